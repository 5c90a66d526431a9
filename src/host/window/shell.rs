//! The window's event loop: receives the system's events and shows pictures.

mod open_scan;
mod opening;
mod photograph;
mod positions;
mod unflown;

use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::{LayerId, ViewportId};
use winit::application::ApplicationHandler;
use winit::event::{ElementState, KeyEvent, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::keyboard::{Key, ModifiersState};
use winit::window::{Fullscreen, Window, WindowId};

use super::action::{Action, Actions};
use super::background::Background;
use super::contract::{Beside, Context, Requests, WindowView, refuse_action};
use super::controller::FlightController;
use super::framebuffer::{Framebuffer, Places};
use super::intent::{ActionContext, Intent};
use super::interface::{Interface, WindowSize};
use super::keeping::{self, Keeping};
use super::keys::HeldKeys;
use super::loading::Ready;
use super::overlay::{self, Content};
use super::own_action::OwnActions;
use super::pairing::Pairing;
use super::panels::open::FileList;
use super::photograph::Views;
use super::placement::Placement;
use super::printed::Printed;
use super::recent::Recent;
use super::reporting::{MakeReport, Reported};
use super::sheet::{self, Sheet};
use super::stroke::{Pressed, Stroke};
use super::workspace::Workspace;
use super::{Asked, Launch, Opening, Resume};
use crate::app::{FlightApp, Overlay};
use crate::components::slices::Orientation;
use crate::error::{Error, Result};
#[cfg(feature = "dicom")]
use crate::host::archives;
use crate::host::log::Log;
use crate::host::settings;
use crate::output;
use crate::panics;
use crate::polyps::Detector;
use crate::render::ImageSize;
use crate::render::adaptive::FRAME;
use open_scan::{OpenScan, Stage};

/// Time between two pictures while loading.
const LOADING: Duration = Duration::from_millis(60);
/// Minimum time between two layouts of panels that show a moving flight.
const LAYOUTS: Duration = Duration::from_millis(30);
/// The window ends after more layouts in a row than this that have panicked.
const MOST_PANICS: u32 = 5;

/// Events from other threads that wake the event loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wake {
    /// Loading has ended.
    Loaded,
    /// Work in the background is done.
    JobDone,
    /// The user interrupted the program.
    Interrupted,
}

/// The program as an application of the event loop.
pub(crate) struct Shell {
    /// The scan that is open or being opened; of two positions, the one that is worked in.
    scan: OpenScan,
    /// The patient's other position.
    other: Option<OpenScan>,
    /// What both positions have in common.
    pairing: Pairing,
    /// A second position that is opened once the first one is shown.
    second: Option<Asked>,
    window: Option<Rc<Window>>,
    /// The window's pixels, until a flight presents its pictures there.
    framebuffer: Option<Framebuffer>,
    laid_out_at: Option<Instant>,
    /// Number of layouts in a row in which something has panicked.
    panicked: u32,
    interface: Interface,
    /// Converts window events for the interface.
    input: Option<egui_winit::State>,
    /// True if an event has occurred that the interface may react to.
    touched: bool,
    workspace: Workspace,
    /// What covers the window.
    sheet: Option<Sheet>,
    /// The number of the layout that was left to show its slices.
    layout_before: Option<usize>,
    /// True if the latest layout is over the picture.
    settled: bool,
    /// Earliest time of the next picture.
    due: Instant,
    /// Scheduled start of the last picture.
    beat: Instant,
    /// True if the program itself requested the next picture.
    asked: bool,
    modifiers: ModifiersState,
    /// The keys that are held.
    pressed: Pressed,
    size: Option<ImageSize>,
    placement: Placement,
    /// That of the scan that was closed last, until the next one is open: it may be the same.
    left: Option<Keeping>,
    open: Box<dyn Fn(Asked) -> Result<Opening>>,
    report: MakeReport,
    recent: Recent,
    /// Shown in a window whose scan could not be opened.
    file_list: FileList,
    proxy: EventLoopProxy<Wake>,
    background: Background,
    overlays: Vec<Overlay>,
    detector: Detector,
    actions: Rc<Actions>,
    /// The actions of other crates.
    own: Rc<OwnActions>,
    /// What the keyboard prints.
    printed: Printed,
    /// The error in the settings file.
    unsettled: Option<Error>,
    outcome: Result<()>,
}

impl Shell {
    /// Starts to load the first scan.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start a thread.
    pub(crate) fn new(launch: Launch, proxy: EventLoopProxy<Wake>) -> Result<Self> {
        let (actions, unsettled) = super::actions(&launch.guides, &launch.overlays, &launch.panels, &launch.actions)?;
        let (workspace, unread) = Workspace::new(&launch.panels, launch.layout.as_deref(), Workspace::usual_file());
        let (recent, unlisted) = Recent::open(Recent::usual_file());
        let (placement, unplaced) = Placement::open(Placement::usual_file());
        let damaged: Vec<Error> = [unsettled, unread, unlisted, unplaced].into_iter().flatten().collect();
        for e in &damaged {
            output::to_stderr(format_args!("note: {e}"));
        }
        let unsettled = damaged.into_iter().next();
        let scan = OpenScan::load(launch.first, true, &proxy)?;
        let waker = proxy.clone();
        let background = Background::new(Arc::new(move || {
            // The window may be closed, and then nothing has to be woken.
            let _ = waker.send_event(Wake::JobDone);
        }));
        Ok(Self {
            scan,
            other: None,
            pairing: Pairing::new(Instant::now()),
            second: launch.second,
            window: None,
            framebuffer: None,
            laid_out_at: None,
            panicked: 0,
            interface: Interface::new(),
            input: None,
            touched: false,
            workspace,
            sheet: None,
            layout_before: None,
            settled: true,
            due: Instant::now(),
            beat: Instant::now(),
            asked: false,
            modifiers: ModifiersState::empty(),
            pressed: Pressed::default(),
            size: launch.size,
            placement,
            open: launch.open,
            report: launch.report,
            recent,
            file_list: FileList::default(),
            proxy,
            left: None,
            background,
            overlays: launch.overlays,
            detector: launch.detector,
            actions: Rc::new(actions),
            own: Rc::new(OwnActions::new(&launch.actions)),
            printed: Printed::default(),
            unsettled,
            outcome: Ok(()),
        })
    }

    /// Writes the outputs of the flight after the window is closed.
    ///
    /// # Errors
    /// Returns the first error.
    pub(crate) fn end(mut self) -> Result<()> {
        self.return_to_layout();
        if let Err(e) = self.workspace.keep() {
            output::to_stderr(format_args!("note: the layout was not saved: {e}"));
        }
        let unopened = self.scan.unopened().and(self.other.as_ref().map_or(Ok(()), OpenScan::unopened));
        let closed = self.close();
        // Last, since it asks the window system, which may have gone.
        self.keep_placement();
        self.outcome.and(unopened).and(closed)
    }

    /// Stores the size of the window for the next time, unless it was asked for.
    fn keep_placement(&self) {
        if let (Some(window), None) = (&self.window, self.size)
            && let Ok(Err(e)) = panics::catch(|| self.placement.keep(window))
        {
            output::to_stderr(format_args!("note: the size of the window was not saved: {e}"));
        }
    }

    /// Writes the outputs of the flight when the display is lost. What belongs to the window system is left as it is: to close it
    /// would ask that for something.
    ///
    /// # Errors
    /// Returns the first error.
    pub(crate) fn end_without_display(mut self) -> Result<()> {
        self.return_to_layout();
        if let Err(e) = self.workspace.keep() {
            output::to_stderr(format_args!("note: the layout was not saved: {e}"));
        }
        let closed = self.close();
        std::mem::forget(self);
        closed
    }

    /// Closes the open scan, with its other position, and writes the outputs of its flight.
    ///
    /// # Errors
    /// Returns the first error.
    fn close(&mut self) -> Result<()> {
        let closed = self.scan.close(&mut self.framebuffer);
        let other = self.other.take().map_or(Ok(()), |mut other| other.close(&mut None));
        self.left = self.scan.keeping.take().or(self.left.take());
        closed.and(other)
    }

    fn fail(&mut self, e: Error, events: &ActiveEventLoop) {
        if self.outcome.is_ok() {
            self.outcome = Err(e);
        }
        events.exit();
    }

    fn quit(&mut self, events: &ActiveEventLoop) {
        if matches!(self.scan.stage, Stage::Loading(_)) {
            self.scan.progress.cancel();
        }
        events.exit();
    }

    /// Returns the window's size; zero pixels if there is no window.
    fn window_size(&self) -> WindowSize {
        self.window.as_ref().map_or(WindowSize { pixels: ImageSize::default(), scale: 1.0 }, |window| {
            let size = window.inner_size();
            WindowSize {
                pixels: ImageSize::new(size.width as usize, size.height as usize),
                scale: window.scale_factor() as f32,
            }
        })
    }

    /// Returns the context of an action: the size of the flight's picture, at time `now`.
    fn moment(&self, now: Instant) -> ActionContext {
        ActionContext { window: ImageSize::new(self.scan.placed.flight_at[2], self.scan.placed.flight_at[3]), now }
    }

    /// Handles the end of loading: starts the flight, or shows the error.
    fn take_off(&mut self) -> Result<()> {
        let Stage::Loading(loading) = &mut self.scan.stage else { return Ok(()) };
        // The wake-up may come from an earlier loading that was cancelled for this one.
        let Some(loaded) = loading.take() else { return Ok(()) };
        self.scan.stage = Stage::Over;
        // It was held while the same scan was opened in another way.
        self.left = None;
        let Ready { mut flight, session, mut notes, unflown, is_whole, is_anew } = match loaded {
            Ok(ready) => ready,
            Err(e) if self.scan.progress.is_cancelled() => return Err(e),
            Err(e) => {
                self.scan.stage = Stage::Failed(e);
                return Ok(());
            }
        };
        if unflown.is_none() {
            self.scan.log = self.scan.log_path.as_deref().map(Log::create).transpose()?;
        }
        let is_guided = flight.setup().scene.guide().is_some();
        if is_anew && self.scan.resume == Resume::Everything {
            self.scan.resume = Resume::Nothing;
        }
        let mut keeping = Keeping::of(session, self.scan.resume, is_guided, Instant::now());
        keeping.reads_whole(is_whole);
        let along = keeping.resume(&mut flight, self.scan.resume);
        if let Some(framebuffer) = self.framebuffer.take() {
            let camera = flight.app().camera_id();
            flight.views().present_to(camera, framebuffer)?;
        }
        let overlays = self.overlays.clone();
        if let Some(scan) = &self.scan.input
            && let Err(e) = self.recent.opened(scan)
        {
            output::to_stderr(format_args!("note: the list of recent scans was not saved: {e}"));
        }
        let mut controller = self.controller(flight, overlays, &self.scan)?;
        if self.scan.seconds.is_some() {
            controller.limit_time();
        }
        keeping.equip(&mut controller);
        notes.extend(keeping.warning().inspect(|warning| output::to_stderr(format_args!("note: {warning}"))));
        self.scan.keeping = Some(keeping);
        if let Some(e) = self.unsettled.take() {
            controller.say(format!("{}: {}", e.what, e.why), Instant::now());
        } else if along.is_some() {
            let other = self.actions.hint("other-end", "starts from the other end");
            controller.say(format!("resumed where you left off{other}"), Instant::now());
        }
        match unflown {
            Some(unflown) => self.look(&mut controller, unflown, &mut notes),
            None => self.return_to_layout(),
        }
        self.workspace.warn(notes);
        // A window of a given size or time is that of a script.
        if self.placement.is_first() && self.size.is_none() && self.scan.seconds.is_none() && self.scan.is_first {
            self.sheet = Some(Sheet::Welcome);
            self.keep_placement();
        }
        self.scan.stage = Stage::Flying(Box::new(controller));
        Ok(())
    }

    /// Returns the controller of a scan's flight, with all that is the window's.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start threads.
    fn controller(&self, flight: FlightApp, overlays: Vec<Overlay>, scan: &OpenScan) -> Result<FlightController> {
        let (background, actions) = (self.background.clone(), Rc::clone(&self.actions));
        let mut controller = FlightController::new(flight, background, overlays, actions)?;
        controller.set_own(Rc::clone(&self.own));
        controller.set_detector(self.detector);
        #[cfg(feature = "dicom")]
        controller.set_archives(archives::known_or_told());
        let (make, series) = (Arc::clone(&self.report), scan.series);
        controller.set_reported(scan.input.clone().map(|input| Reported { make, input, series, second: None }));
        controller.set_screenshots(settings::screenshots());
        Ok(controller)
    }

    fn key(&mut self, event: &KeyEvent, events: &ActiveEventLoop) {
        let now = Instant::now();
        let pressed = event.state == ElementState::Pressed;
        // A button focused by Tab receives its keys, and an open menu the key that closes it.
        let egui = self.interface.egui();
        let widget = egui.egui_wants_keyboard_input() || egui::Popup::is_any_open(egui);
        let is_text = egui.text_edit_focused();
        if pressed && (is_text || widget && matches!(event.logical_key, Key::Named(_))) {
            // What no text field has a use for works with Ctrl while one is written in.
            let stroke = Stroke::of(event, self.modifiers, self.controls());
            let chord = stroke.chord(|c| self.actions.of_key(c).is_some());
            let action = chord.and_then(|c| self.actions.of_key(&c)).map(|a| a.id.as_ref());
            if !is_text || !self.controls() || !matches!(action, Some("quit" | "screenshot")) {
                return;
            }
        }
        // Ctrl-C and similar combinations are not handled here.
        let other = self.modifiers.intersects(ModifiersState::ALT | ModifiersState::SUPER) && !self.controls();
        if !pressed && let Some(hold) = self.pressed.release(event.physical_key) {
            if let Stage::Flying(c) = &mut self.scan.stage {
                c.steer(|held| held.release(hold), now);
            }
            return;
        }
        let stroke = Stroke::of(event, self.modifiers, self.controls());
        if pressed && self.printed.learn(&stroke) {
            self.name_keys();
        }
        let actions = Rc::clone(&self.actions);
        let Some(chord) = stroke.chord(|c| actions.of_key(c).is_some()) else { return };
        // A released key is always let go, whatever modifiers are held.
        let action = actions.of_key(&chord).or_else(|| actions.of_key(&chord.plain()).filter(|_| !pressed));
        let Some(action) = action.filter(|_| !pressed || !other) else { return };
        // A sheet covers everything that other keys would change unseen.
        let is_of_sheet = |a: &Action| matches!(a.intent, Intent::Cancel | Intent::Help | Intent::Quit);
        if pressed && !is_of_sheet(action) {
            match self.sheet {
                Some(ref sheet) if sheet.is_closed_by(&chord) => return self.close_sheet(),
                // Whoever knows the keys needs no welcome.
                Some(Sheet::Welcome) => self.close_sheet(),
                Some(_) => return,
                None => {}
            }
        }
        let once = pressed && (action.repeats || !event.repeat);
        match (&action.intent, &mut self.scan.stage) {
            (&Intent::Hold(hold), Stage::Flying(c)) => {
                if pressed {
                    self.pressed.press(event.physical_key, hold);
                }
                c.steer(|held| if pressed { held.press(hold) } else { held.release(hold) }, now);
            }
            _ if once => self.execute(action.intent.clone(), now, events),
            _ => {}
        }
    }

    /// True if Ctrl is held (on a Mac also Command). With it the wheel changes the view angle.
    fn controls(&self) -> bool {
        let control = if cfg!(target_os = "macos") { ModifiersState::SUPER } else { ModifiersState::empty() };
        self.modifiers.intersects(ModifiersState::CONTROL | control) && !self.modifiers.alt_key()
    }

    fn switch_fullscreen(&self) {
        if let Some(window) = &self.window {
            let full = window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
            window.set_fullscreen(full);
        }
    }

    fn ask_for_picture(&mut self) {
        self.asked = true;
        // A hidden window may never be drawn, so it must not be asked again immediately.
        self.due = Instant::now() + FRAME;
        if let Some(window) = &self.window {
            window.request_redraw();
        }
    }

    /// Updates the layout if something that it shows may have changed, and executes its requests.
    ///
    /// # Errors
    /// Returns status 1 if it panics again and again.
    fn lay_out(&mut self, now: Instant, events: &ActiveEventLoop) -> Result<()> {
        let size = self.window_size();
        let content = match &mut self.scan.stage {
            Stage::Loading(loading) => loading.content(),
            Stage::Failed(e) => Content::Failed { text: Self::failed_text(e) },
            Stage::Flying(controller) => {
                controller.scaled(size.pixels_a_point());
                Content::Flight(Box::new(controller.hud(now)))
            }
            Stage::Over => return Ok(()),
        };
        let other = self.other_content(size, now);
        let more = match &self.scan.stage {
            Stage::Flying(c) => c.has_marks() || self.workspace.shows_more_than_the_flight(),
            Stage::Loading(_) | Stage::Failed(_) | Stage::Over => false,
        };
        // A moving flight is laid out half as often as pictures are shown: rasterising takes as long as a small picture.
        let more = more && self.laid_out_at.is_none_or(|t| now.saturating_duration_since(t) >= LAYOUTS);
        let touched = std::mem::take(&mut self.touched) || more || self.interface.next().is_some_and(|t| t <= now);
        let laid_out = (content, other, size);
        if !touched && self.scan.placed.laid_out.as_ref() == Some(&laid_out) {
            return Ok(());
        }
        let (content, beside, size) = laid_out;
        let (Some(input), Some(window)) = (&mut self.input, &self.window) else { return Ok(()) };
        let (stage, workspace, mut requests) = (&self.scan.stage, &mut self.workspace, Requests::default());
        let (sheet, mut answer) = (&mut self.sheet, sheet::Answer::Stay);
        let (actions, recent) = (&*self.actions, self.recent.scans());
        let (file_list, mut chosen) = (&mut self.file_list, None);
        let (opening, series) = (self.scan.input.as_deref(), self.scan.series);
        let other = self.other.as_ref().zip(beside.as_ref()).map(|(other, content)| other.beside(content));
        let (shows_both, pairing) = (workspace.shows("second"), &self.pairing);
        let choices = if let Stage::Failed(e) = stage { &e.choices[..] } else { &[] };
        let output = self.interface.lay_out(input.take_egui_input(window), size, now, |ui| {
            match (&content, stage) {
                (Content::Flight(hud), Stage::Flying(controller)) => {
                    let context = Context::new(&**controller, actions, recent, hud).of_scan(opening, series);
                    let context = context.headed(workspace.is_headed()).beside(other, shows_both, pairing);
                    workspace.ui(&context, ui, &mut requests);
                    if let Some(sheet) = sheet {
                        answer = sheet.ui(&context, ui, &mut requests);
                    }
                }
                (Content::Failed { text }, _) => {
                    chosen = file_list.instead(text, opening, choices, recent, &actions.quit_key(), ui);
                }
                (Content::Loading { stage, share }, _) => {
                    let quit = actions.key("cancel");
                    overlay::loading(&background(ui), ui.ctx().content_rect(), stage, *share, &quit);
                }
                (Content::Flight(_), _) => {}
            }
            let beside = requests.slices_at().iter().map(|s| s.1).chain(requests.beside_at().iter().map(|b| b.1));
            requests.flight_at().into_iter().chain(beside).collect()
        });
        match (output, self.workspace.take_broken()) {
            (Ok(output), false) => {
                input.handle_platform_output(window, output);
                self.panicked = 0;
            }
            // What is laid out now may be damaged: the next one begins anew, without the panel.
            (laid_out, _) => {
                self.panicked += 1;
                if let (Err(why), true) = (&laid_out, self.panicked > MOST_PANICS) {
                    let hint = "start it without its own panels, or report it";
                    return Err(Error::fault("window", format!("its interface panicked: {why}"), hint));
                }
                self.interface.renew();
                if laid_out.is_err() {
                    self.sheet = None;
                    self.workspace.renew();
                }
                self.input = Some(input_of(&self.interface, window, events));
                (self.touched, self.scan.placed.laid_out) = (true, None);
                // What the other panels asked for holds.
                self.follow(chosen.into_iter().chain(requests.take()), now, events);
                return Ok(());
            }
        }
        self.scan.placed.flight_at = requests.flight_at().map_or([0; 4], |at| size.in_pixels(at));
        self.scan.placed.slices_at = requests.slices_at().iter().map(|(o, at)| (*o, size.in_pixels(*at))).collect();
        self.scan.placed.beside_at = requests.beside_at().iter().map(|(b, at)| (*b, size.in_pixels(*at))).collect();
        let (slices, beside_at) = (requests.slices_at().to_vec(), requests.beside_at().to_vec());
        self.scan.placed.views = Views { flight: requests.flight_at(), slices, beside: beside_at };
        self.scan.placed.laid_out = Some((content, beside, size));
        self.laid_out_at = Some(now);
        match answer {
            sheet::Answer::Stay => {}
            sheet::Answer::Close => self.close_sheet(),
            sheet::Answer::Open(asked) => self.open_asked(asked, events),
            sheet::Answer::Quit => self.quit(events),
        }
        self.follow(chosen.into_iter().chain(requests.take()), now, events);
        Ok(())
    }

    /// Executes the requests of panels.
    fn follow(&mut self, requests: impl Iterator<Item = Intent>, now: Instant, events: &ActiveEventLoop) {
        for request in requests {
            self.execute(request, now, events);
        }
    }

    /// Does what the operator wants, by whatever key, button or panel.
    fn execute(&mut self, intent: Intent, now: Instant, events: &ActiveEventLoop) {
        let moment = self.moment(now);
        let marked = matches!(intent, Intent::Finding(_)).then(|| self.count_findings());
        let left = match &mut self.scan.stage {
            Stage::Flying(c) => c.execute(intent, moment),
            Stage::Loading(_) | Stage::Failed(_) | Stage::Over => Some(intent),
        };
        if let Some(before) = marked {
            self.pair_new_finding(before, now);
        }
        if let Some(left) = left {
            self.execute_own(left, now, events);
        }
    }

    /// Does what concerns the window itself.
    fn execute_own(&mut self, intent: Intent, now: Instant, events: &ActiveEventLoop) {
        self.touched = true;
        match intent {
            Intent::Action(id) => match Rc::clone(&self.actions).named(&id) {
                Some(action) if action.is_performed() => self.execute(action.intent.clone(), now, events),
                found => refuse_action(&id, found.is_some(), None),
            },
            Intent::Own(n) => {
                let Stage::Flying(c) = &mut self.scan.stage else { return };
                if let Some(requests) = c.begin_own(n, self.recent.scans()) {
                    self.follow(requests.into_iter(), now, events);
                    self.own.end(n);
                }
            }
            Intent::Screenshot => self.photograph(now),
            Intent::Kinds => {
                let is_shown = matches!(&self.scan.stage, Stage::Flying(c) if c.kinds().is_shown());
                self.workspace.show_named("kinds", is_shown);
            }
            Intent::Coverage => {
                let is_shown = matches!(&self.scan.stage, Stage::Flying(c) if c.seen().is_painted());
                self.workspace.show_named("missed", is_shown);
            }
            Intent::Open(path, series) => self.open_scan(path, series, events),
            Intent::OpenSecond(path, series) => {
                self.open_second(Asked { input: Some(path), series, is_flying: true, is_whole: false, beside: None });
            }
            Intent::OtherPosition | Intent::SamePlace => {
                let done = match intent {
                    Intent::SamePlace => self.same_place(now),
                    _ => self.work_in_other(now),
                };
                if let Err(e) = done {
                    self.fail(e, events);
                }
            }
            Intent::Link => self.link(now),
            Intent::OfOther(intent) => self.execute_in_other(*intent, now),
            Intent::PartFinding(n) => self.part_finding(n, now),
            Intent::JoinFindings(n) => self.join_findings(n, now),
            Intent::StartAt(place) => self.start_at(place, events),
            Intent::Whole if matches!(self.scan.stage, Stage::Flying(_)) && self.scan.unflown.is_none() => {
                let (input, series) = (self.scan.input.clone(), self.scan.series);
                self.open_asked(Asked { input, series, is_flying: true, is_whole: true, beside: None }, events);
            }
            Intent::Files => self.workspace.switch_named("open"),
            Intent::Fullscreen => self.switch_fullscreen(),
            Intent::Help => match &self.sheet {
                Some(Sheet::Keys { .. }) => self.close_sheet(),
                _ => {
                    // The keyboard's layout may have changed since.
                    self.name_keys();
                    self.sheet = Some(Sheet::keys());
                }
            },
            Intent::Layout(n) => self.workspace.choose(n),
            Intent::Panel(n) => self.workspace.switch(n),
            Intent::Cancel => self.cancel(events),
            Intent::Quit => match &self.scan.stage {
                Stage::Flying(c) if !matches!(self.sheet, Some(Sheet::Quit { .. })) => match c.unfinished() {
                    Some(why) => {
                        let keeps = self.scan.keeping.as_ref().is_some_and(Keeping::keeps);
                        self.sheet = Some(Sheet::Quit { why, keeps });
                    }
                    None => self.quit(events),
                },
                _ => self.quit(events),
            },
            // Of a flight, while there is none.
            _ => {}
        }
    }

    fn close_sheet(&mut self) {
        (self.sheet, self.touched) = (None, true);
    }

    /// Cancels the innermost of what is under way: a sheet, a tool, the list of scans, full screen, the loading of a scan.
    fn cancel(&mut self, events: &ActiveEventLoop) {
        if self.sheet.is_some() {
            return self.close_sheet();
        }
        match &mut self.scan.stage {
            Stage::Flying(c) => {
                if c.cancel(Instant::now()) || self.workspace.hide_named("open") {
                    return;
                }
            }
            // With it the program ends: nothing else is open.
            Stage::Loading(_) => return self.quit(events),
            Stage::Failed(_) | Stage::Over => {}
        }
        if self.window.as_ref().is_some_and(|w| w.fullscreen().is_some()) {
            self.switch_fullscreen();
        }
    }

    /// Asks what the keyboard prints, and names keys by it.
    fn name_keys(&mut self) {
        if let Some(window) = &self.window {
            self.printed.ask(window);
        }
        self.actions = Rc::new(self.actions.on(&self.printed));
        if let Stage::Flying(c) = &mut self.scan.stage {
            c.name_keys_by(Rc::clone(&self.actions));
        }
        self.touched = true;
    }

    /// Simulates up to now. Shows the picture if it differs from the displayed one, or if `anew` is set.
    fn picture(&mut self, anew: bool, events: &ActiveEventLoop) -> Result<()> {
        let now = Instant::now();
        self.lay_out(now, events)?;
        let [left, top, width, height] = self.scan.placed.flight_at;
        let flight = (width * height > 0).then_some((left, top));
        let (mut due, mut is_flat_new) = (None, false);
        match &mut self.scan.stage {
            Stage::Flying(controller) => {
                controller.advance(now)?;
                if let Some(turn) = self.scan.keeping.as_mut().and_then(|k| k.take_over(controller, now)) {
                    self.workspace.warn_instead(keeping::ELSEWHERE, turn.warning().as_deref());
                    controller.say(turn.said(), now);
                    self.touched = true;
                }
                if let Some(log) = &mut self.scan.log {
                    log.add(controller.flight_mut().take_log())?;
                }
                let slices: Vec<_> = self.scan.placed.slices_at.iter().map(|(o, [.., w, h])| (*o, [*w, *h])).collect();
                due = controller.prepare(ImageSize::new(width, height), &slices, now)?;
                is_flat_new = self.scan.placed.flat().is_some_and(|size| controller.draw_flat(size));
                // The text over slices describes them at the time of the layout. At rest, nothing else triggers a new layout.
                self.touched |= due.is_some() && !slices.is_empty() && controller.rests();
            }
            Stage::Loading(_) | Stage::Failed(_) => {}
            Stage::Over => return Ok(()),
        }
        let is_other_new = self.other_picture(due.is_some(), now)?;
        let period = if matches!(self.scan.stage, Stage::Loading(_)) { LOADING } else { FRAME };
        // A picture that starts slightly late does not delay those after it.
        let beat = self.beat + period;
        self.beat = if now.saturating_duration_since(beat) < period / 2 { beat.min(now) } else { now };
        self.due = self.beat + period;
        let (pixels, Some(layout)) = (self.window_size().pixels, self.interface.layout()) else { return Ok(()) };
        if pixels.pixels() == 0 {
            // Minimised: the flight continues, but there is nothing to paint on.
            return Ok(());
        }
        if due.is_none() && !is_other_new && !is_flat_new && !anew && self.scan.placed.painted == Some(layout.serial) {
            return Ok(());
        }
        let shown = match &mut self.scan.stage {
            Stage::Flying(controller) => {
                let place =
                    |(o, [x, y, ..]): &(Orientation, [usize; 4])| Some((controller.slices().entity(*o)?, (*x, *y)));
                let slices = self.scan.placed.slices_at.iter().filter_map(place).collect();
                let beside = &self.scan.placed.beside_at;
                let flat = Some(controller.flat_frame().clone()).filter(|_| is_flat_new);
                if let Some(mut framebuffer) = controller.framebuffer() {
                    if let Some(flat) = &flat {
                        framebuffer.show_beside(Beside::Flat, flat);
                    }
                    for (which, _) in beside.iter().filter(|_| is_other_new) {
                        if let Some(picture) = self.other.as_ref().and_then(|other| other.picture(*which)) {
                            framebuffer.show_beside(*which, picture);
                        }
                    }
                    let beside = beside.iter().map(|(which, [x, y, ..])| (*which, (*x, *y))).collect();
                    framebuffer.prepare(layout, Places { flight, slices, beside });
                }
                let shown = controller.show(due)?;
                if let Some(shown) = &shown {
                    self.scan.placed.presented.took(shown.ms);
                    controller.presented(self.scan.placed.presented.usual_ms());
                }
                shown
            }
            _ => self.framebuffer.as_mut().map(|f| f.show_alone(layout)).transpose()?,
        };
        self.settled = shown.is_none_or(|s| s.settled);
        self.scan.placed.painted = self.settled.then_some(layout.serial);
        Ok(())
    }

    /// Returns when work is due without operator input; `None` to sleep until the next input.
    fn next(&self) -> Option<Instant> {
        // Whatever is shown, the interface reacts to input, and shows its tooltips when they are due.
        let touched = (self.touched && !matches!(self.scan.stage, Stage::Over)).then_some(self.due);
        let interface = self.interface.next().into_iter().chain(touched).min();
        let stage = match &self.scan.stage {
            Stage::Loading(_) => Some(self.due),
            Stage::Flying(c) if c.rests() && self.settled => {
                c.next().into_iter().chain(self.scan.keeping.as_ref().and_then(Keeping::next)).min()
            }
            Stage::Flying(_) => Some(self.due),
            Stage::Failed(_) | Stage::Over => None,
        };
        let other = self.next_of_other();
        stage.into_iter().chain(other).chain(interface).min().map(|t| t.max(self.due))
    }
}

/// Returns the translation of a window's events for an interface.
fn input_of(interface: &Interface, window: &Window, events: &ActiveEventLoop) -> egui_winit::State {
    let (scale, theme) = (window.scale_factor() as f32, Some(winit::window::Theme::Dark));
    egui_winit::State::new(interface.egui().clone(), ViewportId::ROOT, events, Some(scale), theme, None)
}

/// Returns the painter of the layer below all panels.
fn background(ui: &egui::Ui) -> egui::Painter {
    ui.ctx().layer_painter(LayerId::background())
}

impl ApplicationHandler<Wake> for Shell {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.window.is_some() {
            return;
        }
        let attributes = self.placement.attributes(self.size, events).with_title(self.scan.title());
        match Framebuffer::open(events, attributes) {
            Ok(framebuffer) => {
                let window = framebuffer.window();
                self.input = Some(input_of(&self.interface, &window, events));
                self.window = Some(window);
                self.name_keys();
                match &mut self.scan.stage {
                    Stage::Flying(c) => {
                        let camera = c.flight().app().camera_id();
                        if let Err(e) = c.flight_mut().views().present_to(camera, framebuffer) {
                            self.fail(e, events);
                        }
                    }
                    _ => self.framebuffer = Some(framebuffer),
                }
            }
            Err(e) => self.fail(e, events),
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, wake: Wake) {
        match wake {
            Wake::Loaded => {
                if let Err(e) = self.take_off().and_then(|()| self.take_off_other()) {
                    self.fail(e, events);
                }
                self.ask_for_picture();
            }
            Wake::JobDone => self.ask_for_picture(),
            Wake::Interrupted => {
                self.scan.progress.cancel();
                match self.scan.stage {
                    // The reason why it cannot be flown takes precedence.
                    Stage::Flying(_) if self.scan.unflown.is_some() => events.exit(),
                    Stage::Flying(_) => self.fail(Error::cancelled("flight"), events),
                    Stage::Loading(_) => self.fail(Error::cancelled("loading"), events),
                    // The reason why it could not be opened takes precedence.
                    Stage::Failed(_) | Stage::Over => events.exit(),
                }
            }
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let now = Instant::now();
        if let (Some(input), Some(window)) = (&mut self.input, &self.window)
            && !matches!(event, WindowEvent::RedrawRequested)
        {
            self.touched |= input.on_window_event(window, &event).repaint;
        }
        match event {
            WindowEvent::CloseRequested => self.execute(Intent::Quit, now, events),
            WindowEvent::RedrawRequested => {
                // If the system requests a redraw, the window was covered and has lost its picture.
                let anew = !std::mem::take(&mut self.asked);
                if let Err(e) = self.picture(anew, events) {
                    self.fail(e, events);
                } else if self.scan.time_is_over() || self.other.as_mut().is_some_and(OpenScan::time_is_over) {
                    self.quit(events);
                }
            }
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } | WindowEvent::Occluded(false) => {
                self.scan.placed.painted = None;
                self.touched = true;
                self.ask_for_picture();
            }
            WindowEvent::DroppedFile(path) => self.open_scan(path, None, events),
            // A key that is held while the window gains the focus was pressed for another window.
            WindowEvent::KeyboardInput { is_synthetic: true, event, .. } if event.state == ElementState::Pressed => {}
            WindowEvent::KeyboardInput { event, .. } => self.key(&event, events),
            WindowEvent::ModifiersChanged(m) => self.modifiers = m.state(),
            WindowEvent::Focused(false) => {
                if let Stage::Flying(c) = &mut self.scan.stage {
                    c.steer(HeldKeys::let_go, now);
                }
            }
            _ => {}
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if matches!(cause, StartCause::ResumeTimeReached { .. }) {
            self.ask_for_picture();
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        events.set_control_flow(self.next().map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }
}
