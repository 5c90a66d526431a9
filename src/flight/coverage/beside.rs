//! The wall of a scan that is shown in place of the one that is flown through.
//!
//! A flight keeps the walls that it started with, while its pictures may show the cleansed scan. Coverage then counts the wall of
//! the scan on display: it includes the wall that lay under fluid, and not the surface of the fluid.

use std::sync::Arc;

use super::live::LiveCoverage;
use crate::error::Result;
use crate::fields::Lumen;
use crate::progress::Progress;
use crate::space::PreparedVolume;
use crate::volume::Volume;

impl LiveCoverage {
    /// Begins with nothing seen of the wall of `gas`, which was found in `volume`. Its views look through `shown`, the part of that volume
    /// around the gas, for as long as `flown` is flown through.
    ///
    /// # Errors
    /// As [`LiveCoverage::of`].
    pub fn beside(
        volume: &Volume,
        gas: &Arc<Lumen>,
        shown: PreparedVolume,
        flown: &Arc<Lumen>,
        progress: &Progress,
    ) -> Result<Self> {
        let mut coverage = Self::in_voxels(volume, shown.transfer().iso(), gas, progress)?;
        (coverage.beside, coverage.flown) = (Some(shown), Arc::clone(flown));
        Ok(coverage)
    }

    /// True if it belongs to another scan than the one that is flown through.
    pub fn is_beside(&self) -> bool {
        self.beside.is_some()
    }

    /// True if it was begun for a flight through this gas.
    pub fn belongs_to(&self, flown: &Arc<Lumen>) -> bool {
        Arc::ptr_eq(&self.flown, flown)
    }

    /// Returns the scan whose wall it is; `flown` is the one that is flown through.
    pub fn scan<'a>(&'a self, flown: &'a PreparedVolume) -> &'a PreparedVolume {
        self.beside.as_ref().unwrap_or(flown)
    }
}
