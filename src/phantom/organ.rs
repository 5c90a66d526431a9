//! Ellipsoids that organs consist of.

use glam::DVec3;

/// An ellipsoid with a constant value.
pub(crate) struct Organ {
    centre: DVec3,
    /// Reciprocals of the half axes.
    inverse: DVec3,
    shortest: f64,
    /// HU.
    pub hu: f64,
}

pub(crate) const fn organ(centre: [f64; 3], semi: [f64; 3], hu: f64) -> Organ {
    let [a, b, c] = semi;
    Organ {
        centre: DVec3::from_array(centre),
        inverse: DVec3::new(1.0 / a, 1.0 / b, 1.0 / c),
        shortest: a.min(b).min(c),
        hu,
    }
}

impl Organ {
    /// Returns the depth below the surface in an adult's mm: a lower bound of the distance, exact along the shortest half axis.
    pub(crate) fn depth(&self, o: DVec3) -> f64 {
        (1.0 - ((o - self.centre) * self.inverse).length()) * self.shortest
    }
}
