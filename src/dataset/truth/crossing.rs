//! Where a ray crosses the wall.

use glam::{DVec3, Vec3};

/// Where a ray first crosses the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Distance from the camera, mm.
    pub mm: f64,
    /// World, mm.
    pub place: DVec3,
    /// The scan's place of the tissue there, world, mm: the same unless the scan is deformed.
    pub tissue: Vec3,
    /// The wall's normal there, world, of unit length, towards the gas, of the values around it: from the differences over two voxels, as
    /// pictures are shaded. It does not change abruptly from voxel to voxel, and never points away from the ray's origin.
    pub smooth: Vec3,
}

impl Crossing {
    /// Returns cos/r² of a lamp at `eye` (world, mm), 1/mm², with the smooth normal.
    pub fn headlight(&self, eye: DVec3) -> f64 {
        let to = eye - self.place;
        (to.dot(self.smooth.as_dvec3()) / to.length()).max(0.0) / to.length_squared()
    }
}
