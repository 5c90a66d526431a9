//! The gallery: pictures of the candidates and a page that shows them.

use std::path::Path;
use std::sync::Arc;

use super::page::{Card, Page, Picture, VIEW};
use crate::app::look::{Looks, SLICE, Subject};
use crate::app::study::CandidateEntry;
use crate::error::{Error, Result};
use crate::host::record::write_grey_png;
use crate::output;
use crate::polyps::{Candidate, Wall};
use crate::progress::Progress;
use crate::render::slice::Windowing;
use crate::render::{Frame, Preset, Quality, Reuse, Settings, renderer};
use crate::space::TransferFunction;
use crate::volume::Volume;

/// Candidates that get pictures.
const MOST: usize = 200;
/// Window of the slices, HU: gas is dark but not black, and fat and soft tissue differ.
const LEVEL_HU: f64 = -200.0;
const WIDTH_HU: f64 = 1500.0;
/// Name of the page.
pub(crate) const PAGE: &str = "index.html";

/// The inputs of the pictures.
pub(super) struct Scene<'a> {
    /// The scan that the candidates were found in.
    pub(super) volume: Volume,
    pub(super) transfer: TransferFunction,
    pub(super) wall: &'a Wall,
    /// Name of the scan's file or folder.
    pub(super) scan: String,
    /// True if the order of the colon's segments is known.
    pub(super) is_ordered: bool,
}

/// Writes the pictures of the first candidates into `folder`, and the page last. Returns how many candidates have pictures. Fails
/// with status 4 if interrupted, 5 if a file cannot be written.
pub(super) fn write(
    folder: &Path,
    scene: Scene<'_>,
    found: &[Candidate],
    entries: &[CandidateEntry],
    progress: &Progress,
) -> Result<usize> {
    let page = folder.join(PAGE);
    // An older page must not show the new pictures.
    if page.is_file() {
        std::fs::remove_file(&page).map_err(|e| output::cannot(&page, e))?;
    }
    let shown = found.len().min(MOST);
    progress.stage("rendering candidates", shown as u64);
    let preset = Preset::default();
    let prepared = preset.preparation.prepare(Arc::new(scene.volume), scene.transfer);
    let looks = Looks::new(&prepared);
    let mut renderer = renderer(&prepared, Settings::new(Quality::High), preset, Reuse::Never);
    let mut frame = Frame::new(VIEW, VIEW);
    let windowing = Windowing::new(LEVEL_HU, WIDTH_HU).map_err(|why| Error::fault("gallery", why, "report it"))?;
    let (mut hu, mut grey) = (Vec::new(), vec![0; SLICE * SLICE]);
    let mut cards = Vec::with_capacity(shown);
    for (candidate, entry) in found.iter().zip(entries).take(shown) {
        let subject = Subject::of(candidate, scene.wall);
        let name = |kind: &str| format!("{:04}-{kind}.png", entry.rank);
        let (view, scale) = looks.view(&subject, VIEW)?;
        renderer.render(&view, &mut frame);
        let mut pictures = vec![Picture::view(name("view"), scale)];
        frame.write_png(folder.join(&pictures[0].file))?;
        let titles = ["axial", "across", "along"];
        for (title, slice) in titles.into_iter().zip(subject.slices()) {
            slice.fill(prepared.voxels(), &mut hu);
            windowing.fill(&hu, &mut grey);
            let picture = Picture::slice(name(title), title, &slice, subject.radius_mm);
            write_grey_png(&folder.join(&picture.file), &grey, slice.size)?;
            pictures.push(picture);
        }
        cards.push(Card { entry, lesion: candidate.lesion.as_ref(), pictures });
        progress.advance(1)?;
    }
    Page { scan: &scene.scan, is_ordered: scene.is_ordered, all: entries, cards: &cards }.write(&page)?;
    Ok(shown)
}
