//! The sensor: exposure, noise and gamma.

use rayon::prelude::*;

use crate::math::hash;

/// Pixels that a thread reads at a time.
const PART: usize = 1 << 12;

/// What turns light into numbers.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Sensor {
    /// What light is multiplied with; `None` to choose it for each frame, as an endoscope does.
    pub exposure: Option<f32>,
    /// The power of the inverse that is applied: 2.2 for most screens.
    pub gamma: f32,
    /// Standard deviation of the noise where the sensor is full, as a share of that; it grows with the root of the light.
    pub shot: f32,
    /// Standard deviation of the noise in the dark.
    pub read: f32,
}

impl Default for Sensor {
    fn default() -> Self {
        Self { exposure: None, gamma: 2.2, shot: 0.008, read: 0.002 }
    }
}

impl Sensor {
    /// Returns the exposure of a frame: so that 95 % of what is lit stays below 0.8, unless it is given.
    pub fn exposure(&self, linear: &[[f32; 3]]) -> f32 {
        if let Some(exposure) = self.exposure {
            return exposure;
        }
        let mut lit: Vec<f32> = linear.iter().step_by(13).map(|c| c[0]).filter(|l| *l > 0.0).collect();
        if lit.is_empty() {
            return 1.0;
        }
        let n = (lit.len() - 1) * 95 / 100;
        let (_, bright, _) = lit.select_nth_unstable_by(n, f32::total_cmp);
        0.8 / bright.max(1e-12)
    }

    /// Returns the numbers of the light, 8 bits.
    pub fn read(&self, linear: &[[f32; 3]], exposure: f32, seed: u64, frame: u64) -> Vec<[u8; 3]> {
        let (power, has_noise) = (1.0 / self.gamma.max(1e-3), self.shot > 0.0 || self.read > 0.0);
        let own = hash::bits(seed, frame);
        let mut out = vec![[0; 3]; linear.len()];
        out.par_chunks_mut(PART).zip(linear.par_chunks(PART)).enumerate().for_each(|(part, (out, linear))| {
            for (k, (out, light)) in out.iter_mut().zip(linear).enumerate() {
                let n = (part * PART + k) as u64;
                for (c, out) in out.iter_mut().enumerate() {
                    let mut value = light[c] * exposure;
                    if has_noise {
                        let deviation = (self.shot * self.shot * value.min(1.0) + self.read * self.read).sqrt();
                        value += deviation * hash::normal(own, 3 * n + c as u64) as f32;
                    }
                    *out = (255.0 * value.clamp(0.0, 1.0).powf(power) + 0.5) as u8;
                }
            }
        });
        out
    }
}
