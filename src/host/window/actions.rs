//! The table of actions: what the operator can do in a window by name, and with which keys. Keys, help, menus, buttons and tooltips
//! are generated from it.

use super::action::{Action, Actions};
use super::intent::{FindingOf, Intent};
use super::keys::{Chord, Hold};
use super::layouts::LAYOUTS;
use super::own_action::ActionEntry;
use super::panels::PanelEntry;
use super::printed::Printed;
use crate::app::Overlay;
use crate::app::catalog::taken;
use crate::error::{Error, Result, program_name};
use crate::fields::lumen::GasKind;
use crate::host::settings::KeySettings;
use crate::polyps::answers::Answer;
use crate::schedule::Guides;

/// Returns an action with its description and its keys, which are separated by spaces.
fn action(id: &'static str, text: &'static str, keys: &str, intent: Intent) -> Action {
    Action {
        id: id.into(),
        text: text.into(),
        row: text.into(),
        keys: chords(keys),
        shown: Vec::new(),
        shifted: Vec::new(),
        gesture: "",
        repeats: false,
        intent,
    }
}

/// Same as [`action`], in a row of the help that it shares with others.
fn shared(row: &'static str, id: &'static str, text: &'static str, keys: &str, intent: Intent) -> Action {
    Action { row: row.into(), ..action(id, text, keys, intent) }
}

fn hold(row: &'static str, id: &'static str, text: &'static str, keys: &str, hold: Hold) -> Action {
    shared(row, id, text, keys, Intent::Hold(hold))
}

fn gesture(row: &'static str, id: &'static str, text: &'static str, gesture: &'static str) -> Action {
    Action { gesture, ..shared(row, id, text, "", Intent::Gesture) }
}

impl Action {
    /// Adds the keys that count as its own with Shift.
    fn with_shift(self, keys: &str) -> Self {
        Self { shifted: chords(keys), ..self }
    }

    fn or_by(self, gesture: &'static str) -> Self {
        Self { gesture, ..self }
    }

    fn repeating(self) -> Self {
        Self { repeats: true, ..self }
    }

    /// Names the owner of the action, for messages.
    fn owner(&self) -> String {
        match self.intent {
            Intent::Guide(guide) => format!("guide {guide}"),
            Intent::Overlay(_) | Intent::Panel(_) => self.id.replacen('-', " ", 1),
            Intent::Own(_) => format!("action {}", self.id),
            _ => format!("the window's {}", self.id),
        }
    }
}

/// Every action except those of guides, overlays, layouts, panels and other crates, in the order of the help.
fn table() -> Vec<Action> {
    use Intent as I;
    vec![
        action("finding", "mark a finding: where you point, or ahead", "J", I::Finding(FindingOf::Here)),
        action("pause", "pause, resume", "Space", I::Pause),
        hold(FLY_ROW[0], "forward", "fly forward", "W Up", Hold::Forward),
        hold(FLY_ROW[0], "back", "fly back", "S Down", Hold::Back),
        hold(FLY_ROW[1], "left", "fly left", "A", Hold::Left),
        hold(FLY_ROW[1], "right", "fly right", "D", Hold::Right),
        hold(FLY_ROW[2], "up", "fly up", "PageUp", Hold::Up),
        hold(FLY_ROW[2], "down", "fly down", "PageDown", Hold::Down),
        hold(LOOK_ROW, "turn-left", "look left", "Left", Hold::TurnLeft),
        hold(LOOK_ROW, "turn-right", "look right", "Right", Hold::TurnRight),
        hold(LOOK_ROW, "turn-up", "look up", "Home", Hold::TurnUp),
        hold(LOOK_ROW, "turn-down", "look down", "End", Hold::TurnDown),
        gesture(LOOK_ROW, "look", LOOK_ROW, "drag"),
        hold(ROLL_ROW, "roll-left", "roll counter-clockwise", ",", Hold::RollLeft).with_shift("< ;"),
        hold(ROLL_ROW, "roll-right", "roll clockwise", ".", Hold::RollRight).with_shift("> :"),
        gesture(ROLL_ROW, "roll", ROLL_ROW, "right drag, Shift+drag"),
        shared(ANGLE_ROW, "narrower", "narrower view angle", "[ Ctrl++", I::Zoom(1.0))
            .with_shift("{ Ctrl+=")
            .or_by("Ctrl+wheel")
            .repeating(),
        shared(ANGLE_ROW, "wider", "wider view angle", "] Ctrl+-", I::Zoom(-1.0)).with_shift("} Ctrl+_").repeating(),
        action("usual-angle", "reset the view angle", "0 Ctrl+0", I::UsualAngle),
        action("wide-view", "fisheye of 180°, and back", "F10", I::WideView),
        shared(SPEED_ROW, "faster", "faster", "+", I::Speed(1.0)).with_shift("=").or_by("wheel").repeating(),
        shared(SPEED_ROW, "slower", "slower", "-", I::Speed(-1.0)).with_shift("_").repeating(),
        action("reverse", "turn round and fly back", "R B Backspace", I::Reverse),
        action("next", "fly to the next segment", "T", I::NextSegment),
        action("whole", "read the whole colon: one flight from the rectum, cleansed", "Ctrl+I", I::Whole),
        action("other-end", "start from the other end", "E", I::OtherEnd),
        action("guide", "manual, and back to the guide", "G", I::SwitchGuide),
        gesture("jump to that place on the path", "seek", "jump to a place on the path", "click on the bar"),
        action("figures", "figures: frame time, clearance, detail", "", I::Figures),
        action("detail", "detail: high or low", "I", I::Detail),
        action("light", "light: endoscope or headlight", "L", I::Light),
        action("tag", "scan: cleansed, or as scanned", "X", I::Tag),
        shared(WINDOW_ROW, "window-colon", "window for the colon", "Ctrl+1", I::Greys(0.0, 2000.0)),
        shared(WINDOW_ROW, "window-soft", "window for soft tissue", "Ctrl+2", I::Greys(40.0, 400.0)),
        shared(WINDOW_ROW, "window-bone", "window for bone", "Ctrl+3", I::Greys(300.0, 1500.0)),
        shared(WINDOW_ROW, "window-lung", "window for lung", "Ctrl+4", I::Greys(-600.0, 1500.0)),
        shared(SLAB_ROW, "slab", "slab thickness", "Ctrl+5", I::Slab),
        shared(SLAB_ROW, "slab-kind", "projection of a slab: mean, maximum, minimum", "Ctrl+6", I::SlabKind),
        action("slices-reset", "slices: reset", "Ctrl+9", I::ResetSlices),
        action("open", "open another scan", "Ctrl+O", I::Files),
        shared(POSITION_ROW, "position", "work in the patient's other position", "F9", I::OtherPosition),
        shared(POSITION_ROW, "same-place", "go to the same place in the other position", "F7", I::SamePlace),
        shared(POSITION_ROW, "link", "fly both positions together, or stop that", "F8", I::Link),
        action("measure", "measure a distance with two clicks, stop measuring", "M C", I::Measure),
        shared(STEP_ROW, "candidate-next", "next candidate", "Enter", I::Step(true)),
        shared(STEP_ROW, "candidate-previous", "previous candidate", "Ctrl+Enter", I::Step(false)),
        shared(ANSWER_ROW, "candidate-yes", "this candidate is a polyp", "Y Ctrl+Y", I::Answer(Answer::Yes)),
        shared(ANSWER_ROW, "candidate-no", "this candidate is not a polyp", "N Ctrl+N", I::Answer(Answer::No)),
        shared(ANSWER_ROW, "candidate-unsure", "unsure whether this is a polyp", "U Ctrl+U", I::Answer(Answer::Unsure)),
        action("candidate-marks", "mark the candidates in all views", "Ctrl+J", I::Mark),
        action("measure-lesion", "measure a lesion with one click, stop measuring", "Ctrl+M", I::MeasureLesion),
        action("finding-outside", "mark a finding outside the colon, where you point", "Ctrl+P", I::Outside),
        action(
            "finding-measured",
            "mark a finding of the last distance or lesion measured",
            "",
            I::Finding(FindingOf::Measured),
        ),
        action("finding-correct", "measure the diameter of the chosen finding by hand", "", I::MeasureFinding(None)),
        action("finding-same", "take the chosen findings of both positions for one", "", I::JoinFindings(None)),
        action("finding-apart", "part the chosen finding from that of the other position", "", I::PartFinding(None)),
        action("finding-delete", "delete the chosen finding", "", I::DeleteFinding(None)),
        action("report", "write the report of this reading", "Ctrl+X", I::Report),
        action("report-send", "send the report of this reading to the archive", "", I::SendReport(0)),
        action("kinds", "kinds of gas in the slices", "Ctrl+K", I::Kinds),
        shared(KIND_ROW, "kind-colon", "this gas is colon", "Ctrl+L", I::Kind(Some(GasKind::Colon))),
        shared(KIND_ROW, "kind-small-bowel", "this gas is small bowel", "Ctrl+B", I::Kind(Some(GasKind::SmallBowel))),
        shared(KIND_ROW, "kind-stomach", "this gas is stomach", "Ctrl+A", I::Kind(Some(GasKind::Stomach))),
        shared(KIND_ROW, "kind-lung", "this gas is lung", "Ctrl+H", I::Kind(Some(GasKind::Lung))),
        shared(KIND_ROW, "kind-trachea", "this gas is trachea", "Ctrl+T", I::Kind(Some(GasKind::Trachea))),
        shared(KIND_ROW, "kind-unknown", "this gas may be colon", "Ctrl+D", I::Kind(Some(GasKind::Unknown))),
        shared(KIND_ROW, "kind-as-judged", "restore the automatic kind of this gas", "Ctrl+G", I::Kind(None)),
        shared(SEEN_ROW, "unseen", "paint the wall that was not seen", "P Ctrl+E", I::Coverage),
        shared(SEEN_ROW, "missed-next", "fly to the next missed patch of the wall", "F Ctrl+F", I::NextMissed),
        shared(SEEN_ROW, "review", "review: fly past all missed patches, or end it", "V Ctrl+V", I::Review),
        action("undo", "undo the last change to findings, distances, answers or kinds", "Ctrl+Z", I::Undo),
        action("delete-last", "delete the last distance", "Delete", I::DeleteLast),
        action("screenshot", "screenshot of all views", "Ctrl+S", I::Screenshot),
        action("picture", "picture of the flight alone, and its pose", "F12", I::Picture),
        action("fullscreen", "full screen", "F11", I::Fullscreen),
        action("help", "list of keys", "H F1", I::Help).with_shift("?"),
        action("cancel", "cancel, close what covers the window", "Esc", I::Cancel),
        action("quit", "quit", "Ctrl+Q", I::Quit),
    ]
}

/// Rows of the help for keys that fly in opposite directions.
const FLY_ROW: [&str; 3] = ["fly forward, back", "fly left, right", "fly up, down"];
/// Rows of the help for the keys that turn and roll the view, and that change the view angle and the speed.
const LOOK_ROW: &str = "look around";
const ROLL_ROW: &str = "roll the view";
const ANGLE_ROW: &str = "view angle: narrower, wider";
const SPEED_ROW: &str = "faster, slower";
/// Row of the help for the keys of grey-level windows.
const WINDOW_ROW: &str = "window: colon, soft tissue, bone, lung";
/// Row of the help for the wall that was not seen.
const SEEN_ROW: &str = "wall not seen: paint it, next missed patch, review all";
/// Row of the help for the patient's two positions.
const POSITION_ROW: &str = "other position: work in it, at the same place, fly both";
/// Row of the help for the keys of thick slices.
const SLAB_ROW: &str = "slices: slab thickness, projection";

/// Row of the help for the keys of the candidates.
const STEP_ROW: &str = "candidates: next, previous";
/// Row of the help for the keys that give a kind to gas.
const KIND_ROW: &str = "gas: colon, small bowel, stomach, lung, trachea, unknown, automatic";
const ANSWER_ROW: &str = "candidate: yes, no, unsure";

/// The rows of guides and overlays follow this action's row.
const OWN_AFTER: &str = "guide";
/// The rows of layouts and panels follow this action's row.
const LAYOUTS_AFTER: &str = "fullscreen";

/// The row of the help that lists all layouts.
const LAYOUT_ROW: &str = "panels: flight alone, reading, slices, across the path, both positions";

fn chords(keys: &str) -> Vec<Chord> {
    let all: Vec<Chord> = keys.split_whitespace().filter_map(|k| k.parse().ok()).collect();
    #[cfg(test)]
    assert_eq!(all.len(), keys.split_whitespace().count(), "{keys}");
    all
}

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
        let own = |id: String, text: String, row: String, key: Option<char>, intent: Intent| Action {
            id: id.into(),
            text: text.into(),
            row: row.into(),
            keys: key.into_iter().map(Chord::character).collect(),
            ..action("", "", "", intent)
        };
        let names: Vec<&str> = guides.iter().filter(|g| g.key.is_some()).map(|g| g.name).collect();
        let mut all = Vec::new();
        for action in table() {
            let id = action.id.clone();
            all.push(action);
            if id == OWN_AFTER {
                all.extend(guides.iter().map(|g| {
                    let text = format!("switch to guide {}", g.name);
                    own(format!("guide-{}", g.name), text, names.join(", "), g.key, Intent::Guide(g.name))
                }));
                all.extend(overlays.iter().enumerate().map(|(n, o)| {
                    let text = o.summary.to_owned();
                    own(format!("overlay-{}", o.name), text.clone(), text, o.key, Intent::Overlay(n))
                }));
            }
            if id == LAYOUTS_AFTER {
                all.extend(LAYOUTS.iter().enumerate().map(|(n, l)| Action {
                    keys: chords(l.key),
                    ..own(
                        format!("layout-{}", l.name),
                        l.text.to_owned(),
                        LAYOUT_ROW.to_owned(),
                        None,
                        Intent::Layout(n),
                    )
                }));
                all.extend(panels.iter().enumerate().map(|(n, p)| {
                    let text = format!("panel: {}", p.title);
                    own(format!("panel-{}", p.name), text.clone(), text, p.key, Intent::Panel(n))
                }));
                all.extend(more.iter().enumerate().map(|(n, a)| {
                    let text = if a.text.is_empty() { a.id } else { a.text };
                    let own = own(a.id.to_owned(), text.to_owned(), text.to_owned(), a.key, Intent::Own(n));
                    Action { repeats: a.repeats, ..own }
                }));
            }
        }
        for (id, keys) in settings {
            let action = all.iter_mut().find(|a| a.id == *id);
            let Some(action) = action.filter(|a| !matches!(a.intent, Intent::Gesture)) else {
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
                    return Err(Error::usage(owner, "exists twice", "give one of them another name"));
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::window::action::{MENUS, OWN};
    use crate::host::window::panels;
    use crate::systems::guides;

    fn actions(settings: &[(&str, &[&str])]) -> Result<Actions> {
        let settings =
            settings.iter().map(|(id, keys)| ((*id).to_owned(), keys.iter().map(|k| (*k).to_owned()).collect()));
        Actions::new(&guides(), &crate::app::Catalog::default().overlays, panels::BUILT_IN, &settings.collect())
    }

    #[test]
    fn every_action_of_the_table_is_there_once() {
        let all = table();
        for action in &all {
            assert_eq!(all.iter().filter(|a| a.id == action.id).count(), 1, "{}", action.id);
            let same = all.iter().filter(|a| a.intent == action.intent).count();
            assert!(same == 1 || action.intent == Intent::Gesture, "{}", action.id);
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
        assert_eq!(
            usual.short_help(),
            "H keys   Space pause   J finding   W A S D steer   drag to look   R turn round"
        );
        assert_eq!(usual.hint("next", "flies to the next"), " (T flies to the next)");
        assert_eq!((usual.key("undo").as_str(), usual.quit_key().as_str()), ("Ctrl+Z", "Ctrl+Q"));
        let changed = [("help", &["Ü"][..]), ("left", &["Ö"]), ("reverse", &[]), ("next", &[]), ("quit", &["Ä"])];
        let changed = actions(&changed).unwrap();
        assert_eq!(changed.short_help(), "Ü keys   Space pause   J finding   W Ö S D steer   drag to look");
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
        let expected = all.0.iter().filter(|a| !matches!(a.intent, Intent::Hold(_) | Intent::Gesture));
        let mut expected: Vec<&str> = expected.map(|a| a.id.as_ref()).collect();
        let mut found = ids.clone();
        expected.sort_unstable();
        found.sort_unstable();
        assert_eq!(found, expected);
        assert_eq!((groups[0].rows[0].keys.as_str(), groups[1].title.as_str()), ("J", "Steer"));
        assert!(groups[1].rows.iter().any(|r| r.keys == "W S, Up Down" && r.text == "fly forward, back"));
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
