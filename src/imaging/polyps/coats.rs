//! Coated spots: thin tag on the wall. Most flat polyps wear a coat of contrast, 1.5 ± 0.6 mm thick (78.8 % of 160, Kim and others,
//! *Flat polyps at CT colonography: contrast coating*, 2014), and cleansing takes it away with what it marks.
//!
//! At each vertex of the cleansed wall the scan as scanned is looked at along the normal. A coat is, from the lumen on: gas, then tag, then
//! soft tissue, with less than [`MOST_MM`] from one to the other. Tag without gas within that is a pool or stool, and so is what is
//! beside it or lies on a pool's level: the rim of a pool is as thin.
//!
//! The thickness is that of a layer of the scan's tag between gas and tissue that leaves as much above the tissue in the blurred scan. With
//! A, T, F the values of gas, tissue and tag, σ the blur, and z = Φ⁻¹((T − A)/(F − A)) where the edge of gas reaches T, the line holds
//! ∫ max(v − T, 0) = (F − T)(d − zσ) − (F − A)σ(φ(z) − z(1 − Φ(z))), exact for d above about 1.5σ; of a thinner coat
//! it is a little more.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{Candidate, Wall};
use crate::error::Result;
use crate::fields::cleanse::{Cleansed, CleansedPool};
use crate::math::normal;
use crate::progress::Progress;
use crate::space::ray::trilinear;
use crate::volume::Volume;

/// Thicker tag is no coat, mm.
const MOST_MM: f64 = 3.0;
/// A smaller spot is noise, mm².
const LEAST_MM2: f64 = 10.0;
/// Distance between two places along the normal, mm: less than half a voxel of usual scans.
const APART_MM: f32 = 0.35;
/// The least radius around a candidate, mm.
const LEAST_RADIUS_MM: f64 = 4.0;
/// Least edge of the cells by which the wall within balls is found, mm.
const CELL_MM: f32 = 8.0;
/// A coat is at least this bright somewhere, HU, and a spot on the mean; above muscle with noise.
const BRIGHT: f32 = 125.0;
const SURE: f64 = 145.0;
/// Tag as bright as this without end is a pool or stool, HU.
const TAG: f32 = 150.0;
/// Below this is gas, HU.
const GAS: f32 = -500.0;
/// Values of gas and of soft tissue, HU, and the range of the latter behind a coat.
const GAS_HU: f64 = -1000.0;
const TISSUE_HU: f64 = 40.0;
const TISSUE: [f32; 2] = [-150.0, 170.0];
/// The blur of a scan of which nothing is known, mm.
const BLUR_MM: f64 = 0.7;
/// Samples of a line: from this many before the wall to this many behind it, and their distance, mm.
const BEFORE: usize = 15;
const BEHIND: usize = 18;
const STEP_MM: f64 = 0.25;
/// Farthest from the wall that the lumen's side of a coat is searched for, samples behind it: a coat too thin to be cleansed.
const INNER: usize = 4;
/// How far behind a coat the tissue is looked at, samples.
const DEEPER: usize = 5;
/// What is this near to a pool or to stool is its rim, mm; and up to the second, what lies on the level of a pool.
const RIM_MM: [f32; 2] = [2.5, 12.0];
/// What is this near to the level of a pool is on it, mm; it is the pool anywhere if it faces along the level by at least this cosine.
const LEVEL_MM: f64 = 1.5;
const LEVEL_COS: f32 = 0.8;

/// A coated spot. World, mm LPS.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoatedSpot {
    /// The place of the wall in its middle.
    pub place: DVec3,
    /// Unit normal into the lumen there.
    pub normal: DVec3,
    /// Its area, mm².
    pub area_mm2: f64,
    /// Mean thickness of the tag, mm.
    pub thickness_mm: f64,
}

/// How much of a place is coated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coated {
    /// Share of the wall there that wears a coat, 0 to 1.
    pub share: f64,
    /// Mean thickness of that, mm; 0 without any.
    pub thickness_mm: f64,
}

/// The coats on a wall.
#[derive(Clone, Debug, Default)]
pub struct Coats {
    /// The spots, largest first.
    pub spots: Vec<CoatedSpot>,
    /// Thickness of the coat at each vertex, mm; 0 where there is none.
    mm: Vec<f32>,
    /// Where the coat begins on the lumen's side, mm along the normal into the lumen.
    front_mm: Vec<f32>,
}

/// The coated spots of a scan, without their wall.
#[derive(Clone, Debug, Default)]
pub struct CoatedPlaces {
    /// The spots, largest first.
    pub spots: Vec<CoatedSpot>,
    /// Places of the wall under and in the coats, world mm: the wall of the cleansed scan and that of the scan as scanned are among them.
    pub places: Arc<[DVec3]>,
}

impl CoatedPlaces {
    /// Collects the places of the coats on a wall.
    pub fn new(coats: &Coats, wall: &Wall) -> Self {
        Self { spots: coats.spots.clone(), places: coats.places(wall).collect() }
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.spots.as_slice()) + size_of_val(&*self.places)
    }
}

/// What a line through the wall shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Line {
    /// No tag.
    #[default]
    Bare,
    /// A pool, or stool.
    Thick,
    /// A coat.
    Coat {
        /// Where it begins, mm before the wall.
        front_mm: f32,
        /// ∫ of what exceeds tissue, HU·mm.
        above: f32,
        /// Its largest value, HU.
        peak: f32,
    },
}

impl Coats {
    /// Finds the coats on `wall`, that of the cleansed scan, in the values as `scanned`: the whole scan, or the part around the colon.
    /// `cleansed` is what was cleansed, if anything was.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn find(wall: &Wall, scanned: &Volume, cleansed: Option<&Cleansed>, progress: &Progress) -> Result<Self> {
        let pools = cleansed.map_or(&[][..], |c| &c.pools);
        let blur_mm = cleansed.map(|c| c.blur_mm).filter(|mm| *mm > 0.0).unwrap_or(BLUR_MM);
        let mut lines: Vec<Line> = (0..wall.len() as u32)
            .into_par_iter()
            .with_min_len(1024)
            .map(|v| if may_wear(wall, v, scanned) { line(&values(wall, v, scanned)) } else { Line::Bare })
            .collect();
        progress.check()?;
        without_pools(wall, &mut lines, pools);
        let tag_hu = tag_hu(&lines, pools);
        let mut coats = Self { spots: Vec::new(), mm: vec![0.0; wall.len()], front_mm: vec![0.0; wall.len()] };
        for (v, line) in lines.iter().enumerate() {
            if let Line::Coat { front_mm, above, peak } = line {
                let thickness = thickness(f64::from(*above), tag_hu.max(f64::from(*peak)), blur_mm);
                if thickness <= MOST_MM {
                    (coats.mm[v], coats.front_mm[v]) = (thickness as f32, *front_mm);
                }
            }
        }
        coats.group(wall, &lines);
        progress.check()?;
        Ok(coats)
    }

    /// Keeps the coats of spots that are large and bright enough.
    fn group(&mut self, wall: &Wall, lines: &[Line]) {
        let mut is_known = vec![false; wall.len()];
        let mut spot = Vec::new();
        for first in 0..wall.len() as u32 {
            if is_known[first as usize] || self.mm[first as usize] == 0.0 {
                continue;
            }
            spot.clear();
            spot.push(first);
            is_known[first as usize] = true;
            let mut next = 0;
            while let Some(&v) = spot.get(next) {
                next += 1;
                for &w in wall.beside(v) {
                    if !is_known[w as usize] && self.mm[w as usize] > 0.0 {
                        is_known[w as usize] = true;
                        spot.push(w);
                    }
                }
            }
            // In the order of the vertices, so that sums do not depend on the way.
            spot.sort_unstable();
            let sum = |of: &dyn Fn(u32) -> f64| spot.iter().map(|&v| f64::from(wall.area(v)) * of(v)).sum::<f64>();
            let area = sum(&|_| 1.0);
            let peak = sum(&|v| match lines[v as usize] {
                Line::Coat { peak, .. } => f64::from(peak),
                _ => 0.0,
            });
            if area < LEAST_MM2 || peak < SURE * area {
                spot.iter().for_each(|&v| self.mm[v as usize] = 0.0);
                continue;
            }
            let middle = spot.iter().map(|&v| wall.world(v) * f64::from(wall.area(v))).sum::<DVec3>() / area;
            let off = |v: &u32| (wall.world(*v).distance_squared(middle), *v);
            let Some(at) = spot.iter().copied().min_by(|a, b| off(a).partial_cmp(&off(b)).unwrap_or(a.cmp(b))) else {
                continue;
            };
            let thickness_mm = sum(&|v| f64::from(self.mm[v as usize])) / area;
            let normal = wall.normal(at).as_dvec3();
            self.spots.push(CoatedSpot { place: wall.world(at), normal, area_mm2: area, thickness_mm });
        }
        self.spots.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    }

    /// Returns how much of the wall within `radius_mm` of a place (world) is coated. `wall` is the one in which the coats were found.
    pub fn at(&self, wall: &Wall, place: DVec3, radius_mm: f64) -> Coated {
        self.within(wall, &[(place, radius_mm)])[0]
    }

    /// Returns how much of each candidate is coated: of the wall within its diameter and 1 mm beside it, at least 4 mm around its place.
    pub fn of_each<'c>(&self, wall: &Wall, candidates: impl IntoIterator<Item = &'c Candidate>) -> Vec<Coated> {
        let ball = |candidate: &Candidate| {
            let radius = candidate.lesion.as_ref().map_or(0.0, |l| 0.5 * l.diameter_mm + 1.0);
            (candidate.position, radius.max(LEAST_RADIUS_MM))
        };
        self.within(wall, &candidates.into_iter().map(ball).collect::<Vec<_>>())
    }

    /// Returns how much of the wall is coated within each of some balls (world, mm).
    fn within(&self, wall: &Wall, balls: &[(DVec3, f64)]) -> Vec<Coated> {
        let balls = balls.iter().map(|(place, radius)| ((*place - wall.origin()).as_vec3(), *radius as f32));
        let balls: Vec<(Vec3, f32)> = balls.collect();
        let mut cells: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
        // So that no ball is in many cells.
        let edge = balls.iter().map(|b| b.1).fold(CELL_MM, f32::max);
        let cell = |place: Vec3| (place / edge).floor().as_ivec3();
        for (n, &(middle, radius)) in balls.iter().enumerate() {
            let [low, high] = [-radius, radius].map(|by| cell(middle + by));
            for z in low.z..=high.z {
                for y in low.y..=high.y {
                    (low.x..=high.x).for_each(|x| cells.entry([x, y, z]).or_default().push(n));
                }
            }
        }
        let mut sums = vec![[0.0; 3]; balls.len()];
        let mut near: Option<([i32; 3], &[usize])> = None;
        for v in 0..wall.len().min(self.mm.len()) as u32 {
            let place = wall.place(v);
            let at = cell(place).to_array();
            // Vertices that follow each other are near to each other.
            let (_, here) = match near {
                Some(near) if near.0 == at => near,
                _ => *near.insert((at, cells.get(&at).map_or(&[][..], |own| own))),
            };
            for &n in here {
                let (middle, radius) = balls[n];
                if place.distance_squared(middle) > radius * radius {
                    continue;
                }
                let (area, mm) = (f64::from(wall.area(v)), f64::from(self.mm[v as usize]));
                let [all, coated, thick] = &mut sums[n];
                *all += area;
                if mm > 0.0 {
                    *coated += area;
                    *thick += area * mm;
                }
            }
        }
        let share = |part: f64, of: f64| if of > 0.0 { part / of } else { 0.0 };
        let coated =
            |[all, coated, thick]: [f64; 3]| Coated { share: share(coated, all), thickness_mm: share(thick, coated) };
        sums.into_iter().map(coated).collect()
    }

    /// Returns the thickness of the coat at a vertex of the wall, mm; 0 where there is none.
    pub fn thickness(&self, vertex: u32) -> f32 {
        self.mm.get(vertex as usize).copied().unwrap_or(0.0)
    }

    /// Returns the places of [`CoatedPlaces`].
    fn places<'a>(&'a self, wall: &'a Wall) -> impl Iterator<Item = DVec3> + 'a {
        let coated = (0..self.mm.len() as u32).filter(|&v| self.mm[v as usize] > 0.0);
        coated.flat_map(move |v| {
            // From the wall to the lumen's side of the coat, whichever the picture shows.
            let (from, to) = (self.front_mm[v as usize].min(0.0), self.front_mm[v as usize].max(0.0));
            let steps = ((to - from) / APART_MM).ceil() as usize;
            let at = move |n: usize| from + (to - from) * n as f32 / steps.max(1) as f32;
            let (place, normal) = (wall.world(v), wall.normal(v));
            (0..=steps).map(move |n| place + (normal * at(n)).as_dvec3())
        })
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.spots.as_slice()) + size_of_val(self.mm.as_slice()) + size_of_val(self.front_mm.as_slice())
    }
}

/// True if the voxels on the line through a vertex are bright enough for tag, or nearly. Most walls are bare.
fn may_wear(wall: &Wall, vertex: u32, scanned: &Volume) -> bool {
    let grid = scanned.grid();
    let from = grid.voxel(wall.world(vertex)) + 0.5;
    let step = grid.to_voxel().transform_vector3(wall.normal(vertex).as_dvec3()) * -STEP_MM;
    (0..=BEFORE + INNER).step_by(2).any(|n| {
        let [i, j, k] = (from + step * (n as f64 - BEFORE as f64)).floor().to_array().map(|c| c as i64);
        f32::from(scanned.get(i, j, k)) >= 0.6 * BRIGHT
    })
}

/// Returns the values on the line through a vertex, from the lumen on, HU.
fn values(wall: &Wall, vertex: u32, scanned: &Volume) -> [f32; BEFORE + BEHIND + 1] {
    let grid = scanned.grid();
    let from = grid.voxel(wall.world(vertex));
    let step = grid.to_voxel().transform_vector3(wall.normal(vertex).as_dvec3()) * -STEP_MM;
    std::array::from_fn(|n| trilinear(scanned, from + step * (n as f64 - BEFORE as f64)) as f32)
}

/// Judges the values on a line.
fn line(values: &[f32; BEFORE + BEHIND + 1]) -> Line {
    let from = BEFORE + INNER;
    let most = values[..=from].iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if most < BRIGHT {
        return Line::Bare;
    }
    // The lumen's gas, going outwards.
    let Some(gas) = (0..=from).rev().find(|&n| values[n] < GAS) else {
        let before = &values[BEFORE - 12..=BEFORE];
        let is_tag = before.iter().filter(|v| **v >= TAG).count() * 4 >= before.len() * 3;
        return if is_tag { Line::Thick } else { Line::Bare };
    };
    // The brightest part before the next fall: the first rise from the gas.
    let mut peak = gas;
    while peak + 1 < values.len() && (values[peak + 1] >= values[peak] || values[peak] < BRIGHT) {
        peak += 1;
    }
    // Noise on a broad top.
    let near = peak..(peak + 3).min(values.len());
    let peak = near.rev().max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(peak);
    let top = values[peak];
    if top < BRIGHT || peak > gas + (MOST_MM / STEP_MM) as usize + 4 {
        return Line::Bare;
    }
    let half = 0.5 * (top + TISSUE_HU as f32);
    let Some(end) = (peak..values.len()).find(|&n| values[n] < half) else { return Line::Thick };
    if end - gas > (MOST_MM / STEP_MM) as usize + 4 {
        return Line::Thick;
    }
    let behind = values[(end + DEEPER).min(values.len() - 1)];
    if !(TISSUE[0]..=TISSUE[1]).contains(&behind) {
        return Line::Bare;
    }
    let above =
        values[gas..(end + DEEPER).min(values.len())].iter().map(|v| (v - TISSUE_HU as f32).max(0.0)).sum::<f32>();
    Line::Coat {
        front_mm: (BEFORE as f32 - gas as f32 - 1.0) * STEP_MM as f32,
        above: above * STEP_MM as f32,
        peak: top,
    }
}

/// Takes away what belongs to pools and to stool: the rims of thick tag, and what lies on a level.
fn without_pools(wall: &Wall, lines: &mut [Line], pools: &[CleansedPool]) {
    // How far along the wall from thick tag, mm: rings of neighbours around it, as far as they count.
    let mut rim: Vec<u32> = (0..wall.len() as u32).filter(|&v| lines[v as usize] == Line::Thick).collect();
    let mut off = vec![f32::INFINITY; wall.len()];
    rim.iter().for_each(|&v| off[v as usize] = 0.0);
    while !rim.is_empty() {
        let mut next = Vec::new();
        for &v in &rim {
            for &w in wall.beside(v) {
                let mm = off[v as usize] + wall.place(v).distance(wall.place(w));
                if mm < off[w as usize] && mm <= RIM_MM[1] {
                    off[w as usize] = mm;
                    next.push(w);
                }
            }
        }
        rim = next;
    }
    for (v, line) in lines.iter_mut().enumerate() {
        let Line::Coat { front_mm, .. } = *line else { continue };
        let normal = wall.normal(v as u32);
        let front = wall.world(v as u32) + (normal * front_mm).as_dvec3();
        let is_level = |pool: &CleansedPool| {
            let [point, up] = pool.level;
            let faces = off[v] <= RIM_MM[1] || normal.dot(up.as_vec3()) > LEVEL_COS;
            faces && (front - point).dot(up).abs() < LEVEL_MM
        };
        if off[v] <= RIM_MM[0] || normal == Vec3::ZERO || pools.iter().any(is_level) {
            *line = Line::Bare;
        }
    }
}

/// Returns the value of the scan's tag, HU: that of its pools, or of the brightest coats.
fn tag_hu(lines: &[Line], pools: &[CleansedPool]) -> f64 {
    let ml: f64 = pools.iter().map(|p| p.ml).sum();
    if ml > 0.0 {
        return pools.iter().map(|p| p.ml * p.tag_hu).sum::<f64>() / ml;
    }
    let peak = |line: &Line| if let Line::Coat { peak, .. } = line { Some(*peak) } else { None };
    let mut peaks: Vec<f32> = lines.iter().filter_map(peak).collect();
    peaks.sort_unstable_by(f32::total_cmp);
    peaks.get(peaks.len() * 95 / 100).map_or(0.0, |p| f64::from(*p))
}

/// Returns the thickness of a coat of `tag_hu` that leaves `above` (HU·mm) over tissue, mm.
fn thickness(above: f64, tag_hu: f64, blur_mm: f64) -> f64 {
    let (contrast, edge) = (tag_hu - TISSUE_HU, tag_hu - GAS_HU);
    let z = normal::quantile((TISSUE_HU - GAS_HU) / edge);
    let lost = contrast * z + edge * (density(z) - z * (1.0 - normal::cdf(z)));
    ((above + lost * blur_mm) / contrast).max(0.2)
}

/// Returns φ(x), the density of the normal distribution.
fn density(x: f64) -> f64 {
    (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt()
}

#[cfg(test)]
#[path = "coats_tests.rs"]
mod tests;
