//! A sitting in the real window from the first finding to the report: findings by each way there is, corrected, undone, deleted, and there
//! again when the scan is opened the next time.

use colvis::volume::io::LoadOptions;
use serde_json::Value;

use super::findings::{
    assert_same, camera, click, ids, kept, kept_when, list, open, quit, report, screen, vector, wall, write_phantom,
};
use super::*;
use crate::support::scan_study::write_scan;
use crate::support::scans::data;

/// Keys for what has none.
const KEYS: &str = r#"[keys]
panel-findings = ["Ctrl+F6"]
panel-quality = ["Ctrl+F7"]
finding-measured = ["Ctrl+F8"]
finding-correct = ["Ctrl+F9"]
finding-delete = ["Ctrl+F10"]
"#;

/// The middle of the axial slice in the layout for reading, pixels. A place that is gone to is there.
const MIDDLE: (u32, u32) = (993, 236);
/// The field for the note of the chosen finding, in the findings panel.
const NOTE: (u32, u32) = (1088, 541);
/// A place of the wall in the flight's picture, away from its middle.
const WALL: (u32, u32) = (200, 250);

/// A sitting in a window.
struct Sitting<'a> {
    name: &'static str,
    screen: &'a Screen,
    folder: &'a Path,
}

impl Sitting<'_> {
    /// Waits until the file holds so many findings. Returns the last, and all that the file holds.
    fn found(&self, count: usize) -> (Value, Value) {
        let is_all = |found: &Value| list(found, "findings").len() == count;
        let (_, found) = kept_when(self.folder, &format!("{count} findings"), is_all);
        let last = list(&found, "findings").last().cloned().unwrap_or_default();
        (last, found)
    }

    /// Keeps what the screen shows, for whoever looks at the sittings.
    fn shot(&self, what: &str) {
        keep(&format!("sitting {} {what}", self.name), &self.screen.shot());
    }

    /// Waits until the flight's picture, without what is written below it, stands still.
    fn until_still(&self, what: &str) {
        let (mut before, mut count) = (None, 0);
        self.screen.shot_when(what, |shot| {
            let now = image::imageops::crop_imm(shot, 150, 60, 330, 660).to_image();
            count = if before.as_ref() == Some(&now) { count + 1 } else { 0 };
            before = Some(now);
            count == 6
        });
    }

    /// Answers a candidate with yes and marks it.
    fn mark_candidate(&self) {
        self.screen.key("k");
        // It is not known when the list is there. Until then, the keys are refused.
        let begun = Instant::now();
        let is_answered = || kept(self.folder).is_some_and(|(_, found)| !list(&found, "answers").is_empty());
        while !is_answered() {
            assert!(begun.elapsed() < PATIENCE, "no candidate is answered");
            for key in ["Return", "y"] {
                self.screen.key(key);
                std::thread::sleep(Duration::from_secs(1));
            }
        }
        // The answer went on to the next one.
        self.screen.key("ctrl+Return");
        std::thread::sleep(Duration::from_secs(1));
        self.screen.key("j");
        let (finding, found) = self.found(4);
        self.until_still("the candidate");
        self.shot("candidate");
        let answers = list(&found, "answers").iter().filter(|a| a["answer"] == "yes");
        let nearest = answers.map(|a| vector(&a["position"]).distance(vector(&finding["place"]))).reduce(f64::min);
        assert!(nearest.is_some_and(|mm| mm < 1e-3), "{nearest:?} mm: {found:#}");
        assert!(finding["ends"].is_array(), "{finding:#}");
        self.screen.key("k");
    }

    /// Goes to a missed patch and marks it.
    fn mark_missed(&self) {
        let (_, before) = self.found(4);
        self.screen.key("p");
        let is_chosen = |i: &RgbImage| share(i, |p| p == [38, 62, 84]) > 0.005;
        let is_painted = |i: &RgbImage| share(i, |[r, g, b]| r > 220 && g < 110 && b > 180) > 0.0005;
        self.screen.shot_when("paint on the wall that was not seen", is_painted);
        self.screen.key("f");
        self.screen.shot_when("a missed patch in the list", is_chosen);
        self.until_still("the missed patch");
        self.screen.key("j");
        let (finding, _) = self.found(5);
        self.shot("missed patch");
        let place = vector(&finding["place"]);
        for other in list(&before, "findings") {
            assert!(place.distance(vector(&other["place"])) > 5.0, "{finding:#} {other:#}");
        }
        self.screen.key("p");
        self.until_still("no paint");
    }

    /// Measures the diameter of the chosen finding by hand, and drags one of its ends. Undoes that.
    fn correct(&self) {
        let ([left, right], more) = ([MIDDLE.0 - 20, MIDDLE.0 + 20].map(|x| (x, MIDDLE.1)), MIDDLE.0 + 40);
        let ends =
            |found: &Value| -> Option<[DVec3; 2]> { serde_json::from_value(found["findings"][4]["ends"].clone()).ok() };
        self.screen.key("ctrl+F9");
        for at in [left, right] {
            click(self.screen, at);
        }
        let is_across = |ends: [DVec3; 2]| {
            let across = ends[1] - ends[0];
            across.x > 1.0 && across.y.abs() < 1e-3 && across.z.abs() < 1e-3
        };
        let (_, found) = kept_when(self.folder, "a diameter across", |found| ends(found).is_some_and(is_across));
        let by_hand = ends(&found).unwrap();
        let (mm, corrected) = (by_hand[0].distance(by_hand[1]), &found["findings"][4]);
        assert!((corrected["diameter_mm"].as_f64().unwrap() - mm).abs() < 1e-6 && corrected["volume_mm3"].is_null());
        assert_eq!(list(&found, "distances").len(), 1, "it is no distance");
        let [from, to] = [right.0, more].map(|x| x.to_string());
        let y = right.1.to_string();
        let drag = ["mousemove", &from, &y, "sleep", "0.3", "mousedown", "1", "sleep", "0.3", "mousemove", &to, &y];
        self.screen.tool("xdotool", &[&drag[..], &["sleep", "0.3", "mouseup", "1"]].concat());
        // 60 pixels in place of 40.
        let is_longer = |[a, b]: [DVec3; 2]| (a.distance(b) / mm - 1.5).abs() < 0.1 && a.distance(by_hand[0]) < 1e-3;
        let is_dragged = |ends: [DVec3; 2]| is_across(ends) && is_longer(ends);
        kept_when(self.folder, "a dragged end", |found| ends(found).is_some_and(is_dragged));
        self.shot("dragged");
        self.screen.key("ctrl+z");
        kept_when(self.folder, "the former end", |found| ends(found) == Some(by_hand));
    }

    /// Writes a note into the field of the findings panel.
    fn note(&self, words: &str) {
        self.screen.key("ctrl+F6");
        self.until_still("the panel");
        click(self.screen, NOTE);
        self.screen.tool("xdotool", &["type", "--delay", "60", words]);
        kept_when(self.folder, "a note", |found| found["findings"][4]["note"] == words);
        self.shot("note");
        // The keys are the window's again.
        self.screen.key("Escape");
        self.screen.key("ctrl+F6");
        self.until_still("no panel");
    }

    /// Undoes one finding more and deletes another.
    fn undo_and_delete(&self) {
        click(self.screen, WALL);
        for key in ["ctrl+z", "ctrl+F10"] {
            self.screen.key("j");
            self.found(6);
            self.screen.key(key);
            let (_, found) = self.found(5);
            assert_eq!(ids(&found), ["1", "2", "3", "4", "5"]);
        }
    }

    /// Quits twice: the window asks first, because candidates have no answer.
    fn quit(&self, window: Running) {
        self.screen.key("ctrl+q");
        self.until_still("the question");
        self.shot("quit");
        quit(self.screen, window);
    }
}

fn sit(name: &'static str, folder: &Path, scan: &str) {
    let Some(screen) = screen() else { return };
    let shots = folder.join("shots");
    keep_settings(folder, &format!("screenshots = {:?}\n{KEYS}", shots.to_str().unwrap()));
    let sitting = Sitting { name, screen: &screen, folder };
    let window = open(&screen, folder, scan, true);

    // From the flight's picture, from a slice, and a distance.
    screen.key("j");
    sitting.found(1);
    let shot = screen.shot();
    let at = camera(&shot).unwrap();
    let [left, right] = [true, false].map(|is_left| wall(&shot, at, is_left));
    click(&screen, left);
    screen.key("j");
    sitting.found(2);
    screen.key("c");
    click(&screen, left);
    click(&screen, right);
    screen.key("c");
    kept_when(folder, "a distance", |found| list(found, "distances").len() == 1);
    screen.key("ctrl+F8");
    let (finding, found) = sitting.found(3);
    assert_same(&finding["ends"], &found["distances"][0]);
    sitting.mark_candidate();
    sitting.mark_missed();
    sitting.correct();
    sitting.note("flat, just behind a fold");
    sitting.undo_and_delete();

    screen.key("ctrl+F7");
    let is_table = |i: &RgbImage| {
        let panel = image::imageops::crop_imm(i, 900, 80, 380, 250).to_image();
        share(&panel, |p| p[0] > 150) > 0.02
    };
    screen.shot_when("the quality of the segments", is_table);
    sitting.shot("quality");
    screen.key("ctrl+F7");
    let is_whole = |f: &Value| f["view"].is_object() && f["along_mm"].is_f64();
    kept_when(folder, "all", |found| list(found, "findings").iter().all(is_whole));
    let reported = report(&screen, &shots);
    sitting.until_still("the report");
    sitting.shot("report");
    sitting.quit(window);

    let (path, closed) = kept(folder).unwrap();
    assert_eq!(ids(&closed), ["1", "2", "3", "4", "5"]);
    for of in ["findings", "answers", "distances"] {
        assert_same(&reported[of], &closed[of]);
    }
    for found in [&reported, &closed] {
        let seconds: f64 = list(found, "quality").iter().filter_map(|q| q["seconds"].as_f64()).sum();
        assert!(seconds > 1.0, "{found:#}");
    }

    // The next time, all of it is there, and stored on.
    let window = open(&screen, folder, scan, false);
    // A click on the wall pauses the flight, unless it was left paused.
    click(&screen, WALL);
    screen.key("ctrl+F6");
    sitting.until_still("the findings");
    sitting.shot("reopened");
    screen.key("j");
    sitting.found(6);
    screen.key("ctrl+z");
    let (_, again) = sitting.found(5);
    for of in ["findings", "answers", "distances"] {
        assert_same(&again[of], &closed[of]);
    }
    quit(&screen, window);
    assert_eq!(kept(folder).unwrap().0, path);
}

#[test]
#[ignore = "slow: two sittings in a window on a DICOM study"]
fn a_sitting_on_a_dicom_study() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_phantom(folder, "scan.nii.gz");
    let scan = io::load(&folder.join("scan.nii.gz"), &LoadOptions::default(), &Progress::new()).unwrap().volume;
    write_scan(&scan, [false, false], "HFS", &folder.join("study"));
    fs::remove_file(folder.join("scan.nii.gz")).unwrap();
    sit("study", folder, "study");
}

#[test]
#[ignore = "slow: two sittings in a window on a real scan"]
fn a_sitting_on_a_real_scan() {
    let Some(scan) = data("ctc_prone.nii.gz") else { return };
    let folder = tempfile::tempdir().unwrap();
    sit("ct", folder.path(), fs::canonicalize(scan).unwrap().to_str().unwrap());
}
