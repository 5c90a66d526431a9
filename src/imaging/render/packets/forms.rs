//! The directions of sixteen rays of a camera with a [`Form`]: lenses by their tables, panoramas by sines and cosines.

use std::f64::consts::TAU;

use fearless_simd::{Simd, f32x16, prelude::*};
use glam::{DVec2, DVec3, Vec2, Vec3};

use crate::render::camera::form::{PIECES, Piece, Profile};
use crate::render::camera::panorama::RADIANS;
use crate::render::camera::{Form, View};

/// A camera's form, in single precision.
pub(crate) struct FormLanes {
    /// The steps along forward, right and up, voxels, and the same as world directions.
    step: [Vec3; 3],
    world: [Vec3; 3],
    kind: Kind,
}

enum Kind {
    Lens {
        pieces: Box<[Piece]>,
        /// The position in the lens's plane of the picture's first corner, and its change per pixel along x and y.
        plane: Affine,
        /// Pieces per radius.
        per_radius: f32,
    },
    Panorama {
        /// Longitude and latitude, in turns.
        turns: Affine,
    },
}

/// The pixel that is mapped to 0, and how what it is mapped to changes per pixel along x and y.
struct Affine {
    zero: Vec2,
    across: Vec2,
    down: Vec2,
}

impl Affine {
    /// Creates the map of a view's pixels by which the image point `zero` becomes 0, and the unit vectors of image points `axes`.
    fn new(view: &View, zero: DVec2, axes: [DVec2; 2]) -> Self {
        let (unit, [x, y]) = (view.unit(), view.centre());
        // Image points run upwards, pixels run down.
        let down = DVec2::new(1.0, -1.0);
        Self {
            zero: (DVec2::new(x, y) + zero * down / unit).as_vec2(),
            across: (axes[0] * unit.x).as_vec2(),
            down: (axes[1] * -unit.y).as_vec2(),
        }
    }

    #[inline(always)]
    fn at<S: Simd>(&self, x: f32x16<S>, y: f32x16<S>) -> [f32x16<S>; 2] {
        let (x, y) = (x - self.zero.x, y - self.zero.y);
        [x * self.across.x + y * self.down.x, x * self.across.y + y * self.down.y]
    }
}

impl FormLanes {
    /// Creates the form of a view's camera; `None` if it has none. `step` holds the steps for forward, right and up.
    pub(super) fn new(view: &View, step: [Vec3; 3]) -> Option<Self> {
        let world = [view.forward(), view.right(), view.up()].map(DVec3::as_vec3);
        let kind = match view.camera().form()? {
            Form::Lens(profile) => {
                let Profile { plane, reach, pieces } = profile;
                Kind::Lens {
                    pieces: pieces.clone().into(),
                    plane: Affine::new(view, plane.centre, [plane.to_plane.x_axis, plane.to_plane.y_axis]),
                    per_radius: (PIECES as f64 / reach) as f32,
                }
            }
            Form::Panorama => {
                let turns = RADIANS / TAU;
                Kind::Panorama { turns: Affine::new(view, DVec2::ZERO, [DVec2::X * turns, DVec2::Y * turns]) }
            }
        };
        Some(Self { step, world, kind })
    }

    /// Returns the steps (voxels) and the world directions of the rays through the points (`x`, `y`) of the picture, pixels; `None` if one
    /// of them is beyond the table.
    #[inline(always)]
    pub(super) fn lanes<S: Simd>(&self, simd: S, x: f32x16<S>, y: f32x16<S>) -> Option<[[f32x16<S>; 3]; 2]> {
        let local = match &self.kind {
            Kind::Lens { pieces, plane, per_radius } => {
                let [u, v] = plane.at(x, y);
                let place = (u * u + v * v).sqrt() * *per_radius;
                let within = place.simd_lt(PIECES as f32);
                if (!within).to_bitmask() != 0 {
                    return None;
                }
                let first = place.floor();
                let [sine, cosine] = cubics(simd, pieces, first, place - first);
                [u * sine, v * sine, cosine]
            }
            Kind::Panorama { turns } => {
                let [longitude, latitude] = turns.at(x, y);
                let ([across, ahead], [up, level]) =
                    (sine_and_cosine(simd, longitude), sine_and_cosine(simd, latitude));
                [level * across, up, level * ahead]
            }
        };
        Some([turn(self.step, local), turn(self.world, local)])
    }
}

/// Turns directions in the camera's frame (right, up, forward) by the vectors for forward, right and up.
#[inline(always)]
fn turn<S: Simd>([f, r, t]: [Vec3; 3], [x, y, z]: [f32x16<S>; 3]) -> [f32x16<S>; 3] {
    [x * r.x + y * t.x + z * f.x, x * r.y + y * t.y + z * f.y, x * r.z + y * t.z + z * f.z]
}

/// Returns both cubics of the pieces `first` at the places `t` in them.
#[inline(always)]
fn cubics<S: Simd>(simd: S, pieces: &[Piece], first: f32x16<S>, t: f32x16<S>) -> [f32x16<S>; 2] {
    let mut c = [[[0.0; 16]; 4]; 2];
    for (lane, first) in first.to_array().into_iter().enumerate() {
        let piece = &pieces[(first as usize).min(PIECES - 1)];
        for (all, piece) in c.iter_mut().zip(piece) {
            for (all, c) in all.iter_mut().zip(piece) {
                all[lane] = *c;
            }
        }
    }
    // Not with closures: they do not inherit the level's instructions.
    let [a, b] = &c;
    [cubic(simd, a, t), cubic(simd, b, t)]
}

#[inline(always)]
fn cubic<S: Simd>(simd: S, [a, b, c, d]: &[[f32; 16]; 4], t: f32x16<S>) -> f32x16<S> {
    let load = f32x16::load_array_ref;
    ((load(simd, d) * t + load(simd, c)) * t + load(simd, b)) * t + load(simd, a)
}

/// Coefficients of sin πx/x and cos πx as polynomials of x², from their series. On −1/4 to 1/4 these terms leave less than 1e-9.
const SINE: [f32; 5] = [std::f32::consts::PI, -5.167_712_8, 2.550_164, -0.599_264_5, 0.082_145_89];
const COSINE: [f32; 6] = [1.0, -4.934_802, 4.058_712, -1.335_262_8, 0.235_330_63, -0.025_806_89];

/// Returns the sine and the cosine of angles in turns.
#[inline(always)]
fn sine_and_cosine<S: Simd>(simd: S, turns: f32x16<S>) -> [f32x16<S>; 2] {
    // In half turns from the nearest whole one: −1 to 1. A quarter of it is within −1/4 to 1/4, and its angle is doubled twice.
    let x = (turns - (turns + 0.5).floor()) * 0.5;
    let square = x * x;
    let (mut s, mut c) = (f32x16::splat(simd, SINE[4]), f32x16::splat(simd, COSINE[5]));
    for n in (0..4).rev() {
        s = s * square + SINE[n];
    }
    for n in (0..5).rev() {
        c = c * square + COSINE[n];
    }
    let s = s * x;
    let (s, c) = (s * c * 2.0, (c - s) * (c + s));
    [s * c * 2.0, (c - s) * (c + s)]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::math::hash;
    use crate::render::camera::fisheye::{equidistant, kannala_brandt};
    use crate::render::camera::scaramuzza::scaramuzza;
    use crate::render::camera::{Camera, Panorama, Pixels};
    use crate::render::packets::directions::DirectionSource;
    use crate::render::packets::levels;

    /// On every level, rays are those of the camera in single precision: also beyond the picture, where corners of blocks are.
    #[test]
    fn lanes_are_the_cameras_rays() {
        let size = [360, 180];
        let pixels = Pixels { size, centre: [170.0, 95.0] };
        let cameras: [Arc<dyn Camera>; 5] = [
            Arc::new(equidistant(180.0, 2.0).unwrap()),
            Arc::new(equidistant(220.0, 2.0).unwrap()),
            Arc::new(kannala_brandt(pixels, [90.0, 80.0], [0.05, 0.01, 0.0, 0.0]).unwrap()),
            Arc::new(scaramuzza(pixels, [120.0, -1e-3, 0.0, 0.0], [1.0, 0.01, -0.02]).unwrap()),
            Arc::new(Panorama),
        ];
        for camera in cameras {
            assert!(camera.form().is_some(), "{camera:?}");
            let whole =
                View::with_camera(DVec3::ZERO, DVec3::new(0.3, 0.9, 0.1), DVec3::Z, camera, size[0], size[1]).unwrap();
            for view in [whole.resized(180, 90), whole.strip(40..120, [0.3, -0.4]), whole] {
                let per_step = [view.forward(), view.right(), view.up()].map(|d| (d * 2.0).as_vec3());
                let source = DirectionSource::new(&view, DMat3::from_diagonal(DVec3::splat(2.0)), per_step);
                for n in 0..100 {
                    let at = |a: u64| -> [f32; 16] {
                        let side = [view.width(), view.height()][a as usize] as f64;
                        std::array::from_fn(|lane| ((hash::uniform(n * 16 + lane as u64, a) * 1.2 - 0.1) * side) as f32)
                    };
                    let (x, y) = (at(0), at(1));
                    for (name, level) in levels() {
                        let (along, world, shown) = fearless_simd::dispatch!(level, simd => {
                            let load = |v| f32x16::load_array_ref(simd, v);
                            let found = source.lanes(simd, load(&x), load(&y));
                            (found.along.map(|v| v.to_array()), found.world.map(|v| v.to_array()), found.shown.to_bitmask())
                        });
                        for lane in 0..16 {
                            let ray = view.ray_at(f64::from(x[lane]), f64::from(y[lane]));
                            assert_eq!(ray.is_some(), shown >> lane & 1 == 1);
                            let Some(ray) = ray else { continue };
                            let [a, w] = [along, world].map(|v| DVec3::from_array(v.map(|c| f64::from(c[lane]))));
                            let error = (w - ray.direction).length().max(0.5 * (a - ray.direction * 2.0).length());
                            assert!(error < 1e-6, "{name}: {:?} at {} {}: {error}", view.camera(), x[lane], y[lane]);
                        }
                    }
                }
            }
        }
    }
}
