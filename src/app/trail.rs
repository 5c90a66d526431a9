//! Where a flight has been and what it looked at, coarsely: for coverage, and for going back.

use glam::DVec3;

use crate::dynamics::Attitude;

/// A view is kept when the camera has come so far from the last one, mm, …
const STEP_MM: f64 = 2.0;
/// … or has turned so much, as the cosine of the angle: 10°.
const TURN: f64 = 0.984_807_753_012_208;

/// The views of a flight, in order, with the way flown until each.
#[derive(Clone, Debug, Default)]
pub struct Trail {
    views: Vec<(DVec3, Attitude)>,
    along: Vec<f64>,
}

impl Trail {
    /// Takes the pose after a step.
    pub fn follow(&mut self, position: DVec3, attitude: Attitude) {
        let Some(last) = self.views.last() else {
            self.views.push((position, attitude));
            self.along.push(0.0);
            return;
        };
        let moved = last.0.distance(position);
        if moved >= STEP_MM || last.1.forward.dot(attitude.forward) < TURN || last.1.up.dot(attitude.up) < TURN {
            // A jump is no way.
            let way = if moved < 10.0 * STEP_MM { moved } else { 0.0 };
            self.along.push(self.along[self.along.len() - 1] + way);
            self.views.push((position, attitude));
        }
    }

    /// The views, in order.
    pub fn views(&self) -> &[(DVec3, Attitude)] {
        &self.views
    }

    /// The view after `mm` of the way flown; none if it was not flown so far.
    pub fn at(&self, mm: f64) -> Option<(DVec3, Attitude)> {
        let last = *self.along.last()?;
        (mm <= last + STEP_MM).then(|| self.views[self.along.partition_point(|&a| a < mm).min(self.views.len() - 1)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_back_is_known_and_no_further() {
        let mut t = Trail::default();
        assert!(t.at(0.0).is_none());
        let look = Attitude::new(DVec3::X, DVec3::Z);
        for n in 0..1000 {
            t.follow(DVec3::X * 0.1 * f64::from(n), look);
        }
        assert!(t.views().len() > 40 && t.views().len() < 60);
        assert!((t.at(50.0).unwrap().0.x - 50.0).abs() < 3.0);
        assert!(t.at(150.0).is_none());
        t.follow(DVec3::X * 99.9, Attitude::new(DVec3::Y, DVec3::Z));
        assert_eq!(t.views().last().unwrap().1.forward, DVec3::Y, "a turn on the spot is a view of its own");
    }
}
