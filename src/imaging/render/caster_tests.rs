use std::sync::Arc;

use glam::{DMat3, DVec3};
use proptest::prelude::*;

use super::*;
use crate::math::hash;
use crate::render::psnr;
use crate::space::TransferFunction;
use crate::volume::{Grid, Volume};

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

/// Air with random specks of any density: the most uneven volume possible.
fn specks(dims: [usize; 3], seed: u64, share: f64) -> PreparedVolume {
    volume(dims, DVec3::new(0.7, 0.6, 1.1), DMat3::from_rotation_x(0.4), |p| {
        let n = (p.x + 128.0 * (p.y + 128.0 * p.z)) as u64;
        if hash::uniform(seed, n) < share { -1000.0 + 1000.0 * hash::uniform(!seed, n) } else { -1000.0 }
    })
}

fn cavity(centre: DVec3, radius: f64) -> impl Fn(DVec3) -> f64 {
    move |p| -1000.0 + 1050.0 * (((p - centre).length() - radius) / 2.0 + 1.0 / 3.0).clamp(0.0, 1.0)
}

fn shoot(volume: &PreparedVolume, view: &View, settings: &Settings) -> (Frame, Work) {
    let mut frame = Frame::with_depth(1, 1);
    let work = render(volume, view, settings, &mut frame);
    (frame, work)
}

/// Renders the picture with the parts of `settings`, skipping nothing.
fn unskipped(volume: &PreparedVolume, view: &View, settings: &Settings) -> Frame {
    let mut frame = Frame::with_depth(1, 1);
    let (high, low) = (Trilinear::new(volume), Nearest::new(volume));
    let (request, all, mut kept) =
        (ImageRequest { volume, view, settings }, &Everything, vec![(); view.width() * view.height()]);
    match (settings.quality, settings.classification) {
        (Quality::Low, Classification::Value) => {
            request.image(&low, all, &ByValue, &FromScratch, &mut kept, &mut frame)
        }
        (Quality::Low, _) => request.image(&low, all, &ByDensity, &FromScratch, &mut kept, &mut frame),
        (_, Classification::Value) => request.image(&high, all, &ByValue, &FromScratch, &mut kept, &mut frame),
        (..) => request.image(&high, all, &ByDensity, &FromScratch, &mut kept, &mut frame),
    };
    frame
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]
    #[test]
    fn skipping_changes_no_bit(
        dims in prop::array::uniform3(1usize..60), seed: u64, share in prop_oneof![Just(0.0), 0.0..0.002f64, 0.0..0.1f64],
        from in prop::array::uniform3(-0.3..1.3f64), to in prop::array::uniform3(0.0..1.0f64), quality in 0..4usize,
        fov in 20.0..150.0f64, wall in prop_oneof![Just((-800.0, -500.0)), Just((-1100.0, -500.0)), Just((-999.5, 40.0))],
    ) {
        let s = specks(dims, seed, share);
        let s = PreparedVolume::new(Arc::new(s.voxels().clone()), TransferFunction::new(wall.0, wall.1).unwrap());
        let grid = s.voxels().grid();
        let at = |q: [f64; 3]| grid.world(DVec3::from_array(std::array::from_fn(|a| q[a] * dims[a] as f64)));
        let view = View::new(at(from), at(to) - at(from), DVec3::Z, fov, 24, 16).unwrap();
        let mut settings = Settings::new([Quality::High, Quality::Low][quality % 2]);
        settings.classification = [Classification::Value, Classification::Filtered][quality / 2];
        let (frame, _) = shoot(&s, &view, &settings);
        prop_assert!(frame == unskipped(&s, &view, &settings));
    }
}

#[test]
fn skipping_changes_no_bit_along_axes_and_planes() {
    let s = specks([70, 50, 40], 5, 0.0005);
    let s = PreparedVolume::new(
        Arc::new(Volume::new(
            Grid::new([70, 50, 40], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap(),
            s.voxels().data().to_vec(),
        )),
        TransferFunction::default(),
    );
    for n in 0..6 {
        let mut forward = DVec3::ZERO;
        forward[n % 3] = if n < 3 { 1.0 } else { -1.0 };
        // The corner of pixel (16, 16), not its centre, is on the axis; odd sizes send rays along it.
        for (position, size) in [(DVec3::splat(7.0), 33), (DVec3::splat(15.5), 33), (DVec3::splat(23.0), 32)] {
            let view = View::new(position, forward, DVec3::new(0.0, 1.0, 1.0), 90.0, size, size).unwrap();
            let settings = Settings::default();
            assert!(shoot(&s, &view, &settings).0 == unskipped(&s, &view, &settings), "{n} {position}");
        }
    }
}

#[test]
fn any_number_of_threads_renders_the_same_bytes() {
    let s = volume([60; 3], DVec3::ONE, DMat3::IDENTITY, cavity(DVec3::splat(30.0), 22.0));
    let centre = s.voxels().grid().world(DVec3::splat(27.0));
    let view = View::new(centre, DVec3::X, DVec3::Z, 90.0, 203, 101).unwrap();
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| shoot(&s, &view, &Settings { samples_per_pixel: 3, ..Settings::default() }))
    };
    let one = on(1);
    assert_eq!(one.1.rays, 203 * 101 * 3);
    for threads in [2, 3, 5] {
        assert!(on(threads) == one);
    }
}

#[test]
fn high_is_near_reference() {
    let centre = DVec3::splat(40.0);
    let s = volume([80; 3], DVec3::splat(0.7), DMat3::IDENTITY, |p| {
        // A cavity with bumps that resemble folds.
        let r = 25.0 + 4.0 * (0.5 * p.x).sin() * (0.4 * p.y).cos();
        cavity(centre, r)(p)
    });
    let view = View::new(s.voxels().grid().world(centre), DVec3::new(1.0, 0.3, 0.2), DVec3::Z, 90.0, 160, 160).unwrap();
    let (reference, brute) = shoot(&s, &view, &Settings::new(Quality::Reference));
    let (high, work) = shoot(&s, &view, &Settings::new(Quality::High));
    let (low, _) = shoot(&s, &view, &Settings::new(Quality::Low));
    println!("PSNR: high {:.1} dB, low {:.1} dB", psnr(&high, &reference), psnr(&low, &reference));
    assert!(psnr(&high, &reference) > 40.0);
    assert!(psnr(&low, &reference) > 15.0 && psnr(&low, &reference) < psnr(&high, &reference));
    assert!(work.samples * 10 < brute.samples);
    assert_eq!(psnr(&reference, &reference), f64::INFINITY);
    // The wall is closed on all sides, so no pixel is darker than ambient light makes it.
    assert!(high.pixels().iter().all(|p| p[0] > 20));
}

/// An asymmetric block in air, which must appear on the correct side of the image.
#[test]
fn left_and_right_are_right_for_every_handedness() {
    for sign in [1.0, -1.0] {
        for tilt in [0.0, 0.5] {
            let direction = DMat3::from_rotation_z(tilt) * DMat3::from_diagonal(DVec3::new(sign, 1.0, 1.0));
            let grid = Grid::new([40; 3], DVec3::ONE, DVec3::ZERO, direction).unwrap();
            let centre = grid.world(DVec3::splat(19.5));
            // Tissue on the patient's left and superior, 10 mm behind the camera's plane.
            let target = centre + DVec3::new(6.0, 10.0, 3.0);
            let data = (0..grid.len()).map(|n| {
                let p = DVec3::new((n % 40) as f64, (n / 40 % 40) as f64, (n / 1600) as f64);
                if (grid.world(p) - target).length() < 2.0 { 40 } else { -1000 }
            });
            let data = data.collect();
            let s = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
            let view = View::new(centre, DVec3::Y, DVec3::Z, 90.0, 41, 41).unwrap();
            for quality in [Quality::High, Quality::Low, Quality::Reference] {
                let (frame, _) = shoot(&s, &view, &Settings::new(quality));
                let lit: Vec<usize> = (0..41 * 41).filter(|&n| frame.pixels()[n][0] > 40).collect();
                let mean = |f: fn(usize) -> usize| lit.iter().map(|&n| f(n) as f64).sum::<f64>() / lit.len() as f64;
                // 6 mm to the right and 3 mm up at a distance of 10 mm.
                assert!((mean(|n| n % 41) - (20.0 + 0.6 * 20.5)).abs() < 1.5, "{sign} {tilt} {quality:?}");
                assert!((mean(|n| n / 41) - (20.0 - 0.3 * 20.5)).abs() < 1.5);
                let depth = frame.depth().unwrap();
                assert!(lit.iter().any(|&n| (f64::from(depth[n]) - (target - centre).length() + 2.0).abs() < 1.0));
                assert_eq!(depth[0], f32::INFINITY);
            }
        }
    }
}

/// Depth against an analytic tube and sphere, sampled on the grid.
#[test]
fn depth_is_that_of_the_analytic_wall() {
    let h = 0.7;
    let axis = DVec3::new(0.2, 0.3, 1.0).normalize();
    let centre = DVec3::splat(35.0);
    let across = |p: DVec3| (p - centre) - axis * (p - centre).dot(axis);
    // A logistic edge from −1000 to 50 HU, shifted so that −650 HU, a third of its height, is on the analytic wall.
    let width = 0.45;
    let profile = |d: f64| -1000.0 + 1050.0 / (1.0 + (-(d / width) + 2f64.ln()).exp());
    assert!((profile(0.0) + 650.0).abs() < 1e-6);
    for tube in [true, false] {
        let offset = |p: DVec3| if tube { across(p).length() - 20.0 } else { (p - centre).length() - 20.0 };
        let s = volume([71; 3], DVec3::splat(h), DMat3::IDENTITY, |p| profile(offset(p)));
        let grid = s.voxels().grid();
        let from = centre + DVec3::new(6.0, -5.0, 4.0);
        let view = View::new(grid.world(from), DVec3::new(1.0, 0.2, 0.1), DVec3::Z, 120.0, 120, 120).unwrap();
        let (frame, _) = shoot(&s, &view, &Settings::default());
        let mut errors = Vec::new();
        for y in 0..120 {
            for x in 0..120 {
                let d = view.ray(x, y).unwrap().direction;
                let (o, d2, r) =
                    if tube { (across(from), d - axis * d.dot(axis), 20.0) } else { (from - centre, d, 20.0) };
                let (a, b, c) = (d2.length_squared(), o.dot(d2), o.length_squared() - r * r);
                let t = (-b + (b * b - a * c).sqrt()) / a;
                let hit = o + d2 * t;
                let steep = hit.normalize().dot(d) > 20f64.to_radians().sin();
                let inside = from + d * t;
                if steep && inside.min_element() > 1.0 && inside.max_element() < 69.0 {
                    errors.push((f64::from(frame.depth().unwrap()[y * 120 + x]) / h - t).abs());
                }
            }
        }
        errors.sort_by(f64::total_cmp);
        assert!(errors.len() > 5000);
        let (median, most) = (errors[errors.len() / 2], errors[errors.len() * 99 / 100]);
        println!("depth error, voxels: median {median:.3}, 99 % {most:.3}");
        assert!(median < 0.1 && most < 0.5);
    }
}

#[test]
fn every_view_of_every_volume_is_a_picture() {
    let one = DVec3::ONE;
    let thick = DVec3::new(0.3, 0.3, 10.0);
    let lumen = |p: DVec3| if p.x == 5.0 && p.y == 5.0 { -1000.0 } else { 40.0 };
    let spaces = [
        volume([1; 3], one, DMat3::IDENTITY, |_| 40.0),
        volume([2, 2, 2], thick, DMat3::IDENTITY, |p| -1000.0 * p.x),
        volume([40, 40, 1], thick, DMat3::IDENTITY, |p| -1000.0 + 30.0 * p.x),
        volume([20; 3], thick, DMat3::IDENTITY, cavity(DVec3::splat(10.0), 8.0)),
        volume([11, 11, 30], one, DMat3::IDENTITY, lumen),
        volume([20; 3], one, DMat3::IDENTITY, |_| -1000.0),
        volume([20; 3], one, DMat3::IDENTITY, |_| 40.0),
        volume([20; 3], DVec3::new(1e-6, 1.0, 1e6), DMat3::IDENTITY, |p| -1000.0 + 100.0 * p.y),
    ];
    for s in &spaces {
        let grid = s.voxels().grid();
        let dims = DVec3::from_array(grid.dims().map(|n| n as f64));
        for at in [0.5, 0.499, 0.0, 1.0, -3.0, 40.0] {
            let voxel = if at == 0.5 { (dims * at).floor() } else { dims * at };
            for (forward, fov) in [(DVec3::X, 90.0), (DVec3::new(-1.0, 0.5, 0.1), 1.0), (DVec3::NEG_Z, 170.0)] {
                let view = View::new(grid.world(voxel), forward, DVec3::Z, fov, 15, 9).unwrap();
                for quality in [Quality::High, Quality::Low, Quality::Reference] {
                    let (frame, work) = shoot(s, &view, &Settings::new(quality));
                    assert_eq!(work.rays, 15 * 9);
                    assert!(frame.depth().unwrap().iter().all(|d| *d >= 0.0));
                }
            }
        }
    }
}

#[test]
fn outside_in_tissue_and_in_air() {
    let tissue = volume([20; 3], DVec3::ONE, DMat3::IDENTITY, |_| 40.0);
    let c = tissue.voxels().grid().world(DVec3::splat(9.5));
    let request = |s: &PreparedVolume, from, forward| {
        let view = View::new(from, forward, DVec3::Z, 40.0, 21, 21).unwrap();
        shoot(s, &view, &Settings::default()).0
    };
    // In a homogeneous region the gradient points at the camera: full brightness everywhere.
    let full = (255.0 * (0.9 + 0.05 * 1040.0 / 1100.0) + 0.5) as u8;
    let inside = request(&tissue, c, DVec3::X);
    assert!(inside.pixels().iter().all(|p| p[0] == full), "{:?}", inside.pixels()[0]);
    assert!(inside.depth().unwrap().iter().all(|&d| d == 0.0));
    // From outside, its face is a wall seen along its normal.
    let outside = request(&tissue, c - DVec3::X * 40.0, DVec3::X);
    assert!(outside.pixels()[10 * 21 + 10][0] > 200);
    assert!((f64::from(outside.depth().unwrap()[10 * 21 + 10]) - (30.5 - 690.0 / 1064.0)).abs() < 1e-4);
    let away = request(&tissue, c - DVec3::X * 40.0, DVec3::NEG_X);
    assert!(away.pixels().iter().all(|p| *p == [0; 3]));
    assert!(away.depth().unwrap().iter().all(|d| *d == f32::INFINITY));
    let air = volume([20; 3], DVec3::ONE, DMat3::IDENTITY, |_| -1000.0);
    assert!(request(&air, c, DVec3::X).pixels().iter().all(|p| *p == [0; 3]));
}

#[test]
fn classifying_by_filtered_density_draws_the_same_wall() {
    let s = volume([60; 3], DVec3::ONE, DMat3::IDENTITY, cavity(DVec3::splat(30.0), 22.0));
    let view = View::new(s.voxels().grid().world(DVec3::splat(30.0)), DVec3::X, DVec3::Z, 90.0, 80, 80).unwrap();
    let filtered = Settings { classification: Classification::Filtered, ..Settings::default() };
    let (by_value, by_density) = (shoot(&s, &view, &Settings::default()).0, shoot(&s, &view, &filtered).0);
    assert!(by_value != by_density && psnr(&by_value, &by_density) > 30.0);
}

#[test]
fn a_frame_that_fits_keeps_its_memory() {
    let s = specks([20; 3], 1, 0.01);
    let view = View::new(DVec3::ZERO, DVec3::X, DVec3::Z, 90.0, 30, 20).unwrap();
    let mut frame = Frame::with_depth(30, 20);
    let (pixels, depth) = (frame.pixels().as_ptr(), frame.depth().unwrap().as_ptr());
    render(&s, &view, &Settings::default(), &mut frame);
    assert_eq!((frame.pixels().as_ptr(), frame.depth().unwrap().as_ptr()), (pixels, depth));
    assert_eq!((frame.width(), frame.height()), (30, 20));
}

#[test]
fn rays_of_a_pixel_are_spread_over_it() {
    assert_eq!(within_pixel(0, 1), (0.5, 0.5));
    for count in [2u32, 4, 9, 16, 61] {
        let points: Vec<_> = (0..count).map(|n| within_pixel(n, count)).collect();
        let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / f64::from(count);
        assert!((mean(|p| p.0) - 0.5).abs() < 1e-9 && (mean(|p| p.1) - 0.5).abs() < 0.35 / f64::from(count).sqrt());
        assert!(points.iter().all(|p| p.0 > 0.0 && p.0 < 1.0 && p.1 >= 0.0 && p.1 < 1.0));
    }
}
