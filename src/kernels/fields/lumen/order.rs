//! The order from rectum to cecum: the ends of each segment, and the sequence of segments.

use glam::DVec3;

use crate::volume::{Grid, Volume};

/// Maximum number of segments to order (the largest by volume).
const ORDERED_AT_MOST: usize = 9;
/// Cost of a millimetre between two segments joined by tagged fluid.
const FLUID_GAP: f64 = 0.3;
/// Maximum length of a pool at an end, mm.
const POOL_MM: f64 = 120.0;
/// A gap of this length costs twice its millimetres: colon collapses over a few centimetres, seldom over more.
const DEAR_GAP_MM: f64 = 80.0;
/// A gap longer than this costs no more for each of its millimetres.
const DEAREST_MM: f64 = 120.0;
/// For a trusted order: minimum distance of the cecum to the right of the midline, mm.
const CECUM_RIGHT_MM: f64 = 20.0;
/// For a trusted order: maximum distance of the rectum from the midline, mm.
const RECTUM_ASIDE_MM: f64 = 60.0;
/// For a trusted order: maximum gap between two segments, mm.
const WIDEST_GAP_MM: f64 = 220.0;
/// For a trusted order: minimum length from end to end, mm.
const LEAST_COLON_MM: f64 = 200.0;

/// For a trusted order: the rectum is within this fraction of the scanned body's height, from below.
const RECTUM_HEIGHT: f64 = 0.4;

/// Position of the patient, world, mm LPS.
#[derive(Clone, Copy, Debug)]
pub(super) struct Body {
    /// Mean position of the tissue; its x is near the midline.
    pub centre: DVec3,
    /// Minimum and maximum z of the tissue.
    pub span: [f64; 2],
    /// z of the lowest gas of the colon.
    pub lowest: f64,
    /// Size compared with an adult's.
    pub scale: f64,
}

impl Body {
    /// Measures the tissue on every eighth voxel of every eighth row.
    pub(crate) fn of(volume: &Volume, lowest: f64, scale: f64) -> Self {
        let grid: &Grid = volume.grid();
        let [nx, ny, nz] = grid.dims();
        // At least about 16 samples along each axis, so that a small volume is measured too.
        let stride = [nx, ny, nz].map(|n| (n / 16).clamp(1, 8));
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        let mut span = [f64::INFINITY, f64::NEG_INFINITY];
        for k in (0..nz).step_by(stride[2]) {
            for j in (0..ny).step_by(stride[1]) {
                for i in (0..nx).step_by(stride[0]) {
                    if (-150..=300).contains(&volume.data()[grid.index(i, j, k)]) {
                        let p = grid.world(DVec3::new(i as f64, j as f64, k as f64));
                        span = [span[0].min(p.z), span[1].max(p.z)];
                        sum += p;
                        count += 1.0;
                    }
                }
            }
        }
        let middle = (DVec3::new(nx as f64, ny as f64, nz as f64) - 1.0) / 2.0;
        Self { centre: if count > 0.0 { sum / count } else { grid.world(middle) }, span, lowest, scale }
    }

    /// Returns how unlike the rectum a position is, mm in an adult: high, off the midline, or anterior.
    fn unlike_rectum(&self, p: DVec3) -> f64 {
        let mm = (p.z - self.lowest) + (p.x - self.centre.x).abs() + 0.5 * (self.centre.y - p.y).max(0.0);
        mm / self.scale
    }

    /// Returns how unlike the cecum a position is, mm in an adult: not on the right, or high.
    fn unlike_cecum(&self, p: DVec3) -> f64 {
        ((p.x - self.centre.x) / self.scale + 2.0 * CECUM_RIGHT_MM).max(0.0) + 0.3 * (p.z - self.lowest) / self.scale
    }

    /// True for a position near the midline, and low.
    fn may_be_rectum(&self, p: DVec3) -> bool {
        (p.x - self.centre.x).abs() <= RECTUM_ASIDE_MM * self.scale
            && p.z <= self.span[0] + RECTUM_HEIGHT * (self.span[1] - self.span[0])
    }

    /// True for a position on the right.
    fn may_be_cecum(&self, p: DVec3) -> bool {
        p.x <= self.centre.x - CECUM_RIGHT_MM * self.scale
    }
}

/// Input of the ordering: a segment's ends in any order, its length, and the segments that fluid joins to it.
#[derive(Clone, Debug)]
pub(super) struct Link {
    pub ends: [DVec3; 2],
    pub length_mm: f64,
    pub joined_to: Vec<usize>,
    /// The farthest places of its tagged fluid, world, mm: the colon continues there.
    pub fluid: Vec<DVec3>,
    /// Worth of passing it, mm: how much longer a chain may be that does. Infinite if it must be passed.
    pub worth_mm: f64,
}

/// An order of segments.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SegmentOrder {
    /// (segment, true if its ends must be swapped so that the rectal one comes first); those that the chain does not pass come
    /// last.
    pub chain: Vec<(usize, bool)>,
    /// Number of segments that the chain passes.
    pub passed: usize,
    /// True if the chain reliably runs from rectum to cecum.
    pub trusted: bool,
    /// Length of the chain with its gaps, mm.
    pub length_mm: f64,
}

/// Returns the cheapest chain of the segments (given by volume, the largest first) from where a rectum may be to where a cecum may be.
///
/// Each is passed at most once, in either direction; leaving one out costs its worth. The first end's position, the gaps and the
/// last end's position have a cost. Exact, by dynamic programming over subsets (Held and Karp 1962).
pub(super) fn order(links: &[Link], body: &Body) -> SegmentOrder {
    let n = links.len().min(ORDERED_AT_MOST);
    let entry = |s: usize, swapped: bool| links[s].ends[usize::from(swapped)];
    let exit = |s: usize, swapped: bool| links[s].ends[usize::from(!swapped)];
    let gap = |a: usize, b: usize, from: DVec3, to: DVec3| {
        let mm = gap_mm(&links[a], &links[b], from, to) / body.scale;
        if links[a].joined_to.contains(&b) { FLUID_GAP * mm } else { mm * (1.0 + mm.min(DEAREST_MM) / DEAR_GAP_MM) }
    };
    // best[set][state]: least cost of passing `set` and ending in `state` (segment and direction), and the previous state.
    let states = 2 * n;
    let mut best = vec![(f64::INFINITY, usize::MAX); (1 << n) * states];
    for s in 0..states {
        let (cost, at) = rectal(&links[s / 2], entry(s / 2, s % 2 == 1), body);
        if body.may_be_rectum(at) {
            best[(1 << (s / 2)) * states + s] = (cost, usize::MAX);
        }
    }
    let least: Vec<f64> =
        (0..n).map(|s| [false, true].map(|w| rectal(&links[s], entry(s, w), body).0)).map(|c| c[0].min(c[1])).collect();
    for set in 1..1usize << n {
        // The first of those passed is the one most like a rectum: a pool low and behind in the pelvis is not passed on the way.
        let first = (0..n).filter(|s| set >> s & 1 == 1).map(|s| least[s]).fold(f64::INFINITY, f64::min);
        for s in (0..states).filter(|s| set >> (s / 2) & 1 == 1) {
            let cost = best[set * states + s].0;
            for t in (0..states).filter(|t| set >> (t / 2) & 1 == 0 && least[t / 2] >= first) {
                let c = cost + gap(s / 2, t / 2, exit(s / 2, s % 2 == 1), entry(t / 2, t % 2 == 1));
                let to = &mut best[(set | 1 << (t / 2)) * states + t];
                if c < to.0 {
                    *to = (c, s);
                }
            }
        }
    }
    let must: usize = (0..n).filter(|&s| links[s].worth_mm == f64::INFINITY).map(|s| 1 << s).sum();
    let worth = |set: usize| -> f64 {
        (0..n).filter(|s| set >> s & 1 == 1 && must >> s & 1 == 0).map(|s| links[s].worth_mm).sum()
    };
    // The cheapest end of the cheapest set; the larger set of two equal ones. What ends where no cecum is is no colon, however cheap: a
    // collapsed sigmoid may lie farther from its other limb than the rectum does from the cecum.
    let mut end: Option<(f64, usize, usize)> = None;
    for set in (1..1usize << n).rev().filter(|set| set & must == must) {
        let worth = worth(set);
        for s in (0..states).filter(|s| set >> (s / 2) & 1 == 1 && body.may_be_cecum(exit(s / 2, s % 2 == 1))) {
            let total = best[set * states + s].0 + body.unlike_cecum(exit(s / 2, s % 2 == 1)) - worth;
            if total < end.map_or(f64::INFINITY, |e| e.0) {
                end = Some((total, set, s));
            }
        }
    }
    let mut chain = Vec::new();
    let mut at = end.map(|e| (e.1, e.2));
    while let Some((set, s)) = at {
        chain.push((s / 2, s % 2 == 1));
        at = Some(best[set * states + s].1).filter(|&b| b != usize::MAX).map(|b| (set & !(1 << (s / 2)), b));
    }
    chain.reverse();
    let (passed, length_mm) = (chain.len(), length(links, &chain));
    let every = (0..links.len()).all(|s| links[s].worth_mm < f64::INFINITY || chain.iter().any(|c| c.0 == s));
    let trusted = every && is_colon(links, &chain, body);
    if !trusted {
        chain.sort_by_key(|c| c.0);
    }
    let likely = |s: usize| body.unlike_rectum(links[s].ends[1]) < body.unlike_rectum(links[s].ends[0]);
    let rest: Vec<usize> = (0..links.len()).filter(|s| chain.iter().all(|c| c.0 != *s)).collect();
    chain.extend(rest.into_iter().map(|s| (s, likely(s))));
    SegmentOrder { chain, passed, trusted, length_mm }
}

/// Returns how unlike the rectum an end of a segment is, mm in an adult, and the place that is. A rectum that is full of fluid has none of
/// the segment's gas: then the fluid at that end is looked at, which costs its way. What is nearer to the other end lies behind that.
fn rectal(link: &Link, end: DVec3, body: &Body) -> (f64, DVec3) {
    let at_end = |f: &&DVec3| {
        let mm = f.distance(end);
        mm <= POOL_MM * body.scale && link.ends.iter().all(|e| mm <= f.distance(*e))
    };
    let by_fluid = link.fluid.iter().filter(at_end).map(|f| {
        let way = FLUID_GAP * f.distance(end) / body.scale;
        (body.unlike_rectum(*f) + way, *f)
    });
    by_fluid.fold((body.unlike_rectum(end), end), |a, b| if b.0 < a.0 { b } else { a })
}

/// Returns how far the fluid of a segment reaches beyond its nearer end, mm, in a patient of the given size.
pub(super) fn beyond(ends: [DVec3; 2], fluid: &[DVec3], scale: f64) -> f64 {
    let far = fluid.iter().map(|f| f.distance(ends[0]).min(f.distance(ends[1])));
    far.filter(|&mm| mm <= POOL_MM * scale).fold(0.0, f64::max)
}

/// Returns the length of a chain with its gaps, mm.
fn length(links: &[Link], chain: &[(usize, bool)]) -> f64 {
    let end = |c: &(usize, bool), last: bool| links[c.0].ends[usize::from(c.1 != last)];
    let gaps: f64 = chain.windows(2).map(|w| end(&w[0], true).distance(end(&w[1], false))).sum();
    chain.iter().map(|c| links[c.0].length_mm).sum::<f64>() + gaps
}

/// Returns the length of the gap between the end `from` of a segment and the end `to` of another, mm; what fluid fills counts less.
fn gap_mm(a: &Link, b: &Link, from: DVec3, to: DVec3) -> f64 {
    let through = |fluid: &[DVec3], near: DVec3, far: DVec3| {
        let reached = fluid.iter().filter(|f| f.distance(near) <= POOL_MM);
        reached.map(|f| FLUID_GAP * f.distance(near) + f.distance(far)).fold(f64::INFINITY, f64::min)
    };
    from.distance(to).min(through(&a.fluid, from, to)).min(through(&b.fluid, to, from))
}

fn is_colon(links: &[Link], chain: &[(usize, bool)], body: &Body) -> bool {
    let end = |c: &(usize, bool), last: bool| links[c.0].ends[usize::from(c.1 != last)];
    let (Some(first), Some(last)) = (chain.first(), chain.last()) else { return false };
    let (rectum, cecum) = (rectal(&links[first.0], end(first, false), body).1, end(last, true));
    let between = |w: &[(usize, bool)]| gap_mm(&links[w[0].0], &links[w[1].0], end(&w[0], true), end(&w[1], false));
    let gaps: Vec<f64> = chain.windows(2).map(between).collect();
    body.may_be_rectum(rectum)
        && body.may_be_cecum(cecum)
        && rectum.z <= cecum.z
        && gaps.iter().all(|&g| g <= WIDEST_GAP_MM * body.scale)
        && length(links, chain) >= LEAST_COLON_MM * body.scale
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    /// A body around the origin from -200 to 200 mm, with gas down to -150.
    const BODY: Body = Body { centre: DVec3::ZERO, span: [-200.0, 200.0], lowest: -150.0, scale: 1.0 };

    fn trusted(rectum: DVec3, cecum: DVec3, length_mm: f64) -> bool {
        let links = [Link {
            ends: [rectum, cecum],
            length_mm,
            joined_to: Vec::new(),
            fluid: Vec::new(),
            worth_mm: f64::INFINITY,
        }];
        is_colon(&links, &[(0, false)], &BODY)
    }

    #[test]
    fn a_chain_from_rectum_to_cecum_is_told_by_its_ends() {
        let (rectum, cecum) = (DVec3::new(0.0, 60.0, -150.0), DVec3::new(-60.0, 0.0, -60.0));
        assert!(trusted(rectum, cecum, 1500.0));
        assert!(trusted(rectum + DVec3::X * RECTUM_ASIDE_MM, cecum, 1500.0), "a little aside");
        assert!(!trusted(rectum + DVec3::X * (RECTUM_ASIDE_MM + 1.0), cecum, 1500.0), "far aside");
        assert!(!trusted(rectum - DVec3::X * (RECTUM_ASIDE_MM + 1.0), cecum, 1500.0));
        assert!(trusted(rectum + DVec3::Y * 40.0, cecum, 1500.0), "far behind the middle");
        assert!(!trusted(rectum, cecum - DVec3::Z * 100.0, 1500.0), "the cecum is not below the rectum");
        assert!(!trusted(DVec3::new(0.0, 60.0, -30.0), cecum + DVec3::Z * 90.0, 1500.0), "too high");
        assert!(!trusted(rectum, DVec3::new(-CECUM_RIGHT_MM + 1.0, 0.0, -60.0), 1500.0), "not on the right");
        assert!(!trusted(rectum, cecum, LEAST_COLON_MM - 1.0) && trusted(rectum, cecum, LEAST_COLON_MM));
    }

    #[test]
    fn a_rectum_that_is_full_of_fluid_is_one() {
        // Its gas begins above the cecum's end.
        let (gas, cecum) = (DVec3::new(-10.0, 40.0, -40.0), DVec3::new(-60.0, 0.0, -60.0));
        assert!(!trusted(gas, cecum, 1500.0));
        let with_fluid = |fluid: DVec3| {
            let fluid = vec![fluid];
            let link =
                Link { ends: [gas, cecum], length_mm: 1500.0, joined_to: Vec::new(), fluid, worth_mm: f64::INFINITY };
            is_colon(&[link], &[(0, false)], &BODY)
        };
        assert!(with_fluid(DVec3::new(0.0, 60.0, -140.0)), "below the gas");
        assert!(!with_fluid(DVec3::new(0.0, 60.0, -20.0)), "above it");
        assert!(!with_fluid(DVec3::new(100.0, 60.0, -140.0)), "far aside");
    }

    #[test]
    fn fluid_counts_at_the_end_that_it_is_at() {
        let [low, high] = [DVec3::new(0.0, 60.0, -100.0), DVec3::new(-20.0, -10.0, -60.0)];
        let fluid = vec![DVec3::new(0.0, 70.0, -120.0), DVec3::new(300.0, 0.0, 0.0)];
        assert_eq!(beyond([low, high], &fluid, 1.0), low.distance(fluid[0]), "the other is too far");
        assert_eq!(beyond([low, high], &[], 1.0), 0.0);
        let link = Link { ends: [low, high], length_mm: 90.0, joined_to: Vec::new(), fluid, worth_mm: f64::INFINITY };
        assert_eq!(rectal(&link, low, &BODY).1, link.fluid[0]);
        assert_eq!(rectal(&link, high, &BODY).1, high, "it lies behind the other end");
    }

    /// The gas of small phantoms: the collapsed sigmoid is longer than the way from the rectum to the cecum.
    #[test]
    fn a_chain_from_the_rectum_to_the_cecum_is_preferred_to_a_cheaper_one_to_the_sigmoid() {
        let link = |from: [f64; 3], to: [f64; 3], length_mm: f64| Link {
            ends: [DVec3::from(from), DVec3::from(to)],
            length_mm,
            joined_to: Vec::new(),
            fluid: Vec::new(),
            worth_mm: f64::INFINITY,
        };
        let mut links = vec![
            link([67.0, 28.0, 65.0], [-64.0, 29.0, 36.0], 257.0),
            link([-21.0, -8.0, -36.0], [1.0, 32.0, -90.0], 117.0),
            link([17.0, -31.0, -77.0], [67.0, 34.0, 8.0], 147.0),
            link([-65.0, 26.0, -24.0], [-54.0, 12.0, -58.0], 36.0),
        ];
        let body = Body { centre: DVec3::new(0.0, 3.0, -5.0), span: [-122.0, 116.0], lowest: -105.0, scale: 0.574 };
        let found = order(&links, &body);
        assert!(found.trusted);
        assert_eq!(found.chain, [(1, true), (2, false), (0, false), (3, false)]);
        // A pool in the pelvis is the rectum's: its segment is not passed on the way from the sigmoid.
        links[1] = link([-22.0, -8.0, -36.0], [-6.0, 24.0, -32.0], 62.0);
        links[1].fluid = vec![DVec3::new(15.0, 36.0, -81.0), DVec3::new(-3.0, 60.0, -66.0)];
        links[2] = link([67.0, 31.0, 7.0], [18.0, -31.0, -79.0], 151.0);
        links.push(link([-3.0, 8.0, 3.0], [-37.0, 8.0, 10.0], 42.0));
        let body = Body { lowest: -88.0, ..body };
        let found = order(&links, &body);
        assert_eq!(found.chain[0].0, 1, "{found:?}");
        // A sigmoid alone is no colon.
        let found = order(&links[2..3], &body);
        assert!(!found.trusted && found.passed == 0 && found.chain.len() == 1);
    }

    #[test]
    fn without_tissue_the_bodys_middle_is_the_grids() {
        let grid =
            Grid::new([5, 8, 12], DVec3::new(1.0, 2.0, 3.0), DVec3::new(-7.0, 3.0, 11.0), DMat3::IDENTITY).unwrap();
        let volume = Volume::new(grid.clone(), vec![-1000; grid.len()]);
        assert_eq!(Body::of(&volume, 0.0, 1.0).centre, DVec3::new(-7.0 + 2.0, 3.0 + 7.0, 11.0 + 16.5));
    }
}
