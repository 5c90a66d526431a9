//! The embedded Runge–Kutta pair 5(4) of Dormand and Prince (1980; Hairer, Nørsett and Wanner, *Solving ODEs I*, II.5).

use super::{Control, Counted, Phase, StepCost, Stepper, System};

/// Seven stages, the last of which is the first of the next part.
///
/// The fifth-order solution is kept, and its difference from the fourth-order one is the error estimate. Stable for parts
/// of about `1/ω`, a size that the error control finds automatically.
#[doc(hidden)]
pub struct DormandPrince(pub Control);

const C: [f64; 7] = [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];
const A: [[f64; 6]; 7] = [
    [0.0; 6],
    [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];
/// Fifth-order weights minus fourth-order weights.
const E: [f64; 7] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];

impl DormandPrince {
    /// Computes one fifth-order part, its difference from fourth order, and the rate at its end. `first` is the rate at its start.
    fn part(f: &mut Counted<'_>, t: f64, y: Phase, h: f64, first: Phase) -> (Phase, Phase, Phase) {
        let mut k = [first; 7];
        let mut next = y;
        for s in 1..7 {
            next = (0..s).fold(y, |sum, j| sum + k[j] * (h * A[s][j]));
            k[s] = f.rate(t + C[s] * h, next);
        }
        let difference = (0..7).fold(Phase::default(), |sum, j| sum + k[j] * (h * E[j]));
        (next, difference, k[6])
    }

    /// Computes one fifth-order part without error control, to measure the order.
    #[doc(hidden)]
    pub fn fixed(system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        cost.parts += 1;
        let mut f = Counted::new(system, cost);
        let first = f.rate(0.0, y);
        Self::part(&mut f, 0.0, y, h, first).0
    }
}

impl Stepper for DormandPrince {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        // The rate at a state, kept for the part that starts there: the last stage of an accepted part.
        let mut known = (y, Counted::new(system, cost).rate(0.0, y));
        let mut after = known;
        self.0.steps(system, y, h, 5.0, cost, &mut |t, y, h, cost| {
            if y == after.0 {
                known = after;
            }
            let (next, difference, last) = Self::part(&mut Counted::new(system, cost), t, y, h, known.1);
            after = (next, last);
            (next, difference)
        })
    }

    fn order(&self) -> u32 {
        5
    }
}
