//! The body of gas that a voxel belongs to, for painting and pointing.

use std::ops::Range;

use glam::DVec3;

use super::kinds::GasKind;
use super::others::{Other, Others};
use super::runs::{Rows, Run, touching};
use super::{Lumen, SNAP_MM, Told, ends};
use crate::error::Result;
use crate::math::sets::Sets;
use crate::volume::Grid;

/// Binary places of fixed-point voxel coordinates.
const SHIFT: u32 = 32;
const ONE: i64 = 1 << SHIFT;
/// Largest coordinate that a fixed-point number holds with room for a line from there, voxels.
const FARTHEST: f64 = 1e8;
/// A voxel beyond all those.
const OUTSIDE: i64 = 1 << 30;

/// A body of gas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GasBody {
    /// Its kind.
    pub kind: GasKind,
    /// The reason for it, in words.
    pub why: &'static str,
    /// Volume of gas, ml.
    pub ml: f64,
    /// A place in its gas, world, mm.
    pub place: DVec3,
    /// True if the reader gave it its kind.
    pub is_told: bool,
}

/// All bodies of gas in a scan, those of the lumen with their tagged fluid. A voxel belongs to one of them, or to none.
#[derive(Clone, Debug)]
pub struct KindMap {
    bodies: Vec<GasBody>,
    grid: Grid,
    /// Labelled with the number of their body.
    rows: Rows,
}

impl Others {
    /// Returns the bodies of all gas: the segments of the lumen that this belongs to, and the pieces of other gas. Bodies with a place
    /// in `told` have the kind given there.
    ///
    /// # Errors
    /// Returns an error if there are too many runs to number.
    pub fn map(&self, lumen: &Lumen, told: &[Told]) -> Result<KindMap> {
        let grid = lumen.grid();
        let [_, ny, nz] = grid.dims();
        let slices = |top: &Rows, below: &Rows| {
            Rows::gather(grid.dims(), |k| {
                let (mut lengths, mut runs) = (Vec::with_capacity(ny), Vec::new());
                for j in 0..ny {
                    let before = runs.len();
                    overlaid(row(top, j, k), row(below, j, k), &mut runs);
                    lengths.push((runs.len() - before) as u32);
                }
                Ok((lengths, runs))
            })
        };
        let [sure, judged] = &self.rows;
        let own = slices(&lumen.gas, &lumen.fluid)?;
        let segments = lumen.segments.len() as u32;
        // Other gas is labelled with its kind until its connected pieces are known.
        let other = slices(judged, sure)?.pick(|_, r| Some(r.label + segments));
        let all = slices(&own, &other)?;
        drop((own, other));
        let mut sets = Sets::new(all.runs().len());
        for (j, k) in (0..nz).flat_map(|k| (0..ny).map(move |j| (j, k))) {
            let here = all.row_range(j, k);
            for (n, w) in all.runs()[here.clone()].windows(2).enumerate() {
                if w[0].end == w[1].start && w[0].label == w[1].label {
                    sets.join((here.start + n) as u32, (here.start + n + 1) as u32);
                }
            }
            let beside =
                [(j > 0).then(|| all.row_range(j.wrapping_sub(1), k)), (k > 0).then(|| all.row_range(j, k - 1))];
            for other in beside.into_iter().flatten() {
                touching(&all.runs()[other.clone()], &all.runs()[here.clone()], |a, b| {
                    let [a, b] = [other.start + a, here.start + b];
                    if all.runs()[a].label == all.runs()[b].label {
                        sets.join(a as u32, b as u32);
                    }
                });
            }
        }
        let (of, count) = sets.numbered();
        // Segments first: growth may have split one of them, but it is still one body.
        let mut bodies: Vec<GasBody> = (lumen.segments.iter())
            .map(|s| {
                let (kind, why) =
                    s.judged.map_or((GasKind::Colon, "it looks like gas of a colon"), |j| (j.kind, j.why));
                GasBody { kind, why, ml: s.ml, place: s.ends[0], is_told: false }
            })
            .collect();
        let centre = |r: Run, j: usize, k: usize| {
            grid.world(DVec3::new(f64::from(r.start + (r.len() - 1) / 2), j as f64, k as f64))
        };
        let mut longest = vec![0; bodies.len()];
        for (j, k, r) in lumen.gas.iter().filter(|(_, _, r)| r.label < segments) {
            let n = r.label as usize;
            if r.len() > longest[n] {
                (longest[n], bodies[n].place) = (r.len(), centre(r, j, k));
            }
        }
        let mut number = vec![u32::MAX; count];
        let mut bounds = vec![Other::NOWHERE; count];
        for (n, (j, k, r)) in all.iter().enumerate() {
            let set = of[n] as usize;
            if r.label < segments {
                number[set] = r.label;
            } else if number[set] == u32::MAX {
                number[set] = bodies.len() as u32;
                let kind = GasKind::ALL[(r.label - segments) as usize];
                bodies.push(GasBody { kind, why: "", ml: 0.0, place: centre(r, j, k), is_told: false });
                longest.push(r.len());
            }
            if r.label >= segments {
                let n = number[set] as usize;
                bodies[n].ml += f64::from(r.len()) * grid.voxel_ml();
                if r.len() > longest[n] {
                    (longest[n], bodies[n].place) = (r.len(), centre(r, j, k));
                }
            }
            for i in [r.start, r.end - 1] {
                let p = grid.world(DVec3::new(f64::from(i), j as f64, k as f64));
                bounds[set] = [bounds[set][0].min(p), bounds[set][1].max(p)];
            }
        }
        for (set, n) in number.iter().enumerate().filter(|(_, n)| (segments..u32::MAX).contains(n)) {
            let body = &mut bodies[*n as usize];
            body.why = self.why(body.kind, bounds[set]);
        }
        let rows = all.joined(|n, _| Some(number[of[n] as usize]));
        let mut map = KindMap { bodies, grid: grid.clone(), rows };
        for (at, kind) in told {
            if let Some((n, _)) = map.nearest(*at, SNAP_MM) {
                let body = &mut map.bodies[n];
                (body.kind, body.why, body.is_told) = (*kind, "set by the reader", true);
            }
        }
        Ok(map)
    }

    /// Returns the reason of the smallest piece of a kind that reaches around the middle of these bounds.
    fn why(&self, kind: GasKind, [low, high]: [DVec3; 2]) -> &'static str {
        let (middle, same) = (low.midpoint(high), || self.pieces.iter().filter(|p| p.kind == kind));
        let size = |p: &&Other| (p.bounds_mm[1] - p.bounds_mm[0]).element_product();
        let around = |p: &&Other| middle.cmpge(p.bounds_mm[0]).all() && middle.cmple(p.bounds_mm[1]).all();
        let smallest = same().filter(around).min_by(|a, b| size(a).total_cmp(&size(b)));
        smallest.or(same().next()).map_or("it is connected to gas of that kind", |p| p.why)
    }
}

impl KindMap {
    /// Returns the bodies: the segments of the lumen first, in their order.
    pub fn bodies(&self) -> &[GasBody] {
        &self.bodies
    }

    /// Returns the number of the body at a place (world, mm).
    pub fn body_at(&self, world: DVec3) -> Option<usize> {
        let [i, j, k] = ends::to_index(self.grid.voxel(world));
        self.rows.find(i, j, k).map(|r| r.label as usize)
    }

    /// Returns the body nearest to a place (world, mm) and the centre of its nearest voxel, if one is within `within_mm`.
    pub fn nearest(&self, world: DVec3, within_mm: f64) -> Option<(usize, DVec3)> {
        ends::nearest(&self.grid, &self.rows, world, within_mm, |_| true).map(|(n, p)| (n as usize, p))
    }

    /// Calls `each` with the numbers of the places on a line that are in a body, and the body, part by part: `count` places from `start`
    /// on (world, mm), `step` mm apart.
    pub fn along(&self, start: DVec3, step: DVec3, count: usize, mut each: impl FnMut(Range<usize>, usize)) {
        // Fixed-point numbers: rounding floats would take most of the time.
        let fixed = |v: DVec3| v.to_array().map(|x| (x.clamp(-FARTHEST, FARTHEST) * ONE as f64) as i64);
        let from = fixed(self.grid.voxel(start)).map(|x| x + ONE / 2);
        let by = fixed(self.grid.to_voxel().transform_vector3(step));
        let [_, ny, nz] = self.rows.dims();
        let mut n = 0;
        while n < count {
            let at: [i64; 3] = std::array::from_fn(|a| from[a].wrapping_add(by[a].wrapping_mul(n as i64)));
            let [i, j, k] = at.map(|x| x >> SHIFT);
            let is_within = (j as u64) < ny as u64 && (k as u64) < nz as u64;
            let row = if is_within { self.rows.row(j as usize, k as usize) } else { &[] };
            let next = row.partition_point(|r| i64::from(r.end) <= i);
            let (part, body) = match row.get(next) {
                Some(r) if i64::from(r.start) <= i => ([r.start, r.end].map(i64::from), Some(r.label as usize)),
                after => {
                    let before = next.checked_sub(1).and_then(|n| row.get(n));
                    let from = before.map_or(-OUTSIDE, |r| i64::from(r.end));
                    ([from, after.map_or(OUTSIDE, |r| i64::from(r.start))], None)
                }
            };
            // The line leaves this part of the row along one of the axes.
            let parts = [part, [j, j + 1], [k, k + 1]];
            let stays = (0..3).map(|a| places_within(at[a], by[a], parts[a])).fold(count - n, usize::min).max(1);
            if let Some(body) = body {
                each(n..n + stays, body);
            }
            n += stays;
        }
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        self.rows.bytes() + self.bodies.capacity() * size_of::<GasBody>()
    }
}

/// Returns how many places from `at` on, `by` apart, are within these voxels; all three are fixed-point numbers or voxels.
fn places_within(at: i64, by: i64, [low, high]: [i64; 2]) -> usize {
    let room = match by {
        0 => return usize::MAX,
        1.. => (high << SHIFT) - at - 1,
        _ => at - (low << SHIFT),
    };
    (room / by.abs()) as usize + 1
}

/// Returns a row; no run of rows without voxels.
fn row(rows: &Rows, j: usize, k: usize) -> &[Run] {
    if rows.dims().contains(&0) { &[] } else { rows.row(j, k) }
}

/// Adds the runs of a row, and those parts of another one that they do not cover.
fn overlaid(top: &[Run], below: &[Run], out: &mut Vec<Run>) {
    let mut covers = top.iter().copied().peekable();
    for &r in below {
        let mut next = r.start;
        while let Some(&cover) = covers.peek().filter(|c| c.start < r.end) {
            if cover.start > next {
                out.push(Run { start: next, end: cover.start, ..r });
            }
            next = next.max(cover.end);
            if cover.end > r.end {
                // It may cover a part of the following run, too.
                break;
            }
            out.push(cover);
            covers.next();
        }
        if next < r.end {
            out.push(Run { start: next, ..r });
        }
    }
    out.extend(covers);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::lumen;
    use crate::phantom::PhantomSettings;
    use crate::progress::Progress;
    use crate::shared::shared;

    fn run(start: u32, end: u32, label: u32) -> Run {
        Run { start, end, label }
    }

    #[test]
    fn what_lies_below_shows_beside_what_covers_it() {
        let over = |top: &[Run], below: &[Run]| {
            let mut out = Vec::new();
            overlaid(top, below, &mut out);
            out
        };
        let below = [run(2, 10, 7), run(12, 20, 8)];
        assert_eq!(over(&[], &below), below);
        assert_eq!(over(&below, &[]), below);
        assert_eq!(over(&[run(0, 30, 1)], &below), [run(0, 30, 1)]);
        assert_eq!(
            over(&[run(0, 3, 1), run(5, 6, 2), run(9, 14, 3), run(30, 31, 4)], &below),
            [run(0, 3, 1), run(3, 5, 7), run(5, 6, 2), run(6, 9, 7), run(9, 14, 3), run(14, 20, 8), run(30, 31, 4)]
        );
    }

    #[test]
    fn every_voxel_of_the_lumen_is_in_the_body_of_its_segment() {
        let progress = Progress::new();
        let (_, volume) = shared(&PhantomSettings { fluid: true, ..PhantomSettings::embedded(1) });
        let lumen = lumen::find(&volume, &progress).unwrap();
        let others = lumen::not_colon(&volume, &lumen, &progress).unwrap();
        let map = others.map(&lumen, &[]).unwrap();
        let grid = volume.grid();
        for (n, s) in lumen.segments.iter().enumerate() {
            assert!((map.bodies()[n].ml - s.ml).abs() < 1e-6 * s.ml);
            assert_eq!(lumen.segment_at(map.bodies()[n].place), Some(n));
        }
        // Along rows in any direction, each place is what it is by itself.
        let (mut hits, last) = (0, grid.dims().map(|d| d as f64 - 1.0));
        // Beside the middle, so that no place is half way between two voxels.
        let middle = grid.world(DVec3::from_array(last) * 0.5) + DVec3::new(0.0131, 0.0217, 0.0173);
        for step in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(0.3, -0.4, 0.2)] {
            for aside in -8..8 {
                let start = middle + (step.any_orthonormal_vector() * 6.0) * f64::from(aside) - step * 150.0;
                let mut along = vec![None; 300];
                map.along(start, step, 300, |part, body| along[part].fill(Some(body)));
                for (n, body) in along.into_iter().enumerate() {
                    let at = start + step * n as f64;
                    assert_eq!(body, map.body_at(at));
                    if let Some(segment) = lumen.segment_at(at) {
                        assert_eq!(body, Some(segment));
                        hits += 1;
                    }
                }
            }
        }
        assert!(hits > 100, "{hits}");
        for (n, s) in lumen.segments.iter().enumerate().filter(|(_, s)| s.fluid_ml > 1.0) {
            let voxels = map.rows.runs().iter().filter(|r| r.label as usize == n).map(|r| u64::from(r.len()));
            let ml = voxels.sum::<u64>() as f64 * grid.voxel_ml();
            assert!((ml - s.ml - s.fluid_ml).abs() < 0.01, "{ml} ml with its fluid");
        }
        // A kind set by the reader replaces the automatic one.
        let (n, at) = map.nearest(lumen.segments[0].ends[0], 5.0).unwrap();
        let told = others.map(&lumen, &[(at, GasKind::Stomach)]).unwrap();
        assert_eq!((told.bodies()[n].kind, told.bodies()[n].is_told), (GasKind::Stomach, true));
    }
}
