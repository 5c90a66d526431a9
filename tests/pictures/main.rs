//! Pictures against the truth, against the reference, and against one another.

mod choices;
mod depth;
mod frames;
mod golden;
mod grids;
mod handedness;
mod packets;
mod shaders;

#[path = "../support"]
mod support {
    pub(crate) mod checks;
    #[cfg(feature = "dicom")]
    pub(crate) mod dicom;
    pub(crate) mod embedded;
    pub(crate) mod failed;
    pub(crate) mod nifti;
    pub(crate) mod panels;
    pub(crate) mod program;
    pub(crate) mod reading;
    #[cfg(feature = "dicom")]
    pub(crate) mod series;
}
