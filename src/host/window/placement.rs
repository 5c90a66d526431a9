//! How large the window is: as it was left, and as large as the screen the first time.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use winit::dpi::{LogicalSize, PhysicalSize, Size};
use winit::event_loop::ActiveEventLoop;
use winit::window::{Window, WindowAttributes};

use crate::error::Result;
use crate::host::folders::{self, Folder};
use crate::render::ImageSize;

/// Default size of a window on a screen of unknown size, points.
const USUAL: LogicalSize<f64> = LogicalSize::new(1024.0, 768.0);
/// Smallest size of a window, points.
const LEAST: LogicalSize<f64> = LogicalSize::new(320.0, 240.0);
/// Sizes in the file outside these limits are not those of a window, pixels.
const SIZES: std::ops::RangeInclusive<u32> = 64..=16384;
/// Consequence of an invalid file, for messages.
const HINT: &str = "the file is left unchanged; the window fills the screen";

/// The size of a window, as stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    version: u32,
    /// Width and height of its content, pixels.
    size: [u32; 2],
    is_maximized: bool,
}

impl folders::Kept for Kept {
    const VERSION: u32 = 1;

    fn version(&self) -> u32 {
        self.version
    }
}

/// The size of a window.
#[derive(Debug)]
pub(crate) struct Placement {
    /// Its file; `None` if it is not stored.
    file: Option<PathBuf>,
    kept: Option<Kept>,
}

impl Placement {
    /// Returns the default file; `None` on a system that defines no folder for it.
    pub(crate) fn usual_file() -> Option<PathBuf> {
        Folder::State.file(Path::new("window.json"))
    }

    /// Reads how a window was left, with the error if the file is invalid. In that case it is not overwritten.
    pub(crate) fn open(file: Option<PathBuf>) -> (Self, Option<crate::error::Error>) {
        match file.as_deref().map_or(Ok(None), |path| folders::read_kept::<Kept>(path, HINT)) {
            Ok(kept) => {
                let kept = kept.filter(|k| k.size.iter().all(|s| SIZES.contains(s)));
                (Self { file, kept }, None)
            }
            Err(e) => (Self { file: None, kept: None }, Some(e)),
        }
    }

    /// True if no window was open before, so far as is known.
    pub(crate) fn is_first(&self) -> bool {
        self.file.is_some() && self.kept.is_none()
    }

    /// Returns the attributes of a window: of the size that was `asked` for, as it was left, or as large as the screen.
    pub(crate) fn attributes(&self, asked: Option<ImageSize>, events: &ActiveEventLoop) -> WindowAttributes {
        let all = Window::default_attributes().with_min_inner_size(LEAST);
        match (asked, self.kept) {
            (Some(size), _) => all.with_inner_size(PhysicalSize::new(size.width as u32, size.height as u32)),
            (None, Some(Kept { size: [width, height], is_maximized, .. })) => {
                all.with_inner_size(PhysicalSize::new(width, height)).with_maximized(is_maximized)
            }
            (None, None) => {
                let screen = events.primary_monitor().or_else(|| events.available_monitors().next());
                let size = screen.map(|s| s.size()).filter(|s| s.width > 0 && s.height > 0);
                all.with_inner_size(size.map_or(Size::Logical(USUAL), Size::Physical)).with_maximized(true)
            }
        }
    }

    /// Stores the size of a window for the next time. That of a full screen is not stored.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written.
    pub(crate) fn keep(&self, window: &Window) -> Result<()> {
        let size = window.inner_size();
        let Some(path) = self.file.as_ref().filter(|_| window.fullscreen().is_none()) else { return Ok(()) };
        let kept = Kept { version: 1, size: [size.width, size.height], is_maximized: window.is_maximized() };
        if kept.size.iter().all(|s| SIZES.contains(s)) && self.kept != Some(kept) {
            folders::keep(path, &kept)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_read_back_and_what_is_damaged_is_told_and_left() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("window.json");
        let (first, e) = Placement::open(Some(file.clone()));
        assert!(e.is_none() && first.is_first() && first.kept.is_none());
        let kept = Kept { version: 1, size: [1280, 900], is_maximized: false };
        folders::keep(&file, &kept).unwrap();
        let (second, e) = Placement::open(Some(file.clone()));
        assert!(e.is_none() && !second.is_first() && second.kept == Some(kept));
        folders::keep(&file, &Kept { size: [1, 900], ..kept }).unwrap();
        assert!(Placement::open(Some(file.clone())).0.kept.is_none());
        std::fs::write(&file, "{").unwrap();
        let (damaged, e) = Placement::open(Some(file.clone()));
        assert!(e.unwrap().to_string().contains("left unchanged") && !damaged.is_first() && damaged.file.is_none());
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "{");
    }
}
