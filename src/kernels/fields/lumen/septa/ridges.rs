//! Ridges of HU in the core of the gas: what averaging or noise has left of a thin wall.

use rayon::prelude::*;

use super::THICK_MM;
use crate::error::Result;
use crate::fields::lumen::runs::{Rows, Run};
use crate::progress::Progress;
use crate::volume::Volume;

/// Least height of a ridge above the gas on both sides, HU …
const RIDGE_HU: f64 = 70.0;
/// … and in standard deviations of its own noise.
const RIDGE_SIGMAS: f64 = 3.5;
/// How far from a ridge gas is looked for at least, voxels: a septum may lie in two slices …
const SIDES: usize = 2;
/// … and as a multiple of the thickest voxel's size: a septum that is oblique to a thick slice is as wide as half of it within it.
const SIDES_PER_SLICE: f64 = 0.5;
/// … and at most, voxels.
const MOST_SIDES: usize = 6;
/// The value of gas, HU.
const GAS_LEVEL_HU: i16 = -1000;

/// Returns the voxels of the core that are ridges, linear indices, ascending: those of the full height, and those of half of it that
/// touch one (Canny's hysteresis, 1986), so that no gap stays at the rim, where a mean takes in the wall beside.
pub(super) fn ridges(volume: &Volume, core: &Rows, noise: f64, progress: &Progress) -> Result<Vec<usize>> {
    let filter = RidgeFilter::new(volume, noise);
    let [nx, ny, nz] = volume.grid().dims();
    let found = (0..nz).into_par_iter().map(|k| {
        progress.check()?;
        let (mut high, mut half) = (Vec::new(), Vec::new());
        let mut sums = [Vec::new(), Vec::new(), Vec::new()];
        for j in 0..ny {
            core.row(j, k).iter().for_each(|&r| filter.run(r, [j, k], &mut sums, &mut high, &mut half));
        }
        Ok((high, half))
    });
    let (high, half): (Vec<_>, Vec<_>) = found.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let (mut all, half) = (high.concat(), half.concat());
    let mut taken = vec![false; half.len()];
    for &ridge in &all {
        for row in [-1, 0, 1].into_iter().flat_map(|k| [-1, 0, 1].map(|j| nx as i64 * (j + ny as i64 * k))) {
            let middle = ridge as i64 + row;
            let first = half.partition_point(|&h| (h as i64) < middle - 1);
            let near = (first..half.len()).take_while(|&h| half[h] as i64 <= middle + 1);
            near.for_each(|h| taken[h] = true);
        }
    }
    all.extend(half.iter().zip(taken).filter(|h| h.1).map(|h| *h.0));
    all.sort_unstable();
    Ok(all)
}

/// The second difference of the HU along each axis, of means across it.
struct RidgeFilter<'a> {
    data: &'a [i16],
    dims: [usize; 3],
    stride: [usize; 3],
    /// True for the axes along which means are taken: neighbours there are near.
    is_near: [bool; 3],
    /// How far along each axis gas is looked for, voxels.
    sides: [usize; 3],
    /// Least height of a ridge across each axis, times the number of voxels of a mean.
    least: [i32; 3],
    /// Least sum of a mean that may be a ridge's: gas is near −1000 HU.
    floor: [i32; 3],
}

impl<'a> RidgeFilter<'a> {
    fn new(volume: &'a Volume, noise: f64) -> Self {
        let grid = volume.grid();
        let dims @ [nx, ny, _] = grid.dims();
        let is_near = [0, 1, 2].map(|a| grid.spacing()[a] <= THICK_MM);
        let count = [0, 1, 2].map(|axis| (0..3).filter(|&a| a != axis && is_near[a]).map(|_| 3).product::<i32>());
        let least = count.map(|n| {
            // The difference of a mean and the mean of two has √1.5 of the mean's noise.
            let hu = RIDGE_HU.max(RIDGE_SIGMAS * noise * (1.5 / f64::from(n)).sqrt());
            (hu * f64::from(n)).ceil() as i32
        });
        let floor = [0, 1, 2].map(|a| least[a] / 2 + i32::from(GAS_LEVEL_HU) * count[a]);
        let thickest = grid.spacing().max_element();
        let sides = [0, 1, 2]
            .map(|a| ((SIDES_PER_SLICE * thickest / grid.spacing()[a]).ceil() as usize).clamp(SIDES, MOST_SIDES));
        Self { data: volume.data(), dims, stride: [1, nx, nx * ny], is_near, sides, least, floor }
    }

    /// Adds the ridges of a run in row (j, k), those of the full and those of half the height. Voxels at the scan's faces are never ridges.
    fn run(
        &self,
        run: Run,
        [j, k]: [usize; 2],
        sums: &mut [Vec<i32>; 3],
        high: &mut Vec<usize>,
        half: &mut Vec<usize>,
    ) {
        let edge = self.sides.map(|n| n + 1);
        let is_inner = |at: usize, a: usize| at >= edge[a] && at + edge[a] < self.dims[a];
        let (first, last) =
            ((run.start as usize).max(edge[0]), (run.end as usize).min(self.dims[0].saturating_sub(edge[0])));
        if first >= last || !is_inner(j, 1) || !is_inner(k, 2) {
            return;
        }
        let row = self.stride[1] * j + self.stride[2] * k;
        self.row_sums(row + first, last - first, sums);
        for (n, at) in (row + first..row + last).enumerate() {
            let mut is_half = false;
            let is_high = (0..3).any(|axis| {
                let here = sums[axis][n];
                if here < self.floor[axis] {
                    return false;
                }
                let height = self.height(at, axis, here);
                is_half |= 2 * height >= self.least[axis];
                height >= self.least[axis]
            });
            if is_high {
                high.push(at);
            } else if is_half {
                half.push(at);
            }
        }
    }

    /// Fills in the sums across each axis of `count` voxels from `first` on.
    fn row_sums(&self, first: usize, count: usize, sums: &mut [Vec<i32>; 3]) {
        for (axis, sums) in sums.iter_mut().enumerate() {
            sums.clear();
            sums.resize(count, 0);
            self.each_step(axis, |step| {
                let from = (first as isize + step) as usize;
                sums.iter_mut().zip(&self.data[from..from + count]).for_each(|(s, &v)| *s += i32::from(v));
            });
        }
    }

    /// Calls `f` with the steps from a voxel to those of its mean across an axis.
    #[inline(always)]
    fn each_step(&self, axis: usize, mut f: impl FnMut(isize)) {
        let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
        let steps = |a: usize| if self.is_near[a] { -1..=1isize } else { 0..=0 };
        for m in steps(b) {
            for n in steps(c) {
                f(m * self.stride[b] as isize + n * self.stride[c] as isize);
            }
        }
    }

    /// Returns how far the sum `here` at a voxel is above the lowest of the next ones on either side.
    fn height(&self, at: usize, axis: usize, here: i32) -> i32 {
        let side = |sign: isize| {
            let sums = (1..=self.sides[axis] as isize).map(|n| {
                let beside = at as isize + sign * n * self.stride[axis] as isize;
                let mut sum = 0;
                self.each_step(axis, |step| sum += i32::from(self.data[(beside + step) as usize]));
                sum
            });
            here - sums.fold(i32::MAX, i32::min)
        };
        side(-1).min(side(1))
    }
}
