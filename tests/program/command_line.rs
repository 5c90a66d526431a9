//! The command line: exit statuses, the single error line, and interruption.

use std::path::Path;
use std::process::Command;
#[cfg(unix)]
use std::time::Duration;

use colvis::progress::Progress;
use colvis::volume::io::{self, LoadOptions};

use crate::support::program::colvis;
use crate::support::run::run;
use crate::support::skips::skip;

#[test]
fn wrong_usage_is_status_2() {
    for args in [
        &["--warp"][..],
        &["fly", "--headless", "--seconds", "-1"],
        &["fly", "--headless", "--seconds", "nan"],
        &["fly", "--headless", "--rate", "2"],
        &["fly", "--headless", "--guide", "warp"],
        &["fly", "--headless", "--fps", "0"],
        &["fly", "--headless", "--size", "0x10"],
        &["fly", "--headless", "--from", "1,2"],
        &["fly", "--headless", "--wall", "-500,-800"],
        &["fly", "--headless", "--fov", "180", "--record", "x/"],
        &["fly", "--headless", "--threads", "0"],
        &["fly", "--headless", "--scene", "Cargo.toml"],
        &["fly", "--headless", "--record", "film.avi"],
        &["render"],
        &["render", "x.nii", "--poses", "p.json", "--out", "o", "--no-reuse", "--quality", "adaptive"],
        &["phantom", "--out", "x.xyz", "--size", "small"],
        &["info"],
    ] {
        let out = run(args, 2);
        let said = String::from_utf8_lossy(&out.stderr);
        let line = said.lines().find(|l| l.starts_with("error: ")).unwrap();
        assert!(line.matches(": ").count() >= 2 && line.contains("; "), "WHAT: WHY; HOW TO MEND: {line}");
    }
}

#[test]
fn a_missing_scan_is_status_3_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let out = colvis().arg("warp").current_dir(dir.path()).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output();
    let out = out.unwrap();
    assert_eq!(out.status.code(), Some(3), "{}", String::from_utf8_lossy(&out.stderr));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn without_a_display_it_flies_headless_and_leaves_a_film() {
    let dir = tempfile::tempdir().unwrap();
    let out = colvis()
        .args(["--seconds", "4", "--size", "80x60"])
        .current_dir(dir.path())
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success() && said.contains("flying headless"), "{said}");
    let gif = std::fs::File::open(dir.path().join("flight/flight.gif")).unwrap();
    let gif = image::codecs::gif::GifDecoder::new(std::io::BufReader::new(gif)).unwrap();
    let frames = image::AnimationDecoder::into_frames(gif).collect_frames().unwrap();
    assert!(frames.len() > 5 && frames[0].buffer().dimensions() == (80, 60), "{} frames", frames.len());
    let log = std::fs::read_to_string(dir.path().join("flight/flight.jsonl")).unwrap();
    assert_eq!(log.lines().count(), 480);
}

/// Films both directions through the embedded phantom with ffmpeg, and checks the film with ffprobe.
#[test]
#[ignore = "slow: films of a flight both ways"]
fn a_planned_flight_is_filmed_both_ways() {
    let dir = tempfile::tempdir().unwrap();
    let film = dir.path().join("flight.mp4");
    let film = film.to_str().unwrap();
    if !(tool("ffmpeg") && tool("ffprobe")) {
        skip("film", "there is no ffmpeg");
        let out = run(&["fly", "--headless", "--seconds", "0.1", "--size", "80x60", "--record", film], 5);
        assert!(String::from_utf8_lossy(&out.stderr).contains("install ffmpeg"));
        return;
    }
    for way in [&["--reverse"][..], &[]] {
        let flight = ["fly", "--headless", "--guide", "path", "--size", "81x60", "--fps", "24", "--record", film];
        run(&[&flight, way].concat(), 0);
        let probe = ["-v", "error", "-count_frames", "-of", "csv=p=0", "-show_entries"];
        let out = Command::new("ffprobe")
            .args(probe)
            .args(["stream=codec_type,width,height,r_frame_rate,nb_read_frames", film])
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&out.stdout);
        let told: Vec<&str> = told.trim().split(',').collect();
        // An odd width is made even, as the film's encoding requires.
        assert_eq!(told[..4], ["video", "82", "60", "24/1"]);
        assert!(told[4].parse::<u32>().unwrap() > 400, "{told:?}");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "the second film took the first one's place");
}

#[test]
#[ignore = "slow: a run of the program for each output"]
fn outputs_that_cannot_be_written_are_status_5() {
    let dir = tempfile::tempdir().unwrap();
    let missing = dir.path().join("missing/f.jsonl");
    run(&["fly", "--headless", "--seconds", "0.1", "--log", missing.to_str().unwrap()], 5);
    run(&["fly", "--headless", "--seconds", "0.1", "--log", dir.path().to_str().unwrap()], 5);
    run(&["fly", "--headless", "--seconds", "0.5", "--log", "/dev/full"], 5);
    run(&["fly", "--headless", "--seconds", "0.1", "--stats", "/dev/full"], 5);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "nothing half written stays");
}

#[test]
#[ignore = "slow: runs of the program"]
fn points_outside_the_lumen() {
    run(&["fly", "--headless", "--from", "9999,0,0"], 4);
    run(&["fly", "--headless", "--to", "9999,0,0"], 4);
}

/// A colon with tag, and its twin without. In each position fluid lies elsewhere.
#[test]
#[ignore = "slow: phantoms with tag in two positions"]
fn a_phantom_with_tag_and_its_twin() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let with = "folds,polyps,noise,pools,films,stool,inhomogeneous,pseudo";
    let args = ["phantom", "--size", "small", "--with", with, "--out"];
    let twin = at("twin.nii.gz");
    let load = |name: &str| io::load(at(name).as_ref(), &LoadOptions::default(), &Progress::new()).unwrap().volume;
    let mut bright = Vec::new();
    for position in ["supine", "prone"] {
        run(&[&args[..], &[&at("v.nii.gz"), "--twin", &twin, "--position", position]].concat(), 0);
        let (v, t) = (load("v.nii.gz"), load("twin.nii.gz"));
        assert_eq!(v.grid(), t.grid());
        let tagged = v.data().iter().zip(t.data()).filter(|(v, t)| **v > **t + 500).count();
        assert!(tagged > v.data().len() / 500, "{tagged}");
        bright.push(v);
    }
    assert_ne!(bright[0].data(), bright[1].data());
    run(&[&args[..], &[&at("v.nii.gz"), "--twin", &at("v.nii.gz")]].concat(), 2);
    run(&[&args[..], &[&at("v.nii.gz"), "--twin", &at("twin.txt")]].concat(), 2);
    run(&[&args[..], &[&at("v.nii.gz"), "--twin", &at("none/twin.nii")]].concat(), 5);
}

/// Thick slices, and limbs that touch. The truth does not depend on the slices.
#[test]
#[ignore = "slow: phantoms in thick slices"]
fn a_phantom_in_thick_slices() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let out = at("v.nii.gz");
    let args = ["phantom", "--size", "small", "--with", "folds,touching,noise", "--out", &out];
    run(
        &[&args[..], &["--slice", "3", "--noise", "40", "--truth", &at("t.json"), "--labels", &at("l.nii.gz")]]
            .concat(),
        0,
    );
    let load = |name: &str| io::load(at(name).as_ref(), &LoadOptions::default(), &Progress::new()).unwrap().volume;
    let (volume, labels) = (load("v.nii.gz"), load("l.nii.gz"));
    assert_eq!((volume.grid().dims(), volume.grid()), ([230, 186, 81], labels.grid()));
    assert!((volume.grid().spacing().z - 3.0).abs() < 1e-6);
    let truth: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at("t.json")).unwrap()).unwrap();
    assert!(truth["touching"][0]["thickness_mm"].as_f64().unwrap() >= 0.4);
    let refused = ["0.5", "0", "-3", "nan", "inf", "1e9"].map(|mm| ["--slice", mm]);
    for extra in refused.iter().chain(&[["--noise", "-1"], ["--noise", "nan"], ["--noise", "1e9"]]) {
        run(&[&args[..], extra].concat(), 2);
    }
    run(&["phantom", "--size", "small", "--with", "folds", "--noise", "30", "--out", &out], 2);
}

#[test]
#[ignore = "slow: runs of the program"]
fn a_render_of_two_poses_and_their_depth() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    run(&["phantom", "--out", &at("v.nii.gz"), "--size", "small", "--truth", &at("t.json")], 0);
    let truth: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at("t.json")).unwrap()).unwrap();
    let line = truth["centerline"].as_array().unwrap();
    let poses: Vec<_> = [100, 200]
        .iter()
        .map(|&i| serde_json::json!({"position": line[i], "forward": [0, 0, 2], "up": [0, -1, 0.5]}))
        .collect();
    std::fs::write(at("p.json"), serde_json::json!({"fov_degrees": 90, "poses": poses}).to_string()).unwrap();
    let args = ["render", &at("v.nii.gz"), "--poses", &at("p.json"), "--out", &at("o"), "--size", "60x40"];
    run(&[&args[..], &["--depth", "--stats", &at("s.json")]].concat(), 0);
    for n in 0..2 {
        let png = image::open(at(&format!("o/000{n}.png"))).unwrap();
        assert_eq!((png.width(), png.height()), (60, 40));
        let npy = std::fs::read(at(&format!("o/000{n}.npy"))).unwrap();
        let head = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
        assert!(npy.starts_with(b"\x93NUMPY\x01\x00") && head % 64 == 0 && npy.len() == head + 60 * 40 * 4);
        assert!(String::from_utf8_lossy(&npy[..head]).contains("'shape': (40, 60)"));
        let depth: Vec<f32> = npy[head..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert!(depth.iter().all(|d| *d > 3.0 && *d < 43.0), "inside the colon every ray ends at a wall");
    }
    let stats: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at("s.json")).unwrap()).unwrap();
    let frames = stats["frames"].as_array().unwrap();
    let cast = |f: &serde_json::Value| f["rays"].as_u64().unwrap() > 0 && f["samples"].as_u64().unwrap() > 0;
    assert!(frames.len() == 2 && frames.iter().all(|f| cast(f) && f["ms"].as_f64().unwrap() > 0.0));
    // The same pose repeatedly: the picture is refined until nothing is left to do.
    let still = serde_json::json!({ "poses": vec![poses[0].clone(); 12] });
    std::fs::write(at("still.json"), still.to_string()).unwrap();
    let args = ["render", &at("v.nii.gz"), "--poses", &at("still.json"), "--out", &at("o3"), "--size", "60x40"];
    run(&[&args[..], &["--quality", "adaptive", "--stats", &at("s3.json")]].concat(), 0);
    let stats: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at("s3.json")).unwrap()).unwrap();
    assert!(stats["frames"][0]["rays"].as_u64().unwrap() > 0 && stats["frames"][11]["rays"] == 0);
    std::fs::write(at("bad.json"), r#"{"poses": [{"position": [0,0,0], "forward": [0,0,0], "up": [0,1,0]}]}"#).unwrap();
    run(&["render", &at("v.nii.gz"), "--poses", &at("bad.json"), "--out", &at("o2")], 3);
}

#[cfg(unix)]
#[test]
fn an_interrupted_flight_leaves_whole_files() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("f.jsonl");
    let mut child = colvis()
        .args(["fly", "--headless", "--record", dir.path().join("i/").to_str().unwrap(), "--size", "512x512"])
        .args(["--log", log.to_str().unwrap(), "--stats", dir.path().join("s.json").to_str().unwrap()])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // Recording this many large images takes minutes; the first ones exist while the flight is under way.
    wait_for(&mut child, || dir.path().join("i/0001.png").exists());
    signal(&child.id().to_string());
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(4));
    assert!(String::from_utf8_lossy(&out.stderr).contains("error: flight: interrupted"));
    let text = std::fs::read_to_string(&log).unwrap();
    assert!(text.ends_with('\n') && text.lines().all(|l| serde_json::from_str::<serde_json::Value>(l).is_ok()));
    let mut images = 0;
    for entry in std::fs::read_dir(dir.path().join("i")).unwrap() {
        let path = entry.unwrap().path();
        assert!(image::open(&path).is_ok(), "{} is whole", path.display());
        images += 1;
    }
    assert_eq!(frames(&dir.path().join("s.json")), images, "the stats tell of each");
}

/// Returns the number of frames in the stats.
fn frames(stats: &Path) -> usize {
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    stats["frames"].as_array().unwrap().len()
}

/// Returns true if a program can be run.
fn tool(name: &str) -> bool {
    Command::new(name).arg("-version").output().is_ok()
}

/// Waits for a condition while a program runs.
#[cfg(unix)]
fn wait_for(child: &mut std::process::Child, mut there: impl FnMut() -> bool) {
    while !there() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it was interrupted");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(unix)]
fn signal(target: &str) {
    assert!(Command::new("kill").args(["-s", "INT", "--", target]).status().unwrap().success());
}

/// Returns the sizes of the temporary files in a folder.
#[cfg(unix)]
fn temporary(folder: &Path) -> Vec<u64> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap());
    let hidden = entries.filter(|e| e.file_name().to_string_lossy().starts_with(".colvis-"));
    hidden.filter_map(|e| Some(e.metadata().ok()?.len())).collect()
}

/// Ctrl-C in a terminal reaches every program of the process group.
#[cfg(unix)]
#[test]
#[ignore = "slow: a film"]
fn an_interrupted_film_is_whole() {
    use std::os::unix::process::CommandExt;
    if !(tool("ffmpeg") && tool("ffprobe")) {
        skip("film", "there is no ffmpeg");
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let mut child = colvis()
        .args(["fly", "--headless", "--record", &at("f.mp4"), "--size", "512x512"])
        .args(["--log", &at("f.jsonl"), "--stats", &at("s.json")])
        .stderr(std::process::Stdio::piped())
        .process_group(0)
        .spawn()
        .unwrap();
    wait_for(&mut child, || temporary(dir.path()).len() == 2);
    std::thread::sleep(Duration::from_secs(3));
    signal(&format!("-{}", child.id()));
    let out = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(4), "{said}");
    assert!(said.contains("error: flight: interrupted"), "{said}");
    assert!(std::fs::read_to_string(at("f.jsonl")).unwrap().ends_with('\n'));
    let probe = ["-v", "error", "-count_frames", "-of", "csv=p=0", "-show_entries", "stream=nb_read_frames"];
    let told = Command::new("ffprobe").args(probe).arg(at("f.mp4")).output().unwrap();
    let told: usize = String::from_utf8_lossy(&told.stdout).trim().parse().unwrap();
    assert!(told > 0);
    assert_eq!(frames(Path::new(&at("s.json"))), told);
}

#[cfg(unix)]
#[test]
#[ignore = "slow: runs of the program"]
fn a_second_interrupt_ends_at_once_and_leaves_nothing_unfinished() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    // An image with these settings takes minutes.
    let mut child = colvis()
        .args(["fly", "--headless", "--quality", "reference", "--size", "8192x8192", "--record", &at("i/")])
        .args(["--log", &at("f.jsonl")])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    wait_for(&mut child, || temporary(dir.path()).len() == 1);
    std::thread::sleep(Duration::from_secs(1));
    let id = child.id().to_string();
    signal(&id);
    std::thread::sleep(Duration::from_secs(1));
    assert!(child.try_wait().unwrap().is_none());
    signal(&id);
    let out = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(4), "{said}");
    assert_eq!(said.lines().filter(|l| l.starts_with("error: ")).count(), 1, "{said}");
    assert!(temporary(dir.path()).is_empty() && !dir.path().join("f.jsonl").exists());
}

#[cfg(unix)]
#[test]
fn an_interrupted_rendering_tells_of_its_frames() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    solid(&at("s.mha"));
    let pose = serde_json::json!({"position": [4, 4, 40], "forward": [0, 0, -1], "up": [0, -1, 0]});
    std::fs::write(at("p.json"), serde_json::json!({ "poses": vec![pose; 5000] }).to_string()).unwrap();
    let mut child = colvis()
        .args(["render", &at("s.mha"), "--poses", &at("p.json"), "--out", &at("o"), "--stats", &at("s.json")])
        .args(["--size", "256x256", "--quality", "reference"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    wait_for(&mut child, || dir.path().join("o/0001.png").exists());
    signal(&child.id().to_string());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(4));
    assert_eq!(frames(Path::new(&at("s.json"))), std::fs::read_dir(at("o")).unwrap().count());
}

/// Writes a block of tissue, in which there is nothing to fly.
fn solid(path: &str) {
    let head = "ObjectType = Image\nNDims = 3\nDimSize = 8 8 8\nElementSpacing = 1 1 1\nElementType = MET_SHORT\n\
                BinaryDataByteOrderMSB = False\nElementDataFile = LOCAL\n";
    let voxels = std::iter::repeat_n(40i16.to_le_bytes(), 512).flatten();
    std::fs::write(path, head.bytes().chain(voxels).collect::<Vec<u8>>()).unwrap();
}

/// Runs the program without a display.
fn blind(folder: &Path, args: &[&str], status: i32) -> String {
    let mut colvis = colvis();
    for name in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        colvis.env_remove(name);
    }
    let out = colvis.args(args).current_dir(folder).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(status), "{said}");
    assert_eq!(said.lines().filter(|l| l.starts_with("error: ")).count(), usize::from(status != 0), "{said}");
    said
}

#[test]
fn without_a_display_the_reason_why_nothing_is_flown_is_told() {
    let dir = tempfile::tempdir().unwrap();
    solid(dir.path().join("s.mha").to_str().unwrap());
    let said = blind(dir.path(), &["s.mha"], 4);
    assert_eq!(std::fs::read(dir.path().join("flight/flight.jsonl")).unwrap(), b"");
    // The reason is the same if the folder cannot be created.
    std::fs::remove_dir_all(dir.path().join("flight")).unwrap();
    std::fs::write(dir.path().join("flight"), "in the way").unwrap();
    let again = blind(dir.path(), &["s.mha"], 4);
    assert_eq!(said.lines().last(), again.lines().last());
}

#[test]
fn what_was_flown_until_a_replayed_command_is_refused_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(at("in.jsonl"), "{\"tick\":60,\"command\":{\"segment\":99}}\n").unwrap();
    let args = ["fly", "--headless", "--replay", &at("in.jsonl"), "--log", &at("f.jsonl"), "--stats", &at("s.json")];
    let out = run(&[&args[..], &["--record", &at("f.gif"), "--size", "40x30", "--fps", "12"]].concat(), 4);
    assert!(String::from_utf8_lossy(&out.stderr).contains("no segment 99"));
    assert_eq!(std::fs::read_to_string(at("f.jsonl")).unwrap().lines().count(), 60);
    let gif = std::io::BufReader::new(std::fs::File::open(at("f.gif")).unwrap());
    let images = image::AnimationDecoder::into_frames(image::codecs::gif::GifDecoder::new(gif).unwrap());
    let images = images.collect_frames().unwrap().len();
    assert!(images >= 6 && images == frames(Path::new(&at("s.json"))));
}

#[test]
fn no_output_takes_the_place_of_an_input() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    std::fs::create_dir(at("slices")).unwrap();
    image::GrayImage::new(8, 8).save(at("slices/0000.png")).unwrap();
    std::fs::write(at("p.json"), r#"{"poses": []}"#).unwrap();
    solid(&at("s.mha"));
    std::fs::create_dir(at("flight")).unwrap();
    std::fs::write(at("flight/flight.jsonl"), "").unwrap();
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/plane/ring.png"), at("plane.png")).unwrap();
    let before = |name: &str| std::fs::read(at(name)).unwrap();
    let names = ["slices/0000.png", "p.json", "s.mha", "flight/flight.jsonl", "plane.png"];
    let contents = names.map(before);
    let (slices, poses, scan) = (at("slices/"), at("p.json"), at("s.mha"));
    run(&["render", &slices, "--spacing", "1,1,1", "--poses", &poses, "--out", &at("slices")], 2);
    run(&["render", &scan, "--poses", &poses, "--out", &at("o"), "--stats", &scan], 2);
    run(&["render", &scan, "--poses", &poses, "--out", &at("o"), "--stats", &poses], 2);
    run(&["fly", &slices, "--spacing", "1,1,1", "--headless", "--record", &slices], 2);
    run(&["fly", &scan, "--headless", "--record", &at("i/"), "--stats", &scan], 2);
    blind(dir.path(), &["--play", "flight/flight.jsonl"], 2);
    blind(dir.path(), &["plane", "plane.png"], 2);
    assert_eq!(names.map(before), contents);
    assert!(!Path::new(&at("o")).exists(), "refused before anything is made");
}

#[test]
#[ignore = "slow: runs of the program"]
fn explain_tells_of_the_renderer_that_flies() {
    for (args, windowed) in [(&[][..], cfg!(feature = "window")), (&["--headless", "--record", "x/"], false)] {
        let out = run(&[&["explain"], args].concat(), 0);
        // A window refines its pictures when the camera rests.
        assert_eq!(String::from_utf8_lossy(&out.stdout).contains("refinement"), windowed, "{args:?}");
    }
}

#[test]
#[cfg(feature = "window")]
#[ignore = "slow: six runs of the program"]
fn explain_tells_of_the_slices_that_a_layout_shows() {
    // Pixels of a slice: HU, grey and colour.
    let bytes = |slices: u64| slices * 400 * 300 * (4 + 1 + 3);
    for (layout, slices) in [("flight", 0), ("reading", 3), ("slices", 4), ("across", 1)] {
        let out = run(&["explain", "--json", "--layout", layout], 0);
        let told: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        let all = |list: &str| told[list].as_array().unwrap().clone();
        let scheduled = all("frame").iter().any(|system| system == "slices::make_slices");
        let built = all("built").iter().find(|b| b["part"] == "slices").map(|b| b["bytes"].as_u64().unwrap());
        let left_out = all("left_out").iter().any(|l| l["part"] == "slices" && l["why"] == "no panel shows slices");
        assert_eq!((scheduled, left_out), (slices > 0, slices == 0), "{layout}");
        assert_eq!(built, (slices > 0).then(|| bytes(slices)), "{layout}");
    }
    for args in [&[][..], &["--headless", "--layout", "reading"]] {
        let out = run(&[&["explain"], args].concat(), 0);
        let told = String::from_utf8_lossy(&out.stdout).into_owned();
        assert!(told.contains("no panel shows slices") && !told.contains("make_slices"), "{told}");
    }
}

#[test]
#[cfg(feature = "window")]
#[ignore = "slow: runs of the program"]
fn explain_lists_the_actions_by_their_ids_and_the_settings_that_take_them() {
    let folder = tempfile::tempdir().unwrap();
    let settings = folder.path().join("colvis/settings.toml");
    std::fs::create_dir_all(settings.parent().unwrap()).unwrap();
    let explained = |keys: &str| {
        std::fs::write(&settings, format!("version = 1\n[keys]\n{keys}\n")).unwrap();
        let out = colvis().arg("explain").env("XDG_CONFIG_HOME", folder.path()).output().unwrap();
        assert!(out.status.success());
        [out.stdout, out.stderr].map(|text| String::from_utf8_lossy(&text).into_owned())
    };
    let row = |told: &str, id: &str| {
        let line = told
            .lines()
            .skip_while(|l| !l.starts_with("actions of the window"))
            .find(|l| l.split_whitespace().next() == Some(id));
        line.unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let [told, said] = explained("");
    assert_eq!(row(&told, "reverse"), "reverse R, B, Backspace turn round and fly back");
    assert_eq!(row(&told, "guide-path"), "guide-path 3 switch to guide path");
    assert!(!said.contains("note: "), "{said}");
    if cfg!(target_os = "linux") {
        assert_eq!(row(&explained("reverse = [\"Z\"]")[0], "reverse"), "reverse Z turn round and fly back");
        let [told, said] = explained("warp = [\"Z\"]");
        assert_eq!(row(&told, "reverse"), "reverse R, B, Backspace turn round and fly back");
        assert!(said.contains("there is no action \"warp\"; ") && said.contains("explain lists them"), "{said}");
    }
}

/// A program of another crate runs the same code under its own name.
#[test]
fn hints_name_the_program_that_runs() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("viewer");
    std::fs::copy(colvis().get_program(), &program).unwrap();
    let told = |args: &[&str]| {
        let out = Command::new(&program).args(args).current_dir(folder.path()).output().unwrap();
        String::from_utf8_lossy(&[out.stdout, out.stderr].concat()).into_owned()
    };
    for args in [&["--warp"][..], &["none.nii"], &["dataset"], &["--second", "a.nii"], &["info"], &["--keys", "fly"]] {
        let told = told(args);
        assert!(told.contains("see viewer --help") && !told.contains("colvis --"), "{args:?}: {told}");
    }
    let help = told(&["--help"]);
    assert!(help.contains("Usage: viewer "), "{help}");
}

/// `--help keys` is the list of keys that the window shows.
#[cfg(feature = "window")]
#[test]
fn the_keys_of_the_window_are_printed() {
    for help in ["--help", "-h", "help"] {
        let out = colvis().args([help, "keys"]).output().unwrap();
        let page = String::from_utf8(out.stdout).unwrap();
        assert!(out.status.success() && page.starts_with("Findings\n  J  "), "{page}");
        for line in ["\nSteer\n", "  Space", "Ctrl+Q", "turn round and fly back", "\nCandidates\n", "\nHelp\n"] {
            assert!(page.contains(line), "{line}: {page}");
        }
    }
}
