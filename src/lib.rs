//! colvis: real-time virtual colonoscopy on the CPU.
//!
//! The table lists the modules in layers, from the bottom up. A module may use only the modules of the lines above its own.
//! A test reads the table from here.
//!
//! ```text layers
//! error, math, memory
//! panics
//! output, progress
//! volume
//! fields, phantom, space
//! dynamics
//! render
//! components, schedule, surface
//! polyps, coverage
//! systems
//! app, plane, testing
//! host, report
//! cli
//! ```
//!
//! Everything up to `render` is plain functions and data, independent of the entity-component-system. `components` holds the data
//! that entities carry. `schedule` defines the order of the systems and the interface of guides. `systems` (the folder beside
//! `src`) has one file for each scheduled system. `app` contains scans, scenes and flights. `host` drives a flight, in a window
//! or headless. `ARCHITECTURE.md` follows a scan and a pose through these modules, and lists where to add what.
//!
//! [`app::Scan`] has an example of a flight in ten lines. The program itself is [`cli::Program`].
//!
//! To find the distance to the wall, along a ray and in any direction:
//!
//! ```
//! use std::sync::Arc;
//! use colvis::fields::ClearanceFinder;
//! use colvis::space::{PreparedVolume, TransferFunction, first_crossing};
//! use colvis::volume::{Grid, Volume};
//! use glam::{DMat3, DVec3};
//!
//! // Gas, and from x = 10 mm on tissue.
//! let grid = Grid::new([21, 21, 21], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY)?;
//! let data = (0..grid.len()).map(|n| if n % 21 < 10 { -1000 } else { 50 }).collect();
//! let volume = Arc::new(Volume::new(grid, data));
//! let prepared = PreparedVolume::new(Arc::clone(&volume), TransferFunction::default());
//! let eye = DVec3::new(5.0, 10.0, 10.0);
//! let ahead = first_crossing(&prepared, eye, DVec3::X, 100.0).expect("a wall");
//! assert!((ahead - 4.333).abs() < 0.001, "−650 HU lies a third of the way from −1000 to 50");
//! let clearance = ClearanceFinder::new(volume, -650.0, 12.0).at(eye);
//! assert!(clearance.mm <= ahead && clearance.mm > ahead - 0.1 && clearance.toward.x > 0.99);
//! # Ok::<(), colvis::error::Error>(())
//! ```
//!
//! Frames and units: *world* is the patient's frame in millimetres, LPS (x to the patient's left, y to posterior, z to superior).
//! *Voxel* coordinates are fractional indices; an integer index is a voxel's centre. Values are in Hounsfield units.
//!
//! # Glossary
//!
//! The colon and its scan:
//!
//! - **Lumen**: the inside of the colon, gas and tagged fluid: [`fields::lumen`].
//! - **Segment**: a connected piece of the lumen's gas. Fluid or a collapsed stretch separates one segment from the next.
//! - **Tagged fluid**: fluid that a contrast agent brightens, so that it can be distinguished from tissue.
//! - **Haustra**: the pouches of the colon between its folds. **Taeniae**: the three bands of muscle along it.
//! - **Gap**: where the gas of the colon is interrupted, by fluid or because the lumen is collapsed. The way across a collapsed
//!   stretch is a **guess**: [`fields::connection`].
//! - **Residue**: material left in a cleaned colon. A **bridge** is a thin strand of it across the lumen.
//! - **Centerline**: the line through the middle of the lumen from one end to the other: [`fields::centerline`].
//! - **Wall**: the surface where the interpolated value crosses the middle of the opacity ramp, −650 HU by default.
//! - **Wall distance**, D_s: the distance of a point to the wall, as a field over the lumen: [`fields::WallDistance`].
//! - **Target distance**, D_t: the distance of a point to the goal along the lumen: [`fields::TargetDistance`].
//! - **Clearance**: the exact distance from one point to the wall, computed from the voxels around it and never overestimated:
//!   [`fields::ClearanceFinder`].
//! - **Phantom**: a synthetic colon with known ground truth: [`phantom`].
//!
//! - **Polyp candidate**: a place of the wall that looks like a polyp: [`polyps`]. A **detector** finds them. A **cap** is a part of
//!   the wall that bulges into the lumen in every direction.
//!
//! The flight:
//!
//! - **Guide**: a steering (navigation) method: [`schedule::Guide`].
//! - **Tentacles**: sensory rays in all directions that report the distance to the wall to a guide: [`dynamics::tentacles`].
//! - **Mines**: points laid behind the camera that push it forward, so that it does not turn back: [`dynamics::mines`].
//! - **Potential**: the paper's V(x). The wall repels, the target attracts: [`dynamics::potential`].
//! - **Scene**: the list of plugins that make up a flight, with their settings: [`app::Scene`].
//! - **FlightRequest**: the requested ends of a flight. **Plan**: the start and goal derived from them: [`app::FlightRequest`],
//!   [`app::Plan`].
//! - **Path**: the line that the camera flies. A **route** is a path planned in advance, with its speeds: [`dynamics::Route`].
//!   Inside a guide, the **way** is the direction in which the lumen continues.
//! - **Trail**: the past positions of the camera.
//! - **Perforation**: passing through the wall. No step can: [`dynamics::advance()`].
//! - **Clamp**: shortens a step to the length that the clearance allows.
//! - **Trap**: a place where a flight makes no progress, such as a blind end or a local minimum: [`dynamics::trap`].
//! - **Rescue**: the attempt to leave a trap before the operator is called: [`dynamics::rescue`].
//! - **Operator**: the person at the window, or a recorded input in that person's place.
//! - **Coverage**: the share of the wall that was seen: [`coverage`].
//!
//! The picture:
//!
//! - **Transfer function**: maps a value to an opacity, 0 up to one value and 1 from another on: [`space::TransferFunction`].
//! - **Prepared volume**: a volume with its transfer function and the data structures that let rays leap:
//!   [`space::PreparedVolume`].
//! - **Leap**: a step of a ray over space that is known to be empty. **Brick**: a cube of cells that is known to be empty as a
//!   unit.
//! - **Homogeneous-region flag**: one bit per voxel, set if nothing changes around it.
//! - **Early ray termination**: a ray ends when the light from beyond falls below the camera's sensitivity.
//! - **Layer**, or surface hit: one of the surfaces that a ray meets one behind the other.
//! - **Preset**: a named renderer: [`render::Preset`]. **Quality**: the level of detail of its pictures: [`render::Quality`].
//! - **Packet**: sixteen neighbouring rays that are traced together.
//! - **Adaptive image-plane sampling**: traces rays only through those pixels that cannot be derived from the pixels around them.
//! - **Reuse**: takes over the parts of the last frame that provably hold in this one. **Key frame**: a frame rendered without
//!   reuse: [`render::Reuse`].
//! - **Reference**: brute force without any shortcut. Pictures are measured against it.
//! - **Work-precision** diagram: error against run time, a line for each method. The reports draw them: [`report`].
//! - **Presenter**: receives finished pictures, for a window or a recording: [`systems::present::Presenter`].
//! - **View**: an entity with an image of the scan: [`components::output::Picture`]. The flight's camera is one.
//! - **Plug-in**: systems, entities and settings of another crate, for every flight of a program: [`schedule::Plugin`].
//! - **Post-process**: a system that changes finished images, in the set [`schedule::FlightSystems::PostProcess`].
//! - **Shader**: computes the colour of a point of the wall: [`render::Shader`].
//! - **Overlay**: a drawing that a window adds on top of its picture: [`app::Overlay`].
//! - **Panel**: a part of the window with its own widgets or pictures: `panel::Panel`.

pub mod app;
pub mod cli;
pub mod components;
pub mod coverage;
pub mod dynamics;
pub mod error;
pub mod fields;
pub mod host;
pub mod math;
pub(crate) mod memory;
pub mod output;
pub(crate) mod panics;
pub mod phantom;
pub mod plane;
pub mod polyps;
pub mod progress;
pub mod render;
pub mod report;
pub mod schedule;
pub mod space;
pub mod surface;
pub mod testing;
pub mod volume;

#[expect(
    clippy::needless_pass_by_value,
    clippy::type_complexity,
    reason = "a system takes its parameters by value, and its queries are types that list what it touches"
)]
#[path = "../systems/mod.rs"]
pub mod systems;

/// The GUI library of the window's panels.
#[cfg(feature = "window")]
pub use egui;
/// Panels: the parts of the window, each in its own file.
#[cfg(feature = "window")]
pub use host::window::panels as panel;
/// The entity-component-system of flights, of which systems, components and resources are made.
///
/// Its derive macros look for `bevy_ecs` where they are used: `use colvis::bevy_ecs::{self, prelude::*};`.
pub use bevy_ecs;
/// Vectors, matrices and quaternions.
pub use glam;
/// Values of JSON files, as in the statistics of flights.
pub use serde_json;
/// Values of scene files, as in [`render::Options`].
pub use toml;

