//! A way to make pictures, with whatever it keeps from one to the next.

use super::bytes::{ByteScenery, ByteVolume};
use super::caster;
use super::fast::{Fast, Pixels};
use super::quality::{Classification, Preset, Quality};
use super::reuse::paper::Trace;
use super::reuse::{Plain, Refresh, Reusing};
use super::{Frame, Settings, Space, View, Work};

/// Renders views of one space, in the order of a flight. It may keep what it likes between frames as long as each
/// frame is as good on its own: the views may jump.
pub trait Renderer: Send + Sync {
    /// Renders `view` into `frame` (made to fit if it does not), on all of rayon's threads; the same bytes for every
    /// number of threads, if the views before were the same.
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work;

    /// Memory that it takes now, beside the 16-bit voxels, bytes.
    fn bytes(&self) -> usize {
        self.parts().iter().map(|p| p.1).sum()
    }

    /// What that memory is for, and how much of it.
    fn parts(&self) -> Vec<(&'static str, usize)>;
}

/// Pictures from one key frame to the next in the paper's own combination.
const KEY_FRAMES: u32 = 10;

/// The renderer of `space` by `settings` that `preset` stands for, with frame-to-frame reuse only if `reuse`.
///
/// The reference is the same in every preset: it is what they are measured against.
pub fn renderer(space: &Space, settings: Settings, preset: Preset, reuse: bool) -> Box<dyn Renderer> {
    if is_fast(&settings, preset) {
        return Box::new(Fast::new(space, settings, Pixels::Needed));
    }
    if settings.quality == Quality::Reference || preset != Preset::Colvis {
        return Box::new(Direct::new(space, settings));
    }
    let settings = Settings { classification: Classification::Filtered, ..settings };
    let scenery = ByteScenery::new(space, ByteVolume::new(space, 2));
    if reuse {
        Box::new(Reusing::<_, Trace>::new(scenery, settings, Refresh::KeyFrames(KEY_FRAMES)))
    } else {
        Box::new(Plain::new(scenery, settings))
    }
}

/// Whether [`renderer`] makes something that keeps structures of its own: where it does not, a picture needs nothing but
/// the space.
pub fn keeps(settings: &Settings, preset: Preset) -> bool {
    is_fast(settings, preset) || settings.quality != Quality::Reference && preset == Preset::Colvis
}

/// Whether packets of rays render it: they know one ray a pixel, trilinear and classified by value.
fn is_fast(settings: &Settings, preset: Preset) -> bool {
    let plain = settings.classification == Classification::Value && settings.samples_per_pixel <= 1;
    preset == Preset::Default && settings.quality == Quality::High && plain
}

/// The ray caster of [`caster::render`]: nothing is kept between frames.
pub struct Direct {
    space: Space,
    settings: Settings,
}

impl Direct {
    /// Renders `space` by `settings`.
    pub fn new(space: &Space, settings: Settings) -> Self {
        Self { space: space.clone(), settings }
    }
}

impl Renderer for Direct {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        caster::render(&self.space, view, &self.settings, frame)
    }

    fn parts(&self) -> Vec<(&'static str, usize)> {
        vec![("homogeneous-region flags", self.space.bytes())]
    }
}
