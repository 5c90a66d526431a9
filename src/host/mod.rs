//! Hosts that drive a flight: headless, or in a window.

pub(crate) mod frames;
pub mod headless;
pub(crate) mod log;
pub(crate) mod plane;
pub(crate) mod record;
pub(crate) mod terminal;
#[cfg(feature = "window")]
pub(crate) mod window;

pub use frames::FrameStats;
