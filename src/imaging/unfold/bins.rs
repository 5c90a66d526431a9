//! The wall's triangles, sorted by where they are.

use glam::{DVec3, Vec3};

use super::chart::Chart;

/// Side of a bin, mm.
const BIN_MM: f32 = 4.0;
/// A triangle reaches at most this far from its centre, mm, unless voxels are very large.
const REACH_MM: f32 = 4.0;

/// Triangles of a chart by the bin of their centre.
#[derive(Clone, Debug)]
pub(super) struct Bins {
    low: Vec3,
    dims: [usize; 3],
    begins: Vec<u32>,
    triangles: Vec<u32>,
}

impl Bins {
    pub(super) fn new(chart: &Chart) -> Self {
        let far = |low: Vec3, p: &Vec3| low.min(*p);
        let low = chart.places.iter().fold(Vec3::splat(f32::INFINITY), far);
        let high = chart.places.iter().fold(Vec3::splat(f32::NEG_INFINITY), |high, p| high.max(*p));
        let dims = ((high - low) / BIN_MM).to_array().map(|n| n.max(0.0) as usize + 1);
        let bin = |t: &[u32; 3]| {
            let centre = t.iter().map(|&v| chart.places[v as usize]).sum::<Vec3>() / 3.0;
            let at = ((centre - low) / BIN_MM).to_array();
            let [i, j, k]: [usize; 3] = std::array::from_fn(|a| (at[a].max(0.0) as usize).min(dims[a] - 1));
            i + dims[0] * (j + dims[1] * k)
        };
        let mut begins = vec![0u32; dims.iter().product::<usize>() + 1];
        for t in &chart.triangles {
            begins[bin(t) + 1] += 1;
        }
        for n in 1..begins.len() {
            begins[n] += begins[n - 1];
        }
        let (mut next, mut triangles) = (begins.clone(), vec![0; chart.triangles.len()]);
        for (n, t) in chart.triangles.iter().enumerate() {
            let at = &mut next[bin(t)];
            triangles[*at as usize] = n as u32;
            *at += 1;
        }
        Self { low, dims, begins, triangles }
    }

    /// Returns the triangle with coordinates nearest to a place (world, mm) within `most_mm`, the shares of its corners in its point
    /// nearest to the place, and that point.
    pub(super) fn nearest(&self, chart: &Chart, world: DVec3, most_mm: f64) -> Option<(usize, [f32; 3], DVec3)> {
        let at = (world - chart.origin).as_vec3();
        if !at.is_finite() {
            return None;
        }
        let within = |most: f32| {
            let reach = most + REACH_MM;
            let range = |a: usize| {
                let bin = |x: f32| ((x - self.low[a]) / BIN_MM).floor();
                bin(at[a] - reach).max(0.0) as usize..((bin(at[a] + reach) + 1.0).max(0.0) as usize).min(self.dims[a])
            };
            let mut best: Option<(f32, usize, [f32; 3])> = None;
            for (k, j) in range(2).flat_map(|k| range(1).map(move |j| (k, j))) {
                for i in range(0) {
                    let bin = i + self.dims[0] * (j + self.dims[1] * k);
                    for &t in &self.triangles[self.begins[bin] as usize..self.begins[bin + 1] as usize] {
                        let corners = chart.triangles[t as usize].map(|v| chart.places[v as usize]);
                        let shares = nearest(corners, at);
                        let point = corners[0] * shares[0] + corners[1] * shares[1] + corners[2] * shares[2];
                        let square = point.distance_squared(at);
                        if square <= most * most
                            && best.is_none_or(|b| square < b.0)
                            && chart.flat(t as usize).is_some()
                        {
                            best = Some((square, t as usize, shares));
                        }
                    }
                }
            }
            best
        };
        let (_, triangle, shares) = within(1.0).or_else(|| within(most_mm as f32))?;
        let corners = chart.triangles[triangle].map(|v| chart.places[v as usize]);
        let point = corners[0] * shares[0] + corners[1] * shares[1] + corners[2] * shares[2];
        Some((triangle, shares, chart.origin + point.as_dvec3()))
    }
}

/// Returns the shares of a triangle's corners in its point nearest to `p` (Ericson, *Real-Time Collision Detection*, 2005, 5.1.5).
fn nearest([a, b, c]: [Vec3; 3], p: Vec3) -> [f32; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - w, w];
    }
    let sum = va + vb + vc;
    [va / sum, vb / sum, vc / sum]
}
