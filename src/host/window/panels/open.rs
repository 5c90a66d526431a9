//! Opens another scan: another series of the study, one from an archive, a recent one, or one from a folder.

use std::path::{Path, PathBuf};

use egui::{Rect, RichText, ScrollArea, Ui};

#[cfg(feature = "dicom")]
use super::archive::ArchiveList;
use super::series::SeriesList;
use super::{Context, Panel, PanelEntry, Requests};
use crate::host::window::intent::Intent;
use crate::host::window::style::SOFT;

/// Its entry in the table.
pub const PANEL: PanelEntry =
    PanelEntry { name: "open", title: "Open a scan", make: || Box::<FileList>::default(), ..PanelEntry::NONE };

/// File name extensions of scans that can be opened.
const ENDINGS: [&str; 9] = [".nii", ".nii.gz", ".mhd", ".mha", ".nrrd", ".nhdr", ".dcm", ".ima", ".dicom"];
/// Maximum number of listed entries of a folder.
const MOST: usize = 2000;
/// Title above the reason why a scan cannot be flown, and above the series of a study.
const CANNOT: &str = "This scan cannot be flown.";
const CHOOSE: &str = "Choose a series.";

/// The contents of a folder.
#[derive(Debug, Default, PartialEq)]
pub struct Listing {
    /// Its subfolders.
    pub folders: Vec<PathBuf>,
    /// Files that can be opened.
    pub scans: Vec<PathBuf>,
    /// Why it cannot be listed.
    pub fault: Option<String>,
}

impl Listing {
    fn of(folder: &Path) -> Self {
        let entries = match std::fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(e) => return Self { fault: Some(e.to_string()), ..Self::default() },
        };
        let mut listing = Self::default();
        for path in entries.filter_map(|e| Some(e.ok()?.path())).take(MOST) {
            let name = name(&path).to_lowercase();
            if name.starts_with('.') {
                continue;
            }
            if path.is_dir() {
                listing.folders.push(path);
            } else if ENDINGS.iter().any(|e| name.ends_with(e)) {
                listing.scans.push(path);
            }
        }
        listing.folders.sort();
        listing.scans.sort();
        listing
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// A list of scans and folders.
#[derive(Debug, Default)]
pub struct FileList {
    folder: Option<PathBuf>,
    /// Read once, not for every picture.
    listing: Option<Listing>,
    /// The series of the study that is open or that was to be opened.
    series: Option<SeriesList>,
    /// The archives of the settings.
    #[cfg(feature = "dicom")]
    archive: ArchiveList,
}

impl FileList {
    /// Creates a list for a folder with a known listing.
    #[cfg(test)]
    pub fn of(folder: impl Into<PathBuf>, listing: Listing) -> Self {
        Self {
            folder: Some(folder.into()),
            listing: Some(listing),
            series: None,
            #[cfg(feature = "dicom")]
            archive: ArchiveList::of(Vec::new()),
        }
    }

    /// Adds what an archive has answered.
    #[cfg(all(test, feature = "dicom"))]
    pub(super) fn with_archive(self, archive: ArchiveList) -> Self {
        Self { archive, ..self }
    }

    #[cfg(all(test, feature = "dicom"))]
    pub(super) fn archive(&self) -> &ArchiveList {
        &self.archive
    }

    /// Adds the known series of a study.
    #[cfg(test)]
    pub(super) fn with_series(self, series: SeriesList) -> Self {
        Self { series: Some(series), ..self }
    }

    /// Lays out the content that a window shows instead of a flight if the scan `opening` could not be opened: the reason, the
    /// `series` to choose from, other scans, and the key that quits. Returns the choice.
    pub(in crate::host::window) fn instead(
        &mut self,
        why: &str,
        opening: Option<&Path>,
        series: &[String],
        recent: &[PathBuf],
        quit: &str,
        ui: &mut Ui,
    ) -> Option<Intent> {
        let area = ui.ctx().content_rect();
        let width = (area.width() * 0.85).min(720.0);
        let column = Rect::from_center_size(area.center(), egui::vec2(width, area.height() - 48.0));
        let mut chosen = None;
        ui.scope_builder(egui::UiBuilder::new().max_rect(column), |ui| {
            ui.heading(if series.is_empty() { CANNOT } else { CHOOSE });
            ui.label(why);
            let quit = if quit.is_empty() { String::new() } else { format!(" {quit} quits.") };
            ui.label(format!("Open another scan below, or drop one on the window.{quit}"));
            ui.separator();
            ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
                if let Some(path) = opening.filter(|_| !series.is_empty()) {
                    let number = SeriesList::at(&mut self.series, path).choose(series, ui);
                    chosen = number.map(|n| Intent::Open(path.to_owned(), Some(n)));
                    ui.separator();
                }
                chosen = chosen.take().or(self.ui(recent, ui).map(|path| Intent::Open(path, None)));
            });
        });
        chosen
    }

    /// Lays out the list. Returns the chosen scan, if there is one.
    pub fn ui(&mut self, recent: &[PathBuf], ui: &mut Ui) -> Option<PathBuf> {
        let mut chosen = None;
        let folder = self.folder.get_or_insert_with(|| {
            let last = recent.iter().find_map(|r| r.parent().filter(|p| p.is_dir()));
            let here = || std::env::current_dir().unwrap_or_else(|_| PathBuf::from("/"));
            last.map_or_else(here, Path::to_owned)
        });
        let listing = self.listing.get_or_insert_with(|| Listing::of(folder));
        let mut go = None;
        #[cfg(feature = "dicom")]
        if let Some(series) = self.archive.ui(ui) {
            chosen = Some(series);
        }
        if !recent.is_empty() {
            ui.label(RichText::new("Recent scans").color(SOFT));
        }
        for path in recent {
            if ui.button(name(path)).on_hover_text(path.display().to_string()).clicked() {
                chosen = Some(path.clone());
            }
        }
        ui.separator();
        ui.label(RichText::new(folder.display().to_string()).color(SOFT));
        ui.horizontal(|ui| {
            if let Some(parent) = folder.parent().filter(|_| ui.button("Up").clicked()) {
                go = Some(parent.to_owned());
            }
            if ui.button("Read again").clicked() {
                go = Some(folder.clone());
            }
            if ui.button("Open this folder").on_hover_text("a DICOM series, or a stack of PNG slices").clicked() {
                chosen = Some(folder.clone());
            }
        });
        if let Some(fault) = &listing.fault {
            ui.label(fault);
        }
        for path in &listing.folders {
            if ui.button(format!("{}/", name(path))).clicked() {
                go = Some(path.clone());
            }
        }
        for path in &listing.scans {
            if ui.button(name(path)).clicked() {
                chosen = Some(path.clone());
            }
        }
        if listing.fault.is_none() && listing.folders.is_empty() && listing.scans.is_empty() {
            ui.label(RichText::new("no scans here").color(SOFT));
        }
        if let Some(next) = go {
            (self.folder, self.listing) = (Some(next), None);
        }
        chosen
    }

    /// Lays out the series of the study that is open, and the list. Returns the chosen scan, with the number of its series.
    pub(super) fn choose(&mut self, context: &Context<'_>, ui: &mut Ui) -> Option<(PathBuf, Option<usize>)> {
        let scrolled = ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            let opened = context.opened.and_then(|(path, open)| {
                let n = SeriesList::at(&mut self.series, path).of_open(open, ui)?;
                Some((path.to_owned(), Some(n)))
            });
            self.ui(context.recent, ui).map(|path| (path, None)).or(opened)
        });
        scrolled.inner
    }
}

impl Panel for FileList {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        if let Some((path, series)) = self.choose(context, ui) {
            requests.ask(Intent::Open(path, series));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_lists_its_folders_and_scans() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b.nii.gz", "a.NRRD", "notes.txt", ".hidden.nii"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        std::fs::create_dir(dir.path().join("series")).unwrap();
        let listing = Listing::of(dir.path());
        let names = |list: &[PathBuf]| list.iter().map(|p| name(p)).collect::<Vec<_>>();
        assert_eq!(
            (names(&listing.folders), names(&listing.scans)),
            (vec!["series".to_owned()], vec!["a.NRRD".to_owned(), "b.nii.gz".to_owned()])
        );
        assert!(Listing::of(&dir.path().join("gone")).fault.is_some());
    }
}
