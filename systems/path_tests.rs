use super::*;
use crate::components::flight::{Goal, Help};
use crate::dynamics::monitor::MonitorSettings;
use crate::dynamics::{Attitude, Route};
use crate::testing::{Room, TestApp};

/// A straight route along +y in the middle of a long room, from 10 to 110 mm, with 9 mm to the walls.
fn route() -> Arc<Route> {
    let line: Vec<_> = (10..=110).map(|y| DVec3::new(10.0, f64::from(y), 10.0)).collect();
    Arc::new(Route::along(&line, &vec![9.0; line.len()], DVec3::Z).unwrap())
}

fn on_route(s: f64) -> DVec3 {
    DVec3::new(10.0, 10.0 + s, 10.0)
}

/// A body at rest, 40 mm along the route that guides it. Nothing moves it.
fn following(settings: PathSettings, route: Arc<Route>) -> TestApp {
    let mut test = TestApp::new(&Room::new([20, 120, 20]));
    test.app.scan().insert(Centerline(route));
    test.app.equip(Body(dynamics::Body::default()));
    settings.plug(&mut test.app).unwrap();
    test.place(on_route(40.0));
    test
}

fn body() -> TestApp {
    following(PathSettings::default(), route())
}

fn s_mm(test: &TestApp) -> f64 {
    test.get::<Planned>().s_mm
}

fn guide(test: &TestApp) -> GuideThrust {
    *test.get::<GuideThrust>()
}

fn jump(test: &mut TestApp, s: f64) {
    test.place(on_route(s));
    test.get_mut::<Planned>().jumps += 1;
}

#[track_caller]
fn near(a: DVec3, b: DVec3) {
    assert!(a.distance(b) < 1e-6, "{a}, not {b}");
}

#[test]
fn it_needs_a_centerline_and_starts_at_its_beginning() {
    let mut test = TestApp::new(&Room::new([20, 120, 20]));
    assert!(PathSettings::default().plug(&mut test.app).unwrap_err().to_string().contains("centerline is missing"));
    let settings = PathSettings { look_ahead_mm: 17.0, cruise_mm_s: 21.0, ..PathSettings::default() };
    let test = following(settings, route());
    let planned = test.get::<Planned>();
    assert_eq!((planned.s_mm, planned.look_ahead_mm, planned.jumps), (0.0, 17.0, 0));
    assert_eq!(*planned.route, *route());
    assert_eq!(settings.cruise_mm_s(&dynamics::Body::default()), 21.0);
    assert!(settings.needs().centerline && settings.needs().planner == settings.planner);
    assert!(PathSettings { wall_s: 0.0, ..settings }.check().is_err());
}

#[test]
fn the_thrust_is_exact_limited_to_cruise_speed_and_without_a_wall() {
    for (drag, limit) in [(6.0, 180.0), (2.5, 75.0), (0.5, 30.0)] {
        let mut test = body();
        test.get_mut::<Body>().0.drag_per_s = drag;
        *test.get_mut::<GuideThrust>() =
            GuideThrust { thrust: DVec3::X, limit: 1.0, wall: DVec3::X, look_direction: DVec3::X, exact: false };
        test.steps(1).unwrap();
        let guide = guide(&test);
        assert_eq!((guide.limit, guide.exact, guide.wall), (limit, true, DVec3::ZERO), "drag {drag}");
        near(guide.look_direction, DVec3::Y);
        test.get_mut::<Flight>().state = State::Operator;
        test.get_mut::<GuideThrust>().wall = DVec3::X;
        test.steps(1).unwrap();
        let guide = self::guide(&test);
        assert_eq!(
            (guide.limit, guide.exact, guide.wall, guide.look_direction),
            (limit, true, DVec3::ZERO, DVec3::ZERO)
        );
    }
}

/// The view is directed at the mean of the way ahead: past a bend before the position gets there.
#[test]
fn the_view_looks_ahead_along_the_route() {
    let bend = |y: i32| DVec3::new(10.0 + f64::from((y - 60).max(0)), f64::from(y.min(60)), 10.0);
    let line: Vec<_> = (10..=90).map(bend).collect();
    let route = Arc::new(Route::along(&line, &vec![9.0; line.len()], DVec3::Z).unwrap());
    let mut sideways = 0.0;
    for look_ahead_mm in [5.0, 14.0, 24.0] {
        let mut test = following(PathSettings { look_ahead_mm, ..PathSettings::default() }, Arc::clone(&route));
        test.steps(1).unwrap();
        let look = guide(&test).look_direction;
        near(look, route.look(s_mm(&test), look_ahead_mm));
        assert!(look.x > sideways || look_ahead_mm < 10.0, "{look}");
        sideways = look.x;
    }
    assert!(sideways > 0.1);
}

/// From rest the acceleration grows by 80 mm/s³ (half of the greatest jerk), so after 0.5 s it has come 80 t³/6 mm.
#[test]
fn it_sets_off_where_the_body_is_and_the_plan_goes_on_at_the_operators_speed() {
    for (speed, steps) in [(None, 60), (Some(1.0), 60), (Some(2.0), 30)] {
        let mut test = body();
        if let Some(speed) = speed {
            test.app.equip(Hand { speed, ..Hand::default() });
        }
        test.steps(1).unwrap();
        assert!((s_mm(&test) - 40.0).abs() < 1e-3, "{}", s_mm(&test));
        assert!(guide(&test).thrust.length() < 5.0, "it starts gently");
        test.steps(steps - 1).unwrap();
        let gone = s_mm(&test) - 40.0;
        assert!((gone - 80.0 * 0.125 / 6.0).abs() < 0.1, "{gone} at {speed:?}");
        let thrust = guide(&test).thrust;
        assert!(thrust.y > 40.0 && thrust.x.abs() + thrust.z.abs() < 1e-6, "it pulls after the plan: {thrust}");
    }
}

#[test]
fn a_body_that_is_held_joins_the_plan_again() {
    let mut test = body();
    let mut gone = Vec::new();
    for _ in 0..240 {
        test.steps(1).unwrap();
        gone.push(s_mm(&test) - 40.0);
        near(guide(&test).look_direction, DVec3::Y);
    }
    let most = gone.iter().copied().fold(0.0, f64::max);
    assert!((5.5..6.5).contains(&most), "lost 6 mm from its place: {most}");
    let back = gone.windows(2).position(|w| w[1] < w[0]).unwrap();
    assert!(gone[back + 1].abs() < 0.01, "from where it is");
}

/// Where the body joins the plan its acceleration continues: the thrust is `a + k v`.
#[test]
fn the_acceleration_continues_where_the_guide_takes_over() {
    let mut test = body();
    let (before, now) = (DVec3::new(3.2, 20.0, -1.0), DVec3::new(3.0, 20.5, -0.9));
    test.app.equip(Hand { paused: true, ..Hand::default() });
    for velocity in [DVec3::X * 50.0, before] {
        test.get_mut::<Velocity>().0 = velocity;
        test.steps(1).unwrap();
    }
    test.get_mut::<Velocity>().0 = now;
    test.get_mut::<Hand>().paused = false;
    test.steps(1).unwrap();
    near(guide(&test).thrust, (now - before) * 120.0 + now * 6.0);
    // In the first step, and after a jump, what the body did before is not known.
    let mut test = body();
    test.get_mut::<Velocity>().0 = now;
    test.steps(1).unwrap();
    near(guide(&test).thrust, now * 6.0);
    test.get_mut::<Velocity>().0 = before;
    jump(&mut test, 60.0);
    test.steps(1).unwrap();
    near(guide(&test).thrust, before * 6.0);
}

#[test]
fn while_the_hand_is_on_the_place_is_the_nearest_and_the_last_command_fades() {
    let mut test = body();
    test.app.equip(Hand::default());
    test.steps(60).unwrap();
    let last = guide(&test).thrust;
    assert!(last.length() > 40.0);
    // Smoothstep of the guide's part.
    let hands = [Hand { paused: true, ..Hand::default() }, Hand { on_until: 1000, ..Hand::default() }];
    for (s, guided, share) in [(43.0, 1.0, 1.0), (43.5, 0.5, 0.5), (70.0, 0.25, 0.15625), (20.0, 0.0, 0.0)] {
        for hand in hands {
            test.app.camera().insert(Hand { guided, ..hand });
            test.place(on_route(s) + DVec3::X * 2.0);
            test.steps(1).unwrap();
            near(guide(&test).thrust, last * share);
            assert_eq!(guide(&test).look_direction, DVec3::ZERO);
            assert!((s_mm(&test) - s).abs() < 1e-6, "{} for {s}", s_mm(&test));
        }
    }
}

#[test]
fn a_flight_that_has_stopped_gets_no_thrust() {
    for state in [State::Arrived, State::Operator, State::Ended] {
        for hand in [None, Some(Hand::default())] {
            let mut test = body();
            if let Some(hand) = hand {
                test.app.equip(hand);
            }
            test.steps(60).unwrap();
            test.get_mut::<Flight>().state = state;
            test.place(on_route(70.0));
            test.steps(1).unwrap();
            assert_eq!(guide(&test).thrust, DVec3::ZERO, "{state:?}");
            assert!((s_mm(&test) - 70.0).abs() < 1e-6);
        }
    }
}

/// The body is moved by less than it may be off the plan, so only a plan that is joined anew notices.
#[test]
fn after_a_pause_or_a_jump_the_plan_is_joined_where_the_body_is() {
    let mut test = body();
    test.app.equip(Hand::default());
    test.steps(30).unwrap();
    test.get_mut::<Hand>().paused = true;
    test.steps(1).unwrap();
    test.get_mut::<Hand>().paused = false;
    test.place(on_route(43.0));
    test.steps(1).unwrap();
    assert!((s_mm(&test) - 43.0).abs() < 1e-3, "{}", s_mm(&test));
    // The hand is on up to its tick, which is not included.
    let on_until = test.tick() + 2;
    test.get_mut::<Hand>().on_until = on_until;
    test.steps(2).unwrap();
    assert_eq!(guide(&test).look_direction, DVec3::ZERO);
    test.steps(1).unwrap();
    near(guide(&test).look_direction, DVec3::Y);

    test.steps(30).unwrap();
    jump(&mut test, 46.0);
    test.steps(1).unwrap();
    assert!((s_mm(&test) - 46.0).abs() < 1e-3, "{}", s_mm(&test));
    test.steps(59).unwrap();
    let gone = s_mm(&test) - 46.0;
    assert!((gone - 80.0 * 0.125 / 6.0).abs() < 0.1, "once for each jump: {gone}");
}

#[test]
fn a_jump_discards_the_last_command() {
    let mut test = body();
    test.app.equip(Hand::default());
    test.steps(60).unwrap();
    assert!(guide(&test).thrust.length() > 40.0);
    test.get_mut::<Hand>().paused = true;
    jump(&mut test, 80.0);
    test.steps(1).unwrap();
    assert_eq!(guide(&test).thrust, DVec3::ZERO);
    assert!((s_mm(&test) - 80.0).abs() < 1e-6);
}

/// Two lanes 8 mm apart, with a wall between them: the nearer one is out of reach.
#[test]
fn the_nearest_place_is_one_that_can_be_reached() {
    // There inside of the room, at x = 16, and back outside of it, at x = 24.
    let there = (10..=110).map(|y| DVec3::new(16.0, f64::from(y), 10.0));
    let back = (10..=110).rev().map(|y| DVec3::new(24.0, f64::from(y), 10.0));
    let line: Vec<_> = there.chain(back).collect();
    let route = Arc::new(Route::along(&line, &vec![4.0; line.len()], DVec3::Z).unwrap());
    let mut test = following(PathSettings::default(), route);
    for paused in [true, false] {
        test.app.equip(Hand { paused, ..Hand::default() });
        test.place(DVec3::new(19.0, 50.0, 10.0));
        test.get_mut::<Planned>().jumps += 1;
        test.steps(1).unwrap();
        assert!((s_mm(&test) - 40.0).abs() < 0.01, "{} paused: {paused}", s_mm(&test));
        // Nearer to the lane behind the wall.
        test.place(DVec3::new(19.9, 90.0, 10.0));
        test.get_mut::<Planned>().jumps += 1;
        test.steps(1).unwrap();
        assert!((s_mm(&test) - 80.0).abs() < 0.01, "{} paused: {paused}", s_mm(&test));
    }
}

/// A plan behind the wall at x = 20 up to y = 80, and inside of the room from there: no line to it is free, but from the way that the
/// body came.
#[test]
fn where_no_line_to_the_plan_is_free_it_flies_back_over_its_own_trail() {
    let line: Vec<_> = (10..=110).map(|y| DVec3::new(if y < 80 { 24.0 } else { 16.0 }, f64::from(y), 10.0)).collect();
    let route = Arc::new(Route::along(&line, &vec![4.0; line.len()], DVec3::Z).unwrap());
    let mut test = following(PathSettings::default(), route);
    let here = DVec3::new(18.0, 50.0, 10.0);
    test.place(here);
    // Without a trail it stays: behind the wall it would hang.
    test.steps(30).unwrap();
    assert_eq!((guide(&test).thrust, guide(&test).look_direction), (DVec3::ZERO, DVec3::ZERO));
    let mut trail = Trail::default();
    for y in (50..=100).rev() {
        trail.follow((DVec3::new(18.0, f64::from(y), 10.0), Attitude::new(DVec3::NEG_Y, DVec3::Z)), 0.0, None);
    }
    test.app.camera().insert(trail);
    test.steps(60).unwrap();
    let guide = guide(&test);
    assert!(guide.thrust.y > 40.0 && guide.thrust.x.abs() < 1e-6, "{}", guide.thrust);
    near(guide.look_direction, DVec3::Y);
    // As soon as a line is free, it joins.
    test.place(DVec3::new(18.0, 95.0, 10.0));
    test.steps(300).unwrap();
    assert!((s_mm(&test) - test.get::<Planned>().route.nearest(DVec3::new(18.0, 95.0, 10.0))[0]).abs() < 8.0);
}

#[test]
fn a_narrow_place_soon_ahead_is_named_in_the_reason() {
    let line: Vec<_> = (10..=110).map(|y| DVec3::new(10.0, f64::from(y), 10.0)).collect();
    let clearance: Vec<_> = (0..=100).map(|s| if (60..=62).contains(&s) { 1.25 } else { 9.0 }).collect();
    let route = Arc::new(Route::along(&line, &clearance, DVec3::Z).unwrap());
    let named = "the path ahead narrows to 2.5 mm across; the camera needs 3.0 mm";
    for (s, radius_mm, reason) in [
        (50.0, 1.5, named),
        (46.0, 1.5, named),
        (62.0, 1.5, named),
        (45.0, 1.5, "stuck"),
        (63.0, 1.5, "stuck"),
        (50.0, 0.7, "stuck"),
        (50.0, 0.8, "the path ahead narrows to 2.5 mm across; the camera needs 1.6 mm"),
    ] {
        let mut test = following(PathSettings::default(), Arc::clone(&route));
        test.app.equip((HelpCall(None), Hand { paused: true, ..Hand::default() }));
        test.get_mut::<Body>().0.radius_mm = radius_mm;
        test.place(on_route(s));
        test.steps(1).unwrap();
        assert!(test.get::<HelpCall>().0.is_none(), "it does not call by itself");
        test.get_mut::<HelpCall>().0 = Some(Help { reason: "stuck".to_owned(), place: DVec3::X });
        test.steps(1).unwrap();
        let help = test.get::<HelpCall>().0.clone();
        assert_eq!(help, Some(Help { reason: reason.to_owned(), place: DVec3::X }), "at {s}, radius {radius_mm}");
    }
}

/// The watch passes a call on to the operator in the same step, after its reason was replaced.
#[test]
fn the_operator_is_told_of_the_narrow_place() {
    let line: Vec<_> = (10..=110).map(|y| DVec3::new(10.0, f64::from(y), 10.0)).collect();
    let clearance: Vec<_> = (0..=100).map(|s| if (60..=62).contains(&s) { 1.25 } else { 9.0 }).collect();
    let mut test = following(PathSettings::default(), Arc::new(Route::along(&line, &clearance, DVec3::Z).unwrap()));
    let goal = Goal { at: on_route(1000.0), within_mm: 5.0, other_end: on_route(-1000.0) };
    super::super::watch::plug(&mut test.app, MonitorSettings::default(), goal).unwrap();
    test.app.equip(Hand { paused: true, ..Hand::default() });
    test.place(on_route(50.0));
    test.steps(1).unwrap();
    test.get_mut::<HelpCall>().0 = Some(Help { reason: "stuck".to_owned(), place: DVec3::X });
    test.steps(1).unwrap();
    let flight = test.get::<Flight>();
    assert_eq!(flight.state, State::Operator);
    assert_eq!(flight.reason, "the path ahead narrows to 2.5 mm across; the camera needs 3.0 mm");
}

#[test]
fn other_entities_follow_no_plan() {
    let mut test = body();
    let follower = test.get::<PathFollower>().clone();
    let body = (*test.get::<Body>(), *test.get::<Pose>(), Flight::default());
    let help = HelpCall(Some(Help { reason: "odd".to_owned(), place: DVec3::ZERO }));
    let plan = (Planned::new(route(), 24.0), follower, GuideThrust { thrust: DVec3::Z, ..GuideThrust::default() });
    let twin = test.app.world.spawn((body, plan, help)).id();
    test.steps(30).unwrap();
    assert!(s_mm(&test) > 40.0);
    let world = &test.app.world;
    assert_eq!(world.get::<Planned>(twin).unwrap().s_mm, 0.0);
    assert_eq!(world.get::<GuideThrust>(twin).unwrap().thrust, DVec3::Z);
}
