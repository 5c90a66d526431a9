//! Misbehaving plug-ins: invalid numbers, wrong sizes, panics. Whatever they do, the flight ends in order,
//! recorded data is preserved, and the plug-in is named.

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use bevy_ecs::prelude::*;
use colvis::app::{FlightApp, ImageSettings, Overlay, Plan, Scene};
use colvis::components::camera::{Heading, Pose, Velocity};
use colvis::components::flight::State;
use colvis::components::guide::GuideThrust;
use colvis::components::input::HandCommand;
use colvis::components::output::{LogLine, Picture};
use colvis::dynamics::Body;
use colvis::error::{Kind, Result};
use colvis::fields::{Lumen, lumen};
use colvis::host::headless::{self, Outputs};
use colvis::progress::Progress;
use colvis::render::camera::{Camera, CameraModel, CameraRay, Origins};
use colvis::render::presets::{self, standard};
use colvis::render::{
    Frame, MemoryPart, Options, PreparedVolume, Preset, Quality, Renderer, Settings, Shader, ShaderModel, SurfacePoint,
    TransferFunction, View, Work,
};
use colvis::schedule::{App, FlightSystems, Guide, Main};
use colvis::systems::present::Presenter;
use colvis::volume::{Grid, Volume};
use glam::{DMat3, DVec2, DVec3, Vec3};

use crate::support::checks::cases;

/// Time limit for a flight of a third of a second, whatever a plug-in does.
const PATIENCE: Duration = Duration::from_secs(60);
const SECONDS: f64 = 0.3;

/// Numbers that make no sense.
const ODD: [f64; 8] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0, 1e300, -1e300, 1e-310];

/// Creates a square tube of 20 mm along y, and its lumen.
pub(crate) fn tube() -> (PreparedVolume, Arc<Lumen>) {
    static TUBE: OnceLock<(PreparedVolume, Arc<Lumen>)> = OnceLock::new();
    let made = TUBE.get_or_init(|| {
        let grid = Grid::new([32, 80, 32], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let gas = |n: usize| {
            let (i, j, k) = (n % 32, n / 32 % 80, n / (32 * 80));
            (6..26).contains(&i) && (4..76).contains(&j) && (6..26).contains(&k)
        };
        let data = (0..32 * 80 * 32).map(|n| if gas(n) { -1000 } else { 40 }).collect();
        let volume = Arc::new(Volume::new(grid, data));
        let lumen = Arc::new(lumen::find(&volume, &Progress::new()).unwrap());
        (PreparedVolume::new(volume, TransferFunction::default()), lumen)
    });
    made.clone()
}

pub(crate) fn set_out(scene: Scene) -> Result<FlightApp> {
    let [start, goal, end] = [14.0, 70.0, 8.0].map(|y| DVec3::new(16.0, y, 16.0));
    let mut plan = Plan { begin: end, ..Plan::between(start, goal, 60.0) };
    plan.ends[0].at = end;
    let (volume, lumen) = tube();
    FlightApp::new(volume, lumen, plan, scene)
}

/// The outcome of a flight.
pub(crate) struct Outcome {
    pub said: String,
    pub kind: Option<Kind>,
    pub lines: usize,
    /// The state in the last log line.
    pub last: Option<State>,
    pub images: usize,
}

/// Runs `work` within [`PATIENCE`], or fails with its name.
fn in_time<T: Send + 'static>(name: &str, work: impl FnOnce() -> T + Send + 'static) -> T {
    let (done, wait) = channel();
    let worker = std::thread::spawn(move || done.send(work()));
    match wait.recv_timeout(PATIENCE) {
        Ok(made) => made,
        Err(_) if worker.is_finished() => panic!("{name}: a panic came through"),
        Err(_) => panic!("{name}: it hangs"),
    }
}

/// Flies a scene, with a log and a recording.
pub(crate) fn fly(scene: Scene, overlays: &[Overlay]) -> Outcome {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("f.jsonl");
    let (mut said, mut kind);
    match set_out(Scene { log: true, ..scene }) {
        Ok(mut flight) => {
            let record = Some(format!("{}/images/", dir.path().display()));
            let overlays = overlays.to_vec();
            let outputs = Outputs { record, fps: 10.0, log: Some(log.clone()), overlays, ..Outputs::default() };
            let (_, flown) = headless::fly(&mut flight, SECONDS, &outputs, &Arc::new(Progress::new()));
            (said, kind) = (flight.take_notes().join("\n"), None);
            if let Err(e) = flown {
                said = format!("{said}\n{e}");
                kind = Some(e.kind);
            }
        }
        Err(e) => (said, kind) = (e.to_string(), Some(e.kind)),
    }
    // Every line present is complete.
    let text = std::fs::read_to_string(&log).unwrap_or_default();
    let lines: Vec<LogLine> = text.lines().map(|l| serde_json::from_str(l).expect("a whole line")).collect();
    let images = images(&dir.path().join("images"));
    Outcome { said, kind, last: lines.last().map(|l| l.state), lines: lines.len(), images }
}

/// Returns the number of pictures in a folder, and checks that all have the requested size.
fn images(folder: &Path) -> usize {
    let Ok(files) = std::fs::read_dir(folder) else { return 0 };
    files.map(|f| image::image_dimensions(f.unwrap().path()).unwrap()).filter(|size| *size == (32, 24)).count()
}

/// Returns image settings for every preset at every quality.
pub(crate) fn images_by_all() -> Vec<ImageSettings> {
    let mut all = Vec::new();
    for preset in presets::BUILT_IN {
        for (quality, adaptive) in
            [(Quality::High, false), (Quality::Low, false), (Quality::High, true), (Quality::Reference, false)]
        {
            let settings = Settings { adaptive, ..Settings::new(quality) };
            all.push(ImageSettings { width: 32, height: 24, settings, preset, ..ImageSettings::default() });
        }
    }
    all
}

pub(crate) fn recorded(image: ImageSettings) -> Scene {
    Scene { picture: true, presented: true, operator: true, image, ..Scene::default() }
}

/// A guide that misbehaves.
#[derive(Component, Clone, Debug, Default, serde::Deserialize)]
struct Bad {
    /// 0 thrust, 1 wall force, 2 direction, 3 limit, 4 panics in its system, 5 panics when it is plugged in.
    what: usize,
    number: f64,
}

impl Guide for Bad {
    const NAME: &'static str = "bad guide";
    const SUMMARY: &'static str = "misbehaves";

    fn cruise_mm_s(&self, _: &Body) -> f64 {
        self.number
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        assert!(self.what != 5, "plugged badly");
        app.equip(self.clone());
        app.add_systems(FlightSystems::Guide, misguide);
        Ok(())
    }
}

fn misguide(camera: Single<(&Bad, &mut GuideThrust)>) {
    let (bad, mut guide) = camera.into_inner();
    let fine = DVec3::Y * 100.0;
    *guide = GuideThrust { thrust: fine, limit: 150.0, look_direction: DVec3::Y, ..GuideThrust::default() };
    let odd = DVec3::new(0.0, bad.number, bad.number);
    match bad.what {
        0 => guide.thrust = odd,
        1 => guide.wall = odd,
        2 => guide.look_direction = odd,
        3 => guide.limit = bad.number,
        _ => panic!("guided badly"),
    }
}

#[test]
fn guides_that_misbehave() {
    for (n, image) in images_by_all().into_iter().enumerate() {
        let mut cases: Vec<Bad> = (4..6).map(|what| Bad { what, number: 1.0 }).collect();
        // A guide's numbers do not affect pictures: test all of them with one renderer, and some with each.
        for what in 0..4 {
            let some = ODD.iter().enumerate().filter(|(k, _)| n == 0 || k % 12 == n % 12);
            cases.extend(some.map(|(_, &number)| Bad { what, number }));
        }
        for bad in cases {
            let (what, number) = (bad.what, bad.number);
            let name = format!("guide {what} {number} {n}");
            let scene = Scene { steering: Scene::steered_by(bad.clone()).steering, ..recorded(image.clone()) };
            let mut scene = Scene { guides: Scene::default().guides, ..scene };
            scene.guides.set(bad);
            let out = in_time(&name, move || fly(scene, &[]));
            match what {
                5 => assert!(out.kind == Some(Kind::Fault) && out.lines == 0, "{name}: {}", out.said),
                4 => {
                    assert!(out.kind == Some(Kind::Fault) && out.said.contains("guided badly"), "{name}: {}", out.said);
                    assert!(out.lines == 1 && out.images == 2, "{name}: {} {}", out.lines, out.images);
                    assert_eq!(out.last, Some(State::Ended), "{name}");
                }
                _ => {
                    assert_eq!((out.kind, out.lines, out.images), (None, 36, 4), "{name}: {}", out.said);
                    let told = out.said.contains("guide bad guide gave");
                    let absurd = if what == 3 {
                        number.is_nan() || number < 0.0
                    } else {
                        !number.is_finite() || number.abs() > 1e7
                    };
                    assert!(told || !absurd || what == 2 && number.is_finite(), "{name}: {}", out.said);
                }
            }
            assert!(out.kind.is_none() || out.said.contains("bad guide"), "{name}: {}", out.said);
        }
    }
}

#[test]
fn the_hand_moves_the_body_whatever_the_guide_says() {
    for what in 0..4 {
        for number in ODD {
            let mut scene = Scene { operator: true, ..Scene::steered_by(Bad { what, number }) };
            scene.watch = None;
            let moved = in_time(&format!("hand {what} {number}"), move || {
                let mut flight = set_out(scene).unwrap();
                let start = flight.pose().position;
                flight.act(HandCommand::Push([0.0, 0.0, 1.0])).unwrap();
                for _ in 0..120 {
                    flight.step().unwrap();
                }
                flight.pose().position.distance(start)
            });
            // A plausible wall force also acts.
            assert!(moved > 15.0 || what == 1 && number.abs() == 1.0, "{what} {number}: {moved:.1} mm");
        }
    }
}

/// A camera with one odd number.
#[derive(Debug, PartialEq)]
struct Odd {
    what: u32,
    number: f64,
}

impl Camera for Odd {
    fn ray(&self, at: DVec2) -> Option<CameraRay> {
        let mut ray = CameraRay { origin: DVec3::ZERO, direction: at.extend(1.0) };
        match self.what {
            0 => ray.direction *= self.number,
            1 => ray.direction.x = self.number,
            2 => ray.origin = DVec3::splat(self.number),
            3 => panic!("no ray"),
            _ => {}
        }
        Some(ray)
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        Some(place.truncate() * if self.what == 4 { self.number } else { 1.0 })
    }

    fn origins(&self) -> Origins {
        if self.what == 2 { Origins::Many } else { Origins::One }
    }

    fn tangent(&self) -> Option<f64> {
        (self.what == 5).then_some(self.number)
    }

    fn most_turn(&self) -> Option<f64> {
        match self.what {
            6 => Some(self.number),
            // A false value: rays turn far more.
            7 => Some(1e-3),
            _ => Some(1.0),
        }
    }
}

/// Models have no state, so their settings select the camera that they make.
#[derive(Default, serde::Deserialize)]
#[serde(default)]
struct Which {
    what: u32,
    number: f64,
}

const ODD_CAMERA: CameraModel = CameraModel {
    name: "odd camera",
    summary: "",
    options: Options::NONE,
    make: |_, _, options| {
        let Which { what, number } = options.read("odd camera")?;
        assert!(what != 8, "no camera");
        Ok(Arc::new(Odd { what, number }))
    },
};

fn which(what: u32, number: f64) -> Options {
    let number = if number.is_nan() { "nan".to_owned() } else { format!("{number:e}").replace("inf", "inf") };
    Options::new(format!("what = {what}\nnumber = {number}").replace("e", ".0e").replace(".0e", "e").parse().unwrap())
}

#[test]
fn cameras_that_misbehave() {
    for (n, image) in images_by_all().into_iter().take(cases(usize::MAX, 1)).enumerate() {
        for what in 0..8 {
            for (k, number) in ODD.into_iter().enumerate().step_by(cases(1, 3)) {
                let once = [3, 7].contains(&what);
                if once && k > 0 || (!once && n > 0 && k % 3 != n % 3) {
                    continue;
                }
                let name = format!("camera {what} {number} {} {n}", image.preset.name);
                let camera = CameraModel { options: which(what, number), ..ODD_CAMERA };
                let scene = recorded(ImageSettings { camera, ..image.clone() });
                let out = in_time(&name, move || fly(scene, &overlays_built_in()));
                if what == 3 {
                    assert!(
                        out.kind == Some(Kind::Fault) && out.said.contains("camera odd camera"),
                        "{name}: {}",
                        out.said
                    );
                } else {
                    assert_eq!((out.kind, out.lines, out.images), (None, 36, 4), "{name}: {}", out.said);
                }
            }
        }
    }
}

fn overlays_built_in() -> Vec<Overlay> {
    colvis::app::overlays::BUILT_IN.to_vec()
}

/// A renderer that misbehaves from the second picture on.
struct Crooked {
    what: u32,
    pictures: u32,
}

impl Renderer for Crooked {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        self.pictures += 1;
        frame.resize(view.width(), view.height());
        if self.pictures > 1 {
            match self.what {
                0 => frame.resize(0, 0),
                1 => frame.resize(view.width() * 3 + 1, 1),
                2 => frame.resize(view.width(), view.height() - 1),
                3 => *frame = Frame::with_depth(7, 900),
                4 => panic!("rendered badly"),
                _ => return Work { rays: u64::MAX, samples: u64::MAX, reused: u64::MAX, misled: u64::MAX },
            }
        }
        Work { rays: 1, ..Work::default() }
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        vec![(MemoryPart::Flags, usize::MAX / 4)]
    }
}

const CROOKED: Preset = Preset {
    name: "crooked",
    check: |_| Ok(()),
    make: |_, settings, _| {
        let what = settings.options.read::<Which>("crooked").map_or(0, |w| w.what);
        assert!(what != 6, "made badly");
        Box::new(Crooked { what, pictures: 0 })
    },
    ..standard::PRESET
};

#[test]
fn renderers_that_misbehave() {
    for (n, image) in images_by_all().into_iter().take(4).enumerate() {
        for what in 0..7 {
            let name = format!("renderer {what} {n}");
            let settings = Settings { options: which(what, 0.0), ..image.settings };
            let scene = recorded(ImageSettings { preset: CROOKED, settings, ..image.clone() });
            let out = in_time(&name, move || fly(scene, &[]));
            let told = out.said.contains("crooked");
            match what {
                0..=3 => {
                    assert_eq!((out.kind, out.lines, out.images), (None, 36, 4), "{name}: {}", out.said);
                    assert!(told, "{name}: {}", out.said);
                }
                4 => {
                    assert!(out.kind == Some(Kind::Fault) && told, "{name}: {}", out.said);
                    assert!(out.said.contains("rendered badly") && out.lines >= 12 && out.images >= 1, "{name}");
                }
                5 => assert_eq!((out.kind, out.images), (None, 4), "{name}: {}", out.said),
                _ => assert!(out.kind == Some(Kind::Fault) && told, "{name}: {}", out.said),
            }
        }
    }
}

#[derive(Debug)]
struct Dim(Which);

impl std::fmt::Debug for Which {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}", self.what, self.number)
    }
}

impl Shader for Dim {
    fn colour(&self, _: &SurfacePoint) -> Vec3 {
        assert!(self.0.what == 0, "shaded badly");
        Vec3::splat(self.0.number as f32)
    }
}

const DIM: ShaderModel = ShaderModel {
    name: "dim shader",
    summary: "",
    options: Options::NONE,
    make: |options| Ok(Arc::new(Dim(options.read("dim shader")?))),
};

#[test]
fn shaders_that_misbehave() {
    for (n, image) in images_by_all().into_iter().enumerate().step_by(cases(1, 4)) {
        for (what, number) in ODD.iter().map(|&x| (0, x)).chain([(1, 0.0)]) {
            let name = format!("shader {what} {number} {n}");
            let shader = ShaderModel { options: which(what, number), ..DIM };
            let settings = Settings { shader, ..image.settings };
            let scene = recorded(ImageSettings { settings, ..image.clone() });
            let out = in_time(&name, move || fly(scene, &[]));
            if what == 1 {
                assert!(
                    out.kind == Some(Kind::Fault) && out.said.contains("shader dim shader"),
                    "{name}: {}",
                    out.said
                );
            } else {
                assert_eq!((out.kind, out.lines, out.images), (None, 36, 4), "{name}: {}", out.said);
            }
        }
    }
}

/// The variant that the next overlay draws.
static DRAWN: AtomicU32 = AtomicU32::new(0);

#[test]
fn overlays_that_misbehave() {
    let draw = |_: &FlightApp, canvas: &mut colvis::app::Canvas| {
        let n = DRAWN.load(Ordering::Relaxed);
        let number = [5000.0, 1e9, f32::NAN, f32::INFINITY, -1.0, 0.0, 1e-40, f32::MAX][n as usize % 8];
        let place = [number, 5.0];
        match n / 8 {
            0 => canvas.label([9.0, 9.0], colvis::app::overlay::Align::Left, number, "large", [255; 3]),
            1 => canvas.label(place, colvis::app::overlay::Align::Centre, 12.0, "far", [255; 3]),
            2 => canvas.stroke([1.0, 1.0], place, number, [255; 3]),
            3 => canvas.circle(place, number, [255; 3]),
            4 => canvas.disc([5.0; 2], number, [255; 3]),
            5 => canvas.panel([0.0; 2], place, [255; 3], number),
            6 => canvas.text([9.0; 2], "long ".repeat(20_000), [255; 3]),
            _ => panic!("drawn badly"),
        }
    };
    let overlay = Overlay { name: "bad overlay", draw, ..Overlay::PLAIN };
    for n in 0..57 {
        DRAWN.store(n, Ordering::Relaxed);
        let name = format!("overlay {n}");
        let scene = recorded(images_by_all().remove(0));
        let out = in_time(&name, move || fly(scene, &[overlay]));
        if n == 56 {
            assert!(out.kind == Some(Kind::Fault) && out.said.contains("overlay bad overlay"), "{name}: {}", out.said);
        } else {
            assert_eq!((out.kind, out.lines, out.images), (None, 36, 4), "{name}: {}", out.said);
        }
    }
}

/// Returns a plug-in with a system that misbehaves after a tenth of a second.
fn misbehave(what: usize, number: f64) -> impl Fn(&mut App) -> Result<()> + Send + Sync + 'static {
    move |app: &mut App| {
        let odd = DVec3::new(number, 0.0, number);
        let set = [FlightSystems::Input, FlightSystems::Sum, FlightSystems::Trail][what % 3];
        match what / 3 {
            0 => app.add_systems(set, move |mut n: Local<u32>| {
                *n += 1;
                assert!(*n < 12, "stepped badly");
            }),
            1 => app.add_systems(FlightSystems::Watch, move |mut v: Single<&mut Velocity, With<Main>>| v.0 = odd),
            2 => app.add_systems(FlightSystems::Log, move |mut p: Single<&mut Pose, With<Main>>| p.position = odd),
            3 => app.add_systems(FlightSystems::Clock, move |mut p: Single<&mut Pose, With<Main>>| {
                p.attitude.forward = odd;
                p.attitude.up = -odd;
            }),
            4 => app.add_systems(FlightSystems::Sense, move |mut h: Single<&mut Heading, With<Main>>| h.0 = odd),
            5 => app.add_systems(FlightSystems::Aim, move |mut p: Single<&mut Picture, With<Main>>| {
                p.fov_degrees = number;
            }),
            6 => app.add_systems(FlightSystems::PostProcess, |mut p: Single<&mut Picture, With<Main>>| {
                p.frame.resize(0, 0);
            }),
            7 => app.add_systems(FlightSystems::PostProcess, |_: Single<&Picture, With<Main>>| panic!("stepped badly")),
            8 => app.add_systems(FlightSystems::Log, |mut commands: Commands| {
                commands.queue(|_: &mut World| panic!("stepped badly"));
            }),
            9 => app.add_systems(FlightSystems::Trail, |world: &mut World| {
                let camera = world.query_filtered::<Entity, With<Main>>().iter(world).last().unwrap();
                world.despawn(camera);
            }),
            _ => panic!("stepped badly"),
        };
        Ok(())
    }
}

#[test]
fn systems_that_misbehave() {
    for (n, image) in images_by_all().into_iter().take(cases(usize::MAX, 1)).enumerate() {
        for what in 0..31 {
            for (k, number) in ODD.into_iter().enumerate().step_by(cases(1, 3)) {
                let numbers = (3..18).contains(&what) && what % 3 == 0;
                if (!numbers && k > 0) || (3..18).contains(&what) && what % 3 != 0 || n > 0 && numbers && k % 8 != n % 8
                {
                    continue;
                }
                let name = format!("system {what} {number} {n}");
                let scene = recorded(image.clone()).plug(("bad plug-in", misbehave(what, number))).unwrap();
                let out = in_time(&name, move || fly(scene, &[]));
                let panics = what < 3 || (21..27).contains(&what) || what == 30;
                if panics {
                    assert!(out.kind == Some(Kind::Fault) && out.said.contains("bad plug-in"), "{name}: {}", out.said);
                    assert!(out.said.contains("stepped badly"), "{name}: {}", out.said);
                }
                if what == 18 {
                    assert!(out.kind.is_none() && out.images == 4, "{name}: {}", out.said);
                    assert!(
                        out.said.contains("hostile") && out.said.contains("keeps its size"),
                        "{name}: {}",
                        out.said
                    );
                }
                if what < 3 {
                    assert!(out.lines == 12 && out.images >= 2, "{name}: {} {}", out.lines, out.images);
                }
            }
        }
    }
}

#[test]
fn a_camera_that_a_plugin_loses_is_found_again() {
    for number in [f64::NAN, f64::INFINITY, 1e300] {
        let scene = recorded(images_by_all().remove(0)).plug(("bad plug-in", misbehave(6, number))).unwrap();
        let mut flight = set_out(scene).unwrap();
        for _ in 0..12 {
            flight.step().unwrap();
        }
        assert!(flight.pose().position.is_finite() && flight.pose().position.length() < 1e3);
        let notes = flight.take_notes().join("\n");
        assert!(notes.contains("hostile") && notes.contains("invalid position"), "{notes}");
    }
}

struct Deaf;

impl Presenter for Deaf {
    fn name(&self) -> &'static str {
        "deaf"
    }

    fn present(&mut self, _: &Picture) {
        panic!("presented badly");
    }
}

#[test]
fn a_presenter_that_panics_is_told_by_its_name_and_not_asked_again() {
    let mut flight = set_out(recorded(images_by_all().remove(0))).unwrap();
    let camera = flight.app().camera_id();
    flight.views().present_to(camera, Deaf).unwrap();
    let e = flight.frame().unwrap_err().to_string();
    assert!(e.contains("presenter deaf") && e.contains("presented badly"), "{e}");
    flight.frame().unwrap();
    flight.views().present_to(camera, Deaf).unwrap();
    flight.views().present_again();
    assert!(flight.app_mut().outcome().is_err());
}

#[test]
fn one_that_panics_is_switched_off_and_the_others_go_on() {
    #[derive(Resource)]
    struct Count(u32);
    let counts = |app: &mut App| {
        app.world.insert_resource(Count(0));
        app.add_systems(FlightSystems::Trail, |mut n: ResMut<Count>| n.0 += 1);
        Ok(())
    };
    let scene = Scene { operator: true, ..Scene::default() };
    let scene = scene.plug(("bad plug-in", misbehave(0, 0.0))).unwrap().plug(("counts", counts)).unwrap();
    let mut flight = set_out(scene).unwrap();
    let faults: Vec<String> = (0..60).filter_map(|_| flight.step().err()).map(|e| e.to_string()).collect();
    assert!(faults.len() == 1 && faults[0].contains("bad plug-in"), "{faults:?}");
    assert_eq!(flight.app().world.resource::<Count>().0, 60);
    assert!(flight.app().inspect().is_off("bad plug-in") && flight.flight().state == State::Flying);
    let times = flight.app().inspect().plugin_times();
    assert_eq!(times.iter().map(|t| t.name.as_str()).collect::<Vec<_>>(), ["bad plug-in", "counts"]);
}

#[test]
fn a_slow_plugin_is_named_with_its_milliseconds() {
    let sleeps = |app: &mut App| {
        app.add_systems(FlightSystems::Log, || std::thread::sleep(Duration::from_millis(4)));
        Ok(())
    };
    let quick = |app: &mut App| {
        app.add_systems(FlightSystems::Log, || {});
        Ok(())
    };
    let scene = Scene::default().plug(("sleeper", sleeps)).unwrap().plug(("quick", quick)).unwrap();
    let mut flight = set_out(scene).unwrap();
    flight.fly(0.1).unwrap();
    let times = flight.app().inspect().plugin_times();
    assert!(times[0].is_slow() && times[0].step_ms >= 4.0, "{times:?}");
    assert!(times[1].step_ms < times[0].step_ms, "{times:?}");
    let told = colvis::app::explain::explain(&flight).text();
    assert!(told.contains("plug-in sleeper takes") && told.contains(": slow"), "{told}");
}

#[test]
fn a_slow_renderer_and_a_slow_presenter_are_named_with_their_milliseconds() {
    struct Sleepy;
    impl Renderer for Sleepy {
        fn render(&mut self, _: &View, _: &mut Frame) -> Work {
            std::thread::sleep(Duration::from_millis(5));
            Work::default()
        }

        fn parts(&self) -> Vec<(MemoryPart, usize)> {
            Vec::new()
        }
    }
    impl Presenter for Sleepy {
        fn name(&self) -> &'static str {
            "sleepy"
        }

        fn present(&mut self, _: &Picture) {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
    let preset = Preset { name: "sleepy", make: |_, _, _| Box::new(Sleepy), ..standard::PRESET };
    let mut flight = set_out(recorded(ImageSettings { preset, ..images_by_all().remove(0) })).unwrap();
    let camera = flight.app().camera_id();
    flight.views().present_to(camera, Sleepy).unwrap();
    flight.frame().unwrap();
    let times = flight.app().inspect().plugin_times();
    for name in ["preset sleepy", "presenter sleepy"] {
        assert!(times.iter().any(|t| t.name == name && t.is_slow() && t.frame_ms >= 5.0), "{times:?}");
    }
}
