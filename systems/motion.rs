//! The equations of motion: adds up the forces, moves the rigid body as far as the wall allows, and turns it together
//! with its view.

use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryData;
use glam::DVec3;

use crate::components::camera::{Acceleration, AngularMomentum, Body, Contact, Heading, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, SetOff, State};
use crate::components::guide::{GuideThrust, MinePush, PotentialField};
use crate::components::input::Hand;
use crate::components::output::GuideName;
use crate::components::scan::Walls;
use crate::dynamics::heading::follow_velocity;
use crate::dynamics::rigid::orientation;
use crate::dynamics::{Potential, PotentialForce, RigidBodyState, Turning, step};
use crate::error::Result;
use crate::fields::Distance;
use crate::schedule::{App, FlightSystems, Main, Phase, note};

/// Time by which the view lags behind the path, s, and its maximum rate, rad/s.
const VIEW_S: f64 = 0.45;
const VIEW_RATE: f64 = 1.8;
/// How promptly the view follows operator input, and comes to rest without it, 1/s.
const HAND_TURN_PER_S: f64 = 15.0;
/// A view that turns more slowly than this, without a target or input, counts as at rest, rad/s.
const STILL_RAD_S: f64 = 1e-6;

/// Adds motion to the camera.
pub fn plugin(app: &mut App) -> Result<()> {
    app.add_systems(FlightSystems::Sum, sum_forces);
    app.add_systems(FlightSystems::Integrate, move_body);
    app.observe(take_heading);
    Ok(())
}

/// Takes the new heading of a flight that sets off again.
pub fn take_heading(off: On<SetOff>, mut cameras: Query<&mut Heading>) {
    if let (Some(to), Ok(mut heading)) = (off.heading, cameras.get_mut(off.entity)) {
        heading.0 = to;
    }
}

/// The accelerations that act on the body, world mm/s². Drag, a potential and wall contact are not included.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Acting {
    /// Operator input.
    pub hand: DVec3,
    /// The guide's push away from the wall.
    pub wall: DVec3,
    /// The guide's thrust and the mines' push together, limited to cruise speed.
    pub drive: DVec3,
    /// The mines' share of the drive.
    pub mines: DVec3,
}

impl Acting {
    /// Returns the total.
    pub fn sum(&self) -> DVec3 {
        self.hand + self.wall + self.drive
    }
}

/// Returns the accelerations that act on a body now.
///
/// Operator input replaces the guide's thrust and the mines, which fade out and in gradually.
pub fn acting(flight: &Flight, hand: Option<&Hand>, guide: Option<&GuideThrust>, mines: Option<&MinePush>) -> Acting {
    let mut acting = Acting { hand: hand.map_or(DVec3::ZERO, |h| h.acceleration), ..Acting::default() };
    let stopped = hand.is_some_and(Hand::is_stopped);
    let Some(guide) = guide.filter(|_| !stopped) else { return acting };
    acting.wall = guide.wall;
    if guide.exact {
        acting.drive = guide.thrust;
    } else if flight.state == State::Flying {
        let pace = hand.map_or(1.0, Hand::pace);
        // Mines steer. They must not make the flight faster than intended.
        let mines = mines.map_or(DVec3::ZERO, |m| m.0);
        let drive = guide.thrust + mines;
        acting.drive = drive.clamp_length_max(guide.limit) * pace;
        acting.mines = mines * (acting.drive.length() / drive.length().max(1e-9));
    }
    acting
}

/// Who writes what a guide says after the guide, in a flight with parts of other crates.
#[derive(Resource, Clone, Copy, Debug)]
pub struct ThrustWriters {
    /// The look, if it is of another crate.
    pub look: Option<&'static str>,
}

impl ThrustWriters {
    /// Returns the name for messages of who has written something invalid since the guide.
    fn after_the_guide(self, wrong: &str) -> String {
        match self.look {
            Some(look) if wrong == GuideThrust::DIRECTION => format!("look {look}"),
            _ => "a plug-in that writes GuideThrust".to_owned(),
        }
    }
}

/// Checks what the guide says before anything else writes it, so that only its own mistakes are reported as the guide's.
pub fn check_guide_plugin(app: &mut App, writers: ThrustWriters) {
    app.world.insert_resource(writers);
    let check = check_guide.after(FlightSystems::Guide).before(FlightSystems::Look);
    app.add_systems_to(Phase::Step, check);
}

/// Removes what a guide has written wrongly.
pub fn check_guide(camera: Single<&mut GuideThrust, With<Main>>, name: Option<Res<GuideName>>) {
    if let Some(wrong) = camera.into_inner().sanitize() {
        let name = name.map_or("", |n| n.0);
        note(format!("guide {name}"), format!("gave an invalid {wrong}: it counts as zero"));
    }
}

/// Adds up the accelerations that act on the body.
pub fn sum_forces(
    camera: Single<
        (&mut Acceleration, &Flight, Option<&Hand>, Option<&mut GuideThrust>, Option<&MinePush>),
        With<Main>,
    >,
    name: Option<Res<GuideName>>,
    writers: Option<Res<ThrustWriters>>,
) {
    let (mut sum, flight, hand, mut guide, mines) = camera.into_inner();
    if let Some(wrong) = guide.as_deref_mut().and_then(GuideThrust::sanitize) {
        let who = match (writers, name) {
            (Some(writers), _) => writers.after_the_guide(wrong),
            (None, name) => format!("guide {}", name.map_or("", |n| n.0)),
        };
        note(who, format!("gave an invalid {wrong}: it counts as zero"));
    }
    let total = acting(flight, hand, guide.as_deref(), mines).sum();
    sum.0 = if total.is_finite() {
        total
    } else {
        note("a force", "is not finite: operator input only");
        hand.map(|h| h.acceleration).filter(|a| a.is_finite()).unwrap_or(DVec3::ZERO)
    };
}

/// The body that moves, and what moves it.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct MovingBody {
    pose: &'static mut Pose,
    velocity: &'static mut Velocity,
    spin: &'static mut AngularMomentum,
    heading: &'static mut Heading,
    contact: &'static mut Contact,
    flight: &'static mut Flight,
    acceleration: &'static Acceleration,
    body: &'static Body,
    guide: Option<&'static GuideThrust>,
    field: Option<&'static PotentialField>,
    hand: Option<&'static Hand>,
}

/// Advances the rigid body by one step, limited to free space.
pub fn move_body(clock: Res<Clock>, walls: Single<&Walls, With<Main>>, camera: Single<MovingBody, With<Main>>) {
    let MovingBodyItem {
        mut pose,
        mut velocity,
        mut spin,
        mut heading,
        mut contact,
        mut flight,
        acceleration,
        body,
        guide,
        field,
        hand,
    } = camera.into_inner();
    let (body, dt) = (&body.0, clock.dt());
    let before = RigidBodyState {
        position: pose.position,
        momentum: velocity.0 * body.mass_g,
        orientation: orientation(pose.attitude),
        angular: spin.0,
    };
    let guided = flight.state == State::Flying && !hand.is_some_and(|h| h.is_in_control(clock.tick));
    let looking = hand.is_some_and(|h| clock.tick < h.looking_until);
    let turning = match guide.filter(|g| guided && !looking && g.look_direction != DVec3::ZERO) {
        // The operator may roll meanwhile, and the roll stays: the turn towards the path has no component about the view direction.
        Some(guide) => {
            let towards = Turning::towards(guide.look_direction, VIEW_S, VIEW_RATE);
            Turning { push: hand.map_or(DVec3::ZERO, |h| h.turning) * towards.drag, ..towards }
        }
        None => Turning::by_hand(hand.map_or(DVec3::ZERO, |h| h.turning), HAND_TURN_PER_S),
    };
    let push = acceleration.0 * body.mass_g;
    let stopped = hand.is_some_and(Hand::is_stopped);
    let method = body.integrator.stepper();
    let moved = match field.filter(|_| !stopped) {
        Some(f) => {
            let pace = if flight.state == State::Flying { hand.map_or(1.0, Hand::pace) } else { 0.0 };
            let potential = Potential { target_force: f.potential.target_force * pace, ..f.potential };
            let target = f.target.as_deref().filter(|_| pace > 0.0).map(|t| t as &dyn Distance);
            let forces = PotentialForce { potential, wall: Some(&*f.wall), target, push };
            step(method, body, &before, &forces, &turning, &walls.0, dt)
        }
        None => step(method, body, &before, &push, &turning, &walls.0, dt),
    };
    let after = moved.motion;
    velocity.0 = after.momentum / body.mass_g;
    // A body at rest stays there to the last bit, so that a still picture is not rendered again.
    let rate = body.inertia().rate(after.angular, after.orientation * DVec3::Z);
    let still = turning.target == DVec3::ZERO && turning.push == DVec3::ZERO && rate.length() < STILL_RAD_S;
    spin.0 = if still { DVec3::ZERO } else { after.angular };
    let attitude = if still { pose.attitude } else { after.attitude() };
    flight.length_mm += after.position.distance(before.position);
    *pose = Pose { position: after.position, attitude };
    *contact = Contact {
        clearance_mm: walls.0.at(after.position).mm,
        stuck_steps: if moved.advance.stuck { contact.stuck_steps.saturating_add(1) } else { 0 },
    };
    heading.0 = follow_velocity(heading.0, velocity.0, dt);
}

#[cfg(test)]
#[path = "motion_tests.rs"]
mod tests;
