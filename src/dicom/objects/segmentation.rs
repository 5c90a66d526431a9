//! Segmentations of a scan's voxels (PS3.3, A.51 and C.8.20), binary, without empty frames.

use std::io::{self, Write};

use colvis_scan::volume::Grid;
use colvis_scan::volume::io::identity::SourceImage;
use dicom_core::PrimitiveValue;
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;
use rayon::prelude::*;

use super::set::{Code, Set, decimal, decimals, short};
use super::study::{About, Study};

/// An object has so many frames at most: viewers fail at more.
pub const MOST_FRAMES: usize = 400;

/// The voxels of a segment.
#[derive(Clone, Debug, PartialEq)]
pub enum SegmentVoxels {
    /// Those with this label, from 1.
    Label(u8),
    /// These.
    These(Vec<[usize; 3]>),
}

/// A segment.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Its name.
    pub label: String,
    /// What it is, in words; may be empty.
    pub description: String,
    /// The category of what it is.
    pub category: Code,
    /// What it is.
    pub kind: Code,
    /// Its colour.
    pub colour: [u8; 3],
    /// The name and the UID under which a report tracks it.
    pub tracking: Option<[String; 2]>,
    /// Its voxels.
    pub voxels: SegmentVoxels,
}

/// A segmentation, as the objects that hold it.
#[derive(Clone, Debug, PartialEq)]
pub struct Segmentation<'a> {
    /// Whose it is.
    pub study: &'a Study,
    /// What makes it different from others; UIDs are made from it.
    pub seed: String,
    /// UID of its series.
    pub series: String,
    /// Number of its series.
    pub series_number: u32,
    /// What it is, in words.
    pub description: &'a str,
    /// The scan's grid.
    pub grid: &'a Grid,
    /// The label of each voxel, 0 for none.
    pub labels: &'a [u8],
    /// The segments.
    pub segments: Vec<Segment>,
}

/// A frame: the number of its segment, from 0, and its slice.
type Frame = (usize, usize);

impl Segmentation<'_> {
    /// Divides its frames among objects of [`MOST_FRAMES`] at most. A segment is in one object where it fits. Segments without a voxel
    /// are in none.
    pub fn parts(&self) -> Vec<Vec<Frame>> {
        let [nx, ny, nz] = self.grid.dims();
        // Which labels each slice holds.
        let held: Vec<[bool; 256]> = (0..nz)
            .into_par_iter()
            .map(|k| {
                let mut held = [false; 256];
                self.labels[k * nx * ny..][..nx * ny].iter().for_each(|l| held[usize::from(*l)] = true);
                held
            })
            .collect();
        let mut parts: Vec<Vec<Frame>> = vec![Vec::new()];
        for (n, segment) in self.segments.iter().enumerate() {
            let mut slices: Vec<usize> = match &segment.voxels {
                SegmentVoxels::Label(label) => (0..nz).filter(|k| held[*k][usize::from(*label)]).collect(),
                SegmentVoxels::These(voxels) => voxels.iter().map(|v| v[2]).collect(),
            };
            slices.sort_unstable();
            slices.dedup();
            let last = parts.last().map_or(0, Vec::len);
            if last > 0 && last + slices.len() > MOST_FRAMES {
                parts.push(Vec::new());
            }
            for k in slices {
                if parts.last().is_some_and(|p| p.len() == MOST_FRAMES) {
                    parts.push(Vec::new());
                }
                if let Some(part) = parts.last_mut() {
                    part.push((n, k));
                }
            }
        }
        parts.retain(|part| !part.is_empty());
        parts
    }

    /// Writes the object of one of the [`parts`](Self::parts), counted from 0.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(&self, n: usize, frames: &[Frame], out: &mut dyn Write) -> io::Result<()> {
        let about = About {
            class: uids::SEGMENTATION_STORAGE,
            instance: &super::uid(&["segmentation", &self.seed, &n.to_string()]),
            series: &self.series,
            series_number: self.series_number,
            number: n + 1,
            modality: "SEG",
            description: self.description,
        };
        let organization = super::uid(&["dimensions", &self.seed, &n.to_string()]);
        // The segments of this object, by their numbers from 1.
        let mut here: Vec<usize> = frames.iter().map(|f| f.0).collect();
        here.dedup();
        let number = |segment: usize| here.iter().position(|s| *s == segment).map_or(0, |at| at as u16 + 1);
        let segments = here.iter().map(|s| self.segment(number(*s), &self.segments[*s]));
        let index = |pointer, group| {
            Set::default()
                .with(tags::DIMENSION_ORGANIZATION_UID, organization.as_str())
                .with_tags(tags::DIMENSION_INDEX_POINTER, &[pointer])
                .with_tags(tags::FUNCTIONAL_GROUP_POINTER, &[group])
        };
        let mut slices: Vec<usize> = frames.iter().map(|f| f.1).collect();
        slices.sort_unstable();
        slices.dedup();
        let sources = self.sources(&slices);
        let [nx, ny, _] = self.grid.dims();
        let frame = |(segment, k): &Frame| {
            let along = slices.binary_search(k).map_or(0, |at| at as u32 + 1);
            let values = [u32::from(number(*segment)), along];
            let position = self.grid.world(DVec3::new(0.0, 0.0, *k as f64)).to_array();
            let content =
                Set::default().with(tags::DIMENSION_INDEX_VALUES, PrimitiveValue::U32(values.as_slice().into()));
            let set = Set::default()
                .with_items(tags::FRAME_CONTENT_SEQUENCE, [content])
                .with_items(
                    tags::PLANE_POSITION_SEQUENCE,
                    [Set::default().with(tags::IMAGE_POSITION_PATIENT, decimals(position))],
                )
                .with_items(
                    tags::SEGMENT_IDENTIFICATION_SEQUENCE,
                    [Set::default().with(tags::REFERENCED_SEGMENT_NUMBER, number(*segment))],
                );
            match &sources[along as usize - 1] {
                Some(source) => set.with_items(tags::DERIVATION_IMAGE_SEQUENCE, [derivation(source)]),
                // A slice between two that are missing: the sequence is there for every frame, or for none.
                None if !self.study.images.is_empty() => set.with_items(tags::DERIVATION_IMAGE_SEQUENCE, []),
                None => set,
            }
        };
        let referenced = self.referenced(sources.iter().flatten());
        let set = self
            .study
            .head(&about)
            .and(self.study.frame())
            .with(
                tags::IMAGE_TYPE,
                PrimitiveValue::Strs(["DERIVED".to_owned(), "PRIMARY".to_owned()].into_iter().collect()),
            )
            .with(tags::SAMPLES_PER_PIXEL, 1_u16)
            .with(tags::PHOTOMETRIC_INTERPRETATION, "MONOCHROME2")
            .with(tags::NUMBER_OF_FRAMES, frames.len().to_string())
            .with(tags::ROWS, ny as u16)
            .with(tags::COLUMNS, nx as u16)
            .with(tags::BITS_ALLOCATED, 1_u16)
            .with(tags::BITS_STORED, 1_u16)
            .with(tags::HIGH_BIT, 0_u16)
            .with(tags::PIXEL_REPRESENTATION, 0_u16)
            .with(tags::LOSSY_IMAGE_COMPRESSION, "00")
            .with(tags::SEGMENTATION_TYPE, "BINARY")
            .with(tags::CONTENT_LABEL, "COLON")
            .with(tags::CONTENT_DESCRIPTION, short(self.description, 64))
            .with(tags::CONTENT_CREATOR_NAME, "")
            .with_items(
                tags::DIMENSION_ORGANIZATION_SEQUENCE,
                [Set::default().with(tags::DIMENSION_ORGANIZATION_UID, organization.as_str())],
            )
            .with_items(
                tags::DIMENSION_INDEX_SEQUENCE,
                [
                    index(tags::REFERENCED_SEGMENT_NUMBER, tags::SEGMENT_IDENTIFICATION_SEQUENCE),
                    index(tags::IMAGE_POSITION_PATIENT, tags::PLANE_POSITION_SEQUENCE),
                ],
            )
            .with_items(tags::SEGMENT_SEQUENCE, segments)
            .with_items(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, [self.shared()])
            .with_items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, frames.iter().map(frame));
        let set = match referenced {
            Some(series) => set.with_items(tags::REFERENCED_SERIES_SEQUENCE, [series]),
            None => set,
        };
        set.with_bytes(tags::PIXEL_DATA, self.bits(frames)).write(out)
    }

    fn segment(&self, number: u16, segment: &Segment) -> Set {
        let set = Set::default()
            .with(tags::SEGMENT_NUMBER, number)
            .with(tags::SEGMENT_LABEL, short(&segment.label, 64))
            .with(tags::SEGMENT_ALGORITHM_TYPE, "AUTOMATIC")
            .with(tags::SEGMENT_ALGORITHM_NAME, "colvis")
            .with(tags::RECOMMENDED_DISPLAY_CIE_LAB_VALUE, PrimitiveValue::U16(lab(segment.colour).as_slice().into()))
            .with_code(tags::SEGMENTED_PROPERTY_CATEGORY_CODE_SEQUENCE, segment.category)
            .with_code(tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE, segment.kind);
        let set = match &segment.description[..] {
            "" => set,
            text => set.with(tags::SEGMENT_DESCRIPTION, text),
        };
        match &segment.tracking {
            Some([id, uid]) => set.with(tags::TRACKING_ID, short(id, 64)).with(tags::TRACKING_UID, uid.as_str()),
            None => set,
        }
    }

    /// Returns what all frames share.
    fn shared(&self) -> Set {
        let (spacing, direction) = (self.grid.spacing(), self.grid.direction());
        let (_, apart) = across(self.grid);
        let measures = Set::default()
            .with(tags::SLICE_THICKNESS, decimal(apart))
            .with(tags::SPACING_BETWEEN_SLICES, decimal(apart))
            .with(tags::PIXEL_SPACING, decimals([spacing.y, spacing.x]));
        let axes = [direction.x_axis, direction.y_axis].into_iter().flat_map(|a| a.to_array());
        Set::default().with_items(tags::PIXEL_MEASURES_SEQUENCE, [measures]).with_items(
            tags::PLANE_ORIENTATION_SEQUENCE,
            [Set::default().with(tags::IMAGE_ORIENTATION_PATIENT, decimals(axes))],
        )
    }

    /// Returns the slice of the series that lies at each of these slices of the grid, within half their distance.
    fn sources(&self, slices: &[usize]) -> Vec<Option<&SourceImage>> {
        let (normal, apart) = across(self.grid);
        let middle = |k: &usize| self.grid.world(DVec3::new(0.0, 0.0, *k as f64));
        slices.iter().map(|k| self.study.nearest(middle(k), normal, 0.5 * apart)).collect()
    }

    /// Returns the reference to the series and those of its objects that frames were derived from.
    fn referenced<'b>(&self, images: impl Iterator<Item = &'b &'b SourceImage>) -> Option<Set> {
        let series = self.study.series.as_ref()?;
        let mut known: Vec<&SourceImage> = Vec::new();
        for image in images {
            if known.last().is_none_or(|last| last.instance != image.instance) {
                known.push(image);
            }
        }
        let instances = known.into_iter().map(|image| {
            Set::default()
                .with(tags::REFERENCED_SOP_CLASS_UID, image.class.as_str())
                .with(tags::REFERENCED_SOP_INSTANCE_UID, image.instance.as_str())
        });
        let set = Set::default().with(tags::SERIES_INSTANCE_UID, series.as_str());
        Some(set.with_items(tags::REFERENCED_INSTANCE_SEQUENCE, instances))
    }

    /// Returns the pixels of these frames: bits, the first the lowest of a byte, without padding between frames (PS3.5, 8.1.1).
    fn bits(&self, frames: &[Frame]) -> Vec<u8> {
        let [nx, ny, _] = self.grid.dims();
        let size = nx * ny;
        let length = (frames.len() * size).div_ceil(8);
        let mut bytes = vec![0_u8; length.next_multiple_of(2)];
        let mut set = |bit: usize| bytes[bit / 8] |= 1 << (bit % 8);
        for (n, (segment, k)) in frames.iter().enumerate() {
            match &self.segments[*segment].voxels {
                SegmentVoxels::Label(label) => {
                    let slice = &self.labels[k * size..][..size];
                    slice.iter().enumerate().filter(|(_, l)| *l == label).for_each(|(at, _)| set(n * size + at));
                }
                SegmentVoxels::These(voxels) => {
                    let own = voxels.iter().filter(|v| v[2] == *k);
                    own.for_each(|[i, j, _]| set(n * size + j * nx + i));
                }
            }
        }
        bytes
    }
}

/// Returns the unit normal of a grid's slices, and how far they are apart along it, mm: those of a tilted gantry are nearer to each other
/// than their first pixels are.
fn across(grid: &Grid) -> (DVec3, f64) {
    let direction = grid.direction();
    let normal = direction.x_axis.cross(direction.y_axis).normalize_or_zero();
    (normal, (grid.spacing().z * direction.z_axis.dot(normal)).abs())
}

/// Returns what says that a frame was made from an image.
fn derivation(source: &SourceImage) -> Set {
    let image = Set::default()
        .with(tags::REFERENCED_SOP_CLASS_UID, source.class.as_str())
        .with(tags::REFERENCED_SOP_INSTANCE_UID, source.instance.as_str())
        .with_code(
            tags::PURPOSE_OF_REFERENCE_CODE_SEQUENCE,
            Code::new("121322", "DCM", "Source image for image processing operation"),
        );
    let image = match source.frame {
        Some(frame) => image.with(tags::REFERENCED_FRAME_NUMBER, frame.to_string()),
        None => image,
    };
    Set::default()
        .with_items(tags::SOURCE_IMAGE_SEQUENCE, [image])
        .with_code(tags::DERIVATION_CODE_SEQUENCE, Code::new("113076", "DCM", "Segmentation"))
}

/// Returns a colour of a screen (sRGB) in CIELab, in units of the standard (PS3.3, C.10.7.1.1: L from 0 to 65535, a and b from -128 to 127).
fn lab(colour: [u8; 3]) -> [u16; 3] {
    let [r, g, b] = colour.map(|c| {
        let c = f64::from(c) / 255.0;
        if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    });
    // To XYZ under D65, and as shares of the white of D50 after Bradford's adaptation (ICC).
    let x = (0.436_074_7 * r + 0.385_064_9 * g + 0.143_080_4 * b) / 0.964_22;
    let y = 0.222_504_5 * r + 0.716_878_6 * g + 0.060_616_9 * b;
    let z = (0.013_932_2 * r + 0.097_104_5 * g + 0.714_173_3 * b) / 0.825_21;
    let f = |t: f64| if t > 216.0 / 24389.0 { t.cbrt() } else { (24389.0 / 27.0 * t + 16.0) / 116.0 };
    let [x, y, z] = [x, y, z].map(f);
    let scaled =
        |value: f64, least: f64, range: f64| ((value - least) / range * 65535.0).round().clamp(0.0, 65535.0) as u16;
    [
        scaled(116.0 * y - 16.0, 0.0, 100.0),
        scaled(500.0 * (x - y), -128.0, 255.0),
        scaled(200.0 * (y - z), -128.0, 255.0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    const CODE: Code = Code::new("1", "99TEST", "a test");

    fn segment(voxels: SegmentVoxels) -> Segment {
        Segment {
            label: "x".to_owned(),
            description: String::new(),
            category: CODE,
            kind: CODE,
            colour: [0; 3],
            tracking: None,
            voxels,
        }
    }

    #[test]
    fn no_object_has_too_many_frames_and_no_frame_is_empty() {
        // A segment of 300 slices, one of 150, and one of 500 with a gap.
        let dims = [2, 1, 600];
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let mut labels = vec![0_u8; grid.len()];
        for k in 0..600 {
            labels[2 * k] = if k < 300 { 1 } else { u8::from(k < 450) * 2 };
            labels[2 * k + 1] = if (20..30).contains(&k) || k >= 510 { 0 } else { 3 };
        }
        let study = Study::anonymous("sha256:ab");
        let make = |segments: Vec<Segment>| Segmentation {
            study: &study,
            seed: String::new(),
            series: String::new(),
            series_number: 1,
            description: "",
            grid: &grid,
            labels: &labels,
            segments,
        };
        let these = SegmentVoxels::These(vec![[1, 0, 7], [0, 0, 9], [0, 0, 7]]);
        let all = [1, 2, 3, 4].map(|l| segment(SegmentVoxels::Label(l))).into_iter().chain([segment(these)]);
        let seg = make(all.collect());
        let parts = seg.parts();
        let sizes: Vec<usize> = parts.iter().map(Vec::len).collect();
        assert_eq!(sizes, [300, 150, 400, 102]);
        assert_eq!(parts[3][100..], [(4, 7), (4, 9)]);
        for part in &parts {
            let bits = seg.bits(part);
            for (n, frame) in part.iter().enumerate() {
                assert!((2 * n..2 * n + 2).any(|bit| bits[bit / 8] >> (bit % 8) & 1 == 1), "{frame:?}");
            }
        }
        assert!(make(Vec::new()).parts().is_empty());
    }

    #[test]
    fn colours_are_those_of_the_standard() {
        assert_eq!(lab([0; 3]), [0, 32896, 32896]);
        let [l, a, b] = lab([255; 3]);
        assert!(l >= 65530 && a.abs_diff(32896) < 20 && b.abs_diff(32896) < 20, "{l} {a} {b}");
        // Red has L 54.3, a 80.8, b 69.9 under D50.
        let [l, a, b] = lab([255, 0, 0]).map(f64::from);
        let near = |got: f64, wanted: f64| assert!((got - wanted).abs() < 200.0, "{got} {wanted}");
        near(l, 54.29 * 655.35);
        near(a, (80.8 + 128.0) * 257.0);
        near(b, (69.9 + 128.0) * 257.0);
    }
}
