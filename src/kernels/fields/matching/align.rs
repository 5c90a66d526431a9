//! Which row of one wall belongs to which of another, and how far they are turned: a hidden Markov model over both.
//!
//! The state at row i of the first wall is a row j of the second and a turn t. From row to row, j grows by 0 to 4 and t changes by at most
//! one angle. A state is as likely as the rows resemble each other, turned by t. Forward and backward sums (Rabiner, Proc. IEEE 77(2), 1989)
//! give the probability of each state given all rows, and so the best pair, its turn, and how sure both are.

use rayon::prelude::*;

use super::image::{ANGLES, STEP_MM, WallImage};

/// Largest number of rows by which j grows.
const MOST: usize = 4;
/// Probabilities of a growth by 0, 1, …: a colon lies stretched by ± 15 to 20 % over a few centimetres.
const GROWTH: [f64; MOST + 1] = [0.12, 0.70, 0.13, 0.04, 0.01];
/// The same where either wall is collapsed: its line is a guess, and may be much too short or too long.
const LOOSE: [f64; MOST + 1] = [0.25, 0.40, 0.20, 0.10, 0.05];
/// Probability that the turn changes by one angle to either side.
const TURN: f64 = 0.04;
/// Rows of the second wall that are considered lie within this share of its length from where plain distance puts them, …
const BAND: f64 = 0.14;
/// … and at least this far, mm.
const LEAST_BAND_MM: f64 = 60.0;
/// The log-likelihood of neighbouring rows is not independent: folds are longer than a row. It counts by this share.
const SHARE: f64 = 0.18;
/// Standard deviation of what is left of a wall between two scans, as a share of the radius.
const SPREAD: f64 = 0.11;
/// A difference beyond this many standard deviations counts no more: what only one scan shows, such as a pool, must not decide.
const ROBUST: f64 = 2.5;
/// Standard deviation of the caliber between two scans, as a logarithm.
const CALIBER_SPREAD: f64 = 0.35;
/// Mean of a row of resembling walls: what a row without a wall is taken to have.
const BLANK: f64 = 0.55;
/// Window over which the wall is compared with its own mean, mm.
const WINDOW_MM: f64 = 50.0;

/// What is known of a row of the first wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Paired {
    /// Row of the second wall, the median.
    pub row: f64,
    /// Half the width of the stretch that contains it with a probability of 90 %, rows.
    pub uncertain: f64,
    /// Angle in the second wall minus that in the first, radians.
    pub turn: f64,
    /// Length of the mean direction of the turn, 0 to 1: 1 is certain.
    pub sure: f64,
}

/// The features of a wall.
struct Features {
    /// Logarithm of the radius without its mean nearby, [`ANGLES`] for each row.
    relief: Vec<f32>,
    /// Logarithm of the mean radius of each row.
    caliber: Vec<f32>,
}

impl Features {
    fn new(image: &WallImage) -> Self {
        let rows = image.rows();
        let caliber: Vec<f32> =
            (0..rows).map(|n| (image.row(n).iter().sum::<f32>() / ANGLES as f32).max(1.0).ln()).collect();
        let half = (0.5 * WINDOW_MM / STEP_MM) as usize;
        let relief = (0..rows)
            .into_par_iter()
            .flat_map_iter(|n| {
                let near = n.saturating_sub(half)..(n + half + 1).min(rows);
                let (sum, count) = near
                    .filter(|&m| image.is_open[m])
                    .fold((0.0, 0.0), |(sum, count), m| (sum + caliber[m], count + 1.0));
                let mean: f32 = if count > 0.0 { sum / count } else { caliber[n] };
                image.row(n).iter().map(move |r| r.max(1.0).ln() - mean)
            })
            .collect();
        Self { relief, caliber }
    }

    fn row(&self, n: usize) -> &[f32] {
        &self.relief[n * ANGLES..][..ANGLES]
    }
}

/// Pairs the rows of `a` with those of `b`. Returns one for each row of `a`, and the logarithm of the probability of all that is seen, up to a
/// constant for the same two walls.
pub(super) fn align(a: &WallImage, b: &WallImage) -> (Vec<Paired>, f64) {
    let (rows, others) = (a.rows(), b.rows());
    if rows == 0 || others == 0 {
        return (Vec::new(), 0.0);
    }
    let (fa, fb) = (Features::new(a), Features::new(b));
    let stretch = if rows > 1 { (others - 1) as f64 / (rows - 1) as f64 } else { 0.0 };
    let reach = (BAND * others as f64).max(LEAST_BAND_MM / STEP_MM).ceil() as usize;
    let width = (2 * reach + 1).min(others);
    let first = |i: usize| {
        let middle = (i as f64 * stretch).round() as usize;
        middle.saturating_sub(reach).min(others - width)
    };
    // The likelihood of each state of each row, the largest of a row being 1.
    let states = width * ANGLES;
    let (likely, most): (Vec<Vec<f32>>, Vec<f64>) = (0..rows)
        .into_par_iter()
        .map(|i| {
            let mut row = vec![0f32; states];
            for (k, out) in row.chunks_exact_mut(ANGLES).enumerate() {
                let j = first(i) + k;
                if !a.is_open[i] || !b.is_open[j] {
                    out.fill(-BLANK as f32);
                    continue;
                }
                likeness(fa.row(i), fb.row(j), fa.caliber[i] - fb.caliber[j], out);
            }
            let most = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let ends = (i == 0 || i == rows - 1).then_some(());
            row.iter_mut().enumerate().for_each(|(n, l)| {
                let mut log = f64::from(*l - most) * SHARE * ANGLES as f64;
                // Both lines begin and end at the colon's ends, give or take.
                if ends.is_some() {
                    let off = (first(i) + n / ANGLES) as f64 - i as f64 * stretch;
                    log -= 0.5 * (off * STEP_MM / 15.0).powi(2);
                }
                *l = log.exp() as f32;
            });
            (row, f64::from(most) * SHARE * ANGLES as f64)
        })
        .unzip();
    let mut evidence: f64 = most.iter().sum();
    let is_loose = |i: usize, j: usize| !a.is_open[i] || !b.is_open[j];
    // Forward sums, each row scaled to a sum of 1.
    let mut forward = vec![0f32; rows * states];
    let mut now = likely[0].clone();
    evidence += scale(&mut now).ln();
    forward[..states].copy_from_slice(&now);
    let mut turned = vec![0f32; states];
    for i in 1..rows {
        spread_turns(&now, &mut turned);
        let (old, new) = (first(i - 1), first(i));
        now.fill(0.0);
        for k in 0..width {
            let j = new + k;
            let growth = if is_loose(i, j) { &LOOSE } else { &GROWTH };
            let out = &mut now[k * ANGLES..][..ANGLES];
            for (grown, &p) in growth.iter().enumerate() {
                if let Some(from) = j.checked_sub(grown).and_then(|j| j.checked_sub(old)).filter(|&f| f < width) {
                    let p = p as f32;
                    out.iter_mut().zip(&turned[from * ANGLES..][..ANGLES]).for_each(|(o, f)| *o += p * f);
                }
            }
        }
        now.iter_mut().zip(&likely[i]).for_each(|(n, l)| *n *= l);
        evidence += scale(&mut now).ln();
        forward[i * states..][..states].copy_from_slice(&now);
    }
    // Backward sums; with the forward ones they are the probabilities.
    let mut paired = vec![Paired { row: 0.0, uncertain: 0.0, turn: 0.0, sure: 0.0 }; rows];
    let mut after = vec![1f32; states];
    for i in (0..rows).rev() {
        if i + 1 < rows {
            let mut weighed = after.clone();
            weighed.iter_mut().zip(&likely[i + 1]).for_each(|(w, l)| *w *= l);
            spread_turns(&weighed, &mut turned);
            let (here, next) = (first(i), first(i + 1));
            after.fill(0.0);
            for k in 0..width {
                let j = here + k;
                let out = &mut after[k * ANGLES..][..ANGLES];
                for grown in 0..=MOST {
                    let to = j + grown;
                    if let Some(at) = to.checked_sub(next).filter(|&t| t < width) {
                        let p = if is_loose(i + 1, to) { LOOSE[grown] } else { GROWTH[grown] } as f32;
                        out.iter_mut().zip(&turned[at * ANGLES..][..ANGLES]).for_each(|(o, f)| *o += p * f);
                    }
                }
            }
            scale(&mut after);
        }
        paired[i] = read(&forward[i * states..][..states], &after, first(i));
    }
    // Medians follow one another but for rounding.
    for i in 1..rows {
        paired[i].row = paired[i].row.max(paired[i - 1].row);
    }
    (paired, evidence)
}

/// Writes how much two rows resemble each other, turned by each angle: 0 is the most.
fn likeness(a: &[f32], b: &[f32], caliber: f32, out: &mut [f32]) {
    let by_caliber = 0.5 * (f64::from(caliber) / CALIBER_SPREAD).powi(2).min(ROBUST * ROBUST);
    let most = (ROBUST * ROBUST) as f32;
    for (turn, out) in out.iter_mut().enumerate() {
        let mut sum = 0f32;
        for (n, x) in a.iter().enumerate() {
            let d = (x - b[(n + turn) % ANGLES]) / SPREAD as f32;
            sum += (d * d).min(most);
        }
        *out = -(0.5 * f64::from(sum) / ANGLES as f64 + by_caliber / ANGLES as f64) as f32;
    }
}

/// Lets each turn change by an angle to either side.
fn spread_turns(from: &[f32], to: &mut [f32]) {
    let (stay, turn) = ((1.0 - 2.0 * TURN) as f32, TURN as f32);
    for (from, to) in from.chunks_exact(ANGLES).zip(to.chunks_exact_mut(ANGLES)) {
        for (t, to) in to.iter_mut().enumerate() {
            *to = stay * from[t] + turn * (from[(t + 1) % ANGLES] + from[(t + ANGLES - 1) % ANGLES]);
        }
    }
}

/// Scales values to a sum of 1, and returns the sum before. If all are 0, or if they are too small to be told from it, all states are as
/// likely.
fn scale(values: &mut [f32]) -> f64 {
    let sum: f64 = values.iter().map(|&v| f64::from(v)).sum();
    if sum > 1e-30 {
        let by = (1.0 / sum) as f32;
        values.iter_mut().for_each(|v| *v *= by);
    } else {
        values.fill(1.0 / values.len() as f32);
    }
    sum.max(1e-30)
}

/// Reads the pair of a row from its forward and backward sums.
fn read(forward: &[f32], after: &[f32], first: usize) -> Paired {
    let mut by_row: Vec<f64> = Vec::with_capacity(forward.len() / ANGLES);
    let mut by_turn = [0f64; ANGLES];
    for (f, a) in forward.chunks_exact(ANGLES).zip(after.chunks_exact(ANGLES)) {
        let mut sum = 0.0;
        for (t, (f, a)) in f.iter().zip(a).enumerate() {
            let p = f64::from(*f) * f64::from(*a);
            by_turn[t] += p;
            sum += p;
        }
        by_row.push(sum);
    }
    let all: f64 = by_row.iter().sum();
    if all <= 0.0 || !all.is_finite() {
        let middle = 0.5 * (by_row.len() as f64 - 1.0);
        return Paired { row: first as f64 + middle, uncertain: middle, turn: 0.0, sure: 0.0 };
    }
    let quantile = |share: f64| {
        let mut left = share * all;
        for (k, p) in by_row.iter().enumerate() {
            if *p >= left && *p > 0.0 {
                // A row stands for the half of a step to either side.
                return k as f64 - 0.5 + left / p;
            }
            left -= p;
        }
        by_row.len() as f64 - 1.0
    };
    let [low, row, high] = [0.05, 0.5, 0.95].map(quantile);
    let (mut x, mut y) = (0.0, 0.0);
    for (t, p) in by_turn.iter().enumerate() {
        let angle = std::f64::consts::TAU * t as f64 / ANGLES as f64;
        (x, y) = (x + p * angle.cos(), y + p * angle.sin());
    }
    let uncertain = (row - low).max(high - row);
    Paired { row: first as f64 + row, uncertain, turn: y.atan2(x), sure: (x.hypot(y) / all).min(1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::frames::Frame;
    use crate::math::hash;
    use glam::DVec3;

    /// A wall with folds and polyps of its own: smooth noise over distance and angle, mm.
    fn relief(mm: f64, angle: f64) -> f64 {
        let waves = (0..60).map(|n| {
            let draw = |k: u64| (hash::bits(n, k) >> 11) as f64 / (1u64 << 53) as f64;
            let (length, around) = (14.0 + 30.0 * draw(1), (draw(2) * 4.0).floor());
            (mm / length * std::f64::consts::TAU + 6.3 * draw(3)).sin() * (around * angle + 6.3 * draw(4)).cos()
        });
        0.35 * waves.sum::<f64>() + 15.0
    }

    /// The wall whose row n is that of `at(n)`, mm, turned by `turn(n)`; rows for which `is_open` is false have none.
    fn wall(
        rows: usize,
        at: impl Fn(f64) -> f64,
        turn: impl Fn(f64) -> f64,
        is_open: impl Fn(f64) -> bool,
    ) -> WallImage {
        let mm = |n: usize| n as f64 * STEP_MM;
        let frame = Frame { at: DVec3::ZERO, tangent: DVec3::Z, normal: DVec3::X };
        let angle = |t: usize| std::f64::consts::TAU * t as f64 / ANGLES as f64;
        WallImage {
            frames: vec![frame; rows],
            radius_mm: (0..rows * ANGLES)
                .map(|n| {
                    let s = mm(n / ANGLES);
                    if is_open(s) { relief(at(s), angle(n % ANGLES) - turn(s)) as f32 } else { 1.0 }
                })
                .collect(),
            is_open: (0..rows).map(|n| is_open(mm(n))).collect(),
        }
    }

    fn off(a: f64, b: f64) -> f64 {
        let turn = (a - b) / std::f64::consts::TAU;
        ((turn - turn.round()) * 360.0).abs()
    }

    #[test]
    fn a_wall_that_is_stretched_and_turned_is_found_again_and_so_is_how_sure_that_is() {
        // Row s of the second wall is at s·1.06 + waves of the first, within ± 15 %.
        let at = |s: f64| s * 0.94 + 9.0 * (s / 60.0).sin();
        let turn = |s: f64| 0.5 + 0.4 * (s / 150.0).sin();
        let (a, b) = (wall(430, |s| s, |_| 0.0, |_| true), wall(440, at, turn, |_| true));
        let (pairs, _) = align(&a, &b);
        let mut errors = Vec::new();
        for (n, pair) in pairs.iter().enumerate().skip(20).take(380) {
            let found = pair.row * STEP_MM;
            errors.push((at(found) - n as f64 * STEP_MM).abs());
            assert!(off(pair.turn, turn(found)) < 15.0 && pair.sure > 0.8, "{n}: {pair:?}");
            assert!(pair.uncertain * STEP_MM < 8.0, "{n}: {pair:?}");
        }
        errors.sort_by(f64::total_cmp);
        assert!(errors[190] < 1.0 && errors[360] < 3.0, "{} {}", errors[190], errors[360]);
    }

    #[test]
    fn beside_a_collapsed_stretch_it_is_found_again_and_in_it_it_is_unsure() {
        let closed = |s: f64| (300.0..360.0).contains(&s);
        let (a, b) = (
            wall(400, |s| s, |_| 0.0, |_| true),
            wall(385, |s| s + if s > 330.0 { 30.0 } else { 0.0 }, |_| 1.0, |s| !closed(s)),
        );
        let (pairs, _) = align(&a, &b);
        let error = |mm: f64| {
            let pair = pairs[(mm / STEP_MM) as usize];
            let truth = if mm > 360.0 { mm - 30.0 } else { mm };
            ((pair.row * STEP_MM - truth).abs(), pair.uncertain * STEP_MM)
        };
        assert!(error(250.0).0 < 3.0 && error(450.0).0 < 3.0, "{:?} {:?}", error(250.0), error(450.0));
        assert!(error(330.0).1 > 2.0 * error(250.0).1, "{:?} {:?}", error(330.0), error(250.0));
    }

    /// Walls that have nothing in common, are the same, blank or tiny: finite, in order, and unsure where nothing is known.
    #[test]
    fn whatever_the_walls_the_rows_are_in_order() {
        let plain = |rows: usize, open: bool| wall(rows, |_| 0.0, |_| 0.0, move |_| open);
        let rough = |rows: usize, shift: f64| wall(rows, move |s| s + shift, |_| 0.0, |_| true);
        for (a, b) in [
            (rough(200, 0.0), rough(200, 5000.0)),
            (rough(100, 0.0), rough(400, 0.0)),
            (rough(400, 0.0), rough(1, 0.0)),
            (rough(1, 0.0), rough(3, 0.0)),
            (plain(150, true), plain(150, true)),
            (plain(150, false), plain(100, false)),
            (rough(2, 0.0), plain(300, false)),
        ] {
            let (pairs, _) = align(&a, &b);
            assert_eq!(pairs.len(), a.rows());
            let last = b.rows() as f64 - 0.5;
            assert!(pairs.iter().all(|p| p.row.is_finite() && (-0.5..=last).contains(&p.row)), "{pairs:?}");
            assert!(pairs.iter().all(|p| p.uncertain >= 0.0 && p.turn.is_finite() && (0.0..=1.0).contains(&p.sure)));
            assert!(pairs.windows(2).all(|w| w[0].row <= w[1].row));
        }
        assert!(align(&plain(150, true), &plain(150, true)).0[75].uncertain * STEP_MM > 10.0);
        assert!(align(&rough(0, 0.0), &rough(3, 0.0)).0.is_empty());
    }

    #[test]
    fn a_wall_matches_itself_without_error() {
        let a = wall(300, |s| s, |_| 0.0, |_| true);
        let (pairs, _) = align(&a, &a);
        assert!(pairs.iter().enumerate().all(|(n, p)| (p.row - n as f64).abs() < 0.6 && p.turn.abs() < 0.05));
    }
}
