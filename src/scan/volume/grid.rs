//! The voxel grid and its position in the patient.

use glam::{DAffine3, DMat3, DVec3};

use crate::error::{Error, Result};

/// The hint on an unusable spacing.
const SPACING_HINT: &str = "give the distance of neighbouring voxels along each axis in mm";

/// A regular grid in the world: `world = origin + direction · (spacing ∘ index)`, mm, LPS.
///
/// `direction` has unit columns. It may be left- or right-handed and oblique (a tilted gantry), but never singular.
///
/// ```
/// # use colvis_scan as colvis;
/// use colvis::volume::Grid;
/// use glam::{DMat3, DVec3};
///
/// // 4 × 3 × 2 voxels of 0.7 × 0.7 × 1 mm; the first one's centre lies at (−10, 5, 20) mm LPS.
/// let grid = Grid::new([4, 3, 2], DVec3::new(0.7, 0.7, 1.0), DVec3::new(-10.0, 5.0, 20.0), DMat3::IDENTITY)?;
/// assert_eq!(grid.world(DVec3::new(1.0, 0.0, 1.0)), DVec3::new(-9.3, 5.0, 21.0));
/// assert!(grid.voxel(DVec3::new(-10.0, 5.0, 20.0)).length() < 1e-12);
/// # Ok::<(), colvis::error::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    dims: [usize; 3],
    spacing: DVec3,
    origin: DVec3,
    direction: DMat3,
    to_world: DAffine3,
    to_voxel: DAffine3,
}

impl Grid {
    /// Creates a grid of `dims` voxels.
    ///
    /// `spacing` is in mm. `origin` is the centre of voxel (0, 0, 0), mm LPS. The columns of `direction` are the world
    /// directions of the three index axes; they are normalised here.
    ///
    /// # Errors
    /// Returns status 3 if there are no voxels or more than can be addressed, if the spacing is not positive and finite,
    /// if the origin is not finite, or if the direction is singular or not finite.
    pub fn new(dims: [usize; 3], spacing: DVec3, origin: DVec3, direction: DMat3) -> Result<Self> {
        let refused = |why: String, hint: &str| Err(Error::input("grid", why, hint));
        if dims.contains(&0) {
            return refused(format!("has no voxels (dims {dims:?})"), "give at least one voxel along each axis");
        }
        let count = dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d)).filter(|&n| n <= isize::MAX as usize / 8);
        if count.is_none() || dims.iter().any(|&d| d > i32::MAX as usize) {
            return refused(format!("dims {dims:?} are too large"), "give fewer voxels");
        }
        if !spacing.is_finite() || spacing.min_element() <= 0.0 {
            return refused(format!("spacing {spacing} mm is not positive and finite"), SPACING_HINT);
        }
        if spacing.min_element() < 1e-6 || spacing.max_element() > 1e6 {
            return refused(format!("spacing {spacing} mm is out of range"), SPACING_HINT);
        }
        if !origin.is_finite() || origin.abs().max_element() > 1e9 {
            return refused(format!("origin {origin} mm is out of range"), "give the first voxel's centre in mm, LPS");
        }
        let columns = [direction.x_axis, direction.y_axis, direction.z_axis].map(|c| c.normalize_or_zero());
        let direction = DMat3::from_cols(columns[0], columns[1], columns[2]);
        if !direction.is_finite() || direction.determinant().abs() < 1e-3 {
            return refused(
                "direction is singular".to_owned(),
                "give three independent directions, one for each index axis",
            );
        }
        let to_world = DAffine3::from_mat3_translation(direction * DMat3::from_diagonal(spacing), origin);
        let to_voxel = to_world.inverse();
        Ok(Self { dims, spacing, origin, direction, to_world, to_voxel })
    }

    /// Returns the grid of a box of its voxels: `dims` voxels from `first` on.
    ///
    /// # Panics
    /// Panics if the box is empty or reaches beyond the grid.
    pub fn part(&self, first: [usize; 3], dims: [usize; 3]) -> Self {
        assert!((0..3).all(|a| dims[a] > 0 && first[a] + dims[a] <= self.dims[a]), "a part must be within its grid");
        let origin = self.world(DVec3::from_array(first.map(|n| n as f64)));
        let to_world = DAffine3::from_mat3_translation(self.to_world.matrix3, origin);
        Self { dims, origin, to_world, to_voxel: to_world.inverse(), ..self.clone() }
    }

    /// Returns the number of voxels along each index axis.
    #[inline]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Returns the distance between neighbouring voxels along each index axis, mm.
    #[inline]
    pub fn spacing(&self) -> DVec3 {
        self.spacing
    }

    /// Returns the smallest spacing, mm: the `h` of the opacity formula and the unit of steps along a ray.
    #[inline]
    pub fn min_spacing(&self) -> f64 {
        self.spacing.min_element()
    }

    /// Returns the centre of voxel (0, 0, 0), mm LPS.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Returns the world directions of the index axes, as unit columns.
    pub fn direction(&self) -> DMat3 {
        self.direction
    }

    /// Returns the number of voxels.
    #[expect(clippy::len_without_is_empty, reason = "a grid is never empty")]
    #[inline]
    pub fn len(&self) -> usize {
        self.dims[0] * self.dims[1] * self.dims[2]
    }

    /// Returns the transform from voxel coordinates to world, mm LPS.
    pub fn to_world(&self) -> &DAffine3 {
        &self.to_world
    }

    /// Returns the transform from world, mm LPS, to voxel coordinates.
    pub fn to_voxel(&self) -> &DAffine3 {
        &self.to_voxel
    }

    /// Returns the world position (mm LPS) of a (fractional) voxel index.
    #[inline]
    pub fn world(&self, voxel: DVec3) -> DVec3 {
        self.to_world.transform_point3(voxel)
    }

    /// Returns the (fractional) voxel index of a world position (mm LPS).
    #[inline]
    pub fn voxel(&self, world: DVec3) -> DVec3 {
        self.to_voxel.transform_point3(world)
    }

    /// True if a world position (mm LPS) is inside a voxel. Each voxel extends half its size beyond its centre.
    #[inline]
    pub fn contains(&self, world: DVec3) -> bool {
        let at = self.voxel(world).to_array();
        // Written so that NaN gives false.
        (0..3).all(|a| at[a] >= -0.5 && at[a] < self.dims[a] as f64 - 0.5)
    }

    /// Returns the volume of one voxel, ml.
    #[inline]
    pub fn voxel_ml(&self) -> f64 {
        self.to_world.matrix3.determinant().abs() / 1000.0
    }

    /// Returns the linear index of a voxel within the grid.
    #[inline]
    pub fn index(&self, i: usize, j: usize, k: usize) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;

    #[test]
    fn world_and_voxel_are_inverse() {
        let d = DMat3::from_cols(DVec3::NEG_X, DVec3::new(0.0, 0.8, 0.6), DVec3::new(0.0, -0.6, 0.8));
        let g = Grid::new([4, 5, 6], DVec3::new(0.3, 0.7, 10.0), DVec3::new(-10.0, 20.0, 30.0), d).unwrap();
        let p = DVec3::new(1.25, 3.5, 4.75);
        assert!((g.voxel(g.world(p)) - p).length() < 1e-12);
        assert!(g.contains(g.world(DVec3::new(-0.49, 4.49, 5.0))) && !g.contains(g.world(DVec3::new(0.0, 4.51, 5.0))));
        assert!(!g.contains(DVec3::NAN) && !g.contains(DVec3::splat(f64::INFINITY)));
        assert!((g.world(DVec3::X) - g.origin() - DVec3::new(-0.3, 0.0, 0.0)).length() < 1e-12);
        assert!((g.voxel_ml() - 0.3 * 0.7 * 10.0 / 1000.0).abs() < 1e-12);
    }

    #[test]
    fn refuses_what_is_no_grid() {
        let ok = |dims, s: DVec3, d| {
            let grid = Grid::new(dims, s, DVec3::ZERO, d);
            grid.inspect_err(|e| assert!(e.kind == Kind::Input && e.what == "grid" && !e.hint.is_empty(), "{e}"))
        };
        let one = DVec3::ONE;
        assert!(ok([0, 1, 1], one, DMat3::IDENTITY).is_err());
        assert!(ok([usize::MAX, 2, 2], one, DMat3::IDENTITY).is_err());
        for s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(ok([2; 3], DVec3::new(1.0, s, 1.0), DMat3::IDENTITY).is_err());
        }
        assert!(ok([2; 3], one, DMat3::ZERO).is_err());
        assert!(ok([2; 3], one, DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z)).is_err());
    }
}
