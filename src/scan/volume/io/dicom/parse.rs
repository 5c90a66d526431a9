//! Parses a file: its meta header, and its data set up to the pixel data. Damage that is not needed is skipped.

use std::borrow::Cow;
use std::io::Read;

use super::dataset::{DataSet, EXPLICIT, Fault, Form, IMPLICIT, ITEM_END, Item, SEQUENCE_END, Tag};
use super::recover;
use super::walk::Walk;
use crate::volume::io::raw::ByteOrder;

const TRANSFER_SYNTAX: Tag = (0x0002, 0x0010);
const FRAMES: Tag = (0x0028, 0x0008);
/// Maximum unpacked size of a deflated data set, bytes.
const MOST_UNPACKED: u64 = 1 << 30;
/// Maximum number of damaged places that are skipped.
const MOST_REPAIRS: usize = 64;

/// Parses the bytes of a whole file. Also returns the bytes that the pixel position refers to: the inflated ones for a deflated
/// transfer syntax, else `bytes` itself.
///
/// Damage outside the elements that are needed is skipped. Returns [`Fault::Short`] if `bytes` end inside an element,
/// [`Fault::Bad`] if they are damaged.
pub(crate) fn parse(bytes: &[u8]) -> Result<(DataSet, Cow<'_, [u8]>), Fault> {
    parsed(bytes, true)
}

/// Parses the first bytes of a file, as [`parse`] does. Damage is not skipped, because its end may lie beyond these bytes.
pub(crate) fn parse_first(bytes: &[u8]) -> Result<(DataSet, Cow<'_, [u8]>), Fault> {
    parsed(bytes, false)
}

fn parsed(bytes: &[u8], whole: bool) -> Result<(DataSet, Cow<'_, [u8]>), Fault> {
    let mut set = DataSet::default();
    let body = parse_into(bytes, &mut set, whole)?;
    Ok((set, body))
}

/// Returns the elements before the place where a damaged file cannot be parsed further.
pub(crate) fn parse_start(bytes: &[u8]) -> Item {
    let mut set = DataSet::default();
    // The fault is known already.
    let _ = parse_into(bytes, &mut set, false);
    set.root
}

/// Returns the bytes that the position of the pixel data refers to.
fn parse_into<'a>(bytes: &'a [u8], set: &mut DataSet, whole: bool) -> Result<Cow<'a, [u8]>, Fault> {
    let start = if bytes.get(128..132) == Some(b"DICM") { 132 } else { 0 };
    let mut meta = Walk::new(bytes, start, recover::form_at(bytes, start, bytes.len(), EXPLICIT));
    let mut head = Item::default();
    while meta.peek_group()? == Some(2) {
        meta.element(&mut head, 0)?;
    }
    let declared = head.text(TRANSFER_SYNTAX);
    set.oddities.no_syntax = declared.is_none();
    let form = match declared.as_deref() {
        Some("1.2.840.10008.1.2") => IMPLICIT,
        Some("1.2.840.10008.1.2.2") => Form { order: ByteOrder::Big, ..EXPLICIT },
        Some(_) => EXPLICIT,
        None => recover::bare(bytes, meta.at).ok_or_else(|| Fault::Bad("names no transfer syntax".to_owned()))?,
    };
    set.syntax = declared.unwrap_or_else(|| {
        match (form.explicit, form.order) {
            (false, _) => "1.2.840.10008.1.2",
            (true, ByteOrder::Little) => "1.2.840.10008.1.2.1",
            (true, ByteOrder::Big) => "1.2.840.10008.1.2.2",
        }
        .to_owned()
    });
    let body = if set.syntax == "1.2.840.10008.1.2.1.99" {
        let mut out = Vec::new();
        let packed = bytes.get(meta.at..).unwrap_or_default();
        let most = MOST_UNPACKED.min(1040 * packed.len() as u64);
        match flate2::read::DeflateDecoder::new(packed).take(most).read_to_end(&mut out) {
            Ok(_) => Cow::Owned(out),
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => return Err(Fault::Short),
            Err(e) => return Err(Fault::Bad(format!("its deflated data is damaged ({e})"))),
        }
    } else {
        Cow::Borrowed(bytes)
    };
    let at = if matches!(body, Cow::Owned(_)) { 0 } else { meta.at };
    let true_form = recover::form_at(&body, at, body.len(), form);
    set.oddities.other_form = true_form != form;
    let mut walk = Walk::new(&body, at, true_form);
    set.root.order = true_form.order;
    root(&mut walk, set, whole)?;
    set.pixels = walk.pixels;
    if set.oddities.no_syntax && walk.pixels.is_some_and(|p| p.length.is_none()) {
        return Err(Fault::Bad("names no transfer syntax, and its pixel data is compressed".to_owned()));
    }
    Ok(body)
}

/// Parses the elements of a data set up to its pixel data. Passes over damage that is not needed in a `whole` file.
fn root(walk: &mut Walk, set: &mut DataSet, whole: bool) -> Result<(), Fault> {
    let form = walk.form;
    let mut last: Option<(Tag, usize)> = None;
    // The elements before the last damage: what was found after it may prove to be inside a sequence.
    let mut before: Option<(Item, Tag)> = None;
    let mut repairs = 0;
    while walk.pixels.is_none() && walk.peek_group()?.is_some() {
        let at = walk.at;
        let found = walk.tag();
        walk.at = at;
        let inside = matches!(found, Ok(ITEM_END | SEQUENCE_END)) && form.explicit;
        if !inside {
            match walk.element(&mut set.root, 0) {
                Ok(()) => {
                    last = found.ok().map(|tag| (tag, at + 8));
                    continue;
                }
                Err(fault) if !whole => return Err(fault),
                Err(fault) => {
                    repairs += 1;
                    let several = set.root.decimal(FRAMES).is_some_and(|n| n > 1.0);
                    let resumed = recover::resume(walk.bytes, at, form, last, several);
                    let Some(resumed) = resumed.filter(|_| repairs <= MOST_REPAIRS) else { return Err(fault) };
                    if let Some(tag) = resumed.after {
                        before.get_or_insert_with(|| (set.root.clone(), tag));
                    }
                    (walk.at, walk.form) = (resumed.at, form);
                }
            }
        } else {
            // The end of a sequence that never began, or whose beginning is damaged.
            let fault = || Fault::Bad(format!("is damaged at byte {at} (no sequence to end)"));
            repairs += 1;
            if !whole || repairs > MOST_REPAIRS {
                return Err(fault());
            }
            walk.at = at + 8;
            if let Some((item, tag)) = before.clone() {
                let several = item.decimal(FRAMES).is_some_and(|n| n > 1.0);
                let resumed = recover::scan(walk.bytes, at + 8, form, (tag, true), several).ok_or_else(fault)?;
                set.root = item;
                walk.at = resumed.at;
                last = None;
            }
        }
        set.oddities.damage = true;
    }
    Ok(())
}

#[cfg(test)]
#[path = "parse_tests.rs"]
mod tests;
