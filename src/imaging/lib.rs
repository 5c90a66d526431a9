//! The imaging of `colvis`, which re-exports it: rays through volumes, renderers, surfaces, and polyp candidates.

#[cfg(test)]
#[path = "../../tests/support/checks.rs"]
mod checks;
pub mod polyps;
pub mod render;
#[cfg(test)]
#[path = "../../tests/support/shared.rs"]
mod shared;
pub mod space;
pub mod surface;
pub mod unfold;

#[doc(hidden)]
pub use colvis_kernels::fields;
#[cfg(test)]
pub(crate) use colvis_phantom as phantom;
#[doc(hidden)]
pub use colvis_scan::{error, math, output, panics, progress, volume};
