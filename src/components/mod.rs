//! What the entities of a flight carry.
//!
//! There is one scan entity ([`scan`]) and one camera entity ([`camera`], [`guide`], [`flight`], [`trail`]). A component that
//! no plugin asked for is on no entity.

pub mod camera;
pub mod clock;
pub mod flight;
pub mod guide;
pub mod input;
pub mod output;
pub mod play;
pub mod scan;
pub mod slices;
pub mod trail;
