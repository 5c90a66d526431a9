//! A scene: the plugins of a flight and their settings, from a file or from defaults.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::components::App;
use crate::components::app::Plugin;
use crate::components::play::Playback;
use crate::dynamics::mines::MineSettings;
use crate::dynamics::monitor::MonitorSettings;
use crate::dynamics::route::profile::PathSettings;
use crate::dynamics::tentacles::TentacleSettings;
use crate::dynamics::{Body, Potential};
use crate::error::{Error, Result};
use crate::render::{Classification, Preset, Settings};
use crate::systems;

/// Who steers. Each is one plugin over the same body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Guide {
    /// Tentacles, and mines if the scene has them.
    #[default]
    Tentacles,
    /// The paper's potential, of the distances to the wall and to the target.
    Potential,
    /// A planned way along the centerline.
    Path,
    /// The operator alone.
    Manual,
}

impl Guide {
    /// Every guide there is, with its name on the command line and its plugins. A new navigation method is a
    /// variant and one more line here.
    pub const ALL: [(Self, &'static str, &'static [Plugin]); 4] = [
        (Self::Tentacles, "tentacles", &[systems::sense::plugin, systems::tentacles::plugin]),
        (Self::Potential, "potential", &[systems::potential::plugin]),
        (Self::Path, "path", &[systems::path::plugin]),
        (Self::Manual, "manual", &[systems::manual::plugin]),
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|g| g.0 == self).map_or("", |g| g.1)
    }

    /// The guide of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|g| g.1 == name).map(|g| g.0)
    }
}

/// A navigation method from outside this crate, in place of a [`Guide`].
#[derive(Clone, Copy, Debug)]
pub struct OwnGuide {
    /// Its plugins; one of them fills [`Slot::Guide`](crate::components::Slot).
    pub plugins: &'static [Plugin],
    /// Whether it wants tentacles on the camera (and mines, if the scene has them).
    pub feels: bool,
}

/// What a scene says about its images; the quality's own settings hold where it says nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderSettings {
    /// The camera's sensitivity: a ray ends when less than this share of light comes from beyond, 0 to 1.
    pub sensitivity: Option<f32>,
    /// Whether opacity is looked up by the regression's filtered density, as the paper has it, instead of by the
    /// trilinear value.
    pub filtered_density: bool,
    /// Which renderer: `default`, `colvis` or `lean`; the command line's `--preset` wins.
    pub preset: Preset,
}

impl RenderSettings {
    /// A quality's settings with what the scene says in their place.
    pub fn apply(&self, settings: Settings) -> Settings {
        Settings {
            sensitivity: self.sensitivity.unwrap_or(settings.sensitivity),
            classification: if self.filtered_density { Classification::Filtered } else { settings.classification },
            ..settings
        }
    }
}

/// What a flight is made of.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Who steers; without a guide the camera stays where it is.
    pub guide: Option<Guide>,
    /// Somebody else's navigation method; takes the place of `guide`.
    pub own_guide: Option<OwnGuide>,
    /// A log that is flown again; takes the place of any guide.
    pub play: Option<Playback>,
    /// The camera's body.
    pub body: Body,
    /// Sensory rays; used by the guide `tentacles` alone.
    pub tentacles: TentacleSettings,
    /// The potential; used by the guide `potential` alone.
    pub potential: Potential,
    /// How a plan is flown; used by the guide `path` alone.
    pub path: PathSettings,
    /// Mines behind the camera; a scene with `mines = false` has none.
    pub mines: Option<MineSettings>,
    /// Notices when the flight gets nowhere.
    pub watch: Option<MonitorSettings>,
    /// How images are traced.
    pub render: RenderSettings,
    /// Whether images are traced: asked for by a window or a recording.
    pub picture: bool,
    /// Whether steps are written down.
    pub log: bool,
    /// Whether an operator can take part: a window, or a recorded input.
    pub operator: bool,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            guide: Some(Guide::Tentacles),
            own_guide: None,
            play: None,
            body: Body::default(),
            tentacles: TentacleSettings::default(),
            potential: Potential::default(),
            path: PathSettings::default(),
            mines: Some(MineSettings::default()),
            watch: Some(MonitorSettings::default()),
            render: RenderSettings::default(),
            picture: false,
            log: false,
            operator: false,
        }
    }
}

/// A scene as it stands in a file: a list of plugins, and settings for them.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneFile {
    plugins: Vec<String>,
    #[serde(default)]
    body: Body,
    #[serde(default)]
    tentacles: TentacleSettings,
    #[serde(default)]
    potential: Potential,
    #[serde(default)]
    path: PathSettings,
    #[serde(default)]
    mines: MineSettings,
    #[serde(default)]
    watch: MonitorSettings,
    #[serde(default)]
    render: RenderSettings,
}

impl Scene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// Status 3 when it cannot be read, status 2 when it is no scene or a setting in it makes no sense.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| {
            Error::file(path, format!("cannot be read ({})", crate::output::plain(&e)), "give a scene file")
        })?;
        Self::parse(&text).map_err(|e| Error::usage(path.display().to_string(), e.to_string(), "see assets/scenes"))
    }

    /// Reads a scene from the text of its file.
    ///
    /// # Errors
    /// Status 2 as above.
    pub fn parse(text: &str) -> Result<Self> {
        let mend = "name known plugins and settings";
        let file: SceneFile = toml::from_str(text).map_err(|e| Error::usage("scene", e.message().to_owned(), mend))?;
        let mut scene = Self {
            mines: None,
            watch: None,
            body: file.body,
            tentacles: file.tentacles,
            potential: file.potential,
            path: file.path,
            render: file.render,
            ..Self::default()
        };
        let mut guides = Vec::new();
        for plugin in &file.plugins {
            match plugin.as_str() {
                "mines" => scene.mines = Some(file.mines),
                "watch" => scene.watch = Some(file.watch),
                "render" => scene.picture = true,
                name => match Guide::named(name) {
                    Some(guide) => guides.push(guide),
                    None => return Err(Error::usage("scene", format!("there is no plugin {name:?}"), mend)),
                },
            }
        }
        match guides[..] {
            [] => scene.guide = None,
            [guide] => scene.guide = Some(guide),
            _ => return Err(Error::usage("scene", format!("names {} guides", guides.len()), "name one guide at most")),
        }
        scene.check()?;
        Ok(scene)
    }

    /// # Errors
    /// Status 2 for a setting that makes no sense.
    pub fn check(&self) -> Result<()> {
        self.body.check()?;
        self.potential.check()?;
        self.path.check()?;
        let t = &self.tentacles;
        let positive = [
            ("tentacles.reach_mm", t.reach_mm),
            ("tentacles.wall_mm", t.wall_mm),
            ("tentacles.cruise_mm_s", t.cruise_mm_s),
            ("tentacles.mine_cone", t.mine_cone),
            ("mines.spacing_mm", self.mines.map_or(1.0, |m| m.spacing_mm)),
            ("mines.reach_mm", self.mines.map_or(1.0, |m| m.reach_mm)),
            ("watch.window_s", self.watch.map_or(1.0, |w| w.window_s)),
            ("watch.revisited_mm", self.watch.map_or(1.0, |w| w.revisited_mm)),
        ];
        let not_negative = [
            ("tentacles.wall_push", t.wall_push),
            ("tentacles.agreement", t.agreement),
            ("mines.push", self.mines.map_or(0.0, |m| m.push)),
            ("watch.least_progress_mm", self.watch.map_or(0.0, |w| w.least_progress_mm)),
            ("watch.visited_mm", self.watch.map_or(0.0, |w| w.visited_mm)),
        ];
        let bad = |(name, value): (&str, f64), what: &str| {
            Err(Error::usage(name, format!("is {value}"), format!("give a finite number {what}")))
        };
        if let Some(&p) = positive.iter().find(|(_, v)| !(v.is_finite() && *v > 0.0)) {
            return bad(p, "above 0");
        }
        if let Some(&p) = not_negative.iter().find(|(_, v)| !(v.is_finite() && *v >= 0.0)) {
            return bad(p, "of at least 0");
        }
        if let Some(s) = self.render.sensitivity.filter(|s| !(*s > 0.0 && *s < 1.0)) {
            return bad(("render.sensitivity", f64::from(s)), "between 0 and 1");
        }
        if !(3..=4096).contains(&t.count) {
            return bad(("tentacles.count", t.count as f64), "from 3 to 4096");
        }
        if self.mines.is_some_and(|m| m.kept > 100_000) {
            return bad(("mines.kept", self.mines.map_or(0.0, |m| m.kept as f64)), "up to 100000");
        }
        Ok(())
    }

    /// The guide's name as the operator reads it.
    pub fn guide_name(&self) -> &'static str {
        match (&self.play, self.own_guide) {
            (Some(_), _) => "play",
            (None, Some(_)) => "own",
            (None, None) => self.guide.map_or("none", Guide::name),
        }
    }

    /// Which of the guides of this crate steers.
    pub fn steers(&self) -> Option<Guide> {
        self.guide.filter(|_| self.own_guide.is_none() && self.play.is_none())
    }

    /// Speed of the flight where nothing holds it up, mm/s.
    pub fn cruise_mm_s(&self) -> f64 {
        match self.steers() {
            Some(Guide::Path) => self.path.cruise_mm_s,
            Some(Guide::Potential) => self.potential.target_force / (self.body.mass_g * self.body.drag_per_s).max(1e-9),
            _ => self.tentacles.cruise_mm_s,
        }
    }

    /// Whether the camera has tentacles.
    pub fn feels(&self) -> bool {
        self.play.is_none() && self.own_guide.map_or(self.guide == Some(Guide::Tentacles), |own| own.feels)
    }

    /// Whether anything moves the camera.
    pub fn moves(&self) -> bool {
        self.play.is_some() || self.own_guide.is_some() || self.guide.is_some()
    }

    /// Whether a guide moves the camera by itself.
    pub fn is_automatic(&self) -> bool {
        self.play.is_none() && (self.own_guide.is_some() || self.guide.is_some_and(|g| g != Guide::Manual))
    }

    /// Whether the flight is watched.
    pub fn watches(&self) -> bool {
        self.watch.is_some() && self.moves() && self.play.is_none()
    }

    /// Adds the plugins of the scene to an application, and notes what it goes without.
    ///
    /// # Errors
    /// When two plugins want the same slot.
    pub fn plug_into(&self, app: &mut App) -> Result<()> {
        let plugins = match (&self.play, self.own_guide, self.guide) {
            (Some(_), ..) => &[systems::play::plugin as Plugin][..],
            (None, Some(own), _) => own.plugins,
            (None, None, Some(guide)) => Guide::ALL.iter().find(|g| g.0 == guide).map_or(&[][..], |g| g.2),
            (None, None, None) => &[],
        };
        for &plugin in plugins {
            app.add(plugin)?;
        }
        if self.feels() {
            if self.mines.is_some() {
                app.add(systems::mines::plugin)?;
            } else {
                app.leave_out("mines", "the scene names none");
            }
        } else {
            app.leave_out("tentacles", "no guide feels its way");
            app.leave_out("mines", "no guide that they could push on");
        }
        if self.play.is_some() {
            app.leave_out("motion", "the camera is where the log says");
        } else if self.moves() {
            app.add(systems::motion::plugin)?;
        } else {
            app.leave_out("guide", "the scene names none: the camera stays where it is");
            app.leave_out("motion", "nothing moves the camera");
        }
        if self.watches() {
            app.add(systems::watch::plugin)?;
        } else {
            app.leave_out("watch", "the scene names none, or no guide that it could watch");
        }
        if self.operator && self.moves() {
            app.add(systems::operator::plugin)?;
        } else {
            app.leave_out("operator", "neither a window nor a recorded input, or nothing that moves");
        }
        if self.log {
            app.add(systems::log::plugin)?;
        } else {
            app.leave_out("log", "no --log was asked for");
        }
        if self.picture {
            app.add(systems::raycast::plugin)?;
        } else {
            app.leave_out("picture", "neither a window nor a recording: no ray is cast for an image");
        }
        let guide = self.steers();
        if guide != Some(Guide::Potential) {
            let why = match guide {
                Some(Guide::Path) => "the centerline is found by it, then it goes: clearances are exact and local",
                _ => "no part of the scene asks for it: clearances are exact and local",
            };
            app.leave_out("wall distance field", why);
            let why = match guide {
                Some(Guide::Path) => "no part of the scene asks for it: the plan takes its place",
                Some(Guide::Tentacles) => "no part of the scene asks for it: mines take its place",
                _ => "no part of the scene asks for it",
            };
            app.leave_out("target distance field", why);
        }
        if guide != Some(Guide::Path) {
            app.leave_out("centerline", "no part of the scene asks for it");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_names_its_plugins() {
        let s = Scene::parse("plugins = [\"tentacles\"]\n[tentacles]\ncount = 64\n").unwrap();
        assert!(s.mines.is_none() && s.watch.is_none() && s.tentacles.count == 64);
        let s = Scene::parse("plugins = [\"manual\", \"watch\"]").unwrap();
        assert!(s.guide == Some(Guide::Manual) && s.watch.is_some());
        let s = Scene::parse("plugins = [\"render\"]").unwrap();
        assert!(s.guide.is_none() && s.picture && s.render.preset == Preset::Default);
        let s = Scene::parse("plugins = [\"render\"]\n[render]\npreset = \"colvis\"").unwrap();
        assert_eq!(s.render.preset, Preset::Colvis);
        for bad in [
            "plugins = [\"tentacles\", \"manual\"]",
            "plugins = [\"warp\"]",
            "plugins = [\"tentacles\"]\n[body]\nmass_g = 0",
            "plugins = [\"tentacles\"]\n[body]\nmass_g = nan",
            "plugins = [\"tentacles\"]\n[tentacles]\ncount = 2",
            "plugins = [\"tentacles\"]\nspeed = 2",
            "plugins = [\"render\"]\n[render]\nsensitivity = 1.5",
            "plugins = [\"render\"]\n[render]\npreset = \"best\"",
            "plugins",
        ] {
            assert!(Scene::parse(bad).is_err(), "{bad}");
        }
    }
}
