//! A folder of PNG slices, which carry neither spacing nor HU.

use std::collections::BTreeSet;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::passed::{self, Passed};
use super::recognise::is_png;
use super::{LoadOptions, Scanned, frame, normalise, source};
use crate::error::{Error, Result};
use crate::output::png::{Decoder, DecodingError, Fault};
use crate::progress::Progress;
use crate::volume::Volume;

/// Maximum side of a slice, pixels.
const LONGEST_SIDE: u32 = 16384;

/// Files of a folder that are not PNGs, with their first bytes, or why these cannot be read.
pub(crate) type Rest<'a> = Vec<(&'a PathBuf, Result<Vec<u8>>)>;

/// Checks that no slice is missing among the `files` of a folder, and returns notes on what else is skipped. A slice that is
/// missing would move all above it. Fails with status 3 and the name of a slice that is damaged or missing.
pub(crate) fn check_folder(folder: &Path, files: &[PathBuf], rest: Rest, mut passed: Passed) -> Result<Vec<String>> {
    let patterns: BTreeSet<String> = files.iter().map(|f| passed::pattern(f)).collect();
    for (file, head) in rest {
        let here = file.parent() == Some(folder);
        let named = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
        let like_slice = here && (named && !is_hidden(file) || patterns.contains(&passed::pattern(file)));
        match head {
            Err(e) if like_slice => return Err(e),
            Err(_) => passed.add(passed::Kind::Unreadable, file),
            Ok(head) if like_slice => {
                let why = if head.is_empty() { "is empty" } else { "is named like a slice but is not a PNG" };
                return Err(Error::file(file, why, "export it again"));
            }
            Ok(head) if is_png(&head) => passed.add(passed::Kind::Below, file),
            Ok(head) => {
                if let Some(kind) = passed::kind(file, &head, false) {
                    passed.add(kind, file);
                }
            }
        }
    }
    let mut notes = passed.notes(folder);
    notes.extend(check_numbers(folder, files, &patterns)?);
    Ok(notes)
}

fn is_hidden(file: &Path) -> bool {
    file.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'))
}

/// Returns the numbers in a file's name.
fn numbers(file: &Path) -> Vec<u64> {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    name.split(|c: char| !c.is_ascii_digit()).filter(|t| !t.is_empty()).map(|t| t.parse().unwrap_or(u64::MAX)).collect()
}

/// Checks the numbers of slices whose names differ in one number only: they must rise by equal steps.
fn check_numbers(folder: &Path, files: &[PathBuf], patterns: &BTreeSet<String>) -> Result<Option<String>> {
    if patterns.iter().all(|p| !p.contains('#')) {
        return Ok(None);
    }
    if patterns.len() > 1 {
        let first = passed::pattern(&files[0]);
        let other = files.iter().find(|f| passed::pattern(f) != first).unwrap_or(&files[0]);
        let [a, b] = [&files[0], other].map(|f| passed::name_in(folder, f));
        return Ok(Some(format!(
            "slices have {} naming patterns, such as {a} and {b}: all are treated as one scan",
            patterns.len()
        )));
    }
    let all: Vec<Vec<u64>> = files.iter().map(|f| numbers(f)).collect();
    let mut varying = (0..all[0].len()).filter(|k| all.iter().any(|n| n.get(*k) != all[0].get(*k)));
    let (Some(at), None) = (varying.next(), varying.next()) else {
        return match all.windows(2).position(|w| w[0] == w[1]) {
            Some(k) if !all[0].is_empty() => Err(same_number(folder, &files[k], &files[k + 1])),
            _ => Ok(None),
        };
    };
    let steps: Vec<u64> = all.windows(2).map(|w| w[1][at].saturating_sub(w[0][at])).collect();
    if let Some(k) = steps.iter().position(|s| *s == 0) {
        return Err(same_number(folder, &files[k], &files[k + 1]));
    }
    let usual = steps.iter().copied().min().unwrap_or(1);
    if let Some(k) = steps.iter().position(|s| *s != usual) {
        // Names by time or by rounded position rise as they like; a number that is missing doubles a step.
        let others = || steps.iter().filter(|s| **s != usual);
        if 8 * others().count() >= steps.len().max(16) || others().any(|s| s % usual != 0) {
            return Ok(Some("slices are not numbered in equal steps: they are treated as consecutive".to_owned()));
        }
        let [a, b] = [k, k + 1].map(|k| passed::name_in(folder, &files[k]));
        let lost = (steps[k] / usual).saturating_sub(1).max(1);
        let are = if lost == 1 { "slice is" } else { "slices are" };
        let why = format!("{lost} {are} missing between {a} and {b}");
        return Err(Error::file(folder, why, "export all slices, numbered in equal steps"));
    }
    Ok(None)
}

fn same_number(folder: &Path, a: &Path, b: &Path) -> Error {
    let why = format!("has the same number as {}", passed::name_in(folder, a));
    Error::file(b, why, "give each slice its own number")
}

/// Reads the slices, the most inferior first. Rows run to posterior, columns to the patient's left. Fails with status 3 if slices
/// differ or are damaged, or if no spacing is given; status 4 if cancelled.
pub(crate) fn load(input: &Path, files: &[PathBuf], options: &LoadOptions, progress: &Progress) -> Result<Scanned> {
    let spacing = options.spacing.ok_or_else(|| {
        Error::file(input, "is a folder of PNG slices, which have no voxel spacing", "give it with --spacing X,Y,Z")
    })?;
    frame::check_spacing(input, "--spacing", &spacing.to_array())?;
    let (width, height, deep) = size(&files[0])?;
    let dims = [width as usize, height as usize, files.len()];
    let grid = frame::grid(input, dims, spacing, DVec3::ZERO, DMat3::IDENTITY)?;
    let samples = if deep { 2 } else { 1 };
    let most: u64 = files.iter().filter_map(|f| f.metadata().ok()).map(|m| m.len()).sum::<u64>().saturating_mul(1040);
    if (grid.len() as u64).saturating_mul(samples) > most {
        return Err(Error::file(input, format!("its files are too small for dims {dims:?}"), "export them again"));
    }
    source::check_memory(input, grid.len())?;
    let mut data = Vec::new();
    source::reserve(input, &mut data, grid.len())?;
    data.resize(grid.len(), 0);
    progress.stage("reading", files.len() as u64);
    let results: Vec<Result<bool>> = files
        .par_iter()
        .zip(data.par_chunks_mut(dims[0] * dims[1]))
        .map(|(file, out)| {
            progress.check()?;
            let deep = decode(file, (width, height), out)?;
            progress.advance(1)?;
            Ok(deep)
        })
        .collect();
    let deep = results.into_iter().collect::<Result<Vec<_>>>()?;
    if deep.iter().any(|d| *d != deep[0]) {
        return Err(Error::file(input, "mixes slices of 8 and of 16 bits", "export them with equal depth"));
    }
    let mut notes = Vec::new();
    match options.hu {
        Some((black, white)) => normalise::linear(&mut data, black, white),
        None => notes.push(normalise::by_histogram(&mut data)),
    }
    Ok(Scanned { volume: Volume::new(grid, data), notes, fractions: 0 })
}

fn damaged(path: &Path, e: Fault) -> Error {
    match e {
        Fault::Decoding(DecodingError::IoError(io)) if io.kind() != std::io::ErrorKind::UnexpectedEof => {
            source::unreadable(path, io)
        }
        e => Error::file(path, format!("is a damaged PNG ({e})"), "export it again").caused_by(e),
    }
}

fn decoder(path: &Path) -> Result<Decoder<BufReader<std::fs::File>>> {
    let (file, _) = source::open(path)?;
    Decoder::new(BufReader::new(file), LONGEST_SIDE).map_err(|e| damaged(path, e))
}

/// Returns the width, the height, and true if samples have 16 bits.
fn size(path: &Path) -> Result<(u32, u32, bool)> {
    let d = decoder(path)?;
    let (w, h) = d.size();
    Ok((w, h, d.is_deep()))
}

/// Decodes the grey values of one slice: 0 to 65535 (eight bits are spread over that range), stored minus 32768.
fn decode(path: &Path, wanted: (u32, u32), out: &mut [i16]) -> Result<bool> {
    let (_, len) = source::open(path)?;
    let d = decoder(path)?;
    let found = d.size();
    if found != wanted {
        let why = format!("is {}×{}, but the first slice is {}×{}", found.0, found.1, wanted.0, wanted.1);
        return Err(Error::file(path, why, "give slices of equal size"));
    }
    let deep = d.is_deep();
    if d.bytes() > len.saturating_mul(1040) {
        return Err(Error::file(path, format!("is too small for {}×{}", found.0, found.1), "export it again"));
    }
    let samples = d.read().map_err(|e| damaged(path, e))?;
    out.iter_mut().zip(samples.grey()).for_each(|(o, v)| *o = (i32::from(v) - 32768) as i16);
    Ok(deep)
}
