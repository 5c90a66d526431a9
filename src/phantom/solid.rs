//! Solids that grow on the wall, as signed distances with normals, and how two of them join.

use glam::{DMat3, DVec3};

use super::profile::smooth_max;

/// Beyond this distance from a solid, a ball around it stands for it, mm. The wall's distance saturates before.
const FAR: f64 = 10.0;

/// A signed distance (mm, positive in tissue) and its gradient, a unit vector, both to first order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    pub d: f64,
    pub normal: DVec3,
}

impl Surface {
    /// Returns the surface of a ball of tissue.
    pub(crate) fn about(centre: DVec3, radius: f64, p: DVec3) -> Self {
        let away = p - centre;
        let length = away.length();
        Self { d: radius - length, normal: -away / length.max(1e-9) }
    }

    /// Joins two bodies of tissue with a fillet of `k` mm ([`smooth_max`]). The result is divided by its gradient's
    /// length so that it stays a distance within the fillet.
    pub(crate) fn join(self, other: Self, k: f64) -> Self {
        let h = (k - (self.d - other.d).abs()).max(0.0);
        let share = h / (2.0 * k);
        let (near, far) = if self.d >= other.d { (self, other) } else { (other, self) };
        if h <= 0.0 {
            return near;
        }
        let gradient = near.normal * (1.0 - share) + far.normal * share;
        // Faces that meet at a right angle need the largest correction. In an undercut the distance may be too short,
        // never too long.
        let length = gradient.length().max(0.7);
        Self { d: smooth_max(self.d, other.d, k) / length, normal: gradient / length }
    }

    /// Joins two bodies of tissue without a fillet.
    pub(crate) fn or(self, other: Self) -> Self {
        if other.d > self.d { other } else { self }
    }

    /// Takes a body out of the tissue, with edges rounded by `k` mm.
    pub(crate) fn without(self, body: Self, k: f64) -> Self {
        self.inverted().join(body, k).inverted()
    }

    /// Swaps tissue and gas.
    fn inverted(self) -> Self {
        Self { d: -self.d, normal: -self.normal }
    }
}

/// An ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ellipsoid {
    /// Centre, world mm.
    pub centre: DVec3,
    /// Directions of its axes, world: an orthonormal matrix.
    pub axes: DMat3,
    /// Half axes, mm.
    pub radii: DVec3,
}

impl Ellipsoid {
    /// Returns a ball.
    pub(crate) fn ball(centre: DVec3, radius: f64) -> Self {
        Self { centre, axes: DMat3::IDENTITY, radii: DVec3::splat(radius) }
    }

    /// Returns the exact surface.
    pub(crate) fn surface(&self, p: DVec3) -> Surface {
        let away = p - self.centre;
        let most = self.radii.max_element();
        if away.length() > most + FAR || most - self.radii.min_element() < 1e-9 {
            return Surface::about(self.centre, most, p);
        }
        let own = surface_of(self.radii, self.axes.transpose() * away);
        Surface { d: own.d, normal: self.axes * own.normal }
    }

    /// Returns `count` points on the surface, spread evenly over the ball that it is stretched from, world mm.
    pub(crate) fn points(&self, count: usize) -> impl Iterator<Item = DVec3> + '_ {
        let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        (0..count).map(move |i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (sin, cos) = (turn * i as f64).sin_cos();
            let flat = (1.0 - z * z).sqrt();
            self.centre + self.axes * (DVec3::new(flat * cos, flat * sin, z) * self.radii)
        })
    }
}

/// Returns the exact surface, in its own axes, of an ellipsoid about the origin with the half axes `radii`.
///
/// The nearest point is xᵢ = rᵢ²·yᵢ / (t + rᵢ²), where t is the largest root of Σ (rᵢ·yᵢ / (t + rᵢ²))² = 1. That sum is convex
/// and falls with t, so Newton's method from its left converges without overshooting.
pub(crate) fn surface_of(radii: DVec3, q: DVec3) -> Surface {
    let (square, y) = (radii * radii, q.abs().max(DVec3::splat(1e-7)));
    let mut t = (radii * y - square).max_element();
    for _ in 0..50 {
        let part = radii * y / (square + t);
        let value = part.length_squared() - 1.0;
        let step = value / (2.0 * (part * part / (square + t)).element_sum());
        t += step;
        if step.abs() < 1e-10 {
            break;
        }
    }
    let nearest = square * y / (square + t);
    let inside = (y / radii).length_squared() < 1.0;
    let normal = -(nearest / square).normalize_or_zero() * q.signum();
    let d = y.distance(nearest);
    Surface { d: if inside { d } else { -d }, normal }
}

/// A rod with round ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rod {
    /// One end of its axis, world mm.
    pub from: DVec3,
    /// The other end.
    pub to: DVec3,
    /// Radius, mm.
    pub radius: f64,
}

impl Rod {
    /// Returns the surface.
    pub(crate) fn surface(&self, p: DVec3) -> Surface {
        let axis = self.to - self.from;
        let t = ((p - self.from).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
        Surface::about(self.from + axis * t, self.radius, p)
    }
}

/// An upright plate with round edges.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plate {
    /// Middle of its foot, world mm.
    pub foot: DVec3,
    /// Directions along it, across it and upwards, world: an orthonormal matrix.
    pub axes: DMat3,
    /// Length, thickness and height, mm.
    pub size: DVec3,
}

impl Plate {
    /// Returns the surface. The plate reaches 4 mm below its foot.
    pub(crate) fn surface(&self, p: DVec3) -> Surface {
        let q = self.axes.transpose() * (p - self.foot);
        let half = 0.5 * self.size.y;
        let end = 0.5 * self.size.x - half;
        let nearest = DVec3::new(q.x.clamp(-end, end), 0.0, q.z.clamp(-4.0, self.size.z - half));
        let own = Surface::about(nearest, half, q);
        Surface { d: own.d, normal: self.axes * own.normal }
    }
}

/// Returns the largest extent of balls, mm.
pub(crate) fn extent(balls: &[(DVec3, f64)]) -> f64 {
    let pair = |&(c, r): &(DVec3, f64)| balls.iter().map(move |&(d, q)| c.distance(d) + r + q).fold(0.0, f64::max);
    balls.iter().map(pair).fold(0.0, f64::max)
}

/// Returns the mean of balls' centres, weighted by their radii.
pub(crate) fn centre_of(balls: &[(DVec3, f64)]) -> DVec3 {
    let weight: f64 = balls.iter().map(|b| b.1).sum();
    balls.iter().map(|b| b.0 * b.1).sum::<DVec3>() / weight
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;

    #[test]
    fn an_ellipsoids_distance_is_one() {
        for radii in [DVec3::new(5.0, 4.0, 4.5), DVec3::new(10.0, 7.0, 1.3)] {
            for n in 0..2000u64 {
                let u = |k| hash::uniform(7, 8 * n + k) - 0.5;
                let q = DVec3::new(u(0), u(1), u(2)) * 3.0 * radii;
                let own = surface_of(radii, q);
                let on = q + own.normal * -own.d;
                assert!(((on / radii).length() - 1.0).abs() < 1e-6, "{q}: {own:?} leads to {on}");
                let step = DVec3::new(u(3), u(4), u(5)) * 1e-4;
                let other = surface_of(radii, q + step);
                assert!((other.d - own.d).abs() < step.length() + 1e-9, "{q}");
            }
        }
    }
}
