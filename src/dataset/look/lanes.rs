//! Sixteen pixels whose numbers are computed together.

/// Pixels that are lit at once.
pub(super) const LANES: usize = 16;
/// A number of each pixel.
pub(super) type Lanes = [f32; LANES];
