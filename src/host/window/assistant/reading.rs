//! A reader's way through the candidates: which one is looked at, and what was said of each, stored at once for the next time.

use std::path::PathBuf;

use glam::DVec3;

use super::showing::{Facts, Showing};
use crate::error::{Error, Result};
use crate::output;
use crate::polyps::answers::{Answer, Answered, Answers};

/// Answers belong to the candidate within this distance, mm.
const SAME_MM: f64 = 1.0;
/// Maximum number of changes that can be undone.
const UNDONE: usize = 100;

/// What is said of a candidate.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Said {
    pub(crate) answer: Option<Answer>,
    pub(crate) note: String,
}

impl Said {
    fn is_empty(&self) -> bool {
        self.answer.is_none() && self.note.is_empty()
    }
}

/// A change that can be undone: what was said before.
#[derive(Debug)]
struct Change {
    /// Candidates by their numbers, from 0.
    before: Vec<(usize, Said)>,
    /// True if a note was written. Letter by letter, it is one change.
    is_note: bool,
}

/// The state of a reading.
#[derive(Debug, Default)]
pub(crate) struct Reading {
    /// Places of the candidates, world mm, best first.
    places: Vec<DVec3>,
    said: Vec<Said>,
    /// Answers to places that are not in the list. They are stored with the others.
    others: Vec<Answered>,
    current: Option<usize>,
    /// What is known of the candidates, and which of them the list shows.
    facts: Vec<Facts>,
    showing: Showing,
    changes: Vec<Change>,
    /// Number of changes ever made.
    made: u64,
    /// True if letters of a note that follow belong to the last change.
    is_writing: bool,
    /// The file of the answers; `None` if they are not stored.
    file: Option<PathBuf>,
    /// True if they are not stored for the time being.
    is_held: bool,
}

impl Reading {
    /// Begins to read candidates at these places (world, mm), with the answers stored in a file. If that is damaged, returns its
    /// error too; there are no answers then, and the file is not overwritten.
    pub(crate) fn open(places: Vec<DVec3>, file: Option<PathBuf>) -> (Self, Option<Error>) {
        let said = vec![Said::default(); places.len()];
        let mut made = Self { places, said, file, ..Self::default() };
        let Some(path) = made.file.as_ref().filter(|f| f.exists()) else { return (made, None) };
        match Answers::read(path) {
            Ok(answers) => {
                made.take(&answers);
                (made, None)
            }
            Err(e) => {
                made.file = None;
                (made, Some(e))
            }
        }
    }

    /// Takes what is known of the candidates, in their order.
    pub(super) fn know(&mut self, facts: Vec<Facts>) {
        self.facts = facts;
    }

    /// Returns what the list shows.
    pub(crate) fn showing(&self) -> Showing {
        self.showing
    }

    /// Sets what the list shows.
    pub(crate) fn show(&mut self, showing: Showing) {
        self.showing = showing;
    }

    /// Returns the numbers of the candidates, as the list shows them. The one that is looked at is always among them.
    pub(crate) fn shown(&self) -> Vec<usize> {
        let facts = |n: usize| self.facts.get(n).copied().unwrap_or_default();
        self.showing.list(self.places.len(), facts, |n| self.said[n].answer.is_some(), self.current)
    }

    /// Returns the number of candidates.
    pub(crate) fn count(&self) -> usize {
        self.places.len()
    }

    /// Returns what is said of a candidate, by its number from 0.
    pub(crate) fn said(&self, n: usize) -> Option<&Said> {
        self.said.get(n)
    }

    /// Returns the candidate that is looked at.
    pub(crate) fn current(&self) -> Option<usize> {
        self.current
    }

    /// Returns the number of candidates with an answer.
    pub(crate) fn answered(&self) -> usize {
        self.said.iter().filter(|s| s.answer.is_some()).count()
    }

    /// Returns the number of changes that were ever made; undoing counts as none.
    pub(crate) fn changes_made(&self) -> u64 {
        self.made
    }

    /// Ends the note that is being written: letters that follow are another change.
    pub(crate) fn end_note(&mut self) {
        self.is_writing = false;
    }

    /// True if a change can be undone.
    pub(crate) fn may_undo(&self) -> bool {
        !self.changes.is_empty()
    }

    /// Goes to a candidate. Returns it if it exists.
    pub(crate) fn select(&mut self, n: usize) -> Option<usize> {
        let n = (n < self.places.len()).then_some(n)?;
        self.current = Some(n);
        Some(n)
    }

    /// Goes to the next candidate of the list as it is shown, or the first after the last, or backwards. Returns it; `None` if the list
    /// is empty.
    pub(crate) fn step(&mut self, forward: bool) -> Option<usize> {
        let list = self.shown();
        let last = list.len().checked_sub(1)?;
        let next = match (self.row(&list), forward) {
            (None, true) => 0,
            (None, false) => last,
            (Some(row), true) => (row + 1) % (last + 1),
            (Some(row), false) => row.checked_sub(1).unwrap_or(last),
        };
        self.select(list[next])
    }

    /// Goes to the next candidate without an answer of the list as it is shown, from the first again after the last. Returns it; `None`
    /// if all in it are answered.
    pub(crate) fn step_to_open(&mut self) -> Option<usize> {
        let list = self.shown();
        let next = self.row(&list).map_or(0, |row| row + 1);
        let is_open = |n: &&usize| self.said[**n].answer.is_none();
        let open = list[next..].iter().chain(&list[..next]).find(is_open).copied()?;
        self.select(open)
    }

    /// Returns the row of the candidate that is looked at.
    fn row(&self, list: &[usize]) -> Option<usize> {
        list.iter().position(|n| self.current == Some(*n))
    }

    /// Answers for the candidate that is looked at.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be stored. The answer is there nevertheless.
    pub(crate) fn answer(&mut self, answer: Answer) -> Result<()> {
        let Some(n) = self.current else { return Ok(()) };
        let said = Said { answer: Some(answer), ..self.said[n].clone() };
        self.change(vec![(n, said)], false)
    }

    /// Writes the note of a candidate.
    ///
    /// # Errors
    /// As [`Reading::answer`].
    pub(crate) fn note(&mut self, n: usize, note: String) -> Result<()> {
        let Some(said) = self.said.get(n) else { return Ok(()) };
        self.change(vec![(n, Said { note, ..said.clone() })], true)
    }

    /// Undoes the last change, and goes back to the candidate that it was about, unless there were several. Returns it, or the first.
    ///
    /// # Errors
    /// As [`Reading::answer`].
    pub(crate) fn undo(&mut self) -> Result<Option<usize>> {
        self.is_writing = false;
        let Some(change) = self.changes.pop() else { return Ok(None) };
        let first = change.before.first().map(|b| b.0);
        if let [(only, _)] = change.before[..] {
            self.current = Some(only);
        }
        for (n, said) in change.before {
            self.said[n] = said;
        }
        self.keep()?;
        Ok(first)
    }

    /// Adds answers from elsewhere: each to the candidate within 1 mm. An answer or a note replaces the one that is there. Returns how
    /// many belong to candidates.
    ///
    /// # Errors
    /// As [`Reading::answer`].
    pub(crate) fn merge(&mut self, answers: &Answers) -> Result<usize> {
        let said = self.said.clone();
        let count = self.take(answers);
        let merged = std::mem::replace(&mut self.said, said);
        let new = merged.into_iter().enumerate().filter(|(n, s)| self.said[*n] != *s).collect();
        self.change(new, false)?;
        Ok(count)
    }

    /// Takes answers over without storing them. Returns how many belong to candidates.
    fn take(&mut self, answers: &Answers) -> usize {
        let mut count = 0;
        for a in &answers.answers {
            let near = |p: &DVec3| p.distance(a.position);
            let nearest = self.places.iter().enumerate().min_by(|a, b| near(a.1).total_cmp(&near(b.1)));
            let Some((n, _)) = nearest.filter(|n| near(n.1) <= SAME_MM) else {
                self.others.retain(|o| near(&o.position) > SAME_MM);
                self.others.push(a.clone());
                continue;
            };
            count += 1;
            let said = &mut self.said[n];
            said.answer = a.answer.or(said.answer);
            if !a.note.is_empty() {
                said.note.clone_from(&a.note);
            }
        }
        count
    }

    fn change(&mut self, new: Vec<(usize, Said)>, is_note: bool) -> Result<()> {
        let mut before = Vec::new();
        for (n, said) in new {
            if self.said[n] != said {
                before.push((n, std::mem::replace(&mut self.said[n], said)));
            }
        }
        let goes_on = is_note
            && self.is_writing
            && self
                .changes
                .last()
                .is_some_and(|c| c.is_note && c.before.iter().map(|b| b.0).eq(before.iter().map(|b| b.0)));
        if !before.is_empty() && !goes_on {
            self.made += 1;
            self.is_writing = is_note;
            self.changes.push(Change { before, is_note });
            let more = self.changes.len().saturating_sub(UNDONE);
            self.changes.drain(..more);
        }
        self.keep()
    }

    /// Stores the answers from now on, with those that were given until now, or not for the time being.
    ///
    /// # Errors
    /// As [`Reading::answer`].
    pub(super) fn keep_now(&mut self, keeps: bool) -> Result<()> {
        self.is_held = !keeps;
        if self.made > 0 { self.keep() } else { Ok(()) }
    }

    /// Stores all answers, in one piece.
    fn keep(&self) -> Result<()> {
        let Some(path) = self.file.as_ref().filter(|_| !self.is_held) else { return Ok(()) };
        let own = self.places.iter().zip(&self.said).enumerate().filter(|(_, (_, s))| !s.is_empty());
        let own = own.map(|(n, (place, said))| Answered {
            rank: n + 1,
            position: *place,
            answer: said.answer,
            note: said.note.clone(),
        });
        // The ranks of a file differ.
        let beyond = self.places.len() + 1;
        let others = self.others.iter().enumerate().map(|(n, o)| Answered { rank: beyond + n, ..o.clone() });
        // Not the scan's name, which may identify the patient.
        let scan = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        if let Some(folder) = path.parent() {
            output::make_folder(folder)?;
        }
        Answers { scan, answers: own.chain(others).collect() }.write(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places() -> Vec<DVec3> {
        [0.0, 10.0, 20.0].map(|x| DVec3::new(x, -5.0, 1.5)).to_vec()
    }

    fn answered(rank: usize, x: f64, answer: Option<Answer>, note: &str) -> Answered {
        Answered { rank, position: DVec3::new(x, -5.0, 1.5), answer, note: note.to_owned() }
    }

    #[test]
    fn candidates_follow_each_other_in_a_circle() {
        let mut r = Reading::open(places(), None).0;
        assert_eq!((r.current(), r.step(false)), (None, Some(2)));
        assert_eq!([r.step(true), r.step(true), r.step(false)], [Some(0), Some(1), Some(0)]);
        assert_eq!((r.select(2), r.select(3), r.current()), (Some(2), None, Some(2)));
        let mut none = Reading::open(Vec::new(), None).0;
        assert_eq!((none.step(true), none.step(false)), (None, None));
        none.answer(Answer::Yes).unwrap();
        assert!(!none.may_undo());
    }

    #[test]
    fn a_reading_follows_the_list_as_it_is_shown() {
        let mut r = Reading::open(places(), None).0;
        let sizes = [4.0, 12.0, 7.0];
        r.know(sizes.map(|mm| Facts { along: None, diameter_mm: Some(mm) }).to_vec());
        r.show(Showing { least_mm: 6, ..Showing::default() });
        assert_eq!([r.step(true), r.step(true), r.step(true), r.step(false)], [Some(1), Some(2), Some(1), Some(2)]);
        r.show(Showing { hides_answered: true, ..r.showing() });
        r.answer(Answer::No).unwrap();
        assert_eq!(r.shown(), [1, 2], "the one that is looked at stays");
        assert_eq!((r.step_to_open(), r.shown()), (Some(1), vec![1]));
        r.answer(Answer::Yes).unwrap();
        assert_eq!((r.step_to_open(), r.answered(), r.count()), (None, 2, 3));
        // What is undone is gone back to.
        r.select(0);
        assert_eq!((r.undo().unwrap(), r.current()), (Some(1), Some(1)));
        assert_eq!((r.undo().unwrap(), r.current()), (Some(2), Some(2)));
        assert_eq!(r.step_to_open(), Some(1));
    }

    #[test]
    fn answers_and_notes_survive_and_are_undone() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("answers").join("00ff.json");
        let (mut r, e) = Reading::open(places(), Some(file.clone()));
        assert!(e.is_none());
        r.answer(Answer::Yes).unwrap();
        assert!(!file.exists(), "no candidate is looked at");
        r.select(1);
        r.answer(Answer::Yes).unwrap();
        r.answer(Answer::No).unwrap();
        for note in ["a", "a fo", "a fold"] {
            r.note(1, note.to_owned()).unwrap();
        }
        r.note(9, "nowhere".to_owned()).unwrap();
        let again = Reading::open(places(), Some(file.clone())).0;
        assert_eq!(again.said, r.said);
        assert_eq!((again.said(1).unwrap().note.as_str(), again.answered()), ("a fold", 1));
        // A note is one change, however many letters it has.
        assert_eq!(r.undo().unwrap(), Some(1));
        assert_eq!(*r.said(1).unwrap(), Said { answer: Some(Answer::No), note: String::new() });
        r.undo().unwrap();
        assert_eq!(r.said(1).unwrap().answer, Some(Answer::Yes));
        r.undo().unwrap();
        assert!(!r.may_undo() && r.undo().unwrap().is_none());
        assert_eq!(Reading::open(places(), Some(file.clone())).0.answered(), 0, "what was undone is stored too");
        assert_eq!(Answers::read(&file).unwrap().scan, "00ff");
    }

    #[test]
    fn answers_from_elsewhere_belong_to_places() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a.json");
        let mut r = Reading::open(places(), Some(file.clone())).0;
        r.select(0);
        r.answer(Answer::No).unwrap();
        r.note(2, "mine".to_owned()).unwrap();
        let more = Answers {
            scan: "other.nii".to_owned(),
            answers: vec![
                answered(7, 0.9, Some(Answer::Yes), ""),
                answered(3, 20.5, None, "theirs"),
                answered(2, 15.0, Some(Answer::Unsure), "not in the list"),
            ],
        };
        assert_eq!(r.merge(&more).unwrap(), 2);
        let said = |r: &Reading, n: usize| r.said(n).cloned().unwrap();
        assert_eq!(said(&r, 0).answer, Some(Answer::Yes));
        assert_eq!(said(&r, 2), Said { answer: None, note: "theirs".to_owned() });
        // What belongs to no candidate is stored too, once.
        r.merge(&more).unwrap();
        let kept = Answers::read(&file).unwrap();
        assert_eq!(kept.answers.iter().map(|a| a.rank).collect::<Vec<_>>(), [1, 3, 4]);
        assert_eq!(kept.answers[2].note, "not in the list");
        // With a longer list it has its candidate.
        let more = [places(), vec![DVec3::new(15.2, -5.0, 1.5)]].concat();
        assert_eq!(Reading::open(more, Some(file)).0.said(3).unwrap().answer, Some(Answer::Unsure));
        // All of a merge is undone at once.
        r.undo().unwrap();
        assert_eq!((said(&r, 0).answer, said(&r, 2).note.as_str()), (Some(Answer::No), "mine"));
    }

    #[test]
    fn what_is_damaged_is_left_and_what_cannot_be_stored_is_told() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a.json");
        std::fs::write(&file, "{\"colvis\": \"answers\"").unwrap();
        let (mut r, e) = Reading::open(places(), Some(file.clone()));
        assert!(!e.unwrap().to_string().contains('\n'));
        r.select(0);
        r.answer(Answer::Yes).unwrap();
        assert_eq!(r.answered(), 1);
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "{\"colvis\": \"answers\"");
        // The folder is a file.
        let (mut r, _) = Reading::open(places(), Some(file.join("b.json")));
        r.select(0);
        assert_eq!(r.answer(Answer::Yes).unwrap_err().kind as i32, 5);
        assert_eq!(r.answered(), 1);
    }
}
