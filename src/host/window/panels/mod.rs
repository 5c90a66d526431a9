//! Panels: what the window shows, each in a file of its own.
//!
//! A panel reads the flight and writes only through [`Requests`], which are followed once all panels are laid out.

pub mod flight;

use egui::{Rect, Ui};

use super::overlay::Readings;
use crate::app::FlightApp;

/// What a panel reads.
pub struct Context<'a> {
    /// The flight.
    pub flight: &'a FlightApp,
    /// The flight in words.
    pub(super) readings: &'a Readings,
}

/// Something in the window that others can add to.
pub trait Panel {
    /// Lays it out in what is left of `ui`.
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests);
}

/// What panels ask for.
#[derive(Debug, Default)]
pub struct Requests {
    list: Vec<Request>,
    flight_at: Option<Rect>,
}

/// One of them.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// Look around: the view was dragged by so many pixels to the right and downwards.
    Look([f64; 2]),
    /// Roll: the view was dragged by so many pixels to the right.
    Roll(f64),
    /// Make the view angle narrower by so many notches of the wheel.
    Zoom(f64),
    /// Fly faster by so many notches of the wheel.
    Hurry(f64),
    /// Go to a share of the way.
    Seek(f64),
}

impl Requests {
    /// Asks for something.
    pub(super) fn ask(&mut self, request: Request) {
        self.list.push(request);
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
