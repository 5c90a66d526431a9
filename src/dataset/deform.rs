//! A slow deformation of the colon: it breathes, and waves pass along it.
//!
//! A place y of the world at a time t is that of the scan at x = y + b(y, t), where b is a sum of sines, smooth in both, and 0 at t = 0.
//! The deformed scan is therefore V(y + b(y, t)), interpolated at each voxel, without an inverse. Where tissue goes is the solution of
//! y + b(y, t) = x, by fixed-point iteration y ← x − b(y, t). It converges, since b changes by less than its argument: Lipschitz constant
//! below 0.7 for the largest deformation allowed, so no fold and no tear.

use std::f64::consts::TAU;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::space::PreparedVolume;
use crate::space::ray::trilinear;
use crate::volume::Volume;

/// The largest deformation, mm.
pub const MOST_MM: f64 = 5.0;
/// Breathing: its period, s, and the length over which it changes, mm.
const BREATH_S: f64 = 4.0;
const BREATH_MM: f64 = 240.0;
/// Waves: their length, mm, their period, s, and their height as a share of the breathing's.
const WAVE_MM: f64 = 60.0;
const WAVE_S: f64 = 10.0;
const WAVE: f64 = 1.0 / 3.0;
/// The iteration ends at this change, mm, or after so many steps.
const SETTLED_MM: f64 = 1e-11;
const STEPS: usize = 200;

/// A deformation of so many mm.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Deformation {
    mm: f64,
}

impl Deformation {
    /// Creates one whose breathing moves tissue by up to `mm`.
    ///
    /// # Errors
    /// Returns status 2 unless `mm` is above 0 and at most [`MOST_MM`].
    pub fn new(mm: f64) -> Result<Self> {
        if mm > 0.0 && mm <= MOST_MM {
            return Ok(Self { mm });
        }
        let why = format!("{mm} mm is not above 0 and at most {MOST_MM}");
        Err(Error::usage("deformation", why, "give millimetres, such as 3"))
    }

    /// Returns the displacement b, mm, at a place of the world (mm) and a time, s.
    fn back(&self, y: DVec3, seconds: f64) -> DVec3 {
        let breath = (TAU * seconds / BREATH_S).sin();
        let k = TAU / BREATH_MM;
        let breathing =
            DVec3::new(0.2 * (k * y.x).sin(), 0.5 * (k * y.y + 0.7).cos(), 0.6 + 0.4 * (k * y.z + 1.9).cos());
        let (w, phase) = (TAU / WAVE_MM, TAU * seconds / WAVE_S);
        // What has passed since the beginning, when nothing is displaced.
        let wave = |at: f64| (at - phase).sin() - at.sin();
        let waves = DVec3::new(wave(w * y.y + 0.3), wave(w * y.z + 2.1), wave(w * y.x + 4.4));
        (breathing * breath + waves * (0.5 * WAVE)) * self.mm
    }

    /// Returns the scan's place of what is at a place of the world at a time, s; both mm.
    pub fn tissue(&self, place: DVec3, seconds: f64) -> DVec3 {
        place + self.back(place, seconds)
    }

    /// Returns where the tissue at a place of the scan is at a time, s; both mm.
    pub fn place(&self, tissue: DVec3, seconds: f64) -> DVec3 {
        let mut place = tissue;
        for _ in 0..STEPS {
            let next = tissue - self.back(place, seconds);
            let moved = next.distance(place);
            place = next;
            if moved.is_nan() || moved <= SETTLED_MM {
                break;
            }
        }
        place
    }

    /// Returns the deformed scan at a time, s.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn volume(&self, scan: &PreparedVolume, seconds: f64, progress: &Progress) -> Result<PreparedVolume> {
        let (voxels, grid) = (scan.voxels(), scan.voxels().grid());
        let [nx, ny, _] = grid.dims();
        let mut data = vec![0i16; grid.len()];
        data.par_chunks_mut(nx * ny).enumerate().try_for_each(|(k, slice)| {
            progress.check()?;
            for (n, out) in slice.iter_mut().enumerate() {
                let place = grid.world(DVec3::new((n % nx) as f64, (n / nx) as f64, k as f64));
                // Beyond the scan's faces it goes on as at them: air there would be a wall of gas.
                let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
                let at = grid.voxel(self.tissue(place, seconds)).clamp(DVec3::ZERO, last);
                *out = trilinear(voxels, at).round() as i16;
            }
            Ok(())
        })?;
        Ok(scan.with_voxels(Volume::new(grid.clone(), data).into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tissue_goes_and_comes_back_and_never_folds() {
        let deformation = Deformation::new(MOST_MM).unwrap();
        let (mut most, mut steepest) = (0.0f64, 0.0f64);
        for n in 0..4000 {
            let at = DVec3::new(f64::from(n % 17) * 19.3 - 160.0, f64::from(n % 29) * 11.7 - 170.0, f64::from(n) * 0.1);
            let seconds = f64::from(n) * 0.013;
            let place = deformation.place(at, seconds);
            assert!(deformation.tissue(place, seconds).distance(at) < 1e-9, "{at} at {seconds} s");
            assert!(deformation.place(at, 0.0).distance(at) < 1e-12, "nothing has moved at first");
            most = most.max(place.distance(at));
            for axis in DVec3::AXES {
                let step = deformation.back(at + axis * 1e-4, seconds) - deformation.back(at, seconds);
                steepest = steepest.max(step.length() / 1e-4);
            }
        }
        assert!(most > 0.8 * MOST_MM && most < 2.5 * MOST_MM, "{most} mm");
        assert!(steepest < 0.7, "{steepest}");
        for bad in [0.0, -1.0, 5.1, f64::NAN] {
            assert!(Deformation::new(bad).is_err());
        }
    }
}
