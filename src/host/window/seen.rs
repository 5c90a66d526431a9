//! What of the wall was seen, in a window: watched and painted once somebody asks for it, and the list of the patches that were missed.
//!
//! Nothing is computed or kept before somebody asks. The wall is extracted and the views until then are looked at in the background.

mod jobs;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use bevy_ecs::prelude::Entity;
use glam::DVec3;

use super::background::{Background, BackgroundTask};
use super::job::Job;
use crate::app::{FlightApp, Setup};
use crate::components::review::ReviewStop;
use crate::coverage::{CoveragePaint, LiveCoverage, Missed};
use crate::error::Result;
use crate::fields::{Lumen, WallDistance};

/// What is done in the background.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Doing {
    /// The wall is extracted, and the views until then are looked at.
    Beginning,
    /// The missed patches are listed.
    Listing,
    /// The distances to the wall are computed, by which ways are planned.
    Preparing,
}

/// What comes out of it.
enum Done {
    Begun(Box<Watched>),
    Listed(Vec<Patch>),
    Prepared(Arc<Lumen>, Arc<WallDistance>),
}

/// What of the wall was seen, in a window.
pub(crate) struct Seen {
    is_painted: bool,
    task: BackgroundTask<Done>,
    /// What it does, or did last.
    doing: Doing,
    /// The missed patches, as they were when somebody asked, in the order of the flight.
    list: Option<Vec<Missed>>,
    /// Which of them a review visits: the others are shown by its other stops, or cannot be looked at.
    is_visited: Vec<bool>,
    current: Option<usize>,
    /// The patch (world, mm) that the camera was sent to.
    pub(crate) goes_to: Option<DVec3>,
    /// True while a review is under way that goes on in the next segment once it is over.
    pub(crate) goes_on: bool,
    /// The segments that it was in.
    pub(crate) reviewed: BTreeSet<usize>,
    /// The paint, while it is not shown.
    paint: Option<CoveragePaint>,
    /// What was seen of the scan that is not shown now.
    aside: Option<Watched>,
    /// Whether the wall that was last begun is that of the scan beside the one that is flown; `None` once it is watched.
    begun_for: Option<bool>,
    /// What follows once the patches are listed.
    then: Then,
}

/// What was seen of a wall, and its paint.
type Watched = (LiveCoverage, CoveragePaint);

/// A missed patch, and whether a review visits it.
type Patch = (Missed, bool);

/// What has come out of the background.
pub(crate) enum News {
    /// The flight is watched from now on.
    Begun,
    /// The missed patches are listed, and what is to follow.
    Listed(Then),
    /// A way can be planned, and where to.
    Prepared(Then),
}

/// What follows on a list of the missed patches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Then {
    Nothing,
    /// Fly to the next one.
    Next,
    /// Fly past all of them.
    Review,
}

impl Seen {
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            is_painted: false,
            task: BackgroundTask::new(now),
            doing: Doing::Beginning,
            list: None,
            is_visited: Vec::new(),
            current: None,
            goes_to: None,
            goes_on: false,
            reviewed: BTreeSet::new(),
            paint: None,
            aside: None,
            begun_for: None,
            then: Then::Nothing,
        }
    }

    /// True if what was not seen is painted, as soon as it is known.
    pub(crate) fn is_painted(&self) -> bool {
        self.is_painted
    }

    /// Shows or hides the paint. What is needed is found in the background. `other` is the scan that is shown, if it is not the one that
    /// is flown through.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub(crate) fn show(
        &mut self,
        shown: bool,
        flight: &mut FlightApp,
        other: Option<Entity>,
        background: &Background,
        now: Instant,
    ) -> Result<()> {
        self.is_painted = shown;
        if shown && flight.camera::<LiveCoverage>().is_none() {
            if !self.is_beginning() {
                self.begin(flight, other, background, now);
            }
            return Ok(());
        }
        if !shown {
            self.paint = flight.paint_coverage(None)?;
        } else if let Some(coverage) = flight.camera::<LiveCoverage>() {
            // Another lumen has another wall.
            let kept = self.paint.take().filter(|p| p.is_of(coverage));
            let paint = kept.unwrap_or_else(|| CoveragePaint::new(coverage));
            flight.paint_coverage(Some(paint))?;
        }
        Ok(())
    }

    /// Goes over to the wall of the scan that is shown, once another one is. The views until then are looked at again, in the background.
    pub(crate) fn follow(&mut self, flight: &FlightApp, other: Option<Entity>, background: &Background, now: Instant) {
        let is_beginning = self.is_beginning();
        let is_watched = match flight.camera::<LiveCoverage>() {
            Some(watched) => watched.is_beside() == other.is_some(),
            // Nobody has asked, or what was asked for is not there yet.
            None if !is_beginning => return,
            None => false,
        };
        if is_watched {
            // The reader is back at the scan that was shown before.
            if is_beginning && self.begun_for != Some(other.is_some()) {
                self.task.stop();
            }
            if !self.is_beginning() {
                self.begun_for = None;
            }
        } else if self.begun_for != Some(other.is_some()) && (is_beginning || self.next().is_none()) {
            self.begin(flight, other, background, now);
        }
    }

    /// Begins to watch the wall of the scan that is shown.
    fn begin(&mut self, flight: &FlightApp, other: Option<Entity>, background: &Background, now: Instant) {
        self.begun_for = Some(other.is_some());
        self.aside.take_if(|(coverage, _)| !coverage.belongs_to(flown(flight)));
        let known = self.aside.as_ref().filter(|(coverage, _)| coverage.is_beside() == other.is_some()).cloned();
        let job = match known {
            Some((coverage, paint)) => jobs::catch_up(coverage, Some(paint), flight, background),
            None => jobs::begin(flight, other, background),
        };
        self.go_over(Doing::Beginning, job, now);
    }

    /// True while the wall is extracted, or the views until now are looked at.
    fn is_beginning(&self) -> bool {
        self.doing == Doing::Beginning && self.task.is_working()
    }

    /// Goes over to other work. The former one is cancelled.
    fn go_over(&mut self, doing: Doing, job: Result<Job<Done>>, now: Instant) {
        self.doing = doing;
        self.task.go_over(job, now);
    }

    /// Looks at the wall that is watched from all views that it has not taken, in the background, unless that is busy or has failed.
    pub(crate) fn look_again(&mut self, flight: &FlightApp, background: &Background, now: Instant) {
        if self.task.is_working() || self.task.failed().is_some() {
            return;
        }
        if let Some(coverage) = flight.camera::<LiveCoverage>() {
            self.begun_for = Some(coverage.is_beside());
            let job = jobs::catch_up(coverage.clone(), None, flight, background);
            self.go_over(Doing::Beginning, job, now);
        }
    }

    /// Takes what was found of a wall.
    fn adopt(
        &mut self,
        (coverage, paint): Watched,
        flight: &mut FlightApp,
        other: Option<Entity>,
        background: &Background,
        now: Instant,
    ) -> Result<Option<News>> {
        if !coverage.belongs_to(flown(flight)) {
            // Meanwhile the reader has given kinds to gas.
            self.begin(flight, other, background, now);
            return Ok(None);
        }
        if flight.survey().trail().is_some_and(|t| coverage.lags(t.views())) {
            let job = jobs::catch_up(coverage, Some(paint), flight, background);
            self.go_over(Doing::Beginning, job, now);
            return Ok(None);
        }
        // What was watched until now is put aside, unless it is of the same wall.
        let before = flight.camera::<LiveCoverage>().filter(|before| !paint.is_of(before)).cloned();
        flight.watch_coverage(coverage)?;
        let painted = if self.is_painted { flight.paint_coverage(Some(paint))? } else { self.paint.replace(paint) };
        if let Some(coverage) = before {
            let paint = painted.filter(|paint| paint.is_of(&coverage));
            let paint = paint.unwrap_or_else(|| CoveragePaint::new(&coverage));
            self.aside = Some((coverage, paint));
        }
        (self.list, self.current, self.begun_for) = (None, None, None);
        self.is_visited.clear();
        Ok(Some(News::Begun))
    }

    /// Lists the missed patches in the background. Does nothing before the flight is watched.
    pub(crate) fn list_missed(&mut self, then: Then, flight: &FlightApp, background: &Background, now: Instant) {
        self.then = then;
        if self.next().is_some() {
            return;
        }
        if let Some(coverage) = flight.camera::<LiveCoverage>() {
            let job = jobs::list(coverage, flight, background);
            self.go_over(Doing::Listing, job, now);
        }
    }

    /// Takes what has come out of the background.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub(crate) fn take(
        &mut self,
        flight: &mut FlightApp,
        other: Option<Entity>,
        background: &Background,
        now: Instant,
    ) -> Result<Option<News>> {
        let Some(Ok((done, _))) = self.task.take(now) else { return Ok(None) };
        Ok(Some(match done {
            Done::Begun(watched) => return self.adopt(*watched, flight, other, background, now),
            Done::Listed(list) => {
                let (list, is_visited) = list.into_iter().unzip();
                (self.list, self.is_visited, self.current) = (Some(list), is_visited, None);
                News::Listed(self.then)
            }
            Done::Prepared(gas, walls) => {
                flight.adopt_walls(gas, walls);
                News::Prepared(self.then)
            }
        }))
    }

    /// Returns when the progress has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.task.next()
    }

    /// Returns what is being done, or why it failed; `None` if nothing is.
    pub(crate) fn state(&self) -> Option<std::result::Result<&'static str, &str>> {
        let text = match self.doing {
            Doing::Beginning => "computing coverage",
            Doing::Listing => "listing what was missed",
            Doing::Preparing => "preparing the path",
        };
        self.task.failed().map(Err).or(self.task.is_working().then_some(Ok(text)))
    }

    /// Returns the missed patches in the order of the flight; `None` before they were listed.
    pub(crate) fn list(&self) -> Option<&[Missed]> {
        self.list.as_deref()
    }

    /// Returns the number of the patch that is shown.
    pub(crate) fn current(&self) -> Option<usize> {
        self.current
    }

    /// Chooses a patch.
    pub(crate) fn choose(&mut self, n: usize) -> Option<&Missed> {
        let patch = self.list.as_ref()?.get(n)?;
        self.current = Some(n);
        Some(patch)
    }

    /// Returns the number of the next patch that the flight has still not seen and that can be looked at: after the one that is shown,
    /// from the first again after the last. If none is shown yet, the one nearest to the camera (world, mm).
    pub(crate) fn next_missed(&self, coverage: &LiveCoverage, camera: DVec3) -> Option<usize> {
        let list = self.list.as_ref()?;
        let is_left = |&n: &usize| list[n].look_from.is_some() && coverage.share_of(&list[n].triangles) < 0.5;
        let Some(first) = self.current.map(|n| n + 1) else {
            let square = |n: usize| list[n].position.distance_squared(camera);
            return (0..list.len()).filter(is_left).min_by(|&a, &b| square(a).total_cmp(&square(b)));
        };
        (first..list.len()).chain(0..first.min(list.len())).find(is_left)
    }

    /// Prepares to plan a way, in the background if that takes long. Returns true if nothing is to be done.
    pub(crate) fn prepare_tour(
        &mut self,
        then: Then,
        flight: &FlightApp,
        background: &Background,
        now: Instant,
    ) -> bool {
        self.then = then;
        if flight.knows_walls_to_tour() || self.next().is_some() {
            return flight.knows_walls_to_tour();
        }
        self.go_over(Doing::Preparing, jobs::prepare(flight, background), now);
        false
    }

    /// Returns the stops of a review in the gas that is flown, and how many are left elsewhere: the places to look from at what was
    /// not seen since it was listed. As in a review without a window, no patch has one that the other stops show.
    pub(crate) fn stops(&self, flight: &FlightApp) -> (Vec<ReviewStop>, usize) {
        let (here, elsewhere): (Vec<&Missed>, Vec<&Missed>) = self.left(flight).partition(|m| is_here(m, flight));
        let stop = |m: &Missed| Some(ReviewStop::new(m.look_from?.position, Some(m.position)));
        (here.into_iter().filter_map(stop).collect(), elsewhere.len())
    }

    /// Returns the segments other than the flown one in which a review has places to look at.
    pub(crate) fn segments_left(&self, flight: &FlightApp) -> BTreeSet<usize> {
        self.left(flight).filter(|m| !is_here(m, flight)).filter_map(|m| segment_of(m, flight)).collect()
    }

    /// Returns the patches that a review visits and that were not seen since they were listed.
    fn left<'a>(&'a self, flight: &'a FlightApp) -> impl Iterator<Item = &'a Missed> {
        let coverage = flight.camera::<LiveCoverage>();
        let visited = self.list.iter().flatten().zip(&self.is_visited).filter(|(_, is_visited)| **is_visited);
        visited.map(|v| v.0).filter(move |m| coverage.is_some_and(|c| c.share_of(&m.triangles) < 0.5))
    }

    /// Returns how many of the listed patches lie in the gas that is flown.
    pub(crate) fn count_here(&self, flight: &FlightApp) -> usize {
        self.list.iter().flatten().filter(|m| is_here(m, flight)).count()
    }

    /// Marks for slices: another number once they have to be drawn anew. `None` while nothing is painted.
    pub(crate) fn marks(&self, flight: &FlightApp) -> Option<u64> {
        let coverage = flight.camera::<LiveCoverage>().filter(|_| self.is_painted)?;
        // Not for each patch that comes into sight.
        Some((coverage.share() * 1000.0) as u64)
    }
}

/// True if a patch lies in the segment that is flown, or in the one body of gas that is.
fn is_here(patch: &Missed, flight: &FlightApp) -> bool {
    flight.setup().plan.segment.is_none_or(|flown| segment_of(patch, flight) == Some(flown))
}

/// Returns the segment that a patch is looked at from, or lies in.
fn segment_of(patch: &Missed, flight: &FlightApp) -> Option<usize> {
    let lumen = &flight.setup().lumen;
    let looked_from = patch.look_from.and_then(|from| lumen.segment_at(from.position));
    // The segments of a scan that is shown beside are others.
    let is_beside = flight.camera::<LiveCoverage>().is_some_and(LiveCoverage::is_beside);
    looked_from.or(patch.along.filter(|_| !is_beside).map(|a| a.segment))
}

/// Returns the gas that is flown.
fn flown(flight: &FlightApp) -> &Arc<Lumen> {
    let Setup { lumen, plan, .. } = flight.setup();
    plan.gas.as_ref().unwrap_or(lumen)
}
