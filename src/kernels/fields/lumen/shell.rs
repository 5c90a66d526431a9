//! The wall of the lumen by parts: how much of it there is, and how much of it lies under tag.

use glam::DVec3;
use rayon::prelude::*;

use super::Lumen;
use super::runs::Run;

/// A stretch of the wall along x is at most so many voxels long, so that it belongs to one part.
const LONGEST: u32 = 8;

/// Area of a wall, mm².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WallArea {
    /// All of it.
    pub all: f64,
    /// What lies under tagged fluid or stool.
    pub tagged: f64,
}

impl WallArea {
    /// Returns the share under tag, 0 to 1; 0 without a wall.
    pub fn share_tagged(&self) -> f64 {
        if self.all > 0.0 { self.tagged / self.all } else { 0.0 }
    }
}

impl Lumen {
    /// Returns the area of the wall in each of `count` parts, where `part` returns the part of a place (world, mm); a place without one
    /// counts nowhere. `was_tag` is true for a voxel of gas, by its indices, that was tag before it was cleansed.
    ///
    /// The wall is the faces between voxels of the lumen and others. Their sum is larger than the area of the smooth wall, by up to √3,
    /// alike for all of it: use the shares.
    pub fn wall_areas(
        &self,
        count: usize,
        part: impl Fn(DVec3) -> Option<usize> + Sync,
        was_tag: impl Fn([usize; 3]) -> bool + Sync,
    ) -> Vec<WallArea> {
        let [_, ny, nz] = self.gas.dims();
        let spacing = self.grid.spacing();
        let faces = DVec3::new(spacing.y * spacing.z, spacing.x * spacing.z, spacing.x * spacing.y);
        let slice = |k: usize| {
            let mut areas = vec![WallArea::default(); count];
            // Gas and fluid of a row, in order, with a label for fluid.
            let row = |j: usize, k: usize| {
                let labelled = |runs: &[Run], label| runs.iter().map(|r| Run { label, ..*r }).collect::<Vec<_>>();
                let mut all = labelled(self.gas.row(j, k), 0);
                all.extend(labelled(self.fluid.row(j, k), 1));
                all.sort_unstable_by_key(|r| r.start);
                all
            };
            for j in 0..ny {
                let own = row(j, k);
                if own.is_empty() {
                    continue;
                }
                let mut add = |from: u32, to: u32, is_fluid: bool, area: f64| {
                    let middle = [((from + to) / 2) as usize, j, k];
                    let world = self.grid.world(DVec3::from_array(middle.map(|x| x as f64)));
                    let Some(area_of) = part(world).and_then(|n| areas.get_mut(n)) else { return };
                    let mm2 = f64::from(to - from) * area;
                    area_of.all += mm2;
                    if is_fluid || was_tag(middle) {
                        area_of.tagged += mm2;
                    }
                };
                for r in &own {
                    let is_inside =
                        |x: Option<u32>| x.is_some_and(|x| own.iter().any(|o| (o.start..o.end).contains(&x)));
                    for (x, beside) in [(r.start, r.start.checked_sub(1)), (r.end - 1, Some(r.end))] {
                        if !is_inside(beside) {
                            add(x, x + 1, r.label == 1, faces.x);
                        }
                    }
                }
                let above = [(j.checked_sub(1), Some(k)), (Some(j + 1).filter(|j| *j < ny), Some(k))];
                let beyond = [(Some(j), k.checked_sub(1)), (Some(j), Some(k + 1).filter(|k| *k < nz))];
                for (beside, area) in above.map(|b| (b, faces.y)).into_iter().chain(beyond.map(|b| (b, faces.z))) {
                    let others = if let (Some(j), Some(k)) = beside { row(j, k) } else { Vec::new() };
                    for r in &own {
                        uncovered(*r, &others, |from, to| {
                            let starts = (from..to).step_by(LONGEST as usize);
                            starts.for_each(|x| add(x, (x + LONGEST).min(to), r.label == 1, area));
                        });
                    }
                }
            }
            areas
        };
        // In the order of the slices, so that the sum does not depend on the threads.
        let slices: Vec<_> = (0..nz).into_par_iter().map(slice).collect();
        let mut sum = vec![WallArea::default(); count];
        for areas in &slices {
            for (sum, area) in sum.iter_mut().zip(areas) {
                sum.all += area.all;
                sum.tagged += area.tagged;
            }
        }
        sum
    }
}

/// Calls a function with the parts of a run that no run of another row covers: from, to.
fn uncovered(r: Run, others: &[Run], mut f: impl FnMut(u32, u32)) {
    let mut from = r.start;
    for other in others {
        if other.end <= from {
            continue;
        }
        if other.start >= r.end {
            break;
        }
        if other.start > from {
            f(from, other.start);
        }
        from = from.max(other.end);
    }
    if from < r.end {
        f(from, r.end);
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::super::runs::Rows;
    use super::*;
    use crate::volume::Grid;

    /// A box of gas of 10 × 6 × 4 mm on a box of fluid of the same size, in voxels of 1 × 0.5 × 2 mm.
    fn basin() -> Lumen {
        let grid = Grid::new([20, 40, 10], DVec3::new(1.0, 0.5, 2.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let rows = |from: usize, to: usize| {
            let slice = |k: usize| {
                let has = |j: usize| (from..to).contains(&j) && (3..5).contains(&k);
                let lengths = (0..40).map(|j| u32::from(has(j))).collect();
                let runs = (0..40).filter(|&j| has(j)).map(|_| Run { start: 5, end: 15, label: 0 }).collect();
                (lengths, runs)
            };
            Rows::from_slices([20, 40, 10], (0..10).map(slice).collect()).unwrap()
        };
        Lumen::of_rows(&grid, rows(4, 16), rows(16, 28))
    }

    #[test]
    fn areas_are_those_of_the_faces_and_where_gas_meets_fluid_there_is_no_wall() {
        let lumen = basin();
        // Each box: one face of 10 × 4, two of 10 × 6, two of 6 × 4 mm.
        let one = 40.0 + 120.0 + 48.0;
        let all = lumen.wall_areas(1, |_| Some(0), |_| false);
        assert_eq!(all, [WallArea { all: 2.0 * one, tagged: one }]);
        assert_eq!(all[0].share_tagged(), 0.5);
        // Of two parts, and a place that belongs to none.
        let left = |p: DVec3| (p.x < 14.0).then_some(usize::from(p.x >= 10.0));
        let parts = lumen.wall_areas(2, left, |_| false);
        assert!(parts[0].all > parts[1].all && parts[0].all + parts[1].all < 2.0 * one);
        // What was fluid before.
        let cleansed = lumen.wall_areas(1, |_| Some(0), |[_, j, _]| j < 16);
        assert_eq!(cleansed[0].share_tagged(), 1.0);
        let none = Lumen::none(lumen.grid()).wall_areas(1, |_| Some(0), |_| true);
        assert_eq!(none[0].share_tagged(), 0.0);
    }
}
