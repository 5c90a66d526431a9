//! Tentacles and mines in two dimensions (paper, figure 6): a drawn lumen and the same kernels as in the scan, one dimension lower.
//!
//! The drawing is in the plane z = 0: x points right and y down, [`drawing::MM_PER_PIXEL`] mm per pixel, with the origin
//! at the upper left corner. Steering, mines, body, the step that cannot perforate and trap detection come from
//! [`crate::dynamics`]. Only two things differ: tentacles are spread over a circle
//! ([`crate::dynamics::tentacles::circle`]) and walls are pixels ([`walls::Walls`]).

pub mod drawing;
mod files;
pub mod flight;
#[doc(hidden)]
pub mod picture;
#[doc(hidden)]
pub mod plan;
pub(crate) mod potential;
pub mod shipped;
mod walls;

pub use drawing::Drawing;
pub use flight::{Flight, PlaneSettings, State};
pub use plan::Plan;
pub use walls::Walls;

pub(crate) use colvis_flight::components;
pub(crate) use colvis_imaging::render;
pub(crate) use colvis_kernels::{dynamics, fields};
pub(crate) use colvis_scan::{error, math, output};
