//! The lumen as a solid, to be looked at from outside.

use glam::{DMat3, DVec3};

use super::Lumen;
use crate::error::Result;
use crate::volume::{Grid, Volume};

impl Lumen {
    /// Returns the lumen as a volume of cubes of `mm` along the patient's axes. A cube has the second of `values`, HU, as far as the lumen
    /// fills it, and the first as far as it does not. `None` without a lumen.
    ///
    /// # Errors
    /// Returns status 3 if there would be more cubes than a volume can have.
    pub fn solid(&self, mm: f64, [around, inside]: [i16; 2]) -> Result<Option<Volume>> {
        let Some((first, dims)) = self.around(4.0 * mm) else { return Ok(None) };
        // A box around all corners of the lumen's, which may lie askew.
        let corner = |n: usize| {
            let at = std::array::from_fn(|a| (first[a] + (n >> a & 1) * (dims[a] - 1)) as f64);
            self.grid.world(DVec3::from_array(at))
        };
        let (low, high) = (1..8).map(corner).fold((corner(0), corner(0)), |(low, high), p| (low.min(p), high.max(p)));
        let size = ((high - low) / mm).ceil().to_array().map(|n| n as usize + 1);
        let grid = Grid::new(size, DVec3::splat(mm), low, DMat3::IDENTITY)?;
        let mut filled = vec![0f32; grid.len()];
        // Each voxel's volume is shared out among the eight cubes around its centre, so that no cube has more or fewer by chance.
        // Two along each side of a cube are enough.
        let [a, b, c] = self.grid.spacing().to_array().map(|spacing| ((0.5 * mm / spacing) as usize).max(1));
        let part = ((a * b * c) as f64 * self.grid.spacing().element_product() / mm.powi(3)) as f32;
        let rows = self.gas.iter().chain(self.fluid.iter());
        for (j, k, r) in rows.filter(|(j, k, _)| j % b == 0 && k % c == 0) {
            // A row of voxels is a straight line.
            let cube = |i: f64| grid.voxel(self.grid.world(DVec3::new(i, j as f64, k as f64)));
            let start = cube(0.0);
            let step = cube(1.0) - start;
            for i in (r.range().start.next_multiple_of(a)..r.range().end).step_by(a) {
                let at = (start + i as f64 * step).max(DVec3::ZERO);
                let base = at.floor();
                let [x, y, z] = base.to_array().map(|x| x as usize);
                let [u, v, w] = (at - base).to_array().map(|x| x as f32);
                if x + 1 >= size[0] || y + 1 >= size[1] || z + 1 >= size[2] {
                    continue;
                }
                for (dz, w) in [(0, 1.0 - w), (1, w)] {
                    for (dy, v) in [(0, 1.0 - v), (1, v)] {
                        let n = grid.index(x, y + dy, z + dz);
                        filled[n] += part * w * v * (1.0 - u);
                        filled[n + 1] += part * w * v * u;
                    }
                }
            }
        }
        let value = |share: f32| {
            let share = f64::from(share).min(1.0);
            (f64::from(around) + (f64::from(inside) - f64::from(around)) * share) as i16
        };
        Ok(Some(Volume::new(grid, filled.into_iter().map(value).collect())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::lumen::find;
    use crate::phantom::PhantomSettings;
    use crate::progress::Progress;
    use crate::shared::shared;

    #[test]
    fn the_solid_has_the_volume_of_the_lumen() {
        let (_, volume) = shared(&PhantomSettings { fluid: true, ..PhantomSettings::embedded(1) });
        let lumen = find(&volume, &Progress::new()).unwrap();
        for mm in [2.0, 3.0, 4.0] {
            let solid = lumen.solid(mm, [-1000, 1000]).unwrap().unwrap();
            let share: f64 = solid.data().iter().map(|v| (f64::from(*v) + 1000.0) / 2000.0).sum();
            let (ml, expected) = (share * 1e-3 * mm.powi(3), lumen.gas_ml() + lumen.fluid_ml());
            assert!((ml - expected).abs() < 0.02 * expected, "{mm} mm: {ml} {expected}");
        }
        assert!(Lumen::none(lumen.grid()).solid(3.0, [0, 1]).unwrap().is_none());
    }
}
