//! How many rays the next picture gets: as many as its budget allows, and as its motion lets one see.

/// Sides of the traced picture relative to the shown one, as fractions, fine to coarse.
const LEVELS: [(usize, usize); 7] = [(1, 1), (3, 4), (1, 2), (3, 8), (1, 4), (1, 6), (1, 8)];
/// A picture that moves on by no more pixels than this is traced in full; one that moves twice as far shows half as much.
const SHARP: f64 = 40.0;
/// However fast it moves, nothing coarser than this level is chosen for that alone.
const BLURRED: usize = 4;
/// A finer level must promise to stay below these shares of the budget and of the motion, so that the choice does not
/// flicker.
const HEADROOM: f64 = 0.9;
const CALMER: f64 = 0.7;
/// It must do so for so many pictures: detail is lost at once and comes back in steps.
const PATIENCE: u32 = 4;
/// Detail that is lost again within so many pictures came back too soon: the next time it must be promised twice as long,
/// for half of them at the most.
const DOUBT: u32 = 240;
/// Predictions are taken for so much larger than they are: for a picture much like the last, and for one that has
/// nothing to do with it.
const MARGIN: [f64; 2] = [1.08, 1.35];
/// A picture that has moved by this share of its shorter side has little to do with the last.
const NEW: f64 = 0.25;
/// What the dearest picture was is forgotten by this share with each one.
const FORGET: f64 = 0.004;
/// What a pixel costs before any was made, in samples.
const FIRST: f64 = 12.0;

/// What a picture cost, rays counted as samples too ([`cost`](super::cost)).
#[derive(Clone, Copy, Debug)]
struct Cost {
    /// Samples for each pixel of the shown picture.
    samples: f64,
    /// Side of the traced picture relative to it.
    side: f64,
}

impl Cost {
    /// What the same would cost at another side: more pixels let more rays be spared, so that twice the side costs less than
    /// three times as much. Were none spared, the next finer level would cost 1.22 times what is said here at the most, and
    /// be given up again.
    fn at(self, side: f64) -> f64 {
        let ratio = side / self.side;
        self.samples * ratio * ratio.sqrt()
    }
}

/// Chooses levels from what earlier pictures cost. It knows no clock: the budget is in samples.
#[derive(Clone, Debug)]
pub struct Governor {
    level: usize,
    last: Cost,
    dearest: Cost,
    /// Pictures for which a finer level has promised to be cheap enough, and how many it takes.
    calm: u32,
    patience: u32,
    /// Pictures since a finer level was chosen.
    kept: u32,
}

impl Default for Governor {
    fn default() -> Self {
        let cost = Cost { samples: FIRST, side: 1.0 };
        Self { level: 0, last: cost, dearest: cost, calm: 0, patience: PATIENCE, kept: DOUBT }
    }
}

/// The side of a level.
fn side(level: usize) -> f64 {
    let (n, d) = LEVELS[level];
    n as f64 / d as f64
}

impl Governor {
    /// Size in pixels of the next picture to be traced, to be shown in `width` × `height`, that moves by `flow` pixels
    /// (infinite for a cut) and may take `budget` samples.
    pub fn next(&mut self, (width, height): (usize, usize), flow: f64, budget: u64) -> (usize, usize) {
        let budget = budget as f64;
        let pixels = (width * height) as f64;
        let strange = (flow / (NEW * width.min(height) as f64)).clamp(0.0, 1.0);
        let margin = MARGIN[0] + (MARGIN[1] - MARGIN[0]) * strange;
        let cost = |level: usize| {
            let (last, dearest) = (self.last.at(side(level)), self.dearest.at(side(level)));
            pixels * margin * (last + (dearest - last).max(0.0) * strange)
        };
        // A cut is no motion: there is nothing that the eye would follow.
        let flow = if flow.is_finite() { flow } else { 0.0 };
        let blurred = (0..BLURRED).find(|&l| flow * side(l) <= SHARP).unwrap_or(BLURRED);
        let mut level = self.level.max(blurred);
        while level + 1 < LEVELS.len() && cost(level) > budget {
            level += 1;
        }
        // Not by a turn, but by what the picture itself cost.
        let too_dear = level > self.level && pixels * self.last.samples > budget;
        self.kept = self.kept.saturating_add(1);
        if self.kept >= DOUBT {
            self.patience = PATIENCE;
        } else if too_dear {
            self.patience = (self.patience * 2).min(DOUBT / 2);
        }
        let finer = level.checked_sub(1).filter(|&l| {
            level == self.level && cost(l) <= budget * HEADROOM && (l >= BLURRED || flow * side(l) <= SHARP * CALMER)
        });
        self.calm = if finer.is_some() { self.calm + 1 } else { 0 };
        if let Some(finer) = finer.filter(|_| self.calm >= self.patience) {
            (level, self.calm, self.kept) = (finer, 0, 0);
        }
        self.level = level;
        let (n, d) = LEVELS[level];
        let scaled = |s: usize| (s * n).div_ceil(d).max(1);
        (scaled(width), scaled(height))
    }

    /// Learns what the picture took, shown in so many pixels.
    pub fn took(&mut self, samples: u64, pixels: usize) {
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

    const SHOWN: (usize, usize) = (1024, 768);
    const PIXELS: usize = 1024 * 768;

    /// Follows pictures that take `density` samples a traced pixel.
    fn fly(g: &mut Governor, pictures: usize, flow: f64, density: f64, budget: u64) -> Vec<(usize, usize)> {
        let mut sizes = Vec::new();
        for _ in 0..pictures {
            let (w, h) = g.next(SHOWN, flow, budget);
            g.took((density * (w * h) as f64) as u64, PIXELS);
            sizes.push((w, h));
        }
        sizes
    }

    #[test]
    fn the_budget_is_kept_and_used() {
        let mut g = Governor::default();
        assert_eq!(fly(&mut g, 40, 2.0, 4.0, 5_000_000).last(), Some(&SHOWN), "what can be afforded is traced");
        let sizes = fly(&mut g, 60, 2.0, 30.0, 5_000_000);
        assert!(sizes[1..].iter().all(|s| 30 * s.0 * s.1 <= 5_000_000), "{sizes:?}");
        let last = sizes[59];
        assert!(30 * last.0 * last.1 > 1_000_000, "{last:?}");
        assert_eq!(fly(&mut g, 60, 2.0, 4.0, 5_000_000).last(), Some(&SHOWN));
        assert_eq!(fly(&mut g, 9, 2.0, 1e9, 1).last(), Some(&(128, 96)), "there is an end to it");
    }

    #[test]
    fn detail_goes_at_once_and_comes_back_in_steps() {
        let mut g = Governor::default();
        fly(&mut g, 20, 2.0, 1.0, 5_000_000);
        assert_eq!(fly(&mut g, 1, 300.0, 1.0, 5_000_000), [(256, 192)], "a sudden turn");
        let mut sizes = fly(&mut g, 30, 2.0, 1.0, 5_000_000);
        assert_eq!(sizes[0], (256, 192), "no haste afterwards");
        sizes.dedup();
        assert_eq!(sizes, [(256, 192), (384, 288), (512, 384), (768, 576), (1024, 768)]);
        assert_eq!(fly(&mut g, 1, f64::INFINITY, 1.0, 50_000_000), [SHOWN], "a cut is no motion");
    }

    #[test]
    fn noise_does_not_make_it_flicker() {
        let mut g = Governor::default();
        let mut sizes = Vec::new();
        for n in 0..300 {
            // Near where both the motion and the cost of a finer level begin to allow it.
            let noise = if n % 2 == 0 { 0.93 } else { 1.07 };
            let (w, h) = g.next(SHOWN, SHARP * noise, 8_000_000);
            g.took((14.0 * noise * (w * h) as f64) as u64, PIXELS);
            sizes.extend((n > 40).then_some((w, h)));
        }
        sizes.dedup();
        assert_eq!(sizes.len(), 1, "{sizes:?}");
    }

    #[test]
    fn what_proved_too_dear_is_not_tried_again_soon() {
        let mut g = Governor::default();
        // Its last level costs three times as much as the one before, which is more than is foreseen.
        let mut sizes = Vec::new();
        for _ in 0..1200 {
            let size = g.next(SHOWN, 2.0, 5_000_000);
            g.took(if size == SHOWN { 6_000_000 } else { 2_000_000 }, PIXELS);
            sizes.push(size);
        }
        let tried = sizes.iter().filter(|&&s| s == SHOWN).count();
        assert!((2..20).contains(&tried), "{tried} times");
        // And when it can be afforded it comes.
        assert_eq!(fly(&mut g, 130, 2.0, 4.0, 5_000_000).last(), Some(&SHOWN));
    }

    #[test]
    fn nothing_and_nonsense_are_no_fault() {
        let mut g = Governor::default();
        assert_eq!(g.next((0, 0), f64::NAN, 0), (1, 1));
        g.took(u64::MAX, 0);
        g.took(0, 1);
        assert!(g.next((7, 1), 0.0, u64::MAX).1 == 1);
    }
}
