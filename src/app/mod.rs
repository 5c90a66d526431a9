//! Scenes and flights: which plugins make up a flight, and the flight itself over the two schedules.

pub mod explain;
pub mod fields;
pub mod flight;
pub mod plan;
pub mod scene;
pub mod trail;

pub use flight::FlightApp;
pub use scene::{Guide, Scene};
