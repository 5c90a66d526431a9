//! The directions of sixteen rays, and the cells they are in.

use std::array::from_fn;

use fearless_simd::{Simd, f32x16, i32x16, mask32x16, prelude::*};
use glam::{DMat3, DVec3, Vec3};

use super::beam::Beam;
use super::forms::FormLanes;
use crate::render::camera::View;

/// How directions are found.
pub(crate) enum DirectionSource {
    /// From a plane at distance 1 in front of a perspective camera.
    Perspective {
        /// The step along the viewing axis, and its change along the picture's right and up directions, voxels.
        step: [Vec3; 3],
        /// The same as world directions.
        world: [Vec3; 3],
        /// Side of a pixel at distance 1.
        pixel: f32,
        centre: [f32; 2],
    },
    /// From the camera model: by its form, or else ray by ray.
    Any {
        view: Box<View>,
        /// Turns a world direction into a step, voxels.
        to_step: DMat3,
        /// [`View::pixel_turn`].
        turn: Option<f32>,
        /// Computes sixteen rays at once, if the camera has a form.
        form: Option<Box<FormLanes>>,
    },
}

/// The directions of sixteen rays.
pub(crate) struct Directions<S: Simd> {
    /// A step along each axis, voxels.
    pub along: [f32x16<S>; 3],
    /// World directions, of unit length.
    pub world: [f32x16<S>; 3],
    /// Rays for which the camera shows something. The others follow one of these, or point anywhere.
    pub shown: mask32x16<S>,
}

impl<S: Simd> Directions<S> {
    /// Returns the rays' positions `k` steps from `origin`.
    #[inline(always)]
    pub(crate) fn at(&self, origin: Vec3, k: f32) -> [f32x16<S>; 3] {
        let [x, y, z] = self.along;
        [x * k + origin.x, y * k + origin.y, z * k + origin.z]
    }

    /// Like [`Directions::at`], but each ray has its own `k`.
    #[inline(always)]
    pub(crate) fn at_each(&self, origin: Vec3, k: f32x16<S>) -> [f32x16<S>; 3] {
        let [x, y, z] = self.along;
        [x * k + origin.x, y * k + origin.y, z * k + origin.z]
    }

    /// Returns the bundle of these rays and of all whose steps differ from theirs by up to `margin`, voxels.
    #[inline(always)]
    pub(crate) fn beam(&self, origin: Vec3, margin: f32) -> Beam {
        let [x, y, z] = self.along;
        let low = Vec3::new(x.reduce_min(), y.reduce_min(), z.reduce_min());
        let high = Vec3::new(x.reduce_max(), y.reduce_max(), z.reduce_max());
        Beam::new(origin, low - margin, high + margin)
    }
}

impl DirectionSource {
    /// Creates the source for `view`. `to_step` turns world directions into steps in voxels; `step` holds the steps for
    /// forward, right and up.
    pub(crate) fn new(view: &View, to_step: DMat3, step: [Vec3; 3]) -> Self {
        match view.pixel() {
            Some(pixel) => Self::Perspective {
                step,
                world: [view.forward(), view.right(), view.up()].map(DVec3::as_vec3),
                pixel: pixel as f32,
                centre: view.centre().map(|c| c as f32),
            },
            None => Self::Any {
                view: Box::new(view.clone()),
                to_step,
                turn: view.pixel_turn().map(|turn| turn as f32),
                form: FormLanes::new(view, step).map(Box::new),
            },
        }
    }

    /// Returns by how much unit directions of neighbouring pixels differ at most; `None` if unknown.
    pub(crate) fn pixel_turn(&self) -> Option<f32> {
        match self {
            Self::Perspective { pixel, .. } => Some(*pixel),
            Self::Any { turn, .. } => *turn,
        }
    }

    /// Returns by how much the direction of any ray within a rectangle may deviate from those of sixteen rays, as a
    /// length relative to unit directions; `None` if unknown.
    ///
    /// The sixteen rays form rows that reach to the rectangle's edges, with `apart` pixels between neighbours.
    #[inline(always)]
    pub(crate) fn margin<S: Simd>(&self, ray: &Directions<S>, apart: [f32; 2]) -> Option<f32> {
        match self {
            // Between two rays at an angle δ, a direction bulges by δ²/8 at most, along two axes of the picture.
            Self::Perspective { pixel, .. } => {
                let angle = (apart[0].max(apart[1]) * pixel).min(2.0);
                Some(0.5 * angle * angle)
            }
            // No direction is farther from one of the sixteen than the middle of four of them is.
            Self::Any { turn: Some(turn), .. } if (!ray.shown).to_bitmask() == 0 => {
                Some(0.5 * apart[0].hypot(apart[1]) * turn)
            }
            Self::Any { .. } => None,
        }
    }

    /// Returns the rays through the points (`x`, `y`) of the picture, pixels.
    #[inline(always)]
    pub(crate) fn lanes<S: Simd>(&self, simd: S, x: f32x16<S>, y: f32x16<S>) -> Directions<S> {
        let (step, world, pixel, centre) = match self {
            Self::Perspective { step, world, pixel, centre } => (*step, *world, *pixel, *centre),
            Self::Any { view, to_step, form, .. } => {
                // Not with `and_then`: closures do not inherit the level's instructions.
                if let Some(form) = form
                    && let Some([along, world]) = form.lanes(simd, x, y)
                {
                    return Directions { along, world, shown: f32x16::splat(simd, 1.0).simd_gt(0.0) };
                }
                return each(simd, view, *to_step, [x.to_array(), y.to_array()]);
            }
        };
        let one = f32x16::splat(simd, 1.0);
        let (u, v) = ((x - centre[0]) * pixel, (y - centre[1]) * -pixel);
        let shrink = one / (one + u * u + v * v).sqrt();
        let shown = one.simd_gt(0.0);
        Directions { along: Self::turn(step, u, v, shrink), world: Self::turn(world, u, v, shrink), shown }
    }

    #[inline(always)]
    fn turn<S: Simd>([f, r, t]: [Vec3; 3], u: f32x16<S>, v: f32x16<S>, shrink: f32x16<S>) -> [f32x16<S>; 3] {
        [(u * r.x + v * t.x + f.x) * shrink, (u * r.y + v * t.y + f.y) * shrink, (u * r.z + v * t.z + f.z) * shrink]
    }
}

/// Returns the rays of any camera through the points (`x`, `y`) of the picture, one by one.
///
/// Rays that show nothing take the direction of the first one that does, so that they do not widen the bundle, or else
/// point forward.
#[inline(never)]
fn each<S: Simd>(simd: S, view: &View, to_step: DMat3, [x, y]: [[f32; 16]; 2]) -> Directions<S> {
    let directions: [_; 16] = from_fn(|n| view.ray_at(f64::from(x[n]), f64::from(y[n])).map(|ray| ray.direction));
    let other = directions.iter().flatten().next().copied().unwrap_or(view.forward());
    let (mut along, mut world, mut shown) = ([[0.0; 16]; 3], [[0.0; 16]; 3], [0.0; 16]);
    for (n, chosen) in directions.into_iter().enumerate() {
        let direction = chosen.unwrap_or(other);
        let step = to_step * direction;
        for a in 0..3 {
            along[a][n] = step[a] as f32;
            world[a][n] = direction[a] as f32;
        }
        shown[n] = f32::from(u8::from(chosen.is_some()));
    }
    let load = |values: &[f32; 16]| f32x16::load_array_ref(simd, values);
    Directions {
        along: [load(&along[0]), load(&along[1]), load(&along[2])],
        world: [load(&world[0]), load(&world[1]), load(&world[2])],
        shown: load(&shown).simd_gt(0.5),
    }
}

/// Splits positions into cells (counted from cell −1) and positions within them, 0 to 1.
#[inline(always)]
pub(crate) fn split<S: Simd>(q: [f32x16<S>; 3]) -> ([i32x16<S>; 3], [f32x16<S>; 3]) {
    // Not with `map`: closures do not inherit the level's instructions.
    let floor = [q[0].floor(), q[1].floor(), q[2].floor()];
    let place = [q[0] - floor[0], q[1] - floor[1], q[2] - floor[2]];
    let cell = [floor[0].to_int(), floor[1].to_int(), floor[2].to_int()];
    (cell, place)
}
