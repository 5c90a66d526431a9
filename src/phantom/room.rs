//! Room between the colon's loops.

use std::f64::consts::PI;

use super::centerline::Centerline;
use super::shape;

/// True if no two loops' walls are closer than 4 mm and no bend is so tight that the wall would fold over itself.
pub(crate) fn has_room(axis: &Centerline) -> bool {
    has_room_but(axis, [[0.0; 2]; 2])
}

/// Does the same as [`has_room`], but the loop within the first stretch of arc length may touch the one within the second.
pub(crate) fn has_room_but(axis: &Centerline, touching: [[f64; 2]; 2]) -> bool {
    let tight = |i: usize| {
        let s = i as f64 * axis.knot_step();
        axis.curvature(s) * axis.profile(s).radius.0 > 0.72
    };
    loop_clearance_but(axis, touching) >= 4.0 && !(0..axis.knots().len()).any(tight)
}

/// Returns the least tissue between the plain walls of two loops, mm.
#[cfg(test)]
pub(crate) fn loop_clearance(axis: &Centerline) -> f64 {
    loop_clearance_but(axis, [[0.0; 2]; 2])
}

/// Returns the least tissue between the plain walls of two loops, mm, without those that touch ([`has_room_but`]).
fn loop_clearance_but(axis: &Centerline, [a, b]: [[f64; 2]; 2]) -> f64 {
    let knots = axis.knots();
    let radius: Vec<f64> = (0..knots.len()).map(|i| shape::largest(axis, i as f64 * axis.knot_step())).collect();
    let mut least = f64::INFINITY;
    for i in 0..knots.len() {
        for j in i + 1..knots.len() {
            // Within a half circle around a bend's inner wall it is the same loop.
            let along = (j - i) as f64 * axis.knot_step();
            let is_in =
                |k: usize, [from, to]: [f64; 2]| from < to && (from..=to).contains(&(k as f64 * axis.knot_step()));
            if is_in(i, a) && is_in(j, b) {
                continue;
            }
            if along > PI * 0.5 * (radius[i] + radius[j]) + 20.0 {
                least = least.min((knots[i] - knots[j]).length() - radius[i] - radius[j]);
            }
        }
    }
    least
}
