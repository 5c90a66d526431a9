//! Plug-ins that take what belongs to the flight: its camera, its scan, parts of them, the renderer, the pictures. What was asked for
//! is written, or the flight ends with an error that names the plug-in; never neither.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use bevy_ecs::prelude::*;
use colvis::components::camera::{Pose, Velocity};
use colvis::components::flight::State;
use colvis::components::input::FlightCommand;
use colvis::components::output::Picture;
use colvis::components::scan::Scan as ScanData;
use colvis::error::{Kind, Result};
use colvis::schedule::{App, FlightSystems, Main, Phase, Slot};
use colvis::systems::present::{self, Presenter};

use crate::hostile::{fly, images_by_all, recorded, set_out};

/// Counts the pictures that it gets.
struct Counter(&'static str, Arc<AtomicUsize>);

impl Presenter for Counter {
    fn name(&self) -> &'static str {
        self.0
    }

    fn present(&mut self, picture: &Picture) {
        self.1.fetch_add(usize::from(picture.traced), Ordering::Relaxed);
    }
}

#[test]
fn a_presenter_on_the_camera_takes_no_picture_from_the_recording() {
    // Also one that is called like the recording.
    for name in ["presents, too", "recording"] {
        let shown = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&shown);
        let plug = move |app: &mut App| {
            let camera = app.camera_id();
            present::plug(app, camera, Counter(name, Arc::clone(&counter)));
            Ok(())
        };
        let out = fly(recorded(images_by_all().remove(0)).plug(("presents", plug)).unwrap(), &[]);
        assert!(out.kind.is_none() && out.images == 4, "{name}: {} {}", out.images, out.said);
        assert_eq!(shown.load(Ordering::Relaxed), 4, "{name}");
    }
}

#[test]
fn a_recording_without_images_is_a_failure_that_names_who_makes_none() {
    let fills = |app: &mut App| app.fill(Slot::Renderer, "darkroom");
    let silences = |app: &mut App| {
        app.add_systems(FlightSystems::PostProcess, |mut p: Single<&mut Picture, With<Main>>| p.traced = false);
        Ok(())
    };
    let scene = || recorded(images_by_all().remove(0));
    for (scene, who) in [
        (scene().plug(("fills", fills)).unwrap(), "the renderer darkroom"),
        (scene().plug(("silences", silences)).unwrap(), "taken::"),
    ] {
        let out = fly(scene, &[]);
        assert!(out.kind == Some(Kind::Fault) && out.images == 0, "{who}: {}", out.said);
        assert!(out.said.contains("there is no image to record") && out.said.contains(who), "{who}: {}", out.said);
    }
}

type Thief = fn(&mut App) -> Result<()>;

/// Takes something from the flight before the given step, by a command or with the whole world.
const THIEVES: [(&str, &str, Thief); 8] = [
    ("despawned the camera", "commands", |app| {
        app.add_systems(
            FlightSystems::Trail,
            |mut n: Local<u32>, camera: Single<Entity, (With<Main>, With<Pose>)>, mut commands: Commands| {
                *n += 1;
                if *n == 10 {
                    commands.entity(*camera).despawn();
                }
            },
        );
        Ok(())
    }),
    ("despawned the camera", "world", |app| {
        between(app, [FlightSystems::Sense, FlightSystems::Guide], |world: &mut World| {
            tenth(world, |camera| camera.despawn());
        });
        Ok(())
    }),
    ("despawned the scan", "commands", |app| {
        app.add_systems(
            FlightSystems::Sense,
            |mut n: Local<u32>, scan: Single<Entity, (With<Main>, With<ScanData>)>, mut commands: Commands| {
                *n += 1;
                if *n == 10 {
                    commands.entity(*scan).despawn();
                }
            },
        );
        Ok(())
    }),
    ("took Pose from the camera", "world", |app| {
        between(app, [FlightSystems::Input, FlightSystems::Sense], |world: &mut World| {
            tenth(world, |mut camera| {
                camera.remove::<Pose>();
            });
        });
        Ok(())
    }),
    ("took Velocity from the camera", "world", |app| {
        between(app, [FlightSystems::Trail, FlightSystems::Log], |world: &mut World| {
            tenth(world, |mut camera| {
                camera.remove::<Velocity>();
            });
        });
        Ok(())
    }),
    ("took Main from the camera", "world", |app| {
        between(app, [FlightSystems::Log, FlightSystems::Clock], |world: &mut World| {
            tenth(world, |mut camera| {
                camera.remove::<Main>();
            });
        });
        Ok(())
    }),
    ("took Picture from the camera", "world", |app| {
        between(app, [FlightSystems::Call, FlightSystems::Trail], |world: &mut World| {
            tenth(world, |mut camera| {
                camera.remove::<Picture>();
            });
        });
        Ok(())
    }),
    ("took Scan from the scan", "observer", |app| {
        app.observe(|_: On<Due>, scan: Single<Entity, (With<Main>, With<ScanData>)>, mut commands: Commands| {
            commands.entity(*scan).remove::<ScanData>();
        });
        app.add_systems(FlightSystems::Trail, |mut n: Local<u32>, mut commands: Commands| {
            *n += 1;
            if *n == 10 {
                commands.trigger(Due);
            }
        });
        Ok(())
    }),
];

#[derive(Event)]
struct Due;

#[derive(Resource, Default)]
struct Calls(u32);

/// Runs a system that has the whole world between two sets.
fn between(app: &mut App, [after, before]: [FlightSystems; 2], system: fn(&mut World)) {
    app.add_systems_to(Phase::Step, system.after(after).before(before));
}

/// Hands the camera to `steal` at the tenth call.
fn tenth(world: &mut World, steal: impl FnOnce(EntityWorldMut)) {
    let mut calls = world.get_resource_or_init::<Calls>();
    calls.0 += 1;
    if calls.0 == 10 {
        let camera = world.query_filtered::<Entity, (With<Main>, With<Pose>)>().single(world).unwrap();
        steal(world.entity_mut(camera));
    }
}

#[test]
fn a_flight_that_something_is_taken_from_ends_with_the_name_of_who_did_it_and_whole_files() {
    for (what, how, thief) in THIEVES {
        let scene = recorded(images_by_all().remove(0)).plug(("honest", |app: &mut App| {
            app.add_systems(FlightSystems::Log, || {});
            Ok(())
        }));
        let out = fly(scene.unwrap().plug(("thief", thief)).unwrap(), &[]);
        let name = format!("{what} by {how}: {}", out.said);
        assert!(out.kind == Some(Kind::Fault) && out.said.contains("plug-in thief"), "{name}");
        assert!(out.said.contains(what) && !out.said.contains("honest"), "{name}");
        // The step in which it happens is logged or not, depending on when in it that is.
        assert!(
            (9..=10).contains(&out.lines) && out.last == Some(State::Ended),
            "{} {:?}: {name}",
            out.lines,
            out.last
        );
        assert!(out.images >= 2, "{}: {name}", out.images);
    }
}

#[test]
fn a_flight_that_something_was_taken_from_can_be_asked_for_anything_without_a_panic() {
    for (what, how, thief) in THIEVES {
        let scene = recorded(images_by_all().remove(0)).plug(("thief", thief)).unwrap();
        let mut flight = set_out(scene).unwrap();
        let failed = (0..12).filter_map(|_| flight.step().err()).collect::<Vec<_>>();
        assert!(failed.len() == 1 && failed[0].to_string().contains(what), "{what} by {how}: {failed:?}");
        assert!(flight.flight().state == State::Ended && flight.flight().reason.contains(what), "{what} by {how}");
        assert!(flight.pose().position.is_finite() && flight.camera::<Pose>().is_some(), "{what} by {how}");
        for command in [FlightCommand::Reverse, FlightCommand::OtherEnd, FlightCommand::Seek(0.5)] {
            // Whether it can be followed is another matter.
            let _ = flight.act(command);
        }
        flight.step().unwrap();
        flight.frame().unwrap();
        assert!(flight.camera::<Picture>().is_some_and(|p| p.traced), "{what} by {how}");
    }
    // The code that drives the flight may do it, too.
    let mut flight = set_out(recorded(images_by_all().remove(0))).unwrap();
    let (camera, scan) = (flight.app().camera_id(), flight.app().scan_id());
    for entity in [camera, scan] {
        flight.app_mut().world.despawn(entity);
        let _ = flight.act(FlightCommand::Reverse);
        assert!(flight.step().is_err(), "it is told once");
        flight.step().unwrap();
        flight.frame().unwrap();
    }
}

#[test]
fn a_plugin_that_takes_something_while_it_is_plugged_in_is_refused() {
    for (what, thief) in [
        (
            "took Picture from the camera",
            (|app| {
                app.camera().remove::<Picture>();
                Ok(())
            }) as Thief,
        ),
        ("despawned the scan", |app| {
            let scan = app.scan_id();
            app.world.despawn(scan);
            Ok(())
        }),
    ] {
        let e = set_out(recorded(images_by_all().remove(0)).plug(("thief", thief)).unwrap()).err().unwrap();
        assert!(
            e.kind == Kind::Fault && e.to_string().contains("plug-in thief") && e.to_string().contains(what),
            "{e}"
        );
    }
}
