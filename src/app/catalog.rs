//! What a program has to choose from: guides, renderers, cameras, overlays.

use crate::app::{Overlay, overlays};
use crate::error::{Error, Result};
use crate::render::{CameraModel, Preset, camera, presets};
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
    /// Cameras, by `--camera`.
    pub cameras: Vec<CameraModel>,
    /// Overlays of the window, on their keys.
    pub overlays: Vec<Overlay>,
    /// Plug-ins of every flight.
    pub plugins: Plugins,
}

impl Default for Catalog {
    /// What is built in.
    fn default() -> Self {
        Self {
            guides: systems::guides(),
            presets: presets::BUILT_IN.to_vec(),
            cameras: camera::BUILT_IN.to_vec(),
            overlays: overlays::BUILT_IN.to_vec(),
            plugins: Plugins::default(),
        }
    }
}

impl Catalog {
    /// Adds a guide.
    #[must_use]
    pub fn guide<G: Guide>(mut self) -> Self {
        self.guides = self.guides.with::<G>();
        self
    }

    /// Adds a renderer, in the place of one of the same name if there is one.
    #[must_use]
    pub fn preset(mut self, preset: Preset) -> Self {
        self.presets.retain(|p| *p != preset);
        self.presets.push(preset);
        self
    }

    /// Adds a camera, in the place of one of the same name if there is one.
    #[must_use]
    pub fn camera(mut self, camera: CameraModel) -> Self {
        self.cameras.retain(|c| c.name != camera.name);
        self.cameras.push(camera);
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

/// There is no such thing.
fn no<'a>(what: &str, name: &str, names: impl Iterator<Item = &'a str>) -> Error {
    let names: Vec<&str> = names.collect();
    Error::usage(what, format!("there is no {name:?}"), format!("choose one of {}", names.join(", ")))
}
