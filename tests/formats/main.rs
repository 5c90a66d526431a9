//! Input and output: every format, and every way in which a file can be wrong.

mod bad_input;
#[cfg(feature = "dicom")]
mod dicom;
mod formats;
mod labels;
mod peers;
mod surface;

#[path = "../support"]
mod support {
    #[cfg(feature = "dicom")]
    pub mod dicom;
    #[cfg(feature = "dicom")]
    pub mod enhanced;
    pub mod nifti;
    pub mod packing;
    pub mod reading;
    pub mod scans;
    #[cfg(feature = "dicom")]
    pub mod series;
    pub mod skips;
    pub mod volumes;
}
