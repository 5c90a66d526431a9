//! Actions: what the operator wants by name, with its keys.

use std::borrow::Cow;

use super::intent::Intent;
use super::keys::Chord;
use super::printed::Printed;

/// An action of the operator.
#[derive(Clone, Debug)]
pub(crate) struct Action {
    /// Its name in the settings file.
    pub id: Cow<'static, str>,
    /// Short description, for a button's tooltip.
    pub text: Cow<'static, str>,
    /// Its row in the help, shared with other actions.
    pub row: Cow<'static, str>,
    /// Its keys.
    pub keys: Vec<Chord>,
    /// The names of these keys on the reader's keyboard.
    pub shown: Vec<String>,
    /// The same keys with Shift: a key pressed as `,` may be released as `<`.
    pub shifted: Vec<Chord>,
    /// The mouse gesture for it.
    pub gesture: &'static str,
    /// True if it repeats while its key is held.
    pub repeats: bool,
    /// What it is for.
    pub intent: Intent,
}

impl Action {
    /// True if it can be performed by its id, without a key that is held or a gesture.
    pub(crate) fn is_performed(&self) -> bool {
        !matches!(self.intent, Intent::Hold(_) | Intent::Gesture)
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
}

/// The entry of a menu that stands for all actions of other crates.
pub(crate) const OWN: &str = "";

/// The menus: actions by their ids. An id that ends in `-` includes all ids with that prefix.
pub(crate) const MENUS: &[(&str, &[&str])] = &[
    ("File", &["open", "position", "same-place", "link", "screenshot", "picture", "quit"]),
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
            "wide-view",
            "unseen",
            "missed-next",
            "review",
            "overlay-",
            "figures",
            "fullscreen",
        ],
    ),
    ("Slices", &["window-", "slab", "slab-kind", "slices-reset", "kinds", "kind-"]),
    (
        "Findings",
        &[
            "finding",
            "finding-outside",
            "finding-measured",
            "finding-correct",
            "finding-same",
            "finding-apart",
            "finding-delete",
            "panel-findings",
            "report",
            "report-send",
            "undo",
            "measure",
            "delete-last",
            "measure-lesion",
        ],
    ),
    ("Candidates", &["panel-candidates", "candidate-"]),
    ("Panels", &["layout-", "panel-"]),
    ("Help", &["help", "cancel"]),
];

/// All actions of a window.
#[derive(Clone, Debug)]
pub(crate) struct Actions(pub(super) Vec<Action>);

impl Actions {
    /// Returns the same actions with their keys named as a keyboard prints them. Where that is the key of another action, which
    /// comes first, the name stays: `Ctrl+6` on a French keyboard, whose key prints a hyphen and, with Shift, a 6.
    pub(crate) fn on(&self, keyboard: &Printed) -> Self {
        let taken: Vec<String> =
            self.0.iter().flat_map(|a| a.keys.iter().chain(&a.shifted)).map(ToString::to_string).collect();
        let name = |key: &Chord| Some(keyboard.name(key)).filter(|n| !taken.contains(n)).unwrap_or(key.to_string());
        let named = |a: &Action| Action { shown: a.keys.iter().map(name).collect(), ..a.clone() };
        Self(self.0.iter().map(named).collect())
    }

    /// Returns the action of a key.
    pub(crate) fn of_key(&self, key: &Chord) -> Option<&Action> {
        self.0.iter().find(|a| a.keys.contains(key) || a.shifted.contains(key))
    }

    /// Returns the actions of a menu entry.
    pub(crate) fn of_menu<'a>(&'a self, entry: &'a str) -> impl Iterator<Item = &'a Action> {
        self.0.iter().filter(move |a| match a.intent {
            Intent::Own(_) => entry == OWN,
            _ if entry.ends_with('-') => a.id.starts_with(entry),
            _ => a.id == entry,
        })
    }

    /// Returns the action with that name.
    pub(crate) fn named(&self, id: &str) -> Option<&Action> {
        self.0.iter().find(|a| a.id == id)
    }

    /// Returns the action for an intent.
    pub(crate) fn that_wants(&self, intent: &Intent) -> Option<&Action> {
        self.0.iter().find(|a| a.intent == *intent)
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
            part(&["finding"], "finding"),
            part(&["forward", "left", "back", "right"], "steer"),
            Some("drag to look".to_owned()),
            part(&["reverse"], "turn round"),
        ];
        parts.into_iter().flatten().collect::<Vec<_>>().join("   ")
    }
}
