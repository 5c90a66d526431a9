//! The surroundings of a cap: how far its body reaches, and the wall that it replaces.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DVec3, Vec3};

use super::Wall;
use super::fit::solve;

/// Maximum distance along the wall from the cap that is examined, mm.
const FAR_MM: f32 = 15.0;
/// Width of the rings around a cap, mm.
const RING_MM: f32 = 1.0;
/// Share of the first ring that is counted: the cap's own vertices have the part next to it.
const FIRST: f32 = 0.7;
/// Width of the wall from which the wall beneath is continued, mm.
const AROUND_MM: f32 = 3.0;
/// Distance between the body and that strip of wall, mm.
const APART_MM: f32 = 1.0;
/// A body ends at most this far beyond its narrowest ring, mm: the fillet.
const FILLET_MM: f32 = 1.5;
/// Half the usual curvature of a wall, 1/mm: that of a tube of 20 mm, seen from inside. How firmly it is expected, mm⁴: the squared
/// deviation of the surroundings from any such surface (0.3 mm, independent six times) over that of the curvature (0.01/mm).
const USUAL: f64 = 0.0125;
const FLAT: f64 = 30.0;
/// A ring that is this much longer than the narrowest one is beyond the body.
const WIDER: f32 = 1.4;
/// Ratio up to which a ring counts as no longer than the one before.
const ALIKE: f32 = 1.15;
/// Width of the bands of distance in which a search keeps what is not near yet, mm: less than an edge.
const BAND_MM: f32 = 0.25;
/// A narrowest ring farther than this from the cap is a stalk, mm.
const STALK_MM: f32 = 1.5;

/// True on the edge of a fold: sharp one way, and straight the other way.
fn is_edge(wall: &Wall, v: u32) -> bool {
    let [k1, k2] = wall.curvatures(v);
    k1 > 0.25 && k2.abs() < 0.2 * k1
}

/// Vertices to go on from, the nearest one first. Those that are not near yet are kept in bands of distance, unsorted.
#[derive(Debug, Default)]
struct Queue {
    /// Distance and vertex as one number: distances are positive, and their bits are in the same order.
    near: BinaryHeap<Reverse<u64>>,
    bands: Vec<Vec<u64>>,
    /// The band that is near.
    at: usize,
}

impl Queue {
    fn push(&mut self, mm: f32, v: u32) {
        let entry = u64::from(mm.to_bits()) << 32 | u64::from(v);
        let band = (mm / BAND_MM) as usize;
        if band <= self.at {
            return self.near.push(Reverse(entry));
        }
        if band >= self.bands.len() {
            self.bands.resize_with(band + 1, Vec::new);
        }
        self.bands[band].push(entry);
    }

    fn clear(&mut self) {
        self.near.clear();
        self.bands.iter_mut().for_each(Vec::clear);
        self.at = 0;
    }

    /// Takes the nearest entry that `is_current`, given its distance and vertex; of equal ones the first vertex.
    fn pop(&mut self, is_current: impl Fn(f32, u32) -> bool) -> Option<(f32, u32)> {
        let parts = |entry: u64| (f32::from_bits((entry >> 32) as u32), entry as u32);
        loop {
            while let Some(Reverse(entry)) = self.near.pop() {
                let (mm, v) = parts(entry);
                if is_current(mm, v) {
                    return Some((mm, v));
                }
            }
            if self.at + 1 >= self.bands.len() {
                self.at = 0;
                return None;
            }
            self.at += 1;
            let current = |&entry: &u64| {
                let (mm, v) = parts(entry);
                is_current(mm, v)
            };
            self.near.extend(self.bands[self.at].drain(..).filter(current).map(Reverse));
        }
    }
}

/// Memory for one cap after the other.
#[derive(Debug)]
pub(crate) struct Scratch {
    /// Distance along the wall from the cap, mm; infinite where it was not computed.
    mm: Vec<f32>,
    touched: Vec<u32>,
    queue: Queue,
}

impl Scratch {
    pub(crate) fn new(wall: &Wall) -> Self {
        Self { mm: vec![f32::INFINITY; wall.len()], touched: Vec::new(), queue: Queue::default() }
    }

    /// Returns the way along the wall from the cap, mm.
    pub(crate) fn mm(&self, v: u32) -> f32 {
        self.mm[v as usize]
    }

    /// Measures the ways from `cap` along the edges of the wall, up to `far`. Returns the vertices in the order of their distance; those
    /// of the cap are at 0.
    pub(crate) fn spread(&mut self, wall: &Wall, cap: &[u32], far: f32) -> Vec<(f32, u32)> {
        self.begin(cap);
        std::iter::from_fn(|| self.next(wall, far)).collect()
    }

    /// Begins to measure the ways from `cap` along the edges of the wall (Dijkstra 1959).
    fn begin(&mut self, cap: &[u32]) {
        let Self { mm: all, touched, queue } = self;
        queue.clear();
        for v in touched.drain(..) {
            all[v as usize] = f32::INFINITY;
        }
        for &v in cap {
            all[v as usize] = 0.0;
            touched.push(v);
            queue.push(0.0, v);
        }
    }

    /// Returns the nearest vertex that it has not returned yet, and its distance, up to `far`, which must be the same each time. Distances
    /// of those that it has not returned may still shrink.
    fn next(&mut self, wall: &Wall, far: f32) -> Option<(f32, u32)> {
        let Self { mm: all, touched, queue } = self;
        let (mm, v) = queue.pop(|mm, v| mm <= all[v as usize])?;
        for &n in wall.beside(v) {
            let next = mm + wall.place(n).distance(wall.place(v));
            let known = &mut all[n as usize];
            if next < *known && next <= far {
                if known.is_infinite() {
                    touched.push(n);
                }
                *known = next;
                queue.push(next, n);
            }
        }
        Some((mm, v))
    }
}

/// What a cap stands on.
#[derive(Clone, Debug)]
pub(crate) struct Base {
    /// Vertices of the body, and how far along the wall it reaches beyond the cap, mm.
    pub body: Vec<u32>,
    pub reach_mm: f32,
    /// Way along the wall from the body to the nearest fold's edge, mm; at most [`FAR_MM`].
    pub fold_mm: f32,
    /// Length of the stalk, mm; 0 without one.
    pub stalk_mm: f32,
    /// Unit vector from the wall to the lumen.
    pub axis: DVec3,
    /// Root mean square of the surroundings' distance from the continued wall, mm.
    pub rms: f64,
    origin: DVec3,
    u: DVec3,
    w: DVec3,
    q: [f64; 6],
}

impl Base {
    /// Looks at the surroundings of a cap. Returns `None` if there are none.
    pub(crate) fn of(wall: &Wall, cap: &[u32], scratch: &mut Scratch) -> Option<Self> {
        // Most caps are small: only what is asked for is visited.
        let far = FAR_MM + APART_MM + AROUND_MM;
        scratch.begin(cap);
        let mut order = Vec::new();
        let mut rings = [0f32; (FAR_MM / RING_MM) as usize];
        let (mut narrow, mut end) = (0, rings.len());
        for n in 0..rings.len() {
            // A ring is whole when one beyond it is reached.
            while order.last().is_none_or(|&(mm, _)| mm < (n + 1) as f32 * RING_MM)
                && let Some((mm, v)) = scratch.next(wall, far)
            {
                order.push((mm, v));
                if let Some(ring) = rings.get_mut((mm / RING_MM) as usize).filter(|_| mm > 0.0) {
                    *ring += wall.area(v);
                }
            }
            if n == 0 {
                rings[0] /= FIRST;
            }
            if rings[n] < rings[narrow] {
                narrow = n;
            }
            if rings[n] > WIDER * rings[narrow] && rings[n] > 0.0 {
                end = n;
                break;
            }
        }
        // A stalk is as narrow along its whole length.
        while narrow + 1 < end && rings[narrow + 1] <= ALIKE * rings[narrow] {
            narrow += 1;
        }
        let narrow_mm = narrow as f32 * RING_MM;
        let reach_mm = (end as f32 * RING_MM).min(narrow_mm + FILLET_MM);
        let stalk_mm = if narrow_mm > STALK_MM { narrow_mm } else { 0.0 };
        let from = reach_mm + APART_MM;
        let is_fold = |&(mm, v): &(f32, u32)| mm > reach_mm && is_edge(wall, v);
        let mut fold = order.iter().copied().find(is_fold);
        while (fold.is_none() || order.last().is_none_or(|&(mm, _)| mm <= from + AROUND_MM))
            && let Some(next) = scratch.next(wall, far)
        {
            order.push(next);
            fold = fold.or_else(|| Some(next).filter(is_fold));
        }
        let body: Vec<u32> = order.iter().filter(|o| o.0 <= reach_mm).map(|o| o.1).collect();
        let fold_mm = fold.map_or(FAR_MM, |o| (o.0 - reach_mm).min(FAR_MM));
        let around: Vec<u32> = order.iter().filter(|o| o.0 > from && o.0 <= from + AROUND_MM).map(|o| o.1).collect();
        let normal: Vec3 = around.iter().map(|&v| wall.normal(v) * wall.area(v)).sum();
        let area_mm2: f32 = around.iter().map(|&v| wall.area(v)).sum();
        let axis = normal.as_dvec3().normalize_or_zero();
        if axis == DVec3::ZERO || area_mm2 <= 0.0 {
            return None;
        }
        let (u, w) = axis.any_orthonormal_pair();
        let at = |v: u32| wall.place(v).as_dvec3();
        let origin = around.iter().map(|&v| at(v) * f64::from(wall.area(v))).sum::<DVec3>() / f64::from(area_mm2);
        let mut base = Self { body, reach_mm, fold_mm, stalk_mm, axis, rms: 0.0, origin, u, w, q: [0.0; 6] };
        let points: Vec<(DVec3, f64)> = around.iter().map(|&v| (at(v), f64::from(wall.area(v)))).collect();
        base.continue_wall(&points);
        Some(base)
    }

    /// Fits z = q₀ + q₁x + q₂y + q₃x² + q₄xy + q₅y² to the surroundings, three times with Cauchy's weights, so that a fold
    /// beside counts less than the wall.
    fn continue_wall(&mut self, points: &[(DVec3, f64)]) {
        let area: f64 = points.iter().map(|p| p.1).sum();
        for round in 0..4 {
            let (mut matrix, mut side) = ([[0.0; 6]; 6], [0.0; 6]);
            for (p, a) in points {
                let (row, z) = self.row(*p);
                let off = if round == 0 { 0.0 } else { z - dot(&self.q, &row) };
                let weight = a / area / (1.0 + (off / 0.5).powi(2));
                for i in 0..6 {
                    for j in 0..6 {
                        matrix[i][j] += weight * row[i] * row[j];
                    }
                    side[i] += weight * row[i] * z;
                }
            }
            // A ring of wall says little of how it is curved in the middle; the colon's usual curvature does.
            for n in [3, 5] {
                matrix[n][n] += FLAT;
                side[n] += FLAT * USUAL;
            }
            matrix[4][4] += FLAT;
            for (n, row) in matrix.iter_mut().enumerate() {
                row[n] += 1e-9;
            }
            if let Some(q) = solve(matrix, side) {
                self.q = q;
            }
        }
        let off = |p: DVec3| {
            let (row, z) = self.row(p);
            z - dot(&self.q, &row)
        };
        self.rms = (points.iter().map(|(p, a)| a * off(*p).powi(2)).sum::<f64>() / area).sqrt();
    }

    fn row(&self, p: DVec3) -> ([f64; 6], f64) {
        let d = p - self.origin;
        let (x, y) = (d.dot(self.u), d.dot(self.w));
        ([1.0, x, y, x * x, x * y, y * y], d.dot(self.axis))
    }

    /// Returns the height of a place (offset as of [`Wall::place`]) over the continued wall, along the axis, mm.
    pub(crate) fn height(&self, p: DVec3) -> f64 {
        let (row, z) = self.row(p);
        z - dot(&self.q, &row)
    }
}

fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
