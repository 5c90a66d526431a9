//! A Rosenbrock–W method: linearly implicit, so a stiff wall costs one small linear system and no iteration.

use super::{Control, Counted, ExponentialEuler, Phase, StepCost, Stepper, System};

/// ROS34PW2, a third-order Rosenbrock–W method (Rang and Angermann, *New Rosenbrock W-methods of order 3 for PDAEs of
/// index 1*, BIT 2005).
///
/// It has four stages, order 3 for any approximate Jacobian, and an embedded method of order 2. It is L-stable and
/// stiffly accurate:
///
/// ```text
/// (I − γ h J) k_i = h f(t + c_i h, y + Σ α_ij k_j) + h J Σ γ_ij k_j + h² d_i f_t      y₁ = y + Σ b_i k_i
/// ```
///
/// where `J` and `f_t` are taken at the start. Stable for every step.
#[doc(hidden)]
pub struct Rosenbrock;

/// The same method, in parts sized by the embedded method.
#[doc(hidden)]
pub struct RosenbrockAdaptive(pub Control);

const GAMMA: f64 = 4.358_665_215_084_59e-1;
const A: [[f64; 3]; 4] = [
    [0.0; 3],
    [8.717_330_430_169_18e-1, 0.0, 0.0],
    [8.445_706_001_536_942e-1, -1.129_906_423_648_418_5e-1, 0.0],
    [0.0, 0.0, 1.0],
];
const G: [[f64; 3]; 4] = [
    [0.0; 3],
    [-8.717_330_430_169_18e-1, 0.0, 0.0],
    [-9.033_805_701_304_408e-1, 5.418_067_238_809_533e-2, 0.0],
    [2.421_238_070_609_535e-1, -1.223_250_583_904_515, 5.452_602_553_351_021e-1],
];
const B: [f64; 4] = [2.421_238_070_609_535e-1, -1.223_250_583_904_515, 1.545_260_255_335_102, 4.358_665_215_084_59e-1];
const EMBEDDED: [f64; 4] = [3.781_090_314_581_937e-1, -9.604_229_221_242_318e-2, 5e-1, 2.179_332_607_542_295e-1];

/// Computes one part and its difference from the embedded method. Returns `None` if the linear system has no solution.
fn part(system: &dyn System, t: f64, y: Phase, h: f64, cost: &mut StepCost) -> Option<(Phase, Phase)> {
    let mut f = Counted::new(system, cost);
    let j = f.jacobian(t, y);
    let solver = j.shifted(GAMMA * h)?;
    let by_time = system.time_rate(t, y, h);
    let mut k = [Phase::default(); 4];
    for s in 0..4 {
        let sum = |row: &[f64]| (0..s).fold(Phase::default(), |sum, n| sum + k[n] * row[n]);
        let at: f64 = A[s].iter().sum();
        let d = GAMMA + G[s].iter().sum::<f64>();
        let rate = f.rate(t + at * h, y + sum(&A[s]));
        k[s] = solver.solve(rate * h + j.apply(sum(&G[s])) * h + by_time * (h * h * d));
    }
    let weighted = |b: [f64; 4]| (0..4).fold(Phase::default(), |sum, n| sum + k[n] * b[n]);
    let next = weighted(B);
    Some((y + next, next - weighted(EMBEDDED)))
}

impl Stepper for Rosenbrock {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        cost.parts += 1;
        match part(system, 0.0, y, h, cost) {
            Some((next, _)) => next,
            None => {
                cost.cut_short = true;
                ExponentialEuler.step(system, y, h, cost)
            }
        }
    }

    fn order(&self) -> u32 {
        3
    }
}

impl Stepper for RosenbrockAdaptive {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        self.0.steps(system, y, h, 3.0, cost, &mut |t, y, h, cost| {
            let broken = Phase { u: glam::DVec3::NAN, w: glam::DVec3::NAN };
            part(system, t, y, h, cost).unwrap_or((broken, broken))
        })
    }

    fn order(&self) -> u32 {
        3
    }
}
