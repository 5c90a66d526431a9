//! Renders the same poses with every method in turn and compares the results.

use std::time::Instant;

use crate::error::Result;
use crate::progress::Progress;
use crate::render::{Frame, Renderer, View, Work, psnr};
use crate::report::flight::Stop;
use crate::report::image::{displaced, rms, ssim};
use crate::report::methods::{REFERENCE, RenderMethod};
use crate::space::PreparedVolume;

use super::Extent;

/// A wall counts as displaced if its distance differs by more than this share of the smallest spacing.
const TOLERANCE: f64 = 0.25;
/// Frame time, ms, above which a method is not warmed up before each frame, since the effect of a warm cache is negligible then.
const SLOW_MS: f64 = 300.0;

/// Error of a frame against the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fault {
    /// Index of the pose.
    pub stop: usize,
    /// True if the camera jumped there.
    pub jump: bool,
    /// PSNR, dB.
    pub psnr: f64,
    /// Structural similarity; 1 is best.
    pub ssim: f64,
    /// Share of pixels whose wall is displaced, for methods that compute their own depth.
    pub displaced: Option<f64>,
    /// Samples per ray.
    pub samples: f64,
    /// Frame time, ms.
    pub ms: f64,
    /// For methods that keep data: PSNR of this frame against one of a fresh renderer (the error of reuse), and of the fresh one
    /// against the reference (the error of sampling).
    pub reuse: Option<[f64; 2]>,
}

/// A method's measurements.
pub(crate) struct Measured {
    /// The method.
    pub method: RenderMethod,
    /// Preparation time in addition to the flags, s.
    pub prepare_s: f64,
    /// Memory at the end in addition to the voxels, bytes.
    pub bytes: usize,
    /// Times of all frames within the flight, after a warm-up, ms.
    pub ms: Vec<f64>,
    /// Times of the frames after a jump, ms.
    pub jump_ms: Vec<f64>,
    /// Errors at each pose.
    pub faults: Vec<Fault>,
    /// The worst frame: its pose, the reference, and the frame.
    pub worst: Option<(usize, Frame, Frame)>,
}

impl Measured {
    /// Returns the PSNR of every frame, dB.
    pub(crate) fn psnr(&self) -> Vec<f64> {
        self.faults.iter().map(|f| f.psnr).collect()
    }

    /// Returns the smallest PSNR, dB.
    pub(crate) fn worst_psnr(&self) -> f64 {
        self.psnr().into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Returns the root mean square error over all frames, grey levels.
    pub(crate) fn rms(&self) -> f64 {
        let square = |f: &Fault| rms(f.psnr).powi(2);
        (self.faults.iter().map(square).sum::<f64>() / self.faults.len() as f64).sqrt()
    }
}

/// A method during the measurement.
struct Running<'a> {
    renderer: Box<dyn Renderer>,
    volume: &'a PreparedVolume,
    measured: Measured,
}

/// Measures `methods`. The first result is the reference.
pub(crate) fn measure(
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
        // A different method starts each time, so that none always follows the same one.
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

    /// Renders the reference's picture and depth at a pose. The time excludes depth.
    fn truth(&mut self, n: usize, stop: &Stop, extent: &Extent) -> Result<Frame> {
        let view = stop.pose.view(extent.fov_degrees, extent.pixels)?;
        let mut frame = Frame::new(extent.pixels, extent.pixels);
        let (ms, work) = timed(self.renderer.as_mut(), &view, &mut frame);
        // The crossings are exact at any picture quality, so a fast picture provides them.
        let mut truth = Frame::with_depth(extent.pixels, extent.pixels);
        let quick = crate::render::Settings { step_power: 1, ..crate::render::Settings::default() };
        crate::render::render(self.volume, &view, &quick, &mut truth);
        truth.buffers().0.copy_from_slice(frame.pixels());
        self.note(n, stop, ms, work, &frame, &truth, None, None);
        Ok(truth)
    }

    /// Renders a pose and the frames of the flight that lead to it, and compares the last frame.
    fn visit(&mut self, n: usize, stop: &Stop, extent: &Extent, truth: &Frame) -> Result<()> {
        let traits = self.measured.method.traits;
        let mut frame = Frame::new(extent.pixels, extent.pixels);
        let view = stop.pose.view(extent.fov_degrees, extent.pixels)?;
        if traits.keeps {
            for (k, pose) in stop.lead.iter().enumerate() {
                let (ms, _) = timed(self.renderer.as_mut(), &pose.view(extent.fov_degrees, extent.pixels)?, &mut frame);
                // The first frame follows a jump.
                if k > 0 {
                    self.measured.ms.push(ms);
                }
            }
        } else if self.measured.faults.last().is_none_or(|f| f.ms < SLOW_MS) {
            // Not the pose itself, since a cache would then contain all of it.
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

    /// Returns the share of displaced walls, for methods that compute their own depth. None of these keeps data between frames,
    /// so an extra frame for the depth does not affect others.
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
