use std::sync::Arc;

use glam::DMat3;
use proptest::prelude::*;

use super::*;
use crate::fields::ClearanceFinder;
use crate::fields::lumen::GAS_HU;
use crate::math::hash::uniform;

fn grid(dims: [usize; 3], spacing: DVec3) -> Grid {
    Grid::new(dims, spacing, DVec3::new(-5.0, 3.0, 7.0), DMat3::IDENTITY).unwrap()
}

fn volume(grid: Grid, hu: impl Fn(DVec3) -> f64) -> Volume {
    let [nx, ny, _] = grid.dims();
    let data = (0..grid.len())
        .map(|n| hu(grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64))).round() as i16)
        .collect();
    Volume::new(grid, data)
}

/// Takes all gas of a volume as the lumen.
fn of_gas(v: &Volume) -> WallDistance {
    let inside = VoxelBits::from_fn(v.grid().dims(), |n| v.data()[n] <= GAS_HU);
    WallDistance::build(v.grid(), &inside, Some((&Values::of(v), GAS_HU)), SHELL, &Progress::new()).unwrap()
}

/// Returns every crossing of a grid edge and every gas voxel on the border, in mm along the axes.
fn crossings(v: &Volume, is_mask: bool) -> Vec<DVec3> {
    let dims = v.grid().dims();
    let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
    let place = |p: [usize; 3]| DVec3::from_array(p.map(|x| x as f64));
    let is_in = |n: usize| if is_mask { v.data()[n] != 0 } else { v.data()[n] <= GAS_HU };
    let hu = |n: usize| f64::from(v.data()[n]);
    let mut out = Vec::new();
    for n in 0..v.data().len() {
        let p = at(n);
        for a in 0..3 {
            let step = DVec3::AXES[a];
            let beyond = if is_mask { 0.5 } else { 0.0 };
            if is_in(n) && p[a] == 0 {
                out.push(place(p) - step * beyond);
            }
            if is_in(n) && p[a] + 1 == dims[a] {
                out.push(place(p) + step * beyond);
            }
            if p[a] + 1 < dims[a] {
                let m = n + [1, dims[0], dims[0] * dims[1]][a];
                if is_in(n) != is_in(m) {
                    let t = if is_mask { 0.5 } else { (-650.0 - hu(n)) / (hu(m) - hu(n)) };
                    out.push(place(p) + step * t);
                }
            }
        }
    }
    out.iter().map(|c| *c * v.grid().spacing()).collect()
}

/// Distances are counted in 1/512 mm, and in half of that before each of the last two passes, and rounded down.
const ROUNDING_MM: f64 = 2.0 / 512.0;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    /// Compares every voxel's distance with the nearest of all crossings, found by brute force.
    #[test]
    fn is_the_distance_to_the_nearest_crossing(
        nx in prop::sample::select(vec![1usize, 2, 9, 65]), ny in 1usize..9, nz in 1usize..9,
        seed: u64, share in 0.02f64..0.9, is_mask: bool, flat in 0usize..3,
    ) {
        let mut spacing = DVec3::new(0.7, 0.9, 1.3);
        spacing[flat] = 6.0;
        let g = grid([nx, ny, nz], spacing);
        // Blobs and noise give thick and thin parts.
        let solid = |n: usize| uniform(seed, (n / 7) as u64) < share;
        let data: Vec<i16> = (0..g.len())
            .map(|n| match (solid(n), is_mask) {
                (true, true) => 0,
                (false, true) => 3,
                (true, false) => (200.0 * uniform(seed, n as u64)) as i16,
                (false, false) => -1000 + (300.0 * uniform(seed, n as u64)) as i16,
            })
            .collect();
        let v = Volume::new(g, data);
        let d = if is_mask { WallDistance::of_mask(&v, &Progress::new()).unwrap() } else { of_gas(&v) };
        let all = crossings(&v, is_mask);
        prop_assert_eq!(d.voxels(), v.data().iter().filter(|&&x| if is_mask { x != 0 } else { x <= GAS_HU }).count());
        let mut failed = None;
        d.set().for_each(|n, [i, j, k]| {
            let p = DVec3::new(i as f64, j as f64, k as f64) * spacing;
            let brute = all.iter().map(|c| c.distance(p)).fold(f64::INFINITY, f64::min);
            let got = f64::from(d.value(n));
            // Beside the wall, the plane through the samples can be nearer than each sample, by at most a factor √3.
            let tangent = !is_mask && got.abs() >= brute / 3f64.sqrt() - 1e-4 - ROUNDING_MM && brute <= spacing.max_element();
            let exact = got.abs() - brute < 1e-3 && brute - got.abs() < 1e-3 + ROUNDING_MM;
            // In the shell, the path to the nearest crossing may leave the shell.
            let outside = got < 0.0 && got.abs() >= brute - 1e-3 - ROUNDING_MM;
            if !(exact || tangent || outside) && brute.is_finite() {
                failed = Some(([i, j, k], got, brute));
            }
        });
        prop_assert_eq!(failed, None);
    }
}

/// Balls of gas with a linear edge: the error of values at voxel centres, and of the spline between them.
#[test]
fn a_sphere_is_met_to_hundredths_of_a_voxel() {
    for spacing in [DVec3::ONE, DVec3::new(0.7, 0.7, 1.0), DVec3::new(0.5, 0.8, 1.5)] {
        let dims = [0, 1, 2].map(|a| (44.0 / spacing[a]) as usize);
        let centre = DVec3::new(16.6, 25.3, 28.9);
        let v = volume(grid(dims, spacing), |p| {
            let d = p.distance(centre) - 15.0;
            // −650 HU at d = 0, and linear around it, so that the test measures the distance's error, not the interpolation's.
            (-650.0 + 200.0 * d).clamp(-1000.0, 40.0)
        });
        let field = of_gas(&v);
        let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0f64);
        field.set().for_each(|n, [i, j, k]| {
            let p = field.world([i as i64, j as i64, k as i64]);
            let error = f64::from(field.value(n)) - (15.0 - p.distance(centre));
            if field.value(n) > 0.0 && p.distance(centre) > 0.5 {
                (sum, count, worst) = (sum + error.abs(), count + 1.0, worst.max(error.abs()));
            }
        });
        let h = spacing.max_element();
        assert!(sum / count < 0.03 * h && worst < 0.42 * h, "{spacing}: mean {}, worst {worst}", sum / count);
        let (mut sum, mut turned, mut count) = (0.0, 0.0, 0.0);
        for n in 0..2000u64 {
            let u = |k| uniform(7, 4 * n + k) * 2.0 - 1.0;
            let way = DVec3::new(u(0), u(1), u(2)).normalize_or_zero();
            let at = centre + way * (3.0 + 12.0 * uniform(7, 4 * n + 3));
            let s = field.sample(at).unwrap();
            sum += (s.mm - (15.0 - at.distance(centre))).abs();
            turned += s.gradient.angle_between(-way).to_degrees();
            count += 1.0;
            assert!((s.mm - (15.0 - at.distance(centre))).abs() < field.margin_mm() + 0.3 * h);
        }
        assert!(
            sum / count < 0.06 * h && turned / count < 2.5,
            "{spacing}: {} mm, {} degrees",
            sum / count,
            turned / count
        );
        // On the ridge (here a point) the spline is rounded, by no more than its margin.
        let s = field.sample(centre).unwrap();
        assert!(s.mm < 15.1 && s.mm > 15.0 - field.margin_mm() - 0.1 * h && s.gradient.length() < 0.5);
    }
}

/// A bent tube with coarse, noisy voxels: the bound holds and is useful.
#[test]
fn clearances_are_bounds_of_the_finders() {
    let shear = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.0, 0.3, 1.0));
    for (spacing, direction) in [
        (DVec3::ONE, DMat3::IDENTITY),
        (DVec3::new(0.3, 0.3, 10.0), DMat3::IDENTITY),
        (DVec3::new(0.7, 0.7, 1.0), shear),
    ] {
        let dims = [0, 1, 2].map(|a| (40.0 / spacing[a]).ceil() as usize);
        let g = Grid::new(dims, spacing, DVec3::ZERO, direction).unwrap();
        let axis = |p: DVec3| {
            g.world(DVec3::from_array(dims.map(|n| 0.5 * n as f64))) * DVec3::new(1.0, 1.0, 0.0) + DVec3::Z * p.z
        };
        let v = Arc::new(volume(g.clone(), |p| {
            let d = (p - axis(p)).length() - 9.0 - 2.0 * (p.z / 6.0).sin();
            (-650.0 + 300.0 * d + 40.0 * uniform(1, (p.x * 91.0 + p.y * 977.0 + p.z * 7919.0) as u64))
                .clamp(-1000.0, 40.0)
        }));
        let field = of_gas(&v);
        let finder = ClearanceFinder::new(Arc::clone(&v), -650.0, 12.0);
        let (mut loss, mut count) = (0.0, 0.0);
        for n in 0..3000u64 {
            let u = |k| uniform(9, 4 * n + k);
            let at = g.world(DVec3::from_array(dims.map(|n| n as f64)) * DVec3::new(u(0), u(1), u(2)));
            let (ours, exact) = (field.clearance(at), finder.at(at));
            assert!(
                ours.mm <= exact.mm + crate::fields::clearance::TOLERANCE_MM + 1e-6
                    || exact.mm >= finder.limit_mm() - 1e-6,
                "{at}: {} above {}",
                ours.mm,
                exact.mm
            );
            assert!(ours.toward.is_finite());
            if exact.mm > 3.0 {
                (loss, count) = (loss + exact.mm - ours.mm, count + 1.0);
            }
        }
        assert!(count > 20.0 && (spacing.z > 5.0 || loss / count < 2.2), "{spacing}: loses {}", loss / count);
    }
}

#[test]
fn empty_full_flat_and_single() {
    let p = Progress::new();
    for dims in [[1, 1, 1], [1, 7, 1], [70, 3, 2]] {
        for value in [0i16, 1] {
            let v = Volume::new(grid(dims, DVec3::new(0.3, 0.3, 10.0)), vec![value; dims.iter().product()]);
            let d = WallDistance::of_mask(&v, &p).unwrap();
            assert_eq!(d.voxels(), if value == 0 { 0 } else { v.data().len() });
            assert!(d.values().all(|x| x.is_finite() && x > 0.0));
            for at in [v.grid().origin(), DVec3::NAN, DVec3::splat(1e300)] {
                assert!(d.sample(at).is_none_or(|s| s.mm.is_finite() && s.gradient.is_finite()));
                assert!(d.clearance(at).mm >= 0.0);
            }
        }
    }
    let cancelled = Progress::new();
    cancelled.cancel();
    let v = Volume::new(grid([4; 3], DVec3::ONE), vec![1; 64]);
    assert!(WallDistance::of_mask(&v, &cancelled).is_err());
}

/// A ball of any size has distances: in the finest unit up to a radius of 64 mm, in a finer one where voxels are small.
#[test]
fn the_unit_suits_the_lumen() {
    for (radius, most) in
        [(60.0, ROUNDING_MM), (70.0, 4.0 * ROUNDING_MM), (300.0, 16.0 * ROUNDING_MM), (1e-3, 1e-6), (1e6, 1e3)]
    {
        let spacing = DVec3::splat(radius / 12.5);
        let middle = DVec3::splat(14.0) * spacing;
        let inside = |p: DVec3| p.distance(middle) < radius;
        let walls = WallDistance::drawn([29; 3], spacing, inside);
        // Half-way to the first voxel outside, along an axis.
        let at = |n: i64| f64::from(walls.at([14 + n, 14, 14]).unwrap());
        for n in 9..=12 {
            let expected = (12.5 - n as f64) * spacing.x;
            assert!((at(n) - expected).abs() < most, "{radius} {n}: {} {expected}", at(n));
        }
        assert!(at(0) > 0.9 * radius && at(0) < 1.1 * radius, "{radius}: {}", at(0));
    }
}

#[test]
fn any_number_of_threads_gives_the_same() {
    let v = volume(grid([40, 41, 42], DVec3::new(0.7, 0.8, 0.9)), |p| {
        -650.0 + 100.0 * (p.x.sin() * 5.0 + (p - DVec3::new(10.0, 20.0, 25.0)).length() - 12.0)
    });
    let once = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| of_gas(&v)).values().collect::<Vec<_>>()
    };
    assert_eq!(once(1), once(3));
}

/// The nearest voxel of the lumen is found in every direction, as far as asked and no farther.
#[test]
fn the_nearest_voxel_is_within_reach_on_every_side() {
    let spacing = DVec3::new(0.5, 1.0, 2.0);
    let walls = WallDistance::drawn([21, 21, 21], spacing, |p| p == DVec3::splat(10.0) * spacing);
    let middle = walls.world([10; 3]);
    assert_eq!(walls.nearest(middle, 0.0), Some([10; 3]));
    for a in 0..3 {
        for sign in [-1.0, 1.0] {
            let at = middle + DVec3::AXES[a] * (sign * 4.0 * spacing[a]);
            let far = 4.0 * spacing[a];
            assert_eq!(walls.nearest(at, far + 1e-9), Some([10; 3]), "axis {a}, {sign}");
            assert_eq!(walls.nearest(at, far - 1e-6), None, "axis {a}, {sign}");
        }
    }
    // Of several, the nearest.
    let walls = WallDistance::drawn([21, 21, 21], DVec3::ONE, |p| p.x > 12.5 && p.y > 9.5 && p.z > 9.5);
    assert_eq!(walls.nearest(DVec3::new(8.2, 11.1, 14.9), 9.0), Some([13, 11, 15]));
    assert_eq!(walls.nearest(DVec3::splat(f64::NAN), 9.0), None);
}

/// In a box 11 mm wide: in a scan, the bound is less than the distance by the diagonal of a voxel.
#[test]
fn a_clearance_is_the_distance_less_a_voxels_diagonal_in_a_scan() {
    let middle = DVec3::splat(10.0);
    let is_gas = |p: DVec3| (p - middle).abs().max_element() < 5.5;
    let scan = volume(Grid::new([21; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap(), |p| {
        if is_gas(p) { -1000.0 } else { -300.0 }
    });
    let (mask, scan) = (WallDistance::drawn([21; 3], DVec3::ONE, is_gas), of_gas(&scan));
    for x in [0.0, 2.0, 3.0] {
        let (at, far) = (middle + DVec3::X * x, 5.5 - x);
        let [in_mask, in_scan] = [&mask, &scan].map(|w| w.clearance(at).mm);
        assert!((in_mask - far).abs() < 1e-4, "{x}: {in_mask}");
        assert!((in_scan - (far - 3f64.sqrt())).abs() < 1e-4, "{x}: {in_scan}");
    }
}
