//! The flight as the window flies it: steps in real time, images when something has changed, the operator's commands.

use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use super::directions::Directions;
use super::keys::{Deed, Hands};
use super::overlay::{Mood, Readings};
use super::refine::{Order, Refiner, Traced, Use, WakeUp};
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
const QUIET_STEPS: u32 = 40;
/// Slower than this is rest, mm/s: what is left is a long drift away from the wall. Closer than this is the same place,
/// mm.
const REST_MM_S: f64 = 0.3;
const SAME_MM: f64 = 4e-3;
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
struct Shown {
    pose: Pose,
    size: (usize, usize),
    window: (usize, usize),
    quality: Quality,
}

impl Shown {
    /// Whether it shows what `pose` sees in a window.
    fn shows(&self, pose: &Pose, window: (usize, usize), quality: Quality) -> bool {
        self.window == window && self.quality == quality && same(&self.pose, pose)
    }
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
    shown: Option<Shown>,
    /// The image of a camera at rest, finer than the flight's own.
    fine: Option<Frame>,
    refiner: Refiner,
    moved: Instant,
    frames: Vec<FrameStats>,
    figures: Figures,
    message: Option<(String, Instant)>,
    help: bool,
    /// Whether there is something new to say although the flight rests.
    attention: bool,
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
    ///
    /// `wake` is called from another thread when a finer image is there.
    ///
    /// # Errors
    /// Status 1 when the system gives no threads.
    pub fn new(flight: FlightApp, along_mm: f64, wake: WakeUp) -> Result<Self> {
        let now = Instant::now();
        let way = Way::new(flight.plan().length_mm, flight.flight().length_mm).at(along_mm);
        let refiner = Refiner::new(flight.space().clone(), wake)?;
        Ok(Self {
            flight,
            accumulator: Accumulator::default(),
            simulated: None,
            quiet: 0,
            hands: Hands::default(),
            sent: Default::default(),
            look: [0.0; 2],
            way,
            resolution: Resolution::default(),
            shown: None,
            fine: None,
            refiner,
            moved: now,
            frames: Vec::new(),
            figures: Figures { since: now, count: 0, ms: 0.0, text: Default::default(), stale: true },
            message: None,
            help: false,
            attention: false,
        })
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
        self.shown?;
        self.fine.as_ref().or_else(|| self.flight.camera::<Picture>().map(|p| &p.frame))
    }

    /// Says something for a moment.
    pub fn say(&mut self, text: impl Into<String>, now: Instant) {
        self.message = Some((text.into(), now + MESSAGE));
        self.attention = true;
    }

    /// Whether nothing will change until the operator does something.
    pub fn rests(&self) -> bool {
        self.quiet >= QUIET_STEPS
    }

    /// When something is to be done although the flight rests: a finer image, a message to be taken away.
    pub fn next(&self, window: (usize, usize)) -> Option<Instant> {
        let refine = self
            .shown
            .filter(|s| !self.refiner.is_busy() && Resolution::finer(s.size, window).is_some())
            .map(|_| self.moved + REFINE_AFTER);
        let message = self.message.as_ref().map(|m| m.1);
        let figures = self.figures.stale.then_some(self.figures.since + READ_EVERY);
        let attention = self.attention.then_some(self.figures.since);
        [refine, message, figures, attention].into_iter().flatten().min()
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
                let next =
                    if self.flight.scene().guide == Some(Guide::Manual) { Guide::Tentacles } else { Guide::Manual };
                self.act(Command::Guide(next.name().to_owned()), now);
                self.say(format!("guide: {}", self.flight.scene().guide_name()), now);
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
        self.attention = true;
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
        // The next that was not flown, or where there is none the next of all.
        let here = self.flight.plan().segment.map_or(0, |n| n + 1);
        let unflown = self.flight.unflown();
        let next = unflown.iter().find(|s| s.0 >= here).or(unflown.first()).map_or(here % count.max(1), |s| s.0);
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

    fn screenshot(&mut self, (width, height): (usize, usize), now: Instant) {
        if let Some(order) = Order::of(&self.flight, (width.max(1), height.max(1)), Use::Save) {
            self.refiner.begin(order);
            self.say("saving the image", now);
        }
    }

    /// Saves a screenshot and prints its pose.
    fn save(&mut self, traced: &Traced, now: Instant) {
        match screenshot::save(&traced.frame, Path::new(".")) {
            Ok(path) => {
                let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
                let pose = screenshot::pose_json(&traced.order.pose, traced.order.fov_degrees);
                // Who reads the poses may have gone; the picture is there.
                let _ = writeln!(std::io::stdout(), "{pose}");
                self.say(format!("saved {name}"), now);
            }
            Err(e) => self.say(e.to_string(), now),
        }
    }

    /// Saves the screenshots that are still being traced, at the end.
    pub fn save_the_rest(&mut self) {
        while let Some(traced) = self.refiner.wait() {
            match traced {
                Ok(t) if t.order.what_for == Use::Save => self.save(&t, Instant::now()),
                _ => {}
            }
        }
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
        let left_alone =
            hand.paused || flight.state != State::Flying || self.flight.scene().guide == Some(Guide::Manual);
        let still = self.flight.camera::<Velocity>().is_none_or(|v| v.0.length() < REST_MM_S)
            && hand.push == glam::DVec3::ZERO
            && hand.turn == glam::DVec3::ZERO;
        self.quiet = if left_alone && still && !self.flight.is_replaying() { self.quiet.saturating_add(1) } else { 0 };
    }

    /// Sees to it that there is an image for a window of the given size; whether it is another than before.
    ///
    /// # Errors
    /// Status 1 when an image cannot be made: a fault of the program.
    pub fn trace(&mut self, window: (usize, usize), now: Instant) -> Result<bool> {
        let mut finer = self.collect(window, now)?;
        if window.0 == 0 || window.1 == 0 {
            return Ok(false);
        }
        let pose = self.flight.pose();
        let Some(quality) = self.quality() else { return Ok(false) };
        match self.shown.filter(|s| s.shows(&pose, window, quality)) {
            None => {
                self.moved = now;
                self.fine = None;
                let size = self.resolution.moving(window);
                let ms = self.trace_now(size);
                self.resolution.measured(size.0 * size.1, ms);
                self.shown = Some(Shown { pose, size, window, quality });
                finer = true;
            }
            Some(shown) if now >= self.moved + REFINE_AFTER && !self.refiner.is_busy() => {
                let next = Resolution::finer(shown.size, window);
                if let Some(order) = next.and_then(|size| Order::of(&self.flight, size, Use::Show)) {
                    self.refiner.begin(order);
                }
            }
            Some(_) => {}
        }
        Ok(finer)
    }

    /// Traces the flight's own picture; how long that took, ms.
    fn trace_now(&mut self, (width, height): (usize, usize)) -> f64 {
        if let Some(mut picture) = self.flight.camera_mut::<Picture>() {
            picture.frame.resize(width, height);
        }
        let begun = Instant::now();
        self.flight.frame();
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        if let Some(w) = self.flight.camera::<Picture>().map(|p| p.work) {
            self.count(FrameStats { ms, rays: w.rays, samples: w.samples, reused: w.reused });
        }
        ms
    }

    /// Takes the images that were traced in the background; whether one is to be shown.
    fn collect(&mut self, window: (usize, usize), now: Instant) -> Result<bool> {
        let mut finer = false;
        while let Some(traced) = self.refiner.take() {
            let traced = traced?;
            if traced.order.what_for == Use::Save {
                self.save(&traced, now);
                continue;
            }
            let order = traced.order;
            // The camera may have moved on meanwhile.
            let here = self.flight.pose();
            let quality = order.settings.quality;
            if self.quality() != Some(quality) || !same(&order.pose, &here) {
                continue;
            }
            if let Some(shown) = self.shown.as_mut().filter(|s| s.shows(&here, window, quality)) {
                shown.size = order.size;
                self.fine = Some(traced.frame);
                self.count(traced.stats);
                finer = true;
            }
        }
        Ok(finer)
    }

    fn count(&mut self, stats: FrameStats) {
        self.frames.push(stats);
        self.figures.count += 1;
        self.figures.ms += stats.ms;
        self.figures.stale = true;
    }

    fn quality(&self) -> Option<Quality> {
        self.flight.camera::<Picture>().map(|p| p.settings.quality)
    }

    /// What there is to say now.
    pub fn readings(&mut self, now: Instant) -> Readings {
        self.read_figures(now);
        self.attention = false;
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
            // The length is coarse: digits that it does not have are not shown.
            place: format!("{:.0} of about {:.0} mm", (along / 10.0).round() * 10.0, (length / 10.0).round() * 10.0),
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
            State::Flying if self.flight.scene().guide == Some(Guide::Manual) => ("manual", Mood::Waiting),
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
            let size = self.shown.map_or((0, 0), |s| s.size);
            // A rate tells nothing of a picture that stands still.
            let rate = if self.fine.is_some() { String::new() } else { format!(", {fps:.0} fps") };
            f.text[0] = format!("{:.0} ms{rate} ({}x{})", f.ms / f64::from(f.count), size.0, size.1);
        }
        (f.count, f.ms, f.since, f.stale) = (0, 0.0, now, false);
        let speed = self.flight.camera::<Velocity>().map_or(0.0, |v| v.0.length());
        let clearance = self.flight.camera::<Contact>().map_or(0.0, |c| c.clearance_mm);
        let cruise = self.flight.scene().tentacles.cruise_mm_s * self.hand().speed;
        let quality = self.quality().unwrap_or_default();
        self.figures.text[1] = format!("speed {speed:.0} mm/s (cruise {cruise:.0})");
        // Beyond the finder's reach a clearance is a lower bound.
        let bound = if clearance > 10.0 { "over 10".to_owned() } else { format!("{clearance:.1}") };
        self.figures.text[2] = format!("clearance {bound} mm");
        self.figures.text[3] = format!("guide {}, detail {}", self.flight.scene().guide_name(), detail(quality));
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
