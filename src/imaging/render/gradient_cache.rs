//! A cache of regressions at voxels (the paper's section 2.2: "caching gradients at frame level").
//!
//! The volume does not change, so neither do the regressions: what one frame computes is valid for the next.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::Vec3;

use super::density_scale::DensityScale;
use super::regression::Fit;
use crate::space::PreparedVolume;

/// Entries, as a power of two: 4 MiB.
const CACHE_BITS: u32 = 19;
/// Bits of a component of the gradient, including its sign.
const PART_BITS: u32 = 12;
/// Bits of the density.
pub(super) const DENSITY_BITS: u32 = 12;
/// The greatest component.
const PART_MAX: f32 = ((1 << (PART_BITS - 1)) - 1) as f32;
/// Position of the exponent of two that the gradient's components share; it follows them.
const EXPONENT_AT: u32 = 3 * PART_BITS;
/// The greatest exponent.
const EXPONENT_MAX: u32 = 15;
/// Position of the density.
const DENSITY_AT: u32 = EXPONENT_AT + 4;
/// Position of the tag, which identifies the voxel among those that share an entry. 0 marks an entry that was never filled.
const TAG_AT: u32 = DENSITY_AT + DENSITY_BITS;
/// The number of voxels that may share an entry.
const TAGS: u64 = (1 << (64 - TAG_AT)) - 1;

/// A cache of regressions at voxels that lives as long as its owner: for one frame or many.
///
/// It is direct-mapped, with eight bytes per entry: three components of the gradient (12 bits each, with a common
/// exponent: 1/2000 of the greatest), the density (12 bits over the range of voxel values, 1 HU for 16-bit ones) and 12
/// bits that identify the voxel among those that share the entry. An entry is one atomic word, so any number of threads
/// may use it. Its content depends on the voxel alone, so pictures do not depend on which thread came first.
pub struct GradientCache {
    entries: Vec<AtomicU64>,
    /// Voxels along x and y, including one before and one behind.
    row: [usize; 2],
    /// HU/mm per step of a component at exponent 0.
    unit: f32,
    density: DensityScale,
}

impl GradientCache {
    /// Creates an empty cache for `volume`. `densities` are the least and the greatest density, HU.
    pub fn new(volume: &PreparedVolume, densities: [f32; 2]) -> Self {
        let grid = volume.voxels().grid();
        let dims = grid.dims();
        let voxels = dims.iter().map(|&n| n as u64 + 2).product::<u64>();
        // An entry may be shared by no more voxels than the tag can distinguish.
        let bits = CACHE_BITS.max((voxels / TAGS).checked_ilog2().map_or(0, |b| b + 1));
        let mut entries = Vec::new();
        entries.resize_with(1 << bits, AtomicU64::default);
        // No 16-bit volume changes by more than this over a step of h.
        let steepest = 65536.0 / grid.min_spacing() as f32;
        let unit = steepest / (PART_MAX * (1 << EXPONENT_MAX) as f32);
        let density = DensityScale::new(densities, volume.transfer(), DENSITY_BITS);
        Self { entries, row: [dims[0] + 2, dims[1] + 2], unit, density }
    }

    /// Returns the memory in use, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.entries.as_slice())
    }

    /// Returns the fit at voxel `v` (counted from voxel −1), calling `compute` if it is not cached.
    #[inline(always)]
    pub fn get(&self, v: [i32; 3], compute: impl FnOnce() -> Fit) -> Fit {
        let [i, j, k] = v.map(|c| c as usize);
        let n = i + self.row[0] * (j + self.row[1] * k);
        let mask = self.entries.len() - 1;
        let tag = (n >> self.entries.len().trailing_zeros()) as u64 + 1;
        let entry = &self.entries[n & mask];
        let found = entry.load(Ordering::Relaxed);
        if found >> TAG_AT == tag {
            return self.unpack(found);
        }
        let packed = self.pack(compute());
        entry.store(tag << TAG_AT | packed, Ordering::Relaxed);
        // Return the value as it will be read back later, so that the picture does not depend on whether it was cached.
        self.unpack(packed)
    }

    fn pack(&self, fit: Fit) -> u64 {
        let least = fit.gradient.abs().max_element() / (self.unit * PART_MAX);
        // The least power of two that is not below `least`, or the next one.
        let exponent = if least > 1.0 { (least.to_bits() >> 23) - 126 } else { 0 }.min(EXPONENT_MAX);
        let parts =
            (fit.gradient / (self.unit * power(exponent))).round().clamp(Vec3::splat(-PART_MAX), Vec3::splat(PART_MAX));
        let [a, b, c] = parts.to_array().map(|p| u64::from(p as i32 as u32) & ((1 << PART_BITS) - 1));
        let density = u64::from(self.density.level(fit.density));
        density << DENSITY_AT | u64::from(exponent) << EXPONENT_AT | c << (2 * PART_BITS) | b << PART_BITS | a
    }

    #[inline(always)]
    fn unpack(&self, packed: u64) -> Fit {
        let part = |at: u32| ((packed << (64 - PART_BITS - at)) as i64 >> (64 - PART_BITS)) as f32;
        let exponent = (packed >> EXPONENT_AT) as u32 & EXPONENT_MAX;
        let level = (packed >> DENSITY_AT) as u32 & ((1 << DENSITY_BITS) - 1);
        let gradient = Vec3::new(part(0), part(PART_BITS), part(2 * PART_BITS)) * (self.unit * power(exponent));
        Fit { gradient, density: self.density.value(level) }
    }
}

/// 2^`exponent`.
#[inline(always)]
fn power(exponent: u32) -> f32 {
    f32::from_bits((127 + exponent) << 23)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::math::hash;
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};

    #[test]
    fn what_is_kept_is_what_was_put_in() {
        for (lo, hi) in [(-800.0, -500.0), (-30000.0, 30000.0), (4999.5, 6000.0)] {
            let grid = Grid::new([300, 200, 100], DVec3::new(0.5, 0.7, 3.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let wall = TransferFunction::new(lo, hi).unwrap();
            let volume = Volume::new(grid.clone(), vec![0; grid.len()]);
            let [low, high] = [lo.min(-1000.0), hi.max(3000.0)];
            let cache = GradientCache::new(&PreparedVolume::new(Arc::new(volume), wall), [low, high]);
            let range = f64::from(high - low);
            for n in 0..4000u64 {
                let u = |k: u64| hash::uniform(n, k);
                let v = [n % 302, n / 302 * 15, n * 7 % 102].map(|c| c as i32);
                let size = 10f64.powf(8.0 * u(3) - 4.0).min(1e4);
                let gradient = Vec3::from_array([u(4), u(5), u(6)].map(|g| (size * (2.0 * g - 1.0)) as f32));
                let density = (f64::from(low) + range * u(7)) as f32;
                let kept = cache.get(v, || Fit { gradient, density });
                let off = (kept.gradient - gradient).abs().max_element();
                assert!(off <= gradient.abs().max_element() / 2040.0 + cache.unit, "{gradient} {}", kept.gradient);
                assert!(
                    f64::from((kept.density - density).abs()) <= range / 8180.0 + 0.01,
                    "{density} {}",
                    kept.density
                );
                assert!(density > lo || kept.density <= lo + 1e-3, "what is empty stays so: {density}");
                assert_eq!(cache.get(v, || unreachable!()), kept);
            }
        }
    }

    #[test]
    fn voxels_that_share_an_entry_are_told_apart() {
        let grid = Grid::new([1000, 1000, 5], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let volume =
            PreparedVolume::new(Arc::new(Volume::new(grid.clone(), vec![0; grid.len()])), TransferFunction::default());
        let cache = GradientCache::new(&volume, [-1024.0, 3071.0]);
        let fit = |n: usize| Fit { gradient: Vec3::new(n as f32, 0.0, 0.0), density: -700.0 };
        let at = |n: usize| [(n % 1002) as i32, (n / 1002 % 1002) as i32, (n / 1002 / 1002) as i32];
        for n in [5, 5 + (1 << CACHE_BITS), 5 + (2 << CACHE_BITS)] {
            assert_eq!(cache.get(at(n), || fit(n % 7 + 1)).gradient.x.round(), (n % 7 + 1) as f32);
        }
    }
}
