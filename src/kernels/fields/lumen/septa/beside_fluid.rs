//! Septa between gas and the fluid of another limb. Tagged fluid meets gas at its level: where it touches gas far from there, a wall
//! lies between them.

use super::grown::Grown;
use super::places::Hop;
use crate::fields::lumen::cells::by_cells;
use crate::fields::lumen::fluid::Fluid;
use crate::fields::lumen::runs::{Run, touching};
use crate::volume::Grid;

impl Grown {
    /// Returns where the level of each pool is, ascending.
    pub(super) fn levels(&self, fluid: &Fluid) -> Vec<Vec<Hop>> {
        let hops = |level: &Vec<[i64; 3]>| {
            let gas = level.iter().filter_map(|p| Some((self.parts.find(p[0], p[1], p[2])?, p.map(|n| n as usize))));
            let mut hops: Vec<Hop> = gas.filter_map(|(run, at)| self.hop_at(run, at)).collect();
            hops.sort_unstable();
            hops.dedup();
            hops
        };
        fluid.levels.iter().map(hops).collect()
    }

    /// Adds the voxels of gas in row (j, k) that touch fluid whose level is far away.
    pub(super) fn beside_fluid(
        &self,
        grid: &Grid,
        fluid: &Fluid,
        levels: &[Vec<Hop>],
        [j, k]: [usize; 2],
        out: &mut Vec<usize>,
    ) {
        let [_, ny, nz] = self.parts.dims();
        if fluid.pools.dims() != self.parts.dims() {
            return;
        }
        let own = self.parts.row(j, k);
        let row = grid.index(0, j, k);
        let far = |gas: Run, pool: Run, x: u32| {
            let level = &levels[pool.label as usize];
            let Some(at) = self.hop_at(gas, [x as usize, j, k]) else { return false };
            let next = level.partition_point(|l| *l < at);
            let near = |n: usize| level.get(n).is_some_and(|l| !l.is_far(at, self.far));
            !(near(next) || next > 0 && near(next - 1))
        };
        let pools = fluid.pools.row(j, k);
        for pool in pools {
            let at = own.partition_point(|r| r.end < pool.start);
            for gas in own[at..].iter().take_while(|r| r.start <= pool.end) {
                let beside =
                    [(gas.end == pool.start).then(|| gas.end - 1), (pool.end == gas.start).then_some(gas.start)];
                out.extend(beside.into_iter().flatten().filter(|&x| far(*gas, *pool, x)).map(|x| row + x as usize));
            }
        }
        let beside = [
            (j > 0).then(|| (j - 1, k)),
            (j + 1 < ny).then(|| (j + 1, k)),
            (k > 0).then(|| (j, k - 1)),
            (k + 1 < nz).then(|| (j, k + 1)),
        ];
        for (j, k) in beside.into_iter().flatten() {
            let pools = fluid.pools.row(j, k);
            touching(pools, own, |a, b| {
                let (pool, gas) = (pools[a], own[b]);
                let both = pool.start.max(gas.start)..pool.end.min(gas.end);
                for x in by_cells(both, self.places.cells.side[0]) {
                    if far(gas, pool, x.start) {
                        out.extend(x.map(|x| row + x as usize));
                    }
                }
            });
        }
    }

    /// Returns where gas of a run is at voxel `at`. Where nothing is far away, any nearby node will do.
    fn hop_at(&self, gas: Run, at: [usize; 3]) -> Option<Hop> {
        self.hops[gas.label as usize].or_else(|| self.places.near(at))
    }
}
