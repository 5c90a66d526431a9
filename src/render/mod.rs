//! Ray casting in a scan: distances to the wall, and pictures of it (the paper's section 2.2).
//!
//! A ray caster consists of independent parts, chosen at compile time. A [`Sampler`](sampler::Sampler) evaluates the
//! volume at a point, a [`Skipper`](skip::Skipper) selects the samples that can be left out, and a [`Shader`] colours
//! the wall. [`caster`] combines them along each [`Ray`](march::Ray). Separately from pictures, [`space`](crate::space) finds
//! exactly where a ray meets the wall.
//!
//! There are two extension points. A [`Preset`] makes a [`Renderer`] ([`presets`] has those of this crate), and a
//! [`Camera`] defines the rays of its image ([`camera`]).

pub mod adaptive;
pub mod begin;
pub mod bytes;
pub mod camera;
pub mod caster;
pub mod checked;
pub mod choices;
pub mod classify;
pub mod coverage;
pub mod direct;
pub mod enlarge;
pub mod factory;
pub mod frame;
pub mod gradient_cache;
pub mod gradient_store;
pub mod leap;
pub mod light;
pub mod low;
pub mod march;
pub mod memory;
pub mod options;
pub mod packets;
pub mod preset;
pub mod presets;
pub mod quality;
pub mod regression;
pub mod renderer;
pub mod reuse;
pub mod sampler;
pub mod shaders;
pub mod single;
pub mod skip;
pub mod slice;
pub mod transfer;

#[cfg(test)]
mod extremes_tests;
#[cfg(test)]
mod tissue_tests;

pub use crate::space::{PreparedVolume, TransferFunction, first_crossing};
pub use camera::{Camera, CameraModel, CameraRay, Origins, View};
pub use caster::{depths, render};
pub use choices::{Choices, GradientSource, Leaping, LowDetail};
pub use coverage::{Coverage, coverage};
pub use direct::Direct;
pub use factory::renderer;
pub use frame::{Frame, Work, psnr};
pub use light::Light;
pub use memory::MemoryPart;
pub use options::Options;
pub use preset::{Preparation, Preset, Reuse};
pub use quality::{Classification, Quality, Settings};
pub use renderer::{Detail, Renderer};
pub use shaders::{Shader, ShaderModel, SurfacePoint};
