//! The line through the middle of the lumen from one end to the other.
//!
//! The way is found over the lumen's cells (see `cells`) at a cost of length × (1 + (8 mm / clearance)²), and led through
//! their voxels from face to face, so that it cannot pass through a wall however thin. That line is pulled straight as
//! long as it stays inside, and moved towards the lumen's axis (see `fit`). Collapsed stretches between two pieces of the
//! lumen are bridged by a straight line, which is listed as a guess.

mod cells;
mod fit;
mod polyline;

use glam::DVec3;

use super::{Lumen, WallDistance};
use crate::error::{Error, Result};
use crate::progress::Progress;
use cells::Cells;

/// Distance of the line's points, mm.
const STEP_MM: f64 = 1.0;
/// A point outside the lumen is moved into it within this, mm.
const SNAP_MM: f64 = 5.0;
/// Clearance at which narrowness begins to cost, mm.
const NARROW_MM: f64 = 8.0;
/// Rounds of pulling the line straight.
const TIGHTEN: usize = 12;
/// What a way loses for each mm that its end is drawn back from the lumen's tip: see [`last_ball`].
const INWARD: f64 = 0.3;
/// The last ball is looked for within this of the tip, mm.
const INWARD_MM: f64 = 45.0;

/// A line through the lumen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Centerline {
    /// World, mm, about 1 mm apart.
    pub points: Vec<DVec3>,
    /// Distance to the wall at each point, mm; 0 on a guessed stretch.
    pub radius_mm: Vec<f64>,
    /// Length, mm.
    pub length_mm: f64,
    /// Stretches (from, to; mm of length) where the lumen is collapsed and the line is only a guess.
    pub guessed: Vec<[f64; 2]>,
}

/// An end of the line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// The centre of the last ball at the lumen's tip near this place (world, mm).
    Tip(DVec3),
    /// This place (world, mm), moved into the lumen within 5 mm.
    At(DVec3),
}

/// The line of a lumen from `from` to `to`. `guesses` are pairs of places (world, mm) between which the lumen may be
/// collapsed (see [`gaps`]); they are used only where there is no other way.
///
/// # Errors
/// Status 4 when an end is not in the lumen, when there is no way, or when interrupted.
pub fn between(
    walls: &WallDistance,
    from: End,
    to: End,
    guesses: &[[DVec3; 2]],
    progress: &Progress,
) -> Result<Centerline> {
    progress.stage("finding the centerline", 0);
    let cells = Cells::of(walls, progress)?;
    let line = route(walls, &cells, from, to, guesses)?;
    progress.check()?;
    Ok(line)
}

/// The two ends of the lumen's piece with the most voxels, world, mm, the lower one first: the farthest place from its
/// widest one, and the farthest from that (a double sweep).
///
/// # Errors
/// Status 4 when there is no lumen, or when interrupted.
pub fn far_ends(walls: &WallDistance, progress: &Progress) -> Result<[DVec3; 2]> {
    let cells = Cells::of(walls, progress)?;
    let clearance = |n: u32| cells.nodes[n as usize].clearance;
    let widest = cells.largest_piece().into_iter().reduce(|a, b| if clearance(b) > clearance(a) { b } else { a });
    let Some(start) = widest else {
        return Err(Error::incomplete("centerline", "there is no lumen in it", "give a scan or a mask that holds one"));
    };
    let farthest = |n: u32| {
        let length = cells.ways(n, None, narrow).length;
        let far = (0..cells.nodes.len() as u32).filter(|&m| length[m as usize].is_finite());
        far.reduce(|a, b| if length[b as usize] > length[a as usize] { b } else { a }).unwrap_or(n)
    };
    let a = farthest(start);
    let b = farthest(a);
    progress.check()?;
    let ends = [a, b].map(|n| cells.place(n));
    Ok(if ends[0].z <= ends[1].z { ends } else { [ends[1], ends[0]] })
}

/// The gaps between segments that follow each other from rectum to cecum and that nothing joins: where the lumen may be
/// collapsed. Empty where the order is not known.
pub fn gaps(lumen: &Lumen) -> Vec<[DVec3; 2]> {
    if !lumen.ordered {
        return Vec::new();
    }
    lumen.segments.windows(2).map(|w| [w[0].ends[1], w[1].ends[0]]).collect()
}

fn narrow(clearance: f64) -> f64 {
    1.0 + (NARROW_MM / clearance.max(0.3)).powi(2)
}

fn route(walls: &WallDistance, cells: &Cells, from: End, to: End, guesses: &[[DVec3; 2]]) -> Result<Centerline> {
    let place = |e: End| match e {
        End::Tip(p) | End::At(p) => p,
    };
    let (start, goal) = (voxel_of(walls, place(from))?, voxel_of(walls, place(to))?);
    let Some(line) = voxel_way(walls, cells, start, goal) else {
        return bridged(walls, cells, (from, to), guesses);
    };
    let mut line: Vec<DVec3> = line.into_iter().map(|v| walls.world(v)).collect();
    let exact = |e: End, v: [i64; 3]| match e {
        End::At(p) if walls.voxel(p) == v => p,
        _ => walls.world(v),
    };
    if let [first, .., last] = &mut line[..] {
        (*first, *last) = (exact(from, start), exact(to, goal));
    }
    let mut line = polyline::resampled(walls, &line, STEP_MM);
    polyline::tightened(walls, &mut line, TIGHTEN);
    if matches!(to, End::Tip(_)) {
        last_ball(walls, &mut line);
    }
    line.reverse();
    if matches!(from, End::Tip(_)) {
        last_ball(walls, &mut line);
    }
    line.reverse();
    let line = polyline::resampled(walls, &line, STEP_MM);
    let line = fit::to_axis(walls, &line, STEP_MM);
    Ok(finished(walls, &polyline::resampled(walls, &line, STEP_MM)))
}

fn finished(walls: &WallDistance, line: &[DVec3]) -> Centerline {
    let radius = |p: &DVec3| crate::fields::Distance::sample(walls, *p).map_or(0.0, |s| s.mm.max(0.0));
    Centerline {
        radius_mm: line.iter().map(radius).collect(),
        length_mm: polyline::length(line),
        points: line.to_vec(),
        guessed: Vec::new(),
    }
}

fn voxel_of(walls: &WallDistance, place: DVec3) -> Result<[i64; 3]> {
    walls.nearest(place, SNAP_MM).ok_or_else(|| {
        let why =
            format!("{:.1},{:.1},{:.1} is not in the lumen, nor within {SNAP_MM} mm of it", place.x, place.y, place.z);
        Error::incomplete("centerline", why, "give a point in the colon's gas or fluid")
    })
}

/// A 6-connected way of voxels, if there is one.
fn voxel_way(walls: &WallDistance, cells: &Cells, start: [i64; 3], goal: [i64; 3]) -> Option<Vec<[i64; 3]>> {
    let (a, b) = (cells.node_at(start)?, cells.node_at(goal)?);
    let ways = cells.ways(a, Some(b), narrow);
    debug_assert!(walls.is_inside(start) && walls.is_inside(goal));
    ways.length[b as usize].is_finite().then(|| cells.voxels(&cells.way(&ways, b), start, goal))
}

/// Draws the end of a line back from the lumen's tip to the centre of the last ball that touches it: on the way in, the
/// clearance grows as fast as the distance from the tip until the ball meets the side walls too. The place where clearance
/// less a share of the way back is largest does not wander on through a lumen that merely widens.
fn last_ball(walls: &WallDistance, line: &mut Vec<DVec3>) {
    let (mut back, mut best) = (0.0, (f64::NEG_INFINITY, line.len()));
    for n in (0..line.len()).rev() {
        if n + 1 < line.len() {
            back += line[n].distance(line[n + 1]);
        }
        // At least half of the line stays.
        if back > INWARD_MM || 2 * n < line.len() {
            break;
        }
        let worth = f64::from(walls.at(walls.voxel(line[n])).unwrap_or(0.0)) - INWARD * back;
        if worth > best.0 {
            best = (worth, n + 1);
        }
    }
    line.truncate(best.1);
}

/// A line over gaps: the lumen's pieces one after the other, a straight guess between each two.
fn bridged(walls: &WallDistance, cells: &Cells, (from, to): (End, End), guesses: &[[DVec3; 2]]) -> Result<Centerline> {
    let place = |e: End| match e {
        End::Tip(p) | End::At(p) => p,
    };
    let piece = |p: DVec3| walls.nearest(p, SNAP_MM).and_then(|v| cells.node_at(v)).map(|n| cells.piece(n));
    let goal = piece(place(to));
    let mut line: Option<Centerline> = None;
    let mut here = from;
    let mut open: Vec<[DVec3; 2]> = guesses.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
    loop {
        let at = piece(place(here));
        if at == goal && at.is_some() {
            let rest = route(walls, cells, here, to, &[])?;
            return Ok(joined(line, rest));
        }
        // Guesses are given in the order of the colon, so the next one from here leads on; none is used twice.
        let Some(next) = open.iter().position(|g| piece(g[0]) == at && at.is_some()) else { break };
        let [a, b] = open.remove(next);
        open.retain(|g| *g != [b, a]);
        line = Some(joined(line, route(walls, cells, here, End::At(a), &[])?));
        here = End::At(b);
    }
    let (a, b) = (place(from), place(to));
    let why =
        format!("no way leads from {:.1},{:.1},{:.1} to {:.1},{:.1},{:.1} in the lumen", a.x, a.y, a.z, b.x, b.y, b.z);
    Err(Error::incomplete("centerline", why, "choose two points of one connected piece of the lumen"))
}

/// A line continued by another, with a guess between them.
fn joined(line: Option<Centerline>, rest: Centerline) -> Centerline {
    let Some(mut line) = line else { return rest };
    let (Some(&a), Some(&b)) = (line.points.last(), rest.points.first()) else { return rest };
    let gap = a.distance(b);
    let steps = (gap / STEP_MM).ceil().max(1.0) as usize;
    for n in 1..steps {
        line.points.push(a.lerp(b, n as f64 / steps as f64));
        line.radius_mm.push(0.0);
    }
    let begins = line.length_mm;
    line.guessed.push([begins, begins + gap]);
    line.guessed.extend(rest.guessed.iter().map(|g| g.map(|s| s + begins + gap)));
    line.length_mm += gap + rest.length_mm;
    line.points.extend(rest.points);
    line.radius_mm.extend(rest.radius_mm);
    line
}
