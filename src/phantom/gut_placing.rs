//! Placement of small bowel and stomach beside the colon.

use glam::DVec3;

use super::gut::{Gut, Guts};
use super::shape::Shape;
use super::valve::Valve;
use super::{PhantomSettings, bowel, stomach};

/// Returns the small bowel and stomach of a body of `scale` whose colon has this shape and valve.
pub(crate) fn place(shape: &Shape, scale: f64, valve: Option<&Valve>, settings: &PhantomSettings) -> Guts {
    let mut taken = balls(shape);
    let mut guts = valve.map_or_else(Guts::default, |v| bowel::place(scale, v, &taken, settings.seed));
    taken.extend(guts.tubes.iter().flat_map(Gut::balls));
    if settings.stomach {
        let stomach = stomach::place(scale, &taken, settings.position.down(), settings.seed);
        taken.extend(stomach.balls());
        guts.tubes.push(stomach);
    }
    if valve.is_some() {
        guts.tubes.extend(bowel::jejunum(scale, &taken, settings.seed));
    }
    guts
}

/// Returns the least tissue between gut and the plain wall of a colon in a body of `scale`, mm, except where the ileum meets its valve.
pub(crate) fn room(guts: &Guts, shape: &Shape, scale: f64, valve: Option<&Valve>) -> f64 {
    let is_apart = |(c, r): &(DVec3, f64)| valve.is_none_or(|v| c.distance(v.spot.at) - r > 24.0 * scale);
    let colon: Vec<_> = balls(shape).into_iter().filter(is_apart).collect();
    guts.tubes.iter().map(|tube| tube.clearance(&colon)).fold(f64::INFINITY, f64::min)
}

/// Returns the balls about the axis in which the colon lies, one for each knot: centres (world mm) and radii (mm).
fn balls(shape: &Shape) -> Vec<(DVec3, f64)> {
    let radius = |i: usize| shape.largest_radius(i as f64 * shape.axis.knot_step());
    shape.axis.knots().iter().enumerate().map(|(i, c)| (*c, radius(i))).collect()
}
