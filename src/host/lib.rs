//! The hosts of `colvis`, which drive a flight headless or in a window. `colvis` re-exports them.

#[path = "mod.rs"]
pub mod host;
#[cfg(test)]
#[path = "../../tests/support/shared.rs"]
mod shared;

pub(crate) use colvis_app as app;
#[cfg(feature = "dicom")]
pub(crate) use colvis_dicom as dicom;
#[cfg(feature = "window")]
pub(crate) use colvis_flight::coverage;
#[cfg(test)]
pub(crate) use colvis_flight::testing;
pub(crate) use colvis_flight::{components, schedule, systems};
pub(crate) use colvis_imaging::render;
#[cfg(feature = "window")]
pub(crate) use colvis_imaging::{polyps, space, unfold};
#[cfg(feature = "window")]
pub(crate) use colvis_kernels::dynamics;
#[cfg(any(feature = "window", test))]
pub(crate) use colvis_kernels::fields;
#[cfg(test)]
pub(crate) use colvis_phantom as phantom;
pub(crate) use colvis_plane as plane;
#[cfg(any(feature = "window", test))]
pub(crate) use colvis_scan::volume;
pub(crate) use colvis_scan::{error, output, progress};
#[cfg(feature = "window")]
pub(crate) use colvis_scan::{math, panics};
