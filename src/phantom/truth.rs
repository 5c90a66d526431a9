//! The ground truth of a phantom, in the form that the command line writes.

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::bodies::{NamedPart, TrueBody, TrueValve};
use super::decoys::TrueDecoy;
use super::lesions::{PolypShape, PolypSite};
use super::profile::WALL_HU;
use super::shape::DEEP;
use super::touching::{Touching, TrueSeptum};
use super::{Phantom, Position};

/// The ground truth of a phantom.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Points of the axis from rectum to cecum, about 1 mm apart, world mm LPS. Both ends are the centres of the rounded end walls.
    pub centerline: Vec<DVec3>,
    /// Mean radius of the lumen, without folds, at each point, mm.
    pub radius_mm: Vec<f64>,
    /// Length of the axis, mm.
    pub length_mm: f64,
    /// Volume within the wall, gas and fluid, ml.
    pub lumen_ml: f64,
    /// The polyps, in the order of the centerline.
    pub polyps: Vec<TruePolyp>,
    /// The decoys, in the order of the centerline; tagged stool last.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub decoys: Vec<TrueDecoy>,
    /// The colon's parts, without gaps, from rectum to cecum.
    #[serde(default)]
    pub names: Vec<NamedPart>,
    /// The patient's position.
    #[serde(default)]
    pub position: Position,
    /// The bodies of gas beside the colon; its own segments, too, if it is collapsed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<TrueBody>,
    /// Arc lengths between which the colon is collapsed, mm from the rectal end.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub collapsed: Vec<[f64; 2]>,
    /// The septa between limbs of the colon that touch.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub touching: Vec<TrueSeptum>,
    /// The ileocecal valve, if there is small bowel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub valve: Option<TrueValve>,
    /// The wall's iso-value, HU.
    pub wall_hu: i32,
    /// The same patient in the other position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second: Option<Box<TrueSecond>>,
}

/// The ground truth of a patient's second position, and what maps points between the two.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueSecond {
    /// Its own truth. Its polyps and decoys are in the same order as the first's; tagged stool, which is other stool, is last.
    #[serde(flatten)]
    pub truth: Truth,
    /// Arc lengths from the rectal end that belong together, mm, 5 mm apart in the first: that in the first, that in the second.
    pub along_mm: Vec<[f64; 2]>,
    /// For each of them, by how much the wall is turned about the axis in the second position, degrees, beyond the shortest rotation
    /// between the two tangents. Positive turns from the frame's normal to its binormal, clockwise seen along the axis to the cecum.
    pub turn_degrees: Vec<f64>,
    /// Points of the wall without folds that belong together.
    pub points: TruePoints,
}

/// Points of the wall, without folds and polyps, 10 mm apart along the first position's axis and 12 around it. Those where the colon is
/// collapsed in either position are left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruePoints {
    /// In the first position, world mm LPS.
    pub first: Vec<DVec3>,
    /// The same points in the second position, world mm LPS.
    pub second: Vec<DVec3>,
}

/// A polyp of the ground truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TruePolyp {
    /// Centre of the head, world mm LPS. A flat polyp's is above the centre of its base by half its height.
    pub position: DVec3,
    /// Largest diameter of the head without a stalk, mm; of a flat polyp, the largest width of its base. It is that of the surface at the
    /// wall's value: the tissue ends 0.42 times the blur within it, on each side. Of a polyp put into a scan it is that of the tissue.
    pub diameter_mm: f64,
    /// Shape.
    #[serde(default)]
    pub shape: PolypShape,
    /// What it grows on.
    #[serde(default)]
    pub site: PolypSite,
    /// True if most of its surface is under fluid.
    #[serde(default)]
    pub submerged: bool,
    /// Greatest height above the wall or fold as it would be without the polyp, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_mm: Option<f64>,
    /// Volume of the tissue that it adds on the lumen's side, mm³.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume_mm3: Option<f64>,
    /// True if tag sticks to it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub coated: bool,
    /// Distance along a scan's centerline from its rectal end, mm, if it was put into a scan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub along_mm: Option<f64>,
}

impl Phantom {
    /// Returns the ground truth.
    pub fn truth(&self) -> Truth {
        let axis = &self.shape.axis;
        let count = axis.length().round() as usize;
        let s = |i: usize| axis.length() * i as f64 / count as f64;
        Truth {
            centerline: (0..=count).map(|i| axis.frame(s(i)).at).collect(),
            radius_mm: (0..=count).map(|i| axis.profile(s(i)).radius.0).collect(),
            length_mm: axis.length(),
            lumen_ml: self.lumen_ml(),
            polyps: self.measured_polyps(),
            decoys: self.decoys(),
            names: self.names(),
            position: self.settings.position,
            bodies: self.bodies(),
            collapsed: self.collapsed(),
            touching: self.shape.touching.iter().map(Touching::truth).collect(),
            valve: self.valve(),
            wall_hu: WALL_HU as i32,
            second: None,
        }
    }

    /// Returns the decoys, in the order of the centerline; tagged stool last.
    pub fn decoys(&self) -> Vec<TrueDecoy> {
        if !self.settings.decoys {
            return Vec::new();
        }
        let own = self.shape.decoys.iter().map(|d| d.truth);
        own.chain(self.tag.iter().flat_map(|tag| tag.lumps())).collect()
    }

    /// Returns the volume within the wall, ml. It sums cells of 0.9 mm; a cell on the wall counts by the fraction that
    /// a plane at the wall's distance cuts off.
    pub(crate) fn lumen_ml(&self) -> f64 {
        const CELL: f64 = 0.9;
        const BRICK: i64 = 8;
        let knots = self.shape.axis.knots();
        let (mut lo, mut hi) = (knots[0], knots[0]);
        for k in knots {
            (lo, hi) = (lo.min(*k), hi.max(*k));
        }
        let most = self.reach.iter().fold(0.0, |a: f64, b| a.max(*b)) - DEEP;
        let edge = CELL * BRICK as f64;
        let first = lo - DVec3::splat(most);
        let bricks = ((hi + DVec3::splat(most) - first) / edge).ceil();
        let layer = |bz: i64| {
            let (mut near, mut sum) = (Vec::new(), 0.0);
            for by in 0..bricks.y as i64 {
                for bx in 0..bricks.x as i64 {
                    let corner = first + DVec3::new(bx as f64, by as f64, bz as f64) * edge;
                    self.runs_near(corner + DVec3::splat(0.5 * edge), 0.87 * edge, &mut near);
                    if near.is_empty() {
                        continue;
                    }
                    for c in 0..BRICK.pow(3) {
                        let cell = DVec3::new((c % 8) as f64, (c / 8 % 8) as f64, (c / 64) as f64);
                        let p = corner + (cell + DVec3::splat(0.5)) * CELL;
                        let d = self.distances_among(p, &near).0.wall;
                        sum += (0.5 - d / CELL).clamp(0.0, 1.0);
                    }
                }
            }
            sum
        };
        // Sums within a layer and over layers have a fixed order, so the result does not depend on the number of threads.
        let layers: Vec<f64> = (0..bricks.z as i64).into_par_iter().map(layer).collect();
        layers.iter().sum::<f64>() * CELL.powi(3) / 1000.0
    }
}
