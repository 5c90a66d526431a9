//! The measure along a colon, and what can be asked of it.

use std::sync::Arc;

use glam::DVec3;

use crate::fields::centerline::{Centerline, NearestOnLines};
use crate::fields::lumen::Part;

/// A place farther than this from the lumen is nowhere along it, mm.
const NEAR_MM: f64 = 12.0;
/// Distances are reported in steps of this, mm.
const STEP_MM: f64 = 10.0;
/// A place's point of the line is at most this far along it from that of its cell, mm.
const NEAR_ALONG_MM: f64 = 20.0;

/// A place along the colon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlongColon {
    /// The segment of gas, or the one before it along the line.
    pub segment: usize,
    /// Distance along the line from its rectal end, mm.
    pub mm: f64,
    /// The part of the colon, if the parts are known.
    pub part: Option<&'static str>,
    /// True where the line is a guess.
    pub is_guessed: bool,
}

impl AlongColon {
    /// Returns the place in words, as lists show it: "descending, 840 mm", the part of the colon and the distance from the rectum,
    /// in steps of 10 mm. Where the line is a guess it is "about 840 mm". If the parts are not known, the segment takes their
    /// place, numbered from 0 as in files, and the distance is that from its end nearer to the rectum.
    pub fn text(&self) -> String {
        let part = self.part.map_or_else(|| format!("segment {}", self.segment), str::to_owned);
        let about = if self.is_guessed { "about " } else { "" };
        format!("{part}, {about}{:.0} mm", (self.mm / STEP_MM).round() * STEP_MM)
    }

    /// Returns [`AlongColon::text`] with the origin of the distance: "descending, 840 mm from the rectum".
    pub fn full_text(&self) -> String {
        let from = if self.part.is_some() { "the rectum" } else { "its end nearer to the rectum" };
        format!("{} from {from}", self.text())
    }
}

/// The measure along a colon.
#[derive(Clone, Debug, Default)]
pub struct Along {
    pub(super) lines: Vec<Line>,
    /// Which of their points each place of the lumen belongs to.
    pub(super) nearest: Option<Arc<NearestOnLines>>,
    /// The parts along the line, if the order is known.
    pub(super) parts: Vec<Part>,
}

/// The centerline of the colon, or of one segment.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub line: Centerline,
    /// Distance of each point from the first, mm.
    pub mm: Vec<f64>,
    /// The segment at each point.
    pub segment: Vec<u32>,
}

impl Line {
    fn is_guessed(&self, mm: f64) -> bool {
        self.line.guessed.iter().any(|[a, b]| (*a..=*b).contains(&mm))
    }
}

impl Along {
    /// Returns where a place (world, mm) is along the colon; `None` if it is farther than 12 mm from the lumen.
    pub fn of(&self, world: DVec3) -> Option<AlongColon> {
        let (line, point) = self.nearest.as_ref()?.of(world, NEAR_MM)?;
        let own @ Line { line, mm, segment } = self.lines.get(line as usize)?;
        let about = *mm.get(point as usize)?;
        let window =
            mm.partition_point(|&m| m < about - NEAR_ALONG_MM)..mm.partition_point(|&m| m <= about + NEAR_ALONG_MM);
        let square = |n: &usize| line.points[*n].distance_squared(world);
        let n = window.reduce(|a, b| if square(&b) < square(&a) { b } else { a })?;
        let part = self.part(mm[n]).map(|p| p.name);
        Some(AlongColon { segment: segment[n] as usize, mm: mm[n], part, is_guessed: own.is_guessed(mm[n]) })
    }

    /// Returns where the lumen nearest to a place (world, mm) belongs along the colon, by the shortest way through the lumen, mm: about, since
    /// the lumen is divided into cells, and in a bend the nearest point of the line may be farther on. `None` as for [`Along::of`].
    pub fn about(&self, world: DVec3) -> Option<f64> {
        let (line, point) = self.nearest.as_ref()?.of(world, NEAR_MM)?;
        self.lines.get(line as usize)?.mm.get(point as usize).copied()
    }

    /// Returns the point of the line (world, mm) at a distance along it, mm, and the direction towards the cecum there, of unit length;
    /// `None` if no one line leads from the rectum to the cecum.
    pub fn point(&self, mm: f64) -> Option<(DVec3, DVec3)> {
        let Line { line, mm: along, .. } = self.lines.first().filter(|_| self.is_whole() && mm.is_finite())?;
        let last = along.len().checked_sub(1)?;
        let n = along.partition_point(|&m| m < mm).min(last);
        // Over a few points, so that the steps of voxels do not turn the direction.
        let (a, b) = (n.saturating_sub(3), (n + 3).min(last));
        let direction = (line.points[b] - line.points[a]).try_normalize()?;
        Some((line.points[n], direction))
    }

    /// Returns the part of the colon at a distance along the line, mm; `None` if the parts are not known.
    pub fn part(&self, mm: f64) -> Option<Part> {
        self.parts.iter().find(|p| mm <= p.to_mm).or(self.parts.last()).copied()
    }

    /// Returns the parts of the colon along the line, from the rectum; empty if they are not known.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// True if one line leads from the rectum to the cecum.
    pub fn is_whole(&self) -> bool {
        !self.parts.is_empty()
    }

    /// Returns the length of the line, or of the lines, mm.
    pub fn length_mm(&self) -> f64 {
        self.lines.iter().map(|l| l.line.length_mm).sum()
    }

    /// Returns the line from the rectum to the cecum; `None` if no one line leads there.
    pub fn line(&self) -> Option<&Centerline> {
        self.lines.first().filter(|_| self.is_whole()).map(|l| &l.line)
    }

    /// Returns the line if there is only one: that from the rectum to the cecum, where the segments are in order, also if the names of the
    /// parts are not known.
    pub fn only_line(&self) -> Option<&Centerline> {
        match &self.lines[..] {
            [only] => Some(&only.line),
            _ => None,
        }
    }

    /// Returns the caliber along the line from the rectum: the distance of each point along it and the diameter of the largest ball around
    /// that point, mm. Guesses are left out.
    pub fn calibers(&self) -> impl Iterator<Item = [f64; 2]> {
        let points = |l: &Line| l.mm.iter().zip(&l.line.radius_mm).map(|(mm, r)| [*mm, 2.0 * r]).collect::<Vec<_>>();
        let line = self.lines.first();
        let is_known = move |p: &[f64; 2]| line.is_some_and(|l| !l.is_guessed(p[0]));
        line.map(points).unwrap_or_default().into_iter().filter(is_known)
    }

    /// Returns the stretches (from, to; mm along the line) that are guesses.
    pub fn guessed(&self) -> &[[f64; 2]] {
        self.lines.first().map_or(&[], |l| &l.line.guessed)
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        let line = |l: &Line| l.line.points.len() * (size_of::<DVec3>() + 2 * size_of::<f64>() + size_of::<u32>());
        self.nearest.as_ref().map_or(0, |n| n.bytes()) + self.lines.iter().map(line).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::WallDistance;
    use crate::fields::centerline::Cells;
    use crate::progress::Progress;

    #[test]
    fn a_place_is_told_in_words_and_a_guess_as_one() {
        let place = AlongColon { segment: 1, mm: 837.4, part: Some("descending"), is_guessed: false };
        assert_eq!(place.text(), "descending, 840 mm");
        assert_eq!(AlongColon { is_guessed: true, ..place }.text(), "descending, about 840 mm");
        assert_eq!(place.full_text(), "descending, 840 mm from the rectum");
        // Its number is that of the files.
        let alone = AlongColon { part: None, ..place };
        assert_eq!(alone.full_text(), "segment 1, 840 mm from its end nearer to the rectum");
    }

    /// Two limbs with a thin wall between them: beside the wall, the middle of the narrow one is nearer than that of the wide one.
    #[test]
    fn a_place_belongs_to_its_own_side_of_a_wall() {
        let walls = WallDistance::drawn([120, 60, 30], DVec3::ONE, |p| {
            let (wide, narrow) = ((p.y - 20.0).hypot(p.z - 15.0) < 13.0, (p.y - 39.0).hypot(p.z - 15.0) < 5.0);
            (5.0..115.0).contains(&p.x) && (wide || narrow)
        });
        let line = |y: f64| (10..110).map(|x| DVec3::new(f64::from(x), y, 15.0)).collect::<Vec<_>>();
        let (wide, narrow) = (line(20.0), line(39.0));
        let cells = Cells::of(&walls, 0.0, &Progress::new()).unwrap();
        let nearest = NearestOnLines::new(walls, cells, &[&wide, &narrow], &Progress::new()).unwrap();
        // Also right beside the wall, and in it, where the widest place of a cell of the other limb is nearer.
        for (x, y) in (15..105).flat_map(|x| (8..44).map(move |y| (x, y))) {
            let place = DVec3::new(f64::from(x), f64::from(y), 15.0);
            let (line, point) = nearest.of(place, NEAR_MM).unwrap();
            assert_eq!(line, u32::from(y > 33), "{place}");
            assert!((place.x - f64::from(point) - 10.0).abs() < 6.0, "{place}: {point}");
        }
        assert_eq!(nearest.of(DVec3::new(60.0, 20.0, 15.0 + 12.0 + NEAR_MM + 1.0), NEAR_MM), None);
    }
}
