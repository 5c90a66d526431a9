//! A flight: a scan entity, a camera entity, and the schedules over them.

use std::collections::VecDeque;
use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::app::fields::{Fields, Wanted};
use crate::app::plan::{self, Plan};
use crate::app::scene::{Guide, Scene};
use crate::app::trail::Trail;
use crate::components::App;
use crate::components::camera::{Body, Contact, Heading, Pose, Spin, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Goal, State, Watch};
use crate::components::guide::{
    Automatic, Field, GuideThrust, MineField, MinePush, Planned, PotentialField, PotentialSettings, Tentacles,
};
use crate::components::input::{Act, Command, Hand, Inbox};
use crate::components::output::{FlightLog, FrameCache, GuideName, LogLine, Picture};
use crate::components::play::Playback;
use crate::components::scan::{RaySpace, Scan, Walls};
use crate::dynamics::Attitude;
use crate::dynamics::mines::Mines;
use crate::dynamics::rescue::Rescue;
use crate::error::{Error, Result};
use crate::fields::clearance::TOLERANCE_MM;
use crate::fields::{ClearanceFinder, Lumen, lumen};
use crate::progress::Progress;
use crate::render::{Coverage, Frame, Preset, Settings, Space, Work, coverage, renderer};

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
        space: Space,
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
        space: Space,
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

    /// Builds the schedules and the components anew for the scene as it is now: what it needs is added, what it does
    /// not need is removed.
    fn rebuild(&mut self) -> Result<()> {
        self.app.clear_systems();
        self.app.world.insert_resource(GuideName("none"));
        self.scene.plug_into(&mut self.app)?;
        let (moves, feels, guide) = (self.scene.moves(), self.scene.feels(), self.scene.steers());
        self.fields.build(Wanted::by(guide), self.space.volume(), &self.lumen, &self.plan, &self.progress)?;
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
    fn set_out(&mut self) {
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
        let pose = self.pose();
        self.trail.follow(pose.position, pose.attitude);
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
                    let names = Guide::ALL.map(|g| g.1).join(", ");
                    Error::usage("guide", format!("there is no {name:?}"), format!("choose one of {names}"))
                })?;
                if self.scene.play.is_some() {
                    let why = "the flight is a log that is played";
                    return Err(Error::usage("guide", why, "fly without --play"));
                }
                let before = (self.scene.guide, self.scene.own_guide.take());
                self.scene.guide = Some(guide);
                self.change(|flight| (flight.scene.guide, flight.scene.own_guide) = before)?;
                self.resume();
            }
            Command::Reverse => {
                let before = self.plan.clone();
                let plan = &mut self.plan;
                plan.begin = plan.goal;
                std::mem::swap(&mut plan.goal, &mut plan.other_end);
                std::mem::swap(&mut plan.within_mm, &mut plan.other_within_mm);
                self.change(|flight| flight.plan = before)?;
                if let Some(mut heading) = self.app.world.get_mut::<Heading>(self.camera) {
                    heading.0 = -heading.0;
                }
                self.resume();
            }
            Command::Segment(number) => {
                let plan = plan::through_segment(&self.space, &self.lumen, number, false, self.scene.body.radius_mm)?;
                self.set_out_on(plan)?;
            }
            Command::OtherEnd => {
                let number = self
                    .plan
                    .segment
                    .ok_or_else(|| Error::incomplete("other end", "not known of this gas", "turn round instead"))?;
                let reverse = !self.is_reversed();
                let radius = self.scene.body.radius_mm;
                let plan = plan::through_segment(&self.space, &self.lumen, number, reverse, radius)?;
                self.set_out_on(plan)?;
            }
            Command::Seek(share) => self.seek(share)?,
            other => {
                if let Some(mut inbox) = self.app.world.get_resource_mut::<Inbox>() {
                    inbox.0.push_back(other);
                }
            }
        }
        Ok(())
    }

    /// Builds the flight anew after a change; where that fails, for what it was before.
    fn change(&mut self, back: impl FnOnce(&mut Self)) -> Result<()> {
        self.rebuild().or_else(|e| {
            back(self);
            self.rebuild()?;
            Err(e)
        })
    }

    /// Sets out anew with another plan.
    fn set_out_on(&mut self, plan: Plan) -> Result<()> {
        self.note_flown();
        let before = std::mem::replace(&mut self.plan, plan);
        self.change(|flight| flight.plan = before)?;
        self.set_out();
        Ok(())
    }

    /// Takes the camera to a share (0 to 1) of the way: of the plan, of the log that is played, or without either of the
    /// way that was flown.
    fn seek(&mut self, share: f64) -> Result<()> {
        let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
        if let Some(mut play) = self.app.world.get_mut::<Playback>(self.camera) {
            play.seek(share);
            let now = play.now();
            let pose = Pose { position: now.position, attitude: now.attitude };
            self.app.world.entity_mut(self.camera).insert(pose);
            self.resume();
            return Ok(());
        }
        let (position, forward, up) = match self.fields.route() {
            Some(route) => {
                let s = route.length_mm() * share;
                (route.place(s), route.look(s, self.scene.path.look_ahead_mm), route.up(s))
            }
            None => {
                let at = self.trail.at(self.plan.length_mm * share).ok_or_else(|| {
                    Error::incomplete("way", "not flown until there, and not planned", "change the guide to path (G)")
                })?;
                (at.0, at.1.forward, at.1.up)
            }
        };
        if !self.place(position, forward, up) {
            return Err(Error::incomplete("way", "the camera does not fit there", "choose another place"));
        }
        if let Some(mut planned) = self.app.world.get_mut::<Planned>(self.camera) {
            planned.pilot = None;
        }
        if let Some(mut watch) = self.app.world.get_mut::<Watch>(self.camera) {
            watch.rescue.restart();
        }
        if let Some(mut mines) = self.app.world.get_mut::<MineField>(self.camera) {
            mines.mines.clear();
        }
        self.resume();
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

    /// The way flown since the flight last set out, each 2 mm.
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
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// The application, for explanations.
    pub fn app(&self) -> &App {
        &self.app
    }
}
