//! Obstacles in the gas that confuse flights and measurements: thin bridges across the lumen and islands of residue
//! (the paper's section 4).

use glam::DVec3;
use rayon::prelude::*;

use super::frame::AxisDirection;
use super::runs::{Rows, Run};
use super::{GAS_HU, Lumen};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// Maximum thickness of thin tissue with gas on both sides, mm.
const THIN_MM: f64 = 5.0;
/// A voxel that is thin along this many of the thirteen lines through its neighbours belongs to a rod. A rod is long
/// along one line, or between two; a sheet (a fold) along four.
const THIN_LINES: usize = 11;
/// Voxels that are thin along this many lines belong to a rod if they touch voxels that certainly do.
const NEARLY_THIN_LINES: usize = 10;
/// How many times thicker than at its thinnest a rod may appear along a line …
const THIN_RATIO: f64 = 2.2;
/// … plus this much for the size of the voxels, mm.
const THIN_SLACK_MM: f64 = 0.5;
/// Minimum number of voxels that certainly belong to a rod.
const SURE_VOXELS: usize = 4;
/// Maximum fraction of a bridge's voxels that touch other tissue: only its ends do, while the rim of a fold does all along.
const ATTACHED_SHARE: f64 = 0.5;
/// Minimum length of a bridge, mm.
const BRIDGE_MM: f64 = 3.0;
/// Minimum volume of an island, ml: a single noisy voxel does not count …
const ISLAND_LEAST_ML: f64 = 0.002;
/// … and maximum volume, ml: anything larger is a loop of the wall.
const ISLAND_MOST_ML: f64 = 10.0;

/// The thirteen lines through a voxel and its neighbours, one direction of each.
pub(in crate::fields) const LINES: [[i64; 3]; 13] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, -1, 0],
    [1, 0, 1],
    [1, 0, -1],
    [0, 1, 1],
    [0, 1, -1],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [1, -1, -1],
];

/// A bridge or an island.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Remnant {
    /// Middle, world, mm.
    pub at: DVec3,
    /// Volume, ml.
    pub ml: f64,
    /// Diagonal of the box around its voxels' centres, mm.
    pub length_mm: f64,
}

/// Voxel indices.
type Voxels = Vec<[i64; 3]>;

/// The obstacles in the gas.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Residue {
    /// Thin rods of tissue or strands of residue in the gas, the largest first.
    pub bridges: Vec<Remnant>,
    /// Pieces of tissue or residue that touch no wall, the largest first.
    pub islands: Vec<Remnant>,
}

/// Finds bridges and islands within a lumen. Nothing else needs them, so they are only computed on request.
///
/// # Errors
/// Returns an error if cancelled, or if the volume cannot be addressed.
pub fn residue(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Residue> {
    progress.stage("marking bridges and islands", volume.grid().dims()[2] as u64);
    let loose = islands(lumen, progress)?;
    let rods = rods(volume, lumen, &loose, progress)?;
    let bridges = gather(volume.grid(), &rods).filter(|m| m.length_mm >= BRIDGE_MM);
    let islands = gather(volume.grid(), &loose).filter(|m| (ISLAND_LEAST_ML..=ISLAND_MOST_ML).contains(&m.ml));
    Ok(Residue { bridges: largest_first(bridges), islands: largest_first(islands) })
}

fn largest_first(found: impl Iterator<Item = Remnant>) -> Vec<Remnant> {
    let mut found: Vec<Remnant> = found.collect();
    // The sort is stable, so equal ones stay in voxel order.
    found.sort_by(|a, b| b.ml.total_cmp(&a.ml));
    found
}

/// Returns runs that are neither gas nor fluid, border on gas and are not 26-connected to anything outside, labelled by
/// component from 0.
fn islands(lumen: &Lumen, progress: &Progress) -> Result<Rows> {
    let dims @ [nx, ny, nz] = lumen.gas.dims();
    let slices: Vec<_> = (0..nz)
        .into_par_iter()
        .map(|k| {
            progress.advance(1)?;
            let mut runs = Vec::new();
            let mut lengths = Vec::with_capacity(ny);
            for j in 0..ny {
                let before = runs.len();
                complement([lumen.gas.row(j, k), lumen.fluid.row(j, k)], nx as u32, &mut runs);
                lengths.push((runs.len() - before) as u32);
            }
            Ok((lengths, runs))
        })
        .collect::<Result<_>>()?;
    let rows = Rows::from_slices(dims, slices)?;
    progress.check()?;
    let (set, count) = rows.components_by_corners();
    // An island entirely within fluid is undissolved tagging or noise, not something in the gas.
    let mut in_gas = vec![false; count];
    let mut outer = vec![false; count];
    for k in 0..nz {
        for j in 0..ny {
            let on_face = j == 0 || k == 0 || j + 1 == ny || k + 1 == nz;
            for n in rows.row_range(j, k) {
                let r = rows.runs()[n];
                outer[set[n] as usize] |= on_face || r.start == 0 || r.end as usize == nx;
                let (j, k) = (j as i64, k as i64);
                in_gas[set[n] as usize] |=
                    [i64::from(r.start) - 1, i64::from(r.end)].iter().any(|&i| lumen.gas.find(i, j, k).is_some());
            }
        }
    }
    let mut number = 0;
    let numbers: Vec<Option<u32>> = outer
        .into_iter()
        .zip(in_gas)
        .map(|(outer, in_gas)| {
            let island = in_gas && !outer;
            number += u32::from(island);
            island.then(|| number - 1)
        })
        .collect();
    Ok(rows.pick(|n, _| numbers[set[n] as usize]))
}

/// Appends the parts of 0 to `nx` that two rows of runs leave uncovered.
fn complement(covered: [&[Run]; 2], nx: u32, out: &mut Vec<Run>) {
    let [a, b] = covered;
    let (mut i, mut j, mut next) = (0, 0, 0);
    loop {
        let take_a = match (a.get(i), b.get(j)) {
            (None, None) => break,
            (Some(x), Some(y)) => x.start < y.start,
            (x, _) => x.is_some(),
        };
        let r = if take_a { a[i] } else { b[j] };
        if take_a {
            i += 1;
        } else {
            j += 1;
        }
        if r.start > next {
            out.push(Run { start: next, end: r.start, label: 0 });
        }
        next = next.max(r.end);
    }
    if next < nx {
        out.push(Run { start: next, end: nx, label: 0 });
    }
}

/// Returns the voxels that belong to rods, labelled by rod.
fn rods(volume: &Volume, lumen: &Lumen, loose: &Rows, progress: &Progress) -> Result<Rows> {
    let dims @ [_, ny, nz] = lumen.gas.dims();
    let grid = volume.grid();
    let steps = Steps::new(grid);
    let found: Vec<(Voxels, Voxels)> = (0..nz)
        .into_par_iter()
        .map(|k| {
            progress.check()?;
            let (mut sure, mut likely) = (Vec::new(), Vec::new());
            for p in thin_gaps(lumen, k, (THIN_MM / grid.spacing().x) as u32, THIN_MM / grid.spacing().y) {
                let thin = steps.thin_lines(volume, p);
                if thin >= NEARLY_THIN_LINES && loose.find(p[0], p[1], p[2]).is_none() {
                    likely.push(p);
                    if thin >= THIN_LINES {
                        sure.push(p);
                    }
                }
            }
            Ok((sure, likely))
        })
        .collect::<Result<_>>()?;
    let rows = Rows::from_slices(dims, found.iter().map(|f| slice_runs(&f.1, ny)).collect())?;
    let (set, count) = rows.components_by_corners();
    let labelled = rows.pick(|n, _| Some(set[n]));
    let mut sure = vec![0; count];
    for p in found.iter().flat_map(|f| &f.0) {
        if let Some(r) = labelled.find(p[0], p[1], p[2]) {
            sure[r.label as usize] += 1;
        }
    }
    let mut size = vec![(0.0, 0.0); count];
    for (j, k, r) in labelled.iter() {
        let of_rod = &mut size[r.label as usize];
        let attached = r.range().filter(|&i| is_attached(volume, &labelled, [i as i64, j as i64, k as i64])).count();
        *of_rod = (of_rod.0 + f64::from(r.len()), of_rod.1 + attached as f64);
    }
    let is_bridge = |rod: usize| sure[rod] >= SURE_VOXELS && size[rod].1 <= ATTACHED_SHARE * size[rod].0;
    Ok(labelled.select(|rod| is_bridge(rod as usize).then_some(rod)))
}

/// True if one of a voxel's 26 neighbours is tissue that does not belong to a rod.
fn is_attached(volume: &Volume, rods: &Rows, p: [i64; 3]) -> bool {
    LINES.iter().flat_map(|l| [*l, l.map(|x| -x)]).any(|l| {
        let [i, j, k]: [i64; 3] = std::array::from_fn(|a| p[a] + l[a]);
        volume.get(i, j, k) > GAS_HU && rods.find(i, j, k).is_none()
    })
}

/// Returns the runs of a slice's voxels (in order), in the form that [`Rows::from_slices`] takes.
fn slice_runs(voxels: &[[i64; 3]], ny: usize) -> (Vec<u32>, Vec<Run>) {
    let mut runs: Vec<Run> = Vec::new();
    let mut lengths = vec![0; ny];
    for p in voxels {
        let x = p[0] as u32;
        let length = &mut lengths[p[1] as usize];
        match runs.last_mut().filter(|r| *length > 0 && r.end == x) {
            Some(last) => last.end += 1,
            None => {
                runs.push(Run { start: x, end: x + 1, label: 0 });
                *length += 1;
            }
        }
    }
    (lengths, runs)
}

/// Returns the voxels of slice `k` that are, along x or along y, in a gap of the gas no longer than the given number of
/// voxels, in voxel order. Whatever a rod's direction, one of the two crosses it.
fn thin_gaps(lumen: &Lumen, k: usize, most_x: u32, most_y: f64) -> Vec<[i64; 3]> {
    let gas = &lumen.gas;
    let [_, ny, _] = gas.dims();
    let axis_direction = AxisDirection { axis: 1, sign: 1 };
    let mut out = Vec::new();
    for j in 0..ny {
        for w in gas.row(j, k).windows(2).filter(|w| w[1].start - w[0].end <= most_x) {
            out.extend((w[0].end..w[1].start).map(|i| [j as i64, i64::from(i)]));
        }
        for &r in gas.row(j, k) {
            gas.beyond(r, j, k, axis_direction, |[i, j, k]| {
                let gap = (1..=most_y as i64).find(|n| gas.find(i, j + n, k).is_some());
                out.extend((0..gap.unwrap_or(0)).map(|n| [j + n, i]));
            });
        }
    }
    out.sort_unstable();
    out.dedup();
    out.into_iter().map(|[j, i]| [i, j, k as i64]).collect()
}

/// The thirteen lines with the length of a step along each, mm.
struct Steps([([i64; 3], f64); 13]);

impl Steps {
    fn new(grid: &Grid) -> Self {
        Self(LINES.map(|line| (line, (DVec3::from_array(line.map(|x| x as f64)) * grid.spacing()).length())))
    }

    /// Returns the number of lines along which the tissue around a voxel is thin, with gas at both ends.
    ///
    /// Thin is relative to the fourth thinnest of the thirteen lines. A line at an angle φ to a rod of thickness t
    /// passes through t / sin φ of it, so only the one or two lines within about 25° of the rod see much more. At φ to
    /// a sheet's normal a line passes through t / cos φ, and a third of all lines see much more.
    fn thin_lines(&self, volume: &Volume, p: [i64; 3]) -> usize {
        let mut runs = [f64::INFINITY; 13];
        let mut endless = 0;
        for (run, &(line, step_mm)) in runs.iter_mut().zip(&self.0) {
            let gas = |n: i64| volume.get(p[0] + line[0] * n, p[1] + line[1] * n, p[2] + line[2] * n) <= GAS_HU;
            let most = (THIN_MM / step_mm) as i64;
            let ends = (1..=most).find(|&n| gas(n)).and_then(|n| (1..=most - n + 1).find(|&m| gas(-m)).map(|m| n + m));
            match ends {
                Some(n) => *run = (n - 1) as f64 * step_mm,
                None => endless += 1,
            }
            if endless > LINES.len() - NEARLY_THIN_LINES {
                return 0;
            }
        }
        runs.sort_by(f64::total_cmp);
        let limit = THIN_RATIO * runs[3] + THIN_SLACK_MM;
        runs.iter().filter(|&&run| run <= limit).count()
    }
}

/// Returns the position and size of each existing label.
fn gather(grid: &Grid, rows: &Rows) -> impl Iterator<Item = Remnant> {
    let count = rows.runs().iter().map(|r| r.label as usize + 1).max().unwrap_or(0);
    let mut found = vec![(DVec3::ZERO, 0.0, DVec3::INFINITY, DVec3::NEG_INFINITY); count];
    for (j, k, r) in rows.iter() {
        let f = &mut found[r.label as usize];
        let [first, last] = [r.start, r.end - 1].map(|i| DVec3::new(f64::from(i), j as f64, k as f64));
        f.0 += (first + last) / 2.0 * f64::from(r.len());
        f.1 += f64::from(r.len());
        (f.2, f.3) = (f.2.min(first), f.3.max(last));
    }
    let (spacing, voxel_ml, to_world) = (grid.spacing(), grid.voxel_ml(), *grid.to_world());
    found.into_iter().filter(|f| f.1 > 0.0).map(move |(sum, voxels, low, high)| Remnant {
        at: to_world.transform_point3(sum / voxels),
        ml: voxels * voxel_ml,
        length_mm: ((high - low) * spacing).length(),
    })
}
