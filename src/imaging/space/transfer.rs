//! The transfer function: which HU values are wall.

use crate::error::{Error, Result};

/// The opacity ramp over HU: transparent up to `lo`, opaque from `hi`, linear between.
///
/// ```
/// # use colvis_imaging as colvis;
/// use colvis::space::TransferFunction;
///
/// let usual = TransferFunction::default();
/// assert_eq!((usual.lo(), usual.hi(), usual.iso()), (-800.0, -500.0, -650.0));
/// assert!(TransferFunction::new(-500.0, -800.0).is_err(), "it must rise");
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransferFunction {
    lo: f32,
    hi: f32,
}

impl TransferFunction {
    /// Creates a ramp from `lo` to `hi`, HU.
    ///
    /// # Errors
    /// Returns status 2 if a bound is not a finite 16-bit HU value or `lo` is not below `hi`.
    pub fn new(lo: f32, hi: f32) -> Result<Self> {
        let hint = "give LO,HI in HU with LO below HI, such as -800,-500";
        let range = -32767.0..=32767.0;
        if !range.contains(&lo) || !range.contains(&hi) {
            return Err(Error::usage("--wall", format!("{lo},{hi} is not within ±32767 HU"), hint));
        }
        if lo >= hi {
            return Err(Error::usage("--wall", format!("{lo} HU is not below {hi} HU"), hint));
        }
        Ok(Self { lo, hi })
    }

    /// Returns the value above which opacity begins, HU.
    pub fn lo(self) -> f32 {
        self.lo
    }

    /// Returns the value from which opacity is 1, HU.
    pub fn hi(self) -> f32 {
        self.hi
    }

    /// Returns the value of the wall, the middle of the ramp, HU.
    pub fn iso(self) -> f64 {
        0.5 * (f64::from(self.lo) + f64::from(self.hi))
    }
}

impl Default for TransferFunction {
    /// Returns the ramp from −800 to −500 HU, with the wall at −650.
    fn default() -> Self {
        Self { lo: -800.0, hi: -500.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_is_a_rising_finite_ramp() {
        assert_eq!(TransferFunction::default().iso(), -650.0);
        assert_eq!(TransferFunction::new(-800.0, -500.0).unwrap(), TransferFunction::default());
        for (lo, hi) in [(0.0, 0.0), (1.0, 0.0), (f32::NAN, 0.0), (0.0, f32::INFINITY), (-1e6, 0.0)] {
            let e = TransferFunction::new(lo, hi).unwrap_err();
            assert_eq!(e.kind, crate::error::Kind::Usage);
        }
    }
}
