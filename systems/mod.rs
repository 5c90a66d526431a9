//! Every scheduled system, one file each: the function that is scheduled and the `plugin` that puts it into its set.
//!
//! | file | set | what it does |
//! |---|---|---|
//! | `operator` | `Input` | the operator's hand: thrust, look, pause |
//! | `sense` | `Sense` | casts the tentacles |
//! | `tentacles` | `Guide` | steers by tentacles and mines |
//! | `path` | `Guide` | holds the body to a planned way |
//! | `potential` | `Guide` | follows the potential of wall and target |
//! | `manual` | `Guide` | leaves the steering to the operator |
//! | `play` | `Integrate` | flies a log again, in place of `motion` |
//! | `mines` | `Force` | mines are laid and push |
//! | `motion` | `Integrate` | sums the forces, moves and turns the rigid body |
//! | `watch` | `Watch` | arrival and trouble |
//! | `log` | `Log` | writes down the step |
//! | `raycast` | `RayCast` | traces the image |
//!
//! To add a navigation method: write a file like `manual` with a system in the set `Guide` that fills
//! [`GuideThrust`](crate::components::guide::GuideThrust), and add one line to the list in `src/app/scene.rs`.

pub mod log;
pub mod manual;
pub mod mines;
pub mod motion;
pub mod operator;
pub mod path;
pub mod play;
pub mod potential;
pub mod raycast;
pub mod sense;
pub mod tentacles;
pub mod watch;
