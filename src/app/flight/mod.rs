//! A flight: a scan entity, a camera entity, and the schedules over them.

mod assemble;
mod commands;

use std::collections::VecDeque;
use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::app::fields::Fields;
use crate::app::plan::{self, Plan};
use crate::app::scene::Scene;
use crate::components::camera::{AngularMomentum, Heading, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Flown, State};
use crate::components::input::TimedCommand;
use crate::components::output::{FlightLog, Follows, FrameCache, LogLine, Picture};
use crate::components::play::Playback;
use crate::components::scan::{Scan, Walls};
use crate::components::slices::SliceView;
use crate::components::trail::Trail;
use crate::dynamics::Attitude;
use crate::error::{Error, Result};
use crate::fields::clearance::TOLERANCE_MM;
use crate::fields::{Lumen, lumen};
use crate::panics;
use crate::progress::Progress;
use crate::render::{Coverage, Frame, PreparedVolume, Reuse, Settings, View, coverage, renderer};
use crate::schedule::{App, note};
use crate::systems;
use crate::systems::present::{self, Presenter};

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
    coming: VecDeque<TimedCommand>,
    /// Every command that acted, for recording.
    acted: Option<Vec<TimedCommand>>,
    fields: Fields,
    progress: Arc<Progress>,
    /// The camera's last pose that was one.
    sound: Option<Pose>,
    /// The views, to be marked before each frame; kept, since to set a query up takes memory.
    pictures: Option<QueryState<&'static mut Picture>>,
    views: Option<ViewsToMark>,
}

/// What tells whether a view is finished.
type ViewsToMark =
    QueryState<(Entity, &'static mut Picture, &'static FrameCache, Option<&'static Pose>, Option<&'static Follows>)>;

/// A camera farther from the origin than this is nowhere, mm.
const FARTHEST_MM: f64 = 1e9;

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
            app.camera().insert(scene.image.picture());
        }
        let built_in = systems::guides();
        if !scene.plugins.is_empty() || scene.guides.iter().any(|g| built_in.named(g.name).is_none()) {
            app.keep_account();
        }
        for plugin in scene.plugins.iter() {
            app.plug(plugin)?;
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
            sound: None,
            pictures: None,
            views: None,
        };
        flight.rebuild()?;
        flight.prepare_views()?;
        flight.set_out();
        Ok(flight)
    }

    /// Adds a view: an entity with a [`Picture`] and a place to look from, a [`Pose`] of its own or
    /// [`Follows`], and whatever else it is to carry. It is rendered in each frame from now
    /// on. A view that is spawned into the world is, too; this one has its renderer made ready at once.
    ///
    /// # Errors
    /// Status 2 for a picture whose preset does not follow its settings, or that no camera can make.
    pub fn add_view(&mut self, view: impl Bundle) -> Result<Entity> {
        let entity = self.app.world.spawn(view).id();
        let checked = self.check_view(entity).and_then(|()| self.plug_late());
        if let Err(e) = checked {
            self.app.world.despawn(entity);
            return Err(e);
        }
        if let Err(e) = self.prepare_views() {
            self.app.world.despawn(entity);
            return Err(e);
        }
        Ok(entity)
    }

    /// Adds a slice: an entity with a [`SliceView`]. It is drawn in each frame that changes it.
    ///
    /// # Errors
    /// As for any change of the schedule.
    pub fn add_slice(&mut self, slice: SliceView) -> Result<Entity> {
        let entity = self.app.world.spawn(slice).id();
        self.plug_late()?;
        Ok(entity)
    }

    /// All slices.
    pub fn slices(&self) -> Vec<&SliceView> {
        let world = &self.app.world;
        let entities = world.archetypes().iter().flat_map(|a| a.entities().iter().map(|e| e.id()));
        entities.filter_map(|e| world.get::<SliceView>(e)).collect()
    }

    fn check_view(&self, entity: Entity) -> Result<()> {
        let world = &self.app.world;
        let Some(p) = world.get::<Picture>(entity) else {
            return Err(Error::usage("view", "has no Picture", "spawn it with Picture::new(width, height)"));
        };
        if !world.entity(entity).contains::<Pose>() && !world.entity(entity).contains::<Follows>() {
            return Err(Error::usage("view", "has no place to look from", "give it a Pose, or Follows"));
        }
        p.settings.choices.check()?;
        let preset = || format!("preset {}", p.preset.name);
        panics::ask_plugin(preset, || (p.preset.takes)(&p.settings.choices))?;
        panics::ask_plugin(preset, || (p.preset.check)(p.settings.options))?;
        p.settings.shader.check()?;
        let (width, height) = (p.frame.width(), p.frame.height());
        View::with_model(DVec3::ZERO, DVec3::Y, DVec3::Z, p.camera, p.fov_degrees, width, height).map(drop)
    }

    /// Makes the renderers of views that have none yet, so that the first frame takes no longer than others.
    fn prepare_views(&mut self) -> Result<()> {
        let Self { app, volume, .. } = self;
        let mut views = app.world.query::<(&Picture, &mut FrameCache)>();
        for (picture, mut cache) in views.iter_mut(&mut app.world) {
            if picture.scan.is_none() {
                panics::ask_plugin(
                    || format!("preset {}", picture.preset.name),
                    || {
                        cache.renderer_for(volume, picture.settings, picture.preset);
                        Ok(())
                    },
                )?;
            }
        }
        Ok(())
    }

    /// The views beside the camera's own, in the order in which they are rendered, with what their renderers keep.
    pub fn other_views(&self) -> Vec<(&Picture, &FrameCache)> {
        let camera = self.app.camera_id();
        let world = &self.app.world;
        let mut views: Vec<_> = world
            .archetypes()
            .iter()
            .flat_map(|a| a.entities().iter().map(|e| e.id()))
            .filter(|&e| e != camera && world.entity(e).contains::<Picture>())
            .collect();
        views.sort_unstable_by_key(|e| e.index_u32());
        views.into_iter().filter_map(|e| Some((world.get(e)?, world.get(e)?))).collect()
    }

    /// Marks the views beside the camera's that would become better or other pictures if they were rendered now; whether
    /// there is one.
    pub fn mark_unfinished_views(&mut self) -> bool {
        let camera = self.app.camera_id();
        let here = self.pose();
        let mut any = false;
        let Self { app, views, .. } = self;
        let views = views.get_or_insert_with(|| app.world.query());
        for (entity, mut picture, cache, pose, follows) in views.iter_mut(&mut app.world) {
            if entity == camera {
                continue;
            }
            let pose = match follows {
                Some(f) if f.whom.is_none_or(|e| e == camera) => Some(f.pose(&here)),
                // Whom it follows may have moved: it is rendered.
                Some(_) => None,
                None => pose.copied(),
            };
            let same = pose.zip(picture.view.as_ref()).is_some_and(|(pose, view)| {
                let (width, height) = (picture.frame.width(), picture.frame.height());
                let Attitude { forward, up } = pose.attitude;
                View::with_model(pose.position, forward, up, picture.camera, picture.fov_degrees, width, height)
                    .is_ok_and(|now| now == *view)
            });
            picture.due |= !same || cache.is_unfinished(&picture);
            any |= picture.due;
        }
        any
    }

    /// Hands a view's pictures to a presenter from now on: see [`Presenter`].
    ///
    /// # Errors
    /// As for any change of the schedule.
    pub fn present_to(&mut self, view: Entity, presenter: impl Presenter) -> Result<()> {
        present::hand_to(&mut self.app, view, presenter);
        self.plug_late()
    }

    /// Takes the presenter of the camera's pictures away, if it is a `P`.
    pub fn take_presenter<P: Presenter>(&mut self) -> Option<P> {
        let camera = self.app.camera_id();
        present::take(&mut self.app, camera)
    }

    /// Adds what views and presenters that came later need.
    fn plug_late(&mut self) -> Result<()> {
        self.scene.plug_views(&mut self.app)?;
        if self.app.is_changed() { self.app.build() } else { Ok(()) }
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
        if self.app.is_changed() {
            self.app.build()?;
        }
        let stepped = self.app.step();
        self.keep_sound();
        stepped
    }

    /// Puts the camera back to where it last was, at rest, if a plug-in has written what is no place, no direction or no speed.
    fn keep_sound(&mut self) {
        let Some(pose) = self.camera::<Pose>().copied() else { return };
        let moving = [
            self.camera::<Velocity>().map(|v| v.0),
            self.camera::<AngularMomentum>().map(|s| s.0),
            self.camera::<Heading>().map(|h| h.0),
        ];
        let sound = |v: DVec3, most: f64| v.is_finite() && v.abs().max_element() <= most;
        let unit = |v: DVec3| v.is_finite() && (v.length_squared() - 1.0).abs() < 1e-3;
        let placed = sound(pose.position, FARTHEST_MM) && unit(pose.attitude.forward) && unit(pose.attitude.up);
        if placed && moving.into_iter().flatten().all(|v| sound(v, 1e12)) {
            self.sound = Some(pose);
            return;
        }
        let writers = [
            self.app.own_systems_that_write::<Pose>(),
            self.app.own_systems_that_write::<Velocity>(),
            self.app.own_systems_that_write::<AngularMomentum>(),
            self.app.own_systems_that_write::<Heading>(),
        ]
        .concat();
        let who = if writers.is_empty() { "a system".to_owned() } else { writers.join(" or ") };
        note(who, "wrote an invalid position, direction or speed: the camera was put back, at rest");
        let back = self.sound.unwrap_or(Pose {
            position: self.plan.start,
            attitude: plan::first_attitude(&self.volume, self.plan.start, self.plan.goal),
        });
        self.app.camera().insert(back);
        self.rest(back.position, back.attitude.forward);
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

    /// Traces the pictures of all views as they are now, and presents them. Does nothing in a scene without a view.
    ///
    /// # Errors
    /// Status 1 when systems were added whose order is ambiguous.
    pub fn frame(&mut self) -> Result<()> {
        let Self { app, pictures, .. } = self;
        let pictures = pictures.get_or_insert_with(|| app.world.query());
        pictures.iter_mut(&mut app.world).for_each(|mut p| p.due = true);
        self.frame_of_due()
    }

    /// As [`FlightApp::frame`], for those views alone that are due.
    ///
    /// # Errors
    /// As there.
    pub fn frame_of_due(&mut self) -> Result<()> {
        self.plug_late()?;
        present::take_over(&mut self.app);
        let made = self.app.frame();
        let Self { app, pictures, .. } = self;
        let pictures = pictures.get_or_insert_with(|| app.world.query());
        let mut resized = false;
        for mut picture in pictures.iter_mut(&mut app.world) {
            resized |= std::mem::take(&mut picture.resized);
        }
        if resized {
            let who = self.app.own_systems_that_write::<Picture>().join(" or ");
            note(if who.is_empty() { "a post-process" } else { &who }, "has resized a picture: it keeps its size");
        }
        made
    }

    /// Presents the camera's picture again as it was last traced: for something new that lies over it.
    pub fn present(&mut self) {
        let camera = self.app.camera_id();
        present::present_again(&mut self.app, camera);
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
    /// Status 2 for an image without pixels, 1 when a renderer of another crate panics.
    pub fn look(&self, width: usize, height: usize) -> Result<Frame> {
        let (pose, image) = (self.pose(), &self.scene.image);
        let Attitude { forward, up } = pose.attitude;
        let fov_degrees = self.camera::<Picture>().map_or(image.fov_degrees, |p| p.fov_degrees);
        let view = View::with_model(pose.position, forward, up, image.camera, fov_degrees, width, height)?;
        let settings = Settings { adaptive: false, ..image.settings };
        let mut frame = Frame::new(width, height);
        let traced = panics::catch(|| {
            renderer(&self.volume, settings, image.preset, Reuse::Never).render(&view, &mut frame);
        });
        traced.map_err(|why| {
            let what = format!("preset {}", image.preset.name);
            Error::fault(what, format!("panicked: {why}"), "fix it, or choose another preset")
        })?;
        Ok(frame)
    }

    /// Whether the guide that steers was switched off after a panic.
    pub fn is_guide_off(&self) -> bool {
        self.app.is_off(self.scene.guide_name())
    }

    /// Takes what there is to say to the user of what was planned since the last call.
    pub fn take_notes(&mut self) -> Vec<String> {
        let mut notes = self.fields.take_notes();
        notes.extend(self.app.take_notes());
        notes
    }

    /// Takes the steps written down since the last call.
    pub fn take_log(&mut self) -> Vec<LogLine> {
        self.app.world.get_resource_mut::<FlightLog>().map_or_else(Vec::new, |mut l| std::mem::take(&mut l.0))
    }

    /// Ends the flight because of a fault.
    pub fn end_because(&mut self, fault: &Error) {
        self.end();
        if let Some(mut f) = self.camera_mut::<Flight>() {
            f.reason = format!("{}: {}", fault.what, fault.why);
        }
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
            gas = Arc::new(lumen::find(self.volume.voxels(), &self.progress)?);
            if gas.segment_at(first.0).is_none()
                && let Some(there) = lumen::gas_at(self.volume.voxels(), first.0, &self.progress)?
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

    /// Share of the way behind the camera, 0 to 1, and the way's length, mm: by the plan or the log that is played, or coarsely by the
    /// way flown.
    pub fn progress(&self) -> (f64, f64) {
        let Some(trail) = self.trail() else { return (0.0, 0.0) };
        (self.camera::<Playback>().map_or(trail.share(), Playback::share), trail.length_mm())
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
