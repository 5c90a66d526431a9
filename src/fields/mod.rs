//! What is computed from a volume for navigation, each only when a scene asks for it.

pub mod centerline;
pub mod clearance;
pub mod distance;
pub mod drain;
pub mod lumen;
pub mod sample;
pub mod target;
pub mod voxels;

pub use centerline::Centerline;
pub use clearance::{Clearance, ClearanceFinder, Clearances};
pub use distance::{Through, WallDistance};
pub use lumen::Lumen;
pub use sample::{Distance, Sample};
pub use target::{TargetDistance, Traveller};
