//! A bundle of rays from one point, and how far it runs through empty space.

use glam::{BVec3A, Vec3, Vec3A};

use super::occupancy::{BRICK_SHIFT, Occupancy};

/// How thick to either side a bundle may be where single cells are asked, voxels: their bits tell of one voxel around,
/// less what rounding may shift and what a step over a cell's border adds.
const THICK: f32 = 0.97;

/// Rays `origin + k · along` whose `along` lie in a box around `middle`.
pub struct Beam {
    origin: Vec3A,
    middle: Vec3A,
    /// Along which axes some ray runs up, or down, and 1 / the step of the steepest.
    rises: BVec3A,
    falls: BVec3A,
    up: Vec3A,
    down: Vec3A,
    /// 1 / `middle`, and the border of a cell that it leaves by: 0 the lower, 1 the upper.
    inverse: Vec3A,
    side: Vec3A,
    /// A step that crosses a border for certain.
    nudge: f32,
    thinnest: f32,
}

impl Beam {
    /// The bundle from `origin` (grown voxel coordinates) of the rays whose steps (voxels) lie between `low` and `high`.
    #[inline(always)]
    pub fn new(origin: Vec3, low: Vec3, high: Vec3) -> Self {
        let (low, high) = (Vec3A::from(low), Vec3A::from(high));
        let middle = (low + high) * 0.5;
        // A little more, for the rounding of the middle.
        let half = (high - low) * 0.5 + 1e-6;
        let (top, bottom) = (middle + half, middle - half);
        let steep = middle.abs().max(Vec3A::splat(1e-9));
        let backwards = middle.cmplt(Vec3A::ZERO);
        Self {
            origin: Vec3A::from(origin),
            middle,
            rises: top.cmpgt(Vec3A::ZERO),
            falls: bottom.cmplt(Vec3A::ZERO),
            up: top.recip(),
            down: bottom.recip(),
            inverse: Vec3A::select(backwards, -steep.recip(), steep.recip()),
            side: Vec3A::select(backwards, Vec3A::ZERO, Vec3A::ONE),
            nudge: 1e-3 / steep.max_element(),
            thinnest: THICK / half.max_element(),
        }
    }

    /// The first `k` from `k` on at which one of the rays may meet something, or `end` if there is none before it. What is
    /// outside the grown volume is not known.
    #[inline(always)]
    pub fn next(&self, occupancy: &Occupancy, mut k: f32, end: f32) -> f32 {
        let bricks = occupancy.bricks().map(|n| n as i32);
        while k < end {
            let p = self.origin + self.middle * k;
            if p.min_element() < 0.0 {
                return k;
            }
            let cell = p.to_array().map(|c| c as i32);
            let b = cell.map(|c| c >> BRICK_SHIFT);
            if b[0] >= bricks[0] || b[1] >= bricks[1] || b[2] >= bricks[2] {
                return k;
            }
            let n = (b[0] + bricks[0] * (b[1] + bricks[1] * b[2])) as usize;
            let distance = occupancy.distance(n);
            if distance > 0 {
                // The cube of empty bricks, and the voxel around it that is empty too.
                let reach = (f32::from(distance) - 1.0) * 4.0 + 1.0;
                let low = Vec3A::new(b[0] as f32, b[1] as f32, b[2] as f32) * 4.0 - reach;
                let high = low + (4.0 + 2.0 * reach);
                let far = Vec3A::INFINITY;
                let up = Vec3A::select(self.rises, (high - self.origin) * self.up, far);
                let down = Vec3A::select(self.falls, (low - self.origin) * self.down, far);
                let leaves = up.min(down).min_element();
                // Not quite, for rounding.
                let leaves = leaves - self.nudge;
                if leaves <= k + self.nudge {
                    return k;
                }
                k = leaves;
                continue;
            }
            if k > self.thinnest {
                return k;
            }
            let bit = (cell[0] & 3) + 4 * (cell[1] & 3) + 16 * (cell[2] & 3);
            if occupancy.bits(n) >> bit & 1 != 0 {
                return k;
            }
            let border = Vec3A::new(cell[0] as f32, cell[1] as f32, cell[2] as f32) + self.side;
            let leaves = ((border - self.origin) * self.inverse).min_element();
            let nudge = self.nudge.max(k * 1e-6);
            k = (leaves + nudge).max(k + nudge);
        }
        end
    }
}
