//! What a scene does not ask for is neither scheduled nor in memory.

mod flying;

use std::sync::OnceLock;

use colvis::app::Scene;
use colvis::app::explain::{Explanation, explain};
use colvis::app::plan::Wish;
use colvis::phantom::{Settings, Size};
use colvis::volume::Volume;
use flying::{flight, phantom, run};

fn shipped(name: &str) -> Scene {
    Scene::read(&std::path::Path::new("assets/scenes").join(name)).unwrap()
}

fn explained(scene: Scene) -> Explanation {
    static VOLUME: OnceLock<Volume> = OnceLock::new();
    let volume = VOLUME.get_or_init(|| phantom(&Settings { size: Size::Small, ..Settings::default() }).0);
    explain(&flight(volume.clone(), scene, &Wish::default()))
}

#[test]
fn four_scenes_four_schedules() {
    let scenes = ["tentacles.toml", "tentacles-without-mines.toml", "manual.toml", "render.toml"];
    let all: Vec<Explanation> = scenes.iter().map(|s| explained(shipped(s))).collect();
    for (i, a) in all.iter().enumerate() {
        for b in &all[..i] {
            assert_ne!((&a.step, &a.frame), (&b.step, &b.frame));
        }
    }
    // (scene, system or component, is there)
    let has = |n: usize, name: &str| {
        let scheduled = all[n].step.iter().chain(&all[n].frame).any(|s| s.contains(name));
        let carried = all[n].components.iter().any(|c| c == name);
        scheduled || carried
    };
    let table = [
        ("cast_tentacles", [true, true, false, false]),
        ("Tentacles", [true, true, false, false]),
        ("lay_mines", [true, false, false, false]),
        ("MineField", [true, false, false, false]),
        ("MinePush", [true, false, false, false]),
        ("move_body", [true, true, true, false]),
        ("Body", [true, true, true, false]),
        ("Walls", [true, true, true, false]),
        ("watch_flight", [true, true, true, false]),
        ("cast_picture", [false, false, false, true]),
        ("RaySpace", [true, true, false, true]),
        ("FrameCache", [false, false, false, false]),
        ("take_commands", [false, false, false, false]),
        ("Hand", [false, false, false, false]),
        ("log_step", [false, false, false, false]),
    ];
    for (name, wanted) in table {
        for (n, want) in wanted.into_iter().enumerate() {
            assert_eq!(has(n, name), want, "{name} in {}: {:?} {:?}", scenes[n], all[n].step, all[n].components);
        }
    }
    // Whatever is not there is told with a reason.
    let left_out = |n: usize| -> Vec<&str> { all[n].left_out.iter().map(|l| l.part).collect() };
    assert!(left_out(1).contains(&"mines") && left_out(2).contains(&"tentacles") && left_out(3).contains(&"motion"));
    for (n, e) in all.iter().enumerate() {
        assert!(left_out(n).contains(&"centerline") && left_out(n).contains(&"wall distance field"));
        assert!(e.left_out.iter().all(|l| !l.why.is_empty()));
    }
    assert!(left_out(0).contains(&"picture"), "without a window or a recording no ray is cast for an image");
}

#[test]
fn a_scene_that_plans_has_what_it_plans_by_and_no_more() {
    let [path, potential] = ["path.toml", "potential.toml"].map(|s| explained(shipped(s)));
    let built = |e: &Explanation, part: &str| e.built.iter().any(|b| b.part == part && b.bytes > 0);
    let left_out = |e: &Explanation, part: &str| e.left_out.iter().any(|l| l.part == part && !l.why.is_empty());
    for (part, wanted) in [
        ("centerline", [true, false]),
        ("wall distance field", [false, true]),
        ("target distance field", [false, true]),
    ] {
        for (e, wanted) in [&path, &potential].into_iter().zip(wanted) {
            assert_eq!((built(e, part), left_out(e, part)), (wanted, !wanted), "{part}");
        }
    }
    for (e, component, system) in
        [(&path, "Planned", "guide_by_plan"), (&potential, "PotentialField", "guide_by_potential")]
    {
        assert!(e.components.iter().any(|c| c == component) && e.step.iter().any(|s| s.contains(system)));
        assert!(left_out(e, "tentacles") && left_out(e, "mines") && !e.components.iter().any(|c| c == "RaySpace"));
    }
}

#[test]
fn a_guide_is_changed_in_flight_and_its_parts_go() {
    use colvis::components::guide::{MineField, Tentacles};
    use colvis::components::input::Command;
    let (volume, _) = phantom(&Settings { size: Size::Small, ..Settings::default() });
    let mut f = flight(volume, Scene { operator: true, log: true, ..Scene::default() }, &Wish::default());
    for _ in 0..120 {
        f.step().unwrap();
    }
    let before = f.pose().position;
    f.act(Command::Guide("manual".to_owned())).unwrap();
    assert!(f.camera::<Tentacles>().is_none() && f.camera::<MineField>().is_none());
    assert_eq!(f.pose().position, before, "the camera stays where it was");
    for _ in 0..240 {
        f.step().unwrap();
    }
    assert!(f.take_log().last().unwrap().velocity.iter().all(|v| v.abs() < 0.1), "it drifts to rest");
    f.act(Command::Guide("tentacles".to_owned())).unwrap();
    for _ in 0..240 {
        f.step().unwrap();
    }
    assert!(f.pose().position.distance(before) > 20.0, "and the guide goes on");
    assert!(f.act(Command::Guide("warp".to_owned())).is_err());
}

#[test]
fn the_program_explains() {
    let scene = |s| ["explain", "--headless", "--json", "--scene", s].map(str::to_owned);
    let outputs = ["assets/scenes/tentacles.toml", "assets/scenes/render.toml"].map(|s| {
        let args = scene(s);
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let out = run(&args, 0);
        serde_json::from_slice::<serde_json::Value>(&out.stdout).unwrap()
    });
    assert_ne!(outputs[0]["step"], outputs[1]["step"]);
    assert!(outputs[0]["built"].as_array().unwrap().iter().all(|b| b["bytes"].is_u64()));
}

#[test]
fn a_frame_cache_is_there_where_the_preset_reuses() {
    let explain = |preset: &str| {
        let args = ["explain", "--headless", "--json", "--scene", "assets/scenes/render.toml", "--size", "48x32"];
        let out = run(&[&args[..], &["--preset", preset]].concat(), 0);
        serde_json::from_slice::<serde_json::Value>(&out.stdout).unwrap()
    };
    let has = |e: &serde_json::Value, list: &str, part: &str| {
        e[list].as_array().unwrap().iter().any(|b| b == part || b["part"] == part)
    };
    let all = ["default", "colvis", "lean"].map(explain);
    for (n, keeps) in [false, true, false].into_iter().enumerate() {
        // The default's holds the packets' structures, none of which is of the last frame's picture.
        assert_eq!(has(&all[n], "components", "FrameCache"), n < 2);
        assert_eq!(has(&all[n], "built", "gradient cache"), n == 0);
        for part in ["volume (7 + 1 bit)", "frame cache"] {
            assert_eq!((has(&all[n], "built", part), has(&all[n], "left_out", part)), (keeps, !keeps), "{part}");
        }
        assert_eq!(has(&all[n], "left_out", "a flag for each voxel"), n == 2);
    }
    let cache = all[1]["built"].as_array().unwrap().iter().find(|b| b["part"] == "frame cache").unwrap();
    assert!(cache["bytes"].as_u64().unwrap() >= 48 * 32 * 16);
}
