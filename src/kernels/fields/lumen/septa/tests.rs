//! Septa in thick slices and noise, and what is none.

use glam::{DMat3, DVec3};

use super::grown::wide;
use super::*;
use crate::fields::lumen::{Lumen, gas_at};
use crate::math::hash;
use crate::volume::Grid;

const LEFT: DVec3 = DVec3::new(20.0, 30.0, 20.0);

/// The mean over slices of `slice` mm of a body that is gas where `is_gas` says so, with noise of `noise` HU.
fn scanned(slice: f64, noise: f64, is_gas: impl Fn(DVec3) -> bool) -> Volume {
    let dims = [180, 60, (90.0 / slice) as usize];
    let spacing = DVec3::new(1.0, 1.0, slice);
    let grid = Grid::new(dims, spacing, DVec3::new(0.0, 0.0, 0.5 * slice), DMat3::IDENTITY).unwrap();
    let fine = 24;
    let mut data = Vec::with_capacity(grid.len());
    for k in 0..dims[2] {
        for (j, i) in (0..dims[1]).flat_map(|j| (0..dims[0]).map(move |i| (j, i))) {
            let z = |n: i32| slice * (k as f64 + (f64::from(n) + 0.5) / f64::from(fine));
            let gas = (0..fine).filter(|&n| is_gas(DVec3::new(i as f64, j as f64, z(n)))).count() as f64;
            let mean = 40.0 - 1040.0 * gas / f64::from(fine);
            let seed = (data.len() as u64) * 3;
            // The sum of three uniform numbers has the variance 1/4.
            let sum: f64 = (0..3).map(|n| hash::uniform(1, seed + n) - 0.5).sum();
            data.push((mean + 2.0 * noise * sum) as i16);
        }
    }
    Volume::new(grid, data)
}

/// Two limbs along x, joined at their right ends, with a wall of `wall` mm between them from z = `at` on.
fn limbs(at: f64, wall: f64) -> impl Fn(DVec3) -> bool {
    move |p: DVec3| {
        let is_across = (18.0..42.0).contains(&p.y) && (10.0..170.0).contains(&p.x);
        let is_wall = (at..at + wall).contains(&p.z) && p.x < 145.0;
        is_across && (at - 24.0..at + wall + 24.0).contains(&p.z) && !is_wall
    }
}

fn found(volume: &Volume) -> Lumen {
    gas_at(volume, LEFT, &Progress::new()).unwrap().unwrap()
}

#[test]
fn limbs_that_share_a_thin_wall_stay_apart() {
    // Slices of 3 and 5 mm; the wall within one slice, and across two.
    for (slice, at, wall, noise) in [
        (3.0, 36.4, 0.7, 0.0),
        (3.0, 35.6, 0.8, 0.0),
        (3.0, 36.4, 0.7, 40.0),
        (5.0, 36.0, 0.7, 0.0),
        (5.0, 36.0, 1.0, 25.0),
        (2.0, 36.5, 0.4, 12.0),
    ] {
        let volume = scanned(slice, noise, limbs(at, wall));
        let lumen = found(&volume);
        let case = format!("{wall} mm in {slice} mm at {at}, noise {noise}");
        assert!(lumen.septa().len() > 1000, "{case}: {} voxels", lumen.septa().len());
        let length = lumen.segments[0].length_mm;
        assert!(length > 220.0, "{case}: {length} mm");
        // Nothing passes: with its septa closed, the lumen is the same and has none left to close.
        let mut closed = volume.clone();
        lumen.close_septa(&mut closed);
        let again = found(&closed);
        assert!((again.gas_ml() - lumen.gas_ml()).abs() < 0.01 * lumen.gas_ml(), "{case}");
        assert!((again.segments[0].length_mm - length).abs() < 0.05 * length, "{case}");
    }
}

#[test]
fn folds_and_narrow_openings_stay_open() {
    // One straight tube with a fold of half its height in every 40 mm, 1 mm thick; and one with an opening of 3 mm radius.
    for slice in [1.0, 3.0, 5.0] {
        let tube =
            |p: DVec3| (18.0..42.0).contains(&p.y) && (15.0..45.0).contains(&p.z) && (10.0..170.0).contains(&p.x);
        let folds = scanned(slice, 20.0, |p| tube(p) && !(p.z < 30.0 && p.x % 40.0 < 1.0));
        let narrow =
            scanned(slice, 20.0, |p| tube(p) && ((p.x - 90.0).abs() > 2.0 || (p.y - 30.0).hypot(p.z - 32.0) < 3.0));
        // Two chambers above each other, joined by an opening of the same size.
        let stacked = scanned(slice, 20.0, |p| {
            let is_open = (p.x - 90.0).hypot(p.y - 30.0) < 3.0;
            (18.0..42.0).contains(&p.y)
                && (20.0..160.0).contains(&p.x)
                && ((15.0..30.0).contains(&p.z)
                    || (45.0..75.0).contains(&p.z)
                    || is_open && (25.0..50.0).contains(&p.z))
        });
        for (name, volume, ml) in [("folds", folds, 113.5), ("narrow", narrow, 112.5), ("stacked", stacked, 151.6)] {
            let lumen = found(&volume);
            assert!((lumen.gas_ml() - ml).abs() < 0.06 * ml, "{name}, {slice} mm: {} ml", lumen.gas_ml());
            assert!(lumen.septa().is_empty(), "{name}, {slice} mm: {} voxels of septa", lumen.septa().len());
        }
    }
}

#[test]
fn noise_is_measured_in_the_gas() {
    for noise in [0.0, 12.0, 50.0] {
        let volume = scanned(3.0, noise, limbs(36.0, 3.0));
        let (rows, _) = crate::fields::lumen::runs::components_below(&volume, -800, &Progress::new()).unwrap();
        let measured = noise_hu(&volume, &rows);
        assert!((measured - noise).abs() <= 1.0 + 0.05 * noise, "{measured} for {noise}");
    }
}

#[test]
fn patches_smaller_than_a_septum_are_openings() {
    let grid = Grid::new([40, 40, 40], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let square =
        |side: usize, at: usize| (0..side * side).map(move |n| (at + n % side) + 40 * (at + n / side + 40 * at));
    let mut voxels: Vec<usize> = square(4, 5).chain(square(5, 20)).collect();
    voxels.sort_unstable();
    let kept = wide(&grid, &voxels, 20.0);
    assert!(kept.len() == 25 && kept.iter().all(|v| v % 40 >= 20));
    let nothing: [usize; 0] = [];
    assert_eq!(wide(&grid, &nothing, 20.0), nothing);
}
