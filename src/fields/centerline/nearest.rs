//! Which point of a line each cell of the lumen belongs to.

use std::collections::VecDeque;

use glam::DVec3;
use rayon::prelude::*;

use super::cells::Cells;
use super::polyline::is_free;
use crate::error::Result;
use crate::fields::WallDistance;
use crate::progress::Progress;

/// Returns the middle of each cell of the lumen (world, mm) with the line and the point of that line that it belongs to: the nearest
/// point of all `lines` (world, mm) if it is in sight, else the one from which a flood through the lumen, from all points of all lines
/// at once, reaches the cell first. Cells that no flood reaches are left out.
///
/// # Errors
/// Returns status 4 if interrupted.
pub(in crate::fields) fn nearest_through(
    walls: &WallDistance,
    lines: &[&[DVec3]],
    progress: &Progress,
) -> Result<Vec<(DVec3, u32, u32)>> {
    let cells = Cells::of(walls, 0.0, progress)?;
    let mut of: Vec<Option<(u32, u32)>> = vec![None; cells.nodes.len()];
    let mut open = VecDeque::new();
    for (l, line) in lines.iter().enumerate() {
        for (p, &at) in line.iter().enumerate() {
            if let Some(n) = cells.node_at(walls.voxel(at)).filter(|&n| of[n as usize].is_none()) {
                of[n as usize] = Some((l as u32, p as u32));
                open.push_back(n);
            }
        }
    }
    progress.check()?;
    while let Some(n) = open.pop_front() {
        for &m in cells.neighbours(n) {
            if of[m as usize].is_none() {
                of[m as usize] = of[n as usize];
                open.push_back(m);
            }
        }
    }
    progress.check()?;
    let owner = |(n, of): (usize, Option<(u32, u32)>)| {
        let (place, flooded) = (cells.place(n as u32), of?);
        let (line, point) = nearest(lines, place)
            .filter(|n| is_free(walls, place, lines[n.0][n.1]))
            .map_or(flooded, |(line, point)| (line as u32, point as u32));
        Some((place, line, point))
    };
    Ok(of.into_par_iter().enumerate().filter_map(owner).collect())
}

/// Returns the line and the number of the point that is nearest to a place.
fn nearest(lines: &[&[DVec3]], place: DVec3) -> Option<(usize, usize)> {
    let points = lines.iter().enumerate().flat_map(|(l, line)| line.iter().enumerate().map(move |(p, at)| (l, p, at)));
    let squares = points.map(|(l, p, at)| (at.distance_squared(place), l, p));
    squares.reduce(|a, b| if b.0 < a.0 { b } else { a }).map(|(_, l, p)| (l, p))
}
