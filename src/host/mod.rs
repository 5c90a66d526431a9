//! Hosts that drive a flight: headless, or in a window.

pub mod frames;
pub mod headless;
pub mod log;
pub mod plane;
pub mod record;
pub mod terminal;
#[cfg(feature = "window")]
pub mod window;
