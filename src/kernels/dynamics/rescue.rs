//! Recovery from traps: the flight tries another direction, then flies back, then calls the operator.
//!
//! - If the lumen is open ahead (a local minimum, a bridge, a polyp, dithering, circling), the guide sets off again along
//!   the longest tentacle ahead. For a few seconds the wall repels it less, it keeps its heading, and its whole trail is
//!   forbidden ground, not only the last few mines. The same holds in front of a neck that was noted with another heading, if
//!   the tentacles now reach past what is in front: the neck may be wide enough for a bold flight.
//! - If the lumen is closed (a blind end, a neck too narrow), or if the first measure does not help, the mines are
//!   cleared and the guide flies back along its trail until a side branch opens that it has not flown. New mines keep it
//!   from returning. A dead end near the lumen's other end only means that the flight set out in the wrong direction.
//! - Back at the start, or after too many attempts, the operator is called and given the place and the kind of the trap.

use std::collections::VecDeque;

use glam::DVec3;

use super::monitor::{Monitor, MonitorSettings, StallKind};
use super::tentacles::TentacleSettings;
use super::trap::{TentacleReading, Trap, recognise};

/// A dead end within this distance of the lumen's other end means that the flight set out in the wrong direction, mm.
const WRONG_END_MM: f64 = 40.0;
/// How far back along the trail to check for that, mm: the camera may have left the dead end before it was certain.
const WRONG_END_BACK_MM: f64 = 120.0;
/// How long the guide looks for another direction, s, and how often in one flight.
const ASIDE_S: f64 = 4.0;
const ESCAPES: u32 = 6;
/// While it looks for a path past an obstacle: share of the wall's push, and least agreement with the heading.
const BOLD_PUSH: f64 = 0.1;
const BOLD_AGREEMENT: f64 = 8.0;
/// On the flight back, ground this far from the trail is new, in units of [`MonitorSettings::visited_mm`]. Flying this
/// distance over it ends the return flight, mm.
const NEW_GROUND: f64 = 1.5;
const NEW_GROUND_MM: f64 = 20.0;
/// Weight of a direction over the trail on the way back: a side branch wins, and without one the trail does.
const TRAIL_COUNTS: f64 = 0.1;
/// The return flight has failed within this distance of the trail's first point, mm.
const START_MM: f64 = 8.0;
/// A path of this length within a box of little more than half of it counts as wandering in one place, mm.
const WANDERED_MM: f64 = 80.0;
/// Notes within this distance count as nearby, mm.
const NEARBY_MM: f64 = 15.0;
/// Number of notes kept, and the distance between them, mm.
const NOTES: usize = 64;
const NOTE_MM: f64 = 2.0;

/// What the flight should do next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RescueAction {
    /// Nothing: all is well, or a recovery is under way.
    GoOn,
    /// Take this unit heading (or keep the current one if there is none), and clear the mines if `clear_mines` is set.
    SetOff {
        /// The new unit heading, world.
        heading: Option<DVec3>,
        /// True if the mines are cleared, so that they cannot hold the camera.
        clear_mines: bool,
    },
    /// Call the operator.
    Call {
        /// The trap.
        trap: Trap,
        /// Its position, world mm.
        place: DVec3,
    },
}

/// The heading of a camera that starts to fly back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Heading {
    /// It is flying back already.
    Keep,
    /// It has to turn round.
    Back,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Course {
    #[default]
    On,
    /// Looks for another direction ahead until this time, s.
    Aside(f64),
    /// Flies back along the trail before the point with this index. Holds the distance flown over new ground so far, and
    /// the distance flown at which it gives up, mm.
    Back { turn: usize, new_mm: f64, until_mm: f64 },
}

/// The state of recovery in one flight.
#[derive(Clone, Debug, Default)]
pub struct Rescue {
    monitor: Monitor,
    course: Course,
    /// The trap that it is recovering from, and its position (world mm).
    because: Option<(Trap, DVec3)>,
    /// The kinds of the last places visited.
    notes: VecDeque<(DVec3, Trap)>,
    last: Option<DVec3>,
    time: f64,
    turns: u32,
    escapes: u32,
}

impl Rescue {
    /// Returns the camera's trail.
    pub fn monitor(&self) -> &Monitor {
        &self.monitor
    }

    /// Returns how often the flight turned round because it had set out in the wrong direction.
    pub fn turns(&self) -> u32 {
        self.turns
    }

    /// Returns the number of places at which the guide looked for another direction. Operator input resets it.
    pub fn escapes(&self) -> u32 {
        self.escapes
    }

    /// Returns true while the guide looks for another direction.
    pub fn is_escaping(&self) -> bool {
        self.course != Course::On
    }

    /// Returns the trap that the flight is recovering from, and its position (world mm).
    pub fn trap(&self) -> Option<(Trap, DVec3)> {
        self.because
    }

    /// Returns forbidden ground (world mm), and the weight that a direction over it still has, 0 to 1.
    pub fn forbidden(&self) -> (&[DVec3], f64) {
        match self.course {
            Course::On => (&[], 0.0),
            Course::Aside(_) => (self.monitor.trail(), 0.0),
            Course::Back { turn, .. } => (&self.monitor.trail()[..turn], TRAIL_COUNTS),
        }
    }

    /// Starts over after operator input: the path flown so far may be flown again, and all counts are cleared.
    pub fn restart(&mut self) {
        *self = Self { turns: self.turns, ..Self::default() };
    }

    /// Returns the guide's settings to use now.
    ///
    /// While the guide looks for a path past an obstacle, it keeps its heading more and the wall repels it less. A gap
    /// wide enough for the body is then not too narrow for the guide.
    pub fn temper(&self, settings: &TentacleSettings) -> TentacleSettings {
        let mut s = *settings;
        // A circling flight is not blocked by a wall.
        let held_up = self.because.is_some_and(|(trap, _)| trap != Trap::Circling);
        if held_up && matches!(self.course, Course::Aside(_)) {
            s.wall_push *= BOLD_PUSH;
            s.agreement = s.agreement.max(BOLD_AGREEMENT);
        }
        s
    }

    /// Takes the camera's position (world mm) after a step of `dt` seconds and returns what to do.
    ///
    /// `reading` holds the tentacles at that position if the camera has any. `other_end` is the end of the lumen that the
    /// flight is not heading for, if known (world mm).
    pub fn follow(
        &mut self,
        at: DVec3,
        dt: f64,
        reading: Option<&TentacleReading>,
        other_end: Option<DVec3>,
        settings: &MonitorSettings,
    ) -> RescueAction {
        self.time += dt;
        let moved = self.last.replace(at).map_or(0.0, |l| l.distance(at));
        if let Some(reading) = reading
            && self.notes.back().is_none_or(|n| n.0.distance(at) >= NOTE_MM)
        {
            self.notes.push_back((at, reading.kind()));
            if self.notes.len() > NOTES {
                self.notes.pop_front();
            }
        }
        let alarm = self.monitor.follow(at, dt, settings);
        match self.course {
            Course::Aside(until) if self.time >= until => self.go_on(),
            Course::Back { .. } => {
                if let Some(order) = self.going_back(at, moved, settings) {
                    return order;
                }
                if alarm.is_some_and(|a| a.stall == StallKind::TurnedBack) {
                    // It is supposed to fly back.
                    self.monitor.forgive();
                    return RescueAction::GoOn;
                }
            }
            _ => {}
        }
        let Some(alarm) = alarm else { return RescueAction::GoOn };
        let kind = match alarm.stall {
            StallKind::Stuck => reading.map(TentacleReading::kind),
            StallKind::TurnedBack => self.noted(alarm.place),
            StallKind::Dithering | StallKind::Circling => {
                // In front of a neck it also flies off and comes back.
                let neck = reading.map(TentacleReading::kind).filter(|t| *t == Trap::Narrow);
                neck.or_else(|| self.closed_nearby(alarm.place).filter(|_| self.is_in_one_place()))
            }
        };
        let trap = recognise(alarm.stall, kind);
        let turned = alarm.stall == StallKind::TurnedBack;
        let heading = if turned { Heading::Keep } else { Heading::Back };
        if self.turns == 0 && self.was_at_wrong_end(other_end) {
            self.turns += 1;
            self.monitor.restart();
            self.go_on();
            // A camera detected while turning back already has the right heading.
            let heading = reading.filter(|_| !turned).map(|f| f.longest(|_| true).0);
            return RescueAction::SetOff { heading, clear_mines: true };
        }
        let (trap, place) = *self.because.get_or_insert((trap, alarm.place));
        // Another heading does not help a guide without tentacles.
        let Some(reading) = reading.filter(|_| self.escapes < ESCAPES) else {
            return RescueAction::Call { trap, place };
        };
        self.escapes += 1;
        self.monitor.forgive();
        let wanders = matches!(alarm.stall, StallKind::Dithering | StallKind::Circling);
        let reaches_past = wanders && matches!(reading.kind(), Trap::Bridge | Trap::Obstacle);
        let closed = matches!(trap, Trap::BlindEnd | Trap::Narrow | Trap::TurnedBack) && !reaches_past;
        match self.course {
            Course::On if !closed => {
                self.course = Course::Aside(self.time + ASIDE_S);
                RescueAction::SetOff {
                    heading: Some(reading.opening().0).filter(|d| *d != DVec3::ZERO),
                    clear_mines: false,
                }
            }
            Course::Back { .. } => RescueAction::Call { trap, place },
            Course::On | Course::Aside(_) => self.turn_back(at, alarm.place, reading, heading),
        }
    }

    /// Starts the return flight from a trap at `place`.
    fn turn_back(&mut self, at: DVec3, place: DVec3, reading: &TentacleReading, heading: Heading) -> RescueAction {
        let trail = self.monitor.trail();
        let nearest = (0..trail.len()).min_by(|&a, &b| {
            let d = |i: usize| trail[i].distance_squared(place);
            // On a tie, the later one.
            d(a).total_cmp(&d(b)).then(b.cmp(&a))
        });
        let turn = nearest.unwrap_or(0);
        let back = trail[..turn].iter().rev().find(|p| p.distance(at) > 8.0);
        let towards = back.and_then(|p| (*p - at).try_normalize()).unwrap_or_else(|| reading.longest(|_| true).0);
        let until_mm = self.monitor.way_mm() * 2.5 + 100.0;
        self.course = Course::Back { turn, new_mm: 0.0, until_mm };
        RescueAction::SetOff { heading: (heading == Heading::Back).then_some(towards), clear_mines: true }
    }

    /// Checks on the way back if new ground was found or the return flight failed.
    fn going_back(&mut self, at: DVec3, moved: f64, settings: &MonitorSettings) -> Option<RescueAction> {
        let Course::Back { turn, new_mm, until_mm } = &mut self.course else { return None };
        let trail = &self.monitor.trail()[..*turn];
        let near = |p: &DVec3| p.distance(at) < NEW_GROUND * settings.visited_mm;
        *new_mm = if trail.iter().any(near) { 0.0 } else { *new_mm + moved };
        // Everything within the dead end is near the trail; nothing beyond its tip is.
        if *new_mm > NEW_GROUND_MM {
            self.go_on();
            return Some(RescueAction::GoOn);
        }
        let at_start = trail.first().is_none_or(|s| s.distance(at) < START_MM);
        let over = at_start || self.monitor.way_mm() > *until_mm;
        let (trap, place) = self.because.filter(|_| over)?;
        Some(RescueAction::Call { trap, place })
    }

    fn go_on(&mut self) {
        self.course = Course::On;
        self.because = None;
        self.monitor.forgive();
    }

    fn was_at_wrong_end(&self, other_end: Option<DVec3>) -> bool {
        let was_at = |end: DVec3| self.monitor.last_mm(WRONG_END_BACK_MM).any(|p| p.distance(end) < WRONG_END_MM);
        self.monitor.way_mm() > WRONG_END_MM && other_end.is_some_and(was_at)
    }

    /// Returns true if it has been wandering in one place rather than around something larger.
    fn is_in_one_place(&self) -> bool {
        let bounds = |(l, h): (DVec3, DVec3), p: DVec3| (l.min(p), h.max(p));
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = self.monitor.last_mm(WANDERED_MM).fold(none, bounds);
        (high - low).length() < 0.6 * WANDERED_MM
    }

    /// Returns a neck or a blind end recorded near a place, regardless of the heading at the time.
    fn closed_nearby(&self, place: DVec3) -> Option<Trap> {
        let reading = |t: Trap| self.notes.iter().any(|n| n.1 == t && n.0.distance(place) < NEARBY_MM);
        [Trap::Narrow, Trap::BlindEnd].into_iter().find(|t| reading(*t))
    }

    /// Returns the kind of the recorded place nearest to `place`.
    fn noted(&self, place: DVec3) -> Option<Trap> {
        let d = |n: &&(DVec3, Trap)| n.0.distance_squared(place);
        self.notes.iter().min_by(|a, b| d(a).total_cmp(&d(b))).map(|n| n.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::tentacles;

    use crate::dynamics::STEP_S as DT;

    /// Flies `path` and returns all actions other than `GoOn`, with their times.
    fn orders(
        path: impl Fn(f64) -> DVec3,
        seconds: f64,
        reading: Option<&TentacleReading>,
        end: Option<DVec3>,
    ) -> Vec<(f64, RescueAction)> {
        let mut r = Rescue::default();
        (0..(seconds / DT) as usize)
            .map(|n| (n as f64 * DT, r.follow(path(n as f64 * DT), DT, reading, end, &MonitorSettings::default())))
            .filter(|o| o.1 != RescueAction::GoOn)
            .collect()
    }

    #[test]
    fn a_guide_that_feels_nothing_calls_at_once() {
        let all = orders(|t| DVec3::X * 30.0 * t.min(3.0), 6.0, None, None);
        let (t, RescueAction::Call { trap, place }) = all[0] else { panic!("{all:?}") };
        assert!(t < 5.0 && trap == Trap::Stuck && place.distance(DVec3::X * 90.0) < 6.0);
    }

    #[test]
    fn a_blind_end_is_left_the_way_it_was_entered_and_told_of_at_the_start() {
        let directions = [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z, DVec3::NEG_X];
        let lengths = [8.0, 10.0, 10.0, 10.0, 10.0, 90.0];
        let reading = TentacleReading { directions: &directions, lengths: &lengths, heading: DVec3::X, radius_mm: 1.5 };
        // In, a pause at the tip, out again.
        let path = |t: f64| DVec3::X * (if t < 6.0 { 30.0 * t.min(3.0) } else { (90.0 - 30.0 * (t - 6.0)).max(0.0) });
        let all = orders(path, 20.0, Some(&reading), None);
        assert!(
            matches!(all[0].1, RescueAction::SetOff { heading: Some(h), clear_mines: true } if h.x < -0.9),
            "{all:?}"
        );
        let RescueAction::Call { trap: Trap::BlindEnd, place } = all.iter().find(|o| o.0 > 8.0).unwrap().1 else {
            panic!("{all:?}")
        };
        assert!(place.distance(DVec3::X * 90.0) < 6.0);
    }

    /// In a local minimum it sets off along the longest tentacle ahead, bolder, and avoids known ground for a while.
    #[test]
    fn a_local_minimum_is_left_boldly() {
        let directions = [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::NEG_X];
        let reading = TentacleReading {
            directions: &directions,
            lengths: &[80.0, 10.0, 10.0, 90.0],
            heading: DVec3::X,
            radius_mm: 1.5,
        };
        let (mut r, s) = (Rescue::default(), TentacleSettings::default());
        let mut reported = None;
        for n in 0..(12.0 / DT) as usize {
            // It gets away about half a second after detection.
            let t = n as f64 * DT;
            let at = DVec3::X * 30.0 * if t < 5.2 { t.min(3.0) } else { t - 2.2 };
            let order = r.follow(at, DT, Some(&reading), None, &MonitorSettings::default());
            if order != RescueAction::GoOn {
                assert_eq!(order, RescueAction::SetOff { heading: Some(DVec3::X), clear_mines: false });
                assert!(reported.is_none(), "once");
                reported = Some(t);
                assert!(r.temper(&s).wall_push < 0.2 * s.wall_push && r.forbidden().0.len() > 40);
                assert_eq!(r.trap().map(|t| t.0), Some(Trap::LocalMinimum));
            }
        }
        assert!(reported.is_some_and(|t| t < 5.0), "{reported:?}");
        assert!(r.temper(&s) == s && r.forbidden().0.is_empty() && r.trap().is_none() && r.escapes() == 1);
    }

    /// A circling flight is turned back if a neck is in front of it; elsewhere it looks for another direction.
    #[test]
    fn circling_before_a_neck_is_no_circling() {
        let directions = tentacles::directions(1024);
        let round = |t: f64| DVec3::new(20.0 * (1.5 * t).cos(), 20.0 * (1.5 * t).sin(), 0.0);
        let tube = |p: DVec3| p.y.abs() < 10.0 && p.z.abs() < 10.0;
        let slit = |p: DVec3| tube(p) && (p.x < 4.0 || p.x > 6.0 || p.y.abs().max(p.z.abs()) < 1.2);
        let reported = |inside: &dyn Fn(DVec3) -> bool| {
            let reach = |d: &DVec3| (1..1500).map(|n| f64::from(n) * 0.1).find(|l| !inside(*d * *l)).unwrap_or(150.0);
            let lengths: Vec<f64> = directions.iter().map(reach).collect();
            let reading =
                TentacleReading { directions: &directions, lengths: &lengths, heading: DVec3::X, radius_mm: 1.5 };
            orders(round, 9.0, Some(&reading), None)[0].1
        };
        assert!(matches!(reported(&slit), RescueAction::SetOff { clear_mines: true, .. }), "{:?}", reported(&slit));
        assert!(matches!(reported(&tube), RescueAction::SetOff { clear_mines: false, .. }), "{:?}", reported(&tube));
    }

    #[test]
    fn the_wrong_end_is_turned_round_at_once() {
        let end = DVec3::X * 95.0;
        let all = orders(|t| DVec3::X * 30.0 * t.min(3.0), 5.0, None, Some(end));
        assert!(matches!(all[0].1, RescueAction::SetOff { clear_mines: true, .. }), "{all:?}");
    }

    #[test]
    fn the_operator_clears_everything_but_that_it_has_turned_round() {
        let (monitor, end) = (MonitorSettings::default(), DVec3::X * 95.0);
        let directions = [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::NEG_X];
        let lengths = [80.0, 10.0, 10.0, 90.0];
        let reading = TentacleReading { directions: &directions, lengths: &lengths, heading: DVec3::X, radius_mm: 1.5 };
        let mut r = Rescue::default();
        for n in 0..600 {
            let at = DVec3::X * 30.0 * (f64::from(n) / 120.0).min(3.0);
            r.follow(at, 1.0 / 120.0, Some(&reading), Some(end), &monitor);
        }
        let turns = r.turns();
        assert!(turns > 0 && !r.monitor().trail().is_empty());
        r.restart();
        assert_eq!((r.turns(), r.escapes(), r.is_escaping(), r.trap()), (turns, 0, false, None));
        assert!(r.monitor().trail().is_empty() && r.forbidden().0.is_empty());
    }

    /// A neck seen from a circle counts if it is in front now, or if it was seen nearby and the circle is a small one.
    #[test]
    fn a_neck_counts_where_it_is_and_near_where_it_was() {
        let directions = [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z, DVec3::NEG_X];
        let reading = |lengths| TentacleReading { directions: &directions, lengths, heading: DVec3::X, radius_mm: 1.5 };
        let closed = reading(&[8.0, 10.0, 10.0, 10.0, 10.0, 90.0]);
        let open = reading(&[80.0, 10.0, 10.0, 10.0, 10.0, 90.0]);
        assert!(closed.kind() == Trap::BlindEnd && open.kind() != Trap::BlindEnd);
        let circling = |radius: f64| {
            let w = 30.0 / radius;
            let mut r = Rescue::default();
            (0..(20.0 / DT) as usize).find_map(|n| {
                let t = n as f64 * DT;
                let at = DVec3::new(radius * (w * t).cos(), radius * (w * t).sin(), 0.0);
                // A blind end was seen on the first millimetres.
                let seen = if t < 0.3 { &closed } else { &open };
                match r.follow(at, DT, Some(seen), None, &MonitorSettings::default()) {
                    RescueAction::SetOff { clear_mines, .. } => Some(clear_mines),
                    _ => None,
                }
            })
        };
        assert_eq!(circling(14.0), Some(true), "a small circle that passes it again");
        assert_eq!(circling(45.0), Some(false), "a large one goes round something");
    }

    /// A flight that wanders in front of a neck tries it while its tentacles reach past the edge, and only then flies back.
    #[test]
    fn a_neck_that_the_tentacles_reach_past_is_tried_before_turning_back() {
        let directions = tentacles::directions(1024);
        let tube = |p: DVec3| p.y.abs() < 10.0 && p.z.abs() < 10.0;
        let slit = |p: DVec3| tube(p) && (p.x < 4.0 || p.x > 6.0 || p.y.abs().max(p.z.abs()) < 1.2);
        let edge = |p: DVec3| tube(p) && !((5.0..6.5).contains(&p.x) && p.y.abs() < 3.0);
        let lengths = |inside: &dyn Fn(DVec3) -> bool| -> Vec<f64> {
            let reach = |d: &DVec3| (1..1500).map(|n| f64::from(n) * 0.1).find(|l| !inside(*d * *l)).unwrap_or(150.0);
            directions.iter().map(reach).collect()
        };
        let (narrow, open) = (lengths(&slit), lengths(&edge));
        let reading = |lengths| TentacleReading { directions: &directions, lengths, heading: DVec3::X, radius_mm: 1.5 };
        assert_eq!((reading(&narrow).kind(), reading(&open).kind()), (Trap::Narrow, Trap::Bridge));
        let (mut r, mut actions) = (Rescue::default(), Vec::new());
        for n in 0..(12.0 / DT) as usize {
            let t = n as f64 * DT;
            let at = DVec3::new(5.0 * (6.0 * t).cos(), 5.0 * (6.0 * t).sin(), 0.0);
            let order = r.follow(
                at,
                DT,
                Some(&reading(if t < 0.3 { &narrow } else { &open })),
                None,
                &MonitorSettings::default(),
            );
            match order {
                RescueAction::SetOff { heading, clear_mines } => actions.push((heading.is_some(), clear_mines)),
                RescueAction::Call { trap, .. } => {
                    assert_eq!(trap, Trap::Narrow);
                    break;
                }
                RescueAction::GoOn => {}
            }
            if actions.len() == 1 {
                let s = TentacleSettings::default();
                assert!(r.temper(&s).wall_push < 0.2 * s.wall_push, "it is bold");
            }
        }
        assert_eq!(actions, [(true, false), (true, true)], "ahead, then back without the mines");
    }

    /// A return flight follows its own trail, which is no stall. It ends at the start, or where the camera gets stuck.
    #[test]
    fn a_return_flight_may_follow_its_trail_but_not_get_stuck() {
        let directions = [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z, DVec3::NEG_X];
        let lengths = [8.0, 10.0, 10.0, 10.0, 10.0, 90.0];
        let reading = TentacleReading { directions: &directions, lengths: &lengths, heading: DVec3::X, radius_mm: 1.5 };
        // Flies 90 mm into a blind end, and back to `least` mm from its start. Returns where the operator is called.
        let called = |least: f64| {
            let (mut r, mut x, mut back) = (Rescue::default(), 0.0f64, false);
            (0..(15.0 / DT) as usize).find_map(|_| {
                x = if back { (x - 30.0 * DT).max(least) } else { (x + 30.0 * DT).min(90.0) };
                match r.follow(DVec3::X * x, DT, Some(&reading), None, &MonitorSettings::default()) {
                    RescueAction::SetOff { .. } => {
                        back = true;
                        None
                    }
                    RescueAction::Call { trap, .. } => Some((x, trap)),
                    RescueAction::GoOn => None,
                }
            })
        };
        let (x, trap) = called(0.0).unwrap();
        assert!((x - START_MM).abs() < 1.0 && trap == Trap::BlindEnd, "{trap:?} at {x}");
        assert_eq!(called(45.0), Some((45.0, Trap::BlindEnd)));
    }

    /// A return flight that finds no new ground calls the operator after two and a half times the length flown before
    /// it, and 100 mm more.
    #[test]
    fn a_return_flight_is_given_up_after_some_length() {
        let directions = [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z, DVec3::NEG_X];
        let lengths = [8.0, 10.0, 10.0, 10.0, 10.0, 90.0];
        let reading = TentacleReading { directions: &directions, lengths: &lengths, heading: DVec3::X, radius_mm: 1.5 };
        // With these, nothing else stops a flight that sways over its own trail.
        let blind = MonitorSettings { least_progress_mm: 0.0, revisited_mm: 1e6, ..MonitorSettings::default() };
        let (mut r, mut x, mut speed, mut flown) = (Rescue::default(), 0.0f64, 30.0f64, 0.0f64);
        let mut came = None;
        let called = (0..(30.0 / DT) as usize).find_map(|_| {
            let next = (x + speed * DT).min(90.0);
            flown += (next - x).abs();
            x = next;
            if came.is_some() && x < 30.0 {
                speed = 30.0;
            } else if came.is_some() && x > 80.0 {
                speed = -30.0;
            }
            let settings = if came.is_some() { blind } else { MonitorSettings::default() };
            match r.follow(DVec3::X * x, DT, Some(&reading), None, &settings) {
                RescueAction::SetOff { .. } => {
                    (came, speed) = (Some(flown), -30.0);
                    None
                }
                RescueAction::Call { .. } => Some(flown),
                RescueAction::GoOn => None,
            }
        });
        let expected = 2.5 * came.unwrap() + 100.0;
        assert!(called.is_some_and(|mm| (mm - expected).abs() < 2.0), "after {called:?} mm instead of {expected}");
    }
}
