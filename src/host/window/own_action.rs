//! Actions of other crates.

use std::borrow::Cow;
use std::cell::{Cell, OnceCell};

use super::contract::{Context, Requests};
use super::intent::{Intent, WhyNot};
use crate::app::FlightApp;
use crate::panics;
use crate::schedule::note;

/// An action of another crate in the window: an entry of the menu *Flight*, with a key if it has one, in the help and in the
/// settings file. Panels offer it with [`Context::button`].
///
/// It reads the flight and asks for what it wants: commands to the flight, other actions, messages. `examples/own_action.rs` is a
/// complete example.
///
/// ```
/// # mod colvis {
/// # pub use colvis_flight::components;
/// # pub use colvis_host::host::window::panels as panel;
/// # }
/// use colvis::components::input::FlightCommand;
/// use colvis::panel::ActionEntry;
///
/// let home = ActionEntry {
///     id: "home",
///     text: "jump back to the start",
///     key: Some('z'),
///     possible: |flight| if flight.survey().progress().0 > 0.0 { Ok(()) } else { Err("the flight is at its start".into()) },
///     run: |_, requests| requests.command(FlightCommand::Seek(0.0)),
///     ..ActionEntry::BASE
/// };
/// # let _ = home;
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ActionEntry {
    /// Its name in the settings file, for [`Requests::action`] and in messages. No other action may have it.
    pub id: &'static str,
    /// Short description, for the menu and the help.
    pub text: &'static str,
    /// Its key. The settings file may give it another.
    pub key: Option<char>,
    /// True if it repeats while its key is held.
    pub repeats: bool,
    /// Checks whether it is possible now. The error is a state of the flight that follows the words *not while*, for example
    /// *the flight is paused*. Called for each layout of a menu or a button with it, so it should be fast.
    pub possible: fn(&FlightApp) -> Result<(), Cow<'static, str>>,
    /// What it does. If it panics, what it asked for does not happen.
    pub run: fn(&Context<'_>, &mut Requests),
}

impl ActionEntry {
    /// An action that is always possible, without a key, and does nothing. Use it as the base of others.
    pub const BASE: Self = Self { id: "", text: "", key: None, repeats: false, possible: |_| Ok(()), run: |_, _| {} };
}

/// The actions of other crates in a window, by their numbers.
#[derive(Debug, Default)]
pub(crate) struct OwnActions(Vec<(ActionEntry, OwnState)>);

/// The state of an action of another crate.
#[derive(Debug, Default)]
struct OwnState {
    /// Why it is switched off: it has panicked.
    fault: OnceCell<String>,
    /// True from its beginning until what it asked for was done.
    is_under_way: Cell<bool>,
}

impl OwnActions {
    /// Takes the actions, in their order.
    pub(crate) fn new(entries: &[ActionEntry]) -> Self {
        Self(entries.iter().map(|e| (*e, OwnState::default())).collect())
    }

    /// Returns why an action is not possible now; `None` if it is possible.
    pub(crate) fn why_not(&self, n: usize, flight: &FlightApp) -> Option<WhyNot> {
        let Some((entry, state)) = self.0.get(n) else { return Some("there is none".into()) };
        if let Some(why) = state.fault.get() {
            return Some(format!("it is switched off ({why})").into());
        }
        match panics::catch(|| (entry.possible)(flight)) {
            Ok(possible) => possible.err(),
            Err(why) => {
                switch_off(entry, state, &why);
                self.why_not(n, flight)
            }
        }
    }

    /// Runs an action and returns what it asks for. It is under way until [`OwnActions::end`]: until then it does not begin once
    /// more, however it is asked for. `None` if it has not begun.
    pub(crate) fn begin(&self, n: usize, context: &Context<'_>) -> Option<Vec<Intent>> {
        let (entry, state) = self.0.get(n)?;
        let name = format!("action {}", entry.id);
        if state.is_under_way.replace(true) {
            note(name, "requests itself: it runs only once");
            return None;
        }
        let mut requests = Requests::default();
        if let Err(why) = panics::catch(|| (entry.run)(context, &mut requests)) {
            switch_off(entry, state, &why);
            requests = Requests::default();
        }
        requests.refuse_from(0, context.actions, &name);
        Some(requests.take())
    }

    /// Ends an action that was begun.
    pub(crate) fn end(&self, n: usize) {
        if let Some((_, state)) = self.0.get(n) {
            state.is_under_way.set(false);
        }
    }
}

/// Notes that an action has panicked.
fn switch_off(entry: &ActionEntry, state: &OwnState, why: &str) {
    note(format!("action {}", entry.id), format!("panicked: {why}; it is switched off"));
    state.fault.get_or_init(|| format!("panicked: {why}"));
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;
    use std::sync::Arc;
    use std::time::Instant;

    use super::*;
    use crate::components::input::{FlightCommand, HandCommand};
    use crate::host::settings::KeySettings;
    use crate::host::window::action::{Actions, MENUS};
    use crate::host::window::background::Background;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::FlightController;
    use crate::host::window::controller::tests::flight;
    use crate::host::window::intent::{ActionContext, SliceInput};
    use crate::render::ImageSize;
    use crate::schedule::Guides;

    fn actions(own: &[ActionEntry]) -> crate::error::Result<Actions> {
        let settings = KeySettings::from([("last".to_owned(), vec!["Ctrl+R".to_owned()])]);
        let settings = if own.iter().any(|a| a.id == "last") { settings } else { KeySettings::new() };
        Actions::of(&Guides::default(), &[], &[], own, &settings)
    }

    fn controller_with(own: &[ActionEntry]) -> FlightController {
        let actions = Rc::new(actions(own).unwrap());
        let background = Background::new(Arc::new(|| {}));
        let mut c = FlightController::new(flight("manual"), background, Vec::new(), actions).unwrap();
        c.set_own(Rc::new(OwnActions::new(own)));
        c
    }

    /// Begins the only action.
    fn begin(c: &mut FlightController) -> Option<Vec<Intent>> {
        let left = c.execute(Intent::Own(0), ActionContext { window: ImageSize::new(0, 0), now: Instant::now() })?;
        assert_eq!(left, Intent::Own(0));
        c.begin_own(0, &[])
    }

    const MARK: ActionEntry = ActionEntry {
        id: "mark",
        text: "mark this place",
        key: Some('z'),
        run: |context, requests| {
            requests.point(context.flight.pose().position);
            requests.command(HandCommand::Pause(true));
            requests.say("marked");
        },
        ..ActionEntry::BASE
    };

    #[test]
    fn it_has_its_key_its_help_its_setting_and_its_menu() {
        let last = ActionEntry { id: "last", repeats: true, ..ActionEntry::BASE };
        let all = actions(&[MARK, last]).unwrap();
        let id = |key: &str| all.of_key(&key.parse().unwrap()).map(|a| a.id.as_ref());
        assert_eq!((id("Z"), id("Ctrl+R")), (Some("mark"), Some("last")));
        assert!(all.named("last").unwrap().repeats && !all.named("mark").unwrap().repeats);
        let help = all.help();
        for row in [("Z", "mark this place"), ("Ctrl+R", "last")] {
            assert!(help.iter().any(|r| (r.0.as_str(), r.1.as_str()) == row), "{row:?}");
        }
        let menus = MENUS.iter().map(|m| {
            let listed = m.1.iter().flat_map(|entry| all.of_menu(entry)).map(|a| a.id.to_string());
            (m.0, listed.filter(|id| id == "mark" || id == "last").collect::<Vec<_>>())
        });
        let menus: Vec<_> = menus.filter(|m| !m.1.is_empty()).collect();
        assert_eq!(menus, [("Flight", vec!["mark".to_owned(), "last".to_owned()])]);
    }

    #[test]
    fn names_and_keys_that_are_taken_are_refused_with_both_owners() {
        for (own, words) in [
            (vec![ActionEntry { id: "pause", ..MARK }], ["the window's pause", "action pause"]),
            (vec![ActionEntry { key: Some('W'), ..MARK }], ["the window's forward", "action mark"]),
            (vec![MARK, ActionEntry { id: "other", ..MARK }], ["action mark", "action other"]),
            (vec![MARK, ActionEntry { key: None, ..MARK }], ["action mark", "twice"]),
            (vec![ActionEntry { id: "", ..MARK }], ["action", "has no id"]),
        ] {
            let told = actions(&own).unwrap_err().to_string();
            assert!(words.iter().all(|w| told.contains(w)), "{words:?}: {told}");
        }
    }

    #[test]
    fn it_asks_for_what_it_wants_once() {
        let mut c = controller_with(&[MARK]);
        let place = c.flight().pose().position;
        let asked = begin(&mut c).unwrap();
        assert_eq!(asked.len(), 3);
        assert_eq!(asked[0], Intent::Slice(SliceInput::Point(place)));
        assert_eq!(asked[1..], [Intent::Command(HandCommand::Pause(true).into()), Intent::Say("marked".to_owned())]);
        // What it asks for may ask for it again.
        assert!(begin(&mut c).is_none());
        let told = c.flight_mut().take_notes().join("\n");
        assert!(told.contains("action mark requests itself"), "{told}");
        c.own.end(0);
        assert!(begin(&mut c).is_some());
    }

    #[test]
    fn one_that_is_not_possible_is_refused_with_its_reason() {
        let never = ActionEntry { possible: |_| Err("it rains".into()), ..MARK };
        let mut c = controller_with(&[never]);
        assert_eq!(c.why_not(&Intent::Own(0)).as_deref(), Some("it rains"));
        assert!(begin(&mut c).is_none());
        assert_eq!(c.hud(Instant::now()).message.as_deref(), Some("mark this place is unavailable: it rains"));
    }

    #[test]
    fn one_that_panics_is_named_and_switched_off() {
        fn half(_: &Context<'_>, requests: &mut Requests) {
            requests.say("half done");
            panic!("ran badly");
        }
        let runs = ActionEntry { run: half, ..MARK };
        let asks = ActionEntry { possible: |_| panic!("asked badly"), ..MARK };
        for (bad, word) in [(runs, "ran badly"), (asks, "asked badly")] {
            let mut c = controller_with(&[bad]);
            let asked = begin(&mut c).unwrap_or_default();
            assert!(asked.is_empty(), "{asked:?}");
            c.own.end(0);
            let notes = c.flight_mut().take_notes();
            assert!(notes.len() == 1 && notes[0].starts_with("action mark panicked: ") && notes[0].contains(word));
            let why = c.why_not(&Intent::Own(0)).unwrap();
            assert!(why.contains("switched off") && why.contains(word), "{why}");
            assert!(begin(&mut c).is_none() && c.flight_mut().take_notes().is_empty());
        }
    }

    #[test]
    fn commands_are_followed_or_told_why_not() {
        let mut c = controller_with(&[]);
        let now = Instant::now();
        c.flight_mut().commands.start();
        c.command(HandCommand::Speed(0.1 + 0.2).into(), now);
        c.command(FlightCommand::ViewAngle(40.0).into(), now);
        let recorded: Vec<_> = c.flight().commands.recorded().iter().map(|r| r.command.clone()).collect();
        assert_eq!(recorded, [HandCommand::Speed(0.3).into(), FlightCommand::ViewAngle(40.0).into()]);
        let place = c.flight().pose().position;
        for (command, word) in [
            (FlightCommand::Guide("warp".to_owned()).into(), "warp"),
            (FlightCommand::Segment(77).into(), "segment"),
            (FlightCommand::Go { to: [1e6; 3], forward: [1.0, 0.0, 0.0], up: [0.0, 0.0, 1.0] }.into(), "fit"),
            (FlightCommand::Seek(f64::NAN).into(), "seek: one of its numbers is not finite"),
            (HandCommand::Push([0.0, f64::INFINITY, 0.0]).into(), "push: one of its numbers is not finite"),
            (FlightCommand::ViewAngle(f64::NAN).into(), "view_angle: one of its numbers"),
        ] {
            c.command(command, now);
            let told = c.hud(now).message.unwrap_or_default();
            assert!(told.contains(word), "{word}: {told}");
        }
        assert_eq!((c.flight().commands.recorded().len(), c.flight().pose().position), (2, place));
        c.command(FlightCommand::Guide("path".to_owned()).into(), now);
        assert!(c.hud(now).message.unwrap_or_default().contains("guide"), "built beside the flight");
        c.say_for(&format!("{}\nand more", "long ".repeat(1000)), now);
        assert!(c.hud(now).message.unwrap().chars().count() <= 200);
    }
}
