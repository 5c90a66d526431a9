//! How often the regression at a voxel is recomputed within a frame (the paper's section 2.2: "at least a double recalculation of
//! most variables is performed during rendering of an entire frame").

use std::sync::atomic::{AtomicU64, Ordering};

use glam::Vec3;

use crate::error::Result;
use crate::render::begin::FromScratch;
use crate::render::bytes::{ByteLeap, ByteTrilinear, ByteVolume};
use crate::render::caster::ImageRequest;
use crate::render::classify::ByDensity;
use crate::render::gradient_store::{FitSampler, Fits};
use crate::render::regression::Fit;
use crate::render::sampler::{Sampler, VoxelSampler};
use crate::render::{Classification, Frame, GradientSource, Settings, View};
use crate::report::flight::Stop;
use crate::space::PreparedVolume;

use super::Extent;

/// Counts of regressions in frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Recount {
    /// Voxels whose regression was requested, over all frames.
    pub voxels: u64,
    /// Those of them that were requested again in the same frame.
    pub again: u64,
    /// Number of computations without any cache.
    pub computed: u64,
    /// Number of computations with a cache for each frame.
    pub cached: u64,
}

/// Counts the requests for regressions at voxels from a sampler.
struct Counting<'a, S> {
    plain: S,
    counts: &'a Counts,
}

/// A bit for each voxel that was requested, and for each that was requested again.
struct Counts {
    dims: [usize; 3],
    once: Vec<AtomicU64>,
    again: Vec<AtomicU64>,
    all: AtomicU64,
}

impl Counts {
    fn new(volume: &PreparedVolume) -> Self {
        // Voxels are counted from −1, since those beside the volume have regressions too.
        let dims = volume.voxels().grid().dims().map(|n| n + 2);
        let bits = || (0..dims.iter().product::<usize>().div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        Self { dims, once: bits(), again: bits(), all: AtomicU64::new(0) }
    }

    fn note(&self, v: [i32; 3]) {
        let [i, j, k] = v.map(|c| c as usize);
        let n = i + self.dims[0] * (j + self.dims[1] * k);
        let bit = 1 << (n % 64);
        self.all.fetch_add(1, Ordering::Relaxed);
        if self.once[n / 64].fetch_or(bit, Ordering::Relaxed) & bit != 0 {
            self.again[n / 64].fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// Returns the number of distinct voxels, of those requested again, and of all requests.
    fn finish(self) -> [u64; 3] {
        let ones = |words: Vec<AtomicU64>| words.into_iter().map(|w| u64::from(w.into_inner().count_ones())).sum();
        [ones(self.once), ones(self.again), self.all.into_inner()]
    }
}

impl<S: VoxelSampler> Sampler for Counting<'_, S> {
    fn value(&self, q: Vec3) -> f32 {
        self.plain.value(q)
    }

    fn fit(&self, q: Vec3) -> Fit {
        self.plain.fit(q)
    }

    fn is_within_tissue(&self, q: Vec3) -> bool {
        self.plain.is_within_tissue(q)
    }
}

impl<S: VoxelSampler> VoxelSampler for Counting<'_, S> {
    const INTERPOLATES: bool = S::INTERPOLATES;

    fn fit_at(&self, v: [i32; 3]) -> Fit {
        self.counts.note(v);
        self.plain.fit_at(v)
    }

    fn densities(&self) -> [f32; 2] {
        self.plain.densities()
    }
}

/// Counts in the pictures of `stops`, each rendered from scratch with the samples of the preset `colvis`. Fails for an invalid
/// pose.
pub(crate) fn recount(volume: &PreparedVolume, stops: &[Stop], extent: &Extent) -> Result<Recount> {
    let bytes = ByteVolume::new(volume, 2);
    let mut sum = Recount::default();
    for stop in stops {
        let view = stop.pose.view(extent.fov_degrees, extent.pixels)?;
        let [voxels, again, computed] = frame(volume, &bytes, &view, GradientSource::Eight);
        let [_, _, cached] = frame(volume, &bytes, &view, GradientSource::Cached);
        sum = Recount {
            voxels: sum.voxels + voxels,
            again: sum.again + again,
            computed: sum.computed + computed,
            cached: sum.cached + cached,
        };
    }
    Ok(sum)
}

fn frame(volume: &PreparedVolume, bytes: &ByteVolume, view: &View, source: GradientSource) -> [u64; 3] {
    let settings = Settings { classification: Classification::Filtered, ..Settings::default() };
    let counts = Counts::new(volume);
    let plain = ByteTrilinear::new(volume, bytes);
    let fits = Fits::new(source, &plain, volume);
    let sampler = FitSampler::new(Counting { plain, counts: &counts }, &fits);
    let mut kept = vec![(); view.width() * view.height()];
    ImageRequest { volume, view, settings: &settings }.image(
        &sampler,
        &ByteLeap::new(bytes),
        &ByDensity,
        &FromScratch,
        &mut kept,
        &mut Frame::default(),
    );
    counts.finish()
}
