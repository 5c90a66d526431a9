//! The bent tube of the studies. Its distances, gradients and Hessians are known exactly.

use glam::{DMat3, DVec3};

use crate::fields::{Clearance, Clearances, Distance, Sample};

/// A tube of radius `radius` mm around a circle of radius `bend` mm in the plane y = 0, flown towards increasing angles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tube {
    /// Radius of the lumen, mm.
    pub radius: f64,
    /// Radius of its axis, mm.
    pub bend: f64,
    /// Width over which the kink of `D_s` on the axis is rounded, mm: `D_s = r + ε − √(d² + ε²)`. A field on a grid rounds it in
    /// this manner over its spacing. 0 keeps the kink.
    pub rounding: f64,
}

impl Tube {
    /// Returns the point (mm) on the axis at the angle `phi`, rad, moved by `out` mm away from the circle's centre and by `up` mm
    /// along y.
    pub(crate) fn place(&self, phi: f64, out: f64, up: f64) -> DVec3 {
        let (s, c) = phi.sin_cos();
        DVec3::new(c * (self.bend + out), up, s * (self.bend + out))
    }

    /// Returns the unit direction of the axis next to a point.
    pub(crate) fn along(&self, at: DVec3) -> DVec3 {
        DVec3::new(-at.z, 0.0, at.x).normalize_or(DVec3::Z)
    }

    /// Returns the vector from the axis to a point, mm, perpendicular to the axis.
    pub(crate) fn across(&self, at: DVec3) -> DVec3 {
        let out = DVec3::new(at.x, 0.0, at.z).normalize_or(DVec3::X);
        at - out * self.bend
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The wall distance `D_s`.
impl Distance for Tube {
    fn sample(&self, at: DVec3) -> Option<Sample> {
        let rho = at.x.hypot(at.z);
        if !at.is_finite() || rho < 1e-9 {
            return None;
        }
        let (out, along) = (DVec3::new(at.x, 0.0, at.z) / rho, self.along(at));
        let a = rho - self.bend;
        let s = (a * a + at.y * at.y + self.rounding * self.rounding).sqrt().max(1e-12);
        let slope = (out * a + DVec3::Y * at.y) / s;
        let bend = outer(out, out) + outer(DVec3::Y, DVec3::Y) + outer(along, along) * (a / rho);
        let hessian = (bend - outer(slope, slope)) * (1.0 / s);
        Some(Sample { mm: self.radius + self.rounding - s, gradient: -slope, hessian: -hessian })
    }
}

/// The target distance `D_t` in the tube: the remaining path along the axis to the angle `end`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RemainingLength {
    /// The tube.
    pub tube: Tube,
    /// The target's angle, rad.
    pub end: f64,
}

impl Distance for RemainingLength {
    fn sample(&self, at: DVec3) -> Option<Sample> {
        let rho = at.x.hypot(at.z);
        if !at.is_finite() || rho < 1e-9 {
            return None;
        }
        let (out, along) = (DVec3::new(at.x, 0.0, at.z) / rho, self.tube.along(at));
        let bend = self.tube.bend;
        let hessian = (outer(out, along) + outer(along, out)) * (bend / (rho * rho));
        let mm = bend * (self.end - at.z.atan2(at.x));
        Some(Sample { mm, gradient: along * (-bend / rho), hessian })
    }
}

impl Clearances for Tube {
    fn clearance(&self, at: DVec3) -> Clearance {
        let across = self.across(at);
        let mm = if at.is_finite() { (self.radius - across.length()).max(0.0) } else { 0.0 };
        Clearance { mm, toward: if mm > 0.0 { across.normalize_or(DVec3::Y) } else { DVec3::ZERO } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_the_distances() {
        let tube = Tube { radius: 12.0, bend: 50.0, rounding: 0.7 };
        let remaining = RemainingLength { tube, end: 2.0 };
        for field in [&tube as &dyn Distance, &remaining] {
            for at in [tube.place(0.3, 4.0, -2.0), tube.place(1.2, -0.2, 0.1), tube.place(-1.0, 0.0, 9.0)] {
                let s = field.sample(at).unwrap();
                let h = 1e-4;
                for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                    let [a, b] = [h, -h].map(|h| field.sample(at + axis * h).unwrap());
                    assert!(((a.mm - b.mm) / (2.0 * h) - s.gradient.dot(axis)).abs() < 1e-6);
                    assert!(((a.gradient - b.gradient) / (2.0 * h) - s.hessian * axis).length() < 1e-5);
                }
            }
        }
        assert!((tube.clearance(tube.place(0.5, 3.0, 4.0)).mm - 7.0).abs() < 1e-12);
        assert!(tube.sample(DVec3::NAN).is_none() && tube.clearance(DVec3::NAN).mm == 0.0);
    }
}
