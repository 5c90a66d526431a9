//! Pictures of a flight with their ground truth, for learning and for localisation and mapping.
//!
//! [`truth`] measures what each pixel shows, one ray a pixel at the exact crossing; nothing is interpolated between pixels. [`look`] makes
//! the picture of it that an endoscope would make. [`layout`] names the files and writes the lists that programs read, a file each, and
//! [`write`](writing::write) puts it all into a folder that is whole or not there.

pub mod camera;
pub mod deform;
pub mod layout;
pub mod look;
pub mod paths;
pub mod truth;
pub mod writing;
