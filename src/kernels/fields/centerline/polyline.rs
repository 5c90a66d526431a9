//! Polylines that stay inside the lumen.

use glam::DVec3;

use crate::fields::{Distance, WallDistance};

/// Two crossings closer than this fraction of a segment count as one.
const TIE: f64 = 1e-9;
/// How strongly a tightened line leans away from walls: mm per round at a distance of 1 mm.
pub(super) const LEAN: f64 = 0.4;

/// True if every voxel on the straight segment from `a` to `b` (world, mm) belongs to the lumen.
pub(super) fn is_free(walls: &WallDistance, a: DVec3, b: DVec3) -> bool {
    let start = walls.voxel(a);
    let Some(clear) = walls.at(start).filter(|&d| d >= 0.0) else { return false };
    // The ball given by the distance contains only lumen. At both ends a voxel reaches half a diagonal beyond its centre.
    if f64::from(clear) >= a.distance(b) + walls.grid().spacing().length() {
        return true;
    }
    let (u, v) = (walls.grid().voxel(a) + 0.5, walls.grid().voxel(b) + 0.5);
    let end = walls.voxel(b);
    let way = v - u;
    // Traverse voxel by voxel (Amanatides and Woo 1987), tracking the next crossing along each axis.
    let mut at = start;
    let cross = |a: usize, at: i64| {
        if way[a] == 0.0 { f64::INFINITY } else { ((if way[a] > 0.0 { at + 1 } else { at }) as f64 - u[a]) / way[a] }
    };
    // `round` and `floor` differ on the faces between voxels, so check the last voxel separately.
    let most: u64 = (0..3).map(|a| end[a].abs_diff(start[a]) + 1).sum();
    for _ in 0..=most {
        if !walls.is_inside(at) {
            return false;
        }
        let t = [cross(0, at[0]), cross(1, at[1]), cross(2, at[2])];
        let next = t[0].min(t[1]).min(t[2]);
        if next > 1.0 {
            break;
        }
        // If the segment passes through an edge or a corner, check all voxels that meet there: a part of the segment
        // with different rounding may pass on either side.
        let crossed: [bool; 3] = std::array::from_fn(|a| t[a] - next < TIE);
        for sides in 1..8 {
            if (0..3).all(|a| sides >> a & 1 == 0 || crossed[a]) {
                let beside =
                    std::array::from_fn(|a| at[a] + if sides >> a & 1 == 1 { way[a].signum() as i64 } else { 0 });
                if !walls.is_inside(beside) {
                    return false;
                }
            }
        }
        for a in (0..3).filter(|&a| crossed[a]) {
            at[a] += way[a].signum() as i64;
        }
    }
    walls.is_inside(end)
}

/// Resamples a line so that each straight segment is free and about `step` mm long. If a shorter path would cut a
/// corner, the line's own points are kept. The line itself must be free.
pub(super) fn resampled(walls: &WallDistance, line: &[DVec3], step: f64) -> Vec<DVec3> {
    let Some(&first) = line.first() else { return Vec::new() };
    let mut out = vec![first];
    let mut at = first;
    let mut next = 1;
    while next < line.len() {
        // Find the farthest point of the line within one step of arc that is visible from here.
        let mut best = None;
        let (mut from, mut run, mut n) = (at, 0.0, next);
        while n < line.len() {
            let part = line[n].distance(from);
            let is_last = run + part >= step;
            // Keep a point of the line bit for bit.
            let cuts = run + part > step + 1e-9;
            let place = if cuts { from.lerp(line[n], ((step - run) / part).clamp(0.0, 1.0)) } else { line[n] };
            if is_free(walls, at, place) {
                best = Some((place, if cuts { n } else { n + 1 }));
            }
            if is_last {
                break;
            }
            (from, run, n) = (line[n], run + part, n + 1);
        }
        (at, next) = best.unwrap_or((line[next], next + 1));
        if at != *out.last().unwrap_or(&first) {
            out.push(at);
        }
    }
    out
}

/// Returns the length of a line, mm.
pub(in crate::fields) fn length(line: &[DVec3]) -> f64 {
    // An empty sum is −0.
    line.windows(2).map(|w| w[0].distance(w[1])).sum::<f64>() + 0.0
}

/// Returns a line with more points, at most `step` mm apart, whether or not it is free.
pub(in crate::fields) fn spaced(line: &[DVec3], step: f64) -> Vec<DVec3> {
    let mut out: Vec<DVec3> = line.iter().take(1).copied().collect();
    for w in line.windows(2) {
        let steps = (w[0].distance(w[1]) / step).ceil().clamp(1.0, 1e6) as usize;
        out.extend((1..steps).map(|n| w[0].lerp(w[1], n as f64 / steps as f64)).chain([w[1]]));
    }
    out
}

/// Smooths a line's values with a Gaussian of standard deviation `sigma` (in points). Values are mirrored through the
/// ends, which stay.
pub(in crate::fields) fn smoothed(values: &[DVec3], sigma: f64) -> Vec<DVec3> {
    let reach = (3.0 * sigma).ceil() as i64;
    let bell: Vec<f64> = (-reach..=reach).map(|n| (-0.5 * (n as f64 / sigma.max(1e-9)).powi(2)).exp()).collect();
    let last = values.len() as i64 - 1;
    let value = |n: i64| match n {
        _ if n < 0 => 2.0 * values[0] - values[(-n).min(last) as usize],
        _ if n > last => 2.0 * values[last as usize] - values[(2 * last - n).max(0) as usize],
        _ => values[n as usize],
    };
    let total: f64 = bell.iter().sum();
    (0..=last).map(|n| bell.iter().zip(n - reach..).map(|(&b, m)| value(m) * b).sum::<DVec3>() / total).collect()
}

/// Tightens a free line towards the middle of the lumen.
///
/// Each point moves to the mean of its neighbours and, in narrow places, up the wall distance (by `lean` mm per round
/// at a distance of 1 mm), as long as both segments to its neighbours stay free. The ends stay.
pub(super) fn tightened(walls: &WallDistance, line: &mut [DVec3], rounds: usize, lean: f64) {
    for _ in 0..rounds {
        for n in 1..line.len().saturating_sub(1) {
            let (before, here, after) = (line[n - 1], line[n], line[n + 1]);
            let slope = if lean > 0.0 { walls.sample(here) } else { None };
            let uphill = slope.map_or(DVec3::ZERO, |s| s.gradient * lean / s.mm.max(1.0));
            let full = 0.5 * (before + after) + uphill;
            let to = [1.0, 0.5, 0.2].map(|share| here.lerp(full, share));
            if let Some(to) = to.into_iter().find(|&p| is_free(walls, before, p) && is_free(walls, p, after)) {
                line[n] = to;
            }
        }
    }
}
