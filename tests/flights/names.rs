//! Who is named for what goes wrong in a flight, from whatever thread and part of it.

use std::process::Command;

use bevy_ecs::prelude::*;
use colvis::app::{Catalog, Scene};
use colvis::components::guide::GuideThrust;
use colvis::dynamics::Body;
use colvis::error::{Error, Kind, Result};
use colvis::schedule::{App, FlightSystems, Guide, Look, Main, note, report_fault};
use glam::DVec3;

use crate::hostile::{fly, images_by_all, recorded};

#[derive(Event)]
struct Due;

#[test]
fn an_observer_that_panics_is_told_by_its_plugin() {
    let watches = |app: &mut App| {
        app.observe(|_: On<Due>| panic!("observed badly"));
        Ok(())
    };
    let triggers = |app: &mut App| {
        app.add_systems(FlightSystems::Trail, |mut n: Local<u32>, mut commands: Commands| {
            *n += 1;
            if *n == 10 {
                commands.trigger(Due);
            }
        });
        Ok(())
    };
    let scene = recorded(images_by_all().remove(0)).plug(("watches", watches)).unwrap();
    let out = fly(scene.plug(("triggers", triggers)).unwrap(), &[]);
    assert!(out.kind == Some(Kind::Fault) && out.said.contains("observed badly"), "{}", out.said);
    assert!(out.said.contains("plug-in watches") && !out.said.contains("bevy_ecs"), "{}", out.said);
    assert!(out.lines == 10 && out.images >= 2, "{} {}", out.lines, out.images);
}

#[test]
fn what_a_look_writes_wrongly_is_told_as_the_looks() {
    fn plug(app: &mut App) -> Result<()> {
        app.add_systems(FlightSystems::Look, |mut guide: Single<&mut GuideThrust, With<Main>>| {
            guide.look_direction = DVec3::NAN;
        });
        Ok(())
    }
    let look = Look { name: "dazed", summary: "looks nowhere", plug };
    let scene = Scene { look: Some(look), ..recorded(images_by_all().remove(0)) };
    let out = fly(scene.plug(("honest", |_: &mut App| Ok(()))).unwrap(), &[]);
    assert!(out.said.contains("look dazed gave an invalid direction"), "{}", out.said);
    assert!(!out.said.contains("guide"), "{}", out.said);
    // What another plug-in writes over it is neither's.
    let writes = |app: &mut App| {
        app.add_systems(FlightSystems::Force, |mut guide: Single<&mut GuideThrust, With<Main>>| {
            guide.thrust = DVec3::INFINITY;
        });
        Ok(())
    };
    let out = fly(recorded(images_by_all().remove(0)).plug(("writes", writes)).unwrap(), &[]);
    assert!(out.said.contains("a plug-in that writes GuideThrust gave an invalid thrust"), "{}", out.said);
    assert!(!out.said.contains("guide tentacles"), "{}", out.said);
}

/// What is reported from threads of no flight goes to the flight that runs next, so it needs a process of its own.
#[test]
fn notes_and_faults_from_other_threads_are_told() {
    let program = std::env::current_exe().unwrap();
    let arguments = ["--exact", "names::notes_and_faults_from_other_threads", "--ignored", "--nocapture"];
    let out = Command::new(program).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(out.status.success() && said.contains("1 passed"), "{said}{}", String::from_utf8_lossy(&out.stderr));
}

#[test]
#[ignore = "run by notes_and_faults_from_other_threads_are_told, in a process of its own"]
fn notes_and_faults_from_other_threads() {
    // With `--include-ignored`, others run beside it.
    if !std::env::args().any(|a| a == "--exact") {
        return;
    }
    let reports = |app: &mut App| {
        app.add_systems(FlightSystems::Trail, |mut n: Local<u32>| {
            *n += 1;
            if *n == 10 {
                rayon::broadcast(|_| note("a worker", "has a word to say"));
                std::thread::spawn(|| note("a thread", "has one, too")).join().unwrap();
                rayon::scope(|s| s.spawn(|_| report_fault("part of it", "worked badly")));
            }
        });
        Ok(())
    };
    let out = fly(recorded(images_by_all().remove(0)).plug(("reports", reports)).unwrap(), &[]);
    assert!(out.kind == Some(Kind::Fault) && out.said.contains("part of it: panicked: worked badly"), "{}", out.said);
    for told in ["a worker has a word to say", "a thread has one, too"] {
        assert!(out.said.contains(told), "{}", out.said);
    }
    assert_eq!(out.lines, 10);
}

#[derive(Component, Clone, Debug, serde::Deserialize)]
#[serde(default)]
struct Licensed {
    key: String,
}

impl Default for Licensed {
    fn default() -> Self {
        Self { key: "a".to_owned() }
    }
}

impl Guide for Licensed {
    const NAME: &'static str = "licensed";
    const SUMMARY: &'static str = "needs a file";

    fn cruise_mm_s(&self, _: &Body) -> f64 {
        0.0
    }

    fn check(&self) -> Result<()> {
        let e = std::io::Error::other("no licence");
        if self.key.is_empty() {
            Err(Error::incomplete("licensed.key", "is missing", "buy one").caused_by(e))
        } else {
            Ok(())
        }
    }

    fn plug(&self, _: &mut App) -> Result<()> {
        Ok(())
    }
}

#[test]
fn an_error_in_a_scene_file_keeps_its_kind_and_its_cause() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("s.toml");
    let catalog = Catalog::default().guide::<Licensed>();
    let read = |text: &str| {
        std::fs::write(&file, text).unwrap();
        Scene::read(&file, &catalog)
    };
    let e = read("plugins = [\"licensed\"]\n[licensed]\nkey = \"\"\n").unwrap_err();
    assert!(e.kind == Kind::Incomplete && e.to_string().contains("s.toml: line 3:"), "{e}");
    assert!(e.to_string().contains("is missing; buy one") && !e.to_string().contains("assets"), "{e}");
    assert_eq!(std::error::Error::source(&e).unwrap().to_string(), "no licence");
    let e = read("plugins = 3\n").unwrap_err();
    assert!(e.kind == Kind::Usage && std::error::Error::source(&e).is_some(), "{e}");
    let e = Scene::read(&dir.path().join("none.toml"), &catalog).unwrap_err();
    assert!(e.kind == Kind::Input && std::error::Error::source(&e).is_some(), "{e}");
}

#[derive(Component, Clone, Debug, Default, serde::Deserialize)]
struct Unsteady;

impl Guide for Unsteady {
    const NAME: &'static str = "unsteady";
    const SUMMARY: &'static str = "panics when it is asked";

    fn cruise_mm_s(&self, _: &Body) -> f64 {
        panic!("cruised badly")
    }

    fn check(&self) -> Result<()> {
        panic!("checked badly")
    }

    fn plug(&self, _: &mut App) -> Result<()> {
        Ok(())
    }
}

#[derive(Component, Clone, Debug, Default, serde::Deserialize)]
struct Restless;

impl Guide for Restless {
    const NAME: &'static str = "restless";
    const SUMMARY: &'static str = "does not know its speed";

    fn cruise_mm_s(&self, _: &Body) -> f64 {
        panic!("cruised badly")
    }

    fn plug(&self, _: &mut App) -> Result<()> {
        Ok(())
    }
}

#[test]
fn a_guide_that_panics_when_it_is_asked_is_told_by_its_name() {
    let e = Scene::steered_by(Unsteady).check().unwrap_err();
    assert!(e.kind == Kind::Fault && e.to_string().contains("guide unsteady: panicked: checked badly"), "{e}");
    let scene = Scene { picture: true, image: images_by_all().remove(0), ..Scene::steered_by(Restless) };
    let out = fly(scene, &[]);
    assert!(out.kind.is_none() && out.images == 4, "{}", out.said);
    assert!(out.said.contains("guide restless panicked: cruised badly"), "{}", out.said);
    assert!(out.said.contains("its cruise speed counts as 0"), "{}", out.said);
}

#[derive(Resource)]
struct Grenade;

impl Drop for Grenade {
    fn drop(&mut self) {
        panic!("dropped badly");
    }
}

#[test]
fn what_panics_when_the_flight_is_dropped_goes_no_further() {
    let arms = |app: &mut App| {
        app.world.insert_resource(Grenade);
        Ok(())
    };
    let scene = recorded(images_by_all().remove(0)).plug(("arms", arms)).unwrap();
    let out = fly(scene, &[]);
    assert!(out.kind.is_none() && out.images == 4, "{}", out.said);
}
