//! Turns the rays of adaptive image-plane sampling into pixels, with more rays where they are needed.
//!
//! Blocks to be subdivided, and squares of pixels that must be traced, wait until there are four of them, which make a
//! whole packet. Which rays share a packet does not affect their results.

use std::array::from_fn;

use fearless_simd::Simd;

use super::cells::Cells;
use super::paint::Canvas;
use super::rays::Rays;
use super::sampling::{Block, ImageSamples, Point, Rgb, WEIGHTS};
use super::subdivided::{MIDDLES, SUBDIVIDED_WEIGHTS, Subdivided, even_colours, in_rows};
use crate::render::Work;
use crate::render::renderer::SQUARE;

/// Number of blocks, or squares, in a packet.
const GROUP: usize = 4;

/// Some rows of a picture's blocks that are being filled.
pub(crate) struct Band<'a, 'b> {
    rays: &'a Rays<'b>,
    cells: &'a mut Cells,
    canvas: Canvas<'a>,
    blocks: Waiting<Coarse>,
    squares: Waiting<[usize; 2]>,
    work: Work,
}

/// A block to be subdivided.
#[derive(Clone, Copy, Default)]
struct Coarse {
    block: Block,
    /// The colours of its rays if a custom shader gives them.
    colours: Option<[Rgb; 5]>,
    /// The pixel at its top left corner.
    at: [usize; 2],
    start: f32,
}

/// Items that wait for rays.
struct Waiting<T> {
    items: [T; GROUP],
    len: usize,
    /// The number of steps for which none of the rays meets anything.
    start: f32,
}

impl<T: Copy + Default> Default for Waiting<T> {
    fn default() -> Self {
        Self { items: [T::default(); GROUP], len: 0, start: f32::INFINITY }
    }
}

impl<T: Copy + Default> Waiting<T> {
    /// Adds an item; there must be fewer than [`GROUP`]. True if the group is now complete.
    #[inline(always)]
    fn push(&mut self, item: T, start: f32) -> bool {
        self.items[self.len] = item;
        self.len += 1;
        self.start = self.start.min(start);
        self.len == GROUP
    }

    /// Returns the item whose rays are in lane `n` of a packet, four to each. Unneeded lanes repeat the last item.
    #[inline(always)]
    fn of_lane(&self, n: usize) -> &T {
        &self.items[(n / 4).min(self.len - 1)]
    }
}

impl<'a, 'b> Band<'a, 'b> {
    /// Creates a band that casts `rays` for the pixels of `canvas`.
    pub(crate) fn new(rays: &'a Rays<'b>, cells: &'a mut Cells, canvas: Canvas<'a>) -> Self {
        Self { rays, cells, canvas, blocks: Waiting::default(), squares: Waiting::default(), work: Work::default() }
    }

    /// Fills a smooth block whose top left corner is at pixel `at`.
    #[inline(always)]
    pub(crate) fn smooth<S: Simd>(&mut self, simd: S, block: &Block, colours: Option<&[Rgb; 5]>, at: [usize; 2]) {
        match colours {
            None => self.canvas.blend(simd, block.points().map(|p| [p.bright, p.tone]), &WEIGHTS, at),
            Some(colours) => self.canvas.blend_colours(simd, colours, &WEIGHTS, at),
        }
    }

    /// Fills those of [`LANES`](super::sampling::LANES) smooth blocks in a row whose bit is set. Their rays are those from `block` on, whose top
    /// left corner is at pixel `at`; no shader colours them.
    #[inline(never)]
    pub(crate) fn smooth_row<S: Simd>(
        &mut self,
        simd: S,
        samples: &ImageSamples,
        block: [usize; 2],
        which: u16,
        at: [usize; 2],
    ) {
        simd.vectorize(
            #[inline(always)]
            || self.canvas.blend_row(simd, &samples.lights(simd, block), which, at),
        );
    }

    /// Casts a ray for every pixel of a block. The rays must meet nothing before `start` steps.
    #[inline(always)]
    pub(crate) fn rough<S: Simd>(&mut self, simd: S, at: [usize; 2], start: f32) {
        let light = self.rays.packet(simd, at, 1, start, self.cells);
        self.work = self.work + self.canvas.packet(simd, &light, self.rays.colours(self.cells), at);
    }

    /// Queues a block for subdivision.
    #[inline(always)]
    pub(crate) fn coarse<S: Simd>(
        &mut self,
        simd: S,
        block: Block,
        colours: Option<[Rgb; 5]>,
        at: [usize; 2],
        start: f32,
    ) {
        if self.blocks.push(Coarse { block, colours, at, start }, start) {
            self.subdivide(simd);
        }
    }

    /// Queues a square of pixels to be traced with a ray each. The rays must meet nothing before `start` steps.
    #[inline(always)]
    pub(crate) fn square<S: Simd>(&mut self, simd: S, at: [usize; 2], start: f32) {
        if self.squares.push(at, start) {
            self.trace(simd);
        }
    }

    /// Fills everything that still waits. Returns the work of the whole band.
    pub(crate) fn finish<S: Simd>(&mut self, simd: S) -> Work {
        if self.blocks.len > 0 {
            self.subdivide(simd);
        }
        if self.squares.len > 0 {
            self.trace(simd);
        }
        self.work
    }

    /// Casts the rays through the middles of the waiting blocks' sides.
    #[inline(never)]
    fn subdivide<S: Simd>(&mut self, simd: S) {
        let group = std::mem::take(&mut self.blocks);
        let middle = |n: usize| from_fn(|axis| group.of_lane(n).at[axis] + MIDDLES[n % 4][axis]);
        let light = self.rays.cast(simd, middle, group.start, self.cells);
        let rays = 4 * group.len as u64;
        self.work = self.work + Work { rays, samples: u64::from(light.samples), ..Work::default() };
        let middles = Point::all(simd, &light, self.rays.step_in_waves());
        let own = self.rays.colours(self.cells).copied();
        let items = group.items[..group.len].iter().zip(middles.chunks_exact(4)).enumerate();
        for (index, (Coarse { block, colours, at, start }, middles)) in items {
            let subdivided = Subdivided { block: *block, middles: from_fn(|n| middles[n]) };
            let mut smooth = subdivided.smooth();
            let colours = colours.as_ref().zip(own.as_ref()).map(|(&[a, b, c, d, centre], own)| {
                in_rows([a, b, c, d], centre, from_fn(|n| own.map(|channel| channel[4 * index + n])))
            });
            if let Some(colours) = &colours {
                let even = even_colours(colours);
                smooth = from_fn(|n| smooth[n] && even[n]);
            }
            if smooth.contains(&true) {
                if let Some(colours) = &colours {
                    self.canvas.blend_colours(simd, colours, &SUBDIVIDED_WEIGHTS, *at);
                } else {
                    let light = subdivided.points().map(|p| [p.bright, p.tone]);
                    self.canvas.blend(simd, light, &SUBDIVIDED_WEIGHTS, *at);
                }
            }
            // Its quarters are squares.
            for n in (0..4).filter(|&n| !smooth[n]) {
                let at = [at[0] + n % 2 * SQUARE, at[1] + n / 2 * SQUARE];
                if self.canvas.holds(at) {
                    self.square(simd, at, *start);
                }
            }
        }
    }

    /// Casts a ray for each pixel of the waiting squares.
    #[inline(never)]
    fn trace<S: Simd>(&mut self, simd: S) {
        let group = std::mem::take(&mut self.squares);
        let pixel = |n: usize| from_fn(|axis| group.of_lane(n)[axis] + ((n % 4) >> axis & 1));
        let light = self.rays.cast(simd, pixel, group.start, self.cells);
        self.work =
            self.work + self.canvas.squares(simd, &light, self.rays.colours(self.cells), &group.items[..group.len]);
    }
}
