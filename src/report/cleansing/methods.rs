//! The methods that a report on cleansing compares.

use std::sync::Arc;

use crate::error::Result;
use crate::fields::{Lumen, cleanse, lumen};
use crate::progress::Progress;
use crate::volume::Volume;

/// HU of gas and of the colon's wall.
const GAS: f64 = -1000.0;
const TISSUE: f64 = 40.0;
/// How far around the fluid values are remapped, voxels: as far as a scanner's blur reaches.
const REACH: usize = 3;
/// The lumen's mark of tagged fluid.
const FLUID: u8 = 2;

/// A cleansing method.
pub(super) struct Method {
    /// Its name.
    pub name: &'static str,
    /// Returns the cleansed scan, given the scan and its lumen.
    pub apply: fn(&Arc<Volume>, &Lumen, &Progress) -> Result<Arc<Volume>>,
}

/// All methods.
pub(super) const METHODS: [Method; 5] = [
    Method { name: "none", apply: |scan, _, _| Ok(Arc::clone(scan)) },
    Method { name: "blanked", apply: |scan, lumen, _| Ok(Arc::new(blanked(scan, lumen))) },
    Method { name: "remapped", apply: |scan, lumen, _| Ok(Arc::new(remapped(scan, lumen))) },
    Method {
        name: "cleansed",
        apply: |scan, lumen, progress| Ok(Arc::new(cleanse::cleanse(scan, lumen, progress)?.changes.applied(scan))),
    },
    Method {
        name: "as flown",
        apply: |scan, lumen, progress| Ok(Arc::new(cleanse::to_fly(scan, lumen, progress)?.changes.applied(scan))),
    },
];

/// Returns the lumen of a scan.
pub(super) fn lumen_of(scan: &Volume, progress: &Progress) -> Result<Lumen> {
    lumen::find(scan, progress)
}

/// Fills the fluid's voxels with gas, and the blurred layer between gas and fluid.
fn blanked(scan: &Volume, lumen: &Lumen) -> Volume {
    let mut data = scan.data().to_vec();
    for (hu, mark) in data.iter_mut().zip(lumen.mask()) {
        if mark == FLUID {
            *hu = GAS as i16;
        }
    }
    Volume::new(scan.grid().clone(), data)
}

/// Maps values between tissue and the tag's mean linearly to those between tissue and gas, in and around the fluid. Darker ones in
/// the fluid's own voxels, which are between gas and fluid, become gas. Noise grows by the ratio of both contrasts.
fn remapped(scan: &Volume, lumen: &Lumen) -> Volume {
    let (grid, data, mask) = (scan.grid(), scan.data(), lumen.mask());
    let is_fluid = |n: &usize| mask[*n] == FLUID;
    let bright = || (0..data.len()).filter(is_fluid).map(|n| f64::from(data[n])).filter(|&hu| hu > 2.0 * TISSUE);
    let count = bright().count();
    if count == 0 {
        return scan.clone();
    }
    let tag = (bright().sum::<f64>() / count as f64).max(TISSUE + 100.0);
    let mut out = data.to_vec();
    let [nx, ny, nz] = grid.dims();
    let near = |n: usize, count: usize| n.saturating_sub(REACH)..(n + REACH + 1).min(count);
    for n in (0..data.len()).filter(is_fluid) {
        let [i, j, k] = [n % nx, n / nx % ny, n / nx / ny];
        for k in near(k, nz) {
            for j in near(j, ny) {
                for i in near(i, nx) {
                    let n = grid.index(i, j, k);
                    let hu = f64::from(data[n]);
                    if hu > TISSUE {
                        out[n] = (TISSUE + (hu.min(tag) - TISSUE) * (GAS - TISSUE) / (tag - TISSUE)).round() as i16;
                    }
                }
            }
        }
    }
    for n in (0..data.len()).filter(is_fluid) {
        let is_dark = f64::from(data[n]) < TISSUE;
        if is_dark {
            out[n] = GAS as i16;
        }
    }
    Volume::new(grid.clone(), out)
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::volume::Grid;

    /// A box of gas over fluid in tissue: 40 mm wide, its level in the middle.
    #[test]
    fn fluid_becomes_gas_and_tissue_stays() {
        let grid = Grid::new([60, 60, 60], DVec3::ONE, DVec3::splat(-29.5), DMat3::IDENTITY).unwrap();
        let value = |n: usize| {
            let [x, y, z] = [n % 60, n / 60 % 60, n / 3600].map(|c| c as i32 - 30);
            let inside = x.abs() < 20 && y.abs() < 20 && z.abs() < 25;
            if !inside {
                40
            } else if y > 0 {
                450
            } else {
                -1000
            }
        };
        let scan = Arc::new(Volume::new(grid.clone(), (0..grid.len()).map(value).collect()));
        let lumen = lumen_of(&scan, &Progress::new()).unwrap();
        assert!(lumen.fluid_ml() > 20.0);
        for method in &METHODS[1..] {
            let clean = (method.apply)(&scan, &lumen, &Progress::new()).unwrap();
            assert!(clean.get(30, 45, 30) < -990, "{}", method.name);
            assert_eq!(clean.get(30, 15, 30), -1000, "{}", method.name);
            // Far from the fluid nothing changes.
            assert_eq!(clean.get(30, 57, 30), 40, "{}", method.name);
        }
    }
}
