//! The flight as the window flies it: steps in real time, images when something has changed, the operator's commands.

use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use super::directions::Directions;
use super::keys::{Deed, Hands};
use super::overlay::{Mood, Readings};
use super::resolution::Resolution;
use super::screenshot;
use super::way::Way;
use crate::app::{FlightApp, Guide};
use crate::components::camera::{Contact, Pose, Velocity};
use crate::components::clock::Accumulator;
use crate::components::flight::State;
use crate::components::input::{Command, Hand};
use crate::components::output::Picture;
use crate::error::Result;
use crate::host::headless::{self, FrameStats};
use crate::render::{Frame, Quality};

/// Steps between two images at the most: a slower machine flies slower.
const STEPS: u32 = 10;
/// A resting camera is left alone after so many steps without motion.
const QUIET_STEPS: u32 = 60;
/// Slower than this is rest, mm/s; and closer than this is the same place, mm.
const REST_MM_S: f64 = 0.05;
const SAME_MM: f64 = 1e-3;
/// A camera at rest for so long gets finer images.
const REFINE_AFTER: Duration = Duration::from_millis(180);
/// Figures change so often at the most, to be readable.
const READ_EVERY: Duration = Duration::from_millis(250);
/// A message stays so long.
const MESSAGE: Duration = Duration::from_millis(2500);
/// One press of a key, or one notch of the wheel, changes the speed by this factor.
const FASTER: f64 = 1.15;

/// What an image was made of: nothing has to be traced again as long as it is the same.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Traced {
    pose: Pose,
    size: (usize, usize),
    window: (usize, usize),
    quality: Quality,
}

/// A flight with its operator.
pub struct Cockpit {
    flight: FlightApp,
    accumulator: Accumulator,
    /// Until when the flight was simulated; none after a rest.
    simulated: Option<Instant>,
    quiet: u32,
    hands: Hands,
    sent: ([f64; 3], [f64; 3]),
    look: [f64; 2],
    way: Way,
    resolution: Resolution,
    traced: Option<Traced>,
    moved: Instant,
    frames: Vec<FrameStats>,
    figures: Figures,
    message: Option<(String, Instant)>,
    help: bool,
}

/// Frame time and rate, averaged over a moment.
#[derive(Clone, Debug)]
struct Figures {
    since: Instant,
    count: u32,
    ms: f64,
    text: [String; 4],
    stale: bool,
}

impl Cockpit {
    /// The operator of `flight`, whose place along the way is `along_mm`.
    pub fn new(flight: FlightApp, along_mm: f64) -> Self {
        let now = Instant::now();
        let way = Way::new(flight.plan().length_mm, flight.flight().length_mm).at(along_mm);
        Self {
            flight,
            accumulator: Accumulator::default(),
            simulated: None,
            quiet: 0,
            hands: Hands::default(),
            sent: Default::default(),
            look: [0.0; 2],
            way,
            resolution: Resolution::default(),
            traced: None,
            moved: now,
            frames: Vec::new(),
            figures: Figures { since: now, count: 0, ms: 0.0, text: Default::default(), stale: true },
            message: None,
            help: false,
        }
    }

    /// The flight.
    pub fn flight(&self) -> &FlightApp {
        &self.flight
    }

    /// The flight, for taking its log.
    pub fn flight_mut(&mut self) -> &mut FlightApp {
        &mut self.flight
    }

    /// What the images took.
    pub fn frames(&self) -> &[FrameStats] {
        &self.frames
    }

    /// Place along the way, mm.
    pub fn along_mm(&self) -> f64 {
        self.way.along_mm()
    }

    /// The image as it was last traced.
    pub fn image(&self) -> Option<&Frame> {
        self.traced.and_then(|_| self.flight.camera::<Picture>()).map(|p| &p.frame)
    }

    /// Says something for a moment.
    pub fn say(&mut self, text: impl Into<String>, now: Instant) {
        self.message = Some((text.into(), now + MESSAGE));
    }

    /// Whether nothing will change until the operator does something.
    pub fn rests(&self) -> bool {
        self.quiet >= QUIET_STEPS
    }

    /// When something is to be done although the flight rests: a finer image, a message to be taken away.
    pub fn next(&self, window: (usize, usize)) -> Option<Instant> {
        let refine = self
            .traced
            .filter(|t| t.window == window && Resolution::finer(t.size, window).is_some())
            .map(|_| self.moved + REFINE_AFTER);
        let message = self.message.as_ref().map(|m| m.1);
        let figures = self.figures.stale.then_some(self.figures.since + READ_EVERY);
        [refine, message, figures].into_iter().flatten().min()
    }

    /// Sends the flight a command. One that cannot be followed is said, and changes nothing.
    fn act(&mut self, command: Command, now: Instant) {
        self.quiet = 0;
        if let Err(e) = self.flight.act(command) {
            self.say(format!("{}: {}", e.what, e.why), now);
        }
    }

    /// Keys go down or up: what `change` makes of them.
    pub fn steer(&mut self, change: impl FnOnce(&mut Hands) -> bool, now: Instant) {
        if !change(&mut self.hands) {
            return;
        }
        let (push, turn) = (self.hands.push(), self.hands.turn());
        if push != self.sent.0 {
            self.act(Command::Push(push), now);
        }
        if turn != self.sent.1 {
            self.act(Command::Turn(turn), now);
        }
        self.sent = (push, turn);
    }

    /// The mouse was dragged by so many pixels to the right and downwards in a window of the given size.
    pub fn drag(&mut self, (right, down): (f64, f64), window: (usize, usize)) {
        let fov = self.flight.camera::<Picture>().map_or(90.0, |p| p.fov_degrees);
        let degrees = fov / window.0.min(window.1).max(1) as f64;
        self.look[0] += right * degrees;
        self.look[1] -= down * degrees;
        self.quiet = 0;
    }

    /// Changes the speed by so many notches.
    pub fn hurry(&mut self, notches: f64, now: Instant) {
        let speed = (self.hand().speed * FASTER.powf(notches)).clamp(0.1, 5.0);
        self.act(Command::Speed(speed), now);
        let cruise = self.flight.scene().tentacles.cruise_mm_s * speed;
        self.say(format!("cruise {cruise:.0} mm/s"), now);
    }

    fn hand(&self) -> Hand {
        self.flight.camera().copied().unwrap_or_default()
    }

    /// Does what a key stands for. What concerns the window alone is not for here.
    pub fn perform(&mut self, deed: Deed, window: (usize, usize), now: Instant) {
        match deed {
            Deed::Pause => {
                let paused = !self.hand().paused;
                self.act(Command::Pause(paused), now);
            }
            Deed::Faster => self.hurry(1.0, now),
            Deed::Slower => self.hurry(-1.0, now),
            Deed::Guide => {
                let next = if self.flight.scene().guide == Guide::Manual { Guide::Tentacles } else { Guide::Manual };
                self.act(Command::Guide(next.name().to_owned()), now);
                self.say(format!("guide: {}", self.flight.scene().guide.name()), now);
            }
            Deed::Detail => self.switch_detail(now),
            Deed::Reverse => {
                self.way.turn_round();
                self.act(Command::Reverse, now);
                self.say("flying back", now);
            }
            Deed::Next => self.next_segment(now),
            Deed::OtherEnd => {
                self.act(Command::OtherEnd, now);
                self.set_out();
            }
            Deed::Screenshot => self.screenshot(window, now),
            Deed::Help => self.help = !self.help,
            Deed::Fullscreen | Deed::Quit => {}
        }
        self.figures.stale = true;
    }

    fn switch_detail(&mut self, now: Instant) {
        let Some(mut picture) = self.flight.camera_mut::<Picture>() else { return };
        let quality = if picture.settings.quality == Quality::Low { Quality::High } else { Quality::Low };
        picture.settings.quality = quality;
        self.resolution.forget();
        self.say(format!("detail: {}", detail(quality)), now);
    }

    fn next_segment(&mut self, now: Instant) {
        let count = self.flight.lumen().segments.len();
        let next = self.flight.plan().segment.map_or(0, |n| n + 1) % count.max(1);
        if count == 0 || self.flight.plan().segment == Some(next) {
            self.say("there is no other segment", now);
            return;
        }
        self.act(Command::Segment(next), now);
        self.set_out();
        let ml = self.flight.lumen().segments[next].ml;
        if self.flight.plan().segment == Some(next) {
            self.say(format!("segment {} of {count}: {ml:.0} ml", next + 1), now);
        }
    }

    /// A flight that may have set out anew counts its way from there.
    fn set_out(&mut self) {
        if self.flight.flight().length_mm == 0.0 {
            self.way = Way::new(self.flight.plan().length_mm, 0.0);
        }
    }

    fn screenshot(&mut self, window: (usize, usize), now: Instant) {
        let pose = self.flight.pose();
        let Some(picture) = self.flight.camera::<Picture>() else { return };
        let fov = picture.fov_degrees;
        match screenshot::take(self.flight.space(), &pose, picture, window, Path::new(".")) {
            Ok(path) => {
                let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
                // Who reads the poses may have gone; the picture is there.
                let _ = writeln!(std::io::stdout(), "{}", screenshot::pose_json(&pose, fov));
                self.say(format!("saved {name}"), now);
            }
            Err(e) => self.say(e.to_string(), now),
        }
        // Real time went on meanwhile; the flight does not make up for it.
        self.simulated = None;
    }

    /// Simulates up to `now`.
    ///
    /// # Errors
    /// When a replayed command asks for something that there is not.
    pub fn advance(&mut self, now: Instant) -> Result<()> {
        if self.message.as_ref().is_some_and(|m| now >= m.1) {
            self.message = None;
        }
        if self.look != [0.0; 2] {
            let look = std::mem::take(&mut self.look);
            self.act(Command::Look(look), now);
        }
        if self.rests() {
            self.simulated = None;
            return Ok(());
        }
        let elapsed = self.simulated.map_or(Duration::ZERO, |t| now.saturating_duration_since(t));
        self.simulated = Some(now);
        for _ in 0..self.accumulator.take(elapsed, self.flight.clock().hz, STEPS) {
            self.flight.step()?;
            self.watch();
        }
        Ok(())
    }

    /// Follows a step: the way, and whether the flight has come to rest.
    fn watch(&mut self) {
        let flight = self.flight.flight();
        self.way.go(flight.length_mm);
        if flight.state == State::Arrived {
            self.way.arrive();
        }
        let hand = self.hand();
        let left_alone = hand.paused || flight.state != State::Flying || self.flight.scene().guide == Guide::Manual;
        let still = self.flight.camera::<Velocity>().is_none_or(|v| v.0.length() < REST_MM_S)
            && hand.push == glam::DVec3::ZERO
            && hand.turn == glam::DVec3::ZERO;
        self.quiet = if left_alone && still && !self.flight.is_replaying() { self.quiet.saturating_add(1) } else { 0 };
    }

    /// Traces an image for a window of the given size if there is one to be had that differs from the last; whether
    /// there was.
    pub fn trace(&mut self, window: (usize, usize), now: Instant) -> bool {
        if window.0 == 0 || window.1 == 0 {
            return false;
        }
        let pose = self.flight.pose();
        let Some(quality) = self.flight.camera::<Picture>().map(|p| p.settings.quality) else { return false };
        let last = self.traced.filter(|t| t.window == window && t.quality == quality && same(&t.pose, &pose));
        let size = match last {
            None => {
                self.moved = now;
                self.resolution.moving(window)
            }
            Some(t) => match Resolution::finer(t.size, window) {
                Some(finer) if now >= self.moved + REFINE_AFTER => finer,
                _ => return false,
            },
        };
        if let Some(mut picture) = self.flight.camera_mut::<Picture>() {
            picture.frame.resize(size.0, size.1);
        }
        let begun = Instant::now();
        self.flight.frame();
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        self.resolution.measured(size.0 * size.1, ms);
        if let Some(w) = self.flight.camera::<Picture>().map(|p| p.work) {
            self.frames.push(FrameStats { ms, rays: w.rays, samples: w.samples, reused: w.reused });
        }
        self.figures.count += 1;
        self.figures.ms += ms;
        self.figures.stale = true;
        self.traced = Some(Traced { pose, size, window, quality });
        true
    }

    /// What there is to say now.
    pub fn readings(&mut self, now: Instant) -> Readings {
        self.read_figures(now);
        let flight = self.flight.flight();
        let (state, mood) = self.state(&flight.state);
        let mut more = Vec::new();
        match flight.state {
            State::Operator => {
                more.push(flight.reason.clone());
                more.push("Fly on by hand, or R back, N next segment.".to_owned());
            }
            State::Arrived => {
                more.extend(headless::unflown_text(&self.flight).map(|t| format!("{t} (N flies the next)")));
            }
            State::Flying | State::Ended => {}
        }
        let (along, length) = (self.way.along_mm(), self.way.length_mm());
        Readings {
            state,
            mood,
            more,
            figures: self.figures.text.to_vec(),
            directions: Directions::of(&self.flight.pose().attitude),
            per_mille: (self.way.share() * 1000.0).round() as u32,
            place: format!("{:.0} of about {:.0} mm", (along / 5.0).round() * 5.0, (length / 10.0).round() * 10.0),
            message: self.message.as_ref().map(|m| m.0.clone()),
            help: self.help,
        }
    }

    fn state(&self, state: &State) -> (String, Mood) {
        let (text, mood) = match state {
            State::Operator => ("operator needed", Mood::Calling),
            State::Arrived => ("arrived", Mood::Well),
            State::Ended => ("time is over", Mood::Well),
            State::Flying if self.hand().paused => ("paused", Mood::Waiting),
            State::Flying if self.flight.scene().guide == Guide::Manual => ("manual", Mood::Waiting),
            State::Flying if self.flight.clock().tick < self.hand().on_until => ("flying by hand", Mood::Waiting),
            State::Flying => ("flying", Mood::Well),
        };
        (text.to_owned(), mood)
    }

    fn read_figures(&mut self, now: Instant) {
        let f = &mut self.figures;
        let elapsed = now.saturating_duration_since(f.since);
        if !f.stale || (elapsed < READ_EVERY && !f.text[0].is_empty()) {
            return;
        }
        if f.count > 0 {
            let fps = f64::from(f.count) / elapsed.as_secs_f64().max(1e-3);
            let size = self.traced.map_or((0, 0), |t| t.size);
            let rate = if elapsed > READ_EVERY * 4 { String::new() } else { format!(", {fps:.0} fps") };
            f.text[0] = format!("{:.0} ms{rate} ({}x{})", f.ms / f64::from(f.count), size.0, size.1);
        }
        (f.count, f.ms, f.since, f.stale) = (0, 0.0, now, false);
        let speed = self.flight.camera::<Velocity>().map_or(0.0, |v| v.0.length());
        let clearance = self.flight.camera::<Contact>().map_or(0.0, |c| c.clearance_mm);
        let cruise = self.flight.scene().tentacles.cruise_mm_s * self.hand().speed;
        let quality = self.flight.camera::<Picture>().map_or(Quality::High, |p| p.settings.quality);
        self.figures.text[1] = format!("speed {speed:.0} mm/s (cruise {cruise:.0})");
        // Beyond the finder's reach a clearance is a lower bound.
        let bound = if clearance > 10.0 { "over 10".to_owned() } else { format!("{clearance:.1}") };
        self.figures.text[2] = format!("clearance {bound} mm");
        self.figures.text[3] = format!("guide {}, detail {}", self.flight.scene().guide.name(), detail(quality));
    }
}

fn detail(quality: Quality) -> &'static str {
    match quality {
        Quality::High => "high",
        Quality::Low => "low",
        Quality::Reference => "reference",
    }
}

/// Whether two poses make the same image, as far as one can see.
fn same(a: &Pose, b: &Pose) -> bool {
    let near = |a: glam::DVec3, b: glam::DVec3, by: f64| a.distance(b) < by;
    near(a.position, b.position, SAME_MM)
        && near(a.attitude.forward, b.attitude.forward, 1e-5)
        && near(a.attitude.up, b.attitude.up, 1e-5)
}
