//! Errors of one cleansed phantom, compared with the same colon without tagging.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::methods::Method;
use crate::error::Result;
use crate::fields::Lumen;
use crate::phantom::{Beside, Phantom, TruePolyp};
use crate::progress::Progress;
use crate::render::regression::{Regression, Weighting, block};
use crate::report::{mean, quantile, timed};
use crate::space::ray::trilinear;
use crate::space::{PreparedVolume, TransferFunction};
use crate::surface::Mesh;
use crate::volume::Volume;

/// Maximum distance between the true and the cleansed wall, mm: beyond it, the true wall counts as missing and the cleansed one as
/// a ghost.
const LOST_MM: f64 = 1.5;
/// Step of the search for the wall along its normal, mm.
const STEP_MM: f64 = 0.1;

/// A part of the wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Part {
    /// Classified by what lies beside it.
    Beside(Beside),
    /// On a thin fold under fluid.
    Fold,
    /// On a polyp under fluid.
    Polyp,
}

impl Part {
    /// All parts, in the order of the tables.
    pub(super) const ALL: [Self; 8] = [
        Self::Beside(Beside::Gas),
        Self::Beside(Beside::Near),
        Self::Beside(Beside::Fluid),
        Self::Beside(Beside::Rim),
        Self::Beside(Beside::Film),
        Self::Beside(Beside::Stool),
        Self::Fold,
        Self::Polyp,
    ];

    /// Returns the name.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Beside(Beside::Gas) => "dry",
            Self::Beside(Beside::Near) => "dry, within 5 mm of tag",
            Self::Beside(Beside::Fluid) => "under fluid",
            Self::Beside(Beside::Rim) => "rim of a level",
            Self::Beside(Beside::Film) => "under a film",
            Self::Beside(Beside::Stool) => "under stool",
            Self::Fold => "thin fold under fluid",
            Self::Polyp => "polyp under fluid",
        }
    }
}

/// A place on the true wall.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    at: DVec3,
    /// Unit normal, into the tissue.
    normal: DVec3,
    part: Part,
}

/// The true colon and its scan.
pub(super) struct Subject {
    twin: Phantom,
    scan: Arc<Volume>,
    lumen: Lumen,
    places: Vec<Place>,
    /// Share of the tissue in the surroundings of each polyp under fluid, summed over voxels.
    polyps: Vec<(TruePolyp, f64)>,
}

/// Errors on a part of the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Errors {
    pub places: usize,
    pub mean_mm: f64,
    pub p95_mm: f64,
    pub mean_degrees: f64,
    pub p95_degrees: f64,
    /// Share of the places where no wall was found.
    pub missing: f64,
}

/// The result of a method on a subject.
#[derive(Clone, Debug)]
pub(super) struct Outcome {
    pub method: &'static str,
    pub seconds: f64,
    pub megabytes: Option<f64>,
    pub parts: BTreeMap<Part, Errors>,
    /// Share of the surface that floats in the lumen.
    pub ghosts: f64,
    /// Largest deviation of the volume of a polyp under fluid of at least 6 mm, as a share of it; 0 if there is none.
    pub polyp_volume: f64,
}

fn prepared(volume: &Arc<Volume>) -> PreparedVolume {
    PreparedVolume::lean(Arc::clone(volume), TransferFunction::default())
}

impl Subject {
    /// Prepares a phantom, its scan and its lumen, with about `count` places on its wall. Fails if the wall has too many places to
    /// number.
    pub(super) fn new(
        phantom: &Phantom,
        clean: &Arc<Volume>,
        scan: Arc<Volume>,
        lumen: Lumen,
        count: usize,
    ) -> Result<Self> {
        let twin = phantom.twin();
        let mesh = Mesh::new(&prepared(clean))?;
        let polyps = twin.polyps();
        let every = (mesh.places().len() / (3 * count)).max(1);
        let place = |n: u32| {
            let mut at = mesh.world(n);
            let near = phantom.wall_at(at).filter(|w| w.mm.abs() < 1.0)?;
            let mut normal = twin.gradient(at).normalize_or_zero();
            at -= normal * near.mm;
            normal = twin.gradient(at).normalize_or_zero();
            let near = phantom.wall_at(at).filter(|w| w.mm.abs() < 0.1 && normal != DVec3::ZERO)?;
            let on_polyp = |p: &TruePolyp| p.position.distance(at) < 0.5 * p.diameter_mm + 0.3;
            let part = match near.beside {
                Beside::Fluid if near.is_thin_fold => Part::Fold,
                Beside::Fluid if polyps.iter().any(on_polyp) => Part::Polyp,
                beside => Part::Beside(beside),
            };
            Some(Place { at, normal, part })
        };
        let numbers: Vec<u32> = (0..mesh.places().len() as u32).step_by(every).collect();
        let places: Vec<Place> = numbers.into_par_iter().filter_map(place).collect();
        let under = polyps.into_iter().filter(|p| {
            let on_it = |q: &&Place| q.at.distance(p.position) < 0.5 * p.diameter_mm + 0.5;
            let wet = places.iter().filter(on_it).filter(|q| q.part == Part::Polyp).count();
            p.diameter_mm >= 6.0 && 2 * wet > places.iter().filter(on_it).count()
        });
        let polyps = under.map(|p| (p, tissue_around(&twin, clean, &p))).collect();
        Ok(Self { twin, scan, lumen, places, polyps })
    }

    /// Cleanses the scan and measures the result. Fails with status 4 if interrupted, or if the wall has too many places to number.
    pub(super) fn measure(&self, method: &Method, progress: &Progress) -> Result<Outcome> {
        let (clean, seconds, megabytes) = timed(|| (method.apply)(&self.scan, &self.lumen, progress));
        let clean = clean?;
        let found: Vec<(Part, Option<(f64, f64)>)> =
            self.places.par_iter().map(|p| (p.part, found_at(&clean, p))).collect();
        let mut parts = BTreeMap::new();
        for part in Part::ALL {
            let own: Vec<Option<(f64, f64)>> = found.iter().filter(|f| f.0 == part).map(|f| f.1).collect();
            if own.is_empty() {
                continue;
            }
            let (mm, degrees): (Vec<f64>, Vec<f64>) = own.iter().flatten().copied().unzip();
            let errors = Errors {
                places: own.len(),
                mean_mm: mean(&mm),
                p95_mm: quantile(&mm, 0.95),
                mean_degrees: mean(&degrees),
                p95_degrees: quantile(&degrees, 0.95),
                missing: (own.len() - mm.len()) as f64 / own.len() as f64,
            };
            parts.insert(part, errors);
        }
        let volume = |&(ref polyp, truth): &(TruePolyp, f64)| {
            (tissue_around(&self.twin, &clean, polyp) / truth.max(1e-9) - 1.0).abs()
        };
        let polyp_volume = self.polyps.iter().map(volume).fold(0.0, f64::max);
        Ok(Outcome { method: method.name, seconds, megabytes, parts, ghosts: self.ghosts(&clean)?, polyp_volume })
    }

    /// Returns the share of the colon's surface that floats in the lumen.
    fn ghosts(&self, clean: &Arc<Volume>) -> Result<f64> {
        let mesh = Mesh::new(&prepared(clean))?;
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|n| mesh.world(n));
            let area = 0.5 * (b - a).cross(c - a).length();
            match self.twin.wall_at((a + b + c) / 3.0) {
                Some(wall) if wall.mm < -LOST_MM => [0.0, area],
                Some(_) => [area, 0.0],
                None => [0.0; 2],
            }
        };
        // Sums of fixed parts, so that they do not depend on the threads.
        let sums: Vec<[f64; 2]> = mesh
            .triangles()
            .par_chunks(4096)
            .map(|part| part.iter().map(area).fold([0.0; 2], |s, a| [s[0] + a[0], s[1] + a[1]]))
            .collect();
        let [wall, ghosts] = sums.iter().fold([0.0; 2], |s, a| [s[0] + a[0], s[1] + a[1]]);
        Ok(ghosts / (wall + ghosts).max(1e-9))
    }

    /// Returns the number of polyps under fluid of at least 6 mm.
    pub(super) fn polyps(&self) -> usize {
        self.polyps.len()
    }
}

/// Returns how far the wall is from its place, mm, and by how much its normal differs, degrees; `None` if there is none.
fn found_at(volume: &Volume, place: &Place) -> Option<(f64, f64)> {
    let (grid, iso) = (volume.grid(), TransferFunction::default().iso());
    let value = |mm: f64| trilinear(volume, grid.voxel(place.at + place.normal * mm)) - iso;
    let steps = (LOST_MM / STEP_MM).round() as i32;
    let mut best: Option<f64> = None;
    let mut before = value(-LOST_MM);
    for n in -steps + 1..=steps {
        let mm = f64::from(n) * STEP_MM;
        let now = value(mm);
        if before < 0.0 && now >= 0.0 {
            let at = mm - STEP_MM * now / (now - before);
            best = best.filter(|b| b.abs() <= at.abs()).or(Some(at));
        }
        before = now;
    }
    let mm = best?;
    // As the default renderer estimates it.
    let voxel = grid.voxel(place.at + place.normal * mm);
    let base = voxel.floor();
    let around = block(volume, base.to_array().map(|c| c as i32 - 1));
    let fit = Regression::new(grid.spacing(), Weighting::InverseSquare).fit(&around, (voxel - base).as_vec3());
    let gradient = grid.direction() * fit.gradient.as_dvec3();
    let degrees = if gradient.length() > 0.0 { gradient.angle_between(place.normal).to_degrees() } else { 90.0 };
    Some((mm.abs(), degrees))
}

/// Returns the sum of the tissue's share over the voxels of a polyp and the lumen around it.
fn tissue_around(twin: &Phantom, volume: &Volume, polyp: &TruePolyp) -> f64 {
    let grid = volume.grid();
    let reach = 0.5 * polyp.diameter_mm + 2.0;
    let middle = grid.voxel(polyp.position);
    let span = (reach / grid.spacing()).ceil();
    let (first, last) = ((middle - span).floor().as_i64vec3(), (middle + span).ceil().as_i64vec3());
    let mut sum = 0.0;
    for k in first.z..=last.z {
        for j in first.y..=last.y {
            for i in first.x..=last.x {
                let at = grid.world(DVec3::new(i as f64, j as f64, k as f64));
                // Not the wall behind it.
                let in_lumen = twin.plain_wall(at) < 0.0;
                if at.distance(polyp.position) < reach && in_lumen {
                    sum += ((f64::from(volume.get(i, j, k)) + 1000.0) / 1040.0).clamp(0.0, 1.0);
                }
            }
        }
    }
    sum
}
