//! Extreme arguments and outputs: absurd numbers, devices that are full, streams that are shared.

use std::fs::OpenOptions;
use std::path::Path;
use std::process::Stdio;

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
fn what_is_ignored_or_impossible_is_told_before_the_work() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let scan = at("p.nii.gz");
    assert!(said(&["phantom", "--size", "small", "--out", &at("p.txt")], 2).contains("p.txt"));
    run(&["phantom", "--size", "small", "--out", &scan], 0);
    assert!(said(&["segment", &scan, "--out", &at("m.txt")], 2).contains("m.txt"));
    assert!(said(&["info", &scan, "--series", "7"], 0).is_empty(), "info reads every header");
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
