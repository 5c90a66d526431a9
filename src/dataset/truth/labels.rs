//! What the wall belongs to, and the part of the colon.

use fearless_simd::Level;
use glam::{DVec3, Vec3};

use super::lattice::Lattice;
use super::places::{moved, nth};
use crate::render::Sixteen;
use crate::space::{self, PreparedVolume};

/// From this value on, HU, what lies [`BEHIND_MM`] behind the wall is tagged fluid or stool.
const TAG_HU: f32 = 200.0;
const BEHIND_MM: f64 = 1.5;

/// Returns the number of what the wall belongs to at a place of it (world, mm).
pub type Find<'a> = &'a (dyn Fn(DVec3) -> u8 + Sync);

/// The numbers of labels, as the asker knows them, and of the parts of the colon, from 1.
pub struct Labels<'a> {
    kinds: Kinds<'a>,
    /// Where each part begins along the line, mm.
    parts: Vec<f64>,
}

enum Kinds<'a> {
    /// What is found is remembered for each half voxel.
    Found(Find<'a>, Box<Lattice>),
    /// The number of tag, and that of everything else.
    Tag(&'a PreparedVolume, [u8; 2]),
}

impl<'a> Labels<'a> {
    /// Creates those of a scan's wall that `find` knows.
    pub fn found(volume: &PreparedVolume, find: Find<'a>, parts: Vec<f64>) -> Self {
        Self { kinds: Kinds::Found(find, Box::new(Lattice::new(volume.voxels().grid(), 2))), parts }
    }

    /// Creates those of a scan that tell only tagged fluid and stool, by the values behind the wall, from all other wall.
    pub fn of_tag(volume: &'a PreparedVolume, [tag, wall]: [u8; 2], parts: Vec<f64>) -> Self {
        Self { kinds: Kinds::Tag(volume, [tag, wall]), parts }
    }

    /// Returns the numbers of what is at sixteen points of the wall (world, mm, and in voxels) whose normals, into the gas, are known; and
    /// those of the parts of the colon at distances along the line, mm: 0 where that is NaN. All are 0 for points that are not numbers.
    #[inline(always)]
    pub(super) fn sixteen(&self, wall: &Wall, level: Level) -> [[u8; 2]; 16] {
        let Wall { places, voxels, normals, along } = wall;
        let mut out = [[0; 2]; 16];
        let is_place = |k: usize| !places[0][k].is_nan();
        for begin in &self.parts {
            for (out, along) in out.iter_mut().zip(along) {
                out[1] += u8::from(*begin <= *along);
            }
        }
        match &self.kinds {
            Kinds::Found(find, known) => {
                for k in (0..16).filter(|k| is_place(*k)) {
                    let place = DVec3::from_array(nth(places, k));
                    out[k][0] = known.label(place, nth(voxels, k), &mut |place| find(place).into()) as u8;
                }
            }
            Kinds::Tag(volume, [tag, wall]) => {
                let to_voxel = volume.voxels().grid().to_voxel();
                let behind = fearless_simd::dispatch!(level, _simd => moved(to_voxel, places, normals, -BEHIND_MM));
                for k in (0..16).filter(|k| is_place(*k)) {
                    let place =
                        || DVec3::from_array(nth(places, k)) - Vec3::from_array(normals[k]).as_dvec3() * BEHIND_MM;
                    let is_tag = may_reach(volume, nth(&behind, k), TAG_HU) && space::value(volume, place()) >= TAG_HU;
                    out[k][0] = if is_tag { *tag } else { *wall };
                }
            }
        }
        out
    }
}

/// Sixteen points of the wall.
pub(super) struct Wall {
    /// World, mm. Those that are not known are NaN.
    pub places: Sixteen,
    pub voxels: Sixteen,
    /// Into the gas, world.
    pub normals: [[f32; 3]; 16],
    /// Distances along the line, mm.
    pub along: [f64; 16],
}

/// True if one of the eight voxels around a place (voxels) is `least` HU or more, or there are not eight.
#[inline(always)]
fn may_reach(volume: &PreparedVolume, at: [f64; 3], least: f32) -> bool {
    let (grid, data) = (volume.voxels().grid(), volume.voxels().data());
    let [nx, ny, nz] = grid.dims();
    // What is negative or no number is below every cell.
    let is_inside = |a: usize, n: usize| at[a] >= 0.0 && at[a] < n as f64 - 1.0;
    if !(is_inside(0, nx) && is_inside(1, ny) && is_inside(2, nz)) {
        return true;
    }
    let [x, y, z] = at.map(|v| v as u32 as usize);
    let first = x + nx * (y + ny * z);
    let most = |row: usize| data.get(row..row + 2).map_or(i16::MAX, |pair| pair[0].max(pair[1]));
    let most = most(first).max(most(first + nx)).max(most(first + nx * ny)).max(most(first + nx * ny + nx));
    f32::from(most) >= least
}
