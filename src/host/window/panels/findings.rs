//! The findings panel: what the reader has marked, in the colon and outside it, and the marks in other panels.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use egui::{Align2, Color32, ColorImage, ComboBox, FontId, Painter, Pos2, Rect, RichText, ScrollArea, Slider, Stroke};
use egui::{TextEdit, TextureHandle, TextureOptions, Ui, pos2, vec2};

use glam::DVec3;

use super::candidates::Marking;
use super::{Context, Panel, PanelEntry, Requests, rows};
use crate::app::findings::{Finding, FindingPicture, Morphology, Outside, Tissue};
use crate::host::window::intent::{FindingEdit, Intent};
use crate::host::window::style::{EXPECTED, INK, SOFT, TEXT, text};

/// Its entry in the table.
pub const PANEL: PanelEntry =
    PanelEntry { name: "findings", title: "Findings", make: || Box::<FindingsPanel>::default(), ..PanelEntry::NONE };

/// Height of a row of the list, and of its picture, points.
const ROW: f32 = 62.0;
const PICTURE: f32 = 56.0;
/// Height of a row of a finding outside the colon, points.
const OUTSIDE_ROW: f32 = 24.0;
/// Radius of a mark, points. A pointer nearer than this to an end of a diameter drags it.
const MARK: f32 = 6.0;
const REACH: f32 = 8.0;
/// Half the size of the cross at an end of a diameter in a picture, points.
const END: f32 = 4.0;
/// The tissue of a lesion ends so far within its surface at most, mm: 0.42 times the blur of a scan, with room for noise.
const EDGE_MM: f64 = 0.6;
/// Colour of findings: unlike candidates, distances, the crosshair and the camera.
const COLOUR: Color32 = Color32::from_rgb(255, 120, 200);
/// Longest text that is taken, characters.
const LONGEST: usize = 2000;

/// A texture, and the pictures of which it shows one.
type Texture = (Weak<[FindingPicture]>, TextureHandle);

#[derive(Default)]
struct FindingsPanel {
    /// Textures by the finding's id and the picture's number, as long as the pictures are the same.
    textures: BTreeMap<(String, usize), Texture>,
    /// The finding that the list was scrolled to.
    scrolled_to: Option<usize>,
    /// True if the pictures show the scan with its tag.
    is_scanned: bool,
}

impl Panel for FindingsPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let found = context.found();
        ui.horizontal_wrapped(|ui| {
            context.button(ui, "Mark", "finding", requests);
            context.button(ui, "Outside the colon", "finding-outside", requests);
            context.button(ui, "Undo", "undo", requests);
            context.button(ui, "Write the report", "report", requests);
            for (n, name) in context.view.reporting().archives().enumerate() {
                let (intent, button) = (Intent::SendReport(n), egui::Button::new(format!("Send it to {name}")));
                let why_not = context.view.why_not(&intent);
                let shown = ui.add_enabled(why_not.is_none(), button);
                if shown.on_disabled_hover_text(why_not.unwrap_or_default()).clicked() {
                    requests.ask(intent);
                }
            }
        });
        reporting(context, ui, requests);
        if found.findings.is_empty() && found.outside.is_empty() {
            let told =
                "Nothing is marked yet. Point at the wall, in the flight or in a slice, or let the flight look at it.";
            ui.label(RichText::new(told).color(SOFT));
            return;
        }
        if context.view.findings().lacks_pictures(&found.findings) {
            requests.ask(Intent::DrawFindings);
        }
        let current = context.current_finding();
        let left = ui.available_height();
        // The chosen one is edited below the list, which shows at least three.
        let share = if current.is_some() { (left * 0.4).max(3.0 * ROW) } else { left };
        let mut area = ScrollArea::vertical().id_salt("findings").auto_shrink([false, true]).max_height(share);
        if let Some(n) = current.filter(|_| current != self.scrolled_to) {
            area = area.vertical_scroll_offset((n as f32 - 1.0).max(0.0) * (ROW + ui.spacing().item_spacing.y));
        }
        self.scrolled_to = current;
        area.show(ui, |ui| {
            for (n, finding) in found.findings.iter().enumerate() {
                self.row(context, n, finding, current == Some(n), ui, requests);
            }
            for (n, outside) in found.outside.iter().enumerate() {
                outside_row(n, outside, ui, requests);
            }
        });
        if let Some((n, finding)) = current.and_then(|n| Some((n, found.findings.get(n)?))) {
            ui.separator();
            ScrollArea::vertical().id_salt("finding").auto_shrink([false, true]).show(ui, |ui| {
                // What a field remembers of its text is not the next finding's.
                ui.push_id(&finding.id, |ui| self.chosen(context, n, finding, ui, requests));
            });
        }
    }
}

/// Lays out what becomes of a report.
fn reporting(context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
    let Some((told, share)) = context.view.reporting().state() else { return };
    if !context.view.reporting().is_working() {
        ui.label(RichText::new(told).color(SOFT));
        return;
    }
    // A stage that has counted everything may still have work of unknown length.
    let percent = share.filter(|s| *s < 1.0).map_or_else(String::new, |s| format!("  {:.0} %", 100.0 * s));
    ui.label(RichText::new(format!("{told} ...{percent}")).color(SOFT));
    if ui.button("Cancel").clicked() {
        requests.ask(Intent::CancelReport);
    }
}

/// Returns the finding that is chosen in the other position, if it is in that alone.
fn chosen_in_other<'a>(context: &Context<'a>) -> Option<&'a Finding> {
    let other = context.of_other()?;
    other.found().findings.get(other.current_finding()?).filter(|f| f.other.is_none())
}

impl FindingsPanel {
    fn row(
        &mut self,
        context: &Context<'_>,
        n: usize,
        finding: &Finding,
        is_chosen: bool,
        ui: &mut Ui,
        requests: &mut Requests,
    ) {
        let (rect, row) = rows::row(ui, ROW, &finding.id, &format!("finding {}", finding.id), is_chosen);
        let p = ui.painter_at(rect);
        let image = Rect::from_min_size(rect.min + vec2(3.0, 3.0), vec2(PICTURE, PICTURE));
        if let Some(texture) = self.texture(context, finding, 0, ui) {
            p.image(texture, image, Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0)), Color32::WHITE);
        }
        let at = image.right_top() + vec2(8.0, -1.0);
        let head = text(&p, at, Align2::LEFT_TOP, &finding.id, 17.0, COLOUR);
        let size = finding.diameter_mm.map_or_else(|| "not measured".to_owned(), |mm| format!("{mm:.1} mm"));
        let form = finding.morphology.map_or("", Morphology::name);
        let size = [size.as_str(), form].into_iter().filter(|s| !s.is_empty()).collect::<Vec<_>>().join(", ");
        text(&p, pos2(head.max.x + 8.0, head.max.y - 1.0), Align2::LEFT_BOTTOM, &size, TEXT, INK);
        let place = text(&p, pos2(at.x, head.max.y), Align2::LEFT_TOP, &place(finding), TEXT, SOFT);
        let both = if finding.other.is_some() { "in both positions" } else { "" };
        let seen = text(&p, pos2(at.x, place.max.y), Align2::LEFT_TOP, both, TEXT, EXPECTED);
        let y = if finding.other.is_some() { seen.max.y } else { place.max.y };
        text(&p, pos2(at.x, y), Align2::LEFT_TOP, finding.note.lines().next().unwrap_or_default(), TEXT, INK);
        if row.clicked() {
            requests.ask(Intent::VisitFinding(n));
        }
    }

    /// Lays out what can be changed of the chosen finding, and its pictures.
    fn chosen(&mut self, context: &Context<'_>, n: usize, finding: &Finding, ui: &mut Ui, requests: &mut Requests) {
        ui.horizontal_wrapped(|ui| {
            ui.label(RichText::new(format!("Finding {}", finding.id)).strong().color(COLOUR));
            if ui.button("Go there").clicked() {
                requests.ask(Intent::VisitFinding(n));
            }
            if ui.button("Delete").clicked() {
                requests.ask(Intent::DeleteFinding(Some(n)));
            }
            if finding.other.is_some() {
                let tip = "it is not the finding of the other position";
                if ui.button("Part").on_hover_text(tip).clicked() {
                    requests.ask(Intent::PartFinding(Some(n)));
                }
            } else if let Some(other) = chosen_in_other(context) {
                let tip = "it is the finding that is chosen in the other position";
                if ui.button(format!("Same as {} there", other.id)).on_hover_text(tip).clicked() {
                    requests.ask(Intent::JoinFindings(Some(n)));
                }
            }
        });
        ui.label(RichText::new(place(finding)).color(SOFT));
        let measures = [
            finding.diameter_mm.map(|mm| format!("{mm:.1} mm wide")),
            finding.height_mm.map(|mm| format!("{mm:.1} mm high")),
            finding.volume_mm3.map(|mm3| format!("{mm3:.0} mm³")),
        ];
        let measures = measures.into_iter().flatten().collect::<Vec<_>>().join(", ");
        if !measures.is_empty() {
            ui.label(measures);
        }
        let waits = context.view.findings().takes_distance;
        ui.horizontal_wrapped(|ui| {
            let button = egui::Button::new("Measure by hand").selected(waits);
            let tip = "click both ends of its largest diameter, in the flight or in a slice";
            if ui.add(button).on_hover_text(tip).clicked() {
                requests.ask(Intent::MeasureFinding(Some(n)));
            }
        });
        if finding.ends.is_some() {
            ui.label(RichText::new("Drag its ends, in the flight or in a slice, to correct the diameter.").color(SOFT));
        }
        let edit = |edit| Intent::EditFinding(n, edit);
        ui.horizontal_wrapped(|ui| {
            let named = |m: Option<Morphology>| m.map_or("form unknown", Morphology::name);
            let mut form = finding.morphology;
            ComboBox::from_id_salt("form").selected_text(named(form)).show_ui(ui, |ui| {
                for m in Morphology::ALL.map(Some).into_iter().chain([None]) {
                    ui.selectable_value(&mut form, m, named(m));
                }
            });
            if form != finding.morphology {
                requests.ask(edit(FindingEdit::Morphology(form)));
            }
            let named = |t: Option<Tissue>| match t {
                Some(Tissue::Soft) => "soft tissue",
                Some(Tissue::Fat) => "fat",
                None => "tissue unknown",
            };
            let mut tissue = finding.tissue;
            ComboBox::from_id_salt("tissue").selected_text(named(tissue)).show_ui(ui, |ui| {
                for t in Tissue::ALL.map(Some).into_iter().chain([None]) {
                    ui.selectable_value(&mut tissue, t, named(t));
                }
            });
            if tissue != finding.tissue {
                requests.ask(edit(FindingEdit::Tissue(tissue)));
            }
        });
        ui.horizontal_wrapped(|ui| {
            let mut confidence = finding.confidence.unwrap_or(1.0);
            ui.label("confidence");
            let is_known = finding.confidence.is_some();
            let text = move |x: f64, _| if is_known { format!("{x:.2}") } else { "unknown".to_owned() };
            if ui.add(Slider::new(&mut confidence, 0.0..=1.0).custom_formatter(text)).changed() {
                requests.ask(edit(FindingEdit::Confidence(confidence)));
            }
        });
        let mut note = finding.note.clone();
        let field = TextEdit::multiline(&mut note).hint_text("note").desired_rows(2).desired_width(f32::INFINITY);
        if ui.add(field.char_limit(LONGEST)).changed() {
            requests.ask(edit(FindingEdit::Note(note)));
        }
        self.pictures(context, finding, ui);
    }

    /// Lays out the pictures of the chosen finding.
    fn pictures(&mut self, context: &Context<'_>, finding: &Finding, ui: &mut Ui) {
        let Some(pictures) = context.view.findings().pictures(&finding.id) else {
            ui.label(RichText::new("making its pictures ...").color(SOFT));
            return;
        };
        let count = if pictures.len() > 3 { 3 } else { pictures.len() };
        if pictures.len() > count {
            ui.checkbox(&mut self.is_scanned, "as scanned, with the tag");
        }
        let first = if self.is_scanned && pictures.len() > count { count } else { 0 };
        let gap = ui.spacing().item_spacing.x;
        let side = ((ui.available_width() - gap * (count as f32 - 1.0)) / count.max(1) as f32).clamp(40.0, 240.0);
        ui.horizontal(|ui| {
            for k in first..first + count {
                let (rect, _) = ui.allocate_exact_size(vec2(side, side), egui::Sense::hover());
                let (Some(texture), Some(picture)) = (self.texture(context, finding, k, ui), pictures.get(k)) else {
                    continue;
                };
                let p = ui.painter_at(rect);
                p.image(texture, rect, Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0)), Color32::WHITE);
                let scale = side / picture.side as f32;
                for [x, y] in picture.ends.into_iter().flatten() {
                    end(&p, rect.min + scale * vec2(x as f32, y as f32));
                }
                if let Some([left, right, top, bottom]) = &picture.edges {
                    let inner = rect.shrink(3.0);
                    for (at, align, letter) in [
                        (inner.left_center(), Align2::LEFT_CENTER, left),
                        (inner.right_center(), Align2::RIGHT_CENTER, right),
                        (inner.center_top(), Align2::CENTER_TOP, top),
                        (inner.center_bottom(), Align2::CENTER_BOTTOM, bottom),
                    ] {
                        text(&p, at, align, letter, TEXT, INK);
                    }
                }
            }
        });
    }

    /// Returns the texture of a picture of a finding, once that is made.
    fn texture(&mut self, context: &Context<'_>, finding: &Finding, k: usize, ui: &Ui) -> Option<egui::TextureId> {
        let pictures = context.view.findings().pictures(&finding.id)?;
        let picture = pictures.get(k)?;
        let key = (finding.id.clone(), k);
        if let Some((own, texture)) = self.textures.get(&key)
            && own.ptr_eq(&Arc::downgrade(pictures))
        {
            return Some(texture.id());
        }
        let image = ColorImage::from_rgb([picture.side; 2], picture.rgb.as_flattened());
        let texture = ui.ctx().load_texture(format!("finding {} {k}", finding.id), image, TextureOptions::LINEAR);
        let id = texture.id();
        self.textures.insert(key, (Arc::downgrade(pictures), texture));
        Some(id)
    }
}

/// Lays out a finding outside the colon.
fn outside_row(n: usize, outside: &Outside, ui: &mut Ui, requests: &mut Requests) {
    // The number alone is that of the next one once this is deleted.
    ui.push_id(("outside", n, outside.place.to_array().map(f64::to_bits)), |ui| {
        ui.horizontal(|ui| {
            ui.set_min_height(OUTSIDE_ROW);
            if ui.button("Outside").on_hover_text("show it in the slices").clicked() {
                requests.go_to(outside.place, 0.0);
            }
            let (mut category, mut words) = (outside.category.clone(), outside.text.clone());
            let tip = "its category, such as E3";
            let narrow = TextEdit::singleline(&mut category).hint_text("E").desired_width(34.0).char_limit(20);
            let is_new = ui.add(narrow).on_hover_text(tip).changed();
            let room = (ui.available_width() - 62.0).max(60.0);
            let wide = TextEdit::singleline(&mut words).hint_text("what it is").desired_width(room).char_limit(LONGEST);
            if ui.add(wide).changed() || is_new {
                requests.ask(Intent::EditOutside(n, category, words));
            }
            if ui.button("Delete").clicked() {
                requests.ask(Intent::DeleteOutside(n));
            }
        });
    });
}

/// Returns where a finding is along the colon.
fn place(finding: &Finding) -> String {
    let along = finding.along_mm.map(|mm| format!("{:.0} mm", (mm / 10.0).round() * 10.0));
    let parts: Vec<String> = finding.segment.clone().into_iter().chain(along).collect();
    if parts.is_empty() { "place along the colon unknown".to_owned() } else { parts.join(", ") }
}

/// Returns the ends of a diameter where the surface is that is seen: that of the tissue ends within it.
fn at_surface(ends: [DVec3; 2]) -> [DVec3; 2] {
    let apart = (ends[1] - ends[0]).normalize_or_zero() * EDGE_MM;
    [ends[0] - apart, ends[1] + apart]
}

/// True if any point of a finding is visible: its ends are on the wall beside it, and may be hidden by it.
fn is_visible(finding: &Finding, view: &Marking<'_>) -> bool {
    let points = [finding.place].into_iter().chain(finding.ends.into_iter().flat_map(at_surface));
    points.into_iter().any(|at| (view.find)(at).is_some())
}

/// Returns the finding, by its number, and the end of its diameter, 0 or 1, that are drawn within reach of a pointer. While something is
/// measured there is none: the ends that are measured anew are often those.
pub fn end_at(context: &Context<'_>, at: Pos2, view: &Marking<'_>) -> Option<(usize, usize)> {
    if context.measures().is_on() || context.assistant().is_some_and(|a| a.is_measuring) {
        return None;
    }
    let list = context.found().findings.iter().enumerate().filter(|(_, f)| is_visible(f, view));
    let ends =
        list.flat_map(|(n, f)| f.ends.into_iter().flatten().enumerate().map(move |(which, end)| (n, which, end)));
    let near = ends.filter_map(|(n, which, end)| Some(((view.project)(end)?.distance(at), n, which)));
    let near = near.filter(|(away, ..)| *away <= REACH);
    near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, n, which)| (n, which))
}

/// Draws the marks of all findings into a view.
pub fn draw(context: &Context<'_>, p: &Painter, view: &Marking<'_>) {
    let (found, current) = (context.found(), context.current_finding());
    for (n, finding) in found.findings.iter().enumerate() {
        let width = if current == Some(n) { 2.5 } else { 1.5 };
        if !is_visible(finding, view) {
            continue;
        }
        let mut name_at = (view.project)(finding.place);
        if let Some([Some(from), Some(to)]) = finding.ends.map(|ends| ends.map(view.project)) {
            for (colour, width) in [(Color32::BLACK, width + 2.0), (COLOUR, width)] {
                p.line_segment([from, to], Stroke::new(width, colour));
                for end in [from, to] {
                    p.circle_stroke(end, 0.6 * MARK, Stroke::new(width, colour));
                }
            }
            name_at = Some(if from.y < to.y { from } else { to });
        } else if let Some(at) = name_at {
            for (colour, width) in [(Color32::BLACK, width + 2.0), (COLOUR, width)] {
                p.circle_stroke(at, MARK, Stroke::new(width, colour));
            }
        }
        if let Some(at) = name_at {
            let size = finding.diameter_mm.map_or_else(String::new, |mm| format!("  {mm:.1} mm"));
            label(p, at + vec2(0.0, -MARK - 2.0), &format!("{}{size}", finding.id));
        }
    }
    for outside in &found.outside {
        if let Some(at) = (view.find)(outside.place) {
            for (colour, width) in [(Color32::BLACK, 3.5), (COLOUR, 1.5)] {
                p.rect_stroke(
                    Rect::from_center_size(at, vec2(2.0 * MARK, 2.0 * MARK)),
                    0.0,
                    Stroke::new(width, colour),
                    egui::StrokeKind::Middle,
                );
            }
            label(
                p,
                at + vec2(0.0, -MARK - 2.0),
                if outside.category.is_empty() { "outside" } else { &outside.category },
            );
        }
    }
}

/// Marks an end of a diameter in a picture with a cross, as the report does. A line between the ends would hide what it measures.
fn end(p: &Painter, at: Pos2) {
    for (colour, width) in [(Color32::BLACK, 3.5), (COLOUR, 1.6)] {
        for arm in [vec2(END, 0.0), vec2(0.0, END)] {
            p.line_segment([at - arm, at + arm], Stroke::new(width, colour));
        }
    }
}

/// Draws text on a dark ground.
fn label(p: &Painter, at: Pos2, words: &str) {
    let size = p.layout_no_wrap(words.to_owned(), FontId::proportional(TEXT), COLOUR).size();
    p.rect_filled(Align2::CENTER_BOTTOM.anchor_size(at, size).expand(2.0), 3.0, Color32::from_black_alpha(170));
    text(p, at, Align2::CENTER_BOTTOM, words, TEXT, COLOUR);
}
