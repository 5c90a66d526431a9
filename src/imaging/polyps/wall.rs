//! The colon's wall as a smooth surface: positions between voxels, normals and principal curvatures.
//!
//! Vertices lie where the interpolated value crosses the wall's. Their normals n are those of the triangles around them,
//! smoothed along the surface by a Gaussian of [`SMOOTH_MM`], so that no smoothing reaches across a thin fold. The shape
//! operator S of a vertex is the symmetric 2×2 matrix that best maps the steps e to its neighbours, in the tangent plane,
//! to the change of the normal: Σ a |S e − Δn|² is least, with a the area of the neighbour (the discrete form of
//! dn = S dx; Rusinkiewicz 2004 solves the same equation for each triangle). Its eigenvalues are the principal curvatures.
//!
//! The steps are between positions smoothed by the same weights as the normals. Any mean of points of a sphere or a cylinder
//! and the mean of their normals are related by the same S as the points, so that S is exact there, however uneven the mesh
//! is. Elsewhere the error is of the second order in the smoothing and in the length of a step.

use std::ops::Range;

use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;

use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::lumen::Interior;
use crate::progress::Progress;
use crate::surface::LumenMesh;
use crate::volume::Volume;

/// Standard deviation of the smoothing of normals along the surface, mm.
pub const SMOOTH_MM: f64 = 1.0;
/// Maximum number of smoothing steps; a scan with finer voxels is smoothed less.
const MOST_STEPS: usize = 40;
/// Maximum number for a coarser scale.
const MOST_COARSE_STEPS: usize = 200;
/// Vertices that work is split by: a sum then does not depend on the threads.
const CHUNK: usize = 4096;

/// The wall of a lumen. Vertices are numbered from 0; neighbours share an edge.
#[derive(Clone, Debug, Default)]
pub struct Wall {
    origin: DVec3,
    places: Vec<Vec3>,
    normals: Vec<Vec3>,
    areas: Vec<f32>,
    curvatures: Vec<[f32; 2]>,
    /// True if the curvatures are over those of the bowel (see `broad`).
    over_bowel: bool,
    /// How far within the wall the edge of the tissue is, mm, if the wall was settled.
    tissue_mm: Option<f64>,
    /// How many times as noisy its places are as those of usual slices, less one.
    noisier: f64,
    /// Where the corners of each vertex begin.
    begins: Vec<u32>,
    /// The vertices beside each vertex, in their order around it, counter-clockwise as seen from the tissue. Two that follow each
    /// other, and the last and the first, form a triangle with it.
    beside: Vec<u32>,
}

impl Wall {
    /// Extracts the wall of `lumen` at `iso` HU and computes its curvatures.
    ///
    /// # Errors
    /// Returns status 4 if there are more vertices than 32 bits can count, or if interrupted.
    pub fn new(volume: &Volume, lumen: &Lumen, iso: f64, progress: &Progress) -> Result<Self> {
        let mesh = LumenMesh::new(&Interior::of_lumen(volume, lumen, iso, progress)?, progress)?;
        let (mesh, _) = mesh.without_islands();
        Self::of_mesh(mesh, progress)
    }

    /// Computes the curvatures of a closed surface whose normals point out of the lumen.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn of_mesh(mesh: LumenMesh, progress: &Progress) -> Result<Self> {
        progress.stage("measuring the wall", 0);
        let (origin, places, triangles) = mesh.into_parts();
        // Each goes through the triangles in their order.
        let ((normals, areas), (begins, sides)) =
            rayon::join(|| facing(&places, &triangles), || sides(places.len(), &triangles));
        drop(triangles);
        let beside = fans(&begins, sides);
        let mut wall = Self { origin, places, normals, areas, begins, beside, ..Self::default() };
        progress.check()?;
        let steps = wall.smoothing_steps().min(MOST_STEPS);
        wall.smooth(steps, progress)?;
        Ok(wall)
    }

    /// Creates a wall without triangles, given the vertices beside each one. Only smoothing and curvatures of it mean something.
    pub(super) fn of_parts(
        origin: DVec3,
        places: Vec<Vec3>,
        normals: Vec<Vec3>,
        areas: Vec<f32>,
        all_beside: &[Vec<u32>],
    ) -> Self {
        let mut begins = vec![0u32; places.len() + 1];
        for (n, beside) in all_beside.iter().enumerate() {
            begins[n + 1] = begins[n] + beside.len() as u32;
        }
        let beside = all_beside.concat();
        Self { origin, places, normals, areas, begins, beside, ..Self::default() }
    }

    /// Moves the vertices, mm, and computes normals, areas and curvatures again, smoothed by so many times the usual scale.
    pub(super) fn move_by(&mut self, moves: &[Vec3], scale: f64, progress: &Progress) -> Result<()> {
        self.places.par_iter_mut().zip(moves).for_each(|(place, by)| *place += *by);
        let facing = |v: usize| {
            let own = self.places[v];
            // Counter-clockwise as seen from the tissue.
            let normal = |[a, b]: [u32; 2]| 0.5 * (self.places[b as usize] - own).cross(self.places[a as usize] - own);
            self.around(v as u32)
                .map(normal)
                .fold((Vec3::ZERO, 0.0), |(sum, area), n| (sum + n, area + n.length() / 3.0))
        };
        let all: Vec<(Vec3, f32)> = (0..self.len()).into_par_iter().map(facing).collect();
        (self.normals, self.areas) = all.into_iter().map(|(n, area)| (n.normalize_or_zero(), area)).unzip();
        let steps = (self.smoothing_steps() as f64 * scale * scale).round() as usize;
        self.smooth(steps.min(MOST_COARSE_STEPS), progress)
    }

    /// Sets how far within the wall the edge of the tissue is, mm, and how many times as noisy as usual the places are.
    pub(super) fn set_settled(&mut self, tissue_mm: Option<f64>, noisy: f64) {
        (self.tissue_mm, self.noisier) = (tissue_mm, noisy - 1.0);
    }

    /// Returns how many times as noisy the places are as those of usual slices.
    pub(super) fn noisy(&self) -> f64 {
        1.0 + self.noisier
    }

    /// Returns how far within the wall the edge of the tissue is, mm; `None` unless the wall was settled.
    pub(super) fn tissue_mm(&self) -> Option<f64> {
        self.tissue_mm
    }

    /// Takes other curvatures off those of each vertex.
    pub(super) fn subtract_curvatures(&mut self, of: impl Fn(u32) -> [f32; 2] + Sync) {
        self.curvatures.par_iter_mut().enumerate().for_each(|(v, k)| {
            let other = of(v as u32);
            *k = [k[0] - other[0], k[1] - other[1]];
        });
        self.over_bowel = true;
    }

    /// True if the curvatures are over those of the bowel.
    pub(super) fn is_over_bowel(&self) -> bool {
        self.over_bowel
    }

    /// Returns the same wall with normals and curvatures of a coarser scale: those of the wall smoothed by a Gaussian of `mm` in all. What is
    /// broad and low, as a plaque, bulges there as a whole.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub(crate) fn at_scale(&self, mm: f64, progress: &Progress) -> Result<Self> {
        let mut wall = self.clone();
        // The normals are smooth by SMOOTH_MM already, which matters little: the squares of the scales add up.
        let steps = (self.smoothing_steps() as f64 * (mm / SMOOTH_MM).powi(2)).round() as usize;
        wall.smooth(steps.clamp(1, MOST_COARSE_STEPS), progress)?;
        Ok(wall)
    }

    /// Smooths normals along the surface in some steps and computes the curvatures; positions stay.
    fn smooth(&mut self, steps: usize, progress: &Progress) -> Result<()> {
        // Not of unit length: a mean of normals is shorter, as a mean of positions is nearer to the middle.
        let [places, mut normals] = self.smoothed([&self.places, &self.normals], steps, progress)?;
        self.normals.clear();
        let curvatures = |v: usize| self.curvatures_at(v as u32, &places, &normals);
        self.curvatures = (0..self.len()).into_par_iter().map(curvatures).collect();
        drop(places);
        normals.par_iter_mut().for_each(|n| *n = n.normalize_or_zero());
        self.normals = normals;
        progress.check()
    }

    /// Returns the number of vertices.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// True if there is no wall.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Returns a vertex' position, world mm LPS.
    pub fn world(&self, vertex: u32) -> DVec3 {
        self.origin + self.places[vertex as usize].as_dvec3()
    }

    /// Returns a vertex' position as an offset from an origin near the scan, mm in world directions.
    pub(crate) fn place(&self, vertex: u32) -> Vec3 {
        self.places[vertex as usize]
    }

    /// Returns the origin of [`Wall::place`], world mm LPS.
    pub(crate) fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Returns the unit normal at a vertex, into the lumen; zero where the surface has none.
    pub fn normal(&self, vertex: u32) -> Vec3 {
        self.normals[vertex as usize]
    }

    /// Returns a vertex' share of the surface, mm².
    pub fn area(&self, vertex: u32) -> f32 {
        self.areas[vertex as usize]
    }

    /// Returns the principal curvatures at a vertex, 1/mm, the larger one first. They are positive where the wall bulges
    /// into the lumen: both are 1/R on a ball of tissue of radius R.
    pub fn curvatures(&self, vertex: u32) -> [f32; 2] {
        self.curvatures[vertex as usize]
    }

    /// Returns the shape index at a vertex: 1 on a cap, ¾ on a ridge, ½ on a saddle, 0 in a cup (Koenderink and van Doorn
    /// 1992, scaled as by Yoshida and Näppi 2001); ½ on a plane.
    pub fn shape_index(&self, vertex: u32) -> f32 {
        let [k1, k2] = self.curvatures(vertex);
        // atan2 is right also where both are equal.
        if k1 == 0.0 && k2 == 0.0 { 0.5 } else { 0.5 + (k1 + k2).atan2(k1 - k2) / std::f32::consts::PI }
    }

    /// Returns the curvedness at a vertex, √((k1² + k2²)/2), 1/mm.
    pub fn curvedness(&self, vertex: u32) -> f32 {
        let [k1, k2] = self.curvatures(vertex);
        (0.5 * (k1 * k1 + k2 * k2)).sqrt()
    }

    /// Returns the vertices that share an edge with a vertex.
    pub fn beside(&self, vertex: u32) -> &[u32] {
        &self.beside[self.corners(vertex)]
    }

    /// Returns the triangles around a vertex, by their other two vertices, counter-clockwise as seen from the tissue.
    pub fn around(&self, vertex: u32) -> impl Iterator<Item = [u32; 2]> {
        let beside = self.beside(vertex);
        (0..beside.len()).map(|n| [beside[n], beside[(n + 1) % beside.len()]])
    }

    fn corners(&self, vertex: u32) -> Range<usize> {
        self.begins[vertex as usize] as usize..self.begins[vertex as usize + 1] as usize
    }

    /// Returns the vertex nearest to a position (world, mm) within a distance.
    pub fn nearest(&self, world: DVec3, within_mm: f64) -> Option<u32> {
        let at = (world - self.origin).as_vec3();
        let most = (within_mm * within_mm) as f32;
        let near = |(n, p): (usize, &Vec3)| (p.distance_squared(at), n as u32);
        let least = |a: (f32, u32), b: (f32, u32)| if (b.0, b.1) < (a.0, a.1) { b } else { a };
        let (square, vertex) = self.places.par_iter().enumerate().map(near).reduce(|| (f32::INFINITY, u32::MAX), least);
        (square <= most).then_some(vertex)
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.places.as_slice())
            + size_of_val(self.normals.as_slice())
            + size_of_val(self.areas.as_slice())
            + size_of_val(self.curvatures.as_slice())
            + size_of_val(self.begins.as_slice())
            + size_of_val(self.beside.as_slice())
    }

    /// Returns the positions, as of [`Wall::place`], smoothed along the surface by [`SMOOTH_MM`].
    pub(crate) fn smooth_places(&self, progress: &Progress) -> Result<Vec<Vec3>> {
        let [places] = self.smoothed([&self.places], self.smoothing_steps().min(MOST_STEPS), progress)?;
        Ok(places)
    }

    /// Returns the number of steps of [`Wall::smoothed`] that make a Gaussian of [`SMOOTH_MM`].
    fn smoothing_steps(&self) -> usize {
        // Variance of one step along one axis of the surface, as a mean over the surface.
        let spread = |v: u32| {
            let own = self.area(v);
            let (mut sum, mut weight) = (0.0, own);
            for &n in self.beside(v) {
                sum += self.area(n) * self.place(n).distance_squared(self.place(v));
                weight += self.area(n);
            }
            if weight > 0.0 { [f64::from(own * 0.5 * sum / weight), f64::from(own)] } else { [0.0; 2] }
        };
        let vertices: Vec<u32> = (0..self.len() as u32).collect();
        let add = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
        let parts: Vec<[f64; 2]> =
            vertices.par_chunks(CHUNK).map(|part| part.iter().map(|&v| spread(v)).fold([0.0; 2], add)).collect();
        let [sum, area] = parts.into_iter().fold([0.0; 2], add);
        if sum > 0.0 { ((SMOOTH_MM * SMOOTH_MM * area / sum).round() as usize).max(1) } else { 0 }
    }

    /// Returns some values of each vertex after some steps. In each, a vertex takes the mean of its value and those beside it, weighted by
    /// area. Values that are smoothed together are read together.
    fn smoothed<const N: usize>(
        &self,
        values: [&[Vec3]; N],
        steps: usize,
        progress: &Progress,
    ) -> Result<[Vec<Vec3>; N]> {
        let Some(before_last) = steps.checked_sub(1) else { return Ok(values.map(<[Vec3]>::to_vec)) };
        // A value times its area, and the area: so much of the sum is the same for all vertices that read it.
        let weighted = |value: Vec3, v: usize| (value * self.areas[v]).extend(self.areas[v]);
        let sums = |from: &[[Vec4; N]], v: usize| {
            self.beside(v as u32).iter().fold(from[v], |mut sums, &n| {
                sums.iter_mut().zip(&from[n as usize]).for_each(|(sum, value)| *sum += *value);
                sums
            })
        };
        let own = |v: usize| values.map(|values| weighted(values[v], v));
        let mut from: Vec<[Vec4; N]> = (0..self.len()).into_par_iter().map(own).collect();
        let mut to = vec![[Vec4::ZERO; N]; self.len()];
        for step in 0..steps {
            to.par_iter_mut().enumerate().for_each(|(v, to)| {
                let sums = sums(&from, v);
                // Without an area, the value stays and counts for nothing.
                *to = match sums[0].w > 0.0 {
                    true if step < before_last => sums.map(|sum| weighted((sum / sum.w).truncate(), v)),
                    true => sums.map(|sum| sum / sum.w),
                    false if step < before_last => from[v],
                    false => values.map(|values| values[v].extend(0.0)),
                };
            });
            std::mem::swap(&mut from, &mut to);
            progress.check()?;
        }
        drop(to);
        Ok(std::array::from_fn(|n| from.par_iter().map(|all| all[n].truncate()).collect()))
    }

    /// Returns the principal curvatures of a vertex, for other positions and normals than its own.
    pub(super) fn curvatures_at(&self, v: u32, places: &[Vec3], normals: &[Vec3]) -> [f32; 2] {
        let (own, change) = (places[v as usize], normals[v as usize]);
        let normal = change.normalize_or_zero();
        if normal == Vec3::ZERO {
            return [0.0; 2];
        }
        let (u, w) = normal.any_orthonormal_pair();
        let (mut sxx, mut sxy, mut syy) = (0f32, 0f32, 0f32);
        let (mut a, mut b, mut c) = (0f32, 0f32, 0f32);
        for &n in self.beside(v) {
            let (step, change, area) = (places[n as usize] - own, normals[n as usize] - change, self.area(n));
            let (x, y) = (step.dot(u), step.dot(w));
            let (dx, dy) = (change.dot(u), change.dot(w));
            sxx += area * x * x;
            sxy += area * x * y;
            syy += area * y * y;
            a += area * x * dx;
            b += area * (y * dx + x * dy);
            c += area * y * dy;
        }
        // [sxx sxy 0; sxy sxx+syy sxy; 0 sxy syy] · [p q r] = [a b c], the normal equations of S = [p q; q r].
        let trace = sxx + syy;
        let det = trace * (sxx * syy - sxy * sxy);
        // The neighbours are on one line.
        if det.abs() < 1e-4 * trace * trace * trace || !det.is_finite() {
            return [0.0; 2];
        }
        let q = sxx * syy * b - sxy * (syy * a + sxx * c);
        let q = q / det;
        let (p, r) = ((a - sxy * q) / sxx.max(f32::MIN_POSITIVE), (c - sxy * q) / syy.max(f32::MIN_POSITIVE));
        let (half, off) = (0.5 * (p + r), (0.25 * (p - r) * (p - r) + q * q).sqrt());
        let both = [half + off, half - off];
        if both.iter().all(|k| k.is_finite()) { both } else { [0.0; 2] }
    }
}

/// Returns the normals of vertices, into the lumen and weighted by the triangles' areas, and each vertex' third of the
/// area of its triangles.
fn facing(places: &[Vec3], triangles: &[[u32; 3]]) -> (Vec<Vec3>, Vec<f32>) {
    let mut normals = vec![Vec3::ZERO; places.len()];
    let mut areas = vec![0f32; places.len()];
    for t in triangles {
        let [a, b, c] = t.map(|v| places[v as usize]);
        // Counter-clockwise as seen from the tissue.
        let normal = 0.5 * (c - a).cross(b - a);
        let third = normal.length() / 3.0;
        for &v in t {
            normals[v as usize] += normal;
            areas[v as usize] += third;
        }
    }
    normals.par_iter_mut().for_each(|n| *n = n.normalize_or_zero());
    (normals, areas)
}

/// Returns where the sides of each vertex begin, and the sides: the other two vertices of its triangles.
fn sides(vertices: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 2]>) {
    let mut begins = vec![0u32; vertices + 1];
    for &v in triangles.as_flattened() {
        begins[v as usize + 1] += 1;
    }
    for n in 1..begins.len() {
        begins[n] += begins[n - 1];
    }
    let mut next = begins.clone();
    let mut sides = vec![[0u32; 2]; 3 * triangles.len()];
    for &[a, b, c] in triangles {
        for (v, side) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
            sides[next[v as usize] as usize] = side;
            next[v as usize] += 1;
        }
    }
    (begins, sides)
}

/// Returns the neighbours of each vertex in their order around it, given its sides. On a closed surface the triangles around a vertex
/// form one fan.
fn fans(begins: &[u32], mut sides: Vec<[u32; 2]>) -> Vec<u32> {
    let mut parts = Vec::new();
    let mut rest = sides.as_mut_slice();
    for first in (0..begins.len() - 1).step_by(CHUNK) {
        let begins = &begins[first..(first + CHUNK + 1).min(begins.len())];
        let (own, after) = rest.split_at_mut((begins[begins.len() - 1] - begins[0]) as usize);
        parts.push((begins, own));
        rest = after;
    }
    parts.into_par_iter().for_each(|(begins, sides)| {
        // Each side begins where the one before ends.
        for fan in begins.windows(2) {
            let fan = &mut sides[(fan[0] - begins[0]) as usize..(fan[1] - begins[0]) as usize];
            for n in 1..fan.len() {
                let end = fan[n - 1][1];
                if let Some(follows) = fan[n..].iter().position(|s| s[0] == end) {
                    fan.swap(n, n + follows);
                }
            }
        }
    });
    let mut beside: Vec<u32> = sides.into_iter().map(|s| s[0]).collect();
    // It may have taken over the memory of the sides.
    beside.shrink_to_fit();
    beside
}
