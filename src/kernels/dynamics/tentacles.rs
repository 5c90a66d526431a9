//! Tentacles: sensory rays in all directions that measure the distance to the wall (paper, section 3.2).

use glam::DVec3;

use super::settings::{not_negative, positive};
use crate::dynamics::mines::{MineSettings, Mines};
use crate::error::{Error, Result};
use crate::math::sphere;

/// What propels a camera with tentacles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Drive {
    /// A thrust at cruise speed in the direction that the tentacles find open. Mines only steer, and a goal in direct
    /// view attracts the camera.
    #[default]
    Thrust,
    /// Only the forces of walls and mines, as in the paper's section 3.2: *mines forcing the camera to advance*. There is
    /// no thrust, no cruise speed and no attraction by the goal; drag alone limits the speed.
    Mines,
}

/// Settings for steering by tentacles.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TentacleSettings {
    /// Number of sensory rays, at least 3.
    pub count: usize,
    /// What propels the camera.
    pub drive: Drive,
    /// Length of a ray that meets no wall, mm.
    pub reach_mm: f64,
    /// Distance within which the wall repels, mm: the paper's `p`.
    pub wall_mm: f64,
    /// Strength of the wall's repulsion, mm/s². The paper's `C_s` is this value times `p`, for a body of unit mass.
    pub wall_push: f64,
    /// Speed along a straight lumen, mm/s. If mines drive, it is only used to measure progress.
    pub cruise_mm_s: f64,
    /// How strongly the current heading is preferred: the weight of a direction is `((1 + cos)/2)^agreement`.
    pub agreement: f64,
    /// Half-width of the cone around a mine in which directions lose weight, rad.
    pub mine_cone: f64,
}

impl Default for TentacleSettings {
    fn default() -> Self {
        Self {
            count: 128,
            drive: Drive::Thrust,
            reach_mm: 150.0,
            wall_mm: 10.0,
            wall_push: 60.0,
            cruise_mm_s: 30.0,
            agreement: 2.0,
            mine_cone: 0.6,
        }
    }
}

impl TentacleSettings {
    /// Checks the settings.
    ///
    /// # Errors
    /// Returns status 2 if a setting is out of range.
    pub fn check(&self) -> Result<()> {
        for (name, value) in [
            ("tentacles.reach_mm", self.reach_mm),
            ("tentacles.wall_mm", self.wall_mm),
            ("tentacles.cruise_mm_s", self.cruise_mm_s),
            ("tentacles.mine_cone", self.mine_cone),
        ] {
            positive(name, value)?;
        }
        not_negative("tentacles.wall_push", self.wall_push)?;
        not_negative("tentacles.agreement", self.agreement)?;
        if (3..=4096).contains(&self.count) {
            Ok(())
        } else {
            let why = format!("is {}", self.count);
            Err(Error::usage("tentacles.count", why, "give a finite number from 3 to 4096"))
        }
    }
}

/// Returns `count` unit vectors spread evenly over the sphere.
///
/// They form a Fibonacci lattice (González, *Measurement of areas on a sphere using Fibonacci and latitude–longitude
/// lattices*, 2010), which is point-symmetric in its statistics and the same on every call.
///
/// ```
/// # use colvis_kernels as colvis;
/// use colvis::dynamics::tentacles::directions;
///
/// let all = directions(128);
/// assert!(all.len() == 128 && all.iter().all(|d| (d.length() - 1.0).abs() < 1e-12));
/// let mean = all.iter().sum::<glam::DVec3>() / 128.0;
/// assert!(mean.length() < 0.01, "no side is preferred");
/// ```
pub fn directions(count: usize) -> Vec<DVec3> {
    sphere::directions(count).collect()
}

/// Returns `count` unit vectors spread evenly over the circle in the plane z = 0: the tentacles for a drawn lumen.
pub fn circle(count: usize) -> Vec<DVec3> {
    let step = std::f64::consts::TAU / count.max(1) as f64;
    (0..count)
        .map(|i| {
            let (s, c) = (step * i as f64).sin_cos();
            DVec3::new(c, s, 0.0)
        })
        .collect()
}

/// The steering that results from the tentacles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steering {
    /// Acceleration of the guide's thrust, world mm/s²: along the path ahead, sized to balance the drag at cruise speed.
    /// Zero if mines drive.
    pub thrust: DVec3,
    /// Limit on thrust and mines together, mm/s²: the value that drag balances at cruise speed. Infinite if mines drive.
    pub limit: f64,
    /// Acceleration away from near walls, world mm/s².
    pub wall: DVec3,
    /// Unit vector of the path ahead; zero if every direction is closed.
    pub direction: DVec3,
    /// Unit vector to where the lumen opens furthest along the path: where to look. Zero if every direction is closed.
    pub look: DVec3,
}

/// Computes the steering from the tentacles (`directions` and their `lengths` in mm) at the world position `at` (mm).
///
/// `heading` is the current unit heading (zero if there is none yet) and `drag_per_s` the drag `k_t`. `trail` holds
/// further ground that must not be flown again, and the weight that a direction over it still has, 0 to 1.
///
/// The direction ahead is the mean of all directions, weighted by length², by agreement with the heading, and against
/// mines. The wall's repulsion is the slope of the paper's `C_s (p/D_s − 1)²` with `C_s = wall_push · p`, where each
/// tentacle counts as a `D_s` along its own direction.
pub fn steer(
    (directions, lengths): (&[DVec3], &[f64]),
    at: DVec3,
    heading: DVec3,
    mines: Option<(&Mines, &MineSettings)>,
    trail: (&[DVec3], f64),
    settings: &TentacleSettings,
    drag_per_s: f64,
) -> Steering {
    let mut pull = DVec3::ZERO;
    let mut look = DVec3::ZERO;
    let mut wall = DVec3::ZERO;
    let p = settings.wall_mm;
    for (&d, &length) in directions.iter().zip(lengths) {
        let agrees =
            if heading == DVec3::ZERO { 1.0 } else { ((1.0 + heading.dot(d)) / 2.0).max(0.0).powf(settings.agreement) };
        let open = mines.map_or(1.0, |(m, _)| openness(d, length, at, m.iter(), settings.mine_cone))
            * openness(d, length, at, trail.0.iter().copied(), settings.mine_cone).max(trail.1);
        pull += d * (length * length * agrees * open);
        // A higher power picks the deepest opening instead of the mean of all.
        look += d * (length.powi(4) * agrees * open);
        if length < p {
            // The slope grows without bound at the wall. The body's radius keeps the length away from 0; this floor does
            // so for scenes with a body without a radius.
            let l = length.max(0.25);
            wall -= d * ((p / l - 1.0) * (p / l) * (p / l) / p);
        }
    }
    let direction = pull.normalize_or_zero();
    let n = directions.len().max(1) as f64;
    // Slow down where the path bends away from the heading, so that the view can follow.
    let pace = if heading == DVec3::ZERO { 1.0 } else { 0.3 + 0.7 * heading.dot(direction).max(0.0) };
    let cruise = settings.cruise_mm_s * drag_per_s;
    let (thrust, limit) = match settings.drive {
        Drive::Thrust => (direction * (cruise * pace), cruise),
        Drive::Mines => (DVec3::ZERO, f64::INFINITY),
    };
    Steering {
        thrust,
        limit,
        wall: wall * (2.0 * p * settings.wall_push / n),
        direction,
        look: look.normalize_or_zero(),
    }
}

/// Returns the thrust and the unit direction straight towards a nearby goal (world mm).
///
/// The thrust gives full cruise speed until 15 mm before the goal and decreases from there. Returns `None` beyond 60 mm,
/// at the goal, or if mines drive.
pub fn approach(at: DVec3, goal: DVec3, settings: &TentacleSettings, drag_per_s: f64) -> Option<(DVec3, DVec3)> {
    let to = goal - at;
    let distance = to.length();
    if settings.drive == Drive::Mines || !(1e-6..60.0).contains(&distance) {
        return None;
    }
    let direction = to / distance;
    Some((direction * (settings.cruise_mm_s * drag_per_s * (distance / 15.0).min(1.0)), direction))
}

/// Returns the weight of a direction against mines, 0 to 1: near 0 if it points at a mine that the tentacle could touch.
fn openness(direction: DVec3, length: f64, at: DVec3, mines: impl Iterator<Item = DVec3>, cone: f64) -> f64 {
    let mut open = 1.0;
    for m in mines {
        let to = m - at;
        let distance = to.length();
        if distance > length + 10.0 || distance < 1e-6 {
            continue;
        }
        let angle = direction.angle_between(to);
        open *= 1.0 - (-0.5 * (angle / cone).powi(2)).exp();
    }
    open
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_spread_evenly() {
        for n in [3, 64, 1000] {
            let d = directions(n);
            let mean: DVec3 = d.iter().copied().sum::<DVec3>() / n as f64;
            assert!(d.iter().all(|v| (v.length() - 1.0).abs() < 1e-12));
            assert!(mean.length() < 0.35 / (n as f64).sqrt() + 0.1, "{n}: {mean}");
        }
    }

    /// In a straight tube the path ahead follows it, the wall pushes to the middle, and a mine behind decides the direction.
    #[test]
    fn follows_a_tube() {
        let s = TentacleSettings::default();
        let d = directions(256);
        let at = DVec3::new(3.0, 0.0, 0.0);
        let lengths: Vec<f64> = d
            .iter()
            .map(|d| {
                // Ray from `at` to the cylinder of radius 8 around z.
                let (a, b) = (d.x * d.x + d.y * d.y, at.x * d.x + at.y * d.y);
                let t = (-b + (b * b - a * (at.x * at.x + at.y * at.y - 64.0)).sqrt()) / a.max(1e-12);
                t.min(s.reach_mm)
            })
            .collect();
        let st = steer((&d, &lengths), at, DVec3::Z, None, (&[], 0.0), &s, 6.0);
        assert!(st.direction.z > 0.95 && st.wall.x < 0.0 && st.wall.z.abs() < 0.3 * st.wall.x.abs());
        let mut mines = Mines::default();
        let ms = MineSettings::default();
        mines.follow(DVec3::new(0.0, 0.0, 10.0), &ms);
        mines.follow(DVec3::new(0.0, 0.0, 20.0), &ms);
        let st = steer((&d, &lengths), at, DVec3::ZERO, Some((&mines, &ms)), (&[], 0.0), &s, 6.0);
        assert!(st.direction.z < -0.5, "away from the mine: {}", st.direction);
    }

    #[test]
    fn three_tentacles_and_walls_at_distance_zero_stay_finite() {
        let s = TentacleSettings { count: 3, ..TentacleSettings::default() };
        let d = directions(3);
        for l in [[0.0; 3], [0.0, 150.0, 1e-12], [150.0; 3]] {
            let st = steer((&d, &l), DVec3::ZERO, DVec3::X, None, (&[], 0.0), &s, 6.0);
            assert!(st.thrust.is_finite() && st.wall.is_finite());
        }
    }
}
