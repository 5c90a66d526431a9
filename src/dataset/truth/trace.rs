//! Where the rays of a view cross the wall.

use std::array::from_fn;

use glam::Vec3;

use super::band::{Band, Eyes, set};
use super::{Crossing, Subject};
use crate::render::CameraRay;
use crate::render::leap::Directions;

impl Band<'_> {
    /// Finds where each pixel's ray crosses the wall, and what follows from that: nowhere if the camera is in the wall.
    pub(super) fn cross(&mut self, subject: &Subject<'_>, eyes: &Eyes<'_>) {
        self.facing = vec![Vec3::NAN; self.crossings.len()];
        for square in self.squares() {
            let ray = |n: usize| subject.view.ray(n % self.width, self.top + n / self.width);
            let rays: [Option<CameraRay>; 16] = from_fn(|k| ray(square[k]?));
            let is_own = |ray: &CameraRay| ray.origin == subject.view.position();
            let directions: Directions = from_fn(|a| from_fn(|k| rays[k].map_or(0.0, |ray| ray.direction[a])));
            let ends = from_fn(|k| if rays[k].as_ref().is_some_and(is_own) { f64::INFINITY } else { 0.0 });
            let mut mm = eyes.own.sixteen(&directions, &ends);
            let mut facing = eyes.own.facing(&directions, &mm);
            // Rays that do not begin at the camera, as other cameras may have them, are traced one by one.
            for (k, ray) in rays.iter().enumerate() {
                let Some(ray) = ray.filter(|r| !is_own(r)) else { continue };
                let from = subject.rays.from(ray.origin);
                mm[k] = from.first(ray.direction).unwrap_or(f64::INFINITY);
                let own = from.facing(&directions, &from_fn(|n| if n == k { mm[k] } else { f64::INFINITY }));
                for a in 0..3 {
                    (facing.normal[a][k], facing.smooth[a][k]) = (own.normal[a][k], own.smooth[a][k]);
                }
            }
            for (k, n) in square.into_iter().enumerate() {
                let Some(n) = n else { continue };
                let [normal, smooth] = [&facing.normal, &facing.smooth].map(|all| Vec3::from_array(all.map(|c| c[k])));
                let found = rays[k].filter(|_| mm[k].is_finite() && normal.is_finite()).map(|ray| {
                    let place = ray.origin + ray.direction * mm[k];
                    let tissue = subject.tissue.map_or(place, |of| of(place)).as_vec3();
                    self.facing[n] = normal;
                    Crossing { mm: mm[k], place, tissue, smooth }
                });
                self.crossings[n] = found;
                self.tell(subject, n);
            }
        }
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
