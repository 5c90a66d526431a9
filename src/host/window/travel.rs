//! Animated moves of the camera to a place that it should look at.

use std::time::{Duration, Instant};

use glam::DVec3;

use crate::components::camera::Pose;
use crate::dynamics::Attitude;

/// Viewing distance, mm: a haustrum fills the picture.
const GOOD_MM: f64 = 25.0;
/// Duration of the move.
const TAKES: Duration = Duration::from_millis(700);

/// A straight move of the camera towards the place to look at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Travel {
    from: Pose,
    /// World, mm.
    to: DVec3,
    /// Unit vector.
    forward: DVec3,
    begun: Instant,
}

impl Travel {
    /// Creates a move from a pose to a good viewing distance of a place (world, mm). A camera that is nearer stays there and
    /// turns.
    pub(crate) fn to_look_at(from: Pose, place: DVec3, now: Instant) -> Self {
        let direction = place - from.position;
        let forward = direction.try_normalize().unwrap_or(from.attitude.forward);
        let to = from.position + forward * (direction.length() - GOOD_MM).max(0.0);
        Self { from, to, forward, begun: now }
    }

    /// Returns the pose at a time, and true if the move is over. The easing is slow at both ends: 3 t² − 2 t³.
    pub(crate) fn at(&self, now: Instant) -> (Pose, bool) {
        let t = (now.saturating_duration_since(self.begun).as_secs_f64() / TAKES.as_secs_f64()).min(1.0);
        let share = t * t * (3.0 - 2.0 * t);
        let position = self.from.position.lerp(self.to, share);
        let mut attitude = self.from.attitude;
        let axis = attitude.forward.cross(self.forward);
        let angle = attitude.forward.angle_between(self.forward);
        if let Some(axis) = axis.try_normalize().filter(|_| angle.is_finite()) {
            attitude.rotate(axis, angle * share);
        }
        (Pose { position, attitude: Attitude::new(attitude.forward, attitude.up) }, t >= 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_ends_at_a_good_distance_looking_at_the_place() {
        let from = Pose { position: DVec3::new(1.0, 2.0, 3.0), attitude: Attitude::new(DVec3::Y, DVec3::Z) };
        let now = Instant::now();
        for (place, left) in
            [(DVec3::new(61.0, 2.0, 3.0), GOOD_MM), (DVec3::new(1.0, 12.0, 3.0), 10.0), (from.position, 0.0)]
        {
            let travel = Travel::to_look_at(from, place, now);
            assert!(travel.at(now).0.position.distance(from.position) < 1e-12 && !travel.at(now).1);
            let (pose, over) = travel.at(now + TAKES);
            assert!(over && (pose.position.distance(place) - left).abs() < 1e-9);
            assert!(left == 0.0 || (place - pose.position).normalize().distance(pose.attitude.forward) < 1e-9);
        }
    }
}
