//! Two positions of one patient in the real window: the same place there and back, and a finding in both.

use serde_json::Value;

use super::findings::{click, list, quit, screen, vector};
use super::*;

/// A place of one position is expected in the other within this, mm.
const SAME_MM: f64 = 15.0;

/// Returns what the files of findings hold, that of each scan by its name.
fn kept(folder: &Path) -> Vec<Value> {
    let files = fs::read_dir(folder.join("state/colvis/findings")).into_iter().flatten().map(|e| e.unwrap().path());
    let files = files.filter(|p| !p.file_name().unwrap().to_string_lossy().starts_with(".colvis-"));
    let read = |p| serde_json::from_slice(&fs::read(p).unwrap()).expect("valid JSON");
    files.map(read).filter(|found: &Value| !list(found, "findings").is_empty()).collect()
}

fn findings(found: &Value) -> &[Value] {
    list(found, "findings")
}

/// Does something again and again until the files are as wanted.
fn until(folder: &Path, what: &str, mut act: impl FnMut(), wanted: impl Fn(&[Value]) -> bool) -> Vec<Value> {
    let begun = Instant::now();
    loop {
        act();
        std::thread::sleep(Duration::from_millis(1500));
        let kept = kept(folder);
        if wanted(&kept) {
            return kept;
        }
        assert!(begun.elapsed() < PATIENCE, "the files never hold {what}: {kept:#?}");
    }
}

/// Waits until two pictures are the same.
fn still(screen: &Screen) -> RgbImage {
    let mut before = None;
    screen.shot_when("a still image", |now| before.replace(now.clone()).is_some_and(|b| b == *now))
}

#[test]
#[ignore = "slow: a sitting with two positions"]
fn a_place_is_gone_to_in_the_other_position_and_back_and_a_finding_is_in_both() {
    let Some(screen) = screen() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let args = ["phantom", "--out", "a.nii.gz", "--second", "b.nii.gz", "--truth", "t.json", "--size", "small"];
    let made =
        colvis().args(args).args(["--with", "folds,polyps,fluid,noise", "--seed", "3"]).current_dir(folder).status();
    assert!(made.unwrap().success());
    let truth: Value = serde_json::from_slice(&fs::read(folder.join("t.json")).unwrap()).unwrap();
    keep_settings(folder, "[keys]\nfinding-apart = [\"Q\"]\nfinding-same = [\"Z\"]\n");
    let window = screen.open_window(folder, &["fly", "a.nii.gz", "--second", "b.nii.gz", "--size", "1280x800"], |i| {
        flies(i) && share(i, |p| p == [96, 190, 255]) > 0.001
    });
    screen.key("space");
    still(&screen);
    // A finding ahead, and the same place in the other position as soon as that is known.
    until(folder, "a finding", || screen.key("j"), |kept| kept.len() == 1);
    let act =
        || ["F7", "j"].into_iter().for_each(|key| (screen.key(key), std::thread::sleep(Duration::from_secs(2))).1);
    let kept_both = until(folder, "a finding of each", act, |kept| kept.len() == 2);
    let [a, b] = &kept_both[..] else { panic!("{kept_both:?}") };
    for (one, other) in [(a, b), (b, a)] {
        assert_eq!(one["second"], other["scan"]);
        assert_eq!(findings(one)[0]["other"], findings(other)[0]["place"], "{kept_both:#?}");
    }
    // Parted, and joined again by hand.
    for (key, is_one) in [("q", false), ("z", true)] {
        let is_paired = |one: &Value| !findings(one)[0]["other"].is_null();
        screen.key(key);
        until(
            folder,
            "the same pair",
            || {},
            |kept| kept.len() == 2 && kept.iter().all(|one| is_paired(one) == is_one),
        );
    }
    // By the truth, they are one place.
    let points = |of: &str| list(&truth["second"]["points"], of).iter().map(vector).collect::<Vec<_>>();
    let (first, second) = (points("first"), points("second"));
    let [p, q] = [a, b].map(|found| vector(&findings(found)[0]["place"]));
    let nearest = |list: &[DVec3], at: DVec3| {
        (0..list.len()).min_by(|i, j| list[*i].distance(at).total_cmp(&list[*j].distance(at))).unwrap()
    };
    // Which file is whose is told by which list of points is nearer.
    let (p, q) =
        if first[nearest(&first, p)].distance(p) < first[nearest(&first, q)].distance(q) { (p, q) } else { (q, p) };
    let there = second[nearest(&first, p)];
    assert!(there.distance(q) < SAME_MM + 10.0, "{there} and {q}");

    // There and back five times: everything is where it was.
    screen.key("F7");
    let before = still(&screen);
    for _ in 0..5 {
        for _ in 0..2 {
            screen.key("F7");
            std::thread::sleep(Duration::from_millis(400));
        }
    }
    // The message of the last move has to go.
    std::thread::sleep(Duration::from_secs(4));
    let after = still(&screen);
    let differing = before.pixels().zip(after.pixels()).filter(|(a, b)| a != b).count();
    assert!(differing < 8000, "{differing}: {}", keep("window there and back", &after).display());

    // Into the other's picture, where the finding is undone: it is in one position again.
    click(&screen, (960, 300));
    screen.key("ctrl+z");
    let left = until(folder, "one finding", || {}, |kept| kept.len() == 1);
    assert!(left[0]["findings"][0]["other"].is_null(), "{left:#?}");
    quit(&screen, window);
}
