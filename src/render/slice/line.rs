//! Trilinear samples at even steps along a straight line of voxel coordinates.

use glam::DVec3;

use crate::volume::Volume;

/// Bits behind the point of a voxel coordinate in fixed point.
const FRACTION: u32 = 32;
/// Bits of it that weigh neighbours: as many as an `f32` holds.
const SHARE: u32 = 24;

/// Samples the places `start + step · i`, i from 0 to `len` − 1, in voxel coordinates, and gives the HU of each that lies in the scan
/// to `put`, with its i.
#[inline(always)]
pub(super) fn sample(volume: &Volume, start: DVec3, step: DVec3, len: usize, mut put: impl FnMut(usize, f32)) {
    let Some(steps) = len.checked_sub(1) else { return };
    let dims = volume.grid().dims();
    let last = start + step * steps as f64;
    // A line is where its ends are.
    let beyond = |a: usize| {
        let end = dims[a] as f64 - 0.5;
        (start[a] < -0.5 && last[a] < -0.5) || (start[a] >= end && last[a] >= end)
    };
    if beyond(0) || beyond(1) || beyond(2) {
        return;
    }
    match Inner::new(volume, start, step, last, steps) {
        Some(inner) => inner.sample(len, put),
        None => {
            for i in 0..len {
                if let Some(hu) = value(volume, start + step * i as f64) {
                    put(i, hu);
                }
            }
        }
    }
}

/// Trilinear HU at a voxel coordinate. A voxel reaches half its size beyond its centre, and the outermost ones keep their value
/// there; nothing farther out, and where the place is no number.
fn value(volume: &Volume, at: DVec3) -> Option<f32> {
    let (grid, data) = (volume.grid(), volume.data());
    let dims = grid.dims();
    let at = at.to_array();
    if (0..3).any(|a| !(at[a] >= -0.5 && at[a] < dims[a] as f64 - 0.5)) {
        return None;
    }
    let mut low = [0; 3];
    let mut share = [0.0f32; 3];
    for a in 0..3 {
        let held = at[a].clamp(0.0, (dims[a] - 1) as f64);
        low[a] = (held as usize).min(dims[a].saturating_sub(2));
        share[a] = (held - low[a] as f64) as f32;
    }
    let high = [0, 1, 2].map(|a| (low[a] + 1).min(dims[a] - 1));
    let pair = |y: usize, z: usize| [data[grid.index(low[0], y, z)], data[grid.index(high[0], y, z)]];
    let pairs = [pair(low[1], low[2]), pair(high[1], low[2]), pair(low[1], high[2]), pair(high[1], high[2])];
    Some(blend(pairs, share))
}

/// The value between eight voxels: pairs along x at (y, z), (y + 1, z), (y, z + 1) and (y + 1, z + 1).
#[inline(always)]
fn blend(pairs: [[i16; 2]; 4], share: [f32; 3]) -> f32 {
    let along_x = pairs.map(|[a, b]| {
        let (a, b) = (f32::from(a), f32::from(b));
        a + (b - a) * share[0]
    });
    let near = along_x[0] + (along_x[1] - along_x[0]) * share[1];
    let far = along_x[2] + (along_x[3] - along_x[2]) * share[1];
    near + (far - near) * share[2]
}

/// A line of which every place lies between eight voxels, in fixed point: no test and no conversion is left for each sample. Over
/// the length of a run its places are exact to 1e-8 voxels.
struct Inner<'a> {
    data: &'a [i16],
    /// Voxels from one row, and from one layer, to the next.
    stride: [usize; 2],
    start: [i64; 3],
    step: [i64; 3],
}

impl<'a> Inner<'a> {
    /// The line from `start` by `steps` steps to `last`, if it is one.
    #[inline(always)]
    fn new(volume: &'a Volume, start: DVec3, step: DVec3, last: DVec3, steps: usize) -> Option<Self> {
        let dims = volume.grid().dims();
        let fixed = |c: f64| (c * (1u64 << FRACTION) as f64).round() as i64;
        let mut line = Self { data: volume.data(), stride: [dims[0], dims[0] * dims[1]], start: [0; 3], step: [0; 3] };
        for a in 0..3 {
            let most = (dims[a] - 1) as f64;
            // False for what is no number.
            if !(start[a] >= 0.0 && start[a] <= most && last[a] >= 0.0 && last[a] <= most) {
                return None;
            }
            (line.start[a], line.step[a]) = (fixed(start[a]), fixed(step[a]));
            // Both ends as they are reached below, after rounding.
            let end = line.start[a].wrapping_add(line.step[a].wrapping_mul(steps as i64));
            let inside = 0..((dims[a] as i64 - 1) << FRACTION);
            if !(inside.contains(&line.start[a]) && inside.contains(&end)) {
                return None;
            }
        }
        Some(line)
    }

    #[inline(always)]
    fn sample(&self, len: usize, mut put: impl FnMut(usize, f32)) {
        let [row, layer] = self.stride;
        let mut at = self.start;
        for i in 0..len {
            let [x, y, z] = at.map(|c| (c >> FRACTION) as usize);
            let share = at.map(|c| {
                let bits = (c as u32) >> (FRACTION - SHARE);
                bits as i32 as f32 * (1.0 / (1u32 << SHARE) as f32)
            });
            let n = x + row * y + layer * z;
            let pair = |n: usize| self.data.get(n..n + 2).map_or([0; 2], |p| [p[0], p[1]]);
            put(i, blend([pair(n), pair(n + row), pair(n + layer), pair(n + layer + row)], share));
            for a in 0..3 {
                at[a] = at[a].wrapping_add(self.step[a]);
            }
        }
    }
}
