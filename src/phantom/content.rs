//! Finds what positions are in.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::Phantom;
use super::gut::Run;
use super::kinds::{BodyKind, Content};
use super::voxelise::{BRICK, reach_of};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Grid;

impl Phantom {
    /// Returns what a position (world, mm LPS) is in.
    pub fn content_at(&self, world: DVec3) -> Content {
        self.content_among(world, &[self.all_knots()], &self.guts.all_runs())
    }

    /// Returns the label of each voxel of `grid`, x fastest ([`Content::label`]).
    ///
    /// # Errors
    /// Returns an error only if cancelled through `progress`.
    pub fn labels(&self, grid: &Grid, progress: &Progress) -> Result<Vec<u8>> {
        let [nx, ny, nz] = grid.dims();
        let mut out = vec![0u8; grid.len()];
        progress.stage("labels", nz as u64);
        out.par_chunks_mut(nx * ny * BRICK).enumerate().try_for_each(|(slab, out)| {
            let (depth, mut runs, mut guts) = (out.len() / (nx * ny), Vec::new(), Vec::new());
            for j0 in (0..ny).step_by(BRICK) {
                for i0 in (0..nx).step_by(BRICK) {
                    let size = [BRICK.min(nx - i0), BRICK.min(ny - j0), depth];
                    let first = DVec3::new(i0 as f64, j0 as f64, (slab * BRICK) as f64);
                    let half = DVec3::new(size[0] as f64 - 1.0, size[1] as f64 - 1.0, size[2] as f64 - 1.0) * 0.5;
                    let (centre, reach) = (grid.world(first + half), reach_of(grid, half));
                    self.runs_near(centre, reach, &mut runs);
                    self.guts.runs_near(centre, reach, &mut guts);
                    for k in 0..size[2] {
                        for j in 0..size[1] {
                            let start = i0 + nx * (j0 + j + ny * k);
                            for (i, voxel) in out[start..start + size[0]].iter_mut().enumerate() {
                                let p = grid.world(first + DVec3::new(i as f64, j as f64, k as f64));
                                *voxel = self.content_among(p, &runs, &guts).label();
                            }
                        }
                    }
                }
            }
            progress.advance(depth as u64)
        })?;
        Ok(out)
    }

    /// Returns what a position is in, given the relevant runs.
    pub(crate) fn content_among(&self, p: DVec3, runs: &[Range<usize>], guts: &[Run]) -> Content {
        let (d, _) = self.distances_among(p, runs);
        if d.wall < 0.0 {
            return Content::Colon;
        }
        let gut = self.guts.inside(p, guts);
        if let Some(gut) = gut.filter(|g| g.d < 0.0) {
            return match self.guts.tubes[gut.tube].kind {
                BodyKind::Stomach => Content::Stomach,
                _ => Content::SmallBowel,
            };
        }
        // Fat covers a lung up to this distance from gut.
        if d.plain < 5.0 || gut.is_some_and(|g| g.d < 4.75) {
            return Content::Tissue;
        }
        self.body.content(p)
    }
}
