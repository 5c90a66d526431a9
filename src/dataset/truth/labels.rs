//! What the wall belongs to, and the part of the colon.

use glam::DVec3;

use super::lattice::Lattice;
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

    /// Returns the number of what is at a point of the wall (world, mm, and in voxels) whose normal, into the gas, is known; and that of the
    /// part of the colon at a distance along the line, mm: 0 if that is NaN.
    #[inline(always)]
    pub(super) fn label(&self, place: DVec3, voxel: [f64; 3], normal: [f32; 3], along: f64) -> [u8; 2] {
        let part = self.parts.iter().map(|begin| u8::from(*begin <= along)).sum();
        let kind = match &self.kinds {
            Kinds::Found(find, known) => known.label(place, voxel, &mut |place| find(place).into()) as u8,
            Kinds::Tag(volume, [tag, wall]) => {
                let behind = place - DVec3::from_array(normal.map(f64::from)) * BEHIND_MM;
                if may_reach(volume, behind, TAG_HU) && space::value(volume, behind) >= TAG_HU { *tag } else { *wall }
            }
        };
        [kind, part]
    }
}

/// True if one of the eight voxels around a place (world, mm) is `least` HU or more, or there are not eight.
#[inline(always)]
fn may_reach(volume: &PreparedVolume, place: DVec3, least: f32) -> bool {
    let (grid, data) = (volume.voxels().grid(), volume.voxels().data());
    let at = grid.voxel(place).to_array();
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
