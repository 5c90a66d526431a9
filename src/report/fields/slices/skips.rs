//! Skipped stretches: where a line through the colon jumps to another place of the colon, such as through a hole in the wall
//! between two limbs.

use glam::DVec3;

/// Two consecutive points of a line whose places are farther apart than this skip what lies between, mm.
const SKIP_MM: f64 = 40.0;
/// Places are medians over this many points to both sides, so that a line that is near another limb for an instant skips nothing.
const BESIDE: usize = 5;

/// A line to compare with: the true one, or that of the scan as it is.
#[derive(Clone, Debug, Default)]
pub(super) struct Reference {
    points: Vec<DVec3>,
    /// How far along the line each point is, mm.
    along: Vec<f64>,
    /// Its length, mm.
    pub length_mm: f64,
}

/// A stretch that a line leaves out, or goes back by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Skip {
    /// Where it begins and ends along the reference, mm.
    pub between_mm: [f64; 2],
    /// The point of the line before it, world, mm.
    pub at: DVec3,
}

impl Skip {
    /// Returns its length along the reference, mm.
    pub(super) fn mm(&self) -> f64 {
        (self.between_mm[1] - self.between_mm[0]).abs()
    }
}

impl Reference {
    /// Creates a reference of a line's points, world, mm.
    pub(super) fn new(points: Vec<DVec3>) -> Self {
        let mut length_mm = 0.0;
        let mut along = Vec::with_capacity(points.len());
        for (n, p) in points.iter().enumerate() {
            length_mm += n.checked_sub(1).map_or(0.0, |before| p.distance(points[before]));
            along.push(length_mm);
        }
        Self { points, along, length_mm }
    }

    /// Returns how far along the reference its point nearest to `p` (world, mm) is, mm.
    pub(super) fn along(&self, p: DVec3) -> f64 {
        let (mut nearest, mut along) = (f64::INFINITY, 0.0);
        for (n, w) in self.points.windows(2).enumerate() {
            let piece = w[1] - w[0];
            let t = ((p - w[0]).dot(piece) / piece.length_squared().max(1e-12)).clamp(0.0, 1.0);
            let square = p.distance_squared(w[0] + piece * t);
            if square < nearest {
                (nearest, along) = (square, self.along[n] + t * piece.length());
            }
        }
        along
    }

    /// Returns the stretches that a line (points about 1 mm apart, world, mm) skips.
    pub(super) fn skips(&self, line: &[DVec3]) -> Vec<Skip> {
        let along: Vec<f64> = line.iter().map(|&p| self.along(p)).collect();
        let steady: Vec<f64> = (0..along.len())
            .map(|n| {
                // As many points to both sides, so that the median of an even line is its own place.
                let beside = BESIDE.min(n).min(along.len() - 1 - n);
                let mut near = along[n - beside..=n + beside].to_vec();
                near.sort_by(f64::total_cmp);
                near[beside]
            })
            .collect();
        let skips = steady.windows(2).zip(line).map(|(w, &at)| Skip { between_mm: [w[0], w[1]], at });
        skips.filter(|s| s.mm() > SKIP_MM).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::math::hash;

    /// Up, half round, down: two limbs 20 mm apart.
    fn loop_of_two_limbs() -> Vec<DVec3> {
        let up = (0..=100).map(|n| DVec3::new(0.0, 0.0, f64::from(n)));
        let round = (1..32).map(|n| {
            let (y, x) = (PI * f64::from(n) / 32.0).sin_cos();
            DVec3::new(10.0 - 10.0 * x, 0.0, 100.0 + 10.0 * y)
        });
        let down = (0..=100).rev().map(|n| DVec3::new(20.0, 0.0, f64::from(n)));
        up.chain(round).chain(down).collect()
    }

    #[test]
    fn a_line_that_leaves_out_a_loop_is_reported_with_its_length_and_place() {
        let reference = Reference::new(loop_of_two_limbs());
        let length = 200.0 + 10.0 * PI;
        assert!((reference.length_mm - length).abs() < 0.1);
        // Up to a height of 60 mm, straight across, and down.
        let up = (0..=60).map(|n| DVec3::new(0.0, 0.0, f64::from(n)));
        let across = (1..20).map(|n| DVec3::new(f64::from(n), 0.0, 60.0));
        let down = (0..=60).rev().map(|n| DVec3::new(20.0, 0.0, f64::from(n)));
        let mut line: Vec<DVec3> = up.chain(across).chain(down).collect();
        let left_out = length - 120.0;
        let skips = reference.skips(&line);
        assert_eq!(skips.len(), 1, "{skips:?}");
        assert!((skips[0].mm() - left_out).abs() < 1.0, "{skips:?}");
        assert!((skips[0].between_mm[0] - 60.0).abs() < 1.0 && skips[0].at.distance(DVec3::new(10.0, 0.0, 60.0)) < 1.1);
        // The same stretch, from the other end.
        line.reverse();
        let back = reference.skips(&line);
        assert!(back.len() == 1 && (back[0].mm() - left_out).abs() < 1.0, "{back:?}");
    }

    #[test]
    fn a_line_with_noise_skips_nothing() {
        let reference = Reference::new(loop_of_two_limbs());
        for seed in 0..5 {
            let noise = |n: usize, axis: u64| 2.5 * hash::normal(seed, 3 * n as u64 + axis);
            let line = reference.points.iter().enumerate();
            let line: Vec<DVec3> = line.map(|(n, &p)| p + DVec3::new(noise(n, 0), noise(n, 1), noise(n, 2))).collect();
            assert_eq!(reference.skips(&line), [], "seed {seed}");
        }
        // A line that is nearer to the other limb for 4 mm.
        let mut line = reference.points.clone();
        line[50..54].iter_mut().for_each(|p| p.x = 11.0);
        assert!((reference.along(line[51]) - 51.0).abs() > 100.0 && reference.skips(&line).is_empty());
    }

    #[test]
    fn short_lines_skip_nothing() {
        let reference = Reference::new(loop_of_two_limbs());
        assert!(reference.skips(&[]).is_empty() && reference.skips(&[DVec3::ZERO]).is_empty());
        assert_eq!(Reference::default().along(DVec3::ONE), 0.0);
        // A place that the line leaves at once counts, because there is no median at an end.
        assert_eq!(reference.skips(&[DVec3::ZERO, DVec3::new(20.0, 0.0, 0.0)]).len(), 1);
    }
}
