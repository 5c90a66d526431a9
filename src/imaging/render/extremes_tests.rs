//! Extreme cases for rays, tested with every renderer. To add a renderer, add a line to [`RENDERERS`].
//!
//! Every picture must satisfy four conditions. It has no NaN (a colour cast from NaN is 0, so a wall would be black).
//! There is no endless loop: the samples are at most as many as the ray's length has steps. There is no crack: no pixel
//! is black where the wall is closed on all sides. No wall thicker than a voxel is missed.
//!
//! Why none is missed: a scanner's voxel is the mean over its box. For a wall that is at least h thick (h the smallest spacing),
//! the voxels whose centres are within h/2 of its middle are at least half tissue: −475 HU for −1000 to 50. So is every trilinear
//! value within h/4 of the middle, which is therefore opaque. Steps of h/2 (high) or less put a sample there at any angle, since a
//! slanted ray stays inside for longer. The nearest voxel (low) may be √3/2 h away from the sample, and the sample h/2 from the
//! middle, so low detail is only certain for walls from 2.75 h on: [`slabs_thicker_than_a_voxel_stop_every_ray`].

use std::sync::Arc;

use fearless_simd::Level;
use glam::{DMat3, DQuat, DVec3};

use super::packets::{PacketRenderer, Pixels};
use super::reuse::paper::Trace;
use super::reuse::{Refresh, Reusing, WordStorage};
use super::*;
use crate::checks::cases;
use crate::math::hash;
use crate::volume::{Grid, Volume};

type Make = fn(&PreparedVolume, Settings) -> Box<dyn Renderer>;

/// The preset with a leaping method and key frames, which change no bit.
fn leaping(volume: &PreparedVolume, settings: Settings, preset: Preset, leap: Leaping) -> Box<dyn Renderer> {
    let gradients = settings.choices.gradients;
    let choices = Choices { leap: Some(leap), gradients, key_frames: Some(3), low: Some(LowDetail::Nearest) };
    renderer(volume, Settings { choices, ..settings }, preset, Reuse::Allowed)
}

/// Every renderer, with the number of rays that it casts at once. The first six produce identical bytes, as do the four
/// of `colvis` and the two that give every pixel a ray of a packet.
const RENDERERS: [(&str, usize, Make); 14] = [
    ("direct", 1, |s, q| Box::new(Direct::new(s, q))),
    ("lean", 1, |s, q| {
        renderer(&PreparedVolume::lean(s.shared_voxels(), s.transfer()), q, presets::lean::PRESET, Reuse::Allowed)
    }),
    ("reusing", 1, |s, q| Box::new(Reusing::<_, f32>::new(WordStorage::new(s), q, Refresh::Staggered(16)))),
    ("paper's rule", 1, |s, q| Box::new(Reusing::<_, Trace>::new(WordStorage::new(s), q, Refresh::KeyFrames(10)))),
    ("leaping by voxels", 1, |s, q| leaping(s, q, presets::standard::PRESET, Leaping::Voxel)),
    ("leaping by bricks", 1, |s, q| leaping(s, q, presets::standard::PRESET, Leaping::Brick)),
    ("colvis", 1, |s, q| renderer(s, q, presets::colvis::PRESET, Reuse::Allowed)),
    ("colvis without reuse", 1, |s, q| renderer(s, q, presets::colvis::PRESET, Reuse::Never)),
    ("colvis leaping by voxels", 1, |s, q| leaping(s, q, presets::colvis::PRESET, Leaping::Voxel)),
    ("colvis leaping by nothing", 1, |s, q| leaping(s, q, presets::colvis::PRESET, Leaping::None)),
    ("stored gradients", 1, |s, q| {
        let choices = Choices { gradients: Some(GradientSource::Stored), ..q.choices };
        leaping(s, Settings { choices, ..q }, presets::colvis::PRESET, Leaping::Flag)
    }),
    ("default", 16, |s, q| renderer(s, q, Preset::default(), Reuse::Allowed)),
    ("packets", 16, |s, q| Box::new(PacketRenderer::new(s, q, Pixels::All))),
    ("packets at the lowest level", 16, |s, q| {
        Box::new(PacketRenderer::with_level(s, q, Pixels::All, Level::baseline()))
    }),
];

const QUALITIES: [Quality; 3] = [Quality::High, Quality::Low, Quality::Reference];

fn volume(dims: [usize; 3], spacing: DVec3, origin: DVec3, f: impl Fn(DVec3) -> f64) -> PreparedVolume {
    let grid = Grid::new(dims, spacing, origin, DMat3::IDENTITY).unwrap();
    let place =
        |n: usize| DVec3::new((n % dims[0]) as f64, (n / dims[0] % dims[1]) as f64, (n / dims[0] / dims[1]) as f64);
    let data = (0..grid.len()).map(|n| f(place(n)).round() as i16).collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

/// A closed cavity, in voxels.
fn cavity(centre: DVec3, radii: DVec3) -> impl Fn(DVec3) -> f64 {
    move |p| {
        let out = (((p - centre) / radii).length() - 1.0) * radii.min_element();
        -1000.0 + 1050.0 * (out / 2.0 + 0.4).clamp(0.0, 1.0)
    }
}

/// Renders the view twice, the second time with any data kept from the first, and checks the conditions for every picture.
fn look(
    name: &str,
    lanes: usize,
    r: &mut dyn Renderer,
    volume: &PreparedVolume,
    view: &View,
    settings: &Settings,
) -> Frame {
    let mut frame = Frame::with_depth(1, 1);
    let first = r.render(view, &mut frame);
    let alone = frame.clone();
    let again = r.render(view, &mut frame);
    assert!(frame == alone, "{name}: the same view again is another picture: {view:?}");
    let (grid, step) = (volume.voxels().grid(), march::Step::new(volume, settings.step_power).mm);
    let diagonal = (DVec3::from_array(grid.dims().map(|n| (n + 1) as f64)) * grid.spacing()).length();
    // Renderers of single rays cast one per sample of a pixel. Packets count every lane of a step as a sample,
    // including lanes that are outside the picture or have ended, but count only some of them as rays. Their bound is
    // looser by that factor, and still shows that no loop is endless.
    let pixels = view.width() * view.height() * settings.samples_per_pixel as usize;
    for work in [first, again] {
        let rays = if lanes == 1 { pixels } else { lanes * work.rays as usize };
        let bound = (diagonal / step + 2.0) * rays as f64;
        assert!(work.samples as f64 <= bound && work.reused <= work.rays, "{name}: {work:?} of {bound}");
    }
    assert!(frame.depth().unwrap().iter().all(|d| *d >= 0.0), "{name}: a depth is no number");
    frame
}

/// Views along axes, faces, edges and corners and at odd angles, including the narrowest and widest.
fn views(at: DVec3, size: usize) -> Vec<View> {
    let one = |v: [f64; 3]| DVec3::from_array(v);
    let mut forwards = vec![one([0.3, -0.8, 0.52]), one([1.0, 1e-7, -1e-7]), one([1.0, 1.0 + 1e-9, 1.0])];
    for n in 0..27 {
        let v = DVec3::new(f64::from(n % 3) - 1.0, f64::from(n / 3 % 3) - 1.0, f64::from(n / 9) - 1.0);
        if v != DVec3::ZERO {
            forwards.push(v);
        }
    }
    forwards
        .iter()
        .enumerate()
        .map(|(n, &f)| View::new(at, f, DVec3::Z, [90.0, 1.0, 170.0, 60.0][n % 4], size, size).unwrap())
        .collect()
}

#[test]
fn no_view_of_any_volume_breaks_a_renderer() {
    let (one, thick, zero) = (DVec3::ONE, DVec3::new(0.3, 0.3, 10.0), DVec3::ZERO);
    let lumen = |p: DVec3| if p.x == 5.0 && p.y == 5.0 { -1000.0 } else { 40.0 };
    let noise = |p: DVec3| 2000.0 * hash::uniform(7, (p.x + 31.0 * (p.y + 31.0 * p.z)) as u64) - 1024.0;
    let volumes = [
        ("one voxel", volume([1; 3], one, zero, |_| 40.0)),
        ("two voxels", volume([2, 1, 1], one, zero, |p| -1000.0 + 1040.0 * p.x)),
        ("eight voxels", volume([2; 3], thick, zero, |p| -1000.0 * p.x)),
        ("flat", volume([24, 24, 1], thick, zero, |p| -1000.0 + 50.0 * p.x)),
        ("all air", volume([20; 3], one, zero, |_| -1000.0)),
        ("all tissue", volume([20; 3], one, zero, |_| 40.0)),
        ("one-voxel lumen", volume([11, 11, 30], one, zero, lumen)),
        (
            "thick slices",
            volume([24, 24, 8], thick, zero, cavity(DVec3::new(12.0, 12.0, 4.0), DVec3::new(10.0, 10.0, 3.0))),
        ),
        ("noise", volume([17, 19, 23], one, zero, noise)),
        ("extreme values", volume([9; 3], one, zero, |p| if p.x > 4.0 { 32767.0 } else { -32768.0 })),
        ("extreme spacing", volume([20; 3], DVec3::new(1e-6, 1.0, 1e6), zero, |p| -1000.0 + 100.0 * p.y)),
        (
            "3 m away",
            volume([20; 3], one, DVec3::new(3000.0, -3000.0, 3000.0), cavity(DVec3::splat(9.5), DVec3::splat(7.0))),
        ),
    ];
    for (volume, s) in volumes.iter().step_by(cases(1, 6)) {
        let grid = s.voxels().grid();
        let dims = DVec3::from_array(grid.dims().map(|n| n as f64));
        // A voxel's centre, a cell's, the wall, a corner of the volume, just outside it, and far from it.
        for at in [(dims * 0.5).floor(), (dims * 0.5).floor() + 0.5, dims * 0.15, zero, dims, dims * -2.0] {
            for quality in QUALITIES {
                let settings = Settings::new(quality);
                // The reference evaluates every sample, so it renders fewer views.
                let every = if quality == Quality::Reference { 7 } else { 2 };
                let mut pictures: Vec<Vec<Frame>> = Vec::new();
                for (name, lanes, make) in RENDERERS {
                    let mut r = make(s, settings);
                    let looks = views(grid.world(at), 7).into_iter().step_by(every);
                    let name = format!("{name}, {volume}, {at}, {quality:?}");
                    pictures.push(looks.map(|v| look(&name, lanes, &mut *r, s, &v, &settings)).collect());
                }
                for (first, others) in [(0, 1..6), (6, 7..10), (12, 13..14)] {
                    for same in others {
                        let name = RENDERERS[same].0;
                        assert!(pictures[same] == pictures[first], "{name}, {volume}, {at}, {quality:?}");
                    }
                }
            }
        }
    }
}

/// The wall is closed on all sides, so no pixel is black, as none is in the reference.
#[test]
fn a_closed_wall_has_no_crack() {
    let far = DVec3::new(3000.0, -2999.5, 3000.25);
    let walls = [
        (DVec3::new(0.3, 0.3, 10.0), DVec3::ZERO, DVec3::new(12.0, 12.0, 4.0)),
        (DVec3::ONE, DVec3::ZERO, DVec3::splat(12.0)),
        (DVec3::ONE, far, DVec3::splat(12.0)),
        (DVec3::new(0.7, 0.7, 1.0), DVec3::ZERO, DVec3::new(2.0, 13.0, 13.0)),
    ];
    for &(spacing, origin, radii) in cases(&walls[..], &walls[3..]) {
        let centre = (radii + 3.0).ceil();
        let dims = (centre * 2.0).to_array().map(|n| n as usize + 1);
        let s = volume(dims, spacing, origin, cavity(centre, radii));
        for from in [centre, centre + 0.5, centre + DVec3::new(0.0, 0.0, 0.85 * radii.z)] {
            for quality in QUALITIES {
                let settings = Settings::new(quality);
                for (name, lanes, make) in RENDERERS {
                    let mut r = make(&s, settings);
                    let every = if quality == Quality::Reference { 8 } else { 3 };
                    for view in views(s.voxels().grid().world(from), 25).into_iter().step_by(every) {
                        let frame = look(name, lanes, &mut *r, &s, &view, &settings);
                        let black = frame.pixels().iter().filter(|p| p[0] < 15).count();
                        assert_eq!(black, 0, "{name}, {spacing}, {from}, {quality:?}: {view:?}");
                    }
                }
            }
        }
    }
}

/// A slab of 1.05 voxels (2.75 for low detail), as a scanner sees it, at every angle to the grid and to the rays.
#[test]
fn slabs_thicker_than_a_voxel_stop_every_ray() {
    let n = 36;
    let centre = DVec3::splat(0.5 * f64::from(n - 1));
    for tilt in (0..12).step_by(cases(1, 7)) {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.13 * f64::from(tilt), 0.21 * f64::from(tilt), 0.0);
        let normal = turn * DVec3::X;
        let offset = 0.37 * f64::from(tilt % 3);
        // The share of a voxel's box that is in the slab, by 5³ points in it.
        let share = |p: DVec3, thickness: f64| {
            let within = |m: i32| {
                let o = DVec3::new(f64::from(m % 5), f64::from(m / 5 % 5), f64::from(m / 25)) * 0.2 - 0.4;
                ((p + o - centre).dot(normal) - 5.0 - offset).abs() <= 0.5 * thickness
            };
            (0..125).filter(|&m| within(m)).count() as f64 / 125.0
        };
        for quality in QUALITIES {
            let thickness = if quality == Quality::Low { 2.75 } else { 1.05 };
            let s = volume([n as usize; 3], DVec3::ONE, DVec3::ZERO, |p| -1000.0 + 1050.0 * share(p, thickness));
            let settings = Settings::new(quality);
            for (name, lanes, make) in RENDERERS {
                let mut r = make(&s, settings);
                for (u, fov) in [(0.0, 40.0), (0.4, 30.0), (1.0, 10.0)] {
                    let aim = (normal + turn * DVec3::Y * u).normalize();
                    let view = View::new(s.voxels().grid().world(centre), aim, turn * DVec3::Z, fov, 31, 31).unwrap();
                    let frame = look(name, lanes, &mut *r, &s, &view, &settings);
                    for (at, p) in frame.pixels().iter().enumerate() {
                        let ray = view.ray(at % 31, at / 31).unwrap().direction;
                        let hit = centre + ray * ((5.0 + offset) / ray.dot(normal));
                        let within = (hit - centre).abs().max_element() < 0.5 * f64::from(n) - 4.0;
                        assert!(!within || p[0] > 8, "{name}, {quality:?}, tilt {tilt}, pixel {at}: {p:?}");
                    }
                }
            }
        }
    }
}

/// Opacity 1, almost none and none at all, with steps from a hundredth of a voxel to a hundred voxels.
#[test]
fn any_opacity_and_any_step() {
    let centre = DVec3::splat(10.0);
    let base = volume([21; 3], DVec3::ONE, DVec3::ZERO, cavity(centre, DVec3::splat(7.0)));
    let at = base.voxels().grid().world(centre);
    let walls = [(-800.0, -500.0), (-1000.0, -999.0), (-999.9, 32767.0), (32766.0, 32767.0), (-32767.0, -32766.0)];
    for (lo, hi) in walls.into_iter().take(cases(5, 1)) {
        let s = PreparedVolume::new(base.shared_voxels(), TransferFunction::new(lo, hi).unwrap());
        for step_power in [-7, -4, -1, 0, 3, 7] {
            for sensitivity in [0.0, 1e-7, 1.0 / 512.0, 0.999] {
                let settings = Settings { step_power, sensitivity, ..Settings::default() };
                let pictures = RENDERERS.map(|(name, lanes, make)| {
                    let mut r = make(&s, settings);
                    let views = views(at, 5).into_iter().step_by(9);
                    views.map(|v| look(name, lanes, &mut *r, &s, &v, &settings)).collect::<Vec<_>>()
                });
                for same in 1..4 {
                    assert!(pictures[same] == pictures[0], "{}, {lo}, {hi}, {step_power}", RENDERERS[same].0);
                }
                let black = |f: &Frame| f.pixels().iter().all(|p| *p == [0; 3]);
                if (lo, hi) == (32766.0, 32767.0) {
                    assert!(pictures.iter().flatten().all(black), "nothing is that dense");
                }
                // A longer first step may leave the volume.
                if (lo, hi) == (-32767.0, -32766.0) && step_power <= 0 {
                    assert!(pictures.iter().flatten().all(|f| f.pixels().iter().all(|p| p[0] > 200)), "all is opaque");
                }
            }
        }
    }
}

/// An opacity of 1e-7 per step adds up over many steps as the formula requires: rounding loses nothing.
#[test]
fn a_faint_opacity_adds_up() {
    // 1e-4 of the ramp of h, in steps of h/1024: 1e-7 per step.
    let s = volume([65, 9, 9], DVec3::ONE, DVec3::ZERO, |_| -500.0);
    let s = PreparedVolume::new(s.shared_voxels(), TransferFunction::new(-503.2767, 32263.0).unwrap());
    let from = s.voxels().grid().world(DVec3::new(0.0, 4.0, 4.0));
    let view = View::new(from, DVec3::X, DVec3::Z, 1.0, 1, 1).unwrap();
    let bright = |step_power: i32| {
        let settings = Settings { step_power, sensitivity: 0.0, ..Settings::default() };
        let mut frame = Frame::default();
        renderer(&s, settings, Preset::default(), Reuse::Allowed).render(&view, &mut frame);
        frame.pixels()[0]
    };
    // 64 voxels of 1e-4 each are 0.64 % of the light: about one grey level of 255, for any step.
    let (fine, coarse) = (bright(-10), bright(-1));
    assert!(fine[0] > 0 && coarse[0] > 0 && fine[0].abs_diff(coarse[0]) <= 1, "{fine:?} {coarse:?}");
}
