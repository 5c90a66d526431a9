//! Guidance along a plan: keeps a body on it by force, from wherever the body joins it.

use glam::DVec3;

use super::Route;
use super::profile::{PathSettings, Profile};

/// Natural frequency of the pull back to the plan, rad/s: critically damped, well below the step rate.
const PULL: f64 = 6.0;
/// A body farther than this from its planned position is blocked, mm: it must join the plan again.
const LOST_MM: f64 = 6.0;
/// Minimum time for leading a body back to the plan, s …
const JOIN_S: f64 = 1.0;
/// … and the maximum acceleration for it, mm/s².
const JOIN_MM_S2: f64 = 30.0;
/// From the first offset on, mm, progress along the route slows down for a body that is being led back; from the second
/// on it stops. A body that flies on beside the route would hit the next fold.
const WAITS_MM: [f64; 2] = [1.0, 4.0];

/// A flight along a route from where the body joined it.
#[derive(Clone, Debug)]
pub struct RouteFollower {
    profile: Profile,
    /// Time of the plan since the body joined it, and real time since then, s.
    time: f64,
    since: f64,
    /// Offset of the body from the plan at that moment, mm, with its first and second derivatives, mm/s and mm/s².
    off: [DVec3; 3],
    /// Time after which the offset is zero, s.
    join_s: f64,
    /// Current multiple of the plan's speed.
    rate: f64,
    /// Position along the route, mm.
    s: f64,
    /// How much the progress along the route waits for the body to return to it, 0 to 1.
    waits: f64,
}

/// A command from the route follower to the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidanceCommand {
    /// Acceleration in addition to that of the drag, world mm/s².
    pub acceleration: DVec3,
    /// Position along the route, mm.
    pub s: f64,
}

impl RouteFollower {
    /// Joins the route at `s` mm with a body at `position` (world mm) with `velocity` (world mm/s) and `acceleration`
    /// (world mm/s²), flown at `rate` times the plan's speed.
    pub fn join(
        route: &Route,
        s: f64,
        [position, velocity, acceleration]: [DVec3; 3],
        rate: f64,
        settings: &PathSettings,
    ) -> Self {
        let rate = if rate.is_finite() { rate.max(1e-3) } else { 1.0 };
        let profile = Profile::new(route, s, velocity.dot(route.tangent(s)) / rate, settings);
        let begin = profile.at(0.0);
        let off = position - route.place(begin.s);
        let waits = ((off.length() - WAITS_MM[0]) / (WAITS_MM[1] - WAITS_MM[0])).clamp(0.0, 1.0);
        let w = velocity - route.tangent(begin.s) * (begin.v * rate * (1.0 - waits));
        // The quintic that brings an offset d to rest has an acceleration of at most 5.8 d/T² (from a speed w, 4 w/T).
        let by_place = (5.8 * off.length() / JOIN_MM_S2).sqrt();
        let by_speed = 4.0 * w.length() / JOIN_MM_S2;
        let join_s = JOIN_S.max(by_place).max(by_speed.min(2.0)).min(4.0);
        let off = [off, w, DVec3::ZERO];
        let mut follower = Self { profile, time: 0.0, since: 0.0, off, join_s, rate, s: begin.s, waits };
        let [.., planned] = follower.wanted(route);
        // A body stopped by a wall has no acceleration to continue with.
        follower.off[2] = (acceleration - planned).clamp_length_max(4.0 * JOIN_MM_S2);
        follower
    }

    /// Returns the position along the route, mm.
    pub fn s(&self) -> f64 {
        self.s
    }

    /// Returns the offset of the body from the plan at `u = t/T` after it joined: `d(u)`, `ḋ`, `d̈`.
    ///
    /// It is the quintic Hermite polynomial from `(d₀, w, b)` to rest at 0, so position, velocity and acceleration are continuous.
    fn offset(&self) -> [DVec3; 3] {
        let [d, w, b] = self.off;
        let big = self.join_s;
        let u = self.since / big;
        if u >= 1.0 {
            return [DVec3::ZERO; 3];
        }
        let (w, b) = (w * big, b * (big * big / 2.0));
        let (u2, u3) = (u * u, u * u * u);
        let place = d * (1.0 - u3 * (10.0 - 15.0 * u + 6.0 * u2))
            + w * (u - u3 * (6.0 - 8.0 * u + 3.0 * u2))
            + b * (u2 * (1.0 - 3.0 * u + 3.0 * u2 - u3));
        let speed = d * (-30.0 * u2 * (1.0 - 2.0 * u + u2))
            + w * (1.0 - u2 * (18.0 - 32.0 * u + 15.0 * u2))
            + b * (u * (2.0 - 9.0 * u + 12.0 * u2 - 5.0 * u3));
        let bent = d * (-60.0 * u * (1.0 - 3.0 * u + 2.0 * u2))
            + w * (-u * (36.0 - 96.0 * u + 60.0 * u2))
            + b * (2.0 - 18.0 * u + 36.0 * u2 - 20.0 * u3);
        [place, speed / big, bent / (big * big)]
    }

    /// Returns the current rate of the plan's time and its change per second. A flight that waits starts gradually (smoothstep).
    fn pace(&self) -> (f64, f64) {
        let u = (self.since / self.join_s).min(1.0);
        let share = 1.0 - self.waits + self.waits * u * u * (3.0 - 2.0 * u);
        (self.rate * share, self.rate * self.waits * 6.0 * u * (1.0 - u) / self.join_s)
    }

    /// Returns the planned position of the body now, with velocity and acceleration (world; mm, mm/s, mm/s²).
    fn wanted(&self, route: &Route) -> [DVec3; 3] {
        let m = self.profile.at(self.time);
        let (pace, quickens) = self.pace();
        let (v, a) = (m.v * pace, m.a * pace * pace + m.v * quickens);
        let tangent = route.tangent(m.s);
        // The curve's second derivative, from its tangents on both sides.
        let (before, after) = ((m.s - 0.5).max(0.0), (m.s + 0.5).min(route.length_mm()));
        let curve = (route.tangent(after) - route.tangent(before)) / (after - before).max(1e-9);
        let [d, d1, d2] = self.offset();
        [route.place(m.s) + d, tangent * v + d1, tangent * a + curve * (v * v) + d2]
    }

    /// Advances by `dt` seconds at `rate` times the plan's speed and returns the command for a body.
    ///
    /// The body is at `position` (world mm) with `velocity` (world mm/s) and a drag of `drag` 1/s. Returns `None` if it
    /// is too far from its planned position: it is blocked and must [`RouteFollower::join`] again.
    ///
    /// `a = a_w + k v_w + ω² (x_w − x) + (2ω − k)⁺ (v_w − v)`: with the drag −k v the error satisfies `ë + 2ω ė + ω² e =
    /// 0`, the critically damped oscillator.
    pub fn command(
        &mut self,
        route: &Route,
        (position, velocity): (DVec3, DVec3),
        drag: f64,
        rate: f64,
        dt: f64,
    ) -> Option<GuidanceCommand> {
        // The rate changes gradually, so the body can follow.
        let rate = if rate.is_finite() { rate.max(1e-3) } else { self.rate };
        self.rate += (rate - self.rate) * (1.0 - (-dt / 0.3).exp());
        let [x, v, a] = self.wanted(route);
        self.time += dt * self.pace().0;
        self.since += dt;
        self.s = self.profile.at(self.time).s;
        let off = x - position;
        if off.length() > LOST_MM {
            return None;
        }
        let damping = (2.0 * PULL - drag).max(0.0);
        let acceleration = a + v * drag + off * (PULL * PULL) + (v - velocity) * damping;
        acceleration.is_finite().then_some(GuidanceCommand { acceleration, s: self.s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Body;

    use crate::dynamics::STEP_S as DT;

    fn route() -> Route {
        let line: Vec<_> = (0..400)
            .map(|n| {
                let z = f64::from(n);
                DVec3::new(12.0 * (z / 30.0).sin(), 8.0 * (z / 45.0).cos(), z)
            })
            .collect();
        Route::along(&line, &vec![15.0; 400], DVec3::Y).unwrap()
    }

    /// Flies a body along the route for `seconds` and returns its positions and velocities.
    fn fly(
        follower: &mut RouteFollower,
        route: &Route,
        start: (DVec3, DVec3),
        rate: f64,
        seconds: f64,
    ) -> (Vec<DVec3>, Vec<DVec3>) {
        let k = Body::default().drag_per_s;
        let (mut x, mut v) = start;
        let (mut xs, mut vs) = (vec![x], vec![v]);
        for _ in 0..(seconds / DT) as usize {
            let order = follower.command(route, (x, v), k, rate, DT).expect("nothing holds it");
            // Exact for a constant acceleration: v' = a − k v.
            let (rest, decay) = (order.acceleration / k, (-k * DT).exp());
            x += rest * DT + (v - rest) * ((1.0 - decay) / k);
            v = rest + (v - rest) * decay;
            xs.push(x);
            vs.push(v);
        }
        (xs, vs)
    }

    /// Returns the greatest acceleration and jerk, from differences of the velocities.
    fn jerk(v: &[DVec3]) -> (f64, f64) {
        let diff = |v: &[DVec3]| v.windows(2).map(|w| (w[1] - w[0]) / DT).collect::<Vec<_>>();
        let most = |v: &[DVec3]| v.iter().map(|a| a.length()).fold(0.0, f64::max);
        let a = diff(v);
        (most(&a), most(&diff(&a)))
    }

    #[test]
    fn from_end_to_end_on_the_line() {
        let (route, set) = (route(), PathSettings::default());
        for rate in [0.5, 1.0, 2.0] {
            let start = (route.place(0.0), DVec3::ZERO);
            let mut follower = RouteFollower::join(&route, 0.0, [start.0, start.1, DVec3::ZERO], rate, &set);
            let seconds = follower.profile.seconds() / rate + 1.0;
            let (x, v) = fly(&mut follower, &route, start, rate, seconds);
            let off = x.iter().map(|p| route.nearest(*p).first().map_or(9.0, |&s| route.place(s).distance(*p)));
            let off = off.fold(0.0, f64::max);
            assert!(off < 0.1 * rate.max(1.0) * rate, "{off} mm off at {rate}");
            assert!(x[x.len() - 1].distance(route.place(1e9)) < 0.01);
            let fastest = v.iter().map(|v| v.length()).fold(0.0, f64::max);
            assert!(fastest <= 30.5 * rate && fastest > 25.0 * rate, "{fastest} mm/s at {rate}");
            if rate == 1.0 {
                // Along the path and across it: each within its limit, so together within √2 of it.
                let (a, j) = jerk(&v);
                assert!(a < 57.0 && j < 400.0, "{a} {j}");
            }
        }
    }

    #[test]
    fn taken_up_anywhere_without_a_jolt() {
        let (route, set) = (route(), PathSettings::default());
        for (s, off, v) in [
            (100.0, DVec3::new(6.0, -5.0, 0.0), DVec3::new(0.0, 0.0, -20.0)),
            (200.0, DVec3::new(0.0, 9.0, 1.0), DVec3::new(25.0, 0.0, 0.0)),
            (5.0, DVec3::ZERO, DVec3::ZERO),
        ] {
            let start = (route.place(s) + off, v);
            let near = route.nearest(start.0)[0];
            let mut follower = RouteFollower::join(&route, near, [start.0, start.1, start.1 * -6.0], 1.0, &set);
            let (x, vs) = fly(&mut follower, &route, start, 1.0, 6.0);
            let end = x[x.len() - 1];
            assert!(route.place(route.nearest(end)[0]).distance(end) < 0.1, "back on the line");
            assert!(follower.s() > near + 40.0, "and on");
            let (a, j) = jerk(&vs);
            println!(
                "joined {:.1} mm off at {:.0} mm/s: acceleration {a:.0} mm/s², jerk {j:.0} mm/s³",
                off.length(),
                v.length()
            );
            assert!(a < 150.0 && j < 1000.0, "{a} {j}");
        }
    }

    #[test]
    fn held_fast_is_noticed_and_nonsense_is_survived() {
        let (route, set) = (route(), PathSettings::default());
        let start = (route.place(50.0), DVec3::ZERO);
        let mut follower = RouteFollower::join(&route, 50.0, [start.0, start.1, DVec3::ZERO], 1.0, &set);
        assert!((0..600).any(|_| follower.command(&route, start, 6.0, 1.0, DT).is_none()), "it hangs");
        for bad in [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e9] {
            let mut p =
                RouteFollower::join(&route, bad, [DVec3::ZERO, DVec3::splat(bad), DVec3::splat(bad)], bad, &set);
            for _ in 0..100 {
                if let Some(o) = p.command(&route, start, 6.0, bad, DT) {
                    assert!(o.acceleration.is_finite() && o.s.is_finite());
                }
            }
        }
    }

    /// A quintic from the speed w takes 4 w/T: at 30 mm/s² and 15 mm/s it takes 2 s.
    #[test]
    fn joining_takes_as_long_as_the_offset_and_the_speed_need() {
        let (route, set) = (route(), PathSettings::default());
        let join = |off: DVec3, velocity: DVec3| {
            let state = [route.place(100.0) + off, velocity, DVec3::ZERO];
            RouteFollower::join(&route, 100.0, state, 1.0, &set).join_s
        };
        let along = route.tangent(100.0);
        let across = along.cross(DVec3::Y).normalize();
        assert!((join(DVec3::ZERO, along * 20.0 + across * 9.0) - 1.2).abs() < 0.05);
        assert!((join(DVec3::ZERO, along * 20.0 + across * 50.0) - 2.0).abs() < 1e-9, "at most 2 s for a speed");
        assert!((join(across * 40.0, along * 20.0) - (5.8f64 * 40.0 / 30.0).sqrt()).abs() < 0.3);
        assert!((join(across * 900.0, along * 20.0) - 4.0).abs() < 1e-9, "and 4 s for an offset");
        assert!((join(DVec3::ZERO, along * 20.0) - JOIN_S).abs() < 1e-9);
    }

    /// What already flies along the route as fast as planned goes on like that, at any multiple of the plan's speed.
    #[test]
    fn a_body_at_the_planned_speed_keeps_it() {
        let line: Vec<_> = (0..400).map(|n| DVec3::Z * f64::from(n)).collect();
        let route = Route::along(&line, &[15.0; 400], DVec3::Y).unwrap();
        let set = PathSettings::default();
        for rate in [0.5, 1.0, 2.0] {
            let start = (route.place(100.0), DVec3::Z * (rate * set.cruise_mm_s));
            let mut follower = RouteFollower::join(&route, 100.0, [start.0, start.1, DVec3::ZERO], rate, &set);
            let (_, speeds) = fly(&mut follower, &route, start, rate, 1.0);
            let off = speeds.iter().map(|v| v.distance(start.1)).fold(0.0, f64::max);
            assert!(off < 0.5, "{off} mm/s at {rate}");
        }
    }
}
