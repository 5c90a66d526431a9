//! Times of the ray caster's parts: sampling, leaping, gradients, whole frames. `cargo bench -p colvis-bench --bench render`.
//!
//! It uses the small analytic phantom and one view from the middle of its centerline, 512×512, on the machine's own
//! number of threads. A part's name is the second half of the line, so `cargo bench -p colvis-bench --bench render -- leaping` compares
//! leaping alone.
#![expect(missing_docs, reason = "criterion_group makes a public function without a comment")]

use std::hint::black_box;
use std::sync::Arc;

use colvis::math::hash;
use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::internals::{
    BrickLeap, BrickWalls, ByDensity, ByValue, ByteNearest, ByteTrilinear, ByteVolume, Everything, FitSampler, Fits,
    FromScratch, ImageRequest, Leap, Nearest, Refresh, Reusing, Sampler, Trace, Trilinear, VoxelLeap, VoxelWalls,
    WordStorage,
};
use colvis::render::{
    Frame, GradientSource, PreparedVolume, Preset, Quality, Renderer, Reuse, Settings, TransferFunction, View, presets,
    renderer,
};
use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DVec3, Vec3};

const SIDE: usize = 512;

/// The phantom, with the views of a flight along its centerline, 1 mm apart.
fn scene() -> (PreparedVolume, Vec<View>) {
    let phantom = Phantom::new(&PhantomSettings { size: Size::Small, seed: 1, ..Default::default() });
    let volume = phantom.voxelise(&phantom.grid(), &Progress::default()).expect("a phantom");
    let line = phantom.truth().centerline;
    let at = |n: usize| line[n];
    let (from, to) = (at(line.len() / 2), at(line.len() / 2 + 8));
    let ahead = (to - from).normalize();
    let view = |n: i32| View::new(from + ahead * f64::from(n), ahead, DVec3::Z, 90.0, SIDE, SIDE).expect("a view");
    (PreparedVolume::new(Arc::new(volume), TransferFunction::default()), (0..10).map(view).collect())
}

/// Points near the wall, as rays visit them.
fn places(volume: &PreparedVolume) -> Vec<Vec3> {
    let dims = volume.voxels().grid().dims();
    let place =
        |n: u64| Vec3::from_array(std::array::from_fn(|a| (dims[a] as f64 * hash::uniform(n, a as u64)) as f32));
    let near = |q: &Vec3| {
        let [i, j, k] = (*q - 1.0).max(Vec3::ZERO).to_array().map(|c| c as usize);
        !volume.flags().homogeneous(volume.voxels(), i, j, k)
    };
    (0..200_000).map(place).filter(near).flat_map(|q| (0..8).map(move |n| q + 0.3 * n as f32)).take(20_000).collect()
}

/// Measures each part separately, in sequence.
fn parts(c: &mut Criterion) {
    let (volume, views) = scene();
    let s = &volume;
    let places = places(s);
    let one = ByteVolume::new(s, 1);
    let bytes = ByteTrilinear::new(s, &one);
    let fits = |source| Fits::new(source, &Trilinear::new(s), s);
    let (cache, stored) = (fits(GradientSource::Cached), fits(GradientSource::Stored));
    let size = |fits: &Fits| fits.part().map_or(0, |p| p.1);
    println!(
        "bytes: volume {}, flags {}, 7 + 1 bits {}, wall distance per voxel {}, per brick {}, gradients {}, cache {}",
        s.voxels().bytes(),
        s.bytes(),
        one.bytes(),
        VoxelWalls::new(s).bytes(),
        BrickWalls::new(s).bytes(),
        size(&stored),
        size(&cache)
    );

    let mut group = c.benchmark_group("sampling of 20 000 places");
    let values = |f: &dyn Fn(Vec3) -> f32| places.iter().map(|&q| f(q)).sum::<f32>();
    let (low, low_bytes) = (Nearest::new(s), ByteNearest::new(s, &one));
    group.bench_function("nearest, 16 bits", |b| b.iter(|| values(&|q| low.value(q))));
    let high = Trilinear::new(s);
    group.bench_function("trilinear, 16 bits", |b| b.iter(|| values(&|q| high.value(q))));
    group.bench_function("nearest, 7 + 1 bits", |b| b.iter(|| values(&|q| low_bytes.value(q))));
    group.bench_function("trilinear, 7 + 1 bits, fixed point", |b| b.iter(|| values(&|q| bytes.value(q))));
    group.bench_function("trilinear, 7 + 1 bits, floats", |b| b.iter(|| values(&|q| bytes.value_in_floats(q))));
    group.finish();

    let mut group = c.benchmark_group("gradients at 20 000 places");
    let gradients = |f: &dyn Fn(Vec3) -> Vec3| places.iter().map(|&q| f(q)).sum::<Vec3>();
    group.bench_function("computed", |b| b.iter(|| gradients(&|q| high.gradient(q))));
    let [with_stored, with_cache, with_eight] =
        [&stored, &cache, &Fits::Eight].map(|fits| FitSampler::new(Trilinear::new(s), fits));
    group.bench_function("computed at eight voxels", |b| b.iter(|| gradients(&|q| with_eight.gradient(q))));
    group.bench_function("ahead of time", |b| b.iter(|| gradients(&|q| with_stored.gradient(q))));
    group.bench_function("cached", |b| b.iter(|| gradients(&|q| with_cache.gradient(q))));
    group.finish();

    let mut group = c.benchmark_group("preparing");
    group.sample_size(10);
    group.bench_function("flags", |b| b.iter(|| PreparedVolume::new(s.shared_voxels(), s.transfer())));
    group.bench_function("7 + 1 bits", |b| b.iter(|| ByteVolume::new(s, 2)));
    group.bench_function("wall distance per voxel", |b| b.iter(|| VoxelWalls::new(s)));
    group.bench_function("wall distance per brick", |b| b.iter(|| BrickWalls::new(s)));
    group.bench_function("gradients near the wall", |b| b.iter(|| fits(GradientSource::Stored)));
    group.finish();

    let settings = Settings::default();
    let request = ImageRequest { volume: s, view: &views[0], settings: &settings };
    let (mut kept, mut frame) = (vec![(); SIDE * SIDE], Frame::default());
    let (walls, boxes) = (VoxelWalls::new(s), BrickWalls::new(s));
    let mut group = c.benchmark_group("leaping, a frame");
    group.sample_size(20);
    macro_rules! frame {
        ($name:expr, $sampler:expr, $skipper:expr, $classifier:expr) => {
            group.bench_function($name, |b| {
                b.iter(|| {
                    black_box(request.image($sampler, $skipper, $classifier, &FromScratch, &mut kept, &mut frame))
                })
            });
        };
    }
    frame!("nothing", &high, &Everything, &ByValue);
    frame!("bricks", &high, &Leap::<false>::new(s), &ByValue);
    frame!("bricks and flags", &high, &Leap::<true>::new(s), &ByValue);
    frame!("wall distance per brick", &high, &BrickLeap::<false>::new(s, &boxes), &ByValue);
    frame!("wall distance per brick, and flags", &high, &BrickLeap::<true>::new(s, &boxes), &ByValue);
    frame!("wall distance per voxel", &high, &VoxelLeap::<1>::new(&walls), &ByValue);
    frame!("precomputed gradients", &with_stored, &Leap::<true>::new(s), &ByValue);
    frame!("gradients cached", &with_cache, &Leap::<true>::new(s), &ByValue);
    frame!("filtered density, wall distance per voxel", &high, &VoxelLeap::<2>::new(&walls), &ByDensity);
    frame!("filtered density ahead of time, the same", &with_stored, &VoxelLeap::<2>::new(&walls), &ByDensity);
    group.finish();

    let mut group = c.benchmark_group("ten frames of a flight");
    group.sample_size(10);
    let low = Settings::new(Quality::Low);
    type Make<'a> = &'a dyn Fn() -> Box<dyn Renderer>;
    let makes: [(&str, Make<'_>); 7] = [
        ("high", &|| renderer(s, settings, Preset::default(), Reuse::Never)),
        ("high, reusing", &|| Box::new(Reusing::<_, f32>::new(WordStorage::new(s), settings, Refresh::Staggered(16)))),
        ("high, the paper's rule", &|| {
            Box::new(Reusing::<_, Trace>::new(WordStorage::new(s), settings, Refresh::KeyFrames(10)))
        }),
        ("low", &|| renderer(s, low, Preset::default(), Reuse::Never)),
        ("colvis", &|| renderer(s, settings, presets::colvis::PRESET, Reuse::Allowed)),
        ("colvis without reuse", &|| renderer(s, settings, presets::colvis::PRESET, Reuse::Never)),
        ("lean", &|| {
            renderer(
                &PreparedVolume::lean(s.shared_voxels(), s.transfer()),
                settings,
                presets::lean::PRESET,
                Reuse::Allowed,
            )
        }),
    ];
    for (name, make) in makes {
        let mut renderer = make();
        group.bench_function(name, |b| {
            b.iter(|| views.iter().map(|v| renderer.render(v, &mut frame).samples).sum::<u64>());
        });
    }
    group.finish();
}

criterion_group!(benches, parts);
criterion_main!(benches);
