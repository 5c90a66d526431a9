//! Roadmap (paper, section 3.1): balls inscribed at sampled places, and the ways between those that overlap.
//!
//! A sample climbs to where the wall is farthest (retraction to the medial axis, Wilmarth, Amato and Stiller 1999) and
//! covers the ball there. Samples are drawn from what is not covered yet until nothing is left, so that the balls cover
//! the lumen, also where it is narrow; the order is a fixed walk through all voxels. The straight way between the centres
//! of two overlapping balls lies within the two.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use glam::DVec3;

use super::narrow;
use super::polyline::is_free;
use crate::error::Result;
use crate::fields::WallDistance;
use crate::progress::Progress;

/// Steps of a sample's climb at the most.
const CLIMB: usize = 60;
/// Side of the bins that balls are looked up by, mm.
const BIN_MM: f64 = 8.0;

/// A ball inscribed in the lumen.
#[derive(Clone, Copy, Debug)]
struct Ball {
    at: DVec3,
    radius: f64,
}

/// The way of least cost from `start` to `goal` along balls; none where they are not connected.
pub(super) fn way(
    walls: &WallDistance,
    start: [i64; 3],
    goal: [i64; 3],
    progress: &Progress,
) -> Result<Option<Vec<DVec3>>> {
    let balls = balls(walls, [start, goal], progress)?;
    let bins = bins(&balls);
    let largest = balls.iter().map(|b| b.radius).fold(0.0, f64::max);
    let slack = 2.0 * walls.grid().spacing().max_element();
    let mut cost = vec![f64::INFINITY; balls.len()];
    let mut before: Vec<usize> = (0..balls.len()).collect();
    let mut done = vec![false; balls.len()];
    let mut open = BinaryHeap::from([Reverse((0u64, 0usize))]);
    cost[0] = 0.0;
    while let Some(Reverse((_, n))) = open.pop() {
        if std::mem::replace(&mut done[n], true) {
            continue;
        }
        if n == 1 {
            let mut line = vec![balls[1].at];
            let mut n = n;
            while before[n] != n {
                n = before[n];
                line.push(balls[n].at);
            }
            line.reverse();
            return Ok(Some(line));
        }
        let a = balls[n];
        let reach = a.radius + largest + slack;
        let span = |axis: usize| bin(a.at[axis] - reach)..=bin(a.at[axis] + reach);
        for (z, y) in span(2).flat_map(|z| span(1).map(move |y| (z, y))) {
            let row = bins.range((z, y, *span(0).start())..=(z, y, *span(0).end()));
            for &m in row.flat_map(|(_, members)| members).filter(|&&m| !done[m]) {
                let b = balls[m];
                let apart = a.at.distance(b.at) - a.radius - b.radius;
                let touches = apart <= 0.0 || (apart <= slack && is_free(walls, a.at, b.at));
                let c = cost[n] + a.at.distance(b.at) * narrow(a.radius.min(b.radius));
                if touches && c < cost[m] {
                    (cost[m], before[m]) = (c, n);
                    open.push(Reverse((c.to_bits(), m)));
                }
            }
        }
    }
    Ok(None)
}

/// Balls that cover the lumen; the first two are those of the ends.
fn balls(walls: &WallDistance, ends: [[i64; 3]; 2], progress: &Progress) -> Result<Vec<Ball>> {
    let count = walls.set().len();
    let mut covered = vec![false; count];
    let mut balls = Vec::new();
    for end in ends {
        add(walls, end, &mut covered, &mut balls);
    }
    // A stride without a common factor with the count visits every voxel once, far from the one before.
    let mut stride = (count as f64 * 0.618_033_988_75) as usize | 1;
    while gcd(stride, count) != 1 {
        stride += 2;
    }
    let mut n = 0;
    for step in 0..count {
        if step % (1 << 16) == 0 {
            progress.check()?;
        }
        n = (n + stride) % count;
        if covered[n] || walls.values()[n] < 0.0 {
            continue;
        }
        let sample = walls.set().voxel(n);
        add(walls, climbed(walls, sample), &mut covered, &mut balls);
        if !covered[n] {
            add(walls, sample, &mut covered, &mut balls);
        }
    }
    Ok(balls)
}

/// Uphill among the 26 neighbours until none is farther from the wall.
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

/// Adds the ball at a voxel and marks what it covers: a voxel's diagonal less than its radius, so that the balls of
/// neighbouring voxels overlap; its own voxel always.
fn add(walls: &WallDistance, centre: [i64; 3], covered: &mut [bool], balls: &mut Vec<Ball>) {
    let radius = f64::from(walls.at(centre).unwrap_or(0.0).max(0.0));
    let at = walls.world(centre);
    balls.push(Ball { at, radius });
    let spacing = walls.grid().spacing();
    let covers = (radius - spacing.max_element()).max(0.0);
    let reach = spacing.to_array().map(|s| (covers / s) as i64);
    for dk in -reach[2]..=reach[2] {
        for dj in -reach[1]..=reach[1] {
            let across = (dk as f64 * spacing.z).powi(2) + (dj as f64 * spacing.y).powi(2);
            let along = ((covers * covers - across).max(0.0).sqrt() / spacing.x) as i64;
            if across > covers * covers {
                continue;
            }
            let row = |i: i64| [centre[0] + i, centre[1] + dj, centre[2] + dk];
            // All of a ball's voxels are of the lumen, so those of a row are numbered one after the other.
            if let (Some(a), Some(b)) = (walls.set().number(row(-along)), walls.set().number(row(along))) {
                covered[a..=b].fill(true);
            }
        }
    }
}

fn bin(x: f64) -> i64 {
    (x / BIN_MM).floor() as i64
}

/// Balls by the bin of their centre (z, y, x).
fn bins(balls: &[Ball]) -> BTreeMap<(i64, i64, i64), Vec<usize>> {
    let mut out: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (n, b) in balls.iter().enumerate() {
        out.entry((bin(b.at.z), bin(b.at.y), bin(b.at.x))).or_default().push(n);
    }
    out
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}
