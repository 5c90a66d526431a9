//! The wall of the gas that is flown, as triangles.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::lumen::Interior;
use crate::progress::Progress;
use crate::surface::LumenMesh;
use crate::volume::Volume;

/// Side of the cells whose triangles are a patch, mm.
pub(super) const CELL_MM: f32 = 2.0;
/// A block has this many cells on each side, as a power of two.
const BLOCK_SHIFT: u32 = 2;

/// Triangles that are measured at a time. All at once would take as much memory as the wall.
const AT_ONCE: usize = 1 << 16;

/// The wall: triangles over shared vertices. Triangles are ordered by place, so that neighbours in memory are neighbours on the wall.
///
/// Triangles of one cell of 2 mm that face about the same way are a *patch*, and the patches of 4 x 4 x 4 cells a *block*: what can
/// be said of a patch or a block at once need not be asked of each of its triangles.
///
/// Centroids, normals and areas are computed where they are needed: kept, they would be three fifths of the wall. A clone shares the
/// arrays, so a flight's live coverage and its survey hold one wall.
#[derive(Clone, Debug, Default)]
pub struct Wall {
    pub(super) origin: DVec3,
    /// Vertices, mm from the origin, world directions.
    pub(super) places: Arc<Vec<Vec3>>,
    pub(super) triangles: Arc<Vec<[u32; 3]>>,
    /// The patches, and in the end the one after the last, without triangles.
    pub(super) patches: Arc<Vec<Patch>>,
    /// The blocks, in the same manner.
    pub(super) blocks: Arc<Vec<Block>>,
}

/// What is measured of a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Face {
    /// The centroid, mm from the wall's origin.
    pub centroid: Vec3,
    /// The unit normal into the gas; zero for a triangle without area.
    pub normal: Vec3,
    /// The area, mm².
    pub mm2: f32,
}

impl Face {
    /// Measures a triangle whose vertices are given in the order of its mesh, which points out of the gas.
    #[inline]
    fn of([a, b, c]: [Vec3; 3]) -> Self {
        let across = (b - a).cross(c - a);
        Self { centroid: (a + b + c) / 3.0, normal: -across.normalize_or_zero(), mm2: 0.5 * across.length() }
    }

    /// Returns the cell and the side of it that the triangle belongs to, which make its patch.
    pub(super) fn patch(&self) -> (u64, u8) {
        (interleave((self.centroid / CELL_MM).floor().as_ivec3().to_array()), side(self.normal))
    }
}

/// Triangles of a cell that face about the same way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// Its first triangle; the next patch begins after its last.
    pub first: u32,
    /// The triangle whose centroid is nearest to the middle.
    pub middle: u32,
}

/// Patches of some cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    /// Its first patch; the next block begins after its last.
    pub first: u32,
    /// The box around the centroids of its triangles, mm from the origin.
    pub low: Vec3,
    pub high: Vec3,
}

impl Wall {
    /// Extracts the wall of some segments of a lumen found in `volume`, at `iso` HU.
    ///
    /// # Errors
    /// Returns status 4 if interrupted or if there are more vertices than 32 bits can count.
    pub fn of(volume: &Volume, lumen: &Lumen, segments: &[usize], iso: f64, progress: &Progress) -> Result<Self> {
        let gas = lumen.gas_of(segments);
        let mesh = LumenMesh::new(&Interior::of_lumen(volume, &gas, iso, progress)?, progress)?;
        // What it was made of is as large as what it is sorted by.
        colvis_scan::memory::release();
        Ok(Self::of_mesh(mesh))
    }

    /// Takes the triangles of a mesh, whose normals point out of the gas.
    pub fn of_mesh(mesh: LumenMesh) -> Self {
        let (origin, places, triangles) = mesh.into_parts();
        // The cell in 60 bits, the side in three, and the triangle: no more than a triangle takes.
        let key = |(n, t): (usize, &[u32; 3])| {
            let (cell, side) = Face::of(t.map(|v| places[v as usize])).patch();
            let key = cell << 3 | u64::from(side);
            [(key >> 32) as u32, key as u32, n as u32]
        };
        let mut order: Vec<[u32; 3]> = triangles.par_iter().enumerate().map(key).collect();
        let vertices = |n: u32| triangles[n as usize];
        order.par_sort_unstable();
        // Within a patch by their vertices, so that the order of the mesh makes no difference.
        let is_patch = |a: &[u32; 3], b: &[u32; 3]| a[..2] == b[..2];
        order.par_chunk_by_mut(is_patch).for_each(|patch| patch.sort_unstable_by_key(|o| vertices(o[2])));
        let order: Vec<u32> = {
            let keyed = order;
            keyed.par_iter().map(|o| o[2]).collect()
        };
        let sorted = order.par_iter().map(|&n| vertices(n)).collect();
        drop((order, triangles));
        Self::of_sorted(origin, places, sorted)
    }

    /// Takes triangles in their order, and finds the patches and the blocks.
    pub(super) fn of_sorted(origin: DVec3, places: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        let (places, triangles) = (Arc::new(places), Arc::new(triangles));
        let mut wall = Self { origin, places, triangles, ..Self::default() };
        let (mut patches, mut blocks): (Vec<Patch>, Vec<Block>) = Default::default();
        let mut last = None;
        let (mut faces, mut n) = (Vec::new(), 0);
        for begin in (0..wall.len()).step_by(AT_ONCE) {
            let some = begin..(begin + AT_ONCE).min(wall.len());
            let measured = some.into_par_iter().map(|n| wall.face(n)).map(|face| (face.patch(), face.centroid));
            measured.collect_into_vec(&mut faces);
            for &(now, centroid) in &faces {
                let block = |cell: u64| cell >> (3 * BLOCK_SHIFT);
                if last.is_none_or(|(before, _)| block(before) != block(now.0)) {
                    blocks.push(Block { first: patches.len() as u32, low: Vec3::INFINITY, high: Vec3::NEG_INFINITY });
                }
                if last != Some(now) {
                    patches.push(Patch { first: n, middle: n });
                }
                if let Some(block) = blocks.last_mut() {
                    (block.low, block.high) = (block.low.min(centroid), block.high.max(centroid));
                }
                (last, n) = (Some(now), n + 1);
            }
        }
        drop(faces);
        let count = patches.len();
        patches.push(Patch { first: n, middle: n });
        blocks.push(Block { first: count as u32, low: Vec3::ZERO, high: Vec3::ZERO });
        let middle = |p: usize| {
            let these = patches[p].first as usize..patches[p + 1].first as usize;
            let count = these.len().max(1) as f32;
            let middle = these.clone().map(|n| wall.face(n).centroid).sum::<Vec3>() / count;
            let far = |n: &usize| wall.face(*n).centroid.distance_squared(middle);
            these.min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or_default() as u32
        };
        let middles: Vec<u32> = (0..count).into_par_iter().map(middle).collect();
        patches.iter_mut().zip(middles).for_each(|(p, middle)| p.middle = middle);
        patches.shrink_to_fit();
        blocks.shrink_to_fit();
        (wall.patches, wall.blocks) = (Arc::new(patches), Arc::new(blocks));
        wall
    }

    /// Measures a triangle.
    #[inline]
    pub(super) fn face(&self, n: usize) -> Face {
        Face::of(self.triangles[n].map(|v| self.places[v as usize]))
    }

    /// Measures the middle triangle of a patch.
    #[inline]
    pub(super) fn middle(&self, patch: usize) -> Face {
        self.face(self.patches[patch].middle as usize)
    }

    /// Returns the triangles of a patch.
    pub(super) fn triangles_of(&self, patch: usize) -> Range<usize> {
        self.patches[patch].first as usize..self.patches[patch + 1].first as usize
    }

    /// Returns the patches of a block.
    pub(super) fn patches_of(&self, block: usize) -> Range<usize> {
        self.blocks[block].first as usize..self.blocks[block + 1].first as usize
    }

    /// Returns the number of patches.
    pub(super) fn patch_count(&self) -> usize {
        self.patches.len().saturating_sub(1)
    }

    /// Returns the number of blocks.
    pub(super) fn block_count(&self) -> usize {
        self.blocks.len().saturating_sub(1)
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
        self.mm2_of(|_| true)
    }

    /// Returns the area of the triangles that `which` is true for, mm².
    pub fn mm2_of(&self, which: impl Fn(usize) -> bool) -> f64 {
        let mut sum = 0.0;
        self.each_mm2(|n, mm2| sum += if which(n) { mm2 } else { 0.0 });
        sum
    }

    /// Calls `each` with each triangle's number and area, mm², in their order; all threads measure.
    pub(super) fn each_mm2(&self, mut each: impl FnMut(usize, f64)) {
        let mut areas = Vec::new();
        for begin in (0..self.len()).step_by(AT_ONCE) {
            let some = begin..(begin + AT_ONCE).min(self.len());
            some.into_par_iter().map(|n| self.area(n)).collect_into_vec(&mut areas);
            areas.iter().zip(begin..).for_each(|(&mm2, n)| each(n, f64::from(mm2)));
        }
    }

    /// Measures the area of a triangle alone, mm².
    #[inline]
    fn area(&self, n: usize) -> f32 {
        let [a, b, c] = self.triangles[n].map(|v| self.places[v as usize]);
        0.5 * (b - a).cross(c - a).length()
    }

    /// Returns the area of a triangle, mm².
    pub fn mm2_at(&self, n: usize) -> f64 {
        f64::from(self.area(n))
    }

    /// Returns the centroid of a triangle, world, mm.
    pub fn centroid(&self, n: usize) -> DVec3 {
        self.origin + self.face(n).centroid.as_dvec3()
    }

    /// Returns the unit normal of a triangle into the gas, world; zero for one without area.
    pub fn normal(&self, n: usize) -> DVec3 {
        self.face(n).normal.as_dvec3()
    }

    /// Returns the size in memory, bytes, which clones share.
    pub fn bytes(&self) -> usize {
        size_of_val(self.places.as_slice())
            + size_of_val(self.triangles.as_slice())
            + size_of_val(self.patches.as_slice())
            + size_of_val(self.blocks.as_slice())
    }
}

/// Returns the axis and the sign of a normal's largest part, 0 to 5.
fn side(normal: Vec3) -> u8 {
    let axis = normal.abs().max_position();
    2 * axis as u8 + u8::from(normal[axis] < 0.0)
}

/// Interleaves the low 20 bits of three numbers (Morton 1966), so that what is near in space is near in the order.
fn interleave(cell: [i32; 3]) -> u64 {
    let spread = |v: i32| {
        let v = (i64::from(v) + (1 << 19)) as u64 & 0x0f_ffff;
        // Two zeros between each two bits, half as far apart in each step.
        let v = (v | v << 32) & 0x001f_0000_0000_ffff;
        let v = (v | v << 16) & 0x001f_0000_ff00_00ff;
        let v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
        let v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
        (v | v << 2) & 0x1249_2492_4924_9249
    };
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_interleaved_one_by_one() {
        let slow = |cell: [i32; 3]| {
            let v = cell.map(|v| (i64::from(v) + (1 << 19)) as u64 & 0x0f_ffff);
            (0..20).fold(0, |out, bit| (0..3).fold(out, |out, a| out | (v[a] >> bit & 1) << (3 * bit + a)))
        };
        for n in 0..2000i32 {
            let cell = [n.wrapping_mul(7919), -n * 37, n - 900].map(|v| v % (1 << 20));
            assert_eq!(interleave(cell), slow(cell), "{cell:?}");
        }
        assert!(interleave([-1, 0, 0]) < interleave([0, 0, 0]) && interleave([0; 3]) < interleave([0, 0, 1]));
    }
}
