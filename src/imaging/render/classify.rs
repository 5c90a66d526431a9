//! Lookups of the value that determines opacity.

use glam::Vec3;

use super::sampler::Sampler;

/// Looks up the value that determines opacity.
pub trait Classifier: Sync {
    /// A sample depends only on voxels closer than this along every axis, voxels.
    const REACH: f32;

    /// Returns the value at `q` in HU, and the gradient if it is free to compute.
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
