//! Thick slices: what a scanner writes whose slices are thicker than the phantom's grid.

use glam::DVec3;
use rayon::prelude::*;

use super::voxelise::round;
use super::{Phantom, PhantomSettings};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

impl Phantom {
    /// Returns the grid of [`Phantom::scan`]: [`Phantom::grid`] with the scanner's slices.
    ///
    /// # Errors
    /// Returns status 2 if the scanner's slices are not finite, thinner than the grid's own, or so thick that fewer than two fit.
    pub fn scan_grid(&self) -> Result<Grid> {
        self.scanner.slice_mm.map_or_else(|| Ok(self.grid()), |mm| thick_grid(&self.grid(), mm))
    }

    /// Returns the scan that the scanner writes: the phantom on its own grid, in slices as thick as
    /// [`Scanner::slice_mm`](super::Scanner::slice_mm) says.
    ///
    /// # Errors
    /// Returns status 2 if no slices of this thickness fit, or an error if cancelled through `progress`.
    pub fn scan(&self, progress: &Progress) -> Result<Volume> {
        match self.scanner.slice_mm {
            Some(mm) => self.slices(&self.grid(), mm, progress),
            None => self.voxelise(&self.grid(), progress),
        }
    }

    /// Samples the body on `fine` and averages it to slices of `slice_mm` along the grid's third axis: each is the mean of the HU
    /// over its thickness. Noise is added after averaging, so it has the same strength for any thickness.
    ///
    /// # Errors
    /// Returns status 2 if no slices of this thickness fit, or an error if cancelled through `progress`.
    pub fn slices(&self, fine: &Grid, slice_mm: f64, progress: &Progress) -> Result<Volume> {
        let thick = thick_grid(fine, slice_mm)?;
        if thick.dims() == fine.dims() && slice_mm - fine.spacing().z < 1e-9 {
            return self.voxelise(fine, progress);
        }
        let quiet = Self { settings: PhantomSettings { noise: false, ..self.settings }, ..self.clone() };
        let source = quiet.voxelise(fine, progress)?;
        let [nx, ny, nz] = fine.dims();
        let (area, count) = (nx * ny, thick.dims()[2]);
        let each = thick.spacing().z / fine.spacing().z;
        let below = 0.5 * (nz as f64 - count as f64 * each);
        let mut data = vec![0i16; thick.len()];
        progress.stage("slices", count as u64);
        data.par_chunks_mut(area).enumerate().try_for_each(|(slice, out)| {
            // Voxel k reaches from k to k + 1.
            let from = (below + slice as f64 * each).max(0.0);
            let to = (from + each).min(nz as f64);
            let weights: Vec<(usize, f64)> = (from as usize..(to.ceil() as usize).min(nz))
                .map(|k| (k, (to.min(k as f64 + 1.0) - from.max(k as f64)).max(0.0) / (to - from)))
                .collect();
            for (i, voxel) in out.iter_mut().enumerate() {
                let hu: f64 = weights.iter().map(|(k, w)| w * f64::from(source.data()[k * area + i])).sum();
                *voxel = round(hu + self.noise((slice * area + i) as u64));
            }
            progress.advance(1)
        })?;
        Ok(Volume::new(thick, data))
    }
}

/// Returns `fine` with slices of `slice_mm` along its third axis. As many as fit are centred on it. Fails with status 2 if
/// `slice_mm` is not finite, less than the grid's own spacing, or so large that fewer than two slices fit.
pub(crate) fn thick_grid(fine: &Grid, slice_mm: f64) -> Result<Grid> {
    let ([nx, ny, nz], spacing) = (fine.dims(), fine.spacing());
    let (least, most) = (spacing.z, 0.5 * nz as f64 * spacing.z);
    let refused =
        |why: String| Err(Error::usage("--slice", why, format!("give a thickness from {least} to {most} mm")));
    if !slice_mm.is_finite() {
        return refused(format!("{slice_mm} is not a number"));
    }
    if slice_mm < least - 1e-9 {
        return refused(format!("{slice_mm} mm is thinner than the phantom's own slices"));
    }
    if slice_mm > most {
        return refused(format!("fewer than two slices of {slice_mm} mm fit into the phantom"));
    }
    let each = slice_mm / spacing.z;
    let count = (nz as f64 / each + 1e-9) as usize;
    // The middle of the first slice, in voxels of the fine grid.
    let first = 0.5 * (nz as f64 - count as f64 * each) + 0.5 * each - 0.5;
    let origin = fine.world(DVec3::new(0.0, 0.0, first));
    let spacing = DVec3::new(spacing.x, spacing.y, slice_mm);
    let thick = Grid::new([nx, ny, count], spacing, origin, fine.direction());
    thick.map_err(|e| Error::usage("--slice", e.why, format!("give a thickness from {least} to {most} mm")))
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::error::Kind;
    use crate::{Scanner, Size};

    fn phantom(noise: bool, slice_mm: Option<f64>, noise_hu: f64) -> Phantom {
        let settings = PhantomSettings { size: Size::Small, noise, ..PhantomSettings::default() };
        Phantom::scanned(&settings, Scanner { slice_mm, noise_hu, ..Scanner::default() })
    }

    /// A column of the small body along z, 0.9 mm apart as its grid.
    fn column() -> Grid {
        let centre = DVec3::new(-2.0, -46.0, -110.0);
        Grid::new([12, 12, 200], DVec3::splat(0.9), centre, DMat3::IDENTITY).unwrap()
    }

    #[test]
    fn averaging_keeps_the_mean_and_the_place_of_walls() {
        let (fine, phantom) = (column(), phantom(false, None, 22.0));
        let source = phantom.voxelise(&fine, &Progress::new()).unwrap();
        for mm in [0.9, 1.0, 1.35, 2.5, 3.0, 5.0] {
            let thick = phantom.slices(&fine, mm, &Progress::new()).unwrap();
            let [nx, ny, count] = thick.grid().dims();
            assert!((thick.grid().spacing().z - mm).abs() < 1e-12 && (count as f64 * mm) <= 180.0 + 1e-6);
            // In each column of voxels, the sum over its length, and its first moment in z (world), are the same but for what does
            // not fit at the two ends.
            let below = 0.5 * (180.0 - count as f64 * mm);
            for c in 0..nx * ny {
                let sum = |v: &Volume, weight: &dyn Fn(f64) -> f64| {
                    let n = v.grid().dims()[2];
                    (0..n)
                        .map(|k| {
                            let z = v.grid().world(DVec3::new(0.0, 0.0, k as f64)).z;
                            f64::from(v.data()[k * nx * ny + c]) * v.grid().spacing().z * weight(z)
                        })
                        .sum::<f64>()
                };
                let bottom = fine.origin().z - 0.45;
                let cut =
                    |z: f64| ((z - bottom - below + 0.45).min(bottom + 180.0 - below - z + 0.45) / 0.9).clamp(0.0, 1.0);
                let (a, b) = (sum(&source, &cut), sum(&thick, &|_| 1.0));
                assert!((a - b).abs() / 180.0 < 1.0, "{mm} mm: {a} {b}");
                let middle = bottom + 90.0;
                let moment = |z: f64| (z - middle) / 90.0;
                let (a, b) = (sum(&source, &|z| cut(z) * moment(z)), sum(&thick, &moment));
                assert!((a - b).abs() / 180.0 < 2.0 + 2.0 * mm, "{mm} mm: moments {a} {b}");
            }
        }
    }

    /// Where a slice covers a wall that is level, its HU is that of the share of tissue.
    #[test]
    fn a_slice_is_the_mean_over_its_thickness() {
        let (fine, phantom) = (column(), phantom(false, None, 22.0));
        let thick = phantom.slices(&fine, 2.7, &Progress::new()).unwrap();
        let [nx, ny, count] = thick.grid().dims();
        for k in 0..count {
            for c in [0, 40, nx * ny - 1] {
                let at = thick.grid().world(DVec3::new((c % nx) as f64, (c / nx) as f64, k as f64));
                let mean =
                    (0..27).map(|i| phantom.value(at + DVec3::Z * (0.1 * f64::from(i) - 1.3))).sum::<f64>() / 27.0;
                let hu = f64::from(thick.data()[k * nx * ny + c]);
                assert!((hu - mean).abs() < 40.0, "slice {k}, column {c}: {hu} against {mean}");
            }
        }
    }

    #[test]
    fn slices_as_thick_as_the_grids_are_the_grids() {
        let fine = column();
        let plain = phantom(true, None, 22.0).voxelise(&fine, &Progress::new()).unwrap();
        let thick = phantom(true, None, 22.0).slices(&fine, 0.9, &Progress::new()).unwrap();
        assert!(plain.data() == thick.data());
        assert!((plain.grid().origin() - thick.grid().origin()).length() < 1e-9);
    }

    #[test]
    fn noise_is_as_strong_in_slices_of_any_thickness() {
        let fine = column();
        for (mm, level) in [(0.9, 12.0), (3.0, 22.0), (5.0, 70.0)] {
            let noisy = phantom(true, None, level).slices(&fine, mm, &Progress::new()).unwrap();
            let quiet = phantom(false, None, level).slices(&fine, mm, &Progress::new()).unwrap();
            let n = noisy.data().len() as f64;
            let square: f64 = noisy.data().iter().zip(quiet.data()).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            let sd = (square / n).sqrt();
            assert!((sd / level - 1.0).abs() < 0.05, "{mm} mm: {sd} HU for {level}");
        }
    }

    #[test]
    fn the_scans_grid_is_centred_and_extreme_slices_are_refused() {
        let scan = phantom(true, Some(3.0), 22.0).scan_grid().unwrap();
        let [nx, ny, nz] = scan.dims();
        let last = scan.world(DVec3::new(nx as f64 - 1.0, ny as f64 - 1.0, nz as f64 - 1.0));
        assert!((scan.origin() + last).length() < 1e-9 && nz == 81 && scan.spacing().z == 3.0);
        for mm in [0.0, -3.0, 0.89, f64::NAN, f64::INFINITY, 1e6] {
            let error = phantom(true, Some(mm), 22.0).scan_grid().unwrap_err();
            assert_eq!(error.kind, Kind::Usage, "{mm}");
        }
        assert!(phantom(true, Some(0.9), 22.0).scan_grid().is_ok());
    }
}
