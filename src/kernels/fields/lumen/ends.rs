//! The two ends of each piece of gas, and their distance along it.

use glam::DVec3;

use super::graph::{Graph, Node};
use super::runs::Rows;
use crate::fields::neighbours::Ways;
use crate::volume::Grid;

/// Minimum clearance of an end, mm, so that a catheter's tube does not count as one. Ignored if everything is narrower.
const END_CLEARANCE_MM: f64 = 3.5;
/// Maximum distance by which an end moves from the tip into the wider lumen, mm.
const INWARD_MM: f64 = 25.0;
/// Maximum measured radius of an inscribed ball, mm.
const BALL_MM: f64 = 40.0;

/// The ends of one piece of gas.
#[derive(Clone, Debug)]
pub(super) struct Ends {
    pub at: [DVec3; 2],
    pub length_mm: f64,
    /// The way from the first end to the second, without the zigzag of the cells, world, mm.
    pub way: Vec<DVec3>,
    /// Clearance along the way from end to end, mm, every few mm.
    pub clearances: Vec<f64>,
}

/// Finds the ends of the gas of `label` by a double sweep: twice the farthest position from the previous one, along
/// paths that keep away from walls, so that a pocket between two folds is nearer than the end behind it.
pub(super) fn ends(grid: &Grid, rows: &Rows, graph: &Graph, label: u32) -> Option<Ends> {
    let nodes: Vec<u32> = graph.of_label(label).collect();
    let clearance = |n: u32| graph.nodes[n as usize].clearance;
    let widest = nodes.iter().copied().reduce(|a, b| if clearance(b) > clearance(a) { b } else { a })?;
    let roomy: Vec<u32> = nodes.iter().copied().filter(|&n| clearance(n) >= END_CLEARANCE_MM).collect();
    let eligible = if roomy.is_empty() { nodes } else { roomy };
    let farthest = |ways: &Ways| {
        let length = |n: u32| Some(ways.length[n as usize]).filter(|l| l.is_finite()).unwrap_or(-1.0);
        eligible.iter().copied().reduce(|a, b| if length(b) > length(a) { b } else { a })
    };
    let first = farthest(&graph.ways(widest))?;
    let second = farthest(&graph.ways(first))?;
    let second = inward(graph, second);
    let back = graph.ways(second);
    let first = inward(graph, farthest(&back)?);
    let mut polyline = vec![graph.nodes[first as usize].centre];
    let mut clearances = vec![clearance(first)];
    let mut n = first;
    while back.before[n as usize] != n {
        n = back.before[n as usize];
        polyline.push(graph.nodes[n as usize].centre);
        clearances.push(clearance(n));
    }
    let at = [first, second].map(|n| centred(grid, rows, &graph.nodes[n as usize]));
    let way = smooth(&polyline);
    // An empty sum is −0.
    let length_mm = way.windows(2).map(|w| w[0].distance(w[1])).sum::<f64>() + 0.0;
    Some(Ends { at, length_mm, way, clearances })
}

/// Climbs from a tip to where the lumen near it is wide: a gain in clearance is worth five times the distance.
fn inward(graph: &Graph, tip: u32) -> u32 {
    let node = |n: u32| &graph.nodes[n as usize];
    let away = |n: u32| node(n).centre.distance(node(tip).centre);
    let worth = |n: u32| node(n).clearance - 0.2 * away(n);
    let mut at = tip;
    loop {
        let near = graph.neighbours(at).iter().flat_map(|&m| graph.neighbours(m).iter().copied().chain([m]));
        let near = near.filter(|&m| node(m).label == node(tip).label);
        let next =
            near.filter(|&m| away(m) <= INWARD_MM).fold(at, |best, m| if worth(m) > worth(best) { m } else { best });
        if next == at {
            return at;
        }
        at = next;
    }
}

/// Returns a path without the zigzag of the cells: each point is replaced by the mean of five.
fn smooth(polyline: &[DVec3]) -> Vec<DVec3> {
    let mean = |n: usize| {
        let reach = 2.min(n).min(polyline.len() - 1 - n);
        polyline[n - reach..=n + reach].iter().sum::<DVec3>() / (2 * reach + 1) as f64
    };
    (0..polyline.len()).map(mean).collect()
}

/// Returns the voxel near a node's centre with the largest inscribed ball among its neighbours, found with halving steps.
fn centred(grid: &Grid, rows: &Rows, node: &Node) -> DVec3 {
    let Some(mut at) = nearest(grid, rows, node.centre, BALL_MM, |l| l == node.label).map(|n| n.1) else {
        return node.centre;
    };
    let mut best = ball(grid, rows, at, node.label);
    let voxel_mm = grid.spacing();
    let mut step_mm = 4.0;
    while step_mm >= grid.min_spacing() {
        let step = (DVec3::splat(step_mm) / voxel_mm).round();
        let start = at;
        for n in 0..27 {
            let polyline = DVec3::new(f64::from(n % 3 - 1), f64::from(n / 3 % 3 - 1), f64::from(n / 9 - 1));
            let to = to_index(grid.voxel(start) + polyline * step);
            if rows.find(to[0], to[1], to[2]).is_some_and(|r| r.label == node.label) {
                let to = grid.world(DVec3::new(to[0] as f64, to[1] as f64, to[2] as f64));
                let r = ball(grid, rows, to, node.label);
                if r > best {
                    (at, best) = (to, r);
                }
            }
        }
        if at == start {
            step_mm /= 2.0;
        }
    }
    at
}

/// Returns the voxel at (fractional) voxel coordinates.
pub(super) fn to_index(voxel: DVec3) -> [i64; 3] {
    // `as` saturates, so a position far outside stays outside.
    voxel.to_array().map(|x| x.round() as i64)
}

/// Returns the distance, mm, from the centre of the gas voxel at `world` to the nearest voxel centre that is not gas of `label`.
fn ball(grid: &Grid, rows: &Rows, world: DVec3, label: u32) -> f64 {
    let [i, j, k] = to_index(grid.voxel(world));
    let spacing = grid.spacing();
    let mut best = BALL_MM;
    for dk in outward((BALL_MM / spacing.z) as i64) {
        let z = dk as f64 * spacing.z;
        if z.abs() >= best {
            break;
        }
        for dj in outward((BALL_MM / spacing.y) as i64) {
            let yz = z.hypot(dj as f64 * spacing.y);
            if yz >= best {
                break;
            }
            let run = rows.find(i, j + dj, k + dk).filter(|r| r.label == label);
            let gap = run.map_or(0, |r| (i - i64::from(r.start) + 1).min(i64::from(r.end) - i));
            best = best.min(yz.hypot(gap as f64 * spacing.x));
        }
    }
    best
}

/// 0, 1, −1, 2, −2, …, ±n.
fn outward(n: i64) -> impl Iterator<Item = i64> {
    (0..=2 * n).map(|a| if a % 2 == 1 { a / 2 + 1 } else { -(a / 2) })
}

/// Returns the nearest voxel within `within_mm` whose label `of` accepts: its label and centre.
pub(super) fn nearest(
    grid: &Grid,
    rows: &Rows,
    world: DVec3,
    within_mm: f64,
    of: impl Fn(u32) -> bool,
) -> Option<(u32, DVec3)> {
    if !world.is_finite() || within_mm.is_nan() || within_mm < 0.0 {
        return None;
    }
    let centre = grid.voxel(world);
    let dims = rows.dims();
    // The index span of a world distance is the length of that row of the inverse matrix.
    let inverse = grid.to_voxel().matrix3.transpose();
    let reach = |a: usize| inverse.col(a).length() * within_mm;
    let span = |a: usize| {
        let (lo, hi) = ((centre[a] - reach(a)).ceil().max(0.0), (centre[a] + reach(a)).floor());
        lo as usize..(hi + 1.0).clamp(0.0, dims[a] as f64) as usize
    };
    let mut best: Option<(u32, DVec3)> = None;
    let mut best_mm = within_mm;
    for k in span(2) {
        for j in span(1) {
            for r in rows.row(j, k).iter().filter(|r| of(r.label)) {
                let i = centre.x.round().clamp(f64::from(r.start), f64::from(r.end - 1));
                let p = grid.world(DVec3::new(i, j as f64, k as f64));
                let d = p.distance(world);
                if d < best_mm || (best.is_none() && d <= best_mm) {
                    (best, best_mm) = (Some((r.label, p)), d);
                }
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::fields::lumen::runs::Run;

    /// A single voxel is found from every side, within the grid and beyond it, as far as asked and no farther.
    #[test]
    fn the_nearest_voxel_is_found_within_the_given_distance() {
        let grid = Grid::new([9; 3], DVec3::new(0.5, 1.0, 2.0), DVec3::new(-3.0, 5.0, 7.0), DMat3::IDENTITY).unwrap();
        let slice = |k: usize| {
            let lengths: Vec<u32> = (0..9).map(|j| u32::from(j == 4 && k == 4)).collect();
            (lengths, vec![Run { start: 4, end: 5, label: 6 }; usize::from(k == 4)])
        };
        let rows = Rows::from_slices([9; 3], (0..9).map(slice).collect()).unwrap();
        let voxel = grid.world(DVec3::splat(4.0));
        for side in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z] {
            for mm in [0.4, 1.0, 3.0, 12.0] {
                let at = voxel + side * mm;
                assert_eq!(nearest(&grid, &rows, at, mm + 1e-6, |_| true), Some((6, voxel)), "{mm} mm along {side}");
                assert_eq!(nearest(&grid, &rows, at, mm - 1e-6, |_| true), None, "{mm} mm along {side}");
                assert_eq!(nearest(&grid, &rows, at, mm + 1e-6, |label| label != 6), None, "another label");
            }
        }
    }
}
