//! Camera motion: forces on a small body with drag, and a step that cannot pass through the wall.
//!
//! Equation of motion (paper, section 3.1.1): `P′(t) = −∇V(x) − k_t P(t) + F_user(t)`, with `P = m v`. In *tentacles and
//! mines* (section 3.2), the forces of the sensory rays and the mines replace `−∇V`.

pub(crate) mod advance;
mod attitude;
mod body;
mod forces;
#[doc(hidden)]
pub mod hand;
#[doc(hidden)]
pub mod heading;
#[doc(hidden)]
pub mod integrators;
pub mod mines;
pub mod monitor;
pub mod potential;
pub mod rescue;
#[doc(hidden)]
pub mod rigid;
pub mod route;
mod settings;
#[doc(hidden)]
pub mod step;
pub mod tentacles;
pub mod trap;

/// Simulation steps per second, unless a scene sets another rate.
pub const STEP_HZ: u32 = 120;
/// Length of a simulation step, s.
pub const STEP_S: f64 = 1.0 / STEP_HZ as f64;

pub use advance::{Advance, advance};
pub use attitude::Attitude;
pub use body::Body;
pub use forces::{Forces, PotentialForce};
pub use integrators::Integrator;
pub use potential::Potential;
pub use rigid::{Inertia, RigidBodyState, Turning};
pub use route::Route;
#[doc(hidden)]
pub use step::step;
