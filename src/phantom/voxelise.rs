//! Sampling of the analytic body on any voxel grid.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::Phantom;
use super::gut::Run;
use crate::error::Result;
use crate::math::hash;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// Edge of the bricks that are classified as a whole, voxels.
pub(crate) const BRICK: usize = 8;

/// Scratch memory of one slab.
#[derive(Default)]
struct Scratch {
    runs: Vec<Range<usize>>,
    guts: Vec<Run>,
}

impl Phantom {
    /// Samples the body at the voxel centres of `grid`, with noise if the settings enable it.
    ///
    /// The grid may be anisotropic, oblique or flipped. The values do not depend on the number of threads.
    ///
    /// # Errors
    /// Returns an error only if cancelled through `progress`.
    pub fn voxelise(&self, grid: &Grid, progress: &Progress) -> Result<Volume> {
        let [nx, ny, nz] = grid.dims();
        let mut data = vec![0i16; grid.len()];
        progress.stage("phantom", nz as u64);
        data.par_chunks_mut(nx * ny * BRICK).enumerate().try_for_each_init(
            Scratch::default,
            |scratch, (slab, out)| {
                let k0 = slab * BRICK;
                let depth = out.len() / (nx * ny);
                for j0 in (0..ny).step_by(BRICK) {
                    for i0 in (0..nx).step_by(BRICK) {
                        let size = [BRICK.min(nx - i0), BRICK.min(ny - j0), depth];
                        self.fill(grid, [i0, j0, k0], size, out, scratch);
                    }
                }
                progress.advance(depth as u64)
            },
        )?;
        Ok(Volume::new(grid.clone(), data))
    }

    /// Fills one brick of the slab `out`. The slab starts at the brick's first slice.
    fn fill(&self, grid: &Grid, first: [usize; 3], size: [usize; 3], out: &mut [i16], scratch: &mut Scratch) {
        let [nx, ny, _] = grid.dims();
        let corner = DVec3::new(first[0] as f64, first[1] as f64, first[2] as f64);
        let half = DVec3::new(size[0] as f64 - 1.0, size[1] as f64 - 1.0, size[2] as f64 - 1.0) * 0.5;
        let reach = reach_of(grid, half);
        let centre = grid.world(corner + half);
        self.runs_near(centre, reach, &mut scratch.runs);
        self.guts.runs_near(centre, reach, &mut scratch.guts);
        let centre_sample = self.body.sample(centre);
        let body = (centre_sample.constant_mm > reach).then_some(centre_sample.hu);
        let near = self.body.near(centre, reach);
        let body = |p: DVec3| body.unwrap_or_else(|| self.body.value_among(p, near));
        for k in 0..size[2] {
            for j in 0..size[1] {
                let start = first[0] + nx * (first[1] + j + ny * k);
                let index = grid.index(first[0], first[1] + j, first[2] + k) as u64;
                for (i, voxel) in out[start..start + size[0]].iter_mut().enumerate() {
                    let p = grid.world(corner + DVec3::new(i as f64, j as f64, k as f64));
                    let hu = if scratch.runs.is_empty() && scratch.guts.is_empty() {
                        body(p)
                    } else {
                        self.value_among(p, &scratch.runs, &scratch.guts, body)
                    };
                    *voxel = round(hu + self.noise(index + i as u64));
                }
            }
        }
    }

    /// Returns a voxel's noise, HU.
    pub(super) fn noise(&self, index: u64) -> f64 {
        if self.settings.noise { self.scanner.noise_hu * hash::normal(self.noise_seed, index) } else { 0.0 }
    }
}

/// Returns half the longest diagonal of a (possibly slanted) brick that reaches `half` voxels to each side of its middle, mm.
pub(crate) fn reach_of(grid: &Grid, half: DVec3) -> f64 {
    let m = grid.to_world().matrix3;
    let slant = m.x_axis.dot(m.y_axis).abs() + m.y_axis.dot(m.z_axis).abs() + m.z_axis.dot(m.x_axis).abs();
    if slant < 1e-9 {
        (m * half).length()
    } else {
        half.x * m.x_axis.length() + half.y * m.y_axis.length() + half.z * m.z_axis.length()
    }
}

/// Rounds a value well within the range to the nearest whole HU, halves upwards. A cast truncates towards zero, so the
/// value is made positive first. (A plain `round` would call the mathematics library for every voxel.)
pub(crate) fn round(hu: f64) -> i16 {
    ((hu + 32_768.5) as i32 - 32_768) as i16
}
