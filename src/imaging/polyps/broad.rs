//! The wall as a broad, low lesion shows on it: curvatures of a coarser scale, over those of the bowel beneath.
//!
//! A plaque that follows the wall is hardly curved: on a bowel that is concave by 1/R, a plaque of height h and radius r has a curvature of
//! about 2h/r² − 1/R, which may be below 0. What bulges is the difference between the curvatures at two scales: [`LESION_MM`], at which the
//! plaque is one bump, and [`BOWEL_MM`], at which it hardly counts. For the second, the vertices of a cell of [`CELL_MM`] that face the
//! same way become one, so that it costs little.

use std::collections::BTreeMap;

use glam::Vec3;

use super::Wall;
use crate::error::Result;
use crate::progress::Progress;

/// Standard deviations of the smoothing along the surface that shows a lesion and the bowel, mm.
pub(super) const LESION_MM: f64 = 2.5;
const BOWEL_MM: f64 = 7.0;
/// Edge of the cells in which vertices become one, mm.
const CELL_MM: f32 = 2.0;

/// Returns the wall with normals of the lesion's scale, and curvatures of that scale over those of the bowel.
pub(super) fn over_bowel(wall: &Wall, progress: &Progress) -> Result<Wall> {
    let mut broad = wall.at_scale(LESION_MM, progress)?;
    let (bowel, cells) = cells(wall);
    let bowel = bowel.at_scale(BOWEL_MM, progress)?;
    broad.subtract_curvatures(|v| bowel.curvatures(cells[v as usize]));
    Ok(broad)
}

/// Returns a wall of cells, and the cell of each vertex. Both sides of a thin fold are cells of their own.
fn cells(wall: &Wall) -> (Wall, Vec<u32>) {
    let key = |v: u32| {
        let normal = wall.normal(v);
        let facing = normal.abs().max_position();
        let cell = (wall.place(v) / CELL_MM).floor().as_ivec3();
        (cell.to_array(), facing, normal[facing] > 0.0)
    };
    let mut numbers = BTreeMap::new();
    let cells: Vec<u32> = (0..wall.len() as u32)
        .map(|v| {
            let next = numbers.len() as u32;
            *numbers.entry(key(v)).or_insert(next)
        })
        .collect();
    let count = numbers.len();
    let (mut places, mut normals, mut areas) = (vec![Vec3::ZERO; count], vec![Vec3::ZERO; count], vec![0f32; count]);
    let mut pairs = Vec::new();
    for v in 0..wall.len() as u32 {
        let own = cells[v as usize];
        places[own as usize] += wall.place(v) * wall.area(v);
        normals[own as usize] += wall.normal(v) * wall.area(v);
        areas[own as usize] += wall.area(v);
        pairs.extend(wall.beside(v).iter().map(|&n| (own, cells[n as usize])).filter(|p| p.0 != p.1));
    }
    for (n, area) in areas.iter().enumerate() {
        let by = if *area > 0.0 { 1.0 / area } else { 0.0 };
        places[n] *= by;
        normals[n] *= by;
    }
    pairs.sort_unstable();
    pairs.dedup();
    (Wall::of_parts(wall.origin(), places, normals, areas, &pairs), cells)
}
