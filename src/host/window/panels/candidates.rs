//! The candidates panel: places that look like polyps, the answers to them, a measured lesion, and their marks in other panels.

use std::path::PathBuf;
use std::sync::{Arc, Weak};

use egui::{Align2, Color32, ColorImage, FontId, Painter, Pos2, Rect, RichText, ScrollArea, Stroke, TextEdit};
use egui::{TextureHandle, TextureOptions, Ui, pos2, vec2};
use glam::DVec3;

use super::{Context, Panel, PanelEntry, Requests, rows};
use crate::host::window::assistant::{
    Assistant, Entry, Found, Measured, Order, Reading, SIDE, Said, Showing, State, answer_text,
};
use crate::host::window::intent::{FindingOf, Intent};
use crate::host::window::pairing::Twice;
use crate::host::window::style::{ACCENT, EXPECTED, INK, SOFT, Severity, TEXT, text};
use crate::polyps::EVIDENCE;
use crate::polyps::answers::Answer;

/// Its entry in the table.
pub const PANEL: PanelEntry = PanelEntry {
    name: "candidates",
    title: "Candidates",
    key: Some('k'),
    make: || Box::<CandidatesPanel>::default(),
    ..PanelEntry::NONE
};

/// What the list says of itself.
fn caution() -> String {
    format!("A second reader's aid, {EVIDENCE}: it is not a diagnosis.")
}

/// Height of a row of the list, and of its picture, points.
const ROW: f32 = 78.0;
const PICTURE: f32 = 72.0;
/// From this share of its wall on, a candidate is called coated.
const LEAST_COATED: f64 = 0.25;
/// A narrower row has shorter lines, points.
const NARROW: f32 = 270.0;
/// Radius of a mark, points.
const MARK: f32 = 9.0;
/// Colour of a measured lesion's diameter. It differs from that of distances, of the crosshair and of the camera.
const DIAMETER: Color32 = Color32::from_rgb(255, 160, 70);

#[derive(Default)]
struct CandidatesPanel {
    /// The list that the pictures belong to, and those that were shown.
    list: Weak<Found>,
    pictures: Vec<Option<TextureHandle>>,
    /// What the list shows, once that was chosen: it is kept when another scan is opened.
    showing: Option<Showing>,
    /// The candidate and its row that the list was scrolled to, and how far the list is scrolled and high, points.
    scrolled_to: Option<(usize, usize)>,
    offset: f32,
    height: f32,
    /// The path of a file of answers that is typed.
    path: Option<String>,
}

impl Panel for CandidatesPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let Some(assistant) = context.assistant() else {
            // To show the panel is to ask for the list.
            ui.label("Searches the whole colon for polyps while the flight continues.");
            ui.label(RichText::new(caution()).color(SOFT));
            requests.ask(Intent::Search);
            return;
        };
        match assistant.state() {
            State::Working(stage, share) => {
                let stage = if stage.is_empty() { "looking for polyps" } else { &stage };
                // A stage that has counted everything may still have work of unknown length.
                let share = share.filter(|s| *s < 1.0);
                let percent = share.map_or_else(String::new, |s| format!("  {:.0} %", 100.0 * s));
                ui.label(format!("{stage} ...{percent}"));
                ui.label(RichText::new("The flight continues meanwhile.").color(SOFT));
                ui.label(RichText::new(caution()).color(SOFT));
                if ui.button("Cancel").clicked() {
                    requests.ask(Intent::CancelSearch);
                }
            }
            State::Failed(why) => {
                ui.label(RichText::new(why).color(Severity::Alert.colour()));
                if ui.button("Look for polyps").clicked() {
                    requests.ask(Intent::Search);
                }
            }
            State::Ready(found) => self.ready(context, assistant, found, ui, requests),
        }
    }
}

impl CandidatesPanel {
    fn ready(
        &mut self,
        context: &Context<'_>,
        assistant: &Assistant,
        found: &Arc<Found>,
        ui: &mut Ui,
        requests: &mut Requests,
    ) {
        if !std::ptr::eq(self.list.as_ptr(), Arc::as_ptr(found)) {
            *self = Self { list: Arc::downgrade(found), showing: self.showing, ..Self::default() };
            if let Some(showing) = self.showing {
                requests.ask(Intent::Show(showing));
            }
            self.pictures.resize_with(found.list.len(), || None);
        }
        self.buttons(context, assistant, found, ui, requests);
        ui.label(RichText::new("A second reader's aid. It is not a diagnosis.").color(SOFT)).on_hover_text(caution());
        if !assistant.told().is_empty() {
            ui.label(RichText::new(assistant.told()).color(Severity::Notice.colour()));
        }
        if let Some(measured) = assistant.measured() {
            ui.separator();
            lesion(measured, ui, requests);
        }
        ui.separator();
        if found.list.is_empty() {
            ui.label("The detector found nothing that looks like a polyp.");
            return;
        }
        let shown = assistant.reading().shown();
        self.order(assistant.reading(), shown.len(), ui, requests);
        self.list(context, assistant, &shown, ui, requests);
    }

    /// Lays out the order of the list, what it leaves out, and how many it shows.
    fn order(&mut self, reading: &Reading, shown: usize, ui: &mut Ui, requests: &mut Requests) {
        let before = reading.showing();
        let mut showing = before;
        ui.horizontal_wrapped(|ui| {
            ui.selectable_value(&mut showing.order, Order::Score, "by score");
            ui.selectable_value(&mut showing.order, Order::Along, "along the colon");
        });
        ui.horizontal_wrapped(|ui| {
            for (least_mm, text) in [(0, "any size"), (5, "5"), (6, "6"), (10, "10 mm")] {
                ui.selectable_value(&mut showing.least_mm, least_mm, text);
            }
            ui.checkbox(&mut showing.hides_answered, "Hide answered");
        });
        ui.label(RichText::new(format!("{shown} of {} shown", reading.count())).color(SOFT));
        if showing != before {
            self.showing = Some(showing);
            requests.ask(Intent::Show(showing));
        }
    }

    fn buttons(
        &mut self,
        context: &Context<'_>,
        assistant: &Assistant,
        found: &Found,
        ui: &mut Ui,
        requests: &mut Requests,
    ) {
        let reading = assistant.reading();
        let (current, all) = (reading.current(), found.list.len());
        ui.horizontal_wrapped(|ui| {
            context.button(ui, "Previous", "candidate-previous", requests);
            context.button(ui, "Next", "candidate-next", requests);
        });
        let at = current.map_or_else(|| format!("{all} candidates"), |n| format!("candidate {} of {all}", n + 1));
        ui.label(format!("{at}, {} answered", reading.answered()));
        let said = current.and_then(|n| reading.said(n));
        let may_undo = context.view.why_not(&Intent::UndoAnswer).is_none();
        ui.horizontal_wrapped(|ui| {
            for (answer, name) in [(Answer::Yes, "Yes"), (Answer::No, "No"), (Answer::Unsure, "Unsure")] {
                let action = context.actions.named(&format!("candidate-{}", name.to_lowercase()));
                let tip = action.map_or_else(String::new, |a| format!("{} ({})", a.title(), a.key_text()));
                let button = egui::Button::new(name).selected(said.is_some_and(|s| s.answer == Some(answer)));
                if ui.add_enabled(current.is_some(), button).on_hover_text(tip).clicked() {
                    requests.ask(Intent::Answer(answer));
                }
            }
            if let Some(n) = current
                && ui.button("Finding").on_hover_text("mark this candidate as a finding").clicked()
            {
                requests.ask(Intent::Finding(FindingOf::Candidate(n)));
            }
            if ui.add_enabled(may_undo, egui::Button::new("Undo")).clicked() {
                requests.ask(Intent::UndoAnswer);
            }
        });
        if let Some((n, said)) = current.zip(said) {
            let mut note = said.note.clone();
            let edit = TextEdit::singleline(&mut note).hint_text("note").desired_width(f32::INFINITY).char_limit(2000);
            // What the field remembers of its text is not the next candidate's.
            if ui.add(edit.id_salt(("note", n))).changed() {
                requests.ask(Intent::Note(n, note));
            }
        }
        if let Some(place) = current.and_then(|n| found.list.get(n)?.along) {
            ui.label(RichText::new(place.full_text()).color(SOFT));
        }
        ui.horizontal_wrapped(|ui| {
            let mut marks = assistant.is_marking;
            let tip = context.tip("candidate-marks");
            if ui.checkbox(&mut marks, "Marks").on_hover_text(tip).changed() {
                requests.ask(Intent::Mark);
            }
            let text = if assistant.is_measuring { "Stop measuring" } else { "Measure" };
            context.button(ui, text, "measure-lesion", requests);
            if ui.button("Load answers...").on_hover_text("or drop their file on the window").clicked() {
                self.path = if self.path.is_some() { None } else { Some("answers.json".to_owned()) };
            }
        });
        if let Some(path) = &mut self.path {
            let mut load = None;
            ui.horizontal(|ui| {
                load = ui.button("Load").clicked().then(|| PathBuf::from(path.trim()));
                ui.add(TextEdit::singleline(path).desired_width(f32::INFINITY));
            });
            if let Some(load) = load {
                requests.ask(Intent::LoadAnswers(load));
                self.path = None;
            }
        }
        if assistant.is_measuring && assistant.measured().is_none() {
            ui.label(RichText::new("Click on a lesion, in the flight or in a slice.").color(SOFT));
        }
    }

    fn list(
        &mut self,
        context: &Context<'_>,
        assistant: &Assistant,
        shown: &[usize],
        ui: &mut Ui,
        requests: &mut Requests,
    ) {
        let Some(found) = assistant.found() else { return };
        let reading = assistant.reading();
        let step = ROW + ui.spacing().item_spacing.y;
        let mut area = ScrollArea::vertical().auto_shrink(false);
        let row = reading.current().and_then(|n| Some((n, shown.iter().position(|m| *m == n)?)));
        if let Some((_, at)) = row.filter(|_| row != self.scrolled_to) {
            self.scrolled_to = row;
            let top = at as f32 * step;
            // As little as needed.
            let offset = self.offset.clamp((top + ROW - self.height).max(0.0).min(top), top);
            area = area.vertical_scroll_offset(offset);
        }
        let output = area.show_rows(ui, ROW, shown.len(), |ui, visible| {
            for &n in shown.get(visible).unwrap_or_default() {
                let Some(entry) = found.list.get(n) else { continue };
                let name = format!("candidate {}", n + 1);
                let (rect, row) = rows::row(ui, ROW, n, &name, reading.current() == Some(n));
                let p = ui.painter_at(rect);
                let image = Rect::from_min_size(rect.min + vec2(3.0, 3.0), vec2(PICTURE, PICTURE));
                p.image(
                    self.picture(n, entry, ui),
                    image,
                    Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)),
                    Color32::WHITE,
                );
                let said = reading.said(n);
                let told = Told { said, twice: context.twice(n), is_narrow: rect.width() < NARROW };
                words(&p, image.right_top() + vec2(8.0, -1.0), n, entry, told);
                if row.clicked() {
                    requests.ask(Intent::Select(n));
                }
            }
        });
        (self.offset, self.height) = (output.state.offset.y, output.inner_rect.height());
    }

    /// Returns the texture of a candidate's picture.
    fn picture(&mut self, n: usize, entry: &Entry, ui: &Ui) -> egui::TextureId {
        let make = || {
            let image = ColorImage::from_rgb([SIDE, SIDE], entry.picture.as_flattened());
            ui.ctx().load_texture(format!("candidate {n}"), image, TextureOptions::LINEAR)
        };
        self.pictures.get_mut(n).map_or_else(egui::TextureId::default, |p| p.get_or_insert_with(make).id())
    }
}

/// What else is told of a candidate.
#[derive(Clone, Copy)]
struct Told<'a> {
    said: Option<&'a Said>,
    /// What it is in the patient's other position.
    twice: Option<Twice>,
    is_narrow: bool,
}

/// Draws what is known of a candidate, line by line; in a narrow row one thing in each. The painter cuts off what is too long.
fn words(p: &Painter, at: Pos2, n: usize, entry: &Entry, Told { said, twice, is_narrow }: Told<'_>) {
    let head = text(p, at, Align2::LEFT_TOP, &format!("{}", n + 1), 17.0, INK);
    let score =
        format!("{}{:.2}", if is_narrow { "" } else { "score " }, twice.map_or(entry.candidate.score, |t| t.score));
    let score = text(p, pos2(head.max.x + 8.0, head.max.y - 1.0), Align2::LEFT_BOTTOM, &score, TEXT, SOFT);
    if let Some(answer) = said.and_then(|s| s.answer) {
        let (name, colour) = (answer_text(answer), colour(Some(answer)));
        text(p, pos2(score.max.x + 8.0, score.max.y), Align2::LEFT_BOTTOM, name, TEXT, colour);
    }
    let mut y = head.max.y;
    let mut line =
        |words: &str, colour: Color32| y = text(p, pos2(at.x, y), Align2::LEFT_TOP, words, TEXT, colour).max.y;
    if let Some(t) = twice {
        let both = format!("{} in the other position", t.other + 1);
        let why = format!("{both}: {:.2} here, {:.2} there", entry.candidate.score, t.other_score);
        line(if is_narrow { &both } else { &why }, EXPECTED);
    }
    if let Some(l) = &entry.candidate.lesion {
        let sizes = [format!("{:.1} mm wide", l.diameter_mm), format!("{:.1} mm high", l.height_mm)];
        if is_narrow {
            sizes.iter().for_each(|size| line(size, INK));
        } else {
            line(&sizes.join(", "), INK);
        }
    }
    if entry.coated.share >= LEAST_COATED {
        line(&format!("coated, {:.1} mm of tag", entry.coated.thickness_mm), INK);
    }
    if let Some(place) = entry.along {
        line(&place.text(), SOFT);
    }
    if let Some(said) = said {
        line(&said.note, INK);
    }
}

/// Lays out a measured lesion.
fn lesion(measured: &Measured, ui: &mut Ui, requests: &mut Requests) {
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new("Measured lesion").strong().color(DIAMETER));
        if measured.is_ok() && ui.small_button("Finding").on_hover_text("mark it as a finding").clicked() {
            requests.ask(Intent::Finding(FindingOf::Lesion));
        }
        if ui.small_button("Forget").clicked() {
            requests.ask(Intent::ForgetLesion);
        }
    });
    let m = match measured {
        Ok(m) => m,
        Err(why) => {
            ui.label(RichText::new(why).color(Severity::Notice.colour()));
            return;
        }
    };
    let (l, form) = (&m.lesion, m.form.name());
    ui.label(format!("{:.1} mm wide, {:.1} mm high, {:.0} mm³, {form}", l.diameter_mm, l.height_mm, l.volume_mm3));
    let [mean, sd] = ["hu_mean", "hu_sd"].map(|name| l.feature(name));
    ui.label(format!("{mean:.0} ± {sd:.0} HU inside; confidence in the measurements {:.2}", m.confidence));
    if !m.why.is_empty() {
        ui.label(RichText::new(m.why.join("; ")).color(SOFT));
    }
}

/// Returns the colour of an answer, or of none. They differ in brightness, too.
fn colour(answer: Option<Answer>) -> Color32 {
    match answer {
        None => ACCENT,
        Some(Answer::Yes) => Color32::from_rgb(130, 235, 140),
        Some(Answer::No) => Color32::from_gray(150),
        Some(Answer::Unsure) => Severity::Notice.colour(),
    }
}

/// A view that candidates and lesions are marked in. Both functions return the position of a point (world, mm).
pub struct Marking<'a> {
    /// Whether or not it is visible.
    pub project: &'a dyn Fn(DVec3) -> Option<Pos2>,
    /// If it is visible.
    pub find: &'a dyn Fn(DVec3) -> Option<Pos2>,
}

/// Draws the marks of candidates and of the measured lesion into a view. Does nothing before the assistant is asked for.
pub fn draw(context: &Context<'_>, p: &Painter, view: &Marking<'_>) {
    let Some(assistant) = context.assistant() else { return };
    if let Some(found) = assistant.found().filter(|_| assistant.is_marking) {
        let reading = assistant.reading();
        for (n, entry) in found.list.iter().enumerate() {
            if let Some(at) = (view.find)(entry.candidate.position) {
                let ink = colour(reading.said(n).and_then(|s| s.answer));
                ring(p, at, n, ink, if reading.current() == Some(n) { 2.5 } else { 1.5 });
            }
        }
    }
    let Some(Ok(m)) = assistant.measured() else { return };
    let [a, b] = m.lesion.ends;
    // The ends are on the wall beside the lesion, and may be hidden by it.
    let is_visible = [m.lesion.position, a.midpoint(b), a, b].into_iter().any(|at| (view.find)(at).is_some());
    if let (true, Some(from), Some(to)) = (is_visible, (view.project)(a), (view.project)(b)) {
        for (colour, width) in [(Color32::BLACK, 4.0), (DIAMETER, 2.0)] {
            p.line_segment([from, to], Stroke::new(width, colour));
            for end in [from, to] {
                p.circle_stroke(end, 3.5, Stroke::new(width, colour));
            }
        }
        let low = if from.y > to.y { from } else { to };
        label(p, low + vec2(0.0, 8.0), Align2::CENTER_TOP, &format!("{:.1} mm", m.lesion.diameter_mm), DIAMETER);
    }
}

fn ring(p: &Painter, at: Pos2, n: usize, ink: Color32, width: f32) {
    for (colour, width) in [(Color32::BLACK, width + 2.0), (ink, width)] {
        p.circle_stroke(at, MARK, Stroke::new(width, colour));
    }
    label(p, at + vec2(MARK * 0.8, -MARK * 0.8), Align2::LEFT_BOTTOM, &format!("{}", n + 1), ink);
}

/// Draws text on a dark ground.
fn label(p: &Painter, at: Pos2, align: Align2, words: &str, ink: Color32) {
    let size = p.layout_no_wrap(words.to_owned(), FontId::proportional(TEXT), ink).size();
    p.rect_filled(align.anchor_size(at, size).expand(2.0), 3.0, Color32::from_black_alpha(170));
    text(p, at, align, words, TEXT, ink);
}
