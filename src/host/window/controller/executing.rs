//! Executes what the operator wants, and tells what is possible now.

use std::time::Instant;

use super::FlightController;
use crate::app::FlightApp;
use crate::app::overlays::translucency::move_lens;
use crate::components::flight::State;
use crate::host::window::assistant::Assistant;
use crate::host::window::contract::WindowView;
use crate::host::window::document::Document;
use crate::host::window::finding_tool::FindingTool;
use crate::host::window::flat::Flat;
use crate::host::window::intent::{ActionContext, FindingOf, Intent, WhyNot};
use crate::host::window::kinds::Kinds;
use crate::host::window::measures::Measures;
use crate::host::window::quality::QualityTool;
use crate::host::window::reporting::Reporting;
use crate::host::window::seen::Seen;
use crate::host::window::slices::Slices;

impl FlightController {
    /// Does what is wanted, or tells why it is not possible. Returns what is left for the window to do. Keys that are held are for
    /// [`FlightController::steer`].
    pub(crate) fn execute(&mut self, intent: Intent, at: ActionContext) -> Option<Intent> {
        use Intent as I;
        let now = at.now;
        self.quality.stir(now);
        if self.refuse(&intent, now) {
            return None;
        }
        let mut left = None;
        match intent {
            I::Hold(_) | I::Gesture => return None,
            // A pointer's movements are many, and take effect with the next step.
            I::Look([right, down]) => {
                self.drag((right, down), at.window);
                return None;
            }
            I::Roll(right) => {
                self.roll(right, at.window);
                return None;
            }
            I::Zoom(notches) => {
                self.zoom(notches);
                return None;
            }
            I::Speed(notches) => {
                self.change_speed_by(notches);
                return None;
            }
            I::Slice(input) => return self.slice(input, now),
            I::Pause => self.switch_pause(now),
            I::Reverse => self.reverse(now),
            I::NextSegment => self.next_segment(now),
            I::OtherEnd => self.other_end(now),
            I::SwitchGuide => self.switch_guide(now),
            I::Guide(guide) => self.hand_over(guide, now),
            I::UsualAngle => self.usual_angle(now),
            I::WideView => self.switch_wide_view(now),
            I::Seek(share) => self.seek(share, now),
            I::Click(pixel) => self.click(pixel, now),
            I::LookAt(pixel) => self.look_at(pixel, now),
            I::Command(command) => self.command(command, now),
            I::Figures => self.switch_figures(now),
            I::Detail => self.switch_detail(now),
            I::Light => self.switch_light(now),
            I::Tag => self.switch_tag(now),
            I::Overlay(n) => self.switch_overlay(n, now),
            I::MoveLens(to) => move_lens(&mut self.flight, to),
            I::Greys(level, width) => self.slices.window(level, width),
            I::Slab => self.slices.next_slab(),
            I::SlabKind => self.slices.next_slab_kind(),
            I::ResetSlices => self.slices.reset(&mut self.flight),
            I::Measure => self.switch_measuring(now),
            I::DeleteMeasure(n) => self.measures.delete(n),
            I::DeleteLast => self.measures.delete_last(),
            I::Undo => self.undo(now),
            I::Search => self.asked_assistant(now).retry(now),
            I::CancelSearch => self.asked_assistant(now).cancel(),
            I::Select(n) => self.select(n, now),
            I::Step(forward) => self.step(forward, now),
            I::Show(showing) => self.asked_assistant(now).reading_mut().show(showing),
            I::Answer(answer) => self.answer(answer, now),
            I::Note(n, note) => {
                let assistant = self.asked_assistant(now);
                assistant.reading_mut().note(n, note);
                assistant.tell(String::new());
            }
            I::UndoAnswer => self.undo_answer(now),
            I::Mark => {
                let assistant = self.asked_assistant(now);
                assistant.is_marking = !assistant.is_marking;
            }
            I::MeasureLesion => self.switch_lesions(now),
            I::ForgetLesion => self.asked_assistant(now).forget_measured(),
            I::LoadAnswers(path) => self.asked_assistant(now).load(&path),
            I::Finding(of) => self.mark_finding(of, now),
            I::VisitFinding(n) => self.visit_finding(n, now),
            I::EditFinding(n, edit) => self.edit_finding(n, edit, now),
            I::MoveEnd(n, which, to) => self.move_end(n, which, to, now),
            I::MeasureFinding(n) => self.measure_finding(n, now),
            I::DeleteFinding(n) => self.delete_finding(n, now),
            I::DrawFindings => self.findings.order_missing(&self.document.found().findings),
            I::Quality => self.quality.want(),
            I::Report => self.write_report(now),
            I::SendReport(archive) => self.send_report(archive, now),
            I::CancelReport => self.reporting.cancel(),
            I::Outside => self.mark_outside(now),
            I::EditOutside(n, category, text) => self.edit_outside(n, category, text, now),
            I::DeleteOutside(n) => self.delete_outside(n, now),
            I::Kinds => {
                self.show_kinds(!self.kinds.is_shown(), now);
                left = Some(I::Kinds);
            }
            I::Kind(kind) => self.tell_kind(kind, now),
            I::Coverage => {
                self.show_seen(!self.seen.is_painted(), now);
                left = Some(I::Coverage);
            }
            I::ListMissed => self.list_missed(now),
            I::Flat(input) => return self.flat_input(input, now),
            I::VisitMissed(n) => self.visit_missed(n, now),
            I::NextMissed => self.next_missed(now),
            I::Review => self.switch_review(now),
            I::Picture => self.take_screenshot(at),
            I::Say(text) => self.say_for(&text, now),
            I::Screenshot
            | I::Action(_)
            | I::Own(_)
            | I::Open(..)
            | I::OpenSecond(..)
            | I::OtherPosition
            | I::OfOther(_)
            | I::SamePlace
            | I::Link
            | I::PartFinding(_)
            | I::JoinFindings(_)
            | I::StartAt(_)
            | I::Whole
            | I::Files
            | I::Fullscreen
            | I::Help
            | I::Layout(_)
            | I::Panel(_)
            | I::Cancel
            | I::Quit => return Some(intent),
        }
        self.note_changes(now);
        self.attention = true;
        self.figures.touch();
        left
    }

    /// Tells why something is not possible. Returns false if it is.
    fn refuse(&mut self, intent: &Intent, now: Instant) -> bool {
        let Some(why) = self.why_not(intent) else { return false };
        let text = self.actions.that_wants(intent).map(|action| format!("{} is unavailable: {why}", action.text));
        self.say(text.unwrap_or_else(|| why.into_owned()), now);
        true
    }

    /// Checks whether something is possible now. The error states why not.
    fn may(&self, intent: &Intent) -> Result<(), WhyNot> {
        use Intent as I;
        match intent {
            I::Pause | I::Zoom(_) | I::UsualAngle | I::WideView | I::Speed(_) | I::Detail | I::Light | I::Picture => {
                self.may_fly()
            }
            I::Reverse | I::NextSegment | I::OtherEnd | I::SwitchGuide | I::Whole => self.may_fly_itself(),
            I::Tag => self.cleansing.may_switch().map_err(Into::into),
            I::Greys(..) | I::Slab | I::SlabKind | I::ResetSlices if !self.shows_slices() => {
                Err("no slice is shown".into())
            }
            I::Step(_) | I::Answer(_) | I::Mark | I::MeasureLesion => self.may_read(),
            I::Kind(_) => self.kinds.may_tell().map_err(Into::into),
            I::NextMissed => self.may_see_missed(),
            // A replayed log knows no tour.
            I::Review => self.may_fly_itself().and_then(|()| self.may_see_missed()),
            I::Report => self.reporting.why_not().map_or(Ok(()), |why| Err(why.into())),
            I::SendReport(n) => self.reporting.why_not_sent(*n).map_or(Ok(()), |why| Err(why.into())),
            I::Finding(FindingOf::Measured) if !self.has_measured() => Err("nothing is measured".into()),
            I::MeasureFinding(None) | I::DeleteFinding(None) | I::PartFinding(None) | I::JoinFindings(None)
                if self.chosen_finding().is_none() =>
            {
                Err("no finding is chosen".into())
            }
            I::UndoAnswer if !self.document.may_undo_answers() => Err("no answer was changed".into()),
            I::Own(n) => self.own.why_not(*n, &self.flight).map_or(Ok(()), Err),
            _ => Ok(()),
        }
    }

    /// Refuses what a replayed log, or a scan without a flight, cannot follow.
    fn may_fly_itself(&self) -> Result<(), WhyNot> {
        if self.flight.setup().scene.play().is_some() { Err("a log is replayed".into()) } else { self.may_fly() }
    }
}

impl WindowView for FlightController {
    fn flight(&self) -> &FlightApp {
        &self.flight
    }

    fn slices(&self) -> &Slices {
        &self.slices
    }

    fn measures(&self) -> &Measures {
        &self.measures
    }

    fn assistant(&self) -> Option<&Assistant> {
        self.assistant.as_deref()
    }

    fn document(&self) -> &Document {
        &self.document
    }

    fn findings(&self) -> &FindingTool {
        &self.findings
    }

    fn quality(&self) -> &QualityTool {
        &self.quality
    }

    fn reporting(&self) -> &Reporting {
        &self.reporting
    }

    fn segment_here(&self) -> Option<&'static str> {
        self.place.part()
    }

    fn seen(&self) -> &Seen {
        &self.seen
    }

    fn flat(&self) -> &Flat {
        self.own_flat()
    }

    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn unflown(&self) -> Option<&str> {
        self.unflown.as_deref()
    }

    fn has_marks(&self) -> bool {
        let measures = !self.measures.list().is_empty() || self.measures.begun().is_some();
        let lesions = self.assistant().is_some_and(|a| a.is_marking || a.measured().is_some());
        let found = self.document.found();
        let findings = !found.findings.is_empty() || !found.outside.is_empty();
        measures || lesions || findings || self.slices.cursor().is_some()
    }

    fn is_on(&self, intent: &Intent) -> bool {
        match intent {
            Intent::Pause => {
                let goes_on = self.is_by_hand() || self.flight.flight().state != State::Arrived;
                self.unflown.is_none() && self.hand().paused && goes_on
            }
            Intent::Measure => self.measures.is_on(),
            Intent::Figures => self.figures.are_all(),
            Intent::MeasureLesion => self.measures_lesions(),
            // The paint stays until it is taken off again.
            Intent::Coverage => self.seen.is_painted(),
            _ => false,
        }
    }

    fn why_not(&self, intent: &Intent) -> Option<WhyNot> {
        self.may(intent).err()
    }
}
