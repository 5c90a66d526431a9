//! Walks through the bytes of a data set, element by element.
//!
//! Every length is checked against the available bytes before it is used, so an invalid header costs nothing. The walk stops at
//! the pixel data and only records its position.

use super::dataset::{
    FLOAT_PIXEL_DATA, Fault, Form, IMPLICIT, ITEM, ITEM_END, Item, PIXEL_DATA, PixelPlace, SEQUENCE_END, Tag, UNDEFINED,
};
use super::recover;
use crate::volume::io::raw::ByteOrder;

/// Maximum length of a value, bytes. Longer ones (curves, private blobs) are skipped, but for …
const LONGEST_VALUE: usize = 1 << 16;
/// … the data of a look-up table, of 65536 entries at most.
const LUT_DATA: Tag = (0x0028, 0x3006);
const LONGEST_LUT: usize = 1 << 17;
/// Maximum depth of nested sequences.
const DEEPEST: u32 = 12;

/// A place in the bytes of a data set, and the form of what is read there.
pub(super) struct Walk<'a> {
    pub bytes: &'a [u8],
    pub at: usize,
    pub form: Form,
    pub pixels: Option<PixelPlace>,
}

impl<'a> Walk<'a> {
    pub(super) fn new(bytes: &'a [u8], at: usize, form: Form) -> Self {
        Self { bytes, at, form, pixels: None }
    }

    pub(super) fn take(&mut self, n: usize) -> Result<&'a [u8], Fault> {
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

    pub(super) fn u32(&mut self) -> Result<u32, Fault> {
        let b = self.take(4)?;
        let b = [b[0], b[1], b[2], b[3]];
        Ok(match self.form.order {
            ByteOrder::Little => u32::from_le_bytes(b),
            ByteOrder::Big => u32::from_be_bytes(b),
        })
    }

    pub(super) fn tag(&mut self) -> Result<Tag, Fault> {
        Ok((self.u16()?, self.u16()?))
    }

    /// Returns the group of the next element; `None` at the end.
    pub(super) fn peek_group(&mut self) -> Result<Option<u16>, Fault> {
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
            // One element in implicit form among explicit ones.
            let begin = self.at - 6;
            let implicit = Form { explicit: false, ..self.form };
            if let Ok(length) = self.length_at(begin + 4)
                && recover::plausible(self.bytes, begin, self.bytes.len(), implicit, None, 0)
                && (length as usize).checked_add(begin + 8).is_some_and(|end| {
                    recover::plausible(self.bytes, end, self.bytes.len(), self.form, self.tag_at(begin), 1)
                })
            {
                self.at = begin + 8;
                return Ok(([0, 0], length));
            }
            return Err(Fault::Bad(format!("is damaged at byte {} (no value representation)", self.at)));
        }
        if recover::is_long(vr) {
            self.u16()?;
            Ok((vr, self.u32()?))
        } else {
            Ok((vr, u32::from(self.u16()?)))
        }
    }

    fn length_at(&self, at: usize) -> Result<u32, Fault> {
        Walk { at, ..*self }.u32()
    }

    fn tag_at(&self, at: usize) -> Option<Tag> {
        Walk { at, ..*self }.tag().ok()
    }

    pub(super) fn element(&mut self, into: &mut Item, depth: u32) -> Result<(), Fault> {
        let tag = self.tag()?;
        let (vr, length) = self.representation()?;
        let is_float = FLOAT_PIXEL_DATA.contains(&tag);
        if (tag == PIXEL_DATA || is_float) && depth == 0 {
            let length = (length != UNDEFINED).then_some(length as usize);
            self.pixels = Some(PixelPlace { offset: self.at, length, is_float });
            return Ok(());
        }
        if length == UNDEFINED && (tag == PIXEL_DATA || vr[0] == b'O') {
            // Pixel data of an icon, encapsulated.
            return self.pass_fragments();
        }
        // A private sequence is skipped as a whole, whatever the form of its items.
        let private = tag.0 % 2 == 1 && length != UNDEFINED;
        // A value of unknown representation and undefined length is a sequence in implicit form (PS3.5, 6.2.2).
        let sequence = &vr == b"SQ" || length == UNDEFINED || (&vr == b"\0\0" && self.looks_like_items(length));
        if !sequence || private {
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
            self.form = IMPLICIT;
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
        let outer = self.form;
        // Some writers leave the items of a sequence in another form.
        self.form = recover::form_at(self.bytes, self.at, end, outer);
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
        self.form = outer;
        Ok(item)
    }

    fn pass_fragments(&mut self) -> Result<(), Fault> {
        loop {
            match self.tag()? {
                ITEM => {
                    let length = self.u32()?;
                    self.take(length as usize)?;
                }
                SEQUENCE_END => return self.u32().map(drop),
                _ => return Err(Fault::Bad(format!("is damaged at byte {} (no fragment)", self.at))),
            }
        }
    }
}
