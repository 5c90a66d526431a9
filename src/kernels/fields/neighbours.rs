//! Neighbours of a map's numbered nodes, and least-cost paths over them. Shared by the coarse map of the gas and the
//! cells of the centerline.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The neighbours of each node, as compressed rows.
#[derive(Clone, Debug, Default)]
pub(in crate::fields) struct Neighbours {
    /// Index of each node's first neighbour in `nodes`; one more entry than there are nodes.
    first: Vec<u32>,
    nodes: Vec<u32>,
}

/// The least-cost paths from one node.
#[derive(Debug)]
pub(in crate::fields) struct Ways {
    /// Length of the path to every node, mm; infinite if there is none.
    pub length: Vec<f64>,
    /// Predecessor of every node on its path; the node itself at the start and if there is no path.
    pub before: Vec<u32>,
}

/// The result of Dijkstra's algorithm.
#[derive(Debug)]
struct Tree {
    cost: Vec<f64>,
    /// Predecessor of every node; the node itself at a start and if there is no path.
    before: Vec<u32>,
    /// The nodes in the order in which they were reached.
    settled: Vec<u32>,
}

impl Neighbours {
    /// Creates the neighbours of `count` nodes from links, each in either direction, in any order, with or without duplicates.
    pub(crate) fn new(count: usize, links: &[(u32, u32)]) -> Self {
        // Each list is counted, then filled. Sorted pairs in both directions would be the largest part of a map while it is made.
        let mut first = vec![0; count + 1];
        for &(a, b) in links {
            first[a as usize + 1] += 1;
            first[b as usize + 1] += 1;
        }
        for n in 0..count {
            first[n + 1] += first[n];
        }
        let mut nodes = vec![0; first[count] as usize];
        let mut next = first.clone();
        for &(a, b) in links {
            for (of, m) in [(a, b), (b, a)] {
                let at = &mut next[of as usize];
                nodes[*at as usize] = m;
                *at += 1;
            }
        }
        drop(next);
        let (mut from, mut kept) = (0, 0);
        for n in 0..count {
            let to = first[n + 1] as usize;
            nodes[from..to].sort_unstable();
            first[n] = kept as u32;
            for m in from..to {
                if m == from || nodes[m] != nodes[kept - 1] {
                    nodes[kept] = nodes[m];
                    kept += 1;
                }
            }
            from = to;
        }
        first[count] = kept as u32;
        nodes.truncate(kept);
        nodes.shrink_to_fit();
        Self { first, nodes }
    }

    /// Returns the neighbours of a node, ascending.
    pub(crate) fn of(&self, n: u32) -> &[u32] {
        &self.nodes[self.first[n as usize] as usize..self.first[n as usize + 1] as usize]
    }

    /// Returns the least-cost paths from `start` to all nodes, or as far as `to`. A path costs its length times
    /// `weight`; `step` is the distance between two nodes, mm.
    pub(crate) fn ways(
        &self,
        start: u32,
        to: Option<u32>,
        step: impl Fn(u32, u32) -> f64,
        weight: impl Fn(u32, u32) -> f64,
    ) -> Ways {
        let Tree { before, settled, .. } = self.dijkstra(&[(start, 0.0)], to, |n, m| step(n, m) * weight(n, m));
        let mut length = vec![f64::INFINITY; before.len()];
        for n in settled {
            let b = before[n as usize];
            length[n as usize] = if b == n { 0.0 } else { length[b as usize] + step(n, b) };
        }
        Ways { length, before }
    }

    /// Returns the least cost of a path to each node from any of the starts `from` (nodes with their initial costs).
    pub(crate) fn costs(&self, from: &[(u32, f64)], cost: impl Fn(u32, u32) -> f64) -> Vec<f64> {
        self.dijkstra(from, None, cost).cost
    }

    /// Returns for each node the start from which the least-cost path leads to it, if there is one.
    pub(crate) fn roots(&self, from: &[(u32, f64)], cost: impl Fn(u32, u32) -> f64) -> Vec<Option<u32>> {
        let Tree { before, settled, .. } = self.dijkstra(from, None, cost);
        let mut roots = vec![None; before.len()];
        for n in settled {
            let b = before[n as usize];
            roots[n as usize] = if b == n { Some(n) } else { roots[b as usize] };
        }
        roots
    }

    /// Runs Dijkstra's algorithm over neighbours and their neighbours, so that a path may run diagonally through two
    /// cells. Ties go to the smaller node.
    fn dijkstra(&self, from: &[(u32, f64)], to: Option<u32>, step_cost: impl Fn(u32, u32) -> f64) -> Tree {
        let count = self.first.len() - 1;
        let mut cost = vec![f64::INFINITY; count];
        let mut before: Vec<u32> = (0..count as u32).collect();
        let mut done = vec![false; count];
        let mut settled = Vec::new();
        // Costs are not negative, so their bits have the same order.
        let mut open: BinaryHeap<Reverse<(u64, u32)>> = BinaryHeap::new();
        for &(n, c) in from {
            cost[n as usize] = c;
            open.push(Reverse((c.to_bits(), n)));
        }
        while let Some(Reverse((_, n))) = open.pop() {
            if std::mem::replace(&mut done[n as usize], true) {
                continue;
            }
            settled.push(n);
            if to == Some(n) {
                break;
            }
            let mut reach = |m: u32| {
                if done[m as usize] {
                    return;
                }
                let c = cost[n as usize] + step_cost(n, m);
                if c < cost[m as usize] {
                    cost[m as usize] = c;
                    before[m as usize] = n;
                    open.push(Reverse((c.to_bits(), m)));
                }
            };
            for &m in self.of(n) {
                reach(m);
                self.of(m).iter().for_each(|&far| reach(far));
            }
        }
        Tree { cost, before, settled }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of nodes 1 mm apart, and an isolated node.
    fn row(count: u32) -> Neighbours {
        let links: Vec<_> = (1..count).flat_map(|n| [(n - 1, n), (n, n - 1), (n - 1, n)]).collect();
        Neighbours::new(count as usize + 1, &links)
    }

    fn apart(a: u32, b: u32) -> f64 {
        (f64::from(a) - f64::from(b)).abs()
    }

    #[test]
    fn ways_lead_over_neighbours_of_neighbours() {
        let map = row(7);
        assert_eq!((map.of(0), map.of(3), map.of(7)), (&[1][..], &[2, 4][..], &[][..]));
        let ways = map.ways(0, None, apart, |_, _| 1.0);
        assert_eq!(ways.length[..7], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert!(ways.length[7].is_infinite() && ways.before[7] == 7 && ways.before[0] == 0);
        assert_eq!((ways.before[2], ways.before[4]), (0, 2), "two at a time");
        let some = map.ways(0, Some(3), apart, |_, _| 1.0);
        assert!(some.length[3] == 3.0 && some.length[6].is_infinite());
    }

    #[test]
    fn the_cheaper_way_wins_and_lengths_are_not_costs() {
        let map = row(5);
        let dear = |n: u32, m: u32| if n.max(m) == 2 { 10.0 } else { 1.0 };
        let ways = map.ways(0, None, apart, dear);
        assert_eq!(ways.before[3], 1, "over the dear node");
        assert_eq!(ways.length[4], 4.0);
        assert_eq!(map.costs(&[(0, 5.0), (4, 0.0)], apart), [4.0, 3.0, 2.0, 1.0, 0.0, f64::INFINITY]);
        assert_eq!(
            map.roots(&[(0, 2.0), (4, 0.0)], apart),
            [0, 4, 4, 4, 4].map(Some).into_iter().chain([None]).collect::<Vec<_>>()
        );
    }
}
