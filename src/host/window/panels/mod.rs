//! Panels: the parts of the window, each in its own file.
//!
//! A panel reads the flight and writes only through [`Requests`], which are executed after all panels are laid out.

pub mod candidates;
pub mod flight;
pub mod kinds;
pub mod measures;
pub mod missed;
#[cfg(test)]
mod numbers;
pub mod open;
#[cfg(test)]
mod pictures;
mod rows;
mod series;
pub mod slices;

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use egui::{MouseWheelUnit, Rect, Ui, Vec2};
use glam::DVec3;

use super::actions::{Action, Actions, WhyNot};
use super::assistant::Assistant;
pub use super::assistant::{Order, Showing};
use super::controller::FlightController;
use super::kinds::Kinds;
use super::measures::Measures;
use super::overlay::HudState;
pub use super::own_action::ActionEntry;
use super::seen::Seen;
use super::workspace::scan_name;
use crate::app::FlightApp;
use crate::components::input::Command;
use crate::components::slices::{Orientation, SliceView};
use crate::error::program_name;
use crate::fields::lumen::GasKind;
use crate::polyps::answers::Answer;
use crate::schedule::note;

/// The panels of every window.
pub const BUILT_IN: &[PanelEntry] = &[
    flight::PANEL,
    slices::AXIAL,
    slices::CORONAL,
    slices::SAGITTAL,
    slices::ACROSS,
    measures::PANEL,
    candidates::PANEL,
    kinds::PANEL,
    missed::PANEL,
    open::PANEL,
];

/// The entry of a panel, from which a window creates it.
#[derive(Clone, Copy, Debug)]
pub struct PanelEntry {
    /// Its name in the settings file and in messages.
    pub name: &'static str,
    /// Its title, also in the menu.
    pub title: &'static str,
    /// The key that shows and hides it.
    pub key: Option<char>,
    /// True if it is shown initially in layouts that do not contain it.
    pub shown: bool,
    /// True if it draws on its whole area. Otherwise it has a background and its title.
    pub picture: bool,
    /// Creates it, once for each window.
    pub make: fn() -> Box<dyn Panel>,
}

impl PanelEntry {
    /// An entry that shows nothing. Use it as the base of others.
    pub const NONE: Self =
        Self { name: "", title: "", key: None, shown: false, picture: false, make: || Box::new(Empty) };
}

struct Empty;

impl Panel for Empty {
    fn ui(&mut self, _: &Context<'_>, _: &mut Ui, _: &mut Requests) {}
}

/// Pixels of smooth scrolling that count as one notch of the wheel.
const NOTCH: f32 = 40.0;

/// Returns the notches of a wheel movement, away from the user, on a screen of `scale` pixels per point.
fn notches(unit: MouseWheelUnit, delta: Vec2, scale: f32) -> f64 {
    f64::from(match unit {
        MouseWheelUnit::Line | MouseWheelUnit::Page => delta.y,
        MouseWheelUnit::Point => delta.y * scale / NOTCH,
    })
}

/// Read access of a panel.
pub struct Context<'a> {
    /// The flight.
    pub flight: &'a FlightApp,
    pub(super) controller: &'a FlightController,
    pub(super) actions: &'a Actions,
    /// Recently opened scans, the last one first.
    pub(super) recent: &'a [PathBuf],
    /// The state of the flight for display.
    pub(super) hud: &'a HudState,
    /// The open scan, and the number of the series that was asked for.
    pub(super) opened: Option<(&'a Path, Option<usize>)>,
    /// True if the state is shown above all panels.
    pub(super) is_headed: bool,
}

impl<'a> Context<'a> {
    pub(super) fn new(
        controller: &'a FlightController,
        actions: &'a Actions,
        recent: &'a [PathBuf],
        hud: &'a HudState,
    ) -> Self {
        Self { flight: controller.flight(), controller, actions, recent, hud, opened: None, is_headed: false }
    }

    /// Returns the name of the open scan, and of its series if one was asked for.
    pub(super) fn scan_name(&self) -> Cow<'a, str> {
        scan_name(self.opened)
    }

    /// Tells whether the state is shown above all panels.
    pub(super) fn headed(self, is_headed: bool) -> Self {
        Self { is_headed, ..self }
    }

    /// Returns the number of the series that was asked for.
    pub(super) fn series(&self) -> Option<usize> {
        self.opened.and_then(|o| o.1)
    }

    /// Adds the open scan, and the number of the series that was asked for.
    pub(super) fn of_scan(self, path: Option<&'a Path>, series: Option<usize>) -> Self {
        Self { opened: path.map(|path| (path, series)), ..self }
    }

    /// Returns the place that all views show, world mm: the place pointed at, or the camera's position.
    pub fn place(&self) -> DVec3 {
        self.cursor().unwrap_or(self.flight.pose().position)
    }

    /// Returns the place pointed at, world mm; `None` while everything follows the flight.
    pub fn cursor(&self) -> Option<DVec3> {
        self.controller.slices().cursor()
    }

    /// Returns the measures.
    pub(super) fn measures(&self) -> &'a Measures {
        self.controller.measures()
    }

    /// Returns the assistant, once it was asked for.
    pub(super) fn assistant(&self) -> Option<&'a Assistant> {
        self.controller.assistant()
    }

    /// Returns what of the wall was seen.
    pub(super) fn seen(&self) -> &'a Seen {
        self.controller.seen()
    }

    /// Returns the kinds of gas.
    pub(super) fn kinds(&self) -> &'a Kinds {
        self.controller.kinds()
    }

    /// Returns a slice that is shown.
    pub(super) fn slice(&self, orientation: Orientation) -> Option<&'a SliceView> {
        self.controller.slices().view(self.flight, orientation)
    }

    /// Returns why an action is not possible now; `None` if it is possible.
    pub(super) fn why_not(&self, action: &Action) -> Option<WhyNot> {
        action.why_not(self.controller)
    }

    /// Returns what an action does and its key, for a tooltip; empty if the action does not exist.
    pub(super) fn tip(&self, id: &str) -> String {
        let tip = |action: &Action| match action.key_text() {
            key if key.is_empty() => action.title(),
            key => format!("{} ({key})", action.title()),
        };
        self.actions.named(id).map_or_else(String::new, tip)
    }

    /// Adds a button for an action of the window, by its id, with its text and key as a tooltip. It is grey while the action is
    /// not possible, or if there is none of that id, which the window also tells once. `colvis explain` lists all ids.
    pub fn button(&self, ui: &mut Ui, text: &str, id: &str, requests: &mut Requests) {
        let Some(action) = self.actions.named(id) else {
            // It is refused after the layout of the panel, which is named then.
            requests.action(id);
            ui.add_enabled(false, egui::Button::new(text)).on_disabled_hover_text(format!("there is no action {id:?}"));
            return;
        };
        let why_not = self.why_not(action);
        let shown = ui.add_enabled(why_not.is_none(), egui::Button::new(text));
        if shown.on_hover_text(self.tip(id)).on_disabled_hover_text(why_not.unwrap_or_default()).clicked() {
            requests.action(id);
        }
    }
}

/// Tells once why an action that `asker` asked for is not performed: no action has that id, or it `is_there`, but only for a held key.
pub(super) fn refuse_action(id: &str, is_there: bool, asker: Option<&str>) {
    let by = asker.map_or_else(String::new, |who| format!(": {who} asks for it"));
    let why = match is_there {
        true => format!("is asked for, but it works by its key alone{by}; send a command instead"),
        false => format!("is asked for, but there is none{by}; {} explain lists them", program_name()),
    };
    note(format!("action {id:?}"), why);
}

/// A part of the window that plug-ins can add.
pub trait Panel {
    /// Lays itself out in the remaining area of `ui`. Called whenever something that it shows may have changed: 30 times per
    /// second during a flight, and after operator input at rest. A panel that panics is not called again, and the window shows
    /// the error in its place.
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests);
}

/// Requests of panels.
#[derive(Debug, Default)]
pub struct Requests {
    list: Vec<Request>,
    flight_at: Option<Rect>,
    slices_at: Vec<(Orientation, Rect)>,
}

/// A request about what of the wall was not seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeenInput {
    /// List the missed patches anew.
    List,
    /// Go to the missed patch with this number and look at it.
    Visit(usize),
}

/// A single request.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// A request to the flight.
    Flight(FlightInput),
    /// A request to the slices.
    Slice(SliceInput),
    /// A request to the assistant.
    Assist(AssistInput),
    /// Give a kind to the chosen body of gas, or with `None` take back what was given.
    Kind(Option<GasKind>),
    /// A request about what of the wall was not seen.
    Seen(SeenInput),
    /// Perform an action of the window, by its id.
    Action(String),
    /// Send a command to the flight.
    Command(Command),
    /// Show a message for a moment.
    Say(String),
    /// Open another scan. The number selects a series in a folder that holds several.
    Open(PathBuf, Option<usize>),
}

/// A request to the assistant.
#[derive(Clone, Debug, PartialEq)]
pub enum AssistInput {
    /// Look for polyps, unless that is done or under way.
    Begin,
    /// Stop looking for polyps.
    Cancel,
    /// Show a candidate, by its number from 0.
    Select(usize),
    /// Show the next candidate, or with `false` the previous one.
    Step(bool),
    /// Set which candidates the list shows, and in which order.
    Show(Showing),
    /// Answer whether the candidate that is shown is a polyp, and go on to the next without an answer.
    Answer(Answer),
    /// Write the note of a candidate, by its number from 0.
    Note(usize, String),
    /// Undo the last change of answers and notes.
    Undo,
    /// Mark candidates in all views, or stop that.
    Mark,
    /// Measure lesions by clicks, or stop that.
    Measure,
    /// Forget the measured lesion.
    Forget,
    /// Add the answers of a file.
    Load(PathBuf),
}

/// A request to the slices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SliceInput {
    /// A click at a place, world mm.
    Click(DVec3),
    /// Point at a place, world mm.
    Point(DVec3),
    /// Go to a place, world mm, or tell why the camera cannot; without a flight, start one there.
    SetOut(DVec3),
    /// Scroll by a number of layers, towards the viewer.
    Scroll(Orientation, f64),
    /// Move the image to the right and downwards, mm.
    Pan(Orientation, [f64; 2]),
    /// Magnify by a number of wheel notches about a place, world mm, which stays where it is in the image.
    Zoom(Orientation, f64, DVec3),
    /// Go to a place, world mm: point at it, in the middle of every slice, with at least so many mm across it.
    GoTo(DVec3, f64),
    /// Adjust the grey-level window by a drag in pixels: to the right widens it, upwards raises it.
    Window([f64; 2]),
}

/// A request to the flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FlightInput {
    /// Look around by a drag to the right and downwards, pixels.
    Look([f64; 2]),
    /// Roll by a drag to the right, pixels.
    Roll(f64),
    /// Narrow the view angle by a number of wheel notches.
    Zoom(f64),
    /// Fly faster by a number of wheel notches.
    Speed(f64),
    /// Jump to a share of the path.
    Seek(f64),
    /// A click on a pixel of the picture.
    Click([f64; 2]),
    /// Fly towards the point seen at a pixel of the picture, and look at it.
    LookAt([f64; 2]),
    /// Delete a measure, by its number.
    DeleteMeasure(usize),
}

impl Requests {
    /// Adds a request.
    pub(super) fn ask(&mut self, request: Request) {
        self.list.push(request);
    }

    /// Returns how many there are.
    pub(super) fn count(&self) -> usize {
        self.list.len()
    }

    /// Removes those of the actions asked for from request `first` on that are not performed, and tells why, and that `asker` wants
    /// them.
    pub(super) fn refuse_from(&mut self, first: usize, actions: &Actions, asker: &str) {
        let mut n = 0;
        self.list.retain(|request| {
            n += 1;
            let Request::Action(id) = request else { return true };
            let found = actions.named(id);
            let is_refused = n > first && !found.is_some_and(Action::is_performed);
            if is_refused {
                refuse_action(id, found.is_some(), Some(asker));
            }
            !is_refused
        });
    }

    /// Adds a request to the flight.
    pub(super) fn fly(&mut self, request: FlightInput) {
        self.ask(Request::Flight(request));
    }

    /// Adds a request to the slices.
    pub(super) fn slice(&mut self, request: SliceInput) {
        self.ask(Request::Slice(request));
    }

    /// Adds a request to the assistant.
    pub(super) fn assist(&mut self, request: AssistInput) {
        self.ask(Request::Assist(request));
    }

    /// Opens another scan instead of this one.
    pub fn open(&mut self, scan: PathBuf) {
        self.ask(Request::Open(scan, None));
    }

    /// Points at a place, world mm. All views show it until the flight continues.
    pub fn point(&mut self, place: DVec3) {
        self.slice(SliceInput::Point(place));
    }

    /// Goes to a place, world mm: all views show it until the flight continues, the slices with at least `span_mm` around it.
    pub(super) fn go_to(&mut self, place: DVec3, span_mm: f64) {
        self.slice(SliceInput::GoTo(place, span_mm));
    }

    /// Deletes a measure, by its number.
    pub(super) fn delete_measure(&mut self, number: usize) {
        self.fly(FlightInput::DeleteMeasure(number));
    }

    /// Shows a slice below the interface, like the flight's picture, in a rectangle in points.
    pub(super) fn show_slice(&mut self, orientation: Orientation, at: Rect) {
        self.slices_at.push((orientation, at));
    }

    /// Returns the rectangles of slices, points.
    pub(super) fn slices_at(&self) -> &[(Orientation, Rect)] {
        &self.slices_at
    }

    /// Performs an action of the window, by its id in the settings file: `"pause"`, `"reverse"`. `colvis explain` lists all ids. If
    /// there is none of that id, or it steers while its key is held, nothing happens, and the window tells it once.
    pub fn action(&mut self, id: &str) {
        self.ask(Request::Action(id.to_owned()));
    }

    /// Sends a command to the flight: a [`FlightCommand`](crate::components::input::FlightCommand) or a
    /// [`HandCommand`](crate::components::input::HandCommand). If it is refused, the window tells why.
    pub fn command(&mut self, command: impl Into<Command>) {
        self.ask(Request::Command(command.into()));
    }

    /// Shows a message for a moment: one short line.
    pub fn say(&mut self, text: impl Into<String>) {
        self.ask(Request::Say(text.into()));
    }

    /// Jumps to a share of the path, 0 to 1.
    pub fn seek(&mut self, share: f64) {
        self.fly(FlightInput::Seek(share));
    }

    /// Shows the flight's picture below the interface, in a rectangle in points. Draw nothing opaque there.
    pub fn show_flight(&mut self, at: Rect) {
        self.flight_at = Some(at);
    }

    /// Returns the rectangle of the flight's picture, points.
    pub(super) fn flight_at(&self) -> Option<Rect> {
        self.flight_at
    }

    /// Takes all requests, in order.
    pub(super) fn take(&mut self) -> Vec<Request> {
        std::mem::take(&mut self.list)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_action_that_is_not_there_is_told_with_the_panel_that_wants_it() {
        let mut c = super::super::controller::tests::controller("tentacles");
        let guides = &c.flight().setup().scene.guides;
        let actions = Actions::new(guides, &[], BUILT_IN, &Default::default()).unwrap();
        let mut requests = Requests::default();
        requests.action("elsewhere");
        let first = requests.count();
        for id in ["pause", "jump", "forward", "seek"] {
            requests.action(id);
        }
        requests.refuse_from(first, &actions, "panel bad");
        let notes = c.flight_mut().take_notes();
        let held = "is asked for, but it works by its key alone: panel bad asks for it; ";
        for (n, (id, why)) in
            [("jump", "is asked for, but there is none: panel bad asks for it; "), ("forward", held), ("seek", held)]
                .into_iter()
                .enumerate()
        {
            assert!(notes[n].starts_with(&format!("action {id:?} {why}")), "{notes:?}");
        }
        assert_eq!(notes.len(), 3);
        let left = ["elsewhere", "pause"].map(|id| Request::Action(id.to_owned()));
        assert_eq!(requests.take(), left);
    }

    #[test]
    fn requests_are_taken_once_and_in_their_order() {
        let mut requests = Requests::default();
        requests.seek(0.25);
        requests.open(PathBuf::from("scan.nii"));
        requests.point(DVec3::X);
        requests.action("pause");
        requests.delete_measure(3);
        let expected = [
            Request::Flight(FlightInput::Seek(0.25)),
            Request::Open(PathBuf::from("scan.nii"), None),
            Request::Slice(SliceInput::Point(DVec3::X)),
            Request::Action("pause".to_owned()),
            Request::Flight(FlightInput::DeleteMeasure(3)),
        ];
        assert_eq!(requests.take(), expected);
        assert!(requests.take().is_empty());
    }
}
