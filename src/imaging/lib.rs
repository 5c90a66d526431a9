//! The pictures of `colvis`, which re-exports them: rays through volumes, renderers, surfaces, and what stands out of a surface.

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

#[doc(hidden)]
pub use colvis_kernels::fields;
#[cfg(test)]
pub(crate) use colvis_phantom as phantom;
#[doc(hidden)]
pub use colvis_scan::{error, math, output, panics, progress, volume};
