//! Placement of small bowel and stomach beside the colon.

use super::gut::{Gut, Guts};
use super::shape::Shape;
use super::valve::Valve;
use super::{PhantomSettings, bowel, stomach};

/// Returns the small bowel and stomach of a body of `scale` whose colon has this shape and valve.
pub(crate) fn place(shape: &Shape, scale: f64, valve: Option<&Valve>, settings: &PhantomSettings) -> Guts {
    let radius = |i: usize| shape.largest_radius(i as f64 * shape.axis.knot_step());
    let mut taken: Vec<_> = shape.axis.knots().iter().enumerate().map(|(i, c)| (*c, radius(i))).collect();
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
