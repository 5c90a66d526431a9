//! Cross-sections of the scan as radiologists read them: a plane through the volume, trilinear, as a single plane or as
//! a slab of some thickness, in HU or in grey.

mod line;
mod near;
mod plane;
mod slab;
#[cfg(test)]
mod tests;
mod tint;
mod windowing;

use fearless_simd::Level;
use glam::DVec3;
use rayon::prelude::*;

use crate::volume::Volume;
use line::Sampler;

pub use near::Near;
pub use plane::{PlaneFrame, SlicePlane, letters};
pub use slab::{MAX_SLAB_MM, Slab, SlabKind};
pub use tint::Tint;
pub use windowing::Windowing;

/// An image of a plane.
///
/// The centre of pixel (i, j) is at `centre + right · (i + ½ − W/2) s + down · (j + ½ − H/2) s`, where s is the pixels'
/// side. `centre` is therefore in the middle of the image, between pixels if their number is even.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slice {
    /// Position of the image's middle, world, mm.
    pub centre: DVec3,
    /// The image's axes.
    pub frame: PlaneFrame,
    /// Side of a pixel, mm.
    pub mm_per_pixel: f64,
    /// Width and height, pixels.
    pub size: [usize; 2],
}

/// A scan, and the patch laid over it: other values for a box of its voxels, on the scan's grid.
#[derive(Clone, Copy, Debug)]
pub struct Patched<'a> {
    /// The scan.
    pub volume: &'a Volume,
    /// The patch.
    pub patch: Option<&'a Volume>,
}

impl Slice {
    /// Returns where a point of the image is in the world, mm. `at` is in pixels from the image's top left corner.
    pub fn world(&self, at: [f64; 2]) -> DVec3 {
        let [x, y] = [0, 1].map(|a| (at[a] - self.size[a] as f64 / 2.0) * self.mm_per_pixel);
        self.centre + self.frame.right() * x + self.frame.down() * y
    }

    /// Returns where a point of the world (mm) is in the image, pixels from its top left corner, and how far in front
    /// of the plane it is (mm).
    pub fn pixel(&self, world: DVec3) -> ([f64; 2], f64) {
        let d = world - self.centre;
        let along = [d.dot(self.frame.right()), d.dot(self.frame.down())];
        ([0, 1].map(|a| along[a] / self.mm_per_pixel + self.size[a] as f64 / 2.0), d.dot(self.frame.normal()))
    }

    /// Returns the same part of the plane with pixels of `factor` times the side. The last ones of rows and columns may
    /// reach beyond it.
    pub fn with_larger_pixels(&self, factor: usize) -> Self {
        let factor = factor.max(1);
        let size = self.size.map(|s| s.div_ceil(factor));
        // The top left corner stays in place.
        let [right, down] = [0, 1].map(|a| ((size[a] * factor) as f64 - self.size[a] as f64) / 2.0 * self.mm_per_pixel);
        Self {
            centre: self.centre + self.frame.right() * right + self.frame.down() * down,
            frame: self.frame,
            mm_per_pixel: self.mm_per_pixel * factor as f64,
            size,
        }
    }

    /// Enlarges values of this slice to an image of `size`, with pixels smaller by `factor` and the same top left corner.
    ///
    /// Values are linear between the centres of the larger pixels.
    // The enlarger of pictures works on colours; these are HU, which the pointer reads.
    pub fn enlarge(&self, values: &[f32], factor: usize, size: [usize; 2], out: &mut Vec<f32>) {
        out.resize(size[0] * size[1], 0.0);
        let [width, height] = self.size;
        if values.len() != width * height || values.is_empty() || size[0] == 0 {
            return;
        }
        // The pixel before, and the distance from there towards the next.
        let place = |n: usize, most: usize| {
            let at = ((n as f32 + 0.5) / factor.max(1) as f32 - 0.5).clamp(0.0, (most - 1) as f32);
            let before = (at as usize).min(most - 1);
            (before, (before + 1).min(most - 1), at - before as f32)
        };
        out.par_chunks_mut(size[0]).enumerate().for_each(|(y, row)| {
            let (above, below, down) = place(y, height);
            let [above, below] = [above, below].map(|y| &values[y * width..][..width]);
            for (x, pixel) in row.iter_mut().enumerate() {
                let (left, right, along) = place(x, width);
                let between = |row: &[f32]| row[left] + (row[right] - row[left]) * along;
                *pixel = between(above) + (between(below) - between(above)) * down;
            }
        });
    }

    /// Fills `out` with the HU of the pixels, row by row; −1024 outside the scan.
    ///
    /// Gives the same bytes for every number of threads.
    ///
    /// A voxel reaches half its size beyond its centre. The outermost voxels keep their value there; farther out is outside.
    pub fn fill(&self, volume: &Volume, out: &mut Vec<f32>) {
        self.fill_slab(volume, Slab::default(), out);
    }

    /// Like [`fill`](Self::fill), for a slab around the plane.
    pub fn fill_slab(&self, volume: &Volume, slab: Slab, out: &mut Vec<f32>) {
        out.resize(self.size[0] * self.size[1], 0.0);
        self.fill_rows(volume, slab, 0, out);
    }

    /// Fills `rows`, whole rows of the image from row `first` on, like [`fill_slab`](Self::fill_slab).
    ///
    /// Use this for an image too large to hold in memory or to compute in one go.
    pub fn fill_rows(&self, volume: &Volume, slab: Slab, first: usize, rows: &mut [f32]) {
        self.fill_rows_on(Level::new(), Patched { volume, patch: None }, slab, (first, rows), &mut Near::default());
    }

    /// Like [`fill_rows`](Self::fill_rows), for a scan with other values for a box of its voxels. With the same `near` from one picture to
    /// the next it allocates nothing.
    pub fn fill_rows_patched(&self, scan: Patched<'_>, slab: Slab, rows: (usize, &mut [f32]), near: &mut Near) {
        self.fill_rows_on(Level::new(), scan, slab, rows, near);
    }

    /// Like [`fill_rows_patched`](Self::fill_rows_patched), on a given SIMD level. All levels give the same bytes.
    fn fill_rows_on(
        &self,
        level: Level,
        scan: Patched<'_>,
        slab: Slab,
        (first, rows): (usize, &mut [f32]),
        near: &mut Near,
    ) {
        let width = self.size[0];
        if width == 0 || rows.is_empty() {
            return;
        }
        let Patched { volume, patch } = scan;
        let grid = volume.grid();
        let samples = slab.samples(grid, self.frame.normal());
        let start = |y: usize| grid.voxel(self.world([0.5, (first + y) as f64 + 0.5]));
        let step = grid.to_voxel().transform_vector3(self.frame.right() * self.mm_per_pixel);
        let (across, last) = (samples.across(), step * (width - 1) as f64);
        let [top, bottom] = [start(0), start(rows.len().div_ceil(width) - 1)];
        let corners = [top, bottom].map(|left| [left, left + last]);
        let corners = corners.as_flattened().iter().flat_map(|c| [*c - across * 0.5, *c + across * 0.5]);
        let span = corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], c| [low.min(c), high.max(c)]);
        let pixels = rows.len();
        let mut sampler = Sampler::within(volume, span, pixels, &mut near.scan);
        if let Some(patch) = patch {
            let at = sampler.patch_at(patch);
            sampler = sampler.with_patch(Sampler::within(patch, span.map(|s| s - at), pixels, &mut near.patch));
        }
        rows.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            fearless_simd::dispatch!(level, simd => samples.row(simd, &sampler, start(y), step, row));
        });
    }
}
