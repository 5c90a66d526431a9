//! The choice of where the camera looks.

use super::App;
use crate::error::Result;

/// A way to choose where the camera looks while a guide flies it, built in or external. The guide decides where the body goes.
///
/// [`Look::plug`] adds a system to the set [`Look`](super::FlightSystems::Look), which runs after the guide. It reads what the guide
/// has told about the way (such as [`Planned`](crate::components::guide::Planned)) and writes
/// [`GuideThrust::look_direction`](crate::components::guide::GuideThrust::look_direction), to which the view then turns with bounded
/// speed and acceleration and without roll. `examples/own_look.rs` is a complete example. Create one with [`Look::new`], so
/// that your code also compiles with later fields.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Name in scene files.
    pub name: &'static str,
    /// Short description for the help.
    pub summary: &'static str,
    /// Adds its systems and components.
    ///
    /// # Errors
    /// May return any error; the flight is then not created.
    pub plug: fn(&mut App) -> Result<()>,
}

impl Look {
    /// Creates a look.
    pub const fn new(name: &'static str, summary: &'static str, plug: fn(&mut App) -> Result<()>) -> Self {
        Self { name, summary, plug }
    }
}
