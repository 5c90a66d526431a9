//! Conjugate gradients with a W-cycle.

use rayon::prelude::*;

use super::domain::{Domain, Links};
use super::levels::{Level, Levels, NONE};
use crate::error::Result;
use crate::progress::Progress;

/// Values that one task computes, and whose sum is taken at once.
const BLOCK: usize = 4096;
/// Share of the Jacobi step that is taken: the best for the half of the spectrum that aggregates cannot represent.
const DAMPED: f32 = 0.7;
/// Steps on each level of aggregates before the next finer one begins.
const FIRST_STEPS: usize = 3;
/// The most steps on the cells.
const MOST_STEPS: usize = 200;

/// The system of one level: for each free node, the flow to its neighbours and to what is held, which is 0.
#[derive(Clone, Copy)]
struct System<'a> {
    links: &'a Links,
    level: &'a Level,
}

/// Values of one level that a cycle computes with.
struct Work {
    right: Vec<f32>,
    found: Vec<f32>,
    rest: Vec<f32>,
}

impl System<'_> {
    fn len(&self) -> usize {
        self.level.diagonal.len()
    }

    fn is_free(&self, n: usize) -> bool {
        self.level.diagonal[n] > 0.0
    }

    /// Returns the flow out of a node. It is a sum of differences, so that equal values have none: the rounding of a diagonal times a
    /// value would be a leak in every node.
    #[inline]
    fn flow(&self, x: &[f32], n: usize) -> f32 {
        let flow: f32 = self.links.of(n).iter().map(|l| l.conductance * (x[n] - x[l.to as usize])).sum();
        flow + self.level.held[n] * x[n]
    }

    /// The same, in double precision.
    #[inline]
    fn flow_exactly(&self, x: &[f64], n: usize) -> f64 {
        if !self.is_free(n) {
            return 0.0;
        }
        let flow: f64 = self.links.of(n).iter().map(|l| f64::from(l.conductance) * (x[n] - x[l.to as usize])).sum();
        flow + f64::from(self.level.held[n]) * x[n]
    }

    /// Returns a damped Jacobi step from 0.
    #[inline]
    fn step(&self, flow: f32, n: usize) -> f32 {
        if self.is_free(n) { DAMPED * flow / self.level.diagonal[n] } else { 0.0 }
    }
}

/// Sets each value by its index, in parallel.
fn fill<T: Send>(out: &mut [T], value: impl Fn(usize) -> T + Sync) {
    out.par_chunks_mut(BLOCK).enumerate().for_each(|(block, out)| {
        for (n, o) in out.iter_mut().enumerate() {
            *o = value(block * BLOCK + n);
        }
    });
}

/// Returns the sum of values by their index, always in the same order.
fn sum(count: usize, value: impl Fn(usize) -> f64 + Sync) -> f64 {
    let blocks: Vec<f64> = (0..count.div_ceil(BLOCK))
        .into_par_iter()
        .map(|block| (block * BLOCK..((block + 1) * BLOCK).min(count)).map(&value).sum())
        .collect();
    blocks.iter().sum()
}

/// Sums the values of the members of each aggregate.
fn gathered<T: Copy + Send + Sync + std::iter::Sum>(level: &Level, of: &[T], out: &mut [T]) {
    fill(out, |i| {
        let own = level.begins[i] as usize..level.begins[i + 1] as usize;
        level.members[own].iter().map(|&n| of[n as usize]).sum()
    });
}

impl Levels {
    /// Solves for the free cells; `values` of the others are held, or NaN where nothing is reached. `sources` flow into cells. Returns the solution, 0 where a cell
    /// is not free, and the number of steps on the cells.
    pub(super) fn solve(
        &self,
        domain: &Domain,
        (values, sources): (&[f64], &[(u32, f64)]),
        tolerance: f64,
        progress: &Progress,
    ) -> Result<(Vec<f64>, usize)> {
        let systems: Vec<System<'_>> = (0..)
            .zip(&self.all)
            .map(|(n, level)| System { links: if n == 0 { domain.links() } else { &level.links }, level })
            .collect();
        // The flow that the held values cause. What is left to solve for is 0 where they are.
        let mut right = vec![Vec::new(); systems.len()];
        right[0] = vec![0.0; domain.len()];
        let held = |n: usize| if values[n].is_nan() { 0.0 } else { values[n] };
        fill(&mut right[0], |n| {
            let from = systems[0].links.of(n).iter().map(|l| f64::from(l.conductance) * held(l.to as usize));
            if systems[0].is_free(n) { from.sum() } else { 0.0 }
        });
        for &(n, source) in sources.iter().filter(|s| systems[0].is_free(s.0 as usize)) {
            right[0][n as usize] += source;
        }
        for n in 1..systems.len() {
            let mut sums = vec![0.0; systems[n].len()];
            gathered(systems[n - 1].level, &right[n - 1], &mut sums);
            right[n] = sums;
        }
        let new = |n: usize| vec![0.0; n];
        let mut works: Vec<Work> =
            systems.iter().map(|s| Work { right: new(s.len()), found: new(s.len()), rest: new(s.len()) }).collect();
        let coarsest = Direct::new(systems.last());
        let mut found = Vec::new();
        let mut steps = 0;
        for n in (0..systems.len()).rev() {
            let mut start = vec![0.0; systems[n].len()];
            if n + 1 < systems.len() {
                let parent = &systems[n].level.parent;
                fill(&mut start, |i| if parent[i] == NONE { 0.0 } else { found[parent[i] as usize] });
            }
            let most = if n == 0 { MOST_STEPS } else { FIRST_STEPS };
            let cycle = Cycle { systems: &systems[n..], coarsest: &coarsest };
            steps = cycle.conjugate(&right[n], &mut start, (tolerance, most), &mut works[n..], progress)?;
            found = start;
        }
        Ok((found, steps))
    }
}

/// The W-cycle from one level on.
struct Cycle<'a> {
    systems: &'a [System<'a>],
    coarsest: &'a Direct,
}

impl Cycle<'_> {
    /// Improves `x` by conjugate gradients. Returns the number of steps.
    fn conjugate(
        &self,
        right: &[f64],
        x: &mut [f64],
        (tolerance, most): (f64, usize),
        works: &mut [Work],
        progress: &Progress,
    ) -> Result<usize> {
        let system = self.systems[0];
        let count = system.len();
        let mut rest = vec![0.0; count];
        fill(&mut rest, |n| right[n] - system.flow_exactly(x, n));
        let (mut along, mut flow) = (vec![0.0; count], vec![0.0; count]);
        let mut before = 0.0;
        for step in 0..most {
            progress.check()?;
            fill(&mut works[0].right, |n| rest[n] as f32);
            cycle(self.systems, self.coarsest, works);
            let found = &works[0].found;
            let error = sum(count, |n| rest[n] * f64::from(found[n]));
            // At the solution x · right is the square of its energy norm.
            let whole = sum(count, |n| x[n] * right[n]);
            if error <= 0.0 || error <= tolerance * tolerance * whole {
                return Ok(step);
            }
            let turn = if step > 0 { error / before } else { 0.0 };
            before = error;
            along.par_chunks_mut(BLOCK).zip(found.par_chunks(BLOCK)).for_each(|(along, found)| {
                along.iter_mut().zip(found).for_each(|(a, f)| *a = f64::from(*f) + turn * *a);
            });
            fill(&mut flow, |n| system.flow_exactly(&along, n));
            let reach = error / sum(count, |n| along[n] * flow[n]);
            if !reach.is_finite() {
                return Ok(step);
            }
            x.par_chunks_mut(BLOCK).zip(along.par_chunks(BLOCK)).for_each(|(x, along)| {
                x.iter_mut().zip(along).for_each(|(x, a)| *x += reach * a);
            });
            rest.par_chunks_mut(BLOCK).zip(flow.par_chunks(BLOCK)).for_each(|(rest, flow)| {
                rest.iter_mut().zip(flow).for_each(|(r, f)| *r -= reach * f);
            });
        }
        Ok(most)
    }
}

/// Solves the first level's system approximately: a symmetric, positive definite function of `right`.
fn cycle(systems: &[System<'_>], coarsest: &Direct, works: &mut [Work]) {
    let system = systems[0];
    let [work, coarser @ ..] = works else { return };
    let Work { right, found, rest } = work;
    let Some(next) = coarser.first_mut() else {
        coarsest.solve(right, found);
        return;
    };
    fill(found, |n| system.step(right[n], n));
    fill(rest, |n| right[n] - system.flow(found, n));
    gathered(system.level, rest, &mut next.right);
    cycle(&systems[1..], coarsest, coarser);
    if systems.len() > 2 {
        // Twice, because constants over aggregates are a poor guess (a W-cycle): the coarser levels are small.
        let (system, next) = (systems[1], &mut coarser[0]);
        let sum = next.found.clone();
        let right: Vec<f32> =
            (0..next.right.len()).into_par_iter().map(|n| next.right[n] - system.flow(&sum, n)).collect();
        next.right = right;
        cycle(&systems[1..], coarsest, coarser);
        coarser[0].found.par_iter_mut().zip(&sum).for_each(|(f, s)| *f += s);
    }
    let (parent, more) = (&system.level.parent, &coarser[0].found);
    found.par_chunks_mut(BLOCK).zip(parent.par_chunks(BLOCK)).for_each(|(found, parent)| {
        found.iter_mut().zip(parent).filter(|(_, p)| **p != NONE).for_each(|(f, p)| *f += more[*p as usize]);
    });
    fill(rest, |n| found[n] + system.step(right[n] - system.flow(found, n), n));
    std::mem::swap(found, rest);
}

/// The coarsest level's system, factored (Cholesky).
struct Direct {
    /// Its free nodes.
    nodes: Vec<u32>,
    /// The lower triangle, row by row.
    factor: Vec<f64>,
}

impl Direct {
    fn new(system: Option<&System<'_>>) -> Self {
        let Some(system) = system else { return Self { nodes: Vec::new(), factor: Vec::new() } };
        let nodes: Vec<u32> = (0..system.len() as u32).filter(|&n| system.is_free(n as usize)).collect();
        let at = |row: usize, column: usize| row * (row + 1) / 2 + column;
        let mut factor = vec![0.0; at(nodes.len(), 0)];
        for (row, &n) in nodes.iter().enumerate() {
            let mut diagonal = f64::from(system.level.held[n as usize]);
            for l in system.links.of(n as usize) {
                diagonal += f64::from(l.conductance);
                if let Ok(column) = nodes[..row].binary_search(&l.to) {
                    factor[at(row, column)] -= f64::from(l.conductance);
                }
            }
            // A little more, so that rounding leaves it positive definite.
            factor[at(row, row)] = diagonal * (1.0 + 1e-12);
        }
        for row in 0..nodes.len() {
            for column in 0..=row {
                let dot: f64 = (0..column).map(|k| factor[at(row, k)] * factor[at(column, k)]).sum();
                let rest = factor[at(row, column)] - dot;
                factor[at(row, column)] =
                    if row == column { rest.max(f64::MIN_POSITIVE).sqrt() } else { rest / factor[at(column, column)] };
            }
        }
        Self { nodes, factor }
    }

    fn solve(&self, right: &[f32], found: &mut [f32]) {
        let at = |row: usize, column: usize| row * (row + 1) / 2 + column;
        let mut x: Vec<f64> = self.nodes.iter().map(|&n| f64::from(right[n as usize])).collect();
        for row in 0..x.len() {
            let dot: f64 = (0..row).map(|k| self.factor[at(row, k)] * x[k]).sum();
            x[row] = (x[row] - dot) / self.factor[at(row, row)];
        }
        for row in (0..x.len()).rev() {
            x[row] /= self.factor[at(row, row)];
            for k in 0..row {
                x[k] -= self.factor[at(row, k)] * x[row];
            }
        }
        found.fill(0.0);
        for (&n, x) in self.nodes.iter().zip(x) {
            found[n as usize] = x as f32;
        }
    }
}
