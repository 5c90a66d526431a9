//! Tentacles and mines in two dimensions (paper, figure 6): a drawn lumen, the same kernels as in the scan, one
//! dimension less.
//!
//! The drawing lies in the plane z = 0: x runs to the right and y downwards, [`drawing::MM_PER_PIXEL`] mm a pixel, with
//! the origin at the drawing's upper left corner. Steering, mines, body, the step that cannot perforate and the
//! detection of traps are those of [`crate::dynamics`]; only tentacles are spread over a circle
//! ([`crate::dynamics::tentacles::circle`]) and walls are pixels ([`walls::Walls`]).

pub mod drawing;
pub mod flight;
pub mod picture;
pub mod plan;
pub mod potential;
pub mod shipped;
pub mod walls;

pub use drawing::Drawing;
pub use flight::{Flight, PlaneSettings, State};
pub use walls::Walls;
