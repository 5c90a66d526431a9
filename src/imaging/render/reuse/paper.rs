//! The paper's own rule for what a ray may skip (section 2.2): "distances along the rays to the colon wall in the new
//! frame will roughly equal those in the old frame minus the distance the camera moved", with a shortening function of
//! the pixel's position; for a rotation, the distances of the neighbours that correspond to its angle and axis.
//!
//! | paper | here |
//! |---|---|
//! | jump-skip distance of a pixel in the old frame | distance of its first sample that was not empty |
//! | neighbours corresponding to the rotation | the four old pixels around where the new ray's direction was seen |
//! | shortening function | distance moved forward / cos(angle of ray to view); exact if the wall is a plane across the view |
//! | proximity of the wall, in which an average of 4 samples are needed | [`NEAR_SAMPLES`] kept |
//!
//! The rule is a guess: a wall that runs along the view, or a fold that comes out from behind another, breaks it.

use super::known::{Empty, Known, Reprojection};
use crate::render::march::Ray;

/// Number of samples before the guessed wall that are traced again.
pub(crate) const NEAR_SAMPLES: f32 = 4.0;

/// The record of a pixel for the paper's rule and its proof.
#[derive(Clone, Copy, Debug, Default)]
pub struct Trace {
    /// How far the pixel's pyramid is empty, mm.
    pub empty_mm: f32,
    /// Distance of the first sample that was not empty, mm; the ray's end if there was none.
    pub first_mm: f32,
}

impl Empty for Trace {
    fn empty_mm(&self) -> f32 {
        self.empty_mm
    }
}

/// Returns the distance at which the paper's rule would let a `ray` through pixel (`x`, `y`) start, mm; 0 if the old
/// picture does not show its direction.
pub(crate) fn guess(known: &Known<Trace>, motion: &Reprojection, x: usize, y: usize, ray: &Ray) -> f32 {
    let direction = motion.direction(x as f64 + 0.5, y as f64 + 0.5);
    if direction.x <= 0.0 {
        return 0.0;
    }
    let at = motion.project(direction);
    let (width, height) = (known.view.width(), known.view.height());
    let [u, v] = at.map(|c| (c - 0.5).floor());
    if !(u >= 0.0 && v >= 0.0 && u + 1.0 < width as f64 && v + 1.0 < height as f64) {
        return 0.0;
    }
    let first = u as usize + width * v as usize;
    let around = [first, first + 1, first + width, first + width + 1];
    let nearest = around.iter().fold(f32::INFINITY, |d, &n| d.min(known.pixels[n].first_mm));
    let shortening = (motion.moved.x * direction.length()) as f32;
    (nearest - shortening - NEAR_SAMPLES / ray.per_mm).max(0.0)
}
