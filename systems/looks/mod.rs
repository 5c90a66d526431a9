//! Where the camera looks while a guide flies it, one file each.

pub mod ahead;
pub mod way;

use crate::schedule::Look;

/// Every look of this crate.
pub const BUILT_IN: [Look; 2] = [ahead::LOOK, way::LOOK];
