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

/// The same between moments of a deformed scan, mm: it is interpolated twice.
const DEFORMED_MM: f64 = 0.8;
/// Where the middle of a face has gone is first found to this, mm.
const ABOUT_MM: f64 = 0.01;

/// Which frames see the wall.
pub(super) struct Seen<'a> {
    source: &'a Source<'a>,
    mesh: &'a LumenMesh,
    /// The first frame that sees each face; `usize::MAX` for none.
    first: Vec<usize>,
    /// Every so many frames one is looked at.
    step: usize,
}

/// The middle of a face, world, mm, and its normal into the tissue.
type Face = (DVec3, DVec3);

impl<'a> Seen<'a> {
    /// Creates it for a wall of which nothing was seen.
    pub(super) fn new(source: &'a Source<'a>, mesh: &'a LumenMesh) -> Self {
        let (first, step) = (vec![usize::MAX; mesh.triangles().len()], source.count.div_ceil(MOST).max(1));
        Self { source, mesh, first, step }
    }

    /// True if a frame is to be looked at.
    pub(super) fn wants(&self, n: usize) -> bool {
        n.is_multiple_of(self.step)
    }

    /// Looks at all frames of a scan that stays as it is.
    pub(super) fn look_at_all(&mut self, rays: &Crossings, progress: &Progress) -> Result<()> {
        progress.stage("what was seen", 0);
        let numbers = (0..self.source.count).step_by(self.step);
        let views = numbers.map(|n| Ok((n, (self.source.views)(n)?.0))).collect::<Result<Vec<(usize, View)>>>()?;
        let eyes: Vec<RaysFrom<'_>> = views.iter().map(|(_, view)| rays.from(view.position())).collect();
        let mesh = self.mesh;
        self.first.par_chunks_mut(CHUNK).enumerate().try_for_each(|(n, first)| {
            progress.check()?;
            let faces: Vec<Face> = (0..first.len()).map(|t| face(corners(mesh, n * CHUNK + t))).collect();
            for ((n, view), eye) in views.iter().zip(&eyes) {
                let is_towards = |t: &usize| first[*t] == usize::MAX && may_see(view, faces[*t]);
                let towards: Vec<usize> = (0..faces.len()).filter(is_towards).collect();
                let of = |t: usize| faces[t].0;
                look((*n, eye), &towards, of, SAME_MM, first);
            }
            Ok(())
        })
    }

    /// Looks at a frame of a scan that is deformed, along rays through it as it is then.
    pub(super) fn look_at(&mut self, n: usize, rays: &Crossings, progress: &Progress) -> Result<()> {
        let ((view, seconds), Some(deformation)) = ((self.source.views)(n)?, self.source.deformation) else {
            return Ok(());
        };
        let (eye, mesh) = (rays.from(view.position()), self.mesh);
        self.first.par_chunks_mut(CHUNK).enumerate().try_for_each(|(chunk, first)| {
            progress.check()?;
            let mut faces = vec![(DVec3::NAN, DVec3::NAN); first.len()];
            let is_towards = |(t, face_then): (usize, &mut Face)| {
                if first[t] != usize::MAX {
                    return None;
                }
                let rest = corners(mesh, chunk * CHUNK + t);
                if !is_shown(&view, deformation.place_about(face(rest).0, seconds, ABOUT_MM)) {
                    return None;
                }
                *face_then = face(rest.map(|corner| deformation.place(corner, seconds)));
                may_see(&view, *face_then).then_some(t)
            };
            let towards: Vec<usize> = faces.iter_mut().enumerate().filter_map(is_towards).collect();
            look((n, &eye), &towards, |t| faces[t].0, DEFORMED_MM, first);
            Ok(())
        })
    }

    /// Writes `wall.ply`, whose faces have the number of the first frame that sees them, and `coverage.csv` with the share of the wall's
    /// area seen up to each frame. Both are of the wall as it is in the scan.
    pub(super) fn write(self, folder: &Path, progress: &Progress) -> Result<()> {
        let Self { source, mesh, first, step } = self;
        let (mut by_frame, mut whole) = (vec![0.0; source.count.div_ceil(step)], 0.0);
        for (t, first) in first.iter().enumerate() {
            let area = 0.5 * face(corners(mesh, t)).1.length();
            whole += area;
            if let Some(seen) = by_frame.get_mut(*first / step) {
                *seen += area;
            }
        }
        let number = |t: usize| match first[t] {
            usize::MAX => NEVER,
            n => n.min(usize::from(NEVER) - 1) as u16,
        };
        let about = "the wall, mm LPS; first_frame: the first frame that sees a face, 65535 for none";
        let (origin, places, triangles) = mesh.clone().into_parts();
        let parts = (origin, &places[..], &triangles[..]);
        let ply = |w: &mut dyn Write| write_ply(w, parts, about, true, Some(("first_frame", &number)), progress);
        output::write_whole(&folder.join("wall.ply"), ply)?;
        let csv = |w: &mut dyn Write| -> io::Result<()> {
            writeln!(w, "frame,share_of_wall_seen")?;
            let mut seen = 0.0;
            for (n, mm2) in by_frame.iter().enumerate() {
                seen += mm2;
                writeln!(w, "{},{:.6}", n * step, if whole > 0.0 { seen / whole } else { 0.0 })?;
            }
            Ok(())
        };
        output::write_whole(&folder.join("coverage.csv"), csv)
    }
}

/// Returns the corners of a face, world, mm.
fn corners(mesh: &LumenMesh, t: usize) -> [DVec3; 3] {
    mesh.triangles()[t].map(|v| mesh.world(v))
}

/// Returns the middle of a face and its normal.
fn face([a, b, c]: [DVec3; 3]) -> Face {
    ((a + b + c) / 3.0, (b - a).cross(c - a))
}

/// Gives the faces to which the way from a frame's camera is free its number. `middle` returns where they are, world, mm.
fn look(
    (n, eye): (usize, &RaysFrom<'_>),
    faces: &[usize],
    middle: impl Fn(usize) -> DVec3,
    same_mm: f64,
    first: &mut [usize],
) {
    for some in faces.chunks(16) {
        let ways: [DVec3; 16] = from_fn(|k| some.get(k).map_or(DVec3::X, |t| middle(*t) - eye.origin()));
        let directions = from_fn(|a| ways.map(|way| way[a] / way.length()));
        let ends = from_fn(|k| if k < some.len() { ways[k].length() - same_mm } else { 0.0 });
        let met = eye.sixteen(&directions, &[0.0; 16], &ends);
        for (_, t) in some.iter().enumerate().filter(|(k, _)| met[*k] >= ends[*k]) {
            first[*t] = n;
        }
    }
}

/// True if a face is turned towards a view and within its picture.
fn may_see(view: &View, (place, normal): Face) -> bool {
    (place - view.position()).dot(normal) > 0.0 && is_shown(view, place)
}

/// True if a place (world, mm) is within the picture of a view.
fn is_shown(view: &View, place: DVec3) -> bool {
    let Some([u, v]) = view.project(place) else { return false };
    let is_inside = (0.0..view.width() as f64).contains(&u) && (0.0..view.height() as f64).contains(&v);
    // Within the picture of a pinhole every place has a ray.
    is_inside && (view.pixel().is_some() || view.ray_at(u, v).is_some())
}
