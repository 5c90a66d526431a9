//! How the colon continues from one segment of gas to another: through gas, through fluid, or where the lumen is collapsed.
//!
//! Gas that is interrupted leaves segments. Between the facing ends of two of them, the lumen is full of fluid or collapsed. The
//! cheapest way between these ends is sought through what is there: the curve γ that minimises ∫ P(γ(s)) ds, where P, the cost of
//! a millimetre, is least in lumen, higher in soft tissue, and much higher in fat, bone and other gas (minimal paths, Cohen and
//! Kimmel, *Global minimum for active contour models*, 1997; by the algorithm of Dijkstra, 1959, over blocks of about 2 mm; see
//! `tissue` for P).
//!
//! Where the path leads through neither gas nor fluid, the lumen is assumed to be collapsed, and the path is a **guess**. It is reported
//! and drawn as one, and nothing is ever flown along it.

mod path;
#[cfg(test)]
mod tests;
mod tissue;

use glam::DVec3;

use super::centerline::{length, smoothed, spaced};
use super::lumen::{Lumen, Segment};
use crate::error::Result;
use crate::fields::Values;
use crate::progress::Progress;
use crate::volume::Volume;
use tissue::Costs;

/// Distance between the points of a path, mm.
const STEP_MM: f64 = 1.0;
/// Standard deviation of the Gaussian that smooths a path, in blocks.
const SMOOTH: f64 = 2.0;
/// A stretch shorter than this counts as part of the one before, mm. The edge of fluid is neither fluid nor gas.
const SHORT_MM: f64 = 4.0;
/// Tissue on the path between two segments that fluid joins counts as fluid up to this length, mm: the edge of a fold.
const FOLD_MM: f64 = 10.0;
/// Greatest distance of a requested place from the gas that it is in, mm.
const SNAP_MM: f64 = 5.0;

/// What a stretch leads through.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum StretchKind {
    /// A segment of gas: what is flown.
    Gas,
    /// Tagged fluid that fills the lumen. It is flown only if the scan is cleansed.
    Fluid,
    /// Neither gas nor tagged fluid: the lumen is collapsed, or full of what is not tagged. The way is a guess.
    Collapsed,
}

/// A stretch of the path between two places of the colon.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Stretch {
    /// What it leads through.
    pub kind: StretchKind,
    /// Length, mm.
    pub length_mm: f64,
    /// The segment that it begins in: that of gas, or the one before the gap.
    pub from: usize,
    /// The segment that it ends in: that of gas, or the one behind the gap.
    pub to: usize,
    /// Its points, world, mm.
    #[serde(skip)]
    pub points: Vec<DVec3>,
}

/// The way between two places of the colon, in stretches.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
#[serde(transparent)]
pub struct Connection {
    /// The stretches in order. Each begins where the one before ends.
    pub stretches: Vec<Stretch>,
}

/// A place in the colon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColonPlace {
    /// The rectal end of the first segment.
    Rectum,
    /// The cecal end of the last segment.
    Cecum,
    /// A position in a segment, or within 5 mm of it, world, mm.
    At(DVec3),
}

/// The end of a segment that faces a gap.
#[derive(Clone, Copy, Debug)]
struct Facing<'a> {
    /// The segment's number.
    segment: usize,
    /// Centre of the ball at its end, world, mm.
    at: DVec3,
    /// The way through the segment, world, mm.
    way: &'a [DVec3],
    /// True if the end is that of the path, false if its beginning.
    is_last: bool,
}

impl<'a> Facing<'a> {
    fn of(lumen: &'a Lumen, segment: usize, is_last: bool) -> Option<Self> {
        let s: &Segment = lumen.segments.get(segment)?;
        Some(Self { segment, at: s.ends[usize::from(is_last)], way: &s.way, is_last })
    }

    /// True if the nearest point of the path is at most `mm` before its end.
    fn is_before(&self, place: DVec3, mm: f64) -> bool {
        let far = |n: usize| self.way[n].distance_squared(place);
        let nearest = (0..self.way.len()).reduce(|a, b| if far(b) < far(a) { b } else { a });
        nearest.is_none_or(|n| {
            let rest = if self.is_last { &self.way[n..] } else { &self.way[..=n] };
            length(rest) <= mm
        })
    }
}

impl Connection {
    /// Finds the path from one place of the colon to another: through each segment between them, and through what separates those.
    ///
    /// `None` if a place is in no segment, or both are in the same one. If the order of the segments is not known, the two are
    /// taken to follow each other.
    ///
    /// ```
    /// # mod colvis {
    /// # pub use colvis_kernels::*;
    /// # pub use colvis_phantom as phantom;
    /// # }
    /// use colvis::fields::connection::{ColonPlace, Connection, StretchKind};
    /// use colvis::fields::lumen;
    /// use colvis::phantom::{Phantom, PhantomSettings, Size};
    /// use colvis::progress::Progress;
    ///
    /// let progress = Progress::new();
    /// let settings = PhantomSettings { size: Size::Small, collapsed: true, seed: 3, ..PhantomSettings::default() };
    /// let phantom = Phantom::new(&settings);
    /// let volume = phantom.voxelise(&phantom.grid(), &progress)?;
    /// let lumen = lumen::find(&volume, &progress)?;
    /// let way = Connection::between(&volume, &lumen, ColonPlace::Rectum, ColonPlace::Cecum, &progress)?;
    /// let way = way.expect("it has several segments");
    /// assert_eq!(way.stretches[0].kind, StretchKind::Gas);
    /// assert_eq!(way.stretches[1].kind, StretchKind::Collapsed);
    /// # Ok::<(), colvis::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// Returns status 4 when interrupted.
    pub fn between(
        volume: &Volume,
        lumen: &Lumen,
        from: ColonPlace,
        to: ColonPlace,
        progress: &Progress,
    ) -> Result<Option<Self>> {
        let place = |p: ColonPlace| match p {
            ColonPlace::At(p) => p.is_finite().then(|| lumen.nearest_gas(p, SNAP_MM)).flatten().map(|f| (f.0, Some(p))),
            ColonPlace::Rectum if lumen.ordered => (!lumen.segments.is_empty()).then_some((0, None)),
            ColonPlace::Cecum if lumen.ordered => lumen.segments.len().checked_sub(1).map(|n| (n, None)),
            ColonPlace::Rectum | ColonPlace::Cecum => lumen.largest().map(|n| (n, None)),
        };
        let (Some((first, start)), Some((last, goal))) = (place(from), place(to)) else { return Ok(None) };
        if first == last {
            return Ok(None);
        }
        let (chain, values) = (chain(lumen, first, last), Values::of(volume));
        let mut stretches: Vec<Stretch> = Vec::new();
        let mut entry = start;
        for (n, &(segment, forwards)) in chain.iter().enumerate() {
            let next = chain.get(n + 1);
            let gap = match next {
                Some(&(next, onwards)) => across(&values, lumen, [(segment, forwards), (next, !onwards)], progress)?,
                None => Vec::new(),
            };
            let exit =
                gap.first().and_then(|s: &Stretch| s.points.first().copied()).or(goal.filter(|_| next.is_none()));
            stretches.push(through(&lumen.segments[segment], segment, forwards, entry, exit));
            entry = gap.last().and_then(|s| s.points.last().copied());
            stretches.extend(gap);
        }
        Ok(Some(Self { stretches }))
    }

    /// Returns the length of all stretches of a kind, mm.
    pub fn length_mm(&self, kind: StretchKind) -> f64 {
        self.stretches.iter().filter(|s| s.kind == kind).map(|s| s.length_mm).sum::<f64>() + 0.0
    }
}

/// For example: "3 stretches: 820 mm of gas, 45 mm collapsed (a guess), 610 mm of gas".
impl std::fmt::Display for Connection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} stretches: ", self.stretches.len())?;
        for (n, s) in self.stretches.iter().enumerate() {
            let what = match s.kind {
                StretchKind::Gas => "of gas",
                StretchKind::Fluid => "of fluid",
                StretchKind::Collapsed => "collapsed (a guess)",
            };
            write!(f, "{}{:.0} mm {what}", if n > 0 { ", " } else { "" }, s.length_mm)?;
        }
        Ok(())
    }
}

/// Returns the guesses for a centerline: for each pair of consecutive segments among `which`, the points between which the lumen is
/// collapsed, world, mm, with the first and the last one in gas or fluid. Empty if the order of the segments is not known.
///
/// # Errors
/// Returns status 4 when interrupted.
pub fn guesses(
    volume: &Volume,
    lumen: &Lumen,
    which: std::ops::Range<usize>,
    progress: &Progress,
) -> Result<Vec<Vec<DVec3>>> {
    guesses_in(&Values::of(volume), lumen, which, progress)
}

/// Same as [`guesses`], for a lumen found in a volume with these values.
pub(in crate::fields) fn guesses_in(
    values: &Values<'_>,
    lumen: &Lumen,
    which: std::ops::Range<usize>,
    progress: &Progress,
) -> Result<Vec<Vec<DVec3>>> {
    if !lumen.ordered {
        return Ok(Vec::new());
    }
    let mut out = Vec::new();
    for n in which.start..which.end.saturating_sub(1) {
        let gap = across(values, lumen, [(n, true), (n + 1, false)], progress)?;
        let collapsed = |s: &Stretch| s.kind == StretchKind::Collapsed;
        let guess = match (gap.iter().position(collapsed), gap.iter().rposition(collapsed)) {
            (Some(a), Some(b)) => gap[a..=b].iter().flat_map(|s| &s.points).copied().collect(),
            _ => vec![lumen.segments[n].ends[1], lumen.segments[n + 1].ends[0]],
        };
        out.push(guess);
    }
    Ok(out)
}

/// Returns the segments from one to another, each with whether it is passed from its rectal end to its cecal one.
fn chain(lumen: &Lumen, first: usize, last: usize) -> Vec<(usize, bool)> {
    if lumen.ordered {
        return if first < last {
            (first..=last).map(|n| (n, true)).collect()
        } else {
            (last..=first).rev().map(|n| (n, false)).collect()
        };
    }
    // The ends that are nearest to each other face each other.
    let [a, b] = [first, last].map(|n| lumen.segments[n].ends);
    let far = |p: usize| a[p / 2].distance(b[p % 2]);
    let facing = (1..4).fold(0, |best, p| if far(p) < far(best) { p } else { best });
    vec![(first, facing / 2 == 1), (last, facing % 2 == 0)]
}

/// Returns the stretch through a segment. It begins and ends at given places (world, mm), or at the segment's ends.
fn through(segment: &Segment, number: usize, forwards: bool, entry: Option<DVec3>, exit: Option<DVec3>) -> Stretch {
    let mut way = segment.way.clone();
    if !forwards {
        way.reverse();
    }
    let nearest = |p: DVec3| {
        let far = |n: usize| way[n].distance_squared(p);
        (0..way.len()).reduce(|a, b| if far(b) < far(a) { b } else { a })
    };
    let from = entry.and_then(nearest).unwrap_or(0);
    let to = exit.and_then(nearest).unwrap_or(way.len().saturating_sub(1));
    let between = if from <= to { way.get(from..=to).unwrap_or_default() } else { &[] };
    let points: Vec<DVec3> = entry.into_iter().chain(between.iter().copied()).chain(exit).collect();
    Stretch { kind: StretchKind::Gas, length_mm: length(&points), from: number, to: number, points }
}

/// Returns the stretches between two segments, each given with whether its cecal end faces the gap.
fn across(values: &Values<'_>, lumen: &Lumen, ends: [(usize, bool); 2], progress: &Progress) -> Result<Vec<Stretch>> {
    let [Some(a), Some(b)] = ends.map(|(n, is_last)| Facing::of(lumen, n, is_last)) else { return Ok(Vec::new()) };
    let points = match cheapest(values, lumen, [a, b], progress)? {
        Some(points) => points,
        None if a.at.is_finite() && b.at.is_finite() => spaced(&[a.at, b.at], STEP_MM),
        None => return Ok(Vec::new()),
    };
    Ok(divided(lumen, [a.segment, b.segment], &points))
}

/// Returns the cheapest way between the ends of two segments, world, mm; `None` if one is outside the scan or no position.
fn cheapest(
    values: &Values<'_>,
    lumen: &Lumen,
    ends: [Facing<'_>; 2],
    progress: &Progress,
) -> Result<Option<Vec<DVec3>>> {
    progress.stage("connecting the segments", 0);
    let Some(costs) = Costs::between(values, lumen, ends, progress)? else { return Ok(None) };
    let [start, goal] = ends.map(|e| costs.nearest(e.at));
    let way = path::cheapest(&costs, start, goal, progress)?;
    let inner = way.iter().skip(1).take(way.len().saturating_sub(2)).map(|&n| costs.place(n));
    let line: Vec<DVec3> = std::iter::once(ends[0].at).chain(inner).chain([ends[1].at]).collect();
    Ok(Some(spaced(&smoothed(&line, SMOOTH), STEP_MM)))
}

/// True if tagged fluid joins two segments.
fn is_joined(lumen: &Lumen, [a, b]: [usize; 2]) -> bool {
    lumen.segments.get(a).is_some_and(|s| s.joined_to.contains(&b))
}

/// Divides a path from one segment to another into stretches. What is in the gas of the two at its beginning and end is left out.
fn divided(lumen: &Lumen, [from, to]: [usize; 2], points: &[DVec3]) -> Vec<Stretch> {
    let is_in = |n: usize, p: DVec3| lumen.segment_at(p) == Some(n);
    let leaves = points.iter().rposition(|&p| is_in(from, p)).unwrap_or(0);
    let enters = points.iter().enumerate().skip(leaves + 1).find(|(_, p)| is_in(to, **p));
    let enters = enters.map_or(points.len().saturating_sub(1), |e| e.0);
    let mut stretches: Vec<(StretchKind, usize, usize)> = Vec::new();
    for n in leaves..enters {
        let middle = 0.5 * (points[n] + points[n + 1]);
        let kind = if lumen.is_fluid(middle) { StretchKind::Fluid } else { StretchKind::Collapsed };
        match stretches.last_mut() {
            Some(s) if s.0 == kind => s.2 = n + 1,
            _ => stretches.push((kind, n, n + 1)),
        }
    }
    let least_mm = |kind| match kind {
        StretchKind::Collapsed if is_joined(lumen, [from, to]) => FOLD_MM,
        _ => SHORT_MM,
    };
    let long = |s: &(StretchKind, usize, usize)| length(&points[s.1..=s.2]) >= least_mm(s.0);
    // The edges of fluid, before, between and behind it, are part of it. Fluid too short to matter is not.
    while stretches.len() > 1 {
        let Some(n) = (0..stretches.len()).find(|&n| !long(&stretches[n])) else { break };
        let (_, begins, ends) = stretches.remove(n);
        match n.checked_sub(1) {
            Some(before) => stretches[before].2 = ends,
            None => stretches[0].1 = begins,
        }
        stretches.dedup_by(|b, a| {
            let same = a.0 == b.0;
            if same {
                a.2 = b.2;
            }
            same
        });
    }
    let stretch = |(kind, a, b): (StretchKind, usize, usize)| {
        let points = points[a..=b].to_vec();
        Stretch { kind, length_mm: length(&points), from, to, points }
    };
    stretches.into_iter().map(stretch).collect()
}
