//! Where the rays of a view cross the wall.

use std::array::from_fn;

use glam::{DVec3, Vec3};

use super::band::{Band, Eyes, Square};
use super::places::nth;
use super::{Crossing, Subject};
use crate::render::leap::{Bundles, Facing};
use crate::render::{Sixteen, View};

/// Squares whose common way is looked for together.
const TOGETHER: usize = 16;

/// Returns how far the cameras of the frames before and after are away along any axis, voxels: a ray from there to a point seen from here is
/// nowhere farther from the ray from here. `None` where the colon moves.
fn margins(subject: &Subject<'_>, eyes: &Eyes<'_>) -> [Option<f64>; 2] {
    let grid = subject.volume.voxels().grid();
    [0, 1].map(|k| {
        let (other, eye) = (subject.neighbours[k].as_ref()?, eyes.near[k].as_ref()?);
        let apart = (grid.voxel(eye.origin()) - grid.voxel(eyes.own.origin())).abs().max_element();
        Some(apart).filter(|apart| other.moved.is_none() && apart.is_finite())
    })
}

impl Band<'_> {
    /// Finds where each pixel's ray crosses the wall, and what follows from that: nowhere if the camera is in the wall.
    pub(super) fn cross(&mut self, subject: &Subject<'_>, eyes: &Eyes<'_>) {
        self.facing = vec![[f32::NAN; 3]; self.crossings.len()];
        self.clear = [0, 1].map(|_| vec![0.0; self.squares()]);
        let margins = margins(subject, eyes);
        for first in (0..self.squares()).step_by(TOGETHER) {
            let group = first..(first + TOGETHER).min(self.squares());
            let (mut bundles, mut aimed) = (Bundles::default(), [None; TOGETHER]);
            for (n, square) in group.clone().enumerate() {
                let square = self.square(square);
                aimed[n] = fearless_simd::dispatch!(eyes.level, _simd => subject.view.directions(&square.at));
                if let Some(directions) = &aimed[n] {
                    eyes.own.bundle(&mut bundles, n, directions);
                }
            }
            let clear = eyes.own.clear(&bundles, 0.0);
            for (k, margin) in margins.iter().enumerate() {
                if let Some(margin) = margin {
                    self.clear[k][group.clone()].copy_from_slice(&eyes.own.clear(&bundles, *margin)[..group.len()]);
                }
            }
            for (n, square) in group.enumerate() {
                let square = self.square(square);
                match &aimed[n] {
                    Some(directions) => self.cross_square(subject, eyes, &square, (directions, clear[n])),
                    None => self.cross_alone(subject, eyes, &square),
                }
            }
        }
    }

    /// Traces the rays of a square, along directions before whose beginnings there is no wall, mm.
    fn cross_square(
        &mut self,
        subject: &Subject<'_>,
        eyes: &Eyes<'_>,
        square: &Square,
        (directions, begin): (&Sixteen, f64),
    ) {
        let ends = from_fn(|k| if directions[0][k].is_nan() { 0.0 } else { f64::INFINITY });
        let mm = eyes.own.sixteen(directions, &[begin; 16], &ends);
        let facing = eyes.own.facing(directions, &mm);
        let met = Met { from: eyes.own.origin().to_array().map(|x| [x; 16]), directions: *directions, mm, facing };
        self.tell(subject, eyes, square, &met);
    }

    /// Traces rays one by one that do not begin at the camera, as other cameras may have them.
    fn cross_alone(&mut self, subject: &Subject<'_>, eyes: &Eyes<'_>, square: &Square) {
        let mut met = Met::default();
        for (k, _) in square.pixels() {
            let Some(ray) = subject.view.ray_at(square.at[0][k], square.at[1][k]) else { continue };
            let from = subject.rays.from(ray.origin);
            met.mm[k] = from.first(ray.direction).unwrap_or(f64::INFINITY);
            let facing = from.facing(&ray.direction.to_array().map(|d| [d; 16]), &[met.mm[k]; 16]);
            for a in 0..3 {
                (met.from[a][k], met.directions[a][k]) = (ray.origin[a], ray.direction[a]);
                (met.facing.normal[a][k], met.facing.smooth[a][k]) = (facing.normal[a][k], facing.smooth[a][k]);
            }
        }
        self.tell(subject, eyes, square, &met);
    }

    /// Keeps what the rays of a square meet, and what follows from that alone.
    fn tell(&mut self, subject: &Subject<'_>, eyes: &Eyes<'_>, square: &Square, met: &Met) {
        let told = fearless_simd::dispatch!(eyes.level, _simd => Told::new(subject.view, met));
        square.store(&mut self.facing, &told.normals);
        square.store(self.depth, &told.depth);
        square.store(self.z, &told.z);
        square.store(self.normals, &told.normals);
        square.store(self.shading, &told.shading);
        for (k, n) in square.pixels() {
            self.crossings[n] = told.is_met[k].then(|| {
                let place = DVec3::from_array(nth(&told.place, k));
                let tissue = subject.tissue.map_or(place, |of| of(place)).as_vec3();
                Crossing { mm: met.mm[k], place, tissue, smooth: Vec3::from_array(nth(&met.facing.smooth, k)) }
            });
        }
    }
}

/// Where sixteen rays meet the wall, and how it faces them.
struct Met {
    from: Sixteen,
    directions: Sixteen,
    /// Distances along the rays, mm; infinite where there is no wall.
    mm: [f64; 16],
    facing: Facing,
}

impl Default for Met {
    fn default() -> Self {
        let none = [[f32::NAN; 16]; 3];
        let facing = Facing { normal: none, smooth: none };
        Self { from: [[f64::NAN; 16]; 3], directions: [[f64::NAN; 16]; 3], mm: [f64::INFINITY; 16], facing }
    }
}

/// What follows from that.
struct Told {
    is_met: [bool; 16],
    place: Sixteen,
    depth: [f32; 16],
    z: [f32; 16],
    shading: [f32; 16],
    normals: [[f32; 3]; 16],
}

impl Told {
    #[inline(always)]
    fn new(view: &View, met: &Met) -> Self {
        let (eye, forward) = (view.position(), view.forward());
        let Met { from, directions, mm, facing: Facing { normal, smooth } } = met;
        let mut out = Self {
            is_met: [false; 16],
            place: [[0.0; 16]; 3],
            depth: [f32::INFINITY; 16],
            z: [f32::INFINITY; 16],
            shading: [0.0; 16],
            normals: from_fn(|k| nth(normal, k)),
        };
        for k in 0..16 {
            let along = |a: usize| from[a][k] + directions[a][k] * mm[k];
            let [x, y, z] = [along(0), along(1), along(2)];
            (out.place[0][k], out.place[1][k], out.place[2][k]) = (x, y, z);
            let [x, y, z] = [x - eye.x, y - eye.y, z - eye.z];
            let square = x * x + y * y + z * z;
            let (nx, ny, nz) = (f64::from(smooth[0][k]), f64::from(smooth[1][k]), f64::from(smooth[2][k]));
            // Of a lamp at the camera: cos/r².
            let light = -(x * nx + y * ny + z * nz) / (square.sqrt() * square);
            let is_met = mm[k] < f64::INFINITY && (normal[0][k] + normal[1][k] + normal[2][k]).abs() < f32::INFINITY;
            out.is_met[k] = is_met;
            out.depth[k] = if is_met { mm[k] as f32 } else { f32::INFINITY };
            out.z[k] = if is_met { (x * forward.x + y * forward.y + z * forward.z) as f32 } else { f32::INFINITY };
            out.shading[k] = if is_met && light > 0.0 { light as f32 } else { 0.0 };
        }
        out
    }
}
