//! Ways through the lumen between many places: how long each is, and the line to fly.
//!
//! One search over all cells from the first place finds the least-cost paths to all others (as for the centerline: narrow places cost
//! more, and those that a body does not fit through are closed). The longest of them is the spine. A search from each place goes as
//! far as 45 mm, to the places and the part of the spine near it. A way leads directly to a near place, else to the spine, along
//! it and off it again, whichever is the shortest; all of them stay in the lumen. A place far from the spine, in a side branch, is
//! reached up and down the tree of paths from the first place. `O(m log m)` for `m` cells, and `O(k log k)` for the `k` cells near each
//! place, in parallel.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;
use rayon::prelude::*;

use super::cells::Cells;
use super::{Centerline, SNAP_MM, STEP_MM, TIGHTEN, finished, narrow, polyline};
use crate::error::Result;
use crate::fields::WallDistance;
use crate::fields::neighbours;
use crate::progress::Progress;

/// Length of the ways that the search around each place finds, mm.
const NEAR_MM: f64 = 45.0;

/// The ways between places in the lumen.
pub struct Legs<'a> {
    walls: &'a WallDistance,
    cells: Cells,
    /// Minimum distance to the wall, mm.
    least_mm: f64,
    stops: Vec<Option<Stop>>,
    /// The least-cost paths from the first place.
    tree: neighbours::Ways,
    /// The nodes of the spine, each touching the one before.
    spine: Vec<u32>,
    near: Vec<Near>,
}

/// What is near a place.
#[derive(Clone, Debug, Default)]
struct Near {
    /// Lengths of the ways to the other places, mm; infinite beyond [`NEAR_MM`].
    places: Vec<f64>,
    /// Nodes of the spine: the length of the way there, and its distance along the spine, mm.
    spine: Vec<(u32, [f64; 2])>,
}

/// How a path leads.
#[derive(Clone, Copy, Debug)]
enum Course {
    /// Within one node.
    Inside,
    /// Directly to a near place.
    Direct,
    /// Along the spine from one node to another.
    Spine([u32; 2]),
    /// Up the tree to a node, and down.
    Tree(u32),
}

/// A place in the lumen.
#[derive(Clone, Copy, Debug)]
struct Stop {
    place: DVec3,
    voxel: [i64; 3],
    node: u32,
}

impl<'a> Legs<'a> {
    /// Finds the ways between `places` (world mm) for a body that needs `least_mm` on each side. A place outside the lumen is moved
    /// into it by at most 5 mm.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn between(walls: &'a WallDistance, places: &[DVec3], least_mm: f64, progress: &Progress) -> Result<Self> {
        let cells = Cells::of(walls, least_mm, progress)?;
        let stop = |&place: &DVec3| {
            let voxel = walls.nearest(place, SNAP_MM)?;
            let place = if walls.voxel(place) == voxel { place } else { walls.world(voxel) };
            cells.node_at(voxel).map(|node| Stop { place, voxel, node })
        };
        let stops: Vec<Option<Stop>> = places.iter().map(stop).collect();
        let tree = match stops.first().copied().flatten() {
            Some(first) => cells.ways(first.node, None, |mm| weight(mm, least_mm)),
            None => neighbours::Ways { length: vec![f64::INFINITY; cells.nodes.len()], before: Vec::new() },
        };
        let length = |n: u32| tree.length[n as usize];
        let ends = stops.iter().flatten().map(|s| s.node).filter(|&n| length(n).is_finite());
        let end = ends.reduce(|a, b| if length(b) > length(a) { b } else { a });
        let spine = end.map_or_else(Vec::new, |end| cells.way(&tree, end));
        // Nodes between two that do not touch are on the spine, too, but have no length of this path.
        let mut on_spine: Vec<u32> = Vec::new();
        let mut at = end;
        while let Some(n) = at {
            on_spine.push(n);
            at = Some(tree.before[n as usize]).filter(|b| *b != n);
        }
        let near = stops
            .par_iter()
            .map(|from| {
                progress.check()?;
                let Some(from) = from else { return Ok(Near::default()) };
                let search = Search::around(&cells, from.node, None, least_mm);
                let places = stops.iter().map(|to| to.map_or(f64::INFINITY, |to| search.length(to.node))).collect();
                let reached = on_spine.iter().map(|&n| (n, [search.length(n), length(n)]));
                Ok(Near { places, spine: reached.filter(|(_, mm)| mm[0].is_finite()).collect() })
            })
            .collect::<Result<_>>()?;
        Ok(Self { walls, cells, least_mm, stops, tree, spine, near })
    }

    /// Returns the length of the path between two places, mm, counted from 0; infinite if there is none. It is that over cells, and a
    /// line is somewhat shorter.
    pub fn mm(&self, a: usize, b: usize) -> f64 {
        self.course(a, b).map_or(f64::INFINITY, |c| c.0)
    }

    /// Returns the shortest way between two places: its length, mm, and how it leads.
    fn course(&self, a: usize, b: usize) -> Option<(f64, Course)> {
        let (from, to) = (self.stop(a)?, self.stop(b)?);
        if from.node == to.node {
            return Some((from.place.distance(to.place), Course::Inside));
        }
        let mut best = (self.near[a.min(b)].places[a.max(b)], Course::Direct);
        if let Some(way) = self.along_tree(from.node, to.node)
            && way.0 < best.0
        {
            best = (way.0, Course::Tree(way.1));
        }
        for &(p, [off, s]) in &self.near[a].spine {
            for &(q, [on, t]) in &self.near[b].spine {
                let mm = off + (s - t).abs() + on;
                if mm < best.0 {
                    best = (mm, Course::Spine([p, q]));
                }
            }
        }
        best.0.is_finite().then_some(best)
    }

    /// Returns the line between two places, counted from 0, which keeps away from the wall; `None` if there is no way.
    pub fn line(&self, a: usize, b: usize) -> Option<Centerline> {
        let (from, to) = (self.stop(a)?, self.stop(b)?);
        let nodes = match self.course(a, b)?.1 {
            Course::Inside => vec![from.node],
            // In the direction in which it was found: a bounded search back may find another way, which is too long.
            Course::Direct if a <= b => self.nearby(from.node, to.node)?,
            Course::Direct => {
                let mut way = self.nearby(to.node, from.node)?;
                way.reverse();
                way
            }
            Course::Spine([p, q]) => {
                let at = |n: u32| self.spine.iter().position(|m| *m == n);
                let (i, j) = (at(p)?, at(q)?);
                let mut way = self.nearby(from.node, p)?;
                if i <= j {
                    way.extend(self.spine[i..=j].iter().skip(1));
                } else {
                    way.extend(self.spine[j..=i].iter().rev().skip(1));
                }
                way.extend(self.nearby(to.node, q)?.iter().rev().skip(1));
                way
            }
            Course::Tree(top) => {
                let below = |node: u32| {
                    let way = self.cells.way(&self.tree, node);
                    let at = way.iter().position(|n| *n == top).unwrap_or(0);
                    way[at..].to_vec()
                };
                let mut way = below(from.node);
                way.reverse();
                way.extend(below(to.node).iter().skip(1));
                way
            }
        };
        let voxels = self.cells.voxels(&nodes, from.voxel, to.voxel);
        let mut line: Vec<DVec3> = voxels.into_iter().map(|v| self.walls.world(v)).collect();
        match &mut line[..] {
            [first, .., last] => (*first, *last) = (from.place, to.place),
            _ => line = vec![from.place, to.place],
        }
        let mut line = polyline::resampled(self.walls, &line, STEP_MM);
        polyline::tightened(self.walls, &mut line, TIGHTEN, polyline::LEAN);
        Some(finished(self.walls, &polyline::resampled(self.walls, &line, STEP_MM)))
    }

    /// Returns the nodes of the way between two near nodes, each touching the one before.
    fn nearby(&self, from: u32, to: u32) -> Option<Vec<u32>> {
        let search = Search::around(&self.cells, from, Some(to), self.least_mm);
        let ways = search.into_ways(self.cells.nodes.len());
        ways.length[to as usize].is_finite().then(|| self.cells.way(&ways, to))
    }

    fn stop(&self, n: usize) -> Option<Stop> {
        self.stops.get(n).copied().flatten()
    }

    /// Returns the length of the way up the tree from one node and down to another, mm, and the node where it turns; `None` if the tree
    /// does not reach both.
    fn along_tree(&self, a: u32, b: u32) -> Option<(f64, u32)> {
        let length = |n: u32| self.tree.length[n as usize];
        if !(length(a).is_finite() && length(b).is_finite()) {
            return None;
        }
        let (mut x, mut y) = (a, b);
        // Costs grow along a path, and so do lengths: the farther one cannot be on the other's path.
        while x != y {
            if length(x) >= length(y) && self.tree.before[x as usize] != x {
                x = self.tree.before[x as usize];
            } else {
                y = self.tree.before[y as usize];
            }
        }
        Some((length(a) + length(b) - 2.0 * length(x), x))
    }
}

fn weight(clearance: f64, least_mm: f64) -> f64 {
    if clearance < least_mm { f64::INFINITY } else { narrow(clearance) }
}

/// The least-cost paths around a node.
struct Search {
    /// Node, its predecessor and the length of its path, mm, ascending by node.
    reached: Vec<(u32, u32, f64)>,
}

impl Search {
    /// Searches as far as [`NEAR_MM`], or as `to`: Dijkstra's algorithm as in [`neighbours`], with a bound.
    fn around(cells: &Cells, start: u32, to: Option<u32>, least_mm: f64) -> Self {
        let count = cells.nodes.len();
        let (mut cost, mut before) = (vec![f64::INFINITY; count], vec![start; count]);
        let (mut length, mut done) = (vec![f64::INFINITY; count], vec![false; count]);
        let mut reached = Vec::new();
        let mut open = BinaryHeap::new();
        (cost[start as usize], length[start as usize]) = (0.0, 0.0);
        open.push(Reverse((0u64, start)));
        while let Some(Reverse((_, n))) = open.pop() {
            if std::mem::replace(&mut done[n as usize], true) {
                continue;
            }
            reached.push((n, before[n as usize], length[n as usize]));
            if to == Some(n) {
                break;
            }
            let mut reach = |m: u32| {
                if done[m as usize] {
                    return;
                }
                let step = cells.place(n).distance(cells.place(m));
                let far = length[n as usize] + step;
                let mean = 0.5 * (cells.nodes[n as usize].clearance() + cells.nodes[m as usize].clearance());
                let c = cost[n as usize] + step * weight(mean, least_mm);
                if far <= NEAR_MM && c < cost[m as usize] {
                    (cost[m as usize], before[m as usize], length[m as usize]) = (c, n, far);
                    open.push(Reverse((c.to_bits(), m)));
                }
            };
            for &m in cells.neighbours(n) {
                reach(m);
                cells.neighbours(m).iter().for_each(|&far| reach(far));
            }
        }
        reached.sort_unstable_by_key(|r| r.0);
        Self { reached }
    }

    fn length(&self, node: u32) -> f64 {
        self.reached.binary_search_by_key(&node, |r| r.0).map_or(f64::INFINITY, |at| self.reached[at].2)
    }

    fn into_ways(self, count: usize) -> neighbours::Ways {
        let mut ways = neighbours::Ways { length: vec![f64::INFINITY; count], before: (0..count as u32).collect() };
        for (n, before, length) in self.reached {
            (ways.before[n as usize], ways.length[n as usize]) = (before, length);
        }
        ways
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tube of radius 8 mm along x, 300 mm long, with a pocket of radius 5 mm along y at x = 150, and a chamber apart.
    fn tube() -> WallDistance {
        WallDistance::drawn([320, 80, 30], DVec3::ONE, |p| {
            let main = (p.y - 12.0).hypot(p.z - 14.0) < 8.0 && (5.0..305.0).contains(&p.x);
            let pocket = (p.x - 150.0).hypot(p.z - 14.0) < 5.0 && (12.0..60.0).contains(&p.y);
            let apart = (p.x - 250.0).hypot(p.y - 60.0).hypot(p.z - 14.0) < 9.0;
            main || pocket || apart
        })
    }

    #[test]
    fn ways_follow_the_lumen_and_their_lines_keep_inside() {
        let walls = tube();
        let at = |x: f64, y: f64| DVec3::new(x, y, 14.0);
        let places =
            [at(20.0, 12.0), at(290.0, 12.0), at(150.0, 54.0), at(250.0, 60.0), at(135.0, 12.0), at(235.0, 12.0)];
        let legs = Legs::between(&walls, &places, 1.5, &Progress::new()).unwrap();
        let expected = |a: usize, b: usize, mm: f64| {
            let (there, back) = (legs.mm(a, b), legs.mm(b, a));
            assert!(there == back && (there - mm).abs() < 0.1 * mm + 4.0, "{a} to {b}: {there} for {mm}");
            let line = legs.line(a, b).unwrap();
            assert!((line.length_mm - mm).abs() < 0.06 * mm + 3.0, "{a} to {b}: {} for {mm}", line.length_mm);
            assert!(line.points[0] == places[a] && line.points[line.points.len() - 1] == places[b]);
            assert!(line.points.windows(2).all(|w| polyline::is_free(&walls, w[0], w[1])));
            assert!(line.radius_mm.iter().all(|r| *r > 1.5), "{:?}", line.radius_mm);
        };
        expected(0, 1, 270.0);
        expected(0, 2, 130.0 + 40.0);
        expected(1, 2, 140.0 + 40.0);
        expected(2, 4, 15.0 + 40.0);
        expected(4, 4, 0.0);
        expected(5, 4, 100.0);
        expected(5, 2, 85.0 + 40.0);
        assert!(legs.mm(0, 3).is_infinite() && legs.line(3, 1).is_none() && legs.line(0, 9).is_none());
    }

    #[test]
    fn what_the_body_does_not_fit_through_is_no_way() {
        let walls = tube();
        let places = [DVec3::new(20.0, 12.0, 14.0), DVec3::new(150.0, 54.0, 14.0), DVec3::splat(900.0)];
        let legs = |least_mm| Legs::between(&walls, &places, least_mm, &Progress::new()).unwrap();
        assert!(legs(1.5).mm(0, 1).is_finite() && legs(6.5).mm(0, 1).is_infinite());
        assert!(legs(1.5).mm(0, 2).is_infinite() && legs(1.5).mm(2, 2).is_infinite());
        let none = Legs::between(&walls, &[DVec3::NAN, places[0]], 1.5, &Progress::new()).unwrap();
        assert!(none.mm(0, 1).is_infinite() && none.line(0, 1).is_none());
        let empty = Legs::between(&walls, &[], 1.5, &Progress::new()).unwrap();
        assert!(empty.mm(0, 0).is_infinite());
    }
}
