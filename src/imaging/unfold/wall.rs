//! The exact place of the wall beside a point of the mesh, and its normal there.

use glam::{DVec3, Mat3, Vec3};

use super::chart::Chart;
use super::raster::Hit;
use crate::render::regression::{Regression, Weighting, block, to_world};
use crate::render::sampler::{split, trilinear};
use crate::volume::Volume;

/// The mesh is at most this far from the wall, in shares of the least spacing.
const OFF: f32 = 0.75;
/// Steps of the root finder.
const STEPS: usize = 3;
/// Values this close to the wall's are the wall, HU.
const CLOSE_HU: f32 = 2.0;

/// Moves points of the mesh onto the wall that rays see: where the trilinear value is that of the wall.
pub(super) struct Refiner<'a> {
    volume: &'a Volume,
    iso: f32,
    regression: Regression,
    turn: Mat3,
    reach: f32,
}

impl<'a> Refiner<'a> {
    pub(super) fn new(volume: &'a Volume, iso: f64) -> Self {
        let spacing = volume.grid().spacing();
        let regression = Regression::new(spacing, Weighting::InverseSquare);
        let reach = OFF * spacing.min_element() as f32;
        Self { volume, iso: iso as f32, regression, turn: to_world(volume), reach }
    }

    /// Returns the wall's point of a hit and its normal into the tissue, world. Where the values show no wall (at tagged fluid, at a
    /// septum), they are those of the mesh.
    pub(super) fn refined(&self, chart: &Chart, hit: &Hit) -> (Vec3, Vec3) {
        let corners = chart.triangles[hit.triangle as usize].map(|v| chart.places[v as usize]);
        let own = corners[0] * hit.shares[0] + corners[1] * hit.shares[1] + corners[2] * hit.shares[2];
        let face = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let at: DVec3 = chart.origin + own.as_dvec3();
        let grid = self.volume.grid();
        let q = grid.voxel(at).as_vec3() + 1.0;
        let (cell, t) = split(q);
        let gradient = self.turn * self.regression.fit(&block(self.volume, cell.map(|c| c - 2)), t).gradient;
        let steep = gradient.length();
        let normal = gradient / steep.max(f32::MIN_POSITIVE);
        // Tag is brighter than the wall.
        if normal.dot(face) <= 0.0 {
            return (at.as_vec3(), face);
        }
        let along = grid.to_voxel().matrix3.as_mat3() * normal;
        let value = |mm: f32| trilinear(self.volume, q + along * mm) - self.iso;
        let (mut mm, mut off) = (0.0, value(0.0));
        let mut slope = steep;
        let start = off.abs();
        for _ in 0..STEPS {
            // The last two places may be one.
            if off.abs() < CLOSE_HU || slope.is_nan() || slope < 1e-3 {
                break;
            }
            let next = (mm - off / slope).clamp(-self.reach, self.reach);
            let there = value(next);
            slope = (there - off) / (next - mm);
            (mm, off) = (next, there);
        }
        if off.abs() > start {
            return (at.as_vec3(), normal);
        }
        ((at + normal.as_dvec3() * f64::from(mm)).as_vec3(), normal)
    }
}
