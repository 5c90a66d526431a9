//! Keys, as the tables of actions name them, and those that are held down.

use std::fmt;
use std::str::FromStr;

use winit::keyboard::{Key, NamedKey};

use crate::error::{Error, Result};

/// A key, with Ctrl (on a Mac also Command) or without. Letters stand for both of their cases.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Chord {
    control: bool,
    /// A character in lower case, or a name of [`NAMES`].
    key: String,
}

/// Keys that are no characters, by the names that settings and help have for them.
const NAMES: [(&str, NamedKey); 21] = [
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
    ("F11", NamedKey::F11),
    ("F12", NamedKey::F12),
];

impl Chord {
    /// The key of a character, without Ctrl.
    pub fn character(key: char) -> Self {
        let key = if key == ' ' { "Space".to_owned() } else { key.to_lowercase().to_string() };
        Self { control: false, key }
    }

    /// The same key without Ctrl.
    #[must_use]
    pub fn plain(&self) -> Self {
        Self { control: false, key: self.key.clone() }
    }

    /// A key of the window system; none for keys that no action can have.
    pub fn of(key: &Key, control: bool) -> Option<Self> {
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

    /// Reads `"W"`, `"Esc"`, `"Ctrl+0"`.
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

/// What a held key steers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// Along the view.
    Forward,
    /// Against the view.
    Back,
    /// To the left, sideways.
    Left,
    /// To the right, sideways.
    Right,
    /// Upwards.
    Up,
    /// Downwards.
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

/// The keys that are held down.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HeldKeys(Vec<Hold>);

impl HeldKeys {
    /// A key goes down; whether that is news (a held key repeats).
    pub fn press(&mut self, hold: Hold) -> bool {
        let new = !self.0.contains(&hold);
        if new {
            self.0.push(hold);
        }
        new
    }

    /// A key goes up; whether it was down.
    pub fn release(&mut self, hold: Hold) -> bool {
        let before = self.0.len();
        self.0.retain(|h| *h != hold);
        self.0.len() != before
    }

    /// All keys go up; whether any was down.
    pub fn let_go(&mut self) -> bool {
        let any = !self.0.is_empty();
        self.0.clear();
        any
    }

    fn axis(&self, plus: Hold, minus: Hold) -> f64 {
        f64::from(i8::from(self.0.contains(&plus)) - i8::from(self.0.contains(&minus)))
    }

    /// The push that they ask for: right, up, forward.
    pub fn push(&self) -> [f64; 3] {
        [self.axis(Hold::Right, Hold::Left), self.axis(Hold::Up, Hold::Down), self.axis(Hold::Forward, Hold::Back)]
    }

    /// The turn that they ask for: to the right, upwards, clockwise.
    pub fn turn(&self) -> [f64; 3] {
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
