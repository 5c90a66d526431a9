//! Thin walls: what lies between one part of the lumen and another.

use glam::DVec3;

use super::block::{Block, Mask};
use crate::fields::lumen::residue::LINES;

/// Finds what lies between two parts of a lumen that are a little apart.
#[derive(Clone, Debug)]
pub(super) struct Slabs {
    lines: Vec<Line>,
    /// Maximum thickness, mm.
    mm: f64,
}

impl Slabs {
    /// Slabs thinner than `mm`, for voxels with this spacing.
    pub(super) fn new(spacing: DVec3, mm: f64) -> Self {
        let line = |step: [i64; 3]| {
            let length = (DVec3::from_array(step.map(|s| s as f64)) * spacing).length();
            Line { step, mm: length, steps: (mm / length).ceil() as usize + 1 }
        };
        Self { lines: LINES.map(line).to_vec(), mm }
    }

    /// True if the voxel at an index of a block has the lumen on both sides, on one of thirteen lines.
    pub(super) fn is_within(&self, block: &Block, lumen: &Mask, n: usize) -> bool {
        self.across(block, lumen, n).next().is_some()
    }

    /// Returns the lines on which the voxel at an index of a block has the lumen on both sides: the indices from one side to the other,
    /// and the distance from one to the next, mm.
    pub(super) fn across<'a>(
        &'a self,
        block: &Block,
        lumen: &'a Mask,
        n: usize,
    ) -> impl Iterator<Item = (impl Iterator<Item = usize> + Clone, f64)> + 'a {
        let (block, strides) = (*block, block.strides());
        self.lines.iter().filter_map(move |line| {
            let offset = line.offset(&strides);
            let steps = line.steps.min(line.within(&block, n));
            let at = move |m: isize| n.wrapping_add_signed(m * offset);
            let side = |sign: isize| (1..steps as isize).find(|&m| lumen.has(at(sign * m)));
            let (a, b) = side(1).zip(side(-1))?;
            ((a + b) as f64 * line.mm < self.mm).then(|| ((-b..=a).map(at), line.mm))
        })
    }
}

/// A line through a voxel and its neighbours.
#[derive(Clone, Copy, Debug)]
struct Line {
    step: [i64; 3],
    /// Length of a step, mm.
    mm: f64,
    /// Number of steps that exceeds the thickness of a slab.
    steps: usize,
}

impl Line {
    /// Returns the distance of two neighbours on it in a block with these strides.
    fn offset(&self, strides: &[usize; 3]) -> isize {
        (0..3).map(|a| self.step[a] as isize * strides[a] as isize).sum()
    }

    /// Returns the number of steps to either side of a voxel that stay within a block, plus one.
    fn within(&self, block: &Block, n: usize) -> usize {
        let strides = block.strides();
        let room = |a: usize| {
            let at = n / strides[a] % block.dims[a];
            at.min(block.dims[a] - 1 - at) + 1
        };
        (0..3).filter(|&a| self.step[a] != 0).map(room).min().unwrap_or(1)
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::fields::cleanse::block::Bricks;
    use crate::fields::lumen::runs::{Rows, Run};
    use crate::volume::Grid;

    /// Walls of some thickness across x and across a diagonal.
    #[test]
    fn thin_walls_are_slabs_and_thick_ones_and_those_beside_tissue_are_not() {
        let grid = Grid::new([32, 16, 16], DVec3::new(0.7, 0.7, 0.8), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let slabs = Slabs::new(grid.spacing(), 3.0);
        for (wall, is_slab) in [(10..12, true), (10..13, true), (10..14, false), (10..32, false)] {
            let runs = [0..wall.start, wall.end..32].into_iter().filter(|r| !r.is_empty());
            let row: Vec<Run> = runs.map(|r| Run { start: r.start, end: r.end, label: 0 }).collect();
            let slices = (0..16).map(|_| (vec![row.len() as u32; 16], row.repeat(16))).collect();
            let rows = Rows::from_slices(grid.dims(), slices).unwrap();
            let block = Bricks::of(&grid).block(0, [0; 3]);
            let lumen = block.mask(&rows, |_| true);
            let n = block.index([11, 8, 8]);
            assert_eq!(slabs.is_within(&block, &lumen, n), is_slab, "{wall:?}");
            // At the block's edge nothing is known beyond it.
            let edge = block.index([11, 0, 0]);
            assert_eq!(slabs.is_within(&block, &lumen, edge), is_slab, "{wall:?} at the edge");
        }
    }
}
