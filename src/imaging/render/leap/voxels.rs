//! The wall's distance for every voxel: a byte each, half as much again as the 16-bit volume.

use glam::Vec3;
use rayon::prelude::*;

use crate::render::march::Ray;
use crate::render::sampler::nearest;
use crate::render::skip::Skipper;
use crate::space::PreparedVolume;
use crate::volume::AIR_HU;

use super::chessboard::{FAR, Outside, chessboard};
use super::{EmptyRadius, SLACK};

/// For each voxel the number of voxels, by chessboard moves, to the nearest one that is not empty; 255 means at least 255.
///
/// Chessboard and not Euclidean distance, because a sample depends on a box of voxels, whatever their spacing.
pub struct VoxelWalls {
    dims: [usize; 3],
    distance: Vec<u8>,
}

impl VoxelWalls {
    /// Computes the distances in `volume`, in parallel. Air is assumed outside the volume.
    pub fn new(volume: &PreparedVolume) -> Self {
        let (volume, lo) = (volume.voxels(), volume.flags().empty_up_to());
        let dims = volume.grid().dims();
        let mut distance: Vec<u8> =
            volume.data().par_iter().with_min_len(1 << 16).map(|&v| if v <= lo { FAR } else { 0 }).collect();
        let outside = if AIR_HU > lo { Outside::Marked } else { Outside::Unmarked };
        chessboard(&mut distance, dims, outside);
        Self { dims, distance }
    }

    /// Returns the distance of the voxel nearest to `q`, voxels; 0 outside the volume.
    #[inline(always)]
    fn at(&self, q: Vec3) -> u8 {
        let [i, j, k] = nearest(q).map(|c| c.wrapping_sub(1) as usize);
        let [nx, ny, nz] = self.dims;
        if i < nx && j < ny && k < nz { self.distance[i + nx * (j + ny * k)] } else { 0 }
    }

    /// Returns the memory taken, bytes.
    pub fn bytes(&self) -> usize {
        self.distance.len()
    }
}

impl EmptyRadius for VoxelWalls {
    #[inline(always)]
    fn around(&self, q: Vec3) -> f32 {
        // `q` is at most half a voxel from the voxel.
        (f32::from(self.at(q)) - 0.5).max(0.0)
    }
}

/// Leaps from sample to sample by the wall's distance at the nearest voxel.
///
/// `REACH`: a sample depends on voxels nearer than this many voxels along every axis
/// ([`Classifier::REACH`](crate::render::classify::Classifier::REACH)).
pub struct VoxelLeap<'a, const REACH: u8> {
    walls: &'a VoxelWalls,
}

impl<'a, const REACH: u8> VoxelLeap<'a, REACH> {
    /// Leaps by `walls`.
    pub fn new(walls: &'a VoxelWalls) -> Self {
        Self { walls }
    }
}

impl<const REACH: u8> Skipper for VoxelLeap<'_, REACH> {
    /// Samples for each voxel along the axis on which the ray is fastest.
    type Walk = f32;

    #[inline(always)]
    fn start(&self, ray: &Ray, _: u32) -> f32 {
        1.0 / ray.along.abs().max_element()
    }

    #[inline(always)]
    fn next(&self, per_voxel: &mut f32, ray: &Ray, mut n: u32) -> u32 {
        while n < ray.count {
            let free = self.walls.around(ray.at(n)) - f32::from(REACH) - SLACK;
            if free < 0.0 {
                return n;
            }
            // This sample and all within `free` voxels of it are empty.
            n += 1 + (free * *per_voxel).min(1e6) as u32;
        }
        n
    }
}
