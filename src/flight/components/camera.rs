//! The camera entity: its pose, the body that moves it, and its contact with the wall.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::dynamics;

/// Position and view frame of the camera.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position, world mm.
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

/// Unit heading, world: the direction in which the body has been moving, smoothed; zero before it first moves.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Heading(pub DVec3);

/// Wall contact in the last step.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Contact {
    /// Distance from the camera's centre to the nearest wall, mm; a lower bound above the finder's limit.
    pub clearance_mm: f64,
    /// Number of consecutive steps in which the body was in the wall, or closer to it than its radius, and found no way out.
    pub stuck_steps: u32,
}
