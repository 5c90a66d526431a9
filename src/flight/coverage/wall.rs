//! The wall of the gas that is flown, as triangles.

use std::ops::Range;

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

/// The wall, a structure of arrays with an entry for each triangle. Triangles are ordered by place, so that neighbours in memory are
/// neighbours on the wall.
///
/// Triangles of one cell of 2 mm that face about the same way are a *patch*, and the patches of 4 x 4 x 4 cells a *block*: what can
/// be said of a patch or a block at once need not be asked of each of its triangles.
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
    /// The patches, and in the end the one after the last, without triangles.
    pub(super) patches: Vec<Patch>,
    /// The blocks, in the same manner.
    pub(super) blocks: Vec<Block>,
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
        Ok(Self::of_mesh(LumenMesh::new(&Interior::of_lumen(volume, &gas, iso, progress)?, progress)?))
    }

    /// Takes the triangles of a mesh, whose normals point out of the gas.
    pub fn of_mesh(mesh: LumenMesh) -> Self {
        let (origin, places, mut triangles) = mesh.into_parts();
        let measures = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| places[v as usize]);
            let across = (b - a).cross(c - a);
            ((a + b + c) / 3.0, -across.normalize_or_zero(), 0.5 * across.length())
        };
        let key = |t: &[u32; 3]| {
            let (centroid, normal, _) = measures(t);
            (interleave((centroid / CELL_MM).floor().as_ivec3().to_array()), side(normal), *t)
        };
        triangles.par_sort_by_cached_key(key);
        let (mut centroids, mut normals, mut areas) = (Vec::new(), Vec::new(), Vec::new());
        for (c, n, a) in triangles.par_iter().map(measures).collect::<Vec<_>>() {
            centroids.push(c);
            normals.push(n);
            areas.push(a);
        }
        let mut wall = Self { origin, places, triangles, centroids, normals, areas, patches: vec![], blocks: vec![] };
        wall.divide();
        wall
    }

    /// Finds the patches and the blocks.
    pub(super) fn divide(&mut self) {
        let cell = |c: &Vec3| interleave((c / CELL_MM).floor().as_ivec3().to_array());
        let keys: Vec<(u64, u8)> =
            self.centroids.par_iter().zip(&self.normals).map(|(c, &n)| (cell(c), side(n))).collect();
        let mut last = None;
        for (n, now) in keys.into_iter().enumerate() {
            let cell = now.0;
            let block = |cell: u64| cell >> (3 * BLOCK_SHIFT);
            if last.is_none_or(|(before, _)| block(before) != block(cell)) {
                let first = self.patches.len() as u32;
                self.blocks.push(Block { first, low: Vec3::INFINITY, high: Vec3::NEG_INFINITY });
            }
            if last != Some(now) {
                self.patches.push(Patch { first: n as u32, middle: n as u32 });
            }
            if let Some(block) = self.blocks.last_mut() {
                (block.low, block.high) = (block.low.min(self.centroids[n]), block.high.max(self.centroids[n]));
            }
            last = Some(now);
        }
        let (all, patches) = (self.len() as u32, self.patches.len() as u32);
        self.patches.push(Patch { first: all, middle: all });
        self.blocks.push(Block { first: patches, low: Vec3::ZERO, high: Vec3::ZERO });
        let middles: Vec<u32> = (0..patches as usize)
            .into_par_iter()
            .map(|p| {
                let these = self.triangles_of(p);
                let middle = self.centroids[these.clone()].iter().sum::<Vec3>() / these.len().max(1) as f32;
                let far = |n: &usize| self.centroids[*n].distance_squared(middle);
                these.min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or_default() as u32
            })
            .collect();
        self.patches.iter_mut().zip(middles).for_each(|(p, middle)| p.middle = middle);
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

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.places.as_slice())
            + size_of_val(self.triangles.as_slice())
            + size_of_val(self.centroids.as_slice())
            + size_of_val(self.normals.as_slice())
            + size_of_val(self.areas.as_slice())
            + size_of_val(self.patches.as_slice())
            + size_of_val(self.blocks.as_slice())
    }
}

/// Returns the axis and the sign of a normal's largest part, 0 to 5.
fn side(normal: Vec3) -> u8 {
    let axis = normal.abs().max_position();
    2 * axis as u8 + u8::from(normal[axis] < 0.0)
}

/// Interleaves the low 21 bits of three numbers (Morton 1966), so that what is near in space is near in the order.
fn interleave(cell: [i32; 3]) -> u64 {
    let spread = |v: i32| {
        let v = (i64::from(v) + (1 << 20)) as u64 & 0x1f_ffff;
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
            let v = cell.map(|v| (i64::from(v) + (1 << 20)) as u64 & 0x1f_ffff);
            (0..21).fold(0, |out, bit| (0..3).fold(out, |out, a| out | (v[a] >> bit & 1) << (3 * bit + a)))
        };
        for n in 0..2000i32 {
            let cell = [n.wrapping_mul(7919), -n * 37, n - 900].map(|v| v % (1 << 20));
            assert_eq!(interleave(cell), slow(cell), "{cell:?}");
        }
        assert!(interleave([-1, 0, 0]) < interleave([0, 0, 0]) && interleave([0; 3]) < interleave([0, 0, 1]));
    }
}
