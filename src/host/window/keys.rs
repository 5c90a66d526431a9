//! What keys mean.

use winit::keyboard::{Key, NamedKey};

use crate::app::Overlay;
use crate::schedule::Guides;

/// What a key stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Something for as long as the key is held.
    Hold(Hold),
    /// Something once.
    Do(Deed),
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

/// What a key does once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Deed {
    /// Stops to look around, or goes on.
    Pause,
    /// Flies faster.
    Faster,
    /// Flies slower.
    Slower,
    /// Hands over to the operator, or back to the last guide.
    Guide,
    /// Hands over to the guide of this name.
    HandTo(&'static str),
    /// Shows or hides the overlay of this number.
    Overlay(usize),
    /// High or low detail.
    Detail,
    /// The headlight, or an endoscope's light.
    Light,
    /// A smaller view angle: what is seen gets larger.
    Narrower,
    /// A larger view angle.
    Wider,
    /// The view angle that the flight began with.
    UsualAngle,
    /// Turns round and flies back.
    Reverse,
    /// Flies the next segment.
    Next,
    /// Sets out from the other end.
    OtherEnd,
    /// Saves the image.
    Screenshot,
    /// Shows or hides the keys.
    Help,
    /// Fills the screen, or not.
    Fullscreen,
    /// Ends the program.
    Quit,
}

/// One short line of help, shown always.
pub const SHORT_HELP: &str = "H keys   Space stop   W A S D fly   drag to look   R back   Q quit";

/// All keys but those of guides and overlays, as the help shows them.
const HELP: [(&str, &str); 17] = [
    ("Space", "stop and look around, go on"),
    ("W S, Up Down", "fly forward, back"),
    ("A D", "fly to the left, right"),
    ("PageUp PageDown", "fly up, down"),
    ("drag, Left Right, Home End", "look around"),
    (", . (comma, dot), right drag, Shift+drag", "roll the view"),
    ("[ ], Ctrl and + - or wheel; 0", "view angle: narrower, wider; back"),
    ("+ -, wheel", "faster, slower"),
    ("R, B, Backspace", "turn round and fly back"),
    ("N, E", "next segment, from the other end"),
    ("G", "by hand, and back to the guide"),
    ("click on the bar", "go to that place of the way"),
    ("L", "detail: high or low"),
    ("O", "light: endoscope or headlight"),
    ("P, F12", "screenshot, and its pose"),
    ("F, H", "full screen, this help"),
    ("Q, Esc", "quit"),
];

/// The guides and overlays have keys of their own, which come after [`HELP`]'s row for the hand.
const OWN_KEYS_AFTER: &str = "G";

/// All keys with what they do, in the order in which the help shows them.
pub fn help(guides: &Guides, overlays: &[Overlay]) -> Vec<(String, String)> {
    let mut rows = Vec::new();
    for (keys, what) in HELP {
        rows.push((keys.to_owned(), what.to_owned()));
        if keys == OWN_KEYS_AFTER {
            let own: Vec<(String, &str)> =
                guides.iter().filter_map(|g| Some((g.key?.to_uppercase().to_string(), g.name))).collect();
            let joined = |part: fn(&(String, &'static str)) -> String, by: &str| {
                own.iter().map(part).collect::<Vec<_>>().join(by)
            };
            rows.push((joined(|o| o.0.clone(), " "), joined(|o| o.1.to_owned(), ", ")));
            rows.extend(
                overlays.iter().filter_map(|o| Some((o.key?.to_uppercase().to_string(), o.summary.to_owned()))),
            );
        }
    }
    rows
}

/// The guide that a letter or digit hands over to, if it is one's own.
pub fn hand_over(guides: &Guides, key: char) -> Option<Deed> {
    let is = |k: char| k.to_lowercase().eq(key.to_lowercase());
    guides.iter().find(|g| g.key.is_some_and(is)).map(|g| Deed::HandTo(g.name))
}

/// What a key stands for, whatever the case of its letter; of one that the window itself has no use for, what `own` says.
pub fn action(key: &Key, own: impl Fn(char) -> Option<Deed>) -> Option<Action> {
    use Action::{Do, Hold as Held};
    Some(match key {
        Key::Named(named) => match named {
            NamedKey::ArrowUp => Held(Hold::Forward),
            NamedKey::ArrowDown => Held(Hold::Back),
            NamedKey::ArrowLeft => Held(Hold::TurnLeft),
            NamedKey::ArrowRight => Held(Hold::TurnRight),
            NamedKey::PageUp => Held(Hold::Up),
            NamedKey::PageDown => Held(Hold::Down),
            NamedKey::Home => Held(Hold::TurnUp),
            NamedKey::End => Held(Hold::TurnDown),
            NamedKey::Space => Do(Deed::Pause),
            NamedKey::Backspace => Do(Deed::Reverse),
            NamedKey::F12 => Do(Deed::Screenshot),
            NamedKey::Escape => Do(Deed::Quit),
            _ => return None,
        },
        Key::Character(text) => match text.to_lowercase().as_str() {
            "w" => Held(Hold::Forward),
            "s" => Held(Hold::Back),
            "a" => Held(Hold::Left),
            "d" => Held(Hold::Right),
            " " => Do(Deed::Pause),
            "b" | "r" => Do(Deed::Reverse),
            "+" | "=" => Do(Deed::Faster),
            "-" | "_" => Do(Deed::Slower),
            "g" => Do(Deed::Guide),
            "l" => Do(Deed::Detail),
            "o" => Do(Deed::Light),
            // With Shift a key goes up as another character than it went down as.
            "," | "<" | ";" => Held(Hold::RollLeft),
            "." | ">" | ":" => Held(Hold::RollRight),
            "[" | "{" => Do(Deed::Narrower),
            "]" | "}" => Do(Deed::Wider),
            "0" => Do(Deed::UsualAngle),
            "n" => Do(Deed::Next),
            "e" => Do(Deed::OtherEnd),
            "p" => Do(Deed::Screenshot),
            "h" | "?" => Do(Deed::Help),
            "f" => Do(Deed::Fullscreen),
            "q" => Do(Deed::Quit),
            other => {
                let mut letters = other.chars();
                let (letter, rest) = (letters.next()?, letters.next());
                Do(own(letter).filter(|_| rest.is_none())?)
            }
        },
        _ => return None,
    })
}

/// What a key stands for together with Ctrl (on a Mac also Command): the view angle's keys are those of other programs.
pub fn with_control(key: &Key) -> Option<Deed> {
    let Key::Character(text) = key else { return None };
    match text.as_str() {
        "+" | "=" => Some(Deed::Narrower),
        "-" | "_" => Some(Deed::Wider),
        "0" => Some(Deed::UsualAngle),
        _ => None,
    }
}

/// The keys that are held down.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Hands(Vec<Hold>);

impl Hands {
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

    fn character(c: &str) -> Option<Action> {
        action(&Key::Character(c.into()), |key| hand_over(&crate::systems::guides(), key))
    }

    #[test]
    fn letters_of_either_case() {
        for (lower, upper) in [("w", "W"), ("g", "G"), ("q", "Q"), ("p", "P")] {
            assert!(character(lower).is_some());
            assert_eq!(character(lower), character(upper));
        }
        assert_eq!(character("q"), Some(Action::Do(Deed::Quit)));
        assert_eq!(character("3"), Some(Action::Do(Deed::HandTo("path"))));
        assert_eq!(character("ß"), None);
        assert_eq!(action(&Key::Named(NamedKey::Escape), |_| None), Some(Action::Do(Deed::Quit)));
        // A key that went down with Shift and comes up without lets go of the same thing.
        assert_eq!((character("<"), character(">")), (character(","), character(".")));
        assert_eq!(character(","), Some(Action::Hold(Hold::RollLeft)));
        for (plain, control) in [("[", "+"), ("]", "-"), ("0", "0")] {
            let control = with_control(&Key::Character(control.into())).map(Action::Do);
            assert!(control.is_some() && character(plain) == control, "{plain}");
        }
        assert_eq!(with_control(&Key::Character("c".into())), None);
        assert_eq!(action(&Key::Named(NamedKey::Backspace), |_| None), character("R"));
        assert_eq!(action(&Key::Named(NamedKey::Shift), |_| None), None);
    }

    #[test]
    fn held_keys_add_up_and_opposites_cancel() {
        let mut h = Hands::default();
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
