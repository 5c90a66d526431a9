//! Golden pictures of the panels and layouts: laid out, clicked and rasterised as in a window, without one.
//!
//! After an intended change, `COLVIS_REPLACE=1 cargo test --release --lib panels::pictures` rewrites `tests/panels/*.png`. Look
//! at the pictures before you commit them. Every panel of [`BUILT_IN`] has one.

use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use egui::{Event, Modifiers, PointerButton, Pos2, RawInput, Rect, Ui};
use glam::DVec3;

use super::open::{FileList, Listing};
use super::second::SecondPanel;
use super::series::SeriesList;
use super::*;
use crate::app::{FlightRequest, OpenOptions, Scan, Scene};
use crate::components::slices::SliceView;
use crate::host::settings::KeySettings;
use crate::host::window::action::Actions;
use crate::host::window::background::Background;
use crate::host::window::contract::{Other, WindowView};
use crate::host::window::controller::FlightController;
use crate::host::window::controller::tests::wish;
use crate::host::window::directions::Directions;
use crate::host::window::intent::{FindingEdit, FindingOf, Intent, SliceInput};
use crate::host::window::interface::{Interface, WindowSize};
use crate::host::window::layer::{Placed, compose};
use crate::host::window::layouts::LAYOUTS;
use crate::host::window::overlay::{self, Content, HudState};
use crate::host::window::painter::Artist;
use crate::host::window::pairing::Pairing;
use crate::host::window::place::Bar;
use crate::host::window::sheet::Sheet;
use crate::host::window::style::Severity;
use crate::host::window::workspace::Workspace;
use crate::output::png;
use crate::phantom::PhantomSettings;
use crate::polyps::answers::Answer;
use crate::render::{Frame, ImageSize, Light};
use crate::shared::shared;
use crate::volume::io::study::{self, Picture, Series, Study};

/// A pixel differs if one of its colours differs by more than the first number, and a picture if more pixels differ than the
/// second. Another processor may round an edge differently, and even the smallest letter has more pixels than that.
const COLOUR: u8 = 24;
const PIXELS: usize = 4;

/// A flight through the phantom, in a window of the given size.
struct Stage {
    controller: FlightController,
    actions: Rc<Actions>,
    interface: Interface,
    artist: Artist,
    size: WindowSize,
    hud: HudState,
    recent: Vec<PathBuf>,
    /// True while the patient's other position is being read beside it.
    is_beside: bool,
}

impl Stage {
    fn new(pixels: ImageSize, scale: f32) -> Self {
        let mut scene = Scene { picture: true, operator: true, ..Scene::guided_by("tentacles") };
        scene.image.settings.light = Light::ENDOSCOPE;
        let (_, volume) = shared(&PhantomSettings::embedded(1));
        let mut scan = Scan::of(volume, &OpenOptions::default()).unwrap();
        let flight = scan.flight(scene, &FlightRequest::default()).unwrap();
        let actions =
            Actions::new(&flight.setup().scene.guides, &[], BUILT_IN, &KeySettings::new()).map(Rc::new).unwrap();
        let hud = HudState {
            state: "flying".to_owned(),
            severity: Severity::Normal,
            figures: ["12 ms, 60 pictures a second", "20 mm/s", "9.5 mm from the wall"].map(str::to_owned).to_vec(),
            directions: Directions::of(&flight.pose().attitude),
            bar: Bar {
                camera: 310,
                read: vec![[0, 310]],
                guessed: vec![[640, 680]],
                parts: vec![(80, "rectum"), (400, "sigmoid"), (1000, "cecum")],
                calls: vec![620],
                expected: None,
            },
            place: "250 of about 810 mm".to_owned(),
            keys: actions.short_help(),
            ..HudState::default()
        };
        let controller =
            FlightController::new(flight, Background::new(Arc::new(|| {})), Vec::new(), Rc::clone(&actions)).unwrap();
        let (interface, size) = (Interface::new(), WindowSize { pixels, scale });
        let recent = ["/scans/prone.nii.gz", "/scans/supine"].map(PathBuf::from).to_vec();
        Self { controller, actions, interface, artist: Artist::new(), size, hud, recent, is_beside: false }
    }

    /// Lays out after some events.
    fn lay_out(
        &mut self,
        events: Vec<Event>,
        draw: &mut dyn FnMut(&Context<'_>, &mut Ui, &mut Requests),
    ) -> (Frame, Requests) {
        let loading = Content::Loading { stage: "reading".to_owned(), share: Some(0.4) };
        let other = Other { content: &loading, view: None, opened: None, is_first: false };
        let context = Context::new(&self.controller, &self.actions, &self.recent, &self.hud);
        let pairing = Pairing::new(Instant::now());
        let context = context.beside(Some(other).filter(|_| self.is_beside), self.is_beside, &pairing);
        let mut requests = Requests::default();
        let laid_out =
            self.interface.lay_out(RawInput { events, ..RawInput::default() }, self.size, Instant::now(), |ui| {
                requests = Requests::default();
                draw(&context, ui, &mut requests);
                Vec::new()
            });
        laid_out.unwrap();
        // Rasterise each time, as a change of a texture is reported only once.
        let layout = self.interface.layout().unwrap();
        let layer = self.artist.paint(layout, &layout.textures);
        let ImageSize { width, height } = self.size.pixels;
        let world = &self.controller.flight().app().world;
        let slices = requests.slices_at().iter().filter_map(|(orientation, at)| {
            let view = world.get::<SliceView>(self.controller.slices().entity(*orientation)?)?;
            Some((at, &view.frame))
        });
        let flight = requests.flight_at().zip(self.controller.image());
        let placed: Vec<Placed<'_>> = (flight.iter().map(|(at, frame)| (at, *frame)).chain(slices))
            .map(|(at, frame)| {
                let [left, top, ..] = self.size.in_pixels(*at);
                Placed { at: (left, top), frame }
            })
            .collect();
        let mut surface = vec![0; width * height];
        compose(&placed, &layer, &mut surface, width);
        let mut picture = Frame::new(width, height);
        for (pixel, colour) in picture.buffers().0.iter_mut().zip(surface) {
            let [_, r, g, b] = colour.to_be_bytes();
            *pixel = [r, g, b];
        }
        (picture, requests)
    }

    /// Returns the window's picture once all images are complete.
    fn picture(&mut self, mut draw: impl FnMut(&Context<'_>, &mut Ui, &mut Requests)) -> Frame {
        for _ in 0..2 {
            let (_, requests) = self.lay_out(Vec::new(), &mut draw);
            let size = |at: &Rect| self.size.in_pixels(*at);
            let [.., width, height] = requests.flight_at().map_or([0; 4], |at| size(&at));
            let slices: Vec<_> =
                requests.slices_at().iter().map(|(o, at)| (*o, size(at))).map(|(o, [.., w, h])| (o, [w, h])).collect();
            // At rest, render until every picture has its final quality.
            while let Some(due) =
                self.controller.prepare(ImageSize::new(width, height), &slices, Instant::now()).unwrap()
            {
                self.controller.show(Some(due)).unwrap();
            }
        }
        self.lay_out(Vec::new(), &mut draw).0
    }

    /// Returns the picture of a layout.
    fn layout(&mut self, name: &str) -> Frame {
        let mut workspace = Workspace::new(BUILT_IN, Some(name), None).0;
        self.is_beside = name == "both";
        let picture = self.picture(|context, ui, requests| workspace.ui(context, ui, requests));
        self.is_beside = false;
        picture
    }

    /// Returns the picture of a panel that fills the window.
    fn panel(&mut self, panel: &mut dyn Panel) -> Frame {
        self.picture(|context, ui, requests| panel.ui(context, ui, requests))
    }

    /// Performs the action with that name.
    fn perform(&mut self, action: &str) {
        let intent = self.actions.named(action).unwrap().intent.clone();
        wish(&mut self.controller, intent, Instant::now());
    }

    /// Clicks on a point of the world, as in a slice.
    fn click(&mut self, place: DVec3) {
        self.controller.slice(SliceInput::Click(place), Instant::now());
    }
}

fn write(path: &Path, picture: &Frame) {
    let mut out = Vec::new();
    let size = [picture.width(), picture.height()];
    png::encode(&mut out, picture.pixels().as_flattened(), size, png::ColorType::Rgb, png::Compression::High).unwrap();
    std::fs::write(path, out).unwrap();
}

/// The folder of the stored pictures.
const PICTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/panels");

/// Compares a picture with the stored one, or stores it.
fn hold(name: &str, picture: &Frame) {
    let path = Path::new(PICTURES).join(format!("{name}.png"));
    if std::env::var_os("COLVIS_REPLACE").is_some() {
        std::fs::create_dir_all(PICTURES).unwrap();
        write(&path, picture);
        return;
    }
    let anew = "look at it, and if it is meant: COLVIS_REPLACE=1 cargo test --release --lib panels::pictures";
    let kept = image::open(&path).unwrap_or_else(|e| panic!("{}: {e}; {anew}", path.display())).into_rgb8();
    assert_eq!((kept.width() as usize, kept.height() as usize), (picture.width(), picture.height()), "{name}; {anew}");
    let differ = |(a, b): (&[u8; 3], &image::Rgb<u8>)| a.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > COLOUR);
    let differing = picture.pixels().iter().zip(kept.pixels()).filter(|p| differ((p.0, p.1))).count();
    if differing > PIXELS {
        let seen = std::env::temp_dir().join(format!("colvis-{name}.png"));
        write(&seen, picture);
        panic!("{name}: {differing} pixels differ, see {}; {anew}", seen.display());
    }
}

#[test]
fn every_panel_looks_as_it_did() {
    let mut stage = Stage::new(ImageSize::new(440, 320), 1.0);
    let start = stage.controller.flight().pose().position;
    for entry in BUILT_IN {
        // The listed files differ between machines.
        let mut panel: Box<dyn Panel> = match entry.name {
            "open" => Box::new(scans()),
            "second" => Box::new(SecondPanel::of(scans())),
            _ => (entry.make)(),
        };
        hold(entry.name, &stage.panel(&mut *panel));
    }
    // Two distances, and one that is incomplete.
    stage.perform("measure");
    for x in [0.0, 12.0, 4.0, 4.0, -3.0] {
        stage.click(start + DVec3::new(x, 0.5 * x, 0.0));
    }
    for entry in [measures::PANEL, slices::AXIAL] {
        hold(&format!("{}-measured", entry.name), &stage.panel(&mut *(entry.make)()));
    }
}

#[test]
fn candidates_look_as_they_did() {
    let mut stage = Stage::new(ImageSize::new(640, 420), 1.0);
    let mut panel = (candidates::PANEL.make)();
    // The first picture of the flight comes before the search.
    stage.panel(&mut *(flight::PANEL.make)());
    let ask = |stage: &mut Stage, request| wish(&mut stage.controller, request, Instant::now());
    ask(&mut stage, Intent::Search);
    let begun = Instant::now();
    while stage.controller.may_read().is_err() {
        assert!(begun.elapsed() < std::time::Duration::from_secs(120));
        stage.controller.advance(Instant::now()).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    for request in [
        Intent::Select(1),
        Intent::Answer(Answer::No),
        Intent::Select(0),
        Intent::Answer(Answer::Yes),
        Intent::Select(0),
        Intent::Note(0, "on a fold".to_owned()),
        Intent::Mark,
    ] {
        ask(&mut stage, request);
    }
    let place = stage.controller.assistant().unwrap().found().unwrap().list[0].candidate.position;
    // From the next picture on.
    stage.controller.advance(Instant::now()).unwrap();
    hold("candidates-marked", &stage.panel(&mut *(flight::PANEL.make)()));
    ask(&mut stage, Intent::MeasureLesion);
    stage.click(place);
    hold("candidates-list", &stage.panel(&mut *panel));
    hold("candidates-measured", &stage.panel(&mut *(slices::AXIAL.make)()));
}

#[test]
fn findings_look_as_they_did() {
    let mut stage = Stage::new(ImageSize::new(420, 640), 1.0);
    let mut panel = (findings::PANEL.make)();
    stage.panel(&mut *(flight::PANEL.make)());
    let truth = shared(&PhantomSettings::embedded(1)).0.truth();
    for polyp in &truth.polyps[..2] {
        stage.click(polyp.position);
        stage.perform("finding");
    }
    stage.perform("finding-outside");
    for request in [
        Intent::EditFinding(1, FindingEdit::Note("on a fold".to_owned())),
        Intent::EditOutside(0, "E2".to_owned(), "a cyst of the left kidney".to_owned()),
    ] {
        wish(&mut stage.controller, request, Instant::now());
    }
    let begun = Instant::now();
    let is_made = |c: &FlightController| {
        let list = &c.document().found().findings;
        list.iter().all(|f| c.findings().pictures(&f.id).is_some() && f.along_mm.is_some())
    };
    while !is_made(&stage.controller) {
        assert!(begun.elapsed() < std::time::Duration::from_secs(120));
        stage.controller.advance(Instant::now()).unwrap();
        stage.controller.hud(Instant::now());
        stage.panel(&mut *(flight::PANEL.make)());
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    hold("findings-list", &stage.panel(&mut *panel));
    let mut panel = (quality::PANEL.make)();
    while stage.controller.quality().list(stage.controller.flight()).is_none() {
        assert!(begun.elapsed() < std::time::Duration::from_secs(120));
        stage.panel(&mut *panel);
        stage.controller.advance(Instant::now()).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    stage.controller.set_seconds(&[("rectum", 62.0), ("sigmoid", 187.4)]);
    hold("quality-list", &stage.panel(&mut *panel));
    let place = stage.controller.document().found().findings[1].place;
    stage.click(place);
    wish(&mut stage.controller, Intent::VisitFinding(1), Instant::now());
    stage.controller.advance(Instant::now()).unwrap();
    hold("findings-flight", &stage.panel(&mut *(flight::PANEL.make)()));
    hold("findings-axial", &stage.panel(&mut *(slices::AXIAL.make)()));
}

/// A text field remembers what was written in it, and the next finding has another one.
#[test]
fn a_note_is_not_undone_into_that_of_another_finding() {
    let mut stage = Stage::new(ImageSize::new(420, 640), 1.0);
    let mut panel = (findings::PANEL.make)();
    stage.panel(&mut *(flight::PANEL.make)());
    for polyp in &shared(&PhantomSettings::embedded(1)).0.truth().polyps[..2] {
        stage.click(polyp.position);
        stage.perform("finding");
    }
    let mut after = |stage: &mut Stage, event: Event| {
        let mut requests = stage.lay_out(vec![event], &mut |context, ui, requests| panel.ui(context, ui, requests)).1;
        let edits = requests.take().into_iter().filter(|intent| matches!(intent, Intent::EditFinding(..)));
        edits.for_each(|intent| wish(&mut stage.controller, intent, Instant::now()));
        let list = &stage.controller.document().found().findings;
        list.iter().map(|f| f.note.clone()).collect::<Vec<_>>()
    };
    let key = |key, modifiers| Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers };
    let undo = || key(egui::Key::Z, Modifiers::CTRL | Modifiers::COMMAND);
    // The keyboard goes from field to field until it is at the note.
    let write = |stage: &mut Stage, after: &mut dyn FnMut(&mut Stage, Event) -> Vec<String>, words: &str| {
        let is_written = (0..30).any(|_| {
            after(stage, key(egui::Key::Tab, Modifiers::NONE));
            after(stage, Event::Text(words.to_owned())).iter().any(|note| note == words)
        });
        assert!(is_written, "no note is written");
    };
    write(&mut stage, &mut after, "second");
    // After a second, which is 60 pictures, it is a step that can be undone.
    for _ in 0..65 {
        assert_eq!(after(&mut stage, Event::PointerGone), ["", "second"]);
    }
    wish(&mut stage.controller, Intent::VisitFinding(0), Instant::now());
    assert_eq!(after(&mut stage, undo()), ["", "second"]);
    write(&mut stage, &mut after, "first");
    for _ in 0..3 {
        let notes = after(&mut stage, undo());
        assert!(!notes[0].contains("second") && notes[1] == "second", "{notes:?}");
    }
}

#[test]
fn an_end_of_a_finding_is_dragged_but_measured_where_distances_are_measured() {
    let mut stage = Stage::new(ImageSize::new(440, 320), 1.0);
    let middle = stage.controller.flight().pose().position;
    stage.click(middle);
    let ends = [-6.0, 6.0].map(|mm| middle + DVec3::X * mm);
    stage.controller.measure_between(ends[0], ends[1]);
    wish(&mut stage.controller, Intent::Finding(FindingOf::Distance(0)), Instant::now());
    let mut panel = (slices::AXIAL.make)();
    stage.panel(&mut *panel);
    let mut pressed = |stage: &mut Stage| {
        let mut draw = |context: &Context<'_>, ui: &mut Ui, requests: &mut Requests| panel.ui(context, ui, requests);
        let (orientation, at) = stage.lay_out(Vec::new(), &mut draw).1.slices_at()[0];
        let slice = stage.controller.slices().view(stage.controller.flight(), orientation).unwrap().shown().unwrap();
        let [x, y] = slice.pixel(ends[1]).0.map(|x| x as f32);
        let (pos, button, modifiers) = (at.min + egui::vec2(x, y), PointerButton::Primary, Modifiers::NONE);
        let press = |pressed| Event::PointerButton { pos, button, pressed, modifiers };
        let mut asked = stage.lay_out(vec![Event::PointerMoved(pos), press(true)], &mut draw).1.take();
        asked.extend(stage.lay_out(vec![press(false)], &mut draw).1.take());
        asked.iter().any(|intent| matches!(intent, Intent::Slice(SliceInput::Click(_))))
    };
    assert!(!pressed(&mut stage));
    stage.perform("measure");
    assert!(pressed(&mut stage));
}

#[test]
fn kinds_of_gas_look_as_they_did() {
    let mut stage = Stage::new(ImageSize::new(440, 320), 1.0);
    let place = stage.controller.flight().pose().position;
    // The flight stays where it is while time stands still.
    let begun = Instant::now();
    stage.controller.show_kinds(true, begun);
    while stage.controller.kinds().next().is_some() {
        assert!(begun.elapsed() < std::time::Duration::from_secs(120));
        stage.controller.advance(begun).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    hold("kinds-legend", &stage.panel(&mut *(kinds::PANEL.make)()));
    hold("axial-kinds", &stage.panel(&mut *(slices::AXIAL.make)()));
    stage.click(place);
    hold("kinds-chosen", &stage.panel(&mut *(kinds::PANEL.make)()));
}

/// An example of a study: a localizer, supine and prone, and a report.
fn study() -> Study {
    let series = |number: usize, slices: usize, code: &str, description: &str| Series {
        number,
        slices,
        modality: "CT".to_owned(),
        size: [512, 512],
        spacing_mm: Some([0.7, 0.7, 1.0]),
        patient_position: Some(code.to_owned()),
        description: description.to_owned(),
        patient: 1,
        study: 1,
        plane: Some("axial"),
        counts: true,
        ..Series::default()
    };
    let why = |why: &str| Some(why.to_owned());
    let series = vec![
        Series { why: why("a localizer"), counts: false, plane: None, ..series(1, 2, "HFS", "Topogram") },
        Series { pair: vec![3], ..series(2, 412, "HFS", "Colon supine 1.0 B30f") },
        Series { pair: vec![2], ..series(3, 405, "HFP", "Colon prone 1.0 B30f") },
        Series { modality: "SR".to_owned(), spacing_mm: None, why: why("no image"), ..series(4, 0, "", "Dose report") },
    ];
    // A body with gas in it; wider than high.
    let grey = |x: usize, y: usize| {
        let [x, y] = [x as f32 - 35.5, 1.4 * (y as f32 - 25.5)];
        let gas = (x - 12.0).hypot(y - 8.0) < 7.0;
        if x.hypot(y) > 33.0 || gas { 10 } else { 130 }
    };
    let grey: Vec<u8> = (0..52).flat_map(|y| (0..72).map(move |x| grey(x, y))).collect();
    let picture = Picture { width: 72, height: 52, grey };
    let pictures = vec![Some(picture.clone()), Some(picture.clone()), Some(picture), None];
    Study { series, pictures, usual: None }
}

#[test]
fn the_series_of_the_open_study_look_as_they_did() {
    let mut stage = Stage::new(ImageSize::new(440, 420), 1.0);
    let mut panel = scans().with_series(SeriesList::known(Path::new("/study"), study()));
    let picture = stage.picture(|context, ui, requests| {
        let context = Context::new(context.view, context.actions, context.recent, context.hud);
        Panel::ui(&mut panel, &context.of_scan(Some(Path::new("/study")), Some(2)), ui, requests);
    });
    hold("open-series", &picture);
}

#[cfg(feature = "dicom")]
#[test]
fn the_studies_of_an_archive_look_as_they_did() {
    use super::archive::ArchiveList;
    use crate::dicom::archive::{self, Archive, Found};
    let series = |number: i64, description: &str, instances: u64| {
        let mut series = archive::Series::default();
        (series.number, series.instances) = (Some(number), Some(instances));
        series.description = description.to_owned();
        series
    };
    let study = |name: &str, id: &str, date: &str, list: Vec<archive::Series>| {
        let mut study = archive::Study::default();
        (study.patient_name, study.patient_id) = (name.to_owned(), id.to_owned());
        (study.date, study.description, study.series) = (date.to_owned(), "CT colonography".to_owned(), list);
        study
    };
    let mut found = Found::default();
    found.has_more = true;
    found.studies = vec![
        study("Miller^Ann", "4711", "20260131", vec![series(2, "supine", 512), series(3, "prone", 498)]),
        study("Millward^Bob", "4712", "20251203", vec![series(4, "", 430)]),
    ];
    let archives = vec![Archive::new("hospital", "127.0.0.1", 4242, "ORTHANC")];
    let list = ArchiveList::of(archives).with_found("mill", found);
    let mut panel = scans().with_archive(list);
    let mut stage = Stage::new(ImageSize::new(440, 420), 1.0);
    let picture = stage.picture(|context, ui, requests| {
        let context = Context::new(context.view, context.actions, context.recent, context.hud);
        Panel::ui(&mut panel, &context, ui, requests);
    });
    hold("open-archive", &picture);
    // What is typed goes into the field that was clicked on, until a series is: the keys are the window's then.
    let mut after = |events: Vec<Event>| {
        stage.lay_out(events, &mut |context, ui, requests| {
            let context = Context::new(context.view, context.actions, context.recent, context.hud);
            Panel::ui(&mut panel, &context, ui, requests);
        });
        let egui = stage.interface.egui();
        let is_taken = egui.text_edit_focused() || egui.egui_wants_keyboard_input();
        (is_taken, panel.archive().patient().to_owned(), panel.archive().failed().map(str::to_owned))
    };
    let click = |(x, y): (f32, f32)| {
        let (pos, modifiers) = (Pos2::new(x, y), Modifiers::NONE);
        let press = |pressed| Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers };
        [Event::PointerMoved(pos), press(true), press(false)].map(|event| vec![event])
    };
    let (field, series) = ((130.0, 30.0), (60.0, 96.0));
    let patient = || "mill".to_owned();
    let clicked = click(field).map(&mut after);
    assert_eq!(clicked[2], (true, patient(), None));
    // This one has no UID: the fields stay, with why it is not fetched.
    let [.., (is_taken, _, failed)] = click(series).map(&mut after);
    assert!(!is_taken && failed.is_some_and(|why| why.contains("UID")), "the click chooses no series");
    let typed = || vec![Event::Text("x".to_owned())];
    assert_eq!(after(typed()).1, patient());
    for events in click(field) {
        after(events);
    }
    assert!(after(typed()).1.contains('x'));
}

/// An example listing of a folder.
fn scans() -> FileList {
    let list = |names: &[&str]| names.iter().map(|n| Path::new("/scans").join(n)).collect();
    let scans = list(&["abdomen.nii", "prone.nii.gz"]);
    FileList::of("/scans", Listing { folders: list(&["supine", "thorax"]), scans, fault: None })
}

#[test]
fn every_layout_looks_as_it_did() {
    let mut stage = Stage::new(ImageSize::new(880, 560), 1.0);
    for layout in LAYOUTS {
        hold(&format!("layout-{}", layout.name), &stage.layout(layout.name));
    }
    let mut workspace = Workspace::new(BUILT_IN, Some("reading"), None).0;
    workspace.warn(vec!["the header says prone, the level says supine: left and right may be wrong".to_owned()]);
    for (name, mut sheet) in [
        ("help", Sheet::keys()),
        ("welcome", Sheet::Welcome),
        ("quit", Sheet::Quit { why: "Nothing is finished.".to_owned(), keeps: true }),
        ("quit-unkept", Sheet::Quit { why: "Nothing is finished.".to_owned(), keeps: false }),
    ] {
        let picture = stage.picture(|context, ui, requests| {
            workspace.ui(context, ui, requests);
            assert_eq!(sheet.ui(context, ui, requests), crate::host::window::sheet::Answer::Stay);
        });
        hold(&format!("layout-{name}"), &picture);
    }
}

#[test]
fn what_is_small_or_dense_looks_as_it_did() {
    // Pixels of half the size, and a window of the minimum size.
    hold("dense", &Stage::new(ImageSize::new(1280, 800), 2.0).layout("reading"));
    let mut small = Stage::new(ImageSize::new(320, 240), 1.0);
    (small.hud.severity, small.hud.state) = (Severity::Alert, "operator needed".to_owned());
    hold("small", &small.layout("flight"));
}

#[test]
fn what_is_under_the_pointer_is_told_beside_letters_and_scale_bar() {
    let mut stage = Stage::new(ImageSize::new(260, 240), 1.0);
    let mut panel = (slices::CORONAL.make)();
    stage.panel(&mut *panel);
    stage.perform("slab");
    stage.panel(&mut *panel);
    let events = vec![Event::PointerMoved(Pos2::new(70.0, 90.0))];
    hold("readout", &stage.lay_out(events, &mut |context, ui, requests| panel.ui(context, ui, requests)).0);
}

#[test]
fn loading_and_a_scan_that_cannot_be_flown_look_as_they_did() {
    let mut stage = Stage::new(ImageSize::new(640, 420), 1.0);
    let loading = |_: &Context<'_>, ui: &mut Ui, _: &mut Requests| {
        let area = ui.ctx().content_rect();
        overlay::loading(&ui.ctx().layer_painter(egui::LayerId::background()), area, "reading", Some(0.4), "Esc");
    };
    hold("loading", &stage.picture(loading));
    let instead = |list: &mut FileList, series: &[String], stage: &mut Stage, events: Vec<Event>| {
        let mut chosen = None;
        let why = if series.is_empty() { "scan.nii: is empty" } else { "study: holds 4 series, 3 of them CT" };
        let (picture, _) = stage.lay_out(events, &mut |context, ui, _| {
            chosen = list.instead(why, Some(Path::new("/study")), series, context.recent, "Esc", ui);
        });
        (picture, chosen)
    };
    hold("failed", &instead(&mut scans(), &[], &mut stage, Vec::new()).0);
    let mut list = scans().with_series(SeriesList::known(Path::new("/study"), study()));
    let lines = study::table(&study().series);
    let mut failed = |stage: &mut Stage, events: Vec<Event>| instead(&mut list, &lines, stage, events);
    // A texture reaches the picture after the one that it is loaded for.
    failed(&mut stage, Vec::new());
    hold("choose", &failed(&mut stage, Vec::new()).0);
    // The second series is chosen from the list.
    let at = Pos2::new(240.0, 220.0);
    let click =
        |pressed| Event::PointerButton { pos: at, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE };
    failed(&mut stage, vec![Event::PointerMoved(at)]);
    failed(&mut stage, vec![click(true)]);
    let chosen = failed(&mut stage, vec![click(false)]).1;
    assert_eq!(chosen, Some(Intent::Open(PathBuf::from("/study"), Some(2))));
}
