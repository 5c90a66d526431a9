use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::*;
use crate::math::hash;
use crate::render::begin::FromScratch;
use crate::render::caster::{ImageRequest, render};
use crate::render::classify::{ByDensity, ByValue};
use crate::render::sampler::Trilinear;
use crate::render::skip::Leap;
use crate::render::{Classification, Frame, Settings, View, psnr};
use crate::space::TransferFunction;
use crate::volume::{Grid, Volume};

fn cavity(n: usize, noise: f64) -> PreparedVolume {
    let grid = Grid::new([n; 3], DVec3::new(0.7, 0.7, 1.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let middle = DVec3::splat(0.5 * n as f64);
    let value = |i: usize| {
        let p = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) - middle;
        let out = p.length() - 0.37 * n as f64 - 2.0 * (0.5 * p.x).sin();
        (-1000.0 + 1050.0 * (out / 2.0 + 0.4).clamp(0.0, 1.0) + noise * hash::normal(1, i as u64)) as i16
    };
    PreparedVolume::new(
        Arc::new(Volume::new(grid.clone(), (0..grid.len()).map(value).collect())),
        TransferFunction::default(),
    )
}

#[test]
fn stored_and_cached_fits_are_the_regressions() {
    let s = cavity(24, 20.0);
    let plain = Trilinear::new(&s);
    let all = GradientVolume::new(&plain, &s, Stored::Everywhere);
    let (all_bytes, all) = (all.bytes(), Fits::Stored(all));
    let near = Fits::new(GradientSource::Stored, &plain, &s);
    let (cache, eight) = (Fits::new(GradientSource::Cached, &plain, &s), Fits::new(GradientSource::Eight, &plain, &s));
    let [a, b, c, d] = [&all, &near, &cache, &eight].map(|fits| FitSampler::new(Trilinear::new(&s), fits));
    let step = Quantum::new(&s, plain.densities()).gradient;
    for n in 0..4000 {
        // Includes the border of the grown volume.
        let u = |k: u64| 25.0 * hash::uniform(n, k) as f32;
        let q = Vec3::new(u(0), u(1), u(2));
        let want = plain.fit(q);
        for got in [a.fit(q), b.fit(q)] {
            assert!((got.gradient - want.gradient).abs().max_element() < 0.6 * step + 1e-2, "{q}");
            assert!((got.density - want.density).abs() < 0.1, "{q}");
        }
        // The second round reads the cache.
        for _ in 0..2 {
            let got = c.fit(q);
            // The bound is 1/2000 of the steepest of the eight, which may cancel each other.
            assert!((got.gradient - want.gradient).abs().max_element() < 0.6, "{q} {want:?} {got:?}");
            assert!((got.density - want.density).abs() < 0.6, "{q}");
        }
        // Regression and interpolation commute.
        let got = d.fit(q);
        assert!((got.gradient - want.gradient).abs().max_element() < 1e-2 && (got.density - want.density).abs() < 1e-2);
    }
    assert_eq!(all_bytes, 7 * 7 * 7 * (VOXELS * 8 + 4));
    let bytes = |fits: &Fits| fits.part().unwrap().1;
    assert!(bytes(&near) < all_bytes && bytes(&cache) == 4 << 20 && eight.part().is_none());
}

#[test]
fn pictures_are_the_same_to_the_eye_and_for_any_number_of_threads() {
    let s = cavity(48, 0.0);
    let view = View::new(s.voxels().grid().world(DVec3::splat(24.0)), DVec3::X, DVec3::Z, 90.0, 80, 80).unwrap();
    let settings = Settings::default();
    let (request, mut kept) = (ImageRequest { volume: &s, view: &view, settings: &settings }, vec![(); 6400]);
    let mut plain = Frame::default();
    render(&s, &view, &settings, &mut plain);
    let leap = Leap::<true>::new(&s);
    let fits = |source| Fits::new(source, &Trilinear::new(&s), &s);
    let stored = fits(GradientSource::Stored);
    let mut got = Frame::default();
    fn with<'a>(s: &'a PreparedVolume, fits: &'a Fits) -> FitSampler<'a, Trilinear<'a>> {
        FitSampler::new(Trilinear::new(s), fits)
    }
    request.image(&with(&s, &stored), &leap, &ByValue, &FromScratch, &mut kept, &mut got);
    assert!(psnr(&plain, &got) > 55.0, "{}", psnr(&plain, &got));
    let filtered = Settings { classification: Classification::Filtered, ..settings };
    let by_density = ImageRequest { settings: &filtered, ..request };
    let mut plain_density = Frame::default();
    render(&s, &view, &filtered, &mut plain_density);
    let mut first: Option<[Frame; 2]> = None;
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let cache = fits(GradientSource::Cached);
        for _ in 0..2 {
            let cached = with(&s, &cache);
            pool.install(|| request.image(&cached, &leap, &ByValue, &FromScratch, &mut kept, &mut got));
            let value = got.clone();
            let bricks = Leap::<false>::new(&s);
            pool.install(|| by_density.image(&cached, &bricks, &ByDensity, &FromScratch, &mut kept, &mut got));
            let db = [psnr(&plain, &value), psnr(&plain_density, &got)];
            assert!(db.iter().all(|db| *db > 50.0), "{db:?}");
            let both = [value, got.clone()];
            assert!(first.get_or_insert_with(|| both.clone()) == &both);
        }
    }
    // Densities are stored as well.
    by_density.image(&with(&s, &stored), &Leap::<false>::new(&s), &ByDensity, &FromScratch, &mut kept, &mut got);
    assert!(psnr(&plain_density, &got) > 50.0, "{}", psnr(&plain_density, &got));
}
