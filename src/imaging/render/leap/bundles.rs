//! How far bundles of rays have no wall before them, so that each of their rays may begin there.
//!
//! Only the middle of a bundle leaps. Where its cell is at least `n` king's moves from wall, it may go on while the whole bundle is within
//! `n` − 1 cells of that one: a ray whose direction differs from the middle's by d is d·t beside it at t.

use fearless_simd::{Simd, f32x16, i32x16, prelude::*};

use super::crossings::RaysFrom;
use super::sixteen::Way;
use crate::render::camera::Sixteen;
use crate::render::packets::lanes::Padded;

/// A leap is worth another look at the distances if it is at least this long, voxels.
const WORTH: f32 = 0.5;
/// What positions in single precision may be wrong by, and more, voxels.
const ROUNDED: f32 = 2e-3;

/// Sixteen bundles of sixteen rays each from one point.
#[derive(Clone, Debug)]
pub struct Bundles {
    /// The direction of each bundle's middle, world, of about unit length.
    middle: Sixteen,
    /// The most by which a ray's direction differs from it along an axis, voxels/mm; infinite for no bundle.
    spread: [f64; 16],
}

impl Default for Bundles {
    fn default() -> Self {
        Self { middle: [[0.0; 16]; 3], spread: [f64::INFINITY; 16] }
    }
}

impl RaysFrom<'_> {
    /// Makes the rays along sixteen directions (world; of unit length; those that are no numbers do not count) bundle `n` of sixteen.
    pub fn bundle(&self, bundles: &mut Bundles, n: usize, rays: &Sixteen) {
        let (middle, spread) = fearless_simd::dispatch!(self.crossings.level, _simd => self.about(rays));
        for (all, own) in bundles.middle.iter_mut().zip(middle) {
            all[n] = own;
        }
        bundles.spread[n] = spread;
    }

    /// Returns the middle of sixteen directions and the most by which one differs from it.
    #[inline(always)]
    fn about(&self, rays: &Sixteen) -> ([f64; 3], f64) {
        let rows = self.crossings.volume.voxels().grid().to_voxel().matrix3.transpose().to_cols_array_2d();
        let (mut sums, mut count) = ([[0.0; 16]; 3], [0.0; 16]);
        for k in 0..16 {
            let is_ray = !rays[0][k].is_nan();
            for (sum, along) in sums.iter_mut().zip(rays) {
                sum[k] = if is_ray { along[k] } else { 0.0 };
            }
            count[k] = f64::from(u8::from(is_ray));
        }
        let add = |a: f64, b: f64| a + b;
        let count = fold(count, add);
        let middle = sums.map(|sum| fold(sum, add) / count);
        let mut wide = [0.0; 16];
        for k in 0..16 {
            let [x, y, z] = [rays[0][k] - middle[0], rays[1][k] - middle[1], rays[2][k] - middle[2]];
            for row in &rows {
                let beside = (row[0] * x + row[1] * y + row[2] * z).abs();
                // What is no number is not more.
                wide[k] = if beside > wide[k] { beside } else { wide[k] };
            }
        }
        let spread = fold(wide, |a, b| if a > b { a } else { b });
        (middle, if count > 0.0 { spread } else { f64::INFINITY })
    }

    /// Returns how far each bundle goes without a wall within `margin` voxels of its rays, mm; at least 0.
    pub fn clear(&self, bundles: &Bundles, margin: f64) -> [f64; 16] {
        let Some((_, free)) = &self.lanes else { return [0.0; 16] };
        fearless_simd::dispatch!(self.crossings.level, simd => self.clear_at_once(simd, free, bundles, margin as f32))
    }

    #[inline(always)]
    fn clear_at_once<S: Simd>(&self, simd: S, free: &Padded<'_>, bundles: &Bundles, margin: f32) -> [f64; 16] {
        let [nx, ny, _] = self.crossings.dims.map(|n| n as i32);
        let zero = f32x16::splat(simd, 0.0);
        let way = Way::new(simd, self.along(simd, &bundles.middle));
        let spread = f32x16::from_slice(simd, &bundles.spread.map(|s| s as f32 * 1.000_001));
        let most = way.along[0].abs().max(way.along[1].abs()).max(way.along[2].abs());
        let worth = f32x16::splat(simd, WORTH) / most;
        let mut active = spread.simd_lt(f32::INFINITY) & most.simd_lt(f32::INFINITY);
        let mut t = zero;
        while active.any_true() {
            let (cell, _) = self.place(simd, &way, t);
            let [x, y, z] = [
                cell[0].to_int::<i32x16<S>>() + 1,
                cell[1].to_int::<i32x16<S>>() + 1,
                cell[2].to_int::<i32x16<S>>() + 1,
            ];
            let room = free.at(simd, x + (y + z * ny) * nx).to_float::<f32x16<S>>() - 1.0;
            // Where the middle leaves the room, the bundle is no wider before.
            let wide = spread * self.reach(&way, cell, room).max(0.0) + (margin + ROUNDED);
            let next = self.reach(&way, cell, room - wide);
            active &= room.simd_ge(wide) & next.simd_gt(t + worth);
            t = active.select(next, t);
        }
        t.to_array().map(f64::from)
    }
}

/// Joins sixteen numbers, halves at a time.
#[inline(always)]
fn fold(mut all: [f64; 16], join: impl Fn(f64, f64) -> f64) -> f64 {
    for half in [8, 4, 2, 1] {
        for k in 0..half {
            all[k] = join(all[k], all[k + half]);
        }
    }
    all[0]
}

#[cfg(test)]
mod tests {
    use std::array::from_fn;

    use glam::DVec3;

    use super::*;
    use crate::math::hash::Stream;
    use crate::phantom::Phantom;
    use crate::progress::Progress;
    use crate::render::leap::Crossings;
    use crate::space::{PreparedVolume, TransferFunction};

    /// Of rays in bundles, and of rays to the same points from a little beside, none meets a wall before the bundle's end.
    #[test]
    fn no_ray_meets_a_wall_before_its_bundle_ends() {
        let volume = Phantom::embedded(&Progress::new()).unwrap();
        let volume = PreparedVolume::new(volume.into(), TransferFunction::default());
        let crossings = Crossings::new(&volume, &Progress::new()).unwrap();
        let grid = volume.voxels().grid();
        let middle = DVec3::from_array(grid.dims().map(|n| 0.5 * n as f64));
        let mut draw = Stream::new(11, 0);
        let (mut far, mut reached, mut all) = (0, 0.0, 0.0);
        for n in 0..3000 {
            let place = DVec3::from_array(from_fn(|_| draw.within(-0.9, 0.9)));
            let rays = crossings.from(grid.world(middle + place * middle));
            let wide = [0.0, 0.005, 0.05, 0.5][n % 4];
            let mut bundles = Bundles::default();
            let mut ways = Vec::new();
            for k in 0..15 {
                let about: [f64; 3] = from_fn(|_| draw.within(-1.0, 1.0));
                let one: [DVec3; 16] = from_fn(|j| {
                    let d = DVec3::from_array(about.map(|x| x + draw.within(-wide, wide))).normalize();
                    if n % 3 == 0 && j == k { DVec3::NAN } else { d }
                });
                ways.push(from_fn(|a| one.map(|d| d[a])));
                rays.bundle(&mut bundles, k, &ways[k]);
            }
            let beside: DVec3 = DVec3::from_array(from_fn(|_| draw.within(-1.0, 1.0)));
            let clear = [rays.clear(&bundles, 0.0), rays.clear(&bundles, 1.0)];
            assert_eq!([clear[0][15], clear[1][15]], [0.0; 2]);
            let from = crossings.from(grid.world(rays.from + beside));
            for (k, ways) in ways.iter().enumerate() {
                assert!(clear[0][k].is_finite() && clear[1][k].is_finite());
                for j in 0..16 {
                    let d = DVec3::from_array(ways.map(|d| d[j]));
                    let Some(mm) = rays.first(d).filter(|mm| *mm > 0.0) else { continue };
                    assert!(mm >= clear[0][k], "{n} {k} {j}: {mm} {}", clear[0][k]);
                    far += usize::from(clear[0][k] > 0.0);
                    (reached, all) = (reached + clear[0][k], all + mm);
                    let way = rays.origin + d * mm - from.origin;
                    let met = from.first(way.normalize()).unwrap_or(f64::INFINITY);
                    assert!(met >= way.length() * (clear[1][k] / mm).min(1.0) - 1e-9, "{n} {k} {j}");
                }
            }
        }
        assert!(far > 10_000 && reached > 0.3 * all, "{far}: {reached} of {all}");
        for nowhere in [DVec3::NAN, DVec3::splat(1e30)] {
            assert_eq!(crossings.from(nowhere).clear(&Bundles::default(), 0.0), [0.0; 16]);
        }
    }
}
