use glam::{DMat3, DVec3};

use super::*;
use crate::fields::lumen;
use crate::math::{hash, normal};
use crate::volume::Grid;

const SIGMA: f64 = 0.6;

/// A capsule of gas of 14 mm radius along z in tissue, 140 mm long, with tag below a level: (scan, the same without tag). `flip` turns
/// it upside down.
fn capsule(tag: f64, level: f64, noise: f64, flip: bool) -> (Volume, Volume) {
    let dims = [72, 72, 200];
    let grid = Grid::new(dims, DVec3::splat(0.8), DVec3::new(-28.4, -28.4, -79.6), DMat3::IDENTITY).unwrap();
    let make = |tag: f64| {
        let value = |n: usize| {
            let v = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|c| c as f64);
            let p = grid.world(DVec3::from_array(v));
            let axis = DVec3::new(0.0, 0.0, p.z.clamp(-56.0, 56.0));
            let tissue = normal::cdf((p.distance(axis) - 14.0) / SIGMA);
            let y = if flip { -p.y } else { p.y };
            let inside = -1000.0 + (tag + 1000.0) * normal::cdf((y - level) / SIGMA);
            (40.0 * tissue + inside * (1.0 - tissue) + noise * hash::normal(5, n as u64)).round() as i16
        };
        Volume::new(grid.clone(), (0..grid.len()).map(value).collect())
    };
    (make(tag), make(-1000.0))
}

/// The same in tissue with a ball of 4 mm radius on its floor, and tag of `hu` at a position (mm) below the level y = 0: (scan, the same
/// without tag). The tag's own boundary is as sharp as `hu` makes it.
fn with_ball(hu: impl Fn(DVec3) -> f64) -> (Volume, Volume) {
    let dims = [60, 60, 90];
    let grid = Grid::new(dims, DVec3::splat(0.8), DVec3::new(-23.6, -23.6, -35.6), DMat3::IDENTITY).unwrap();
    let make = |is_tagged: bool| {
        let value = |n: usize| {
            let v = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|c| c as f64);
            let p = grid.world(DVec3::from_array(v));
            let axis = DVec3::new(0.0, 0.0, p.z.clamp(-22.0, 22.0));
            let wall = (p.distance(axis) - 14.0).max(4.0 - p.distance(BALL));
            let tissue = normal::cdf(wall / SIGMA);
            let tag = if is_tagged { hu(p) } else { -1000.0 };
            let inside = -1000.0 + (tag + 1000.0) * normal::cdf(p.y / SIGMA);
            (40.0 * tissue + inside * (1.0 - tissue) + 12.0 * hash::normal(5, n as u64)).round() as i16
        };
        Volume::new(grid.clone(), (0..grid.len()).map(value).collect())
    };
    (make(true), make(false))
}

/// The middle of the ball.
const BALL: DVec3 = DVec3::new(0.0, 11.0, 0.0);

/// Returns what was found, and the volume without it.
fn cleansed(scan: &Volume) -> (Cleansed, Volume) {
    let lumen = lumen::find(scan, &Progress::new()).unwrap();
    let made = cleanse(scan, &lumen, &Progress::new()).unwrap();
    let volume = made.changes.applied(scan);
    (made, volume)
}

/// Returns mean and largest difference of two volumes over the voxels that a scan and its clean twin differ in.
fn difference(scan: &Volume, clean: &Volume, made: &Volume) -> (f64, f64) {
    let changed = (0..scan.data().len()).filter(|&n| (scan.data()[n] - clean.data()[n]).abs() > 60);
    let off: Vec<f64> = changed.map(|n| f64::from(made.data()[n] - clean.data()[n]).abs()).collect();
    (off.iter().sum::<f64>() / off.len() as f64, off.iter().fold(0.0, |a, b| b.max(a)))
}

#[test]
fn the_wall_comes_back_under_fluid_of_any_brightness_on_either_side() {
    for (tag, level, flip) in [(450.0, 2.0, false), (250.0, -3.0, false), (1000.0, 5.0, true)] {
        let (scan, clean) = capsule(tag, level, 0.0, flip);
        let (made, volume) = cleansed(&scan);
        assert_eq!(made.pools.len(), 1);
        let pool = made.pools[0];
        assert!((pool.tag_hu - tag).abs() < 0.05 * tag, "{pool:?}");
        let down = if flip { -1.0 } else { 1.0 };
        assert!(
            (pool.level[0].y * down - level).abs() < 0.15 && pool.level[1].dot(DVec3::Y * -down) > 0.9999,
            "{pool:?}"
        );
        let (mean, most) = difference(&scan, &clean, &volume);
        println!("{tag} HU: {mean:.1} HU off in the mean, at most {most:.0}");
        assert!(mean < 12.0 && most < 200.0, "{tag}: {mean} {most}");
    }
}

/// Layered tag, a dark patch, and tag that is twice as dense around the ball. With its mean over some millimetres, and without regard to the
/// wall's curvature, the ball loses 16, 9 and 40 % of its volume.
#[test]
fn a_polyp_keeps_its_volume_in_tag_that_is_not_the_same_everywhere() {
    type Tag = (&'static str, f64, fn(DVec3) -> f64);
    let tags: [Tag; 3] = [
        ("layers", 0.08, |p| 250.0 + 25.0 * p.y.max(0.0)),
        ("a patch", 0.04, |p| {
            600.0 - 220.0 * normal::cdf((5.0 - p.distance(BALL + DVec3::new(0.0, -2.0, 9.0))) / SIGMA)
        }),
        ("a coat", 0.11, |p| 350.0 + 400.0 * normal::cdf((6.0 - p.distance(BALL)) / SIGMA)),
    ];
    for (name, most, tag) in tags {
        let (scan, clean) = with_ball(tag);
        let made = cleansed(&scan).1;
        let tissue = |volume: &Volume, is_ours: &dyn Fn(DVec3) -> bool| -> f64 {
            let share = |n: usize| {
                let v = [n % 60, n / 60 % 60, n / 3600].map(|c| c as f64);
                let p = scan.grid().world(DVec3::from_array(v));
                let is_within = p.truncate().length() < 12.0 && p.y > 2.0 && is_ours(p);
                if is_within { (f64::from(volume.data()[n]) + 1000.0) / 1040.0 } else { 0.0 }
            };
            (0..scan.data().len()).map(share).sum()
        };
        let at_ball = |p: DVec3| p.distance(BALL) < 6.0;
        let off = tissue(&made, &at_ball) / tissue(&clean, &at_ball) - 1.0;
        let beside = |p: DVec3| p.distance(BALL) > 6.0 && p.z.abs() < 20.0;
        let floats = (tissue(&made, &beside) - tissue(&clean, &beside)) / tissue(&clean, &at_ball);
        println!("{name}: the ball is off by {:.1} %, {:.1} % of it beside it", 100.0 * off, 100.0 * floats);
        assert!(off.abs() < most && floats.abs() < 0.3, "{name}: {off} {floats}");
    }
}

/// A lump of faint stool under the ceiling and a bright skin as faint beside it, above dense fluid: stool is thick, a wall with contrast
/// agent is not.
#[test]
fn a_faint_lump_goes_and_a_wall_as_bright_stays() {
    const LUMP: DVec3 = DVec3::new(0.0, -9.0, 10.0);
    let grid = Grid::new([60, 60, 90], DVec3::splat(0.8), DVec3::new(-23.6, -23.6, -35.6), DMat3::IDENTITY).unwrap();
    let value = |n: usize| {
        let p = grid.world(DVec3::from_array([n % 60, n / 60 % 60, n / 3600].map(|c| c as f64)));
        let wall = p.distance(DVec3::new(0.0, 0.0, p.z.clamp(-22.0, 22.0))) - 14.0;
        let skin =
            normal::cdf((1.5 - wall) / SIGMA) * normal::cdf((-4.0 - p.z) / SIGMA) * normal::cdf((-4.0 - p.y) / SIGMA);
        let inside = -1000.0 + 1900.0 * normal::cdf((p.y - 4.0) / SIGMA);
        let lump = normal::cdf((5.0 - p.distance(LUMP)) / SIGMA);
        let inside = inside + (300.0 - inside) * lump;
        let tissue = normal::cdf(wall / SIGMA);
        ((40.0 + 260.0 * skin) * tissue + inside * (1.0 - tissue) + 12.0 * hash::normal(5, n as u64)).round() as i16
    };
    let scan = Volume::new(grid.clone(), (0..grid.len()).map(value).collect());
    let made = cleansed(&scan).1;
    let share = |is_one: &dyn Fn(DVec3) -> bool, hu: std::ops::Range<i16>| {
        let own = (0..grid.len())
            .filter(|&n| is_one(grid.world(DVec3::from_array([n % 60, n / 60 % 60, n / 3600].map(|c| c as f64)))));
        let (count, all) = own
            .fold([0.0, 0.0], |[c, all], n| [c + f64::from(u8::from(hu.contains(&made.data()[n]))), all + 1.0])
            .into();
        count / all
    };
    let wall = |p: DVec3| p.truncate().length() - 14.0;
    let left = share(&|p| p.distance(LUMP) < 4.0 && wall(p) < -2.0, -650..i16::MAX);
    let lost = share(&|p| (0.3..1.3).contains(&wall(p)) && p.y < -5.0 && (-20.0..-6.0).contains(&p.z), i16::MIN..-200);
    println!("{:.1} % of the lump remain, {:.1} % of the wall are lost", 100.0 * left, 100.0 * lost);
    assert!(left < 0.05 && lost == 0.0, "{left} {lost}");
}

#[test]
fn the_blur_of_a_scan_is_found_with_and_without_noise_and_tag() {
    for (noise, level) in [(0.0, 0.0), (22.0, 2.0), (22.0, 0.0), (5.0, -4.0)] {
        let (scan, _) = capsule(450.0, level, noise, false);
        let found = scanner::blur_mm(&scan, &lumen::find(&scan, &Progress::new()).unwrap());
        assert!((found - SIGMA).abs() < 0.1, "{found} mm with noise {noise}");
    }
}

#[test]
fn noise_under_fluid_is_no_more_than_beside_it() {
    let (scan, clean) = capsule(450.0, 0.0, 22.0, false);
    let made = cleansed(&scan).1;
    let spread = |wet: bool| {
        let own = (0..scan.data().len()).filter(|&n| {
            let p = scan.grid().world(DVec3::from_array([n % 72, n / 72 % 72, n / 72 / 72].map(|c| c as f64)));
            // Around the wall, off the level.
            (p.truncate().length() - 14.0).abs() < 0.8 && p.z.abs() < 50.0 && if wet { p.y > 4.0 } else { p.y < -4.0 }
        });
        let truth = capsule_truth(scan.grid());
        let off: Vec<f64> = own.map(|n| f64::from(made.data()[n]) - truth[n]).collect();
        (off.iter().map(|d| d * d).sum::<f64>() / off.len() as f64).sqrt()
    };
    let (wet, dry) = (spread(true), spread(false));
    println!("noise of {wet:.1} HU under fluid, {dry:.1} beside it");
    assert!(wet < 1.2 * dry, "{wet} {dry}");
    assert!(difference(&scan, &clean, &made).0 < 30.0);
}

/// The capsule without tag and noise.
fn capsule_truth(grid: &Grid) -> Vec<f64> {
    let (_, clean) = capsule(450.0, 0.0, 0.0, false);
    assert_eq!(clean.grid(), grid);
    clean.data().iter().map(|&hu| f64::from(hu)).collect()
}

#[test]
fn what_is_far_from_tag_keeps_its_value_and_a_clean_scan_all_of_them() {
    let (scan, clean) = capsule(450.0, 3.0, 22.0, false);
    let made = cleansed(&scan).1;
    for n in 0..scan.data().len() {
        let [_, y, _] = [n % 72, n / 72 % 72, n / 72 / 72];
        // The level is at 3 mm, which is row 39.
        if y < 32 {
            assert_eq!(made.data()[n], scan.data()[n]);
        }
    }
    let (same, volume) = cleansed(&clean);
    assert!(same.pools.is_empty() && same.changes.is_empty() && volume.data() == clean.data());
}

#[test]
fn a_flight_keeps_every_wall_and_tells_what_it_sees() {
    let (scan, _) = capsule(450.0, 3.0, 22.0, false);
    let lumen = lumen::find(&scan, &Progress::new()).unwrap();
    let made = to_fly(&scan, &lumen, &Progress::new()).unwrap();
    let flown = made.changes.applied(&scan);
    for (n, mark) in lumen.mask().into_iter().enumerate() {
        let (before, now) = (scan.data()[n], flown.data()[n]);
        match mark {
            2 => assert!(now < WALL_HU, "fluid of {before} HU is {now}"),
            _ => assert_eq!(now > WALL_HU, before > WALL_HU, "{before} HU became {now}"),
        }
    }
    assert!((made.replaced_ml - lumen.fluid_ml()).abs() < 1e-9 && made.residue_ml == 0.0, "{made:?}");
}

/// The capsule with a level that climbs its sides by `rise` mm, as in a narrow gap, and where it ends: (scan, the same without tag).
fn climbing(tag: f64, rise: f64) -> (Volume, Volume) {
    let (_, clean) = capsule(tag, 2.0, 0.0, false);
    let grid = clean.grid().clone();
    let dims = grid.dims();
    let value = |n: usize| {
        let v = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|c| c as f64);
        let p = grid.world(DVec3::from_array(v));
        let axis = DVec3::new(0.0, 0.0, p.z.clamp(-56.0, 56.0));
        let tissue = normal::cdf((p.distance(axis) - 14.0) / SIGMA);
        // A curve with a capillary length of 2.5 mm.
        let climbs = rise * ((p.x.abs() - 14.0) / 2.5).exp();
        let depth = (p.y - 2.0 + climbs) / (1.0 + (climbs / 2.5).powi(2)).sqrt();
        let inside = -1000.0 + (tag + 1000.0) * normal::cdf(depth / SIGMA);
        (40.0 * tissue + inside * (1.0 - tissue) + 10.0 * hash::normal(5, n as u64)).round() as i16
    };
    (Volume::new(grid.clone(), (0..grid.len()).map(value).collect()), clean)
}

#[test]
fn fluid_that_climbs_the_wall_goes_with_its_pool() {
    for (tag, rise) in [(450.0, 3.0), (700.0, 6.0)] {
        let (scan, clean) = climbing(tag, rise);
        let (made, volume) = cleansed(&scan);
        assert_eq!(made.pools.len(), 1);
        // What is gas without tag, farther than its blur from the wall.
        let lumen = (0..scan.data().len()).filter(|&n| clean.data()[n] < -995);
        let shelf = lumen.clone().filter(|&n| volume.data()[n] > WALL_HU).count();
        let wet = lumen.filter(|&n| scan.data()[n] > WALL_HU).count();
        let (mean, most) = difference(&scan, &clean, &volume);
        println!(
            "{rise} mm up the wall: {shelf} of {wet} voxels remain; {mean:.1} HU off in the mean, at most {most:.0}"
        );
        assert!(shelf * 5000 < wet && mean < 25.0, "{shelf} of {wet}, {mean} HU");
    }
}

/// The capsule without a level, with a lump of tag of some radius (mm) on its wall and a fold across it: either 2 mm thick and coated
/// with 1.5 mm of tag on one side, or so thin (mm) and soaked with tag. Returns the scan and the same without tag.
fn lump_and_fold(tag: f64, radius: f64, soaked: Option<f64>) -> (Volume, Volume) {
    let (_, plain) = capsule(tag, 2.0, 0.0, false);
    let grid = plain.grid().clone();
    let dims = grid.dims();
    let make = |tag: f64| {
        let value = |n: usize| {
            let v = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|c| c as f64);
            let p = grid.world(DVec3::from_array(v));
            let axis = DVec3::new(0.0, 0.0, p.z.clamp(-56.0, 56.0));
            // Blurred half-spaces, which are exact on planes.
            let below = |mm: f64| normal::cdf(-mm / SIGMA);
            let half = below(p.y);
            let [thick, coat] = soaked.map_or([2.0, 1.5], |mm| [mm, 0.0]);
            let fold = (below(p.z - 20.0 - 0.5 * thick) - below(p.z - 20.0 + 0.5 * thick)) * half;
            let coat = (below(p.z - 21.0 - coat) - below(p.z - 21.0)) * half;
            let own = if soaked.is_some() { tag.max(40.0) } else { 40.0 };
            let lump = below(p.distance(DVec3::new(0.0, 13.0 - radius, -20.0)) - radius);
            let inside = -1000.0 + (1000.0 + own) * fold + (tag + 1000.0) * (coat + lump).min(1.0 - fold);
            let tissue = normal::cdf((p.distance(axis) - 14.0) / SIGMA);
            (40.0 * tissue + inside * (1.0 - tissue) + 10.0 * hash::normal(5, n as u64)).round() as i16
        };
        Volume::new(grid.clone(), (0..grid.len()).map(value).collect())
    };
    (make(tag), make(-1000.0))
}

#[test]
fn a_lump_of_tag_between_gas_and_gas_is_removed_and_a_coated_or_soaked_fold_stays() {
    for (tag, radius, soaked) in [(500.0, 2.5, None), (800.0, 3.0, None), (600.0, 3.0, Some(2.2))] {
        let (scan, clean) = lump_and_fold(tag, radius, soaked);
        let volume = cleansed(&scan).1;
        let bright = |v: &Volume, from: usize, to: usize| -> Vec<usize> {
            (72 * 72 * from..72 * 72 * to).filter(|&n| v.data()[n] > WALL_HU).collect()
        };
        // The lump's slices, and the fold's.
        let lump: Vec<usize> = bright(&scan, 65, 85).into_iter().filter(|&n| clean.data()[n] < -900).collect();
        let ghosts = lump.iter().filter(|&&n| volume.data()[n] > WALL_HU).count();
        let fold: Vec<usize> = bright(&clean, 123, 127).into_iter().filter(|&n| clean.data()[n] > -300).collect();
        let lost = fold.iter().filter(|&&n| volume.data()[n] <= WALL_HU).count();
        println!(
            "{tag} HU: {ghosts} of {} voxels of the lump remain, {lost} of {} of the fold are lost",
            lump.len(),
            fold.len()
        );
        assert!(lump.len() > 100 && ghosts * 50 < lump.len(), "{ghosts} of {}", lump.len());
        let share = if soaked.is_some() { 150 } else { 400 };
        assert!(fold.len() > 1000 && lost * share < fold.len(), "{lost} of {}", fold.len());
    }
}
