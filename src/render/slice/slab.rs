//! Slabs: what lies within some distance of a plane, as one image.

use glam::DVec3;

use super::{RUN, line};
use crate::volume::{AIR_HU, Grid, Volume};

/// The thickest slab, mm.
pub const MAX_SLAB_MM: f64 = 20.0;
/// No slab has more samples than this between its faces: enough for voxels from 10 µm on.
const MAX_STEPS: usize = 4096;

/// What a slab shows of the samples behind a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum SlabKind {
    /// Their mean: less noise, as a thicker slice has.
    #[default]
    Mean,
    /// The largest (maximum intensity projection): contrast medium, bone.
    Max,
    /// The smallest (minimum intensity projection): gas.
    Min,
}

/// A slab about a plane, as thick on either side. Without thickness it is the plane itself.
///
/// A pixel's samples lie on the line along the plane's normal, from one face of the slab to the other, both included, evenly and at
/// most half the scan's least spacing apart. The mean is that of the values between the faces by the trapezoidal rule: the two samples
/// on the faces count half. Samples outside the scan do not count; where all are outside the pixel is outside.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Slab {
    mm: f64,
    kind: SlabKind,
}

impl Slab {
    /// A slab of a thickness, mm.
    ///
    /// # Errors
    /// Says in a few words what is wrong with the thickness: it is not between 0 and [`MAX_SLAB_MM`].
    pub fn new(mm: f64, kind: SlabKind) -> Result<Self, String> {
        if !(0.0..=MAX_SLAB_MM).contains(&mm) {
            return Err(format!("a thickness of {mm} mm is not within 0 to {MAX_SLAB_MM} mm"));
        }
        Ok(Self { mm, kind })
    }

    /// Its thickness, mm.
    pub fn mm(self) -> f64 {
        self.mm
    }

    /// What it shows.
    pub fn kind(self) -> SlabKind {
        self.kind
    }

    /// Where to sample on a grid, along a normal of unit length (world).
    pub(super) fn samples(self, grid: &Grid, normal: DVec3) -> Samples {
        let steps = ((self.mm / (0.5 * grid.min_spacing())).ceil() as usize).min(MAX_STEPS);
        Samples { across: grid.to_voxel().transform_vector3(normal * self.mm), steps, kind: self.kind }
    }
}

/// The samples of a pixel, along the normal.
pub(super) struct Samples {
    /// From face to face, voxels.
    across: DVec3,
    /// Steps between the faces; 0 for the plane alone.
    steps: usize,
    kind: SlabKind,
}

impl Samples {
    /// Fills a run of up to [`RUN`] pixels that begins at `start` in the plane, each `step` farther (voxel coordinates).
    #[inline]
    pub(super) fn fill(&self, volume: &Volume, start: DVec3, step: DVec3, run: &mut [f32]) {
        let len = run.len();
        if self.steps == 0 {
            run.fill(f32::from(AIR_HU));
            line::sample(volume, start, step, len, |i, hu| run[i] = hu);
            return;
        }
        let at = |k: usize| start + self.across * (k as f64 / self.steps as f64 - 0.5);
        match self.kind {
            SlabKind::Mean => {
                run.fill(0.0);
                let mut weights = [0.0f32; RUN];
                for k in 0..=self.steps {
                    let weight = if k == 0 || k == self.steps { 0.5 } else { 1.0 };
                    line::sample(volume, at(k), step, len, |i, hu| {
                        run[i] += weight * hu;
                        weights[i] += weight;
                    });
                }
                for (pixel, weight) in run.iter_mut().zip(weights) {
                    *pixel = if weight > 0.0 { *pixel / weight } else { f32::from(AIR_HU) };
                }
            }
            SlabKind::Max => {
                run.fill(f32::NEG_INFINITY);
                for k in 0..=self.steps {
                    line::sample(volume, at(k), step, len, |i, hu| run[i] = if hu > run[i] { hu } else { run[i] });
                }
            }
            SlabKind::Min => {
                run.fill(f32::INFINITY);
                for k in 0..=self.steps {
                    line::sample(volume, at(k), step, len, |i, hu| run[i] = if hu < run[i] { hu } else { run[i] });
                }
            }
        }
        // What no sample has reached.
        for pixel in run.iter_mut().filter(|p| p.is_infinite()) {
            *pixel = f32::from(AIR_HU);
        }
    }
}
