//! Colours over the wall that was not seen yet, in pictures and in slices.

use std::ops::Range;
use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

use super::live::LiveCoverage;
use super::sight::REACH_MM;
use super::wall::{CELL_MM, Wall};
use crate::render::camera::CameraRay;
use crate::render::slice::Slice;
use crate::render::{Frame, View};
use crate::space::{PreparedVolume, first_crossing};

/// Pixels between two rays that ask for the paint of the wall; it changes evenly in between.
const STEP: usize = 6;
/// The colour of what was not seen.
pub const INK: [f32; 3] = [255.0, 80.0, 215.0];
/// Maximum opacity of the colour over the wall.
pub const OVER: f32 = 0.62;
/// Cells along the side of a block.
const SIDE: i32 = 4;

/// Paints the wall that was not seen yet.
#[derive(Component, Clone, Debug)]
pub struct CoveragePaint {
    /// The block with each group of cells, or `NONE`, x fastest.
    blocks: Vec<u32>,
    /// The first group of cells, and their numbers.
    first: IVec3,
    count: IVec3,
    /// For each block, the first patch of each of its cells, counted from its own first, or `ABSENT`.
    cells: Vec<[u16; (SIDE * SIDE * SIDE) as usize]>,
    /// Paint at the rays of the last picture.
    at: Vec<f32>,
    /// The wall.
    wall: Arc<Wall>,
}

const NONE: u32 = u32::MAX;
const ABSENT: u16 = u16::MAX;

impl CoveragePaint {
    /// Prepares to find the patches of a wall.
    pub fn new(coverage: &LiveCoverage) -> Self {
        let wall = coverage.wall();
        let cell = |p: usize| (coverage.middle(p)[0] / CELL_MM).floor().as_ivec3();
        let group = |b: usize| cell(wall.blocks[b].first as usize).div_euclid(IVec3::splat(SIDE));
        let blocks = wall.block_count();
        let (mut low, mut high) = (IVec3::MAX, IVec3::MIN);
        (0..blocks).map(group).for_each(|g| (low, high) = (low.min(g), high.max(g)));
        let count = if blocks == 0 { IVec3::ZERO } else { high - low + 1 };
        let mut paint = Self {
            blocks: vec![NONE; count.as_usizevec3().element_product()],
            first: low,
            count,
            cells: vec![[ABSENT; (SIDE * SIDE * SIDE) as usize]; blocks],
            at: Vec::new(),
            wall: Arc::clone(coverage.shared_wall()),
        };
        for b in 0..blocks {
            if let Some(at) = paint.number(group(b)) {
                paint.blocks[at] = b as u32;
            }
            let patches = wall.patches_of(b);
            for p in patches.clone().rev() {
                paint.cells[b][within(cell(p))] = (p - patches.start).min(usize::from(ABSENT) - 1) as u16;
            }
        }
        paint
    }

    /// True if it belongs to the wall of this coverage.
    pub fn is_of(&self, coverage: &LiveCoverage) -> bool {
        Arc::ptr_eq(&self.wall, coverage.shared_wall())
    }

    fn number(&self, group: IVec3) -> Option<usize> {
        let at = group.checked_sub(self.first)?;
        let inside = at.cmpge(IVec3::ZERO).all() && at.cmplt(self.count).all();
        inside.then(|| (at.x + self.count.x * (at.y + self.count.y * at.z)) as usize)
    }

    /// Returns the block of a cell, and its patches.
    fn patches(&self, coverage: &LiveCoverage, cell: IVec3) -> (usize, Range<usize>) {
        let found = self.number(cell.div_euclid(IVec3::splat(SIDE))).map(|n| self.blocks[n]).filter(|b| *b != NONE);
        let Some(block) = found.map(|b| b as usize) else { return (0, 0..0) };
        let first = self.cells[block][within(cell)];
        if first == ABSENT {
            return (0, 0..0);
        }
        let all = coverage.wall().patches_of(block);
        let first = all.start + usize::from(first);
        let here = |p: &usize| (coverage.middle(*p)[0] / CELL_MM).floor().as_ivec3() == cell;
        (block, first..(first..all.end).find(|p| !here(p)).unwrap_or(all.end))
    }

    /// Returns how much of the wall at a place (world, mm) is painted at a time of the flight, s, 0 to 1. `inwards` is the unit normal into
    /// the tissue.
    pub fn share_at(&self, coverage: &LiveCoverage, place: DVec3, inwards: Vec3, seconds: f64) -> f32 {
        self.amount(coverage, (place - coverage.wall().origin).as_vec3(), inwards, seconds as f32)
    }

    /// Returns how much of the wall at a place (mm from the wall's origin) that faces against `forward` is painted, 0 to 1: the
    /// mean of the surrounding patches, weighted by their nearness.
    fn amount(&self, coverage: &LiveCoverage, place: Vec3, forward: Vec3, seconds: f32) -> f32 {
        let at = place / CELL_MM - 0.5;
        let (base, part) = (at.floor().as_ivec3(), at - at.floor());
        let (mut sum, mut weights) = (0.0, 0.0);
        for corner in 0..8 {
            let bit = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let share = Vec3::select(bit.cmpeq(IVec3::ONE), part, 1.0 - part).element_product();
            let (block, patches) = self.patches(coverage, base + bit);
            for p in patches {
                // The other side of a thin fold is another wall.
                if coverage.middle(p)[1].dot(forward) < 0.1 {
                    sum += share * coverage.paint(block, p, seconds);
                    weights += share;
                }
            }
        }
        if weights > 1e-6 { sum / weights } else { 0.0 }
    }

    /// Blends the colour over a picture, whose pixels are those of `view`, at a time of the flight, s.
    pub fn paint(
        &mut self,
        coverage: &LiveCoverage,
        volume: &PreparedVolume,
        view: &View,
        seconds: f64,
        frame: &mut Frame,
    ) {
        let volume = coverage.scan(volume);
        let (width, height) = (frame.width(), frame.height());
        if width == 0 || height == 0 || (width, height) != (view.width(), view.height()) {
            return;
        }
        let (columns, rows) = (width.div_ceil(STEP) + 1, height.div_ceil(STEP) + 1);
        let mut at = std::mem::take(&mut self.at);
        at.resize(columns * rows, 0.0);
        at.par_chunks_mut(columns).enumerate().for_each(|(row, line)| {
            for (column, amount) in line.iter_mut().enumerate() {
                let ray = view.ray_at((column * STEP) as f64, (row * STEP) as f64);
                *amount = ray.map_or(0.0, |CameraRay { origin, direction }| {
                    let Some(mm) = first_crossing(volume, origin, direction, REACH_MM) else { return 0.0 };
                    let place = (origin + direction * mm - coverage.wall().origin).as_vec3();
                    self.amount(coverage, place, direction.as_vec3(), seconds as f32)
                });
            }
        });
        frame.buffers().0.par_chunks_mut(width).enumerate().for_each(|(y, pixels)| {
            let (row, v) = (y / STEP, (y % STEP) as f32 / STEP as f32);
            let [above, below] = [row, row + 1].map(|r| &at[r * columns..][..columns]);
            let mix = |c: usize| above[c] + (below[c] - above[c]) * v;
            for (c, group) in pixels.chunks_mut(STEP).enumerate() {
                let (left, right) = (mix(c), mix(c + 1));
                if left <= 0.0 && right <= 0.0 {
                    continue;
                }
                for (x, pixel) in group.iter_mut().enumerate() {
                    let share = OVER * (left + (right - left) * x as f32 / STEP as f32);
                    let light = pixel.iter().copied().max().map_or(0.0, f32::from) / 255.0;
                    for (value, ink) in pixel.iter_mut().zip(INK) {
                        *value = (f32::from(*value) * (1.0 - share) + ink * light * share + 0.5) as u8;
                    }
                }
            }
        });
        self.at = at;
    }
}

/// Draws the lines in which a slice cuts the wall that was not seen yet.
pub fn paint_slice(coverage: &LiveCoverage, slice: &Slice, frame: &mut Frame) {
    let wall = coverage.wall();
    let size = frame.size();
    let normal = slice.frame.normal();
    let off = |v: u32| (wall.origin + wall.places[v as usize].as_dvec3() - slice.centre).dot(normal);
    let (n, centre) = (normal.as_vec3(), (slice.centre - wall.origin).as_vec3());
    for b in 0..wall.block_count() {
        let block = wall.blocks[b];
        let half = 0.5 * (block.high - block.low) + 1.5;
        if (block.low.midpoint(block.high) - centre).dot(n).abs() > n.abs().dot(half) || coverage.is_all_seen(b) {
            continue;
        }
        for p in wall.patches_of(b).filter(|&p| coverage.is_missing(p)) {
            for t in wall.triangles_of(p) {
                let corners = wall.triangles[t];
                let side = corners.map(off);
                let cut = |a: usize, b: usize| {
                    let crosses = (side[a] < 0.0) != (side[b] < 0.0);
                    let world = |c: usize| wall.origin + wall.places[corners[c] as usize].as_dvec3();
                    crosses.then(|| world(a).lerp(world(b), side[a] / (side[a] - side[b])))
                };
                let mut ends = [cut(0, 1), cut(1, 2), cut(2, 0)].into_iter().flatten();
                if let (Some(a), Some(b)) = (ends.next(), ends.next()) {
                    let [a, b] = [a, b].map(|p| slice.pixel(p).0);
                    line(a, b, size.width, size.height, frame.buffers().0);
                }
            }
        }
    }
}

/// Draws a line two pixels wide, from and to pixel coordinates.
fn line(a: [f64; 2], b: [f64; 2], width: usize, height: usize, pixels: &mut [[u8; 3]]) {
    let steps = (b[0] - a[0]).abs().max((b[1] - a[1]).abs()).ceil().clamp(1.0, 4096.0);
    if !steps.is_finite() {
        return;
    }
    for n in 0..=steps as usize {
        let t = n as f64 / steps;
        let [x, y] = [0, 1].map(|k| a[k] + (b[k] - a[k]) * t - 1.0);
        for (i, j) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let [x, y] = [(x + i).round(), (y + j).round()];
            if x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64 {
                pixels[y as usize * width + x as usize] = INK.map(|c| c as u8);
            }
        }
    }
}

/// Returns the number of a cell in its block.
fn within(cell: IVec3) -> usize {
    let [x, y, z] = cell.rem_euclid(IVec3::splat(SIDE)).to_array();
    (x + SIDE * (y + SIDE * z)) as usize
}
