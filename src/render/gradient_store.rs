//! Gradients that are not computed anew for every sample: all of them ahead of time, or each once in a while (the
//! paper's section 2.2).
//!
//! Both keep the regressions at voxels and interpolate them, as the paper does; quantised to 16 bits a component, which
//! is 1/8 HU per h (1/8 HU for the density), so that the same voxel always gives the same bits.
//!
//! Packets of rays do not use it: their cache holds whole cells ([`fast`](super::fast)).

use std::sync::atomic::{AtomicU64, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::prepared_volume::PreparedVolume;
use super::regression::{Fit, Regression, block};
use super::sampler::{Sampler, Trilinear, is_homogeneous, regression, split};

/// Edge of the bricks that are stored or not, voxels.
const EDGE: usize = 4;
/// Voxels of a brick.
const VOXELS: usize = EDGE * EDGE * EDGE;
/// A brick that is not stored.
const NONE: u32 = u32::MAX;

/// A fit in 64 bits: gradient along the index axes and density.
#[derive(Clone, Copy)]
struct Quantum {
    /// HU/mm of a step of a gradient's component.
    gradient: f32,
    /// HU of a step of the density.
    density: f32,
}

impl Quantum {
    fn new(space: &PreparedVolume) -> Self {
        Self { gradient: 0.125 / space.volume().grid().min_spacing() as f32, density: 0.125 }
    }

    fn pack(self, fit: Fit) -> [i16; 4] {
        // A cast stops at the bounds of 16 bits: ±4096 HU over h.
        let [a, b, c] = (fit.gradient / self.gradient).round().to_array().map(|g| g as i16);
        [a, b, c, (fit.density / self.density).round() as i16]
    }

    #[inline(always)]
    fn gradient(self, [a, b, c, _]: [i16; 4]) -> Vec3 {
        Vec3::new(f32::from(a), f32::from(b), f32::from(c)) * self.gradient
    }

    #[inline(always)]
    fn fit(self, packed: [i16; 4]) -> Fit {
        Fit { gradient: self.gradient(packed), density: f32::from(packed[3]) * self.density }
    }
}

/// The regression at voxel `v`, counted from voxel −1.
#[inline(never)]
fn at_voxel(space: &PreparedVolume, regression: &Regression, v: [i32; 3]) -> Fit {
    regression.fit(&block(space.volume(), v.map(|c| c - 2)), Vec3::ZERO)
}

/// The weights of a cell's corners at the place `t` in it: x fastest.
#[inline(always)]
fn weights(t: Vec3) -> [f32; 8] {
    let s = Vec3::ONE - t;
    let [a, b, c, d] = [s.x * s.y, t.x * s.y, s.x * t.y, t.x * t.y];
    [a * s.z, b * s.z, c * s.z, d * s.z, a * t.z, b * t.z, c * t.z, d * t.z]
}

#[inline(always)]
fn corner(cell: [i32; 3], n: usize) -> [i32; 3] {
    let n = n as i32;
    [cell[0] + (n & 1), cell[1] + (n >> 1 & 1), cell[2] + (n >> 2)]
}

/// Which voxels' gradients are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stored {
    /// Those near the wall: of bricks with a voxel that is neither empty nor opaque with all its neighbours.
    NearWall,
    /// All.
    Everywhere,
}

/// Gradients and densities computed ahead of time: eight bytes a stored voxel.
pub struct GradientVolume {
    bricks: [usize; 3],
    /// Where each brick's voxels begin, in bricks; [`NONE`] for those that are not stored.
    index: Vec<u32>,
    fits: Vec<[i16; 4]>,
    quantum: Quantum,
}

impl GradientVolume {
    /// Computes what is stored of `space`, in parallel.
    pub fn new(space: &PreparedVolume, stored: Stored) -> Self {
        let dims = space.volume().grid().dims();
        // Voxel −1 to n of each axis: those at the border have gradients too.
        let bricks = dims.map(|n| (n + 2).div_ceil(EDGE));
        let count: usize = bricks.iter().product();
        let corner =
            |n: usize| [n % bricks[0], n / bricks[0] % bricks[1], n / bricks[0] / bricks[1]].map(|b| (b * EDGE) as i32);
        let voxel = |n: usize, m: usize| {
            let [i, j, k] = corner(n);
            [i + (m % EDGE) as i32, j + (m / EDGE % EDGE) as i32, k + (m / EDGE / EDGE) as i32]
        };
        let near = |n: usize| {
            (0..VOXELS).any(|m| {
                let [i, j, k] = voxel(n, m).map(|c| c as usize);
                let inside = (1..=dims[0]).contains(&i) && (1..=dims[1]).contains(&j) && (1..=dims[2]).contains(&k);
                inside && !space.flags().homogeneous(space.volume(), i - 1, j - 1, k - 1)
            })
        };
        let wanted: Vec<bool> = (0..count).into_par_iter().map(|n| stored == Stored::Everywhere || near(n)).collect();
        let (mut index, mut list) = (vec![NONE; count], Vec::new());
        for n in (0..count).filter(|&n| wanted[n]) {
            index[n] = list.len() as u32;
            list.push(n);
        }
        let (quantum, regression) = (Quantum::new(space), regression(space));
        let mut fits = vec![[0; 4]; list.len() * VOXELS];
        fits.par_chunks_mut(VOXELS).zip(&list).for_each(|(out, &n)| {
            for (m, out) in out.iter_mut().enumerate() {
                *out = quantum.pack(at_voxel(space, &regression, voxel(n, m)));
            }
        });
        Self { bricks, index, fits, quantum }
    }

    /// Memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.index.as_slice()) + size_of_val(self.fits.as_slice())
    }

    #[inline(always)]
    fn get(&self, v: [i32; 3]) -> Option<[i16; 4]> {
        let b = v.map(|c| c as usize / EDGE);
        let inner = v.map(|c| c as usize % EDGE);
        let n = *self.index.get(b[0] + self.bricks[0] * (b[1] + self.bricks[1] * b[2]))?;
        self.fits.get(n as usize * VOXELS + inner[0] + EDGE * (inner[1] + EDGE * inner[2])).copied()
    }
}

/// High detail with gradients and densities from a [`GradientVolume`]; what is not stored is computed.
pub struct StoredGradientSampler<'a> {
    plain: Trilinear<'a>,
    stored: &'a GradientVolume,
}

impl<'a> StoredGradientSampler<'a> {
    /// A sampler of `space`, from which `stored` was made.
    pub fn new(space: &'a PreparedVolume, stored: &'a GradientVolume) -> Self {
        Self { plain: Trilinear::new(space), stored }
    }
}

impl Sampler for StoredGradientSampler<'_> {
    #[inline(always)]
    fn value(&self, q: Vec3) -> f32 {
        self.plain.value(q)
    }

    #[inline(always)]
    fn fit(&self, q: Vec3) -> Fit {
        let (cell, t) = split(q);
        let (weights, mut sum) = (weights(t), Fit { gradient: Vec3::ZERO, density: 0.0 });
        for (n, w) in weights.into_iter().enumerate() {
            let Some(packed) = self.stored.get(corner(cell, n)) else { return self.plain.fit(q) };
            let fit = self.stored.quantum.fit(packed);
            sum = Fit { gradient: sum.gradient + fit.gradient * w, density: sum.density + fit.density * w };
        }
        sum
    }

    #[inline(always)]
    fn gradient(&self, q: Vec3) -> Vec3 {
        if is_homogeneous(self.plain.space(), q) { Vec3::ZERO } else { self.fit(q).gradient }
    }
}

/// Entries of a gradient cache, as a power of two: 4 MiB.
const CACHE_BITS: u32 = 19;

/// A cache of gradients at voxels that lives as long as its owner: for a frame or for many.
///
/// Direct-mapped, eight bytes an entry: 48 bits of gradient and 16 that tell the voxels apart which share the entry. An
/// entry is one atomic word, so any number of threads may use it; what it says depends on the voxel alone, so pictures do
/// not depend on who came first.
pub struct GradientCache {
    entries: Vec<AtomicU64>,
    quantum: Quantum,
}

impl GradientCache {
    /// An empty cache for `space`.
    pub fn new(space: &PreparedVolume) -> Self {
        let dims = space.volume().grid().dims();
        let voxels = dims.iter().map(|&n| n as u64 + 2).product::<u64>();
        // No more voxels to an entry than 16 bits tell apart.
        let bits = CACHE_BITS.max((voxels >> 15).checked_ilog2().map_or(0, |b| b + 1));
        let mut entries = Vec::new();
        entries.resize_with(1 << bits, AtomicU64::default);
        Self { entries, quantum: Quantum::new(space) }
    }

    /// Memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.entries.as_slice())
    }
}

/// High detail with gradients by way of a [`GradientCache`].
pub struct CachedGradientSampler<'a> {
    plain: Trilinear<'a>,
    regression: Regression,
    cache: &'a GradientCache,
}

impl<'a> CachedGradientSampler<'a> {
    /// A sampler of `space`, for which `cache` was made.
    pub fn new(space: &'a PreparedVolume, cache: &'a GradientCache) -> Self {
        Self { plain: Trilinear::new(space), regression: regression(space), cache }
    }

    #[inline(always)]
    fn at(&self, v: [i32; 3]) -> Vec3 {
        let space = self.plain.space();
        let dims = space.volume().grid().dims();
        let [i, j, k] = v.map(|c| c as usize);
        let n = i + (dims[0] + 2) * (j + (dims[1] + 2) * k);
        let mask = self.cache.entries.len() - 1;
        let tag = (n >> self.cache.entries.len().ilog2()) as u64 + 1;
        let entry = &self.cache.entries[n & mask];
        let found = entry.load(Ordering::Relaxed);
        let packed = if found >> 48 == tag {
            [found as i16, (found >> 16) as i16, (found >> 32) as i16, 0]
        } else {
            let packed = self.cache.quantum.pack(at_voxel(space, &self.regression, v));
            let [a, b, c, _] = packed.map(|p| u64::from(p as u16));
            entry.store(tag << 48 | c << 32 | b << 16 | a, Ordering::Relaxed);
            packed
        };
        self.cache.quantum.gradient(packed)
    }
}

impl Sampler for CachedGradientSampler<'_> {
    #[inline(always)]
    fn value(&self, q: Vec3) -> f32 {
        self.plain.value(q)
    }

    /// Not cached: a density needs more bits than an entry has.
    #[inline(always)]
    fn fit(&self, q: Vec3) -> Fit {
        self.plain.fit(q)
    }

    #[inline(always)]
    fn gradient(&self, q: Vec3) -> Vec3 {
        if is_homogeneous(self.plain.space(), q) {
            return Vec3::ZERO;
        }
        let (cell, t) = split(q);
        weights(t).into_iter().enumerate().map(|(n, w)| self.at(corner(cell, n)) * w).sum()
    }
}

#[cfg(test)]
#[path = "gradient_store_tests.rs"]
mod tests;
