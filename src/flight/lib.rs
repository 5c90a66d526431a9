//! The flights of `colvis`, which re-exports them: the data that entities carry, the schedule, all systems, and the coverage of the wall.

pub mod components;
pub mod coverage;
pub mod schedule;
#[expect(
    clippy::needless_pass_by_value,
    clippy::type_complexity,
    reason = "a system takes its parameters by value, and its queries are types that list what it touches"
)]
#[path = "../../systems/mod.rs"]
pub mod systems;
pub mod testing;

#[doc(hidden)]
pub use colvis_imaging::{render, space, surface};
#[doc(hidden)]
pub use colvis_kernels::{dynamics, fields};
#[doc(hidden)]
pub use colvis_scan::{error, math, output, panics, progress, volume};
