//! Step size control for methods that estimate their error.

use super::{ExponentialEuler, Phase, StepCost, Stepper, System};

/// Controls the parts (substeps) that a step is divided into.
#[derive(Clone, Copy, Debug, PartialEq)]
#[doc(hidden)]
pub struct Control {
    /// Error allowed per part: mm or rad, and mm/s or rad/s. Relative to the speed above 1 mm/s or rad/s.
    pub tolerance: f64,
    /// Maximum number of parts per step, including rejected ones. [`ExponentialEuler`] takes the remainder in one step.
    pub most_parts: u32,
}

/// Computes one part: the new state and its difference from that of the embedded method.
pub(super) type Part<'a> = dyn FnMut(f64, Phase, f64, &mut StepCost) -> (Phase, Phase) + 'a;

impl Control {
    /// Steps over `h` s in parts with an error of about `tolerance` each; `order` is the order of the error.
    ///
    /// PI control (Gustafsson 1991; Hairer and Wanner, *Solving ODEs II*, IV.2): `h′ = 0.9 h ε^(−0.7/q) ε₋₁^(0.4/q)`,
    /// where `ε` is the scaled error, `ε₋₁` the previous one and `q = order`. The size changes by at most a factor of 5
    /// either way, and does not grow after a rejected part.
    pub(super) fn steps(
        &self,
        system: &dyn System,
        start: Phase,
        h: f64,
        order: f64,
        cost: &mut StepCost,
        part: &mut Part<'_>,
    ) -> Phase {
        let b = system.mobility();
        let (mut t, mut y, mut size) = (0.0, start, h);
        let (mut before, mut thrown) = (1.0f64, false);
        for _ in 0..self.most_parts {
            let last = t + size >= h * (1.0 - 1e-12);
            let length = if last { h - t } else { size };
            let (next, difference) = part(t, y, length, cost);
            cost.parts += 1;
            let speed = (b * y.w).length().max((b * next.w).length()).max(1.0);
            let scaled = Phase { u: difference.u, w: difference.w * (1.0 / speed) };
            let error = scaled.norm(b) / self.tolerance;
            if error <= 1.0 && next.is_finite() {
                if last {
                    return next;
                }
                (t, y) = (t + length, next);
                let grow = 0.9 * error.max(1e-8).powf(-0.7 / order) * before.powf(0.4 / order);
                size = length * grow.clamp(0.2, if thrown { 1.0 } else { 5.0 });
                (before, thrown) = (error.max(1e-4), false);
            } else {
                // Also reached if the error is NaN.
                let shrink = if error.is_finite() { 0.9 * error.powf(-1.0 / order) } else { 0.1 };
                size = length * shrink.clamp(0.1, 0.9);
                thrown = true;
                // A smaller part would no longer change the time.
                if size < 1e-14 * h {
                    break;
                }
            }
        }
        cost.cut_short = true;
        ExponentialEuler.step(&From { system, t }, y, h - t, cost)
    }
}

/// A system with its time shifted.
struct From<'a> {
    system: &'a dyn System,
    t: f64,
}

impl System for From<'_> {
    fn rate(&self, t: f64, y: Phase) -> Phase {
        self.system.rate(self.t + t, y)
    }

    fn jacobian(&self, t: f64, y: Phase) -> super::Blocks {
        self.system.jacobian(self.t + t, y)
    }

    fn time_rate(&self, t: f64, y: Phase, scale: f64) -> Phase {
        self.system.time_rate(self.t + t, y, scale)
    }

    fn drag(&self) -> f64 {
        self.system.drag()
    }

    fn mobility(&self) -> glam::DMat3 {
        self.system.mobility()
    }
}
