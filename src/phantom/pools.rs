//! Pools of fluid in the low points of a colon.

use glam::DVec3;

use super::shape::Shape;

/// A pool of tagged fluid: a stretch of colon filled up to a horizontal level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pool {
    /// Start, mm of arc length.
    pub from: f64,
    /// End, mm of arc length. At both ends the whole lumen is above the level, or the colon is closed.
    pub to: f64,
    /// Depth of the surface along the direction of gravity, world mm; fluid is deeper.
    pub level: f64,
}

/// Share of the lumen's height up to which fluid stands at most.
pub(crate) const FLUID_SHARE: f64 = 0.36;

/// Returns the pools of a colon with gravity along the unit vector `down`. Each low point holds fluid, up to the lowest saddle and
/// at most a share of the lumen's height, which `share` returns for one pool after another.
pub(crate) fn pools(shape: &Shape, down: DVec3, mut share: impl FnMut() -> f64) -> Vec<Pool> {
    const STEP: f64 = 1.0;
    let count = (shape.axis.length() / STEP) as usize + 1;
    let s = |i: usize| (i as f64 * STEP).min(shape.axis.length());
    // The lowest and highest positions that the lumen can reach at each arc length, and where fluid can be.
    let place: Vec<(f64, f64)> =
        (0..count).map(|i| (shape.axis.frame(s(i)).at.dot(down), shape.largest_radius(s(i)))).collect();
    let bottom = |i: usize| place[i].0 + place[i].1;
    // Margin at the ends, mm; blur does not reach beyond it.
    let margin = 4.0;
    let mut order: Vec<usize> = (0..count)
        .filter(|&i| (i == 0 || bottom(i) > bottom(i - 1)) && (i + 1 == count || bottom(i) >= bottom(i + 1)))
        .collect();
    order.sort_by(|&a, &b| bottom(b).total_cmp(&bottom(a)).then(a.cmp(&b)));
    let mut pools: Vec<Pool> = Vec::new();
    for lowest in order {
        let share = share();
        let highest = |i: usize| place[i].0 + place[i].1 * (1.0 - 2.0 * share);
        let mut level = highest(lowest);
        // A greater depth lowers the surface, which only shrinks the stretch, so the loop terminates.
        let (from, to) = loop {
            let mut from = lowest;
            while from > 0 && bottom(from) > level - margin {
                from -= 1;
            }
            let mut to = lowest;
            while to + 1 < count && bottom(to) > level - margin {
                to += 1;
            }
            let needed = (from..=to).filter(|&i| bottom(i) > level).map(highest).fold(level, f64::max);
            let spills = (from..=to).any(|i| bottom(i) > bottom(lowest) + 1e-9);
            if needed > level {
                level = needed;
            } else if spills {
                level += 0.5;
            } else {
                break (from, to);
            }
            if level > bottom(lowest) - 3.0 {
                break (lowest, lowest);
            }
        };
        let pool = Pool { from: s(from), to: s(to), level };
        let overlaps = pools.iter().any(|p| pool.from < p.to && p.from < pool.to);
        if to - from > 10 && !overlaps {
            pools.push(pool);
        }
    }
    pools.sort_by(|a, b| a.from.total_cmp(&b.from));
    pools
}
