//! Which candidates a list shows, and in which order.

use std::cmp::Ordering;

use super::search::Entry;
use crate::fields::AlongColon;

/// An order of candidates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// The highest score first.
    #[default]
    Score,
    /// From the rectum on; without a known order, segment by segment. What is nowhere along the colon comes last.
    Along,
}

/// What a list of candidates shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Showing {
    /// The order.
    pub order: Order,
    /// The smallest diameter, mm. A candidate whose diameter is not known is shown.
    pub least_mm: u32,
    /// True if candidates with an answer are hidden.
    pub hides_answered: bool,
}

/// What of a candidate decides whether and where it is listed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Facts {
    pub(crate) along: Option<AlongColon>,
    pub(crate) diameter_mm: Option<f64>,
    /// Its score; that of both positions if it was found twice.
    pub(crate) score: f64,
}

impl Facts {
    pub(super) fn of(entry: &Entry) -> Self {
        let diameter_mm = entry.candidate.lesion.as_ref().map(|l| l.diameter_mm);
        Self { along: entry.along, diameter_mm, score: entry.candidate.score }
    }

    /// True if the diameter, as lists tell it, is at least so large.
    fn is_from(&self, least_mm: u32) -> bool {
        self.diameter_mm.is_none_or(|mm| (mm * 10.0).round() / 10.0 >= f64::from(least_mm))
    }

    /// Compares places along the colon.
    fn by_place(&self, other: &Self) -> Ordering {
        // Where one line leads through all segments, it alone counts.
        let key = |a: AlongColon| (if a.part.is_some() { 0 } else { a.segment }, a.mm);
        match (self.along.map(key), other.along.map(key)) {
            (Some((s, a)), Some((t, b))) => s.cmp(&t).then(a.total_cmp(&b)),
            (a, b) => a.is_none().cmp(&b.is_none()),
        }
    }
}

impl Showing {
    /// Returns the candidates that are listed, by their numbers from 0. `facts` and `is_answered` tell of each of `count`, and the one
    /// that is looked at is listed in any case.
    pub(super) fn list(
        &self,
        count: usize,
        facts: impl Fn(usize) -> Facts,
        is_answered: impl Fn(usize) -> bool,
        current: Option<usize>,
    ) -> Vec<usize> {
        let is_listed = |&n: &usize| {
            current == Some(n) || (facts(n).is_from(self.least_mm) && !(self.hides_answered && is_answered(n)))
        };
        let mut list: Vec<usize> = (0..count).filter(is_listed).collect();
        // Those that are alike stay in the order of the list.
        match self.order {
            Order::Score => list.sort_by(|&a, &b| facts(b).score.total_cmp(&facts(a).score)),
            Order::Along => list.sort_by(|&a, &b| facts(a).by_place(&facts(b))),
        }
        list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_is_ordered_and_filtered() {
        let along = |segment, mm, part| Some(AlongColon { segment, mm, part, is_guessed: false });
        let facts = |n: usize| match n {
            0 => Facts { along: along(1, 700.0, Some("cecum")), diameter_mm: Some(5.96), score: 0.9 },
            1 => Facts { along: along(2, 90.0, Some("sigmoid")), diameter_mm: Some(12.0), score: 0.8 },
            2 => Facts { along: None, diameter_mm: None, score: 0.7 },
            _ => Facts { along: along(0, 90.0, Some("sigmoid")), diameter_mm: Some(5.9), score: 0.7 },
        };
        let list = |showing: Showing, current| showing.list(4, facts, |n| n == 1, current);
        let all = Showing::default();
        let by_place = Showing { order: Order::Along, ..all };
        assert_eq!(list(all, None), [0, 1, 2, 3]);
        assert_eq!(list(by_place, None), [1, 3, 0, 2]);
        // One that was found in both positions rises.
        let risen = |n: usize| Facts { score: if n == 3 { 0.95 } else { facts(n).score }, ..facts(n) };
        assert_eq!(all.list(4, risen, |_| false, None), [3, 0, 1, 2]);
        // As the list tells it, the first is 6.0 mm wide.
        assert_eq!(list(Showing { least_mm: 6, ..by_place }, None), [1, 0, 2]);
        let open = Showing { hides_answered: true, ..by_place };
        assert_eq!((list(open, None), list(open, Some(1))), (vec![3, 0, 2], vec![1, 3, 0, 2]));
        // Without an order of the segments, each has a measure of its own.
        let alone =
            |n: usize| Facts { along: along(2 - n, [10.0, 90.0, 50.0][n], None), diameter_mm: None, score: 0.0 };
        assert_eq!(by_place.list(3, alone, |_| false, None), [2, 1, 0]);
    }
}
