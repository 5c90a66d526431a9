use glam::DMat3;

use super::*;
use crate::components::flight::{Help, State};
use crate::fields::{Distance, Sample};
use crate::testing::{Room, TestApp};

const TARGET: DVec3 = DVec3::new(10.0, 19.0, 10.0);

/// The distance to a point.
struct To(DVec3);

impl Distance for To {
    fn sample(&self, at: DVec3) -> Option<Sample> {
        let mm = at.distance(self.0);
        Some(Sample { mm, gradient: (at - self.0).normalize_or_zero(), hessian: DMat3::ZERO })
    }
}

/// The cameras that helped themselves, in order.
#[derive(Resource, Default)]
struct Answered(Vec<Entity>);

fn settings() -> Potential {
    Potential { target_force: 150.0, wall_energy: 50.0, reach_mm: 7.0 }
}

/// A body of 2.5 g that a potential guides, with steps of a tenth of a second. Nothing moves it.
fn guided() -> TestApp {
    let mut test = TestApp::new(&Room::new([20; 3]));
    test.app.world.resource_mut::<Clock>().hz = 10;
    let potential = settings();
    let body = dynamics::Body { mass_g: 2.5, drag_per_s: 4.0, ..dynamics::Body::default() };
    test.app.equip((
        Body(body),
        HelpCall::default(),
        YieldingPotential { potential, yields: 0, yields_until: 0 },
        PotentialField { potential, wall: Arc::new(To(DVec3::ZERO)), target: Some(Arc::new(To(TARGET))) },
    ));
    test.app.add_systems(FlightSystems::Guide, guide_by_potential);
    test.app.add_systems(FlightSystems::Answer, yield_to_trap);
    test.app.world.init_resource::<Answered>();
    test.app.observe(|answered: On<HelpAnswered>, mut all: ResMut<Answered>| all.0.push(answered.entity));
    test
}

fn call(test: &mut TestApp) {
    test.get_mut::<HelpCall>().0 = Some(Help { reason: "stuck".to_owned(), place: DVec3::X });
}

fn field(test: &TestApp) -> Potential {
    test.get::<PotentialField>().potential
}

#[test]
fn it_needs_the_distances_to_the_wall() {
    let mut test = TestApp::new(&Room::new([20; 3]));
    let refused = settings().plug(&mut test.app).unwrap_err().to_string();
    assert!(refused.contains("distances to the wall are missing"), "{refused}");
    assert!(test.app.camera_get::<PotentialField>().is_none());
    let body = dynamics::Body { mass_g: 2.5, drag_per_s: 4.0, ..dynamics::Body::default() };
    assert_eq!(Guide::cruise_mm_s(&settings(), &body), 15.0, "150/(2.5 · 4)");
    let free = dynamics::Body { drag_per_s: 0.0, ..body };
    assert!(Guide::cruise_mm_s(&settings(), &free).is_finite());
    assert!(Guide::check(&Potential { reach_mm: 0.0, ..settings() }).is_err());
}

#[test]
fn it_looks_at_the_target_and_leaves_the_force_to_the_field() {
    let mut test = guided();
    let [thrust, wall, look_direction] = [DVec3::X, DVec3::Y, DVec3::X];
    *test.get_mut::<GuideThrust>() = GuideThrust { thrust, wall, limit: 1.0, look_direction, exact: true };
    test.steps(1).unwrap();
    let guide = *test.get::<GuideThrust>();
    assert_eq!((guide.thrust, guide.wall, guide.exact), (DVec3::ZERO, DVec3::ZERO, false));
    assert_eq!(guide.limit, 60.0, "150/2.5");
    assert!(guide.look_direction.distance(DVec3::Y) < 1e-12);
    test.place(TARGET + DVec3::new(3.0, 0.0, 4.0));
    test.steps(1).unwrap();
    assert!(test.get::<GuideThrust>().look_direction.distance(DVec3::new(-0.6, 0.0, -0.8)) < 1e-12);
    test.get_mut::<PotentialField>().target = None;
    test.steps(1).unwrap();
    assert_eq!(test.get::<GuideThrust>().look_direction, DVec3::ZERO, "it knows of no target any more");
}

#[test]
fn the_field_is_as_requested_while_nothing_calls() {
    let mut test = guided();
    test.get_mut::<PotentialField>().potential.wall_energy = 1.0;
    test.get_mut::<PotentialField>().potential.target_force = 1.0;
    test.steps(50).unwrap();
    assert_eq!(field(&test), settings());
    assert_eq!(test.get::<Flight>().escapes, 0);
    assert!(test.app.world.resource::<Answered>().0.is_empty());
}

#[test]
fn in_a_trap_the_wall_is_a_fiftieth_for_four_seconds() {
    let mut test = guided();
    let flight = Flight { turns: 1, escapes: 3, length_mm: 5.0, ..Flight::default() };
    test.app.camera().insert(flight);
    test.steps(7).unwrap();
    call(&mut test);
    test.steps(1).unwrap();
    assert_eq!(field(&test), settings(), "from the next step on");
    assert!(test.get::<HelpCall>().0.is_none(), "the operator is not called");
    assert_eq!(test.app.world.resource::<Answered>().0, [test.app.camera_id()]);
    // Called at tick 7: up to tick 47, which is not included.
    for tick in 8..47 {
        test.steps(1).unwrap();
        assert_eq!(field(&test), Potential { wall_energy: 1.0, ..settings() }, "tick {tick}");
    }
    for tick in 47..100 {
        test.steps(1).unwrap();
        assert_eq!(field(&test), settings(), "tick {tick}");
    }
    let flight = test.get::<Flight>();
    assert_eq!((flight.state, flight.turns, flight.escapes, flight.length_mm), (State::Flying, 1, 4, 5.0));
    assert_eq!((flight.reason.as_str(), flight.place), ("", DVec3::ZERO));
    assert_eq!(test.app.world.resource::<Answered>().0.len(), 1);
}

#[test]
fn a_call_meanwhile_begins_the_four_seconds_anew() {
    let mut test = guided();
    call(&mut test);
    test.steps(21).unwrap();
    call(&mut test);
    test.steps(1).unwrap();
    // Called at tick 21, so up to tick 61.
    test.steps(39).unwrap();
    assert_eq!(field(&test).wall_energy, 1.0, "not weaker than in the first");
    test.steps(1).unwrap();
    assert_eq!(field(&test).wall_energy, 50.0);
}

#[test]
fn it_helps_itself_six_times_and_then_the_call_stands() {
    let mut test = guided();
    for n in 1..=6 {
        call(&mut test);
        test.steps(1).unwrap();
        assert!(test.get::<HelpCall>().0.is_none(), "{n}");
        assert_eq!((test.get::<Flight>().escapes, test.app.world.resource::<Answered>().0.len()), (n, n as usize));
    }
    test.steps(50).unwrap();
    call(&mut test);
    test.steps(3).unwrap();
    assert!(test.get::<HelpCall>().0.as_ref().is_some_and(|h| h.reason == "stuck" && h.place == DVec3::X));
    assert_eq!((test.get::<Flight>().escapes, test.app.world.resource::<Answered>().0.len()), (6, 6));
    assert_eq!(field(&test), settings());
}

#[test]
fn other_entities_are_not_guided() {
    let mut test = guided();
    let potential = settings();
    let yielding = YieldingPotential { potential, yields: 0, yields_until: 1000 };
    let field = PotentialField { potential, wall: Arc::new(To(DVec3::ZERO)), target: Some(Arc::new(To(TARGET))) };
    let help = HelpCall(Some(Help { reason: "odd".to_owned(), place: DVec3::ZERO }));
    let pose = *test.get::<Pose>();
    let body = Body(dynamics::Body::default());
    let twin = test.app.world.spawn((yielding, field, help, pose, body, Flight::default())).id();
    call(&mut test);
    test.steps(3).unwrap();
    assert!(test.get::<HelpCall>().0.is_none() && test.get::<GuideThrust>().limit == 60.0);
    let world = &test.app.world;
    assert!(world.get::<HelpCall>(twin).unwrap().0.is_some());
    assert_eq!(world.get::<Flight>(twin).unwrap().escapes, 0);
    assert_eq!(world.get::<PotentialField>(twin).unwrap().potential, settings());
    assert_eq!(world.get::<GuideThrust>(twin).unwrap().limit, 0.0);
}
