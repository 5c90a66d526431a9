//! Selection of the colon's gas: outside air, gas around the patient and lungs are recognised by position and texture.

use rayon::prelude::*;

use super::TISSUE_HU;
use super::frame::Frame;
use super::kinds::GasKind;
use super::others::Other;
use super::runs::{Rows, Run};
use crate::volume::{Grid, Volume};

/// Minimum size of a piece of gas as a fraction of the largest one, unless it is [`AMPLE_ML`].
const LEAST_SHARE: f64 = 0.05;
/// Gas of this volume is kept however large the largest piece is, ml: part of the colon between two collapsed stretches.
const AMPLE_ML: f64 = 15.0;
/// Bubbles smaller than this are never kept beside a larger piece, ml.
pub(super) const BUBBLE_ML: f64 = 0.1;
/// Maximum number of pieces (the largest are kept).
const MOST: usize = 32;
/// Tissue that surrounds gas inside the body on every side, mm: more than the shell of a table, less than the skin and
/// muscle of a lean patient.
const ENCLOSING_MM: f64 = 6.0;
/// Minimum excess of the lung's median over the scan's own gas, HU. Even emphysema rarely comes closer.
const LUNG_ABOVE_GAS: i32 = 70;
/// Same for gas that reaches the scan's superior end, where lungs are expected.
const LUNG_ABOVE_GAS_AT_TOP: i32 = 45;
/// Maximum value of the scan's gas if there is no darker one, HU.
const GAS_AT_MOST: i32 = -950;
/// Maximum excess of the scan's gas over the air around the patient, HU: scatter and the blur of walls.
const GAS_ABOVE_AIR: i32 = 20;
/// Value of air, HU; a scan's own may be less, or be padding.
const AIR: i32 = -1000;
/// Number of voxels of a piece whose surroundings are examined.
const PROBES: usize = 160;

/// A connected component of gas.
#[derive(Clone, Copy, Debug, Default)]
struct Piece {
    voxels: u64,
    /// True if it touches a face of the grid other than the superior and the inferior one.
    on_side: bool,
    on_top: bool,
}

/// The kind of a component, if it is beyond doubt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// It may be colon.
    Unsure,
    /// Air outside the patient.
    Outside,
    /// Gas not enclosed by the body: in the table, in folds of clothes.
    Around,
    /// Lung with its airways.
    Lung,
}

impl Kind {
    /// Returns its name and the reason; `None` if unsure.
    pub(crate) fn reported(self) -> Option<(GasKind, &'static str)> {
        match self {
            Self::Unsure => None,
            Self::Outside => Some((GasKind::Outside, "it reaches a lateral face of the scan")),
            Self::Around => Some((GasKind::Outside, "no tissue encloses it")),
            Self::Lung => Some((GasKind::Lung, "it is brighter than gas, as lung is")),
        }
    }
}

/// The result of examining a component's probes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Found {
    /// Median, HU, possibly that of gas, with tissue around it.
    Dark(i32),
    /// Brighter than lung can be, however dark the scan's gas is; the surroundings were not examined.
    Bright,
    /// No tissue around it.
    Bare,
}

impl Found {
    fn median(self) -> Option<i32> {
        if let Self::Dark(median) = self { Some(median) } else { None }
    }
}

/// The examination of all components.
pub(super) struct ComponentReview {
    pieces: Vec<Piece>,
    voxel_ml: f64,
    /// The largest components within the body, by volume, the largest first (ties by label).
    inside: Vec<(u32, Found)>,
    /// The value of the scan's own gas, HU.
    gas: i32,
}

impl ComponentReview {
    fn ml(&self, c: u32) -> f64 {
        self.pieces[c as usize].voxels as f64 * self.voxel_ml
    }

    /// Returns the kind of each component.
    pub(crate) fn kinds(&self) -> Vec<Kind> {
        let mut kinds: Vec<Kind> =
            self.pieces.iter().map(|p| if p.on_side { Kind::Outside } else { Kind::Unsure }).collect();
        // The few voxels of a bubble are near its wall, hence brighter than gas, and say little about its surroundings.
        for &(c, found) in self.inside.iter().filter(|&&(c, _)| self.ml(c) >= AMPLE_ML) {
            kinds[c as usize] = match found {
                Found::Dark(median) if self.is_dark(c, median) => Kind::Unsure,
                Found::Dark(_) | Found::Bright => Kind::Lung,
                Found::Bare => Kind::Around,
            };
        }
        kinds
    }

    /// Returns the components that may be colon, by volume, the largest first (ties by label).
    pub(crate) fn colon(&self) -> Vec<u32> {
        let dark = self.inside.iter().filter_map(|&(c, f)| Some((c, f.median()?)));
        let mut kept: Vec<u32> = dark.filter(|&(c, median)| self.is_dark(c, median)).map(|s| s.0).collect();
        if let Some(&largest) = kept.first() {
            let least = (self.ml(largest) * LEAST_SHARE).clamp(BUBBLE_ML, AMPLE_ML);
            kept.retain(|&c| c == largest || self.ml(c) >= least);
        }
        kept.truncate(MOST);
        kept
    }

    /// Returns the ample components that are surely no colon and not among `chosen`, by the size of their cores.
    pub(crate) fn others(&self, grid: &Grid, rows: &Rows, chosen: &[u32]) -> Vec<Other> {
        let mut all: Vec<Option<Other>> = (0..)
            .zip(self.kinds())
            .map(|(c, kind): (u32, Kind)| {
                let (kind, why) = kind.reported().filter(|_| self.ml(c) >= AMPLE_ML && !chosen.contains(&c))?;
                Some(Other { ml: self.ml(c), ..Other::sure(kind, why) })
            })
            .collect();
        for (j, k, r) in rows.iter() {
            if let Some(o) = &mut all[r.label as usize] {
                o.reach(grid, r, j, k);
            }
        }
        all.into_iter().flatten().collect()
    }

    /// True if a component's median is that of gas rather than of lung.
    fn is_dark(&self, c: u32, median: i32) -> bool {
        let margin = if self.pieces[c as usize].on_top { LUNG_ABOVE_GAS_AT_TOP } else { LUNG_ABOVE_GAS };
        median - self.gas <= margin
    }
}

/// Examines the components.
pub(super) fn look(volume: &Volume, rows: &Rows, components: usize, frame: Frame) -> ComponentReview {
    let pieces = survey(rows, components, frame);
    let voxel_ml = volume.grid().voxel_ml();
    let ml = |c: u32| pieces[c as usize].voxels as f64 * voxel_ml;
    let mut inside: Vec<u32> = (0..components as u32).filter(|&c| !pieces[c as usize].on_side).collect();
    inside.sort_by_key(|&c| (std::cmp::Reverse(pieces[c as usize].voxels), c));
    // Thousands of bubbles need no closer examination: the largest piece that passes decides what is kept.
    inside.truncate(8 * MOST);
    let samples = sample(rows, &inside, components);
    let found: Vec<Found> = samples
        .par_iter()
        .map(|probes| {
            let median = median(volume, probes);
            if median > GAS_AT_MOST + LUNG_ABOVE_GAS {
                return Found::Bright;
            }
            if is_enclosed(volume, frame, probes) { Found::Dark(median) } else { Found::Bare }
        })
        .collect();
    let inside: Vec<(u32, Found)> = inside.into_iter().zip(found).collect();
    let seen: Vec<(u32, i32)> = inside.iter().filter_map(|&(c, f)| Some((c, f.median()?))).collect();
    let ample = |&&(c, _): &&(u32, i32)| ml(c) >= AMPLE_ML;
    let darkest = seen.iter().filter(ample).map(|s| s.1).min().or_else(|| seen.iter().map(|s| s.1).min());
    let around = (0..components as u32).filter(|&c| pieces[c as usize].on_side);
    let around = around.reduce(|a, b| if pieces[b as usize].voxels > pieces[a as usize].voxels { b } else { a });
    let air = around.map(|c| median(volume, &sample(rows, &[c], components)[0]).max(AIR));
    let gas = darkest.into_iter().chain(air.map(|a| a + GAS_ABOVE_AIR)).fold(GAS_AT_MOST, i32::min);
    ComponentReview { pieces, voxel_ml, inside, gas }
}

/// True if a component reaches a lateral face of the grid, as outside air does.
pub(super) fn is_outside(rows: &Rows, component: u32, frame: Frame) -> bool {
    let dims = rows.dims();
    rows.iter().any(|(j, k, r)| r.label == component && faces(dims, frame, j, k, r).0)
}

fn survey(rows: &Rows, components: usize, frame: Frame) -> Vec<Piece> {
    let mut pieces = vec![Piece::default(); components];
    let dims = rows.dims();
    for (j, k, r) in rows.iter() {
        let p = &mut pieces[r.label as usize];
        p.voxels += u64::from(r.len());
        let (side, top) = faces(dims, frame, j, k, r);
        p.on_side |= side;
        p.on_top |= top;
    }
    pieces
}

/// Returns two flags: the run reaches a lateral face, and it reaches the superior face.
fn faces(dims: [usize; 3], frame: Frame, j: usize, k: usize, r: Run) -> (bool, bool) {
    let up = frame.superior;
    let low = [r.start == 0, j == 0, k == 0];
    let high = [r.end as usize == dims[0], j + 1 == dims[1], k + 1 == dims[2]];
    let side = (0..3).any(|a| a != up.axis && (low[a] || high[a]));
    (side, if up.sign > 0 { high[up.axis] } else { low[up.axis] })
}

/// Returns voxels of each of the `chosen` components, spread evenly over it.
fn sample(rows: &Rows, chosen: &[u32], components: usize) -> Vec<Vec<[i64; 3]>> {
    const NONE: u32 = u32::MAX;
    let mut place = vec![NONE; components];
    for (n, &c) in chosen.iter().enumerate() {
        place[c as usize] = n as u32;
    }
    let mut voxels = vec![0u64; chosen.len()];
    for r in rows.runs().iter().filter(|r| place[r.label as usize] != NONE) {
        voxels[place[r.label as usize] as usize] += u64::from(r.len());
    }
    let mut out = vec![Vec::new(); chosen.len()];
    let mut passed = vec![0u64; chosen.len()];
    for (j, k, r) in rows.iter().filter(|(_, _, r)| place[r.label as usize] != NONE) {
        let n = place[r.label as usize] as usize;
        // Probe p is in the middle of the p-th of PROBES equal parts of the component's voxels.
        let at = |p: usize| (2 * p as u64 + 1) * voxels[n] / (2 * PROBES as u64);
        while out[n].len() < PROBES && at(out[n].len()) < passed[n] + u64::from(r.len()) {
            let i = i64::from(r.start) + at(out[n].len()).saturating_sub(passed[n]) as i64;
            out[n].push([i, j as i64, k as i64]);
        }
        passed[n] += u64::from(r.len());
    }
    out
}

fn median(volume: &Volume, probes: &[[i64; 3]]) -> i32 {
    let mut values: Vec<i16> = probes.iter().map(|p| volume.get(p[0], p[1], p[2])).collect();
    values.sort_unstable();
    i32::from(values[values.len() / 2])
}

/// True if most probes have tissue around them: in the axial plane, in at least seven of eight directions.
fn is_enclosed(volume: &Volume, frame: Frame, probes: &[[i64; 3]]) -> bool {
    const COMPASS: [(f64, f64); 8] =
        [(1.0, 0.0), (0.7, 0.7), (0.0, 1.0), (-0.7, 0.7), (-1.0, 0.0), (-0.7, -0.7), (0.0, -1.0), (0.7, -0.7)];
    let spacing = volume.grid().spacing();
    let (a, b) = (frame.left.axis, frame.posterior.axis);
    let step_mm = spacing[a].min(spacing[b]);
    let enclosed = probes
        .iter()
        .filter(|p| {
            let walled = COMPASS.iter().filter(|(u, v)| {
                let mut step = [0.0; 3];
                step[a] = u * step_mm / spacing[a];
                step[b] = v * step_mm / spacing[b];
                is_walled(volume, p, step, step_mm)
            });
            walled.count() + 1 >= COMPASS.len()
        })
        .count();
    !probes.is_empty() && 5 * enclosed >= 3 * probes.len()
}

/// True if the ray from `from` by `step` (voxels, `step_mm` long) passes through enough tissue, or through tissue to
/// the grid's border.
fn is_walled(volume: &Volume, from: &[i64; 3], step: [f64; 3], step_mm: f64) -> bool {
    let dims = volume.grid().dims();
    let (mut tissue, mut last) = (0.0, false);
    for n in 1.. {
        let p: [i64; 3] = std::array::from_fn(|x| from[x] + (step[x] * f64::from(n)).round() as i64);
        if (0..3).any(|x| p[x] < 0 || p[x] >= dims[x] as i64) {
            return last;
        }
        last = volume.get(p[0], p[1], p[2]) > TISSUE_HU;
        if last {
            tissue += step_mm;
            if tissue >= ENCLOSING_MM {
                return true;
            }
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::volume::Grid;

    /// A volume of air with tissue where `is_tissue` says, for positions in mm from the middle.
    fn volume(spacing: f64, is_tissue: impl Fn(DVec3) -> bool) -> Volume {
        let side = (80.0 / spacing) as usize + 1;
        let dims = [side, side, 3];
        let grid = Grid::new(dims, DVec3::splat(spacing), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let middle = DVec3::new((side / 2) as f64, (side / 2) as f64, 1.0);
        let at = |n: usize| DVec3::new((n % side) as f64, (n / side % side) as f64, (n / side / side) as f64) - middle;
        let hu = |n: usize| if is_tissue(at(n) * spacing) { 40 } else { -1000 };
        Volume::new(grid.clone(), (0..grid.len()).map(hu).collect())
    }

    fn enclosed(spacing: f64, is_tissue: impl Fn(DVec3) -> bool) -> bool {
        let volume = volume(spacing, is_tissue);
        let middle = (volume.grid().dims()[0] / 2) as i64;
        is_enclosed(&volume, Frame::of(volume.grid()), &[[middle, middle, 1]])
    }

    /// Around gas there is tissue in seven of eight directions at least, 6 mm of it or up to the border, however fine the
    /// voxels are.
    #[test]
    fn gas_in_a_body_is_enclosed_and_gas_in_a_thin_shell_is_not() {
        for spacing in [0.5, 0.7, 1.0, 2.0] {
            let ring = |thick: f64| move |p: DVec3| (10.0..10.0 + thick).contains(&p.length());
            assert!(enclosed(spacing, ring(10.0)), "{spacing}");
            assert!(!enclosed(spacing, ring(4.0)), "{spacing}");
            assert!(enclosed(spacing, |p: DVec3| p.length() > 36.0), "up to the border, {spacing}");
            assert!(!enclosed(spacing, |_| false));
        }
    }

    /// One direction may be open, two may not, wherever they are.
    #[test]
    fn a_body_may_be_open_on_one_side() {
        let towards = |p: DVec3, n: usize| {
            let angle = p.y.atan2(p.x) - n as f64 * std::f64::consts::FRAC_PI_4;
            angle.sin().atan2(angle.cos()).abs() < 0.3
        };
        for a in 0..8 {
            assert!(enclosed(1.0, |p| p.length() > 10.0 && p.length() < 30.0 && !towards(p, a)), "{a}");
            for b in 0..a {
                assert!(
                    !enclosed(1.0, |p| p.length() > 10.0 && p.length() < 30.0 && !towards(p, a) && !towards(p, b)),
                    "{a}, {b}"
                );
            }
        }
    }

    /// Probes are voxels of their component, evenly through it, in components smaller and larger than their number.
    #[test]
    fn probes_are_spread_over_their_component() {
        for (length, rows) in [(3u32, 2usize), (40, 4), (40, 30), (41, 37), (8, 20)] {
            let run = |start, label| Run { start, end: start + length, label };
            let lengths = vec![2u32; rows];
            let runs = (0..rows).flat_map(|j| [run(j as u32, 0), run(100 + j as u32, 1)]).collect();
            let rows_of = Rows::from_slices([200, rows, 1], vec![(lengths, runs)]).unwrap();
            let probes = sample(&rows_of, &[1], 2);
            let probes = &probes[0];
            assert_eq!(probes.len(), PROBES);
            let number = |p: &[i64; 3]| {
                let i = p[0] - 100 - p[1];
                assert!((0..i64::from(length)).contains(&i), "{p:?} is no voxel of it");
                p[1] * i64::from(length) + i
            };
            let all = rows as i64 * i64::from(length);
            for (n, p) in probes.iter().enumerate() {
                let even = (2 * n as i64 + 1) * all / (2 * PROBES as i64);
                assert_eq!(number(p), even, "{length} × {rows}, probe {n}");
            }
        }
    }

    #[test]
    fn what_is_no_colon_is_named_with_its_reason() {
        assert_eq!(Kind::Unsure.reported(), None);
        let named = [Kind::Outside, Kind::Around, Kind::Lung].map(|k| k.reported().unwrap());
        assert_eq!(named.map(|n| n.0), [GasKind::Outside, GasKind::Outside, GasKind::Lung]);
        assert!(named.iter().all(|n| n.1.len() > 10));
    }
}
