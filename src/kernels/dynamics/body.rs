//! The moving body: size, mass, drag and integration method.

use crate::dynamics::integrators::Integrator;
use crate::dynamics::rigid::Inertia;
use crate::error::{Error, Result};

/// The camera as a rigid body, with the method that integrates its motion.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Body {
    /// Radius of the sphere that must not touch the wall, mm. It encloses the cylinder in every orientation.
    /// The module `dynamics::advance` explains why contact is tested with the sphere.
    pub radius_mm: f64,
    /// Mass, g. Only the ratio of force to mass matters; forces are in g·mm/s².
    pub mass_g: f64,
    /// Drag `k_t`, 1/s: without forces the speed falls by a factor of e every `1/k_t` seconds.
    pub drag_per_s: f64,
    /// Radius of the cylinder, mm. Defaults to that of the largest cylinder in the sphere that is as long as it is wide.
    pub cylinder_radius_mm: Option<f64>,
    /// Length of the cylinder along the view direction, mm. Defaults as for the radius.
    pub cylinder_length_mm: Option<f64>,
    /// Method that solves the equations of motion.
    pub integrator: Integrator,
}

impl Default for Body {
    fn default() -> Self {
        Self {
            radius_mm: 1.5,
            mass_g: 1.0,
            drag_per_s: 6.0,
            cylinder_radius_mm: None,
            cylinder_length_mm: None,
            integrator: Integrator::default(),
        }
    }
}

impl Body {
    /// Checks the settings.
    ///
    /// # Errors
    /// Returns status 2 if the mass is not positive, the radius or the drag is negative, the cylinder sticks out of the
    /// sphere, or any value is not finite.
    pub fn check(&self) -> Result<()> {
        let refuse = |what: &str, value: f64, want: &str| {
            Err(Error::usage(format!("body.{what}"), format!("is {value}"), format!("give {want}")))
        };
        // Outside this range, products of forces, times and inverse masses overflow.
        if !(1e-9..=1e9).contains(&self.mass_g) {
            return refuse("mass_g", self.mass_g, "a positive mass, 1e-9 to 1e9 g");
        }
        if !(0.0..=50.0).contains(&self.radius_mm) {
            return refuse("radius_mm", self.radius_mm, "0 to 50 mm");
        }
        if !(self.drag_per_s.is_finite() && self.drag_per_s >= 0.0) {
            return refuse("drag_per_s", self.drag_per_s, "a drag of at least 0");
        }
        let (r, l) = self.cylinder();
        for (what, value) in [("cylinder_radius_mm", r), ("cylinder_length_mm", l)] {
            if !(value.is_finite() && value >= 0.0) {
                return refuse(what, value, "a length of at least 0");
            }
        }
        if r.hypot(0.5 * l) > self.radius_mm * (1.0 + 1e-9) {
            let (what, value) =
                if self.cylinder_length_mm.is_some() { ("cylinder_length_mm", l) } else { ("cylinder_radius_mm", r) };
            let want = format!("a cylinder that lies within the sphere of body.radius_mm = {}", self.radius_mm);
            return refuse(what, value, &want);
        }
        Ok(())
    }

    /// Returns the radius and length of the cylinder, mm. A dimension that is not set is the largest that fits with the other.
    pub fn cylinder(&self) -> (f64, f64) {
        let sphere = self.radius_mm;
        let beside = |x: f64| (sphere * sphere - x * x).max(0.0).sqrt();
        match (self.cylinder_radius_mm, self.cylinder_length_mm) {
            (Some(r), Some(l)) => (r, l),
            (Some(r), None) => (r, 2.0 * beside(r)),
            (None, Some(l)) => (beside(0.5 * l), l),
            (None, None) => (sphere * std::f64::consts::FRAC_1_SQRT_2, sphere * std::f64::consts::SQRT_2),
        }
    }

    /// Returns the widest gap between the surface of the cylinder and that of the sphere, mm.
    ///
    /// The body stays farther from the wall than its cylinder requires by at most this distance. The gap is widest at the
    /// side of the cylinder or at the middle of its ends.
    pub fn gap_mm(&self) -> f64 {
        let (radius, length) = self.cylinder();
        self.radius_mm - radius.min(0.5 * length)
    }

    /// Returns the cylinder's moments of inertia.
    pub fn inertia(&self) -> Inertia {
        let (radius, length) = self.cylinder();
        Inertia::cylinder(self.mass_g, radius, length)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::math::hash;

    #[test]
    fn nonsense_is_refused_by_name() {
        let good = Body::default();
        let bad = [f64::NAN, f64::INFINITY, -1.0];
        let cases = bad.iter().flat_map(|&x| {
            [
                ("mass_g", Body { mass_g: x, ..good }),
                ("radius_mm", Body { radius_mm: x, ..good }),
                ("drag_per_s", Body { drag_per_s: x, ..good }),
                ("cylinder_radius_mm", Body { cylinder_radius_mm: Some(x), ..good }),
                ("cylinder_length_mm", Body { cylinder_length_mm: Some(x), ..good }),
            ]
        });
        let more = [
            ("mass_g", Body { mass_g: 0.0, ..good }),
            ("cylinder_length_mm", Body { cylinder_length_mm: Some(3.1), ..good }),
            ("cylinder_radius_mm", Body { cylinder_radius_mm: Some(1.6), ..good }),
        ];
        for (name, body) in cases.chain(more) {
            let said = body.check().unwrap_err().to_string();
            assert!(said.contains(name), "{body:?}: {said}");
        }
    }

    #[test]
    fn needles_discs_and_points_are_bodies() {
        for (r, l) in
            [(None, None), (Some(0.0), None), (None, Some(0.0)), (Some(1e-9), Some(2.9)), (Some(1.5), Some(0.0))]
        {
            for mass_g in [1e-6, 1.0, 1e6] {
                let body = Body { mass_g, cylinder_radius_mm: r, cylinder_length_mm: l, ..Body::default() };
                body.check().unwrap();
                let j = body.inertia();
                assert!(j.axial > 0.0 && j.transverse > 0.0 && j.excess().is_finite());
            }
        }
        let point = Body { radius_mm: 0.0, ..Body::default() };
        point.check().unwrap();
        assert!(point.inertia().axial > 0.0);
        let (r, l) = Body::default().cylinder();
        assert!((r.hypot(l / 2.0) - 1.5).abs() < 1e-12 && (l - 2.0 * r).abs() < 1e-12);
    }

    /// The basis of the contact test with the sphere: no turn takes a point of the cylinder out of it, and the wall is
    /// farther away than the cylinder requires by at most the gap.
    #[test]
    fn the_sphere_encloses_the_cylinder_however_it_is_turned() {
        assert!((Body::default().gap_mm() - 0.44).abs() < 0.001, "as the docs of the contact test have it");
        for (r, l) in [(None, None), (Some(0.3), None), (None, Some(0.5)), (Some(1.0), Some(1.0))] {
            let body = Body { cylinder_radius_mm: r, cylinder_length_mm: l, ..Body::default() };
            body.check().unwrap();
            let (r, l) = body.cylinder();
            let mut widest = 0.0f64;
            for n in 0..500u64 {
                let u = |k| hash::uniform(7, 8 * n + k) * 2.0 - 1.0;
                let turn = DQuat::from_scaled_axis(DVec3::new(u(0), u(1), u(2)) * 3.0);
                // The cylinder's farthest point along a direction in its own frame, and its extent in that direction.
                let direction = DVec3::new(u(3), u(4), u(5)).normalize();
                let across = DVec3::new(direction.x, direction.y, 0.0);
                let point = across.normalize() * r + DVec3::Z * (0.5 * l * direction.z.signum());
                assert!((turn * point).length() <= body.radius_mm * (1.0 + 1e-9));
                widest = widest.max(body.radius_mm - direction.dot(point));
            }
            assert!(widest <= body.gap_mm() + 1e-9 && widest > 0.5 * body.gap_mm(), "{widest} {}", body.gap_mm());
        }
    }

    /// A cylinder of mass m, radius r and length l: m r²/2 about its axis, m (3 r² + l²)/12 across it.
    #[test]
    fn the_moments_of_inertia_are_those_of_its_cylinder() {
        let (cylinder_radius_mm, cylinder_length_mm) = (Some(0.9), Some(2.0));
        let body = Body { mass_g: 3.0, cylinder_radius_mm, cylinder_length_mm, ..Body::default() };
        let j = body.inertia();
        assert!((j.axial - 3.0 * 0.81 / 2.0).abs() < 1e-12, "{j:?}");
        assert!((j.transverse - 3.0 * (3.0 * 0.81 + 4.0) / 12.0).abs() < 1e-12, "{j:?}");
    }
}
