//! The wall about the axis: haustra, taeniae, folds, polyps and bridges as one signed distance.
//!
//! Everything is a distance in mm to first order: each part's implicit function is divided by the length of its own
//! gradient, so that the scanner's blur is as wide on a fold's flank as on the plain wall. Parts are joined by a smooth
//! maximum, which rounds the fillets between them.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::centerline::{Centerline, Foot};
use super::profile::smooth_max;

/// Distances saturate here, mm: nothing depends on the wall farther away, and features need not be looked for.
pub const REACH: f64 = 8.0;

/// The plain wall leaves the mean radius by at most this share of it (and [`TAENIA_MM`]).
const BULGE: f64 = 0.14;
/// Height of the taeniae's bands, mm.
const TAENIA_MM: f64 = 0.8;
/// Over this length the cross-section becomes round towards the caps, mm.
const ROUND_MM: f64 = 14.0;
/// Fillet radii (of [`smooth_max`]) of folds, polyps and bridges, mm.
const FILLET: [f64; 3] = [3.0, 1.0, 0.8];

/// A semilunar fold: a curved plate that stands on the wall between two taeniae.
#[derive(Clone, Debug)]
pub struct Fold {
    /// Arc length at its middle, mm.
    pub s: f64,
    /// Angle of its middle.
    pub phi: f64,
    /// Half of the angle it spans.
    pub half_width: f64,
    /// How far it stands out in its middle, mm.
    pub depth: f64,
    /// Thickness, mm; the free edge is a half circle.
    pub thickness: f64,
    /// Mean radius of the lumen here, mm.
    pub radius: f64,
    /// How its line on the wall leaves the plane across the axis, mm: a slant and a bow.
    pub slant: f64,
    /// See [`Fold::slant`].
    pub bow: f64,
}

/// A sessile polyp: a ball that sits on the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polyp {
    /// Centre of the ball, world mm.
    pub position: DVec3,
    /// Diameter of the ball, mm.
    pub diameter_mm: f64,
}

/// A strand of tissue across the lumen.
#[derive(Clone, Copy, Debug)]
pub struct Bridge {
    /// One end, world mm.
    pub from: DVec3,
    /// The other end.
    pub to: DVec3,
    /// Its diameter, mm.
    pub diameter_mm: f64,
}

/// A feature and the arc length of the axis' point it belongs to: another loop's lumen is not changed by it.
#[derive(Clone, Copy, Debug)]
pub struct Attached<T> {
    /// Arc length, mm.
    pub s: f64,
    /// The feature.
    pub what: T,
}

/// The signed distances of one place to the colon.
#[derive(Clone, Copy, Debug)]
pub struct Distances {
    /// To the lumen's wall with all it carries, mm, negative in the lumen.
    pub wall: f64,
    /// To the plain wall without folds, polyps and bridges.
    pub plain: f64,
}

/// The lumen's shape about its axis.
#[derive(Clone, Debug)]
pub struct Shape {
    /// The axis.
    pub axis: Centerline,
    /// Angle of the first taenia; the others are 120° and 240° away.
    pub taenia: f64,
    /// For each of the three rows of haustra the arc lengths of its constrictions, from 0 to the axis' length.
    pub rows: [Vec<f64>; 3],
    /// By arc length.
    pub folds: Vec<Fold>,
    /// Sessile polyps.
    pub polyps: Vec<Attached<Polyp>>,
    /// Thin strands.
    pub bridges: Vec<Attached<Bridge>>,
}

/// A function's value with its two partial derivatives in arc length and angle.
#[derive(Clone, Copy)]
struct Radius {
    at: f64,
    by_s: f64,
    by_phi: f64,
}

impl Shape {
    /// The largest radius that the plain wall has about s, mm.
    pub fn largest_radius(&self, s: f64) -> f64 {
        self.axis.profile(s).radius.0 * (1.0 + BULGE)
    }

    /// Radius of the plain wall at arc length `s` and angle `phi`, mm.
    pub fn radius(&self, s: f64, phi: f64) -> f64 {
        self.plain(s, phi).at
    }

    fn plain(&self, s: f64, phi: f64) -> Radius {
        let p = self.axis.profile(s);
        let (r, r_s) = p.radius;
        let (tri, tri_s) = p.triangle;
        let theta = phi - self.taenia;
        let (s3, c3) = (3.0 * theta).sin_cos();
        // 0 on the taeniae, 1 midway between them.
        let between = 0.5 * (1.0 - c3);
        let between_phi = 1.5 * s3;
        let band = (1.0 - between).powi(8);
        let band_phi = -8.0 * (1.0 - between).powi(7) * between_phi;
        let row = &self.rows[(theta.rem_euclid(TAU) / (TAU / 3.0)) as usize % 3];
        let (sac, sac_s) = sacculation(row, s);
        let haustra = 0.14 * between * between;
        // A share of the radius, and a height.
        let share = -tri * c3 + haustra * (sac - 0.4);
        let share_s = -tri_s * c3 + haustra * sac_s;
        let share_phi = 3.0 * tri * s3 + 0.28 * between * between_phi * (sac - 0.4);
        let height = r * share - TAENIA_MM * band;
        let height_s = r_s * share + r * share_s;
        let height_phi = r * share_phi - TAENIA_MM * band_phi;
        let (round, round_s) = roundness(s, self.axis.length());
        Radius { at: r + round * height, by_s: r_s + round * height_s + round_s * height, by_phi: round * height_phi }
    }

    /// The distances of `p` to the part of the colon about one of its feet.
    pub fn distances(&self, p: DVec3, foot: &Foot) -> Distances {
        let near = self.axis.profile(foot.s).radius.0;
        if foot.rho > near * (1.0 + BULGE) + REACH + 2.0 {
            return Distances { wall: REACH, plain: REACH };
        }
        let phi = self.axis.frame(foot.s).angle(foot.offset);
        let r = self.plain(foot.s, phi);
        // Near the axis the angle means little; the distance there is beyond what anything depends on.
        let arm = foot.rho.max(0.3 * near);
        let slope = (r.by_s / foot.stretch).hypot(r.by_phi / arm);
        let plain = (foot.rho - r.at) / 1f64.hypot(slope);
        let mut wall = plain;
        let window = 30.0;
        let first = self.folds.partition_point(|f| f.s < foot.s - window);
        for fold in self.folds[first..].iter().take_while(|f| f.s <= foot.s + window) {
            if let Some(d) = fold.distance(foot, phi, arm) {
                wall = smooth_max(wall, d, FILLET[0]);
            }
        }
        for polyp in self.polyps.iter().filter(|a| (a.s - foot.s).abs() < window) {
            let d = 0.5 * polyp.what.diameter_mm - (p - polyp.what.position).length();
            wall = smooth_max(wall, d, FILLET[1]);
        }
        for bridge in self.bridges.iter().filter(|a| (a.s - foot.s).abs() < window) {
            wall = smooth_max(wall, bridge.what.distance(p), FILLET[2]);
        }
        Distances { wall: wall.clamp(-REACH, REACH), plain: plain.min(REACH) }
    }
}

impl Fold {
    /// Angle from the fold's middle, in (−π, π].
    fn off_middle(&self, phi: f64) -> f64 {
        (phi - self.phi + PI).rem_euclid(TAU) - PI
    }

    /// How far the fold stands out at angle `phi`, mm; negative beyond its ends, where it lies buried in the wall.
    pub fn height(&self, phi: f64) -> f64 {
        let u = self.off_middle(phi) / self.half_width;
        self.depth * (1.0 - u * u)
    }

    /// Signed distance into the fold's tissue, mm, `None` where it is more than [`REACH`] away.
    fn distance(&self, foot: &Foot, phi: f64, arm: f64) -> Option<f64> {
        let along = foot.s - self.s;
        let wander = self.slant.abs() + self.bow.abs();
        let half = 0.5 * self.thickness;
        // The line on the wall is at least this far off, whatever the angle (its slope shortens by a fifth at most).
        if (along.abs() - wander) * foot.stretch * 0.8 > REACH + half {
            return None;
        }
        let delta = self.off_middle(phi);
        let u = delta / self.half_width;
        let height = self.depth * (1.0 - u * u);
        if height < -REACH {
            return None;
        }
        let (sin, cos) = delta.sin_cos();
        let line = self.slant * sin + self.bow * (1.0 - cos);
        let line_phi = self.slant * cos + self.bow * sin;
        let across = (along - line) / (1.0 / foot.stretch).hypot(line_phi / arm);
        let edge_phi = 2.0 * self.depth * u / self.half_width;
        let beyond = (foot.rho - (self.radius - height) - half) / 1f64.hypot(edge_phi / arm);
        Some(half - across.hypot(beyond.min(0.0)))
    }
}

impl Bridge {
    fn distance(&self, p: DVec3) -> f64 {
        let axis = self.to - self.from;
        let t = ((p - self.from).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
        0.5 * self.diameter_mm - (p - self.from - axis * t).length()
    }
}

/// 0 at a row's constrictions, 1 midway between them, with its derivative.
fn sacculation(row: &[f64], s: f64) -> (f64, f64) {
    let i = row.partition_point(|&x| x <= s).clamp(1, row.len() - 1);
    let gap = row[i] - row[i - 1];
    let (sin, cos) = (PI * (s - row[i - 1]) / gap).sin_cos();
    (sin * sin, 2.0 * PI / gap * sin * cos)
}

/// 0 at the caps, where the angle means nothing, 1 in between, with its derivative.
fn roundness(s: f64, length: f64) -> (f64, f64) {
    let ramp = |x: f64| {
        let t = (x / ROUND_MM).clamp(0.0, 1.0);
        (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / ROUND_MM)
    };
    let ((a, a_s), (b, b_s)) = (ramp(s), ramp(length - s));
    (a * b, a_s * b - a * b_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_radius_has_the_derivatives_it_claims() {
        let axis = Centerline::new(1.0, |r| r, 0.0, 1);
        let end = axis.length();
        let row = |k: f64| (0..=40).map(|i| end / 40.0 * f64::from(i) + if i % 40 == 0 { 0.0 } else { k }).collect();
        let shape = Shape {
            axis,
            taenia: 0.3,
            rows: [row(0.0), row(7.0), row(-4.0)],
            folds: Vec::new(),
            polyps: Vec::new(),
            bridges: Vec::new(),
        };
        for (s, phi) in [(3.0, 1.0), (100.0, 0.31), (432.1, 2.2), (800.0, -2.0), (end - 5.0, 0.7)] {
            let (r, h) = (shape.plain(s, phi), 1e-5);
            let by_s = (shape.radius(s + h, phi) - shape.radius(s - h, phi)) / (2.0 * h);
            let by_phi = (shape.radius(s, phi + h) - shape.radius(s, phi - h)) / (2.0 * h);
            assert!((r.by_s - by_s).abs() < 1e-6 && (r.by_phi - by_phi).abs() < 1e-5, "at {s}, {phi}");
            assert!(r.at <= shape.largest_radius(s));
        }
    }
}
