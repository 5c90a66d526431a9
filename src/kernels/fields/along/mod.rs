//! Where a place is along the colon: the one measure that every command, panel and file uses.
//!
//! It is the distance along the centerline of the whole colon, from its rectal end, as `colvis centerline` writes it. Where two
//! segments of gas are joined by nothing, the line follows a guess, which is marked. Without a known order, each segment has a line
//! of its own.
//!
//! A place belongs to the stretch of the line that is nearest *through the lumen*, not through a wall: every cell of the lumen (see
//! [`centerline`](super::centerline)) takes the point of the line with the shortest path to it, and a place takes that of its nearest
//! voxel's cell. It is then as far along as the nearest point of the line within `NEAR_ALONG_MM` of that one. Beside a thin wall
//! between two limbs, or in a sharp bend, the nearest point in space may be another.

mod find;
mod model;

pub use model::{Along, AlongColon};
