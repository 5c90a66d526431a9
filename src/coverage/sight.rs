//! Which triangles of the wall are seen from the views of a flight.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::wall::Wall;
use crate::dynamics::Attitude;
use crate::render::camera::Camera;
use crate::space::{PreparedVolume, first_crossing, value};

/// The largest distance at which a place of the wall counts as seen, mm.
pub const REACH_MM: f64 = 100.0;
/// The flattest angle at which a place of the wall counts as seen, degrees from its normal.
pub const FLATTEST_DEGREES: f64 = 85.0;
/// The line to a place ends this many voxels before it.
const BEFORE: f64 = 0.5;
/// A line that is blocked is remembered this many voxels behind where it meets the wall.
const INTO_WALL: f64 = 0.7;
/// Triangles that are looked at together: the views near them are gathered once.
const CHUNK: usize = 512;

/// The share of a wall's area that was seen, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Coverage {
    /// Seen in the direction of flight.
    pub one_way: f64,
    /// Seen from the same positions in either direction, as if the path had been flown back too.
    pub both_ways: f64,
}

/// What is seen of each triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sight {
    /// Number of views that see it, as flown; at most 1 unless all were counted.
    pub ahead: u16,
    /// True if it is seen by the same views looking ahead or back.
    pub either: bool,
}

/// A view that may see a triangle.
#[derive(Clone, Copy)]
struct Candidate {
    squared: f32,
    view: u32,
    /// Its place among the views near the chunk.
    eye: u32,
    is_ahead: bool,
}

impl Wall {
    /// Returns what is seen of each triangle from `views` (world position, mm, and attitude) in the square image of `camera`, all of
    /// whose rays start at its position. With `count`, all views that see a triangle are counted, which takes longer; without, the
    /// first one is enough.
    pub fn seen<C: Camera + ?Sized>(
        &self,
        volume: &PreparedVolume,
        views: &[(DVec3, Attitude)],
        camera: &C,
        count: bool,
    ) -> Vec<Sight> {
        let flattest = FLATTEST_DEGREES.to_radians().cos() as f32;
        let eyes: Vec<Eye> = views.iter().enumerate().filter_map(|(n, v)| Eye::new(n as u32, v, self.origin)).collect();
        let before = BEFORE * volume.voxels().grid().spacing().min_element();
        let (iso, voxel) = (volume.transfer().iso(), volume.voxels().grid().spacing().min_element());
        // `block` is how far from the view the line to the last hidden place was in the wall: there the next line probably is, too, and
        // one value of the volume proves it.
        let is_seen = |view: u32, n: usize, block: &mut f64| {
            let (from, to) = (views[view as usize].0, self.centroid(n));
            let way = to - from;
            let d = way.length() - before;
            if d <= 0.0 {
                return true;
            }
            if *block < d && f64::from(value(volume, from + way * (*block / way.length()))) >= iso {
                return false;
            }
            let crossing = first_crossing(volume, from, way, d);
            if let Some(mm) = crossing {
                *block = mm + INTO_WALL * voxel;
            }
            crossing.is_none()
        };
        let mut sights = vec![Sight::default(); self.len()];
        sights.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, sights)| {
            let first = chunk * CHUNK;
            let here = &self.centroids[first..first + sights.len()];
            let (low, high) =
                here.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(*c), h.max(*c)));
            let reach = REACH_MM as f32;
            let near: Vec<&Eye> =
                eyes.iter().filter(|e| e.at.distance_squared(e.at.clamp(low, high)) <= reach * reach).collect();
            let mut candidates: Vec<Candidate> = Vec::with_capacity(near.len());
            let mut blocks = vec![f64::INFINITY; near.len()];
            // The views that saw the last triangle probably see the next one, too.
            let mut hints = [None; 2];
            for (k, sight) in sights.iter_mut().enumerate() {
                let n = first + k;
                let (centroid, normal) = (here[k], self.normals[n]);
                candidates.clear();
                for (eye, e) in (0u32..).zip(&near) {
                    let to = centroid - e.at;
                    let squared = to.length_squared();
                    let facing = -to.dot(normal);
                    if squared > reach * reach || facing <= 0.0 || facing * facing <= flattest * flattest * squared {
                        continue;
                    }
                    let [right, up, ahead] = [e.right, e.up, e.forward].map(|axis| f64::from(to.dot(axis)));
                    // Looking back, right becomes left.
                    for (is_ahead, place) in
                        [(true, DVec3::new(right, up, ahead)), (false, DVec3::new(-right, up, -ahead))]
                    {
                        if camera.project(place).is_some_and(|at| at.abs().max_element() <= 1.0) {
                            candidates.push(Candidate { squared, view: e.view, eye, is_ahead });
                        }
                    }
                }
                let mut sees = |c: &Candidate| is_seen(c.view, n, &mut blocks[c.eye as usize]);
                if count {
                    let ahead = candidates.iter().filter(|c| c.is_ahead && sees(c)).count();
                    sight.ahead = ahead.min(usize::from(u16::MAX)) as u16;
                } else {
                    sight.ahead = u16::from(find(&mut candidates, true, &mut hints[0], &mut sees));
                }
                sight.either = sight.ahead > 0 || find(&mut candidates, false, &mut hints[1], &mut sees);
            }
        });
        sights
    }

    /// Returns the shares of the area that were seen.
    pub fn coverage(&self, sights: &[Sight]) -> Coverage {
        let all = self.mm2();
        let share = |which: fn(&Sight) -> bool| {
            if all > 0.0 { self.mm2_of(|n| which(&sights[n])) / all } else { 0.0 }
        };
        Coverage { one_way: share(|s| s.ahead > 0), both_ways: share(|s| s.either) }
    }
}

/// True if one of the candidates that look ahead, or back, sees the place: first the hint, then the nearest view, which is the most
/// likely to see it.
fn find(
    candidates: &mut [Candidate],
    ahead: bool,
    hint: &mut Option<u32>,
    sees: &mut impl FnMut(&Candidate) -> bool,
) -> bool {
    if let Some(c) = candidates.iter().find(|c| c.is_ahead == ahead && Some(c.view) == *hint)
        && sees(c)
    {
        return true;
    }
    candidates.sort_unstable_by(|a, b| a.squared.total_cmp(&b.squared).then(a.view.cmp(&b.view)));
    let found = candidates.iter().find(|c| c.is_ahead == ahead && Some(c.view) != *hint && sees(c));
    *hint = found.map(|c| c.view).or(*hint);
    found.is_some()
}

/// A view in single precision, mm from the wall's origin.
struct Eye {
    view: u32,
    at: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
}

impl Eye {
    /// `None` for a view that is nowhere.
    fn new(view: u32, (at, attitude): &(DVec3, Attitude), origin: DVec3) -> Option<Self> {
        let [right, up, forward] = [attitude.right(), attitude.up, attitude.forward].map(|v| v.as_vec3());
        at.is_finite().then(|| Self { view, at: (*at - origin).as_vec3(), right, up, forward })
    }
}
