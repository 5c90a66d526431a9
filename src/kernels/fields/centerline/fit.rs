//! Fitting of a line of largest balls to the lumen's axis.
//!
//! Folds stand into the lumen from one side and push the largest ball to the other, so a line of such balls swings
//! around the axis from haustrum to haustrum. This module instead cuts the lumen across the line, by rays to the wall.
//! For each direction, the median radius over a stretch as long as a haustrum skips folds, polyps and strands. The line
//! then moves by the centroids of these cross-sections, smoothed along it.

use std::f64::consts::TAU;

use glam::DVec3;
use rayon::prelude::*;

use super::polyline::{is_free, smoothed};
use crate::fields::WallDistance;
use crate::math::reflection::doubly_reflected;

/// Number of rays in a cross-section.
const RAYS: usize = 48;
/// Number of rounds of cutting and moving.
const ROUNDS: usize = 4;
/// Half the length of the stretch whose cross-sections are combined, mm: a haustrum is about 25 mm long.
const HALF_MM: f64 = 14.0;
/// Standard deviations of the smoothing, mm: of the line before cutting, and of the centroids along it.
const LINE_MM: f64 = 5.0;
const OFFSET_MM: f64 = 7.0;
/// Maximum ray length as a multiple of the wall distance at the line; a longer ray has left the cross-section.
const FAR: f64 = 3.0;
/// A moved point keeps at least this fraction of the input line's clearance, but never needs more than [`AMPLE_MM`].
const KEPT: f64 = 0.6;
const AMPLE_MM: f64 = 4.0;
/// Number of points over which the line blends from the input to the fitted one.
const EASE: usize = 5;

/// A frame perpendicular to the line at a point.
#[derive(Clone, Copy, Debug)]
struct Across {
    u: DVec3,
    v: DVec3,
}

/// Moves a free line (world, points about `step` mm apart) towards the lumen's axis, as far as it stays free.
pub(super) fn to_axis(walls: &WallDistance, line: &[DVec3], step: f64) -> Vec<DVec3> {
    if line.len() < 5 {
        return line.to_vec();
    }
    let ease = ends_eased(line.len(), step);
    let mut fitted = line.to_vec();
    for _ in 0..ROUNDS {
        let even = smoothed(&fitted, LINE_MM / step);
        let moved = offsets(walls, &even, step);
        let moved = smoothed(&moved, OFFSET_MM / step);
        fitted =
            even.iter().zip(&moved).zip(line.iter().zip(&ease)).map(|((p, m), (l, &e))| l.lerp(*p + *m, e)).collect();
    }
    kept_free(walls, line, &fitted)
}

/// Returns how far each point may leave the input line. The ends stay, since they are centres of balls.
fn ends_eased(count: usize, step: f64) -> Vec<f64> {
    let share = |n: usize| {
        let t = (n.min(count - 1 - n) as f64 * step / HALF_MM).min(1.0);
        t * t * (3.0 - 2.0 * t)
    };
    (0..count).map(share).collect()
}

/// Returns the offsets of the cross-sections' centroids from the line's points.
fn offsets(walls: &WallDistance, line: &[DVec3], step: f64) -> Vec<DVec3> {
    let frames = frames(line);
    let radii: Vec<[f32; RAYS]> = line.par_iter().zip(&frames).map(|(&p, f)| cut(walls, p, f)).collect();
    let half = (HALF_MM / step).round() as usize;
    (0..line.len())
        .into_par_iter()
        .map(|n| {
            let reach = half.min(n).min(line.len() - 1 - n);
            let near = &radii[n - reach..=n + reach];
            let mut column: Vec<f32> = Vec::with_capacity(near.len());
            let radius: [f64; RAYS] = std::array::from_fn(|r| {
                column.clear();
                column.extend(near.iter().map(|c| c[r]).filter(|r| *r > 0.0));
                if column.is_empty() {
                    return 0.0;
                }
                let middle = column.len() / 2;
                f64::from(*column.select_nth_unstable_by(middle, f32::total_cmp).1)
            });
            centroid(&radius, &frames[n])
        })
        .collect()
}

/// Returns the centroid of the polygon of ray ends, relative to the rays' origin.
fn centroid(radius: &[f64; RAYS], frame: &Across) -> DVec3 {
    let ray = |r: usize| {
        let (sin, cos) = (TAU * r as f64 / RAYS as f64).sin_cos();
        (radius[r % RAYS] * cos, radius[r % RAYS] * sin)
    };
    let (mut area, mut x, mut y) = (0.0, 0.0, 0.0);
    for r in 0..RAYS {
        let (a, b) = (ray(r), ray(r + 1));
        let twice = a.0 * b.1 - a.1 * b.0;
        area += twice;
        x += twice * (a.0 + b.0) / 3.0;
        y += twice * (a.1 + b.1) / 3.0;
    }
    if area > 1e-9 { (frame.u * x + frame.v * y) / area } else { DVec3::ZERO }
}

/// Returns rotation-minimising frames along the line (double reflection), so that the rays of neighbouring
/// cross-sections correspond.
fn frames(line: &[DVec3]) -> Vec<Across> {
    let last = line.len() - 1;
    let tangent = |n: usize| (line[(n + 1).min(last)] - line[n.saturating_sub(1)]).normalize_or(DVec3::Z);
    let mut u = tangent(0).any_orthonormal_vector();
    (0..line.len())
        .map(|n| {
            let t = tangent(n);
            if n > 0 {
                u = doubly_reflected(u, [line[n - 1], line[n]], [tangent(n - 1), t]);
            }
            u = (u - t * t.dot(u)).try_normalize().unwrap_or_else(|| t.any_orthonormal_vector());
            Across { u, v: t.cross(u) }
        })
        .collect()
}

/// Returns the distances to the wall along the rays across the line, mm; 0 if a ray leaves the cross-section without hitting it.
fn cut(walls: &WallDistance, at: DVec3, frame: &Across) -> [f32; RAYS] {
    let grid = walls.grid();
    let centre = grid.voxel(at);
    let linear = grid.to_voxel().matrix3;
    let least = 0.35 * grid.min_spacing();
    let clear = f64::from(walls.at(walls.voxel(at)).unwrap_or(0.0).max(0.0));
    let far = FAR * clear.max(3.0 * grid.min_spacing());
    std::array::from_fn(|r| {
        let (sin, cos) = (TAU * r as f64 / RAYS as f64).sin_cos();
        let way = linear * (frame.u * cos + frame.v * sin);
        let (mut t, mut last) = (0.0, (0.0, clear));
        while t < far {
            let d = walls.at((centre + way * t).to_array().map(|x| x.round() as i64)).map_or(-1.0, f64::from);
            if d < 0.0 {
                // Interpolate the wall between the last free position and this one, by their wall distances.
                let share = if last.1 - d > 0.0 { last.1 / (last.1 - d) } else { 0.5 };
                return (last.0 + (t - last.0) * share.clamp(0.0, 1.0)) as f32;
            }
            last = (t, d);
            t += (0.8 * d).max(least);
        }
        0.0
    })
}

/// Returns the values within [`EASE`] points of point `n`.
fn around(values: &[f64], n: usize) -> &[f64] {
    &values[n.saturating_sub(EASE)..(n + EASE + 1).min(values.len())]
}

/// Returns the fitted line where it is free. Elsewhere it moves towards the input line, which is free, only as far as necessary.
fn kept_free(walls: &WallDistance, line: &[DVec3], fitted: &[DVec3]) -> Vec<DVec3> {
    let clear = |p: DVec3| f64::from(walls.at(walls.voxel(p)).unwrap_or(-1.0));
    let mut share: Vec<f64> = line
        .par_iter()
        .zip(fitted)
        .map(|(&l, &f)| {
            let least = (KEPT * clear(l)).clamp(0.0, AMPLE_MM);
            [1.0, 0.75, 0.5, 0.25].into_iter().find(|&s| clear(l.lerp(f, s)) >= least).unwrap_or(0.0)
        })
        .collect();
    // Keep the neighbours of a constrained point near the input line too, so that the line has no steps.
    let least: Vec<f64> = (0..share.len()).map(|n| around(&share, n).iter().copied().fold(1.0, f64::min)).collect();
    share = (0..share.len()).map(|n| around(&least, n).iter().sum::<f64>() / around(&least, n).len() as f64).collect();
    let at = |share: &[f64], n: usize| line[n].lerp(fitted[n], share[n]);
    loop {
        let blocked: Vec<usize> =
            (1..line.len()).filter(|&n| !is_free(walls, at(&share, n - 1), at(&share, n))).collect();
        if blocked.iter().all(|&n| share[n - 1] == 0.0 && share[n] == 0.0) {
            break;
        }
        for n in blocked {
            for m in [n - 1, n] {
                share[m] = if share[m] > 0.1 { 0.5 * share[m] } else { 0.0 };
            }
        }
    }
    (0..line.len()).map(|n| at(&share, n)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays end at a wall of two fifths of a millimetre with lumen behind it, where voxels are half as large.
    #[test]
    fn rays_pass_no_thin_wall_of_small_voxels() {
        let middle = DVec3::new(3.0, 3.0, 2.0);
        let walls = WallDistance::drawn([31, 31, 21], DVec3::splat(0.2), |p| {
            let r = (p.x - middle.x).hypot(p.y - middle.y);
            !(1.0..1.4).contains(&r)
        });
        let radii = cut(&walls, middle, &Across { u: DVec3::X, v: DVec3::Y });
        for (n, mm) in radii.into_iter().enumerate() {
            assert!((0.7..1.4).contains(&mm), "ray {n} ends after {mm} mm");
        }
    }
}
