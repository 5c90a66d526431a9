//! What a polyp adds to the surface that it grows on: its height, its volume, and how much of it lies under fluid.

use glam::DVec3;
use rayon::prelude::*;

use super::ground::Ground;
use super::lesions::{Lesion, PolypShape};
use super::pools::Pool;
use super::shape::{Attached, Polyp, Shape};
use super::solid::Ellipsoid;
use super::truth::TruePolyp;
use super::{Phantom, tag::Tag};

/// A polyp of either kind, by its index.
#[derive(Clone, Copy, Debug)]
pub(super) enum Which {
    Ball(usize),
    Lesion(usize),
}

/// Number of cells along the diameter of a polyp, and points on its surface.
const CELLS: f64 = 36.0;
const POINTS: usize = 400;

impl Phantom {
    /// Returns the polyps, in the order of the centerline, without height and volume, which [`Phantom::truth`] measures.
    pub fn polyps(&self) -> Vec<TruePolyp> {
        self.in_order().into_iter().map(|which| self.true_polyp(which)).collect()
    }

    /// Returns the polyps with height and volume.
    pub(super) fn measured_polyps(&self) -> Vec<TruePolyp> {
        // Each polyp is summed in a fixed order, so the result does not depend on the number of threads.
        let measured = |which: Which| {
            let (with, without) = (Ground::new(&self.shape), which.removed_from(&self.shape));
            let without = Ground::new(&without);
            let (s, reach, middle) = which.extent(&self.shape);
            TruePolyp {
                height_mm: which.height_mm(&self.shape, &without),
                volume_mm3: Some(volume_mm3(&with, &without, s, middle, reach)),
                ..self.true_polyp(which)
            }
        };
        self.in_order().into_par_iter().map(measured).collect()
    }

    pub(super) fn in_order(&self) -> Vec<Which> {
        let balls = self.shape.polyps.iter().enumerate().map(|(i, a)| (a.s, Which::Ball(i)));
        let lesions = self.shape.lesions.iter().enumerate().map(|(i, a)| (a.s, Which::Lesion(i)));
        let mut all: Vec<_> = balls.chain(lesions).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all.into_iter().map(|(_, which)| which).collect()
    }

    fn true_polyp(&self, which: Which) -> TruePolyp {
        let mut polyp: TruePolyp = match which {
            Which::Ball(i) => self.shape.polyps[i].what.into(),
            Which::Lesion(i) => self.shape.lesions[i].what.into(),
        };
        let pools = self.tag.as_ref().map_or_else(|| self.pools.clone(), Tag::pools);
        if !pools.is_empty() {
            polyp.submerged = self.is_submerged(which, &pools);
        }
        polyp
    }

    /// Returns true if most of a polyp's surface in the lumen is under fluid.
    fn is_submerged(&self, which: Which, pools: &[Pool]) -> bool {
        let without = which.removed_from(&self.shape);
        let (ground, s) = (Ground::new(&without), which.extent(&self.shape).0);
        let down = self.settings.position.down();
        let (mut under, mut all) = (0, 0);
        for p in which.head(&self.shape).points(POINTS) {
            let Some(foot) = ground.foot(p, s).filter(|foot| without.surface(p, foot).d < 0.0) else { continue };
            all += 1;
            let pool = pools.iter().find(|pool| (pool.from..=pool.to).contains(&foot.s));
            under += usize::from(pool.is_some_and(|pool| p.dot(down) > pool.level));
        }
        2 * under > all
    }
}

impl Which {
    fn head(self, shape: &Shape) -> Ellipsoid {
        match self {
            Self::Ball(i) => Ellipsoid::ball(shape.polyps[i].what.position, 0.5 * shape.polyps[i].what.diameter_mm),
            Self::Lesion(i) => shape.lesions[i].what.head,
        }
    }

    /// Returns the colon without the polyp.
    fn removed_from(self, shape: &Shape) -> Shape {
        let mut shape = shape.clone();
        match self {
            Self::Ball(i) => drop(shape.polyps.remove(i)),
            Self::Lesion(i) => drop(shape.lesions.remove(i)),
        }
        shape
    }

    /// Returns the polyp's arc length (mm), and a ball that holds it: its radius (mm) and centre (world).
    fn extent(self, shape: &Shape) -> (f64, f64, DVec3) {
        let head = self.head(shape);
        let most = head.radii.max_element();
        match self {
            Self::Ball(i) => (shape.polyps[i].s, most + 1.0, head.centre),
            Self::Lesion(i) => {
                let Attached { s, what } = shape.lesions[i];
                let long = if what.shape == PolypShape::Stalked { what.root.distance(head.centre) } else { 0.0 };
                let towards = (what.root - head.centre).normalize_or_zero();
                let half = 0.5 * (long + most + 2.0).max(2.0 * most + 2.0);
                (s, half, head.centre + towards * (half - most - 1.0).max(0.0))
            }
        }
    }

    /// Returns the polyp's greatest height above the surface without it, mm.
    fn height_mm(self, shape: &Shape, without: &Ground<'_>) -> Option<f64> {
        let head = self.head(shape);
        if matches!(self, Self::Lesion(i) if shape.lesions[i].what.shape == PolypShape::Flat) {
            return Some(head.radii.z);
        }
        let s = self.extent(shape).0;
        let heights = head.points(POINTS).filter_map(|p| without.foot(p, s)).map(|foot| -without.shape.to_wall(&foot));
        heights.max_by(f64::total_cmp)
    }
}

/// Returns the tissue that is in one colon and not in the other, within `reach` mm of `middle` (world), mm³. A cell on a surface
/// counts by the fraction that a plane at the surface's distance cuts off.
pub(super) fn volume_mm3(with: &Ground<'_>, without: &Ground<'_>, s: f64, middle: DVec3, reach: f64) -> f64 {
    let cell = 2.0 * reach / CELLS;
    let lumen = |ground: &Ground<'_>, p: DVec3| match ground.surface(p, s) {
        Some(surface) => (0.5 - surface.d / cell).clamp(0.0, 1.0),
        None => 0.0,
    };
    let count = CELLS as i32;
    let mut sum = 0.0;
    for n in 0..count * count * count {
        let at = DVec3::new(f64::from(n % count), f64::from(n / count % count), f64::from(n / count / count));
        let p = middle + (at + DVec3::splat(0.5)) * cell - DVec3::splat(reach);
        if p.distance(middle) > reach + cell {
            continue;
        }
        let free = lumen(without, p);
        if free > 0.0 {
            sum += free - lumen(with, p);
        }
    }
    sum * cell.powi(3)
}

impl From<Polyp> for TruePolyp {
    fn from(p: Polyp) -> Self {
        Self { position: p.position, diameter_mm: p.diameter_mm, ..Self::default() }
    }
}

impl From<Lesion> for TruePolyp {
    fn from(lesion: Lesion) -> Self {
        let (position, diameter_mm) = (lesion.position(), lesion.diameter_mm());
        Self { position, diameter_mm, shape: lesion.shape, site: lesion.site, ..Self::default() }
    }
}
