//! The sensor: exposure, noise and gamma.

use rayon::prelude::*;

use super::PART;
use super::noise::split;
use crate::math::hash;

/// What turns light into numbers. It reads all pixels at once: the shutter does not roll.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Sensor {
    /// What light is multiplied with; `None` to choose it for each frame, as an endoscope does.
    pub exposure: Option<f64>,
    /// The power of the inverse that is applied: 2.2 for most screens. 1 to 3.
    pub gamma: f64,
    /// Standard deviation of the noise where the sensor is full, as a share of that; it grows with the root of the light.
    pub shot: f64,
    /// Standard deviation of the noise in the dark.
    pub read: f64,
}

impl Default for Sensor {
    fn default() -> Self {
        Self { exposure: None, gamma: 2.2, shot: 0.008, read: 0.001 }
    }
}

/// Steps of the table for gamma, over the root of the light: there, no step has more than two of the 256 numbers.
const STEPS: usize = 4096;
/// Numbers in the table of noise: 12 bits choose one.
const DRAWS: usize = 4096;

/// A sensor with its tables.
#[derive(Debug)]
pub(super) struct Reader {
    sensor: Sensor,
    /// The lowest number in each step.
    lowest: Vec<u8>,
    /// The light from which on a number is shown.
    from: Vec<f32>,
    /// Normal numbers that are equally probable, with mean 0 and deviation 1.
    normal: Vec<f32>,
}

impl Reader {
    pub(super) fn new(sensor: &Sensor) -> Self {
        let from = |n: usize| if n == 0 { 0.0 } else { ((n as f64 - 0.5) / 255.0).powf(sensor.gamma) as f32 };
        let mut from: Vec<f32> = (0..256).map(from).collect();
        from.push(f32::INFINITY);
        let lowest = (0..2 * STEPS).map(|step| {
            let light = (step.min(STEPS) as f32 / STEPS as f32).powi(2);
            (from.partition_point(|f| *f <= light) - 1) as u8
        });
        Self { lowest: lowest.collect(), from, normal: normal(), sensor: sensor.clone() }
    }

    /// Returns the exposure of a frame: so that 90 % of what is lit stays below 0.8, unless it is given.
    pub(super) fn exposure(&self, linear: &[[f32; 3]]) -> f32 {
        if let Some(exposure) = self.sensor.exposure {
            return exposure as f32;
        }
        let mut lit: Vec<f32> = linear.iter().step_by(13).map(|c| c[0]).filter(|l| *l > 0.0).collect();
        if lit.is_empty() {
            return 1.0;
        }
        let n = (lit.len() - 1) * 90 / 100;
        let (_, bright, _) = lit.select_nth_unstable_by(n, f32::total_cmp);
        0.8 / bright.max(1e-12)
    }

    /// Returns the numbers of the light, 8 bits.
    pub(super) fn read(&self, linear: &[[f32; 3]], exposure: f32, seed: u64) -> Vec<[u8; 3]> {
        let (shot, read) = (self.sensor.shot as f32, self.sensor.read as f32);
        let (shot, read, is_noisy) = (shot * shot, read * read, shot > 0.0 || read > 0.0);
        let mut out = vec![[0; 3]; linear.len()];
        out.par_chunks_mut(PART).zip(linear.par_chunks(PART)).enumerate().for_each(|(part, (out, linear))| {
            for (k, (out, light)) in out.iter_mut().zip(linear).enumerate() {
                let draws = if is_noisy { hash::bits(seed, (part * PART + k) as u64) } else { 0 };
                for c in 0..3 {
                    let mut value = light[c] * exposure;
                    if is_noisy {
                        let draw = (draws >> (20 * c)) as usize % DRAWS;
                        value += (shot * value.min(1.0) + read).sqrt() * self.normal[draw];
                    }
                    out[c] = self.number(value);
                }
            }
        });
        out
    }

    /// Returns the nearest of 256 numbers for a light times its exposure.
    #[inline]
    fn number(&self, value: f32) -> u8 {
        // What is not a number is dark: it is cast to 0 and below nothing.
        let value = value.clamp(0.0, 1.0);
        let n = usize::from(self.lowest[split(value.sqrt() * STEPS as f32, 2 * STEPS).0]);
        (n + usize::from(value >= self.from[n + 1])) as u8
    }
}

/// Returns the middles of [`DRAWS`] equally probable parts of the normal distribution, scaled to a deviation of 1.
fn normal() -> Vec<f32> {
    const FINE: usize = 1 << 16;
    let at = |n: usize| 10.0 * (n as f64 + 0.5) / FINE as f64 - 5.0;
    let density: Vec<f64> = (0..FINE).map(|n| (-0.5 * at(n) * at(n)).exp()).collect();
    let all: f64 = density.iter().sum();
    let (mut n, mut below) = (0, 0.0);
    let mut out: Vec<f64> = Vec::with_capacity(DRAWS);
    for k in 0..DRAWS {
        let wanted = (k as f64 + 0.5) / DRAWS as f64 * all;
        while n + 1 < FINE && below + density[n] < wanted {
            below += density[n];
            n += 1;
        }
        out.push(at(n));
    }
    let deviation = (out.iter().map(|x| x * x).sum::<f64>() / DRAWS as f64).sqrt();
    out.iter().map(|x| (x / deviation) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_the_nearest_for_every_gamma() {
        for gamma in [1.0, 1.8, 2.2, 3.0] {
            let reader = Reader::new(&Sensor { gamma, ..Sensor::default() });
            for n in 0..100_000 {
                let value = n as f32 / 99_999.0;
                let value = value * value;
                let exact = 255.0 * f64::from(value).powf(1.0 / gamma);
                assert!((f64::from(reader.number(value)) - exact).abs() < 0.5 + 1e-4, "{gamma} {value} {exact}");
            }
            assert_eq!([f32::NAN, -1.0, f32::INFINITY].map(|x| reader.number(x)), [0, 0, 255]);
        }
    }

    #[test]
    fn noise_has_the_mean_and_the_deviation_that_are_told() {
        let sensor = Sensor { gamma: 1.0, exposure: Some(1.0), shot: 0.05, read: 0.02 };
        let reader = Reader::new(&sensor);
        for light in [0.3_f32, 0.6] {
            let linear = vec![[light; 3]; 200_000];
            for c in 0..3 {
                let shown = reader.read(&linear, 1.0, 77);
                let values = shown.iter().map(|p| f64::from(p[c]) / 255.0);
                let mean = values.clone().sum::<f64>() / linear.len() as f64;
                let square = values.map(|v| (v - mean).powi(2)).sum::<f64>() / linear.len() as f64;
                let told = (0.05_f64.powi(2) * f64::from(light) + 0.02_f64.powi(2)).sqrt();
                assert!((mean - f64::from(light)).abs() < 5e-4 && (square.sqrt() / told - 1.0).abs() < 0.01);
            }
        }
        let again = reader.read(&[[0.5; 3]; 64], 1.0, 77);
        assert!(again == reader.read(&[[0.5; 3]; 64], 1.0, 77) && again != reader.read(&[[0.5; 3]; 64], 1.0, 78));
    }
}
