//! Adaptive detail (the paper's plan of detail relative to speed).
//!
//! **In motion** a picture is traced at part of its resolution and stretched, as finely as its budget of samples and
//! its image flow allow (`level`, `flow`). The cost of earlier pictures predicts that of the next.
//!
//! **At rest** the picture first becomes sharp and is then refined to the reference with 16 samples a pixel. Every
//! requested picture adds a part, within the same budget (`still`). Once this is done, no more rays are cast. Pixels
//! whose first three samples are alike get no others, and packets of rays take steps of half a voxel instead of the
//! reference's eighth. The result has a PSNR of 50 dB or more against the reference.
//!
//! This module uses no clock: a budget is a number of samples. A caller with a clock converts time into samples from
//! measured times per sample. A caller without one gets the same pictures every time.

mod budget;
mod flow;
mod level;
mod still;

use super::caster::fill_depth;
use super::distances::Distances;
use super::enlarge::Enlarger;
use super::memory::MemoryPart;
use super::quality::{Quality, Settings};
use super::renderer::{Detail, Renderer};
use super::{Frame, PreparedVolume, View, Work};
use crate::render::frame::ImageSize;
use flow::Probes;
use level::Governor;
use still::{Means, Still};

pub use budget::Budget;
#[doc(hidden)]
pub use budget::{FRAME, FrameBudget};
#[doc(hidden)]
pub use still::SAMPLES;

/// Default budget of a picture, in samples: what two present-day cores take in a sixtieth of a second.
pub(crate) const BUDGET: Budget = Budget::strict(5_000_000);
/// Cost of a ray in samples, besides those it takes: to be set up, shaded and shown.
const RAY: u64 = 8;
/// A picture that has moved by no more pixels than this since it was begun is at rest.
const REST: f64 = 0.5;

/// Returns the cost of a picture, in samples.
#[doc(hidden)]
pub fn cost(work: &Work) -> u64 {
    work.samples.saturating_add(work.rays.saturating_mul(RAY))
}

/// Returns the cost of a picture of `shown` pixels, in samples, including stretching. `detail` is what its renderer reports.
#[doc(hidden)]
pub fn cost_shown(work: &Work, detail: Option<Detail>, shown: ImageSize) -> u64 {
    let stretched = detail.is_some_and(|d| d.size != shown);
    let pixels = shown.pixels() as f64;
    cost(work).saturating_add(if stretched { (pixels * level::STRETCHED) as u64 } else { 0 })
}

/// Adapts the detail with two renderers of the same volume.
#[doc(hidden)]
pub struct Adaptive {
    volume: PreparedVolume,
    moving: Box<dyn Renderer>,
    /// Renders samples of the reference; `None` for a quality that does not ask for it.
    fine: Option<Box<dyn Renderer>>,
    budget: Budget,
    governor: Governor,
    /// Probes of the last view that differed.
    probes: Option<Probes>,
    /// The last picture of a moving camera, as it was traced. A camera that stops starts from it.
    last: Frame,
    enlarger: Enlarger,
    still: Still,
    resting: bool,
    traced: ImageSize,
    /// The size of the last picture as it was shown.
    shown: ImageSize,
    /// True if the renderer's last picture was the whole one, not a strip.
    is_whole: bool,
}

impl Adaptive {
    /// Creates a renderer that uses `moving` in motion, and at rest `fine`, which takes one sample a pixel.
    pub(crate) fn new(volume: &PreparedVolume, moving: Box<dyn Renderer>, fine: Option<Box<dyn Renderer>>) -> Self {
        Self {
            volume: volume.clone(),
            moving,
            fine,
            budget: BUDGET,
            governor: Governor::default(),
            probes: None,
            last: Frame::default(),
            enlarger: Enlarger::default(),
            still: Still::default(),
            resting: false,
            traced: ImageSize::new(0, 0),
            shown: ImageSize::new(0, 0),
            is_whole: false,
        }
    }

    /// Returns the settings of [`Adaptive`]'s finest samples for pictures with `settings`; `None` if those are not refined.
    #[doc(hidden)]
    pub fn fine(settings: Settings) -> Option<Settings> {
        let Settings { sensitivity, step_power, .. } = Settings::new(Quality::Reference);
        let fine = Settings {
            quality: Quality::High,
            sensitivity,
            step_power,
            samples_per_pixel: 1,
            adaptive: false,
            ..settings
        };
        (settings.quality != Quality::Low).then_some(fine)
    }

    fn in_motion(&mut self, view: &View, flow: f64, frame: &mut Frame) -> Work {
        self.resting = false;
        let size = ImageSize::new(view.width(), view.height());
        (self.traced, self.shown) = (self.governor.next(size, flow, self.budget), size);
        // Not into `frame`: the caller handles its depth.
        let work = if self.traced == size {
            let work = self.moving.render(view, &mut self.last);
            frame.show(&self.last);
            work
        } else {
            let work = self.moving.render(&view.resized(self.traced.width, self.traced.height), &mut self.last);
            frame.resize(size.width, size.height);
            self.enlarger.enlarge(&self.last, frame);
            work
        };
        self.is_whole = true;
        self.governor.took(cost(&work), size.pixels());
        self.probes = Some(Probes::new(&self.volume, view));
        work
    }

    fn at_rest(&mut self, view: &View, frame: &mut Frame) -> Work {
        let size = ImageSize::new(view.width(), view.height());
        if !self.resting {
            self.resting = true;
            let begun = self.still.begin(self.shown, self.traced == self.shown);
            if self.traced == self.shown {
                begun.show(&self.last);
            } else {
                self.enlarger.enlarge(&self.last, begun);
            }
        }
        self.is_whole &= self.still.is_sharp();
        let means = Means { sharp: &mut *self.moving, fine: self.fine.as_deref_mut() };
        let work = self.still.go_on(view, means, self.budget.samples);
        if self.still.is_sharp() {
            self.traced = size;
        }
        frame.show(self.still.shown());
        work
    }
}

impl Renderer for Adaptive {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        // A camera at rest may tremble: its picture remains that of the view in which it came to rest.
        let rest = self.probes.as_ref().map(|p| (p.flow(view), p.view().clone()));
        let work = match rest {
            Some((flow, of)) if flow <= REST => self.at_rest(&of, frame),
            Some((flow, _)) => self.in_motion(view, flow, frame),
            None => self.in_motion(view, f64::INFINITY, frame),
        };
        fill_depth(&self.volume, view, frame);
        work
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        let pixels = |f: &Frame| f.pixels().len() * 3;
        let mut parts = self.moving.parts();
        // Memory that both share is counted once.
        let own = self.fine.as_ref().map_or(0, |fine| fine.own_bytes());
        if own > 0 {
            parts.push((MemoryPart::RefinementRays, own));
        }
        parts.push((MemoryPart::RefinementPictures, self.still.bytes() + pixels(&self.last) + self.enlarger.bytes()));
        parts
    }

    fn set_budget(&mut self, budget: Budget) {
        self.budget = budget;
    }

    fn distances(&self) -> Option<Distances<'_>> {
        // At rest, strips may have taken their place.
        Some(self.moving.distances().filter(|_| self.is_whole)?.stretched(self.traced, self.shown))
    }

    fn complaint(&mut self) -> Option<(String, String)> {
        self.moving.complaint().or_else(|| self.fine.as_mut()?.complaint())
    }

    fn detail(&self) -> Option<Detail> {
        let best = self.resting && self.still.is_done(if self.fine.is_some() { SAMPLES } else { 0 });
        let samples = if self.resting { self.still.samples() } else { 0 };
        Some(Detail { size: self.traced, samples, best })
    }
}

#[cfg(test)]
mod tests;
