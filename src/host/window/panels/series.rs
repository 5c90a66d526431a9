//! The series of a study, with a small picture of each, to choose from.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use egui::{Align2, Color32, ColorImage, Painter, Pos2, Rect, RichText, Sense, Stroke, StrokeKind};
use egui::{TextureHandle, TextureOptions, Ui, pos2, vec2};

use crate::error::Result;
use crate::host::window::job::Job;
use crate::host::window::style::{ACCENT, INK, SOFT, TEXT, text};
use crate::progress::Progress;
use crate::volume::io;
use crate::volume::io::study::{Picture, Series, Study};

/// Height of a row of the list, and side of its picture, points.
const ROW: f32 = 78.0;
const PICTURE: f32 = 72.0;
/// Pixels of a picture's longer side.
const SIDE: usize = 72;
/// Time between two looks at the reading of a study.
const POLL: Duration = Duration::from_millis(100);
/// Background of the row of the open series.
const CHOSEN: Color32 = Color32::from_rgb(38, 62, 84);
/// Colour of what cannot be opened.
const GREY: Color32 = Color32::from_gray(120);

enum State {
    /// The headers are read and the pictures are made on another thread.
    Reading(Job<Study>),
    /// `None` if that failed.
    Ready(Option<Study>),
}

/// The list of a study's series.
pub(super) struct SeriesList {
    path: PathBuf,
    state: State,
    textures: Vec<Option<TextureHandle>>,
}

impl std::fmt::Debug for SeriesList {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SeriesList").field("path", &self.path).finish_non_exhaustive()
    }
}

impl SeriesList {
    /// Starts to read the study at `path` on another thread. Dropping the list cancels that.
    fn of(path: &Path) -> Self {
        let study = path.to_owned();
        let read = move |progress: &Arc<Progress>| -> Result<Study> { io::study(&study, SIDE, progress) };
        let state = match Job::start("study", &Arc::new(Progress::new()), read, || {}) {
            Ok(job) => State::Reading(job),
            Err(_) => State::Ready(None),
        };
        Self { path: path.to_owned(), state, textures: Vec::new() }
    }

    /// Creates the list of a known study.
    #[cfg(test)]
    pub(super) fn known(path: &Path, study: Study) -> Self {
        Self { path: path.to_owned(), state: State::Ready(Some(study)), textures: Vec::new() }
    }

    /// Returns the list of the study at `path`: the one in `place`, or a new one.
    pub(super) fn at<'a>(place: &'a mut Option<Self>, path: &Path) -> &'a mut Self {
        if place.as_ref().is_some_and(|list| list.path != path) {
            *place = None;
        }
        place.get_or_insert_with(|| Self::of(path))
    }

    /// Takes the study once it is read.
    fn poll(&mut self, ui: &Ui) {
        if let State::Reading(job) = &mut self.state {
            match job.take() {
                Some(study) => self.state = State::Ready(study.ok()),
                None => ui.ctx().request_repaint_after(POLL),
            }
        }
    }

    /// Returns the series once they are read.
    fn study(&self) -> Option<&Study> {
        match &self.state {
            State::Ready(study) => study.as_ref(),
            State::Reading(_) => None,
        }
    }

    /// Lays out the list in the place of a scan that could not be opened. `lines` are shown until the study is read. Returns the
    /// number of the series that was chosen.
    pub(super) fn choose(&mut self, lines: &[String], ui: &mut Ui) -> Option<usize> {
        self.poll(ui);
        let known = self.study().is_some_and(|s| s.series.len() == lines.len());
        if known {
            return self.rows(None, ui);
        }
        let mut chosen = None;
        for (line, n) in lines.iter().zip(1..) {
            let (rect, row) = ui.allocate_exact_size(vec2(ui.available_width(), ROW), Sense::click());
            let p = ui.painter_at(rect);
            ground(&p, rect, &row, false);
            frame(&p, rect, "…");
            text(&p, rect.left_top() + vec2(PICTURE + 11.0, 6.0), Align2::LEFT_TOP, line, TEXT, INK);
            if row.clicked() {
                chosen = Some(n);
            }
        }
        chosen
    }

    /// Lays out the study of the open scan, if it has several series. `open` is the number of the series that was asked for.
    /// Returns the number of another one that was chosen.
    pub(super) fn of_open(&mut self, open: Option<usize>, ui: &mut Ui) -> Option<usize> {
        self.poll(ui);
        let study = self.study().filter(|s| s.series.len() > 1)?;
        let open = open.or(study.usual.map(|k| k + 1));
        ui.label(RichText::new("Series of this study").color(SOFT));
        let chosen = self.rows(open, ui);
        ui.separator();
        chosen.filter(|n| Some(*n) != open)
    }

    fn rows(&mut self, open: Option<usize>, ui: &mut Ui) -> Option<usize> {
        let State::Ready(Some(study)) = &self.state else { return None };
        self.textures.resize_with(study.series.len(), || None);
        let mut chosen = None;
        for (k, s) in study.series.iter().enumerate() {
            let usable = s.why.is_none();
            let sense = if usable { Sense::click() } else { Sense::hover() };
            let (rect, row) = ui.allocate_exact_size(vec2(ui.available_width(), ROW), sense);
            if !ui.is_rect_visible(rect) {
                continue;
            }
            let p = ui.painter_at(rect);
            let is_open = open == Some(s.number);
            if usable {
                ground(&p, rect, &row, is_open);
            }
            let picture = study.pictures.get(k).and_then(Option::as_ref);
            match (picture, self.textures.get_mut(k)) {
                (Some(picture), Some(texture)) => {
                    let texture = texture.get_or_insert_with(|| load(ui, s.number, picture));
                    draw(&p, rect, texture, usable);
                }
                _ => frame(&p, rect, &s.modality),
            }
            words(&p, rect.left_top() + vec2(PICTURE + 11.0, 1.0), s, &study.series, is_open);
            let row = row.on_hover_text(details(s, &study.series));
            if row.clicked() {
                chosen = Some(s.number);
            }
        }
        chosen
    }
}

/// Draws the ground of a row that can be chosen.
fn ground(p: &Painter, rect: Rect, row: &egui::Response, is_open: bool) {
    if is_open {
        p.rect_filled(rect, 4.0, CHOSEN);
    } else if row.hovered() {
        p.rect_filled(rect, 4.0, Color32::from_gray(45));
    }
    if row.has_focus() {
        p.rect_stroke(rect, 4.0, Stroke::new(1.5, ACCENT), StrokeKind::Inside);
    }
}

/// Returns the place of a row's picture.
fn place(rect: Rect) -> Rect {
    Rect::from_min_size(rect.min + vec2(3.0, 3.0), vec2(PICTURE, PICTURE))
}

/// Draws a frame with a word, where there is no picture.
fn frame(p: &Painter, rect: Rect, word: &str) {
    let at = place(rect);
    p.rect_stroke(at, 2.0, Stroke::new(1.0, Color32::from_gray(70)), StrokeKind::Inside);
    text(p, at.center(), Align2::CENTER_CENTER, word, TEXT, GREY);
}

fn load(ui: &Ui, number: usize, picture: &Picture) -> TextureHandle {
    let image = ColorImage::from_gray([picture.width, picture.height], &picture.grey);
    ui.ctx().load_texture(format!("series {number}"), image, TextureOptions::LINEAR)
}

/// Draws a picture in the middle of its place, in its own proportions.
fn draw(p: &Painter, rect: Rect, texture: &TextureHandle, usable: bool) {
    let at = place(rect);
    p.rect_filled(at, 0.0, Color32::BLACK);
    let size = texture.size_vec2();
    let at = Rect::from_center_size(at.center(), size * (PICTURE / size.max_elem().max(1.0)));
    let tint = if usable { Color32::WHITE } else { Color32::from_gray(110) };
    p.image(texture.id(), at, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), tint);
}

/// Draws what is known of a series, line by line. The painter cuts off what is too long.
fn words(p: &Painter, at: Pos2, s: &Series, list: &[Series], is_open: bool) {
    let (ink, soft) = if s.why.is_none() { (INK, SOFT) } else { (GREY, GREY) };
    let number = text(p, at, Align2::LEFT_TOP, &s.number.to_string(), 17.0, ink);
    let name = if s.description.is_empty() { "no description" } else { &s.description };
    let head = text(p, pos2(number.max.x + 8.0, number.max.y - 1.0), Align2::LEFT_BOTTOM, name, TEXT, ink);
    if is_open {
        text(p, pos2(head.max.x + 8.0, head.max.y), Align2::LEFT_BOTTOM, "open", TEXT, ACCENT);
    }
    let mut y = number.max.y;
    let mut line = |words: &str| y = text(p, pos2(at.x, y), Align2::LEFT_TOP, words, TEXT, soft).max.y;
    let slices = if s.slices == 1 { "1 slice".to_owned() } else { format!("{} slices", s.slices) };
    let spacing = s.spacing_mm.is_some().then(|| s.spacing_text());
    let facts = [Some(s.modality.clone()), Some(slices), spacing];
    line(&facts.into_iter().flatten().collect::<Vec<_>>().join(", "));
    match &s.why {
        Some(why) => line(&format!("cannot be opened: {why}")),
        None => relations(s, list).iter().for_each(|words| line(words)),
    }
}

/// Returns position, plane and patient in words, and the same patient's other positions.
fn relations(s: &Series, list: &[Series]) -> [String; 2] {
    let several = list.iter().any(|o| o.patient != s.patient);
    let patient = several.then(|| format!("patient {}", s.patient));
    let words = [s.position().map(str::to_owned), s.plane.map(str::to_owned), patient];
    let pair = s.pair.iter().filter_map(|n| list.get(n.checked_sub(1)?)).map(|other| {
        let position = other.position().map_or_else(String::new, |p| format!(", {p}"));
        format!("{}{position}", other.number)
    });
    let pair = pair.collect::<Vec<_>>().join("; ");
    let pair = if pair.is_empty() { pair } else { format!("same patient as {pair}") };
    [words.into_iter().flatten().collect::<Vec<_>>().join(", "), pair]
}

/// Returns what is told of a row under the pointer: all of it, for a narrow panel cuts off lines.
fn details(s: &Series, list: &[Series]) -> String {
    let [columns, rows] = s.size;
    let number = s.series_number.map_or_else(String::new, |n| format!(", series number {n}"));
    let image = format!("{columns}×{rows} pixels, {}", s.spacing_text());
    let why = s.why.as_ref().map(|why| format!("cannot be opened: {why}"));
    let origin = format!("study {}{number}", s.study);
    let lines = [s.description.clone(), image, origin].into_iter().chain(relations(s, list)).chain(why);
    lines.filter(|l| !l.is_empty()).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_series_names_the_other_positions_of_its_patient() {
        let one = Series { number: 1, patient: 1, plane: Some("axial"), pair: vec![2], ..Series::default() };
        let prone = Some("HFP".to_owned());
        let two = Series { number: 2, patient: 1, patient_position: prone, pair: vec![1], ..Series::default() };
        let list = [one, two];
        assert_eq!(relations(&list[0], &list), ["axial", "same patient as 2, prone"]);
        assert_eq!(relations(&list[1], &list), ["prone", "same patient as 1"]);
        let list = [list[1].clone(), Series { number: 2, patient: 2, ..Series::default() }];
        assert_eq!(relations(&list[1], &list), ["patient 2", ""]);
    }

    #[test]
    fn a_folder_without_a_study_has_no_list() {
        let dir = tempfile::tempdir().unwrap();
        let mut list = None;
        let list = SeriesList::at(&mut list, dir.path());
        let begun = std::time::Instant::now();
        while let State::Reading(job) = &mut list.state {
            assert!(begun.elapsed() < Duration::from_secs(10));
            if let Some(study) = job.take() {
                list.state = State::Ready(study.ok());
            }
        }
        assert!(list.study().is_none());
    }
}
