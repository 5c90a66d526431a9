//! The least of parabolas over lines of voxels: min over p of h(p) + (s·(q − p))² for each voxel q.
//!
//! Sixteen voxels at a time look at the heights beside them, nearest first, until (s·(q − p))² alone is more than each has. In a colon, that
//! is after a dozen voxels, and takes 0.4 of the time of lower envelopes, which go through a line one voxel after the other.
//! Where more than [`FAR`] voxels would have to be looked at, an envelope is built, so that the time stays linear in the number of voxels.

use std::ops::Range;

use fearless_simd::{Level, Simd, dispatch};

use super::envelope::Envelope;
use super::lines::{Lines, Window};
use crate::fields::voxels::{VoxelSet, each_bit, each_run};

/// Voxels that are worked on at once, and their values, mm².
const LANES: usize = 16;
type Lanes = [f32; LANES];
/// Heights farther than this are left to an envelope, voxels.
const FAR: usize = 64;
/// Heights that are looked at before it is asked whether farther ones can matter.
const STEPS: usize = 4;

/// Scratch memory for one plane after the other.
#[derive(Debug, Default)]
pub(super) struct Parabolas {
    envelope: Envelope,
    /// Squared distances of 0 to [`FAR`] voxels, mm².
    squares: Vec<f32>,
    /// Sixteen columns, line by line.
    columns: Vec<Lanes>,
    /// A row with [`FAR`] voxels and more beside it on both sides.
    row: Vec<f32>,
    start: Vec<usize>,
}

impl Parabolas {
    /// Replaces the members' heights in each row of the window by the least of the parabolas in it. `square` is s², mm².
    pub(super) fn along_rows(
        &mut self,
        set: &VoxelSet,
        lines: &Lines,
        window: &Window,
        square: f32,
        values: &mut [f32],
    ) {
        self.set_square(square);
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || self.rows(set, lines, window, square, values),
        ));
    }

    /// Replaces the members' heights by the least of the parabolas across the lines of the window.
    pub(super) fn across(&mut self, set: &VoxelSet, lines: &Lines, window: &Window, square: f32, values: &mut [f32]) {
        self.set_square(square);
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || self.all_columns(set, lines, window, square, values),
        ));
    }

    fn set_square(&mut self, square: f32) {
        self.squares.clear();
        self.squares.extend((0..=FAR).map(|n| square * n as f32 * n as f32));
    }

    #[inline(always)]
    fn rows(&mut self, set: &VoxelSet, lines: &Lines, window: &Window, square: f32, values: &mut [f32]) {
        let width = window.width();
        self.row.clear();
        self.row.resize(width + 2 * FAR + LANES, f32::INFINITY);
        for (n, row) in window.lines.clone().zip(values.chunks_exact_mut(width)) {
            let members = lines.row(set.bits(), n);
            self.row[FAR..FAR + width].copy_from_slice(row);
            let heights = &self.row[..];
            let mut is_done = true;
            let mut x = 0;
            while x < width && is_done {
                let own = bits(members, window.xs.start + x) & rest(width - x);
                if own != 0 {
                    let at = FAR + x;
                    let found = least(
                        lanes(heights, at),
                        own,
                        &self.squares,
                        #[inline(always)]
                        |o| (lanes(heights, at - o), lanes(heights, at + o)),
                    );
                    match found {
                        Some(found) => put(&mut row[x..], &found, own),
                        None => is_done = false,
                    }
                }
                x += LANES;
            }
            if !is_done {
                row.copy_from_slice(&self.row[FAR..FAR + width]);
                each_run(members, |r| {
                    self.envelope.lower(&mut row[r.start - window.xs.start..r.end - window.xs.start], square);
                });
            }
        }
    }

    #[inline(always)]
    fn all_columns(&mut self, set: &VoxelSet, lines: &Lines, window: &Window, square: f32, values: &mut [f32]) {
        let width = window.width();
        let count = window.lines.len();
        let mut x = 0;
        while x < width {
            let here = x..(x + LANES).min(width);
            x += LANES;
            self.columns.clear();
            let mut is_known = false;
            for row in values.chunks_exact(width) {
                let mut own = [f32::INFINITY; LANES];
                own[..here.len()].copy_from_slice(&row[here.clone()]);
                is_known |= own.iter().fold(f32::INFINITY, |a, &b| if b < a { b } else { a }) < f32::INFINITY;
                self.columns.push(own);
            }
            // Above and below all of the lumen, nothing is known yet.
            if !is_known {
                continue;
            }
            let columns = &self.columns[..count];
            let mut is_done = true;
            for n in 0..count {
                let members = lines.row(set.bits(), window.lines.start + n);
                let own = bits(members, window.xs.start + here.start) & rest(here.len());
                if own == 0 {
                    continue;
                }
                // Beyond an end, the height there is taken as farther than it is, which is never less.
                let found = least(
                    columns[n],
                    own,
                    &self.squares,
                    #[inline(always)]
                    |o| (columns[n.saturating_sub(o)], columns[(n + o).min(count - 1)]),
                );
                match found {
                    Some(found) => put(&mut values[n * width..][here.clone()], &found, own),
                    None => {
                        is_done = false;
                        break;
                    }
                }
            }
            if !is_done {
                for (row, own) in values.chunks_exact_mut(width).zip(columns) {
                    let row = &mut row[here.clone()];
                    row.copy_from_slice(&own[..row.len()]);
                }
                self.envelopes(set, lines, window, square, (here, values));
            }
        }
    }

    /// Does the same for a part of the columns, in time linear in their length.
    fn envelopes(
        &mut self,
        set: &VoxelSet,
        lines: &Lines,
        window: &Window,
        square: f32,
        (xs, values): (Range<usize>, &mut [f32]),
    ) {
        let Self { envelope, start, row, .. } = self;
        let width = window.width();
        let first = window.lines.start;
        let mut heights = std::mem::take(row);
        start.clear();
        start.resize(LANES, 0);
        let mut before = 0;
        for n in 0..=window.lines.len() {
            let here = if n == window.lines.len() {
                0
            } else {
                bits(lines.row(set.bits(), first + n), window.xs.start + xs.start) & rest(xs.len())
            };
            each_bit(u64::from(before ^ here), |lane| {
                if here >> lane & 1 == 1 {
                    start[lane] = n;
                    return;
                }
                let at = |n: usize| n * width + xs.start + lane;
                heights.clear();
                heights.extend((start[lane]..n).map(|n| values[at(n)]));
                envelope.lower(&mut heights, square);
                (start[lane]..n).zip(&heights).for_each(|(n, &h)| values[at(n)] = h);
            });
            before = here;
        }
        *row = heights;
    }
}

/// Returns the least of the parabolas of sixteen voxels, and of those `beside` them by so many voxels on both sides. Voxels that are no members have any
/// value. `None` if heights beyond [`FAR`] may matter.
#[inline(always)]
fn least(own: Lanes, members: u16, squares: &[f32], beside: impl Fn(usize) -> (Lanes, Lanes)) -> Option<Lanes> {
    let squares = &squares[..=FAR];
    let mut least = own;
    for l in 0..LANES {
        least[l] = if members >> l & 1 == 1 { own[l] } else { 0.0 };
    }
    let mut first = 1;
    while first <= FAR {
        let mut halves = [0f32; LANES / 2];
        for l in 0..LANES / 2 {
            let [a, b] = [least[l], least[l + LANES / 2]];
            halves[l] = if a > b { a } else { b };
        }
        let mut most = 0f32;
        for h in halves {
            most = if h > most { h } else { most };
        }
        if squares[first] >= most {
            return Some(least);
        }
        for (n, square) in squares[first..first + STEPS].iter().enumerate() {
            let (low, high) = beside(first + n);
            for l in 0..LANES {
                let h = if low[l] < high[l] { low[l] } else { high[l] };
                let here = h + square;
                least[l] = if here < least[l] { here } else { least[l] };
            }
        }
        first += STEPS;
    }
    None
}

/// Returns sixteen heights from `at` on.
#[inline(always)]
fn lanes(heights: &[f32], at: usize) -> Lanes {
    let mut out = [0.0; LANES];
    out.copy_from_slice(&heights[at..at + LANES]);
    out
}

/// Writes the values of members.
#[inline(always)]
fn put(to: &mut [f32], values: &Lanes, members: u16) {
    let count = to.len().min(LANES);
    for l in 0..count {
        to[l] = if members >> l & 1 == 1 { values[l] } else { to[l] };
    }
}

/// Returns sixteen bits of a row from `at` on; there are none beyond its end.
#[inline(always)]
fn bits(row: &[u64], at: usize) -> u16 {
    let (word, shift) = (at / 64, at % 64);
    let low = row.get(word).map_or(0, |w| w >> shift);
    let high = if shift > 64 - LANES { row.get(word + 1).map_or(0, |w| w << (64 - shift)) } else { 0 };
    (low | high) as u16
}

/// The bits of so many voxels, sixteen at most.
#[inline(always)]
fn rest(count: usize) -> u16 {
    if count >= LANES { u16::MAX } else { (1 << count) - 1 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::fields::voxels::VoxelBits;
    use crate::math::hash::uniform;

    /// Heights of a plane in which few are known, so that some are nearest from far away.
    fn heights(seed: u64, count: usize, known: f64) -> Vec<f32> {
        let height = |n: u64| (40.0 * uniform(seed + 1, n)) as f32;
        (0..count as u64).map(|n| if uniform(seed, n) < known { height(n) } else { f32::INFINITY }).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn members_have_the_least_of_all_parabolas_in_their_line(
            width in 1usize..100, count in prop::sample::select(vec![1usize, 2, 40, 150]), known in prop::sample::select(vec![0.005, 0.05, 0.6, 1.0]),
            spacing in 0.3f32..4.0, seed in 0u64..1000, is_across: bool,
        ) {
            let dims = [width, count, 1];
            // Runs of members with voxels between them, which a parabola reaches over; an envelope, needed for far ones, does not.
            let share = if known == 1.0 { 0.9 } else { 1.0 };
            let set = VoxelBits::from_fn(dims, |n| uniform(seed + 2, n as u64 / 5) < share).numbered().unwrap();
            let lines = Lines { dims, axis: 1, at: 0 };
            let Some(window) = Window::of(&set, &lines) else { return Ok(()) };
            let first = heights(seed, window.len(), known);
            let square = spacing * spacing;
            let (mut values, mut parabolas) = (first.clone(), Parabolas::default());
            if is_across {
                parabolas.across(&set, &lines, &window, square, &mut values);
            } else {
                parabolas.along_rows(&set, &lines, &window, square, &mut values);
            }
            let (rows, columns) = (window.lines.len(), window.width());
            for n in 0..rows {
                for x in 0..columns {
                    let got = values[n * columns + x];
                    let is_member = set.contains([window.xs.start + x, window.lines.start + n, 0].map(|c| c as i64));
                    if !is_member {
                        prop_assert_eq!(got, first[n * columns + x]);
                        continue;
                    }
                    let of = |m: usize, apart: usize| first[m] + (apart as f32 * spacing).powi(2);
                    let least = match is_across {
                        true => (0..rows).map(|m| of(m * columns + x, m.abs_diff(n))).fold(f32::INFINITY, f32::min),
                        false => (0..columns).map(|m| of(n * columns + m, m.abs_diff(x))).fold(f32::INFINITY, f32::min),
                    };
                    let is_least = got == least || (got - least).abs() <= 1e-4 * (1.0 + least);
                    prop_assert!(is_least, "{got} is not {least} at {x}, {n}");
                }
            }
        }
    }
}
