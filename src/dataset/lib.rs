//! The datasets of `colvis`, which re-exports them.

#[path = "mod.rs"]
pub mod dataset;

pub(crate) use colvis_imaging::{render, space, surface};
pub(crate) use colvis_kernels::fields;
pub(crate) use colvis_scan::{error, math, output, progress, volume};
