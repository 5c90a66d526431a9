//! The interactive window: a picture of the flight, keyboard and mouse input, and the interface around them.
//!
//! No other part of the program depends on winit, softbuffer or egui. The flight is the same [`FlightApp`] that flies without a
//! window. Operator input reaches it as [commands](crate::components::input::Command), so that it can be recorded and replayed.

mod action;
mod actions;
mod assistant;
mod background;
mod clean;
mod cleansing;
mod contract;
mod controller;
mod directions;
mod display;
mod document;
mod field_job;
mod figures;
mod finding_tool;
mod findings;
mod flat;
mod framebuffer;
mod framing;
mod intent;
mod interface;
mod job;
mod keeping;
mod key_list;
mod keys;
mod kinds;
mod last_words;
mod layer;
mod layouts;
mod loading;
mod looked;
mod measures;
mod moving;
mod overlay;
mod overlays;
mod own_action;
mod painter;
mod pairing;
pub mod panels;
mod photograph;
mod place;
mod placement;
#[doc(hidden)]
pub mod plane;
mod present_timer;
mod printed;
mod quality;
mod recent;
mod reporting;
mod screen;
mod screenshot;
mod screenshot_renderer;
mod seen;
mod session;
mod sheet;
mod shell;
mod shown;
mod slices;
mod stroke;
mod style;
mod toolbar;
mod travel;
mod unflown;
mod view_renderer;
mod workspace;
#[cfg_attr(not(all(unix, not(target_os = "macos"))), path = "no_x11.rs")]
mod x11;

use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use crate::app::{FlightApp, Overlay};
use crate::error::{Error, Result};
use crate::host::frames::FrameStats;
use crate::host::settings::{self, KeySettings, Settings};
use crate::panics;
use crate::polyps::Detector;
use crate::progress::Progress;
use crate::render::ImageSize;
use crate::schedule::Guides;
use action::Actions;
#[doc(hidden)]
pub use assistant::Took as AssistantTook;
#[doc(hidden)]
pub use cleansing::Took as CleansingTook;
#[doc(hidden)]
pub use display::Display;
#[doc(hidden)]
pub use layouts::slices_of;
pub use loading::{Prepare, Ready, SessionFile, Unflown};
#[doc(hidden)]
pub use moving::{Interval, Moving, Pictures, Side};
pub(crate) use painter::{Marker, pixels_a_point};
use panels::{ActionEntry, PanelEntry};
#[doc(hidden)]
pub use present_timer::PresentMs;
#[doc(hidden)]
pub use reporting::{MakeReport, ReportOrder};
use shell::{Shell, Wake};

/// Returns all default keys of the window with their descriptions, in the order of its help. The user's settings file is not
/// applied.
///
/// # Errors
/// Returns status 2 if two actions share a key.
#[doc(hidden)]
pub fn key_help(
    guides: &Guides,
    overlays: &[Overlay],
    panels: &[PanelEntry],
    more: &[ActionEntry],
) -> Result<Vec<(String, String)>> {
    Ok(Actions::of(guides, overlays, panels, more, &KeySettings::new())?.help())
}

/// Returns id, keys and text of every action of the window, with the keys of the user's settings file, and the error in that file.
///
/// # Errors
/// Returns status 2 if two actions share a key without any settings.
#[doc(hidden)]
pub fn action_list(
    guides: &Guides,
    overlays: &[Overlay],
    panels: &[PanelEntry],
    more: &[ActionEntry],
) -> Result<(Vec<[String; 3]>, Option<Error>)> {
    actions(guides, overlays, panels, more).map(|(actions, unsettled)| (actions.list(), unsettled))
}

/// Returns all default keys of the window as text, in the groups of its list. The user's settings file is not applied.
///
/// # Errors
/// Returns status 2 if two actions share a key.
#[doc(hidden)]
pub fn key_page(guides: &Guides, overlays: &[Overlay], panels: &[PanelEntry], more: &[ActionEntry]) -> Result<String> {
    let groups = Actions::of(guides, overlays, panels, more, &KeySettings::new())?.groups();
    let wide = groups.iter().flat_map(|g| &g.rows).map(|r| r.keys.chars().count()).max().unwrap_or(0);
    let group = |g: &key_list::Group| {
        let rows = g.rows.iter().map(|r| format!("  {:wide$}  {}\n", r.keys, r.text));
        format!("{}\n{}", g.title, rows.collect::<String>())
    };
    Ok(groups.iter().map(group).collect::<Vec<_>>().join("\n"))
}

/// True if the user's settings open every scan with one flight through the whole colon.
#[doc(hidden)]
pub fn opens_whole() -> bool {
    settings::opens() == settings::Opens::Whole
}

/// Returns the path of the user's window settings, if the system defines a folder for them.
#[doc(hidden)]
pub fn settings_file() -> Option<PathBuf> {
    settings::file()
}

/// Creates the actions of a window with the keys of the user's settings file. If that is damaged or its keys collide, prints a
/// note and uses the default keys.
///
/// # Errors
/// Returns status 2 if two actions share a key without any settings.
fn actions(
    guides: &Guides,
    overlays: &[Overlay],
    panels: &[PanelEntry],
    more: &[ActionEntry],
) -> Result<(Actions, Option<Error>)> {
    let usual = Actions::of(guides, overlays, panels, more, &KeySettings::new())?;
    let Some(file) = settings::file() else { return Ok((usual, None)) };
    let chosen = Settings::read(&file).and_then(|settings| match settings {
        Some(settings) => Actions::of(guides, overlays, panels, more, &settings.keys)
            .map(Some)
            .map_err(|e| e.named(|what| format!("{}: {what}", file.display()))),
        None => Ok(None),
    });
    Ok(match chosen {
        Ok(chosen) => (chosen.unwrap_or(usual), None),
        Err(e) => (usual, Some(e)),
    })
}

/// Time between two checks for an interrupt.
const INTERRUPT: Duration = Duration::from_millis(50);

/// Called with a flight, the statistics of its images, and how they were shown.
pub(crate) type Finish = Box<dyn FnOnce(&FlightApp, &[FrameStats], &Shown) -> Result<()>>;

/// How a window showed its pictures, for the statistics. Parts that did not happen are omitted.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
#[doc(hidden)]
pub struct Shown {
    /// From the finished image to the presented one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub present_ms: Option<PresentMs>,
    /// Pictures while the camera moved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moving: Option<Moving>,
    /// The scan without tag beside the one as it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cleansing: Option<cleansing::Took>,
    /// The search for polyps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub assistant: Option<assistant::Took>,
}

/// What a reader asks to be opened.
#[derive(Clone, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct Asked {
    /// Path of the scan; `None` for the embedded phantom.
    pub input: Option<PathBuf>,
    /// A series in a folder that holds several.
    pub series: Option<usize>,
    /// True if a scan is flown already: the files that were asked for are its own.
    pub is_flying: bool,
    /// One flight through the whole colon, from the rectum along the centerline, cleansed; otherwise the flight that the
    /// command line asks for.
    pub is_whole: bool,
    /// Beside which scan, and which of its series, it is opened as the same patient's other position.
    pub beside: Option<(PathBuf, Option<usize>)>,
}

/// A scan to open in a window.
#[doc(hidden)]
pub struct Opening {
    /// Path of the scan; `None` for the embedded phantom.
    pub input: Option<PathBuf>,
    /// The number of the series that was asked for, in a folder that holds several.
    pub series: Option<usize>,
    /// Creates the flight. Called on another thread while the window shows the progress.
    pub prepare: Prepare,
    /// Called when the scan is closed, after the log has been written.
    pub finish: Finish,
    /// State to restore from the last time that this scan was open.
    pub resume: Resume,
    /// Destination of the log.
    pub log: Option<PathBuf>,
    /// Simulated seconds after which the window closes.
    pub seconds: Option<f64>,
}

/// Content and configuration of a window.
#[doc(hidden)]
pub struct Launch {
    /// The scan to open first.
    pub first: Opening,
    /// The same patient in another position, to be read with it.
    pub second: Option<Asked>,
    /// Opens another scan, or the same in another way.
    pub open: Box<dyn Fn(Asked) -> Result<Opening>>,
    /// Size of the window in pixels; a default size if `None`.
    pub size: Option<ImageSize>,
    /// Overlays available for the picture.
    pub overlays: Vec<Overlay>,
    /// Guides that the operator can switch to: those of the flight's scene.
    pub guides: Guides,
    /// The method that finds polyps.
    pub detector: Detector,
    /// Available panels.
    pub panels: Vec<PanelEntry>,
    /// Actions of other crates.
    pub actions: Vec<ActionEntry>,
    /// Makes the report of a reading.
    pub report: MakeReport,
    /// Layout of the panels; the last used one if `None`.
    pub layout: Option<String>,
}

/// State to restore from the last time that a scan was open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Resume {
    /// Position, speed and guide.
    Everything,
    /// Position and speed: the guide was selected on the command line.
    Place,
    /// Nothing, but the position is stored for the next time.
    Nothing,
    /// Nothing, and nothing is stored: a flight that repeats another, or that will be repeated.
    Never,
}

impl Resume {
    /// True if answers, distances and the place are stored for the next time.
    fn keeps(self) -> bool {
        self != Self::Never
    }
}

/// Opens a window and flies until it is closed.
///
/// # Errors
/// Returns the error of the preparation, the outputs or `finish`, and status 4 if interrupted or cancelled while loading. Outputs
/// are complete in any case.
#[doc(hidden)]
pub fn run(display: Display, launch: Launch, progress: &Arc<Progress>) -> Result<()> {
    let proxy = display.0.create_proxy();
    let (interrupted, wake) = (Arc::clone(progress), proxy.clone());
    // The event loop sleeps while nothing happens, so a separate thread checks. It ends with the program.
    let watcher = std::thread::Builder::new().name("interrupt".to_owned()).spawn(move || {
        while !interrupted.is_cancelled() {
            std::thread::sleep(INTERRUPT);
        }
        // The window may be closed, and then nothing has to be woken.
        let _ = wake.send_event(Wake::Interrupted);
    });
    watcher.map_err(|e| Error::fault("window", e.to_string(), "close other programs"))?;
    let shell = last_words::keep(Shell::new(launch, proxy)?);
    let looped = panics::catch(|| display.0.run_app(&mut last_words::Handler(Rc::clone(&shell))));
    // Logs and other outputs first: they must be complete even if the display disconnected, or something panicked.
    let ended = panics::catch(|| last_words::take(&shell).map_or(Ok(()), Shell::end));
    let fault = |why: String| Error::fault("window", format!("panicked: {why}"), "report it, or use --headless");
    // winit panics or returns an error then.
    if !matches!(looped, Ok(Ok(()))) && x11::is_display_lost() {
        ended.map_err(fault)??;
        return Err(screen::display_lost());
    }
    let looped = looped.map_err(fault)?;
    ended.map_err(fault)??;
    looped.map_err(|e| Error::fault("window", e.to_string(), "use --headless"))
}
