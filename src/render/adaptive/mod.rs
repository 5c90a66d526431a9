//! Detail that follows the need (the paper's plan of detail relative to speed).
//!
//! **In motion** a picture is traced at a part of its resolution and stretched: as finely as its budget of samples and its
//! image flow allow (`level`, `flow`). What an earlier picture took predicts what the next will take.
//!
//! **At rest** it is made sharp first, and then refined to the reference with 16 samples a pixel, a part with every picture
//! that is asked for, within the same budget (`still`). When that is done, no ray is cast any more. Where three samples are
//! alike there are no others, and packets of rays take steps of half a voxel for the reference's eighth: 50 dB of it and more.
//!
//! There is no clock here: a budget is a number of samples. Who has a clock turns it into samples by what samples have
//! taken; who has none gets the same pictures every time.

mod budget;
mod flow;
mod level;
mod still;

use super::caster::depths;
use super::enlarge::Enlarger;
use super::memory::MemoryPart;
use super::quality::{Quality, Settings};
use super::renderer::{Detail, Renderer};
use super::{Frame, PreparedVolume, View, Work};
use flow::Probes;
use level::Governor;
use still::{Means, Still};

pub use budget::{Budget, FRAME, FrameBudget};
pub use still::SAMPLES;

/// What a picture may cost where nobody says otherwise, in samples: what two cores of today take in a sixtieth of a second.
pub const BUDGET: Budget = Budget::strict(5_000_000);
/// A ray costs as much as so many samples, beside its own: to be set up, shaded and shown.
const RAY: u64 = 8;
/// A picture that would move by no more pixels than this since it was begun is at rest.
const REST: f64 = 0.5;

/// What a picture cost, in samples.
pub fn cost(work: &Work) -> u64 {
    work.samples.saturating_add(work.rays.saturating_mul(RAY))
}

/// What a picture of `shown` pixels cost, in samples, stretching included: of the detail that its renderer tells.
pub fn cost_shown(work: &Work, detail: Option<Detail>, shown: (usize, usize)) -> u64 {
    let stretched = detail.is_some_and(|d| d.size != shown);
    let pixels = (shown.0 * shown.1) as f64;
    cost(work).saturating_add(if stretched { (pixels * level::STRETCHED) as u64 } else { 0 })
}

/// Follows the need with two renderers of the same space.
pub struct Adaptive {
    volume: PreparedVolume,
    moving: Box<dyn Renderer>,
    /// Makes samples of the reference; none at a quality that does not ask for it.
    fine: Option<Box<dyn Renderer>>,
    budget: Budget,
    governor: Governor,
    /// Of the last view that was another.
    probes: Option<Probes>,
    small: Frame,
    enlarger: Enlarger,
    still: Still,
    resting: bool,
    /// The last picture of a moving camera: a camera that stops begins with it.
    last: Frame,
    traced: (usize, usize),
}

impl Adaptive {
    /// Follows the need by `moving`, and at rest by `fine`, which makes one sample a pixel.
    pub fn new(volume: &PreparedVolume, moving: Box<dyn Renderer>, fine: Option<Box<dyn Renderer>>) -> Self {
        Self {
            volume: volume.clone(),
            moving,
            fine,
            budget: BUDGET,
            governor: Governor::default(),
            probes: None,
            small: Frame::default(),
            enlarger: Enlarger::default(),
            still: Still::default(),
            resting: false,
            last: Frame::default(),
            traced: (0, 0),
        }
    }

    /// The settings of [`Adaptive`]'s finest samples, for pictures by `settings`; none where those do not go so far.
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
        let size = (view.width(), view.height());
        let (width, height) = self.governor.next(size, flow, self.budget);
        self.traced = (width, height);
        let work = if self.traced == size {
            // Not into `frame`: its depth is seen to by the caller.
            self.moving.render(view, &mut self.last)
        } else {
            let work = self.moving.render(&view.resized(width, height), &mut self.small);
            self.last.resize(view.width(), view.height());
            self.enlarger.enlarge(&self.small, &mut self.last);
            work
        };
        self.governor.took(cost(&work), size.0 * size.1);
        self.probes = Some(Probes::new(&self.volume, view));
        frame.show(&self.last);
        work
    }

    fn at_rest(&mut self, view: &View, frame: &mut Frame) -> Work {
        let size = (view.width(), view.height());
        if !self.resting {
            self.resting = true;
            self.still.begin(&self.last, self.traced == size);
        }
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
        // A camera at rest may tremble: its picture stays that of the view that it came to rest at.
        let rest = self.probes.as_ref().map(|p| (p.flow(view), p.view().clone()));
        let work = match rest {
            Some((flow, of)) if flow <= REST => self.at_rest(&of, frame),
            Some((flow, _)) => self.in_motion(view, flow, frame),
            None => self.in_motion(view, f64::INFINITY, frame),
        };
        if let Some(depth) = frame.buffers().1 {
            depths(&self.volume, view, depth);
        }
        work
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        let pixels = |f: &Frame| f.pixels().len() * 3;
        let mut parts = self.moving.parts();
        // What both share is told once.
        let own = self.fine.as_ref().map_or(0, |fine| fine.own_bytes());
        if own > 0 {
            parts.push((MemoryPart::RefinementRays, own));
        }
        parts.push((
            MemoryPart::RefinementPictures,
            self.still.bytes() + pixels(&self.small) + pixels(&self.last) + self.enlarger.bytes(),
        ));
        parts
    }

    fn set_budget(&mut self, budget: Budget) {
        self.budget = budget;
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
