//! The window itself: the system's events in, pictures out.

use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalPosition, PhysicalSize, Size};
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::keyboard::ModifiersState;
use winit::window::{Fullscreen, Window, WindowId};

use super::actions::{Actions, Does, Moment, WindowRequest};
use super::cockpit::Cockpit;
use super::framebuffer::Framebuffer;
use super::keys::{Chord, HeldKeys};
use super::loading::{Loading, Ready};
use super::overlay::Content;
use super::painter::{on_bar, pixels_a_point};
use super::presented::Presented;
use super::saver::WakeUp;
use super::session::Session;
use super::{Finish, Launch, Resume, Shown};
use crate::app::Overlay;
use crate::error::{Error, Result};
use crate::host::log::Log;
use crate::progress::Progress;
use crate::render::adaptive::FRAME;

/// Time between two pictures while loading.
const LOADING: Duration = Duration::from_millis(60);
/// Size of a window where none is asked for, in points.
const USUAL: LogicalSize<f64> = LogicalSize::new(1024.0, 768.0);
/// Pixels of a smooth scroll that count as a notch.
const NOTCH: f64 = 40.0;

/// What wakes the event loop from other threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wake {
    /// The loading is over.
    Loaded,
    /// An image is ready to be saved.
    Saveable,
    /// The user has interrupted the program.
    Interrupted,
}

/// What a mouse does that is dragged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Drag {
    /// Looks around.
    Look,
    /// Rolls the view.
    Roll,
}

enum Stage {
    Loading(Loading),
    Failed(Error),
    Flying(Box<Cockpit>),
    /// Nothing is shown any more.
    Over,
}

/// The program as the system's event loop knows it.
pub struct Shell {
    stage: Stage,
    window: Option<Rc<Window>>,
    /// The window's pixels, until there is a flight that presents its pictures there.
    framebuffer: Option<Framebuffer>,
    /// What the picture shows: painted again only when it differs.
    painted: Option<Content>,
    /// Whether what lies over the picture is what is to.
    settled: bool,
    /// When the next picture is due at the earliest.
    due: Instant,
    /// Whether the program itself asked for the next picture.
    asked: bool,
    modifiers: ModifiersState,
    cursor: Option<PhysicalPosition<f64>>,
    drag: Option<Drag>,
    log_path: Option<PathBuf>,
    log: Option<Log>,
    seconds: Option<f64>,
    size: Option<(usize, usize)>,
    resume: Resume,
    session: Option<PathBuf>,
    finish: Option<Finish>,
    progress: Arc<Progress>,
    saveable: WakeUp,
    presented: Presented,
    overlays: Vec<Overlay>,
    actions: Rc<Actions>,
    /// What is wrong with the settings file.
    unsettled: Option<Error>,
    outcome: Result<()>,
}

impl Shell {
    /// Begins to load.
    ///
    /// # Errors
    /// Status 1 when the system gives no thread.
    pub fn new(launch: Launch, progress: &Arc<Progress>, proxy: EventLoopProxy<Wake>) -> Result<Self> {
        let (actions, unsettled) = super::actions(&launch.guides, &launch.overlays)?;
        if let Some(e) = &unsettled {
            eprintln!("note: {e}");
        }
        let done = proxy.clone();
        let loading = Loading::start(launch.prepare, progress, move || {
            // There is nobody to wake when the window is gone.
            let _ = done.send_event(Wake::Loaded);
        })?;
        let saveable: WakeUp = Arc::new(move || {
            let _ = proxy.send_event(Wake::Saveable);
        });
        Ok(Self {
            stage: Stage::Loading(loading),
            window: None,
            framebuffer: None,
            painted: None,
            settled: true,
            due: Instant::now(),
            asked: false,
            modifiers: ModifiersState::empty(),
            cursor: None,
            drag: None,
            log_path: launch.log,
            log: None,
            seconds: launch.seconds,
            size: launch.size,
            resume: launch.resume,
            session: None,
            finish: Some(launch.finish),
            progress: Arc::clone(progress),
            saveable,
            presented: Presented::default(),
            overlays: launch.overlays,
            actions: Rc::new(actions),
            unsettled,
            outcome: Ok(()),
        })
    }

    /// Writes what the flight leaves behind, once the window is closed.
    ///
    /// # Errors
    /// The first of what went wrong.
    pub fn end(mut self) -> Result<()> {
        let stage = std::mem::replace(&mut self.stage, Stage::Over);
        match stage {
            Stage::Flying(mut cockpit) => {
                cockpit.save_the_rest();
                let flight = cockpit.flight();
                let logged = self.log.take().map_or(Ok(()), |l| l.finish(flight.flight().state));
                if let Some(path) = self.session.take() {
                    let session = Session::of(flight, cockpit.along_mm());
                    if let Err(e) = Session::keep(session.as_ref(), &path) {
                        eprintln!("note: the place of this flight is not kept: {e}");
                    }
                }
                let shown = Shown { present_ms: self.presented.summary(), moving: cockpit.moving() };
                let finished = self.finish.take().map_or(Ok(()), |f| f(flight, cockpit.frames(), &shown));
                self.outcome.and(logged).and(finished)
            }
            Stage::Failed(e) => Err(e),
            // Closed while loading: the worker gives up by itself, and leaves nothing behind.
            Stage::Loading(_) => Err(Error::cancelled("loading")),
            Stage::Over => self.outcome,
        }
    }

    fn fail(&mut self, e: Error, events: &ActiveEventLoop) {
        if self.outcome.is_ok() {
            self.outcome = Err(e);
        }
        events.exit();
    }

    fn quit(&mut self, events: &ActiveEventLoop) {
        if matches!(self.stage, Stage::Loading(_)) {
            self.progress.cancel();
        }
        events.exit();
    }

    /// The window's size in pixels.
    fn window_size(&self) -> (usize, usize) {
        self.window.as_ref().map_or((0, 0), |window| {
            let size = window.inner_size();
            (size.width as usize, size.height as usize)
        })
    }

    /// Pixels of the window that the system counts as a point.
    fn scale(&self) -> f32 {
        self.window.as_ref().map_or(1.0, |w| w.scale_factor() as f32)
    }

    /// The loading is over: takes off, or shows why not.
    fn take_off(&mut self) -> Result<()> {
        let Stage::Loading(loading) = std::mem::replace(&mut self.stage, Stage::Over) else { return Ok(()) };
        let Ready { mut flight, session } = match loading.finish() {
            Ok(ready) => ready,
            Err(e) if self.progress.is_cancelled() => return Err(e),
            Err(e) => {
                self.stage = Stage::Failed(e);
                return Ok(());
            }
        };
        self.log = self.log_path.as_deref().map(Log::create).transpose()?;
        // A camera that nobody steers leaves no place behind that another flight could go on from.
        if self.resume != Resume::Never && flight.scene().guide().is_some() {
            self.session = session;
        }
        let left = match (&self.session, self.resume) {
            (Some(path), Resume::Everything | Resume::Place) => Session::read(path).unwrap_or_else(|e| {
                eprintln!("note: {e}");
                None
            }),
            _ => None,
        };
        // What cannot be taken up must not keep the scan from being opened.
        let along = left.and_then(|left| {
            left.take_up(&mut flight, self.resume).unwrap_or_else(|e| {
                eprintln!("note: the flight does not go on where it was left: {e}");
                None
            })
        });
        if let Some(framebuffer) = self.framebuffer.take() {
            let camera = flight.app().camera_id();
            flight.present_to(camera, framebuffer)?;
        }
        let overlays = std::mem::take(&mut self.overlays);
        let mut cockpit =
            Cockpit::new(flight, along.unwrap_or(0.0), Arc::clone(&self.saveable), overlays, Rc::clone(&self.actions))?;
        if let Some(e) = self.unsettled.take() {
            cockpit.say(format!("{}: {}", e.what, e.why), Instant::now());
        } else if along.is_some() {
            cockpit.say("going on where you left (E starts from the end)", Instant::now());
        }
        self.stage = Stage::Flying(Box::new(cockpit));
        Ok(())
    }

    fn key(&mut self, event: &KeyEvent, events: &ActiveEventLoop) {
        let now = Instant::now();
        let pressed = event.state == ElementState::Pressed;
        // Ctrl-C and the like are not ours.
        let other = self.modifiers.intersects(ModifiersState::ALT | ModifiersState::SUPER) && !self.controls();
        let Some(chord) = Chord::of(&event.logical_key, self.controls()) else { return };
        let actions = Rc::clone(&self.actions);
        // A key that goes up is let go of in any case, whatever is held beside it.
        let action = actions.of_key(&chord).or_else(|| actions.of_key(&chord.plain()).filter(|_| !pressed));
        let Some(action) = action.filter(|_| !pressed || !other) else { return };
        let once = pressed && (action.repeats || !event.repeat);
        match (action.does, &mut self.stage) {
            (Does::Window(WindowRequest::Quit), _) if pressed => self.quit(events),
            (Does::Window(WindowRequest::Fullscreen), _) if once => self.switch_fullscreen(),
            (Does::Window(_) | Does::Gesture, _) => {}
            (Does::Hold(hold), Stage::Flying(c)) => {
                c.steer(|held| if pressed { held.press(hold) } else { held.release(hold) }, now);
            }
            (Does::Once(_) | Does::HandTo(_) | Does::Overlay(_), Stage::Flying(c)) if once => {
                let window = self.window.as_ref().map_or((0, 0), |w| {
                    let size = w.inner_size();
                    (size.width as usize, size.height as usize)
                });
                c.perform(action, Moment { window, now });
            }
            (Does::Hold(_) | Does::Once(_) | Does::HandTo(_) | Does::Overlay(_), _) => {}
        }
    }

    /// Whether Ctrl is held (on a Mac also Command): with it the wheel changes the view angle.
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
        // A window that is hidden may never be drawn: it must not be asked again at once.
        self.due = Instant::now() + FRAME;
        if let Some(window) = &self.window {
            window.request_redraw();
        }
    }

    /// Flies on to now, and shows the picture if it differs from the one that is shown, or if `anew`.
    fn picture(&mut self, anew: bool) -> Result<()> {
        let now = Instant::now();
        let (size, scale) = (self.window_size(), self.scale());
        let mut due = None;
        let content = match &mut self.stage {
            Stage::Loading(loading) => loading.content(),
            Stage::Failed(e) => Content::Failed { text: e.to_string() },
            Stage::Flying(cockpit) => {
                cockpit.advance(now)?;
                if let Some(log) = &mut self.log {
                    log.add(cockpit.flight_mut().take_log())?;
                }
                due = cockpit.prepare(size, now)?;
                cockpit.scaled(pixels_a_point(size, scale));
                Content::Flight(Box::new(cockpit.readings(now)))
            }
            Stage::Over => return Ok(()),
        };
        let period = if matches!(self.stage, Stage::Loading(_)) { LOADING } else { FRAME };
        self.due = now + period;
        if size.0 == 0 || size.1 == 0 {
            // Minimised: the flight goes on, there is nothing to paint on.
            return Ok(());
        }
        if due.is_none() && !anew && self.painted.as_ref() == Some(&content) {
            return Ok(());
        }
        let shown = match &mut self.stage {
            Stage::Flying(cockpit) => {
                let shown = cockpit.show(due, content.clone())?;
                if let Some(shown) = &shown {
                    self.presented.took(shown.ms);
                    cockpit.presented(self.presented.usual_ms());
                }
                shown
            }
            _ => self.framebuffer.as_mut().map(|f| f.show(None, &content)).transpose()?,
        };
        let settled = shown.is_none_or(|s| s.settled);
        self.painted = settled.then_some(content);
        self.settled = settled;
        Ok(())
    }

    /// Whether the flight's time is over.
    fn time_is_over(&mut self) -> bool {
        match (&mut self.stage, self.seconds) {
            (Stage::Flying(c), Some(s)) if c.flight().clock().seconds() >= s => {
                c.flight_mut().end();
                true
            }
            _ => false,
        }
    }

    /// When there is something to do next without the operator; none to sleep until they do something.
    fn next(&self) -> Option<Instant> {
        match &self.stage {
            Stage::Loading(_) => Some(self.due),
            Stage::Flying(c) if c.rests() && self.settled => c.next().map(|t| t.max(self.due)),
            Stage::Flying(_) => Some(self.due),
            Stage::Failed(_) | Stage::Over => None,
        }
    }
}

impl ApplicationHandler<Wake> for Shell {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.window.is_some() {
            return;
        }
        let size = self.size.map_or(Size::Logical(USUAL), |(w, h)| PhysicalSize::new(w as u32, h as u32).into());
        let attributes = Window::default_attributes()
            .with_title("colvis")
            .with_inner_size(size)
            .with_min_inner_size(LogicalSize::new(320.0, 240.0));
        match Framebuffer::open(events, attributes) {
            Ok(framebuffer) => {
                self.window = Some(framebuffer.window());
                match &mut self.stage {
                    Stage::Flying(c) => {
                        let camera = c.flight().app().camera_id();
                        if let Err(e) = c.flight_mut().present_to(camera, framebuffer) {
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
                if let Err(e) = self.take_off() {
                    self.fail(e, events);
                }
                self.ask_for_picture();
            }
            Wake::Saveable => self.ask_for_picture(),
            Wake::Interrupted => {
                if matches!(self.stage, Stage::Flying(_)) {
                    self.fail(Error::cancelled("flight"), events);
                } else {
                    events.exit();
                }
            }
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let now = Instant::now();
        match event {
            WindowEvent::CloseRequested => self.quit(events),
            WindowEvent::RedrawRequested => {
                // Where the system asks, the window was covered and has lost its picture.
                let anew = !std::mem::take(&mut self.asked);
                if let Err(e) = self.picture(anew) {
                    self.fail(e, events);
                } else if self.time_is_over() {
                    self.quit(events);
                }
            }
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } | WindowEvent::Occluded(false) => {
                self.painted = None;
                self.ask_for_picture();
            }
            WindowEvent::KeyboardInput { event, .. } => self.key(&event, events),
            WindowEvent::ModifiersChanged(m) => self.modifiers = m.state(),
            WindowEvent::Focused(false) => {
                self.drag = None;
                if let Stage::Flying(c) = &mut self.stage {
                    c.steer(HeldKeys::let_go, now);
                }
            }
            WindowEvent::MouseInput { button: MouseButton::Right, state, .. } => {
                self.drag = (state == ElementState::Pressed).then_some(Drag::Roll);
            }
            WindowEvent::MouseInput { button: MouseButton::Left, state, .. } => {
                let pressed = state == ElementState::Pressed;
                let drag = if self.modifiers.shift_key() { Drag::Roll } else { Drag::Look };
                let size = self.window_size();
                let share = self.cursor.and_then(|c| on_bar(size, self.scale(), (c.x, c.y)));
                match (&mut self.stage, share) {
                    (Stage::Flying(c), Some(share)) if pressed => c.seek(share, now),
                    _ => self.drag = pressed.then_some(drag),
                }
            }
            WindowEvent::CursorMoved { position, .. } => {
                let size = self.window_size();
                if let (Stage::Flying(c), Some(last), Some(drag)) = (&mut self.stage, self.cursor, self.drag) {
                    let (right, down) = (position.x - last.x, position.y - last.y);
                    match drag {
                        Drag::Look => c.drag((right, down), size),
                        Drag::Roll => c.roll(right, size),
                    }
                }
                self.cursor = Some(position);
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => f64::from(lines),
                    MouseScrollDelta::PixelDelta(p) => p.y / NOTCH,
                };
                let zooms = self.controls();
                if let Stage::Flying(c) = &mut self.stage {
                    if zooms { c.zoom(notches) } else { c.hurry(notches) }
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
