//! Flights, what they see of the wall, and what a second look adds.

use glam::DVec3;

use crate::app::{Covered, FlightApp, FlightRequest, ReviewRounds, Scan, Scene, TourFlown};
use crate::components::flight::State;
use crate::components::trail::Trail;
use crate::coverage::missed::{self, LEAST_MM2};
use crate::coverage::{Coverage, Missed, Sight, Wall};
use crate::dynamics::Attitude;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::render::camera::{Camera, CameraModel, fisheye, perspective};
use crate::report::timed;

/// Maximum duration of a flight, simulated seconds.
pub(super) const SECONDS: f64 = 600.0;
/// Maximum duration of a tour, simulated seconds.
const TOUR_SECONDS: f64 = 3600.0;
/// Cameras with their view angles, degrees. The first is the one that everything else is measured with.
const VIEWS: [(CameraModel, f64); 3] =
    [(perspective::MODEL, FOV), (perspective::MODEL, 120.0), (fisheye::MODEL, FISHEYE_FOV)];
/// The view angle of the first camera, degrees.
pub(super) const FOV: f64 = 90.0;
/// The view angle of the fisheye, degrees.
pub(super) const FISHEYE_FOV: f64 = 180.0;
/// Number of rounds of looks at missed patches.
const ROUNDS: usize = 2;

/// The guides.
pub(super) const GUIDES: [&str; 3] = ["tentacles", "path", "potential"];
/// The guide whose flight is also flown back, and whose unseen wall is analysed.
pub(super) const PATH: &str = "path";

/// What a flight sees of the wall with one camera.
pub(super) struct Run {
    pub guide: &'static str,
    pub camera: CameraModel,
    pub fov_degrees: f64,
    pub state: State,
    pub length_mm: f64,
    pub wall_mm2: f64,
    pub coverage: Coverage,
    /// Share seen there and back: by this flight and by one from its goal.
    pub there_and_back: f64,
    /// What was missed in the direction of flight: patches of at least 300 mm² and their area, mm².
    pub missed: (usize, f64),
    /// After a second look at what the flight missed, and at what the flights there and back missed.
    pub reviewed: [Review; 2],
}

/// What a second look adds.
#[derive(Clone, Debug)]
pub(super) struct Review {
    /// Share of the area seen before or now.
    pub share: f64,
    /// The views that were added.
    pub views: Vec<(DVec3, Attitude)>,
    /// Whether each triangle is seen before or now.
    pub seen: Vec<bool>,
}

/// A flight at its end, with its wall and what is seen of it with each camera.
pub(super) struct Flight {
    pub app: FlightApp,
    /// The views of a flight back.
    pub back: Vec<(DVec3, Attitude)>,
    pub wall: Wall,
    pub sights: Vec<Vec<Sight>>,
    /// Time (s) and memory (MB) of the measure at 90°, with the wall.
    pub seconds: f64,
    pub megabytes: Option<f64>,
}

impl Flight {
    /// Returns the views.
    pub(super) fn views(&self) -> &[(DVec3, Attitude)] {
        self.app.survey().trail().map_or(&[][..], Trail::views)
    }

    /// Returns what is seen from some views.
    fn seen(&self, views: &[(DVec3, Attitude)], camera: &dyn Camera, progress: &Progress) -> Result<Vec<Sight>> {
        self.wall.seen(&self.app.setup().volume, views, camera, false, progress)
    }
}

/// A review that was flown after a flight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Toured {
    /// Shares seen before and after it.
    pub shares: [f64; 2],
    pub tours: usize,
    pub stops: usize,
    pub reached: usize,
    pub length_mm: f64,
    pub seconds: f64,
    /// Lengths of the orders of its tours over the lumen's cells, and of the best of 1,000 random orders, mm.
    pub orders_mm: [f64; 2],
    /// Time for planning the tours, s.
    pub planned_s: f64,
}

/// Flies a review of the patches that a flight has missed at a view angle of 90°.
pub(super) fn toured(flight: Flight, progress: &Progress) -> Result<Toured> {
    let Flight { mut app, wall, sights, .. } = flight;
    let sights = sights.into_iter().next().unwrap_or_default();
    let coverage = wall.coverage(&sights);
    let mut rounds = ReviewRounds::new(&app, Covered { wall, sights, coverage }, FOV);
    loop {
        match rounds.set_out(&mut app) {
            Ok(true) => {}
            // No path leads to a missed patch.
            Err(e) if e.what == "review" => break,
            due => {
                due?;
                break;
            }
        }
        let most = app.clock().seconds() + TOUR_SECONDS;
        while app.tour().is_some() && app.flight().state == State::Flying && app.clock().seconds() < most {
            progress.check()?;
            app.step()?;
        }
        rounds.end_tour(&mut app)?;
    }
    let tours = &rounds.tours;
    let sum = |of: fn(&TourFlown) -> f64| tours.iter().map(of).sum::<f64>();
    Ok(Toured {
        shares: [coverage.one_way, rounds.covered.coverage.one_way],
        tours: tours.len(),
        stops: tours.iter().map(|t| t.stops).sum(),
        reached: tours.iter().map(|t| t.reached).sum(),
        length_mm: sum(|t| t.length_mm),
        seconds: sum(|t| t.seconds),
        orders_mm: [sum(|t| t.order_mm), sum(|t| t.random_mm)],
        planned_s: sum(|t| t.planned_s),
    })
}

/// Flies to the end. Fails with status 4 if there is no colon to fly or if interrupted.
pub(super) fn fly(scan: &mut Scan, guide: &'static str, reverse: bool, progress: &Progress) -> Result<FlightApp> {
    let mut flight = scan.flight(Scene::guided_by(guide), &FlightRequest { reverse, ..FlightRequest::default() })?;
    while flight.flight().state == State::Flying && flight.clock().seconds() < SECONDS {
        progress.check()?;
        flight.step()?;
    }
    Ok(flight)
}

/// Flies there and back, and measures what was seen.
pub(super) fn measured(scan: &mut Scan, guide: &'static str, progress: &Progress) -> Result<Flight> {
    let back = fly(scan, guide, true, progress)?.survey().trail().map_or_else(Vec::new, |t| t.views().to_vec());
    let app = fly(scan, guide, false, progress)?;
    let (covered, seconds, megabytes) = timed(|| app.survey().coverage(FOV, false));
    let Some(covered) = covered? else {
        return Err(Error::incomplete("report coverage", "no gas was flown through", "give a scan with a colon"));
    };
    let mut flight = Flight { app, back, wall: covered.wall, sights: vec![covered.sights], seconds, megabytes };
    for (model, fov) in &VIEWS[1..] {
        let sights = flight.seen(flight.views(), &*model.camera(*fov, 1.0)?, progress)?;
        flight.sights.push(sights);
    }
    Ok(flight)
}

/// Returns a row for each camera.
pub(super) fn runs(flight: &Flight, guide: &'static str, progress: &Progress) -> Result<Vec<Run>> {
    let (wall, f) = (&flight.wall, flight.app.flight());
    let mut runs = Vec::new();
    for (&(model, fov_degrees), sights) in VIEWS.iter().zip(&flight.sights) {
        let camera = model.camera(fov_degrees, 1.0)?;
        let back = flight.seen(&flight.back, &*camera, progress)?;
        let ahead: Vec<bool> = sights.iter().map(|s| s.ahead > 0).collect();
        let both: Vec<bool> = ahead.iter().zip(back).map(|(a, b)| *a || b.ahead > 0).collect();
        let missed = missed(flight, &ahead, progress)?;
        runs.push(Run {
            guide,
            camera: model,
            fov_degrees,
            state: f.state,
            length_mm: f.length_mm,
            wall_mm2: wall.mm2(),
            coverage: wall.coverage(sights),
            there_and_back: share(wall, |n| both[n]),
            missed: (missed.len(), missed.iter().map(|m| m.area_mm2).sum()),
            reviewed: [review(flight, ahead, &*camera, progress)?, review(flight, both, &*camera, progress)?],
        });
    }
    Ok(runs)
}

/// Returns the share of the area that `which` is true for.
pub(super) fn share(wall: &Wall, which: impl Fn(usize) -> bool) -> f64 {
    wall.mm2_of(which) / wall.mm2().max(f64::MIN_POSITIVE)
}

/// Returns the patches of at least 300 mm² that were not seen.
fn missed(flight: &Flight, seen: &[bool], progress: &Progress) -> Result<Vec<Missed>> {
    let setup = flight.app.setup();
    let radius_mm = setup.scene.body.radius_mm;
    missed::missed(&flight.wall, |n| seen[n], LEAST_MM2, |_| None, &setup.volume, radius_mm, progress)
}

/// Looks at each patch that was missed from the place that is proposed for it, and again at what is missed after that.
///
/// A reader is taken to these places one by one; here the views on the way there are not counted.
fn review(flight: &Flight, mut seen: Vec<bool>, camera: &dyn Camera, progress: &Progress) -> Result<Review> {
    let (wall, mut views) = (&flight.wall, Vec::new());
    for _ in 0..ROUNDS {
        let looks = missed(flight, &seen, progress)?.into_iter().filter_map(|m| m.look_from);
        let looks: Vec<_> = looks.map(|l| (l.position, Attitude::new(l.forward, l.up))).collect();
        if looks.is_empty() {
            break;
        }
        let sights = flight.seen(&looks, camera, progress)?;
        seen.iter_mut().zip(sights).for_each(|(seen, s)| *seen |= s.ahead > 0);
        views.extend(looks);
    }
    Ok(Review { share: share(wall, |n| seen[n]), views, seen })
}
