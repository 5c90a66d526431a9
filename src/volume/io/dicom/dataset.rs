//! The elements of a DICOM data set, parsed from bytes in memory.
//!
//! Every length is checked against the available bytes before it is used, so an invalid header costs nothing. Parsing
//! stops at the pixel data and only records its position. Encodings follow PS3.5, section 7 and annex A.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Read;

use crate::volume::io::raw::ByteOrder;

/// Group and element.
pub(crate) type Tag = (u16, u16);

const PIXEL_DATA: Tag = (0x7FE0, 0x0010);
/// Pixel data of single and of double precision.
const FLOAT_PIXEL_DATA: [Tag; 2] = [(0x7FE0, 0x0008), (0x7FE0, 0x0009)];
const ITEM: Tag = (0xFFFE, 0xE000);
const ITEM_END: Tag = (0xFFFE, 0xE00D);
const SEQUENCE_END: Tag = (0xFFFE, 0xE0DD);
const TRANSFER_SYNTAX: Tag = (0x0002, 0x0010);
/// The length that means "until the delimiter".
const UNDEFINED: u32 = u32::MAX;
/// Maximum length of a value, bytes. Longer ones (curves, private blobs) are skipped, but for …
const LONGEST_VALUE: usize = 1 << 16;
/// … the data of a look-up table, of 65536 entries at most.
const LUT_DATA: Tag = (0x0028, 0x3006);
const LONGEST_LUT: usize = 1 << 17;
/// Maximum depth of nested sequences.
const DEEPEST: u32 = 12;
/// Maximum unpacked size of a deflated data set, bytes.
const MOST_UNPACKED: u64 = 1 << 30;

/// The reason a parse failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// The bytes end inside an element. Reading more of the file may help.
    Short,
    /// The data is damaged.
    Bad(String),
}

/// Explicit or implicit value representation, and byte order.
#[derive(Clone, Copy)]
struct Form {
    explicit: bool,
    order: ByteOrder,
}

/// One item: plain values and nested sequences.
#[derive(Clone, Debug, Default)]
pub(crate) struct Item {
    values: BTreeMap<Tag, Vec<u8>>,
    sequences: BTreeMap<Tag, Vec<Item>>,
    order: ByteOrder,
}

impl Item {
    /// Returns the text of an element without padding; `None` if absent or empty.
    pub(crate) fn text(&self, tag: Tag) -> Option<String> {
        let bytes = self.values.get(&tag)?;
        let text = String::from_utf8_lossy(bytes);
        let text = text.trim_matches(['\0', ' ']);
        (!text.is_empty()).then(|| text.to_owned())
    }

    /// Returns the numbers of a decimal or integer string.
    pub(crate) fn decimals(&self, tag: Tag) -> Option<Vec<f64>> {
        self.text(tag)?.split('\\').map(|t| t.trim().parse().ok()).collect()
    }

    /// Returns the first number of a decimal or integer string.
    pub(crate) fn decimal(&self, tag: Tag) -> Option<f64> {
        self.decimals(tag)?.first().copied()
    }

    /// Returns an unsigned short.
    pub(crate) fn short(&self, tag: Tag) -> Option<u16> {
        self.values.get(&tag)?.first_chunk().map(|b| self.word(*b))
    }

    /// Returns the unsigned shorts of an element.
    pub(crate) fn shorts(&self, tag: Tag) -> Option<Vec<u16>> {
        Some(self.values.get(&tag)?.as_chunks().0.iter().map(|b| self.word(*b)).collect())
    }

    /// Returns the bytes of an element.
    pub(crate) fn bytes(&self, tag: Tag) -> Option<&[u8]> {
        self.values.get(&tag).map(Vec::as_slice)
    }

    fn word(&self, bytes: [u8; 2]) -> u16 {
        match self.order {
            ByteOrder::Little => u16::from_le_bytes(bytes),
            ByteOrder::Big => u16::from_be_bytes(bytes),
        }
    }

    /// Returns an unsigned long.
    pub(crate) fn long(&self, tag: Tag) -> Option<u32> {
        let b: [u8; 4] = self.values.get(&tag)?.get(..4)?.try_into().ok()?;
        Some(match self.order {
            ByteOrder::Little => u32::from_le_bytes(b),
            ByteOrder::Big => u32::from_be_bytes(b),
        })
    }

    /// Returns the floating point number of an element that holds one, single or double.
    pub(crate) fn float(&self, tag: Tag) -> Option<f64> {
        let bytes = self.values.get(&tag)?;
        let little = self.order == ByteOrder::Little;
        if let Ok(b) = <[u8; 4]>::try_from(&bytes[..]) {
            return Some(f64::from(if little { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) }));
        }
        let b: [u8; 8] = bytes.get(..8)?.try_into().ok()?;
        Some(if little { f64::from_le_bytes(b) } else { f64::from_be_bytes(b) })
    }

    /// Returns the first item of each sequence.
    pub(crate) fn nested(&self) -> impl Iterator<Item = &Item> {
        self.sequences.values().filter_map(|items| items.first())
    }

    /// Returns the items of a sequence.
    pub(crate) fn items(&self, tag: Tag) -> &[Item] {
        self.sequences.get(&tag).map_or(&[], Vec::as_slice)
    }
}

/// Position of pixel data in the (inflated) bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PixelPlace {
    /// Offset of the first byte.
    pub offset: usize,
    /// Length in bytes; `None` for encapsulated fragments.
    pub length: Option<usize>,
    /// True if samples are floats.
    pub is_float: bool,
}

/// The elements of a file up to its pixel data.
#[derive(Clone, Debug)]
pub(crate) struct DataSet {
    /// The data set itself.
    pub root: Item,
    /// UID of the transfer syntax.
    pub syntax: String,
    /// The pixel data, if any.
    pub pixels: Option<PixelPlace>,
}

/// Parses a file's bytes. Also returns the bytes that the pixel position refers to: the inflated ones for a deflated
/// transfer syntax, else `bytes` itself.
///
/// # Errors
/// Returns [`Fault::Short`] if `bytes` end inside an element, [`Fault::Bad`] if they are damaged.
pub(crate) fn parse(bytes: &[u8]) -> Result<(DataSet, Cow<'_, [u8]>), Fault> {
    let mut root = Item::default();
    let (syntax, pixels, body) = parse_into(bytes, &mut root)?;
    Ok((DataSet { root, syntax, pixels }, body))
}

/// Returns the elements before the place where a damaged file cannot be parsed further.
pub(crate) fn parse_start(bytes: &[u8]) -> Item {
    let mut root = Item::default();
    // The fault is known already.
    let _ = parse_into(bytes, &mut root);
    root
}

/// Syntax, pixel data, and the bytes that its position refers to.
type Parsed<'a> = (String, Option<PixelPlace>, Cow<'a, [u8]>);

fn parse_into<'a>(bytes: &'a [u8], root: &mut Item) -> Result<Parsed<'a>, Fault> {
    let start = if bytes.get(128..132) == Some(b"DICM") { 132 } else { 0 };
    let mut meta = Walk { bytes, at: start, form: Form { explicit: true, order: ByteOrder::Little }, pixels: None };
    let mut head = Item::default();
    while meta.peek_group()? == Some(2) {
        meta.element(&mut head, 0)?;
    }
    let syntax = head.text(TRANSFER_SYNTAX).ok_or_else(|| Fault::Bad("names no transfer syntax".to_owned()))?;
    let form = match syntax.as_str() {
        "1.2.840.10008.1.2" => Form { explicit: false, order: ByteOrder::Little },
        "1.2.840.10008.1.2.2" => Form { explicit: true, order: ByteOrder::Big },
        _ => Form { explicit: true, order: ByteOrder::Little },
    };
    let body = if syntax == "1.2.840.10008.1.2.1.99" {
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
    let mut walk = Walk { bytes: &body, at, form, pixels: None };
    root.order = form.order;
    while walk.pixels.is_none() && walk.peek_group()?.is_some() {
        walk.element(root, 0)?;
    }
    let pixels = walk.pixels;
    Ok((syntax, pixels, body))
}

struct Walk<'a> {
    bytes: &'a [u8],
    at: usize,
    form: Form,
    pixels: Option<PixelPlace>,
}

impl<'a> Walk<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], Fault> {
        let end = self.at.checked_add(n).ok_or(Fault::Short)?;
        let taken = self.bytes.get(self.at..end).ok_or(Fault::Short)?;
        self.at = end;
        Ok(taken)
    }

    fn u16(&mut self) -> Result<u16, Fault> {
        let b = self.take(2)?;
        Ok(match self.form.order {
            ByteOrder::Little => u16::from_le_bytes([b[0], b[1]]),
            ByteOrder::Big => u16::from_be_bytes([b[0], b[1]]),
        })
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        let b = self.take(4)?;
        let b = [b[0], b[1], b[2], b[3]];
        Ok(match self.form.order {
            ByteOrder::Little => u32::from_le_bytes(b),
            ByteOrder::Big => u32::from_be_bytes(b),
        })
    }

    fn tag(&mut self) -> Result<Tag, Fault> {
        Ok((self.u16()?, self.u16()?))
    }

    /// Returns the group of the next element; `None` at the end.
    fn peek_group(&mut self) -> Result<Option<u16>, Fault> {
        if self.at >= self.bytes.len() {
            return Ok(None);
        }
        let at = self.at;
        let group = self.u16();
        self.at = at;
        group.map(Some)
    }

    /// Reads value representation and length of the element whose tag has just been read.
    fn representation(&mut self) -> Result<([u8; 2], u32), Fault> {
        if !self.form.explicit {
            return Ok(([0, 0], self.u32()?));
        }
        let vr = self.take(2)?;
        let vr = [vr[0], vr[1]];
        if !vr.iter().all(u8::is_ascii_uppercase) {
            return Err(Fault::Bad(format!("is damaged at byte {} (no value representation)", self.at)));
        }
        let long =
            [b"OB", b"OW", b"OF", b"OD", b"OL", b"OV", b"SQ", b"UN", b"UT", b"UC", b"UR", b"SV", b"UV"].contains(&&vr);
        if long {
            self.u16()?;
            Ok((vr, self.u32()?))
        } else {
            Ok((vr, u32::from(self.u16()?)))
        }
    }

    fn element(&mut self, into: &mut Item, depth: u32) -> Result<(), Fault> {
        let tag = self.tag()?;
        let (vr, length) = self.representation()?;
        let is_float = FLOAT_PIXEL_DATA.contains(&tag);
        if (tag == PIXEL_DATA || is_float) && depth == 0 {
            let length = (length != UNDEFINED).then_some(length as usize);
            self.pixels = Some(PixelPlace { offset: self.at, length, is_float });
            return Ok(());
        }
        // A value of unknown representation and undefined length is a sequence in implicit form (PS3.5, 6.2.2).
        let sequence = &vr == b"SQ" || length == UNDEFINED || (&vr == b"\0\0" && self.looks_like_items(length));
        if !sequence {
            let value = self.take(length as usize)?;
            let longest = if tag == LUT_DATA { LONGEST_LUT } else { LONGEST_VALUE };
            if value.len() <= longest && tag.0 % 2 == 0 {
                into.values.insert(tag, value.to_vec());
            }
            return Ok(());
        }
        if depth >= DEEPEST {
            return Err(Fault::Bad("nests sequences too deeply".to_owned()));
        }
        let outer = self.form;
        if &vr == b"UN" {
            self.form = Form { explicit: false, order: ByteOrder::Little };
        }
        let items = self.sequence(length, depth)?;
        self.form = outer;
        if tag.0 % 2 == 0 {
            into.sequences.insert(tag, items);
        }
        Ok(())
    }

    /// True if a value looks like a sequence. Implicit form does not distinguish sequences from values, but an item's
    /// tag at the start does.
    fn looks_like_items(&self, length: u32) -> bool {
        length >= 8 && self.bytes.get(self.at..self.at.saturating_add(4)) == Some(&[0xFE, 0xFF, 0x00, 0xE0])
    }

    /// Returns the end of a part of known length, which must be within the bytes.
    fn end_of(&self, length: u32) -> Result<usize, Fault> {
        if length == UNDEFINED {
            return Ok(usize::MAX);
        }
        self.at.checked_add(length as usize).filter(|e| *e <= self.bytes.len()).ok_or(Fault::Short)
    }

    fn sequence(&mut self, length: u32, depth: u32) -> Result<Vec<Item>, Fault> {
        let end = self.end_of(length)?;
        let mut items = Vec::new();
        while self.at < end {
            match self.tag()? {
                ITEM => {
                    let length = self.u32()?;
                    items.push(self.item(length, depth)?);
                }
                SEQUENCE_END => {
                    self.u32()?;
                    return Ok(items);
                }
                _ => return Err(Fault::Bad(format!("is damaged at byte {} (no item in a sequence)", self.at))),
            }
        }
        Ok(items)
    }

    fn item(&mut self, length: u32, depth: u32) -> Result<Item, Fault> {
        let end = self.end_of(length)?;
        let mut item = Item { order: self.form.order, ..Item::default() };
        while self.at < end {
            let at = self.at;
            if self.tag()? == ITEM_END {
                self.u32()?;
                break;
            }
            self.at = at;
            self.element(&mut item, depth + 1)?;
        }
        Ok(item)
    }
}

/// Returns the fragments of encapsulated pixel data, without the preceding offset table (PS3.5, A.4).
///
/// # Errors
/// Returns [`Fault::Short`] if the data ends inside a fragment.
pub(crate) fn fragments(bytes: &[u8], offset: usize) -> Result<Vec<&[u8]>, Fault> {
    let mut walk = Walk { bytes, at: offset, form: Form { explicit: true, order: ByteOrder::Little }, pixels: None };
    let mut out = Vec::new();
    loop {
        match walk.tag()? {
            ITEM => {
                let length = walk.u32()?;
                out.push(walk.take(length as usize)?);
            }
            SEQUENCE_END => break,
            _ => return Err(Fault::Bad("has no fragment where one is expected".to_owned())),
        }
    }
    if out.is_empty() {
        return Err(Fault::Bad("has no offset table before its fragments".to_owned()));
    }
    out.remove(0);
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(syntax: &str, body: &[u8]) -> Vec<u8> {
        let mut uid = syntax.as_bytes().to_vec();
        uid.resize(uid.len().next_multiple_of(2), 0);
        let mut f = vec![0; 128];
        f.extend(b"DICM\x02\0\x10\0UI");
        f.extend((uid.len() as u16).to_le_bytes());
        f.extend(uid);
        f.extend(body);
        f
    }

    #[test]
    fn a_length_beyond_the_file_is_short_and_allocates_nothing() {
        for length in [5u32, 1 << 20, u32::MAX - 1] {
            let mut body = b"\x08\0\x05\0UN\0\0".to_vec();
            body.extend(length.to_le_bytes());
            body.extend(b"abcd");
            assert_eq!(parse(&file("1.2.840.10008.1.2.1", &body)).unwrap_err(), Fault::Short);
        }
    }

    #[test]
    fn nested_sequences_of_both_lengths() {
        // SQ (0008,1140) of undefined length with an item of undefined length that holds a value and another SQ of
        // defined length.
        let mut body = b"\x08\0\x40\x11SQ\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\xff\xff\xff\xff".to_vec();
        body.extend(b"\x28\0\x10\0US\x02\0\x07\0");
        body.extend(b"\x08\0\x41\x11SQ\0\0\x10\0\0\0\xfe\xff\x00\xe0\x08\0\0\0\x10\0\x10\0LO\0\0");
        body.extend(b"\xfe\xff\x0d\xe0\0\0\0\0\xfe\xff\xdd\xe0\0\0\0\0");
        body.extend(b"\xe0\x7f\x10\0OW\0\0\x02\0\0\0ab");
        let bytes = file("1.2.840.10008.1.2.1", &body);
        let (set, _) = parse(&bytes).unwrap();
        let items = set.root.items((0x0008, 0x1140));
        assert_eq!(items[0].short((0x0028, 0x0010)), Some(7));
        assert_eq!(items[0].items((0x0008, 0x1141)).len(), 1);
        assert_eq!(set.pixels, Some(PixelPlace { offset: bytes.len() - 2, length: Some(2), is_float: false }));
    }

    #[test]
    fn deep_nesting_is_refused() {
        let mut body = Vec::new();
        for _ in 0..100 {
            body.extend(b"\x08\0\x40\x11SQ\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\xff\xff\xff\xff");
        }
        assert!(matches!(parse(&file("1.2.840.10008.1.2.1", &body)), Err(Fault::Bad(_))));
    }

    /// A sequence of unknown representation is in implicit form, and what follows it is not (PS3.5, 6.2.2).
    #[test]
    fn an_unknown_sequence_leaves_the_explicit_form_as_it_was() {
        let mut body = b"\x08\0\x40\x11UN\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\x0a\0\0\0".to_vec();
        body.extend(b"\x28\0\x10\0\x02\0\0\0\x07\0\xfe\xff\xdd\xe0\0\0\0\0");
        body.extend(b"\x28\0\x11\0US\x02\0\x09\0");
        body.extend(b"\xe0\x7f\x10\0OW\0\0\x02\0\0\0ab");
        let bytes = file("1.2.840.10008.1.2.1", &body);
        let (set, _) = parse(&bytes).unwrap();
        assert_eq!(set.root.items((0x0008, 0x1140))[0].short((0x0028, 0x0010)), Some(7));
        assert_eq!(set.root.short((0x0028, 0x0011)), Some(9));
        assert_eq!(set.pixels, Some(PixelPlace { offset: bytes.len() - 2, length: Some(2), is_float: false }));
    }

    #[test]
    fn the_implicit_form_tells_values_from_sequences_by_their_bytes() {
        let mut body = b"\x28\0\x11\0\x02\0\0\0\x09\0\x08\0\x40\x11\x12\0\0\0".to_vec();
        body.extend(b"\xfe\xff\x00\xe0\x0a\0\0\0\x28\0\x10\0\x02\0\0\0\x07\0");
        body.extend(b"\x18\0\x50\0\x0a\0\0\x000.62500000\xe0\x7f\x10\0\x02\0\0\0ab");
        let bytes = file("1.2.840.10008.1.2", &body);
        let (set, _) = parse(&bytes).unwrap();
        assert_eq!(set.root.short((0x0028, 0x0011)), Some(9));
        assert_eq!(set.root.items((0x0008, 0x1140))[0].short((0x0028, 0x0010)), Some(7));
        assert_eq!(set.root.decimal((0x0018, 0x0050)), Some(0.625), "ten bytes that do not begin as an item does");
        assert_eq!(set.pixels, Some(PixelPlace { offset: bytes.len() - 2, length: Some(2), is_float: false }));
    }

    #[test]
    fn a_decimal_is_the_first_number_of_a_value() {
        let mut body = b"\x18\0\x50\0DS\x04\x002.5 \x20\0\x11\0IS\x02\0x ".to_vec();
        body.extend(b"\x28\0\x30\0DS\x08\x000.7\\0.8 ");
        let bytes = file("1.2.840.10008.1.2.1", &body);
        let root = parse(&bytes).unwrap().0.root;
        assert_eq!(root.decimal((0x0018, 0x0050)), Some(2.5));
        assert_eq!(root.decimal((0x0028, 0x0030)), Some(0.7));
        assert_eq!(root.decimals((0x0028, 0x0030)), Some(vec![0.7, 0.8]));
        assert_eq!(root.decimal((0x0020, 0x0011)), None, "no number");
        assert_eq!(root.decimal((0x0018, 0x0088)), None, "not there");
    }
}
