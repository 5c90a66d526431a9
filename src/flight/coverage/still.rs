//! Views in addition to those of a flight's trail: what is looked at while nothing moves.

use glam::DVec3;

use super::live::LiveCoverage;
use crate::components::still::{StillView, StillViews};
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::progress::Progress;
use crate::space::PreparedVolume;

/// Maximum number of views that are taken within a frame; more are taken in the background.
pub const VIEWS_AT_ONCE: usize = 8;

impl LiveCoverage {
    /// Takes all views that have not been taken, at a time of the flight, s: those of an earlier session, the trail, and those of
    /// this session beside the trail.
    ///
    /// An earlier session must be taken before the flight: otherwise its movements would count as flown from the camera's current
    /// position, and the wall around the camera as passed. If the flight has begun without it, the coverage is computed again.
    ///
    /// # Errors
    /// Returns status 4 if interrupted: then it has taken some of them.
    pub fn see(
        &mut self,
        volume: &PreparedVolume,
        trail: &[(DVec3, Attitude)],
        still: &StillViews,
        seconds: f64,
        progress: &Progress,
    ) -> Result<()> {
        if self.has_flown() && self.looked < still.earlier().len() {
            *self = self.afresh();
        }
        self.look_until(volume, still.earlier(), seconds, progress)?;
        self.catch_up(volume, trail, seconds, progress)?;
        self.look_until(volume, still.views(), seconds, progress)
    }

    fn look_until(
        &mut self,
        volume: &PreparedVolume,
        views: &[StillView],
        seconds: f64,
        progress: &Progress,
    ) -> Result<()> {
        while self.looked < views.len() {
            progress.check()?;
            self.look_on(volume, &views[self.looked..=self.looked], seconds);
        }
        Ok(())
    }

    /// Takes all views that were shown beside the trail and have not been taken, at a time of the flight, s. Returns true if there was
    /// one.
    pub fn look(&mut self, volume: &PreparedVolume, views: &[StillView], seconds: f64) -> bool {
        let more = views.get(self.looked..).unwrap_or(&[]);
        self.look_on(volume, more, seconds);
        !more.is_empty()
    }

    /// Takes these views, which come after those that were [taken](Self::looked), at a time of the flight, s.
    pub fn look_on(&mut self, volume: &PreparedVolume, more: &[StillView], seconds: f64) {
        let volume = &self.scan(volume).clone();
        let fov_degrees = self.fov_degrees();
        for view in more {
            self.finish(volume);
            self.looked += 1;
            // A picture wider than a flat one can be counts as the flight's usual one.
            self.set_fov(fov_degrees);
            self.set_fov(view.fov_degrees);
            if let Some(before) = self.last {
                let mm = before.distance(view.position);
                self.moved(mm);
                if !self.has_flown() {
                    self.flew(mm);
                }
            }
            self.begin(&(view.position, view.attitude), seconds);
            self.finish(volume);
        }
        self.set_fov(fov_degrees);
    }

    /// Returns how many of the views beside the trail were taken.
    pub fn looked(&self) -> usize {
        self.looked
    }

    /// Adds time that the flight's clock does not count, s, so that painted wall fades while nothing moves.
    pub fn rest(&mut self, seconds: f32) {
        self.rested_s += seconds.max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::fields::lumen;
    use crate::render::camera::Perspective;
    use crate::testing::Room;

    #[test]
    fn a_view_beside_the_trail_counts_with_its_own_angle() {
        let room = Room::new([30, 90, 24]);
        let volume = room.scan();
        let gas = Arc::new(lumen::gas_at(volume.voxels(), room.centre(), &Progress::new()).unwrap().unwrap());
        let mut live = LiveCoverage::of(&volume, &gas, &Progress::new()).unwrap();
        let attitude = Attitude::new(DVec3::Y, DVec3::Z);
        let views = [60.0, 120.0].map(|fov_degrees| StillView { position: room.centre(), attitude, fov_degrees });
        for n in 1..=2 {
            assert!(live.looked() < n && live.look(&volume, &views[..n], 0.0) && live.looked() == n);
            let camera = Perspective::new(views[n - 1].fov_degrees).unwrap();
            let sights =
                live.wall().seen(&volume, &[(room.centre(), attitude)], &camera, false, &Progress::new()).unwrap();
            let truth = live.wall().coverage(&sights).one_way;
            assert!((live.share() - truth).abs() < 0.01, "{} at {}: {truth}", live.share(), views[n - 1].fov_degrees);
        }
        assert!(!live.look(&volume, &views, 0.0) && live.fov_degrees() == 90.0);
        let nowhere = StillView { position: DVec3::NAN, ..views[0] };
        live.look(&volume, &[views[0], views[1], nowhere], f64::NAN);
        // A picture that is wider than a flat one can be shows what the flight's pictures do.
        let sees = |fov_degrees: f64| {
            let mut live = live.afresh();
            live.look(&volume, &[views[1], StillView { fov_degrees, ..views[0] }], 0.0);
            assert_eq!(live.looked(), 2);
            live.share()
        };
        assert_eq!(sees(200.0), sees(90.0));
    }

    /// Fails if the ways of an earlier sitting count as flown from where the camera is now.
    #[test]
    fn what_is_around_the_camera_is_not_passed_because_of_an_earlier_sitting() {
        let room = Room::new([20, 400, 20]);
        let volume = room.scan();
        let gas = Arc::new(lumen::gas_at(volume.voxels(), room.centre(), &Progress::new()).unwrap().unwrap());
        let mut live = LiveCoverage::of(&volume, &gas, &Progress::new()).unwrap();
        live.set_fov(20.0);
        let at = |y: f64| (DVec3::new(10.0, y, 10.0), Attitude::new(DVec3::X, DVec3::Z));
        let still = |y: f64| StillView { position: at(y).0, attitude: at(y).1, fov_degrees: 20.0 };
        let earlier: Vec<StillView> = (5..=150).map(|n| still(2.0 * f64::from(n))).collect();
        let mut views: StillViews = earlier.into_iter().collect();
        let trail: Vec<_> = (150..=155).map(|n| at(2.0 * f64::from(n))).collect();
        // At rest here and there in this sitting.
        (0..60).for_each(|n| views.add(still(if n % 2 == 0 { 300.0 } else { 308.0 })));
        let around = |live: &LiveCoverage, from: f64, to: f64| {
            let wall = live.wall();
            let missed = live.missed();
            (0..wall.len()).any(|n| (from..to).contains(&wall.centroid(n).y) && missed[n])
        };
        let mut later = live.clone();
        live.see(&volume, &trail, &views, 0.0, &Progress::new()).unwrap();
        assert!(around(&live, 20.0, 200.0) && !around(&live, 305.0, 330.0));
        // The same if the flight had begun before they were known.
        later.catch_up(&volume, &trail[..1], 0.0, &Progress::new()).unwrap();
        later.see(&volume, &trail, &views, 0.0, &Progress::new()).unwrap();
        assert_eq!((later.missed(), later.share()), (live.missed(), live.share()));
        assert_eq!((later.looked(), live.looked()), (views.views().len(), views.views().len()));
    }
}
