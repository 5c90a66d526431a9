//! The wall as a mesh, and when it was first seen.

use std::array::from_fn;
use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;
use rayon::prelude::*;

use super::Source;
use crate::error::Result;
use crate::output;
use crate::progress::Progress;
use crate::render::View;
use crate::render::leap::{Crossings, RaysFrom};
use crate::surface::{LumenMesh, write_ply};

/// The number of a face that no frame sees.
const NEVER: u16 = u16::MAX;
/// A face is seen if nothing is more than this before its middle, mm: the mesh is smooth where the scan has steps.
const SAME_MM: f64 = 0.4;
/// The most frames that are looked at. Of more, every second, third, … is.
const MOST: usize = 4000;
/// Faces that a thread looks at together: neighbours, so that the rays to sixteen of them lie close together.
const CHUNK: usize = 1 << 10;

/// Writes `wall.ply`, whose faces have the number of the first frame that sees them, and `coverage.csv` with the share of the wall's area
/// seen up to each frame.
pub(super) fn write(
    (source, rays): (&Source<'_>, &Crossings),
    mesh: &LumenMesh,
    folder: &Path,
    progress: &Progress,
) -> Result<()> {
    let step = source.count.div_ceil(MOST).max(1);
    let looked: Vec<usize> = (0..source.count).step_by(step).collect();
    let views = looked.iter().map(|n| Ok((source.views)(*n)?.0)).collect::<Result<Vec<View>>>()?;
    progress.stage("what was seen", 0);
    let corners = |t: usize| mesh.triangles()[t].map(|v| mesh.world(v));
    let eyes: Vec<RaysFrom<'_>> = views.iter().map(|view| rays.from(view.position())).collect();
    let mut first = vec![usize::MAX; mesh.triangles().len()];
    first.par_chunks_mut(CHUNK).enumerate().for_each(|(n, first)| {
        let faces = (0..first.len()).map(|t| {
            let [a, b, c] = corners(n * CHUNK + t);
            // Into the tissue.
            ((a + b + c) / 3.0, (b - a).cross(c - a))
        });
        let faces: Vec<(DVec3, DVec3)> = faces.collect();
        for (n, (view, eye)) in views.iter().zip(&eyes).enumerate() {
            let is_towards = |t: &usize| first[*t] == usize::MAX && may_see(view, faces[*t]);
            let towards: Vec<usize> = (0..faces.len()).filter(is_towards).collect();
            for some in towards.chunks(16) {
                let ways: [DVec3; 16] = from_fn(|k| some.get(k).map_or(DVec3::X, |t| faces[*t].0 - eye.origin()));
                let directions = from_fn(|a| ways.map(|way| way[a] / way.length()));
                let ends = from_fn(|k| if k < some.len() { ways[k].length() - SAME_MM } else { 0.0 });
                let met = eye.sixteen(&directions, &[0.0; 16], &ends);
                for (_, t) in some.iter().enumerate().filter(|(k, _)| met[*k] >= ends[*k]) {
                    first[*t] = n;
                }
            }
        }
    });
    progress.check()?;
    let (mut by_frame, mut whole) = (vec![0.0; views.len()], 0.0);
    for (t, first) in first.iter().enumerate() {
        let [a, b, c] = corners(t);
        let area = 0.5 * (b - a).cross(c - a).length();
        whole += area;
        if let Some(seen) = by_frame.get_mut(*first) {
            *seen += area;
        }
    }
    let number = |t: usize| match first[t] {
        usize::MAX => NEVER,
        n => (n * step).min(usize::from(NEVER) - 1) as u16,
    };
    let about = "the wall, mm LPS; first_frame: the first frame that sees a face, 65535 for none";
    let (origin, places, triangles) = mesh.clone().into_parts();
    let parts = (origin, &places[..], &triangles[..]);
    let ply = |w: &mut dyn Write| write_ply(w, parts, about, true, Some(("first_frame", &number)), progress);
    output::write_whole(&folder.join("wall.ply"), ply)?;
    let csv = |w: &mut dyn Write| -> io::Result<()> {
        writeln!(w, "frame,share_of_wall_seen")?;
        let mut seen = 0.0;
        for (n, mm2) in looked.iter().zip(&by_frame) {
            seen += mm2;
            writeln!(w, "{n},{:.6}", if whole > 0.0 { seen / whole } else { 0.0 })?;
        }
        Ok(())
    };
    output::write_whole(&folder.join("coverage.csv"), csv)
}

/// True if a face (its middle, world, mm, and its normal into the tissue) is turned towards a view and within its picture.
fn may_see(view: &View, (place, normal): (DVec3, DVec3)) -> bool {
    if (place - view.position()).dot(normal) <= 0.0 {
        return false;
    }
    let Some([u, v]) = view.project(place) else { return false };
    let is_inside = (0.0..view.width() as f64).contains(&u) && (0.0..view.height() as f64).contains(&v);
    is_inside && view.ray_at(u, v).is_some()
}
