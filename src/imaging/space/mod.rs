//! Space as rays see it: a volume prepared for ray casting, and exact distances along a ray to the wall.
//!
//! Guides, tentacles and plans ask these questions as pictures do. [`ClearanceFinder`](crate::fields::ClearanceFinder)
//! answers the other one: how far the wall is in any direction.

#[doc(hidden)]
pub mod flags;
mod prepared_volume;
#[doc(hidden)]
pub mod ray;
pub(crate) mod surround;
mod transfer;

pub use flags::Flags;
pub use prepared_volume::PreparedVolume;
pub use ray::{first_crossing, first_crossing_counted, value};
pub use transfer::TransferFunction;
