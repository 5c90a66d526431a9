//! Exact distances to the wall in a drawing: to the nearest wall, and along a ray.

use glam::DVec3;

use super::drawing::{Drawing, MM_PER_PIXEL};
use crate::fields::{Clearance, Clearances};

/// Side of a block of pixels. Each block records whether it contains any wall.
const BLOCK: usize = 8;

/// The walls of a drawing: every dark pixel is a closed square of wall, and everything beyond the border is wall.
#[derive(Clone, Debug)]
pub struct Walls {
    drawing: Drawing,
    /// Number of blocks in a row, and for each block, true if it contains a wall pixel.
    blocks: (usize, Vec<bool>),
    limit: f64,
}

impl Walls {
    /// Creates the walls of a drawing, searched for within `limit_mm`.
    pub fn new(drawing: Drawing, limit_mm: f64) -> Self {
        let (bw, bh) = (drawing.width().div_ceil(BLOCK), drawing.height().div_ceil(BLOCK));
        let mut blocks = vec![false; bw * bh];
        for (n, _) in drawing.lumen().iter().enumerate().filter(|(_, lumen)| !**lumen) {
            blocks[n % drawing.width() / BLOCK + bw * (n / drawing.width() / BLOCK)] = true;
        }
        Self { drawing, blocks: (bw, blocks), limit: limit_mm }
    }

    /// Returns the drawing.
    pub fn drawing(&self) -> &Drawing {
        &self.drawing
    }

    /// Returns true if a position (mm) is in the lumen.
    pub fn is_lumen(&self, at: DVec3) -> bool {
        let u = (at / MM_PER_PIXEL).floor();
        // Reject positions far outside and NaN before they become an index.
        u.abs().max_element() < 1e9 && u.is_finite() && self.drawing.is_lumen(u.x as i64, u.y as i64)
    }

    /// Returns the exact distance (mm) from a position (mm) to where a ray first enters a wall pixel.
    ///
    /// `direction` is a unit vector in the plane. Returns `None` if there is no wall within `reach_mm`, and 0 in the
    /// wall. Pixels are visited in the order in which the ray passes through them (Amanatides and Woo, *A fast voxel
    /// traversal algorithm for ray tracing*, 1987).
    pub fn crossing(&self, at: DVec3, direction: DVec3, reach_mm: f64) -> Option<f64> {
        if !self.is_lumen(at) {
            return Some(0.0);
        }
        let origin = [at.x / MM_PER_PIXEL, at.y / MM_PER_PIXEL];
        let d = [direction.x, direction.y];
        let mut cell = origin.map(|o| o.floor() as i64);
        let step = d.map(|d| if d > 0.0 { 1 } else { -1 });
        // Length, in pixels, to the next border across each axis, and between two borders.
        let mut next: [f64; 2] = std::array::from_fn(|a| {
            let border = if d[a] > 0.0 { cell[a] as f64 + 1.0 } else { cell[a] as f64 };
            if d[a] == 0.0 { f64::INFINITY } else { (border - origin[a]) / d[a] }
        });
        let between = d.map(|d| if d == 0.0 { f64::INFINITY } else { 1.0 / d.abs() });
        let reach = reach_mm / MM_PER_PIXEL;
        loop {
            let axis = usize::from(next[1] < next[0]);
            let length = next[axis];
            // Written so that a NaN direction also ends here.
            if length > reach || length.is_nan() {
                return None;
            }
            // At a corner the ray touches both neighbours, and either of them stops it.
            let corner = next[0] == next[1];
            let side = [cell[0] + step[0], cell[1] + step[1]];
            cell[axis] += step[axis];
            next[axis] += between[axis];
            let blocked = !self.drawing.is_lumen(cell[0], cell[1])
                || corner && !(self.drawing.is_lumen(side[0], cell[1]) && self.drawing.is_lumen(cell[0], side[1]));
            if blocked {
                return Some(length.max(0.0) * MM_PER_PIXEL);
            }
        }
    }

    /// Returns the squared distance to the nearest point of a wall pixel within the limit, and its offset from `u`, in pixels.
    fn nearest(&self, u: [f64; 2]) -> (f64, [f64; 2]) {
        let limit = self.limit / MM_PER_PIXEL;
        let (w, h) = (self.drawing.width() as f64, self.drawing.height() as f64);
        let mut best = (limit * limit, [0.0; 2]);
        let mut offer = |o: [f64; 2]| {
            let d2 = o[0] * o[0] + o[1] * o[1];
            if d2 < best.0 {
                best = (d2, o);
            }
        };
        for o in [[-u[0], 0.0], [w - u[0], 0.0], [0.0, -u[1]], [0.0, h - u[1]]] {
            offer(o);
        }
        let (bw, blocks) = &self.blocks;
        let bh = blocks.len() / bw;
        let home = [u[0] as usize / BLOCK, u[1] as usize / BLOCK];
        for ring in 0..=(*bw).max(bh) {
            // Everything in this ring of blocks around the point's block is at least this far away.
            let away = (ring as f64 - 1.0) * BLOCK as f64;
            if away > 0.0 && away * away >= best.0 {
                break;
            }
            let around = |c: usize, n: usize| c.saturating_sub(ring)..(c + ring + 1).min(n);
            for by in around(home[1], bh) {
                for bx in around(home[0], *bw) {
                    let on_ring = bx.abs_diff(home[0]).max(by.abs_diff(home[1])) == ring;
                    if on_ring && blocks[bx + bw * by] {
                        self.scan(u, [bx, by], &mut best);
                    }
                }
            }
        }
        best
    }

    fn scan(&self, u: [f64; 2], block: [usize; 2], best: &mut (f64, [f64; 2])) {
        let (w, h) = (self.drawing.width(), self.drawing.height());
        let gap = |n: usize, x: f64| (n as f64 - x).max(0.0) + (n as f64 + 1.0 - x).min(0.0);
        for j in block[1] * BLOCK..((block[1] + 1) * BLOCK).min(h) {
            let y = gap(j, u[1]);
            if y * y >= best.0 {
                continue;
            }
            for i in block[0] * BLOCK..((block[0] + 1) * BLOCK).min(w) {
                let x = gap(i, u[0]);
                if x * x + y * y < best.0 && !self.drawing.lumen()[i + w * j] {
                    *best = (x * x + y * y, [x, y]);
                }
            }
        }
    }
}

impl Clearances for Walls {
    fn clearance(&self, at: DVec3) -> Clearance {
        if !self.is_lumen(at) {
            return Clearance { mm: 0.0, toward: DVec3::ZERO };
        }
        let (d2, offset) = self.nearest([at.x / MM_PER_PIXEL, at.y / MM_PER_PIXEL]);
        let toward = DVec3::new(offset[0], offset[1], 0.0).normalize_or_zero();
        Clearance { mm: d2.sqrt() * MM_PER_PIXEL, toward }
    }
}

#[cfg(test)]
mod tests {
    use crate::render::ImageSize;
    use proptest::prelude::*;

    use super::*;

    fn drawn(lumen: &[bool], w: usize) -> Walls {
        Walls::new(Drawing::new("d", ImageSize::new(w, lumen.len() / w), lumen.to_vec()).unwrap(), 30.0)
    }

    #[test]
    fn a_square_room() {
        let room: Vec<bool> = (0..400).map(|n| (2..18).contains(&(n % 20)) && (2..18).contains(&(n / 20))).collect();
        let w = drawn(&room, 20);
        let c = w.clearance(DVec3::new(2.0, 5.0, 0.0));
        assert!((c.mm - 1.0).abs() < 1e-12 && c.toward == DVec3::NEG_X);
        assert_eq!(w.crossing(DVec3::new(2.0, 5.0, 0.0), DVec3::X, 99.0), Some(7.0));
        assert_eq!(w.crossing(DVec3::new(2.0, 5.0, 0.0), DVec3::X, 6.9), None);
        for p in [DVec3::ZERO, DVec3::NAN, DVec3::splat(-1e300), DVec3::splat(1e300), DVec3::new(0.9, 5.0, 0.0)] {
            assert_eq!((w.clearance(p).mm, w.crossing(p, DVec3::X, 9.0)), (0.0, Some(0.0)), "{p}");
        }
        assert_eq!(w.crossing(DVec3::splat(5.0), DVec3::NAN, 9.0), None);
    }

    #[test]
    fn no_ray_slips_between_two_pixels_that_touch_at_a_corner() {
        // A checkerboard of four: the diagonal passes through its centre.
        let mut room = vec![true; 64];
        (room[3 + 8 * 4], room[4 + 8 * 3]) = (false, false);
        let w = drawn(&room, 8);
        let hit = w.crossing(DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, 1.0, 0.0).normalize(), 20.0).unwrap();
        assert!((hit - 2f64.sqrt()).abs() < 1e-9, "{hit}");
    }

    proptest! {
        /// Compares with every pixel, and checks that a ray never passes closer to a wall than the clearance.
        #[test]
        fn clearance_is_the_brute_force_distance(bits in prop::collection::vec(prop::bool::weighted(0.93), 24 * 31), x in 0.0f64..12.0, y in 0.0f64..15.5, angle in 0.0f64..std::f64::consts::TAU) {
            prop_assume!(bits.contains(&true) && bits.contains(&false));
            let w = drawn(&bits, 24);
            let p = DVec3::new(x, y, 0.0);
            let brute = (0..bits.len()).filter(|n| !bits[*n]).map(|n| {
                let low = DVec3::new((n % 24) as f64, (n / 24) as f64, 0.0) * MM_PER_PIXEL;
                (p.clamp(low, low + DVec3::new(MM_PER_PIXEL, MM_PER_PIXEL, 0.0)) - p).length()
            }).fold(x.min(y).min(12.0 - x).min(15.5 - y), f64::min);
            let c = w.clearance(p);
            prop_assert!((c.mm - brute).abs() < 1e-9, "{} for {brute}", c.mm);
            let d = DVec3::new(angle.cos(), angle.sin(), 0.0);
            let ray = w.crossing(p, d, 99.0).unwrap();
            prop_assert!(ray >= c.mm - 1e-9);
            let (before, beyond) = (p + d * (ray - 1e-6).max(0.0), p + d * (ray + 1e-6));
            prop_assert!(ray == 0.0 || w.is_lumen(before) && w.clearance(beyond).mm < 1e-5);
        }
    }
}
