//! The benefit of each idea of the paper's section 2.2: the preset `colvis` with and without it, rendered in turn.

use std::time::Instant;

use crate::error::Result;
use crate::progress::Progress;
use crate::render::bytes::{ByteStorage, ByteVolume};
use crate::render::presets::{colvis, standard};
use crate::render::single::by_frames;
use crate::render::{
    Choices, Classification, Direct, Frame, GradientSource, Leaping, Quality, Renderer, Reuse, Settings, Work, psnr,
    renderer,
};
use crate::report::flight::Stop;
use crate::report::median;
use crate::report::page::Page;
use crate::report::table::{Table, table};
use crate::space::PreparedVolume;

use super::{Extent, Subject};

/// A variant of the preset `colvis` that differs in one respect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Variant {
    /// The unchanged preset.
    Whole,
    /// Rays continue behind the wall.
    NoSensitivity,
    /// Samples the nearest voxel.
    Low,
    /// Classifies by the trilinear value.
    ByValue,
    /// Uses the 16-bit voxels.
    Words,
    /// Uses another method of leaping.
    Leap(Leaping),
    /// Uses another source of gradients.
    Gradients(GradientSource),
    /// Renders every picture from scratch.
    NoReuse,
    /// Renders only the first picture from scratch.
    NoKeyFrames,
    /// Skips, keeps and reuses nothing, and computes eight regressions for each sample.
    Unaccelerated,
}

/// An idea, and the variants that are compared.
struct Idea {
    /// Name in the paper's words.
    name: &'static str,
    file: &'static str,
    setting: &'static str,
    with: Variant,
    without: Variant,
}

/// The ideas, in the order of the paper.
#[rustfmt::skip]
const IDEAS: &[Idea] = &[
    Idea { name: "a ray ends at the camera's sensitivity", file: "caster.rs", setting: "sensitivity = 0.002", with: Variant::Whole, without: Variant::NoSensitivity },
    Idea { name: "opacity by the filtered density D, not the trilinear value", file: "classify.rs", setting: "filtered_density = true", with: Variant::Whole, without: Variant::ByValue },
    Idea { name: "low detail: the nearest voxel", file: "bytes/sampler.rs", setting: "--quality low, low = \"nearest\"", with: Variant::Low, without: Variant::Whole },
    Idea { name: "7 + 1 bits a voxel instead of 16", file: "bytes/mod.rs", setting: "preset = \"colvis\"", with: Variant::Whole, without: Variant::Words },
    Idea { name: "the homogeneous-region flag", file: "bytes/skip.rs", setting: "leap = \"flag\"", with: Variant::Whole, without: Variant::Leap(Leaping::None) },
    Idea { name: "the potential field instead of the flag", file: "leap/voxels.rs", setting: "leap = \"voxel\"", with: Variant::Leap(Leaping::Voxel), without: Variant::Whole },
    Idea { name: "distances of bricks instead of the flag (not the paper's)", file: "leap/bricks.rs", setting: "leap = \"brick\"", with: Variant::Leap(Leaping::Brick), without: Variant::Whole },
    Idea { name: "gradients cached, not eight computed for each sample", file: "gradient_cache.rs", setting: "gradients = \"cached\"", with: Variant::Whole, without: Variant::Gradients(GradientSource::Eight) },
    Idea { name: "gradients and densities ahead of time, not cached", file: "gradient_store.rs", setting: "gradients = \"stored\"", with: Variant::Gradients(GradientSource::Stored), without: Variant::Whole },
    Idea { name: "one sum for a sample, not cached (not the paper's)", file: "regression.rs", setting: "gradients = \"none\"", with: Variant::Gradients(GradientSource::None), without: Variant::Whole },
    Idea { name: "frame-to-frame reuse", file: "reuse/paper.rs", setting: "without --no-reuse", with: Variant::Whole, without: Variant::NoReuse },
    Idea { name: "every 10th frame from scratch", file: "reuse/mod.rs", setting: "key_frames = 10", with: Variant::Whole, without: Variant::NoKeyFrames },
    Idea { name: "all accelerations together", file: "presets/colvis.rs", setting: "preset = \"colvis\"", with: Variant::Whole, without: Variant::Unaccelerated },
];

impl Variant {
    /// Creates its renderer.
    pub(crate) fn renderer(self, volume: &PreparedVolume) -> Box<dyn Renderer> {
        let make = |settings: Settings, reuse| renderer(volume, settings, colvis::PRESET, reuse);
        let chosen = |choices| make(Settings { choices, ..Settings::default() }, Reuse::Allowed);
        let nothing = Choices::default();
        match self {
            Self::Whole => chosen(nothing),
            Self::NoSensitivity => make(Settings { sensitivity: 0.0, ..Settings::default() }, Reuse::Allowed),
            Self::Low => make(Settings::new(Quality::Low), Reuse::Allowed),
            Self::ByValue => {
                let storage = ByteStorage::new(volume, ByteVolume::new(volume, 1), colvis::LEAPING, colvis::GRADIENTS);
                by_frames(storage, Settings::default(), Some(colvis::KEY_FRAMES))
            }
            Self::Words => {
                let (leap, gradients) = (Some(colvis::LEAPING), Some(colvis::GRADIENTS));
                let choices = Choices { leap, gradients, key_frames: Some(colvis::KEY_FRAMES), ..nothing };
                let settings = Settings { classification: Classification::Filtered, choices, ..Settings::default() };
                renderer(volume, settings, standard::PRESET, Reuse::Allowed)
            }
            Self::Leap(leap) => chosen(Choices { leap: Some(leap), ..nothing }),
            Self::Gradients(source) => chosen(Choices { gradients: Some(source), ..nothing }),
            Self::NoReuse => make(Settings::default(), Reuse::Never),
            Self::NoKeyFrames => chosen(Choices { key_frames: Some(u32::MAX), ..nothing }),
            Self::Unaccelerated => {
                let (leap, gradients) = (Some(Leaping::None), Some(GradientSource::Eight));
                let choices = Choices { leap, gradients, ..nothing };
                make(Settings { choices, ..Settings::default() }, Reuse::Never)
            }
        }
    }

    /// True if frames take so long that only few are rendered.
    fn is_slow(self) -> bool {
        matches!(self, Self::NoSensitivity | Self::Leap(Leaping::None) | Self::Unaccelerated)
    }
}

/// Measurements of a variant.
pub(crate) struct Taken {
    /// The variant.
    pub variant: Variant,
    renderer: Box<dyn Renderer>,
    /// Time of each frame, ms.
    pub ms: Vec<f64>,
    /// Rays and samples of all frames.
    pub work: Work,
    /// Memory at the end in addition to the 16-bit voxels, bytes.
    pub bytes: usize,
    /// Smallest PSNR against brute force with the same classification as the preset's, dB.
    pub worst_psnr: f64,
}

/// Renders the stops that are part of the flight, and some frames before each, with every variant in turn.
pub(crate) fn measure(
    volume: &PreparedVolume,
    stops: &[Stop],
    extent: &Extent,
    progress: &Progress,
) -> Result<Vec<Taken>> {
    let mut all: Vec<Taken> = Vec::new();
    for variant in IDEAS.iter().flat_map(|idea| [idea.with, idea.without]) {
        if all.iter().all(|t| t.variant != variant) {
            let renderer = variant.renderer(volume);
            let (ms, work) = (Vec::new(), Work::default());
            all.push(Taken { variant, renderer, ms, work, bytes: 0, worst_psnr: f64::INFINITY });
        }
    }
    let settings = Settings { classification: Classification::Filtered, ..Settings::new(Quality::Reference) };
    let mut reference = Direct::new(volume, settings);
    let flown: Vec<&Stop> = stops.iter().filter(|s| !s.jump).collect();
    let every = flown.len().div_ceil(extent.effort.choose(3, 8)).max(1);
    let flown: Vec<&Stop> = flown.into_iter().step_by(every).collect();
    progress.stage("worth of each idea", (flown.len() * all.len()) as u64);
    let (mut truth, mut frame) = (Frame::default(), Frame::default());
    for (n, stop) in flown.into_iter().enumerate() {
        reference.render(&stop.pose.view(extent.fov_degrees, extent.pixels)?, &mut truth);
        for k in 0..all.len() {
            let count = all.len();
            let taken = &mut all[(k + n) % count];
            // The first frame follows a jump and only prepares the next ones.
            let most = if taken.variant.is_slow() { 1 } else { stop.lead.len() };
            let lead = &stop.lead[stop.lead.len() - most.min(stop.lead.len())..];
            for (m, pose) in lead.iter().chain([&stop.pose]).enumerate() {
                let view = pose.view(extent.fov_degrees, extent.pixels)?;
                let begun = Instant::now();
                let work = taken.renderer.render(&view, &mut frame);
                if m > 0 || lead.is_empty() {
                    taken.ms.push(begun.elapsed().as_secs_f64() * 1e3);
                    taken.work = taken.work + work;
                }
            }
            taken.worst_psnr = taken.worst_psnr.min(psnr(&frame, &truth));
            taken.bytes = taken.renderer.bytes();
            progress.advance(1)?;
        }
    }
    Ok(all)
}

/// Writes the section on the benefit of each idea of the paper.
pub(crate) fn tell(page: &mut Page, s: &Subject, taken: &[Taken], extent: &Extent) -> Result<()> {
    page.section(&format!("{}: benefit of each idea of the paper's section 2.2", s.title));
    page.text(&format!(
        "The preset colvis at {0} × {0} pixels with and without each idea, rendered in turn along the flight. PSNR is against brute force by the filtered density of the 16-bit voxels. All variants use headlight and regression; `report gradients` compares the regression's error with others; SIMD levels are below.",
        extent.pixels
    ));
    page.table(&format!("{}-worth", s.name), &table(taken, s.volume.voxels().bytes()))
}

/// Returns the table, with a row for each idea.
pub(crate) fn table(taken: &[Taken], volume: usize) -> Table {
    let find = |variant: Variant| taken.iter().find(|t| t.variant == variant);
    let samples = |t: &Taken| t.work.samples as f64 / t.work.rays.max(1) as f64;
    table!(for (idea, with, without) in IDEAS.iter().filter_map(|i| Some((i, find(i.with)?, find(i.without)?)));
        "idea" => idea.name,
        "src/imaging/render/" => idea.file,
        "setting" => idea.setting,
        "frame with it / ms" => (median(&with.ms), 2),
        "frame without it / ms" => (median(&without.ms), 2),
        "times faster" => (median(&without.ms) / median(&with.ms), 2),
        "samples a ray with it" => (samples(with), 2),
        "samples a ray without it" => (samples(without), 2),
        "memory with it / 16-bit volume" => (with.bytes as f64 / volume as f64, 3),
        "memory without it / 16-bit volume" => (without.bytes as f64 / volume as f64, 3),
        "PSNR worst with it / dB" => (with.worst_psnr, 1),
        "PSNR worst without it / dB" => (without.worst_psnr, 1),
    )
}
