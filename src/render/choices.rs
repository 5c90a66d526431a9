//! What a scene may choose of the paper's ideas (section 2.2), whichever preset makes the pictures.
//!
//! Each is a key of a scene file's table `[render]`:
//!
//! ```toml
//! [render]
//! leap = "voxel"        # none, flag, brick, voxel: how rays pass over what is empty
//! gradients = "stored"  # none, eight, cached, stored: where regressions come from
//! key_frames = 10       # reuse by the paper's rule, every so manyth picture from scratch
//! low = "nearest"       # nearest, third: what low detail is
//! ```
//!
//! What is left out is the preset's own. The preset `colvis` takes all of them in its stride; packets of rays, which the
//! preset `default` is made of, know none of the first three, so that with one of them it casts rays one after the other.
//! `lean` refuses what would take the memory that it is there to spare. The quality `reference` skips and keeps nothing,
//! whatever is chosen.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// How rays pass over what is empty. Pictures are the same bit for bit with all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Leaping {
    /// Every sample is looked at.
    None,
    /// By the homogeneous-region flag, as the paper does. That of the 16-bit voxels tells too little where densities are
    /// classified: there by empty bricks alone.
    Flag,
    /// By the wall's distance for each brick of 8×8×8 voxels.
    Brick,
    /// By the wall's distance for each voxel: the paper's potential-field assisted method.
    Voxel,
}

/// Where the regressions at a sample come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GradientSource {
    /// Each sample's own, by one sum over the 64 voxels around it: regression and interpolation are both linear.
    None,
    /// The eight nearest voxels' for each sample, interpolated, as the paper has it; at low detail the nearest one's.
    Eight,
    /// The same, each voxel's kept for the samples and frames to come.
    Cached,
    /// The same, computed ahead of time near the wall.
    Stored,
}

/// What low detail is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LowDetail {
    /// A sample is what the nearest voxel is: the paper's.
    Nearest,
    /// A ray for nine pixels, at high detail, and the picture is stretched.
    Third,
}

/// The most frames from one key frame to the next.
pub const MOST_KEY_FRAMES: u32 = 1_000_000;

/// What a scene chooses; the preset's own where it says nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Choices {
    /// How rays pass over what is empty.
    pub leap: Option<Leaping>,
    /// Where regressions come from.
    pub gradients: Option<GradientSource>,
    /// Frames from one key frame to the next, at least 1; with it pictures are made with the last one's help.
    pub key_frames: Option<u32>,
    /// What low detail is.
    pub low: Option<LowDetail>,
}

impl Choices {
    /// Whether packets of rays cannot do what is chosen.
    pub fn need_single_rays(&self) -> bool {
        self.leap.is_some() || self.gradients.is_some() || self.key_frames.is_some()
    }

    /// # Errors
    /// Status 2 where a number makes no sense.
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

/// Takes every choice: for a [`Preset`](super::Preset) that follows them all.
///
/// # Errors
/// None.
pub fn all(_: &Choices) -> Result<()> {
    Ok(())
}

/// Takes no choice: for a [`Preset`](super::Preset) that is one way to make pictures and no other.
///
/// # Errors
/// Status 2 where anything is chosen.
pub fn none(choices: &Choices) -> Result<()> {
    if *choices == Choices::default() {
        return Ok(());
    }
    let why = "this preset has neither leap nor gradients, key_frames or low to choose";
    Err(Error::usage("[render]", why, "leave them out, or choose the preset colvis or default"))
}
