//! A way to make pictures, with whatever it keeps from one to the next.

use super::adaptive::{Adaptive, Fine};
use super::bytes::{ByteScenery, ByteVolume};
use super::caster;
use super::fast::{Fast, Pixels};
use super::low::Low;
use super::quality::{Classification, Preset, Quality};
use super::reuse::paper::Trace;
use super::reuse::{Plain, Refresh, Reusing};
use super::{Frame, PreparedVolume, Settings, View, Work};

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

    /// Lets each picture from now on take about so many samples. Only renderers whose detail follows the need listen.
    fn set_budget(&mut self, _samples: u64) {}

    /// Whether it traces a part of the pixels and stretches them: strips of a picture, each rendered as one of its own, would
    /// not fit together.
    fn stretches(&self) -> bool {
        false
    }

    /// How detailed the last picture is, where that follows the need.
    fn detail(&self) -> Option<Detail> {
        None
    }
}

/// How detailed a picture is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detail {
    /// Pixels that were traced, before the picture was stretched.
    pub size: (usize, usize),
    /// Samples of the reference that each pixel has.
    pub samples: u32,
    /// Whether the same view rendered again would be no better.
    pub best: bool,
}

/// Pictures from one key frame to the next in the paper's own combination.
const KEY_FRAMES: u32 = 10;

/// The renderer of `space` by `settings` that `preset` stands for, with frame-to-frame reuse only if `reuse`.
///
/// The reference is the same in every preset: it is what they are measured against.
pub fn renderer(space: &PreparedVolume, settings: Settings, preset: Preset, reuse: bool) -> Box<dyn Renderer> {
    if settings.adaptive {
        return adaptive(space, settings, preset, reuse);
    }
    if is_fast(&settings, preset) {
        return match settings.quality {
            Quality::Low => Box::new(Low::new(space, settings)),
            _ => Box::new(Fast::new(space, settings, Pixels::Needed)),
        };
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

/// A renderer whose detail follows the need. Its moving pictures are those of the preset, and at rest it comes to the
/// reference, which is the same in every preset.
fn adaptive(space: &PreparedVolume, settings: Settings, preset: Preset, reuse: bool) -> Box<dyn Renderer> {
    let moving = Settings { adaptive: false, ..settings };
    let fine = Adaptive::fine(moving);
    if let (Some(fine), true) = (fine, is_fast(&moving, preset)) {
        let fast = Fast::new(space, moving, Pixels::Needed);
        let fine = fast.beside(Fine::packets(fine));
        return Box::new(Adaptive::new(space, Box::new(fast), Some(Fine::Packets(fine))));
    }
    let fine = fine.map(|fine| match is_fast(&fine, preset) {
        true => Fine::Packets(Fast::new(space, Fine::packets(fine), Pixels::Needed)),
        false => Fine::Rays(Direct::new(space, fine)),
    });
    Box::new(Adaptive::new(space, renderer(space, moving, preset, reuse), fine))
}

/// Whether [`renderer`] makes something that keeps structures of its own: where it does not, a picture needs nothing but
/// the space.
pub fn keeps(settings: &Settings, preset: Preset) -> bool {
    settings.adaptive || is_fast(settings, preset) || settings.quality != Quality::Reference && preset == Preset::Colvis
}

/// Whether packets of rays render it: they know one ray a pixel, trilinear and classified by value.
fn is_fast(settings: &Settings, preset: Preset) -> bool {
    let plain = settings.classification == Classification::Value && settings.samples_per_pixel <= 1;
    preset == Preset::Default && settings.quality != Quality::Reference && plain
}

/// The ray caster of [`caster::render`]: nothing is kept between frames.
pub struct Direct {
    space: PreparedVolume,
    settings: Settings,
}

impl Direct {
    /// Renders `space` by `settings`.
    pub fn new(space: &PreparedVolume, settings: Settings) -> Self {
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
