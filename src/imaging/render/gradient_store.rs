//! Gradients that are not recomputed for every sample. They are computed ahead of time, near the wall or everywhere
//! (the paper's section 2.2), or cached.
//!
//! Both keep the regressions at voxels and interpolate them, as the paper does. They are quantised, so that the same
//! voxel always gives the same bits: here to 16 bits per component, which is 1/8 HU per h.
//!
//! Packets of rays do not use this: their cache holds whole cells ([`packets`](super::packets)).

use glam::Vec3;
use rayon::prelude::*;

use super::choices::GradientSource;
use super::density_scale::DensityScale;
use super::gradient_cache::{self, GradientCache};
use super::memory::MemoryPart;
use super::regression::Fit;
use super::sampler::{Sampler, VoxelSampler, nearest, split};
use crate::space::PreparedVolume;

/// Edge of the bricks that are stored or left out, voxels.
const EDGE: usize = 4;
/// Voxels in a brick.
const VOXELS: usize = EDGE * EDGE * EDGE;
/// Marks a brick that is not stored.
const NONE: u32 = u32::MAX;

/// The scale of a fit in 64 bits: gradient along the index axes and density.
#[derive(Clone, Copy)]
struct Quantum {
    /// HU/mm per step of a gradient component.
    gradient: f32,
    density: DensityScale,
}

impl Quantum {
    fn new(volume: &PreparedVolume, densities: [f32; 2]) -> Self {
        let gradient = 0.125 / volume.voxels().grid().min_spacing() as f32;
        Self { gradient, density: DensityScale::new(densities, volume.transfer(), 16) }
    }

    fn pack(self, fit: Fit) -> [i16; 4] {
        // The cast saturates at the bounds of 16 bits: ±4096 HU over h.
        let [a, b, c] = (fit.gradient / self.gradient).round().to_array().map(|g| g as i16);
        [a, b, c, self.density.level(fit.density) as u16 as i16]
    }

    #[inline(always)]
    fn fit(self, [a, b, c, d]: [i16; 4]) -> Fit {
        let gradient = Vec3::new(f32::from(a), f32::from(b), f32::from(c)) * self.gradient;
        Fit { gradient, density: self.density.value(u32::from(d as u16)) }
    }
}

/// Returns the weights of a cell's corners at the place `t` in it, x fastest.
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

/// The voxels whose gradients are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stored {
    /// Voxels near the wall: those of bricks with a voxel that is neither empty nor opaque together with all its neighbours.
    NearWall,
    /// All voxels.
    Everywhere,
}

/// Gradients and densities computed ahead of time: eight bytes per stored voxel.
pub struct GradientVolume {
    bricks: [usize; 3],
    /// The start of each brick's voxels, in bricks; [`NONE`] for bricks that are not stored.
    index: Vec<u32>,
    fits: Vec<[i16; 4]>,
    quantum: Quantum,
}

impl GradientVolume {
    /// Computes the stored voxels of `volume`, as `sampler` sees them, in parallel.
    pub fn new<S: VoxelSampler>(sampler: &S, volume: &PreparedVolume, stored: Stored) -> Self {
        volume.fill_flags();
        let dims = volume.voxels().grid().dims();
        // Voxels −1 to n of each axis: those at the border have gradients too.
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
                inside && !volume.flags().homogeneous(volume.voxels(), i - 1, j - 1, k - 1)
            })
        };
        let wanted: Vec<bool> = (0..count).into_par_iter().map(|n| stored == Stored::Everywhere || near(n)).collect();
        let (mut index, mut list) = (vec![NONE; count], Vec::new());
        for n in (0..count).filter(|&n| wanted[n]) {
            index[n] = list.len() as u32;
            list.push(n);
        }
        let quantum = Quantum::new(volume, sampler.densities());
        let mut fits = vec![[0; 4]; list.len() * VOXELS];
        fits.par_chunks_mut(VOXELS).zip(&list).for_each(|(out, &n)| {
            for (m, out) in out.iter_mut().enumerate() {
                *out = quantum.pack(sampler.fit_at(voxel(n, m)));
            }
        });
        Self { bricks, index, fits, quantum }
    }

    /// Returns the memory in use, bytes.
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

/// The source of a renderer's regressions, with the data kept for it.
pub enum Fits {
    /// Regressions by [`GradientSource::None`].
    Fused,
    /// Regressions by [`GradientSource::Eight`].
    Eight,
    /// Regressions by [`GradientSource::Cached`].
    Cached(GradientCache),
    /// Regressions by [`GradientSource::Stored`].
    Stored(GradientVolume),
}

impl Fits {
    /// Prepares what `source` needs for `volume`, whose voxels `sampler` sees.
    ///
    /// Nothing is kept if the wall's ramp is so steep that stored densities could not distinguish its opacities.
    pub fn new<S: VoxelSampler>(source: GradientSource, sampler: &S, volume: &PreparedVolume) -> Self {
        let (wall, densities) = (volume.transfer(), sampler.densities());
        let serves = |bits| DensityScale::new(densities, wall, bits).serves(wall);
        match source {
            GradientSource::None => Self::Fused,
            GradientSource::Cached if serves(gradient_cache::DENSITY_BITS) => {
                Self::Cached(GradientCache::new(volume, densities))
            }
            GradientSource::Stored if serves(16) => {
                Self::Stored(GradientVolume::new(sampler, volume, Stored::NearWall))
            }
            GradientSource::Eight | GradientSource::Cached | GradientSource::Stored => Self::Eight,
        }
    }

    /// Returns its memory, if it has any.
    pub fn part(&self) -> Option<(MemoryPart, usize)> {
        match self {
            Self::Fused | Self::Eight => None,
            Self::Cached(cache) => Some((MemoryPart::GradientCache, cache.bytes())),
            Self::Stored(stored) => Some((MemoryPart::StoredGradients, stored.bytes())),
        }
    }
}

/// A sampler that takes its regressions from [`Fits`] and computes those that are not stored.
pub struct FitSampler<'a, S> {
    plain: S,
    fits: &'a Fits,
}

impl<'a, S: VoxelSampler> FitSampler<'a, S> {
    /// Creates a sampler that samples as `plain` does, with the regressions of `fits`, which must have been made for it.
    pub fn new(plain: S, fits: &'a Fits) -> Self {
        Self { plain, fits }
    }

    /// Returns the fit at `q` from those at voxels that `at` returns, or `None` if one is missing.
    #[inline(always)]
    fn of_voxels(&self, q: Vec3, at: impl Fn([i32; 3]) -> Option<Fit>) -> Option<Fit> {
        if !S::INTERPOLATES {
            return at(nearest(q));
        }
        let (cell, t) = split(q);
        let mut sum = Fit { gradient: Vec3::ZERO, density: 0.0 };
        for (n, w) in weights(t).into_iter().enumerate() {
            let fit = at(corner(cell, n))?;
            sum = Fit { gradient: sum.gradient + fit.gradient * w, density: sum.density + fit.density * w };
        }
        Some(sum)
    }
}

impl<S: VoxelSampler> Sampler for FitSampler<'_, S> {
    #[inline(always)]
    fn value(&self, q: Vec3) -> f32 {
        self.plain.value(q)
    }

    #[inline(always)]
    fn fit(&self, q: Vec3) -> Fit {
        let of_voxels = match self.fits {
            Fits::Fused => None,
            Fits::Eight => self.of_voxels(q, |v| Some(self.plain.fit_at(v))),
            Fits::Cached(cache) => self.of_voxels(q, |v| Some(cache.get(v, || self.plain.fit_at(v)))),
            Fits::Stored(stored) => self.of_voxels(q, |v| stored.get(v).map(|packed| stored.quantum.fit(packed))),
        };
        of_voxels.unwrap_or_else(|| self.plain.fit(q))
    }

    #[inline(always)]
    fn is_within_tissue(&self, q: Vec3) -> bool {
        self.plain.is_within_tissue(q)
    }
}

#[cfg(test)]
#[path = "gradient_store_tests.rs"]
mod tests;
