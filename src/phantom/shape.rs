//! The colon's wall: haustra, taeniae, folds, polyps and bridges as one signed distance.
//!
//! All distances are in mm and correct to first order. Each part's implicit function is divided by the length of its
//! gradient, so that the scanner's blur is as wide on a fold's flank as on the plain wall. A smooth maximum joins the
//! parts and rounds the fillets between them.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::centerline::{Centerline, FootPoint, Profile};
use super::collapse::Collapse;
use super::decoys::Decoy;
use super::lesions::Lesion;
use super::profile::smooth_step;
use super::solid::Surface;
use super::spline::Spline;
use super::touching::Touching;

/// Saturation of distances in the lumen, mm. Nothing depends on a wall farther away, so features beyond it are skipped.
pub(crate) const REACH: f64 = 8.0;
/// Saturation of distances in the tissue, mm.
pub(crate) const DEEP: f64 = 6.0;

/// Arc length within which features can matter, mm. It is larger than [`REACH`] because arcs on the inside of a bend
/// are longer than distances.
pub(crate) const WINDOW: f64 = 30.0;
/// Maximum deviation of the plain wall from the mean radius, as a fraction of it; [`TAENIA_MM`] is added.
const BULGE: f64 = 0.16;
/// What counts as the radius of a closed lumen, mm.
const LEAST_CALIBER_MM: f64 = 0.2;
/// Height of the taeniae, mm.
const TAENIA_MM: f64 = 0.8;
/// Length over which the cross-section becomes round towards the caps, mm.
const ROUND_MM: f64 = 14.0;
/// Fillet radii of folds, polyps and bridges for [`smooth_max`], mm.
const FILLET: [f64; 3] = [3.0, 1.0, 0.8];

/// A semilunar fold: a curved plate on the wall between two taeniae.
#[derive(Clone, Debug)]
pub(crate) struct Fold {
    /// Arc length at the middle, mm.
    pub s: f64,
    /// Angle of the middle.
    pub phi: f64,
    /// Half the angle that the fold spans.
    pub half_width: f64,
    /// Height above the wall at the middle, mm.
    pub depth: f64,
    /// Thickness, mm. The free edge is a half circle.
    pub thickness: f64,
    /// Mean radius of the lumen at the fold, mm.
    pub radius: f64,
    /// Slant of the fold's line on the wall, mm. Slant and bow are its deviation from the plane across the axis.
    pub slant: f64,
    /// Bow of the line, mm; see [`Fold::slant`].
    pub bow: f64,
    /// It is so thin that each side's blur reaches the other one.
    pub sheet: bool,
}

/// A sessile polyp: a ball on the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polyp {
    /// Centre of the ball, world mm.
    pub position: DVec3,
    /// Diameter of the ball, mm.
    pub diameter_mm: f64,
}

/// A strand of tissue across the lumen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bridge {
    /// One end, world mm.
    pub from: DVec3,
    /// The other end.
    pub to: DVec3,
    /// Diameter, mm.
    pub diameter_mm: f64,
}

/// A feature and its arc length on the axis. The arc length keeps it from changing the lumen of another loop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Attached<T> {
    /// Arc length, mm.
    pub s: f64,
    /// The feature.
    pub what: T,
}

/// Signed distances of one position to the colon.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Distances {
    /// Distance to the wall with all its features, mm; negative in the lumen.
    pub wall: f64,
    /// Distance to the plain wall without folds, polyps and bridges, mm.
    pub plain: f64,
    /// Unit normal of the wall, into the tissue, in closed form: exact on the plain wall, polyps and bridges, and to
    /// first order in the fillets (a few degrees).
    pub normal: DVec3,
    /// Thickness of the tissue behind the wall, mm, in a thin fold; infinite elsewhere.
    pub thickness: f64,
}

/// The lumen's shape around its axis.
#[derive(Clone, Debug)]
pub(crate) struct Shape {
    /// The axis.
    pub axis: Centerline,
    /// Angle of the first taenia; the others are 120° and 240° away.
    pub taenia: f64,
    /// By how much taeniae and haustra are turned about the axis at each arc length, radians (its x); `None` for not at all.
    pub twist: Option<Spline>,
    /// Arc lengths of the constrictions of each of the three rows of haustra, from 0 to the axis' length.
    pub rows: [Vec<f64>; 3],
    /// Folds, by arc length.
    pub folds: Vec<Fold>,
    /// Sessile polyps.
    pub polyps: Vec<Attached<Polyp>>,
    /// Thin strands.
    pub bridges: Vec<Attached<Bridge>>,
    /// Polyps of every shape and site.
    pub lesions: Vec<Attached<Lesion>>,
    /// Structures that look like a polyp but are not.
    pub decoys: Vec<Decoy>,
    /// Stretches where the lumen is closed.
    pub collapsed: Vec<Collapse>,
    /// Septa between limbs that touch.
    pub touching: Vec<Touching>,
}

/// A radius with its partial derivatives in arc length and angle.
#[derive(Clone, Copy)]
struct Radius {
    at: f64,
    by_s: f64,
    by_phi: f64,
}

impl Shape {
    /// Returns the largest radius of the plain wall near s, mm.
    pub(crate) fn largest_radius(&self, s: f64) -> f64 {
        largest(&self.axis, s)
    }

    /// Returns for each knot of the axis the distance within which positions depend on it, mm.
    pub(crate) fn reach(&self) -> Vec<f64> {
        // A position whose foot point is half a knot away is slightly farther from the knot than from the foot point.
        let step = self.axis.knot_step();
        (0..self.axis.knots().len()).map(|i| self.largest_radius(i as f64 * step) + DEEP + 1.5).collect()
    }

    /// Returns the radius of the plain wall at arc length `s` and angle `phi`, mm, as if nothing were collapsed.
    pub(crate) fn radius(&self, s: f64, phi: f64) -> f64 {
        self.plain(s, &self.axis.profile(s), phi).at
    }

    /// Returns the radius of the plain wall as [`Shape::radius`] does, but of what is collapsed what is left, and at least 0.2 mm.
    pub(crate) fn caliber(&self, s: f64, phi: f64) -> f64 {
        let open = self.radius(s, phi);
        let closed = self.collapsed.iter().find(|c| c.concerns(s)).map(|c| c.closure(s));
        closed.map_or(open, |(share, _, overlap, _)| open * share - overlap).max(LEAST_CALIBER_MM)
    }

    /// Returns the radius at arc length `s`, where the axis has the profile `p`, and at angle `phi`.
    fn plain(&self, s: f64, p: &Profile, phi: f64) -> Radius {
        let (r, r_s) = p.radius;
        let (tri, tri_s) = p.triangle;
        let (twist, twist_s) = self.twist(s);
        let theta = phi - self.taenia - twist;
        let (s3, c3) = (3.0 * theta).sin_cos();
        // 0 on the taeniae, 1 midway between them.
        let between = 0.5 * (1.0 - c3);
        let between_phi = 1.5 * s3;
        let band = (1.0 - between).powi(8);
        let band_phi = -8.0 * (1.0 - between).powi(7) * between_phi;
        let row = &self.rows[((theta / TAU - (theta / TAU).floor()) * 3.0) as usize % 3];
        let (sac, sac_s) = sacculation(row, s);
        let haustra = 0.14 * between * between;
        // A fraction of the radius, and a height.
        let share = -tri * c3 + haustra * (sac - 0.4);
        let share_s = -tri_s * c3 + haustra * sac_s;
        let share_phi = 3.0 * tri * s3 + 0.28 * between * between_phi * (sac - 0.4);
        let height = r * share - TAENIA_MM * band;
        let height_s = r_s * share + r * share_s;
        let height_phi = r * share_phi - TAENIA_MM * band_phi;
        let (round, round_s) = roundness(s, self.axis.length());
        let by_phi = round * height_phi;
        Radius { at: r + round * height, by_s: r_s + round * height_s + round_s * height - twist_s * by_phi, by_phi }
    }

    /// Returns the angle by which taeniae and haustra are turned at arc length `s`, and its derivative, radians and radians/mm.
    pub(crate) fn twist(&self, s: f64) -> (f64, f64) {
        self.twist.as_ref().map_or((0.0, 0.0), |twist| {
            let j = twist.jet(s);
            (j.at.x, j.d1.x)
        })
    }

    /// Returns the distances of `p` to the part of the colon around one of its foot points.
    pub(crate) fn distances(&self, p: DVec3, foot: &FootPoint) -> Distances {
        let (here, plain, normal) = self.here(foot);
        if plain >= DEEP {
            return Distances { wall: DEEP, plain: DEEP, normal: here.outward, thickness: f64::INFINITY };
        }
        let (surface, thickness) = self.among(p, &here, Surface { d: plain, normal });
        // The walls that touch are as thick together as they are apart.
        let cord = self.collapsed.iter().map(|c| c.cord_mm(foot.s)).fold(0.0, f64::max);
        Distances { wall: surface.d.clamp(-REACH, DEEP), plain: plain - cord, normal: surface.normal, thickness }
    }

    /// Returns the surface at `p`, which has this foot point, without saturation.
    pub(crate) fn surface(&self, p: DVec3, foot: &FootPoint) -> Surface {
        let (here, plain, normal) = self.here(foot);
        self.among(p, &here, Surface { d: plain, normal }).0
    }

    /// Returns the decoys that change the wall at arc length `s`.
    pub(crate) fn decoys_near(&self, s: f64) -> impl Iterator<Item = &Decoy> {
        self.decoys.iter().filter(move |d| (d.s - s).abs() < d.span_mm)
    }

    /// Returns the signed distance to the faces of the folds alone, mm; −∞ if none is within [`REACH`].
    pub(crate) fn to_folds(&self, foot: &FootPoint) -> f64 {
        let (here, ..) = self.here(foot);
        let near = self.folds.iter().filter(|f| (f.s - foot.s).abs() <= WINDOW);
        near.filter_map(|f| f.surface(&here)).map(|s| s.d).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns the signed distance to the plain wall without anything that grows on it, mm.
    pub(crate) fn bare(&self, foot: &FootPoint) -> f64 {
        self.here(foot).1
    }

    /// Returns the signed distance to the plain wall and the folds, mm, without fillets between them. Far from both, a fillet's
    /// distance may be too long.
    pub(crate) fn to_wall(&self, foot: &FootPoint) -> f64 {
        self.here(foot).1.max(self.to_folds(foot))
    }

    /// Returns a foot point's position in the tube's coordinates, the distance to the plain wall and its normal.
    fn here<'a>(&self, foot: &'a FootPoint) -> (Here<'a>, f64, DVec3) {
        let profile = self.axis.profile(foot.s);
        let near = profile.radius.0;
        let phi = self.axis.angle(foot);
        let mut r = self.plain(foot.s, &profile, phi);
        if let Some(collapse) = self.collapsed.iter().find(|c| c.concerns(foot.s)) {
            let (share, by_s, closed, closed_by_s) = collapse.closure(foot.s);
            r = Radius {
                at: r.at * share - closed,
                by_s: r.by_s * share + r.at * by_s - closed_by_s,
                by_phi: r.by_phi * share,
            };
        }
        // Near the axis the angle is ill-defined, but nothing depends on the distance there.
        let arm = foot.rho.max(0.3 * near);
        let (by_s, by_phi) = (r.by_s / foot.stretch, r.by_phi / arm);
        let steep = (1.0 + by_s * by_s + by_phi * by_phi).sqrt();
        let plain = (foot.rho - r.at) / steep;
        let outward = foot.offset / foot.rho.max(1e-9);
        let here = Here { foot, phi, arm, outward, along: foot.tangent, around: foot.tangent.cross(outward) };
        let normal = (outward - here.along * by_s - here.around * by_phi) / steep;
        if self.touching.is_empty() {
            return (here, plain, normal);
        }
        let p = || self.axis.at(foot.s) + foot.offset;
        let wall = Surface { d: plain, normal };
        let Surface { d, normal } = self.touching.iter().fold(wall, |wall, septum| septum.flatten(wall, foot.s, p));
        (here, d, normal)
    }

    /// Returns the surface of the plain wall with everything that grows on it, and the thickness of a thin fold.
    fn among(&self, p: DVec3, here: &Here<'_>, wall: Surface) -> (Surface, f64) {
        let (foot, plain) = (here.foot, wall.d);
        let mut surface = wall;
        let mut thickness = f64::INFINITY;
        // A fold does not reach deeper into the tissue than its own thickness.
        let folds = if plain < 5.0 { &self.folds[..] } else { &[] };
        let first = folds.partition_point(|f| f.s < foot.s - WINDOW);
        for fold in folds[first..].iter().take_while(|f| f.s <= foot.s + WINDOW) {
            if let Some(other) = fold.surface(here) {
                if fold.sheet && other.d > surface.d {
                    // At its root it becomes the wall.
                    thickness = fold.thickness + DEEP * smooth_step(-1.5, 0.5, plain);
                }
                surface = surface.join(other, if fold.sheet { FILLET[1] } else { FILLET[0] });
            }
        }
        for polyp in self.polyps.iter().filter(|a| (a.s - foot.s).abs() < WINDOW) {
            surface = surface.join(Surface::about(polyp.what.position, 0.5 * polyp.what.diameter_mm, p), FILLET[1]);
        }
        for bridge in self.bridges.iter().filter(|a| (a.s - foot.s).abs() < WINDOW) {
            surface = surface.join(bridge.what.surface(p), FILLET[2]);
        }
        for lesion in self.lesions.iter().filter(|a| (a.s - foot.s).abs() < WINDOW) {
            let grown = lesion.what.grow_on(surface, p);
            if grown.d > surface.d {
                thickness = f64::INFINITY;
            }
            surface = grown;
        }
        for decoy in self.decoys_near(foot.s) {
            let grown = decoy.grow_on(surface, p);
            if grown.d > surface.d {
                thickness = f64::INFINITY;
            }
            surface = grown;
        }
        (surface, thickness)
    }
}

/// A position in the tube's coordinates.
struct Here<'a> {
    foot: &'a FootPoint,
    phi: f64,
    /// Distance from the axis, with a lower bound so that angles can be scaled by it.
    arm: f64,
    /// Unit vectors: away from the axis, along it, and around it (increasing φ).
    outward: DVec3,
    along: DVec3,
    around: DVec3,
}

impl Fold {
    /// Returns the angle from the fold's middle, within ±π.
    fn off_middle(&self, phi: f64) -> f64 {
        let delta = phi - self.phi;
        delta - TAU * (delta / TAU).round()
    }

    /// Returns the fold's height at angle `phi`, mm; negative beyond its ends, where it is buried in the wall.
    pub(crate) fn height(&self, phi: f64) -> f64 {
        let u = self.off_middle(phi) / self.half_width;
        self.depth * (1.0 - u * u)
    }

    /// Returns the arc length of the fold's line at angle `phi`, mm.
    pub(crate) fn line(&self, phi: f64) -> f64 {
        let (sin, cos) = self.off_middle(phi).sin_cos();
        self.s + self.slant * sin + self.bow * (1.0 - cos)
    }

    /// Returns the fold's surface, or `None` if it is more than [`REACH`] away.
    fn surface(&self, here: &Here<'_>) -> Option<Surface> {
        let foot = here.foot;
        let off = foot.s - self.s;
        let wander = self.slant.abs() + self.bow.abs();
        let half = 0.5 * self.thickness;
        // Lower bound of the distance to the line on the wall at any angle (its slope shortens it by a fifth at most).
        if (off.abs() - wander) * foot.stretch * 0.8 > REACH + half {
            return None;
        }
        let delta = self.off_middle(here.phi);
        let u = delta / self.half_width;
        let height = self.depth * (1.0 - u * u);
        if height < -REACH {
            return None;
        }
        // Across the plate.
        let (sin, cos) = delta.sin_cos();
        let line = self.slant * sin + self.bow * (1.0 - cos);
        let (by_s, by_phi) = (1.0 / foot.stretch, (self.slant * cos + self.bow * sin) / here.arm);
        let steep = (by_s * by_s + by_phi * by_phi).sqrt();
        let across = (off - line) / steep;
        let across_normal = (here.along * by_s - here.around * by_phi) / steep;
        // Beyond the centre of the half circle at the edge.
        let by_phi = 2.0 * self.depth * u / self.half_width / here.arm;
        let steep = (1.0 + by_phi * by_phi).sqrt();
        let beyond = ((foot.rho - (self.radius - height) - half) / steep).min(0.0);
        let beyond_normal = (here.outward - here.around * by_phi) / steep;
        let length = (across * across + beyond * beyond).sqrt();
        let normal = -(across_normal * across + beyond_normal * beyond) / length.max(1e-9);
        Some(Surface { d: half - length, normal })
    }
}

impl Bridge {
    pub(crate) fn surface(&self, p: DVec3) -> Surface {
        let axis = self.to - self.from;
        let t = ((p - self.from).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
        Surface::about(self.from + axis * t, 0.5 * self.diameter_mm, p)
    }
}

/// Returns the largest radius of the plain wall near s, mm.
pub(crate) fn largest(axis: &Centerline, s: f64) -> f64 {
    axis.profile(s).radius.0 * (1.0 + BULGE)
}

/// Returns 0 at a row's constrictions and 1 midway between them, with its derivative.
fn sacculation(row: &[f64], s: f64) -> (f64, f64) {
    let i = row.partition_point(|&x| x <= s).clamp(1, row.len() - 1);
    let gap = row[i] - row[i - 1];
    let (sin, cos) = (PI * (s - row[i - 1]) / gap).sin_cos();
    (sin * sin, 2.0 * PI / gap * sin * cos)
}

/// Returns 0 at the caps, where the angle is ill-defined, and 1 in between, with its derivative.
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
            twist: None,
            rows: [row(0.0), row(7.0), row(-4.0)],
            folds: Vec::new(),
            polyps: Vec::new(),
            bridges: Vec::new(),
            lesions: Vec::new(),
            decoys: Vec::new(),
            collapsed: Vec::new(),
            touching: Vec::new(),
        };
        let turns = (0..=40).map(|i| DVec3::X * (0.02 * f64::from(i)).sin()).collect();
        let twisted = Shape { twist: Some(Spline::new(end / 40.0, turns, DVec3::ZERO, DVec3::ZERO)), ..shape.clone() };
        for shape in [shape, twisted] {
            for (s, phi) in [(3.0, 1.0), (100.0, 0.31), (432.1, 2.2), (800.0, -2.0), (end - 5.0, 0.7)] {
                let (r, h) = (shape.plain(s, &shape.axis.profile(s), phi), 1e-5);
                let by_s = (shape.radius(s + h, phi) - shape.radius(s - h, phi)) / (2.0 * h);
                let by_phi = (shape.radius(s, phi + h) - shape.radius(s, phi - h)) / (2.0 * h);
                assert!((r.by_s - by_s).abs() < 1e-6 && (r.by_phi - by_phi).abs() < 1e-5, "at {s}, {phi}");
                assert!(r.at <= shape.largest_radius(s));
            }
        }
    }
}
