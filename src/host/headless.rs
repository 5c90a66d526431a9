//! Headless flights: the same schedules as in a window, run as fast as possible.

use std::path::PathBuf;
use std::sync::Arc;

use crate::app::overlay::Mark;
use crate::app::overlays::coats;
use crate::app::plan::triple;
use crate::app::{Canvas, FlightApp, Overlay};
use crate::components::clock::Clock;
use crate::components::flight::State;
use crate::components::output::Picture;
use crate::error::{Error, Kind, Result};
use crate::host::frames::FrameStats;
use crate::host::log::Log;
use crate::host::record::{Recorder, Recording};
use crate::progress::Progress;
use crate::schedule::{Slot, at_home};
use crate::systems::present;

/// Outputs of a headless flight.
#[derive(Clone, Debug, Default)]
pub struct Outputs {
    /// Destination of images.
    pub record: Option<String>,
    /// Images per simulated second.
    pub fps: f64,
    /// Playback rate of the recording, images per second; `fps` if `None`.
    pub shown_fps: Option<f64>,
    /// Destination of the log.
    pub log: Option<PathBuf>,
    /// Overlays drawn over recorded images. Without the feature `window` they are not drawn.
    pub overlays: Vec<Overlay>,
}

/// Called when a flight has ended: returns the simulated seconds for which it continues, or `None` if it is over.
pub type Onward<'a> = &'a mut dyn FnMut(&mut FlightApp) -> Result<Option<f64>>;

/// Same as [`fly_on`], but stops when the flight ends.
///
/// # Errors
/// As [`fly_on`].
pub fn fly(
    flight: &mut FlightApp,
    seconds: f64,
    outputs: &Outputs,
    progress: &Arc<Progress>,
) -> (Vec<FrameStats>, Result<()>) {
    fly_on(flight, seconds, outputs, progress, &mut |_| Ok(None))
}

/// Flies until the flight arrives, calls the operator, or `seconds` of simulated time (at least one step) have passed. The state of
/// the flight distinguishes these. Then continues for as long as `onward` says, into the same log and recording. Returns the frames
/// rendered so far together with the result.
///
/// # Errors
/// Returns status 5 if an output cannot be written, status 4 if interrupted, and the error of a replayed command that is refused.
/// Log and recording are complete up to that point.
pub fn fly_on(
    flight: &mut FlightApp,
    seconds: f64,
    outputs: &Outputs,
    progress: &Arc<Progress>,
    onward: Onward,
) -> (Vec<FrameStats>, Result<()>) {
    let log = outputs.log.as_deref().map(Log::create).transpose();
    let (log, recorder) = match log.and_then(|log| Ok((log, recorder(flight, outputs)?))) {
        Ok(both) => both,
        Err(e) => return (Vec::new(), Err(e)),
    };
    let fps = recorder.as_ref().map(|_| outputs.fps);
    if let Some(recorder) = recorder {
        let camera = flight.app().camera_id();
        if let Err(e) = flight.views().present_to(camera, Recording::new(recorder)) {
            return (Vec::new(), Err(e));
        }
    }
    for overlay in &outputs.overlays {
        let known = if overlay.name == coats::OVERLAY.name { flight.find_coats() } else { Ok(()) };
        if let Err(e) = known.and_then(|()| overlay.switch(flight, Some(0))) {
            return (Vec::new(), Err(e));
        }
    }
    let flown = fly_steps(flight, seconds, (log, fps, &outputs.overlays), progress, onward);
    let camera = flight.app().camera_id();
    let recording = present::take::<Recording>(flight.app_mut(), camera);
    let (frames, recorded) = recording.map_or((Vec::new(), Ok(())), Recording::finish);
    // An interruption is reported last, as an output that could not be written is more severe.
    let outcome = flown.and_then(|interrupted| recorded.map(|()| interrupted));
    (frames, outcome.and_then(|interrupted| if interrupted { Err(Error::cancelled("flight")) } else { Ok(()) }))
}

/// Creates the requested recorder, if the flight has pictures.
fn recorder(flight: &FlightApp, outputs: &Outputs) -> Result<Option<Recorder>> {
    let Some(out) = &outputs.record else { return Ok(None) };
    let size = flight
        .camera::<Picture>()
        .map(|p| p.frame.size())
        .ok_or_else(|| without_image(flight, "recording", "record"))?;
    Recorder::create(out, size, outputs.shown_fps.unwrap_or(outputs.fps)).map(Some)
}

/// The error for `what`, a recording or a window, whose flight has made no image to `use_it`.
pub(crate) fn without_image(flight: &FlightApp, what: &str, use_it: &str) -> Error {
    let inspector = flight.app().inspect();
    let mut who = inspector.own_systems_that_write::<Picture>();
    who.extend(inspector.own_fill(Slot::Renderer).map(|name| format!("the renderer {name}")));
    let who = if who.is_empty() { "the scene".to_owned() } else { who.join(" or ") };
    let why = format!("there is no image to {use_it}: {who} makes none of what the camera sees");
    Error::fault(what, why, "let the scene render a picture, or record nothing")
}

/// Flies, logs, and records `fps` images per simulated second, if there are any. Returns true if interrupted. The log is complete
/// in any case.
fn fly_steps(
    flight: &mut FlightApp,
    seconds: f64,
    (mut log, fps, overlays): (Option<Log>, Option<f64>, &[Overlay]),
    progress: &Arc<Progress>,
    onward: Onward,
) -> Result<bool> {
    let hz = f64::from(flight.clock().hz);
    // Even the shortest flight has one step, and its log one line.
    let steps = |seconds: f64| (seconds * hz).round().clamp(1.0, 1e15) as u64;
    let mut images = 0;
    let mut tick = 0;
    let mut last = steps(seconds);
    let mut fly = || {
        loop {
            progress.stage("flying", (last - tick).min(expected_steps(flight).max(1)));
            while tick < last {
                if fps.is_some_and(|fps| due(images, fps, hz) <= tick) {
                    images += 1;
                    record(flight, overlays)?;
                }
                flight.step()?;
                tick += 1;
                if tick == last {
                    flight.end();
                }
                if let Some(log) = &mut log {
                    log.add(flight.take_log())?;
                }
                match progress.advance(1) {
                    Ok(()) => {}
                    Err(_) if progress.is_cancelled() => return Ok(true),
                    Err(e) => return Err(e),
                }
                if flight.flight().state != State::Flying {
                    break;
                }
            }
            match onward(flight)? {
                Some(seconds) => last = tick + steps(seconds),
                None => return Ok(false),
            }
        }
    };
    let flown: Result<bool> = fly();
    if let Err(e) = &flown
        && e.kind == Kind::Fault
    {
        flight.end_because(e);
    }
    // Finish the outputs however the flight ended: the log first, since a recording may hang on another program. A step that failed
    // was still executed and logged.
    let logged = log.map_or(Ok(()), |mut l| l.add(flight.take_log()).and_then(|()| l.finish(flight.flight().state)));
    let last = fps.map_or(Ok(()), |_| record(flight, overlays));
    let interrupted = flown?;
    logged.and(last)?;
    Ok(interrupted)
}

/// Estimates the number of steps for the whole path from the guide's cruise speed.
fn expected_steps(flight: &FlightApp) -> u64 {
    let Clock { hz, .. } = flight.clock();
    let cruise_mm_s = flight.setup().scene.cruise_mm_s();
    if cruise_mm_s > 0.0 {
        (flight.setup().plan.length_mm / cruise_mm_s * f64::from(hz) * 1.3) as u64
    } else {
        u64::MAX
    }
}

/// Returns the step before which image number `n` is due. It is computed from `n`, not accumulated.
fn due(n: u64, fps: f64, hz: f64) -> u64 {
    (n as f64 * hz / fps).round() as u64
}

/// Renders and records the image of the current pose.
fn record(flight: &mut FlightApp, overlays: &[Overlay]) -> Result<()> {
    let _home = at_home();
    let camera = flight.app().camera_id();
    // An overlay that panics loses its marks, but the image is recorded.
    let (marks, drawn) = match marks(flight, overlays) {
        Ok(marks) => (marks, Ok(())),
        Err(e) => (Vec::new(), Err(e)),
    };
    let before = present::presenter::<Recording>(flight.app_mut(), camera).map(|mut recording| recording.begin(marks));
    flight.frame()?;
    let recording = present::presenter::<Recording>(flight.app_mut(), camera);
    let (made, outcome) = recording.map_or((None, Ok(())), |mut r| (Some(r.images()), r.take_outcome()));
    outcome.and(drawn)?;
    if made.is_none() || made == before { Err(without_image(flight, "recording", "record")) } else { Ok(()) }
}

/// Returns the marks that overlays draw over the next image.
fn marks(flight: &FlightApp, overlays: &[Overlay]) -> Result<Vec<Mark>> {
    let Some(view) = flight.view().filter(|_| !overlays.is_empty()) else { return Ok(Vec::new()) };
    #[cfg(feature = "window")]
    let scale = crate::host::window::pixels_a_point(crate::render::ImageSize::new(view.width(), view.height()), 1.0);
    #[cfg(not(feature = "window"))]
    let scale = 1.0;
    let mut canvas = Canvas::at_scale(view, scale);
    overlays.iter().try_for_each(|overlay| canvas.draw(overlay, flight))?;
    Ok(canvas.into_marks())
}

/// Returns the outcome of a flight as an exit status: `Ok` for a flight that arrived or whose time is over.
///
/// # Errors
/// Returns status 4 if the operator was called, with the place and the reason.
pub fn outcome(flight: &FlightApp) -> Result<()> {
    let f = flight.flight();
    if f.state != State::Operator {
        return Ok(());
    }
    Err(Error::incomplete(
        format!("flight stopped at {} after {:.0} mm", triple(f.place), f.length_mm),
        f.reason,
        "fly it by hand, or start again with --from X,Y,Z",
    ))
}

/// Lists the segments that were not flown: "2 more: 280 ml, 180 ml".
pub fn unflown_text(flight: &FlightApp) -> Option<String> {
    let rest = flight.survey().unflown();
    if rest.is_empty() {
        return None;
    }
    let list: Vec<String> = rest.iter().map(|(_, ml)| format!("{ml:.0} ml")).collect();
    Some(format!("{} more: {}", rest.len(), list.join(", ")))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use image::AnimationDecoder;
    use image::codecs::gif::GifDecoder;

    use super::*;
    use crate::app::{ImageSettings, Plan, Scene};
    use crate::fields::Lumen;
    use crate::testing::Room;

    #[test]
    fn a_film_is_shown_at_the_rate_that_it_is_given() {
        let dir = tempfile::tempdir().unwrap();
        let film = dir.path().join("film.gif");
        let room = Room::new([10, 30, 10]);
        // Four images a second, unless it is to be shown at another rate.
        for (shown_fps, ms) in [(None, 250), (Some(12.5), 80)] {
            let volume = room.scan();
            let lumen = Arc::new(Lumen::none(volume.voxels().grid()));
            let image = ImageSettings { width: 12, height: 8, ..ImageSettings::default() };
            let scene = Scene { picture: true, image, ..Scene::guided_by("manual") };
            let plan = Plan::between(room.centre(), room.centre() + DVec3::Y * 10.0, 10.0);
            let mut flight = FlightApp::new(volume, lumen, plan, scene).unwrap();
            let record = Some(film.to_string_lossy().into_owned());
            let outputs = Outputs { record, fps: 4.0, shown_fps, ..Outputs::default() };
            let (frames, flown) = fly(&mut flight, 0.5, &outputs, &Arc::new(Progress::new()));
            flown.unwrap();
            let file = std::io::BufReader::new(std::fs::File::open(&film).unwrap());
            let images = GifDecoder::new(file).unwrap().into_frames().collect_frames().unwrap();
            // At the beginning, after a quarter of a second, and at the end.
            assert_eq!((images.len(), frames.len()), (3, 3));
            assert!(images.iter().all(|i| i.delay().numer_denom_ms() == (ms, 1)), "{shown_fps:?}");
        }
    }
}
