//! Pictures in colour: a Multi-frame True Color Secondary Capture (PS3.3, A.8.5).

use std::io::{self, Write};

use dicom_core::PrimitiveValue;
use dicom_dictionary_std::{tags, uids};

use super::set::{Set, short};
use super::study::{About, Study};

/// Pictures of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture<'a> {
    /// Whose they are.
    pub study: &'a Study,
    /// UID of the object.
    pub instance: String,
    /// UID of its series.
    pub series: String,
    /// Number of its series.
    pub series_number: u32,
    /// Its number in the series, from 1.
    pub number: usize,
    /// What the series is, in words.
    pub description: &'a str,
    /// What is said of these pictures.
    pub comment: String,
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Each picture's name, of 16 letters at most, and its pixels, row by row.
    pub frames: Vec<(&'a str, &'a [[u8; 3]])>,
}

impl Capture<'_> {
    /// UID of its SOP class.
    pub const CLASS: &'static str = uids::MULTI_FRAME_TRUE_COLOR_SECONDARY_CAPTURE_IMAGE_STORAGE;

    /// Writes it. Nothing is drawn into the pictures that tells whose they are.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let about = About {
            class: Self::CLASS,
            instance: &self.instance,
            series: &self.series,
            series_number: self.series_number,
            number: self.number,
            modality: "OT",
            description: self.description,
        };
        let [width, height] = self.size.map(|n| n as u16);
        let mut bytes: Vec<u8> = self.frames.iter().flat_map(|(_, rgb)| rgb.as_flattened()).copied().collect();
        if bytes.len() % 2 == 1 {
            bytes.push(0);
        }
        let names = self.frames.iter().map(|(name, _)| short(name, 16)).collect();
        let numbers = (1..=self.frames.len()).map(|n| n.to_string()).collect();
        let set = self
            .study
            .head(&about)
            .and(Set::default().with(tags::CONVERSION_TYPE, "WSD"))
            .with(
                tags::IMAGE_TYPE,
                PrimitiveValue::Strs(["DERIVED".to_owned(), "SECONDARY".to_owned()].into_iter().collect()),
            )
            .with(tags::PATIENT_ORIENTATION, "")
            .with(tags::LATERALITY, "")
            .with(tags::IMAGE_COMMENTS, short(&self.comment, 1024))
            .with(tags::BURNED_IN_ANNOTATION, "NO")
            .with(tags::RECOGNIZABLE_VISUAL_FEATURES, "NO")
            .with(tags::LOSSY_IMAGE_COMPRESSION, "00")
            .with(tags::PAGE_NUMBER_VECTOR, PrimitiveValue::Strs(numbers))
            .with(tags::FRAME_LABEL_VECTOR, PrimitiveValue::Strs(names))
            .with(tags::SAMPLES_PER_PIXEL, 3_u16)
            .with(tags::PHOTOMETRIC_INTERPRETATION, "RGB")
            .with(tags::PLANAR_CONFIGURATION, 0_u16)
            .with(tags::NUMBER_OF_FRAMES, self.frames.len().to_string())
            .with_tags(tags::FRAME_INCREMENT_POINTER, &[tags::PAGE_NUMBER_VECTOR, tags::FRAME_LABEL_VECTOR])
            .with(tags::ROWS, height)
            .with(tags::COLUMNS, width)
            .with(tags::BITS_ALLOCATED, 8_u16)
            .with(tags::BITS_STORED, 8_u16)
            .with(tags::HIGH_BIT, 7_u16)
            .with(tags::PIXEL_REPRESENTATION, 0_u16);
        set.with_bytes(tags::PIXEL_DATA, bytes).write(out)
    }
}
