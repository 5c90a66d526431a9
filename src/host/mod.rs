//! What drives a flight: nobody's screen, or a window.

pub mod frames;
pub mod headless;
pub mod log;
pub mod plane;
pub mod record;
pub mod terminal;
#[cfg(feature = "window")]
pub mod window;
