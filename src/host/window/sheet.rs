//! Sheets over the whole window: the list of keys, and the question before the program is quit.

use egui::style::ScrollStyle;
use egui::{Align, Key, Modal, RichText, ScrollArea, TextEdit, Ui, vec2};

use super::Asked;
use super::contract::{Context, Requests};
use super::key_list::Group;
use super::keys::Chord;
use super::style::{SOFT, Severity};

/// Least width of a column of keys, points.
const COLUMN: f32 = 380.0;
/// Width of the keys in a column, points.
const KEYS: f32 = 170.0;
/// Share of the window's width and height that the list of keys may take.
const SHARE: f32 = 0.92;

/// The keys that press the welcome's button.
const BEGIN: [&str; 2] = ["Enter", "Space"];

/// What covers the window until it is closed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Sheet {
    /// The keys, of those actions that contain a text.
    Keys {
        /// What is searched for.
        search: String,
        /// True once the search has the keyboard.
        is_open: bool,
    },
    /// What one sees, and the keys to begin with, the first time that a window is open.
    Welcome,
    /// Asks before another scan is opened, since what was made is lost with this one.
    Open {
        /// What is to be opened.
        asked: Asked,
    },
    /// Asks before the program is quit, since something is unfinished.
    Quit {
        /// What is.
        why: String,
        /// True if answers, distances and the place are stored for the next time.
        keeps: bool,
    },
}

/// What becomes of a sheet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// It stays.
    Stay,
    /// It is closed.
    Close,
    /// Another scan is opened.
    Open(Asked),
    /// The program is quit.
    Quit,
}

impl Sheet {
    /// The list of keys.
    pub(crate) fn keys() -> Self {
        Self::Keys { search: String::new(), is_open: false }
    }

    /// True if a key does nothing but close the sheet.
    pub(crate) fn is_closed_by(&self, key: &Chord) -> bool {
        *self == Self::Welcome && BEGIN.iter().any(|k| k.parse().is_ok_and(|k: Chord| k == *key))
    }

    /// Lays the sheet out over everything else.
    pub(crate) fn ui(&mut self, context: &Context<'_>, ui: &Ui, requests: &mut Requests) -> Answer {
        match self {
            Self::Keys { search, is_open } => keys(context, ui, requests, search, is_open),
            Self::Welcome => welcome(context, ui),
            Self::Open { asked } => open(ui, asked),
            Self::Quit { why, keeps } => quit(ui, why, *keeps),
        }
    }
}

fn keys(context: &Context<'_>, ui: &Ui, requests: &mut Requests, search: &mut String, is_open: &mut bool) -> Answer {
    let area = ui.ctx().content_rect().size() * SHARE - vec2(24.0, 24.0);
    let mut answer = Answer::Stay;
    let modal = Modal::new(egui::Id::new("keys")).show(ui.ctx(), |ui| {
        ui.set_width(area.x.max(120.0));
        ui.horizontal(|ui| {
            ui.heading("Keys");
            let width = (ui.available_width() - 90.0).clamp(60.0, 280.0);
            let field = ui.add(TextEdit::singleline(search).hint_text("search").desired_width(width));
            if !std::mem::replace(is_open, true) {
                field.request_focus();
            }
            ui.with_layout(egui::Layout::right_to_left(Align::Center), |ui| {
                if ui.button("Close").clicked() {
                    answer = Answer::Close;
                }
            });
        });
        ui.separator();
        let groups = found(context.actions.groups(), search);
        if groups.is_empty() {
            ui.label(format!("no action is called {search:?}"));
        }
        ui.spacing_mut().scroll = ScrollStyle::solid();
        ScrollArea::vertical()
            .max_height(area.y - 44.0)
            .min_scrolled_height(area.y - 44.0)
            .auto_shrink([false, true])
            .show(ui, |ui| {
                let columns = ((ui.available_width() / COLUMN) as usize).clamp(1, 4);
                let shares = share_out(&groups, columns);
                ui.columns(columns, |columns| {
                    for (ui, share) in columns.iter_mut().zip(shares) {
                        for group in share {
                            if list(context, ui, requests, group) {
                                answer = Answer::Close;
                            }
                        }
                    }
                });
            });
    });
    if modal.should_close() { Answer::Close } else { answer }
}

/// Lists a group of keys. Returns true if an action was clicked.
fn list(context: &Context<'_>, ui: &mut Ui, requests: &mut Requests, group: &Group) -> bool {
    let mut is_chosen = false;
    ui.add_space(4.0);
    ui.label(RichText::new(&group.title).strong());
    for row in &group.rows {
        ui.horizontal(|ui| {
            let keys = RichText::new(&row.keys).color(Severity::Notice.colour());
            ui.allocate_ui_with_layout(vec2(KEYS, 18.0), egui::Layout::left_to_right(Align::Center), |ui| {
                ui.set_min_width(KEYS);
                ui.add(egui::Label::new(keys).truncate()).on_hover_text(&row.keys);
            });
            let action = row.id.as_deref().and_then(|id| context.actions.named(id));
            let Some(action) = action else {
                ui.label(&row.text);
                return;
            };
            let why_not = context.why_not(action);
            let button = ui.add_enabled(why_not.is_none(), egui::Button::new(&row.text).frame(false).wrap());
            if button.on_disabled_hover_text(why_not.unwrap_or_default()).clicked() {
                requests.action(&action.id);
                is_chosen = true;
            }
        });
    }
    is_chosen
}

/// The rows of groups that contain each word of a search, in their text, their keys or their title.
fn found(groups: Vec<Group>, search: &str) -> Vec<Group> {
    let words: Vec<String> = search.split_whitespace().map(str::to_lowercase).collect();
    let keep = |group: Group| {
        let title = group.title.to_lowercase();
        let rows = group.rows.into_iter().filter(|row| {
            let text = format!("{title} {} {}", row.text.to_lowercase(), row.keys.to_lowercase());
            words.iter().all(|w| text.contains(w.as_str()))
        });
        Group { rows: rows.collect(), title: group.title }
    };
    groups.into_iter().map(keep).filter(|g| !g.rows.is_empty()).collect()
}

/// Shares groups out among columns, in their order, so that the columns are about as long as each other.
fn share_out(groups: &[Group], columns: usize) -> Vec<&[Group]> {
    let length = |g: &Group| g.rows.len() + 2;
    let total: usize = groups.iter().map(length).sum();
    let mut shares = Vec::new();
    let (mut from, mut done) = (0, 0);
    for column in 1..=columns {
        let mut to = from;
        while to < groups.len() && (column == columns || done + length(&groups[to]) / 2 < total * column / columns) {
            done += length(&groups[to]);
            to += 1;
        }
        shares.push(&groups[from..to]);
        from = to;
    }
    shares
}

fn welcome(context: &Context<'_>, ui: &Ui) -> Answer {
    let mut answer = Answer::Stay;
    let key = |id: &str| context.actions.key(id);
    let modal = Modal::new(egui::Id::new("welcome")).show(ui.ctx(), |ui| {
        ui.set_width(400.0);
        ui.heading("Inside a colon");
        ui.label(
            "You look along the inside of a colon, as its CT scan shows it. The flight goes by itself, and you may steer at any time. \
             The slices beside it show where you are.",
        );
        ui.add_space(6.0);
        for (id, what) in [("pause", "stops, and flies on"), ("reverse", "turns round"), ("help", "lists all keys")] {
            ui.horizontal(|ui| {
                ui.label(RichText::new(key(id)).color(Severity::Notice.colour()).strong());
                ui.label(what);
            });
        }
        ui.label("Drag to look around.");
        ui.add_space(8.0);
        let enter = ui.input(|i| i.key_pressed(Key::Enter) || i.key_pressed(Key::Space));
        if ui.button("Begin").clicked() || enter {
            answer = Answer::Close;
        }
    });
    if modal.should_close() { Answer::Close } else { answer }
}

fn open(ui: &Ui, asked: &Asked) -> Answer {
    let mut answer = Answer::Stay;
    let modal = Modal::new(egui::Id::new("open")).show(ui.ctx(), |ui| {
        ui.set_width(320.0);
        ui.heading("Open it?");
        ui.label("What you made here is not kept, and is lost when another scan is opened.");
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            if ui.button("Go on here").clicked() {
                answer = Answer::Close;
            }
            if ui.button("Open").clicked() || ui.input(|i| i.key_pressed(Key::Enter)) {
                answer = Answer::Open(asked.clone());
            }
        });
    });
    if modal.should_close() { Answer::Close } else { answer }
}

fn quit(ui: &Ui, why: &str, keeps: bool) -> Answer {
    let mut answer = Answer::Stay;
    let modal = Modal::new(egui::Id::new("quit")).show(ui.ctx(), |ui| {
        ui.set_width(320.0);
        ui.heading("Quit?");
        ui.label(why);
        match keeps {
            true => ui.label(RichText::new("Findings, answers, distances and the place are kept.").color(SOFT)),
            false => {
                let told = "Findings, answers, distances and kinds that you made here are lost.";
                ui.label(RichText::new(told).color(Severity::Notice.colour()))
            }
        };
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let go_on = ui.button("Go on");
            let enter = ui.input(|i| i.key_pressed(Key::Enter));
            if ui.button("Quit").clicked() || enter {
                answer = Answer::Quit;
            }
            if go_on.clicked() {
                answer = Answer::Close;
            }
        });
    });
    if modal.should_close() { Answer::Close } else { answer }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::window::key_list::HelpRow;

    fn group(title: &str, rows: &[(&str, &str)]) -> Group {
        let row =
            |(keys, text): &(&str, &str)| HelpRow { keys: (*keys).to_owned(), text: (*text).to_owned(), id: None };
        Group { title: title.to_owned(), rows: rows.iter().map(row).collect() }
    }

    #[test]
    fn the_keys_of_the_welcome_do_nothing_else() {
        let closes = |sheet: &Sheet, key: &str| sheet.is_closed_by(&key.parse().unwrap());
        assert!(closes(&Sheet::Welcome, "Enter") && closes(&Sheet::Welcome, "Space"));
        assert!(!closes(&Sheet::Welcome, "R") && !closes(&Sheet::keys(), "Enter"));
    }

    #[test]
    fn a_search_finds_words_in_texts_keys_and_titles() {
        let all = || vec![group("Flight", &[("R", "turn round"), ("+", "faster")]), group("View", &[("X", "tag")])];
        let texts = |search: &str| -> Vec<String> {
            found(all(), search).into_iter().flat_map(|g| g.rows).map(|r| r.text).collect()
        };
        assert_eq!(texts(""), ["turn round", "faster", "tag"]);
        assert_eq!(texts("ROUND turn"), ["turn round"]);
        assert_eq!(texts("view"), ["tag"]);
        assert_eq!(texts("+"), ["faster"]);
        assert!(texts("warp").is_empty());
    }

    #[test]
    fn columns_hold_all_groups_in_order() {
        let all: Vec<Group> = (1..8).map(|n| group(&n.to_string(), &vec![("a", "b"); n])).collect();
        for columns in 1..5 {
            let shares = share_out(&all, columns);
            assert_eq!(shares.len(), columns);
            assert_eq!(shares.concat(), all);
            let longest = shares.iter().map(|s| s.iter().map(|g| g.rows.len() + 2).sum::<usize>()).max().unwrap();
            assert!(longest <= 42 / columns + 9, "{columns}: {longest}");
        }
        assert!(share_out(&[], 3).iter().all(|s| s.is_empty()));
    }
}
