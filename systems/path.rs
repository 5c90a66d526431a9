//! The guide that follows a plan: a force keeps the body at its planned position.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryData;
use glam::DVec3;

use crate::components::camera::{Body, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, HelpCall, State};
use crate::components::guide::{Gaze, GuideThrust, Planned};
use crate::components::input::Hand;
use crate::components::review::Review;
use crate::components::scan::{Centerline, Walls};
use crate::components::trail::Trail;
use crate::dynamics;
use crate::dynamics::Route;
use crate::dynamics::route::back::way_back;
use crate::dynamics::route::follower::{GuidanceCommand, RouteFollower};
use crate::dynamics::route::profile::PathSettings;
use crate::error::{Error, Result};
use crate::fields::Clearances;
use crate::schedule::{App, FlightSystems, Guide, Look, Main, Needs};
use crate::systems::looks::way;

/// Number of places behind the first one that leads on, to which the way back leads: the line from there is free beyond doubt.
const BEHIND: usize = 2;

/// Keeps the body on its plan.
#[derive(Component, Clone, Debug)]
pub struct PathFollower {
    settings: PathSettings,
    /// The follower of the route; `None` while the guide does not have control.
    follower: Option<RouteFollower>,
    /// The way back over its own trail, and its follower, while no free line leads to the route.
    back: Option<(Route, RouteFollower)>,
    /// Velocity before the last step, world mm/s; `None` if the body was not moved in between.
    velocity_before: Option<DVec3>,
    /// The last acceleration commanded, world mm/s².
    last: DVec3,
    /// The number of jumps of the plan handled so far.
    jumps: u32,
}

impl Guide for PathSettings {
    const NAME: &'static str = "path";
    const SUMMARY: &'static str = "follows the centerline";
    const KEY: Option<char> = Some('3');
    const LOOK: Option<Look> = Some(way::LOOK);
    const NEEDS: Needs = Needs { centerline: true, fluid_as_gas: true, ..Needs::NOTHING };

    fn needs(&self) -> Needs {
        Needs { planner: self.planner, ..Self::NEEDS }
    }

    fn check(&self) -> Result<()> {
        Self::check(self)
    }

    fn cruise_mm_s(&self, _: &dynamics::Body) -> f64 {
        self.cruise_mm_s
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        let line = app.scan_get::<Centerline>().map(|c| Arc::clone(&c.0));
        let route = line.ok_or_else(|| Error::fault("path", "the centerline is missing", "report it"))?;
        let (settings, last) = (*self, DVec3::ZERO);
        app.equip((
            Planned::new(route, self.look_ahead_mm),
            PathFollower { settings, follower: None, back: None, velocity_before: None, last, jumps: 0 },
        ));
        app.add_systems(FlightSystems::Guide, guide_by_plan);
        app.add_systems(FlightSystems::Answer, report_narrow_place);
        Ok(())
    }
}

/// The camera that a plan steers.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct FollowingBody {
    pose: &'static Pose,
    velocity: &'static Velocity,
    body: &'static Body,
    flight: &'static Flight,
    planned: &'static mut Planned,
    follower: &'static mut PathFollower,
    guide: &'static mut GuideThrust,
    gaze: Option<&'static Gaze>,
    review: Option<&'static Review>,
    trail: Option<&'static Trail>,
    hand: Option<&'static Hand>,
}

/// Commands the acceleration that the plan requires.
///
/// After an interruption, the plan is joined again at its nearest reachable position. If no straight line to the plan is free, the body
/// flies back over its own trail until one is: behind a wall it would hang.
pub fn guide_by_plan(clock: Res<Clock>, walls: Single<&Walls, With<Main>>, camera: Single<FollowingBody, With<Main>>) {
    let FollowingBodyItem {
        pose,
        velocity,
        body,
        flight,
        mut planned,
        follower: mut held,
        mut guide,
        gaze,
        review,
        trail,
        hand,
    } = camera.into_inner();
    let Planned { route, s_mm, jumps, .. } = &mut *planned;
    if held.jumps != *jumps {
        (held.follower, held.velocity_before, held.last, held.jumps) = (None, None, DVec3::ZERO, *jumps);
        held.back = None;
    }
    let PathFollower { settings, follower, back, velocity_before, last, .. } = &mut *held;
    let acceleration = velocity_before.map_or(DVec3::ZERO, |before| (velocity.0 - before) / clock.dt());
    *velocity_before = Some(velocity.0);
    let limit = settings.cruise_mm_s * body.0.drag_per_s.max(1.0);
    *guide = GuideThrust { limit, exact: true, ..GuideThrust::default() };
    // A tour passes the same places several times: it continues on the same pass.
    let nearest = |at: DVec3, s_mm: f64| match review {
        Some(_) => route.nearest_pass(&walls.0, at, s_mm),
        None => route.nearest_reachable(&walls.0, at),
    };
    let away = hand.is_some_and(|h| h.is_in_control(clock.tick));
    if away || flight.state != State::Flying {
        (*follower, *back) = (None, None);
        *s_mm = nearest(pose.position, *s_mm).unwrap_or(*s_mm);
        // Fade out the last command instead of dropping it.
        guide.thrust = *last * hand.filter(|_| away).map_or(0.0, Hand::share);
        return;
    }
    let rate = hand.map_or(1.0, |h| h.speed) * gaze.map_or(1.0, Gaze::pace) * review.map_or(1.0, |r| r.pace);
    let state = (pose.position, velocity.0);
    let (drag, dt) = (body.0.drag_per_s, clock.dt());
    let order = follower.as_mut().and_then(|p| p.command(route, state, drag, rate, dt));
    let order = order.or_else(|| {
        *follower = None;
        let joined = [state.0, state.1, acceleration];
        let Some(s) = nearest(pose.position, *s_mm) else {
            // At the pace of the flight, not of a stop: it must get out first.
            let rate = hand.map_or(1.0, |h| h.speed);
            let order = fly_back(back, state, [drag, rate, dt]).or_else(|| {
                let trail: Vec<DVec3> = trail?.views().iter().map(|v| v.0).collect();
                let way = way_back(&trail, &walls.0, pose.position);
                let way = way_out(&way, &walls.0, |at| nearest(at, *s_mm).is_some())?;
                let anew = RouteFollower::join(&way, 0.0, joined, rate, settings);
                *back = Some((way, anew));
                fly_back(back, state, [drag, rate, dt])
            });
            if let (Some(order), Some((way, _))) = (order, &*back) {
                *last = order.acceleration;
                guide.thrust = order.acceleration;
                guide.look_direction = way.look(order.s, settings.look_ahead_mm);
            }
            return None;
        };
        *back = None;
        let mut anew = RouteFollower::join(route, s, joined, rate, settings);
        let order = anew.command(route, state, drag, rate, dt);
        *follower = Some(anew);
        order
    });
    if let Some(order) = order {
        *s_mm = order.s;
        *last = order.acceleration;
        guide.thrust = order.acceleration;
        guide.look_direction = route.look(order.s, settings.look_ahead_mm);
    }
}

/// Returns the command on the way back, if there is one and the body is on it.
fn fly_back(
    back: &mut Option<(Route, RouteFollower)>,
    state: (DVec3, DVec3),
    [drag, rate, dt]: [f64; 3],
) -> Option<GuidanceCommand> {
    let (way, follower) = back.as_mut()?;
    follower.command(way, state, drag, rate, dt)
}

/// Returns the part of a way (world mm) up to a little behind its first place that `leads_on`; `None` if none does.
fn way_out(way: &[DVec3], walls: &impl Clearances, leads_on: impl Fn(DVec3) -> bool) -> Option<Route> {
    let first = way.iter().position(|&p| leads_on(p))?;
    let way = &way[..(first + 1 + BEHIND).min(way.len())];
    let clearance: Vec<f64> = way.iter().map(|&p| walls.clearance(p).mm).collect();
    Route::along(way, &clearance, DVec3::NEG_Y)
}

/// Replaces the reason of a call for help if the plan leads to a place that the body does not fit through.
pub fn report_narrow_place(camera: Single<(&Body, &Planned, &mut HelpCall), With<Main>>) {
    let (body, planned, mut call) = camera.into_inner();
    if let Some(help) = &mut call.0
        && let Some(narrow) = planned.route.narrow_place(planned.s_mm, body.0.radius_mm)
    {
        help.reason = narrow;
    }
}

#[cfg(test)]
#[path = "path_tests.rs"]
mod tests;
