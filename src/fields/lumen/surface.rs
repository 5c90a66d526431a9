//! Sample positions on the lumen's wall, for measuring how much of it was seen.

use glam::DVec3;

use super::Lumen;
use crate::math::hash;

/// Approximate number of gas voxels to examine, however many there are.
const LOOKED_AT: u64 = 1 << 20;

/// A position at the wall that represents a piece of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallPlace {
    /// Centre of a gas voxel that touches the wall, world mm.
    pub at: DVec3,
    /// Area of wall that it represents, mm².
    pub mm2: f64,
}

impl Lumen {
    /// Returns positions at the wall of the given segments. They are gas voxels with a face to anything other than gas,
    /// tagged fluid or the border of the scan. Every Nth voxel on average is used, spread evenly and deterministically.
    pub fn wall_places(&self, segments: &[usize]) -> Vec<WallPlace> {
        let wanted = |label: u32| segments.contains(&(label as usize));
        let dims = self.grid.dims().map(|n| n as i64);
        let voxels: u64 = self.gas.iter().filter(|r| wanted(r.2.label)).map(|r| u64::from(r.2.len())).sum();
        let one_in = (voxels / LOOKED_AT).max(1);
        let s = self.grid.spacing();
        let faces = [s.y * s.z, s.x * s.z, s.x * s.y];
        let mut places = Vec::new();
        for (j, k, r) in self.gas.iter().filter(|r| wanted(r.2.label)) {
            for i in r.start..r.end {
                let voxel = [i64::from(i), j as i64, k as i64];
                let number = self.grid.index(i as usize, j, k) as u64;
                if one_in > 1 && !hash::bits(0x7a11, number).is_multiple_of(one_in) {
                    continue;
                }
                let mut mm2 = 0.0;
                for axis in 0..3 {
                    for step in [-1, 1] {
                        let mut next = voxel;
                        next[axis] += step;
                        let [a, b, c] = next;
                        let scanned = (0..dims[axis]).contains(&next[axis]);
                        if scanned && self.gas.find(a, b, c).is_none() && self.fluid.find(a, b, c).is_none() {
                            mm2 += faces[axis];
                        }
                    }
                }
                if mm2 > 0.0 {
                    let at = self.grid.world(DVec3::from_array(voxel.map(|v| v as f64)));
                    places.push(WallPlace { at, mm2: mm2 * one_in as f64 });
                }
            }
        }
        places
    }
}
