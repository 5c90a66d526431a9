//! Views of the camera in addition to those of the trail: shown while nothing moved, or in an earlier session.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::dynamics::Attitude;

/// Maximum number of views.
const MOST: usize = 50_000;

/// A view that was shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StillView {
    /// World, mm.
    pub position: DVec3,
    /// View direction and up.
    pub attitude: Attitude,
    /// View angle, degrees.
    pub fov_degrees: f64,
}

/// Views that count as seen, in the order in which they were shown. A window adds them; they have no effect on the flight.
#[derive(Component, Clone, Debug, Default)]
pub struct StillViews {
    views: Vec<StillView>,
    earlier: usize,
}

impl StillViews {
    /// Adds a view, unless there are too many.
    pub fn add(&mut self, view: StillView) {
        if self.views.len() < MOST && view.position.is_finite() {
            self.views.push(view);
        }
    }

    /// Returns all views.
    pub fn views(&self) -> &[StillView] {
        &self.views
    }

    /// Returns those of an earlier session, which come first.
    pub fn earlier(&self) -> &[StillView] {
        &self.views[..self.earlier]
    }
}

/// The views of an earlier session.
impl FromIterator<StillView> for StillViews {
    fn from_iter<T: IntoIterator<Item = StillView>>(views: T) -> Self {
        let mut all = Self::default();
        views.into_iter().for_each(|v| all.add(v));
        all.earlier = all.views.len();
        all
    }
}
