//! Tests of every method against known solutions and at extreme parameters.

use glam::{DMat3, DQuat, DVec3};

use super::*;
use crate::dynamics::body::Body;
use crate::dynamics::forces::Forces;
use crate::dynamics::rigid::{RigidBodyState, Turning, angle, free};
use crate::dynamics::step;

/// A pendulum in each direction: smooth and nonlinear, with a derivative that is constant nowhere.
struct Waves;

impl Forces for Waves {
    fn force(&self, at: DVec3) -> DVec3 {
        -DVec3::new(at.x.sin() * 4.0, (2.0 * at.y).sin() * 3.0 + at.x * at.y, at.z.sinh() + 0.3 * at.x)
    }

    fn slope(&self, at: DVec3) -> DMat3 {
        DMat3::from_cols(
            DVec3::new(-4.0 * at.x.cos(), -at.y, -0.3),
            DVec3::new(0.0, -6.0 * (2.0 * at.y).cos() - at.x, 0.0),
            DVec3::new(0.0, 0.0, -at.z.cosh()),
        )
    }
}

fn start() -> RigidBodyState {
    RigidBodyState {
        position: DVec3::new(0.7, -0.3, 0.5),
        momentum: DVec3::new(1.0, 0.4, -0.6),
        orientation: free::exp(DVec3::new(0.5, -0.2, 0.9)),
        angular: DVec3::new(0.8, -1.1, 0.5),
    }
}

fn body() -> Body {
    let cylinder = (Some(1.0), Some(1.0));
    Body {
        drag_per_s: 1.3,
        mass_g: 2.0,
        cylinder_radius_mm: cylinder.0,
        cylinder_length_mm: cylinder.1,
        ..Body::default()
    }
}

fn fly(method: &dyn Stepper, turning: &Turning, seconds: f64, steps: u32) -> RigidBodyState {
    let h = seconds / f64::from(steps);
    (0..steps).fold(start(), |m, _| step::integrate(method, &body(), &m, &Waves, turning, h).0)
}

/// A fifth-order step without error control.
struct Fixed5;

impl Stepper for Fixed5 {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        DormandPrince::fixed(system, y, h, cost)
    }
    fn order(&self) -> u32 {
        5
    }
}

/// Halving the step divides the error by two to the power of the order, in position and in angle.
#[test]
fn orders_are_those_of_theory() {
    let turning =
        Turning { push: DVec3::new(0.4, -0.3, 0.8), ..Turning::towards(DVec3::new(1.0, 0.4, -0.5), 0.8, 2.0) };
    let reference = fly(&Fixed5, &turning, 2.0, 4000);
    let all: [(&str, &dyn Stepper, u32); 8] = [
        ("explicit-euler", &ExplicitEuler, 1280),
        ("semi-implicit-euler", &SemiImplicitEuler, 1280),
        ("exponential-euler", &ExponentialEuler, 1280),
        ("backward-euler", &BackwardEuler, 1280),
        ("implicit-midpoint", &ImplicitMidpoint, 160),
        ("rosenbrock", &Rosenbrock, 160),
        ("rk4", &Rk4, 80),
        ("dormand-prince", &Fixed5, 40),
    ];
    for (name, method, steps) in all {
        let errors = [steps, 2 * steps].map(|n| {
            let end = fly(method, &turning, 2.0, n);
            [end.position.distance(reference.position), angle(end.orientation, reference.orientation)]
        });
        for (n, what) in ["position", "orientation"].into_iter().enumerate() {
            let order = (errors[0][n] / errors[1][n]).log2();
            println!("{name}, {what}: order {order:.2}, error {:.1e}", errors[1][n]);
            // On a nearly linear system, the order-5 term of Dormand and Prince's error is so small (z⁶/3600) that the
            // next term hides it. The measured order may exceed the nominal one.
            let more = if (name, what) == ("dormand-prince", "orientation") { 1.0 } else { 0.2 };
            let theory = f64::from(method.order());
            assert!(order > theory - 0.2 && order < theory + more, "{name}, {what}: {order} ({errors:?})");
        }
    }
}

#[test]
fn adaptive_methods_keep_their_tolerance() {
    let turning = Turning::towards(DVec3::new(1.0, 0.4, -0.5), 0.8, 2.0);
    let reference = fly(&Fixed5, &turning, 2.0, 4000);
    for tolerance in [1e-3, 1e-5, 1e-7] {
        let control = Control { tolerance, most_parts: 2000 };
        for method in [&DormandPrince(control) as &dyn Stepper, &RosenbrockAdaptive(control)] {
            let end = fly(method, &turning, 2.0, 4);
            let error = end.position.distance(reference.position);
            assert!(error < 30.0 * tolerance, "{error} for {tolerance}");
        }
    }
}

/// A well too stiff for any explicit step of this size.
#[test]
fn implicit_methods_are_stable_where_explicit_ones_are_not() {
    struct Spring(f64);
    impl Forces for Spring {
        fn force(&self, at: DVec3) -> DVec3 {
            at * -self.0
        }
        fn slope(&self, _: DVec3) -> DMat3 {
            DMat3::IDENTITY * -self.0
        }
    }
    let body = Body { drag_per_s: 1.0, ..Body::default() };
    for omega in [1e2, 1e5, 1e9] {
        for (integrator, name) in Integrator::ALL {
            let mut m = RigidBodyState { angular: DVec3::ZERO, ..start() };
            for _ in 0..200 {
                m = step::integrate(integrator.stepper(), &body, &m, &Spring(omega * omega), &Turning::FREE, 0.1).0;
            }
            use Integrator::{BackwardEuler as B, ImplicitMidpoint as M, Rosenbrock as R};
            if matches!(integrator, B | M | R) {
                assert!(m.position.length() < 2.0, "{name}: {}", m.position);
            } else if integrator != Integrator::DormandPrince {
                assert!(m.position.length() > 1e3 || !m.position.is_finite(), "{name} is reported unstable here");
            }
        }
    }
}

/// All combinations of extreme parameters. Every run terminates: evaluations are bounded.
#[test]
fn past_reason_everything_stays_finite() {
    struct Forced(f64);
    impl Forces for Forced {
        fn force(&self, at: DVec3) -> DVec3 {
            DVec3::splat(1e9) - at * self.0
        }
        fn slope(&self, _: DVec3) -> DMat3 {
            DMat3::IDENTITY * -self.0
        }
    }
    let mut rates = 0;
    for (integrator, name) in Integrator::ALL {
        for dt in [1e-6, crate::dynamics::STEP_S, 1.0, 10.0] {
            for mass_g in [1e-6, 1.0, 1e6] {
                for c_s in [1e-9, 1.0, 1e9] {
                    for (r, l) in [(1.0, 2.0), (1e-6, 2.9), (1.49, 1e-6)] {
                        let body = Body {
                            mass_g,
                            cylinder_radius_mm: Some(r),
                            cylinder_length_mm: Some(l),
                            ..Body::default()
                        };
                        body.check().unwrap();
                        let j = body.inertia();
                        let q = start().orientation;
                        let spin = j.momentum(DVec3::new(0.6, 0.0, 0.8) * 1e4, q * DVec3::Z);
                        let mut m = RigidBodyState { orientation: q, angular: spin, ..start() };
                        for turning in [
                            Turning::towards(DVec3::Y, 0.45, 1.8),
                            Turning { push: DVec3::splat(1e9), ..Turning::FREE },
                        ] {
                            for _ in 0..3 {
                                let (next, cost) =
                                    step::integrate(integrator.stepper(), &body, &m, &Forced(c_s), &turning, dt);
                                assert!(next.is_finite(), "{name} {dt} {mass_g} {c_s} {r}x{l}: {next:?}");
                                assert!((next.orientation.length() - 1.0).abs() < 1e-9);
                                assert!(cost.rates < 20_000, "{name}: {cost:?}");
                                rates += u64::from(cost.rates);
                                m = RigidBodyState { position: start().position, ..next };
                            }
                        }
                    }
                }
            }
        }
    }
    assert!(rates > 0);
}

#[test]
fn free_bodies_keep_their_momenta() {
    let body = Body { drag_per_s: 0.0, ..body() };
    let j = body.inertia();
    for (integrator, name) in Integrator::ALL {
        let mut m = RigidBodyState {
            angular: j.momentum(DVec3::new(1e4, 2e3, -5e3), start().orientation * DVec3::Z),
            ..start()
        };
        let begun = m;
        let energy = |m: &RigidBodyState| j.energy(m.angular, m.orientation * DVec3::Z);
        for _ in 0..1000 {
            m = step::integrate(integrator.stepper(), &body, &m, &DVec3::ZERO, &Turning::FREE, crate::dynamics::STEP_S)
                .0;
        }
        assert!((m.momentum - begun.momentum).length() < 1e-12 * begun.momentum.length(), "{name}");
        assert!((m.angular - begun.angular).length() < 1e-12 * begun.angular.length(), "{name}");
        assert!((energy(&m) / energy(&begun) - 1.0).abs() < 1e-9, "{name}: {}", energy(&m) / energy(&begun));
        let exact = free::turn(begun.orientation, begun.angular, &j, 0.0, 1000.0 / 120.0);
        let off = angle(m.orientation, exact);
        assert!(off < 1e-6, "{name}: {off}");
    }
}

#[test]
fn the_view_arrives_without_overshoot_and_the_horizon_stays() {
    for (integrator, name) in Integrator::ALL {
        for dt in [crate::dynamics::STEP_S, 0.05] {
            let body = Body::default();
            let mut m = RigidBodyState { angular: DVec3::ZERO, orientation: DQuat::IDENTITY, ..start() };
            let target = m.orientation * DVec3::new(1.0, 0.0, 0.3).normalize();
            let turning = Turning::towards(target, 0.45, 1.8);
            let (mut last, mut fastest) = (f64::INFINITY, 0.0f64);
            for _ in 0..(8.0 / dt) as usize {
                let before = m.orientation * DVec3::Z;
                m = step::integrate(integrator.stepper(), &body, &m, &DVec3::ZERO, &turning, dt).0;
                let view = m.orientation * DVec3::Z;
                fastest = fastest.max(before.angle_between(view) / dt);
                let left = view.angle_between(target);
                assert!(left < last + 0.005, "{name} {dt}: it comes nearer in each step: {left} after {last}");
                last = left;
            }
            assert!(last < 1e-3 && fastest < 1.9, "{name} {dt}: {last} rad left, {fastest} rad/s");
            // The target is level, so up stays up.
            assert!((m.orientation * DVec3::Y).dot(DVec3::Y) > 1.0 - 1e-9, "{name}");
        }
    }
}
