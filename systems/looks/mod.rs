//! Where the camera looks while a guide flies it, one file each.

pub mod ahead;
pub mod review;
pub mod way;

use crate::schedule::Look;

/// Every look of this crate that a scene may choose. A [`review`] brings its own.
pub const BUILT_IN: [Look; 2] = [ahead::LOOK, way::LOOK];
