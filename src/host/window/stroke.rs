//! Keys on every keyboard layout: an action's key is the one that prints its character, or else the one at its place on a US
//! keyboard.
//!
//! So all actions have a key where the layout prints other letters (Russian, Greek, Arabic, Hebrew) or no digits (French), and no
//! key changes where the layout prints what the action asks for.

use winit::event::KeyEvent;
use winit::keyboard::{Key, KeyCode, ModifiersState, PhysicalKey};
use winit::platform::modifier_supplement::KeyEventExtModifierSupplement;

use super::keys::{Chord, Hold};

/// The characters of keys, without and with Shift; `None` where a key prints nothing.
pub(crate) type Printing = [Option<char>; 2];

/// A key that was pressed or released.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Stroke {
    /// What the layout makes of it.
    logical: Key,
    /// The same without Shift, AltGr and the like.
    plain: Key,
    /// Its place on the keyboard.
    physical: PhysicalKey,
    shift: bool,
    control: bool,
}

impl Stroke {
    /// Converts an event of the window system. `control` is true if Ctrl counts.
    pub(crate) fn of(event: &KeyEvent, modifiers: ModifiersState, control: bool) -> Self {
        Self {
            logical: event.logical_key.clone(),
            plain: event.key_without_modifiers(),
            physical: event.physical_key,
            shift: modifiers.shift_key(),
            control,
        }
    }

    /// Returns the place of a key that was pressed without modifiers, and what it printed; `None` for other keys.
    pub(super) fn printed(&self) -> Option<(KeyCode, char)> {
        let PhysicalKey::Code(code) = self.physical else { return None };
        let Key::Character(text) = &self.logical else { return None };
        let mut letters = text.chars().flat_map(char::to_lowercase);
        let one = letters.next().filter(|_| letters.next().is_none())?;
        (!self.shift && !self.control && self.logical == self.plain).then_some((code, one))
    }

    /// A key that prints `text` without modifiers.
    #[cfg(test)]
    pub(super) fn typed(code: KeyCode, text: &str) -> Self {
        let key = Key::Character(text.into());
        Self { logical: key.clone(), plain: key, physical: code.into(), shift: false, control: false }
    }

    /// Returns the key as actions name it; `None` for keys that no action can have. `has_action` is true for keys with an action.
    pub(crate) fn chord(&self, has_action: impl Fn(&Chord) -> bool) -> Option<Chord> {
        let printed = Chord::of(&self.logical, self.control);
        if matches!(self.logical, Key::Named(_)) || printed.as_ref().is_some_and(&has_action) {
            return printed;
        }
        // With Shift or AltGr, it is another key on purpose.
        let plain = Chord::of(&self.plain, self.control);
        let is_plain = plain == printed || !matches!(self.logical, Key::Character(_));
        if !is_plain && (!self.shift || plain.as_ref().is_some_and(&has_action)) {
            return printed;
        }
        let us = us_character(self.physical, self.shift);
        let us = us.and_then(|c| Chord::of(&Key::Character(c.to_string().into()), self.control));
        us.filter(has_action).or(printed)
    }
}

/// The keys that cause the held motions. A key releases what it pressed, even if the layout or a modifier has changed since then.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pressed(Vec<(PhysicalKey, Hold)>);

impl Pressed {
    /// Stores what a pressed key causes.
    pub(crate) fn press(&mut self, key: PhysicalKey, hold: Hold) {
        self.0.retain(|p| p.0 != key);
        self.0.push((key, hold));
    }

    /// Returns what a released key caused; `None` if that is not known.
    pub(crate) fn release(&mut self, key: PhysicalKey) -> Option<Hold> {
        let at = self.0.iter().position(|p| p.0 == key)?;
        Some(self.0.swap_remove(at).1)
    }
}

/// Returns the character at that place on a US keyboard.
fn us_character(key: PhysicalKey, shift: bool) -> Option<char> {
    let PhysicalKey::Code(code) = key else { return None };
    let (_, plain, shifted) = US.iter().find(|k| k.0 == code)?;
    Some(if shift { *shifted } else { *plain })
}

/// The characters of a US keyboard, without and with Shift.
pub(super) const US: [(KeyCode, char, char); 47] = [
    (KeyCode::Backquote, '`', '~'),
    (KeyCode::Digit1, '1', '!'),
    (KeyCode::Digit2, '2', '@'),
    (KeyCode::Digit3, '3', '#'),
    (KeyCode::Digit4, '4', '$'),
    (KeyCode::Digit5, '5', '%'),
    (KeyCode::Digit6, '6', '^'),
    (KeyCode::Digit7, '7', '&'),
    (KeyCode::Digit8, '8', '*'),
    (KeyCode::Digit9, '9', '('),
    (KeyCode::Digit0, '0', ')'),
    (KeyCode::Minus, '-', '_'),
    (KeyCode::Equal, '=', '+'),
    (KeyCode::KeyQ, 'q', 'Q'),
    (KeyCode::KeyW, 'w', 'W'),
    (KeyCode::KeyE, 'e', 'E'),
    (KeyCode::KeyR, 'r', 'R'),
    (KeyCode::KeyT, 't', 'T'),
    (KeyCode::KeyY, 'y', 'Y'),
    (KeyCode::KeyU, 'u', 'U'),
    (KeyCode::KeyI, 'i', 'I'),
    (KeyCode::KeyO, 'o', 'O'),
    (KeyCode::KeyP, 'p', 'P'),
    (KeyCode::BracketLeft, '[', '{'),
    (KeyCode::BracketRight, ']', '}'),
    (KeyCode::Backslash, '\\', '|'),
    (KeyCode::KeyA, 'a', 'A'),
    (KeyCode::KeyS, 's', 'S'),
    (KeyCode::KeyD, 'd', 'D'),
    (KeyCode::KeyF, 'f', 'F'),
    (KeyCode::KeyG, 'g', 'G'),
    (KeyCode::KeyH, 'h', 'H'),
    (KeyCode::KeyJ, 'j', 'J'),
    (KeyCode::KeyK, 'k', 'K'),
    (KeyCode::KeyL, 'l', 'L'),
    (KeyCode::Semicolon, ';', ':'),
    (KeyCode::Quote, '\'', '"'),
    (KeyCode::KeyZ, 'z', 'Z'),
    (KeyCode::KeyX, 'x', 'X'),
    (KeyCode::KeyC, 'c', 'C'),
    (KeyCode::KeyV, 'v', 'V'),
    (KeyCode::KeyB, 'b', 'B'),
    (KeyCode::KeyN, 'n', 'N'),
    (KeyCode::KeyM, 'm', 'M'),
    (KeyCode::Comma, ',', '<'),
    (KeyCode::Period, '.', '>'),
    (KeyCode::Slash, '/', '?'),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::settings::KeySettings;
    use crate::host::window::action::Actions;
    use crate::host::window::panels;
    use crate::systems::guides;

    fn actions(settings: &[(&str, &str)]) -> Actions {
        let keys = |key: &str| vec![key.to_owned()];
        let settings: KeySettings = settings.iter().map(|(id, key)| ((*id).to_owned(), keys(key))).collect();
        Actions::new(&guides(), &crate::app::Catalog::default().overlays, panels::BUILT_IN, &settings).unwrap()
    }

    /// A key that prints `plain` without modifiers and `printed` with those that are held.
    fn stroke(code: KeyCode, plain: &str, printed: &str, shift: bool, control: bool) -> Stroke {
        let key = |text: &str| Key::Character(text.into());
        Stroke { logical: key(printed), plain: key(plain), physical: code.into(), shift, control }
    }

    fn id(actions: &Actions, stroke: &Stroke) -> Option<String> {
        let chord = stroke.chord(|c| actions.of_key(c).is_some())?;
        actions.of_key(&chord).map(|a| a.id.clone().into_owned())
    }

    /// The characters of the keys 1, 3, R, W, A, S, D and G on layouts.
    const LAYOUTS: [(&str, [&str; 8]); 6] = [
        ("us", ["1", "3", "r", "w", "a", "s", "d", "g"]),
        ("fr", ["&", "\"", "r", "z", "q", "s", "d", "g"]),
        ("ru", ["1", "3", "к", "ц", "ф", "ы", "в", "п"]),
        ("gr", ["1", "3", "ρ", "ς", "α", "σ", "δ", "γ"]),
        ("ara", ["١", "٣", "ق", "ص", "ش", "س", "ي", "ل"]),
        ("il", ["1", "3", "ר", "'", "ש", "ד", "ג", "ע"]),
    ];
    const PLACES: [KeyCode; 8] = [
        KeyCode::Digit1,
        KeyCode::Digit3,
        KeyCode::KeyR,
        KeyCode::KeyW,
        KeyCode::KeyA,
        KeyCode::KeyS,
        KeyCode::KeyD,
        KeyCode::KeyG,
    ];

    #[test]
    fn every_layout_has_digits_and_letters() {
        let all = actions(&[]);
        let usual = ["guide-tentacles", "guide-path", "reverse", "forward", "left", "back", "right", "guide"];
        for (name, printed) in LAYOUTS {
            for ((place, printed), usual) in PLACES.into_iter().zip(printed).zip(usual) {
                let found = id(&all, &stroke(place, printed, printed, false, false));
                assert_eq!(found.as_deref(), Some(usual), "{name}: {printed}");
            }
        }
    }

    #[test]
    fn what_a_layout_prints_counts_first() {
        let all = actions(&[]);
        // The places of Q on a French and on a Greek keyboard.
        for (printed, wanted) in [("a", "left"), (";", "roll-left")] {
            let found = id(&all, &stroke(KeyCode::KeyQ, printed, printed, false, false));
            assert_eq!(found.as_deref(), Some(wanted), "{printed}");
        }
    }

    #[test]
    fn shift_and_control_are_those_of_the_place() {
        let all = actions(&[]);
        let find = |s: Stroke| id(&all, &s);
        assert_eq!(find(stroke(KeyCode::Period, "ю", "Ю", true, false)).as_deref(), Some("roll-right"));
        assert_eq!(find(stroke(KeyCode::KeyG, "п", "П", true, false)).as_deref(), Some("guide"));
        assert_eq!(find(stroke(KeyCode::KeyZ, "я", "я", false, true)).as_deref(), Some("undo"));
        assert_eq!(find(stroke(KeyCode::Digit1, "&", "&", false, true)).as_deref(), Some("window-colon"));
        assert_eq!(find(stroke(KeyCode::Digit3, "\"", "3", true, false)).as_deref(), Some("guide-path"));
        // Another character on purpose: a US keyboard with Shift, a German one with AltGr.
        assert_eq!(find(stroke(KeyCode::Digit3, "3", "#", true, false)), None);
        assert_eq!(find(stroke(KeyCode::Digit3, "3", "№", true, false)), None);
        assert_eq!(find(stroke(KeyCode::KeyE, "e", "€", false, false)), None);
        assert_eq!(find(stroke(KeyCode::Minus, "ß", "\\", false, false)), None);
        // A dead key, as on French keyboards.
        let dead = Stroke { logical: Key::Dead(Some('^')), ..stroke(KeyCode::BracketLeft, "^", "^", false, false) };
        assert_eq!(find(dead).as_deref(), Some("narrower"));
    }

    #[test]
    fn a_key_of_the_settings_is_what_its_layout_prints() {
        let all = actions(&[("measure", "\""), ("light", "П")]);
        assert_eq!(id(&all, &stroke(KeyCode::Digit3, "\"", "\"", false, false)).as_deref(), Some("measure"));
        assert_eq!(id(&all, &stroke(KeyCode::KeyG, "п", "п", false, false)).as_deref(), Some("light"));
    }

    #[test]
    fn a_key_releases_what_it_pressed() {
        let (w, a) = (KeyCode::KeyW.into(), KeyCode::KeyA.into());
        let mut pressed = Pressed::default();
        pressed.press(w, Hold::Forward);
        pressed.press(a, Hold::Left);
        // A held key repeats, here after the layout has changed.
        pressed.press(w, Hold::Up);
        assert_eq!((pressed.release(w), pressed.release(w)), (Some(Hold::Up), None));
        assert_eq!(pressed.release(a), Some(Hold::Left));
    }

    #[test]
    fn places_and_characters_are_there_once() {
        for (n, (code, plain, shifted)) in US.iter().enumerate() {
            assert!(
                US[..n].iter().all(|o| o.0 != *code && ![o.1, o.2].contains(plain) && ![o.1, o.2].contains(shifted))
            );
        }
    }
}
