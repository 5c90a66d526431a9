//! Paint on the wall in finished pictures, by inks that belong to places of the wall. [`Translucency`](super::translucency::Translucency) and
//! [`SpotPaint`] use it.
//!
//! It looks at one ray in 8×8 pixels, from the picture's own [`Distances`] where its renderer has them; inks come from a field of the wall's
//! cells that is filled where somebody looks; and pixels keep their brightness, so that the shape stays visible.

mod field;
mod spots;
mod tint;

#[cfg(test)]
mod tests;

use std::array::from_fn;
use std::ops::Range;
use std::sync::Arc;

use fearless_simd::{Level, Simd, f32x16, prelude::*};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::distances::Distances;
use super::packets::directions::DirectionSource;
use super::packets::picture::on_level;
use super::{Frame, PreparedVolume, View, first_crossing};
use crate::volume::Volume;
use field::{CellField, Sum};
use tint::{Gains, ONE, STEP};

pub use spots::SpotPaint;

pub(crate) use field::{AT_ONCE, CellInks};

/// The part of a picture that is painted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PaintedArea {
    /// All of it.
    #[default]
    Whole,
    /// A circle.
    Lens {
        /// Its middle, pixels from the picture's top left corner.
        centre: [f32; 2],
        /// Its radius, pixels.
        radius: f32,
    },
}

/// A picture and what it was made from.
#[derive(Clone, Copy, Debug)]
pub struct Pictured<'a> {
    /// The volume whose wall it shows.
    pub volume: &'a PreparedVolume,
    /// The scan before it was cleansed, or a part of it on the same lattice; `None` if it was not cleansed.
    pub scanned: Option<&'a Arc<Volume>>,
    /// The camera and its pixels.
    pub view: &'a View,
    /// The distances that its renderer has found, if it keeps them. Rays are cast where they are not known.
    pub distances: Option<Distances<'a>>,
}

/// What the inks of rays belong to.
#[derive(Debug)]
struct Source {
    view: View,
    /// Pixels between two rays of known distance; 0 if all were cast.
    apart: f32,
}

/// How much of the picture's own colour inks cover.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cover {
    /// At most, 0 to 1.
    pub most: f32,
    /// From this share of inks with a full last number around a place on, out of [`Cover::ALL`]. Where the wall has inks everywhere there are
    /// about a third to all of it.
    pub full_at: f32,
}

impl Cover {
    /// All cells around a place have an ink with a full last number.
    pub(crate) const ALL: f32 = 255.0 * 256.0;
}

/// Paints the wall in pictures. Reuse it: it allocates only when its pictures become larger, and where nobody has looked before.
#[derive(Debug)]
pub(crate) struct WallPainter {
    field: CellField,
    /// The volumes that the field belongs to: that of the wall, and the one as scanned.
    volumes: [Option<Arc<Volume>>; 2],
    /// Inks and gains at the rays of the last picture.
    inks: Vec<Sum>,
    gains: Vec<Gains>,
    /// For each row of rays, the packets with inks that are not known yet: see [`bit`].
    waits: Vec<u64>,
    /// What all inks are of; `None` if they are not of the whole picture.
    source: Option<Source>,
    level: Level,
}

impl WallPainter {
    /// Creates one that has painted nothing.
    pub(crate) fn new(level: Level) -> Self {
        Self {
            field: CellField::default(),
            volumes: [None, None],
            inks: Vec::new(),
            gains: Vec::new(),
            waits: Vec::new(),
            source: None,
            level,
        }
    }

    /// Paints the wall in `area` of a picture, whose size is that of its view, with inks that cover it. Bytes are the same for every
    /// number of threads.
    pub(crate) fn paint(
        &mut self,
        of: Pictured<'_>,
        area: PaintedArea,
        (inks, cover): (&dyn CellInks, Cover),
        frame: &mut Frame,
    ) {
        let [width, height] = [frame.width(), frame.height()];
        if width == 0 || height == 0 || [width, height] != [of.view.width(), of.view.height()] {
            return;
        }
        let Some([columns, rows]) = part(area, [width, height]) else { return };
        self.belong_to(&of, inks);
        let [across, down] = [width, height].map(|n| n.div_ceil(STEP) + 1);
        let is_whole = area == PaintedArea::Whole;
        if !(is_whole && self.is_of(&of)) {
            self.inks.resize(across * down, [0; 4]);
            self.gains.resize(across * down, [ONE; 4]);
            self.waits.resize(down, 0);
            self.source = is_whole.then(|| Source::new(&of));
            self.waits.fill(u64::MAX);
        }
        // One more ray than blocks, to the right and below.
        let part = [&columns, &rows].map(|range| range.start / STEP..range.end.div_ceil(STEP) + 1);
        self.look(of, &part, (inks, cover), frame);
        let (gains, level) = (&self.gains, self.level);
        let bands = frame.buffers().0.par_chunks_mut(width * STEP).enumerate().with_max_len(1);
        let [_, lines] = part;
        bands.skip(lines.start).take(lines.len() - 1).for_each(|(band, pixels)| {
            let spans = from_fn(|n| {
                let y = band * STEP + n;
                if rows.contains(&y) { span(area, y, &columns) } else { [columns.start; 2] }
            });
            let lines = [0, 1].map(|n| &gains[(band + n) * across..][..across]);
            on_level!(level, simd => tint::band(simd, pixels, width, &spans, lines));
        });
    }

    /// Finds the inks of the rays in some columns and rows that wait for them, and the gains of all.
    fn look(
        &mut self,
        of: Pictured<'_>,
        [columns, rows]: &[Range<usize>; 2],
        (inks, cover): (&dyn CellInks, Cover),
        frame: &Frame,
    ) {
        let (eyes, level, pixels) = (Eyes::new(of), self.level, frame.pixels());
        let [width, height, across] = [frame.width(), frame.height(), frame.width().div_ceil(STEP) + 1];
        let mut is_first = true;
        loop {
            let field = &self.field;
            let lines = self.inks.par_chunks_mut(across).zip(self.gains.par_chunks_mut(across)).zip(&mut self.waits);
            let lines = lines.enumerate().with_max_len(1).skip(rows.start).take(rows.len());
            lines.for_each(|(row, ((line, gains), waits))| {
                let waited = std::mem::take(waits);
                if waited == 0 && !is_first {
                    return;
                }
                let pixels = &pixels[(row * STEP).min(height - 1) * width..][..width];
                on_level!(level, simd => {
                    for (n, first) in columns.clone().step_by(PACKET).enumerate() {
                        let packet = first..columns.end.min(first + PACKET);
                        if waited & bit(n) != 0 {
                            if !eyes.packet(simd, field, [first, row], &mut line[packet.clone()]) {
                                *waits |= bit(n);
                                continue;
                            }
                        } else if !is_first {
                            continue;
                        }
                        tint::find(simd, (line, cover), pixels, packet, gains);
                    }
                });
            });
            is_first = false;
            if !self.field.answer(of.volume, inks, level) {
                return;
            }
        }
    }

    /// Begins anew if the picture is of other volumes.
    fn belong_to(&mut self, of: &Pictured<'_>, inks: &dyn CellInks) {
        let [shown, scanned] = &self.volumes;
        let same = |a: &Option<Arc<Volume>>, b: Option<&Volume>| match (a, b) {
            (Some(a), Some(b)) => std::ptr::eq(&**a, b),
            (None, None) => true,
            _ => false,
        };
        if !same(shown, Some(of.volume.voxels())) || !same(scanned, of.scanned.map(|s| &**s)) {
            self.volumes = [Some(of.volume.shared_voxels()), of.scanned.cloned()];
            (self.field, self.source) = (CellField::new(of.volume.voxels(), inks), None);
        }
    }

    /// True if the inks are of this picture, and not coarser than they could be.
    fn is_of(&self, of: &Pictured<'_>) -> bool {
        let known = self.source.as_ref().filter(|s| s.view == *of.view);
        known.is_some_and(|s| s.apart <= STEP as f32 || of.distances.is_none_or(|d| d.pixels_apart() >= s.apart))
    }

    /// Returns the memory in use, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.field.bytes()
            + self.inks.len() * (size_of::<Sum>() + size_of::<Gains>())
            + self.waits.len() * size_of::<u64>()
    }
}

impl Source {
    fn new(of: &Pictured<'_>) -> Self {
        Self { view: of.view.clone(), apart: of.distances.map_or(0.0, |d| d.pixels_apart()) }
    }
}

/// Returns the bit of a row's packet. All after the last bit share it.
fn bit(packet: usize) -> u64 {
    1 << packet.min(63)
}

/// Returns the columns and rows of pixels that an area may reach; `None` if it has none.
fn part(area: PaintedArea, size: [usize; 2]) -> Option<[Range<usize>; 2]> {
    let PaintedArea::Lens { centre, radius } = area else { return Some(size.map(|n| 0..n)) };
    let range = |n: usize| {
        let low = (centre[n] - radius).floor().max(0.0) as usize;
        let high = (centre[n] + radius).ceil().max(0.0) as usize;
        low..high.min(size[n])
    };
    let all = [range(0), range(1)];
    // A radius that is not a number has no range either.
    (radius > 0.0 && all.iter().all(|r| !r.is_empty())).then_some(all)
}

/// Returns the first pixel of row `y` in an area, and the one after the last.
fn span(area: PaintedArea, y: usize, columns: &Range<usize>) -> [usize; 2] {
    let PaintedArea::Lens { centre, radius } = area else { return [columns.start, columns.end] };
    let down = y as f32 + 0.5 - centre[1];
    let half = (radius * radius - down * down).max(0.0).sqrt();
    // Pixels whose middles are within.
    let from = (centre[0] - half + 0.5).max(0.0) as usize;
    let to = (centre[0] + half + 0.5).max(0.0) as usize;
    [from.clamp(columns.start, columns.end), to.clamp(columns.start, columns.end)]
}

/// The rays of a picture at which inks are found.
struct Eyes<'a> {
    of: Pictured<'a>,
    directions: DirectionSource,
    /// The camera's voxel coordinates, counted from voxel −1.
    origin: Vec3,
    /// The distances of its rays; `None` if rays begin elsewhere than at the camera, or so far away that single precision does not do.
    distances: Option<Distances<'a>>,
}

/// Rays at once.
const PACKET: usize = 16;
/// Pixels from the first of them to each.
const APART: [f32; PACKET] = {
    let mut all = [0.0; PACKET];
    let mut n = 0;
    while n < PACKET {
        all[n] = (n * STEP) as f32;
        n += 1;
    }
    all
};

/// A camera farther away than this has its rays cast one by one, voxels.
const FAR: f64 = 1e4;

impl<'a> Eyes<'a> {
    fn new(of: Pictured<'a>) -> Self {
        let (view, grid) = (of.view, of.volume.voxels().grid());
        let to_voxel = grid.to_voxel().matrix3;
        let steps = [view.forward(), view.right(), view.up()].map(|d| (to_voxel * d).as_vec3());
        let origin = grid.voxel(view.position()) + DVec3::ONE;
        let is_near = origin.abs().max_element() < FAR && view.camera().origins() == super::Origins::One;
        Self {
            of,
            directions: DirectionSource::new(view, to_voxel, steps),
            origin: if is_near { origin.as_vec3() } else { Vec3::ZERO },
            distances: of.distances.filter(|_| is_near),
        }
    }

    /// Finds the inks at some rays of a row, from the ray `at` on. Returns false if some of them are not known yet.
    #[inline(never)]
    fn packet<S: Simd>(&self, simd: S, field: &CellField, at: [usize; 2], inks: &mut [Sum]) -> bool {
        let [x, y] = [0, 1].map(|a| (at[a] * STEP) as f32 + 0.5);
        let mut inverse = [f32::NAN; PACKET];
        let mut unit_mm = 1.0;
        if let Some(distances) = self.distances {
            distances.inverse_row([x, y], STEP as f32, &mut inverse[..inks.len()]);
            unit_mm = distances.unit_mm();
        }
        let mut all = true;
        simd.vectorize(
            #[inline(always)]
            || {
                let load = f32x16::load_array_ref;
                let apart = load(simd, &APART);
                let ray = self.directions.lanes(simd, apart + x, f32x16::splat(simd, y));
                let inverse = load(simd, &inverse);
                // 1 / 0 is infinite, and stays NaN what is not known.
                let mut q = ray.at_each(self.origin, f32x16::splat(simd, unit_mm) / inverse);
                // Of those after the last nobody asks.
                let is_known = inverse.simd_eq(inverse) | load(simd, &APART).simd_ge((inks.len() * STEP) as f32);
                if !is_known.all_true() {
                    let cast = self.cast_some(inverse.as_array(), [x, y], inks.len());
                    for (q, cast) in q.iter_mut().zip(&cast) {
                        *q = is_known.select(*q, load(simd, cast));
                    }
                }
                let (found, known) = field.at(simd, q, inks.len());
                inks.copy_from_slice(&found[..inks.len()]);
                all = known;
            },
        );
        all
    }

    /// Casts those of the first rays from the point (`x`, `y`) on whose distance is not known, and returns where they meet the wall.
    #[cold]
    #[inline(never)]
    fn cast_some(&self, inverse: &[f32; PACKET], [x, y]: [f32; 2], rays: usize) -> [[f32; PACKET]; 3] {
        let mut cast = [[f32::INFINITY; PACKET]; 3];
        for lane in 0..rays {
            if inverse[lane].is_nan()
                && let Some(place) = self.cast(x + (lane * STEP) as f32, y)
            {
                (0..3).for_each(|a| cast[a][lane] = place[a]);
            }
        }
        cast
    }

    /// Returns where the ray through a point of the picture meets the wall, in voxel coordinates counted from voxel −1.
    fn cast(&self, x: f32, y: f32) -> Option<Vec3> {
        let ray = self.of.view.ray_at(f64::from(x), f64::from(y))?;
        let mm = first_crossing(self.of.volume, ray.origin, ray.direction, f64::INFINITY)?;
        let grid = self.of.volume.voxels().grid();
        Some((grid.voxel(ray.origin + ray.direction * mm) + DVec3::ONE).as_vec3())
    }
}
