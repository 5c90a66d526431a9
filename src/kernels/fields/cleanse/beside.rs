//! How bright tag is right beside a wall.
//!
//! Tag is layered and patchy, and denser where it clings to a wall. Its mean over some millimetres is off there by a share δ of its
//! contrast to tissue, and the wall by `σ Φ⁻¹(½ (1 + δ))` with it. The brightness of the tag itself is the grey-scale closing of the scan
//! by a box, over the fluid alone: of the largest values within reach the smallest. A closing fills what is narrower than the box,
//! which may be a wall, and leaves what is wider, which is tag of another brightness (J. Serra, *Image Analysis and Mathematical
//! Morphology*, 1982).

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::block::{Block, Bricks, Mask};
use super::{TISSUE, step};
use crate::error::Result;

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
/// Tag's own brightness is found for so many bricks at a time, along y and along z: its margin is wider than a brick.
const GROUP: usize = 3;

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

/// By how much tag is brighter than its mean, HU, by brick.
pub(super) struct Brighter(BTreeMap<usize, Vec<i16>>);

impl Brighter {
    /// Finds it in some bricks, in groups of them, given how to find it in a block that goes on this far around what is asked, voxels.
    pub(super) fn find(
        bricks: &Bricks,
        asked: &[usize],
        around: [usize; 3],
        within: impl Fn(&Block) -> Result<Vec<f32>> + Sync,
    ) -> Result<Self> {
        let mut groups: BTreeMap<[usize; 3], Vec<usize>> = BTreeMap::new();
        for &brick in asked {
            let [x, y, z] = bricks.at(brick);
            groups.entry([x, y / GROUP * GROUP, z / GROUP * GROUP]).or_default().push(brick);
        }
        let groups: Vec<_> = groups.into_iter().collect();
        let parts = groups.par_iter().map(|(at, group)| {
            let wide = bricks.blocks(*at, [1, GROUP, GROUP], around);
            let found = within(&wide)?;
            let own = |&brick: &usize| {
                let block = bricks.block(brick, [0; 3]);
                let mut values = Vec::with_capacity(block.len());
                for from in (0..block.len()).step_by(block.dims[0]) {
                    let at = wide.index(block.voxel(from));
                    values.extend(found[at..at + block.dims[0]].iter().map(|hu| hu.round() as i16));
                }
                (brick, values)
            };
            Ok(group.iter().map(own).collect::<Vec<(usize, Vec<i16>)>>())
        });
        let parts: Vec<_> = parts.collect::<Result<_>>()?;
        Ok(Self(parts.into_iter().flatten().collect()))
    }

    /// Returns it for each voxel of a block, HU; 0 where it is not known.
    pub(super) fn around(&self, bricks: &Bricks, block: &Block) -> Vec<f32> {
        let (edges, counts) = (bricks.edges(), bricks.counts());
        let mut out = vec![0f32; block.len()];
        let within = |v: i64, a: usize| (0..bricks.dims[a] as i64).contains(&v).then_some(v as usize);
        for (row, out) in out.chunks_exact_mut(block.dims[0]).enumerate() {
            let [first, y, z] = block.voxel(row * block.dims[0]);
            let Some((y, z)) = within(y, 1).zip(within(z, 2)) else { continue };
            let mut x = first.max(0) as usize;
            let end = (first + block.dims[0] as i64).clamp(0, bricks.dims[0] as i64) as usize;
            while x < end {
                let at = [x / edges[0], y / edges[1], z / edges[2]];
                let until = end.min((at[0] + 1) * edges[0]);
                if let Some(values) = self.0.get(&(at[0] + counts[0] * (at[1] + counts[1] * at[2]))) {
                    let own = bricks.blocks(at, [1; 3], [0; 3]);
                    let from = own.index([x, y, z].map(|c| c as i64));
                    let to = (x as i64 - first) as usize;
                    let to = out[to..to + until - x].iter_mut();
                    to.zip(&values[from..]).for_each(|(to, hu)| *to = f32::from(*hu));
                }
                x = until;
            }
        }
        out
    }
}
