//! Extreme arguments and outputs: absurd numbers, devices that are full, streams that are shared.

use std::fs::OpenOptions;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::program::colvis;
use crate::support::run::run;

fn said(args: &[&str], status: i32) -> String {
    String::from_utf8(run(args, status).stderr).unwrap()
}

#[test]
fn absurd_numbers_and_names_make_short_messages() {
    for args in [
        &["--wall", "-1e308,1e308", "fly", "--headless"][..],
        &["fly", "--headless", "--seconds", "-1e308"],
        &["fly", "--headless", "--from", "1e308,0,0"],
        &["--fov", "1e308", "fly", "--headless", "--record", "x/"],
        &["--spacing", "1e308,1,1", "fly", "--headless"],
        &["info", &"x".repeat(3000)],
    ] {
        let status = if args[0] == "info" {
            3
        } else if args.contains(&"--from") {
            4
        } else {
            2
        };
        let told = said(args, status);
        assert!(told.len() < 1500 && !told.contains("inf") && !told.contains("00000000"), "{args:?}: {told}");
    }
}

#[test]
fn more_threads_than_help_are_refused_or_capped() {
    assert!(said(&["--threads", "257", "info", "absent"], 2).contains("1 to 256"));
    let out = colvis().args(["info", "absent"]).env("RAYON_NUM_THREADS", "65535").output().unwrap();
    assert_eq!(out.status.code(), Some(3));
}

#[test]
#[ignore = "slow: many runs of the program"]
fn what_is_ignored_or_impossible_is_told_before_the_work() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let scan = at("p.nii.gz");
    assert!(said(&["phantom", "--size", "small", "--out", &at("p.txt")], 2).contains("p.txt"));
    run(&["phantom", "--size", "small", "--out", &scan], 0);
    assert!(said(&["segment", &scan, "--out", &at("m.txt")], 2).contains("m.txt"));
    assert!(said(&["info", &scan, "--series", "7"], 0).contains("--series is ignored"));
    assert!(said(&["segment", &scan, "--series", "7", "--out", &at("m.nii")], 0).contains("--series is ignored"));
    for ends in [["rectum", "rectum"], ["cecum", "cecum"]] {
        let line = at("line.csv");
        let told = said(&["centerline", &scan, "--from", ends[0], "--to", ends[1], "--out", &line], 4);
        assert!(told.contains("start and goal coincide") && !Path::new(&line).exists(), "{told}");
    }
}

/// Devices and redirections as Unix has them.
#[cfg(unix)]
#[test]
fn streams_that_are_full_closed_or_shared_lose_nothing() {
    let full = || Stdio::from(OpenOptions::new().write(true).open("/dev/full").unwrap());
    for (args, status) in [(&["info", "absent"][..], 3), (&["fly", "--warp"], 2)] {
        let out = colvis().args(args).stderr(full()).output().unwrap();
        assert_eq!(out.status.code(), Some(status), "{args:?}: a full standard error changes no status");
    }
    let out = colvis().args(["--help"]).stdout(full()).output().unwrap();
    assert_eq!(out.status.code(), Some(5), "help that cannot be written");
    // A log behind `>>` follows what is there.
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log");
    std::fs::write(&path, "first\n").unwrap();
    let appended = OpenOptions::new().append(true).open(&path).unwrap();
    let fly = ["fly", "--headless", "--seconds", "0.1", "--log", "/dev/stdout"];
    let out = colvis().args(fly).stdout(Stdio::from(appended)).output().unwrap();
    assert_eq!(out.status.code(), Some(0));
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.starts_with("first\n{") && text.lines().count() > 10, "{text}");
}

#[test]
fn numbers_that_do_not_fit_are_told_plainly() {
    for (args, told) in [
        (&["fly", "--rate", "2"][..], "--rate: needs --play"),
        (&["report", "perforation", "--out", "r", "--steps", "-1"], "must be a whole number, 1 or more"),
        (&["report", "perforation", "--out", "r", "--steps", "0"], "must be a whole number, 1 or more"),
        (&["--threads", "-1", "info", "absent"], "must be a whole number from 1 to 256"),
        (&["--seed", "-1", "fly"], "must be a whole number from 0 to"),
        (&["info", "absent", "--series", "-3"], "must be a whole number from 1 to 4096"),
        (&["fly", "--size", "-3x3"], "a whole number from 1 to 16384"),
    ] {
        let text = said(args, 2);
        assert!(text.contains(told) && !text.contains("unexpected argument"), "{args:?}: {text}");
    }
}

#[test]
fn a_flight_however_short_has_a_step() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    run(&["fly", "--headless", "--seconds", "1e-9", "--log", &at("f.jsonl"), "--stats", &at("s.json")], 0);
    let (log, stats) = ["f.jsonl", "s.json"].map(|name| std::fs::read_to_string(at(name)).unwrap()).into();
    assert!(log.lines().count() == 1 && log.contains("\"state\":\"ended\""), "{log}");
    assert!(stats.contains("\"state\": \"ended\""), "{stats}");
}

/// Writes a block of tissue without any gas.
fn tissue(path: &str) {
    let head = "ObjectType = Image\nNDims = 3\nDimSize = 16 16 16\nElementSpacing = 1 1 1\nElementType = MET_SHORT\n\
                BinaryDataByteOrderMSB = False\nElementDataFile = LOCAL\n";
    let voxels = std::iter::repeat_n(40i16.to_le_bytes(), 4096).flatten();
    std::fs::write(path, head.bytes().chain(voxels).collect::<Vec<u8>>()).unwrap();
}

#[test]
fn a_scan_without_gas_has_no_lumen() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    tissue(&at("s.mha"));
    for (command, out) in [("segment", "m.nii.gz"), ("surface", "m.stl")] {
        let told = said(&[command, &at("s.mha"), "--out", &at(out)], 4);
        assert!(told.contains("error: volume: no gas of a colon was found in it: no voxel near -1000 HU"), "{told}");
        assert!(told.contains("; give a scan in HU"), "{told}");
    }
    assert!(Path::new(&at("m.nii.gz")).exists() && !Path::new(&at("m.stl")).exists(), "an empty mask is a mask");
}

#[test]
fn a_wrong_setting_is_told_with_file_line_and_name() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("s.toml").to_str().unwrap().to_owned();
    for (table, key) in [("body", "mass_g"), ("tentacles", "count")] {
        std::fs::write(&scene, format!("plugins = [\"tentacles\"]\n\n[{table}]\n{key} = \"many\"\n")).unwrap();
        let told = said(&["fly", "--headless", "--scene", &scene], 2);
        assert!(told.contains(&format!("s.toml: line 4: {table}.{key}: invalid type: string \"many\"")), "{told}");
    }
}

#[test]
fn a_file_in_a_folders_place_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(at("f"), "x").unwrap();
    assert!(said(&["fly", "--headless", "--record", &at("f/")], 5).contains("f is a file"));
    assert!(said(&["fly", "--headless", "--log", &at("f/deep/l.jsonl")], 5).contains("its folder is a file"));
}

/// Sends a signal at once: starting `kill` would take longer than the time between two of them.
#[cfg(unix)]
fn signal(child: &Child, name: &str, times: usize) {
    let kill = format!("kill -{name} {}; sleep 0.001; ", child.id()).repeat(times);
    assert!(Command::new("sh").args(["-c", &format!("{kill} true")]).stderr(Stdio::null()).status().unwrap().success());
}

/// Starts the program, and waits until `there`.
#[cfg(unix)]
fn started(args: &[&str], there: impl Fn() -> bool) -> Child {
    let mut child = colvis().args(args).stderr(Stdio::piped()).spawn().unwrap();
    while !there() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it was interrupted");
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

#[cfg(unix)]
fn hidden(folder: &Path) -> usize {
    let names = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name());
    names.filter(|n| n.to_string_lossy().starts_with(".colvis-")).count()
}

/// The second interrupt comes while the first is told of.
#[cfg(unix)]
#[test]
#[ignore = "slow: many runs that are interrupted"]
fn interrupts_in_quick_succession_tell_one_line_and_leave_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    // Made once: reading it takes a fraction of the time.
    let scan = at("phantom.mha");
    run(&["phantom", "--size", "small", "--out", &scan], 0);
    for n in 0..15 {
        let args = ["fly", &scan, "--headless", "--log", &at("f.jsonl"), "--stats", &at("s.json")];
        let child =
            started(&[&args[..], &["--size", "32x32", "--record", &at("i/")]].concat(), || hidden(dir.path()) > 0);
        signal(&child, "INT", 2 + n % 2);
        let out = child.wait_with_output().unwrap();
        let told = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(4), "{told}");
        assert_eq!(told.lines().filter(|l| l.starts_with("error: ")).count(), 1, "{told}");
        assert_eq!(hidden(dir.path()) + hidden(&dir.path().join("i")), 0, "run {n}: {told}");
    }
}

/// Its depths take seconds.
#[cfg(unix)]
#[test]
fn a_large_depth_image_is_interrupted_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    tissue(&at("s.mha"));
    let pose = serde_json::json!({"position": [8, 8, 30], "forward": [0, 0, -1], "up": [0, -1, 0]});
    std::fs::write(at("p.json"), serde_json::json!({ "poses": [pose] }).to_string()).unwrap();
    let size = ["--size", "8192x8192", "--depth"];
    let args = ["render", &at("s.mha"), "--poses", &at("p.json"), "--out", &at("o")];
    let child = started(&[&args[..], &size].concat(), || dir.path().join("o").exists());
    std::thread::sleep(Duration::from_millis(500));
    let begun = Instant::now();
    signal(&child, "TERM", 1);
    let out = child.wait_with_output().unwrap();
    assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
    assert_eq!(out.status.code(), Some(4), "{}", String::from_utf8_lossy(&out.stderr));
    assert!(!dir.path().join("o/0000.npy").exists());
}
