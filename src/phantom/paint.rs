//! The body's value, painted layer over layer.

use super::profile::{mix, smooth_step};

/// A value under construction: layers are painted over it.
pub(crate) struct Paint {
    /// HU.
    pub hu: f64,
    /// Distance from an edge within which its blur reaches, mm.
    pub edge: f64,
    /// Radius within which the value is constant, mm.
    pub free: f64,
}

impl Paint {
    /// Changes the value to `hu` where the depth `d` passes from negative to positive. `d` is in mm and must not change
    /// faster than the position.
    #[inline]
    pub(crate) fn over(&mut self, d: f64, hu: f64) {
        self.free = self.free.min(d.abs() - self.edge);
        if d > -self.edge {
            self.hu = mix(self.hu, hu, smooth_step(-self.edge, self.edge, d));
        }
    }

    /// Says that the value varies here.
    pub(crate) fn varies(&mut self) {
        self.free = 0.0;
    }
}
