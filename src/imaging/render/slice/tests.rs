//! Tests cross-sections of volumes whose values are known.

use glam::DMat3;

use super::*;
use crate::volume::Grid;

#[test]
fn planes_are_seen_as_radiologists_see_them() {
    let edges = |plane: SlicePlane| plane.frame().unwrap().edges().join(" ");
    assert_eq!(edges(SlicePlane::Axial), "R L A P");
    assert_eq!(edges(SlicePlane::Coronal), "R L S I");
    assert_eq!(edges(SlicePlane::Sagittal), "A P S I");
    assert_eq!(edges(SlicePlane::Oblique(DVec3::NEG_Z)), "R L A P");
    for bad in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
        assert!(SlicePlane::Oblique(bad).frame().is_err());
    }
}

/// Linear values are exact on a rotated grid of stretched voxels, and a click maps to the world and back.
#[test]
fn linear_values_are_exact_in_every_plane() {
    let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-1.1);
    let grid = Grid::new([30, 28, 26], DVec3::new(0.7, 0.9, 1.6), DVec3::splat(-3.0), turn).unwrap();
    let slope = DVec3::new(3.0, -2.0, 1.0);
    // In whole HU at the voxels.
    let data = (0..grid.len())
        .map(|n| slope.dot(DVec3::from_array([n % 30, n / 30 % 28, n / 840].map(|c| c as f64))) as i16)
        .collect();
    let volume = Volume::new(grid.clone(), data);
    let centre = grid.world(DVec3::new(14.3, 13.1, 12.7));
    for plane in
        [SlicePlane::Axial, SlicePlane::Coronal, SlicePlane::Sagittal, SlicePlane::Oblique(DVec3::new(1.0, -2.0, 0.5))]
    {
        let slice = Slice { centre, frame: plane.frame().unwrap(), mm_per_pixel: 0.8, size: [41, 50] };
        let mut out = Vec::new();
        slice.fill(&volume, &mut out);
        let (mut inside, mut outside) = (0, 0);
        for (n, hu) in out.iter().enumerate() {
            let world = slice.world([(n % 41) as f64 + 0.5, (n / 41) as f64 + 0.5]);
            let v = grid.voxel(world);
            if v.min_element() > 0.0 && v.cmplt(DVec3::new(29.0, 27.0, 25.0)).all() {
                inside += 1;
                assert!((f64::from(*hu) - slope.dot(v)).abs() < 1e-3, "{plane:?} {n}: {hu}");
            }
            // Half a voxel beyond the outermost centres the scan ends.
            let in_it = v.min_element() >= -0.499 && v.cmplt(DVec3::new(29.499, 27.499, 25.499)).all();
            let out_of_it = v.min_element() < -0.501 || v.cmpgt(DVec3::new(29.501, 27.501, 25.501)).any();
            assert!(!(out_of_it && *hu != -1024.0 || in_it && *hu == -1024.0), "{plane:?} {n}: {hu} at {v}");
            outside += usize::from(out_of_it);
            let (back, before) = slice.pixel(world);
            assert!((back[0] - (n % 41) as f64 - 0.5).abs() < 1e-9 && before.abs() < 1e-9);
        }
        assert!(inside > 300 && outside > 100, "{plane:?}: {inside}, {outside}");
    }
    let far = Slice {
        centre: DVec3::splat(1e9),
        mm_per_pixel: f64::NAN,
        size: [3, 2],
        frame: SlicePlane::Axial.frame().unwrap(),
    };
    let mut out = Vec::new();
    far.fill(&volume, &mut out);
    assert_eq!(out, [-1024.0; 6]);
}

/// A volume of 40×36×32 voxels of 0.8×0.7×1.1 mm on a rotated grid. `f` gives the values at positions relative to its
/// middle (world, mm).
fn volume_of(turn: DMat3, f: impl Fn(DVec3) -> f64) -> (Volume, DVec3) {
    let grid = Grid::new([40, 36, 32], DVec3::new(0.8, 0.7, 1.1), DVec3::new(12.0, -7.0, 30.0), turn).unwrap();
    let middle = grid.world(DVec3::new(19.5, 17.5, 15.5));
    let at = |n: usize| DVec3::new((n % 40) as f64, (n / 40 % 36) as f64, (n / 1440) as f64);
    let data = (0..grid.len()).map(|n| f(grid.world(at(n)) - middle).round() as i16).collect();
    (Volume::new(grid, data), middle)
}

/// All 48 orientations of a grid's axes along the patient's.
fn orientations() -> Vec<DMat3> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let sign = |bits: usize, a: usize| if bits >> a & 1 == 1 { -1.0 } else { 1.0 };
    let one =
        |o: [usize; 3], bits| DMat3::from_cols_array_2d(&[0, 1, 2].map(|a| (axes[o[a]] * sign(bits, a)).to_array()));
    orders.into_iter().flat_map(|o| (0..8).map(move |bits| one(o, bits))).collect()
}

/// Every orientation of the grid shows the same side of the patient at each edge: values that increase to the patient's
/// left increase towards the edge labelled L.
#[test]
fn letters_hold_in_every_orientation() {
    assert_eq!(orientations().len(), 48);
    for (axis, letter) in [(DVec3::X, 'L'), (DVec3::Y, 'P'), (DVec3::Z, 'S')] {
        for turn in orientations() {
            let (volume, middle) = volume_of(turn, |d| 30.0 * d.dot(axis));
            let oblique = SlicePlane::Oblique(DVec3::new(0.4, -1.0, 0.3));
            for plane in [SlicePlane::Axial, SlicePlane::Coronal, SlicePlane::Sagittal, oblique] {
                let frame = plane.frame().unwrap();
                let slice = Slice { centre: middle, frame, mm_per_pixel: 0.5, size: [20, 20] };
                let mut out = Vec::new();
                slice.fill(&volume, &mut out);
                // From the middle to each edge: left, right, top, bottom.
                let growth = [10 * 20 + 2, 10 * 20 + 17, 2 * 20 + 10, 17 * 20 + 10].map(|n| out[n] - out[10 * 20 + 10]);
                for (edge, growth) in frame.edges().iter().zip(growth) {
                    assert!(!edge.contains(letter) || growth > 10.0, "{plane:?} {turn}: {edge} {growth}");
                    let opposite = match letter {
                        'L' => 'R',
                        'P' => 'A',
                        _ => 'I',
                    };
                    assert!(!edge.contains(opposite) || growth < -10.0, "{plane:?} {turn}: {edge} {growth}");
                }
            }
        }
    }
}

/// For a linear volume the mean is the value in the plane, and the extremes are those on the faces.
#[test]
fn slabs_of_a_linear_volume() {
    let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-1.1);
    let slope = DVec3::new(20.0, -30.0, 25.0);
    let (volume, middle) = volume_of(turn, |d| slope.dot(d));
    for plane in [SlicePlane::Axial, SlicePlane::Sagittal, SlicePlane::Oblique(DVec3::new(1.0, -2.0, 0.5))] {
        let frame = plane.frame().unwrap();
        let slice = Slice { centre: middle, frame, mm_per_pixel: 0.3, size: [15, 12] };
        for mm in [0.0, 0.01, 1.0, 6.3] {
            let across = 0.5 * mm * slope.dot(frame.normal()).abs();
            for (kind, more) in [(SlabKind::Mean, 0.0), (SlabKind::Max, across), (SlabKind::Min, -across)] {
                let mut out = Vec::new();
                slice.fill_slab(&volume, Slab::new(mm, kind).unwrap(), &mut out);
                for (n, hu) in out.iter().enumerate() {
                    let at = slice.world([(n % 15) as f64 + 0.5, (n / 15) as f64 + 0.5]) - middle;
                    // Voxels hold whole HU.
                    let error = (f64::from(*hu) - slope.dot(at) - more).abs();
                    assert!(error < 0.51, "{plane:?} {mm} mm {kind:?}: {error} HU");
                }
            }
        }
    }
}

/// For values c·z² the mean across z is c·T²/12 about 0, the largest c·T²/4, the least 0.
#[test]
fn slabs_of_a_quadratic_volume() {
    let (volume, middle) = volume_of(DMat3::IDENTITY, |d| 100.0 * d.z * d.z);
    let slice = Slice { centre: middle, frame: SlicePlane::Axial.frame().unwrap(), mm_per_pixel: 0.3, size: [8, 8] };
    // Trilinear values exceed the parabola by c·h²/6 on average, and the trapezoidal rule adds c·s²/6, with s at most h/2.
    for mm in [4.0, 11.0, 20.0] {
        let mut out = Vec::new();
        let mut fill = |kind| {
            slice.fill_slab(&volume, Slab::new(mm, kind).unwrap(), &mut out);
            assert!(out.iter().all(|hu| *hu == out[0]));
            f64::from(out[0])
        };
        let (mean, most, least) = (fill(SlabKind::Mean), fill(SlabKind::Max), fill(SlabKind::Min));
        assert!(
            (mean - 100.0 * mm * mm / 12.0 - 100.0 * 1.21 / 6.0).abs() < 100.0 * 0.35 * 0.35 / 6.0 + 1.0,
            "{mm}: {mean}"
        );
        assert!((most - 100.0 * mm * mm / 4.0 - 15.0).abs() < 16.0, "{mm}: {most}");
        // The middle is between two layers of voxels.
        assert!((least - 30.25).abs() < 1.0, "{mm}: {least}");
    }
}

/// Samples outside the scan do not count, unless all are outside.
#[test]
fn slabs_at_the_scans_end_count_what_is_in_it() {
    let (volume, _) = volume_of(DMat3::IDENTITY, |d| 10.0 * d.z);
    let grid = volume.grid();
    let slab = |mm, kind| Slab::new(mm, kind).unwrap();
    let middle_pixel = |z: f64, slab: Slab| {
        let centre = grid.world(DVec3::new(19.5, 17.5, z));
        let slice = Slice { centre, frame: SlicePlane::Axial.frame().unwrap(), mm_per_pixel: 0.3, size: [1, 1] };
        let mut out = Vec::new();
        slice.fill_slab(&volume, slab, &mut out);
        out[0]
    };
    // The topmost voxel's value, 170.5 HU rounded, holds for half its height beyond its centre.
    assert!((middle_pixel(31.4, Slab::default()) - 170.5).abs() < 0.6);
    assert_eq!(middle_pixel(31.6, Slab::default()), -1024.0);
    // The plane is outside, its slab is not.
    assert!((middle_pixel(31.6, slab(2.0, SlabKind::Max)) - 170.5).abs() < 0.6);
    let least = middle_pixel(31.6, slab(4.4, SlabKind::Min));
    assert!((least - (170.5 - 1.4 * 11.0)).abs() < 0.6, "{least}: 2.2 mm below 0.6 voxels above the topmost centre");
    let mean = middle_pixel(31.6, slab(4.4, SlabKind::Mean));
    assert!(mean > least && mean < 171.0, "{mean}");
    for kind in [SlabKind::Mean, SlabKind::Max, SlabKind::Min] {
        assert_eq!(middle_pixel(40.0, slab(2.0, kind)), -1024.0);
    }
    for mm in [-1.0, 20.1, f64::NAN, f64::INFINITY] {
        assert!(Slab::new(mm, SlabKind::Mean).is_err());
    }
}

/// Any number of threads, any subset of rows at a time and every SIMD level give the same bytes. A second fill needs no new memory.
#[test]
fn threads_and_parts_change_nothing() {
    let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-0.2);
    let (volume, centre) = volume_of(turn, |d| 400.0 * (d.x * 0.9).sin() + 300.0 * (d.y * 1.3).cos() - 20.0 * d.z);
    let frame = SlicePlane::Oblique(DVec3::new(0.3, 0.8, -0.6)).frame().unwrap();
    let slice = Slice { centre, frame, mm_per_pixel: 0.21, size: [203, 171] };
    for slab in [Slab::default(), Slab::new(3.0, SlabKind::Mean).unwrap(), Slab::new(3.0, SlabKind::Max).unwrap()] {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut out = Vec::new();
            pool.install(|| slice.fill_slab(&volume, slab, &mut out));
            let place = out.as_ptr();
            pool.install(|| slice.fill_slab(&volume, slab, &mut out));
            assert_eq!(place, out.as_ptr());
            out.iter().map(|hu| hu.to_bits()).collect::<Vec<u32>>()
        };
        let one = on(1);
        assert!(one == on(2) && one == on(3));
        let mut rows = vec![0.0; 203 * 171];
        for (n, part) in rows.chunks_mut(203 * 50).enumerate() {
            slice.fill_rows(&volume, slab, n * 50, part);
        }
        assert!(rows.iter().map(|hu| hu.to_bits()).eq(one.iter().copied()));
        let mut near = Near::default();
        for (name, level) in crate::render::packets::levels() {
            let scan = Patched { volume: &volume, patch: None };
            slice.fill_rows_on(level, scan, slab, (0, &mut rows), &mut near);
            assert!(rows.iter().map(|hu| hu.to_bits()).eq(one.iter().copied()), "{name}");
        }
    }
}

/// Where a patch lies over the scan, slices and slabs show its values, and between it and the rest those of the scan: as one volume with
/// both shows them.
#[test]
fn a_patch_is_seen_as_one_volume_with_it_is() {
    let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-0.2);
    let (scan, centre) = volume_of(turn, |d| 400.0 * (d.x * 0.9).sin() + 300.0 * (d.y * 1.3).cos() - 20.0 * d.z);
    let [nx, ny, nz] = scan.grid().dims();
    // Only the inner voxels of the box differ. One box is in the middle, one reaches to a corner.
    for (low, high) in [([3, 4, 2], [nx - 4, ny - 3, nz - 5]), ([0, 0, 0], [nx - 1, ny / 2, nz / 2])] {
        let is_inner = |v: [usize; 3]| {
            (0..3).all(|a| (v[a] > low[a] || low[a] == 0) && (v[a] < high[a] || high[a] + 1 == scan.grid().dims()[a]))
        };
        let value = |n: usize| {
            let hu = scan.data()[n];
            if is_inner([n % nx, n / nx % ny, n / nx / ny]) { hu / 2 - 300 } else { hu }
        };
        let whole = Volume::new(scan.grid().clone(), (0..scan.data().len()).map(value).collect());
        let dims = [0, 1, 2].map(|a| high[a] + 1 - low[a]);
        let mut data = Vec::new();
        for (z, y) in (low[2]..=high[2]).flat_map(|z| (low[1]..=high[1]).map(move |y| (z, y))) {
            data.extend((low[0]..=high[0]).map(|x| whole.data()[scan.grid().index(x, y, z)]));
        }
        let patch = Volume::new(scan.grid().part(low, dims), data);
        let mut near = Near::default();
        let oblique = SlicePlane::Oblique(DVec3::new(0.3, 0.8, -0.6));
        for plane in [SlicePlane::Axial, SlicePlane::Sagittal, oblique] {
            let slice = Slice { centre, frame: plane.frame().unwrap(), mm_per_pixel: 0.21, size: [150, 120] };
            for slab in
                [Slab::default(), Slab::new(6.0, SlabKind::Mean).unwrap(), Slab::new(6.0, SlabKind::Min).unwrap()]
            {
                let [mut patched, mut expected, mut raw] = [(); 3].map(|()| vec![0.0; 150 * 120]);
                let both = Patched { volume: &scan, patch: Some(&patch) };
                slice.fill_rows_patched(both, slab, (0, &mut patched), &mut near);
                slice.fill_rows(&whole, slab, 0, &mut expected);
                slice.fill_rows(&scan, slab, 0, &mut raw);
                let off = patched.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(off < 0.2, "{plane:?} {slab:?}: {off} HU");
                assert!(raw.iter().zip(&expected).any(|(a, b)| (a - b).abs() > 50.0), "there is a difference to see");
            }
        }
    }
}

/// Extreme slices and scans: nothing panics, and everything outside is −1024.
#[test]
fn extreme_slices() {
    let frame = SlicePlane::Axial.frame().unwrap();
    let filled = |volume: &Volume, centre, mm_per_pixel, size, slab| {
        let mut out = Vec::new();
        Slice { centre, frame, mm_per_pixel, size }.fill_slab(volume, slab, &mut out);
        out
    };
    let (volume, middle) = volume_of(DMat3::IDENTITY, |_| 7.0);
    let single = |dims: [usize; 3]| {
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        Volume::new(grid.clone(), vec![7; grid.len()])
    };
    for slab in [Slab::default(), Slab::new(20.0, SlabKind::Mean).unwrap(), Slab::new(1.0, SlabKind::Min).unwrap()] {
        for mm in [5e-324, 1e-300, 1e300, f64::MAX, f64::INFINITY, f64::NAN, 0.0, -1.0] {
            for centre in [middle, DVec3::MAX, DVec3::MIN, DVec3::NAN, DVec3::INFINITY, DVec3::splat(1e12)] {
                for size in [[1, 1], [2, 3], [130, 2], [0, 5], [5, 0]] {
                    let out = filled(&volume, centre, mm, size, slab);
                    assert_eq!(out.len(), size[0] * size[1]);
                    assert!(out.iter().all(|hu| (*hu - 7.0).abs() < 1e-4 || *hu == -1024.0), "{centre} {mm} {out:?}");
                }
            }
        }
        // One voxel, one row, one layer: the picture is as large as they are.
        for dims in [[1, 1, 1], [5, 1, 1], [1, 5, 1], [5, 5, 1], [1, 1, 5]] {
            let out = filled(&single(dims), DVec3::ZERO, 0.25, [64, 64], slab);
            let inside = out.iter().filter(|hu| **hu == 7.0).count();
            assert_eq!(inside, 16 * dims[0] * dims[1], "{dims:?} {slab:?}");
        }
    }
}

/// The two sampling methods, at the scan's border and within, agree.
#[test]
fn runs_agree_with_single_samples() {
    let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-0.2);
    let (volume, centre) = volume_of(turn, |d| 400.0 * (d.x * 0.9).sin() + 300.0 * (d.y * 1.3).cos() - 20.0 * d.z);
    let frame = SlicePlane::Oblique(DVec3::new(0.3, 0.8, -0.6)).frame().unwrap();
    let slice = Slice { centre, frame, mm_per_pixel: 0.21, size: [203, 171] };
    let mut out = Vec::new();
    slice.fill(&volume, &mut out);
    let inside = out.iter().filter(|hu| **hu != -1024.0).count();
    assert!(inside > 9000 && inside < out.len(), "{inside}");
    for (n, hu) in out.iter().enumerate() {
        let centre = slice.world([(n % 203) as f64 + 0.5, (n / 203) as f64 + 0.5]);
        let mut alone = Vec::new();
        Slice { centre, size: [1, 1], ..slice }.fill(&volume, &mut alone);
        // At the very border rounding decides.
        let at_border = {
            let v = volume.grid().voxel(centre);
            let dims = DVec3::new(40.0, 36.0, 32.0);
            (v + 0.5).abs().min((v + 0.5 - dims).abs()).min_element() < 1e-9
        };
        assert!(at_border || (hu - alone[0]).abs() < 1e-3, "{n}: {hu} and {}", alone[0]);
    }
}

/// A line that enters the scan through a corner is outside before it, in every direction.
#[test]
fn a_line_through_a_corner_is_in_the_scan_from_there_on() {
    let grid = Grid::new([12; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let volume = Volume::new(grid.clone(), vec![500; grid.len()]);
    for sign in [-1.0, 1.0] {
        for normal in [DVec3::new(1.0, 1.0, -2.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(-2.0, 1.0, 1.0)] {
            let frame = SlicePlane::Oblique(normal * sign).frame().unwrap();
            let slice = Slice { centre: DVec3::splat(5.5), frame, mm_per_pixel: 0.7, size: [48, 48] };
            let mut out = Vec::new();
            slice.fill(&volume, &mut out);
            for (n, hu) in out.iter().enumerate() {
                let v = slice.world([(n % 48) as f64 + 0.5, (n / 48) as f64 + 0.5]);
                let beyond = (v - DVec3::splat(5.5)).abs().max_element() - 6.0;
                if beyond.abs() > 1e-3 {
                    assert_eq!(*hu, if beyond < 0.0 { 500.0 } else { -1024.0 }, "{normal} {v}");
                }
            }
        }
    }
}

/// What was copied serves the planes beside it, but no other scan, nor the same with other values.
#[test]
fn copied_voxels_are_those_of_the_scan() {
    let (mut scan, centre) = volume_of(DMat3::IDENTITY, |d| 400.0 * (d.x * 0.9).sin() + 300.0 * (d.y * 1.3).cos());
    let frame = SlicePlane::Sagittal.frame().unwrap();
    let (mut near, mut out) = (Near::default(), vec![0.0; 120 * 110]);
    let mut check = |scan: &Volume, mm: f64| {
        let centre = centre + DVec3::X * mm;
        let slice = Slice { centre, frame, mm_per_pixel: 0.2, size: [120, 110] };
        slice.fill_rows_patched(Patched { volume: scan, patch: None }, Slab::default(), (0, &mut out), &mut near);
        let mut expected = Vec::new();
        slice.fill(scan, &mut expected);
        assert_eq!(out, expected, "{mm}");
        near.scan.of()
    };
    let held = [0.0, 0.4, -0.7, 1.1].map(|mm| check(&scan, mm));
    assert!(held[0].is_some() && held.iter().all(|h| *h == held[0]), "{held:?}");
    assert_ne!(check(&scan, 8.0), held[0]);
    let clone = scan.clone();
    let here = check(&scan, 0.0);
    assert_eq!(check(&clone, 0.0), here);
    scan.data_mut().iter_mut().for_each(|hu| *hu = -*hu);
    assert_ne!(check(&scan, 0.0), here);
    assert_ne!(check(&clone.part([0; 3], clone.grid().dims()), 0.0), here);
}

/// Samples of voxels that were copied first are those of the scan, to the bit: in the middle, at the edges and beyond them, on a layer of
/// voxels and between two, with and without a patch.
#[test]
fn copied_voxels_change_nothing() {
    let (scan, centre) =
        volume_of(DMat3::IDENTITY, |d| 400.0 * (d.x * 0.9).sin() + 300.0 * (d.y * 1.3).cos() - 20.0 * d.z);
    let low = [3, 4, 2];
    let dims = [0, 1, 2].map(|a| scan.grid().dims()[a] - low[a] - 2);
    let patch = scan.part(low, dims);
    let patch = Volume::new(patch.grid().clone(), patch.data().iter().map(|hu| hu / 2 - 300).collect());
    for plane in [SlicePlane::Axial, SlicePlane::Coronal, SlicePlane::Sagittal] {
        let frame = plane.frame().unwrap();
        let layer = scan.grid().world(scan.grid().voxel(centre).round());
        for (centre, mm_per_pixel) in [(layer, 0.2), (centre, 0.2), (layer, 0.03), (centre + DVec3::splat(9.3), 0.1)] {
            let slice = Slice { centre, frame, mm_per_pixel, size: [203, 170] };
            for slab in [Slab::default(), Slab::new(2.0, SlabKind::Max).unwrap()] {
                for patch in [None, Some(&patch)] {
                    let mut sampler = Sampler::new(&scan);
                    if let Some(patch) = patch {
                        sampler = sampler.with_patch(Sampler::new(patch));
                    }
                    let samples = slab.samples(scan.grid(), frame.normal());
                    let step = scan.grid().to_voxel().transform_vector3(frame.right() * mm_per_pixel);
                    let [mut expected, mut out] = [(); 2].map(|()| vec![0.0f32; 203 * 170]);
                    for (y, row) in expected.chunks_mut(203).enumerate() {
                        let start = scan.grid().voxel(slice.world([0.5, y as f64 + 0.5]));
                        fearless_simd::dispatch!(Level::new(), simd => samples.row(simd, &sampler, start, step, row));
                    }
                    let mut near = Near::default();
                    slice.fill_rows_patched(Patched { volume: &scan, patch }, slab, (0, &mut out), &mut near);
                    let same = out.iter().map(|hu| hu.to_bits()).eq(expected.iter().map(|hu| hu.to_bits()));
                    assert!(same, "{plane:?} {mm_per_pixel} {slab:?} {}", patch.is_some());
                    let is_copied = near.bytes() > 0;
                    assert!(is_copied || plane != SlicePlane::Sagittal, "{mm_per_pixel} {slab:?}");
                }
            }
        }
    }
}
