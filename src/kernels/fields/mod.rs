//! Fields and structures for navigation, computed from a volume: the lumen, distances to wall and target, centerlines.
//! Each is computed only when a scene needs it.

mod along;
pub mod centerline;
pub mod cleanse;
#[doc(hidden)]
pub mod clearance;
pub mod connection;
#[doc(hidden)]
pub mod distance;
pub mod frames;
pub mod harmonic;
pub mod lumen;
pub mod matching;
mod neighbours;
mod sample;
mod target;
mod values;
pub mod voxels;
#[doc(hidden)]
pub mod wall;

pub use along::{Along, AlongColon};
pub use centerline::{Centerline, CenterlineMethod};
pub use clearance::{Clearance, ClearanceFinder, Clearances};
pub use connection::Connection;
pub use distance::{Through, WallDistance};
pub use lumen::Lumen;
pub use sample::{Distance, Sample};
pub use target::{BodyClearance, TargetDistance};
use values::Values;
