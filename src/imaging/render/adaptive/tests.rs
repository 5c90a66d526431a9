use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3};

use super::*;
use crate::checks::cases;
use crate::phantom::PhantomSettings;
use crate::render::{Direct, Preset, Reuse, presets, psnr, renderer};
use crate::shared::shared;
use crate::space::TransferFunction;
use crate::volume::{Grid, Volume};

const SIDE: usize = 96;

/// A small colon, and the points of its centerline.
fn colon() -> (PreparedVolume, Vec<DVec3>) {
    let (phantom, volume) = shared(&PhantomSettings::embedded(1));
    let line = phantom.truth().centerline;
    (PreparedVolume::new(Arc::new(volume), TransferFunction::default()), line)
}

fn adaptive(volume: &PreparedVolume, quality: Quality) -> Box<dyn Renderer> {
    renderer(volume, Settings { adaptive: true, ..Settings::new(quality) }, Preset::default(), Reuse::Allowed)
}

fn view(at: DVec3, forward: DVec3) -> View {
    View::new(at, forward, DVec3::Z, 90.0, SIDE, SIDE).unwrap()
}

/// A flight along the centerline with an occasional sudden turn.
fn flight(line: &[DVec3], pictures: usize) -> Vec<View> {
    let mut turned = 0.0f64;
    (0..pictures)
        .map(|n| {
            let at = 40 + n * (line.len() - 100) / pictures;
            if n % 23 == 11 {
                turned += 1.9;
            }
            view(line[at], DQuat::from_rotation_z(turned) * (line[at + 8] - line[at]))
        })
        .collect()
}

#[test]
fn a_flight_with_sudden_turns_keeps_its_budget() {
    let (volume, line) = colon();
    for &budget in cases(&[60_000, 20_000, 150_000][..], &[60_000]) {
        let mut r = adaptive(&volume, Quality::High);
        r.set_budget(Budget::strict(budget));
        let mut frame = Frame::new(SIDE, SIDE);
        let views = flight(&line, 400);
        let costs: Vec<u64> = views.iter().map(|v| cost(&r.render(v, &mut frame))).collect();
        let over = costs[1..].iter().filter(|c| **c > budget).count();
        let mean = costs.iter().sum::<u64>() as f64 / costs.len() as f64;
        println!("budget {budget}: {over} of {} above it, {:.2} of it used", costs.len() - 1, mean / budget as f64);
        assert!(over * 100 <= costs.len(), "{over} above {budget}");
        assert!(frame.pixels().iter().any(|p| p[0] > 40), "there is a picture");
    }
}

#[test]
fn the_same_on_one_thread_and_on_two() {
    let (volume, line) = colon();
    let make = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut r = adaptive(&volume, Quality::High);
            r.set_budget(Budget::strict(60_000));
            let mut frame = Frame::new(SIDE, SIDE);
            let mut all = Vec::new();
            for v in flight(&line, 30) {
                // The camera rests for a moment at each position.
                for _ in 0..3 {
                    all.push((r.render(&v, &mut frame), frame.pixels().to_vec(), r.detail()));
                }
            }
            all
        })
    };
    let (one, two, again) = (make(1), make(2), make(2));
    assert!(one == two && two == again);
}

#[test]
#[ignore = "slow: refines three pictures to the end"]
fn at_rest_it_becomes_the_reference_and_stops() {
    let (volume, line) = colon();
    let v = view(line[60], line[70] - line[60]);
    let settings = Settings { samples_per_pixel: SAMPLES, ..Settings::new(Quality::Reference) };
    let mut reference = Frame::default();
    Direct::new(&volume, settings).render(&v, &mut reference);
    for (preset, budget) in
        [(Preset::default(), 40_000), (Preset::default(), u64::MAX), (presets::lean::PRESET, 400_000)]
    {
        let settings = Settings { adaptive: true, ..Settings::default() };
        let mut r = renderer(&volume, settings, preset, Reuse::Allowed);
        r.set_budget(Budget::strict(budget));
        let mut frame = Frame::new(SIDE, SIDE);
        let mut pictures = 0;
        let mut quality = Vec::new();
        while !r.detail().is_some_and(|d| d.best) {
            let work = r.render(&v, &mut frame);
            assert!(work.rays > 0, "it stops before it says so");
            pictures += 1;
            assert!(pictures < 2000, "{preset:?}: no end");
            quality.push(psnr(&frame, &reference));
        }
        let (first, last) = (quality[0], *quality.last().unwrap());
        println!("{preset:?}, budget {budget}: {pictures} pictures, {first:.1} to {last:.1} dB");
        assert!(last >= 45.0, "{last} dB");
        let done = frame.clone();
        // A camera that trembles by a hundredth of a millimetre is at rest.
        for tremble in [0.0, 0.01] {
            let again = view(line[60] + DVec3::X * tremble, line[70] - line[60]);
            assert_eq!((r.render(&again, &mut frame), &frame), (Work::default(), &done));
        }
    }
}

#[test]
fn what_moves_on_begins_anew() {
    let (volume, line) = colon();
    let mut r = adaptive(&volume, Quality::High);
    r.set_budget(Budget::strict(100_000));
    let mut frame = Frame::with_depth(SIDE, SIDE);
    let first = view(line[60], line[70] - line[60]);
    let small = View::new(line[60], line[70] - line[60], DVec3::Z, 90.0, 60, 40).unwrap();
    let elsewhere = view(line[150], line[160] - line[150]);
    for next in [small, elsewhere, first.clone()] {
        for _ in 0..4 {
            r.render(&first, &mut frame);
        }
        assert!(r.detail().unwrap().samples < SAMPLES);
        r.render(&next, &mut frame);
        assert_eq!((frame.width(), frame.height()), (next.width(), next.height()));
        r.set_budget(Budget::strict(u64::MAX));
        let (mut alone, mut fresh) = (Frame::with_depth(1, 1), adaptive(&volume, Quality::High));
        fresh.set_budget(Budget::strict(u64::MAX));
        for _ in 0..2 {
            r.render(&next, &mut frame);
            fresh.render(&next, &mut alone);
        }
        assert!(r.detail().unwrap().best);
        assert!(psnr(&frame, &alone) > 50.0, "nothing of the old picture is left");
        assert_eq!(frame.depth(), alone.depth());
        r.set_budget(Budget::strict(100_000));
    }
}

#[test]
#[ignore = "slow: refines pictures of three sizes to the end"]
fn low_detail_at_rest_is_that_of_a_picture_made_at_once() {
    let (volume, line) = colon();
    for (width, height) in [(128, 40), (40, 128), (SIDE, SIDE)] {
        let v = View::new(line[60], line[70] - line[60], DVec3::Z, 90.0, width, height).unwrap();
        let mut at_once = Frame::default();
        renderer(&volume, Settings::new(Quality::Low), Preset::default(), Reuse::Allowed).render(&v, &mut at_once);
        let (mut r, mut frame) = (adaptive(&volume, Quality::Low), Frame::default());
        r.set_budget(Budget::strict(1));
        r.render(&v, &mut frame);
        for _ in 0..20 {
            r.render(&v, &mut frame);
        }
        assert!(r.detail().unwrap().best);
        assert_eq!(frame.pixels(), at_once.pixels(), "{width}x{height}");
    }
}

#[test]
fn low_detail_is_cheaper_and_rests_when_it_is_sharp() {
    let (volume, line) = colon();
    let v = view(line[60], line[70] - line[60]);
    let works = [Quality::High, Quality::Low].map(|quality| {
        let mut r = renderer(&volume, Settings::new(quality), Preset::default(), Reuse::Allowed);
        r.render(&v, &mut Frame::default())
    });
    assert!(cost(&works[1]) * 2 < cost(&works[0]), "{works:?}");
    let (mut r, mut frame) = (adaptive(&volume, Quality::Low), Frame::default());
    r.set_budget(Budget::strict(1));
    r.render(&v, &mut frame);
    r.set_budget(Budget::strict(u64::MAX));
    assert_ne!(r.render(&v, &mut frame), Work::default());
    assert!(r.detail().unwrap().best);
    assert_eq!(r.render(&v, &mut frame), Work::default());
}

/// The pictures kept are the last one of a moving camera as it was traced, what stretching needs, and those of a camera at rest.
#[test]
fn the_memory_includes_every_picture() {
    let grid = Grid::new([16; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let data = (0..grid.len()).map(|n| if n % 16 < 12 { -1000 } else { 0 }).collect();
    let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
    let mut r = Adaptive::new(&volume, Box::new(Direct::new(&volume, Settings::default())), None);
    r.set_budget(Budget::strict(1));
    let counted = |r: &Adaptive| {
        let pictures = r.parts().into_iter().filter(|p| p.0 == MemoryPart::RefinementPictures);
        pictures.map(|p| p.1).sum::<usize>()
    };
    let v = View::new(DVec3::splat(6.0), DVec3::X, DVec3::Z, 90.0, 64, 48).unwrap();
    let mut frame = Frame::default();
    r.render(&v, &mut frame);
    // Traced at an eighth of the side; three bytes a pixel.
    let moving = 3 * (8 * 6) + r.enlarger.bytes();
    assert_eq!((counted(&r), r.still.bytes()), (moving, 0));
    r.render(&v, &mut frame);
    assert!(r.still.bytes() >= 3 * 64 * 48 && r.enlarger.bytes() > 0);
    assert_eq!(counted(&r), moving + r.still.bytes());
}
