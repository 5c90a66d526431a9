//! Noticing that a flight gets nowhere: a blind end, circling, dithering between two ways (paper, sections 3.1.1, 3.2).

use glam::DVec3;

/// When a flight counts as getting nowhere.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MonitorSettings {
    /// How far back the net progress is measured, s.
    pub window_s: f64,
    /// Less net displacement than this within the window is none, mm.
    pub least_progress_mm: f64,
    /// A place counts as visited when it comes within this of the trail, mm.
    pub visited_mm: f64,
    /// So much way over visited ground, against or along the trail, is turning back or circling, mm.
    pub revisited_mm: f64,
}

impl Default for MonitorSettings {
    fn default() -> Self {
        Self { window_s: 2.0, least_progress_mm: 6.0, visited_mm: 6.0, revisited_mm: 25.0 }
    }
}

/// Why a flight gets nowhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// It hangs in place: every direction is closed.
    NoWayOn,
    /// It moves but stays where it is: two forces or two ways take turns.
    Dithering,
    /// It flies back over its own trail.
    TurnedBack,
    /// It flies over its own trail again in the same sense.
    Circling,
}

impl Trouble {
    /// As the operator reads it.
    pub fn text(self) -> &'static str {
        match self {
            Self::NoWayOn => "no way on",
            Self::Dithering => "confused: dithering in one place",
            Self::TurnedBack => "no way on: the guide turned back over its own trail",
            Self::Circling => "confused: circling over its own trail",
        }
    }
}

/// Way between two points of the trail, mm.
const TRAIL_STEP_MM: f64 = 2.0;
/// Trail nearer than this along the way is not "visited ground" but where the camera has just been, mm.
const RECENT_MM: f64 = 40.0;

/// The camera's trail and what can be read from it.
#[derive(Clone, Debug, Default)]
pub struct Monitor {
    /// Points each [`TRAIL_STEP_MM`] of the way, world mm.
    trail: Vec<DVec3>,
    /// Positions each quarter of the window, oldest first, with the way flown until then.
    recent: std::collections::VecDeque<(f64, DVec3, f64)>,
    last: Option<DVec3>,
    time: f64,
    way: f64,
    against: f64,
    along: f64,
}

impl Monitor {
    /// Way flown since the last [`Monitor::restart`], mm.
    pub fn way_mm(&self) -> f64 {
        self.way
    }

    /// The trail since the last [`Monitor::restart`], world mm.
    pub fn trail(&self) -> &[DVec3] {
        &self.trail
    }

    /// Begins anew, as after a turn or when the operator took over: what was flown so far may be flown again.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// Gives the flight another chance, remembering its trail.
    pub fn forgive(&mut self) {
        self.recent.clear();
        self.against = 0.0;
        self.along = 0.0;
    }

    /// Takes the camera's place after a step of `dt` seconds; tells of trouble once it is certain.
    pub fn follow(&mut self, at: DVec3, dt: f64, settings: &MonitorSettings) -> Option<Trouble> {
        let moved = self.last.map_or(DVec3::ZERO, |l| at - l);
        self.last = Some(at);
        self.time += dt;
        self.way += moved.length();
        if self.recent.back().is_none_or(|r| self.time - r.0 >= settings.window_s / 4.0) {
            self.recent.push_back((self.time, at, self.way));
        }
        while self.recent.len() > 1 && self.time - self.recent[1].0 >= settings.window_s {
            self.recent.pop_front();
        }
        if self.trail.last().is_none_or(|l| l.distance(at) >= TRAIL_STEP_MM) {
            self.trail.push(at);
        }
        self.revisit(at, moved, settings);
        if self.against > settings.revisited_mm {
            return Some(Trouble::TurnedBack);
        }
        if self.along > settings.revisited_mm {
            return Some(Trouble::Circling);
        }
        let &(since, place, way) = self.recent.front()?;
        let stuck = self.time - since >= settings.window_s
            && self.recent.iter().all(|r| r.1.distance(at) < settings.least_progress_mm)
            && place.distance(at) < settings.least_progress_mm;
        if !stuck {
            return None;
        }
        Some(if self.way - way > 3.0 * settings.least_progress_mm { Trouble::Dithering } else { Trouble::NoWayOn })
    }

    /// Adds up the way over visited ground, against and along the trail's sense; new ground forgets it.
    fn revisit(&mut self, at: DVec3, moved: DVec3, settings: &MonitorSettings) {
        let old = self.trail.len().saturating_sub((RECENT_MM / TRAIL_STEP_MM) as usize);
        let near = (1..old).map(|i| (i, self.trail[i].distance_squared(at))).min_by(|a, b| a.1.total_cmp(&b.1));
        match near {
            Some((i, d2)) if d2 < settings.visited_mm.powi(2) => {
                let sense = (self.trail[i] - self.trail[i - 1]).normalize_or_zero();
                let signed = moved.dot(sense);
                self.against += (-signed).max(0.0);
                self.along += signed.max(0.0);
            }
            _ => {
                let forget = moved.length();
                self.against = (self.against - forget).max(0.0);
                self.along = (self.along - forget).max(0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fly(path: impl Fn(f64) -> DVec3, seconds: f64) -> Option<(f64, Trouble)> {
        let mut m = Monitor::default();
        let dt = 1.0 / 120.0;
        (0..(seconds / dt) as usize).find_map(|n| {
            let t = n as f64 * dt;
            m.follow(path(t), dt, &MonitorSettings::default()).map(|v| (t, v))
        })
    }

    #[test]
    fn steady_flight_is_no_trouble() {
        assert_eq!(fly(|t| DVec3::new(30.0 * t, 10.0 * t.sin(), 0.0), 60.0), None);
        // A helix with neighbouring turns further apart than a lumen is wide.
        assert_eq!(fly(|t| DVec3::new(20.0 * t.cos(), 20.0 * t.sin(), 3.0 * t), 60.0), None);
    }

    #[test]
    fn each_trouble_is_told_in_time() {
        let hang = fly(|t| DVec3::X * 30.0 * t.min(3.0), 20.0).unwrap();
        assert_eq!(hang.1, Trouble::NoWayOn);
        assert!(hang.0 < 3.0 + 2.6, "within two and a half seconds: {}", hang.0);
        let dither =
            fly(|t| DVec3::X * (if t < 3.0 { 30.0 * t } else { 90.0 + 2.0 * (15.0 * t).sin() }), 20.0).unwrap();
        assert_eq!(dither.1, Trouble::Dithering);
        let back = fly(|t| DVec3::X * 30.0 * (5.0 - (t - 5.0).abs()), 20.0).unwrap();
        assert_eq!(back.1, Trouble::TurnedBack);
        assert!(back.0 < 5.0 + 3.0, "{}", back.0);
        let circle = fly(|t| DVec3::new(20.0 * t.cos(), 20.0 * t.sin(), 0.0), 20.0).unwrap();
        assert_eq!(circle.1, Trouble::Circling);
    }
}
