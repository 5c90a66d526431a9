//! Exact first crossings of many single rays: a distance for each cell, made once, lets a ray leap to where the wall may be.
//!
//! The results are those of [`first_crossing`](crate::space::first_crossing), which walks from cell to cell and needs no memory.

use std::array::from_fn;

use fearless_simd::Level;
use glam::DVec3;
use rayon::prelude::*;

use super::chessboard::{FAR, Outside, chessboard};
use crate::progress::Progress;
use crate::render::packets::lanes::{Padded, SPARE, Voxels};
use crate::space::PreparedVolume;
use crate::space::ray::{Segment, clip, trilinear};

/// The most voxels along an axis for which sixteen rays' positions in single precision are good enough.
const MOST_CELLS: usize = 2048;

/// Where each ray of many first crosses the wall, and the memory that this takes: a byte for each voxel.
#[derive(Clone, Debug)]
pub struct Crossings {
    pub(super) volume: PreparedVolume,
    /// For each cell from −1 on, x fastest: king's moves to the nearest one that may hold wall. A few bytes follow.
    pub(super) free: Vec<u8>,
    /// Number of cells along each axis.
    pub(super) dims: [usize; 3],
    pub(super) level: Level,
}

impl Crossings {
    /// Prepares a volume.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn new(volume: &PreparedVolume, progress: &Progress) -> crate::error::Result<Self> {
        let (data, grid) = (volume.voxels().data(), volume.voxels().grid());
        let wall = volume.transfer().iso().ceil() as i16;
        let [nx, ny, nz] = grid.dims();
        let dims = [nx + 1, ny + 1, nz + 1];
        let count = dims.iter().product();
        let mut free = vec![FAR; count + SPARE];
        free[..count].par_chunks_mut(dims[0] * dims[1]).enumerate().try_for_each(|(k, slice)| {
            progress.check()?;
            for (j, row) in slice.chunks_exact_mut(dims[0]).enumerate() {
                // Cell k − 1 lies between the voxels k − 1 and k.
                for z in k.saturating_sub(1)..(k + 1).min(nz) {
                    for y in j.saturating_sub(1)..(j + 1).min(ny) {
                        let voxels = &data[grid.index(0, y, z)..][..nx];
                        for (x, _) in voxels.iter().enumerate().filter(|v| *v.1 >= wall) {
                            (row[x], row[x + 1]) = (0, 0);
                        }
                    }
                }
            }
            Ok(())
        })?;
        progress.check()?;
        chessboard(&mut free[..count], dims, Outside::Unmarked);
        Ok(Self { volume: volume.clone(), free, dims, level: Level::new() })
    }

    /// Returns the rays from a point (world, mm).
    pub fn from(&self, origin: DVec3) -> RaysFrom<'_> {
        let grid = self.volume.voxels().grid();
        let from = grid.voxel(origin);
        let is_near =
            from.cmpge(DVec3::NEG_ONE).all() && from.cmple(DVec3::from_array(grid.dims().map(|n| n as f64))).all();
        let is_wall =
            is_near && trilinear(self.volume.voxels(), from) >= self.volume.transfer().iso() - crate::space::ray::TOUCH;
        // Sixteen rays at once need positions in single precision, and places of voxels in 32 bits.
        let is_small = grid.dims().iter().all(|&n| n <= MOST_CELLS);
        let lanes = Voxels::new(self.volume.voxels()).zip(Padded::new(&self.free));
        let lanes = lanes.filter(|_| is_small && is_near && !is_wall);
        RaysFrom { crossings: self, origin, from, is_near, is_wall, lanes }
    }

    /// Returns the distance in mm from `origin` along `direction` (world; of unit length) to the wall: 0 if the origin is in it, `None` if
    /// there is none.
    pub fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        self.from(origin).first(direction)
    }

    /// Leaps from cell to cell from `begin` on, before which there is no wall. Each leap leaves the cells that are known to be free; none
    /// moves back.
    pub(super) fn walk(&self, from: DVec3, along: DVec3, (begin, exit): (f64, f64)) -> Option<f64> {
        let segment = Segment::new(&self.volume, from, along);
        let inverse = along.recip();
        let last: [i64; 3] = from_fn(|a| self.dims[a] as i64 - 2);
        let mut cell: [i64; 3] = from_fn(|a| floor(from[a] + along[a] * begin).clamp(-1, last[a]));
        let mut t = begin;
        loop {
            let [i, j, k] = cell.map(|c| (c + 1) as usize);
            let free = self.free[i + self.dims[0] * (j + self.dims[1] * k)];
            let reach = i64::from(free.max(1)) - 1;
            let (mut next, mut axis) = (f64::INFINITY, 0);
            for a in 0..3 {
                let plane = if segment.step(a) > 0 { cell[a] + reach + 1 } else { cell[a] - reach };
                let at = if segment.step(a) == 0 { f64::INFINITY } else { (plane as f64 - from[a]) * inverse[a] };
                if at < next {
                    (next, axis) = (at, a);
                }
            }
            if free == 0
                && let Some(hit) = segment.cross(cell, t, next.min(exit))
            {
                return Some(hit.min(exit));
            }
            t = t.max(next);
            if t >= exit {
                return None;
            }
            for a in 0..3 {
                let step = segment.step(a);
                if a == axis {
                    cell[a] += step * (reach + 1);
                } else if reach > 0 && step != 0 {
                    let here = (floor(from[a] + along[a] * t)).clamp(cell[a] - reach, cell[a] + reach);
                    // Rounding must not move the walk back.
                    cell[a] = if step > 0 { here.max(cell[a]) } else { here.min(cell[a]) };
                }
            }
            if cell[axis] < -1 || cell[axis] > last[axis] {
                return None;
            }
        }
    }
}

/// Rays from one point.
#[derive(Clone, Copy, Debug)]
pub struct RaysFrom<'a> {
    pub(super) crossings: &'a Crossings,
    pub(super) origin: DVec3,
    /// The same in voxels.
    pub(super) from: DVec3,
    /// True within the volume or less than a voxel beside it.
    is_near: bool,
    pub(super) is_wall: bool,
    /// The voxels and the distances of cells, for sixteen rays at once, if they can be.
    pub(super) lanes: Option<(Voxels<'a>, Padded<'a>)>,
}

impl RaysFrom<'_> {
    /// Returns the point that they start from, world, mm.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Returns the distance in mm along `direction` (world; of unit length) to the wall, as [`Crossings::first`].
    pub fn first(&self, direction: DVec3) -> Option<f64> {
        let Self { crossings, origin, from, is_near, is_wall, .. } = *self;
        if !is_near {
            return crate::space::first_crossing(&crossings.volume, origin, direction, f64::INFINITY);
        }
        if is_wall {
            return direction.is_finite().then_some(0.0);
        }
        let grid = crossings.volume.voxels().grid();
        let along = grid.to_voxel().transform_vector3(direction);
        let (_, exit) = clip(grid.dims(), from, along).filter(|_| along.is_finite())?;
        crossings.walk(from, along, (0.0, exit))
    }
}

/// Returns the whole number at or below `x`, which is within ±2⁶².
#[inline(always)]
fn floor(x: f64) -> i64 {
    let whole = x as i64;
    whole - i64::from(x < whole as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::Stream;
    use crate::phantom::Phantom;
    use crate::space::{TransferFunction, first_crossing};

    #[test]
    fn leaps_end_where_single_steps_do() {
        let volume = Phantom::embedded(&Progress::new()).unwrap();
        let volume = PreparedVolume::new(volume.into(), TransferFunction::default());
        let crossings = Crossings::new(&volume, &Progress::new()).unwrap();
        let grid = volume.voxels().grid();
        let (mut draw, mut hits, mut inside) = (Stream::new(5, 0), 0, 0);
        for n in 0..40_000 {
            let mut within = |reach: f64| DVec3::from_array(from_fn(|_| draw.within(-reach, reach)));
            let middle = DVec3::from_array(grid.dims().map(|n| 0.5 * n as f64));
            let origin = grid.world(middle + within(0.6) * 2.0 * middle);
            let mut direction = within(1.0);
            // Along the axes, too.
            for a in (0..3).filter(|a| n % 7 == a + 1 || n % 11 == a + 1) {
                direction[a] = 0.0;
            }
            let Some(direction) = direction.try_normalize() else { continue };
            let slow = first_crossing(&volume, origin, direction, f64::INFINITY);
            let fast = crossings.first(origin, direction);
            match (slow, fast) {
                (Some(a), Some(b)) => assert!((a - b).abs() < 1e-9, "{origin} {direction}: {a} {b}"),
                (a, b) => assert_eq!(a, b, "{origin} {direction}"),
            }
            hits += usize::from(slow.is_some_and(|mm| mm > 0.0));
            inside += usize::from(slow == Some(0.0));
        }
        assert!(hits > 5000 && inside > 1000, "{hits} {inside}");
        for nowhere in [DVec3::NAN, DVec3::splat(1e30)] {
            assert_eq!(crossings.first(nowhere, DVec3::X), None);
        }
    }
}
