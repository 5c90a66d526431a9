//! Objects that are written: reports, segmentations and captures.
//!
//! Each is a file of PS3.10 in explicit little endian, with texts in UTF-8. Places are world mm, LPS, which is the patient's frame of
//! DICOM. [`Study`] is what they belong to: an anonymous one, or that of the headers.

mod capture;
mod report;
mod segmentation;
mod set;
mod study;

pub use capture::Capture;
pub use report::{Content, ImageReference, Node, Report};
pub use segmentation::{MOST_FRAMES, Segment, SegmentVoxels, Segmentation};
pub use set::Code;
pub use study::{Study, uid};
