//! Whose series it is, and the UIDs of its slices.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::slice::{self, Slice};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::io::identity::{ATTRIBUTES, Identity, SourceImage, Tag};

const CHARACTER_SET: Tag = (0x0008, 0x0005);
const CLASS: Tag = (0x0008, 0x0016);
const INSTANCE: Tag = (0x0008, 0x0018);

/// Reads the identity of a series from the headers of its slices. Fails with status 3 if one cannot be read, status 4 if cancelled.
pub(super) fn of(slices: &[Slice], progress: &Progress) -> Result<Identity> {
    let mut files: Vec<_> = slices.iter().filter(|s| s.fault.is_none()).map(|s| s.file.path.as_path()).collect();
    files.dedup();
    progress.stage("reading headers", files.len() as u64);
    let read = files.par_iter().map(|path| {
        progress.advance(1)?;
        let (set, _) = slice::header(path)?;
        let text = |tag: Tag| set.root.text(tag).unwrap_or_default();
        Ok((*path, [text(CLASS), text(INSTANCE)]))
    });
    let uids: BTreeMap<_, [String; 2]> = read.collect::<Result<_>>()?;
    let Some(first) = files.first() else { return Ok(Identity::default()) };
    let (set, _) = slice::header(first)?;
    let value = |tag: Tag| {
        let bytes = set.root.bytes(tag)?;
        let end = bytes.iter().rposition(|b| !matches!(b, 0 | b' '))? + 1;
        Some((tag, bytes[..end].to_vec()))
    };
    let image = |s: &Slice| {
        let [class, instance] = uids.get(s.file.path.as_path())?.clone();
        let frame = (s.file.frames > 1).then_some(s.frame + 1);
        // Without a UID, nothing can refer to it.
        (!instance.is_empty()).then_some(SourceImage { class, instance, frame, position: s.position })
    };
    Ok(Identity {
        character_set: set.root.text(CHARACTER_SET).unwrap_or_default(),
        values: ATTRIBUTES.into_iter().filter_map(value).collect(),
        images: slices.iter().filter_map(image).collect(),
    })
}
