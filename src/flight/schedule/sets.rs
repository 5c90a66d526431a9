//! The order of everything that is scheduled.

use bevy_ecs::prelude::*;

/// The order of a flight's systems, and the only one.
///
/// `Input` to `Clock` run in each simulation step, `Aim` to `Present` in each frame. Two systems in one set must not
/// touch the same data in a way that depends on their order; otherwise the schedule does not build. The exception is
/// `PostProcess`, where systems run in the order in which they were added.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FlightSystems {
    /// Applies operator input: push, look, pause.
    Input,
    /// Senses the surroundings with tentacles.
    Sense,
    /// The guide chooses the direction. A slot: exactly one navigation method is plugged in.
    Guide,
    /// Chooses where the camera looks.
    Look,
    /// Computes all forces besides the guide's. Mines are laid before they push.
    Force,
    /// Adds up all forces.
    Sum,
    /// Solves the equation of motion with the step that cannot perforate, and turns the view.
    Integrate,
    /// Evaluates the new position: arrivals and stalls. Systems that need help ask for it here.
    Watch,
    /// A guide answers a call for help before the operator receives it.
    Answer,
    /// Calls the operator and marks segments flown to their end.
    Call,
    /// Records where the camera has been.
    Trail,
    /// Logs the step.
    Log,
    /// Advances simulated time.
    Clock,
    /// Places the views of plug-ins before they are traced.
    Aim,
    /// Traces the images of all views. A slot: one renderer.
    RayCast,
    /// Draws slices.
    Slices,
    /// Changes finished images. Takes any number of systems, in the order in which they were added.
    PostProcess,
    /// Shows or records the finished images.
    Present,
}

/// The two phases in which the systems of a flight run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// A simulation step of fixed length.
    Step,
    /// A frame, run whenever an image is needed.
    Frame,
}

impl FlightSystems {
    /// The sets of a simulation step, in order.
    pub const STEP: [Self; 13] = [
        Self::Input,
        Self::Sense,
        Self::Guide,
        Self::Look,
        Self::Force,
        Self::Sum,
        Self::Integrate,
        Self::Watch,
        Self::Answer,
        Self::Call,
        Self::Trail,
        Self::Log,
        Self::Clock,
    ];
    /// The sets of a frame, in order.
    pub const FRAME: [Self; 5] = [Self::Aim, Self::RayCast, Self::Slices, Self::PostProcess, Self::Present];

    /// Returns the phase that the set belongs to.
    pub fn phase(self) -> Phase {
        if Self::FRAME.contains(&self) { Phase::Frame } else { Phase::Step }
    }
}
