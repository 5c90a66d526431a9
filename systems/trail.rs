//! Records where the flight has been: for coverage, for flying back and for the progress bar.

use bevy_ecs::prelude::*;

use crate::components::camera::Pose;
use crate::components::flight::{Flight, State};
use crate::components::guide::Planned;
use crate::components::trail::Trail;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Adds the trail to the camera.
pub fn plugin(app: &mut App) -> Result<()> {
    app.camera().insert_if_new(Trail::default());
    app.add_systems(FlightSystems::Trail, follow_trail);
    Ok(())
}

/// Records the view after a step, and its position along the path: by the plan, or by the distance flown.
pub fn follow_trail(camera: Single<(&Pose, &Flight, &mut Trail, Option<&Planned>), With<Main>>) {
    let (pose, flight, mut trail, planned) = camera.into_inner();
    let planned = planned.map(|p| (p.s_mm, p.route.length_mm()));
    trail.follow((pose.position, pose.attitude), flight.length_mm, planned);
    match flight.state {
        State::Arrived => trail.arrive(),
        State::Operator => trail.call(),
        State::Flying | State::Ended => {}
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::dynamics::{Attitude, Route};
    use crate::testing::{Room, TestApp};

    /// A camera at the start of a path 80 mm long.
    fn test() -> TestApp {
        let mut test = TestApp::new(&Room::new([4; 3]));
        plugin(&mut test.app).unwrap();
        test.get_mut::<Trail>().set_out(80.0);
        test
    }

    /// Runs a step after which the camera is at x, and has flown this far. Returns its share of the path.
    fn at(test: &mut TestApp, x: f64, flown: f64) -> f64 {
        test.place(DVec3::X * x);
        test.get_mut::<Flight>().length_mm = flown;
        test.steps(1).unwrap();
        test.get::<Trail>().share()
    }

    #[test]
    fn the_share_is_the_distance_flown_over_the_length() {
        let mut test = test();
        assert_eq!(at(&mut test, 0.0, 0.0), 0.0);
        assert_eq!(at(&mut test, 5.0, 20.0), 0.25, "by the flight's length, however the position differs");
        assert_eq!(at(&mut test, 5.0, 20.0), 0.25, "at rest it stays");
        test.get_mut::<Trail>().turn_round();
        assert_eq!(at(&mut test, 5.0, 20.0), 0.75);
        assert_eq!(at(&mut test, 3.0, 28.0), 0.85);
        test.get_mut::<Trail>().jump(0.5);
        assert_eq!(at(&mut test, 9.0, 32.0), 0.55, "on from where the jump led");
        test.get_mut::<Flight>().state = State::Arrived;
        assert_eq!(at(&mut test, 9.0, 32.0), 1.0, "whatever the count is");
        assert!(test.get::<Trail>().calls().is_empty());
    }

    #[test]
    fn a_plan_tells_the_share_by_its_own_length() {
        let mut test = test();
        let line = [0.0, 20.0, 40.0].map(|x| DVec3::X * x);
        let route = Route::along(&line, &[5.0; 3], DVec3::Z).unwrap();
        assert!((route.length_mm() - 40.0).abs() < 1e-9);
        test.app.equip(Planned { s_mm: 10.0, ..Planned::new(Arc::new(route), 20.0) });
        assert!((at(&mut test, 33.0, 70.0) - 0.25).abs() < 1e-9, "not by the distance flown");
        assert!((test.get::<Trail>().length_mm() - 40.0).abs() < 1e-9);
        test.get_mut::<Planned>().s_mm = 30.0;
        assert!((at(&mut test, 33.0, 71.0) - 0.75).abs() < 1e-9);
        // Without it the count goes on from there, by what is flown from now on.
        test.app.camera().remove::<Planned>();
        assert!((at(&mut test, 33.0, 75.0) - 0.85).abs() < 1e-9);
    }

    #[test]
    fn calls_are_marked_once_where_they_are_made() {
        let mut test = test();
        at(&mut test, 2.0, 16.0);
        test.get_mut::<Flight>().state = State::Operator;
        assert_eq!(at(&mut test, 3.0, 20.0), 0.25);
        at(&mut test, 3.0, 20.0);
        at(&mut test, 3.0, 20.4);
        assert_eq!(test.get::<Trail>().calls(), [0.25], "and not in the step before");
        for state in [State::Flying, State::Ended] {
            test.get_mut::<Flight>().state = state;
            assert_eq!(at(&mut test, 3.0, 40.0), 0.5);
        }
        test.get_mut::<Flight>().state = State::Operator;
        at(&mut test, 3.0, 60.0);
        assert_eq!(test.get::<Trail>().calls(), [0.25, 0.75]);
    }

    #[test]
    fn the_view_after_each_step_is_recorded_and_other_cameras_are_left_alone() {
        let mut test = test();
        let other = (*test.get::<Pose>(), Flight { state: State::Operator, ..Flight::default() }, Trail::default());
        let other = test.app.world.spawn(other).id();
        at(&mut test, 1.0, 1.0);
        at(&mut test, 2.5, 2.5);
        at(&mut test, 3.0, 3.0);
        let look = Attitude::new(DVec3::Y, DVec3::Z);
        assert_eq!(test.get::<Trail>().views(), [1.0, 3.0].map(|x| (DVec3::X * x, look)), "2 mm apart");
        plugin(&mut test.app).unwrap();
        assert_eq!(test.get::<Trail>().views().len(), 2, "adding the system keeps what is there");
        let trail = test.app.world.get::<Trail>(other).unwrap();
        assert!(trail.views().is_empty() && trail.calls().is_empty());
    }
}
