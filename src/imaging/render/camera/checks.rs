//! What every camera's tests check.

use glam::DVec2;

use super::Camera;

/// Points of an image with the given width divided by its height, from edge to edge.
fn points(aspect: f64) -> impl Iterator<Item = DVec2> {
    let half = DVec2::new(aspect, 1.0) / aspect.min(1.0);
    (0..41).flat_map(move |y| {
        (0..41).map(move |x| DVec2::new(f64::from(x) / 20.0 - 1.0, f64::from(y) / 20.0 - 1.0) * half)
    })
}

/// A place along a ray is seen at the point that the ray goes through.
pub(super) fn check_round_trip(camera: &dyn Camera, aspect: f64) {
    let mut shown = 0;
    for at in points(aspect) {
        let Some(ray) = camera.ray(at * 0.999) else { continue };
        shown += 1;
        assert!((ray.direction.length() - 1.0).abs() < 1e-12, "{at}");
        let found = camera.project(ray.direction * 23.0).unwrap();
        assert!((found - at * 0.999).length() < 1e-7, "{camera:?}: {at} {found}");
    }
    assert!(shown > 500, "{shown}");
}

/// Directions turn no faster than the camera says, and in places nearly as fast.
pub(super) fn check_turn(camera: &dyn Camera, aspect: f64) {
    let most = camera.most_turn().unwrap();
    let step = 1e-5;
    let mut fastest = 0.0f64;
    for at in points(aspect) {
        for to in (0..8).map(|n| DVec2::from_angle(f64::from(n) * 0.4) * step) {
            let [Some(a), Some(b)] = [at, at + to].map(|p| camera.ray(p)) else { continue };
            fastest = fastest.max((a.direction - b.direction).length() / step);
        }
    }
    assert!(fastest <= most * (1.0 + 1e-6), "{camera:?}: {fastest}, not {most}");
    assert!(fastest >= 0.9 * most, "{camera:?}: {most} is far above {fastest}");
}
