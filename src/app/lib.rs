//! Scans, scenes and flights: the interface for programs that fly.
//!
//! [`Scan`] opens a file and makes a [`FlightApp`] of it, with the plugins and settings that a [`Scene`] lists. The owner of the
//! flight steps it, renders its view, and passes on the operator's commands.

#[doc(hidden)]
pub mod boxed;
#[doc(hidden)]
pub mod catalog;
#[doc(hidden)]
pub mod coats;
#[doc(hidden)]
pub mod colon;
pub mod explain;
pub mod findings;
#[doc(hidden)]
pub mod flight;
pub(crate) mod flight_fields;
#[doc(hidden)]
pub mod found;
pub mod graft;
mod images;
mod lines;
#[doc(hidden)]
pub mod look;
pub mod overlay;
pub mod overlays;
pub mod plan;
#[doc(hidden)]
pub mod scan;
pub(crate) mod scene;
mod scene_file;
pub mod study;
mod timings;

pub use catalog::Catalog;
pub use flight::{CommandRecord, Covered, FlightApp, ReviewRounds, Setup, Survey, TourFlown, TourPlan, Views};
pub use flight_fields::Fields;
pub use images::{ImageSettings, RenderSettings};
pub use overlay::{Canvas, Overlay};
pub use plan::{FlightRequest, Place, Plan};
pub use scan::{OpenOptions, Scan};
pub use scene::{Scene, SceneOptions, Steering};
pub use timings::Timings;

#[cfg(test)]
#[path = "../../tests/support/scans.rs"]
mod scans;
#[cfg(test)]
#[path = "../../tests/support/shared.rs"]
mod shared;
#[cfg(test)]
#[path = "../../tests/support/skips.rs"]
mod skips;

// The examples in the docs name this crate as `colvis` does.
#[doc(hidden)]
pub extern crate self as app;
#[doc(hidden)]
pub use colvis_flight::{components, coverage, schedule, systems, testing};
#[doc(hidden)]
pub use colvis_imaging::{polyps, render, space, surface};
#[doc(hidden)]
pub use colvis_kernels::{dynamics, fields};
#[doc(hidden)]
pub use colvis_phantom as phantom;
#[doc(hidden)]
pub use colvis_scan::{error, math, output, panics, progress, volume};
