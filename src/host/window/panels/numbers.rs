//! Tests that the lists of a window, its place and the files of the program tell one place along the colon.

use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use glam::DVec3;

use super::missed;
use crate::app::found::Found;
use crate::app::study::Study;
use crate::app::{FlightRequest, ImageSettings, OpenOptions, Scan, Scene, Timings, colon};
use crate::coverage::LiveCoverage;
use crate::fields::{Along, AlongColon, lumen};
use crate::host::window::contract::WindowView;
use crate::host::window::controller::FlightController;
use crate::host::window::controller::tests::{cockpit_of, perform, trace, wish};
use crate::host::window::intent::Intent;
use crate::phantom::PhantomSettings;
use crate::polyps::detectors;
use crate::progress::Progress;
use crate::render::Settings;
use crate::shared::shared;
use crate::space::TransferFunction;
use crate::volume::Volume;

/// Longest wait for the background.
const WAIT: Duration = Duration::from_secs(240);
/// A patch is looked up this far from the wall, mm.
const INTO_GAS_MM: f64 = 2.0;

/// The embedded phantom, and the measure along it.
fn scanned(fluid: bool, collapsed: bool) -> (Volume, Arc<Along>) {
    measured(shared(&PhantomSettings { fluid, collapsed, ..PhantomSettings::embedded(1) }).1)
}

/// A scan, and the measure along it as it is in its file.
fn measured(scan: Volume) -> (Volume, Arc<Along>) {
    let mut opened = Scan::of(scan.clone(), &OpenOptions::default()).unwrap();
    let lumen = opened.lumen().unwrap();
    let along = lumen.along(opened.volume().voxels(), &Progress::new()).unwrap();
    (scan, along)
}

/// A window on that scan, at a share of its flight.
fn window(scan: Volume, guide: &'static str, share: f64) -> FlightController {
    let mut scan = Scan::of(scan, &OpenOptions::default()).unwrap();
    let settings = Settings { adaptive: false, ..Settings::default() };
    let image = ImageSettings { width: 96, height: 72, settings, ..ImageSettings::default() };
    let scene = Scene { picture: true, operator: true, image, ..Scene::guided_by(guide) };
    let mut flight = scan.flight(scene, &FlightRequest::default()).unwrap();
    while flight.survey().progress().0 < share {
        flight.step().unwrap();
    }
    let mut c = cockpit_of(flight, 0.0, Vec::new());
    trace(&mut c, Instant::now());
    c
}

/// Lets time go by until something is so.
#[track_caller]
fn until(c: &mut FlightController, now: &mut Instant, wanted: impl Fn(&FlightController) -> bool) {
    let begun = Instant::now();
    while !wanted(c) {
        assert!(begun.elapsed() < WAIT, "{:?}", c.hud(*now).message);
        *now += Duration::from_millis(25);
        c.advance(*now).unwrap();
        sleep(Duration::from_millis(2));
    }
}

/// Asserts that the status line tells the camera's place as the file's measure does.
#[track_caller]
fn assert_bar(c: &mut FlightController, now: &mut Instant, along: &Along) {
    *now += Duration::from_secs(1);
    c.advance(*now).unwrap();
    while c.hud(*now).place.contains(" of about ") {
        *now += Duration::from_secs(1);
        sleep(Duration::from_millis(2));
    }
    let camera = along.of(c.flight().pose().position).unwrap();
    let length = (along.length_mm() / 10.0).round() * 10.0;
    assert_eq!(told_place(&c.hud(*now).place), told_place(&format!("{} of {length} mm", told_mm(&camera))));
}

/// The place of the status line, without what follows it.
fn told_place(place: &str) -> String {
    place.replace(", a guess", "").split(';').next().unwrap_or_default().to_owned()
}

/// "descending, 840", of "descending, about 840 mm".
fn told_mm(place: &AlongColon) -> String {
    place.text().replace("about ", "").trim_end_matches(" mm").to_owned()
}

/// The list of candidates that `colvis candidates` writes of a scan.
fn listed(mut scan: Volume) -> Vec<serde_json::Value> {
    let (progress, timings) = (Progress::new(), &mut Timings::default());
    let find = |volume: &Volume| lumen::find(volume, &progress);
    let (found, known) = (Arc::new(find(&scan).unwrap()), Found::default());
    let without_tag = colon::without_tag(&mut scan, (found, &known), true, find, |_| {}, timings, &progress);
    let iso = TransferFunction::default().iso();
    let study = Study::new(scan, without_tag.unwrap().0, iso, colon::WALL_MM, timings, &progress).unwrap();
    let entries = study.entries(&study.find(&detectors::BUILT_IN[0], &progress).unwrap(), None);
    entries.iter().map(|e| serde_json::to_value(e).unwrap()).collect()
}

/// Every candidate that a window lists has the place, the segment and the part that `colvis candidates` writes of it, and the camera
/// that went to it is told by the same measure. `guide` may take the tag out of the scan.
fn candidates_agree(guide: &'static str, fluid: bool, collapsed: bool) {
    let (scan, along) = scanned(fluid, collapsed);
    let in_file = listed(scan.clone());
    let (mut c, mut now) = (window(scan, guide, 0.0), Instant::now());
    wish(&mut c, Intent::Search, now);
    until(&mut c, &mut now, |c| c.assistant().unwrap().found().is_some());
    let found = Arc::clone(c.assistant().unwrap().found().unwrap());
    assert!(found.list.len() > 2 && found.list.len() <= in_file.len(), "{}", found.list.len());
    for (n, (entry, written)) in found.list.iter().zip(&in_file).enumerate() {
        let position: DVec3 = serde_json::from_value(written["position"].clone()).unwrap();
        let told = entry.along.unwrap();
        // The command looks at the part of the scan around the colon: single-precision places differ in their last digits.
        assert!(entry.candidate.position.distance(position) < 1e-3, "{n}: {} {position}", entry.candidate.position);
        assert!((told.mm - written["along_mm"].as_f64().unwrap()).abs() < 1e-6, "{n}: {told:?} {written}");
        assert_eq!(written["segment"].as_u64(), Some(told.segment as u64), "{n}: {told:?}");
        assert_eq!(written["part"].as_str(), told.part, "{n}");
        assert_eq!(along.of(position).map(|a| a.text()), Some(told.text()), "{n}");
        if n < 3 {
            perform(&mut c, "candidate-next", now);
            assert_bar(&mut c, &mut now, &along);
        }
    }
}

#[test]
#[ignore = "slow: candidates of a phantom"]
fn candidates_have_the_places_of_their_file() {
    candidates_agree("tentacles", false, false);
}

#[test]
#[ignore = "slow: candidates of a tagged phantom"]
fn candidates_under_tag_have_the_places_of_their_file() {
    candidates_agree("tentacles", true, false);
    // The scan that is flown has its cleansed.
    candidates_agree("path", true, false);
}

#[test]
#[ignore = "slow: candidates of a collapsed phantom"]
fn candidates_in_several_segments_have_the_places_of_their_file() {
    candidates_agree("tentacles", true, true);
}

/// The measure is known some time after the flight has begun, the later the larger the scan.
#[test]
#[ignore = "slow: flights through a phantom"]
fn what_was_flown_before_the_measure_was_known_is_read() {
    let (scan, along) = scanned(true, false);
    let (mut c, mut now) = (window(scan, "path", 0.0), Instant::now());
    let begin = along.of(c.flight().pose().position).unwrap();
    while c.flight().survey().progress().0 < 0.5 {
        c.flight_mut().step().unwrap();
    }
    assert_bar(&mut c, &mut now, &along);
    let bar = c.hud(now).bar;
    let from = (begin.mm / along.length_mm() * 1000.0).round() as u32;
    assert!(bar.read.len() == 1 && bar.read[0][0].abs_diff(from) < 12, "{bar:?}, {from}");
    assert!(bar.read[0][1].abs_diff(bar.camera) < 3, "{bar:?}");
}

#[test]
#[ignore = "slow: flights through three phantoms"]
fn missed_patches_have_the_places_of_the_measure_along_the_scan() {
    for (fluid, collapsed) in [(false, false), (true, false), (true, true)] {
        let (scan, along) = scanned(fluid, collapsed);
        let (mut c, mut now) = (window(scan, "path", 0.6), Instant::now());
        c.show_seen(true, now);
        until(&mut c, &mut now, |c| c.seen().list().is_some());
        let list = c.seen().list().unwrap().to_vec();
        assert!(!list.is_empty());
        let coverage = c.flight().camera::<LiveCoverage>().unwrap();
        for (n, patch) in list.iter().enumerate() {
            let wall = coverage.wall();
            let far = |t: &u32| wall.centroid(*t as usize).distance_squared(patch.position);
            let middle = patch.triangles.iter().copied().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap();
            let place = along.of(patch.position + wall.normal(middle as usize) * INTO_GAS_MM).unwrap();
            let told = missed::place(patch);
            assert_eq!(told.trim_end_matches(", too narrow to look at"), place.text(), "{n}");
            let (mm, part) = (patch.along.unwrap().mm, patch.along.unwrap().part);
            assert!((mm - place.mm).abs() < 1e-6 && part == place.part, "{n}: {mm} {place:?}");
        }
        for (n, _) in list.iter().enumerate().filter(|(_, m)| m.look_from.is_some()).take(3) {
            c.visit_missed(n, now);
            assert_bar(&mut c, &mut now, &along);
        }
    }
}
