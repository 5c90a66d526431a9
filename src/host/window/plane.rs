//! The window of the 2D program: the picture of a flight through a drawing, and a few keys.
//!
//! Space pauses, R restarts, and a click restarts at that point. T, M, V and S show and hide tentacles, mines, the potential and
//! the path flown. Q quits.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DVec3;
use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalPosition};
use winit::event::{ElementState, MouseButton, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::keyboard::ModifiersState;
use winit::window::{Window, WindowId};

use super::screen::Screen;
use super::stroke::Stroke;
use super::{Display, Wake};
use crate::components::clock::Accumulator;
use crate::error::{Error, Result};
use crate::output;
use crate::plane::drawing::MM_PER_PIXEL;
use crate::plane::flight::HZ;
use crate::plane::picture::{Painter, Show};
use crate::plane::plan::pair;
use crate::plane::{Flight, State};
use crate::progress::Progress;
use crate::render::Frame;

/// Time between two pictures.
const PERIOD: Duration = Duration::from_millis(16);
/// Maximum number of steps to catch up per picture.
const MOST_STEPS: u32 = 12;
/// Keys with an action.
const KEYS: [&str; 8] = ["Space", "Esc", "Q", "R", "T", "M", "V", "S"];
/// Colour around the picture, `0x00RRGGBB`.
const MARGIN: u32 = 0x0018_161a;

struct Shell {
    flight: Flight,
    painter: Painter,
    show: Show,
    frame: Frame,
    paused: bool,
    time: Accumulator,
    last: Instant,
    /// Position of the picture in the window: left, top, and window pixels per pixel of the drawing.
    place: (usize, usize, usize),
    cursor: PhysicalPosition<f64>,
    modifiers: ModifiersState,
    screen: Option<Screen>,
    outcome: Result<()>,
    progress: Arc<Progress>,
    title: String,
}

/// Opens a window and flies until it is closed.
///
/// # Errors
/// Returns status 1 if the window fails, 4 if interrupted.
#[doc(hidden)]
pub fn run(display: Display, flight: Flight, progress: &Arc<Progress>) -> Result<()> {
    let painter = Painter::new(&flight);
    let mut shell = Shell {
        flight,
        painter,
        show: Show::default(),
        frame: Frame::default(),
        paused: false,
        time: Accumulator::default(),
        last: Instant::now(),
        place: (0, 0, 1),
        cursor: PhysicalPosition::default(),
        modifiers: ModifiersState::empty(),
        screen: None,
        outcome: Ok(()),
        progress: Arc::clone(progress),
        title: String::new(),
    };
    display.0.run_app(&mut shell).map_err(|e| Error::fault("window", e.to_string(), "use --headless"))?;
    shell.outcome
}

impl Shell {
    fn key(&mut self, stroke: &Stroke, events: &ActiveEventLoop) {
        let Some(key) = stroke.chord(|c| KEYS.contains(&&*c.to_string())) else { return };
        match key.to_string().as_str() {
            "Space" => self.paused = !self.paused,
            "Esc" | "Q" => events.exit(),
            "R" => self.flight.restart(),
            "T" => self.show.tentacles ^= true,
            "M" => self.show.mines ^= true,
            "V" => self.show.potential ^= true,
            "S" => self.show.trajectory ^= true,
            _ => {}
        }
    }

    /// Restarts at the cursor.
    fn click(&mut self) {
        let (left, top, scale) = self.place;
        let mm = |x: f64, edge: usize| (x - edge as f64) / scale as f64 * MM_PER_PIXEL;
        let at = DVec3::new(mm(self.cursor.x, left), mm(self.cursor.y, top), 0.0);
        if let Err(e) = self.flight.start_at(at) {
            output::to_stderr(format_args!("note: {e}"));
        }
    }

    /// Simulates up to now and shows the picture.
    fn picture(&mut self) -> Result<()> {
        let now = Instant::now();
        let steps = self.time.take(now - self.last, HZ, MOST_STEPS);
        self.last = now;
        if !self.paused {
            (0..steps).for_each(|_| self.flight.step());
        }
        let Some(screen) = &mut self.screen else { return Ok(()) };
        // Minimised: there is nothing to paint on.
        let Some(size) = screen.size() else { return Ok(()) };
        let (w, h) = (size.width, size.height);
        let scale = Painter::scale_for(&self.flight, size);
        self.painter.paint(&self.flight, self.show, scale, &mut self.frame);
        let (fw, fh) = (self.frame.width(), self.frame.height());
        self.place = (w.saturating_sub(fw) / 2, h.saturating_sub(fh) / 2, scale);
        let title = title(&self.flight, self.paused);
        if title != self.title {
            screen.window.set_title(&title);
            self.title = title;
        }
        let (left, top, _) = self.place;
        let frame = &self.frame;
        let shown = screen.show(size, |buffer| {
            buffer.fill(MARGIN);
            for (y, row) in frame.pixels().chunks_exact(fw).enumerate().take(h.saturating_sub(top)) {
                for (to, &[r, g, b]) in buffer[(y + top) * w + left..(y + top + 1) * w].iter_mut().zip(row) {
                    *to = u32::from_be_bytes([0, r, g, b]);
                }
            }
        });
        // A refused picture has been reported, and the next one comes soon.
        shown.map(|_| ())
    }

    fn open(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let drawing = self.flight.walls().drawing();
        let points = |n: usize| (n * 2).clamp(320, 1200) as f64;
        let attributes = Window::default_attributes()
            .with_title("colvis plane")
            .with_inner_size(LogicalSize::new(points(drawing.width()), points(drawing.height())));
        self.screen = Some(Screen::open(events, attributes)?);
        Ok(())
    }

    fn fail(&mut self, e: Error, events: &ActiveEventLoop) {
        self.outcome = Err(e);
        events.exit();
    }
}

/// Returns the window title for the state of a flight.
fn title(flight: &Flight, paused: bool) -> String {
    let state = match (flight.state(), paused) {
        (State::Arrived, _) => "arrived".to_owned(),
        (State::Ended, _) => "the time is over".to_owned(),
        (State::Operator, _) => {
            flight.call().map_or_else(String::new, |c| format!("{} at {}", c.trap.text(), pair(c.place)))
        }
        (State::Flying, true) => "paused".to_owned(),
        (State::Flying, false) if flight.rescue().is_escaping() => "looking for another direction".to_owned(),
        (State::Flying, false) => "flying".to_owned(),
    };
    format!("colvis plane: {state} (Space R T M V S, click to start there, Q)")
}

impl ApplicationHandler<Wake> for Shell {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.screen.is_none()
            && let Err(e) = self.open(events)
        {
            self.fail(e, events);
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::RedrawRequested => {
                if let Err(e) = self.picture() {
                    self.fail(e, events);
                }
            }
            // A key that was down as the window got the focus was pressed for another window.
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. }
                if event.state == ElementState::Pressed && !event.repeat =>
            {
                self.key(&Stroke::of(&event, self.modifiers, false), events);
            }
            WindowEvent::ModifiersChanged(m) => self.modifiers = m.state(),
            WindowEvent::CursorMoved { position, .. } => self.cursor = position,
            WindowEvent::MouseInput { button: MouseButton::Left, state: ElementState::Pressed, .. } => self.click(),
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        if self.progress.is_cancelled() {
            self.fail(Error::cancelled("flight"), events);
            return;
        }
        if self.last.elapsed() >= PERIOD
            && let Some(s) = &self.screen
        {
            s.window.request_redraw();
        }
        events.set_control_flow(ControlFlow::WaitUntil(Instant::now() + PERIOD));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plane::{Drawing, PlaneSettings};
    use crate::render::ImageSize;

    /// The window, not yet open, of a flight through a corridor of 78 × 18 mm.
    fn shell() -> Shell {
        let lumen = (0..160 * 40).map(|n| (2..158).contains(&(n % 160)) && (2..38).contains(&(n / 160))).collect();
        let mut drawing = Drawing::new("corridor", ImageSize::new(160, 40), lumen).unwrap();
        (drawing.start, drawing.goal) = (Some(DVec3::new(15.0, 10.0, 0.0)), Some(DVec3::new(70.0, 10.0, 0.0)));
        let flight = Flight::new(drawing, PlaneSettings::default()).unwrap();
        Shell {
            painter: Painter::new(&flight),
            flight,
            show: Show::default(),
            frame: Frame::default(),
            paused: false,
            time: Accumulator::default(),
            last: Instant::now(),
            place: (0, 0, 1),
            cursor: PhysicalPosition::default(),
            modifiers: ModifiersState::empty(),
            screen: None,
            outcome: Ok(()),
            progress: Arc::new(Progress::new()),
            title: String::new(),
        }
    }

    #[test]
    fn a_click_restarts_where_it_points() {
        let mut shell = shell();
        // Two window pixels are a pixel of the drawing, half a millimetre.
        shell.place = (100, 8, 2);
        shell.cursor = PhysicalPosition::new(100.0 + 4.0 * 40.0, 8.0 + 4.0 * 12.0);
        shell.flight.step();
        shell.click();
        assert_eq!(shell.flight.places(), [DVec3::new(40.0, 12.0, 0.0)]);
        // Beside the drawing nothing happens.
        shell.cursor = PhysicalPosition::new(20.0, 30.0);
        shell.click();
        assert_eq!(shell.flight.position(), DVec3::new(40.0, 12.0, 0.0));
    }

    #[test]
    fn time_goes_by_unless_the_flight_is_paused() {
        let mut shell = shell();
        let mut picture_after = |ms: u64, paused: bool| {
            (shell.last, shell.paused) = (shell.last.checked_sub(Duration::from_millis(ms)).unwrap(), paused);
            shell.picture().unwrap();
            shell.flight.places().len() - 1
        };
        assert_eq!(picture_after(10_000, false), MOST_STEPS as usize, "a slow machine flies slower");
        assert_eq!(picture_after(10_000, true), MOST_STEPS as usize);
        assert_eq!(picture_after(10_000, false), 2 * MOST_STEPS as usize);
    }

    #[test]
    fn the_title_says_what_the_flight_does() {
        let mut shell = shell();
        assert!(title(&shell.flight, false).starts_with("colvis plane: flying ("));
        assert!(title(&shell.flight, true).starts_with("colvis plane: paused ("));
        while shell.flight.state() == State::Flying {
            shell.flight.step();
        }
        assert!(title(&shell.flight, false).starts_with("colvis plane: arrived ("));
    }
}
