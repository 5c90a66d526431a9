//! Detectors: each is one file and a line in [`BUILT_IN`].

mod curvature;
mod protrusion;
mod shape;

use super::Detector;

/// Every detector of this crate; the first is the default.
pub const BUILT_IN: [Detector; 3] = [shape::DETECTOR, protrusion::DETECTOR, curvature::DETECTOR];
