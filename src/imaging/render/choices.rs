//! Choices among the paper's ideas (section 2.2) that a scene can make for any preset.
//!
//! Each choice is a key in a scene file's `[render]` table:
//!
//! ```toml
//! [render]
//! leap = "voxel"        # none, flag, brick, voxel: how rays skip empty space
//! gradients = "stored"  # none, eight, cached, stored: where regressions come from
//! key_frames = 10       # reuse by the paper's rule, every Nth picture from scratch
//! low = "nearest"       # nearest, third: how quality low renders
//! ```
//!
//! A key that is left out keeps the preset's default. The preset `colvis` supports all of them. Packets of rays, which the preset
//! `default` uses, support none of the first three; with any of these `default` casts single rays instead. `lean` refuses choices
//! that would take the memory it is there to save. The quality `reference` skips and keeps nothing, whatever is chosen.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// How rays skip empty space. All variants produce the same pictures bit for bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Leaping {
    /// Looks at every sample.
    None,
    /// Uses the homogeneous-region flag, as the paper does. The flags of the 16-bit voxels are not sufficient where
    /// densities are classified; empty bricks alone are used there.
    Flag,
    /// Uses the distance to the wall for each brick of 8×8×8 voxels.
    Brick,
    /// Uses the distance to the wall for each voxel: the paper's potential-field assisted method.
    Voxel,
}

/// The source of the regressions at a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum GradientSource {
    /// Computes each sample's regression directly, as one sum over the 64 voxels around it: regression and
    /// interpolation are both linear.
    None,
    /// Interpolates the regressions of the eight nearest voxels for each sample, as in the paper. At low detail it uses
    /// the nearest voxel's.
    Eight,
    /// As `Eight`, with each voxel's regression cached for later samples and frames.
    Cached,
    /// As `Eight`, with the regressions near the wall computed ahead of time.
    Stored,
}

/// The method for low detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum LowDetail {
    /// A sample takes the nearest voxel's data, as in the paper.
    Nearest,
    /// One ray for nine pixels at high detail; the picture is then stretched.
    Third,
}

/// The largest number of frames from one key frame to the next.
pub const MOST_KEY_FRAMES: u32 = 1_000_000;

/// A scene's choices. `None` keeps the preset's default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Choices {
    /// How rays skip empty space.
    pub leap: Option<Leaping>,
    /// The source of regressions.
    pub gradients: Option<GradientSource>,
    /// Frames from one key frame to the next, at least 1. If set, each picture reuses the previous one.
    pub key_frames: Option<u32>,
    /// The method for low detail.
    pub low: Option<LowDetail>,
}

impl Choices {
    /// Returns true if packets of rays do not support these choices.
    pub fn need_single_rays(&self) -> bool {
        self.leap.is_some() || self.gradients.is_some() || self.key_frames.is_some()
    }

    /// Checks that all numbers are in range.
    ///
    /// # Errors
    /// Returns status 2 if a number is out of range.
    pub fn check(&self) -> Result<()> {
        match self.key_frames {
            Some(n) if !(1..=MOST_KEY_FRAMES).contains(&n) => {
                let hint = format!("give a whole number from 1 to {MOST_KEY_FRAMES}");
                Err(Error::usage("render.key_frames", format!("is {n}"), hint))
            }
            _ => Ok(()),
        }
    }
}

/// Accepts every choice. For a [`Preset`](super::Preset) that supports them all.
///
/// # Errors
/// Never returns an error.
pub fn all(_: &Choices) -> Result<()> {
    Ok(())
}

/// Accepts no choice. For a [`Preset`](super::Preset) with a single rendering method.
///
/// # Errors
/// Returns status 2 if anything is chosen.
pub fn none(choices: &Choices) -> Result<()> {
    if *choices == Choices::default() {
        return Ok(());
    }
    let why = "this preset has no setting leap, gradients, key_frames or low";
    Err(Error::usage("[render]", why, "leave them out, or choose the preset colvis or default"))
}
