//! A part of the wall: of some segments, or what was not seen, to look at it again.

use rayon::prelude::*;

use super::sight::Sight;
use super::wall::Wall;

impl Wall {
    /// Returns the triangles that `which` is true for as a wall of their own, and their numbers in this one, ascending. If those are
    /// all, the wall shares the arrays of this one.
    pub fn part(&self, which: impl Fn(usize) -> bool + Sync) -> (Self, Vec<u32>) {
        let numbers: Vec<u32> = (0..self.len() as u32).into_par_iter().filter(|&n| which(n as usize)).collect();
        if numbers.len() == self.len() {
            return (self.clone(), numbers);
        }
        let mut number = vec![u32::MAX; self.places.len()];
        numbers.iter().flat_map(|&n| self.triangles[n as usize]).for_each(|v| number[v as usize] = 0);
        let mut places = Vec::with_capacity(number.iter().filter(|&&new| new == 0).count());
        for (old, new) in number.iter_mut().enumerate().filter(|(_, new)| **new == 0) {
            *new = places.len() as u32;
            places.push(self.places[old]);
        }
        let triangles = numbers.par_iter().map(|&n| self.triangles[n as usize].map(|v| number[v as usize])).collect();
        let part = Self::of_sorted(self.origin, places, triangles);
        (part, numbers)
    }
}

/// Adds what later views saw of a part of the wall to what was seen of all of it.
#[doc(hidden)]
pub fn add(sights: &mut [Sight], numbers: &[u32], more: &[Sight]) {
    for (&n, more) in numbers.iter().zip(more) {
        let sight = &mut sights[n as usize];
        sight.ahead = sight.ahead.saturating_add(more.ahead);
        sight.either |= more.either;
    }
}
