//! Placement of collapsed stretches: drawn from the seed, away from limbs that touch.

use super::centerline::Centerline;
use super::collapse::Collapse;
use super::shape::Shape;
use super::stream::stream;
use super::touching::Touching;

/// Returns the collapsed stretches of a colon, in the order of the axis: one in the sigmoid, one in the descending colon, and for
/// two seeds of three another one, in the transverse or ascending colon or at the splenic flexure.
fn place(axis: &Centerline, seed: u64) -> Vec<Collapse> {
    let mut draw = stream(seed, 96);
    let small = axis.length() < 1000.0;
    // The middles of the stretches, in control points from the rectum.
    let (sigmoid, descending) = (draw.within(6.2, 8.8), draw.within(12.4, 13.4));
    let third = [None, Some(draw.within(18.8, 20.4)), Some([24.9, 15.6][(seed / 3 % 2) as usize])][(seed % 3) as usize];
    let stations = axis.stations();
    let place = |middle: f64| {
        let i = middle as usize;
        let s = stations[i] + (stations[i + 1] - stations[i]) * middle.fract();
        let half = 0.5 * if small { draw.within(12.0, 26.0) } else { draw.within(14.0, 45.0) };
        Collapse { from: s - half, to: s + half, taper: 8.0 + axis.profile(s).radius.0 }
    };
    [Some(sigmoid), Some(descending), third].into_iter().flatten().map(place).collect()
}

/// Closes the lumen where [`place`] says, and removes the polyps and strands that would be there.
pub(crate) fn close(shape: &mut Shape, seed: u64) {
    let mut collapsed = place(&shape.axis, seed);
    // Limbs that touch are open.
    let touching: Vec<_> = shape.touching.iter().flat_map(Touching::stretches).collect();
    collapsed.retain(|c| touching.iter().all(|[from, to]| c.from - c.taper > *to || c.to + c.taper < *from));
    let free = |s: f64| collapsed.iter().all(|c| !(c.from - c.taper..=c.to + c.taper).contains(&s));
    shape.polyps.retain(|p| free(p.s));
    shape.bridges.retain(|b| free(b.s));
    shape.collapsed = collapsed;
}
