//! Rays that need not be cast: what rays twice as far apart predict.
//!
//! First, rays are cast through the corners and the centres of blocks that are wider than those of the picture. Where such a block is smooth
//! ([`ImageSamples::judge`]; its rays are no farther apart than the finest waves that the scan can hold), they predict the remaining rays of
//! blocks half as wide ([`predict`](super::predict)). All others are cast. This is repeated down to the picture's blocks. What
//! follows does not know which rays were cast.

use std::array::from_fn;

use fearless_simd::Simd;

use super::cells::Cells;
use super::predict::REST;
use super::rays::{PacketResult, Rays, SIDE, paired};
use super::sampling::{self, BLOCK, ImageSamples, LANES};
use crate::render::Work;

/// The largest angle that the side of the widest blocks may cover, radians, unless they are [`LEAST`]. Wider ones are rarely smooth: in flights
/// of 512², 1024² and 2048² pixels, blocks of 8, 16 and 32 pixels were as fast as any or faster.
const ANGLE: f32 = 0.04;
/// The side of the picture's blocks is doubled at least and at most this often.
const LEAST: usize = 1;
const MOST: usize = 4;

/// Returns how often the side of the picture's blocks is doubled for the widest ones, if the directions of neighbouring pixels differ by
/// `turn`, radians.
pub(super) fn doublings(turn: f32) -> usize {
    (0..MOST).take_while(|n| turn * ((2 * BLOCK) << n) as f32 <= ANGLE).count().max(LEAST)
}

/// Casts the corners and centres of four rows of the widest blocks, the `n`th four of the picture. Their side is `block` pixels, and there are so
/// many of them across and down.
#[inline(always)]
pub(super) fn cast<S: Simd>(
    simd: S,
    rays: &Rays<'_>,
    cells: &mut Cells,
    rows: &mut sampling::Rows<'_>,
    n: usize,
    (block, [across, down]): (usize, [usize; 2]),
) -> Work {
    let mut work = Work::default();
    let within = |first: usize, count: usize| (count.saturating_sub(first)).min(SIDE) as u64;
    for packet in 0..rows.packets() {
        let [x, y] = [packet * SIDE * block, n * SIDE * block];
        let corner = [x as f32, y as f32];
        // The rays through the middles of blocks' sides are up to half a pixel farther out.
        let start = rays.start(simd, corner, [(SIDE * block + 1) as f32; 2], 0.0);
        // Two rows of corners with their centres: rays that are close meet the wall after as many steps.
        let halves: [_; 2] = from_fn(|half| {
            let top = y + half * (SIDE / 2) * block;
            if top / block > down {
                return (PacketResult::default(), None);
            }
            let pixel = |n: usize| {
                let (n, middle) = (n % 8, n / 8 * (block / 2));
                [x + n % SIDE * block + middle, top + n / SIDE * block + middle]
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
        rows.keep(simd, packet, [(&corners, colours(0)), (&centres, colours(1))], rays.step_in_waves(), start);
        // A picture has one more corner than blocks.
        let [rays, centres] = [1, 0].map(|more| within(packet * SIDE, across + more) * within(n * SIDE, down + more));
        work = work + Work { rays: rays + centres, samples: u64::from(corners.samples), ..Work::default() };
    }
    work
}

/// Fills four rows of blocks with a side of `block` pixels, the `n`th four of the picture, which has `blocks` across and down, from the rays of
/// blocks twice as wide, whose side at distance 1 is `side`.
#[inline(always)]
pub(super) fn fill<S: Simd>(
    simd: S,
    rays: &Rays<'_>,
    cells: &mut Cells,
    (wide, side): (&ImageSamples, f32),
    rows: &mut sampling::Rows<'_>,
    n: usize,
    (block, blocks): (usize, [usize; 2]),
) -> Work {
    let [across, down] = blocks;
    let [wide_across, wide_down] = blocks.map(|b| b.div_ceil(2));
    let mut waiting = Waiting { places: [Place::default(); 16], len: 0, block, work: Work::default() };
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
                let at = [packet * SIDE, n * SIDE];
                let from = wide.start(at.map(|c| c / 2));
                // Where nothing is left to cast, nobody asks.
                let size = [(SIDE * block + 1) as f32; 2];
                let is_done = both >> (2 * pair) & 3 == 3;
                let at = at.map(|c| (c * block) as f32);
                rows.set_start(packet, if is_done { from } else { rays.start(simd, at, size, from) });
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
    /// Side of a block, pixels.
    block: usize,
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
        let block = self.block;
        let pixel = |lane: usize| {
            let Place { at, is_centre } = place(lane);
            at.map(|c| c * block + if is_centre { block / 2 } else { 0 })
        };
        let start = places.iter().map(|p| rows.start(p.at[0] / SIDE)).fold(f32::INFINITY, f32::min);
        let light = rays.cast(simd, pixel, start, cells);
        let own = rays.colours(cells);
        let to = places.iter().map(|p| ([p.at[0], p.at[1] - n * SIDE], p.is_centre));
        rows.put(simd, (&light, own), to, rays.step_in_waves());
        let rays = places.len() as u64;
        self.work = self.work + Work { rays, samples: u64::from(light.samples), ..Work::default() };
        self.len = 0;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3};

    use super::{MOST, doublings};
    use crate::render::packets::{PacketRenderer, Pixels};
    use crate::render::{Frame, Renderer, Settings, View};
    use crate::space::{PreparedVolume, TransferFunction};
    use crate::volume::{Grid, Volume};

    /// Blocks are widest where pixels are narrow: a picture of 90° has blocks of 8, 16 and 32 pixels from 512, 1024 and 2048 pixels on.
    #[test]
    fn the_widest_blocks_cover_the_same_angle() {
        for (size, times) in [(100, 1), (512, 1), (1024, 2), (2048, 3), (4096, 4), (1 << 20, MOST)] {
            assert_eq!(doublings(2.0 / size as f32), times, "{size}");
        }
        assert_eq!(doublings(0.0), MOST);
        assert_eq!(doublings(f32::INFINITY), 1);
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
        let view = |[width, height]: [usize; 2], toward, angle| {
            View::new(DVec3::new(24.0, 22.0, 23.0), toward, DVec3::Z, angle, width, height).unwrap()
        };
        let mut used = PacketRenderer::new(&volume, Settings::default(), Pixels::Needed);
        let mut all = PacketRenderer::new(&volume, Settings::default(), Pixels::All);
        // The narrower the view, the wider the widest blocks.
        for ([width, height], angle) in [
            ([1, 1], 95.0),
            ([3, 8], 10.0),
            ([8, 3], 95.0),
            ([16, 17], 1.0),
            ([24, 24], 95.0),
            ([33, 40], 3.0),
            ([63, 31], 12.0),
            ([97, 66], 95.0),
            ([131, 129], 1.5),
            ([200, 149], 30.0),
        ] {
            used.render(&view([200, 180], DVec3::NEG_X, 95.0), &mut Frame::default());
            let view = view([width, height], DVec3::new(1.0, 0.4, -0.2), angle);
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
