//! What the keys of the reader's keyboard print, so that lists of keys and messages name them as they are labelled.
//!
//! An X server tells it for the whole keyboard. Elsewhere it is learnt from the keys that are pressed.

use std::collections::BTreeMap;

use winit::keyboard::KeyCode;
use winit::window::Window;

use super::keys::Chord;
use super::stroke::{Printing, Stroke, US};
use super::x11;

/// What keys print, as far as it is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Printed {
    /// What the window system told last.
    told: Vec<(KeyCode, Printing)>,
    /// The same, and what was learnt since then.
    keys: BTreeMap<KeyCode, Printing>,
}

impl Printed {
    /// Asks the window system. Another answer than the last one replaces what was learnt; a second layout that a key switches to is
    /// not told, and has to be learnt.
    pub(crate) fn ask(&mut self, window: &Window) {
        // Without an answer, what is known stays.
        if let Some(told) = x11::printed(window) {
            self.tell(told);
        }
    }

    pub(super) fn tell(&mut self, told: Vec<(KeyCode, Printing)>) {
        if told != self.told {
            let lower = |c: char| c.to_lowercase().next().unwrap_or(c);
            self.keys = told.iter().map(|&(code, printing)| (code, printing.map(|c| c.map(lower)))).collect();
            self.told = told;
        }
    }

    /// Learns from a key that was pressed without modifiers. Returns true if it printed something else than was known.
    pub(crate) fn learn(&mut self, stroke: &Stroke) -> bool {
        let Some((code, printed)) = stroke.printed() else { return false };
        let Some(&(_, us, _)) = US.iter().find(|k| k.0 == code) else { return false };
        let known = self.keys.get(&code).map_or(Some(us), |p| p[0]);
        if known == Some(printed) {
            return false;
        }
        self.keys.entry(code).or_default()[0] = Some(printed);
        true
    }

    /// Returns the name of a key, by what it prints.
    pub(crate) fn name(&self, key: &Chord) -> String {
        let printed = key.letter().and_then(|letter| self.instead_of(letter));
        printed.map_or_else(|| key.to_string(), |letter| key.with_letter(letter).to_string())
    }

    /// Returns what the key prints that has the place of `key` on a US keyboard; `None` if `key` is right as it is: something prints
    /// it, or nothing is known.
    pub(crate) fn instead_of(&self, key: char) -> Option<char> {
        let &(code, plain, _) = US.iter().find(|k| k.1 == key || k.2 == key)?;
        let level = usize::from(plain != key);
        // Unknown keys are those of a US keyboard.
        let prints =
            |code: KeyCode, us: Printing| self.keys.get(&code).copied().unwrap_or(us)[..=level].contains(&Some(key));
        if US.iter().any(|k| prints(k.0, [Some(k.1), Some(k.2)])) {
            return None;
        }
        self.keys.get(&code).and_then(|p| p[level]).filter(|&c| c != key)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(keys: &[(KeyCode, char, char)]) -> Printed {
        let mut printed = Printed::default();
        printed.tell(keys.iter().map(|k| (k.0, [Some(k.1), Some(k.2)])).collect());
        printed
    }

    #[test]
    fn digits_of_a_french_keyboard_are_named_by_what_they_print() {
        let french = layout(&[
            (KeyCode::Digit1, '&', '1'),
            (KeyCode::Digit3, '"', '3'),
            (KeyCode::KeyQ, 'a', 'A'),
            (KeyCode::KeyA, 'q', 'Q'),
            (KeyCode::Comma, ';', '.'),
            (KeyCode::KeyM, ',', '?'),
            (KeyCode::Slash, '!', '§'),
            (KeyCode::Period, ':', '/'),
        ]);
        let named = |c: char| french.instead_of(c).unwrap_or(c);
        // Digits need Shift there; letters, the comma and the question mark are on other keys.
        assert_eq!("13aq,?".chars().map(named).collect::<String>(), "&\"aq,?");
        assert_eq!(named('.'), ':', "the full stop needs Shift there");
    }

    #[test]
    fn letters_of_a_russian_keyboard_are_named_by_what_they_print() {
        let russian = layout(&[(KeyCode::KeyW, 'ц', 'Ц'), (KeyCode::KeyH, 'р', 'Р'), (KeyCode::Digit3, '3', '№')]);
        assert_eq!([russian.instead_of('w'), russian.instead_of('h')], [Some('ц'), Some('р')]);
        assert_eq!([russian.instead_of('3'), russian.instead_of('j')], [None, None]);
        assert_eq!([None, None], ['w', '?'].map(|c| Printed::default().instead_of(c)));
    }

    #[test]
    fn what_is_pressed_is_learnt_once() {
        let mut printed = Printed::default();
        assert!(!printed.learn(&Stroke::typed(KeyCode::KeyW, "w")), "as on a US keyboard");
        assert!(
            printed.learn(&Stroke::typed(KeyCode::KeyW, "ц")) && !printed.learn(&Stroke::typed(KeyCode::KeyW, "ц"))
        );
        assert_eq!(printed.instead_of('w'), Some('ц'));
        assert!(printed.learn(&Stroke::typed(KeyCode::KeyW, "w")), "back to the other layout");
        assert_eq!(printed.instead_of('w'), None);

        // Until the window system tells something else.
        let mut switched = layout(&[(KeyCode::KeyW, 'w', 'W'), (KeyCode::KeyH, 'h', 'H')]);
        assert!(
            switched.learn(&Stroke::typed(KeyCode::KeyW, "ц")) && switched.learn(&Stroke::typed(KeyCode::KeyH, "р"))
        );
        switched.tell(switched.told.clone());
        assert_eq!(['w', 'h'].map(|c| switched.instead_of(c)), [Some('ц'), Some('р')]);
        switched.tell(vec![(KeyCode::KeyW, [Some('z'), Some('Z')])]);
        assert_eq!(['w', 'h'].map(|c| switched.instead_of(c)), [Some('z'), None]);
    }
}
