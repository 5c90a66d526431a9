//! Looks along the way, and at each stop of a review at what was missed there.
//!
//! Near a stop the flight slows down in proportion to the distance, comes nearly to rest, and waits until the view has turned: by the
//! same bounded law as always, and for a limited time. A stop that is not reached in its own time is given up, and the rest of the tour is
//! planned anew by the flight. A second one in a row calls the operator.

use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryData;
use glam::DVec3;

use super::way;
use crate::components::camera::Pose;
use crate::components::clock::Clock;
use crate::components::flight::{Flight, State};
use crate::components::guide::{GuideThrust, Planned};
use crate::components::input::Hand;
use crate::components::review::Review;
use crate::components::scan::Walls;
use crate::error::Result;
use crate::fields::Clearances;
use crate::schedule::{App, FlightSystems, Look, Main};

/// Distance along the way from a stop at which the flight slows down, mm.
const SLOWS_MM: f64 = 14.0;
/// Distance along the way from a stop at which the view turns to what was missed, if it is in view, mm.
const TURNS_MM: f64 = 20.0;
/// Distance along the way at which a stop is reached, mm, …
const THERE_MM: f64 = 1.0;
/// … if the camera is this near, mm: a plan that is joined farther ahead has left the stop out.
const NEAR_MM: f64 = 10.0;
/// Least share of its speed of a flight that nears a stop, and of one that waits there.
const NEARING: f64 = 0.12;
const WAITING: f64 = 1e-3;
/// The view has turned to a place within this angle, as its cosine: 6°.
const TURNED: f64 = 0.994_521_895_368_273;
/// Maximum time for which the flight waits for the view, s.
const WAITS_S: f64 = 4.0;
/// A line to the wall ends this far before it, mm: its voxels would count.
const BEFORE_MM: f64 = 0.8;

/// The look of a review.
pub const LOOK: Look =
    Look { name: "review", summary: "looks along the path, and at each stop at the missed patch", plug };

fn plug(app: &mut App) -> Result<()> {
    (way::LOOK.plug)(app)?;
    app.add_systems(FlightSystems::Look, look_at_stops.after(way::look_along_way));
    Ok(())
}

/// The camera on its tour.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct ReviewingCamera {
    pose: &'static Pose,
    planned: &'static Planned,
    review: &'static mut Review,
    guide: &'static mut GuideThrust,
    flight: &'static mut Flight,
    hand: Option<&'static Hand>,
}

/// Turns the view to the next stop's place near it, sets the flight's pace, and ends the tour after the last stop.
pub fn look_at_stops(
    clock: Res<Clock>,
    walls: Single<&Walls, With<Main>>,
    camera: Single<ReviewingCamera, With<Main>>,
) {
    let ReviewingCameraItem { pose, planned, mut review, mut guide, mut flight, hand } = camera.into_inner();
    if flight.state != State::Flying || hand.is_some_and(|h| h.is_in_control(clock.tick)) {
        return;
    }
    if review.jumps != planned.jumps {
        review.jumps = planned.jumps;
        review.go_on_from(planned.s_mm);
    }
    let Some(stop) = review.stops.get(review.next).copied() else {
        (flight.state, flight.place) = (State::Arrived, pose.position);
        return;
    };
    // A slower flight takes longer.
    review.spent_s += clock.dt() * hand.map_or(1.0, |h| h.speed.min(1.0));
    if review.spent_s > stop.limit_s {
        if review.fail(pose.position) {
            (flight.state, flight.place) = (State::Operator, pose.position);
            flight.reason = match review.left() {
                0 => "the review did not reach its last two stops".to_owned(),
                1 => "the review did not reach two stops in a row; 1 stop is left".to_owned(),
                left => format!("the review did not reach two stops in a row; {left} stops are left"),
            };
            // The operator moves the camera on, and the next stop has its own two tries.
            review.failed = 0;
        }
        return;
    }
    let left_mm = stop.s_mm - planned.s_mm;
    if left_mm <= THERE_MM
        && review.held_s.is_none()
        && pose.position.distance(planned.route.place(stop.s_mm)) > NEAR_MM
    {
        review.skip();
        return;
    }
    let Some(target) = stop.look_at else {
        review.pace = 1.0;
        if left_mm <= THERE_MM {
            review.leave(true);
        }
        return;
    };
    let towards = target - pose.position;
    if let Some(held_s) = review.held_s {
        review.pace = WAITING;
        review.held_s = Some(held_s + clock.dt());
        let has_turned = pose.attitude.forward.dot(towards.normalize_or_zero()) > TURNED;
        if has_turned || held_s > WAITS_S {
            review.leave(has_turned);
            return;
        }
    } else {
        review.pace = (left_mm / SLOWS_MM).clamp(NEARING, 1.0);
        if left_mm <= THERE_MM {
            review.held_s = Some(0.0);
        }
    }
    let length = towards.length();
    let is_in_sight = || !walls.0.enters(pose.position, target - towards * (BEFORE_MM / length.max(BEFORE_MM)));
    let turns = review.held_s.is_some() || (left_mm < TURNS_MM && is_in_sight());
    if turns && length > 0.0 && guide.look_direction != DVec3::ZERO {
        guide.look_direction = towards / length;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::components::review::TourStop;
    use crate::dynamics::Attitude;
    use crate::dynamics::route::Route;
    use crate::testing::{Room, TestApp};

    /// A camera on a straight tour with stops at 30 mm, which looks to the side, and at 60 mm, which it passes.
    fn touring() -> TestApp {
        let line: Vec<DVec3> = (0..=60).map(|n| DVec3::new(20.0, 10.0 + f64::from(n), 10.0)).collect();
        let route = Arc::new(Route::along(&line, &[8.0; 61], DVec3::Z).unwrap());
        let mut test = TestApp::new(&Room::new([40, 90, 20]));
        let stop = |s_mm: f64, look_at| TourStop { s_mm, look_at, limit_s: 8.0 };
        let review = Review::new(vec![stop(30.0, Some(DVec3::new(38.0, 40.0, 10.0))), stop(60.0, None)]);
        let guide = GuideThrust { look_direction: DVec3::Y, ..GuideThrust::default() };
        test.app.equip((Planned::new(route, 24.0), guide, review));
        plug(&mut test.app).unwrap();
        test.place(line[0]);
        test
    }

    /// Runs a step with the camera at `s` mm of the tour. Returns its pace and where it looks.
    fn at(test: &mut TestApp, s: f64) -> (f64, DVec3) {
        test.get_mut::<GuideThrust>().look_direction = DVec3::Y;
        test.get_mut::<Planned>().s_mm = s;
        test.place(DVec3::new(20.0, 10.0 + s, 10.0));
        test.steps(1).unwrap();
        (test.get::<Review>().pace, test.get::<GuideThrust>().look_direction)
    }

    #[test]
    fn it_slows_down_turns_waits_and_goes_on() {
        let mut test = touring();
        let (pace, look) = at(&mut test, 2.0);
        assert!(pace == 1.0 && look.dot(DVec3::Y) > 0.99, "far from a stop it looks along the way");
        let (pace, look) = at(&mut test, 22.0);
        assert!((pace - 8.0 / SLOWS_MM).abs() < 1e-9 && look.x > 0.8, "{pace} {look}");
        at(&mut test, 29.5);
        let (pace, look) = at(&mut test, 29.6);
        assert!(pace == WAITING && look.x > 0.99 && test.get::<Review>().next == 0);
        // The view arrives.
        let pose = *test.get::<Pose>();
        *test.get_mut::<Pose>() = Pose { attitude: Attitude::new(DVec3::X, DVec3::Z), ..pose };
        test.steps(1).unwrap();
        assert_eq!((test.get::<Review>().next, test.get::<Review>().reached), (1, 1));
        assert_eq!(at(&mut test, 40.0).0, 1.0);
        at(&mut test, 59.5);
        test.steps(1).unwrap();
        assert_eq!((test.get::<Flight>().state, test.get::<Review>().reached), (State::Arrived, 2));
    }

    #[test]
    fn it_waits_for_a_limited_time_and_calls_where_it_hangs() {
        let mut test = touring();
        at(&mut test, 29.5);
        test.steps(500).unwrap();
        let review = test.get::<Review>();
        assert_eq!((review.next, review.reached), (1, 0), "not looked at, and left");
        // It hangs before the second stop, the last one: the flight plans the rest, and nobody needs to be called.
        test.steps(1000).unwrap();
        let review = test.get::<Review>();
        assert!((review.next, review.reached, review.failed, review.replan) == (2, 0, 1, true));
        assert!(review.hung.is_some_and(|h| h.distance(test.get::<Pose>().position) < 1e-9));
        assert!(test.get::<Flight>().state != State::Operator);
    }

    #[test]
    fn the_second_stop_in_a_row_that_is_not_reached_calls() {
        for left in [0, 1, 5] {
            let mut test = touring();
            let more = TourStop { s_mm: 60.0, look_at: None, limit_s: 8.0 };
            test.get_mut::<Review>().stops.extend(vec![more; left]);
            at(&mut test, 5.0);
            test.steps(1000).unwrap();
            assert!(test.get::<Review>().failed == 1 && test.get::<Flight>().state == State::Flying);
            test.steps(1000).unwrap();
            let (flight, review) = (test.get::<Flight>(), test.get::<Review>());
            assert!(flight.state == State::Operator && (review.next, review.reached) == (2, 0));
            let told = match left {
                0 => "the review did not reach its last two stops",
                1 => "the review did not reach two stops in a row; 1 stop is left",
                _ => "the review did not reach two stops in a row; 5 stops are left",
            };
            assert_eq!(flight.reason, told);
            // The operator brings it on: the next stop has its own two tries.
            assert!(!review.replan && review.failed == 0);
        }
    }

    #[test]
    fn a_stop_that_is_reached_between_two_others_calls_nobody() {
        let mut test = touring();
        let more = TourStop { s_mm: 60.0, look_at: None, limit_s: 8.0 };
        test.get_mut::<Review>().stops.push(more);
        at(&mut test, 5.0);
        test.steps(1000).unwrap();
        assert_eq!(test.get::<Review>().failed, 1);
        at(&mut test, 59.5);
        let review = test.get::<Review>();
        assert_eq!((review.next, review.reached, review.failed, review.hung), (2, 1, 0, None));
    }

    #[test]
    fn a_stop_that_the_plan_leaves_behind_is_not_reached() {
        let mut test = touring();
        test.get_mut::<Review>().next = 1;
        test.get_mut::<Planned>().s_mm = 59.5;
        test.place(DVec3::new(20.0, 40.0, 10.0));
        test.steps(1).unwrap();
        let review = test.get::<Review>();
        assert_eq!((review.next, review.reached), (2, 0));
    }

    #[test]
    fn after_a_jump_it_goes_on_with_the_next_stop() {
        let mut test = touring();
        test.get_mut::<Planned>().jumps += 1;
        at(&mut test, 45.0);
        assert_eq!(test.get::<Review>().next, 1);
        test.get_mut::<Planned>().jumps += 1;
        at(&mut test, 5.0);
        assert_eq!(test.get::<Review>().next, 0);
    }
}
