//! The baseline: a threshold on shape index and curvedness (Yoshida and Näppi 2001).
//!
//! Vertices with a shape index of at least 0.9 and a curvedness of 0.09 to 0.8 per mm are seeds: balls of 3 to 20 mm, the
//! smallest of which the scanner's blur curves more by a fifth. Those beside them with at least 0.8 and 0.05 to 1.0 per mm join
//! them. A larger area is a better candidate. The authors' ranges end at 0.2 and 0.25 per mm, which no ball below 8 mm reaches.

use crate::error::Result;
use crate::polyps::{Candidate, Colon, Detector, Wall};
use crate::progress::Progress;

/// The detector.
pub(super) const DETECTOR: Detector =
    Detector { name: "curvature", summary: "areas of the wall curved like a ball of 3 to 20 mm", find };

/// Least area of a candidate, mm².
const LEAST_MM2: f32 = 4.0;

fn is_seed(wall: &Wall, v: u32) -> bool {
    wall.shape_index(v) >= 0.9 && (0.09..=0.8).contains(&wall.curvedness(v))
}

fn joins(wall: &Wall, v: u32) -> bool {
    wall.shape_index(v) >= 0.8 && (0.05..=1.0).contains(&wall.curvedness(v))
}

/// A middle farther than this from its patch is not on the wall, mm.
const OFF_WALL_MM: f64 = 5.0;

fn find(colon: &Colon<'_>, progress: &Progress) -> Result<Vec<Candidate>> {
    let wall = colon.wall;
    let mut seen = vec![false; wall.len()];
    let mut out = Vec::new();
    for seed in 0..wall.len() as u32 {
        if seen[seed as usize] || !is_seed(wall, seed) {
            continue;
        }
        seen[seed as usize] = true;
        let mut patch = vec![seed];
        let mut next = 0;
        while next < patch.len() {
            for &n in wall.beside(patch[next]) {
                if !seen[n as usize] && joins(wall, n) {
                    seen[n as usize] = true;
                    patch.push(n);
                }
            }
            next += 1;
        }
        let area: f32 = patch.iter().map(|&v| wall.area(v)).sum();
        if area >= LEAST_MM2 {
            let sum = patch.iter().map(|&v| wall.world(v) * f64::from(wall.area(v))).sum::<glam::DVec3>();
            let middle = sum / f64::from(area);
            // The middle of a patch that bends round, such as a rim, is not on the wall: then its nearest place.
            let near = patch.iter().map(|&v| wall.world(v));
            let nearest = near.min_by(|a, b| a.distance_squared(middle).total_cmp(&b.distance_squared(middle)));
            let on_wall = nearest.filter(|n| n.distance(middle) > OFF_WALL_MM).unwrap_or(middle);
            out.push(Candidate::new(on_wall, f64::from(area)));
        }
    }
    progress.check()?;
    Ok(out)
}
