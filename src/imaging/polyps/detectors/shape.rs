//! The default: caps of the wall, each ranked by its shape, the wall that it stands on, and its content.

use std::ops::Range;

use rayon::prelude::*;

use crate::error::Result;
use crate::polyps::base::Scratch;
use crate::polyps::broad::over_bowel;
use crate::polyps::lesion::Limits;
use crate::polyps::{Candidate, Cap, Colon, Detector, Lesion, Wall, caps, score, score::above_noise};
use crate::progress::Progress;

/// The detector.
pub(super) const DETECTOR: Detector =
    Detector { name: "shape", summary: "caps of the wall, ranked by shape, height and content", find };

/// Least curvature of a cap, 1/mm: a flat lesion of 20 mm has less on top.
const LEAST_K2: f32 = 0.02;
/// Least area of a cap, mm².
const LEAST_MM2: f32 = 3.0;

/// Least curvature over that of the bowel, 1/mm, and area of a cap that is a broad, low lesion, mm².
const BROAD_K2: f32 = 0.03;
const BROAD_MM2: f32 = 20.0;
/// What is curved less than this share of its peak is none of it.
const BROAD_EDGE: f32 = 0.15;
/// Limits of a plaque's height and extent, mm, of its height for its extent, and of the gas in it.
const PLAQUE_HIGH_MM: Range<f64> = 0.8..4.0;
const PLAQUE_WIDE_MM: Range<f64> = 6.0..30.0;
const PLAQUE_LOW: f64 = 0.4;
const PLAQUE_AIR: f64 = 0.1;

fn find(colon: &Colon<'_>, progress: &Progress) -> Result<Vec<Candidate>> {
    // The flood of caps runs on one thread.
    let (tops, broad) = rayon::join(|| caps(colon.wall, LEAST_K2, LEAST_MM2), || over_bowel(colon.wall, progress));
    let broad = broad?;
    let mut found = judged(colon, colon.wall, &tops, &Limits::NO_RIDGE, progress)?;
    let mut tops = caps(&broad, BROAD_K2, BROAD_MM2);
    tops.iter_mut().for_each(|cap| trim(cap, &broad));
    let (extent_mm, height_mm) = (PLAQUE_WIDE_MM, PLAQUE_HIGH_MM);
    let limits = Limits { extent_mm, height_mm, ..Limits::NO_RIDGE };
    let plaques = judged(colon, &broad, &tops, &limits, progress)?;
    found.extend(plaques.into_iter().filter(|c| c.lesion.as_ref().is_some_and(is_plaque)));
    Ok(above_noise(found))
}

/// Takes off a cap what is hardly curved: over a bowel that is as curved itself, a flood finds no edge.
fn trim(cap: &mut Cap, wall: &Wall) {
    cap.vertices.retain(|&v| wall.curvatures(v)[1] >= BROAD_EDGE * cap.k2);
    cap.area = cap.vertices.iter().map(|&v| wall.area(v)).sum();
}

/// True for a lesion within the limits of height and extent that is low for its extent; the finer scale sees all others better.
fn is_plaque(lesion: &Lesion) -> bool {
    let f = |name| lesion.feature(name);
    lesion.height_mm < PLAQUE_LOW * f("extent_mm") && f("share_air") < PLAQUE_AIR
}

/// Returns the candidates among the caps of a wall.
fn judged(colon: &Colon<'_>, wall: &Wall, all: &[Cap], limits: &Limits, progress: &Progress) -> Result<Vec<Candidate>> {
    progress.check()?;
    let candidate = |scratch: &mut Scratch, cap| {
        let lesion = Lesion::within(wall, cap, colon.volume, scratch, limits)?;
        Some(Candidate { position: lesion.position, score: score(&lesion), lesion: Some(lesion) })
    };
    let found: Vec<Option<Candidate>> =
        all.par_iter().with_min_len(64).map_init(|| Scratch::new(wall), candidate).collect();
    progress.check()?;
    Ok(found.into_iter().flatten().collect())
}
