//! Findings in a flight: marked where the reader points, corrected, and gone to.

use std::time::Instant;

use glam::DVec3;

use super::FlightController;
use super::pointing::go_to;
use crate::app::findings::{Finding, Outside, View, wall_near};
use crate::components::camera::Pose;
use crate::components::input::FlightCommand;
use crate::components::output::Picture;
use crate::host::window::contract::WindowView;
use crate::host::window::document::Stroke;
use crate::host::window::finding_tool::{Made, Scans};
use crate::host::window::intent::{EndAt, FindingEdit, FindingOf};
use crate::polyps::Measurement;
use crate::space::first_crossing;

/// A place this much before the wall that hides it is seen, mm.
const SEEN_MM: f64 = 0.5;
/// The view angle of a finding's view if it was made with another camera than a perspective one, degrees.
const USUAL_DEGREES: f64 = 90.0;
/// Where the lumen is sought before a wall, mm.
const BEFORE_MM: [f64; 4] = [1.0, 2.0, 3.0, 5.0];
/// Places within this of each other are the same, mm: a file keeps no more digits.
const AGAIN_MM: f64 = 1e-6;
/// A candidate within this of where all views point is what is pointed at, mm.
const SAME_MM: f64 = 0.5;

impl FlightController {
    /// Marks a finding.
    pub(super) fn mark_finding(&mut self, of: FindingOf, now: Instant) {
        let (mut finding, measured) = match self.new_finding(of) {
            Ok(made) => made,
            Err(why) => return self.say(why, now),
        };
        if let Some(id) = self.marked_at(&finding) {
            self.say(format!("finding {id} is here already"), now);
            return self.findings.choose(Some(id));
        }
        if let Some(measured) = &measured {
            finding.measure(measured);
        }
        finding.id = self.document.found().new_id();
        finding.view = self.view_of(finding.place);
        self.locate(&mut finding);
        let (id, place, measures) = (finding.id.clone(), finding.place, finding.ends.is_none());
        let told = format!("finding {id}{}", place_text(&finding));
        let kept = self.document.change_findings(None, |list| list.push(finding));
        self.report_kept(kept, now);
        self.findings.choose(Some(id.clone()));
        self.findings.order(&id, place, measures);
        // It goes into the report.
        self.quality.want();
        let undo = self.actions.hint("undo", "undoes it");
        self.say(format!("{told}{undo}"), now);
        self.quiet = 0;
    }

    /// Returns the id of the finding that a new one would be again: at the same place, and with the same ends if those were measured.
    fn marked_at(&self, new: &Finding) -> Option<String> {
        let is_again = |f: &&Finding| {
            let ends = || f.ends.into_iter().flatten().zip(new.ends.into_iter().flatten());
            f.place.distance(new.place) < AGAIN_MM
                && (new.ends.is_none() || f.ends.is_some() && ends().all(|(a, b)| a.distance(b) < AGAIN_MM))
        };
        self.document.found().findings.iter().find(is_again).map(|f| f.id.clone())
    }

    /// Returns a finding without a name, and its measures if they are known. The error states why there is none.
    fn new_finding(&self, of: FindingOf) -> Result<(Finding, Option<Measurement>), String> {
        let at = |place: DVec3| Finding { place, ..Finding::default() };
        let on_wall = |place: DVec3| {
            let (place, normal) = wall_near(self.flight.shown_scan(), place)?;
            self.is_colon(place, normal).then_some(Finding { place, normal: Some(normal), ..Finding::default() })
        };
        let assistant = self.assistant();
        match of {
            FindingOf::Here => {
                let place = self.place_here().ok_or("point at the wall, in the flight or in a slice")?;
                if let Some(n) = self.candidate_at(place) {
                    return self.new_finding(FindingOf::Candidate(n));
                }
                let outside = self.actions.hint("finding-outside", "marks a finding outside the colon");
                let finding = on_wall(place).ok_or_else(|| format!("no wall of the colon within 10 mm{outside}"))?;
                Ok((finding, None))
            }
            FindingOf::Candidate(n) => {
                let found = assistant.and_then(|a| a.found()).ok_or("there is no list of candidates")?;
                let place = found.list.get(n).map(|e| e.candidate.position).ok_or("there is no such candidate")?;
                Ok((at(place), found.measure(place).ok()))
            }
            FindingOf::Lesion => match assistant.and_then(|a| a.measured()) {
                Some(Ok(m)) => Ok((at(m.lesion.position), Some(m.clone()))),
                _ => Err("no lesion is measured".to_owned()),
            },
            FindingOf::Measured => match self.measures.list().len().checked_sub(1) {
                Some(last) if !self.measures_lesions() => self.new_finding(FindingOf::Distance(last)),
                _ => self.new_finding(FindingOf::Lesion),
            },
            FindingOf::Distance(n) => {
                let m = self.measures.list().get(n).ok_or("there is no such distance")?;
                let middle = m.from.midpoint(m.to);
                let mut finding = on_wall(middle).unwrap_or_else(|| at(middle));
                finding.correct([m.from, m.to]);
                Ok((finding, None))
            }
            FindingOf::Missed(n) => {
                let patch = self.seen.list().and_then(|list| list.get(n)).ok_or("there is no such patch")?;
                Ok((on_wall(patch.position).unwrap_or_else(|| at(patch.position)), None))
            }
        }
    }

    /// True if there is a distance or a measured lesion.
    pub(super) fn has_measured(&self) -> bool {
        !self.measures.list().is_empty() || self.assistant().is_some_and(|a| a.measured().is_some())
    }

    /// True if the gas or the fluid before a place of a wall belongs to the colon, or may.
    fn is_colon(&self, place: DVec3, normal: DVec3) -> bool {
        let setup = self.flight.setup();
        let lumen = setup.plan.gas.as_ref().unwrap_or(&setup.lumen);
        let is_inside = |mm: f64| {
            let at = place + normal * mm;
            lumen.segment_at(at).is_some() || lumen.is_fluid(at)
        };
        BEFORE_MM.into_iter().any(is_inside)
    }

    /// Returns where the reader looks, world mm: the place that all views show, or the wall in the middle of the picture.
    fn place_here(&self) -> Option<DVec3> {
        self.slices.cursor().or_else(|| {
            let view = self.flight.camera::<Picture>()?.view.as_ref()?;
            let ray = view.ray_at(0.5 * view.width() as f64, 0.5 * view.height() as f64)?;
            let mm = first_crossing(self.flight.shown_scan(), ray.origin, ray.direction, f64::INFINITY)?;
            Some(ray.origin + ray.direction * mm)
        })
    }

    /// Returns the candidate that is shown, if all views point at it.
    fn candidate_at(&self, place: DVec3) -> Option<usize> {
        let assistant = self.assistant()?;
        let n = assistant.reading().current()?;
        let candidate = &assistant.found()?.list.get(n)?.candidate;
        (candidate.position.distance(place) < SAME_MM).then_some(n)
    }

    /// Returns the camera's view if it shows a place (world, mm).
    fn view_of(&self, place: DVec3) -> Option<View> {
        let picture = self.flight.camera::<Picture>()?;
        let view = picture.view.as_ref()?;
        let [x, y] = view.project(place)?;
        let within = x >= 0.0 && y >= 0.0 && x < view.width() as f64 && y < view.height() as f64;
        let ray = view.ray_at(x, y).filter(|_| within)?;
        let mm = ray.origin.distance(place);
        let is_hidden =
            first_crossing(self.flight.shown_scan(), ray.origin, ray.direction, mm).is_some_and(|d| d < mm - SEEN_MM);
        let (position, up) = (view.position(), view.up());
        // A report has pictures of a perspective camera: one that looks at the place shows what a wider one does.
        let (forward, fov_degrees) = match view.camera().tangent() {
            Some(_) => (view.forward(), picture.fov_degrees),
            None => (ray.direction, USUAL_DEGREES),
        };
        (!is_hidden).then_some(View { position, forward, up, fov_degrees })
    }

    /// Notes where a finding is along the colon, if that is known.
    fn locate(&self, finding: &mut Finding) {
        if let Some(along) = self.place.along_of(finding.place) {
            finding.segment = along.part.map(str::to_owned);
            finding.along_mm = Some(along.mm);
        }
    }

    /// Takes what the background has made of findings, and begins with the next.
    pub(super) fn take_findings(&mut self, now: Instant) {
        if let Some(made) = self.findings.take(&self.document.found().findings, now) {
            self.complete(made, now);
            self.attention = true;
        }
        // Those that were marked before the measure along the colon was known.
        let is_nowhere = |f: &&Finding| f.along_mm.is_none() && self.place.along_of(f.place).is_some();
        if let Some(mut finding) = self.document.found().findings.iter().find(is_nowhere).cloned() {
            self.locate(&mut finding);
            let Finding { id, place, segment, along_mm, .. } = finding;
            let add = |f: &mut Finding| (f.segment, f.along_mm) = (segment.clone(), along_mm);
            let kept = self.document.complete(&id, place, add);
            self.report_kept(kept, now);
        }
        let (flight, cleansing) = (&self.flight, &self.cleansing);
        let scans = || {
            let (cleansed, scanned) = cleansing.pair(flight);
            Scans { cleansed, scanned, shown: flight.shown_scan().clone(), preset: flight.setup().scene.image.preset }
        };
        self.findings.begin(&self.document.found().findings, scans, &self.background, now);
    }

    fn complete(&mut self, made: Made, now: Instant) {
        let Made { id, place, measured, view, .. } = made;
        let add = |f: &mut Finding| {
            f.view.get_or_insert(view);
            // The reader may have measured it meanwhile.
            if let Some(Ok(m)) = measured.as_ref().filter(|_| f.ends.is_none()) {
                f.measure(m);
            }
        };
        let kept = self.document.complete(&id, place, add);
        self.report_kept(kept, now);
        if !self.document.found().findings.iter().any(|f| f.is_at(&id, place)) {
            return;
        }
        match measured {
            Some(Ok(m)) => self.say(format!("finding {id}: {:.1} mm", m.lesion.diameter_mm), now),
            Some(Err(why)) => self.say(format!("finding {id} has no measures: {why}"), now),
            None => {}
        }
    }

    /// Changes a finding, by its number.
    pub(super) fn edit_finding(&mut self, n: usize, edit: FindingEdit, now: Instant) {
        let Some(id) = self.document.found().findings.get(n).map(|f| f.id.clone()) else { return };
        let stroke = match &edit {
            FindingEdit::Note(_) => Some(Stroke::Note(id)),
            FindingEdit::Confidence(_) => Some(Stroke::Confidence(id)),
            FindingEdit::Morphology(_) | FindingEdit::Tissue(_) => None,
        };
        let kept = self.document.change_findings(stroke, |list| {
            let Some(f) = list.get_mut(n) else { return };
            match edit {
                FindingEdit::Morphology(m) => f.morphology = m,
                FindingEdit::Tissue(t) => f.tissue = t,
                FindingEdit::Confidence(c) => f.confidence = Some(c.clamp(0.0, 1.0)),
                FindingEdit::Note(note) => f.note = note,
            }
        });
        self.report_kept(kept, now);
    }

    /// Moves an end of a finding's diameter to where the pointer is.
    pub(super) fn move_end(&mut self, n: usize, which: usize, to: EndAt, now: Instant) {
        let to = match to {
            EndAt::World(place) => Some(place).filter(|place| place.is_finite()),
            EndAt::Pixel(pixel) => self.place_at(pixel),
        };
        let finding = self.document.found().findings.get(n);
        let (Some(to), Some((id, Some(mut ends)))) = (to, finding.map(|f| (f.id.clone(), f.ends))) else { return };
        ends[which.min(1)] = to;
        self.findings.choose(Some(id.clone()));
        // However many steps a drag has, it is one correction.
        let stroke = Stroke::Ends(id);
        let before = self.document.before(&stroke).and_then(|list| list.get(n)).cloned();
        let kept = self.document.change_findings(Some(stroke), |list| {
            if let Some(f) = list.get_mut(n) {
                if let Some(before) = before {
                    *f = before;
                }
                f.correct(ends);
            }
        });
        self.report_kept(kept, now);
    }

    /// Takes a distance as the diameter of the chosen finding, if one is waited for. Returns true if so.
    pub(super) fn takes_diameter(&mut self, ends: [DVec3; 2], now: Instant) -> bool {
        let list = &self.document.found().findings;
        let Some(n) = self.findings.current(list).filter(|_| self.findings.takes_distance) else { return false };
        self.findings.takes_distance = false;
        let kept = self.document.change_findings(None, |list| list[n].correct(ends));
        self.report_kept(kept, now);
        true
    }

    /// Returns the number of the chosen finding.
    pub(super) fn chosen_finding(&self) -> Option<usize> {
        self.findings.current(&self.document.found().findings)
    }

    /// Lets the next distance be the diameter of a finding, by its number or the chosen one, or stops that.
    pub(super) fn measure_finding(&mut self, n: Option<usize>, now: Instant) {
        let Some(n) = n.or_else(|| self.chosen_finding()) else { return };
        let Some(id) = self.document.found().findings.get(n).map(|f| f.id.clone()) else { return };
        self.findings.choose(Some(id));
        self.findings.takes_distance = !self.findings.takes_distance;
        if self.findings.takes_distance != self.measures.is_on() {
            self.switch_measuring(now);
        }
    }

    /// Deletes a finding, by its number or the chosen one.
    pub(super) fn delete_finding(&mut self, n: Option<usize>, now: Instant) {
        let Some(n) = n.or_else(|| self.chosen_finding()) else { return };
        let Some(id) = self.document.found().findings.get(n).map(|f| f.id.clone()) else { return };
        let kept = self.document.change_findings(None, |list| _ = list.remove(n));
        self.report_kept(kept, now);
        let undo = self.actions.hint("undo", "brings it back");
        self.say(format!("finding {id} deleted{undo}"), now);
    }

    /// Shows a finding in all views, by its number.
    pub(super) fn visit_finding(&mut self, n: usize, now: Instant) {
        let Some(finding) = self.document.found().findings.get(n).cloned() else { return };
        self.findings.choose(Some(finding.id.clone()));
        self.stop(now);
        self.travel = None;
        let mut told = format!("finding {}{}", finding.id, place_text(&finding));
        let pose = finding.view.map(|v| v.pose());
        if self.flight.setup().scene.play().is_none()
            && !pose.is_some_and(|pose| self.go_where_seen(pose, finding.place, now))
        {
            told.push_str(": the flight cannot go to where it is seen");
        }
        self.say(told, now);
        self.slices.aim(&self.flight, finding.place, 0.0);
        self.figures.touch();
        self.quiet = 0;
    }

    /// Moves the camera to a pose that sees a place (world, mm), or to one nearby that does. Returns false if it fits nowhere.
    pub(super) fn go_where_seen(&mut self, pose: Pose, place: DVec3, now: Instant) -> bool {
        let Some((pose, segment)) = self.seen_from(pose, place) else { return false };
        let other = self.flight.setup().plan.segment.is_some_and(|s| s != segment);
        (!other || self.act(FlightCommand::Segment(segment), now)) && self.flight.act(go_to(pose)).is_ok()
    }

    /// Marks a finding outside the colon, at the place that all views show.
    pub(super) fn mark_outside(&mut self, now: Instant) {
        let Some(place) = self.slices.cursor() else { return self.say("click in a slice first", now) };
        if !self.flight.shown_scan().voxels().grid().contains(place) {
            return self.say("that is outside the scan: click in the patient", now);
        }
        let outside = Outside { place, category: String::new(), text: String::new() };
        let kept = self.document.change_outside(None, |list| list.push(outside));
        self.report_kept(kept, now);
        let undo = self.actions.hint("undo", "undoes it");
        self.say(format!("finding outside the colon{undo}"), now);
    }

    /// Writes the category and text of a finding outside the colon, by its number.
    pub(super) fn edit_outside(&mut self, n: usize, category: String, text: String, now: Instant) {
        let kept = self.document.change_outside(Some(Stroke::Outside(n)), |list| {
            if let Some(o) = list.get_mut(n) {
                (o.category, o.text) = (category, text);
            }
        });
        self.report_kept(kept, now);
    }

    /// Deletes a finding outside the colon, by its number.
    pub(super) fn delete_outside(&mut self, n: usize, now: Instant) {
        let kept = self.document.change_outside(None, |list| {
            if n < list.len() {
                list.remove(n);
            }
        });
        self.report_kept(kept, now);
    }
}

/// Returns where a finding is along the colon, for a message: ", sigmoid, 310 mm".
fn place_text(finding: &Finding) -> String {
    let segment = finding.segment.iter().map(|s| format!(", {s}"));
    let along = finding.along_mm.iter().map(|mm| format!(", {:.0} mm from the rectum", (mm / 10.0).round() * 10.0));
    segment.chain(along).collect()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::app::findings::{Morphology, Tissue};
    use crate::host::window::controller::tests::{cockpit_of, controller, perform, phantom_flight, trace, wish};
    use crate::host::window::document::Document;
    use crate::host::window::intent::{Intent, SliceInput};
    use crate::host::window::session::ScanFiles;
    use crate::phantom::PhantomSettings;
    use crate::shared::shared;

    fn list(c: &FlightController) -> &[Finding] {
        &c.document().found().findings
    }

    /// Returns everything about findings. A file keeps a number to the last digit but one.
    fn told(list: &[Finding]) -> String {
        format!("{list:.9?}")
    }

    /// Lets time go by until the background has made everything of the findings.
    fn until_made(c: &mut FlightController, now: &mut Instant) {
        let begun = Instant::now();
        while list(c).iter().any(|f| c.findings().pictures(&f.id).is_none()) {
            assert!(begun.elapsed() < Duration::from_secs(100));
            *now += Duration::from_millis(25);
            c.advance(*now).unwrap();
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    #[test]
    fn a_polyp_is_marked_measured_corrected_and_there_when_the_scan_is_opened_again() {
        let settings = PhantomSettings { polyps: true, ..PhantomSettings::embedded(3) };
        let phantom = shared(&settings).0.truth();
        let polyp = phantom.polyps.iter().max_by(|a, b| a.diameter_mm.total_cmp(&b.diameter_mm)).unwrap();
        let (dir, mut now) = (tempfile::tempdir().unwrap(), Instant::now());
        let files = ScanFiles::below(dir.path(), "a.json");
        let opened = || {
            let mut c = cockpit_of(phantom_flight(&settings), 0.0, Vec::new());
            c.set_document(Document::open(&files).0);
            c
        };
        let mut c = opened();
        trace(&mut c, now);
        // Beside the polyp, in tissue.
        let head = polyp.position;
        wish(&mut c, Intent::Slice(SliceInput::Click(head)), now);
        perform(&mut c, "finding", now);
        let made = list(&c)[0].clone();
        assert!(made.place.distance(head) < 10.0 && made.id == "1" && made.diameter_mm.is_none(), "{made:?}");
        assert!(made.normal.unwrap().is_normalized());
        until_made(&mut c, &mut now);
        let made = list(&c)[0].clone();
        let mm = made.diameter_mm.unwrap();
        assert!((mm - polyp.diameter_mm).abs() < 2.0, "{mm} of {}", polyp.diameter_mm);
        assert!(made.height_mm.unwrap() > 1.0 && made.volume_mm3.unwrap() > 10.0 && made.confidence.is_some());
        assert!(made.morphology.is_some() && made.tissue != Some(Tissue::Fat), "{made:?}");
        let view = made.view.unwrap();
        assert!(c.flight().setup().lumen.segment_at(view.position).is_some(), "{view:?}");
        let pictures = c.findings().pictures("1").unwrap();
        assert_eq!(pictures.iter().map(|p| p.name).collect::<Vec<_>>(), ["view", "axial", "along"]);
        assert!(pictures.iter().all(|p| p.rgb.iter().any(|rgb| *rgb != p.rgb[0])), "a picture is empty");
        // Its place along the colon is known once the measure is.
        while list(&c)[0].along_mm.is_none() {
            now += Duration::from_millis(300);
            trace(&mut c, now);
            c.advance(now).unwrap();
            c.hud(now);
            std::thread::sleep(Duration::from_millis(2));
        }
        // An end is dragged in many steps, which are undone at once.
        let ends = made.ends.unwrap();
        for n in 1..=5 {
            let to = ends[1] + (ends[1] - ends[0]) * (0.1 * f64::from(n));
            wish(&mut c, Intent::MoveEnd(0, 1, EndAt::World(to)), now);
        }
        assert!((list(&c)[0].diameter_mm.unwrap() - 1.5 * mm).abs() < 1e-6);
        for text in ["f", "fl", "flat?"] {
            wish(&mut c, Intent::EditFinding(0, FindingEdit::Note(text.to_owned())), now);
        }
        wish(&mut c, Intent::EditFinding(0, FindingEdit::Morphology(Some(Morphology::Flat))), now);
        let all = list(&c).to_vec();
        assert_eq!((all[0].note.as_str(), all[0].morphology), ("flat?", Some(Morphology::Flat)));
        assert_eq!(told(list(&opened())), told(&all));
        perform(&mut c, "undo", now);
        perform(&mut c, "undo", now);
        assert_eq!((list(&c)[0].note.as_str(), list(&c)[0].morphology), ("", made.morphology));
        perform(&mut c, "undo", now);
        assert!((list(&c)[0].diameter_mm.unwrap() - mm).abs() < 1e-6);
        // Deleted, brought back with all that is known of it, and unmarked.
        let whole = list(&c).to_vec();
        wish(&mut c, Intent::DeleteFinding(Some(0)), now);
        assert!(list(&c).is_empty() && list(&opened()).is_empty());
        perform(&mut c, "undo", now);
        assert_eq!(list(&c), whole);
        assert_eq!(told(list(&opened())), told(&whole));
        // The camera goes to where it is seen.
        wish(&mut c, Intent::VisitFinding(0), now);
        assert!(c.flight().pose().position.distance(view.position) < 1e-3);
        assert_eq!(c.slices().cursor(), Some(whole[0].place));
        perform(&mut c, "undo", now);
        assert!(list(&c).is_empty());
    }

    /// An id is given again once the last finding is gone, and what is made of that one may come late.
    #[test]
    fn what_belongs_to_a_finding_that_is_gone_does_not_go_to_the_next_one() {
        let settings = PhantomSettings { polyps: true, ..PhantomSettings::embedded(3) };
        let (mut c, mut now) = (cockpit_of(phantom_flight(&settings), 0.0, Vec::new()), Instant::now());
        trace(&mut c, now);
        let polyps = shared(&settings).0.truth().polyps;
        let [a, b] = [polyps[4].position, polyps[2].position];
        let mark = |c: &mut FlightController, at: DVec3, now: Instant| {
            wish(c, Intent::Slice(SliceInput::Click(at)), now);
            perform(c, "finding", now);
        };
        // The background begins with the first one, and that is undone.
        mark(&mut c, a, now);
        c.advance(now).unwrap();
        perform(&mut c, "undo", now);
        mark(&mut c, b, now);
        until_made(&mut c, &mut now);
        let second = list(&c)[0].clone();
        assert_eq!(second.id, "1");
        assert!(second.ends.is_none_or(|ends| ends[0].distance(b) < 15.0), "{second:?} of {b}, not of {a}");
        assert!(second.view.unwrap().position.distance(b) < a.distance(b), "{second:?}");
        // Deleted, another one with its id, and brought back.
        let until_along = |c: &mut FlightController, now: &mut Instant| {
            while list(c)[0].along_mm.is_none() {
                *now += Duration::from_millis(300);
                trace(c, *now);
                c.advance(*now).unwrap();
                c.hud(*now);
                std::thread::sleep(Duration::from_millis(2));
            }
        };
        until_along(&mut c, &mut now);
        let second = list(&c)[0].clone();
        wish(&mut c, Intent::DeleteFinding(Some(0)), now);
        mark(&mut c, a, now);
        until_made(&mut c, &mut now);
        until_along(&mut c, &mut now);
        perform(&mut c, "undo", now);
        perform(&mut c, "undo", now);
        assert_eq!(list(&c), [second]);
    }

    /// The background has not begun with it when it is deleted.
    #[test]
    fn a_finding_that_is_deleted_and_brought_back_is_measured() {
        let settings = PhantomSettings { polyps: true, ..PhantomSettings::embedded(3) };
        let (mut c, mut now) = (cockpit_of(phantom_flight(&settings), 0.0, Vec::new()), Instant::now());
        trace(&mut c, now);
        let polyps = shared(&settings).0.truth().polyps;
        for polyp in [&polyps[4], &polyps[2]] {
            wish(&mut c, Intent::Slice(SliceInput::Click(polyp.position)), now);
            perform(&mut c, "finding", now);
        }
        assert_eq!(list(&c).len(), 2, "{:?}", c.hud(now).message);
        perform(&mut c, "finding-delete", now);
        until_made(&mut c, &mut now);
        // What waits for a finding that is gone keeps nobody awake.
        assert!(list(&c).len() == 1 && c.findings().next(list(&c), now).is_none());
        perform(&mut c, "undo", now);
        assert!(c.findings().next(list(&c), now).is_some() && !c.findings().lacks_pictures(list(&c)));
        until_made(&mut c, &mut now);
        assert!(list(&c).iter().all(|f| f.diameter_mm.is_some()), "{:?}", list(&c));
    }

    #[test]
    fn the_same_place_is_no_second_finding() {
        let (mut c, now) = (controller("tentacles"), Instant::now());
        trace(&mut c, now);
        let point = |c: &mut FlightController, y: f64| {
            wish(c, Intent::Slice(SliceInput::Click(DVec3::new(5.0, y, 12.0))), now);
        };
        perform(&mut c, "finding", now);
        for y in [30.0, 40.0] {
            point(&mut c, y);
            perform(&mut c, "finding", now);
        }
        let before = list(&c).to_vec();
        assert_eq!(before.len(), 3, "{:?}", c.hud(now).message);
        for (y, n) in [(40.0, 2), (30.0, 1), (40.0, 2)] {
            point(&mut c, y);
            perform(&mut c, "finding", now);
            let told = c.hud(now).message.unwrap();
            assert_eq!((c.chosen_finding(), told), (Some(n), format!("finding {} is here already", n + 1)));
        }
        // A distance whose middle is there is another finding, and the same distance is not.
        let middle = before[2].place;
        c.measure_between(middle - DVec3::Y * 3.0, middle + DVec3::Y * 3.0);
        for _ in 0..2 {
            perform(&mut c, "finding-measured", now);
            assert_eq!((list(&c).len(), list(&c)[3].diameter_mm), (4, Some(6.0)));
        }
        assert_eq!(list(&c)[..3], before);
        // Once it is deleted, the place is free. Without a chosen one, nothing is deleted.
        for _ in 0..2 {
            perform(&mut c, "finding-delete", now);
            assert_eq!(list(&c), before);
        }
        point(&mut c, 40.0);
        perform(&mut c, "finding", now);
        perform(&mut c, "finding-delete", now);
        perform(&mut c, "finding", now);
        assert_eq!((list(&c).len(), list(&c)[2].place), (3, middle));
    }

    /// A drag that goes far and comes back is a small correction, whatever its steps.
    #[test]
    fn a_drag_counts_from_where_it_began() {
        let (mut c, now) = (controller("tentacles"), Instant::now());
        trace(&mut c, now);
        let ends = [DVec3::new(6.0, 40.0, 12.0), DVec3::new(6.0, 50.0, 12.0)];
        c.measure_between(ends[0], ends[1]);
        perform(&mut c, "finding-measured", now);
        let add = |f: &mut Finding| (f.height_mm, f.morphology) = (Some(4.0), Some(Morphology::Pedunculated));
        let place = list(&c)[0].place;
        c.document.complete("1", place, add).unwrap();
        let mut drag = |mm: f64, which: usize| {
            let to = if which == 1 { ends[0] + DVec3::Y * mm } else { ends[1] - DVec3::Y * mm };
            wish(&mut c, Intent::MoveEnd(0, which, EndAt::World(to)), now);
            let f = &list(&c)[0];
            (f.diameter_mm.unwrap(), f.height_mm, f.morphology)
        };
        let pedunculated = Some(Morphology::Pedunculated);
        assert_eq!(drag(12.0, 1), (12.0, Some(4.0), pedunculated));
        assert_eq!(drag(13.0, 1), (13.0, Some(4.0), pedunculated));
        assert_eq!(drag(14.0, 1), (14.0, None, pedunculated));
        assert_eq!(drag(31.0, 1), (31.0, None, Some(Morphology::Mass)));
        assert_eq!(drag(10.0, 1), (10.0, Some(4.0), pedunculated));
        // The other end goes on from there.
        assert_eq!(drag(9.0, 0), (9.0, Some(4.0), pedunculated));
        perform(&mut c, "undo", now);
        assert_eq!(list(&c)[0].ends, Some(ends));
    }

    #[test]
    fn what_is_measured_and_what_lies_ahead_become_findings_and_a_place_without_wall_does_not() {
        let (mut c, now) = (controller("tentacles"), Instant::now());
        trace(&mut c, now);
        // Ahead, without a place that is pointed at: the end of the tube is too far for its wall, but it is seen.
        perform(&mut c, "finding", now);
        assert_eq!(list(&c).len(), 1, "{:?}", c.hud(now).message);
        assert!((list(&c)[0].place.y - 75.0).abs() < 1.5 && list(&c)[0].view.is_some(), "{:?}", list(&c)[0]);
        let ends = [DVec3::new(6.0, 40.0, 12.0), DVec3::new(6.0, 47.0, 12.0)];
        c.measure_between(ends[0], ends[1]);
        wish(&mut c, Intent::Finding(FindingOf::Distance(0)), now);
        let finding = &list(&c)[1];
        assert_eq!((finding.id.as_str(), finding.diameter_mm, finding.ends), ("2", Some(7.0), Some(ends)));
        assert!(finding.normal.unwrap().x > 0.9 && (finding.place.x - 5.5).abs() < 0.6, "{finding:?}");
        // The next distance is the diameter of the chosen one, and no distance.
        wish(&mut c, Intent::MeasureFinding(Some(1)), now);
        for y in [30.0, 33.0] {
            wish(&mut c, Intent::Slice(SliceInput::Click(DVec3::new(6.0, y, 12.0))), now);
        }
        assert_eq!((list(&c)[1].diameter_mm, c.measures().list().len()), (Some(3.0), 1));
        assert!(!c.measures().is_on());
        // In tissue, far from the wall.
        wish(&mut c, Intent::Slice(SliceInput::Click(DVec3::new(-0.4, 79.4, -0.4))), now);
        perform(&mut c, "finding", now);
        let told = c.hud(now).message.unwrap();
        assert!(list(&c).len() == 2 && told.contains("outside the colon"), "{told}");
        perform(&mut c, "finding-outside", now);
        for text in ["a", "a cyst"] {
            wish(&mut c, Intent::EditOutside(0, "E2".to_owned(), text.to_owned()), now);
        }
        let outside = c.document().found().outside.clone();
        assert_eq!((outside.len(), outside[0].category.as_str(), outside[0].text.as_str()), (1, "E2", "a cyst"));
        wish(&mut c, Intent::DeleteOutside(0), now);
        for left in [1, 1, 0] {
            perform(&mut c, "undo", now);
            assert_eq!(c.document().found().outside.len(), left);
        }
        // A slice shows more than the scan.
        wish(&mut c, Intent::Slice(SliceInput::Click(DVec3::splat(-500.0))), now);
        perform(&mut c, "finding-outside", now);
        assert!(c.document().found().outside.is_empty());
        for id in [FindingOf::Candidate(0), FindingOf::Lesion, FindingOf::Distance(7), FindingOf::Missed(0)] {
            wish(&mut c, Intent::Finding(id), now);
            assert_eq!(list(&c).len(), 2, "{id:?}");
        }
        // All of it, in the order in which it was made.
        perform(&mut c, "undo", now);
        assert_eq!(list(&c)[1].diameter_mm, Some(7.0));
        perform(&mut c, "undo", now);
        assert_eq!((list(&c).len(), c.measures().list().len()), (1, 1));
        perform(&mut c, "undo", now);
        perform(&mut c, "undo", now);
        assert!(list(&c).is_empty() && c.measures().list().is_empty());
    }
}
