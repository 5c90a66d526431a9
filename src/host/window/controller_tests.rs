use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::*;
use crate::app::{FlightRequest, ImageSettings, OpenOptions, Plan, Scan, Scene};
use crate::components::flight::Flight;
use crate::components::slices::Orientation;
use crate::fields::lumen;
use crate::host::settings::KeySettings;
use crate::host::window::intent::{ActionContext, Intent, SliceInput};
use crate::host::window::keys::Hold;
use crate::host::window::panels::BUILT_IN;
use crate::phantom::PhantomSettings;
use crate::progress::Progress;
use crate::render::{ImageSize, Preset, Quality, Settings};
use crate::shared::shared;
use crate::space::{PreparedVolume, TransferFunction};
use crate::volume::{Grid, Volume};

const WINDOW: ImageSize = ImageSize::new(96, 72);
/// Time between two pictures.
const FRAME: Duration = Duration::from_millis(20);

/// A flight along y through a square tube of 20 mm.
pub(crate) fn flight(guide: &'static str) -> FlightApp {
    flight_from(guide, DVec3::new(16.0, 8.0, 16.0))
}

/// The same flight with another end, for turning round.
fn flight_from(guide: &'static str, other_end: DVec3) -> FlightApp {
    flight_with(guide, other_end, |_| {})
}

/// The same flight with a modified scene.
fn flight_with(guide: &'static str, other_end: DVec3, change: impl FnOnce(&mut Scene)) -> FlightApp {
    let grid = Grid::new([32, 80, 32], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let gas = |n: usize| {
        let (i, j, k) = (n % 32, n / 32 % 80, n / (32 * 80));
        (6..26).contains(&i) && (4..76).contains(&j) && (6..26).contains(&k)
    };
    let data = (0..32 * 80 * 32).map(|n| if gas(n) { -1000 } else { 40 }).collect();
    let volume = Arc::new(Volume::new(grid, data));
    let lumen = Arc::new(lumen::find(&volume, &Progress::new()).unwrap());
    let [start, goal, end] = [14.0, 70.0, 8.0].map(|y| DVec3::new(16.0, y, 16.0));
    let mut plan = Plan { begin: end, ..Plan::between(start, goal, 60.0) };
    plan.ends[0].at = other_end;
    let settings = Settings { adaptive: true, ..Settings::new(Quality::High) };
    let image = ImageSettings { width: 8, height: 8, settings, ..ImageSettings::default() };
    let mut scene = Scene { picture: true, image, operator: true, ..Scene::guided_by(guide) };
    change(&mut scene);
    FlightApp::new(PreparedVolume::new(volume, TransferFunction::default()), lumen, plan, scene).unwrap()
}

/// A flight along the path of a phantom, in pictures of 96 × 72 pixels.
pub(crate) fn phantom_flight(phantom: &PhantomSettings) -> FlightApp {
    let mut scan = Scan::of(shared(phantom).1, &OpenOptions::default()).unwrap();
    let settings = Settings { adaptive: false, ..Settings::default() };
    let image = ImageSettings { width: WINDOW.width, height: WINDOW.height, settings, ..ImageSettings::default() };
    let scene = Scene { picture: true, operator: true, image, ..Scene::guided_by("path") };
    scan.flight(scene, &FlightRequest::default()).unwrap()
}

/// The controller of such a flight.
pub(crate) fn controller(guide: &'static str) -> FlightController {
    cockpit_of(flight(guide), 0.0, Vec::new())
}

/// Returns the position of a flight along its path, whole mm.
fn along_mm(c: &FlightController) -> i64 {
    let (share, length_mm) = c.flight().survey().progress();
    (share * length_mm).round() as i64
}

/// Creates the controller of `flight`, at `along_mm` of its path.
pub(crate) fn cockpit_of(flight: FlightApp, along_mm: f64, overlays: Vec<Overlay>) -> FlightController {
    cockpit_with(flight, along_mm, overlays, &KeySettings::new())
}

/// The same with other keys.
fn cockpit_with(
    mut flight: FlightApp,
    along_mm: f64,
    overlays: Vec<Overlay>,
    settings: &KeySettings,
) -> FlightController {
    flight.stands_at(along_mm);
    let actions = Actions::new(&flight.setup().scene.guides, &overlays, BUILT_IN, settings).unwrap();
    FlightController::new(flight, Background::new(Arc::new(|| {})), overlays, Rc::new(actions)).unwrap()
}

/// Performs the action with that name.
pub(crate) fn perform(c: &mut FlightController, action: &str, now: Instant) {
    let intent = c.actions.named(action).unwrap().intent.clone();
    wish(c, intent, now);
}

/// Does what is wanted, as far as it is not left to the window.
pub(crate) fn wish(c: &mut FlightController, intent: Intent, now: Instant) {
    c.execute(intent, ActionContext { window: WINDOW, now });
}

/// Renders the picture that is due. Returns true if there is one.
pub(crate) fn trace(c: &mut FlightController, now: Instant) -> bool {
    let due = c.prepare(WINDOW, &[], now).unwrap();
    let any = due.is_some();
    if any {
        assert!(c.show(due).unwrap().is_none(), "there is no window");
    }
    any
}

/// Flies for `frames` pictures. Returns the number of new ones.
fn fly(c: &mut FlightController, now: &mut Instant, frames: usize) -> usize {
    let mut new = 0;
    for _ in 0..frames {
        *now += FRAME;
        c.advance(*now).unwrap();
        new += usize::from(trace(c, *now));
    }
    new
}

#[test]
fn a_still_scene_is_refined_and_then_left_alone() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    assert_eq!(fly(&mut c, &mut now, 1), 1);
    assert!(c.view_renderer.is_refining(&c.flight) && c.next().is_some());
    fly(&mut c, &mut now, 60);
    assert!(c.rests());
    let begun = Instant::now();
    while c.view_renderer.is_refining(&c.flight) {
        fly(&mut c, &mut now, 1);
        assert!(begun.elapsed() < Duration::from_secs(60));
    }
    let image = c.image().unwrap();
    assert_eq!(image.size(), WINDOW);
    assert_eq!(c.view_renderer.detail(&c.flight).unwrap().samples, crate::render::adaptive::SAMPLES);
    c.hud(now + Duration::from_secs(1));
    assert_eq!(c.next(), None, "nothing to wake up for");
    let (ticks, frames) = (c.flight().clock().tick, c.frames().len());
    assert_eq!(fly(&mut c, &mut now, 50), 0);
    assert_eq!((c.flight().clock().tick, c.frames().len()), (ticks, frames), "neither simulated nor traced");
    // A message wakes the flight for display, but no picture is rendered for it.
    c.say("a word", now);
    assert!(c.next().is_some_and(|t| t <= now) && c.hud(now).message.is_some());
    assert_eq!(fly(&mut c, &mut now, 1), 0);
    // Looking around does change the picture.
    c.drag((9.0, 0.0), WINDOW);
    assert!(fly(&mut c, &mut now, 3) > 0);
}

#[test]
fn a_scene_that_makes_no_picture_is_left_alone_and_told_once() {
    use bevy_ecs::prelude::Single;
    use bevy_ecs::query::With;

    use crate::schedule::{App, FlightSystems, Main, Slot};
    type Plug = fn(&mut App) -> Result<()>;
    let fills: Plug = |app| app.fill(Slot::Renderer, "dark room");
    let silences: Plug = |app| {
        app.add_systems(FlightSystems::PostProcess, |mut p: Single<&mut Picture, With<Main>>| p.traced = false);
        Ok(())
    };
    for plug in [fills, silences] {
        let flight = flight_with("manual", DVec3::new(16.0, 8.0, 16.0), |scene| {
            *scene = scene.clone().plug(("bad", plug)).unwrap();
        });
        let (mut c, mut now) = (cockpit_of(flight, 0.0, Vec::new()), Instant::now());
        let told = |c: &mut FlightController, now| c.hud(now).message.unwrap_or_default();
        fly(&mut c, &mut now, 80);
        assert!(told(&mut c, now).contains("there is no image to show"));
        now += FAULT_MESSAGE;
        c.hud(now);
        fly(&mut c, &mut now, 1);
        now += Duration::from_secs(1);
        // It stays on display, and wakes nothing.
        assert!(told(&mut c, now).contains("there is no image to show"));
        assert!(c.rests() && c.next().is_none(), "{:?}", c.next());
        assert_eq!((fly(&mut c, &mut now, 20), c.next()), (0, None));
        // Another message takes its place for a moment.
        c.say("a word", now);
        assert_eq!(told(&mut c, now), "a word");
    }
}

#[test]
fn a_slow_machine_flies_slower_and_does_not_fall_behind() {
    let (mut c, now) = (controller("tentacles"), Instant::now());
    c.advance(now).unwrap();
    assert_eq!(c.flight().clock().tick, 0, "no time has gone by");
    c.advance(now + Duration::from_millis(50)).unwrap();
    assert_eq!(c.flight().clock().tick, 6);
    c.advance(now + Duration::from_secs(60)).unwrap();
    assert_eq!(c.flight().clock().tick, 6 + u64::from(STEPS));
}

#[test]
fn aided_flight_starts_by_itself_and_stops_for_the_operator() {
    let (mut c, mut now) = (controller("tentacles"), Instant::now());
    let start = c.flight().pose().position;
    fly(&mut c, &mut now, 40);
    assert!(c.flight().pose().position.distance(start) > 2.0);
    assert_eq!(c.hud(now).state, "flying");
    perform(&mut c, "pause", now);
    fly(&mut c, &mut now, 150);
    assert!(c.rests());
    assert_eq!(c.hud(now).state, "paused");
    // Operator input overrides the pause, and never passes through the wall.
    c.steer(|h| h.press(Hold::Forward), now);
    fly(&mut c, &mut now, 250);
    let at = c.flight().pose().position;
    assert!(at.cmpge(DVec3::splat(5.0)).all() && at.y <= 76.0, "{at}");
    assert!(c.flight().camera::<crate::components::camera::Contact>().unwrap().clearance_mm >= 1.5 - 1e-6);
    c.steer(HeldKeys::let_go, now);
    fly(&mut c, &mut now, 150);
    assert!(c.rests());
}

#[test]
fn what_there_is_not_is_said_and_changes_nothing() {
    let (mut c, mut now) = (controller("tentacles"), Instant::now());
    fly(&mut c, &mut now, 2);
    let pose = c.flight().pose();
    perform(&mut c, "other-end", now);
    assert!(c.hud(now).message.is_some_and(|m| m.contains("other end")));
    assert_eq!(c.flight().pose(), pose);
    perform(&mut c, "detail", now);
    assert_eq!(c.hud(now).message.as_deref(), Some("detail: low"));
    for _ in 0..60 {
        perform(&mut c, "faster", now);
    }
    fly(&mut c, &mut now, 2);
    assert_eq!(c.hand().speed, 5.0, "there is a limit");
}

#[test]
fn messages_name_the_keys_that_settings_have_changed() {
    let now = Instant::now();
    let settings = [
        ("usual-angle", "Α"),
        ("reverse", "Β"),
        ("next", "Γ"),
        ("unseen", "Δ"),
        ("panel-candidates", "Ε"),
        ("help", "Ζ"),
        ("guide", "Η"),
    ];
    let settings = settings.map(|(id, key)| (id.to_owned(), vec![key.to_owned()])).into_iter().collect();
    let mut c = cockpit_with(flight("path"), 20.0, Vec::new(), &settings);
    c.zoom(1.0);
    c.advance(now).unwrap();
    let message = |c: &mut FlightController| c.hud(now).message.unwrap_or_default();
    assert!(message(&mut c).ends_with(" (Α sets it back)"), "{}", message(&mut c));
    perform(&mut c, "missed-next", now);
    assert!(message(&mut c).ends_with("coverage is off (Δ begins)"), "{}", message(&mut c));
    perform(&mut c, "candidate-next", now);
    assert!(message(&mut c).ends_with("no list of candidates (Ε looks for polyps)"), "{}", message(&mut c));
    c.flight_mut().camera_mut::<Flight>().unwrap().state = State::Operator;
    let hud = c.hud(now);
    assert_eq!(hud.more.last().unwrap(), "Steer by hand, Β turns round, Γ flies to the next segment.");
    assert!(hud.keys.starts_with("Ζ keys   Space pause"), "{}", hud.keys);
}

#[test]
fn it_flies_back_only_where_there_is_a_way_back() {
    let (far, now) = (DVec3::new(-500.0, 8.0, 16.0), Instant::now());
    let mut c = cockpit_of(flight_from("path", far), 20.0, Vec::new());
    let goal = c.flight().setup().plan.goal().at;
    perform(&mut c, "reverse", now);
    assert!(c.hud(now).message.is_some_and(|m| m != "flying back"));
    assert_eq!((c.flight().setup().plan.goal().at, along_mm(&c)), (goal, 20));
    let mut c = cockpit_of(flight("path"), 20.0, Vec::new());
    perform(&mut c, "reverse", now);
    assert_eq!(c.hud(now).message.as_deref(), Some("flying back"));
    assert_ne!((c.flight().setup().plan.goal().at, along_mm(&c)), (goal, 20));
}

#[test]
fn a_screenshot_is_what_is_shown_or_what_was_seen() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    fly(&mut c, &mut now, 60);
    while c.view_renderer.is_refining(&c.flight) {
        fly(&mut c, &mut now, 1);
    }
    c.view_renderer.order_to_save(&c.flight, WINDOW);
    let saved = c.view_renderer.take_to_save();
    assert!(saved.len() == 1 && Some(&saved[0].frame) == c.image());
    // A camera that has moved on before its image was good enough.
    let start = c.flight().pose();
    let look_from = |c: &mut FlightController, mm: f64| {
        assert!(c.flight.place(start.position + DVec3::Y * mm, start.attitude.forward, start.attitude.up));
        assert!(trace(c, now));
        c.flight().pose()
    };
    let pose = look_from(&mut c, 1.0);
    c.view_renderer.order_to_save(&c.flight, WINDOW);
    look_from(&mut c, 2.0);
    let saved = c.view_renderer.all_to_save();
    assert_eq!(saved.len(), 1);
    assert_eq!((saved[0].request.pose, saved[0].frame.size()), (pose, WINDOW));
}

#[test]
fn another_view_angle_is_another_picture() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    let still = |c: &mut FlightController, now: &mut Instant| {
        fly(c, now, 60);
        while c.view_renderer.is_refining(&c.flight) {
            fly(c, now, 1);
        }
        c.image().unwrap().clone()
    };
    let angle = |c: &FlightController| c.flight().camera::<Picture>().unwrap().fov_degrees;
    let usual = still(&mut c, &mut now);
    assert_eq!(fly(&mut c, &mut now, 5), 0);
    perform(&mut c, "narrower", now);
    c.zoom(1.0);
    assert!(fly(&mut c, &mut now, 2) > 0, "it is traced again");
    assert_eq!(angle(&c), 74.4);
    assert!(c.hud(now).message.is_some_and(|m| m.contains("74.4°")));
    let narrow = still(&mut c, &mut now);
    assert!(narrow != usual);
    now += Duration::from_secs(1);
    assert!(c.hud(now).figures.iter().any(|f| f.ends_with("view 74.4°")), "{:?}", c.hud(now).figures);
    // A screenshot that still waits for a better picture keeps the angle that was seen.
    perform(&mut c, "wider", now);
    fly(&mut c, &mut now, 1);
    assert!(c.view_renderer.is_refining(&c.flight));
    c.view_renderer.order_to_save(&c.flight, WINDOW);
    c.act(FlightCommand::ViewAngle(90.0), now);
    assert!(trace(&mut c, now));
    let saved = c.view_renderer.all_to_save();
    assert_eq!((saved.len(), saved[0].request.fov_degrees, angle(&c)), (1, 81.8, 90.0));
    assert!(still(&mut c, &mut now) == usual, "as many notches back are the angle of before");
    // The limits, and back.
    c.zoom(1e3);
    fly(&mut c, &mut now, 1);
    assert_eq!(angle(&c), 1.0);
    c.zoom(-1e3);
    fly(&mut c, &mut now, 1);
    assert_eq!(angle(&c), 170.0);
    perform(&mut c, "usual-angle", now);
    assert_eq!(angle(&c), 90.0);
}

#[test]
fn a_key_shows_the_flight_through_a_fisheye_and_back() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    let camera = |c: &FlightController| {
        let picture = c.flight().camera::<Picture>().unwrap();
        (picture.camera.name, picture.fov_degrees)
    };
    fly(&mut c, &mut now, 2);
    perform(&mut c, "wide-view", now);
    assert_eq!(camera(&c), ("fisheye", 180.0));
    assert!(c.hud(now).message.is_some_and(|m| m.contains("fisheye camera, 180°")));
    assert!(fly(&mut c, &mut now, 2) > 0, "it is traced again");
    let behind = |c: &FlightController| {
        let view = c.flight().camera::<Picture>().unwrap().view.clone().unwrap();
        view.project(view.position() + view.right() - view.forward() * 0.1).is_some()
    };
    assert!(behind(&c), "overlays find what is beside the camera");
    // The limits, and back to the angle that it began with.
    for (notches, angle) in [(1e3, 120.0), (-1e3, 220.0)] {
        c.zoom(notches);
        fly(&mut c, &mut now, 1);
        assert_eq!(camera(&c), ("fisheye", angle));
    }
    perform(&mut c, "usual-angle", now);
    assert_eq!(camera(&c), ("fisheye", 180.0));
    perform(&mut c, "wide-view", now);
    assert_eq!(camera(&c), ("perspective", 90.0));
    fly(&mut c, &mut now, 2);
    assert!(!behind(&c));
    // A panorama does not fit into a window.
    c.act(FlightCommand::Camera { model: "panorama".to_owned(), fov_degrees: 90.0 }, now);
    assert_eq!(camera(&c), ("perspective", 90.0));
}

#[test]
fn keys_and_mouse_roll_the_view() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    let before = c.flight().pose().attitude;
    let rolled = |c: &FlightController| {
        let now = c.flight().pose().attitude;
        assert!(now.forward.distance(before.forward) < 1e-6);
        before.up.cross(now.up).dot(before.forward).atan2(before.up.dot(now.up)).to_degrees()
    };
    // A drag over the window's shorter side is half a turn.
    c.roll(WINDOW.height as f64 / 6.0, WINDOW);
    assert!(fly(&mut c, &mut now, 2) > 0);
    assert!((rolled(&c) - 30.0).abs() < 1e-6, "{}", rolled(&c));
    c.steer(|h| h.press(Hold::RollLeft), now);
    fly(&mut c, &mut now, 50);
    c.steer(HeldKeys::let_go, now);
    fly(&mut c, &mut now, 100);
    assert!(rolled(&c) < -20.0, "a second counter-clockwise: {}", rolled(&c));
    assert!(c.rests());
}

/// Neither drawn nor computed until its key is pressed.
#[test]
fn an_overlay_costs_nothing_while_it_is_hidden() {
    use std::sync::atomic::{AtomicUsize, Ordering};
    static DRAWN: AtomicUsize = AtomicUsize::new(0);
    let counted = Overlay {
        name: "counted",
        summary: "",
        key: Some('z'),
        shown: false,
        draw: |_, canvas| {
            DRAWN.fetch_add(1, Ordering::Relaxed);
            canvas.disc([4.0, 4.0], 2.0 * canvas.scale(), [1, 2, 3]);
        },
        ..Overlay::PLAIN
    };
    let now = Instant::now();
    let mut c = cockpit_of(flight("tentacles"), 0.0, vec![counted]);
    assert!(c.hud(now).marks_drawn.is_empty() && DRAWN.load(Ordering::Relaxed) == 0);
    c.scaled(2.0);
    perform(&mut c, "overlay-counted", now);
    let disc = crate::app::overlay::Mark::Disc { centre: [4.0; 2], radius: 4.0, colour: [1, 2, 3] };
    assert_eq!(c.hud(now).marks_drawn, [disc]);
    perform(&mut c, "overlay-counted", now);
    assert!(c.hud(now).marks_drawn.is_empty() && DRAWN.load(Ordering::Relaxed) == 1);
}

/// A guide that panics.
#[derive(Clone, Debug, Default, serde::Deserialize)]
struct Panicking {}

impl crate::schedule::Guide for Panicking {
    const NAME: &'static str = "panicking";
    const SUMMARY: &'static str = "panics";

    fn cruise_mm_s(&self, _: &crate::dynamics::Body) -> f64 {
        30.0
    }

    fn plug(&self, app: &mut crate::schedule::App) -> Result<()> {
        let panics = || panic!("guided badly");
        app.add_systems(crate::schedule::FlightSystems::Guide, panics);
        Ok(())
    }
}

/// A renderer that panics.
struct Unfinished;

impl crate::render::Renderer for Unfinished {
    fn render(&mut self, _: &crate::render::View, _: &mut Frame) -> crate::render::Work {
        panic!("rendered badly")
    }

    fn parts(&self) -> Vec<(crate::render::MemoryPart, usize)> {
        Vec::new()
    }
}

/// The window reports what has panicked and survives: with manual steering and the default renderer's pictures.
#[test]
fn a_window_outlives_what_is_plugged_into_it() {
    use crate::schedule::{App, FlightSystems};
    let other_end = DVec3::new(16.0, 8.0, 16.0);
    let panics = |app: &mut App| {
        app.add_systems(FlightSystems::Trail, || panic!("stepped badly"));
        Ok(())
    };
    let paints = |app: &mut App| {
        app.add_systems(FlightSystems::PostProcess, || panic!("painted badly"));
        Ok(())
    };
    let unfinished = Preset { name: "unfinished", make: |_, _, _| Box::new(Unfinished), ..Preset::default() };
    let draws = Overlay { name: "smudge", shown: true, draw: |_, _| panic!("drawn badly"), ..Overlay::PLAIN };
    type Change<'a> = Box<dyn FnOnce(&mut Scene) + 'a>;
    let cases: [(&str, &str, Change<'_>, Vec<Overlay>); 5] = [
        ("plug-in panics", "stepped badly", Box::new(|s| s.plugins.add(("panics", panics)).unwrap()), Vec::new()),
        ("plug-in paints", "painted badly", Box::new(|s| s.plugins.add(("paints", paints)).unwrap()), Vec::new()),
        (
            "plug-in panicking",
            "guided badly",
            Box::new(|s| {
                s.guides.set(Panicking {});
                s.steering = crate::app::Steering::Guide("panicking");
            }),
            Vec::new(),
        ),
        ("preset unfinished", "rendered badly", Box::new(|s| s.image.preset = unfinished), Vec::new()),
        ("overlay smudge", "drawn badly", Box::new(|_| {}), vec![draws]),
    ];
    for (who, why, change, overlays) in cases {
        let flight = flight_with("tentacles", other_end, change);
        let mut c = cockpit_of(flight, 0.0, overlays);
        let mut now = Instant::now();
        let mut reported = String::new();
        for _ in 0..10 {
            fly(&mut c, &mut now, 1);
            reported += &c.hud(now).message.unwrap_or_default();
        }
        assert!(reported.contains(who) && reported.contains(why), "{who}: {reported}");
        // The flight continues: pictures are rendered, and operator input moves the camera.
        let at = c.flight().pose().position;
        c.steer(|hands| hands.press(Hold::Forward), now);
        assert!(fly(&mut c, &mut now, 40) > 30, "{who}");
        c.steer(HeldKeys::let_go, now);
        assert!(c.flight().pose().position.distance(at) > 5.0, "{who}");
        assert!(c.image().unwrap().pixels().iter().any(|p| p[0] > 60), "{who}");
        let by_hand = who == "plug-in panicking";
        assert_eq!(c.flight().setup().scene.guide_name(), if by_hand { "manual" } else { "tentacles" });
    }
}

#[test]
fn a_slow_plugin_is_among_the_figures() {
    let sleeps = |app: &mut crate::schedule::App| {
        app.add_systems(crate::schedule::FlightSystems::Log, || std::thread::sleep(Duration::from_millis(3)));
        Ok(())
    };
    let other_end = DVec3::new(16.0, 8.0, 16.0);
    let flight = flight_with("tentacles", other_end, |s| s.plugins.add(("sleeper", sleeps)).unwrap());
    let mut c = cockpit_of(flight, 0.0, Vec::new());
    let mut now = Instant::now();
    fly(&mut c, &mut now, 20);
    let figures = c.hud(now + Duration::from_secs(1)).figures;
    assert!(figures.iter().any(|f| f.starts_with("plug-in sleeper takes ")), "{figures:?}");
}

/// The slices of a reading layout, in the size of these tests.
const SLICES: [(Orientation, [usize; 2]); 2] = [(Orientation::Axial, [64, 64]), (Orientation::Across, [64, 64])];

/// Renders a picture with slices beside it.
fn trace_with_slices(c: &mut FlightController, now: Instant) {
    let due = c.prepare(WINDOW, &SLICES, now).unwrap();
    c.show(due).unwrap();
}

#[test]
fn a_click_in_a_slice_stops_the_flight_and_takes_the_camera_along_where_it_fits() {
    let (mut c, mut now) = (controller("tentacles"), Instant::now());
    c.flight_mut().commands.start();
    fly(&mut c, &mut now, 10);
    trace_with_slices(&mut c, now);
    let view = c.slices().view(c.flight(), Orientation::Axial).unwrap();
    assert_eq!(view.size, [64, 64]);
    let at = |c: &FlightController| c.flight().pose().position;
    let (start, gas, tissue) = (at(&c), DVec3::new(17.0, 40.0, 15.0), DVec3::new(2.0, 40.0, 16.0));
    c.slice(SliceInput::Click(tissue), now);
    assert_eq!((at(&c), c.slices().cursor()), (start, Some(tissue)));
    fly(&mut c, &mut now, 5);
    assert_eq!(c.hud(now).state, "paused");
    c.slice(SliceInput::Click(gas), now);
    assert_eq!((at(&c), c.slices().cursor()), (gas, Some(gas)));
    trace_with_slices(&mut c, now);
    let through = c.slices().view(c.flight(), Orientation::Across).unwrap().shown().unwrap();
    assert!(through.pixel(gas).1.abs() < 1e-9, "the slices go through it");
    // The flight continues, and the slices follow.
    perform(&mut c, "pause", now);
    assert_eq!(c.slices().cursor(), None);
    fly(&mut c, &mut now, 20);
    assert!(at(&c).y > gas.y + 1.0);
    // Operator commands are recorded like any other command.
    let commands = serde_json::to_string(c.flight().commands.recorded()).unwrap();
    assert!(commands.contains("\"go\""), "{commands}");
    assert_eq!(
        serde_json::from_str::<Vec<crate::components::input::TimedCommand>>(&commands).unwrap(),
        c.flight().commands.recorded()
    );
}

#[test]
fn distances_are_measured_on_the_wall_and_in_slices() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    fly(&mut c, &mut now, 2);
    trace(&mut c, now);
    perform(&mut c, "measure", now);
    let at = ActionContext { window: WINDOW, now };
    let middle = WINDOW.height as f64 / 2.0;
    c.execute(Intent::Click([4.0, middle]), at);
    assert!(c.measures().begun().is_some());
    c.execute(Intent::Click([WINDOW.width as f64 - 4.0, middle]), at);
    let made = c.measures().list()[0];
    assert!((made.mm() - 20.0).abs() < 0.6, "from wall to wall of a tube of 20 mm: {}", made.text());
    // The camera is half a millimetre off the middle.
    assert!((made.from.y - made.to.y).abs() < 1.5 && made.from.x < made.to.x);
    // Mixed: from the wall to a point of a slice.
    c.execute(Intent::Click([4.0, middle]), at);
    c.slice(SliceInput::Click(made.from + DVec3::Y * 3.0), now);
    assert!((c.measures().list()[1].mm() - 3.0).abs() < 1e-6);
    perform(&mut c, "undo", now);
    perform(&mut c, "delete-last", now);
    assert!(c.measures().list().is_empty());
    perform(&mut c, "undo", now);
    assert_eq!(c.measures().list(), [made]);
}

#[test]
fn a_double_click_flies_to_what_it_looks_at() {
    let (mut c, mut now) = (controller("tentacles"), Instant::now());
    fly(&mut c, &mut now, 2);
    trace(&mut c, now);
    c.execute(Intent::LookAt([70.0, 36.0]), ActionContext { window: WINDOW, now });
    let place = c.slices().cursor().unwrap();
    fly(&mut c, &mut now, 60);
    let pose = c.flight().pose();
    let direction = place - pose.position;
    assert!(direction.normalize().dot(pose.attitude.forward) > 0.999, "it looks at it");
    assert!((5.0..30.0).contains(&direction.length()), "{} mm", direction.length());
    assert_eq!(c.hud(now).state, "paused");
}

#[test]
fn what_was_said_goes_away_while_the_flight_rests() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    fly(&mut c, &mut now, 60);
    c.say("here", now);
    assert_eq!(c.hud(now).message.as_deref(), Some("here"));
    assert!(c.hud(now + MESSAGE * 2).message.is_none());
}

#[test]
fn a_hidden_flight_is_not_made_better_and_not_saved() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    fly(&mut c, &mut now, 60);
    perform(&mut c, "light", now);
    assert!(c.next().is_some_and(|t| t <= now), "another light is another picture");
    c.hud(now);
    let due = c.prepare(ImageSize::new(0, 0), &SLICES, now).unwrap();
    c.show(due).unwrap();
    now += MESSAGE * 2;
    c.hud(now);
    assert!(
        c.prepare(ImageSize::new(0, 0), &SLICES, now).unwrap().is_none(),
        "the slices are drawn, and the flight is not seen"
    );
    let rests = |t: Instant| t > now;
    assert!(c.next().is_none_or(rests), "nothing is due");
    c.take_screenshot(ActionContext { window: ImageSize::new(0, 0), now });
    assert_eq!(c.hud(now).message.as_deref(), Some("the flight is not shown"));
}

#[test]
fn every_picture_that_was_ordered_is_saved() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    let folder = tempfile::tempdir().unwrap();
    c.set_screenshots(Some(folder.path().to_owned()));
    trace(&mut c, now);
    let saved = || std::fs::read_dir(folder.path()).unwrap().count();
    // Both before the picture is complete.
    for _ in 0..2 {
        c.take_screenshot(ActionContext { window: WINDOW, now });
    }
    assert_eq!(saved(), 0);
    for _ in 0..200 {
        now += FRAME;
        c.advance(now).unwrap();
        trace(&mut c, now);
    }
    c.save_the_rest();
    assert_eq!(saved(), 2);
}

#[test]
fn nothing_goes_on_after_an_arrival() {
    let (mut c, mut now) = (controller("path"), Instant::now());
    fly(&mut c, &mut now, 2);
    perform(&mut c, "pause", now);
    fly(&mut c, &mut now, 2);
    assert!(c.is_on(&Intent::Pause));
    c.flight.camera_mut::<Flight>().unwrap().state = State::Arrived;
    assert_eq!((c.is_on(&Intent::Pause), c.hud(now).state.as_str()), (false, "arrived"));
}

#[test]
fn slices_are_scrolled_by_every_notch_and_by_parts_of_one() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    fly(&mut c, &mut now, 2);
    trace_with_slices(&mut c, now);
    let layer = |c: &FlightController| c.slices().cursor().map(|p| p.z.round());
    let from = c.flight().pose().position.z.round();
    for _ in 0..3 {
        c.slice(SliceInput::Scroll(Orientation::Axial, 1.0), now);
    }
    assert_eq!(layer(&c), Some(from - 3.0), "towards who looks from below");
    for _ in 0..8 {
        c.slice(SliceInput::Scroll(Orientation::Axial, -0.25), now);
    }
    assert_eq!(layer(&c), Some(from - 1.0));
}

#[test]
fn a_screenshot_that_waits_for_a_finer_picture_is_saved_at_the_end() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    fly(&mut c, &mut now, 1);
    assert!(c.view_renderer.is_refining(&c.flight));
    let pose = c.flight().pose();
    c.view_renderer.order_to_save(&c.flight, WINDOW);
    assert!(c.view_renderer.take_to_save().is_empty(), "it may become better");
    let saved = c.view_renderer.all_to_save();
    assert_eq!(saved.len(), 1);
    assert_eq!((saved[0].request.pose, saved[0].frame.size()), (pose, WINDOW));
    assert!(c.view_renderer.all_to_save().is_empty(), "once");
}

#[test]
fn another_detail_keeps_the_light() {
    let (mut c, now) = (controller("manual"), Instant::now());
    let settings = |c: &FlightController| c.flight().camera::<Picture>().unwrap().settings;
    for action in ["detail", "light", "detail", "detail", "light", "detail"] {
        let before = settings(&c);
        perform(&mut c, action, now);
        let after = settings(&c);
        assert_eq!(before.light != after.light, action == "light", "{action}");
        assert_eq!(before.quality != after.quality, action == "detail", "{action}");
        assert_eq!((before.adaptive, before.options), (after.adaptive, after.options), "{action}");
    }
}

#[test]
fn the_view_angle_that_is_told_is_the_one_that_is_shown() {
    let (mut c, mut now) = (controller("manual"), Instant::now());
    c.zoom(-1e3);
    fly(&mut c, &mut now, 1);
    assert_eq!(c.hud(now).message.as_deref(), Some("view angle 170° (0 sets it back)"));
    c.zoom(1e3);
    fly(&mut c, &mut now, 1);
    assert_eq!(c.hud(now).message.as_deref(), Some("view angle 1° (0 sets it back)"));
    perform(&mut c, "usual-angle", now);
    assert_eq!(c.hud(now).message.as_deref(), Some("view angle 90°"));
    // Without a picture there is no angle.
    let other_end = DVec3::new(16.0, 8.0, 16.0);
    let mut c = cockpit_of(flight_with("manual", other_end, |s| s.picture = false), 0.0, Vec::new());
    c.zoom(1.0);
    c.advance(now).unwrap();
    assert!(c.message.is_none(), "{:?}", c.message);
}

#[test]
fn the_guide_that_was_chosen_last_steers() {
    let (mut c, mut now) = (controller("tentacles"), Instant::now());
    let guide = |c: &FlightController| c.flight().setup().scene.guide_name();
    c.hand_over("path", now);
    assert!(c.planning.is_working() && c.hud(now).message.is_some_and(|m| m.contains("preparing the guide path")));
    c.hand_over("manual", now);
    // What is prepared for the first one is of no use any more.
    assert!(!c.planning.is_working());
    fly(&mut c, &mut now, 3);
    assert_eq!(guide(&c), "manual");
    c.hand_over("path", now);
    while c.planning.is_working() {
        std::thread::sleep(Duration::from_millis(1));
        fly(&mut c, &mut now, 1);
    }
    assert_eq!(guide(&c), "path");
}

#[test]
fn a_drag_turns_the_view_to_the_right_and_downwards() {
    let before = controller("manual").flight().pose().attitude;
    let looks_after = |drag: (f64, f64)| {
        let (mut c, mut now) = (controller("manual"), Instant::now());
        c.drag(drag, WINDOW);
        fly(&mut c, &mut now, 2);
        let forward = c.flight().pose().attitude.forward;
        [forward.dot(before.right()), forward.dot(before.up)].map(|sine| sine.asin().to_degrees())
    };
    // The shorter side of 72 pixels is the view angle of 90°.
    for (drag, [right, up]) in [((8.0, 0.0), [10.0, 0.0]), ((0.0, 8.0), [0.0, -10.0]), ((0.0, -4.0), [0.0, 5.0])] {
        let looks = looks_after(drag);
        assert!((looks[0] - right).abs() < 0.1 && (looks[1] - up).abs() < 0.1, "{drag:?}: {looks:?}");
    }
}
