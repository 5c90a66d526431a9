//! Trilinear samples at even steps along a line of voxel coordinates, sixteen at once.

use fearless_simd::{Simd, f32x16, i32x16, mask32x16, prelude::*};
use glam::DVec3;

use super::near::Copied;
use crate::render::packets::lanes::{Corners, Voxels};
use crate::volume::{AIR_HU, Volume};

/// Number of samples taken at once.
pub(super) const LANES: usize = 16;
/// The longest step along an axis, voxels, up to which sixteen samples are taken in single precision. They are then
/// exact to 1e-5 voxels.
const LONGEST_STEP: f64 = 8.0;
/// The number of each lane.
const NUMBERS: [f32; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];
/// A mask with a bit for each lane.
pub(super) const ALL: u64 = (1 << LANES) - 1;

/// A scan to sample. A voxel reaches half its size beyond its centre, and the outermost voxels keep their value there.
/// Positions farther out are outside.
pub(super) struct Sampler<'a> {
    volume: &'a Volume,
    /// Its voxels, or a box of them in which all samples are.
    voxels: Option<Voxels<'a>>,
    /// The first of these.
    first: DVec3,
    /// Voxels along each axis of the scan.
    dims: [f64; 3],
    /// A position is in it from the first on, and below the second.
    bounds: [[f64; 2]; 3],
    /// What lies over a box of its voxels, and the first voxel of that.
    patch: Option<(Box<Self>, DVec3)>,
}

impl<'a> Sampler<'a> {
    pub(super) fn new(volume: &'a Volume) -> Self {
        let dims = volume.grid().dims().map(|n| n as f64);
        let bounds = dims.map(|d| [-0.5, d - 0.5]);
        Self { volume, voxels: Voxels::new(volume), first: DVec3::ZERO, dims, bounds, patch: None }
    }

    /// Like [`Sampler::new`], for `pixels` samples at most of which none is beyond the voxel coordinates `span`: it reads a copy of the
    /// voxels there if that is faster.
    pub(super) fn within(volume: &'a Volume, span: [DVec3; 2], pixels: usize, copied: &'a mut Copied) -> Self {
        match copied.around(volume, span, pixels) {
            Some((voxels, first)) => Self { voxels: Some(voxels), first, ..Self::new(volume) },
            None => Self::new(volume),
        }
    }

    /// Lays other values over a box of its voxels: `patch` is on the same grid, with fewer voxels. Between the box and the voxels beside
    /// it the values are those of the scan. `over` samples it.
    pub(super) fn with_patch(mut self, mut over: Self) -> Self {
        let first = self.patch_at(over.volume);
        for a in 0..3 {
            let (low, end) = (first[a], first[a] + over.dims[a]);
            over.bounds[a] = [
                if low <= 0.0 { -0.5 } else { 0.0 },
                if end >= self.dims[a] { over.dims[a] - 0.5 } else { over.dims[a] - 1.0 },
            ];
        }
        self.patch = Some((Box::new(over), first));
        self
    }

    /// Returns the scan's voxel at which a patch begins.
    pub(super) fn patch_at(&self, patch: &Volume) -> DVec3 {
        self.volume.grid().voxel(patch.grid().origin()).round()
    }

    /// Returns the HU at the positions `start + step · i`, i from 0 to 15, in voxel coordinates, and a bit for each
    /// that is in the scan. Values outside the scan are arbitrary but finite.
    #[inline(always)]
    pub(super) fn sixteen<S: Simd>(&self, simd: S, start: DVec3, step: DVec3) -> (f32x16<S>, u64) {
        let (hu, inside) = self.own(simd, start, step);
        let Some((patch, first)) = &self.patch else { return (hu, inside) };
        let (over, covered) = patch.own(simd, start - *first, step);
        (lanes(simd, covered).select(over, hu), inside)
    }

    /// As [`Sampler::sixteen`], without what lies over it.
    #[inline(always)]
    fn own<S: Simd>(&self, simd: S, start: DVec3, step: DVec3) -> (f32x16<S>, u64) {
        let last = start + step * (LANES - 1) as f64;
        // The two ends decide for the whole line.
        let mut within = true;
        for a in 0..3 {
            let [begin, end] = self.bounds[a];
            if (start[a] < begin && last[a] < begin) || (start[a] >= end && last[a] >= end) {
                return (f32x16::splat(simd, 0.0), 0);
            }
            within &= start[a] >= begin && start[a] < end && last[a] >= begin && last[a] < end;
        }
        let inside = if within { ALL } else { self.inside(start, step) };
        // False for NaN.
        let is_fine = step.abs().max_element() <= LONGEST_STEP && !step.is_nan();
        match &self.voxels {
            Some(voxels) if is_fine => (self.between(simd, voxels, start - self.first, step), inside),
            _ => (f32x16::load_array_ref(simd, &self.one_by_one(start, step)), inside),
        }
    }

    /// Returns a bit for each of the positions that is in the scan.
    #[inline(never)]
    fn inside(&self, start: DVec3, step: DVec3) -> u64 {
        let is_in = |i: usize| {
            let at = start + step * i as f64;
            // False for NaN.
            (0..3).all(|a| at[a] >= self.bounds[a][0] && at[a] < self.bounds[a][1])
        };
        (0..LANES).map(|i| u64::from(is_in(i)) << i).sum()
    }

    /// Returns the values at positions on a line near the voxels, counted from their first. Positions outside take the value of the nearest
    /// position within.
    #[inline(always)]
    fn between<S: Simd>(&self, simd: S, voxels: &Voxels<'_>, start: DVec3, step: DVec3) -> f32x16<S> {
        let lane = f32x16::load_array_ref(simd, &NUMBERS);
        let (mut cell, mut share) = ([i32x16::splat(simd, 0); 3], [lane; 3]);
        let last = voxels.last();
        for a in 0..3 {
            // Relative to the first position's cell, single precision is enough.
            let base = start[a].floor();
            let at = lane * (step[a] as f32) + ((start[a] - base) as f32);
            let at = at.max((0.0 - base) as f32).min((f64::from(last[a]) - base) as f32);
            let low = at.floor().min((f64::from(last[a] - 1) - base) as f32);
            share[a] = at - low;
            // Counted from cell −1.
            cell[a] = low.to_int::<i32x16<S>>() + (base as i32 + 1);
        }
        let all = lane.simd_ge(0.0);
        blend(voxels.corners(simd, cell, all), share)
    }

    /// Returns the values at positions that are far apart, or in a scan of one voxel along an axis.
    #[inline(never)]
    fn one_by_one(&self, start: DVec3, step: DVec3) -> [f32; LANES] {
        std::array::from_fn(|i| value(self.volume, start + step * i as f64))
    }
}

/// Returns the trilinear HU at a voxel coordinate, or at the nearest one in the scan.
fn value(volume: &Volume, at: DVec3) -> f32 {
    let (grid, data) = (volume.grid(), volume.data());
    let dims = grid.dims();
    let (mut low, mut high, mut share) = ([0; 3], [0; 3], [0.0f32; 3]);
    for a in 0..3 {
        // 0 for NaN.
        let held = at[a].max(0.0).min((dims[a] - 1) as f64);
        low[a] = (held as usize).min(dims[a].saturating_sub(2));
        high[a] = (low[a] + 1).min(dims[a] - 1);
        share[a] = (held - low[a] as f64) as f32;
    }
    let voxel = |x: usize, y: usize, z: usize| f32::from(data[grid.index(x, y, z)]);
    let row = |y: usize, z: usize| {
        let (a, b) = (voxel(low[0], y, z), voxel(high[0], y, z));
        a + (b - a) * share[0]
    };
    let layer = |z: usize| {
        let (a, b) = (row(low[1], z), row(high[1], z));
        a + (b - a) * share[1]
    };
    let (a, b) = (layer(low[2]), layer(high[2]));
    a + (b - a) * share[2]
}

/// Interpolates between the corners like [`value`].
///
/// Weights are floats because HU are written to files here. The rounded weights of rays would be off by a quarter of an HU.
#[inline(always)]
fn blend<S: Simd>(corners: Corners<S>, share: [f32x16<S>; 3]) -> f32x16<S> {
    let [a, b, c, d] = corners;
    let (a, b) = (along_x(a, share[0]), along_x(b, share[0]));
    let (c, d) = (along_x(c, share[0]), along_x(d, share[0]));
    let near = a + (b - a) * share[1];
    let far = c + (d - c) * share[1];
    near + (far - near) * share[2]
}

/// Interpolates between the two values of each pair.
#[inline(always)]
fn along_x<S: Simd>(pair: i32x16<S>, share: f32x16<S>) -> f32x16<S> {
    let low: f32x16<S> = (pair << 16 >> 16).to_float();
    let high: f32x16<S> = (pair >> 16).to_float();
    low + (high - low) * share
}

/// Returns the lanes of `bits`.
#[inline(always)]
pub(super) fn lanes<S: Simd>(simd: S, bits: u64) -> mask32x16<S> {
    mask32x16::from_bitmask(simd, bits)
}

/// Returns [`AIR_HU`] in all lanes.
#[inline(always)]
pub(super) fn air<S: Simd>(simd: S) -> f32x16<S> {
    f32x16::splat(simd, f32::from(AIR_HU))
}

#[cfg(test)]
mod tests {
    use fearless_simd::Level;
    use glam::DMat3;

    use super::*;
    use crate::volume::Grid;

    /// Lines along the diagonal enter and leave the scan through its corners, on all axes at once.
    #[test]
    fn a_line_from_corner_to_corner_is_in_the_scan_between_them() {
        let grid = Grid::new([12; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let volume = Volume::new(grid.clone(), vec![500; grid.len()]);
        let scan = Sampler::new(&volume);
        for start in -20..32 {
            for step in [-1, 1] {
                let (from, along) = (DVec3::splat(f64::from(start)), DVec3::splat(f64::from(step)));
                let inside = fearless_simd::dispatch!(Level::new(), simd => scan.sixteen(simd, from, along).1);
                let expected: u64 = (0..16).map(|i| u64::from((0..12).contains(&(start + step * i))) << i).sum();
                assert_eq!(inside, expected, "from {start} in steps of {step}");
            }
        }
    }
}
