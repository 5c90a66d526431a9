//! Rows of a frame that a thread measures by itself.

use std::array::from_fn;
use std::iter::repeat_with;

use fearless_simd::Level;

use super::{Crossing, Subject, Truth};
use crate::render::leap::RaysFrom;

/// Side of the squares of pixels whose rays are traced at once.
pub(super) const SIDE: usize = 4;
/// Rows of a band. Neighbouring rays visit the same voxels while they are in the cache.
const ROWS: usize = 2 * SIDE;

/// The rays from the cameras of a frame, and of those before and after it.
pub(super) struct Eyes<'a> {
    pub own: RaysFrom<'a>,
    pub near: [Option<RaysFrom<'a>>; 2],
    pub level: Level,
}

impl<'a> Eyes<'a> {
    pub(super) fn of(subject: &Subject<'a>) -> Self {
        Self {
            own: subject.rays.from(subject.view.position()),
            near: subject.neighbours.map(|n| n.map(|n| n.rays.from(n.view.position()))),
            level: Level::new(),
        }
    }
}

/// The rows of each part of a frame's truth; what is not asked for is empty.
pub(super) struct Band<'a> {
    /// Number of the first row.
    pub top: usize,
    pub width: usize,
    pub crossings: &'a mut [Option<Crossing>],
    /// For the frames before and after, how far each square's rays from here, and those from there to the same points, have no wall before
    /// them, mm from here.
    pub clear: [Vec<f64>; 2],
    /// The wall's normals, whether or not they are asked for.
    pub facing: Vec<[f32; 3]>,
    pub depth: &'a mut [f32],
    pub z: &'a mut [f32],
    pub normals: &'a mut [[f32; 3]],
    pub shading: &'a mut [f32],
    pub flow: [&'a mut [[f32; 2]]; 2],
    pub unseen: [&'a mut [u8]; 2],
    pub scene: &'a mut [[f32; 3]],
    pub labels: &'a mut [[u8; 2]],
    pub along: &'a mut [[f32; 3]],
}

/// A square of pixels, row by row.
pub(super) struct Square {
    /// The first pixel, within the band.
    first: usize,
    /// Pixels in a row of the picture.
    width: usize,
    /// Columns and rows within the picture.
    columns: usize,
    rows: usize,
    /// The pixels' middles, x and y, pixels from the picture's top left corner.
    pub at: [[f64; 16]; 2],
}

impl Square {
    /// Returns the pixels within the picture: the number in the square, and that in the band.
    #[inline(always)]
    pub(super) fn pixels(&self) -> impl Iterator<Item = (usize, usize)> {
        let (columns, first, width) = (self.columns, self.first, self.width);
        (0..self.rows).flat_map(move |y| (0..columns).map(move |x| (SIDE * y + x, first + width * y + x)))
    }

    /// Writes the square's values to those of the band, unless these were not asked for.
    #[inline(always)]
    pub(super) fn store<T: Copy>(&self, all: &mut [T], values: &[T; 16]) {
        if all.is_empty() {
            return;
        }
        for y in 0..self.rows {
            let (from, to) = (&values[SIDE * y..SIDE * (y + 1)], &mut all[self.first + self.width * y..]);
            // Copies of a known length need no call.
            match to.first_chunk_mut::<SIDE>() {
                Some(to) if self.columns == SIDE => to.copy_from_slice(from),
                _ => to[..self.columns].copy_from_slice(&from[..self.columns]),
            }
        }
    }
}

/// Returns the bands of a frame, from top to bottom.
pub(super) fn bands(truth: &mut Truth, width: usize) -> Vec<Band<'_>> {
    fn parts<T>(all: &mut [T], each: usize) -> impl Iterator<Item = &mut [T]> {
        all.chunks_mut(each).chain(repeat_with(Default::default))
    }
    let each = ROWS * width.max(1);
    let count = truth.crossings.len().div_ceil(each);
    let [before, after] = &mut truth.flow;
    let [unseen_before, unseen_after] = &mut truth.unseen;
    let mut crossings = parts(&mut truth.crossings, each);
    let (mut depth, mut z) = (parts(&mut truth.depth, each), parts(&mut truth.z, each));
    let (mut normals, mut shading) = (parts(&mut truth.normals, each), parts(&mut truth.shading, each));
    let (mut before, mut after) = (parts(before, each), parts(after, each));
    let (mut unseen_before, mut unseen_after) = (parts(unseen_before, each), parts(unseen_after, each));
    let (mut scene, mut labels) = (parts(&mut truth.scene, each), parts(&mut truth.labels, each));
    let mut along = parts(&mut truth.along, each);
    let mut band = |n: usize| {
        Some(Band {
            top: n * ROWS,
            width,
            crossings: crossings.next()?,
            clear: Default::default(),
            facing: Vec::new(),
            depth: depth.next()?,
            z: z.next()?,
            normals: normals.next()?,
            shading: shading.next()?,
            flow: [before.next()?, after.next()?],
            unseen: [unseen_before.next()?, unseen_after.next()?],
            scene: scene.next()?,
            labels: labels.next()?,
            along: along.next()?,
        })
    };
    (0..count).map_while(&mut band).collect()
}

impl Band<'_> {
    /// Returns the number of squares of [`SIDE`] × [`SIDE`] pixels.
    pub(super) fn squares(&self) -> usize {
        let rows = self.crossings.len() / self.width.max(1);
        rows.div_ceil(SIDE) * self.width.div_ceil(SIDE)
    }

    /// Returns a square.
    #[inline(always)]
    pub(super) fn square(&self, n: usize) -> Square {
        let (across, rows) = (self.width.div_ceil(SIDE), self.crossings.len() / self.width);
        let [left, top] = [n % across * SIDE, n / across * SIDE];
        let middle = [left as f64 + 0.5, (self.top + top) as f64 + 0.5];
        let at = [from_fn(|k| middle[0] + (k % SIDE) as f64), from_fn(|k| middle[1] + (k / SIDE) as f64)];
        Square {
            first: top * self.width + left,
            width: self.width,
            columns: SIDE.min(self.width - left),
            rows: SIDE.min(rows - top),
            at,
        }
    }
}
