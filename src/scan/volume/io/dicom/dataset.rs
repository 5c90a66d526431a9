//! The elements of a DICOM data set, and their encodings (PS3.5, section 7 and annex A).

use std::collections::BTreeMap;

use crate::volume::io::raw::ByteOrder;

/// Group and element.
pub(crate) type Tag = (u16, u16);

pub(super) const PIXEL_DATA: Tag = (0x7FE0, 0x0010);
/// Pixel data of single and of double precision.
pub(super) const FLOAT_PIXEL_DATA: [Tag; 2] = [(0x7FE0, 0x0008), (0x7FE0, 0x0009)];
pub(super) const ITEM: Tag = (0xFFFE, 0xE000);
pub(super) const ITEM_END: Tag = (0xFFFE, 0xE00D);
pub(super) const SEQUENCE_END: Tag = (0xFFFE, 0xE0DD);
/// The length that means "until the delimiter".
pub(super) const UNDEFINED: u32 = u32::MAX;

/// The reason a parse failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// The bytes end inside an element. Reading more of the file may help.
    Short,
    /// The data is damaged.
    Bad(String),
}

/// Explicit or implicit value representation, and byte order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Form {
    pub explicit: bool,
    pub order: ByteOrder,
}

pub(super) const EXPLICIT: Form = Form { explicit: true, order: ByteOrder::Little };
pub(super) const IMPLICIT: Form = Form { explicit: false, order: ByteOrder::Little };

/// Deviations of a file from the standard that do not keep it from being read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Oddities {
    /// Names no transfer syntax: it is derived from the bytes.
    pub no_syntax: bool,
    /// Has explicit elements where its transfer syntax says implicit, or the reverse.
    pub other_form: bool,
    /// Has damaged elements that are not needed.
    pub damage: bool,
    /// Has a number of frames of zero.
    pub no_frames: bool,
}

/// One item: plain values and nested sequences.
#[derive(Clone, Debug, Default)]
pub(crate) struct Item {
    pub(super) values: BTreeMap<Tag, Vec<u8>>,
    pub(super) sequences: BTreeMap<Tag, Vec<Item>>,
    pub(super) order: ByteOrder,
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
#[derive(Clone, Debug, Default)]
pub(crate) struct DataSet {
    /// The data set itself.
    pub root: Item,
    /// UID of the transfer syntax.
    pub syntax: String,
    /// The pixel data, if any.
    pub pixels: Option<PixelPlace>,
    /// Its deviations from the standard.
    pub oddities: Oddities,
}
