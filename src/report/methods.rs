//! The rendering methods that `report render` compares. To add a method, add a line here.

use crate::error::Result;
use crate::render::gradient_store::{GradientVolume, Stored};
use crate::render::leap::VoxelWalls;
use crate::render::packets::{PacketRenderer, Pixels};
use crate::render::reuse::{Refresh, Reusing, Rule, WordStorage};
use crate::render::sampler::Trilinear;
use crate::render::{
    Choices, Classification, Direct, GradientSource, Leaping, Quality, Renderer, Reuse, Settings, presets, renderer,
};
use crate::space::PreparedVolume;
use crate::space::flags::Flags;
use crate::surface::{Mesh, Rasteriser};

/// A rendering method.
#[derive(Clone, Copy)]
pub(crate) struct RenderMethod {
    /// Its name in plots and tables.
    pub name: &'static str,
    /// Family of the method. Methods of one family share a colour.
    pub family: &'static str,
    /// Creates the renderer for a scan.
    pub make: fn(&PreparedVolume) -> Result<Box<dyn Renderer>>,
    /// Its properties.
    pub traits: Traits,
}

/// Properties of a method that the report takes into account.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Traits {
    /// It keeps data from one frame to the next.
    pub keeps: bool,
    /// It computes its own depth instead of the exact crossings.
    pub own_depth: bool,
    /// Its target picture differs from the reference's, so that its difference is not an error.
    pub other_picture: bool,
    /// It is so slow that a quick report omits it.
    pub slow: bool,
}

const PLAIN: Traits = Traits { keeps: false, own_depth: false, other_picture: false, slow: false };
const OTHER: Traits = Traits { other_picture: true, ..PLAIN };

/// Creates the ray caster of a quality with steps of h · 2^`step_power` and the given samples per pixel.
fn direct(
    volume: &PreparedVolume,
    quality: Quality,
    step_power: i32,
    samples_per_pixel: u32,
) -> Result<Box<dyn Renderer>> {
    let settings = Settings { step_power, samples_per_pixel, ..Settings::new(quality) };
    Ok(Box::new(Direct::new(volume, settings)))
}

fn filtered(volume: &PreparedVolume) -> Result<Box<dyn Renderer>> {
    let settings = Settings { classification: Classification::Filtered, ..Settings::default() };
    Ok(Box::new(Direct::new(volume, settings)))
}

const KEEPS: Traits = Traits { keeps: true, ..PLAIN };

/// Creates a packet renderer with samples every h · 2^(`step_power` + 1).
fn packets(volume: &PreparedVolume, step_power: i32, pixels: Pixels) -> Result<Box<dyn Renderer>> {
    Ok(Box::new(PacketRenderer::new(volume, Settings { step_power, ..Settings::default() }, pixels)))
}

fn reusing<R: Rule + 'static>(volume: &PreparedVolume, refresh: Refresh) -> Result<Box<dyn Renderer>> {
    Ok(Box::new(Reusing::<_, R>::new(WordStorage::new(volume), Settings::default(), refresh)))
}

/// Creates the preset `default` with a scene's choices.
fn chosen(volume: &PreparedVolume, choices: Choices) -> Result<Box<dyn Renderer>> {
    let settings = Settings { choices, ..Settings::default() };
    Ok(renderer(volume, settings, presets::standard::PRESET, Reuse::Allowed))
}

const NOTHING: Choices = Choices { leap: None, gradients: None, key_frames: None, low: None };

fn lean(volume: &PreparedVolume) -> Result<Box<dyn Renderer>> {
    let volume = PreparedVolume::lean(volume.shared_voxels(), volume.transfer());
    Ok(renderer(&volume, Settings::default(), presets::lean::PRESET, Reuse::Allowed))
}

/// The reference for all other methods.
pub(crate) const REFERENCE: RenderMethod = RenderMethod {
    name: "reference h/8",
    family: "nothing skipped",
    make: |s| direct(s, Quality::Reference, -3, 1),
    traits: PLAIN,
};

/// All methods.
#[rustfmt::skip]
pub(crate) const METHODS: &[RenderMethod] = &[
    RenderMethod { name: "brute h/16", family: "nothing skipped", make: |s| direct(s, Quality::Reference, -4, 1), traits: Traits { slow: true, ..PLAIN } },
    RenderMethod { name: "brute h/4", family: "nothing skipped", make: |s| direct(s, Quality::Reference, -2, 1), traits: PLAIN },
    RenderMethod { name: "brute h/2", family: "nothing skipped", make: |s| direct(s, Quality::Reference, -1, 1), traits: PLAIN },
    RenderMethod { name: "brute h", family: "nothing skipped", make: |s| direct(s, Quality::Reference, 0, 1), traits: PLAIN },
    RenderMethod { name: "high h/8", family: "flags, trilinear", make: |s| direct(s, Quality::High, -3, 1), traits: PLAIN },
    RenderMethod { name: "high h/4", family: "flags, trilinear", make: |s| direct(s, Quality::High, -2, 1), traits: PLAIN },
    RenderMethod { name: "high h/2", family: "flags, trilinear", make: |s| direct(s, Quality::High, -1, 1), traits: PLAIN },
    RenderMethod { name: "high h", family: "flags, trilinear", make: |s| direct(s, Quality::High, 0, 1), traits: PLAIN },
    RenderMethod { name: "high 2h", family: "flags, trilinear", make: |s| direct(s, Quality::High, 1, 1), traits: PLAIN },
    RenderMethod { name: "low h/2", family: "flags, nearest voxel", make: |s| direct(s, Quality::Low, -1, 1), traits: PLAIN },
    RenderMethod { name: "low h", family: "flags, nearest voxel", make: |s| direct(s, Quality::Low, 0, 1), traits: PLAIN },
    RenderMethod { name: "filtered h/2", family: "filtered density", make: filtered, traits: OTHER },
    RenderMethod { name: "2 samples", family: "samples a pixel", make: |s| direct(s, Quality::High, -1, 2), traits: OTHER },
    RenderMethod { name: "4 samples", family: "samples a pixel", make: |s| direct(s, Quality::High, -1, 4), traits: OTHER },
    RenderMethod { name: "16 samples", family: "samples a pixel", make: |s| direct(s, Quality::High, -1, 16), traits: OTHER },
    RenderMethod { name: "wall distance, voxels", family: "one acceleration", make: |s| chosen(s, Choices { leap: Some(Leaping::Voxel), ..NOTHING }), traits: PLAIN },
    RenderMethod { name: "wall distance, bricks", family: "one acceleration", make: |s| chosen(s, Choices { leap: Some(Leaping::Brick), ..NOTHING }), traits: PLAIN },
    RenderMethod { name: "stored gradients", family: "one acceleration", make: |s| chosen(s, Choices { gradients: Some(GradientSource::Stored), ..NOTHING }), traits: PLAIN },
    RenderMethod { name: "gradient cache", family: "one acceleration", make: |s| chosen(s, Choices { gradients: Some(GradientSource::Cached), ..NOTHING }), traits: PLAIN },
    RenderMethod { name: "reuse, staggered", family: "one acceleration", make: |s| reusing::<f32>(s, Refresh::Staggered(16)), traits: KEEPS },
    RenderMethod { name: "reuse, paper's rule", family: "one acceleration", make: |s| chosen(s, Choices { key_frames: Some(10), ..NOTHING }), traits: KEEPS },
    RenderMethod { name: "preset colvis", family: "filtered density", make: |s| Ok(renderer(s, Settings::default(), presets::colvis::PRESET, Reuse::Allowed)), traits: Traits { other_picture: true, ..KEEPS } },
    RenderMethod { name: "preset lean", family: "flags, trilinear", make: lean, traits: PLAIN },
    RenderMethod { name: "packets h/4", family: "packets of rays", make: |s| packets(s, -3, Pixels::All), traits: PLAIN },
    RenderMethod { name: "packets h", family: "packets of rays", make: |s| packets(s, -1, Pixels::All), traits: PLAIN },
    RenderMethod { name: "packets 2h", family: "packets of rays", make: |s| packets(s, 0, Pixels::All), traits: PLAIN },
    RenderMethod { name: "default", family: "packets of rays", make: |s| packets(s, -1, Pixels::Needed), traits: PLAIN },
    RenderMethod { name: "default h/4", family: "packets of rays", make: |s| packets(s, -3, Pixels::Needed), traits: PLAIN },
    RenderMethod { name: "marching cubes", family: "indirect", make: |s| Ok(Box::new(Rasteriser::new(s)?)), traits: Traits { own_depth: true, ..PLAIN } },
];

/// The role of a preparation in the paper's claims.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// The homogeneous-region flags.
    Flag,
    /// The wall distance of each voxel: the potential field.
    Field,
    /// Precomputed gradients and densities.
    Gradients,
    /// The surface of the indirect method.
    Surface,
}

/// A data structure that is built from the voxels before the first frame.
#[derive(Clone, Copy)]
pub(crate) struct Preparation {
    /// Its name in tables.
    pub name: &'static str,
    /// Its role.
    pub role: Role,
    /// Builds it and returns its size in bytes.
    pub build: fn(&PreparedVolume) -> Result<usize>,
}

/// All preparations. To add one that the paper's claims compare with, add a line here. A claim whose preparation is missing is
/// omitted.
#[rustfmt::skip]
pub(crate) const PREPARATIONS: &[Preparation] = &[
    Preparation { name: "homogeneous-region flags", role: Role::Flag, build: |s| Ok(Flags::new(s.voxels(), s.transfer()).bytes()) },
    Preparation { name: "wall distance per voxel", role: Role::Field, build: |s| Ok(VoxelWalls::new(s).bytes()) },
    Preparation { name: "gradients near the wall", role: Role::Gradients, build: |s| Ok(GradientVolume::new(&Trilinear::new(s), s, Stored::NearWall).bytes()) },
    Preparation { name: "marching cubes mesh", role: Role::Surface, build: |s| Ok(Mesh::new(s)?.bytes()) },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_families_fit_the_colours() {
        let mut names: Vec<&str> = METHODS.iter().chain([&REFERENCE]).map(|m| m.name).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
        let mut families: Vec<&str> = METHODS.iter().map(|m| m.family).collect();
        families.sort_unstable();
        families.dedup();
        assert!(families.len() <= super::super::pen::COLOURS.len());
    }
}
