//! Where a place is along the colon: the one measure that every command, panel and file uses.
//!
//! It is the distance along the centerline of the whole colon, from its rectal end, as `colvis centerline` writes it. Where two
//! segments of gas are joined by nothing, the line follows a guess, which is marked. Without a known order, each segment has a line
//! of its own.
//!
//! A place belongs to the stretch of the line that is nearest *through the lumen*, not through a wall: every cell of the lumen (see
//! [`centerline`]) takes the point of the line with the shortest path to it, and a place takes that of its nearest voxel's
//! cell. It is then as far along as the nearest point of the line within [`NEAR_ALONG_MM`] of that one. Beside a thin wall between
//! two limbs, or in a sharp bend, the nearest point in space may be another.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;

use super::centerline::{self, Centerline, End, NearestOnLines};
use super::cleanse::Cleansed;
use super::lumen::{self, Lumen, Part, Told};
use super::{Through, WallDistance, connection};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

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
    /// Returns the place in words, as lists tell it: "descending, 840 mm", the part of the colon and the distance from the rectum, in
    /// steps of 10 mm. Where the line is a guess it is "about 840 mm". If the parts are not known, the segment takes their place,
    /// numbered from 0 as in files, and the distance is that from its end nearer to the rectum.
    pub fn text(&self) -> String {
        let part = self.part.map_or_else(|| format!("segment {}", self.segment), str::to_owned);
        let about = if self.is_guessed { "about " } else { "" };
        format!("{part}, {about}{:.0} mm", (self.mm / STEP_MM).round() * STEP_MM)
    }

    /// Returns what [`AlongColon::text`] tells, and from where: "descending, 840 mm from the rectum".
    pub fn full_text(&self) -> String {
        let from = if self.part.is_some() { "the rectum" } else { "its end nearer to the rectum" };
        format!("{} from {from}", self.text())
    }
}

/// The measure along a colon.
#[derive(Clone, Debug, Default)]
pub struct Along {
    lines: Vec<Line>,
    /// Which of their points each place of the lumen belongs to.
    nearest: Option<Arc<NearestOnLines>>,
    /// The parts along the line, if the order is known.
    parts: Vec<Part>,
}

/// The centerline of the colon, or of one segment.
#[derive(Clone, Debug)]
struct Line {
    line: Centerline,
    /// Distance of each point from the first, mm.
    mm: Vec<f64>,
    /// The segment at each point.
    segment: Vec<u32>,
}

/// A scan before its tag was taken out: the measure is that of the scan as it is in its file, whatever is shown.
#[derive(Clone, Debug)]
pub(super) struct AsScanned {
    /// What was taken out. Its changes hold the values that the scan had.
    pub cleansed: Arc<Cleansed>,
    /// The kinds that the reader gave to gas.
    pub told: Vec<Told>,
    /// The lumen in it, if that is known.
    pub lumen: Option<Arc<Lumen>>,
}

impl AsScanned {
    /// Returns the measure, given the scan without tag.
    pub(super) fn along(&self, volume: &Volume, progress: &Progress) -> Result<Arc<Along>> {
        if let Some(known) = self.lumen.as_ref().and_then(|l| l.known_along()) {
            return Ok(known);
        }
        let volume = self.cleansed.changes.applied(volume);
        match &self.lumen {
            Some(lumen) => lumen.along(&volume, progress),
            None => lumen::find_told(&volume, &self.told, progress)?.along(&volume, progress),
        }
    }
}

impl Line {
    fn new(line: Centerline, lumen: &Lumen, segments: Range<usize>) -> Self {
        let mut mm = Vec::with_capacity(line.points.len());
        let mut sum = 0.0;
        for (n, &p) in line.points.iter().enumerate() {
            sum += n.checked_sub(1).map_or(0.0, |before| line.points[before].distance(p));
            mm.push(sum);
        }
        let mut last = segments.start as u32;
        let segment = line.points.iter().map(|&p| {
            last = lumen.segment_at(p).filter(|s| segments.contains(s)).map_or(last, |s| s as u32);
            last
        });
        Self { segment: segment.collect(), mm, line }
    }

    fn is_guessed(&self, mm: f64) -> bool {
        self.line.guessed.iter().any(|[a, b]| (*a..=*b).contains(&mm))
    }
}

impl Along {
    /// Returns the same measure with the segments of another lumen of the same colon.
    pub(in crate::fields) fn in_lumen(&self, lumen: &Lumen) -> Self {
        let all = 0..lumen.segments.len();
        let lines = self.lines.iter().map(|l| Line::new(l.line.clone(), lumen, all.clone()));
        Self { lines: lines.collect(), ..self.clone() }
    }

    /// Finds the centerline of a lumen found in `volume`, and what belongs to each of its points.
    ///
    /// # Errors
    /// Returns status 4 if interrupted, status 3 if there are more voxels than can be numbered.
    pub fn new(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Self> {
        if lumen.segments.is_empty() {
            return Ok(Self::default());
        }
        let walls = WallDistance::of_lumen(volume, lumen, Through::GasAndFluid, progress)?;
        let all = 0..lumen.segments.len();
        let whole = if lumen.ordered {
            let guesses = connection::guesses(volume, lumen, all.clone(), progress)?;
            let ends = [lumen.segments[0].ends[0], lumen.segments[all.end - 1].ends[1]].map(End::Tip);
            match centerline::between(&walls, ends[0], ends[1], &guesses, progress) {
                Ok(line) => Some(line),
                Err(e) if progress.is_cancelled() => return Err(e),
                Err(_) => None,
            }
        } else {
            None
        };
        let lines = match whole {
            Some(line) => vec![Line::new(line, lumen, all)],
            None => Self::by_segment(&walls, lumen, progress)?,
        };
        let parts = match &lines[..] {
            [only] => lumen.names().on(&only.line.points),
            _ => Vec::new(),
        };
        let points: Vec<&[DVec3]> = lines.iter().map(|l| &l.line.points[..]).collect();
        let nearest = Some(Arc::new(NearestOnLines::new(&walls, &points, progress)?));
        Ok(Self { lines, nearest, parts })
    }

    /// Finds a line through each segment.
    fn by_segment(walls: &WallDistance, lumen: &Lumen, progress: &Progress) -> Result<Vec<Line>> {
        let mut lines = Vec::with_capacity(lumen.segments.len());
        for (n, segment) in lumen.segments.iter().enumerate() {
            progress.check()?;
            let [a, b] = segment.ends.map(End::Tip);
            let line = match centerline::between(walls, a, b, &[], progress) {
                Ok(line) => line,
                Err(e) if progress.is_cancelled() => return Err(e),
                // Its ends are in one voxel, or it is too narrow to have a line: the coarse way.
                Err(_) => Centerline { points: segment.way.clone(), ..Centerline::default() },
            };
            if !line.points.is_empty() {
                lines.push(Line::new(line, lumen, n..n + 1));
            }
        }
        Ok(lines)
    }

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
    use crate::checks::cases;
    use crate::fields::lumen;
    use crate::phantom::{PhantomSettings, Size};
    use crate::shared::shared;

    /// The line that `colvis centerline` writes.
    fn line_of(volume: &Volume, lumen: &Lumen) -> Centerline {
        let progress = Progress::new();
        let walls = WallDistance::of_lumen(volume, lumen, Through::GasAndFluid, &progress).unwrap();
        let guesses = connection::guesses(volume, lumen, 0..lumen.segments.len(), &progress).unwrap();
        let ends = [lumen.segments[0].ends[0], lumen.segments[lumen.segments.len() - 1].ends[1]].map(End::Tip);
        centerline::between(&walls, ends[0], ends[1], &guesses, &progress).unwrap()
    }

    #[test]
    fn a_place_is_as_far_along_as_the_centerline_says() {
        let phantoms = [(false, false, 1), (true, false, 2), (true, true, 3)];
        for (fluid, collapsed, seed) in phantoms.into_iter().take(cases(3, 1)) {
            let settings = PhantomSettings { size: Size::Small, fluid, collapsed, seed, ..PhantomSettings::default() };
            let (_, volume) = shared(&settings);
            let found = lumen::find(&volume, &Progress::new()).unwrap();
            assert!(found.ordered, "{seed}");
            let along = found.along(&volume, &Progress::new()).unwrap();
            let line = line_of(&volume, &found);
            assert_eq!(along.length_mm(), line.length_mm);
            assert_eq!(along.guessed().len(), line.guessed.len());
            assert!(Arc::ptr_eq(&along, &found.along(&volume, &Progress::new()).unwrap()));
            let parts = found.names().on(&line.points);
            let mut mm = 0.0;
            for (n, &p) in line.points.iter().enumerate() {
                mm += n.checked_sub(1).map_or(0.0, |before| line.points[before].distance(p));
                if line.guessed.iter().any(|[a, b]| (a - 15.0..=b + 15.0).contains(&mm)) {
                    continue;
                }
                let side = p + DVec3::new(0.5, -0.3, 0.4) * line.radius_mm[n];
                for (place, most) in [(p, 1.5), (side, 15.0)] {
                    let found = along.of(place).unwrap();
                    assert!((found.mm - mm).abs() < most, "{seed}: {} for {mm}", found.mm);
                    let part = parts.iter().find(|p| found.mm <= p.to_mm).map(|p| p.name);
                    assert_eq!(found.part, part.or(parts.last().map(|p| p.name)));
                }
            }
            for nowhere in [DVec3::NAN, DVec3::INFINITY, DVec3::splat(-1e300), DVec3::splat(1e4)] {
                assert_eq!(along.of(nowhere), None);
            }
        }
        assert_eq!(Along::default().of(DVec3::ZERO), None);
    }

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
        let nearest = NearestOnLines::new(&walls, &[&wide, &narrow], &Progress::new()).unwrap();
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
