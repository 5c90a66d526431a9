//! Adaptive detail in real time, as in a window: how many pictures of a flight with sudden turns meet the frame time, and how
//! long a picture takes to reach the reference's quality when the camera stops.

use std::time::Instant;

use crate::error::Result;
use crate::progress::Progress;
use crate::render::adaptive::{Adaptive, FRAME, FrameBudget, SAMPLES, cost_shown};
use crate::render::{Direct, Frame, ImageSize, Preset, Quality, Renderer, Reuse, Settings, View, psnr, renderer};
use crate::report::flight::Flown;
use crate::report::{median, quantile};
use crate::space::PreparedVolume;

use super::Extent;

/// Assumed cost of showing a picture, ms.
const PRESENT_MS: f64 = 2.0;
/// Number of frames between two sudden turns of the camera.
const TURN_EVERY: usize = 40;
/// Maximum number of pictures of a refinement.
const PICTURES: usize = 5000;

/// Results of the measurement.
pub(crate) struct AdaptiveMeasurement {
    /// Times of the pictures in motion, ms.
    pub ms: Vec<f64>,
    /// Number of sudden turns among them.
    pub turns: usize,
    /// Share of a moving picture's pixels that were traced before upscaling, median.
    pub traced: f64,
    /// Time from the stop to the best picture, s.
    pub refined_s: Vec<f64>,
    /// Slowest picture during refinement, ms.
    pub refining_ms: f64,
    /// PSNR of the first best picture against the reference with the same number of samples, dB.
    pub refined_db: f64,
}

impl AdaptiveMeasurement {
    /// Returns the share of pictures in motion that took longer than a frame.
    pub(crate) fn late(&self) -> f64 {
        let frame = FRAME.as_secs_f64() * 1e3;
        self.ms.iter().filter(|&&ms| ms > frame).count() as f64 / self.ms.len() as f64
    }

    /// Returns the finding as a sentence.
    pub(crate) fn finding(&self, pixels: usize) -> String {
        format!(
            "Adaptive detail at {pixels}² with a frame of {:.1} ms: {:.2} % of {} pictures with {} sudden turns took longer (median \
             {:.1} ms, p99 {:.1} ms, {:.0} % of the pixels traced); standing still, the reference with 16 samples a pixel is reached in \
             {:.2} s (slowest {:.2} s), with a PSNR of {:.1} dB.",
            FRAME.as_secs_f64() * 1e3,
            100.0 * self.late(),
            self.ms.len(),
            self.turns,
            median(&self.ms),
            quantile(&self.ms, 0.99),
            100.0 * self.traced,
            median(&self.refined_s),
            self.refined_s.iter().copied().fold(0.0, f64::max),
            self.refined_db
        )
    }
}

/// Flies `extent.moving` frames of the flight, sixty per second, with sudden turns and occasional stops.
pub(crate) fn motion(
    volume: &PreparedVolume,
    flown: &Flown,
    extent: &Extent,
    progress: &Progress,
) -> Result<AdaptiveMeasurement> {
    let settings = Settings { adaptive: true, ..Settings::new(Quality::High) };
    let mut eye = Eye {
        renderer: renderer(volume, settings, Preset::default(), Reuse::Allowed),
        budget: FrameBudget::default(),
        frame: Frame::default(),
    };
    let side = extent.pixels * 2;
    let poses = flown.moving(extent.moving, TURN_EVERY);
    progress.stage("moving", poses.len() as u64);
    let mut m = AdaptiveMeasurement {
        ms: Vec::new(),
        turns: 0,
        traced: 0.0,
        refined_s: Vec::new(),
        refining_ms: 0.0,
        refined_db: f64::INFINITY,
    };
    let mut first = None;
    let mut traced = Vec::new();
    let stop_every = (poses.len() / extent.stops.max(1)).max(1);
    for (n, (pose, turned)) in poses.iter().enumerate() {
        let view = pose.view(extent.fov_degrees, side)?;
        m.ms.push(eye.picture(&view, Camera::Moving));
        m.turns += usize::from(*turned);
        if let Some(d) = eye.renderer.detail() {
            traced.push(d.size.pixels() as f64 / (side * side) as f64);
        }
        if (n + 1).is_multiple_of(stop_every) {
            let begun = Instant::now();
            for _ in 0..PICTURES {
                m.refining_ms = eye.picture(&view, Camera::Resting).max(m.refining_ms);
                if eye.renderer.detail().is_none_or(|d| d.best) {
                    break;
                }
            }
            m.refined_s.push(begun.elapsed().as_secs_f64());
            first.get_or_insert_with(|| (view, eye.frame.clone()));
        }
        progress.advance(1)?;
    }
    m.traced = median(&traced);
    if let Some((view, refined)) = first {
        progress.stage("reference", 1);
        m.refined_db = psnr(&refined, &reference(volume, &view, settings));
        progress.advance(1)?;
    }
    Ok(m)
}

/// Renders the target of a refinement with single rays that skip empty space. The report states the error of this method, `high
/// h/8`, against brute force.
fn reference(volume: &PreparedVolume, view: &View, settings: Settings) -> Frame {
    let settings = Settings { samples_per_pixel: SAMPLES, ..Adaptive::fine(settings).unwrap_or(settings) };
    let mut frame = Frame::default();
    Direct::new(volume, settings).render(view, &mut frame);
    frame
}

/// State of the camera while a picture is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Camera {
    Moving,
    Resting,
}

struct Eye {
    renderer: Box<dyn Renderer>,
    budget: FrameBudget,
    frame: Frame,
}

impl Eye {
    /// Renders one picture as in the window. Returns its time, ms.
    fn picture(&mut self, view: &View, camera: Camera) -> f64 {
        let rest = camera == Camera::Resting;
        let pixels = view.width() * view.height();
        self.renderer.set_budget(self.budget.next(rest, PRESENT_MS, pixels));
        let begun = Instant::now();
        let work = self.renderer.render(view, &mut self.frame);
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        let cost = cost_shown(&work, self.renderer.detail(), ImageSize::new(view.width(), view.height()));
        self.budget.took(rest, cost, pixels, ms);
        ms
    }
}
