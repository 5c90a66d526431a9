//! Where the rays of a view cross the wall.

use std::array::from_fn;

use glam::{DVec3, Vec3};

use super::band::{Band, Eyes, Square, set};
use super::{Crossing, Subject};
use crate::render::CameraRay;
use crate::render::leap::Facing;

impl Band<'_> {
    /// Finds where each pixel's ray crosses the wall, and what follows from that: nowhere if the camera is in the wall.
    pub(super) fn cross(&mut self, subject: &Subject<'_>, eyes: &Eyes<'_>) {
        self.facing = vec![Vec3::NAN; self.crossings.len()];
        for square in 0..self.squares() {
            let square = self.square(square);
            let aimed = fearless_simd::dispatch!(eyes.level, _simd => subject.view.directions(&square.at));
            let Some(directions) = aimed else {
                self.cross_alone(subject, &square);
                continue;
            };
            let ends = from_fn(|k| if directions[0][k].is_nan() { 0.0 } else { f64::INFINITY });
            let mm = eyes.own.sixteen(&directions, &ends);
            let facing = eyes.own.facing(&directions, &mm);
            for (k, n) in square.pixels.into_iter().enumerate() {
                let Some(n) = n else { continue };
                let ray =
                    CameraRay { origin: eyes.own.origin(), direction: DVec3::from_array(directions.map(|d| d[k])) };
                self.keep(subject, n, (ray, mm[k]), &facing, k);
            }
        }
    }

    /// Traces rays one by one that do not begin at the camera, as other cameras may have them.
    fn cross_alone(&mut self, subject: &Subject<'_>, square: &Square) {
        for (k, n) in square.pixels.into_iter().enumerate() {
            let Some(n) = n else { continue };
            self.crossings[n] = None;
            let Some(ray) = subject.view.ray_at(square.at[0][k], square.at[1][k]) else {
                self.tell(subject, n);
                continue;
            };
            let from = subject.rays.from(ray.origin);
            let mm = from.first(ray.direction).unwrap_or(f64::INFINITY);
            let facing = from.facing(&ray.direction.to_array().map(|d| [d; 16]), &[mm; 16]);
            self.keep(subject, n, (ray, mm), &facing, k);
        }
    }

    /// Keeps the crossing of a pixel's ray, if it has one, and what follows from it.
    #[inline(always)]
    fn keep(&mut self, subject: &Subject<'_>, n: usize, (ray, mm): (CameraRay, f64), facing: &Facing, k: usize) {
        let [normal, smooth] = [&facing.normal, &facing.smooth].map(|all| Vec3::from_array(all.map(|c| c[k])));
        self.facing[n] = normal;
        self.crossings[n] = (mm.is_finite() && normal.is_finite()).then(|| {
            let place = ray.origin + ray.direction * mm;
            let tissue = subject.tissue.map_or(place, |of| of(place)).as_vec3();
            Crossing { mm, place, tissue, smooth }
        });
        self.tell(subject, n);
    }

    /// Fills in what follows from a pixel's crossing alone.
    fn tell(&mut self, subject: &Subject<'_>, n: usize) {
        let (found, facing) = (&self.crossings[n], self.facing[n]);
        let (eye, forward) = (subject.view.position(), subject.view.forward());
        set(self.depth, n, || found.map_or(f32::INFINITY, |c| c.mm as f32));
        set(self.z, n, || found.map_or(f32::INFINITY, |c| (c.place - eye).dot(forward) as f32));
        set(self.normals, n, || facing.to_array());
        set(self.shading, n, || found.map_or(0.0, |c| c.headlight(eye) as f32));
    }
}
