//! Small bowel: the ileum, and detached loops of jejunum.

use glam::DVec3;

use super::centerline::Centerline;
use super::gut::{Gut, Guts, Ridges};
use super::kinds::BodyKind;
use super::spline::{Beyond, b_spline};
use super::stream::stream;
use super::valve::Valve;
use crate::math::hash::Stream;

/// Least tissue between small bowel and colon, and between two loops of small bowel, mm.
pub(crate) const APART_MM: f64 = 4.5;

/// Control points of the ileum in an adult's mm LPS, from the valve, with the lumen's mean radius. They coil between the
/// transverse colon and the sigmoid.
const ILEUM: [([f64; 3], f64); 18] = [
    ([-70.0, 8.0, -26.0], 9.5),
    ([-66.0, -28.0, -10.0], 10.5),
    ([-28.0, -44.0, -12.0], 11.0),
    ([14.0, -42.0, -14.0], 10.0),
    ([56.0, -36.0, -16.0], 11.0),
    ([80.0, -4.0, -8.0], 10.5),
    ([56.0, 26.0, 0.0], 11.0),
    ([16.0, 12.0, 2.0], 10.0),
    ([-24.0, 16.0, 0.0], 11.5),
    ([-58.0, 28.0, 8.0], 10.5),
    ([-74.0, 8.0, 26.0], 10.0),
    ([-56.0, -18.0, 36.0], 10.5),
    ([-24.0, -24.0, 34.0], 11.0),
    ([8.0, -26.0, 28.0], 10.5),
    ([48.0, -16.0, 30.0], 11.5),
    ([74.0, -2.0, 36.0], 10.5),
    ([74.0, 22.0, 48.0], 10.0),
    ([46.0, 24.0, 60.0], 9.5),
];

/// Least radius of the ileum beside the colon, an adult's, mm.
const LEAST_RADIUS: f64 = 5.0;

/// Middles of detached loops of jejunum in an adult's mm LPS.
const JEJUNUM: [[f64; 3]; 6] = [
    [52.0, 0.0, 92.0],
    [8.0, -22.0, 72.0],
    [72.0, -14.0, 70.0],
    [-28.0, -12.0, 76.0],
    [20.0, 8.0, 104.0],
    [24.0, -18.0, 62.0],
];

/// Tissue between the colon's plain wall and the ileum's end, mm.
const BEHIND_MM: f64 = 3.5;

/// Returns the small bowel of a body of `scale` (1 is an adult), away from the colon's lumen, whose knots `colon` holds, and from
/// the other `tubes`.
pub(crate) fn place(scale: f64, valve: &Valve, colon: &[(DVec3, f64)], seed: u64) -> Guts {
    let mut draw = stream(seed, 98);
    let every_mm = draw.within(5.5, 7.5);
    let ridges = Ridges::Rings { every_mm, height: draw.within(1.4, 2.2) * scale };
    // Where the jitter leaves too little room, less of it, and then a narrower tube.
    let tries = [6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0].into_iter().flat_map(|jitter| [0, 1].map(|k| (jitter, 1.0, k)));
    let narrow = [0.92, 0.85, 0.78, 0.7, 0.62, 0.55].into_iter().map(|share| (0.0, share, 0));
    // The last stretch meets the colon at the valve.
    let near = |b: &(DVec3, f64)| b.0.distance(valve.spot.at) - b.1;
    let colon: Vec<_> = colon.iter().copied().filter(|c| near(c) > 24.0 * scale).collect();
    let mut best: Option<(f64, Gut)> = None;
    for (jitter, share, k) in tries.chain(narrow) {
        let mut draw = stream(seed, 100 + k);
        let gut = ileum(scale, valve, &colon, [jitter, share], ridges, &mut draw);
        let room = gut.clearance(&colon).min(gut.own_clearance());
        if best.as_ref().is_none_or(|(least, _)| room > *least) {
            best = Some((room, gut));
        }
        if room >= APART_MM {
            break;
        }
    }
    let mut tubes: Vec<Gut> = best.map(|(_, gut)| gut).into_iter().collect();
    if let Some(ileum) = tubes.first_mut() {
        pinch(ileum, &mut draw);
    }
    Guts { tubes, passage: valve.slit }
}

/// Returns true if an ileum of least width, in a body of `scale` (1 is an adult), fits beside a colon's `stretches` (arc lengths, mm).
pub(crate) fn leaves_room(axis: &Centerline, stretches: [[f64; 2]; 2], scale: f64) -> bool {
    let ileum: Vec<DVec3> = ILEUM.iter().map(|(at, _)| DVec3::from_array(*at) * scale).collect();
    let places = (4..=4 * (ileum.len() - 1)).map(|i| b_spline(&ileum, 0.25 * i as f64, Beyond::PointReflection));
    let colon: Vec<_> = (stretches.iter())
        .flat_map(|[from, to]| (0..=40).map(move |i| from + (to - from) * f64::from(i) / 40.0))
        .map(|s| (axis.at(s), axis.profile(s).radius.0))
        .collect();
    let least = LEAST_RADIUS * scale + APART_MM;
    places.into_iter().all(|p| colon.iter().all(|(c, r)| c.distance(p) - r >= least))
}

/// Returns the ileum. Its axis ends behind the valve, and it is narrower where the colon is near.
fn ileum(
    scale: f64,
    valve: &Valve,
    colon: &[(DVec3, f64)],
    [jitter, share]: [f64; 2],
    ridges: Ridges,
    draw: &mut Stream,
) -> Gut {
    let into = -valve.spot.up;
    let end_radius = 6.5 * scale.max(0.75);
    let end = valve.spot.at + into * (BEHIND_MM + end_radius);
    // The cecum's side and the plain beside it differ with the seed, so the first points follow the valve.
    let mut all = vec![(end, end_radius), (end + (into * 4.0 + DVec3::Z * 8.0) * scale, 7.0 * scale)];
    all.push((end + (into * 4.0 + DVec3::new(-3.0, -7.0, 22.0)) * scale, 7.5 * share.max(0.8) * scale));
    for (at, radius) in ILEUM {
        let off = DVec3::new(draw.within(-1.0, 1.0), draw.within(-1.0, 1.0), draw.within(-1.0, 1.0));
        let radius = radius * draw.within(0.88, 1.12) * share * scale;
        all.push(((DVec3::from_array(at) + off * jitter) * scale, radius));
    }
    for (at, radius) in &mut all[2..] {
        let room = colon.iter().map(|(c, r)| c.distance(*at) - r).fold(f64::INFINITY, f64::min);
        *radius = radius.min((room - APART_MM - 0.5).max(LEAST_RADIUS * scale));
    }
    all.reverse();
    let places: Vec<DVec3> = all.iter().map(|a| a.0).collect();
    let profile: Vec<DVec3> = all.iter().map(|a| DVec3::new(a.1, 0.0, 1.0)).collect();
    let mut gut = Gut::new(BodyKind::SmallBowel, Centerline::through(&places, &profile), ridges);
    gut.reach_past_end(16.0);
    gut
}

/// Closes the tube in up to three places.
fn pinch(gut: &mut Gut, draw: &mut Stream) {
    let count = draw.within(0.0, 3.999) as usize;
    let end = gut.axis.length();
    for i in 0..count {
        let share = (i as f64 + draw.within(0.3, 0.7)) / count as f64;
        let s = 0.08 * end + 0.72 * end * share;
        gut.pinches.push([s, draw.within(0.9, 1.5) * gut.axis.profile(s).radius.0 + 4.0]);
    }
}

/// Returns two to four detached loops of jejunum for every third seed, away from the balls that are `taken`.
pub(crate) fn jejunum(scale: f64, taken: &[(DVec3, f64)], seed: u64) -> Vec<Gut> {
    let mut draw = stream(seed, 99);
    let count = if seed.is_multiple_of(3) { draw.within(2.0, 4.999) as usize } else { 0 };
    let mut taken = taken.to_vec();
    let mut loops: Vec<Gut> = Vec::new();
    for n in 0..240 {
        if loops.len() == count {
            break;
        }
        let middle = DVec3::from_array(JEJUNUM[n % JEJUNUM.len()]);
        // Smaller and smaller ones, if the first do not fit.
        let shrink = 1.0 - 0.45 * n as f64 / 240.0;
        let mut off =
            |most: f64| DVec3::new(draw.within(-most, most), draw.within(-most, most), draw.within(-most, most));
        let (shift, lean) = (off(14.0), off(1.0).normalize_or(DVec3::X));
        let side = lean.any_orthonormal_vector();
        let long = draw.within(24.0, 40.0) * shrink;
        let radius = draw.within(10.0, 12.5) * shrink;
        let at = |along: f64, up: f64| (middle + shift + lean * (along * long) + side * (up * long)) * scale;
        let places = [at(-0.8, 0.0), at(-0.3, 0.25), at(0.3, 0.25), at(0.8, 0.0)];
        let profile = [0.85, 1.0, 1.05, 0.8].map(|share| DVec3::new(radius * share * scale, 0.0, 1.0));
        let ridges = Ridges::Rings { every_mm: draw.within(5.0, 7.0), height: 2.0 * scale };
        let gut = Gut::new(BodyKind::SmallBowel, Centerline::through(&places, &profile), ridges);
        if gut.clearance(&taken) >= APART_MM + 1.0 {
            taken.extend(gut.balls());
            loops.push(gut);
        }
    }
    loops
}
