//! Every scheduled system, one file each: the functions that are scheduled, and what puts them into their sets with the
//! components that they need.
//!
//! | file | set | what it does |
//! |---|---|---|
//! | `operator` | `Input` | the operator's hand: thrust, look, roll, pause |
//! | `sense` | `Sense` | casts the tentacles |
//! | `tentacles` | `Guide` | steers by tentacles and mines |
//! | `potential` | `Guide`, `Answer` | follows the potential of wall and target; lets the wall yield in a trap |
//! | `path` | `Guide`, `Answer` | holds the body to a planned way; tells of narrow places |
//! | `manual` | `Guide` | leaves the steering to the operator |
//! | `mines` | `Force` | mines are laid and push |
//! | `motion` | `Sum`, `Integrate` | adds up the forces; moves and turns the rigid body |
//! | `play` | `Integrate` | flies a log again, in place of `motion` |
//! | `watch` | `Watch`, `Call` | arrival and trouble; calls the operator |
//! | `arrival` | `Call` | notes what is flown; a goal beyond the gas |
//! | `trail` | `Trail` | where the flight has been |
//! | `log` | `Log` | writes down the step |
//! | `clock` | `Clock` | counts the steps |
//! | `raycast` | `RayCast` | traces the image |
//! | `slices` | `Slices` | draws slices that have changed |
//! | `present` | `Present` | hands the image to a window or a recording |
//!
//! To add a navigation method: write a file like `manual`, in which a type of yours implements
//! [`Guide`](crate::schedule::Guide), and add it to [`guides`].

pub mod arrival;
pub mod clock;
pub mod log;
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
pub mod watch;

use crate::dynamics::Potential;
use crate::dynamics::route::profile::PathSettings;
use crate::dynamics::tentacles::TentacleSettings;
use crate::schedule::Guides;

/// The guides of this crate, in the order in which they are listed. The first is the default.
pub fn guides() -> Guides {
    Guides::default().with::<TentacleSettings>().with::<Potential>().with::<PathSettings>().with::<manual::Manual>()
}
