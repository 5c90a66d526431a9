//! A flight: a scan entity, a camera entity, and the schedules over them.

mod assemble;
mod coats;
mod commands;
mod connecting;
mod review;
mod rounds;
mod survey;
mod told;
mod translucent;
pub(crate) mod views;

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{AngularMomentum, Heading, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Flown, State};
use crate::components::output::{FlightLog, FrameCache, LogLine, Picture};
use crate::components::scan::{Scan, Walls};
use crate::components::trail::Trail;
use crate::dynamics::Attitude;
use crate::error::{Error, Result};
use crate::fields::cleanse::Cleansed;
use crate::fields::clearance::TOLERANCE_MM;
use crate::fields::lumen::Told;
use crate::fields::{Lumen, WallDistance};
use crate::flight_fields::Fields;
use crate::panics;
use crate::plan::{self, Plan};
use crate::polyps::CoatedPlaces;
use crate::progress::Progress;
use crate::render::{Frame, Reuse, Settings, View, renderer};
use crate::scene::Scene;
use crate::schedule::{App, at_home, note};
use crate::space::PreparedVolume;
use crate::systems;
use crate::volume::Volume;

pub use commands::CommandRecord;
pub use review::TourPlan;
pub use rounds::{ReviewRounds, TourFlown};
pub use survey::{Covered, Survey};
#[doc(hidden)]
pub use told::{Onward, onward};
pub use views::Views;

/// A running flight. A host drives it in the same manner in a window and headless.
///
/// Create it with [`Scan::flight`](crate::Scan::flight), or from its parts with [`FlightApp::new`]. What concerns views, what
/// has been covered, the setup and the commands is found on [`Views`], [`Survey`], [`Setup`] and [`CommandRecord`]. What remains
/// here drives the flight and reads its camera. Shortcuts such as [`pose`](FlightApp::pose) and [`clock`](FlightApp::clock) for
/// components and resources stay, because nearly every host, test and example reads them.
pub struct FlightApp {
    app: App,
    setup: Setup,
    /// The commands that took effect, and those that are left to replay.
    pub commands: CommandRecord,
    progress: Arc<Progress>,
    /// The current review.
    reviewing: Option<review::Reviewing>,
    /// Number of stops that the last review has reached.
    reached: usize,
    /// Where the camera hung when the last review ended, world mm.
    hung: Option<DVec3>,
    /// The distances to the wall with which the last tour was planned, and the gas that they belong to.
    toured: Option<(Arc<Lumen>, Arc<WallDistance>)>,
    /// The camera's last valid pose.
    sound: Option<Pose>,
    queries: views::Queries,
    connecting: connecting::Connecting,
    /// The values as scanned, if what is flown was cleansed and somebody has asked for them.
    scanned: Option<Arc<Volume>>,
    /// The coated spots of the scan, once they were found.
    coats: Option<Arc<CoatedPlaces>>,
}

/// What a flight flies through, where, and how.
pub struct Setup {
    /// The scan, prepared for rendering.
    pub volume: PreparedVolume,
    /// The colon's lumen.
    pub lumen: Arc<Lumen>,
    /// The start, the goal and the segment between them.
    pub plan: Plan,
    /// The guide and all other choices.
    pub scene: Scene,
    /// The fields over the lumen that the guide needs.
    pub fields: Fields,
    /// What was cleansed in the scan for this flight: its changes hold the values that the scan had. `None` if it is flown as scanned.
    pub cleansed: Option<Arc<Cleansed>>,
    /// Kinds that the reader gave to gas. The lumen was found with them.
    pub told: Vec<Told>,
}

impl Setup {
    /// True if the flight goes to its segment's rectal end.
    pub fn is_reversed(&self) -> bool {
        self.plan.segment.and_then(|n| self.lumen.segments.get(n)).is_some_and(|s| {
            let [rectal, cecal] = s.ends;
            self.plan.goal().at.distance(rectal) < self.plan.goal().at.distance(cecal)
        })
    }

    /// Builds the fields that the scene needs for the plan, and drops the others.
    #[doc(hidden)]
    pub fn build_fields(&mut self, progress: &Progress) -> Result<()> {
        let Self { volume, lumen, plan, scene, fields, .. } = self;
        fields.build(scene.needs(), volume.voxels(), lumen, plan, scene.body.radius_mm, progress)
    }
}

/// Largest valid distance of the camera from the origin, mm.
const FARTHEST_MM: f64 = 1e9;

impl FlightApp {
    /// Creates a flight at its start, and builds the fields that its guide needs.
    ///
    /// # Errors
    /// Returns an error if the scene is inconsistent, and status 4 if the guide plans and there is no path.
    pub fn new(volume: PreparedVolume, lumen: Arc<Lumen>, plan: Plan, scene: Scene) -> Result<Self> {
        scene.check()?;
        let mut setup =
            Setup { volume, lumen, plan, scene, fields: Fields::default(), cleansed: None, told: Vec::new() };
        let progress = Arc::new(Progress::new());
        setup.build_fields(&progress)?;
        Self::with_fields(setup, progress)
    }

    /// Creates a flight at its start with fields that are [built](Fields::build) for its plan. `progress` reports the building of
    /// those that a later change of guide, direction or segment needs. Fails if the scene is inconsistent or a field that its guide
    /// needs is missing.
    pub(crate) fn with_fields(setup: Setup, progress: Arc<Progress>) -> Result<Self> {
        let Setup { volume, scene, .. } = &setup;
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
        let commands = CommandRecord::default();
        let (queries, connecting) = (views::Queries::default(), connecting::Connecting::default());
        let mut flight = Self {
            app,
            setup,
            commands,
            progress,
            reviewing: None,
            reached: 0,
            hung: None,
            toured: None,
            sound: None,
            queries,
            connecting,
            scanned: None,
            coats: None,
        };
        flight.rebuild()?;
        flight.views().prepare()?;
        flight.set_out();
        Ok(flight)
    }

    /// Runs one simulation step, with the commands that are due.
    ///
    /// # Errors
    /// Returns an error if a command requests something that does not exist.
    pub fn step(&mut self) -> Result<()> {
        let _home = at_home();
        let tick = self.clock().tick;
        while let Some(command) = self.commands.next_due(tick) {
            self.act(command)?;
        }
        if self.app.is_changed() {
            self.app.build()?;
        }
        let stepped = self.app.step();
        let stepped = self.restored(stepped);
        self.keep_sound();
        stepped.and_then(|()| self.go_on_with_review())
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
            position: self.setup.plan.start,
            attitude: plan::first_attitude(&self.setup.volume, self.setup.plan.start, self.setup.plan.goal().at),
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
        let mut views = self.views();
        views.mark_all();
        views.render_due()
    }

    /// Returns the view of the camera's picture from its current pose; `None` in a scene without a picture.
    pub fn view(&self) -> Option<View> {
        let (pose, picture) = (self.pose(), self.camera::<Picture>()?);
        let Attitude { forward, up } = pose.attitude;
        let (width, height) = (picture.frame.width(), picture.frame.height());
        View::with_model(pose.position, forward, up, picture.camera, picture.fov_degrees, width, height).ok()
    }

    /// Renders what the camera sees now in `width` × `height` pixels, at high quality, with the scene's renderer, even if the scene
    /// has no picture. It always shows the scan that is flown through, whatever the window shows.
    ///
    /// # Errors
    /// Returns status 2 for an image without pixels, and status 1 if a renderer of another crate panics.
    pub fn look(&self, width: usize, height: usize) -> Result<Frame> {
        let (pose, image) = (self.pose(), &self.setup.scene.image);
        let Attitude { forward, up } = pose.attitude;
        let fov_degrees = self.camera::<Picture>().map_or(image.fov_degrees, |p| p.fov_degrees);
        let view = View::with_model(pose.position, forward, up, image.camera, fov_degrees, width, height)?;
        let settings = Settings { adaptive: false, ..image.settings };
        let mut frame = Frame::new(width, height);
        let traced = panics::catch(|| {
            renderer(&self.setup.volume, settings, image.preset, Reuse::Never).render(&view, &mut frame);
        });
        traced.map_err(|why| {
            let what = format!("preset {}", image.preset.name);
            Error::fault(what, format!("panicked: {why}"), "fix it, or choose another preset")
        })?;
        Ok(frame)
    }

    /// Takes the notes to the user about planning since the last call.
    pub fn take_notes(&mut self) -> Vec<String> {
        let mut notes = self.setup.fields.take_notes();
        notes.extend(self.app.take_notes());
        notes
    }

    /// Returns the statistics of the plug-ins ([`Plugin::stats`](crate::schedule::Plugin::stats)) by their names, and the error of
    /// the first plug-in that panicked. The others are still asked.
    pub fn plugin_stats(&self) -> (serde_json::Map<String, serde_json::Value>, Result<()>) {
        let (mut told, mut outcome) = (serde_json::Map::new(), Ok(()));
        for plugin in self.setup.scene.plugins.iter() {
            let name = plugin.name();
            match panics::ask_plugin(|| format!("plug-in {name}"), || Ok(plugin.stats(&self.app))) {
                Ok(Some(stats)) => _ = told.insert(name.into_owned(), stats),
                Ok(None) => {}
                Err(e) => outcome = outcome.and(Err(e)),
            }
        }
        (told, outcome)
    }

    /// Takes the log lines written since the last call.
    pub fn take_log(&mut self) -> Vec<LogLine> {
        self.app.world.get_resource_mut::<FlightLog>().map_or_else(Vec::new, |mut l| std::mem::take(&mut l.0))
    }

    /// Ends the flight because of an error.
    #[doc(hidden)]
    pub fn end_because(&mut self, fault: &Error) {
        self.end();
        if let Some(mut f) = self.camera_mut::<Flight>() {
            f.reason = format!("{}: {}", fault.what, fault.why);
        }
    }

    /// Ends the flight because its time is over.
    #[doc(hidden)]
    pub fn end(&mut self) {
        let place = self.pose().position;
        if let Some(mut f) = self.camera_mut::<Flight>()
            && f.state == State::Flying
        {
            (f.state, f.place) = (State::Ended, place);
        }
    }

    /// Adopts fields that were built elsewhere for this flight. Fields that do not fit its plan are rebuilt.
    #[doc(hidden)]
    pub fn adopt(&mut self, fields: Fields) {
        self.setup.fields = fields;
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
        let here = Pose { position: self.setup.plan.start, attitude: Attitude::new(DVec3::Y, DVec3::Z) };
        self.camera().copied().unwrap_or(here)
    }

    /// Moves the camera to a pose (world mm), for example to resume a flight. Returns false, without moving it, if the body does
    /// not fit there.
    pub fn place(&mut self, position: DVec3, forward: DVec3, up: DVec3) -> bool {
        let fits = self.app.scan_get::<Walls>().map_or(0.0, |w| w.0.at(position).mm);
        if fits <= self.setup.scene.body.radius_mm + TOLERANCE_MM {
            return false;
        }
        let attitude = Attitude::new(forward, up);
        let pose = Pose { position, attitude };
        self.sound = Some(pose);
        self.app.camera().insert(pose);
        self.rest(position, attitude.forward);
        true
    }

    /// Sets how far along the path the camera is, mm. Use it to continue an earlier flight.
    #[doc(hidden)]
    pub fn stands_at(&mut self, along_mm: f64) {
        let share = along_mm / self.setup.plan.length_mm;
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

    /// Returns what the flight was made from.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Returns the scan that the camera's picture shows: that which is flown through, or another one.
    pub fn shown_scan(&self) -> &PreparedVolume {
        let other = self.camera::<Picture>().and_then(|p| self.app.world.get::<Scan>(p.scan?));
        other.map_or(&self.setup.volume, |scan| &scan.0)
    }

    /// Returns what the flight has covered so far.
    pub fn survey(&self) -> Survey<'_> {
        Survey { flight: self, as_flown: None }
    }

    /// Returns the views other than the camera's, in rendering order, with their renderers' caches.
    pub fn other_views(&self) -> Vec<(&Picture, &FrameCache)> {
        views::others(&self.app)
    }

    /// Returns the views, to add and to render them.
    pub fn views(&mut self) -> Views<'_> {
        Views { flight: self }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::lumen::Segment;
    use crate::testing::Room;

    #[test]
    fn a_flight_is_reversed_if_its_goal_is_nearer_to_the_rectal_end() {
        let volume = Room::new([10, 40, 10]).scan();
        let [rectal, cecal] = [5.0, 35.0].map(|y| DVec3::new(5.0, y, 5.0));
        let reversed = |ends: [DVec3; 2], goal: DVec3, segment: Option<usize>| {
            let mut lumen = Lumen::none(volume.voxels().grid());
            let bounds_mm = [DVec3::ZERO; 2];
            lumen.segments = vec![Segment {
                ml: 4.0,
                fluid_ml: 0.0,
                bounds_mm,
                ends,
                joined_to: Vec::new(),
                length_mm: 30.0,
                way: Vec::new(),
                judged: None,
            }];
            let plan = Plan { segment, ..Plan::between(ends[0], goal, 30.0) };
            let (lumen, scene, fields) = (Arc::new(lumen), Scene::default(), Fields::default());
            Setup { volume: volume.clone(), lumen, plan, scene, fields, cleansed: None, told: Vec::new() }.is_reversed()
        };
        let ends = [rectal, cecal];
        assert!(reversed(ends, rectal, Some(0)) && reversed(ends, DVec3::new(5.0, 19.0, 5.0), Some(0)));
        assert!(!reversed(ends, cecal, Some(0)) && !reversed(ends, DVec3::new(5.0, 21.0, 5.0), Some(0)));
        assert!(!reversed([rectal; 2], rectal, Some(0)), "a bubble whose ends coincide");
        assert!(!reversed(ends, rectal, None), "gas that is no segment");
    }
}
