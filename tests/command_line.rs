//! The contract's command line: statuses, the one error line, and interruption.

mod flying;

use flying::{colvis, run};

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

/// Both ways through the embedded phantom, by ffmpeg; what ffprobe then says of the film.
#[test]
fn a_planned_flight_is_filmed_both_ways() {
    let dir = tempfile::tempdir().unwrap();
    let film = dir.path().join("flight.mp4");
    let film = film.to_str().unwrap();
    let tool = |name: &str| std::process::Command::new(name).arg("-version").output().is_ok();
    if !(tool("ffmpeg") && tool("ffprobe")) {
        println!("skipped: no ffmpeg here");
        let out = run(&["fly", "--headless", "--seconds", "0.1", "--size", "80x60", "--record", film], 5);
        assert!(String::from_utf8_lossy(&out.stderr).contains("install ffmpeg"));
        return;
    }
    for way in [&["--reverse"][..], &[]] {
        let flight = ["fly", "--headless", "--guide", "path", "--size", "81x60", "--fps", "24", "--record", film];
        run(&[&flight, way].concat(), 0);
        let probe = ["-v", "error", "-count_frames", "-of", "csv=p=0", "-show_entries"];
        let out = std::process::Command::new("ffprobe")
            .args(probe)
            .args(["stream=codec_type,width,height,r_frame_rate,nb_read_frames", film])
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&out.stdout);
        let told: Vec<&str> = told.trim().split(',').collect();
        // An odd width is made even, as the film's coding asks.
        assert_eq!(told[..4], ["video", "82", "60", "24/1"]);
        assert!(told[4].parse::<u32>().unwrap() > 100, "{told:?}");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "the second film took the first one's place");
}

#[test]
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
fn points_outside_the_lumen() {
    run(&["fly", "--headless", "--from", "9999,0,0"], 4);
    run(&["fly", "--headless", "--to", "9999,0,0"], 4);
}

#[test]
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
        assert!(depth.iter().all(|d| *d > 0.5 && *d < 400.0), "inside the colon every ray ends at a wall");
    }
    let stats: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at("s.json")).unwrap()).unwrap();
    let frames = stats["frames"].as_array().unwrap();
    let cast = |f: &serde_json::Value| f["rays"].as_u64().unwrap() > 0 && f["samples"].as_u64().unwrap() > 0;
    assert!(frames.len() == 2 && frames.iter().all(|f| cast(f) && f["ms"].as_f64().unwrap() > 0.0));
    // The same place again and again: it is refined, and then nothing is left to do.
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
        .args(["--log", log.to_str().unwrap()])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // Recording so many large images takes minutes; the first are there when the flight is under way.
    while !dir.path().join("i/0001.png").exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it was interrupted");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(4));
    assert!(String::from_utf8_lossy(&out.stderr).contains("error: flight: interrupted"));
    let text = std::fs::read_to_string(&log).unwrap();
    assert!(text.ends_with('\n') && text.lines().all(|l| serde_json::from_str::<serde_json::Value>(l).is_ok()));
    for entry in std::fs::read_dir(dir.path().join("i")).unwrap() {
        let path = entry.unwrap().path();
        assert!(image::open(&path).is_ok(), "{} is whole", path.display());
    }
}
