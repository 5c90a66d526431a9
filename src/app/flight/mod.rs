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
use crate::render::{Coverage, Frame, Reuse, Settings, View, coverage, renderer};
use crate::schedule::{App, note};
use crate::space::PreparedVolume;
use crate::systems;
use crate::systems::present::{self, Presenter};

/// A running flight. A host drives it in the same manner in a window and headless.
///
/// Create it with [`Scan::flight`](crate::app::Scan::flight), or from its parts with [`FlightApp::new`].
pub struct FlightApp {
    app: App,
    scene: Scene,
    volume: PreparedVolume,
    lumen: Arc<Lumen>,
    plan: Plan,
    /// Commands that are left to replay, by step.
    coming: VecDeque<TimedCommand>,
    /// Commands that took effect, for recording.
    acted: Option<Vec<TimedCommand>>,
    fields: Fields,
    progress: Arc<Progress>,
    /// The camera's last valid pose.
    sound: Option<Pose>,
    /// Query of the views that are marked before each frame. It is kept because creating a query allocates.
    pictures: Option<QueryState<&'static mut Picture>>,
    views: Option<ViewsToMark>,
}

/// Components that determine whether a view is finished.
type ViewsToMark =
    QueryState<(Entity, &'static mut Picture, &'static FrameCache, Option<&'static Pose>, Option<&'static Follows>)>;

/// Largest valid distance of the camera from the origin, mm.
const FARTHEST_MM: f64 = 1e9;

impl FlightApp {
    /// Creates a flight at its start, and builds the fields that its guide needs.
    ///
    /// # Errors
    /// Returns an error if the scene is inconsistent, and status 4 if the guide plans and there is no path.
    pub fn new(volume: PreparedVolume, lumen: Arc<Lumen>, plan: Plan, scene: Scene) -> Result<Self> {
        scene.check()?;
        let (mut fields, progress) = (Fields::default(), Arc::new(Progress::new()));
        fields.build(scene.needs(), volume.voxels(), &lumen, &plan, scene.body.radius_mm, &progress)?;
        Self::with_fields(volume, lumen, plan, scene, fields, progress)
    }

    /// Creates a flight at its start with fields that are [built](Fields::build) for its plan. `progress` reports the building
    /// of those that a later change of guide, direction or segment needs.
    ///
    /// # Errors
    /// Returns an error if the scene is inconsistent or a field that its guide needs is missing.
    pub(crate) fn with_fields(
        volume: PreparedVolume,
        lumen: Arc<Lumen>,
        plan: Plan,
        scene: Scene,
        fields: Fields,
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
            fields,
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

    /// Adds a view: an entity with a [`Picture`], a position to look from (its own [`Pose`] or [`Follows`]), and any other
    /// components. It is rendered in every frame from now on. So is a view that is spawned into the world directly, but this
    /// method also prepares the renderer at once.
    ///
    /// # Errors
    /// Returns status 2 for a picture whose preset does not support its settings, or that no camera can render.
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
    /// Returns the errors of any change of the schedule.
    pub fn add_slice(&mut self, slice: SliceView) -> Result<Entity> {
        let entity = self.app.world.spawn(slice).id();
        self.plug_late()?;
        Ok(entity)
    }

    /// Returns all slices.
    pub(crate) fn slices(&self) -> Vec<&SliceView> {
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
        p.preset.supports(&p.settings)?;
        let (width, height) = (p.frame.width(), p.frame.height());
        View::with_model(DVec3::ZERO, DVec3::Y, DVec3::Z, p.camera, p.fov_degrees, width, height).map(drop)
    }

    /// Creates the renderers of views that have none yet, so that the first frame takes no longer than others.
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

    /// Returns the views other than the camera's, in rendering order, with their renderers' caches.
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

    /// Marks the views other than the camera's whose picture would change or improve if they were rendered now. Returns true if
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
                // The followed entity may have moved, so the view is rendered.
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

    /// Sends a view's pictures to a presenter from now on: see [`Presenter`].
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub fn present_to(&mut self, view: Entity, presenter: impl Presenter) -> Result<()> {
        present::hand_to(&mut self.app, view, presenter);
        self.plug_late()
    }

    /// Removes and returns the presenter of the camera's pictures, if it is a `P`.
    pub fn take_presenter<P: Presenter>(&mut self) -> Option<P> {
        let camera = self.app.camera_id();
        present::take(&mut self.app, camera)
    }

    /// Adds the systems needed by views and presenters that were added later.
    fn plug_late(&mut self) -> Result<()> {
        self.scene.plug_views(&mut self.app)?;
        if self.app.is_changed() { self.app.build() } else { Ok(()) }
    }

    /// Runs one simulation step, with the commands that are due.
    ///
    /// # Errors
    /// Returns an error if a command requests something that does not exist.
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

    /// Moves the camera back to its last valid pose, at rest, if a plug-in has written an invalid position, direction or speed.
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
            self.app.inspect().own_systems_that_write::<Pose>(),
            self.app.inspect().own_systems_that_write::<Velocity>(),
            self.app.inspect().own_systems_that_write::<AngularMomentum>(),
            self.app.inspect().own_systems_that_write::<Heading>(),
        ]
        .concat();
        let who = if writers.is_empty() { "a system".to_owned() } else { writers.join(" or ") };
        note(who, "wrote an invalid position, direction or speed: the camera was put back, at rest");
        let back = self.sound.unwrap_or(Pose {
            position: self.plan.start,
            attitude: plan::first_attitude(&self.volume, self.plan.start, self.plan.goal().at),
        });
        self.app.camera().insert(back);
        self.rest(back.position, back.attitude.forward);
    }

    /// Flies for a number of simulated seconds, or until the flight ends.
    ///
    /// # Errors
    /// Returns the errors of [`FlightApp::step`].
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

    /// Renders the pictures of all views in their current state and presents them. Does nothing in a scene without a view.
    ///
    /// # Errors
    /// Returns status 1 if systems were added whose order is ambiguous.
    pub fn frame(&mut self) -> Result<()> {
        let Self { app, pictures, .. } = self;
        let pictures = pictures.get_or_insert_with(|| app.world.query());
        pictures.iter_mut(&mut app.world).for_each(|mut p| p.due = true);
        self.frame_of_due()
    }

    /// Same as [`FlightApp::frame`], but only for views that are due.
    ///
    /// # Errors
    /// Returns the errors of [`FlightApp::frame`].
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
            let who = self.app.inspect().own_systems_that_write::<Picture>().join(" or ");
            note(if who.is_empty() { "a post-process" } else { &who }, "has resized a picture: it keeps its size");
        }
        made
    }

    /// Presents the camera's last picture again without rendering it. Use it after an overlay has changed.
    pub fn present(&mut self) {
        let camera = self.app.camera_id();
        present::present_again(&mut self.app, camera);
    }

    /// Returns the view of the camera's picture from its current pose; `None` in a scene without a picture.
    pub fn view(&self) -> Option<View> {
        let (pose, picture) = (self.pose(), self.camera::<Picture>()?);
        let Attitude { forward, up } = pose.attitude;
        let (width, height) = (picture.frame.width(), picture.frame.height());
        View::with_model(pose.position, forward, up, picture.camera, picture.fov_degrees, width, height).ok()
    }

    /// Renders what the camera sees now in `width` × `height` pixels, at high quality, with the scene's renderer. Works also if
    /// the scene has no picture.
    ///
    /// # Errors
    /// Returns status 2 for an image without pixels, and status 1 if a renderer of another crate panics.
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

    /// True if the active guide was switched off after a panic.
    pub fn is_guide_off(&self) -> bool {
        self.app.inspect().is_off(self.scene.guide_name())
    }

    /// Takes the notes to the user about planning since the last call.
    pub fn take_notes(&mut self) -> Vec<String> {
        let mut notes = self.fields.take_notes();
        notes.extend(self.app.take_notes());
        notes
    }

    /// Takes the log lines written since the last call.
    pub fn take_log(&mut self) -> Vec<LogLine> {
        self.app.world.get_resource_mut::<FlightLog>().map_or_else(Vec::new, |mut l| std::mem::take(&mut l.0))
    }

    /// Ends the flight because of an error.
    pub(crate) fn end_because(&mut self, fault: &Error) {
        self.end();
        if let Some(mut f) = self.camera_mut::<Flight>() {
            f.reason = format!("{}: {}", fault.what, fault.why);
        }
    }

    /// Ends the flight because its time is over.
    pub(crate) fn end(&mut self) {
        let place = self.pose().position;
        if let Some(mut f) = self.camera_mut::<Flight>()
            && f.state == State::Flying
        {
            (f.state, f.place) = (State::Ended, place);
        }
    }

    /// Returns the segments of the lumen that are not yet flown to their end, with their gas in ml.
    pub fn unflown(&self) -> Vec<(usize, f64)> {
        let flown = self.camera::<Flown>().map_or(&[][..], |f| &f.done);
        self.lumen
            .segments
            .iter()
            .enumerate()
            .filter(|(n, _)| !flown.contains(n))
            // The current segment is not "another one".
            .filter(|(n, _)| self.plan.segment != Some(*n))
            .map(|(n, s)| (n, s.ml))
            .collect()
    }

    /// Returns the fields over the lumen that the guide needed.
    pub fn fields(&self) -> &Fields {
        &self.fields
    }

    /// Adopts fields that were built elsewhere for this flight. Fields that do not fit its plan are rebuilt.
    #[cfg(feature = "window")]
    pub(crate) fn adopt(&mut self, fields: Fields) {
        self.fields = fields;
    }

    /// Takes the build times of fields since the last call, s.
    pub fn take_field_times(&mut self) -> Vec<(&'static str, f64)> {
        self.fields.take_times()
    }

    /// Returns the flight's past views, one every 2 mm from its beginning, with their positions along the path.
    pub fn trail(&self) -> Option<&Trail> {
        self.camera()
    }

    /// Returns the share of the wall seen, in the gas flown through: see [`crate::render::coverage()`]. `None` if that gas is not
    /// known.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn coverage(&self, fov_degrees: f64) -> Result<Option<Coverage>> {
        let places = self.trail().map_or(&[][..], Trail::views);
        let mut gas = self.plan.gas.clone().unwrap_or_else(|| Arc::clone(&self.lumen));
        if gas.segments.is_empty()
            && let Some(first) = places.first()
        {
            // A played log: the colon has not been segmented until now.
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

    /// Returns a component of the camera.
    pub fn camera<T: Component>(&self) -> Option<&T> {
        self.app.camera_get()
    }

    /// Returns a component of the camera for modification, for example to resize its picture.
    pub fn camera_mut<T: Component<Mutability = bevy_ecs::component::Mutable>>(&mut self) -> Option<Mut<'_, T>> {
        self.app.camera_get_mut()
    }

    /// Returns the camera's pose.
    pub fn pose(&self) -> Pose {
        let here = Pose { position: self.plan.start, attitude: Attitude::new(DVec3::Y, DVec3::Z) };
        self.camera().copied().unwrap_or(here)
    }

    /// Moves the camera to a pose (world mm), for example to resume a flight. Returns false, without moving it, if the body does
    /// not fit there.
    pub fn place(&mut self, position: DVec3, forward: DVec3, up: DVec3) -> bool {
        let fits = self.app.scan_get::<Walls>().map_or(0.0, |w| w.0.at(position).mm);
        if fits <= self.scene.body.radius_mm + TOLERANCE_MM {
            return false;
        }
        let attitude = Attitude::new(forward, up);
        let pose = Pose { position, attitude };
        self.sound = Some(pose);
        self.app.camera().insert(pose);
        self.rest(position, attitude.forward);
        true
    }

    /// Returns the share of the path behind the camera, 0 to 1, and the path's length, mm. They refer to the plan or the log that
    /// is played, or, coarsely, to the path flown.
    pub fn progress(&self) -> (f64, f64) {
        let Some(trail) = self.trail() else { return (0.0, 0.0) };
        (self.camera::<Playback>().map_or(trail.share(), Playback::share), trail.length_mm())
    }

    /// Sets how far along the path the camera is, mm. Use it to continue an earlier flight.
    pub fn stands_at(&mut self, along_mm: f64) {
        let share = along_mm / self.plan.length_mm;
        self.jump(if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 });
    }

    /// Returns the state of the flight.
    pub fn flight(&self) -> Flight {
        self.camera().cloned().unwrap_or_default()
    }

    /// Returns the simulated time.
    pub fn clock(&self) -> Clock {
        *self.app.world.resource::<Clock>()
    }

    /// Returns the plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// True if the flight goes to its segment's rectal end.
    pub fn is_reversed(&self) -> bool {
        self.plan.segment.and_then(|n| self.lumen.segments.get(n)).is_some_and(|s| {
            let [rectal, cecal] = s.ends;
            self.plan.goal().at.distance(rectal) < self.plan.goal().at.distance(cecal)
        })
    }

    /// Returns the scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Returns the colon's lumen.
    pub fn lumen(&self) -> &Lumen {
        &self.lumen
    }

    /// Returns the colon's lumen for sharing.
    pub fn shared_lumen(&self) -> Arc<Lumen> {
        Arc::clone(&self.lumen)
    }

    /// Returns the prepared volume.
    pub fn volume(&self) -> &PreparedVolume {
        &self.volume
    }

    /// Returns the world and its schedules, for explanations.
    pub fn app(&self) -> &App {
        &self.app
    }

    /// Returns the world and its schedules for modification, for a host that adds its presenter.
    pub fn app_mut(&mut self) -> &mut App {
        &mut self.app
    }
}
