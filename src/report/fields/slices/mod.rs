//! How thick slices, noise and thin walls between limbs change the length of the centerline.

mod pages;
mod skips;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::fields::centerline::{self, Centerline, End};
use crate::fields::lumen::{self, Lumen, NAMES};
use crate::fields::{Through, WallDistance, connection};
use crate::math::hash;
use crate::phantom::{Phantom, PhantomSettings, Scanner, Size};
use crate::progress::Progress;
use crate::report::Effort;
use crate::volume::{Grid, Volume};
use skips::{Reference, Skip};

pub(super) use pages::write;

/// The slice thickness, the noise and the wall between limbs of which one varies at a time.
const BASE: Setting = Setting { slice_mm: 3.0, noise_hu: 25.0, wall_mm: Some(0.7) };
/// Thinnest slices of a full report, mm. Phantoms with coarser grids are sampled on a finer one.
const THIN_MM: f64 = 0.6;
/// Slice thicknesses, mm.
const SLICES_MM: [f64; 5] = [1.0, 2.0, 3.0, 4.0, 5.0];
/// Standard deviations of a phantom's noise, HU.
const NOISES_HU: [f64; 4] = [12.0, 25.0, 50.0, 70.0];
/// Thicknesses of the wall between limbs that touch, mm.
const WALLS_MM: [f64; 4] = [0.4, 0.7, 1.0, 1.5];
/// Standard deviations of the noise added to a scan, HU.
const ADDED_HU: [f64; 3] = [0.0, 25.0, 50.0];
/// Seed of that noise.
const NOISE_SEED: u64 = 0x5CA7;
/// Number of phantoms for each setting.
const SEEDS: u64 = 3;
const QUICK_SEEDS: u64 = 2;

/// How a volume was scanned.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Setting {
    slice_mm: f64,
    /// Standard deviation of the noise, in a scan of the added noise, HU.
    noise_hu: f64,
    /// Thickness of the wall between limbs that touch, mm; `None` if none are made to touch.
    wall_mm: Option<f64>,
}

/// The line found in one volume.
#[derive(Clone, Debug)]
struct Found {
    length_mm: f64,
    /// Where it begins and ends along the reference, mm.
    ends_mm: [f64; 2],
    skips: Vec<Skip>,
    /// Smallest distance of the line from the wall, without guessed stretches, mm.
    narrowest_mm: Option<f64>,
    guessed_mm: f64,
    septum_voxels: usize,
    segments: usize,
    /// Whether the segments are ordered from rectum to cecum: `yes`, `no`, or `wrong` if they are said to be and are not.
    order: &'static str,
    /// True if the line passes all parts of the colon in their order.
    parts: bool,
}

/// One volume and what was found in it, or the exit status and the reason.
#[derive(Clone, Debug)]
pub(super) struct Run {
    volume: String,
    setting: Setting,
    seed: Option<u64>,
    reference_mm: f64,
    found: std::result::Result<Found, String>,
}

impl Run {
    /// Returns the length found in percent of the reference's.
    fn share(&self) -> Option<f64> {
        self.found.as_ref().ok().map(|f| 100.0 * f.length_mm / self.reference_mm)
    }

    fn largest_skip(&self) -> Option<&Skip> {
        self.found.as_ref().ok()?.skips.iter().max_by(|a, b| a.mm().total_cmp(&b.mm()))
    }

    /// Returns its setting in words.
    fn words(&self) -> String {
        let Setting { slice_mm, noise_hu, wall_mm } = self.setting;
        let wall = wall_mm.map_or(String::new(), |mm| format!(", {mm} mm wall"));
        let seed = self.seed.map_or(String::new(), |seed| format!(", seed {seed}"));
        format!("{slice_mm} mm slices, {noise_hu} HU noise{wall}{seed}")
    }
}

/// Returns the settings to measure: those of a phantom whose grid has slices of `own_mm`, with limbs that touch or without.
fn settings(effort: Effort, own_mm: f64, touching: bool) -> Vec<Setting> {
    let base = Setting { wall_mm: BASE.wall_mm.filter(|_| touching), ..BASE };
    let mut slices = effort.choose(vec![own_mm, BASE.slice_mm, 5.0], [&[THIN_MM, own_mm], &SLICES_MM[..]].concat());
    slices.sort_by(f64::total_cmp);
    let noises = if touching {
        effort.choose(vec![12.0, 70.0], NOISES_HU.to_vec())
    } else {
        effort.choose(Vec::new(), NOISES_HU.to_vec())
    };
    let walls = if touching { effort.choose(vec![0.4, 1.5], WALLS_MM.to_vec()) } else { Vec::new() };
    let varied = (slices.iter().map(|&slice_mm| Setting { slice_mm, ..base }))
        .chain(noises.iter().map(|&noise_hu| Setting { noise_hu, ..base }))
        .chain(walls.iter().map(|&wall_mm| Setting { wall_mm: Some(wall_mm), ..base }));
    let mut all: Vec<Setting> = Vec::new();
    for s in varied {
        if !all.contains(&s) {
            all.push(s);
        }
    }
    all
}

/// Measures phantoms, with limbs that touch and without.
pub(super) fn phantoms(effort: Effort, size: Size, seed: u64, progress: &Progress) -> Result<Vec<Run>> {
    let mut runs = Vec::new();
    for touching in [true, false] {
        let own_mm = Phantom::new(&PhantomSettings { size, ..PhantomSettings::default() }).grid().spacing().z;
        for setting in settings(effort, own_mm, touching) {
            for seed in seed..seed + effort.choose(QUICK_SEEDS, SEEDS) {
                runs.push(phantom(setting, size, seed, progress)?);
            }
        }
    }
    Ok(runs)
}

fn phantom(setting: Setting, size: Size, seed: u64, progress: &Progress) -> Result<Run> {
    let touching_mm = setting.wall_mm;
    let settings =
        PhantomSettings { size, seed, touching: touching_mm.is_some(), touching_mm, ..PhantomSettings::default() };
    let phantom = Phantom::scanned(&settings, Scanner { noise_hu: setting.noise_hu, ..Scanner::default() });
    let grid = phantom.grid();
    let fine = if setting.slice_mm < grid.spacing().z { sliced(&grid, setting.slice_mm)? } else { grid };
    let volume = phantom.slices(&fine, setting.slice_mm, progress)?;
    let reference = Reference::new(phantom.truth().centerline);
    let found = attempt(line(&volume, progress), progress)?.map(|(lumen, line)| of(&lumen, &line, &reference));
    let name = if touching_mm.is_some() { "phantom, limbs touch" } else { "phantom" };
    Ok(Run { volume: name.to_owned(), setting, seed: Some(seed), reference_mm: reference.length_mm, found })
}

/// Measures a scan: as it is, then averaged to thicker slices and with noise added, against the line of the scan as it is.
pub(super) fn scan(effort: Effort, title: &str, volume: &Volume, progress: &Progress) -> Result<Vec<Run>> {
    let own_mm = volume.grid().spacing().z;
    let as_it_is = Setting { slice_mm: own_mm, noise_hu: 0.0, wall_mm: None };
    let run = |setting: Setting, reference: &Reference, found| Run {
        volume: title.to_owned(),
        setting,
        seed: None,
        reference_mm: reference.length_mm,
        found,
    };
    let (lumen, own) = match attempt(line(volume, progress), progress)? {
        Ok(found) => found,
        Err(why) => return Ok(vec![run(as_it_is, &Reference::default(), Err(why))]),
    };
    let reference = Reference::new(own.points.clone());
    let mut runs = vec![run(as_it_is, &reference, Ok(of(&lumen, &own, &reference)))];
    drop((lumen, own));
    let slices = effort.choose(vec![5.0], SLICES_MM.to_vec());
    let noises = effort.choose(vec![0.0, 50.0], ADDED_HU.to_vec());
    for slice_mm in slices.into_iter().filter(|mm| *mm > own_mm - 1e-6) {
        for &noise_hu in &noises {
            let setting = Setting { slice_mm, noise_hu, wall_mm: None };
            let found = averaged(volume, slice_mm, noise_hu, progress).and_then(|v| line(&v, progress));
            let found = attempt(found, progress)?.map(|(lumen, line)| of(&lumen, &line, &reference));
            runs.push(run(setting, &reference, found));
        }
    }
    Ok(runs)
}

/// Finds the line from rectum to cecum, as `colvis centerline --from rectum --to cecum` does.
fn line(volume: &Volume, progress: &Progress) -> Result<(Lumen, Centerline)> {
    let lumen = lumen::find(volume, progress)?;
    let all = 0..lumen.segments.len();
    if all.is_empty() {
        return Err(Error::incomplete("scan", "no gas of a colon was found in it", "report on another scan"));
    }
    let walls = WallDistance::of_lumen(volume, &lumen, Through::GasAndFluid, progress)?;
    let [from, to] = lumen.outermost(all.clone()).map(End::Tip);
    let guesses = connection::guesses(volume, &lumen, all, progress)?;
    let line = centerline::between(&walls, from, to, &guesses, progress)?;
    Ok((lumen, line))
}

/// Separates a failure, as exit status and reason, from an interruption.
fn attempt<T>(result: Result<T>, progress: &Progress) -> Result<std::result::Result<T, String>> {
    match result {
        Ok(value) => Ok(Ok(value)),
        Err(e) => progress.check().map(|()| Err(format!("{}: {}", e.kind as u8, e.why))),
    }
}

/// Compares what was found with the reference.
fn of(lumen: &Lumen, line: &Centerline, reference: &Reference) -> Found {
    let radii = line.radius_mm.iter().copied().filter(|r| *r > 0.0);
    Found {
        length_mm: line.length_mm,
        ends_mm: [line.points.first(), line.points.last()].map(|p| p.map_or(0.0, |&p| reference.along(p))),
        skips: reference.skips(&line.points),
        narrowest_mm: radii.reduce(f64::min),
        guessed_mm: line.guessed.iter().fold(0.0, |sum, [a, b]| sum + b - a),
        septum_voxels: lumen.septa().len(),
        segments: lumen.segments.len(),
        order: match lumen.ordered {
            false => "no",
            true if is_ordered(lumen, reference) => "yes",
            true => "wrong",
        },
        parts: lumen.names().on(&line.points).iter().map(|p| p.name).eq(NAMES),
    }
}

/// True if the segments follow each other along the reference, each with its rectal end first.
fn is_ordered(lumen: &Lumen, reference: &Reference) -> bool {
    let ends = lumen.segments.iter().map(|s| s.ends.map(|p| reference.along(p)));
    let middles: Vec<f64> = ends.clone().map(|[a, b]| 0.5 * (a + b)).collect();
    ends.clone().all(|[a, b]| a <= b) && middles.is_sorted()
}

/// Returns `grid` with slices of `slice_mm` along its third axis, as many as fit, centred on it.
fn sliced(grid: &Grid, slice_mm: f64) -> Result<Grid> {
    let ([nx, ny, nz], spacing) = (grid.dims(), grid.spacing());
    let each = slice_mm / spacing.z;
    let count = (nz as f64 / each + 1e-9) as usize;
    let first = 0.5 * (nz as f64 - 1.0) - 0.5 * each * (count as f64 - 1.0);
    let origin = grid.world(DVec3::new(0.0, 0.0, first));
    let spacing = DVec3::new(spacing.x, spacing.y, slice_mm);
    let sliced = Grid::new([nx, ny, count], spacing, origin, grid.direction());
    sliced.map_err(|e| Error::incomplete("slices", e.why, "report on a scan with more slices"))
}

/// Averages a scan to slices of `slice_mm` along its third axis and adds white noise of `noise_hu`.
fn averaged(volume: &Volume, slice_mm: f64, noise_hu: f64, progress: &Progress) -> Result<Volume> {
    let grid = sliced(volume.grid(), slice_mm)?;
    let ([nx, ny, nz], count) = (volume.grid().dims(), grid.dims()[2]);
    let (area, each) = (nx * ny, slice_mm / volume.grid().spacing().z);
    let below = 0.5 * (nz as f64 - count as f64 * each);
    let mut data = vec![0i16; grid.len()];
    data.par_chunks_mut(area).enumerate().try_for_each(|(slice, out)| {
        progress.check()?;
        // Voxel k reaches from k to k + 1.
        let from = (below + slice as f64 * each).max(0.0);
        let to = (from + each).min(nz as f64);
        let weights: Vec<(usize, f64)> = (from as usize..(to.ceil() as usize).min(nz))
            .map(|k| (k, (to.min(k as f64 + 1.0) - from.max(k as f64)).max(0.0) / (to - from)))
            .collect();
        for (i, voxel) in out.iter_mut().enumerate() {
            let hu: f64 = weights.iter().map(|(k, w)| w * f64::from(volume.data()[k * area + i])).sum();
            let noise = noise_hu * hash::normal(NOISE_SEED, (slice * area + i) as u64);
            *voxel = (hu + noise).round().clamp(f64::from(i16::MIN), f64::from(i16::MAX)) as i16;
        }
        Ok::<(), Error>(())
    })?;
    Ok(Volume::new(grid, data).with_header_position(volume.header_position()))
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::pages::{finding, table};
    use super::*;

    #[test]
    fn one_thing_varies_at_a_time() {
        let full = settings(Effort::Full, 1.0, true);
        assert_eq!(full.len(), 6 + 3 + 3, "{full:?}");
        let changes = |s: &Setting| {
            [s.slice_mm != BASE.slice_mm, s.noise_hu != BASE.noise_hu, s.wall_mm != BASE.wall_mm]
                .into_iter()
                .filter(|c| *c)
                .count()
        };
        assert!(full.iter().all(|s| changes(s) <= 1) && full.iter().filter(|s| changes(s) == 0).count() == 1);
        assert!(full.iter().any(|s| s.slice_mm == THIN_MM) && full.iter().any(|s| s.wall_mm == Some(1.5)));
        let apart = settings(Effort::Full, 0.9, false);
        assert!(apart.len() == 7 + 3 && apart.iter().all(|s| s.wall_mm.is_none()));
        let quick = [true, false].map(|touching| settings(Effort::Quick, 0.9, touching).len());
        assert_eq!(quick, [3 + 2 + 2, 3]);
    }

    fn column(noise: bool) -> (Phantom, Grid) {
        let settings = PhantomSettings { size: Size::Small, noise, ..PhantomSettings::default() };
        let centre = DVec3::new(-2.0, -46.0, -60.0);
        (Phantom::new(&settings), Grid::new([10, 10, 101], DVec3::splat(0.9), centre, DMat3::IDENTITY).unwrap())
    }

    #[test]
    fn a_scan_is_averaged_as_a_scanner_averages_a_phantom() {
        let (phantom, grid) = column(false);
        let volume = phantom.voxelise(&grid, &Progress::new()).unwrap();
        for mm in [0.9, 1.35, 3.0, 5.0] {
            let expected = phantom.slices(&grid, mm, &Progress::new()).unwrap();
            let found = averaged(&volume, mm, 0.0, &Progress::new()).unwrap();
            assert_eq!(found.grid().dims(), expected.grid().dims());
            assert!((found.grid().origin() - expected.grid().origin()).length() < 1e-9);
            let far = found.data().iter().zip(expected.data()).map(|(a, b)| (a - b).abs()).max();
            assert!(far.unwrap() <= 1, "{mm} mm: {far:?}");
            // Noise is the same each time, and as strong as asked for.
            let noisy = [1, 2].map(|_| averaged(&volume, mm, 50.0, &Progress::new()).unwrap());
            assert!(noisy[0].data() == noisy[1].data());
            let n = found.data().len() as f64;
            let square = noisy[0].data().iter().zip(found.data()).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            assert!(((square / n).sqrt() / 50.0 - 1.0).abs() < 0.06, "{mm} mm");
        }
    }

    #[test]
    fn finer_slices_are_centred_on_the_grid() {
        let (_, grid) = column(false);
        let fine = sliced(&grid, 0.6).unwrap();
        assert_eq!(fine.dims(), [10, 10, 151]);
        let middle = |g: &Grid| g.world(0.5 * DVec3::new(9.0, 9.0, g.dims()[2] as f64 - 1.0));
        assert!((middle(&fine) - middle(&grid)).length() < 1e-9);
    }

    #[test]
    #[ignore = "slow: a phantom of the report on fields"]
    fn a_phantom_gives_a_row_and_so_does_a_failure() {
        let mut runs = vec![phantom(BASE, Size::Small, 1, &Progress::new()).unwrap()];
        let share = runs[0].share().unwrap();
        assert!(share > 20.0 && share < 110.0, "{share}");
        let found = runs[0].found.clone().unwrap();
        let (grid, air) = (column(false).1, -1000);
        let empty = Volume::new(grid.clone(), vec![air; grid.len()]);
        let failed = attempt(line(&empty, &Progress::new()), &Progress::new()).unwrap().map(|_| found);
        assert!(failed.as_ref().is_err_and(|why| why.starts_with("4: ")), "{failed:?}");
        runs.push(Run { found: failed, ..runs[0].clone() });
        let csv = table(runs.iter()).csv();
        let rows: Vec<&str> = csv.lines().skip(1).collect();
        assert!(rows.len() == 2 && rows[0].ends_with(",0") && rows[1].contains("4: "), "{csv}");
        assert!(finding("phantoms", "the true line", &runs).unwrap().contains("1 without a line"));
        let progress = Progress::new();
        progress.cancel();
        assert!(phantom(BASE, Size::Small, 1, &progress).is_err(), "an interruption is no row");
    }
}
