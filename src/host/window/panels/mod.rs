//! Panels: what the window shows, each in a file of its own.
//!
//! A panel reads the flight and writes only through [`Requests`], which are followed once all panels are laid out.

pub mod flight;
pub mod measures;
pub mod open;
#[cfg(test)]
mod pictures;
pub mod slices;

use std::path::PathBuf;

use egui::{MouseWheelUnit, Rect, Ui, Vec2};
use glam::DVec3;

use super::actions::{Action, Actions};
use super::controller::FlightController;
use super::measures::Measures;
use super::overlay::HudState;
use crate::app::FlightApp;
use crate::components::slices::{Orientation, SliceView};

/// The panels that every window has.
pub const BUILT_IN: &[PanelEntry] =
    &[flight::PANEL, slices::AXIAL, slices::CORONAL, slices::SAGITTAL, slices::ACROSS, measures::PANEL, open::PANEL];

/// A panel, as a window makes it.
#[derive(Clone, Copy, Debug)]
pub struct PanelEntry {
    /// Its name, in the settings file and in messages.
    pub name: &'static str,
    /// What stands above it, and in the menu.
    pub title: &'static str,
    /// The key that shows and hides it.
    pub key: Option<char>,
    /// Whether it is shown from the beginning, in a layout that it is no part of.
    pub shown: bool,
    /// Whether it draws on all of its place itself; else it has a background and its title.
    pub picture: bool,
    /// Makes it, once for each window.
    pub make: fn() -> Box<dyn Panel>,
}

impl PanelEntry {
    /// One that shows nothing, to be filled in.
    pub const NONE: Self =
        Self { name: "", title: "", key: None, shown: false, picture: false, make: || Box::new(Empty) };
}

struct Empty;

impl Panel for Empty {
    fn ui(&mut self, _: &Context<'_>, _: &mut Ui, _: &mut Requests) {}
}

/// Pixels of a smooth scroll that count as a notch of the wheel.
const NOTCH: f32 = 40.0;

/// The notches that a wheel was turned by, away from who turns it, on a screen of `scale` pixels a point.
fn notches(unit: MouseWheelUnit, delta: Vec2, scale: f32) -> f64 {
    f64::from(match unit {
        MouseWheelUnit::Line | MouseWheelUnit::Page => delta.y,
        MouseWheelUnit::Point => delta.y * scale / NOTCH,
    })
}

/// What a panel reads.
pub struct Context<'a> {
    /// The flight.
    pub flight: &'a FlightApp,
    pub(super) controller: &'a FlightController,
    pub(super) actions: &'a Actions,
    /// The scans that were open lately, the last one first.
    pub(super) recent: &'a [PathBuf],
    /// The flight in words.
    pub(super) hud: &'a HudState,
}

impl<'a> Context<'a> {
    pub(super) fn new(
        controller: &'a FlightController,
        actions: &'a Actions,
        recent: &'a [PathBuf],
        hud: &'a HudState,
    ) -> Self {
        Self { flight: controller.flight(), controller, actions, recent, hud }
    }

    /// The place that all views show, world mm: one that was pointed at, or where the camera is.
    pub fn place(&self) -> DVec3 {
        self.cursor().unwrap_or(self.flight.pose().position)
    }

    /// A place that was pointed at, world mm; none while everything follows the flight.
    pub fn cursor(&self) -> Option<DVec3> {
        self.controller.slices().cursor()
    }

    /// What was measured.
    pub(super) fn measures(&self) -> &'a Measures {
        self.controller.measures()
    }

    /// A slice that is shown.
    pub(super) fn slice(&self, orientation: Orientation) -> Option<&'a SliceView> {
        self.controller.slices().view(self.flight, orientation)
    }

    /// Why an action cannot be done now; none if it can.
    pub(super) fn why_not(&self, action: &Action) -> Option<&'static str> {
        (action.possible)(self.controller).err()
    }

    /// A button for an action of the window, by its id, with its text and key as a tooltip; grey while it is not possible.
    /// Nothing where there is no such action.
    pub fn button(&self, ui: &mut Ui, text: &str, id: &str, requests: &mut Requests) {
        let Some(action) = self.actions.named(id) else { return };
        let why_not = self.why_not(action);
        let shown = ui.add_enabled(why_not.is_none(), egui::Button::new(text));
        let key = action.key_text();
        let tip = if key.is_empty() { action.title() } else { format!("{} ({key})", action.title()) };
        if shown.on_hover_text(tip).on_disabled_hover_text(why_not.unwrap_or_default()).clicked() {
            requests.action(id);
        }
    }
}

/// Something in the window that others can add to.
pub trait Panel {
    /// Lays it out in what is left of `ui`. Called whenever something that it shows may have changed: while the flight goes on 30 times a
    /// second, at rest after the operator has done something. One that panics is not called again: the
    /// window says so in its place.
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests);
}

/// What panels ask for.
#[derive(Debug, Default)]
pub struct Requests {
    list: Vec<Request>,
    flight_at: Option<Rect>,
    slices_at: Vec<(Orientation, Rect)>,
}

/// One of them.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// Something of the flight.
    Flight(FlightInput),
    /// Something of the slices.
    Slice(SliceInput),
    /// An action of the window, by its id.
    Action(String),
    /// Open another scan; of a folder that holds several series, this one.
    Open(PathBuf, Option<usize>),
}

/// What is asked of the slices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SliceInput {
    /// A click at a place, world mm.
    Click(DVec3),
    /// Point at a place, world mm.
    Point(DVec3),
    /// Go on by so many layers, towards who looks.
    Scroll(Orientation, f64),
    /// Move the image by so many mm to the right and downwards.
    Pan(Orientation, [f64; 2]),
    /// Magnify by so many notches of the wheel.
    Zoom(Orientation, f64),
    /// Window: the image was dragged by so many pixels to the right, which widens it, and upwards, which raises it.
    Window([f64; 2]),
}

/// What is asked of the flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FlightInput {
    /// Look around: the view was dragged by so many pixels to the right and downwards.
    Look([f64; 2]),
    /// Roll: the view was dragged by so many pixels to the right.
    Roll(f64),
    /// Make the view angle narrower by so many notches of the wheel.
    Zoom(f64),
    /// Fly faster by so many notches of the wheel.
    Speed(f64),
    /// Go to a share of the way.
    Seek(f64),
    /// A click on what is seen at a point of the picture, pixels.
    Click([f64; 2]),
    /// Fly to what is seen at a point of the picture, pixels, and look at it.
    LookAt([f64; 2]),
    /// Take a measure away, by its number.
    DeleteMeasure(usize),
}

impl Requests {
    /// Asks for something.
    pub(super) fn ask(&mut self, request: Request) {
        self.list.push(request);
    }

    /// Asks something of the flight.
    pub(super) fn fly(&mut self, request: FlightInput) {
        self.ask(Request::Flight(request));
    }

    /// Asks something of the slices.
    pub(super) fn slice(&mut self, request: SliceInput) {
        self.ask(Request::Slice(request));
    }

    /// Opens another scan in the place of this one.
    pub fn open(&mut self, scan: PathBuf) {
        self.ask(Request::Open(scan, None));
    }

    /// Points at a place, world mm: all views show it until the flight goes on.
    pub fn point(&mut self, place: DVec3) {
        self.slice(SliceInput::Point(place));
    }

    /// Takes a measure away, by its number.
    pub(super) fn delete_measure(&mut self, number: usize) {
        self.fly(FlightInput::DeleteMeasure(number));
    }

    /// Has a slice below the interface, as the flight's picture.
    pub(super) fn show_slice(&mut self, orientation: Orientation, at: Rect) {
        self.slices_at.push((orientation, at));
    }

    /// Where slices lie, points.
    pub(super) fn slices_at(&self) -> &[(Orientation, Rect)] {
        &self.slices_at
    }

    /// Effect an action of the window, by its id in the settings file: `"pause"`, `"reverse"`. One that there is not is nothing.
    pub fn action(&mut self, id: &str) {
        self.ask(Request::Action(id.to_owned()));
    }

    /// Goes to a share of the way, 0 to 1.
    pub fn seek(&mut self, share: f64) {
        self.fly(FlightInput::Seek(share));
    }

    /// Has the flight's picture below the interface, in a rectangle in points that nothing opaque is drawn in.
    pub fn show_flight(&mut self, at: Rect) {
        self.flight_at = Some(at);
    }

    /// Where the flight's picture lies, points.
    pub(super) fn flight_at(&self) -> Option<Rect> {
        self.flight_at
    }

    /// All in their order.
    pub(super) fn take(&mut self) -> Vec<Request> {
        std::mem::take(&mut self.list)
    }
}
