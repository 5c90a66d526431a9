//! Translucency: the wall takes the colour of what lies behind it, so that tag, fat, soft tissue and gas are told apart at a glance.
//!
//! Use it after a picture has been made: [`Translucency::paint`] finds the colour of each cell that the wall crosses, once, and
//! colours the pixels ([`wall_paint`](super::wall_paint)). [`TranslucencySettings`] is the table of HU ranges with their colours. The
//! tests of this module state what a path of known values looks like.
//!
//! The values are those of the scan as it is. Behind a cleansed wall, a layer of less than 3 mm that was taken out in front of it
//! counts as a part of it: it would have been seen.
//!
//! The idea is the translucency of clinical software for CT colonography: Pickhardt, *Translucency rendering in 3D endoluminal CT
//! colonography: a useful tool for increasing polyp specificity and decreasing interpretation time*, AJR 2004.

mod behind;
mod tissues;

#[cfg(test)]
mod tests;

use fearless_simd::Level;

use super::Frame;
use super::wall_paint::{Cover, PaintedArea, Pictured, WallPainter};
use behind::Behind;

pub use tissues::{TissueRange, TranslucencySettings};

/// How much of the picture's own colour is covered: as much wherever something is known.
const COVER: Cover = Cover { most: 0.9, full_at: 0.03 * Cover::ALL };

/// Colours walls by what lies behind them. Reuse it: what it has found stays as long as it paints pictures of the same volumes.
#[derive(Debug)]
pub struct Translucency {
    settings: TranslucencySettings,
    painter: WallPainter,
    level: Level,
}

impl Clone for Translucency {
    /// The clone has found nothing yet.
    fn clone(&self) -> Self {
        Self::with_level(self.settings.clone(), self.level)
    }
}

impl Translucency {
    /// Creates one with these settings, which are [in range](TranslucencySettings::in_range).
    pub fn new(settings: TranslucencySettings) -> Self {
        Self::with_level(settings, Level::new())
    }

    /// Like [`Translucency::new`], on a given SIMD level.
    #[doc(hidden)]
    pub fn with_level(settings: TranslucencySettings, level: Level) -> Self {
        Self { settings, painter: WallPainter::new(level), level }
    }

    /// Returns the settings.
    pub fn settings(&self) -> &TranslucencySettings {
        &self.settings
    }

    /// Colours the wall in `area` of a picture, whose size is that of its view. Bytes are the same for every number of threads.
    ///
    /// Leaves the picture alone if its volume has a single voxel along an axis, or too many for packets of rays.
    pub fn paint(&mut self, of: Pictured<'_>, area: PaintedArea, frame: &mut Frame) {
        let scanned = of.scanned.map(|s| &**s);
        let Some(behind) = Behind::new(of.volume, scanned, &self.settings, self.level) else { return };
        self.painter.paint(of, area, (&behind, COVER), frame);
    }

    /// Returns the memory in use, bytes.
    pub fn bytes(&self) -> usize {
        self.painter.bytes()
    }
}
