//! The voxels around a slice, copied next to each other.
//!
//! A scan's voxels are stored row by row, so that those of a sagittal plane lie a row's length apart, each in a line of the cache and
//! nearly each in a page of its own, and every pixel reads several of them. They are copied first, if that reads less, and with them those
//! on both sides, which lie in the same lines: a flight gets there next. Samples are the same to the bit.

use glam::DVec3;
use rayon::prelude::*;

use crate::render::packets::lanes::Voxels;
use crate::volume::Volume;

/// Memory for the voxels around a slice, kept from one picture to the next: of the scan, and of what is laid over it.
#[derive(Clone, Debug, Default)]
pub struct Near {
    pub(super) scan: Copied,
    pub(super) patch: Copied,
}

impl Near {
    /// Returns its size in memory, bytes.
    pub fn bytes(&self) -> usize {
        (self.scan.data.capacity() + self.patch.data.capacity()) * size_of::<i16>()
    }
}

/// Distances to the next voxel that single precision rounds to 0, voxels: all below this one.
const LAYER: f64 = 1e-8;
/// And none above this one.
const ROUNDED: f64 = 1e-6;

/// Voxels in a line of the cache.
const LINE: usize = 32;
/// Rows of a copy have at most so many voxels without those on both sides. Longer ones are read well where they are.
const THIN: usize = LINE / 2;
/// Voxels on each side that are copied as well.
const BESIDE: usize = 4;

/// A box of a volume's voxels.
#[derive(Clone, Debug, Default)]
pub(super) struct Copied {
    data: Vec<i16>,
    /// The values' stamp, and where the box begins; `None` if there is none.
    of: Option<(u64, [usize; 3])>,
    dims: [usize; 3],
}

impl Copied {
    /// Copies the voxels of which samples between the voxel coordinates `low` and `high` are made. Returns them, with the first one's
    /// coordinates; `None` if `pixels` samples are read faster without.
    pub(super) fn around(
        &mut self,
        volume: &Volume,
        [low, high]: [DVec3; 2],
        pixels: usize,
    ) -> Option<(Voxels<'_>, DVec3)> {
        if !(low.is_finite() && high.is_finite()) {
            return None;
        }
        let grid = volume.grid();
        let (mut first, mut end) = ([0; 3], [0; 3]);
        for a in 0..3 {
            let n = grid.dims()[a];
            // Samples lie where single precision rounds them to, which may be the next voxel. Across a plane along the axes all of them
            // are rounded alike, and what is as close to a voxel as `LAYER` is on it.
            let is_flat = high[a] - low[a] < 0.5;
            let [below, above] = if is_flat { [LAYER, ROUNDED] } else { [-1.0, 1.0] };
            let at = |v: f64| v.clamp(0.0, n as f64 - 1.0) as usize;
            // Two at least, for a sample lies between two.
            first[a] = at((low[a] + below).floor()).min(n.saturating_sub(2));
            end[a] = (at((high[a] + above).floor() + 1.0) + 1).max(first[a] + 2).min(n);
        }
        let is_held = |stamp: u64, held: [usize; 3]| {
            stamp == volume.stamp() && (0..3).all(|a| held[a] <= first[a] && end[a] <= held[a] + self.dims[a])
        };
        if !self.of.is_some_and(|(stamp, held)| is_held(stamp, held)) {
            let rows = (end[1] - first[1]) * (end[2] - first[2]);
            if end[0] - first[0] > THIN || 2 * rows > 3 * pixels {
                return None;
            }
            first[0] = first[0].saturating_sub(BESIDE);
            end[0] = (end[0] + BESIDE).min(grid.dims()[0]);
            self.copy(volume, first, [0, 1, 2].map(|a| end[a] - first[a]));
        }
        let at = self.of?.1;
        let voxels = Voxels::of(&self.data, self.dims)?;
        Some((voxels, DVec3::from_array(at.map(|n| n as f64))))
    }

    #[cfg(test)]
    pub(super) fn of(&self) -> Option<(u64, [usize; 3])> {
        self.of
    }

    fn copy(&mut self, volume: &Volume, first: [usize; 3], dims: [usize; 3]) {
        (self.of, self.dims) = (Some((volume.stamp(), first)), dims);
        self.data.resize(dims.iter().product(), 0);
        let grid = volume.grid();
        self.data.par_chunks_mut((dims[0] * dims[1]).max(1)).enumerate().for_each(|(z, layer)| {
            for (y, row) in layer.chunks_exact_mut(dims[0]).enumerate() {
                let from = grid.index(first[0], first[1] + y, first[2] + z);
                row.copy_from_slice(&volume.data()[from..from + dims[0]]);
            }
        });
    }
}
