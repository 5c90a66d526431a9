//! DICOM: one file or a folder of slices.
//!
//! [`parse`] reads a file's elements into a [`dataset`] and passes over damage that does not matter ([`recover`]), [`slice`] keeps the
//! relevant ones, [`study`] groups slices into series and chooses one, [`passes`] divides a series whose [`marks`] tell that it is
//! several volumes, [`stack`] orders slices in space, [`pixels`] converts stored values to HU ([`codestream`], [`samples`], [`lut`],
//! [`units`]) and [`picture`] makes a small picture of a slice. [`index`] reads a DICOMDIR, and [`identity`] tells whose series it is.

mod codestream;
mod copies;
mod dataset;
mod even;
mod fragments;
mod identity;
mod index;
mod lut;
mod marks;
mod origin;
mod parse;
mod passes;
mod picture;
mod pixels;
mod recover;
mod rle;
mod samples;
mod slice;
mod stack;
mod study;
mod units;
mod walk;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Map, Value, json};

use self::dataset::Oddities;
pub(crate) use self::recover::begins_bare;
use self::slice::Slice;
use self::stack::{Gap, Stack};
use self::study::Groups;
pub(crate) use self::units::Units;
use super::identity::Identity;
use super::study::{self as list, Study};
use super::{LoadOptions, Modality, source};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::Volume;

/// A scan, its notes, and the DICOM facts that `info` adds to those of every format.
pub(crate) struct Read {
    /// The scan.
    pub volume: Volume,
    /// Warnings.
    pub notes: Vec<String>,
    /// `modality`, `patient_position`, `slice_gaps`, `series`.
    pub facts: Map<String, Value>,
    /// What the values are.
    pub units: Units,
}

/// Reads the chosen series from `files` of `input`. It must be of the modality `wanted`. Fails with status 3 if no series can be
/// chosen, or if it is incomplete or unreadable; status 4 if cancelled.
pub(crate) fn load(
    input: &Path,
    files: &[PathBuf],
    options: &LoadOptions,
    wanted: Modality,
    progress: &Progress,
) -> Result<Read> {
    let mut notes = Vec::new();
    let mut groups = groups(input, files, &mut notes, progress)?;
    let chosen = groups.choose(input, options.series, wanted, &mut notes)?;
    groups.check(input, chosen, wanted)?;
    let list: Vec<Value> = groups.list.iter().enumerate().map(|(k, s)| study::entry(s, k == chosen)).collect();
    let slices = groups.slices.swap_remove(chosen);
    let (modality, patient_position) = (slices[0].modality.clone(), study::patient_position(&slices));
    if modality != "CT" && wanted == Modality::Ct {
        return Err(Error::file(input, format!("its modality is {modality}, whose values are not HU"), "give a CT"));
    }
    for s in &slices {
        if let Some(fault) = &s.fault {
            return Err(fault.clone());
        }
        pixels::check_syntax(&s.file)?;
    }
    let units = units_of(&slices);
    if let (Units::Other(what), Modality::Ct) = (&units, wanted) {
        return Err(Error::file(input, format!("holds {what}"), "give the series in HU"));
    }
    notes.extend(odd(&slices));
    let stack = stack::stack(input, slices, progress)?;
    if !options.allow_gaps {
        refuse_gaps(input, &stack)?;
    }
    let mut facts = Map::new();
    facts.insert("modality".to_owned(), json!(modality));
    facts.insert("patient_position".to_owned(), json!(patient_position));
    let gaps: Vec<Value> = stack.gaps.iter().map(|g| json!({ "after_slice": g.after, "missing": g.missing })).collect();
    facts.insert("slice_gaps".to_owned(), json!(gaps));
    facts.insert("series".to_owned(), json!(list));
    notes.extend(stack.notes.iter().cloned());
    let volume = volume(input, stack, &mut notes, progress)?;
    Ok(Read { volume, notes, facts, units })
}

/// Returns what the values of all slices are: HU only if those of each are.
fn units_of(slices: &[Slice]) -> Units {
    let doubtful = |s: &&Slice| s.units != Units::Hu;
    let other = slices.iter().find(|s| matches!(s.units, Units::Other(_)));
    other.or_else(|| slices.iter().find(doubtful)).map_or(Units::Hu, |s| s.units.clone())
}

/// Returns whose series the chosen one of `files` of `input` is. Fails with status 3 if no series can be chosen or a header cannot be
/// read, status 4 if cancelled.
pub(crate) fn identity(
    input: &Path,
    files: &[PathBuf],
    options: &LoadOptions,
    progress: &Progress,
) -> Result<Identity> {
    let groups = groups(input, files, &mut Vec::new(), progress)?;
    let chosen = groups.choose(input, options.series, Modality::Ct, &mut Vec::new())?;
    identity::of(&groups.slices[chosen], progress)
}

/// Returns the study in `files` of `input`, with pictures of at most `side` pixels a side. Fails with status 3 if no file can be
/// read, status 4 if cancelled. A series that cannot be decoded has no picture.
pub(crate) fn study(input: &Path, files: &[PathBuf], side: usize, progress: &Progress) -> Result<Study> {
    let groups = groups(input, files, &mut Vec::new(), progress)?;
    progress.stage("making pictures", groups.slices.len() as u64);
    let mut pictures = Vec::with_capacity(groups.slices.len());
    for slices in &groups.slices {
        progress.advance(1)?;
        pictures.push(study::middle(slices).and_then(|s| picture::picture(s, side, progress).ok()));
    }
    progress.check()?;
    let usual = list::usual(&groups.list).or((groups.list.len() == 1).then_some(0));
    Ok(Study { series: groups.list, pictures, usual })
}

/// Reads the headers of `files` and groups the slices by series. Files whose series cannot be determined are left out, with a note,
/// if there are several series that they can belong to. Fails with status 3 if there is no image, or for the first file that cannot
/// be read; status 4 if cancelled.
fn groups(input: &Path, files: &[PathBuf], notes: &mut Vec<String>, progress: &Progress) -> Result<Groups> {
    progress.stage("reading headers", files.len() as u64);
    let read: Vec<Result<Vec<Slice>>> = files
        .par_iter()
        .map(|f| {
            progress.advance(1)?;
            slice::read(f)
        })
        .collect();
    progress.check()?;
    let (mut slices, mut unread, mut indexes) = (Vec::new(), Vec::new(), Vec::new());
    for (file, read) in files.iter().zip(read) {
        match read {
            Ok(none) if none.is_empty() => indexes.push(file),
            Ok(some) => slices.extend(some),
            // The index of a medium is never needed.
            Err(_) if file.file_name().is_some_and(|n| n.eq_ignore_ascii_case("DICOMDIR")) => {}
            Err(e) => unread.push(e),
        }
    }
    // A file that holds no image and no report is an index, or names neither series nor modality.
    for file in indexes {
        let Some(index) = index::read(file)? else { continue };
        notes.extend(index.note(file));
        if file == input {
            if index.files.is_empty() {
                let why = "is the index of a medium, and none of the files that it lists exists";
                return Err(Error::file(input, why, "copy the whole medium"));
            }
            // An index among the listed files is a folder's matter.
            let listed: Vec<PathBuf> = index.files.into_iter().filter(|f| f != input).collect();
            return groups(input, &listed, notes, progress);
        }
    }
    let groups = Groups::of(slices.into_iter());
    match unread.first() {
        Some(first) if groups.images() < 2 => return Err(first.clone()),
        Some(first) => {
            let n = unread.len();
            notes.push(format!("left out unreadable files ({n}), the first: {}: {}", first.what, first.why));
        }
        None => {}
    }
    if groups.images() == 0 {
        return Err(Error::file(input, "holds no DICOM image", "give a CT series"));
    }
    Ok(groups)
}

/// Tells whether a file has one oddity, and its words.
type OddKind = (fn(&Oddities) -> bool, &'static str);

/// Returns notes on files of a series that are read although they are not as the standard says.
fn odd(slices: &[Slice]) -> Vec<String> {
    let kinds: [OddKind; 4] = [
        (|o| o.no_syntax, "without a transfer syntax: the encoding was derived from the data"),
        (|o| o.other_form, "with an encoding other than their transfer syntax: they are read as encoded"),
        (|o| o.damage, "with damaged elements that are not needed: these were skipped"),
        (|o| o.no_frames, "with NumberOfFrames 0: 1 is assumed"),
    ];
    let one = |(has, words): &OddKind| {
        let mut odd = slices.iter().filter(|s| has(&s.file.oddities)).peekable();
        let first = odd.peek()?.file.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let n = odd.count();
        Some(format!("{n} {} {words}, the first: {first}", if n == 1 { "slice" } else { "slices" }))
    };
    kinds.iter().filter_map(one).collect()
}

fn refuse_gaps(input: &Path, stack: &Stack) -> Result<()> {
    let hint = "export the whole series, or resample over it with --allow-gaps";
    if let Some(text) = gaps_in_words(&stack.gaps) {
        return Err(Error::file(input, format!("slices are missing: {text}"), hint));
    }
    if let Some((least, most)) = stack.uneven {
        return Err(Error::file(input, format!("its slices are {least:.3} to {most:.3} mm apart"), hint));
    }
    Ok(())
}

fn gaps_in_words(gaps: &[Gap]) -> Option<String> {
    let one = |g: &Gap| format!("{} after slice {}", g.missing, g.after);
    match gaps {
        [] => None,
        [some @ .., _] if some.len() >= 8 => {
            let total: usize = gaps.iter().map(|g| g.missing).sum();
            Some(format!("{total} in {} places, the first {}", gaps.len(), one(&gaps[0])))
        }
        _ => Some(gaps.iter().map(one).collect::<Vec<_>>().join(", ")),
    }
}

fn volume(input: &Path, stack: Stack, notes: &mut Vec<String>, progress: &Progress) -> Result<Volume> {
    let slice = usize::from(stack.slices[0].file.rows) * usize::from(stack.slices[0].file.cols);
    let count = slice.checked_mul(stack.slices.len()).filter(|n| n / slice == stack.slices.len());
    let count = count.ok_or_else(|| Error::file(input, "is too large", "give fewer slices"))?;
    for s in stack.slices.iter().filter(|s| s.file.pixels.length.is_none()) {
        pixels::check_expansion(&s.file)?;
    }
    source::check_memory(input, count.max(stack.grid.len()))?;
    let mut data = Vec::new();
    source::reserve(input, &mut data, count)?;
    data.resize(count, 0);
    progress.stage("reading", stack.slices.len() as u64);
    let padded = pixels::decode(&stack.slices, &mut data, progress)?;
    notes.extend(super::strange_note(padded.strange));
    if padded.air > 0 {
        notes.push(format!("{} voxels hold the padding value of the header and became air", padded.air));
    }
    if padded.kept > 0 {
        let n = padded.kept;
        notes.push(format!(
            "{n} voxels hold the padding value of the header but lie inside the slices: they stay tissue"
        ));
    }
    if stack.slices.iter().any(|s| s.file.inverted) {
        notes.push("is MONOCHROME1 (low values are displayed bright); the HU are unchanged".to_owned());
    }
    if stack.gaps.is_empty() && stack.uneven.is_none() {
        return Ok(Volume::new(stack.grid, data));
    }
    if let Some(text) = gaps_in_words(&stack.gaps) {
        notes.push(format!("slices are missing ({text}) and were interpolated"));
    }
    if let Some((least, most)) = stack.uneven {
        notes.push(format!("slices are {least:.3} to {most:.3} mm apart and were resampled evenly"));
    }
    let mut even = Vec::new();
    source::reserve(input, &mut even, stack.grid.len())?;
    even.resize(stack.grid.len(), 0);
    even.par_chunks_mut(slice).enumerate().try_for_each(|(k, out)| {
        progress.check()?;
        interpolate(&stack.slots, &data, k as f64, out);
        Ok(())
    })?;
    Ok(Volume::new(stack.grid, even))
}

/// Interpolates a slice at `slot` linearly between its neighbours.
fn interpolate(slots: &[f64], data: &[i16], slot: f64, out: &mut [i16]) {
    let n = out.len();
    let above = slots.partition_point(|s| *s < slot).min(slots.len() - 1);
    let below = above.saturating_sub(1);
    let width = slots[above] - slots[below];
    let t = if width > 0.0 { ((slot - slots[below]) / width).clamp(0.0, 1.0) } else { 0.0 };
    let (a, b) = (&data[below * n..][..n], &data[above * n..][..n]);
    for ((o, a), b) in out.iter_mut().zip(a).zip(b) {
        *o = super::raw::to_hu(f64::from(*a) * (1.0 - t) + f64::from(*b) * t);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_gaps_are_summed_up_to_the_last() {
        let gaps: Vec<Gap> = (1..=9).map(|k| Gap { after: 10 * k, missing: k }).collect();
        assert_eq!(gaps_in_words(&gaps).unwrap(), "45 in 9 places, the first 1 after slice 10");
        assert_eq!(gaps_in_words(&gaps[..2]).unwrap(), "1 after slice 10, 2 after slice 20");
        assert!(gaps_in_words(&gaps[..8]).unwrap().ends_with("8 after slice 80"));
        assert_eq!(gaps_in_words(&[]), None);
    }

    #[test]
    fn a_missing_slice_lies_between_its_neighbours() {
        // Slices of two voxels, at 0, 1 and 5.
        let (slots, data) = ([0.0, 1.0, 5.0], [-1000, 0, -500, 100, 300, 900]);
        let at = |slot: f64| {
            let mut out = [0; 2];
            interpolate(&slots, &data, slot, &mut out);
            out
        };
        assert_eq!([at(0.0), at(1.0), at(5.0)], [[-1000, 0], [-500, 100], [300, 900]]);
        assert_eq!([at(0.5), at(2.0), at(3.0)], [[-750, 50], [-300, 300], [-100, 500]]);
    }
}
