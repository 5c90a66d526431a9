//! Flies without a screen: the same schedules, as fast as they run.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use crate::app::FlightApp;
use crate::app::plan::triple;
use crate::components::flight::State;
use crate::components::output::Picture;
use crate::error::{Error, Result};
use crate::host::record::Recorder;
use crate::output::{Whole, cannot};
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
/// state tells which.
///
/// # Errors
/// Status 5 when an output cannot be written; status 4 when interrupted. What was logged and recorded until then is
/// there, whole.
pub fn fly(
    flight: &mut FlightApp,
    seconds: f64,
    outputs: &Outputs,
    progress: &Arc<Progress>,
) -> Result<Vec<FrameStats>> {
    let mut log = outputs.log.as_deref().map(Whole::create).transpose()?;
    let size = flight.camera::<Picture>().map(|p| (p.frame.width(), p.frame.height()));
    let mut recorder = match (&outputs.record, size) {
        (Some(out), Some(size)) => Some(Recorder::create(out, size, outputs.shown_fps.unwrap_or(outputs.fps))?),
        _ => None,
    };
    let hz = f64::from(flight.clock().hz);
    let steps = (seconds * hz).round().min(1e15) as u64;
    let expected = (flight.plan().length_mm / flight.scene().tentacles.cruise_mm_s * hz * 1.3) as u64;
    progress.stage("flying", steps.min(expected.max(1)));
    let mut frames = Vec::new();
    let mut pending = Vec::new();
    let mut interrupted = false;
    for tick in 0..steps {
        if recorder.is_some() && due(frames.len() as u64, outputs.fps, hz) <= tick {
            frames.push(picture(flight, recorder.as_mut())?);
        }
        flight.step()?;
        if tick + 1 == steps {
            flight.end();
        }
        // The last line carries the final state, so a step is written out when the next one is there.
        let mut lines = flight.take_log();
        pending.append(&mut lines);
        if pending.len() > 1 {
            let keep = pending.split_off(pending.len() - 1);
            write_lines(log.as_mut(), &pending, outputs)?;
            pending = keep;
        }
        interrupted = progress.advance(1).is_err();
        if flight.flight().state != State::Flying || interrupted {
            break;
        }
    }
    if recorder.is_some() {
        frames.push(picture(flight, recorder.as_mut())?);
    }
    if let Some(last) = pending.last_mut() {
        last.state = flight.flight().state;
    }
    write_lines(log.as_mut(), &pending, outputs)?;
    log.map_or(Ok(()), Whole::finish)?;
    recorder.map_or(Ok(()), Recorder::finish)?;
    if interrupted { Err(Error::cancelled("flight")) } else { Ok(frames) }
}

/// The step before which image number `n` is due: counted, not summed up.
fn due(n: u64, fps: f64, hz: f64) -> u64 {
    (n as f64 * hz / fps).round() as u64
}

fn picture(flight: &mut FlightApp, recorder: Option<&mut Recorder>) -> Result<FrameStats> {
    let begun = Instant::now();
    flight.frame();
    let ms = begun.elapsed().as_secs_f64() * 1e3;
    let Some(p) = flight.camera::<Picture>() else {
        return Err(Error::fault("recording", "there is no picture", "report it"));
    };
    if let Some(r) = recorder {
        r.add(&p.frame)?;
    }
    Ok(FrameStats { ms, rays: p.work.rays, samples: p.work.samples, reused: p.work.reused })
}

fn write_lines(log: Option<&mut Whole>, lines: &[crate::components::output::LogLine], outputs: &Outputs) -> Result<()> {
    let (Some(file), Some(path)) = (log, &outputs.log) else { return Ok(()) };
    for line in lines {
        serde_json::to_writer(&mut *file, line)
            .map_err(std::io::Error::from)
            .and_then(|()| file.write_all(b"\n"))
            .map_err(|e| cannot(path, &e))?;
    }
    Ok(())
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
