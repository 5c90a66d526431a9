//! Rays through a scan: how far the wall is, and the picture of it (the paper's section 2.2).
//!
//! A ray caster is put together from parts that know nothing of each other, chosen at compile time: a
//! [`Sampler`](sampler::Sampler) says what a place is like, a [`Skipper`](skip::Skipper) which samples need not be
//! looked at, a [`Shader`](shade::Shader) what the wall looks like; [`caster`] joins them along each
//! [`Ray`](march::Ray). Apart from pictures, [`ray`] finds where a ray meets the wall, exactly.

pub mod adaptive;
pub mod begin;
pub mod bytes;
pub mod camera;
pub mod caster;
pub mod classify;
pub mod coverage;
pub mod enlarge;
pub mod fast;
pub mod flags;
pub mod frame;
pub mod gradient;
pub mod gradients;
pub mod leap;
pub mod low;
pub mod march;
pub mod quality;
pub mod ray;
pub mod renderer;
pub mod reuse;
pub mod sampler;
pub mod shade;
pub mod skip;
pub mod space;
pub mod transfer;

#[cfg(test)]
mod extremes_tests;

pub use camera::View;
pub use caster::render;
pub use coverage::{Coverage, coverage};
pub use frame::{Frame, Work, psnr};
pub use quality::{Classification, Preset, Quality, Settings};
pub use ray::{first_crossing, first_crossing_counted, value};
pub use renderer::{Detail, Direct, Renderer, renderer};
pub use space::{PreparedVolume, TransferFunction};
