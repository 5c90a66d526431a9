//! Which point of a line each place of the lumen belongs to.

use std::ops::Range;

use glam::DVec3;

use super::cells::{Cells, Shape};
use crate::error::Result;
use crate::fields::WallDistance;
use crate::progress::Progress;
use crate::volume::Grid;

/// The cells of a lumen that lead to lines through it, each with the point of a line that it belongs to.
#[derive(Clone, Debug)]
pub(in crate::fields) struct NearestOnLines {
    grid: Grid,
    shape: Shape,
    /// Cells along each axis.
    dims: [usize; 3],
    /// In the order of their cells, x fastest.
    pieces: Vec<Piece>,
    /// The first piece of each row of cells, and the number of pieces.
    rows: Vec<u32>,
}

/// A connected piece of the lumen within a cell.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// The cell's voxels that belong to it, x fastest.
    mask: u64,
    /// The first voxel of the cell along x.
    x: u32,
    /// The line, and its point.
    of: (u32, u32),
}

impl NearestOnLines {
    /// Gives each cell of the lumen the point from which the way through the lumen is shortest, of all points of all `lines` (world,
    /// mm): by Dijkstra's algorithm over the cells' widest places, so to about half a cell. The distances are dropped as soon as they are not
    /// needed, and are as large as all the rest.
    pub(in crate::fields) fn new(
        walls: WallDistance,
        mut cells: Cells,
        lines: &[&[DVec3]],
        progress: &Progress,
    ) -> Result<Self> {
        cells.link(&walls, 0.0);
        let mut of: Vec<Option<(f64, (u32, u32))>> = vec![None; cells.nodes.len()];
        for (l, line) in lines.iter().enumerate() {
            for (p, &at) in line.iter().enumerate() {
                let Some(n) = cells.node_at(walls.voxel(at)) else { continue };
                let mm = cells.place(n).distance(at);
                if of[n as usize].is_none_or(|(least, _)| mm < least) {
                    of[n as usize] = Some((mm, (l as u32, p as u32)));
                }
            }
        }
        let grid = walls.grid().clone();
        drop(walls);
        colvis_scan::memory::release();
        progress.check()?;
        let starts: Vec<(u32, f64)> = (0..).zip(&of).filter_map(|(n, of)| Some((n, of.as_ref()?.0))).collect();
        let roots = cells.roots(&starts);
        drop(starts);
        let (shape, dims) = cells.shape();
        let pieces = Vec::with_capacity(roots.iter().flatten().count());
        let mut out = Self { grid, shape, dims, pieces, rows: vec![0; dims[1] * dims[2] + 1] };
        for (node, root) in cells.nodes.iter().zip(roots) {
            let Some((_, of)) = root.and_then(|r| of[r as usize]) else { continue };
            let (corner, mask) = node.voxels();
            let [_, j, k] = [0, 1, 2].map(|a| corner[a] as usize / shape.side[a]);
            out.rows[j + dims[1] * k + 1] += 1;
            out.pieces.push(Piece { mask, x: corner[0] as u32, of });
        }
        for n in 1..out.rows.len() {
            out.rows[n] += out.rows[n - 1];
        }
        Ok(out)
    }

    /// Returns the line and its point that the lumen nearest to a place (world, mm) belongs to, if a middle of its voxels is within
    /// `most_mm`.
    pub(in crate::fields) fn of(&self, world: DVec3, most_mm: f64) -> Option<(u32, u32)> {
        if self.pieces.is_empty() || !world.is_finite() {
            return None;
        }
        let at = self.grid.voxel(world);
        // First among the cells around it: whatever is farther away lies outside of these.
        let extent = (0..3).map(|a| self.shape.side[a] as f64 * self.grid.spacing()[a]);
        let near = extent.fold(most_mm, f64::min);
        self.nearest(at, near).or_else(|| self.nearest(at, most_mm))
    }

    /// Returns what the nearest voxel within `most_mm` of a place (voxels) belongs to; of equal ones the first.
    fn nearest(&self, at: DVec3, most_mm: f64) -> Option<(u32, u32)> {
        let spacing = self.grid.spacing();
        let range = |a: usize| -> Range<usize> {
            let side = self.shape.side[a] as f64;
            let reach = most_mm / spacing[a];
            // The cast saturates.
            let [low, high] = [at[a] - reach, at[a] + reach].map(|v| (v / side).floor());
            low.max(0.0) as usize..((high + 1.0).max(0.0) as usize).min(self.dims[a])
        };
        let xs = range(0);
        let first = (xs.start * self.shape.side[0]) as u32..(xs.end * self.shape.side[0]) as u32;
        let (mut least, mut found) = (most_mm * most_mm, None);
        for (k, j) in range(2).flat_map(|k| range(1).map(move |j| (k, j))) {
            let [y, z] = [j * self.shape.side[1], k * self.shape.side[2]];
            let row = j + self.dims[1] * k;
            let row = &self.pieces[self.rows[row] as usize..self.rows[row + 1] as usize];
            for piece in &row[row.partition_point(|p| p.x < first.start)..] {
                if piece.x >= first.end {
                    break;
                }
                let corner = DVec3::new(f64::from(piece.x), y as f64, z as f64);
                let last = corner + DVec3::from_array(self.shape.side.map(|s| (s - 1) as f64));
                if ((at - at.clamp(corner, last)) * spacing).length_squared() > least {
                    continue;
                }
                let mut mask = piece.mask;
                while mask != 0 {
                    let offset = self.shape.offset(mask.trailing_zeros() as usize).map(|v| v as f64);
                    let square = ((corner + DVec3::from_array(offset) - at) * spacing).length_squared();
                    if square < least || (found.is_none() && square <= least) {
                        (least, found) = (square, Some(piece.of));
                    }
                    mask &= mask - 1;
                }
            }
        }
        found
    }

    /// Returns the size in memory, bytes.
    pub(in crate::fields) fn bytes(&self) -> usize {
        size_of_val(self.pieces.as_slice()) + size_of_val(self.rows.as_slice())
    }
}
