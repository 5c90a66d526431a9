//! Keys as named in the tables of actions, and the keys currently held.

use std::fmt;
use std::str::FromStr;

use winit::keyboard::{Key, NamedKey};

use crate::error::{Error, Result};

/// A key with or without Ctrl (on a Mac also Command). Letters stand for both of their cases.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Chord {
    control: bool,
    /// A lower-case character, or a name of [`NAMES`].
    key: String,
}

/// Keys other than characters, by their names in settings and help.
const NAMES: [(&str, NamedKey); 26] = [
    ("Space", NamedKey::Space),
    ("Up", NamedKey::ArrowUp),
    ("Down", NamedKey::ArrowDown),
    ("Left", NamedKey::ArrowLeft),
    ("Right", NamedKey::ArrowRight),
    ("PageUp", NamedKey::PageUp),
    ("PageDown", NamedKey::PageDown),
    ("Home", NamedKey::Home),
    ("End", NamedKey::End),
    ("Backspace", NamedKey::Backspace),
    ("Delete", NamedKey::Delete),
    ("Enter", NamedKey::Enter),
    ("Tab", NamedKey::Tab),
    ("Esc", NamedKey::Escape),
    ("F1", NamedKey::F1),
    ("F2", NamedKey::F2),
    ("F3", NamedKey::F3),
    ("F4", NamedKey::F4),
    ("F5", NamedKey::F5),
    ("F6", NamedKey::F6),
    ("F7", NamedKey::F7),
    ("F8", NamedKey::F8),
    ("F9", NamedKey::F9),
    ("F10", NamedKey::F10),
    ("F11", NamedKey::F11),
    ("F12", NamedKey::F12),
];

impl Chord {
    /// Returns the key of a character, without Ctrl.
    pub(crate) fn character(key: char) -> Self {
        let key = if key == ' ' { "Space".to_owned() } else { key.to_lowercase().to_string() };
        Self { control: false, key }
    }

    /// Returns the same key without Ctrl.
    #[must_use]
    pub(crate) fn plain(&self) -> Self {
        Self { control: false, key: self.key.clone() }
    }

    /// Returns its character; `None` if it has a name.
    pub(crate) fn letter(&self) -> Option<char> {
        let mut letters = self.key.chars();
        letters.next().filter(|_| letters.next().is_none())
    }

    /// Returns the key of another character, with or without Ctrl as this one.
    pub(crate) fn with_letter(&self, letter: char) -> Self {
        Self { control: self.control, key: letter.to_string() }
    }

    /// Converts a key of the window system; `None` for keys that no action can have.
    pub(crate) fn of(key: &Key, control: bool) -> Option<Self> {
        let key = match key {
            Key::Named(named) => NAMES.iter().find(|n| n.1 == *named)?.0.to_owned(),
            Key::Character(text) if text.as_str() == " " => "Space".to_owned(),
            Key::Character(text) => text.to_lowercase(),
            _ => return None,
        };
        Some(Self { control, key })
    }
}

impl FromStr for Chord {
    type Err = Error;

    /// Parses `"W"`, `"Esc"`, `"Ctrl+0"`.
    fn from_str(text: &str) -> Result<Self> {
        let (control, key) = text.strip_prefix("Ctrl+").map_or((false, text), |key| (true, key));
        let named = NAMES.iter().find(|n| n.0.eq_ignore_ascii_case(key)).map(|n| n.0.to_owned());
        let mut letters = key.chars();
        let one = letters.next().filter(|c| letters.next().is_none() && !c.is_whitespace() && !c.is_control());
        let Some(key) = named.or_else(|| one.map(|c| c.to_lowercase().to_string())) else {
            let names: Vec<&str> = NAMES.iter().map(|n| n.0).collect();
            let fix = format!("give one character or one of {}, with Ctrl+ before it or without", names.join(", "));
            return Err(Error::usage("key", format!("there is no {text:?}"), fix));
        };
        Ok(Self { control, key })
    }
}

impl fmt::Display for Chord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let control = if self.control { "Ctrl+" } else { "" };
        let is_name = NAMES.iter().any(|n| n.0 == self.key);
        if is_name { write!(f, "{control}{}", self.key) } else { write!(f, "{control}{}", self.key.to_uppercase()) }
    }
}

/// The motion that a held key causes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Hold {
    /// Moves along the view.
    Forward,
    /// Moves against the view.
    Back,
    /// Moves to the left, sideways.
    Left,
    /// Moves to the right, sideways.
    Right,
    /// Moves upwards.
    Up,
    /// Moves downwards.
    Down,
    /// Turns the view to the left.
    TurnLeft,
    /// Turns the view to the right.
    TurnRight,
    /// Turns the view upwards.
    TurnUp,
    /// Turns the view downwards.
    TurnDown,
    /// Rolls the view counter-clockwise.
    RollLeft,
    /// Rolls the view clockwise.
    RollRight,
}

/// The keys that are currently held.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct HeldKeys(Vec<Hold>);

impl HeldKeys {
    /// Presses a key. Returns true if it was not held before (a held key repeats).
    pub(crate) fn press(&mut self, hold: Hold) -> bool {
        let new = !self.0.contains(&hold);
        if new {
            self.0.push(hold);
        }
        new
    }

    /// Releases a key. Returns true if it was held.
    pub(crate) fn release(&mut self, hold: Hold) -> bool {
        let before = self.0.len();
        self.0.retain(|h| *h != hold);
        self.0.len() != before
    }

    /// Releases all keys. Returns true if any was held.
    pub(crate) fn let_go(&mut self) -> bool {
        let any = !self.0.is_empty();
        self.0.clear();
        any
    }

    fn axis(&self, plus: Hold, minus: Hold) -> f64 {
        f64::from(i8::from(self.0.contains(&plus)) - i8::from(self.0.contains(&minus)))
    }

    /// Returns the push of the held keys: right, up, forward.
    pub(crate) fn push(&self) -> [f64; 3] {
        [self.axis(Hold::Right, Hold::Left), self.axis(Hold::Up, Hold::Down), self.axis(Hold::Forward, Hold::Back)]
    }

    /// Returns the turn of the held keys: to the right, upwards, clockwise.
    pub(crate) fn turn(&self) -> [f64; 3] {
        [
            self.axis(Hold::TurnRight, Hold::TurnLeft),
            self.axis(Hold::TurnUp, Hold::TurnDown),
            self.axis(Hold::RollRight, Hold::RollLeft),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_what_its_text_says() {
        for text in ["W", "[", "+", "Ctrl++", "Ctrl+0", "Esc", "PageUp", "F12", "Ü"] {
            let chord: Chord = text.parse().unwrap();
            assert_eq!(chord.to_string(), text);
        }
        assert_eq!("w".parse::<Chord>().unwrap(), "W".parse().unwrap());
        assert_eq!(Chord::character(' '), "space".parse().unwrap());
        for text in ["", "WW", "Ctrl+", "Escape!", " ", "\n"] {
            assert!(text.parse::<Chord>().is_err(), "{text:?}");
        }
    }

    #[test]
    fn keys_of_the_window_system_are_found_in_either_case() {
        let of = |text: &str, control| Chord::of(&Key::Character(text.into()), control);
        assert_eq!(of("w", false), of("W", false));
        assert_eq!(of("+", true), "Ctrl++".parse().ok());
        assert_eq!(Chord::of(&Key::Named(NamedKey::Escape), false), "Esc".parse().ok());
        assert_eq!(Chord::of(&Key::Named(NamedKey::Shift), false), None);
    }

    #[test]
    fn the_space_bar_is_one_key_whether_a_name_or_a_character() {
        let named = Chord::of(&Key::Named(NamedKey::Space), false);
        assert_eq!(named, "Space".parse().ok());
        assert_eq!(Chord::of(&Key::Character(" ".into()), false), named);
    }

    #[test]
    fn held_keys_add_up_and_opposites_cancel() {
        let mut h = HeldKeys::default();
        assert!(h.press(Hold::Forward) && !h.press(Hold::Forward));
        assert!(h.press(Hold::Left));
        assert_eq!(h.push(), [-1.0, 0.0, 1.0]);
        h.press(Hold::Back);
        assert_eq!(h.push(), [-1.0, 0.0, 0.0]);
        assert!(h.release(Hold::Back) && !h.release(Hold::Back));
        h.press(Hold::TurnRight);
        h.press(Hold::TurnUp);
        assert_eq!(h.turn(), [1.0, 1.0, 0.0]);
        h.press(Hold::RollLeft);
        assert_eq!(h.turn(), [1.0, 1.0, -1.0]);
        assert!(h.let_go() && !h.let_go());
        assert_eq!((h.push(), h.turn()), ([0.0; 3], [0.0; 3]));
    }
}
