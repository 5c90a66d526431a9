//! The flight's entities and schedules, for the scene as it is.

use std::sync::Arc;

use glam::DVec3;

use super::FlightApp;
use crate::app::plan::{self, Plan};
use crate::app::scene::Scene;
use crate::components::camera::{AngularMomentum, Body, Contact, Heading, Pose, Velocity};
use crate::components::flight::{Flight, Flown, Goal, GoalMissed};
use crate::components::guide::{Automatic, GuideThrust, Planned};
use crate::components::play::Playback;
use crate::components::scan::{Centerline, TargetDistances, WallDistances, Walls};
use crate::components::trail::Trail;
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::fields::ClearanceFinder;
use crate::schedule::App;

/// Logged clearances are exact up to 10 mm; what they are found by reaches a little farther, mm.
const CLEARANCE_MM: f64 = 11.0;

impl FlightApp {
    /// Builds the schedules and the components anew for the scene as it is now: what it needs is added, what it does
    /// not need is removed.
    pub(super) fn rebuild(&mut self) -> Result<()> {
        self.fields.build(
            self.scene.needs(),
            self.volume.voxels(),
            &self.lumen,
            &self.plan,
            self.scene.body.radius_mm,
            &self.progress,
        )?;
        self.equip_scan();
        let goal = Goal { at: self.plan.goal, within_mm: self.plan.within_mm, other_end: self.plan.other_end };
        let Self { app, scene, plan, .. } = self;
        app.set_scene(|app| {
            equip_camera(app, scene, plan);
            scene.plug_into(app, goal)
        })?;
        self.app.build()
    }

    /// The scan with what is built of it.
    fn equip_scan(&mut self) {
        let mut scan = self.app.scan();
        if self.scene.moves() && !scan.contains::<Walls>() {
            let iso = self.volume.transfer().iso() as f32;
            scan.insert(Walls(ClearanceFinder::new(self.volume.shared_voxels(), iso, CLEARANCE_MM)));
        }
        scan.remove::<(WallDistances, TargetDistances, Centerline)>();
        if let (Some(walls), true) = (self.fields.walls(), self.scene.needs().distances) {
            scan.insert(WallDistances(Arc::clone(walls)));
        }
        if let Some(target) = self.fields.target() {
            scan.insert(TargetDistances(Arc::clone(target)));
        }
        if let Some(route) = self.fields.route() {
            scan.insert(Centerline(Arc::clone(route)));
        }
    }

    /// Puts the camera at the start of the plan.
    pub(super) fn set_out(&mut self) {
        let attitude = match (self.scene.play(), self.camera::<Planned>()) {
            (Some(play), _) => play.now().attitude,
            (None, Some(Planned { route, look_ahead_mm, .. })) => {
                let s = route.nearest(self.plan.start).first().copied().unwrap_or(0.0);
                Attitude::new(route.look(s, *look_ahead_mm), route.up(s))
            }
            (None, None) => plan::first_attitude(&self.volume, self.plan.start, self.plan.goal),
        };
        let (position, length_mm) = (self.plan.start, self.plan.length_mm);
        self.app.camera().insert((Pose { position, attitude }, Flight::default()));
        self.rest(position, attitude.forward);
        if let Some(mut trail) = self.camera_mut::<Trail>() {
            trail.set_out(length_mm);
        }
    }

    /// Brings the body, if there is one, to rest at a place, heading along `forward`.
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

/// What every camera of the scene has, whoever steers it.
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
    camera.insert(GoalMissed(plan.goal_missed.clone()));
    if let Some(mut flown) = camera.get_mut::<Flown>() {
        flown.segment = plan.segment;
    }
}
