//! Looks at the farthest point of the way that is still in view.
//!
//! The way is the guide's plan, or the steepest descent of the distance to the target. How far along it the view reaches follows what
//! is in view at a bounded speed: the reach `r` grows by at most 90 mm/s where the place at `r` can be seen in a straight
//! line, and shrinks by at most 180 mm/s where it cannot. It is continuous, and so is the direction from the camera to the
//! place; the view turns there as a critically damped oscillator ([`Turning`](crate::dynamics::Turning)). In a bend this is the
//! place before the way disappears behind the inner wall, so the view turns into the bend before the body does.
//!
//! The turn lags behind a moving target by half a second, in which the body flies a third of the way through a sharp bend: the view
//! would still be on the wall that the way has left. So for a body on a plan the look is taken from where it will be a little later.
//! A body that descends a field does not keep to its way, and looks from where it is.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::guide::{Gaze, GuideThrust, Planned, PotentialField};
use crate::components::scan::Walls;
use crate::dynamics::potential::descent;
use crate::error::Result;
use crate::fields::Clearances;
use crate::schedule::{App, FlightSystems, Look, Main};

/// Speed at which the reach grows and shrinks, mm/s.
const GROWS_MM_S: f64 = 90.0;
const SHRINKS_MM_S: f64 = 180.0;
/// Maximum reach of the first look, mm.
const BEGINS_MM: f64 = 24.0;
/// Time by which the look is ahead of the body, s: a good half of the view's lag. With all of it the view cuts corners, and shows
/// the inner wall of a bend before the body has reached it.
const LEAD_S: f64 = 0.25;
/// Maximum distance by which the look is ahead of the body, mm.
const LEAD_MM: f64 = 16.0;
/// Distance between two places of the way, mm.
const STEP_MM: f64 = 2.0;
/// Number of places of the way, up to the farthest that is looked at.
const PLACES: usize = ((Gaze::MOST_MM + LEAD_MM) / STEP_MM) as usize + 1;

/// The look.
pub const LOOK: Look = Look { name: "way", summary: "looks at the farthest visible point of the path", plug };

fn plug(app: &mut App) -> Result<()> {
    app.equip(Gaze::default());
    app.add_systems(FlightSystems::Look, look_along_way);
    Ok(())
}

/// The guides that know the way.
type Ways<'a> = (
    &'a Pose,
    Option<&'a Velocity>,
    Option<&'a Planned>,
    Option<&'a PotentialField>,
    &'a mut Gaze,
    &'a mut GuideThrust,
);

/// Turns the guide's direction to the farthest place of the way in view. A guide without a way keeps its own direction.
pub fn look_along_way(clock: Res<Clock>, walls: Single<&Walls, With<Main>>, camera: Single<Ways, With<Main>>) {
    let (pose, velocity, planned, field, mut gaze, mut guide) = camera.into_inner();
    if guide.look_direction == DVec3::ZERO {
        *gaze = Gaze::default();
        return;
    }
    let way = match (planned, field.and_then(|f| f.target.as_deref())) {
        (Some(p), _) => std::array::from_fn(|n| p.route.beyond(p.s_mm + STEP_MM * n as f64)),
        (None, Some(target)) => descent(target, pose.position, STEP_MM),
        (None, None) => return,
    };
    let lead = planned.and(velocity).map_or(0.0, |v| (LEAD_S * v.0.length()).min(LEAD_MM));
    // A body beside its way stays beside it.
    let eye = pose.position + (at(&way, lead) - way[0]);
    let place = |mm: f64| at(&way, lead + mm);
    let in_sight = |mm: f64| !walls.0.enters(eye, place(mm));
    let jumps = planned.map_or(0, |p| p.jumps);
    if gaze.jumps != Some(jumps) {
        // The camera was placed with a view along the next stretch of the way, and continues from there.
        let seen = (1..PLACES).map(|n| STEP_MM * n as f64).take_while(|&mm| in_sight(mm)).last();
        *gaze = Gaze { reach_mm: seen.unwrap_or(0.0).clamp(Gaze::LEAST_MM, BEGINS_MM), jumps: Some(jumps) };
    } else if in_sight(gaze.reach_mm) {
        gaze.reach_mm = (gaze.reach_mm + GROWS_MM_S * clock.dt()).min(Gaze::MOST_MM);
    } else {
        gaze.reach_mm = (gaze.reach_mm - SHRINKS_MM_S * clock.dt()).max(Gaze::LEAST_MM);
    }
    let towards = (place(gaze.reach_mm) - eye).normalize_or_zero();
    if towards != DVec3::ZERO {
        guide.look_direction = towards;
    }
}

/// Returns the place of a way after `mm`.
fn at(way: &[DVec3; PLACES], mm: f64) -> DVec3 {
    let u = (mm / STEP_MM).clamp(0.0, (PLACES - 1) as f64);
    let n = (u as usize).min(PLACES - 2);
    way[n].lerp(way[n + 1], u - n as f64)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use crate::dynamics::route::Route;
    use crate::fields::{Distance, Sample};
    use crate::testing::{Room, TestApp};

    /// A camera at a place of a room whose plan leads through these places (world mm).
    fn planned(room: &Room, line: &[DVec3]) -> TestApp {
        let route = Arc::new(Route::along(line, &vec![5.0; line.len()], DVec3::Z).unwrap());
        let mut test = TestApp::new(room);
        test.app.equip((Planned::new(route, 24.0), GuideThrust { look_direction: DVec3::Y, ..GuideThrust::default() }));
        plug(&mut test.app).unwrap();
        test.place(line[0]);
        test
    }

    fn towards(test: &TestApp) -> DVec3 {
        test.get::<GuideThrust>().look_direction
    }

    /// Along y, then around a corner along x, 1 mm apart.
    fn corner(from: DVec3, legs: [usize; 2]) -> Vec<DVec3> {
        let mut line: Vec<DVec3> = (0..=legs[0]).map(|n| from + DVec3::Y * n as f64).collect();
        let turn = line[legs[0]];
        line.extend((1..=legs[1]).map(|n| turn + DVec3::X * n as f64));
        line
    }

    #[test]
    fn it_looks_at_the_last_place_before_a_wall() {
        let room = Room::new([30, 60, 20]);
        // The way leaves the room 15 mm after its corner, 30 mm from the start.
        let line = corner(DVec3::new(15.0, 10.0, 10.0), [30, 60]);
        let mut test = planned(&room, &line);
        test.steps(240).unwrap();
        let reach = test.get::<Gaze>().reach_mm;
        assert!((reach - 45.0).abs() < 2.5, "{reach} mm along the way to the wall");
        assert!(towards(&test).angle_between(DVec3::new(15.0, 30.0, 0.0)) < 0.06, "{}", towards(&test));
        // Nearer to the wall the flight slows down.
        test.place(line[42]);
        test.get_mut::<Planned>().s_mm = 42.0;
        test.steps(240).unwrap();
        assert!(test.get::<Gaze>().reach_mm <= Gaze::LEAST_MM + 1.0 && test.get::<Gaze>().pace() < 0.5);
    }

    /// The view lags, so a body that moves looks from a quarter of a second ahead; however fast, from no farther than 16 mm.
    #[test]
    fn a_body_in_motion_looks_from_where_it_will_be() {
        let room = Room::new([30, 60, 20]);
        let line = corner(DVec3::new(15.0, 10.0, 10.0), [30, 60]);
        for (speed, lead) in [(0.0, 0.0), (30.0, 7.5), (20.0, 5.0), (1e6, 16.0)] {
            let mut test = planned(&room, &line);
            test.app.camera().insert(Velocity(DVec3::Y * speed));
            test.steps(240).unwrap();
            let reach = test.get::<Gaze>().reach_mm;
            assert!((reach - (45.0 - lead)).abs() < 2.5, "{reach} mm from {lead} mm ahead to the wall");
            let last = DVec3::new(15.0, 30.0 - lead, 0.0);
            assert!(towards(&test).angle_between(last) < 0.06, "{} at {speed} mm/s", towards(&test));
        }
    }

    #[test]
    fn what_comes_into_sight_is_looked_at_gradually() {
        let room = Room::new([40, 90, 20]);
        let line = corner(DVec3::new(20.0, 5.0, 10.0), [80, 60]);
        let mut test = planned(&room, &line);
        test.steps(1).unwrap();
        let mut before = (test.get::<Gaze>().reach_mm, towards(&test));
        assert!(before.0 <= BEGINS_MM);
        for _ in 0..200 {
            test.steps(1).unwrap();
            let now = (test.get::<Gaze>().reach_mm, towards(&test));
            assert!((now.0 - before.0).abs() <= SHRINKS_MM_S / 120.0 + 1e-9);
            assert!(now.1.angle_between(before.1) < 0.02, "{} after {}", now.1, before.1);
            before = now;
        }
        assert_eq!(before.0, Gaze::MOST_MM);
    }

    /// The distance to a point.
    struct To(DVec3);

    impl Distance for To {
        fn sample(&self, at: DVec3) -> Option<Sample> {
            let gradient = (at - self.0).normalize_or_zero();
            Some(Sample { mm: at.distance(self.0), gradient, hessian: DMat3::ZERO })
        }
    }

    #[test]
    fn without_a_plan_the_descent_to_the_target_is_the_way() {
        let room = Room::new([40, 90, 20]);
        let mut test = TestApp::new(&room);
        let target = DVec3::new(5.0, 80.0, 10.0);
        let field = PotentialField {
            potential: crate::dynamics::Potential::default(),
            wall: Arc::new(To(DVec3::ZERO)),
            target: Some(Arc::new(To(target))),
        };
        test.app.equip((field, GuideThrust { look_direction: DVec3::X, ..GuideThrust::default() }));
        plug(&mut test.app).unwrap();
        test.place(DVec3::new(30.0, 10.0, 10.0));
        test.steps(120).unwrap();
        assert!(towards(&test).angle_between(target - DVec3::new(30.0, 10.0, 10.0)) < 1e-6);
    }

    #[test]
    fn a_guide_without_a_way_or_a_direction_keeps_what_it_has() {
        let room = Room::new([20; 3]);
        let mut test = TestApp::new(&room);
        test.app.equip(GuideThrust { look_direction: DVec3::X, ..GuideThrust::default() });
        plug(&mut test.app).unwrap();
        test.steps(1).unwrap();
        assert_eq!(towards(&test), DVec3::X);
        let mut test = planned(&room, &[DVec3::splat(10.0), DVec3::splat(14.0)]);
        test.get_mut::<GuideThrust>().look_direction = DVec3::ZERO;
        test.steps(1).unwrap();
        assert_eq!(towards(&test), DVec3::ZERO);
        // An invalid place: the view keeps a direction.
        for lost in [DVec3::NAN, DVec3::splat(1e300)] {
            test.get_mut::<GuideThrust>().look_direction = DVec3::Y;
            test.place(lost);
            test.steps(3).unwrap();
            assert!(towards(&test).is_finite() && test.get::<Gaze>().reach_mm >= Gaze::LEAST_MM);
        }
    }
}
