//! The colour of the wall, fixed to it: mucosa, its vessels, and residue that a tag shows.

use glam::{Affine3A, Vec3};

use super::lanes::{LANES, Lanes};
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
const RED: [f32; 3] = [0.58, 0.115, 0.085];
/// A vessel.
const BLOOD: [f32; 3] = [0.30, 0.045, 0.04];
/// Tagged fluid and stool.
const RESIDUE: [f32; 3] = [0.50, 0.33, 0.09];
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

    /// Returns the share of linear red, green and blue light that the wall scatters at sixteen points (world, mm) with normals.
    #[inline(always)]
    pub(super) fn sixteen(&self, place: &[Lanes; 3], normal: &[Lanes; 3]) -> [Lanes; 3] {
        let mut out = BASE.map(|base| [base; LANES]);
        if !self.is_on {
            return out;
        }
        let [light, red, dark] = self.strength;
        let coarse = self.noise.sixteen(&place.map(|axis| axis.map(|x| x * (1.0 / PATCHES_MM))));
        let [blood, fine] = self.near(place, normal);
        for k in 0..LANES {
            let fine = 2.0 * fine[k] - 1.0;
            let redness = red * (0.25 + coarse[1][k] + 0.5 * fine).clamp(0.0, 1.0);
            let brightness = 1.0 + light * (coarse[0][k] + 0.5 * fine);
            // Vessels come and go: they lie at different depths.
            let shown = dark * (0.8 + 0.7 * coarse[2][k]).clamp(0.2, 1.0) * blood[k];
            for c in 0..3 {
                let mucosa = (BASE[c] + (RED[c] - BASE[c]) * redness) * brightness;
                out[c][k] = mucosa + (BLOOD[c] - mucosa) * shown;
            }
        }
        out
    }

    /// Returns how much blood lies under points, and how the colour varies near them: that of the tile on the three planes, by how much
    /// each faces the point.
    #[inline(always)]
    fn near(&self, place: &[Lanes; 3], normal: &[Lanes; 3]) -> [Lanes; 2] {
        let mut near = [[0.0; LANES]; 2];
        let mut sum = [1e-6; LANES];
        // Different parts of the tile, so that no plane mirrors another.
        for (across, [u, v], by) in [(0, [1, 2], [17.3, 0.0]), (1, [2, 0], [5.9, 31.7]), (2, [1, 0], [40.1, 11.3])] {
            let mut share = [0.0; LANES];
            for k in 0..LANES {
                let own = (normal[across][k].abs() - LEAST).max(0.0);
                share[k] = own * own;
                sum[k] += share[k];
            }
            let at = [place[u].map(|x| x + by[0]), place[v].map(|x| x + by[1])];
            self.vessels.add(&at, &share, &mut near);
        }
        for k in 0..LANES {
            (near[0][k], near[1][k]) = (near[0][k] / sum[k], near[1][k] / sum[k]);
        }
        near
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

    /// Covers the colours of sixteen points of the wall (world, mm) with that of residue where a tag shows some behind them.
    #[inline(always)]
    pub(super) fn over(&self, colours: &mut [Lanes; 3], place: &[Lanes; 3], normal: &[Lanes; 3]) {
        let [nx, ny, nz] = self.dims;
        let columns = self.to_voxel.matrix3.to_cols_array_2d();
        let from = self.to_voxel.translation.to_array();
        let mut cell = [[0; LANES]; 3];
        for k in 0..LANES {
            let behind = |a: usize| place[a][k] - normal[a][k] * BEHIND_MM;
            let [x, y, z] = [behind(0), behind(1), behind(2)];
            for a in 0..3 {
                let at = columns[0][a] * x + columns[1][a] * y + columns[2][a] * z + from[a] + 0.5;
                cell[a][k] = at as i32;
            }
        }
        for k in 0..LANES {
            // The nearest voxel tells that most places have none, in a fraction of the time.
            let [x, y, z] = [cell[0][k] as usize, cell[1][k] as usize, cell[2][k] as usize];
            let is_inside = x < nx && y < ny && z < nz;
            if !is_inside || f32::from(self.data[x + nx * (y + ny * z)]) < 0.5 * RESIDUE_HU[0] {
                continue;
            }
            let [from, to] = RESIDUE_HU;
            let at = |all: &[Lanes; 3]| Vec3::new(all[0][k], all[1][k], all[2][k]);
            let behind = at(place) - at(normal) * BEHIND_MM;
            let share = ((space::value(self.volume, behind.as_dvec3()) - from) / (to - from)).clamp(0.0, 1.0);
            for c in 0..3 {
                colours[c][k] += (RESIDUE[c] - colours[c][k]) * (0.9 * share);
            }
        }
    }
}
