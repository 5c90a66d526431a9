//! The cheapest way over the blocks.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::tissue::Costs;
use crate::error::Result;
use crate::progress::Progress;

/// Number of blocks settled between two checks for cancellation.
const EVERY: usize = 1 << 14;
/// Lengths are counted in this fraction of a millimetre.
const PER_MM: f64 = 64.0;
/// The block before one that has not been reached.
const NONE: u32 = u32::MAX;

/// Returns the blocks of the least-cost way from `start` to `goal` (Dijkstra 1959). A step costs its length times the mean cost
/// of both blocks.
///
/// Costs are whole numbers, and of equal ones the block with the smaller number comes first, so the path is the same everywhere.
pub(super) fn cheapest(costs: &Costs, start: usize, goal: usize, progress: &Progress) -> Result<Vec<usize>> {
    let mut cost = vec![u32::MAX; costs.cost.len()];
    let mut before = vec![NONE; costs.cost.len()];
    let mut open = BinaryHeap::from([Reverse((0u32, start as u32))]);
    cost[start] = 0;
    let mut settled = 0;
    while let Some(Reverse((spent, n))) = open.pop() {
        let n = n as usize;
        if spent > cost[n] {
            continue;
        }
        if n == goal {
            break;
        }
        settled += 1;
        if settled % EVERY == 0 {
            progress.check()?;
        }
        let here = u32::from(costs.cost[n]);
        costs.around(n, |m, mm| {
            let step = (mm * PER_MM) as u32 * (here + u32::from(costs.cost[m]));
            let total = spent.saturating_add(step.max(1));
            if total < cost[m] {
                cost[m] = total;
                before[m] = n as u32;
                open.push(Reverse((total, m as u32)));
            }
        });
    }
    let mut way = vec![goal];
    let mut at = goal;
    while before[at] != NONE {
        at = before[at] as usize;
        way.push(at);
    }
    way.reverse();
    Ok(way)
}
