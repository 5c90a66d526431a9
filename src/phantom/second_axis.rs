//! The colon's axis in the patient's second position: bent anew, stretched by segment, distended otherwise and turned.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use super::centerline::{Centerline, PARTS};
use super::coordinates::{Along, Motion};
use super::room::has_room;
use super::shape::largest;
use super::spline::Spline;
use super::stream::stream;
use crate::math::hash;
use crate::math::hash::Stream;

/// Largest displacement of the axis, an adult's mm.
const MOVED_MM: f64 = 14.0;
/// Shares of the displacement, the stretching and the change of distension that are tried, and how often each.
const SHARES: [f64; 9] = [1.0, 0.85, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1];
const TRIES: u64 = 12;
/// Largest stretch of a part of the colon against the others. With it, a place's share of the length differs by up to 40 mm: in
/// patients distances along both lines differ by 26 mm on average (98 polyps).
const STRETCH: f64 = 0.3;
/// Largest shift of a control point along the axis, relative to the distance to its nearer neighbour.
const SLIDE: f64 = 0.12;
/// Largest change of the radius, relative to it.
const DISTENSION: f64 = 0.12;
/// Turn about the axis: its largest constant part, and its largest slow waves, degrees.
const TURN_DEG: [f64; 2] = [30.0, 20.0];
/// What of the turn is left at the rectal and at the cecal end, which are held, and the distance over which it grows, an adult's mm.
const HELD: [f64; 2] = [0.2, 0.4];
const HELD_MM: f64 = 150.0;
/// The side that the patient lies on is flatter by this share, and what moves freely falls towards it, an adult's mm.
const FLATTER: f64 = 0.05;
const FALLS_MM: f64 = 5.0;
/// The control points of the sigmoid and of the transverse colon, which move freely.
const FREE: [[usize; 2]; 2] = [[5, 9], [17, 21]];
/// Least tissue between the lumen and the skin, mm.
const BELOW_SKIN_MM: f64 = 8.0;
/// The length may change by this share, and the volume of the lumen by about these factors.
const LENGTH: f64 = 0.1;
const VOLUME: [f64; 2] = [0.75, 1.3];

/// The axis in the second position.
#[derive(Clone, Debug)]
pub(crate) struct Bent {
    pub axis: Centerline,
    pub motion: Motion,
}

/// Returns the axis `first` of a body of `scale` (1 is an adult) with gravity along `down`, bent anew: all that leave the loops their
/// room, those with the largest changes first, and last one with none, which always does. `depth` is the distance (mm) to the skin or
/// the end of the scan at a position (world).
pub(crate) fn bends(
    first: &Centerline,
    scale: f64,
    down: DVec3,
    seed: u64,
    depth: impl Fn(DVec3) -> f64,
) -> impl Iterator<Item = Bent> {
    let room = move |axis: &Centerline| {
        let knots = axis.knots().iter().enumerate();
        knots.map(|(i, c)| depth(*c) - largest(axis, i as f64 * axis.knot_step())).fold(f64::INFINITY, f64::min)
    };
    let needed = BELOW_SKIN_MM.min(room(first));
    let fits = move |axis: &Centerline| is_alike(first, axis) && room(axis) >= needed && has_room(axis);
    let tries = SHARES.iter().flat_map(|&share| (0..TRIES).map(move |_| share)).chain([0.0]).enumerate();
    tries.filter_map(move |(n, share)| {
        let mut draw = stream(hash::bits(seed, 0x2D0 + n as u64), 140);
        let (axis, along) = Bend { first, scale, down }.attempt(share, &mut draw);
        (share <= 0.0 || fits(&axis)).then(|| {
            let turn = turn(first, &axis, &along, scale, seed);
            Bent { axis, motion: Motion { along, turn } }
        })
    })
}

/// True if the length and the volume of a lumen are near those of the first.
fn is_alike(first: &Centerline, second: &Centerline) -> bool {
    let volume = |axis: &Centerline| {
        let area = |i: usize| axis.profile(i as f64 * axis.knot_step()).radius.0.powi(2);
        (0..axis.knots().len()).map(area).sum::<f64>() * axis.knot_step()
    };
    let (length, volume) = (second.length() / first.length(), volume(second) / volume(first));
    (length - 1.0).abs() < LENGTH && (VOLUME[0]..VOLUME[1]).contains(&volume)
}

/// What the axis is bent from.
struct Bend<'a> {
    first: &'a Centerline,
    scale: f64,
    down: DVec3,
}

impl Bend<'_> {
    /// Returns the axis with a `share` of all changes, and the map of arc lengths to it.
    fn attempt(&self, share: f64, draw: &mut Stream) -> (Centerline, Along) {
        let first = self.first;
        let mut places = first.control_points();
        let profile: Vec<DVec3> = first.stations().iter().map(|s| first.profile_at(*s)).collect();
        let middle = places.iter().sum::<DVec3>() / places.len() as f64;
        let bends = Bends::drawn(draw);
        let last = places.len() - 1;
        for (i, place) in places.iter_mut().enumerate() {
            let flatter = self.down * (-FLATTER * (*place - middle).dot(self.down));
            let free = FREE.iter().any(|[from, to]| (*from..=*to).contains(&i));
            let falls = self.down * if free { FALLS_MM } else { 0.0 };
            // The rectum is held.
            let held = (0.1 + 0.3 * i as f64).min(1.0);
            *place += (flatter + (falls + bends.at(i as f64 / last as f64) * MOVED_MM) * self.scale) * (held * share);
        }
        let bent = Centerline::through(&places, &profile);
        let plain = stretched(bent.stations(), share * STRETCH, draw);
        let mut stations = plain.clone();
        for i in 1..last {
            let gap = (plain[i + 1] - plain[i]).min(plain[i] - plain[i - 1]);
            stations[i] += share * SLIDE * gap * draw.within(-1.0, 1.0);
        }
        stations[last] = bent.length();
        let mut from = first.stations().to_vec();
        from[last] = first.length();
        let along = Along::new(from, stations.clone());
        let phases = [draw.within(0.0, 1.0), draw.within(0.0, 1.0)];
        let end = bent.length();
        let wider = |s: f64| 1.0 + share * DISTENSION * waves(s / end, [0.8, 2.1], phases);
        let axis = bent.with_profile(stations, |s| first.profile_at(along.back(s)) * DVec3::new(wider(s), 1.0, 1.0));
        (axis, along)
    }
}

/// Returns the arc lengths of control points if each part of the colon is longer or shorter by up to a share, and all of it is as long.
fn stretched(stations: &[f64], share: f64, draw: &mut Stream) -> Vec<f64> {
    let factors: Vec<f64> = PARTS.iter().map(|_| 1.0 + share * draw.within(-1.0, 1.0)).collect();
    let factor = |i: usize| PARTS.iter().zip(&factors).rev().find(|((_, from), _)| i >= *from).map_or(1.0, |(_, f)| *f);
    let mut along = vec![0.0];
    for (i, pair) in stations.windows(2).enumerate() {
        along.push(along[i] + (pair[1] - pair[0]) * factor(i));
    }
    let scale = stations.last().copied().unwrap_or(0.0) / along.last().copied().unwrap_or(1.0).max(1e-9);
    along.iter().map(|s| s * scale).collect()
}

/// Returns the sum of two waves of these numbers of periods along `u` from 0 to 1 and phases, from −1 to 1.
fn waves(u: f64, periods: [f64; 2], phases: [f64; 2]) -> f64 {
    0.6 * (TAU * (periods[0] * u + phases[0])).sin() + 0.4 * (TAU * (periods[1] * u + phases[1])).sin()
}

/// A smooth displacement along the axis, of a length of at most 1.
struct Bends([(DVec3, DVec3); 4]);

impl Bends {
    fn drawn(draw: &mut Stream) -> Self {
        let mut off = || DVec3::new(draw.within(-1.0, 1.0), draw.within(-1.0, 1.0), draw.within(-1.0, 1.0));
        let mut own = Self([1.0, 0.9, 0.7, 0.5].map(|weight| (off() * weight, off() * weight)));
        let most = (0..=100).map(|i| own.at(f64::from(i) / 100.0).length()).fold(1e-3, f64::max);
        for (a, b) in &mut own.0 {
            (*a, *b) = (*a / most, *b / most);
        }
        own
    }

    fn at(&self, u: f64) -> DVec3 {
        let term = |(i, (a, b)): (usize, &(DVec3, DVec3))| {
            let (sin, cos) = (TAU * (i + 1) as f64 * u).sin_cos();
            *a * sin + *b * cos
        };
        self.0.iter().enumerate().map(term).sum()
    }
}

/// Returns [`Motion::turn`].
fn turn(first: &Centerline, second: &Centerline, along: &Along, scale: f64, seed: u64) -> Spline {
    let mut draw = stream(seed, 141);
    let constant = draw.within(-TURN_DEG[0], TURN_DEG[0]);
    let phases = [draw.within(0.0, 1.0), draw.within(0.0, 1.0)];
    let (step, end) = (second.knot_step(), second.length());
    let held = |x: f64, left: f64| left + (1.0 - left) * (x / (HELD_MM * scale)).min(1.0);
    let mut before = 0.0;
    let points: Vec<DVec3> = (0..second.knots().len())
        .map(|i| {
            let s = (i as f64 * step).min(end);
            let seen = constant + TURN_DEG[1] * waves(s / end, [1.3, 2.9], phases);
            let seen = (seen * held(s, HELD[0]) * held(end - s, HELD[1])).to_radians();
            // The angle of the first frame's normal in the second frame.
            let (a, b) = (first.frame(along.back(s)), second.frame(s));
            let own = b.angle(DQuat::from_rotation_arc(a.tangent, b.tangent) * a.normal);
            let own = own - TAU * ((own - before) / TAU).round();
            before = own;
            DVec3::new(own + seen, seen, 0.0)
        })
        .collect();
    let (n, slope) = (points.len(), |i: usize| (points[i + 1] - points[i]) / step);
    let (from, to) = (slope(0), slope(n - 2));
    Spline::new(step, points, from, to)
}
