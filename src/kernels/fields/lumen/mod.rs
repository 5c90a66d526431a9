//! The colon's interior: from HU to gas and tagged fluid, in segments from rectum to cecum.
//!
//! Gas is at or below the wall's middle ([`GAS_HU`]). Connected gas is found at [`CORE_HU`], where a thin wall between
//! two loops still separates them, and then grown to the wall's middle. Outside air, gas around the patient and lungs
//! are recognised by position and texture (see `choose`). Everything is stored as runs along the index x axis, so no
//! field of the volume's size is created.

mod bodies;
mod cells;
mod choose;
mod ends;
mod find;
mod fluid;
pub(in crate::fields) mod frame;
mod graph;
mod grow;
mod interior;
mod judgement;
mod kinds;
mod map;
mod model;
mod names;
mod not_colon;
mod order;
mod others;
mod paged;
mod position;
pub(in crate::fields) mod residue;
pub(in crate::fields) mod runs;
mod segment;
mod septa;
mod shell;
mod solid;
mod stretches;
#[cfg(test)]
mod tests;

pub use find::{find, find_told, gas_at, gas_near};
pub use interior::Interior;
pub use kinds::{Chain, Considered, Features, GasKind, Judged, Landmarks, RULES, Rule, judge};
pub use map::{GasBody, KindMap};
pub(in crate::fields) use model::AsScanned;
pub use model::{Lumen, Told};
pub use names::{NAMES, Names, Part};
pub use not_colon::not_colon;
pub use others::{Other, Others};
pub use position::Lying;
pub use residue::{Remnant, Residue, residue};
pub use segment::Segment;
pub use shell::WallArea;
pub use stretches::CoarseAlong;

/// A voxel at or below this is gas, HU: the middle of the wall's opacity ramp.
pub const GAS_HU: i16 = -650;
/// Gas connects at or below this, HU: the foot of the opacity ramp. A one-voxel wall between two loops is blurred to a
/// value in between and must not let the camera through.
pub const CORE_HU: i16 = -800;
/// Tissue is brighter than this, HU: between fat (−120) and lung.
const TISSUE_HU: i16 = -300;
/// Maximum growth of the gas from its core to the wall's middle, voxels.
const GROWTH: usize = 3;
/// Maximum distance of the lumen from a given point, mm.
const SNAP_MM: f64 = 5.0;
