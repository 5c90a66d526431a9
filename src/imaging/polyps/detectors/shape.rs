//! The default: caps of the wall, each ranked by its shape, the wall that it stands on, and its content.

use rayon::prelude::*;

use crate::error::Result;
use crate::polyps::base::Scratch;
use crate::polyps::{Candidate, Colon, Detector, Lesion, caps, score};
use crate::progress::Progress;

/// The detector.
pub(super) const DETECTOR: Detector =
    Detector { name: "shape", summary: "caps of the wall, ranked by shape, height and content", find };

/// Least curvature of a cap, 1/mm: a flat lesion of 20 mm has less on top.
const LEAST_K2: f32 = 0.02;
/// Least area of a cap, mm².
const LEAST_MM2: f32 = 3.0;

fn find(colon: &Colon<'_>, progress: &Progress) -> Result<Vec<Candidate>> {
    let all = caps(colon.wall, LEAST_K2, LEAST_MM2);
    progress.check()?;
    let candidate = |scratch: &mut Scratch, cap| {
        let lesion = Lesion::of(colon.wall, cap, colon.volume, scratch)?;
        Some(Candidate { position: lesion.position, score: score(&lesion), lesion: Some(lesion) })
    };
    let found: Vec<Option<Candidate>> =
        all.par_iter().with_min_len(64).map_init(|| Scratch::new(colon.wall), candidate).collect();
    progress.check()?;
    Ok(found.into_iter().flatten().collect())
}
