//! Frames along a curve with the least possible rotation about it.

use glam::DVec3;

use crate::dynamics::Attitude;
use crate::math::reflection::doubly_reflected;

/// Returns the unit up vectors of a rotation-minimising frame along a curve.
///
/// `points` (world mm) and unit `tangents` describe the curve. The frame starts with `up` (made orthogonal) and is
/// propagated by double reflection.
pub fn rotation_minimising(points: &[DVec3], tangents: &[DVec3], up: DVec3) -> Vec<DVec3> {
    let Some(&first) = tangents.first() else { return Vec::new() };
    let mut r = Attitude::new(first, up).up;
    let mut ups = vec![r];
    for (x, t) in points.windows(2).zip(tangents.windows(2)) {
        // Rounding errors must not add up over thousands of points.
        r = Attitude::new(t[1], doubly_reflected(r, [x[0], x[1]], [t[0], t[1]])).up;
        ups.push(r);
    }
    ups
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A helix turns its Frenet frame by its torsion, which gives the rotation-minimising frame exactly.
    fn error(points: usize) -> f64 {
        let (a, b): (f64, f64) = (10.0, 4.0);
        let c = (a * a + b * b).sqrt();
        let torsion = b / (c * c);
        let angle = |n: usize| 6.0 * n as f64 / (points - 1) as f64;
        let at = |p: f64| DVec3::new(a * p.cos(), a * p.sin(), b * p);
        let tangent = |p: f64| DVec3::new(-a * p.sin(), a * p.cos(), b) / c;
        let normal = |p: f64| DVec3::new(-p.cos(), -p.sin(), 0.0);
        let all: Vec<f64> = (0..points).map(angle).collect();
        let places: Vec<_> = all.iter().map(|&p| at(p)).collect();
        let tangents: Vec<_> = all.iter().map(|&p| tangent(p)).collect();
        let ups = rotation_minimising(&places, &tangents, normal(0.0));
        let exact = |p: f64| {
            let turned = -torsion * c * p;
            normal(p) * turned.cos() + tangent(p).cross(normal(p)) * turned.sin()
        };
        all.iter().zip(&ups).map(|(&p, u)| u.distance(exact(p))).fold(0.0, f64::max)
    }

    #[test]
    fn a_helix_with_order_four() {
        assert!(error(400) < 1e-7, "{}", error(400));
        let order = (error(31) / error(61)).log2();
        assert!((order - 4.0).abs() < 0.2, "order {order}");
    }

    #[test]
    fn a_straight_line_does_not_turn() {
        let points: Vec<_> = (0..50).map(|n| DVec3::X * f64::from(n)).collect();
        let ups = rotation_minimising(&points, &[DVec3::X; 50], DVec3::new(0.3, 1.0, 0.0));
        assert!(ups.iter().all(|u| u.distance(DVec3::Y) < 1e-12));
        assert!(rotation_minimising(&[], &[], DVec3::Z).is_empty());
        let doubled = rotation_minimising(&[DVec3::ONE; 4], &[DVec3::X; 4], DVec3::NAN);
        assert!(doubled.iter().all(|u| u.is_normalized()));
    }
}
