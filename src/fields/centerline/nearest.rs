//! Which point of a line each cell of the lumen belongs to.

use std::collections::VecDeque;

use glam::DVec3;

use super::cells::Cells;
use crate::error::Result;
use crate::fields::WallDistance;
use crate::progress::Progress;

/// Returns the middle of each cell of the lumen (world, mm) with the line and the point of that line from which a flood through the
/// lumen, from all points of all `lines` (world, mm) at once, reaches it first. Cells that no flood reaches are left out.
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
    let reached = of.into_iter().enumerate().filter_map(|(n, of)| of.map(|(l, p)| (cells.place(n as u32), l, p)));
    Ok(reached.collect())
}
