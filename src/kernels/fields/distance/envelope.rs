//! The lower envelope of parabolas, in one sweep (Felzenszwalb and Huttenlocher 2012).

/// Returns the first whole position at or after `place`, or 0 if it is negative. (`ceil` is a function call on a baseline CPU.)
fn from(place: f32) -> usize {
    let whole = place as usize;
    whole + usize::from((whole as f32) < place)
}

/// A parabola of an envelope.
#[derive(Clone, Copy, Debug)]
struct Parabola {
    /// Position of the minimum.
    at: u32,
    /// Start of the range in which it is the lowest.
    begin: f32,
    /// Height at the minimum, mm².
    height: f32,
}

/// Scratch memory for building envelopes.
#[derive(Debug, Default)]
pub(super) struct Envelope {
    parabolas: Vec<Parabola>,
    /// 1/n, as far as needed so far: a division takes several times as long as the rest of a step.
    inverse: Vec<f32>,
}

impl Envelope {
    /// Replaces the heights h(q) of a run by min over p of h(p) + (s·(q − p))², with `square` = s² (mm²).
    pub(super) fn lower(&mut self, heights: &mut [f32], square: f32) {
        let Self { parabolas, inverse } = self;
        let known = inverse.len();
        inverse.extend((known..heights.len()).map(|n| 1.0 / n as f32));
        let half = 0.5 / square;
        parabolas.clear();
        for (q, &height) in heights.iter().enumerate() {
            if height == f32::INFINITY {
                continue;
            }
            let mut begin = f32::NEG_INFINITY;
            while let Some(last) = parabolas.last() {
                let p = last.at as usize;
                let meet = (height - last.height) * half * inverse[q - p] + 0.5 * (q + p) as f32;
                if meet > last.begin {
                    begin = meet;
                    break;
                }
                parabolas.pop();
            }
            parabolas.push(Parabola { at: q as u32, begin, height });
        }
        let mut first = 0;
        for (n, p) in parabolas.iter().enumerate() {
            let end = parabolas.get(n + 1).map_or(heights.len(), |next| from(next.begin).clamp(first, heights.len()));
            let bottom = p.at as f32;
            for (x, o) in heights[first..end].iter_mut().enumerate() {
                let gap = (first + x) as f32 - bottom;
                *o = p.height + square * gap * gap;
            }
            first = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn is_the_least_of_all_parabolas(heights in prop::collection::vec(prop::option::weighted(0.7, 0.0f32..400.0), 1..90), step in 0.1f32..5.0) {
            let f: Vec<f32> = heights.iter().map(|h| h.unwrap_or(f32::INFINITY)).collect();
            let square = step * step;
            let mut heights = f.clone();
            Envelope::default().lower(&mut heights, square);
            for (q, &got) in heights.iter().enumerate() {
                let brute = f.iter().enumerate().map(|(p, h)| h + square * (q as f32 - p as f32).powi(2)).fold(f32::INFINITY, f32::min);
                prop_assert!(got == brute || (got - brute).abs() <= 1e-3 * (1.0 + brute), "{got} is not {brute}");
            }
        }
    }
}
