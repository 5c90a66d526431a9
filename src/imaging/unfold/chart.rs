//! The wall as a mesh whose vertices know how far along the colon they are and at which angle about it.

use std::f32::consts::{PI, TAU};
use std::sync::OnceLock;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::axis::{Axis, Piece, Station};
use crate::error::{Error, Result};
use crate::fields::Lumen;
use crate::fields::centerline::Centerline;
use crate::fields::harmonic::{CELL_MM, Domain};
use crate::fields::lumen::Interior;
use crate::progress::Progress;
use crate::surface::LumenMesh;
use crate::volume::Volume;

/// Sides of a triangle that are longer than this along the colon bridge two parts of the lumen, mm.
const BRIDGE_MM: f32 = 25.0;

/// The wall of a colon with its coordinates: for each vertex of the mesh the distance along the colon and the angle about it.
///
/// The distance is that of the harmonic function's level (see [`fields::harmonic`](crate::fields::harmonic)) on the line; the angle is
/// that of the direction from the line's point of that level, in a frame that does not turn about the line. Angle 0 is towards the
/// patient's front at the beginning of the line. Each point of the wall has one distance and one angle.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Vertices are offsets from here, mm.
    pub(super) origin: DVec3,
    pub(super) places: Vec<Vec3>,
    /// Counter-clockwise as seen from the tissue.
    pub(super) triangles: Vec<[u32; 3]>,
    /// For each vertex the distance along the line, mm; NaN if it belongs to no piece of the line.
    pub(super) along: Vec<f32>,
    /// For each vertex the angle about the line, −π to π.
    pub(super) angle: Vec<f32>,
    pub(super) pieces: Vec<Piece>,
    /// Length of the line, mm.
    length_mm: f64,
    /// Number of steps of the solver, and of cells.
    solved: [usize; 2],
    /// The girth and the areas, once they were asked for: a second sheet of this chart asks for the same.
    girth_mm: OnceLock<f64>,
    areas: OnceLock<Areas>,
}

/// The wall's area in equal lengths of the line.
#[derive(Clone, Debug, PartialEq)]
struct Areas {
    from_mm: f64,
    each_mm: f64,
    mm2: Vec<f64>,
}

impl Chart {
    /// Unfolds the wall of `lumen`, found in `volume`, about its line from the rectum to the cecum. The wall of gas is at `iso` HU.
    ///
    /// # Errors
    /// Returns status 4 if the line leads through no part of the lumen or if interrupted, status 3 if there are more voxels than can be
    /// numbered.
    pub fn new(volume: &Volume, lumen: &Lumen, line: &Centerline, iso: f64, progress: &Progress) -> Result<Self> {
        let interior = Interior::of_lumen(volume, lumen, iso, progress)?;
        Self::of_interior(&interior, line, progress)
    }

    /// Unfolds the wall of an interior about a line through it.
    ///
    /// # Errors
    /// As [`Chart::new`].
    pub fn of_interior(interior: &Interior<'_>, line: &Centerline, progress: &Progress) -> Result<Self> {
        progress.stage("unfolding", 0);
        let domain = Domain::new(interior.grid(), interior.set(), CELL_MM, progress)?;
        let axis = Axis::new(&domain, line, progress)?;
        if axis.pieces.is_empty() {
            let why = "the line from the rectum to the cecum leads through no part of the lumen";
            return Err(Error::incomplete("unfold", why, "check the lumen with colvis segment"));
        }
        let (mesh, _) = LumenMesh::new(interior, progress)?.without_islands();
        progress.stage("unfolding", 0);
        let (origin, places, triangles) = mesh.into_parts();
        let coordinates: Vec<(f32, f32)> = places
            .par_iter()
            .map(|place| coordinates(&domain, &axis, origin + place.as_dvec3()).unwrap_or((f32::NAN, 0.0)))
            .collect();
        let (along, angle) = coordinates.into_iter().unzip();
        let solved = [axis.harmonic.steps(), domain.len()];
        let length_mm = line.length_mm;
        Ok(Self {
            origin,
            places,
            triangles,
            along,
            angle,
            pieces: axis.pieces,
            length_mm,
            solved,
            girth_mm: OnceLock::new(),
            areas: OnceLock::new(),
        })
    }

    /// Returns the length of the line, mm.
    pub fn length_mm(&self) -> f64 {
        self.length_mm
    }

    /// Returns the first and last distance along the line that any wall has, mm. The wall beyond the line's ends is before 0 and behind
    /// its length.
    pub fn extent_mm(&self) -> [f64; 2] {
        let end = |piece: Option<&Piece>, of: fn(&[Station]) -> Option<&Station>| {
            piece.and_then(|p| of(&p.stations)).map_or(0.0, |s| s.mm)
        };
        [end(self.pieces.first(), |s| s.first()), end(self.pieces.last(), |s| s.last())]
    }

    /// Returns the stretches of the line (from, to; mm) between two pieces of the lumen: nothing is shown there.
    pub fn gaps(&self) -> Vec<[f64; 2]> {
        let ends = |p: &Piece| [p.stations[0].mm, p.stations[p.stations.len() - 1].mm];
        self.pieces.windows(2).map(|w| [ends(&w[0])[1], ends(&w[1])[0]]).filter(|g| g[1] > g[0]).collect()
    }

    /// Returns the point in the middle of the lumen at a distance along the line, mm, and the frame about it; `None` in a gap.
    pub(super) fn middle(&self, mm: f64) -> Option<Station> {
        let piece = self.pieces.iter().find(|p| {
            let [first, .., last] = &p.stations[..] else { return false };
            (first.mm..=last.mm).contains(&mm)
        })?;
        let n = piece.stations.partition_point(|s| s.mm < mm).clamp(1, piece.stations.len() - 1);
        Some(between(&piece.stations[n - 1], &piece.stations[n], mm, |s| s.mm))
    }

    /// Returns the area of the wall over the length of what is open: its mean girth, folds included, mm.
    pub fn girth_mm(&self) -> f64 {
        *self.girth_mm.get_or_init(|| {
            let area: f64 = (0..self.triangles.len()).filter(|&t| self.flat(t).is_some()).map(|t| self.area(t)).sum();
            let length: f64 = self.pieces.iter().map(|p| p.stations[p.stations.len() - 1].mm - p.stations[0].mm).sum();
            area / length.max(1.0)
        })
    }

    /// Returns the wall's area in each of `count` equal lengths of the line from `from_mm` on, mm². A triangle's area is spread evenly over
    /// its length.
    pub(super) fn areas(&self, from_mm: f64, each_mm: f64, count: usize) -> Vec<f64> {
        let sum = || Areas { from_mm, each_mm, mm2: self.summed_areas(from_mm, each_mm, count) };
        let known = self.areas.get_or_init(sum);
        let is_the_same = (known.from_mm, known.each_mm, known.mm2.len()) == (from_mm, each_mm, count);
        if is_the_same { known.mm2.clone() } else { sum().mm2 }
    }

    fn summed_areas(&self, from_mm: f64, each_mm: f64, count: usize) -> Vec<f64> {
        let mut out = vec![0.0; count];
        for (t, corners) in (0..self.triangles.len()).filter_map(|t| Some((t, self.flat(t)?))) {
            let [a, b, c] = corners.map(|c| (f64::from(c[1]) - from_mm) / each_mm);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            if high < 0.0 || low >= count as f64 {
                continue;
            }
            let area = self.area(t);
            let (first, last) = (low.floor().max(0.0) as usize, (high.max(0.0) as usize).min(count - 1));
            if first >= last {
                out[last] += area;
                continue;
            }
            for (n, out) in out.iter_mut().enumerate().take(last + 1).skip(first) {
                let within = high.min(n as f64 + 1.0) - low.max(n as f64);
                *out += area * within.max(0.0) / (high - low);
            }
        }
        out
    }

    /// Returns the number of steps of the solver, and of cells that it solved for.
    pub fn solved(&self) -> [usize; 2] {
        self.solved
    }

    /// Returns the world position of a vertex, mm.
    #[inline]
    pub(super) fn world(&self, vertex: u32) -> DVec3 {
        self.origin + self.places[vertex as usize].as_dvec3()
    }

    /// Returns the coordinates of a triangle's vertices, (angle, distance), the angles without a jump; `None` if it has none: at a tip
    /// it may enclose the line.
    pub(super) fn flat(&self, triangle: usize) -> Option<[[f32; 2]; 3]> {
        let vertices = self.triangles[triangle];
        let [a, b, c] = vertices.map(|v| self.angle[v as usize]);
        let along = vertices.map(|v| self.along[v as usize]);
        let least = along[0].min(along[1]).min(along[2]);
        let most = along[0].max(along[1]).max(along[2]);
        let turned = |from: f32, to: f32| {
            let turn = to - from;
            if turn > PI {
                turn - TAU
            } else if turn < -PI {
                turn + TAU
            } else {
                turn
            }
        };
        let (ab, bc, ca) = (turned(a, b), turned(b, c), turned(c, a));
        let encloses = (ab + bc + ca).abs() > PI;
        if along.iter().any(|a| a.is_nan()) || most - least > BRIDGE_MM || encloses {
            return None;
        }
        Some([[a, along[0]], [a + ab, along[1]], [a - ca, along[2]]])
    }

    /// Returns the area of a triangle, mm².
    pub(super) fn area(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.triangles[triangle].map(|v| self.world(v));
        0.5 * (b - a).cross(c - a).length()
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        self.places.len() * (size_of::<Vec3>() + 2 * size_of::<f32>()) + self.triangles.len() * size_of::<[u32; 3]>()
    }
}

/// Returns the station between two, at `value` of `of`.
fn between(a: &Station, b: &Station, value: f64, of: impl Fn(&Station) -> f64) -> Station {
    let length = of(b) - of(a);
    let share = if length > 0.0 { ((value - of(a)) / length).clamp(0.0, 1.0) } else { 0.5 };
    let mut frame = a.frame;
    frame.at = a.frame.at.lerp(b.frame.at, share);
    frame.tangent = a.frame.tangent.lerp(b.frame.tangent, share).normalize_or(a.frame.tangent);
    frame.normal = a.frame.normal.lerp(b.frame.normal, share).reject_from(frame.tangent).normalize_or(a.frame.normal);
    Station { mm: a.mm + (b.mm - a.mm) * share, frame, level: a.level + (b.level - a.level) * share }
}

/// Returns the distance along the line, mm, and the angle about it of a vertex of the mesh.
fn coordinates(domain: &Domain, axis: &Axis, world: DVec3) -> Option<(f32, f32)> {
    let cell = beside(domain, world)?;
    let piece = axis.pieces.iter().find(|p| p.component == domain.component(cell))?;
    let level = axis.harmonic.at(domain, cell, domain.local(world));
    let n = piece.stations.partition_point(|s| s.level < level).clamp(1, piece.stations.len() - 1);
    let station = between(&piece.stations[n - 1], &piece.stations[n], level, |s| s.level);
    let away = world - station.frame.at;
    let across = station.frame.tangent.cross(station.frame.normal);
    let angle = away.dot(across).atan2(away.dot(station.frame.normal));
    Some((station.mm as f32, angle as f32))
}

/// Returns the cell on the inner side of a vertex, which lies on an edge of the grid.
fn beside(domain: &Domain, world: DVec3) -> Option<u32> {
    let at = domain.grid().voxel(world);
    let off = (at - at.round()).abs();
    let axis = if off.x >= off.y && off.x >= off.z { 0 } else { 1 + usize::from(off.z >= off.y) };
    let mut low = at.round();
    low[axis] = at[axis].floor();
    let low = low.to_array().map(|x| x as i64);
    let mut high = low;
    high[axis] += 1;
    domain.cell(low).or_else(|| domain.cell(high))
}
