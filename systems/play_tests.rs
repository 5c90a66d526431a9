use super::*;
use crate::components::output::LogLine;
use crate::components::play::Direction;
use crate::dynamics::Attitude;
use crate::testing::{Room, TestApp};

/// A log of 3 s, in which the camera turns from +x through +y to −x, that ended in `last`.
fn lines(last: State) -> Vec<LogLine> {
    let line = |t: f64, x: f64, y: f64, forward: [f64; 3], clearance_mm: f64, state: State| LogLine {
        t: 5.0 + t,
        position: [x, y, 0.0],
        forward,
        up: [0.0, 0.0, 1.0],
        velocity: [8.0, t, 0.0],
        clearance_mm,
        state,
        guide: "tentacles".to_owned(),
    };
    vec![
        line(0.0, 0.0, 0.0, [1.0, 0.0, 0.0], 4.0, State::Flying),
        line(1.0, 8.0, 0.0, [0.0, 1.0, 0.0], 8.0, State::Operator),
        line(3.0, 8.0, 16.0, [-1.0, 0.0, 0.0], 2.0, last),
    ]
}

/// A camera at the start of a log, looking up, with steps of a quarter of a second.
fn played(rate: f64, direction: Direction, last: State) -> TestApp {
    let mut test = TestApp::new(&Room::new([20; 3]));
    test.app.world.resource_mut::<Clock>().hz = 4;
    let play = Playback::new(lines(last), rate, direction).unwrap();
    let attitude = Attitude::new(DVec3::Z, DVec3::Y);
    test.app.camera().insert((Pose { position: play.ends()[0], attitude }, Velocity::default(), Contact::default()));
    plug(&mut test.app, &play).unwrap();
    test
}

fn forwards() -> TestApp {
    played(1.0, Direction::Forwards, State::Arrived)
}

fn pose(test: &TestApp) -> Pose {
    *test.get::<Pose>()
}

#[track_caller]
fn near(a: DVec3, b: impl Into<DVec3>) {
    let b = b.into();
    assert!(a.distance(b) < 1e-12, "{a}, not {b}");
}

#[test]
fn each_step_shows_the_log_after_it() {
    for speed in [None, Some(1.0)] {
        let mut test = forwards();
        if let Some(speed) = speed {
            test.app.equip(Hand { speed, ..Hand::default() });
        }
        *test.get_mut::<Contact>() = Contact { clearance_mm: 9.0, stuck_steps: 7 };
        test.get_mut::<Flight>().length_mm = 1.0;
        test.steps(1).unwrap();
        near(pose(&test).position, [2.0, 0.0, 0.0]);
        near(pose(&test).attitude.forward, DVec3::new(0.75, 0.25, 0.0).normalize());
        near(test.get::<Velocity>().0, [8.0, 0.25, 0.0]);
        assert_eq!((test.get::<Contact>().clearance_mm, test.get::<Contact>().stuck_steps), (5.0, 0));
        assert_eq!(test.get::<Flight>().length_mm, 3.0);
        test.steps(5).unwrap();
        near(pose(&test).position, [8.0, 4.0, 0.0]);
        assert_eq!(test.get::<Contact>().clearance_mm, 6.5);
        assert!((test.get::<Flight>().length_mm - 13.0).abs() < 1e-12);
        assert_eq!(test.get::<Flight>().state, State::Flying, "calls of the log do not stop it");
    }
}

#[test]
fn the_operators_speed_and_the_rate_multiply() {
    for (rate, speed) in [(1.0, 2.0), (4.0, 0.5), (2.0, 1.0)] {
        let mut test = played(rate, Direction::Forwards, State::Arrived);
        test.app.equip(Hand { speed, ..Hand::default() });
        test.steps(1).unwrap();
        near(pose(&test).position, [4.0, 0.0, 0.0]);
        near(test.get::<Velocity>().0, [16.0, 1.0, 0.0]);
        test.steps(4).unwrap();
        assert_eq!(test.get::<Flight>().state, State::Flying);
        test.steps(1).unwrap();
        assert_eq!(test.get::<Flight>().state, State::Arrived, "3 s at twice the speed");
    }
}

#[test]
fn a_paused_log_stands_still_and_goes_on_from_there() {
    let mut test = forwards();
    test.app.equip(Hand::default());
    test.steps(1).unwrap();
    let (before, flown) = (pose(&test), test.get::<Flight>().length_mm);
    test.get_mut::<Hand>().paused = true;
    test.steps(1).unwrap();
    assert_eq!(test.get::<Velocity>().0, DVec3::ZERO);
    test.steps(20).unwrap();
    assert_eq!((pose(&test), test.get::<Flight>().length_mm), (before, flown));
    assert_eq!(test.get::<Contact>().clearance_mm, 5.0);
    assert_eq!(test.get::<Flight>().state, State::Flying);
    test.get_mut::<Hand>().paused = false;
    test.steps(1).unwrap();
    near(pose(&test).position, [4.0, 0.0, 0.0]);
    near(test.get::<Velocity>().0, [8.0, 0.5, 0.0]);
}

#[test]
fn at_its_end_it_has_arrived_only_if_the_log_has() {
    for (last, direction, end) in [
        (State::Arrived, Direction::Forwards, State::Arrived),
        (State::Operator, Direction::Forwards, State::Ended),
        (State::Flying, Direction::Forwards, State::Ended),
        (State::Ended, Direction::Forwards, State::Ended),
        (State::Arrived, Direction::Backwards, State::Ended),
    ] {
        let mut test = played(1.0, direction, last);
        let place = test.get::<Playback>().ends()[1];
        test.steps(11).unwrap();
        let flight = test.get::<Flight>();
        assert_eq!((flight.state, flight.place), (State::Flying, DVec3::ZERO), "{last:?} {direction:?}");
        test.steps(1).unwrap();
        let flight = test.get::<Flight>();
        assert_eq!((flight.state, flight.place, pose(&test).position), (end, place, place), "{last:?} {direction:?}");
        assert!((flight.length_mm - 24.0).abs() < 1e-12);
        assert_ne!(test.get::<Velocity>().0, DVec3::ZERO, "the velocity of the last step");
        test.steps(3).unwrap();
        assert_eq!((test.get::<Flight>().state, test.get::<Velocity>().0), (end, DVec3::ZERO));
        assert_eq!(pose(&test).position, place);
    }
}

#[test]
fn backwards_it_moves_the_other_way() {
    let mut test = played(2.0, Direction::Backwards, State::Arrived);
    test.steps(1).unwrap();
    near(pose(&test).position, [8.0, 12.0, 0.0]);
    near(test.get::<Velocity>().0, [-16.0, -5.0, 0.0]);
}

#[test]
fn a_log_that_is_not_flying_stands_until_it_is_resumed() {
    let mut test = forwards();
    test.get_mut::<Flight>().state = State::Operator;
    test.get_mut::<Velocity>().0 = DVec3::X;
    test.steps(5).unwrap();
    assert_eq!((pose(&test).position, test.get::<Velocity>().0), (DVec3::ZERO, DVec3::ZERO));
    test.get_mut::<Flight>().state = State::Flying;
    test.steps(1).unwrap();
    near(pose(&test).position, [2.0, 0.0, 0.0]);
}

#[test]
fn who_looks_around_keeps_the_view_until_it_turns_back_to_the_log() {
    let mut test = forwards();
    test.app.equip(Hand { turned_until: 3, ..Hand::default() });
    let before = pose(&test).attitude;
    test.steps(3).unwrap();
    near(pose(&test).position, [6.0, 0.0, 0.0]);
    assert_eq!(pose(&test).attitude, before);
    test.steps(1).unwrap();
    near(pose(&test).attitude.forward, DVec3::Y);
}

/// A turn of 1.2 rad/s about −z and one about +z, each in steps of a quarter of a second.
#[test]
fn a_held_key_turns_the_view_paused_or_over_or_not() {
    for (paused, state) in [(false, State::Flying), (true, State::Flying), (false, State::Ended)] {
        for rate in [1.2, -2.0] {
            let mut test = forwards();
            test.get_mut::<Flight>().state = state;
            let turning = DVec3::NEG_Z * rate;
            test.app.equip(Hand { paused, turning, turned_until: 2, ..Hand::default() });
            test.get_mut::<Pose>().attitude = Attitude::new(DVec3::Y, DVec3::Z);
            test.steps(2).unwrap();
            let angle = 0.5 * rate;
            near(pose(&test).attitude.forward, [angle.sin(), angle.cos(), 0.0]);
            let before = pose(&test).attitude;
            test.steps(1).unwrap();
            assert_eq!(pose(&test).attitude == before, paused || state != State::Flying, "from tick 2 on it does not");
        }
    }
}

#[test]
fn a_new_scene_goes_on_where_the_log_was() {
    let mut test = TestApp::new(&Room::new([20; 3]));
    test.app.world.resource_mut::<Clock>().hz = 4;
    test.app.camera().insert((Velocity::default(), Contact::default()));
    let play = Playback::new(lines(State::Arrived), 1.0, Direction::Forwards).unwrap();
    test.app.set_scene(|app| plug(app, &play)).unwrap();
    test.steps(2).unwrap();
    test.app.set_scene(|app| plug(app, &play)).unwrap();
    test.steps(1).unwrap();
    near(pose(&test).position, [6.0, 0.0, 0.0]);
    assert_eq!(test.get::<Playback>().share(), 0.25);
}

#[test]
fn other_entities_do_not_follow_the_log() {
    let mut test = forwards();
    let play = Playback::new(lines(State::Arrived), 1.0, Direction::Forwards).unwrap();
    let twin = (pose(&test), Velocity(DVec3::X), Contact::default(), Flight::default(), play);
    let twin = test.app.world.spawn(twin).id();
    test.steps(20).unwrap();
    assert_eq!(test.get::<Flight>().state, State::Arrived);
    let world = &test.app.world;
    assert_eq!(
        (world.get::<Pose>(twin).unwrap().position, world.get::<Velocity>(twin).unwrap().0),
        (DVec3::ZERO, DVec3::X)
    );
    assert_eq!(world.get::<Playback>(twin).unwrap().share(), 0.0);
}
