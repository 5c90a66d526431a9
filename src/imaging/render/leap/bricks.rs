//! The wall's distance for every brick of 8×8×8 cells: a byte each, 1/1024 of the 16-bit volume.

use glam::Vec3;

use crate::render::march::Ray;
use crate::render::skip::{Skipper, is_empty_voxel};
use crate::space::PreparedVolume;

use super::chessboard::{FAR, Outside, chessboard};
use super::{EDGE, EmptyRadius};

/// For each brick the number of bricks, by chessboard moves, to the nearest one in which something may be visible; 0 there.
pub struct BrickWalls {
    bricks: [usize; 3],
    distance: Vec<u8>,
}

impl BrickWalls {
    /// Computes the distances between the bricks of `volume`'s flags.
    ///
    /// Air is assumed outside them: where air is not empty, no brick at the border is empty either.
    pub fn new(volume: &PreparedVolume) -> Self {
        let flags = volume.flags();
        let bricks = flags.bricks();
        let count: usize = bricks.iter().product();
        let mut distance: Vec<u8> = (0..count).map(|n| if flags.empty_brick(n as isize) { FAR } else { 0 }).collect();
        chessboard(&mut distance, bricks, Outside::Unmarked);
        Self { bricks, distance }
    }

    /// Returns the distance of the brick that contains `q`, bricks, and the brick's first corner; 0 outside the volume.
    #[inline(always)]
    fn at(&self, q: Vec3) -> (u8, Vec3) {
        let b = (q / EDGE).to_array().map(|c| c as usize);
        let [nx, ny, nz] = self.bricks;
        let inside = q.cmpge(Vec3::ZERO).all() && b[0] < nx && b[1] < ny && b[2] < nz;
        let distance = if inside { self.distance[b[0] + nx * (b[1] + ny * b[2])] } else { 0 };
        (distance, Vec3::new(b[0] as f32, b[1] as f32, b[2] as f32) * EDGE)
    }

    /// Returns the memory taken, bytes.
    pub fn bytes(&self) -> usize {
        self.distance.len()
    }
}

impl EmptyRadius for BrickWalls {
    #[inline(always)]
    fn around(&self, q: Vec3) -> f32 {
        let (distance, corner) = self.at(q);
        if distance == 0 {
            return 0.0;
        }
        // Nothing is visible within the box of empty bricks around this one, and two voxels beyond it.
        let inner = (q - corner).min(corner + EDGE - q).min_element().max(0.0);
        EDGE * f32::from(distance - 1) + inner + 2.0
    }
}

/// Leaps from box to box of empty bricks; with `VOXELS` also over single voxels flagged as empty, like
/// [`Leap`](crate::render::skip::Leap).
pub struct BrickLeap<'a, const VOXELS: bool> {
    volume: &'a PreparedVolume,
    walls: &'a BrickWalls,
}

impl<'a, const VOXELS: bool> BrickLeap<'a, VOXELS> {
    /// Leaps by `walls`, which must be those of `volume`.
    pub fn new(volume: &'a PreparedVolume, walls: &'a BrickWalls) -> Self {
        Self { volume, walls }
    }
}

/// Returns the number of samples before the ray leaves the box from `low` to `high` (grown voxel coordinates).
#[inline(always)]
fn leaves(ray: &Ray, low: Vec3, high: Vec3) -> f32 {
    let ahead = Vec3::select(ray.inverse.cmpge(Vec3::ZERO), high, low);
    (ahead * ray.inverse + ray.offset).min_element()
}

impl<const VOXELS: bool> Skipper for BrickLeap<'_, VOXELS> {
    /// Samples before this one may be visible.
    type Walk = u32;

    #[inline(always)]
    fn start(&self, _: &Ray, _: u32) -> u32 {
        0
    }

    #[inline(always)]
    fn next(&self, seen_until: &mut u32, ray: &Ray, mut n: u32) -> u32 {
        while n < ray.count {
            let q = ray.at(n);
            if n >= *seen_until {
                let (distance, corner) = self.walls.at(q);
                if distance == 0 {
                    // At least this sample; a few more in the next brick do no harm.
                    let end = leaves(ray, corner, corner + EDGE);
                    *seen_until = (end.clamp(0.0, 4e9) as u32).max(n) + 1;
                } else {
                    let margin = EDGE * f32::from(distance - 1);
                    let end = leaves(ray, corner - margin, corner + EDGE + margin);
                    // Not the last one before the plane: with rounding it might be beyond it.
                    let slack = 0.01 + end * 1e-6;
                    n = ((end - slack).clamp(0.0, 4e9) as u32).max(n) + 1;
                    continue;
                }
            }
            if !VOXELS || !is_empty_voxel(self.volume, q) {
                return n;
            }
            n += ray.near;
        }
        n
    }
}
