//! Coverage: the share of the colon's wall, by area, that a flight has seen, and what it has missed.
//!
//! The wall is the surface at the middle of the opacity ramp of the gas that is flown, in triangles ([`Wall`]). A triangle is seen from
//! a view if its centroid is within [`REACH_MM`] and inside the picture, its normal is less than [`FLATTEST_DEGREES`] from the line to
//! the camera, and that line, ended half a voxel before the centroid, crosses no wall ([`Wall::seen`]). Patches of the wall that share
//! edges and were not seen are [`missed`], and [`tour`] orders them for a review.
//!
//! Where tagged fluid was not cleansed, its surface is wall: it is what a reader sees. Where a window shows another scan than the one
//! that is flown through, its wall counts ([`LiveCoverage::beside`]).

mod beside;
mod live;
pub mod missed;
mod paint;
#[doc(hidden)]
pub mod part;
mod sight;
mod still;
mod stretches;
pub mod tour;
mod wall;

pub use live::{LiveCoverage, sight_camera};
pub use missed::{LookFrom, Missed, Scans};
pub use paint::{CoveragePaint, INK, OVER, paint_slice};
pub use sight::{Coverage, FLATTEST_DEGREES, REACH_MM, Sight};
pub use still::VIEWS_AT_ONCE;
pub use wall::Wall;

#[cfg(test)]
mod tests;
