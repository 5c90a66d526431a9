//! The patient's orientation in the grid.

use crate::volume::Grid;

/// An index axis with a direction along it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::fields) struct AxisDirection {
    /// 0, 1 or 2: i, j or k.
    pub axis: usize,
    /// 1 if the index increases in this direction, −1 if it decreases.
    pub sign: i64,
}

impl AxisDirection {
    pub(crate) fn back(self) -> Self {
        Self { sign: -self.sign, ..self }
    }

    /// Returns the step of one voxel in this direction.
    pub(crate) fn step(self) -> [i64; 3] {
        let mut s = [0; 3];
        s[self.axis] = self.sign;
        s
    }
}

/// The index directions closest to the patient's axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::fields) struct Frame {
    pub left: AxisDirection,
    pub posterior: AxisDirection,
    pub superior: AxisDirection,
}

impl Frame {
    /// Matches index axes to world axes for the best overall agreement, however the grid is stored.
    pub(crate) fn of(grid: &Grid) -> Self {
        let d = grid.direction();
        let toward = |axis: usize, world: usize| d.col(axis)[world];
        const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let agreement = |o: &[usize; 3]| (0..3).map(|w| toward(o[w], w).abs()).sum::<f64>();
        let mut best = ORDERS[0];
        for o in ORDERS {
            if agreement(&o) > agreement(&best) + 1e-9 {
                best = o;
            }
        }
        let axis_direction =
            |w: usize| AxisDirection { axis: best[w], sign: if toward(best[w], w) < 0.0 { -1 } else { 1 } };
        Self { left: axis_direction(0), posterior: axis_direction(1), superior: axis_direction(2) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    #[test]
    fn ways_follow_the_direction_matrix() {
        // i runs to superior, j to the right, k to anterior, all slightly tilted.
        let d = DMat3::from_cols(DVec3::new(0.1, 0.0, 1.0), DVec3::new(-1.0, 0.2, 0.0), DVec3::new(0.0, -1.0, 0.2));
        let f = Frame::of(&Grid::new([2; 3], DVec3::ONE, DVec3::ZERO, d).unwrap());
        assert_eq!(f.left, AxisDirection { axis: 1, sign: -1 });
        assert_eq!(f.posterior, AxisDirection { axis: 2, sign: -1 });
        assert_eq!(f.superior, AxisDirection { axis: 0, sign: 1 });
    }

    #[test]
    fn an_axis_between_two_of_the_patients_takes_one_of_them() {
        let d = DMat3::from_cols(DVec3::new(1.0, 1.0, 0.0), DVec3::new(-1.0, 1.0, 0.0), DVec3::Z);
        let f = Frame::of(&Grid::new([2; 3], DVec3::ONE, DVec3::ZERO, d).unwrap());
        let mut axes = [f.left.axis, f.posterior.axis, f.superior.axis];
        axes.sort_unstable();
        assert_eq!(axes, [0, 1, 2]);
    }
}
