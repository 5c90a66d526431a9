//! Flies without a screen: the same schedules, as fast as they run.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use crate::app::FlightApp;
use crate::app::plan::triple;
use crate::components::flight::State;
use crate::components::output::Picture;
use crate::error::{Error, Result};
use crate::host::log::Log;
use crate::host::record::Recorder;
use crate::progress::Progress;

/// What a headless flight leaves behind.
#[derive(Clone, Debug, Default)]
pub struct Outputs {
    /// Where images go.
    pub record: Option<String>,
    /// Images a simulated second.
    pub fps: f64,
    /// Images a second when the recording is shown; as `fps` if none.
    pub shown_fps: Option<f64>,
    /// Where steps are logged.
    pub log: Option<PathBuf>,
}

/// What a frame took.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct FrameStats {
    /// Milliseconds from the pose being known to the finished image.
    pub ms: f64,
    /// Rays cast.
    pub rays: u64,
    /// Samples taken.
    pub samples: u64,
    /// Pixels taken over from the last frame.
    pub reused: u64,
}

/// Flies until the flight has arrived, calls for the operator, or `seconds` of simulated time are over. The flight's
/// state tells which. Beside what went wrong, the frames that were made until then.
///
/// # Errors
/// Status 5 when an output cannot be written; status 4 when interrupted; what a replayed command is refused with. What was
/// logged and recorded until then is there, whole.
pub fn fly(
    flight: &mut FlightApp,
    seconds: f64,
    outputs: &Outputs,
    progress: &Arc<Progress>,
) -> (Vec<FrameStats>, Result<()>) {
    let mut frames = Vec::new();
    let flown = fly_into(&mut frames, flight, seconds, outputs, progress);
    (frames, flown)
}

fn fly_into(
    frames: &mut Vec<FrameStats>,
    flight: &mut FlightApp,
    seconds: f64,
    outputs: &Outputs,
    progress: &Arc<Progress>,
) -> Result<()> {
    let mut log = outputs.log.as_deref().map(Log::create).transpose()?;
    let size = flight.camera::<Picture>().map(|p| (p.frame.width(), p.frame.height()));
    let mut recorder = match (&outputs.record, size) {
        (Some(out), Some(size)) => Some(Recorder::create(out, size, outputs.shown_fps.unwrap_or(outputs.fps))?),
        _ => None,
    };
    let hz = f64::from(flight.clock().hz);
    let steps = (seconds * hz).round().min(1e15) as u64;
    let expected = (flight.plan().length_mm / flight.scene().tentacles.cruise_mm_s * hz * 1.3) as u64;
    progress.stage("flying", steps.min(expected.max(1)));
    let mut fly = || {
        for tick in 0..steps {
            if let Some(recorder) = recorder.as_mut().filter(|_| due(frames.len() as u64, outputs.fps, hz) <= tick) {
                frames.push(picture(flight, recorder)?);
            }
            flight.step()?;
            if tick + 1 == steps {
                flight.end();
            }
            if let Some(log) = &mut log {
                log.add(flight.take_log())?;
            }
            let interrupted = progress.advance(1).is_err();
            if interrupted || flight.flight().state != State::Flying {
                return Ok(interrupted);
            }
        }
        Ok(false)
    };
    let flown = fly();
    // However the flight ended, what it leaves is finished: first the log, as a recording may hang on another program.
    let logged = log.map_or(Ok(()), |l| l.finish(flight.flight().state));
    let recorded = recorder.map_or(Ok(()), |mut recorder| {
        frames.push(picture(flight, &mut recorder)?);
        recorder.finish()
    });
    let interrupted = flown?;
    logged.and(recorded)?;
    if interrupted { Err(Error::cancelled("flight")) } else { Ok(()) }
}

/// The step before which image number `n` is due: counted, not summed up.
fn due(n: u64, fps: f64, hz: f64) -> u64 {
    (n as f64 * hz / fps).round() as u64
}

fn picture(flight: &mut FlightApp, recorder: &mut Recorder) -> Result<FrameStats> {
    let begun = Instant::now();
    flight.frame();
    let ms = begun.elapsed().as_secs_f64() * 1e3;
    let Some(p) = flight.camera::<Picture>() else {
        return Err(Error::fault("recording", "there is no picture", "report it"));
    };
    recorder.add(&p.frame)?;
    Ok(FrameStats { ms, rays: p.work.rays, samples: p.work.samples, reused: p.work.reused })
}

/// What is said at the end of a flight, as the exit status wants it: nothing but `Ok` for a flight that arrived or whose
/// time is over.
///
/// # Errors
/// Status 4 where the operator was called, with the place and the reason.
pub fn outcome(flight: &FlightApp) -> Result<()> {
    let f = flight.flight();
    if f.state != State::Operator {
        return Ok(());
    }
    Err(Error::incomplete(
        format!("flight stopped at {} after {:.0} mm", triple(f.place), f.length_mm),
        f.reason,
        "fly it by hand, or start anew with --from X,Y,Z",
    ))
}

/// What is said of segments that were not flown: "2 more: 280 ml, 180 ml".
pub fn unflown_text(flight: &FlightApp) -> Option<String> {
    let rest = flight.unflown();
    if rest.is_empty() {
        return None;
    }
    let list: Vec<String> = rest.iter().map(|(_, ml)| format!("{ml:.0} ml")).collect();
    Some(format!("{} more: {}", rest.len(), list.join(", ")))
}
