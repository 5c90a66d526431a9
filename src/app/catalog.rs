//! What a program has to choose from: guides, renderers, cameras, overlays.

use crate::app::{Overlay, overlays};
use crate::error::{Error, Result};
use crate::render::{CameraModel, Preset, ShaderModel, camera, presets, shaders};
use crate::schedule::{Guide, Guides, Plugin, Plugins};
use crate::systems;

/// Everything that can be chosen by its name: what is built in, and whatever a program adds.
///
/// The command line, scene files, the window's keys and their help are read off this.
#[derive(Clone, Debug)]
pub struct Catalog {
    /// Guides, by `--guide`.
    pub guides: Guides,
    /// Renderers, by `--preset`.
    pub presets: Vec<Preset>,
    /// Cameras, by `--camera` and `[render] camera`.
    pub cameras: Vec<CameraModel>,
    /// Shaders, by `[render] shade`.
    pub shaders: Vec<ShaderModel>,
    /// Overlays of the window, on their keys.
    pub overlays: Vec<Overlay>,
    /// Plug-ins of every flight.
    pub plugins: Plugins,
    /// Guides that were added although there was one of their name.
    twice: Vec<&'static str>,
}

impl Default for Catalog {
    /// What is built in.
    fn default() -> Self {
        Self {
            guides: systems::guides(),
            presets: presets::BUILT_IN.to_vec(),
            cameras: camera::BUILT_IN.to_vec(),
            shaders: shaders::BUILT_IN.to_vec(),
            overlays: overlays::BUILT_IN.to_vec(),
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

    /// Adds a plug-in.
    #[must_use]
    pub fn plugin(mut self, plugin: impl Plugin) -> Self {
        self.plugins.push(plugin);
        self
    }

    /// The renderer of that name.
    ///
    /// # Errors
    /// Status 2 where there is none.
    pub fn find_preset(&self, name: &str) -> Result<Preset> {
        self.presets
            .iter()
            .find(|p| p.name == name)
            .copied()
            .ok_or_else(|| no("preset", name, self.presets.iter().map(|p| p.name)))
    }

    /// The camera of that name.
    ///
    /// # Errors
    /// Status 2 where there is none.
    pub fn find_camera(&self, name: &str) -> Result<CameraModel> {
        self.cameras
            .iter()
            .find(|c| c.name == name)
            .copied()
            .ok_or_else(|| no("camera", name, self.cameras.iter().map(|c| c.name)))
    }
}

/// Tables and words of scene files that are no names.
const RESERVED: [&str; 7] = ["plugins", "body", "mines", "watch", "render", "overlay", "none"];

impl Catalog {
    /// The shader of that name.
    ///
    /// # Errors
    /// Status 2 where there is none.
    pub fn find_shader(&self, name: &str) -> Result<ShaderModel> {
        let found = self.shaders.iter().find(|s| s.name == name).copied();
        found.ok_or_else(|| no("shade", name, self.shaders.iter().map(|s| s.name)))
    }

    /// The overlay of that name.
    ///
    /// # Errors
    /// Status 2 where there is none.
    pub fn find_overlay(&self, name: &str) -> Result<Overlay> {
        let found = self.overlays.iter().find(|o| o.name == name).copied();
        found.ok_or_else(|| no("overlay", name, self.overlays.iter().map(|o| o.name)))
    }

    /// Checks that every name and every key stands for one thing. Guides, presets, cameras, shaders and plug-ins share their
    /// names, as each may have a table in a scene file. Overlays have tables of their own.
    ///
    /// # Errors
    /// Status 2 for the first name or key that is taken twice, with both of its owners.
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

/// # Errors
/// Status 2 for the first name that stands there twice.
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

/// Two want to have the same thing.
pub(crate) fn taken(what: &str, first: &str, second: &str, thing: &str) -> Error {
    Error::usage(
        what,
        format!("is used twice: by {first} and by {second}"),
        format!("give one of them a different {thing}"),
    )
}

/// There is no such thing.
fn no<'a>(what: &str, name: &str, names: impl Iterator<Item = &'a str>) -> Error {
    let names: Vec<&str> = names.collect();
    Error::usage(what, format!("there is no {name:?}"), format!("choose one of {}", names.join(", ")))
}
