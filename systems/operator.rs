//! Operator input: push, view direction, roll and pause.

use bevy_ecs::prelude::*;
use glam::{DVec2, DVec3};

use crate::components::camera::{Body, Heading, Pose};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, State, TakenOver};
use crate::components::input::{Hand, HandCommand, Inbox};
use crate::dynamics::hand;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Time after the last push before the guide thrusts again, s.
const HAND_OFF_S: f64 = 0.4;
/// Time for which the view stays where the operator turned it, s.
const LOOK_S: f64 = 1.5;

/// Adds operator input to the camera.
pub fn plugin(app: &mut App) -> Result<()> {
    app.world.init_resource::<Inbox>();
    app.camera().insert_if_new(Hand::default());
    app.add_systems(FlightSystems::Input, take_commands);
    app.observe(resume_flight);
    Ok(())
}

/// Applies the commands due in this step, then updates the push and turn that are held down.
pub fn take_commands(
    clock: Res<Clock>,
    mut inbox: ResMut<Inbox>,
    camera: Single<(Entity, &mut Hand, &mut Pose, &mut Heading, &Flight, &Body), With<Main>>,
    mut commands: Commands,
) {
    let (entity, mut operator, mut pose, mut heading, flight, body) = camera.into_inner();
    let after = |seconds: f64| clock.tick + (seconds * f64::from(clock.hz)).ceil() as u64;
    let unit = |v: [f64; 3]| DVec3::from_array(v.map(|x| if x.is_finite() { x.clamp(-1.0, 1.0) } else { 0.0 }));
    let mut touched = false;
    for command in inbox.0.drain(..) {
        match command {
            HandCommand::Push(p) => operator.push = unit(p),
            HandCommand::Turn(t) => operator.turn = unit(t),
            HandCommand::Look([right, up]) if right.is_finite() && up.is_finite() => {
                let (axis_up, axis_right) = (pose.attitude.up, pose.attitude.right());
                // Upwards first: about the axis that is already turned to the side, it would roll the view.
                pose.attitude.rotate(axis_right, up.to_radians());
                pose.attitude.rotate(axis_up, -right.to_radians());
                operator.looking_until = after(LOOK_S);
                operator.turned_until = operator.looking_until;
            }
            HandCommand::Roll(clockwise) if clockwise.is_finite() => {
                let axis = pose.attitude.forward;
                pose.attitude.rotate(axis, clockwise.to_radians());
                operator.turned_until = after(LOOK_S);
            }
            HandCommand::Pause(p) => {
                operator.paused = p;
                touched = true;
            }
            HandCommand::Speed(s) if s.is_finite() => operator.speed = s.clamp(0.1, 5.0),
            HandCommand::Resume => touched = true,
            // Not a finite number: ignore the turn or the speed.
            HandCommand::Look(_) | HandCommand::Roll(_) | HandCommand::Speed(_) => {}
        }
    }
    operator.turning = hand::turning(&pose.attitude, operator.turn);
    if operator.turn != DVec3::ZERO {
        operator.turned_until = after(LOOK_S);
    }
    // Rolling alone does not change the view direction, so the view keeps following the path.
    if operator.turn.truncate() != DVec2::ZERO {
        operator.looking_until = after(LOOK_S);
    }
    let push = hand::push_direction(&pose.attitude, operator.push);
    operator.acceleration =
        hand::push_acceleration(operator.acceleration, push, body.0.drag_per_s, operator.speed, clock.dt());
    if push != DVec3::ZERO {
        operator.on_until = after(HAND_OFF_S);
        touched = true;
        // The guide resumes from where the operator releases control, in the direction of the push.
        heading.0 = push.normalize_or_zero();
    }
    let away = operator.is_in_control(clock.tick) || flight.state != State::Flying;
    operator.guided = if away { hand::let_go } else { hand::take_up }(operator.guided, clock.dt());
    if touched {
        commands.trigger(TakenOver { entity });
    }
}

/// Resumes a flight that had called the operator.
pub fn resume_flight(taken: On<TakenOver>, mut cameras: Query<&mut Flight>) {
    if let Ok(mut flight) = cameras.get_mut(taken.entity)
        && flight.state == State::Operator
    {
        flight.state = State::Flying;
        flight.reason.clear();
    }
}

#[cfg(test)]
#[path = "operator_tests.rs"]
mod tests;
