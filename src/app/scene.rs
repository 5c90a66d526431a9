//! Scenes: the steering, the plugins that take part, and their settings.

use std::collections::BTreeMap;

use crate::components::flight::Goal;
use crate::components::guide::Tentacles;
use crate::components::output::{GuideName, Picture};
use crate::components::play::Playback;
use crate::components::slices::SliceView;
use crate::dynamics::Body;
use crate::dynamics::mines::MineSettings;
use crate::dynamics::monitor::MonitorSettings;
use crate::dynamics::tentacles::{Drive, TentacleSettings};
use crate::error::{Error, Result};
use crate::images::{ImageSettings, RenderSettings};
use crate::panics::catch;
use crate::render::Options;
use crate::schedule::{App, Guide, GuideEntry, Guides, Look, Needs, Plugin, Plugins, Slot, note};
use crate::systems;
use crate::systems::present::{Presenters, Waiting};

/// The source of the camera's motion.
#[derive(Clone, Debug)]
pub enum Steering {
    /// Nothing: the camera does not move.
    Nobody,
    /// The guide with this name, one of [`Scene::guides`].
    Guide(&'static str),
    /// A recorded log that is replayed.
    Log(Playback),
}

/// The parts of a flight.
///
/// ```
/// # use colvis_app as colvis;
/// use colvis::app::Scene;
/// use colvis::dynamics::tentacles::TentacleSettings;
///
/// let mut scene = Scene { log: true, ..Scene::guided_by("tentacles") };
/// scene.guides.edit::<TentacleSettings>(|t| t.count = 256);
/// assert_eq!((scene.guide_name(), scene.cruise_mm_s()), ("tentacles", 30.0));
/// scene.check()?;
/// # Ok::<(), colvis::error::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Scene {
    /// The source of the camera's motion.
    pub steering: Steering,
    /// Every guide that the flight can be switched to, with its settings: the built-in ones and those that a program adds.
    pub guides: Guides,
    /// Where the camera looks; `None` for the guide's own choice.
    pub look: Option<Look>,
    /// The camera's body.
    pub body: Body,
    /// Mines behind the camera. They take part only if the camera has tentacles.
    pub mines: Option<MineSettings>,
    /// Monitor that notices when the flight makes no progress.
    pub watch: Option<MonitorSettings>,
    /// How images are rendered.
    pub render: RenderSettings,
    /// True if images are rendered, for a window or a recording.
    pub picture: bool,
    /// Size, camera and renderer of these images.
    pub image: ImageSettings,
    /// True if images are presented, in a window or a recording.
    pub presented: bool,
    /// True if steps are logged.
    pub log: bool,
    /// True if coverage is measured during the flight.
    pub coverage: bool,
    /// True if an operator can take part: a window, or a recorded input.
    pub operator: bool,
    /// Plug-ins of other crates that take part in the flight.
    pub plugins: Plugins,
    /// Settings of presets, cameras, shaders and overlays by name, as in a scene file. They also apply to those that are selected
    /// elsewhere, such as on the command line.
    pub options: SceneOptions,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            steering: Steering::Guide("tentacles"),
            guides: systems::guides(),
            look: None,
            body: Body::default(),
            mines: Some(MineSettings::default()),
            watch: Some(MonitorSettings::default()),
            render: RenderSettings::default(),
            picture: false,
            image: ImageSettings::default(),
            presented: false,
            log: false,
            coverage: false,
            operator: false,
            plugins: Plugins::default(),
            options: SceneOptions::default(),
        }
    }
}

/// Tables of settings, by the name of the part they belong to.
#[derive(Clone, Debug, Default)]
pub struct SceneOptions {
    pub(super) named: BTreeMap<String, Options>,
    pub(super) overlays: BTreeMap<String, Options>,
}

impl SceneOptions {
    /// Returns the settings of the preset, camera or shader with that name.
    pub fn of(&self, name: &str) -> Options {
        self.named.get(name).copied().unwrap_or_default()
    }
}

impl Scene {
    /// Creates the default scene, steered by the guide with that name.
    pub fn guided_by(name: &'static str) -> Self {
        Self { steering: Steering::Guide(name), ..Self::default() }
    }

    /// Creates the default scene, steered by a guide with these settings, from this crate or another.
    pub fn steered_by<G: Guide>(guide: G) -> Self {
        let mut scene = Self::guided_by(G::NAME);
        scene.guides.set(guide);
        scene
    }

    /// Adds a plug-in to the scene.
    ///
    /// A pair of a name and a closure is a plug-in, too:
    ///
    /// ```
    /// use bevy_ecs::prelude::*;
    /// # use colvis_app as colvis;
    /// use colvis::app::{Scan, Scene, FlightRequest};
    /// use colvis::components::input::FlightCommand;
    /// use colvis::schedule::{App, FlightSystems};
    ///
    /// #[derive(Resource, Default)]
    /// struct Steps(u32);
    ///
    /// let count = |app: &mut App| {
    ///     app.world.init_resource::<Steps>();
    ///     app.add_systems(FlightSystems::Log, |mut steps: ResMut<Steps>| steps.0 += 1);
    ///     Ok(())
    /// };
    /// let mut flight = Scan::phantom(1)?.flight(Scene::default().plug(("count", count))?, &FlightRequest::default())?;
    /// flight.fly(1.0)?;
    /// flight.act(FlightCommand::Guide("manual".to_owned()))?;
    /// flight.fly(1.0)?;
    /// assert_eq!(flight.app().world.resource::<Steps>().0, 240);
    /// # Ok::<(), colvis::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// Returns status 2 if there is already one with its name.
    pub fn plug(mut self, plugin: impl Plugin) -> Result<Self> {
        self.plugins.add(plugin)?;
        Ok(self)
    }

    /// Checks the scene.
    ///
    /// # Errors
    /// Returns status 2 for an invalid setting, or a guide that does not exist.
    pub fn check(&self) -> Result<()> {
        self.body.check()?;
        self.guides.check()?;
        self.mines.map_or(Ok(()), |m| m.check())?;
        self.watch.map_or(Ok(()), |w| w.check())?;
        let by_mines = self.guides.get::<TentacleSettings>().drive == Drive::Mines;
        if by_mines && self.guide_name() == TentacleSettings::NAME && self.mines.is_none_or(|m| m.kept == 0) {
            let why = "is \"mines\", but the scene has none: nothing would move the camera";
            return Err(Error::usage("tentacles.drive", why, "add the plugin mines"));
        }
        self.render.check()?;
        self.image.check()?;
        match self.steering {
            Steering::Guide(name) => self.find(name).map(drop),
            _ => Ok(()),
        }
    }

    /// Returns the guide with that name.
    ///
    /// # Errors
    /// Returns status 2 if it does not exist.
    pub fn find(&self, name: &str) -> Result<&GuideEntry> {
        self.guides.named(name).ok_or_else(|| {
            let names: Vec<&str> = self.guides.iter().map(|g| g.name).collect();
            Error::usage("guide", format!("there is no {name:?}"), format!("choose one of {}", names.join(", ")))
        })
    }

    /// Returns the guide that steers; `None` if nothing steers or a log is replayed.
    pub fn guide(&self) -> Option<&GuideEntry> {
        match self.steering {
            Steering::Guide(name) => self.guides.named(name),
            _ => None,
        }
    }

    /// Returns the log that is played, if there is one.
    pub fn play(&self) -> Option<&Playback> {
        match &self.steering {
            Steering::Log(play) => Some(play),
            _ => None,
        }
    }

    /// Returns the name of what steers, for display.
    pub fn guide_name(&self) -> &'static str {
        match self.steering {
            Steering::Nobody => "none",
            Steering::Guide(name) => name,
            Steering::Log(_) => "play",
        }
    }

    /// Returns what has to be built for the guide.
    pub fn needs(&self) -> Needs {
        self.guide().map_or(Needs::NOTHING, |g| g.needs)
    }

    /// Returns the unobstructed speed of the flight, mm/s; 0 if nothing moves the camera automatically.
    pub fn cruise_mm_s(&self) -> f64 {
        let Some(guide) = self.guide() else { return 0.0 };
        // A guide that cannot report its speed counts as not moving.
        let odd = |what: String| {
            note(format!("guide {}", guide.name), format!("{what}: its cruise speed counts as 0"));
            0.0
        };
        match catch(|| guide.cruise_mm_s(&self.body)) {
            Ok(mm_s) if mm_s.is_finite() && mm_s >= 0.0 => mm_s,
            Ok(mm_s) => odd(format!("returned a cruise speed of {mm_s} mm/s")),
            Err(why) => odd(format!("panicked: {why}")),
        }
    }

    /// True if anything moves the camera.
    pub fn moves(&self) -> bool {
        !matches!(self.steering, Steering::Nobody)
    }

    /// True if a guide moves the camera automatically.
    pub fn is_automatic(&self) -> bool {
        self.guide().is_some_and(|g| g.automatic)
    }

    /// Adds the plugins of the scene to an application, whose scan already holds what the guide needs, and notes the parts it
    /// does without. `goal` is where the flight ends.
    ///
    /// # Errors
    /// Returns an error if two plugins claim the same slot, or a guide lacks something that it needs.
    pub fn plug_into(&self, app: &mut App, goal: Goal) -> Result<()> {
        app.world.insert_resource(GuideName(self.guide_name()));
        systems::clock::plugin(app)?;
        self.plug_steering(app)?;
        self.plug_watch(app, goal)?;
        systems::trail::plugin(app)?;
        if self.operator && self.moves() {
            systems::operator::plugin(app)?;
        } else {
            app.leave_out("operator", "no window and no recorded input, or nothing that moves");
        }
        if self.log {
            systems::log::plugin(app)?;
        } else {
            app.leave_out("log", "there is no --log");
        }
        if app.is_filled(Slot::Coverage) {
            // It was added to a running flight.
        } else if self.coverage {
            systems::coverage::plugin(app)?;
        } else {
            app.leave_out("coverage", "neither the scene nor a window measures coverage");
        }
        for (part, why) in [
            ("picture", "no window and no recording: no image is rendered"),
            ("presentation", "no window and no recording: nothing is presented"),
            ("slices", "no panel shows slices"),
        ] {
            app.leave_out(part, why);
        }
        self.plug_views(app)?;
        self.leave_out_fields(app);
        Ok(())
    }

    /// Adds the systems that render and present views, as soon as there is a view and a presenter to receive it.
    ///
    /// # Errors
    /// Returns the errors of [`Scene::plug_into`].
    pub fn plug_views(&self, app: &mut App) -> Result<()> {
        // Called before each frame.
        if app.is_filled(Slot::Slices) {
            app.take_in("slices");
        } else if app.world.query::<&SliceView>().iter(&app.world).next().is_some() {
            systems::slices::plugin(app)?;
            app.take_in("slices");
        }
        if app.has_post_processes() && !app.is_filled(Slot::PictureSize) {
            systems::raycast::keep_sizes_plugin(app)?;
        }
        let given = app.world.contains_resource::<Waiting>();
        let presents = self.presented || given || app.world.contains_non_send::<Presenters>();
        for (slot, part) in [(Slot::Renderer, "picture"), (Slot::Presentation, "presentation")] {
            if app.is_filled(slot) {
                app.take_in(part);
            }
        }
        if app.is_filled(Slot::Renderer) && (app.is_filled(Slot::Presentation) || !presents) {
            return Ok(());
        }
        if app.world.query::<&Picture>().iter(&app.world).next().is_none() {
            return Ok(());
        }
        if !app.is_filled(Slot::Renderer) {
            systems::raycast::plugin(app)?;
        }
        app.take_in("picture");
        if presents {
            if !app.is_filled(Slot::Presentation) {
                systems::present::plugin(app)?;
            }
            app.take_in("presentation");
        }
        Ok(())
    }

    /// Adds the guide, or the log that replaces it, and the system that moves the body.
    fn plug_steering(&self, app: &mut App) -> Result<()> {
        match &self.steering {
            Steering::Nobody => {
                app.leave_out("guide", "the scene has none, so the camera stays in place");
                app.leave_out("motion", "nothing moves the camera");
            }
            Steering::Guide(name) => {
                app.fill(Slot::Guide, name)?;
                let guide = self.find(name)?;
                match systems::guides().named(name) {
                    Some(_) => guide.plug(app)?,
                    None => app.on_account(name, |app| guide.plug(app))?,
                }
                let look = self.look.or(guide.look).unwrap_or(systems::looks::ahead::LOOK);
                let mut built_in = systems::looks::BUILT_IN.iter().chain([&systems::looks::review::LOOK]);
                let is_own = !built_in.any(|l| l.name == look.name);
                match is_own {
                    true => app.on_account(look.name, look.plug)?,
                    false => (look.plug)(app)?,
                }
                if app.keeps_account() {
                    let look = is_own.then_some(look.name);
                    systems::motion::check_guide_plugin(app, systems::motion::ThrustWriters { look });
                }
                systems::motion::plugin(app)?;
            }
            Steering::Log(play) => {
                app.fill(Slot::Guide, "play")?;
                systems::play::plug(app, play)?;
                app.leave_out("motion", "the camera is where the log says");
            }
        }
        match self.mines {
            _ if app.camera_get::<Tentacles>().is_none() => {
                app.leave_out("tentacles", "no guide uses sensory rays");
                app.leave_out("mines", "no guide for them to push");
            }
            Some(mines) => systems::mines::plug(app, mines)?,
            None => app.leave_out("mines", "the scene has none"),
        }
        Ok(())
    }

    /// Adds the systems that monitor the flight.
    fn plug_watch(&self, app: &mut App, goal: Goal) -> Result<()> {
        match self.watch.filter(|_| self.guide().is_some()) {
            Some(settings) => systems::watch::plug(app, settings, goal)?,
            None => app.leave_out("watch", "the scene has none, or no guide to watch"),
        }
        if self.moves() {
            systems::arrival::plugin(app)?;
        }
        Ok(())
    }

    /// Notes which fields are not built, and why.
    fn leave_out_fields(&self, app: &mut App) {
        let needs = self.needs();
        let feels = app.camera_get::<Tentacles>().is_some();
        if !needs.distances {
            let why = match needs.centerline {
                true => "only the search for the centerline needs it: clearances are exact and local",
                false => "nothing in the scene needs it: clearances are exact and local",
            };
            app.leave_out("wall distance field", why);
            let why = match (needs.centerline, feels) {
                (true, _) => "nothing in the scene needs it: the plan replaces it",
                (_, true) => "nothing in the scene needs it: mines replace it",
                _ => "nothing in the scene needs it",
            };
            app.leave_out("target distance field", why);
        }
        if !needs.centerline {
            app.leave_out("centerline", "nothing in the scene needs it");
        }
    }
}
