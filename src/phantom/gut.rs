//! Gas-filled tubes beside the colon: small bowel and stomach.
//!
//! A tube's lumen is round about its axis, less the ridges of its wall. Its signed distance is correct to first order, like the
//! colon's, and negative in the lumen.

use std::f64::consts::TAU;
use std::ops::Range;

use glam::DVec3;

use super::Phantom;
use super::centerline::{Centerline, FootPoint};
use super::kinds::BodyKind;
use super::profile::{FAT, GAS, TISSUE, mix, normal_cdf, smooth_step, tissue_share};
use super::shape::{DEEP, Distances};
use super::solid::Plate;

/// Ridges on the inside of a tube.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Ridges {
    /// Around the tube: distance between two and height, mm.
    Rings {
        /// Mean distance from one to the next, mm.
        every_mm: f64,
        /// Height, mm.
        height: f64,
    },
    /// Along the tube.
    Along {
        /// Number around the tube.
        count: f64,
        /// Height, mm.
        height: f64,
    },
}

/// A tube with a rounded cap at each end.
#[derive(Clone, Debug)]
pub(crate) struct Gut {
    /// Small bowel or stomach.
    pub kind: BodyKind,
    /// Axis and radii.
    pub axis: Centerline,
    /// Ridges.
    pub ridges: Ridges,
    /// Arc lengths where the tube is pinched off, and half the length of each narrowing, mm.
    pub pinches: Vec<[f64; 2]>,
    /// Depth of the fluid's surface along the direction of gravity, world mm, that direction, and the fluid's HU.
    pub fluid: Option<(f64, DVec3, f64)>,
    /// For each knot of the axis, the distance within which positions depend on it, mm.
    reach: Vec<f64>,
}

/// The knots of one tube that a region depends on.
pub(crate) type Run = (usize, Range<usize>);

/// What a position is to the nearest tube.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inside {
    /// Signed distance to its wall, mm; negative in the lumen.
    pub d: f64,
    /// Index of the tube.
    pub tube: usize,
    /// Arc length of the foot point, mm.
    pub s: f64,
}

impl Gut {
    /// Creates a tube without pinches and fluid.
    pub(crate) fn new(kind: BodyKind, axis: Centerline, ridges: Ridges) -> Self {
        let reach =
            (0..axis.knots().len()).map(|i| axis.profile(i as f64 * axis.knot_step()).radius.0 + DEEP + 1.5).collect();
        Self { kind, axis, ridges, pinches: Vec::new(), fluid: None, reach }
    }

    /// Lets positions up to `more` mm beyond the usual distance depend on the tube's last knots.
    pub(crate) fn reach_past_end(&mut self, more: f64) {
        let last = self.reach.len().saturating_sub(5);
        self.reach[last..].iter_mut().for_each(|reach| *reach += more);
    }

    /// Returns the radius at arc length `s` and angle `phi`, mm, and its derivatives; it is negative where the tube is closed.
    fn radius(&self, s: f64, phi: impl Fn() -> f64) -> (f64, f64, f64) {
        let (r, r_s) = self.axis.profile(s).radius;
        let (mut at, mut by_s, mut by_phi) = (r, r_s, 0.0);
        // No ridges on the caps, where the angle is ill-defined.
        let fade = |x: f64| smooth_step(2.0, 12.0, x);
        let round = fade(s) * fade(self.axis.length() - s);
        match self.ridges {
            Ridges::Rings { every_mm, height } => {
                let turn = TAU * (s / every_mm + 0.3 * (s / 17.0).sin());
                let turn_s = TAU * (1.0 / every_mm + 0.3 / 17.0 * (s / 17.0).cos());
                let (sin, cos) = turn.sin_cos();
                let bump = 0.5 + 0.5 * cos;
                at -= round * height * bump.powi(3);
                by_s += round * height * 1.5 * bump.powi(2) * sin * turn_s;
            }
            Ridges::Along { count, height } => {
                let (sin, cos) = (count * phi() + 0.9 * (s / 19.0).sin()).sin_cos();
                let bump = 0.5 + 0.5 * cos;
                at -= round * height * bump.powi(2);
                by_phi += round * height * bump * sin * count;
            }
        }
        for [middle, half] in &self.pinches {
            let off = s - middle;
            if off.abs() < *half {
                let t = 1.0 - (off / half).abs();
                let share = t * t * (3.0 - 2.0 * t);
                let share_s = -6.0 * t * (1.0 - t) * off.signum() / half;
                // It closes by 2 mm more than it must, so that no blur reaches through.
                by_s = by_s * (1.0 - share) - (at + 2.0) * share_s;
                at -= (at + 2.0) * share;
            }
        }
        (at, by_s, by_phi)
    }

    /// Returns the signed distance at a foot point, mm.
    fn distance(&self, foot: &FootPoint) -> f64 {
        let (r, r_s, r_phi) = self.radius(foot.s, || self.axis.angle(foot));
        let arm = foot.rho.max(0.4 * r.abs()).max(1.0);
        // In the tissue, and on the inside of a bend, the ridges' slope matters less and less.
        let near = 1.0 - smooth_step(0.5, 2.5, foot.rho - r);
        let (by_s, by_phi) = (near * r_s / foot.stretch.max(0.5), near * r_phi / arm);
        (foot.rho - r) / (1.0 + by_s * by_s + by_phi * by_phi).sqrt()
    }

    /// Returns the arc lengths from which to which the tube holds gas, one range for each piece.
    pub(crate) fn pieces(&self) -> Vec<[f64; 2]> {
        let mut ends = vec![0.0];
        for [middle, _] in &self.pinches {
            ends.extend([*middle, *middle]);
        }
        ends.push(self.axis.length());
        ends.chunks(2).map(|c| [c[0], c[1]]).collect()
    }

    /// Returns the least distance between this tube's lumen and another one's with these knots and radii, mm.
    pub(crate) fn clearance(&self, knots: &[(DVec3, f64)]) -> f64 {
        let own = self.balls();
        let mut least = f64::INFINITY;
        for (a, r) in &own {
            for (b, q) in knots {
                least = least.min(a.distance(*b) - r - q);
            }
        }
        least
    }

    /// Returns the balls about the axis in which the lumen lies, one for each knot.
    pub(crate) fn balls(&self) -> Vec<(DVec3, f64)> {
        let radius = |i: usize| self.axis.profile(i as f64 * self.axis.knot_step()).radius.0;
        self.axis.knots().iter().enumerate().map(|(i, c)| (*c, radius(i))).collect()
    }

    /// Returns the least distance between two stretches of the tube that are not neighbours, mm, or a negative number if a bend
    /// is so tight that the wall would fold over itself.
    pub(crate) fn own_clearance(&self) -> f64 {
        let balls = self.balls();
        let step = self.axis.knot_step();
        let mut least = f64::INFINITY;
        for (i, (a, r)) in balls.iter().enumerate() {
            if self.axis.curvature(i as f64 * step) * r > 0.9 {
                return -1.0;
            }
            for (j, (b, q)) in balls.iter().enumerate().skip(i + 1) {
                if (j - i) as f64 * step > 1.6 * (r + q) + 14.0 {
                    least = least.min(a.distance(*b) - r - q);
                }
            }
        }
        least
    }

    /// Returns the value of the lumen's content at `p`, HU.
    fn content(&self, p: DVec3, sigma: f64) -> f64 {
        match self.fluid {
            Some((level, down, hu)) => mix(GAS, hu, normal_cdf((p.dot(down) - level) / sigma)),
            None => GAS,
        }
    }

    /// Returns true if `p` is below the fluid's surface.
    pub(crate) fn is_under(&self, p: DVec3) -> bool {
        self.fluid.is_some_and(|(level, down, _)| p.dot(down) > level)
    }
}

/// The tubes of a body, and the passage through the ileocecal valve.
#[derive(Clone, Debug, Default)]
pub(crate) struct Guts {
    /// The tubes; the ileum is the first one.
    pub tubes: Vec<Gut>,
    /// The gas in the open valve.
    pub passage: Option<Plate>,
}

impl Guts {
    /// Collects the runs of knots that positions within `more` mm of `centre` depend on.
    pub(crate) fn runs_near(&self, centre: DVec3, more: f64, out: &mut Vec<Run>) {
        out.clear();
        let mut runs = Vec::new();
        for (i, tube) in self.tubes.iter().enumerate() {
            tube.axis.runs_near(centre, more, &tube.reach, &mut runs);
            out.extend(runs.drain(..).map(|run| (i, run)));
        }
    }

    /// Returns all runs.
    pub(crate) fn all_runs(&self) -> Vec<Run> {
        self.tubes.iter().enumerate().map(|(i, t)| (i, 0..t.axis.knots().len())).collect()
    }

    /// Returns what `p` is to the nearest tube, given the relevant runs; `None` in none's reach. The passage is part of the ileum.
    pub(crate) fn inside(&self, p: DVec3, runs: &[Run]) -> Option<Inside> {
        let mut best: Option<Inside> = None;
        for (i, run) in runs {
            let tube = &self.tubes[*i];
            tube.axis.feet(p, run.clone(), &tube.reach, |foot| {
                let d = tube.distance(&foot);
                if best.is_none_or(|b| d < b.d) {
                    best = Some(Inside { d, tube: *i, s: foot.s });
                }
            });
        }
        if let (Some(passage), Some(nearest)) = (&self.passage, &mut best) {
            let end = self.tubes[0].axis.length();
            if nearest.tube == 0 && nearest.s > end - 20.0 {
                let d = -passage.surface(p).d;
                if d < nearest.d {
                    *nearest = Inside { d, tube: 0, s: end };
                }
            }
        }
        best.filter(|b| b.d < DEEP)
    }

    /// Returns the content's HU at `p`, which has this nearest tube.
    pub(crate) fn content(&self, p: DVec3, inside: &Inside, sigma: f64) -> f64 {
        self.tubes[inside.tube].content(p, sigma)
    }
}

impl Phantom {
    /// Returns the value at `p` beside gut, given the values `inside` and `outside` the colon's lumen and the share of tissue
    /// between them. The gut's wall is about 2.5 mm thick, and fat surrounds it.
    pub(super) fn beside_gut(
        &self,
        p: DVec3,
        gut: &Inside,
        d: &Distances,
        [inside, outside]: [f64; 2],
        tissue: f64,
    ) -> f64 {
        let fat = mix(outside, FAT, smooth_step(2.0, 4.0, d.plain));
        let around = mix(TISSUE, mix(fat, outside, smooth_step(3.5, DEEP, gut.d)), smooth_step(2.0, 3.5, gut.d));
        let own = self.guts.content(p, gut, self.sigma);
        // In the mouth of the valve both lumens meet.
        let content = mix(inside, own, smooth_step(-1.0, 1.0, d.wall - gut.d));
        mix(content, around, tissue.min(tissue_share(gut.d, self.sigma)))
    }
}
