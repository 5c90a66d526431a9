//! The arguments of `colvis phantom`.

use std::path::PathBuf;

use clap::{Args as ClapArgs, ValueEnum};

/// `phantom`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct PhantomArgs {
    /// Output volume; the extension selects the format
    #[arg(long, value_name = "V.nii.gz")]
    pub out: PathBuf,
    /// Write the ground truth as JSON
    #[arg(long, value_name = "T.json")]
    pub truth: Option<PathBuf>,
    /// Size of the colon and its voxels
    #[arg(long, value_enum, default_value = "standard")]
    pub size: PhantomSize,
    /// Features to include
    #[arg(long, value_enum, value_delimiter = ',', default_value = "folds,polyps,noise")]
    pub with: Vec<PhantomFeature>,
    /// The patient's position: fluid runs to the side that is down
    #[arg(long, value_enum, default_value = "supine")]
    pub position: PhantomPosition,
    /// Thickness of the slices, mm: each is the mean of the HU over it. Noise is added afterwards
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub slice: Option<f64>,
    /// Standard deviation of the noise of the scan written, HU [default: 22]
    #[arg(long, value_name = "HU", allow_negative_numbers = true)]
    pub noise: Option<f64>,
    /// Write what each voxel is in: 0 nothing, 1 colon, 2 small bowel, 3 stomach, 4 lung, 5 outside air
    #[arg(long, value_name = "F.nii.gz")]
    pub labels: Option<PathBuf>,
    /// Also write the same colon, in the first position, without tagging and stool
    #[arg(long, value_name = "F.nii.gz")]
    pub twin: Option<PathBuf>,
    /// Also write the same patient in the other position, deformed, with another stretch collapsed and other fluid; --truth then maps
    /// points both ways
    #[arg(long, value_name = "F.nii.gz")]
    pub second: Option<PathBuf>,
    /// Put lesions into this scan, instead of making a phantom: blurred as it is, with noise as it has
    #[arg(long, value_name = "SCAN", conflicts_with_all = ["size", "with", "position", "slice", "noise"])]
    pub into: Option<PathBuf>,
    /// Number of lesions to put into the scan; fewer where there is no room [default: 20]
    #[arg(long, value_name = "N", requires = "into", value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub lesions: Option<u16>,
}

/// The phantom's sizes.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum PhantomSize {
    /// Quick to make; about 0.7 m of colon.
    Small,
    /// An adult colon at CT resolution.
    Standard,
    /// An adult colon at twice that resolution.
    Large,
}

/// Features of a phantom.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum PhantomFeature {
    /// Haustral folds.
    Folds,
    /// Polyps of known size.
    Polyps,
    /// Tagged fluid with a horizontal level.
    Fluid,
    /// Tagged fluid, some of it deep, with thin folds and polyps in it.
    Pools,
    /// Films of tagged fluid on the wall.
    Films,
    /// Tagged stool with bubbles.
    Stool,
    /// Tagging from 200 to 1200 HU, layered and patchy.
    Inhomogeneous,
    /// Tissue beside tagged fluid appears brighter.
    Pseudo,
    /// Thin strands across the lumen.
    Bridges,
    /// Polyps of every shape and site: sessile, stalked and flat, on the wall, on folds and between them.
    Lesions,
    /// Structures that mislead detectors: odd folds, the ileocecal valve, a rectal tube, untagged stool.
    Decoys,
    /// Small bowel with gas, joined to the colon by the ileocecal valve, which is open for odd seeds.
    Ileum,
    /// A stomach with gas and a fluid level.
    Stomach,
    /// The lower parts of both lungs, with airways, and the heart.
    Lungs,
    /// Stretches of the colon without gas.
    Collapsed,
    /// Pelvic bones.
    Pelvis,
    /// Two limbs of the colon that share a thin wall.
    Touching,
    /// Scanner noise.
    Noise,
}

/// Positions of a phantom's patient.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum PhantomPosition {
    /// On the back.
    Supine,
    /// On the belly.
    Prone,
    /// On the left side.
    Left,
    /// On the right side.
    Right,
}
