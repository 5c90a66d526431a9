//! The order of changes to distances, answers and kinds, each of which keeps its own: so the last change of all is undone first.

use std::time::Instant;

use super::FlightController;
use crate::host::window::assistant::Assistant;
use crate::host::window::measures::Measures;

/// Maximum number of changes that are remembered: more than all stores keep together.
const MOST: usize = 1000;

/// What a change was made to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Store {
    Distances,
    Answers,
    Kinds,
}

const STORES: [Store; 3] = [Store::Distances, Store::Answers, Store::Kinds];

/// The changes in the order in which they were made.
#[derive(Debug, Default)]
pub(super) struct History {
    done: Vec<Store>,
    /// Number of changes that each store had ever made when it was last looked at.
    noted: [u64; 3],
    /// Number of changes before the first end of a distance was clicked.
    begun: usize,
}

impl History {
    /// Adds what the stores have changed since the last call; `made` is how many changes each has ever made.
    fn note(&mut self, made: [u64; 3]) {
        for ((store, made), noted) in STORES.into_iter().zip(made).zip(&mut self.noted) {
            let new = made.saturating_sub(*noted).min(MOST as u64) as usize;
            self.done.extend(std::iter::repeat_n(store, new));
            *noted = made;
        }
        let more = self.done.len().saturating_sub(MOST);
        self.done.drain(..more);
        self.begun = self.begun.saturating_sub(more);
    }

    /// Forgets the last change of a store, which has undone it.
    fn forget_last(&mut self, store: Store) {
        if let Some(n) = self.done.iter().rposition(|s| *s == store) {
            self.done.remove(n);
            self.begun -= usize::from(n < self.begun);
        }
    }
}

impl FlightController {
    /// Notes what was changed. Call it after each change, so that the order is that of the changes.
    pub(super) fn note_changes(&mut self) {
        let answers = self.assistant.as_ref().map_or(0, |a| a.reading().changes_made());
        let before = self.history.done.len();
        self.history.note([self.measures.changes_made(), answers, self.kinds.changes_made()]);
        if self.history.done[before.min(self.history.done.len())..].iter().any(|s| *s != Store::Answers) {
            self.end_note();
        }
    }

    /// Notes that the first end of a distance was clicked.
    pub(super) fn note_begun(&mut self) {
        self.history.begun = self.history.done.len();
    }

    /// Letters that follow are a change of their own.
    fn end_note(&mut self) {
        if let Some(assistant) = &mut self.assistant {
            assistant.reading_mut().end_note();
        }
    }

    /// Undoes the last change to answers, and goes back to the candidate that it was about.
    pub(super) fn undo_answer(&mut self, now: Instant) {
        self.note_changes();
        self.history.forget_last(Store::Answers);
        self.end_note();
        if let Some(assistant) = &mut self.assistant {
            let before = assistant.reading().current();
            let kept = assistant.reading_mut().undo();
            let undone = kept.as_ref().ok().copied().flatten();
            assistant.report(kept.map(drop));
            // Not to the first of many.
            if let Some(n) = undone.filter(|_| assistant.reading().current() == undone) {
                self.return_to(n, before, now);
            }
        }
    }

    /// Undoes the last change to distances, answers or kinds, or discards the first end of a distance if nothing was changed since.
    pub(crate) fn undo(&mut self, now: Instant) {
        self.note_changes();
        if self.history.done.len() <= self.history.begun && self.measures.discard_begun() {
            return;
        }
        // A store forgets its oldest changes.
        let may_undo = |c: &Self, store| match store {
            Store::Distances => Measures::may_undo(&c.measures),
            Store::Answers => c.assistant.as_deref().map(Assistant::reading).is_some_and(|r| r.may_undo()),
            Store::Kinds => c.kinds.may_undo(),
        };
        while let Some(&store) = self.history.done.last() {
            if may_undo(self, store) {
                match store {
                    Store::Distances => {
                        let kept = self.measures.undo();
                        self.report_kept(kept, now);
                    }
                    Store::Answers => return self.undo_answer(now),
                    Store::Kinds => self.undo_kind(now),
                }
                self.end_note();
                self.history.done.pop();
                return;
            }
            self.history.done.pop();
        }
    }
}
