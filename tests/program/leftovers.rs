//! Files left behind by a killed program are removed by the next one that writes there; files of a running program are
//! not.
#![cfg(unix)]

use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::support::program::colvis;
use crate::support::run::run;

/// Starts a flight that writes its log for minutes.
fn flight(folder: &Path, name: &str) -> Child {
    let at = |n: &str| folder.join(n).to_str().unwrap().to_owned();
    let pictures = folder.parent().unwrap().join(name);
    colvis()
        .args(["fly", "--headless", "--quality", "reference", "--size", "2048x2048"])
        .args(["--record", &format!("{}/", pictures.display()), "--log", &at(&format!("{name}.jsonl"))])
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn temporary(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|n| n.starts_with(".colvis-")).collect();
    names.sort();
    names
}

fn wait_for(mut there: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !there() {
        assert!(begun.elapsed() < Duration::from_secs(120), "nothing is written");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
#[ignore = "slow: flights that are killed"]
fn a_killed_writers_files_go_and_a_living_ones_stay() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("logs");
    std::fs::create_dir(&folder).unwrap();
    let mut living = flight(&folder, "living");
    wait_for(|| temporary(&folder).len() == 1);
    let own = temporary(&folder);
    let mut killed = flight(&folder, "killed");
    wait_for(|| temporary(&folder).len() == 2);
    // SIGKILL leaves the program no chance to clean up.
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert_eq!(temporary(&folder).len(), 2, "it cannot clean up after itself");
    let out = folder.join("p.json");
    let next = ["phantom", "--size", "small", "--out"];
    let volume = dir.path().join("v.nii.gz");
    run(&[&next[..], &[volume.to_str().unwrap(), "--truth", out.to_str().unwrap()]].concat(), 0);
    let left = temporary(&folder);
    living.kill().unwrap();
    living.wait().unwrap();
    assert_eq!(left, own, "the killed one's file is gone, the living one's is there");
    run(&[&next[..], &[volume.to_str().unwrap(), "--truth", out.to_str().unwrap()]].concat(), 0);
    assert_eq!(temporary(&folder), Vec::<String>::new());
}
