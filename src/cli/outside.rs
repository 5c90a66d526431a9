//! The colon from outside, drawn by the renderer of flights: its lumen is made solid, and looked at from the front.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::fields::Lumen;
use crate::progress::Progress;
use crate::render::{Frame, Preset, Quality, Reuse, Settings, View, renderer};
use crate::space::TransferFunction;

/// Values of the solid and of what surrounds it, HU: like tissue in gas.
const SOLID_HU: i16 = 200;
const AROUND_HU: i16 = -1000;
/// The camera is so far from the colon that lines of sight are nearly parallel, mm.
const AWAY_MM: f64 = 4000.0;
/// Share of the picture's height that the colon takes.
const FILLS: f64 = 0.92;
/// Colour beside the colon.
pub(super) const PAPER: [u8; 3] = [255; 3];
/// Side of the small picture, pixels, and how many times finer it is drawn.
const SIDE: usize = 200;
const FINER: usize = 2;
/// Side of the voxels of its solid, mm.
const VOXEL_MM: f64 = 3.0;
/// Its colour.
const COLON: [u8; 3] = [236, 196, 170];

/// A place of the surface that a pixel shows.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    /// World, mm.
    pub(super) place: DVec3,
    /// Brightness, 0 to 1.
    light: f64,
}

impl Hit {
    /// Returns a colour in its light.
    pub(super) fn lit(&self, colour: [u8; 3]) -> [u8; 3] {
        colour.map(|c| (f64::from(c) * (0.35 + 0.65 * self.light)).round() as u8)
    }
}

/// A colon seen from outside.
pub(super) struct Outside {
    pub(super) view: View,
    /// What each pixel shows, row by row; `None` beside the colon.
    pub(super) hits: Vec<Option<Hit>>,
}

/// Looks at a colon from the front: the patient's right is on the left. Its solid is made of cubes of `voxel_mm`. `None` without a lumen.
pub(super) fn look(
    lumen: &Lumen,
    [width, height]: [usize; 2],
    voxel_mm: f64,
    progress: &Progress,
) -> Result<Option<Outside>> {
    let Some(solid) = lumen.solid(voxel_mm, [AROUND_HU, SOLID_HU])? else { return Ok(None) };
    progress.check()?;
    let grid = solid.grid();
    let size = grid.spacing() * DVec3::from_array(grid.dims().map(|n| n as f64));
    let middle = grid.world(DVec3::from_array(grid.dims().map(|n| 0.5 * (n as f64 - 1.0))));
    let tall = size.z.max(size.x * height as f64 / width as f64) / FILLS;
    let fov = (2.0 * (0.5 * tall / AWAY_MM).atan()).to_degrees();
    let view = View::new(middle - DVec3::Y * AWAY_MM, DVec3::Y, DVec3::Z, fov, width, height)?;
    let preset = Preset::default();
    let prepared = preset.preparation.prepare(Arc::new(solid), TransferFunction::default());
    let mut frame = Frame::with_depth(width, height);
    renderer(&prepared, Settings::new(Quality::High), preset, Reuse::Never).render(&view, &mut frame);
    let depth = frame.depth().unwrap_or_default();
    // The renderer's light falls off with the distance, which is nearly the same everywhere: its brightest pixel is white.
    let grey = |p: [u8; 3]| p.map(f64::from).iter().sum::<f64>() / 3.0;
    let pixels = || frame.pixels().iter().zip(depth);
    let most = pixels().filter(|(_, mm)| mm.is_finite()).map(|(p, _)| grey(*p)).fold(1.0, f64::max);
    let hit = |(n, (pixel, mm)): (usize, (&[u8; 3], &f32))| {
        let [x, y] = [n % width, n / width].map(|x| x as f64 + 0.5);
        let ray = view.ray_at(x, y).filter(|_| mm.is_finite())?;
        let place = ray.origin + ray.direction * f64::from(*mm);
        Some(Hit { place, light: (grey(*pixel) / most).clamp(0.0, 1.0) })
    };
    let hits = pixels().enumerate().map(hit).collect();
    Ok(Some(Outside { view, hits }))
}

/// Refuses a name of a picture that does not end in `.png`. Fails with status 2.
pub(super) fn check_ending(path: &Path) -> Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    Err(Error::usage(path.display().to_string(), "its extension is not that of a picture", "end it in .png"))
}

/// Draws a small picture of a colon; an empty one without a lumen.
pub(super) fn small(lumen: &Lumen, progress: &Progress) -> Result<Frame> {
    let side = SIDE * FINER;
    let outside = look(lumen, [side; 2], VOXEL_MM, progress)?;
    let fine: Vec<[u8; 3]> = match &outside {
        Some(outside) => outside.hits.iter().map(|hit| hit.map_or(PAPER, |h| h.lit(COLON))).collect(),
        None => vec![PAPER; side * side],
    };
    let mut frame = Frame::new(SIDE, SIDE);
    for (n, pixel) in frame.buffers().0.iter_mut().enumerate() {
        let [x, y] = [n % SIDE, n / SIDE].map(|x| x * FINER);
        let block = (y..y + FINER).flat_map(|y| &fine[y * side + x..y * side + x + FINER]);
        let sums = block.fold([0usize; 3], |sums, p| std::array::from_fn(|c| sums[c] + usize::from(p[c])));
        *pixel = sums.map(|sum| ((sum + FINER * FINER / 2) / (FINER * FINER)) as u8);
    }
    Ok(frame)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::lumen::find;
    use crate::phantom::PhantomSettings;
    use crate::shared::shared;

    #[test]
    fn a_small_picture_shows_the_colon_with_its_right_side_on_the_left() {
        let (_, volume) = shared(&PhantomSettings { fluid: true, ..PhantomSettings::embedded(1) });
        let lumen = find(&volume, &Progress::new()).unwrap();
        let frame = small(&lumen, &Progress::new()).unwrap();
        assert_eq!([frame.width(), frame.height()], [SIDE; 2]);
        let shown = frame.pixels().iter().filter(|p| **p != PAPER).count();
        assert!((SIDE * SIDE / 10..SIDE * SIDE / 2).contains(&shown), "{shown}");
        assert_eq!(frame.pixels(), small(&lumen, &Progress::new()).unwrap().pixels());
        // The cecal end is on the patient's right, which has the lesser x.
        let outside = look(&lumen, [SIDE; 2], VOXEL_MM, &Progress::new()).unwrap().unwrap();
        let column = |x: f64| outside.view.project(DVec3::new(x, 0.0, 0.0)).unwrap()[0];
        assert!(column(-50.0) < column(50.0));
        let none = small(&Lumen::none(lumen.grid()), &Progress::new()).unwrap();
        assert!(none.pixels().iter().all(|p| *p == PAPER));
    }
}
