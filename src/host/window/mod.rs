//! The interactive window: a picture of the flight, the operator's keys and mouse, and what there is to say.
//!
//! Nothing else in the program knows of winit, softbuffer or egui. The flight is the same [`FlightApp`] that flies without
//! a window: what the operator does reaches it as [commands](crate::components::input::Command), so that it can be kept
//! and repeated.

mod actions;
mod controller;
mod directions;
mod field_job;
mod figures;
mod folders;
mod framebuffer;
mod interface;
mod job;
mod keys;
mod layer;
mod loading;
mod measures;
mod moving;
mod overlay;
mod overlays;
mod painter;
pub mod panels;
pub mod plane;
mod present_timer;
mod recent;
mod screen;
mod screenshot;
mod screenshot_renderer;
mod session;
mod settings;
mod shell;
mod slices;
mod travel;
mod view_renderer;
mod workspace;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use winit::event_loop::EventLoop;

use crate::app::{FlightApp, Overlay};
use crate::error::{Error, Result};
use crate::host::frames::FrameStats;
use crate::panics::catch_panic;
use crate::progress::Progress;
use crate::schedule::Guides;
use actions::{Actions, KeySettings};
pub use loading::{Prepare, Ready, SessionFile};
pub use moving::{Interval, Moving, Side};
pub use painter::{Marker, pixels_a_point};
use panels::PanelEntry;
pub use present_timer::PresentMs;
use settings::Settings;
use shell::{Shell, Wake};
pub use workspace::slices_of;

/// All keys of the window with what they do, in the order in which its help shows them, as they are without a settings file.
///
/// # Errors
/// Status 2 where two actions have one key.
pub fn key_help(guides: &Guides, overlays: &[Overlay], panels: &[PanelEntry]) -> Result<Vec<(String, String)>> {
    Ok(Actions::new(guides, overlays, panels, &KeySettings::new())?.help())
}

/// The user's settings of the window, where there is a folder for them.
pub fn settings_file() -> Option<PathBuf> {
    settings::file()
}

/// The actions of a window with the keys that the user's settings file has for them. Where it is damaged, or its keys collide, a line
/// says so, and the window has the keys that it comes with.
///
/// # Errors
/// Status 2 where two actions have one key without any settings.
fn actions(guides: &Guides, overlays: &[Overlay], panels: &[PanelEntry]) -> Result<(Actions, Option<Error>)> {
    let usual = Actions::new(guides, overlays, panels, &KeySettings::new())?;
    let Some(file) = settings::file() else { return Ok((usual, None)) };
    let chosen = Settings::read(&file).and_then(|settings| match settings {
        Some(settings) => Actions::new(guides, overlays, panels, &settings.keys)
            .map(Some)
            .map_err(|e| Error { what: format!("{}: {}", file.display(), e.what), ..e }),
        None => Ok(None),
    });
    Ok(match chosen {
        Ok(chosen) => (chosen.unwrap_or(usual), None),
        Err(e) => (usual, Some(e)),
    })
}

/// How often an interrupt is looked for.
const INTERRUPT: Duration = Duration::from_millis(50);

/// Called with a flight, what its images took, and how they were shown.
pub type Finish = Box<dyn FnOnce(&FlightApp, &[FrameStats], &Shown) -> Result<()>>;

/// How a window showed its pictures, for the stats; parts that did not happen are left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Shown {
    /// From the finished image to the presented one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub present_ms: Option<PresentMs>,
    /// Pictures while the camera moved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moving: Option<Moving>,
}

/// A scan that a window is to show.
pub struct Opening {
    /// Where it is; none for the embedded phantom.
    pub input: Option<PathBuf>,
    /// Makes the flight; called on another thread while the window shows how far it has come.
    pub prepare: Prepare,
    /// Called when the scan is closed, after the log was written.
    pub finish: Finish,
    /// What is taken up from the last time that this scan was open.
    pub resume: Resume,
    /// Where steps are logged.
    pub log: Option<PathBuf>,
    /// The window closes after so many simulated seconds.
    pub seconds: Option<f64>,
}

/// What a window is to show.
pub struct Launch {
    /// The scan that it opens with.
    pub first: Opening,
    /// Opens another one; of a folder that holds several series, the one of this number.
    pub open: Box<dyn Fn(PathBuf, Option<usize>) -> Result<Opening>>,
    /// Size of the window in pixels; a usual one if none.
    pub size: Option<(usize, usize)>,
    /// What can be drawn over the picture.
    pub overlays: Vec<Overlay>,
    /// The guides that can be handed over to: those of the flight's scene.
    pub guides: Guides,
    /// The panels that can be shown.
    pub panels: Vec<PanelEntry>,
    /// The layout of the panels; the last one if none.
    pub layout: Option<String>,
}

/// What is taken up from the last time that a scan was open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resume {
    /// Place, speed and guide.
    Everything,
    /// Place and speed: the guide was chosen on the command line.
    Place,
    /// Nothing, but the place is kept for the next time.
    Nothing,
    /// Nothing, and nothing is kept either: a flight that repeats another, or that is to be repeated.
    Never,
}

/// A display on which a window can be opened.
pub struct Display(EventLoop<Wake>);

impl Display {
    /// The display of this session; none where there is none, or where it cannot be used. To be asked for once, on the
    /// program's first thread.
    pub fn open() -> Option<Self> {
        let set = |name: &str| std::env::var_os(name).is_some_and(|v| !v.is_empty());
        if cfg!(all(unix, not(target_os = "macos")))
            && !["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"].map(set).contains(&true)
        {
            return None;
        }
        // Where a system library or an extension of the X server is missing, winit panics instead of failing. There is
        // no display to use then, and the flight goes on without one.
        catch_panic(|| EventLoop::with_user_event().build().ok()).ok().flatten().map(Self)
    }
}

/// Opens a window and flies until it is closed.
///
/// # Errors
/// What the preparation, the outputs or `finish` fail with; status 4 when interrupted or cancelled while loading. Outputs
/// are whole in any case.
pub fn run(display: Display, launch: Launch, progress: &Arc<Progress>) -> Result<()> {
    let proxy = display.0.create_proxy();
    let (interrupted, wake) = (Arc::clone(progress), proxy.clone());
    // The event loop sleeps while nothing happens, so somebody else has to look. The thread ends with the program.
    let watcher = std::thread::Builder::new().name("interrupt".to_owned()).spawn(move || {
        while !interrupted.is_cancelled() {
            std::thread::sleep(INTERRUPT);
        }
        // There is nobody to wake when the window is gone.
        let _ = wake.send_event(Wake::Interrupted);
    });
    watcher.map_err(|e| Error::fault("window", e.to_string(), "close other programs"))?;
    let mut shell = Shell::new(launch, proxy)?;
    let looped = display.0.run_app(&mut shell);
    // Logs and the like first: they are to be whole even if the display went away.
    shell.end()?;
    looped.map_err(|e| Error::fault("window", e.to_string(), "use --headless"))
}
