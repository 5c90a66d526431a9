//! What is computed from a volume for navigation, each only when a scene asks for it.

pub mod clearance;
pub mod lumen;
pub mod sample;

pub use clearance::{Clearance, ClearanceFinder, Clearances};
pub use lumen::Lumen;
pub use sample::{Distance, Sample};
