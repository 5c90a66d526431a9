//! Placement of collapsed stretches: drawn from the seed, away from limbs that touch.

use super::centerline::Centerline;
use super::collapse::Collapse;
use super::decoys::Body;
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

/// Range of the length of [`close_another`]'s stretch, mm; in a small colon it is at most the shorter length.
const ANOTHER_MM: [f64; 2] = [25.0, 50.0];
const ANOTHER_SMALL_MM: f64 = 32.0;
/// Length at the rectal and at the cecal end that [`close_another`] leaves open, mm.
const OPEN_MM: [f64; 2] = [100.0, 80.0];
/// Distance from a stretch, with its tapers, at which it does not concern what is on the wall, mm.
const BESIDE_MM: f64 = 6.0;

/// Closes one stretch away from the ends and from the stretches to `avoid` (arc lengths, mm), where the fewest polyps, strands and decoys
/// are.
pub(crate) fn close_another(shape: &mut Shape, avoid: &[[f64; 2]], seed: u64) {
    let mut draw = stream(seed, 142);
    let (axis, end) = (&shape.axis, shape.axis.length());
    let most = if end < 1000.0 { ANOTHER_SMALL_MM } else { ANOTHER_MM[1] };
    let half = 0.5 * draw.within(ANOTHER_MM[0], most);
    let decoys = shape.decoys.iter().filter(|d| !matches!(d.body, Body::Folds)).map(|d| d.s);
    let things = (shape.polyps.iter().map(|a| a.s)).chain(shape.lesions.iter().map(|a| a.s));
    let things: Vec<f64> = things.chain(shape.bridges.iter().map(|a| a.s)).chain(decoys).collect();
    let at = |s: f64| Collapse { from: s - half, to: s + half, taper: 8.0 + axis.profile(s).radius.0 };
    let cost = |c: &Collapse| {
        let reach = c.taper + BESIDE_MM;
        let inside = things.iter().filter(|s| (c.from - reach..=c.to + reach).contains(*s)).count();
        let meets = avoid.iter().filter(|[from, to]| c.from - reach <= *to && c.to + reach >= *from).count();
        inside + 100 * meets
    };
    let ends = |c: &Collapse| c.from - c.taper >= OPEN_MM[0] && c.to + c.taper <= end - OPEN_MM[1];
    let all: Vec<_> =
        (0..(end / 3.0) as usize).map(|i| at(3.0 * i as f64)).filter(ends).map(|c| (cost(&c), c)).collect();
    let least = all.iter().map(|(cost, _)| *cost).min();
    let best: Vec<Collapse> = all.into_iter().filter(|(cost, _)| Some(*cost) == least).map(|(_, c)| c).collect();
    shape.collapsed = if best.is_empty() { Vec::new() } else { vec![best[draw.below(best.len())]] };
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
