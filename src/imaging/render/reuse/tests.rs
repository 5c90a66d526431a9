use std::sync::Arc;

use crate::render::frame::ImageSize;
use glam::{DMat3, DQuat};
use proptest::prelude::*;

use super::*;
use crate::checks::cases;
use crate::math::hash;
use crate::render::Quality;
use crate::render::caster::render;
use crate::space::TransferFunction;
use crate::volume::{Grid, Volume};

/// Every method of reuse, for the same volume.
fn ways(volume: &PreparedVolume, settings: Settings) -> Vec<Box<dyn Renderer>> {
    vec![
        Box::new(Reusing::<_, f32>::new(WordStorage::new(volume), settings, Refresh::Staggered(16))),
        Box::new(Reusing::<_, f32>::new(WordStorage::new(volume), settings, Refresh::Staggered(1000))),
        Box::new(Reusing::<_, Trace>::new(WordStorage::new(volume), settings, Refresh::KeyFrames(10))),
    ]
}

fn volume(dims: [usize; 3], spacing: DVec3, wall: (f32, f32), f: impl Fn(DVec3, u64) -> f64) -> PreparedVolume {
    let grid = Grid::new(dims, spacing, DVec3::new(-3.0, 5.0, 7.0), DMat3::from_rotation_x(0.4)).unwrap();
    let place =
        |n: usize| DVec3::new((n % dims[0]) as f64, (n / dims[0] % dims[1]) as f64, (n / dims[0] / dims[1]) as f64);
    let data = (0..grid.len()).map(|n| f(place(n), n as u64).round() as i16).collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::new(wall.0, wall.1).unwrap())
}

/// A lumen with a fold across it and a polyp behind the fold, in tissue; its air has specks of arbitrary values.
fn lumen(dims: [usize; 3], spacing: DVec3, wall: (f32, f32), seed: u64, share: f64) -> PreparedVolume {
    let half = DVec3::from_array(dims.map(|n| 0.5 * n as f64));
    let r = 0.4 * dims[0].min(dims[1]) as f64;
    let (fold, polyp) = (half.z * 0.8, half + DVec3::new(0.0, 0.7 * r, 0.1 * half.z));
    volume(dims, spacing, wall, |p, n| {
        let across = (p - half).truncate().length();
        let tube = if (p.z - fold).abs() < 1.5 { 0.6 * r } else { r };
        let inside = (across - tube).max(0.25 * r - (p - polyp).length());
        if hash::uniform(seed, n) < share {
            return -1000.0 + 1000.0 * hash::uniform(!seed, n);
        }
        -1000.0 + 1050.0 * (inside / 2.0 + 0.4).clamp(0.0, 1.0)
    })
}

#[derive(Clone, Copy, Debug)]
struct Shoot {
    at: [f64; 3],
    turn: [f64; 3],
    fov: f64,
    size: ImageSize,
}

fn view(volume: &PreparedVolume, s: Shoot) -> View {
    let grid = volume.voxels().grid();
    let at = DVec3::from_array(std::array::from_fn(|a| s.at[a] * grid.dims()[a] as f64));
    let q = DQuat::from_euler(glam::EulerRot::ZYX, s.turn[0], s.turn[1], s.turn[2]);
    View::new(grid.world(at), q * DVec3::Z, q * DVec3::Y, s.fov, s.size.width, s.size.height).unwrap()
}

/// Renders the views in order with every method and compares each with an independently rendered picture. Returns the
/// number of rays that skipped something.
fn check(volume: &PreparedVolume, settings: Settings, views: &[View]) -> Vec<u64> {
    ways(volume, settings)
        .iter_mut()
        .enumerate()
        .map(|(way, renderer)| {
            let mut reused = 0;
            let (mut got, mut want) = (Frame::with_depth(1, 1), Frame::with_depth(1, 1));
            for (n, view) in views.iter().enumerate() {
                let work = renderer.render(view, &mut got);
                let alone = render(volume, view, &settings, &mut want);
                assert!(got == want, "way {way}, picture {n}: {view:?}");
                assert_eq!(work.rays, alone.rays);
                reused += work.reused;
            }
            reused
        })
        .collect()
}

fn shoot() -> impl Strategy<Value = Shoot> {
    let fov = prop_oneof![4 => Just(90.0), 1 => Just(1.0), 1 => Just(170.0), 1 => 5.0..150.0f64];
    let size = prop_oneof![3 => Just((40, 24)), 1 => Just((17, 33)), 1 => Just((1, 1)), 1 => Just((64, 64))];
    (prop::array::uniform3(-0.2..1.2f64), prop::array::uniform3(-3.2..3.2f64), fov, size)
        .prop_map(|(at, turn, fov, size)| Shoot { at, turn, fov, size: ImageSize::new(size.0, size.1) })
}

/// The change from one view to the next: mostly a small step of any kind, or a cut.
fn change() -> impl Strategy<Value = (u8, [f64; 3], [f64; 3], Shoot)> {
    (0u8..12, prop::array::uniform3(-1.0..1.0f64), prop::array::uniform3(-1.0..1.0f64), shoot())
}

fn follow(mut s: Shoot, (kind, by, turn, cut): (u8, [f64; 3], [f64; 3], Shoot)) -> Shoot {
    let moved = |s: &mut Shoot, scale: f64| (0..3).for_each(|a| s.at[a] += scale * by[a]);
    let turned = |s: &mut Shoot, scale: f64| (0..3).for_each(|a| s.turn[a] += scale * turn[a]);
    match kind {
        0..=2 => moved(&mut s, 0.01),
        3 | 4 => turned(&mut s, 0.05),
        5..=7 => {
            moved(&mut s, 0.02);
            turned(&mut s, 0.05);
        }
        8 => s.turn[1] += std::f64::consts::PI,
        9 => s.size = cut.size,
        10 => s.fov = cut.fov,
        _ => return cut,
    }
    s
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(60, 3)))]
    #[test]
    fn every_picture_is_the_same_bytes_as_on_its_own(
        dims in prop::array::uniform3(2usize..60), seed: u64, quality in 0..4usize, samples in 1u32..3, first in shoot(),
        centred: bool, changes in prop::collection::vec(change(), 1..14),
        share in prop_oneof![Just(0.0), 0.0..0.002f64, 0.0..0.1f64],
        spacing in prop_oneof![Just(DVec3::new(0.7, 0.6, 1.1)), Just(DVec3::new(0.3, 0.3, 10.0))],
        wall in prop_oneof![Just((-800.0, -500.0)), Just((-1100.0, -500.0)), Just((-999.5, 40.0))],
    ) {
        let s = lumen(dims, spacing, wall, seed, share);
        let mut settings = Settings::new([Quality::High, Quality::Low][quality % 2]);
        settings.classification = [Classification::Value, Classification::Filtered][quality / 2];
        settings.samples_per_pixel = samples;
        let mut now = if centred { Shoot { at: [0.5, 0.5, 0.3], ..first } } else { first };
        let mut views = vec![view(&s, now)];
        for c in changes {
            now = follow(now, c);
            views.push(view(&s, now));
        }
        check(&s, settings, &views);
    }
}

/// A flight of each kind of motion: the bytes are the same, and most rays skip part of their path.
#[test]
fn flights_of_every_kind_reuse_and_are_right() {
    let s = lumen([90, 90, 160], DVec3::new(0.7, 0.7, 1.0), (-800.0, -500.0), 3, 0.0);
    let first = Shoot { at: [0.5, 0.5, 0.15], turn: [0.4, 0.1, -0.3], fov: 90.0, size: ImageSize::new(120, 100) };
    // In voxels and radians per picture.
    let kinds: [(&str, [f64; 3], [f64; 3], f64); 8] = [
        ("still", [0.0; 3], [0.0; 3], 0.9),
        ("forward", [0.0, 0.0, 1.0], [0.0; 3], 0.8),
        ("backward", [0.0, 0.0, -0.5], [0.0; 3], 0.4),
        ("sideways", [0.7, 0.0, 0.0], [0.0; 3], 0.6),
        ("roll", [0.0; 3], [0.02, 0.0, 0.0], 0.5),
        ("pitch and yaw", [0.0; 3], [0.0, 0.015, 0.01], 0.7),
        ("all at once", [0.3, -0.2, 0.8], [0.01, 0.015, -0.01], 0.5),
        ("past the fold", [0.0, 0.0, 3.0], [0.0; 3], 0.5),
    ];
    for &(name, by, turn, least) in cases(&kinds[..], &kinds[1..2]) {
        let views: Vec<View> = (0..14)
            .map(|n| {
                let n = f64::from(n);
                let mut s1 = first;
                (0..3).for_each(|a| {
                    s1.at[a] += n * by[a] / s.voxels().grid().dims()[a] as f64;
                    s1.turn[a] += n * turn[a];
                });
                view(&s, s1)
            })
            .collect();
        let reused = check(&s, Settings::default(), &views);
        let share = |way: usize| reused[way] as f64 / (14.0 * 120.0 * 100.0);
        println!(
            "{name}: rays that reuse {:.2} staggered, {:.2} not refreshed, {:.2} by the paper's rule",
            share(0),
            share(1),
            share(2)
        );
        assert!(share(1) > least && share(1) >= share(0), "{name}: {:.2}", share(1));
    }
}

/// The camera in tissue, at the wall, outside, far away; a new volume.
#[test]
fn unusual_places_are_right() {
    let s = lumen([60, 60, 80], DVec3::ONE, (-800.0, -500.0), 1, 0.001);
    let at = |at: [f64; 3]| Shoot { at, turn: [0.1, 0.2, 0.3], fov: 90.0, size: ImageSize::new(40, 40) };
    let mut views = Vec::new();
    for place in
        [[0.02, 0.02, 0.5], [0.5, 0.12, 0.5], [0.5, 0.5, -0.3], [-20.0, 0.5, 0.5], [0.5, 0.5, 0.0], [0.5, 0.5, 0.999]]
    {
        for n in 0..3 {
            let mut shoot = at(place);
            shoot.at[2] += 0.005 * f64::from(n);
            views.push(view(&s, shoot));
        }
    }
    check(&s, Settings::default(), &views);
}

/// The more emptiness a picture proves, the fewer samples the next one takes.
#[test]
fn reuse_looks_at_no_more_samples() {
    let s = lumen([90, 90, 160], DVec3::new(0.7, 0.7, 1.0), (-800.0, -500.0), 3, 0.0);
    let settings = Settings::default();
    let mut renderer = Reusing::<_, f32>::new(WordStorage::new(&s), settings, Refresh::Staggered(1000));
    let mut frame = Frame::default();
    for n in 0..5 {
        let v = view(
            &s,
            Shoot {
                at: [0.5, 0.5, 0.2 + 0.005 * f64::from(n)],
                turn: [0.0; 3],
                fov: 90.0,
                size: ImageSize::new(64, 64),
            },
        );
        let (work, alone) = (renderer.render(&v, &mut frame), render(&s, &v, &settings, &mut Frame::default()));
        // Flags are met at other positions if a ray starts elsewhere.
        assert!(work.samples * 50 <= alone.samples * 51, "{work:?} {alone:?}");
    }
    assert!(renderer.bytes() > s.bytes() + 64 * 64 * 8);
}

/// The paper's own rule is sometimes wrong, and is corrected.
#[test]
fn the_papers_rule_is_counted_when_it_misleads() {
    let s = lumen([90, 90, 160], DVec3::new(0.7, 0.7, 1.0), (-800.0, -500.0), 3, 0.0);
    let mut renderer = Reusing::<_, Trace>::new(WordStorage::new(&s), Settings::default(), Refresh::KeyFrames(10));
    let mut frame = Frame::default();
    let mut total = Work::default();
    for n in 0..20 {
        // Sideways past a fold: its edge covers what was seen behind it.
        let at = [0.4 + 0.01 * f64::from(n), 0.5, 0.2];
        total = total
            + renderer.render(
                &view(&s, Shoot { at, turn: [0.4, 0.0, 0.0], fov: 90.0, size: ImageSize::new(96, 96) }),
                &mut frame,
            );
    }
    println!("{} of {} rays misled", total.misled, total.rays);
    assert!(total.misled > 0 && total.misled < total.rays / 2);
}

/// No ray is misled by a method that guesses nothing, whatever the rays hit.
#[test]
fn what_guesses_nothing_misleads_no_ray() {
    let s = lumen([40, 40, 60], DVec3::ONE, (-800.0, -500.0), 3, 0.0);
    let mut renderer = Reusing::<_, f32>::new(WordStorage::new(&s), Settings::default(), Refresh::Staggered(1000));
    let mut frame = Frame::default();
    let mut total = Work::default();
    for n in 0..4 {
        let at = [0.5, 0.5, 0.3 + 0.005 * f64::from(n)];
        let shoot = Shoot { at, turn: [0.4, 0.1, 0.0], fov: 90.0, size: ImageSize::new(48, 48) };
        total = total + renderer.render(&view(&s, shoot), &mut frame);
    }
    assert!(total.reused > 0 && frame.pixels().iter().any(|p| p[0] > 40), "{total:?}");
    assert_eq!(total.misled, 0);
}
