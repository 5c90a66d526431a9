//! A lesion put into the voxels around it.
//!
//! A scan is S = K ∗ b + n: what there is, b, blurred by the scanner's kernel K, and noise n. With tissue t in the region R of the lumen
//! that a lesion fills, it would have been S + K ∗ ((t − b) 1_R): the blur is linear, and b is gas or fluid in R, whose HU are known. So
//! the values around are left as they are, and the wall beneath, where R ends, meets the lesion without a seam. R is drawn on a lattice of
//! a quarter of a mm, where the lumen ends at the half-way level of the scan.
//!
//! A scan blurs a little more here than there, and the half-way level is not quite where tissue ends. What is left of the wall's edge under
//! a lesion would be a faint line. To first order it is a u φ(u) + c φ(u) with u the distance from the wall in standard deviations; a and c
//! are fitted to the wall around, before anything is put in, and taken off where the lesion covers the wall.
//!
//! Noise in tissue may be stronger than in gas; what is missing is added, with the scan's own correlation.

use glam::{DMat4, DVec3, DVec4, IVec3};
use rayon::prelude::*;

use super::HALF_HU;
use super::form::Form;
use super::noise::{Noise, NoiseLevel};
use super::spread::Spread;
use crate::error::Result;
use crate::fields::WallDistance;
use crate::math::ranked::median;
use crate::phantom::TruePolyp;
use crate::progress::Progress;
use crate::space::ray::trilinear;
use crate::volume::{Grid, Volume};

/// Spacing of the lattice, mm, about; each voxel has an odd number of its points.
const FINE_MM: f64 = 0.25;
/// The kernel ends here, standard deviations.
const REACH: f64 = 4.0;
/// Room around a lesion that is looked at, mm.
const ROOM_MM: f64 = 2.5;
/// Cleansed gas that is darker than this is not blurred with the wall, HU; fewer voxels of it say nothing.
const CLEAR_HU: f64 = -880.0;
const LEAST: usize = 20;
/// Gas is darker than this, and fluid brighter than that, HU.
const GAS_HU: f64 = -700.0;
const FLUID_HU: f64 = 150.0;
/// Share of what is farther from the wall that may be neither.
const OTHER: f64 = 0.01;
/// Cleansing changed less than this where a lesion is dry, HU, but for a small share.
const UNCHANGED_HU: f64 = 60.0;
/// The edge around a lesion is fitted to voxels this near to the wall, and up to this distance beyond the lesion, mm; what differs by more
/// than this from the scan's own edge is something else, HU.
const EDGE_MM: f64 = 2.0;
const BESIDE_MM: f64 = 4.0;
const OTHER_HU: f64 = 200.0;
const ROUNDS: usize = 2;
/// Where less than this of a voxel is lumen, what is there has the noise of tissue, as far as gas has less.
const CLEAR_SHARE: f64 = 0.75;
/// Where less than this of the lumen's share is left, there is no edge.
const LEAST_GAS: f64 = 0.02;
/// A lesion that is more hidden in tissue than this is none.
const LEAST_MM3: f64 = 8.0;
/// A lesion as high as wide must stand out at least this much of what was drawn.
const LEAST_SHARE: f64 = 0.25;

/// A coat of tag on a lesion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coat {
    pub(super) mm: f64,
    pub(super) hu: f64,
    /// Where the coat is: on the side of this direction, as far as the second number says, -1 (all) to 1 (nothing).
    pub(super) side: (DVec3, f64),
}

/// The scan that lesions are put into.
pub(super) struct Scan<'a> {
    /// As scanned.
    pub(super) raw: &'a Volume,
    /// Cleansed.
    pub(super) cleansed: &'a Volume,
    pub(super) spread: Spread,
    pub(super) noise: &'a Noise,
    /// Seed of the noise.
    pub(super) seed: u64,
}

/// What a lesion changes.
pub(super) struct Patch {
    /// Voxels of the scan and what is added to them, HU.
    pub(super) added: Vec<([usize; 3], f64)>,
    pub(super) truth: TruePolyp,
}

/// The lattice around a lesion.
struct Lattice {
    grid: Grid,
    /// Points for each voxel along each axis, and the first voxel.
    fine: [usize; 3],
    first: [usize; 3],
    voxels: [usize; 3],
    /// Share of the lumen at each point, and the distance from its wall, mm: above 0 in the lumen, below in tissue.
    free: Vec<f32>,
    wall_mm: Vec<f32>,
}

/// The edge of the wall around a lesion, as it differs from that of the whole scan.
struct LocalEdge {
    /// The lumen, blurred by the scan's kernel, at each voxel.
    gas: Vec<f64>,
    /// Distance from the wall at each voxel, standard deviations of the blur, and what is too much in the scan there, HU.
    u: Vec<f64>,
    wider: f64,
    shifted: f64,
}

/// Returns what `form` changes in a scan, or `None` where it does not fit. `tissue_hu` is that of the wall there.
pub(super) fn patch(
    scan: &Scan<'_>,
    form: &Form,
    coat: Option<Coat>,
    tissue_hu: f64,
    progress: &Progress,
) -> Result<Option<Patch>> {
    let Some((base_hu, submerged)) = filled_with(scan, form) else { return Ok(None) };
    if coat.is_some() && submerged {
        return Ok(None);
    }
    let Some(lattice) = Lattice::around(scan, form, tissue_hu, progress)? else { return Ok(None) };
    let count = lattice.grid.len();
    let (mut share, mut signal) = (vec![0f32; count], vec![0f32; count]);
    let (mut sum, mut height) = (0.0, 0f64);
    let cell = lattice.grid.spacing().min_element();
    let reach = form.reach_mm();
    for n in 0..count {
        if lattice.free[n] <= 0.0 {
            continue;
        }
        let place = lattice.world(n);
        let off = place - form.root.place;
        if off.length() > reach + 2.0 {
            continue;
        }
        let mm = form.distance(place, f64::from(lattice.wall_mm[n]));
        let part = f64::from(lattice.free[n]) * (0.5 - mm / cell).clamp(0.0, 1.0);
        if part > 0.0 {
            share[n] = part as f32;
            signal[n] = (part * (tissue_hu - base_hu)) as f32;
            sum += part;
            if part > 0.5 {
                height = height.max(f64::from(lattice.wall_mm[n]));
            }
        }
        if let Some(coat) = coat.filter(|c| off.normalize_or_zero().dot(c.side.0) > c.side.1) {
            let within = (0.5 + (coat.mm - mm) / cell).clamp(0.0, 1.0);
            let part = (f64::from(lattice.free[n]) * within - part).max(0.0);
            signal[n] += (part * (coat.hu - base_hu)) as f32;
        }
    }
    let volume_mm3 = sum * lattice.grid.spacing().element_product();
    if volume_mm3 < LEAST_MM3 {
        return Ok(None);
    }
    let truth = form.truth(|p| lattice.at(p).is_some_and(|n| lattice.free[n] > 0.5));
    let ball = std::f64::consts::PI / 6.0 * truth.diameter_mm.powi(3);
    if height < 1.2 || form.shape != crate::phantom::PolypShape::Flat && volume_mm3 < LEAST_SHARE * ball {
        return Ok(None);
    }
    let blurred = |of: &[f32]| lattice.blurred(of, &scan.spread);
    let (signal, share) = (blurred(&signal), blurred(&share));
    let edge = LocalEdge::of(&lattice, scan, form, base_hu, tissue_hu);
    let noise = scan.noise.near(form.root.place);
    let change = |n: usize| {
        let (voxel, share) = (lattice.voxel(n), share[n].clamp(0.0, 1.0));
        // On the wall's own edge the noise is there already.
        let clear = ((edge.gas[n] - CLEAR_SHARE) / (1.0 - CLEAR_SHARE)).clamp(0.0, 1.0);
        let more = noise_added(scan, &noise, voxel, share * clear, (base_hu, submerged));
        let hu = signal[n] + more - edge.left_over(n, share);
        (hu.abs() >= 0.5).then_some((voxel, hu))
    };
    let added = (0..signal.len()).into_par_iter().filter_map(change).collect();
    let coated = coat.is_some();
    let truth = TruePolyp { submerged, coated, height_mm: Some(height), volume_mm3: Some(volume_mm3), ..truth };
    Ok(Some(Patch { added, truth }))
}

/// Returns the HU of what fills the lumen in and around a lesion, and true if that is fluid. `None` if it is neither gas nor fluid alone, if
/// cleansing changed some of the gas, or where the scan ends.
fn filled_with(scan: &Scan<'_>, form: &Form) -> Option<(f64, bool)> {
    let grid = scan.raw.grid();
    let (h, middle) = (grid.spacing(), grid.voxel(form.root.place));
    let mm = form.reach_mm() + ROOM_MM;
    let (lo, hi) = ((middle - mm / h).ceil().as_ivec3(), (middle + mm / h).floor().as_ivec3());
    if lo.cmplt(IVec3::ZERO).any() || hi.cmpge(IVec3::from_array(grid.dims().map(|n| n as i32))).any() {
        return None;
    }
    let (mut clear, mut changed, mut all) = (Vec::new(), 0usize, 0usize);
    for (k, j, i) in (lo.z..=hi.z).flat_map(|k| (lo.y..=hi.y).flat_map(move |j| (lo.x..=hi.x).map(move |i| (k, j, i))))
    {
        let place = grid.world(DVec3::new(f64::from(i), f64::from(j), f64::from(k)));
        let high = (place - form.root.place).dot(form.root.up);
        let n = grid.index(i as usize, j as usize, k as usize);
        let [raw, cleansed] = [scan.raw, scan.cleansed].map(|v| f64::from(v.data()[n]));
        if cleansed > HALF_HU || form.distance(place, high) > ROOM_MM {
            continue;
        }
        all += 1;
        changed += usize::from((raw - cleansed).abs() > UNCHANGED_HU);
        if cleansed < CLEAR_HU {
            clear.push(raw);
        }
    }
    let submerged = median(clear.clone())? > 0.0;
    let is_own = |hu: &f64| if submerged { *hu > FLUID_HU } else { *hu < GAS_HU };
    let count = clear.len();
    clear.retain(is_own);
    let few = |count: usize| count as f64 <= OTHER * all as f64;
    let is_one = few(count - clear.len()) && (submerged || few(changed)) && clear.len() > LEAST;
    // The mean of rounded values, which may be few.
    is_one.then(|| (clear.iter().sum::<f64>() / clear.len() as f64, submerged))
}

impl LocalEdge {
    /// Fits the edge of the wall around a lesion, between what fills the lumen and the wall, HU.
    fn of(lattice: &Lattice, scan: &Scan<'_>, form: &Form, base_hu: f64, tissue_hu: f64) -> Self {
        let gas = lattice.blurred(&lattice.free, &scan.spread);
        let sigma = scan.spread.sigma_mm[0];
        let mut out = Self { gas, u: Vec::new(), wider: 0.0, shifted: 0.0 };
        let mut rows: Vec<(DVec4, f64)> = Vec::new();
        for n in 0..out.gas.len() {
            let own = lattice.middle(n);
            let mm = f64::from(lattice.wall_mm[own]);
            out.u.push(-mm / sigma);
            let far = lattice.world(own).distance(form.root.place);
            if mm.abs() > EDGE_MM || far > form.reach_mm() + BESIDE_MM {
                continue;
            }
            let [i, j, k] = lattice.voxel(n);
            let hu = f64::from(scan.raw.data()[scan.raw.grid().index(i, j, k)]);
            let solid = 1.0 - out.gas[n];
            let off = hu - (base_hu + (tissue_hu - base_hu) * solid);
            let [first, second] = out.terms(n);
            rows.push((DVec4::new(solid, solid * mm, first, second), off));
        }
        let mut fitted = DVec4::ZERO;
        for _ in 0..ROUNDS {
            let (mut matrix, mut side) = (DMat4::IDENTITY * 1e-3, DVec4::ZERO);
            for (row, off) in rows.iter().filter(|r| (r.1 - fitted.dot(r.0)).abs() < OTHER_HU) {
                matrix += DMat4::from_cols(*row * row.x, *row * row.y, *row * row.z, *row * row.w);
                side += *row * *off;
            }
            fitted = matrix.inverse() * side;
        }
        if fitted.is_finite() {
            (out.wider, out.shifted) = (fitted.z, fitted.w);
        }
        out
    }

    /// Returns u φ(u) and φ(u) at a voxel.
    fn terms(&self, n: usize) -> [f64; 2] {
        let u = self.u[n];
        let density = (-0.5 * u * u).exp();
        [u * density, density]
    }

    /// Returns what is left of the wall's edge at a voxel that a lesion fills by this share, HU.
    fn left_over(&self, n: usize, share: f64) -> f64 {
        if self.gas[n] < LEAST_GAS {
            return 0.0;
        }
        let [first, second] = self.terms(n);
        (share / self.gas[n]).clamp(0.0, 1.0) * (self.wider * first + self.shifted * second)
    }
}

/// Returns the noise that tissue has beyond that of the gas which it replaces, HU; where gas is noisier, what it must lose.
fn noise_added(scan: &Scan<'_>, noise: &NoiseLevel, voxel: [usize; 3], share: f64, base: (f64, bool)) -> f64 {
    let (base_hu, submerged) = base;
    // Fluid is as noisy as tissue.
    if submerged || share < 0.02 {
        return 0.0;
    }
    let missing = noise.tissue_hu.powi(2) - noise.gas_hu.powi(2);
    if missing >= 0.0 {
        return share * missing.sqrt() * scan.noise.at(scan.seed, voxel.map(|v| v as i64));
    }
    let own = f64::from(scan.raw.data()[scan.raw.grid().index(voxel[0], voxel[1], voxel[2])]) - base_hu;
    // Near the wall the values are not those of gas.
    if own.abs() > 4.0 * noise.gas_hu { 0.0 } else { -share * own * (1.0 - noise.tissue_hu / noise.gas_hu) }
}

impl Lattice {
    /// Draws the lumen around a lesion. Returns `None` where the scan ends.
    fn around(scan: &Scan<'_>, form: &Form, tissue_hu: f64, progress: &Progress) -> Result<Option<Self>> {
        let grid = scan.raw.grid();
        let (h, dims) = (grid.spacing(), grid.dims());
        let most = scan.spread.sigma_mm[0].max(scan.spread.sigma_mm[1]);
        let mm = form.reach_mm() + ROOM_MM + REACH * most;
        let middle = grid.voxel(form.root.place);
        let (lo, hi) = ((middle - mm / h).floor().as_ivec3(), (middle + mm / h).ceil().as_ivec3());
        let last = IVec3::from_array(dims.map(|n| n as i32 - 1));
        if lo.cmplt(IVec3::ONE).any() || hi.cmpge(last).any() {
            return Ok(None);
        }
        let first = lo.to_array().map(|v| v as usize);
        let voxels: [usize; 3] = std::array::from_fn(|a| (hi[a] - lo[a] + 1) as usize);
        let fine: [usize; 3] = std::array::from_fn(|a| (h[a] / FINE_MM).ceil() as usize | 1);
        let spacing = h / DVec3::from_array(fine.map(|f| f as f64));
        let points: [usize; 3] = std::array::from_fn(|a| voxels[a] * fine[a]);
        // The first point is half a voxel before the first voxel's middle, and half a point after that.
        let start = lo.as_dvec3() - 0.5 + 0.5 * spacing / h;
        let own = Grid::new(points, spacing, grid.world(start), grid.direction())?;
        let cleansed = scan.cleansed;
        let half = 0.5 * (scan.spread.gas_hu + tissue_hu);
        // A step's values rise by this much over a point.
        let rise = (tissue_hu - scan.spread.gas_hu) / (2.5 * most) * spacing.min_element();
        let mut free: Vec<f32> = (0..own.len())
            .into_par_iter()
            .map(|n| {
                let p = own.world(point(points, n));
                let hu = trilinear(cleansed, cleansed.grid().voxel(p));
                (0.5 + (half - hu) / rise).clamp(0.0, 1.0) as f32
            })
            .collect();
        let out = |free, wall_mm| Self { grid: own.clone(), fine, first, voxels, free, wall_mm };
        progress.check()?;
        // Only the gas that the lesion stands in: beyond a thin wall there may be other gas.
        let lattice = out(std::mem::take(&mut free), Vec::new());
        let Some(joined) = lattice.joined(form) else { return Ok(None) };
        let mut lattice = lattice;
        lattice.free.iter_mut().zip(&joined).for_each(|(f, is)| *f = if *is { *f } else { 0.0 });
        let [within, beyond] = [true, false].map(|side| {
            let mask = lattice.free.iter().map(|f| i16::from((*f >= 0.5) == side)).collect();
            WallDistance::of_mask(&Volume::new(own.clone(), mask), progress)
        });
        let (within, beyond) = (within?, beyond?);
        let depth = |n: usize| {
            let of =
                |walls: &WallDistance| walls.at(point(points, n).to_array().map(|c| c as i64)).unwrap_or(0.0).max(0.0);
            if lattice.free[n] >= 0.5 { of(&within) } else { -of(&beyond) }
        };
        lattice.wall_mm = (0..own.len()).into_par_iter().map(depth).collect();
        Ok(Some(lattice))
    }

    /// Returns which points are joined to those just above the root by points of the lumen, and those beside them.
    fn joined(&self, form: &Form) -> Option<Vec<bool>> {
        let dims = self.grid.dims();
        let start = [0.5, 1.0, 1.5, 2.0]
            .iter()
            .find_map(|mm| self.at(form.root.place + form.root.up * *mm).filter(|&n| self.free[n] >= 0.5))?;
        let mut seen = vec![false; self.free.len()];
        seen[start] = true;
        let mut front = vec![start];
        let strides = [1, dims[0], dims[0] * dims[1]];
        while let Some(n) = front.pop() {
            let at = point(dims, n).to_array();
            for a in 0..3 {
                let mut visit = |other: usize| {
                    if !std::mem::replace(&mut seen[other], true) && self.free[other] >= 0.5 {
                        front.push(other);
                    }
                };
                if at[a] > 0.0 {
                    visit(n - strides[a]);
                }
                if at[a] + 1.0 < dims[a] as f64 {
                    visit(n + strides[a]);
                }
            }
        }
        Some(seen)
    }

    /// Blurs values on the lattice by the scan's kernel, at the voxels' middles, in their order.
    fn blurred(&self, values: &[f32], spread: &Spread) -> Vec<f64> {
        let [xy, z] = spread.sigma_mm;
        let values: Vec<f64> = values.iter().map(|v| f64::from(*v)).collect();
        let mut dims = self.grid.dims();
        let along = |values: &[f64], axis: usize, sigma: f64, is_second: bool, dims: &mut [usize; 3]| {
            let kernel = kernel(self.grid.spacing()[axis], sigma, is_second);
            let out = convolved(values, *dims, axis, self.fine[axis], &kernel);
            dims[axis] = self.voxels[axis];
            out
        };
        let through = along(&values, 2, z, false, &mut dims);
        let (mut other, mut third) = (dims, dims);
        let rows = along(&through, 0, xy, false, &mut dims);
        let mut out = along(&rows, 1, xy, false, &mut dims);
        if spread.sharpness > 0.0 {
            // G − β σ² (G_xx + G_yy)
            let xx = along(&through, 0, xy, true, &mut other);
            let xx = along(&xx, 1, xy, false, &mut other);
            let yy = along(&through, 0, xy, false, &mut third);
            let yy = along(&yy, 1, xy, true, &mut third);
            for ((out, xx), yy) in out.iter_mut().zip(xx).zip(yy) {
                *out -= spread.sharpness * (xx + yy);
            }
        }
        out
    }

    /// Returns the point in the middle of the voxel with a number.
    fn middle(&self, n: usize) -> usize {
        let at = self.voxel(n);
        let at: [usize; 3] = std::array::from_fn(|a| (at[a] - self.first[a]) * self.fine[a] + self.fine[a] / 2);
        self.grid.index(at[0], at[1], at[2])
    }

    fn world(&self, n: usize) -> DVec3 {
        self.grid.world(point(self.grid.dims(), n))
    }

    /// Returns the point nearest to a place, if it is on the lattice.
    fn at(&self, place: DVec3) -> Option<usize> {
        let p = self.grid.voxel(place).round();
        let dims = self.grid.dims();
        let inside = (0..3).all(|a| p[a] >= 0.0 && p[a] < dims[a] as f64);
        inside.then(|| self.grid.index(p.x as usize, p.y as usize, p.z as usize))
    }

    /// Returns the scan's voxel with a number.
    fn voxel(&self, n: usize) -> [usize; 3] {
        let [x, y, _] = self.voxels;
        let at = [n % x, n / x % y, n / (x * y)];
        std::array::from_fn(|a| self.first[a] + at[a])
    }
}

/// Returns the place of a grid's `n`-th point.
fn point(dims: [usize; 3], n: usize) -> DVec3 {
    DVec3::new((n % dims[0]) as f64, (n / dims[0] % dims[1]) as f64, (n / (dims[0] * dims[1])) as f64)
}

/// Returns the normal density at points of a lattice, or its second derivative times σ²; each sums to what its integral is.
fn kernel(spacing: f64, sigma: f64, is_second: bool) -> Vec<f64> {
    let half = (REACH * sigma / spacing).ceil() as i32;
    let g = |n: i32| (-0.5 * (f64::from(n) * spacing / sigma).powi(2)).exp();
    let sum: f64 = (-half..=half).map(g).sum();
    let values = (-half..=half).map(|n| g(n) / sum);
    if !is_second {
        return values.collect();
    }
    let second: Vec<f64> =
        (-half..=half).zip(values).map(|(n, g)| g * ((f64::from(n) * spacing / sigma).powi(2) - 1.0)).collect();
    let mean = second.iter().sum::<f64>() / second.len() as f64;
    second.into_iter().map(|s| s - mean).collect()
}

/// Convolves values along an axis, at every voxel's middle; beyond the lattice there is nothing.
fn convolved(values: &[f64], dims: [usize; 3], axis: usize, fine: usize, kernel: &[f64]) -> Vec<f64> {
    let mut to = dims;
    to[axis] = dims[axis] / fine;
    let inner = dims[..axis].iter().product::<usize>();
    let half = kernel.len() / 2;
    let mut out = vec![0.0; to.iter().product()];
    out.par_chunks_mut(inner).enumerate().for_each(|(row, out)| {
        let (o, v) = (row / to[axis], row % to[axis]);
        let middle = v * fine + fine / 2;
        for (k, weight) in kernel.iter().enumerate() {
            let Some(at) = (middle + k).checked_sub(half).filter(|a| *a < dims[axis]) else { continue };
            let from = (o * dims[axis] + at) * inner;
            out.iter_mut().zip(&values[from..from + inner]).for_each(|(out, value)| *out += weight * value);
        }
    });
    out
}
