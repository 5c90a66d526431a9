use std::sync::Arc;

use glam::DMat3;

use super::*;
use crate::dynamics::{self, Attitude, Integrator};
use crate::fields::Sample;
use crate::fields::clearance::TOLERANCE_MM;
use crate::testing::{Room, TestApp};

/// A body of 2.5 g in a room of 16 × 40 × 20 mm, by a method that is exact for constant forces.
fn body() -> (TestApp, Room) {
    let room = Room::new([16, 40, 20]);
    let mut test = TestApp::new(&room);
    let integrator = Integrator::ExponentialEuler;
    test.app.equip(Body(dynamics::Body { mass_g: 2.5, integrator, ..dynamics::Body::default() }));
    plugin(&mut test.app).unwrap();
    (test, room)
}

#[track_caller]
fn near(a: DVec3, b: DVec3, within: f64) {
    assert!(a.distance(b) <= within, "{a}, not {b}");
}

/// Speed and distance after `t` seconds at a constant acceleration from rest, against a drag of 6/s.
fn driven(a: DVec3, t: f64) -> (DVec3, DVec3) {
    let gone = 1.0 - (-6.0 * t).exp();
    (a / 6.0 * gone, a / 6.0 * (t - gone / 6.0))
}

fn thrust() -> GuideThrust {
    let [thrust, wall] = [DVec3::X * 300.0, DVec3::Z * 1000.0];
    GuideThrust { thrust, wall, limit: 100.0, look_direction: DVec3::ZERO, exact: false }
}

const MINES: MinePush = MinePush(DVec3::new(0.0, 400.0, 0.0));

fn flight(state: State) -> Flight {
    Flight { state, ..Flight::default() }
}

/// 300 and 400 are 500 together, and a limit of 100 leaves a fifth.
#[test]
fn the_limit_is_on_thrust_and_mines_together_and_not_on_the_wall() {
    let flying = flight(State::Flying);
    let all = acting(&flying, None, Some(&thrust()), Some(&MINES));
    near(all.drive, DVec3::new(60.0, 80.0, 0.0), 1e-9);
    near(all.mines, DVec3::new(0.0, 80.0, 0.0), 1e-9);
    assert_eq!((all.wall, all.hand), (DVec3::Z * 1000.0, DVec3::ZERO));
    near(all.sum(), DVec3::new(60.0, 80.0, 1000.0), 1e-9);
    let below = acting(&flying, None, Some(&GuideThrust { limit: 501.0, ..thrust() }), Some(&MINES));
    assert_eq!(below.drive, DVec3::new(300.0, 400.0, 0.0));
    near(below.mines, MINES.0, 1e-9);
    assert_eq!(acting(&flying, None, Some(&thrust()), None).drive, DVec3::X * 100.0);
    assert_eq!(acting(&flying, None, None, Some(&MINES)), Acting::default(), "mines belong to a guide");
}

#[test]
fn the_operators_speed_and_share_act_on_the_drive_beyond_the_limit() {
    let hand = Hand { speed: 3.0, guided: 0.5, acceleration: DVec3::X * 7.0, ..Hand::default() };
    let all = acting(&flight(State::Flying), Some(&hand), Some(&thrust()), Some(&MINES));
    near(all.drive, DVec3::new(90.0, 120.0, 0.0), 1e-9);
    near(all.mines, DVec3::new(0.0, 120.0, 0.0), 1e-9);
    assert_eq!((all.wall, all.hand), (DVec3::Z * 1000.0, DVec3::X * 7.0));
    near(all.sum(), DVec3::new(97.0, 120.0, 1000.0), 1e-9);
}

#[test]
fn a_flight_that_has_stopped_is_not_driven_and_the_wall_still_acts() {
    for state in [State::Arrived, State::Operator, State::Ended] {
        let all = acting(&flight(state), Some(&Hand::default()), Some(&thrust()), Some(&MINES));
        assert_eq!(all, Acting { wall: DVec3::Z * 1000.0, ..Acting::default() }, "{state:?}");
        let exact = GuideThrust { exact: true, ..thrust() };
        let hand = Hand { speed: 3.0, guided: 0.0, ..Hand::default() };
        let all = acting(&flight(state), Some(&hand), Some(&exact), Some(&MINES));
        assert_eq!(all.drive, DVec3::X * 300.0, "a plan's thrust acts unchanged");
        assert_eq!(all.mines, DVec3::ZERO);
    }
}

#[test]
fn a_paused_body_is_driven_by_the_push_alone() {
    let acceleration = DVec3::Y * 5.0;
    let idle = Hand { paused: true, guided: 1.0, acceleration, ..Hand::default() };
    for exact in [false, true] {
        let guide = GuideThrust { exact, ..thrust() };
        let all = acting(&flight(State::Flying), Some(&idle), Some(&guide), Some(&MINES));
        assert_eq!(all, Acting { hand: acceleration, ..Acting::default() });
    }
    let pushed = Hand { push: DVec3::Z, guided: 0.0, ..idle };
    let all = acting(&flight(State::Flying), Some(&pushed), Some(&thrust()), Some(&MINES));
    assert_eq!(all, Acting { hand: acceleration, wall: DVec3::Z * 1000.0, ..Acting::default() });
}

#[test]
fn the_sum_is_that_of_this_step() {
    let (mut test, _) = body();
    test.app.equip((thrust(), MINES));
    test.app.camera().insert(Acceleration(DVec3::splat(9.0)));
    test.steps(1).unwrap();
    near(test.get::<Acceleration>().0, DVec3::new(60.0, 80.0, 1000.0), 1e-9);
    test.app.camera().remove::<(GuideThrust, MinePush)>();
    test.steps(1).unwrap();
    assert_eq!(test.get::<Acceleration>().0, DVec3::ZERO);
}

#[test]
fn a_guides_nonsense_counts_as_zero_and_is_told() {
    let (mut test, _) = body();
    test.app.world.insert_resource(GuideName("odd"));
    test.app.equip(GuideThrust { thrust: DVec3::new(1.0, f64::NAN, 0.0), wall: DVec3::X * 5.0, ..thrust() });
    test.steps(2).unwrap();
    assert_eq!(test.get::<Acceleration>().0, DVec3::X * 5.0);
    assert_eq!(test.get::<GuideThrust>().thrust, DVec3::ZERO);
    assert_eq!(test.app.take_notes(), ["guide odd gave an invalid thrust: it counts as zero"]);
}

#[test]
fn of_a_force_that_is_no_number_only_the_hand_is_left() {
    let (mut test, _) = body();
    test.app.equip((thrust(), MinePush(DVec3::NAN), Hand { acceleration: DVec3::Y * 3.0, ..Hand::default() }));
    test.steps(1).unwrap();
    assert_eq!(test.get::<Acceleration>().0, DVec3::Y * 3.0);
    assert_eq!(test.app.take_notes(), ["a force is not finite: operator input only"]);
    test.get_mut::<Hand>().acceleration = DVec3::X * f64::INFINITY;
    test.steps(1).unwrap();
    assert_eq!(test.get::<Acceleration>().0, DVec3::ZERO);
    assert!(test.get::<Pose>().position.is_finite());
}

/// `v = v₀ e^(−k t)` and `x = v₀ (1 − e^(−k t))/k`.
#[test]
fn free_drift_decays_with_the_drag_at_any_step() {
    for (integrator, hz, within) in [
        (Integrator::ExponentialEuler, 120, 1e-10),
        (Integrator::ExponentialEuler, 50, 1e-10),
        (Integrator::Rosenbrock, 120, 1e-4),
        (Integrator::Rosenbrock, 240, 2e-5),
    ] {
        let (mut test, room) = body();
        test.app.world.resource_mut::<Clock>().hz = hz;
        test.get_mut::<Body>().0.integrator = integrator;
        test.get_mut::<Flight>().length_mm = 7.0;
        let speed = DVec3::new(6.0, 18.0, -4.0);
        test.get_mut::<Velocity>().0 = speed;
        for n in 1..=hz / 2 {
            test.steps(1).unwrap();
            let decay = (-6.0 * f64::from(n) / f64::from(hz)).exp();
            near(test.get::<Velocity>().0 / 18.0, speed * decay / 18.0, within);
            let moved = test.get::<Pose>().position - room.centre();
            near(moved, speed * ((1.0 - decay) / 6.0), within * 10.0);
            let flight = test.get::<Flight>();
            assert!((flight.length_mm - 7.0 - moved.length()).abs() < 1e-9, "the distance moved is added up");
            let clearance = test.get::<Contact>().clearance_mm;
            let at = test.get::<Pose>().position;
            assert_eq!(clearance, test.app.scan_get::<Walls>().unwrap().0.at(at).mm, "measured where it is now");
            let below = room.clearance_mm(at) - clearance;
            assert!((-1e-3..=TOLERANCE_MM + 1e-3).contains(&below), "{below}");
            assert_eq!(test.get::<Contact>().stuck_steps, 0);
        }
    }
}

#[test]
fn a_constant_force_drives_any_mass_alike() {
    let (mut test, room) = body();
    test.app.equip((GuideThrust { wall: DVec3::ZERO, ..thrust() }, MINES));
    test.steps(60).unwrap();
    let (speed, way) = driven(DVec3::new(60.0, 80.0, 0.0), 0.5);
    near(test.get::<Velocity>().0, speed, 1e-9);
    near(test.get::<Pose>().position - room.centre(), way, 1e-9);
}

#[test]
fn the_wall_stops_the_body() {
    let (mut test, room) = body();
    test.get_mut::<Velocity>().0 = DVec3::X * 300.0;
    test.steps(60).unwrap();
    let at = test.get::<Pose>().position;
    let clearance = room.clearance_mm(at);
    assert!(at.x > 8.0 && (1.5..1.7).contains(&clearance), "{at}");
    // Free drift would have left 15 mm/s.
    let velocity = test.get::<Velocity>().0;
    assert!(velocity.length() < 1.0, "the momentum into the wall is lost: {velocity}");
    assert_eq!(test.get::<Contact>().stuck_steps, 0, "a body at the wall is free");
}

#[test]
fn steps_in_the_wall_are_counted_in_a_row() {
    let (mut test, room) = body();
    let inside = room.centre().with_x(0.5);
    test.place(inside);
    test.get_mut::<Velocity>().0 = DVec3::NEG_X * 20.0;
    for n in 1..=5 {
        test.steps(1).unwrap();
        assert_eq!(test.get::<Contact>().stuck_steps, n);
        assert_eq!((test.get::<Pose>().position, test.get::<Velocity>().0), (inside, DVec3::ZERO));
        assert!((0.449..=0.501).contains(&test.get::<Contact>().clearance_mm));
    }
    assert_eq!(test.get::<Flight>().length_mm, 0.0);
    test.place(room.centre());
    test.steps(1).unwrap();
    assert_eq!(test.get::<Contact>().stuck_steps, 0, "free");
    test.place(inside);
    test.steps(2).unwrap();
    assert_eq!(test.get::<Contact>().stuck_steps, 2, "counted anew");
    test.get_mut::<Contact>().stuck_steps = u32::MAX;
    test.steps(1).unwrap();
    assert_eq!(test.get::<Contact>().stuck_steps, u32::MAX);
    test.app.equip(GuideThrust { wall: DVec3::X * 6000.0, ..GuideThrust::default() });
    test.steps(5).unwrap();
    assert_eq!(test.get::<Contact>().stuck_steps, 0, "on its way out");
    assert!(test.get::<Pose>().position.x > inside.x);
}

#[test]
fn the_heading_follows_the_velocity_after_the_step() {
    let (mut test, _) = body();
    let share = 1.0 - (-1.0 / 120.0 / 0.25f64).exp();
    test.get_mut::<Heading>().0 = DVec3::X;
    test.get_mut::<Velocity>().0 = DVec3::Y * 30.0;
    test.steps(1).unwrap();
    near(test.get::<Heading>().0, (DVec3::X + (DVec3::Y - DVec3::X) * share).normalize(), 1e-9);
    test.get_mut::<Heading>().0 = DVec3::Z;
    test.get_mut::<Velocity>().0 = DVec3::Y * 2.05;
    test.steps(1).unwrap();
    assert_eq!(test.get::<Heading>().0, DVec3::Z, "after the step it is slower than 2 mm/s");
}

#[test]
fn setting_off_takes_a_new_heading_if_there_is_one() {
    let (mut test, _) = body();
    test.get_mut::<Heading>().0 = DVec3::X;
    let entity = test.app.camera_id();
    test.app.world.trigger(SetOff { entity, heading: None, clear_mines: true });
    assert_eq!(test.get::<Heading>().0, DVec3::X);
    let other = test.app.world.spawn(Heading(DVec3::X)).id();
    test.app.world.trigger(SetOff { entity: other, heading: Some(DVec3::Z), clear_mines: true });
    assert_eq!(test.get::<Heading>().0, DVec3::X);
    test.app.world.trigger(SetOff { entity, heading: Some(DVec3::NEG_Y), clear_mines: false });
    assert_eq!(test.get::<Heading>().0, DVec3::NEG_Y);
}

fn odd() -> Attitude {
    Attitude::new(DVec3::new(0.3, 0.9, 0.1), DVec3::new(0.2, 0.1, 1.0))
}

fn turn_to(test: &mut TestApp, attitude: Attitude) {
    test.get_mut::<Pose>().attitude = attitude;
}

fn view(test: &TestApp) -> Attitude {
    test.get::<Pose>().attitude
}

#[test]
fn a_view_at_rest_keeps_its_bits() {
    let (mut test, _) = body();
    turn_to(&mut test, odd());
    // A spin below 1e-6 rad/s is none.
    let inertia = test.get::<Body>().0.inertia();
    test.get_mut::<AngularMomentum>().0 = DVec3::X * (0.9e-6 * inertia.transverse.min(inertia.axial));
    test.get_mut::<Velocity>().0 = DVec3::Y * 10.0;
    for hand in [false, true] {
        if hand {
            test.app.equip(Hand::default());
        }
        test.steps(50).unwrap();
        assert_eq!(view(&test), odd());
        assert_eq!(test.get::<AngularMomentum>().0, DVec3::ZERO);
    }
    test.get_mut::<AngularMomentum>().0 = DVec3::X * (1e-3 * inertia.transverse.max(inertia.axial));
    test.steps(1).unwrap();
    assert_ne!(view(&test), odd(), "a spin of 1e-3 rad/s turns it");
    assert_ne!(test.get::<AngularMomentum>().0, DVec3::ZERO);
}

/// The rate approaches the one asked for as `1 − e^(−15 t)`, and dies away alike.
#[test]
fn a_turn_by_hand_follows_promptly_and_comes_to_rest() {
    let (mut test, _) = body();
    test.app.equip(Hand { turning: DVec3::NEG_Z * 1.2, ..Hand::default() });
    test.steps(60).unwrap();
    let gone = 1.0 - (-7.5f64).exp();
    let angle = 1.2 * (0.5 - gone / 15.0);
    near(view(&test).forward, DVec3::new(angle.sin(), angle.cos(), 0.0), 1e-4);
    near(view(&test).up, DVec3::Z, 1e-6);
    test.get_mut::<Hand>().turning = DVec3::ZERO;
    test.steps(120).unwrap();
    let angle = angle + 1.2 * gone / 15.0;
    near(view(&test).forward, DVec3::new(angle.sin(), angle.cos(), 0.0), 1e-4);
    let rest = view(&test);
    assert_eq!(test.get::<AngularMomentum>().0, DVec3::ZERO, "1.2 e^(−15) is below 1e-6");
    test.steps(10).unwrap();
    assert_eq!(view(&test), rest);
}

/// Angle of the view to +y, to the right.
fn aside(test: &TestApp) -> f64 {
    let f = view(test).forward;
    f.x.atan2(f.y)
}

fn look_at(angle: f64) -> GuideThrust {
    GuideThrust { look_direction: DVec3::new(angle.sin(), angle.cos(), 0.0), ..GuideThrust::default() }
}

/// `e = e₀ (1 + ω t) e^(−ω t)` with `ω = 2/0.45 s`: after 0.45 s, `3 e^(−2)` of it is left.
#[test]
fn the_view_follows_the_path_critically_damped() {
    let (mut test, _) = body();
    test.app.equip(look_at(0.02));
    test.steps(54).unwrap();
    let left = 0.02 - aside(&test);
    assert!((left / (0.06 * (-2f64).exp()) - 1.0).abs() < 0.01, "{left}");
    assert!(view(&test).up.distance(DVec3::Z) < 1e-9, "no roll");
    // A long turn goes on at nearly 1.8 rad/s, and no faster.
    let (mut test, _) = body();
    test.app.equip(look_at(2.9));
    let mut fastest = 0.0f64;
    for _ in 0..150 {
        let before = aside(&test);
        test.steps(1).unwrap();
        fastest = fastest.max((aside(&test) - before) * 120.0);
    }
    assert!((1.6..1.8).contains(&fastest), "{fastest}");
}

#[test]
fn the_view_follows_the_path_only_while_the_guide_flies_and_nobody_looks_aside() {
    let still = |flight: State, hand: Option<Hand>, ticks: u32| {
        let (mut test, _) = body();
        turn_to(&mut test, odd());
        test.get_mut::<Flight>().state = flight;
        test.app.equip(look_at(1.0));
        if let Some(hand) = hand {
            test.app.equip(hand);
        }
        test.steps(ticks).unwrap();
        view(&test) == odd()
    };
    let hand = Hand::default();
    assert!(!still(State::Flying, None, 2) && !still(State::Flying, Some(hand), 2));
    for state in [State::Arrived, State::Operator, State::Ended] {
        assert!(still(state, None, 5), "{state:?}");
    }
    assert!(still(State::Flying, Some(Hand { paused: true, ..hand }), 5));
    for hand in [Hand { on_until: 5, ..hand }, Hand { looking_until: 5, ..hand }] {
        assert!(still(State::Flying, Some(hand), 5), "{hand:?}");
        assert!(!still(State::Flying, Some(hand), 7), "from tick 5 on it turns: {hand:?}");
    }
    assert!(!still(State::Flying, Some(Hand { turned_until: 5, ..hand }), 2), "a roll does not hold it");
}

/// The rate approaches 1.2 rad/s with twice `ω`.
#[test]
fn the_operator_may_roll_the_view_while_it_follows_the_path() {
    let (mut test, _) = body();
    test.app.equip((look_at(0.0), Hand { turning: DVec3::Y * 1.2, ..Hand::default() }));
    test.steps(60).unwrap();
    let k: f64 = 4.0 / 0.45;
    let angle = 1.2 * (0.5 - (1.0 - (-0.5 * k).exp()) / k);
    near(view(&test).forward, DVec3::Y, 1e-9);
    near(view(&test).up, DVec3::new(angle.sin(), 0.0, angle.cos()), 1e-4);
}

/// A distance of 5 mm everywhere, along a gradient.
struct Slope(DVec3);

impl Distance for Slope {
    fn sample(&self, _: DVec3) -> Option<Sample> {
        Some(Sample { mm: 5.0, gradient: self.0, hessian: DMat3::ZERO })
    }
}

/// Returns the velocity after a tenth of a second in a potential: a pull of 180 along +x, and half-way into a reach of
/// 10 mm the wall's `2 C_s (p/D − 1) p/D²`, 80 along +z.
fn velocity_in_a_potential(state: State, hand: Option<Hand>, target: bool) -> DVec3 {
    let (mut test, _) = body();
    test.get_mut::<Flight>().state = state;
    let target = target.then(|| Arc::new(Slope(DVec3::NEG_X)) as _);
    test.app.equip(PotentialField { potential: Potential::default(), wall: Arc::new(Slope(DVec3::Z)), target });
    if let Some(hand) = hand {
        test.app.equip(hand);
    }
    test.steps(12).unwrap();
    test.get::<Velocity>().0
}

#[test]
fn a_potential_is_a_force_on_the_mass_beside_the_hand() {
    let hand = Hand::default();
    let [pull, wall, push] = [DVec3::X * (180.0 / 2.5), DVec3::Z * (80.0 / 2.5), DVec3::Y * 50.0];
    for (state, hand, target, acceleration) in [
        (State::Flying, None, true, pull + wall),
        (State::Flying, Some(hand), true, pull + wall),
        (State::Flying, Some(hand), false, wall),
        (State::Flying, Some(Hand { speed: 2.0, guided: 0.5, ..hand }), true, pull + wall),
        (State::Flying, Some(Hand { speed: 3.0, ..hand }), true, pull * 3.0 + wall),
        (State::Flying, Some(Hand { guided: 0.0, acceleration: push, ..hand }), true, wall + push),
        (State::Arrived, Some(hand), true, wall),
        (State::Operator, None, true, wall),
        (State::Flying, Some(Hand { paused: true, ..hand }), true, DVec3::ZERO),
        (State::Flying, Some(Hand { paused: true, acceleration: push, ..hand }), true, push),
        (
            State::Flying,
            Some(Hand { paused: true, guided: 0.0, push: DVec3::Z, acceleration: push, ..hand }),
            true,
            wall + push,
        ),
    ] {
        let velocity = velocity_in_a_potential(state, hand, target);
        near(velocity, driven(acceleration, 0.1).0, 1e-9);
    }
}

#[test]
fn other_entities_do_not_move() {
    let (mut test, room) = body();
    let twin = (Body(dynamics::Body::default()), Velocity(DVec3::X * 9.0), Acceleration(DVec3::Y), *test.get::<Pose>());
    let twin = test.app.world.spawn((twin, Flight::default(), thrust(), Hand::default(), Heading(DVec3::Z))).id();
    test.get_mut::<Velocity>().0 = DVec3::Y * 9.0;
    test.steps(5).unwrap();
    assert!(test.get::<Pose>().position.y > room.centre().y, "the camera does");
    let world = &test.app.world;
    assert_eq!(world.get::<Pose>(twin).unwrap().position, room.centre());
    assert_eq!(world.get::<Velocity>(twin).unwrap().0, DVec3::X * 9.0);
    assert_eq!(world.get::<Acceleration>(twin).unwrap().0, DVec3::Y);
    assert_eq!(world.get::<Heading>(twin).unwrap().0, DVec3::Z);
    assert_eq!(world.get::<Flight>(twin).unwrap().length_mm, 0.0);
}
