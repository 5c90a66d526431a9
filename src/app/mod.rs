//! Scans, scenes and flights: what a program uses that flies.
//!
//! [`Scan`] opens a file and makes a [`FlightApp`] of it, whose plugins and settings a [`Scene`] lists. Whoever has the flight
//! steps it, looks at it, and lets the operator act.

pub mod catalog;
pub mod explain;
pub mod fields;
pub mod flight;
mod images;
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
