//! Which lamps the wall hides from its points.

use glam::DVec3;
use rayon::prelude::*;

use super::Look;
use crate::dataset::truth::Crossing;
use crate::render::View;
use crate::space::PreparedVolume;
use crate::space::ray::Bundle;

/// Side of the squares of pixels that are looked at together.
const SIDE: usize = 8;
/// A lamp lights a point if its ray meets the wall at most this much before it, mm: pictures need no more.
const SAME_MM: f64 = 0.05;

/// Returns for each pixel which lamps are hidden from its point of the wall, a bit each.
pub(super) fn dark(look: &Look, volume: &PreparedVolume, view: &View, found: &[Option<Crossing>]) -> Vec<u8> {
    let width = view.width().max(1);
    let lamps: Vec<DVec3> =
        look.lights_mm.iter().take(8).map(|[x, y]| view.position() + view.right() * *x + view.up() * *y).collect();
    let mut dark = vec![0; found.len()];
    dark.par_chunks_mut(SIDE * width).zip(found.par_chunks(SIDE * width)).for_each(|(dark, found)| {
        let mut rays: Vec<(usize, DVec3, f64)> = Vec::with_capacity(SIDE * SIDE);
        for left in (0..width).step_by(SIDE) {
            for (bit, lamp) in lamps.iter().enumerate() {
                rays.clear();
                for y in 0..found.len() / width {
                    let row = y * width + left..y * width + (left + SIDE).min(width);
                    for (n, crossing) in row.clone().zip(&found[row]) {
                        let Some(crossing) = crossing else { continue };
                        let way = crossing.place - *lamp;
                        let mm = way.length();
                        // What faces away is dark without a shadow.
                        if mm > SAME_MM && crossing.smooth.as_dvec3().dot(way) < 0.0 {
                            rays.push((n, way / mm, mm));
                        }
                    }
                }
                let bundle = Bundle::new(volume, rays.iter().map(|r| (*lamp, r.1)));
                for &(n, direction, mm) in &rays {
                    let is_lit = bundle.first_crossing((*lamp, direction)).is_none_or(|met| met >= mm - SAME_MM);
                    dark[n] |= u8::from(!is_lit) << bit;
                }
            }
        }
    });
    dark
}
