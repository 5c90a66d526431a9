//! A slow deformation of the colon: it breathes, and waves pass along it.
//!
//! A place y of the world at a time t is that of the scan at x = y + b(y, t), where b is a sum of sines, smooth in both, and 0 at t = 0.
//! The deformed scan is therefore V(y + b(y, t)), interpolated at each voxel, without an inverse. Where tissue goes is the solution of
//! y + b(y, t) = x, by fixed-point iteration y ← x − b(y, t). It converges, since b changes by less than its argument: Lipschitz constant
//! below 0.7 for the largest deformation allowed, so no fold and no tear.

use std::array::from_fn;
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
        self.displaced(arguments(y).map(f64::sin_cos), &Moment::at(seconds))
    }

    /// Returns the displacement, mm, where the sums' arguments have these sines and cosines.
    #[inline(always)]
    fn displaced(&self, [x, y, z, u, v, w]: [(f64, f64); 6], now: &Moment) -> DVec3 {
        let breathing = DVec3::new(0.2 * x.0, 0.5 * y.1, 0.6 + 0.4 * z.1);
        // What has passed since the beginning, when nothing is displaced: sin(s − phase) − sin(s).
        let wave = |(sin, cos): (f64, f64)| sin * now.turned - cos * now.aside;
        let waves = DVec3::new(wave(u), wave(v), wave(w));
        (breathing * now.breath + waves * (0.5 * WAVE)) * self.mm
    }

    /// Returns the scan's place of what is at a place of the world at a time, s; both mm.
    pub fn tissue(&self, place: DVec3, seconds: f64) -> DVec3 {
        place + self.back(place, seconds)
    }

    /// Returns where the tissue at a place of the scan is at a time, s; both mm.
    pub fn place(&self, tissue: DVec3, seconds: f64) -> DVec3 {
        self.place_about(tissue, seconds, SETTLED_MM)
    }

    /// Does the same until it changes by at most `settled` mm. It is then wrong by less than 3 times as much.
    pub fn place_about(&self, tissue: DVec3, seconds: f64, settled: f64) -> DVec3 {
        let mut place = tissue;
        for _ in 0..STEPS {
            let next = tissue - self.back(place, seconds);
            let moved = next.distance(place);
            place = next;
            if moved.is_nan() || moved <= settled {
                break;
            }
        }
        place
    }

    /// Tells where tissue goes, as text.
    pub fn told(&self) -> String {
        format!(
            "The tissue that the scan has at x = (x1, x2, x3), mm, is at the time t, s, at the only y with x = y + {mm} · (sin(2πt/{BREATH_S}) · \
             a(y) + w(y, t)/{wave}), which y ← x − … finds from y = x; a = (0.2 sin(k y1), 0.5 cos(k y2 + 0.7), 0.6 + 0.4 cos(k y3 + \
             1.9)) with k = 2π/{BREATH_MM}, and w = (v(q y2 + 0.3), v(q y3 + 2.1), v(q y1 + 4.4)) with q = 2π/{WAVE_MM} and v(s) = sin(s − \
             2πt/{WAVE_S}) − sin(s)",
            mm = self.mm,
            wave = 2.0 / WAVE,
        )
    }

    /// Returns the deformed scan at a time, s.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn volume(&self, scan: &PreparedVolume, seconds: f64, progress: &Progress) -> Result<PreparedVolume> {
        let (voxels, grid, now) = (scan.voxels(), scan.voxels().grid(), Moment::at(seconds));
        let [nx, ny, nz] = grid.dims();
        // Along a row the arguments grow evenly, so their sines follow from those where it begins, and of what they have grown by.
        let place = |i: usize, j: usize, k: usize| grid.world(DVec3::new(i as f64, j as f64, k as f64));
        let (begin, next) = (arguments(place(0, 0, 0)), arguments(grid.world(DVec3::X)));
        let grown = (0..nx).map(|i| from_fn(|a| ((next[a] - begin[a]) * i as f64).sin_cos()));
        let grown: Vec<[(f64, f64); 6]> = grown.collect();
        // Beyond the scan's faces it goes on as at them: air there would be a wall of gas.
        let last = DVec3::from_array([nx, ny, nz].map(|n| n as f64 - 1.0));
        let mut data = vec![0i16; grid.len()];
        data.par_chunks_mut(nx * ny).enumerate().try_for_each(|(k, slice)| {
            progress.check()?;
            for (j, row) in slice.chunks_exact_mut(nx).enumerate() {
                let first = arguments(place(0, j, k)).map(f64::sin_cos);
                for (i, (out, grown)) in row.iter_mut().zip(&grown).enumerate() {
                    let turned = from_fn(|a| {
                        let ((s, c), (sin, cos)) = (first[a], grown[a]);
                        (s * cos + c * sin, c * cos - s * sin)
                    });
                    let tissue = place(i, j, k) + self.displaced(turned, &now);
                    *out = trilinear(voxels, grid.voxel(tissue).clamp(DVec3::ZERO, last)).round() as i16;
                }
            }
            Ok(())
        })?;
        Ok(scan.with_voxels(Volume::new(grid.clone(), data).into()))
    }
}

/// What the sums need of a time: the breath, and cos(phase) − 1 and sin(phase) of the waves.
struct Moment {
    breath: f64,
    turned: f64,
    aside: f64,
}

impl Moment {
    fn at(seconds: f64) -> Self {
        let (aside, cos) = (TAU * seconds / WAVE_S).sin_cos();
        Self { breath: (TAU * seconds / BREATH_S).sin(), turned: cos - 1.0, aside }
    }
}

/// Returns the arguments of the sines at a place of the world, mm: three of breathing and three of waves.
#[inline(always)]
fn arguments(y: DVec3) -> [f64; 6] {
    let (k, q) = (TAU / BREATH_MM, TAU / WAVE_MM);
    [k * y.x, k * y.y + 0.7, k * y.z + 1.9, q * y.y + 0.3, q * y.z + 2.1, q * y.x + 4.4]
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::space::TransferFunction;
    use crate::volume::Grid;

    #[test]
    fn a_deformed_scan_is_the_scan_at_its_tissue() {
        let turn = DMat3::from_rotation_y(0.3) * DMat3::from_rotation_z(0.7);
        let grid = Grid::new([300, 9, 8], DVec3::new(0.7, 0.8, 2.5), DVec3::new(-90.0, 40.0, 7.0), turn).unwrap();
        let data = (0..grid.len()).map(|n| (n as i64 * 7919 % 3000 - 1000) as i16).collect();
        let scan = PreparedVolume::new(Volume::new(grid.clone(), data).into(), TransferFunction::default());
        let deformation = Deformation::new(3.0).unwrap();
        let then = deformation.volume(&scan, 1.7, &Progress::new()).unwrap();
        let last = DVec3::new(299.0, 8.0, 7.0);
        for (n, value) in then.voxels().data().iter().enumerate() {
            let at = grid.world(DVec3::new((n % 300) as f64, (n / 300 % 9) as f64, (n / 2700) as f64));
            let at = grid.voxel(deformation.tissue(at, 1.7)).clamp(DVec3::ZERO, last);
            assert!((f64::from(*value) - trilinear(scan.voxels(), at)).abs() < 0.5 + 1e-6, "{n}");
        }
        assert!(then.voxels().data() != scan.voxels().data());
    }

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
