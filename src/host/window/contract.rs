//! What panels and actions of other crates see of a window, and how they ask for what they want.
//!
//! They read through [`Context`] and write through [`Requests`], which are executed after all panels are laid out.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use egui::{Rect, Ui};
use glam::DVec3;

use super::action::{Action, Actions};
use super::assistant::Assistant;
use super::document::Document;
use super::finding_tool::FindingTool;
use super::flat::Flat;
use super::intent::{Intent, SliceInput, WhyNot};
use super::kinds::Kinds;
use super::measures::Measures;
use super::overlay::{Content, HudState};
use super::pairing::{Expected, Pairing, Twice};
use super::quality::QualityTool;
use super::reporting::Reporting;
use super::seen::Seen;
use super::slices::Slices;
use crate::app::FlightApp;
use crate::app::findings::Findings;
use crate::components::input::Command;
use crate::components::slices::{Orientation, SliceView};
use crate::error::program_name;
use crate::fields::matching::Side;
use crate::schedule::note;

/// What the embedded phantom is called.
const PHANTOM: &str = "synthetic phantom";

/// Returns the name of an open scan, and of its series if one was asked for.
pub(crate) fn scan_name(opened: Option<(&Path, Option<usize>)>) -> Cow<'_, str> {
    let Some((path, series)) = opened else { return PHANTOM.into() };
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    match series {
        Some(n) => format!("{name}, series {n}").into(),
        None => name,
    }
}

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

/// What a window shows, for panels.
pub(crate) trait WindowView {
    /// Returns the flight.
    fn flight(&self) -> &FlightApp;
    /// Returns the slices that are shown.
    fn slices(&self) -> &Slices;
    /// Returns the measured distances.
    fn measures(&self) -> &Measures;
    /// Returns the assistant, once it was asked for.
    fn assistant(&self) -> Option<&Assistant>;
    /// Returns what was found.
    fn document(&self) -> &Document;
    /// Returns the chosen finding, and the pictures of all.
    fn findings(&self) -> &FindingTool;
    /// Returns the quality of the segments.
    fn quality(&self) -> &QualityTool;
    /// Returns the report that is made, or was made last.
    fn reporting(&self) -> &Reporting;
    /// Returns the segment of the colon that the camera is in, if it is known.
    fn segment_here(&self) -> Option<&'static str>;
    /// Returns what of the wall was seen.
    fn seen(&self) -> &Seen;
    /// Returns the kinds of gas.
    fn kinds(&self) -> &Kinds;
    /// Returns the colon laid flat.
    fn flat(&self) -> &Flat;
    /// Returns why the scan cannot be flown; `None` if it can.
    fn unflown(&self) -> Option<&str>;
    /// True if marks are drawn in the picture that the state for display does not contain.
    fn has_marks(&self) -> bool;
    /// True if the state that an intent switches is on.
    fn is_on(&self, intent: &Intent) -> bool;
    /// Returns why something is not possible now; `None` if it is possible.
    fn why_not(&self, intent: &Intent) -> Option<WhyNot>;
}

/// Read access of a panel.
pub struct Context<'a> {
    /// The flight.
    pub flight: &'a FlightApp,
    pub(super) view: &'a dyn WindowView,
    pub(super) actions: &'a Actions,
    /// Recently opened scans, the last one first.
    pub(super) recent: &'a [PathBuf],
    /// The state of the flight for display.
    pub(super) hud: &'a HudState,
    /// The open scan, and the number of the series that was asked for.
    pub(super) opened: Option<(&'a Path, Option<usize>)>,
    /// True if the state is shown above all panels.
    pub(super) is_headed: bool,
    /// The patient's other position.
    pub(super) other: Option<Other<'a>>,
    /// True if the panel of the second position is shown.
    pub(super) shows_both: bool,
    /// What the positions have in common, and which of them this is.
    pub(super) pairing: Option<(&'a Pairing, Side)>,
}

/// A picture below the interface beside those of the flight and its slices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Beside {
    /// The flight through the patient's other position.
    Other,
    /// A slice of the patient's other position.
    OtherSlice(Orientation),
    /// The colon laid flat.
    Flat,
}

/// The patient's position that is not worked in.
#[derive(Clone, Copy)]
pub(super) struct Other<'a> {
    /// What there is of it.
    pub(super) content: &'a Content,
    /// Its flight, once there is one.
    pub(super) view: Option<&'a dyn WindowView>,
    pub(super) opened: Option<(&'a Path, Option<usize>)>,
    /// True if it is the first position: the second is worked in.
    pub(super) is_first: bool,
}

impl<'a> Context<'a> {
    pub(super) fn new(
        view: &'a dyn WindowView,
        actions: &'a Actions,
        recent: &'a [PathBuf],
        hud: &'a HudState,
    ) -> Self {
        Self {
            flight: view.flight(),
            view,
            actions,
            recent,
            hud,
            opened: None,
            is_headed: false,
            other: None,
            shows_both: false,
            pairing: None,
        }
    }

    /// Returns the name of the open scan, and of its series if one was asked for.
    pub(super) fn scan_name(&self) -> Cow<'a, str> {
        scan_name(self.opened)
    }

    /// Tells whether the state is shown above all panels.
    pub(super) fn headed(self, is_headed: bool) -> Self {
        Self { is_headed, ..self }
    }

    /// Adds the patient's other position. `shows_both` tells whether the panel of the second one is shown.
    pub(super) fn beside(self, other: Option<Other<'a>>, shows_both: bool, pairing: &'a Pairing) -> Self {
        let side = if other.is_some_and(|other| other.is_first) { Side::B } else { Side::A };
        Self { other, shows_both, pairing: other.map(|_| (pairing, side)), ..self }
    }

    /// Returns what the other position lets expect in this one.
    pub(super) fn expected(&self) -> &'a [Expected] {
        self.pairing.map_or(&[], |(pairing, side)| pairing.expected(side))
    }

    /// Returns what a candidate, by its number from 0, is in the other position.
    pub(super) fn twice(&self, candidate: usize) -> Option<Twice> {
        let (pairing, side) = self.pairing?;
        pairing.twice(side).get(candidate).copied().flatten()
    }

    /// Returns the same of the other position, with its state for display; `None` if there is none, or if it is not ready.
    pub(super) fn of_other(&self) -> Option<Self> {
        let other = self.other?;
        let (Some(view), Content::Flight(hud)) = (other.view, other.content) else { return None };
        let pairing = self.pairing.map(|(pairing, side)| (pairing, side.other()));
        Some(Self { opened: other.opened, pairing, ..Self::new(view, self.actions, self.recent, hud) })
    }

    /// True if the second position is worked in, and not the first.
    pub(super) fn is_second(&self) -> bool {
        self.other.is_some_and(|other| other.is_first)
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
        self.view.slices().cursor()
    }

    /// Returns the measures.
    pub(super) fn measures(&self) -> &'a Measures {
        self.view.measures()
    }

    /// Returns the assistant, once it was asked for.
    pub(super) fn assistant(&self) -> Option<&'a Assistant> {
        self.view.assistant()
    }

    /// Returns what the reader found.
    pub(super) fn found(&self) -> &'a Findings {
        self.view.document().found()
    }

    /// Returns the number of the chosen finding.
    pub(super) fn current_finding(&self) -> Option<usize> {
        self.view.findings().current(&self.found().findings)
    }

    /// Returns what of the wall was seen.
    pub(super) fn seen(&self) -> &'a Seen {
        self.view.seen()
    }

    /// Returns the kinds of gas.
    pub(super) fn kinds(&self) -> &'a Kinds {
        self.view.kinds()
    }

    /// Returns a slice that is shown.
    pub(super) fn slice(&self, orientation: Orientation) -> Option<&'a SliceView> {
        self.view.slices().view(self.flight, orientation)
    }

    /// Returns why an action is not possible now; `None` if it is possible.
    pub(super) fn why_not(&self, action: &Action) -> Option<WhyNot> {
        self.view.why_not(&action.intent)
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
    let by = asker.map_or_else(String::new, |who| format!(": requested by {who}"));
    let why = match is_there {
        true => format!("cannot be requested, because it works by its key alone{by}; send a command instead"),
        false => format!("does not exist{by}; {} explain lists them", program_name()),
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
    list: Vec<Intent>,
    flight_at: Option<Rect>,
    slices_at: Vec<(Orientation, Rect)>,
    beside_at: Vec<(Beside, Rect)>,
}

impl Requests {
    /// Adds a request.
    pub(super) fn ask(&mut self, request: Intent) {
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
            let Intent::Action(id) = request else { return true };
            let found = actions.named(id);
            let is_refused = n > first && !found.is_some_and(Action::is_performed);
            if is_refused {
                refuse_action(id, found.is_some(), Some(asker));
            }
            !is_refused
        });
    }

    /// Adds a request to the slices.
    pub(super) fn slice(&mut self, request: SliceInput) {
        self.ask(Intent::Slice(request));
    }

    /// Opens another scan instead of this one.
    pub fn open(&mut self, scan: PathBuf) {
        self.ask(Intent::Open(scan, None));
    }

    /// Points at a place, world mm. All views show it until the flight continues.
    pub fn point(&mut self, place: DVec3) {
        self.slice(SliceInput::Point(place));
    }

    /// Goes to a place, world mm: all views show it until the flight continues, the slices with at least `span_mm` around it.
    pub(super) fn go_to(&mut self, place: DVec3, span_mm: f64) {
        self.slice(SliceInput::GoTo(place, span_mm));
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
        self.ask(Intent::Action(id.to_owned()));
    }

    /// Sends a command to the flight: a [`FlightCommand`](crate::components::input::FlightCommand) or a
    /// [`HandCommand`](crate::components::input::HandCommand). If it is refused, the window tells why.
    pub fn command(&mut self, command: impl Into<Command>) {
        self.ask(Intent::Command(command.into()));
    }

    /// Shows a message for a moment: one short line.
    pub fn say(&mut self, text: impl Into<String>) {
        self.ask(Intent::Say(text.into()));
    }

    /// Jumps to a share of the path, 0 to 1.
    pub fn seek(&mut self, share: f64) {
        self.ask(Intent::Seek(share));
    }

    /// Shows the flight's picture below the interface, in a rectangle in points. Draw nothing opaque there.
    pub fn show_flight(&mut self, at: Rect) {
        self.flight_at = Some(at);
    }

    /// Returns the rectangle of the flight's picture, points.
    pub(super) fn flight_at(&self) -> Option<Rect> {
        self.flight_at
    }

    /// Shows a picture below the interface, like the flight's, in a rectangle in points.
    pub(super) fn show_beside(&mut self, which: Beside, at: Rect) {
        self.beside_at.push((which, at));
    }

    /// Takes over requests that are the other position's.
    pub(super) fn of_other(&mut self, of_other: &mut Self) {
        self.list.extend(of_other.take().into_iter().map(|intent| Intent::OfOther(Box::new(intent))));
        self.beside_at.extend(of_other.slices_at.drain(..).map(|(o, at)| (Beside::OtherSlice(o), at)));
    }

    /// Returns the rectangles of pictures beside the flight's, points.
    pub(super) fn beside_at(&self) -> &[(Beside, Rect)] {
        &self.beside_at
    }

    /// Takes all requests, in order.
    pub(super) fn take(&mut self) -> Vec<Intent> {
        std::mem::take(&mut self.list)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::window::panels::BUILT_IN;

    #[test]
    fn an_action_that_is_not_there_is_told_with_the_panel_that_wants_it() {
        let mut c = crate::host::window::controller::tests::controller("tentacles");
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
        let held = "cannot be requested, because it works by its key alone: requested by panel bad; ";
        for (n, (id, why)) in [("jump", "does not exist: requested by panel bad; "), ("forward", held), ("seek", held)]
            .into_iter()
            .enumerate()
        {
            assert!(notes[n].starts_with(&format!("action {id:?} {why}")), "{notes:?}");
        }
        assert_eq!(notes.len(), 3);
        let left = ["elsewhere", "pause"].map(|id| Intent::Action(id.to_owned()));
        assert_eq!(requests.take(), left);
    }

    #[test]
    fn requests_are_taken_once_and_in_their_order() {
        let mut requests = Requests::default();
        requests.seek(0.25);
        requests.open(PathBuf::from("scan.nii"));
        requests.point(DVec3::X);
        requests.action("pause");
        requests.ask(Intent::DeleteMeasure(3));
        let expected = [
            Intent::Seek(0.25),
            Intent::Open(PathBuf::from("scan.nii"), None),
            Intent::Slice(SliceInput::Point(DVec3::X)),
            Intent::Action("pause".to_owned()),
            Intent::DeleteMeasure(3),
        ];
        assert_eq!(requests.take(), expected);
        assert!(requests.take().is_empty());
    }
}
