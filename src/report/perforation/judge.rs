//! The judge of perforations. It uses only the voxels, not the clearance finder that the step relies on.
//!
//! It samples the wall: in each cell whose corners are on both sides of iso, the points of a lattice at which the trilinear value
//! reaches iso. These are certainly points of the wall, so a path that comes nearer than the radius to any of them has
//! perforated. A path whose own points reach iso has gone through the wall.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;

use crate::volume::Volume;

/// Distance between sample points of the wall, and between those of a path, mm.
const LATTICE_MM: f64 = 0.25;
const ALONG_MM: f64 = 0.04;
/// Distance between sample points of the wall for a close check, mm.
pub(crate) const CLOSE_MM: f64 = 0.03;
/// Size of a bin, mm.
const BIN_MM: f64 = 1.0;

/// The wall of a volume as sample points.
pub(crate) struct Judge {
    volume: Arc<Volume>,
    iso: f64,
    low: DVec3,
    bins: [usize; 3],
    /// The points of bin `b` are `points[begins[b]..begins[b + 1]]`.
    begins: Vec<u32>,
    points: Vec<DVec3>,
}

impl Judge {
    /// Samples the wall at `iso` HU.
    pub(crate) fn new(volume: Arc<Volume>, iso: f64) -> Self {
        let points = wall(&volume, iso);
        let grid = volume.grid();
        let corners = |f: fn(DVec3, DVec3) -> DVec3| {
            let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
            let all = (0..8)
                .map(|c| grid.world(last * DVec3::new(f64::from(c & 1), f64::from(c >> 1 & 1), f64::from(c >> 2))));
            all.reduce(f).unwrap_or_default()
        };
        let (low, high) = (corners(DVec3::min), corners(DVec3::max));
        let bins = ((high - low) / BIN_MM).to_array().map(|n| n.ceil() as usize + 1);
        let mut judge =
            Self { volume, iso, low, bins, begins: vec![0; bins.iter().product::<usize>() + 1], points: Vec::new() };
        let numbers: Vec<usize> = points.iter().map(|&p| judge.number(judge.bin(p))).collect();
        for &n in &numbers {
            judge.begins[n + 1] += 1;
        }
        for n in 1..judge.begins.len() {
            judge.begins[n] += judge.begins[n - 1];
        }
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|&i| numbers[i]);
        judge.points = order.into_iter().map(|i| points[i]).collect();
        judge
    }

    fn bin(&self, p: DVec3) -> [usize; 3] {
        let b = ((p - self.low) / BIN_MM).to_array();
        std::array::from_fn(|a| (b[a].max(0.0) as usize).min(self.bins[a] - 1))
    }

    fn number(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.bins[0] * (j + self.bins[1] * k)
    }

    /// True if the trilinear value at a world point reaches iso, or if the point is outside the volume.
    pub(crate) fn in_wall(&self, at: DVec3) -> bool {
        let grid = self.volume.grid();
        let u = grid.voxel(at);
        let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
        !(u.cmpge(DVec3::splat(-1e-9)).all() && u.cmple(last + 1e-9).all()) || value(&self.volume, u) >= self.iso
    }

    /// Returns the smallest distance from a straight path to the wall, mm, up to `reach` mm. The border of the volume counts as
    /// wall.
    pub(crate) fn clearance(&self, from: DVec3, to: DVec3, reach: f64) -> f64 {
        let mut least = reach.min(self.to_border(from)).min(self.to_border(to));
        let parts = (from.distance(to) / 2.0).ceil().clamp(1.0, 1e4) as u32;
        for part in 0..parts {
            let end = |n: u32| from.lerp(to, f64::from(n) / f64::from(parts));
            let (a, b) = (end(part), end(part + 1));
            let (lo, hi) = (self.bin(a.min(b) - reach), self.bin(a.max(b) + reach));
            for k in lo[2]..=hi[2] {
                for j in lo[1]..=hi[1] {
                    let row = self.number([lo[0], j, k])..=self.number([hi[0], j, k]);
                    let points = self.begins[*row.start()] as usize..self.begins[*row.end() + 1] as usize;
                    for &p in &self.points[points] {
                        least = least.min(to_segment(p, a, b));
                    }
                }
            }
        }
        least
    }

    /// Same as [`Judge::clearance`] for one point, from a lattice as fine as [`CLOSE_MM`]. Slow.
    pub(crate) fn closely(&self, at: DVec3, reach: f64) -> f64 {
        let mut least = reach.min(self.to_border(at));
        let grid = self.volume.grid();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for c in 0..8 {
            let side = |bit: i32| if c >> bit & 1 == 1 { reach } else { -reach };
            let u = grid.voxel(at + DVec3::new(side(0), side(1), side(2)));
            (low, high) = (low.min(u), high.max(u));
        }
        let cells = std::array::from_fn(|a| {
            let last = grid.dims()[a].saturating_sub(1);
            (low[a].floor().max(0.0) as usize).min(last)..(high[a].ceil().max(0.0) as usize).min(last)
        });
        sample_wall(&self.volume, self.iso, cells, CLOSE_MM, |p| least = least.min(p.distance(at)));
        least
    }

    /// True if a path that begins in gas, or has reached it, enters the wall.
    pub(crate) fn crosses(&self, from: DVec3, to: DVec3) -> bool {
        let parts = (from.distance(to) / ALONG_MM).ceil().clamp(1.0, 1e5) as u32;
        let mut free = false;
        (0..=parts).any(|n| {
            let wall = self.in_wall(from.lerp(to, f64::from(n) / f64::from(parts)));
            let crossed = free && wall;
            free |= !wall;
            crossed
        })
    }

    fn to_border(&self, at: DVec3) -> f64 {
        let grid = self.volume.grid();
        let u = grid.voxel(at);
        let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
        (u * grid.spacing()).min_element().min(((last - u) * grid.spacing()).min_element()).max(0.0)
    }
}

fn to_segment(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = b - a;
    let length = along.length_squared();
    let t = if length > 0.0 { ((p - a).dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
    p.distance(a + along * t)
}

/// Returns the trilinear value at a voxel position inside the volume.
fn value(volume: &Volume, u: DVec3) -> f64 {
    let last = DVec3::from_array(volume.grid().dims().map(|n| (n as f64 - 2.0).max(0.0)));
    let base = u.floor().clamp(DVec3::ZERO, last);
    let t = u - base;
    let b = base.as_i64vec3();
    (0..8i64)
        .map(|c| {
            let (i, j, k) = (c & 1, c >> 1 & 1, c >> 2);
            let share = |bit: i64, t: f64| if bit == 1 { t } else { 1.0 - t };
            share(i, t.x) * share(j, t.y) * share(k, t.z) * f64::from(volume.get(b.x + i, b.y + j, b.z + k))
        })
        .sum()
}

fn wall(volume: &Volume, iso: f64) -> Vec<DVec3> {
    let cells = volume.grid().dims().map(|n| 0..n.saturating_sub(1));
    let mut points = Vec::new();
    sample_wall(volume, iso, cells, LATTICE_MM, |p| points.push(p));
    points
}

/// Reports the points of the wall, world mm, on a lattice in a box of cells.
fn sample_wall(volume: &Volume, iso: f64, cells: [Range<usize>; 3], lattice_mm: f64, mut point: impl FnMut(DVec3)) {
    let grid = volume.grid();
    let fine = (grid.spacing() / lattice_mm).to_array().map(|n| (n.ceil() as usize).clamp(1, 400));
    let [x, y, z] = cells;
    for (k, j, i) in z.flat_map(|k| {
        let x = x.clone();
        y.clone().flat_map(move |j| x.clone().map(move |i| (k, j, i)))
    }) {
        let corner =
            |c: usize| f64::from(volume.get((i + (c & 1)) as i64, (j + (c >> 1 & 1)) as i64, (k + (c >> 2)) as i64));
        let solid = (0..8).filter(|&c| corner(c) >= iso).count();
        if solid == 0 || solid == 8 {
            continue;
        }
        for (c, b, a) in
            (0..=fine[2]).flat_map(|c| (0..=fine[1]).flat_map(move |b| (0..=fine[0]).map(move |a| (c, b, a))))
        {
            let part = |n: usize, of: usize| n as f64 / of as f64;
            let u = DVec3::new(i as f64 + part(a, fine[0]), j as f64 + part(b, fine[1]), k as f64 + part(c, fine[2]));
            if value(volume, u) >= iso {
                point(grid.world(u));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::volume::Grid;

    #[test]
    fn a_way_through_the_wall_is_told_from_one_beside_it() {
        let grid =
            Grid::new([21, 21, 21], DVec3::new(1.0, 0.5, 1.0), DVec3::new(-3.0, 2.0, 0.0), DMat3::IDENTITY).unwrap();
        // A wall one voxel thick at x = 7 mm.
        let data = (0..grid.len()).map(|n| if n % 21 == 10 { 40 } else { -1000 }).collect();
        let judge = Judge::new(Arc::new(Volume::new(grid, data)), -650.0);
        let at = |x: f64| DVec3::new(x, 7.0, 10.0);
        assert!(
            judge.in_wall(at(7.0)) && !judge.in_wall(at(5.0)) && judge.in_wall(at(-3.1)) && judge.in_wall(DVec3::NAN)
        );
        assert!(
            judge.crosses(at(5.0), at(9.0)) && !judge.crosses(at(2.0), at(6.2)) && !judge.crosses(at(7.0), at(9.0))
        );
        // Iso is reached 0.663 mm before the voxel. The lattice spacing is a quarter of a voxel.
        let c = judge.clearance(at(3.0), at(4.0), 5.0);
        assert!((c - 2.34).abs() < 0.26, "{c}");
        let close = judge.closely(at(4.0), 5.0);
        assert!((close - 2.337).abs() < CLOSE_MM, "{close}");
        assert!(judge.clearance(at(5.0), at(9.0), 5.0) < 1e-9);
        assert_eq!(judge.clearance(at(0.0), at(0.5), 1.0), 1.0);
        assert_eq!(judge.clearance(at(-2.5), at(0.5), 1.0), 0.5, "the border is a wall");
    }
}
