//! What the opacity of a place is looked up by.

use glam::Vec3;

use super::sampler::Sampler;

/// Looks up the value that decides on opacity.
pub trait Classifier: Sync {
    /// A sample depends on voxels that are nearer than this along every axis, voxels.
    const REACH: f32;

    /// The value at `q`, HU, with the gradient where it comes for nothing.
    fn look<S: Sampler>(&self, sampler: &S, q: Vec3) -> (f32, Option<Vec3>);
}

/// [`Classification::Value`](super::Classification::Value).
pub struct ByValue;

impl Classifier for ByValue {
    const REACH: f32 = 1.0;

    #[inline(always)]
    fn look<S: Sampler>(&self, sampler: &S, q: Vec3) -> (f32, Option<Vec3>) {
        (sampler.value(q), None)
    }
}

/// [`Classification::Filtered`](super::Classification::Filtered).
pub struct ByDensity;

impl Classifier for ByDensity {
    const REACH: f32 = 2.0;

    #[inline(always)]
    fn look<S: Sampler>(&self, sampler: &S, q: Vec3) -> (f32, Option<Vec3>) {
        let fit = sampler.fit(q);
        (fit.density, Some(fit.gradient))
    }
}
