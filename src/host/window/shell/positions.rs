//! The patient's other position: opened beside the first one, shown, and worked in instead.

use std::time::Instant;

use glam::DVec3;

use super::open_scan::{OpenScan, Placed, Stage};
use super::{Ready, Shell};
use crate::components::camera::Pose;
use crate::components::input::HandCommand;
use crate::error::Result;
use crate::fields::matching::Side;
use crate::host::window::contract::{Beside, WindowView};
use crate::host::window::controller::FlightController;
use crate::host::window::framebuffer::Framebuffer;
use crate::host::window::intent::{ActionContext, Intent, SliceInput};
use crate::host::window::interface::WindowSize;
use crate::host::window::keeping::Keeping;
use crate::host::window::keys::HeldKeys;
use crate::host::window::overlay::Content;
use crate::host::window::pairing::{Pairing, Position};
use crate::host::window::stroke::Pressed;
use crate::host::window::{Asked, Resume, unflown};
use crate::output;

/// What is said where a second position is needed.
const NONE: &str = "there is no other position: open one in the panel Second position";
/// Places within this of each other are those of one finding, mm: more than any rounding in files.
const SAME_MM: f64 = 0.5;

impl Shell {
    /// Opens a scan as the patient's second position, instead of the one that is open as such.
    pub(super) fn open_second(&mut self, asked: Asked) {
        let is_second = self.scan.is_second;
        let asked = Asked { beside: self.scan.input.clone().map(|path| (path, self.scan.series)), ..asked };
        let opened = (self.open)(asked).and_then(|opening| OpenScan::load(opening, false, &self.proxy));
        match opened {
            Ok(mut scan) => {
                let mut closed = Ok(());
                if let Some(mut before) = self.other.take() {
                    closed = before.close(&mut None);
                }
                if let Err(e) = closed {
                    output::to_stderr(format_args!("{e}"));
                    self.outcome = std::mem::replace(&mut self.outcome, Ok(())).and(Err(e));
                }
                // Beside the second one, it takes the place of the first.
                scan.is_second = !is_second;
                self.other = Some(scan);
            }
            Err(e) => self.say(e.to_string()),
        }
        self.touched = true;
    }

    fn say(&mut self, text: String) {
        match &mut self.scan.stage {
            Stage::Flying(c) => c.say(text, Instant::now()),
            Stage::Loading(_) | Stage::Failed(_) | Stage::Over => output::to_stderr(format_args!("note: {text}")),
        }
    }

    /// Opens the second position that the window was asked for, and handles the end of its loading.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start threads.
    pub(super) fn take_off_other(&mut self) -> Result<()> {
        if matches!(self.scan.stage, Stage::Flying(_))
            && let Some(asked) = self.second.take()
        {
            self.open_second(asked);
        }
        let Some(mut other) = self.other.take() else { return Ok(()) };
        let loaded = if let Stage::Loading(loading) = &mut other.stage { loading.take() } else { None };
        let landed = match loaded {
            Some(Ok(ready)) => self.land(&mut other, ready),
            Some(Err(e)) => {
                other.stage = Stage::Failed(e);
                Ok(())
            }
            None => Ok(()),
        };
        self.other = Some(other);
        self.touched = true;
        landed
    }

    /// Lets the flight through the other position wait where it begins, or was left.
    fn land(&mut self, other: &mut OpenScan, ready: Ready) -> Result<()> {
        let Ready { mut flight, session, notes, unflown, is_whole, is_anew } = ready;
        notes.iter().for_each(|note| output::to_stderr(format_args!("note: the other position: {note}")));
        if is_anew && other.resume == Resume::Everything {
            other.resume = Resume::Nothing;
        }
        let now = Instant::now();
        let is_guided = flight.setup().scene.guide().is_some();
        let mut keeping = Keeping::of(session, other.resume, is_guided, now);
        keeping.reads_whole(is_whole);
        keeping.resume(&mut flight, other.resume);
        let mut controller = self.controller(flight, self.overlays.clone(), other)?;
        keeping.equip(&mut controller);
        let warned = keeping.warning();
        warned.iter().for_each(|w| output::to_stderr(format_args!("note: the other position: {w}")));
        other.keeping = Some(keeping);
        match unflown {
            Some(unflown) => {
                controller.rest(unflown::in_words(&unflown.why), now);
                other.unflown = Some(unflown);
            }
            // It waits for the reader.
            None => controller.flight_mut().act(HandCommand::Pause(true)).unwrap_or(()),
        }
        controller.count_as_shown();
        other.stage = Stage::Flying(Box::new(controller));
        Ok(())
    }

    /// Works in the patient's other position from now on: keys, lists and slices are its own.
    ///
    /// # Errors
    /// Returns status 1 if the picture cannot be shown.
    pub(super) fn work_in_other(&mut self, now: Instant) -> Result<()> {
        let said = match self.other.as_ref().map(|other| &other.stage) {
            Some(Stage::Flying(_)) => None,
            Some(Stage::Loading(_)) => Some("the other position is being read"),
            Some(Stage::Failed(_) | Stage::Over) => Some("the other position could not be read"),
            None => Some(NONE),
        };
        let (Some(other), None) = (&mut self.other, said) else {
            self.say(said.unwrap_or_default().to_owned());
            return Ok(());
        };
        let (mut framebuffer, shows_both) = (None, self.workspace.shows("second"));
        if let Stage::Flying(c) = &mut self.scan.stage {
            c.steer(HeldKeys::let_go, now);
            // Nobody looks where it would fly.
            if !shows_both {
                c.wait(now);
            }
            framebuffer = c.flight_mut().views().take_presenter::<Framebuffer>();
        }
        self.pressed = Pressed::default();
        std::mem::swap(&mut self.scan, other);
        let presented = (std::mem::take(&mut other.placed).presented, std::mem::take(&mut self.scan.placed).presented);
        (other.placed, self.scan.placed) = (
            Placed { presented: presented.0, ..Placed::default() },
            Placed { presented: presented.1, ..Placed::default() },
        );
        let position = which(&self.scan);
        if let (Some(mut framebuffer), Stage::Flying(c)) = (framebuffer, &mut self.scan.stage) {
            framebuffer.forget_pictures();
            if let Some(shown) = other.picture(Beside::Other) {
                framebuffer.show_beside(Beside::Other, shown);
            }
            let camera = c.flight().app().camera_id();
            c.flight_mut().views().present_to(camera, framebuffer)?;
            c.say(format!("working in the {position} position"), now);
        }
        if let Some(window) = &self.window {
            window.set_title(&self.scan.title());
        }
        self.touched = true;
        self.ask_for_picture();
        Ok(())
    }

    /// Returns which position is worked in.
    fn side(&self) -> Side {
        if self.scan.is_second { Side::B } else { Side::A }
    }

    /// Returns the flights through both positions, in the order of sides.
    fn flights(&self) -> Option<[&FlightController; 2]> {
        let (Stage::Flying(own), Some(Stage::Flying(other))) =
            (&self.scan.stage, self.other.as_ref().map(|other| &other.stage))
        else {
            return None;
        };
        Some(if self.side() == Side::A { [own, other] } else { [other, own] })
    }

    /// Returns the flight that is worked in and the other one.
    fn own_and_other(&mut self) -> Option<(&mut FlightController, &mut FlightController)> {
        let (Stage::Flying(own), Some(Stage::Flying(other))) =
            (&mut self.scan.stage, self.other.as_mut().map(|other| &mut other.stage))
        else {
            return None;
        };
        Some((own, other))
    }

    /// Returns the poses of both cameras, in the order of sides.
    fn poses(&self) -> Option<[Pose; 2]> {
        Some(self.flights()?.map(|c| c.flight().pose()))
    }

    /// Returns the places that are pointed at, world mm, in the order of sides.
    fn cursors(&self) -> Option<[Option<DVec3>; 2]> {
        Some(self.flights()?.map(|c| c.slices().cursor()))
    }

    /// Compares the positions as soon as both are there, and lets the other one follow if they are flown together.
    fn pair(&mut self, now: Instant) {
        if self.other.is_none() {
            return;
        }
        let (side, was_known) = (self.side(), self.pairing.why_not().is_none());
        // Taken out, since it looks at both flights.
        let mut pairing = std::mem::replace(&mut self.pairing, Pairing::new(now));
        let positions = self.flights().map(|flights| {
            flights.map(|c| Position {
                flight: c.flight(),
                found: c.document().found(),
                assistant: c.assistant(),
                is_settled: c.is_settled(),
            })
        });
        let is_new = positions.is_some_and(|positions| pairing.advance(positions, &self.background, now));
        if let Some((own, other)) = self.own_and_other()
            && is_new
        {
            own.raise(pairing.twice(side));
            other.raise(pairing.twice(side.other()));
        }
        self.pairing = pairing;
        self.touched |= is_new;
        if is_new {
            self.tell_reports();
        }
        if is_new && !was_known && self.pairing.why_not().is_none() {
            // Readers expect both to move.
            self.pairing.is_linked = true;
            let how = self.actions.hint("same-place", "goes to the same place in the other");
            self.say(format!("both positions are compared and fly together{how}"));
        } else if is_new && let Some(why) = self.pairing.why_not().filter(|_| self.pairing.next().is_none()) {
            self.say(why);
        }
        self.mend_pairs(now);
        self.follow_in_other(now);
    }

    /// Lets the reports of each position tell of the other, if that is a scan of its own.
    fn tell_reports(&mut self) {
        let of = |scan: &OpenScan| {
            let Stage::Flying(c) = &scan.stage else { return None };
            // A study with several series has no path for one of them.
            let path = scan.input.clone().filter(|_| scan.series.is_none())?;
            Some((path, c.document().found().scan.clone()))
        };
        let (own, other) = (of(&self.scan), self.other.as_ref().and_then(of));
        if let Some((here, there)) = self.own_and_other() {
            here.report_with(other);
            there.report_with(own);
        }
    }

    /// Lets the other position's camera stand where that of the one that is worked in is.
    fn follow_in_other(&mut self, now: Instant) {
        if !self.pairing.is_linked {
            return;
        }
        let (side, poses) = (self.side(), self.poses());
        let Some(poses) = poses.filter(|poses| !self.pairing.stands(*poses)) else { return };
        let own = poses[side as usize];
        let Some((there, found)) = self.pairing.pose(side, &own) else { return };
        // As steady as the flight: what belongs together changes from row to row.
        let there = self.pairing.steadied(there, &poses[side.other() as usize], now);
        if let Some((_, other)) = self.own_and_other() {
            other.stand(&there, found.on_line(), now);
        }
        if let Some(poses) = self.poses() {
            self.pairing.stand_if_still(poses, &there, side);
        }
    }

    /// True while the camera of the other position has not come to where it belongs.
    fn is_other_behind(&self) -> bool {
        let side = self.side();
        let is_behind =
            |poses: [Pose; 2]| !self.pairing.stands(poses) && self.pairing.pose(side, &poses[side as usize]).is_some();
        self.pairing.is_linked && self.poses().is_some_and(is_behind)
    }

    /// Flies both positions together, or stops that.
    pub(super) fn link(&mut self, now: Instant) {
        if self.other.is_none() {
            return self.say(NONE.to_owned());
        }
        if let Some(why) = self.pairing.why_not() {
            return self.say(why);
        }
        self.pairing.is_linked = !self.pairing.is_linked;
        let said = if self.pairing.is_linked { "both positions fly together" } else { "each position flies alone" };
        self.say(said.to_owned());
        self.follow_in_other(now);
        self.touched = true;
    }

    /// Goes to the same place in the other position, and works there.
    ///
    /// # Errors
    /// Returns status 1 if the picture cannot be shown.
    pub(super) fn same_place(&mut self, now: Instant) -> Result<()> {
        let why_not = if self.other.is_none() { Some(NONE.to_owned()) } else { self.pairing.why_not() };
        if let Some(why) = why_not {
            self.say(why);
            return Ok(());
        }
        let side = self.side();
        let Some(poses) = self.poses() else { return Ok(()) };
        let Some(cursors) = self.cursors() else { return Ok(()) };
        let (cursor, own) = (cursors[side as usize], poses[side as usize]);
        let Some((pose, found)) = self.pairing.pose(side, &own) else {
            self.say("the camera is nowhere along the colon".to_owned());
            return Ok(());
        };
        // A place that is pointed at is pointed at in the other, too.
        let place = cursor.and_then(|place| self.pairing.expect(side, place)).map(|e| e.place);
        // Back where it was: there and back again leads to the same place.
        let is_there = self.pairing.stands(poses) && (cursor.is_none() || self.pairing.points(cursors));
        let gap = if found.is_gap { "; collapsed in one of them: a guess" } else { "" };
        let told = format!("same place: {:.0} ± {:.0} mm{gap}", found.along_mm, found.uncertainty_mm.ceil());
        if let Some((_, other)) = self.own_and_other().filter(|_| !is_there)
            && !other.arrive(&pose, found.on_line(), place, now)
        {
            self.say("the camera does not fit there in the other position".to_owned());
            return Ok(());
        }
        self.work_in_other(now)?;
        if let (Some(poses), Some(cursors)) = (self.poses(), self.cursors()) {
            self.pairing.stand(poses);
            self.pairing.point(cursors);
        }
        self.say(told);
        Ok(())
    }

    /// Returns the number of findings of the position that is worked in.
    pub(super) fn count_findings(&self) -> usize {
        if let Stage::Flying(c) = &self.scan.stage { c.document().found().findings.len() } else { 0 }
    }

    /// Takes a finding that was just marked for that of the other position which is expected there: one finding with two places. There were
    /// `before` findings.
    pub(super) fn pair_new_finding(&mut self, before: usize, now: Instant) {
        let side = self.side();
        let Some(flights) = self.flights() else { return };
        let [own, other] = [side, side.other()].map(|s| flights[s as usize].document().found());
        let Some(new) = own.findings.last().filter(|_| own.findings.len() > before).cloned() else { return };
        let Some(same) = self.pairing.same_finding(side, new.place, other) else { return };
        let same = other.findings[same].clone();
        let scans = [own.scan.clone(), other.scan.clone()];
        if let Some((own, other)) = self.own_and_other() {
            own.pair_finding(&new, Some(same.place), &scans[1], now);
            other.pair_finding(&same, Some(new.place), &scans[0], now);
            let part = "the panel Findings parts them";
            own.say(format!("finding {} is finding {} of the other position; {part}", new.id, same.id), now);
        }
        self.touched = true;
    }

    /// Takes a finding, or the chosen one, and the chosen one of the other position for one finding with two places.
    pub(super) fn join_findings(&mut self, n: Option<usize>, now: Instant) {
        let Some((own, other)) = self.own_and_other() else { return self.say(NONE.to_owned()) };
        let [own_found, other_found] = [own.document().found().clone(), other.document().found().clone()];
        let finding = n.or(own.current_finding()).and_then(|n| own_found.findings.get(n));
        let same = other.current_finding().and_then(|n| other_found.findings.get(n));
        let (Some(finding), Some(same)) = (finding, same) else {
            return own.say("choose a finding in each position first", now);
        };
        if let Some(paired) = [finding, same].into_iter().find(|f| f.other.is_some()) {
            return own.say(format!("finding {} is in both positions already: part it first", paired.id), now);
        }
        own.pair_finding(finding, Some(same.place), &other_found.scan, now);
        other.pair_finding(same, Some(finding.place), &own_found.scan, now);
        own.say(format!("finding {} is finding {} of the other position", finding.id, same.id), now);
        self.touched = true;
    }

    /// Parts a finding from that of the other position.
    pub(super) fn part_finding(&mut self, n: Option<usize>, now: Instant) {
        let Some((own, other)) = self.own_and_other() else { return self.say(NONE.to_owned()) };
        let [own_found, other_found] = [own.document().found().clone(), other.document().found().clone()];
        let chosen = n.or(own.current_finding()).and_then(|n| own_found.findings.get(n));
        let Some((finding, place)) = chosen.and_then(|f| Some((f, f.other?))) else {
            return own.say("no finding is chosen that is in both positions", now);
        };
        own.pair_finding(finding, None, &other_found.scan, now);
        if let Some(same) = other_found.findings.iter().find(|f| f.place.distance(place) < SAME_MM) {
            other.pair_finding(same, None, &own_found.scan, now);
        }
        own.say(format!("finding {} is parted from that of the other position", finding.id), now);
        self.touched = true;
    }

    /// Parts findings whose counterpart in the other position was deleted.
    fn mend_pairs(&mut self, now: Instant) {
        if let Some((own, other)) = self.own_and_other() {
            part_from_gone(own, other, now);
            part_from_gone(other, own, now);
        }
    }

    /// Does what a panel of the other position wants. What concerns the window itself is left out.
    pub(super) fn execute_in_other(&mut self, intent: Intent, now: Instant) {
        let at = ActionContext { window: self.scan.placed.other(), now };
        // It is looked at apart.
        if matches!(intent, Intent::Slice(SliceInput::Click(_) | SliceInput::Point(_) | SliceInput::SetOut(_))) {
            self.pairing.is_linked = false;
        }
        if let Some((_, other)) = self.own_and_other() {
            other.execute(intent, at);
        }
        self.touched = true;
    }

    /// Returns what there is of the other position, for panels: where the place of the one that is worked in is expected, too.
    pub(super) fn other_content(&mut self, size: WindowSize, now: Instant) -> Option<Content> {
        let side = self.side();
        let own = self.poses().map(|poses| poses[side as usize]);
        let found = own.and_then(|pose| self.pairing.place(side, pose.position));
        let (waits, is_linked) = (self.pairing.why_not(), self.pairing.is_linked);
        let other = self.other.as_mut()?;
        let mut content = other.content(Some(size), now)?;
        if let (Content::Flight(hud), Stage::Flying(c)) = (&mut content, &other.stage) {
            let told = match (&found, waits) {
                (_, Some(why)) => why,
                (Some(found), None) => {
                    let reach = [-found.uncertainty_mm, found.uncertainty_mm].map(|by| found.along_mm + by);
                    hud.bar.expected = c.stretch(reach);
                    let gap = if found.is_gap { ", collapsed: a guess" } else { "" };
                    format!("same place: {:.0} ± {:.0} mm{gap}", found.along_mm, found.uncertainty_mm.ceil())
                }
                (None, None) => "nowhere along the colon".to_owned(),
            };
            if is_linked {
                hud.state = "linked".to_owned();
                // It does not fly by itself.
                hud.figures.retain(|line| !line.contains("mm/s") && !line.starts_with("guide "));
            }
            hud.more = vec![told];
            hud.keys.clear();
        }
        Some(content)
    }

    /// Lets the other position go on if it is shown, and renders its picture if that is new. `is_busy` tells whether the picture of the
    /// position that is worked in is rendered, too: they share the time of a frame. Returns true for a new picture.
    ///
    /// # Errors
    /// As [`FlightController::advance`](crate::host::window::controller::FlightController::advance).
    pub(super) fn other_picture(&mut self, is_busy: bool, now: Instant) -> Result<bool> {
        self.pair(now);
        let (size, slices) = (self.scan.placed.other(), self.scan.placed.other_slices());
        let Some(Stage::Flying(c)) = self.other.as_mut().map(|other| &mut other.stage) else { return Ok(false) };
        c.advance(now)?;
        let mut is_new = false;
        if size.pixels() > 0 || !slices.is_empty() {
            c.share_frames(is_busy);
            if let Some(due) = c.prepare(size, &slices, now)? {
                is_new = true;
                c.show(Some(due))?;
            }
        }
        if let Stage::Flying(own) = &mut self.scan.stage {
            own.share_frames(is_new && size.pixels() > 0);
        }
        Ok(is_new)
    }

    /// Returns when work is due for the other position, if it is shown.
    pub(super) fn next_of_other(&self) -> Option<Instant> {
        let is_shown = !self.scan.placed.beside_at.is_empty();
        if is_shown && self.is_other_behind() {
            return Some(self.due);
        }
        match self.other.as_ref().map(|other| &other.stage)? {
            Stage::Loading(_) => Some(self.due),
            Stage::Flying(c) if !is_shown || c.rests() => c.next().into_iter().chain(self.pairing.next()).min(),
            Stage::Flying(_) => Some(self.due),
            Stage::Failed(_) | Stage::Over => None,
        }
    }
}

impl OpenScan {
    /// Returns what there is of it, for panels.
    pub(super) fn content(&mut self, size: Option<WindowSize>, now: Instant) -> Option<Content> {
        match &mut self.stage {
            Stage::Loading(loading) => Some(loading.content()),
            Stage::Failed(e) => Some(Content::Failed { text: unflown::failed_in_words(e) }),
            Stage::Flying(controller) => {
                if let Some(size) = size {
                    controller.scaled(size.pixels_a_point());
                }
                Some(Content::Flight(Box::new(controller.hud(now))))
            }
            Stage::Over => None,
        }
    }
}

/// Parts a finding of one position whose counterpart in the other one was deleted.
fn part_from_gone(mine: &mut FlightController, theirs: &FlightController, now: Instant) {
    let (found, others) = (mine.document().found(), theirs.document().found());
    let is_gone = |at: DVec3| !others.findings.iter().any(|f| f.place.distance(at) < SAME_MM);
    let is_theirs = found.second.as_ref() == Some(&others.scan);
    if let Some(alone) = found.findings.iter().find(|f| is_theirs && f.other.is_some_and(is_gone)).cloned() {
        mine.pair_finding(&alone, None, &others.scan, now);
    }
}

/// Names a position.
fn which(scan: &OpenScan) -> &'static str {
    if scan.is_second { "second" } else { "first" }
}
