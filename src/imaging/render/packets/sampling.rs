//! Adaptive image-plane sampling: interpolates pixels between rays. A voxel of the wall covers hundreds of pixels of a
//! frame, so most rays add no information.
//!
//! Rays are cast through the corners and the centres of blocks of 4×4 pixels. If the centre is what the corners predict, and
//! nothing else speaks against it, the block's pixels are interpolated. These conditions must hold ([`ImageSamples::judge`]):
//!
//! - All five rays end in the wall in their first layer, or all in their second, or all five meet nothing.
//! - The block's rays (corners and centre) are no farther apart than the finest waves in the scan ([`blur`](super::blur)): two voxels, or
//!   four if the scan is smoother than its grid. So the block has little to show between them.
//! - At the centre, brightness and the inverse depth of each layer (which is linear over a plane) match the mean of the
//!   corners, and the corners are not twisted.
//!
//! Between the corners values are bilinear, plus a tent over the centre for its difference: blocks meet without a seam. A block
//! that is nearly smooth is divided into quarters ([`subdivided`](super::subdivided)). Everywhere else each pixel gets its own ray.
//!
//! Not all of these rays are cast: where wider blocks are smooth, theirs predict the others ([`wide`](super::wide)).
//!
//! A custom shader that calls itself smooth ([`Shader::is_smooth`](crate::render::Shader::is_smooth)) has its colours
//! interpolated in the same way. Each of its channels must then meet the conditions for brightness, too, in addition to
//! all others: the headlight's brightness still shows how the wall turns between the rays.

use fearless_simd::{Simd, f32x16, prelude::*};
use rayon::prelude::*;

use super::cells::Colours;
use super::predict::predicted;
use super::rays::{PacketResult, SIDE};
use crate::render::distances::Distances;

/// Side of a block, pixels.
pub(crate) const BLOCK: usize = 4;
/// Number of blocks judged at once.
pub(crate) const LANES: usize = 16;
/// How much the centre may differ from the corners' mean: brightness, 0 to 1.
const BRIGHTNESS: f32 = 0.027;
/// The most that brightness may change over a block.
pub(crate) const CONTRAST: f32 = 0.5;
/// How much the centre's depth may differ, units: see [`Point::near`].
const DEPTH: f32 = 0.25;
/// The most that depth may change over a block, units.
pub(crate) const SLOPE: f32 = 3.0;
/// The largest side of a block, units: 2√2, at which the rays of corners and centres are 2 units apart.
const LARGEST: f32 = 2.83;
/// A ray has ended in the wall when no more than this share of light comes from beyond.
const OPAQUE: f32 = 0.02;
/// A block with errors up to this multiple of those allowed is likely to be smooth at half the side, where they are a
/// quarter. It is subdivided.
const NEARLY_SMOOTH: f32 = 4.0;
/// Values kept for each ray: those of [`Point`]. A custom shader's [`Rgb`] comes after them.
const FIELDS: usize = 4;

/// Red, green and blue that a custom shader has given to a ray.
pub(crate) type Rgb = [f32; 3];
/// A ray's result, and its colour if a custom shader gives it.
pub(crate) type Shaded<'a> = (&'a PacketResult, Option<&'a Colours>);

/// The result of one ray.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Point {
    /// 1 / depth at which the ray ended, in units of half the finest waves (of a sharp scan: voxels of the smallest spacing); 0 if it met nothing; NaN unless it ended
    /// in the wall in its first or second layer, or met nothing.
    pub near: f32,
    /// 1 / depth of the layer before, 0 if there is none.
    pub front: f32,
    /// Same as [`PacketResult::bright`].
    pub bright: f32,
    /// Same as [`PacketResult::tone`].
    pub tone: f32,
}

impl Point {
    /// Returns the results of a packet whose steps are `step` units long.
    #[inline(always)]
    pub(crate) fn all<S: Simd>(simd: S, light: &PacketResult, step: f32) -> [Self; 16] {
        let [near, front] = nearness(simd, light, step);
        std::array::from_fn(|n| Self { near: near[n], front: front[n], bright: light.bright[n], tone: light.tone[n] })
    }
}

/// Returns [`Point::near`] and [`Point::front`] for each ray of a packet.
#[inline(always)]
fn nearness<S: Simd>(simd: S, light: &PacketResult, step: f32) -> [[f32; 16]; 2] {
    let load = |values| f32x16::load_array_ref(simd, values);
    let (through, depth, layers) = (load(&light.through), load(&light.depth), load(&light.layers));
    let [front, front_depth] = [load(&light.front[0]), load(&light.front[1])];
    let (zero, one, least) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0), f32x16::splat(simd, 1e-6));
    let weight = one - through;
    let ended = through.simd_le(OPAQUE) & layers.simd_lt(1.5);
    // If there are two layers, the second must hold more than rounding errors.
    let (last, last_depth) = (weight - front, depth - front_depth);
    let ended = ended & last.simd_gt(1e-3) & last_depth.simd_gt(zero);
    let near = ended.select(last / (last_depth * step).max(least), f32x16::splat(simd, f32::NAN));
    let near = weight.simd_le(zero).select(zero, near);
    [near.to_array(), (front / (front_depth * step).max(least)).to_array()]
}

/// Rays in rows: for each row the fields of its rays, one after the other.
#[derive(Default)]
struct Points {
    values: Vec<f32>,
    /// [`FIELDS`], and those of [`Rgb`] if a custom shader gives them.
    fields: usize,
}

impl Points {
    #[inline(always)]
    fn get(&self, stride: usize, [x, y]: [usize; 2]) -> Point {
        let row = &self.values[self.fields * stride * y + x..];
        Point { near: row[0], front: row[stride], bright: row[2 * stride], tone: row[3 * stride] }
    }

    fn rgb(&self, stride: usize, [x, y]: [usize; 2]) -> Rgb {
        let at = (self.fields * y + FIELDS) * stride + x;
        [0, 1, 2].map(|channel| self.values[at + channel * stride])
    }

    /// Returns both inverse depths and the brightness of [`LANES`] rays in a row from (`x`, `y`) on.
    #[inline(always)]
    fn load<S: Simd>(&self, simd: S, stride: usize, [x, y]: [usize; 2]) -> [f32x16<S>; 3] {
        let at = self.fields * stride * y + x;
        let load = |at: usize| f32x16::from_slice(simd, &self.values[at..at + LANES]);
        [load(at), load(at + stride), load(at + 2 * stride)]
    }

    /// Returns a field of [`LANES`] rays in a row from (`x`, `y`) on.
    #[inline(always)]
    fn field<S: Simd>(&self, simd: S, stride: usize, [x, y]: [usize; 2], field: usize) -> f32x16<S> {
        let at = (self.fields * y + field) * stride + x;
        f32x16::from_slice(simd, &self.values[at..at + LANES])
    }

    /// Returns the brightness and the tone of [`LANES`] rays in a row from (`x`, `y`) on.
    #[inline(always)]
    fn light<S: Simd>(&self, simd: S, stride: usize, [x, y]: [usize; 2]) -> [f32x16<S>; 2] {
        let at = self.fields * stride * y + x;
        let (bright, tone) = (&self.values[at + 2 * stride..], &self.values[at + 3 * stride..]);
        [f32x16::from_slice(simd, &bright[..LANES]), f32x16::from_slice(simd, &tone[..LANES])]
    }

    /// Returns a channel of the colours of [`LANES`] rays in a row from (`x`, `y`) on.
    #[inline(always)]
    fn load_channel<S: Simd>(&self, simd: S, stride: usize, [x, y]: [usize; 2], channel: usize) -> f32x16<S> {
        let at = (self.fields * y + FIELDS + channel) * stride + x;
        f32x16::from_slice(simd, &self.values[at..at + LANES])
    }
}

/// The rays through the corners and the centres of a picture's blocks.
#[derive(Default)]
pub(crate) struct ImageSamples {
    /// Corners in a row of blocks, rounded up to a whole packet.
    stride: usize,
    corners: Points,
    centres: Points,
    /// For each packet, the number of steps for which no ray among its rays meets anything.
    starts: Vec<f32>,
}

/// Four rows of packets that are being filled.
pub(crate) struct Rows<'a> {
    stride: usize,
    fields: usize,
    corners: &'a mut [f32],
    centres: &'a mut [f32],
    starts: &'a mut [f32],
}

impl ImageSamples {
    /// Makes room for a picture with blocks of the side `block`, with or without the colours of a custom shader.
    pub(crate) fn resize(&mut self, [width, height]: [usize; 2], block: usize, own_colours: bool) {
        let fields = if own_colours { FIELDS + size_of::<Rgb>() / size_of::<f32>() } else { FIELDS };
        self.stride = (width.div_ceil(block) + 1).next_multiple_of(SIDE);
        let rows = (height.div_ceil(block) + 1).next_multiple_of(SIDE);
        for points in [&mut self.corners, &mut self.centres] {
            // Verdicts beyond the last block are ignored.
            points.values.resize(fields * self.stride * rows + LANES + 1, 0.0);
            points.fields = fields;
        }
        self.starts.resize(self.stride / SIDE * rows / SIDE, 0.0);
    }

    /// Returns its rows of packets, from top to bottom.
    pub(crate) fn rows(&mut self) -> impl IndexedParallelIterator<Item = Rows<'_>> {
        let (stride, fields) = (self.stride, self.corners.fields);
        let length = fields * stride * SIDE;
        let whole = self.starts.len() / (stride / SIDE) * length;
        let corners = self.corners.values[..whole].par_chunks_mut(length);
        let centres = self.centres.values[..whole].par_chunks_mut(length);
        let starts = self.starts.par_chunks_mut(stride / SIDE);
        corners.zip(centres).zip(starts).map(move |((corners, centres), starts)| Rows {
            stride,
            fields,
            corners,
            centres,
            starts,
        })
    }

    /// Returns the distances along the rays through the corners of a picture's blocks, if the picture has the given size, pixels, and
    /// an inverse distance of 1 is that of `unit_mm`, mm.
    pub(crate) fn distances(&self, size: [usize; 2], unit_mm: f32) -> Distances<'_> {
        let count = size.map(|s| s.div_ceil(BLOCK) + 1);
        Distances::new(&self.corners.values, self.corners.fields * self.stride, count, BLOCK, unit_mm)
    }

    /// Returns the block (`x`, `y`).
    #[inline(always)]
    pub(crate) fn block(&self, [x, y]: [usize; 2]) -> Block {
        let corner = |x, y| self.corners.get(self.stride, [x, y]);
        let corners = [corner(x, y), corner(x + 1, y), corner(x, y + 1), corner(x + 1, y + 1)];
        Block { corners, centre: self.centres.get(self.stride, [x, y]) }
    }

    /// Returns brightness and tone of the rays of [`LANES`] blocks in a row from (`x`, `y`) on, in the order of [`Block::points`].
    #[inline(always)]
    pub(crate) fn lights<S: Simd>(&self, simd: S, [x, y]: [usize; 2]) -> [[f32x16<S>; 2]; 5] {
        let corners = &self.corners;
        [
            corners.light(simd, self.stride, [x, y]),
            corners.light(simd, self.stride, [x + 1, y]),
            corners.light(simd, self.stride, [x, y + 1]),
            corners.light(simd, self.stride, [x + 1, y + 1]),
            self.centres.light(simd, self.stride, [x, y]),
        ]
    }

    /// Returns the colours of the block (`x`, `y`) in the order of [`Block::points`] if a custom shader gives them.
    #[inline(always)]
    pub(crate) fn colours(&self, [x, y]: [usize; 2]) -> Option<[Rgb; 5]> {
        let corner = |x, y| self.corners.rgb(self.stride, [x, y]);
        let all = || {
            let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x, y + 1), corner(x + 1, y + 1)];
            [a, b, c, d, self.centres.rgb(self.stride, [x, y])]
        };
        self.has_colours().then(all)
    }

    /// True if a custom shader has coloured the rays.
    #[inline(always)]
    pub(crate) fn has_colours(&self) -> bool {
        self.corners.fields > FIELDS
    }

    /// Returns the number of steps for which no ray through the block (`x`, `y`) meets anything.
    #[inline(always)]
    pub(crate) fn start(&self, [x, y]: [usize; 2]) -> f32 {
        self.starts[y / SIDE * (self.stride / SIDE) + x / SIDE]
    }

    /// Judges [`LANES`] blocks in a row from (`x`, `y`) on. `side` is the side of a block at distance 1.
    #[inline(never)]
    pub(crate) fn judge<S: Simd>(&self, simd: S, at: [usize; 2], side: f32) -> Verdict {
        simd.vectorize(
            #[inline(always)]
            || self.judge_lanes(simd, at, side),
        )
    }

    #[inline(always)]
    fn judge_lanes<S: Simd>(&self, simd: S, [x, y]: [usize; 2], side: f32) -> Verdict {
        let corners = |x, y| self.corners.load(simd, self.stride, [x, y]);
        let [a, b, c, d] = [corners(x, y), corners(x + 1, y), corners(x, y + 1), corners(x + 1, y + 1)];
        let centre = self.centres.load(simd, self.stride, [x, y]);
        let zero = f32x16::splat(simd, 0.0);
        let near = Five::new([a[0], b[0], c[0], d[0]], centre[0]);
        let front = Five::new([a[1], b[1], c[1], d[1]], centre[1]);
        let bright = Five::new([a[2], b[2], c[2], d[2]], centre[2]);

        // NaN does not equal itself.
        let all = near.sum + near.centre;
        let plain = all.simd_eq(all);
        let nothing = plain & all.simd_le(zero);
        // All have a layer in front, or none has.
        let alike = front.least.min(front.centre).simd_gt(zero) | front.most.max(front.centre).simd_le(zero);
        let met = plain & alike & near.least.min(near.centre).simd_gt(zero);
        let close = met & (near.centre * LARGEST).simd_ge(side);
        // The largest of all errors, as multiples of those allowed. Second differences shrink with the square of the
        // side, first differences with the side.
        let [near, front] = [near.surface(simd), front.surface(simd)];
        let [shade, contrast] = bright.light();
        let mut second = shade.max(near[0]).max(front[0]);
        let mut first = contrast.max(near[1]).max(front[1]);
        if self.has_colours() {
            for channel in 0..3 {
                let corners = |x, y| self.corners.load_channel(simd, self.stride, [x, y], channel);
                let corners = [corners(x, y), corners(x + 1, y), corners(x, y + 1), corners(x + 1, y + 1)];
                let centre = self.centres.load_channel(simd, self.stride, [x, y], channel);
                let [shade, contrast] = Five::new(corners, centre).light();
                (second, first) = (second.max(shade), first.max(contrast));
            }
        }
        let smooth = nothing | close & second.simd_le(1.0) & first.simd_le(1.0);
        let subdivided = close & second.simd_le(NEARLY_SMOOTH) & first.simd_le(NEARLY_SMOOTH.sqrt());
        Verdict { smooth: smooth.to_bitmask() as u16, subdivided: subdivided.to_bitmask() as u16 }
    }

    /// Writes the corners of sixteen blocks in a row from (`x`, `y`) on into the row `to` of blocks of half the side, and what
    /// else the blocks predict there and in the next row, if they exist.
    #[inline(never)]
    pub(crate) fn predict<S: Simd>(&self, simd: S, at: [usize; 2], exists: bool, rows: &mut Rows<'_>, to: usize) {
        simd.vectorize(
            #[inline(always)]
            || self.predict_lanes(simd, at, exists, rows, to),
        );
    }

    #[inline(always)]
    fn predict_lanes<S: Simd>(&self, simd: S, [x, y]: [usize; 2], exists: bool, rows: &mut Rows<'_>, to: usize) {
        for field in 0..self.corners.fields {
            let (corners, centres, stride) = (&self.corners, &self.centres, self.stride);
            let a = corners.field(simd, stride, [x, y], field);
            if !exists {
                rows.spread(false, [to, field], x, a, a);
                continue;
            }
            let b = corners.field(simd, stride, [x + 1, y], field);
            let c = corners.field(simd, stride, [x, y + 1], field);
            let d = corners.field(simd, stride, [x + 1, y + 1], field);
            let e = centres.field(simd, stride, [x, y], field);
            // Without a block there, what is predicted is not used.
            let (up, before) = (y.saturating_sub(1), x.saturating_sub(1));
            let above = [
                centres.field(simd, stride, [x, up], field),
                corners.field(simd, stride, [x, up], field),
                corners.field(simd, stride, [x + 1, up], field),
            ];
            let mut left = [
                centres.field(simd, stride, [before, y], field),
                corners.field(simd, stride, [before, y], field),
                corners.field(simd, stride, [before, y + 1], field),
            ];
            if x == 0 {
                left = [shifted(simd, left[0]), shifted(simd, left[1]), shifted(simd, left[2])];
            }
            let [top, side, q0, q1, q2, q3] = predicted([a, b, c, d, e], above, left);
            rows.spread(false, [to, field], x, a, top);
            rows.spread(false, [to + 1, field], x, side, e);
            rows.spread(true, [to, field], x, q0, q1);
            rows.spread(true, [to + 1, field], x, q2, q3);
        }
    }

    /// Returns the memory taken, bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<f32>() * (self.corners.values.len() + self.centres.values.len() + self.starts.len())
    }
}

/// Returns the lanes one place further on.
#[inline(always)]
fn shifted<S: Simd>(simd: S, values: f32x16<S>) -> f32x16<S> {
    let values = values.to_array();
    let mut out = values;
    out[1..].copy_from_slice(&values[..LANES - 1]);
    f32x16::load_array_ref(simd, &out)
}

/// A value at the corners (a and b above c and d) and at the centre of blocks. Has methods because closures do not
/// inherit the level's instructions.
struct Five<S: Simd> {
    centre: f32x16<S>,
    sum: f32x16<S>,
    /// How much the corners are twisted: |a + d − b − c|.
    twist: f32x16<S>,
    /// Least and greatest value at the corners.
    least: f32x16<S>,
    most: f32x16<S>,
}

impl<S: Simd> Five<S> {
    #[inline(always)]
    fn new([a, b, c, d]: [f32x16<S>; 4], centre: f32x16<S>) -> Self {
        let (least, most) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        Self { centre, sum: a + b + c + d, twist: (a + d - b - c).abs(), least, most }
    }

    /// Returns how much the centre differs from the corners' mean.
    #[inline(always)]
    fn bend(&self) -> f32x16<S> {
        (self.centre - self.sum * 0.25).abs()
    }

    /// For brightness or a channel of the colour: returns its errors, of second and of first differences, as multiples of
    /// those allowed.
    #[inline(always)]
    fn light(&self) -> [f32x16<S>; 2] {
        let second = (self.bend() * (1.0 / BRIGHTNESS)).max(self.twist * (0.25 / BRIGHTNESS));
        [second, (self.most - self.least) * (1.0 / CONTRAST)]
    }

    /// For a surface's inverse depth: returns its errors in depth, of second and of first differences, as multiples of
    /// those allowed.
    #[inline(always)]
    fn surface(&self, simd: S) -> [f32x16<S>; 2] {
        // With n = 1/depth, a small change of n by δ is a change of depth by δ/n².
        let one = f32x16::splat(simd, 1.0);
        let scale = one / self.centre.simd_gt(0.0).select(self.centre * self.centre, one);
        let slope = self.most.max(self.centre) - self.least.min(self.centre);
        let second = (self.bend() * (1.0 / DEPTH)).max(self.twist * (0.25 / DEPTH));
        [second * scale, slope * scale * (1.0 / SLOPE)]
    }
}

impl Rows<'_> {
    /// Writes values of blocks twice as wide, from the `x`th of these on, into the even and the odd places of a row and field of the
    /// corners or the centres.
    #[inline(always)]
    fn spread<S: Simd>(&mut self, centres: bool, [row, field]: [usize; 2], x: usize, even: f32x16<S>, odd: f32x16<S>) {
        let points = if centres { &mut *self.centres } else { &mut *self.corners };
        let from = self.stride * (self.fields * row + field);
        let Some(out) = points.get_mut(from + 2 * x..from + self.stride) else { return };
        let (low, high) = even.interleave(odd);
        if let Some((first, rest)) = out.split_at_mut_checked(LANES)
            && rest.len() >= LANES
        {
            low.store_slice(first);
            high.store_slice(&mut rest[..LANES]);
        } else {
            for (out, value) in out.iter_mut().zip(low.to_array().into_iter().chain(high.to_array())) {
                *out = value;
            }
        }
    }

    /// Stores rays of a packet, the first of them at the given places of these rows: column and row of a corner, or of a centre if so.
    #[inline(never)]
    pub(crate) fn put<S: Simd>(
        &mut self,
        simd: S,
        (light, own): Shaded<'_>,
        places: impl Iterator<Item = ([usize; 2], bool)>,
        step: f32,
    ) {
        let [near, front] = simd.vectorize(
            #[inline(always)]
            || nearness(simd, light, step),
        );
        for (n, ([x, row], is_centre)) in places.enumerate() {
            let points = if is_centre { &mut *self.centres } else { &mut *self.corners };
            let own = own.into_iter().flatten();
            let fields = [&near, &front, &light.bright, &light.tone].into_iter().chain(own);
            for (field, values) in fields.take(self.fields).enumerate() {
                points[self.stride * (self.fields * row + field) + x] = values[n];
            }
        }
    }

    /// Returns the number of steps for which no ray of a packet meets anything.
    #[inline(always)]
    pub(crate) fn start(&self, packet: usize) -> f32 {
        self.starts[packet]
    }

    /// Sets it.
    #[inline(always)]
    pub(crate) fn set_start(&mut self, packet: usize, start: f32) {
        self.starts[packet] = start;
    }

    /// Returns the number of packets in the rows.
    pub(crate) fn packets(&self) -> usize {
        self.starts.len()
    }

    /// Stores the packet `n` of the corners and that of the centres.
    ///
    /// Their steps are `step` units long, and they meet nothing before `start` steps.
    #[inline(never)]
    pub(crate) fn keep<S: Simd>(
        &mut self,
        simd: S,
        n: usize,
        [corners, centres]: [Shaded<'_>; 2],
        step: f32,
        start: f32,
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                self.starts[n] = start;
                for ((light, own), points) in [(corners, &mut *self.corners), (centres, &mut *self.centres)] {
                    let [near, front] = nearness(simd, light, step);
                    let own = own.into_iter().flatten();
                    let fields = [&near, &front, &light.bright, &light.tone].into_iter().chain(own);
                    for (field, values) in fields.take(self.fields).enumerate() {
                        for (row, values) in values.chunks_exact(SIDE).enumerate() {
                            let at = self.stride * (self.fields * row + field) + SIDE * n;
                            points[at..at + SIDE].copy_from_slice(values);
                        }
                    }
                }
            },
        );
    }
}

/// The verdicts on some blocks, a bit for each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Verdict {
    /// Blocks whose pixels may be interpolated.
    pub smooth: u16,
    /// Blocks that are worth subdividing.
    pub subdivided: u16,
}

/// The rays of a block: the corners (left to right, then top to bottom) and the centre.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Block {
    /// Corners.
    pub corners: [Point; 4],
    /// Centre.
    pub centre: Point,
}

impl Block {
    /// Returns all its rays.
    #[inline(always)]
    pub(crate) fn points(&self) -> [Point; 5] {
        let [a, b, c, d] = self.corners;
        [a, b, c, d, self.centre]
    }
}

/// Weights of a block's rays (corners, then centre) in each of its pixels, row by row: bilinear between the corners,
/// plus a tent over the centre for its difference from their mean.
pub(crate) static WEIGHTS: [[f32; BLOCK * BLOCK]; 5] = weights();

const fn weights() -> [[f32; BLOCK * BLOCK]; 5] {
    let mut all = [[0.0; BLOCK * BLOCK]; 5];
    let mut n = 0;
    while n < BLOCK * BLOCK {
        let (u, v) = ((n % BLOCK) as f32 / BLOCK as f32, (n / BLOCK) as f32 / BLOCK as f32);
        let (du, dv) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let tent = (1.0 - if du < 0.0 { -du } else { du }) * (1.0 - if dv < 0.0 { -dv } else { dv });
        all[0][n] = (1.0 - u) * (1.0 - v) - 0.25 * tent;
        all[1][n] = u * (1.0 - v) - 0.25 * tent;
        all[2][n] = (1.0 - u) * v - 0.25 * tent;
        all[3][n] = u * v - 0.25 * tent;
        all[4][n] = tent;
        n += 1;
    }
    all
}

#[cfg(test)]
mod tests {
    use fearless_simd::Level;

    use super::*;

    /// A packet whose rays end at the given points; a layer in front takes half of their light.
    fn light(points: [Point; 16]) -> PacketResult {
        let mut light = PacketResult { through: [0.0; 16], ..PacketResult::default() };
        for (n, p) in points.iter().enumerate() {
            (light.bright[n], light.tone[n]) = (p.bright, p.tone);
            light.layers[n] = if p.near.is_nan() { 2.0 } else { f32::from(p.front > 0.0) };
            light.depth[n] = if p.near.is_nan() { 1.0 } else { 1.0 / p.near };
            if p.front > 0.0 {
                [light.front[0][n], light.front[1][n]] = [0.5, 0.5 / p.front];
                light.depth[n] = 0.5 / p.near + 0.5 / p.front;
            }
            if p.near == 0.0 {
                (light.depth[n], light.through[n]) = (0.0, 1.0);
            }
        }
        light
    }

    /// The samples of a picture of `size`; `of` returns the result of a ray at a position in pixels.
    fn samples_of(size: [usize; 2], of: impl Fn(f32, f32) -> Point + Sync) -> ImageSamples {
        let mut samples = ImageSamples::default();
        samples.resize(size, BLOCK, false);
        samples.rows().enumerate().for_each(|(y, mut rows)| {
            for x in 0..rows.packets() {
                let packet = |shift: usize| {
                    let at = |first: usize, n: usize| ((SIDE * first + n) * BLOCK + shift) as f32;
                    light(std::array::from_fn(|n| of(at(x, n % SIDE), at(y, n / SIDE))))
                };
                let (corners, centres) = (packet(0), packet(BLOCK / 2));
                let packets = [(&corners, None), (&centres, None)];
                fearless_simd::dispatch!(Level::new(), simd => rows.keep(simd, x, packets, 1.0, 0.0));
            }
        });
        samples
    }

    fn judge(samples: &ImageSamples, at: [usize; 2], side: f32) -> Verdict {
        let best = fearless_simd::dispatch!(Level::new(), simd => samples.judge(simd, at, side));
        let least = fearless_simd::dispatch!(Level::baseline(), simd => samples.judge(simd, at, side));
        assert_eq!(best, least);
        best
    }

    const SIZE: [usize; 2] = [64, 64];
    /// Far below the largest side.
    const SMALL: f32 = 1e-3;

    #[test]
    fn planes_and_nothing_are_smooth_up_to_the_largest_side() {
        // Without and with a second plane in front.
        for front in [0.0, 0.08] {
            let plane = |x: f32, y: f32| {
                let front = if front > 0.0 { front + 1e-5 * (x + y) } else { 0.0 };
                Point { near: 0.05 + 1e-5 * (x - y), front, bright: 0.3 + 0.005 * x, tone: 1.0 }
            };
            let plane = samples_of(SIZE, plane);
            assert_eq!(judge(&plane, [0, 7], SMALL), Verdict { smooth: u16::MAX, subdivided: u16::MAX });
            assert_eq!(judge(&plane, [0, 7], LARGEST * 0.06), Verdict::default());
        }
        let nothing = samples_of(SIZE, |_, _| Point::default());
        assert_eq!(judge(&nothing, [0, 15], SMALL).smooth, u16::MAX);
    }

    #[test]
    fn edges_and_what_lies_behind_them_are_not_smooth() {
        let grey = Point { near: 0.05, bright: 0.5, ..Point::default() };
        let tests: [&(dyn Fn(f32) -> Point + Sync); 7] = [
            &|near| Point { near, ..grey },
            &|near| Point { near: near - 0.05, ..grey },
            &|near| Point { near: if near > 0.05 { f32::NAN } else { near }, ..grey },
            &|near| Point { bright: near * 10.0, ..grey },
            // Another surface in front has an edge, begins or ends.
            &|near| Point { front: near + 0.05, ..grey },
            &|near| Point { front: near - 0.05, near: 0.04, ..grey },
            &|near| Point { front: if near > 0.05 { 0.0 } else { 0.1 }, ..grey },
        ];
        for (n, of) in tests.into_iter().enumerate() {
            // Blocks 0 to 4 are before the edge, block 5 contains it.
            let samples = samples_of(SIZE, |x, _| of(if x < 21.0 { 0.05 } else { 0.1 }));
            let verdict = judge(&samples, [0, 3], SMALL);
            assert_eq!(verdict.smooth & 0x3f, 0x1f, "{n}");
            assert_eq!(verdict.subdivided & 1 << 5, 0, "{n}");
        }
    }

    /// The samples of a picture in which nothing but the colours changes; `of` returns those of a ray.
    fn coloured(of: impl Fn(f32, f32) -> Rgb) -> ImageSamples {
        let mut samples = ImageSamples::default();
        samples.resize(SIZE, BLOCK, true);
        let rows: Vec<_> = samples.rows().collect();
        for (y, mut rows) in rows.into_iter().enumerate() {
            for x in 0..rows.packets() {
                let grey = light([Point { near: 0.05, bright: 0.5, ..Point::default() }; 16]);
                let colours = [0, BLOCK / 2].map(|shift| {
                    let at = |first: usize, n: usize| ((SIDE * first + n) * BLOCK + shift) as f32;
                    let all: [Rgb; 16] = std::array::from_fn(|n| of(at(x, n % SIDE), at(y, n / SIDE)));
                    [0, 1, 2].map(|channel| all.map(|rgb| rgb[channel]))
                });
                let packets = [(&grey, Some(&colours[0])), (&grey, Some(&colours[1]))];
                fearless_simd::dispatch!(Level::new(), simd => rows.keep(simd, x, packets, 1.0, 0.0));
            }
        }
        samples
    }

    /// The wall may look the same in the headlight where a custom shader's colours have an edge, or bend.
    #[test]
    fn every_channel_of_a_custom_shader_counts() {
        for channel in 0..3 {
            let paint = |value: f32| {
                let mut rgb = [0.2, 0.3, 0.4];
                rgb[channel] = value;
                rgb
            };
            let edge = coloured(|x, _| paint(if x < 21.0 { 0.05 } else { 0.9 }));
            let verdict = judge(&edge, [0, 3], SMALL);
            assert_eq!((verdict.smooth & 0x3f, verdict.subdivided & 1 << 5), (0x1f, 0), "{channel}");
            let [corner, .., centre] = edge.colours([4, 3]).unwrap();
            assert_eq!([corner, centre], [paint(0.05); 2]);
            assert_eq!(edge.colours([5, 3]).unwrap(), [0.05, 0.9, 0.05, 0.9, 0.9].map(paint));
            let bowl = |c: f32| judge(&coloured(|x, y| paint(c * (x * x + y * y))), [0, 0], SMALL);
            let [smooth, rough] = [0.9, 1.1].map(|errors| bowl(errors * BRIGHTNESS / 8.0));
            assert_eq!([smooth.smooth & 1, rough.smooth & 1, rough.subdivided & 1], [1, 0, 1], "{channel}");
        }
        assert!(samples_of(SIZE, |_, _| Point::default()).colours([0, 0]).is_none());
    }

    #[test]
    fn a_block_that_is_nearly_smooth_is_subdivided() {
        // The centre differs from the corners' mean by 4c for each of two directions.
        let bowl =
            |c: f32| move |x: f32, y: f32| Point { near: 0.05, bright: 0.1 + c * (x * x + y * y), ..Point::default() };
        let verdict = |c: f32| judge(&samples_of([4, 4], bowl(c)), [0, 0], SMALL);
        let [smooth, subdivided, rough] = [0.9, 3.9, 4.1].map(|errors| verdict(errors * BRIGHTNESS / 8.0));
        assert_eq!(
            [smooth.smooth & 1, subdivided.smooth & 1, subdivided.subdivided & 1, rough.subdivided & 1],
            [1, 0, 1, 0]
        );
    }
}
