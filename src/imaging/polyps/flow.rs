//! The flow that flattens protrusions: ∂x/∂τ = −max(k2, 0) n, until nothing bulges in every direction any more (van Wijk 2010).
//!
//! Ridges stay, since k2 ≤ 0 there; a cap sinks until it is as straight in one direction as the wall around it. How far a vertex has sunk
//! is its protrusion. It reads low, since the cap hangs on the rim where k2 vanishes.
//!
//! k2 is that of [`Wall::curvatures`](super::Wall::curvatures), of the surface as it is then, as a mean over the vertices beside. Steps are
//! explicit (Euler), of first order in τ, which does not matter for the state that they end in. The flow is parabolic: a step of up to
//! h²/2 is stable, with h the distance of neighbours; [`STEP`] is a third of that for the mean h², and no vertex moves farther than
//! [`MOST_MM`] at once, so that slivers do not turn over.

use glam::Vec3;
use rayon::prelude::*;

use super::Wall;
use crate::error::Result;
use crate::progress::Progress;

/// Step, in squared distances between neighbours.
const STEP: f32 = 0.17;
/// Farthest move of a step, mm.
const MOST_MM: f32 = 0.08;
/// Steps at most.
const STEPS: usize = 400;
/// A step that moves nothing farther than this is the last one, mm.
const STILL_MM: f32 = 2e-3;
/// Steps of the smoothing that makes axes of normals: a Gaussian of about 4 mm.
const BROAD: usize = 120;
/// Least cosine of a normal and its axis.
const STEEP: f32 = 0.35;
/// Only vertices that bulge this much in every direction may sink, 1/mm, and those this many edges around them.
const LEAST_K2: f32 = 0.015;
const AROUND: usize = 5;

/// Returns how far each vertex sinks, mm.
pub(crate) fn protrusions(wall: &Wall, progress: &Progress) -> Result<Vec<f32>> {
    let mut places = wall.smooth_places(progress)?;
    let mut sunk = vec![0f32; wall.len()];
    let first = (0..wall.len() as u32).filter(|&v| wall.curvatures(v)[1] > LEAST_K2).collect();
    let active = grown(wall, first, AROUND);
    // What the moves of those depend on: curvatures beside them, and normals beside those.
    let curved = grown(wall, active.clone(), 1);
    let facing = grown(wall, curved.clone(), 1);
    let mut normals: Vec<Vec3> = (0..wall.len() as u32).map(|v| wall.normal(v)).collect();
    let mut axes = normals.clone();
    for _ in 0..BROAD {
        scatter(&mut axes, &facing, |axes, v| {
            let own = axes[v as usize] * wall.area(v);
            wall.beside(v).iter().fold(own, |sum, &n| sum + axes[n as usize] * wall.area(n)).normalize_or_zero()
        });
    }
    let mut k2 = vec![0f32; wall.len()];
    let square = |v: &u32| {
        let beside = wall.beside(*v);
        beside.iter().map(|&n| wall.place(n).distance_squared(wall.place(*v))).sum::<f32>() / beside.len().max(1) as f32
    };
    let step = STEP * active.iter().map(square).sum::<f32>() / active.len().max(1) as f32;
    for _ in 0..STEPS {
        progress.check()?;
        scatter(&mut normals, &facing, |_, v| {
            let at = |n: u32| places[n as usize] - places[v as usize];
            wall.around(v).map(|[a, b]| at(b).cross(at(a))).sum::<Vec3>().normalize_or_zero()
        });
        scatter(&mut k2, &curved, |_, v| wall.curvatures_at(v, &places, &normals)[1]);
        let mean = |v: u32| {
            let (sum, area) = wall.beside(v).iter().chain([&v]).fold((0.0, 0.0), |(sum, area), &n| {
                (sum + wall.area(n) * k2[n as usize].max(0.0), area + wall.area(n))
            });
            if area > 0.0 { sum / area } else { 0.0 }
        };
        let moves: Vec<f32> = active.par_iter().map(|&v| (step * mean(v)).clamp(0.0, MOST_MM)).collect();
        for (&v, &mm) in active.iter().zip(&moves) {
            let v = v as usize;
            // A wall that is steep sinks faster along the axis than along its normal.
            let mm = mm / normals[v].dot(axes[v]).max(STEEP);
            places[v] -= axes[v] * mm;
            sunk[v] += mm;
        }
        if moves.iter().all(|&mm| mm < STILL_MM) {
            break;
        }
    }
    Ok(sunk)
}

/// Sets the values of some vertices to what `of` returns, given all values before.
fn scatter<T: Copy + Send + Sync>(values: &mut [T], vertices: &[u32], of: impl Fn(&[T], u32) -> T + Sync) {
    let old: &[T] = values;
    let new: Vec<T> = vertices.par_iter().map(|&v| of(old, v)).collect();
    vertices.iter().zip(new).for_each(|(&v, value)| values[v as usize] = value);
}

/// Returns vertices and those up to some edges around them, in their order.
fn grown(wall: &Wall, first: Vec<u32>, edges: usize) -> Vec<u32> {
    let mut is_in = vec![false; wall.len()];
    first.iter().for_each(|&v| is_in[v as usize] = true);
    let mut front = first;
    for _ in 0..edges {
        let mut next = Vec::new();
        for &v in &front {
            next.extend(wall.beside(v).iter().filter(|&&n| !std::mem::replace(&mut is_in[n as usize], true)));
        }
        front = next;
    }
    (0..wall.len() as u32).filter(|&v| is_in[v as usize]).collect()
}
