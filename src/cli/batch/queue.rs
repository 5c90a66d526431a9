//! Which case is begun when: as many at once as there are cores for, and as memory allows.

use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What a case takes: some of it whatever the scan, and the more the larger its files are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Need {
    base: u64,
    /// For each byte of its files, before any case is known: with the voxels in 16 bits, and packed.
    factors: [f64; 2],
}

/// Memory, bytes.
pub(super) const MEMORY: Need = Need { base: 64 << 20, factors: [3.0, 12.0] };
/// Time of all steps on two cores, ms.
pub(super) const TIME: Need = Need { base: 10_000, factors: [1e-3, 4e-3] };

/// A case that waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Waiting {
    /// Its place in the manifest.
    pub case: usize,
    /// The memory that it is expected to take, bytes.
    pub memory: u64,
}

/// Cases in the order of the manifest.
#[derive(Debug)]
pub(super) struct Queue {
    waiting: Vec<Waiting>,
    running: Vec<Waiting>,
    jobs: usize,
    memory: u64,
}

impl Queue {
    /// Creates a queue that runs up to `jobs` cases at once in `memory` bytes.
    pub(super) fn new(waiting: Vec<Waiting>, jobs: usize, memory: u64) -> Self {
        Self { waiting, running: Vec::new(), jobs, memory }
    }

    /// Takes the first case that fits beside the running ones. One that fits nowhere runs alone.
    pub(super) fn next(&mut self) -> Option<Waiting> {
        if self.running.len() >= self.jobs {
            return None;
        }
        let taken: u64 = self.running.iter().map(|w| w.memory).sum();
        let fits = |w: &Waiting| self.running.is_empty() || taken.saturating_add(w.memory) <= self.memory;
        let at = self.waiting.iter().position(fits)?;
        let next = self.waiting.remove(at);
        self.running.push(next);
        Some(next)
    }

    /// Corrects what waiting cases are expected to take: `expected` tells it of a case, bytes, if something better is known.
    pub(super) fn correct(&mut self, expected: impl Fn(usize) -> Option<u64>) {
        for waiting in &mut self.waiting {
            waiting.memory = expected(waiting.case).unwrap_or(waiting.memory);
        }
    }

    /// Takes a case out that has ended.
    pub(super) fn end(&mut self, case: usize) {
        self.running.retain(|w| w.case != case);
    }

    /// Lets a case wait again that took `memory` bytes and more beside others: it is the next that runs, with room for more.
    pub(super) fn again(&mut self, case: usize, memory: u64) {
        self.end(case);
        self.waiting.insert(0, Waiting { case, memory: memory.saturating_add(memory / 2) });
    }
}

impl Need {
    /// Returns what is known from `cases` that ran: whether their files were packed, their bytes, and what they took. The most of them counts.
    pub(super) fn learn(mut self, cases: impl Iterator<Item = (bool, u64, u64)>) -> Self {
        let mut most = [None::<f64>; 2];
        for (packed, bytes, took) in cases.filter(|c| c.1 > 0 && c.2 > 0) {
            let factor = took.saturating_sub(self.base) as f64 / bytes as f64;
            let known = &mut most[usize::from(packed)];
            *known = Some(known.map_or(factor, |k| k.max(factor)));
        }
        for (factor, known) in self.factors.iter_mut().zip(most) {
            *factor = known.unwrap_or(*factor);
        }
        self
    }

    /// Returns what a scan of so many bytes is expected to take.
    pub(super) fn expected(&self, scan: &Path, bytes: u64) -> u64 {
        self.base + (bytes as f64 * self.factors[usize::from(is_packed(scan))]) as u64
    }
}

/// True if a scan's files are likely to be compressed.
pub(super) fn is_packed(scan: &Path) -> bool {
    scan.extension().is_some_and(|e| e == "gz" || e == "nrrd" || e == "mha")
}

/// The memory that running cases have, beside what they were expected to take.
#[derive(Debug)]
pub(super) struct Ledger {
    limit: u64,
    cases: Mutex<Vec<Entry>>,
}

#[derive(Debug)]
struct Entry {
    case: usize,
    expected: u64,
    now: u64,
}

impl Ledger {
    /// Creates a ledger of `limit` bytes.
    pub(super) fn new(limit: u64) -> Self {
        Self { limit, cases: Mutex::new(Vec::new()) }
    }

    fn cases(&self) -> MutexGuard<'_, Vec<Entry>> {
        self.cases.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes that a case begins.
    pub(super) fn begin(&self, next: Waiting) {
        self.cases().push(Entry { case: next.case, expected: next.memory, now: 0 });
    }

    /// Notes that a case has ended.
    pub(super) fn end(&self, case: usize) {
        self.cases().retain(|e| e.case != case);
    }

    /// Notes what a case has now, bytes. Returns true if all of them have more than the limit and this one exceeds what it was expected to
    /// take by the most.
    pub(super) fn is_too_large(&self, case: usize, now: u64) -> bool {
        let mut cases = self.cases();
        for entry in cases.iter_mut().filter(|e| e.case == case) {
            entry.now = now;
        }
        let all: u64 = cases.iter().map(|e| e.now).sum();
        let most = cases.iter().max_by_key(|e| (i128::from(e.now) - i128::from(e.expected), e.case));
        all > self.limit && most.is_some_and(|e| e.case == case)
    }

    /// Returns what a case was last seen to have, bytes.
    pub(super) fn now(&self, case: usize) -> u64 {
        self.cases().iter().find(|e| e.case == case).map_or(0, |e| e.now)
    }

    /// True if a case of so many bytes is within the limit by itself.
    pub(super) fn holds(&self, bytes: u64) -> bool {
        bytes <= self.limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_take_turns_where_memory_is_short() {
        let waiting =
            |memory: &[u64]| memory.iter().enumerate().map(|(case, &memory)| Waiting { case, memory }).collect();
        let mut queue = Queue::new(waiting(&[2, 3, 2, 9, 1]), 3, 4);
        let mut next = |ended: &[usize]| {
            ended.iter().for_each(|&case| queue.end(case));
            queue.next().map(|w| w.case)
        };
        assert_eq!([next(&[]), next(&[]), next(&[])], [Some(0), Some(2), None], "the second would be too much");
        assert_eq!([next(&[0]), next(&[])], [Some(4), None]);
        assert_eq!([next(&[2]), next(&[])], [Some(1), None]);
        assert_eq!([next(&[4, 1]), next(&[])], [Some(3), None], "alone, if it fits nowhere");
        assert_eq!(next(&[3]), None);
        // What the first one took shows that two fit.
        let mut queue = Queue::new(waiting(&[4, 4, 4, 4]), 3, 4);
        assert_eq!((queue.next().map(|w| w.case), queue.next()), (Some(0), None));
        queue.end(0);
        queue.correct(|case| (case < 3).then_some(2));
        let began: Vec<_> = std::iter::from_fn(|| queue.next().map(|w| w.case)).collect();
        assert_eq!(began, [1, 2]);
    }

    #[test]
    fn a_case_that_takes_more_than_expected_makes_way() {
        let mut queue = Queue::new((0..3).map(|case| Waiting { case, memory: 2 }).collect(), 3, 4);
        let ledger = Ledger::new(4);
        for _ in 0..2 {
            ledger.begin(queue.next().unwrap());
        }
        assert!(!ledger.is_too_large(0, 2) && !ledger.is_too_large(1, 2));
        assert!(ledger.is_too_large(1, 3) && !ledger.is_too_large(0, 2) && ledger.holds(3));
        ledger.end(1);
        queue.again(1, 3);
        assert!(!ledger.is_too_large(0, 4) && ledger.is_too_large(0, 5) && !ledger.holds(5));
        assert_eq!(queue.next(), Some(Waiting { case: 2, memory: 2 }), "which fits beside the first");
        queue.end(0);
        queue.end(2);
        assert_eq!(queue.next(), Some(Waiting { case: 1, memory: 4 }));
    }

    #[test]
    fn what_cases_took_tells_what_others_take() {
        let (mib, base) = (1 << 20, MEMORY.base);
        assert_eq!(MEMORY.expected(Path::new("a.nii"), 100 * mib), base + 300 * mib);
        let known = MEMORY.learn([(false, 100 * mib, base + 200 * mib), (false, mib, base), (true, 0, 5)].into_iter());
        assert_eq!(known.factors, [2.0, 12.0]);
        assert_eq!(known.expected(Path::new("a.nii"), 100 * mib), base + 200 * mib);
        assert_eq!(known.expected(Path::new("a.nii.gz"), mib), base + 12 * mib);
    }
}
