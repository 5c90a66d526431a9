//! A bundle of rays from one point, and the distance it can leap through empty space.

use glam::{BVec3A, Vec3, Vec3A};

use super::occupancy::{BRICK_SHIFT, Occupancy};

/// The most cells along an axis that are looked up at once. A thicker bundle does not leap: its rays take ordinary steps.
const MOST: i32 = 8;
/// The most bricks along an axis whose distances are looked up one by one.
const MOST_BRICKS: i32 = 3;

/// A bundle of rays `origin + k · along` whose `along` are within a box.
///
/// At any `k` the rays' positions are within a box too, and this box leaps as a whole. It moves from empty brick to empty
/// brick (after Amanatides and Woo 1987, with the box's leading faces in place of a point). Where bricks are not empty,
/// it advances by one cell length at a time.
pub(crate) struct Beam {
    origin: Vec3A,
    /// Corners of the box of steps, voxels.
    bottom: Vec3A,
    top: Vec3A,
    /// The axes along which some ray runs up (`rises`) or down (`falls`), and 1 / the steepest step in each direction.
    rises: BVec3A,
    falls: BVec3A,
    up: Vec3A,
    down: Vec3A,
    /// The largest step of any ray along any axis, voxels; `cell` is its inverse, in steps per voxel.
    steepest: f32,
    cell: f32,
}

impl Beam {
    /// Creates the bundle from `origin` (grown voxel coordinates) of the rays whose steps (voxels) lie between `low` and `high`.
    #[inline(always)]
    pub(crate) fn new(origin: Vec3, low: Vec3, high: Vec3) -> Self {
        let (bottom, top) = (Vec3A::from(low), Vec3A::from(high));
        let steepest = bottom.abs().max(top.abs()).max_element().max(1e-9);
        Self {
            origin: Vec3A::from(origin),
            bottom,
            top,
            rises: top.cmpgt(Vec3A::ZERO),
            falls: bottom.cmplt(Vec3A::ZERO),
            up: top.recip(),
            down: bottom.recip(),
            steepest,
            cell: 1.0 / steepest,
        }
    }

    /// Returns the `k` at which a leading face of the box meets the planes `low` and `high`.
    #[inline(always)]
    fn meets(&self, low: Vec3A, high: Vec3A) -> f32 {
        let far = Vec3A::INFINITY;
        let up = Vec3A::select(self.rises, (high - self.origin) * self.up, far);
        let down = Vec3A::select(self.falls, (low - self.origin) * self.down, far);
        up.min(down).min_element()
    }

    /// Returns the `k` at which the bundle leaves the bricks from `first` to `last` and the empty bricks around them.
    ///
    /// `distance` is the distance to the next occupied brick, bricks. If one of the bricks is itself occupied, the
    /// result is behind the camera.
    #[inline(always)]
    fn leaves(&self, first: [i32; 3], last: [i32; 3], distance: u8) -> f32 {
        if distance == 0 {
            return -1.0;
        }
        let reach = f32::from(distance) - 1.0;
        let corner = |b: [i32; 3]| Vec3A::new(b[0] as f32, b[1] as f32, b[2] as f32);
        let side = (1 << BRICK_SHIFT) as f32;
        self.meets((corner(first) - reach) * side, (corner(last) + (1.0 + reach)) * side)
    }

    /// Returns the first `k` from `k` on at which one of the rays may meet something, or `end` if there is none before it.
    ///
    /// The result is early by about a thousandth of a voxel. Nothing is known outside the grown volume.
    #[inline(always)]
    pub(crate) fn next(&self, occupancy: &Occupancy, k: f32, end: f32) -> f32 {
        let next = self.leap(occupancy, k, end);
        // Twice, to cover the rounding of a border's position.
        if next < end { (next - 2.0 * self.nudge(next)).max(k) } else { end }
    }

    /// How far past a border a leap goes, so that it crosses it for certain at any distance, steps.
    #[inline(always)]
    fn nudge(&self, k: f32) -> f32 {
        (1e-3 * self.cell).max(k * 1e-6)
    }

    /// Computes [`next`](Beam::next), late by one nudge where a leap ended there.
    #[inline(always)]
    fn leap(&self, occupancy: &Occupancy, mut k: f32, end: f32) -> f32 {
        let bricks = occupancy.bricks().map(|n| n as i32);
        let whole = |v: Vec3A| v.to_array().map(|c| c as i32);
        while k < end {
            // Grown by what rounding and nudges may shift.
            let slack = 2e-3 + (k * self.steepest + 1.0) * 1e-6;
            let (low, high) = (self.origin + self.bottom * k - slack, self.origin + self.top * k + slack);
            if low.min_element() < 0.0 {
                return k;
            }
            let (first, last) = (whole(low), whole(high));
            let (b, c) = (first.map(|c| c >> BRICK_SHIFT), last.map(|c| c >> BRICK_SHIFT));
            if c[0] >= bricks[0] || c[1] >= bricks[1] || c[2] >= bricks[2] {
                return k;
            }
            let nudge = self.nudge(k);
            let distance = occupancy.distance(b);
            if (0..3).all(|a| c[a] - b[a] < i32::from(distance)) {
                let leaves = self.leaves(b, b, distance);
                if leaves > k {
                    k = leaves + nudge;
                    continue;
                }
            } else if distance > 0 && (0..3).all(|a| c[a] - b[a] < MOST_BRICKS) {
                // None of the bricks that the box touches may hold anything.
                let leaves = self.leaves(b, c, occupancy.nearest(b, c));
                if leaves > k {
                    k = leaves + nudge;
                    continue;
                }
            }
            // The box's sweep over about one cell.
            let far = k + self.cell.max(nudge);
            let (low, high) =
                (low.min(self.origin + self.bottom * far - slack), high.max(self.origin + self.top * far + slack));
            if low.min_element() < 0.0 {
                return k;
            }
            let (first, last) = (whole(low), whole(high));
            let fits = (0..3).all(|a| last[a] >> BRICK_SHIFT < bricks[a] && last[a] - first[a] < MOST);
            if !fits || occupancy.any(first, last) {
                return k;
            }
            k = far;
        }
        end
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::math::hash;
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};

    /// The occupancy of an empty volume in which the given voxels are set.
    fn occupancy(dims: [usize; 3], set: impl Iterator<Item = [usize; 3]>) -> Occupancy {
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let mut data = vec![-1000; grid.len()];
        for [x, y, z] in set {
            data[x + dims[0] * (y + dims[1] * z)] = 0;
        }
        Occupancy::new(&Volume::new(grid, data), TransferFunction::default())
    }

    /// Returns where one of the rays at the box's corners, or within it, is in a set cell before `until`.
    fn missed(o: &Occupancy, origin: Vec3, [low, high]: [Vec3; 2], from: f32, until: f32) -> Option<Vec3> {
        let cells = o.bricks().map(|n| n as f32 * 4.0);
        let pace = 0.05 / low.abs().max(high.abs()).max_element();
        (0..12u64).find_map(|n| {
            let share = |a: u64| if n < 8 { (n >> a & 1) as f32 } else { hash::uniform(n, a) as f32 };
            let along = low + (high - low) * Vec3::new(share(0), share(1), share(2));
            (0..4000).map(|i| origin + along * (from + pace * i as f32).min(until)).find(|p| {
                let within = p.min_element() >= 0.0 && (0..3).all(|a| p[a] < cells[a]);
                let cell = p.to_array().map(|c| c as i32);
                within && o.any(cell, cell)
            })
        })
    }

    /// A trailing face, too, may extend beyond the bricks that are known to be empty.
    #[test]
    fn a_wide_bundle_leaps_over_nothing_beside_it() {
        let o = occupancy([99, 119, 11], (0..11).map(|z| [40, 86, z]));
        let (origin, along) =
            (Vec3::new(40.5, 2.0, 6.0), [Vec3::new(-0.06, 0.999, -0.01), Vec3::new(-0.005, 1.0, 0.01)]);
        let k = Beam::new(origin, along[0], along[1]).next(&o, 60.0, 1e4);
        assert!((80.0..84.1).contains(&k), "leapt to {k}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn no_ray_is_in_a_set_cell_before(
            seed: u64, many in 0u64..12, x in 0.0f32..60.0, y in 0.0f32..60.0, z in 0.0f32..60.0,
            dx in -1.0f32..1.0, dy in -1.0f32..1.0, dz in -1.0f32..1.0, width in 0.0f32..0.3, power in -5i32..6, from in 0.0f32..30.0,
        ) {
            let dims = [60, 60, 60];
            let place = |n: u64| [0, 1, 2].map(|a| (60.0 * hash::uniform(seed, 3 * n + a)) as usize);
            let o = occupancy(dims, (0..many).map(place));
            let step = 2f32.powi(power);
            let along = Vec3::new(dx, dy, dz).normalize_or(Vec3::X) * step;
            let (low, high) = (along - 0.5 * width * step, along + 0.5 * width * step);
            let (origin, from) = (Vec3::new(x, y, z), from / step);
            let k = Beam::new(origin, low, high).next(&o, from, 200.0 / step);
            if k > from {
                let missed = missed(&o, origin, [low, high], from, k);
                prop_assert_eq!(missed, None, "leapt from {} to {}", from, k);
            }
        }
    }
}
