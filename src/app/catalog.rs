//! The guides, looks, renderers, cameras, shaders, overlays, detectors and plug-ins that a program offers.

use crate::error::{Error, Result};
use crate::polyps::{Detector, detectors};
use crate::render::{CameraModel, Preset, ShaderModel, camera, presets, shaders};
use crate::schedule::{Guide, Guides, Look, Plugin, Plugins};
use crate::systems;
use crate::{Overlay, overlays};

/// Everything that can be selected by name: the built-in entries and those that a program adds.
///
/// The command line, scene files, the window's keys and the help texts are derived from it.
#[derive(Clone, Debug)]
pub struct Catalog {
    /// Guides, selected by `--guide`.
    pub guides: Guides,
    /// Renderers, selected by `--preset`.
    pub presets: Vec<Preset>,
    /// Cameras, selected by `--camera` and `[render] camera`.
    pub cameras: Vec<CameraModel>,
    /// Shaders, selected by `[render] shade`.
    pub shaders: Vec<ShaderModel>,
    /// Overlays of the window, toggled by their keys.
    pub overlays: Vec<Overlay>,
    /// Where the camera looks, selected by `[view] look`.
    pub looks: Vec<Look>,
    /// Detectors of polyps, selected by `candidates --detector`.
    pub detectors: Vec<Detector>,
    /// Plug-ins that take part in every flight.
    pub plugins: Plugins,
    /// Names of added guides that were taken already.
    twice: Vec<&'static str>,
}

impl Default for Catalog {
    /// The built-in entries.
    fn default() -> Self {
        Self {
            guides: systems::guides(),
            presets: presets::BUILT_IN.to_vec(),
            cameras: camera::BUILT_IN.to_vec(),
            shaders: shaders::BUILT_IN.to_vec(),
            overlays: overlays::BUILT_IN.to_vec(),
            looks: systems::looks::BUILT_IN.to_vec(),
            detectors: detectors::BUILT_IN.to_vec(),
            plugins: Plugins::default(),
            twice: Vec::new(),
        }
    }
}

impl Catalog {
    /// Adds a guide.
    #[must_use]
    pub fn guide<G: Guide>(mut self) -> Self {
        if self.guides.named(G::NAME).is_some() {
            self.twice.push(G::NAME);
        }
        self.guides = self.guides.with::<G>();
        self
    }

    /// Adds a renderer.
    #[must_use]
    pub fn preset(mut self, preset: Preset) -> Self {
        self.presets.push(preset);
        self
    }

    /// Adds a camera.
    #[must_use]
    pub fn camera(mut self, camera: CameraModel) -> Self {
        self.cameras.push(camera);
        self
    }

    /// Adds a shader.
    #[must_use]
    pub fn shader(mut self, shader: ShaderModel) -> Self {
        self.shaders.push(shader);
        self
    }

    /// Adds an overlay.
    #[must_use]
    pub fn overlay(mut self, overlay: Overlay) -> Self {
        self.overlays.push(overlay);
        self
    }

    /// Adds a look.
    #[must_use]
    pub fn look(mut self, look: Look) -> Self {
        self.looks.push(look);
        self
    }

    /// Adds a detector.
    #[must_use]
    pub fn detector(mut self, detector: Detector) -> Self {
        self.detectors.push(detector);
        self
    }

    /// Adds a plug-in.
    #[must_use]
    pub fn plugin(mut self, plugin: impl Plugin) -> Self {
        self.plugins.push(plugin);
        self
    }

    /// Returns the renderer with that name.
    ///
    /// # Errors
    /// Returns status 2 if it does not exist.
    pub fn find_preset(&self, name: &str) -> Result<Preset> {
        self.presets
            .iter()
            .find(|p| p.name == name)
            .copied()
            .ok_or_else(|| no("preset", name, self.presets.iter().map(|p| p.name)))
    }

    /// Returns the camera with that name.
    ///
    /// # Errors
    /// Returns status 2 if it does not exist.
    pub fn find_camera(&self, name: &str) -> Result<CameraModel> {
        self.cameras
            .iter()
            .find(|c| c.name == name)
            .copied()
            .ok_or_else(|| no("camera", name, self.cameras.iter().map(|c| c.name)))
    }
}

/// Tables and keywords of scene files that cannot be used as names.
const RESERVED: [&str; 8] = ["plugins", "body", "mines", "watch", "view", "render", "overlay", "none"];

impl Catalog {
    /// Returns the shader with that name.
    ///
    /// # Errors
    /// Returns status 2 if it does not exist.
    pub fn find_shader(&self, name: &str) -> Result<ShaderModel> {
        let found = self.shaders.iter().find(|s| s.name == name).copied();
        found.ok_or_else(|| no("shade", name, self.shaders.iter().map(|s| s.name)))
    }

    /// Returns the overlay with that name.
    ///
    /// # Errors
    /// Returns status 2 if it does not exist.
    pub fn find_overlay(&self, name: &str) -> Result<Overlay> {
        let found = self.overlays.iter().find(|o| o.name == name).copied();
        found.ok_or_else(|| no("overlay", name, self.overlays.iter().map(|o| o.name)))
    }

    /// Returns the look with that name.
    ///
    /// # Errors
    /// Returns status 2 if it does not exist.
    pub fn find_look(&self, name: &str) -> Result<Look> {
        let found = self.looks.iter().find(|l| l.name == name).copied();
        found.ok_or_else(|| no("look", name, self.looks.iter().map(|l| l.name)))
    }

    /// Returns the detector with that name.
    ///
    /// # Errors
    /// Returns status 2 if it does not exist.
    pub fn find_detector(&self, name: &str) -> Result<Detector> {
        let found = self.detectors.iter().find(|d| d.name == name).copied();
        found.ok_or_else(|| no("detector", name, self.detectors.iter().map(|d| d.name)))
    }

    /// Checks that every name and every key is unique. Guides, presets, cameras, shaders and plug-ins share one namespace, since
    /// each may have a table in a scene file. Overlays have separate tables, looks and detectors none.
    ///
    /// # Errors
    /// Returns status 2 for the first name or key that is used twice, naming both owners.
    pub fn check(&self) -> Result<()> {
        let kinds = |kind, names: Vec<String>| names.into_iter().map(move |name| (name, kind)).collect::<Vec<_>>();
        let own = |names: &mut dyn Iterator<Item = &'static str>| names.map(str::to_owned).collect::<Vec<_>>();
        let mut names: Vec<(String, &str)> = [
            kinds("a word of scene files", own(&mut RESERVED.into_iter())),
            kinds("guide", own(&mut self.guides.iter().map(|g| g.name).chain(["play"]))),
            kinds("guide", own(&mut self.twice.iter().copied())),
            kinds("preset", own(&mut self.presets.iter().map(|p| p.name))),
            kinds("camera", own(&mut self.cameras.iter().map(|c| c.name))),
            kinds("shader", own(&mut self.shaders.iter().map(|s| s.name))),
            kinds("plug-in", self.plugins.iter().map(|p| p.name().into_owned()).collect()),
        ]
        .concat();
        unique(&mut names)?;
        unique(&mut kinds("overlay", own(&mut self.overlays.iter().map(|o| o.name))))?;
        unique(&mut kinds("look", own(&mut self.looks.iter().map(|l| l.name))))?;
        unique(&mut kinds("detector", own(&mut self.detectors.iter().map(|d| d.name))))?;
        let lower = |key: char| key.to_lowercase().to_string();
        let guides = self.guides.iter().filter_map(|g| Some((lower(g.key?), format!("guide {}", g.name))));
        let overlays = self.overlays.iter().filter_map(|o| Some((lower(o.key?), format!("overlay {}", o.name))));
        let keys: Vec<(String, String)> = guides.chain(overlays).collect();
        for (n, (key, owner)) in keys.iter().enumerate() {
            if let Some((_, other)) = keys[..n].iter().find(|k| k.0 == *key) {
                return Err(taken(&format!("key {:?}", key.to_uppercase()), other, owner, "key"));
            }
        }
        Ok(())
    }
}

/// Checks that each name occurs once. Fails with status 2 for the first duplicate name.
fn unique(names: &mut [(String, &str)]) -> Result<()> {
    for n in 0..names.len() {
        let (name, kind) = &names[n];
        if name.is_empty() {
            return Err(Error::usage(*kind, "has no name", "give it one"));
        }
        if let Some((_, other)) = names[..n].iter().find(|o| o.0 == *name) {
            let [first, second] = [other, kind].map(|k| format!("{k} {name}"));
            let first = if RESERVED.contains(&name.as_str()) { format!("{name}, {other}") } else { first };
            return Err(taken(&format!("name {name:?}"), &first, &second, "name"));
        }
    }
    Ok(())
}

/// Error: `first` and `second` claim the same name or key.
#[doc(hidden)]
pub fn taken(what: &str, first: &str, second: &str, thing: &str) -> Error {
    Error::usage(
        what,
        format!("is used twice: by {first} and by {second}"),
        format!("give one of them a different {thing}"),
    )
}

/// Error: nothing with that name exists.
fn no<'a>(what: &str, name: &str, names: impl Iterator<Item = &'a str>) -> Error {
    let names: Vec<&str> = names.collect();
    Error::usage(what, format!("there is no {name:?}"), format!("choose one of {}", names.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Body;
    use crate::schedule::App;

    #[derive(Clone, Debug, Default, serde::Deserialize, PartialEq)]
    struct Own;

    impl Guide for Own {
        const NAME: &'static str = "own";
        const SUMMARY: &'static str = "does nothing";
        const KEY: Option<char> = Some('X');

        fn cruise_mm_s(&self, _: &Body) -> f64 {
            0.0
        }

        fn plug(&self, _: &mut App) -> Result<()> {
            Ok(())
        }
    }

    /// A catalog with an entry of each kind, all with names of their own.
    fn full() -> Catalog {
        Catalog::default()
            .guide::<Own>()
            .preset(Preset { name: "own preset", ..Preset::default() })
            .camera(CameraModel { name: "own camera", ..CameraModel::default() })
            .shader(ShaderModel { name: "own shader", ..ShaderModel::default() })
            .overlay(Overlay { name: "own overlay", key: Some('y'), ..overlays::BUILT_IN[0] })
            .plugin(|_: &mut App| Ok(()))
    }

    #[test]
    fn what_is_added_is_found_beside_what_is_built_in() {
        let (own, built_in) = (full(), Catalog::default());
        assert!(own.guides.named("own").is_some() && own.guides.iter().count() == built_in.guides.iter().count() + 1);
        assert_eq!(own.plugins.iter().count(), 1);
        assert_eq!(own.find_preset("own preset").unwrap().name, "own preset");
        assert_eq!(own.find_camera("own camera").unwrap().name, "own camera");
        assert_eq!(own.find_shader("own shader").unwrap().name, "own shader");
        assert_eq!(own.find_overlay("own overlay").unwrap().name, "own overlay");
        for catalog in [&own, &built_in] {
            assert!(presets::BUILT_IN.iter().all(|p| catalog.find_preset(p.name).unwrap() == *p));
            assert!(camera::BUILT_IN.iter().all(|c| catalog.find_camera(c.name).unwrap() == *c));
            assert!(shaders::BUILT_IN.iter().all(|s| catalog.find_shader(s.name).unwrap() == *s));
            assert!(overlays::BUILT_IN.iter().all(|o| catalog.find_overlay(o.name).unwrap().name == o.name));
            catalog.check().unwrap();
        }
        for refused in [
            built_in.find_preset("own preset").map(drop),
            built_in.find_camera("own camera").map(drop),
            built_in.find_shader("own shader").map(drop),
            built_in.find_overlay("own overlay").map(drop),
        ] {
            let e = refused.unwrap_err().to_string();
            assert!(e.contains("there is no \"own") && e.contains("choose one of "), "{e}");
        }
    }

    #[test]
    fn names_and_keys_are_unique() {
        let preset = |name| Preset { name, ..Preset::default() };
        let overlay = |name, key| Overlay { name, key, ..overlays::BUILT_IN[0] };
        for (what, catalog) in [
            ("guide", Catalog::default().guide::<Own>().guide::<Own>()),
            ("built in", Catalog::default().preset(preset("default"))),
            ("another kind's", full().preset(preset("own"))),
            ("a camera's", full().preset(preset("own camera"))),
            ("a shader's", full().preset(preset("own shader"))),
            ("a table's", Catalog::default().preset(preset("render"))),
            ("a log's", Catalog::default().preset(preset("play"))),
            ("none", Catalog::default().preset(preset(""))),
            ("overlay", full().overlay(overlay("own overlay", None))),
            ("overlay's key", full().overlay(overlay("other", Some('Y')))),
            ("guide's key", full().overlay(overlay("other", Some('x')))),
        ] {
            assert!(catalog.check().is_err(), "{what}");
        }
        full().overlay(overlay("own", None)).check().unwrap();
        let e = full().overlay(overlay("other", Some('x'))).check().unwrap_err().to_string();
        assert!(e.contains("key \"X\": is used twice: by guide own and by overlay other"), "{e}");
    }
}
