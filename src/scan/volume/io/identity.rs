//! Whose scan an input is: what only files that are meant to carry it may tell.

use std::collections::BTreeMap;

use glam::DVec3;

/// Group and element of a DICOM attribute.
pub type Tag = (u16, u16);

/// Patient, study and images of a DICOM series, as its headers give them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identity {
    /// The character set of the texts (Specific Character Set); may be empty.
    pub character_set: String,
    /// The values of [`ATTRIBUTES`] that the headers hold, without padding.
    pub values: BTreeMap<Tag, Vec<u8>>,
    /// The slices of the series. Two may be at one position.
    pub images: Vec<SourceImage>,
}

/// A slice of a series, as other objects refer to it.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceImage {
    /// UID of its SOP class.
    pub class: String,
    /// UID of its SOP instance.
    pub instance: String,
    /// Number of its frame, from 1; `None` if the instance has only one.
    pub frame: Option<u32>,
    /// Where the centre of its first pixel is, world mm; `None` if it does not tell.
    pub position: Option<DVec3>,
}

/// UID of the study.
pub const STUDY: Tag = (0x0020, 0x000D);
/// UID of the series.
pub const SERIES: Tag = (0x0020, 0x000E);
/// UID of the frame of reference.
pub const FRAME_OF_REFERENCE: Tag = (0x0020, 0x0052);
/// The patient's name.
pub const PATIENT_NAME: Tag = (0x0010, 0x0010);
/// The patient's number.
pub const PATIENT_ID: Tag = (0x0010, 0x0020);
/// The patient's date of birth.
pub const BIRTH_DATE: Tag = (0x0010, 0x0030);
/// The patient's sex.
pub const SEX: Tag = (0x0010, 0x0040);
/// Date of the study.
pub const STUDY_DATE: Tag = (0x0008, 0x0020);
/// The number under which the study was ordered.
pub const ACCESSION: Tag = (0x0008, 0x0050);
/// What the study is.
pub const STUDY_DESCRIPTION: Tag = (0x0008, 0x1030);

/// Time of the study.
pub const STUDY_TIME: Tag = (0x0008, 0x0030);
/// The name of the referring physician.
pub const REFERRING: Tag = (0x0008, 0x0090);
/// The offset of all times from UTC.
pub const OFFSET: Tag = (0x0008, 0x0201);
/// Who gave the patient's number.
pub const ISSUER: Tag = (0x0010, 0x0021);
/// The patient's age.
pub const AGE: Tag = (0x0010, 0x1010);
/// Number of the study.
pub const STUDY_ID: Tag = (0x0020, 0x0010);
/// What positions are relative to.
pub const POSITION_REFERENCE: Tag = (0x0020, 0x1040);

/// What an identity holds: patient and study (PS3.3, C.7.1.1 and C.7.2.1), UIDs of study, series and frame of reference.
pub const ATTRIBUTES: [Tag; 17] = [
    STUDY_DATE,
    STUDY_TIME,
    ACCESSION,
    REFERRING,
    OFFSET,
    STUDY_DESCRIPTION,
    PATIENT_NAME,
    PATIENT_ID,
    ISSUER,
    BIRTH_DATE,
    SEX,
    AGE,
    STUDY,
    SERIES,
    STUDY_ID,
    FRAME_OF_REFERENCE,
    POSITION_REFERENCE,
];
