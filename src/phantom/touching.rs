//! Limbs that touch: the sigmoid rises, the transverse colon sags, and only a thin septum of tissue is left between their lumens.
//!
//! The septum is exact: both lumens end at planes with the same normal. A ball of gas widens each lumen towards its plane, so that
//! the contact is a patch and not a point.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::profile::SHIFT;
use super::solid::Surface;

/// Roundings between a lumen and its ball, and at the septum's rim, mm.
const ROUNDED_MM: [f64; 2] = [2.0, 1.0];

/// A septum of the ground truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueSeptum {
    /// Its middle, world mm LPS.
    pub position: DVec3,
    /// Its unit normal, from the limb nearer to the rectum to the other one.
    pub normal: DVec3,
    /// Thickness of its tissue before the scanner's blur, mm.
    pub thickness_mm: f64,
    /// Distances of the two limbs along the axis from the rectal end, mm.
    pub along_mm: [f64; 2],
}

/// One of two limbs that touch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limb {
    /// Arc length of the point of the axis nearest to the other limb, mm.
    pub s: f64,
    /// Arc lengths between which the septum ends the lumen, mm.
    pub from: f64,
    pub to: f64,
    /// The gas that widens the lumen: centre (world mm) and radius (mm).
    pub ball: (DVec3, f64),
    /// Radius of the patch, mm.
    pub patch: f64,
}

/// Two limbs and the septum between them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touching {
    /// Middle of the septum, world mm.
    pub middle: DVec3,
    /// Its unit normal, from the first to the second limb.
    pub normal: DVec3,
    pub thickness_mm: f64,
    /// Distance between the walls, where the value is that of the wall, mm.
    pub apart: f64,
    pub limbs: [Limb; 2],
}

impl Touching {
    /// Returns the same septum as seen with a blur of `sigma` mm. The tissue's own edges are where its share is a half.
    pub(crate) fn blurred(self, sigma: f64) -> Self {
        Self { apart: self.thickness_mm - 2.0 * SHIFT * sigma, ..self }
    }

    /// Returns the ground truth.
    pub(crate) fn truth(&self) -> TrueSeptum {
        let Self { middle: position, normal, thickness_mm, limbs, .. } = *self;
        TrueSeptum { position, normal, thickness_mm, along_mm: limbs.map(|limb| limb.s) }
    }

    /// Returns the stretches of arc length at the contact, mm.
    pub(crate) fn stretches(&self) -> [[f64; 2]; 2] {
        self.limbs.map(|limb| [limb.s - limb.patch, limb.s + limb.patch])
    }

    /// Returns a ball around the contact: its centre, world mm, and its radius, mm.
    pub(crate) fn ball(&self) -> (DVec3, f64) {
        (self.middle, self.limbs[0].patch.max(self.limbs[1].patch))
    }

    /// Returns the limb that arc length `s` is in.
    pub(crate) fn limb(&self, s: f64) -> Option<usize> {
        self.limbs.iter().position(|limb| (limb.from..=limb.to).contains(&s))
    }

    /// Returns how far `p` is beyond the face of limb `i`, mm.
    pub(crate) fn beyond(&self, i: usize, p: DVec3) -> f64 {
        (p - self.middle).dot(self.normal) * [1.0, -1.0][i] + 0.5 * self.apart
    }

    /// Ends the lumen with the plain wall `wall` at the septum. `p` has its foot point at arc length `s`.
    pub(crate) fn flatten(&self, wall: Surface, s: f64, p: impl Fn() -> DVec3) -> Surface {
        let Some(i) = self.limb(s) else { return wall };
        let p = p();
        let (centre, radius) = self.limbs[i].ball;
        let face = Surface { d: self.beyond(i, p), normal: self.normal * [1.0, -1.0][i] };
        wall.without(Surface::about(centre, radius, p), ROUNDED_MM[0]).join(face, ROUNDED_MM[1])
    }
}
