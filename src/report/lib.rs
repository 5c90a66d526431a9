//! The reports of `colvis`, which re-exports them.

#[path = "mod.rs"]
pub mod report;
#[cfg(test)]
#[path = "../../tests/support/shared.rs"]
mod shared;

pub(crate) use colvis_app as app;
pub(crate) use colvis_flight::{components, coverage, schedule, systems};
pub(crate) use colvis_imaging::{polyps, render, space, surface, unfold};
pub(crate) use colvis_kernels::{dynamics, fields};
pub(crate) use colvis_phantom as phantom;
pub(crate) use colvis_plane as plane;
pub(crate) use colvis_scan::{error, math, memory, output, progress, volume};
