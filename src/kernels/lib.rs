//! The fields and the dynamics of `colvis`, which re-exports them: plain functions and data, without an entity-component-system and
//! without pictures.

#[cfg(test)]
#[path = "../../tests/support/checks.rs"]
mod checks;
pub mod dynamics;
pub mod fields;
#[cfg(test)]
#[path = "../../tests/support/shared.rs"]
mod shared;

#[cfg(test)]
pub(crate) use colvis_phantom as phantom;
#[doc(hidden)]
pub use colvis_scan::{error, math, output, progress, volume};
