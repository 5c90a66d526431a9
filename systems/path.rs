//! The guide that follows a plan: a force holds the body to where it should be on its way.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{Body, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, State};
use crate::components::guide::{GuideThrust, Planned};
use crate::components::input::Hand;
use crate::components::output::GuideName;
use crate::components::scan::Walls;
use crate::components::{App, FlightSystems, Slot};
use crate::dynamics::Route;
use crate::dynamics::route::pilot::Pilot;
use crate::error::Result;
use crate::fields::Clearances;

/// Places of the way that are looked at for one that the body can get to.
const CANDIDATES: usize = 6;

/// Plugs the plan into the guide's slot.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Guide, "path")?;
    app.world.insert_resource(GuideName("path"));
    app.add_systems(FlightSystems::Guide, guide_by_plan);
    Ok(())
}

/// Asks of the body what the plan wants. Whenever somebody else has had it, the plan is taken up from its nearest place.
pub fn guide_by_plan(
    clock: Res<Clock>,
    walls: Single<&Walls>,
    camera: Single<(&Pose, &Velocity, &Body, &Flight, &mut Planned, &mut GuideThrust, Option<&Hand>)>,
) {
    let (pose, velocity, body, flight, mut planned, mut guide, hand) = camera.into_inner();
    let Planned { settings, route, pilot, s_mm, velocity_before, last } = &mut *planned;
    let acceleration = velocity_before.map_or(DVec3::ZERO, |before| (velocity.0 - before) / clock.dt());
    *velocity_before = Some(velocity.0);
    let limit = settings.cruise_mm_s * body.0.drag_per_s.max(1.0);
    *guide = GuideThrust { limit, exact: true, ..GuideThrust::default() };
    let away = hand.is_some_and(|h| h.paused || clock.tick < h.on_until);
    if away || flight.state != State::Flying {
        *pilot = None;
        *s_mm = nearest(route, &walls.0, pose.position);
        // What was asked last is let go of, not dropped.
        guide.thrust = *last * hand.filter(|_| away).map_or(0.0, Hand::share);
        return;
    }
    let rate = hand.map_or(1.0, |h| h.speed);
    let state = (pose.position, velocity.0);
    let order = pilot.as_mut().and_then(|p| p.order(route, state, body.0.drag_per_s, rate, clock.dt()));
    let order = order.or_else(|| {
        let s = nearest(route, &walls.0, pose.position);
        let mut anew = Pilot::join(route, s, [state.0, state.1, acceleration], rate, settings);
        let order = anew.order(route, state, body.0.drag_per_s, rate, clock.dt());
        *pilot = Some(anew);
        order
    });
    if let Some(order) = order {
        *s_mm = order.s;
        *last = order.acceleration;
        guide.thrust = order.acceleration;
        guide.way = route.look(order.s, settings.look_ahead_mm);
    }
}

/// The nearest place of the way, mm along it, to which the straight line is free; the nearest of all where none is.
pub fn nearest(route: &Route, walls: &impl Clearances, at: DVec3) -> f64 {
    let places = route.nearest(at);
    let free = |&&s: &&f64| !walls.enters(at, route.place(s));
    places.iter().take(CANDIDATES).find(free).or(places.first()).copied().unwrap_or(0.0)
}
