//! Roadmap (paper, section 3.1): balls inscribed at sampled positions, and paths between those that touch.
//!
//! A sample climbs to where the wall is farthest (retraction to the medial axis, Wilmarth, Amato and Stiller 1999). Its
//! ball owns the voxels that it covers and that no other ball owns yet. Samples are drawn from voxels without an owner
//! until none are left, so the balls' voxels cover the lumen, even where it is narrow. The order is a fixed traversal
//! of all voxels. Two balls are neighbours if their voxels share a face. The path between them leads straight from
//! centre to centre if that is free, else through such a pair of voxels.
//!
//! The search is separate from that of the cell maps (`fields::neighbours`): it steps only from ball to ball, and it
//! remembers the pair of voxels used.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::narrow;
use super::polyline::is_free;
use crate::error::Result;
use crate::fields::WallDistance;
use crate::progress::Progress;

/// Maximum number of steps in a sample's climb.
const CLIMB: usize = 60;
/// Number of samples between two checks for cancellation.
const EVERY: usize = 1 << 14;
/// Number of contacts to list before reducing them to the best one of each pair.
const CONTACTS: usize = 1 << 22;
/// The owner of a voxel without a ball.
const NOBODY: u32 = u32::MAX;

/// A ball inscribed in the lumen.
#[derive(Clone, Copy, Debug)]
struct Ball {
    at: DVec3,
    radius: f64,
}

/// A shared face between two balls' voxels: the smaller ball, the larger one, and the voxel numbers of each.
type Contact = (u32, u32, u32, u32);

/// Returns the least-cost path from `start` to `goal` along balls; `None` if they are not connected.
pub(super) fn way(
    walls: &WallDistance,
    start: [i64; 3],
    goal: [i64; 3],
    progress: &Progress,
) -> Result<Option<Vec<DVec3>>> {
    let (balls, owner) = balls(walls, [start, goal], progress)?;
    if start == goal {
        return Ok(Some(vec![balls[0].at]));
    }
    let contacts = contacts(walls, &owner, progress)?;
    let mut cost = vec![f64::INFINITY; balls.len()];
    let mut before: Vec<Option<Contact>> = vec![None; balls.len()];
    let mut done = vec![false; balls.len()];
    let mut open = BinaryHeap::from([Reverse((0u64, 0u32))]);
    cost[0] = 0.0;
    while let Some(Reverse((_, n))) = open.pop() {
        if n == 1 {
            return Ok(Some(line(walls, &balls, &before)));
        }
        if std::mem::replace(&mut done[n as usize], true) {
            continue;
        }
        let first = contacts.partition_point(|c| c.0 < n);
        for &c in contacts[first..].iter().take_while(|c| c.0 == n).filter(|c| !done[c.1 as usize]) {
            let (a, b) = (balls[n as usize], balls[c.1 as usize]);
            let price = cost[n as usize] + a.at.distance(b.at) * narrow(a.radius.min(b.radius));
            if price < cost[c.1 as usize] {
                (cost[c.1 as usize], before[c.1 as usize]) = (price, Some(c));
                open.push(Reverse((price.to_bits(), c.1)));
            }
        }
    }
    Ok(None)
}

/// Returns the line to ball 1 along the contacts by which the balls were reached.
fn line(walls: &WallDistance, balls: &[Ball], before: &[Option<Contact>]) -> Vec<DVec3> {
    let mut out = vec![balls[1].at];
    let mut n = 1;
    while let Some((a, b, x, y)) = before[n] {
        let (from, to) = (balls[a as usize].at, balls[b as usize].at);
        if !is_free(walls, from, to) {
            out.extend([y, x].map(|v| walls.world(walls.set().voxel(v as usize))));
        }
        out.push(from);
        n = a as usize;
    }
    out.reverse();
    out
}

/// Returns the pairs of balls whose voxels share a face, in both directions, ascending. Each pair has the contact
/// farthest from the wall.
fn contacts(walls: &WallDistance, owner: &[u32], progress: &Progress) -> Result<Vec<Contact>> {
    let mut all: Vec<(Contact, u32)> = Vec::new();
    let mut most = CONTACTS;
    progress.stage("joining balls", 0);
    walls.set().for_each(|n, v| {
        if owner[n] == NOBODY || progress.is_cancelled() {
            return;
        }
        if all.len() >= most {
            best_of_each(&mut all);
            most = CONTACTS.max(2 * all.len());
        }
        for a in 0..3 {
            let mut next = v.map(|x| x as i64);
            next[a] += 1;
            let Some(m) = walls.set().number(next).filter(|&m| owner[m] != NOBODY && owner[m] != owner[n]) else {
                continue;
            };
            // Distances are not negative here, so their bits have the same order. The largest comes first.
            let rank = !walls.value(n).min(walls.value(m)).to_bits();
            all.push(((owner[n], owner[m], n as u32, m as u32), rank));
            all.push(((owner[m], owner[n], m as u32, n as u32), rank));
        }
    });
    progress.check()?;
    best_of_each(&mut all);
    Ok(all.into_iter().map(|c| c.0).collect())
}

/// Keeps the contact of least rank for each pair of balls, in the order of the pairs.
fn best_of_each(all: &mut Vec<(Contact, u32)>) {
    all.sort_unstable_by_key(|&((a, b, x, y), rank)| (a, b, rank, x, y));
    all.dedup_by_key(|c| (c.0.0, c.0.1));
}

/// Returns balls that own the lumen's voxels, and each voxel's owner. The first two balls are at the ends.
fn balls(walls: &WallDistance, ends: [[i64; 3]; 2], progress: &Progress) -> Result<(Vec<Ball>, Vec<u32>)> {
    let count = walls.set().len();
    let mut owner = vec![NOBODY; count];
    let mut balls = Vec::new();
    for end in ends {
        add(walls, end, &mut owner, &mut balls);
    }
    // A stride coprime to the count visits every voxel once, each far from the previous one.
    let mut stride = (count as f64 * 0.618_033_988_75) as usize | 1;
    while gcd(stride, count) != 1 {
        stride += 2;
    }
    progress.stage("sampling balls", count as u64);
    // Many samples climb to the same position; create its ball only once.
    let mut made = vec![false; count];
    for end in ends {
        walls.set().number(end).into_iter().for_each(|n| made[n] = true);
    }
    let mut n = 0;
    for step in 0..count {
        if step.is_multiple_of(EVERY) {
            progress.advance(EVERY as u64)?;
        }
        n = (n + stride) % count;
        if owner[n] != NOBODY || walls.value(n) < 0.0 {
            continue;
        }
        let sample = walls.set().voxel(n);
        let top = climbed(walls, sample);
        if walls.set().number(top).is_some_and(|n| !std::mem::replace(&mut made[n], true)) {
            add(walls, top, &mut owner, &mut balls);
        }
        if owner[n] == NOBODY {
            add(walls, sample, &mut owner, &mut balls);
        }
    }
    Ok((balls, owner))
}

/// Climbs among the 26 neighbours until none is farther from the wall.
fn climbed(walls: &WallDistance, from: [i64; 3]) -> [i64; 3] {
    let mut at = from;
    for _ in 0..CLIMB {
        let near = (0..27).map(|n| [at[0] + n % 3 - 1, at[1] + n / 3 % 3 - 1, at[2] + n / 9 - 1]);
        let height = |v: [i64; 3]| walls.at(v).unwrap_or(-1.0);
        let best = near.fold(at, |b, v| if height(v) > height(b) { v } else { b });
        if best == at {
            break;
        }
        at = best;
    }
    at
}

/// Adds the ball at a voxel and assigns it the unowned voxels that it covers. It covers a diagonal less than its radius, so that
/// the straight segment from its centre to any of its voxels passes through no voxel outside. It always covers its centre voxel.
fn add(walls: &WallDistance, centre: [i64; 3], owner: &mut [u32], balls: &mut Vec<Ball>) {
    let radius = f64::from(walls.at(centre).unwrap_or(0.0).max(0.0));
    let own = balls.len() as u32;
    balls.push(Ball { at: walls.world(centre), radius });
    let spacing = walls.grid().spacing();
    let covers = (radius - spacing.length()).max(0.0);
    let reach = spacing.to_array().map(|s| (covers / s) as i64);
    for dk in -reach[2]..=reach[2] {
        for dj in -reach[1]..=reach[1] {
            let across = (dk as f64 * spacing.z).powi(2) + (dj as f64 * spacing.y).powi(2);
            if across > covers * covers {
                continue;
            }
            let along = ((covers * covers - across).sqrt() / spacing.x) as i64;
            let row = |i: i64| [centre[0] + i, centre[1] + dj, centre[2] + dk];
            // All of a ball's voxels belong to the lumen, so those of a row have consecutive numbers.
            if let (Some(a), Some(b)) = (walls.set().number(row(-along)), walls.set().number(row(along))) {
                owner[a..=b].iter_mut().filter(|o| **o == NOBODY).for_each(|o| *o = own);
            }
        }
    }
    // The end balls own their centres, even if another ball covered them first: the search starts and ends there.
    if let Some(n) = walls.set().number(centre).filter(|_| own < 2) {
        owner[n] = own;
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}
