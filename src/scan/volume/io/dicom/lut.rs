//! The Modality LUT: a table from stored values to HU (PS3.3, C.11.1).

use super::dataset::{Item, Tag};
use super::units::Units;

/// Modality LUT Sequence.
pub(super) const SEQUENCE: Tag = (0x0028, 0x3000);
const DESCRIPTOR: Tag = (0x0028, 0x3002);
const TYPE: Tag = (0x0028, 0x3004);
const DATA: Tag = (0x0028, 0x3006);

/// A table of HU.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Lut {
    /// Stored value of the first entry.
    first: i32,
    /// HU of the stored values from there on; at least one.
    entries: Vec<i16>,
}

/// Returns the units of the values of the data set's Modality LUT; `None` without one.
pub(super) fn units(root: &Item) -> Option<Units> {
    let item = root.items(SEQUENCE).first()?;
    Some(item.text(TYPE).map_or(Units::Missing, |term| Units::of("ModalityLUTType", &term)))
}

impl Lut {
    /// Reads the table of a data set whose stored values are `signed` or not.
    ///
    /// Entries of 16 bits are taken as signed. The standard has none below zero, but HU have, and writers store them so. Fails with
    /// a short description if the table is missing, or shorter than it declares.
    pub(super) fn of(root: &Item, signed: bool) -> Result<Self, String> {
        let item = root.items(SEQUENCE).first().ok_or("has no Modality LUT")?;
        let descriptor = item.shorts(DESCRIPTOR).unwrap_or_default();
        let [count, first, bits] = descriptor[..] else {
            return Err("its Modality LUT has no descriptor of three numbers".to_owned());
        };
        if !(1..=16).contains(&bits) {
            return Err(format!("its Modality LUT has entries of {bits} bits, not of 8 or 16"));
        }
        let count = if count == 0 { 1 << 16 } else { usize::from(count) };
        let (bytes, words) = (item.bytes(DATA).unwrap_or_default(), item.shorts(DATA).unwrap_or_default());
        // Entries of eight bits are one a word, or packed.
        let entry = |word: &u16| {
            let value = if bits == 16 { *word } else { word & ((1 << bits) - 1) };
            value.cast_signed()
        };
        let entries: Vec<i16> = if words.len() >= count {
            words[..count].iter().map(entry).collect()
        } else if bits <= 8 && bytes.len() >= count {
            bytes[..count].iter().map(|b| entry(&u16::from(*b))).collect()
        } else {
            return Err(format!(
                "its Modality LUT ends early: {count} entries are declared, {} are there",
                words.len()
            ));
        };
        let first = if signed { i32::from(first.cast_signed()) } else { i32::from(first) };
        Ok(Self { first, entries })
    }

    /// Returns the HU of a stored value. Values before the first entry or after the last have that of the nearest.
    pub(super) fn hu(&self, stored: i32) -> i16 {
        let at = (stored - self.first).max(0) as usize;
        self.entries[at.min(self.entries.len() - 1)]
    }
}
