//! How many rays an image gets: few enough to keep up while it moves, one a pixel when it stands still.

/// A moving image may take so long, ms.
const MOVING_MS: f64 = 45.0;
/// A finer resolution must promise to stay this far below [`MOVING_MS`], so that the choice does not flicker.
const HEADROOM: f64 = 0.75;
/// Weight of the newest image in the estimate of the cost.
const NEWEST: f64 = 0.3;
/// Sides of the image relative to the window's, as fractions, fine to coarse.
const LEVELS: [(usize, usize); 7] = [(1, 1), (2, 3), (1, 2), (1, 3), (1, 4), (1, 6), (1, 8)];
/// The level tried before anything was measured: 1/3.
const FIRST: usize = 3;

/// Chooses the size of the image from what earlier ones took.
#[derive(Clone, Debug)]
pub struct Resolution {
    /// Estimated cost of a pixel, ms.
    pixel_ms: Option<f64>,
    level: usize,
}

impl Default for Resolution {
    fn default() -> Self {
        Self { pixel_ms: None, level: FIRST }
    }
}

impl Resolution {
    /// Learns that an image of `pixels` took `ms`.
    pub fn measured(&mut self, pixels: usize, ms: f64) {
        if pixels == 0 || !(ms.is_finite() && ms >= 0.0) {
            return;
        }
        let now = ms / pixels as f64;
        self.pixel_ms = Some(self.pixel_ms.map_or(now, |p| p + (now - p) * NEWEST));
    }

    /// Forgets the costs: the quality of the images has changed.
    pub fn forget(&mut self) {
        self.pixel_ms = None;
    }

    /// Size in pixels of the next image of a moving scene, for a window of the given size.
    pub fn moving(&mut self, window: (usize, usize)) -> (usize, usize) {
        if let Some(pixel_ms) = self.pixel_ms {
            let ms = |level| {
                let (w, h) = scaled(window, level);
                pixel_ms * (w * h) as f64
            };
            while self.level + 1 < LEVELS.len() && ms(self.level) > MOVING_MS {
                self.level += 1;
            }
            while self.level > 0 && ms(self.level - 1) < MOVING_MS * HEADROOM {
                self.level -= 1;
            }
        }
        scaled(window, self.level)
    }

    /// The next finer image of a scene that stands still, after one of the size `last`; none after one of the window's
    /// own. Levels are skipped, so that a still image gets there in two or three steps.
    pub fn finer(last: (usize, usize), window: (usize, usize)) -> Option<(usize, usize)> {
        if last == window {
            return None;
        }
        let mut finer = (0..LEVELS.len()).rev().map(|level| scaled(window, level));
        finer.find(|&(w, h)| w * h >= 3 * last.0 * last.1).or(Some(window))
    }
}

fn scaled((w, h): (usize, usize), level: usize) -> (usize, usize) {
    let (n, d) = LEVELS[level];
    let side = |s: usize| (s * n / d).max(1);
    (side(w), side(h))
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: (usize, usize) = (1200, 900);

    #[test]
    fn a_slow_machine_gets_fewer_rays_and_a_fast_one_all() {
        let mut r = Resolution::default();
        assert_eq!(r.moving(WINDOW), (400, 300), "a cautious first image");
        for _ in 0..50 {
            let (w, h) = r.moving(WINDOW);
            r.measured(w * h, (w * h) as f64 * 1e-3);
        }
        assert_eq!(r.moving(WINDOW), (200, 150), "45 000 rays at the most");
        for _ in 0..50 {
            let (w, h) = r.moving(WINDOW);
            r.measured(w * h, (w * h) as f64 * 1e-6);
        }
        assert_eq!(r.moving(WINDOW), WINDOW);
    }

    #[test]
    fn noise_does_not_make_it_flicker() {
        let mut r = Resolution::default();
        let mut seen = Vec::new();
        for n in 0..200 {
            let (w, h) = r.moving(WINDOW);
            // Half the window takes 32 ms, give or take a tenth: near where it becomes worth it.
            r.measured(w * h, (w * h) as f64 * (32.0 / 270_000.0) * if n % 2 == 0 { 0.9 } else { 1.1 });
            if n > 20 {
                seen.push((w, h));
            }
        }
        seen.dedup();
        assert_eq!(seen, [(600, 450)]);
    }

    #[test]
    fn a_still_scene_is_refined_to_the_last_pixel() {
        let (mut size, mut steps) = ((150, 112), 0);
        while let Some(next) = Resolution::finer(size, WINDOW) {
            assert!(next.0 * next.1 > size.0 * size.1);
            (size, steps) = (next, steps + 1);
            assert!(steps < 8);
        }
        assert_eq!(size, WINDOW);
        assert_eq!(Resolution::finer((1, 1), (1, 1)), None);
    }

    #[test]
    fn an_image_is_never_empty() {
        let mut r = Resolution::default();
        for _ in 0..20 {
            r.measured(1, 1e6);
        }
        assert_eq!(r.moving((5000, 3)), (625, 1));
        r.measured(0, f64::NAN);
    }
}
