//! The camera entity: where it is, what moves it, what it sees.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::dynamics;

/// Where the camera is and where it looks.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// World, mm.
    pub position: DVec3,
    /// View frame.
    pub attitude: dynamics::Attitude,
}

/// The body that must not touch the wall. A camera without one does not move.
#[derive(Component, Clone, Copy, Debug)]
#[require(Velocity, AngularMomentum, Acceleration, Contact, Heading)]
pub struct Body(pub dynamics::Body);

/// Velocity, world mm/s.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Velocity(pub DVec3);

/// Angular momentum about the body's centre, world g·mm²/s.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct AngularMomentum(pub DVec3);

/// The sum of all forces divided by the mass, world mm/s².
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Acceleration(pub DVec3);

/// Unit direction of the flight, world: where the body has been going, smoothed; zero before it first moves.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Heading(pub DVec3);

/// What the last step told of the wall.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Contact {
    /// Distance from the camera's centre to the nearest wall, mm; a lower bound above the finder's limit.
    pub clearance_mm: f64,
    /// Steps in a row in which the body was in the wall, or nearer to it than its radius, and no way out was found.
    pub stuck_steps: u32,
}
