//! Whether the values of a scan are HU, judged by where its air lies.

use std::fmt;

use rayon::prelude::*;

use super::{AIR_HU, Volume};

/// Minimum number of voxels for a judgement: fewer are not a scan.
const LEAST_VOXELS: usize = 4096;
/// Number of voxels of the sample that is enough for most scans.
const SAMPLE: usize = 1 << 20;
/// HU of air and gas, with noise and partial volume.
const AIR: std::ops::Range<i32> = -1150..-700;
/// HU of the body without bones.
const BODY: std::ops::Range<i32> = -250..400;
/// Half the width of the window that the voxels of a mode are counted in, HU.
const HALF: i32 = 40;

/// How values differ from HU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Oddity {
    /// Gas lies elsewhere: its value, and that minus −1000.
    Offset {
        /// The value of gas.
        gas: i32,
        /// How much too high the values are.
        by: i32,
    },
    /// Values lie within this, 0 or −1, and 1.
    Unit(i16),
    /// Values lie within 0 and 255.
    Grey,
    /// There is no air: minimum and maximum value.
    NoAir(i16, i16),
}

impl fmt::Display for Oddity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Offset { gas, by } => {
                let way = if *by > 0 { "too high" } else { "too low" };
                write!(f, "its air is near {gas}, not -1000 HU: values are {way} by about {}", by.abs())
            }
            Self::Unit(low) => {
                write!(f, "no voxel near -1000 HU: values lie within {low} and 1, as those of a normalised scan do")
            }
            Self::Grey => f.write_str("no voxel near -1000 HU: values lie within 0 and 255, as grey levels do"),
            Self::NoAir(low, high) => write!(f, "no voxel near -1000 HU: values lie within {low} and {high}"),
        }
    }
}

impl Oddity {
    /// What to do where a colon was asked for. Values without air may be HU, of a scan without gas.
    pub fn hint(self) -> &'static str {
        if self.is_clear() { "give a scan in HU" } else { "give a scan in HU, with gas in the colon" }
    }

    /// True if the values are clearly not HU, not only without air.
    pub fn is_clear(self) -> bool {
        !matches!(self, Self::NoAir(..))
    }
}

/// Returns how the values of a scan differ from HU; `None` if air lies where it does in HU.
///
/// A sample of rows is counted first. Only if that has no air, all voxels are.
pub fn oddity(volume: &Volume) -> Option<Oddity> {
    let data = volume.data();
    if data.len() < LEAST_VOXELS {
        return None;
    }
    let row = volume.grid().dims()[0];
    // An odd step meets other rows in each slice.
    let step = (data.len() / SAMPLE) | 1;
    let mut sample = Histogram::default();
    data.chunks(row).step_by(step).for_each(|row| sample.add(row));
    match sample.judge() {
        Verdict::Hu => return None,
        verdict if step == 1 => return verdict.oddity(),
        _ => {}
    }
    let add = |mut h: Histogram, part: &[i16]| {
        h.add(part);
        h
    };
    data.par_chunks(1 << 20).fold(Histogram::default, add).reduce(Histogram::default, Histogram::plus).judge().oddity()
}

enum Verdict {
    Hu,
    Odd(Oddity),
}

impl Verdict {
    fn oddity(self) -> Option<Oddity> {
        match self {
            Self::Hu => None,
            Self::Odd(oddity) => Some(oddity),
        }
    }
}

/// Numbers of voxels of each value.
struct Histogram(Vec<u32>);

impl Default for Histogram {
    fn default() -> Self {
        Self(vec![0; 1 << 16])
    }
}

impl Histogram {
    fn add(&mut self, values: &[i16]) {
        for v in values {
            let n = &mut self.0[usize::from(v.cast_unsigned() ^ 0x8000)];
            *n = n.saturating_add(1);
        }
    }

    fn plus(mut self, other: Self) -> Self {
        self.0.iter_mut().zip(other.0).for_each(|(a, b)| *a = a.saturating_add(b));
        self
    }

    /// Number of voxels of a range of values.
    fn count(&self, range: std::ops::Range<i32>) -> u64 {
        let at = |v: i32| (v + 32768).clamp(0, 1 << 16) as usize;
        self.0[at(range.start)..at(range.end).max(at(range.start))].iter().map(|n| u64::from(*n)).sum()
    }

    fn judge(mut self) -> Verdict {
        // What is exactly −1024 may be padding that became air, whatever the other values are.
        let at = (i32::from(AIR_HU) + 32768) as usize;
        let padding = std::mem::take(&mut self.0[at]);
        let all = self.count(-32768..32768);
        if all == 0 {
            return Verdict::Hu;
        }
        let offset = self.offset(all);
        let air = self.count(AIR);
        let is_air = 10_000 * air >= all || (air > 0 && padding > 0);
        if is_air && (20 * self.count(BODY) >= all || offset.is_none()) {
            return Verdict::Hu;
        }
        let value = |k: usize| k as i32 - 32768;
        let low = self.0.iter().position(|n| *n > 0).map_or(0, value);
        let high = self.0.iter().rposition(|n| *n > 0).map_or(0, value);
        Verdict::Odd(match offset {
            Some(odd) => odd,
            None if padding > 0 => return Verdict::Hu,
            None if low >= -1 && high <= 1 => Oddity::Unit(low as i16),
            None if low >= 0 && high <= 255 => Oddity::Grey,
            None => Oddity::NoAir(low as i16, high as i16),
        })
    }

    /// Finds gas and the body around it elsewhere than HU have them.
    fn offset(&self, all: u64) -> Option<Oddity> {
        let window = |v: i32| self.count(v - HALF..v + HALF + 1);
        let step = HALF / 2;
        // The lowest mode of a hundredth of the voxels …
        let bins = || (-32768 + HALF..32768 - HALF).step_by(step as usize);
        let first = bins().find(|v| 100 * window(*v) >= all)?;
        let gas = (first..first + 3 * HALF).step_by(8).max_by_key(|v| (window(*v), -v))?;
        let gas = self.middle(gas - HALF..gas + HALF + 1);
        // … and as much as the body makes of a scan as far above it as tissue is above gas.
        let body = self.count(gas + 700..gas + 1450);
        let by = gas + 1000;
        let spread = bins().filter(|v| 1000 * window(*v) >= all).max().unwrap_or(gas) - gas;
        (by.abs() > 200 && 10 * body >= all && spread > 800).then_some(Oddity::Offset { gas, by })
    }

    /// The median of the voxels of a range.
    fn middle(&self, range: std::ops::Range<i32>) -> i32 {
        let half = self.count(range.clone()).div_ceil(2);
        let mut seen = 0;
        range
            .clone()
            .find(|v| {
                seen += self.count(*v..v + 1);
                seen >= half
            })
            .unwrap_or(range.start)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::math::hash::normal;
    use crate::volume::Grid;

    /// A body of fat and muscle with gas and some bone, `a` of it air, and what is made of its HU.
    fn scan(air: usize, map: impl Fn(f64) -> f64) -> Volume {
        let grid = Grid::new([64, 64, 16], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let hu = |i: usize| match i % 100 {
            k if k < air => -1000.0,
            0..50 => -90.0,
            50..97 => 50.0,
            _ => 700.0,
        };
        let data = (0..grid.len()).map(|i| map(hu(i) + 15.0 * normal(3, i as u64)).round() as i16).collect();
        Volume::new(grid, data)
    }

    #[test]
    fn hu_are_hu_with_much_air_little_or_all_of_it_clamped() {
        for air in [1, 5, 40, 80, 95] {
            assert_eq!(oddity(&scan(air, |v| v)), None, "{air} %");
            assert_eq!(oddity(&scan(air, |v| if v < -900.0 { -1024.0 } else { v })), None, "{air} %, clamped");
        }
    }

    #[test]
    fn other_values_are_told() {
        for air in [2, 20, 60] {
            for by in [1024.0, 1000.0, -1024.0, 2048.0] {
                let found = oddity(&scan(air, |v| v + by));
                let near = |o: Oddity| matches!(o, Oddity::Offset { by: b, .. } if (f64::from(b) - by).abs() < 30.0);
                assert!(found.is_some_and(near), "{air} %, {by}: {found:?}");
            }
            // Padding that became air hides nothing.
            let padded = oddity(&scan(air, |v| if v > 690.0 { -1024.0 } else { v + 1024.0 }));
            assert!(matches!(padded, Some(Oddity::Offset { .. })), "{padded:?}");
        }
        assert_eq!(oddity(&scan(20, |v| ((v + 1000.0) / 2000.0).clamp(0.0, 1.0))), Some(Oddity::Unit(0)));
        assert_eq!(oddity(&scan(20, |v| ((v + 1000.0) / 8.0).clamp(0.0, 255.0))), Some(Oddity::Grey));
        let without = oddity(&scan(0, |v| v));
        assert!(without.is_some_and(|o| !o.is_clear() && o.to_string().starts_with("no voxel near -1000 HU")));
    }
}
