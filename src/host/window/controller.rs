//! Controls a flight in a window: steps in real time, images when something has changed, and operator commands.

mod assisting;
mod commanding;
mod executing;
mod faults;
mod finding;
mod flattening;
mod history;
mod looking;
mod pairing;
mod pointing;
mod resting;
mod saving;
mod seeing;
mod telling;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::{Duration, Instant};

use bevy_ecs::change_detection::Mut;
use glam::DVec3;

use super::action::Actions;
use super::assistant::Assistant;
use super::background::{Background, BackgroundTask};
use super::cleansing::Cleansing;
use super::contract::WindowView;
use super::directions::Directions;
use super::document::Document;
use super::field_job;
use super::figures::Figures;
use super::finding_tool::FindingTool;
use super::flat::Flat;
use super::framebuffer::{Framebuffer, PresentResult};
use super::keys::HeldKeys;
use super::kinds::Kinds;
use super::measures::Measures;
use super::moving::Moving;
use super::overlay::HudState;
use super::overlays::Overlays;
use super::own_action::OwnActions;
use super::place::{Bar, Chosen, Place, which_segment};
use super::quality::QualityTool;
use super::reporting::{Reported, Reporting};
use super::seen::Seen;
use super::slices::Slices;
use super::style::{Severity, angle};
use super::travel::Travel;
use super::view_renderer::{Due, ViewRenderer};
use crate::app::{Fields, FlightApp, Overlay};
use crate::components::camera::{Pose, Velocity};
use crate::components::clock::Accumulator;
use crate::components::flight::State;
use crate::components::guide::Planned;
use crate::components::input::{Command, FlightCommand, Hand, HandCommand};
use crate::components::output::Picture;
use crate::components::slices::Orientation;
use crate::components::trail::Trail;
#[cfg(feature = "dicom")]
use crate::dicom::archive::Archive;
use crate::dynamics::Attitude;
use crate::error::{Error, Result};
use crate::host::frames::FrameStats;
use crate::host::headless;
use crate::output;
use crate::polyps::{Detector, detectors};
use crate::render::camera::fisheye;
use crate::render::{CameraModel, Frame, ImageSize};
use crate::systems::present;
use crate::volume::io::thick_slices;
use looking::Looking;

/// Maximum number of steps between two images. A slower machine flies slower.
const STEPS: u32 = 10;
/// Number of steps without motion after which a resting camera is no longer stepped.
const QUIET_STEPS: u32 = 40;
/// Speeds below this count as rest, mm/s: the remaining motion is a slow drift away from the wall.
const REST_MM_S: f64 = 0.3;
/// Duration of a message.
const MESSAGE: Duration = Duration::from_millis(2500);
/// Duration of a message about a plug-in that has panicked, or about the scan.
const FAULT_MESSAGE: Duration = Duration::from_secs(12);
/// Factor of the speed for one key press or one notch of the wheel.
const FASTER: f64 = 1.15;
/// The same factor for the view angle.
const NARROWER: f64 = 1.0 / 1.1;
/// View angles of the fisheye in the window, degrees, the one that it begins with, and that of a perspective camera in its place.
const WIDE: [f64; 2] = [120.0, 220.0];
const USUAL_WIDE: f64 = 180.0;
const USUAL_FLAT: f64 = 90.0;

/// Controls a flight for the operator.
pub(crate) struct FlightController {
    flight: FlightApp,
    accumulator: Accumulator,
    start: Instant,
    /// Time up to which the flight is simulated; `None` after a rest.
    simulated: Option<Instant>,
    quiet: u32,
    /// True if the flight's time is limited: it goes on whatever happens, or its end would never come.
    is_timed: bool,
    held: HeldKeys,
    sent: ([f64; 3], [f64; 3]),
    moved: Moved,
    slices: Slices,
    measures: Measures,
    /// The animated move of the camera to a place.
    travel: Option<Travel>,
    view_renderer: ViewRenderer,
    figures: Figures,
    place: Place,
    message: Option<(String, Instant)>,
    /// Errors that have been printed.
    reported: BTreeSet<String>,
    /// Fields that are being built for a guide before it takes over.
    planning: BackgroundTask<(&'static str, Fields)>,
    /// The scan without tag, beside the one as it is.
    cleansing: Cleansing,
    /// Looks for polyps, once it was asked for.
    assistant: Option<Box<Assistant>>,
    /// The method that finds polyps.
    detector: Detector,
    /// Why what is made is not kept with the scan, in a sentence.
    unkept: Option<String>,
    /// The kinds of gas, found once somebody asks for them.
    kinds: Kinds,
    /// The colon laid flat, once somebody asks for it.
    flat: Flat,
    /// What of the wall was seen, watched once somebody asks for it.
    seen: Seen,
    /// The view that is looked at.
    looking: Looking,
    /// What was found, and its history.
    document: Document,
    /// The chosen finding, and the pictures of all.
    findings: FindingTool,
    /// How well each segment can be read, and how long it was looked at.
    quality: QualityTool,
    reporting: Reporting,
    /// True once anything of the flight was shown.
    has_shown: bool,
    background: Background,
    /// The guide that resumes when the operator releases control.
    last_guide: &'static str,
    overlays: Overlays,
    actions: Rc<Actions>,
    /// The actions of other crates.
    pub(super) own: Rc<OwnActions>,
    /// Pixels per point of the window.
    scale: f32,
    /// True if there is something new to show although the flight rests.
    attention: bool,
    /// Why the scan cannot be flown.
    unflown: Option<String>,
    /// Why there is no picture, while the scene makes none.
    pictureless: Option<String>,
    /// The folder of screenshots that was set.
    screenshots: Option<PathBuf>,
}

/// Mouse and wheel movements since the last step. Each sum becomes one command, because a mouse reports far more often than the
/// flight steps, and each command is recorded.
#[derive(Default)]
struct Moved {
    /// Look to the right and upwards, degrees.
    look: [f64; 2],
    /// Roll, degrees clockwise.
    roll: f64,
    /// Notches by which the view angle narrows.
    zoom: f64,
    /// Notches by which the flight becomes faster.
    speed: f64,
}

impl FlightController {
    /// Creates the controller of `flight`.
    ///
    /// The numbers of overlays in `actions` are their indices in `overlays`. `background` wakes the window when an image
    /// is ready to be saved, or the scan without tag was found.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start threads.
    pub(crate) fn new(
        mut flight: FlightApp,
        background: Background,
        overlays: Vec<Overlay>,
        actions: Rc<Actions>,
    ) -> Result<Self> {
        let now = Instant::now();
        let view_renderer = ViewRenderer::new(background.wake())?;
        let overlays = Overlays::new(overlays, &mut flight)?;
        let scene = &flight.setup().scene;
        let automatic = scene.guide().into_iter().chain(scene.guides.iter()).find(|g| g.automatic);
        let last_guide = automatic.map_or("", |g| g.name);
        let kinds = Kinds::new(flight.setup().told.clone(), now);
        let mut document = Document::default();
        document.begin_with(kinds.told());
        // What the scan cannot show is said for as long as a fault.
        let thick = thick_slices(flight.setup().volume.voxels().grid()).map(|note| (note, now + FAULT_MESSAGE));
        Ok(Self {
            flight,
            accumulator: Accumulator::default(),
            start: now,
            simulated: None,
            quiet: 0,
            is_timed: false,
            held: HeldKeys::default(),
            sent: Default::default(),
            moved: Moved::default(),
            slices: Slices::default(),
            measures: Measures::default(),
            travel: None,
            view_renderer,
            figures: Figures::new(now),
            place: Place::new(now),
            message: thick,
            reported: BTreeSet::new(),
            planning: BackgroundTask::new(now),
            cleansing: Cleansing::new(now),
            assistant: None,
            detector: detectors::BUILT_IN[0],
            unkept: None,
            kinds,
            flat: Flat::new(now),
            seen: Seen::new(now),
            looking: Looking::default(),
            document,
            findings: FindingTool::new(now),
            quality: QualityTool::new(now),
            reporting: Reporting::new(now),
            has_shown: false,
            background,
            last_guide,
            overlays,
            actions,
            own: Rc::default(),
            scale: 1.0,
            attention: false,
            unflown: None,
            pictureless: None,
            screenshots: None,
        })
    }

    /// Returns the flight for modification, for example to take its log.
    pub(crate) fn flight_mut(&mut self) -> &mut FlightApp {
        &mut self.flight
    }

    /// Sets of what reports are made.
    pub(crate) fn set_reported(&mut self, of: Option<Reported>) {
        self.reporting.set(of);
    }

    /// Sets where reports can be sent.
    #[cfg(feature = "dicom")]
    pub(crate) fn set_archives(&mut self, archives: Vec<Archive>) {
        self.reporting.set_archives(archives);
    }

    /// Takes the actions of other crates.
    pub(crate) fn set_own(&mut self, own: Rc<OwnActions>) {
        self.own = own;
    }

    /// Sets the pixels per point of the window.
    pub(crate) fn scaled(&mut self, scale: f32) {
        self.scale = scale;
    }

    /// Returns the statistics of the images.
    pub(crate) fn frames(&self) -> &[FrameStats] {
        self.view_renderer.frames()
    }

    /// Returns the statistics of the size and rate of pictures while the camera moved.
    pub(crate) fn moving(&self) -> Option<Moving> {
        self.view_renderer.moving()
    }

    /// Records the time of a presentation, ms.
    pub(crate) fn presented(&mut self, ms: f64) {
        self.view_renderer.presented(ms);
    }

    /// Tells whether another picture is rendered in each frame.
    pub(crate) fn share_frames(&mut self, is_shared: bool) {
        self.view_renderer.share_frames(is_shared);
    }

    /// Returns the last rendered image.
    pub(crate) fn image(&self) -> Option<&Frame> {
        self.view_renderer.image(&self.flight)
    }

    /// Renders the picture that is due and presents it. If none is due, presents the last one again. Returns the result of the
    /// presentation if a window was [prepared](Framebuffer::prepare) for it.
    ///
    /// # Errors
    /// Returns status 1 if a frame cannot be rendered or shown.
    pub(crate) fn show(&mut self, due: Option<Due>) -> Result<Option<PresentResult>> {
        let mut is_rendered = due.as_ref().is_some_and(Due::is_rendered);
        match &due {
            Some(_) => {
                if let Err(e) = self.flight.views().render_due() {
                    is_rendered = false;
                    self.recover(e, Instant::now())?;
                }
            }
            None => self.flight.views().present_again(),
        }
        let is_pending = self.framebuffer().is_some_and(|mut f| f.show_without_flight());
        let is_empty = is_rendered && self.flight.camera::<Picture>().is_some_and(|p| !p.traced);
        if (is_pending || is_empty) && self.flight.setup().scene.picture {
            self.miss_picture(&headless::without_image(&self.flight, "window", "show"), Instant::now());
        } else if is_rendered {
            self.pictureless = None;
        }
        let (presented, refused) =
            self.framebuffer().map_or((None, None), |mut f| (f.take_presented(), f.take_refused()));
        if let Some(why) = refused {
            self.say(format!("a picture could not be shown: {why}"), Instant::now());
        }
        let presented = presented.transpose()?;
        self.has_shown = true;
        if let Some(due) = due {
            self.view_renderer.traced(&self.flight, &due, presented.map(|p| p.traced_ms));
            self.save_traced(Instant::now());
            self.figures.touch();
        }
        Ok(presented)
    }

    /// Returns the window's framebuffer, if there is one.
    pub(crate) fn framebuffer(&mut self) -> Option<Mut<'_, Framebuffer>> {
        let camera = self.flight.app().camera_id();
        present::presenter(self.flight.app_mut(), camera)
    }

    /// Shows a message for a moment.
    pub(crate) fn say(&mut self, text: impl Into<String>, now: Instant) {
        self.message = Some((text.into(), now + MESSAGE));
        self.attention = true;
    }

    /// True if nothing will change until the operator acts.
    pub(crate) fn rests(&self) -> bool {
        self.quiet >= QUIET_STEPS && !self.is_timed
    }

    /// Tells that the flight ends at a certain time.
    pub(crate) fn limit_time(&mut self) {
        self.is_timed = true;
    }

    /// Returns when work is due although the flight rests, such as a finer image or the end of a message.
    pub(crate) fn next(&self) -> Option<Instant> {
        let message = self.message.as_ref().map(|m| m.1);
        let attention = self.attention.then_some(self.start);
        let finer = self.view_renderer.is_refining(&self.flight).then_some(self.start);
        let planned = self.planning.next();
        let uncleansed =
            (self.cleansing.is_waiting() && self.has_shown && self.unflown.is_none()).then_some(self.start);
        let searched = self.assistant.as_ref().and_then(|a| a.next());
        let (told, seen, found) =
            (self.kinds.next(), self.seen.next(), self.findings.next(&self.document.found().findings, self.start));
        [
            self.looking.next(),
            seen,
            found,
            self.quality.next(),
            self.reporting.next(),
            finer,
            message,
            self.figures.next(),
            attention,
            planned,
            uncleansed,
            searched,
            self.flat.next(),
            told,
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Sends a command to the flight. Returns true if it succeeded. A refused command is reported and changes nothing.
    fn act(&mut self, command: impl Into<Command>, now: Instant) -> bool {
        self.quiet = 0;
        // Any operator command interrupts an animated move.
        self.travel = None;
        let command = command.into();
        // Whoever sends the flight elsewhere ends the round of reviews, too.
        if let Command::Flight(sent) = &command
            && !matches!(sent, FlightCommand::ViewAngle(_) | FlightCommand::Camera { .. })
        {
            self.seen.goes_on = false;
        }
        let followed = self.flight.act(command);
        if let Err(e) = &followed {
            self.say(format!("{}: {}", e.what, e.why), now);
        }
        followed.is_ok()
    }

    /// Applies `change` to the held keys and sends the resulting push and turn.
    pub(crate) fn steer(&mut self, change: impl FnOnce(&mut HeldKeys) -> bool, now: Instant) {
        if !change(&mut self.held) {
            return;
        }
        let (push, turn) = (self.held.push(), self.held.turn());
        if push != self.sent.0 {
            self.act(HandCommand::Push(push), now);
        }
        if turn != self.sent.1 {
            self.act(HandCommand::Turn(turn), now);
        }
        self.sent = (push, turn);
    }

    /// Turns the view by a mouse drag, in pixels to the right and downwards, in a window of the given size.
    pub(crate) fn drag(&mut self, (right, down): (f64, f64), window: ImageSize) {
        let fov = self.flight.camera::<Picture>().map_or(90.0, |p| p.fov_degrees);
        let degrees = fov / window.shorter().max(1) as f64;
        self.moved.look[0] += right * degrees;
        self.moved.look[1] -= down * degrees;
        self.quiet = 0;
    }

    /// Rolls the view by a mouse drag, in pixels to the right, in a window of the given size. A drag over its shorter side is
    /// half a turn.
    pub(crate) fn roll(&mut self, right: f64, window: ImageSize) {
        self.moved.roll += right * 180.0 / window.shorter().max(1) as f64;
        self.quiet = 0;
    }

    /// Narrows the view angle by a number of notches before the next step. Negative notches widen it.
    pub(crate) fn zoom(&mut self, notches: f64) {
        self.moved.zoom += notches;
        self.quiet = 0;
    }

    fn change_angle(&mut self, degrees: f64, now: Instant) {
        let degrees = if self.is_wide() { degrees.clamp(WIDE[0], WIDE[1]) } else { degrees };
        self.act(FlightCommand::ViewAngle(degrees), now);
        let Some(degrees) = self.flight.camera::<Picture>().map(|p| p.fov_degrees) else { return };
        let usual = self.usual_degrees();
        let back = if degrees == usual { String::new() } else { self.actions.hint("usual-angle", "sets it back") };
        self.say(format!("view angle {}{back}", angle(degrees)), now);
        self.figures.touch();
    }

    /// Changes the speed by a number of notches before the next step.
    pub(crate) fn change_speed_by(&mut self, notches: f64) {
        self.moved.speed += notches;
        self.quiet = 0;
    }

    fn change_speed(&mut self, notches: f64, now: Instant) {
        let speed = (self.hand().speed * FASTER.powf(notches)).clamp(0.1, 5.0);
        self.act(HandCommand::Speed(recordable(speed)), now);
        let cruise = self.flight.setup().scene.cruise_mm_s() * speed;
        self.say(format!("cruise {cruise:.0} mm/s"), now);
    }

    fn hand(&self) -> Hand {
        self.flight.camera().copied().unwrap_or_default()
    }

    /// Pauses or resumes the flight.
    fn switch_pause(&mut self, now: Instant) {
        let paused = !self.hand().paused;
        if !paused {
            self.slices.follow();
        }
        self.act(HandCommand::Pause(paused), now);
    }

    /// Switches to manual control, or back to the last guide.
    fn switch_guide(&mut self, now: Instant) {
        let by_hand = self.flight.setup().scene.guides.iter().find(|g| !g.automatic).map(|g| g.name);
        let next = if self.is_by_hand() { Some(self.last_guide) } else { by_hand };
        if let Some(next) = next {
            self.hand_over(next, now);
        }
    }

    /// Resets the view angle to its initial value.
    fn usual_angle(&mut self, now: Instant) {
        self.change_angle(self.usual_degrees(), now);
    }

    /// Returns the view angle that the present camera starts with, degrees.
    fn usual_degrees(&self) -> f64 {
        if self.is_wide() { USUAL_WIDE } else { self.flight.setup().scene.image.fov_degrees }
    }

    /// True if the fisheye was chosen in the window: the flight itself has another camera.
    fn is_wide(&self) -> bool {
        let own = self.flight.setup().scene.image.camera;
        own != fisheye::MODEL && self.flight.camera::<Picture>().is_some_and(|p| p.camera == fisheye::MODEL)
    }

    /// Looks through a fisheye, or through the flight's own camera again; a flight that has a fisheye gets a perspective camera.
    fn switch_wide_view(&mut self, now: Instant) {
        let image = &self.flight.setup().scene.image;
        let shown = self.flight.camera::<Picture>().map(|p| p.camera);
        let (model, fov_degrees) = match shown == Some(fisheye::MODEL) {
            true if image.camera != fisheye::MODEL => (image.camera, image.fov_degrees),
            true => (CameraModel::default(), USUAL_FLAT),
            false if image.camera == fisheye::MODEL => (image.camera, image.fov_degrees),
            false => (fisheye::MODEL, USUAL_WIDE),
        };
        let command = FlightCommand::Camera { model: model.name.to_owned(), fov_degrees };
        if self.act(command, now) {
            self.say(format!("{} camera, {}", model.name, angle(fov_degrees)), now);
        }
        self.figures.touch();
    }

    /// Turns round and flies back.
    fn reverse(&mut self, now: Instant) {
        if self.act(FlightCommand::Reverse, now) {
            self.say("flying back", now);
        }
    }

    /// Restarts from the other end.
    fn other_end(&mut self, now: Instant) {
        self.act(FlightCommand::OtherEnd, now);
    }

    /// Cancels the tool in use: measuring, a flight to a place, a review. Returns false if there is none.
    pub(crate) fn cancel(&mut self, now: Instant) -> bool {
        let said = if self.measures.is_on() {
            self.measures.switch();
            "measuring is off"
        } else if self.measures_lesions() {
            self.leave_lesions();
            "measuring is off"
        } else if self.travel.take().is_some() {
            "stopped on the way"
        } else if self.flight.tour().is_some() {
            self.switch_review(now);
            return true;
        } else {
            return false;
        };
        self.say(said, now);
        true
    }

    /// Returns what is unfinished, in words: a measurement, a search, a list that is answered in part.
    pub(crate) fn unfinished(&self) -> Option<String> {
        if self.measures.begun().is_some() {
            return Some("A distance has only one end.".to_owned());
        }
        if self.has_unkept() {
            let why = self.unkept.iter().map(|why| format!("{why} "));
            return Some(why.chain(["What you made here is not kept.".to_owned()]).collect());
        }
        if self.reporting.is_working() {
            return Some("The report is not finished.".to_owned());
        }
        let assistant = self.assistant()?;
        if let super::assistant::State::Working(..) = assistant.state() {
            return Some("The search for candidates is not finished.".to_owned());
        }
        let (all, answered) = (assistant.found()?.list.len(), assistant.reading().answered());
        (answered > 0 && answered < all).then(|| format!("{} of {all} candidates are not answered.", all - answered))
    }

    /// Switches to a guide. The fields that it needs are built in the background while the flight continues.
    fn hand_over(&mut self, guide: &'static str, now: Instant) {
        self.planning.stop();
        let begun = self
            .flight
            .setup()
            .scene
            .guides
            .named(guide)
            .and_then(|g| field_job::begin(&self.flight, g, &self.background));
        match begun {
            Some(Ok(planning)) => {
                self.planning.go_over(Ok(planning), now);
                self.say(format!("preparing the guide {guide} ..."), now);
            }
            Some(Err(e)) => self.say(e.to_string(), now),
            None => self.change_guide(guide, now),
        }
    }

    fn change_guide(&mut self, guide: &'static str, now: Instant) {
        self.act(FlightCommand::Guide(guide.to_owned()), now);
        if self.flight.setup().scene.guide_name() == guide {
            if self.flight.setup().scene.is_automatic() {
                self.last_guide = guide;
            }
            self.say(format!("guide: {guide}"), now);
        }
    }

    /// True if the operator flies manually and no guide moves the camera.
    fn is_by_hand(&self) -> bool {
        self.flight.setup().scene.guide().is_some_and(|g| !g.automatic)
    }

    /// Adopts the fields built for a guide, once they are complete.
    fn take_planned(&mut self, now: Instant) {
        match self.planning.take(now) {
            None => {}
            Some(Ok(((guide, fields), _))) => {
                self.flight.adopt(fields);
                self.change_guide(guide, now);
            }
            Some(Err(e)) => self.say(format!("{}: {}", e.what, e.why), now),
        }
    }

    /// Starts to look for the scan without tag once there is a picture, and adopts it once it is found.
    fn take_cleansed(&mut self, now: Instant) {
        let begun = if self.has_shown && self.unflown.is_none() {
            self.cleansing.begin(&self.flight, &self.background, now)
        } else {
            Ok(())
        };
        match begun.and_then(|()| self.cleansing.take(&mut self.flight, now)) {
            Ok(Some(what)) => {
                if !what.is_empty() {
                    output::to_stderr(format_args!("note: {what}"));
                    let how = self.actions.hint("tag", "shows the scan as it is");
                    self.say(format!("{what}{how}"), now);
                } else if self.cleansing.is_shown_as_scanned() {
                    self.say(self.cleansing.shown(), now);
                }
                self.attention = true;
                self.figures.touch();
            }
            Ok(None) => {}
            Err(e) => self.say(format!("{}: {}", e.what, e.why), now),
        }
        self.slices.patch(self.cleansing.other());
    }

    /// True once the first picture was shown and nothing waits for the scan to be its only holder: others may hold it, too.
    pub(crate) fn is_settled(&self) -> bool {
        self.has_shown && self.unflown.is_none() && !self.cleansing.is_waiting()
    }

    /// Goes on as if the first picture had been shown: the other position is compared whether or not it is shown.
    pub(crate) fn count_as_shown(&mut self) {
        self.has_shown = true;
    }

    /// Returns what is known of the scan without tag.
    pub(crate) fn cleansing(&self) -> &Cleansing {
        &self.cleansing
    }

    /// Switches between the scan without tag and the scan as it is.
    fn switch_tag(&mut self, now: Instant) {
        match self.cleansing.switch(&mut self.flight, &self.background, now) {
            Ok(shown) => self.say(shown, now),
            Err(e) => self.say(e.to_string(), now),
        }
        self.slices.patch(self.cleansing.other());
        self.quiet = 0;
    }

    /// Jumps to a share of the bar, 0 to 1: of the colon, from the rectum, once its measure is known, and of the path until then.
    pub(crate) fn seek(&mut self, share: f64, now: Instant) {
        self.quiet = 0;
        self.travel = None;
        let went = match self.place.at_share(&self.flight, share) {
            Some(chosen) => self.go_along(&chosen),
            None => self.flight.act(FlightCommand::Seek(share)),
        };
        if let Err(e) = went {
            self.say(format!("{}: {}; {}", e.what, e.why, e.hint), now);
        }
        self.figures.touch();
    }

    /// Goes to a place of the colon's line and looks along it.
    fn go_along(&mut self, chosen: &Chosen) -> Result<()> {
        if chosen.is_guessed {
            let hint = "click beside it, and read it in the slices";
            return Err(Error::incomplete("place", "the colon has no gas there", hint));
        }
        let plan = &self.flight.setup().plan;
        // A planned way leads through all segments.
        let is_planned = self.flight.camera::<Planned>().is_some();
        if !is_planned && plan.gas.is_none() && plan.segment.is_some_and(|own| own != chosen.segment) {
            self.flight.act(FlightCommand::Segment(chosen.segment))?;
        }
        // As upright as the camera is now.
        let up = self.flight.pose().attitude.up;
        let up = if up.cross(chosen.forward).length() > 0.1 { up } else { chosen.forward.any_orthonormal_vector() };
        self.flight.act(pointing::go_to(Pose { position: chosen.at, attitude: Attitude::new(chosen.forward, up) }))
    }

    /// Names keys as these actions do from now on.
    pub(crate) fn name_keys_by(&mut self, actions: Rc<Actions>) {
        self.actions = actions;
    }

    /// Shows or hides the figures that only a developer needs.
    fn switch_figures(&mut self, now: Instant) {
        let what = if self.figures.switch_all() { "all figures" } else { "speed and guide only" };
        self.say(what, now);
    }

    /// Switches between high and low detail.
    fn switch_detail(&mut self, now: Instant) {
        if let Some(quality) = self.view_renderer.switch_detail(&mut self.flight) {
            self.say(format!("detail: {}", quality.name()), now);
        }
    }

    /// Switches between the endoscope's light and the headlight.
    fn switch_light(&mut self, now: Instant) {
        if let Some(light) = self.view_renderer.switch_light(&mut self.flight) {
            self.say(format!("light: {}", light.name()), now);
        }
    }

    /// Flies the next segment that is not yet flown. If there is none, flies the next segment of all.
    fn next_segment(&mut self, now: Instant) {
        let count = self.flight.setup().lumen.segments.len();
        // The next segment that is not yet flown, otherwise the next of all.
        let here = self.flight.setup().plan.segment.map_or(0, |n| n + 1);
        let unflown = self.flight.survey().unflown();
        let next = unflown.iter().find(|s| s.0 >= here).or(unflown.first()).map_or(here % count.max(1), |s| s.0);
        if count == 0 || self.flight.setup().plan.segment == Some(next) {
            self.say("there is no other segment", now);
            return;
        }
        self.act(FlightCommand::Segment(next), now);
        let ml = self.flight.setup().lumen.segments[next].ml;
        if self.flight.setup().plan.segment == Some(next) {
            self.say(format!("{}: {ml:.0} ml", which_segment(next, count)), now);
        }
    }

    /// Simulates up to `now`.
    ///
    /// # Errors
    /// Returns an error if a replayed command requests something that does not exist.
    pub(crate) fn advance(&mut self, now: Instant) -> Result<()> {
        self.take_planned(now);
        self.take_cleansed(now);
        self.take_found(now);
        self.take_kinds(now);
        self.take_seen(now);
        self.attention |= self.flat.take(now);
        self.take_findings(now);
        self.take_quality(now);
        self.take_report(now);
        for note in self.flight.take_notes() {
            // A message is soon gone, and the last ones are never read.
            if self.reported.insert(note.clone()) {
                output::to_stderr(format_args!("note: {note}"));
            }
            self.say(note, now);
        }
        let Moved { look, roll, zoom, speed } = std::mem::take(&mut self.moved);
        if look != [0.0; 2] {
            self.act(HandCommand::Look(look.map(recordable)), now);
        }
        if roll != 0.0 {
            self.act(HandCommand::Roll(recordable(roll)), now);
        }
        if zoom != 0.0 {
            let degrees = self.flight.camera::<Picture>().map_or(90.0, |p| p.fov_degrees);
            // Round to tenths, so that the same number of notches there and back ends at the initial angle.
            self.change_angle((degrees * NARROWER.powf(zoom) * 10.0).round() / 10.0, now);
        }
        if speed != 0.0 {
            self.change_speed(speed, now);
        }
        self.go_on(now);
        self.look_at_rest(now);
        if self.rests() {
            self.simulated = None;
            return Ok(());
        }
        let elapsed = self.simulated.map_or(Duration::ZERO, |t| now.saturating_duration_since(t));
        self.simulated = Some(now);
        for _ in 0..self.accumulator.take(elapsed, self.flight.clock().hz, STEPS) {
            if let Err(e) = self.flight.step() {
                self.recover(e, now)?;
            }
            self.watch();
        }
        Ok(())
    }

    /// Updates the rest state after a step.
    fn watch(&mut self) {
        let flight = self.flight.flight();
        let hand = self.hand();
        let left_alone = hand.paused || self.unflown.is_some() || flight.state != State::Flying || self.is_by_hand();
        let still = self.flight.camera::<Velocity>().is_none_or(|v| v.0.length() < REST_MM_S)
            && hand.push == DVec3::ZERO
            && hand.turn == DVec3::ZERO;
        self.quiet =
            if left_alone && still && !self.flight.commands.is_replaying() { self.quiet.saturating_add(1) } else { 0 };
    }

    /// Prepares the next frame for a picture of the given size, with these slices beside it. `None` if the shown picture cannot
    /// become better.
    ///
    /// # Errors
    /// Returns status 1 if an image cannot be rendered, which is an internal error.
    pub(crate) fn prepare(
        &mut self,
        window: ImageSize,
        slices: &[(Orientation, [usize; 2])],
        now: Instant,
    ) -> Result<Option<Due>> {
        let hand = self.hand();
        let held = (hand.paused || self.travel.is_some()) && hand.push == DVec3::ZERO;
        self.slices.mark(self.seen.marks(&self.flight));
        let stale = self.slices.show(&mut self.flight, slices, held)?;
        let due = self.view_renderer.prepare(&mut self.flight, window, stale)?;
        self.save_traced(now);
        Ok(due)
    }

    /// Returns the state of the flight for display.
    pub(crate) fn hud(&mut self, now: Instant) -> HudState {
        if self.message.as_ref().is_some_and(|m| now >= m.1) {
            self.message = None;
        }
        let mut figures = self.figures.read(&self.flight, &self.view_renderer, now).to_vec();
        figures.extend(Some(self.cleansing.shown()).filter(|s| !s.is_empty()).map(str::to_owned));
        self.attention = false;
        let flight = self.flight.flight();
        let (state, severity) = self.state(&flight.state);
        let mut more = Vec::new();
        match flight.state {
            State::Operator => {
                more.push(flight.reason);
                let way = |id, what: &str| {
                    Some(self.actions.key(id)).filter(|k| !k.is_empty()).map(|k| format!("{k} {what}"))
                };
                let ways = [way("reverse", "turns round"), way("next", "flies to the next segment")];
                let ways = std::iter::once("Steer by hand".to_owned()).chain(ways.into_iter().flatten());
                more.push(format!("{}.", ways.collect::<Vec<_>>().join(", ")));
            }
            State::Arrived => {
                let next = self.actions.hint("next", "flies to the next");
                more.extend(headless::unflown_text(&self.flight).map(|t| t + &next));
            }
            State::Flying if self.hand().paused => {
                let key = self.actions.key("pause");
                more.extend(Some(format!("{key} flies on.")).filter(|_| !key.is_empty()));
            }
            State::Flying | State::Ended => {}
        }
        let (share, length) = self.flight.survey().progress();
        let along = share * length;
        // The first picture comes first, and the tag is taken out of a volume that nothing else holds.
        if self.has_shown && self.unflown.is_none() && !self.cleansing.is_waiting() {
            self.place.update(&self.flight, &self.background, now);
        }
        let (marks_drawn, fault) = self.overlays.draw(&self.flight, self.scale);
        if let Some(e) = fault {
            self.report_fault(&e, now);
        }
        HudState {
            state,
            severity,
            more,
            figures,
            directions: Directions::of(&self.flight.pose().attitude),
            bar: self.bar(),
            // Until the measure along the colon is known, the distance flown: its length is approximate, so it is rounded.
            place: self.place.text(&self.flight).map(|place| self.with_time(place)).unwrap_or_else(|| {
                let mm =
                    format!("{:.0} of about {:.0} mm", (along / 10.0).round() * 10.0, (length / 10.0).round() * 10.0);
                self.figures.part().map_or(mm.clone(), |part| format!("{part}, {mm}"))
            }),
            message: self.message.as_ref().map(|m| &m.0).or(self.pictureless.as_ref()).cloned(),
            keys: self.actions.short_help(),
            marks_drawn,
        }
    }

    /// Returns the bar: along the colon once its measure is known, and along the path flown until then.
    fn bar(&self) -> Bar {
        self.place.bar(&self.flight).unwrap_or_else(|| {
            let camera = self.figures.per_mille();
            let calls = self.flight.survey().trail().map_or(&[][..], Trail::calls);
            let calls = calls.iter().map(|m| (m * 1000.0).round() as u32).collect();
            Bar { camera, read: vec![[0, camera]], calls, ..Bar::default() }
        })
    }

    fn state(&self, state: &State) -> (String, Severity) {
        let (text, severity) = match state {
            _ if self.unflown.is_some() => ("no flight", Severity::Notice),
            State::Operator => ("operator needed", Severity::Alert),
            // Who flies by hand goes on after an arrival.
            State::Arrived if self.is_by_hand() => ("manual", Severity::Notice),
            State::Arrived => ("arrived", Severity::Normal),
            State::Ended => ("time is over", Severity::Normal),
            State::Flying if self.hand().paused => ("paused", Severity::Notice),
            State::Flying if self.is_by_hand() => ("manual", Severity::Notice),
            State::Flying if self.flight.setup().scene.play().is_some() => ("replaying a log", Severity::Normal),
            State::Flying if self.flight.clock().tick < self.hand().on_until => ("manual input", Severity::Notice),
            State::Flying => ("flying", Severity::Normal),
        };
        (text.to_owned(), severity)
    }
}

/// Rounds a number to at most nine decimals. Its text is then so short that every reader parses the same value, and recorded
/// operator input is repeated bit for bit.
fn recordable(x: f64) -> f64 {
    (x * 1e9).round() / 1e9
}

#[cfg(test)]
#[path = "controller_tests.rs"]
pub(crate) mod tests;
