//! Cross-sections: a plane through the volume, trilinear, as radiologists look at it.

mod plane;

use glam::DVec3;
use rayon::prelude::*;

use crate::volume::{AIR_HU, Volume};

pub use plane::{PlaneFrame, SlicePlane, letters};

/// An image of a plane. The centre of pixel (i, j) lies at `centre + right · (i + ½ − W/2) s + down · (j + ½ − H/2) s`, s the pixels'
/// side, so that `centre` is in the middle of the image, between pixels where their number is even.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slice {
    /// World, mm.
    pub centre: DVec3,
    /// Its axes.
    pub frame: PlaneFrame,
    /// Side of a pixel, mm.
    pub mm_per_pixel: f64,
    /// Width and height, pixels.
    pub size: [usize; 2],
}

impl Slice {
    /// Where a point of the image is in the world, mm; `at` counts pixels from the image's top left corner.
    pub fn world(&self, at: [f64; 2]) -> DVec3 {
        let [x, y] = [0, 1].map(|a| (at[a] - self.size[a] as f64 / 2.0) * self.mm_per_pixel);
        self.centre + self.frame.right() * x + self.frame.down() * y
    }

    /// Where a point of the world (mm) is in the image, pixels from its top left corner, and how far before the plane (mm).
    pub fn pixel(&self, world: DVec3) -> ([f64; 2], f64) {
        let d = world - self.centre;
        let along = [d.dot(self.frame.right()), d.dot(self.frame.down())];
        ([0, 1].map(|a| along[a] / self.mm_per_pixel + self.size[a] as f64 / 2.0), d.dot(self.frame.normal()))
    }

    /// Fills `out` with the HU of the pixels, row by row; −1024 outside the scan. It allocates nothing where `out` has the size
    /// already, and gives the same bytes for every number of threads.
    pub fn fill(&self, volume: &Volume, out: &mut Vec<f32>) {
        let [width, height] = self.size;
        out.resize(width * height, 0.0);
        if width == 0 {
            return;
        }
        let grid = volume.grid();
        let step = grid.to_voxel().transform_vector3(self.frame.right() * self.mm_per_pixel);
        out.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let first = grid.voxel(self.world([0.5, y as f64 + 0.5]));
            for (x, pixel) in row.iter_mut().enumerate() {
                *pixel = value(volume, first + step * x as f64);
            }
        });
    }
}

/// Trilinear HU at a voxel coordinate. A voxel reaches half its size beyond its centre, and the outermost ones keep their value
/// there; farther out, and where the place is no number, it is −1024.
fn value(volume: &Volume, at: DVec3) -> f32 {
    let (grid, data) = (volume.grid(), volume.data());
    let dims = grid.dims();
    let at = at.to_array();
    if (0..3).any(|a| !(at[a] >= -0.5 && at[a] < dims[a] as f64 - 0.5)) {
        return f32::from(AIR_HU);
    }
    let mut low = [0; 3];
    let mut share = [0.0f32; 3];
    for a in 0..3 {
        let held = at[a].clamp(0.0, (dims[a] - 1) as f64);
        low[a] = (held as usize).min(dims[a].saturating_sub(2));
        share[a] = (held - low[a] as f64) as f32;
    }
    let high = [0, 1, 2].map(|a| (low[a] + 1).min(dims[a] - 1));
    let voxel = |x: usize, y: usize, z: usize| f32::from(data[grid.index(x, y, z)]);
    let row = |y: usize, z: usize| {
        let (a, b) = (voxel(low[0], y, z), voxel(high[0], y, z));
        a + (b - a) * share[0]
    };
    let layer = |z: usize| {
        let (a, b) = (row(low[1], z), row(high[1], z));
        a + (b - a) * share[1]
    };
    let (a, b) = (layer(low[2]), layer(high[2]));
    a + (b - a) * share[2]
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::volume::Grid;

    #[test]
    fn planes_are_seen_as_radiologists_see_them() {
        let edges = |plane: SlicePlane| plane.frame().unwrap().edges().join(" ");
        assert_eq!(edges(SlicePlane::Axial), "R L A P");
        assert_eq!(edges(SlicePlane::Coronal), "R L S I");
        assert_eq!(edges(SlicePlane::Sagittal), "A P S I");
        assert_eq!(edges(SlicePlane::Oblique(DVec3::NEG_Z)), "R L A P");
        for bad in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
            assert!(SlicePlane::Oblique(bad).frame().is_err());
        }
    }

    /// Linear values come out exactly on a turned grid of stretched voxels, and a click goes to the world and back.
    #[test]
    fn linear_values_are_exact_in_every_plane() {
        let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-1.1);
        let grid = Grid::new([30, 28, 26], DVec3::new(0.7, 0.9, 1.6), DVec3::splat(-3.0), turn).unwrap();
        let slope = DVec3::new(3.0, -2.0, 1.0);
        // In whole HU at the voxels.
        let data = (0..grid.len())
            .map(|n| slope.dot(DVec3::from_array([n % 30, n / 30 % 28, n / 840].map(|c| c as f64))) as i16)
            .collect();
        let volume = Volume::new(grid.clone(), data);
        let centre = grid.world(DVec3::new(14.3, 13.1, 12.7));
        for plane in [
            SlicePlane::Axial,
            SlicePlane::Coronal,
            SlicePlane::Sagittal,
            SlicePlane::Oblique(DVec3::new(1.0, -2.0, 0.5)),
        ] {
            let slice = Slice { centre, frame: plane.frame().unwrap(), mm_per_pixel: 0.4, size: [41, 30] };
            let mut out = Vec::new();
            slice.fill(&volume, &mut out);
            let mut inside = 0;
            for (n, hu) in out.iter().enumerate() {
                let world = slice.world([(n % 41) as f64 + 0.5, (n / 41) as f64 + 0.5]);
                let v = grid.voxel(world);
                if v.min_element() > 0.0 && v.cmplt(DVec3::new(29.0, 27.0, 25.0)).all() {
                    inside += 1;
                    assert!((f64::from(*hu) - slope.dot(v)).abs() < 1e-3, "{plane:?} {n}: {hu}");
                }
                let (back, before) = slice.pixel(world);
                assert!((back[0] - (n % 41) as f64 - 0.5).abs() < 1e-9 && before.abs() < 1e-9);
            }
            assert!(inside > 300, "{plane:?}: {inside}");
        }
        let far = Slice {
            centre: DVec3::splat(1e9),
            mm_per_pixel: f64::NAN,
            size: [3, 2],
            frame: SlicePlane::Axial.frame().unwrap(),
        };
        let mut out = Vec::new();
        far.fill(&volume, &mut out);
        assert_eq!(out, [-1024.0; 6]);
    }
}
