//! From settings and a preset to a renderer.

use super::adaptive::Adaptive;
use super::direct::Direct;
use super::prepared_volume::PreparedVolume;
use super::preset::{Preset, Reuse};
use super::quality::{Quality, Settings};
use super::renderer::Renderer;

/// The renderer of `space` by `settings` that `preset` stands for.
///
/// Two things are the same in every preset. The quality `reference` is what all of them are measured against. Where detail
/// follows the need ([`Settings::adaptive`]) the moving pictures are the preset's, and at rest they come to the reference.
pub fn renderer(space: &PreparedVolume, settings: Settings, preset: Preset, reuse: Reuse) -> Box<dyn Renderer> {
    if settings.adaptive {
        let settings = Settings { adaptive: false, ..settings };
        let moving = renderer(space, settings, preset, reuse);
        let fine = Adaptive::fine(settings)
            .map(|fine| moving.refining(fine).unwrap_or_else(|| Box::new(Direct::new(space, fine))));
        return Box::new(Adaptive::new(space, moving, fine));
    }
    match settings.quality {
        Quality::Reference => Box::new(Direct::new(space, settings)),
        _ => (preset.make)(space, settings, reuse),
    }
}
