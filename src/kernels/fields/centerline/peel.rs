//! *Peel onion* (paper, section 3.1): peels the lumen voxel by voxel from the wall inwards until a line remains.
//!
//! This is distance-ordered homotopic thinning (Pudney 1998): voxels are removed in the order of their distance to the
//! wall, each only if its removal does not change the topology. The lumen is 6-connected here and its surroundings are
//! 26-connected, so loops whose walls touch in an edge or a corner stay apart. A voxel is simple if, among its
//! neighbours, the lumen has one piece that touches its faces (within the 18-neighbourhood) and the outside has one
//! piece (Bertrand and Malandain 1994). The two ends are never removed. The remainder contains a line between them, a
//! loop around every strand across the lumen, and a shell around every island in it.

use std::collections::VecDeque;

use crate::error::Result;
use crate::fields::WallDistance;
use crate::fields::voxels::each_bit;
use crate::progress::Progress;

/// Distance buckets per millimetre.
const PER_MM: f32 = 8.0;
/// Number of voxels between two checks for cancellation.
const EVERY: u64 = 1 << 16;

/// Returns the shortest path of voxels from `start` to `goal` through the peeled remainder; `None` if they are not connected.
pub(super) fn peeled(
    walls: &WallDistance,
    start: [i64; 3],
    goal: [i64; 3],
    progress: &Progress,
) -> Result<Option<Vec<[i64; 3]>>> {
    let mut left = Left::of(walls);
    let tables = Tables::new();
    let mut buckets: Vec<Vec<[i32; 3]>> = Vec::new();
    let bucket_of = |v: [i64; 3]| (walls.at(v).unwrap_or(0.0).max(0.0) * PER_MM) as usize;
    let push = |buckets: &mut Vec<Vec<[i32; 3]>>, v: [i64; 3], least: usize| {
        let b = bucket_of(v).max(least);
        if b >= buckets.len() {
            buckets.resize_with(b + 1, Vec::new);
        }
        buckets[b].push(v.map(|x| x as i32));
    };
    // Start with the skin. Every removed voxel exposes its neighbours.
    let mut skin = Vec::new();
    walls.set().for_each(|n, v| {
        let v = v.map(|x| x as i64);
        if walls.value(n) >= 0.0 && left.around(v) & tables.faces != tables.faces {
            skin.push(v);
        }
    });
    skin.into_iter().for_each(|v| push(&mut buckets, v, 0));
    progress.stage("peeling the lumen", walls.voxels() as u64);
    let mut at = 0;
    let mut steps = 0u64;
    while at < buckets.len() {
        let Some(v) = buckets[at].pop() else {
            // A voxel is listed each time a neighbour goes, many times in total, so free finished buckets.
            buckets[at] = Vec::new();
            at += 1;
            continue;
        };
        let v = v.map(i64::from);
        if v == start || v == goal || !left.contains(v) || !tables.is_simple(left.around(v)) {
            continue;
        }
        left.remove(v);
        steps += 1;
        if steps.is_multiple_of(EVERY) {
            progress.advance(EVERY)?;
        }
        let near = left.around(v);
        each_bit(u64::from(near), |b| {
            let b = b as i64;
            push(&mut buckets, [v[0] + b % 3 - 1, v[1] + b / 3 % 3 - 1, v[2] + b / 9 - 1], at);
        });
    }
    Ok(way(walls, &left, start, goal))
}

/// Returns the shortest path across faces through the remaining voxels.
fn way(walls: &WallDistance, left: &Left, start: [i64; 3], goal: [i64; 3]) -> Option<Vec<[i64; 3]>> {
    let mut reached = vec![(start, 0usize)];
    let mut seen = vec![false; walls.set().len()];
    seen[walls.set().number(start)?] = true;
    let mut open = VecDeque::from([0usize]);
    while let Some(n) = open.pop_front() {
        let at = reached[n].0;
        if at == goal {
            let mut out = vec![at];
            let mut n = n;
            while n != 0 {
                n = reached[n].1;
                out.push(reached[n].0);
            }
            out.reverse();
            return Some(out);
        }
        for s in 0..6 {
            let mut v = at;
            v[s / 2] += if s % 2 == 0 { 1 } else { -1 };
            let Some(number) = walls.set().number(v).filter(|_| left.contains(v)) else { continue };
            if !std::mem::replace(&mut seen[number], true) {
                open.push_back(reached.len());
                reached.push((v, n));
            }
        }
    }
    None
}

/// The remaining voxels, one bit each, with an empty rim so that neighbours need no bounds check.
struct Left {
    words: usize,
    rows: usize,
    bits: Vec<u64>,
}

impl Left {
    fn of(walls: &WallDistance) -> Self {
        let [nx, ny, nz] = walls.grid().dims();
        let words = (nx + 2).div_ceil(64);
        let mut left = Self { words, rows: ny + 2, bits: vec![0; words * (ny + 2) * (nz + 2)] };
        walls.set().for_each(|n, v| {
            if walls.value(n) >= 0.0 {
                let (word, bit) = left.place(v.map(|x| x as i64));
                left.bits[word] |= bit;
            }
        });
        left
    }

    /// Returns word and bit of a voxel. −1 and the grid's size are the rim.
    fn place(&self, v: [i64; 3]) -> (usize, u64) {
        let [i, j, k] = v.map(|x| (x + 1) as usize);
        (self.words * (j + self.rows * k) + i / 64, 1 << (i % 64))
    }

    fn contains(&self, v: [i64; 3]) -> bool {
        let (word, bit) = self.place(v);
        self.bits[word] & bit != 0
    }

    fn remove(&mut self, v: [i64; 3]) {
        let (word, bit) = self.place(v);
        self.bits[word] &= !bit;
    }

    /// Returns the 26 neighbours of a voxel as bits, x fastest; the voxel's own bit (13) is not set.
    fn around(&self, [i, j, k]: [i64; 3]) -> u32 {
        let mut out = 0;
        // The previous voxel, in rim coordinates.
        let x = i as usize;
        for dk in 0..3 {
            for dj in 0..3 {
                let row = self.words * ((j + dj) as usize + self.rows * (k + dk) as usize);
                let (word, shift) = (x / 64, x % 64);
                let mut three = self.bits[row + word] >> shift;
                if shift > 61 && word + 1 < self.words {
                    three |= self.bits[row + word + 1] << (64 - shift);
                }
                out |= ((three & 7) as u32) << (3 * dj + 9 * dk);
            }
        }
        out & !(1 << 13)
    }
}

/// Adjacency of the 27 voxels in a neighbourhood.
struct Tables {
    /// For each voxel, its neighbours across faces within the 18-neighbourhood, and all its 26-neighbours.
    six: [u32; 27],
    all: [u32; 27],
    /// The middle voxel's six neighbours across faces, and its 18-neighbourhood.
    faces: u32,
    eighteen: u32,
}

impl Tables {
    fn new() -> Self {
        let at = |b: usize| [b % 3, b / 3 % 3, b / 9].map(|x| x as i32 - 1);
        let apart = |a: usize, b: usize| (0..3).map(|n| (at(a)[n] - at(b)[n]).abs()).sum::<i32>();
        let cheby = |a: usize, b: usize| (0..3).map(|n| (at(a)[n] - at(b)[n]).abs()).max().unwrap_or(0);
        let bits =
            |is_in: &dyn Fn(usize) -> bool| (0..27).filter(|&b| b != 13 && is_in(b)).fold(0u32, |m, b| m | 1 << b);
        let eighteen = bits(&|b| apart(b, 13) <= 2);
        Self {
            six: std::array::from_fn(|a| bits(&|b| apart(a, b) == 1) & eighteen),
            all: std::array::from_fn(|a| bits(&|b| b != a && cheby(a, b) == 1)),
            faces: bits(&|b| apart(b, 13) == 1),
            eighteen,
        }
    }

    /// Returns the part of `set` that is connected to `seed` by `touching`.
    fn piece(set: u32, seed: u32, touching: &[u32; 27]) -> u32 {
        let (mut piece, mut fresh) = (seed, seed);
        while fresh != 0 {
            let mut next = 0;
            each_bit(u64::from(fresh), |b| next |= touching[b]);
            fresh = next & set & !piece;
            piece |= fresh;
        }
        piece
    }

    /// True if the middle voxel may be removed, given which of its neighbours belong to the lumen.
    fn is_simple(&self, near: u32) -> bool {
        let faces = near & self.faces;
        let outside = !near & ((1 << 27) - 1) & !(1 << 13);
        if faces == 0 || outside == 0 {
            return false;
        }
        let lumen = Self::piece(near & self.eighteen, faces & faces.wrapping_neg(), &self.six);
        faces & !lumen == 0 && Self::piece(outside, outside & outside.wrapping_neg(), &self.all) == outside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In a box with a pillar in the way, the path is as short as steps across faces allow.
    #[test]
    fn the_way_through_what_is_left_is_the_shortest() {
        let spacing = glam::DVec3::ONE;
        let walls = WallDistance::drawn([12, 12, 12], spacing, |p| {
            p.min_element() > 0.5 && p.max_element() < 10.5 && !((p.x - 5.0).abs() < 1.5 && (p.y - 5.0).abs() < 1.5)
        });
        let left = Left::of(&walls);
        for (start, goal) in [([1, 1, 1], [10, 10, 10]), ([1, 1, 1], [10, 1, 1]), ([2, 9, 3], [9, 2, 8])] {
            let path = way(&walls, &left, start, goal).unwrap();
            let least: i64 = (0..3).map(|a| i64::abs(start[a] - goal[a])).sum();
            assert_eq!(path.len() as i64, least + 1, "{start:?} to {goal:?}");
            assert_eq!((path[0], path[path.len() - 1]), (start, goal));
        }
    }

    /// Checks against the definition, by counting pieces with a plain flood fill.
    #[test]
    fn simple_voxels_are_those_of_the_definition() {
        let tables = Tables::new();
        let at = |b: usize| [b % 3, b / 3 % 3, b / 9].map(|x| x as i32 - 1);
        let pieces = |set: &[usize], touch: &dyn Fn([i32; 3], [i32; 3]) -> bool| -> Vec<Vec<usize>> {
            let mut rest: Vec<usize> = set.to_vec();
            let mut out = Vec::new();
            while let Some(first) = rest.pop() {
                let mut piece = vec![first];
                let mut n = 0;
                while n < piece.len() {
                    let here = piece[n];
                    let (near, far) = rest.iter().partition(|&&o| touch(at(here), at(o)));
                    rest = far;
                    let near: Vec<usize> = near;
                    piece.extend(near);
                    n += 1;
                }
                out.push(piece);
            }
            out
        };
        let manhattan = |a: [i32; 3], b: [i32; 3]| (0..3).map(|n| (a[n] - b[n]).abs()).sum::<i32>();
        for n in 0..4000u64 {
            let share = crate::math::hash::uniform(1, n);
            let near = (0..27).filter(|&b| b != 13 && crate::math::hash::uniform(2, 27 * n + b) < share);
            let near: u32 = near.fold(0, |m, b| m | 1 << b);
            let lumen: Vec<usize> = (0..27).filter(|&b| near >> b & 1 == 1 && manhattan(at(b), [0; 3]) <= 2).collect();
            let outside: Vec<usize> = (0..27).filter(|&b| b != 13 && near >> b & 1 == 0).collect();
            let touching = pieces(&lumen, &|a, b| manhattan(a, b) == 1);
            let touching = touching.iter().filter(|p| p.iter().any(|&b| manhattan(at(b), [0; 3]) == 1)).count();
            let around = pieces(&outside, &|a, b| (0..3).all(|n| (a[n] - b[n]).abs() <= 1)).len();
            assert_eq!(tables.is_simple(near), touching == 1 && around == 1, "{near:027b}");
        }
    }
}
