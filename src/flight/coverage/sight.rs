//! Which triangles of the wall are seen from the views of a flight.

use std::path::Path;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::wall::{Block, Face, Wall};
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::output;
use crate::progress::Progress;
use crate::render::camera::Camera;
use crate::space::{PreparedVolume, first_crossing, value};
use crate::surface::{is_far, write_ply};

/// The largest distance at which a place of the wall counts as seen, mm.
pub const REACH_MM: f64 = 100.0;
/// The same in single precision.
pub(super) const REACH: f32 = REACH_MM as f32;
/// The flattest angle at which a place of the wall counts as seen, degrees from its normal.
pub const FLATTEST_DEGREES: f64 = 85.0;
/// The line to a place ends this many voxels before it.
const BEFORE: f64 = 0.5;
/// A line that is blocked is remembered this many voxels behind where it meets the wall.
const INTO_WALL: f64 = 0.7;
/// A patch that is hidden from this many of the nearest views is tested from every n-th of the others only.
const NEAREST: usize = 12;
const SOME: usize = 3;
/// Triangles of a patch that are tried from a view before it is taken as hidden from there.
const PROBES: usize = 3;

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

impl Wall {
    /// Returns what is seen of each triangle from `views` (world position, mm, and attitude) in the square image of `camera`, all of
    /// whose rays start at its position.
    ///
    /// With `count`, all views that see a triangle are counted. Without, one is enough, and triangles that are most likely hidden
    /// are not tested: the other triangles of a patch of which three are hidden from a view (different ones each time), and two of
    /// three views once a patch was hidden from the twelve nearest. In a colon this misses 0.3 % of the area and takes a thirtieth
    /// of the time.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn seen<C: Camera + ?Sized>(
        &self,
        volume: &PreparedVolume,
        views: &[(DVec3, Attitude)],
        camera: &C,
        count: bool,
        progress: &Progress,
    ) -> Result<Vec<Sight>> {
        let eyes: Vec<Eye> = views.iter().filter_map(|v| Eye::new(v, self.origin)).collect();
        let sight = Sightline::new(self, volume, camera);
        let mut sights = vec![Sight::default(); self.len()];
        let mut rest = &mut sights[..];
        let mut blocks = Vec::with_capacity(self.block_count());
        for block in 0..self.block_count() {
            let patches = self.patches_of(block);
            let end = self.patches[patches.end].first as usize;
            let (here, after) = rest.split_at_mut(end - self.patches[patches.start].first as usize);
            blocks.push((block, here));
            rest = after;
        }
        blocks.into_par_iter().try_for_each_init(
            <(Vec<Face>, Vec<u64>)>::default,
            |(faces, order), (block, sights)| {
                progress.check()?;
                let Block { low, high, .. } = self.blocks[block];
                let middle = low.midpoint(high);
                let is_near = |e: &Eye| e.at.distance_squared(e.at.clamp(low, high)) <= REACH * REACH;
                // The nearest is the most likely to see it. Of two at the same distance, the first: it must not depend on the threads. The bits
                // of distances, which are never negative, have the same order as the distances.
                let key = |(n, e): (usize, &Eye)| u64::from(e.at.distance_squared(middle).to_bits()) << 32 | n as u64;
                order.clear();
                order.extend(eyes.iter().enumerate().filter(|(_, e)| is_near(e)).map(key));
                order.sort_unstable();
                let (mut near, mut inside): (Vec<&Eye>, Vec<[bool; 2]>) = Default::default();
                for key in &*order {
                    let eye = &eyes[*key as u32 as usize];
                    let sides = sight.may_see_block(block, eye);
                    if count || sides[0] || sides[1] {
                        near.push(eye);
                        inside.push(sides);
                    }
                }
                if near.is_empty() {
                    return Ok(());
                }
                let mut blocked = vec![f64::INFINITY; near.len()];
                let first = self.patches[self.blocks[block].first as usize].first as usize;
                // Each is tested from many views.
                faces.clear();
                faces.extend((first..first + sights.len()).map(|n| self.face(n)));
                // The view that saw the last patch probably sees the next one, too.
                let mut hints = [0; 2];
                let mut left = Vec::new();
                for patch in self.patches_of(block) {
                    let these = self.triangles_of(patch);
                    if count {
                        for n in these.clone() {
                            let sees = |(e, b): (&&Eye, &mut f64)| sight.is_seen(&faces[n - first], e, true, b);
                            let all = near.iter().zip(&mut blocked).map(sees).filter(|seen| *seen).count();
                            sights[n - first].ahead = all.min(usize::from(u16::MAX)) as u16;
                        }
                    }
                    for (ahead, hint) in [true, false].into_iter().zip(&mut hints) {
                        left.clear();
                        left.extend(these.clone().filter(|n| sights[n - first].ahead == 0));
                        if ahead && count {
                            continue;
                        }
                        let whole = left.len();
                        let (mut turn, mut tried) = (0, 0);
                        // The hint first, and not again.
                        let start = *hint;
                        let others = (0..near.len()).filter(|e| *e != start);
                        let first_hint = (start < near.len()).then_some(start).into_iter();
                        for e in first_hint.chain(others).filter(|e| inside[*e][usize::from(!ahead)]) {
                            if left.is_empty() {
                                break;
                            }
                            tried += 1;
                            // What is hidden from the nearest views is in all likelihood hidden from most of the others.
                            if left.len() == whole && tried > NEAREST && tried % SOME != 0 {
                                continue;
                            }
                            let (eye, blocked) = (near[e], &mut blocked[e]);
                            let mut sees = |n: usize| sight.is_seen(&faces[n - first], eye, ahead, blocked);
                            let every = left.len().div_ceil(PROBES);
                            turn = if turn + 1 < every { turn + 1 } else { 0 };
                            if left.len() < whole || (turn..left.len()).step_by(every).any(|n| sees(left[n])) {
                                *hint = e;
                                left.retain(|&n| {
                                    let seen = sees(n);
                                    let sight = &mut sights[n - first];
                                    sight.ahead |= u16::from(seen && ahead);
                                    sight.either |= seen;
                                    !seen
                                });
                            }
                        }
                    }
                    these.for_each(|n| sights[n - first].either |= sights[n - first].ahead > 0);
                }
                Ok(())
            },
        )?;
        Ok(sights)
    }

    /// Returns the shares of the area that were seen.
    pub fn coverage(&self, sights: &[Sight]) -> Coverage {
        let [mut all, mut ahead, mut either] = [0.0; 3];
        self.each_mm2(|n, mm2| {
            all += mm2;
            ahead += if sights[n].ahead > 0 { mm2 } else { 0.0 };
            either += if sights[n].either { mm2 } else { 0.0 };
        });
        let share = |seen: f64| if all > 0.0 { seen / all } else { 0.0 };
        Coverage { one_way: share(ahead), both_ways: share(either) }
    }

    /// Writes the wall as PLY, with the number of views that see it (`seen`) on each face. Nothing is written in part.
    ///
    /// # Errors
    /// Returns status 5 if the file cannot be written, status 4 if interrupted.
    pub fn save(&self, path: &Path, sights: &[Sight], progress: &Progress) -> Result<()> {
        let about = "the wall that was flown along, mm LPS; seen: number of places from which a face was seen";
        let far = is_far(self.origin, &self.places);
        let (mesh, seen) = ((self.origin, &self.places[..], &self.triangles[..]), |n: usize| sights[n].ahead);
        output::write_whole(path, |w| write_ply(w, mesh, about, far, Some(("seen", &seen)), progress))
    }
}

/// Decides whether a triangle is seen from a view.
pub(super) struct Sightline<'a, C: Camera + ?Sized> {
    wall: &'a Wall,
    volume: &'a PreparedVolume,
    camera: &'a C,
    iso: f64,
    /// Least distance between two voxels, mm.
    voxel: f64,
    /// The cosine of the flattest angle.
    flattest: f32,
    /// The tangent of half the view angle of a perspective camera.
    tangent: Option<f32>,
    /// Half the picture's width, in halves of its height: pictures are square unless the camera's are not.
    wide: f64,
}

impl<'a, C: Camera + ?Sized> Sightline<'a, C> {
    pub(super) fn new(wall: &'a Wall, volume: &'a PreparedVolume, camera: &'a C) -> Self {
        let voxel = volume.voxels().grid().spacing().min_element();
        let flattest = FLATTEST_DEGREES.to_radians().cos() as f32;
        let (tangent, wide) = (camera.tangent().map(|t| t as f32), camera.aspect().unwrap_or(1.0));
        Self { wide, wall, volume, camera, iso: volume.transfer().iso(), voxel, flattest, tangent }
    }

    /// Returns the square of the distance of a view to the box of a block, mm².
    pub(super) fn square_to_block(&self, block: usize, eye: &Eye) -> f32 {
        let Block { low, high, .. } = self.wall.blocks[block];
        eye.at.distance_squared(eye.at.clamp(low, high))
    }

    /// Returns whether a triangle of a block can be seen from a view, apart from its distance, looking ahead and looking back.
    #[inline]
    pub(super) fn may_see_block(&self, block: usize, eye: &Eye) -> [bool; 2] {
        let Block { low, high, .. } = self.wall.blocks[block];
        let (middle, radius) = (low.midpoint(high) - eye.at, 0.5 * low.distance(high));
        let Some(t) = self.tangent else { return [true; 2] };
        let far = radius * (1.0 + t * t).sqrt();
        let [right, up] = [eye.right, eye.up].map(|axis| axis.dot(middle).abs());
        let forward = t * eye.forward.dot(middle);
        [right - forward <= far && up - forward <= far, right + forward <= far && up + forward <= far]
    }

    /// True if a triangle is within reach, faces the view and is inside the picture, looking ahead or back.
    pub(super) fn is_in_picture(&self, centroid: Vec3, normal: Vec3, eye: &Eye, ahead: bool) -> bool {
        let to = centroid - eye.at;
        let squared = to.length_squared();
        let facing = -to.dot(normal);
        if squared > REACH * REACH || facing <= 0.0 || facing * facing <= self.flattest * self.flattest * squared {
            return false;
        }
        let [right, up, forward] = [eye.right, eye.up, eye.forward].map(|axis| to.dot(axis));
        if let Some(t) = self.tangent {
            let most = t * if ahead { forward } else { -forward };
            return right.abs() <= most && up.abs() <= most;
        }
        let [right, up, forward] = [right, up, forward].map(f64::from);
        // Looking back, right becomes left.
        let place = if ahead { DVec3::new(right, up, forward) } else { DVec3::new(-right, up, -forward) };
        self.camera.project(place).is_some_and(|at| at.x.abs() <= self.wide && at.y.abs() <= 1.0)
    }

    /// True if the line to a triangle with this centroid (mm from the wall's origin) crosses no wall. `blocked` is how far from the view the line to the last hidden place was in
    /// the wall: there the next line probably is, too, and one value of the volume proves it.
    pub(super) fn is_free(&self, centroid: Vec3, eye: &Eye, blocked: &mut f64) -> bool {
        let (from, to) = (eye.world, self.wall.origin + centroid.as_dvec3());
        let way = to - from;
        let length = way.length();
        let d = length - BEFORE * self.voxel;
        if d <= 0.0 {
            return true;
        }
        if *blocked < d && f64::from(value(self.volume, from + way * (*blocked / length))) >= self.iso {
            return false;
        }
        let crossing = first_crossing(self.volume, from, way, d);
        if let Some(mm) = crossing {
            *blocked = mm + INTO_WALL * self.voxel;
        }
        crossing.is_none()
    }

    fn is_seen(&self, face: &Face, eye: &Eye, ahead: bool, blocked: &mut f64) -> bool {
        self.is_in_picture(face.centroid, face.normal, eye, ahead) && self.is_free(face.centroid, eye, blocked)
    }
}

/// A view, also in single precision, mm from the wall's origin.
#[derive(Clone, Debug)]
pub(super) struct Eye {
    /// World, mm.
    pub world: DVec3,
    pub at: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
}

impl Eye {
    /// `None` for a view with a position that is not finite.
    pub(super) fn new((world, attitude): &(DVec3, Attitude), origin: DVec3) -> Option<Self> {
        let [right, up, forward] = [attitude.right(), attitude.up, attitude.forward].map(|v| v.as_vec3());
        world.is_finite().then(|| Self { world: *world, at: (*world - origin).as_vec3(), right, up, forward })
    }
}
