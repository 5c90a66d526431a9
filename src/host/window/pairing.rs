//! What two positions of one patient have in common: which place of one is which of the other, and what is therefore expected there.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::assistant::{Assistant, Found};
use super::background::{Background, BackgroundTask};
use super::job::Job;
use crate::app::FlightApp;
use crate::app::findings::Findings;
use crate::components::camera::Pose;
use crate::dynamics::Attitude;
use crate::error::{Error, Result};
use crate::fields::matching::{Match, Matching, Posed, Side};
use crate::fields::{Along, Lumen};
use crate::polyps::answers::Answer;

/// Distance between the points of a stretch, mm.
const STRETCH_MM: f64 = 3.0;
/// A lesion of one position is that of the other if it is within this of the stretch where it is expected, mm: about the error across the
/// line, which the stretch does not tell, and the size of a lesion.
const SAME_MM: f64 = 12.0;
/// Poses within this of each other are the same, mm.
const STILL_MM: f64 = 0.01;
/// A camera that follows another one lags behind by this, s, unless it has farther to go than the other, mm.
const LAG_S: f64 = 0.12;
const JUMP_MM: f64 = 30.0;

/// A position for its pair.
#[derive(Clone, Copy)]
pub(crate) struct Position<'a> {
    pub flight: &'a FlightApp,
    pub found: &'a Findings,
    pub assistant: Option<&'a Assistant>,
    /// False while nothing else may hold its volume.
    pub is_settled: bool,
}

/// Something that a position has.
#[derive(Clone, Debug, PartialEq)]
struct Known {
    name: String,
    /// World, mm.
    place: DVec3,
}

/// Something of one position where it is expected in the other.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Expected {
    /// What it is called where it was found.
    pub name: String,
    /// The stretch of the wall where it is with a probability of 90 %, world mm, from the rectum.
    pub stretch: Vec<DVec3>,
    /// The middle of it on the wall, world mm.
    pub place: DVec3,
    /// Half its length along the colon, mm.
    pub uncertainty_mm: f64,
    /// True if either position is collapsed there.
    pub is_gap: bool,
}

impl Expected {
    /// Returns the distance of a place (world, mm) from the stretch, mm.
    fn away(&self, place: DVec3) -> f64 {
        self.stretch.iter().map(|p| p.distance(place)).fold(f64::INFINITY, f64::min)
    }
}

/// A candidate that the other position has, too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Twice {
    /// Its number there, from 0.
    pub other: usize,
    /// The score with that of the other position.
    pub score: f64,
    /// The score of the other.
    pub other_score: f64,
}

/// The two colons, and which places of them belong together.
struct Matched {
    matching: Matching,
    along: [Arc<Along>; 2],
    lumens: [Arc<Lumen>; 2],
}

impl Matched {
    fn place(&self, from: Side, place: DVec3) -> Option<Match> {
        self.matching.place(from, place, self.along[from as usize].of(place)?.mm)
    }

    fn expected(&self, from: Side, known: &Known) -> Option<Expected> {
        let (found, lumen) = (self.place(from, known.place)?, &self.lumens[from.other() as usize]);
        Some(Expected {
            name: known.name.clone(),
            stretch: self.matching.stretch(from.other(), &found, lumen, STRETCH_MM),
            place: found.on_wall(lumen),
            uncertainty_mm: found.uncertainty_mm,
            is_gap: found.is_gap,
        })
    }
}

/// The pair of a patient's positions in a window.
pub(crate) struct Pairing {
    task: BackgroundTask<Matched>,
    /// The lumens that are compared.
    lumens: Option<[Arc<Lumen>; 2]>,
    matched: Option<Matched>,
    /// True while both positions are flown together.
    pub(crate) is_linked: bool,
    /// What each position has, and where that is expected in the other.
    known: [Vec<Known>; 2],
    expected: [Vec<Expected>; 2],
    /// The lists of candidates that were compared, and what they share.
    lists: [Option<Arc<Found>>; 2],
    twice: [Vec<Option<Twice>>; 2],
    /// Where the cameras stood when one had gone to the place of the other.
    stood: Option<[Pose; 2]>,
    /// What was pointed at then, world mm.
    pointed: [Option<DVec3>; 2],
    /// The pose of the camera that follows, before it was made to fit, and when.
    steady: Option<(Pose, Instant)>,
}

impl Pairing {
    /// Creates the pair of two positions that are not compared yet.
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            task: BackgroundTask::new(now),
            lumens: None,
            matched: None,
            is_linked: false,
            known: Default::default(),
            expected: Default::default(),
            lists: Default::default(),
            twice: Default::default(),
            stood: None,
            pointed: [None; 2],
            steady: None,
        }
    }

    /// Compares the positions, in the order of sides, once both are ready and again if one of their lumens changes. Returns true if there is
    /// something new to show.
    pub(crate) fn advance(&mut self, scans: [Position<'_>; 2], background: &Background, now: Instant) -> bool {
        if !scans.iter().all(|c| c.is_settled) {
            return false;
        }
        let lumens = scans.map(|c| Arc::clone(&c.flight.setup().lumen));
        let is_same = |of: &[Arc<Lumen>; 2]| of.iter().zip(&lumens).all(|(a, b)| Arc::ptr_eq(a, b));
        if !self.lumens.as_ref().is_some_and(is_same) {
            self.task.go_over(begin(scans, background), now);
            (self.lumens, self.matched) = (Some(lumens), None);
            return true;
        }
        let mut is_new = false;
        if let Some(done) = self.task.take(now) {
            self.matched = done.ok().map(|done| done.0);
            // All is expected anew.
            (self.known, self.lists, is_new) = (Default::default(), Default::default(), true);
        }
        is_new | self.compare(scans)
    }

    /// Looks where what each position has is expected in the other. Returns true if that has changed.
    fn compare(&mut self, scans: [Position<'_>; 2]) -> bool {
        let Some(matched) = &self.matched else { return false };
        let lists = scans.map(|c| c.assistant.and_then(|a| a.found()).cloned());
        let is_same = |(a, b): (&Option<Arc<Found>>, &Option<Arc<Found>>)| match (a, b) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        let mut is_new = false;
        if !lists.iter().zip(&self.lists).all(is_same) {
            self.twice = match &lists {
                [Some(a), Some(b)] => twice(matched, [a, b]),
                _ => Default::default(),
            };
            (self.lists, is_new) = (lists, true);
        }
        for from in [Side::A, Side::B] {
            let known = known(&scans[from as usize], &self.twice[from as usize]);
            if known != self.known[from as usize] {
                let expected = known.iter().filter_map(|k| matched.expected(from, k)).collect();
                (self.expected[from.other() as usize], self.known[from as usize], is_new) = (expected, known, true);
            }
        }
        is_new
    }

    /// Returns why nothing is known of the pair, in words; `None` if it is.
    pub(crate) fn why_not(&self) -> Option<String> {
        match (&self.matched, self.task.failed()) {
            (Some(_), _) => None,
            (None, Some(why)) => Some(format!("the positions cannot be compared: {why}")),
            (None, None) => Some("the positions are being compared".to_owned()),
        }
    }

    /// Returns when the comparison has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.task.next()
    }

    /// Returns what of the other position is expected in one.
    pub(crate) fn expected(&self, side: Side) -> &[Expected] {
        &self.expected[side as usize]
    }

    /// Returns for each candidate of a position what it is in the other.
    pub(crate) fn twice(&self, side: Side) -> &[Option<Twice>] {
        &self.twice[side as usize]
    }

    /// Returns what of the other position belongs to a place of one (world, mm).
    pub(crate) fn place(&self, from: Side, place: DVec3) -> Option<Match> {
        self.matched.as_ref()?.place(from, place)
    }

    /// Returns where a place of one position (world, mm) is expected in the other.
    pub(crate) fn expect(&self, from: Side, place: DVec3) -> Option<Expected> {
        self.matched.as_ref()?.expected(from, &Known { name: String::new(), place })
    }

    /// Returns the pose of one position's camera in the other, and what belongs to it there.
    pub(crate) fn pose(&self, from: Side, pose: &Pose) -> Option<(Pose, Match)> {
        let matched = self.matched.as_ref()?;
        let along_mm = matched.along[from as usize].of(pose.position)?.mm;
        let camera = Posed { position: pose.position, forward: pose.attitude.forward, up: pose.attitude.up };
        let (there, found) = matched.matching.camera(from, camera, along_mm)?;
        let attitude = Attitude::new(there.forward, there.up);
        Some((Pose { position: there.position, attitude }, found))
    }

    /// True if both cameras stand where they did when one had gone to the place of the other.
    pub(crate) fn stands(&self, poses: [Pose; 2]) -> bool {
        self.stood.as_ref().is_some_and(|stood| stood.iter().zip(&poses).all(|(a, b)| is_near(a, b)))
    }

    /// True if the places that are pointed at are those when one camera had gone to the place of the other.
    pub(crate) fn points(&self, cursors: [Option<DVec3>; 2]) -> bool {
        self.pointed == cursors
    }

    /// Notes what was pointed at when one camera had gone to the place of the other.
    pub(crate) fn point(&mut self, cursors: [Option<DVec3>; 2]) {
        self.pointed = cursors;
    }

    /// Notes that one camera has gone to the place of the other.
    pub(crate) fn stand(&mut self, poses: [Pose; 2]) {
        self.stood = Some(poses);
    }

    /// Returns the pose of a camera that follows another one to `there`: it lags by a fraction of a second, so that what changes from row to
    /// row does not shake it, and jumps over long ways. `before` is where it stands.
    pub(crate) fn steadied(&mut self, there: Pose, before: &Pose, now: Instant) -> Pose {
        let near = |a: &Pose, b: &Pose| a.position.distance(b.position) < JUMP_MM;
        let last = self.steady.filter(|(last, _)| near(last, before) && near(last, &there));
        let steady = last.map_or(there, |(last, at)| {
            let share = 1.0 - (-now.saturating_duration_since(at).as_secs_f64() / LAG_S).exp();
            let mix = |a: DVec3, b: DVec3| a.lerp(b, share).try_normalize().unwrap_or(b);
            let forward = mix(last.attitude.forward, there.attitude.forward);
            let attitude = Attitude::new(forward, mix(last.attitude.up, there.attitude.up));
            Pose { position: last.position.lerp(there.position, share), attitude }
        });
        self.steady = Some((steady, now));
        steady
    }

    /// Notes that a camera that follows has come to where it belongs. `steady` is its pose before it was made to fit.
    pub(crate) fn stand_if_still(&mut self, poses: [Pose; 2], steady: &Pose, side: Side) {
        let there = self.pose(side, &poses[side as usize]).map(|p| p.0);
        if there.is_some_and(|there| is_near(&there, steady)) {
            self.stand(poses);
        }
    }

    /// Returns the finding of the other position, by its number there, that a place of one (world, mm) is: the nearest of those that are
    /// expected here and belong to no finding yet.
    pub(crate) fn same_finding(&self, side: Side, place: DVec3, others: &Findings) -> Option<usize> {
        let matched = self.matched.as_ref()?;
        let near = others.findings.iter().enumerate().filter(|(_, f)| f.other.is_none()).filter_map(|(n, f)| {
            let known = Known { name: String::new(), place: f.place };
            Some((n, matched.expected(side.other(), &known)?.away(place)))
        });
        near.filter(|n| n.1 <= SAME_MM).min_by(|a, b| a.1.total_cmp(&b.1)).map(|n| n.0)
    }
}

/// True if two poses are the same, up to what nobody sees.
fn is_near(a: &Pose, b: &Pose) -> bool {
    a.position.distance(b.position) < STILL_MM && a.attitude.forward.distance(b.attitude.forward) < 1e-3
}

/// Returns what a position has that is not known to be in the other one: findings, and marked candidates that are not refused.
fn known(scan: &Position<'_>, twice: &[Option<Twice>]) -> Vec<Known> {
    let findings = scan.found.findings.iter().filter(|f| f.other.is_none());
    let findings = findings.map(|f| Known { name: format!("finding {}", f.id), place: f.place });
    let assistant = scan.assistant.filter(|a| a.is_marking);
    let candidates =
        assistant.and_then(|a| Some((a.found()?, a.reading()))).into_iter().flat_map(|(found, reading)| {
            let refused = move |n: usize| reading.said(n).is_some_and(|s| s.answer == Some(Answer::No));
            let list = found.list.iter().enumerate();
            list.filter(move |(n, _)| !refused(*n) && twice.get(*n).copied().flatten().is_none())
                .map(|(n, e)| Known { name: format!("candidate {}", n + 1), place: e.candidate.position })
        });
    findings.chain(candidates).collect()
}

/// Returns for each candidate of both lists what it is in the other: two are one if each is the nearest to the other, within
/// [`SAME_MM`] of the stretch where the first is expected.
fn twice(matched: &Matched, lists: [&Arc<Found>; 2]) -> [Vec<Option<Twice>>; 2] {
    let [a, b] = lists.map(|found| found.list.iter().map(|e| e.candidate.clone()).collect::<Vec<_>>());
    let expected: Vec<_> = a
        .iter()
        .map(|c| matched.expected(Side::A, &Known { name: String::new(), place: c.position }).filter(|e| !e.is_gap))
        .collect();
    let away = |i: usize, j: usize| {
        let mm = expected[i].as_ref().map_or(f64::INFINITY, |e| e.away(b[j].position));
        Some(mm).filter(|mm| *mm <= SAME_MM)
    };
    let nearest = |list: &mut dyn Iterator<Item = (usize, f64)>| list.min_by(|a, b| a.1.total_cmp(&b.1)).map(|n| n.0);
    let mut made = [vec![None; a.len()], vec![None; b.len()]];
    for i in 0..a.len() {
        let Some(j) = nearest(&mut (0..b.len()).filter_map(|j| Some((j, away(i, j)?)))) else { continue };
        if nearest(&mut (0..a.len()).filter_map(|i| Some((i, away(i, j)?)))) != Some(i) {
            continue;
        }
        let score = together(a[i].score, b[j].score);
        made[0][i] = Some(Twice { other: j, score, other_score: b[j].score });
        made[1][j] = Some(Twice { other: i, score, other_score: a[i].score });
    }
    made
}

/// Returns the score of a candidate that was found twice. Scores from 0 to 1 count as probabilities of two looks at one place; of any other
/// scale, the larger one counts.
fn together(a: f64, b: f64) -> f64 {
    let is_share = |s: f64| (0.0..=1.0).contains(&s);
    if is_share(a) && is_share(b) { 1.0 - (1.0 - a) * (1.0 - b) } else { a.max(b) }
}

/// Begins to compare two positions.
///
/// # Errors
/// Returns status 1 if the system cannot start threads.
fn begin(scans: [Position<'_>; 2], background: &Background) -> Result<Job<Matched>> {
    let input = scans.map(|c| (c.flight.setup().volume.clone(), Arc::clone(&c.flight.setup().lumen)));
    background.start_apart("positions", move |progress| {
        let [a, b] = &input;
        let along = [a.1.along(a.0.voxels(), progress)?, b.1.along(b.0.voxels(), progress)?];
        let none = || {
            let why = "no one line leads from the rectum to the cecum of each";
            Error::incomplete("two positions", why, "read them one by one")
        };
        let matching = Matching::new((&a.1, &along[0]), (&b.1, &along[1]), progress)?.ok_or_else(none)?;
        Ok(Matched { matching, along, lumens: [Arc::clone(&a.1), Arc::clone(&b.1)] })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_look_raises_a_score_and_never_lowers_it() {
        assert!((together(0.5, 0.5) - 0.75).abs() < 1e-12);
        for (a, b) in [(0.0, 0.3), (1.0, 0.2), (4.0, 0.2), (-1.0, 2.0)] {
            assert!(together(a, b) >= a.max(b) && together(a, b) == together(b, a));
        }
    }
}
