//! Views beside those of a flight's trail: what is looked at while nothing moves.

use super::live::LiveCoverage;
use crate::components::still::StillView;
use crate::space::PreparedVolume;

impl LiveCoverage {
    /// Takes all views that were shown beside the trail and have not been taken, at a time of the flight, s. Returns true if there was
    /// one.
    pub fn look(&mut self, volume: &PreparedVolume, views: &[StillView], seconds: f64) -> bool {
        let volume = &self.scan(volume).clone();
        let fov_degrees = self.fov_degrees();
        let from = self.looked.min(views.len());
        for view in &views[from..] {
            self.finish(volume);
            self.looked += 1;
            self.set_fov(view.fov_degrees);
            if let Some(before) = self.last {
                self.moved(before.distance(view.position));
            }
            self.begin(&(view.position, view.attitude), seconds);
            self.finish(volume);
        }
        self.set_fov(fov_degrees);
        from < views.len()
    }

    /// True if not all of so many views were taken.
    pub fn has_to_look(&self, views: usize) -> bool {
        self.looked < views
    }

    /// Lets time go by that the flight's clock does not count, s: what is painted fades although nothing moves.
    pub fn rest(&mut self, seconds: f32) {
        self.rested_s += seconds.max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::dynamics::Attitude;
    use crate::fields::lumen;
    use crate::progress::Progress;
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
            assert!(live.has_to_look(n) && live.look(&volume, &views[..n], 0.0) && !live.has_to_look(n));
            let camera = Perspective::new(views[n - 1].fov_degrees).unwrap();
            let sights = live.wall().seen(&volume, &[(room.centre(), attitude)], &camera, false);
            let truth = live.wall().coverage(&sights).one_way;
            assert!((live.share() - truth).abs() < 0.01, "{} at {}: {truth}", live.share(), views[n - 1].fov_degrees);
        }
        assert!(!live.look(&volume, &views, 0.0) && live.fov_degrees() == 90.0);
        let nowhere = StillView { position: DVec3::NAN, ..views[0] };
        live.look(&volume, &[views[0], views[1], nowhere], f64::NAN);
    }
}
