use std::thread;
use std::time::Duration;

use super::*;
use crate::app::findings::Findings;
use crate::app::{FlightRequest, ImageSettings, OpenOptions, Scan, Scene};
use crate::components::slices::{Orientation, SliceView};
use crate::host::window::assistant::Said;
use crate::host::window::contract::WindowView;
use crate::host::window::controller::FlightController;
use crate::host::window::controller::tests::{cockpit_of, perform, trace, wish};
use crate::host::window::document::Document;
use crate::host::window::findings;
use crate::host::window::intent::{Intent, SliceInput};
use crate::host::window::session::ScanFiles;
use crate::math::hash;
use crate::phantom::PhantomSettings;
use crate::polyps::answers::Answer;
use crate::render::{ImageSize, Settings};
use crate::shared::shared;

/// A scan with other gas beside the colon, which is collapsed in places.
fn scan() -> Scan {
    let (_, volume) = shared(&PhantomSettings {
        ileum: true,
        stomach: true,
        lungs: true,
        collapsed: true,
        noise: true,
        ..PhantomSettings::embedded(1)
    });
    Scan::of(volume, &OpenOptions::default()).unwrap()
}

fn flown(scan: &mut Scan) -> FlightController {
    let settings = Settings { adaptive: false, ..Settings::default() };
    let image = ImageSettings { width: 32, height: 24, settings, ..ImageSettings::default() };
    let scene = Scene { picture: true, image, operator: true, ..Scene::guided_by("manual") };
    cockpit_of(scan.flight(scene, &FlightRequest::default()).unwrap(), 0.0, Vec::new())
}

/// Returns the kinds that are stored.
fn kept(files: &ScanFiles) -> Vec<Told> {
    findings::read(files).0.kinds.unwrap()
}

fn until_found(c: &mut FlightController, now: Instant) {
    let begun = Instant::now();
    while c.kinds().next().is_some() {
        assert!(begun.elapsed() < Duration::from_secs(120));
        c.advance(now).unwrap();
        thread::sleep(Duration::from_millis(2));
    }
}

/// Draws the axial slice through a place, and returns its pixel there.
fn pixel(c: &mut FlightController, place: DVec3, now: Instant) -> [u8; 3] {
    c.slice(SliceInput::Point(place), now);
    let due = c.prepare(ImageSize::new(32, 24), &[(Orientation::Axial, [200, 160])], now).unwrap();
    c.show(due).unwrap();
    let entity = c.slices().entity(Orientation::Axial).unwrap();
    let view = c.flight().app().world.get::<SliceView>(entity).unwrap();
    let [x, y] = view.shown().unwrap().pixel(place).0.map(|p| p as usize);
    view.frame.pixels()[y * 200 + x]
}

/// Returns a place in the largest body of gas in the abdomen that is no colon, and its kind.
fn no_colon(c: &FlightController) -> (DVec3, GasKind) {
    let map = c.kinds().map.clone().unwrap();
    let other = |b: &&GasBody| matches!(b.kind, GasKind::SmallBowel | GasKind::Stomach);
    let body = map.bodies().iter().filter(other).max_by(|a, b| a.ml.total_cmp(&b.ml)).expect("there is other gas");
    (body.place, body.kind)
}

fn is_like([r, g, b]: [u8; 3], kind: GasKind) -> bool {
    // Gas is black: what is seen is the colour at its opacity.
    let of = |opacity: u8| colour(kind).unwrap().map(|c| (u32::from(c) * u32::from(opacity) / 255) as i32);
    let near = |to: [i32; 3]| to.iter().zip([r, g, b]).all(|(a, b)| (a - i32::from(b)).abs() < 30);
    near(of(OPACITY)) || near(of(CHOSEN))
}

/// Fails if the kinds are those that were read before the scan was locked: what another window has told since would be overwritten.
#[test]
fn what_another_window_told_meanwhile_stays() {
    let (mut scan, now, dir) = (scan(), Instant::now(), tempfile::tempdir().unwrap());
    let files = ScanFiles::below(dir.path(), "a.json");
    let file = files.findings.clone().unwrap();
    let mut c = flown(&mut scan);
    c.show_kinds(true, now);
    until_found(&mut c, now);
    let place = no_colon(&c).0;
    let mut c = flown(&mut scan);
    let kinds = Some(vec![(place, GasKind::Colon)]);
    findings::keep(&file, &Findings { scan: files.content.hash.clone(), kinds, ..Findings::default() }).unwrap();
    let meanwhile = kept(&files);
    c.set_document(Document::open(&files).0);
    c.show_kinds(true, now);
    until_found(&mut c, now);
    assert!(c.flight().setup().lumen.segment_at(place).is_some(), "it counts");
    let here = c.flight().pose().position;
    c.slice(SliceInput::Click(here), now);
    perform(&mut c, "kind-colon", now);
    let kept = kept(&files);
    assert!(kept.len() == 2 && kept.contains(&meanwhile[0]), "{kept:?}");
    // A damaged file, or none, changes nothing.
    std::fs::write(&file, "damaged").unwrap();
    for name in ["a.json", "none.json"] {
        c.set_document(Document::open(&ScanFiles::below(dir.path(), name)).0);
        assert_eq!(c.kinds().told(), kept);
    }
}

#[test]
fn gas_has_the_colour_of_its_kind_and_the_reader_changes_it() {
    let (mut scan, now, dir) = (scan(), Instant::now(), tempfile::tempdir().unwrap());
    let files = ScanFiles::below(dir.path(), "a.json");
    let mut c = flown(&mut scan);
    c.set_document(Document::open(&files).0);
    let colon = c.flight().pose().position;
    // Nothing is found and coloured before somebody asks.
    c.advance(now).unwrap();
    assert!(c.kinds().map.is_none() && c.kinds().next().is_none() && c.kinds().tint().is_none());
    let [r, g, b] = pixel(&mut c, colon, now);
    assert!(r == g && g == b && r < 40);
    perform(&mut c, "kind-colon", now);
    assert!(c.hud(now).message.unwrap().contains("not shown"));
    c.show_kinds(true, now);
    until_found(&mut c, now);
    assert!(is_like(pixel(&mut c, colon, now), GasKind::Colon));
    let (place, kind) = no_colon(&c);
    assert!(is_like(pixel(&mut c, place, now), kind));
    let before = c.kinds().volumes().unwrap();
    // A click tells why, and a key changes it.
    perform(&mut c, "kind-colon", now);
    assert!(c.hud(now).message.unwrap().contains("click on one"));
    c.slice(SliceInput::Click(place), now);
    assert!(c.hud(now).message.unwrap().starts_with(&format!("{}, ", kind.name())));
    let segments = c.flight().setup().lumen.segments.len();
    let pose = c.flight().pose();
    perform(&mut c, "kind-colon", now);
    assert_eq!(kept(&files).len(), 1);
    until_found(&mut c, now);
    assert_eq!(c.flight().pose(), pose, "the flight goes on");
    assert!(is_like(pixel(&mut c, place, now), GasKind::Colon));
    assert!(c.kinds().chosen_body().unwrap().1.is_told);
    assert!(c.flight().setup().lumen.segment_at(place).is_some());
    let after = c.kinds().volumes().unwrap();
    assert!(after[0] > before[0] && after[kind.number()] < before[kind.number()]);
    // Opened again, the scan has that kind from the first.
    scan.tell(kept(&files));
    let again = flown(&mut scan);
    // A file keeps a place to the last digit but one.
    let [a, b] = [&again, &c].map(|c| c.flight().setup().told[0]);
    assert!(a.0.distance(b.0) < 1e-9 && a.1 == b.1, "{a:?}, {b:?}");
    assert!(again.flight().setup().lumen.segment_at(place).is_some());
    // It is undone like any other change.
    perform(&mut c, "undo", now);
    until_found(&mut c, now);
    assert!(is_like(pixel(&mut c, place, now), kind));
    assert_eq!(c.flight().setup().lumen.segments.len(), segments);
    assert!(kept(&files).is_empty() && c.flight().setup().told.is_empty());
    // Hidden, the slices are grey.
    c.show_kinds(false, now);
    let [r, g, b] = pixel(&mut c, place, now);
    assert!(r == g && g == b);
}

#[test]
fn gas_that_was_flown_and_is_no_colon_is_left() {
    let (mut scan, now) = (scan(), Instant::now());
    let mut c = flown(&mut scan);
    c.show_kinds(true, now);
    until_found(&mut c, now);
    let place = c.flight().pose().position;
    c.slice(SliceInput::Click(place), now);
    perform(&mut c, "kind-stomach", now);
    until_found(&mut c, now);
    let said = c.hud(now).message.unwrap();
    assert!(said.contains("no longer colon"), "{said}");
    let setup = c.flight().setup();
    assert!(setup.plan.segment.is_some() && setup.lumen.segment_at(place) != setup.plan.segment);
    assert!(c.flight().pose().position.distance(place) > 5.0, "the flight is elsewhere");
    let body = c.kinds().chosen_body().unwrap().1;
    assert_eq!((body.kind, body.why), (GasKind::Stomach, "set by the reader"));
    // What is told twice, or of nothing, changes nothing.
    perform(&mut c, "kind-stomach", now);
    assert!(c.kinds().next().is_none());
    perform(&mut c, "kind-as-judged", now);
    until_found(&mut c, now);
    assert!(c.flight().setup().told.is_empty() && !c.flight().setup().lumen.segments.is_empty());
}

#[test]
fn what_cannot_be_stored_is_told_all_the_same() {
    let (mut scan, now, dir) = (scan(), Instant::now(), tempfile::tempdir().unwrap());
    let mut c = flown(&mut scan);
    // A file where the folder would be.
    std::fs::write(dir.path().join("findings"), "").unwrap();
    c.set_document(Document::open(&ScanFiles::below(dir.path(), "a.json")).0);
    c.show_kinds(true, now);
    until_found(&mut c, now);
    let (place, _) = no_colon(&c);
    c.slice(SliceInput::Click(place), now);
    perform(&mut c, "kind-lung", now);
    assert!(c.hud(now).message.unwrap().starts_with("not saved: "));
    until_found(&mut c, now);
    assert_eq!(c.kinds().chosen_body().unwrap().1.kind, GasKind::Lung);
}

/// What the reader has said and measured.
type State = (Vec<String>, Vec<Said>, Vec<Told>);

fn state(c: &FlightController) -> State {
    let measures = c.measures().list().iter().map(|m| format!("{m:?}")).collect();
    let reading = c.assistant().unwrap().reading();
    (measures, (0..).map_while(|n| reading.said(n).cloned()).collect(), c.kinds().told.clone())
}

/// Whatever is done in whatever order, undoing takes back the last change.
#[test]
fn changes_are_undone_in_the_order_in_which_they_were_made() {
    let (mut scan, now) = (scan(), Instant::now());
    let mut c = flown(&mut scan);
    // The tag is looked for once something was shown.
    trace(&mut c, now);
    c.show_kinds(true, now);
    wish(&mut c, Intent::Search, now);
    let begun = Instant::now();
    while c.kinds().next().is_some() || c.may_read().is_err() {
        assert!(begun.elapsed() < Duration::from_secs(240), "{:?}", c.hud(now).message);
        c.advance(now).unwrap();
        thread::sleep(Duration::from_millis(2));
    }
    perform(&mut c, "candidate-yes", now);
    assert!(c.hud(now).message.unwrap().contains("no candidate is selected"));
    let (place, _) = no_colon(&c);
    c.slice(SliceInput::Click(place), now);
    wish(&mut c, Intent::Select(0), now);
    let answers = [Answer::Yes, Answer::No, Answer::Unsure];
    let kinds = [Some(GasKind::Lung), Some(GasKind::Stomach), None];
    for seed in 0..4 {
        let mut before: Vec<State> = Vec::new();
        // The candidate whose note is being written.
        let mut writing = None;
        let mut n = 0;
        let mut random = |below: usize| {
            n += 1;
            (hash::uniform(seed, n) * below as f64) as usize
        };
        while !c.measures().list().is_empty() || !state(&c).2.is_empty() {
            perform(&mut c, "undo", now);
        }
        for step in 0..80 {
            let (former, what) = (state(&c), random(9));
            let mut note = None;
            match what {
                0 | 1 => {
                    if !c.measures().is_on() {
                        perform(&mut c, "measure", now);
                    }
                    c.slice(SliceInput::Click(place), now);
                    // Half way, an end is discarded and nothing else.
                    if random(3) == 0 {
                        perform(&mut c, "undo", now);
                        assert!(c.measures().begun().is_none() && state(&c) == former, "{seed}, {step}");
                        continue;
                    }
                    c.slice(SliceInput::Click(place + DVec3::X * (1.0 + random(50) as f64)), now);
                }
                2 => perform(&mut c, "delete-last", now),
                3 => wish(&mut c, Intent::DeleteMeasure(random(4)), now),
                4 => wish(&mut c, Intent::Answer(answers[random(3)]), now),
                5 => {
                    let of = random(2);
                    note = Some(of);
                    wish(&mut c, Intent::Note(of, format!("{} letters", random(1000))), now);
                }
                6 => c.tell_kind(kinds[random(3)], now),
                _ => {
                    perform(&mut c, "undo", now);
                    assert_eq!(state(&c), before.pop().unwrap_or(former), "{seed}, {step}");
                    writing = None;
                    continue;
                }
            }
            if state(&c) != former {
                // Letter by letter, a note is one change.
                if note.is_none() || note != writing {
                    before.push(former);
                }
                writing = note;
            }
        }
        for former in before.into_iter().rev() {
            perform(&mut c, "undo", now);
            assert_eq!(state(&c), former, "{seed}");
        }
    }
}
