//! The foundation of `colvis`, which re-exports it: errors, numbers, output files, progress, and volumes with their files. It knows
//! nothing of flights and pictures.

pub mod error;
pub mod math;
#[doc(hidden)]
pub mod memory;
pub mod output;
#[doc(hidden)]
pub mod panics;
pub mod progress;
pub mod volume;
