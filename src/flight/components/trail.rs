//! The path and views of a flight, recorded coarsely: for coverage and for flying back.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::dynamics::Attitude;

/// A view is recorded when the camera is this far from the last one, mm, …
const STEP_MM: f64 = 2.0;
/// … or has turned by this angle, as its cosine: 10°.
const TURN: f64 = 0.984_807_753_012_208;

/// Calls closer together than this share of the path count as one.
const ONE_CALL: f64 = 0.01;
/// Maximum number of calls kept.
const CALLS: usize = 64;

/// The views of a flight, in order, each with its share of the path (0 to 1, from the current start to the current goal).
///
/// The share matches what the operator is shown: it comes from the plan, or without one from the distance flown over the
/// approximate length of the path. It is reversed after the flight turns round, and after a jump it counts from the new position.
#[derive(Component, Clone, Debug, Default)]
pub struct Trail {
    views: Vec<(DVec3, Attitude)>,
    shares: Vec<f64>,
    /// Index of the first view since the flight last set out. Earlier views are on another path.
    begins: usize,
    /// Index of the first view of each leg since then: no path connects it to the view before.
    legs: Vec<usize>,
    /// True if the next view starts a leg.
    leaves: bool,
    /// Length of the path, mm.
    length_mm: f64,
    /// Distance flown until the last step, mm.
    flown_mm: f64,
    /// The camera's share of the path.
    share: f64,
    /// Where the guide called the operator since the flight last set out.
    calls: Vec<f64>,
}

impl Trail {
    /// Starts a new path of length `length_mm`. Views recorded earlier are kept.
    pub fn set_out(&mut self, length_mm: f64) {
        (self.begins, self.length_mm, self.flown_mm) = (self.views.len(), length_mm.max(0.0), 0.0);
        self.legs.clear();
        self.calls.clear();
        self.jump(0.0);
    }

    /// Moves the camera to a share of the path.
    pub fn jump(&mut self, share: f64) {
        (self.share, self.leaves) = (share, true);
    }

    /// Swaps start and goal.
    pub fn turn_round(&mut self) {
        self.share = 1.0 - self.share;
        self.shares[self.begins..].iter_mut().chain(&mut self.calls).for_each(|s| *s = 1.0 - *s);
    }

    /// Records a call for the operator here.
    pub fn call(&mut self) {
        if self.calls.len() < CALLS && self.calls.iter().all(|c| (c - self.share).abs() > ONE_CALL) {
            self.calls.push(self.share);
        }
    }

    /// Returns where the guide called the operator since the flight set out, as shares of the path.
    pub fn calls(&self) -> &[f64] {
        &self.calls
    }

    /// Returns the camera's share of the path.
    pub fn share(&self) -> f64 {
        self.share
    }

    /// Returns the length of the path, mm.
    pub fn length_mm(&self) -> f64 {
        self.length_mm
    }

    /// Marks the goal as reached, regardless of the count.
    pub fn arrive(&mut self) {
        self.share = 1.0;
    }

    /// Records the view after a step.
    ///
    /// `flown_mm` is the flight's length so far. `planned` is the position along a plan and the plan's length (mm), if
    /// there is one.
    pub fn follow(&mut self, view: (DVec3, Attitude), flown_mm: f64, planned: Option<(f64, f64)>) {
        let before = self.share;
        let along_mm = match planned {
            Some((s, length_mm)) => {
                self.length_mm = length_mm;
                s
            }
            None => self.share * self.length_mm + (flown_mm - self.flown_mm).max(0.0),
        };
        self.flown_mm = flown_mm;
        self.share = if self.length_mm > 0.0 { (along_mm / self.length_mm).clamp(0.0, 1.0) } else { 0.0 };
        if std::mem::take(&mut self.leaves) {
            self.legs.push(self.views.len());
            // The step after a jump is short; the path is known from its start on.
            self.keep(view, before);
            return;
        }
        let is_new = |last: &(DVec3, Attitude)| {
            last.0.distance(view.0) >= STEP_MM
                || last.1.forward.dot(view.1.forward) < TURN
                || last.1.up.dot(view.1.up) < TURN
        };
        if self.views.last().is_none_or(is_new) {
            self.keep(view, self.share);
        }
    }

    fn keep(&mut self, view: (DVec3, Attitude), share: f64) {
        self.views.push(view);
        self.shares.push(share);
    }

    /// Returns the views, in order.
    pub fn views(&self) -> &[(DVec3, Attitude)] {
        &self.views
    }

    /// Returns the share of the path at the view nearest to a place (world mm) since the flight set out.
    ///
    /// Returns the camera's share if there is no view.
    pub fn share_near(&self, place: DVec3) -> f64 {
        let views = self.views.iter().zip(&self.shares).skip(self.begins);
        let near = views.map(|(v, s)| (v.0.distance_squared(place), *s)).min_by(|a, b| a.0.total_cmp(&b.0));
        near.map_or(self.share, |n| n.1)
    }

    /// Returns the last view at a share of the path, or `None` if the flight has not been there since it set out.
    pub fn at(&self, share: f64) -> Option<(DVec3, Attitude)> {
        let count = self.views.len();
        // Pointing at the camera's position may select a point slightly beyond it.
        let about = self.share + if self.length_mm > 0.0 { STEP_MM / self.length_mm } else { 0.0 };
        for n in (self.begins..count).rev() {
            let here = self.shares[n];
            // On the same leg. Anything after the last view is too near to it to be recorded.
            let next = match n + 1 {
                m if m == count => {
                    if self.leaves {
                        here
                    } else {
                        about
                    }
                }
                m if self.legs.binary_search(&m).is_ok() => here,
                m => self.shares[m],
            };
            if here.min(next) <= share && share <= here.max(next) {
                let nearer = n + 1 < count && (next - share).abs() < (here - share).abs();
                return Some(self.views[if nearer { n + 1 } else { n }]);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOK: Attitude = Attitude { forward: DVec3::X, up: DVec3::Z };

    /// Flies along x in steps of 0.1 mm; `flown` is the distance flown, updated in place.
    fn fly(t: &mut Trail, from: f64, to: f64, flown: &mut f64) {
        let steps = ((to - from).abs() * 10.0).round() as i32;
        for n in 1..=steps {
            let x = from + (to - from) * f64::from(n) / f64::from(steps);
            *flown += 0.1;
            t.follow((DVec3::X * x, LOOK), *flown, None);
        }
    }

    #[test]
    fn the_way_back_is_known_and_no_further() {
        let (mut t, mut flown) = (Trail::default(), 0.0);
        t.set_out(200.0);
        assert!(t.at(0.0).is_none());
        fly(&mut t, 0.0, 100.0, &mut flown);
        assert!(t.views().len() > 40 && t.views().len() < 60);
        for share in [0.0, 0.1, 0.25, 0.5] {
            let x = t.at(share).unwrap().0.x;
            assert!((x - 200.0 * share).abs() < 2.1, "{x} at {share}");
        }
        assert!(t.at(0.52).is_none() && t.at(1.0).is_none());
        t.follow((DVec3::X * 99.9, Attitude::new(DVec3::Y, DVec3::Z)), flown, None);
        assert_eq!(t.views().last().unwrap().1.forward, DVec3::Y, "a turn on the spot is a view of its own");
    }

    #[test]
    fn calls_are_kept_once_and_turn_round_with_the_way() {
        let (mut t, mut flown) = (Trail::default(), 0.0);
        t.set_out(200.0);
        fly(&mut t, 0.0, 60.0, &mut flown);
        t.call();
        t.call();
        assert!((t.share() - 0.3).abs() < 1e-9 && t.calls() == [t.share()]);
        t.turn_round();
        assert!((t.share() - 0.7).abs() < 1e-9 && t.calls() == [t.share()]);
        for n in 0..300 {
            t.jump(f64::from(n) / 300.0);
            t.call();
        }
        assert!(t.calls().len() <= CALLS);
        t.set_out(0.0);
        assert!(t.calls().is_empty() && t.share() == 0.0);
    }

    #[test]
    fn legs_are_counted_as_the_operator_is_shown_them() {
        let (mut t, mut flown) = (Trail::default(), 0.0);
        let x = |t: &Trail, share: f64| t.at(share).map(|v| v.0.x);
        let near = |a: Option<f64>, b: f64| a.is_some_and(|a| (a - b).abs() < 2.1);
        t.set_out(200.0);
        fly(&mut t, 0.0, 120.0, &mut flown);
        // Turned round at 60 %: that is 40 % of the way back. The goal is now at x = 0.
        t.turn_round();
        fly(&mut t, 120.0, 100.0, &mut flown);
        assert!(near(x(&t, 0.45), 110.0) && near(x(&t, 0.9), 20.0), "{:?} {:?}", x(&t, 0.45), x(&t, 0.9));
        assert!(t.at(0.2).is_none(), "on the way there it did not come so far");
        // A jump back to 80 %, and on from there.
        t.jump(0.8);
        fly(&mut t, 40.0, 30.0, &mut flown);
        assert!(near(x(&t, 0.84), 32.0) && near(x(&t, 0.6), 80.0) && near(x(&t, 1.0), 0.0));
        // Another path: none of the former shares count, but all views are kept.
        let seen = t.views().len();
        t.set_out(50.0);
        assert!(t.at(0.0).is_none());
        fly(&mut t, 500.0, 510.0, &mut 0.0);
        assert!(near(x(&t, 0.1), 505.0) && t.at(0.5).is_none() && t.views().len() > seen);
        // The flight covered more than the approximate length.
        fly(&mut t, 510.0, 580.0, &mut 10.0);
        t.arrive();
        assert!(t.at(1.0).is_some() && near(x(&t, 0.5), 525.0));
    }

    #[test]
    fn a_plan_tells_the_share_by_itself() {
        let mut t = Trail::default();
        t.set_out(70.0);
        for n in 0..100 {
            let s = f64::from(n);
            t.follow((DVec3::X * s, LOOK), s, Some((s, 200.0)));
        }
        assert!((t.at(0.25).unwrap().0.x - 50.0).abs() < 2.1 && t.at(0.6).is_none());
        // Without a plan the count continues from there.
        let mut flown = 99.0;
        fly(&mut t, 99.0, 140.0, &mut flown);
        assert!((t.at(0.6).unwrap().0.x - 120.0).abs() < 2.1);
    }

    fn look(degrees: f64) -> Attitude {
        Attitude::new(DVec3::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0), DVec3::Z)
    }

    #[test]
    fn a_view_is_recorded_every_two_millimetres_or_ten_degrees() {
        let mut t = Trail::default();
        t.set_out(100.0);
        let mut kept = |x: f64, look: Attitude| {
            t.follow((DVec3::X * x, look), 0.0, None);
            t.views().len()
        };
        assert_eq!([0.0, 0.0, 1.99, 2.0, 3.99, 4.0].map(|x| kept(x, LOOK)), [1, 1, 1, 2, 2, 3]);
        // The next is measured from the last one recorded, not from the last step.
        assert_eq!([9.9, 10.1, 15.0, 20.2].map(|a| kept(4.0, look(a))), [3, 4, 4, 5]);
        let roll = |degrees: f64| {
            let (s, c) = degrees.to_radians().sin_cos();
            let forward = look(20.2).forward;
            Attitude { forward, up: DVec3::Z * c + forward.cross(DVec3::Z) * s }
        };
        assert_eq!([9.9, 10.1].map(|a| kept(4.0, roll(a))), [5, 6], "a roll is a turn too");
    }

    #[test]
    fn a_share_is_between_0_and_1_and_0_of_no_path() {
        let mut t = Trail::default();
        t.set_out(10.0);
        let mut share = |flown: f64, planned: Option<(f64, f64)>| {
            t.follow((DVec3::ZERO, LOOK), flown, planned);
            t.share()
        };
        assert_eq!(share(4.0, None), 0.4);
        assert_eq!(share(2.0, None), 0.4, "a flight's length that starts anew does not take it back");
        assert_eq!(share(3.0, None), 0.5);
        assert_eq!(share(90.0, None), 1.0);
        assert_eq!(share(90.0, Some((-1.0, 20.0))), 0.0);
        assert_eq!(share(90.0, Some((21.0, 20.0))), 1.0);
        assert_eq!(share(90.0, Some((5.0, 0.0))), 0.0);
        t.set_out(-3.0);
        t.follow((DVec3::ZERO, LOOK), 5.0, None);
        assert_eq!((t.length_mm(), t.share()), (0.0, 0.0));
    }

    #[test]
    fn a_path_set_out_on_counts_from_its_own_start() {
        let mut t = Trail::default();
        t.set_out(100.0);
        fly(&mut t, 0.0, 30.0, &mut 0.0);
        t.call();
        let seen = t.views().len();
        t.set_out(50.0);
        assert_eq!((t.share(), t.length_mm(), t.views().len()), (0.0, 50.0, seen));
        assert!(t.calls().is_empty());
        // The flight's length starts again, and so do the counts.
        t.follow((DVec3::Y * 5.0, LOOK), 5.0, None);
        assert!((t.share() - 0.1).abs() < 1e-12);
        assert_eq!(t.share_near(DVec3::ZERO), 0.0, "the first view of this path, not one of the former");
        assert_eq!(t.at(0.0).map(|v| v.0), Some(DVec3::Y * 5.0));
    }

    #[test]
    fn after_a_jump_the_first_view_is_recorded_however_near_and_begins_a_leg() {
        let (mut t, mut flown) = (Trail::default(), 0.0);
        t.set_out(100.0);
        fly(&mut t, 0.0, 10.0, &mut flown);
        let seen = t.views().len();
        t.jump(0.5);
        assert_eq!(t.share(), 0.5);
        assert!(t.at(0.3).is_none(), "nothing connects the two places, even before the next step");
        assert!((t.at(0.05).unwrap().0.x - 5.0).abs() < 1.2);
        t.follow((DVec3::X * 10.0, LOOK), flown + 1.0, None);
        assert_eq!(t.views().len(), seen + 1);
        t.follow((DVec3::X * 10.1, LOOK), flown + 2.0, None);
        assert_eq!(t.views().len(), seen + 1, "only the first");
        assert!((t.share() - 0.52).abs() < 1e-12);
        assert!(t.at(0.3).is_none() && t.at(0.49).is_none() && t.at(0.5).is_some());
    }

    #[test]
    fn calls_farther_apart_than_a_hundredth_are_two() {
        let mut t = Trail::default();
        t.set_out(100.0);
        for (share, calls) in [(0.5, 1), (0.509, 1), (0.491, 1), (0.511, 2), (0.489, 3)] {
            t.jump(share);
            t.call();
            assert_eq!(t.calls().len(), calls, "{share}");
        }
        assert_eq!(t.calls(), [0.5, 0.511, 0.489]);
    }
}
