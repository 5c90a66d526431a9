//! A triangle mesh of the wall, laid out for a rasteriser.

use glam::{DVec3, Vec3};

/// A group of neighbouring triangles: those of 4×4×4 cells, with a bounding ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Centre of the ball, mm from the mesh's origin in world directions.
    pub centre: Vec3,
    /// Radius of the ball, mm.
    pub radius: f32,
    /// Index of the first triangle.
    pub first: u32,
    /// Number of triangles.
    pub count: u32,
}

/// A closed mesh of the wall.
///
/// Triangles share vertices by index. Positions are single-precision offsets (mm, world directions) from an origin near
/// the volume, so that no precision is lost if the patient is far from the world's origin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    pub(super) origin: DVec3,
    pub(super) places: Vec<Vec3>,
    pub(super) normals: Vec<Normal>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) blocks: Vec<Block>,
}

impl Mesh {
    /// Returns the origin of [`Mesh::places`] and of the blocks, world mm.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Returns the vertices, mm from [`Mesh::origin`] in world directions.
    pub fn places(&self) -> &[Vec3] {
        &self.places
    }

    /// Returns the world position of a vertex, mm.
    pub fn world(&self, vertex: u32) -> DVec3 {
        self.origin + self.places[vertex as usize].as_dvec3()
    }

    /// Returns the unit normal at a vertex (world), which points into the tissue. It comes from the volume's gradient
    /// there, and is zero where the gradient is zero.
    pub fn normal(&self, vertex: u32) -> Vec3 {
        self.normals[vertex as usize].vector()
    }

    /// Returns the triangles, three vertices each, counter-clockwise as seen from the gas.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Returns the blocks of triangles.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.places.as_slice())
            + size_of_val(self.normals.as_slice())
            + size_of_val(self.triangles.as_slice())
            + size_of_val(self.blocks.as_slice())
    }
}

/// A unit vector in four bytes, by the octahedral map (Cigolle et al. 2014), accurate to 0.003°.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Normal([i16; 2]);

impl Normal {
    /// No direction.
    pub(crate) const NONE: Self = Self([i16::MIN; 2]);

    /// Encodes the direction of `v`, or [`Normal::NONE`] if it has none.
    pub(crate) fn new(v: Vec3) -> Self {
        let sum = v.abs().element_sum();
        if !(sum > 0.0 && sum.is_finite()) {
            return Self::NONE;
        }
        let v = v / sum;
        let fold = |a: f32, b: f32| if v.z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
        Self([fold(v.x, v.y), fold(v.y, v.x)].map(|c| (c * 32767.0).round() as i16))
    }

    /// Returns the unit vector, or zero for [`Normal::NONE`].
    #[inline]
    pub(crate) fn vector(self) -> Vec3 {
        if self == Self::NONE {
            return Vec3::ZERO;
        }
        let [x, y] = self.0.map(|c| f32::from(c) / 32767.0);
        let z = 1.0 - x.abs() - y.abs();
        let unfold = |a: f32, b: f32| if z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
        Vec3::new(unfold(x, y), unfold(y, x), z).normalize_or_zero()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;

    #[test]
    fn a_normal_survives_four_bytes() {
        for n in 0..20_000 {
            let v = Vec3::from_array([0, 1, 2].map(|k| hash::uniform(n, k) as f32 - 0.5)).normalize();
            let angle = v.as_dvec3().angle_between(Normal::new(v).vector().as_dvec3()).to_degrees();
            assert!(angle < 0.004, "{v}: {angle}");
        }
        for axis in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
            assert_eq!(Normal::new(axis).vector(), axis);
        }
        for none in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
            assert_eq!(Normal::new(none).vector(), Vec3::ZERO);
        }
    }
}
