//! Findings in the real window: marked, measured and undone, in their file at once, and never lost.

use std::collections::BTreeMap;
use std::path::PathBuf;

use colvis::volume::io::LoadOptions;
use serde_json::Value;

use super::*;

/// A screen on which the wall beside the camera is some pixels away in each slice.
const LARGE: (u32, u32) = (1280, 800);

/// Writes a phantom that has everything that a reader meets.
pub(crate) fn write_phantom(folder: &Path, name: &str) {
    let made = colvis()
        .args(["phantom", "--out", name, "--size", "small", "--with", "folds,polyps,fluid,noise", "--seed", "1"])
        .current_dir(folder)
        .status();
    assert!(made.unwrap().success());
}

pub(crate) fn screen() -> Option<Screen> {
    Screen::open_with(&format!("{}x{}x24", LARGE.0, LARGE.1), &[], &[])
}

/// Opens a scan in the layout for reading and pauses its flight if that is asked for.
pub(crate) fn open(screen: &Screen, folder: &Path, scan: &str, pauses: bool) -> Running {
    let size = format!("{}x{}", LARGE.0, LARGE.1);
    let args = ["fly", scan, "--size", &size, "--log", "f.jsonl", "--layout", "flight"];
    let window = screen.open_window(folder, &args, flies);
    screen.key("F3");
    screen.shot_when("slices", |i| camera(i).is_some());
    if pauses {
        screen.key("space");
        let mut before = None;
        screen.shot_when("a still image", |now| before.replace(now.clone()).is_some_and(|b| b == *now));
    }
    window
}

/// Returns the place of the camera in the axial slice, at the upper right of the layout, pixels.
pub(crate) fn camera(image: &RgbImage) -> Option<(u32, u32)> {
    // The upper bound of the slice's rows is that of its scale bar and letters.
    let places = (60..400).flat_map(|y| (720..LARGE.0).map(move |x| (x, y)));
    let blue: Vec<_> = places.filter(|&(x, y)| image.get_pixel(x, y).0 == [96, 190, 255]).collect();
    // Its dot is wider than its arrow, wherever that points.
    let around = |&(x, y): &(u32, u32)| blue.iter().filter(|(a, b)| a.abs_diff(x) < 4 && b.abs_diff(y) < 4).count();
    blue.iter().copied().max_by_key(around)
}

/// Returns the place of the wall beside the camera in the axial slice, at its left or right, pixels.
pub(crate) fn wall(image: &RgbImage, at: (u32, u32), is_left: bool) -> (u32, u32) {
    let column = |n: u32| if is_left { at.0 - n } else { at.0 + n };
    // Below the crosshair, past the dot.
    let row = at.1 + 4;
    let is_tissue = |p: [u8; 3]| p[0] == p[1] && p[1] == p[2] && p[0] > 70;
    let n = (8..200).find(|n| (0..3).all(|more| is_tissue(image.get_pixel(column(n + more), row).0)));
    let n = n.unwrap_or_else(|| panic!("no wall beside the camera: {}", keep("window wall", image).display()));
    (column(n), row)
}

pub(crate) fn click(screen: &Screen, at: (u32, u32)) {
    screen.tool("xdotool", &["mousemove", &at.0.to_string(), &at.1.to_string(), "sleep", "0.1", "click", "1"]);
    // Two clicks soon after each other would be a double click.
    std::thread::sleep(Duration::from_millis(700));
}

fn kept_in(folder: &Path) -> PathBuf {
    folder.join("state/colvis/findings")
}

fn names(folder: &Path) -> Vec<String> {
    let list = fs::read_dir(kept_in(folder)).into_iter().flatten();
    let mut names: Vec<String> = list.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn is_temporary(name: &str) -> bool {
    name.starts_with(".colvis-")
}

/// Returns the one file of findings, and what it holds; `None` if there is none yet.
pub(crate) fn kept(folder: &Path) -> Option<(PathBuf, Value)> {
    let names: Vec<String> = names(folder).into_iter().filter(|n| !is_temporary(n)).collect();
    assert!(names.len() < 2, "{names:?}");
    let path = kept_in(folder).join(names.first()?);
    let found: Value = serde_json::from_slice(&fs::read(&path).unwrap()).expect("valid JSON");
    assert_eq!(found["version"], 1);
    Some((path, found))
}

/// Waits until the file holds what is `wanted`.
pub(crate) fn kept_when(folder: &Path, what: &str, wanted: impl Fn(&Value) -> bool) -> (PathBuf, Value) {
    let begun = Instant::now();
    loop {
        let kept = kept(folder);
        if let Some(kept) = kept.clone().filter(|(_, found)| wanted(found)) {
            return kept;
        }
        assert!(begun.elapsed() < PATIENCE / 3, "the file never holds {what}: {kept:#?}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

pub(crate) fn list<'a>(found: &'a Value, of: &str) -> &'a [Value] {
    found[of].as_array().map_or(&[], Vec::as_slice)
}

pub(crate) fn ids(found: &Value) -> Vec<&str> {
    list(found, "findings").iter().map(|f| f["id"].as_str().unwrap()).collect()
}

pub(crate) fn vector(value: &Value) -> DVec3 {
    serde_json::from_value(value.clone()).unwrap()
}

/// True if a window has said nothing but that it has cleansed the scan, or that a finding of a report is no lesion: no warning, and not
/// that findings are not kept.
fn is_content(err: &str) -> bool {
    err.lines().all(|line| {
        line.starts_with("note: removed ") && line.contains("of tagged fluid") || line.contains(" has no measures: ")
    })
}

/// Writes the report, and returns its findings once it is there.
pub(crate) fn report(screen: &Screen, shots: &Path) -> Value {
    screen.key("ctrl+x");
    let begun = Instant::now();
    loop {
        let folders = fs::read_dir(shots).into_iter().flatten().map(|e| e.unwrap().path());
        let mut reports = folders.filter(|p| p.join("report.html").exists());
        if let Some(report) = reports.next() {
            let page = fs::read_to_string(report.join("report.html")).unwrap();
            assert!(page.trim_end().ends_with("</html>"));
            return serde_json::from_slice(&fs::read(report.join("findings.json")).unwrap()).unwrap();
        }
        assert!(begun.elapsed() < PATIENCE, "there is no report in {}", shots.display());
        std::thread::sleep(Duration::from_millis(100));
    }
}

pub(crate) fn quit(screen: &Screen, mut window: Running) {
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success() && is_content(&err), "{status}: {err}");
    gone(screen);
}

/// Waits until the server shows no window: the next one would not get the keyboard.
fn gone(screen: &Screen) {
    screen.shot_when("an empty screen", |i| share(i, |p| p != [0; 3]) < 0.001);
}

#[test]
#[ignore = "slow: a sitting in a window, and another one"]
fn findings_are_in_the_scans_file_whatever_form_the_scan_comes_in() {
    let Some(screen) = screen() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_phantom(folder, "scan.nii.gz");
    let shots = folder.join("shots");
    fs::create_dir_all(folder.join("config/colvis")).unwrap();
    let settings = format!("version = 1\nscreenshots = {:?}\n", shots.to_str().unwrap());
    fs::write(folder.join("config/colvis/settings.toml"), settings).unwrap();
    let window = open(&screen, folder, "scan.nii.gz", true);
    assert!(kept(folder).is_none());

    // Ahead, then at the wall at the left and the right of the camera.
    screen.key("j");
    kept_when(folder, "what is ahead", |found| ids(found) == ["1"]);
    let shot = screen.shot();
    let at = camera(&shot).unwrap();
    let [left, right] = [true, false].map(|is_left| wall(&shot, at, is_left));
    for (n, place) in [(2, left), (3, right)] {
        click(&screen, place);
        screen.key("j");
        kept_when(folder, "what was clicked", |found| list(found, "findings").len() == n);
    }
    // The last one is undone, and made again.
    screen.key("ctrl+z");
    kept_when(folder, "what is left", |found| ids(found) == ["1", "2"]);
    screen.key("j");
    kept_when(folder, "what is marked again", |found| ids(found) == ["1", "2", "3"]);

    // A distance across the lumen, which is undone and measured again, and a place in tissue.
    for is_undone in [true, false] {
        screen.key("c");
        click(&screen, left);
        click(&screen, right);
        screen.key("c");
        kept_when(folder, "a distance", |found| list(found, "distances").len() == 1);
        if is_undone {
            screen.key("ctrl+z");
            kept_when(folder, "no distance", |found| list(found, "distances").is_empty());
        }
    }
    click(&screen, (left.0 - 30, left.1));
    screen.key("ctrl+p");
    // All that the program adds, too.
    let is_whole = |f: &Value| f["view"].is_object() && f["along_mm"].is_f64();
    let (path, found) = kept_when(folder, "all", |found| {
        list(found, "outside").len() == 1 && list(found, "findings").iter().all(is_whole)
    });
    let reported = report(&screen, &shots);
    assert_eq!((ids(&reported), list(&reported, "outside").len()), (vec!["1", "2", "3"], 1));
    assert!(list(&reported, "quality").iter().any(|q| q["seconds"].as_f64().unwrap() > 0.0), "{reported}");
    quit(&screen, window);
    assert_eq!(kept(folder).unwrap().1["findings"], found["findings"]);
    let name = path.file_name().unwrap().to_str().unwrap();
    assert_eq!(found["scan"], format!("sha256:{}", name.strip_suffix(".json").unwrap()));

    // They are where they were made. The patient's left is at the right of an axial slice, and the first coordinate.
    let lines = log(folder, "f.jsonl");
    let last = lines.last().unwrap();
    let (camera, forward) = (place(last), DVec3::from_array(last.forward));
    let places: Vec<DVec3> = list(&found, "findings").iter().map(|f| vector(&f["place"])).collect();
    let ahead = (places[0] - camera).normalize();
    assert!(ahead.dot(forward) > 0.999, "{ahead} {forward}");
    let ends: Vec<DVec3> = found["distances"][0].as_array().unwrap().iter().map(vector).collect();
    let outside = vector(&found["outside"][0]["place"]);
    assert!(ends[0].x < camera.x && camera.x < ends[1].x && outside.x < ends[0].x, "{camera}: {ends:?} {outside}");
    for at in ends.iter().chain([&outside]) {
        // A pixel is half a millimetre.
        assert!((at.y - camera.y).abs() < 4.0 && (at.z - camera.z).abs() < 1.0, "{camera}: {at}");
    }
    assert!(places[1].distance(ends[0]) < 3.0 && places[2].distance(ends[1]) < 3.0, "{places:?} {ends:?}");

    // The same scan in another folder, under another name, in another format.
    fs::create_dir(folder.join("other")).unwrap();
    let progress = Progress::new();
    let volume = io::load(&folder.join("scan.nii.gz"), &LoadOptions::default(), &progress).unwrap().volume;
    io::save(&folder.join("other/copy.mha"), &volume, &progress).unwrap();
    fs::remove_file(folder.join("scan.nii.gz")).unwrap();
    let window = open(&screen, folder, "other/copy.mha", false);
    screen.key("j");
    let (again, more) =
        kept_when(folder, "one more", |found| list(found, "findings").len() == 4 && is_whole(&found["findings"][3]));
    quit(&screen, window);
    assert_eq!((again, &more["scan"]), (path, &found["scan"]));
    assert_eq!(ids(&more), ["1", "2", "3", "4"]);
    for of in ["outside", "distances"] {
        assert_same(&more[of], &found[of]);
    }
    for (a, b) in list(&more, "findings").iter().zip(list(&found, "findings")) {
        assert_same(a, b);
    }
    assert!(names(folder).iter().all(|n| !is_temporary(n)), "{:?}", names(folder));
}

/// Asserts that two values are the same. A number keeps its digits but the last, and a place those of a header.
pub(crate) fn assert_same(a: &Value, b: &Value) {
    match (a, b) {
        (Value::Number(x), Value::Number(y)) => {
            assert!((x.as_f64().unwrap() - y.as_f64().unwrap()).abs() < 1e-3, "{x} {y}");
        }
        (Value::Array(x), Value::Array(y)) => {
            assert_eq!(x.len(), y.len(), "{a} {b}");
            x.iter().zip(y).for_each(|(x, y)| assert_same(x, y));
        }
        (Value::Object(x), Value::Object(y)) => {
            assert!(x.keys().eq(y.keys()), "{a} {b}");
            x.values().zip(y.values()).for_each(|(x, y)| assert_same(x, y));
        }
        _ => assert_eq!(a, b),
    }
}

/// Returns numbers from 0 to 1 that are drawn with a seed.
fn drawn(mut seed: u64) -> impl FnMut() -> f64 {
    move || {
        // Knuth, The Art of Computer Programming, volume 2, 3.3.4: the multiplier and increment of MMIX.
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Makes the file so long that a program is often killed while it is written.
fn lengthen(folder: &Path) {
    let (path, mut found) = kept(folder).unwrap();
    let findings = found["findings"].as_array_mut().unwrap();
    let first = findings[0].clone();
    findings.extend((101..400).map(|n| {
        let mut finding = first.clone();
        finding["id"] = n.to_string().into();
        finding["note"] = "n".repeat(15_000).into();
        finding
    }));
    fs::write(path, serde_json::to_vec_pretty(&found).unwrap()).unwrap();
}

/// Looks a little to the side and marks what is ahead then: a place that has a finding gets no second one.
fn mark_elsewhere(screen: &Screen) {
    screen.tool("xdotool", &["keydown", "Left", "sleep", "0.1", "keyup", "Left", "sleep", "0.1", "key", "j"]);
}

#[test]
#[ignore = "slow: twenty windows that are killed"]
fn a_window_that_is_killed_loses_no_finding_and_the_next_one_stores_on() {
    let Some(screen) = screen() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_phantom(folder, "scan.nii.gz");
    let window = open(&screen, folder, "scan.nii.gz", false);
    screen.key("j");
    kept_when(folder, "a finding", |found| {
        ids(found) == ["1"] && found["findings"][0]["view"].is_object() && found["findings"][0]["along_mm"].is_f64()
    });
    quit(&screen, window);
    lengthen(folder);

    let mut random = drawn(7);
    let (mut left, mut made) = (Vec::new(), 0);
    for kill in 0..20 {
        let count = |found: &Value| list(found, "findings").len();
        let held = count(&kept(folder).unwrap().1);
        let mut window = open(&screen, folder, "scan.nii.gz", false);
        // It reads the file and stores on; what a killed one has left is gone then.
        mark_elsewhere(&screen);
        kept_when(folder, "one more", |found| count(found) > held);
        let there = names(folder);
        assert!(left.iter().all(|name| !there.contains(name)), "{kill}: {left:?} of {there:?}");
        for _ in 0..(3.0 * random()) as usize {
            mark_elsewhere(&screen);
        }
        // What is in the file now must never be lost.
        let (path, before) = kept(folder).unwrap();
        mark_elsewhere(&screen);
        std::thread::sleep(Duration::from_secs_f64(0.6 * random()));
        window.0.kill().unwrap();
        window.wait();
        let (again, after) = kept(folder).unwrap();
        assert_eq!(path, again);
        let by_id: BTreeMap<&str, &Value> = ids(&after).into_iter().zip(list(&after, "findings")).collect();
        assert_eq!(by_id.len(), count(&after), "{kill}: an id is there twice");
        for finding in list(&before, "findings") {
            let id = finding["id"].as_str().unwrap();
            let same = by_id.get(id).unwrap_or_else(|| panic!("{kill}: finding {id} is lost"));
            assert_eq!((&same["place"], &same["note"]), (&finding["place"], &finding["note"]), "{kill}: {id}");
        }
        let (_, err) = window.output();
        assert!(is_content(&err), "{kill}: {err}");
        left = names(folder).into_iter().filter(|n| is_temporary(n)).collect();
        made += usize::from(!left.is_empty());
        gone(&screen);
    }
    println!("{made} of 20 were killed while they wrote");
    let window = open(&screen, folder, "scan.nii.gz", false);
    let held = list(&kept(folder).unwrap().1, "findings").len();
    mark_elsewhere(&screen);
    kept_when(folder, "one more", |found| list(found, "findings").len() > held);
    quit(&screen, window);
    assert!(names(folder).iter().all(|n| !is_temporary(n)), "{:?}", names(folder));
}
