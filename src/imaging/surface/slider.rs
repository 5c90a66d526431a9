//! A vertex on an edge of the grid, whose position is being determined.

use glam::Vec3;

/// Vertices keep this share of their edge's length from its ends. Two vertices on edges that meet in a voxel therefore
/// never coincide, and no triangle degenerates to a line or a point.
pub(super) const KEEP_OFF: f32 = 0.02;

/// A vertex whose position is being determined: on the grid's edge from `base`, at the share `t` along `axis`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slider {
    /// The vertex's number.
    pub vertex: u32,
    /// Offset of the edge's lower voxel, mm.
    pub base: Vec3,
    /// Axis of the edge.
    pub axis: u8,
    /// Position along the edge, as a share of its length.
    pub t: f32,
}

impl Slider {
    /// Returns its position, an offset in mm. `steps` are the vectors along the grid's edges.
    pub(crate) fn place(&self, steps: &[Vec3; 3]) -> Vec3 {
        self.base + self.t * steps[usize::from(self.axis)]
    }
}
