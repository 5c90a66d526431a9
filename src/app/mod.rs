//! Scans, scenes and flights: the interface for programs that fly.
//!
//! [`Scan`] opens a file and makes a [`FlightApp`] of it, with the plugins and settings that a [`Scene`] lists. The owner of the
//! flight steps it, renders its view, and passes on the operator's commands.

pub mod catalog;
pub mod explain;
pub mod fields;
pub mod flight;
mod images;
mod lines;
pub mod overlay;
pub mod overlays;
pub mod plan;
pub mod scan;
pub mod scene;
pub mod timings;

pub use catalog::Catalog;
pub use flight::FlightApp;
pub use images::{ImageSettings, RenderSettings};
pub use overlay::{Canvas, Overlay};
pub use plan::{FlightRequest, Place, Plan};
pub use scan::{OpenOptions, Scan};
pub use scene::{Scene, Steering};
pub use timings::Timings;
