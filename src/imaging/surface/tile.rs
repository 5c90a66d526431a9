//! A screen tile with the nearest triangle of each pixel.
//!
//! Coverage is decided by exact integer edge functions with the top-left rule (Pineda 1988), so triangles that share a
//! side leave no gap and cover no pixel twice.

use super::clip::{Corner, SUB};

/// Pixels along a tile's edge.
pub(crate) const TILE: usize = 64;
/// No triangle.
pub(crate) const NONE: u32 = u32::MAX;

/// The nearest triangle of each pixel of a tile, row by row.
pub(crate) struct Tile {
    /// The screen pixel in the tile's corner.
    left: i64,
    top: i64,
    /// Its size on the screen, pixels across and down.
    size: [usize; 2],
    /// Number of pixels without a triangle.
    open: usize,
    inverse: [f32; TILE * TILE],
    triangle: [u32; TILE * TILE],
    /// Number of depth tests.
    pub tests: u64,
}

impl Tile {
    /// Creates a tile without triangles, with its corner at the pixel (`left`, `top`) and `size` pixels on the screen.
    pub(crate) fn new(left: usize, top: usize, size: [usize; 2]) -> Self {
        let size = size.map(|n| n.min(TILE));
        Self {
            left: left as i64,
            top: top as i64,
            size,
            open: size[0] * size[1],
            inverse: [0.0; TILE * TILE],
            triangle: [NONE; TILE * TILE],
            tests: 0,
        }
    }

    /// Returns the nearest triangle in a pixel of the tile.
    pub(crate) fn triangle(&self, x: usize, y: usize) -> u32 {
        self.triangle[y * TILE + x]
    }

    /// Returns the distance (z, mm) beyond which nothing is visible. It is infinite while a pixel has no triangle.
    pub(crate) fn farthest(&self) -> f32 {
        if self.open > 0 {
            return f32::INFINITY;
        }
        let rows = self.inverse.chunks_exact(TILE).take(self.size[1]);
        1.0 / rows.flat_map(|r| &r[..self.size[0]]).fold(f32::INFINITY, |m, &i| m.min(i))
    }

    /// Draws the convex polygon of the first `n` corners of triangle `id`. Returns true if a pixel has changed.
    pub(crate) fn draw(&mut self, corners: &[Corner; 4], n: usize, id: u32) -> bool {
        let mut changed = false;
        for k in 2..n {
            changed |= self.fill([corners[0], corners[k - 1], corners[k]], id);
        }
        changed
    }

    fn fill(&mut self, mut c: [Corner; 3], id: u32) -> bool {
        let cross =
            |a: [i64; 2], b: [i64; 2], p: [i64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
        let mut area = cross(c[0].at, c[1].at, c[2].at);
        if area == 0 {
            return false;
        }
        // Both sides of the wall are drawn. A single orientation is enough for the edge functions.
        if area < 0 {
            c.swap(1, 2);
            area = -area;
        }
        // The first and last pixel of the tile whose centre may be inside.
        let range = |a: usize, first: i64| {
            let (low, high) = (c[0].at[a].min(c[1].at[a]).min(c[2].at[a]), c[0].at[a].max(c[1].at[a]).max(c[2].at[a]));
            let low = (low - SUB / 2 + SUB - 1).div_euclid(SUB) - first;
            let high = (high - SUB / 2).div_euclid(SUB) - first;
            (low.max(0), high.min(self.size[a] as i64 - 1))
        };
        let (x, y) = (range(0, self.left), range(1, self.top));
        if x.0 > x.1 || y.0 > y.1 {
            return false;
        }
        let centre = |n: i64, first: i64| (n + first) * SUB + SUB / 2;
        let start = [centre(x.0, self.left), centre(y.0, self.top)];
        // Edge k is opposite corner k.
        let sides = [(c[1].at, c[2].at), (c[2].at, c[0].at), (c[0].at, c[1].at)];
        // A pixel exactly on a side belongs to the triangle to its right or below.
        let owned = |(a, b): ([i64; 2], [i64; 2])| b[1] < a[1] || (b[1] == a[1] && b[0] > a[0]);
        let bias = sides.map(|s| i64::from(!owned(s)));
        let mut row = sides.map(|(a, b)| cross(a, b, start));
        let step = sides.map(|(a, b)| [-(b[1] - a[1]) * SUB, (b[0] - a[0]) * SUB]);
        let share = c.map(|c| c.inverse / area as f32);
        let mut changed = false;
        for j in y.0..=y.1 {
            let mut e = row;
            for i in x.0..=x.1 {
                if e[0] >= bias[0] && e[1] >= bias[1] && e[2] >= bias[2] {
                    let inverse = e[0] as f32 * share[0] + e[1] as f32 * share[1] + e[2] as f32 * share[2];
                    let at = (j as usize) * TILE + i as usize;
                    self.tests += 1;
                    if inverse > self.inverse[at] {
                        self.open -= usize::from(self.triangle[at] == NONE);
                        self.inverse[at] = inverse;
                        self.triangle[at] = id;
                        changed = true;
                    }
                }
                for k in 0..3 {
                    e[k] += step[k][0];
                }
            }
            for k in 0..3 {
                row[k] += step[k][1];
            }
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;

    #[test]
    fn a_fan_covers_every_pixel_once() {
        // Triangles around a point fill a square exactly, wherever their corners are.
        for seed in 0..200 {
            let u = |k: u64| (hash::uniform(seed, k) * (TILE as i64 * SUB) as f64) as i64;
            // Also place corners on pixel centres, where the rules decide.
            let snap = |v: i64| if seed % 2 == 0 { v / SUB * SUB + SUB / 2 } else { v };
            let middle = [snap(u(0)), snap(u(1))];
            let (lo, hi) = (-SUB, (TILE as i64 + 1) * SUB);
            let rim = [[lo, lo], [snap(u(2)), lo], [hi, lo], [hi, snap(u(3))], [hi, hi], [lo, hi], [lo, snap(u(4))]];
            let mut count = [0; TILE * TILE];
            for k in 0..rim.len() {
                let mut tile = Tile::new(0, 0, [TILE; 2]);
                let corner = |at| Corner { at, inverse: 1.0 };
                let c = [corner(middle), corner(rim[k]), corner(rim[(k + 1) % rim.len()]), corner([0, 0])];
                tile.draw(&c, 3, 7);
                for (n, t) in count.iter_mut().zip(tile.triangle) {
                    *n += i32::from(t == 7);
                }
            }
            assert!(count.iter().all(|&n| n == 1), "seed {seed}");
        }
    }

    #[test]
    fn the_nearer_triangle_wins_in_any_order() {
        let big = |inverse: [f32; 3]| {
            let at = [[-SUB, -SUB], [200 * SUB, -SUB], [-SUB, 200 * SUB]];
            let c = |k: usize| Corner { at: at[k], inverse: inverse[k] };
            [c(0), c(1), c(2), c(0)]
        };
        let draw = |order: [u32; 2]| {
            let mut tile = Tile::new(0, 0, [TILE; 2]);
            for id in order {
                tile.draw(&big(if id == 1 { [0.5; 3] } else { [0.2, 0.9, 0.9] }), 3, id);
            }
            assert!(tile.farthest().is_finite());
            tile.triangle
        };
        assert_eq!(draw([1, 2]), draw([2, 1]));
        assert_eq!(Tile::new(0, 0, [TILE; 2]).farthest(), f32::INFINITY);
    }
}
