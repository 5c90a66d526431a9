//! Additions of other crates to a flight: plug-ins with state, views, post-processes, presenters.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use colvis::app::explain::explain;
use colvis::app::{FlightApp, FlightRequest, ImageSettings, Scan, Scene};
use colvis::components::camera::Pose;
use colvis::components::guide::Tentacles;
use colvis::components::input::FlightCommand;
use colvis::components::output::{Follows, FrameCache, Picture};
use colvis::error::Result;
use colvis::render::Preset;
use colvis::schedule::{App, FlightSystems, Phase, Plugin};
use colvis::systems::present::{self, Presenter};

use crate::support::embedded::embedded;

/// Counts the steps since it was built.
struct StepCounter {
    start: u32,
}

#[derive(Resource)]
struct Counted(u32);

impl Plugin for StepCounter {
    fn build(&self, app: &mut App) -> Result<()> {
        app.world.insert_resource(Counted(self.start));
        app.add_systems(FlightSystems::Log, |mut counted: ResMut<Counted>, mut runs: Local<u32>| {
            // Both the world's data and the system's local data must persist.
            *runs += 1;
            assert_eq!(*runs, counted.0 + 1);
            counted.0 += 1;
        });
        Ok(())
    }
}

fn scan() -> Scan {
    Scan::prepared(embedded(), Arc::default())
}

fn small(scene: Scene) -> FlightApp {
    scan().flight(scene, &FlightRequest::default()).unwrap()
}

/// Returns a scene with pictures of 96 × 64 pixels.
fn seen() -> Scene {
    let image = ImageSettings { width: 96, height: 64, ..ImageSettings::default() };
    Scene { picture: true, operator: true, image, ..Scene::default() }
}

fn picture(flight: &FlightApp, view: Entity) -> &Picture {
    flight.app().world.get::<Picture>(view).unwrap()
}

#[test]
fn a_plugin_is_built_once_and_counts_through_every_change() {
    let scene = Scene { operator: true, ..Scene::default() }.plug(StepCounter { start: 0 }).unwrap();
    let mut flight = small(scene);
    // Additions to the flight itself are plug-ins, too.
    flight.app_mut().world.spawn(Name::new("late"));
    flight.app_mut().add_systems(FlightSystems::Trail, |mut names: Query<&mut Name>, mut n: Local<u32>| {
        *n += 1;
        names.iter_mut().for_each(|mut name| name.set(n.to_string()));
    });
    let changes = [
        FlightCommand::Guide("manual".to_owned()),
        FlightCommand::Guide("potential".to_owned()),
        FlightCommand::Reverse,
        FlightCommand::Guide("tentacles".to_owned()),
    ];
    for change in changes {
        for _ in 0..48 {
            flight.step().unwrap();
        }
        flight.act(change).unwrap();
    }
    for _ in 0..48 {
        flight.step().unwrap();
    }
    let world = &mut flight.app_mut().world;
    assert_eq!((world.resource::<Counted>().0, world.query::<&Name>().single(world).unwrap().as_str()), (240, "240"));
    assert_eq!(flight.app().inspect().plugged(), ["StepCounter"]);
    let told = explain(&flight);
    assert_eq!(told.plugins, ["StepCounter"]);
    assert!(told.step.iter().any(|s| s.contains("StepCounter")), "{:?}", told.step);
    assert!(told.components.contains(&"bevy_ecs::Name".to_owned()), "{:?}", told.components);
    assert!(told.text().contains("plugged in:\n  1. StepCounter\n"), "{}", told.text());
}

#[test]
fn two_plugins_of_one_name_are_refused() {
    let one = Scene::default().plug(StepCounter { start: 0 }).unwrap();
    assert!(one.plug(StepCounter { start: 3 }).unwrap_err().to_string().contains("StepCounter"));
}

#[test]
fn every_entity_with_a_picture_is_a_view() {
    let mut alone = small(seen());
    let mut flight = small(seen());
    let camera = flight.app().camera_id();
    let rear = flight.views().add((Picture::new(48, 32), Follows::rear())).unwrap();
    let spawned = flight.app_mut().world.spawn((Picture::new(40, 40), Follows::default())).id();
    let pose = flight.pose();
    let fixed = flight.app_mut().world.spawn((Picture::new(40, 40), pose)).id();
    // Neither another entity that resembles a camera nor another scan interferes with the flight.
    let scan = flight.app_mut().scan_get::<colvis::components::scan::Scan>().cloned().unwrap();
    let other = Scan::phantom(2).unwrap().volume().clone();
    flight.app_mut().world.spawn((scan, pose));
    let other = flight.app_mut().world.spawn(colvis::components::scan::Scan(other)).id();
    let elsewhere = flight.app_mut().world.spawn((Picture { scan: Some(other), ..Picture::new(40, 40) }, pose)).id();
    for f in [&mut alone, &mut flight] {
        f.fly(1.5).unwrap();
        f.frame().unwrap();
    }
    assert_eq!(flight.pose(), alone.pose());
    assert!(picture(&flight, camera).frame == alone.camera::<Picture>().unwrap().frame, "the camera's is as it was");
    let all = [camera, rear, spawned, fixed, elsewhere].map(|view| picture(&flight, view));
    assert!(all.iter().all(|p| p.traced && p.frame.pixels().iter().any(|p| p[0] > 60)));
    assert!((all[1].view.as_ref().unwrap().forward() + flight.pose().attitude.forward).length() < 1e-12);
    assert_eq!(all[3].view.as_ref().unwrap().position(), pose.position, "it stays where it was put");
    assert!(all[3].frame != all[2].frame && all[4].frame != all[3].frame, "of another place, of another scan");
    let told = explain(&flight);
    for view in ["picture", "view 2", "view 5"] {
        assert!(told.built.iter().any(|b| b.part == view && b.bytes > 0), "{view}: {:?}", told.built);
    }
    // It survives a change of guide.
    flight.act(FlightCommand::Guide("manual".to_owned())).unwrap();
    let before = picture(&flight, rear).frame.clone();
    assert!(flight.place(pose.position, pose.attitude.forward, pose.attitude.up));
    flight.frame().unwrap();
    assert!(picture(&flight, rear).frame != before);
}

#[test]
fn a_view_can_be_added_to_a_flight_without_pictures() {
    for spawned in [false, true] {
        let mut flight = small(Scene::default());
        flight.fly(0.5).unwrap();
        assert!(explain(&flight).frame.is_empty() && flight.camera::<Tentacles>().is_some());
        let view = (Picture::new(32, 32), Follows::default());
        let view = match spawned {
            true => flight.app_mut().world.spawn(view).id(),
            false => flight.views().add(view).unwrap(),
        };
        flight.frame().unwrap();
        assert!(picture(&flight, view).traced);
        assert!(!explain(&flight).left_out.iter().any(|l| l.part == "picture"));
        flight.act(FlightCommand::Guide("manual".to_owned())).unwrap();
        flight.frame().unwrap();
        assert!(picture(&flight, view).traced);
    }
}

#[test]
fn what_is_no_view_is_refused() {
    let mut flight = small(Scene::default());
    let bad = Picture { fov_degrees: 400.0, ..Picture::new(32, 32) };
    for said in [
        flight.views().add(Follows::default()),
        flight.views().add(Picture::new(32, 32)),
        flight.views().add((bad, Follows::default())),
        flight.views().add((Picture::new(0, 32), Follows::default())),
    ] {
        assert_eq!(said.unwrap_err().kind as u8, 2);
    }
    assert!(explain(&flight).frame.is_empty());
    // A spawned entity cannot be refused: it keeps its black picture.
    let odd = flight.app_mut().world.spawn((Picture::new(0, 0), Follows::default())).id();
    let lost = flight.app_mut().world.spawn(Picture::new(8, 8)).id();
    flight.frame().unwrap();
    assert!(!picture(&flight, odd).traced && !picture(&flight, lost).traced);
}

/// A presenter that records into a list.
#[derive(Default)]
struct Kept(Vec<(usize, bool)>);

impl Presenter for Kept {
    fn name(&self) -> &'static str {
        "kept"
    }

    fn present(&mut self, picture: &Picture) {
        self.0.push((picture.frame.width(), picture.traced));
    }
}

#[test]
fn each_view_has_its_presenter() {
    let mut flight = small(seen());
    let camera = flight.app().camera_id();
    let rear = flight.views().add((Picture::new(48, 32), Follows::rear())).unwrap();
    for view in [camera, rear] {
        flight.views().present_to(view, Kept::default()).unwrap();
    }
    flight.frame().unwrap();
    flight.act(FlightCommand::Guide("manual".to_owned())).unwrap();
    flight.frame().unwrap();
    flight.views().present_again();
    let kept = [camera, rear].map(|view| present::take::<Kept>(flight.app_mut(), view).unwrap().0);
    assert_eq!(kept[0], [(96, true); 3], "presented again, as it was traced");
    assert_eq!(kept[1], [(48, true); 2]);
    assert!(present::take::<Kept>(flight.app_mut(), camera).is_none());
}

fn invert(mut pictures: Query<&mut Picture>) {
    for mut picture in pictures.iter_mut().filter(|p| p.traced) {
        picture.frame.buffers().0.iter_mut().for_each(|p| *p = p.map(|c| 255 - c));
    }
}

fn darken(mut pictures: Query<&mut Picture>) {
    for mut picture in pictures.iter_mut().filter(|p| p.traced) {
        picture.frame.buffers().0.iter_mut().for_each(|p| *p = p.map(|c| c / 2));
    }
}

#[test]
fn post_processes_need_not_know_each_other() {
    let plug = |app: &mut App, first: bool| {
        match first {
            true => app.add_systems(FlightSystems::PostProcess, invert),
            false => app.add_systems(FlightSystems::PostProcess, darken),
        };
        Ok(())
    };
    let scene = |order: [bool; 2]| {
        let mut scene = seen();
        for first in order {
            let name = if first { "invert" } else { "darken" };
            scene = scene.plug((name, move |app: &mut App| plug(app, first))).unwrap();
        }
        scene
    };
    let mut frames = Vec::new();
    for order in [[true, false], [false, true]] {
        let mut flight = small(scene(order));
        flight.act(FlightCommand::Guide("manual".to_owned())).unwrap();
        flight.frame().unwrap();
        let told = explain(&flight);
        let place = |name: &str| told.frame.iter().position(|s| s.contains(name)).unwrap();
        let at = [place("cast_pictures"), place("invert"), place("darken")];
        assert!(at[0] < at[1] && at[0] < at[2] && (at[1] < at[2]) == order[0], "{:?}", told.frame);
        frames.push(flight.camera::<Picture>().unwrap().frame.clone());
    }
    let mut plain = small(seen());
    plain.frame().unwrap();
    let plain = plain.camera::<Picture>().unwrap();
    for (n, pixel) in plain.frame.pixels().iter().enumerate() {
        assert_eq!(frames[0].pixels()[n], pixel.map(|c| (255 - c) / 2));
        assert_eq!(frames[1].pixels()[n], pixel.map(|c| 255 - c / 2));
    }
}

#[test]
fn another_preset_shows_at_once() {
    let mut flight = small(seen());
    flight.frame().unwrap();
    let standard = flight.camera::<Picture>().unwrap().frame.clone();
    flight.camera_mut::<Picture>().unwrap().preset = Preset::named("colvis").unwrap();
    flight.frame().unwrap();
    let colvis = flight.camera::<Picture>().unwrap().frame.clone();
    let mut fresh =
        small(Scene { image: ImageSettings { preset: Preset::named("colvis").unwrap(), ..seen().image }, ..seen() });
    fresh.frame().unwrap();
    assert!(colvis != standard && colvis == fresh.camera::<Picture>().unwrap().frame);
    let parts = flight.camera::<FrameCache>().unwrap().renderer().unwrap().parts();
    assert!(parts.iter().any(|p| p.0.name() == "volume (7 + 1 bit)"), "{parts:?}");
}

#[test]
fn sets_and_order_of_ones_own() {
    #[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
    struct Wind;

    fn blow(mut poses: Query<&mut Pose>) {
        poses.iter_mut().for_each(|mut p| p.position.z += 0.001);
    }
    let windy = |app: &mut App| {
        app.configure_sets(Phase::Step, Wind.after(FlightSystems::Integrate).before(FlightSystems::Watch));
        app.add_systems_to(Phase::Step, blow.in_set(Wind));
        Ok(())
    };
    let flight = small(Scene::default().plug(windy).unwrap());
    let step = explain(&flight).step;
    let place = |name: &str| step.iter().position(|s| s.contains(name)).unwrap();
    assert!(place("move_body") < place("blow") && place("blow") < place("watch_flight"), "{step:?}");
    // Two that access the same data are refused, and the message names a fix that works.
    let clash = |app: &mut App| {
        app.add_systems(FlightSystems::Integrate, blow);
        Ok(())
    };
    let scene = Scene::default().plug(clash).unwrap();
    let Err(e) = scan().flight(scene, &FlightRequest::default()) else { panic!("it is ambiguous") };
    let e = e.to_string();
    assert!(e.contains("blow") && e.contains("move_body") && e.contains("`a.before(b)`"), "{e}");
    let ordered = |app: &mut App| {
        app.add_systems(FlightSystems::Integrate, blow.before(colvis::systems::motion::move_body));
        Ok(())
    };
    let mut flight = small(Scene { operator: true, ..Scene::default() }.plug(ordered).unwrap());
    for guide in ["manual", "tentacles"] {
        flight.act(FlightCommand::Guide(guide.to_owned())).unwrap();
        flight.fly(0.1).unwrap();
    }
}

#[test]
fn two_views_and_two_post_processes_are_the_same_on_any_number_of_threads() {
    let flown = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let post = |app: &mut App| {
                app.world.spawn((Picture::new(64, 48), Follows::rear()));
                app.add_systems(FlightSystems::PostProcess, invert).add_systems(FlightSystems::PostProcess, darken);
                Ok(())
            };
            let mut flight = small(seen().plug(post).unwrap());
            let mut digest = Vec::new();
            for _ in 0..4 {
                flight.fly(0.5).unwrap();
                flight.frame().unwrap();
                let views = flight.other_views();
                let all = views.iter().map(|v| v.0).chain(flight.camera::<Picture>());
                digest.push(all.map(|p| p.frame.pixels().to_vec()).collect::<Vec<_>>());
            }
            digest
        })
    };
    let one = flown(1);
    assert_eq!(one[0].len(), 2);
    for threads in [2, 3, 8] {
        assert_eq!(flown(threads), one, "{threads} threads");
    }
}

/// A plug-in's presenter moves to the thread that runs frames, whichever thread created the flight.
#[test]
fn a_plugin_gives_a_view_its_presenter_on_whichever_thread_it_is_built() {
    let presents = |app: &mut App| {
        let rear = app.world.spawn((Picture::new(48, 32), Follows::rear())).id();
        present::plug(app, rear, Kept::default());
        Ok(())
    };
    let made = std::thread::spawn(move || small(seen().plug(presents).unwrap()));
    let mut flight = made.join().unwrap();
    flight.act(FlightCommand::Guide("manual".to_owned())).unwrap();
    flight.frame().unwrap();
    let camera = flight.app().camera_id();
    flight.views().present_to(camera, Kept::default()).unwrap();
    flight.frame().unwrap();
    let app = flight.app_mut();
    let views: Vec<Entity> = app.world.query_filtered::<Entity, With<Follows>>().iter(&app.world).collect();
    assert_eq!(present::take::<Kept>(app, views[0]).unwrap().0, [(48, true); 2]);
    assert_eq!(present::take::<Kept>(app, camera).unwrap().0, [(96, true)]);
}

#[test]
fn a_view_that_aim_moves_is_traced_where_it_is_now() {
    let aims = |app: &mut App| {
        app.add_systems(
            FlightSystems::Aim,
            |mut views: Query<&mut Pose, (With<Picture>, Without<colvis::schedule::Main>)>| {
                views.iter_mut().for_each(|mut pose| pose.position.x += 0.5);
            },
        );
        Ok(())
    };
    let mut flight = small(seen().plug(aims).unwrap());
    let pose = flight.pose();
    let view = flight.views().add((Picture::new(32, 24), pose)).unwrap();
    for n in 1..4 {
        // As in a window, which does not know what the set will do.
        flight.views().render_due().unwrap();
        let seen = picture(&flight, view);
        assert!(seen.traced && seen.view.as_ref().unwrap().position().x == pose.position.x + 0.5 * f64::from(n));
    }
}

#[test]
fn a_view_that_panics_goes_on_with_what_this_crate_has_and_the_others_do_not_mind() {
    struct Bad;
    impl colvis::render::Renderer for Bad {
        fn render(&mut self, _: &colvis::render::View, _: &mut colvis::render::Frame) -> colvis::render::Work {
            panic!("rendered badly")
        }

        fn parts(&self) -> Vec<(colvis::render::MemoryPart, usize)> {
            Vec::new()
        }
    }
    let bad = Preset { name: "bad", make: |_, _, _| Box::new(Bad), ..Preset::default() };
    let mut flight = small(seen());
    flight.camera_mut::<Picture>().unwrap().preset = Preset::named("colvis").unwrap();
    let rear = flight.views().add((Picture { preset: bad, ..Picture::new(32, 24) }, Follows::rear())).unwrap();
    let e = flight.frame().unwrap_err().to_string();
    assert!(e.contains("preset bad") && e.contains("rendered badly"), "{e}");
    flight.frame().unwrap();
    assert!(picture(&flight, rear).traced && picture(&flight, rear).preset == Preset::default());
    assert_eq!(flight.camera::<Picture>().unwrap().preset.name, "colvis");
}

#[test]
fn a_run_condition_that_panics_is_its_own_plugins() {
    let panics = |app: &mut App| {
        app.add_systems(FlightSystems::Trail, (|| {}).run_if(|| -> bool { panic!("asked badly") }));
        Ok(())
    };
    let scene = Scene::default().plug(StepCounter { start: 0 }).unwrap().plug(("asker", panics)).unwrap();
    let mut flight = small(scene);
    let faults: Vec<String> = (0..20).filter_map(|_| flight.step().err()).map(|e| e.to_string()).collect();
    assert!(
        faults.len() == 1 && faults[0].contains("plug-in asker") && faults[0].contains("asked badly"),
        "{faults:?}"
    );
    assert_eq!(flight.app().world.resource::<Counted>().0, 20);
}
