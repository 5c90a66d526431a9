//! Synthetic bodies, one per question, and the scans of the data folder.

#[path = "../../../../tests/support/skips.rs"]
mod skips;

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::*;
use crate::math::hash;
use crate::phantom::{Phantom, PhantomSettings, Size};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// HU.
const GAS: f64 = -1000.0;
const TISSUE: f64 = 40.0;

/// Samples `hu` at every voxel's centre (world, mm).
fn scan(grid: &Grid, hu: impl Fn(DVec3) -> f64 + Sync) -> Volume {
    let [nx, ny, _] = grid.dims();
    let data = (0..grid.len())
        .into_par_iter()
        .map(|n| hu(grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64))) as i16)
        .collect();
    Volume::new(grid.clone(), data)
}

/// Returns a grid of about `size` mm around the world's origin.
fn grid_around(size: DVec3, spacing: DVec3) -> Grid {
    let dims = (size / spacing).to_array().map(|n| n.round() as usize);
    let last = DVec3::from_array(dims.map(|n| n as f64 - 1.0));
    Grid::new(dims, spacing, -0.5 * last * spacing, DMat3::IDENTITY).unwrap()
}

fn found(volume: &Volume) -> Lumen {
    let lumen = find(volume, &Progress::new()).unwrap();
    holds_together(volume, &lumen);
    lumen
}

/// Checks the invariants of every lumen.
fn holds_together(volume: &Volume, lumen: &Lumen) {
    let grid = volume.grid();
    let mask = lumen.mask();
    assert_eq!(mask.len(), grid.len());
    assert!(mask.iter().zip(volume.data()).all(|(&m, &hu)| m != 1 || hu <= GAS_HU), "gas is dark");
    let ml = |value: u8| mask.iter().filter(|&&m| m == value).count() as f64 * grid.voxel_ml();
    assert!((ml(1) - lumen.gas_ml()).abs() < 1e-6 * (1.0 + ml(1)), "{} is not {}", ml(1), lumen.gas_ml());
    assert!((ml(2) - lumen.fluid_ml()).abs() < 1e-6 * (1.0 + ml(2)), "{} is not {}", ml(2), lumen.fluid_ml());
    for (n, s) in lumen.segments.iter().enumerate() {
        assert!(s.ends.iter().all(|&e| lumen.segment_at(e) == Some(n)), "the ends of {n} are in its gas: {s:?}");
        assert!(s.bounds_mm[0].cmple(s.bounds_mm[1]).all() && s.ml > 0.0 && s.length_mm.is_finite());
        assert!(s.joined_to.iter().all(|&o| o != n && lumen.segments[o].joined_to.contains(&n)));
    }
}

fn capsule(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    p.distance(a + t * (b - a))
}

/// A body on a table in air, lungs above, and a colon of three tubes: up on the left, across, down on the right.
fn abdomen(p: DVec3) -> f64 {
    let colon = [
        DVec3::new(0.0, 20.0, -68.0),
        DVec3::new(50.0, 10.0, 0.0),
        DVec3::new(-45.0, -15.0, 15.0),
        DVec3::new(-50.0, 0.0, -40.0),
    ];
    let lung = |x: f64| ((p - DVec3::new(x, 10.0, 90.0)) / DVec3::new(28.0, 30.0, 45.0)).length() < 1.0;
    let body = (p.x / 90.0).hypot(p.y / 60.0);
    let table = p.y > 62.0 && p.y < 74.0 && p.x.abs() < 85.0;
    if colon.windows(2).any(|w| capsule(p, w[0], w[1]) < 11.0) {
        GAS
    } else if body < 1.0 && (lung(-45.0) || lung(45.0)) {
        let n = (p.x * 7.0).round() as i64 * 1_000_003 + (p.y * 7.0).round() as i64 * 1009 + (p.z * 7.0).round() as i64;
        -850.0 + 70.0 * hash::normal(3, n as u64)
    } else if body < 1.0 {
        TISSUE
    } else if table && !(p.y > 64.0 && p.y < 72.0 && p.x.abs() < 83.0) {
        -200.0
    } else {
        GAS
    }
}

#[test]
fn the_colon_is_told_from_outside_air_table_and_lungs() {
    let volume = scan(&grid_around(DVec3::new(210.0, 160.0, 180.0), DVec3::splat(1.5)), abdomen);
    let lumen = found(&volume);
    assert_eq!(lumen.segments.len(), 1, "{:?}", lumen.segments);
    assert!(lumen.segment_at(DVec3::new(45.0, 10.0, 75.0)).is_none(), "no lung");
    assert!(lumen.segment_at(DVec3::new(0.0, 68.0, 0.0)).is_none(), "no hollow of the table");
    assert!(lumen.segment_at(DVec3::new(100.0, 0.0, 0.0)).is_none(), "no outside air");
    assert!(lumen.ordered && lumen.is_flyable() && lumen.main_segment() == Some(0));
    let s = &lumen.segments[0];
    assert!(s.ends[0].distance(DVec3::new(0.0, 20.0, -68.0)) < 8.0, "the rectum comes first: {:?}", s.ends);
    assert!(s.ends[1].distance(DVec3::new(-50.0, 0.0, -40.0)) < 8.0, "the cecum comes last: {:?}", s.ends);
    // 84.9, 99.3 and 57.2 mm from corner to corner; the path cuts corners.
    assert!((200.0..260.0).contains(&s.length_mm), "{}", s.length_mm);
}

/// The same body, stored in any order of axes and in either direction along each, gives the same colon in the world.
#[test]
fn flipped_and_permuted_grids_give_the_same_colon() {
    let spacing = DVec3::new(2.0, 2.2, 1.8);
    let plain = grid_around(DVec3::new(210.0, 160.0, 180.0), spacing);
    let expected = found(&scan(&plain, abdomen));
    for (axes, signs) in [
        ([0, 1, 2], [-1.0, 1.0, 1.0]),
        ([0, 1, 2], [-1.0, -1.0, -1.0]),
        ([1, 2, 0], [1.0, 1.0, -1.0]),
        ([2, 0, 1], [-1.0, 1.0, 1.0]),
        ([2, 1, 0], [1.0, -1.0, 1.0]),
    ] {
        // Index axis a runs along world axis axes[a], from the plain grid's near or far end.
        let mut direction = DMat3::ZERO;
        let mut origin = plain.origin();
        for a in 0..3 {
            let w = axes[a];
            direction.col_mut(a)[w] = signs[a];
            if signs[a] < 0.0 {
                origin[w] += (plain.dims()[w] - 1) as f64 * spacing[w];
            }
        }
        let dims = axes.map(|w| plain.dims()[w]);
        let turned = Grid::new(dims, DVec3::from_array(axes.map(|w| spacing[w])), origin, direction).unwrap();
        let lumen = found(&scan(&turned, abdomen));
        assert_eq!(lumen.segments.len(), 1, "{axes:?} {signs:?}");
        assert!(lumen.ordered);
        let (s, e) = (&lumen.segments[0], &expected.segments[0]);
        assert!((s.ml - e.ml).abs() < 1e-6 * e.ml, "{axes:?} {signs:?}: {} ml", s.ml);
        for n in 0..2 {
            assert!(s.bounds_mm[n].distance(e.bounds_mm[n]) < 1e-6);
            assert!(s.ends[n].distance(e.ends[n]) < 12.0, "{axes:?} {signs:?}: {} is not {}", s.ends[n], e.ends[n]);
        }
        assert!((s.length_mm - e.length_mm).abs() < 0.1 * e.length_mm);
    }
}

#[test]
fn a_thin_blurred_wall_parts_two_loops() {
    let loops = |p: DVec3| match p {
        // One voxel of wall, blurred to less than the wall's middle.
        _ if p.x.abs() < 0.5 && p.y.abs() < 10.0 && p.z.abs() < 30.0 => -700.0,
        _ if p.x.abs() < 15.0 && p.y.abs() < 10.0 && p.z.abs() < 30.0 => GAS,
        _ => TISSUE,
    };
    let grid = Grid::new([61, 41, 81], DVec3::ONE, DVec3::new(-30.0, -20.0, -40.0), DMat3::IDENTITY).unwrap();
    let lumen = found(&scan(&grid, loops));
    assert_eq!(lumen.segments.len(), 2);
    assert_ne!(lumen.segment_at(DVec3::new(8.0, 0.0, 0.0)), lumen.segment_at(DVec3::new(-8.0, 0.0, 0.0)));
    assert!(lumen.segment_at(DVec3::ZERO).is_none(), "the wall belongs to none of them");
    assert_eq!(lumen.septa().len(), 19 * 59);
    // A point beside the gas finds it; one far away does not.
    let (_, p) = lumen.nearest_gas(DVec3::new(17.0, 0.0, 0.0), 5.0).unwrap();
    assert!(p.distance(DVec3::new(14.0, 0.0, 0.0)) < 1e-9);
    assert!(lumen.nearest_gas(DVec3::new(21.0, 0.0, 0.0), 5.0).is_none());
    assert!(lumen.nearest_gas(DVec3::NAN, 5.0).is_none());
    assert!(lumen.nearest_gas(DVec3::splat(1e300), 5.0).is_none());
}

/// A basin of two chambers over one pool; `down` is the direction of gravity (+1 to posterior).
fn basin(p: DVec3, down: f64) -> f64 {
    let y = down * p.y;
    let chamber = p.z.abs() > 6.0 && p.z.abs() < 36.0 && p.x.abs() < 14.0 && y > -16.0 && y < 16.0;
    let passage = p.z.abs() <= 6.0 && p.x.abs() < 14.0 && y > 8.0 && y < 16.0;
    // Tagged small bowel and bone behind thin walls.
    let beside = (p.x.abs() > 16.5 && p.x.abs() < 24.0 || y > 18.5 && y < 24.0) && p.z.abs() < 36.0;
    match p {
        _ if chamber && y < 2.0 => GAS,
        _ if chamber && y < 3.0 => -150.0,
        _ if chamber || passage => 600.0,
        _ if beside && p.x.abs() < 24.0 => 700.0,
        _ => TISSUE,
    }
}

#[test]
fn a_level_pool_is_lumen_and_joins_what_it_lies_under() {
    for down in [1.0, -1.0] {
        for axes in [[0, 1, 2], [1, 0, 2], [2, 0, 1]] {
            let mut direction = DMat3::ZERO;
            for (a, w) in axes.into_iter().enumerate() {
                direction.col_mut(a)[w] = 1.0;
            }
            let size = [61usize, 61, 91];
            let origin = DVec3::new(-30.0, -30.0, -45.0);
            let grid = Grid::new(axes.map(|w| size[w]), DVec3::ONE, origin, direction).unwrap();
            let volume = scan(&grid, |p| basin(p, down));
            let lumen = found(&volume);
            assert_eq!(lumen.segments.len(), 2, "{down} {axes:?}");
            assert_eq!([&lumen.segments[0].joined_to, &lumen.segments[1].joined_to], [&vec![1], &vec![0]]);
            let truth = grid_values(&volume).filter(|&(p, hu)| {
                let own = p.x.abs() < 14.0 && down * p.y < 16.0;
                own && (hu > 500.0 || hu < -100.0 && hu > -200.0)
            });
            let truth = truth.count() as f64 / 1000.0;
            assert!((lumen.fluid_ml() - truth).abs() < 0.02 * truth, "{} is not {truth} ml", lumen.fluid_ml());
        }
    }
}

fn grid_values(volume: &Volume) -> impl Iterator<Item = (DVec3, f64)> + '_ {
    let grid = volume.grid();
    let [nx, ny, _] = grid.dims();
    volume.data().iter().enumerate().map(move |(n, &hu)| {
        (grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64)), f64::from(hu))
    })
}

#[test]
fn bright_walls_without_a_level_are_no_fluid() {
    let coated = |p: DVec3| match p.length() {
        r if r < 20.0 => GAS,
        r if r < 23.0 => 500.0,
        _ => TISSUE,
    };
    let lumen = found(&scan(&grid_around(DVec3::splat(70.0), DVec3::ONE), coated));
    assert_eq!((lumen.segments.len(), lumen.fluid_ml()), (1, 0.0));
}

#[test]
fn a_rod_is_a_bridge_a_fold_is_none_and_a_loose_piece_is_an_island() {
    let rod = [DVec3::new(-25.0, -12.0, -20.0), DVec3::new(25.0, 14.0, -11.0)];
    let island = DVec3::new(2.0, 3.0, 18.0);
    let inside = |p: DVec3| {
        let fold = (p.z - 0.3 * p.y).abs() < 1.2 && p.x > 4.0;
        if p.length() > 32.0 || capsule(p, rod[0], rod[1]) < 1.1 || p.distance(island) < 2.0 || fold {
            TISSUE
        } else {
            GAS
        }
    };
    let volume = scan(&grid_around(DVec3::splat(80.0), DVec3::splat(0.8)), inside);
    let lumen = found(&volume);
    let found = residue(&volume, &lumen, &Progress::new()).unwrap();
    assert_eq!((found.bridges.len(), found.islands.len()), (1, 1), "{found:?}");
    assert!(found.bridges[0].at.distance((rod[0] + rod[1]) / 2.0) < 3.0, "{found:?}");
    assert!(found.islands[0].at.distance(island) < 0.3);
    assert!((found.islands[0].ml - 0.0335).abs() < 0.006, "a ball of 4 mm: {}", found.islands[0].ml);
}

#[test]
fn volumes_without_a_colon_are_no_error() {
    let flat = |dims| Grid::new(dims, DVec3::new(0.7, 0.7, 1.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
    for dims in [[1, 1, 1], [64, 1, 1], [1, 40, 1], [1, 1, 9], [30, 30, 1], [1, 20, 20], [20, 1, 20], [12, 13, 14]] {
        for hu in [GAS, TISSUE, -700.0, 3000.0, f64::from(i16::MIN)] {
            let volume = scan(&flat(dims), |_| hu);
            let lumen = found(&volume);
            assert!(lumen.segments.is_empty() && !lumen.is_flyable(), "{dims:?} {hu}");
            assert_eq!(residue(&volume, &lumen, &Progress::new()).unwrap(), Residue::default());
            assert!(gas_at(&volume, DVec3::ZERO, &Progress::new()).unwrap().is_none());
        }
    }
}

#[test]
fn a_lumen_of_one_voxel_is_one() {
    let grid = Grid::new([9, 9, 9], DVec3::ONE, DVec3::splat(-4.0), DMat3::IDENTITY).unwrap();
    let lumen = found(&scan(&grid, |p| if p.length() < 0.5 { GAS } else { TISSUE }));
    assert_eq!(lumen.segments.len(), 1);
    assert_eq!(lumen.segments[0].ends, [DVec3::ZERO; 2]);
    assert_eq!((lumen.segments[0].length_mm, lumen.is_flyable()), (0.0, false));
}

#[test]
fn thick_slices_are_no_hindrance() {
    let tube = |p: DVec3| {
        if capsule(p, DVec3::new(0.0, 0.0, -150.0), DVec3::new(8.0, 0.0, 150.0)) < 12.0 { GAS } else { TISSUE }
    };
    let lumen = found(&scan(&grid_around(DVec3::new(60.0, 60.0, 400.0), DVec3::new(0.3, 0.3, 10.0)), tube));
    assert_eq!(lumen.segments.len(), 1);
    let s = &lumen.segments[0];
    assert!((280.0..340.0).contains(&s.length_mm), "{}", s.length_mm);
    assert!(s.ends[0].z < -125.0 && s.ends[1].z > 125.0, "{:?}", s.ends);
    assert!(s.ends.iter().all(|e| (e.x - 4.0).hypot(e.y) < 6.0), "in the tube's middle: {:?}", s.ends);
}

#[test]
fn gas_at_a_point_takes_what_is_there() {
    let two = |p: DVec3| {
        let small = p.distance(DVec3::new(30.0, 0.0, 0.0)) < 2.5;
        if small || capsule(p, DVec3::new(-20.0, 0.0, -30.0), DVec3::new(-20.0, 0.0, 30.0)) < 12.0 {
            GAS
        } else {
            TISSUE
        }
    };
    let volume = scan(&grid_around(DVec3::splat(100.0), DVec3::ONE), two);
    let at = |p: DVec3| gas_at(&volume, p, &Progress::new()).unwrap();
    assert_eq!(found(&volume).segments.len(), 1, "a bubble is no colon …");
    let bubble = at(DVec3::new(31.0, 0.0, 0.0)).unwrap();
    holds_together(&volume, &bubble);
    assert_eq!(bubble.segments.len(), 1, "… unless it is asked for");
    assert!(bubble.segments[0].ml < 0.1 && bubble.segment_at(DVec3::new(-20.0, 0.0, 0.0)).is_none());
    assert!(at(DVec3::new(36.0, 0.0, 0.0)).is_some(), "a point beside it snaps to it");
    assert!(at(DVec3::new(42.0, 0.0, 0.0)).is_none());
    assert!(at(DVec3::new(0.0, 0.0, 900.0)).is_none());
}

fn with_threads<T: Send>(n: usize, f: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(f)
}

#[test]
fn threads_change_nothing() {
    let volume = scan(&grid_around(DVec3::new(210.0, 160.0, 180.0), DVec3::splat(2.0)), abdomen);
    let [one, two] = [1, 2].map(|n| with_threads(n, || found(&volume)));
    assert_eq!(one.segments, two.segments);
    assert_eq!(one.mask(), two.mask());
    let basin = scan(&grid_around(DVec3::new(61.0, 61.0, 91.0), DVec3::ONE), |p| basin(p, 1.0));
    let [one, two] = [1, 2].map(|n| {
        with_threads(n, || {
            let lumen = found(&basin);
            (residue(&basin, &lumen, &Progress::new()).unwrap(), lumen.segments.clone(), lumen.mask())
        })
    });
    assert_eq!(one, two);
}

/// Loads a file of the data folder, which lies beside the workspace; reports a skip if it is absent.
fn data(name: &str) -> Option<Volume> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("COLVIS_TEST_DATA").map_or_else(beside, PathBuf::from);
    let path = folder.join(name);
    if !path.exists() {
        skips::skip("data", &format!("{} is absent", path.display()));
        return None;
    }
    Some(crate::volume::io::load(&path, &Default::default(), &Progress::new()).unwrap().volume)
}

#[test]
#[ignore = "slow: the lumen of the real scan"]
fn the_prone_scan_has_three_segments_in_order() {
    let Some(volume) = data("ctc_prone.nii.gz") else { return };
    let lumen = found(&volume);
    assert!(lumen.ordered && lumen.is_flyable());
    // At the core's threshold they contain 281, 183 and 2479 ml; the surface is at a brighter one.
    let ml: Vec<f64> = lumen.segments.iter().map(|s| s.ml).collect();
    assert_eq!(ml.len(), 3, "{ml:?}");
    for (ml, expected) in ml.into_iter().zip([292.0, 192.0, 2560.0]) {
        assert!((ml - expected).abs() < 0.02 * expected, "{ml} is not {expected}");
    }
    let main = &lumen.segments[2];
    assert_eq!(lumen.main_segment(), Some(2));
    assert!(main.ends[0].distance(DVec3::new(131.0, -64.0, -126.0)) < 20.0, "{:?}", main.ends);
    assert!(main.ends[1].distance(DVec3::new(-90.0, -103.0, -258.0)) < 45.0, "{:?}", main.ends);
    assert!((780.0..1000.0).contains(&main.length_mm), "{}", main.length_mm);
    // Only fluid separates neighbours.
    let joined: Vec<&[usize]> = lumen.segments.iter().map(|s| s.joined_to.as_slice()).collect();
    assert_eq!(joined, [&[1][..], &[0, 2], &[1]]);
    let share = lumen.fluid_ml() / (lumen.gas_ml() + lumen.fluid_ml());
    assert!((0.08..0.20).contains(&share), "{share}");
    // Lung bases, outside air, tagged small bowel and the pelvis.
    let mask = lumen.mask();
    let value = |p: DVec3| {
        let [i, j, k] = volume.grid().voxel(p).round().to_array().map(|x| x as usize);
        mask[volume.grid().index(i, j, k)]
    };
    let not =
        [[-80.0, 20.0, -25.0], [80.0, 20.0, -25.0], [0.0, 120.0, -200.0], [-60.0, -130.0, -337.0], [90.0, 0.0, -337.0]];
    for p in not {
        assert_eq!(value(DVec3::from_array(p)), 0, "{p:?}");
    }
    let residue = residue(&volume, &lumen, &Progress::new()).unwrap();
    assert!(residue.bridges.len() < 40, "{}", residue.bridges.len());
}

#[test]
fn an_unprepared_abdomen_is_no_colon_to_fly() {
    let Some(volume) = data("abdomen_unprepared.nii.gz") else { return };
    let lumen = found(&volume);
    assert!(!lumen.is_flyable() && !lumen.ordered, "{:?}", lumen.segments);
    // There is gas all the same, and it can be requested.
    let inside = lumen.segments[0].ends[0];
    let one = gas_at(&volume, inside, &Progress::new()).unwrap().unwrap();
    holds_together(&volume, &one);
    assert_eq!(one.segments.len(), 1);
    // On its own it also grows into the blur that it otherwise shares with its neighbours.
    let [alone, among] = [one.segments[0].ml, lumen.segments[0].ml];
    assert!(alone >= among && alone < 1.1 * among, "{alone} {among}");
}

#[test]
fn the_phantom_is_one_lumen_from_rectum_to_cecum() {
    use crate::phantom::{PhantomSettings, Size};
    use crate::shared::shared;
    for (fluid, bridges) in [(false, false), (true, true)] {
        let settings = PhantomSettings { size: Size::Small, fluid, bridges, ..PhantomSettings::default() };
        let (phantom, volume) = shared(&settings);
        let lumen = found(&volume);
        let truth = phantom.truth();
        let ml = lumen.gas_ml() + lumen.fluid_ml();
        assert!(lumen.ordered && lumen.is_flyable());
        assert!((ml - truth.lumen_ml).abs() < 0.02 * truth.lumen_ml, "{ml} is not {} ml", truth.lumen_ml);
        assert_eq!(lumen.fluid_ml() > 0.0, fluid);
        let ends = [lumen.segments[0].ends[0], lumen.segments[lumen.segments.len() - 1].ends[1]];
        let last = truth.centerline.len() - 1;
        for (end, at) in ends.into_iter().zip([truth.centerline[0], truth.centerline[last]]) {
            assert!(end.distance(at) < 8.0, "{end} is not {at}");
        }
        let length = lumen.segments.iter().map(|s| s.length_mm).sum::<f64>();
        assert!((length - truth.length_mm).abs() < 0.1 * truth.length_mm, "{length} is not {} mm", truth.length_mm);
    }
}

#[test]
#[ignore = "slow: two phantoms with every lesion and decoy"]
fn a_colon_with_lesions_and_decoys_is_one_lumen() {
    for (pools, seed) in [(false, 1), (true, 2)] {
        let settings = PhantomSettings {
            size: Size::Small,
            seed,
            pools,
            lesions: true,
            decoys: true,
            ..PhantomSettings::default()
        };
        let phantom = Phantom::new(&settings);
        let volume = phantom.voxelise(&phantom.grid(), &Progress::new()).unwrap();
        let lumen = find(&volume, &Progress::new()).unwrap();
        let truth = phantom.truth();
        let length = lumen.segments.iter().map(|s| s.length_mm).sum::<f64>();
        println!("{length} of {}, {} segments", truth.length_mm, lumen.segments.len());
        assert!(lumen.is_flyable());
        assert!((length / truth.length_mm - 1.0).abs() < 0.12, "{length} of {}", truth.length_mm);
    }
}
