//! The map of a colon laid flat, with its picture: coarse as a whole, then fine band by band.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;

use crate::error::{Error, Result};
use crate::host::window::clean::{Clean, Scanned};
use crate::progress::Progress;
use crate::unfold::{Band, Chart, Drawing, Sheet, Unfolding};

/// Rows and columns of the fine map for one of the coarse map, which takes a sixteenth of the time.
const COARSER: usize = 4;
/// The colour of a wall that was under tag, red, green and blue, and its share.
const TAG: [f32; 3] = [255.0, 255.0, 235.0];
const TAG_SHARE: f32 = 0.6;
/// Tag was in front of the wall if it was within this of it, mm.
const BEFORE_MM: f64 = 1.0;

/// A map with its picture.
pub(crate) struct FlatMap {
    pub(super) map: Unfolding,
    pub(super) rgb: Vec<[u8; 3]>,
    /// The same as scanned: with the colour of tag where tag was. `None` if there was none.
    pub(super) scanned: Option<Vec<[u8; 3]>>,
}

/// Some rows of a map with their picture.
pub(super) struct FlatBand {
    band: Band,
    rgb: Vec<[u8; 3]>,
    scanned: Option<Vec<[u8; 3]>>,
}

/// What becomes known of the map, in this order: the coarse one in the size of the fine one, so that a place of the panel stays what it is,
/// then each band of that.
pub(super) enum Piece {
    Map(FlatMap),
    Band(FlatBand),
}

/// Where along the colon a reader looks, mm: those bands are drawn first.
pub(super) struct Focus(AtomicU64);

impl Focus {
    pub(super) fn new() -> Self {
        Self(AtomicU64::new(f64::NAN.to_bits()))
    }

    pub(super) fn set(&self, mm: f64) {
        self.0.store(mm.to_bits(), Ordering::Relaxed);
    }

    fn get(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }
}

impl FlatBand {
    /// Returns the rows of the map that it shows.
    pub(super) fn rows(&self) -> std::ops::Range<usize> {
        self.band.rows.clone()
    }

    fn new(drawing: &Drawing<'_>, clean: &Clean, band: Band) -> Self {
        let rgb = drawing.picture(&band);
        let was_tag: Vec<bool> = band
            .wall()
            .map(|(point, inwards)| {
                let before = point.as_dvec3() - inwards.as_dvec3() * BEFORE_MM;
                !point.is_nan() && clean.before.is_restored(&clean.volume, before)
            })
            .collect();
        let scanned = was_tag.contains(&true).then(|| {
            let colour = |(colour, was_tag): (&[u8; 3], &bool)| {
                let share = if *was_tag { TAG_SHARE } else { 0.0 };
                std::array::from_fn(|n| (f32::from(colour[n]) * (1.0 - share) + TAG[n] * share) as u8)
            };
            rgb.iter().zip(&was_tag).map(colour).collect()
        });
        Self { band, rgb, scanned }
    }
}

impl FlatMap {
    fn blank(drawing: &Drawing<'_>) -> Self {
        let map = drawing.blank();
        Self { rgb: vec![[0; 3]; map.points().len()], map, scanned: None }
    }

    /// Replaces the rows of a band.
    pub(super) fn put(&mut self, fine: &FlatBand) {
        let pixels = fine.band.rows.start * self.map.columns()..fine.band.rows.end * self.map.columns();
        if fine.scanned.is_some() && self.scanned.is_none() {
            self.scanned = Some(self.rgb.clone());
        }
        if let Some(scanned) = &mut self.scanned {
            scanned[pixels.clone()].copy_from_slice(fine.scanned.as_ref().unwrap_or(&fine.rgb));
        }
        self.rgb[pixels].copy_from_slice(&fine.rgb);
        self.map.put(&fine.band);
    }
}

/// Unfolds a colon, and hands over what becomes known. Bands come outwards from the focus; until that is set, from a place, world mm.
///
/// # Errors
/// Returns status 4 if cancelled or if no one line leads through the colon, and the errors of `ready`.
pub(super) fn make(
    scan: Scanned,
    (focus, place): (&Focus, DVec3),
    progress: &Progress,
    ready: &(impl Fn(Piece) -> Result<()> + Sync),
) -> Result<()> {
    let iso = scan.volume.transfer().iso();
    let clean = scan.clean(progress)?;
    let along = clean.lumen.along(&clean.volume, progress)?;
    let none = || {
        let why = "no one line leads from the rectum to the cecum";
        Error::incomplete("the colon", why, "read it in flight and slices")
    };
    let line = along.line().ok_or_else(none)?;
    let own_mm = along.of(place).map_or(0.0, |at| at.mm);
    let from_mm = || Some(focus.get()).filter(|mm| mm.is_finite()).unwrap_or(own_mm);
    let chart = Arc::new(Chart::new(&clean.volume, &clean.lumen, line, iso, progress)?);
    let fine = Drawing::new(Arc::clone(&chart), &clean.volume, iso, &Sheet::default())?;
    let step_mm = COARSER as f64 * Sheet::default().step_mm;
    let sheet = Sheet { columns: Some(fine.columns() / COARSER), step_mm, ..Sheet::default() };
    let coarse = Drawing::new(chart, &clean.volume, iso, &sheet)?;
    let made = Mutex::new(FlatMap::blank(&coarse));
    coarse.outwards(from_mm, progress, |band| {
        let band = FlatBand::new(&coarse, &clean, band);
        made.lock().unwrap_or_else(PoisonError::into_inner).put(&band);
        Ok(())
    })?;
    let made = made.into_inner().unwrap_or_else(PoisonError::into_inner);
    let preview = FlatMap {
        map: fine.preview(&made.map),
        rgb: fine.enlarged(&made.map, &made.rgb),
        scanned: made.scanned.as_ref().map(|rgb| fine.enlarged(&made.map, rgb)),
    };
    drop((made, coarse));
    // The first place that is asked for sorts the wall.
    preview.map.place(DVec3::ZERO);
    ready(Piece::Map(preview))?;
    fine.outwards(from_mm, progress, |band| ready(Piece::Band(FlatBand::new(&fine, &clean, band))))
}
