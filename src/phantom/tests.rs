use std::f64::consts::PI;

use super::room::loop_clearance;
use super::*;
use crate::features::CHANNEL_MM;
use crate::profile::WALL_HU;

fn make(size: Size, seed: u64) -> Phantom {
    Phantom::new(&PhantomSettings { size, seed, ..PhantomSettings::default() })
}

/// A phantom with every feature except noise.
fn quiet(size: Size) -> Phantom {
    Phantom::new(&PhantomSettings { size, fluid: true, bridges: true, noise: false, ..PhantomSettings::default() })
}

/// Returns a position near the colon: arc length, angle and distance from the axis are drawn from `n`.
fn place(phantom: &Phantom, n: u64, most: f64) -> DVec3 {
    let u = |k| hash::uniform(13, 4 * n + k);
    let frame = phantom.shape.axis.frame(phantom.shape.axis.length() * u(0));
    frame.at + frame.direction(6.3 * u(1)) * (most * u(2))
}

/// Returns points on the wall, found by bisection from the axis outwards, with the search direction.
fn wall_points(phantom: &Phantom, count: u64) -> Vec<(DVec3, DVec3)> {
    let axis = &phantom.shape.axis;
    let find = |n: u64| {
        let u = |k| hash::uniform(11, 4 * n + k);
        let frame = axis.frame(10.0 + (axis.length() - 20.0) * u(0));
        let out = frame.direction(6.3 * u(1));
        let (mut lo, mut hi) = (0.0, 40.0);
        while hi - lo > 4e-12 {
            let mid = 0.5 * (lo + hi);
            if phantom.wall(frame.at + out * mid) < 0.0 { lo = mid } else { hi = mid }
        }
        (frame.at + out * lo, out)
    };
    (0..count).map(find).collect()
}

#[test]
fn the_wall_is_where_the_value_is() {
    let phantom = make(Size::Standard, 1);
    for (p, out) in wall_points(&phantom, 300) {
        assert!((phantom.value(p) - WALL_HU).abs() < 1e-5, "{p}: {}", phantom.value(p));
        assert!(phantom.value(p - out * 1e-4) < WALL_HU && phantom.value(p + out * 1e-4) > WALL_HU);
    }
}

#[test]
fn the_gradient_is_the_values_and_the_walls_blur_is_as_wide_everywhere() {
    let phantom = make(Size::Standard, 2);
    // Derivative of the blurred edge at the wall, per mm of true distance.
    let h = 1e-5;
    let edge = |d| mix(GAS, TISSUE, tissue_share(d, phantom.sigma));
    let slope = (edge(h) - edge(-h)) / (2.0 * h);
    let (mut lengths, mut leans) = (Vec::new(), Vec::new());
    for (p, _) in wall_points(&phantom, 300) {
        let g = phantom.gradient(p);
        // Two-point differences at two step sizes, extrapolated: an independent route to the same derivative.
        let n = g.normalize();
        let by = |h: f64| (phantom.value(p + n * h) - phantom.value(p - n * h)) / (2.0 * h);
        let along = (4.0 * by(4e-4) - by(8e-4)) / 3.0;
        assert!((along - g.length()).abs() < 1e-3 * slope, "{p}: {along} {}", g.length());
        let normal = phantom.distances_among(p, &[phantom.all_knots()]).0.normal;
        let lean = n.dot(normal).clamp(-1.0, 1.0).acos().to_degrees();
        leans.push(lean);
        // Along the wall the value is constant.
        let across = n.any_orthonormal_vector() * 1e-4;
        assert!((phantom.value(p + across) - phantom.value(p - across)).abs() < 2e-3, "{p}");
        lengths.push(g.length() / slope);
    }
    lengths.sort_by(f64::total_cmp);
    leans.sort_by(f64::total_cmp);
    assert!(lengths[15] > 0.95 && lengths[285] < 1.05, "{} {}", lengths[15], lengths[285]);
    // The closed-form normal is exact except in fillets.
    assert!(leans[150] < 0.01 && leans[270] < 4.0, "{} {}", leans[150], leans[270]);
}

#[test]
fn a_flight_has_room_about_the_axis_for_every_seed() {
    for size in [Size::Small, Size::Standard] {
        for seed in 1..=20 {
            let phantom = make(size, seed);
            let axis = &phantom.shape.axis;
            let range = if size == Size::Small { 600.0..850.0 } else { 1200.0..1500.0 };
            assert!(range.contains(&axis.length()), "{size:?} {seed}: {} mm", axis.length());
            let mut s = 0.0;
            while s <= axis.length() {
                let frame = axis.frame(s);
                for k in 0..12 {
                    let p = frame.at + frame.direction(f64::from(k) * PI / 6.0) * (CHANNEL_MM - 0.9);
                    assert!(phantom.wall(p) < 0.0, "{size:?} {seed}: {s} mm, {k}: {}", phantom.wall(p));
                }
                s += 2.3;
            }
        }
    }
}

#[test]
fn loops_and_borders_are_apart_for_every_seed() {
    for size in [Size::Small, Size::Standard] {
        for seed in 1..=20 {
            let phantom = make(size, seed);
            let axis = &phantom.shape.axis;
            assert!(loop_clearance(axis) >= 4.0, "{size:?} {seed}: {}", loop_clearance(axis));
            let grid = phantom.grid();
            let [nx, ny, nz] = grid.dims();
            let far = grid.world(DVec3::new(nx as f64 - 1.0, ny as f64 - 1.0, nz as f64 - 1.0));
            for (i, c) in axis.knots().iter().enumerate() {
                let r = phantom.shape.largest_radius(i as f64 * axis.knot_step());
                let room = (*c - grid.origin()).min(far - *c).min_element() - r;
                assert!(room >= 12.0, "{size:?} {seed}: {room} mm at {c}");
            }
        }
    }
}

#[test]
#[ignore = "slow: the voxels of a phantom"]
fn the_true_volume_is_the_voxels() {
    let phantom =
        Phantom::new(&PhantomSettings { size: Size::Small, bridges: true, noise: false, ..PhantomSettings::default() });
    let grid = phantom.grid();
    let volume = phantom.voxelise(&grid, &Progress::new()).unwrap();
    let mut count = 0;
    for (n, _) in volume.data().iter().enumerate().filter(|&(_, &hu)| f64::from(hu) < WALL_HU) {
        let [nx, ny, _] = grid.dims();
        let p = grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64));
        // Exclude the air outside and the lung.
        count += usize::from(phantom.body.value(p) > -500.0);
    }
    let (counted, truth) = (count as f64 * grid.voxel_ml(), phantom.truth());
    assert!((counted / truth.lumen_ml - 1.0).abs() < 0.01, "{counted} ml, {} ml", truth.lumen_ml);
    assert_eq!(truth.centerline.len(), truth.radius_mm.len());
    let json = serde_json::to_value(&truth).unwrap();
    assert_eq!(json["wall_hu"], -650);
    assert!(json["length_mm"].as_f64() == Some(truth.length_mm) && json["lumen_ml"].is_f64());
    assert_eq!(json["centerline"][3][2].as_f64(), Some(truth.centerline[3].z));
    assert!(json["polyps"][0]["position"][2].is_f64() && json["polyps"][0]["diameter_mm"].is_f64());
    assert!(truth.centerline[0].z < -70.0 && truth.centerline.last().unwrap().x < -40.0, "rectum low, cecum right");
}

/// A coarse grid over the small body with everything that a scanner can do to it: oblique, flipped, anisotropic.
fn odd_grid() -> Grid {
    let direction =
        DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-0.2) * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0));
    let spacing = DVec3::new(2.1, 2.9, 3.7);
    let dims = [91, 61, 69];
    let half = DVec3::new(45.0, 30.0, 34.0) * spacing;
    Grid::new(dims, spacing, -(direction * half), direction).unwrap()
}

#[test]
fn any_grid_holds_the_same_body() {
    let phantom = quiet(Size::Small);
    let grid = odd_grid();
    let volume = phantom.voxelise(&grid, &Progress::new()).unwrap();
    let [nx, ny, nz] = grid.dims();
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let hu = phantom.value(grid.world(DVec3::new(i as f64, j as f64, k as f64)));
                let voxel = f64::from(volume.data()[grid.index(i, j, k)]);
                assert!((voxel - hu).abs() <= 0.5 + 1e-6, "{i} {j} {k}: {voxel}, {hu}");
            }
        }
    }
}

#[test]
#[ignore = "slow: the voxels of a phantom on one thread and two"]
fn one_thread_and_two_give_the_same_voxels_and_truth() {
    let phantom = Phantom::new(&PhantomSettings { size: Size::Small, fluid: true, ..PhantomSettings::default() });
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (phantom.voxelise(&odd_grid(), &Progress::new()).unwrap(), phantom.truth()))
    };
    assert!(run(1) == run(2));
}

#[test]
fn the_seed_and_nothing_else_decides() {
    for size in [Size::Small, Size::Standard] {
        let knot = |seed| make(size, seed).shape.axis.knots()[40].to_array().map(f64::to_bits);
        assert_eq!(knot(3), knot(3));
        let all: std::collections::BTreeSet<_> = (1..=20).map(knot).collect();
        assert_eq!(all.len(), 20, "{size:?}: every seed its own colon");
    }
}

#[test]
fn noise_has_its_strength() {
    let phantom = make(Size::Small, 1);
    let grid = odd_grid();
    let noisy = phantom.voxelise(&grid, &Progress::new()).unwrap();
    let clean = Phantom::new(&PhantomSettings { noise: false, ..*phantom.settings() })
        .voxelise(&grid, &Progress::new())
        .unwrap();
    let difference: Vec<f64> =
        noisy.data().iter().zip(clean.data()).map(|(a, b)| f64::from(*a) - f64::from(*b)).collect();
    let n = difference.len() as f64;
    let mean = difference.iter().sum::<f64>() / n;
    let sd = (difference.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n).sqrt();
    assert!(mean.abs() < 0.2 && (sd / NOISE_HU - 1.0).abs() < 0.02, "mean {mean}, sd {sd}");
}

#[test]
fn polyps_are_where_and_as_large_as_stated() {
    for seed in 1..=5 {
        let phantom = make(Size::Standard, seed);
        let polyps = phantom.polyps();
        assert!((6..=10).contains(&polyps.len()));
        for polyp in &polyps {
            assert!((4.0..=12.0).contains(&polyp.diameter_mm), "{polyp:?}");
            assert!(phantom.value(polyp.position) > -50.0, "{polyp:?} is tissue");
            let foot = phantom.nearest(polyp.position).unwrap();
            let top = polyp.position - foot.offset / foot.rho * (0.5 * polyp.diameter_mm);
            assert!(phantom.wall(top).abs() < 0.3, "{polyp:?}: {}", phantom.wall(top));
        }
    }
}

#[test]
fn one_polyp_can_be_put_on_a_side() {
    let settings = PhantomSettings { size: Size::Small, folds: false, ..PhantomSettings::default() };
    let base = Phantom::new(&settings);
    let s = 0.45 * base.shape.axis.length();
    let bare = Phantom::new(&PhantomSettings { polyps: false, ..settings });
    let at = base.shape.axis.frame(s).at;
    for side in [DVec3::X, DVec3::NEG_X] {
        let polyp = base.polyp_at(s, side, 7.0);
        let phantom = Phantom::with_polyps(&settings, &[polyp]);
        assert_eq!(phantom.polyps().len(), 1);
        assert!((polyp.position - at).dot(side) > 4.0, "{side}: {}", polyp.position - at);
        let top = polyp.position + (at - polyp.position).normalize() * 1.5;
        assert!(phantom.value(top) > -50.0 && bare.value(top) < -990.0, "{side}");
    }
}

#[test]
fn fluid_lies_behind_a_horizontal_level_and_is_closed_in() {
    for size in [Size::Small, Size::Standard] {
        let phantom = quiet(size);
        assert!(!phantom.pools.is_empty());
        for pool in &phantom.pools {
            let (mut fluid, mut gas) = (0, 0);
            for n in 0..40_000 {
                let p = place(&phantom, n, 30.0);
                let (d, s) = phantom.distances_among(p, &[phantom.all_knots()]);
                if !(pool.from - 3.0..=pool.to + 3.0).contains(&s) || d.wall > 1.5 {
                    continue;
                }
                // Beyond the pool's ends the whole lumen is above the level, so nothing is cut off there.
                if s < pool.from || s > pool.to {
                    let closed = pool.from < 2.0 || pool.to > phantom.shape.axis.length() - 2.0;
                    assert!(closed || p.y < pool.level - 1.0, "{size:?}: open at {s}: {p}");
                } else if d.wall < -2.5 && (p.y - pool.level).abs() > 3.0 {
                    let hu = phantom.value(p);
                    let expected = if p.y > pool.level { FLUID } else { GAS };
                    assert!((hu - expected).abs() < 1.0, "{size:?} {p}: {hu}");
                    *(if p.y > pool.level { &mut fluid } else { &mut gas }) += 1;
                }
            }
            assert!(fluid > 0 && gas > fluid, "{size:?} {pool:?}: {fluid} in fluid, {gas} in gas");
        }
    }
}

#[test]
fn bridges_cross_the_lumen_and_leave_the_axis_free() {
    let phantom = quiet(Size::Standard);
    let without = Phantom::new(&PhantomSettings { bridges: false, ..*phantom.settings() });
    assert_eq!(phantom.shape.bridges.len(), 5);
    for b in &phantom.shape.bridges {
        let middle = 0.5 * (b.what.from + b.what.to);
        assert!(phantom.wall(middle) > 0.0 && without.wall(middle) < -1.0, "{b:?}");
        assert!(phantom.nearest(middle).unwrap().rho > 4.0, "{b:?}");
    }
}

#[test]
fn the_embedded_phantom_is_cancelled_when_asked() {
    let progress = Progress::new();
    progress.cancel();
    assert_eq!(Phantom::embedded(&progress).unwrap_err().kind, error::Kind::Incomplete);
    let start = std::time::Instant::now();
    let volume = Phantom::embedded(&Progress::new()).unwrap();
    println!("embedded phantom: {:?}, {:?}", start.elapsed(), volume.grid().dims());
    assert!((8_000_000..12_000_000).contains(&volume.data().len()));
}

#[test]
fn the_wall_has_no_jumps() {
    for size in [Size::Small, Size::Standard] {
        for seed in 1..=3 {
            let phantom = Phantom::new(&PhantomSettings { size, seed, bridges: true, ..PhantomSettings::default() });
            let step = DVec3::new(1.0, -2.0, 1.5) * 1e-5;
            for n in 0..20_000 {
                let p = place(&phantom, n, 30.0);
                let (a, b) = (phantom.wall(p), phantom.wall(p + step));
                assert!(a.abs() > 2.0 || (a - b).abs() < 3.0 * step.length(), "{size:?} {seed} {p}: {a}, {b}");
            }
        }
    }
}

#[test]
fn every_grid_is_centred_on_the_body() {
    for size in [Size::Small, Size::Standard, Size::Large] {
        let grid = make(size, 1).grid();
        let [nx, ny, nz] = grid.dims();
        let last = grid.world(DVec3::new(nx as f64 - 1.0, ny as f64 - 1.0, nz as f64 - 1.0));
        assert!((grid.origin() + last).length() < 1e-9, "{size:?}: {} to {last}", grid.origin());
    }
}

/// Between the taeniae and along the colon the wall bulges by more than a tenth of its radius, but not at the caps.
#[test]
fn haustra_bulge_between_taeniae() {
    let phantom = Phantom::new(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let shape = &phantom.shape;
    let spread = |s: f64| {
        let radii = (0..72).map(|n| shape.radius(s, f64::from(n) * std::f64::consts::TAU / 72.0));
        let (lo, hi) = radii.fold((f64::INFINITY, 0.0f64), |(l, h), r| (l.min(r), h.max(r)));
        (hi - lo) / hi
    };
    let end = shape.axis.length();
    for share in [0.2, 0.4, 0.6, 0.8] {
        assert!(spread(share * end) > 0.1, "{}", spread(share * end));
    }
    assert!(spread(0.0) < 1e-9 && spread(end) < 1e-9);
}

/// In LPS, +x is the patient's left and +y posterior: fluid lies on that side of the axis on which the patient lies.
#[test]
fn fluid_is_on_the_side_that_the_patient_lies_on() {
    for (position, down) in [
        (Position::Supine, DVec3::Y),
        (Position::Prone, DVec3::NEG_Y),
        (Position::Left, DVec3::X),
        (Position::Right, DVec3::NEG_X),
    ] {
        let settings = PhantomSettings { size: Size::Small, fluid: true, position, ..PhantomSettings::default() };
        let phantom = Phantom::new(&settings);
        let axis = phantom.axis();
        let [mut below, mut above] = [0, 0];
        for pool in &phantom.pools {
            for n in 0..20 {
                let s = pool.from + (pool.to - pool.from) * f64::from(n) / 19.0;
                for share in [0.3, 0.5, 0.7, 0.85] {
                    let away = down * (share * axis.profile(s).radius.0);
                    let is_fluid = |at: DVec3| phantom.wall(at) < -1.5 && phantom.value(at) > 200.0;
                    below += usize::from(is_fluid(axis.frame(s).at + away));
                    above += usize::from(is_fluid(axis.frame(s).at - away));
                }
            }
        }
        assert!(below > 4 * above, "{position:?}: {below} below, {above} above");
    }
}
