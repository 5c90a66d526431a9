//! Data elements in bytes that come from elsewhere: a file, or the network. Nothing is allocated for a length that is only claimed.

use std::ops::Range;

use dicom_core::Tag;

/// Length of a sequence, an item or pixel data that ends with a delimiter.
const UNDEFINED: u32 = u32::MAX;
/// Deepest sequence within a sequence.
const DEEPEST: usize = 32;
/// Ends an item.
const ITEM_END: u32 = 0xFFFE_E00D;
/// Ends a sequence, or compressed pixel data.
const SEQUENCE_END: u32 = 0xFFFE_E0DD;

/// The data elements of a data set, with their values' places. Little-endian. Iterates until the bytes end or are damaged.
#[derive(Clone, Debug)]
pub(super) struct Elements<'a> {
    bytes: &'a [u8],
    at: usize,
    explicit: bool,
    /// True if the bytes did not end with an element.
    damaged: bool,
}

impl<'a> Elements<'a> {
    /// Elements that tell how their values are represented.
    pub(super) fn explicit(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, explicit: true, damaged: false }
    }

    /// Elements that do not.
    pub(super) fn implicit(bytes: &'a [u8]) -> Self {
        Self { explicit: false, ..Self::explicit(bytes) }
    }

    /// True if the bytes consist of whole elements.
    pub(super) fn are_whole(mut self) -> bool {
        self.by_ref().for_each(drop);
        !self.damaged
    }

    /// Place of the next element.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    fn u32(&mut self) -> Option<u32> {
        let bytes = self.bytes.get(self.at..self.at.checked_add(4)?)?;
        self.at += 4;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    }

    /// Reads a tag, as group and element in one number, and the length of its value.
    fn head(&mut self) -> Option<(u32, u32)> {
        let tag = self.u32()?.rotate_left(16);
        // Delimiters and items have no representation in either form.
        if !self.explicit || tag >> 16 == 0xFFFE {
            return Some((tag, self.u32()?));
        }
        let [a, b, low, high] = self.u32()?.to_le_bytes();
        let is_long = matches!(
            &[a, b],
            b"OB" | b"OD" | b"OF" | b"OL" | b"OV" | b"OW" | b"SQ" | b"SV" | b"UC" | b"UN" | b"UR" | b"UT" | b"UV"
        );
        if !(a.is_ascii_uppercase() && b.is_ascii_uppercase()) {
            return None;
        }
        Some((tag, if is_long { self.u32()? } else { u32::from(u16::from_le_bytes([low, high])) }))
    }

    /// Passes a value. Returns its place, which includes the delimiter of a value that has one.
    fn value(&mut self, length: u32, depth: usize) -> Option<Range<usize>> {
        let start = self.at;
        if length != UNDEFINED {
            self.at = self.at.checked_add(length as usize).filter(|end| *end <= self.bytes.len())?;
            return Some(start..self.at);
        }
        if depth == DEEPEST {
            return None;
        }
        loop {
            let (tag, length) = self.head()?;
            self.value(if matches!(tag, ITEM_END | SEQUENCE_END) { 0 } else { length }, depth + 1)?;
            if matches!(tag, ITEM_END | SEQUENCE_END) {
                return Some(start..self.at);
            }
        }
    }
}

impl<'a> Iterator for Elements<'a> {
    type Item = (Tag, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        if self.damaged || self.at >= self.bytes.len() {
            return None;
        }
        let (before, next) = (self.at, self.head());
        let found = next.and_then(|(tag, length)| Some((tag, self.value(length, 0)?)));
        if found.is_none() {
            (self.damaged, self.at) = (true, before);
        }
        found.map(|(tag, place)| (Tag((tag >> 16) as u16, tag as u16), &self.bytes[place]))
    }
}

/// Returns a text without the padding at its end.
pub(super) fn text(value: &[u8]) -> String {
    String::from_utf8_lossy(value).trim_matches(|c: char| c == '\0' || c.is_whitespace()).to_owned()
}

/// Writes an element without its representation. A value of odd length is padded.
pub(super) fn put_implicit(out: &mut Vec<u8>, tag: Tag, value: &[u8], pad: u8) {
    out.extend(tag.0.to_le_bytes());
    out.extend(tag.1.to_le_bytes());
    out.extend((value.len().next_multiple_of(2) as u32).to_le_bytes());
    out.extend(value);
    if value.len() % 2 == 1 {
        out.push(pad);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAME: Tag = Tag(0x0010, 0x0010);

    #[test]
    fn elements_of_both_forms_are_read_to_their_end() {
        let mut implicit = Vec::new();
        put_implicit(&mut implicit, NAME, b"Doe", b' ');
        put_implicit(&mut implicit, Tag(0x0020, 0x000D), b"1.2", 0);
        let read: Vec<_> = Elements::implicit(&implicit).map(|(tag, v)| (tag, text(v))).collect();
        assert_eq!(read, [(NAME, "Doe".to_owned()), (Tag(0x0020, 0x000D), "1.2".to_owned())]);
        // A sequence of undefined length, and compressed pixel data.
        let explicit = b"\x08\0\x60\0CS\x02\0CT\x00\x52\x30\x92SQ\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\xff\xff\xff\xff\
            \x20\0\x32\0DS\x02\x001 \xfe\xff\x0d\xe0\0\0\0\0\xfe\xff\xdd\xe0\0\0\0\0\xe0\x7f\x10\0OB\0\0\xff\xff\xff\xff\
            \xfe\xff\x00\xe0\0\0\0\0\xfe\xff\x00\xe0\x02\0\0\0ab\xfe\xff\xdd\xe0\0\0\0\0";
        let read = Elements::explicit(explicit);
        assert!(read.clone().are_whole());
        assert_eq!(read.map(|e| e.0).collect::<Vec<_>>(), [Tag(8, 0x60), Tag(0x5200, 0x9230), Tag(0x7FE0, 0x0010)]);
        for end in 1..explicit.len() {
            let rest = Elements::explicit(&explicit[..end]);
            assert!(rest.clone().are_whole() == matches!(end, 10 | 56), "{end}");
        }
        assert!(Elements::implicit(&[]).are_whole());
    }

    #[test]
    fn claimed_lengths_and_endless_nesting_are_damage() {
        for bytes in [&b"\x10\0\x10\0\xfe\xff\xff\xffab"[..], b"\x10\0", b"\x10\0\x10\0\x04\0\0\0ab"] {
            assert!(!Elements::implicit(bytes).are_whole());
        }
        let deep = b"\x10\0\x10\0\xff\xff\xff\xff".repeat(100_000);
        assert!(!Elements::implicit(&deep).are_whole());
    }
}
