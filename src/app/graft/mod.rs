//! Lesions put into a real scan: its background, noise and anatomy are real, and the truth of the lesions is exact.
//!
//! `spread` measures how the scanner blurs, `noise` how its noise is strong and correlated, both at the scan's own walls and tissue; `site`
//! draws places on the wall, `form` shapes, and `patch` puts one lesion into the voxels around it. Voxels farther away keep their bits.

mod draw;
mod form;
mod noise;
mod patch;
mod site;
mod spread;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use serde::Serialize;

use crate::Timings;
use crate::colon;
use crate::error::{Error, Result};
use crate::fields::lumen;
use crate::found::Found;
use crate::math::hash::Stream;
use crate::phantom::{PolypShape, PolypSite, TruePolyp};
use crate::polyps::Wall;
use crate::progress::Progress;
use crate::space::ray::trilinear;
use crate::volume::{Volume, content_hash};
use form::Form;
use noise::Noise;
use patch::{Coat, Patch, Scan};
use site::Sites;

pub use noise::NoiseLevel;
pub use spread::Spread;

/// The wall that lesions grow on: half-way from gas to tissue, HU.
const HALF_HU: f64 = -480.0;
/// Lesions are at least this far apart, mm: so are their surroundings.
const APART_MM: f64 = 12.0;
/// Shares of the shapes and places.
const SHAPES: [(PolypShape, f64); 3] =
    [(PolypShape::Sessile, 0.45), (PolypShape::Stalked, 0.25), (PolypShape::Flat, 0.3)];
const SITES: [(PolypSite, f64); 3] = [(PolypSite::Wall, 0.4), (PolypSite::Fold, 0.3), (PolypSite::Between, 0.3)];
/// Diameters, mm, with their shares; evenly by their logarithm within each.
const SIZES: [([f64; 2], f64); 3] = [([3.5, 6.0], 0.2), ([6.0, 10.0], 0.5), ([10.0, 20.0], 0.3)];
/// Least diameters of stalked and of flat lesions, mm, and the largest on a fold and beside one.
const LEAST_STALKED_MM: f64 = 5.0;
const LEAST_FLAT_MM: f64 = 6.0;
const MOST_ON_FOLD_MM: f64 = 10.0;
const MOST_BESIDE_MM: f64 = 12.0;
/// Each so-many-th lesion that is not flat is looked for under fluid first, and so many have a coat, if the scan has tag.
const UNDER: usize = 5;
const COATED: usize = 4;
/// Thickness of coats, mm.
const COAT_MM: [f64; 2] = [0.4, 1.4];
/// Draws of a form at a place, before the wish becomes a smaller one.
const FORMS: usize = 12;
/// A lesion's tip keeps this distance from the opposite wall, mm.
const FREE_MM: f64 = 2.5;
/// Behind the wall there is tissue up to this depth, mm, brighter than that, HU: not the bore of a tube, nor another lumen.
const BEHIND_MM: [f64; 2] = [1.2, 4.0];
const BEHIND_HU: f64 = -350.0;
/// The wall's own HU are those at these depths, mm. They are the mean over so many places around, this far apart, mm, and at most that far
/// from those of the scan's walls.
const DEPTH_MM: [f64; 3] = [1.4, 1.8, 2.2];
const AROUND: usize = 12;
const AROUND_MM: f64 = 1.0;
const OWN_HU: f64 = 20.0;
/// The wall's tissue is within these values, HU, and a lesion's within those: a thin wall is dark, as its blur reaches into fat.
const TISSUE_HU: [f64; 2] = [-40.0, 140.0];
const LESION_HU: [f64; 2] = [15.0, 90.0];

/// A scan with lesions.
#[derive(Debug)]
pub struct Grafted {
    /// The scan.
    pub volume: Volume,
    /// Its lesions and its anatomy.
    pub truth: GraftTruth,
}

/// What is known of a scan with lesions: of them exactly, of the rest as it was measured in the scan. World, mm LPS.
#[derive(Clone, Debug, Serialize)]
pub struct GraftTruth {
    /// Points of the scan's centerline, from rectum to cecum; empty if it was not found.
    pub centerline: Vec<DVec3>,
    /// Distance from the wall at each of them, mm.
    pub radius_mm: Vec<f64>,
    /// Length of that line, mm.
    pub length_mm: f64,
    /// Volume of gas and fluid, ml.
    pub lumen_ml: f64,
    /// The lesions, in the order of the centerline.
    pub polyps: Vec<TruePolyp>,
    /// The value at which the edge of a lesion is, half-way from gas to tissue, HU.
    pub wall_hu: i32,
    /// The scan that they were put into.
    pub scan: Host,
}

/// The scan that lesions were put into.
#[derive(Clone, Debug, Serialize)]
pub struct Host {
    /// Hash of its content, as in a findings file.
    pub content: String,
    /// How it blurs.
    pub spread: Spread,
    /// Its noise.
    pub noise: NoiseLevel,
    /// HU of its tag, if it has pools.
    pub tag_hu: Option<f64>,
    /// Lesions that were asked for; fewer may have found room.
    pub asked: usize,
    /// The seed.
    pub seed: u64,
}

/// Puts lesions into a scan. The same scan, seed and number give the same lesions.
///
/// # Errors
/// Returns status 4 if the scan has no gas of a colon, if its walls do not show how it blurs, if no lesion has room, or if interrupted.
pub fn graft(volume: Volume, seed: u64, count: usize, progress: &Progress) -> Result<Grafted> {
    let found = lumen::find(&volume, progress)?;
    let mut cleansed = volume.clone();
    let again = |volume: &Volume| lumen::find(volume, progress);
    let (found, known, mut untimed) = (Arc::new(found), Found::default(), Timings::default());
    let (lumen, made) =
        colon::without_tag(&mut cleansed, (found, &known), true, again, |_| (), &mut untimed, progress)?;
    let along = lumen.along(&volume, progress)?;
    let wall = Wall::new(&cleansed, &lumen, HALF_HU, progress)?;
    progress.stage("measuring the scan's blur and noise", 0);
    let spread = Spread::of(&volume, &wall).ok_or_else(|| {
        let why = "too few walls lie against tissue to measure how the scan blurs";
        Error::incomplete("lesions", why, "give a scan of a colon with gas in it")
    })?;
    let noise = match lumen.around(colon::WALL_MM) {
        Some((first, dims)) => Noise::of(&volume.part(first, dims)),
        None => Noise::of(&volume),
    };
    let pools = made.iter().flat_map(|m| &m.pools);
    let tag_hu = pools.max_by(|a, b| a.ml.total_cmp(&b.ml)).map(|p| p.tag_hu);
    let host = Host { content: content_hash(&volume), spread, noise: noise.level(), tag_hu, asked: count, seed };
    let scan = Scan { raw: &volume, cleansed: &cleansed, spread, noise: &noise, seed };
    let patches = Grower { scan, sites: Sites::new(&wall), tag_hu, taken: Vec::new() }.grow(seed, count, progress)?;
    if patches.is_empty() {
        return Err(Error::incomplete("lesions", "none has room in this colon", "give another scan, or a whole one"));
    }
    let lumen_ml = lumen.gas_ml() + lumen.fluid_ml();
    drop((wall, cleansed, lumen));
    let mut polyps: Vec<TruePolyp> = patches.iter().map(|p| p.truth).collect();
    for polyp in &mut polyps {
        polyp.along_mm = along.of(polyp.position).map(|a| a.mm);
    }
    polyps.sort_by(|a, b| a.along_mm.unwrap_or(0.0).total_cmp(&b.along_mm.unwrap_or(0.0)));
    let line = along.line();
    let truth = GraftTruth {
        centerline: line.map_or_else(Vec::new, |l| l.points.clone()),
        radius_mm: line.map_or_else(Vec::new, |l| l.radius_mm.clone()),
        length_mm: along.length_mm(),
        lumen_ml,
        polyps,
        wall_hu: HALF_HU as i32,
        scan: host,
    };
    let mut volume = volume;
    let voxels = patches.into_iter().flat_map(|p| p.added);
    apply(&mut volume, voxels);
    Ok(Grafted { volume, truth })
}

/// Adds values to voxels. A slice that holds few values only, as of a scan that was once an image, gets no others.
fn apply(volume: &mut Volume, added: impl Iterator<Item = ([usize; 3], f64)>) {
    let [nx, ny, _] = volume.grid().dims();
    let mut slices: BTreeMap<usize, Vec<(usize, f64)>> = BTreeMap::new();
    for ([i, j, k], hu) in added {
        slices.entry(k).or_default().push((i + nx * j, hu));
    }
    for (k, added) in slices {
        let slice = &mut volume.data_mut()[k * nx * ny..(k + 1) * nx * ny];
        let mut has = slice.to_vec();
        has.sort_unstable();
        has.dedup();
        for (n, hu) in added {
            let value = f64::from(slice[n]) + hu;
            let above = has.partition_point(|h| f64::from(*h) < value).min(has.len() - 1);
            let below = above.saturating_sub(1);
            let nearer = if value - f64::from(has[below]) < f64::from(has[above]) - value { below } else { above };
            slice[n] = has[nearer];
        }
    }
}

/// The requested properties of a lesion.
#[derive(Clone, Copy, Debug)]
struct Wish {
    shape: PolypShape,
    site: PolypSite,
    diameter_mm: f64,
    under: bool,
    coated: bool,
}

/// Returns the requested lesions, largest first. Shapes, places and sizes have their shares of any number, each in an order of its own.
fn wishes(seed: u64, count: usize) -> Vec<Wish> {
    let mut draw = draw::stream(seed, 1);
    let mut spread = || {
        let mut shares: Vec<f64> = (0..count).map(|i| (i as f64 + draw.within(0.0, 1.0)) / count as f64).collect();
        for i in (1..count).rev() {
            shares.swap(i, draw.below(i + 1));
        }
        shares
    };
    let [shapes, sites, sizes, kinds] = std::array::from_fn(|_| spread());
    let mut all: Vec<Wish> = (0..count)
        .map(|n| {
            let (shape, site) = (picked(&SHAPES, shapes[n]).0, picked(&SITES, sites[n]).0);
            let ([lo, hi], share) = picked(&SIZES, sizes[n]);
            let drawn = lo * (hi / lo).powf(share);
            let least = match shape {
                PolypShape::Stalked => LEAST_STALKED_MM,
                PolypShape::Flat => LEAST_FLAT_MM,
                _ => 0.0,
            };
            let most = match site {
                PolypSite::Fold => MOST_ON_FOLD_MM,
                PolypSite::Between => MOST_BESIDE_MM,
                PolypSite::Wall => f64::INFINITY,
            };
            let kind = (kinds[n] * (UNDER * COATED) as f64) as usize;
            let under = shape != PolypShape::Flat && kind.is_multiple_of(UNDER);
            Wish { shape, site, diameter_mm: drawn.clamp(least, most), under, coated: !under && kind % COATED == 1 }
        })
        .collect();
    all.sort_by(|a, b| b.diameter_mm.total_cmp(&a.diameter_mm));
    all
}

/// Returns what a number from 0 to 1 picks among things with shares, and where it is within that share, 0 to 1.
fn picked<T: Copy>(of: &[(T, f64)], share: f64) -> (T, f64) {
    let mut from = 0.0;
    for (thing, part) in of {
        if share < from + part {
            return (*thing, (share - from) / part);
        }
        from += part;
    }
    (of[of.len() - 1].0, 1.0)
}

/// The search for room.
struct Grower<'a> {
    scan: Scan<'a>,
    sites: Sites<'a>,
    tag_hu: Option<f64>,
    /// Balls that lesions take, and their surroundings: middle (world, mm) and radius, mm.
    taken: Vec<(DVec3, f64)>,
}

impl Grower<'_> {
    /// Puts lesions where there is room for them, one after the other.
    fn grow(mut self, seed: u64, count: usize, progress: &Progress) -> Result<Vec<Patch>> {
        progress.stage("putting lesions in", count as u64);
        let mut out = Vec::new();
        for (n, wish) in wishes(seed, count).into_iter().enumerate() {
            let mut draw = draw::stream(seed, 100 + n as u64);
            if let Some(patch) = self.find(wish, &mut draw, progress)? {
                out.push(patch);
            }
            progress.advance(1)?;
        }
        Ok(out)
    }

    /// Finds room for a wish, or else for a dry, a smaller one, or one on the plain wall.
    fn find(&mut self, wish: Wish, draw: &mut Stream, progress: &Progress) -> Result<Option<Patch>> {
        let smaller = |w: Wish, share: f64| Wish { diameter_mm: w.diameter_mm * share, ..w };
        let dry = Wish { under: false, ..wish };
        let plain = Wish { site: PolypSite::Wall, coated: false, ..dry };
        let first = if wish.under && self.tag_hu.is_none() { dry } else { wish };
        for wish in [first, dry, smaller(dry, 0.8), plain, smaller(plain, 0.7)] {
            for _ in 0..FORMS {
                if let Some(patch) = self.attempt(wish, draw, progress)? {
                    return Ok(Some(patch));
                }
            }
        }
        Ok(None)
    }

    fn attempt(&mut self, wish: Wish, draw: &mut Stream, progress: &Progress) -> Result<Option<Patch>> {
        let radius = 0.5 * wish.diameter_mm;
        let grid = self.scan.raw.grid();
        let accepts = |place: DVec3| {
            let is_free = self.taken.iter().all(|(at, mm)| at.distance(place) > mm + radius + APART_MM);
            let raw = trilinear(self.scan.raw, grid.voxel(place));
            // The wall under fluid is hidden in a bright edge.
            is_free && (raw > HALF_HU + 250.0) == wish.under
        };
        let Some(root) = self.sites.draw(wish.site, radius, draw, accepts) else { return Ok(None) };
        let form = Form::drawn(wish.shape, wish.diameter_mm, root, draw);
        let hu = |mm: f64| trilinear(self.scan.cleansed, grid.voxel(root.place + root.up * mm));
        let steps = |from: f64, to: f64| (0..=((to - from) / 0.4) as usize).map(move |n| from + 0.4 * n as f64);
        let has_room = steps(1.2, form.top_mm() + FREE_MM).all(|mm| hu(mm) < HALF_HU);
        let is_solid = steps(BEHIND_MM[0], BEHIND_MM[1]).all(|mm| hu(-mm) > BEHIND_HU);
        if !has_room || !is_solid {
            return Ok(None);
        }
        let own = self.wall_hu(root.place, root.up);
        if !(TISSUE_HU[0]..=TISSUE_HU[1]).contains(&own) {
            return Ok(None);
        }
        let usual = self.scan.spread.tissue_hu;
        let tissue_hu = own.clamp(usual - OWN_HU, usual + OWN_HU).clamp(LESION_HU[0], LESION_HU[1]);
        let coat = self.tag_hu.filter(|_| wish.coated).map(|tag| Coat {
            mm: draw.within(COAT_MM[0], COAT_MM[1]),
            hu: tag * draw.within(0.5, 1.0),
            side: ((root.up + draw::direction(draw)).normalize_or(root.up), draw.within(-1.0, 0.3)),
        });
        let patch = patch::patch(&self.scan, &form, coat, tissue_hu, progress)?;
        let patch = patch.filter(|p| p.truth.submerged == wish.under);
        if patch.is_some() {
            self.taken.push((root.place, form.reach_mm()));
        }
        Ok(patch)
    }

    /// Returns the HU of the wall around a place, with the direction into the lumen there.
    fn wall_hu(&self, place: DVec3, up: DVec3) -> f64 {
        let (scan, grid) = (self.scan.cleansed, self.scan.raw.grid());
        let (u, w) = up.any_orthonormal_pair();
        let beside = |n: usize| {
            let (sin, cos) = (n as f64 * std::f64::consts::TAU / 6.0).sin_cos();
            place + (u * cos + w * sin) * AROUND_MM * (1 + n / 6) as f64
        };
        let at = |mm: f64| (0..AROUND).map(|n| trilinear(scan, grid.voxel(beside(n) - up * mm))).sum::<f64>();
        DEPTH_MM.map(|mm| at(mm) / AROUND as f64).into_iter().sum::<f64>() / DEPTH_MM.len() as f64
    }
}
