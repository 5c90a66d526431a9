//! The assistant of a window, in flights through phantoms.

use std::thread;
use std::time::Duration;

use super::*;
use crate::app::{FlightRequest, ImageSettings, OpenOptions, Scan, Scene};
use crate::host::window::contract::WindowView;
use crate::host::window::controller::FlightController;
use crate::host::window::controller::tests::{cockpit_of, perform, trace, wish};
use crate::host::window::document::Document;
use crate::host::window::intent::{Intent, SliceInput};
use crate::host::window::session::ScanFiles;
use crate::phantom::PhantomSettings;
use crate::polyps::answers::Answered;
use crate::progress::Progress;
use crate::render::Settings;
use crate::shared::shared;

/// A flight through a phantom that has shown its first picture.
fn flown(fluid: bool) -> FlightController {
    let (_, volume) = shared(&PhantomSettings { fluid, ..PhantomSettings::embedded(1) });
    let mut scan = Scan::of(volume, &OpenOptions::default()).unwrap();
    let settings = Settings { adaptive: false, ..Settings::default() };
    let image = ImageSettings { width: 96, height: 72, settings, ..ImageSettings::default() };
    let scene = Scene { picture: true, operator: true, image, ..Scene::guided_by("tentacles") };
    let mut c = cockpit_of(scan.flight(scene, &FlightRequest::default()).unwrap(), 0.0, Vec::new());
    trace(&mut c, Instant::now());
    c
}

fn until(c: &mut FlightController, wanted: impl Fn(&Assistant) -> bool) {
    let begun = Instant::now();
    while !c.assistant().is_some_and(&wanted) {
        assert!(begun.elapsed() < Duration::from_secs(120));
        c.advance(Instant::now()).unwrap();
        thread::sleep(Duration::from_millis(2));
    }
}

#[test]
#[ignore = "slow: candidates of a phantom"]
fn candidates_are_found_visited_and_answered_and_answers_survive() {
    let dir = tempfile::tempdir().unwrap();
    let (files, now) = (ScanFiles::below(dir.path(), "a.json"), Instant::now());
    let file = files.findings.clone().unwrap();
    let mut c = flown(true);
    c.set_document(Document::open(&files).0);
    c.advance(now).unwrap();
    assert!(c.assistant().is_none() && !file.exists(), "nobody has asked");
    perform(&mut c, "candidate-next", now);
    assert!(c.hud(now).message.is_some_and(|m| m.contains("K looks for polyps")));
    wish(&mut c, Intent::Search, now);
    assert!(c.next().is_some_and(|t| t <= now + LOOKS));
    until(&mut c, |a| a.found().is_some());
    let took = c.assistant().unwrap().took().unwrap();
    let found = Arc::clone(c.assistant().unwrap().found().unwrap());
    assert!(took.candidates == found.list.len() && took.seconds > 0.0 && took.bytes > 0);
    assert!(found.list.len() > 1);
    for n in [0, 1] {
        perform(&mut c, "candidate-next", now);
        let place = found.list[n].candidate.position;
        assert_eq!((c.assistant().unwrap().reading().current(), c.slices().cursor()), (Some(n), Some(place)));
        // The camera looks there from where it may be.
        let pose = c.flight().pose();
        let to = place - pose.position;
        assert!(to.length() < 60.0 && to.normalize().dot(pose.attitude.forward) > 0.8, "{n}: {to}");
        assert!(c.flight().setup().lumen.segment_at(pose.position).is_some());
    }
    c.advance(Instant::now() + Duration::from_millis(50)).unwrap();
    assert_eq!(c.hud(now).state, "paused");
    // An answer goes on to the next candidate without one.
    let current = |c: &FlightController| c.assistant().unwrap().reading().current();
    perform(&mut c, "candidate-unsure", now);
    let told = c.hud(now).message.unwrap();
    assert!(told.starts_with("candidate 2: unsure (") && told.contains("; now candidate "), "{told}");
    assert_ne!(current(&c), Some(1));
    wish(&mut c, Intent::Select(0), now);
    perform(&mut c, "candidate-yes", now);
    assert!(found.list.len() > 2 && current(&c) == Some(2));
    wish(&mut c, Intent::Select(0), now);
    perform(&mut c, "candidate-no", now);
    wish(&mut c, Intent::Note(0, "a fold".to_owned()), now);
    // Distances and answers are undone by one key, the last change first, and what was undone is shown.
    perform(&mut c, "undo", now);
    perform(&mut c, "undo", now);
    let told = c.hud(now).message.unwrap();
    assert!(told.starts_with("candidate 1 of ") && told.contains(": undone; yes"), "{told}");
    assert_eq!((current(&c), c.slices().cursor()), (Some(0), Some(found.list[0].candidate.position)));
    let kept = Answers::read(&file).unwrap();
    let said: Vec<_> = kept.answers.iter().map(|a| (a.rank, a.answer, a.note.as_str())).collect();
    assert_eq!(said, [(1, Some(Answer::Yes), ""), (2, Some(Answer::Unsure), "")]);
    // The last answer of all ends it.
    for _ in 2..found.list.len() {
        wish(&mut c, Intent::Step(true), now);
        while c.assistant().unwrap().reading().said(current(&c).unwrap()).unwrap().answer.is_some() {
            wish(&mut c, Intent::Step(true), now);
        }
        perform(&mut c, "candidate-no", now);
    }
    let (told, all) = (c.hud(now).message.unwrap(), found.list.len());
    assert!(told.ends_with(&format!("all {all} candidates are answered")), "{told}");
    for _ in 2..all {
        perform(&mut c, "undo", now);
    }
    assert_eq!(c.assistant().unwrap().reading().answered(), 2);
    // Another window of the same scan has them.
    let mut c = flown(true);
    c.set_document(Document::open(&files).0);
    wish(&mut c, Intent::Search, now);
    until(&mut c, |a| a.found().is_some());
    assert_eq!(c.assistant().unwrap().reading().answered(), 2);
}

#[test]
fn a_candidate_is_told_where_the_file_has_it_and_the_list_may_follow_the_colon() {
    let now = Instant::now();
    let mut c = flown(true);
    let progress = Progress::new();
    let lumen = Arc::clone(&c.flight().setup().lumen);
    let along = lumen.along(c.flight().setup().volume.voxels(), &progress).unwrap();
    wish(&mut c, Intent::Search, now);
    until(&mut c, |a| a.found().is_some());
    let found = Arc::clone(c.assistant().unwrap().found().unwrap());
    for entry in &found.list {
        // The file has the measure along the scan as it was opened.
        let (told, in_file) = (entry.along.unwrap(), along.of(entry.candidate.position).unwrap());
        assert_eq!((told.mm, told.text()), (in_file.mm, in_file.text()));
    }
    wish(&mut c, Intent::Show(Showing { order: Order::Along, least_mm: 5, hides_answered: false }), now);
    let mut way = Vec::new();
    for _ in 0..c.assistant().unwrap().reading().shown().len() {
        perform(&mut c, "candidate-next", now);
        way.push(c.assistant().unwrap().reading().current().unwrap());
    }
    assert_eq!(way, c.assistant().unwrap().reading().shown());
    let mm = |n: &usize| found.list[*n].along.unwrap().mm;
    assert!(
        way.is_sorted_by_key(mm)
            && way.iter().all(|&n| found.list[n].candidate.lesion.as_ref().unwrap().diameter_mm > 4.9)
    );
}

#[test]
fn a_click_measures_a_lesion_or_tells_why_not() {
    let now = Instant::now();
    let mut c = flown(false);
    wish(&mut c, Intent::Search, now);
    until(&mut c, |a| a.found().is_some());
    perform(&mut c, "measure", now);
    perform(&mut c, "measure-lesion", now);
    assert!(!c.measures().is_on(), "a click measures one or the other");
    let place = c.assistant().unwrap().found().unwrap().list[0].candidate.position;
    c.slice(SliceInput::Click(place), now);
    let a = c.assistant().unwrap();
    let Some(Ok(m)) = a.measured() else { panic!("a lesion") };
    assert!(m.lesion.position.distance(place) < 6.0 && c.has_marks());
    assert!(c.slices().cursor().unwrap().distance(place) < 10.0);
    c.slice(SliceInput::Click(place + DVec3::splat(500.0)), now);
    let measured = c.assistant().unwrap().measured().cloned();
    let Some(Err(why)) = measured else { panic!("nothing there") };
    assert!(!why.contains('\n') && c.hud(now).message == Some(why));
    perform(&mut c, "measure", now);
    assert!(!c.assistant().unwrap().is_measuring && c.measures().is_on());
}

#[test]
fn a_search_is_cancelled_and_begun_again_and_answers_wait_for_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("answers.json");
    let now = Instant::now();
    let mut c = flown(false);
    wish(&mut c, Intent::Search, now);
    until(&mut c, |a| a.task.is_working());
    wish(&mut c, Intent::CancelSearch, now);
    let failed = |a: &Assistant| matches!(a.state(), State::Failed(why) if why.contains("cancelled"));
    assert!(c.assistant().is_some_and(failed) && c.assistant().unwrap().next().is_none());
    // What a damaged file lacks is told in one line, once there is a list.
    std::fs::write(&path, "{").unwrap();
    c.load_answers(&path, now);
    wish(&mut c, Intent::Search, now);
    until(&mut c, |a| a.found().is_some());
    let told = c.assistant().unwrap().told().to_owned();
    assert!(told.contains("answers.json") && !told.contains('\n'), "{told}");
    let position = c.assistant().unwrap().found().unwrap().list[1].candidate.position + DVec3::splat(0.3);
    let one = Answered { rank: 9, position, answer: Some(Answer::Yes), note: String::new() };
    Answers { scan: String::new(), answers: vec![one] }.write(&path).unwrap();
    c.load_answers(&path, now);
    assert_eq!(c.assistant().unwrap().told(), "1 of 1 answers belong to candidates of this list");
    assert_eq!(c.assistant().unwrap().reading().said(1).unwrap().answer, Some(Answer::Yes));
}
