//! Fluid that stands above its level: it climbs narrow gaps and walls, and fills bends without gas as in a siphon.
//!
//! Its surface is no plane there, but it is still where the gas ends. A voxel of gas with the value `v` is at the depth
//! `Φ⁻¹((v − A)/(F − A))`, in σ, with gas `A` and tag `F`. What is at the distance `d` from it is at most `d/σ` deeper, and exactly that
//! along the surface's normal:
//!
//! ```text
//! depth = min over gas of (Φ⁻¹((v − A)/(F − A)) + d/σ)
//! ```
//!
//! Without gas in reach the depth is infinite: there is only fluid. The depth takes the place of that below the plane, so that risen
//! fluid is removed like the rest of its pool.

use glam::DVec3;

use super::block::{Block, Mask};
use crate::math::normal;

/// The plane does not hold where fluid has risen and around its foot, up to this distance, σ, …
const FOOT: f64 = 5.0;
/// … and this near fluid, σ: what is clearly fluid ends 0.7 below its surface, and gas begins 1 above it. Farther away there are
/// walls of gas.
const AROUND: f64 = 2.5;
/// Farther than this from gas, σ, there is only fluid.
const FAR: f64 = 4.0;
/// Gas with a smaller depth than this, σ, counts as so deep, which the minimum allows: its own depth is lost in noise.
const LEAST: f64 = -2.0;

/// The depth of the voxels around risen fluid.
#[derive(Clone, Debug)]
pub(super) struct Risen {
    /// By index of the block, σ; NaN where the plane holds. Empty if it holds everywhere.
    depths: Vec<f32>,
}

impl Risen {
    /// The plane holds everywhere.
    pub(super) fn none() -> Self {
        Self { depths: Vec::new() }
    }

    /// Returns the depths in `block` around the risen fluid, given all fluid and the lumen's gas; all are sets of `wide`, a larger block
    /// of the same brick with the values `hu`. A voxel is `per_sigma` wide, and `materials` writes HU of gas and of tag along a row of
    /// voxels that begins at a voxel.
    pub(super) fn new(
        [risen, fluid, gas]: [&Mask; 3],
        hu: &[f32],
        [wide, block]: [&Block; 2],
        per_sigma: DVec3,
        materials: impl Fn([i64; 3], [&mut [f32]; 2]),
    ) -> Self {
        let near = Ball::new(per_sigma, AROUND, wide);
        let far = Ball::new(per_sigma, FAR, wide);
        let most = (FOOT / per_sigma).floor().to_array().map(|n| n as usize);
        let foot = risen.dilated(most);
        let mut around = fluid.clone();
        // What lies around a set lies around its outermost voxels.
        let inner = fluid.eroded([1; 3]);
        let close = foot.dilated(near.most);
        fluid.each(|n| {
            if !inner.has(n) && close.has(n) {
                near.visit(wide, n, |m, _| {
                    around.set(m);
                    true
                });
            }
        });
        around.keep_in(&foot);
        // Depth of gas; infinite elsewhere.
        let mut of_gas = vec![f32::INFINITY; hu.len()];
        let (mut dark, mut tag) = (vec![0f32; wide.dims[0]], vec![0f32; wide.dims[0]]);
        let mut row = usize::MAX;
        let least = normal::cdf(LEAST);
        let mut in_reach = around.dilated(far.most);
        in_reach.keep_in(gas);
        in_reach.each(|n| {
            let x = n % wide.dims[0];
            if row != n - x {
                row = n - x;
                materials(wide.voxel(row), [&mut dark, &mut tag]);
            }
            let share = f64::from((hu[n] - dark[x]) / (tag[x] - dark[x]).max(1.0));
            of_gas[n] = if share > least { normal::quantile(share.min(0.5)) as f32 } else { LEAST as f32 };
        });
        let near_gas = in_reach.dilated(far.most);
        let mut depths = vec![f32::NAN; block.len()];
        around.each(|n| {
            let v = wide.voxel(n);
            let is_within = |a: usize| (block.first[a]..block.first[a] + block.dims[a] as i64).contains(&v[a]);
            if !(0..3).all(is_within) {
                return;
            }
            let mut depth = f32::INFINITY;
            if near_gas.has(n) {
                far.visit(wide, n, |m, distance| {
                    depth = depth.min(of_gas[m] + distance);
                    // What is farther away is deeper.
                    distance + (LEAST as f32) < depth
                });
            }
            depths[block.index(v)] = depth;
        });
        Self { depths }
    }

    /// Returns the depth of the voxel at an index of the block; `None` where the plane holds.
    #[inline]
    pub(super) fn get(&self, n: usize) -> Option<f32> {
        self.depths.get(n).copied().filter(|depth| !depth.is_nan())
    }
}

/// The voxels of a block within some distance of one, by distance.
struct Ball {
    /// Steps along the axes, the difference of the indices, and the distance.
    steps: Vec<([i64; 3], isize, f32)>,
    /// Greatest steps.
    most: [usize; 3],
}

impl Ball {
    /// All within `radius`, for voxels of this size.
    fn new(size: DVec3, radius: f64, block: &Block) -> Self {
        let most = (radius / size).floor().to_array().map(|n| n as i64);
        let strides = block.strides().map(|s| s as i64);
        let mut steps = Vec::new();
        for z in -most[2]..=most[2] {
            for y in -most[1]..=most[1] {
                for x in -most[0]..=most[0] {
                    let distance = (DVec3::new(x as f64, y as f64, z as f64) * size).length();
                    if distance <= radius {
                        let offset = x * strides[0] + y * strides[1] + z * strides[2];
                        steps.push(([x, y, z], offset as isize, distance as f32));
                    }
                }
            }
        }
        steps.sort_by(|a, b| a.2.total_cmp(&b.2));
        Self { steps, most: most.map(|m| m as usize) }
    }

    /// Calls `visit` with the index of each voxel around the one at index `n` that is in the block, and its distance, as long as it
    /// returns true.
    fn visit(&self, block: &Block, n: usize, mut visit: impl FnMut(usize, f32) -> bool) {
        let strides = block.strides();
        let at = [0, 1, 2].map(|a| n / strides[a] % block.dims[a]);
        let is_inside = (0..3).all(|a| at[a] >= self.most[a] && at[a] + self.most[a] < block.dims[a]);
        for &(step, offset, distance) in &self.steps {
            let is_within = |a: usize| (0..block.dims[a] as i64).contains(&(at[a] as i64 + step[a]));
            if (is_inside || (0..3).all(is_within)) && !visit(n.wrapping_add_signed(offset), distance) {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::fields::cleanse::block::Bricks;
    use crate::fields::lumen::runs::{Rows, Run};
    use crate::math::hash;
    use crate::volume::{Grid, Volume};

    const SIGMA: f64 = 0.6;

    /// Fluid of 600 HU up to a plane through the block's middle whose normal leans by some degrees, below gas.
    fn leaning(degrees: f64, noise: f64) -> (Volume, impl Fn([i64; 3]) -> f64) {
        let grid = Grid::new([32, 16, 16], DVec3::new(0.7, 0.7, 0.9), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let spacing = grid.spacing();
        let (sin, cos) = degrees.to_radians().sin_cos();
        let depth = move |v: [i64; 3]| {
            let p = DVec3::from_array(v.map(|c| c as f64)) * spacing - DVec3::new(10.0, 5.0, 0.0);
            (p.y * cos + p.x * sin) / SIGMA
        };
        let value = |n: usize| {
            let v = [n % 32, n / 32 % 16, n / 32 / 16].map(|c| c as i64);
            (-1000.0 + 1600.0 * normal::cdf(depth(v)) + noise * hash::normal(3, n as u64)).round() as i16
        };
        (Volume::new(grid.clone(), (0..grid.len()).map(value).collect()), depth)
    }

    #[test]
    fn the_depth_is_that_below_the_surface_however_it_leans() {
        for (degrees, noise) in [(0.0, 0.0), (30.0, 0.0), (45.0, 20.0), (80.0, 20.0)] {
            let (volume, depth) = leaning(degrees, noise);
            let bricks = Bricks::of(volume.grid());
            let [wide, block] = [[8; 3], [3; 3]].map(|margin| bricks.block(0, margin));
            let rows = |is_one: &dyn Fn(i16) -> bool| {
                let slices = volume.data().chunks(32 * 16).map(|slice| {
                    let rows = slice.chunks(32).map(|row| {
                        let own = (0..32u32).filter(|&i| is_one(row[i as usize]));
                        own.map(|i| Run { start: i, end: i + 1, label: 0 }).collect::<Vec<_>>()
                    });
                    let rows: Vec<_> = rows.collect();
                    (rows.iter().map(|r| r.len() as u32).collect(), rows.concat())
                });
                Rows::from_slices(volume.grid().dims(), slices.collect()).unwrap()
            };
            let gas = wide.mask(&rows(&|hu| hu <= -650), |_| true);
            let bright = wide.mask(&rows(&|hu| hu > 210), |_| true);
            let hu = wide.load(&volume);
            let per_sigma = volume.grid().spacing() / SIGMA;
            let found = Risen::new([&bright, &bright, &gas], &hu, [&wide, &block], per_sigma, |_, [dark, tag]| {
                dark.fill(-1000.0);
                tag.fill(600.0);
            });
            let (mut worst, mut count) = (0.0f64, 0);
            // Away from the edges of the scan, which have no neighbours on one side.
            for n in 0..block.len() {
                let v = block.voxel(n);
                let is_inner = (0..3).all(|a| (3..volume.grid().dims()[a] as i64 - 3).contains(&v[a]));
                let Some(found) = found.get(n).filter(|_| is_inner) else { continue };
                let truth = depth(v);
                if truth.abs() < 2.0 {
                    worst = worst.max((f64::from(found) - truth).abs());
                    count += 1;
                }
                assert!(truth < 2.0 || found > 1.6, "{v:?}: {found} instead of {truth}");
                assert!(found.is_finite() || truth > 2.5, "{v:?}: {found} instead of {truth}");
            }
            println!("leaning by {degrees}°: at most {worst:.2} σ off at {count} voxels");
            assert!(count > 200 && worst < 0.45, "{degrees}°: {worst} at {count}");
        }
    }
}
