use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};
use proptest::prelude::*;

use super::*;
use crate::math::hash;
use crate::render::begin::FromScratch;
use crate::render::caster::{ImageRequest, render};
use crate::render::classify::{ByDensity, ByValue};
use crate::render::sampler::Sampler;
use crate::render::skip::Everything;
use crate::render::{Classification, Frame, Settings, View, psnr};
use crate::volume::Volume;

fn volume(dims: [usize; 3], wall: TransferFunction, f: impl Fn(usize) -> i16) -> PreparedVolume {
    let grid = Grid::new(dims, DVec3::new(0.7, 0.6, 1.1), DVec3::ZERO, DMat3::IDENTITY).unwrap();
    PreparedVolume::new(Arc::new(Volume::new(grid.clone(), (0..grid.len()).map(f).collect())), wall)
}

fn specks(dims: [usize; 3], wall: TransferFunction, seed: u64, share: f64) -> PreparedVolume {
    volume(dims, wall, |n| {
        let u = |s: u64| hash::uniform(s, n as u64);
        if u(seed) < share { -1000 + (1000.0 * u(!seed)) as i16 } else { -1000 }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(50))]
    #[test]
    fn flags_are_what_they_say(
        dims in prop::array::uniform3(1usize..40), seed: u64, share in 0.0..0.02f64, reach in 1usize..3, tissue: bool,
        wall in prop_oneof![Just((-800.0, -500.0)), Just((-2000.0, -1100.0)), Just((-1100.0, -500.0))],
    ) {
        let wall = TransferFunction::new(wall.0, wall.1).unwrap();
        let s = volume(dims, wall, |n| match (hash::uniform(seed, n as u64) < share, tissue) {
            (true, _) => -650,
            (false, true) => 40,
            (false, false) => -1024,
        });
        let bytes = ByteVolume::new(&s, reach);
        let r = reach as i32;
        for k in 0..dims[2] as i32 { for j in 0..dims[1] as i32 { for i in 0..dims[0] as i32 {
            let around = || (-r..=r).flat_map(|z| (-r..=r).flat_map(move |y| (-r..=r).map(move |x| (x, y, z))));
            let mut classes = around().map(|(x, y, z)| class(bytes.get([i + 1 + x, j + 1 + y, k + 1 + z]) & CODE));
            let want = classes.try_fold(3u8, |a, c| (a & c != 0).then_some(a & c)).is_some();
            prop_assert_eq!(bytes.get([i + 1, j + 1, k + 1]) & FLAG != 0, want, "{} {} {}", i, j, k);
        }}}
    }

    #[test]
    fn leaping_by_the_flag_changes_no_bit(
        dims in prop::array::uniform3(1usize..40), seed: u64, share in prop_oneof![Just(0.0), 0.0..0.02f64],
        from in prop::array::uniform3(-0.3..1.3f64), to in prop::array::uniform3(0.0..1.0f64),
        wall in prop_oneof![Just((-800.0, -500.0)), Just((-1100.0, -500.0)), Just((-999.5, 40.0))],
    ) {
        let s = specks(dims, TransferFunction::new(wall.0, wall.1).unwrap(), seed, share);
        let grid = s.voxels().grid();
        let at = |q: [f64; 3]| grid.world(DVec3::from_array(std::array::from_fn(|a| q[a] * dims[a] as f64)));
        let view = View::new(at(from), at(to) - at(from), DVec3::Z, 90.0, 24, 16).unwrap();
        let settings = Settings::default();
        let request = ImageRequest { volume: &s, view: &view, settings: &settings };
        let mut kept = vec![(); 24 * 16];
        let mut frames = vec![Frame::new(24, 16); 4];
        let [a, b, c, d] = &mut frames[..] else { unreachable!() };
        let one = ByteVolume::new(&s, 1);
        let two = ByteVolume::new(&s, 2);
        request.image(&ByteTrilinear::new(&s, &one), &Everything, &ByValue, &FromScratch, &mut kept, a);
        request.image(&ByteTrilinear::new(&s, &one), &ByteLeap::new(&one), &ByValue, &FromScratch, &mut kept, b);
        request.image(&ByteNearest::new(&s, &two), &Everything, &ByDensity, &FromScratch, &mut kept, c);
        request.image(&ByteNearest::new(&s, &two), &ByteLeap::new(&two), &ByDensity, &FromScratch, &mut kept, d);
        prop_assert!(a == b && c == d);
    }
}

#[test]
fn values_are_off_by_half_a_code() {
    let wall = TransferFunction::default();
    let s = volume([30, 20, 10], wall, |n| -1028 + (906.0 * hash::uniform(4, n as u64)) as i16);
    let bytes = ByteVolume::new(&s, 1);
    let half = 0.5 * unit(wall);
    assert!((half - 150.0 / 42.0).abs() < 1e-4 && bytes.bytes() * 2 == s.voxels().bytes());
    let (exact, fixed) = (crate::render::sampler::Trilinear::new(&s), ByteTrilinear::new(&s, &bytes));
    for n in 0..4000 {
        let u = |k: u64| hash::uniform(n, k) as f32;
        let q = Vec3::new(1.0 + 28.9 * u(0), 1.0 + 18.9 * u(1), 1.0 + 8.9 * u(2));
        let floats = fixed.value_in_floats(q);
        assert!((floats - exact.value(q)).abs() <= half + 0.01, "{q}");
        // A position is rounded to 1/256 of a cell along each axis, over which the value changes by up to 906 HU.
        assert!((fixed.value(q) - floats).abs() <= 3.0 * 907.0 / 512.0 + 0.01, "{q}");
    }
    // No empty value becomes visible, and no value beyond the codes leaves its class.
    for hu in i16::MIN..=i16::MAX {
        let c = code(hu, wall, 1.0 / unit(wall));
        assert!(f32::from(hu) > wall.lo() || c <= EMPTY);
        assert!(f32::from(hu) < wall.hi() || c >= OPAQUE);
    }
}

#[test]
fn seven_bits_draw_the_same_wall() {
    let n = 60;
    let s = volume([n; 3], TransferFunction::default(), |i| {
        let p = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) - 30.0;
        let r = p.length() - 22.0 - 2.0 * (0.5 * p.x).sin();
        (-1000.0 + 1050.0 * (r / 2.0 + 0.4).clamp(0.0, 1.0)) as i16
    });
    let view = View::new(s.voxels().grid().world(DVec3::splat(30.0)), DVec3::X, DVec3::Z, 90.0, 90, 90).unwrap();
    for classification in [Classification::Value, Classification::Filtered] {
        let settings = Settings { classification, ..Settings::default() };
        let mut frames = [Frame::default(), Frame::default()];
        render(&s, &view, &settings, &mut frames[0]);
        let (request, mut kept) = (ImageRequest { volume: &s, view: &view, settings: &settings }, vec![(); 8100]);
        let bytes = ByteVolume::new(&s, 2);
        let (high, leap) = (ByteTrilinear::new(&s, &bytes), ByteLeap::new(&bytes));
        match classification {
            Classification::Value => request.image(&high, &leap, &ByValue, &FromScratch, &mut kept, &mut frames[1]),
            Classification::Filtered => {
                request.image(&high, &leap, &ByDensity, &FromScratch, &mut kept, &mut frames[1])
            }
        };
        let error = psnr(&frames[0], &frames[1]);
        println!("{classification:?}: 7 + 1 bits against 16: {error:.1} dB");
        assert!(error > 33.0, "{error}");
    }
}
