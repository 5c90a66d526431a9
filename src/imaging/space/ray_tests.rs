use std::sync::Arc;

use glam::{DMat3, DVec3, IVec3};
use proptest::prelude::*;

use super::*;
use crate::math::hash;
use crate::space::TransferFunction;
use crate::volume::Grid;

fn volume(dims: [usize; 3], spacing: DVec3, direction: DMat3, f: impl Fn(DVec3) -> f64) -> PreparedVolume {
    let grid = Grid::new(dims, spacing, DVec3::new(-3.0, 5.0, 7.0), direction).unwrap();
    let mut data = Vec::new();
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                data.push(f(DVec3::new(i as f64, j as f64, k as f64)).round() as i16);
            }
        }
    }
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

/// Takes tiny steps and bisects where the sign changes. [`first_crossing`] must agree with it.
fn by_steps(volume: &PreparedVolume, origin: DVec3, direction: DVec3, max_mm: f64) -> Option<f64> {
    let grid = volume.voxels().grid();
    let iso = volume.transfer().iso();
    let f = |t: f64| trilinear(volume.voxels(), grid.voxel(origin + direction * t)) - iso;
    if f(0.0) >= 0.0 {
        return Some(0.0);
    }
    let dt = grid.min_spacing() / 400.0;
    let (mut a, mut b) = (0.0, dt);
    while f(b) < 0.0 {
        if b > max_mm {
            return None;
        }
        (a, b) = (b, b + dt);
    }
    for _ in 0..60 {
        let m = 0.5 * (a + b);
        if f(m) >= 0.0 { b = m } else { a = m }
    }
    (b <= max_mm).then_some(b)
}

fn rotation(seed: u64) -> DMat3 {
    let u = |n| hash::uniform(seed, n) * 6.0 - 3.0;
    let r = DMat3::from_euler(glam::EulerRot::XYZ, u(100), u(101), u(102));
    if hash::uniform(seed, 103) < 0.5 { r * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)) } else { r }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn agrees_with_tiny_steps(
        dims in prop::array::uniform3(1usize..20), seed: u64, share in 0.0..0.2f64,
        from in prop::array::uniform3(-0.6..1.6f64), to in prop::array::uniform3(-0.1..1.1f64), tall in 0.3..4.0f64,
        wall in prop_oneof![Just((-800.0, -500.0)), Just((-1100.0, -1080.0)), Just((-999.5, -700.0))],
    ) {
        let s = volume(dims, DVec3::new(0.7, 0.6, tall), rotation(seed), |p| {
            let n = (p.x + 32.0 * (p.y + 32.0 * p.z)) as u64;
            if hash::uniform(seed, n) < share { -900.0 + 1000.0 * hash::uniform(!seed, n) } else { -1000.0 }
        });
        let s = PreparedVolume::new(Arc::new(s.voxels().clone()), TransferFunction::new(wall.0, wall.1).unwrap());
        let grid = s.voxels().grid();
        let at = |q: [f64; 3]| grid.world(DVec3::from_array(from_fn(|a| q[a] * dims[a] as f64)));
        let (origin, target) = (at(from), at(to));
        prop_assume!((target - origin).length() > 1e-3);
        let direction = (target - origin).normalize();
        let (exact, stepped) = (first_crossing(&s, origin, direction, 200.0), by_steps(&s, origin, direction, 200.0));
        match (exact, stepped) {
            (None, None) => {}
            (Some(e), Some(b)) if (e - b).abs() < 1e-6 => {}
            // Stepping may miss a graze between two steps, but it must still be a touch of the wall.
            (Some(e), _) => {
                prop_assert!(stepped.is_none_or(|b| e < b), "{e} is later than {stepped:?}");
                let v = trilinear(s.voxels(), grid.voxel(origin + direction * e));
                prop_assert!((v - s.transfer().iso()).abs() < 1e-4, "no wall at {e}: {v}");
            }
            (None, Some(b)) => prop_assert!(false, "missed the wall at {b}"),
        }
    }
}

/// Looks at one voxel of wall from all sides, along axes, faces, edges and diagonals.
#[test]
fn no_crack_along_axes_faces_edges_and_corners() {
    let s = volume([21; 3], DVec3::ONE, DMat3::IDENTITY, |p| if p == DVec3::splat(10.0) { 1000.0 } else { -1000.0 });
    let centre = s.voxels().grid().world(DVec3::splat(10.0));
    for n in 0..27 {
        let d = IVec3::new(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1).as_dvec3();
        if d == DVec3::ZERO {
            continue;
        }
        let d = d.normalize();
        for nudge in [0.0, -0.0, 1e-17, -1e-17, f64::MIN_POSITIVE / 8.0, -f64::MIN_POSITIVE / 8.0] {
            let e = d + DVec3::splat(nudge) * (DVec3::ONE - d.abs().signum());
            for away in [8.0, 30.0, 1e5] {
                let hit = first_crossing(&s, centre - d * away, e, f64::INFINITY);
                let value = value(&s, centre - d * away + d * hit.unwrap());
                assert!((value + 650.0).abs() < 0.01, "{d} {nudge} {away}: {value} at {hit:?}");
                assert!((away - hit.unwrap()) < 1.8);
                assert_eq!(first_crossing(&s, centre - d * away, -e, f64::INFINITY), None);
            }
        }
    }
}

#[test]
fn a_thin_sheet_is_never_missed() {
    // One voxel that is only just wall: its crossing is 1/350 voxel wide.
    let s = volume([32; 3], DVec3::ONE, DMat3::IDENTITY, |p| if p.x == 20.0 { -649.0 } else { -1000.0 });
    let grid = s.voxels().grid();
    for n in 0..500 {
        let u = |k| hash::uniform(n, k);
        let origin = grid.world(DVec3::new(18.0 * u(0), 1.0 + 29.0 * u(1), 1.0 + 29.0 * u(2)));
        let target = grid.world(DVec3::new(20.0, 1.0 + 29.0 * u(3), 1.0 + 29.0 * u(4)));
        let hit = first_crossing(&s, origin, target - origin, 100.0).unwrap();
        let along = (target - origin).length();
        let across = (target.x - origin.x) / along;
        assert!((hit * across - ((target.x - origin.x) - 1.0 / 351.0)).abs() < 1e-9);
    }
}

#[test]
fn touching_counts() {
    // An edge of voxels exactly at the wall, passed along a neighbouring axis: the value only just reaches it.
    let s = volume([9; 3], DVec3::ONE, DMat3::IDENTITY, |p| if p.x == 4.0 && p.y == 4.0 { -650.0 } else { -1000.0 });
    let grid = s.voxels().grid();
    let hit = first_crossing(&s, grid.world(DVec3::new(1.0, 4.0, 3.0)), DVec3::X, 20.0).unwrap();
    assert!((hit - 3.0).abs() < 1e-9);
    assert_eq!(first_crossing(&s, grid.world(DVec3::new(1.0, 4.0, 3.0)), DVec3::X, 2.9), None);
    let diagonal = first_crossing(&s, grid.world(DVec3::new(3.0, 3.0, 3.0)), DVec3::new(1.0, 1.0, 0.5), 20.0).unwrap();
    assert!((diagonal - 1.5).abs() < 1e-6, "{diagonal}");
}

#[test]
fn inside_and_outside() {
    let tissue = volume([4; 3], DVec3::ONE, DMat3::IDENTITY, |_| 40.0);
    let grid = tissue.voxels().grid();
    let c = grid.world(DVec3::splat(1.5));
    assert_eq!(first_crossing(&tissue, c, DVec3::X, 1.0), Some(0.0));
    // From −1024 one voxel outside to 40 at the border.
    let enter = (-650.0 + 1024.0) / 1064.0 - 1.0;
    let hit = first_crossing(&tissue, c - DVec3::X * 11.5, DVec3::X, 100.0).unwrap();
    assert!((hit - (10.0 + enter)).abs() < 1e-9);
    assert_eq!(first_crossing(&tissue, c - DVec3::X * 11.5, DVec3::X, 5.0), None);
    assert_eq!(first_crossing(&tissue, c - DVec3::X * 11.5, DVec3::Y, 100.0), None);
    let air = volume([3; 3], DVec3::ONE, DMat3::IDENTITY, |_| -1000.0);
    assert_eq!(first_crossing(&air, c, DVec3::X, f64::INFINITY), None);
    for dims in [[1, 1, 1], [2, 1, 1], [1, 2, 70]] {
        let s = volume(dims, DVec3::new(0.3, 0.3, 10.0), DMat3::IDENTITY, |_| 40.0);
        let c = s.voxels().grid().world(DVec3::ZERO);
        let hit = first_crossing(&s, c - DVec3::Z * 100.0, DVec3::Z, 1e3).unwrap();
        assert!((hit - (100.0 + 10.0 * enter)).abs() < 1e-9);
    }
}

#[test]
fn what_is_no_ray_has_no_crossing() {
    let s = volume([4; 3], DVec3::ONE, DMat3::IDENTITY, |p| if p.x < 2.0 { -1000.0 } else { 0.0 });
    let c = s.voxels().grid().world(DVec3::ZERO);
    let nan = DVec3::new(f64::NAN, 0.0, 0.0);
    assert_eq!(first_crossing(&s, nan, DVec3::X, 9.0), None);
    assert_eq!(first_crossing(&s, c, nan, 9.0), None);
    assert_eq!(first_crossing(&s, c, DVec3::ZERO, 9.0), None);
    assert_eq!(first_crossing(&s, c, DVec3::splat(f64::INFINITY), 9.0), None);
    assert_eq!(first_crossing(&s, c, DVec3::X, f64::NAN), None);
    assert_eq!(first_crossing(&s, c, DVec3::X, -1.0), None);
    assert_eq!(first_crossing(&s, DVec3::splat(1e300), DVec3::X, f64::INFINITY), None);
    assert_eq!(value(&s, nan), -1024.0);
    assert_eq!(value(&s, DVec3::splat(-1e300)), -1024.0);
    // Directions of any length are equivalent.
    let hit = first_crossing(&s, c, DVec3::X, 9.0).unwrap();
    for scale in [1e-310, 1e-12, 1e12, 1e308] {
        assert_eq!(first_crossing(&s, c, DVec3::X * scale, 9.0), Some(hit));
    }
}

/// The wall around the origin is no crossing either.
#[test]
fn what_is_no_ray_has_no_crossing_within_the_wall() {
    let tissue = volume([4; 3], DVec3::ONE, DMat3::IDENTITY, |_| 40.0);
    let c = tissue.voxels().grid().world(DVec3::splat(1.5));
    assert_eq!(first_crossing(&tissue, c, DVec3::X, 9.0), Some(0.0));
    for direction in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
        assert_eq!(first_crossing(&tissue, c, direction, 9.0), None, "{direction}");
    }
    for max_mm in [-1.0, f64::NEG_INFINITY, f64::NAN] {
        assert_eq!(first_crossing(&tissue, c, DVec3::X, max_mm), None, "{max_mm}");
    }
    // Here even the air outside is wall.
    let all = TransferFunction::new(-1100.0, -1080.0).unwrap();
    let all = PreparedVolume::new(Arc::new(tissue.voxels().clone()), all);
    assert_eq!(first_crossing(&all, DVec3::splat(-1e3), DVec3::X, 9.0), Some(0.0));
    for origin in [DVec3::NAN, DVec3::INFINITY, DVec3::NEG_INFINITY] {
        assert_eq!(first_crossing(&all, origin, DVec3::X, 9.0), None, "{origin}");
    }
}

#[test]
fn a_sphere_lies_where_it_is() {
    let r = 20.0;
    let s = volume([64; 3], DVec3::new(0.8, 0.8, 0.8), rotation(3), |p| {
        (-1000.0 + 1050.0 * (((p - DVec3::splat(31.3)).length() - r) / 2.0 + 1.0 / 3.0).clamp(0.0, 1.0)).round()
    });
    let grid = s.voxels().grid();
    let origin = grid.world(DVec3::splat(31.3) + DVec3::new(5.0, -3.0, 2.0));
    let centre = grid.world(DVec3::splat(31.3));
    let mut cells = 0;
    for n in 0..2000 {
        let u = |k| hash::normal(n, k);
        let d = DVec3::new(u(0), u(1), u(2)).normalize();
        let hit = first_crossing_counted(&s, origin, d, 100.0, &mut cells).unwrap();
        let off = ((origin + d * hit - centre).length() - r * 0.8).abs() / 0.8;
        assert!(off < 0.1, "{off}");
    }
    assert!(cells > 2000 && cells < 2000 * 120, "{cells}");
}

/// A bundle's rays have the same distances to the bit, however wide it is and wherever it begins.
#[test]
fn a_bundle_changes_no_distance() {
    let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-1.1);
    let spacing = DVec3::new(0.7, 0.9, 1.6);
    // A winding tunnel with a rough wall and specks in its gas.
    let s = volume([60, 50, 40], spacing, turn, |p| {
        let n = (p.x + 60.0 * (p.y + 50.0 * p.z)) as u64;
        let axis = DVec3::new(30.0 + 12.0 * (p.z * 0.15).sin(), 25.0 + 8.0 * (p.z * 0.1).cos(), p.z);
        let depth = (p - axis).length() - 11.0 + 2.0 * hash::uniform(n, 0);
        if hash::uniform(n, 1) < 1e-4 { 200.0 } else { (depth * 400.0 - 700.0).clamp(-1000.0, 60.0) }
    });
    let air = volume([9; 3], DVec3::ONE, DMat3::IDENTITY, |_| -1000.0);
    let mut hits = 0;
    for n in 0..600 {
        let u = |k| hash::uniform(n, k);
        let v = |k| DVec3::new(u(k), u(k + 1), u(k + 2));
        let s = if n % 20 == 0 { &air } else { &s };
        let size = DVec3::from_array(s.voxels().grid().dims().map(|n| n as f64));
        // Also from outside, and from within the wall.
        let origin = s.voxels().grid().world(size * (v(0) * 1.2 - 0.1));
        let (middle, wide) = (v(3) - 0.5, 10f64.powf(-5.0 + 5.0 * u(6)));
        let direction =
            |k: u64| if n % 3 == 0 { DVec3::AXES[n as usize % 3] } else { middle } + (v(10 + k) - 0.5) * wide;
        let rays: Vec<_> = (0..40).map(|k| (origin, direction(3 * k).normalize())).collect();
        let bundle = Bundle::new(s, rays.iter().copied());
        for &ray in &rays {
            let alone = first_crossing(s, origin, ray.1, f64::INFINITY);
            assert_eq!(bundle.first_crossing(ray), alone, "{n}: {ray:?}");
            hits += u32::from(bundle.free > 0.0 && alone.is_some());
        }
    }
    assert!(hits > 500, "{hits} rays of bundles that knew something");
    // Rays of several points are walked one by one.
    let rays = [DVec3::ZERO, DVec3::X].map(|origin| (origin, DVec3::X));
    assert_eq!(Bundle::new(&s, rays.into_iter()).free, 0.0);
}

#[test]
fn a_ray_enters_and_leaves_where_the_volume_does() {
    // Four voxels an axis, grown by one: from −1 to 4.
    let at = |x: f64, y: f64, along: DVec3| clip([4; 3], DVec3::new(x, y, 1.0), along);
    assert_eq!(at(1.0, 1.0, DVec3::X), Some((0.0, 3.0)));
    assert_eq!(at(-3.0, 1.0, DVec3::X), Some((2.0, 7.0)));
    assert_eq!(at(6.0, 1.0, DVec3::NEG_X * 0.5), Some((4.0, 14.0)));
    assert_eq!(at(6.0, 1.0, DVec3::X), None, "the volume is behind");
    for y in [-5.0, -1.5, 4.5, 9.0] {
        assert_eq!(at(1.0, y, DVec3::X), None, "the ray passes beside it at {y}");
    }
    for y in [-1.0, 4.0] {
        assert_eq!(at(1.0, y, DVec3::X), Some((0.0, 3.0)), "its border belongs to it");
    }
}

/// Voxels are longer than a millimetre, so that steps are too.
#[test]
fn a_bundle_in_a_coarse_volume_leaps_over_no_wall() {
    let s = volume([60, 20, 20], DVec3::splat(3.0), DMat3::IDENTITY, |p| if p.x < 41.0 { -1000.0 } else { 40.0 });
    for n in 0..60 {
        let x = 1.5 + 0.6 * f64::from(n);
        let origin = s.voxels().grid().world(DVec3::new(x, 9.5, 9.5));
        let rays = [DVec3::X, DVec3::new(1.0, 0.01, 0.0), DVec3::new(1.0, 0.0, -0.01)].map(|d| (origin, d.normalize()));
        let bundle = Bundle::new(&s, rays.into_iter());
        // From −1000 at voxel 40 to 40 HU at voxel 41.
        let wall = 3.0 * (40.0 + 350.0 / 1040.0 - x);
        let hit = bundle.first_crossing(rays[0]).unwrap();
        assert!((hit - wall).abs() < 1e-9, "from {x}: {hit} instead of {wall}");
        for ray in rays {
            assert_eq!(bundle.first_crossing(ray), first_crossing(&s, ray.0, ray.1, f64::INFINITY), "from {x}");
        }
    }
}

/// A ray passes many voxels that are much shorter than a millimetre in each step that a bundle leaps.
#[test]
fn a_bundle_in_a_fine_volume_leaps_over_no_sheet() {
    let s = volume([64, 20, 20], DVec3::splat(0.1), DMat3::IDENTITY, |p| if p.x == 25.0 { 1000.0 } else { -1000.0 });
    let mut hits = 0;
    for n in 0..120 {
        let x = 0.25 + 0.5 * f64::from(n);
        let origin = s.voxels().grid().world(DVec3::new(x, 9.5, 9.5));
        for forward in [DVec3::X, DVec3::NEG_X] {
            let rays = [DVec3::ZERO, DVec3::Y * 0.01, DVec3::Z * -0.01].map(|d| (origin, (forward + d).normalize()));
            let bundle = Bundle::new(&s, rays.into_iter());
            for ray in rays {
                let alone = first_crossing(&s, ray.0, ray.1, f64::INFINITY);
                assert_eq!(bundle.first_crossing(ray), alone, "from {x} along {forward}");
                hits += u32::from(alone.is_some());
            }
        }
    }
    assert!(hits > 300, "{hits}");
}
