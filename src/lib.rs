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
//! dicom, fields, phantom, space
//! dynamics
//! render
//! components, schedule, surface
//! polyps, unfold, coverage, dataset
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
//! # Features
//!
//! | feature | what it adds | without it |
//! |---|---|---|
//! | `window` (default) | the interactive window, the modules `panel` and `egui` | every flight is headless, and recordings contain no overlays |
//! | `wayland` (default) | windows of a Wayland compositor | windows of an X server, which compositors provide as well |
//! | `report` (default) | measurements on this machine, as pages with plots | `colvis report` names the feature that it needs |
//! | `dicom` (default) | DICOM series and their codecs, reports as DICOM objects, archives | NIfTI, MetaImage, NRRD and PNG slices are still read |
//!
//! # Extend it
//!
//! Every extension is one value or type, added to a program of your own with one call to [`cli::Program`]. It then appears on the
//! command line, in scene files, among the keys and in the help. The examples are complete programs of less than 70 lines.
//!
//! | what | with what | added by | example | those of this crate |
//! |---|---|---|---|---|
//! | a guide | [`schedule::Guide`] | [`Program::guide`](cli::Program::guide) | `examples/own_guide.rs` | `systems/` |
//! | where the camera looks | [`schedule::Look`] | [`Program::look`](cli::Program::look) | `examples/own_look.rs` | `systems/looks/` |
//! | a renderer | [`render::Preset`], [`render::Renderer`] | [`Program::preset`](cli::Program::preset) | `examples/own_renderer.rs` | `src/imaging/render/presets/` |
//! | a camera model | [`render::CameraModel`], [`render::Camera`] | [`Program::camera`](cli::Program::camera) | `examples/own_camera.rs` | `src/imaging/render/camera/` |
//! | a shader | [`render::ShaderModel`], [`render::Shader`] | [`Program::shader`](cli::Program::shader) | `examples/own_shader.rs` | `src/imaging/render/shaders/` |
//! | an overlay | [`app::Overlay`] | [`Program::overlay`](cli::Program::overlay) | `examples/own_overlay.rs` | `src/app/overlays/` |
//! | a panel | `panel::Panel`, `panel::PanelEntry` | `Program::panel` | `examples/own_panel.rs` | `src/host/window/panels/` |
//! | an action in the window | `panel::ActionEntry` | `Program::action` | `examples/own_action.rs` | `src/host/window/actions.rs` |
//! | a view | [`components::output::Picture`] | [`app::Views::add`], a plug-in | `examples/own_view.rs` | |
//! | a post-process | a system in [`PostProcess`](schedule::FlightSystems::PostProcess) | a plug-in | `examples/own_post_process.rs` | |
//! | systems, with settings and state | [`schedule::Plugin`] | [`Program::plugin`](cli::Program::plugin) | `examples/own_plugin.rs`, `examples/test_one_system.rs` | `systems/` |
//! | statistics of a flight | [`Plugin::stats`](schedule::Plugin::stats) | [`Program::plugin`](cli::Program::plugin) | `examples/own_stats.rs` | |
//! | a polyp detector | [`polyps::Detector`] | [`Program::detector`](cli::Program::detector) | `examples/own_detector.rs` | `src/imaging/polyps/detectors/` |
//! | a command | `clap::Args`, [`cli::Session`] | [`Program::command`](cli::Program::command) | `examples/own_command.rs` | `src/cli/` |
//!
//! Entries such as [`render::CameraModel`] are filled on a base, `CameraModel { name: "wide", make, ..CameraModel::BASE }`, or
//! created by a function such as [`polyps::Detector::new`]. So they also compile with later fields. Types of other crates in public signatures are re-exported, so that versions always match:
//! [`bevy_ecs`], [`glam`], [`serde_json`], [`toml`], [`cli::clap`]. A plug-in that needs nothing else:
//!
//! ```
//! use colvis::app::{FlightRequest, Scan, Scene};
//! use colvis::bevy_ecs::{self, prelude::*};
//! use colvis::components::camera::Pose;
//! use colvis::glam::DVec3;
//! use colvis::schedule::{App, FlightSystems, Main};
//!
//! /// The flight's highest place.
//! #[derive(Resource, Default)]
//! struct Highest(DVec3);
//!
//! fn watch(pose: Single<&Pose, With<Main>>, mut highest: ResMut<Highest>) {
//!     highest.0 = if pose.position.z > highest.0.z { pose.position } else { highest.0 };
//! }
//!
//! fn plug(app: &mut App) -> colvis::error::Result<()> {
//!     app.world.insert_resource(Highest(DVec3::splat(f64::NEG_INFINITY)));
//!     app.add_systems(FlightSystems::Watch, watch);
//!     Ok(())
//! }
//!
//! let scene = Scene::default().plug(("highest", plug))?;
//! let mut flight = Scan::phantom(1)?.flight(scene, &FlightRequest::default())?;
//! flight.fly(0.1)?;
//! assert!(flight.app().world.resource::<Highest>().0.is_finite());
//! # Ok::<(), colvis::error::Error>(())
//! ```
//!
//! # Build it quickly
//!
//! Cargo takes profiles from the program that is built, never from a dependency. These lines in your `Cargo.toml` optimise what works
//! hard in a flight and let the rest build quickly. For `--release` replace `dev` by `release`.
//!
//! ```toml
//! [profile.dev.package]
//! "*" = { opt-level = 1, debug = false }
//! colvis-app = { opt-level = 3, debug = false }
//! colvis-flight = { opt-level = 3, debug = false }
//! colvis-imaging = { opt-level = 3, debug = false }
//! colvis-kernels = { opt-level = 3, debug = false }
//! colvis-phantom = { opt-level = 3, debug = false }
//! colvis-scan = { opt-level = 3, debug = false }
//! zlib-rs = { opt-level = 3, debug = false }
//! ```
//!
//! # Glossary
//!
//! Help, statistics, messages and the window use one word for one thing: that of the first column, and none of the last. A test compares
//! them with this table.
//!
//! | word | means | not |
//! |---|---|---|
//! | segment | a connected piece of the colon's gas; fluid or a collapsed stretch separates it from the next | piece of gas, stretch of gas, pocket of gas |
//! | part | a named part of the colon, such as the sigmoid | section of the colon, region of the colon |
//! | body | connected gas of any origin, before it is known to be colon | blob, region of gas |
//! | kind | what a body of gas is: colon, small bowel, stomach, lung, … | type of gas, class of gas |
//! | centerline | the line through the middle of the lumen, rectum to cecum | centreline, center line, colon's line |
//! | along | a distance along the centerline of the whole colon, from the rectum | distance from the rectum, way from the rectum |
//! | place | a point of the scan that a message names or the user points at | spot, location |
//! | not seen | wall that has not been seen until now, whether passed or ahead | unobserved, uncovered |
//! | missed | wall that the flight has passed and not seen | overlooked, skipped wall |
//! | patch | a connected area of the wall that was missed | missed area, missed region |
//! | review | a flight past the missed patches | revisit |
//! | cleansed | with the colon's tagged fluid and stool replaced by gas, and the wall beneath restored | tag taken out, without tag, electronically cleaned |
//! | as scanned | not cleansed | with tag, uncleansed |
//! | candidate | a place of the wall that looks like a polyp | suspect, finding of the detector |
//! | lesion | what is measured at a place of the wall | growth |
//! | guide | a steering (navigation) method | navigator, autopilot |
//! | operator | the person at the window, or recorded input in that person's place | pilot |
//! | preset | a named renderer | rendering mode |
//! | view angle | the angle over the shorter side of an image | angle of view |
//!
//! The colon and its scan:
//!
//! - **Lumen**: the inside of the colon, gas and tagged fluid: [`fields::lumen`].
//! - **Tagged fluid**: fluid that a contrast agent brightens, so that it can be distinguished from tissue.
//! - **Haustra**: the pouches of the colon between its folds. **Taeniae**: the three bands of muscle along it.
//! - **Limb**: a length of the colon that lies beside another one.
//! - **Gap**: where the gas of the colon is interrupted, by fluid or because the lumen is collapsed. The connection across a collapsed
//!   stretch is a **guess**: [`fields::connection`].
//! - **Residue**: material left in a cleaned colon. A **bridge** is a thin strand of it across the lumen.
//! - **Centerline**: [`fields::centerline`]. **Along**: [`fields::Along`].
//! - **Wall**: the surface where the interpolated value crosses the middle of the opacity ramp, −650 HU by default.
//! - **Wall distance**, D_s: the distance of a point to the wall, as a field over the lumen: [`fields::WallDistance`].
//! - **Target distance**, D_t: the distance of a point to the goal along the lumen: [`fields::TargetDistance`].
//! - **Clearance**: the exact distance from one point to the wall, computed from the voxels around it and never overestimated:
//!   [`fields::ClearanceFinder`].
//! - **Phantom**: a synthetic colon with known ground truth: [`phantom`].
//! - **Unfolding**: the wall cut open along the colon and laid flat: [`unfold`]. Its **chart** gives each point of the wall its distance along
//!   the colon and its angle about it.
//! - **Candidate**: [`polyps`]. A **detector** finds candidates. A **cap** is a part of the wall that bulges into the lumen in every
//!   direction.
//!
//! The flight:
//!
//! - **Guide**: [`schedule::Guide`]. **Look**, or gaze: where the camera looks, independent of where it flies: [`schedule::Look`].
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
//! - **Coverage**: the share of the wall that was seen: [`coverage`]. A **tour** is the order in which a review visits the missed patches,
//!   its **stops**.
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
//! - **Preset**: [`render::Preset`]. **Quality**: the level of detail of its images: [`render::Quality`].
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
//! - **Action**: something that the operator can do in a window, by a key, the menu or a button: `panel::ActionEntry`.

#[doc(inline)]
pub use colvis_app as app;
pub use colvis_dataset::dataset;
#[cfg(feature = "dicom")]
#[doc(inline)]
pub use colvis_dicom as dicom;
#[doc(inline)]
pub use colvis_flight::{components, coverage, schedule, systems, testing};
#[doc(inline)]
pub use colvis_host::host;
#[doc(inline)]
pub use colvis_imaging::{polyps, render, space, surface, unfold};
#[doc(inline)]
pub use colvis_kernels::{dynamics, fields};
#[doc(inline)]
pub use colvis_phantom as phantom;
#[doc(inline)]
pub use colvis_plane as plane;
#[cfg(feature = "report")]
#[doc(inline)]
pub use colvis_report::report;
#[doc(inline)]
pub use colvis_scan::{error, math, output, progress, volume};
pub(crate) use colvis_scan::{memory, panics};

pub mod cli;
#[cfg(test)]
#[path = "../tests/support/shared.rs"]
mod shared;

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

/// The GUI library of the window's panels.
#[cfg(feature = "window")]
pub use egui;
/// Panels, the parts of the window, each in its own file; and actions of other crates.
#[cfg(feature = "window")]
pub use host::window::panels as panel;
