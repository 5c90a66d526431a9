//! The flow that flattens protrusions finds the places, and the same score as that of [`shape`](super::shape) judges them.
//!
//! It is independent of the watershed of curvatures: a place is a part of the wall that sinks by [`LEAST_MM`] and more.

use rayon::prelude::*;

use crate::error::Result;
use crate::polyps::base::Scratch;
use crate::polyps::{Candidate, Cap, Colon, Detector, Lesion, flow, score, score::above_noise};
use crate::progress::Progress;

/// The detector.
pub(super) const DETECTOR: Detector =
    Detector { name: "protrusion", summary: "protrusions, found by smoothing the wall until nothing bulges", find };

/// Least protrusion of a place, mm, and of the vertices that may belong to it.
const LEAST_MM: f32 = 0.3;
const EDGE_MM: f32 = 0.2;
/// Those belong to it that sink by this share of its largest protrusion.
const SHARE: f32 = 0.3;

fn find(colon: &Colon<'_>, progress: &Progress) -> Result<Vec<Candidate>> {
    let wall = colon.wall;
    let sunk = flow::protrusions(wall, progress)?;
    let mut seen = vec![false; wall.len()];
    let mut places = Vec::new();
    for seed in 0..wall.len() as u32 {
        if seen[seed as usize] || sunk[seed as usize] < EDGE_MM {
            continue;
        }
        seen[seed as usize] = true;
        let mut vertices = vec![seed];
        let mut next = 0;
        while next < vertices.len() {
            for &n in wall.beside(vertices[next]) {
                if sunk[n as usize] >= EDGE_MM && !std::mem::replace(&mut seen[n as usize], true) {
                    vertices.push(n);
                }
            }
            next += 1;
        }
        let most = vertices.iter().map(|&v| sunk[v as usize]).fold(0.0, f32::max);
        if most < LEAST_MM {
            continue;
        }
        vertices.retain(|&v| sunk[v as usize] >= SHARE * most);
        vertices.sort_unstable();
        let k2 = |v: &u32| wall.curvatures(*v)[1];
        let Some(peak) = vertices.iter().copied().max_by(|a, b| k2(a).total_cmp(&k2(b)).then(b.cmp(a))) else {
            continue;
        };
        let area = vertices.iter().map(|&v| wall.area(v)).sum();
        places.push(Cap { peak, k2: k2(&peak), area, vertices });
    }
    progress.check()?;
    let candidate = |scratch: &mut Scratch, cap| {
        let lesion = Lesion::of(wall, cap, colon.volume, scratch)?;
        Some(Candidate { position: lesion.position, score: score(&lesion), lesion: Some(lesion) })
    };
    let found: Vec<Option<Candidate>> =
        places.par_iter().with_min_len(64).map_init(|| Scratch::new(wall), candidate).collect();
    progress.check()?;
    Ok(above_noise(found.into_iter().flatten().collect()))
}
