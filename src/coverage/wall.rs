//! The wall of the gas that is flown, as triangles that are seen or not.

use std::path::Path;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::sight::Sight;
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::lumen::Interior;
use crate::output;
use crate::progress::Progress;
use crate::surface::{LumenMesh, is_far, write_ply};
use crate::volume::Volume;

/// Side of the cells by which triangles are ordered, mm: those of one cell see about the same views.
const CELL_MM: f32 = 6.0;

/// The wall, a structure of arrays with an entry for each triangle. Triangles are ordered by place, so that neighbours in memory are
/// neighbours on the wall.
#[derive(Clone, Debug, Default)]
pub struct Wall {
    pub(super) origin: DVec3,
    /// Vertices, mm from the origin, world directions.
    pub(super) places: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Centroids, mm from the origin.
    pub(super) centroids: Vec<Vec3>,
    /// Unit normals into the gas; zero for a triangle without area.
    pub(super) normals: Vec<Vec3>,
    /// Areas, mm².
    pub(super) areas: Vec<f32>,
}

impl Wall {
    /// Extracts the wall of some segments of a lumen found in `volume`, at `iso` HU.
    ///
    /// # Errors
    /// Returns status 4 if interrupted or if there are more vertices than 32 bits can count.
    pub fn of(volume: &Volume, lumen: &Lumen, segments: &[usize], iso: f64, progress: &Progress) -> Result<Self> {
        let gas = lumen.gas_of(segments);
        Ok(Self::of_mesh(LumenMesh::new(&Interior::of_lumen(volume, &gas, iso, progress)?, progress)?))
    }

    /// Takes the triangles of a mesh, whose normals point out of the gas.
    pub fn of_mesh(mesh: LumenMesh) -> Self {
        let (origin, places, mut triangles) = mesh.into_parts();
        let centroid = |t: &[u32; 3]| t.iter().map(|&v| places[v as usize]).sum::<Vec3>() / 3.0;
        let key = |t: &[u32; 3]| {
            let c = (centroid(t) / CELL_MM).floor().as_ivec3();
            (interleave(c.to_array()), *t)
        };
        triangles.par_sort_by_cached_key(key);
        let measures = triangles.par_iter().map(|t| {
            let [a, b, c] = t.map(|v| places[v as usize]);
            let across = (b - a).cross(c - a);
            (centroid(t), -across.normalize_or_zero(), 0.5 * across.length())
        });
        let (mut centroids, mut normals, mut areas) = (Vec::new(), Vec::new(), Vec::new());
        for (c, n, a) in measures.collect::<Vec<_>>() {
            centroids.push(c);
            normals.push(n);
            areas.push(a);
        }
        Self { origin, places, triangles, centroids, normals, areas }
    }

    /// Returns the number of triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// True without triangles.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Returns the area, mm².
    pub fn mm2(&self) -> f64 {
        self.areas.iter().map(|&a| f64::from(a)).sum()
    }

    /// Returns the area of the triangles that `which` is true for, mm².
    pub fn mm2_of(&self, which: impl Fn(usize) -> bool) -> f64 {
        self.areas.iter().enumerate().filter(|(n, _)| which(*n)).map(|(_, &a)| f64::from(a)).sum()
    }

    /// Returns the centroid of a triangle, world, mm.
    pub fn centroid(&self, n: usize) -> DVec3 {
        self.origin + self.centroids[n].as_dvec3()
    }

    /// Returns the unit normal of a triangle into the gas, world; zero for one without area.
    pub fn normal(&self, n: usize) -> DVec3 {
        self.normals[n].as_dvec3()
    }

    /// Writes the wall as PLY, with the number of views that see it (`seen`) on each face. Nothing is written in part.
    ///
    /// # Errors
    /// Returns status 5 if the file cannot be written.
    pub fn save(&self, path: &Path, sights: &[Sight]) -> Result<()> {
        let about = "the wall that was flown along, mm LPS; seen: number of places from which a face was seen";
        let far = is_far(self.origin, &self.places);
        let (mesh, seen) = ((self.origin, &self.places[..], &self.triangles[..]), |n: usize| sights[n].ahead);
        output::write_whole(path, |w| write_ply(w, mesh, about, far, Some(("seen", &seen)), &Progress::new()))
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.places.as_slice())
            + size_of_val(self.triangles.as_slice())
            + size_of_val(self.centroids.as_slice())
            + size_of_val(self.normals.as_slice())
            + size_of_val(self.areas.as_slice())
    }
}

/// Interleaves the low 21 bits of three numbers (Morton 1966), so that what is near in space is near in the order.
fn interleave(cell: [i32; 3]) -> u64 {
    let spread = |v: i32| {
        let v = (i64::from(v) + (1 << 20)) as u64 & 0x1f_ffff;
        (0..21).fold(0, |out, bit| out | (v >> bit & 1) << (3 * bit))
    };
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}
