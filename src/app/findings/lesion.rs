//! The lesion at a place of the wall, measured in the part of the scan around it.

use glam::DVec3;

use crate::error::{Error, Result};
use crate::fields::lumen;
use crate::polyps::{self, Measurement, Wall};
use crate::progress::Progress;
use crate::volume::Volume;

/// The part of the scan reaches this far from the place, mm: a mass and the wall around it.
const REACH_MM: f64 = 45.0;

/// Measures the lesion at a place (world, mm) of the wall of a scan, whose wall is at `iso` HU. Only the part around it is looked at, so
/// it takes some hundredths of a second. `is_restored` is true for a place (world, mm) on a wall that cleansing has restored.
///
/// # Errors
/// Returns status 4 if there is no wall near the place, if nothing bulges there, or if interrupted.
pub fn lesion_at(
    volume: &Volume,
    iso: f64,
    at: DVec3,
    is_restored: impl Fn(DVec3) -> bool,
    progress: &Progress,
) -> Result<Measurement> {
    let nowhere = |why: &str| Error::incomplete("measure", why, "give a place on the wall");
    let grid = volume.grid();
    if !at.is_finite() || !grid.contains(at) {
        return Err(nowhere("the place is outside the scan"));
    }
    let (middle, dims) = (grid.voxel(at), grid.dims());
    let reach = REACH_MM / grid.spacing();
    let first = (middle - reach).floor().max(DVec3::ZERO).to_array().map(|x| x as usize);
    let last = (middle + reach).ceil().to_array();
    let size = std::array::from_fn(|a| (last[a] as usize + 1).min(dims[a]) - first[a]);
    let part = volume.part(first, size);
    let gas = lumen::gas_near(&part, at, progress)?.ok_or_else(|| nowhere("there is no gas near the place"))?;
    let wall = Wall::new(&part, &gas, iso, progress)?;
    polyps::measure(&wall, &part, at, is_restored)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;
    use crate::findings::{Finding, Morphology, Tissue};
    use crate::phantom::PhantomSettings;
    use crate::shared::shared;

    /// In the part as in the whole scan.
    #[test]
    fn a_lesion_has_the_measures_that_the_whole_wall_gives() {
        let (phantom, volume) = shared(&PhantomSettings { polyps: true, ..PhantomSettings::embedded(3) });
        let progress = Progress::new();
        let found = lumen::find(&volume, &progress).unwrap();
        let wall = Wall::new(&volume, &found, -650.0, &progress).unwrap();
        let mut measured = 0;
        for polyp in &phantom.truth().polyps {
            let whole = polyps::measure(&wall, &volume, polyp.position, |_| false);
            let part = lesion_at(&volume, -650.0, polyp.position, |_| false, &progress);
            let (Ok(whole), Ok(part)) = (&whole, &part) else {
                assert_eq!(whole.is_ok(), part.is_ok(), "{whole:?} {part:?}");
                continue;
            };
            let off = (whole.lesion.diameter_mm - part.lesion.diameter_mm).abs();
            assert!(off < 0.05, "{whole:?} {part:?}");
            let mut finding = Finding { place: polyp.position, ..Finding::default() };
            finding.measure(part);
            assert_eq!(finding.diameter_mm, Some(part.lesion.diameter_mm));
            let is_small = part.lesion.diameter_mm < 6.0;
            assert!(finding.tissue == Some(Tissue::Soft) || is_small && finding.tissue.is_none(), "{finding:?}");
            measured += 1;
        }
        assert_eq!(Tissue::of(0.9, -60.0, 8.0), Some(Tissue::Fat));
        assert_eq!(Tissue::of(0.1, -60.0, 8.0), Some(Tissue::Soft));
        // Small, or a fold whose core is soft: it counts, whatever its mean.
        assert_eq!((Tissue::of(0.9, -60.0, 5.0), Tissue::of(0.9, 10.0, 12.0)), (None, None));
        assert!(measured >= 3, "{measured}");
    }

    #[test]
    fn where_there_is_none_that_is_said() {
        let (_, volume) = shared(&PhantomSettings::embedded(3));
        let corner = volume.grid().world(DVec3::splat(2.0));
        for at in [corner, DVec3::splat(1e4), DVec3::NAN] {
            let e = lesion_at(&volume, -650.0, at, |_| false, &Progress::new()).unwrap_err();
            assert_eq!(e.kind, Kind::Incomplete, "{e}");
        }
    }

    #[test]
    fn a_diameter_that_is_corrected_may_make_it_a_mass() {
        let mut finding = Finding { morphology: Some(Morphology::Flat), ..Finding::default() };
        finding.correct([DVec3::ZERO, DVec3::X * 12.0]);
        assert_eq!((finding.diameter_mm, finding.morphology), (Some(12.0), Some(Morphology::Flat)));
        finding.correct([DVec3::ZERO, DVec3::X * 31.0]);
        assert_eq!(finding.morphology, Some(Morphology::Mass));
        finding.correct([DVec3::ZERO, DVec3::X * 29.0]);
        assert_eq!(finding.morphology, Some(Morphology::Sessile));
    }

    #[test]
    fn a_height_stays_unless_the_diameter_is_corrected_by_more_than_a_third() {
        for (mm, height_mm) in [(12.0, Some(4.0)), (15.9, Some(4.0)), (8.1, Some(4.0)), (16.1, None), (7.9, None)] {
            let (diameter_mm, volume_mm3) = (Some(12.0), Some(300.0));
            let mut finding = Finding { diameter_mm, height_mm: Some(4.0), volume_mm3, ..Finding::default() };
            finding.correct([DVec3::ZERO, DVec3::X * mm]);
            assert_eq!((finding.height_mm, finding.volume_mm3), (height_mm, None), "{mm}");
        }
        let mut unmeasured = Finding { height_mm: Some(4.0), ..Finding::default() };
        unmeasured.correct([DVec3::ZERO, DVec3::X]);
        assert_eq!(unmeasured.height_mm, Some(4.0), "no base is known that it belongs to");
    }
}
