//! DICOM objects that colvis writes, and the archives that it talks to.
//!
//! The foundation's [`volume::io`](colvis_scan::volume::io) reads DICOM.

pub mod archive;
pub mod objects;
mod text;

pub use text::{day, is_uid, person};
