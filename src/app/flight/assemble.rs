//! The flight's entities and schedules, for the scene as it is.

use std::sync::Arc;

use glam::DVec3;

use super::FlightApp;
use crate::app::fields::Wanted;
use crate::app::plan;
use crate::components::camera::{Body, Contact, Heading, Pose, Spin, Velocity};
use crate::components::flight::{Flight, Goal, Watch};
use crate::components::guide::{
    Automatic, Field, GuideThrust, MineField, MinePush, Planned, PotentialField, PotentialSettings, Tentacles,
};
use crate::components::input::Hand;
use crate::components::output::{FrameCache, GuideName, Picture};
use crate::components::play::Playback;
use crate::components::scan::{RaySpace, Walls};
use crate::dynamics::Attitude;
use crate::dynamics::mines::Mines;
use crate::dynamics::rescue::Rescue;
use crate::error::Result;
use crate::fields::ClearanceFinder;
use crate::render::renderer;

/// How far clearances are exact, mm; the contract asks for 10.
const CLEARANCE_MM: f64 = 11.0;

impl FlightApp {
    /// Builds the schedules and the components anew for the scene as it is now: what it needs is added, what it does
    /// not need is removed.
    pub(super) fn rebuild(&mut self) -> Result<()> {
        self.app.clear_systems();
        self.app.world.insert_resource(GuideName("none"));
        self.scene.plug_into(&mut self.app)?;
        let (moves, feels, guide) = (self.scene.moves(), self.scene.feels(), self.scene.steers());
        self.fields.build(
            Wanted::by(guide),
            self.space.volume(),
            &self.lumen,
            &self.plan,
            self.scene.body.radius_mm,
            &self.progress,
        )?;
        let world = &mut self.app.world;
        let mut scan = world.entity_mut(self.scan);
        if moves && !scan.contains::<Walls>() {
            let iso = self.space.wall().iso() as f32;
            scan.insert(Walls(ClearanceFinder::new(self.space.shared_volume(), iso, CLEARANCE_MM)));
        }
        if feels || self.scene.picture {
            scan.insert(RaySpace(self.space.clone()));
        } else {
            scan.remove::<RaySpace>();
        }
        let mut camera = world.entity_mut(self.camera);
        if moves {
            camera.insert_if_new((Body(self.scene.body), GuideThrust::default()));
        }
        camera.remove::<(Planned, PotentialField, PotentialSettings)>();
        if let Some(route) = self.fields.route() {
            camera.insert(Planned::new(Arc::clone(route), self.scene.path));
        }
        if let (Some(walls), Some(target)) = (self.fields.walls(), self.fields.target()) {
            let potential = self.scene.potential;
            let (wall, target): (Field, Field) = (Arc::clone(walls) as Field, Arc::clone(target) as Field);
            let settings = PotentialSettings { potential, yields: 0, yields_until: 0 };
            camera.insert((settings, PotentialField { potential, wall, target: Some(target) }));
        }
        match (self.scene.play.clone(), camera.contains::<Playback>()) {
            (Some(play), false) => drop(camera.insert(play)),
            (None, true) => drop(camera.remove::<Playback>()),
            _ => {}
        }
        match (feels, camera.contains::<Tentacles>()) {
            (true, false) => drop(camera.insert(Tentacles::new(self.scene.tentacles))),
            (false, true) => drop(camera.remove::<Tentacles>()),
            _ => {}
        }
        match self.scene.mines.filter(|_| feels) {
            Some(settings) => drop(camera.insert(MineField { settings, mines: Mines::default() })),
            None => drop(camera.remove::<(MineField, MinePush)>()),
        }
        if self.scene.is_automatic() {
            camera.insert(Automatic);
        } else {
            camera.remove::<Automatic>();
        }
        match self.scene.watch.filter(|_| self.scene.watches()) {
            Some(settings) => {
                camera.insert(Watch { settings, rescue: Rescue::default() });
                camera.insert(Goal {
                    at: self.plan.goal,
                    within_mm: self.plan.within_mm,
                    other_end: self.plan.other_end,
                });
            }
            None => drop(camera.remove::<(Watch, Goal)>()),
        }
        // Only a preset that keeps something asks for a cache.
        let kept = camera.get::<Picture>().filter(|_| self.scene.picture).map(|p| (p.settings, p.preset));
        match (kept.filter(|(s, p)| renderer::keeps(s, *p)), camera.contains::<FrameCache>()) {
            (Some((settings, preset)), false) => {
                let renderer = renderer(&self.space, settings, preset, true);
                camera.insert(FrameCache { renderer, settings });
            }
            (None, true) => drop(camera.remove::<FrameCache>()),
            _ => {}
        }
        if self.scene.operator && moves && !camera.contains::<Hand>() {
            camera.insert(Hand::default());
        }
        self.app.build()
    }

    /// Puts the camera at the start of the plan.
    pub(super) fn set_out(&mut self) {
        let attitude = match (&self.scene.play, self.fields.route()) {
            (Some(play), _) => play.now().attitude,
            (None, Some(route)) => {
                let s = route.nearest(self.plan.start).first().copied().unwrap_or(0.0);
                Attitude::new(route.look(s, self.scene.path.look_ahead_mm), route.up(s))
            }
            (None, None) => plan::first_attitude(&self.space, self.plan.start, self.plan.goal),
        };
        self.app
            .world
            .entity_mut(self.camera)
            .insert((Pose { position: self.plan.start, attitude }, Flight::default()));
        self.rest(self.plan.start, attitude.forward);
        self.trail.set_out(self.plan.length_mm);
    }

    /// Brings the body, if there is one, to rest at a place, heading along `forward`.
    pub(super) fn rest(&mut self, position: DVec3, forward: DVec3) {
        let Some(clearance_mm) = self.app.world.get::<Walls>(self.scan).map(|w| w.0.at(position).mm) else { return };
        self.app.world.entity_mut(self.camera).insert((
            Heading(forward),
            Velocity::default(),
            Spin::default(),
            Contact { clearance_mm, ..Contact::default() },
        ));
    }
}
