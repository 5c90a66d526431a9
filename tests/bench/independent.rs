//! Solutions by an independent solver (diffsol), in coordinates that the integrators do not use: thirteen numbers, including the
//! quaternion, `q′ = ½ ω q`. They verify the accuracy that the reference solution of `report dynamics` claims.
//!
//! ```sh
//! cargo test --release -p colvis-bench
//! ```

use colvis::dynamics::{Body, Forces, RigidBodyState, Turning};
use colvis::report::internals::{self as study, CASES, SECONDS, angle, errors, exp, forces, start, turn, turning};
use diffsol::{
    DiffsolError, NalgebraLU, NalgebraMat, OdeBuilder, OdeEquations, OdeSolverMethod, OdeSolverStopReason, Vector,
};
use glam::{DQuat, DVec3};

/// Number of components of a state.
const N: usize = 13;

/// The solver of diffsol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Solver {
    /// Implicit backward differentiation formulas of variable order.
    Bdf,
    /// Tsitouras' explicit Runge–Kutta pair 5(4), to cross-check the other.
    Tsit45,
}

/// Returns the motion after each of `times` (s, ascending).
///
/// # Errors
/// Returns an error if the solver gives up.
fn solve(
    solver: Solver,
    body: &Body,
    start: &RigidBodyState,
    forces: &dyn Forces,
    turning: &Turning,
    times: &[f64],
) -> Result<Vec<RigidBodyState>, DiffsolError> {
    let rate = |y: &[f64], out: &mut [f64]| {
        let m = unpack(y);
        let inertia = body.inertia();
        // Without normalising: the derivative must be that of a smooth function of all four components.
        let axis = (m.orientation * (1.0 / m.orientation.length())) * DVec3::Z;
        let turn = inertia.rate(m.angular, axis);
        let unit = m.orientation * (1.0 / m.orientation.length());
        let torque = inertia.momentum(turning.acceleration(unit), axis) - m.angular * turning.drag;
        let spun = DQuat::from_xyzw(turn.x, turn.y, turn.z, 0.0) * m.orientation * 0.5;
        pack(
            &RigidBodyState {
                position: m.momentum / body.mass_g,
                momentum: forces.force(m.position) - m.momentum * body.drag_per_s,
                orientation: spun,
                angular: torque,
            },
            out,
        );
    };
    let by_state = |y: &[f64], v: &[f64], out: &mut [f64]| {
        // The derivative along v. A good approximation is sufficient for Newton's iteration.
        let size = v.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        if size == 0.0 {
            out.fill(0.0);
            return;
        }
        let h = 1e-6 / size;
        let [mut ahead, mut behind] = [[0.0; N]; 2];
        let moved = |sign: f64| -> [f64; N] { std::array::from_fn(|n| y[n] + sign * h * v[n]) };
        rate(&moved(1.0), &mut ahead);
        rate(&moved(-1.0), &mut behind);
        for n in 0..N {
            out[n] = (ahead[n] - behind[n]) / (2.0 * h);
        }
    };
    let tolerance = if solver == Solver::Bdf { 1e-11 } else { 1e-13 };
    let problem = OdeBuilder::<NalgebraMat<f64>>::new()
        .rtol(tolerance)
        .atol([tolerance])
        .rhs_implicit(
            |y: &[f64], _: &[f64], _: f64, out: &mut [f64]| rate(y, out),
            |y: &[f64], _: &[f64], _: f64, v: &[f64], out: &mut [f64]| by_state(y, v, out),
        )
        .init(|_: &[f64], _: f64, y: &mut [f64]| pack(start, y), N)
        .build()?;
    match solver {
        Solver::Bdf => reach(problem.bdf::<NalgebraLU<f64>>()?, times),
        Solver::Tsit45 => reach(problem.tsit45()?, times),
    }
}

/// Runs a solver to each of `times`, s.
fn reach<'a, E>(mut solver: impl OdeSolverMethod<'a, E>, times: &[f64]) -> Result<Vec<RigidBodyState>, DiffsolError>
where
    E: OdeEquations<T = f64> + 'a,
{
    let mut found = Vec::with_capacity(times.len());
    for &t in times {
        solver.set_stop_time(t)?;
        while !matches!(solver.step()?, OdeSolverStopReason::TstopReached) {}
        found.push(unpack(&solver.state().y.clone_as_vec()));
    }
    Ok(found)
}

fn pack(m: &RigidBodyState, out: &mut [f64]) {
    let q = m.orientation.to_array();
    let all = m.position.to_array().into_iter().chain(m.momentum.to_array()).chain(q).chain(m.angular.to_array());
    out.iter_mut().zip(all).for_each(|(to, x)| *to = x);
}

fn unpack(y: &[f64]) -> RigidBodyState {
    let v = |n: usize| DVec3::new(y[n], y[n + 1], y[n + 2]);
    RigidBodyState {
        position: v(0),
        momentum: v(3),
        orientation: DQuat::from_xyzw(y[6], y[7], y[8], y[9]),
        angular: v(10),
    }
}

/// Against a known motion: a spinning cylinder that falls against its drag.
#[test]
fn two_solvers_find_the_exact_motion() {
    let body = Body { drag_per_s: 2.0, ..Body::default() };
    let turning = Turning { drag: 0.5, ..Turning::FREE };
    let start = RigidBodyState {
        position: DVec3::ZERO,
        momentum: DVec3::X,
        orientation: exp(DVec3::new(0.2, 0.7, -0.4)),
        angular: DVec3::new(4.0, -2.0, 3.0),
    };
    let force = DVec3::new(0.0, 0.0, -3.0);
    for solver in [Solver::Bdf, Solver::Tsit45] {
        for m in solve(solver, &body, &start, &force, &turning, &[0.5, 2.0]).unwrap().into_iter().skip(1) {
            let decay = (-4f64).exp();
            let x = DVec3::X * ((1.0 - decay) / 2.0) + force * (2.0 - (1.0 - decay) / 2.0) / 2.0;
            let exact = turn(start.orientation, start.angular, &body.inertia(), 0.5, 2.0);
            assert!(m.position.distance(x) < 1e-8, "{solver:?}: {} for {x}", m.position);
            assert!(angle(m.orientation, exact) < 1e-8, "{solver:?}: {}", angle(m.orientation, exact));
        }
    }
}

/// Compares the report's reference with both solvers, on the flights for which the report uses it.
#[test]
fn the_reference_is_as_accurate_as_it_claims() {
    let body = Body::default();
    let (begun, turning) = (start(&body), turning());
    for case in &CASES {
        let force = forces(case.wall_energy);
        let reference = study::solve(&body, &begun, &force, &turning, SECONDS);
        for (solver, held_to) in [(Solver::Tsit45, study::ACCURACY), (Solver::Bdf, [2e-9, 2e-10])] {
            let other = solve(solver, &body, &begun, &force, &turning, &[SECONDS]).unwrap()[0];
            let [mm, rad] = errors(&reference, &other);
            println!("{}, {solver:?}: {mm:.1e} mm, {rad:.1e} rad", case.name);
            assert!(mm < held_to[0] && rad < held_to[1], "{}, {solver:?}: {mm:e} mm, {rad:e} rad", case.name);
        }
    }
}
