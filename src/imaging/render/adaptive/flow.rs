//! Image flow: how fast a picture moves.

use glam::DVec3;

use crate::render::{CameraRay, View};
use crate::space::PreparedVolume;
use crate::space::first_crossing;

/// Number of tracked points along each side of the picture.
const SIDE: usize = 5;
/// Assumed distance where there is no wall, mm.
const FAR_MM: f64 = 1e6;

/// A few points of the wall that a view shows, to be found again in the next view.
#[derive(Clone, Debug)]
pub(crate) struct Probes {
    view: View,
    /// Positions in the world, mm, and in the picture, pixels.
    points: Vec<(DVec3, [f64; 2])>,
}

impl Probes {
    /// Tracks what `view` shows of `volume`: one exact ray for each of 25 points at which the camera shows anything.
    pub(crate) fn new(volume: &PreparedVolume, view: &View) -> Self {
        let place = |n: usize, length: usize| (n as f64 + 0.5) / SIDE as f64 * length as f64;
        let point = |n: usize| {
            let at = [place(n % SIDE, view.width()), place(n / SIDE, view.height())];
            let CameraRay { origin, direction } = view.ray_at(at[0], at[1])?;
            let depth = first_crossing(volume, origin, direction, FAR_MM).unwrap_or(FAR_MM);
            Some((origin + direction * depth, at))
        };
        Self { view: view.clone(), points: (0..SIDE * SIDE).filter_map(point).collect() }
    }

    /// Returns the view in which the points were seen.
    pub(crate) fn view(&self) -> &View {
        &self.view
    }

    /// Returns by how many pixels the picture moves from that view to the view `to`. A quarter of the points move farther.
    ///
    /// The flow is infinite (a cut) if the points are not visible, or if the picture has another size or camera.
    pub(crate) fn flow(&self, to: &View) -> f64 {
        if *to == self.view {
            return 0.0;
        }
        let size = |v: &View| (v.width(), v.height());
        if size(to) != size(&self.view) || to.camera() != self.view.camera() || self.points.is_empty() {
            return f64::INFINITY;
        }
        let mut moved: Vec<f64> = self.points.iter().map(|&(p, at)| distance(to, p, at)).collect();
        moved.sort_by(f64::total_cmp);
        moved[moved.len() * 3 / 4]
    }
}

/// Returns the distance in pixels between `at` and the position where `view` shows `point`; infinite if it does not show it.
fn distance(view: &View, point: DVec3, at: [f64; 2]) -> f64 {
    if point == view.position() {
        // A camera right at the wall sees it where it was.
        return 0.0;
    }
    view.project(point).map_or(f64::INFINITY, |[x, y]| (x - at[0]).hypot(y - at[1]))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DQuat};

    use super::*;
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};

    /// A wall at x = 50 mm.
    fn wall() -> PreparedVolume {
        let grid = Grid::new([64, 64, 64], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..64 * 64 * 64).map(|n| if n % 64 > 50 { 0 } else { -1000 }).collect();
        PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
    }

    fn view(at: DVec3, forward: DVec3) -> View {
        View::new(at, forward, DVec3::Z, 90.0, 200, 200).unwrap()
    }

    #[test]
    fn it_is_that_of_the_wall_that_is_seen() {
        let (volume, at) = (wall(), DVec3::new(30.0, 32.0, 32.0));
        let probes = Probes::new(&volume, &view(at, DVec3::X));
        assert_eq!(probes.flow(&view(at, DVec3::X)), 0.0);
        // A pixel covers 0.01 of the distance of about 20.3 mm.
        let sideways = probes.flow(&view(at + DVec3::Y * 2.0, DVec3::X));
        assert!((sideways - 200.0 / 20.3).abs() < 0.5, "{sideways}");
        let forward = probes.flow(&view(at + DVec3::X, DVec3::X));
        assert!(forward > 2.0 && forward < sideways, "{forward}");
        let turned = probes.flow(&view(at, DQuat::from_rotation_z(0.1) * DVec3::X));
        assert!(turned > 9.0 && turned < 20.0, "{turned}");
    }

    #[test]
    fn cuts_are_infinite() {
        let (volume, at) = (wall(), DVec3::new(30.0, 32.0, 32.0));
        let v = view(at, DVec3::X);
        let probes = Probes::new(&volume, &v);
        assert_eq!(probes.flow(&view(at, DVec3::NEG_X)), f64::INFINITY);
        assert_eq!(probes.flow(&v.resized(201, 200)), f64::INFINITY);
        // Nothing is NaN outside and within the wall.
        for from in [DVec3::splat(-1e3), DVec3::new(60.0, 32.0, 32.0), DVec3::splat(1e8)] {
            let probes = Probes::new(&volume, &view(from, DVec3::X));
            assert!(!probes.flow(&view(from + DVec3::Y, DVec3::X)).is_nan());
        }
    }
}
