//! Inks of the wall, one for each cell that it crosses, found when they are first looked at.
//!
//! A cell lies between eight neighbouring voxels. What a wall's colour depends on changes over voxels, not over pixels, and a picture looks
//! at each cell many times, the next one again. So it is kept, in bricks of 8×8×8 cells. Each brick has a row of the next ones'
//! cells, too: whatever lies between eight cells is in one brick.

use std::array::from_fn;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

use fearless_simd::{Simd, f32x16, i32x16, prelude::*, u16x32};
use rayon::prelude::*;

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
    /// Creates the field of a volume, without any inks.
    pub(super) fn new(volume: &Volume) -> Self {
        let count = volume.grid().dims().map(|n| n / SIDE + 1);
        let table = (0..count.iter().product()).map(|_| AtomicU32::new(UNKNOWN)).collect();
        Self { count, table, bricks: Vec::new(), len: 0, asked: Mutex::default() }
    }

    /// Returns the inks at places of the wall, from the cells around them, weighted by their nearness, and whether all of the first
    /// `wanted` are known. The others are [asked](Self::answer) for. Places are given in voxel coordinates, counted from voxel −1.
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
        let mut taps = [[0; 16]; 8];
        let mut all = true;
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
                for (n, tap) in taps.iter_mut().enumerate() {
                    tap[lane] = cells[(n & 1) + HELD * (n >> 1 & 1) + HELD * HELD * (n >> 2)];
                }
            }
        }
        // Two numbers of an ink in each sum, 16 bits for each. The weights add up to at most 256.
        let [mut low, mut high] = [u16x32::splat(simd, 0); 2];
        for (n, tap) in taps.iter().enumerate() {
            let weight = near[0][n & 1] * near[1][n >> 1 & 1] * (near[2][n >> 2] * 256.0);
            let weight: i32x16<S> = weight.to_int();
            let weight: u16x32<S> = (weight | weight << 16).bitcast();
            let tap = i32x16::load_array_ref(simd, tap);
            let (even, odd): (u16x32<S>, u16x32<S>) =
                ((tap & 0x00ff_00ff).bitcast(), (tap >> 8 & 0x00ff_00ff).bitcast());
            low += even * weight;
            high += odd * weight;
        }
        let (low, high) = (low.to_array(), high.to_array());
        let sum = |lane: usize| [low[2 * lane], high[2 * lane], low[2 * lane + 1], high[2 * lane + 1]];
        (from_fn(sum), all)
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
    pub(super) fn answer(&mut self, volume: &PreparedVolume, inks: &dyn CellInks) -> bool {
        let mut asked = std::mem::take(self.asked.get_mut().unwrap_or_else(PoisonError::into_inner));
        if asked.is_empty() {
            return false;
        }
        let [across, down, _] = self.count;
        let found: Vec<_> = asked
            .par_iter()
            .map(|&number| {
                let n = number as usize;
                brick(volume, inks, [n % across, n / across % down, n / (across * down)])
            })
            .collect();
        for (number, brick) in asked.drain(..).zip(found) {
            let at = self.table[number as usize].get_mut();
            *at = EMPTY;
            if let Some(brick) = brick {
                *at = self.len as u32;
                if self.len >> CHUNK == self.bricks.len() {
                    self.bricks.push(vec![[0; HELD * HELD * HELD]; MANY]);
                }
                self.bricks[self.len >> CHUNK][self.len & (MANY - 1)] = *brick;
                self.len += 1;
            }
        }
        // Its memory is used again.
        self.asked = Mutex::new(asked);
        true
    }

    /// Returns the memory in use, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.table.len() * size_of::<AtomicU32>() + self.bricks.len() * MANY * size_of::<Brick>()
    }
}

/// Returns a brick; `None` if the wall crosses none of its cells.
fn brick(volume: &PreparedVolume, inks: &dyn CellInks, at: [usize; 3]) -> Option<Box<Brick>> {
    let (voxels, iso) = (volume.voxels(), volume.transfer().iso());
    let grid = voxels.grid();
    let dims = grid.dims();
    // For each voxel that the cells lie between, whether it is in the wall; 2 beyond the volume.
    let mut side = [2u8; CORNERS * CORNERS * CORNERS];
    let first = at.map(|b| (b * SIDE).wrapping_sub(1));
    for z in 0..CORNERS {
        for y in 0..CORNERS {
            let [j, k] = [first[1].wrapping_add(y), first[2].wrapping_add(z)];
            if j >= dims[1] || k >= dims[2] {
                continue;
            }
            let row = &voxels.data()[grid.index(0, j, k)..][..dims[0]];
            for (x, side) in side[CORNERS * (y + CORNERS * z)..][..CORNERS].iter_mut().enumerate() {
                if let Some(&value) = row.get(first[0].wrapping_add(x)) {
                    *side = u8::from(f64::from(value) >= iso);
                }
            }
        }
    }
    let mut brick: Option<Box<Brick>> = None;
    let (mut cells, mut places, mut len) = ([[0; 3]; AT_ONCE], [0; AT_ONCE], 0);
    let mut flush = |cells: &[[usize; 3]], places: &[usize]| {
        let mut found = [[0; 4]; AT_ONCE];
        inks.inks(cells, &mut found[..cells.len()]);
        let brick = brick.get_or_insert_with(|| Box::new([0; HELD * HELD * HELD]));
        for (ink, place) in found.iter().zip(places) {
            brick[*place] = if ink[3] == 0 { 0 } else { i32::from_le_bytes(*ink) };
        }
    };
    for place in 0..HELD * HELD * HELD {
        let [x, y, z] = [place % HELD, place / HELD % HELD, place / (HELD * HELD)];
        let corner = |n: usize| side[x + (n & 1) + CORNERS * (y + (n >> 1 & 1) + CORNERS * (z + (n >> 2)))];
        let (mut all, mut any) = (corner(0), corner(0));
        for n in 1..8 {
            (all, any) = (all & corner(n), any | corner(n));
        }
        if any == 1 && all == 0 {
            (cells[len], places[len]) =
                ([first[0].wrapping_add(x), first[1].wrapping_add(y), first[2].wrapping_add(z)], place);
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
    brick
}
