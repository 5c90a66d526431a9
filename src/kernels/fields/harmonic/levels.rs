//! Aggregates of cells, of aggregates, and so on, until few are left.
//!
//! An aggregate is a connected piece of the level below within a block of twice the size. Where two parts of one block are connected
//! only by a neck, they stay apart: otherwise no level would know that the neck holds back the flow. Conductances between aggregates
//! are those of the faces between them, over the distance of their own centres: without that, aggregates conduct twice as well as
//! their cells. So each level is a finite volume method of its own.

use glam::Vec3;
use rayon::prelude::*;

use super::domain::{Domain, Link, Links};
use crate::error::Result;
use crate::math::sets::Sets;
use crate::progress::Progress;

/// A link that conducts less than this share of the best one of either side is a neck.
const NECK: f32 = 0.1;
/// The coarsest level has at most this many nodes, which are solved directly.
pub(super) const FEW: usize = 300;
/// Stands for no aggregate.
pub(super) const NONE: u32 = u32::MAX;

/// One level of nodes: cells, or aggregates.
#[derive(Debug, Default)]
pub(super) struct Level {
    pub links: Links,
    /// The sum of a node's conductances, also to what is held; 0 for a node that takes no part.
    pub diagonal: Vec<f32>,
    /// The conductance of an aggregate to what is held. Cells that are held are nodes themselves.
    pub held: Vec<f32>,
    /// The aggregate of each node, on the next level.
    pub parent: Vec<u32>,
    /// The nodes of each aggregate of the next level, those of one after those of another, and where they begin.
    pub members: Vec<u32>,
    pub begins: Vec<u32>,
}

/// All levels, the cells first.
#[derive(Debug)]
pub(super) struct Levels {
    /// The cells have no links here: theirs are those of the domain.
    pub all: Vec<Level>,
}

/// Where the nodes of a level are.
struct Places {
    block: Vec<[u16; 3]>,
    centre: Vec<Vec3>,
    volume: Vec<f32>,
}

impl Levels {
    /// Builds the levels over the cells that are free.
    pub(super) fn new(domain: &Domain, free: &[bool], progress: &Progress) -> Result<Self> {
        let count = domain.len();
        let mut places = Places {
            block: (0..count).map(|n| domain.block(n)).collect(),
            centre: (0..count as u32).map(|n| domain.centre(n).as_vec3()).collect(),
            volume: (0..count as u32).map(|n| domain.volume_mm3(n) as f32).collect(),
        };
        let sum = |n: usize| domain.links().of(n).iter().map(|l| l.conductance).sum::<f32>();
        let diagonal = (0..count).into_par_iter().map(|n| if free[n] { sum(n) } else { 0.0 }).collect();
        let mut all = vec![Level { diagonal, held: vec![0.0; count], ..Level::default() }];
        let mut is_slow = false;
        loop {
            progress.check()?;
            let is_first = all.len() == 1;
            let Some(level) = all.last_mut() else { break };
            let links = if is_first { domain.links() } else { &level.links };
            let nodes = level.diagonal.iter().filter(|d| **d > 0.0).count();
            if nodes <= FEW {
                break;
            }
            let (parent, count) = aggregates(links, level, &places.block, if is_slow { 0.0 } else { NECK });
            // Rough noise is necks all over.
            is_slow = 3 * count > 2 * nodes;
            let (members, begins) = members(&parent, count);
            let coarse = places.merged(&members, &begins);
            let next = coarser(links, &parent, (&members, &begins), (&places, &coarse));
            let to_held = |n: usize| links.of(n).iter().filter(|l| level.diagonal[l.to as usize] == 0.0);
            let held: Vec<f32> = (0..count)
                .into_par_iter()
                .map(|i| {
                    let own = members[begins[i] as usize..begins[i + 1] as usize].iter().map(|&n| n as usize);
                    own.map(|n| level.held[n] + to_held(n).map(|l| l.conductance).sum::<f32>()).sum()
                })
                .collect();
            let diagonal =
                (0..count).map(|i| held[i] + next.of(i).iter().map(|l| l.conductance).sum::<f32>()).collect();
            (level.parent, level.members, level.begins) = (parent, members, begins);
            all.push(Level { links: next, diagonal, held, ..Level::default() });
            places = coarse;
        }
        Ok(Self { all })
    }
}

/// Returns the aggregate of each node, numbered in the order of their first nodes, and their number.
fn aggregates(links: &Links, level: &Level, block: &[[u16; 3]], neck: f32) -> (Vec<u32>, usize) {
    let is_free = |n: u32| level.diagonal[n as usize] > 0.0;
    let best: Vec<f32> = (0..level.diagonal.len())
        .into_par_iter()
        .map(|n| links.of(n).iter().map(|l| l.conductance).fold(0.0, f32::max))
        .collect();
    let double = |n: u32| block[n as usize].map(|b| b / 2);
    let mut sets = Sets::new(level.diagonal.len());
    for n in (0..level.diagonal.len() as u32).filter(|&n| is_free(n)) {
        for l in links.of(n as usize).iter().filter(|l| l.to > n && is_free(l.to)) {
            let is_wide = l.conductance >= neck * best[n as usize].min(best[l.to as usize]);
            if is_wide && double(n) == double(l.to) {
                sets.join(n, l.to);
            }
        }
    }
    let (mut parent, mut count) = (vec![NONE; level.diagonal.len()], 0);
    for n in (0..level.diagonal.len() as u32).filter(|&n| is_free(n)) {
        // The root is the first of its set.
        let root = sets.find(n);
        if root == n {
            parent[n as usize] = count;
            count += 1;
        } else {
            parent[n as usize] = parent[root as usize];
        }
    }
    (parent, count as usize)
}

/// Returns the nodes of each aggregate, and where they begin.
fn members(parent: &[u32], count: usize) -> (Vec<u32>, Vec<u32>) {
    let mut begins = vec![0u32; count + 1];
    for &p in parent.iter().filter(|p| **p != NONE) {
        begins[p as usize + 1] += 1;
    }
    for i in 0..count {
        begins[i + 1] += begins[i];
    }
    let (mut next, mut members) = (begins.clone(), vec![0; begins[count] as usize]);
    for (n, &p) in parent.iter().enumerate().filter(|(_, p)| **p != NONE) {
        members[next[p as usize] as usize] = n as u32;
        next[p as usize] += 1;
    }
    (members, begins)
}

impl Places {
    /// Returns where aggregates are.
    fn merged(&self, members: &[u32], begins: &[u32]) -> Self {
        let count = begins.len() - 1;
        let own = |i: usize| members[begins[i] as usize..begins[i + 1] as usize].iter().map(|&n| n as usize);
        let volume: Vec<f32> = (0..count).map(|i| own(i).map(|n| self.volume[n]).sum()).collect();
        let centre = (0..count).map(|i| own(i).map(|n| self.centre[n] * self.volume[n]).sum::<Vec3>() / volume[i]);
        let block = (0..count).map(|i| self.block[members[begins[i] as usize] as usize].map(|b| b / 2));
        Self { block: block.collect(), centre: centre.collect(), volume }
    }

    /// Returns the distance between two nodes across the blocks' common face; `None` within a block.
    fn apart(&self, n: usize, m: usize) -> Option<f32> {
        let axis = (0..3).find(|&a| self.block[n][a] != self.block[m][a])?;
        Some((self.centre[n][axis] - self.centre[m][axis]).abs())
    }
}

/// Returns the links between aggregates.
fn coarser(
    links: &Links,
    parent: &[u32],
    (members, begins): (&[u32], &[u32]),
    (fine, coarse): (&Places, &Places),
) -> Links {
    Links::gather(begins.len() - 1, |i, out| {
        let before = out.len();
        for &n in &members[begins[i] as usize..begins[i + 1] as usize] {
            for l in links.of(n as usize) {
                let to = parent[l.to as usize];
                if to == NONE || to == i as u32 {
                    continue;
                }
                let share = match (fine.apart(n as usize, l.to as usize), coarse.apart(i, to as usize)) {
                    // Centres of bent pieces may be nearer than those of their cells.
                    (Some(near), Some(far)) => near / far.max(near),
                    _ => 1.0,
                };
                out.push(Link { to, conductance: l.conductance * share });
            }
        }
        // Stable, so that sums are always taken in the same order.
        out[before..].sort_by_key(|l| l.to);
        let mut kept = before;
        for n in before..out.len() {
            if kept > before && out[kept - 1].to == out[n].to {
                out[kept - 1].conductance += out[n].conductance;
            } else {
                out[kept] = out[n];
                kept += 1;
            }
        }
        out.truncate(kept);
    })
}
