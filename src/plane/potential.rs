//! The potential that corresponds to tentacles and mines, over a whole drawing (paper, sections 3.1.1 and 3.2).
//!
//! It is `C_s (p/D_s − 1)²` with `C_s = wall_push · p` where `0 < D_s < p`, plus `push · reach/2 · (1 − d/reach)²` for
//! each mine within its reach.

use rayon::prelude::*;

use super::drawing::{MM_PER_PIXEL, pixel_centre};
use super::flight::PlaneSettings;
use super::walls::Walls;
use crate::dynamics::mines::{MineSettings, Mines};
use crate::fields::Clearances;

/// The potential at the centre of each pixel, mm²/s² (an acceleration times a distance); infinite in the wall.
#[derive(Clone, Debug)]
pub(crate) struct Potential {
    width: usize,
    wall: Vec<f32>,
    now: Vec<f32>,
}

impl Potential {
    /// Computes the wall's part, which stays constant.
    pub(crate) fn new(walls: &Walls, settings: &PlaneSettings) -> Self {
        let (w, h) = (walls.drawing().width(), walls.drawing().height());
        let (p, strength) = (settings.tentacles.wall_mm, settings.tentacles.wall_push);
        // Beyond `p` the potential is 0, so there is no need to search further.
        let near = Walls::new(walls.drawing().clone(), p);
        let value = |n: usize| {
            let d = near.clearance(pixel_centre(n % w, n / w)).mm;
            if d <= 0.0 { f32::INFINITY } else { (strength * p * (p / d - 1.0).max(0.0).powi(2)) as f32 }
        };
        let wall: Vec<f32> = (0..w * h).into_par_iter().with_min_len(1 << 12).map(value).collect();
        Self { width: w, now: wall.clone(), wall }
    }

    /// Returns the potential with the current mines added.
    pub(crate) fn with_mines(&mut self, mines: Option<(&Mines, &MineSettings)>) -> &[f32] {
        self.now.copy_from_slice(&self.wall);
        let Some((mines, s)) = mines else { return &self.now };
        let height = self.wall.len() / self.width;
        for m in mines.iter() {
            let span = |c: f64, n: usize| {
                let low = ((c - s.reach_mm) / MM_PER_PIXEL).max(0.0) as usize;
                low..((((c + s.reach_mm) / MM_PER_PIXEL).max(0.0) as usize + 1).min(n))
            };
            for j in span(m.y, height) {
                for i in span(m.x, self.width) {
                    let near = (1.0 - pixel_centre(i, j).distance(m) / s.reach_mm).max(0.0);
                    self.now[i + self.width * j] += (s.push * s.reach_mm / 2.0 * near * near) as f32;
                }
            }
        }
        &self.now
    }
}

#[cfg(test)]
mod tests {
    use crate::render::ImageSize;
    use glam::DVec3;

    use super::super::drawing::Drawing;
    use super::*;

    #[test]
    fn walls_and_mines_add_up() {
        let lumen: Vec<bool> = (0..6400).map(|n| (10..70).contains(&(n / 80))).collect();
        let walls = Walls::new(Drawing::new("d", ImageSize::new(80, 80), lumen).unwrap(), 50.0);
        let settings = PlaneSettings::default();
        let mut v = Potential::new(&walls, &settings);
        let middle = 40 + 80 * 40;
        let mut mines = Mines::default();
        let before = v.with_mines(None)[middle];
        assert_eq!(before, 0.0, "14.75 mm from the nearest wall");
        assert!(v.with_mines(None)[40 + 80 * 12] > 100.0 && v.with_mines(None)[0].is_infinite());
        let s = settings.mines.unwrap();
        mines.follow(pixel_centre(40, 40), &s);
        mines.follow(pixel_centre(40, 40) + DVec3::X * 9.0, &s);
        let now = v.with_mines(Some((&mines, &s)))[middle];
        assert!((f64::from(now) - s.push * s.reach_mm / 2.0).abs() < 1e-3, "{now}");
    }
}
