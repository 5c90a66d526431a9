//! The wall as a broad, low lesion shows on it: curvatures of a coarser scale, over those of the bowel beneath.
//!
//! A plaque that follows the wall is hardly curved: on a bowel that is concave by 1/R, a plaque of height h and radius r has a curvature of
//! about 2h/r² − 1/R, which may be below 0. What bulges is the difference between the curvatures at two scales: [`LESION_MM`], at which the
//! plaque is one bump, and [`BOWEL_MM`], at which it hardly counts. For the second, the vertices of a cell of [`CELL_MM`] that face the
//! same way become one, so that it costs little.

use glam::Vec3;
use rayon::prelude::*;

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
        (cell.to_array(), facing as u8, normal[facing] > 0.0)
    };
    let mut sorted: Vec<_> = (0..wall.len() as u32).into_par_iter().map(|v| (key(v), v)).collect();
    sorted.par_sort_unstable();
    // Numbered by their first vertex.
    let mut groups: Vec<_> = sorted.chunk_by(|a, b| a.0 == b.0).collect();
    groups.par_sort_unstable_by_key(|group| group[0].1);
    let mut cells = vec![0; wall.len()];
    for (n, group) in groups.iter().enumerate() {
        group.iter().for_each(|(_, v)| cells[*v as usize] = n as u32);
    }
    let mean = |group: &&[(_, u32)]| {
        let (mut place, mut normal, mut area) = (Vec3::ZERO, Vec3::ZERO, 0f32);
        for &(_, v) in *group {
            place += wall.place(v) * wall.area(v);
            normal += wall.normal(v) * wall.area(v);
            area += wall.area(v);
        }
        let by = if area > 0.0 { 1.0 / area } else { 0.0 };
        ((place * by, normal * by), area)
    };
    let ((places, normals), areas): ((Vec<_>, Vec<_>), Vec<_>) = groups.par_iter().map(mean).unzip();
    let beside = |(n, group): (usize, &&[(_, u32)])| {
        let all = group.iter().flat_map(|(_, v)| wall.beside(*v)).map(|&other| cells[other as usize]);
        let mut beside: Vec<u32> = all.filter(|&other| other != n as u32).collect();
        beside.sort_unstable();
        beside.dedup();
        beside.shrink_to_fit();
        beside
    };
    let beside: Vec<Vec<u32>> = groups.par_iter().enumerate().map(beside).collect();
    (Wall::of_parts(wall.origin(), places, normals, areas, &beside), cells)
}
