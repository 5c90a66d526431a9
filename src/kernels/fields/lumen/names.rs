//! Names of the colon's parts along its way from rectum to cecum.
//!
//! The two flexures are the highest places on the left and on the right; around each, the part is called a flexure as long as the
//! centerline bends. The descending colon begins where it turns upwards in the left flank, or rises above the pelvis there if that
//! comes first, and the rectum ends where it leaves the hollow of the sacrum. Each junction has an uncertainty: half the
//! distance between where a strict and a lenient threshold put it, and no less than the coarse map's.

use std::ops::Range;

use glam::DVec3;

use super::kinds::Landmarks;

/// Distance between the sampled places on the line, mm.
const STEP_MM: f64 = 4.0;
/// Half the length over which the line's direction is measured, mm, in an adult.
const SMOOTH_MM: f64 = 18.0;
/// A flexure lies at least this far from the midline, as a share of half the body's width.
const ASIDE: f64 = 0.2;
/// How much higher a place 1 mm farther to the side counts, mm.
const SIDE_WORTH: f64 = 0.3;
/// Slope of the line, as the vertical share of its direction, at which a flexure begins, and its tolerance.
const FLEXURE_BEGINS: [f64; 2] = [0.2, 0.2];
/// Slope at which it ends: the colon leaves a flexure steeply.
const FLEXURE_ENDS: [f64; 2] = [0.92, 0.06];
/// A flexure reaches at most this far from its highest place, mm, in an adult.
const FLEXURE_MM: f64 = 85.0;
/// Slope of the line where the descending colon begins, and its tolerance.
const DESCENDING: [f64; 2] = [0.96, 0.03];
/// Length of the rectum, mm, in an adult: least, usual and most.
const RECTUM_MM: [f64; 3] = [120.0, 150.0, 200.0];
/// Length of the cecum up to the centre of the last ball, mm, in an adult, and its tolerance.
const CECUM_MM: [f64; 2] = [32.0, 15.0];
/// Minimum uncertainty of a junction, mm, in an adult.
const LEAST_MM: f64 = 14.0;

/// The names, from rectum to cecum.
pub const NAMES: [&str; 8] =
    ["rectum", "sigmoid", "descending", "splenic flexure", "transverse", "hepatic flexure", "ascending", "cecum"];

/// A part of the colon.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Part {
    /// Its name, one of [`NAMES`].
    pub name: &'static str,
    /// Where it begins along the line from the rectal end, mm.
    pub from_mm: f64,
    /// Where it ends, mm.
    pub to_mm: f64,
    /// Uncertainty of where it ends, mm; 0 at the end of the line.
    pub uncertainty_mm: f64,
}

/// The parts of a colon along a line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Names {
    /// The parts, without gaps; empty if the line is not known from rectum to cecum.
    pub parts: Vec<Part>,
    /// Places on the line (world, mm), and how far along each is, mm.
    way: Vec<(DVec3, f64)>,
}

impl Names {
    /// Names the parts along a line from rectum to cecum, world, mm.
    pub fn along(way: &[DVec3], body: &Landmarks) -> Self {
        let way = evenly(way);
        let Some(junctions) = Course { way: &way, body }.junctions() else { return Self::default() };
        let length = way.last().map_or(0.0, |w| w.1);
        let mut parts = Vec::with_capacity(NAMES.len());
        let mut from_mm = 0.0;
        for (n, name) in NAMES.into_iter().enumerate() {
            let (to_mm, uncertainty_mm) = junctions.get(n).copied().unwrap_or((length, 0.0));
            parts.push(Part { name, from_mm, to_mm, uncertainty_mm });
            from_mm = to_mm;
        }
        Self { parts, way }
    }

    /// Returns the part nearest to a place (world, mm); `None` if the parts are not known.
    pub fn at(&self, world: DVec3) -> Option<Part> {
        let along = self.along_of(world)?;
        self.parts.iter().find(|p| along <= p.to_mm).or(self.parts.last()).copied()
    }

    /// Returns how far along the line the place nearest to a position (world, mm) is.
    fn along_of(&self, world: DVec3) -> Option<f64> {
        let square = |w: &&(DVec3, f64)| w.0.distance_squared(world);
        self.way.iter().min_by(|a, b| square(a).total_cmp(&square(b))).map(|w| w.1)
    }

    /// Returns the parts with their limits along another line through the same colon, in either direction; those that it does not
    /// pass are left out.
    pub fn on(&self, line: &[DVec3]) -> Vec<Part> {
        let line = evenly(line);
        let ends = line.first().zip(line.last()).and_then(|(a, b)| self.along_of(a.0).zip(self.along_of(b.0)));
        let Some((first, last)) = ends else { return Vec::new() };
        let length = line.last().map_or(0.0, |l| l.1);
        let is_reversed = first > last;
        let place = |mm: f64| {
            let at = self.way.partition_point(|w| w.1 < mm).min(self.way.len() - 1);
            let square = |l: &&(DVec3, f64)| l.0.distance_squared(self.way[at].0);
            line.iter().min_by(|a, b| square(a).total_cmp(&square(b))).map_or(0.0, |l| l.1)
        };
        let (low, high) = (first.min(last), first.max(last));
        // Only what lies between the line's ends has a place on it.
        let mut passed: Vec<Part> = self.parts.iter().filter(|p| p.to_mm > low && p.from_mm < high).copied().collect();
        if is_reversed {
            passed.reverse();
        }
        let mut from_mm = 0.0;
        let count = passed.len();
        for (n, p) in passed.iter_mut().enumerate() {
            let ends = if is_reversed { p.from_mm } else { p.to_mm };
            let to_mm = if n + 1 == count { length } else { place(ends).max(from_mm) };
            let before = self.parts.iter().find(|o| o.to_mm == p.from_mm).map_or(0.0, |o| o.uncertainty_mm);
            let uncertainty_mm = if n + 1 == count {
                0.0
            } else if is_reversed {
                before
            } else {
                p.uncertainty_mm
            };
            *p = Part { from_mm, to_mm, uncertainty_mm, ..*p };
            from_mm = to_mm;
        }
        passed
    }
}

/// Returns places every few mm along a line, with how far along each is.
fn evenly(way: &[DVec3]) -> Vec<(DVec3, f64)> {
    let mut out: Vec<(DVec3, f64)> = way.first().map(|&p| (p, 0.0)).into_iter().collect();
    let mut along = 0.0;
    for w in way.windows(2) {
        let length = w[0].distance(w[1]);
        while let Some(last) = out.last().copied().filter(|l| l.1 + STEP_MM <= along + length) {
            let mm = last.1 + STEP_MM;
            out.push((w[0].lerp(w[1], (mm - along) / length.max(1e-9)), mm));
        }
        along += length;
    }
    if let Some((&end, last)) = way.last().zip(out.last().copied())
        && along > last.1
    {
        out.push((end, along));
    }
    out
}

/// A way through a body.
struct Course<'a> {
    way: &'a [(DVec3, f64)],
    body: &'a Landmarks,
}

impl Course<'_> {
    /// Returns the vertical share of the line's direction at place `n`: 1 straight up, −1 straight down.
    fn slope(&self, n: usize) -> f64 {
        let reach = (SMOOTH_MM * self.body.scale() / STEP_MM).ceil() as usize;
        let (a, b) = (n.saturating_sub(reach), (n + reach).min(self.way.len() - 1));
        let d = self.way[b].0 - self.way[a].0;
        d.z / d.length().max(1e-9)
    }

    /// Returns the highest place on one side: `side` is 1 on the left, −1 on the right.
    fn highest(&self, among: Range<usize>, side: f64) -> Option<usize> {
        let worth = |n: usize| {
            let p = self.way[n].0;
            p.z + SIDE_WORTH * side * (p.x - self.body.midline)
        };
        let aside = among.filter(|&n| side * self.body.aside(self.way[n].0) > ASIDE);
        aside.reduce(|a, b| if worth(b) > worth(a) { b } else { a })
    }

    /// Returns where the slope, times `sign`, first exceeds `limit` from place `from` on in steps of `step`, at most to `last`.
    fn first(&self, from: usize, step: isize, last: usize, sign: f64, limit: f64) -> usize {
        let mut n = from;
        while n != last && sign * self.slope(n) < limit {
            n = n.saturating_add_signed(step);
        }
        n
    }

    /// Returns a junction between a strict and a lenient limit: how far along, and its uncertainty, mm.
    fn between(&self, find: impl Fn(f64) -> usize, [limit, slack]: [f64; 2]) -> (f64, f64) {
        let at = |limit: f64| self.way[find(limit)].1;
        let spread = 0.5 * (at(limit + slack) - at(limit - slack)).abs();
        (at(limit), spread.max(LEAST_MM * self.body.scale()))
    }

    /// Returns the seven junctions in order: how far along, and the uncertainty, mm.
    fn junctions(&self) -> Option<[(f64, f64); 7]> {
        let (scale, last) = (self.body.scale(), self.way.len().checked_sub(1)?);
        let length = self.way[last].1;
        let steps = |mm: f64| (mm * scale / STEP_MM).round() as usize;
        // The splenic flexure is the first to be reached, and left of the hepatic one.
        let right = self.highest(0..last + 1, -1.0)?;
        let left = self.highest(0..right, 1.0)?;
        let right = self.highest(left..last + 1, -1.0)?;
        let reach = steps(FLEXURE_MM);
        let flexure = |top: usize| {
            let begins = self.between(|l| self.first(top, -1, top.saturating_sub(reach), 1.0, l), FLEXURE_BEGINS);
            let ends = self.between(|l| self.first(top, 1, (top + reach).min(last), -1.0, l), FLEXURE_ENDS);
            [begins, ends]
        };
        let ([splenic, transverse], [hepatic, ascending]) = (flexure(left), flexure(right));
        // Down the left flank from where the flexure begins.
        let upright = self.way.partition_point(|w| w.1 < splenic.0).saturating_sub(1);
        let lowest = self.way.partition_point(|w| w.1 < RECTUM_MM[0] * scale).min(upright);
        let in_flank = |n: usize| self.body.aside(self.way[n].0) > ASIDE;
        let foot = |limit: f64| {
            let down = |mut n: usize, goes_on: &dyn Fn(usize) -> bool| {
                while n > lowest && in_flank(n) && goes_on(n) {
                    n -= 1;
                }
                n
            };
            let steep = down(upright, &|n| self.slope(n) < limit);
            down(steep, &|n| self.slope(n) >= limit)
        };
        let mut descending = self.between(foot, DESCENDING);
        // In the flank above the pelvis it is the descending colon, whatever its course: it may lie in loops.
        if let Some(crest) = self.body.pelvis {
            let mut n = upright;
            while n > lowest && in_flank(n) && self.way[n].0.z > crest {
                n -= 1;
            }
            let apart = descending.0 - self.way[n].1;
            if apart > 0.0 {
                descending = (self.way[n].1, descending.1.max(0.5 * apart));
            }
        }
        // The rectum ends where the line turns forward most, within its usual length.
        let sharpest = RECTUM_MM[1] * scale;
        let sigmoid = (sharpest.min(descending.0), 0.25 * (RECTUM_MM[2] - RECTUM_MM[0]) * scale);
        let cecum = ((length - CECUM_MM[0] * scale).max(ascending.0), CECUM_MM[1] * scale);
        let mut all = [sigmoid, descending, splenic, transverse, hepatic, ascending, cecum];
        for n in 1..all.len() {
            all[n].0 = all[n].0.max(all[n - 1].0);
        }
        Some(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checks::cases;
    use crate::fields::lumen;
    use crate::phantom::{PhantomSettings, Size};
    use crate::progress::Progress;
    use crate::shared::shared;

    /// Returns the errors of the seven junctions of a phantom, mm along its true axis, and the uncertainties told.
    fn errors(settings: &PhantomSettings) -> Vec<(f64, f64)> {
        let (phantom, volume) = shared(settings);
        let lumen = lumen::find(&volume, &Progress::new()).unwrap();
        let truth = phantom.truth();
        let names = lumen.names();
        assert_eq!(names.parts.len(), NAMES.len(), "seed {}: ordered {}", settings.seed, lumen.ordered);
        let found = names.on(&truth.centerline);
        let pairs = found.iter().zip(&truth.names).take(7);
        pairs.map(|(a, b)| (a.to_mm - b.to_mm, a.uncertainty_mm)).collect()
    }

    #[test]
    fn junctions_are_where_a_phantom_has_them() {
        for seed in 1..=cases(3, 1) {
            let collapsed = seed == 2;
            let settings = PhantomSettings { size: Size::Small, seed, collapsed, ..PhantomSettings::default() };
            for (n, (error, uncertainty)) in errors(&settings).into_iter().enumerate() {
                println!("seed {seed}: {} ends {error:.0} mm off, told within {uncertainty:.0} mm", NAMES[n]);
                assert!(error.abs() < 20.0 && error.abs() < 2.5 * uncertainty, "{}: {error} mm", NAMES[n]);
            }
        }
    }

    #[test]
    fn a_line_from_cecum_to_rectum_has_the_names_in_its_own_order() {
        let settings = PhantomSettings { size: Size::Small, ..PhantomSettings::default() };
        let (phantom, volume) = shared(&settings);
        let names = lumen::find(&volume, &Progress::new()).unwrap().names();
        let mut line = phantom.truth().centerline;
        let there = names.on(&line);
        line.reverse();
        let back = names.on(&line);
        let length = there[7].to_mm;
        assert_eq!(there.iter().map(|p| p.name).collect::<Vec<_>>(), NAMES);
        for (a, b) in there.iter().zip(back.iter().rev()) {
            assert_eq!(a.name, b.name);
            assert!((a.from_mm - (length - b.to_mm)).abs() < 2.0 * STEP_MM, "{a:?}, {b:?}");
        }
        let half = names.on(&line[line.len() / 2..]);
        assert!(half.len() < 8 && half.last().unwrap().name == "rectum", "{half:?}");
        assert_eq!(names.at(line[0]).unwrap().name, "cecum");
        assert_eq!((Names::default().at(DVec3::ZERO), Names::default().on(&line)), (None, Vec::new()));
    }
}
