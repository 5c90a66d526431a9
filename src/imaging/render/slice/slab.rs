//! Slabs: everything within some distance of a plane, as one image.

use fearless_simd::{Simd, f32x16, prelude::*};
use glam::DVec3;

use super::line::{self, LANES, Sampler};
use crate::volume::Grid;

/// The thickest slab, mm.
pub const MAX_SLAB_MM: f64 = 20.0;
/// The most steps between a slab's faces: enough for voxels of 10 µm and more.
const MAX_STEPS: usize = 4096;

/// How a slab combines the samples behind a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum SlabKind {
    /// Their mean: less noise, like a thicker slice.
    #[default]
    Mean,
    /// The largest (maximum intensity projection): contrast medium, bone.
    Max,
    /// The smallest (minimum intensity projection): gas.
    Min,
}

/// A slab centred on a plane. With thickness 0 it is the plane itself.
///
/// A pixel's samples are on the line along the plane's normal, from one face of the slab to the other. They include
/// both faces and the plane, and are evenly spaced, at most half the scan's least spacing apart. The mean is that of
/// the values between the faces by the trapezoidal rule: the two samples on the faces count half. Samples outside the
/// scan do not count. A pixel is outside if all of its samples are.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Slab {
    mm: f64,
    kind: SlabKind,
}

impl Slab {
    /// Creates a slab of a thickness, mm.
    ///
    /// # Errors
    /// Returns a short reason if the thickness is not between 0 and [`MAX_SLAB_MM`].
    pub fn new(mm: f64, kind: SlabKind) -> Result<Self, String> {
        if !(0.0..=MAX_SLAB_MM).contains(&mm) {
            return Err(format!("a thickness of {mm} mm is not within 0 to {MAX_SLAB_MM} mm"));
        }
        Ok(Self { mm, kind })
    }

    /// Returns its thickness, mm.
    pub fn mm(self) -> f64 {
        self.mm
    }

    /// Returns how it combines samples.
    pub fn kind(self) -> SlabKind {
        self.kind
    }

    /// Returns the number of samples a pixel takes in a scan on this grid.
    pub fn samples_a_pixel(self, grid: &Grid) -> usize {
        self.steps(grid) + 1
    }

    /// Returns the number of steps between the faces, the same in front of the plane as behind it; 0 for the plane alone.
    fn steps(self, grid: &Grid) -> usize {
        (2 * (self.mm / grid.min_spacing()).ceil() as usize).min(MAX_STEPS)
    }

    /// Returns the samples to take on a grid, along a normal of unit length (world).
    pub(super) fn samples(self, grid: &Grid, normal: DVec3) -> Samples {
        let across = grid.to_voxel().transform_vector3(normal * self.mm);
        Samples { across, steps: self.steps(grid), kind: self.kind }
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
    /// Returns the way from face to face, voxels.
    pub(super) fn across(&self) -> DVec3 {
        self.across
    }

    /// Fills a row of pixels that begins at `start` in the plane, each `step` farther (voxel coordinates).
    #[inline(always)]
    pub(super) fn row<S: Simd>(&self, simd: S, scan: &Sampler<'_>, start: DVec3, step: DVec3, row: &mut [f32]) {
        for (n, pixels) in row.chunks_mut(LANES).enumerate() {
            let at = start + step * (n * LANES) as f64;
            let found = match (self.steps, self.kind) {
                (0, _) => {
                    let (hu, inside) = scan.sixteen(simd, at, step);
                    line::lanes(simd, inside).select(hu, line::air(simd))
                }
                (_, SlabKind::Mean) => self.mean(simd, scan, at, step),
                (_, SlabKind::Max) => self.extreme::<S, true>(simd, scan, at, step),
                (_, SlabKind::Min) => self.extreme::<S, false>(simd, scan, at, step),
            };
            pixels.copy_from_slice(&found.as_array()[..pixels.len()]);
        }
    }

    /// Returns the offset of sample k from the plane, voxels.
    #[inline(always)]
    fn offset(&self, k: usize) -> DVec3 {
        self.across * (k as f64 / self.steps as f64 - 0.5)
    }

    #[inline(always)]
    fn mean<S: Simd>(&self, simd: S, scan: &Sampler<'_>, at: DVec3, step: DVec3) -> f32x16<S> {
        let none = f32x16::splat(simd, 0.0);
        let (mut sum, mut weights) = (none, none);
        for k in 0..=self.steps {
            let (hu, inside) = scan.sixteen(simd, at + self.offset(k), step);
            let weight = f32x16::splat(simd, if k == 0 || k == self.steps { 0.5 } else { 1.0 });
            let weight = line::lanes(simd, inside).select(weight, none);
            sum += hu * weight;
            weights += weight;
        }
        weights.simd_gt(none).select(sum / weights, line::air(simd))
    }

    #[inline(always)]
    fn extreme<S: Simd, const MAX: bool>(&self, simd: S, scan: &Sampler<'_>, at: DVec3, step: DVec3) -> f32x16<S> {
        let none = f32x16::splat(simd, if MAX { f32::NEG_INFINITY } else { f32::INFINITY });
        let mut found = none;
        for k in 0..=self.steps {
            let (hu, inside) = scan.sixteen(simd, at + self.offset(k), step);
            let hu = line::lanes(simd, inside).select(hu, none);
            found = if MAX { found.max(hu) } else { found.min(hu) };
        }
        found.simd_eq(none).select(line::air(simd), found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slab_is_as_thick_as_it_was_made_and_of_its_kind() {
        for kind in [SlabKind::Mean, SlabKind::Max, SlabKind::Min] {
            let slab = Slab::new(7.5, kind).unwrap();
            assert_eq!((slab.mm(), slab.kind()), (7.5, kind));
        }
        for bad in [-0.1, MAX_SLAB_MM + 0.1, f64::NAN] {
            assert!(Slab::new(bad, SlabKind::Mean).is_err(), "{bad}");
        }
    }
}
