//! The components of a flight's entities.
//!
//! There is one scan entity ([`scan`]) and one camera entity ([`camera`], [`guide`], [`flight`], [`trail`], [`still`]). A component
//! that no plugin requests is not added to any entity.

pub mod camera;
pub mod clock;
pub mod coats;
pub mod flight;
pub mod guide;
pub mod input;
pub mod output;
pub mod play;
pub mod review;
pub mod scan;
pub mod slices;
pub mod still;
pub mod trail;
pub mod translucent;
