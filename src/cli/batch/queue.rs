//! Which case is begun when: as many at once as there are cores for, and as memory allows.

use std::path::Path;

/// Memory of a process whatever its scan, bytes.
const BASE: u64 = 64 << 20;
/// Memory of a case in bytes of its files, before any case is known: with the voxels in 16 bits, and packed.
const FACTORS: [f64; 2] = [3.0, 12.0];

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
    pub(super) fn next(&mut self) -> Option<usize> {
        if self.running.len() >= self.jobs {
            return None;
        }
        let taken: u64 = self.running.iter().map(|w| w.memory).sum();
        let fits = |w: &Waiting| self.running.is_empty() || taken.saturating_add(w.memory) <= self.memory;
        let at = self.waiting.iter().position(fits)?;
        let next = self.waiting.remove(at);
        self.running.push(next);
        Some(next.case)
    }

    /// Takes a case out that has ended.
    pub(super) fn end(&mut self, case: usize) {
        self.running.retain(|w| w.case != case);
    }
}

/// Returns the memory that a scan of so many bytes is expected to take, bytes. `known` is what earlier cases took for each byte of theirs, by
/// whether they were packed.
pub(super) fn expected(scan: &Path, bytes: u64, known: [Option<f64>; 2]) -> u64 {
    let packed = usize::from(is_packed(scan));
    BASE + (bytes as f64 * known[packed].unwrap_or(FACTORS[packed])) as u64
}

/// True if a scan's files are likely to be compressed.
pub(super) fn is_packed(scan: &Path) -> bool {
    scan.extension().is_some_and(|e| e == "gz" || e == "nrrd" || e == "mha")
}

/// Returns what cases took for each byte of their files: the most of them, by whether they were packed.
pub(super) fn learned(cases: impl Iterator<Item = (bool, u64, u64)>) -> [Option<f64>; 2] {
    let mut most = [None::<f64>; 2];
    for (packed, bytes, peak) in cases.filter(|c| c.1 > 0 && c.2 > 0) {
        let factor = peak.saturating_sub(BASE) as f64 / bytes as f64;
        let known = &mut most[usize::from(packed)];
        *known = Some(known.map_or(factor, |k| k.max(factor)));
    }
    most
}

/// Returns the memory that is free, bytes; `None` if the system does not tell.
pub(super) fn free() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    Some(line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_take_turns_where_memory_is_short() {
        let waiting =
            |memory: &[u64]| memory.iter().enumerate().map(|(case, &memory)| Waiting { case, memory }).collect();
        let mut queue = Queue::new(waiting(&[2, 3, 2, 9, 1]), 3, 4);
        assert_eq!(
            [queue.next(), queue.next(), queue.next()],
            [Some(0), Some(2), None],
            "the second would be too much"
        );
        queue.end(0);
        assert_eq!([queue.next(), queue.next()], [Some(4), None]);
        queue.end(2);
        assert_eq!([queue.next(), queue.next()], [Some(1), None]);
        queue.end(4);
        queue.end(1);
        assert_eq!([queue.next(), queue.next()], [Some(3), None], "alone, if it fits nowhere");
        queue.end(3);
        assert_eq!(queue.next(), None);
    }

    #[test]
    fn what_cases_took_tells_what_others_take() {
        let mib = 1 << 20;
        assert_eq!(expected(Path::new("a.nii"), 100 * mib, [None; 2]), BASE + 300 * mib);
        let known = learned([(false, 100 * mib, BASE + 200 * mib), (false, mib, BASE), (true, 0, 5)].into_iter());
        assert_eq!(known, [Some(2.0), None]);
        assert_eq!(expected(Path::new("a.nii"), 100 * mib, known), BASE + 200 * mib);
        assert_eq!(expected(Path::new("a.nii.gz"), mib, known), BASE + 12 * mib);
    }
}
