//! colvis: flying through the inside of the body, on a processor alone.
//!
//! Who may use whom, from the bottom up (nothing points the other way):
//!
//! `error`, `progress`, `math` ← `volume`, `phantom`, `fields`, `dynamics` ← `render` ← `components` ← `systems`
//! ← `app` ← `host` ← `cli`.
//!
//! Everything up to `render` is plain functions and data that know no entity-component-system. `components` holds what
//! the entities carry, `systems` (the folder beside `src`) one file for each scheduled system, `app` the plugins and the
//! schedule, `host` what drives it: a window, or nobody.
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
pub mod output;
pub mod phantom;
pub mod progress;
pub mod render;
pub mod volume;

#[expect(
    clippy::needless_pass_by_value,
    clippy::type_complexity,
    reason = "a system takes its parameters by value, and its queries are types that list what it touches"
)]
#[path = "../systems/mod.rs"]
pub mod systems;
