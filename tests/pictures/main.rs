//! Pictures against the truth, against the reference, and against one another.

mod choices;
mod depth;
mod frames;
mod grids;
mod handedness;
mod packets;
mod shaders;

#[path = "../support"]
mod support {
    #[cfg(feature = "dicom")]
    pub mod dicom;
    pub mod failed;
    pub mod nifti;
    pub mod panels;
    pub mod program;
    pub mod reading;
    #[cfg(feature = "dicom")]
    pub mod series;
}
