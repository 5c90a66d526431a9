//! Renders the same poses with every method in turn and compares.

use std::time::Instant;

use crate::error::Result;
use crate::progress::Progress;
use crate::render::{Frame, PreparedVolume, Renderer, View, Work, psnr};
use crate::report::flight::Stop;
use crate::report::image::{displaced, rms, ssim};
use crate::report::methods::{REFERENCE, RenderMethod};

use super::Extent;

/// A wall is displaced when it is off by more than this share of the smallest spacing.
const TOLERANCE: f64 = 0.25;
/// A method slower than this (ms) is not warmed up before each frame: what a warm cache saves is lost in it.
const SLOW_MS: f64 = 300.0;

/// How far a frame is from the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// Number of the pose.
    pub stop: usize,
    /// Whether the camera jumped there.
    pub jump: bool,
    /// dB.
    pub psnr: f64,
    /// Structural similarity, 1 at best.
    pub ssim: f64,
    /// Share of pixels whose wall is displaced, for methods whose depth is their own.
    pub displaced: Option<f64>,
    /// Samples a ray.
    pub samples: f64,
    /// ms.
    pub ms: f64,
    /// For methods that keep something: PSNR of this frame against one of a fresh renderer (the error of reuse), and of
    /// the fresh one against the reference (the error of sampling).
    pub reuse: Option<[f64; 2]>,
}

/// A method's measurements.
pub struct Measured {
    /// The method.
    pub method: RenderMethod,
    /// Time to make it ready, beside the flags, s.
    pub prepare_s: f64,
    /// Memory at the end, beside the voxels.
    pub bytes: usize,
    /// Times of all frames within the flight, after a warm-up, ms.
    pub ms: Vec<f64>,
    /// Times of the frames after a jump, ms.
    pub jump_ms: Vec<f64>,
    /// A line for each pose.
    pub faults: Vec<Fault>,
    /// The worst frame's pose, the reference there, and the frame.
    pub worst: Option<(usize, Frame, Frame)>,
}

impl Measured {
    /// PSNR of every frame.
    pub fn psnr(&self) -> Vec<f64> {
        self.faults.iter().map(|f| f.psnr).collect()
    }

    /// The least PSNR, dB.
    pub fn worst_psnr(&self) -> f64 {
        self.psnr().into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Root mean square error over all frames, grey levels.
    pub fn rms(&self) -> f64 {
        let square = |f: &Fault| rms(f.psnr).powi(2);
        (self.faults.iter().map(square).sum::<f64>() / self.faults.len() as f64).sqrt()
    }
}

/// A method at work.
struct Running<'a> {
    renderer: Box<dyn Renderer>,
    volume: &'a PreparedVolume,
    measured: Measured,
}

/// Measures `methods`, and the reference as the first of the result.
pub fn measure(
    volume: &PreparedVolume,
    methods: &[RenderMethod],
    stops: &[Stop],
    extent: &Extent,
    progress: &Progress,
) -> Result<Vec<Measured>> {
    progress.stage("preparing", methods.len() as u64);
    let mut running = Vec::with_capacity(methods.len());
    for &method in methods {
        running.push(Running::new(volume, method)?);
        progress.advance(1)?;
    }
    let mut reference = Running::new(volume, REFERENCE)?;
    progress.stage("measuring", (stops.len() * (methods.len() + 1)) as u64);
    for (n, stop) in stops.iter().enumerate() {
        let truth = reference.truth(n, stop, extent)?;
        progress.advance(1)?;
        // Another one begins each time, so that none is always after the same.
        for k in 0..running.len() {
            let k = (k + n) % running.len();
            running[k].visit(n, stop, extent, &truth)?;
            progress.advance(1)?;
        }
    }
    Ok([reference].into_iter().chain(running).map(Running::finish).collect())
}

fn timed(renderer: &mut dyn Renderer, view: &View, frame: &mut Frame) -> (f64, Work) {
    let begun = Instant::now();
    let work = renderer.render(view, frame);
    (begun.elapsed().as_secs_f64() * 1e3, work)
}

impl<'a> Running<'a> {
    fn new(volume: &'a PreparedVolume, method: RenderMethod) -> Result<Self> {
        let begun = Instant::now();
        let renderer = (method.make)(volume)?;
        let prepare_s = begun.elapsed().as_secs_f64();
        let measured = Measured {
            method,
            prepare_s,
            bytes: 0,
            ms: Vec::new(),
            jump_ms: Vec::new(),
            faults: Vec::new(),
            worst: None,
        };
        Ok(Self { renderer, volume, measured })
    }

    /// The reference's picture and depth of a pose, timed without depth.
    fn truth(&mut self, n: usize, stop: &Stop, extent: &Extent) -> Result<Frame> {
        let view = stop.pose.view(extent.fov_degrees, extent.pixels)?;
        let mut frame = Frame::new(extent.pixels, extent.pixels);
        let (ms, work) = timed(self.renderer.as_mut(), &view, &mut frame);
        // The crossings are exact whatever the picture's quality, so a quick picture tells them.
        let mut truth = Frame::with_depth(extent.pixels, extent.pixels);
        let quick = crate::render::Settings { step_power: 1, ..crate::render::Settings::default() };
        crate::render::render(self.volume, &view, &quick, &mut truth);
        truth.buffers().0.copy_from_slice(frame.pixels());
        self.note(n, stop, ms, work, &frame, &truth, None, None);
        Ok(truth)
    }

    /// Renders a pose as the next frames of a flight and compares the last.
    fn visit(&mut self, n: usize, stop: &Stop, extent: &Extent, truth: &Frame) -> Result<()> {
        let traits = self.measured.method.traits;
        let mut frame = Frame::new(extent.pixels, extent.pixels);
        let view = stop.pose.view(extent.fov_degrees, extent.pixels)?;
        if traits.keeps {
            for (k, pose) in stop.lead.iter().enumerate() {
                let (ms, _) = timed(self.renderer.as_mut(), &pose.view(extent.fov_degrees, extent.pixels)?, &mut frame);
                // The first comes after a jump.
                if k > 0 {
                    self.measured.ms.push(ms);
                }
            }
        } else if self.measured.faults.last().is_none_or(|f| f.ms < SLOW_MS) {
            // Not the pose itself: a cache would know all of it.
            let before = stop.lead.last().unwrap_or(&stop.pose).view(extent.fov_degrees, extent.pixels)?;
            self.renderer.render(&before, &mut frame);
        }
        let (ms, work) = timed(self.renderer.as_mut(), &view, &mut frame);
        let displaced = self.displaced(extent, &view, truth);
        let reuse = if traits.keeps {
            let mut alone = Frame::new(extent.pixels, extent.pixels);
            (self.measured.method.make)(self.volume)?.render(&view, &mut alone);
            Some([psnr(&frame, &alone), psnr(&alone, truth)])
        } else {
            None
        };
        self.note(n, stop, ms, work, &frame, truth, displaced, reuse);
        Ok(())
    }

    /// The share of displaced walls, for methods with a depth of their own. None of these keeps anything from one frame
    /// to the next, so that a frame for the depth alone changes no other.
    fn displaced(&mut self, extent: &Extent, view: &View, truth: &Frame) -> Option<f64> {
        if !self.measured.method.traits.own_depth {
            return None;
        }
        let mut frame = Frame::with_depth(extent.pixels, extent.pixels);
        self.renderer.render(view, &mut frame);
        let tolerance = TOLERANCE * self.volume.voxels().grid().min_spacing();
        frame.depth().zip(truth.depth()).map(|(a, b)| displaced(a, b, tolerance))
    }

    #[expect(clippy::too_many_arguments, reason = "a frame's measurements, all at once")]
    fn note(
        &mut self,
        n: usize,
        stop: &Stop,
        ms: f64,
        work: Work,
        frame: &Frame,
        truth: &Frame,
        displaced: Option<f64>,
        reuse: Option<[f64; 2]>,
    ) {
        let m = &mut self.measured;
        let times = if stop.jump { &mut m.jump_ms } else { &mut m.ms };
        times.push(ms);
        let db = psnr(frame, truth);
        if m.faults.iter().all(|f| f.psnr > db) && db.is_finite() {
            m.worst = Some((n, truth.clone(), frame.clone()));
        }
        let samples = work.samples as f64 / work.rays.max(1) as f64;
        let ssim = ssim(frame, truth);
        m.faults.push(Fault { stop: n, jump: stop.jump, psnr: db, ssim, displaced, samples, ms, reuse });
    }

    fn finish(mut self) -> Measured {
        self.measured.bytes = self.renderer.bytes();
        self.measured
    }
}
