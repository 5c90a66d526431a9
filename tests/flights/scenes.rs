//! Parts that a scene does not request are neither scheduled nor in memory.

use std::sync::OnceLock;

use colvis::app::Scene;
use colvis::app::explain::{Explanation, explain};
use colvis::app::plan::FlightRequest;
use colvis::phantom::{PhantomSettings, Size};
use colvis::volume::Volume;

use crate::support::flights::flight;
use crate::support::phantom::phantom;
use crate::support::run::run;

fn shipped(name: &str) -> Scene {
    Scene::read(&std::path::Path::new("assets/scenes").join(name), &colvis::app::Catalog::default()).unwrap()
}

fn explained(scene: Scene) -> Explanation {
    static VOLUME: OnceLock<Volume> = OnceLock::new();
    let volume = VOLUME.get_or_init(|| phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() }).0);
    explain(&flight(volume.clone(), scene, &FlightRequest::default()))
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
    // (scene, system or component, true if present)
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
        ("cast_pictures", [false, false, false, true]),
        ("Scan", [true, true, true, true]),
        ("FrameCache", [false, false, false, true]),
        ("take_commands", [false, false, false, false]),
        ("Hand", [false, false, false, false]),
        ("log_step", [false, false, false, false]),
    ];
    for (name, wanted) in table {
        for (n, want) in wanted.into_iter().enumerate() {
            assert_eq!(has(n, name), want, "{name} in {}: {:?} {:?}", scenes[n], all[n].step, all[n].components);
        }
    }
    // Every missing part is reported with a reason.
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
        assert!(left_out(e, "tentacles") && left_out(e, "mines"));
    }
}

#[test]
fn a_guide_is_changed_in_flight_and_its_parts_go() {
    use colvis::components::guide::{MineField, Tentacles};
    use colvis::components::input::FlightCommand;
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let mut f = flight(volume, Scene { operator: true, log: true, ..Scene::default() }, &FlightRequest::default());
    for _ in 0..120 {
        f.step().unwrap();
    }
    let before = f.pose().position;
    f.act(FlightCommand::Guide("manual".to_owned())).unwrap();
    assert!(f.camera::<Tentacles>().is_none() && f.camera::<MineField>().is_none());
    assert_eq!(f.pose().position, before, "the camera stays where it was");
    for _ in 0..240 {
        f.step().unwrap();
    }
    let drift = f.take_log().last().unwrap().velocity;
    assert!(drift.iter().all(|v| v.abs() < 3.4e-4), "it drifts to rest");
    f.act(FlightCommand::Guide("tentacles".to_owned())).unwrap();
    for _ in 0..240 {
        f.step().unwrap();
    }
    assert!(f.pose().position.distance(before) > 25.0, "and the guide goes on");
    assert!(f.act(FlightCommand::Guide("warp".to_owned())).is_err());
}

#[test]
#[ignore = "slow: two runs of the program"]
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
#[ignore = "slow: two runs of the program"]
fn coverage_is_explained_where_it_is_watched_and_where_it_is_not() {
    for (asked, there) in [(&["--coverage"][..], true), (&[], false)] {
        let out = run(&[&["explain", "--headless", "--json"], asked].concat(), 0);
        let told: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        let has =
            |list: &str, part: &str| told[list].as_array().unwrap().iter().any(|b| b == part || b["part"] == part);
        assert_eq!(has("step", "coverage::watch_wall"), there, "{told}");
        assert_eq!(has("built", "wall, and which of it was seen"), there);
        assert_eq!(has("left_out", "coverage"), !there);
    }
}

#[test]
#[ignore = "slow: three runs of the program"]
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
        assert!(has(&all[n], "components", "FrameCache"));
        assert_eq!(has(&all[n], "built", "gradient cache"), n < 2);
        for part in ["volume (7 + 1 bit)", "frame cache"] {
            assert_eq!((has(&all[n], "built", part), has(&all[n], "left_out", part)), (keeps, !keeps), "{part}");
        }
        assert_eq!(has(&all[n], "left_out", "a flag for each voxel"), n == 2);
    }
    let cache = all[1]["built"].as_array().unwrap().iter().find(|b| b["part"] == "frame cache").unwrap();
    assert!(cache["bytes"].as_u64().unwrap() >= 48 * 32 * 16);
}

/// Flies with a scene's choices and returns the memory that `explain` reports, the samples and reused rays of each
/// frame, and the frames.
fn flown_by(choices: &str, preset: &str) -> (serde_json::Value, Vec<[u64; 3]>, Vec<Vec<u8>>) {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).display().to_string();
    let (scene, stats, images) = (at("s.toml"), at("s.json"), format!("{}/", at("images")));
    std::fs::write(&scene, format!("plugins = [\"tentacles\", \"mines\"]\n[render]\n{choices}\n")).unwrap();
    let args = ["--headless", "--scene", &scene, "--preset", preset, "--size", "64x48", "--record", &images];
    let told = run(&[&["explain", "--json"][..], &args].concat(), 0);
    let told = serde_json::from_slice(&told.stdout).unwrap();
    run(&[&["fly"][..], &args, &["--seconds", "0.2", "--stats", &stats]].concat(), 0);
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(&stats).unwrap()).unwrap();
    let counts = |f: &serde_json::Value| ["rays", "samples", "reused"].map(|c| f[c].as_u64().unwrap());
    let mut names: Vec<_> = std::fs::read_dir(&images).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    let frames = stats["frames"].as_array().unwrap().iter().map(counts).collect();
    (told, frames, names.iter().map(|n| std::fs::read(n).unwrap()).collect())
}

#[test]
#[ignore = "slow: twelve runs of the program"]
fn a_flight_runs_what_its_scene_chooses_of_the_papers_ideas() {
    let needed = |e: &serde_json::Value, part: &str| {
        let built = e["built"].as_array().unwrap().iter();
        built.filter(|b| b["part"] == part && b["bytes"].as_u64() > Some(0)).map(|b| b["needed_by"].clone()).next()
    };
    let samples = |f: &[[u64; 3]]| f.iter().map(|f| f[1]).sum::<u64>();
    for preset in ["default", "colvis"] {
        let (none, at_all, plain) = flown_by("leap = \"none\"\ngradients = \"none\"", preset);
        let (voxel, leapt, same) = flown_by("leap = \"voxel\"\ngradients = \"none\"\nkey_frames = 3", preset);
        let (stored, ..) = flown_by("gradients = \"stored\"", preset);
        assert_eq!((at_all.len(), plain.len()), (7, 7));
        assert!(plain == same, "{preset}: leaping and reuse change no bit");
        assert!(samples(&leapt) < samples(&at_all), "{preset}");
        let reused: Vec<bool> = leapt.iter().map(|f| f[2] > 0).collect();
        assert_eq!(reused, [false, true, true, false, true, true, false], "{preset}");
        for (part, told, from) in [
            ("wall distance per voxel", &voxel, "[render] leap"),
            ("frame cache", &voxel, "[render] key_frames"),
            ("precomputed gradients", &stored, "[render] gradients"),
        ] {
            assert!(needed(told, part).unwrap().as_str().unwrap().contains(from), "{preset} {part}");
            let left_out = told["left_out"].as_array().unwrap().iter().any(|l| l["part"] == part);
            assert!(!left_out, "{preset} {part}");
        }
        assert!(
            needed(&none, "wall distance per voxel").is_none() && needed(&voxel, "precomputed gradients").is_none()
        );
    }
}

#[test]
fn choices_that_make_no_sense_are_status_2() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("s.toml").display().to_string();
    for (choices, preset, said) in [
        ("leap = \"far\"", "colvis", "unknown variant `far`, expected one of `none`, `flag`, `brick`, `voxel`"),
        ("key_frames = 0", "colvis", "render.key_frames: is 0; give a whole number from 1"),
        ("leap = \"voxel\"", "lean", "render.leap: the preset lean stores nothing per voxel; choose \"brick\""),
        ("gradients = \"cached\"", "lean", "render.gradients: the preset lean keeps no gradients; choose"),
        ("key_frames = 9", "lean", "render.key_frames: the preset lean keeps nothing between frames; leave it out"),
    ] {
        std::fs::write(&scene, format!("plugins = [\"render\"]\n[render]\n{choices}\n")).unwrap();
        for command in ["fly", "explain"] {
            let out = run(&[command, "--headless", "--scene", &scene, "--preset", preset, "--size", "32x32"], 2);
            let err = String::from_utf8_lossy(&out.stderr).into_owned();
            assert!(err.contains(said), "{choices}: {err}");
        }
    }
}

/// Every part of a step and of a frame is a scheduled system, in a window as in a recording.
#[test]
#[ignore = "slow: two runs of the program"]
fn the_whole_step_and_the_whole_frame_are_systems() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("f.jsonl").display().to_string();
    let record = format!("{}/images/", dir.path().display());
    let input = dir.path().join("in.jsonl").display().to_string();
    let window = ["explain", "--json", "--log", &log];
    let recording = ["explain", "--json", "--log", &log, "--headless", "--record", &record, "--record-input", &input];
    let mut all = vec![&recording[..]];
    if cfg!(feature = "window") {
        all.push(&window[..]);
    }
    for args in all {
        let told = serde_json::from_slice::<serde_json::Value>(&run(args, 0).stdout).unwrap();
        let names = |list: &str| {
            let list = told[list].as_array().unwrap().iter();
            list.map(|n| n.as_str().unwrap().rsplit("::").next().unwrap().to_owned()).collect::<Vec<_>>()
        };
        let step = [
            "take_commands",  // input
            "cast_tentacles", // sense
            "guide_by_tentacles",
            "look_ahead",
            "lay_mines", // force
            "push_by_mines",
            "sum_forces",
            "move_body", // integration
            "watch_flight",
            "call_operator",
            "note_arrival",
            "follow_trail",
            "log_step",
            "tick",
        ];
        assert_eq!(names("step"), step);
        assert_eq!(names("frame"), ["cast_pictures", "present_pictures"]);
    }
}

/// The volume is a component that sensing and rendering systems query.
#[test]
fn the_volume_is_a_component_that_systems_query() {
    use colvis::components::scan::Scan;
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let scene = Scene { picture: true, ..Scene::default() };
    let flight = flight(volume, scene, &FlightRequest::default());
    let querying = flight.app().inspect().systems_that_query::<Scan>();
    for system in ["raycast::cast_pictures", "sense::cast_tentacles", "tentacles::guide_by_tentacles"] {
        assert!(querying.iter().any(|s| s == system), "{system} is not among {querying:?}");
    }
    assert!(!querying.iter().any(|s| s.contains("log_step")), "{querying:?}");
}
