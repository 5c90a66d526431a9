//! The ground truth of what holds gas: its bodies, the colon's parts and the ileocecal valve.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Phantom;
use super::centerline::PARTS;
use super::gut::Run;
use super::kinds::{BodyKind, Content};
use super::profile::GAS;

/// A connected body of gas. Gas that passes an open ileocecal valve counts as two bodies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueBody {
    /// What it is in.
    pub kind: BodyKind,
    /// Volume, ml: of the gas alone, in the colon with its fluid, and of a lung with its vessels, up to the scan's last slice.
    pub ml: f64,
    /// A point well inside its gas, world mm LPS.
    pub position: DVec3,
    /// Least and greatest coordinates, world mm LPS.
    pub bounds_mm: [DVec3; 2],
}

/// A part of the colon along the truth's centerline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NamedPart {
    /// Rectum, sigmoid, descending, splenic flexure, transverse, hepatic flexure, ascending or cecum, in lower case.
    pub name: String,
    /// Arc length at which it begins, mm from the rectal end.
    pub from_mm: f64,
    /// Arc length at which it ends, mm from the rectal end.
    pub to_mm: f64,
}

/// The ileocecal valve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueValve {
    /// The middle of its mouth in the colon, world mm LPS.
    pub position: DVec3,
    /// Unit vector into the ileum, world LPS.
    pub direction: DVec3,
    /// True if gas passes it.
    pub open: bool,
}

/// Volume and bounds of a body, summed over cells.
#[derive(Clone, Copy, Debug)]
struct Sum {
    cells: f64,
    low: DVec3,
    high: DVec3,
}

impl Sum {
    const NONE: Self = Self { cells: 0.0, low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    fn add(self, other: &Self) -> Self {
        let (low, high) = (self.low.min(other.low), self.high.max(other.high));
        Self { cells: self.cells + other.cells, low, high }
    }
}

/// Edge of the cells, mm.
const CELL: f64 = 1.2;

fn body(kind: BodyKind, sum: &Sum, position: DVec3) -> Option<TrueBody> {
    let ml = sum.cells * CELL.powi(3) / 1000.0;
    (ml > 0.0).then_some(TrueBody { kind, ml, position, bounds_mm: [sum.low, sum.high] })
}

/// Edge of a brick of cells that share the knots near them, cells.
const BRICK: usize = 6;

impl Phantom {
    /// Sums the cells in a box, each into the body that `of` returns with the share of the cell that it fills, given the runs of
    /// knots near it. The order of the sum does not depend on the number of threads.
    fn measure(
        &self,
        [low, high]: [DVec3; 2],
        count: usize,
        of: impl Fn(DVec3, &[Range<usize>], &[Run]) -> Option<(usize, f64)> + Sync,
    ) -> Vec<Sum> {
        let edge = CELL * BRICK as f64;
        let bricks = ((high - low) / edge).ceil().max(DVec3::ONE);
        let layer = |k: usize| {
            let (mut runs, mut guts, mut sums) = (Vec::new(), Vec::new(), vec![Sum::NONE; count]);
            for j in 0..bricks.y as usize {
                for i in 0..bricks.x as usize {
                    let corner = low + DVec3::new(i as f64, j as f64, k as f64) * edge;
                    self.runs_near(corner + 0.5 * edge, 0.87 * edge, &mut runs);
                    self.guts.runs_near(corner + 0.5 * edge, 0.87 * edge, &mut guts);
                    for c in 0..BRICK.pow(3) {
                        let cell =
                            DVec3::new((c % BRICK) as f64, (c / BRICK % BRICK) as f64, (c / BRICK / BRICK) as f64);
                        let p = corner + (cell + 0.5) * CELL;
                        if let Some((body, share)) = of(p, &runs, &guts).filter(|(_, share)| *share > 0.0) {
                            let own = Sum { cells: share, low: p - 0.5 * CELL, high: p + 0.5 * CELL };
                            sums[body] = sums[body].add(&own);
                        }
                    }
                }
            }
            sums
        };
        let layers: Vec<Vec<Sum>> = (0..bricks.z as usize).into_par_iter().map(layer).collect();
        (0..count).map(|body| layers.iter().fold(Sum::NONE, |sum, layer| sum.add(&layer[body]))).collect()
    }

    /// Returns the parts of the colon from rectum to cecum.
    pub fn names(&self) -> Vec<NamedPart> {
        let (stations, end) = (self.shape.axis.stations(), self.shape.axis.length());
        let at = |i: usize| PARTS.get(i).map_or(end, |(_, station)| stations[*station]);
        let part = |(i, (name, _)): (usize, &(&str, usize))| NamedPart {
            name: (*name).to_string(),
            from_mm: at(i),
            to_mm: at(i + 1),
        };
        PARTS.iter().enumerate().map(part).collect()
    }

    /// Returns the arc lengths between which the colon is collapsed, mm.
    pub fn collapsed(&self) -> Vec<[f64; 2]> {
        self.shape.collapsed.iter().map(|c| [c.from, c.to]).collect()
    }

    /// Returns the bodies of gas: the colon's if it is collapsed, and those beside it.
    pub fn bodies(&self) -> Vec<TrueBody> {
        let mut all = self.colon_bodies();
        for tube in 0..self.guts.tubes.len() {
            all.extend(self.gut_bodies(tube));
        }
        if self.settings.lungs {
            all.extend(self.lung_bodies());
        }
        all
    }

    /// Returns the ileocecal valve, if there is small bowel.
    pub fn valve(&self) -> Option<TrueValve> {
        self.valve.map(|v| {
            let position = v.spot.at + v.spot.up * v.height;
            TrueValve { position, direction: -v.spot.up, open: v.slit.is_some() }
        })
    }

    /// Returns the pieces of gas in a tube beside the colon.
    fn gut_bodies(&self, tube: usize) -> Vec<TrueBody> {
        let gut = &self.guts.tubes[tube];
        let pieces = gut.pieces();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (c, r) in gut.balls() {
            (low, high) = (low.min(c - r - 2.0), high.max(c + r + 2.0));
        }
        let runs = [(tube, 0..gut.axis.knots().len())];
        let of = |p: DVec3, _: &[Range<usize>], near: &[Run]| {
            let inside = self.guts.inside(p, near).filter(|inside| inside.tube == tube)?;
            let piece = pieces.partition_point(|piece| piece[1] < inside.s).min(pieces.len() - 1);
            (!gut.is_under(p)).then(|| (piece, (0.5 - inside.d / CELL).clamp(0.0, 1.0)))
        };
        let sums = self.measure([low, high], pieces.len(), of);
        let up = gut.fluid.map_or(DVec3::ZERO, |(_, down, _)| -down);
        let piece = |(i, [from, to]): (usize, &[f64; 2])| {
            // The point in gas, on the axis or above it, that is farthest from the wall and the fluid.
            let places = (0..=40).flat_map(|n| {
                let s = from + (to - from) * f64::from(n) / 40.0;
                let lift = gut.axis.profile(s).radius.0;
                [0.0, 0.3, 0.5].map(|share| gut.axis.frame(s).at + up * (share * lift))
            });
            let room = |p: &DVec3| {
                let wall = self.guts.inside(*p, &runs).map_or(-1.0, |inside| -inside.d);
                gut.fluid.map_or(wall, |(level, down, _)| wall.min(level - p.dot(down)))
            };
            let best = places.max_by(|a, b| room(a).total_cmp(&room(b)))?;
            body(gut.kind, &sums[i], best)
        };
        pieces.iter().enumerate().filter_map(piece).collect()
    }

    /// Returns the left and the right lung.
    fn lung_bodies(&self) -> Vec<TrueBody> {
        let grid = self.grid();
        let scale = self.settings.size.scale();
        let last = grid.dims().map(|n| n as f64 - 1.0);
        let top = grid.world(DVec3::from_array(last)).z;
        let low = DVec3::new(-150.0, -70.0, 130.0) * scale;
        let high = DVec3::new(150.0 * scale, 115.0 * scale, top);
        let of = |p: DVec3, runs: &[Range<usize>], guts: &[Run]| {
            // The last layer of bricks is higher than the scan.
            let lung = p.z <= top && self.content_among(p, runs, guts) == Content::Lung;
            lung.then(|| (usize::from(p.x < 0.0), 1.0))
        };
        let sums = self.measure([low, high], 2, of);
        let side = |i: usize| {
            let Sum { low, high, .. } = sums[i];
            let cells = (0..12 * 12 * 12).map(|n| {
                let share = DVec3::new(f64::from(n % 12), f64::from(n / 12 % 12), f64::from(n / 144)) + 0.5;
                low + (high - low) * share / 12.0
            });
            let best = cells.max_by(|a, b| self.body.lung_depth(*a).total_cmp(&self.body.lung_depth(*b)))?;
            body(BodyKind::Lung, &sums[i], best)
        };
        (0..2).filter_map(side).collect()
    }

    /// Returns the segments of a collapsed colon.
    fn colon_bodies(&self) -> Vec<TrueBody> {
        let collapsed = self.collapsed();
        if collapsed.is_empty() {
            return Vec::new();
        }
        let (axis, end) = (&self.shape.axis, self.shape.axis.length());
        let count = collapsed.len() + 1;
        let middles: Vec<f64> = collapsed.iter().map(|[from, to]| 0.5 * (from + to)).collect();
        let knots = axis.knots();
        let (mut low, mut high) = (knots[0], knots[0]);
        for k in knots {
            (low, high) = (low.min(*k), high.max(*k));
        }
        let most = DVec3::splat(32.0);
        let of = |p: DVec3, runs: &[Range<usize>], _: &[Run]| {
            if runs.is_empty() {
                return None;
            }
            let (d, s) = self.distances_among(p, runs);
            Some((middles.partition_point(|m| *m < s), (0.5 - d.wall / CELL).clamp(0.0, 1.0)))
        };
        let sums = self.measure([low - most, high + most], count, of);
        let segment = |i: usize| {
            let from = if i == 0 { 0.0 } else { collapsed[i - 1][1] };
            let to = if i + 1 == count { end } else { collapsed[i][0] };
            // The point of the axis in gas that is farthest from the segment's ends and in a wide lumen.
            let places = (1..40).map(|n| from + (to - from) * f64::from(n) / 40.0);
            let room = |s: &f64| (axis.profile(*s).radius.0).min(s - from).min(to - s);
            let in_gas = |s: &f64| self.value(axis.frame(*s).at) < GAS + 50.0;
            let best = places.clone().filter(in_gas).max_by(|a, b| room(a).total_cmp(&room(b)));
            let best = best.unwrap_or(0.5 * (from + to));
            body(BodyKind::Colon, &sums[i], axis.frame(best).at)
        };
        (0..count).filter_map(segment).collect()
    }
}
