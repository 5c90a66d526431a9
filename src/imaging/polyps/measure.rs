//! The lesion at a place that somebody points at, with how far its measures can be trusted.

use glam::DVec3;

use super::base::Scratch;
use super::caps::{Cap, caps_among};
use super::settle::is_thick;
use super::{Lesion, Wall, score};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::Volume;

/// A place farther than this from the wall is in mid-air or in tissue, mm.
const SNAP_MM: f64 = 5.0;
/// Distance along the wall within which a lesion is searched for, mm, and within which its surroundings are.
const SEEK_MM: f32 = 6.0;
const PART_MM: f32 = 32.0;
/// What counts as a cap here: flatter and smaller than a detector's.
const LEAST_K2: f32 = 0.01;
const LEAST_MM2: f32 = 2.0;
/// Cost of each mm between a place and a lesion, in logits of the score.
const PER_MM: f64 = 0.6;
/// Below this confidence the measures come with reasons.
const SURE: f64 = 0.7;

/// A voxel whose value differs by more than this from the scanned one was restored by cleansing, HU.
#[doc(hidden)]
pub const RESTORED_HU: i32 = 60;

/// What a lesion looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Form {
    /// It stands on the wall.
    Sessile,
    /// It hangs on a stalk.
    Stalked,
    /// It is less than 3 mm high, and low for its width.
    Flat,
}

impl Form {
    /// Returns the name of the form.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sessile => "sessile",
            Self::Stalked => "stalked",
            Self::Flat => "flat",
        }
    }
}

/// A measured lesion.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// Its measures.
    pub lesion: Lesion,
    /// What it looks like.
    pub form: Form,
    /// How far the measures can be trusted, 0 to 1.
    pub confidence: f64,
    /// Why the confidence is low, most important first; empty if it is not.
    pub why: Vec<&'static str>,
}

/// Measures the lesion at a place (world, mm LPS) of the wall of `volume`. `is_restored` is true for a place (world, mm)
/// on a wall that cleansing has restored. All places on one lesion give the same measurement. In thick slices, the lesion is measured on a wall
/// without their terraces, which is about half a slice from the one given at most.
///
/// # Errors
/// Returns status 4 if there is no wall within 5 mm, or nothing bulges there.
pub fn measure(wall: &Wall, volume: &Volume, at: DVec3, is_restored: impl Fn(DVec3) -> bool) -> Result<Measurement> {
    let vertex = wall.nearest(at, SNAP_MM).ok_or_else(|| {
        let why = format!("the colon has no wall within {SNAP_MM} mm of the place");
        Error::incomplete("measure", why, "give a place on the wall")
    })?;
    // Detectors keep the wall as it is drawn: settling it smooths more, which small and flat lesions do not all survive.
    let settled = if is_thick(volume) { Some(wall.settled(volume, &Progress::new())?) } else { None };
    let wall = settled.as_ref().unwrap_or(wall);
    let mut scratch = Scratch::new(wall);
    let mut part = scratch.spread(wall, &[vertex], PART_MM);
    part.sort_unstable_by_key(|p| p.1);
    let all = caps_among(wall, part.iter().map(|p| p.1), LEAST_K2, LEAST_MM2);
    let way = |cap: &Cap| cap.vertices.iter().map(|&v| scratch.mm(v)).fold(f32::INFINITY, f32::min);
    let near: Vec<(&Cap, f32)> = all.iter().map(|c| (c, way(c))).filter(|c| c.1 <= SEEK_MM).collect();
    let mut best: Option<(f64, Lesion)> = None;
    for (cap, mm) in near {
        let Some(lesion) = Lesion::of_any(wall, cap, volume, &mut scratch) else { continue };
        let p = score(&lesion).clamp(1e-9, 1.0 - 1e-9);
        let worth = (p / (1.0 - p)).ln() - PER_MM * f64::from(mm);
        if best.as_ref().is_none_or(|b| worth > b.0) {
            best = Some((worth, lesion));
        }
    }
    let (_, lesion) = best.ok_or_else(|| {
        Error::incomplete("measure", "the wall does not bulge into the lumen there", "give a place on a polyp")
    })?;
    let restored = is_restored(lesion.position) || lesion.ends.iter().any(|e| is_restored(*e));
    Ok(judged(lesion, volume, restored))
}

/// Judges how far a lesion's measures can be trusted.
fn judged(lesion: Lesion, volume: &Volume, restored: bool) -> Measurement {
    let f = |name| lesion.feature(name);
    let is_flat = lesion.height_mm < 3.0 && lesion.height_mm < 0.4 * lesion.diameter_mm;
    let form = match f("stalk_mm") > 0.0 && f("normal_overlap") > 0.5 {
        true => Form::Stalked,
        false if is_flat => Form::Flat,
        false => Form::Sessile,
    };
    let grid = volume.grid();
    let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
    let reach = 0.5 * lesion.diameter_mm + 2.0;
    let at_border = {
        let voxel = grid.voxel(lesion.position);
        let mm = voxel.min(last - voxel) * grid.spacing();
        mm.min_element() < reach
    };
    let voxels = lesion.diameter_mm / grid.spacing().max_element();
    // Reasons, and what share of the confidence each leaves.
    let reasons: [(bool, f64, &'static str); 8] = [
        (at_border, 0.3, "the scan ends beside it"),
        (f("shape_index") < 0.84 || f("roundness") < 0.1, 0.3, "it looks like a fold or the tip of one"),
        (is_flat, 0.5, "it is flat"),
        (f("share_air") > 0.1, 0.4, "there is gas inside"),
        (restored, 0.8, "it was under tagged fluid, and its surface was restored"),
        (f("fit_rms_mm") > 0.12, 0.6, "no ellipsoid fits it"),
        (voxels < 4.0, 0.6, "it is smaller than four voxels"),
        (f("fold_mm") < 1.0 && form != Form::Stalked, 0.8, "a fold is beside it"),
    ];
    let confidence = reasons.iter().filter(|r| r.0).map(|r| r.1).product();
    let mut why: Vec<(f64, &'static str)> = reasons.iter().filter(|r| r.0).map(|r| (r.1, r.2)).collect();
    why.sort_by(|a, b| a.0.total_cmp(&b.0));
    let why = if confidence < SURE { why.into_iter().map(|w| w.1).collect() } else { Vec::new() };
    Measurement { lesion, form, confidence, why }
}
