//! The picture of a camera at rest: sharp at first, then better with every pass, until it is the reference.

use rayon::prelude::*;

use super::cost;
use crate::render::caster::within_pixel;
use crate::render::packets::BLOCK;
use crate::render::renderer::{Renderer, SQUARE};
use crate::render::{Frame, ImageSize, View, Work};

/// Samples a pixel of the finished picture.
#[doc(hidden)]
pub const SAMPLES: u32 = 16;
/// Strips of a pass have a multiple of this many rows, which is also a multiple of a block's.
const ROWS: usize = 4 * BLOCK;
/// Number of passes that sample every pixel. The later ones continue where these have differed: samples that are alike add nothing.
const EVERYWHERE: u32 = 3;
/// A sample that differs from the earlier ones by no more grey levels than this counts as alike.
const RESTLESS: u8 = 2;
/// Assumed cost of a pixel before any was rendered, in samples: for a sharp pass, a fine pass, and a pass over selected squares.
const FIRST: [f64; 3] = [12.0, 24.0, 12.0];
/// Factor by which predictions are increased.
const MARGIN: f64 = 1.15;

/// A picture that is being refined, pass by pass and strip by strip.
#[derive(Default)]
pub(crate) struct Still {
    /// The picture to be shown.
    shown: Frame,
    /// Sum of each pixel's samples.
    sums: Vec<[u16; 3]>,
    /// For each square, by how many grey levels a sample differed from the earlier ones.
    unrest: Vec<u8>,
    /// The squares of a strip in which another sample is worth its cost.
    wanted: Vec<bool>,
    strip: Frame,
    /// The current pass: 0 makes the picture sharp, each other pass takes one sample a pixel.
    pass: u32,
    /// The first row that it has not reached.
    row: usize,
    /// Cost of a pixel in the last strips of each kind of pass, in samples.
    cost: Option<[f64; 3]>,
}

/// The renderers that refine a picture.
pub(crate) struct Means<'a> {
    /// Renders the sharp picture.
    pub sharp: &'a mut (dyn Renderer + 'static),
    /// Renders one of the reference's samples; `None` if the picture is finished when it is sharp.
    pub fine: Option<&'a mut (dyn Renderer + 'static)>,
}

impl Means<'_> {
    /// Returns the number of passes that refine a sharp picture.
    fn passes(&self) -> u32 {
        if self.fine.is_some() { SAMPLES } else { 0 }
    }
}

impl Still {
    /// Starts with the picture that the caller draws into what this returns. `sharp` is true if all of its pixels were traced.
    pub(crate) fn begin(&mut self, size: ImageSize, sharp: bool) -> &mut Frame {
        self.shown.resize(size.width, size.height);
        (self.pass, self.row) = (u32::from(sharp), 0);
        &mut self.shown
    }

    /// Returns the current picture.
    pub(crate) fn shown(&self) -> &Frame {
        &self.shown
    }

    /// Returns the number of reference samples that each pixel has.
    pub(crate) fn samples(&self) -> u32 {
        self.pass.saturating_sub(1)
    }

    /// True if every pixel was traced.
    pub(crate) fn is_sharp(&self) -> bool {
        self.pass > 0
    }

    /// True if the picture is finished after `passes` that each take one sample a pixel.
    pub(crate) fn is_done(&self, passes: u32) -> bool {
        self.pass > passes
    }

    /// Continues the picture of `view` with `budget` samples, or with one strip if that takes more.
    ///
    /// A sharp picture from a stretching renderer is one strip, since its rays are few.
    pub(crate) fn go_on(&mut self, view: &View, mut means: Means<'_>, budget: u64) -> Work {
        let mut all = Work::default();
        let mut expected = self.cost.unwrap_or(FIRST);
        let passes = means.passes();
        while !self.is_done(passes) {
            let kind = match self.pass {
                0 => 0,
                1..=EVERYWHERE => 1,
                _ => 2,
            };
            let left = budget.saturating_sub(cost(&all)) as f64;
            let affordable = match kind {
                0 if means.sharp.stretches() => view.height(),
                _ => (left / (expected[kind] * MARGIN * view.width() as f64)) as usize / ROWS * ROWS,
            };
            if affordable == 0 && all != Work::default() {
                break;
            }
            let end = self.row.saturating_add(affordable.max(ROWS)).min(view.height());
            let shift = if kind == 0 { [0.0; 2] } else { place(self.pass - 1) };
            let part = view.strip(self.row..end, shift);
            self.choose(&part, kind);
            let work = match &mut means.fine {
                Some(fine) if kind == 2 => fine.render_squares(&part, &mut self.strip, &self.wanted),
                Some(fine) if kind == 1 => fine.render(&part, &mut self.strip),
                _ => means.sharp.render(&part, &mut self.strip),
            };
            // Strips differ: the more expensive of two is the better prediction for the next.
            let now = cost(&work) as f64 / (part.width() * part.height()) as f64;
            expected[kind] = now.max(0.75 * expected[kind]);
            self.take(kind, view);
            all = all + work;
            self.row = end;
            if end == view.height() {
                (self.pass, self.row) = (self.pass + 1, 0);
            }
        }
        self.cost = Some(expected);
        all
    }

    /// Marks the squares of a strip that get a sample: at first all of them, then those whose samples differ.
    fn choose(&mut self, part: &View, kind: usize) {
        let (across, down) = (part.width().div_ceil(SQUARE), part.height().div_ceil(SQUARE));
        let first = self.row / SQUARE * across;
        self.unrest.resize((first + across * down).max(self.unrest.len()), 0);
        if self.pass <= 1 {
            let unrest = &mut self.unrest[first..first + across * down];
            unrest.par_chunks_mut(across).enumerate().for_each(|(y, row)| {
                for (x, unrest) in row.iter_mut().enumerate() {
                    *unrest = if is_at_border(part, x, y) { u8::MAX } else { 0 };
                }
            });
        }
        self.wanted.clear();
        self.wanted.extend(self.unrest[first..first + across * down].iter().map(|&u| kind < 2 || u > RESTLESS));
    }

    /// Copies a finished strip into the picture.
    fn take(&mut self, kind: usize, view: &View) {
        let (width, pixels) = (view.width(), self.strip.pixels());
        let first = self.row * width;
        let shown = &mut self.shown.buffers().0[first..first + pixels.len()];
        if kind == 0 {
            shown.copy_from_slice(pixels);
            return;
        }
        self.sums.resize(width * view.height(), [0; 3]);
        let sums = &mut self.sums[first..first + pixels.len()];
        let across = width.div_ceil(SQUARE);
        let unrest = &mut self.unrest[self.row / SQUARE * across..];
        let (anew, share) = (self.pass == 1, 1.0 / self.pass as f32);
        let rows = shown.par_chunks_mut(SQUARE * width).zip(sums.par_chunks_mut(SQUARE * width));
        let rows = rows.zip(pixels.par_chunks(SQUARE * width));
        let squares = unrest.par_chunks_mut(across).zip(self.wanted.par_chunks(across));
        rows.zip(squares).for_each(|(((shown, sums), pixels), (unrest, wanted))| {
            let rows = shown.chunks_mut(width).zip(sums.chunks_mut(width)).zip(pixels.chunks(width));
            for ((shown, sums), pixels) in rows {
                let columns = shown.chunks_mut(SQUARE).zip(sums.chunks_mut(SQUARE)).zip(pixels.chunks(SQUARE));
                let wanted = columns.zip(unrest.iter_mut().zip(wanted)).filter(|square| *square.1.1);
                for (((shown, sums), pixels), (unrest, _)) in wanted {
                    let all = shown.as_flattened_mut().iter_mut().zip(sums.as_flattened_mut());
                    for ((shown, sum), &new) in all.zip(pixels.as_flattened()) {
                        if anew {
                            *sum = 0;
                        } else {
                            *unrest = (*unrest).max(shown.abs_diff(new));
                        }
                        *sum += u16::from(new);
                        *shown = (f32::from(*sum) * share + 0.5) as u8;
                    }
                }
            }
        });
    }

    /// Returns the memory taken, bytes.
    pub(crate) fn bytes(&self) -> usize {
        let pixels = |f: &Frame| f.pixels().len() * 3;
        pixels(&self.shown)
            + pixels(&self.strip)
            + self.sums.len() * size_of::<[u16; 3]>()
            + self.unrest.len()
            + self.wanted.len()
    }
}

/// True if the camera shows something in one part of a square and nothing in another. A few samples cannot show how much.
fn is_at_border(view: &View, x: usize, y: usize) -> bool {
    if view.pixel().is_some() {
        return false;
    }
    let shown = |n: usize| view.ray_at(((x + n % 2) * SQUARE) as f64, ((y + n / 2) * SQUARE) as f64).is_some();
    (1..4).any(|n| shown(n) != shown(0))
}

/// Returns where the rays of sample `n` pass through their pixels, from the pixels' centres, pixels to the right and downwards.
///
/// These are the points of the reference, in an order whose mean stays near the centre, so that a picture does not
/// drift while it is refined.
fn place(n: u32) -> [f64; 2] {
    let mut left: Vec<[f64; 2]> = (0..SAMPLES)
        .map(|n| {
            let (u, v) = within_pixel(n, SAMPLES);
            [u - 0.5, v - 0.5]
        })
        .collect();
    let mut sum = [0.0; 2];
    for _ in 0..n.min(SAMPLES - 1) {
        let next = nearest(&left, sum);
        let [x, y] = left.swap_remove(next);
        sum = [sum[0] + x, sum[1] + y];
    }
    left[nearest(&left, sum)]
}

/// Returns the index of the point that brings the sum of all nearest to the centre.
fn nearest(points: &[[f64; 2]], sum: [f64; 2]) -> usize {
    let far = |p: &[f64; 2]| (sum[0] + p[0]).hypot(sum[1] + p[1]);
    let of_two = |a: usize, b: usize| if far(&points[b]) < far(&points[a]) { b } else { a };
    (0..points.len()).reduce(of_two).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_those_of_the_reference_and_stay_about_the_centre() {
        let mut all: Vec<[f64; 2]> = (0..SAMPLES).map(place).collect();
        let mut sum = [0.0; 2];
        for (n, p) in all.iter().enumerate() {
            sum = [sum[0] + p[0], sum[1] + p[1]];
            let off = sum[0].hypot(sum[1]) / (n + 1) as f64;
            assert!(off < 0.3 / (n + 1) as f64 + 0.1, "{n}: {off} pixels");
        }
        let mut reference: Vec<[f64; 2]> =
            (0..SAMPLES).map(|n| within_pixel(n, SAMPLES)).map(|(u, v)| [u - 0.5, v - 0.5]).collect();
        let order = |a: &[f64; 2], b: &[f64; 2]| a[0].total_cmp(&b[0]);
        all.sort_by(order);
        reference.sort_by(order);
        assert_eq!(all, reference);
    }
}
