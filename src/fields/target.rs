//! D_t, the distance to a target along the lumen: what the paper's potential pulls by. Built only when a scene asks.
//!
//! It solves |∇T| = 1 within the lumen from the target on, by fast marching (Sethian 1996) with first-order upwind
//! differences: over the axes whose upwind neighbours are lowest, Σ ((T − T_a)/h_a)² = 1. The front is kept in buckets
//! narrower than a voxel (an untidy queue, Yatziv et al. 2006), so that time and memory are linear in the lumen's voxels;
//! the order within a bucket is that of arrival. Every voxel's value comes from lower neighbours, so there is no local
//! minimum but the target. Voxels are neighbours across faces only: there is no way through where walls touch corner to
//! corner. Within the ball inscribed at the target distances are exact.
//!
//! **A way on which the body fits.** The front passes only where the wall is at least a body's clearance away (and
//! anywhere within 5 mm of both ends). Every other voxel of the lumen takes the distance of the nearest one that was
//! passed, and more by how far that is: from every slit, also one whose far side is nearer to the target, the field leads
//! back to where the body fits. Where the two ends are not joined so, half the clearance is asked for, and then none.
//!
//! Between voxels it is the cubic B-spline over those voxels of the lumen that the way leads past: a voxel whose distance
//! differs by more than the ways within the spline's reach can explain lies behind a wall, and does not count; nor does
//! what is outside. Near walls the weights of the rest are scaled to a sum of 1.

use std::sync::Arc;

use glam::DVec3;

use super::distance::{WallDistance, spline};
use super::{Distance, Sample};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// A point outside the lumen is moved into it within this, mm.
const SNAP_MM: f64 = 5.0;
/// Buckets in the least spacing.
const FINENESS: f64 = 4.0;
/// How fast the distance grows from where the body fits into where it does not, mm/mm.
const RISE: f32 = 1.5;
/// How much longer than straight the way between two voxels of the spline's reach may be.
const DETOUR: f64 = 2.5;

/// The distance to a target along the lumen, mm.
#[derive(Clone, Debug)]
pub struct TargetDistance {
    walls: Arc<WallDistance>,
    /// In the order of the walls' set; infinite outside the lumen and where the target cannot be reached from.
    values: Vec<f32>,
    target: DVec3,
    guessed: Vec<[DVec3; 2]>,
    clearance: f64,
}

/// For whom a way is sought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Traveller {
    /// Where it begins, world mm.
    pub from: DVec3,
    /// The clearance that it needs, mm.
    pub clearance_mm: f64,
}

/// A voxel on the front.
type Front = (u32, [i32; 3]);

impl TargetDistance {
    /// The distance to `target` (world, mm; moved into the lumen within 5 mm), for a traveller if one is named.
    /// `guesses` are pairs of places (world, mm) between which the lumen may be collapsed: where only one of the two can
    /// be reached, the straight line between them is taken as the way on, and listed in [`TargetDistance::guessed`].
    ///
    /// # Errors
    /// Status 4 when the target is not in the lumen, or when interrupted.
    pub fn to(
        walls: &Arc<WallDistance>,
        target: DVec3,
        traveller: Option<Traveller>,
        guesses: &[[DVec3; 2]],
        progress: &Progress,
    ) -> Result<Self> {
        let Some(voxel) = walls.nearest(target, SNAP_MM) else {
            let why = format!("{:.1},{:.1},{:.1} is not in the lumen", target.x, target.y, target.z);
            return Err(Error::incomplete("target", why, "give a point in the colon's gas or fluid"));
        };
        let target = if walls.is_inside(walls.voxel(target)) { target } else { walls.world(voxel) };
        progress.stage("measuring the distance to the target", walls.voxels() as u64);
        let asked = traveller.map_or(0.0, |t| t.clearance_mm.max(0.0));
        let mut open = vec![target];
        open.extend(traveller.map(|t| t.from));
        for clearance in [asked, 0.5 * asked, 0.0] {
            let mut march = March::new(walls, clearance, &open);
            march.ball(voxel, target);
            march.run(progress)?;
            let guessed = march.bridge(guesses, progress)?;
            if clearance > 0.0 {
                if traveller.is_some_and(|t| !march.reaches(t.from)) {
                    continue;
                }
                march.extend(progress)?;
            }
            return Ok(Self { walls: Arc::clone(walls), values: march.values, target, guessed, clearance });
        }
        unreachable!("the last clearance is none")
    }

    /// The target, world, mm.
    pub fn target(&self) -> DVec3 {
        self.target
    }

    /// The clearance that the way keeps between its ends, mm; 0 when there is no such way.
    pub fn clearance_mm(&self) -> f64 {
        self.clearance
    }

    /// The stretches that were bridged as a guess, each from the side of the target on, world, mm.
    pub fn guessed(&self) -> &[[DVec3; 2]] {
        &self.guessed
    }

    /// The distance at a voxel's centre, mm; none outside the lumen and where there is no way.
    #[inline]
    pub fn at(&self, voxel: [i64; 3]) -> Option<f32> {
        self.walls.set().number(voxel).map(|n| self.values[n]).filter(|d| d.is_finite())
    }

    /// Size in memory, without the wall distance that it shares.
    pub fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }
}

impl Distance for TargetDistance {
    fn sample(&self, at: DVec3) -> Option<Sample> {
        let grid = self.walls.grid();
        let here = self.at(self.walls.voxel(at))?;
        let centre = self.walls.voxel(at);
        let spacing = grid.spacing();
        // Relative to the nearest voxel's, so that large distances lose no digits.
        let near = |v: [i64; 3]| {
            let apart: f64 = (0..3).map(|a| (v[a] - centre[a]).abs() as f64 * spacing[a]).sum();
            self.at(v).map(|d| d - here).filter(|d| f64::from(d.abs()) <= DETOUR * apart)
        };
        let s = spline::sample_some(grid, at, near)?;
        Some(Sample { mm: s.mm + f64::from(here), ..s })
    }
}

/// The marching front.
struct March<'a> {
    walls: &'a WallDistance,
    values: Vec<f32>,
    done: Vec<bool>,
    /// Voxels by their value; the lowest that is not empty is next.
    buckets: Vec<Vec<Front>>,
    next: usize,
    per_mm: f64,
    spacing: [f32; 3],
    /// Only where the wall is so far away, mm, or near one of these places.
    clearance: f32,
    open: &'a [DVec3],
    /// What each voxel takes from the neighbour that the front came from.
    track: Option<Vec<f32>>,
}

impl<'a> March<'a> {
    fn new(walls: &'a WallDistance, clearance: f64, open: &'a [DVec3]) -> Self {
        let count = walls.set().len();
        Self {
            walls,
            values: vec![f32::INFINITY; count],
            done: vec![false; count],
            buckets: Vec::new(),
            next: 0,
            per_mm: FINENESS / walls.grid().min_spacing(),
            spacing: walls.grid().spacing().to_array().map(|s| s as f32),
            clearance: clearance as f32,
            open,
            track: None,
        }
    }

    /// Whether the front may come to a voxel.
    fn passes(&self, n: usize, voxel: [i64; 3]) -> bool {
        let d = self.walls.values()[n];
        d >= self.clearance
            || d >= 0.0 && self.open.iter().any(|&o| self.walls.world(voxel).distance_squared(o) <= SNAP_MM * SNAP_MM)
    }

    /// Goes on across what is collapsed, where a guess leads from what is reached to what is not. Which were used, each
    /// from the side of the target on.
    fn bridge(&mut self, guesses: &[[DVec3; 2]], progress: &Progress) -> Result<Vec<[DVec3; 2]>> {
        let mut guessed = Vec::new();
        let mut left: Vec<[DVec3; 2]> = guesses.to_vec();
        // Each pass over what is left uses one guess, so it ends.
        while let Some(at) = left.iter().position(|g| self.reaches(g[0]) != self.reaches(g[1])) {
            let [a, b] = left.remove(at);
            let (from, to) = if self.reaches(a) { (a, b) } else { (b, a) };
            let Some(start) = self.walls.nearest(to, SNAP_MM) else { continue };
            let already = self.value(from) + from.distance(to) as f32;
            self.seed(start, already);
            self.run(progress)?;
            guessed.push([from, to]);
        }
        Ok(guessed)
    }

    /// Gives every voxel of the lumen that the front did not come to the value of the nearest one that it did, and
    /// [`RISE`] times the way there.
    fn extend(&mut self, progress: &Progress) -> Result<()> {
        let mut away = March::new(self.walls, 0.0, &[]);
        self.walls.set().for_each(|n, voxel| {
            if self.done[n] {
                away.offer(n, voxel.map(|x| x as i64), 0.0);
            }
        });
        away.track = Some(std::mem::take(&mut self.values));
        away.run(progress)?;
        let mut values = away.track.take().unwrap_or_default();
        for (value, &far) in values.iter_mut().zip(&away.values) {
            *value += RISE * far;
        }
        self.values = values;
        Ok(())
    }

    /// Starts with the ball inscribed at `target`, which lies in `voxel`.
    fn ball(&mut self, voxel: [i64; 3], target: DVec3) {
        self.seed(voxel, self.walls.world(voxel).distance(target) as f32);
        let radius = f64::from(self.walls.at(voxel).unwrap_or(0.0)) - self.walls.grid().spacing().length();
        let reach = self.walls.grid().spacing().to_array().map(|s| (radius / s).floor() as i64);
        for dk in -reach[2]..=reach[2] {
            for dj in -reach[1]..=reach[1] {
                for di in -reach[0]..=reach[0] {
                    let v = [voxel[0] + di, voxel[1] + dj, voxel[2] + dk];
                    let far = self.walls.world(v).distance(self.walls.world(voxel));
                    if far < radius && self.walls.is_inside(v) {
                        self.seed(v, self.walls.world(v).distance(target) as f32);
                    }
                }
            }
        }
    }

    fn seed(&mut self, voxel: [i64; 3], value: f32) {
        if let Some(n) = self.walls.set().number(voxel) {
            self.offer(n, voxel, value);
        }
    }

    fn offer(&mut self, n: usize, voxel: [i64; 3], value: f32) {
        if value < self.values[n] && !self.done[n] {
            self.values[n] = value;
            // A guess may start again below the bucket that came last.
            let bucket = (f64::from(value) * self.per_mm) as usize;
            if bucket >= self.buckets.len() {
                self.buckets.resize_with(bucket + 1, Vec::new);
            }
            self.buckets[bucket].push((n as u32, voxel.map(|x| x as i32)));
            self.next = self.next.min(bucket);
        }
    }

    fn run(&mut self, progress: &Progress) -> Result<()> {
        let mut steps = 0u64;
        while self.next < self.buckets.len() {
            // What arrives in this bucket meanwhile is taken in the next round.
            let front = std::mem::take(&mut self.buckets[self.next]);
            if front.is_empty() {
                self.next += 1;
                continue;
            }
            for (n, voxel) in front {
                if !std::mem::replace(&mut self.done[n as usize], true) {
                    steps += 1;
                    self.take(n as usize, voxel.map(i64::from));
                    self.spread(voxel.map(i64::from));
                }
            }
            if steps >= 1 << 16 {
                progress.advance(std::mem::take(&mut steps))?;
            }
        }
        progress.advance(steps)
    }

    /// Takes what is tracked from the neighbour that is nearest to where the front began.
    fn take(&mut self, n: usize, at: [i64; 3]) {
        let Some(mut track) = self.track.take() else { return };
        let mut nearest = (self.values[n], n);
        for side in 0..6 {
            let mut from = at;
            from[side / 2] += if side % 2 == 0 { 1 } else { -1 };
            if let Some(m) = self.walls.set().number(from).filter(|&m| self.done[m] && self.values[m] < nearest.0) {
                nearest = (self.values[m], m);
            }
        }
        track[n] = track[nearest.1];
        self.track = Some(track);
    }

    fn spread(&mut self, at: [i64; 3]) {
        for a in 0..3 {
            for way in [-1, 1] {
                let mut to = at;
                to[a] += way;
                if let Some(n) = self.walls.set().number(to).filter(|&n| !self.done[n] && self.passes(n, to)) {
                    let value = self.upwind(to);
                    self.offer(n, to, value);
                }
            }
        }
    }

    /// The value that the neighbours whose own is final give a voxel.
    fn upwind(&self, at: [i64; 3]) -> f32 {
        let mut lowest = [(f32::INFINITY, 1.0f32); 3];
        for a in 0..3 {
            lowest[a].1 = self.spacing[a];
            for way in [-1, 1] {
                let mut from = at;
                from[a] += way;
                if let Some(n) = self.walls.set().number(from).filter(|&n| self.done[n]) {
                    lowest[a].0 = lowest[a].0.min(self.values[n]);
                }
            }
        }
        lowest.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Values relative to the lowest: large distances lose no digits.
        let base = lowest[0].0;
        let mut value = lowest[0].1;
        let (mut a, mut b, mut c) = (0.0, 0.0, -1.0);
        for (n, &(t, h)) in lowest.iter().enumerate() {
            let (t, w) = (t - base, 1.0 / (h * h));
            if n > 0 && t >= value {
                break;
            }
            a += w;
            b += w * t;
            c += w * t * t;
            value = (b + (b * b - a * c).max(0.0).sqrt()) / a;
        }
        base + value
    }

    fn value(&self, world: DVec3) -> f32 {
        let voxel = self.walls.nearest(world, SNAP_MM);
        voxel.and_then(|v| self.walls.set().number(v)).map_or(f32::INFINITY, |n| self.values[n])
    }

    fn reaches(&self, world: DVec3) -> bool {
        self.value(world).is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::{Grid, Volume};
    use glam::DMat3;

    /// A mask of what `is_in` accepts (world, mm).
    fn walls(dims: [usize; 3], spacing: DVec3, is_in: impl Fn(DVec3) -> bool) -> Arc<WallDistance> {
        let grid = Grid::new(dims, spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..grid.len())
            .map(|n| {
                let u =
                    DVec3::new((n % dims[0]) as f64, (n / dims[0] % dims[1]) as f64, (n / dims[0] / dims[1]) as f64);
                i16::from(is_in(grid.world(u)))
            })
            .collect();
        Arc::new(WallDistance::of_mask(&Volume::new(grid, data), &Progress::new()).unwrap())
    }

    /// A tube of radius 5 mm bent to three quarters of a circle of radius 15 mm: its ends come near each other.
    fn bend(p: DVec3) -> bool {
        let q = p - DVec3::new(24.0, 24.0, 8.0);
        let ring = (q.x.hypot(q.y) - 15.0).hypot(q.z);
        ring < 5.0 && !(q.x > 0.0 && q.y > -1.0 && q.y < 3.0)
    }

    fn to(walls: &Arc<WallDistance>, target: DVec3) -> TargetDistance {
        TargetDistance::to(walls, target, None, &[], &Progress::new()).unwrap()
    }

    #[test]
    fn follows_the_lumen_and_has_no_minimum_but_the_target() {
        for spacing in [DVec3::ONE, DVec3::new(0.6, 0.8, 1.5)] {
            let dims = [48.0, 48.0, 17.0];
            let w = walls([0, 1, 2].map(|a| (dims[a] / spacing[a]).ceil() as usize), spacing, bend);
            let target = DVec3::new(39.0, 28.0, 8.0);
            let d = to(&w, target);
            let mut lower = 0;
            w.set().for_each(|n, [i, j, k]| {
                let v = [i as i64, j as i64, k as i64];
                if w.values()[n] < 0.0 {
                    assert_eq!(d.at(v), None);
                    return;
                }
                let here = d.at(v).expect("all of the bend is one piece");
                let neighbours = (0..6).map(|s| {
                    let mut u = v;
                    u[s / 2] += if s % 2 == 0 { 1 } else { -1 };
                    d.at(u)
                });
                if !neighbours.flatten().any(|o| o < here) {
                    lower += 1;
                    assert_eq!(v, w.voxel(target), "a local minimum");
                }
                assert!(f64::from(here) >= w.world(v).distance(target) - 1e-4);
            });
            assert_eq!(lower, 1);
            // The taut way about the ring's inner side (10 mm) is 64.5 mm long; fast marching of first order about a wall
            // of steps finds it longer, never shorter.
            let far = d.sample(DVec3::new(39.0, 22.0, 8.0)).unwrap().mm;
            assert!((64.0..77.0).contains(&far), "{far}");
        }
    }

    #[test]
    fn the_gradient_leads_to_the_target() {
        let w = walls([48, 48, 17], DVec3::ONE, bend);
        let target = DVec3::new(39.0, 28.0, 8.0);
        let d = to(&w, target);
        for start in [DVec3::new(39.0, 22.0, 8.0), DVec3::new(9.0, 24.0, 10.0), DVec3::new(24.0, 5.0, 7.0)] {
            let mut at = start;
            let mut last = f64::INFINITY;
            for _ in 0..2000 {
                let s = d.sample(at).expect("the way stays in the lumen");
                assert!(s.mm < last + 1e-3, "at {at}: {} after {last}", s.mm);
                assert!(s.hessian.to_cols_array().iter().all(|h| h.is_finite()));
                last = s.mm;
                if at.distance(target) < 2.0 {
                    break;
                }
                assert!((0.5..1.5).contains(&s.gradient.length()), "{at}: {}", s.gradient.length());
                at -= s.gradient.normalize() * 0.1;
            }
            assert!(at.distance(target) < 2.0, "from {start} to {at}");
        }
    }

    /// Two channels that touch along an edge, and one voxel of wall: neither leaks, in voxels or between them.
    #[test]
    fn no_way_through_a_touching_wall() {
        let w = walls([40, 9, 5], DVec3::ONE, |p| {
            (1.0..=7.0).contains(&p.y) && p.y != 4.0 && (1.0..=38.0).contains(&p.x)
                || (p.y == 4.0 && p.x >= 37.0 && p.x < 39.0)
        });
        let d = to(&w, DVec3::new(2.0, 2.0, 2.0));
        let (near, far) = (d.sample(DVec3::new(2.0, 3.2, 2.0)).unwrap(), d.sample(DVec3::new(2.0, 5.0, 2.0)).unwrap());
        assert!(near.mm < 2.0 && far.mm > 70.0, "{} {}", near.mm, far.mm);
        let corner = walls([20, 20, 3], DVec3::ONE, |p| (p.x < 10.0) == (p.y < 10.0));
        let d = to(&corner, DVec3::new(5.0, 5.0, 1.0));
        assert_eq!(d.at([15, 15, 1]), None);
    }

    #[test]
    fn a_gap_is_bridged_only_as_a_guess() {
        let w = walls([60, 11, 11], DVec3::ONE, |p| (p.y - 5.0).hypot(p.z - 5.0) < 4.0 && !(25.0..33.0).contains(&p.x));
        let target = DVec3::new(3.0, 5.0, 5.0);
        assert_eq!(to(&w, target).at([50, 5, 5]), None);
        let gap = [DVec3::new(34.0, 5.0, 5.0), DVec3::new(23.0, 5.0, 5.0)];
        let d = TargetDistance::to(&w, target, None, &[gap], &Progress::new()).unwrap();
        assert!((f64::from(d.at([50, 5, 5]).unwrap()) - 47.0).abs() < 1.0);
        assert_eq!(d.guessed(), &[[gap[1], gap[0]]]);
        assert!(TargetDistance::to(&w, DVec3::new(29.0, 50.0, 5.0), None, &[], &Progress::new()).is_err());
        assert!(TargetDistance::to(&w, DVec3::NAN, None, &[], &Progress::new()).is_err());
    }

    /// Two rooms with a slit between them, and perhaps a wide way round.
    fn rooms(wide: bool) -> impl Fn(DVec3) -> bool {
        move |p| {
            let room = (p.x - 20.0).abs() < 18.0 && (p.y - 10.0).abs() < 8.0 && (p.z - 8.0).abs() < 7.0;
            let wall = (p.x - 20.0).abs() < 2.5;
            let slit = (p.y - 10.0).abs() < 1.2;
            let round = wide && p.y > 15.0 && p.y < 40.0 && (p.x - 20.0).abs() < 18.0 && (p.z - 8.0).abs() < 7.0;
            room && (!wall || slit) || round && (p.y > 24.0 || (p.x - 20.0).abs() > 6.0)
        }
    }

    #[test]
    fn leads_where_the_body_fits() {
        let (from, target) = (DVec3::new(8.0, 10.0, 8.0), DVec3::new(32.0, 10.0, 8.0));
        let way = |wide: bool, clearance_mm: f64| {
            let w = walls([41, 44, 17], DVec3::ONE, rooms(wide));
            let d =
                TargetDistance::to(&w, target, Some(Traveller { from, clearance_mm }), &[], &Progress::new()).unwrap();
            let (mut at, mut least) = (from, f64::INFINITY);
            for _ in 0..2000 {
                let Some(s) = d.sample(at) else { break };
                least = least.min(f64::from(w.at(w.voxel(at)).unwrap()));
                at -= s.gradient.normalize_or_zero() * 0.1;
                if at.distance(target) < 2.0 {
                    break;
                }
            }
            (d, at.distance(target) < 2.0, least)
        };
        let (d, there, least) = way(true, 2.5);
        assert!(there && d.clearance_mm() == 2.5 && least > 1.7, "{there} {least}");
        // From the slit it leads back to the room that it is nearer to.
        for x in [17.0, 18.0, 19.0] {
            let g = d.sample(DVec3::new(x, 10.0, 8.0)).unwrap().gradient;
            assert!(g.x > 0.3, "at {x}: {g}");
        }
        let (d, there, least) = way(true, 0.0);
        assert!(there && d.sample(from).unwrap().mm < 30.0 && least < 1.7, "{least}");
        let (d, there, _) = way(false, 2.5);
        assert!(there && d.clearance_mm() < 1.3, "through the slit, as there is no other way");
    }
}
