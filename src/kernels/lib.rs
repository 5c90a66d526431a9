//! The fields and the dynamics of `colvis`, which re-exports them: plain functions and data, without an entity-component-system and
//! without pictures.

pub mod dynamics;
pub mod fields;

#[cfg(test)]
pub(crate) use colvis_phantom as phantom;
#[doc(hidden)]
pub use colvis_scan::{error, math, output, progress, volume};
