//! The 2D program: ten drawn lumens with known traps, extreme ones, and invalid drawings. `traps.rs` covers the traps
//! in three dimensions.

use colvis::dynamics::mines::MineSettings;
use colvis::dynamics::trap::Trap;
use colvis::fields::Clearances;
use colvis::math::hash;
use colvis::plane::drawing::{Drawing, MM_PER_PIXEL};
use colvis::plane::flight::HZ;
use colvis::plane::shipped::{DRAWINGS, named};
use colvis::plane::{Flight, PlaneSettings, State};
use colvis::render::ImageSize;
use glam::DVec3;

use crate::support::run::run;

/// The known outcome of each drawing: the trap that calls the operator (none if the flight arrives), the number of
/// places at which another path was searched, and the digest of the trajectory.
///
/// To update a digest after an intended change of flights, run with `-- --nocapture` and copy the output.
const KNOWN: [(&str, Option<Trap>, u32, u64); 10] = [
    ("bends", None, 0, 0xaf1d_a9b5_7bdf_0d21),
    ("straight", None, 0, 0x597b_1c1b_24da_044a),
    ("fork", None, 1, 0xfdaf_7f36_440d_de8d),
    ("pocket", Some(Trap::BlindEnd), 1, 0x8c48_2923_489e_f8fd),
    ("ring", Some(Trap::Circling), 2, 0xb6c7_64b4_c98a_b559),
    ("touching", None, 0, 0x7503_36a8_d21e_32c8),
    ("bridge", None, 1, 0xf229_57b2_fb4a_6177),
    ("polyp", None, 1, 0xc9d2_82e5_f37a_1d99),
    ("neck", Some(Trap::Narrow), 1, 0x2d20_1e6a_acbd_e238),
    ("spiral", None, 0, 0x4ffc_81bb_bdff_1293),
];

/// FNV-1a of the positions every tenth of a second, to a hundredth of a millimetre.
fn digest(places: &[DVec3]) -> u64 {
    let numbers = places.iter().step_by(12).flat_map(|p| [p.x, p.y].map(|x| (x * 100.0).round() as i64));
    numbers.fold(0xcbf2_9ce4_8422_2325, |h, n| (h ^ n as u64).wrapping_mul(0x0100_0000_01b3))
}

/// The events of a flight.
struct Flown {
    flight: Flight,
    /// Each trap: the time at which it was reported, its kind and place, and how long the camera had been there.
    traps: Vec<(f64, Trap, DVec3, f64)>,
}

fn fly(drawing: Drawing, settings: PlaneSettings) -> Flown {
    let radius = settings.body.radius_mm;
    let mut flight = Flight::new(drawing, settings).expect("a flight");
    let began = flight.clearance_mm();
    let (mut traps, mut was) = (Vec::new(), None);
    while flight.state() == State::Flying {
        flight.step();
        let clearance = flight.clearance_mm();
        assert!(
            flight.position().is_finite() && (clearance >= radius || clearance >= began),
            "perforated: {clearance}"
        );
        let trap = flight.rescue().trap();
        if let Some((kind, at)) = trap.filter(|_| trap != was) {
            // The camera was in the trap since it came near the place. If it turned back, it was in the trap since it
            // left again over known ground.
            let places = flight.places();
            let near = |p: &DVec3| p.distance(at) <= 6.0;
            let last_near = places.iter().rposition(near).unwrap_or(0);
            let came = places[..last_near].iter().rposition(|p| !near(p)).unwrap_or(0);
            let known = |p: &DVec3| places[..last_near].iter().step_by(6).any(|q| q.distance(*p) <= 6.0);
            let back = places[last_near..].iter().rposition(|p| !known(p)).map_or(last_near, |n| last_near + n + 1);
            let since = if last_near + 1 == places.len() { came } else { back };
            traps.push((flight.seconds(), kind, at, (places.len() - since) as f64 / f64::from(HZ)));
        }
        was = trap;
    }
    Flown { flight, traps }
}

#[test]
fn ten_lumens_come_out_as_known() {
    let mut wrong = Vec::new();
    for (name, want, escapes, code) in KNOWN {
        let Flown { flight, traps } = fly(named(name).unwrap().unwrap(), PlaneSettings::default());
        let got = (flight.call().map(|c| c.trap), flight.rescue().escapes(), digest(flight.places()));
        println!(
            "(\"{name}\", {:?}, {}, {:#018x}), {:?} after {:.0} mm, {:.1} s at {:.0}, {:.0}; least clearance {:.2}; {traps:.1?}",
            got.0,
            got.1,
            got.2,
            flight.state(),
            flight.length_mm(),
            flight.seconds(),
            flight.position().x,
            flight.position().y,
            flight.places().iter().map(|p| flight.walls().clearance(*p).mm).fold(f64::INFINITY, f64::min),
        );
        assert!(traps.iter().all(|t| t.3 <= 2.0), "{name}: noticed too late: {traps:?}");
        let state = if want.is_some() { State::Operator } else { State::Arrived };
        if flight.state() != state || got != (want, escapes, code) {
            wrong.push(name);
        }
    }
    assert!(wrong.is_empty(), "not as known: {wrong:?}");
}

/// The shipped pictures match the generator. `COLVIS_REPLACE=1` rewrites them.
#[test]
fn the_drawings_are_what_the_generator_draws() {
    for (name, png) in DRAWINGS {
        let drawn = crate::plane_drawings::draw(name);
        let path = format!("assets/plane/{name}.png");
        if std::env::var_os("COLVIS_REPLACE").is_some() {
            drawn.save(&path).unwrap();
            continue;
        }
        let shipped = image::load_from_memory(png).unwrap().to_rgb8();
        assert!(
            shipped == drawn,
            "{path} differs: COLVIS_REPLACE=1 cargo test --release --test flights plane writes it anew"
        );
    }
}

/// Creates a straight lumen of the given half-width, pixels, between two ends.
fn corridor(half: i64) -> Drawing {
    let (w, h) = (240, 80);
    let inside = |n: usize| (8..232).contains(&(n % w)) && ((n / w) as i64 - 40).abs() <= half;
    let mut d = Drawing::new("corridor", ImageSize::new(w, h), (0..w * h).map(inside).collect()).unwrap();
    d.start = Some(DVec3::new(10.0, 20.25, 0.0));
    d.goal = Some(DVec3::new(112.0, 20.25, 0.0));
    d
}

#[test]
#[ignore = "slow: twenty flights in two dimensions"]
fn few_tentacles_none_and_many_mines_stay_safe() {
    for count in [3, 4, 8, 64, 1024] {
        for kept in [None, Some(0), Some(1), Some(10_000)] {
            let mut settings = PlaneSettings { seconds: 30.0, ..PlaneSettings::default() };
            settings.tentacles.count = count;
            settings.mines = kept.map(|kept| MineSettings { kept, spacing_mm: 0.1, ..MineSettings::default() });
            let Flown { flight, .. } = fly(corridor(16), settings);
            assert_ne!(flight.state(), State::Flying, "{count} tentacles, {kept:?} mines");
            if count >= 64 {
                assert_eq!(flight.state(), State::Arrived, "{count} tentacles, {kept:?} mines: {:?}", flight.call());
            }
        }
    }
}

#[test]
fn no_room_at_the_start_is_told() {
    // One pixel wide: the camera fits nowhere.
    let narrow = Flight::new(corridor(0), PlaneSettings::default()).unwrap_err();
    assert!(narrow.kind as i32 == 4 && narrow.to_string().contains("narrower than the camera"), "{narrow}");
    let mut unmarked = corridor(0);
    (unmarked.start, unmarked.goal) = (None, None);
    assert_eq!(Flight::new(unmarked, PlaneSettings::default()).unwrap_err().kind as i32, 4);
    // In the wall, at distance exactly 0 from it, outside, beyond all numbers: moved into the lumen nearby, or refused.
    for (start, fits) in [
        (DVec3::new(10.0, 10.0, 0.0), true),
        (DVec3::new(10.0, 12.0, 0.0), true),
        (DVec3::new(10.0, 2.0, 0.0), false),
        (DVec3::new(-40.0, 20.0, 0.0), false),
        (DVec3::splat(1e300), false),
        (DVec3::NAN, false),
    ] {
        let mut d = corridor(16);
        d.start = Some(start);
        match Flight::new(d, PlaneSettings { seconds: 5.0, ..PlaneSettings::default() }) {
            Ok(flight) => {
                assert!(fits, "{start}");
                assert!(flight.clearance_mm() > 1.5 && flight.plan().notes.len() == 1, "{start}");
            }
            Err(e) => assert!(!fits && e.kind as i32 == 4, "{start}: {e}"),
        }
    }
    // A body without a radius flies through one pixel.
    let mut settings = PlaneSettings::default();
    settings.body.radius_mm = 0.0;
    let Flown { flight, .. } = fly(corridor(0), settings);
    assert_ne!(flight.state(), State::Flying);
}

/// Random walls: whatever is drawn, a flight ends, stays in the lumen and is reproducible.
#[test]
fn anything_drawn_is_survived() {
    for seed in 0..24u64 {
        let (w, h) = (90, 70);
        let blob = |n: u64| [0, 1, 2].map(|k| hash::uniform(seed, 8 * n + k));
        let blobs: Vec<[f64; 3]> = (0..14).map(blob).collect();
        let lumen = (0..w * h).map(|n| {
            let (x, y) = ((n % w) as f64 / w as f64, (n / w) as f64 / h as f64);
            blobs.iter().any(|b| (x - b[0]).hypot(y - b[1]) < 0.05 + 0.12 * b[2])
        });
        let Ok(drawing) = Drawing::new("blobs", ImageSize::new(w, h), lumen.collect()) else { continue };
        let settings = PlaneSettings { seconds: 40.0, ..PlaneSettings::default() };
        let twice = [(); 2].map(|()| fly(drawing.clone(), settings.clone()).flight);
        assert_eq!(digest(twice[0].places()), digest(twice[1].places()));
        assert!(twice[0].places().iter().all(|p| twice[0].walls().is_lumen(*p)), "{seed}");
    }
}

#[test]
fn pictures_are_whole_however_the_flight_ends() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    run(&["plane", "straight", "--headless", "--out", &at("a.png")], 0);
    let out = run(&["plane", "neck", "--headless", "--out", &at("b.gif")], 4);
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(said.contains("narrower than the camera") && said.contains("flight at "), "{said}");
    run(&["plane", "ring", "--headless", "--out", &at("c.png")], 4);
    for (file, size) in [("a.png", (720, 240)), ("b.gif", (720, 240)), ("c.png", (600, 480))] {
        assert_eq!(image::image_dimensions(at(file)).unwrap(), size, "{file}");
    }
    // A drawing from a file works like a shipped one.
    std::fs::write(at("mine.png"), DRAWINGS[1].1).unwrap();
    run(&["plane", &at("mine.png"), "--headless", "--out", &at("d.png")], 0);
    assert!(std::fs::read(at("a.png")).unwrap() == std::fs::read(at("d.png")).unwrap());
}

#[test]
fn what_cannot_be_drawn_or_written_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let grey = |name: &str, w, h, g| {
        image::GrayImage::from_pixel(w, h, image::Luma([g])).save(at(name)).unwrap();
        at(name)
    };
    std::fs::write(at("text.png"), "no picture").unwrap();
    for (file, why) in [
        (grey("one.png", 1, 1, 255), "too small"),
        (grey("wall.png", 64, 64, 0), "no lumen"),
        (grey("lumen.png", 64, 64, 255), "no wall"),
        (grey("large.png", 16_384, 16_384, 255), "more than 4096"),
        (at("text.png"), "not a readable PNG"),
        (at("absent.png"), "cannot be read"),
        (at(""), "cannot be read"),
    ] {
        let out = run(&["plane", &file, "--headless", "--out", &at("x.png")], 3);
        let said = String::from_utf8_lossy(&out.stderr);
        assert!(said.contains(why), "{file}: {said}");
        assert!(!dir.path().join("x.png").exists(), "nothing is written");
    }
    let usage: [&[&str]; 3] = [
        &["plane", "straight", "--headless"],
        &["plane", "straight", "--out", "x.png"],
        &["plane", "straight", "--headless", "--out", "x.bmp"],
    ];
    for args in usage {
        run(args, 2);
    }
    run(&["plane", "straight", "--headless", "--out", &at("none/x.png")], 5);
    assert_eq!(MM_PER_PIXEL, 0.5, "as README and help have it");
}

/// Flies a drawing with a scene file and returns the picture's bytes and the output.
fn by_scene(drawing: &str, scene: Option<&str>, status: i32) -> (Vec<u8>, String) {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (out, file) = (at("a.png"), at("s.toml"));
    let mut args = vec!["plane", drawing, "--headless", "--out", &out];
    if let Some(text) = scene {
        std::fs::write(&file, text).unwrap();
        args.extend(["--scene", &file]);
    }
    let said = run(&args, status);
    (std::fs::read(&out).unwrap_or_default(), String::from_utf8_lossy(&said.stderr).into_owned())
}

#[test]
#[ignore = "slow: eleven runs of the program"]
fn a_scene_file_has_the_settings() {
    let all = "plugins = [\"tentacles\", \"mines\", \"watch\"]\n";
    let (usual, told) = by_scene("bends", None, 0);
    // A scene without settings is the default.
    assert!(by_scene("bends", Some(all), 0).0 == usual);
    // Each setting changes the flight.
    let seconds = |told: &str| told.split_whitespace().rev().nth(1).unwrap().parse::<f64>().unwrap();
    let (slow, told_slow) = by_scene("bends", Some(&format!("{all}[tentacles]\ncruise_mm_s = 15")), 0);
    assert!(slow != usual && seconds(&told_slow) > 1.6 * seconds(&told), "{told_slow}");
    for setting in [
        "[tentacles]\ncount = 24",
        "[tentacles]\nwall_push = 200",
        "[mines]\nkept = 2",
        "[mines]\npush = 400",
        "[body]\nradius_mm = 3",
        "[body]\ndrag_per_s = 3",
    ] {
        assert!(by_scene("bends", Some(&format!("{all}{setting}")), 0).0 != usual, "{setting}");
    }
    assert!(by_scene("bends", Some("plugins = [\"tentacles\", \"watch\"]"), 0).0 != usual, "without mines");
    // Without the trap watch, the neck holds the camera until time is over, and the operator is not called.
    let (_, told) = by_scene("neck", Some("plugins = [\"tentacles\", \"mines\"]"), 0);
    assert!(told.contains("time is over"), "{told}");
    // Settings that do not apply to a drawing are reported.
    let (same, told) = by_scene("bends", Some(&format!("{all}[potential]\nreach_mm = 5")), 0);
    assert!(same == usual && told.contains("[potential] does not apply to a drawing"), "{told}");
}

#[test]
fn a_scene_that_no_drawing_can_be_flown_by_is_refused() {
    let all = "plugins = [\"tentacles\", \"mines\", \"watch\"]\n";
    for (scene, why) in [
        (format!("{all}[tentacles]\nfeelers = 9"), "feelers"),
        (format!("{all}[tentacles]\ncount = 2"), "tentacles.count"),
        (format!("{all}[mines]\nspacing_mm = 0"), "mines.spacing_mm"),
        (format!("{all}[warp]\nspeed = 9"), "warp"),
        ("plugins = [\"tentacles\", \"warp\"]".to_owned(), "warp"),
        ("plugins = [\"tentacles\", \"render\"]".to_owned(), "is not rendered"),
        ("plugins = []".to_owned(), "names no guide"),
        ("plugins".to_owned(), "s.toml"),
    ] {
        let (picture, told) = by_scene("straight", Some(&scene), 2);
        assert!(picture.is_empty() && told.contains(why) && told.lines().count() == 1, "{scene}: {told}");
    }
    // Shipped scenes: those of tentacles are flown, the others are refused with the name of their guide.
    for (name, refused) in [
        ("tentacles", None),
        ("tentacles-without-mines", None),
        ("path", Some("uses the guide path")),
        ("potential", Some("uses the guide potential")),
        ("manual", Some("uses the guide manual")),
        ("render", Some("names no guide")),
    ] {
        let text = std::fs::read_to_string(format!("assets/scenes/{name}.toml")).unwrap();
        let (_, told) = by_scene("straight", Some(&text), if refused.is_some() { 2 } else { 0 });
        assert!(told.contains(refused.unwrap_or("arrived at")), "{name}: {told}");
    }
    run(&["plane", "straight", "--headless", "--out", "x.png", "--scene", "assets/scenes/none.toml"], 3);
    // Inputs are not overwritten.
    run(&["plane", "--headless", "--out", "assets/plane/fork.png", "--scene", "assets/plane/fork.png"], 2);
}
