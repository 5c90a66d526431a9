//! The scan that is open or being opened, with all that belongs to it alone. Another scan replaces it whole.

use std::path::PathBuf;
use std::sync::Arc;

use winit::event_loop::EventLoopProxy;

use super::Wake;
use crate::components::slices::Orientation;
use crate::error::{Error, Result, program_name};
use crate::host::log::Log;
use crate::host::window::assistant::Assistant;
use crate::host::window::contract::{Beside, Other, WindowView, scan_name};
use crate::host::window::controller::FlightController;
use crate::host::window::framebuffer::Framebuffer;
use crate::host::window::interface::WindowSize;
use crate::host::window::keeping::Keeping;
use crate::host::window::loading::{Loading, Prepare, Unflown};
use crate::host::window::overlay::Content;
use crate::host::window::photograph::Views;
use crate::host::window::present_timer::PresentTimer;
use crate::host::window::{Finish, Opening, Resume, Shown};
use crate::output;
use crate::progress::Progress;
use crate::render::{Frame, ImageSize};

/// What becomes of a scan.
pub(super) enum Stage {
    Loading(Loading),
    Failed(Error),
    Flying(Box<FlightController>),
    /// Nothing is shown any more.
    Over,
}

/// Where a scan is shown in the window.
#[derive(Default)]
pub(super) struct Placed {
    /// The content, that of the other position and the window size of the last layout. A new layout is needed if they differ.
    pub laid_out: Option<(Content, Option<Content>, WindowSize)>,
    /// Rectangle of the flight's picture in the window, pixels: left, top, width, height.
    pub flight_at: [usize; 4],
    /// The same for pictures beside it.
    pub beside_at: Vec<(Beside, [usize; 4])>,
    /// The same for the slices.
    pub slices_at: Vec<(Orientation, [usize; 4])>,
    /// All of them, in points.
    pub views: Views,
    /// Serial number of the displayed layout.
    pub painted: Option<u64>,
    pub presented: PresentTimer,
}

impl Placed {
    /// Returns the size of the picture of the other position, pixels.
    pub(super) fn other(&self) -> ImageSize {
        let at = self.beside_at.iter().find(|b| b.0 == Beside::Other);
        at.map_or(ImageSize::default(), |(_, [.., width, height])| ImageSize::new(*width, *height))
    }

    /// Returns the size of the colon laid flat, pixels; `None` if it is not shown.
    pub(super) fn flat(&self) -> Option<ImageSize> {
        let at = self.beside_at.iter().find(|b| b.0 == Beside::Flat)?;
        Some(ImageSize::new(at.1[2], at.1[3]))
    }

    /// Returns the slices of the other position, with their sizes, pixels.
    pub(super) fn other_slices(&self) -> Vec<(Orientation, [usize; 2])> {
        let slice = |(which, [.., width, height]): &(Beside, [usize; 4])| match which {
            Beside::OtherSlice(orientation) => Some((*orientation, [*width, *height])),
            Beside::Other | Beside::Flat => None,
        };
        self.beside_at.iter().filter_map(slice).collect()
    }
}

/// The scan that is open or being opened.
pub(super) struct OpenScan {
    pub stage: Stage,
    /// Its path; `None` for the embedded phantom.
    pub input: Option<PathBuf>,
    /// The number of the series that was asked for.
    pub series: Option<usize>,
    /// True if this is the scan that the window was opened with.
    pub is_first: bool,
    /// True if it is the patient's second position, beside the one that was opened first.
    pub is_second: bool,
    /// Set while it is shown although it cannot be flown.
    pub unflown: Option<Unflown>,
    pub resume: Resume,
    /// What is kept of it.
    pub keeping: Option<Keeping>,
    pub log_path: Option<PathBuf>,
    pub log: Option<Log>,
    /// Simulated seconds after which the window closes.
    pub seconds: Option<f64>,
    pub finish: Option<Finish>,
    /// Closing a scan while it loads cancels the loading, not the program. A cancelled progress stays cancelled.
    pub progress: Arc<Progress>,
    pub placed: Placed,
}

impl OpenScan {
    /// Starts to load a scan.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start a thread.
    pub(super) fn load(opening: Opening, is_first: bool, proxy: &EventLoopProxy<Wake>) -> Result<Self> {
        let progress = Arc::new(Progress::new());
        Ok(Self {
            stage: Stage::Loading(begin(opening.prepare, &progress, proxy)?),
            input: opening.input,
            series: opening.series,
            is_first,
            is_second: false,
            unflown: None,
            resume: opening.resume,
            keeping: None,
            log_path: opening.log,
            log: None,
            seconds: opening.seconds,
            finish: Some(opening.finish),
            progress,
            placed: Placed::default(),
        })
    }

    /// Loads the same scan in another way, after it was shown without a flight. What was kept of it is returned.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start a thread.
    pub(super) fn load_again(&mut self, prepare: Prepare, proxy: &EventLoopProxy<Wake>) -> Result<()> {
        (self.progress, self.placed) = (Arc::new(Progress::new()), Placed::default());
        self.stage = Stage::Loading(begin(prepare, &self.progress, proxy)?);
        if self.resume.keeps() {
            self.resume = Resume::Nothing;
        }
        Ok(())
    }

    /// Returns why the scan that the window was opened with was not opened or never flown. Errors of scans that were opened in the
    /// window were shown there.
    ///
    /// # Errors
    /// Returns that reason.
    pub(super) fn unopened(&self) -> Result<()> {
        match (&self.stage, &self.unflown) {
            _ if !self.is_first => Ok(()),
            (Stage::Failed(e), _) => Err(e.clone()),
            (Stage::Loading(_), _) => Err(Error::cancelled("loading")),
            (Stage::Flying(_), Some(unflown)) => Err(unflown.why.clone()),
            (Stage::Flying(_) | Stage::Over, _) => Ok(()),
        }
    }

    /// Closes it and writes the outputs of its flight. The window's pixels return to `framebuffer`.
    ///
    /// # Errors
    /// Returns the first error.
    pub(super) fn close(&mut self, framebuffer: &mut Option<Framebuffer>) -> Result<()> {
        let stage = std::mem::replace(&mut self.stage, Stage::Over);
        match stage {
            Stage::Flying(mut controller) => {
                controller.save_the_rest();
                if let Err(e) = controller.keep_quality() {
                    output::to_stderr(format_args!("note: the times of this reading were not saved: {e}"));
                }
                *framebuffer = controller.flight_mut().views().take_presenter();
                if self.unflown.take().is_some() {
                    return Ok(());
                }
                let flight = controller.flight();
                let logged = self.log.take().map_or(Ok(()), |l| l.finish(flight.flight().state));
                if let Some(keeping) = &self.keeping {
                    keeping.close(flight);
                }
                let shown = Shown {
                    present_ms: self.placed.presented.summary(),
                    moving: controller.moving(),
                    cleansing: controller.cleansing().took(),
                    assistant: controller.assistant().and_then(Assistant::took),
                };
                let finished = self.finish.take().map_or(Ok(()), |f| f(flight, controller.frames(), &shown));
                logged.and(finished)
            }
            // Closed while loading: the worker stops without leaving anything behind.
            Stage::Loading(_) | Stage::Failed(_) | Stage::Over => {
                self.progress.cancel();
                Ok(())
            }
        }
    }

    /// Returns it for panels, as the position that is not worked in.
    pub(super) fn beside<'a>(&'a self, content: &'a Content) -> Other<'a> {
        let view = match &self.stage {
            Stage::Flying(c) => Some(&**c as &dyn WindowView),
            Stage::Loading(_) | Stage::Failed(_) | Stage::Over => None,
        };
        let opened = self.input.as_deref().map(|path| (path, self.series));
        Other { content, view, opened, is_first: !self.is_second }
    }

    /// Returns a picture of it, as the position that is not worked in.
    pub(super) fn picture(&self, which: Beside) -> Option<&Frame> {
        let Stage::Flying(c) = &self.stage else { return None };
        match which {
            Beside::Other => c.image(),
            Beside::Flat => None,
            Beside::OtherSlice(orientation) => c.slices().view(c.flight(), orientation).map(|view| &view.frame),
        }
    }

    /// Returns the title of the window: the scan, and the program.
    pub(super) fn title(&self) -> String {
        let program = match program_name() {
            "colvis" => "colvis".to_owned(),
            // Another program's window is known by the engine's name, too.
            own => format!("{own} (colvis)"),
        };
        format!("{} - {program}", scan_name(self.input.as_deref().map(|path| (path, self.series))))
    }

    /// True if the flight's time is over.
    pub(super) fn time_is_over(&mut self) -> bool {
        match (&mut self.stage, self.seconds) {
            (Stage::Flying(c), Some(s)) if c.flight().clock().seconds() >= s => {
                c.flight_mut().end();
                true
            }
            _ => false,
        }
    }
}

/// Starts the preparation of a flight.
fn begin(prepare: Prepare, progress: &Arc<Progress>, proxy: &EventLoopProxy<Wake>) -> Result<Loading> {
    let done = proxy.clone();
    Loading::start(prepare, progress, move || {
        // The window may be closed, and then nothing has to be woken.
        let _ = done.send_event(Wake::Loaded);
    })
}
