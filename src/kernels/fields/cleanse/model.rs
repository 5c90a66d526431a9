//! The result of cleansing: what was removed from a colon, and what remains.

use std::fmt;

use glam::DVec3;

use super::changes::Changes;

/// The result of cleansing a scan.
#[derive(Clone, Debug, Default)]
pub struct Cleansed {
    /// The new values in and around the removed tag; some are unchanged.
    pub changes: Changes,
    /// The pools that were removed.
    pub pools: Vec<CleansedPool>,
    /// Volume of the films and the stool that were removed, ml.
    pub residue_ml: f64,
    /// Volume of all tag that was removed, ml.
    pub replaced_ml: f64,
    /// Tag that remains.
    pub left: Vec<Left>,
    /// Standard deviation of the scan's blur, mm; 0 without tagged fluid, where it is not used.
    pub blur_mm: f64,
}

impl Cleansed {
    /// Returns what is known of the tag without the values: the pools and the blur.
    #[must_use]
    pub fn without_values(&self) -> Self {
        let Self { pools, residue_ml, replaced_ml, left, blur_mm, .. } = self;
        Self {
            changes: Changes::default(),
            pools: pools.clone(),
            residue_ml: *residue_ml,
            replaced_ml: *replaced_ml,
            left: left.clone(),
            blur_mm: *blur_mm,
        }
    }
}

/// Tag that was not removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Left {
    /// Volume, ml.
    pub ml: f64,
    /// The reason.
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

/// A pool that was removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CleansedPool {
    /// Volume of the fluid, ml.
    pub ml: f64,
    /// Mean HU of its tag.
    pub tag_hu: f64,
    /// A point of its level and the unit normal, upwards; world.
    pub level: [DVec3; 2],
}
