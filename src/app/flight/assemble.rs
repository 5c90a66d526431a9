//! Assembles a flight's entities and schedules for its scene.

use std::sync::Arc;

use glam::DVec3;

use super::{FlightApp, Setup};
use crate::components::camera::{AngularMomentum, Body, Contact, Heading, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Flown, Goal, GoalMissed};
use crate::components::guide::{Automatic, GuideThrust, Planned};
use crate::components::output::Picture;
use crate::components::play::Playback;
use crate::components::scan::{Centerline, Scan, TargetDistances, WallDistances, Walls};
use crate::components::still::StillViews;
use crate::components::trail::Trail;
use crate::coverage::{CoveragePaint, LiveCoverage, VIEWS_AT_ONCE};
use crate::dynamics::Attitude;
use crate::error::{Error, Result};
use crate::fields::ClearanceFinder;
use crate::plan::{self, Plan};
use crate::render::CameraModel;
use crate::scene::Scene;
use crate::schedule::{App, Main, Slot};
use crate::systems::{self, present};

/// Reach of the clearance search, mm. Logged clearances are exact up to 10 mm, so it is slightly larger.
const CLEARANCE_MM: f64 = 11.0;

impl FlightApp {
    /// Rebuilds the schedules and components for the current scene: adds what it needs and removes what it does not need.
    ///
    /// The fields that it needs are built.
    pub(super) fn rebuild(&mut self) -> Result<()> {
        self.equip_scan();
        if self.setup.scene.coverage {
            self.equip_coverage()?;
        }
        let [other, goal] = &self.setup.plan.ends;
        let goal = Goal { at: goal.at, within_mm: goal.within_mm, other_end: other.at };
        let tour = self.tour_component();
        let Self { app, setup: Setup { scene, plan, .. }, .. } = self;
        present::forget_scene(app);
        app.set_scene(|app| {
            equip_camera(app, scene, plan);
            if let Some(tour) = tour {
                app.equip(tour);
            }
            scene.plug_into(app, goal)
        })?;
        self.app.build()
    }

    /// Equips the scan entity with the data built for it.
    fn equip_scan(&mut self) {
        let mut scan = self.app.scan();
        if self.setup.scene.moves() && !scan.contains::<Walls>() {
            let iso = self.setup.volume.transfer().iso() as f32;
            scan.insert(Walls(ClearanceFinder::new(self.setup.volume.shared_voxels(), iso, CLEARANCE_MM)));
        }
        scan.remove::<(WallDistances, TargetDistances, Centerline)>();
        if let (Some(walls), true) = (self.setup.fields.walls(), self.setup.scene.needs().distances) {
            scan.insert(WallDistances(Arc::clone(walls)));
        }
        if let Some(target) = self.setup.fields.target() {
            scan.insert(TargetDistances(Arc::clone(target)));
        }
        if let Some(route) = self.setup.fields.route() {
            scan.insert(Centerline(Arc::clone(route)));
        }
    }

    /// Builds the wall of the gas that is flown through, unless it is the same as before.
    fn equip_coverage(&mut self) -> Result<()> {
        let Setup { volume, lumen, plan, .. } = &self.setup;
        let gas = plan.gas.as_ref().unwrap_or(lumen);
        if !self.camera::<LiveCoverage>().is_some_and(|c| c.belongs_to(gas)) {
            let mut coverage = LiveCoverage::of(volume, gas, &self.progress)?;
            let image = &self.setup.scene.image;
            if image.camera != CameraModel::default() {
                coverage.set_camera(image.camera, image.fov_degrees);
            }
            // In another lumen, the views so far have seen another wall.
            let views = self.camera::<Trail>().map_or(&[][..], Trail::views);
            // Before the flight's first step there is no clock, and no view.
            let seconds = self.app.world.get_resource::<Clock>().map_or(0.0, Clock::seconds);
            match self.camera::<StillViews>() {
                Some(still) if still.views().len() <= VIEWS_AT_ONCE => {
                    coverage.see(volume, views, still, seconds, &self.progress)?;
                }
                // A window looks at more of them in the background.
                _ => coverage.catch_up(volume, views, seconds, &self.progress)?,
            }
            self.app.camera().insert(coverage);
        }
        Ok(())
    }

    /// Measures coverage from now on. `coverage` belongs to this flight's gas, and may already contain views of it.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub fn watch_coverage(&mut self, coverage: LiveCoverage) -> Result<()> {
        self.app.camera().insert(coverage);
        self.setup.scene.coverage = true;
        if !self.app.is_filled(Slot::Coverage) {
            systems::coverage::plugin(&mut self.app)?;
            self.app.take_in("coverage");
            self.app.build()?;
        }
        Ok(())
    }

    /// Stops measuring coverage, and frees what that takes.
    pub fn unwatch_coverage(&mut self) {
        self.setup.scene.coverage = false;
        self.app.camera().remove::<LiveCoverage>();
    }

    /// Starts or stops painting the unseen wall over the camera's picture and over slices with marks. Returns the previous paint.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub fn paint_coverage(&mut self, paint: Option<CoveragePaint>) -> Result<Option<CoveragePaint>> {
        let before = self.app.camera().take::<CoveragePaint>();
        if let Some(paint) = paint {
            self.app.camera().insert(paint);
            if !self.app.is_filled(Slot::CoveragePaint) {
                systems::coverage::paint_plugin(&mut self.app)?;
                self.app.build()?;
            }
        }
        Ok(before)
    }

    /// Renders the camera's picture again in the next frame although it has not changed, because what is painted over it has.
    pub fn mark_picture(&mut self) {
        if let Some(mut picture) = self.camera_mut::<Picture>() {
            picture.due = true;
        }
    }

    /// Puts back what systems of other crates have taken from the scan and the camera in a step or frame with this outcome, and
    /// ends the flight: what they knew is lost. Returns the error of the step or frame, or status 1 if the code that drives the
    /// flight has taken it.
    pub(super) fn restored(&mut self, outcome: Result<()>) -> Result<()> {
        let Some(former) = self.app.take_lost() else { return outcome };
        let outcome = outcome.and_then(|()| {
            let why = "the scan, the camera or a part of them was removed";
            Err(Error::fault("flight", why, "do not change the entities of a flight"))
        });
        let Setup { volume, scene, .. } = &self.setup;
        let (scan, picture) = (Scan(volume.clone()), scene.picture.then(|| scene.image.picture()));
        self.app.scan().insert_if_new((scan, Main));
        let mut camera = self.app.camera();
        camera.insert_if_new((Main, Flight::default(), Flown::default(), Trail::default()));
        if let Some(picture) = picture {
            camera.insert_if_new(picture);
        }
        present::hand_on(&mut self.app, former);
        // A flight that has ended does without what can no longer be built.
        let _ = self.rebuild().and_then(|()| self.views().prepare());
        if let Some(pose) = self.sound {
            self.app.camera().insert(pose);
            self.rest(pose.position, pose.attitude.forward);
        }
        if let Err(e) = &outcome {
            self.end_because(e);
        }
        outcome
    }

    /// Places the camera at the start of the plan.
    pub(super) fn set_out(&mut self) {
        let attitude = match (self.setup.scene.play(), self.camera::<Planned>()) {
            (Some(play), _) => play.now().attitude,
            (None, Some(Planned { route, look_ahead_mm, .. })) => {
                let s = route.nearest(self.setup.plan.start).first().copied().unwrap_or(0.0);
                Attitude::new(route.look(s, *look_ahead_mm), route.up(s))
            }
            (None, None) => plan::first_attitude(&self.setup.volume, self.setup.plan.start, self.setup.plan.goal().at),
        };
        let (position, length_mm) = (self.setup.plan.start, self.setup.plan.length_mm);
        let pose = Pose { position, attitude };
        self.sound = Some(pose);
        self.app.camera().insert((pose, Flight::default()));
        self.rest(position, attitude.forward);
        if let Some(mut trail) = self.camera_mut::<Trail>() {
            trail.set_out(length_mm);
        }
    }

    /// Puts the body, if there is one, to rest at a position (world mm), heading along `forward`.
    pub(super) fn rest(&mut self, position: DVec3, forward: DVec3) {
        let Some(clearance_mm) = self.app.scan_get::<Walls>().map(|w| w.0.at(position).mm) else { return };
        self.app.camera().insert((
            Heading(forward),
            Velocity::default(),
            AngularMomentum::default(),
            Contact { clearance_mm, ..Contact::default() },
        ));
    }
}

/// Adds the components that every camera of the scene has, independent of the steering.
fn equip_camera(app: &mut App, scene: &Scene, plan: &Plan) {
    let moves = scene.moves();
    if scene.play().is_none() {
        app.camera().remove::<Playback>();
    }
    if scene.is_automatic() {
        app.equip(Automatic);
    }
    let mut camera = app.camera();
    if moves {
        camera.insert_if_new((Body(scene.body), GuideThrust::default()));
    }
    camera.insert(GoalMissed(plan.goal().missed.clone()));
    if let Some(mut flown) = camera.get_mut::<Flown>() {
        flown.segment = plan.segment;
    }
}
