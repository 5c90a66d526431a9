//! Frames along a line that do not turn about it, for what needs the same angles about the colon everywhere.

use glam::DVec3;

/// Distance between the points of [`evenly`], mm.
pub const STEP_MM: f64 = 2.0;
/// Standard deviation of the smoothing of the line, mm: over it, its direction is that of the colon and not of its voxels.
const SMOOTH_MM: f64 = 5.0;

/// A frame about a line that does not turn about it, world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Point of the line, mm.
    pub at: DVec3,
    /// Unit direction towards the cecum.
    pub tangent: DVec3,
    /// Unit direction of angle 0.
    pub normal: DVec3,
}

impl Frame {
    /// Returns the unit direction of an angle, radians.
    pub fn direction(&self, angle: f64) -> DVec3 {
        self.normal * angle.cos() + self.tangent.cross(self.normal) * angle.sin()
    }

    /// Returns the angle of a direction, radians.
    pub fn angle(&self, direction: DVec3) -> f64 {
        direction.dot(self.tangent.cross(self.normal)).atan2(direction.dot(self.normal))
    }

    /// Returns a direction's components along angle 0, along a right angle, and along the line.
    pub fn components(&self, direction: DVec3) -> DVec3 {
        DVec3::new(
            direction.dot(self.normal),
            direction.dot(self.tangent.cross(self.normal)),
            direction.dot(self.tangent),
        )
    }

    /// Returns the direction with these components.
    pub fn of_components(&self, c: DVec3) -> DVec3 {
        self.normal * c.x + self.tangent.cross(self.normal) * c.y + self.tangent * c.z
    }

    /// Returns the frame at a share of the way to the next one.
    pub fn to(&self, next: &Self, share: f64) -> Self {
        let tangent = self.tangent.lerp(next.tangent, share).try_normalize().unwrap_or(self.tangent);
        let normal = self.normal.lerp(next.normal, share);
        let normal = (normal - tangent * normal.dot(tangent))
            .try_normalize()
            .unwrap_or_else(|| tangent.any_orthonormal_vector());
        Self { at: self.at.lerp(next.at, share), tangent, normal }
    }
}

/// Returns points every [`STEP_MM`] along a line, smoothed, and their distances along the line as it is, mm.
pub fn evenly(line: &[DVec3]) -> (Vec<DVec3>, Vec<f64>) {
    let mut along = Vec::with_capacity(line.len());
    let mut sum = 0.0;
    for (n, &p) in line.iter().enumerate() {
        sum += n.checked_sub(1).map_or(0.0, |before| line[before].distance(p));
        along.push(sum);
    }
    let rows = (sum / STEP_MM).floor() as usize + 1;
    let at = |mm: f64| {
        let n = along.partition_point(|&a| a < mm).clamp(1, line.len().max(2) - 1);
        match (line.get(n - 1), line.get(n)) {
            (Some(&a), Some(&b)) => {
                let length = along[n] - along[n - 1];
                a.lerp(b, if length > 0.0 { ((mm - along[n - 1]) / length).clamp(0.0, 1.0) } else { 0.0 })
            }
            _ => line.first().copied().unwrap_or_default(),
        }
    };
    let mm: Vec<f64> = (0..rows).map(|n| n as f64 * STEP_MM).collect();
    let even: Vec<DVec3> = mm.iter().map(|&mm| at(mm)).collect();
    let reach = (3.0 * SMOOTH_MM / STEP_MM).ceil() as i64;
    let smooth = |n: usize| {
        // Towards an end the window shrinks on both sides, so that the ends stay.
        let reach = reach.min(n as i64).min((rows - 1 - n) as i64);
        let weigh = |d: i64| (-0.5 * (d as f64 * STEP_MM / SMOOTH_MM).powi(2)).exp();
        let sum = (-reach..=reach).fold((DVec3::ZERO, 0.0), |(p, w), d| {
            let weight = weigh(d);
            (p + even[(n as i64 + d) as usize] * weight, w + weight)
        });
        sum.0 / sum.1
    };
    ((0..rows).map(smooth).collect(), mm)
}

/// Returns frames that do not turn about the line: double reflection (Wang, Jüttler, Zheng and Liu, ACM TOG 27(1), 2008), of fourth order
/// in the distance between points. The first one's angle 0 is towards the front of the patient.
pub fn frames(points: &[DVec3]) -> Vec<Frame> {
    let tangent = |n: usize| {
        let (a, b) = (n.saturating_sub(1), (n + 1).min(points.len() - 1));
        (points[b] - points[a]).try_normalize().unwrap_or(DVec3::Z)
    };
    let mut frames: Vec<Frame> = Vec::with_capacity(points.len());
    for (n, &at) in points.iter().enumerate() {
        let tangent = tangent(n);
        let before = frames.last().map(|before: &Frame| {
            let v = at - before.at;
            let c = v.length_squared();
            if c < 1e-12 {
                return before.normal;
            }
            let reflected = |d: DVec3| d - v * (2.0 / c * v.dot(d));
            let (normal, along) = (reflected(before.normal), reflected(before.tangent));
            let w = tangent - along;
            let c = w.length_squared();
            if c < 1e-12 { normal } else { normal - w * (2.0 / c * w.dot(normal)) }
        });
        let normal = before.unwrap_or(DVec3::NEG_Y);
        let normal = (normal - tangent * normal.dot(tangent))
            .try_normalize()
            .unwrap_or_else(|| tangent.any_orthonormal_vector());
        frames.push(Frame { at, tangent, normal });
    }
    frames
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    fn helix(step: f64) -> Vec<DVec3> {
        let at = |t: f64| DVec3::new(30.0 * t.cos(), 30.0 * t.sin(), 8.0 * t);
        (0..=(6.0 / step) as usize).map(|n| at(n as f64 * step)).collect()
    }

    /// The frames of a helix turn against Frenet's by the torsion times the length, exactly.
    #[test]
    fn frames_do_not_turn_about_the_line_and_converge_by_the_fourth_order() {
        let error = |step: f64| {
            let points = helix(step);
            let frames = frames(&points);
            let (c, torsion) = (30f64.hypot(8.0), 8.0 / (30.0 * 30.0 + 64.0));
            let frenet = |t: f64| -> (DVec3, DVec3) {
                let tangent = DVec3::new(-30.0 * t.sin(), 30.0 * t.cos(), 8.0) / c;
                (tangent, DVec3::new(-t.cos(), -t.sin(), 0.0))
            };
            let angle = |n: usize| {
                let (tangent, normal) = frenet(n as f64 * step);
                let d = frames[n].normal;
                d.dot(tangent.cross(normal)).atan2(d.dot(normal))
            };
            // Without the ends, where the tangent is of the first order.
            let (a, b) = ((1.0 / step) as usize, (5.0 / step) as usize);
            let turned = angle(b) - angle(a) + torsion * c * 4.0;
            (turned - TAU * (turned / TAU).round()).abs()
        };
        let (coarse, fine) = (error(0.1), error(0.05));
        assert!(coarse < 1e-3 && fine < coarse / 3.0, "{coarse} {fine}");
    }

    #[test]
    fn a_line_is_sampled_evenly_and_keeps_its_ends() {
        let line = [DVec3::ZERO, DVec3::X * 3.0, DVec3::X * 3.0, DVec3::X * 21.0];
        let (points, mm) = evenly(&line);
        assert_eq!((points.len(), mm[10]), (11, 20.0));
        assert!(points.iter().zip(&mm).all(|(p, mm)| (p.x - mm).abs() < 1e-9 && p.y == 0.0), "{points:?}");
        for short in [&line[..1], &line[..2]] {
            let (points, _) = evenly(short);
            assert!(points.iter().all(|p| p.is_finite()) && !frames(&points).is_empty());
        }
    }
}
