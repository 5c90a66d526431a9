//! Approximate distances to the wall, for comparison with the exact one: two passes over the grid's box around the lumen.
//!
//! Chamfer distances (Borgefors 1986) add the lengths of steps to the 26 neighbours. The chessboard distance counts
//! voxels along the longest axis; in mm it is the count times the smallest spacing, a lower bound. Both assume that the
//! wall is half-way between voxels.

use crate::fields::WallDistance;

/// An approximate distance measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Cheap {
    /// Steps to the 26 neighbours at their Euclidean lengths.
    Chamfer,
    /// The maximum of the steps along each axis.
    Chessboard,
}

/// Returns the distances (mm) of the voxels in the set of `walls`, in its order; 0 for those outside the lumen.
#[doc(hidden)]
pub fn distances(walls: &WallDistance, kind: Cheap) -> Vec<f32> {
    let set = walls.set();
    let spacing = walls.grid().spacing();
    let unit = spacing.min_element();
    let length = |d: [i64; 3]| match kind {
        Cheap::Chamfer => (0..3).map(|a| (d[a] as f64 * spacing[a]).powi(2)).sum::<f64>().sqrt(),
        Cheap::Chessboard => unit,
    } as f32;
    let before: Vec<([i64; 3], f32)> =
        (0..13i64).map(|n| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1]).map(|d| (d, length(d))).collect();
    let half = |a: usize| match kind {
        Cheap::Chamfer => 0.5 * spacing[a],
        Cheap::Chessboard => 0.5 * unit,
    } as f32;
    let mut out: Vec<f32> = walls.values().map(|v| if v >= 0.0 { f32::INFINITY } else { 0.0 }).collect();
    // Next to the wall: half a voxel along the axis that leads out.
    set.for_each(|n, v| {
        let v = v.map(|x| x as i64);
        if out[n] > 0.0 {
            for a in 0..3 {
                for way in [-1, 1] {
                    let mut to = v;
                    to[a] += way;
                    if !walls.is_inside(to) {
                        out[n] = out[n].min(half(a));
                    }
                }
            }
        }
    });
    let relax = |out: &mut [f32], n: usize, v: [i64; 3], sign: i64| {
        for &(d, step) in &before {
            let from = [v[0] + sign * d[0], v[1] + sign * d[1], v[2] + sign * d[2]];
            // A neighbour outside is not on the wall; the wall is before it.
            if let Some(m) = set.number(from).filter(|&m| walls.value(m) >= 0.0) {
                out[n] = out[n].min(out[m] + step);
            }
        }
    };
    let mut voxels = Vec::with_capacity(set.len());
    set.for_each(|n, v| {
        let v = v.map(|x| x as i64);
        if walls.value(n) >= 0.0 {
            relax(&mut out, n, v, 1);
            voxels.push((n as u32, v.map(|x| x as i32)));
        }
    });
    for &(n, v) in voxels.iter().rev() {
        relax(&mut out, n as usize, v.map(i64::from), -1);
    }
    out
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// In a long tube of 9 × 9 voxels, the nearest wall is across; in a box it is the nearest of six.
    #[test]
    fn distances_of_boxes_are_known() {
        for spacing in [DVec3::ONE, DVec3::new(0.5, 1.0, 2.0)] {
            for long in 0..3 {
                // Nine voxels within, 41 along one axis, wall on all sides.
                let mut size = [9usize; 3];
                size[long] = 41;
                let dims = size.map(|n| n + 2);
                let inside =
                    |p: DVec3| (0..3).all(|a| p[a] > 0.5 * spacing[a] && p[a] < (size[a] as f64 + 0.5) * spacing[a]);
                let walls = WallDistance::drawn(dims, spacing, inside);
                for kind in [Cheap::Chamfer, Cheap::Chessboard] {
                    let found = distances(&walls, kind);
                    walls.set().for_each(|n, v| {
                        if walls.value(n) < 0.0 {
                            return;
                        }
                        let unit = if kind == Cheap::Chamfer { spacing } else { DVec3::splat(spacing.min_element()) };
                        // Half a voxel and whole ones to the nearer of the two walls across each axis.
                        let to_wall = |a: usize| (v[a].min(size[a] + 1 - v[a]) as f64 - 0.5) * unit[a];
                        let want = to_wall(0).min(to_wall(1)).min(to_wall(2));
                        assert!((f64::from(found[n]) - want).abs() < 1e-5, "{kind:?} {spacing} {v:?}: {}", found[n]);
                    });
                }
            }
        }
    }
}
