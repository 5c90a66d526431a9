//! The moving body and its integrator.

use glam::DVec3;

use crate::error::{Error, Result};

/// What the camera is made of.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Body {
    /// Radius of the sphere that must not touch the wall, mm.
    pub radius_mm: f64,
    /// Mass, g. Only the ratio of force to mass matters; forces are in g·mm/s².
    pub mass_g: f64,
    /// Drag `k_t`, 1/s: without forces the speed falls by e each `1/k_t` seconds.
    pub drag_per_s: f64,
}

impl Default for Body {
    fn default() -> Self {
        Self { radius_mm: 1.5, mass_g: 1.0, drag_per_s: 6.0 }
    }
}

impl Body {
    /// # Errors
    /// Status 2 for a mass that is not positive, a radius or drag that is negative, or anything not finite.
    pub fn check(&self) -> Result<()> {
        let refuse = |what: &str, value: f64, want: &str| {
            Err(Error::usage(format!("body.{what}"), format!("is {value}"), format!("give {want}")))
        };
        if !(self.mass_g.is_finite() && self.mass_g > 0.0) {
            return refuse("mass_g", self.mass_g, "a positive mass");
        }
        if !(self.radius_mm.is_finite() && (0.0..=50.0).contains(&self.radius_mm)) {
            return refuse("radius_mm", self.radius_mm, "0 to 50 mm");
        }
        if !(self.drag_per_s.is_finite() && self.drag_per_s >= 0.0) {
            return refuse("drag_per_s", self.drag_per_s, "a drag of at least 0");
        }
        Ok(())
    }

    /// One step of `dt` seconds under a force held constant: the new velocity (mm/s) and the displacement (mm).
    ///
    /// `v′ = F/m − k v` is linear in `v`, so with `F` constant over the step its exact solution is taken:
    /// `v₁ = v₀ e^(−k dt) + (F/m)(1 − e^(−k dt))/k`, and its integral for the displacement (the exponential Euler
    /// method; Hochbruck and Ostermann, *Exponential integrators*, Acta Numerica 2010). Order 1 where the force varies
    /// with place; stable in the drag for every `dt`, as `e^(−k dt)` never leaves [0, 1]. The force's own stiffness is
    /// taken care of by [`super::advance()`], which no step can outrun.
    pub fn step(&self, velocity: DVec3, force: DVec3, dt: f64) -> (DVec3, DVec3) {
        let k = self.drag_per_s;
        let x = k * dt;
        let decay = (-x).exp();
        // φ₁ = (1 − e⁻ˣ)/x and φ₂ = (1 − φ₁)/x, by their series where the quotients cancel.
        let (phi1, phi2) = if x < 1e-4 {
            (1.0 - x / 2.0 + x * x / 6.0, 0.5 - x / 6.0 + x * x / 24.0)
        } else {
            let phi1 = (1.0 - decay) / x;
            (phi1, (1.0 - phi1) / x)
        };
        let a = force / self.mass_g;
        let v1 = velocity * decay + a * (dt * phi1);
        let dx = velocity * (dt * phi1) + a * (dt * dt * phi2);
        if v1.is_finite() && dx.is_finite() { (v1, dx) } else { (DVec3::ZERO, DVec3::ZERO) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_for_a_constant_force_whatever_the_step() {
        let b = Body { drag_per_s: 3.0, mass_g: 2.0, ..Body::default() };
        let (f, v0, t) = (DVec3::new(5.0, -1.0, 0.5), DVec3::new(1.0, 2.0, 3.0), 2.0);
        let (v, x) = b.step(v0, f, t);
        let (mut vn, mut xn) = (v0, DVec3::ZERO);
        for _ in 0..1000 {
            let (a, d) = b.step(vn, f, t / 1000.0);
            vn = a;
            xn += d;
        }
        assert!((v - vn).length() < 1e-10 && (x - xn).length() < 1e-10);
        // Without drag: uniformly accelerated motion.
        let free = Body { drag_per_s: 0.0, mass_g: 2.0, ..b };
        let (v, x) = free.step(v0, f, t);
        assert!((v - v0 - f).length() < 1e-12 && (x - v0 * t - f).length() < 1e-12);
    }

    /// A damped spring has an analytic solution; halving the step must halve the error.
    #[test]
    fn order_one_for_a_force_that_varies() {
        let b = Body { drag_per_s: 2.0, mass_g: 1.0, ..Body::default() };
        let spring = 10.0;
        let exact = |t: f64| {
            let w = (spring - 1.0f64).sqrt();
            (-t).exp() * ((w * t).cos() + (w * t).sin() / w)
        };
        let error = |n: usize| {
            let (mut x, mut v) = (DVec3::X, DVec3::ZERO);
            for _ in 0..n {
                let (a, d) = b.step(v, -spring * x, 1.0 / n as f64);
                v = a;
                x += d;
            }
            (x.x - exact(1.0)).abs()
        };
        let order = (error(200) / error(400)).log2();
        assert!((order - 1.0).abs() < 0.2, "order {order}");
    }

    #[test]
    fn extremes_stay_finite_and_nonsense_is_refused() {
        for dt in [1e-6, 1.0, 10.0, 1e6] {
            for k in [0.0, 1e-12, 1.0, 1e9] {
                let b = Body { drag_per_s: k, mass_g: 1e-6, ..Body::default() };
                let (v, x) = b.step(DVec3::splat(1e4), DVec3::splat(1e9), dt);
                assert!(v.is_finite() && x.is_finite());
            }
        }
        assert_eq!(Body::default().step(DVec3::NAN, DVec3::X, 0.1), (DVec3::ZERO, DVec3::ZERO));
        for b in [
            Body { mass_g: 0.0, ..Body::default() },
            Body { mass_g: f64::NAN, ..Body::default() },
            Body { radius_mm: -1.0, ..Body::default() },
            Body { drag_per_s: -1.0, ..Body::default() },
        ] {
            assert!(b.check().is_err());
        }
        assert!(Body::default().check().is_ok());
    }
}
