//! Sets of voxels in pages, of which only those with a member are in memory.

use crate::fields::voxels::each_bit;

/// Words of a page: eight rows of a usual scan.
const WORDS: usize = 64;
/// Voxels of a page.
const PAGE: usize = 64 * WORDS;

/// A set of voxels, by their linear indices.
#[derive(Debug)]
pub(super) struct PagedBits {
    pages: Vec<Option<Box<[u64; WORDS]>>>,
    count: usize,
}

impl PagedBits {
    /// Creates an empty set of voxels of a volume of so many.
    pub(super) fn new(voxels: usize) -> Self {
        Self { pages: vec![None; voxels.div_ceil(PAGE)], count: 0 }
    }

    /// True if it holds a voxel.
    pub(super) fn has(&self, voxel: usize) -> bool {
        self.pages[voxel / PAGE].as_ref().is_some_and(|page| page[voxel % PAGE / 64] >> (voxel % 64) & 1 == 1)
    }

    /// Adds a voxel that it does not hold.
    pub(super) fn add(&mut self, voxel: usize) {
        let page = self.pages[voxel / PAGE].get_or_insert_with(|| Box::new([0; WORDS]));
        page[voxel % PAGE / 64] |= 1 << (voxel % 64);
        self.count += 1;
    }

    /// Returns the number of voxels.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Calls `visit` with each voxel, ascending.
    pub(super) fn each(&self, mut visit: impl FnMut(usize)) {
        for (n, page) in self.pages.iter().enumerate() {
            for (word, bits) in page.iter().flat_map(|page| page.iter().enumerate()) {
                each_bit(*bits, |bit| visit(n * PAGE + word * 64 + bit));
            }
        }
    }

    /// Takes all voxels of another set out, which it holds.
    pub(super) fn remove(&mut self, other: &Self) {
        for (own, other) in self.pages.iter_mut().zip(&other.pages) {
            if let (Some(own), Some(other)) = (own, other) {
                own.iter_mut().zip(&**other).for_each(|(own, other)| *own &= !other);
            }
        }
        self.count -= other.count;
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::math::hash::uniform;

    #[test]
    fn it_is_a_set() {
        let len = 3 * PAGE + 77;
        let of = |seed: u64, share: f64| (0..len).filter(move |&n| uniform(seed, n as u64) < share && n / PAGE != 1);
        let (mut all, mut some) = (PagedBits::new(len), PagedBits::new(len));
        let listed: BTreeSet<usize> = of(1, 0.1).collect();
        let taken: BTreeSet<usize> = listed.iter().copied().filter(|&n| uniform(2, n as u64) < 0.5).collect();
        listed.iter().rev().for_each(|&n| all.add(n));
        taken.iter().for_each(|&n| some.add(n));
        assert!((0..len).all(|n| all.has(n) == listed.contains(&n)) && all.count() == listed.len());
        all.remove(&some);
        let mut left = Vec::new();
        all.each(|n| left.push(n));
        assert_eq!(left, listed.difference(&taken).copied().collect::<Vec<_>>());
        assert_eq!(all.count(), left.len());
        let mut none = PagedBits::new(0);
        none.remove(&PagedBits::new(0));
        none.each(|_| unreachable!());
    }
}
