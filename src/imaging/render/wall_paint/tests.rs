use std::sync::Mutex;

use glam::DMat3;

use super::*;
use crate::render::TransferFunction;
use crate::render::packets::levels;
use crate::volume::Grid;

/// Gas up to z = 9.5, in voxels, then tissue. The wall crosses the cells with z = 9.
fn flat() -> PreparedVolume {
    let grid = Grid::new([20, 18, 22], DVec3::new(0.7, 0.8, 1.5), DVec3::splat(-3.0), DMat3::IDENTITY).unwrap();
    let data = (0..grid.len()).map(|n| if n / 360 < 10 { -1000 } else { 40 }).collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

/// An ink for each column of cells, which remembers how often it was asked for.
#[derive(Default)]
struct Columns(Mutex<Vec<[usize; 3]>>);

impl CellInks for Columns {
    fn inks(&self, cells: &[[usize; 3]], inks: &mut [[u8; 4]]) {
        assert!(!cells.is_empty() && cells.len() == inks.len() && cells.len() <= AT_ONCE);
        for (cell, ink) in cells.iter().zip(inks) {
            *ink = [10 * cell[0] as u8, 100, 0, if cell[1] == 4 { 0 } else { 200 }];
        }
        self.0.lock().unwrap().extend_from_slice(cells);
    }
}

/// Returns the ink at a place on every SIMD level; `None` if it is not known yet.
fn ink(field: &CellField, q: [f32; 3]) -> Option<Sum> {
    let mut all = levels().into_iter().map(|(_, level)| {
        let mut found = None;
        on_level!(level, simd => {
            let q = q.map(|c| f32x16::splat(simd, c));
            let (inks, known) = field.at(simd, q, 9);
            found = known.then_some(inks[8]);
        });
        found
    });
    let first = all.next().unwrap();
    assert!(all.all(|other| other == first), "SIMD levels differ");
    first
}

#[test]
fn a_place_has_the_mean_of_the_cells_around_it_and_each_is_found_once() {
    let (volume, columns) = (flat(), Columns::default());
    let mut field = CellField::new(volume.voxels(), &columns);
    let places = [[7.5, 12.5, 10.5], [7.0, 12.5, 10.5], [7.5, 12.5, 11.0], [7.5, 12.5, 14.0], [7.5, 5.5, 10.5]];
    assert!(places.iter().all(|&q| ink(&field, q).is_none()), "not known yet");
    assert!(field.answer(&volume, &columns, Level::new()) && !field.answer(&volume, &columns, Level::new()));
    let all = places.map(|q| ink(&field, q).unwrap());
    // Cell 6 is between the grown coordinates 7 and 8.
    assert_eq!(all[0], [60 * 256, 100 * 256, 0, 200 * 256]);
    assert_eq!(all[1], [55 * 256, 100 * 256, 0, 200 * 256], "between two cells");
    assert_eq!(all[2], [60 * 128, 100 * 128, 0, 200 * 128], "the next layer has no wall");
    assert_eq!([all[3], all[4]], [[0; 4]; 2], "far from the wall, and without ink");
    let asked = std::mem::take(&mut *columns.0.lock().unwrap());
    assert!(asked.iter().all(|c| c[2] == 9 && c[0] < 19 && c[1] < 17), "{asked:?}");
    let once = asked.len();
    for q in [[7.5, 12.5, 10.5], [9.5, 12.5, 10.5]] {
        ink(&field, q);
    }
    field.answer(&volume, &columns, Level::new());
    assert!(columns.0.lock().unwrap().iter().all(|c| c[0] >= 7), "another brick, with those at its border");
    assert!(once <= 2 * 81);
}

/// An ink for some cells.
struct FourCells([[usize; 3]; 4]);

impl CellInks for FourCells {
    fn inks(&self, cells: &[[usize; 3]], inks: &mut [[u8; 4]]) {
        for (cell, ink) in cells.iter().zip(inks) {
            *ink = if self.0.contains(cell) { [9, 8, 7, 255] } else { [0; 4] };
        }
    }

    fn only(&self) -> Option<Vec<[usize; 3]>> {
        Some(self.0.into())
    }
}

#[test]
fn only_bricks_of_cells_with_ink_are_asked_for() {
    let volume = flat();
    // At the first cell, and on both sides of where bricks meet.
    let inks = FourCells([[0, 0, 9], [7, 4, 9], [8, 12, 9], [18, 16, 9]]);
    let mut field = CellField::new(volume.voxels(), &inks);
    for [x, y, z] in inks.0 {
        let q = [x, y, z].map(|c| c as f32 + 1.5);
        assert_eq!(ink(&field, q), None);
        assert!(field.answer(&volume, &inks, Level::new()));
        assert_eq!(ink(&field, q), Some([9 * 256, 8 * 256, 7 * 256, 255 * 256]), "{x} {y}");
        // From the cell before, which may be in the brick before.
        let near = q.map(|c| c - 0.5);
        ink(&field, near);
        field.answer(&volume, &inks, Level::new());
        assert_eq!(ink(&field, near).map(|sum| sum[3]), Some(255 * 32), "{x} {y}");
    }
    assert_eq!(ink(&field, [3.5, 14.5, 3.5]), Some([0; 4]), "nobody asks");
}

#[test]
fn places_beyond_the_volume_have_no_ink() {
    let (volume, columns) = (flat(), Columns::default());
    let mut field = CellField::new(volume.voxels(), &columns);
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let beyond =
        [[-1e9, 3.0, 3.0], [3.0, inf, 3.0], [3.0, 3.0, -inf], [nan, 3.0, 3.0], [1e30, 1e30, 1e30], [60.0, 3.0, 3.0]];
    for q in beyond {
        assert_eq!(ink(&field, q), Some([0; 4]), "{q:?}");
    }
    // At the last cells of the wall there is some.
    for q in [[1.5, 1.5, 10.5], [19.5, 17.5, 10.5], [0.2, 0.7, 10.5], [20.9, 18.9, 10.5]] {
        ink(&field, q);
        while field.answer(&volume, &columns, Level::new()) {}
        assert!(ink(&field, q).is_some(), "{q:?}");
    }
    assert_eq!(ink(&field, [19.5, 17.5, 10.5]), Some([180 * 256, 100 * 256, 0, 200 * 256]));
    assert!(field.bytes() > 0);
}

/// Gains are exact at the rays and even in between; a gain of 1 changes no byte, nor do pixels beside the span change.
#[test]
fn pixels_are_multiplied_evenly() {
    for byte in 0..=255u8 {
        for (width, span) in [(40, [0, 40]), (40, [3, 29]), (19, [0, 19]), (17, [9, 12])] {
            let mut rows = vec![[byte; 3]; 8 * width];
            let gains = |g: u16| [[ONE; 4], [ONE, g, ONE / 2, ONE], [ONE; 4], [ONE; 4], [ONE; 4], [ONE; 4]];
            let lines = [gains(2 * ONE - 8), gains(ONE)];
            for (_, level) in levels() {
                rows.fill([byte; 3]);
                let lines = [&lines[0][..], &lines[1][..]];
                on_level!(level, simd => tint::band(simd, &mut rows, width, &[span; STEP], lines));
                for (n, pixel) in rows.iter().enumerate() {
                    let (x, y) = (n % width, n / width);
                    let near = if (span[0]..span[1]).contains(&x) {
                        (8.0 - (x as f32 - 8.0).abs()).max(0.0) / 8.0
                    } else {
                        0.0
                    };
                    let down = 1.0 - y as f32 / 8.0;
                    let expected =
                        [1.0, 1.0 + near * down * (1.0 - 8.0 / 1024.0), 1.0 - 0.5 * near].map(|g| g * f32::from(byte));
                    for (got, expected) in pixel.iter().zip(expected) {
                        let off = f32::from(*got) - expected.min(255.0);
                        assert!((-3.5..=0.5).contains(&off), "{x} {y} {span:?}: {got} instead of {expected}");
                        assert!(near > 0.0 || *got == byte);
                    }
                }
            }
        }
    }
}

#[test]
fn gains_give_the_inks_colour_in_the_pixels_light() {
    let full = (Cover::ALL / 2.0) as u16;
    let ink = |r: u16, g: u16, b: u16| [r, g, b].map(|c| c * 128).into_iter().chain([full]).collect::<Vec<_>>();
    let inks: Vec<Sum> = [ink(200, 100, 50), ink(255, 255, 255), vec![0; 4]].map(|i| i.try_into().unwrap()).into();
    let pixels = [[240, 150, 125]; 20];
    let mut gains = [[0; 4]; 3];
    let cover = Cover { most: 1.0, full_at: 0.1 * Cover::ALL };
    for (name, level) in levels() {
        on_level!(level, simd => tint::find(simd, (&inks, cover), &pixels, 0..3, &mut gains));
        let coloured = |n: usize| [0, 1, 2].map(|c| f32::from(gains[n][c]) / 1024.0 * f32::from(pixels[0][c]));
        for (n, expected) in [(0, [200.0, 100.0, 50.0]), (1, [255.0; 3])] {
            for (got, expected) in coloured(n).into_iter().zip(expected) {
                let expected = expected * 240.0 / 255.0;
                assert!((got - expected).abs() < 8.0, "{name}: {:?}", coloured(n));
            }
        }
        assert_eq!(gains[2], [ONE; 4], "no ink");
    }
    // Rows of every length, from every ray on, have the same.
    let row: Vec<Sum> = (0..60).map(|n| inks[n % 3]).collect();
    for width in [1usize, 7, 8, 124, 125, 129, 300, 400] {
        let pixels: Vec<[u8; 3]> = (0..width).map(|n| [240, (n % 200) as u8, 125]).collect();
        let rays = width.div_ceil(STEP) + 1;
        for first in [0, 1, rays / 2, rays - 1] {
            let mut some = vec![[0; 4]; rays];
            on_level!(Level::new(), simd => tint::find(simd, (&row[..rays], cover), &pixels, first..rays, &mut some));
            for n in first..rays {
                let (own, mut one) = (pixels[(n * STEP).min(width - 1)], [[0; 4]]);
                on_level!(Level::new(), simd => tint::find(simd, (&row[n..=n], cover), &[own], 0..1, &mut one));
                assert_eq!(some[n], one[0], "{width} {first} {n}");
            }
            assert!(some[..first].iter().all(|gains| *gains == [0; 4]));
        }
    }
}
