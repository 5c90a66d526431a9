//! Numbers of places that are slow to find, remembered.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU16, Ordering};

use glam::DVec3;

use crate::volume::Grid;

/// Side of a brick, places.
const SIDE: usize = 16;
/// A place without a label yet.
const UNKNOWN: u16 = u16::MAX;

type Brick = Box<[AtomicU16]>;

/// Remembers a number, a label for short, for each cube of a voxel or of a share of it: that of its middle, whoever asks first. So the
/// labels do not depend on the order of questions. Memory is taken where questions are.
#[derive(Debug)]
pub(super) struct Lattice {
    grid: Grid,
    /// Cubes along an axis of a voxel.
    per_voxel: usize,
    bricks: [usize; 3],
    known: Vec<OnceLock<Brick>>,
}

impl Lattice {
    /// Creates one for a scan's grid with so many cubes along each axis of a voxel.
    pub(super) fn new(grid: &Grid, per_voxel: usize) -> Self {
        let bricks = grid.dims().map(|n| (n * per_voxel).div_ceil(SIDE));
        let known = std::iter::repeat_with(OnceLock::new).take(bricks.iter().product()).collect();
        Self { grid: grid.clone(), per_voxel, bricks, known }
    }

    /// Returns the label at a place (world, mm, and the same in voxels), below 65,535: what `find` returns for the middle of its cube.
    #[inline(always)]
    pub(super) fn label(&self, place: DVec3, voxel: [f64; 3], find: &mut dyn FnMut(DVec3) -> u16) -> u16 {
        let at = voxel.map(|v| (v + 0.5) * self.per_voxel as f64);
        // Whole numbers of what is not negative need no rounding downwards; what is no number is no cube either.
        let is_in = |a: usize| at[a] >= 0.0 && at[a] < (self.bricks[a] * SIDE) as f64;
        if !(is_in(0) && is_in(1) && is_in(2)) {
            return find(place);
        }
        let cube = at.map(|c| c as u32 as usize);
        let [i, j, k] = cube.map(|c| c / SIDE);
        let brick = &self.known[i + self.bricks[0] * (j + self.bricks[1] * k)];
        let [x, y, z] = cube.map(|c| c % SIDE);
        let own = x + SIDE * (y + SIDE * z);
        let known = brick.get().map_or(UNKNOWN, |brick| brick[own].load(Ordering::Relaxed));
        if known == UNKNOWN { self.ask(brick, own, cube, find) } else { known }
    }

    /// Finds the label of a cube, number `own` of its brick.
    #[inline(never)]
    fn ask(&self, brick: &OnceLock<Brick>, own: usize, cube: [usize; 3], find: &mut dyn FnMut(DVec3) -> u16) -> u16 {
        let brick = brick.get_or_init(|| (0..SIDE * SIDE * SIDE).map(|_| AtomicU16::new(UNKNOWN)).collect());
        let middle = (DVec3::from_array(cube.map(|c| c as f64)) + 0.5) / self.per_voxel as f64 - 0.5;
        let found = find(self.grid.world(middle)).min(UNKNOWN - 1);
        brick[own].store(found, Ordering::Relaxed);
        found
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    #[test]
    fn a_cube_has_the_label_of_its_middle_whoever_asks() {
        let grid = Grid::new([20, 10, 10], DVec3::new(0.7, 0.7, 1.0), DVec3::splat(-3.0), DMat3::IDENTITY).unwrap();
        let label = |p: DVec3| if p.x > 2.0 { 7 } else { 3 };
        let asked = std::cell::Cell::new(0);
        let lattice = Lattice::new(&grid, 2);
        let ask = |p: DVec3| {
            lattice.label(p, grid.voxel(p).to_array(), &mut |middle| {
                asked.set(asked.get() + 1);
                label(middle)
            })
        };
        for n in 0..200 {
            let p = DVec3::new(-3.0 + 0.05 * f64::from(n), 0.1, 0.1);
            assert!(ask(p) == label(p) || (p.x - 2.0).abs() <= 0.175, "{p}");
            assert_eq!(ask(p), ask(p));
        }
        assert!(asked.get() < 40, "{} questions", asked.get());
        assert_eq!(ask(DVec3::splat(1e6)), 7, "outside nothing is remembered");
    }
}
