//! A flight: a scan entity, a camera entity, and the schedules over them.

use std::collections::VecDeque;
use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::app::plan::{self, Plan};
use crate::app::scene::{Guide, Scene};
use crate::components::App;
use crate::components::camera::{Body, Contact, Heading, Pose, Spin, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Goal, State, Watch};
use crate::components::guide::{Automatic, GuideThrust, MineField, MinePush, Tentacles};
use crate::components::input::{Act, Command, Hand, Inbox};
use crate::components::output::{FlightLog, FrameCache, GuideName, LogLine, Picture};
use crate::components::scan::{RaySpace, Scan, Walls};
use crate::dynamics::mines::Mines;
use crate::dynamics::rescue::Rescue;
use crate::error::Result;
use crate::fields::clearance::TOLERANCE_MM;
use crate::fields::{ClearanceFinder, Lumen};
use crate::render::{Frame, Preset, Settings, Space, Work, renderer};

/// How far clearances are exact, mm; the contract asks for 10.
const CLEARANCE_MM: f64 = 11.0;

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
    space: Space,
    lumen: Arc<Lumen>,
    plan: Plan,
    camera: Entity,
    scan: Entity,
    /// Commands still to come (a replay), by step.
    coming: VecDeque<Act>,
    /// Every command that acted, for recording.
    acted: Option<Vec<Act>>,
    flown: Vec<usize>,
}

impl FlightApp {
    /// A flight at its start.
    ///
    /// # Errors
    /// When the scene is not consistent.
    pub fn new(
        space: Space,
        lumen: Arc<Lumen>,
        plan: Plan,
        scene: Scene,
        image: Option<ImageSettings>,
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
        };
        flight.rebuild()?;
        flight.set_out();
        Ok(flight)
    }

    /// Builds the schedules and the components anew for the scene as it is now: what it needs is added, what it does
    /// not need is removed.
    fn rebuild(&mut self) -> Result<()> {
        self.app.clear_systems();
        self.app.world.insert_resource(GuideName("none"));
        self.scene.plug_into(&mut self.app)?;
        let (moves, feels) = (self.scene.moves(), self.scene.feels());
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
        match self.scene.watch.filter(|_| moves) {
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
    fn set_out(&mut self) {
        let attitude = plan::first_attitude(&self.space, self.plan.start, self.plan.goal);
        self.app
            .world
            .entity_mut(self.camera)
            .insert((Pose { position: self.plan.start, attitude }, Flight::default()));
        self.rest(self.plan.start, attitude.forward);
    }

    /// Brings the body, if there is one, to rest at a place, heading along `forward`.
    fn rest(&mut self, position: DVec3, forward: DVec3) {
        let Some(clearance_mm) = self.app.world.get::<Walls>(self.scan).map(|w| w.0.at(position).mm) else { return };
        self.app.world.entity_mut(self.camera).insert((
            Heading(forward),
            Velocity::default(),
            Spin::default(),
            Contact { clearance_mm, ..Contact::default() },
        ));
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
        if let (Some(why), true) = (&self.plan.falls_short, self.flight().state == State::Arrived) {
            let reason = format!("the gas ends here: {why}");
            if let Some(mut f) = self.app.world.get_mut::<Flight>(self.camera) {
                f.state = State::Operator;
                f.reason = reason;
            }
        }
        Ok(())
    }

    /// Traces the image of the pose as it is now.
    pub fn frame(&mut self) {
        self.app.frame();
    }

    /// Lets the operator act before the next step.
    ///
    /// # Errors
    /// When a command asks for something that there is not.
    pub fn act(&mut self, command: Command) -> Result<()> {
        let tick = self.clock().tick;
        self.follow(command.clone())?;
        // Only what was followed: a replay must not stop at what was refused.
        if let Some(acted) = &mut self.acted {
            acted.push(Act { tick, command });
        }
        Ok(())
    }

    fn follow(&mut self, command: Command) -> Result<()> {
        match command {
            Command::Guide(name) => {
                let guide = Guide::named(&name).ok_or_else(|| {
                    crate::error::Error::usage("guide", format!("there is no {name:?}"), "choose tentacles or manual")
                })?;
                self.scene.guide = Some(guide);
                self.scene.own_guide = None;
                self.rebuild()?;
                self.resume();
            }
            Command::Reverse => {
                let plan = &mut self.plan;
                std::mem::swap(&mut plan.goal, &mut plan.other_end);
                std::mem::swap(&mut plan.within_mm, &mut plan.other_within_mm);
                self.rebuild()?;
                if let Some(mut heading) = self.app.world.get_mut::<Heading>(self.camera) {
                    heading.0 = -heading.0;
                }
                self.resume();
            }
            Command::Segment(number) => {
                self.note_flown();
                self.plan = plan::through_segment(&self.space, &self.lumen, number, false, self.scene.body.radius_mm)?;
                self.rebuild()?;
                self.set_out();
            }
            Command::OtherEnd => {
                let number = self.plan.segment.ok_or_else(|| {
                    crate::error::Error::incomplete("other end", "not known of this gas", "turn round instead")
                })?;
                let reverse = !self.is_reversed();
                let radius = self.scene.body.radius_mm;
                let plan = plan::through_segment(&self.space, &self.lumen, number, reverse, radius)?;
                self.note_flown();
                self.plan = plan;
                self.rebuild()?;
                self.set_out();
            }
            other => {
                if let Some(mut inbox) = self.app.world.get_resource_mut::<Inbox>() {
                    inbox.0.push_back(other);
                }
            }
        }
        Ok(())
    }

    fn resume(&mut self) {
        if let Some(mut flight) = self.app.world.get_mut::<Flight>(self.camera) {
            flight.state = State::Flying;
            flight.reason.clear();
            flight.escapes = 0;
        }
    }

    fn note_flown(&mut self) {
        if let Some(n) = self.plan.segment
            && self.flight().state == State::Arrived
            && !self.flown.contains(&n)
        {
            self.flown.push(n);
        }
    }

    /// Replays acts in the steps they were made in.
    pub fn replay(&mut self, acts: Vec<Act>) {
        self.coming = acts.into();
    }

    /// Whether acts are still to be replayed.
    pub fn is_replaying(&self) -> bool {
        !self.coming.is_empty()
    }

    /// Keeps every act from here on.
    pub fn record_acts(&mut self) {
        self.acted = Some(Vec::new());
    }

    /// The acts kept since [`FlightApp::record_acts`].
    pub fn acts(&self) -> &[Act] {
        self.acted.as_deref().unwrap_or(&[])
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
        let arrived = (self.flight().state == State::Arrived).then_some(self.plan.segment).flatten();
        self.lumen
            .segments
            .iter()
            .enumerate()
            .filter(|(n, _)| arrived != Some(*n) && !self.flown.contains(n))
            // The one being flown is not "another one".
            .filter(|(n, _)| self.plan.segment != Some(*n))
            .map(|(n, s)| (n, s.ml))
            .collect()
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
        let here = Pose { position: self.plan.start, attitude: crate::dynamics::Attitude::new(DVec3::Y, DVec3::Z) };
        self.camera().copied().unwrap_or(here)
    }

    /// Puts the camera somewhere (a flight taken up where it was left); refused where the body does not fit.
    pub fn place(&mut self, position: DVec3, forward: DVec3, up: DVec3) -> bool {
        let fits = self.app.world.get::<Walls>(self.scan).map_or(0.0, |w| w.0.at(position).mm);
        if fits <= self.scene.body.radius_mm + TOLERANCE_MM {
            return false;
        }
        let attitude = crate::dynamics::Attitude::new(forward, up);
        self.app.world.entity_mut(self.camera).insert(Pose { position, attitude });
        self.rest(position, attitude.forward);
        true
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

    /// The volume made ready for rays.
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// The application, for explanations.
    pub fn app(&self) -> &App {
        &self.app
    }
}
