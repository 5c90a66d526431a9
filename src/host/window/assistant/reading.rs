//! A reader's way through the candidates: which one is looked at, and what was said of each.

use glam::DVec3;

use super::showing::{Facts, Showing};
use crate::polyps::answers::{Answer, Answered};

/// Answers belong to the candidate within this distance, mm.
const SAME_MM: f64 = 1.0;

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
}

impl Reading {
    /// Begins to read candidates at these places (world, mm), with the answers that were given before.
    pub(crate) fn open(places: Vec<DVec3>, answers: &[Answered]) -> Self {
        let said = vec![Said::default(); places.len()];
        let mut made = Self { places, said, ..Self::default() };
        made.merge(answers);
        made
    }

    /// Takes what is known of the candidates, in their order.
    pub(super) fn know(&mut self, facts: Vec<Facts>) {
        self.facts = facts;
    }

    /// Sets the scores of those that were found in both positions, by their numbers from 0.
    pub(crate) fn raise(&mut self, scores: impl Iterator<Item = f64>) {
        self.facts.iter_mut().zip(scores).for_each(|(facts, score)| facts.score = score);
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

    /// Returns what is said of all candidates.
    pub(crate) fn all(&self) -> &[Said] {
        &self.said
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
    pub(crate) fn answer(&mut self, answer: Answer) {
        if let Some(n) = self.current {
            self.said[n].answer = Some(answer);
        }
    }

    /// Writes the note of a candidate.
    pub(crate) fn note(&mut self, n: usize, note: String) {
        if let Some(said) = self.said.get_mut(n) {
            said.note = note;
        }
    }

    /// Restores what was said before. Goes to the candidate that it is about, unless there are several, and returns it.
    pub(crate) fn restore(&mut self, said: Vec<Said>) -> Option<usize> {
        let mut changed = self.said.iter().zip(&said).enumerate().filter(|(_, (a, b))| a != b).map(|(n, _)| n);
        let only = changed.next().filter(|_| changed.next().is_none());
        self.said = said;
        self.current = only.or(self.current);
        only
    }

    /// Adds answers from elsewhere: each to the candidate within 1 mm. An answer or a note replaces the one that is there. Returns how
    /// many belong to candidates.
    pub(crate) fn merge(&mut self, answers: &[Answered]) -> usize {
        let mut count = 0;
        for a in answers {
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

    /// Returns all answers: those of candidates, and then those to other places.
    pub(crate) fn answers(&self) -> Vec<Answered> {
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
        own.chain(others).collect()
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
        let mut r = Reading::open(places(), &[]);
        assert_eq!((r.current(), r.step(false)), (None, Some(2)));
        assert_eq!([r.step(true), r.step(true), r.step(false)], [Some(0), Some(1), Some(0)]);
        assert_eq!((r.select(2), r.select(3), r.current()), (Some(2), None, Some(2)));
        let mut none = Reading::open(Vec::new(), &[]);
        assert_eq!((none.step(true), none.step(false)), (None, None));
        none.answer(Answer::Yes);
        assert!(none.answers().is_empty());
    }

    #[test]
    fn a_reading_follows_the_list_as_it_is_shown() {
        let mut r = Reading::open(places(), &[]);
        let sizes = [4.0, 12.0, 7.0];
        r.know(sizes.map(|mm| Facts { along: None, diameter_mm: Some(mm), score: 0.0 }).to_vec());
        r.show(Showing { least_mm: 6, ..Showing::default() });
        assert_eq!([r.step(true), r.step(true), r.step(true), r.step(false)], [Some(1), Some(2), Some(1), Some(2)]);
        r.show(Showing { hides_answered: true, ..r.showing() });
        let before = [r.all().to_vec()];
        r.answer(Answer::No);
        assert_eq!(r.shown(), [1, 2], "the one that is looked at stays");
        assert_eq!((r.step_to_open(), r.shown()), (Some(1), vec![1]));
        let before = [&before[..], &[r.all().to_vec()]].concat();
        r.answer(Answer::Yes);
        assert_eq!((r.step_to_open(), r.answered(), r.count()), (None, 2, 3));
        // What is undone is gone back to.
        r.select(0);
        assert_eq!((r.restore(before[1].clone()), r.current()), (Some(1), Some(1)));
        assert_eq!((r.restore(before[0].clone()), r.current()), (Some(2), Some(2)));
        assert_eq!(r.step_to_open(), Some(1));
    }

    #[test]
    fn answers_from_elsewhere_belong_to_places() {
        let mut r = Reading::open(places(), &[]);
        r.select(0);
        r.answer(Answer::No);
        r.note(2, "mine".to_owned());
        let before = r.all().to_vec();
        let more = vec![
            answered(7, 0.9, Some(Answer::Yes), ""),
            answered(3, 20.5, None, "theirs"),
            answered(2, 15.0, Some(Answer::Unsure), "not in the list"),
        ];
        assert_eq!(r.merge(&more), 2);
        let said = |r: &Reading, n: usize| r.said(n).cloned().unwrap();
        assert_eq!(said(&r, 0).answer, Some(Answer::Yes));
        assert_eq!(said(&r, 2), Said { answer: None, note: "theirs".to_owned() });
        // What belongs to no candidate is kept too, once.
        r.merge(&more);
        let kept = r.answers();
        assert_eq!(kept.iter().map(|a| a.rank).collect::<Vec<_>>(), [1, 3, 4]);
        assert_eq!(kept[2].note, "not in the list");
        // With a longer list it has its candidate.
        let more = [places(), vec![DVec3::new(15.2, -5.0, 1.5)]].concat();
        assert_eq!(Reading::open(more, &kept).said(3).unwrap().answer, Some(Answer::Unsure));
        // All of a merge is undone at once.
        assert_eq!(r.restore(before), None);
        assert_eq!((said(&r, 0).answer, said(&r, 2).note.as_str()), (Some(Answer::No), "mine"));
    }
}
