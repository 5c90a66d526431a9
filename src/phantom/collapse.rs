//! Collapsed stretches of the colon: the walls touch, and gas is on both sides.

use super::centerline::Centerline;
use super::features::Stream;
use super::shape::Shape;
use super::touching::Touching;

/// How far the walls overlap within a stretch, mm, so that no blur reaches through.
const OVERLAP_MM: f64 = 2.2;
/// Arc length within which the overlap grows, mm.
const GROWS_MM: f64 = 5.0;
/// Tissue around a closed lumen beyond what surrounds an open one, mm.
const CORD_MM: f64 = 4.0;

/// A stretch where the lumen is closed, and how it tapers at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Collapse {
    /// Arc lengths between which the lumen is closed, mm.
    pub from: f64,
    /// See `from`.
    pub to: f64,
    /// Arc length over which the lumen tapers before and behind the stretch, mm.
    pub taper: f64,
}

impl Collapse {
    /// Returns true if the stretch changes the lumen at arc length `s`.
    pub(crate) fn concerns(&self, s: f64) -> bool {
        (self.from - self.taper..=self.to + self.taper).contains(&s)
    }

    /// Returns the share of the radius that is left at arc length `s`, and by how many mm the walls overlap, each followed by
    /// its derivative in s.
    pub(crate) fn closure(&self, s: f64) -> (f64, f64, f64, f64) {
        let step = |x: f64, length: f64| {
            let t = (x / length).clamp(0.0, 1.0);
            (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / length)
        };
        // Outside the stretch, how far away it is; inside, how far its nearer end is.
        let (out, side) = if s < self.from { (self.from - s, -1.0) } else { (s - self.to, 1.0) };
        let (share, share_s) = step(out.max(0.0), self.taper);
        let (depth, inwards) = if s - self.from < self.to - s { (s - self.from, 1.0) } else { (self.to - s, -1.0) };
        let (closed, closed_s) = step(depth, GROWS_MM);
        (share, share_s * side, OVERLAP_MM * closed, OVERLAP_MM * closed_s * inwards)
    }

    /// Returns by how much more tissue surrounds the axis at arc length `s` than an open lumen, mm.
    pub(crate) fn cord_mm(&self, s: f64) -> f64 {
        if self.concerns(s) { CORD_MM * (1.0 - self.closure(s).0) } else { 0.0 }
    }
}

/// Returns the collapsed stretches of a colon, in the order of the axis: one in the sigmoid, one in the descending colon, and for
/// two seeds of three another one, in the transverse or ascending colon or at the splenic flexure.
pub(crate) fn place(axis: &Centerline, seed: u64) -> Vec<Collapse> {
    let mut draw = Stream::new(seed, 96);
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

/// Closes the lumen where [`place`] says, and takes away the polyps and strands that would be there.
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
