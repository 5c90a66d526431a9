//! The front that computes the distance to a target: fast marching over the lumen's voxels, and extension to the rest.

use glam::DVec3;

use super::SNAP_MM;
use crate::error::Result;
use crate::fields::WallDistance;
use crate::progress::Progress;

/// Number of buckets per smallest spacing.
const FINENESS: f64 = 4.0;
/// Slope of the distance from where the body fits into where it does not, mm/mm.
const RISE: f32 = 1.5;

/// A voxel on the front.
type Front = (u32, [i32; 3]);

/// The marching front.
pub(crate) struct March<'a> {
    walls: &'a WallDistance,
    /// Distances in the order of the walls' set, mm; infinite where the front did not arrive.
    pub values: Vec<f32>,
    done: Vec<bool>,
    /// Voxels by value; the lowest bucket that is not empty is next.
    buckets: Vec<Vec<Front>>,
    next: usize,
    per_mm: f64,
    spacing: [f32; 3],
    /// The front passes only where the wall is at least this far away, mm, or near one of the `open` positions.
    clearance: f32,
    open: &'a [DVec3],
    /// A value that each voxel inherits from the neighbour that the front came from.
    track: Option<Vec<f32>>,
}

impl<'a> March<'a> {
    pub(crate) fn new(walls: &'a WallDistance, clearance: f64, open: &'a [DVec3]) -> Self {
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

    /// True if the front may enter a voxel.
    fn passes(&self, n: usize, voxel: [i64; 3]) -> bool {
        let d = self.walls.value(n);
        d >= self.clearance
            || d >= 0.0 && self.open.iter().any(|&o| self.walls.world(voxel).distance_squared(o) <= SNAP_MM * SNAP_MM)
    }

    /// Continues across collapsed stretches if a guess leads from reached voxels to others. Returns the guesses used,
    /// each starting on the target's side.
    pub(crate) fn bridge(&mut self, guesses: &[[DVec3; 2]], progress: &Progress) -> Result<Vec<[DVec3; 2]>> {
        let mut guessed = Vec::new();
        let mut left: Vec<[DVec3; 2]> = guesses.to_vec();
        // Each pass uses one of the remaining guesses, so the loop ends.
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

    /// Extends the distance to every voxel of the lumen that the front did not reach: the value of the nearest reached
    /// voxel plus [`RISE`] times the path from it.
    pub(crate) fn extend(&mut self, progress: &Progress) -> Result<()> {
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

    /// Starts with the ball inscribed at `target` (world, mm), which is in `voxel`.
    pub(crate) fn ball(&mut self, voxel: [i64; 3], target: DVec3) {
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
            // A guess may restart below the last bucket.
            let bucket = (f64::from(value) * self.per_mm) as usize;
            if bucket >= self.buckets.len() {
                self.buckets.resize_with(bucket + 1, Vec::new);
            }
            self.buckets[bucket].push((n as u32, voxel.map(|x| x as i32)));
            self.next = self.next.min(bucket);
        }
    }

    pub(crate) fn run(&mut self, progress: &Progress) -> Result<()> {
        let mut steps = 0u64;
        while self.next < self.buckets.len() {
            // Voxels that arrive in this bucket meanwhile are processed in the next round.
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

    /// Inherits the tracked value from the neighbour nearest to the start of the front.
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

    /// Returns the value that a voxel gets from its neighbours with final values.
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
        // Use values relative to the lowest, so that large distances lose no digits.
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

    pub(crate) fn reaches(&self, world: DVec3) -> bool {
        self.value(world).is_finite()
    }
}
