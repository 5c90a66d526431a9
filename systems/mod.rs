//! All scheduled systems, one file each.
//!
//! Each file holds the functions that are scheduled, and the code that adds them to their sets together with the
//! components they need. Its tests are at its end, or in `NAME_tests.rs` beside it.
//!
//! | file | set | what it does |
//! |---|---|---|
//! | `operator` | `Input` | applies operator input: thrust, look, roll, pause |
//! | `sense` | `Sense` | casts the tentacles |
//! | `tentacles` | `Guide` | steers by tentacles and mines |
//! | `potential` | `Guide`, `Answer` | follows the potential of wall and target; weakens the wall in a trap |
//! | `path` | `Guide`, `Answer` | keeps the body on a planned path; reports narrow places |
//! | `manual` | `Guide` | leaves the steering to the operator |
//! | `looks` | `Look` | chooses where the camera looks, one file each |
//! | `mines` | `Force` | lays mines and computes their push |
//! | `motion` | `Sum`, `Integrate` | adds up the forces; moves and turns the rigid body |
//! | `play` | `Integrate` | replays a log, in place of `motion` |
//! | `watch` | `Watch`, `Call` | detects arrivals and stalls; calls the operator |
//! | `arrival` | `Call` | marks flown segments; reports a goal beyond the gas |
//! | `trail` | `Trail` | records where the flight has been |
//! | `log` | `Log` | logs the step |
//! | `coverage` | `Log` | watches what the flight has seen of the wall |
//! | `clock` | `Clock` | counts the steps |
//! | `raycast` | `RayCast` | traces the image |
//! | `coats` | `PostProcess` | paints coated spots of the wall |
//! | `translucency` | `PostProcess` | colours the wall by what lies behind it |
//! | `slices` | `Slices` | draws slices that have changed |
//! | `present` | `Present` | passes the image to a window or a recording |
//!
//! To add a navigation method, write a file like `manual` with a type that implements [`Guide`](crate::schedule::Guide),
//! and add that type to [`guides`].

pub mod arrival;
pub mod clock;
pub mod coats;
pub mod coverage;
pub mod log;
pub mod looks;
pub mod manual;
pub mod mines;
pub mod motion;
pub mod operator;
pub mod path;
pub mod play;
pub mod potential;
pub mod present;
pub mod raycast;
pub mod sense;
pub mod slices;
pub mod tentacles;
pub mod trail;
pub mod translucency;
pub mod watch;

use crate::dynamics::Potential;
use crate::dynamics::route::profile::PathSettings;
use crate::dynamics::tentacles::TentacleSettings;
use crate::schedule::Guides;

/// Returns the guides of this crate, in the order in which they are listed. The first is the default.
pub fn guides() -> Guides {
    Guides::default().with::<TentacleSettings>().with::<Potential>().with::<PathSettings>().with::<manual::Manual>()
}
