use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use super::*;
use crate::fields::voxels::VoxelSet;
use crate::volume::Grid;

/// The domain of the voxels whose middle (mm) is inside.
fn domain(dims: [usize; 3], spacing: DVec3, cell_mm: f64, is_inside: impl Fn(DVec3) -> bool) -> Domain {
    let grid = Grid::new(dims, spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let at =
        |n: usize| DVec3::from_array([n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|c| c as f64));
    let set = VoxelSet::from_fn(dims, |n| is_inside(at(n) * spacing)).unwrap();
    Domain::new(&grid, &set, cell_mm, &Progress::new()).unwrap()
}

fn held(domain: &Domain, value: impl Fn(DVec3) -> Option<f64>) -> Vec<(u32, f64)> {
    (0..domain.len() as u32).filter_map(|n| Some((n, value(domain.centre(n))?))).collect()
}

/// In half a torus of square section the function is the angle.
fn bend(h: f64) -> (f64, f64, usize) {
    let middle = DVec3::new(30.3, 2.1, 0.0);
    let dims = [60.0, 32.0, 16.0].map(|mm: f64| (mm / h).ceil() as usize + 1);
    let polar = |p: DVec3| ((p - middle).truncate().length(), (p.y - middle.y).atan2(p.x - middle.x));
    let domain = domain(dims, DVec3::splat(h), 2.01 * h, |p| {
        let (r, angle) = polar(p);
        (12.0..26.0).contains(&r) && (0.0..PI).contains(&angle) && (1.0..13.0).contains(&p.z)
    });
    let held = held(&domain, |p| {
        let (r, angle) = polar(p);
        (r * angle.min(PI - angle) < 2.0 * h).then_some(angle)
    });
    let harmonic = Harmonic::solve(&domain, &held, &[], 1e-9, &Progress::new()).unwrap();
    let (mut sum, mut most) = (0.0, 0.0f64);
    for n in 0..domain.len() as u32 {
        let (_, angle) = polar(domain.centre(n));
        // In mm of the line through the middle.
        let off = 19.0 * (harmonic.value(n) - angle).abs();
        assert!(off.is_finite());
        sum += off;
        most = most.max(off);
    }
    (sum / domain.len() as f64, most, harmonic.steps())
}

/// Its mean error is of the second order in the size of a cell, the largest, beside the steps of the wall, of the first.
#[test]
fn in_a_bend_it_is_the_angle_and_converges() {
    let errors = [2.0, 1.0, 0.5].map(bend);
    let order = |a: f64, b: f64| (a / b).log2() / 2.0;
    assert!(order(errors[0].0, errors[2].0) > 1.6, "{errors:?}");
    assert!(order(errors[0].1, errors[2].1) > 0.8 && errors[2].1 < 0.5, "{errors:?}");
    // Finer cells take no more steps.
    assert!(errors.iter().all(|e| e.2 < 30), "{errors:?}");
}

/// The tube's value is linear, whatever hangs on it and however narrow it is somewhere.
#[test]
fn necks_pouches_and_flat_voxels_are_solved() {
    for spacing in [DVec3::ONE, DVec3::new(0.5, 0.5, 2.5), DVec3::new(2.5, 0.5, 0.5)] {
        let dims = [60.0, 24.0, 24.0];
        let counts = [0, 1, 2].map(|a| (dims[a] / spacing[a]) as usize);
        let domain = domain(counts, spacing, CELL_MM, |p| {
            let tube = (p.y - 12.0).abs().max((p.z - 12.0).abs()) < 5.0;
            // One voxel wide.
            let is_neck = (p.x - 30.0).abs() < 4.0;
            let neck = ((p.y - 12.0) / spacing.y).abs() < 0.5 && ((p.z - 12.0) / spacing.z).abs() < 0.5;
            let pouch = (p.x - 12.0).abs() < 2.0 && (p.z - 12.0).abs() < 2.0 && p.y > 12.0;
            (if is_neck { neck } else { tube }) || pouch
        });
        let ends = held(&domain, |p| (!(2.0..57.0).contains(&p.x)).then_some(if p.x < 30.0 { 0.0 } else { 1.0 }));
        let harmonic = Harmonic::solve(&domain, &ends, &[], 1e-6, &Progress::new()).unwrap();
        let (mut low, mut high) = (0.0f64, 1.0f64);
        for n in 0..domain.len() as u32 {
            let (p, value) = (domain.centre(n), harmonic.value(n));
            assert!((-1e-6..=1.0 + 1e-6).contains(&value), "{spacing} {p}: {value}");
            if p.x < 25.0 {
                low = low.max(value);
            } else if p.x > 35.0 {
                high = high.min(value);
            }
        }
        // Nearly all of the difference is in the neck.
        assert!(low < 0.1 && high > 0.9, "{spacing}: {low} {high}");
    }
}

#[test]
fn nothing_and_pieces_without_an_end_have_no_value() {
    let empty = domain([4; 3], DVec3::ONE, CELL_MM, |_| false);
    assert!(empty.is_empty() && empty.nearest(DVec3::ONE, 5.0).is_none());
    assert_eq!(Harmonic::solve(&empty, &[], &[], 1e-3, &Progress::new()).unwrap().steps(), 0);
    let two = domain([30, 8, 8], DVec3::ONE, CELL_MM, |p| p.x < 12.0 || p.x > 16.0);
    assert_eq!(two.components(), 2);
    let first = two.cell([0, 0, 0]).unwrap();
    let harmonic = Harmonic::solve(&two, &[(first, 0.5)], &[], 1e-3, &Progress::new()).unwrap();
    for n in 0..two.len() as u32 {
        let is_known = two.component(n) == two.component(first);
        assert_eq!(harmonic.value(n).is_nan(), !is_known);
        assert!(!is_known || (harmonic.value(n) - 0.5).abs() < 1e-9);
    }
    let progress = Progress::new();
    progress.cancel();
    assert!(Harmonic::solve(&two, &[(first, 0.5)], &[], 1e-3, &progress).is_err());
}

/// In a ring the value rises on both sides of the source.
#[test]
fn a_ring_is_solved_the_same_by_any_number_of_threads() {
    let ring = domain([80, 80, 14], DVec3::ONE, CELL_MM, |p| {
        let r = (p - DVec3::new(40.0, 40.0, 0.0)).truncate().length();
        (r - 28.0).hypot(p.z - 7.0) < 6.0
    });
    let ends = [(ring.cell([12, 40, 7]).unwrap(), 0.0), (ring.cell([68, 40, 7]).unwrap(), 1.0)];
    let solve = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Harmonic::solve(&ring, &ends, &[], 1e-6, &Progress::new()).unwrap())
    };
    let (one, many) = (solve(1), solve(5));
    assert!(one.values.iter().zip(&many.values).all(|(a, b)| a.to_bits() == b.to_bits()));
    for voxel in [[40, 12, 7], [40, 68, 7]] {
        assert!((one.value(ring.cell(voxel).unwrap()) - 0.5).abs() < 0.02);
    }
}

/// Both sides of a fold one voxel thick are in cells of their own.
#[test]
fn a_thin_fold_is_not_bridged() {
    let folded = domain([40, 20, 20], DVec3::ONE, CELL_MM, |p| p.x != 20.0 || p.y > 15.0);
    let ends = held(&folded, |p| (!(1.0..38.0).contains(&p.x)).then_some(p.x / 39.0));
    let harmonic = Harmonic::solve(&folded, &ends, &[], 1e-6, &Progress::new()).unwrap();
    let at = |x| harmonic.value(folded.cell([x, 2, 10]).unwrap());
    assert!(at(21) - at(19) > 0.2, "{} {}", at(19), at(21));
}

/// A uniform source in a tube, held at one end, makes a parabola: u = s (L x − x²/2).
#[test]
fn a_source_flows_to_what_is_held() {
    let tube = domain([80, 9, 9], DVec3::splat(0.5), 1.0, |p| p.x < 30.0 && p.y.max(p.z) < 4.0);
    let ends = held(&tube, |p| (p.x < 0.5).then_some(0.0));
    let sources: Vec<(u32, f64)> = (0..tube.len() as u32).map(|n| (n, tube.volume_mm3(n))).collect();
    let harmonic = Harmonic::solve(&tube, &ends, &sources, 1e-8, &Progress::new()).unwrap();
    for n in 0..tube.len() as u32 {
        let x = tube.centre(n).x - 0.25;
        let expected = 29.5 * x - 0.5 * x * x;
        assert!((harmonic.value(n) - expected).abs() < 1.0, "{x}: {} of {expected}", harmonic.value(n));
    }
}
