//! The potential field of the paper (section 3.1.1): the wall repels, the target attracts.
//!
//! `V(x) = C_t D_t(x) + C_s (p/D_s(x) − 1)²` if `0 < D_s < p`, and `V(x) = C_t D_t(x)` otherwise, with
//!
//! | paper | here | unit |
//! |---|---|---|
//! | `D_s(x)` | `wall`, distance to the wall | mm |
//! | `D_t(x)` | `target`, distance to the target | mm |
//! | `C_t` | [`Potential::target_force`] | g·mm/s² |
//! | `C_s` | [`Potential::wall_energy`] | g·mm²/s² |
//! | `p` | [`Potential::reach_mm`] | mm |
//!
//! With `s(D) = (p/D − 1)²`, `s′ = −2 (p/D − 1) p/D²` and `s″ = 2 p²/D⁴ + 4 (p/D − 1) p/D³`, the chain rule gives `∇V =
//! C_t ∇D_t + C_s s′ ∇D_s` and `∇²V = C_t ∇²D_t + C_s (s″ ∇D_s ∇D_sᵀ + s′ ∇²D_s)`.
//!
//! **The barrier.** `s` is unbounded as `D_s → 0`. Below `δ = 10⁻⁴ p` it is continued by its second-degree Taylor
//! polynomial at `δ`, through 0 and into the negative distances inside the wall. Value, force and stiffness are
//! continuous at `δ`. The force keeps growing into the wall but stays finite: at most about `10¹² C_s/p` at the wall. At
//! `D_s = p` the force starts from 0, so only its slope jumps (by `2 C_s/p²`).

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::fields::{Distance, Sample};

/// Below this share of `p` the barrier is continued by its Taylor polynomial.
const FLOOR: f64 = 1e-4;

/// The view is directed at the path this far ahead, mm. The path is followed in steps of [`AHEAD_STEP_MM`].
const AHEAD_MM: f64 = 24.0;
/// One step along that path, mm.
const AHEAD_STEP_MM: f64 = 3.0;

/// The parameters of `V(x)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Potential {
    /// `C_t`: the constant pull towards the target, g·mm/s².
    pub target_force: f64,
    /// `C_s`: the strength of the wall, g·mm²/s².
    pub wall_energy: f64,
    /// `p`: the wall repels within this distance, mm.
    pub reach_mm: f64,
}

impl Default for Potential {
    /// A drag of 6/s holds the pull at 30 mm/s for 1 g; the wall balances that pull at 4 mm.
    fn default() -> Self {
        Self { target_force: 180.0, wall_energy: 100.0, reach_mm: 10.0 }
    }
}

/// `V` with its first and second derivatives at a point, in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PotentialSample {
    /// `V`, g·mm²/s².
    pub energy: f64,
    /// `∇V`, g·mm/s²; the force is its negative.
    pub gradient: DVec3,
    /// `∇²V`, g/s²; symmetric.
    pub hessian: DMat3,
}

impl PotentialSample {
    /// No potential. The type does not derive `Default`, since the default matrix is the identity.
    pub const ZERO: Self = Self { energy: 0.0, gradient: DVec3::ZERO, hessian: DMat3::ZERO };
}

impl Potential {
    /// Checks the parameters.
    ///
    /// # Errors
    /// Returns status 2 if a constant is negative, the reach is not positive, or any value is not finite.
    pub fn check(&self) -> Result<()> {
        let refuse = |what: &str, value: f64, want: &str| {
            Err(Error::usage(format!("potential.{what}"), format!("is {value}"), format!("give {want}")))
        };
        for (what, value) in [("target_force", self.target_force), ("wall_energy", self.wall_energy)] {
            if !(value.is_finite() && value >= 0.0) {
                return refuse(what, value, "a finite number of at least 0");
            }
        }
        // Outside this range, the fourth power of the inverse overflows.
        if !(1e-6..=1e6).contains(&self.reach_mm) {
            return refuse("reach_mm", self.reach_mm, "a distance from 1e-6 to 1e6 mm");
        }
        Ok(())
    }

    /// Returns `V` and its derivatives, given the distances to the wall and to the target. `None` contributes nothing.
    pub fn at(&self, wall: Option<Sample>, target: Option<Sample>) -> PotentialSample {
        let mut v = PotentialSample::ZERO;
        if let Some(t) = target {
            v.energy += self.target_force * t.mm;
            v.gradient += t.gradient * self.target_force;
            v.hessian += t.hessian * self.target_force;
        }
        if let Some(w) = wall.filter(|w| w.mm < self.reach_mm) {
            let [s, s1, s2] = self.barrier(w.mm);
            let g = w.gradient;
            v.energy += self.wall_energy * s;
            v.gradient += g * (self.wall_energy * s1);
            let outer = DMat3::from_cols(g * g.x, g * g.y, g * g.z);
            v.hessian += outer * (self.wall_energy * s2) + w.hessian * (self.wall_energy * s1);
        }
        v
    }

    /// Returns `s`, `s′` (1/mm) and `s″` (1/mm²) at the distance `d` mm; zero from `p` on.
    pub fn barrier(&self, d: f64) -> [f64; 3] {
        let p = self.reach_mm;
        if d.is_nan() || d >= p {
            return [0.0; 3];
        }
        let at = d.max(FLOOR * p);
        let (q, over) = (p / at, p / at - 1.0);
        let s = over * over;
        let s1 = -2.0 * over * q / at;
        let s2 = (2.0 * q * q + 4.0 * over * q) / (at * at);
        // Zero unless the floor applies. Limited to depth p, because distances deeper inside the wall mean nothing.
        let deeper = (d - at).max(-p);
        [s + deeper * (s1 + 0.5 * deeper * s2), s1 + deeper * s2, s2]
    }
}

/// Returns the unit direction (world) from `from` (world mm) to the path ahead.
///
/// It is the mean direction of the points on the steepest descent of the distance to the target, up to 24 mm ahead. Zero
/// if the distance is unknown, and at the target.
pub fn ahead(target: &dyn Distance, from: DVec3) -> DVec3 {
    let mut at = from;
    let mut sum = DVec3::ZERO;
    for _ in 0..(AHEAD_MM / AHEAD_STEP_MM) as usize {
        let Some(s) = target.sample(at) else { break };
        let step = AHEAD_STEP_MM.min(s.mm);
        let down = s.gradient.normalize_or_zero();
        if down == DVec3::ZERO || step < 1e-3 {
            break;
        }
        at -= down * step;
        sum += (at - from).normalize_or_zero();
    }
    sum.normalize_or_zero()
}

/// Returns places on the steepest descent of the distance to the target from `from` on (world mm), `step` mm apart. Beyond the target
/// they go straight on.
#[doc(hidden)]
pub fn descent<const N: usize>(target: &dyn Distance, from: DVec3, step: f64) -> [DVec3; N] {
    let (mut at, mut down, mut goes_on) = (from, DVec3::ZERO, true);
    let mut places = [from; N];
    for place in places.iter_mut().skip(1) {
        let sample = target.sample(at).filter(|s| goes_on && s.mm > step);
        match sample.map(|s| -s.gradient.normalize_or_zero()).filter(|d| *d != DVec3::ZERO) {
            Some(steepest) => down = steepest,
            None => goes_on = false,
        }
        at += down * step;
        *place = at;
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Distance to a sphere of radius `r` around `centre`, from inside.
    fn sphere(at: DVec3, centre: DVec3, r: f64) -> Sample {
        let (d, n) = ((at - centre).length(), (at - centre).normalize());
        let outer = DMat3::from_cols(n * n.x, n * n.y, n * n.z);
        Sample { mm: r - d, gradient: -n, hessian: (outer - DMat3::IDENTITY) * (1.0 / d) }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]
        /// Gradient and Hessian match central differences of the value.
        #[test]
        fn derivatives_are_those_of_the_value(
            d in 0.3f64..11.0, c_s in 0.1f64..1e4, c_t in 0.0f64..1e3, x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0,
        ) {
            let v = Potential { target_force: c_t, wall_energy: c_s, reach_mm: 10.0 };
            let axis = DVec3::new(x, y, z + 1.5).normalize();
            let (wall, goal) = (DVec3::new(3.0, -2.0, 1.0), DVec3::new(40.0, 9.0, -7.0));
            let here = wall + axis * (20.0 - d);
            let sample = |at: DVec3| v.at(Some(sphere(at, wall, 20.0)), Some(Sample {
                mm: (at - goal).length(),
                gradient: (at - goal).normalize(),
                hessian: sphere(at, goal, 0.0).hessian * -1.0,
            }));
            let s = sample(here);
            let h = 1e-5 * d;
            // Not across the jump of the stiffness at p.
            prop_assume!((d - 10.0).abs() > 1e-2);
            for axis in DMat3::IDENTITY.to_cols_array_2d().map(DVec3::from_array) {
                let (a, b) = (sample(here + axis * h), sample(here - axis * h));
                let slope = (a.energy - b.energy) / (2.0 * h);
                prop_assert!((slope - s.gradient.dot(axis)).abs() <= 1e-5 * (1.0 + s.gradient.length() + s.energy));
                let bend = (a.gradient - b.gradient) / (2.0 * h);
                let reported = s.hessian * axis;
                prop_assert!((bend - reported).length() <= 1e-4 * (1.0 + reported.length() + s.gradient.length()), "{bend} {reported}");
            }
        }
    }

    #[test]
    fn the_barrier_is_continued_smoothly_and_stays_finite() {
        for p in [1e-3, 10.0, 1e3] {
            let v = Potential { target_force: 0.0, wall_energy: 1e9, reach_mm: p };
            v.check().unwrap();
            let floor = FLOOR * p;
            let (above, below) = (v.barrier(floor * (1.0 + 1e-9)), v.barrier(floor * (1.0 - 1e-9)));
            for n in 0..3 {
                assert!((above[n] / below[n] - 1.0).abs() < 1e-6, "{n}: {above:?} {below:?}");
            }
            let mut last = f64::INFINITY;
            for d in [p, 0.9 * p, 0.1 * p, floor, 0.0, -0.5 * p, -p, -1e12, f64::NEG_INFINITY] {
                let s = v.barrier(d).map(|x| x * v.wall_energy);
                assert!(s.iter().all(|x| x.is_finite()), "{d}: {s:?}");
                assert!(s[1] <= 0.0 && s[1] <= last, "it pushes out of the wall, and more the deeper: {d}: {s:?}");
                last = s[1];
            }
        }
        assert_eq!(Potential::default().barrier(f64::NAN), [0.0; 3]);
        assert_eq!(Potential::default().at(None, None), PotentialSample::ZERO);
    }

    /// Distance to a point, defined only where z > −1.
    struct ToPoint(DVec3);

    impl Distance for ToPoint {
        fn sample(&self, at: DVec3) -> Option<Sample> {
            let direction = at - self.0;
            let gradient = direction.normalize_or_zero();
            (at.z > -1.0).then_some(Sample { mm: direction.length(), gradient, hessian: DMat3::ZERO })
        }
    }

    #[test]
    fn the_view_looks_down_the_distance() {
        let target = ToPoint(DVec3::new(50.0, 0.0, 0.0));
        assert!(ahead(&target, DVec3::ZERO).distance(DVec3::X) < 1e-12);
        assert!(ahead(&target, DVec3::new(49.0, 0.0, 0.0)).distance(DVec3::X) < 1e-12, "nearer than one step");
        assert_eq!(ahead(&target, target.0), DVec3::ZERO, "at the target");
        assert_eq!(ahead(&target, DVec3::NEG_Z * 2.0), DVec3::ZERO, "not known");
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        let good = Potential::default();
        assert!(good.check().is_ok());
        let bad = [f64::NAN, f64::INFINITY, -1.0];
        let cases = bad.iter().flat_map(|&x| {
            [
                ("target_force", Potential { target_force: x, ..good }),
                ("wall_energy", Potential { wall_energy: x, ..good }),
                ("reach_mm", Potential { reach_mm: x, ..good }),
            ]
        });
        for (name, v) in cases.chain([("reach_mm", Potential { reach_mm: 0.0, ..good })]) {
            let said = v.check().unwrap_err().to_string();
            assert!(said.contains(name), "{said}");
        }
    }
}
