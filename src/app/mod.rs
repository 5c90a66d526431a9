//! Scans, scenes and flights: the interface for programs that fly.
//!
//! [`Scan`] opens a file and makes a [`FlightApp`] of it, with the plugins and settings that a [`Scene`] lists. The owner of the
//! flight steps it, renders its view, and passes on the operator's commands.

pub(crate) mod catalog;
pub(crate) mod colon;
pub mod explain;
pub(crate) mod fields;
pub(crate) mod flight;
mod images;
mod lines;
pub(crate) mod look;
pub mod overlay;
pub mod overlays;
pub mod plan;
pub(crate) mod scan;
pub(crate) mod scene;
mod timings;

pub use catalog::Catalog;
pub use fields::Fields;
pub use flight::{CommandRecord, Covered, FlightApp, ReviewRounds, Setup, Survey, TourFlown, TourPlan, Views};
pub use images::{ImageSettings, RenderSettings};
pub use overlay::{Canvas, Overlay};
pub use plan::{FlightRequest, Place, Plan};
pub use scan::{OpenOptions, Scan};
pub use scene::{Scene, SceneOptions, Steering};
pub use timings::Timings;
