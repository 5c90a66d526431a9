//! What a phantom is made of: its size, features and position, and the scanner that sees it.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Standard deviation of the noise, HU.
pub const NOISE_HU: f64 = 22.0;

/// Size of a phantom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Size {
    /// A colon of about 0.7 m on about ten million voxels of 0.9 mm.
    Small,
    /// An adult colon on 512×512×400 voxels of 0.7×0.7×1.0 mm.
    #[default]
    Standard,
    /// The adult colon on 1024×1024×800 voxels of half the spacing.
    Large,
}

impl Size {
    /// Returns the size of the body relative to an adult's.
    pub(crate) fn scale(self) -> f64 {
        if self == Self::Small { 0.58 } else { 1.0 }
    }
}

/// The patient's position on the table. Fluid runs to the side that is down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Position {
    /// On the back.
    #[default]
    Supine,
    /// On the belly.
    Prone,
    /// On the left side.
    Left,
    /// On the right side.
    Right,
}

impl Position {
    /// Returns the position on the other side.
    #[must_use]
    pub fn opposite(self) -> Self {
        match self {
            Self::Supine => Self::Prone,
            Self::Prone => Self::Supine,
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }

    /// Returns the direction of gravity, LPS.
    pub fn down(self) -> DVec3 {
        match self {
            Self::Supine => DVec3::Y,
            Self::Prone => DVec3::NEG_Y,
            Self::Left => DVec3::X,
            Self::Right => DVec3::NEG_X,
        }
    }
}

/// What the scanner makes of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scanner {
    /// Standard deviation of the blur, mm; `None` for about 0.65 of a voxel of the phantom's size.
    pub blur_mm: Option<f64>,
    /// Standard deviation of the noise, HU, if the settings enable it.
    pub noise_hu: f64,
    /// Thickness of the slices of [`Phantom::scan`](super::Phantom::scan), mm; `None` for the spacing of the phantom's grid.
    pub slice_mm: Option<f64>,
    /// HU of all tag, about which inhomogeneous tag varies; `None` as placed: 450, or from 200 to 1200 if inhomogeneous.
    pub tag_hu: Option<f64>,
}

impl Default for Scanner {
    fn default() -> Self {
        Self { blur_mm: None, noise_hu: NOISE_HU, slice_mm: None, tag_hu: None }
    }
}

/// Selects the features of a phantom.
///
/// ```
/// # mod colvis {
/// # pub use colvis_phantom as phantom;
/// # }
/// use colvis::phantom::{Phantom, PhantomSettings, Size};
///
/// let phantom = Phantom::new(&PhantomSettings { size: Size::Small, seed: 3, ..PhantomSettings::default() });
/// let truth = phantom.truth();
/// let inside = truth.centerline[truth.centerline.len() / 2];
/// assert!(phantom.value(inside) < -900.0, "gas, HU");
/// assert!(truth.length_mm > 500.0 && !truth.polyps.is_empty());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhantomSettings {
    /// Size of the phantom.
    pub size: Size,
    /// Semilunar folds.
    pub folds: bool,
    /// Sessile polyps.
    pub polyps: bool,
    /// Pools of tagged fluid with a horizontal level, filled to a third at most.
    pub fluid: bool,
    /// Pools of tagged fluid, some nearly full, with thin folds and polyps under the fluid.
    pub pools: bool,
    /// Films of tagged fluid on the wall.
    pub films: bool,
    /// Tagged stool that clings to the wall and holds bubbles.
    pub stool: bool,
    /// Tag from 200 to 1200 HU, layered and patchy, not 450 HU everywhere.
    pub inhomogeneous: bool,
    /// Pseudo-enhancement: tissue beside tag appears brighter.
    pub pseudo: bool,
    /// The patient's position.
    pub position: Position,
    /// Thin strands of tissue across the lumen.
    pub bridges: bool,
    /// Polyps of every shape and site, about one each 75 mm of the colon, with their ground truth.
    pub lesions: bool,
    /// Structures that mislead detectors: folds that look like a polyp, the ileocecal valve, a rectal tube, untagged stool.
    pub decoys: bool,
    /// Gas-filled small bowel, joined to the colon by the ileocecal valve: open for odd seeds, closed for even ones.
    pub ileum: bool,
    /// A gas-filled stomach with a fluid level.
    pub stomach: bool,
    /// The lower parts of both lungs with airways, and the heart between them, instead of the bases alone.
    pub lungs: bool,
    /// Stretches where the walls of the colon touch.
    pub collapsed: bool,
    /// Pelvic bones.
    pub pelvis: bool,
    /// Two limbs of the colon that share a wall: a septum of 0.4 to 1.5 mm, drawn from the seed, lies between their lumens.
    pub touching: bool,
    /// Thickness of that septum, mm, instead of the drawn one; from 0.2 to 3, to which it is clamped. The colon's axis does not
    /// depend on it.
    pub touching_mm: Option<f64>,
    /// Voxel noise of [`NOISE_HU`].
    pub noise: bool,
    /// Seed of the anatomy. Each seed gives a different colon.
    pub seed: u64,
}

impl PhantomSettings {
    /// Settings of the embedded phantom, for commands without an input: small, and different for each seed.
    pub fn embedded(seed: u64) -> Self {
        Self { size: Size::Small, seed, ..Self::default() }
    }

    /// Settings of a patient with every kind of gas: a colon with pools and collapsed stretches, small bowel, a stomach and lungs, and
    /// a pelvis.
    pub fn with_all_gas(size: Size, seed: u64, position: Position) -> Self {
        Self {
            size,
            seed,
            position,
            pools: true,
            ileum: true,
            stomach: true,
            lungs: true,
            collapsed: true,
            pelvis: true,
            ..Self::default()
        }
    }
}

impl Default for PhantomSettings {
    fn default() -> Self {
        Self {
            size: Size::Standard,
            folds: true,
            polyps: true,
            fluid: false,
            pools: false,
            films: false,
            stool: false,
            inhomogeneous: false,
            pseudo: false,
            position: Position::Supine,
            bridges: false,
            lesions: false,
            decoys: false,
            ileum: false,
            stomach: false,
            lungs: false,
            collapsed: false,
            pelvis: false,
            touching: false,
            touching_mm: None,
            noise: true,
            seed: 1,
        }
    }
}
