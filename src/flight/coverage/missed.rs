//! Patches of the wall that were not seen, with a place to look at each from.

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize as _;

use super::sight::{FLATTEST_DEGREES, REACH_MM};
use super::wall::Wall;
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::fields::{AlongColon, ClearanceFinder, Clearances};
use crate::math::sets::Sets;
use crate::math::sphere::half_directions;
use crate::progress::Progress;
use crate::render::Camera;
use crate::space::PreparedVolume;

/// Minimum area of a reported patch, mm²: a study of 223 patients counts patches from this area on.
pub const LEAST_MM2: f64 = 300.0;
/// Distances from a patch at which places to look from are tried, mm.
const AWAY_MM: [f64; 6] = [6.0, 9.0, 13.0, 18.0, 24.0, 32.0];
/// Directions to such places, for each distance.
const WAYS: usize = 48;
/// Minimum distance of such a place from the wall beyond the camera's radius, mm.
const FREE_MM: f64 = 0.5;
/// Maximum distance from a place to the wall that a look at the place is directed at, mm.
const ABOUT_MM: f64 = 5.0;
/// Distance from the wall into the gas at which a patch is looked up along the colon, mm.
const INTO_GAS_MM: f64 = 2.0;
/// A patch needs no look of its own if others show this share of it.
const SHOWN: f64 = 0.7;
/// Triangles of a patch that are tried from each place, at most.
const TRIED: usize = 32;

/// The scans that are searched for places to look from.
#[derive(Clone, Copy, Debug)]
pub struct Scans<'a> {
    /// The one whose wall is looked at.
    pub shown: &'a PreparedVolume,
    /// The one in which the camera flies.
    pub flown: &'a PreparedVolume,
}

impl<'a> From<&'a PreparedVolume> for Scans<'a> {
    fn from(both: &'a PreparedVolume) -> Self {
        Self { shown: both, flown: both }
    }
}

/// A patch that was not seen.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Missed {
    /// Area, mm².
    pub area_mm2: f64,
    /// The centroid of its triangle nearest to its middle, world mm.
    pub position: DVec3,
    /// Its mean unit normal into the gas, world.
    pub normal: DVec3,
    /// Where it is along the colon; `None` if that is not known. Files have the distance alone, as `along_mm`.
    #[serde(rename = "along_mm", serialize_with = "distance_alone")]
    pub along: Option<AlongColon>,
    /// Where most of it is seen from; `None` if no place was found where the camera fits.
    pub look_from: Option<LookFrom>,
    /// Its triangles.
    #[serde(skip)]
    pub triangles: Vec<u32>,
}

/// Writes the distance along the colon, mm.
fn distance_alone<S: serde::Serializer>(along: &Option<AlongColon>, to: S) -> std::result::Result<S::Ok, S::Error> {
    along.map(|a| a.mm).serialize(to)
}

/// A view of a missed patch.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LookFrom {
    /// Position, world mm.
    pub position: DVec3,
    /// Unit view direction, world.
    pub forward: DVec3,
    /// Unit up direction, world.
    pub up: DVec3,
}

/// Returns the patches of at least `least_mm2` for whose triangles `is_seen` is false, the largest first. Triangles that share an edge
/// belong to one patch. `along` returns where along the colon a place in the gas is (world mm), and the camera that flies in
/// `scans` has a radius of `radius_mm`.
///
/// # Errors
/// Returns status 4 if interrupted.
pub fn missed<'a>(
    wall: &Wall,
    is_seen: impl Fn(usize) -> bool,
    least_mm2: f64,
    along: impl Fn(DVec3) -> Option<AlongColon> + Sync,
    scans: impl Into<Scans<'a>>,
    radius_mm: f64,
    progress: &Progress,
) -> Result<Vec<Missed>> {
    let walls = &Finders::new(scans.into(), radius_mm);
    let all = patches(wall, is_seen);
    let found: Result<Vec<Option<Missed>>> = all
        .into_par_iter()
        .map(|triangles| {
            progress.check()?;
            let area_mm2: f64 = triangles.iter().map(|&n| wall.mm2_at(n as usize)).sum();
            if area_mm2 < least_mm2 {
                return Ok(None);
            }
            let (mut middle, mut normal) = (DVec3::ZERO, DVec3::ZERO);
            for &n in &triangles {
                let face = wall.face(n as usize);
                let mm2 = f64::from(face.mm2);
                middle += (wall.origin + face.centroid.as_dvec3()) * mm2;
                normal += face.normal.as_dvec3() * mm2;
            }
            let (middle, normal) = (middle / area_mm2, normal.normalize_or_zero());
            let far = |n: &u32| wall.centroid(*n as usize).distance_squared(middle);
            let Some(&nearest) = triangles.iter().min_by(|a, b| far(a).total_cmp(&far(b))) else { return Ok(None) };
            let position = wall.centroid(nearest as usize);
            let along = along(position + wall.normal(nearest as usize) * INTO_GAS_MM);
            let look_from = look_from(wall, &triangles, position, normal, walls, radius_mm);
            Ok(Some(Missed { area_mm2, position, normal, along, look_from, triangles }))
        })
        .collect();
    let mut found: Vec<Missed> = found?.into_iter().flatten().collect();
    found.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    Ok(found)
}

/// Returns the numbers of the patches that a review looks at, in their order: those that can be looked at, without those of which the
/// views of the ones before show most. `unseen` is the part of the wall that was not seen, with the `numbers` of its triangles in the
/// whole wall (see [`Wall::part`]).
///
/// # Errors
/// Returns status 4 if interrupted.
pub fn to_visit(
    patches: &[Missed],
    unseen: &Wall,
    numbers: &[u32],
    volume: &PreparedVolume,
    camera: &dyn Camera,
    progress: &Progress,
) -> Result<Vec<usize>> {
    let mut is_shown = vec![false; unseen.len()];
    let mut visited = Vec::new();
    for (n, patch) in patches.iter().enumerate() {
        let Some(from) = patch.look_from else { continue };
        let own = patch.triangles.iter().filter_map(|t| numbers.binary_search(t).ok());
        let shown_mm2: f64 = own.filter(|&t| is_shown[t]).map(|t| unseen.mm2_at(t)).sum();
        if shown_mm2 > SHOWN * patch.area_mm2 {
            continue;
        }
        let view = (from.position, Attitude::new(from.forward, from.up));
        let sights = unseen.seen(volume, &[view], camera, false, progress)?;
        sights.iter().zip(&mut is_shown).for_each(|(s, shown)| *shown |= s.ahead > 0);
        visited.push(n);
    }
    Ok(visited)
}

/// Returns where some places on or near a wall (world mm) are seen from by a camera of `radius_mm` that fits there; `None` for a place
/// too far from the wall, or too narrow.
///
/// # Errors
/// Returns status 4 if interrupted.
pub fn look_at<'a>(
    wall: &Wall,
    places: &[DVec3],
    scans: impl Into<Scans<'a>>,
    radius_mm: f64,
    progress: &Progress,
) -> Result<Vec<Option<LookFrom>>> {
    let walls = Finders::new(scans.into(), radius_mm);
    let look = |&place: &DVec3| {
        progress.check()?;
        let about = |n: &u32| wall.centroid(*n as usize).distance_squared(place) <= ABOUT_MM * ABOUT_MM;
        let triangles: Vec<u32> = (0..wall.len() as u32).filter(about).collect();
        let mm2 = |n: u32| wall.mm2_at(n as usize);
        let normal = triangles.iter().map(|&n| wall.normal(n as usize) * mm2(n)).sum::<DVec3>().normalize_or_zero();
        Ok(if triangles.is_empty() { None } else { look_from(wall, &triangles, place, normal, &walls, radius_mm) })
    };
    places.par_iter().map(look).collect()
}

/// What decides whether the camera fits and what it sees.
struct Finders {
    shown: ClearanceFinder,
    /// `None` if that is the same.
    flown: Option<ClearanceFinder>,
}

impl Finders {
    fn new(scans: Scans<'_>, radius_mm: f64) -> Self {
        let finder = |volume: &PreparedVolume| {
            ClearanceFinder::new(volume.shared_voxels(), volume.transfer().iso() as f32, radius_mm + 2.0 * FREE_MM)
        };
        let is_other = !std::ptr::eq(scans.shown.voxels(), scans.flown.voxels());
        Self { shown: finder(scans.shown), flown: is_other.then(|| finder(scans.flown)) }
    }

    /// True if a body fits at a place (world, mm), in what is flown and in what is shown.
    fn fits(&self, at: DVec3, mm: f64) -> bool {
        let is_free = |walls: &ClearanceFinder| walls.clearance(at).mm >= mm;
        is_free(&self.shown) && self.flown.as_ref().is_none_or(is_free)
    }
}

/// Returns the connected patches of triangles that were not seen, each in ascending order.
fn patches(wall: &Wall, is_seen: impl Fn(usize) -> bool) -> Vec<Vec<u32>> {
    let unseen: Vec<u32> = (0..wall.len() as u32).filter(|&n| !is_seen(n as usize)).collect();
    let mut sets = Sets::new(unseen.len());
    let mut sides: Vec<([u32; 2], u32)> = (0u32..)
        .zip(&unseen)
        .flat_map(|(n, &t)| {
            let [a, b, c] = wall.triangles[t as usize];
            [[a, b], [b, c], [c, a]].map(|[p, q]| ([p.min(q), p.max(q)], n))
        })
        .collect();
    let vertices = |[p, q]: [u32; 2]| u64::from(p) << 32 | u64::from(q);
    sides.par_sort_unstable_by_key(|side| vertices(side.0));
    for w in sides.windows(2).filter(|w| w[0].0 == w[1].0) {
        sets.join(w[0].1, w[1].1);
    }
    let (set, count) = sets.numbered();
    let mut patches = vec![Vec::new(); count];
    for (set, &t) in set.iter().zip(&unseen) {
        patches[*set as usize].push(t);
    }
    patches
}

/// Returns the place from which most of a patch is seen in a picture of 90° that is directed at its middle, among places around it
/// where the camera fits.
fn look_from(
    wall: &Wall,
    triangles: &[u32],
    position: DVec3,
    normal: DVec3,
    walls: &Finders,
    radius_mm: f64,
) -> Option<LookFrom> {
    let every = triangles.len().div_ceil(TRIED);
    let some: Vec<Tried> = triangles
        .iter()
        .step_by(every)
        .map(|&n| (wall.face(n as usize), wall.mm2_at(n as usize)))
        .map(|(face, mm2)| Tried { at: wall.origin + face.centroid.as_dvec3(), normal: face.normal.as_dvec3(), mm2 })
        .collect();
    let flattest = FLATTEST_DEGREES.to_radians().cos();
    // The most that can be seen from each place: what is in the picture from there, with nothing in the way.
    let in_picture = |from: DVec3| {
        let view = Attitude::new(position - from, DVec3::Z);
        let is_in = move |tried: &&Tried| {
            let to = tried.at - from;
            let d = to.length();
            let [right, up, ahead] = [view.right(), view.up, view.forward].map(|axis| to.dot(axis));
            right.abs() <= ahead && up.abs() <= ahead && d <= REACH_MM && -to.dot(tried.normal) > flattest * d
        };
        some.iter().filter(is_in)
    };
    let normal = normal.try_normalize().unwrap_or(DVec3::Z);
    let directions: Vec<DVec3> = half_directions(WAYS, normal).collect();
    let around = AWAY_MM.iter().flat_map(|&away| directions.iter().map(move |&way| position + way * away));
    let most = |from| in_picture(from).map(|tried| tried.mm2).sum::<f64>();
    let mut places: Vec<(f64, usize, DVec3)> = around.enumerate().map(|(n, from)| (most(from), n, from)).collect();
    // The most promising first: most of the others cannot be better.
    places.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut best: Option<(f64, usize, DVec3)> = None;
    for (most, n, from) in places {
        // The nearer of two equal places.
        let is_better = |mm2: f64| mm2 > 0.0 && best.is_none_or(|b| mm2 > b.0 || (mm2 == b.0 && n < b.1));
        if best.is_some_and(|b| most < b.0) {
            break;
        }
        if !is_better(most) || !walls.fits(from, radius_mm + FREE_MM) {
            continue;
        }
        let is_free = |tried: &&Tried| {
            let to = tried.at - from;
            // Ended a little before the wall, whose voxels would count.
            !walls.shown.enters(from, tried.at - to * (0.6 / to.length().max(0.7)))
        };
        let mm2 = in_picture(from).filter(is_free).map(|tried| tried.mm2).sum();
        if is_better(mm2) {
            best = Some((mm2, n, from));
        }
    }
    let (_, _, from) = best?;
    let attitude = Attitude::new(position - from, DVec3::Z);
    Some(LookFrom { position: from, forward: attitude.forward, up: attitude.up })
}

/// A triangle that places to look from are tried for.
struct Tried {
    /// Its centroid, world mm.
    at: DVec3,
    normal: DVec3,
    mm2: f64,
}
