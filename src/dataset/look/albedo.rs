//! The colour of the wall, fixed to it: mucosa, its vessels, and residue that a tag shows.

use glam::{Affine3A, Vec2, Vec3};

use super::noise::Noise;
use super::vessels::Vessels;
use crate::math::hash;
use crate::space::{self, PreparedVolume};

/// How much the mucosa's colour varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Mucosa {
    /// Not at all.
    Off,
    /// As in a healthy colon.
    Mild,
    /// As where it is inflamed.
    Strong,
}

impl Mucosa {
    /// Returns that of this name.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "off" => Some(Self::Off),
            "mild" => Some(Self::Mild),
            "strong" => Some(Self::Strong),
            _ => None,
        }
    }
}

/// The mucosa's mean colour, linear red, green and blue.
pub const BASE: [f32; 3] = [0.66, 0.22, 0.145];
/// Where much blood lies under it.
const RED: Vec3 = Vec3::new(0.58, 0.115, 0.085);
/// A vessel.
const BLOOD: Vec3 = Vec3::new(0.30, 0.045, 0.04);
/// Tagged fluid and stool.
const RESIDUE: Vec3 = Vec3::new(0.50, 0.33, 0.09);
/// Residue is what reaches the first value, HU, this far behind the wall; from the second on it hides the mucosa.
const RESIDUE_HU: [f32; 2] = [150.0, 250.0];
const BEHIND_MM: f32 = 1.5;

/// Distance over which patches of colour change, mm.
const PATCHES_MM: f32 = 14.0;
/// Vessels are drawn on the planes that a normal has more of than this.
const LEAST: f32 = 0.5;

/// The colour of every point of the wall.
#[derive(Debug)]
pub(super) struct Albedo {
    noise: Noise,
    vessels: Vessels,
    /// How much the brightness varies, how red patches are, and how dark vessels are.
    strength: [f32; 3],
    is_on: bool,
}

impl Albedo {
    /// Creates that of a seed.
    pub(super) fn new(mucosa: Mucosa, seed: u64) -> Self {
        let strength = match mucosa {
            Mucosa::Off => [0.0; 3],
            Mucosa::Mild => [0.10, 0.35, 0.65],
            Mucosa::Strong => [0.18, 0.9, 0.95],
        };
        Self {
            noise: Noise::new(hash::bits(seed, 0xC0104)),
            vessels: Vessels::new(seed),
            strength,
            is_on: mucosa != Mucosa::Off,
        }
    }

    /// Returns the share of linear red, green and blue light that the wall scatters at a point (world, mm) with a normal.
    #[inline(always)]
    pub(super) fn of(&self, place: Vec3, normal: Vec3) -> Vec3 {
        let base = Vec3::from_array(BASE);
        if !self.is_on {
            return base;
        }
        let [light, red, dark] = self.strength;
        let coarse = self.noise.at(place * (1.0 / PATCHES_MM));
        let [blood, fine] = self.near(place, normal).to_array();
        let fine = 2.0 * fine - 1.0;
        let redness = red * (0.25 + coarse.y + 0.5 * fine).clamp(0.0, 1.0);
        let brightness = 1.0 + light * (coarse.x + 0.5 * fine);
        // Vessels come and go: they lie at different depths.
        let shown = dark * (0.8 + 0.7 * coarse.z).clamp(0.2, 1.0);
        (base.lerp(RED, redness) * brightness).lerp(BLOOD, shown * blood)
    }

    /// Returns how much blood lies under a point, and how the colour varies near it: that of the tile on the three planes, by how much each
    /// faces the point.
    #[inline(always)]
    fn near(&self, place: Vec3, normal: Vec3) -> Vec2 {
        let share = (normal.abs() - LEAST).max(Vec3::ZERO);
        let share = share * share;
        let [x, y, z] = place.to_array();
        let mut near = Vec2::ZERO;
        // Different parts of the tile, so that no plane mirrors another.
        if share.x > 0.0 {
            near += share.x * self.vessels.at(Vec2::new(y + 17.3, z));
        }
        if share.y > 0.0 {
            near += share.y * self.vessels.at(Vec2::new(z + 5.9, x + 31.7));
        }
        if share.z > 0.0 {
            near += share.z * self.vessels.at(Vec2::new(y + 40.1, x + 11.3));
        }
        near / share.element_sum().max(1e-6)
    }

    /// Returns how a normal is turned at a point by the bumps of the mucus on the wall.
    #[inline(always)]
    pub(super) fn bumps(&self, place: Vec3) -> Vec3 {
        let coarse = self.noise.at(place * (1.0 / 3.1) + 7.7);
        let fine = self.noise.at(place * (1.0 / 0.6) + 3.1);
        coarse.truncate() * 0.15 + fine.truncate() * 0.05
    }
}

/// Tagged fluid and stool behind the wall of a scan.
pub(super) struct Residue<'a> {
    volume: &'a PreparedVolume,
    data: &'a [i16],
    dims: [usize; 3],
    to_voxel: Affine3A,
}

impl<'a> Residue<'a> {
    pub(super) fn new(volume: &'a PreparedVolume) -> Self {
        let (voxels, grid) = (volume.voxels(), volume.voxels().grid());
        Self { volume, data: voxels.data(), dims: grid.dims(), to_voxel: grid.to_voxel().as_affine3a() }
    }

    /// Returns the colour with that of residue, if a tag shows some behind a point of the wall (world, mm).
    #[inline(always)]
    pub(super) fn over(&self, colour: Vec3, place: Vec3, normal: Vec3) -> Vec3 {
        let behind = place - normal * BEHIND_MM;
        // The nearest voxel tells that most places have none, in a fraction of the time.
        let [i, j, k] = (self.to_voxel.transform_point3(behind) + 0.5).to_array().map(|x| x as i32 as usize);
        let [nx, ny, nz] = self.dims;
        let is_inside = i < nx && j < ny && k < nz;
        if !is_inside || f32::from(self.data[i + nx * (j + ny * k)]) < 0.5 * RESIDUE_HU[0] {
            return colour;
        }
        let [from, to] = RESIDUE_HU;
        let share = ((space::value(self.volume, behind.as_dvec3()) - from) / (to - from)).clamp(0.0, 1.0);
        colour.lerp(RESIDUE, 0.9 * share)
    }
}
