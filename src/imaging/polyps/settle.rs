//! A smooth wall in thick slices.
//!
//! A slice is the mean over its thickness. Where an edge lies nearly in the plane of the slices, only one of them is partly tissue, and no
//! interpolation between such samples puts a level where the edge is: at −650 HU and slices of 3 mm, the level is 0.4 to 1.0 mm off
//! with a period of one slice. The wall then has terraces, on which a large lesion falls into several bumps.
//!
//! The mean itself is kept, however: the sum of the shares of tissue along a line through the slices, times their distance, is how far
//! tissue reaches along it, whichever slice the edge is in. This is the edge that preserves the moment of the values (Tabatabai and
//! Mitchell 1984, there for a line of pixels). Linear interpolation preserves the sum, too, so that it is an integral along the normal:
//! edge = h + ∫ f before h − ∫ (1 − f) behind h, with f the share of tissue and any h between. An even blur does not move it.

use glam::DVec3;
use rayon::prelude::*;

use super::Wall;
use super::edge::crossing;
use crate::error::Result;
use crate::math::ranked::median;
use crate::progress::Progress;
use crate::space::ray::trilinear;
use crate::volume::Volume;

/// Slices are thick if they are farther apart than this, mm, and than so many times the finest distance between voxels.
const THICK_MM: f64 = 1.25;
const THICKER: f64 = 1.5;
/// Values of gas and tissue, HU.
const GAS_HU: f64 = -1000.0;
const TISSUE_HU: f64 = 40.0;
/// Steps of the integral, mm.
const STEP_MM: f64 = 0.15;
/// An edge reaches this far, mm, and so many times the thickness of a voxel along the normal: half a slice's mean and one interpolation.
const REACH: (f64, f64) = (3.0, 1.5);
/// Least cosine between a profile and the normal of the wall.
const LEAST_COS: f64 = 0.4;
/// Less than this share of tissue is gas, and more than one less it is tissue.
const NONE: f64 = 0.03;
/// A profile that turns back by this share belongs to something else beyond.
const BACK: f64 = 0.15;
/// Shares that a profile must reach on both sides.
const ENOUGH: f64 = 0.12;
/// Normals are better after each round.
const ROUNDS: usize = 2;
/// Noise moves an edge along the slices' normal by as much more as they are thick. In curvatures, the noise of places falls with the cube of
/// the scale that they are smoothed by; the wall's usual scale is for slices of this distance, mm.
const USUAL_MM: f64 = 1.0;
/// No vertex moves farther in one round, mm.
const MOST_MM: f64 = 1.5;

/// True if a volume's slices are so thick that its wall has terraces.
pub(super) fn is_thick(volume: &Volume) -> bool {
    let spacing = volume.grid().spacing();
    spacing.max_element() > THICK_MM.max(THICKER * spacing.min_element())
}

impl Wall {
    /// Returns the same wall, settled: vertices keep their numbers.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub(super) fn settled(&self, volume: &Volume, progress: &Progress) -> Result<Self> {
        let mut wall = self.clone();
        wall.settle(volume, progress)?;
        Ok(wall)
    }

    /// Moves the wall to where it is evenly far before the edge of the tissue, as far as it is on average. A vertex without a clear edge stays.
    fn settle(&mut self, volume: &Volume, progress: &Progress) -> Result<()> {
        let noisy = volume.grid().spacing().max_element() / USUAL_MM;
        let scale = noisy.cbrt();
        let mut before_mm = None;
        let (grid, spacing) = (volume.grid(), volume.grid().spacing());
        let axis = DVec3::AXES.into_iter().max_by(|a, b| a.dot(spacing).total_cmp(&b.dot(spacing))).unwrap_or(DVec3::Z);
        let across = (grid.world(axis) - grid.world(DVec3::ZERO)).normalize_or_zero();
        for _ in 0..ROUNDS {
            let edge = |v: usize| self.tissue_edge(v as u32, volume, across);
            let edges: Vec<Option<f64>> = (0..self.len()).into_par_iter().map(edge).collect();
            progress.check()?;
            let Some(middle) = before_mm.or_else(|| median(edges.iter().copied().flatten().collect())) else { break };
            before_mm = Some(middle);
            let moves = |v: usize| {
                let mm = edges[v].map_or(0.0, |mm| (mm - middle).clamp(-MOST_MM, MOST_MM));
                self.normal(v as u32) * mm as f32
            };
            let moved: Vec<glam::Vec3> = (0..self.len()).map(moves).collect();
            self.move_by(&moved, scale, progress)?;
        }
        self.set_settled(before_mm.map(|mm| -mm), noisy);
        Ok(())
    }

    /// Returns where the edge of the tissue is along the normal of a vertex, mm from it into the lumen: as seen along the normal of the
    /// slices, and within them.
    fn tissue_edge(&self, v: u32, volume: &Volume, across: DVec3) -> Option<f64> {
        let normal = self.normal(v).as_dvec3();
        let up = normal.dot(across);
        let level = normal - across * up;
        let spacing = volume.grid().spacing();
        let (thick, fine) = (spacing.max_element(), spacing.min_element());
        let (mut sum, mut weight) = (0.0, 0.0);
        // What spreads a profile sideways, mm²: across the slices the blur, about a voxel; within them, a slice (Δ²/12) and an
        // interpolation (Δ²/6). On a curved wall, that puts the profile's edge off by half the spread times the curvature over cos².
        for (direction, cos, thickness, spread) in [
            (across * up.signum(), up.abs(), thick, fine * fine),
            (level.normalize_or_zero(), level.length(), fine, 0.25 * thick * thick),
        ] {
            // A profile that runs along the wall says nothing of it.
            if cos < LEAST_COS {
                continue;
            }
            if let Some(mm) = profile_edge(volume, self.world(v), direction, thickness) {
                let counts = (cos * cos / spread).powi(2);
                (sum, weight) = (sum + counts * mm * cos, weight + counts);
            }
        }
        (weight > 0.0).then(|| sum / weight)
    }
}

/// Returns where the edge of the tissue is along a direction, mm from a place (world, mm), among voxels of a thickness in this direction.
fn profile_edge(volume: &Volume, place: DVec3, direction: DVec3, thickness: f64) -> Option<f64> {
    let grid = volume.grid();
    let share = |mm: f64| {
        let at = place + direction * mm;
        let value = || (trilinear(volume, grid.voxel(at)) - GAS_HU) / (TISSUE_HU - GAS_HU);
        grid.contains(at).then(|| value().clamp(0.0, 1.0))
    };
    let half = crossing(0.5, share)?;
    let reach = ((REACH.0 + REACH.1 * thickness) / STEP_MM) as usize;
    let (before, least) = tail(reach, |n| share(half + (n as f64 + 0.5) * STEP_MM))?;
    let (behind, most) = tail(reach, |n| Some(1.0 - share(half - (n as f64 + 0.5) * STEP_MM)?))?;
    (least < ENOUGH && most < ENOUGH).then_some(half + before - behind)
}

/// Returns the integral of a share that falls with the steps, mm, until there is none or it rises again, and the least share.
fn tail(steps: usize, share: impl Fn(usize) -> Option<f64>) -> Option<(f64, f64)> {
    let (mut sum, mut least) = (0.0, 1.0_f64);
    for n in 0..steps {
        let here = share(n)?;
        if here > least + BACK {
            break;
        }
        sum += here * STEP_MM;
        least = least.min(here);
        if least < NONE {
            break;
        }
    }
    Some((sum, least))
}
