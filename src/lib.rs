//! colvis: flying through the inside of the body, on a processor alone.
//!
//! Who may use whom, from the bottom up: each module those of the lines above its own in this table. A test reads it from
//! here.
//!
//! ```text layers
//! error, math, memory
//! fence
//! output, progress
//! volume
//! fields, phantom
//! dynamics
//! render
//! components, schedule, surface
//! systems
//! app, plane
//! host, report
//! cli
//! ```
//!
//! Everything up to `render` is plain functions and data that know no entity-component-system. `components` holds what
//! the entities carry, `schedule` the order of the systems and what a guide says of itself, `systems` (the folder beside
//! `src`) one file for each scheduled system, `app` scans, scenes and flights, `host` what drives a flight: a window, or
//! nobody. `ARCHITECTURE.md` tells the way of a scan and of a pose through them, and where to add what.
//!
//! A flight in ten lines is the example of [`app::Scan`]; the program itself is [`cli::Program`].
//!
//! How far the wall is from a place, along a ray and to any side:
//!
//! ```
//! use std::sync::Arc;
//! use colvis::fields::ClearanceFinder;
//! use colvis::render::{PreparedVolume, TransferFunction, first_crossing};
//! use colvis::volume::{Grid, Volume};
//! use glam::{DMat3, DVec3};
//!
//! // Gas, and from x = 10 mm on tissue.
//! let grid = Grid::new([21, 21, 21], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY)?;
//! let data = (0..grid.len()).map(|n| if n % 21 < 10 { -1000 } else { 50 }).collect();
//! let volume = Arc::new(Volume::new(grid, data));
//! let space = PreparedVolume::new(Arc::clone(&volume), TransferFunction::default());
//! let eye = DVec3::new(5.0, 10.0, 10.0);
//! let ahead = first_crossing(&space, eye, DVec3::X, 100.0).expect("a wall");
//! assert!((ahead - 4.333).abs() < 0.001, "−650 HU lies a third of the way from −1000 to 50");
//! let clearance = ClearanceFinder::new(volume, -650.0, 12.0).at(eye);
//! assert!(clearance.mm <= ahead && clearance.mm > ahead - 0.1 && clearance.toward.x > 0.99);
//! # Ok::<(), String>(())
//! ```
//!
//! Frames and units: *world* is the patient's frame, millimetres, LPS (x to the patient's left, y to posterior,
//! z to superior). *Voxel* coordinates are fractional indices; an integer index is a voxel's centre. Values are
//! Hounsfield units.
//!
//! # Glossary
//!
//! The colon and its scan:
//!
//! - **Lumen**: the inside of the colon, gas and tagged fluid: [`fields::lumen`].
//! - **Segment**: a connected piece of the lumen's gas. Fluid or a collapsed stretch parts one from the next.
//! - **Tagged fluid**: fluid that a contrast agent makes bright, so that it can be told from tissue.
//! - **Haustra**: the pouches of the colon between its folds. **Taeniae**: the three bands of muscle along it.
//! - **Residue**: what is left in a cleaned colon. A **bridge** is a thin strand of it across the lumen.
//! - **Centerline**: the line through the middle of the lumen from one end to the other: [`fields::centerline`].
//! - **Wall**: where the interpolated value crosses the middle of the opacity ramp, −650 HU unless told otherwise.
//! - **Wall distance**, D_s: how far a place is from the wall, as a field over the lumen: [`fields::distance`].
//! - **Target distance**, D_t: how far it is to the goal along the lumen: [`fields::target`].
//! - **Clearance**: the exact distance from one place to the wall, found among the voxels around it, never told too large:
//!   [`fields::ClearanceFinder`].
//! - **Phantom**: a synthetic colon whose truth is known: [`phantom`].
//!
//! The flight:
//!
//! - **Guide**: who steers, a navigation method: [`schedule::Guide`].
//! - **Tentacles**: sensory rays to all sides that tell a guide how far the wall is: [`dynamics::tentacles`].
//! - **Mines**: points laid behind the camera that push it on, so that it does not turn back: [`dynamics::mines`].
//! - **Potential**: the paper's V(x). The wall repels, the target attracts: [`dynamics::potential`].
//! - **Scene**: what a flight is made of, as a list of plugins and their settings: [`app::Scene`].
//! - **FlightRequest**: which ends were asked for. **Plan**: start and goal that come of it: [`app::FlightRequest`], [`app::Plan`].
//! - **Way**: the line that is flown, and in a guide the direction in which it goes on. A **route** is a way that is planned
//!   ahead, with its speeds: [`dynamics::Route`].
//! - **Trail**: where the camera has been.
//! - **Perforation**: passing through the wall. No step can: [`dynamics::advance()`].
//! - **Clamp**: what cuts a step back to what the clearance allows.
//! - **Trap**: a place in which a flight gets nowhere, such as a blind end or a local minimum: [`dynamics::trap`].
//! - **Rescue**: what is done about it, before the operator is called: [`dynamics::rescue`].
//! - **Operator**: the person at the window, or a recorded input in that person's place.
//! - **Coverage**: the share of the wall that was seen: [`render::Coverage`].
//!
//! The picture:
//!
//! - **Transfer function**: from a value to an opacity: 0 up to one value, 1 from another on: [`render::TransferFunction`].
//! - **Prepared volume**: a volume with its transfer function and what lets rays leap: [`render::PreparedVolume`].
//! - **Leap**: a step of a ray over what is known to be empty. **Brick**: a cube of cells that is known to be so as one.
//! - **Homogeneous-region flag**: a bit for each voxel that says that nothing changes around it.
//! - **Early ray termination**: a ray ends when less light comes from beyond than the camera's sensitivity.
//! - **Layer**, or surface hit: one of the surfaces that a ray meets one behind the other.
//! - **Preset**: a renderer by its name: [`render::Preset`]. **Quality**: how detailed its pictures are: [`render::Quality`].
//! - **Packet**: sixteen neighbouring rays that are traced as one.
//! - **Adaptive image-plane sampling**: rays only through pixels of which those around do not tell enough.
//! - **Reuse**: taking over from the last frame what is proven to hold in this one. **Key frame**: one that is made without:
//!   [`render::reuse`].
//! - **Reference**: brute force, which leaves nothing out; what pictures are measured against.
//! - **Work-precision** diagram: error against run time, a line for each method. The reports draw them: [`report`].
//! - **Presenter**: where finished pictures go, a window or a recording: [`systems::present::Presenter`].
//! - **View**: an entity with an image of the scan: [`components::output::Picture`]. The flight's camera is one.
//! - **Plug-in**: systems, entities and settings of another crate, for every flight of a program: [`schedule::Plugin`].
//! - **Post-process**: a system that changes finished images, in the set [`schedule::FlightSystems::PostProcess`].
//! - **Shader**: the colour of a point of the wall: [`render::Shader`].
//! - **Overlay**: something that a window draws over its picture: [`app::Overlay`].
//! - **Panel**: a part of the window with widgets or pictures of its own: `panel::Panel`.

pub mod app;
pub mod cli;
pub mod components;
pub mod dynamics;
pub mod error;
pub mod fields;
pub mod host;
pub mod math;
pub mod memory;
pub mod output;
pub mod panics;
pub mod phantom;
pub mod plane;
pub mod progress;
pub mod render;
pub mod report;
pub mod schedule;
pub mod surface;
pub mod volume;

#[expect(
    clippy::needless_pass_by_value,
    clippy::type_complexity,
    reason = "a system takes its parameters by value, and its queries are types that list what it touches"
)]
#[path = "../systems/mod.rs"]
pub mod systems;

/// The library that the window's panels are drawn with.
#[cfg(feature = "window")]
pub use egui;
/// Panels: what the window shows, each in a file of its own.
#[cfg(feature = "window")]
pub use host::window::panels as panel;
