//! What cleansing takes out of a colon, and what it leaves.

use std::fmt;

use glam::DVec3;

use super::changes::Changes;

/// A scan's colon without tag.
#[derive(Clone, Debug, Default)]
pub struct Cleansed {
    /// The values around what was taken out; some are as they were.
    pub changes: Changes,
    /// The pools that were taken out.
    pub pools: Vec<CleansedPool>,
    /// Volume of the films and the stool that were taken out, ml.
    pub residue_ml: f64,
    /// Volume of all tag that was taken out, ml.
    pub replaced_ml: f64,
    /// Tag that was left.
    pub left: Vec<Left>,
    /// Standard deviation of the scan's blur, mm; 0 without tagged fluid, where it is not used.
    pub blur_mm: f64,
}

/// Tag that was not taken out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Left {
    /// Volume, ml.
    pub ml: f64,
    /// Why.
    pub why: &'static str,
}

impl fmt::Display for Cleansed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.changes.is_empty() {
            return f.write_str("the colon contains no tagged fluid or stool: the scan is unchanged");
        }
        let pools = self.pools.len();
        write!(f, "removed {:.1} ml of tagged fluid and stool: {pools} ", self.replaced_ml)?;
        f.write_str(if pools == 1 { "pool" } else { "pools" })?;
        if self.residue_ml > 0.0 {
            write!(f, " and {:.1} ml of films and stool", self.residue_ml)?;
        }
        let left: f64 = self.left.iter().map(|l| l.ml).sum();
        if left > 0.05 { write!(f, "; {left:.1} ml remain") } else { Ok(()) }
    }
}

/// A pool that was taken out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CleansedPool {
    /// Volume of the fluid, ml.
    pub ml: f64,
    /// Mean HU of its tag.
    pub tag_hu: f64,
    /// A point of its level and the unit normal, upwards; world.
    pub level: [DVec3; 2],
}
