//! Rays through a scan: how far the wall is, and the picture of it (the paper's section 2.2).
//!
//! The parts can be exchanged one by one, and are put together at compile time: a [`sampler`] says what a place is
//! like, a [`skip`]per which samples need not be looked at, a [`shade`]r what the wall looks like; [`caster`] joins them
//! along each [`march`]ing ray. [`ray`] finds where a ray meets the wall, exactly and without a picture.

pub mod camera;
pub mod caster;
pub mod flags;
pub mod frame;
pub mod gradient;
pub mod march;
pub mod quality;
pub mod ray;
pub mod sampler;
pub mod shade;
pub mod skip;
pub mod space;
pub mod transfer;

pub use camera::View;
pub use caster::render;
pub use frame::{Frame, Work, psnr};
pub use quality::{Classification, Quality, Settings};
pub use ray::{first_crossing, first_crossing_counted, value};
pub use space::{Space, Wall};
