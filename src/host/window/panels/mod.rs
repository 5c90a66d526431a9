//! Panels: the parts of the window, each in its own file.
//!
//! A panel reads the flight through its [`Context`] and writes only through [`Requests`], which are executed after all panels are laid
//! out.

#[cfg(feature = "dicom")]
mod archive;
pub mod candidates;
mod expected;
pub mod findings;
pub mod flat;
pub mod flight;
pub mod kinds;
pub mod measures;
pub mod missed;
#[cfg(test)]
mod numbers;
pub mod open;
#[cfg(test)]
mod pictures;
pub mod quality;
mod rows;
pub mod second;
mod series;
pub mod slices;

use egui::{MouseWheelUnit, Vec2};

pub use super::assistant::{Order, Showing};
pub use super::contract::{Context, Panel, PanelEntry, Requests};
pub use super::own_action::ActionEntry;

/// The panels of every window.
pub const BUILT_IN: &[PanelEntry] = &[
    flight::PANEL,
    slices::AXIAL,
    slices::CORONAL,
    slices::SAGITTAL,
    slices::ACROSS,
    findings::PANEL,
    measures::PANEL,
    candidates::PANEL,
    kinds::PANEL,
    missed::PANEL,
    quality::PANEL,
    flat::PANEL,
    second::PANEL,
    slices::OTHER_AXIAL,
    slices::OTHER_CORONAL,
    slices::OTHER_SAGITTAL,
    open::PANEL,
];

/// Pixels of smooth scrolling that count as one notch of the wheel.
const NOTCH: f32 = 40.0;

/// Returns the notches of a wheel movement, away from the user, on a screen of `scale` pixels per point.
fn notches(unit: MouseWheelUnit, delta: Vec2, scale: f32) -> f64 {
    f64::from(match unit {
        MouseWheelUnit::Line | MouseWheelUnit::Page => delta.y,
        MouseWheelUnit::Point => delta.y * scale / NOTCH,
    })
}
