//! The place of a point in the colon: distance along its line, distance from it, and angle about it.

use std::array::from_fn;
use std::sync::Arc;

use fearless_simd::Level;
use glam::DVec3;

use super::Subject;
use super::angle::angle;
use super::band::Band;
use super::labels::Wall;
use super::lattice::Lattice;
use super::places::{moved, nth};
use crate::fields::Along;
use crate::fields::centerline::Centerline;
use crate::fields::frames::{Frame, STEP_MM, evenly, frames};
use crate::render::Sixteen;
use crate::volume::Grid;

/// The nearest point of the line is looked for within this of where the way through the lumen leads, mm along: in a bend, the inner wall's
/// is far from there.
const WINDOW_MM: f64 = 29.0;
/// Frames that are looked at together: at least those among which the nearest point of the line is.
const FRAMES: usize = 32;
const _: () = assert!(2.0 * (WINDOW_MM + NEAR_STEP_MM) / STEP_MM + 2.0 <= FRAMES as f64);
/// Steps in which that is remembered, mm.
const NEAR_STEP_MM: f64 = 0.5;

/// From a frame to the next: where it begins and the way, mm; 1/way², 1/mm²; the distance along the line as scanned and what it grows by,
/// mm; the tangents of both, and their normals.
type Step = [f64; 21];

/// Returns the way from a frame to the next, whose distances along the line are known, mm.
fn step([a, b]: [&Frame; 2], mm: [f64; 2]) -> Step {
    let way = b.at - a.at;
    let mut out = [0.0; 21];
    let parts = [a.at, way, DVec3::new(1.0 / way.length_squared().max(1e-12), mm[0], mm[1] - mm[0])];
    for (k, part) in parts.into_iter().chain([a.tangent, b.tangent, a.normal, b.normal]).enumerate() {
        out[3 * k..3 * k + 3].copy_from_slice(&part.to_array());
    }
    out
}

/// The line of a colon with frames that do not turn about it.
#[derive(Debug)]
pub struct Rings {
    along: Arc<Along>,
    /// Where places are along the line, in steps of [`NEAR_STEP_MM`] from 1; 0 for nowhere.
    known: Lattice,
    frames: Vec<Frame>,
    /// The sum of the directions to each frame and from it.
    bends: Vec<DVec3>,
    steps: Vec<Step>,
    /// x, y and z of the frames, and of as many beyond the last as are looked at together.
    at: [Vec<f32>; 3],
    /// Distance of each frame along the line as scanned, mm.
    mm: Vec<f64>,
    level: Level,
}

impl Rings {
    /// Creates them for the only line of a colon in a scan's grid; `None` if there is none.
    pub fn new(along: &Arc<Along>, grid: &Grid) -> Option<Self> {
        let line: &Centerline = along.only_line()?;
        let (even, mm) = evenly(&line.points);
        let frames = frames(&even);
        let beyond = [f32::INFINITY; FRAMES];
        let of = |axis: usize| frames.iter().map(|f| f.at[axis] as f32).chain(beyond).collect();
        let at = [of(0), of(1), of(2)];
        let way = |n: usize| frames.get(n + 1).map_or(DVec3::ZERO, |b| (b.at - frames[n].at).normalize_or_zero());
        let bends = (0..frames.len()).map(|n| n.checked_sub(1).map_or(DVec3::ZERO, way) + way(n)).collect();
        (frames.len() > 1 && frames.len() == mm.len()).then(|| Self {
            bends,
            steps: (1..frames.len()).map(|n| step([&frames[n - 1], &frames[n]], [mm[n - 1], mm[n]])).collect(),
            along: Arc::clone(along),
            known: Lattice::new(grid, 1),
            at,
            frames,
            mm,
            level: Level::new(),
        })
    }

    /// Returns the points of the line, world, mm, with the distance of each along it, mm.
    pub fn points(&self) -> impl Iterator<Item = (f64, &Frame)> {
        self.mm.iter().copied().zip(&self.frames)
    }

    /// Returns the distances along the line, mm, those from the line, mm, and the angles about it, radians from −π to π, of sixteen points
    /// (world, mm), each of which belongs to the lumen at a place in voxels; NaN for those that are not finite, or farther than 12 mm from
    /// the lumen. Angle 0 is towards the patient's front where the line begins.
    pub(super) fn sixteen(&self, places: &Sixteen, voxels: &Sixteen) -> Sixteen {
        fearless_simd::dispatch!(self.level, _simd => self.measure(places, voxels))
    }

    #[inline(always)]
    fn measure(&self, places: &Sixteen, voxels: &Sixteen) -> Sixteen {
        // A number of all sixteen steps at a time.
        let (mut steps, mut is_known) = ([[1.0; 16]; 21], [false; 16]);
        for k in 0..16 {
            let (place, voxel) = (DVec3::from_array(nth(places, k)), nth(voxels, k));
            let Some(step) = self.nearest(place, voxel).filter(|_| place.is_finite()) else { continue };
            is_known[k] = true;
            for (all, own) in steps.iter_mut().zip(&self.steps[step]) {
                all[k] = *own;
            }
        }
        let mut out = [[f64::NAN; 16]; 3];
        for k in 0..16 {
            let step = |n: usize| [steps[n][k], steps[n + 1][k], steps[n + 2][k]];
            let ([ax, ay, az], [wx, wy, wz], [inverse, mm, more]) = (step(0), step(3), step(6));
            let (x, y, z) = (places[0][k] - ax, places[1][k] - ay, places[2][k] - az);
            // The nearest point of the step.
            let share = ((x * wx + y * wy + z * wz) * inverse).clamp(0.0, 1.0);
            let (x, y, z) = (x - wx * share, y - wy * share, z - wz * share);
            let between = |n: usize| steps[n][k] + (steps[n + 3][k] - steps[n][k]) * share;
            let [tx, ty, tz] = [between(9), between(10), between(11)];
            let [nx, ny, nz] = [between(15), between(16), between(17)];
            let square = tx * tx + ty * ty + tz * tz;
            let tilt = (nx * tx + ny * ty + nz * tz) / square;
            let [nx, ny, nz] = [nx - tx * tilt, ny - ty * tilt, nz - tz * tilt];
            // Both as long as the tangent: only their ratio matters.
            let right = (x * nx + y * ny + z * nz) * square.sqrt();
            let up = x * (ty * nz - tz * ny) + y * (tz * nx - tx * nz) + z * (tx * ny - ty * nx);
            let none = |x: f64| if is_known[k] { x } else { f64::NAN };
            out[0][k] = none(mm + more * share);
            out[1][k] = none((x * x + y * y + z * z).sqrt());
            out[2][k] = none(angle(up, right));
        }
        out
    }

    /// Returns the step on which the nearest point of the line lies.
    #[inline(always)]
    fn nearest(&self, place: DVec3, voxel: [f64; 3]) -> Option<usize> {
        let mut steps =
            |place| self.along.about(place).map_or(0, |mm| (mm / NEAR_STEP_MM).clamp(0.0, 65_000.0) as u16 + 1);
        let about = f64::from(self.known.label(place, voxel, &mut steps).checked_sub(1)?) * NEAR_STEP_MM;
        // The frames are evenly spaced.
        let frame = |mm: f64| mm.max(0.0) / STEP_MM;
        let last = (frame(about + WINDOW_MM) as usize + 1).clamp(2, self.frames.len());
        let first = (frame(about - WINDOW_MM).ceil() as usize).min(last - 2);
        // Squares that are not negative are in the order of their bits. The last five give way to the number.
        let [x, y, z] = place.as_vec3().to_array();
        let [xs, ys, zs] = [0, 1, 2].map(|axis| &self.at[axis][first..first + FRAMES]);
        let mut least = u32::MAX;
        for k in 0..FRAMES {
            let (x, y, z) = (xs[k] - x, ys[k] - y, zs[k] - z);
            let square = ((x * x + y * y + z * z).to_bits() & !31) | k as u32;
            least = least.min(if k < last - first { square } else { u32::MAX });
        }
        let nearest = first + (least & 31) as usize;
        // Of the two steps that meet there, the one to whose side of the bend the place lies is nearer, or both are as near.
        let is_before = (place - self.frames[nearest].at).dot(self.bends[nearest]) < 0.0;
        Some(nearest.saturating_sub(usize::from(is_before)).min(self.steps.len() - 1))
    }
}

impl Band<'_> {
    /// Finds what the wall of each pixel belongs to, and where it is in the colon.
    pub(super) fn anatomy(&mut self, subject: &Subject<'_>) {
        if self.labels.is_empty() && self.along.is_empty() {
            return;
        }
        let grid = subject.volume.voxels().grid();
        // The middle of the cube around a place that far from the wall is on the same side of the wall.
        let (to_voxel, into_gas) = (grid.to_voxel(), 0.5 * grid.spacing().length());
        let level = Level::new();
        for square in 0..self.squares() {
            let square = self.square(square);
            let (mut places, mut normals) = ([[f64::NAN; 16]; 3], [[0.0; 3]; 16]);
            for (k, n) in square.pixels() {
                let Some(crossing) = &self.crossings[n] else { continue };
                // What is not deformed is known better.
                let at = if subject.tissue.is_some() { crossing.tissue.as_dvec3() } else { crossing.place };
                (places[0][k], places[1][k], places[2][k]) = at.into();
                normals[k] = self.facing[n];
            }
            let (voxels, before) = fearless_simd::dispatch!(level, _simd => {
                (moved(to_voxel, &places, &normals, 0.0), moved(to_voxel, &places, &normals, into_gas))
            });
            let along = subject.rings.map_or([[f64::NAN; 16]; 3], |rings| rings.sixteen(&places, &before));
            square.store(self.along, &from_fn(|k| nth(&along, k).map(|x| x as f32)));
            if !self.labels.is_empty() {
                let wall = Wall { places, voxels, normals, along: along[0] };
                square.store(self.labels, &subject.labels.map_or([[0; 2]; 16], |all| all.sixteen(&wall, level)));
            }
        }
    }
}
