//! Rays that need not be cast: what rays twice as far apart predict.
//!
//! First, rays are cast through the corners and the centres of blocks twice as wide as those of the picture. Where such a block is smooth
//! ([`ImageSamples::judge`]; its rays are no farther apart than the finest waves that the scan can hold), its five rays determine a
//! quadratic polynomial of the place in the picture but for how its curvature is divided between the two axes:
//!
//! ```text
//! f(x, y) = e + gx x + gy y + t x y + b (x² + y²) / 2 + …,
//! ```
//!
//! which the remaining rays of the picture's blocks do not ask for: a block's quarters have their centres on its diagonals, and for the
//! middle of a side the block beyond has its part. Both are exact for quadratic polynomials, so that errors shrink with the third power of
//! the side. All other rays are cast. What follows does not know which were.

use std::array::from_fn;

use fearless_simd::{Simd, f32x16};

use super::cells::Cells;
use super::rays::{PacketResult, Rays, SIDE, paired};
use super::sampling::{self, BLOCK, ImageSamples, LANES};
use crate::render::Work;

/// Side of a wide block, pixels.
pub(super) const WIDE: usize = 2 * BLOCK;
/// Number of rays that a wide block predicts: the middles of two of its sides, and the centres of its quarters.
const REST: usize = 6;

/// Casts the corners and centres of four rows of wide blocks, the `n`th four of the picture, which has `blocks` of its own across and down.
#[inline(always)]
pub(super) fn cast<S: Simd>(
    simd: S,
    rays: &Rays<'_>,
    cells: &mut Cells,
    rows: &mut sampling::Rows<'_>,
    n: usize,
    blocks: [usize; 2],
) -> Work {
    let mut work = Work::default();
    let [across, down] = blocks.map(|b| b.div_ceil(2));
    let within = |first: usize, count: usize| (count.saturating_sub(first)).min(SIDE) as u64;
    for packet in 0..rows.packets() {
        let [x, y] = [packet * SIDE * WIDE, n * SIDE * WIDE];
        let corner = [x as f32, y as f32];
        // The rays through the middles of blocks' sides are up to half a pixel farther out.
        let start = rays.start(simd, corner, [(SIDE * WIDE + 1) as f32; 2], 0.0);
        // Two rows of corners with their centres: rays that are close meet the wall after as many steps.
        let halves: [_; 2] = from_fn(|half| {
            let top = y + half * (SIDE / 2) * WIDE;
            if top / WIDE > down {
                return (PacketResult::default(), None);
            }
            let size = [SIDE * WIDE + 1, SIDE / 2 * WIDE + 1].map(|s| s as f32);
            let start = rays.start(simd, [x as f32, top as f32], size, start);
            let pixel = |n: usize| {
                let (n, middle) = (n % 8, n / 8 * (WIDE / 2));
                [x + n % SIDE * WIDE + middle, top + n / SIDE * WIDE + middle]
            };
            let light = rays.cast(simd, pixel, start, cells);
            (light, rays.colours(cells).copied())
        });
        let [corners, centres] = PacketResult::paired([&halves[0].0, &halves[1].0]);
        let colours = halves[0].1.as_ref().zip(halves[1].1.as_ref()).map(|(a, b)| {
            let pairs: [_; 3] = from_fn(|channel| paired([&a[channel], &b[channel]]));
            [0, 1].map(|kind| pairs.map(|p| p[kind]))
        });
        let colours = |kind: usize| colours.as_ref().map(|c| &c[kind]);
        rows.keep(simd, packet, [(&corners, colours(0)), (&centres, colours(1))], rays.step(), start);
        // A picture has one more corner than blocks.
        let [rays, centres] = [1, 0].map(|more| within(packet * SIDE, across + more) * within(n * SIDE, down + more));
        work = work + Work { rays: rays + centres, samples: u64::from(corners.samples), ..Work::default() };
    }
    work
}

/// Fills four rows of blocks, the `n`th four of the picture, which has `blocks` across and down, from the rays of wide blocks, whose side
/// at distance 1 is `side`.
#[inline(always)]
pub(super) fn fill<S: Simd>(
    simd: S,
    rays: &Rays<'_>,
    cells: &mut Cells,
    (wide, side): (&ImageSamples, f32),
    rows: &mut sampling::Rows<'_>,
    n: usize,
    blocks: [usize; 2],
) -> Work {
    let [across, down] = blocks;
    let [wide_across, wide_down] = blocks.map(|b| b.div_ceil(2));
    let mut waiting = Waiting { places: [Place::default(); 16], len: 0, work: Work::default() };
    // The verdicts on the rows of wide blocks here, and on the one above.
    let y = [0, 1].map(|half| n * SIDE / 2 + half);
    let mut before = [0; 2];
    for first in (0..=wide_across).step_by(LANES) {
        let inside = match wide_across - first {
            0..LANES => (1 << (wide_across - first)) - 1,
            _ => u16::MAX,
        };
        let smooth = |y: usize| if y < wide_down { wide.judge(simd, [first, y], side).smooth & inside } else { 0 };
        let own = y.map(smooth);
        let above = [if y[0] > 0 && own[0] != 0 { own[0] & smooth(y[0] - 1) } else { 0 }, own[1] & own[0]];
        let both = own[0] & own[1];
        for pair in 0..LANES / 2 {
            let packet = first / 2 + pair;
            if packet < rows.packets() {
                let at = [packet * SIDE * BLOCK, n * SIDE * BLOCK];
                let from = wide.start(at.map(|c| c / WIDE));
                // Where nothing is left to cast, nobody asks.
                let size = [(SIDE * BLOCK + 1) as f32; 2];
                let is_done = both >> (2 * pair) & 3 == 3;
                rows.set_start(packet, if is_done { from } else { rays.start(simd, at.map(|c| c as f32), size, from) });
            }
        }
        for half in 0..2 {
            if 2 * y[half] > down {
                break;
            }
            let (own, above) = (own[half], above[half]);
            let left = own & (own << 1 | before[half]);
            before[half] = own >> 15;
            wide.predict(simd, [first, y[half]], y[half] < wide_down, rows, 2 * half);
            for lane in 0..LANES.min(wide_across + 1 - first) {
                let bit = 1 << lane;
                let [u, v] = [2 * (first + lane), 2 * y[half]];
                // Top and left side, and the quarters' centres.
                let missing = [above & bit == 0, left & bit == 0, own & bit == 0];
                for k in 0..REST {
                    let is_centre = k >= 2;
                    let (right, low) = if is_centre { (k & 1, (k >> 1) - 1) } else { (1 - k, k) };
                    let at = [u + right, v + low];
                    // A picture has one more corner than blocks.
                    let least = [across, down].map(|b| b + usize::from(!is_centre));
                    if missing[k.min(2)] && at[0] < least[0] && at[1] < least[1] {
                        waiting.push(simd, rays, cells, rows, n, Place { at, is_centre });
                    }
                }
            }
        }
    }
    if waiting.len > 0 {
        waiting.cast(simd, rays, cells, rows, n);
    }
    waiting.work
}

/// A ray of the picture's blocks: the corner or the centre of the block (`x`, `y`).
#[derive(Clone, Copy, Default)]
struct Place {
    at: [usize; 2],
    is_centre: bool,
}

/// Rays that wait until there is a whole packet.
struct Waiting {
    places: [Place; 16],
    len: usize,
    work: Work,
}

impl Waiting {
    #[inline(always)]
    fn push<S: Simd>(
        &mut self,
        simd: S,
        rays: &Rays<'_>,
        cells: &mut Cells,
        rows: &mut sampling::Rows<'_>,
        n: usize,
        place: Place,
    ) {
        self.places[self.len] = place;
        self.len += 1;
        if self.len == self.places.len() {
            self.cast(simd, rays, cells, rows, n);
        }
    }

    #[inline(never)]
    fn cast<S: Simd>(&mut self, simd: S, rays: &Rays<'_>, cells: &mut Cells, rows: &mut sampling::Rows<'_>, n: usize) {
        let places = &self.places[..self.len];
        // Unneeded lanes repeat the last one.
        let place = |lane: usize| places[lane.min(places.len() - 1)];
        let pixel = |lane: usize| {
            let Place { at, is_centre } = place(lane);
            at.map(|c| c * BLOCK + if is_centre { BLOCK / 2 } else { 0 })
        };
        let start = places.iter().map(|p| rows.start(p.at[0] / SIDE)).fold(f32::INFINITY, f32::min);
        let light = rays.cast(simd, pixel, start, cells);
        let own = rays.colours(cells);
        let to = places.iter().map(|p| ([p.at[0], p.at[1] - n * SIDE], p.is_centre));
        rows.put(simd, (&light, own), to, rays.step());
        let rays = places.len() as u64;
        self.work = self.work + Work { rays, samples: u64::from(light.samples), ..Work::default() };
        self.len = 0;
    }
}

/// Returns what the rays of sixteen wide blocks (corners, then centre), the centres of the blocks above and to the left, and the other
/// corners of those predict: the middles of the top and left sides, and the centres of the quarters, row by row.
#[inline(always)]
pub(super) fn predicted<S: Simd>(
    [a, b, c, d, e]: [f32x16<S>; 5],
    [above, above_left, above_right]: [f32x16<S>; 3],
    [left, left_top, left_bottom]: [f32x16<S>; 3],
) -> [f32x16<S>; REST] {
    let bend = |corners: f32x16<S>, centre: f32x16<S>| centre - corners * 0.25;
    let own = bend(a + b + c + d, e);
    let middle =
        |ends: f32x16<S>, other: f32x16<S>, other_bend: f32x16<S>| (ends + e + other + own + other_bend) * 0.25;
    let top = middle(a + b, above, bend(above_left + above_right + a + b, above));
    let side = middle(a + c, left, bend(left_top + left_bottom + a + c, left));
    let (base, x, y) = (e - own * 0.25, (b + d - a - c) * 0.125, (c + d - a - b) * 0.125);
    let twist = (a + d - b - c) * 0.0625;
    [top, side, base - x - y + twist, base + x - y - twist, base - x + y - twist, base + x + y + twist]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use fearless_simd::{Level, prelude::*};
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::render::packets::{PacketRenderer, Pixels};
    use crate::render::{Frame, Renderer, Settings, View};
    use crate::space::{PreparedVolume, TransferFunction};
    use crate::volume::{Grid, Volume};

    /// Returns what wide blocks of the side 2 predict of `f` around (`x`, `y`), and what is there.
    fn compare(f: impl Fn(f64, f64) -> f64, [x, y]: [f64; 2], half: f64) -> [[f64; REST]; 2] {
        let at = |u: f64, v: f64| f(x + u * half, y + v * half);
        let lanes = |u: f64, v: f64| [at(u, v) as f32; 16];
        let own = [lanes(-1.0, -1.0), lanes(1.0, -1.0), lanes(-1.0, 1.0), lanes(1.0, 1.0), lanes(0.0, 0.0)];
        let above = [lanes(0.0, -2.0), lanes(-1.0, -3.0), lanes(1.0, -3.0)];
        let left = [lanes(-2.0, 0.0), lanes(-3.0, -1.0), lanes(-3.0, 1.0)];
        let found = fearless_simd::dispatch!(Level::new(), simd => {
            let load = |v: &[f32; 16]| f32x16::load_array_ref(simd, v);
            predicted(own.each_ref().map(load), above.each_ref().map(load), left.each_ref().map(load)).map(|v| f64::from(v.to_array()[7]))
        });
        let places = [[0.0, -1.0], [-1.0, 0.0], [-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]];
        [found, places.map(|[u, v]| at(u, v))]
    }

    /// Errors of what is predicted shrink with the third power of the side or faster.
    #[test]
    fn the_order_is_three() {
        let f = |x: f64, y: f64| (0.9 * x + 0.3).sin() * (0.7 * y - 0.2).cos() + 0.2 * (x * y).sin();
        let worst = |half: f64| {
            let places = (0..40).map(|n| [0.31 * f64::from(n % 7) - 1.0, 0.27 * f64::from(n / 7) - 0.8]);
            let errors = places.flat_map(|at| {
                let [found, truth] = compare(f, at, half);
                from_fn::<f64, REST, _>(|n| (found[n] - truth[n]).abs())
            });
            errors.fold(0.0, f64::max)
        };
        let [coarse, fine] = [worst(0.4), worst(0.2)];
        let order = (coarse / fine).log2();
        assert!((2.7..4.5).contains(&order) && fine > 1e-5, "{coarse} {fine}: {order}");
    }

    proptest! {
        #[test]
        fn what_is_quadratic_is_predicted_exactly(k in prop::array::uniform6(-1.0f64..1.0), x in -2.0f64..2.0, y in -2.0f64..2.0) {
            let f = |x: f64, y: f64| k[0] + k[1] * x + k[2] * y + k[3] * x * x + k[4] * x * y + k[5] * y * y;
            let [found, truth] = compare(f, [x, y], 0.8);
            for n in 0..REST {
                prop_assert!((found[n] - truth[n]).abs() < 3e-5, "{n}: {found:?} {truth:?}");
            }
        }
    }

    /// Pictures of any size, after larger ones of something else, are those of a new renderer, and close to those with a ray for every
    /// pixel.
    #[test]
    fn pictures_of_every_size_are_whole() {
        let grid = Grid::new([48; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let value = |n: usize| {
            let p = DVec3::new((n % 48) as f64, (n / 48 % 48) as f64, (n / 2304) as f64) - 23.5;
            let fold = 3.0 * (0.35 * p.x).sin();
            (-650.0 + 400.0 * (p.length() - 16.0 - fold).clamp(-0.9, 1.5)) as i16
        };
        let volume = Volume::new(grid.clone(), (0..grid.len()).map(value).collect());
        let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
        let view = |width, height, toward| {
            View::new(DVec3::new(24.0, 22.0, 23.0), toward, DVec3::Z, 95.0, width, height).unwrap()
        };
        let mut used = PacketRenderer::new(&volume, Settings::default(), Pixels::Needed);
        let mut all = PacketRenderer::new(&volume, Settings::default(), Pixels::All);
        for [width, height] in [[1, 1], [3, 8], [8, 3], [16, 17], [24, 24], [33, 40], [63, 31], [97, 66], [131, 129]] {
            used.render(&view(200, 180, DVec3::NEG_X), &mut Frame::default());
            let view = view(width, height, DVec3::new(1.0, 0.4, -0.2));
            let (mut a, mut b, mut c) = (Frame::default(), Frame::default(), Frame::default());
            used.render(&view, &mut a);
            PacketRenderer::new(&volume, Settings::default(), Pixels::Needed).render(&view, &mut b);
            all.render(&view, &mut c);
            assert!(a == b, "{width} × {height}: old rays are seen");
            let off = a.pixels().as_flattened().iter().zip(c.pixels().as_flattened()).map(|(a, c)| a.abs_diff(*c));
            let (most, sum) = off.fold((0, 0.0), |(most, sum), d| (d.max(most), sum + f64::from(d)));
            let mean = sum / (3 * width * height) as f64;
            assert!(most < 40 && mean < 1.0, "{width} × {height}: {most} {mean}");
        }
    }
}
