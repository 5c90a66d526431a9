//! The one order of everything that is scheduled.

use bevy_ecs::prelude::*;

/// The order of a flight's systems; the only one there is.
///
/// `Input` to `Clock` run in each simulation step, `Aim` to `Present` in each frame. Two systems of one set must not touch
/// the same data in a way that depends on their order: the build of such a schedule fails. Only in `PostProcess` they may.
/// There they run in the order in which they were added.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FlightSystems {
    /// The operator's hand: push, look, pause.
    Input,
    /// Feeling the surroundings: tentacles.
    Sense,
    /// The guide decides on the way. A socket: exactly one navigation method is plugged in.
    Guide,
    /// Every force that acts besides the guide's; mines are laid before they push.
    Force,
    /// All forces are added up.
    Sum,
    /// The equation of motion, the step that cannot perforate, and the turn of the view.
    Integrate,
    /// What follows from the new place: arrival, trouble. Whoever needs help asks for it here.
    Watch,
    /// A guide's own answer to a call for help, before the operator hears it.
    Answer,
    /// The operator is called; what was flown to its end is noted.
    Call,
    /// Where the camera has been.
    Trail,
    /// Writing down the step.
    Log,
    /// Simulated time goes on.
    Clock,
    /// Placing the views of plug-ins before they are traced.
    Aim,
    /// Tracing the images of all views. A socket: one renderer.
    RayCast,
    /// Drawing slices.
    Slices,
    /// Changing finished images. Any number of systems, in the order in which they were added.
    PostProcess,
    /// Showing or recording the finished images.
    Present,
}

/// The two parts that the systems of a flight run in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// A simulation step of fixed length.
    Step,
    /// A frame, whenever an image is wanted.
    Frame,
}

impl FlightSystems {
    /// The sets of a simulation step, in order.
    pub const STEP: [Self; 12] = [
        Self::Input,
        Self::Sense,
        Self::Guide,
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

    /// The phase that it is a part of.
    pub fn phase(self) -> Phase {
        if Self::FRAME.contains(&self) { Phase::Frame } else { Phase::Step }
    }
}
