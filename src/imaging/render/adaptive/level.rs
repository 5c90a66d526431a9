//! Chooses how many rays the next picture gets: as many as its budget allows and its motion lets the eye see.

use super::budget::Budget;
use crate::render::frame::ImageSize;

/// Sides of the traced picture relative to the shown one, as fractions, fine to coarse.
const LEVELS: [(usize, usize); 7] = [(1, 1), (3, 4), (1, 2), (3, 8), (1, 4), (1, 6), (1, 8)];
/// A picture that moves by no more pixels than this is traced in full; one that moves twice as far shows half the
/// detail. No eye follows sixty times as much in a second.
const SHARP: f64 = 80.0;
/// Motion alone never selects a level coarser than this.
const BLURRED: usize = 4;
/// Levels of three quarters of the side, and of half of it.
const THREE_QUARTERS: usize = 1;
const HALF: usize = 2;
/// How far a level may exceed the budget before the next coarser one replaces it, as a factor. Three quarters of the
/// side are worth a picture that comes a little late.
const SLACK: [f64; LEVELS.len()] = [1.0, 1.3, 1.0, 1.0, 1.0, 1.0, 1.0];
/// Cost of a pixel that is stretched from a coarser picture, in samples. If it were left out, a coarse picture, which
/// is mostly stretching, would make samples look slow and stay coarse.
pub(crate) const STRETCHED: f64 = 0.15;
/// A finer level must be predicted to stay below these shares of the budget and of the motion, so that the choice does not flicker.
const HEADROOM: f64 = 0.9;
const CALMER: f64 = 0.7;
/// This must hold for this many consecutive pictures: detail is lost at once and comes back in steps.
const PATIENCE: u32 = 4;
/// Detail that is lost again within this many pictures came back too soon. The next time the prediction must hold for
/// twice as many pictures, up to half of this number.
const DOUBT: u32 = 240;
/// Factors by which predictions are increased: for a picture much like the last, and for one that has nothing in common with it.
const MARGIN: [f64; 2] = [1.08, 1.35];
/// A picture that has moved by this share of its shorter side has little in common with the last.
const NEW: f64 = 0.25;
/// The cost of the most expensive picture decays by this share with each picture.
const FORGET: f64 = 0.004;
/// Assumed cost of a pixel before any was rendered, in samples.
const FIRST: f64 = 2.0;
/// Share of a full picture's cost that a coarser one has too, however small: packets of rays span more of the scene
/// where pixels are larger. On the CT, half the side costs 0.40 of the full picture and three quarters 0.64.
const CONSTANT: f64 = 0.15;

/// The cost of a picture, with rays counted as samples too ([`cost`](super::cost)).
#[derive(Clone, Copy, Debug)]
struct Cost {
    /// Samples for each pixel of the shown picture.
    samples: f64,
    /// Side of the traced picture relative to the shown one.
    side: f64,
}

impl Cost {
    /// Predicts the cost at another side. If all of the cost grows with the pixels, the next finer level costs at most
    /// 1.2 times this prediction, and is given up again.
    fn at(self, side: f64) -> f64 {
        let cost = |side: f64| CONSTANT + (1.0 - CONSTANT) * side * side;
        self.samples * cost(side) / cost(self.side)
    }
}

/// Chooses levels from the cost of earlier pictures. It uses no clock: the budget is in samples.
#[derive(Clone, Debug)]
pub(crate) struct Governor {
    level: usize,
    last: Cost,
    dearest: Cost,
    /// Number of pictures for which a finer level was predicted to be cheap enough, and the number required.
    calm: u32,
    patience: u32,
    /// Pictures since a finer level was chosen.
    kept: u32,
    /// Expected cost of that level, in samples.
    expected: f64,
}

impl Default for Governor {
    fn default() -> Self {
        let cost = Cost { samples: FIRST, side: 1.0 };
        Self { level: 0, last: cost, dearest: cost, calm: 0, patience: PATIENCE, kept: DOUBT, expected: f64::INFINITY }
    }
}

/// Returns the side of a level.
fn side(level: usize) -> f64 {
    let (n, d) = LEVELS[level];
    n as f64 / d as f64
}

/// Returns what a pixel of a level costs besides being traced, in samples.
fn stretched(level: usize) -> f64 {
    if level == 0 { 0.0 } else { STRETCHED }
}

impl Governor {
    /// Returns the size in pixels at which the next picture is traced.
    ///
    /// The picture is shown in `size`, moves by `flow` pixels (infinite for a cut) and may cost `budget`.
    pub(crate) fn next(&mut self, size: ImageSize, flow: f64, budget: Budget) -> ImageSize {
        let at_half = budget.at_half as f64;
        let allowed = |level| if level == THREE_QUARTERS { budget.lasting as f64 } else { budget.samples as f64 };
        let pixels = size.pixels() as f64;
        let strange = (flow / (NEW * size.shorter() as f64)).clamp(0.0, 1.0);
        let margin = MARGIN[0] + (MARGIN[1] - MARGIN[0]) * strange;
        let cost = |level: usize| {
            let (last, dearest) = (self.last.at(side(level)), self.dearest.at(side(level)));
            pixels * (stretched(level) + margin * (last + (dearest - last).max(0.0) * strange))
        };
        // A cut is not motion: there is nothing that the eye would follow.
        let flow = if flow.is_finite() { flow } else { 0.0 };
        let blurred = (0..BLURRED).find(|&l| flow * side(l) <= SHARP).unwrap_or(BLURRED);
        let mut level = self.level.max(blurred);
        while level + 1 < LEVELS.len()
            && cost(level) > allowed(level) * SLACK[level]
            && (level < HALF || cost(HALF) > at_half)
        {
            level += 1;
        }
        // Not because of a turn, nor because the machine has become slower, but because the picture cost more than expected.
        let own = pixels * (stretched(self.level) + self.last.samples);
        let too_dear = level > self.level && own > allowed(self.level) * SLACK[self.level] && own > self.expected;
        self.kept = self.kept.saturating_add(1);
        if self.kept >= DOUBT {
            self.patience = PATIENCE;
        } else if too_dear {
            self.patience = (self.patience * 2).min(DOUBT / 2);
        }
        let finer = level.checked_sub(1).filter(|&l| {
            let affordable = cost(l) <= allowed(l) * HEADROOM || l >= HALF && cost(HALF) <= at_half * HEADROOM;
            level == self.level && affordable && (l >= BLURRED || flow * side(l) <= SHARP * CALMER)
        });
        self.calm = if finer.is_some() { self.calm + 1 } else { 0 };
        if let Some(finer) = finer.filter(|_| self.calm >= self.patience) {
            self.expected = cost(finer);
            (level, self.calm, self.kept) = (finer, 0, 0);
        }
        self.level = level;
        let (n, d) = LEVELS[level];
        let scaled = |s: usize| (s * n).div_ceil(d).max(1);
        ImageSize::new(scaled(size.width), scaled(size.height))
    }

    /// Records the cost of the picture, shown in `pixels` pixels.
    pub(crate) fn took(&mut self, samples: u64, pixels: usize) {
        if pixels == 0 {
            return;
        }
        self.last = Cost { samples: samples as f64 / pixels as f64, side: side(self.level) };
        self.dearest.samples *= 1.0 - FORGET;
        if self.last.samples >= self.dearest.at(self.last.side) {
            self.dearest = self.last;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHOWN: ImageSize = ImageSize::new(1024, 768);
    const PIXELS: usize = 1024 * 768;

    /// Simulates pictures that take `density` samples a traced pixel.
    fn fly(g: &mut Governor, pictures: usize, flow: f64, density: f64, budget: u64) -> Vec<ImageSize> {
        let mut sizes = Vec::new();
        for _ in 0..pictures {
            let size = g.next(SHOWN, flow, Budget::strict(budget));
            g.took((density * size.pixels() as f64) as u64, PIXELS);
            sizes.push(size);
        }
        sizes
    }

    #[test]
    fn the_budget_is_kept_and_used() {
        let mut g = Governor::default();
        assert_eq!(fly(&mut g, 40, 2.0, 4.0, 5_000_000).last(), Some(&SHOWN), "what can be afforded is traced");
        let sizes = fly(&mut g, 60, 2.0, 30.0, 5_000_000);
        assert!(sizes[1..].iter().all(|s| 30 * s.pixels() <= 5_000_000), "{sizes:?}");
        let last = sizes[59];
        assert!(30 * last.pixels() > 1_000_000, "{last:?}");
        assert_eq!(fly(&mut g, 60, 2.0, 4.0, 5_000_000).last(), Some(&SHOWN));
        assert_eq!(fly(&mut g, 9, 2.0, 1e9, 1).last(), Some(&ImageSize::new(128, 96)), "there is an end to it");
    }

    #[test]
    fn detail_goes_at_once_and_comes_back_in_steps() {
        let mut g = Governor::default();
        fly(&mut g, 20, 2.0, 1.0, 5_000_000);
        assert_eq!(fly(&mut g, 1, 300.0, 1.0, 5_000_000), [ImageSize::new(256, 192)], "a sudden turn");
        let mut sizes = fly(&mut g, 30, 2.0, 1.0, 5_000_000);
        assert_eq!(sizes[0], ImageSize::new(256, 192), "no haste afterwards");
        let each = |width: usize| sizes.iter().filter(|s| s.width == width).count();
        assert!([384, 512, 768].map(each).iter().all(|&n| n >= PATIENCE as usize), "a few pictures of each: {sizes:?}");
        sizes.dedup();
        assert_eq!(
            sizes,
            [
                ImageSize::new(256, 192),
                ImageSize::new(384, 288),
                ImageSize::new(512, 384),
                ImageSize::new(768, 576),
                ImageSize::new(1024, 768)
            ]
        );
        assert_eq!(fly(&mut g, 1, f64::INFINITY, 1.0, 50_000_000), [SHOWN], "a cut is no motion");
    }

    #[test]
    fn a_busy_machine_leaves_half_the_side_and_a_slow_one_less() {
        let mut g = Governor::default();
        let busy = Budget { samples: 300_000, lasting: 300_000, at_half: 5_000_000 };
        for (budget, last) in [
            (busy, ImageSize::new(512, 384)),
            (Budget::strict(200_000), ImageSize::new(128, 96)),
            (busy, ImageSize::new(512, 384)),
        ] {
            let mut sizes = Vec::new();
            for _ in 0..60 {
                let size = g.next(SHOWN, 2.0, budget);
                g.took(8 * size.pixels() as u64, PIXELS);
                sizes.push(size);
            }
            assert_eq!(sizes[59], last);
        }
        let mut back = 0;
        while g.next(SHOWN, 2.0, Budget { samples: 8_000_000, lasting: 8_000_000, ..busy }) != SHOWN {
            let (n, d) = LEVELS[g.level];
            g.took(8 * (PIXELS * n * n / d / d) as u64, PIXELS);
            back += 1;
            assert!(back < 30, "within half a second");
        }
    }

    #[test]
    fn hiccups_leave_three_quarters_of_the_side() {
        let mut g = Governor::default();
        // In three of every ten pictures samples seem to take twice as long: a picture of 768 × 576 pixels would be too expensive.
        for n in 0..300 {
            let samples = if n % 10 < 3 { 3_000_000 } else { 6_000_000 };
            let size = g.next(SHOWN, 2.0, Budget { samples, lasting: 6_000_000, at_half: 12_000_000 });
            g.took(10 * size.pixels() as u64, PIXELS);
            assert!(n < 30 || size == ImageSize::new(768, 576), "{n}: {size}");
        }
    }

    #[test]
    fn noise_does_not_make_it_flicker() {
        let mut g = Governor::default();
        let mut sizes = Vec::new();
        for n in 0..300 {
            // Close to where both the motion and the cost of a finer level begin to allow it.
            let noise = if n % 2 == 0 { 0.93 } else { 1.07 };
            let size = g.next(SHOWN, SHARP * noise, Budget::strict(8_000_000));
            g.took((14.0 * noise * size.pixels() as f64) as u64, PIXELS);
            sizes.extend((n > 40).then_some(size));
        }
        sizes.dedup();
        assert_eq!(sizes.len(), 1, "{sizes:?}");
    }

    #[test]
    fn what_proved_too_dear_is_not_tried_again_soon() {
        let mut g = Governor::default();
        // The finest level costs three times as much as the one before, which is more than predicted.
        let mut sizes = Vec::new();
        for _ in 0..1200 {
            let size = g.next(SHOWN, 2.0, Budget::strict(5_000_000));
            g.took(if size == SHOWN { 6_000_000 } else { 2_000_000 }, PIXELS);
            sizes.push(size);
        }
        let tried = sizes.iter().filter(|&&s| s == SHOWN).count();
        assert!((2..20).contains(&tried), "{tried} times");
        // It comes once it can be afforded.
        assert_eq!(fly(&mut g, 130, 2.0, 4.0, 5_000_000).last(), Some(&SHOWN));
    }

    #[test]
    fn nothing_and_nonsense_are_no_fault() {
        let mut g = Governor::default();
        assert_eq!(g.next(ImageSize::default(), f64::NAN, Budget::strict(0)), ImageSize::new(1, 1));
        g.took(u64::MAX, 0);
        g.took(0, 1);
        assert!(g.next(ImageSize::new(7, 1), 0.0, Budget::strict(u64::MAX)).height == 1);
    }

    /// A costly place is remembered although a turn has shown it in a quarter of the side only: after a cut, the picture
    /// keeps its budget at once.
    #[test]
    fn a_costly_place_is_remembered_from_a_coarse_picture() {
        const BUDGET: u64 = 5_000_000;
        let mut g = Governor::default();
        // Renders a picture of a place that costs so many samples a pixel in full. Returns its size and samples.
        let mut picture = |flow: f64, full: f64| {
            let size = g.next(SHOWN, flow, Budget::strict(BUDGET));
            let side = size.width as f64 / SHOWN.width as f64;
            let samples = (full * (CONSTANT + (1.0 - CONSTANT) * side * side) * PIXELS as f64) as u64;
            g.took(samples, PIXELS);
            (size, samples)
        };
        for _ in 0..5 {
            assert_eq!(picture(300.0, 7.4).0, ImageSize::new(256, 192), "in a turn");
        }
        let calm = (0..40).fold(ImageSize::default(), |_, _| picture(2.0, 1.0).0);
        assert_eq!(calm, SHOWN, "a cheap place is traced in full");
        let (size, samples) = picture(f64::INFINITY, 7.4);
        assert!(samples <= BUDGET, "{samples} samples at {size}");
    }
}
