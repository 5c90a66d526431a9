//! Elements of a data set, codes, and the file that holds them.

use std::io::{self, Write};

use dicom_core::dictionary::{DataDictionary, DataDictionaryEntry};
use dicom_core::header::HasLength;
use dicom_core::value::DataSetSequence;
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{StandardDataDictionary, uids};
use dicom_object::InMemDicomObject;
use dicom_object::meta::FileMetaTableBuilder;

/// A code: a value of a coding scheme, and what it means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    /// The value.
    pub value: &'static str,
    /// The scheme: DCM, SCT, UCUM, …
    pub scheme: &'static str,
    /// The meaning.
    pub meaning: &'static str,
}

impl Code {
    /// Returns a code.
    pub const fn new(value: &'static str, scheme: &'static str, meaning: &'static str) -> Self {
        Self { value, scheme, meaning }
    }
}

/// A data set that is made.
#[derive(Clone)]
pub(super) struct Set(InMemDicomObject);

impl Default for Set {
    fn default() -> Self {
        Self(InMemDicomObject::new_empty())
    }
}

impl Set {
    /// Adds a value, with the representation of the dictionary.
    pub(super) fn with(mut self, tag: Tag, value: impl Into<PrimitiveValue>) -> Self {
        let vr = StandardDataDictionary.by_tag(tag).map_or(VR::UN, |entry| entry.vr().relaxed());
        let value: PrimitiveValue = value.into();
        let is_empty = value.is_empty();
        self.0.put(DataElement::new(tag, vr, if is_empty { PrimitiveValue::Empty } else { value }));
        self
    }

    /// Adds bytes.
    pub(super) fn with_bytes(mut self, tag: Tag, bytes: Vec<u8>) -> Self {
        self.0.put(DataElement::new(tag, VR::OB, PrimitiveValue::U8(bytes.into())));
        self
    }

    /// Adds an attribute whose values are tags.
    pub(super) fn with_tags(self, tag: Tag, values: &[Tag]) -> Self {
        self.with(tag, PrimitiveValue::Tags(values.into()))
    }

    /// Adds a sequence.
    pub(super) fn with_items(mut self, tag: Tag, items: impl IntoIterator<Item = Self>) -> Self {
        let items: Vec<InMemDicomObject> = items.into_iter().map(|set| set.0).collect();
        self.0.put(DataElement::new(tag, VR::SQ, DataSetSequence::from(items)));
        self
    }

    /// Adds a sequence of one code.
    pub(super) fn with_code(self, tag: Tag, code: Code) -> Self {
        use dicom_dictionary_std::tags;
        let item = Self::default()
            .with(tags::CODE_VALUE, code.value)
            .with(tags::CODING_SCHEME_DESIGNATOR, code.scheme)
            .with(tags::CODE_MEANING, code.meaning);
        self.with_items(tag, [item])
    }

    /// Adds the elements of another set.
    pub(super) fn and(mut self, other: Self) -> Self {
        for element in other.0 {
            self.0.put(element);
        }
        self
    }

    /// Writes a file.
    pub(super) fn write(self, out: &mut dyn Write) -> io::Result<()> {
        let meta = FileMetaTableBuilder::new().transfer_syntax(uids::EXPLICIT_VR_LITTLE_ENDIAN);
        let file = self.0.with_meta(meta).map_err(io::Error::other)?;
        // The reason why a file cannot be written is told by its own error, which the library would hide.
        let mut bytes = Vec::new();
        file.write_all(&mut bytes).map_err(io::Error::other)?;
        out.write_all(&bytes)
    }
}

/// Returns a number as a decimal string, of 16 letters at most: all of them are there for it.
pub(super) fn decimal(value: f64) -> String {
    let whole = format!("{value}");
    if whole.len() <= 16 {
        return whole;
    }
    // From many digits to few, until it fits.
    let fits = |text: &String| text.len() <= 16;
    (0..15)
        .rev()
        .map(|digits| format!("{value:.digits$}"))
        .find(|text| fits(text) && value.abs() >= 1e-4)
        .unwrap_or_else(|| {
            (0..10).rev().map(|digits| format!("{value:.digits$e}")).find(fits).unwrap_or_else(|| "0".to_owned())
        })
}

/// Returns decimal strings.
pub(super) fn decimals(values: impl IntoIterator<Item = f64>) -> PrimitiveValue {
    PrimitiveValue::Strs(values.into_iter().map(decimal).collect())
}

/// Returns a text of several lines, without the letters that such a text must not have.
pub(super) fn long(text: &str) -> String {
    let is_plain = |c: &char| !c.is_control() || matches!(c, '\t' | '\n' | '\r' | '\u{c}');
    text.chars().filter(is_plain).collect()
}

/// Cuts a text to so many characters, without the letters that a text of one line and one value must not have.
pub(super) fn short(text: &str, most: usize) -> String {
    let plain = |c: char| if c.is_control() || c == '\\' { ' ' } else { c };
    text.trim().chars().take(most).map(plain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_strings_fit_and_are_as_near_as_they_can_be() {
        for value in
            [0.0, 1.0, -0.7, 1.0 / 3.0, -1_234.567_890_123_456, 1e-17, -2.345_678_901e-12, 98_765_432.123_456_79, 1e300]
        {
            let text = decimal(value);
            assert!(text.len() <= 16, "{text}");
            let read: f64 = text.parse().unwrap();
            assert!((read - value).abs() <= 1e-7 * value.abs().max(1e-30), "{value} {text}");
        }
        assert_eq!((decimal(0.7), decimal(-0.0)), ("0.7".to_owned(), "-0".to_owned()));
    }

    #[test]
    fn texts_have_one_line_and_one_value() {
        assert_eq!(short(" a\\b\nc ", 64), "a b c");
        assert_eq!(short("äöü", 2), "äö");
    }
}
