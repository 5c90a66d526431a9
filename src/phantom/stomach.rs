//! The stomach: a J with ridges along it and a fluid level.

use glam::DVec3;

use super::centerline::Centerline;
use super::gut::{Gut, Ridges};
use super::kinds::BodyKind;
use super::stream::stream;

/// Least tissue between the stomach and other gut, mm.
const APART_MM: f64 = 3.6;

/// Control points in an adult's mm LPS with radii: fundus, body, and the antrum that rises to the right.
const PLACES: [([f64; 3], f64); 7] = [
    ([36.0, -32.0, 156.0], 26.0),
    ([28.0, -37.0, 148.0], 29.0),
    ([14.0, -44.0, 136.0], 28.0),
    ([0.0, -47.0, 121.0], 26.0),
    ([-12.0, -45.0, 107.0], 22.0),
    ([-24.0, -40.0, 99.0], 17.0),
    ([-36.0, -34.0, 102.0], 12.0),
];

/// Returns the stomach of a body of `scale` (1 is an adult) with gravity along `down`, away from the balls that are `taken`.
pub(crate) fn place(scale: f64, taken: &[(DVec3, f64)], down: DVec3, seed: u64) -> Gut {
    let shrink = [1.0, 0.96, 0.92, 0.88, 0.84, 0.8, 0.75, 0.7, 0.62, 0.55];
    let tries = shrink.into_iter().flat_map(|share| [3.0, 1.5, 0.0].map(|jitter| (jitter, share)));
    let mut best: Option<(f64, Gut)> = None;
    for (jitter, share) in tries {
        let gut = stomach(scale, jitter, share, taken, seed);
        let room = gut.clearance(taken).min(gut.own_clearance());
        if best.as_ref().is_none_or(|(least, _)| room > *least) {
            best = Some((room, gut));
        }
        if room >= APART_MM {
            break;
        }
    }
    let mut gut = best.map_or_else(|| stomach(scale, 0.0, 0.5, taken, seed), |(_, gut)| gut);
    let mut draw = stream(seed, 104);
    // A share of the height of its lumen.
    let ends = gut.balls().into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), (c, r)| {
        (lo.min(c.dot(down) - r), hi.max(c.dot(down) + r))
    });
    let level = ends.1 - draw.within(0.15, 0.28) * (ends.1 - ends.0);
    let hu = if draw.within(0.0, 1.0) < 0.5 { 20.0 } else { 150.0 };
    gut.fluid = Some((level, down, hu));
    gut
}

/// Returns a stomach whose control points move by up to `jitter` mm, an adult's, and whose radii are a `share` of the usual ones,
/// less where something that is `taken` is near.
fn stomach(scale: f64, jitter: f64, share: f64, taken: &[(DVec3, f64)], seed: u64) -> Gut {
    let mut draw = stream(seed, 105);
    let wide = draw.within(0.94, 1.06);
    let mut all = Vec::new();
    for (at, radius) in PLACES {
        let off = DVec3::new(draw.within(-1.0, 1.0), draw.within(-1.0, 1.0), draw.within(-1.0, 1.0));
        let at = (DVec3::from_array(at) + off * jitter) * scale;
        let room = taken.iter().map(|(c, r)| c.distance(at) - r).fold(f64::INFINITY, f64::min);
        all.push((at, (radius * wide * scale).min(room - APART_MM - 0.5).max(6.0 * scale) * share));
    }
    let ridges = Ridges::Along { count: 7.0, height: draw.within(3.2, 4.6) * scale * share };
    let places: Vec<DVec3> = all.iter().map(|a| a.0).collect();
    let profile: Vec<DVec3> = all.iter().map(|a| DVec3::new(a.1, 0.0, 1.0)).collect();
    Gut::new(BodyKind::Stomach, Centerline::through(&places, &profile), ridges)
}
