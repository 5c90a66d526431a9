//! colvis: flying through the inside of the body, on a processor alone.
//!
//! Who may use whom, from the bottom up (nothing points the other way):
//!
//! `error`, `progress`, `memory`, `math` ← `volume`, `phantom`, `fields`, `dynamics` ← `render` ← `surface`, `components` ←
//! `systems` ← `app` ← `host`, `report` ← `cli`; `plane`, the flights in two dimensions, stands beside `app`.
//!
//! Everything up to `render` is plain functions and data that know no entity-component-system. `components` holds what
//! the entities carry, `systems` (the folder beside `src`) one file for each scheduled system, `app` the plugins and the
//! schedule, `host` what drives it: a window, or nobody.
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
pub mod phantom;
pub mod plane;
pub mod progress;
pub mod render;
pub mod report;
pub mod surface;
pub mod volume;

#[expect(
    clippy::needless_pass_by_value,
    clippy::type_complexity,
    reason = "a system takes its parameters by value, and its queries are types that list what it touches"
)]
#[path = "../systems/mod.rs"]
pub mod systems;
