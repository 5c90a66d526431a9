//! Scene files: their format, and the scene that one describes.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use crate::dynamics::Body;
use crate::dynamics::mines::MineSettings;
use crate::dynamics::monitor::MonitorSettings;
use crate::error::{Error, Result};
use crate::images::{ImageSettings, RenderSettings};
use crate::panics::ask_plugin;
use crate::render::{
    CameraModel, Choices, GradientSource, Leaping, Light, LowDetail, Options, Preset, Settings, ShaderModel,
};
use crate::scene::{Scene, SceneOptions, Steering};
use crate::schedule::{Guides, Plugins};
use crate::{Catalog, Overlay, lines};

/// The format of a scene file: a list of plugins, and their settings. The remaining tables belong to guides, presets, cameras,
/// shaders and plug-ins, each under its name.
#[derive(Deserialize)]
struct SceneFile {
    plugins: Vec<String>,
    #[serde(default)]
    body: Body,
    #[serde(default)]
    mines: MineSettings,
    #[serde(default)]
    watch: MonitorSettings,
    #[serde(default)]
    view: ViewFile,
    #[serde(default)]
    render: RenderFile,
    /// A table for each overlay.
    #[serde(default)]
    overlay: toml::Table,
    #[serde(flatten)]
    named: toml::Table,
}

/// The table `[view]` of a scene file.
#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ViewFile {
    look: Option<String>,
}

/// The table `[render]` of a scene file.
#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
struct RenderFile {
    sensitivity: Option<f32>,
    filtered_density: bool,
    preset: Option<String>,
    camera: Option<String>,
    fov_degrees: Option<f64>,
    shade: Option<String>,
    light: Option<Light>,
    leap: Option<Leaping>,
    gradients: Option<GradientSource>,
    key_frames: Option<u32>,
    low: Option<LowDetail>,
}

impl RenderFile {
    /// Converts to the settings and the images' settings. Preset, camera and shader are looked up in `catalog`, and their settings
    /// by name in `options`. Fails with status 2 if the preset, camera or shader does not exist.
    fn settings(self, catalog: &Catalog, options: impl Fn(&str) -> Options) -> Result<(RenderSettings, ImageSettings)> {
        let Self { sensitivity, filtered_density, light, leap, gradients, key_frames, low, .. } = self;
        let preset = self.preset.map_or(Ok(Preset::default()), |name| catalog.find_preset(&name))?;
        let camera = self.camera.map_or(Ok(CameraModel::default()), |name| catalog.find_camera(&name))?;
        let shader = self.shade.map_or(Ok(ShaderModel::default()), |name| catalog.find_shader(&name))?;
        let choices = Choices { leap, gradients, key_frames, low };
        let shader = ShaderModel { options: options(shader.name), ..shader };
        let render = RenderSettings { sensitivity, filtered_density, choices, light, shader };
        let settings = Settings { options: options(preset.name), ..render.apply(Settings::default()) };
        let camera = CameraModel { options: options(camera.name), ..camera };
        let fov_degrees = self.fov_degrees.unwrap_or(90.0);
        Ok((render, ImageSettings { camera, fov_degrees, settings, preset, ..ImageSettings::default() }))
    }
}

impl SceneOptions {
    /// Returns an overlay with its settings.
    pub fn overlay(&self, overlay: Overlay) -> Overlay {
        Overlay { options: self.overlays.get(overlay.name).copied().unwrap_or(overlay.options), ..overlay }
    }
}

impl Scene {
    /// Reads a scene file. Guides and renderers are looked up in `catalog`.
    ///
    /// # Errors
    /// Returns status 3 if it cannot be read, and the errors of [`Scene::parse`], with the name of the file.
    pub fn read(path: &Path, catalog: &Catalog) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| {
            let why = format!("cannot be read ({})", crate::output::plain(&e));
            Error::file(path, why, "give a scene file").caused_by(e)
        })?;
        Self::parse(&text, catalog).map_err(|e| e.named(|what| format!("{}: {what}", path.display())))
    }

    /// Parses the text of a scene file. Guides, presets, cameras, shaders, overlays and plug-ins are looked up in `catalog`.
    ///
    /// # Errors
    /// Returns status 2 if it is not a scene or a setting in it is invalid, and the error of a guide or another part of another crate
    /// that checks its settings.
    pub fn parse(text: &str, catalog: &Catalog) -> Result<Self> {
        let file = toml::from_str(text).map_err(|e| lines::unread(text, &e, "name known plugins and settings"))?;
        Self::of_file(file, catalog).map_err(|e| lines::with_line(text, e))
    }

    fn of_file(file: SceneFile, catalog: &Catalog) -> Result<Self> {
        let hint = "name known plugins and settings";
        let (mut guides, mut plugins) = (catalog.guides.clone(), catalog.plugins.clone());
        let options = SceneOptions {
            named: named_options(file.named, catalog, &mut guides, &mut plugins)?,
            overlays: overlay_options(file.overlay, catalog)?,
        };
        let (render, image) = file.render.settings(catalog, |name| options.of(name))?;
        let look = file.view.look.map(|name| catalog.find_look(&name)).transpose()?;
        let mut scene = Self {
            guides,
            look,
            mines: None,
            watch: None,
            body: file.body,
            image,
            render,
            plugins,
            options,
            ..Self::default()
        };
        let mut named = Vec::new();
        for plugin in &file.plugins {
            match plugin.as_str() {
                "mines" => scene.mines = Some(file.mines),
                "watch" => scene.watch = Some(file.watch),
                "render" => scene.picture = true,
                "coverage" => scene.coverage = true,
                // Plug-ins take part in every flight of the program that has them.
                name if scene.plugins.iter().any(|p| p.name() == name) => {}
                name => match scene.guides.named(name) {
                    Some(guide) => named.push(guide.name),
                    None => return Err(Error::usage("scene", format!("there is no plugin {name:?}"), hint)),
                },
            }
        }
        scene.steering = match named[..] {
            [] => Steering::Nobody,
            [guide] => Steering::Guide(guide),
            _ => return Err(Error::usage("scene", format!("has {} guides", named.len()), "name one guide at most")),
        };
        scene.check()?;
        Ok(scene)
    }
}

/// Returns the settings in tables that are named after presets, cameras and shaders. Tables of guides and plug-ins are passed on to
/// those. Fails with status 2 for an unknown name, and for settings that the named part does not have.
fn named_options(
    tables: toml::Table,
    catalog: &Catalog,
    guides: &mut Guides,
    plugins: &mut Plugins,
) -> Result<BTreeMap<String, Options>> {
    let mut named = BTreeMap::new();
    for (name, value) in tables {
        let unknown = || Error::usage("scene", format!("there is no {name:?}"), "name known plugins and settings");
        let toml::Value::Table(table) = value else { return Err(unknown()) };
        if guides.named(&name).is_some() {
            guides.read(&name, table)?;
            continue;
        }
        let options = Options::new(table);
        if plugins.configure(&name, options)? {
            continue;
        }
        let in_table = |e: Error| e.named(|what| format!("[{name}] {what}"));
        if let Ok(preset) = catalog.find_preset(&name) {
            ask_plugin(|| format!("preset {name}"), || (preset.check)(options)).map_err(in_table)?;
        } else if let Ok(shader) = catalog.find_shader(&name) {
            ShaderModel { options, ..shader }.check().map_err(in_table)?;
        } else if let Ok(camera) = catalog.find_camera(&name) {
            CameraModel { options, ..camera }.camera(90.0, 1.0).map_err(in_table)?;
        } else {
            return Err(unknown());
        }
        named.insert(name, options);
    }
    Ok(named)
}

/// Returns the settings in the tables of overlays. Fails with status 2 for an unknown overlay, and for settings that it does not
/// have.
fn overlay_options(tables: toml::Table, catalog: &Catalog) -> Result<BTreeMap<String, Options>> {
    let mut overlays = BTreeMap::new();
    for (name, value) in tables {
        let overlay = catalog.find_overlay(&name)?;
        let toml::Value::Table(table) = value else {
            return Err(Error::usage(format!("overlay.{name}"), "is not a table", format!("write [overlay.{name}]")));
        };
        let options = Options::new(table);
        ask_plugin(|| format!("overlay {name}"), || (overlay.check)(options))
            .map_err(|e| e.named(|what| format!("[overlay.{name}] {what}")))?;
        overlays.insert(name, options);
    }
    Ok(overlays)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::tentacles::TentacleSettings;
    use crate::render::{Choices, GradientSource, Leaping, LowDetail, Preset, Settings};

    fn parse(text: &str) -> Result<Scene> {
        Scene::parse(text, &Catalog::default())
    }

    #[test]
    fn a_file_chooses_of_the_papers_ideas() {
        let text = "plugins = [\"render\"]\n[render]\npreset = \"colvis\"\nleap = \"voxel\"\ngradients = \"stored\"\n\
                    key_frames = 7\nlow = \"third\"";
        let s = parse(text).unwrap();
        let (leap, gradients) = (Some(Leaping::Voxel), Some(GradientSource::Stored));
        let choices = Choices { leap, gradients, key_frames: Some(7), low: Some(LowDetail::Third) };
        assert_eq!((s.render.choices, s.image.settings.choices, s.image.preset.name), (choices, choices, "colvis"));
        assert_eq!(s.render.apply(Settings::default()).choices, choices);
        // Settings that a preset does not support are refused wherever the preset was selected.
        let lean = Preset::named("lean").unwrap();
        let other = Scene { image: ImageSettings { preset: lean, ..s.image }, ..s };
        let refused = other.check().unwrap_err();
        assert!(refused.to_string().contains("the preset lean stores nothing per voxel"), "{refused}");
        assert!(parse("plugins = []\n[render]\npreset = \"lean\"\nleap = \"brick\"\ngradients = \"eight\"").is_ok());
    }

    #[test]
    fn an_error_names_the_setting_and_its_line() {
        for (text, told) in [
            ("plugins = []\n[body]\nmass_g = \"much\"", "line 3: body.mass_g: invalid type"),
            ("plugins = []\n\n[tentacles]\nlength_mm = 9\ncount = \"many\"", "line 5: tentacles.count: invalid type"),
            ("plugins = []\n[tentacles]\ncount = 64\ncounts = 20", "line 4: [tentacles]: unknown field `counts`"),
            ("plugins = []\n[body]\nmass_g = 0", "line 3: body.mass_g: "),
            ("plugins = []\nbody.mass_g = true", "line 2: body.mass_g: invalid type"),
            ("plugins = 3", "line 1: plugins: invalid type"),
            ("plugins = []\n[render]\nkey_frames = -3", "line 3: render.key_frames: "),
            ("plugins = []\n[render", "line 2: scene: "),
            ("[body]\nmass_g = 3.0", "scene: missing field `plugins`"),
        ] {
            let e = parse(text).unwrap_err().to_string();
            assert!(e.starts_with(told), "{text:?}: {e}");
        }
    }

    #[test]
    fn a_file_names_its_plugins() {
        let s = parse("plugins = [\"tentacles\"]\n[tentacles]\ncount = 64\n").unwrap();
        assert!(s.mines.is_none() && s.watch.is_none() && s.guides.get::<TentacleSettings>().count == 64);
        let s = parse("plugins = [\"manual\", \"watch\"]").unwrap();
        assert!(s.guide_name() == "manual" && s.watch.is_some());
        let s = parse("plugins = [\"render\"]").unwrap();
        assert!(!s.moves() && s.picture && s.image.preset == Preset::default());
        let s = parse("plugins = [\"render\"]\n[render]\npreset = \"colvis\"").unwrap();
        assert_ne!(s.image.preset, Preset::default());
        for bad in [
            "plugins = [\"tentacles\", \"manual\"]",
            "plugins = [\"warp\"]",
            "plugins = [\"tentacles\"]\n[body]\nmass_g = 0",
            "plugins = [\"tentacles\"]\n[body]\nmass_g = nan",
            "plugins = [\"tentacles\"]\n[tentacles]\ncount = 2",
            "plugins = [\"tentacles\"]\n[tentacles]\ncounts = 20",
            "plugins = [\"tentacles\"]\n[tentacles]\ndrive = \"mines\"",
            "plugins = [\"tentacles\", \"mines\"]\n[tentacles]\ndrive = \"oars\"",
            "plugins = [\"tentacles\"]\nspeed = 2",
            "plugins = [\"tentacles\"]\n[warp]\nspeed = 2",
            "plugins = [\"render\"]\n[render]\nsensitivity = 1.5",
            "plugins = [\"render\"]\n[render]\npreset = \"best\"",
            "plugins = [\"render\"]\n[render]\nleap = \"far\"",
            "plugins = [\"render\"]\n[render]\nleap = 8",
            "plugins = [\"render\"]\n[render]\ngradients = \"guessed\"",
            "plugins = [\"render\"]\n[render]\nlow = \"lower\"",
            "plugins = [\"render\"]\n[render]\nkey_frames = 0",
            "plugins = [\"render\"]\n[render]\nkey_frames = -3",
            "plugins = [\"render\"]\n[render]\nkey_frames = 2.5",
            "plugins = [\"render\"]\n[render]\nkey_frames = 5000000000",
            "plugins = [\"render\"]\n[render]\npreset = \"lean\"\nleap = \"voxel\"",
            "plugins = [\"render\"]\n[render]\npreset = \"lean\"\ngradients = \"stored\"",
            "plugins = [\"render\"]\n[render]\npreset = \"lean\"\nkey_frames = 5",
            "plugins",
        ] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn mines_that_drive_the_camera_are_kept() {
        let kept = |n: usize| {
            let text = "plugins = [\"tentacles\", \"mines\"]\n[tentacles]\ndrive = \"mines\"";
            parse(&format!("{text}\n[mines]\nkept = {n}"))
        };
        assert!(kept(1).is_ok());
        let e = kept(0).unwrap_err().to_string();
        assert!(e.contains("nothing would move the camera"), "{e}");
    }
}
