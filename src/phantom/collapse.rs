//! Collapsed stretches of the colon: the walls touch, and gas is on both sides.

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
