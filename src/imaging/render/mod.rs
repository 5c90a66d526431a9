//! Ray casting in a scan: distances to the wall, and pictures of it (the paper's section 2.2).
//!
//! A ray caster consists of independent parts, chosen at compile time. A `Sampler` evaluates the volume at a point, a
//! `Skipper` selects the samples that can be left out, and a [`Shader`] colours the wall. `caster` combines them along
//! each `Ray`. Separately from pictures, [`space`](crate::space) finds exactly where a ray meets the wall.
//!
//! There are two extension points. A [`Preset`] makes a [`Renderer`] ([`presets`] has those of this crate), and a
//! [`Camera`] defines the rays of its image ([`camera`]).

mod accelerations;
#[doc(hidden)]
pub mod adaptive;
#[doc(hidden)]
pub mod awake;
#[doc(hidden)]
pub mod begin;
#[doc(hidden)]
pub mod bytes;
pub mod camera;
#[doc(hidden)]
pub mod caster;
mod checked;
pub mod choices;
#[doc(hidden)]
pub mod classify;
mod density_scale;
mod direct;
mod distances;
mod enlarge;
mod factory;
mod frame;
mod gather;
mod gradient_cache;
#[doc(hidden)]
pub mod gradient_store;
#[doc(hidden)]
pub mod leap;
mod light;
mod low;
mod march;
mod memory;
mod normals;
#[doc(hidden)]
pub mod options;
#[doc(hidden)]
pub mod packets;
mod preset;
pub mod presets;
mod quality;
#[doc(hidden)]
pub mod regression;
pub(crate) mod renderer;
#[doc(hidden)]
pub mod reuse;
#[doc(hidden)]
pub mod sampler;
pub mod shaders;
#[doc(hidden)]
pub mod single;
mod skip;
pub mod slice;
pub(crate) mod transfer;
pub mod translucency;
pub mod wall_paint;
#[doc(hidden)]
pub mod words;

#[cfg(test)]
mod extremes_tests;
#[cfg(test)]
mod tissue_tests;

pub use crate::space::{PreparedVolume, TransferFunction, first_crossing};
pub use adaptive::Budget;
pub use camera::{Camera, CameraModel, CameraRay, Origins, Sixteen, View};
#[doc(hidden)]
pub use caster::crossings;
pub use caster::{depths, render};
pub use choices::{Choices, GradientSource, Leaping, LowDetail};
pub use direct::Direct;
pub use distances::Distances;
pub use factory::renderer;
pub use frame::{Frame, ImageSize, Work, psnr};
pub use light::Light;
pub use memory::MemoryPart;
#[doc(hidden)]
pub use normals::normal_at;
pub use normals::normals;
pub use options::Options;
pub use preset::{Preparation, Preset, Reuse};
pub use quality::{Classification, Quality, Settings};
pub use renderer::{Detail, Renderer, SQUARE};
pub use shaders::{Shader, ShaderModel, SurfacePoint};

/// Parts of the ray caster for this crate's benches and integration tests, with the types in their signatures. They may
/// change at any time.
#[doc(hidden)]
pub mod internals {
    pub use super::accelerations::Accelerations;
    pub use super::begin::{Begin, FromScratch};
    pub use super::bytes::{ByteNearest, ByteTrilinear, ByteVolume};
    pub use super::caster::ImageRequest;
    pub use super::classify::{ByDensity, ByValue, Classifier};
    pub use super::gradient_cache::GradientCache;
    pub use super::gradient_store::{FitSampler, Fits, GradientVolume, Stored};
    pub use super::leap::chosen::{ChosenLeap, ChosenRadius, ChosenWalk};
    pub use super::leap::{BrickLeap, BrickWalls, EmptyRadius, Leaper, Surroundings, VoxelLeap, VoxelWalls};
    pub use super::march::{Ray, Step};
    pub use super::packets::{PacketRenderer, Pixels, levels};
    pub use super::regression::{Fit, Regression, Weighting, block, central_differences, to_world};
    pub use super::reuse::known::{Empty, Known, Reprojection};
    pub use super::reuse::paper::Trace;
    pub use super::reuse::{Refresh, Reusing, Rule, VoxelStorage, WordStorage};
    pub use super::sampler::{Nearest, Sampler, Trilinear, VoxelSampler};
    pub use super::skip::{Bricks, Everything, Leap, Skipper};
}
