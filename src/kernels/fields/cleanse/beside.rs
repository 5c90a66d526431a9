//! How bright tag is right beside a wall.
//!
//! Tag is layered and patchy, and denser where it clings to a wall. Its mean over some millimetres is off there by a share δ of its
//! contrast to tissue, and the wall by `σ Φ⁻¹(½ (1 + δ))` with it. The brightness of the tag itself is the grey-scale closing of the scan
//! by a box, over the fluid alone: of the largest values within reach the smallest. A closing fills what is narrower than the box,
//! which may be a wall, and leaves what is wider, which is tag of another brightness (J. Serra, *Image Analysis and Mathematical
//! Morphology*, 1982).

use super::block::{Block, Mask};
use super::{TISSUE, step};

/// Half a side of the box, σ of the scan's blur and mm: twice it is wider than what a thin wall darkens.
const BOX: f64 = 2.5;
const BOX_MM: f64 = 1.2;
/// Standard deviation of the blur of the scan before, and of the result after, mm.
const BEFORE_MM: f64 = 0.35;
const AFTER_MM: f64 = 0.6;
/// A difference below the first may be noise alone, HU; above the second it counts in full.
const NOISE_HU: [f32; 2] = [15.0, 40.0];
/// Tag may be darker than usual by at most this share of its contrast to tissue: what is darker is other bowel that touches the fluid.
const DARKER: f32 = 0.4;

/// Finds the brightness of tag beside walls.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beside {
    /// Half a side of the box, voxels.
    half: [usize; 3],
    spacing: [f64; 3],
}

impl Beside {
    /// For a scan with this blur, mm.
    pub(super) fn new(blur_mm: f64, spacing: [f64; 3]) -> Self {
        let half = spacing.map(|h| ((BOX * blur_mm).max(BOX_MM) / h).round().clamp(1.0, 3.0) as usize);
        Self { half, spacing }
    }

    /// Returns how far around a voxel values matter, voxels.
    pub(super) fn reach(&self) -> [usize; 3] {
        [0, 1, 2].map(|a| {
            let blurs = [BEFORE_MM, AFTER_MM].map(|mm| (3.0 * mm / self.spacing[a]).ceil() as usize);
            2 * self.half[a] + blurs[0] + blurs[1]
        })
    }

    /// Returns the values of a block with less noise.
    pub(super) fn smooth(&self, block: &Block, mut hu: Vec<f32>) -> Vec<f32> {
        block.blur(&mut hu, self.spacing.map(|h| BEFORE_MM / h));
        hu
    }

    /// Returns by how much tag is brighter around each voxel of a block than `usual`, HU, given the fluid, and of it what is deep enough
    /// to be without gas. Only around `pure` voxels, which hold nothing but tag, it may be darker.
    pub(super) fn brighter(
        &self,
        block: &Block,
        hu: &[f32],
        usual: &[f32],
        [fluid, deep, pure]: [&Mask; 3],
    ) -> Vec<f32> {
        let among = |mask: &Mask, values: &[f32], other: f32| -> Vec<f32> {
            let mut out = vec![other; values.len()];
            mask.each(|n| out[n] = values[n]);
            out
        };
        let mut most = among(fluid, hu, f32::NEG_INFINITY);
        block.spread(&mut most, self.half, |a, b| if a > b { a } else { b });
        let mut around = among(deep, &most, f32::INFINITY);
        block.spread(&mut around, self.half, |a, b| if a < b { a } else { b });
        let sure = pure.dilated(self.half);
        let mut out: Vec<f32> = (around.iter().zip(usual).enumerate())
            .map(|(n, (&around, &usual))| match around - usual {
                f32::INFINITY => 0.0,
                more if sure.has(n) => more.max(-DARKER * (usual - TISSUE)),
                more => more.max(0.0),
            })
            .collect();
        out.iter_mut().for_each(|hu| *hu *= step(NOISE_HU[0], NOISE_HU[1], hu.abs()));
        block.blur(&mut out, self.spacing.map(|h| AFTER_MM / h));
        out
    }
}
