//! A parameter search for tentacles and mines: each parameter changed alone, then many at once.
//!
//! It flies on standard phantoms with everything on, on real scans, and on the ten drawn lumens with traps in three
//! dimensions. It prints CSV; `assets/tuning/tentacles.csv` is its output.
//!
//! ```sh
//! cargo bench -p colvis-bench --bench tune -- SCAN.nii.gz … > tune.csv     # the scans both ways, the drawn lumens, phantoms 1 to 10
//! cargo bench -p colvis-bench --bench tune -- --seeds 1,2 --around 0       # fewer seeds, one change at a time
//! ```

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use colvis::app::Scene;
use colvis::dynamics::tentacles::TentacleSettings;
use colvis::math::hash;
use colvis::phantom::PhantomSettings;
use colvis::plane::shipped::{DRAWINGS, named};
use colvis::progress::Progress;
use colvis::render::{PreparedVolume, TransferFunction};
use colvis::report::trials::{self, Course, Trial};
use colvis::volume::io::{self, LoadOptions};
use rayon::prelude::*;

/// The maximum simulated time of a flight, seconds.
const SECONDS: f64 = 150.0;
/// Number of settings with several parameters changed at once.
const AROUND: u64 = 12;

type Set = fn(&mut Scene, f64);

/// The searched parameters: name, values (including the default), and the function that sets a value.
const PARAMETERS: [(&str, &[f64], Set); 12] = [
    ("tentacles.count", &[16.0, 32.0, 64.0, 128.0, 256.0, 512.0], |s, v| {
        s.guides.edit::<TentacleSettings>(|t| t.count = v as usize);
    }),
    ("tentacles.reach_mm", &[40.0, 75.0, 150.0, 300.0], |s, v| s.guides.edit::<TentacleSettings>(|t| t.reach_mm = v)),
    ("tentacles.wall_mm", &[4.0, 7.0, 10.0, 14.0, 20.0], |s, v| s.guides.edit::<TentacleSettings>(|t| t.wall_mm = v)),
    ("tentacles.wall_push", &[0.0, 20.0, 60.0, 180.0, 600.0], |s, v| {
        s.guides.edit::<TentacleSettings>(|t| t.wall_push = v);
    }),
    ("tentacles.cruise_mm_s", &[10.0, 30.0, 60.0, 120.0], |s, v| {
        s.guides.edit::<TentacleSettings>(|t| t.cruise_mm_s = v);
    }),
    ("tentacles.agreement", &[0.0, 1.0, 2.0, 4.0, 8.0], |s, v| s.guides.edit::<TentacleSettings>(|t| t.agreement = v)),
    ("tentacles.mine_cone", &[0.1, 0.3, 0.6, 1.0], |s, v| s.guides.edit::<TentacleSettings>(|t| t.mine_cone = v)),
    ("mines.kept", &[0.0, 4.0, 12.0, 48.0], |s, v| mines(s).kept = v as usize),
    ("mines.spacing_mm", &[2.0, 4.0, 8.0, 16.0, 32.0], |s, v| mines(s).spacing_mm = v),
    ("mines.reach_mm", &[8.0, 15.0, 25.0, 50.0], |s, v| mines(s).reach_mm = v),
    ("mines.push", &[0.0, 20.0, 60.0, 180.0], |s, v| mines(s).push = v),
    ("body.drag_per_s", &[2.0, 6.0, 18.0], |s, v| s.body.drag_per_s = v),
];

fn mines(scene: &mut Scene) -> &mut colvis::dynamics::mines::MineSettings {
    scene.mines.get_or_insert_default()
}

/// Returns every setting to try, with its name, the defaults first.
fn candidates(around: u64) -> Vec<(String, Scene)> {
    let mut all = vec![("default".to_owned(), Scene::default())];
    for (name, values, set) in PARAMETERS {
        for &v in values {
            let mut scene = Scene::default();
            set(&mut scene, v);
            if format!("{scene:?}") != format!("{:?}", Scene::default()) {
                all.push((format!("{name}={v}"), scene));
            }
        }
    }
    // The neighbourhood: each parameter except count and speed times 0.5 to 2, all at once.
    for n in 0..around {
        let mut scene = Scene::default();
        let mut name = Vec::new();
        let mut factor = |k: u64, what: &str, value: f64| {
            let v = value * 2f64.powf(2.0 * hash::uniform(23, 16 * n + k) - 1.0);
            name.push(format!("{what}={v:.2}"));
            v
        };
        let mut t = scene.guides.get::<TentacleSettings>();
        t.wall_mm = factor(0, "wall_mm", t.wall_mm);
        t.wall_push = factor(1, "wall_push", t.wall_push);
        t.agreement = factor(2, "agreement", t.agreement);
        t.mine_cone = factor(3, "mine_cone", t.mine_cone);
        scene.guides.set(t);
        let m = mines(&mut scene);
        m.spacing_mm = factor(4, "spacing_mm", m.spacing_mm);
        m.reach_mm = factor(5, "reach_mm", m.reach_mm);
        m.push = factor(6, "push", m.push);
        all.push((name.join(" "), scene));
    }
    all
}

fn main() {
    // Cargo runs benches in the folder of their package. Files are given from the root, where cargo is called.
    std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).expect("the root");
    // Cargo adds --bench. Everything that is not an option is a scan.
    let args: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let value = |name: &str| args.iter().position(|a| a == name).and_then(|i| args.get(i + 1));
    let number = |s: &str| s.parse::<u64>().unwrap_or_else(|_| panic!("{s} is no number"));
    let list = |s: &String| s.split(',').filter(|n| !n.is_empty()).map(number).collect();
    let seeds: Vec<u64> = value("--seeds").map_or((1..=10).collect(), list);
    let around = value("--around").map_or(AROUND, |s| number(s));
    let is_scan = |i: usize| !args[i].starts_with("--") && (i == 0 || !args[i - 1].starts_with("--"));
    let scans = (0..args.len()).filter(|&i| is_scan(i)).map(|i| args[i].clone());
    let progress = Progress::new();
    let all = candidates(around);
    println!(
        "course,settings,state,reason,seconds,length_mm,escapes,least_clearance_mm,mean_clearance_mm,offset,jerk_mm_s3"
    );
    let phantom = |seed: &u64| {
        let settings = PhantomSettings { seed: *seed, fluid: true, bridges: true, ..PhantomSettings::default() };
        (format!("phantom {seed}"), Course::phantom(&settings, &progress).expect("a phantom"))
    };
    let scan = |path: String| {
        let volume = io::load(Path::new(&path), &LoadOptions::default(), &progress).expect("a scan").volume;
        let course = Course::new(PreparedVolume::new(Arc::new(volume), TransferFunction::default()), None, &progress);
        let name = Path::new(&path).file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned());
        (name, course.expect("a colon"))
    };
    let drawn = |(name, _): &(&str, &[u8])| {
        let drawing = named(name).expect("a picture").expect("a drawing");
        (format!("drawn {name}"), Course::drawn(&drawing, &progress).expect("a lumen"))
    };
    // One volume at a time, and scans in both directions.
    let courses = scans.map(|s| (true, scan(s)));
    let courses = courses.chain(DRAWINGS.iter().map(|d| (false, drawn(d))));
    for (both, (name, there)) in courses.chain(seeds.iter().map(|s| (false, phantom(s)))) {
        let back = both.then(|| there.reversed(&progress).expect("a way back"));
        for (way, course) in [("", Some(&there)), (" reversed", back.as_ref())] {
            let Some(course) = course else { continue };
            let flown: Vec<Trial> =
                all.par_iter().map(|(_, scene)| trials::fly(course, scene, SECONDS).expect("a flight")).collect();
            let mut out = std::io::stdout().lock();
            for ((settings, _), t) in all.iter().zip(flown) {
                let offset = t.offset.map_or(String::new(), |o| format!("{o:.4}"));
                let (least, mean) = t.clearance_mm;
                writeln!(
                    out,
                    "{name}{way},{settings},{:?},{},{:.2},{:.0},{},{least:.2},{mean:.2},{offset},{:.0}",
                    t.state,
                    t.reason.replace(',', ";"),
                    t.seconds,
                    t.length_mm,
                    t.escapes,
                    t.jerk
                )
                .expect("standard output");
            }
        }
    }
}
