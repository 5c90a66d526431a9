//! Time of a cross-section: `cargo bench -p colvis-bench --bench slices`.
//!
//! It takes 512×512 pixels of 0.7 mm through the middle of an artificial scan of 512×512×400 voxels of 0.7×0.7×1.0 mm,
//! on the machine's own number of threads.
#![expect(missing_docs, reason = "criterion_group makes a public function without a comment")]

use colvis::render::slice::{Slab, SlabKind, Slice, SlicePlane, Windowing};
use colvis::volume::{Grid, Volume};
use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DMat3, DVec3};

/// A scan whose neighbouring voxels all differ.
fn scan() -> Volume {
    let grid = Grid::new([512, 512, 400], DVec3::new(0.7, 0.7, 1.0), DVec3::ZERO, DMat3::IDENTITY).expect("a grid");
    let data = (0..grid.len() as u32).map(|n| (n.wrapping_mul(2_654_435_761) >> 20) as i16 - 1024).collect();
    Volume::new(grid, data)
}

fn slices(c: &mut Criterion) {
    let volume = scan();
    let centre = volume.grid().world(DVec3::new(255.3, 256.1, 199.7));
    let mut hu = Vec::new();
    let mut group = c.benchmark_group("512×512 pixels");
    group.sample_size(30);
    let oblique = SlicePlane::Oblique(DVec3::new(0.5, -0.7, 0.4));
    let planes = [
        ("axial", SlicePlane::Axial),
        ("coronal", SlicePlane::Coronal),
        ("sagittal", SlicePlane::Sagittal),
        ("oblique", oblique),
    ];
    for (name, plane) in planes {
        let slice = Slice { centre, frame: plane.frame().expect("a plane"), mm_per_pixel: 0.7, size: [512; 2] };
        group.bench_function(name, |b| b.iter(|| slice.fill(&volume, &mut hu)));
        for (mm, kind) in [(5.0, SlabKind::Mean), (5.0, SlabKind::Max), (20.0, SlabKind::Mean)] {
            let slab = Slab::new(mm, kind).expect("a slab");
            group.bench_function(format!("{name}, {mm} mm {kind:?}"), |b| {
                b.iter(|| slice.fill_slab(&volume, slab, &mut hu));
            });
        }
    }
    let mut grey = vec![0; hu.len()];
    group.bench_function("windowing", |b| b.iter(|| Windowing::default().fill(&hu, &mut grey)));
    group.finish();
}

criterion_group!(benches, slices);
criterion_main!(benches);
