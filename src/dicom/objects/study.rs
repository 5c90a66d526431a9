//! Whose objects are written, and what all of them say.

use colvis_scan::volume::io::identity::{self, ATTRIBUTES, Identity, SourceImage};
use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_encoding::text::{SpecificCharacterSet, TextCodec};
use sha2::{Digest, Sha256};

use super::set::{Set, short};

/// A date that stands for none, where one must be given (PS3.15, table E.1-1: a dummy).
const NO_DATE: [&str; 2] = ["19000101", "000000"];

/// The patient and the study that objects belong to.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// UID of the study.
    pub study: String,
    /// UID of the frame of reference of all places.
    pub frame_of_reference: String,
    /// UID of the series that was read, if it may be told.
    pub series: Option<String>,
    /// The slices of that series.
    pub images: Vec<SourceImage>,
    /// Attributes of the patient and the study, in UTF-8.
    values: Vec<(identity::Tag, String)>,
    /// Date and time of the content.
    date: [String; 2],
    /// True if nothing of the patient is told.
    is_nobodys: bool,
}

impl Study {
    /// Returns a study of a patient without a name. `scan` is what distinguishes the scan from others, such as its hash.
    pub fn nobodys(scan: &str) -> Self {
        let short: String = scan.rsplit(':').next().unwrap_or_default().chars().take(12).collect();
        Self {
            study: uid(&["study", scan]),
            frame_of_reference: uid(&["frame", scan]),
            series: None,
            images: Vec::new(),
            values: vec![
                (identity::PATIENT_NAME, format!("scan^{short}")),
                (identity::PATIENT_ID, format!("scan-{short}")),
            ],
            date: NO_DATE.map(str::to_owned),
            is_nobodys: true,
        }
    }

    /// Returns the study of an identity. `date` is the day and time of the reading in UTC, as `YYYYMMDD` and `HHMMSS`. UIDs that the
    /// headers lack are made from `scan`, as [`Study::nobodys`] does.
    pub fn of(identity: &Identity, scan: &str, date: [String; 2]) -> Self {
        let text = |tag: identity::Tag| {
            let bytes = identity.values.get(&tag)?;
            Some(decode(&identity.character_set, bytes)).filter(|text| !text.is_empty())
        };
        let none = Self::nobodys(scan);
        let values = ATTRIBUTES.into_iter().filter_map(|tag| Some((tag, text(tag)?))).collect();
        Self {
            study: text(identity::STUDY).unwrap_or(none.study),
            frame_of_reference: text(identity::FRAME_OF_REFERENCE).unwrap_or(none.frame_of_reference),
            series: text(identity::SERIES),
            images: identity.images.clone(),
            values,
            date,
            is_nobodys: false,
        }
    }

    /// True if nothing of the patient is told.
    pub fn is_nobodys(&self) -> bool {
        self.is_nobodys
    }

    /// Returns an attribute of the patient or the study; `None` if it is not known.
    pub fn text(&self, tag: identity::Tag) -> Option<&str> {
        self.values.iter().find(|v| v.0 == tag).map(|v| v.1.as_str())
    }

    /// Returns the patient, study, series and equipment modules and the common ones of an object.
    pub(super) fn head(&self, about: &About<'_>) -> Set {
        let [date, time] = self.date.clone();
        let text = |tag: identity::Tag| self.text(tag).unwrap_or_default().to_owned();
        let set = Set::default()
            .with(tags::SPECIFIC_CHARACTER_SET, "ISO_IR 192")
            .with(tags::SOP_CLASS_UID, about.class)
            .with(tags::SOP_INSTANCE_UID, about.instance)
            .with(tags::STUDY_DATE, text(identity::STUDY_DATE))
            .with(tags::STUDY_TIME, text((0x0008, 0x0030)))
            .with(tags::CONTENT_DATE, date)
            .with(tags::CONTENT_TIME, time)
            .with(tags::TIMEZONE_OFFSET_FROM_UTC, "+0000")
            .with(tags::ACCESSION_NUMBER, text(identity::ACCESSION))
            .with(tags::MODALITY, about.modality)
            .with(tags::MANUFACTURER, "colvis")
            .with(tags::MANUFACTURER_MODEL_NAME, "colvis")
            .with(tags::DEVICE_SERIAL_NUMBER, env!("CARGO_PKG_VERSION"))
            .with(tags::SOFTWARE_VERSIONS, env!("CARGO_PKG_VERSION"))
            .with(tags::REFERRING_PHYSICIAN_NAME, text((0x0008, 0x0090)))
            .with(tags::SERIES_DESCRIPTION, short(about.description, 64))
            .with(tags::PATIENT_NAME, text(identity::PATIENT_NAME))
            .with(tags::PATIENT_ID, text(identity::PATIENT_ID))
            .with(tags::PATIENT_BIRTH_DATE, text(identity::BIRTH_DATE))
            .with(tags::PATIENT_SEX, text(identity::SEX))
            .with(tags::STUDY_INSTANCE_UID, self.study.as_str())
            .with(tags::SERIES_INSTANCE_UID, about.series)
            .with(tags::STUDY_ID, text((0x0020, 0x0010)))
            .with(tags::SERIES_NUMBER, about.series_number.to_string())
            .with(tags::INSTANCE_NUMBER, about.number.to_string());
        let set = if self.is_nobodys {
            set.with(tags::PATIENT_IDENTITY_REMOVED, "YES")
                .with(tags::DEIDENTIFICATION_METHOD, "nothing of the patient was taken over from the scan")
        } else {
            set
        };
        let optional: [(Tag, identity::Tag); 3] = [
            (tags::STUDY_DESCRIPTION, identity::STUDY_DESCRIPTION),
            (tags::ISSUER_OF_PATIENT_ID, (0x0010, 0x0021)),
            (tags::PATIENT_AGE, (0x0010, 0x1010)),
        ];
        let known = optional.into_iter().filter_map(|(tag, of)| Some((tag, self.text(of)?)));
        known.fold(set, |set, (tag, text)| set.with(tag, text))
    }

    /// Returns the frame of reference module.
    pub(super) fn frame(&self) -> Set {
        let indicator = self.text((0x0020, 0x1040)).unwrap_or_default();
        Set::default()
            .with(tags::FRAME_OF_REFERENCE_UID, self.frame_of_reference.as_str())
            .with(tags::POSITION_REFERENCE_INDICATOR, indicator)
    }
}

/// What an object is.
pub(super) struct About<'a> {
    /// UID of its SOP class.
    pub class: &'a str,
    /// UID of the object.
    pub instance: &'a str,
    /// UID of its series.
    pub series: &'a str,
    /// Number of its series.
    pub series_number: u32,
    /// Its number in the series, from 1.
    pub number: usize,
    /// SR, SEG, OT.
    pub modality: &'a str,
    /// What the series is, in words.
    pub description: &'a str,
}

/// Returns a UID made of these texts: the same for the same texts, and no other program's (a UUID of version 8 below 2.25, PS3.5, B.2).
pub fn uid(parts: &[&str]) -> String {
    let mut hash = Sha256::new_with_prefix("colvis");
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part.as_bytes());
    }
    let mut bytes: [u8; 16] = std::array::from_fn(|_| 0);
    bytes.copy_from_slice(&hash.finalize()[..16]);
    bytes[6] = bytes[6] & 0x0F | 0x80;
    bytes[8] = bytes[8] & 0x3F | 0x80;
    format!("2.25.{}", u128::from_be_bytes(bytes))
}

/// Decodes a text of a header. What its character set does not know becomes a replacement character.
fn decode(character_set: &str, bytes: &[u8]) -> String {
    let one = |code: &str, bytes: &[u8]| match SpecificCharacterSet::from_code(code.trim()) {
        Some(set) if set != SpecificCharacterSet::ISO_IR_192 => set.decode(bytes).ok(),
        _ => None,
    };
    let mut codes = character_set.split('\\');
    let first = codes.next().filter(|c| !c.trim().is_empty()).unwrap_or("ISO_IR 192");
    // Sets that are switched to by escape sequences: a decoder of such a set knows the others of its language.
    let text = match codes.next() {
        Some(second) if bytes.contains(&0x1B) => one(second, bytes),
        _ => one(first, bytes),
    };
    let text = text.unwrap_or_else(|| String::from_utf8_lossy(bytes).into_owned());
    // A backslash would separate two values.
    text.trim_matches(['\0', ' ']).replace('\\', " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uids_are_valid_and_tell_texts_apart() {
        let (a, b) = (uid(&["a", "bc"]), uid(&["ab", "c"]));
        assert!(a != b && a == uid(&["a", "bc"]));
        for uid in [a, b] {
            assert!(
                uid.len() <= 64 && uid.starts_with("2.25.") && uid.bytes().all(|c| c == b'.' || c.is_ascii_digit())
            );
        }
    }

    #[test]
    fn texts_of_any_character_set_become_unicode() {
        for (set, bytes, text) in [
            ("ISO_IR 100", &b"M\xfcller^J\xf6rg "[..], "Müller^Jörg"),
            ("ISO_IR 192", "Müller".as_bytes(), "Müller"),
            ("", b"Miller\0", "Miller"),
            ("ISO_IR 144", b"\xbb\xee\xda", "Люк"),
            ("\\ISO 2022 IR 87", b"Yamada^Tarou=\x1b$B;3ED\x1b(B^\x1b$BB@O:\x1b(B", "Yamada^Tarou=山田^太郎"),
            ("unheard of", b"\xff\xfe", "\u{fffd}\u{fffd}"),
        ] {
            assert_eq!(decode(set, bytes), text, "{set}");
        }
    }
}
