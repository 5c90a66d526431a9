//! A piece of the colon's gas.

use glam::DVec3;

use super::kinds::Judged;

/// A connected piece of the colon's gas, with the fluid in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Volume of gas, ml.
    pub ml: f64,
    /// Volume of tagged fluid, ml. A pool shared by several segments counts towards the one with the longest interface.
    pub fluid_ml: f64,
    /// Minimum and maximum world coordinates of the gas voxels' centres, mm.
    pub bounds_mm: [DVec3; 2],
    /// The rectal end, then the cecal one: centres of good inscribed balls in the gas near the lumen's two ends, world, mm.
    pub ends: [DVec3; 2],
    /// Other segments joined to this one by tagged fluid.
    pub joined_to: Vec<usize>,
    /// Length from end to end along the lumen, mm; accurate to about a tenth.
    pub length_mm: f64,
    /// The coarse way from end to end, world, mm.
    pub way: Vec<DVec3>,
    /// Why it is, or may be, colon; `None` if the gas was not classified.
    pub judged: Option<Judged>,
}
