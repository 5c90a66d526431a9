//! The exact Euclidean distance to the points where grid edges cross the wall, in time linear in the number of requested voxels.
//!
//! Sources are on grid edges, off the voxels' centres along one axis each. For sources on edges along x, a scan finds the nearest
//! one along each row. The least of parabolas (see [`parabolas`](super::parabolas)) extends this across y and then z, where those sources are
//! at whole indices, so it is exact (Felzenszwalb and Huttenlocher 2012). The same holds for y and z with the scan along their own axis. Extending one
//! family's distance along its own axis a second time would add the squares of two parts of one distance and fall below the truth.
//! The three families are therefore merged only when their remaining passes are the same:
//!
//! D² = min(Pz(min(Py(fx²), Px(fy²))), Py(Px(fz²))),  P_a the least of parabolas along axis a, f_a the scan.
//!
//! Everything runs within the requested voxels: the ball given by a distance contains every voxel that its computation
//! passes through, so nothing beyond the lumen and its shell is read.
//!
//! One value is kept for each requested voxel, that of the first two families. The third is computed for a few slices at a time and
//! merged at once: its scan along z reads bits, not values. Kept whole, it would be the largest part of a flight's memory at its peak.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::lines::{Lines, Window};
use super::parabolas::Parabolas;
use crate::error::Result;
use crate::fields::Values;
use crate::fields::voxels::{VoxelBits, VoxelSet, each_bit, each_run};
use crate::progress::Progress;

/// Slices for which the family of z is computed at a time, by one thread. Each reads the bits of all slices.
const SLICES: usize = 32;

/// The voxels inside, and the position of the wall between two voxels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walls<'a> {
    /// The voxels on the inner side of the wall.
    pub inside: &'a VoxelBits,
    /// The values that locate the wall between two voxels, HU, and its iso value. Without them the wall is half-way.
    pub hu: Option<(&'a Values<'a>, i16)>,
}

impl Walls<'_> {
    /// Returns the position of the wall from an inside voxel towards its outside neighbour, voxels.
    #[inline]
    fn fraction(&self, inside: usize, outside: usize) -> f32 {
        let Some((hu, iso)) = self.hu else { return 0.5 };
        let (a, b, iso) = (f32::from(hu.at(inside)), f32::from(hu.at(outside)), f32::from(iso));
        if a <= iso && b > iso { (iso - a) / (b - a) } else { 0.5 }
    }

    /// Returns the position of the wall beyond the grid's outermost voxels, voxels. Unscanned space cannot be flown
    /// through, but a mask's outermost voxels are entirely lumen.
    fn border(&self) -> f32 {
        if self.hu.is_some() { 0.0 } else { 0.5 }
    }

    /// Calls `visit(x, place)` for every crossing between line `n` and the next. Lines are given as the bits of rows; `place` is counted
    /// in lines.
    #[inline]
    fn crossings(&self, lines: &Lines, n: usize, mut visit: impl FnMut(usize, f32)) {
        let (a, b) = (lines.row(self.inside, n), lines.row(self.inside, n + 1));
        for (w, (&a, &b)) in a.iter().zip(b).enumerate() {
            each_bit(a ^ b, |bit| visit(64 * w + bit, self.place(lines, n, 64 * w + bit, a >> bit & 1 == 1)));
        }
    }

    /// Same as [`Walls::crossings`] among the voxels `open` of a row, which are closed there. Returns false once none is open.
    #[inline]
    fn nearest(&self, lines: &Lines, n: usize, open: &mut [u64], mut visit: impl FnMut(usize, f32)) -> bool {
        let (a, b) = (lines.row(self.inside, n), lines.row(self.inside, n + 1));
        let mut any = 0;
        for (w, (open, (&a, &b))) in open.iter_mut().zip(a.iter().zip(b)).enumerate() {
            let here = (a ^ b) & *open;
            each_bit(here, |bit| visit(64 * w + bit, self.place(lines, n, 64 * w + bit, a >> bit & 1 == 1)));
            *open &= !here;
            any |= *open;
        }
        any != 0
    }

    /// Returns the place of the crossing at `x` between line `n` and the next, counted in lines.
    #[inline]
    fn place(&self, lines: &Lines, n: usize, x: usize, first_inside: bool) -> f32 {
        let (here, next) = (lines.base(n) + x, lines.base(n + 1) + x);
        if first_inside { n as f32 + self.fraction(here, next) } else { (n + 1) as f32 - self.fraction(next, here) }
    }
}

/// Computes squared distances along the lines' axis to the nearest crossing on it, mm², for the lines `part` of the window. Of the lines
/// before and behind the part, only what is nearest to voxels of `asked` is read.
fn scan(
    (walls, asked): (&Walls, &VoxelSet),
    lines: &Lines,
    window: &Window,
    part: &Range<usize>,
    spacing: f32,
    out: &mut Vec<f32>,
) {
    let width = window.width();
    out.clear();
    out.resize(part.len() * width, f32::INFINITY);
    let (first, last) = (window.lines.start, window.lines.end - 1);
    let x0 = window.xs.start;
    let mut seen = vec![f32::NEG_INFINITY; width];
    let mut open = Vec::new();
    let all = |open: &mut Vec<u64>| {
        open.clear();
        open.resize(lines.row(asked.bits(), first).len(), 0);
        for n in part.clone() {
            open.iter_mut().zip(lines.row(asked.bits(), n)).for_each(|(o, row)| *o |= row);
        }
    };
    let at_border = |n: usize, place: f32, open: &[u64], seen: &mut [f32]| {
        for (w, (&row, &open)) in lines.row(walls.inside, n).iter().zip(open).enumerate() {
            each_bit(row & open, |bit| seen[64 * w + bit - x0] = place);
        }
    };
    all(&mut open);
    for n in (first..part.start).rev() {
        if n > 0 && !walls.nearest(lines, n - 1, &mut open, |x, place| seen[x - x0] = place) {
            break;
        }
    }
    if first == 0 {
        at_border(0, -walls.border(), &open, &mut seen);
    }
    for n in part.clone() {
        if n > 0 {
            walls.crossings(lines, n - 1, |x, place| {
                if window.xs.contains(&x) {
                    seen[x - x0] = place;
                }
            });
        }
        let here = n as f32;
        for (o, &s) in out[(n - part.start) * width..][..width].iter_mut().zip(&seen) {
            *o = (here - s) * spacing;
        }
    }
    seen.fill(f32::INFINITY);
    all(&mut open);
    for n in part.end..=last {
        if n + 1 < lines.count() && !walls.nearest(lines, n, &mut open, |x, place| seen[x - x0] = place) {
            break;
        }
    }
    if last + 1 == lines.count() {
        at_border(last, last as f32 + walls.border(), &open, &mut seen);
    }
    for n in part.clone().rev() {
        if n + 1 < lines.count() {
            walls.crossings(lines, n, |x, place| {
                if window.xs.contains(&x) {
                    seen[x - x0] = place;
                }
            });
        }
        let here = n as f32;
        for (o, &s) in out[(n - part.start) * width..][..width].iter_mut().zip(&seen) {
            let d = o.min((s - here) * spacing);
            *o = d * d;
        }
    }
}

/// Same as [`scan`] along x itself, for one row.
fn scan_row(
    walls: &Walls,
    (j, k): (usize, usize),
    xs: &Range<usize>,
    spacing: f32,
    places: &mut Vec<f32>,
    out: &mut [f32],
) {
    let dims = walls.inside.dims();
    let base = dims[0] * (j + dims[1] * k);
    places.clear();
    places.push(f32::NEG_INFINITY);
    each_run(walls.inside.row(j, k), |r| {
        places.push(match r.start {
            0 => -walls.border(),
            s => s as f32 - walls.fraction(base + s, base + s - 1),
        });
        let last = r.end - 1;
        places.push(match r.end {
            e if e == dims[0] => last as f32 + walls.border(),
            e => last as f32 + walls.fraction(base + last, base + e),
        });
    });
    places.push(f32::INFINITY);
    let mut x = xs.start;
    for pair in places.windows(2) {
        // Voxels from one crossing up to the next. A voxel on a crossing has distance 0 from either side.
        let end = (pair[1].ceil() as usize).clamp(x, xs.end);
        for (n, o) in out[x - xs.start..end - xs.start].iter_mut().enumerate() {
            let here = (x + n) as f32;
            let d = (here - pair[0]).min(pair[1] - here) * spacing;
            *o = d * d;
        }
        x = end;
    }
}

/// Values of the members in each row of a plane.
type PlaneRows<'v> = Vec<&'v mut [i16]>;

/// Splits the values of the slices `ks` of `set` into the rows of slices (fixed k) or of layers (fixed j), so that different threads can
/// write them.
fn planes<'v>(set: &VoxelSet, ks: Range<usize>, mut values: &'v mut [i16], axis: usize) -> Vec<PlaneRows<'v>> {
    let [_, ny, _] = set.dims();
    let (count, each) = if axis == 1 { (ks.len(), ny) } else { (ny, ks.len()) };
    let mut out: Vec<PlaneRows> = (0..count).map(|_| Vec::with_capacity(each)).collect();
    for k in ks.clone() {
        for j in 0..ny {
            let next = if j + 1 < ny { set.row_start(j + 1, k) } else { set.row_start(0, k + 1) };
            let (row, rest) = values.split_at_mut(next - set.row_start(j, k));
            out[if axis == 1 { k - ks.start } else { j }].push(row);
            values = rest;
        }
    }
    out
}

/// Splits the values of `set` by some slices at a time.
fn slabs<'v>(set: &VoxelSet, mut values: &'v mut [i16]) -> Vec<(Range<usize>, &'v mut [i16])> {
    let nz = set.dims()[2];
    let mut out = Vec::with_capacity(nz.div_ceil(SLICES));
    for begin in (0..nz).step_by(SLICES) {
        let ks = begin..(begin + SLICES).min(nz);
        let (own, rest) = values.split_at_mut(set.row_start(0, ks.end) - set.row_start(0, begin));
        out.push((ks, own));
        values = rest;
    }
    out
}

/// Spreads the members' squares over the window.
fn spread(unit: Unit, set: &VoxelSet, lines: &Lines, window: &Window, rows: &[&mut [i16]], out: &mut Vec<f32>) {
    out.clear();
    out.resize(window.len(), f32::INFINITY);
    for (n, line) in window.lines.clone().zip(out.chunks_exact_mut(window.width())) {
        let mut at = 0;
        each_run(lines.row(set.bits(), n), |r| {
            let line = &mut line[r.start - window.xs.start..r.end - window.xs.start];
            line.iter_mut().zip(&rows[n][at..]).for_each(|(square, &packed)| *square = unit.square(packed));
            at += r.len();
        });
    }
}

/// Collects the members' squares of the lines `part` from the window; `rows` are those of the lines from `first` on.
fn collect(
    unit: Unit,
    set: &VoxelSet,
    lines: &Lines,
    (window, part): (&Window, &Range<usize>),
    values: &[f32],
    (first, rows): (usize, &mut [&mut [i16]]),
) {
    for (n, line) in part.clone().zip(values.chunks_exact(window.width())) {
        let mut at = 0;
        each_run(lines.row(set.bits(), n), |r| {
            let line = &line[r.start - window.xs.start..r.end - window.xs.start];
            rows[n - first][at..].iter_mut().zip(line).for_each(|(packed, &square)| *packed = unit.packed(square));
            at += r.len();
        });
    }
}

/// Scratch memory for one slice: squares by family of sources.
#[derive(Debug, Default)]
struct Slice {
    unit: Unit,
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    plane: Vec<f32>,
    places: Vec<f32>,
    parabolas: Parabolas,
}

impl Slice {
    /// Fills `within` with min(Py(fx²), Px(fy²)).
    fn fill(
        &mut self,
        walls: &Walls,
        asked: &VoxelSet,
        (lines, window): (&Lines, &Window),
        spacing: [f32; 3],
        within: &mut [&mut [i16]],
    ) {
        self.scan(walls, asked, (lines, window), spacing);
        let Self { x, y, parabolas, .. } = self;
        parabolas.along_rows(asked, lines, window, spacing[0] * spacing[0], y);
        parabolas.across(asked, lines, window, spacing[1] * spacing[1], x);
        x.iter_mut().zip(&*y).for_each(|(x, &y)| *x = x.min(y));
        collect(self.unit, asked, lines, (window, &window.lines), &self.x, (0, within));
    }

    /// Replaces the scan along z in `across` by Py(Px(fz²)), or the plane through the crossings near a voxel where that is nearer.
    fn fill_across(
        &mut self,
        walls: &Walls,
        asked: &VoxelSet,
        (lines, window): (&Lines, &Window),
        spacing: [f32; 3],
        across: &mut [&mut [i16]],
    ) {
        let squares = spacing.map(|s| s * s);
        spread(self.unit, asked, lines, window, across, &mut self.z);
        self.plane.clear();
        if walls.hu.is_some() {
            self.scan(walls, asked, (lines, window), spacing);
            let Self { x, y, z, plane, .. } = self;
            let near = x.iter().zip(&*y).zip(&*z).map(|((&x, &y), &z)| tangent([x, y, z], squares));
            plane.extend(near);
        }
        let Self { z, plane, parabolas, .. } = self;
        parabolas.along_rows(asked, lines, window, squares[0], z);
        parabolas.across(asked, lines, window, squares[1], z);
        z.iter_mut().zip(&*plane).for_each(|(z, &p)| *z = z.min(p));
        collect(self.unit, asked, lines, (window, &window.lines), &self.z, (0, across));
    }

    /// Fills `x` and `y` with the scans along x and y.
    fn scan(&mut self, walls: &Walls, asked: &VoxelSet, (lines, window): (&Lines, &Window), spacing: [f32; 3]) {
        let Self { x, y, places, .. } = self;
        scan((walls, asked), lines, window, &window.lines, spacing[1], y);
        x.clear();
        x.resize(window.len(), f32::INFINITY);
        for (n, row) in window.lines.clone().zip(x.chunks_exact_mut(window.width())) {
            scan_row(walls, lines.place(n), &window.xs, spacing[0], places, row);
        }
    }
}

/// Returns the squared distance to the plane through the crossings within one voxel along two or three axes, mm²; infinite if there
/// are fewer. Crossings are samples of the surface: right beside it, the plane through them is nearer than any of them.
fn tangent(f: [f32; 3], squares: [f32; 3]) -> f32 {
    let (mut sum, mut count) = (0.0, 0);
    for a in 0..3 {
        if f[a] <= squares[a] {
            sum += 1.0 / f[a];
            count += 1;
        }
    }
    if count > 1 { 1.0 / sum } else { f32::INFINITY }
}

/// What distances are counted in while they are found, mm. Between the passes and in the end they take 16 bits a voxel: half a field's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Unit(f32);

/// The largest unit that is tried first, mm, and the share of a voxel that it is at most.
const FINE: f32 = 1.0 / 1024.0;
const OF_VOXEL: f64 = 1.0 / 256.0;
/// What is not known yet, or farther than can be counted.
const FAR: u16 = u16::MAX;

impl Unit {
    /// Packs a squared distance, mm²; it is never rounded up.
    #[inline]
    fn packed(self, square: f32) -> i16 {
        // `as` saturates.
        (square.sqrt() / self.0) as u16 as i16
    }

    /// Returns the squared distance that was packed, mm².
    #[inline]
    fn square(self, packed: i16) -> f32 {
        let packed = packed as u16;
        let d = f32::from(packed) * self.0;
        if packed == FAR { f32::INFINITY } else { d * d }
    }
}

/// Returns the distances of the voxels of `asked` to the nearest crossing, in their order: negative for those outside, and `most` (mm) if there
/// is no crossing. They are multiplied by `scale`, and counted in the unit that is returned with them, mm: 1/512 mm or less, but four times as
/// much, or more, where the lumen is too wide for that. Spacing is in mm.
pub(super) fn distances(
    walls: &Walls,
    asked: &VoxelSet,
    spacing: [f64; 3],
    (scale, most): (f64, f64),
    progress: &Progress,
) -> Result<(Vec<i16>, f32)> {
    let (scale, most) = (scale as f32, most as f32);
    let least = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let mut unit = ((least * OF_VOXEL).log2().floor().exp2() as f32).min(FINE);
    loop {
        let reach = f32::from(FAR) * unit;
        let wanted = (scale, most.min(reach));
        if let Some(found) = in_unit(Unit(unit), walls, asked, spacing, wanted, most > reach, progress)? {
            return Ok((found, 2.0 * unit));
        }
        unit *= 4.0;
    }
}

/// Does what [`distances`] does, counted in twice a unit. `None` if `may_fail` and one is farther than all that can be counted.
fn in_unit(
    unit: Unit,
    walls: &Walls,
    asked: &VoxelSet,
    spacing: [f64; 3],
    (scale, most): (f32, f32),
    may_fail: bool,
    progress: &Progress,
) -> Result<Option<Vec<i16>>> {
    let dims = asked.dims();
    let spacing = spacing.map(|s| s as f32);
    let all = 0..dims[2];
    progress.stage("measuring the distance to the wall", (dims[1] + 2 * dims[2]) as u64);
    let mut values = vec![FAR as i16; asked.len()];
    // Within each slice, then along z: each layer of rows with the same j.
    let slices = planes(asked, all.clone(), &mut values, 1).into_par_iter().enumerate();
    let room = || Slice { unit, ..Slice::default() };
    slices.try_for_each_init(room, |room, (k, mut rows)| {
        let lines = Lines { dims, axis: 1, at: k };
        if let Some(window) = Window::of(asked, &lines) {
            room.fill(walls, asked, (&lines, &window), spacing, &mut rows);
        }
        progress.advance(1)
    })?;
    let layers = planes(asked, all, &mut values, 2).into_par_iter().enumerate();
    let windows: Result<Vec<Option<Window>>> = layers
        .map_init(<(Vec<f32>, Parabolas)>::default, |(room, parabolas), (j, mut rows)| {
            let lines = Lines { dims, axis: 2, at: j };
            let window = Window::of(asked, &lines);
            if let Some(window) = &window {
                spread(unit, asked, &lines, window, &rows, room);
                parabolas.across(asked, &lines, window, spacing[2] * spacing[2], room);
                collect(unit, asked, &lines, (window, &window.lines), room, (0, &mut rows));
            }
            progress.advance(1)?;
            Ok(window)
        })
        .collect();
    let windows = windows?;
    let is_cut = AtomicBool::new(false);
    let slabs = slabs(asked, &mut values).into_par_iter();
    let room = || (Slice { unit, ..Slice::default() }, Vec::new(), Vec::new());
    slabs.try_for_each_init(room, |(room, plane, across), (ks, values)| {
        across.clear();
        across.resize(values.len(), FAR as i16);
        let mut layers = planes(asked, ks.clone(), across, 2);
        for (j, (window, rows)) in windows.iter().zip(&mut layers).enumerate() {
            let Some(window) = window else { continue };
            let part = window.lines.start.max(ks.start)..window.lines.end.min(ks.end);
            if !part.is_empty() {
                let lines = Lines { dims, axis: 2, at: j };
                scan((walls, asked), &lines, window, &part, spacing[2], plane);
                collect(unit, asked, &lines, (window, &part), plane, (ks.start, rows));
            }
        }
        drop(layers);
        for (k, mut rows) in ks.clone().zip(planes(asked, ks.clone(), across, 1)) {
            let lines = Lines { dims, axis: 1, at: k };
            if let Some(window) = Window::of(asked, &lines) {
                room.fill_across(walls, asked, (&lines, &window), spacing, &mut rows);
            }
            progress.advance(1)?;
        }
        let mut both = values.iter_mut().zip(&*across);
        for (j, k) in ks.flat_map(|k| (0..dims[1]).map(move |j| (j, k))) {
            for (&members, &inside) in asked.row(j, k).iter().zip(walls.inside.row(j, k)) {
                each_bit(members, |b| {
                    let Some((value, &other)) = both.next() else { return };
                    let nearest = (*value as u16).min(other as u16);
                    let is_inside = inside >> b & 1 == 1;
                    if is_inside && nearest == FAR {
                        is_cut.store(true, Ordering::Relaxed);
                    }
                    let d = (f32::from(nearest) * unit.0).min(most) * scale;
                    let counted = (d * (0.5 / unit.0)) as i16;
                    *value = if is_inside { counted } else { -counted.max(1) };
                });
            }
        }
        Ok(())
    })?;
    Ok((!(may_fail && is_cut.into_inner())).then_some(values))
}
