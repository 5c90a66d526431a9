//! Clearance: the exact distance from a point to the nearest wall, searched in the voxels around it, without a distance
//! field. It makes perforation impossible.
//!
//! The wall is where the trilinearly interpolated volume reaches the iso value. The volume's border is a wall too,
//! because unscanned space cannot be flown through. A trilinear function takes its extremes over an axis-aligned box at
//! the box's corners. So a box contains no wall exactly when all eight corners are below iso, and a corner that is not
//! below iso is itself a point of the wall. Branch and bound over the cells between voxels, and inside them over halved
//! boxes, therefore bounds the distance as tightly as required; here within [`TOLERANCE_MM`].

use std::sync::{Arc, Mutex};

use glam::{DMat3, DVec3};

use crate::math::cubic;
use crate::volume::Volume;
use crate::volume::cell::Cell;

/// Maximum amount by which [`Clearance::mm`] is below the true distance, mm.
#[doc(hidden)]
pub const TOLERANCE_MM: f64 = 0.05;

/// Distance to the nearest wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Distance, mm: never more than the true distance, and at most `TOLERANCE_MM` less if it is below the search
    /// limit. It is 0 in tissue and outside the volume.
    pub mm: f64,
    /// Unit world vector towards the nearest wall; zero if none was found within the limit, or in the wall.
    pub toward: DVec3,
}

/// A source of clearances, used by [`crate::dynamics::advance()`] to move a body.
pub trait Clearances: Sync {
    /// Returns the clearance of a world point (mm), never more than the true distance. It is 0 in the wall and for a
    /// point that is not finite.
    fn clearance(&self, at: DVec3) -> Clearance;

    /// True if the straight line between two points (world, mm) passes from gas into the wall anywhere. Leaving the
    /// wall in which it starts does not count. The answer may be a false positive, never a false negative.
    ///
    /// The default derives it from the clearances of both ends, and is true for every line longer than their sum.
    fn enters(&self, from: DVec3, to: DVec3) -> bool {
        let (a, b) = (self.clearance(from), self.clearance(to));
        let begins_in_wall = a.mm == 0.0 && a.toward == DVec3::ZERO;
        b.mm == 0.0 || (!begins_in_wall && a.mm + b.mm <= from.distance(to))
    }
}

impl Clearances for ClearanceFinder {
    fn clearance(&self, at: DVec3) -> Clearance {
        self.at(at)
    }

    fn enters(&self, from: DVec3, to: DVec3) -> bool {
        enters(&self.volume, f64::from(self.iso), from, to)
    }
}

/// Finds clearances in a volume.
#[derive(Clone, Debug)]
pub struct ClearanceFinder {
    volume: Arc<Volume>,
    iso: f32,
    limit: f64,
    spacing: DVec3,
    /// Voxel axes (unit columns) in the world.
    axes: DMat3,
    /// Smallest singular value of `axes`: 1 for orthogonal axes. On a sheared grid, this factor times the distance
    /// along the axes taken as orthogonal is a lower bound of the distance.
    shrink: f64,
    /// Rows of cells (offsets in y and z from the point's cell), ordered by least distance, mm².
    rows: Vec<(f64, i32, i32)>,
    last: Last,
}

/// The last point searched from, with its clearance. A body's step starts where the last one ended, so every other search
/// would find the same again.
#[derive(Debug, Default)]
struct Last(Mutex<Option<(DVec3, Clearance)>>);

impl Clone for Last {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl ClearanceFinder {
    /// Creates a finder for the wall at `iso` HU, with a search limit of `limit_mm`.
    pub fn new(volume: Arc<Volume>, iso: f32, limit_mm: f64) -> Self {
        let spacing = volume.grid().spacing();
        let axes = volume.grid().direction();
        let limit = limit_mm.clamp(0.1, 100.0);
        // No cell is farther away than the volume is wide, however fine its voxels.
        let dims = volume.grid().dims();
        let reach = |axis: usize| (limit / spacing[axis]).ceil().min(dims[axis] as f64) as i32 + 1;
        let (ry, rz) = (reach(1), reach(2));
        let gap = |d: i32, s: f64| f64::from((d.abs() - 1).max(0)) * s;
        let mut rows: Vec<_> = (-rz..=rz)
            .flat_map(|dz| (-ry..=ry).map(move |dy| (dy, dz)))
            .map(|(dy, dz)| (gap(dy, spacing.y).powi(2) + gap(dz, spacing.z).powi(2), dy, dz))
            .filter(|r| r.0 < limit * limit)
            .collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        Self { shrink: smallest_singular_value(axes), volume, iso, limit, spacing, axes, rows, last: Last::default() }
    }

    /// Returns the search limit, mm.
    pub fn limit_mm(&self) -> f64 {
        self.limit * self.shrink
    }

    /// Returns the size in memory without the volume, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.rows.as_slice())
    }

    /// Returns the clearance of a world point (mm). NaN counts as outside.
    pub fn at(&self, world: DVec3) -> Clearance {
        // Another thread may be using it; the search then gives the same.
        let known = self.last.0.try_lock().ok().and_then(|last| *last);
        if let Some((_, clearance)) = known.filter(|(at, _)| *at == world) {
            return clearance;
        }
        let clearance = self.search(world);
        if let Ok(mut last) = self.last.0.try_lock() {
            *last = Some((world, clearance));
        }
        clearance
    }

    fn search(&self, world: DVec3) -> Clearance {
        let none = Clearance { mm: 0.0, toward: DVec3::ZERO };
        let dims = self.volume.grid().dims();
        let last = DVec3::new(dims[0] as f64 - 1.0, dims[1] as f64 - 1.0, dims[2] as f64 - 1.0);
        let u = self.volume.grid().voxel(world);
        if !(u.cmpge(DVec3::ZERO).all() && u.cmple(last).all()) || last.min_element() < 1.0 {
            return none;
        }
        // From here on, all coordinates are in mm along the voxel axes, relative to the point.
        let mm2 = self.limit * self.limit;
        let mut best = Best { mm2, mm: mm2.sqrt(), at: DVec3::ZERO };
        for axis in 0..3 {
            let mut unit = DVec3::ZERO;
            unit[axis] = self.spacing[axis];
            best.offer(-unit * u[axis]);
            best.offer(unit * (last[axis] - u[axis]));
        }
        let base = u.floor().min(last - 1.0);
        let fraction = u - base;
        let base = base.as_i64vec3();
        for &(least, dy, dz) in &self.rows {
            if least >= best.mm2 {
                break;
            }
            let (j, k) = (base.y + i64::from(dy), base.z + i64::from(dz));
            if j < 0 || k < 0 || j + 2 > dims[1] as i64 || k + 2 > dims[2] as i64 {
                continue;
            }
            let y = (f64::from(dy) - fraction.y) * self.spacing.y;
            let z = (f64::from(dz) - fraction.z) * self.spacing.z;
            let off = gap2(y, self.spacing.y) + gap2(z, self.spacing.z);
            if off < best.mm2 {
                self.scan_row(base.x, fraction.x, j as usize, k as usize, (y, z, off), &mut best);
            }
        }
        if best.mm2 == 0.0 {
            return none;
        }
        let found = best.at != DVec3::ZERO;
        let slack = if found { TOLERANCE_MM } else { 0.0 };
        let toward = (self.axes * best.at).normalize_or_zero();
        Clearance { mm: (best.mm - slack).max(0.0) * self.shrink, toward }
    }

    /// Searches one row of cells for walls nearer than `best`. `y`, `z`: offset of the row's low corner, mm; `off`:
    /// squared distance of the row from the point across x, mm².
    fn scan_row(&self, base: i64, fraction: f64, j: usize, k: usize, (y, z, off): (f64, f64, f64), best: &mut Best) {
        let [nx, ny, _] = self.volume.grid().dims();
        let data = self.volume.data();
        let start = |dj: usize, dk: usize| nx * (j + dj + ny * (k + dk));
        let rows = [start(0, 0), start(1, 0), start(0, 1), start(1, 1)].map(|s| &data[s..s + nx]);
        let column = |i: usize| rows[0][i].max(rows[1][i]).max(rows[2][i]).max(rows[3][i]);
        // A voxel reaches iso when its integer value does.
        let wall = f64::from(self.iso).ceil() as i32;
        let s = self.spacing.x;
        let reach = ((best.mm2 - off).sqrt() / s) + 1.0;
        let at = base as f64 + fraction;
        let lo = (at - reach).floor().max(0.0) as usize;
        let hi = ((at + reach).ceil() as usize).min(nx - 2);
        let mut left = i32::from(column(lo));
        for i in lo..=hi {
            let right = i32::from(column(i + 1));
            if left.max(right) >= wall {
                let x = (i as f64 - at) * s;
                if off + gap2(x, s) < best.mm2 {
                    let v = std::array::from_fn(|c| f64::from(rows[c >> 1][i + (c & 1)]));
                    let low = DVec3::new(x, y, z);
                    refine(&v, f64::from(self.iso), low, low + self.spacing, best);
                }
            }
            left = right;
        }
    }
}

/// The nearest wall point found so far, as an offset in mm along the voxel axes.
struct Best {
    mm2: f64,
    mm: f64,
    at: DVec3,
}

impl Best {
    #[inline]
    fn offer(&mut self, at: DVec3) {
        let mm2 = at.length_squared();
        if mm2 < self.mm2 {
            *self = Self { mm2, mm: mm2.sqrt(), at };
        }
    }
}

/// Returns the squared distance from 0 to the interval `[a, a + s]`.
fn gap2(a: f64, s: f64) -> f64 {
    let g = if a > 0.0 { a } else { (-(a + s)).max(0.0) };
    g * g
}

/// Halves the box `[lo, hi]` (corner values `v`, x fastest) until no part of it can contain a wall that is nearer than
/// `best` by more than the tolerance.
fn refine(v: &[f64; 8], iso: f64, lo: DVec3, hi: DVec3, best: &mut Best) {
    let near = DVec3::ZERO.clamp(lo, hi).length();
    if near * near >= best.mm2 || v.iter().all(|&x| x < iso) {
        return;
    }
    for (c, &x) in v.iter().enumerate() {
        if x >= iso {
            let pick = |bit: usize, a: f64, b: f64| if c >> bit & 1 == 1 { b } else { a };
            best.offer(DVec3::new(pick(0, lo.x, hi.x), pick(1, lo.y, hi.y), pick(2, lo.z, hi.z)));
        }
    }
    // Slightly below the tolerance, so that this bound plus rounding stays within it.
    if near + 0.9 * TOLERANCE_MM >= best.mm {
        return;
    }
    let extent = hi - lo;
    if extent.x >= extent.y && extent.x >= extent.z {
        halve::<0>(v, iso, lo, hi, best);
    } else if extent.z > extent.y {
        halve::<2>(v, iso, lo, hi, best);
    } else {
        halve::<1>(v, iso, lo, hi, best);
    }
}

/// Refines both halves of the box, cut across an axis.
#[inline(always)]
fn halve<const AXIS: usize>(v: &[f64; 8], iso: f64, lo: DVec3, hi: DVec3, best: &mut Best) {
    let bit = 1 << AXIS;
    let middle: [f64; 8] = std::array::from_fn(|c| 0.5 * (v[c & !bit] + v[c | bit]));
    let cut = 0.5 * (lo[AXIS] + hi[AXIS]);
    let half = |upper: bool| {
        let values = std::array::from_fn(|c| if (c & bit != 0) == upper { v[c] } else { middle[c] });
        let (mut a, mut b) = (lo, hi);
        *(if upper { &mut a[AXIS] } else { &mut b[AXIS] }) = cut;
        (values, a, b)
    };
    // The half on the point's side comes first: it tightens the bound for the other.
    let mut refine_half = |upper: bool| {
        let (values, a, b) = half(upper);
        refine(&values, iso, a, b, best);
    };
    if cut < 0.0 {
        refine_half(true);
        refine_half(false);
    } else {
        refine_half(false);
        refine_half(true);
    }
}

/// Exact version of [`Clearances::enters`]. Within each cell the value along the line is a cubic, which is checked from
/// one extremum to the next. Outside the volume is wall.
fn enters(volume: &Volume, iso: f64, from: DVec3, to: DVec3) -> bool {
    let grid = volume.grid();
    let start = grid.voxel(from);
    let along = grid.voxel(to) - start;
    if !start.is_finite() || !along.is_finite() {
        return true;
    }
    let last = grid.dims().map(|n| n as i64 - 1);
    let mut cell = start.floor().as_i64vec3().to_array();
    let mut gas = false;
    let mut t = 0.0;
    loop {
        // Each iteration passes one plane between cells; the number of planes ahead is an integer.
        let plane = |a: usize| {
            let ahead = cell[a] + i64::from(along[a] > 0.0);
            if along[a] == 0.0 { f64::INFINITY } else { (ahead as f64 - start[a]) / along[a] }
        };
        let planes = [plane(0), plane(1), plane(2)];
        let axis = (1..3).fold(0, |m, a| if planes[a] < planes[m] { a } else { m });
        let until = planes[axis].clamp(t, 1.0);
        if (0..3).all(|a| cell[a] >= 0 && cell[a] < last[a]) {
            let base = DVec3::from_array(cell.map(|c| c as f64));
            let mut along_it = Cell::load(volume, cell).along(start - base, along);
            along_it[0] -= iso;
            let turns = cubic::critical_points(along_it).map(|s| if s.is_nan() { t } else { s.clamp(t, until) });
            for s in [t, turns[0], turns[1], until] {
                let wall = cubic::value(along_it, s) >= 0.0;
                if gas && wall {
                    return true;
                }
                gas |= !wall;
            }
        } else if gas {
            return true;
        }
        if planes[axis] >= 1.0 {
            return false;
        }
        t = until;
        cell[axis] += if along[axis] > 0.0 { 1 } else { -1 };
    }
}

/// Returns a lower bound of the smallest singular value of a matrix with unit columns; 1 if they are orthogonal.
pub(super) fn smallest_singular_value(m: DMat3) -> f64 {
    let g = m.transpose() * m;
    let off = (g.x_axis.y.abs() + g.x_axis.z.abs()).max(g.y_axis.x.abs() + g.y_axis.z.abs());
    let off = off.max(g.z_axis.x.abs() + g.z_axis.y.abs());
    if off < 1e-5 {
        return 1.0;
    }
    // Gershgorin's bound on the smallest eigenvalue of MᵀM; for strong shear, the exact product bound det / max².
    let gershgorin = 1.0 - off;
    let by_determinant = (m.determinant() / 3.0).powi(2);
    gershgorin.max(by_determinant).max(1e-12).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Grid;
    use proptest::prelude::*;

    fn volume(dims: [usize; 3], spacing: DVec3, f: impl Fn(DVec3) -> f64) -> Arc<Volume> {
        let grid = Grid::new(dims, spacing, DVec3::new(-5.0, 3.0, 7.0), DMat3::IDENTITY).unwrap();
        let mut data = Vec::with_capacity(grid.len());
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let p = grid.world(DVec3::new(i as f64, j as f64, k as f64));
                    data.push(f(p).round().clamp(-2000.0, 3000.0) as i16);
                }
            }
        }
        Arc::new(Volume::new(grid, data))
    }

    /// A ball of gas with a linear edge, for which the trilinear surface is close to the sphere.
    #[test]
    fn distance_to_a_sphere() {
        for spacing in [DVec3::ONE, DVec3::new(0.5, 0.8, 1.1)] {
            let dims = [0, 1, 2].map(|a| (44.0 / spacing[a]) as usize);
            let centre = DVec3::new(17.0, 25.0, 29.0);
            let v = volume(dims, spacing, |p| -650.0 + 200.0 * ((p - centre).length() - 15.0));
            let f = ClearanceFinder::new(v, -650.0, 12.0);
            for (offset, want) in
                [(DVec3::X * 9.0, 6.0), (DVec3::new(3.0, -8.0, 4.0), 15.0 - 89f64.sqrt()), (DVec3::Z * 14.0, 1.0)]
            {
                let c = f.at(centre + offset);
                assert!((c.mm - want).abs() < 0.12, "{spacing} {offset}: {} for {want}", c.mm);
                assert!(c.toward.dot(offset.normalize()) > 0.99);
            }
            assert_eq!(f.at(centre + DVec3::X * 16.0).mm, 0.0);
            let far = f.at(centre);
            assert!(far.mm == 12.0 && far.toward == DVec3::ZERO, "beyond the limit it is a lower bound");
        }
    }

    #[test]
    fn border_and_nonsense() {
        let v = volume([20, 20, 20], DVec3::ONE, |_| -1000.0);
        let f = ClearanceFinder::new(Arc::clone(&v), -650.0, 12.0);
        let c = f.at(v.grid().world(DVec3::new(3.0, 10.0, 9.0)));
        assert!((c.mm - 3.0).abs() <= TOLERANCE_MM && c.toward == DVec3::NEG_X);
        for p in [DVec3::NAN, DVec3::splat(1e300), v.grid().world(DVec3::splat(-0.1)), DVec3::INFINITY] {
            assert_eq!(f.at(p).mm, 0.0);
        }
        for dims in [[1, 1, 1], [5, 5, 1]] {
            let v = volume(dims, DVec3::ONE, |_| -1000.0);
            assert_eq!(ClearanceFinder::new(Arc::clone(&v), -650.0, 12.0).at(v.grid().origin()).mm, 0.0);
        }
    }

    /// The voxels are so fine that the search limit spans thousands of them. The search stays within the volume.
    #[test]
    fn fine_voxels_take_no_more_rows_than_there_are() {
        for spacing in [7e-4, 1e-6] {
            let v = volume([6, 7, 8], DVec3::splat(spacing), |_| -1000.0);
            let f = ClearanceFinder::new(Arc::clone(&v), -650.0, 11.0);
            assert!(f.bytes() <= 17 * 19 * size_of::<(f64, i32, i32)>(), "{} bytes", f.bytes());
        }
        let v = volume([6, 7, 8], DVec3::splat(0.5), |p| if p.z > 8.9 { 100.0 } else { -1000.0 });
        let c = ClearanceFinder::new(Arc::clone(&v), -650.0, 11.0).at(v.grid().world(DVec3::new(2.5, 3.0, 2.5)));
        assert!((c.mm - 0.409).abs() <= TOLERANCE_MM && c.toward == DVec3::Z, "{c:?}");
    }

    /// One voxel of exactly the wall's value in gas.
    #[test]
    fn a_wall_that_only_just_reaches_its_value_is_met() {
        let wall = DVec3::new(5.0, 13.0, 17.0);
        let v = volume([20; 3], DVec3::ONE, |p| if p == wall { -650.0 } else { -1000.0 });
        let f = ClearanceFinder::new(v, -650.0, 12.0);
        for from in [DVec3::Z, DVec3::NEG_X, DVec3::Y] {
            let c = f.at(wall + 3.0 * from);
            assert!((c.mm - 3.0).abs() <= TOLERANCE_MM + 1e-9 && c.toward.dot(from) < -0.999, "{from}: {c:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Compares with a fine lattice of points of the trilinear field: never above the truth, and close below it.
        #[test]
        fn encloses_the_brute_force_distance(values in prop::collection::vec(-1000i16..200, 125), x in 0.5f64..3.5, y in 0.5f64..3.5, z in 0.5f64..3.5) {
            let spacing = DVec3::new(0.4, 0.7, 1.3);
            let grid = Grid::new([5; 3], spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let v = Arc::new(Volume::new(grid, values));
            let f = ClearanceFinder::new(Arc::clone(&v), -650.0, 12.0);
            let p = DVec3::new(x, y, z) * spacing;
            let n = 40i32;
            let value = |u: DVec3| {
                let b = u.floor().min(DVec3::splat(3.0));
                let t = u - b;
                let g = |di: i64, dj: i64, dk: i64| f64::from(v.get(b.x as i64 + di, b.y as i64 + dj, b.z as i64 + dk));
                let l = |a: f64, b: f64, t: f64| a + (b - a) * t;
                let plane = |dk| l(l(g(0, 0, dk), g(1, 0, dk), t.x), l(g(0, 1, dk), g(1, 1, dk), t.x), t.y);
                l(plane(0), plane(1), t.z)
            };
            let mut brute = f64::INFINITY;
            for k in 0..=n { for j in 0..=n { for i in 0..=n {
                let u = DVec3::new(f64::from(i), f64::from(j), f64::from(k)) * (4.0 / f64::from(n));
                if value(u) >= -650.0 || [i, j, k].iter().any(|&e| e == 0 || e == n) {
                    brute = brute.min((u * spacing - p).length());
                }
            }}}
            let c = f.at(p);
            let diagonal = (spacing * (4.0 / f64::from(n))).length();
            prop_assert!(c.mm <= brute + 1e-9, "{} above {brute}", c.mm);
            let elsewhere = f.at(p * 0.9);
            prop_assert!(c == f.at(p) && c == f.at(p), "the same when asked again, after another point too");
            let fresh = ClearanceFinder::new(Arc::clone(&v), -650.0, 12.0);
            prop_assert!(elsewhere == fresh.at(p * 0.9), "the same from a finder that remembers nothing");
            // A segment enters the wall where its finely sampled values do.
            let q = DVec3::new(z, x, y);
            let (begin, way) = (DVec3::new(x, y, z), q - DVec3::new(x, y, z));
            let mut places: Vec<f64> = (0..=2000).map(|n| f64::from(n) / 2000.0).collect();
            // Values bend sharply between cells, so even samples could miss a peak there.
            let planes = (0..15).map(|n| (f64::from(n / 3) - begin[n as usize % 3]) / way[n as usize % 3]);
            places.extend(planes.filter(|s| *s > 0.0 && *s < 1.0));
            places.sort_by(f64::total_cmp);
            let profile: Vec<f64> = places.into_iter().map(|s| value(begin + way * s) + 650.0).collect();
            let sampled = profile.windows(2).any(|w| w[0] < 0.0 && w[1] >= 0.0);
            let reported = f.enters(p, q * spacing);
            prop_assert!(reported || !sampled, "a way into the wall was missed");
            // A turning point between two samples differs from either by at most half the second derivative times the
            // square of their distance. Mixed differences of values that span 1200 HU are at most 2400 HU.
            let second = 2.0 * 2400.0 * ((way.x * way.y).abs() + (way.y * way.z).abs() + (way.z * way.x).abs());
            let hidden = 1e-6 + 0.5 * second / (2000.0 * 2000.0);
            let grazes = profile.windows(2).any(|w| w[0].abs() <= hidden && w[1].abs() <= hidden);
            prop_assert!(sampled || !reported || grazes, "a way that does not enter the wall is reported");
            prop_assert!(c.mm >= brute - TOLERANCE_MM - diagonal || value(p / spacing) >= -650.0, "{} far below {brute}", c.mm);
        }
    }
}
