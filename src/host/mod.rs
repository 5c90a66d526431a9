//! Hosts that drive a flight: headless, or in a window.

#[cfg(feature = "dicom")]
#[doc(hidden)]
pub mod archives;
pub(crate) mod folders;
#[doc(hidden)]
pub mod frames;
pub mod headless;
pub(crate) mod log;
#[doc(hidden)]
pub mod plane;
#[doc(hidden)]
pub mod record;
#[doc(hidden)]
pub mod settings;
#[doc(hidden)]
pub mod terminal;
#[cfg(feature = "window")]
#[doc(hidden)]
pub mod window;

pub use frames::FrameStats;
