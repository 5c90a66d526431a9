//! Input and output: every format, and every way in which a file can be wrong.

mod bad_input;
#[cfg(feature = "dicom")]
mod dicom;
mod formats;
#[cfg(feature = "dicom")]
mod headers;
mod labels;
#[cfg(feature = "dicom")]
mod lost;
mod peers;
#[cfg(feature = "dicom")]
mod series;
#[cfg(feature = "dicom")]
mod study;
mod surface;
#[cfg(feature = "dicom")]
mod values;
mod variants;

#[path = "../support"]
mod support {
    #[cfg(feature = "dicom")]
    pub(crate) mod dicom;
    #[cfg(feature = "dicom")]
    pub(crate) mod enhanced;
    pub(crate) mod judged;
    pub(crate) mod nifti;
    pub(crate) mod packing;
    pub(crate) mod reading;
    pub(crate) mod scans;
    #[cfg(feature = "dicom")]
    pub(crate) mod series;
    pub(crate) mod skips;
    #[cfg(feature = "dicom")]
    pub(crate) mod study;
    pub(crate) mod volumes;
}
