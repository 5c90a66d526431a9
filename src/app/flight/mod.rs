//! A flight: a scan entity, a camera entity, and the schedules over them.

mod assemble;
mod commands;

use std::collections::VecDeque;
use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::app::fields::Fields;
use crate::app::plan::Plan;
use crate::app::scene::Scene;
use crate::app::trail::Trail;
use crate::components::App;
use crate::components::camera::Pose;
use crate::components::clock::Clock;
use crate::components::flight::{Flight, State};
use crate::components::guide::Planned;
use crate::components::input::Act;
use crate::components::output::{FlightLog, LogLine, Picture};
use crate::components::scan::{Scan, Walls};
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::fields::clearance::TOLERANCE_MM;
use crate::fields::{Lumen, lumen};
use crate::progress::Progress;
use crate::render::{Coverage, Frame, PreparedVolume, Preset, Settings, Work, coverage};

/// How images are made.
#[derive(Clone, Debug)]
pub struct ImageSettings {
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
    /// View angle over the shorter side, degrees.
    pub fov_degrees: f64,
    /// The renderer's settings.
    pub settings: Settings,
    /// Which renderer.
    pub preset: Preset,
}

/// What a host drives: the same for a window and headless.
pub struct FlightApp {
    app: App,
    scene: Scene,
    space: PreparedVolume,
    lumen: Arc<Lumen>,
    plan: Plan,
    camera: Entity,
    scan: Entity,
    /// Commands still to come (a replay), by step.
    coming: VecDeque<Act>,
    /// Every command that acted, for recording.
    acted: Option<Vec<Act>>,
    flown: Vec<usize>,
    fields: Fields,
    trail: Trail,
    progress: Arc<Progress>,
}

impl FlightApp {
    /// A flight at its start.
    ///
    /// # Errors
    /// When the scene is not consistent; status 4 where the guide plans and there is no way.
    pub fn new(
        space: PreparedVolume,
        lumen: Arc<Lumen>,
        plan: Plan,
        scene: Scene,
        image: Option<ImageSettings>,
    ) -> Result<Self> {
        Self::prepared(space, lumen, plan, scene, image, Arc::new(Progress::new()))
    }

    /// [`FlightApp::new`], telling how far what the guide needs is built.
    ///
    /// # Errors
    /// As above, and status 4 when interrupted.
    pub fn prepared(
        space: PreparedVolume,
        lumen: Arc<Lumen>,
        plan: Plan,
        scene: Scene,
        image: Option<ImageSettings>,
        progress: Arc<Progress>,
    ) -> Result<Self> {
        scene.check()?;
        let mut app = App::new();
        app.world.insert_resource(Clock::default());
        let scan = app.world.spawn(Scan(space.shared_volume())).id();
        let camera = app.world.spawn(Flight::default()).id();
        if let Some(i) = image {
            app.world.entity_mut(camera).insert(Picture {
                fov_degrees: i.fov_degrees,
                settings: i.settings,
                preset: i.preset,
                frame: Frame::new(i.width, i.height, false),
                work: Work::default(),
            });
        }
        let mut flight = Self {
            app,
            scene,
            space,
            lumen,
            plan,
            camera,
            scan,
            coming: VecDeque::new(),
            acted: None,
            flown: Vec::new(),
            fields: Fields::default(),
            trail: Trail::default(),
            progress,
        };
        flight.rebuild()?;
        flight.set_out();
        Ok(flight)
    }

    /// One simulation step, with the commands that are due.
    ///
    /// # Errors
    /// When a command asks for something that there is not.
    pub fn step(&mut self) -> Result<()> {
        let tick = self.clock().tick;
        while self.coming.front().is_some_and(|a| a.tick <= tick) {
            if let Some(act) = self.coming.pop_front() {
                self.act(act.command)?;
            }
        }
        self.app.step();
        self.app.world.resource_mut::<Clock>().tick += 1;
        let pose = self.pose();
        let planned = self.camera::<Planned>().map(|p| (p.s_mm, p.route.length_mm()));
        self.trail.follow((pose.position, pose.attitude), self.flight().length_mm, planned);
        self.note_flown();
        if let (Some(why), true) = (&self.plan.falls_short, self.flight().state == State::Arrived) {
            let reason = format!("the gas ends here: {why}");
            if let Some(mut f) = self.app.world.get_mut::<Flight>(self.camera) {
                f.state = State::Operator;
                f.reason = reason;
            }
        }
        if self.flight().state == State::Arrived {
            self.trail.arrive();
        }
        Ok(())
    }

    /// Traces the image of the pose as it is now.
    pub fn frame(&mut self) {
        self.app.frame();
    }

    /// Takes what there is to say to the user of what was planned since the last call.
    pub fn take_notes(&mut self) -> Vec<String> {
        self.fields.take_notes()
    }

    /// Takes the steps written down since the last call.
    pub fn take_log(&mut self) -> Vec<LogLine> {
        self.app.world.get_resource_mut::<FlightLog>().map_or_else(Vec::new, |mut l| std::mem::take(&mut l.0))
    }

    /// Ends the flight because its time is over.
    pub fn end(&mut self) {
        if let Some(mut f) = self.app.world.get_mut::<Flight>(self.camera)
            && f.state == State::Flying
        {
            f.state = State::Ended;
        }
    }

    /// Segments of the lumen not flown to their end yet, with their gas in ml.
    pub fn unflown(&self) -> Vec<(usize, f64)> {
        self.lumen
            .segments
            .iter()
            .enumerate()
            .filter(|(n, _)| !self.flown.contains(n))
            // The one being flown is not "another one".
            .filter(|(n, _)| self.plan.segment != Some(*n))
            .map(|(n, s)| (n, s.ml))
            .collect()
    }

    /// What the guide needed of the lumen.
    pub fn fields(&self) -> &Fields {
        &self.fields
    }

    /// Takes over fields that were built elsewhere for this flight; what does not fit its plan is built anew.
    pub fn adopt(&mut self, fields: Fields) {
        self.fields = fields;
    }

    /// How long fields took that were built since the last call, s.
    pub fn take_field_times(&mut self) -> Vec<(&'static str, f64)> {
        self.fields.take_times()
    }

    /// The views of the flight from its beginning on, each 2 mm, and how far along the way they lie.
    pub fn trail(&self) -> &Trail {
        &self.trail
    }

    /// Share of the wall of the gas flown through that was seen: see [`crate::render::coverage`]. None where that gas is
    /// not known.
    ///
    /// # Errors
    /// Status 4 when interrupted.
    pub fn coverage(&self, fov_degrees: f64) -> Result<Option<Coverage>> {
        let places = self.trail.views();
        let mut gas = self.plan.gas.clone().unwrap_or_else(|| Arc::clone(&self.lumen));
        if gas.segments.is_empty()
            && let Some(first) = places.first()
        {
            // A log that was played: the colon was not asked for until now.
            gas = Arc::new(lumen::find(self.space.volume(), &self.progress)?);
            if gas.segment_at(first.0).is_none()
                && let Some(there) = lumen::gas_at(self.space.volume(), first.0, &self.progress)?
            {
                gas = Arc::new(there);
            }
        }
        let mut flown: Vec<usize> = places.iter().filter_map(|p| gas.segment_at(p.0)).collect();
        flown.sort_unstable();
        flown.dedup();
        let walls = gas.wall_places(&flown);
        Ok((!walls.is_empty()).then(|| coverage(&self.space, &walls, places, fov_degrees)))
    }

    /// A component of the camera.
    pub fn camera<T: Component>(&self) -> Option<&T> {
        self.app.world.get(self.camera)
    }

    /// A component of the camera, to change it: a window resizes its picture, say.
    pub fn camera_mut<T: Component<Mutability = bevy_ecs::component::Mutable>>(&mut self) -> Option<Mut<'_, T>> {
        self.app.world.get_mut(self.camera)
    }

    /// The camera's pose.
    pub fn pose(&self) -> Pose {
        let here = Pose { position: self.plan.start, attitude: Attitude::new(DVec3::Y, DVec3::Z) };
        self.camera().copied().unwrap_or(here)
    }

    /// Puts the camera somewhere (a flight taken up where it was left); refused where the body does not fit.
    pub fn place(&mut self, position: DVec3, forward: DVec3, up: DVec3) -> bool {
        let fits = self.app.world.get::<Walls>(self.scan).map_or(0.0, |w| w.0.at(position).mm);
        if fits <= self.scene.body.radius_mm + TOLERANCE_MM {
            return false;
        }
        let attitude = Attitude::new(forward, up);
        self.app.world.entity_mut(self.camera).insert(Pose { position, attitude });
        self.rest(position, attitude.forward);
        true
    }

    /// Says how far along the way the camera stands, mm: for a flight that goes on from where another was left.
    pub fn stands_at(&mut self, along_mm: f64) {
        let share = along_mm / self.plan.length_mm;
        self.trail.jump(if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 });
    }

    /// How the flight stands.
    pub fn flight(&self) -> Flight {
        self.camera().cloned().unwrap_or_default()
    }

    /// Simulated time.
    pub fn clock(&self) -> Clock {
        *self.app.world.resource::<Clock>()
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Whether the flight goes to its segment's rectal end.
    pub fn is_reversed(&self) -> bool {
        self.plan.segment.and_then(|n| self.lumen.segments.get(n)).is_some_and(|s| {
            let [rectal, cecal] = s.ends;
            self.plan.goal.distance(rectal) < self.plan.goal.distance(cecal)
        })
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The colon.
    pub fn lumen(&self) -> &Lumen {
        &self.lumen
    }

    /// The colon, to be shared.
    pub fn shared_lumen(&self) -> Arc<Lumen> {
        Arc::clone(&self.lumen)
    }

    /// The volume made ready for rays.
    pub fn space(&self) -> &PreparedVolume {
        &self.space
    }

    /// The application, for explanations.
    pub fn app(&self) -> &App {
        &self.app
    }
}
