//! Smooth random numbers that are fixed in space.

use glam::{Vec3, Vec4};

use super::lanes::{LANES, Lanes};
use crate::math::hash;

/// Side of the lattice, after which the numbers repeat.
const SIDE: usize = 32;
/// Coordinates are kept within this, so that cells have numbers in single precision.
pub(super) const MOST: f32 = 1e5;
/// Added to a number below 2²², it leaves the nearest whole number in the last bits. That takes a fifth of the time of a cast, which
/// looks for overflows.
const MAGIC: f32 = 12_582_912.0;

/// Returns the whole number below `x` modulo a power of two, and what `x` has more, 0 to 1. Just at a whole number it may be the one
/// below and 1: interpolation does not mind.
#[inline(always)]
pub(super) fn split(x: f32, modulo: usize) -> (usize, f32) {
    let (whole, more) = split_32(x, modulo as u32);
    (whole as usize, more)
}

/// Does the same with 32 bits: several at once.
#[inline(always)]
pub(super) fn split_32(x: f32, modulo: u32) -> (u32, f32) {
    let whole = x - 0.5 + MAGIC;
    (whole.to_bits() & (modulo - 1), x - (whole - MAGIC))
}

/// Numbers at the corners of a lattice.
type Lattice = [[[Vec4; SIDE]; SIDE]; SIDE];

/// Four random fields in space: value noise (Lagae et al., A Survey of Procedural Noise Functions, 2010, section 3), from a table
/// because hashing eight corners takes longer than reading them.
#[derive(Debug)]
pub(super) struct Noise(Box<Lattice>);

impl Noise {
    /// Creates the fields of a seed.
    pub(super) fn new(seed: u64) -> Self {
        let number = |n: usize| 2.0 * hash::uniform(seed, n as u64) as f32 - 1.0;
        let mut all: Box<Lattice> = Box::new([[[Vec4::ZERO; SIDE]; SIDE]; SIDE]);
        let corners = all.as_flattened_mut().as_flattened_mut();
        for (n, corner) in corners.iter_mut().enumerate() {
            *corner = Vec4::from_array([0, 1, 2, 3].map(|k| number(4 * n + k)));
        }
        Self(all)
    }

    /// Returns the first three numbers at sixteen points, as [`Noise::at`].
    #[inline(always)]
    pub(super) fn sixteen(&self, points: &[Lanes; 3]) -> [Lanes; 3] {
        let (mut cells, mut shares) = ([[0; LANES]; 3], [[0.0; LANES]; 3]);
        for ((points, cells), shares) in points.iter().zip(&mut cells).zip(&mut shares) {
            for k in 0..LANES {
                let (cell, t) = split_32(points[k].clamp(-MOST, MOST), SIDE as u32);
                (cells[k], shares[k]) = (cell, t * t * (3.0 - 2.0 * t));
            }
        }
        let mut out = [[0.0; LANES]; 3];
        for k in 0..LANES {
            let found = self.between([0, 1, 2].map(|a| cells[a][k] as usize), [0, 1, 2].map(|a| shares[a][k]));
            (out[0][k], out[1][k], out[2][k]) = (found.x, found.y, found.z);
        }
        out
    }

    /// Returns the four numbers at a point, −1 to 1. Its unit is the distance over which they change; they repeat after 32 units. Finite
    /// for every finite point.
    #[inline(always)]
    pub(super) fn at(&self, point: Vec3) -> Vec4 {
        let point = point.clamp(Vec3::splat(-MOST), Vec3::splat(MOST));
        let [(i, x), (j, y), (k, z)] = [point.x, point.y, point.z].map(|x| split(x, SIDE));
        self.between([i, j, k], [x, y, z].map(|t| t * t * (3.0 - 2.0 * t)))
    }

    /// Returns the numbers between the corners of a cell.
    #[inline(always)]
    fn between(&self, [i, j, k]: [usize; 3], [x, y, z]: [f32; 3]) -> Vec4 {
        // Cells are below the side already: that keeps checks of bounds out.
        let [i, j, k] = [i, j, k].map(|n| n & (SIDE - 1));
        let [right, down, deep] = [i, j, k].map(|n| (n + 1) & (SIDE - 1));
        let row = |row: &[Vec4; SIDE]| row[i] + (row[right] - row[i]) * x;
        let plane = |plane: &[[Vec4; SIDE]; SIDE]| {
            let (a, b) = (row(&plane[j]), row(&plane[down]));
            a + (b - a) * y
        };
        let (a, b) = (plane(&self.0[k]), plane(&self.0[deep]));
        a + (b - a) * z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_smooth_and_their_mean_is_nothing() {
        let noise = Noise::new(3);
        let mut sum = Vec4::ZERO;
        for n in 0..40_000 {
            let p = Vec3::new(n as f32 * 0.013 - 200.0, n as f32 * 0.0071, 33.3 - n as f32 * 0.0033);
            let (a, b) = (noise.at(p), noise.at(p + Vec3::splat(0.01)));
            assert!(a.abs().max_element() < 1.001 && (a - b).abs().max_element() < 0.1);
            sum += a;
        }
        assert!((sum / 40_000.0).abs().max_element() < 0.05, "{sum}");
        assert!(noise.at(Vec3::splat(1e30)).is_finite() && noise.at(Vec3::splat(f32::MIN)).is_finite());
    }
}
