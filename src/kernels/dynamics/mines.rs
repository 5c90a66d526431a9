//! Mines: points laid behind the camera that repel it, so it does not turn back (paper, section 3.2).

use std::collections::VecDeque;

use super::settings::{not_negative, positive};
use crate::error::{Error, Result};
use glam::DVec3;

/// Maximum distance from the camera of a mine laid directly behind it, mm.
const BEHIND_MM: f64 = 3.0;

/// How mines are laid and how they push.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MineSettings {
    /// Number of most recent mines kept.
    pub kept: usize,
    /// Distance flown between two mines, mm.
    pub spacing_mm: f64,
    /// A mine farther than this from the camera does not push, mm.
    pub reach_mm: f64,
    /// Push of a mine at distance 0, as an acceleration, mm/s². It falls linearly to 0 at the reach.
    pub push: f64,
}

impl Default for MineSettings {
    fn default() -> Self {
        Self { kept: 12, spacing_mm: 8.0, reach_mm: 25.0, push: 60.0 }
    }
}

impl MineSettings {
    /// Checks the settings.
    ///
    /// # Errors
    /// Returns status 2 if a setting is out of range.
    pub fn check(&self) -> Result<()> {
        positive("mines.spacing_mm", self.spacing_mm)?;
        positive("mines.reach_mm", self.reach_mm)?;
        not_negative("mines.push", self.push)?;
        if self.kept > 100_000 {
            let why = format!("is {}", self.kept);
            return Err(Error::usage("mines.kept", why, "give a finite number up to 100000"));
        }
        Ok(())
    }
}

/// The mines kept so far, oldest first.
///
/// ```
/// # use colvis_kernels as colvis;
/// use colvis::dynamics::mines::{MineSettings, Mines};
/// use glam::DVec3;
///
/// let (settings, mut mines) = (MineSettings { kept: 3, spacing_mm: 8.0, ..MineSettings::default() }, Mines::default());
/// for x in 0..100 {
///     mines.follow(DVec3::X * f64::from(x), &settings);
/// }
/// assert_eq!(mines.len(), 3, "the last few are kept");
/// assert!(mines.push(DVec3::X * 99.0, &settings).x > 0.0, "and push on");
/// ```
#[derive(Clone, Debug, Default)]
pub struct Mines {
    points: VecDeque<DVec3>,
    last: Option<DVec3>,
}

impl Mines {
    /// Lays the mines of one step. Where mines `alone` drive the camera, the first one is laid at once, behind the `heading`.
    pub fn lay(&mut self, camera: DVec3, heading: DVec3, alone: bool, settings: &MineSettings) {
        if self.is_empty() && alone {
            self.lay_behind(camera, heading, settings);
        }
        self.follow(camera, settings);
    }

    /// Lets the camera set off again, along a new heading if there is one. Where mines `alone` drive the camera, the heading
    /// takes effect through a mine behind it.
    pub fn set_off(
        &mut self,
        camera: DVec3,
        heading: Option<DVec3>,
        clear: bool,
        alone: bool,
        settings: &MineSettings,
    ) {
        if clear {
            self.clear();
        }
        if let Some(heading) = heading.filter(|_| alone) {
            self.lay_behind(camera, heading, settings);
        }
    }

    /// Follows the camera (world mm). Every `spacing_mm` it lays a mine where the camera was at the last one, or at the first call.
    pub fn follow(&mut self, camera: DVec3, settings: &MineSettings) {
        match self.last {
            None => self.last = Some(camera),
            Some(last) if last.distance(camera) >= settings.spacing_mm => self.put(last, camera, settings),
            Some(_) => {}
        }
    }

    /// Lays a mine directly behind a camera (world mm) that sets off along the unit `heading`: the first mine of a flight
    /// driven by mines alone, or one that sends it in another direction.
    pub fn lay_behind(&mut self, camera: DVec3, heading: DVec3, settings: &MineSettings) {
        self.put(camera - heading * (0.5 * settings.spacing_mm).min(BEHIND_MM), camera, settings);
    }

    /// Lays a mine at `place`. The next one follows once the camera is `spacing_mm` away from its position now.
    fn put(&mut self, place: DVec3, camera: DVec3, settings: &MineSettings) {
        self.points.push_back(place);
        self.last = Some(camera);
        while self.points.len() > settings.kept {
            self.points.pop_front();
        }
    }

    /// Removes all mines, for example after a turn.
    pub fn clear(&mut self) {
        self.points.clear();
        self.last = None;
    }

    /// Iterates over the mines' world positions, mm, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.points.iter().copied()
    }

    /// Returns the number of mines.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Returns true if there are no mines.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Returns the acceleration (world mm/s²) that the mines exert at a world point (mm).
    ///
    /// Within its reach, each mine contributes the potential `push · reach/2 · (1 − d/reach)²`.
    pub fn push(&self, at: DVec3, settings: &MineSettings) -> DVec3 {
        self.iter()
            .map(|m| {
                let away = at - m;
                let d = away.length();
                away.normalize_or_zero() * (settings.push * (1.0 - d / settings.reach_mm).max(0.0))
            })
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn laid_behind_and_the_last_few_kept() {
        let s = MineSettings { kept: 3, spacing_mm: 5.0, ..MineSettings::default() };
        let mut m = Mines::default();
        for x in 0..100 {
            m.follow(DVec3::X * f64::from(x), &s);
        }
        let xs: Vec<f64> = m.iter().map(|p| p.x).collect();
        assert_eq!(xs, [80.0, 85.0, 90.0]);
        assert!(m.push(DVec3::X * 99.0, &s).x > 0.0, "they push on");
        assert_eq!(m.push(DVec3::X * 300.0, &s), DVec3::ZERO);
        assert!(m.push(DVec3::X * 90.0, &s).is_finite(), "on a mine");
    }

    #[test]
    fn the_first_one_is_laid_behind_and_drives() {
        let s = MineSettings { kept: 2, spacing_mm: 4.0, ..MineSettings::default() };
        let mut m = Mines::default();
        m.lay_behind(DVec3::ZERO, DVec3::Y, &s);
        let push = m.push(DVec3::ZERO, &s);
        assert!(push.y > 0.8 * s.push && push.x == 0.0 && push.z == 0.0, "{push}");
        for y in 0..20 {
            m.follow(DVec3::Y * f64::from(y), &s);
        }
        assert_eq!(m.iter().map(|p| p.y).collect::<Vec<_>>(), [8.0, 12.0], "then as always");
        m.lay_behind(DVec3::Y, DVec3::ZERO, &MineSettings { kept: 0, ..s });
        assert!(m.is_empty(), "none is kept where none may be");
    }

    #[test]
    fn push_is_the_potentials_slope() {
        let s = MineSettings::default();
        let mut m = Mines::default();
        m.follow(DVec3::ZERO, &s);
        m.follow(DVec3::X * 10.0, &s);
        let v = |p: DVec3| s.push * s.reach_mm / 2.0 * (1.0 - p.length() / s.reach_mm).max(0.0).powi(2);
        let (p, h) = (DVec3::new(4.0, -3.0, 7.0), 1e-5);
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let slope = (v(p + axis * h) - v(p - axis * h)) / (2.0 * h);
            assert!((m.push(p, &s).dot(axis) + slope).abs() < 1e-6);
        }
    }
}
