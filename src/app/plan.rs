//! Plans a flight: derives start and goal from a lumen and the requested points.

use std::sync::Arc;

use glam::{DVec3, IVec3};

use crate::components::play::Playback;
use crate::dynamics::Attitude;
use crate::dynamics::tentacles::directions;
use crate::error::{Error, Result};
use crate::fields::ClearanceFinder;
use crate::fields::connection::ColonPlace;
use crate::fields::lumen::{self, Lumen, Segment};
use crate::math::lattice::nearest_first;
use crate::progress::Progress;
use crate::space::{PreparedVolume, first_crossing};
use crate::volume::{Volume, hounsfield};

/// Largest distance by which a point outside the lumen is moved into it, mm.
const SNAP_MM: f64 = 5.0;
/// Distance from the goal at which the camera has arrived, with `--to`, mm.
const ARRIVED_MM: f64 = 3.0;
/// Number of rays that measure the surroundings of an end.
const PROBES: usize = 512;

/// A requested place in the colon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// The rectal end.
    Rectum,
    /// The cecal end.
    Cecum,
    /// A point, world mm.
    World(DVec3),
}

impl From<Place> for ColonPlace {
    fn from(place: Place) -> Self {
        match place {
            Place::Rectum => Self::Rectum,
            Place::Cecum => Self::Cecum,
            Place::World(p) => Self::At(p),
        }
    }
}

/// The requested ends of a flight.
///
/// ```
/// # use colvis_app as colvis;
/// use colvis::app::{Place, Scan, Scene, FlightRequest};
///
/// let wish = FlightRequest { from: Some(Place::Cecum), ..FlightRequest::default() }; // and on to the other end
/// let flight = Scan::phantom(1)?.flight(Scene::default(), &wish)?;
/// assert!(flight.setup().is_reversed() && flight.setup().plan.length_mm > 300.0);
/// # Ok::<(), colvis::error::Error>(())
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct FlightRequest {
    /// Start.
    pub from: Option<Place>,
    /// Goal.
    pub to: Option<Place>,
    /// Swaps the ends.
    pub reverse: bool,
}

impl FlightRequest {
    /// Returns the places of the colon between which the request leads, whether or not gas joins them. An end that is not requested
    /// is that of the colon.
    pub fn places(&self) -> [Place; 2] {
        match (self.from, self.to) {
            (Some(from), Some(to)) => [from, to],
            (Some(Place::Cecum), None) => [Place::Cecum, Place::Rectum],
            (Some(from), None) => [from, if self.reverse { Place::Rectum } else { Place::Cecum }],
            (None, Some(Place::Rectum)) => [Place::Cecum, Place::Rectum],
            (None, Some(to)) => [Place::Rectum, to],
            (None, None) if self.reverse => [Place::Cecum, Place::Rectum],
            (None, None) => [Place::Rectum, Place::Cecum],
        }
    }
}

/// An end that a flight can go to.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct PlanEnd {
    /// Position, world mm.
    pub at: DVec3,
    /// Distance from it at which the flight has arrived, mm.
    pub within_mm: f64,
    /// Message on arrival, if the requested end lies beyond the gas that the flight can reach.
    pub missed: Option<String>,
}

impl PlanEnd {
    /// Creates an end that was requested as such.
    pub fn new(at: DVec3, within_mm: f64) -> Self {
        Self { at, within_mm, missed: None }
    }
}

/// A planned flight.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Where it starts, world mm.
    pub start: DVec3,
    /// Where the planned path begins, world mm: the requested start, or the lumen's other end.
    pub begin: DVec3,
    /// The lumen's other end, and the goal. A reversed flight swaps them.
    pub ends: [PlanEnd; 2],
    /// Coarse length of the segment, mm, to display the progress of the flight.
    pub length_mm: f64,
    /// Number of the segment, if it is one of the lumen's.
    pub segment: Option<usize>,
    /// The gas of the flight, if it is not a segment of the colon.
    pub gas: Option<Arc<Lumen>>,
    /// What was asked for.
    pub asked: FlightRequest,
    /// Notes to the user.
    pub notes: Vec<String>,
}

impl Plan {
    /// Creates a plan for gas that is not a segment of a colon, from `start` to `goal` (world mm), of a coarse length (mm).
    pub fn between(start: DVec3, goal: DVec3, length_mm: f64) -> Self {
        let ends = [start, goal].map(|at| PlanEnd::new(at, ARRIVED_MM));
        let (asked, notes) = (FlightRequest::default(), Vec::new());
        Self { start, begin: start, ends, length_mm, segment: None, gas: None, asked, notes }
    }

    /// Returns where the flight goes.
    pub fn goal(&self) -> &PlanEnd {
        &self.ends[1]
    }

    /// Returns the end of the lumen opposite the goal.
    pub fn other_end(&self) -> &PlanEnd {
        &self.ends[0]
    }

    /// Turns the flight round.
    pub fn reverse(&mut self) {
        self.begin = self.goal().at;
        self.ends.swap(0, 1);
    }
}

/// Plans the requested flight. Without points it goes through the largest segment.
///
/// # Errors
/// Returns status 4 if there is no colon to fly, a point is outside the lumen, or the lumen is too narrow for the body.
pub fn plan(
    volume: &PreparedVolume,
    lumen: &Lumen,
    request: &FlightRequest,
    radius_mm: f64,
    progress: &Progress,
) -> Result<Plan> {
    let mut notes = Vec::new();
    if let Some(Place::World(from)) = request.from {
        let found = lumen.nearest_gas(from, SNAP_MM).map(|(s, p)| (Some(s), lumen.segments[s].clone(), p));
        let mut own = None;
        let found = match found {
            Some(f) => f,
            // Gas of any size outside the segmented colon: the operator requested this point.
            None => {
                let gas = lumen::gas_at(volume.voxels(), from, progress)?.ok_or_else(|| outside("--from", from))?;
                let (s, p) = gas.nearest_gas(from, SNAP_MM).ok_or_else(|| outside("--from", from))?;
                let segment = gas.segments[s].clone();
                own = Some(Arc::new(gas));
                (None, segment, p)
            }
        };
        let (number, segment, gas) = found;
        // Take the voxel's centre only if the point itself is not in gas.
        let inside = f64::from(crate::space::value(volume, from)) < volume.transfer().iso();
        let at = if inside { from } else { gas };
        if !inside {
            notes.push(format!("--from {} lies outside the lumen; moved to {}", triple(from), triple(gas)));
        }
        let gas = FlownGas { number, segment: &segment, lumen, own: own.as_deref() };
        let plan = finish(volume, gas, Some(at), request, radius_mm, notes)?;
        return Ok(Plan { gas: own, ..plan });
    }
    if !lumen.is_flyable() {
        return Err(no_colon(volume.voxels(), lumen));
    }
    let last = lumen.segments.len() - 1;
    let main = lumen.main_segment().unwrap_or(0);
    let named = |place| match place {
        Place::Rectum if lumen.ordered => 0,
        Place::Cecum if lumen.ordered => last,
        _ => main,
    };
    let number = match (request.from, request.to) {
        (Some(p), _) => named(p),
        (None, Some(Place::World(to))) => lumen.nearest_gas(to, SNAP_MM).ok_or_else(|| outside("--to", to))?.0,
        (None, Some(p)) => named(p),
        (None, None) => main,
    };
    let gas = FlownGas { number: Some(number), segment: &lumen.segments[number], lumen, own: None };
    finish(volume, gas, None, request, radius_mm, notes)
}

/// An end of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SegmentEnd {
    /// The end nearer to the rectum.
    Rectal,
    /// The end nearer to the cecum.
    Cecal,
}

/// Plans the flight through one segment to one of its ends.
///
/// # Errors
/// Returns status 4 if the segment is too narrow for the body.
pub fn through_segment(
    volume: &PreparedVolume,
    lumen: &Lumen,
    number: usize,
    to: SegmentEnd,
    radius_mm: f64,
) -> Result<Plan> {
    let segment = lumen.segments.get(number).ok_or_else(|| {
        Error::incomplete("segment", format!("there is no segment {number}"), "choose another segment")
    })?;
    let request = FlightRequest { reverse: to == SegmentEnd::Rectal, ..FlightRequest::default() };
    let gas = FlownGas { number: Some(number), segment, lumen, own: None };
    finish(volume, gas, None, &request, radius_mm, Vec::new())
}

/// The gas that a flight goes through.
#[derive(Clone, Copy)]
struct FlownGas<'a> {
    /// `None` if it is not a segment of the colon.
    number: Option<usize>,
    segment: &'a Segment,
    lumen: &'a Lumen,
    /// The gas of the flight, if it is not a segment of the colon.
    own: Option<&'a Lumen>,
}

fn finish(
    volume: &PreparedVolume,
    FlownGas { number, segment, lumen, own }: FlownGas,
    from: Option<DVec3>,
    request: &FlightRequest,
    radius_mm: f64,
    mut notes: Vec<String>,
) -> Result<Plan> {
    let walls = ClearanceFinder::new(volume.shared_voxels(), volume.transfer().iso() as f32, SNAP_MM + radius_mm + 1.0);
    let (mut first, mut last) = ends_of(segment, request);
    // Gas that is not colon has no direction of its own: the flight goes to the end that is farther from its start.
    let is_free = own.is_some() && request.to.is_none() && !request.reverse;
    if is_free && from.is_some_and(|f| f.distance(last) < f.distance(first)) {
        (first, last) = (last, first);
    }
    let mut missed = None;
    let (goal, within_mm) = match request.to {
        Some(Place::World(to)) => {
            let in_own = own.and_then(|gas| gas.nearest_gas(to, SNAP_MM)).map(|(_, p)| (None, p));
            let in_colon = lumen.nearest_gas(to, SNAP_MM).map(|(s, p)| (Some(s), p));
            let far = |f: &(Option<usize>, DVec3)| f.1.distance_squared(to);
            let nearest = in_own.into_iter().chain(in_colon).min_by(|a, b| far(a).total_cmp(&far(b)));
            let (s, p) = nearest.ok_or_else(|| outside("--to", to))?;
            if s == number {
                let inside = f64::from(crate::space::value(volume, to)) < volume.transfer().iso();
                if !inside {
                    notes.push(format!("--to {} lies outside the lumen; moved to {}", triple(to), triple(p)));
                }
                (if inside { to } else { p }, ARRIVED_MM)
            } else {
                missed = Some(format!("--to {} lies in another segment{}", triple(to), begins(lumen, s)));
                (last, end_reach(volume, last))
            }
        }
        _ => (last, end_reach(volume, last)),
    };
    let other = |end: &str, next| format!("the {end} lies in another segment{}", begins(lumen, Some(next)));
    match (request.to, number) {
        (Some(Place::Cecum), Some(n)) if lumen.ordered && n + 1 < lumen.segments.len() => {
            missed = Some(other("cecum", n + 1));
        }
        (Some(Place::Rectum), Some(n)) if lumen.ordered && n > 0 => missed = Some(other("rectum", n - 1)),
        _ => {}
    }
    let wanted = from.unwrap_or(first);
    let start = roomy(&walls, wanted, radius_mm).ok_or_else(|| {
        Error::incomplete(
            format!("start {}", triple(wanted)),
            format!("the lumen there is narrower than the camera ({radius_mm} mm)"),
            "choose another start with --from X,Y,Z",
        )
    })?;
    let goal = PlanEnd { at: goal, within_mm, missed };
    Ok(Plan {
        start,
        begin: if from.is_some() { start } else { first },
        ends: [PlanEnd::new(first, end_reach(volume, first)), goal],
        length_mm: segment.length_mm,
        segment: number,
        gas: None,
        asked: *request,
        notes,
    })
}

/// Returns the segment's end at which the flight starts (if no point is given) and the end at which it ends.
fn ends_of(segment: &Segment, request: &FlightRequest) -> (DVec3, DVec3) {
    let [rectal, cecal] = segment.ends;
    let end = |place| match place {
        Some(Place::Rectum) => Some(rectal),
        Some(Place::Cecum) => Some(cecal),
        _ => None,
    };
    let other = |end: DVec3| if end == rectal { cecal } else { rectal };
    let (first, last) = match (end(request.from), end(request.to), request.to) {
        (Some(first), Some(last), _) => (first, last),
        (Some(first), None, _) => (first, other(first)),
        (None, Some(last), _) => (other(last), last),
        // With only a goal given, the flight starts at the end that is further from it.
        (None, None, Some(Place::World(to))) if request.from.is_none() && to.distance(rectal) < to.distance(cecal) => {
            (cecal, rectal)
        }
        _ => (rectal, cecal),
    };
    if request.reverse { (last, first) } else { (first, last) }
}

/// Describes where another segment begins, for the operator to start from.
fn begins(lumen: &Lumen, number: Option<usize>) -> String {
    let segment = number.and_then(|n| lumen.segments.get(n));
    segment.map_or_else(String::new, |s| format!(", which reaches from {} to {}", triple(s.ends[0]), triple(s.ends[1])))
}

/// Returns the nearest point within [`SNAP_MM`] at which the body fits. Searches a lattice in order of distance.
fn roomy(walls: &ClearanceFinder, at: DVec3, radius: f64) -> Option<DVec3> {
    const STEP: f64 = 0.5;
    nearest_first(SNAP_MM, STEP, IVec3::ONE).into_iter().map(|o| at + o).find(|&p| walls.at(p).mm > radius + 0.1)
}

/// Returns the distance from the centre of the ball at a lumen's end at which a flight has arrived, mm: half the ball's radius
/// (the shortest of many rays). The end wall is then within one and a half radii.
fn end_reach(volume: &PreparedVolume, at: DVec3) -> f64 {
    let radius = directions(PROBES)
        .into_iter()
        .map(|d| first_crossing(volume, at, d, 60.0).unwrap_or(60.0))
        .fold(60.0, f64::min);
    (0.5 * radius).max(1.0)
}

/// Returns the initial attitude. Forward points to the goal if that is in view, otherwise along the longest free direction. Up
/// is the patient's front, so that fluid is at the bottom of the image for a patient on the back.
pub fn first_attitude(volume: &PreparedVolume, start: DVec3, goal: DVec3) -> Attitude {
    let to = goal - start;
    let seen = to.length() > 1.0 && first_crossing(volume, start, to.normalize(), to.length()).is_none();
    let forward = if seen {
        to
    } else {
        // The first of equals, so that the choice never depends on rounding further on.
        let mut best = (f64::NEG_INFINITY, DVec3::Z);
        for d in directions(PROBES) {
            let free = first_crossing(volume, start, d, 300.0).unwrap_or(300.0);
            if free > best.0 {
                best = (free, d);
            }
        }
        best.1
    };
    Attitude::new(forward, DVec3::NEG_Y)
}

/// Creates the error that no colon was found, with what was found instead. Values that are not HU come first: nothing else
/// can be derived from them.
pub fn no_colon(volume: &Volume, lumen: &Lumen) -> Error {
    if let Some(odd) = hounsfield::oddity(volume) {
        return Error::incomplete("no colon found to fly through", odd.to_string(), odd.hint());
    }
    let found = lumen.found().unwrap_or_else(|| "no gas inside the patient that looks like a colon's".to_owned());
    let is_chest = lumen.landmarks.as_ref().is_some_and(|l| l.is_chest());
    let hint = if is_chest { " (a scan of the chest?)" } else { " (an unprepared or collapsed colon?)" };
    Error::incomplete("no colon found to fly through", format!("{found}{hint}"), "start in any gas with --from X,Y,Z")
}

fn outside(option: &str, at: DVec3) -> Error {
    Error::incomplete(
        format!("{option} {}", triple(at)),
        format!("no lumen within {SNAP_MM} mm"),
        "give a point inside the gas, in mm LPS",
    )
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Rectum => f.write_str("the rectum"),
            Self::Cecum => f.write_str("the cecum"),
            Self::World(p) => f.write_str(&triple(*p)),
        }
    }
}

/// Formats a point as it is typed on the command line.
pub fn triple(p: DVec3) -> String {
    format!("{:.1},{:.1},{:.1}", p.x, p.y, p.z)
}

/// Creates the plan of a log, from its first to its last position.
pub fn as_logged(play: &Playback) -> Plan {
    let [start, goal] = play.ends();
    Plan::between(start, goal, play.length_mm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Room;

    const RECTAL: DVec3 = DVec3::new(10.0, 8.0, 10.0);
    const CECAL: DVec3 = DVec3::new(10.0, 70.0, 10.0);

    /// A segment of a colon in a room of 20 × 80 × 20 mm, shifted to the side by its number.
    fn segment(number: usize, ml: f64) -> Segment {
        let aside = DVec3::X * number as f64;
        let ends = [RECTAL + aside, CECAL + aside];
        Segment {
            ml,
            fluid_ml: 0.0,
            bounds_mm: ends,
            ends,
            joined_to: Vec::new(),
            length_mm: 300.0,
            way: Vec::new(),
            judged: None,
        }
    }

    /// Three segments, of which the middle one is the largest.
    fn three(ordered: bool) -> (PreparedVolume, Lumen) {
        let volume = Room::new([20, 80, 20]).scan();
        let mut lumen = Lumen::none(volume.voxels().grid());
        (lumen.segments, lumen.ordered) = (vec![segment(0, 30.0), segment(1, 50.0), segment(2, 40.0)], ordered);
        (volume, lumen)
    }

    fn request(from: Option<Place>, to: Option<Place>, reverse: bool) -> FlightRequest {
        FlightRequest { from, to, reverse }
    }

    #[test]
    fn a_request_leads_through_the_whole_colon_where_it_names_no_end() {
        use Place::{Cecum, Rectum, World};
        let there = World(DVec3::X);
        let places = |from, to, reverse| FlightRequest { from, to, reverse }.places();
        for (from, to, forwards, backwards) in [
            (None, None, [Rectum, Cecum], [Cecum, Rectum]),
            (Some(Rectum), None, [Rectum, Cecum], [Rectum, Rectum]),
            (Some(Cecum), None, [Cecum, Rectum], [Cecum, Rectum]),
            (None, Some(Rectum), [Cecum, Rectum], [Cecum, Rectum]),
            (None, Some(there), [Rectum, there], [Rectum, there]),
            (Some(there), None, [there, Cecum], [there, Rectum]),
            (Some(Cecum), Some(there), [Cecum, there], [Cecum, there]),
        ] {
            assert_eq!([places(from, to, false), places(from, to, true)], [forwards, backwards], "{from:?} to {to:?}");
        }
    }

    #[test]
    fn a_flight_begins_and_ends_where_it_is_asked_to() {
        use Place::{Cecum, Rectum, World};
        let s = segment(0, 30.0);
        let near = |y: f64| Some(World(DVec3::new(10.0, y, 10.0)));
        for (from, to, expected) in [
            (None, None, (RECTAL, CECAL)),
            (Some(Rectum), None, (RECTAL, CECAL)),
            (Some(Cecum), None, (CECAL, RECTAL)),
            (None, Some(Rectum), (CECAL, RECTAL)),
            (None, Some(Cecum), (RECTAL, CECAL)),
            (Some(Rectum), Some(Cecum), (RECTAL, CECAL)),
            (Some(Cecum), Some(Rectum), (CECAL, RECTAL)),
            (None, near(12.0), (CECAL, RECTAL)),
            (None, near(60.0), (RECTAL, CECAL)),
            (Some(Cecum), near(60.0), (CECAL, RECTAL)),
            (near(12.0), near(12.0), (RECTAL, CECAL)),
            (near(12.0), Some(Rectum), (CECAL, RECTAL)),
        ] {
            assert_eq!(ends_of(&s, &request(from, to, false)), expected, "{from:?} {to:?}");
            assert_eq!(ends_of(&s, &request(from, to, true)), (expected.1, expected.0), "back: {from:?} {to:?}");
        }
    }

    #[test]
    fn a_named_end_chooses_its_segment_and_says_what_it_cannot_reach() {
        use Place::{Cecum, Rectum};
        let (volume, lumen) = three(true);
        let plan = |lumen: &Lumen, from, to| {
            let plan = plan(&volume, lumen, &request(from, to, false), 1.5, &Progress::new()).unwrap();
            (plan.segment.unwrap(), plan.goal().missed.clone())
        };
        assert_eq!(plan(&lumen, None, None), (1, None), "the largest");
        assert_eq!(plan(&lumen, Some(Rectum), None), (0, None));
        assert_eq!(plan(&lumen, Some(Cecum), None), (2, None));
        assert_eq!(plan(&lumen, None, Some(Rectum)), (0, None));
        assert_eq!(plan(&lumen, None, Some(Cecum)), (2, None));
        let (segment, missed) = plan(&lumen, Some(Rectum), Some(Cecum));
        let next = "the cecum lies in another segment, which reaches from 11.0,8.0,10.0 to 11.0,70.0,10.0";
        assert_eq!((segment, missed.as_deref()), (0, Some(next)));
        let (segment, missed) = plan(&lumen, Some(Cecum), Some(Rectum));
        let next = "the rectum lies in another segment, which reaches from 11.0,8.0,10.0 to 11.0,70.0,10.0";
        assert_eq!((segment, missed.as_deref()), (2, Some(next)));
        // Without an order, it is unknown which segment the ends are in.
        let (_, lumen) = three(false);
        for (from, to) in [(Some(Rectum), Some(Cecum)), (Some(Cecum), Some(Rectum)), (None, Some(Cecum))] {
            assert_eq!(plan(&lumen, from, to), (1, None), "{from:?} {to:?}");
        }
    }

    #[test]
    fn a_segment_is_flown_to_either_end() {
        let (volume, lumen) = three(true);
        let through = |number, to| through_segment(&volume, &lumen, number, to, 1.5);
        let plan = through(2, SegmentEnd::Cecal).unwrap();
        let aside = DVec3::X * 2.0;
        assert_eq!((plan.segment, plan.length_mm, plan.begin), (Some(2), 300.0, RECTAL + aside));
        assert_eq!((plan.other_end().at, plan.goal().at), (RECTAL + aside, CECAL + aside));
        // Half the distance to the nearest wall.
        assert!((plan.goal().within_mm - 0.5 * 8.0).abs() < 0.3, "{}", plan.goal().within_mm);
        let back = through(2, SegmentEnd::Rectal).unwrap();
        assert_eq!((back.other_end().at, back.goal().at), (CECAL + aside, RECTAL + aside));
        assert_eq!(through(3, SegmentEnd::Cecal).unwrap_err().kind, crate::error::Kind::Incomplete);
        let narrow = through_segment(&volume, &lumen, 0, SegmentEnd::Cecal, 12.0).unwrap_err();
        assert!(narrow.why.contains("narrower than the camera (12 mm)"), "{narrow}");
        let mut turned = plan;
        turned.reverse();
        assert_eq!(
            (turned.begin, turned.goal().at, turned.other_end().at),
            (CECAL + aside, RECTAL + aside, CECAL + aside)
        );
    }
}
