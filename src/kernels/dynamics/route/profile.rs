//! The speed profile of a route: as fast as bends, narrow places, acceleration and jerk allow.

use super::Route;
use crate::error::{Error, Result};
use crate::fields::centerline::CenterlineMethod;

/// Length over which curvature is measured, mm. Anything sharper is a wiggle, not a bend.
const BEND_MM: f64 = 6.0;
/// Minimum speed, however narrow and bent the path is, mm/s.
const LEAST_MM_S: f64 = 2.0;

/// How a planned path is flown.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PathSettings {
    /// Speed if nothing limits it, mm/s.
    pub cruise_mm_s: f64,
    /// Maximum acceleration along the path, and across it in bends, mm/s².
    pub acceleration_mm_s2: f64,
    /// Maximum jerk along the path, mm/s³.
    pub jerk_mm_s3: f64,
    /// Minimum time to the nearest wall at the current speed, s: narrow places are flown slowly.
    pub wall_s: f64,
    /// Length of the route ahead that the view is directed at, mm.
    pub look_ahead_mm: f64,
    /// Method that finds the path to fly.
    pub planner: CenterlineMethod,
}

impl Default for PathSettings {
    fn default() -> Self {
        Self {
            cruise_mm_s: 30.0,
            acceleration_mm_s2: 40.0,
            jerk_mm_s3: 160.0,
            wall_s: 0.3,
            look_ahead_mm: 24.0,
            planner: CenterlineMethod::default(),
        }
    }
}

impl PathSettings {
    /// Checks the settings.
    ///
    /// # Errors
    /// Returns status 2 if a setting is not a positive number, or far too large.
    pub fn check(&self) -> Result<()> {
        for (name, value, most) in [
            ("path.cruise_mm_s", self.cruise_mm_s, 1e4),
            ("path.acceleration_mm_s2", self.acceleration_mm_s2, 1e6),
            ("path.jerk_mm_s3", self.jerk_mm_s3, 1e8),
            ("path.wall_s", self.wall_s, 1e3),
            ("path.look_ahead_mm", self.look_ahead_mm, 1e3),
        ] {
            if !(value.is_finite() && value > 0.0 && value <= most) {
                return Err(Error::usage(name, format!("is {value}"), format!("give a number above 0, up to {most}")));
            }
        }
        Ok(())
    }

    /// Returns the speed at a position along a path, mm/s: `v ≤ cruise`, `v² · curvature ≤ acceleration`, `v ≤ clearance / wall_s`.
    pub fn speed(&self, route: &Route, s: f64) -> f64 {
        let bend = route.bend(s, BEND_MM).max(1e-9);
        let allowed = (self.acceleration_mm_s2 / bend).sqrt().min(route.clearance(s) / self.wall_s);
        allowed.max(LEAST_MM_S).min(self.cruise_mm_s)
    }
}

/// The state of a flight along its path at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// Distance from the start, mm.
    pub s: f64,
    /// Speed, mm/s.
    pub v: f64,
    /// Acceleration, mm/s².
    pub a: f64,
}

/// Distance along the route over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// States at intervals of [`Profile::TICK`] seconds.
    moments: Vec<Moment>,
}

impl Profile {
    /// Time between two states, s.
    const TICK: f64 = crate::dynamics::STEP_S;
    /// Maximum duration of a plan, s.
    const LONGEST: f64 = 36_000.0;

    /// Plans the motion from `from` mm to the end of the route, starting at `speed` mm/s and ending at rest. The initial
    /// speed is lower if the route is too short to stop from `speed`.
    ///
    /// The first stage finds the fastest motion under the speed limits and the bounded acceleration, with one forward and
    /// one backward pass over the route (`v² ≤ v₀² + 2 a Δs`; Bobrow, Dubowsky, Gibson 1985). The second stage averages
    /// it over the last `T = 2 a / jerk` seconds. The mean of bounded accelerations has the same bound, and its change
    /// per second is bounded by `2 a / T`, the jerk. Because the average covers speeds allowed a moment ago, it may
    /// exceed the current limit, by no more than `a T / 2`.
    pub fn new(route: &Route, from: f64, speed: f64, settings: &PathSettings) -> Self {
        let a = settings.acceleration_mm_s2;
        let window = ((2.0 * a / settings.jerk_mm_s3 / Self::TICK).round() as usize).clamp(1, 1200);
        let length = route.length_mm();
        let from = if from.is_finite() { from.clamp(0.0, length) } else { 0.0 };
        let speed = if speed.is_finite() { speed.max(0.0) } else { 0.0 };
        // The average lags half a window behind, so the path starts that much ahead.
        let lead = |v: f64| (v * Self::TICK * (window - 1) as f64 / 2.0).min(length - from);
        let (mut fast, begun) = Self::fastest(route, from + lead(speed), speed, settings);
        if begun < speed {
            fast = Self::fastest(route, from + lead(begun), begun, settings).0;
        }
        let speed = begun;
        // Before the start it arrived at its initial speed; after the end it is at rest.
        let before = |n: usize| fast[0] - speed * Self::TICK * n as f64;
        let mut sum: f64 = (1..window).map(before).sum::<f64>() + fast[0];
        let count = fast.len() + window - 1;
        let mut s = Vec::with_capacity(count);
        for n in 0..count {
            if n > 0 {
                let old = if n >= window { fast[n - window] } else { before(window - n) };
                sum += fast[n.min(fast.len() - 1)] - old;
            }
            s.push((sum / window as f64).clamp(from, length));
        }
        let last = s.len() - 1;
        let v = |n: usize| if n < last { (s[n + 1] - s[n]) / Self::TICK } else { 0.0 };
        let moments = (0..=last)
            .map(|n| Moment { s: s[n], v: v(n), a: if n < last { (v(n + 1) - v(n)) / Self::TICK } else { 0.0 } })
            .collect();
        Self { moments }
    }

    /// Returns the distance over time under speed and acceleration limits alone, every [`Profile::TICK`], and the initial speed.
    fn fastest(route: &Route, from: f64, speed: f64, settings: &PathSettings) -> (Vec<f64>, f64) {
        let length = route.length_mm() - from;
        let cells = (length / super::STEP_MM).ceil().clamp(8.0, 1e6) as usize;
        let ds = length / cells as f64;
        let a = settings.acceleration_mm_s2;
        let change = 2.0 * a * ds;
        let mut v: Vec<f64> = (0..=cells).map(|n| settings.speed(route, from + ds * n as f64)).collect();
        v[cells] = 0.0;
        let brake_in_time = |v: &mut [f64]| {
            for n in (0..cells).rev() {
                v[n] = v[n].min((v[n + 1].powi(2) + change).sqrt());
            }
        };
        brake_in_time(&mut v);
        // A body that arrives faster than allowed brakes as hard as it can. If that is not enough, it arrived too fast.
        v[0] = speed;
        for n in 1..=cells {
            let before = v[n - 1].powi(2);
            v[n] = v[n].clamp((before - change).max(0.0).sqrt(), (before + change).sqrt());
        }
        v[cells] = 0.0;
        brake_in_time(&mut v);
        let begun = v[0];
        let mut s = vec![from];
        let (mut cell, mut since) = (0, 0.0);
        let mut time = 0.0;
        loop {
            time += Self::TICK;
            // Within a cell the acceleration is constant; it takes ds over the mean of the speeds at its ends.
            while cell < cells {
                let takes = 2.0 * ds / (v[cell] + v[cell + 1]).max(1e-6);
                if since + takes >= time {
                    break;
                }
                since += takes;
                cell += 1;
            }
            if cell == cells || time > Self::LONGEST {
                s.push(from + length);
                return (s, begun);
            }
            let t = time - since;
            let takes = 2.0 * ds / (v[cell] + v[cell + 1]).max(1e-6);
            let rate = (v[cell + 1] - v[cell]) / takes;
            let within = v[cell] * t + 0.5 * rate * t * t;
            s.push(from + ds * cell as f64 + within.clamp(0.0, ds));
        }
    }

    /// Returns the duration, s.
    pub fn seconds(&self) -> f64 {
        Self::TICK * (self.moments.len() - 1) as f64
    }

    /// Returns the state after `t` seconds; clamped to the start and end.
    pub fn at(&self, t: f64) -> Moment {
        let last = self.moments.len() - 1;
        let u = if t.is_finite() { (t / Self::TICK).clamp(0.0, last as f64) } else { 0.0 };
        let n = (u.floor() as usize).min(last.saturating_sub(1));
        let (p, q) = (self.moments[n], self.moments[(n + 1).min(last)]);
        let mix = |a: f64, b: f64| a + (b - a) * (u - n as f64);
        Moment { s: mix(p.s, q.s), v: mix(p.v, q.v), a: mix(p.a, q.a) }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;

    /// 200 mm straight, a half circle of 12 mm, 200 mm straight back; narrow in the middle of the last part.
    fn hairpin() -> Route {
        let mut line: Vec<DVec3> = (0..=200).map(|n| DVec3::X * f64::from(n)).collect();
        line.extend((1..40).map(|n| {
            let a = std::f64::consts::PI * (f64::from(n) / 40.0 - 0.5);
            DVec3::new(200.0 + 12.0 * a.cos(), 12.0 + 12.0 * a.sin(), 0.0)
        }));
        line.extend((0..=200).map(|n| DVec3::new(200.0 - f64::from(n), 24.0, 0.0)));
        let clearance: Vec<f64> =
            line.iter().map(|p| if p.y > 23.0 && (p.x - 100.0).abs() < 10.0 { 3.0 } else { 14.0 }).collect();
        Route::along(&line, &clearance, DVec3::Z).unwrap()
    }

    /// Returns the greatest speed, acceleration and jerk, from differences over a tick.
    fn measure(p: &Profile) -> (f64, f64, f64) {
        let n = p.moments.len();
        let s: Vec<f64> = (0..n + 2).map(|n| p.at(n as f64 * Profile::TICK).s).collect();
        let diff = |v: &[f64]| v.windows(2).map(|w| (w[1] - w[0]) / Profile::TICK).collect::<Vec<f64>>();
        let v = diff(&s);
        let a = diff(&v);
        let j = diff(&a);
        let most = |v: &[f64]| v.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        (most(&v), most(&a), most(&j))
    }

    #[test]
    fn cruise_slower_in_bends_and_narrow_places_with_bounded_acceleration_and_jerk() {
        let (route, set) = (hairpin(), PathSettings::default());
        let p = Profile::new(&route, 0.0, 0.0, &set);
        let (v, a, j) = measure(&p);
        assert!((v - 30.0).abs() < 0.1, "cruise is reached: {v}");
        // Second differences: rounding of 1e-13 mm is 1e-7 mm/s³, but the ends of cells fall between ticks.
        assert!(a <= set.acceleration_mm_s2 * 1.02 && j <= set.jerk_mm_s3 * 1.05, "{a} {j}");
        let speed_at = |s: f64| {
            let t = (0..).map(|n| f64::from(n) * 0.01).find(|&t| p.at(t).s >= s).unwrap();
            p.at(t).v
        };
        assert!(speed_at(100.0) > 29.0);
        let bend = speed_at(200.0 + 6.0 * std::f64::consts::PI);
        assert!((bend - (40.0 * 12.0f64).sqrt()).abs() < 1.5, "{bend}");
        let narrow = speed_at(300.0 + 12.0 * std::f64::consts::PI);
        assert!((narrow - 10.0).abs() < 2.0, "{narrow}");
        let end = p.at(p.seconds());
        assert!((end.s - route.length_mm()).abs() < 1e-9 && end.v == 0.0 && p.at(0.0).s == 0.0);
        assert!(p.at(1e9).s == end.s && p.at(f64::NAN).s == 0.0);
        let fastest = route.length_mm() / 30.0;
        assert!(p.seconds() > fastest && p.seconds() < fastest + 6.0, "{} s, at cruise {fastest}", p.seconds());
    }

    #[test]
    fn what_comes_with_speed_goes_on_with_it() {
        let (route, set) = (hairpin(), PathSettings::default());
        let p = Profile::new(&route, 50.0, 18.0, &set);
        assert!((p.at(0.0).s - 50.0).abs() < 1e-9 && (p.at(0.0).v - 18.0).abs() < 0.5, "{:?}", p.at(0.0));
        let (_, a, j) = measure(&p);
        assert!(a <= 41.0 && j <= 170.0, "{a} {j}");
        // Too fast to stop in time: the guidance must shed the excess.
        let short = Profile::new(&route, route.length_mm() - 1.0, 50.0, &set);
        assert!(short.at(0.0).v <= (2.0f64 * 40.0).sqrt() + 0.5);
        assert!((short.at(9.0).s - route.length_mm()).abs() < 1e-9);
        let at_end = Profile::new(&route, 1e9, 1.0, &set);
        assert!((at_end.at(1.0).s - route.length_mm()).abs() < 1e-9 && at_end.at(0.0).v.is_finite());
        // The narrow place is passed as slowly wherever the plan begins, and the straight part before it as fast.
        let narrow = 300.0 + 12.0 * std::f64::consts::PI;
        for from in [40.0, 150.0, 250.0] {
            let p = Profile::new(&route, from, 0.0, &set);
            let v = |s: f64| (0..).map(|n| p.at(f64::from(n) * 0.01)).find(|m| m.s >= s).unwrap().v;
            assert!((v(narrow) - 10.0).abs() < 2.0, "{} from {from}", v(narrow));
            assert!(from > 100.0 || v(130.0) > 29.0, "{} from {from}", v(130.0));
        }
    }

    /// With nearly unlimited acceleration the speed is that of each place, along the whole of a narrow stretch and nowhere else.
    #[test]
    fn a_narrow_stretch_is_slow_from_its_beginning_to_its_end() {
        let line: Vec<DVec3> = (0..=100).map(|n| DVec3::X * f64::from(n)).collect();
        let clearance: Vec<f64> = (0..=100).map(|n| if (50..=60).contains(&n) { 3.0 } else { 14.0 }).collect();
        let route = Route::along(&line, &clearance, DVec3::Z).unwrap();
        let set = PathSettings { acceleration_mm_s2: 1e4, jerk_mm_s3: 1e8, ..PathSettings::default() };
        let p = Profile::new(&route, 0.0, 0.0, &set);
        let [mut slow, mut fast] = [0, 0];
        for m in &p.moments {
            if (50.2..59.8).contains(&m.s) {
                assert!((m.v - 10.0).abs() < 0.5, "{m:?}");
                slow += 1;
            } else if (2.0..48.8).contains(&m.s) || (61.2..98.0).contains(&m.s) {
                assert!((m.v - 30.0).abs() < 0.5, "{m:?}");
                fast += 1;
            }
        }
        assert!(slow > 100 && fast > 300, "{slow} {fast}");
    }

    #[test]
    fn nonsense_is_refused() {
        let good = PathSettings::default();
        assert!(good.check().is_ok());
        for bad in [
            PathSettings { cruise_mm_s: 0.0, ..good },
            PathSettings { cruise_mm_s: f64::NAN, ..good },
            PathSettings { acceleration_mm_s2: -1.0, ..good },
            PathSettings { jerk_mm_s3: f64::INFINITY, ..good },
            PathSettings { wall_s: 0.0, ..good },
            PathSettings { look_ahead_mm: -3.0, ..good },
        ] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn never_backwards_never_faster_always_to_the_end(
            from in 0.0f64..440.0, speed in 0.0f64..60.0, cruise in 1.0f64..200.0, a in 1.0f64..500.0, t in 0.02f64..1.0,
        ) {
            let set = PathSettings {
                cruise_mm_s: cruise, acceleration_mm_s2: a, jerk_mm_s3: 2.0 * a / t, ..PathSettings::default()
            };
            let route = hairpin();
            let p = Profile::new(&route, from, speed, &set);
            let n = (p.seconds() / Profile::TICK).round() as usize;
            let mut last = p.at(0.0);
            for k in 1..=n {
                let m = p.at(k as f64 * Profile::TICK);
                prop_assert!(m.s >= last.s - 1e-9 && m.v <= cruise.max(speed) * 1.001 + 1e-6, "{m:?}");
                last = m;
            }
            prop_assert!((last.s - route.length_mm()).abs() < 1e-6);
            let (_, most, _) = measure(&p);
            prop_assert!(most <= a * 1.05 + 1e-3, "{most} for {a}");
        }
    }
}
