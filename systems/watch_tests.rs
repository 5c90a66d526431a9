use super::*;
use crate::components::guide::{MineField, MinePush};
use crate::dynamics::mines::MineSettings;
use crate::dynamics::tentacles::TentacleSettings;
use crate::dynamics::trap::Trap;
use crate::dynamics::{self, STEP_S};
use crate::testing::{Room, TestApp};
use glam::DVec3;

/// The goal is far outside of the room.
const GOAL: DVec3 = DVec3::new(0.0, 1000.0, 0.0);

/// Each time that the flight set off again.
#[derive(Resource, Default)]
struct Offs(Vec<SetOff>);

/// A body that a guide moves, whose flight is watched.
fn watched() -> TestApp {
    let mut test = TestApp::new(&Room::new([20; 3]));
    let goal = Goal { at: GOAL, within_mm: 5.0, other_end: -GOAL };
    test.app.equip((Body(dynamics::Body::default()), Automatic));
    plug(&mut test.app, MonitorSettings::default(), goal).unwrap();
    test.app.world.init_resource::<Offs>();
    test.app.observe(|off: On<SetOff>, mut all: ResMut<Offs>| all.0.push(*off.event()));
    test
}

/// Flies straight along x for `mm` at 30 mm/s.
fn fly(test: &mut TestApp, mm: f64) {
    let from = test.get::<Pose>().position;
    for n in 1..=(mm / 30.0 / STEP_S).round() as u32 {
        test.place(from + DVec3::X * (30.0 * STEP_S * f64::from(n)));
        test.steps(1).unwrap();
    }
}

fn state(test: &TestApp) -> State {
    test.get::<Flight>().state
}

/// Returns the distance watched since the last restart, mm.
fn way(test: &TestApp) -> f64 {
    test.get::<Watch>().rescue.monitor().way_mm()
}

#[test]
fn it_has_arrived_within_the_distance_of_the_goal() {
    for (away, arrived) in [(5.0 + 1e-9, false), (5.0, true), (4.9, true), (0.0, true)] {
        let mut test = watched();
        let at = GOAL + DVec3::Y * away;
        test.place(at);
        test.get_mut::<Contact>().stuck_steps = if arrived { 1000 } else { 0 };
        test.steps(1).unwrap();
        let flight = test.get::<Flight>();
        assert_eq!(flight.state, if arrived { State::Arrived } else { State::Flying }, "{away}");
        assert_eq!(flight.place, if arrived { at } else { DVec3::ZERO });
        assert_eq!(flight.reason, "");
        test.steps(3).unwrap();
        assert_eq!(state(&test), if arrived { State::Arrived } else { State::Flying });
    }
    let mut test = watched();
    test.app.camera().remove::<Goal>();
    test.place(GOAL);
    test.steps(1).unwrap();
    assert_eq!(state(&test), State::Flying, "a flight without a goal never arrives");
}

#[test]
fn half_a_second_in_the_wall_calls_the_operator() {
    for (hz, steps, calls) in [(120, 59, false), (120, 60, true), (100, 49, false), (100, 50, true), (100, 51, true)] {
        let mut test = watched();
        test.app.world.resource_mut::<Clock>().hz = hz;
        test.get_mut::<Contact>().stuck_steps = steps;
        test.steps(1).unwrap();
        let flight = test.get::<Flight>();
        assert_eq!(flight.state, if calls { State::Operator } else { State::Flying }, "{steps} steps at {hz} Hz");
        assert_eq!(flight.place, if calls { DVec3::splat(10.0) } else { DVec3::ZERO });
        assert_eq!(flight.reason.contains("in the wall"), calls);
    }
}

#[test]
fn a_body_in_the_wall_is_left_to_the_hand_that_is_on() {
    let mut test = watched();
    test.app.equip(Hand { on_until: 4, ..Hand::default() });
    test.get_mut::<Contact>().stuck_steps = 60;
    test.steps(4).unwrap();
    assert_eq!(state(&test), State::Flying);
    test.steps(1).unwrap();
    assert_eq!(state(&test), State::Operator);
    // A pause is no hand that pushes it out.
    let mut test = watched();
    test.app.camera().remove::<Automatic>();
    test.app.equip(Hand { paused: true, ..Hand::default() });
    test.get_mut::<Contact>().stuck_steps = 60;
    test.steps(1).unwrap();
    assert_eq!(state(&test), State::Operator, "with any guide");
}

#[test]
fn a_flight_that_is_over_or_called_is_not_watched() {
    for over in [State::Arrived, State::Operator, State::Ended] {
        let mut test = watched();
        test.place(GOAL);
        test.get_mut::<Contact>().stuck_steps = 1000;
        let before = Flight { state: over, reason: "why".to_owned(), place: DVec3::X, ..Flight::default() };
        test.app.camera().insert(before);
        test.steps(200).unwrap();
        let flight = test.get::<Flight>();
        assert_eq!((flight.state, flight.reason.as_str(), flight.place), (over, "why", DVec3::X));
        assert!(test.get::<Watch>().rescue.monitor().trail().is_empty());
    }
}

#[test]
fn a_guide_without_tentacles_that_hangs_for_its_window_calls() {
    let mut test = watched();
    fly(&mut test, 60.0);
    assert!((way(&test) - 60.0).abs() < 0.3, "every step is watched: {}", way(&test));
    let at = test.get::<Pose>().position;
    // 1.5 s, and the 6 mm before that count as hanging.
    test.steps(150).unwrap();
    assert_eq!(state(&test), State::Flying);
    test.steps(35).unwrap();
    let flight = test.get::<Flight>();
    assert_eq!((flight.state, flight.reason.as_str(), flight.place), (State::Operator, Trap::Stuck.text(), at));
    assert!(test.get::<HelpCall>().0.is_none(), "the call has been taken");
    assert_eq!((flight.turns, flight.escapes), (0, 0));
    assert!(test.app.world.resource::<Offs>().0.is_empty());
}

#[test]
fn a_window_is_as_long_as_the_settings_say_at_any_step() {
    let mut test = watched();
    test.app.world.resource_mut::<Clock>().hz = 60;
    test.get_mut::<Watch>().settings.window_s = 0.5;
    test.steps(29).unwrap();
    assert_eq!(state(&test), State::Flying);
    test.steps(4).unwrap();
    assert_eq!(state(&test), State::Operator, "0.5 s are 30 steps");
}

#[test]
fn only_a_guide_that_moves_the_camera_is_watched() {
    let mut test = watched();
    test.app.camera().remove::<Automatic>();
    fly(&mut test, 20.0);
    assert_eq!(way(&test), 0.0);
    test.steps(400).unwrap();
    assert_eq!(state(&test), State::Flying);
}

#[test]
fn the_watch_starts_over_while_the_operator_has_control() {
    for hand in [Hand { on_until: 200, ..Hand::default() }, Hand { paused: true, ..Hand::default() }] {
        let mut test = watched();
        test.app.equip(Hand::default());
        test.steps(150).unwrap();
        test.app.camera().insert(Hand { on_until: hand.on_until.max(1), ..hand });
        test.steps(50).unwrap();
        assert_eq!((state(&test), way(&test)), (State::Flying, 0.0));
        assert!(test.get::<Watch>().rescue.monitor().trail().is_empty());
        test.app.camera().insert(Hand { paused: false, on_until: 200, ..hand });
        // From tick 200 on it is watched again, for the whole window.
        test.steps(179).unwrap();
        assert_eq!(state(&test), State::Flying);
        test.steps(4).unwrap();
        assert_eq!(state(&test), State::Operator);
    }
}

#[test]
fn a_takeover_and_an_answer_start_the_watch_over_and_a_takeover_clears_the_mines() {
    let mut test = watched();
    super::super::mines::plug(&mut test.app, MineSettings::default()).unwrap();
    let entity = test.app.camera_id();
    let mines = |test: &TestApp| test.get::<MineField>().mines.len();
    let other = test.app.world.spawn(()).id();
    fly(&mut test, 30.0);
    test.app.world.trigger(TakenOver { entity: other });
    test.app.world.trigger(HelpAnswered { entity: other });
    assert!(way(&test) > 29.0 && mines(&test) == 3, "another entity's: {} mm, {} mines", way(&test), mines(&test));
    test.app.world.trigger(HelpAnswered { entity });
    assert_eq!((way(&test), mines(&test)), (0.0, 3));
    fly(&mut test, 10.0);
    assert!((way(&test) - 10.0).abs() < 0.3, "{}", way(&test));
    test.app.world.trigger(TakenOver { entity });
    assert_eq!((way(&test), mines(&test)), (0.0, 0));
    test.steps(1).unwrap();
    assert_eq!(test.get::<MinePush>().0, DVec3::ZERO);
    fly(&mut test, 7.0);
    assert_eq!(mines(&test), 0, "the next one is laid 8 mm from there");
    fly(&mut test, 2.0);
    assert_eq!(mines(&test), 1);
}

#[test]
fn a_call_that_a_guide_answers_does_not_reach_the_operator() {
    let mut test = watched();
    test.app.add_systems(FlightSystems::Answer, |mut call: Single<&mut HelpCall, With<Main>>| call.0 = None);
    test.steps(300).unwrap();
    assert_eq!((state(&test), test.get::<Flight>().reason.as_str()), (State::Flying, ""));
}

#[test]
fn a_call_reaches_the_operator_once_with_its_reason_and_place() {
    let mut test = watched();
    let place = DVec3::new(1.0, 2.0, 3.0);
    test.steps(1).unwrap();
    assert_eq!(state(&test), State::Flying);
    test.get_mut::<HelpCall>().0 = Some(Help { reason: "odd".to_owned(), place });
    test.steps(1).unwrap();
    let flight = test.get::<Flight>();
    assert_eq!((flight.state, flight.reason.as_str(), flight.place), (State::Operator, "odd", place));
    *test.get_mut::<Flight>() = Flight::default();
    test.steps(5).unwrap();
    assert_eq!(state(&test), State::Flying, "it is not called again");
}

/// Tentacles in the plane, with a lumen that is open ahead (+x) but blocked by its forces; the longest leads back.
fn tentacles() -> Tentacles {
    Tentacles {
        settings: TentacleSettings::default(),
        directions: vec![DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::NEG_X],
        lengths: vec![80.0, 10.0, 10.0, 90.0],
    }
}

fn hang(test: &mut TestApp) -> Vec<SetOff> {
    test.get_mut::<Heading>().0 = DVec3::X;
    fly(test, 90.0);
    test.steps(185).unwrap();
    test.app.world.resource::<Offs>().0.clone()
}

#[test]
fn a_local_minimum_is_left_along_the_tentacles_and_counted() {
    let mut test = watched();
    test.app.equip(tentacles());
    (test.get_mut::<Flight>().turns, test.get_mut::<Flight>().escapes) = (1, 2);
    let offs = hang(&mut test);
    assert_eq!(offs.len(), 1, "{offs:?}");
    assert_eq!((offs[0].entity, offs[0].heading), (test.app.camera_id(), Some(DVec3::X)));
    assert!(!offs[0].clear_mines);
    let flight = test.get::<Flight>();
    assert_eq!((flight.state, flight.turns, flight.escapes), (State::Flying, 1, 3));
    // The watch counts anew after a takeover, and the flight does not.
    let entity = test.app.camera_id();
    test.app.world.trigger(TakenOver { entity });
    test.steps(170).unwrap();
    assert_eq!((test.get::<Flight>().turns, test.get::<Flight>().escapes), (1, 3));
    test.steps(20).unwrap();
    assert_eq!((test.get::<Flight>().turns, test.get::<Flight>().escapes), (1, 4));
}

#[test]
fn a_dead_end_is_told_from_the_heading_and_the_bodys_size() {
    let mut test = watched();
    test.app.equip(Tentacles { lengths: vec![8.0, 10.0, 10.0, 90.0], ..tentacles() });
    let offs = hang(&mut test);
    assert!(offs.len() == 1 && offs[0].clear_mines, "{offs:?}");
    assert!(offs[0].heading.is_some_and(|h| h.distance(DVec3::NEG_X) < 1e-9), "back along the trail");
    // A body as wide as the lumen ahead is long sees a dead end in it.
    let mut test = watched();
    test.app.equip(tentacles());
    test.get_mut::<Body>().0.radius_mm = 41.0;
    let offs = hang(&mut test);
    assert!(offs.len() == 1 && offs[0].clear_mines, "{offs:?}");
}

#[test]
fn a_guide_with_tentacles_turns_round_at_the_wrong_end_once() {
    let mut test = watched();
    test.app.equip(tentacles());
    test.get_mut::<Goal>().other_end = DVec3::new(100.0, 10.0, 10.0);
    (test.get_mut::<Flight>().turns, test.get_mut::<Flight>().escapes) = (4, 2);
    let offs = hang(&mut test);
    assert_eq!(offs.len(), 1, "{offs:?}");
    assert_eq!((offs[0].heading, offs[0].clear_mines), (Some(DVec3::NEG_X), true));
    assert_eq!((test.get::<Flight>().turns, test.get::<Flight>().escapes), (5, 2));
    // A guide without tentacles has no other direction.
    let mut test = watched();
    test.get_mut::<Goal>().other_end = DVec3::new(100.0, 10.0, 10.0);
    assert!(hang(&mut test).is_empty());
    assert_eq!((state(&test), test.get::<Flight>().turns), (State::Operator, 0));
}

#[test]
fn other_entities_are_not_watched() {
    let mut test = watched();
    let goal = Goal { at: GOAL, within_mm: 5.0, other_end: -GOAL };
    let watch = Watch { settings: MonitorSettings::default(), rescue: Rescue::default() };
    let pose = Pose { position: GOAL, ..*test.get::<Pose>() };
    let help = HelpCall(Some(Help { reason: "odd".to_owned(), place: DVec3::ZERO }));
    let body = Body(dynamics::Body::default());
    let twin = test.app.world.spawn((body, pose, Flight::default(), watch, help, goal, Automatic)).id();
    test.steps(200).unwrap();
    assert_eq!(state(&test), State::Operator, "the camera is");
    let world = &test.app.world;
    assert_eq!(world.get::<Flight>(twin).unwrap().state, State::Flying);
    assert!(world.get::<HelpCall>(twin).unwrap().0.is_some());
    assert!(world.get::<Watch>(twin).unwrap().rescue.monitor().trail().is_empty());
}
