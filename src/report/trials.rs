//! Trial flights: the same course flown with different settings, with the results.

use std::sync::Arc;
use std::time::Instant;

use glam::{DMat3, DVec3};

use crate::app::plan::{self, FlightRequest, Plan};
use crate::app::{FlightApp, Scan, Scene};
use crate::components::clock::Clock;
use crate::components::flight::State;
use crate::error::{Error, Result};
use crate::fields::{Lumen, TargetDistance, Through, WallDistance, lumen};
use crate::phantom::{Phantom, PhantomSettings, Size, Truth};
use crate::plane::drawing::Drawing;
use crate::progress::Progress;
use crate::report::Effort;
use crate::space::{PreparedVolume, TransferFunction};
use crate::volume::{Grid, Volume};

/// A volume to fly through from end to end.
pub struct Course {
    /// The volume.
    pub volume: PreparedVolume,
    /// Its lumen.
    pub lumen: Arc<Lumen>,
    /// Start and goal.
    pub plan: Plan,
    /// Its ground truth, for a phantom.
    pub truth: Option<Truth>,
}

impl Course {
    /// Creates a course through a volume, from its rectal to its cecal end.
    ///
    /// # Errors
    /// Returns status 4 if there is no colon to fly or if interrupted.
    pub fn new(volume: PreparedVolume, truth: Option<Truth>, progress: &Progress) -> Result<Self> {
        let mut scan = Scan::prepared(volume.clone(), Arc::new(progress.clone()));
        let plan = scan.plan(&FlightRequest::default(), Scene::default().body.radius_mm)?;
        Ok(Self { volume, lumen: scan.lumen()?, plan, truth })
    }

    /// Creates a course through a phantom.
    ///
    /// # Errors
    /// Returns the errors of [`Course::new`].
    pub fn phantom(settings: &PhantomSettings, progress: &Progress) -> Result<Self> {
        let phantom = Phantom::new(settings);
        let volume = phantom.voxelise(&phantom.grid(), progress)?;
        Self::new(PreparedVolume::new(Arc::new(volume), TransferFunction::default()), Some(phantom.truth()), progress)
    }

    /// Creates a course through a drawn lumen, 18 mm high, from its start to its goal. The voxels are 1 mm, so that four pixels
    /// make one.
    ///
    /// # Errors
    /// Returns status 2 if no start or goal is drawn, 3 if the drawing cannot be converted to a volume, 4 if there is no free
    /// space at the start.
    pub fn drawn(drawing: &Drawing, progress: &Progress) -> Result<Self> {
        let unmarked = || Error::usage("drawing", "it has no start or no goal", "mark them in red and green");
        let (start, goal) = (drawing.start.ok_or_else(unmarked)?, drawing.goal.ok_or_else(unmarked)?);
        let (thick, wall) = (18, 2);
        let dims = [drawing.width() / 2, drawing.height() / 2, thick + 2 * wall];
        let middle = -0.5 * dims[2] as f64;
        let grid = Grid::new(dims, DVec3::ONE, DVec3::new(0.5, 0.5, middle), DMat3::IDENTITY)
            .map_err(|e| Error::input("drawing", e.why, "draw a larger one"))?;
        let value = |n: usize| {
            let (i, j, k) = (n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]);
            let pixels = [(0, 0), (1, 0), (0, 1), (1, 1)];
            let open = |(x, y): (usize, usize)| drawing.is_lumen((2 * i + x) as i64, (2 * j + y) as i64);
            let share =
                if (wall..wall + thick).contains(&k) { pixels.into_iter().filter(|p| open(*p)).count() } else { 0 };
            40 - 260 * share as i16
        };
        let data = (0..grid.len()).map(value).collect();
        let volume = Volume::new(grid, data);
        let nothing = || Error::incomplete("drawing", "nothing is open at its start", "start within the lumen");
        let lumen = Arc::new(lumen::gas_at(&volume, start, progress)?.ok_or_else(nothing)?);
        let elsewhere = DVec3::splat(1e4);
        let mut plan = Plan { begin: elsewhere, ..Plan::between(start, goal, 300.0) };
        plan.ends[0].at = elsewhere;
        Ok(Self {
            volume: PreparedVolume::new(Arc::new(volume), TransferFunction::default()),
            lumen,
            plan,
            truth: None,
        })
    }

    /// Returns the distance of each point of the lumen from the goal, along the lumen.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn to_goal(&self, progress: &Progress) -> Result<TargetDistance> {
        let gas = self.plan.gas.as_deref().unwrap_or(&self.lumen);
        let walls = WallDistance::of_lumen(self.volume.voxels(), gas, Through::Gas, progress)?;
        TargetDistance::to(&Arc::new(walls), self.plan.goal().at, None, &[], progress)
    }

    /// Returns the same course in the opposite direction.
    ///
    /// # Errors
    /// Returns status 4 if there is no colon to fly.
    pub fn reversed(&self, progress: &Progress) -> Result<Self> {
        let request = FlightRequest { reverse: true, ..FlightRequest::default() };
        let plan = plan::plan(&self.volume, &self.lumen, &request, Scene::default().body.radius_mm, progress)?;
        Ok(Self { volume: self.volume.clone(), lumen: Arc::clone(&self.lumen), plan, truth: self.truth.clone() })
    }
}

/// Creates the courses of small studies: six small phantoms with folds, polyps and noise, or two for a quick report.
///
/// # Errors
/// Returns the errors of [`Course::new`].
pub fn small_phantoms(effort: Effort, progress: &Progress) -> Result<Vec<Course>> {
    let seeds = 1..=effort.choose(2, 6);
    seeds
        .map(|seed| {
            Course::phantom(&PhantomSettings { size: Size::Small, seed, ..PhantomSettings::default() }, progress)
        })
        .collect()
}

/// The result of a flight.
#[derive(Clone, Debug)]
pub struct Trial {
    /// Final state.
    pub state: State,
    /// Why the operator was called; empty if not called.
    pub reason: String,
    /// Duration, simulated seconds.
    pub seconds: f64,
    /// Camera positions every tenth of a second, world mm.
    pub places: Vec<DVec3>,
    /// Distance flown, mm.
    pub length_mm: f64,
    /// Number of places at which the flight searched for another direction.
    pub escapes: u32,
    /// Smallest and mean clearance, mm.
    pub clearance_mm: (f64, f64),
    /// Mean distance from the true centerline as a share of the local radius; `None` without ground truth.
    pub offset: Option<f64>,
    /// Root mean square of the jerk after the first second, mm/s³.
    pub jerk: f64,
    /// Wall-clock time of a step, µs.
    pub step_us: f64,
}

impl Trial {
    /// True if the flight arrived.
    pub fn arrived(&self) -> bool {
        self.state == State::Arrived
    }
}

/// Flies a course with a scene, for at most `seconds` simulated seconds.
///
/// # Errors
/// Returns status 2 for an invalid scene.
pub fn fly(course: &Course, scene: &Scene, seconds: f64) -> Result<Trial> {
    let scene = Scene { log: true, ..scene.clone() };
    let (volume, lumen) = (course.volume.clone(), Arc::clone(&course.lumen));
    let mut flight = FlightApp::new(volume, lumen, course.plan.clone(), scene)?;
    let steps = (seconds * f64::from(Clock::default().hz)) as usize;
    let mut log = Vec::new();
    let begun = Instant::now();
    while log.len() < steps && flight.flight().state == State::Flying {
        flight.step()?;
        log.append(&mut flight.take_log());
    }
    let took = begun.elapsed().as_secs_f64();
    if flight.flight().state == State::Flying {
        flight.end();
    }
    let places: Vec<DVec3> = log.iter().map(|l| DVec3::from_array(l.position)).collect();
    let clearance = log.iter().map(|l| l.clearance_mm);
    let n = log.len().max(1) as f64;
    let f = flight.flight();
    let tenth = flight.clock().hz as usize / 10;
    Ok(Trial {
        state: f.state,
        reason: f.reason,
        seconds: flight.clock().seconds(),
        length_mm: f.length_mm,
        escapes: f.escapes,
        clearance_mm: (clearance.clone().fold(f64::INFINITY, f64::min), clearance.sum::<f64>() / n),
        offset: course.truth.as_ref().map(|t| offset(&places, t)),
        jerk: jerk(&places, flight.clock().dt()),
        step_us: took * 1e6 / n,
        places: places.into_iter().step_by(tenth.max(1)).collect(),
    })
}

/// Returns the mean distance from the true centerline, sampled every tenth of a second, as a share of the local radius.
fn offset(places: &[DVec3], truth: &Truth) -> f64 {
    let share = |p: &DVec3| {
        let d = |i: &usize| truth.centerline[*i].distance_squared(*p);
        let near = (0..truth.centerline.len()).min_by(|a, b| d(a).total_cmp(&d(b)));
        near.map_or(f64::NAN, |i| truth.centerline[i].distance(*p) / truth.radius_mm[i])
    };
    super::mean(&places.iter().step_by(12).map(share).collect::<Vec<_>>())
}

/// Returns the root mean square of the third differences of the positions over a twentieth of a second, after the first second.
/// Shorter intervals contain only rounding, and the start is not chatter.
fn jerk(places: &[DVec3], dt: f64) -> f64 {
    const EVERY: usize = 6;
    let h = dt * EVERY as f64;
    let p: Vec<DVec3> = places.iter().skip((1.0 / dt) as usize).step_by(EVERY).copied().collect();
    let third = |w: &[DVec3]| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).length_squared() / h.powi(6);
    super::mean(&p.windows(4).map(third).collect::<Vec<_>>()).sqrt()
}
