//! What a navigation method says of itself, and the table of all of them.

use std::any::Any;
use std::fmt::Debug;
use std::sync::Arc;

use serde::de::DeserializeOwned;

use super::App;
use crate::dynamics::Body;
use crate::error::{Error, Result};
use crate::fields::centerline::CenterlineMethod;

/// What has to be built from the lumen before a guide can fly; it is on the scan entity then
/// ([`components::scan`](crate::components::scan)) for as long as that guide steers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// The distances to the wall and to the target, with derivatives:
    /// [`WallDistances`](crate::components::scan::WallDistances) and
    /// [`TargetDistances`](crate::components::scan::TargetDistances).
    pub distances: bool,
    /// The centerline from start to goal: [`Centerline`](crate::components::scan::Centerline).
    pub centerline: bool,
    /// The method that finds the centerline.
    pub planner: CenterlineMethod,
    /// Tagged fluid taken as gas, so that segments of gas which it joins are flown as one.
    pub fluid_as_gas: bool,
}

impl Needs {
    /// Nothing beside the scan and its lumen.
    pub const NOTHING: Self =
        Self { distances: false, centerline: false, planner: CenterlineMethod::PenalisedPath, fluid_as_gas: false };
}

/// A navigation method, built in or from outside. The value itself is its settings: as they stand under its name in a scene
/// file, or their defaults.
///
/// What it says here is all that the command line, the keys, the help, `explain`, the preparation and the progress know of it;
/// `examples/own_guide.rs` is a whole one.
pub trait Guide: Clone + Debug + Default + DeserializeOwned + Send + Sync + 'static {
    /// Its name: on the command line, in scene files, in logs.
    const NAME: &'static str;
    /// What it does, in a few words, for the help.
    const SUMMARY: &'static str;
    /// The key of the window that hands over to it.
    const KEY: Option<char> = None;
    /// What has to be built for it.
    const NEEDS: Needs = Needs::NOTHING;
    /// Whether it moves the camera by itself. Its flight is watched then.
    const AUTOMATIC: bool = true;

    /// What has to be built for it with these settings, where they have a say in it; else [`Guide::NEEDS`].
    fn needs(&self) -> Needs {
        Self::NEEDS
    }

    /// Refuses settings that make no sense.
    ///
    /// # Errors
    /// Status 2 (wrong usage), naming the setting.
    fn check(&self) -> Result<()> {
        Ok(())
    }

    /// Speed of the flight where nothing holds it up, mm/s: for the display and for progress.
    fn cruise_mm_s(&self, body: &Body) -> f64;

    /// Adds its systems to the schedule, in the set [`Guide`](super::FlightSystems::Guide) and wherever else it takes part, and
    /// [equips](App::equip) the camera with its components.
    ///
    /// # Errors
    /// When something that it needs is missing.
    fn plug(&self, app: &mut App) -> Result<()>;
}

/// A [`Guide`] of whichever type.
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
    /// As [`Guide::NAME`].
    pub name: &'static str,
    /// As [`Guide::SUMMARY`].
    pub summary: &'static str,
    /// As [`Guide::KEY`].
    pub key: Option<char>,
    /// As [`Guide::needs`].
    pub needs: Needs,
    /// As [`Guide::AUTOMATIC`].
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
            automatic: G::AUTOMATIC,
            settings: Arc::new(settings),
        }
    }

    /// As [`Guide::cruise_mm_s`].
    pub fn cruise_mm_s(&self, body: &Body) -> f64 {
        self.settings.cruise_mm_s(body)
    }

    /// As [`Guide::plug`].
    ///
    /// # Errors
    /// As there.
    pub fn plug(&self, app: &mut App) -> Result<()> {
        self.settings.plug(app)
    }
}

/// The guides that a flight may be handed to, in the order in which they are listed, each with its settings.
#[derive(Clone, Debug, Default)]
pub struct Guides(Vec<GuideEntry>);

impl Guides {
    /// Adds a guide with its default settings, in the place of one of the same name if there is one.
    #[must_use]
    pub fn with<G: Guide>(mut self) -> Self {
        self.set(G::default());
        self
    }

    /// Settings of a guide, which is added if it is not there.
    pub fn set<G: Guide>(&mut self, settings: G) {
        let entry = GuideEntry::of(settings);
        match self.0.iter_mut().find(|g| g.name == entry.name) {
            Some(there) => *there = entry,
            None => self.0.push(entry),
        }
    }

    /// Settings of a guide; its defaults where it is not there.
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

    /// The guide of that name.
    pub fn named(&self, name: &str) -> Option<&GuideEntry> {
        self.0.iter().find(|g| g.name == name)
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &GuideEntry> {
        self.0.iter()
    }

    /// Takes over the settings of the guide `name` as a scene file has them; whether there is such a guide.
    ///
    /// # Errors
    /// Status 2 for settings that it does not have.
    pub fn read(&mut self, name: &str, settings: toml::Table) -> Result<bool> {
        let Some(entry) = self.0.iter_mut().find(|g| g.name == name) else { return Ok(false) };
        let read = entry.settings.read(settings);
        entry.settings =
            read.map_err(|e| Error::usage(format!("[{name}]"), e.message().to_owned(), "name settings that it has"))?;
        entry.needs = entry.settings.needs();
        Ok(true)
    }

    /// Refuses settings that make no sense.
    ///
    /// # Errors
    /// Status 2, naming the first.
    pub fn check(&self) -> Result<()> {
        self.0.iter().try_for_each(|g| g.settings.check())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Debug, Default, serde::Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Drift {
        speed: f64,
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
        guides.set(Drift { speed: 3.0 });
        assert_eq!((guides.get::<Drift>().speed, guides.iter().count()), (3.0, 1));
    }
}
