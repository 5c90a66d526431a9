//! The trait for navigation methods, and the table of all guides.

use std::any::Any;
use std::fmt::Debug;
use std::sync::Arc;

use serde::de::DeserializeOwned;

use super::{App, Look};
use crate::dynamics::Body;
use crate::error::Result;
use crate::fields::centerline::CenterlineMethod;
use crate::panics::ask_plugin;
use crate::render::options::unread;

/// The data to derive from the lumen before a guide can fly.
///
/// It is on the scan entity ([`components::scan`](crate::components::scan)) for as long as the guide steers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Distances to the wall and to the target, with derivatives: [`WallDistances`](crate::components::scan::WallDistances) and
    /// [`TargetDistances`](crate::components::scan::TargetDistances).
    pub distances: bool,
    /// The centerline from start to goal: [`Centerline`](crate::components::scan::Centerline).
    pub centerline: bool,
    /// The method that finds the centerline.
    pub planner: CenterlineMethod,
    /// True to treat tagged fluid as gas, so that segments of gas joined by fluid are flown as one.
    pub fluid_as_gas: bool,
}

impl Needs {
    /// Nothing besides the scan and its lumen.
    pub const NOTHING: Self =
        Self { distances: false, centerline: false, planner: CenterlineMethod::PenalisedPath, fluid_as_gas: false };
}

/// A navigation method, built in or external. The value holds its settings: those under its name in a scene file, or the defaults.
///
/// The command line, the keys, the help, `explain`, the preparation and the progress know a guide only through this
/// trait. `examples/own_guide.rs` is a complete example.
pub trait Guide: Clone + Debug + Default + DeserializeOwned + Send + Sync + 'static {
    /// Name on the command line, in scene files and in logs.
    const NAME: &'static str;
    /// Short description for the help.
    const SUMMARY: &'static str;
    /// Window key that switches to this guide.
    const KEY: Option<char> = None;
    /// Data that must be built for this guide.
    const NEEDS: Needs = Needs::NOTHING;
    /// Where the camera looks, unless the scene says otherwise; `None` for where the guide steers.
    const LOOK: Option<Look> = None;
    /// True if the guide moves the camera automatically. Its flight is then watched.
    const AUTOMATIC: bool = true;

    /// Returns the data that must be built for these settings. Defaults to [`Guide::NEEDS`]; override it if it depends on settings.
    fn needs(&self) -> Needs {
        Self::NEEDS
    }

    /// Checks the settings.
    ///
    /// # Errors
    /// Returns status 2 (invalid arguments) and names the setting that is out of range.
    fn check(&self) -> Result<()> {
        Ok(())
    }

    /// Returns the speed of the flight if nothing limits it, mm/s: for the display and for progress.
    fn cruise_mm_s(&self, body: &Body) -> f64;

    /// Adds the guide's systems to the schedule and [equips](App::equip) the camera with its components.
    ///
    /// The systems go to the set [`Guide`](super::FlightSystems::Guide) and to any other set that the guide takes part in.
    ///
    /// # Errors
    /// Returns an error if required data is missing.
    fn plug(&self, app: &mut App) -> Result<()>;
}

/// A [`Guide`] of any type. [`Guide`] itself has constants and a [`Default`], by which guides are written in few lines, but no
/// trait object.
trait AnyGuide: Debug + Send + Sync {
    fn needs(&self) -> Needs;
    fn check(&self) -> Result<()>;
    fn cruise_mm_s(&self, body: &Body) -> f64;
    fn plug(&self, app: &mut App) -> Result<()>;
    fn read(&self, settings: toml::Table) -> std::result::Result<Arc<dyn AnyGuide>, toml::de::Error>;
    fn as_any(&self) -> &dyn Any;
}

impl<G: Guide> AnyGuide for G {
    fn needs(&self) -> Needs {
        Guide::needs(self)
    }

    fn check(&self) -> Result<()> {
        Guide::check(self)
    }

    fn cruise_mm_s(&self, body: &Body) -> f64 {
        Guide::cruise_mm_s(self, body)
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        Guide::plug(self, app)
    }

    fn read(&self, settings: toml::Table) -> std::result::Result<Arc<dyn AnyGuide>, toml::de::Error> {
        settings.try_into::<G>().map(|g| Arc::new(g) as Arc<dyn AnyGuide>)
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

/// A guide in the table, with its settings.
#[derive(Clone, Debug)]
pub struct GuideEntry {
    /// [`Guide::NAME`].
    pub name: &'static str,
    /// [`Guide::SUMMARY`].
    pub summary: &'static str,
    /// [`Guide::KEY`].
    pub key: Option<char>,
    /// [`Guide::needs`].
    pub needs: Needs,
    /// [`Guide::LOOK`].
    pub look: Option<Look>,
    /// [`Guide::AUTOMATIC`].
    pub automatic: bool,
    settings: Arc<dyn AnyGuide>,
}

impl GuideEntry {
    fn of<G: Guide>(settings: G) -> Self {
        Self {
            name: G::NAME,
            summary: G::SUMMARY,
            key: G::KEY,
            needs: settings.needs(),
            look: G::LOOK,
            automatic: G::AUTOMATIC,
            settings: Arc::new(settings),
        }
    }

    /// Calls [`Guide::cruise_mm_s`].
    pub fn cruise_mm_s(&self, body: &Body) -> f64 {
        self.settings.cruise_mm_s(body)
    }

    /// Calls [`Guide::plug`].
    ///
    /// # Errors
    /// Returns the errors of [`Guide::plug`].
    pub fn plug(&self, app: &mut App) -> Result<()> {
        self.settings.plug(app)
    }
}

/// The guides available to a flight, in the order in which they are listed, each with its settings.
#[derive(Clone, Debug, Default)]
pub struct Guides(Vec<GuideEntry>);

impl Guides {
    /// Adds a guide with its default settings, replacing any guide of the same name.
    #[must_use]
    pub fn with<G: Guide>(mut self) -> Self {
        self.set(G::default());
        self
    }

    /// Sets the settings of a guide and adds the guide if it is missing.
    pub fn set<G: Guide>(&mut self, settings: G) {
        let entry = GuideEntry::of(settings);
        match self.0.iter_mut().find(|g| g.name == entry.name) {
            Some(there) => *there = entry,
            None => self.0.push(entry),
        }
    }

    /// Returns the settings of a guide, or its defaults if it is missing.
    pub fn get<G: Guide>(&self) -> G {
        let there = self.0.iter().find_map(|g| g.settings.as_any().downcast_ref::<G>());
        there.cloned().unwrap_or_default()
    }

    /// Changes some settings of a guide.
    pub fn edit<G: Guide>(&mut self, change: impl FnOnce(&mut G)) {
        let mut settings = self.get::<G>();
        change(&mut settings);
        self.set(settings);
    }

    /// Returns the guide of that name.
    pub fn named(&self, name: &str) -> Option<&GuideEntry> {
        self.0.iter().find(|g| g.name == name)
    }

    /// Iterates over all guides.
    pub fn iter(&self) -> impl Iterator<Item = &GuideEntry> {
        self.0.iter()
    }

    /// Reads the settings of the guide `name` from a scene file's table. Returns false if there is no such guide.
    ///
    /// # Errors
    /// Returns status 2 if the guide does not have one of the settings.
    pub fn read(&mut self, name: &str, settings: toml::Table) -> Result<bool> {
        let Some(entry) = self.0.iter_mut().find(|g| g.name == name) else { return Ok(false) };
        entry.settings = entry.settings.read(settings).map_err(|e| unread(name, &e))?;
        entry.needs = entry.settings.needs();
        Ok(true)
    }

    /// Checks the settings of all guides.
    ///
    /// # Errors
    /// Returns status 2 and names the first setting that is out of range.
    pub fn check(&self) -> Result<()> {
        self.0.iter().try_for_each(|g| ask_plugin(|| format!("guide {}", g.name), || g.settings.check()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    #[derive(Clone, Debug, Default, serde::Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Drift {
        speed: f64,
        lag: f64,
    }

    impl Guide for Drift {
        const NAME: &'static str = "drift";
        const SUMMARY: &'static str = "drifts";

        fn check(&self) -> Result<()> {
            if self.speed < 0.0 { Err(Error::usage("drift.speed", "is negative", "give a speed")) } else { Ok(()) }
        }

        fn cruise_mm_s(&self, _: &Body) -> f64 {
            self.speed
        }

        fn plug(&self, _: &mut App) -> Result<()> {
            Ok(())
        }
    }

    #[test]
    fn settings_come_from_a_file_or_from_a_program() {
        let mut guides = Guides::default().with::<Drift>();
        let table = |text: &str| text.parse::<toml::Table>().unwrap();
        assert!(guides.read("drift", table("speed = 7.0")).unwrap());
        assert_eq!(guides.named("drift").unwrap().cruise_mm_s(&Body::default()), 7.0);
        assert!(guides.read("drift", table("speeed = 7.0")).is_err());
        assert!(!guides.read("warp", table("")).unwrap() && guides.named("warp").is_none());
        guides.edit::<Drift>(|d| d.speed = -1.0);
        assert!(guides.check().is_err());
        guides.set(Drift { speed: 3.0, lag: 0.0 });
        assert_eq!((guides.get::<Drift>().speed, guides.iter().count()), (3.0, 1));
    }

    #[test]
    fn changing_one_setting_keeps_the_others() {
        let mut guides = Guides::default().with::<Drift>();
        guides.read("drift", "speed = 7.0\nlag = 2.0".parse().unwrap()).unwrap();
        guides.edit::<Drift>(|d| d.lag = 5.0);
        guides.edit::<Drift>(|d| d.lag += 1.0);
        let drift = guides.get::<Drift>();
        assert_eq!((drift.speed, drift.lag), (7.0, 6.0));
    }
}
