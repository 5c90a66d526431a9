//! Opacity and colour of a step along a ray.

use glam::Vec3;

use crate::space::TransferFunction;

/// Values this little above the ramp's foot are still empty, HU. The rounding of interpolated values must not give
/// opacity to a neighbourhood that is flagged as empty, so that skipping it changes no bit of the picture.
pub(super) const FOOT: f32 = 0.01;

/// The opacity of one step along a ray.
///
/// The ramp's opacity a applies to a path of h, the smallest spacing; over Δs it is 1 − (1 − a)^(Δs/h). Steps are h ·
/// 2^p for a whole p, so the power consists of a few square roots or squares: exact, and the same on every machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ramp {
    foot: f32,
    lo: f32,
    scale: f32,
    power: i32,
}

impl Ramp {
    /// Creates the ramp of `wall` for steps of h · 2^`power`.
    pub(crate) fn new(wall: TransferFunction, power: i32) -> Self {
        Self { foot: wall.lo() + FOOT, lo: wall.lo(), scale: 1.0 / (wall.hi() - wall.lo()), power }
    }

    /// Returns the opacity, 0 to 1, of a step at a point of value `hu`.
    #[inline(always)]
    pub(crate) fn opacity(&self, hu: f32) -> f32 {
        if hu <= self.foot {
            return 0.0;
        }
        let mut through = 1.0 - ((hu - self.lo) * self.scale).min(1.0);
        for _ in self.power..0 {
            through = through.sqrt();
        }
        for _ in 0..self.power {
            through *= through;
        }
        1.0 - through
    }
}

/// The colour of the wall over HU, as linear shares of red, green and blue.
///
/// It is a warm tone like that of mucosa, a little paler where the tissue is denser. As in the paper, no display curve is applied.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Palette {
    /// The colour at and below the first value of [`PALETTE_HU`].
    base: Vec3,
    /// The change of the colour per HU above it.
    slope: Vec3,
}

/// The values between which the colour changes, HU.
pub(crate) const PALETTE_HU: [f32; 2] = [-1000.0, 100.0];
/// The colours at these values.
pub(crate) const PALETTE: [[f32; 3]; 2] = [[0.90, 0.50, 0.40], [0.95, 0.60, 0.50]];

impl Default for Palette {
    fn default() -> Self {
        let [base, top] = PALETTE.map(Vec3::from_array);
        Self { base, slope: (top - base) / (PALETTE_HU[1] - PALETTE_HU[0]) }
    }
}

impl Palette {
    /// Returns the colour at a value, HU.
    #[inline(always)]
    pub(crate) fn colour(&self, hu: f32) -> Vec3 {
        self.base + self.slope * (hu.clamp(PALETTE_HU[0], PALETTE_HU[1]) - PALETTE_HU[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opacity_rises_linearly_and_falls_with_the_step() {
        let wall = TransferFunction::default();
        for power in -4..=2 {
            let ramp = Ramp::new(wall, power);
            assert_eq!(ramp.opacity(-1024.0), 0.0);
            assert_eq!(ramp.opacity(-800.0), 0.0);
            assert_eq!(ramp.opacity(-500.0), 1.0);
            assert_eq!(ramp.opacity(3071.0), 1.0);
            for a in [0.1, 0.25, 0.5, 0.9f64] {
                let expected = 1.0 - (1.0 - a).powf(2f64.powi(power));
                let got = ramp.opacity((-800.0 + 300.0 * a) as f32);
                assert!((f64::from(got) - expected).abs() < 1e-6, "{power} {a}");
            }
        }
    }

    #[test]
    fn colours_follow_the_table() {
        let p = Palette::default();
        assert_eq!(p.colour(-2000.0), Vec3::from_array(PALETTE[0]));
        assert!((p.colour(3000.0) - Vec3::from_array(PALETTE[1])).length() < 1e-6);
        assert!((p.colour(-450.0) - Vec3::new(0.925, 0.55, 0.45)).length() < 1e-6);
    }
}
