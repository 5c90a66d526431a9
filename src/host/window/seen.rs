//! What of the wall was seen, in a window: watched and painted once somebody asks for it, and the list of the patches that were missed.
//!
//! Nothing is computed or kept before somebody asks. The wall is extracted and the views until then are looked at in the background.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DVec3;

use super::job::Job;
use super::screenshot_renderer::WakeUp;
use crate::app::{FlightApp, Setup};
use crate::components::review::ReviewStop;
use crate::coverage::{CoveragePaint, LiveCoverage, Missed, missed};
use crate::error::Result;
use crate::fields::{Lumen, Through, WallDistance};
use crate::progress::Progress;

/// Time between two looks at the progress.
const LOOKS: Duration = Duration::from_millis(200);

enum Stage {
    Idle,
    /// The wall is extracted, and the views until then are looked at.
    Beginning(Job<(LiveCoverage, CoveragePaint)>),
    /// The missed patches are listed.
    Listing(Job<Vec<Patch>>),
    /// The distances to the wall are computed, by which ways are planned.
    Preparing(Job<(Arc<Lumen>, Arc<WallDistance>)>),
    /// It failed, and why.
    Failed(String),
}

/// What of the wall was seen, in a window.
pub(crate) struct Seen {
    is_painted: bool,
    stage: Stage,
    /// The missed patches, as they were when somebody asked, in the order of the flight.
    list: Option<Vec<Missed>>,
    /// Which of them a review visits: the others are shown by its other stops, or cannot be looked at.
    is_visited: Vec<bool>,
    current: Option<usize>,
    /// The patch (world, mm) that the camera was sent to.
    pub(crate) goes_to: Option<DVec3>,
    /// The paint, while it is not shown.
    paint: Option<CoveragePaint>,
    /// What follows once the patches are listed.
    then: Then,
    /// When the progress was looked at.
    looked: Instant,
}

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
            stage: Stage::Idle,
            list: None,
            is_visited: Vec::new(),
            current: None,
            goes_to: None,
            paint: None,
            then: Then::Nothing,
            looked: now,
        }
    }

    /// True if what was not seen is painted, as soon as it is known.
    pub(crate) fn is_painted(&self) -> bool {
        self.is_painted
    }

    /// Shows or hides the paint. What is needed is found in the background.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub(crate) fn show(&mut self, shown: bool, flight: &mut FlightApp, wake: &WakeUp, now: Instant) -> Result<()> {
        self.is_painted = shown;
        if shown && flight.camera::<LiveCoverage>().is_none() {
            if !matches!(self.stage, Stage::Beginning(_)) {
                self.looked = now;
                self.stage = begin(flight, wake).map_or_else(|e| Stage::Failed(e.to_string()), Stage::Beginning);
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

    /// Lists the missed patches in the background. Does nothing before the flight is watched.
    pub(crate) fn list_missed(&mut self, then: Then, flight: &FlightApp, wake: &WakeUp, now: Instant) {
        self.then = then;
        if self.next().is_some() {
            return;
        }
        if let Some(coverage) = flight.camera::<LiveCoverage>() {
            self.looked = now;
            let job = list(coverage, flight, wake);
            self.stage = job.map_or_else(|e| Stage::Failed(e.to_string()), Stage::Listing);
        }
    }

    /// Takes what has come out of the background.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub(crate) fn take(&mut self, flight: &mut FlightApp, now: Instant) -> Result<Option<News>> {
        let failed = match &mut self.stage {
            Stage::Beginning(job) => {
                self.looked = now;
                match job.take() {
                    None => return Ok(None),
                    Some(Ok((coverage, paint))) => {
                        self.stage = Stage::Idle;
                        flight.watch_coverage(coverage)?;
                        match self.is_painted {
                            true => drop(flight.paint_coverage(Some(paint))?),
                            false => self.paint = Some(paint),
                        }
                        return Ok(Some(News::Begun));
                    }
                    Some(Err(e)) => e,
                }
            }
            Stage::Listing(job) => {
                self.looked = now;
                match job.take() {
                    None => return Ok(None),
                    Some(Ok(list)) => {
                        self.stage = Stage::Idle;
                        let (list, is_visited) = list.into_iter().unzip();
                        (self.list, self.is_visited, self.current) = (Some(list), is_visited, None);
                        return Ok(Some(News::Listed(self.then)));
                    }
                    Some(Err(e)) => e,
                }
            }
            Stage::Preparing(job) => {
                self.looked = now;
                match job.take() {
                    None => return Ok(None),
                    Some(Ok((gas, walls))) => {
                        self.stage = Stage::Idle;
                        flight.adopt_walls(gas, walls);
                        return Ok(Some(News::Prepared(self.then)));
                    }
                    Some(Err(e)) => e,
                }
            }
            Stage::Idle | Stage::Failed(_) => return Ok(None),
        };
        self.stage = Stage::Failed(failed.to_string());
        Ok(None)
    }

    /// Returns when the progress has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        let is_working = matches!(self.stage, Stage::Beginning(_) | Stage::Listing(_) | Stage::Preparing(_));
        is_working.then_some(self.looked + LOOKS)
    }

    /// Returns what is being done, or why it failed; `None` if nothing is.
    pub(crate) fn state(&self) -> Option<std::result::Result<&'static str, &str>> {
        match &self.stage {
            Stage::Idle => None,
            Stage::Beginning(_) => Some(Ok("looking at the wall")),
            Stage::Listing(_) => Some(Ok("listing what was missed")),
            Stage::Preparing(_) => Some(Ok("preparing the way")),
            Stage::Failed(why) => Some(Err(why)),
        }
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
    pub(crate) fn prepare_tour(&mut self, then: Then, flight: &FlightApp, wake: &WakeUp, now: Instant) -> bool {
        self.then = then;
        if flight.knows_walls_to_tour() || self.next().is_some() {
            return flight.knows_walls_to_tour();
        }
        self.looked = now;
        self.stage = prepare(flight, wake).map_or_else(|e| Stage::Failed(e.to_string()), Stage::Preparing);
        false
    }

    /// Returns the stops of a review in the gas that is flown, and how many are left elsewhere: the places to look from at what was
    /// not seen since it was listed. As in a review without a window, no patch has one that the other stops show.
    pub(crate) fn stops(&self, flight: &FlightApp) -> (Vec<ReviewStop>, usize) {
        let Some(coverage) = flight.camera::<LiveCoverage>() else { return (Vec::new(), 0) };
        let visited = self.list.iter().flatten().zip(&self.is_visited).filter(|(_, is_visited)| **is_visited);
        let left = visited.map(|v| v.0).filter(|m| coverage.share_of(&m.triangles) < 0.5);
        let (here, elsewhere): (Vec<&Missed>, Vec<&Missed>) = left.partition(|m| is_here(m, flight));
        let stop = |m: &Missed| Some(ReviewStop::new(m.look_from?.position, Some(m.position)));
        (here.into_iter().filter_map(stop).collect(), elsewhere.len())
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
    let Setup { lumen, plan, .. } = flight.setup();
    let looked_from = patch.look_from.and_then(|from| lumen.segment_at(from.position));
    let segment = looked_from.or(patch.along.map(|a| a.segment));
    plan.segment.is_none_or(|flown| segment == Some(flown))
}

/// Extracts the wall and looks at the views until now, in the background.
fn begin(flight: &FlightApp, wake: &WakeUp) -> Result<Job<(LiveCoverage, CoveragePaint)>> {
    let Setup { volume, lumen, plan, .. } = flight.setup();
    let (volume, gas) = (volume.clone(), Arc::clone(plan.gas.as_ref().unwrap_or(lumen)));
    let views = flight.survey().trail().map_or_else(Vec::new, |t| t.views().to_vec());
    let seconds = flight.clock().seconds();
    let work = move |progress: &Arc<Progress>| {
        let mut coverage = LiveCoverage::of(&volume, &gas, progress)?;
        coverage.catch_up(&volume, &views, seconds);
        let paint = CoveragePaint::new(&coverage);
        Ok((coverage, paint))
    };
    let wake = Arc::clone(wake);
    Job::start("coverage", &Arc::new(Progress::new()), work, move || wake())
}

/// Computes the distances to the wall of the gas that is flown, in the background.
fn prepare(flight: &FlightApp, wake: &WakeUp) -> Result<Job<(Arc<Lumen>, Arc<WallDistance>)>> {
    let Setup { volume, lumen, plan, .. } = flight.setup();
    let (volume, gas) = (volume.clone(), Arc::clone(plan.gas.as_ref().unwrap_or(lumen)));
    let work = move |progress: &Arc<Progress>| {
        let walls = WallDistance::of_lumen(volume.voxels(), &gas, Through::Gas, progress)?;
        Ok((gas, Arc::new(walls)))
    };
    let wake = Arc::clone(wake);
    Job::start("tour", &Arc::new(Progress::new()), work, move || wake())
}

/// Lists the missed patches in the background.
fn list(coverage: &LiveCoverage, flight: &FlightApp, wake: &WakeUp) -> Result<Job<Vec<Patch>>> {
    let (coverage, setup) = (coverage.clone(), flight.setup());
    let (radius, volume) = (setup.scene.body.radius_mm, setup.volume.clone());
    let gas = Arc::clone(setup.plan.gas.as_ref().unwrap_or(&setup.lumen));
    let work = move |progress: &Arc<Progress>| {
        let along = gas.along(volume.voxels(), progress)?;
        let is_missed = coverage.missed();
        let (wall, place) = (coverage.wall(), |p: DVec3| along.of(p));
        let found = missed::missed(wall, |n| !is_missed[n], missed::LEAST_MM2, place, &volume, radius);
        let (unseen, numbers) = wall.part(|n| is_missed[n]);
        let mut is_visited = vec![false; found.len()];
        for n in missed::to_visit(&found, &unseen, &numbers, &volume, coverage.camera()) {
            is_visited[n] = true;
        }
        let mut found: Vec<Patch> = found.into_iter().zip(is_visited).collect();
        // What has no place along the colon comes last.
        let mm = |p: &Patch| p.0.along.map_or(f64::INFINITY, |a| a.mm);
        found.sort_by(|a, b| mm(a).total_cmp(&mm(b)));
        Ok(found)
    };
    let wake = Arc::clone(wake);
    Job::start("missed", &Arc::new(Progress::new()), work, move || wake())
}
