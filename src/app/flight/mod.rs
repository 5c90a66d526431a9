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
use crate::components::camera::Pose;
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Flown, State};
use crate::components::input::Act;
use crate::components::output::{FlightLog, LogLine, Picture};
use crate::components::scan::{Scan, Walls};
use crate::components::trail::Trail;
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::fields::clearance::TOLERANCE_MM;
use crate::fields::{Lumen, lumen};
use crate::progress::Progress;
use crate::render::{Coverage, Frame, PreparedVolume, Reuse, Settings, View, Work, coverage, renderer};
use crate::schedule::App;

/// A flight under way: what a host drives, the same for a window and headless.
///
/// It is made by [`Scan::flight`](crate::app::Scan::flight), or from its parts by [`FlightApp::new`].
pub struct FlightApp {
    app: App,
    scene: Scene,
    volume: PreparedVolume,
    lumen: Arc<Lumen>,
    plan: Plan,
    /// Commands still to come (a replay), by step.
    coming: VecDeque<Act>,
    /// Every command that acted, for recording.
    acted: Option<Vec<Act>>,
    fields: Fields,
    progress: Arc<Progress>,
}

impl FlightApp {
    /// A flight at its start.
    ///
    /// # Errors
    /// When the scene is not consistent; status 4 where the guide plans and there is no way.
    pub fn new(volume: PreparedVolume, lumen: Arc<Lumen>, plan: Plan, scene: Scene) -> Result<Self> {
        Self::prepared(volume, lumen, plan, scene, Arc::new(Progress::new()))
    }

    /// [`FlightApp::new`], telling how far what the guide needs is built.
    ///
    /// # Errors
    /// As above, and status 4 when interrupted.
    pub fn prepared(
        volume: PreparedVolume,
        lumen: Arc<Lumen>,
        plan: Plan,
        scene: Scene,
        progress: Arc<Progress>,
    ) -> Result<Self> {
        scene.check()?;
        let mut app = App::new();
        app.scan().insert(Scan(volume.clone()));
        app.camera().insert((Flight::default(), Flown::default(), Trail::default()));
        if scene.picture {
            let i = &scene.image;
            app.camera().insert(Picture {
                camera: i.camera,
                fov_degrees: i.fov_degrees,
                settings: i.settings,
                preset: i.preset,
                frame: Frame::new(i.width, i.height),
                work: Work::default(),
                due: false,
                traced: false,
            });
        }
        let mut flight = Self {
            app,
            scene,
            volume,
            lumen,
            plan,
            coming: VecDeque::new(),
            acted: None,
            fields: Fields::default(),
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
        Ok(())
    }

    /// Flies on by so many simulated seconds, or until the flight ends by itself.
    ///
    /// # Errors
    /// As [`FlightApp::step`].
    pub fn fly(&mut self, seconds: f64) -> Result<State> {
        let steps = (seconds * f64::from(self.clock().hz)).round() as u64;
        for _ in 0..steps {
            if self.flight().state != State::Flying {
                break;
            }
            self.step()?;
        }
        Ok(self.flight().state)
    }

    /// Traces the picture of the pose as it is now, and presents it. Does nothing in a scene without a picture.
    pub fn frame(&mut self) {
        if let Some(mut picture) = self.camera_mut::<Picture>() {
            picture.due = true;
        }
        self.app.frame();
    }

    /// Presents the picture again as it was last traced: for something new that lies over it.
    pub fn present(&mut self) {
        self.app.frame();
    }

    /// The view that its picture is of, from where the camera is now; none in a scene without a picture.
    pub fn view(&self) -> Option<View> {
        let (pose, picture) = (self.pose(), self.camera::<Picture>()?);
        let Attitude { forward, up } = pose.attitude;
        let (width, height) = (picture.frame.width(), picture.frame.height());
        View::with_model(pose.position, forward, up, picture.camera, picture.fov_degrees, width, height).ok()
    }

    /// What the camera sees now, in `width` × `height` pixels, whether or not the scene has a picture: at high quality, by the
    /// scene's renderer.
    ///
    /// # Errors
    /// Status 2 for an image without pixels.
    pub fn look(&self, width: usize, height: usize) -> Result<Frame> {
        let (pose, image) = (self.pose(), &self.scene.image);
        let Attitude { forward, up } = pose.attitude;
        let fov_degrees = self.camera::<Picture>().map_or(image.fov_degrees, |p| p.fov_degrees);
        let view = View::with_model(pose.position, forward, up, image.camera, fov_degrees, width, height)?;
        let settings = Settings { adaptive: false, ..image.settings };
        let mut frame = Frame::new(width, height);
        renderer(&self.volume, settings, image.preset, Reuse::Never).render(&view, &mut frame);
        Ok(frame)
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
        if let Some(mut f) = self.camera_mut::<Flight>()
            && f.state == State::Flying
        {
            f.state = State::Ended;
        }
    }

    /// Segments of the lumen not flown to their end yet, with their gas in ml.
    pub fn unflown(&self) -> Vec<(usize, f64)> {
        let flown = self.camera::<Flown>().map_or(&[][..], |f| &f.done);
        self.lumen
            .segments
            .iter()
            .enumerate()
            .filter(|(n, _)| !flown.contains(n))
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
    pub fn trail(&self) -> Option<&Trail> {
        self.camera()
    }

    /// Share of the wall of the gas flown through that was seen: see [`crate::render::coverage()`]. None where that gas is
    /// not known.
    ///
    /// # Errors
    /// Status 4 when interrupted.
    pub fn coverage(&self, fov_degrees: f64) -> Result<Option<Coverage>> {
        let places = self.trail().map_or(&[][..], Trail::views);
        let mut gas = self.plan.gas.clone().unwrap_or_else(|| Arc::clone(&self.lumen));
        if gas.segments.is_empty()
            && let Some(first) = places.first()
        {
            // A log that was played: the colon was not asked for until now.
            gas = Arc::new(lumen::find(self.volume.volume(), &self.progress)?);
            if gas.segment_at(first.0).is_none()
                && let Some(there) = lumen::gas_at(self.volume.volume(), first.0, &self.progress)?
            {
                gas = Arc::new(there);
            }
        }
        let mut flown: Vec<usize> = places.iter().filter_map(|p| gas.segment_at(p.0)).collect();
        flown.sort_unstable();
        flown.dedup();
        let walls = gas.wall_places(&flown);
        Ok((!walls.is_empty()).then(|| coverage(&self.volume, &walls, places, fov_degrees)))
    }

    /// A component of the camera.
    pub fn camera<T: Component>(&self) -> Option<&T> {
        self.app.camera_get()
    }

    /// A component of the camera, to change it: a window resizes its picture, say.
    pub fn camera_mut<T: Component<Mutability = bevy_ecs::component::Mutable>>(&mut self) -> Option<Mut<'_, T>> {
        self.app.camera_get_mut()
    }

    /// The camera's pose.
    pub fn pose(&self) -> Pose {
        let here = Pose { position: self.plan.start, attitude: Attitude::new(DVec3::Y, DVec3::Z) };
        self.camera().copied().unwrap_or(here)
    }

    /// Puts the camera somewhere (a flight taken up where it was left); refused where the body does not fit.
    pub fn place(&mut self, position: DVec3, forward: DVec3, up: DVec3) -> bool {
        let fits = self.app.scan_get::<Walls>().map_or(0.0, |w| w.0.at(position).mm);
        if fits <= self.scene.body.radius_mm + TOLERANCE_MM {
            return false;
        }
        let attitude = Attitude::new(forward, up);
        self.app.camera().insert(Pose { position, attitude });
        self.rest(position, attitude.forward);
        true
    }

    /// Says how far along the way the camera stands, mm: for a flight that goes on from where another was left.
    pub fn stands_at(&mut self, along_mm: f64) {
        let share = along_mm / self.plan.length_mm;
        self.jump(if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 });
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
    pub fn volume(&self) -> &PreparedVolume {
        &self.volume
    }

    /// The world and its schedules, for explanations.
    pub fn app(&self) -> &App {
        &self.app
    }

    /// The same, for a host that hands its presenter to it.
    pub fn app_mut(&mut self) -> &mut App {
        &mut self.app
    }
}
