//! The patient and the study that objects belong to, and what all objects have.

use colvis_scan::volume::io::identity::{self, ATTRIBUTES, Identity, SourceImage};
use dicom_core::Tag;
use dicom_dictionary_std::tags;
use glam::DVec3;
use sha2::{Digest, Sha256};

use super::set::{Set, short};
use crate::text::{decode, is_uid};

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
    /// True if no object tells whose scan it is.
    is_anonymous: bool,
    /// The offset of all times from UTC, `+0100`; `None` if it is not known.
    offset: Option<String>,
}

impl Study {
    /// Returns a study that does not tell whose it is. `scan` distinguishes the scan from others, such as its hash.
    pub fn anonymous(scan: &str) -> Self {
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
            is_anonymous: true,
            offset: None,
        }
    }

    /// Returns the study of an identity. `seconds` is when the scan was read, since 1970 in UTC. UIDs that the headers lack are made from
    /// `scan` and the identity. Values that their representation does not allow are left out or shortened.
    pub fn of(identity: &Identity, scan: &str, seconds: u64) -> Self {
        let values: Vec<(identity::Tag, String)> = ATTRIBUTES
            .into_iter()
            .filter_map(|tag| {
                let text = decode(identity.values.get(&tag)?, &identity.character_set);
                Some((tag, valid(tag, &text)?))
            })
            .collect();
        let text = |tag: identity::Tag| values.iter().find(|v| v.0 == tag).map(|v| v.1.clone());
        let whose = format!("{:?}", identity.values);
        let offset = text(identity::OFFSET);
        let minutes = offset.as_deref().map_or(0, minutes);
        let series = text(identity::SERIES);
        let is_sound = |image: &&SourceImage| series.is_some() && is_uid(&image.class) && is_uid(&image.instance);
        let images = identity.images.iter().filter(is_sound).cloned().collect();
        Self {
            study: text(identity::STUDY).unwrap_or_else(|| uid(&["study of", scan, &whose])),
            frame_of_reference: text(identity::FRAME_OF_REFERENCE).unwrap_or_else(|| uid(&["frame of", scan, &whose])),
            series,
            images,
            date: date(seconds.saturating_add_signed(60 * minutes)),
            values,
            is_anonymous: false,
            offset,
        }
    }

    /// True if no object tells whose scan it is.
    pub fn is_anonymous(&self) -> bool {
        self.is_anonymous
    }

    /// Returns the slice of the series that is nearest to a place (world, mm) across its slices, whose normal is given, and within so
    /// many mm; of two at one position the first.
    pub fn nearest(&self, place: DVec3, normal: DVec3, within_mm: f64) -> Option<&SourceImage> {
        let off = |image: &SourceImage| image.position.map(|p| (p - place).dot(normal).abs());
        let near = self.images.iter().filter_map(|image| Some((off(image)?, image)));
        let best = near.reduce(|a, b| if b.0 < a.0 { b } else { a })?;
        (best.0 <= within_mm).then_some(best.1)
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
            .with(tags::STUDY_TIME, text(identity::STUDY_TIME))
            .with(tags::CONTENT_DATE, date)
            .with(tags::CONTENT_TIME, time)
            .with(tags::ACCESSION_NUMBER, text(identity::ACCESSION))
            .with(tags::MODALITY, about.modality)
            .with(tags::MANUFACTURER, "colvis")
            .with(tags::MANUFACTURER_MODEL_NAME, "colvis")
            .with(tags::DEVICE_SERIAL_NUMBER, env!("CARGO_PKG_VERSION"))
            .with(tags::SOFTWARE_VERSIONS, env!("CARGO_PKG_VERSION"))
            .with(tags::REFERRING_PHYSICIAN_NAME, text(identity::REFERRING))
            .with(tags::SERIES_DESCRIPTION, short(about.description, 64))
            .with(tags::PATIENT_NAME, text(identity::PATIENT_NAME))
            .with(tags::PATIENT_ID, text(identity::PATIENT_ID))
            .with(tags::PATIENT_BIRTH_DATE, text(identity::BIRTH_DATE))
            .with(tags::PATIENT_SEX, text(identity::SEX))
            .with(tags::STUDY_INSTANCE_UID, self.study.as_str())
            .with(tags::SERIES_INSTANCE_UID, about.series)
            .with(tags::STUDY_ID, text(identity::STUDY_ID))
            .with(tags::SERIES_NUMBER, about.series_number.to_string())
            .with(tags::INSTANCE_NUMBER, about.number.to_string());
        let set = if self.is_anonymous {
            set.with(tags::PATIENT_IDENTITY_REMOVED, "YES")
                .with(tags::DEIDENTIFICATION_METHOD, "nothing of the patient was taken over from the scan")
        } else {
            set
        };
        let optional: [(Tag, identity::Tag); 4] = [
            (tags::TIMEZONE_OFFSET_FROM_UTC, identity::OFFSET),
            (tags::STUDY_DESCRIPTION, identity::STUDY_DESCRIPTION),
            (tags::ISSUER_OF_PATIENT_ID, identity::ISSUER),
            (tags::PATIENT_AGE, identity::AGE),
        ];
        let known = optional.into_iter().filter_map(|(tag, of)| Some((tag, self.text(of)?)));
        known.fold(set, |set, (tag, text)| set.with(tag, text))
    }

    /// Returns the frame of reference module.
    pub(super) fn frame(&self) -> Set {
        let indicator = self.text(identity::POSITION_REFERENCE).unwrap_or_default();
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

/// Returns day and time as `YYYYMMDD` and `HHMMSS` of seconds since 1970 (days to dates: Hinnant, *chrono-Compatible Low-Level Date
/// Algorithms*).
fn date(seconds: u64) -> [String; 2] {
    let (days, seconds) = (seconds / 86400, seconds % 86400);
    let days = days + 719_468;
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = 400 * era + year_of_era + u64::from(month <= 2);
    [
        format!("{year:04}{month:02}{day:02}"),
        format!("{:02}{:02}{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60),
    ]
}

/// Returns the minutes of an offset from UTC, such as `+0130`.
fn minutes(offset: &str) -> i64 {
    let number = |range: std::ops::Range<usize>| offset.get(range).and_then(|n| n.parse::<i64>().ok()).unwrap_or(0);
    let minutes = 60 * number(1..3) + number(3..5);
    if offset.starts_with('-') { -minutes } else { minutes }
}

/// Returns the value of an attribute as its representation allows it (PS3.5, 6.2): shortened, or `None` if it is none.
fn valid(tag: identity::Tag, text: &str) -> Option<String> {
    let digits = |text: &str, count: usize| text.len() == count && text.bytes().all(|b| b.is_ascii_digit());
    let is_good = match tag {
        identity::STUDY | identity::SERIES | identity::FRAME_OF_REFERENCE => is_uid(text),
        identity::STUDY_DATE | identity::BIRTH_DATE => digits(text, 8),
        identity::STUDY_TIME => {
            let (whole, part) = text.split_once('.').unwrap_or((text, "0"));
            [2, 4, 6].into_iter().any(|n| digits(whole, n)) && (1..=6).any(|n| digits(part, n))
        }
        identity::SEX => matches!(text, "M" | "F" | "O"),
        identity::AGE => {
            text.len() == 4 && digits(&text[..3.min(text.len())], 3) && text.ends_with(['D', 'W', 'M', 'Y'])
        }
        identity::OFFSET => text.starts_with(['+', '-']) && text.get(1..).is_some_and(|n| digits(n, 4)),
        _ => true,
    };
    let most = match tag {
        identity::ACCESSION | identity::STUDY_ID => 16,
        identity::PATIENT_NAME | identity::REFERRING => 3 * 64,
        _ => 64,
    };
    let text = short(text, most);
    (is_good && !text.is_empty()).then_some(text)
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
    fn dates_are_those_of_the_calendar() {
        for (seconds, day, time) in [
            (0, "19700101", "000000"),
            (951_782_400, "20000229", "000000"),
            (1_709_251_199, "20240229", "235959"),
            (4_102_444_800, "21000101", "000000"),
        ] {
            assert_eq!(date(seconds), [day, time]);
        }
        assert_eq!((minutes("+0130"), minutes("-0200"), minutes("?")), (90, -120, 0));
    }

    #[test]
    fn values_that_are_none_are_left_out_and_long_ones_shortened() {
        for (tag, text, wanted) in [
            (identity::STUDY, "1.2.abc", None),
            (identity::STUDY, "1.2.3", Some("1.2.3")),
            (identity::SEX, "female", None),
            (identity::AGE, "74", None),
            (identity::AGE, "074Y", Some("074Y")),
            (identity::STUDY_DATE, "2024.01.05", None),
            (identity::STUDY_TIME, "101112.5", Some("101112.5")),
            (identity::STUDY_TIME, "10:11", None),
            (identity::ACCESSION, "123456789012345678", Some("1234567890123456")),
            (identity::OFFSET, "+0100", Some("+0100")),
            (identity::OFFSET, "CET", None),
            (identity::PATIENT_NAME, "Doe^Jane", Some("Doe^Jane")),
        ] {
            assert_eq!(valid(tag, text).as_deref(), wanted, "{text}");
        }
    }

    #[test]
    fn objects_of_somebody_and_of_nobody_are_not_linked() {
        let identity = Identity { values: [(identity::PATIENT_ID, b"7".to_vec())].into(), ..Identity::default() };
        let (known, unknown) = (Study::of(&identity, "sha256:ab", 0), Study::anonymous("sha256:ab"));
        assert!(known.study != unknown.study && known.frame_of_reference != unknown.frame_of_reference);
        let other = Identity { values: [(identity::PATIENT_ID, b"8".to_vec())].into(), ..Identity::default() };
        assert_ne!(Study::of(&other, "sha256:ab", 0).study, known.study);
    }

    /// The first pixels of a tilted gantry's slices are on a line that is not their normal.
    #[test]
    fn the_nearest_slice_of_a_tilted_gantry_is_the_one_whose_plane_it_is() {
        let (sin, cos) = 0.3_f64.sin_cos();
        let image = |k: u32| SourceImage {
            class: "1.2".to_owned(),
            instance: format!("1.{k}"),
            frame: None,
            position: Some(DVec3::Z * f64::from(k)),
        };
        let study = Study { images: (0..200).map(image).collect(), ..Study::anonymous("") };
        let normal = DVec3::new(0.0, -sin, cos);
        let at = |k: f64, along: f64| DVec3::Z * k + DVec3::new(0.0, cos, sin) * along;
        for (k, along) in [(100.0, 0.0), (100.0, 120.0), (40.2, -90.0)] {
            let found = study.nearest(at(k, along), normal, 1.0).unwrap();
            assert_eq!(found.instance, format!("1.{k:.0}"), "{along}");
        }
        assert_eq!(study.nearest(at(250.0, 0.0), normal, 1.0), None);
    }
}
