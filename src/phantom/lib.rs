//! A synthetic colon whose value, gradient and anatomy are known at every point.
//!
//! The lumen is a tube around a smooth axis (`centerline`). Haustra, taeniae, semilunar folds, polyps and bridges
//! shape its wall (`shape`, placed by `features`). The abdomen surrounds it (`body`). Every edge is blurred like
//! a scanner's, by a normal distribution. The wall is where the value is −650 HU against gas.

mod bodies;
mod body;
mod bowel;
mod centerline;
#[cfg(test)]
#[path = "../../tests/support/checks.rs"]
mod checks;
mod chest;
mod collapse;
mod collapse_placing;
mod content;
mod coordinates;
mod decoy_placing;
#[cfg(test)]
mod decoy_tests;
mod decoys;
mod features;
mod ground;
mod grown;
mod growth;
mod gut;
mod gut_placing;
#[cfg(test)]
mod gut_tests;
mod kinds;
#[cfg(test)]
mod lesion_tests;
mod lesions;
mod lesions_and_decoys;
mod moved;
mod organ;
mod paint;
mod pelvis;
mod placing;
mod pools;
mod profile;
mod residue;
mod room;
mod second;
mod second_axis;
#[cfg(test)]
mod second_tests;
mod settings;
mod shape;
mod solid;
mod spline;
mod stomach;
mod stream;
mod tag;
#[cfg(test)]
mod tests;
mod texture;
mod thick;
mod touching;
mod touching_placing;
#[cfg(test)]
mod touching_tests;
mod truth;
mod valve;
mod voxelise;

use std::ops::Range;

use glam::{DMat3, DVec3};

use colvis_scan::{error, math, progress, volume};

use crate::error::Result;
use crate::math::hash;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};
use body::Body;
use centerline::FootPoint;
use gut::{Guts, Run};
use pools::{FLUID_SHARE, Pool};
use profile::{FAT, FLUID, GAS, TISSUE, mix, normal_cdf, sheet_share, smooth_min, smooth_step, tissue_share};
use room::has_room;
use shape::{Attached, DEEP, Distances, Shape};
use tag::{Seen, Tag};
use valve::Valve;

pub use bodies::{NamedPart, TrueBody, TrueValve};
pub use centerline::{Centerline, Frame};
pub use decoys::{DecoyKind, TrueDecoy};
pub use grown::WallKind;
pub use kinds::{BodyKind, Content};
pub use lesions::{PolypShape, PolypSite};
pub use second::Second;
pub use settings::{NOISE_HU, PhantomSettings, Position, Scanner, Size};
pub use shape::Polyp;
pub use tag::Beside;
pub use touching::TrueSeptum;
pub use truth::{TruePoints, TruePolyp, TrueSecond, Truth};

/// Distance within which two loops' walls blend, mm; smaller than the tissue between them.
const LOOP_BLEND: f64 = 2.0;

/// Standard deviations of the blur beyond which it does not reach.
const BLUR_REACH: f64 = 6.0;

/// The wall near a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallPlace {
    /// Signed distance to it, mm, as of [`Phantom::wall`].
    pub mm: f64,
    /// What is beside it, if the position is on it.
    pub beside: Beside,
    /// True on a fold that is so thin that a scanner does not see all of its tissue.
    pub is_thin_fold: bool,
}

/// The analytic phantom.
#[derive(Clone, Debug)]
pub struct Phantom {
    settings: PhantomSettings,
    shape: Shape,
    body: Body,
    /// Pools of the feature `fluid`.
    pools: Vec<Pool>,
    /// Small bowel and stomach.
    guts: Guts,
    valve: Option<Valve>,
    /// The other kinds of tag.
    tag: Option<Tag>,
    /// For each knot of the axis, the distance within which positions depend on it, mm.
    reach: Vec<f64>,
    sigma: f64,
    scanner: Scanner,
    noise_seed: u64,
}

impl Phantom {
    /// Creates the phantom described by `settings`.
    pub fn new(settings: &PhantomSettings) -> Self {
        Self::scanned(settings, Scanner::default())
    }

    /// Creates the phantom described by `settings` as a scanner sees it.
    pub fn scanned(settings: &PhantomSettings, scanner: Scanner) -> Self {
        let small = settings.size == Size::Small;
        let scale = settings.size.scale();
        let radius = |r: f64| if small { 4.5 + 0.48 * r } else { r };
        // If a seed's loops come too close, reduce the variation; the anatomy without variation always has room.
        let usual = || {
            [4.0, 3.0, 2.0, 1.0]
                .into_iter()
                .map(|jitter| Centerline::new(scale, radius, jitter, hash::bits(settings.seed, 0xA715)))
                .find(has_room)
                .unwrap_or_else(|| Centerline::new(scale, radius, 0.0, 0))
        };
        let bent = if settings.touching { touching_placing::axis(scale, radius, settings) } else { None };
        let (axis, septum) = bent.map_or_else(|| (usual(), None), |(axis, septum)| (axis, Some(septum)));
        let mut shape = features::shape(axis, settings);
        // About 0.65 of a voxel.
        let sigma = scanner.blur_mm.unwrap_or(match settings.size {
            Size::Small => 0.58,
            Size::Standard => 0.5,
            Size::Large => 0.26,
        });
        let (seed, down) = (settings.seed, settings.position.down());
        shape.touching.extend(septum.map(|septum| septum.blurred(sigma)));
        touching_placing::clear(&mut shape);
        if settings.collapsed {
            collapse_placing::close(&mut shape, seed);
        }
        let valve = if settings.ileum { valve::valve(&shape, seed) } else { None };
        if let Some(valve) = &valve {
            decoy_placing::open(&mut shape, valve);
        }
        let mut pools = if settings.fluid { pools::pools(&shape, down, || FLUID_SHARE) } else { Vec::new() };
        let mut tag = None;
        if settings.pools || settings.films || settings.stool {
            if settings.pools {
                pools = residue::deep_pools(&shape, down, seed);
                features::submerge(&mut shape, &pools, down, sigma, seed);
                touching_placing::clear(&mut shape);
                if settings.collapsed {
                    collapse_placing::close(&mut shape, seed);
                }
            }
            tag = Some(residue::tag(&shape, &pools, settings, scanner.tag_hu, seed));
            pools = Vec::new();
        }
        if settings.lesions || settings.decoys {
            lesions_and_decoys::place(&mut shape, settings, tag.as_ref(), &pools);
        }
        let reach = shape.reach();
        let body = Body::new(scale, sigma, hash::bits(seed, 0xB0D7)).with(settings);
        let guts = gut_placing::place(&shape, scale, valve.as_ref(), settings);
        let noise_seed = hash::bits(seed, 0x4015E);
        Self { settings: *settings, shape, body, pools, guts, valve, tag, reach, sigma, scanner, noise_seed }
    }

    /// Returns the same colon without tag, with the same noise.
    #[must_use]
    pub fn twin(&self) -> Self {
        Self { pools: Vec::new(), tag: None, ..self.clone() }
    }

    /// Creates the same body with exactly the given polyps, which come from [`Phantom::polyp_at`] or are placed
    /// manually on the wall.
    pub fn with_polyps(settings: &PhantomSettings, polyps: &[Polyp]) -> Self {
        let mut phantom = Self::new(&PhantomSettings { polyps: false, ..*settings });
        let s_of = |p: &Polyp| phantom.nearest(p.position).map_or(0.0, |f| f.s);
        let attached = polyps.iter().map(|p| Attached { s: s_of(p), what: *p }).collect();
        phantom.shape.polyps = attached;
        phantom
    }

    /// Returns the small phantom of seed 1 with folds, polyps and noise, used when the engine has no input.
    ///
    /// # Errors
    /// Returns an error only if cancelled through `progress`.
    pub fn embedded(progress: &Progress) -> Result<Volume> {
        let phantom = Self::new(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
        phantom.voxelise(&phantom.grid(), progress)
    }

    /// Returns the grid of this size, aligned with the patient axes (LPS) and centred on the body.
    pub fn grid(&self) -> Grid {
        let (dims, spacing) = match self.settings.size {
            Size::Small => ([230, 186, 272], DVec3::splat(0.9)),
            Size::Standard => ([512, 512, 400], DVec3::new(0.7, 0.7, 1.0)),
            Size::Large => ([1024, 1024, 800], DVec3::new(0.35, 0.35, 0.5)),
        };
        let last = DVec3::new(dims[0] as f64 - 1.0, dims[1] as f64 - 1.0, dims[2] as f64 - 1.0);
        let Ok(grid) = Grid::new(dims, spacing, -0.5 * last * spacing, DMat3::IDENTITY) else {
            unreachable!("the three grids are well formed")
        };
        grid
    }

    /// Returns the settings.
    pub fn settings(&self) -> &PhantomSettings {
        &self.settings
    }

    /// Returns the axis of the colon, from rectum to cecum.
    pub fn axis(&self) -> &Centerline {
        &self.shape.axis
    }

    /// Returns a polyp of `diameter_mm` for [`Phantom::with_polyps`]. It is on the wall, `s` mm from the rectal end, on
    /// the side of the axis that faces `towards` (world direction).
    pub fn polyp_at(&self, s: f64, towards: DVec3, diameter_mm: f64) -> Polyp {
        let phi = self.shape.axis.frame(s).angle(towards);
        features::sessile(&self.shape, s, phi, diameter_mm).what
    }

    /// Returns the noise-free value at a position (world, mm LPS), HU.
    pub fn value(&self, world: DVec3) -> f64 {
        self.value_among(world, &[self.all_knots()], &self.guts.all_runs(), |p| self.body.value(p))
    }

    /// Returns the gradient of [`Phantom::value`], HU/mm, in world directions.
    ///
    /// Uses five-point central differences of the double-precision value, 1 µm apart. The truncation error is
    /// h⁴·f⁗′/30, below 10⁻⁹ of the wall's own gradient. The search for the nearest point of the axis adds less than
    /// 10⁻² HU/mm; the wall's own gradient is about 700.
    pub fn gradient(&self, world: DVec3) -> DVec3 {
        const H: f64 = 1e-3;
        let mut runs = Vec::new();
        self.runs_near(world, 4.0 * H, &mut runs);
        let mut guts = Vec::new();
        self.guts.runs_near(world, 4.0 * H, &mut guts);
        let f = |d: DVec3| self.value_among(world + d, &runs, &guts, |p| self.body.value(p));
        let along = |axis: DVec3| {
            let (a, b) = (axis * H, axis * (2.0 * H));
            (8.0 * (f(a) - f(-a)) - (f(b) - f(-b))) / (12.0 * H)
        };
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    }

    /// Returns the signed distance to the lumen's wall, mm: negative in gas and fluid, positive in tissue.
    ///
    /// The distance is correct to first order near the wall and saturates at −8 and 6 mm. It is 0 exactly where the value is −650
    /// HU against gas. It is continuous except on the axis itself, where it is far into saturation or the lumen is narrow.
    pub fn wall(&self, world: DVec3) -> f64 {
        self.distances_among(world, &[self.all_knots()]).0.wall
    }

    /// Returns the signed distance to the wall without folds, polyps and bridges, mm, as of [`Phantom::wall`].
    pub fn plain_wall(&self, world: DVec3) -> f64 {
        let mut runs = Vec::new();
        self.runs_near(world, 0.1, &mut runs);
        self.distances_among(world, &runs).0.plain
    }

    /// Returns the wall near a position (world); `None` where there is none within 6 mm and it is not in the lumen.
    pub fn wall_at(&self, world: DVec3) -> Option<WallPlace> {
        let mut runs = Vec::new();
        self.runs_near(world, 0.1, &mut runs);
        if runs.is_empty() {
            return None;
        }
        let (d, s) = self.distances_among(world, &runs);
        let beside = self.tag.as_ref().map_or(Beside::Gas, |t| t.beside(world, s, &d));
        (d.wall < DEEP).then_some(WallPlace { mm: d.wall, beside, is_thin_fold: d.thickness.is_finite() })
    }

    /// Returns the point of the axis nearest to a position, or `None` out of reach of the colon.
    fn nearest(&self, p: DVec3) -> Option<FootPoint> {
        let mut best: Option<FootPoint> = None;
        self.shape.axis.feet(p, self.all_knots(), &self.reach, |f| {
            if best.is_none_or(|b| f.rho < b.rho) {
                best = Some(f);
            }
        });
        best
    }

    fn all_knots(&self) -> Range<usize> {
        0..self.shape.axis.knots().len()
    }

    /// Collects the runs of knots that positions within `more` mm of `centre` depend on.
    fn runs_near(&self, centre: DVec3, more: f64, out: &mut Vec<Range<usize>>) {
        self.shape.axis.runs_near(centre, more, &self.reach, out);
    }

    /// Returns a position's distances and the arc length of the loop that it is deepest in, given the relevant runs of
    /// knots. Where two loops are close, a smooth minimum joins their lumens, which does not move either wall.
    fn distances_among(&self, p: DVec3, runs: &[Range<usize>]) -> (Distances, f64) {
        if !self.shape.touching.is_empty() {
            return self.sides(p, runs).0;
        }
        let mut all = Distances { wall: DEEP, plain: DEEP, normal: DVec3::ZERO, thickness: f64::INFINITY };
        let (mut deepest, mut s) = (f64::INFINITY, 0.0);
        for run in runs {
            self.shape.axis.feet(p, run.clone(), &self.reach, |foot| {
                let d = self.shape.distances(p, &foot);
                if d.wall < deepest {
                    (deepest, s) = (d.wall, foot.s);
                    (all.normal, all.thickness) = (d.normal, d.thickness);
                }
                all.wall = smooth_min(all.wall, d.wall, LOOP_BLEND);
                all.plain = all.plain.min(d.plain);
            });
        }
        (all, s)
    }

    /// Does the same as [`Phantom::distances_among`] in a colon with septa, which no smooth minimum may make thinner. If the loop
    /// that the position is second deepest in is so close that its blur reaches the position, its distances and arc length follow,
    /// and the thickness is that of the tissue between the two.
    fn sides(&self, p: DVec3, runs: &[Range<usize>]) -> ((Distances, f64), Option<(Distances, f64)>) {
        let none = Distances { wall: DEEP, plain: DEEP, normal: DVec3::ZERO, thickness: f64::INFINITY };
        let (mut first, mut second) = ((none, 0.0), (none, 0.0));
        for run in runs {
            self.shape.axis.feet(p, run.clone(), &self.reach, |foot| {
                let side = (self.shape.distances(p, &foot), foot.s);
                if side.0.wall < first.0.wall {
                    (first, second) = (side, first);
                } else if side.0.wall < second.0.wall {
                    second = side;
                }
            });
        }
        let near = (second.0.wall < BLUR_REACH * self.sigma).then_some(second);
        first.0.plain = first.0.plain.min(second.0.plain);
        if let Some((other, _)) = near {
            first.0.thickness = first.0.thickness.min(first.0.wall + other.wall);
        }
        (first, near)
    }

    /// Returns the value at a position, given the relevant runs of knots and the body's value there.
    fn value_among(&self, p: DVec3, runs: &[Range<usize>], guts: &[Run], body: impl Fn(DVec3) -> f64) -> f64 {
        let ((d, s), other) =
            if self.shape.touching.is_empty() { (self.distances_among(p, runs), None) } else { self.sides(p, runs) };
        let tissue = if d.thickness.is_finite() {
            sheet_share(d.wall, d.thickness, self.sigma)
        } else {
            tissue_share(d.wall, self.sigma)
        };
        let (mut inside, mut pseudo_hu) = self.inside(p, s, &d, tissue);
        if let Some((other, s)) = other {
            // Beside a septum, the blur mixes what is in both lumens.
            let (beyond, pseudo) = self.inside(p, s, &other, tissue);
            let share = |d: f64| 1.0 - tissue_share(d, self.sigma);
            let (own, beyond_share) = (share(d.wall), share(other.wall));
            inside = mix(inside, beyond, beyond_share / (own + beyond_share).max(1e-30));
            pseudo_hu = pseudo_hu.max(pseudo);
        }
        let gut = if guts.is_empty() { None } else { self.guts.inside(p, guts) };
        if tissue <= 0.0 && gut.is_none() {
            return inside;
        }
        let solid = self.shape.decoys_near(s).fold(TISSUE, |hu, d| d.material(p, hu));
        // The wall is about 3 mm thick; mesenteric fat fades into the surrounding body.
        let layer = smooth_step(2.0, 4.0, d.plain);
        let outside = if layer > 0.0 {
            let body = body(p);
            let fat = mix(FAT, body, smooth_step(4.0, DEEP, d.plain));
            mix(solid, fat, layer)
        } else {
            solid
        };
        let outside = outside + pseudo_hu;
        match gut {
            Some(gut) => self.beside_gut(p, &gut, &d, [inside, outside], tissue),
            None => mix(inside, outside, tissue),
        }
    }

    /// Returns the value of the lumen's content at a position with arc length `s`, distances `d` and this share of tissue, and by how
    /// much the tissue beside it appears brighter, HU.
    fn inside(&self, p: DVec3, s: f64, d: &Distances, tissue: f64) -> (f64, f64) {
        let seen = self.tag.as_ref().map(|t| t.seen(p, s, d, self.sigma));
        let inside = match seen {
            _ if tissue >= 1.0 => GAS,
            Some(Seen { tag, hu, .. }) => mix(GAS, hu, tag),
            None => self.content(p, s),
        };
        let enclosed = || self.shape.decoys_near(s).map(|d| d.enclosed_gas(p)).fold(0.0, f64::max);
        let inside = if inside > GAS { mix(inside, GAS, enclosed()) } else { inside };
        (inside, seen.map_or(0.0, |s| s.pseudo_hu))
    }

    /// Returns the value of gas, or of fluid below the level of the pool at arc length `s`.
    fn content(&self, p: DVec3, s: f64) -> f64 {
        match self.pools.iter().find(|pool| (pool.from..=pool.to).contains(&s)) {
            Some(pool) => mix(GAS, FLUID, normal_cdf((p.dot(self.settings.position.down()) - pool.level) / self.sigma)),
            None => GAS,
        }
    }
}
