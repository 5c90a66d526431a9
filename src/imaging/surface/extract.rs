//! Marching cubes over a volume.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::cases;
use super::mesh::{Block, Mesh, Normal};
use super::signs::{Numbers, Signs};
use crate::error::{Error, Result};
use crate::fields::voxels::each_bit;
use crate::render::regression::to_world;
use crate::render::sampler::{Sampler, Trilinear};
use crate::space::PreparedVolume;
use crate::volume::{Grid, Volume};

/// Rows of blocks made at a time. All at once would be in memory twice.
const ROWS: usize = 1024;
/// Cells along a block's edge. It must divide 64.
const BLOCK: usize = 4;

impl Mesh {
    /// Extracts the wall of `volume` by marching cubes on all of rayon's threads. The result is the same for every
    /// number of threads.
    ///
    /// # Errors
    /// Returns status 4 if there are more vertices than 32 bits can count.
    pub fn new(volume: &PreparedVolume) -> Result<Self> {
        let (voxels, iso) = (volume.voxels(), volume.transfer().iso());
        let signs = Signs::new(voxels, iso);
        let numbers = Numbers::new(&signs);
        check_count(&numbers)?;
        let (places, normals) = vertices(volume, &signs, &numbers);
        let above = |v| value(voxels, v) - iso;
        let (triangles, blocks) = triangles(voxels.grid(), above, &signs, &numbers, Some(&places));
        Ok(Self { origin: voxels.grid().origin(), places, normals, triangles, blocks })
    }
}

/// Checks that all triangles can be numbered. Fails with status 4 if there are too many.
pub(super) fn check_count(numbers: &Numbers) -> Result<()> {
    // There are about two triangles per vertex, five at the most.
    if numbers.total() > u64::from(u32::MAX / 5) {
        let why = format!("its wall has {} vertices, more than 32 bits can count", numbers.total());
        return Err(Error::incomplete("surface", why, "resample the scan"));
    }
    Ok(())
}

/// Calls `visit(from, axis)` for every crossed edge from a grown voxel of plane `z`, in the order of the vertices.
pub(super) fn each_crossed(signs: &Signs, z: usize, mut visit: impl FnMut([usize; 3], usize)) {
    for y in 0..signs.dims[1] {
        for axis in 0..3 {
            for w in 0..signs.words() {
                each_bit(signs.crossed(axis, y, z, w), |bit| visit([64 * w + bit, y, z], axis));
            }
        }
    }
}

/// Returns the value of a grown voxel, HU.
fn value(voxels: &Volume, [x, y, z]: [usize; 3]) -> f64 {
    f64::from(voxels.get(x as i64 - 1, y as i64 - 1, z as i64 - 1))
}

/// Computes a vertex for each crossed edge: the point where the value, linear between the two voxels, equals the wall's.
fn vertices(volume: &PreparedVolume, signs: &Signs, numbers: &Numbers) -> (Vec<Vec3>, Vec<Normal>) {
    let (voxels, iso) = (volume.voxels(), volume.transfer().iso());
    let total = numbers.total() as usize;
    let mut places = vec![Vec3::ZERO; total];
    let mut normals = vec![Normal::NONE; total];
    let sampler = Trilinear::new(volume);
    let turn = to_world(voxels);
    let mut planes = Vec::with_capacity(signs.dims[2]);
    let (mut rest, mut rest_normals) = (&mut places[..], &mut normals[..]);
    for z in 0..signs.dims[2] {
        let n = numbers.before_plane(signs, z + 1) - numbers.before_plane(signs, z);
        let (plane, after) = rest.split_at_mut(n);
        let (plane_normals, after_normals) = rest_normals.split_at_mut(n);
        planes.push((z, plane, plane_normals));
        (rest, rest_normals) = (after, after_normals);
    }
    planes.into_par_iter().for_each(|(z, places, normals)| {
        let mut out = places.iter_mut().zip(normals);
        each_crossed(signs, z, |from, axis| {
            let mut to = from;
            to[axis] += 1;
            let (a, b) = (value(voxels, from), value(voxels, to));
            let mut q = DVec3::from_array(from.map(|c| c as f64));
            q[axis] += (iso - a) / (b - a);
            if let Some((place, normal)) = out.next() {
                *place = voxels.grid().to_world().transform_vector3(q - 1.0).as_vec3();
                *normal = Normal::new(turn * sampler.fit(q.as_vec3()).gradient);
            }
        });
    });
    (places, normals)
}

/// Computes the triangles, block by block, and with `places` of the vertices the balls around the blocks. `above` is the difference between a grown voxel and the wall; it is more
/// than 0 exactly where the voxel is solid, or 0.
pub(super) fn triangles(
    grid: &Grid,
    above: impl Fn([usize; 3]) -> f64 + Sync,
    signs: &Signs,
    numbers: &Numbers,
    places: Option<&[Vec3]>,
) -> (Vec<[u32; 3]>, Vec<Block>) {
    let cells = signs.dims.map(|n| n - 1);
    let blocks = cells.map(|n| n.div_ceil(BLOCK));
    // A mirrored grid reverses every triangle.
    let mirrored = grid.direction().determinant() < 0.0;
    let row = |row: usize| {
        let first = [0, row % blocks[1] * BLOCK, row / blocks[1] * BLOCK];
        let (mut triangles, mut found): (Vec<[u32; 3]>, Vec<Block>) = Default::default();
        for bx in 0..blocks[0] {
            let begun = triangles.len();
            let corner = [bx * BLOCK, first[1], first[2]];
            block(&above, signs, numbers, corner, mirrored, &mut triangles);
            if let Some(places) = places.filter(|_| triangles.len() > begun) {
                let (centre, radius) = ball(&triangles[begun..], places);
                let count = (triangles.len() - begun) as u32;
                found.push(Block { centre, radius, first: begun as u32, count });
            }
        }
        (triangles, found)
    };
    let (mut all, mut all_blocks): (Vec<[u32; 3]>, Vec<Block>) = Default::default();
    let count = blocks[1] * blocks[2];
    for some in (0..count).step_by(ROWS) {
        let rows: Vec<_> = (some..(some + ROWS).min(count)).into_par_iter().map(row).collect();
        for (triangles, blocks) in rows {
            let before = all.len() as u32;
            all.extend(triangles);
            all_blocks.extend(blocks.into_iter().map(|b| Block { first: b.first + before, ..b }));
        }
    }
    all.shrink_to_fit();
    all_blocks.shrink_to_fit();
    (all, all_blocks)
}

/// Computes the triangles of the block of cells from `first` on.
fn block(
    above: &impl Fn([usize; 3]) -> f64,
    signs: &Signs,
    numbers: &Numbers,
    first: [usize; 3],
    mirrored: bool,
    out: &mut Vec<[u32; 3]>,
) {
    let end = |a: usize| (first[a] + BLOCK).min(signs.dims[a] - 1);
    for z in first[2]..end(2) {
        for y in first[1]..end(1) {
            let mixed = signs.mixed(y, z, first[0] / 64) >> (first[0] % 64) & ((1 << BLOCK) - 1);
            for x in (0..BLOCK).filter(|x| mixed >> x & 1 == 1).map(|x| first[0] + x) {
                let solid = signs.corners(x, y, z);
                let ambiguous = cases::ambiguous_faces(solid);
                let mut joined = 0;
                if ambiguous != 0 {
                    let corner = |c: usize| [x + (c & 1), y + (c >> 1 & 1), z + (c >> 2)];
                    let above = std::array::from_fn(|c| above(corner(c)));
                    for face in (0..6).filter(|f| ambiguous >> f & 1 == 1) {
                        joined |= u8::from(cases::is_joined(face, &above)) << face;
                    }
                }
                for &edges in cases::triangles(solid, joined) {
                    let [a, b, c] = edges.map(|e| {
                        let (axis, low) = cases::place(e);
                        numbers.of(signs, axis, [x + low[0], y + low[1], z + low[2]])
                    });
                    out.push(if mirrored { [a, c, b] } else { [a, b, c] });
                }
            }
        }
    }
}

/// Returns the centre and radius of a ball around triangles.
fn ball(triangles: &[[u32; 3]], places: &[Vec3]) -> (Vec3, f32) {
    let all = || triangles.as_flattened().iter().map(|&v| places[v as usize]);
    let (low, high) =
        all().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p: Vec3| (low.min(p), high.max(p)));
    let centre = 0.5 * (low + high);
    let square = all().map(|p| p.distance_squared(centre)).fold(0.0, f32::max);
    // A little larger, to allow for rounding.
    (centre, square.sqrt() * 1.0001 + 1e-6)
}
