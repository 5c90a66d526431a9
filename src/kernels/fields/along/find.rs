//! Measures along a lumen.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;

use super::model::{Along, Line};
use crate::error::Result;
use crate::fields::centerline::{self, Cells, Centerline, End, NearestOnLines};
use crate::fields::cleanse::Changes;
use crate::fields::lumen::{self, AsScanned, Lumen};
use crate::fields::{Through, Values, WallDistance, connection};
use crate::progress::Progress;
use crate::volume::Volume;

impl Lumen {
    /// Returns the measure along this lumen, found in `volume`. The first call computes it: in the scan as scanned, if it was
    /// cleansed since, so that both give the same distances.
    ///
    /// # Errors
    /// As [`Along::new`].
    pub fn along(&self, volume: &Volume, progress: &Progress) -> Result<Arc<Along>> {
        if let Some(known) = self.along.get() {
            return Ok(Arc::clone(known));
        }
        let found = match &self.scanned {
            Some(scanned) => scanned.along(volume, progress)?.in_lumen(self),
            None => Along::new(volume, self, progress)?,
        };
        Ok(Arc::clone(self.along.get_or_init(|| Arc::new(found))))
    }

    /// Same as [`Lumen::along`], of a lumen found in `volume` before `changes` were exchanged with its values.
    ///
    /// # Errors
    /// As [`Along::new`].
    #[doc(hidden)]
    pub fn along_before(&self, volume: &Volume, changes: &Changes, progress: &Progress) -> Result<Arc<Along>> {
        if let Some(known) = self.along.get() {
            return Ok(Arc::clone(known));
        }
        let found = Along::of_values(&Values::before(volume, changes), self, progress)?;
        Ok(Arc::clone(self.along.get_or_init(|| Arc::new(found))))
    }

    /// Takes over the measure along the lumen of the scan as scanned, if it has been computed, so that both give the same
    /// distances.
    #[doc(hidden)]
    pub fn keep_along(&self, before: &Self) {
        if let Some(along) = before.along.get() {
            self.along.get_or_init(|| Arc::new(along.in_lumen(self)));
        }
    }
}

impl AsScanned {
    /// Returns the measure, given the cleansed scan.
    fn along(&self, volume: &Volume, progress: &Progress) -> Result<Arc<Along>> {
        let changes = &self.cleansed.changes;
        let Some(lumen) = &self.lumen else {
            let volume = changes.applied(volume);
            return lumen::find_told(&volume, &self.told, progress)?.along(&volume, progress);
        };
        lumen.along_before(volume, changes, progress)
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
}

impl Along {
    /// Returns the same measure with the segments of another lumen of the same colon.
    fn in_lumen(&self, lumen: &Lumen) -> Self {
        let all = 0..lumen.segments.len();
        let lines = self.lines.iter().map(|l| Line::new(l.line.clone(), lumen, all.clone()));
        Self { lines: lines.collect(), ..self.clone() }
    }

    /// Finds the centerline of a lumen found in `volume`, and what belongs to each of its points.
    ///
    /// # Errors
    /// Returns status 4 if interrupted, status 3 if there are more voxels than can be numbered.
    pub fn new(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Self> {
        Self::of_values(&Values::of(volume), lumen, progress)
    }

    fn of_values(values: &Values<'_>, lumen: &Lumen, progress: &Progress) -> Result<Self> {
        if lumen.segments.is_empty() {
            return Ok(Self::default());
        }
        let walls = WallDistance::of_values(values, lumen, Through::GasAndFluid, progress)?;
        let mut cells = Cells::of(&walls, 0.0, progress)?;
        // They are gathered from pieces, which are as large.
        colvis_scan::memory::release();
        let all = 0..lumen.segments.len();
        let whole = if lumen.ordered {
            let guesses = || connection::guesses_in(values, lumen, all.clone(), progress);
            let ends = [lumen.segments[0].ends[0], lumen.segments[all.end - 1].ends[1]].map(End::Tip);
            match centerline::over_cells(&walls, &mut cells, ends, guesses, progress) {
                Ok(line) => Some(line),
                Err(e) if progress.is_cancelled() => return Err(e),
                Err(_) => None,
            }
        } else {
            None
        };
        let lines = match whole {
            Some(line) => vec![Line::new(line, lumen, all)],
            None => Self::by_segment(&walls, &mut cells, lumen, progress)?,
        };
        let parts = match &lines[..] {
            [only] => lumen.names().on(&only.line.points),
            _ => Vec::new(),
        };
        let points: Vec<&[DVec3]> = lines.iter().map(|l| &l.line.points[..]).collect();
        let nearest = Some(Arc::new(NearestOnLines::new(walls, cells, &points, progress)?));
        Ok(Self { lines, nearest, parts })
    }

    /// Finds a line through each segment.
    fn by_segment(walls: &WallDistance, cells: &mut Cells, lumen: &Lumen, progress: &Progress) -> Result<Vec<Line>> {
        let mut lines = Vec::with_capacity(lumen.segments.len());
        for (n, segment) in lumen.segments.iter().enumerate() {
            progress.check()?;
            let ends = segment.ends.map(End::Tip);
            let line = match centerline::over_cells(walls, cells, ends, || Ok(Vec::new()), progress) {
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
}
