//! Numbers of places that are slow to find, remembered.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU16, Ordering};

use glam::DVec3;

use crate::volume::Grid;

/// Places that have one label along an axis of a voxel.
const PER_VOXEL: usize = 2;
/// Side of a brick, places.
const SIDE: usize = 16;
/// A place without a label yet.
const UNKNOWN: u16 = u16::MAX;

type Brick = Box<[AtomicU16]>;

/// Remembers a number, a label for short, for each cube of half a voxel: that of its middle, whoever asks first. So the labels do not depend on the order of
/// questions. Memory is taken where questions are.
#[derive(Debug)]
pub(super) struct Lattice {
    grid: Grid,
    bricks: [usize; 3],
    known: Vec<OnceLock<Brick>>,
}

impl Lattice {
    /// Creates one for a scan's grid.
    pub(super) fn new(grid: &Grid) -> Self {
        let bricks = grid.dims().map(|n| (n * PER_VOXEL).div_ceil(SIDE));
        let known = std::iter::repeat_with(OnceLock::new).take(bricks.iter().product()).collect();
        Self { grid: grid.clone(), bricks, known }
    }

    /// Returns the label at a place (world, mm), below 65,535: what `find` returns for the middle of its cube.
    pub(super) fn label(&self, place: DVec3, find: &mut dyn FnMut(DVec3) -> u16) -> u16 {
        let at = (self.grid.voxel(place) + 0.5) * PER_VOXEL as f64;
        // Whole numbers of what is not negative need no rounding downwards; what is no number is no cube either.
        let last = DVec3::from_array(self.bricks.map(|n| (n * SIDE) as f64));
        if !(at.cmpge(DVec3::ZERO).all() && at.cmplt(last).all()) {
            return find(place);
        }
        let [x, y, z] = at.to_array().map(|c| c as u32 as usize);
        let [i, j, k] = [x / SIDE, y / SIDE, z / SIDE];
        let brick = &self.known[i + self.bricks[0] * (j + self.bricks[1] * k)];
        let brick = brick.get_or_init(|| (0..SIDE * SIDE * SIDE).map(|_| AtomicU16::new(UNKNOWN)).collect());
        let own = &brick[x % SIDE + SIDE * (y % SIDE + SIDE * (z % SIDE))];
        let known = own.load(Ordering::Relaxed);
        if known != UNKNOWN {
            return known;
        }
        let middle = (DVec3::new(x as f64, y as f64, z as f64) + 0.5) / PER_VOXEL as f64 - 0.5;
        let found = find(self.grid.world(middle)).min(UNKNOWN - 1);
        own.store(found, Ordering::Relaxed);
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
        let lattice = Lattice::new(&grid);
        let ask = |p: DVec3| {
            lattice.label(p, &mut |middle| {
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
