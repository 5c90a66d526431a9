//! Rays through a scan: how far the wall is, and the picture of it (the paper's section 2.2).
//!
//! The parts can be exchanged one by one, and are put together at compile time:
//! [`space`] is the volume made ready, [`flags`] tell where nothing is to be seen, [`ray`] finds where a ray meets the
//! wall.

pub mod flags;
pub mod ray;
pub mod space;

pub use ray::{first_crossing, first_crossing_counted, value};
pub use space::{Space, Wall};
