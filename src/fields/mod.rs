//! What is computed from a volume for navigation, each only when a scene asks for it.

pub mod clearance;
pub mod lumen;

pub use clearance::{Clearance, ClearanceFinder};
pub use lumen::Lumen;
