//! A lesion's measures and features, from the cap that it is and the wall around it.

use std::collections::BTreeSet;
use std::ops::Range;

use glam::DVec3;

use super::Wall;
use super::base::{Base, Scratch};
use super::caps::Cap;
use super::edge::Edge;
use super::fit::Ellipsoid;
use crate::math::sphere::directions;
use crate::space::ray::trilinear;
use crate::volume::Volume;

/// Points of a cap whose k2 is below this share of its peak are its edge, and none of the head.
const HEAD: f32 = 0.3;
/// A cap with less roundness or a lower shape index is a ridge. A flat lesion may come near.
const RIDGE: [f64; 2] = [0.02, 0.8];
/// Any length, mm.
const ANY_MM: Range<f64> = f64::NEG_INFINITY..f64::INFINITY;
/// Directions in which a head is measured.
const DIRECTIONS: usize = 400;
/// A head emerges from the wall this far below its cap, whose edge is rounded off, mm.
const EMERGES_MM: f64 = 1.2;
/// A head grows at most so often; it has what is within so many times the deviation of its ellipsoid, and within these, mm, and whose normal
/// has at least this cosine with the ellipsoid's.
const GROWTHS: usize = 6;
const WITHIN: f64 = 2.5;
const WITHIN_MM: [f64; 2] = [0.2, 0.5];
const ALONG: f64 = 0.85;
/// The inside begins this far below the surface, mm.
const INSIDE_MM: f64 = 1.4;

/// What is asked of a lesion. One that is something else is not measured any further.
#[derive(Clone, Debug)]
pub(crate) struct Limits {
    /// Least roundness and shape index of its cap.
    pub ridge: [f64; 2],
    /// Extent of its cap and height, mm.
    pub extent_mm: Range<f64>,
    pub height_mm: Range<f64>,
}

impl Limits {
    /// Anything but a ridge.
    pub(crate) const NO_RIDGE: Self = Self { ridge: RIDGE, extent_mm: ANY_MM, height_mm: ANY_MM };
    /// Anything.
    const NONE: Self = Self { ridge: [0.0; 2], ..Self::NO_RIDGE };
}

/// What was measured of a lesion. Positions are world, mm LPS.
#[derive(Clone, Debug, PartialEq)]
pub struct Lesion {
    /// The highest place over the wall.
    pub position: DVec3,
    /// Unit vector from the wall into the lumen.
    pub axis: DVec3,
    /// Largest diameter without a stalk, mm: of the tissue, whose edge is half-way between gas and tissue. The wall lies outside of it.
    pub diameter_mm: f64,
    /// Ends of that diameter.
    pub ends: [DVec3; 2],
    /// Greatest height over the wall that it replaces, mm.
    pub height_mm: f64,
    /// Volume over that wall, mm³.
    pub volume_mm3: f64,
    /// Features that a score may be made of, in the order of [`FEATURES`].
    pub features: [f64; FEATURES.len()],
}

/// Darker than this inside is gas; between the two fat, brighter than the last tag, HU.
const AIR_HU: f64 = -200.0;
const FAT_HU: f64 = -35.0;
const TAG_HU: f64 = 150.0;

/// Names of the features.
pub const FEATURES: [&str; 29] = [
    "cap_area_mm2",
    "k2_peak",
    "k2_mean",
    "k1_mean",
    "shape_index",
    "facing",
    "roundness",
    "radius_mm",
    "fit_rms_mm",
    "elongation",
    "sphericity",
    "height_mm",
    "diameter_mm",
    "volume_mm3",
    "stalk_mm",
    "wall_rms_mm",
    "hu_mean",
    "hu_sd",
    "hu_min",
    "hu_max",
    "share_air",
    "share_fat",
    "share_tag",
    "normal_overlap",
    "fold_mm",
    "extent_mm",
    "hu_median",
    "hu_spread",
    "broad",
];

impl Lesion {
    /// Measures the lesion that a cap belongs to. Returns `None` for a ridge, or if there is no wall around it or no
    /// ellipsoid fits.
    pub(crate) fn of(wall: &Wall, cap: &Cap, volume: &Volume, scratch: &mut Scratch) -> Option<Self> {
        Self::within(wall, cap, volume, scratch, &Limits::NO_RIDGE)
    }

    /// Like [`Lesion::of`], also for a ridge.
    pub(crate) fn of_any(wall: &Wall, cap: &Cap, volume: &Volume, scratch: &mut Scratch) -> Option<Self> {
        Self::within(wall, cap, volume, scratch, &Limits::NONE)
    }

    /// Like [`Lesion::of`], for what is within some limits.
    pub(crate) fn within(
        wall: &Wall,
        cap: &Cap,
        volume: &Volume,
        scratch: &mut Scratch,
        limits: &Limits,
    ) -> Option<Self> {
        if cap.vertices.is_empty() {
            return None;
        }
        let high = |v: &u32| wall.curvatures(*v)[1] >= HEAD * cap.k2;
        let head: Vec<u32> = cap.vertices.iter().copied().filter(high).collect();
        // In thick slices, noise breaks a body into several caps, and an ellipsoid of one of them says little.
        let whole = if wall.tissue_mm().is_some() && !wall.is_over_bowel() { grown(wall, cap, &head) } else { None };
        let (cap, head) = match &whole {
            Some((cap, head)) => (cap, head.clone()),
            None => (cap, head),
        };
        let area = f64::from(cap.area).max(1e-9);
        let mean =
            |f: &dyn Fn(u32) -> f64| cap.vertices.iter().map(|&v| f64::from(wall.area(v)) * f(v)).sum::<f64>() / area;
        let normal = cap.vertices.iter().map(|&v| wall.normal(v) * wall.area(v)).sum::<glam::Vec3>().as_dvec3() / area;
        let [least, most] = spread(wall, cap, normal.normalize_or_zero());
        let (roundness, shape_index) = (least / most.max(1e-9), mean(&|v| f64::from(wall.shape_index(v))));
        if roundness < limits.ridge[0] || shape_index < limits.ridge[1] {
            return None;
        }
        let all: Vec<DVec3> = cap.vertices.iter().map(|&v| wall.place(v).as_dvec3()).collect();
        let own = farthest(&all);
        let extent = own.map_or(0.0, |f| f.0);
        if !limits.extent_mm.contains(&extent) {
            return None;
        }
        let base = Base::of(wall, &cap.vertices, scratch)?;
        let top = |v: &u32| base.height(wall.place(*v).as_dvec3());
        let highest = base.body.iter().copied().max_by(|a, b| top(a).total_cmp(&top(b)).then(b.cmp(a)))?;
        let height_mm = top(&highest);
        if !limits.height_mm.contains(&height_mm) {
            return None;
        }
        let shape = fitted(wall, &head)?;
        let overlap = overlap(wall, cap, &shape);
        let found = widest(&shape, &base, lowest(wall, cap, base.axis) - EMERGES_MM)?;
        // Features are those of the surface; what is told of the lesion is that of its tissue.
        let (surface_mm, surface_ends) = match (wall.is_over_bowel(), own) {
            // An ellipsoid says nothing of a plaque that follows a concave wall.
            (true, Some(own)) => stretched(own, PLAQUE),
            _ => bounded(found, extent, overlap),
        };
        let volume_mm3 = raised(wall, &base, scratch);

        let hu = inside(wall, &head, &shape, volume);
        let (long, short) = match wall.is_over_bowel() {
            true => moments(wall, cap, base.axis),
            false => in_plane(&shape, base.axis),
        };
        let features = [
            area,
            f64::from(cap.k2),
            mean(&|v| f64::from(wall.curvatures(v)[1])),
            mean(&|v| f64::from(wall.curvatures(v)[0])),
            shape_index,
            normal.length(),
            roundness,
            shape.radius(),
            shape.rms,
            long / short.max(1e-9),
            height_mm / surface_mm.max(1e-9),
            height_mm,
            surface_mm,
            volume_mm3,
            f64::from(base.stalk_mm),
            base.rms,
            hu.mean,
            hu.sd,
            hu.min,
            hu.max,
            hu.air,
            hu.fat,
            hu.tag,
            overlap,
            f64::from(base.fold_mm),
            extent,
            hu.median,
            hu.spread,
            // See `broad`, whose curvatures are over those of the bowel.
            f64::from(u8::from(wall.is_over_bowel())),
        ];
        let edge = Edge::of(wall, &head, volume, hu.mean, hu.max);
        let diameter_mm = edge.map_or(surface_mm, |edge| edge.diameter(surface_mm));
        let middle = 0.5 * (surface_ends[0] + surface_ends[1]);
        let ends = surface_ends.map(|e| middle + (e - middle) * (diameter_mm / surface_mm.max(1e-9)));
        let position = wall.world(highest);
        let out = Self {
            position,
            axis: base.axis,
            diameter_mm,
            ends: ends.map(|e| wall.origin() + e),
            height_mm,
            volume_mm3,
            features,
        };
        out.features.iter().all(|f| f.is_finite()).then_some(out)
    }

    /// Returns a feature by its name; NaN if there is none.
    pub fn feature(&self, name: &str) -> f64 {
        FEATURES.iter().position(|f| *f == name).map_or(f64::NAN, |n| self.features[n])
    }
}

/// Returns the ellipsoid that fits vertices best.
fn fitted(wall: &Wall, vertices: &[u32]) -> Option<Ellipsoid> {
    let point = |&v: &u32| (wall.place(v).as_dvec3(), f64::from(wall.area(v)));
    Ellipsoid::fit(&vertices.iter().map(point).collect::<Vec<_>>(), wall.noisy())
}

/// Returns the mean k2 of a vertex and those beside it, 1/mm.
fn ring_k2(wall: &Wall, v: u32) -> f64 {
    let all = || wall.beside(v).iter().copied().chain([v]);
    let area = |v: u32| f64::from(wall.area(v));
    all().map(|n| area(n) * f64::from(wall.curvatures(n)[1])).sum::<f64>() / all().map(area).sum::<f64>().max(1e-9)
}

/// Returns a cap with all of the wall around it that its body's ellipsoid describes, and the vertices that are on the ellipsoid. The
/// ellipsoid of a head is fitted again to what it reaches, which is how surfaces are grown from a seed (Besl and Jain 1988).
fn grown(wall: &Wall, cap: &Cap, head: &[u32]) -> Option<(Cap, Vec<u32>)> {
    let mut on = head.to_vec();
    for _ in 0..GROWTHS {
        let shape = fitted(wall, &on)?;
        let within = (WITHIN * shape.rms).clamp(WITHIN_MM[0], WITHIN_MM[1]);
        let fits = |v: u32| {
            let p = wall.place(v).as_dvec3();
            let away = (shape.s * (shape.s * (p - shape.centre))).normalize_or_zero();
            let near = shape.distance(p).abs() <= within && wall.normal(v).as_dvec3().dot(away) >= ALONG;
            near && ring_k2(wall, v) * shape.radius() >= f64::from(HEAD)
        };
        let mut seen: BTreeSet<u32> = head.iter().copied().filter(|&v| fits(v)).collect();
        let mut next: Vec<u32> = seen.iter().copied().collect();
        while let Some(v) = next.pop() {
            for &n in wall.beside(v) {
                if !seen.contains(&n) && fits(n) {
                    seen.insert(n);
                    next.push(n);
                }
            }
        }
        if seen.len() < on.len() / 2 {
            break;
        }
        let same = seen.len() == on.len() && on.iter().all(|v| seen.contains(v));
        on = seen.into_iter().collect();
        if same {
            break;
        }
    }
    let vertices: Vec<u32> = cap.vertices.iter().chain(&on).copied().collect::<BTreeSet<u32>>().into_iter().collect();
    let area = vertices.iter().map(|&v| wall.area(v)).sum();
    Some((Cap { vertices, area, ..cap.clone() }, on))
}

/// Returns how far along `axis` a cap begins, mm: all but a twentieth of its area is farther.
fn lowest(wall: &Wall, cap: &Cap, axis: DVec3) -> f64 {
    let mut along: Vec<(f64, f64)> =
        cap.vertices.iter().map(|&v| (wall.place(v).as_dvec3().dot(axis), f64::from(wall.area(v)))).collect();
    along.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut left = 0.05 * f64::from(cap.area);
    let first = along.iter().find(|a| {
        left -= a.1;
        left <= 0.0
    });
    first.map_or(0.0, |a| a.0)
}

/// Returns the largest distance between two points of an ellipsoid, mm, and the points: those over the wall, and those that are
/// farther than `from` along the axis, which hold where a fold hides the wall.
fn widest(shape: &Ellipsoid, base: &Base, from: f64) -> Option<(f64, [DVec3; 2])> {
    let points: Vec<DVec3> = directions(DIRECTIONS)
        .map(|d| shape.point(d))
        .filter(|p| base.height(*p) >= 0.0 || p.dot(base.axis) >= from)
        .collect();
    farthest(&points)
}

/// The rim of a flat lesion, where it is concave, is none of its cap: the lesion is so many times as wide (the median of flat lesions of
/// phantoms is 1.35, of those put into a CT 1.25).
const TOP: f64 = 1.4;

/// Shortens a diameter to what a cap of this extent can belong to: hardly more than the extent if the cap is most of a ball
/// (`overlap`), up to [`TOP`] times as much if it is the top of something flat. A small cap does not determine its ellipsoid well.
fn bounded((mm, ends): (f64, [DVec3; 2]), extent: f64, overlap: f64) -> (f64, [DVec3; 2]) {
    let part = |lo: f64, hi: f64| ((overlap - lo) / (hi - lo)).clamp(0.0, 1.0);
    let times = (2.0 - 0.65 * part(0.05, 0.35) - 0.29 * part(0.35, 0.6)).min(TOP);
    let most = times * extent + 0.3;
    if mm <= most { (mm, ends) } else { stretched((mm, ends), most / mm) }
}

/// A plaque is so many times as wide as its cap at the scale of [`broad`](super::broad).
const PLAQUE: f64 = 1.2;

/// Makes a diameter so many times as long, about its middle.
fn stretched((mm, ends): (f64, [DVec3; 2]), times: f64) -> (f64, [DVec3; 2]) {
    let middle = 0.5 * (ends[0] + ends[1]);
    (mm * times, ends.map(|e| middle + (e - middle) * times))
}

/// Returns the standard deviations of a cap's places across the axis, the larger one first, mm.
fn moments(wall: &Wall, cap: &Cap, axis: DVec3) -> (f64, f64) {
    let (u, w) = axis.any_orthonormal_pair();
    let all = || cap.vertices.iter().map(|&v| (wall.place(v).as_dvec3(), f64::from(wall.area(v))));
    let area: f64 = all().map(|p| p.1).sum::<f64>().max(1e-9);
    let middle = all().map(|(p, a)| p * a).sum::<DVec3>() / area;
    let (mut a, mut b, mut c) = (0.0, 0.0, 0.0);
    for (p, share) in all().map(|(p, a)| (p - middle, a / area)) {
        let (x, y) = (p.dot(u), p.dot(w));
        a += share * x * x;
        b += share * x * y;
        c += share * y * y;
    }
    let (half, off) = (0.5 * (a + c), (0.25 * (a - c).powi(2) + b * b).sqrt());
    ((half + off).sqrt(), (half - off).max(0.0).sqrt())
}

/// Returns the largest distance between two points, mm, and the points.
fn farthest(points: &[DVec3]) -> Option<(f64, [DVec3; 2])> {
    let mut best: Option<(f64, [DVec3; 2])> = None;
    let first = *points.first()?;
    for direction in directions(DIRECTIONS / 2) {
        let (mut least, mut most) = ((f64::INFINITY, first), (f64::NEG_INFINITY, first));
        for &p in points {
            let along = p.dot(direction);
            if along < least.0 {
                least = (along, p);
            }
            if along >= most.0 {
                most = (along, p);
            }
        }
        let mm = least.1.distance(most.1);
        if best.is_none_or(|b| mm > b.0) {
            best = Some((mm, [least.1, most.1]));
        }
    }
    best
}

/// Returns the half axes of the ellipse in which a plane across `axis` through the centre cuts an ellipsoid, the longer one
/// first, mm.
fn in_plane(shape: &Ellipsoid, axis: DVec3) -> (f64, f64) {
    let (u, w) = axis.any_orthonormal_pair();
    let m = shape.s * shape.s;
    let (a, b, c) = (u.dot(m * u), u.dot(m * w), w.dot(m * w));
    let (half, off) = (0.5 * (a + c), (0.25 * (a - c).powi(2) + b * b).sqrt());
    ((half - off).max(1e-9).sqrt().recip(), (half + off).max(1e-9).sqrt().recip())
}

/// Returns the volume between a body's surface and the wall beneath, mm³.
fn raised(wall: &Wall, base: &Base, scratch: &Scratch) -> f64 {
    let in_body = |v: u32| scratch.mm(v) <= base.reach_mm;
    let mut sum = 0.0;
    for &v in &base.body {
        // Each triangle is counted at its first vertex.
        for [a, b] in wall.around(v).filter(|&[a, b]| v < a && v < b && in_body(a) && in_body(b)) {
            let [own, a, b] = [v, a, b].map(|n| wall.place(n).as_dvec3());
            let across = 0.5 * (b - own).cross(a - own).dot(base.axis);
            sum += across * (base.height(own) + base.height(a) + base.height(b)) / 3.0;
        }
    }
    sum.max(0.0)
}

/// Returns the smaller and the larger mean square of a cap's normals across the axis: equal on a ball, the smaller one near 0
/// on a ridge.
fn spread(wall: &Wall, cap: &Cap, axis: DVec3) -> [f64; 2] {
    if axis == DVec3::ZERO {
        return [0.0, 1.0];
    }
    let (u, w) = axis.any_orthonormal_pair();
    let (mut a, mut b, mut c) = (0.0, 0.0, 0.0);
    for &v in &cap.vertices {
        let n = wall.normal(v).as_dvec3();
        let (x, y, area) = (n.dot(u), n.dot(w), f64::from(wall.area(v)));
        a += area * x * x;
        b += area * x * y;
        c += area * y * y;
    }
    let (half, off) = (0.5 * (a + c), (0.25 * (a - c).powi(2) + b * b).sqrt());
    [(half - off).max(0.0), half + off]
}

/// Returns the share of the ellipsoid's surface that a cap covers, each place weighted by how well its normal points away from the
/// centre: the overlap of the normals there.
fn overlap(wall: &Wall, cap: &Cap, shape: &Ellipsoid) -> f64 {
    let at = |v: &u32| {
        let away = (wall.place(*v).as_dvec3() - shape.centre).normalize_or_zero();
        f64::from(wall.area(*v)) * wall.normal(*v).as_dvec3().dot(away).max(0.0).powi(2)
    };
    cap.vertices.iter().map(at).sum::<f64>() / (4.0 * std::f64::consts::PI * shape.radius().powi(2))
}

/// HU inside a lesion.
#[derive(Default)]
struct Inside {
    mean: f64,
    sd: f64,
    min: f64,
    max: f64,
    /// Shares of gas, fat and tag.
    air: f64,
    fat: f64,
    tag: f64,
    /// Median, and the range of the middle half as a standard deviation: a coat of tag or the edge of a small head does not move them.
    median: f64,
    spread: f64,
}

/// The range of the middle half of a normal distribution, standard deviations.
const MIDDLE_HALF: f64 = 1.349;

/// Returns the HU below a head's surface, up to its centre.
fn inside(wall: &Wall, head: &[u32], shape: &Ellipsoid, volume: &Volume) -> Inside {
    let deepest = (shape.radius()).clamp(INSIDE_MM + 0.1, 6.0);
    let (mut count, mut sum, mut square) = (0.0, 0.0, 0.0);
    let (mut air, mut fat, mut tag) = (0.0, 0.0, 0.0);
    let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut all = Vec::new();
    for &v in head {
        let inwards = -wall.normal(v).as_dvec3();
        let mut mm = INSIDE_MM;
        while mm <= deepest {
            let hu = trilinear(volume, volume.grid().voxel(wall.world(v) + inwards * mm));
            (count, sum, square) = (count + 1.0, sum + hu, square + hu * hu);
            all.push(hu);
            (min, max) = (min.min(hu), max.max(hu));
            air += f64::from(u8::from(hu < AIR_HU));
            fat += f64::from(u8::from((AIR_HU..FAT_HU).contains(&hu)));
            tag += f64::from(u8::from(hu > TAG_HU));
            mm += 1.0;
        }
    }
    if count == 0.0 {
        return Inside::default();
    }
    let mean: f64 = sum / count;
    let sd = (square / count - mean * mean).max(0.0).sqrt();
    all.sort_by(f64::total_cmp);
    let [low, median, high] = [1, 2, 3].map(|quarter| all[(all.len() - 1) * quarter / 4]);
    let spread = (high - low) / MIDDLE_HALF;
    Inside { mean, sd, min, max, air: air / count, fat: fat / count, tag: tag / count, median, spread }
}
