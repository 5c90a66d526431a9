//! How slices lie along their normal: evenly, or as those of several passes.

/// Slices closer than this are at the same position, mm.
pub(crate) const SAME_PLACE: f64 = 1e-3;
/// Maximum deviation of a step from the usual one: a fraction of it, and the effect of rounding both written positions to a tenth
/// of a millimetre, mm. At most a fraction of the step.
const UNEVEN: (f64, f64, f64) = (0.1, 0.12, 0.4);
/// Maximum deviation when passes are distinguished from gaps, as a fraction of the usual step.
const TIGHT: f64 = 0.25;
/// Minimum number of slices of a pass that is recognised by its spacing alone.
const LEAST_SLICES: usize = 4;
/// Maximum number of passes that are distinguished by spacing alone.
const MOST_PASSES: usize = 4;

fn room(step: f64) -> f64 {
    (UNEVEN.0 * step + UNEVEN.1).min(UNEVEN.2 * step)
}

/// Returns the number of steps between neighbours that differ from the usual one, for positions in ascending order, mm. Slices at
/// one position count too.
pub(crate) fn faults(along: &[f64]) -> usize {
    let steps: Vec<f64> = along.windows(2).map(|w| w[1] - w[0]).collect();
    let mut apart: Vec<f64> = steps.iter().copied().filter(|d| *d >= SAME_PLACE).collect();
    apart.sort_by(f64::total_cmp);
    let Some(usual) = apart.get(apart.len().saturating_sub(1) / 2) else { return steps.len() };
    steps.iter().filter(|d| **d < SAME_PLACE || (**d - usual).abs() > room(*usual)).count()
}

/// True if positions in ascending order, mm, are those of several even passes that overlap, and not of one that lacks a few slices.
pub(crate) fn several(along: &[f64]) -> bool {
    let mut steps: Vec<f64> = along.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    let Some(usual) = steps.get(steps.len().saturating_sub(1) / 2) else { return false };
    let room = room(*usual).min(TIGHT * usual);
    !lacks_few(along, *usual, room) && passes(along, room, MOST_PASSES)
}

/// True if positions are those of one even pass without a few slices: few steps are multiples of the usual one, and the others
/// equal it. Where two passes begin one after the other, or end so, steps are doubled there.
fn lacks_few(along: &[f64], usual: f64, room: f64) -> bool {
    let steps: Vec<f64> = along.windows(2).map(|w| w[1] - w[0]).collect();
    let wide = |d: &f64| *d > usual + room;
    let multiples = steps.iter().all(|d| (d - (d / usual).round().max(1.0) * usual).abs() <= room);
    let few = 4 * steps.iter().filter(|d| wide(d)).count() < steps.len();
    let at_ends = steps.iter().take(2).all(wide) || steps.iter().rev().take(2).all(wide);
    multiples && few && !at_ends
}

fn passes(along: &[f64], room: f64, most: usize) -> bool {
    if most < 2 || along.len() < 2 * LEAST_SLICES {
        return false;
    }
    (1..=MOST_PASSES).any(|next| {
        let (first, rest) = chain(along, along[next] - along[0], room);
        let (Some(end), Some(begin)) = (first.last(), rest.first()) else { return false };
        let long = first.len() >= LEAST_SLICES && rest.len() >= LEAST_SLICES;
        long && begin < end && (faults(&rest) == 0 || passes(&rest, room, most - 1))
    })
}

/// Follows the first position in steps of `step` (with `room` for each, mm), and returns what it meets and what it leaves.
fn chain(along: &[f64], step: f64, room: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut taken, mut left) = (vec![along[0]], Vec::with_capacity(along.len()));
    let mut at = 1;
    while at < along.len() {
        let wanted = taken[taken.len() - 1] + step;
        let nearest = |k: usize| (along[k] - wanted).abs();
        if nearest(at) > room || along.get(at + 1).is_some_and(|_| nearest(at + 1) < nearest(at)) {
            left.push(along[at]);
        } else {
            taken.push(along[at]);
        }
        at += 1;
    }
    (taken, left)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(from: f64, step: f64, n: usize) -> Vec<f64> {
        (0..n).map(|k| from + step * k as f64).collect()
    }

    fn mixed(parts: &[Vec<f64>]) -> Vec<f64> {
        let mut all = parts.concat();
        all.sort_by(f64::total_cmp);
        all
    }

    #[test]
    fn two_passes_are_seen_in_their_spacing() {
        let one = steps(0.0, 1.25, 20);
        for (shift, n, step) in [(0.4, 20, 1.25), (0.05, 20, 1.25), (10.4, 20, 1.25), (0.3, 12, 2.0), (12.0, 8, 0.9)] {
            let both = mixed(&[one.clone(), steps(shift, step, n)]);
            assert!(several(&both), "{shift} {n} {step}");
            assert!(faults(&both) > 0, "{shift} {n} {step}");
        }
        assert!(several(&mixed(&[one, steps(0.3, 1.25, 20), steps(0.7, 1.25, 20)])));
    }

    #[test]
    fn one_pass_is_one() {
        let one = steps(0.0, 1.25, 40);
        let without = |gone: &[usize]| -> Vec<f64> {
            one.iter().enumerate().filter(|(k, _)| !gone.contains(k)).map(|(_, t)| *t).collect()
        };
        assert_eq!(faults(&one), 0);
        for gone in [&[][..], &[7], &[7, 20, 21], &[3, 9, 10, 11, 30], &[1], &[38], &[2, 4]] {
            assert!(!several(&without(gone)), "{gone:?}");
        }
        // Two that meet end to end do not overlap, and positions rounded to a tenth are even.
        assert!(!several(&mixed(&[steps(0.0, 1.25, 20), steps(25.4, 1.25, 20)])));
        let rounded: Vec<f64> = steps(0.0, 0.625, 200).iter().map(|t| (t * 10.0).round() / 10.0).collect();
        assert!(faults(&rounded) == 0 && !several(&rounded));
        assert_eq!((faults(&[]), faults(&[1.0]), faults(&[1.0, 1.0])), (0, 0, 1));
    }
}
