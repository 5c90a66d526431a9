use super::*;
use crate::components::camera::Velocity;
use crate::dynamics::{self, Attitude};
use crate::testing::{Room, TestApp};

/// The cameras that were taken over, in order.
#[derive(Resource, Default)]
struct Taken(Vec<Entity>);

/// A camera at rest that obeys the operator, with a drag of 4/s.
fn camera() -> TestApp {
    let mut test = TestApp::new(&Room::new([20; 3]));
    test.app.equip(Body(dynamics::Body { drag_per_s: 4.0, ..dynamics::Body::default() }));
    plugin(&mut test.app).unwrap();
    test.app.world.init_resource::<Taken>();
    test.app.observe(|taken: On<TakenOver>, mut all: ResMut<Taken>| all.0.push(taken.entity));
    test
}

fn set_hz(test: &mut TestApp, hz: u32) {
    test.app.world.resource_mut::<Clock>().hz = hz;
}

fn give(test: &mut TestApp, command: HandCommand) {
    test.script([(test.tick(), command)]);
    test.steps(1).unwrap();
}

fn takeovers(test: &TestApp) -> usize {
    test.app.world.resource::<Taken>().0.len()
}

fn view(test: &TestApp) -> Attitude {
    test.get::<Pose>().attitude
}

#[track_caller]
fn near(a: DVec3, b: impl Into<DVec3>) {
    let b = b.into();
    assert!(a.distance(b) < 1e-12, "{a}, not {b}");
}

#[test]
fn the_speed_is_kept_within_a_tenth_and_five() {
    let mut test = camera();
    assert_eq!(test.get::<Hand>().speed, 1.0);
    for (asked, kept) in [
        (20.0, 5.0),
        (0.0, 0.1),
        (5.0, 5.0),
        (-3.0, 0.1),
        (2.5, 2.5),
        (f64::NAN, 2.5),
        (f64::INFINITY, 2.5),
        (0.1, 0.1),
        (1e-9, 0.1),
        (4.9, 4.9),
    ] {
        give(&mut test, HandCommand::Speed(asked));
        assert_eq!(test.get::<Hand>().speed, kept, "Speed({asked})");
        assert!(test.app.world.resource::<Inbox>().0.is_empty(), "every command is carried out once");
    }
}

#[test]
fn a_push_is_at_most_one_along_each_axis_and_builds_up_in_the_world() {
    let mut test = camera();
    set_hz(&mut test, 100);
    give(&mut test, HandCommand::Push([3.0, -7.0, f64::NAN]));
    assert_eq!(test.get::<Hand>().push, DVec3::new(1.0, -1.0, 0.0));
    give(&mut test, HandCommand::Push([f64::INFINITY, f64::NEG_INFINITY, 0.25]));
    assert_eq!(test.get::<Hand>().push, DVec3::new(0.0, 0.0, 0.25));

    // Right, up and forward are +x, +z and +y. A full push holds 45 mm/s against the drag, and takes 60 ms to build up.
    let mut test = camera();
    set_hz(&mut test, 100);
    test.script([(0, HandCommand::Speed(2.0)), (0, HandCommand::Push([0.5, 0.25, -1.0]))]);
    test.steps(1).unwrap();
    let (asked, decay) = (DVec3::new(0.5, -1.0, 0.25) * (45.0 * 4.0 * 2.0), (-0.01 / 0.06f64).exp());
    near(test.get::<Hand>().acceleration, asked * (1.0 - decay));
    test.steps(1).unwrap();
    near(test.get::<Hand>().acceleration, asked * (1.0 - decay * decay));
    near(test.get::<Heading>().0, DVec3::new(0.5, -1.0, 0.25).normalize());
    let held = test.get::<Hand>().acceleration;
    give(&mut test, HandCommand::Push([0.0; 3]));
    near(test.get::<Hand>().acceleration, held * decay);
    near(test.get::<Heading>().0, DVec3::new(0.5, -1.0, 0.25).normalize());
    test.steps(200).unwrap();
    assert_eq!(test.get::<Hand>().acceleration, DVec3::ZERO, "none is left in the end");
}

#[test]
fn a_push_is_along_the_view_of_this_step() {
    let mut test = camera();
    test.script([(0, HandCommand::Push([0.0, 0.0, 1.0])), (0, HandCommand::Look([90.0, 0.0]))]);
    test.steps(1).unwrap();
    near(test.get::<Heading>().0, DVec3::X);
    near(test.get::<Hand>().acceleration.normalize(), DVec3::X);
}

#[test]
fn without_a_push_the_heading_is_left_alone() {
    let mut test = camera();
    test.app.camera().insert(Heading(DVec3::NEG_X));
    test.script([(0, HandCommand::Pause(true)), (1, HandCommand::Look([10.0, 5.0])), (2, HandCommand::Resume)]);
    test.steps(4).unwrap();
    assert_eq!(test.get::<Heading>().0, DVec3::NEG_X);
}

#[test]
fn the_hand_is_on_until_four_tenths_of_a_second_after_the_last_push() {
    let mut test = camera();
    test.script([(3, HandCommand::Push([0.0, 0.0, 1.0])), (10, HandCommand::Push([0.0; 3]))]);
    test.steps(3).unwrap();
    assert_eq!(test.get::<Hand>().on_until, 0);
    test.steps(1).unwrap();
    assert_eq!(test.get::<Hand>().on_until, 3 + 48, "0.4 s of 120 steps a second");
    test.steps(20).unwrap();
    assert_eq!(test.get::<Hand>().on_until, 9 + 48, "counted from the last step of the push");
    // Part of a step counts as a whole one.
    for (hz, steps) in [(100, 40), (7, 3)] {
        let mut test = camera();
        set_hz(&mut test, hz);
        give(&mut test, HandCommand::Push([1.0, 0.0, 0.0]));
        assert_eq!(test.get::<Hand>().on_until, steps, "at {hz} Hz");
    }
}

#[test]
fn only_a_push_a_pause_and_a_resume_take_over() {
    let (on, off) = (HandCommand::Push([0.0, 1.0, 0.0]), HandCommand::Push([0.0; 3]));
    let mut test = camera();
    for (command, times) in [
        (HandCommand::Look([5.0, 5.0]), 0),
        (HandCommand::Roll(5.0), 0),
        (HandCommand::Turn([1.0, 1.0, 1.0]), 0),
        (HandCommand::Turn([0.0; 3]), 0),
        (HandCommand::Speed(2.0), 0),
        (off, 0),
        (HandCommand::Pause(true), 1),
        (HandCommand::Pause(false), 1),
        (HandCommand::Resume, 1),
        (on, 1),
        (HandCommand::Speed(1.0), 1),
        (off, 0),
    ] {
        let before = takeovers(&test);
        give(&mut test, command);
        assert_eq!(takeovers(&test) - before, times, "{command:?} (the push is held meanwhile)");
    }
    let before = takeovers(&test);
    let tick = test.tick();
    test.script([HandCommand::Pause(true), HandCommand::Resume, on].map(|c| (tick, c)));
    test.steps(1).unwrap();
    assert_eq!(takeovers(&test) - before, 1, "once a step");
    let camera = test.app.camera_id();
    assert!(test.app.world.resource::<Taken>().0.iter().all(|e| *e == camera));
}

#[test]
fn a_pause_holds_until_it_is_lifted() {
    let mut test = camera();
    test.script([(1, HandCommand::Pause(true)), (5, HandCommand::Resume), (6, HandCommand::Pause(false))]);
    let paused = [false, true, true, true, true, true, false, false];
    for (n, paused) in paused.into_iter().enumerate() {
        test.steps(1).unwrap();
        assert_eq!(test.get::<Hand>().paused, paused, "step {n}");
    }
}

#[test]
fn a_look_is_in_degrees_to_the_right_and_upwards() {
    let (s, c) = (0.5, 0.75f64.sqrt());
    for (look, forward, up) in [
        ([30.0, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]),
        ([-90.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
        ([0.0, 30.0], [0.0, c, s], [0.0, -s, c]),
        ([0.0, -30.0], [0.0, c, -s], [0.0, s, c]),
        // Both at once: as high over the horizon as upwards alone, and not rolled.
        ([90.0, 30.0], [c, 0.0, s], [-s, 0.0, c]),
    ] {
        let mut test = camera();
        test.steps(5).unwrap();
        give(&mut test, HandCommand::Look(look));
        near(view(&test).forward, forward);
        near(view(&test).up, up);
        let hand = *test.get::<Hand>();
        assert_eq!((hand.looking_until, hand.turned_until), (5 + 180, 5 + 180), "1.5 s of 120 steps a second");
        test.steps(10).unwrap();
        near(view(&test).forward, forward);
        assert_eq!((test.get::<Hand>().looking_until, test.get::<Hand>().on_until), (5 + 180, 0), "turned once");
    }
    let mut test = camera();
    set_hz(&mut test, 7);
    give(&mut test, HandCommand::Look([1.0, 0.0]));
    assert_eq!(test.get::<Hand>().looking_until, 11, "part of a step counts as a whole one");
}

#[test]
fn a_roll_is_clockwise_in_degrees_and_does_not_keep_the_view_from_the_path() {
    let mut test = camera();
    test.steps(2).unwrap();
    give(&mut test, HandCommand::Roll(30.0));
    near(view(&test).forward, DVec3::Y);
    near(view(&test).up, DVec3::new(0.5, 0.0, 0.75f64.sqrt()));
    assert_eq!((test.get::<Hand>().looking_until, test.get::<Hand>().turned_until), (0, 2 + 180));
    give(&mut test, HandCommand::Roll(-30.0));
    near(view(&test).up, DVec3::Z);
}

#[test]
fn a_held_turn_asks_for_its_rate_and_says_how_long_the_view_is_turned() {
    for (turn, rate, is_looking) in [
        ([1.0, 0.0, 0.0], DVec3::NEG_Z, true),
        ([0.0, -0.5, 0.0], DVec3::X * -0.5, true),
        ([0.0, 0.0, 1.0], DVec3::Y, false),
        ([9.0, f64::NAN, -9.0], DVec3::new(0.0, -1.0, -1.0), true),
    ] {
        let mut test = camera();
        let pose = *test.get::<Pose>();
        test.script([(4, HandCommand::Turn(turn)), (20, HandCommand::Turn([0.0; 3]))]);
        test.steps(20).unwrap();
        let hand = *test.get::<Hand>();
        near(hand.turning, rate * 1.2);
        let until = 19 + 180;
        assert_eq!((hand.looking_until, hand.turned_until), (if is_looking { until } else { 0 }, until), "{turn:?}");
        test.steps(5).unwrap();
        let hand = *test.get::<Hand>();
        assert_eq!((hand.turning, hand.turn, hand.turned_until), (DVec3::ZERO, DVec3::ZERO, until), "let go");
        assert_eq!(*test.get::<Pose>(), pose, "the body turns in its own step");
    }
}

#[test]
fn a_look_or_a_roll_that_is_no_number_is_ignored() {
    let mut test = camera();
    let odd = Attitude::new(DVec3::new(0.3, 0.9, 0.1), DVec3::new(0.2, 0.1, 1.0));
    test.get_mut::<Pose>().attitude = odd;
    for command in [
        HandCommand::Look([f64::NAN, 1.0]),
        HandCommand::Look([1.0, f64::INFINITY]),
        HandCommand::Roll(f64::NAN),
        HandCommand::Roll(f64::NEG_INFINITY),
    ] {
        give(&mut test, command);
        assert_eq!(view(&test), odd, "{command:?}");
        assert_eq!((test.get::<Hand>().looking_until, test.get::<Hand>().turned_until), (0, 0));
    }
}

#[test]
fn the_guide_lets_go_in_0_15_s_and_takes_up_in_0_8_s_once_the_hand_is_off() {
    let mut test = camera();
    test.script([(0, HandCommand::Push([0.0, 0.0, 1.0])), (1, HandCommand::Push([0.0; 3]))]);
    let guided = |test: &TestApp| test.get::<Hand>().guided;
    test.steps(9).unwrap();
    assert!((guided(&test) - 0.5).abs() < 1e-12, "9 of 18 steps");
    test.steps(39).unwrap();
    assert_eq!(guided(&test), 0.0, "the hand is on for 48 steps");
    test.steps(1).unwrap();
    assert!((guided(&test) - 1.0 / 96.0).abs() < 1e-12);
    test.steps(47).unwrap();
    assert!((guided(&test) - 0.5).abs() < 1e-12, "48 of 96 steps");
    test.steps(60).unwrap();
    assert_eq!(guided(&test), 1.0);
    give(&mut test, HandCommand::Pause(true));
    test.steps(100).unwrap();
    assert_eq!(guided(&test), 0.0, "as long as it is paused");
    give(&mut test, HandCommand::Pause(false));
    assert!((guided(&test) - 1.0 / 96.0).abs() < 1e-12);
    for state in [State::Arrived, State::Operator, State::Ended] {
        let mut test = camera();
        test.get_mut::<Flight>().state = state;
        test.steps(9).unwrap();
        assert!((guided(&test) - 0.5).abs() < 1e-12, "{state:?}");
    }
}

#[test]
fn a_takeover_resumes_a_flight_that_called_and_no_other() {
    let commands = [HandCommand::Push([0.0, 0.0, 1.0]), HandCommand::Pause(true), HandCommand::Resume];
    for command in commands.into_iter().chain([HandCommand::Look([5.0, 0.0])]) {
        for state in [State::Operator, State::Arrived, State::Ended, State::Flying] {
            let mut test = camera();
            let place = DVec3::new(1.0, 2.0, 3.0);
            let flight = Flight { state, reason: "why".to_owned(), place, length_mm: 7.0, turns: 1, escapes: 2 };
            test.app.camera().insert(flight);
            test.steps(3).unwrap();
            assert_eq!(test.get::<Flight>().state, state, "nothing happens without input");
            give(&mut test, command);
            let resumed = state == State::Operator && !matches!(command, HandCommand::Look(_));
            let flight = test.get::<Flight>();
            assert_eq!(flight.state, if resumed { State::Flying } else { state }, "{command:?}");
            assert_eq!(flight.reason, if resumed { "" } else { "why" }, "{command:?} in {state:?}");
            assert_eq!((flight.place, flight.length_mm, flight.turns, flight.escapes), (place, 7.0, 1, 2));
        }
    }
}

#[test]
fn a_scene_that_is_set_up_again_keeps_the_hand_and_a_second_camera_has_its_own() {
    let mut test = camera();
    let flight = Flight { state: State::Operator, ..Flight::default() };
    let twin = (Body(dynamics::Body::default()), Hand::default(), *test.get::<Pose>(), flight);
    let twin = test.app.world.spawn(twin).id();
    test.script([(0, HandCommand::Speed(3.0)), (0, HandCommand::Push([1.0; 3])), (0, HandCommand::Look([9.0, 9.0]))]);
    test.steps(2).unwrap();
    let world = &test.app.world;
    let hand = world.get::<Hand>(twin).unwrap();
    assert_eq!((hand.push, hand.speed, hand.looking_until, hand.guided), (DVec3::ZERO, 1.0, 0, 1.0));
    assert_eq!(world.get::<Heading>(twin).unwrap().0, DVec3::ZERO);
    assert_eq!(world.get::<Velocity>(twin).unwrap().0, DVec3::ZERO);
    assert_eq!(world.get::<Pose>(twin).unwrap().attitude, Attitude::new(DVec3::Y, DVec3::Z));
    assert_eq!(world.get::<Flight>(twin).unwrap().state, State::Operator);
    assert_eq!(test.get::<Hand>().speed, 3.0);
    let mut again = camera();
    again.get_mut::<Hand>().speed = 3.0;
    plugin(&mut again.app).unwrap();
    assert_eq!(again.get::<Hand>().speed, 3.0);
}
