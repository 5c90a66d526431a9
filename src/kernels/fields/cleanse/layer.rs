//! A layer of tag on a wall: where along a line gas ends and tissue begins.
//!
//! Along the normal of the gas, a film shows `v(u) = A + (F − A)·Φ(u − a) + (T − F)·Φ(u − b)`: gas up to `a`, tag up to `b`, tissue beyond,
//! blurred by the scanner, all in units of its σ. Two unknowns are fitted to samples of the line by damped least squares
//! (Levenberg and Marquardt), with weights that fall off from its middle. Without a wall in reach `b` runs off and the tissue's
//! share is 0; without tag `b` comes down to `a`.

use super::block::Phi;

/// Samples of a line …
pub(super) const SAMPLES: usize = 15;
/// … and their places, σ.
const FROM: f32 = -3.6;
const STEP: f32 = 0.6;
/// Range in which boundaries are searched for, σ: beyond it they are not visible.
const NEAREST: f32 = -5.5;
const FARTHEST: f32 = 7.5;
/// Standard deviation of the weights of a fit, σ, and of those that assess it.
const WEIGHTS: f32 = 2.4;
const NEAR: f32 = 1.2;
/// Tissue and tag between gas and gas are left if they are thinner than this, σ, and of thicker ones this much stays on the far side.
const SLAB: f32 = 6.0;
const WALL: f32 = 2.2;
/// A film between gas and gas is at least this bright, as a share of the tag's contrast to tissue.
const THIN: f32 = 0.4;
/// Steps of the fit.
const ROUNDS: usize = 8;

/// HU of the three materials.
#[derive(Clone, Copy, Debug)]
pub(super) struct Materials {
    pub gas: f32,
    pub tag: f32,
    pub tissue: f32,
}

/// A fitted layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layer {
    /// Where gas ends and tissue begins, σ from the middle of the line.
    pub gas_end: f32,
    pub wall: f32,
    /// How bright its tag is, HU.
    pub tag: f32,
    /// Root mean square residual of the fit, HU.
    pub rest: f32,
}

/// Returns the place of a sample, σ from the middle.
pub(super) fn place(n: usize) -> f32 {
    FROM + STEP * n as f32
}

/// Fits layers. Holds the data that all fits share.
#[derive(Clone, Debug)]
pub(super) struct Fitter {
    pub phi: Phi,
    /// Weights of the samples in a fit, and in its assessment.
    weights: [f32; SAMPLES],
    near: [f32; SAMPLES],
}

impl Fitter {
    pub(super) fn new() -> Self {
        let bell = |sigma: f32| std::array::from_fn(|n| (-0.5 * (place(n) / sigma) * (place(n) / sigma)).exp());
        Self { phi: Phi::new(), weights: bell(WEIGHTS), near: bell(NEAR) }
    }

    /// Fits a layer to the samples of a line, HU, from gas to tissue. `is_within` a piece of tag there is no wall beside it.
    pub(super) fn fit(&self, values: &[f32; SAMPLES], materials: Materials, is_within: bool) -> Layer {
        let Materials { gas, tag, tissue } = materials;
        let middle = 0.5 * (gas + tissue);
        let crossing = |n: usize, level: f32| {
            let (v, w) = (values[n], values[n + 1]);
            place(n) + STEP * ((level - v) / (w - v)).clamp(0.0, 1.0)
        };
        let crossing_down = |end: usize, level: f32| {
            (1..=end).rev().find(|&n| values[n - 1] >= level).map_or(place(end), |n| crossing(n - 1, level))
        };
        // The rising crossing nearest to the middle of the line.
        let rises = (0..SAMPLES - 1).filter(|&n| values[n] < middle && values[n + 1] >= middle);
        let begin = rises.min_by(|&m, &n| crossing(m, middle).abs().total_cmp(&crossing(n, middle).abs()));
        let centre = values[SAMPLES / 2];
        let (mut a, first) = match begin {
            Some(n) => (crossing(n, middle), n + 1),
            None if centre >= middle => (NEAREST, 0),
            // Only gas.
            None => return Layer { gas_end: FARTHEST, wall: FARTHEST, tag, rest: 0.0 },
        };
        // The brightest beyond it, before any gas, and where values have fallen half-way from there to tissue.
        let end = (first..SAMPLES).find(|&n| values[n] < middle - 200.0).unwrap_or(SAMPLES);
        let brightest = (first..end).max_by(|&m, &n| values[m].total_cmp(&values[n])).unwrap_or(first);
        let peak = values[brightest];
        // Gas on both sides: it cannot be determined whether this is a film on a thin wall, or on which side.
        let last = if end < SAMPLES && !is_within { crossing_down(end, middle) } else { FARTHEST + WALL };
        if last - a < SLAB || last <= FARTHEST && peak < tissue + THIN * (tag - tissue) {
            return Layer { gas_end: a, wall: a, tag, rest: 0.0 };
        }
        let farthest = last - WALL;
        let mut b = if peak < tissue + 0.1 * (tag - tissue) {
            a + 0.2
        } else {
            let half = 0.5 * (peak + tissue);
            let falls = (brightest..end - 1).find(|&n| values[n] >= half && values[n + 1] < half);
            falls.map_or(farthest, |n| crossing(n, half))
        };
        b = b.clamp(a, farthest);
        // Tag is patchy: where the layer is wide, it is as bright as it looks.
        let wide = ((b - a - 4.0) / 2.0).clamp(0.0, 1.0);
        let tag = tag + (peak.max(tissue + 0.5 * (tag - tissue).min(100.0)) - tag) * wide;
        // Samples beyond gas of another place, or far beyond the wall, are not used.
        let until = end.min(SAMPLES);
        let from = match begin {
            Some(n) => (0..=n).rev().find(|&m| values[m] > middle).map_or(0, |m| m + 1),
            None => 0,
        };
        let weight = |n: usize, b: f32| if place(n) > b + 2.2 { 0.0 } else { self.weights[n] };
        let model = |u: f32, a: f32, b: f32| {
            let ([pa, da], [pb, db]) = (self.phi.at(u - a), self.phi.at(u - b));
            (gas + (tag - gas) * pa + (tissue - tag) * pb, -(tag - gas) * da, -(tissue - tag) * db)
        };
        let error = |a: f32, b: f32, window: f32| {
            let (mut sum, mut total) = (0.0, 1e-9);
            for (n, v) in values.iter().enumerate().take(until).skip(from) {
                let (w, r) = (weight(n, window), v - model(place(n), a, b).0);
                sum += w * r * r;
                total += w;
            }
            sum / total
        };
        let window = b;
        let mut now = error(a, b, window);
        let mut damp = 1e-2f32;
        for _ in 0..ROUNDS {
            let (mut aa, mut ab, mut bb, mut ra, mut rb) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
            for (n, v) in values.iter().enumerate().take(until).skip(from) {
                let (m, ja, jb) = model(place(n), a, b);
                let (w, r) = (weight(n, window), v - m);
                aa += w * ja * ja;
                ab += w * ja * jb;
                bb += w * jb * jb;
                ra += w * ja * r;
                rb += w * jb * r;
            }
            // Damped by the slope of an edge of 1000 HU too, so that a boundary that does not show stays.
            let (da, db) = (aa * (1.0 + damp) + 1e3, bb * (1.0 + damp) + 1e3);
            let determinant = da * db - ab * ab;
            if determinant <= 0.0 {
                damp *= 10.0;
                continue;
            }
            let (sa, sb) = ((db * ra - ab * rb) / determinant, (da * rb - ab * ra) / determinant);
            let to_a = (a + sa.clamp(-1.5, 1.5)).clamp(NEAREST, FARTHEST);
            let to_b = (b + sb.clamp(-1.5, 1.5)).clamp(to_a, farthest.max(to_a));
            let then = error(to_a, to_b, window);
            if then < now {
                let small = (to_a - a).abs() + (to_b - b).abs() < 1e-3;
                (a, b, now) = (to_a, to_b, then);
                damp = (0.2 * damp).max(1e-4);
                if small {
                    break;
                }
            } else {
                damp *= 8.0;
            }
        }
        // What is not explained near the middle, where the answer is used.
        let (mut sum, mut total) = (0.0, 1e-9);
        for (n, v) in values.iter().enumerate().take(until).skip(from) {
            let (w, r) = (self.near[n], v - model(place(n), a, b).0);
            sum += w * r * r;
            total += w;
        }
        Layer { gas_end: a, wall: b, tag, rest: (sum / total).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;

    const MATERIALS: Materials = Materials { gas: -1000.0, tag: 600.0, tissue: 40.0 };

    fn line(a: f32, b: f32, noise: f64, seed: u64) -> [f32; SAMPLES] {
        let phi = Phi::new();
        std::array::from_fn(|n| {
            let u = place(n);
            let v = -1000.0 + 1600.0 * phi.at(u - a)[0] - 560.0 * phi.at(u - b)[0];
            v + (noise * hash::normal(seed, n as u64)) as f32
        })
    }

    #[test]
    fn layers_of_any_thickness_are_found_where_they_are() {
        let fitter = Fitter::new();
        for a in [-2.0, -0.7, 0.0, 1.3] {
            for thickness in [0.8, 1.5, 2.5, 4.0] {
                let found = fitter.fit(&line(a, a + thickness, 0.0, 0), MATERIALS, false);
                if a + thickness < 3.0 {
                    let off = (found.gas_end - a).abs().max((found.wall - a - thickness).abs());
                    assert!(off < 0.08 && found.rest < 10.0, "{a} + {thickness}: {found:?}");
                }
            }
        }
    }

    #[test]
    fn noise_moves_the_wall_by_a_tenth_of_the_blur() {
        let fitter = Fitter::new();
        let square: f32 =
            (0..200).map(|seed| (fitter.fit(&line(-0.8, 0.9, 22.0, seed), MATERIALS, false).wall - 0.9).powi(2)).sum();
        let off = (square / 200.0).sqrt();
        println!("the wall is {off:.3} σ off");
        assert!(off < 0.15);
    }

    #[test]
    fn a_bare_wall_stays_and_tag_without_a_wall_has_none() {
        let fitter = Fitter::new();
        for a in [-1.5, 0.0, 1.0] {
            let bare = fitter.fit(&line(a, a, 0.0, 0), MATERIALS, false);
            assert!((bare.wall - a).abs() < 0.1 && bare.wall - bare.gas_end < 0.1, "{bare:?}");
            let thick = fitter.fit(&line(a, 30.0, 0.0, 0), MATERIALS, false);
            assert!(thick.wall > 5.0 && (thick.gas_end - a).abs() < 0.1, "{thick:?}");
        }
        // Within tag, far from gas: the wall beyond it.
        let inside = fitter.fit(&line(-9.0, 0.4, 0.0, 0), MATERIALS, false);
        assert!((inside.wall - 0.4).abs() < 0.05, "{inside:?}");
        let gas = fitter.fit(&[-990.0; SAMPLES], MATERIALS, false);
        assert_eq!((gas.wall, gas.rest), (FARTHEST, 0.0));
    }

    #[test]
    fn a_thin_wall_between_gas_and_gas_is_left() {
        let fitter = Fitter::new();
        let slab = |film: f32, wall: f32| -> [f32; SAMPLES] {
            std::array::from_fn(|n| {
                let at = |u: f32| fitter.phi.at(place(n) - u)[0];
                -1000.0 + 1600.0 * at(-1.0) - 560.0 * at(film - 1.0) - 1040.0 * at(film + wall - 1.0)
            })
        };
        let left = fitter.fit(&slab(2.0, 3.0), MATERIALS, false);
        assert_eq!(left.wall, left.gas_end, "{left:?}");
        let within = fitter.fit(&slab(2.0, 3.0), MATERIALS, true);
        assert!((within.wall - 1.0).abs() < 0.4, "{within:?}");
        // A dry fold is one, with or without tagged fluid nearby.
        let fold = fitter.fit(&slab(0.0, 3.0), MATERIALS, false);
        assert_eq!(fold.wall, fold.gas_end);
    }

    #[test]
    fn what_is_no_layer_gives_numbers_all_the_same() {
        let fitter = Fitter::new();
        for seed in 0..300 {
            let values = std::array::from_fn(|n| (hash::normal(seed, n as u64) * 3000.0) as f32);
            for tag in [140.0, 600.0, 3000.0] {
                let found = fitter.fit(&values, Materials { tag, ..MATERIALS }, false);
                assert!(found.rest.is_finite() && (NEAREST..=FARTHEST).contains(&found.gas_end), "{found:?}");
                assert!((found.gas_end..=FARTHEST).contains(&found.wall), "{found:?}");
            }
        }
        for hu in [-1024.0, -480.0, 40.0, 600.0, 3071.0] {
            assert!(fitter.fit(&[hu; SAMPLES], MATERIALS, false).wall.is_finite());
        }
    }
}
