//! What the bytes of a data set reveal if its header is missing or wrong: the encoding, and where the next sound element begins.

use super::dataset::{
    EXPLICIT, FLOAT_PIXEL_DATA, Form, IMPLICIT, ITEM, ITEM_END, PIXEL_DATA, SEQUENCE_END, Tag, UNDEFINED,
};
use crate::volume::io::raw::ByteOrder;

/// The value representations of PS3.5, 6.2, whose lengths take four bytes in explicit form.
const LONG: [&[u8; 2]; 13] =
    [b"OB", b"OW", b"OF", b"OD", b"OL", b"OV", b"SQ", b"UN", b"UT", b"UC", b"UR", b"SV", b"UV"];
/// Those whose lengths take two.
const SHORT: [&[u8; 2]; 21] = [
    b"AE", b"AS", b"AT", b"CS", b"DA", b"DS", b"DT", b"FL", b"FD", b"IS", b"LO", b"LT", b"PN", b"SH", b"SL", b"SS",
    b"ST", b"TM", b"UI", b"UL", b"US",
];
const BIG: Form = Form { explicit: true, order: ByteOrder::Big };
/// Elements that say what the voxels are, where they lie and whose they are, as ranges: damage there is never skipped.
const WANTED: [(Tag, Tag); 18] = [
    ((0x0008, 0x0008), (0x0008, 0x0008)),
    ((0x0008, 0x0016), (0x0008, 0x0016)),
    ((0x0008, 0x0060), (0x0008, 0x0060)),
    ((0x0010, 0x0010), (0x0010, 0x0010)),
    ((0x0010, 0x0020), (0x0010, 0x0020)),
    ((0x0018, 0x0050), (0x0018, 0x0050)),
    ((0x0018, 0x0088), (0x0018, 0x0088)),
    ((0x0018, 0x5100), (0x0018, 0x5100)),
    ((0x0020, 0x000D), (0x0020, 0x000E)),
    ((0x0020, 0x0011), (0x0020, 0x0011)),
    ((0x0020, 0x0032), (0x0020, 0x0032)),
    ((0x0020, 0x0037), (0x0020, 0x0037)),
    ((0x0020, 0x0052), (0x0020, 0x0052)),
    ((0x0028, 0x0002), (0x0028, 0x0004)),
    ((0x0028, 0x0008), (0x0028, 0x0030)),
    ((0x0028, 0x0100), (0x0028, 0x0121)),
    ((0x0028, 0x1052), (0x0028, 0x1054)),
    ((0x0028, 0x3000), (0x0028, 0x3000)),
];
/// Functional groups, which say the same for the frames of an image with several.
const GROUPS: (Tag, Tag) = ((0x5200, 0x9229), (0x5200, 0x9230));

/// True if the length of this value representation takes four bytes in explicit form.
pub(super) fn is_long(vr: [u8; 2]) -> bool {
    LONG.contains(&&vr)
}

/// The header of an element.
struct Head {
    tag: Tag,
    vr: [u8; 2],
    length: u32,
    /// Where its value begins.
    value: usize,
}

fn word(bytes: &[u8], at: usize, order: ByteOrder) -> Option<u16> {
    let b = *bytes.get(at..)?.first_chunk()?;
    Some(if order == ByteOrder::Little { u16::from_le_bytes(b) } else { u16::from_be_bytes(b) })
}

fn long(bytes: &[u8], at: usize, order: ByteOrder) -> Option<u32> {
    let b = *bytes.get(at..)?.first_chunk()?;
    Some(if order == ByteOrder::Little { u32::from_le_bytes(b) } else { u32::from_be_bytes(b) })
}

fn tag(bytes: &[u8], at: usize, order: ByteOrder) -> Option<Tag> {
    Some((word(bytes, at, order)?, word(bytes, at.checked_add(2)?, order)?))
}

/// Returns the header at `at`; `None` if the bytes end or the value representation is not in the standard.
fn head(bytes: &[u8], at: usize, form: Form) -> Option<Head> {
    let found = tag(bytes, at, form.order)?;
    if !form.explicit {
        return Some(Head { tag: found, vr: [0, 0], length: long(bytes, at + 4, form.order)?, value: at + 8 });
    }
    let vr: [u8; 2] = *bytes.get(at + 4..)?.first_chunk()?;
    if is_long(vr) {
        let reserved = word(bytes, at + 6, form.order)? == 0;
        let length = long(bytes, at + 8, form.order)?;
        return reserved.then_some(Head { tag: found, vr, length, value: at + 12 });
    }
    let length = u32::from(word(bytes, at + 6, form.order)?);
    SHORT.contains(&&vr).then_some(Head { tag: found, vr, length, value: at + 8 })
}

/// True if an element can begin at `at`, after an element `after`: its tag follows, its value lies before `limit`, and the next
/// `more` elements are as sound.
pub(super) fn plausible(bytes: &[u8], at: usize, limit: usize, form: Form, after: Option<Tag>, more: u32) -> bool {
    let Some(h) = head(bytes, at, form) else { return false };
    if after.is_some_and(|t| h.tag <= t) || h.tag.0 == 0xFFFE || h.tag.0 == 0 {
        return false;
    }
    let begins = || matches!(tag(bytes, h.value, form.order), Some(ITEM | SEQUENCE_END));
    if h.length == UNDEFINED {
        // Only sequences, unknown values and pixel data have it.
        return (!form.explicit || is_long(h.vr)) && begins();
    }
    let Some(end) = h.value.checked_add(h.length as usize).filter(|e| *e <= limit) else { return false };
    if &h.vr == b"SQ" && h.length > 0 {
        return begins();
    }
    // Values have even lengths.
    h.length % 2 == 0
        && (end == limit
            || more == 0
            || matches!(tag(bytes, end, form.order), Some(ITEM_END | SEQUENCE_END))
            || plausible(bytes, end, limit, form, Some(h.tag), more - 1))
}

/// Returns the form of the elements from `at` to `limit`: the one that is `declared`, unless only another can be.
pub(super) fn form_at(bytes: &[u8], at: usize, limit: usize, declared: Form) -> Form {
    let limit = limit.min(bytes.len());
    let fits = |f: Form, more: u32| plausible(bytes, at, limit, f, None, more);
    if declared.order == ByteOrder::Big || fits(declared, 1) {
        return declared;
    }
    let other = if declared.explicit { IMPLICIT } else { EXPLICIT };
    if fits(other, 2) { other } else { declared }
}

/// Returns the form of a data set that begins at `at` without a meta header; `None` if there is none.
pub(super) fn bare(bytes: &[u8], at: usize) -> Option<Form> {
    [EXPLICIT, IMPLICIT, BIG].into_iter().find(|f| {
        // A data set of an image begins with its character set, its type or its class.
        tag(bytes, at, f.order).is_some_and(|t| t.0 == 0x0008 && t.1 <= 0x0070)
            && plausible(bytes, at, bytes.len(), *f, None, 2)
    })
}

/// True if the start of a file is that of a DICOM data set without preamble.
pub(crate) fn begins_bare(head: &[u8]) -> bool {
    let meta = head.starts_with(&[2, 0]) && plausible(head, 0, head.len(), EXPLICIT, None, 1);
    meta || bare(head, 0).is_some()
}

/// Where reading continues after damage.
pub(super) struct Resumed {
    /// The next sound element.
    pub at: usize,
    /// The element that is lost, or that precedes the damage.
    pub after: Option<Tag>,
}

/// Finds the next sound element after damage at `at`. `last` is the sound element before it: its tag and where its value begins.
/// Returns `None` if there is none, or if an element that is needed may be lost.
pub(super) fn resume(
    bytes: &[u8],
    at: usize,
    form: Form,
    last: Option<(Tag, usize)>,
    several: bool,
) -> Option<Resumed> {
    let limit = bytes.len();
    let last_tag = last.map(|l| l.0);
    // The damaged element is lost, with those up to the next sound one.
    if let Some(h) = head(bytes, at, form).filter(|h| last_tag.is_none_or(|t| h.tag > t) && h.tag.0 != 0xFFFE) {
        let behind = h.value.saturating_add(h.length as usize);
        if h.length != UNDEFINED && sound(bytes, behind, limit, form, Some(h.tag)) {
            return at_if_spared(bytes, behind, form, (h.tag, true), several);
        }
        return scan(bytes, h.value, form, (h.tag, true), several);
    }
    let (before, value) = last?;
    // The length of the element before may be what is wrong.
    if !needed((before, true), next(before), several) {
        return scan(bytes, value, form, (before, true), several);
    }
    // Only the tag of the damaged element may be sound.
    let found = tag(bytes, at, form.order).filter(|t| *t > before && t.0 < 0x7FE0);
    let resumed = found.and_then(|t| scan(bytes, at.saturating_add(4), form, (t, true), several));
    resumed.or_else(|| scan(bytes, at, form, (before, false), several))
}

/// Maximum number of places of pixel data that are looked at.
const MOST_PIXELS: usize = 64;

/// Finds the next sound element from `from`, after the tag `lost` (which is lost itself if its flag is set).
pub(super) fn scan(bytes: &[u8], from: usize, form: Form, lost: (Tag, bool), several: bool) -> Option<Resumed> {
    let mut pixels = 0;
    for at in from..bytes.len() {
        if !plausible(bytes, at, bytes.len(), form, Some(lost.0), 2) {
            continue;
        }
        let Some(h) = head(bytes, at, form) else { continue };
        if is_pixels(h.tag) {
            // Each of them is followed to its end.
            pixels += 1;
            if pixels > MOST_PIXELS {
                return None;
            }
            if !is_last(bytes, &h, form) {
                continue;
            }
        }
        return at_if_spared(bytes, at, form, lost, several);
    }
    None
}

fn sound(bytes: &[u8], at: usize, limit: usize, form: Form, after: Option<Tag>) -> bool {
    plausible(bytes, at, limit, form, after, 2)
        && head(bytes, at, form).is_some_and(|h| !is_pixels(h.tag) || is_last(bytes, &h, form))
}

fn is_pixels(tag: Tag) -> bool {
    tag == PIXEL_DATA || FLOAT_PIXEL_DATA.contains(&tag)
}

/// True if pixel data is that of the file, which ends it, and not that of an icon.
fn is_last(bytes: &[u8], h: &Head, form: Form) -> bool {
    let mut end = h.value.saturating_add(h.length as usize);
    if h.length == UNDEFINED {
        end = h.value;
        while tag(bytes, end, form.order) == Some(ITEM) {
            let Some(length) = long(bytes, end + 4, form.order) else { return false };
            end = end.saturating_add(8).saturating_add(length as usize);
        }
        if tag(bytes, end, form.order) == Some(SEQUENCE_END) {
            end += 8;
        }
    }
    end >= bytes.len() || tag(bytes, end, form.order).is_some_and(|t| t.0 > 0x7FE0 && t.0 != 0xFFFE)
}

fn at_if_spared(bytes: &[u8], at: usize, form: Form, lost: (Tag, bool), several: bool) -> Option<Resumed> {
    let next = tag(bytes, at, form.order)?;
    (!needed(lost, next, several)).then_some(Resumed { at, after: Some(lost.0) })
}

/// True if a needed element lies between the tag of `lost` (included if its flag is set) and `end` (excluded).
fn needed(lost: (Tag, bool), end: Tag, several: bool) -> bool {
    let begin = if lost.1 { lost.0 } else { next(lost.0) };
    let groups = several.then_some(GROUPS);
    WANTED.into_iter().chain(groups).any(|(from, to)| from < end && begin <= to)
}

fn next(t: Tag) -> Tag {
    if t.1 == u16::MAX { (t.0.saturating_add(1), 0) } else { (t.0, t.1 + 1) }
}
