//! Opens a series from an archive: a search as one types, the studies that match, and the series that is fetched.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::{CollapsingHeader, ComboBox, RichText, TextEdit, Ui};

use crate::dicom::archive::{Archive, Found, Got, Query, Series, Study};
use crate::dicom::is_uid;
use crate::dicom::{day, person};
use crate::error::{Error, Result};
use crate::host::archives;
use crate::host::folders::Folder;
use crate::host::window::job::Job;
use crate::host::window::style::{SOFT, Severity};
use crate::progress::Progress;

/// Time between the last letter and the search.
const PAUSE: Duration = Duration::from_millis(400);
/// Time between two looks at what is under way.
const POLL: Duration = Duration::from_millis(100);
/// Studies that are listed.
const MOST: usize = 100;

/// What is searched for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Words {
    patient: String,
    date: String,
    description: String,
}

impl Words {
    /// Returns the query; the error says what is wrong with the date.
    fn query(&self) -> std::result::Result<Query, String> {
        let word = |text: &str| Some(text.trim().to_owned()).filter(|t| !t.is_empty());
        let date = word(&self.date).map(|date| date.parse()).transpose()?;
        Ok(Query { patient: word(&self.patient), date, description: word(&self.description) })
    }
}

/// A series that is fetched.
struct Getting {
    name: String,
    folder: PathBuf,
    job: Job<Got>,
}

/// The studies of an archive.
#[derive(Default)]
pub(super) struct ArchiveList {
    /// The archives of the settings, read once.
    known: Option<Vec<Archive>>,
    /// The number of the archive that is asked.
    chosen: usize,
    words: Words,
    /// When a letter was typed that is not searched for yet.
    typed: Option<Instant>,
    search: Option<Job<Found>>,
    found: Option<std::result::Result<Found, String>>,
    getting: Option<Getting>,
    /// Why the last series was not fetched.
    failed: Option<String>,
}

impl std::fmt::Debug for ArchiveList {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ArchiveList").field("words", &self.words).finish_non_exhaustive()
    }
}

impl ArchiveList {
    /// Creates a list of these archives.
    #[cfg(test)]
    pub(super) fn of(known: Vec<Archive>) -> Self {
        Self { known: Some(known), ..Self::default() }
    }

    /// Adds what the archive has answered to a search for a patient.
    #[cfg(test)]
    pub(super) fn with_found(self, patient: &str, found: Found) -> Self {
        let words = Words { patient: patient.to_owned(), ..Words::default() };
        Self { words, found: Some(Ok(found)), ..self }
    }

    #[cfg(test)]
    pub(super) fn patient(&self) -> &str {
        &self.words.patient
    }

    #[cfg(test)]
    pub(super) fn failed(&self) -> Option<&str> {
        self.failed.as_deref()
    }

    /// Lays out the archives, if the settings name any. Returns the folder of a series that is fetched.
    pub(super) fn ui(&mut self, ui: &mut Ui) -> Option<PathBuf> {
        let known = self.known.get_or_insert_with(archives::known_or_told);
        if known.is_empty() {
            return None;
        }
        let opened = self.take(ui);
        let header = CollapsingHeader::new("From an archive").id_salt("archive").default_open(true);
        header.show(ui, |ui| self.open(ui));
        ui.separator();
        opened
    }

    /// Takes what other threads have done. Returns the folder of a series that is fetched.
    fn take(&mut self, ui: &Ui) -> Option<PathBuf> {
        if let Some(found) = self.search.as_mut().and_then(Job::take) {
            self.search = None;
            self.found = Some(found.map_err(|e| e.to_string()));
        }
        let mut opened = None;
        if let Some(got) = self.getting.as_mut().and_then(|g| g.job.take()) {
            let folder = self.getting.take().map(|g| g.folder);
            match got {
                Ok(_) => opened = folder,
                Err(e) => self.failed = Some(e.to_string()),
            }
        }
        if self.search.is_some() || self.getting.is_some() {
            ui.ctx().request_repaint_after(POLL);
        }
        opened
    }

    /// Lays out the search and what it has found.
    fn open(&mut self, ui: &mut Ui) {
        if let Some(getting) = &self.getting {
            let (stage, done, total) = getting.job.progress().snapshot();
            let count = if total > 0 { format!("  {done} of {total}") } else { String::new() };
            ui.label(format!("{}: {stage} ...{count}", getting.name));
            if ui.button("Cancel").clicked() {
                // What was fetched stays, and the next time goes on.
                (self.getting, self.failed) = (None, Some("cancelled; the next time goes on".to_owned()));
            }
            return;
        }
        let before = (self.words.clone(), self.chosen);
        ui.horizontal_wrapped(|ui| self.fields(ui));
        if before != (self.words.clone(), self.chosen) {
            self.typed = Some(Instant::now());
        }
        if let Some(why) = &self.failed {
            ui.label(RichText::new(why).color(Severity::Alert.colour()));
        }
        match self.words.query() {
            Err(why) => {
                ui.label(RichText::new(format!("date: {why}")).color(SOFT));
                return;
            }
            Ok(query) => self.search(query, ui),
        }
        match &self.found {
            Some(Err(why)) => _ = ui.label(RichText::new(why).color(Severity::Alert.colour())),
            Some(Ok(found)) => {
                let chosen = list(found, ui);
                if let Some((study, series)) = chosen.map(|(s, n)| (found.studies[s].clone(), n)) {
                    self.get(&study, &study.series[series]);
                }
            }
            None if self.search.is_some() => _ = ui.label(RichText::new("asking the archive ...").color(SOFT)),
            None => {}
        }
    }

    /// Lays out what is searched for, and where.
    fn fields(&mut self, ui: &mut Ui) {
        let Some(known) = self.known.as_ref().filter(|k| !k.is_empty()) else { return };
        self.chosen = self.chosen.min(known.len() - 1);
        match &known[..] {
            [one] => _ = ui.label(&one.name),
            several => {
                let shown = ComboBox::from_id_salt("archives").selected_text(&several[self.chosen].name);
                shown.show_ui(ui, |ui| {
                    for (n, archive) in several.iter().enumerate() {
                        ui.selectable_value(&mut self.chosen, n, &archive.name);
                    }
                });
            }
        }
        let mut is_entered = false;
        for (text, hint, width) in [
            (&mut self.words.patient, "patient", 130.0),
            (&mut self.words.date, "date or from-to", 130.0),
            (&mut self.words.description, "description", 130.0),
        ] {
            let field = ui.add(TextEdit::singleline(text).hint_text(hint).desired_width(width).char_limit(64));
            is_entered |= field.lost_focus() && ui.input(|i| i.key_pressed(egui::Key::Enter));
        }
        if ui.button("Search").on_hover_text("the latest studies, if nothing is written").clicked() || is_entered {
            self.typed = Instant::now().checked_sub(PAUSE);
        }
    }

    /// Begins the search once nothing was typed for a moment. The search before is cancelled.
    fn search(&mut self, query: Query, ui: &Ui) {
        let Some(typed) = self.typed else { return };
        let waited = typed.elapsed();
        if waited < PAUSE {
            ui.ctx().request_repaint_after(PAUSE - waited);
            return;
        }
        self.typed = None;
        let Some(archive) = self.known.as_ref().and_then(|k| k.get(self.chosen)).cloned() else { return };
        let work = move |progress: &Arc<Progress>| archive.find(&query, MOST, progress);
        (self.found, self.failed) = (None, None);
        match Job::start("archive", &Arc::new(Progress::new()), work, || {}) {
            Ok(job) => self.search = Some(job),
            Err(e) => self.found = Some(Err(e.to_string())),
        }
        ui.ctx().request_repaint_after(POLL);
    }

    /// Begins to fetch a series.
    fn get(&mut self, study: &Study, series: &Series) {
        self.failed = None;
        let begun = || -> Result<Getting> {
            let archive = self.known.as_ref().and_then(|k| k.get(self.chosen)).cloned();
            let archive = archive.ok_or_else(|| Error::usage("archive", "is gone", "open the list again"))?;
            let folder = folder(&series.uid)?;
            let (uid, place) = (series.uid.clone(), folder.clone());
            let work = move |progress: &Arc<Progress>| archive.get(&uid, &place, progress);
            let job = Job::start("archive", &Arc::new(Progress::new()), work, || {})?;
            Ok(Getting { name: named(study, series), folder, job })
        };
        match begun() {
            Ok(getting) => self.getting = Some(getting),
            Err(e) => self.failed = Some(e.to_string()),
        }
    }
}

/// Returns the folder that a series is fetched into: it is kept, so that opening it again needs no network. Fails with status 3 for what
/// is no UID, or if the system has no folder for it.
fn folder(uid: &str) -> Result<PathBuf> {
    if !is_uid(uid) {
        return Err(Error::input("archive", "names a series that has no valid UID", "ask who runs it"));
    }
    let place = Folder::State.file(PathBuf::from("archive").join(uid));
    place.ok_or_else(|| Error::input("archive", "there is no folder for what it sends", "set HOME to a folder"))
}

/// Returns what a series is called: "Doe, Jane, 2026-01-31, prone".
fn named(study: &Study, series: &Series) -> String {
    let parts = [person(&study.patient_name), day(&study.date), series.description.clone()];
    parts.into_iter().filter(|p| !p.is_empty()).collect::<Vec<_>>().join(", ")
}

/// Lays out what was found. Returns the numbers of the study and the series that were chosen.
fn list(found: &Found, ui: &mut Ui) -> Option<(usize, usize)> {
    let mut chosen = None;
    if found.studies.is_empty() {
        ui.label(RichText::new("the archive has no such CT").color(SOFT));
    }
    for (n, study) in found.studies.iter().enumerate() {
        ui.horizontal_wrapped(|ui| {
            let name = RichText::new(person(&study.patient_name)).strong();
            let facts = [day(&study.date).into(), name, RichText::new(&study.patient_id).color(SOFT)];
            for fact in facts.into_iter().chain([study.description.clone().into()]).filter(|f| !f.is_empty()) {
                ui.label(fact);
            }
        });
        for (k, series) in study.series.iter().enumerate() {
            let number = series.number.map_or_else(String::new, |n| format!("{n}  "));
            let description = if series.description.is_empty() { "no description" } else { &series.description };
            let count = series.instances.map_or_else(String::new, |n| format!(", {n} slices"));
            if ui.button(format!("{number}{description}{count}")).clicked() {
                chosen = Some((n, k));
            }
        }
    }
    if found.has_more {
        ui.label(RichText::new("The archive has more: write more of the name, or a date.").color(SOFT));
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_typed_becomes_a_query_once_it_can() {
        let words = |patient: &str, date: &str| Words {
            patient: patient.to_owned(),
            date: date.to_owned(),
            description: " ".to_owned(),
        };
        let query = words(" doe ", "20260101-").query().unwrap();
        assert_eq!((query.patient.as_deref(), query.description), (Some("doe"), None));
        assert_eq!(query.date.unwrap().to_string(), "20260101-");
        assert!(words("", "2026").query().is_err());
        assert_eq!(words("", "").query().unwrap(), Query::default());
    }

    #[test]
    fn a_series_is_kept_below_the_programs_folder_whatever_the_archive_calls_it() {
        assert!(folder("1.2.840.113").unwrap().ends_with("archive/1.2.840.113"));
        for uid in ["..", "1..2", "", "1.2/../3", "a.b", &"1".repeat(65)] {
            assert!(folder(uid).is_err(), "{uid}");
        }
    }
}
