//! Gathers neighbouring voxels, whatever a voxel is stored as.

use std::array::from_fn;

use glam::Vec4;

use crate::volume::{AIR_HU, Grid, Volume};

/// The voxels of a volume, each stored as a `V`.
#[derive(Clone, Copy)]
pub(crate) struct Voxels<'a, V> {
    pub(crate) grid: &'a Grid,
    /// x fastest, then y, then z.
    pub(crate) data: &'a [V],
    /// What every place outside the grid holds.
    pub(crate) outside: V,
}

impl<'a> Voxels<'a, i16> {
    /// The HU of a volume, with air outside.
    #[inline(always)]
    pub(crate) fn of(volume: &'a Volume) -> Self {
        Self { grid: volume.grid(), data: volume.data(), outside: AIR_HU }
    }
}

impl<V: Copy> Voxels<'_, V> {
    /// Returns a voxel, counted from voxel −1.
    #[inline(always)]
    pub(crate) fn get(&self, v: [i32; 3]) -> V {
        let dims = self.grid.dims();
        let [i, j, k] = v.map(|c| c.wrapping_sub(1) as usize);
        let inside = i < dims[0] && j < dims[1] && k < dims[2];
        if inside { self.data[self.grid.index(i, j, k)] } else { self.outside }
    }

    /// Returns the corners of a cell, counted from cell −1: x fastest, then y, then z.
    #[inline(always)]
    pub(crate) fn corners(&self, cell: [i32; 3]) -> [V; 8] {
        let dims = self.grid.dims();
        let inside = |a: usize| cell[a] >= 1 && (cell[a] as usize) < dims[a];
        if inside(0) && inside(1) && inside(2) {
            let [i, j, k] = cell.map(|c| c as usize - 1);
            let n = self.grid.index(i, j, k);
            let (row, slice) = (dims[0], dims[0] * dims[1]);
            let pair = |n: usize| self.data[n..n + 2].first_chunk().copied().unwrap_or([self.outside; 2]);
            let ([a, b], [c, d]) = (pair(n), pair(n + row));
            let ([e, f], [g, h]) = (pair(n + slice), pair(n + slice + row));
            [a, b, c, d, e, f, g, h]
        } else {
            from_fn(|n| {
                let n = n as i32;
                self.get([cell[0] + (n & 1), cell[1] + (n >> 1 & 1), cell[2] + (n >> 2)])
            })
        }
    }

    /// Returns the 4×4×4 voxels from `first` on, counted from voxel −1, as numbers: rows along x, `[z][y]`.
    #[inline(always)]
    pub(crate) fn block(&self, first: [i32; 3], number: impl Fn(V) -> f32) -> [[Vec4; 4]; 4] {
        let dims = self.grid.dims();
        let inside = |a: usize| first[a] >= 1 && first[a] as usize + 3 <= dims[a];
        if inside(0) && inside(1) && inside(2) {
            let [i, j, k] = first.map(|c| c as usize - 1);
            let n = self.grid.index(i, j, k);
            let (row, slice) = (dims[0], dims[0] * dims[1]);
            // Use loops, not closures: inside a ray's loop the optimiser may give up on closures.
            let mut all = [[Vec4::ZERO; 4]; 4];
            for (z, plane) in all.iter_mut().enumerate() {
                for (y, four) in plane.iter_mut().enumerate() {
                    let at = n + z * slice + y * row;
                    if let Some(&[a, b, c, d]) = self.data[at..at + 4].first_chunk() {
                        *four = Vec4::new(number(a), number(b), number(c), number(d));
                    }
                }
            }
            all
        } else {
            let [i, j, k] = first;
            let at = |x, y, z| number(self.get([i + x, j + y as i32, k + z as i32]));
            from_fn(|z| from_fn(|y| Vec4::new(at(0, y, z), at(1, y, z), at(2, y, z), at(3, y, z))))
        }
    }
}
