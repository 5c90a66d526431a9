//! The line through the middle of the lumen from one end to the other.
//!
//! The path is found over the lumen's cells (see `cells`) at a cost of length × (1 + (8 mm / clearance)²). It runs
//! through their voxels from face to face, so it cannot pass through a wall, however thin. The line is then tightened
//! while it stays inside, and moved towards the lumen's axis (see `fit`). Collapsed stretches between two pieces of the
//! lumen are bridged along guesses (see `connection`), which are listed.

mod cells;
mod fit;
pub mod legs;
mod model;
mod nearest;
mod peel;
mod polyline;
mod roadmap;
#[cfg(test)]
mod tests;

use glam::DVec3;

use super::{Lumen, WallDistance};
use crate::error::{Error, Result};
use crate::progress::Progress;

pub(in crate::fields) use cells::{Cells, Shape};
pub use model::{BODY_MM, Centerline, Narrow};
pub(in crate::fields) use nearest::NearestOnLines;
pub(in crate::fields) use polyline::{length, smoothed, spaced};

/// Distance between the line's points, mm.
const STEP_MM: f64 = 1.0;
/// Maximum distance over which a point outside the lumen is moved into it, mm.
const SNAP_MM: f64 = 5.0;
/// Clearance at which narrowness begins to add cost, mm.
const NARROW_MM: f64 = 8.0;
/// Number of tightening rounds before and after the line is moved towards the axis. The later ones do not lean away
/// from walls, since walls push the line off the axis.
const TIGHTEN: usize = 12;
const EVEN: usize = 4;
/// Clearance that each millimetre of retreat from the lumen's tip must gain, mm: see [`last_ball`].
const INWARD: f64 = 0.3;
/// Maximum distance of the lumen's tip from the known end, mm.
const TIP_MM: f64 = 40.0;
/// Minimum clearance of a tip, mm, so that a catheter's tube does not count as one. It is lower if the known end is narrower.
const TIP_CLEARANCE_MM: f64 = 3.5;
/// Maximum distance of the last ball from the tip, mm.
const INWARD_MM: f64 = 45.0;

/// An end of the line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// The centre of the last ball at the lumen's tip near this position (world, mm).
    Tip(DVec3),
    /// This position (world, mm), moved into the lumen by at most 5 mm.
    At(DVec3),
}

/// The method that finds the line. Its name appears on the command line, in scene files and in `explain`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum CenterlineMethod {
    /// The shortest path over the lumen's cells that keeps away from walls, tightened and moved to the lumen's axis.
    #[default]
    #[serde(rename = "penalised")]
    PenalisedPath,
    /// The remainder of peeling the lumen from the wall inwards (see `peel`), tightened.
    #[serde(rename = "peel-onion")]
    PeelOnion,
    /// The shortest path along overlapping inscribed balls at sampled positions (see `roadmap`).
    #[serde(rename = "roadmap")]
    Roadmap,
    /// The shortest path over the lumen's cells, voxel by voxel.
    #[serde(rename = "cell-decomposition")]
    Cells,
}

impl CenterlineMethod {
    /// All methods.
    pub const ALL: [Self; 4] = [Self::PenalisedPath, Self::PeelOnion, Self::Roadmap, Self::Cells];

    /// Returns the method's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::PenalisedPath => "penalised",
            Self::PeelOnion => "peel-onion",
            Self::Roadmap => "roadmap",
            Self::Cells => "cell-decomposition",
        }
    }

    /// Returns a short description for help and `explain`.
    pub fn summary(self) -> &'static str {
        match self {
            Self::PenalisedPath => "the path over cells that keeps away from walls, moved to the axis",
            Self::PeelOnion => "the line that remains when the lumen is peeled from the wall inwards",
            Self::Roadmap => "along inscribed balls that overlap",
            Self::Cells => "over cells of the lumen, voxel by voxel",
        }
    }
}

/// Finds the line of a lumen from `from` to `to`.
///
/// `guesses` are lines (world, mm) from one piece of the lumen to another, between which it may be collapsed (see
/// [`connection::guesses`](crate::fields::connection::guesses) and [`gaps`]). They are used only if there is no other path.
///
/// # Errors
/// Returns status 4 if an end is not in the lumen, if there is no path, or when interrupted.
pub fn between(
    walls: &WallDistance,
    from: End,
    to: End,
    guesses: &[Vec<DVec3>],
    progress: &Progress,
) -> Result<Centerline> {
    by(CenterlineMethod::PenalisedPath, walls, from, to, guesses, progress)
}

/// Same as [`between`], over the cells of the lumen. `guesses` are asked for only if there is no other path.
pub(in crate::fields) fn over_cells(
    walls: &WallDistance,
    cells: &mut Cells,
    [from, to]: [End; 2],
    guesses: impl FnOnce() -> Result<Vec<Vec<DVec3>>>,
    progress: &Progress,
) -> Result<Centerline> {
    search((CenterlineMethod::PenalisedPath, true), walls, cells, [from, to], guesses, progress)
}

/// Same as [`between`], with another method.
///
/// # Errors
/// Same as [`between`].
pub fn by(
    method: CenterlineMethod,
    walls: &WallDistance,
    from: End,
    to: End,
    guesses: &[Vec<DVec3>],
    progress: &Progress,
) -> Result<Centerline> {
    let smooth = matches!(method, CenterlineMethod::PenalisedPath | CenterlineMethod::PeelOnion);
    let mut cells = Cells::of(walls, 0.0, progress)?;
    search((method, smooth), walls, &mut cells, [from, to], || Ok(guesses.to_vec()), progress)
}

/// Same as [`by`], for a body to follow. The line is tightened and leans away from walls, whichever method found it.
/// Some methods lead from voxel to voxel or from ball to ball.
///
/// # Errors
/// Same as [`between`].
pub fn to_fly(
    method: CenterlineMethod,
    walls: &WallDistance,
    from: End,
    to: End,
    progress: &Progress,
) -> Result<Centerline> {
    let mut cells = Cells::of(walls, 0.0, progress)?;
    search((method, true), walls, &mut cells, [from, to], || Ok(Vec::new()), progress)
}

fn search(
    (method, smooth): (CenterlineMethod, bool),
    walls: &WallDistance,
    cells: &mut Cells,
    [from, to]: [End; 2],
    guesses: impl FnOnce() -> Result<Vec<Vec<DVec3>>>,
    progress: &Progress,
) -> Result<Centerline> {
    progress.stage("finding the centerline", 0);
    cells.link(walls, 0.0);
    let planner = Planner { method, smooth, walls, cells, progress };
    let Some(line) = planner.route(from, to)? else { return planner.bridged(from, to, guesses()?) };
    if line.impassable().is_empty() {
        return Ok(line);
    }
    // Through openings wide enough for the body, if there are any.
    cells.link(walls, BODY_MM);
    Ok(Planner { method, smooth, walls, cells, progress }.route(from, to)?.unwrap_or(line))
}

/// Returns the two ends of the lumen's piece with the most voxels, world, mm, the lower one first. They are the
/// position farthest from the widest one, and the position farthest from that (a double sweep).
///
/// # Errors
/// Returns status 4 if there is no lumen, or when interrupted.
pub fn far_ends(walls: &WallDistance, progress: &Progress) -> Result<[DVec3; 2]> {
    let cells = Cells::of(walls, 0.0, progress)?;
    let clearance = |n: u32| cells.nodes[n as usize].clearance();
    let widest = cells.largest_piece().into_iter().reduce(|a, b| if clearance(b) > clearance(a) { b } else { a });
    let Some(start) = widest else {
        return Err(Error::incomplete("centerline", "it contains no lumen", "give a scan or a mask with a lumen"));
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

/// Returns the gaps between consecutive gas segments from rectum to cecum, where the lumen may be collapsed, as straight lines. If
/// fluid joins two segments, their gap is within one piece of the lumen and is not used. Empty if the order is unknown.
pub fn gaps(lumen: &Lumen) -> Vec<Vec<DVec3>> {
    if !lumen.ordered {
        return Vec::new();
    }
    lumen.segments.windows(2).map(|w| vec![w[0].ends[1], w[1].ends[0]]).collect()
}

fn narrow(clearance: f64) -> f64 {
    1.0 + (NARROW_MM / clearance.max(0.3)).powi(2)
}

/// Inputs of the search for a line.
#[derive(Clone, Copy)]
struct Planner<'a> {
    method: CenterlineMethod,
    /// True if the line is tightened.
    smooth: bool,
    walls: &'a WallDistance,
    cells: &'a Cells,
    progress: &'a Progress,
}

impl Planner<'_> {
    /// Finds the line within one piece of the lumen; `None` if the ends are in different pieces.
    fn route(&self, from: End, to: End) -> Result<Option<Centerline>> {
        let walls = self.walls;
        let (start, goal) = (voxel_of(walls, from.place())?, voxel_of(walls, to.place())?);
        let Some((start, goal, nodes)) = self.tips((from, start), (to, goal)) else { return Ok(None) };
        let Some(mut line) = self.way(start, goal, &nodes)? else { return Ok(None) };
        self.progress.check()?;
        if let [first, .., last] = &mut line[..] {
            (*first, *last) = (from.within(walls, start), to.within(walls, goal));
        }
        let mut line = polyline::resampled(walls, &line, STEP_MM);
        if self.smooth {
            polyline::tightened(walls, &mut line, TIGHTEN, polyline::LEAN);
        }
        for end in [to, from] {
            if matches!(end, End::Tip(_)) {
                last_ball(walls, &mut line);
            }
            line.reverse();
        }
        if self.method == CenterlineMethod::PenalisedPath {
            line = fit::to_axis(walls, &polyline::resampled(walls, &line, STEP_MM), STEP_MM);
            polyline::tightened(walls, &mut line, EVEN, 0.0);
        }
        Ok(Some(finished(walls, &polyline::resampled(walls, &line, STEP_MM))))
    }

    /// Finds a path inside the lumen, if there is one, world, mm. `nodes` lead from the start's node to the goal's.
    fn way(&self, start: [i64; 3], goal: [i64; 3], nodes: &[u32]) -> Result<Option<Vec<DVec3>>> {
        let walls = self.walls;
        let world = |way: Vec<[i64; 3]>| way.into_iter().map(|v| walls.world(v)).collect();
        match self.method {
            CenterlineMethod::PenalisedPath | CenterlineMethod::Cells => {
                Ok(Some(world(self.cells.voxels(nodes, start, goal))))
            }
            CenterlineMethod::PeelOnion => Ok(peel::peeled(walls, start, goal, self.progress)?.map(world)),
            CenterlineMethod::Roadmap => roadmap::way(walls, start, goal, self.progress),
        }
    }

    /// Moves ends that are tips to the nearby position farthest along the lumen from the other end. Returns the ends
    /// and the nodes of the path between them; `None` if there is no path.
    fn tips(
        &self,
        (from, start): (End, [i64; 3]),
        (to, goal): (End, [i64; 3]),
    ) -> Option<([i64; 3], [i64; 3], Vec<u32>)> {
        let cells = self.cells;
        let (a, b) = (cells.node_at(start)?, cells.node_at(goal)?);
        let search = |from: u32, to: u32, end: End| {
            let ways = cells.ways(from, matches!(end, End::At(_)).then_some(to), narrow);
            let clearance = |n: u32| cells.nodes[n as usize].clearance();
            let roomy = clearance(to).min(TIP_CLEARANCE_MM);
            let near = (0..cells.nodes.len() as u32).filter(|&n| {
                matches!(end, End::Tip(p) if cells.place(n).distance(p) < TIP_MM)
                    && clearance(n) >= roomy
                    && ways.length[n as usize].is_finite()
            });
            let farthest = near.fold(to, |m, n| if ways.length[n as usize] > ways.length[m as usize] { n } else { m });
            (ways, farthest)
        };
        let (ways, tip) = search(a, b, to);
        if !ways.length[b as usize].is_finite() {
            return None;
        }
        let goal = if tip == b { goal } else { cells.widest(tip) };
        if matches!(from, End::At(_)) {
            return Some((start, goal, cells.way(&ways, tip)));
        }
        let (back, first) = search(tip, a, from);
        let start = if first == a { start } else { cells.widest(first) };
        let mut nodes = cells.way(&back, first);
        nodes.reverse();
        Some((start, goal, nodes))
    }

    /// Returns the connected piece of the lumen at a position (world, mm).
    fn piece(&self, place: DVec3) -> Option<u32> {
        let voxel = self.walls.nearest(place, SNAP_MM)?;
        self.cells.node_at(voxel).map(|n| self.cells.piece(n))
    }

    /// Finds a line across gaps: the lumen's pieces in order, joined by guesses.
    fn bridged(&self, from: End, to: End, mut open: Vec<Vec<DVec3>>) -> Result<Centerline> {
        let goal = self.piece(to.place());
        let mut line: Option<Centerline> = None;
        let mut here = from;
        let mut guess: Vec<DVec3> = Vec::new();
        // A guess within one piece is not needed.
        let ends = |g: &[DVec3]| Some([*g.first()?, *g.last()?]);
        open.retain(|g| ends(g).is_some_and(|[a, b]| self.piece(a) != self.piece(b)));
        let starts = |g: &[DVec3]| g.first().and_then(|&a| self.piece(a));
        let stops = |g: &[DVec3]| g.last().and_then(|&b| self.piece(b));
        // Guesses follow each other along the colon, towards the cecum or back towards the rectum.
        if open
            .iter()
            .position(|g| stops(g) == self.piece(from.place()))
            .is_some_and(|at| open[..=at].iter().any(|g| starts(g) == goal))
        {
            open.iter_mut().for_each(|g| g.reverse());
            open.reverse();
        }
        loop {
            let at = self.piece(here.place());
            if at == goal {
                return match self.route(here, to)? {
                    Some(rest) => Ok(joined(line, &guess, rest)),
                    None => Err(no_way(from, to)),
                };
            }
            let Some(next) = open.iter().position(|g| starts(g) == at) else { return Err(no_way(from, to)) };
            let next = open.remove(next);
            let Some([a, b]) = ends(&next) else { return Err(no_way(from, to)) };
            let part = self.route(here, End::At(a))?.ok_or_else(|| no_way(from, to))?;
            line = Some(joined(line, &guess, part));
            (here, guess) = (End::At(b), next);
        }
    }
}

impl End {
    fn place(self) -> DVec3 {
        match self {
            Self::Tip(p) | Self::At(p) => p,
        }
    }

    /// Returns the end point of the line, given the voxel of the lumen found for the end.
    fn within(self, walls: &WallDistance, voxel: [i64; 3]) -> DVec3 {
        match self {
            Self::At(p) if walls.voxel(p) == voxel => p,
            _ => walls.world(voxel),
        }
    }
}

fn no_way(from: End, to: End) -> Error {
    let (a, b) = (from.place(), to.place());
    let places = format!("{:.1},{:.1},{:.1} to {:.1},{:.1},{:.1}", a.x, a.y, a.z, b.x, b.y, b.z);
    let why = format!("no path leads from {places} within the lumen");
    Error::incomplete("centerline", why, "choose two points of one connected piece of the lumen")
}

fn finished(walls: &WallDistance, line: &[DVec3]) -> Centerline {
    let radius = |p: &DVec3| crate::fields::Distance::sample(walls, *p).map_or(0.0, |s| s.mm.max(0.0));
    Centerline {
        radius_mm: line.iter().map(radius).collect(),
        length_mm: length(line),
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

/// Shortens a line from the lumen's tip to the centre of the last ball that touches the tip.
///
/// On the way in, the clearance grows as fast as the distance from the tip, until the ball also meets the side walls.
/// The line ends where the clearance minus a fraction of the distance from the tip is largest. That point does not
/// drift onward through a lumen that merely widens.
fn last_ball(walls: &WallDistance, line: &mut Vec<DVec3>) {
    let (mut back, mut best) = (0.0, (f64::NEG_INFINITY, line.len()));
    for n in (0..line.len()).rev() {
        if n + 1 < line.len() {
            back += line[n].distance(line[n + 1]);
        }
        // Keep at least half of the line.
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

/// Appends a line to another, with a guess between them. The guess begins and ends where the lines do.
fn joined(line: Option<Centerline>, guess: &[DVec3], rest: Centerline) -> Centerline {
    let Some(mut line) = line else { return rest };
    let (Some(&a), Some(&b)) = (line.points.last(), rest.points.first()) else { return rest };
    let inner = guess.get(1..guess.len().saturating_sub(1)).unwrap_or_default();
    let way: Vec<DVec3> = std::iter::once(a).chain(inner.iter().copied()).chain([b]).collect();
    let gap = length(&way);
    let between = spaced(&way, STEP_MM);
    let between = &between[1..between.len() - 1];
    line.points.extend(between);
    line.radius_mm.resize(line.points.len(), 0.0);
    let begins = line.length_mm;
    line.guessed.push([begins, begins + gap]);
    line.guessed.extend(rest.guessed.iter().map(|g| g.map(|s| s + begins + gap)));
    line.length_mm += gap + rest.length_mm;
    line.points.extend(rest.points);
    line.radius_mm.extend(rest.radius_mm);
    line
}
