//! The line that the wall is unfolded about: for each distance along the colon its middle, its frame, and the level of the harmonic
//! function there.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use glam::DVec3;

use crate::error::Result;
use crate::fields::centerline::Centerline;
use crate::fields::frames::{self, Frame, evenly};
use crate::fields::harmonic::{Domain, Harmonic};
use crate::progress::Progress;

/// Distance between stations, mm.
pub(super) const STEP_MM: f64 = 1.0;
/// A point of the line belongs to the lumen if a voxel of that is within this distance, mm.
const NEAR_MM: f64 = 3.0;
/// The least number of points of the line in a piece of the lumen.
const LEAST: usize = 3;
/// Standard deviation of the smoothing of the line, mm, within the balls around it.
const SMOOTH_MM: f64 = 5.0;
/// Share of a ball's radius that its centre may be moved by.
const MOVED: f64 = 0.6;
/// Each end of the line is led on to the tip of the lumen, at most this far, mm.
const TIP_MM: f64 = 80.0;
/// The way to the tip is smoothed by at most this much, mm.
const TIP_MOVED_MM: f64 = 3.0;
/// The middle of the lumen's tip is farther from the wall than this, mm, unless all of it is narrower: a catheter's inside is no tip.
const ROOMY_MM: f64 = 3.0;
/// What is within this many times as far from such a place belongs to it.
const BESIDE: f64 = 1.8;
/// Share of the mean rise by which equal values at an end rise.
const HAIR: f64 = 1e-6;
/// The solver stops at this share of the solution's energy norm.
const TOLERANCE: f64 = 3e-4;

/// The line at one distance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Station {
    /// Distance along the line from the rectum, mm.
    pub mm: f64,
    /// The middle, and the frame about it, world.
    pub frame: Frame,
    /// The harmonic function there; it grows from station to station.
    pub level: f64,
}

/// The line through one connected piece of the lumen, from its rectal to its cecal tip.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    /// The domain's component.
    pub component: u32,
    /// Stations, [`STEP_MM`] apart or a little less.
    pub stations: Vec<Station>,
}

/// The line through all pieces, and the function on them.
pub(super) struct Axis {
    pub pieces: Vec<Piece>,
    pub harmonic: Harmonic,
}

/// Part of the line in one component: its first and last point, and how many of them lie in it.
#[derive(Clone, Copy, Debug)]
struct Span {
    component: u32,
    first: usize,
    last: usize,
    count: usize,
}

impl Axis {
    /// Leads `line` through the lumen of `domain` and solves for the function.
    pub(super) fn new(domain: &Domain, line: &Centerline, progress: &Progress) -> Result<Self> {
        let mut mm = Vec::with_capacity(line.points.len());
        let mut sum = 0.0;
        for (n, &p) in line.points.iter().enumerate() {
            sum += n.checked_sub(1).map_or(0.0, |before| line.points[before].distance(p));
            mm.push(sum);
        }
        let (even, _) = evenly(&line.points);
        let frames = frames::frames(&even);
        let (mut held, mut sources, mut caps) = (Vec::new(), Vec::new(), Vec::new());
        for span in spans(domain, line, &mm) {
            progress.check()?;
            let own = &line.points[span.first..=span.last];
            let back: Vec<DVec3> = own.iter().rev().copied().collect();
            let (Some(low), Some(high)) = (Cap::new(domain, &back), Cap::new(domain, own)) else { continue };
            held.push((low.start, 0.0));
            for (cap, flow) in [(&low, -1.0), (&high, 1.0)] {
                let whole: f64 = cap.wide.iter().map(|&n| domain.volume_mm3(n)).sum();
                sources.extend(cap.wide.iter().map(|&n| (n, flow * domain.volume_mm3(n) / whole)));
            }
            caps.push((span, low, high));
        }
        let harmonic = Harmonic::solve(domain, &held, &sources, TOLERANCE, progress)?;
        let mut paths: Vec<(Span, Path)> = caps
            .into_iter()
            .map(|(span, low, high)| {
                let ways = [low.way(domain, |n| -harmonic.value(n)), high.way(domain, |n| harmonic.value(n))];
                (span, Path::new(line, &mm, span, ways))
            })
            .collect();
        // What reaches into a gap from either side keeps to its half.
        let borders: Vec<f64> = paths.windows(2).map(|w| 0.5 * (mm[w[0].0.last] + mm[w[1].0.first])).collect();
        for (n, (span, path)) in paths.iter_mut().enumerate() {
            let low = n.checked_sub(1).map_or(f64::NEG_INFINITY, |n| borders[n]);
            path.squeeze([mm[span.first], mm[span.last]], [low, borders.get(n).copied().unwrap_or(f64::INFINITY)]);
        }
        let pieces = paths.into_iter().map(|(span, path)| path.piece(domain, &harmonic, &frames, span.component));
        Ok(Self { pieces: pieces.filter(|p| p.stations.len() > 1).collect(), harmonic })
    }
}

/// Returns the parts of the line in the components of the lumen, in order, none within another.
fn spans(domain: &Domain, line: &Centerline, mm: &[f64]) -> Vec<Span> {
    let mut all: Vec<Span> = Vec::new();
    for (n, &p) in line.points.iter().enumerate() {
        if line.guessed.iter().any(|[a, b]| *a < mm[n] && mm[n] < *b) {
            continue;
        }
        let Some((cell, _)) = domain.nearest(p, NEAR_MM) else { continue };
        let component = domain.component(cell);
        match all.iter_mut().find(|s| s.component == component) {
            Some(span) => (span.last, span.count) = (n, span.count + 1),
            None => all.push(Span { component, first: n, last: n, count: 1 }),
        }
    }
    let mut kept: Vec<Span> = Vec::new();
    for span in all.into_iter().filter(|s| s.count >= LEAST) {
        // Of two that overlap the longer one is the colon.
        while kept.last().is_some_and(|k| k.last >= span.first && k.count < span.count) {
            kept.pop();
        }
        if kept.last().is_none_or(|k| k.last < span.first) {
            kept.push(span);
        }
    }
    kept
}

/// The points that lead through a piece from tip to tip.
struct Path {
    points: Vec<DVec3>,
    /// Distance along the line, mm: below 0 before its start.
    mm: Vec<f64>,
    /// How far each may be moved, mm.
    free: Vec<f64>,
}

impl Path {
    fn new(line: &Centerline, mm: &[f64], span: Span, [low, high]: [Vec<DVec3>; 2]) -> Self {
        let own = span.first..=span.last;
        let (mut points, mut along) = (line.points[own.clone()].to_vec(), mm[own.clone()].to_vec());
        let mut free: Vec<f64> = line.radius_mm[own].iter().map(|r| MOVED * r).collect();
        for way in [high, low] {
            let (last, sign) = (points.len() - 1, (along[along.len() - 1] - along[0]).signum());
            let length: f64 = way.windows(2).map(|w| w[0].distance(w[1])).sum();
            let mut gone = 0.0;
            for w in way.windows(2) {
                let part = w[0].distance(w[1]);
                let steps = (part / STEP_MM).ceil().max(1.0) as usize;
                for n in 1..=steps {
                    let share = n as f64 / steps as f64;
                    points.push(w[0].lerp(w[1], share));
                    along.push(along[last] + sign * (gone + share * part));
                    free.push((MOVED * (length - gone - share * part)).min(TIP_MOVED_MM));
                }
                gone += part;
            }
            // Once for either end.
            points.reverse();
            along.reverse();
            free.reverse();
        }
        Self { points, mm: along, free }
    }

    /// Shortens the distances beyond the line's ends so that they stay within the borders, mm.
    fn squeeze(&mut self, ends: [f64; 2], borders: [f64; 2]) {
        let (Some(&first), Some(&last)) = (self.mm.first(), self.mm.last()) else { return };
        let share = |reach: f64, room: f64| if reach > room { room / reach } else { 1.0 };
        let (before, behind) =
            (share(ends[0] - first, ends[0] - borders[0]), share(last - ends[1], borders[1] - ends[1]));
        for mm in &mut self.mm {
            if *mm < ends[0] {
                *mm = ends[0] - (ends[0] - *mm) * before;
            } else if *mm > ends[1] {
                *mm = ends[1] + (*mm - ends[1]) * behind;
            }
        }
    }

    /// Smooths the line within its balls and looks up the function.
    fn piece(self, domain: &Domain, harmonic: &Harmonic, frames: &[Frame], component: u32) -> Piece {
        let middles = self.smoothed();
        let levels: Vec<f64> = middles
            .iter()
            .map(|&at| match domain.nearest(at, NEAR_MM) {
                Some((cell, _)) if domain.component(cell) == component => harmonic.at(domain, cell, domain.local(at)),
                _ => f64::NAN,
            })
            .collect();
        let levels = rising(&levels);
        let stations = middles.into_iter().zip(self.mm).zip(levels).map(|((at, mm), level)| {
            let frame = frame_at(frames, mm);
            Station { mm, frame: Frame { at, ..frame }, level }
        });
        Piece { component, stations: stations.collect() }
    }

    fn smoothed(&self) -> Vec<DVec3> {
        let count = self.points.len() as i64;
        let reach = (3.0 * SMOOTH_MM / STEP_MM) as i64;
        let mut now = self.points.clone();
        // The second round smooths what was stopped at the border of a ball.
        for sigma in [SMOOTH_MM, 0.4 * SMOOTH_MM] {
            let smooth = |n: i64| {
                let reach = reach.min(n).min(count - 1 - n);
                let sum = (-reach..=reach).fold((DVec3::ZERO, 0.0), |(p, w), d| {
                    let weight = (-0.5 * (d as f64 * STEP_MM / sigma).powi(2)).exp();
                    (p + now[(n + d) as usize] * weight, w + weight)
                });
                let (own, free) = (self.points[n as usize], self.free[n as usize]);
                own + (sum.0 / sum.1 - own).clamp_length_max(free)
            };
            now = (0..count).map(smooth).collect();
        }
        now
    }
}

fn micrometres(mm: f64) -> u64 {
    (mm * 1000.0) as u64
}

/// What lies beyond an end of the line: the cells to which no other point of it is nearer.
struct Cap {
    /// The cell at the line's end.
    start: u32,
    /// The end, in the coordinates of [`Domain::local`].
    end: DVec3,
    /// Its cells, each with its distance from the line's end through the lumen, in micrometres, and the cell before it on the way there.
    reached: BTreeMap<u32, (u64, u32)>,
    /// Those of its cells that are not in a narrow pocket or in a catheter.
    wide: Vec<u32>,
}

impl Cap {
    /// Finds what lies beyond the last point of a line; `None` if that is not in the lumen.
    fn new(domain: &Domain, line: &[DVec3]) -> Option<Self> {
        let (last, before) = line.split_last()?;
        let before: Vec<DVec3> = before.iter().rev().step_by(2).map(|&p| domain.local(p)).collect();
        let (start, _) = domain.nearest(*last, NEAR_MM)?;
        let end = domain.local(*last);
        let is_beyond = |p: DVec3| {
            let own = p.distance_squared(end);
            own < TIP_MM * TIP_MM && before.iter().all(|q| own <= p.distance_squared(*q))
        };
        // Dijkstra's algorithm; whole lengths, so that equal ones are taken in the order of their cells.
        let mut reached: BTreeMap<u32, (u64, u32)> = BTreeMap::from([(start, (0, start))]);
        let mut open = BinaryHeap::from([Reverse((0, start))]);
        while let Some(Reverse((far, cell))) = open.pop() {
            if reached.get(&cell).is_some_and(|r| r.0 < far) {
                continue;
            }
            for link in domain.neighbours(cell) {
                let there = far + micrometres(domain.centre(cell).distance(domain.centre(link.to)));
                let is_nearer = reached.get(&link.to).is_none_or(|r| there < r.0);
                if is_nearer && is_beyond(domain.centre(link.to)) {
                    reached.insert(link.to, (there, cell));
                    open.push(Reverse((there, link.to)));
                }
            }
        }
        let mut cap = Self { start, end, reached, wide: Vec::new() };
        cap.wide = cap.roomy(domain);
        Some(cap)
    }

    /// Returns the cells of the wide part: those beside a place that is farther from the wall than a catheter's inside ever is; all, if
    /// there is no such place.
    fn roomy(&self, domain: &Domain) -> Vec<u32> {
        let size = domain.cell_mm();
        let area = DVec3::new(size.y * size.z, size.z * size.x, size.x * size.y);
        let whole = 2.0 * (area / size).element_sum();
        let is_beside_wall = |n: &u32| {
            let sum: f64 = domain.neighbours(*n).iter().map(|l| f64::from(l.conductance)).sum();
            sum < 0.99 * whole
        };
        let wall = self.reached.keys().copied().filter(is_beside_wall);
        let far = self.spread(domain, wall.map(|n| (n, micrometres(0.5 * size.min_element()))).collect());
        let mut roomy: Vec<u32> = far.into_iter().filter(|f| f.1 >= micrometres(ROOMY_MM)).map(|f| f.0).collect();
        if roomy.is_empty() {
            return self.reached.keys().copied().collect();
        }
        let near = self.spread(domain, roomy.iter().map(|&n| (n, 0)).collect());
        roomy = near.into_iter().filter(|f| f.1 <= micrometres(BESIDE * ROOMY_MM)).map(|f| f.0).collect();
        roomy
    }

    /// Returns the least distance of each cell from some of them through the lumen, in micrometres.
    fn spread(&self, domain: &Domain, from: Vec<(u32, u64)>) -> BTreeMap<u32, u64> {
        let mut far: BTreeMap<u32, u64> = from.into_iter().collect();
        let mut open: BinaryHeap<Reverse<(u64, u32)>> = far.iter().map(|(n, far)| Reverse((*far, *n))).collect();
        while let Some(Reverse((own, cell))) = open.pop() {
            if far[&cell] < own {
                continue;
            }
            for link in domain.neighbours(cell).iter().filter(|l| self.reached.contains_key(&l.to)) {
                let there = own + micrometres(domain.centre(cell).distance(domain.centre(link.to)));
                if far.get(&link.to).is_none_or(|f| there < *f) {
                    far.insert(link.to, there);
                    open.push(Reverse((there, link.to)));
                }
            }
        }
        far
    }

    /// Returns the way (world, mm) from the line's end to the tip of the lumen beyond it, as straight as the lumen lets it be: to the
    /// cell of the greatest value in its wide part.
    fn way(&self, domain: &Domain, value: impl Fn(u32) -> f64) -> Vec<DVec3> {
        let best = |a: u32, b: u32| if value(b) > value(a) { b } else { a };
        let tip = self.wide.iter().copied().fold(self.start, best);
        let mut way = vec![tip];
        while let Some(&(_, before)) = way.last().and_then(|n| self.reached.get(n)).filter(|r| Some(&r.1) != way.last())
        {
            way.push(before);
        }
        way.reverse();
        let mut points = vec![self.end];
        let mut at = 0;
        while at + 1 < way.len() {
            let from = points[points.len() - 1];
            let seen = (at + 1..way.len()).rev().find(|&n| is_seen(domain, from, domain.centre(way[n]) - from));
            at = seen.unwrap_or(at + 1);
            points.push(domain.centre(way[at]));
        }
        points.into_iter().map(|p| domain.world(p)).collect()
    }
}

/// True if the straight way from a place stays in the lumen.
fn is_seen(domain: &Domain, from: DVec3, away: DVec3) -> bool {
    let spacing = domain.grid().spacing();
    let steps = (away.length() / (0.5 * spacing.min_element())).ceil().max(1.0);
    (0..=steps as usize).all(|n| {
        let at = (from + away * (n as f64 / steps)) / spacing;
        domain.cell(at.round().to_array().map(|x| x as i64)).is_some()
    })
}

/// Returns the frame at a distance along the line, mm, from those every [`frames::STEP_MM`].
fn frame_at(frames: &[Frame], mm: f64) -> Frame {
    let last = frames.len() - 1;
    let at = (mm / frames::STEP_MM).clamp(0.0, last as f64);
    let (a, b, share) = (frames[at.floor() as usize], frames[at.ceil() as usize], at.fract());
    let tangent = a.tangent.lerp(b.tangent, share).normalize_or(a.tangent);
    let normal = a.normal.lerp(b.normal, share).reject_from(tangent).normalize_or(a.normal);
    Frame { at: a.at.lerp(b.at, share), tangent, normal }
}

/// Returns the nearest values that never fall (isotonic regression, pool adjacent violators), those that are NaN interpolated, and
/// made to rise by a hair where they are equal.
fn rising(values: &[f64]) -> Vec<f64> {
    let mut pools: Vec<(f64, usize, usize)> = Vec::new();
    for (n, &value) in values.iter().enumerate().filter(|v| !v.1.is_nan()) {
        pools.push((value, 1, n));
        while let [.., a, b] = pools[..] {
            if a.0 < b.0 {
                break;
            }
            pools.pop();
            let count = a.1 + b.1;
            let mean = (a.0 * a.1 as f64 + b.0 * b.1 as f64) / count as f64;
            let last = pools.len() - 1;
            pools[last] = (mean, count, b.2);
        }
    }
    // Each pool's value at its middle, linear between, and beyond the last ones as from there to the ends.
    let last = (values.len().max(2) - 1) as f64;
    let mut knots: Vec<(f64, f64)> =
        pools.into_iter().map(|(value, count, end)| (end as f64 - 0.5 * (count - 1) as f64, value)).collect();
    let (Some(&first), Some(&end)) = (knots.first(), knots.last()) else { return vec![0.0; values.len()] };
    let rise = ((end.1 - first.1) / last).max(f64::MIN_POSITIVE);
    if first.0 > 0.0 {
        knots.insert(0, (0.0, first.1 - HAIR * rise * first.0));
    }
    if end.0 < last {
        knots.push((last, end.1 + HAIR * rise * (last - end.0)));
    }
    if knots.len() == 1 {
        knots.push((last, end.1 + rise));
    }
    let mut at = 0;
    (0..values.len())
        .map(|n| {
            let n = n as f64;
            while at + 2 < knots.len() && knots[at + 1].0 <= n {
                at += 1;
            }
            let (a, b) = (knots[at], knots[at + 1]);
            a.1 + (b.1 - a.1) * ((n - a.0) / (b.0 - a.0)).clamp(0.0, 1.0)
        })
        .collect()
}
