//! The stretches of the colon that the blocks of its wall belong to.

use rayon::prelude::*;

use super::wall::Wall;
use crate::fields::Lumen;
use crate::fields::lumen::CoarseAlong;

/// How far before a triangle the gas is that it belongs to, mm.
pub(super) const INTO_GAS_MM: f64 = 0.8;
/// Resolution of places along the colon, mm.
pub(super) const STRETCH_MM: f64 = 5.0;

/// Returns the stretch of the colon that each block belongs to, and the first one of each segment.
pub(super) fn stretches(wall: &Wall, gas: &Lumen, along: &CoarseAlong) -> (Vec<u32>, Vec<u32>) {
    let place = |b: usize| {
        let n = wall.patches[wall.blocks[b].first as usize].middle as usize;
        along.of(wall.centroid(n) + wall.normal(n) * INTO_GAS_MM)
    };
    let places: Vec<Option<(usize, f64)>> = (0..wall.block_count()).into_par_iter().map(place).collect();
    let mut count = vec![1u32; gas.segments.len()];
    for &(segment, mm) in places.iter().flatten() {
        count[segment] = count[segment].max((mm / STRETCH_MM) as u32 + 1);
    }
    let mut first = vec![0; count.len() + 1];
    for n in 0..count.len() {
        first[n + 1] = first[n] + count[n];
    }
    // A block before gas that is too thin for the map belongs to the one before it.
    let mut last = 0;
    let stretches = places
        .into_iter()
        .map(|at| {
            last = at.map_or(last, |(segment, mm)| first[segment] + (mm / STRETCH_MM) as u32);
            last
        })
        .collect();
    (stretches, first)
}
