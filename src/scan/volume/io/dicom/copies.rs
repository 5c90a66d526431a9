//! Slices that are at the position of another: copies, in whatever transfer syntax, are left out.

use std::path::Path;

use glam::DVec3;

use super::even::SAME_PLACE;
use super::pixels;
use super::slice::Slice;
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Number of slices that are decoded at once to be compared.
const AT_ONCE: usize = 32;
/// Number of pixels that are decoded at once, unless one slice has more.
const MOST_PIXELS: usize = 1 << 24;

/// Returns the sorted `slices` without those that have the position and the values (HU) of one before. A note gives their number.
/// Fails with status 3 if slices at one position have different values, or if one cannot be decoded; status 4 if cancelled.
pub(crate) fn left_out(
    input: &Path,
    slices: Vec<Slice>,
    normal: DVec3,
    notes: &mut Vec<String>,
    progress: &Progress,
) -> Result<Vec<Slice>> {
    let (mut kept, mut copies): (Vec<Slice>, Vec<(usize, Slice)>) = (Vec::with_capacity(slices.len()), Vec::new());
    for s in slices {
        let apart = |last: &Slice| (s.position.unwrap_or_default() - last.position.unwrap_or_default()).dot(normal);
        match kept.last() {
            Some(last) if apart(last).abs() < SAME_PLACE => copies.push((kept.len() - 1, s)),
            _ => kept.push(s),
        }
    }
    let Some((of, first)) = copies.first() else { return Ok(kept) };
    let files = named(input, first, &kept[*of]);
    progress.stage("comparing duplicates", 2 * copies.len() as u64);
    let mut others: Vec<usize> = Vec::new();
    let pixels = usize::from(first.file.rows) * usize::from(first.file.cols);
    let at_once = (MOST_PIXELS / pixels.max(1)).clamp(1, AT_ONCE);
    for (begin, chunk) in copies.chunks(at_once).enumerate().map(|(n, c)| (n * at_once, c)) {
        let one: Vec<Slice> = chunk.iter().map(|c| kept[c.0].clone()).collect();
        let two: Vec<Slice> = chunk.iter().map(|c| c.1.clone()).collect();
        let (one, two) = (values(&one, progress)?, values(&two, progress)?);
        let voxels = one.len() / chunk.len();
        let differ = one.chunks(voxels).zip(two.chunks(voxels)).enumerate().filter(|(_, (a, b))| a != b);
        others.extend(differ.map(|(k, _)| begin + k));
    }
    match others[..] {
        [] => {}
        [only] => {
            let (of, slice) = &copies[only];
            let [two, one] = named(input, slice, &kept[*of]);
            let why = format!("has the same position as {one} but different values");
            let what = if slice.file.path == input { format!("{two} of {}", input.display()) } else { two };
            return Err(Error { what, ..Error::file(input, why, "keep one of the two slices") });
        }
        _ => {
            let (of, slice) = &copies[others[0]];
            let [two, one] = named(input, slice, &kept[*of]);
            let why = format!(
                "{} of its slices have the same position as another but different values (first: {two} and {one}), and no header separates the passes",
                others.len()
            );
            return Err(Error::file(input, why, "export each pass as its own series"));
        }
    }
    let [two, one] = files;
    notes.push(match copies.len() {
        1 => format!("{two} duplicates {one} and was left out"),
        n => format!("{n} slices are duplicates of others and were left out, the first: {two} of {one}"),
    });
    Ok(kept)
}

fn values(slices: &[Slice], progress: &Progress) -> Result<Vec<i16>> {
    let file = &slices[0].file;
    for s in slices.iter().filter(|s| s.file.pixels.length.is_none()) {
        pixels::check_expansion(&s.file)?;
    }
    let mut out = vec![0; usize::from(file.rows) * usize::from(file.cols) * slices.len()];
    pixels::decode(slices, &mut out, progress)?;
    Ok(out)
}

/// Names two slices of `input`: by their files, or by their frames of one file, which is named once at most.
fn named(input: &Path, one: &Slice, two: &Slice) -> [String; 2] {
    let file = |s: &Slice| s.file.path.display().to_string();
    if one.file.path == two.file.path {
        let of = if one.file.path == input { String::new() } else { format!(" of {}", file(one)) };
        return [format!("frame {}{of}", one.frame + 1), format!("frame {}", two.frame + 1)];
    }
    [one, two].map(|s| match s.file.frames {
        1 => file(s),
        _ => format!("frame {} of {}", s.frame + 1, file(s)),
    })
}
