//! Paint of one colour on places of the wall.

use std::sync::Arc;

use fearless_simd::Level;
use glam::DVec3;

use super::{CellInks, Cover, Pictured, WallPainter};
use crate::render::Frame;
use crate::render::wall_paint::PaintedArea;
use crate::volume::{Grid, Volume};

/// How much of the picture's own colour is covered: all that may be where about a fifth of the cells around a place are painted.
const COVER: Cover = Cover { most: 0.75, full_at: 0.2 * Cover::ALL };

/// Paints places of the wall in one colour. Reuse it.
#[derive(Debug)]
pub struct SpotPaint {
    /// World, mm.
    places: Arc<[DVec3]>,
    colour: [u8; 3],
    /// The volume whose cells are numbered, and those to paint, in order.
    of: Option<Arc<Volume>>,
    cells: Vec<u64>,
    painter: WallPainter,
}

impl SpotPaint {
    /// Creates paint of a colour for the cells around places, world mm. Where no place is nearer than a voxel the wall stays as it is.
    pub fn new(places: Arc<[DVec3]>, colour: [u8; 3]) -> Self {
        Self { places, colour, of: None, cells: Vec::new(), painter: WallPainter::new(Level::new()) }
    }

    /// Paints a whole picture, whose size is that of its view. Bytes are the same for every number of threads.
    pub fn paint(&mut self, of: Pictured<'_>, frame: &mut Frame) {
        let voxels = of.volume.voxels();
        if !self.of.as_ref().is_some_and(|known| std::ptr::eq(&**known, voxels)) {
            self.cells = cells(voxels.grid(), &self.places);
            self.of = Some(of.volume.shared_voxels());
        }
        let [r, g, b] = self.colour;
        let inks = Spots { cells: &self.cells, ink: [r, g, b, 255] };
        // What the scan was before is nothing to it.
        self.painter.paint(Pictured { scanned: None, ..of }, PaintedArea::Whole, (&inks, COVER), frame);
    }

    /// Returns the memory in use, bytes.
    pub fn bytes(&self) -> usize {
        self.cells.len() * size_of::<u64>() + self.painter.bytes()
    }
}

/// Returns the number of a cell.
fn number([x, y, z]: [usize; 3]) -> u64 {
    (z as u64) << 42 | (y as u64) << 21 | x as u64
}

/// Returns the cell of a number.
fn cell(number: u64) -> [usize; 3] {
    [0, 21, 42].map(|shift| (number >> shift) as usize & ((1 << 21) - 1))
}

/// Returns the cells with a place, and those beside them, in order.
fn cells(grid: &Grid, places: &[DVec3]) -> Vec<u64> {
    let mut all: Vec<u64> = Vec::new();
    for place in places {
        let cell = grid.voxel(*place).floor().as_i64vec3().to_array();
        for n in 0..7 {
            let mut near = cell;
            if n > 0 {
                near[(n - 1) / 2] += if n % 2 == 0 { 1 } else { -1 };
            }
            if near.iter().zip(grid.dims()).all(|(c, n)| *c >= 0 && *c < n as i64) {
                all.push(number(near.map(|c| c as usize)));
            }
        }
    }
    all.sort_unstable();
    all.dedup();
    all
}

/// The inks of some cells.
struct Spots<'a> {
    cells: &'a [u64],
    ink: [u8; 4],
}

impl CellInks for Spots<'_> {
    fn inks(&self, cells: &[[usize; 3]], inks: &mut [[u8; 4]]) {
        for (cell, ink) in cells.iter().zip(inks) {
            *ink = if self.cells.binary_search(&number(*cell)).is_ok() { self.ink } else { [0; 4] };
        }
    }

    fn only(&self) -> Option<Vec<[usize; 3]>> {
        Some(self.cells.iter().copied().map(cell).collect())
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::render::{PreparedVolume, Preset, Reuse, Settings, TransferFunction, View, renderer};

    #[test]
    fn the_wall_is_painted_where_a_place_is_and_nowhere_else() {
        let grid = Grid::new([40, 40, 30], DVec3::new(0.7, 0.7, 1.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..grid.len()).map(|n| if n / 1600 < 20 { -1000 } else { 40 }).collect();
        let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
        // A spot of 4 mm in the middle of the wall that the camera looks at.
        let inside = |n: usize| DVec3::new(12.0 + 0.4 * (n % 11) as f64, 12.0 + 0.4 * (n / 11) as f64, 19.3);
        let mut paint = SpotPaint::new((0..121).map(inside).collect(), [0, 200, 0]);
        let view = View::new(DVec3::new(14.0, 14.0, 9.0), DVec3::Z, DVec3::Y, 90.0, 160, 160).unwrap();
        let mut renderer = renderer(&volume, Settings::default(), Preset::default(), Reuse::Never);
        let mut plain = Frame::default();
        renderer.render(&view, &mut plain);
        let mut painted = plain.clone();
        paint.paint(
            Pictured { volume: &volume, scanned: None, view: &view, distances: renderer.distances() },
            &mut painted,
        );
        let at = |frame: &Frame, mm: f64| {
            let [x, y] = view.project(DVec3::new(14.0 + mm, 14.0, 19.3)).unwrap().map(|c| c as usize);
            frame.pixels()[y * 160 + x]
        };
        let [r, g, b] = at(&painted, 0.0);
        assert!(g > r + 40 && g > b + 40, "{r} {g} {b}");
        assert_eq!([at(&painted, 6.0), at(&painted, -6.0)], [at(&plain, 6.0), at(&plain, -6.0)]);
        assert!(paint.bytes() > 0);
        let mut none = plain.clone();
        let of = Pictured { volume: &volume, scanned: None, view: &view, distances: None };
        SpotPaint::new(Arc::new([]), [0; 3]).paint(of, &mut none);
        assert!(none == plain);
    }
}
