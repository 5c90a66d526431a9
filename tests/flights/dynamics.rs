//! The rigid body in flight: under operator input, stuck in a wall, and moved by every integrator.

use colvis::app::plan::FlightRequest;
use colvis::app::{FlightApp, Scene};
use colvis::components::camera::{AngularMomentum, Pose};
use colvis::components::flight::State;
use colvis::components::input::HandCommand;
use colvis::dynamics::Integrator;
use colvis::phantom::{PhantomSettings, Size, Truth};
use colvis::space::value;
use colvis::volume::Volume;
use glam::DVec3;

use crate::support::flights::{flight, fly, scan};
use crate::support::phantom::phantom;

fn small() -> (Volume, Truth) {
    phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() })
}

fn steps(f: &mut FlightApp, count: usize) {
    for _ in 0..count {
        f.step().unwrap();
    }
}

#[test]
fn a_camera_in_the_wall_calls_the_operator() {
    let (volume, truth) = small();
    let scene = Scene { log: true, operator: true, ..Scene::default() };
    let mut f = flight(volume, scene, &FlightRequest::default());
    // Deep in tissue: out from the axis, until there is only tissue around.
    let axis = truth.centerline[truth.centerline.len() / 2];
    let solid = |p: DVec3| {
        (0..6).all(|n| {
            let mut d = DVec3::ZERO;
            d[n / 2] = if n % 2 == 0 { 2.0 } else { -2.0 };
            value(&f.setup().volume, p + d) > -300.0 && value(&f.setup().volume, p) > -300.0
        })
    };
    let inside = (0..400).map(|n| axis + DVec3::X * 0.2 * f64::from(n)).find(|&p| solid(p)).expect("tissue");
    f.camera_mut::<Pose>().unwrap().position = inside;
    steps(&mut f, 59);
    assert_eq!(f.flight().state, State::Flying, "half a second to find a way out");
    steps(&mut f, 2);
    let told = f.flight();
    assert_eq!(told.state, State::Operator);
    assert!(told.reason.contains("in the wall") && told.place.distance(inside) < 1e-9, "{told:?}");
    assert_eq!(f.pose().position, inside, "it was moved nowhere");
    // The operator cannot push it through the wall either.
    f.act(HandCommand::Push([1.0, 0.0, 0.0])).unwrap();
    steps(&mut f, 240);
    assert!(f.pose().position.distance(inside) < 1e-9);
}

#[test]
#[ignore = "slow: every push and turn"]
fn the_hand_turns_and_pushes_in_six_degrees_of_freedom() {
    let (volume, _) = small();
    let scene = Scene { log: true, operator: true, ..Scene::guided_by("manual") };
    let mut f = flight(volume, scene, &FlightRequest::default());
    for (turn, axis) in [([1.0, 0.0, 0.0], 0), ([0.0, -1.0, 0.0], 1), ([0.0, 0.0, 1.0], 2)] {
        let before = f.pose().attitude;
        f.act(HandCommand::Turn(turn)).unwrap();
        steps(&mut f, 120);
        assert!(f.camera::<AngularMomentum>().unwrap().0.length() > 0.0, "angular momentum, not a jump");
        f.act(HandCommand::Turn([0.0; 3])).unwrap();
        steps(&mut f, 240);
        let after = f.pose().attitude;
        let (view, up) = (before.forward.angle_between(after.forward), before.up.angle_between(after.up));
        let right = before.right().angle_between(after.right());
        // The vector along the axis stays; the others turn by one second at 1.2 rad/s.
        let turned = [[view, right, up], [view, up, right], [up, right, view]][axis];
        assert!(turned[2] < 1e-7, "{axis}: {turned:?}");
        assert!((turned[0] - 1.2).abs() < 1.5e-7 && (turned[1] - 1.2).abs() < 1.5e-7, "{axis}: {turned:?}");
        steps(&mut f, 60);
        assert_eq!(f.pose().attitude, after, "at rest to the last bit");
        assert_eq!(f.camera::<AngularMomentum>().unwrap().0, DVec3::ZERO);
    }
    for push in [[0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.3], [0.0, 0.0, -0.3]] {
        let before = f.pose();
        f.act(HandCommand::Push(push)).unwrap();
        steps(&mut f, 10);
        f.act(HandCommand::Push([0.0; 3])).unwrap();
        let moved = f.pose().position - before.position;
        let [x, y, z] = push;
        let a = before.attitude;
        assert!(moved.dot(a.right() * x + a.up * y + a.forward * z) > 0.0, "{push:?}: {moved}");
        steps(&mut f, 240);
    }
}

#[test]
#[ignore = "slow: a flight by each integrator"]
fn every_integrator_flies_by_its_name_in_a_scene() {
    let mut scan = scan(small().0);
    for (integrator, name) in Integrator::ALL {
        let text = format!(
            "plugins = [\"tentacles\", \"mines\"]\n[body]\nintegrator = \"{name}\"\ncylinder_length_mm = 0.5\nmass_g = 1e-3\n"
        );
        let scene = Scene { log: true, ..Scene::parse(&text, &colvis::app::Catalog::default()).unwrap() };
        assert_eq!(scene.body.integrator, integrator);
        let mut f = scan.flight(scene, &FlightRequest::default()).unwrap();
        let log = fly(&mut f, 5.0);
        assert!(f.flight().length_mm > 80.0, "{name}: {:?}", f.flight());
        assert!(log.iter().all(|l| l.clearance_mm >= 1.5), "{name}");
    }
    for bad in
        ["integrator = \"warp\"", "cylinder_length_mm = 9.0", "cylinder_radius_mm = -1", "mass_g = 0", "mass_g = nan"]
    {
        let text = format!("plugins = [\"tentacles\"]\n[body]\n{bad}\n");
        assert!(Scene::parse(&text, &colvis::app::Catalog::default()).is_err(), "{bad}");
    }
}
