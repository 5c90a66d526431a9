//! Caps: parts of the wall that bulge into the lumen in every direction, one around each peak of the smaller curvature.
//!
//! The smaller principal curvature k2 is flooded from its peaks downwards (a watershed). Two floods that meet become one
//! if they meet at more than [`MERGE`] of the lower peak: a dent that shallow is noise or the shape of one body. So a cap
//! does not depend on where a search starts.

use rayon::slice::ParallelSliceMut;

use super::Wall;
use crate::math::sets::Sets;

/// Two caps that meet at more than this share of the lower one's peak are one.
const MERGE: f32 = 0.6;
/// Flooding stops here, 1/mm: flatter than a ball of 200 mm.
const FLOOR: f32 = 0.005;
/// No cap.
const NONE: u32 = u32::MAX;

/// A cap.
#[derive(Clone, Debug, PartialEq)]
pub struct Cap {
    /// The vertex with the largest k2.
    pub peak: u32,
    /// k2 there, 1/mm.
    pub k2: f32,
    /// Its area, mm².
    pub area: f32,
    /// Its vertices, in their order.
    pub vertices: Vec<u32>,
}

/// Returns the caps of a wall whose peak is at least `least` (1/mm) and whose area is at least `area` (mm²), by the number
/// of their peaks' vertices.
pub fn caps(wall: &Wall, least: f32, area: f32) -> Vec<Cap> {
    caps_among(wall, 0..wall.len() as u32, least, area)
}

/// Like [`caps`], of a part of the wall, given by its vertices in their order.
pub(crate) fn caps_among(wall: &Wall, part: impl Iterator<Item = u32> + Clone, least: f32, area: f32) -> Vec<Cap> {
    let k2 = |v: u32| wall.curvatures(v)[1];
    // Falling curvatures, then rising numbers. The bits of positive numbers are in their order.
    let key = |v: u32| u64::from(!k2(v).to_bits()) << 32 | u64::from(v);
    let mut order: Vec<u64> = part.clone().filter(|&v| k2(v) > FLOOR).map(key).collect();
    order.par_sort_unstable();
    // The flood that each vertex belongs to, and which flood that one has become a part of.
    let mut label = vec![NONE; wall.len()];
    let (mut floods, mut peaks) = (Sets::default(), Vec::new());
    for v in order.iter().map(|&key| key as u32) {
        let mut best = NONE;
        for &n in wall.beside(v) {
            if label[n as usize] == NONE {
                continue;
            }
            let root = floods.find(label[n as usize]);
            if best == NONE {
                best = root;
            } else if root != best {
                // Peaks come in falling order, so the lower number is the higher peak.
                let (high, low) = (best.min(root), best.max(root));
                if k2(v) > MERGE * k2(peaks[low as usize]) {
                    floods.join(low, high);
                }
                best = high;
            }
        }
        if best == NONE {
            best = floods.add();
            peaks.push(v);
        }
        label[v as usize] = best;
    }
    let mut own: Vec<Cap> =
        peaks.iter().map(|&peak| Cap { peak, k2: k2(peak), area: 0.0, vertices: Vec::new() }).collect();
    for v in part {
        if label[v as usize] != NONE {
            let cap = &mut own[floods.find(label[v as usize]) as usize];
            cap.area += wall.area(v);
            cap.vertices.push(v);
        }
    }
    own.retain(|c| c.k2 >= least && c.area >= area && !c.vertices.is_empty());
    own.sort_unstable_by_key(|c| c.peak);
    own
}
