//! Inks of the wall, one for each cell that it crosses, found when they are first looked at.
//!
//! A cell lies between eight neighbouring voxels. What a wall's colour depends on changes over voxels, not over pixels, and a picture looks
//! at each cell many times, the next one again. So it is kept, in bricks of 8×8×8 cells. Each brick has a row of the next ones'
//! cells, too: whatever lies between eight cells is in one brick.

use std::array::from_fn;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

use fearless_simd::{Level, Simd, f32x16, i16x16, i32x16, prelude::*, u16x32};
use rayon::prelude::*;

use crate::render::packets::picture::on_level;
use crate::space::PreparedVolume;
use crate::volume::Volume;

/// An ink: four numbers from 0 to 255, of which the last is above 0 where there is one.
pub(super) type Ink = [u8; 4];

/// The ink at a place: the sum of those of the cells around it, each with a weight; the weights add up to at most 256.
pub(super) type Sum = [u16; 4];

/// Finds inks.
pub(crate) trait CellInks: Sync {
    /// Returns the inks of the wall in some cells, at most [`AT_ONCE`]. A cell is given by its voxel with the lowest indices. An ink whose last
    /// number is 0 counts as none.
    fn inks(&self, cells: &[[usize; 3]], inks: &mut [Ink]);

    /// Returns the only cells that may have an ink, in any order; `None` if any may.
    fn only(&self) -> Option<Vec<[usize; 3]>> {
        None
    }
}

/// The most cells for which inks are asked at once.
pub(crate) const AT_ONCE: usize = 16;

/// Cells along the side of a brick, and those that it holds.
const SIDE: usize = 1 << SHIFT;
const SHIFT: usize = 3;
const HELD: usize = SIDE + 1;
/// Voxels along the side of what a brick's cells lie between.
const CORNERS: usize = HELD + 1;

/// Bricks in a part of their memory.
const MANY: usize = 1 << CHUNK;
const CHUNK: usize = 7;
/// From the first of eight cells around a place to the last.
const AROUND: usize = 2 + HELD + HELD * HELD;

type Brick = [i32; HELD * HELD * HELD];

/// For each row of a brick's cells along x, a bit for each that the wall crosses.
type Crossed = [u16; HELD * HELD];

/// Nothing is known of a brick.
const UNKNOWN: u32 = u32::MAX;
/// Somebody waits for a brick.
const ASKED: u32 = u32::MAX - 1;
/// The wall does not cross a brick.
const EMPTY: u32 = u32::MAX - 2;

/// The inks of a volume's wall.
#[derive(Debug, Default)]
pub(super) struct CellField {
    /// Bricks along each axis.
    count: [usize; 3],
    /// For each brick where it is in `bricks`, or one of the above.
    table: Vec<AtomicU32>,
    /// Bricks, as many in each part: none is moved when there are more.
    bricks: Vec<Vec<Brick>>,
    len: usize,
    asked: Mutex<Vec<u32>>,
}

impl CellField {
    /// Creates the field of a volume, without any inks. Nobody asks for bricks without cells that may have one.
    pub(super) fn new(volume: &Volume, inks: &dyn CellInks) -> Self {
        let count = volume.grid().dims().map(|n| n / SIDE + 1);
        let only = inks.only();
        let first = if only.is_some() { EMPTY } else { UNKNOWN };
        let mut table: Vec<_> = (0..count.iter().product()).map(|_| AtomicU32::new(first)).collect();
        for cell in only.unwrap_or_default() {
            // A brick begins one cell before its first whole one: along an axis, one or two of them have a cell.
            for n in 0..8 {
                let [x, y, z] = from_fn(|a| (cell[a] + (n >> a & 1)) / SIDE);
                if let Some(at) = table.get_mut(x + count[0] * (y + count[1] * z)) {
                    *at.get_mut() = UNKNOWN;
                }
            }
        }
        Self { count, table, ..Self::default() }
    }

    /// Returns the inks at places of the wall, from the cells around them, weighted by their nearness, and whether all of the first
    /// `wanted` are known. If not, none is found, and those are [asked](Self::answer) for. Places are given in voxel coordinates, counted from voxel −1.
    /// There is no ink beyond the volume, nor at places that are not finite.
    #[inline(always)]
    pub(super) fn at<S: Simd>(&self, simd: S, q: [f32x16<S>; 3], wanted: usize) -> ([Sum; 16], bool) {
        let (one, zero) = (f32x16::splat(simd, 1.0), i32x16::splat(simd, 0));
        // The middle of cell 0 is at 1.5, and a brick's first cell is the one before its first whole one.
        let (mut number, mut first, mut has) = (zero, zero, zero.simd_eq(0));
        let mut near = [[one; 2]; 3];
        for a in (0..3).rev() {
            let place = q[a] - 0.5;
            let floor = place.floor();
            near[a] = [one - (place - floor), place - floor];
            let base: i32x16<S> = floor.to_int();
            let brick = base >> SHIFT as u32;
            has &= place.simd_ge(0.0) & place.simd_lt((self.count[a] << SHIFT) as f32);
            number = number * self.count[a] as i32 + brick;
            first = first * HELD as i32 + (base & (SIDE as i32 - 1));
        }
        let (number, first) = (has.select(number, zero - 1).to_array(), has.select(first, zero).to_array());
        // Two cells that are neighbours along x are one load.
        let mut taps = [[[0; 2]; 16]; 4];
        let (mut all, mut any) = (true, false);
        // Rays that are close are in one brick.
        let (mut last, mut brick) = (-1, None);
        for lane in 0..wanted.min(16) {
            if number[lane] != last {
                last = number[lane];
                let at = self.table.get(last as usize).map_or(EMPTY, |at| at.load(Ordering::Relaxed));
                brick = self.bricks.get(at as usize >> CHUNK).map(|chunk| &chunk[at as usize & (MANY - 1)]);
                if brick.is_none() && at != EMPTY {
                    all = self.ask(last as usize);
                }
            }
            if let Some(cells) = brick.and_then(|b| b.get(first[lane] as usize..)?.first_chunk::<AROUND>()) {
                any = true;
                for (n, taps) in taps.iter_mut().enumerate() {
                    let at = HELD * (n & 1) + HELD * HELD * (n >> 1);
                    taps[lane] = [cells[at], cells[at + 1]];
                }
            }
        }
        let mut sums = [[0; 4]; 16];
        // Where some wait, all are looked for again.
        if !(any && all) {
            return (sums, all);
        }
        // Two numbers of an ink in each sum, 16 bits for each. The weights add up to at most 256.
        let [mut low, mut high] = [u16x32::splat(simd, 0); 2];
        for (n, taps) in taps.iter().enumerate() {
            let taps = taps.as_flattened();
            let (left, right) =
                i32x16::from_slice(simd, &taps[..16]).deinterleave(i32x16::from_slice(simd, &taps[16..]));
            for (x, tap) in [left, right].into_iter().enumerate() {
                let weight = near[0][x] * near[1][n & 1] * (near[2][n >> 1] * 256.0);
                let weight: i32x16<S> = weight.to_int();
                let weight: u16x32<S> = (weight | weight << 16).bitcast();
                let (even, odd): (u16x32<S>, u16x32<S>) =
                    ((tap & 0x00ff_00ff).bitcast(), (tap >> 8 & 0x00ff_00ff).bitcast());
                low += even * weight;
                high += odd * weight;
            }
        }
        let (first, second) = low.interleave(high);
        let numbers = sums.as_flattened_mut();
        first.store_slice(&mut numbers[..32]);
        second.store_slice(&mut numbers[32..]);
        (sums, all)
    }

    /// Asks for a brick. Returns false.
    #[cold]
    #[inline(never)]
    fn ask(&self, number: usize) -> bool {
        let was = self.table[number].compare_exchange(UNKNOWN, ASKED, Ordering::Relaxed, Ordering::Relaxed);
        if was.is_ok() {
            self.asked.lock().unwrap_or_else(PoisonError::into_inner).push(number as u32);
        }
        false
    }

    /// Finds the inks that were asked for in the wall of `volume`. Returns false if none were.
    pub(super) fn answer(&mut self, volume: &PreparedVolume, inks: &dyn CellInks, level: Level) -> bool {
        let mut asked = std::mem::take(self.asked.get_mut().unwrap_or_else(PoisonError::into_inner));
        if asked.is_empty() {
            return false;
        }
        let [across, down, _] = self.count;
        let first = |number: u32| {
            let n = number as usize;
            [n % across, n / across % down, n / (across * down)].map(|b| (b * SIDE).wrapping_sub(1))
        };
        let mut found = Vec::with_capacity(asked.len());
        let look = |&number: &u32| {
            let mut crossed = [0; HELD * HELD];
            on_level!(level, simd => crossed = crossings(simd, volume, first(number)));
            (number, crossed)
        };
        asked.par_iter().map(look).collect_into_vec(&mut found);
        let begin = self.len;
        found.retain(|(number, crossed)| {
            let is_crossed = crossed.iter().any(|&row| row != 0);
            *self.table[*number as usize].get_mut() = if is_crossed { self.len as u32 } else { EMPTY };
            self.len += usize::from(is_crossed);
            is_crossed
        });
        let parts = self.len.div_ceil(MANY);
        self.bricks.resize_with(parts, || vec![[0; HELD * HELD * HELD]; MANY]);
        // Each is written where it stays.
        let new = self.bricks[begin / MANY..].iter_mut().flatten().skip(begin % MANY);
        let mut new: Vec<_> = new.zip(&found).collect();
        new.par_iter_mut().for_each(|(brick, (number, crossed))| fill(brick, crossed, first(*number), inks));
        // Its memory is used again.
        asked.clear();
        self.asked = Mutex::new(asked);
        true
    }

    /// Returns the memory in use, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.table.len() * size_of::<AtomicU32>() + self.bricks.len() * MANY * size_of::<Brick>()
    }
}

/// Returns which cells of the brick from the cell `first` on the wall crosses: those with a voxel in it and another in the gas. Beyond
/// the volume there are none.
#[inline(never)]
fn crossings<S: Simd>(simd: S, volume: &PreparedVolume, first: [usize; 3]) -> Crossed {
    let voxels = volume.voxels();
    let (grid, data) = (voxels.grid(), voxels.data());
    let dims = grid.dims();
    // Values are whole numbers.
    let iso = volume.transfer().iso().ceil().clamp(-32768.0, 32767.0) as i16;
    let mut crossed = [0; HELD * HELD];
    // The first column may be before the volume.
    let before = usize::from(first[0] == usize::MAX);
    let from = first[0].wrapping_add(before);
    let columns = dims[0].saturating_sub(from).min(CORNERS - before);
    let valid = ((1u16 << columns) - 1) << before;
    // The cells between two voxels of the volume.
    let valid = valid & (valid >> 1);
    simd.vectorize(
        #[inline(always)]
        || {
            // For each row of voxels that the cells lie between, a bit for each that is in the wall; `None` beyond the volume.
            let mut rows = [None; CORNERS * CORNERS];
            for (n, row) in rows.iter_mut().enumerate() {
                let [j, k] = [first[1].wrapping_add(n % CORNERS), first[2].wrapping_add(n / CORNERS)];
                if j >= dims[1] || k >= dims[2] || columns == 0 {
                    continue;
                }
                let at = &data[grid.index(from, j, k)..];
                let inside = match at.first_chunk::<16>() {
                    Some(values) => i16x16::load_array_ref(simd, values).simd_ge(iso).to_bitmask() as u16,
                    None => (0..columns).fold(0, |bits, x| bits | u16::from(at[x] >= iso) << x),
                };
                *row = Some(inside << before);
            }
            for (n, crossed) in crossed.iter_mut().enumerate() {
                let at = n % HELD + CORNERS * (n / HELD);
                let four = [rows[at], rows[at + 1], rows[at + CORNERS], rows[at + CORNERS + 1]];
                if let [Some(a), Some(b), Some(c), Some(d)] = four {
                    let (any, all) = (a | b | c | d, a & b & c & d);
                    *crossed = (any | any >> 1) & !(all & (all >> 1)) & valid;
                }
            }
        },
    );
    crossed
}

/// Finds the inks of the crossed cells of the brick from the cell `first` on.
fn fill(brick: &mut Brick, crossed: &Crossed, first: [usize; 3], inks: &dyn CellInks) {
    let (mut cells, mut places, mut len) = ([[0; 3]; AT_ONCE], [0; AT_ONCE], 0);
    let mut flush = |cells: &[[usize; 3]], places: &[usize]| {
        let mut found = [[0; 4]; AT_ONCE];
        inks.inks(cells, &mut found[..cells.len()]);
        for (ink, place) in found.iter().zip(places) {
            brick[*place] = if ink[3] == 0 { 0 } else { i32::from_le_bytes(*ink) };
        }
    };
    for (n, &row) in crossed.iter().enumerate() {
        let mut row = row;
        while row != 0 {
            let x = row.trailing_zeros() as usize;
            row &= row - 1;
            cells[len] = [x, n % HELD, n / HELD];
            for (cell, first) in cells[len].iter_mut().zip(first) {
                *cell = first.wrapping_add(*cell);
            }
            places[len] = x + HELD * n;
            len += 1;
            if len == AT_ONCE {
                flush(&cells, &places);
                len = 0;
            }
        }
    }
    if len > 0 {
        flush(&cells[..len], &places[..len]);
    }
}
