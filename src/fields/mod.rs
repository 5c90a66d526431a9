//! What is computed from a volume for navigation, each only when a scene asks for it.

pub mod clearance;

pub use clearance::{Clearance, ClearanceFinder};
