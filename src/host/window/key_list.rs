//! Lists of all actions and their keys: in groups, by their ids, and as a help.

use super::action::{Action, Actions, MENUS};
use super::intent::Intent;
use super::keys::Chord;

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

/// The title of the group that comes first.
const FIRST: &str = "Findings";

impl Actions {
    /// Returns everything that the operator can do, in groups: findings, the keys that steer, then as in the menus. Every action is there once.
    pub(crate) fn groups(&self) -> Vec<Group> {
        let steers = |a: &Action| matches!(a.intent, Intent::Hold(_) | Intent::Gesture);
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
        // What a reading is for.
        groups.sort_by_key(|g| g.title != FIRST);
        groups
    }

    /// Returns id, keys and text of every action that can have a key, in the order of the help.
    pub(crate) fn list(&self) -> Vec<[String; 3]> {
        let keyed = self.0.iter().filter(|a| !matches!(a.intent, Intent::Gesture));
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
