//! Directions on the sphere: Fibonacci lattices, which turn by the golden angle from one direction to the next.

use std::f64::consts::PI;

use glam::DVec3;

/// Returns `count` unit directions, evenly spread over the sphere.
pub fn directions(count: usize) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |n| {
        let z = 1.0 - (2.0 * n as f64 + 1.0) / count as f64;
        let (sin, cos, r) = round(n, z);
        DVec3::new(r * cos, r * sin, z)
    })
}

/// Returns `count` unit directions, evenly spread over the half sphere around the unit vector `axis`, the nearest to it first.
pub fn half_directions(count: usize, axis: DVec3) -> impl Iterator<Item = DVec3> {
    let (u, v) = axis.any_orthonormal_pair();
    (0..count).map(move |n| {
        let height = 1.0 - (n as f64 + 0.5) / count as f64;
        let (sin, cos, r) = round(n, height);
        axis * height + (u * cos + v * sin) * r
    })
}

/// Returns sine and cosine of the angle around the axis of direction `n`, and its distance from the axis at a height.
fn round(n: usize, height: f64) -> (f64, f64, f64) {
    let golden = PI * (3.0 - 5f64.sqrt());
    let (sin, cos) = (golden * n as f64).sin_cos();
    (sin, cos, (1.0 - height * height).max(0.0).sqrt())
}
