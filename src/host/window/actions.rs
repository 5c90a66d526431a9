//! The table of actions: what the operator can do in a window, with which keys, and when. Keys, help, menus, buttons and tooltips
//! are generated from it.

use std::borrow::Cow;
use std::time::Instant;

use super::controller::FlightController;
use super::keys::{Chord, Hold, KeySettings};
use super::layouts::LAYOUTS;
use super::own_action::{ActionEntry, OwnState};
use super::panels::{AssistInput, PanelEntry};
use super::printed::Printed;
use crate::app::Overlay;
use crate::app::catalog::taken;
use crate::error::{Error, Result, program_name};
use crate::fields::lumen::GasKind;
use crate::polyps::answers::Answer;
use crate::render::ImageSize;
use crate::schedule::Guides;

/// An action of the operator.
#[derive(Clone, Debug)]
pub(crate) struct Action {
    /// Its name in the settings file.
    pub id: Cow<'static, str>,
    /// Short description, for a button's tooltip.
    pub text: Cow<'static, str>,
    /// Its row in the help, shared with other actions.
    row: Cow<'static, str>,
    /// Its keys.
    keys: Vec<Chord>,
    /// The names of these keys on the reader's keyboard.
    shown: Vec<String>,
    /// The same keys with Shift: a key pressed as `,` may be released as `<`.
    shifted: Vec<Chord>,
    /// The mouse gesture for it.
    gesture: &'static str,
    /// True if it repeats while its key is held.
    pub repeats: bool,
    /// Checks whether it is possible now. If not, its button is grey and shows the reason.
    pub possible: Possible,
    /// What it does.
    pub effect: Effect,
    /// The state of an action of another crate.
    pub own: OwnState,
}

/// The effect of an action.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Effect {
    /// Steers while the key is held.
    Hold(Hold),
    /// Changes the flight, or how it is shown.
    Once(fn(&mut FlightController, ActionContext)),
    /// Switches to the guide with this name.
    HandTo(&'static str),
    /// Shows or hides the overlay with this number.
    Overlay(usize),
    /// A request to the window itself, independent of its content.
    Window(WindowRequest),
    /// What another crate wants.
    Own(ActionEntry),
    /// None by a key: it is a mouse gesture only.
    Gesture,
}

/// Context of an action: the size of the picture and the time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ActionContext {
    /// Size of the flight's picture, pixels.
    pub window: ImageSize,
    /// Current time.
    pub now: Instant,
}

/// A request to the window itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WindowRequest {
    /// Toggle full screen.
    Fullscreen,
    /// Quit the program; asks first if something is unfinished.
    Quit,
    /// Cancel what is under way, or close what covers the window: the innermost of these. Never quits.
    Cancel,
    /// Show or hide the list of keys.
    Help,
    /// Show or hide the list of scans to open.
    Open,
    /// Open the scan anew, for one flight through the whole colon.
    Whole,
    /// Show or hide the kinds of gas in the slices, and their panel.
    Kinds,
    /// Paint or stop painting what of the wall was not seen, and show or hide its panel.
    Seen,
    /// Show the layout with this number.
    Layout(usize),
    /// Show or hide the panel with this number.
    Panel(usize),
}

/// The reason why an action is not possible now.
pub(crate) type WhyNot = Cow<'static, str>;

/// Checks whether an action is possible now. The error states why not.
pub(crate) type Possible = fn(&FlightController) -> std::result::Result<(), WhyNot>;

fn always(_: &FlightController) -> std::result::Result<(), WhyNot> {
    Ok(())
}

/// Refuses actions that a replayed log, or a scan without a flight, cannot follow.
fn flies_itself(c: &FlightController) -> std::result::Result<(), WhyNot> {
    if c.flight().setup().scene.play().is_some() { Err("a log is replayed".into()) } else { c.may_fly() }
}

/// Refuses what only a flight can follow, in a scan that is looked at without one.
fn has_flight(c: &FlightController) -> std::result::Result<(), WhyNot> {
    c.may_fly()
}

fn has_both_scans(c: &FlightController) -> std::result::Result<(), WhyNot> {
    c.cleansing().may_switch().map_err(Into::into)
}

fn has_list(c: &FlightController) -> std::result::Result<(), WhyNot> {
    c.may_read()
}

fn has_body(c: &FlightController) -> std::result::Result<(), WhyNot> {
    c.kinds().may_tell().map_err(Into::into)
}

fn may_see_missed(c: &FlightController) -> std::result::Result<(), WhyNot> {
    c.may_see_missed()
}

/// A replayed log knows no tour.
fn may_review(c: &FlightController) -> std::result::Result<(), WhyNot> {
    flies_itself(c).and_then(|()| c.may_see_missed())
}

fn shows_slices(c: &FlightController) -> std::result::Result<(), WhyNot> {
    if c.shows_slices() { Ok(()) } else { Err("no slice is shown".into()) }
}

/// A row of the table.
struct Row {
    id: &'static str,
    text: &'static str,
    row: &'static str,
    keys: &'static str,
    shifted: &'static str,
    gesture: &'static str,
    repeats: bool,
    possible: Possible,
    effect: Effect,
}

const ROW: Row = Row {
    id: "",
    text: "",
    row: "",
    keys: "",
    shifted: "",
    gesture: "",
    repeats: false,
    possible: always,
    effect: Effect::Gesture,
};

const fn hold(id: &'static str, text: &'static str, row: &'static str, keys: &'static str, hold: Hold) -> Row {
    Row { id, text, row, keys, effect: Effect::Hold(hold), ..ROW }
}

const fn once(
    id: &'static str,
    text: &'static str,
    keys: &'static str,
    effect: fn(&mut FlightController, ActionContext),
) -> Row {
    Row { id, text, row: text, keys, effect: Effect::Once(effect), ..ROW }
}

/// Every action except those of guides and overlays, in the order of the help. Keys are separated by spaces.
const TABLE: &[Row] = &[
    Row { possible: has_flight, ..once("pause", "pause, resume", "Space", FlightController::switch_pause) },
    hold("forward", "fly forward", "fly forward, back", "W Up", Hold::Forward),
    hold("back", "fly back", "fly forward, back", "S Down", Hold::Back),
    hold("left", "fly left", "fly left, right", "A", Hold::Left),
    hold("right", "fly right", "fly left, right", "D", Hold::Right),
    hold("up", "fly up", "fly up, down", "PageUp", Hold::Up),
    hold("down", "fly down", "fly up, down", "PageDown", Hold::Down),
    hold("turn-left", "look left", "look around", "Left", Hold::TurnLeft),
    hold("turn-right", "look right", "look around", "Right", Hold::TurnRight),
    hold("turn-up", "look up", "look around", "Home", Hold::TurnUp),
    hold("turn-down", "look down", "look around", "End", Hold::TurnDown),
    Row { id: "look", row: "look around", gesture: "drag", ..ROW },
    Row { shifted: "< ;", ..hold("roll-left", "roll counter-clockwise", "roll the view", ",", Hold::RollLeft) },
    Row { shifted: "> :", ..hold("roll-right", "roll clockwise", "roll the view", ".", Hold::RollRight) },
    Row { id: "roll", row: "roll the view", gesture: "right drag, Shift+drag", ..ROW },
    Row {
        row: "view angle: narrower, wider",
        shifted: "{ Ctrl+=",
        gesture: "Ctrl+wheel",
        repeats: true,
        possible: has_flight,
        ..once("narrower", "narrower view angle", "[ Ctrl++", |c, _| c.zoom(1.0))
    },
    Row {
        row: "view angle: narrower, wider",
        shifted: "} Ctrl+_",
        repeats: true,
        possible: has_flight,
        ..once("wider", "wider view angle", "] Ctrl+-", |c, _| c.zoom(-1.0))
    },
    Row {
        possible: has_flight,
        ..once("usual-angle", "reset the view angle", "0 Ctrl+0", FlightController::usual_angle)
    },
    Row {
        row: "faster, slower",
        shifted: "=",
        gesture: "wheel",
        repeats: true,
        possible: has_flight,
        ..once("faster", "faster", "+", |c, _| c.change_speed_by(1.0))
    },
    Row {
        row: "faster, slower",
        shifted: "_",
        repeats: true,
        possible: has_flight,
        ..once("slower", "slower", "-", |c, _| c.change_speed_by(-1.0))
    },
    Row {
        possible: flies_itself,
        ..once("reverse", "turn round and fly back", "R B Backspace", FlightController::reverse)
    },
    Row { possible: flies_itself, ..once("next", "fly to the next segment", "T", FlightController::next_segment) },
    Row {
        effect: Effect::Window(WindowRequest::Whole),
        possible: flies_itself,
        ..once("whole", "read the whole colon: one flight from the rectum, tag taken out", "Ctrl+I", |_, _| {})
    },
    Row { possible: flies_itself, ..once("other-end", "start from the other end", "E", FlightController::other_end) },
    Row {
        possible: flies_itself,
        ..once("guide", "manual, and back to the guide", "G", FlightController::switch_guide)
    },
    Row {
        id: "seek",
        text: "jump to a place on the path",
        row: "jump to that place on the path",
        gesture: "click on the bar",
        ..ROW
    },
    once("figures", "figures: time of a picture, clearance, detail", "", FlightController::switch_figures),
    Row { possible: has_flight, ..once("detail", "detail: high or low", "I", FlightController::switch_detail) },
    Row { possible: has_flight, ..once("light", "light: endoscope or headlight", "L", FlightController::switch_light) },
    Row { possible: has_both_scans, ..once("tag", "tag: taken out, or as scanned", "X", FlightController::switch_tag) },
    greys("window-colon", "window for the colon", "Ctrl+1", |c, _| c.window(0.0, 2000.0)),
    greys("window-soft", "window for soft tissue", "Ctrl+2", |c, _| c.window(40.0, 400.0)),
    greys("window-bone", "window for bone", "Ctrl+3", |c, _| c.window(300.0, 1500.0)),
    greys("window-lung", "window for lung", "Ctrl+4", |c, _| c.window(-600.0, 1500.0)),
    Row {
        row: SLAB_ROW,
        possible: shows_slices,
        ..once("slab", "slab thickness", "Ctrl+5", FlightController::next_slab)
    },
    Row {
        row: SLAB_ROW,
        possible: shows_slices,
        ..once("slab-kind", "projection of a slab: mean, maximum, minimum", "Ctrl+6", FlightController::next_slab_kind)
    },
    Row { possible: shows_slices, ..once("slices-reset", "slices: reset", "Ctrl+9", FlightController::reset_slices) },
    Row { effect: Effect::Window(WindowRequest::Open), ..once("open", "open another scan", "Ctrl+O", |_, _| {}) },
    once("measure", "measure a distance with two clicks, stop measuring", "M C", FlightController::switch_measuring),
    Row {
        row: STEP_ROW,
        possible: has_list,
        ..once("candidate-next", "next candidate", "Enter", |c, at| c.assist(AssistInput::Step(true), at.now))
    },
    Row {
        row: STEP_ROW,
        possible: has_list,
        ..once("candidate-previous", "previous candidate", "Ctrl+Enter", |c, at| {
            c.assist(AssistInput::Step(false), at.now);
        })
    },
    answer("candidate-yes", "this candidate is a polyp", "Y Ctrl+Y", |c, at| {
        c.assist(AssistInput::Answer(Answer::Yes), at.now);
    }),
    answer("candidate-no", "this candidate is not a polyp", "N Ctrl+N", |c, at| {
        c.assist(AssistInput::Answer(Answer::No), at.now);
    }),
    answer("candidate-unsure", "unsure whether this is a polyp", "U Ctrl+U", |c, at| {
        c.assist(AssistInput::Answer(Answer::Unsure), at.now);
    }),
    Row {
        possible: has_list,
        ..once("candidate-marks", "mark the candidates in all views", "Ctrl+J", |c, at| {
            c.assist(AssistInput::Mark, at.now);
        })
    },
    Row {
        possible: has_list,
        ..once("measure-lesion", "measure a lesion with one click, stop measuring", "Ctrl+M", |c, at| {
            c.assist(AssistInput::Measure, at.now);
        })
    },
    Row {
        effect: Effect::Window(WindowRequest::Kinds),
        ..once("kinds", "kinds of gas in the slices", "Ctrl+K", |_, _| {})
    },
    kind("kind-colon", "this gas is colon", "Ctrl+L", |c, at| c.tell_kind(Some(GasKind::Colon), at.now)),
    kind("kind-small-bowel", "this gas is small bowel", "Ctrl+B", |c, at| {
        c.tell_kind(Some(GasKind::SmallBowel), at.now);
    }),
    kind("kind-stomach", "this gas is stomach", "Ctrl+A", |c, at| c.tell_kind(Some(GasKind::Stomach), at.now)),
    kind("kind-lung", "this gas is lung", "Ctrl+H", |c, at| c.tell_kind(Some(GasKind::Lung), at.now)),
    kind("kind-trachea", "this gas is trachea", "Ctrl+T", |c, at| c.tell_kind(Some(GasKind::Trachea), at.now)),
    kind("kind-unknown", "this gas may be colon", "Ctrl+D", |c, at| c.tell_kind(Some(GasKind::Unknown), at.now)),
    kind("kind-as-judged", "restore the automatic kind of this gas", "Ctrl+G", |c, at| c.tell_kind(None, at.now)),
    Row {
        effect: Effect::Window(WindowRequest::Seen),
        row: SEEN_ROW,
        ..once("unseen", "paint the wall that was not seen", "P Ctrl+E", |_, _| {})
    },
    Row {
        row: SEEN_ROW,
        possible: may_see_missed,
        ..once("missed-next", "fly to the next patch of the wall that was missed", "F Ctrl+F", |c, at| {
            c.next_missed(at.now);
        })
    },
    Row {
        row: SEEN_ROW,
        possible: may_review,
        ..once("review", "review: fly past all that was missed, end that", "V Ctrl+V", |c, at| c.switch_review(at.now))
    },
    once("undo", "undo the last change to distances, answers or kinds", "Ctrl+Z", FlightController::undo),
    once("delete-last", "delete the last distance", "Delete", FlightController::delete_last_measure),
    once("screenshot", "screenshot of all views", "Ctrl+S", FlightController::order_photograph),
    Row {
        possible: has_flight,
        ..once("picture", "picture of the flight alone, and its pose", "F12", FlightController::take_screenshot)
    },
    Row { effect: Effect::Window(WindowRequest::Fullscreen), ..once("fullscreen", "full screen", "F11", |_, _| {}) },
    Row {
        shifted: "?",
        effect: Effect::Window(WindowRequest::Help),
        ..once("help", "list of keys", "H F1", |_, _| {})
    },
    Row {
        effect: Effect::Window(WindowRequest::Cancel),
        ..once("cancel", "cancel, close what covers the window", "Esc", |_, _| {})
    },
    Row { effect: Effect::Window(WindowRequest::Quit), ..once("quit", "quit", "Ctrl+Q", |_, _| {}) },
];

/// Row of the help for the keys of grey-level windows.
const WINDOW_ROW: &str = "window: colon, soft tissue, bone, lung";
/// Row of the help for the wall that was not seen.
const SEEN_ROW: &str = "wall not seen: paint it, next missed patch, review all";
/// Row of the help for the keys of thick slices.
const SLAB_ROW: &str = "slices: slab thickness, projection";

/// Row of the help for the keys of the candidates.
const STEP_ROW: &str = "candidates: next, previous";
/// Row of the help for the keys that give a kind to gas.
const KIND_ROW: &str = "gas: colon, small bowel, stomach, lung, trachea, unknown, automatic";
const ANSWER_ROW: &str = "candidate: yes, no, unsure";

const fn answer(
    id: &'static str,
    text: &'static str,
    keys: &'static str,
    effect: fn(&mut FlightController, ActionContext),
) -> Row {
    Row { row: ANSWER_ROW, possible: has_list, ..once(id, text, keys, effect) }
}

const fn kind(
    id: &'static str,
    text: &'static str,
    keys: &'static str,
    effect: fn(&mut FlightController, ActionContext),
) -> Row {
    Row { row: KIND_ROW, possible: has_body, ..once(id, text, keys, effect) }
}

const fn greys(
    id: &'static str,
    text: &'static str,
    keys: &'static str,
    effect: fn(&mut FlightController, ActionContext),
) -> Row {
    Row { row: WINDOW_ROW, possible: shows_slices, ..once(id, text, keys, effect) }
}

/// The rows of guides and overlays follow this action's row.
const OWN_AFTER: &str = "guide";
/// The rows of layouts and panels follow this action's row.
const LAYOUTS_AFTER: &str = "fullscreen";

/// The row of the help that lists all layouts.
const LAYOUT_ROW: &str = "panels: flight alone, reading, slices, across the path";

/// The entry of a menu that stands for all actions of other crates.
pub(crate) const OWN: &str = "";

/// The menus: actions by their ids. An id that ends in `-` includes all ids with that prefix.
pub(crate) const MENUS: &[(&str, &[&str])] = &[
    ("File", &["open", "screenshot", "picture", "quit"]),
    ("Flight", &["pause", "guide", "guide-", "reverse", "whole", "next", "other-end", "faster", "slower", OWN]),
    (
        "View",
        &[
            "tag",
            "detail",
            "light",
            "narrower",
            "wider",
            "usual-angle",
            "unseen",
            "missed-next",
            "review",
            "overlay-",
            "figures",
            "fullscreen",
        ],
    ),
    ("Slices", &["window-", "slab", "slab-kind", "slices-reset", "kinds", "kind-"]),
    ("Measure", &["measure", "undo", "delete-last", "measure-lesion"]),
    ("Candidates", &["panel-candidates", "candidate-"]),
    ("Panels", &["layout-", "panel-"]),
    ("Help", &["help", "cancel"]),
];

fn chords(keys: &str) -> Vec<Chord> {
    keys.split_whitespace().filter_map(|k| k.parse().ok()).collect()
}

impl From<&Row> for Action {
    fn from(r: &Row) -> Self {
        Self {
            id: r.id.into(),
            text: if r.text.is_empty() { r.row.into() } else { r.text.into() },
            row: r.row.into(),
            keys: chords(r.keys),
            shown: Vec::new(),
            shifted: chords(r.shifted),
            gesture: r.gesture,
            repeats: r.repeats,
            possible: r.possible,
            effect: r.effect,
            own: OwnState::default(),
        }
    }
}

impl Action {
    /// True if it can be performed by its id, without a key that is held or a gesture.
    pub(crate) fn is_performed(&self) -> bool {
        !matches!(self.effect, Effect::Hold(_) | Effect::Gesture)
    }

    /// Returns its first key, for a menu.
    pub(crate) fn key_text(&self) -> String {
        self.shown.first().cloned().unwrap_or_default()
    }

    /// Returns its description, for a menu or a button.
    pub(crate) fn title(&self) -> String {
        let mut letters = self.text.chars();
        letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
    }

    /// Names the owner of the action, for messages.
    fn owner(&self) -> String {
        match self.effect {
            Effect::HandTo(guide) => format!("guide {guide}"),
            Effect::Overlay(_) | Effect::Window(WindowRequest::Panel(_)) => self.id.replacen('-', " ", 1),
            Effect::Own(_) => format!("action {}", self.id),
            _ => format!("the window's {}", self.id),
        }
    }
}

/// A row of the list of keys.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct HelpRow {
    /// The keys and gestures; empty if it has none.
    pub keys: String,
    /// What they do.
    pub text: String,
    /// The action's id, if it can be performed by a click.
    pub id: Option<String>,
}

/// Rows of the list of keys that belong together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Group {
    /// Its title.
    pub title: String,
    /// Its rows.
    pub rows: Vec<HelpRow>,
}

/// All actions of a window.
#[derive(Clone, Debug)]
pub(crate) struct Actions(Vec<Action>);

impl Actions {
    /// Creates the actions of a window without those of other crates.
    #[cfg(test)]
    pub(crate) fn new(
        guides: &Guides,
        overlays: &[Overlay],
        panels: &[PanelEntry],
        settings: &KeySettings,
    ) -> Result<Self> {
        Self::of(guides, overlays, panels, &[], settings)
    }

    /// Creates the actions of the window, of `guides`, `overlays` and `panels`, and those of other crates, `more`. Keys in
    /// `settings` replace the default ones.
    ///
    /// # Errors
    /// Returns status 2 if two actions have the same key or name, or if a setting refers to an unknown action or key.
    pub(crate) fn of(
        guides: &Guides,
        overlays: &[Overlay],
        panels: &[PanelEntry],
        more: &[ActionEntry],
        settings: &KeySettings,
    ) -> Result<Self> {
        let own = |id: String, text: String, row: String, key: Option<char>, effect: Effect| Action {
            id: id.into(),
            text: text.into(),
            row: row.into(),
            keys: key.into_iter().map(Chord::character).collect(),
            effect,
            ..Action::from(&ROW)
        };
        let window = |n: usize| Effect::Window(WindowRequest::Layout(n));
        let names: Vec<&str> = guides.iter().filter(|g| g.key.is_some()).map(|g| g.name).collect();
        let mut all = Vec::new();
        for row in TABLE {
            all.push(Action::from(row));
            if row.id == OWN_AFTER {
                all.extend(guides.iter().map(|g| {
                    let text = format!("switch to guide {}", g.name);
                    own(format!("guide-{}", g.name), text, names.join(", "), g.key, Effect::HandTo(g.name))
                }));
                all.extend(overlays.iter().enumerate().map(|(n, o)| {
                    let text = o.summary.to_owned();
                    own(format!("overlay-{}", o.name), text.clone(), text, o.key, Effect::Overlay(n))
                }));
            }
            if row.id == LAYOUTS_AFTER {
                all.extend(LAYOUTS.iter().enumerate().map(|(n, l)| Action {
                    keys: chords(l.key),
                    ..own(format!("layout-{}", l.name), l.text.to_owned(), LAYOUT_ROW.to_owned(), None, window(n))
                }));
                all.extend(panels.iter().enumerate().map(|(n, p)| {
                    let (text, effect) = (format!("panel: {}", p.title), Effect::Window(WindowRequest::Panel(n)));
                    own(format!("panel-{}", p.name), text.clone(), text, p.key, effect)
                }));
                all.extend(more.iter().map(|a| {
                    let text = if a.text.is_empty() { a.id } else { a.text };
                    let effect = Effect::Own(*a);
                    Action {
                        repeats: a.repeats,
                        ..own(a.id.to_owned(), text.to_owned(), text.to_owned(), a.key, effect)
                    }
                }));
            }
        }
        for (id, keys) in settings {
            let action = all.iter_mut().find(|a| a.id == *id);
            let Some(action) = action.filter(|a| !matches!(a.effect, Effect::Gesture)) else {
                let why = format!("there is no action {id:?}");
                let hint = format!("{} explain lists them under \"actions of the window\"", program_name());
                return Err(Error::usage("keys: action", why, hint));
            };
            action.keys = keys.iter().map(|k| k.parse()).collect::<Result<_>>()?;
            action.shifted.clear();
        }
        let actions = Self(all);
        actions.check()?;
        Ok(actions.on(&Printed::default()))
    }

    /// Returns the same actions with their keys named as a keyboard prints them. Where that is the key of another action, which
    /// comes first, the name stays: `Ctrl+6` on a French keyboard, whose key prints a hyphen and, with Shift, a 6.
    pub(crate) fn on(&self, keyboard: &Printed) -> Self {
        let taken: Vec<String> =
            self.0.iter().flat_map(|a| a.keys.iter().chain(&a.shifted)).map(ToString::to_string).collect();
        let name = |key: &Chord| Some(keyboard.name(key)).filter(|n| !taken.contains(n)).unwrap_or(key.to_string());
        let named = |a: &Action| Action { shown: a.keys.iter().map(name).collect(), ..a.clone() };
        Self(self.0.iter().map(named).collect())
    }

    /// Checks that each key has one action.
    ///
    /// # Errors
    /// Returns status 2 for the first key that two actions share.
    fn check(&self) -> Result<()> {
        let owned: Vec<(&Chord, &Action)> =
            self.0.iter().flat_map(|a| a.keys.iter().chain(&a.shifted).map(move |k| (k, a))).collect();
        for (n, action) in self.0.iter().enumerate() {
            if action.id.is_empty() {
                return Err(Error::usage("action", "has no id", "give it one"));
            }
            match self.0[..n].iter().find(|a| a.id == action.id).map(Action::owner) {
                Some(owner) if owner == action.owner() => {
                    return Err(Error::usage(owner, "is there twice", "give one another name"));
                }
                Some(owner) => {
                    let what = format!("action {:?}", action.id);
                    return Err(taken(&what, &owner, &action.owner(), "id"));
                }
                None => {}
            }
        }
        for (n, (key, action)) in owned.iter().enumerate() {
            if let Some((_, other)) = owned[..n].iter().find(|o| o.0 == *key) {
                let why = format!("is used twice: by {} and by {}", other.owner(), action.owner());
                return Err(Error::usage(format!("key {key}"), why, "give one another key"));
            }
        }
        Ok(())
    }

    /// Returns the action of a key.
    pub(crate) fn of_key(&self, key: &Chord) -> Option<&Action> {
        self.0.iter().find(|a| a.keys.contains(key) || a.shifted.contains(key))
    }

    /// Returns the actions of a menu entry.
    pub(crate) fn of_menu<'a>(&'a self, entry: &'a str) -> impl Iterator<Item = &'a Action> {
        self.0.iter().filter(move |a| match a.effect {
            Effect::Own(_) => entry == OWN,
            _ if entry.ends_with('-') => a.id.starts_with(entry),
            _ => a.id == entry,
        })
    }

    /// Returns the action with that name.
    pub(crate) fn named(&self, id: &str) -> Option<&Action> {
        self.0.iter().find(|a| a.id == id)
    }

    /// Returns the first key of the action with that name; empty if it has none. Messages name keys with this or [`Actions::hint`],
    /// because a settings file may have changed them.
    pub(crate) fn key(&self, id: &str) -> String {
        self.named(id).map_or_else(String::new, Action::key_text)
    }

    /// Returns the end of a message that names an action's key, ` (N flies to the next)`; empty if the action has none.
    pub(crate) fn hint(&self, id: &str, what: &str) -> String {
        let key = self.key(id);
        if key.is_empty() { key } else { format!(" ({key} {what})") }
    }

    /// Returns the key that quits; empty if there is none.
    pub(crate) fn quit_key(&self) -> String {
        self.key("quit")
    }

    /// Returns the most needed keys in one line.
    pub(crate) fn short_help(&self) -> String {
        let part = |ids: &[&str], what: &str| {
            let keys: Vec<String> = ids.iter().map(|id| self.key(id)).filter(|k| !k.is_empty()).collect();
            (!keys.is_empty()).then(|| format!("{} {what}", keys.join(" ")))
        };
        let parts = [
            part(&["help"], "keys"),
            part(&["pause"], "pause"),
            part(&["forward", "left", "back", "right"], "steer"),
            Some("drag to look".to_owned()),
            part(&["reverse"], "turn round"),
        ];
        parts.into_iter().flatten().collect::<Vec<_>>().join("   ")
    }

    /// Returns everything that the operator can do, in groups: the keys that steer, then as in the menus. Every action is there once.
    pub(crate) fn groups(&self) -> Vec<Group> {
        let steers = |a: &Action| matches!(a.effect, Effect::Hold(_) | Effect::Gesture);
        let mut steer: Vec<HelpRow> = Vec::new();
        for (keys, text) in self.rows_of(steers) {
            steer.push(HelpRow { keys, text, id: None });
        }
        let mut groups = vec![Group { title: "Steer".to_owned(), rows: steer }];
        let row = |a: &Action| {
            let keys = a.shown.iter().cloned().chain(Some(a.gesture.to_owned()).filter(|g| !g.is_empty()));
            HelpRow { keys: keys.collect::<Vec<_>>().join(", "), text: a.text.to_string(), id: Some(a.id.to_string()) }
        };
        let mut listed: Vec<&str> = Vec::new();
        for (title, entries) in MENUS {
            let mut rows = Vec::new();
            for action in entries.iter().flat_map(|e| self.of_menu(e)).filter(|a| !steers(a)) {
                if !listed.contains(&action.id.as_ref()) {
                    listed.push(&action.id);
                    rows.push(row(action));
                }
            }
            groups.push(Group { title: (*title).to_owned(), rows });
        }
        let rest: Vec<HelpRow> =
            self.0.iter().filter(|a| !steers(a) && !listed.contains(&a.id.as_ref())).map(row).collect();
        groups.push(Group { title: "More".to_owned(), rows: rest });
        groups.retain(|g| !g.rows.is_empty());
        groups
    }

    /// Returns id, keys and text of every action that can have a key, in the order of the help.
    pub(crate) fn list(&self) -> Vec<[String; 3]> {
        let keyed = self.0.iter().filter(|a| !matches!(a.effect, Effect::Gesture));
        let keys = |a: &Action| a.keys.iter().map(Chord::to_string).collect::<Vec<_>>().join(", ");
        keyed.map(|a| [a.id.to_string(), keys(a), a.text.to_string()]).collect()
    }

    /// Returns all keys with their descriptions, a row for each task, in the order of the table.
    pub(crate) fn help(&self) -> Vec<(String, String)> {
        self.rows_of(|_| true)
    }

    /// Returns the keys of some actions with their descriptions, a row for each task.
    fn rows_of(&self, wanted: impl Fn(&Action) -> bool) -> Vec<(String, String)> {
        let mut rows: Vec<(&str, Vec<&Action>)> = Vec::new();
        for action in self.0.iter().filter(|a| wanted(a)) {
            match rows.iter_mut().find(|r| r.0 == action.row) {
                Some((_, all)) => all.push(action),
                None => rows.push((&action.row, vec![action])),
            }
        }
        let keys = |all: &[&Action]| {
            // Opposite keys side by side: "W S, Up Down".
            let most = all.iter().map(|a| a.keys.len()).max().unwrap_or(0);
            let of = |n: usize| all.iter().filter_map(|a| a.shown.get(n)).cloned().collect::<Vec<_>>().join(" ");
            let gestures = all.iter().map(|a| a.gesture.to_owned()).filter(|g| !g.is_empty());
            (0..most).map(of).chain(gestures).collect::<Vec<_>>().join(", ")
        };
        rows.iter()
            .map(|(what, all)| (keys(all), (*what).to_owned()))
            .filter(|(keys, what)| !keys.is_empty() && !what.is_empty())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::window::panels;
    use crate::systems::guides;

    fn actions(settings: &[(&str, &[&str])]) -> Result<Actions> {
        let settings =
            settings.iter().map(|(id, keys)| ((*id).to_owned(), keys.iter().map(|k| (*k).to_owned()).collect()));
        Actions::new(&guides(), &crate::app::Catalog::default().overlays, panels::BUILT_IN, &settings.collect())
    }

    #[test]
    fn every_text_of_the_table_is_read() {
        for row in TABLE {
            assert_eq!(chords(row.keys).len(), row.keys.split_whitespace().count(), "{}", row.id);
            assert_eq!(chords(row.shifted).len(), row.shifted.split_whitespace().count(), "{}", row.id);
            assert_eq!(TABLE.iter().filter(|r| r.id == row.id).count(), 1, "{}", row.id);
        }
    }

    #[test]
    fn every_entry_of_the_menus_is_an_action() {
        let all = actions(&[]).unwrap();
        for entry in MENUS.iter().flat_map(|m| m.1) {
            assert!(all.of_menu(entry).count() > 0 || *entry == OWN, "{entry}");
        }
        assert_eq!(all.named("pause").unwrap().title(), "Pause, resume");
    }

    #[test]
    fn no_two_actions_name_one_key_on_a_french_keyboard() {
        use super::super::stroke::US;
        const PLAIN: &str = "²&é\"'(-è_çà)=azertyuiop^$*qsdfghjklmùwxcvbn,;:!";
        const SHIFTED: &str = " 1234567890°+AZERTYUIOP¨£µQSDFGHJKLM%WXCVBN?./§";
        let keys = US.iter().zip(PLAIN.chars().zip(SHIFTED.chars()));
        let mut french = Printed::default();
        french.tell(keys.map(|(us, (plain, shifted))| (us.0, [Some(plain), Some(shifted)])).collect());
        let all = actions(&[]).unwrap().on(&french);
        let names: Vec<&String> = all.0.iter().flat_map(|a| &a.shown).collect();
        let twice: Vec<&&String> = names.iter().filter(|n| names.iter().filter(|m| m == n).count() > 1).collect();
        assert!(twice.is_empty(), "{twice:?}");
        // Its key prints a hyphen, which has an action of its own, and a 6 with Shift.
        assert_eq!((all.key("slab-kind"), all.key("guide-path")), ("Ctrl+6".to_owned(), "\"".to_owned()));
    }

    #[test]
    fn keys_are_found_and_listed() {
        let all = actions(&[]).unwrap();
        let id = |key: &str| all.of_key(&key.parse().unwrap()).map(|a| a.id.as_ref());
        assert_eq!(
            (id("w"), id("Esc"), id("<"), id("3")),
            (Some("forward"), Some("cancel"), Some("roll-left"), Some("guide-path"))
        );
        assert_eq!(
            (id("Ctrl+0"), id("0"), id("Ctrl+C"), id("ß")),
            (Some("usual-angle"), Some("usual-angle"), None, None)
        );
        assert_eq!((id("Ctrl+K"), id("Ctrl+B")), (Some("kinds"), Some("kind-small-bowel")));
        let help = all.help();
        let keys = |what: &str| help.iter().find(|r| r.1 == what).unwrap().0.as_str();
        assert_eq!(keys("fly forward, back"), "W S, Up Down");
        assert_eq!(keys("turn round and fly back"), "R, B, Backspace");
        assert_eq!(keys("tentacles, potential, path, manual"), "1 2 3 4");
        assert_eq!(keys("look around"), "Left Right Home End, drag");
    }

    #[test]
    fn every_action_that_can_have_a_key_is_listed_with_its_id() {
        let all = actions(&[("reverse", &["Z", "Ctrl+R"]), ("left", &[])]).unwrap();
        let list = all.list();
        let row = |id: &str| list.iter().find(|r| r[0] == id).map(|r| [r[1].as_str(), r[2].as_str()]);
        assert_eq!(row("reverse"), Some(["Z, Ctrl+R", "turn round and fly back"]));
        assert_eq!((row("left"), row("seek")), (Some(["", "fly left"]), None));
        for [id, ..] in &list {
            assert!(actions(&[(id, &["Ö"])]).is_ok(), "{id} can be set");
            assert!(!id.contains(char::is_whitespace), "{id}");
        }
        assert!(!all.named("left").unwrap().is_performed() && all.named("pause").unwrap().is_performed());
    }

    #[test]
    fn messages_name_the_keys_of_the_settings() {
        let usual = actions(&[]).unwrap();
        assert_eq!(usual.short_help(), "H keys   Space pause   W A S D steer   drag to look   R turn round");
        assert_eq!(usual.hint("next", "flies to the next"), " (T flies to the next)");
        assert_eq!((usual.key("undo").as_str(), usual.quit_key().as_str()), ("Ctrl+Z", "Ctrl+Q"));
        let changed = [("help", &["Ü"][..]), ("left", &["Ö"]), ("reverse", &[]), ("next", &[]), ("quit", &["Ä"])];
        let changed = actions(&changed).unwrap();
        assert_eq!(changed.short_help(), "Ü keys   Space pause   W Ö S D steer   drag to look");
        assert_eq!((changed.hint("next", "flies to the next"), changed.quit_key()), (String::new(), "Ä".to_owned()));
    }

    /// Returns the texts of a source file between quotes, without its tests.
    fn texts(source: &str) -> Vec<String> {
        let is_code = |l: &&str| !l.trim_start().starts_with("//");
        let code: Vec<&str> = source.split("#[cfg(test)]").next().unwrap_or("").lines().filter(is_code).collect();
        code.join("\n").replace("\\\"", "").split('"').skip(1).step_by(2).map(str::to_owned).collect()
    }

    #[test]
    fn no_text_of_the_window_names_a_key_that_settings_may_change() {
        let all = actions(&[]).unwrap();
        let is_key = |word: &str| {
            let word = word.trim_matches(|c: char| "(),;.:".contains(c));
            // A and digits are words, too.
            let is_word = word == "A" || word.chars().all(|c| c.is_ascii_digit());
            let is_told = word.len() == 1 || word.starts_with("Ctrl+") || ["Space", "Esc", "F12"].contains(&word);
            let is_upper = word.chars().next().is_some_and(char::is_uppercase);
            !is_word && is_told && is_upper && word.parse().is_ok_and(|key| all.of_key(&key).is_some())
        };
        assert!(["(T", "Ctrl+Z", "Esc"].map(is_key) == [true; 3] && ["t", "Next", "3"].map(is_key) == [false; 3]);
        let window = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("window");
        let (mut folders, mut files) = (vec![window], 0);
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(&folder).unwrap() {
                let path = entry.unwrap().path();
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                if path.is_dir() {
                    folders.push(path);
                // The tables of keys themselves, and another window, whose keys no settings change.
                } else if !name.contains("tests") && !["actions.rs", "keys.rs", "plane.rs"].contains(&&*name) {
                    files += 1;
                    // W and L of a slice are its window and level.
                    let is_told = |t: &&String| t.contains(' ') && !t.starts_with("W {");
                    for text in texts(&std::fs::read_to_string(&path).unwrap()).iter().filter(is_told) {
                        let key = text.split_whitespace().find(|w| is_key(w));
                        assert_eq!(key, None, "{}: {text:?}", path.display());
                    }
                }
            }
        }
        assert!(files > 40, "{files}");
    }

    #[test]
    fn the_groups_of_the_list_hold_every_action_once() {
        let all = actions(&[]).unwrap();
        let groups = all.groups();
        let ids: Vec<&str> = groups.iter().flat_map(|g| &g.rows).filter_map(|r| r.id.as_deref()).collect();
        let expected = all.0.iter().filter(|a| !matches!(a.effect, Effect::Hold(_) | Effect::Gesture));
        let mut expected: Vec<&str> = expected.map(|a| a.id.as_ref()).collect();
        let mut found = ids.clone();
        expected.sort_unstable();
        found.sort_unstable();
        assert_eq!(found, expected);
        assert_eq!(groups[0].title, "Steer");
        assert!(groups[0].rows.iter().any(|r| r.keys == "W S, Up Down" && r.text == "fly forward, back"));
        assert!(groups.iter().all(|g| g.title != "More"), "{:?}", groups.last());
        let yes = groups.iter().flat_map(|g| &g.rows).find(|r| r.id.as_deref() == Some("candidate-yes")).unwrap();
        assert_eq!((yes.keys.as_str(), yes.text.as_str()), ("Y, Ctrl+Y", "this candidate is a polyp"));
    }

    #[test]
    fn settings_change_keys_and_collisions_are_refused() {
        let all = actions(&[("reverse", &["Z", "Ctrl+W"]), ("left", &[])]).unwrap();
        let id = |key: &str| all.of_key(&key.parse().unwrap()).map(|a| a.id.as_ref());
        assert_eq!((id("z"), id("Ctrl+W"), id("R"), id("A")), (Some("reverse"), Some("reverse"), None, None));
        for (bad, word) in [
            (("reverse", &["W"][..]), "forward"),
            (("reverse", &["Z", "Z"][..]), "reverse"),
            (("warp", &["Z"][..]), "warp"),
            (("seek", &["Z"][..]), "seek"),
            (("reverse", &["Hyper"][..]), "Hyper"),
        ] {
            let e = actions(&[bad]).unwrap_err();
            assert!(e.to_string().contains(word), "{e}");
        }
    }
}
