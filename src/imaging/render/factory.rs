//! Creation of a renderer from settings and a preset.

use super::adaptive::Adaptive;
use super::checked::Checked;
use super::direct::Direct;
use super::preset::{Preset, Reuse};
use super::quality::{Quality, Settings};
use super::renderer::Renderer;
use crate::space::PreparedVolume;

/// Creates the renderer that `preset` and `settings` select for `volume`.
///
/// Two things are the same for every preset of this crate. The quality `reference` is the baseline that all of them are
/// measured against. With adaptive detail ([`Settings::adaptive`]) the preset renders moving pictures, and at rest they
/// converge to the reference.
///
/// A preset of another crate renders every quality itself. At rest its pictures become as sharp as it can make them,
/// and sharper if it provides [`Renderer::refining`].
///
/// ```
/// use std::sync::Arc;
/// # use colvis_imaging as colvis;
/// use colvis::render::{Frame, PreparedVolume, Preset, Reuse, Settings, TransferFunction, View, renderer};
/// use colvis::volume::{Grid, Volume};
/// use glam::{DMat3, DVec3};
///
/// // Gas with a wall of tissue from x = 8 mm on, seen from 6 mm before it.
/// let grid = Grid::new([12, 12, 12], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).expect("a grid");
/// let data = (0..grid.len()).map(|n| if n % 12 < 8 { -1000 } else { 40 }).collect();
/// let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
/// let mut renderer = renderer(&volume, Settings::default(), Preset::default(), Reuse::Allowed);
/// let mut frame = Frame::with_depth(9, 9);
/// renderer.render(&View::new(DVec3::new(2.0, 5.5, 5.5), DVec3::X, DVec3::Z, 60.0, 9, 9)?, &mut frame);
/// assert!(frame.pixels()[40][0] > 100, "a wall seen straight on is bright");
/// assert!((frame.depth().expect("asked for")[40] - 5.34).abs() < 0.01);
/// # Ok::<(), colvis::error::Error>(())
/// ```
pub fn renderer(volume: &PreparedVolume, settings: Settings, preset: Preset, reuse: Reuse) -> Box<dyn Renderer> {
    if settings.adaptive {
        let settings = Settings { adaptive: false, ..settings };
        let moving = renderer(volume, settings, preset, reuse);
        let fine = Adaptive::fine(settings).and_then(|fine| match moving.refining(fine) {
            None if is_built_in(preset) => Some(Box::new(Direct::new(volume, fine)) as Box<dyn Renderer>),
            own => own,
        });
        return Box::new(Adaptive::new(volume, moving, fine));
    }
    match settings.quality {
        Quality::Reference if is_built_in(preset) => Box::new(Direct::new(volume, settings)),
        _ if is_built_in(preset) => (preset.make)(volume, settings, reuse),
        _ => Box::new(Checked::new(preset.name, (preset.make)(volume, settings, reuse))),
    }
}

/// Returns true if a preset is one of this crate's.
fn is_built_in(preset: Preset) -> bool {
    super::presets::BUILT_IN.contains(&preset)
}
