//! A scan without tag, for what looks at the wall itself: the search for polyps, and the colon laid flat.

use std::sync::Arc;

use glam::DVec3;

use super::cleansing::{Cleansing, Tag};
use super::shown::laid_over;
use crate::app::FlightApp;
use crate::app::boxed::boxed;
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::cleanse::{self, Cleansed};
use crate::fields::lumen::{self, Told};
use crate::polyps::RESTORED_HU;
use crate::progress::Progress;
use crate::space::PreparedVolume;
use crate::volume::Volume;

/// A scan that is flown through, and what is known of its tag.
pub(crate) struct Scanned {
    pub(crate) volume: PreparedVolume,
    pub(crate) lumen: Arc<Lumen>,
    /// Kinds that the reader gave to gas.
    pub(crate) told: Vec<Told>,
    pub(crate) tag: Tag,
}

/// The values that a scan had before its tag was taken out.
pub(crate) enum Before {
    Same,
    Changes(Arc<Cleansed>),
    Scan(Arc<Volume>, Arc<Cleansed>),
}

/// A scan without tag.
pub(crate) struct Clean {
    pub(crate) volume: Arc<Volume>,
    pub(crate) lumen: Arc<Lumen>,
    pub(crate) before: Before,
    /// The same around the colon, for pictures and measures.
    pub(crate) around: PreparedVolume,
    /// Bytes of that, if it was made here.
    pub(crate) bytes: usize,
}

impl Scanned {
    /// Takes the scan of a flight.
    pub(crate) fn of(flight: &FlightApp, cleansing: &Cleansing) -> Self {
        let setup = flight.setup();
        Self {
            volume: setup.volume.clone(),
            lumen: Arc::clone(&setup.lumen),
            told: setup.told.clone(),
            tag: cleansing.tag(flight),
        }
    }

    /// Returns the scan without tag, and the lumen in it.
    ///
    /// # Errors
    /// Returns status 4 if cancelled.
    pub(crate) fn clean(self, progress: &Progress) -> Result<Clean> {
        let Self { volume, lumen: known, told, tag } = self;
        let scanned = volume.shared_voxels();
        let as_it_is = |before: Before, volume: PreparedVolume, lumen: Arc<Lumen>| Clean {
            volume: volume.shared_voxels(),
            lumen,
            before,
            around: volume,
            bytes: 0,
        };
        let again = |volume: &Volume| -> Result<Arc<Lumen>> {
            let mut found = lumen::find_told(volume, &told, progress)?;
            cleanse::keep_ends(&mut found, &known);
            known.along(&scanned, progress)?;
            found.keep_along(&known);
            Ok(Arc::new(found))
        };
        match tag {
            Tag::Absent => Ok(as_it_is(Before::Same, volume, Arc::clone(&known))),
            Tag::Taken(cleansed) => Ok(as_it_is(Before::Changes(cleansed), volume, Arc::clone(&known))),
            Tag::Beside(around, known_tag) => {
                let volume = Arc::new(laid_over(&scanned, around.voxels()));
                let lumen = again(&volume)?;
                Ok(Clean { volume, lumen, before: Before::Scan(scanned, known_tag), around, bytes: 0 })
            }
            Tag::Unknown => {
                let cleansed = cleanse::cleanse(&scanned, &known, progress)?;
                if cleansed.changes.is_empty() {
                    return Ok(as_it_is(Before::Same, volume, Arc::clone(&known)));
                }
                let part = boxed(&scanned, &known, &cleansed.changes);
                let around = volume.with_voxels(Arc::new(part));
                let volume = Arc::new(cleansed.changes.applied(&scanned));
                let lumen = again(&volume)?;
                let bytes = around.voxels().bytes() + around.bytes();
                let before = Before::Scan(scanned, Arc::new(cleansed.without_values()));
                Ok(Clean { volume, lumen, before, around, bytes })
            }
        }
    }
}

impl Before {
    /// True if tag was taken out at a place (world, mm) of `clean`.
    pub(crate) fn is_restored(&self, clean: &Volume, p: DVec3) -> bool {
        let hu = |volume: &Volume| {
            let [i, j, k] = volume.grid().voxel(p).round().to_array().map(|x| x as i64);
            i32::from(volume.get(i, j, k))
        };
        let before = match self {
            Self::Same => return false,
            Self::Scan(scan, _) => hu(scan),
            Self::Changes(cleansed) => {
                let grid = clean.grid();
                let (dims, voxel) = (grid.dims(), grid.voxel(p).round().to_array());
                if (0..3).any(|a| voxel[a] < 0.0 || voxel[a] >= dims[a] as f64) {
                    return false;
                }
                let [i, j, k] = voxel.map(|x| x as usize);
                let Some(hu) = cleansed.changes.get(grid.index(i, j, k)) else { return false };
                i32::from(hu)
            }
        };
        (before - hu(clean)).abs() > RESTORED_HU
    }
}
