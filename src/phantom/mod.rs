//! A synthetic colon whose value, gradient and anatomy are known at every point.
//!
//! The lumen is a tube about a smooth axis ([`centerline`]): haustra, taeniae, semilunar folds, polyps and bridges shape
//! its wall ([`shape`], placed by [`features`]), the abdomen lies about it ([`body`]). Every edge carries a scanner's
//! blur, a normal distribution; the wall is where the value is −650 HU against gas.

pub mod body;
pub mod centerline;
pub mod features;
pub mod profile;
pub mod shape;
pub mod spline;
#[cfg(test)]
mod tests;
mod truth;
mod voxelise;

use glam::{DMat3, DVec3};

use crate::error::Result;
use crate::math::hash;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};
use body::Body;
use centerline::{Centerline, Foot};
use features::Pool;
use profile::{FAT, FLUID, GAS, TISSUE, mix, normal_cdf, smooth_min, smooth_step, tissue_share};
use shape::{Attached, Distances, REACH, Shape};

pub use shape::Polyp;
pub use truth::{TruePolyp, Truth};

/// Standard deviation of the noise, HU.
pub const NOISE_HU: f64 = 22.0;

/// Two loops' walls merge smoothly within this, mm: less than the tissue between them.
const LOOP_BLEND: f64 = 2.0;

/// How large a phantom is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Size {
    /// A colon of some 0.7 m on about ten million voxels of 0.9 mm.
    Small,
    /// An adult's colon, 512×512×400 voxels of 0.7×0.7×1.0 mm.
    #[default]
    Standard,
    /// The same on 1024×1024×800 voxels of half the spacing.
    Large,
}

/// What a phantom is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Its size.
    pub size: Size,
    /// Semilunar folds.
    pub folds: bool,
    /// Sessile polyps.
    pub polyps: bool,
    /// Pools of tagged fluid with a horizontal level.
    pub fluid: bool,
    /// Thin strands of tissue across the lumen.
    pub bridges: bool,
    /// Noise of [`NOISE_HU`] in the voxels.
    pub noise: bool,
    /// Which colon of all that could be.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { size: Size::Standard, folds: true, polyps: true, fluid: false, bridges: false, noise: true, seed: 1 }
    }
}

/// The analytic body.
#[derive(Clone, Debug)]
pub struct Phantom {
    settings: Settings,
    shape: Shape,
    body: Body,
    pools: Vec<Pool>,
    sigma: f64,
    noise_seed: u64,
}

impl Phantom {
    /// The body that `settings` describe.
    pub fn new(settings: &Settings) -> Self {
        let small = settings.size == Size::Small;
        let scale = if small { 0.58 } else { 1.0 };
        let radius = |r: f64| if small { 4.5 + 0.48 * r } else { r };
        // A seed whose loops come too close gets a tamer variation; the tame anatomy itself has room.
        let axis = [4.0, 3.0, 2.0, 1.0]
            .into_iter()
            .map(|jitter| Centerline::new(scale, radius, jitter, hash::bits(settings.seed, 0xA715)))
            .find(has_room)
            .unwrap_or_else(|| Centerline::new(scale, radius, 0.0, 0));
        let shape = features::shape(axis, settings.seed, settings.folds, settings.polyps, settings.bridges);
        // About 0.65 of a voxel.
        let sigma = match settings.size {
            Size::Small => 0.58,
            Size::Standard => 0.5,
            Size::Large => 0.26,
        };
        let pools = if settings.fluid { features::pools(&shape) } else { Vec::new() };
        let seed = settings.seed;
        let body = Body::new(scale, sigma, hash::bits(seed, 0xB0D7));
        Self { settings: *settings, shape, body, pools, sigma, noise_seed: hash::bits(seed, 0x4015E) }
    }

    /// The same body with exactly the given polyps, made by [`Phantom::polyp_at`] or placed by hand on the wall.
    pub fn with_polyps(settings: &Settings, polyps: &[Polyp]) -> Self {
        let mut phantom = Self::new(&Settings { polyps: false, ..*settings });
        let s_of = |p: &Polyp| phantom.nearest(p.position).map_or(0.0, |f| f.s);
        let attached = polyps.iter().map(|p| Attached { s: s_of(p), what: *p }).collect();
        phantom.shape.polyps = attached;
        phantom
    }

    /// The small phantom of seed 1 with folds, polyps and noise: what an engine without an input flies through.
    ///
    /// # Errors
    /// Only when cancelled through `progress`.
    pub fn embedded(progress: &Progress) -> Result<Volume> {
        let phantom = Self::new(&Settings { size: Size::Small, ..Settings::default() });
        phantom.voxelise(&phantom.grid(), progress)
    }

    /// The grid that belongs to the size, axes along the patient's (LPS), the body in its middle.
    pub fn grid(&self) -> Grid {
        let (dims, spacing) = match self.settings.size {
            Size::Small => ([230, 186, 256], DVec3::splat(0.9)),
            Size::Standard => ([512, 512, 400], DVec3::new(0.7, 0.7, 1.0)),
            Size::Large => ([1024, 1024, 800], DVec3::new(0.35, 0.35, 0.5)),
        };
        let last = DVec3::new(dims[0] as f64 - 1.0, dims[1] as f64 - 1.0, dims[2] as f64 - 1.0);
        let Ok(grid) = Grid::new(dims, spacing, -0.5 * last * spacing, DMat3::IDENTITY) else {
            unreachable!("the three grids are well formed")
        };
        grid
    }

    /// What it was made of.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The colon's shape.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// The pools of fluid.
    pub fn pools(&self) -> &[Pool] {
        &self.pools
    }

    /// Standard deviation of the scanner's blur, mm.
    pub fn sigma(&self) -> f64 {
        self.sigma
    }

    /// A polyp of `diameter_mm` for [`Phantom::with_polyps`], on the wall at `s` mm from the rectal end, on the side of
    /// the axis that faces `towards` (world direction).
    pub fn polyp_at(&self, s: f64, towards: DVec3, diameter_mm: f64) -> Polyp {
        let phi = self.shape.axis.frame(s).angle(towards);
        features::sessile(&self.shape, s, phi, diameter_mm).what
    }

    /// The noise-free value at a place (world, mm LPS), HU.
    pub fn value(&self, world: DVec3) -> f64 {
        self.value_among(world, 0..self.shape.axis.knots().len())
    }

    /// The gradient of [`Phantom::value`], HU/mm, world directions.
    ///
    /// Five-point central differences of the double-precision value, 1 µm apart: the truncation error is
    /// h⁴·f⁗′/30, below 10⁻⁹ of the wall's own gradient, and rounding leaves some 10⁻⁸ HU/mm.
    pub fn gradient(&self, world: DVec3) -> DVec3 {
        const H: f64 = 1e-3;
        let reach = 4.0 * H;
        let mut near = Vec::new();
        self.knots_near(world, reach, &mut near);
        let f = |d: DVec3| self.value_among(world + d, near.iter().copied());
        let along = |axis: DVec3| {
            let (a, b) = (axis * H, axis * (2.0 * H));
            (8.0 * (f(a) - f(-a)) - (f(b) - f(-b))) / (12.0 * H)
        };
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    }

    /// Signed distance to the lumen's wall, mm, negative in gas and fluid, positive in tissue, to first order near the
    /// wall and saturated at ±8 mm. It is 0 exactly where the value is −650 HU against gas; towards the axis it is
    /// continuous but for the axis itself, where it is deep in its saturation or the lumen narrow.
    pub fn wall(&self, world: DVec3) -> f64 {
        self.distances_among(world, 0..self.shape.axis.knots().len()).wall
    }

    /// The point of the axis nearest to a place within a wall's reach.
    fn nearest(&self, p: DVec3) -> Option<Foot> {
        let axis = &self.shape.axis;
        (0..axis.knots().len()).filter_map(|i| axis.foot(p, i)).min_by(|a, b| a.rho.total_cmp(&b.rho))
    }

    /// Within this distance of a knot places may depend on the colon, mm.
    fn reach_of_knot(&self, i: usize) -> f64 {
        let axis = &self.shape.axis;
        // A foot lies within one and a half knots of the knot it belongs to.
        self.shape.largest_radius(i as f64 * axis.knot_step()) + REACH + 2.0 + 1.5 * axis.knot_step()
    }

    /// The knots that places within `reach` mm of `centre` may depend on, appended to `out`.
    fn knots_near(&self, centre: DVec3, reach: f64, out: &mut Vec<usize>) {
        self.shape.axis.knots_near(centre, |i| reach + self.reach_of_knot(i), out);
    }

    /// The distances of a place, given the knots that matter. Where two loops are near, their lumens are joined by a
    /// smooth minimum, which changes nothing at a wall.
    fn distances_among(&self, p: DVec3, knots: impl Iterator<Item = usize>) -> Distances {
        self.loops_among(p, knots).0
    }

    /// The distances and the arc length of the loop that the place is deepest in.
    fn loops_among(&self, p: DVec3, knots: impl Iterator<Item = usize>) -> (Distances, f64) {
        let mut all = Distances { wall: REACH, plain: REACH };
        let (mut deepest, mut s) = (f64::INFINITY, 0.0);
        for foot in knots.filter_map(|i| self.shape.axis.foot(p, i)) {
            let d = self.shape.distances(p, &foot);
            if d.wall < deepest {
                (deepest, s) = (d.wall, foot.s);
            }
            all.wall = smooth_min(all.wall, d.wall, LOOP_BLEND);
            all.plain = all.plain.min(d.plain);
        }
        (all, s)
    }

    fn value_among(&self, p: DVec3, knots: impl Iterator<Item = usize>) -> f64 {
        let (d, s) = self.loops_among(p, knots);
        let tissue = tissue_share(d.wall, self.sigma);
        let inside = if tissue < 1.0 { self.content(p, s) } else { GAS };
        if tissue <= 0.0 {
            return inside;
        }
        // The wall is about 3 mm thick; fat of the mesentery fades into what lies there.
        let layer = smooth_step(2.0, 4.0, d.plain);
        let outside = if layer > 0.0 {
            let body = self.body.sample(p).hu;
            let fat = mix(FAT, body, smooth_step(4.0, REACH, d.plain));
            mix(TISSUE, fat, layer)
        } else {
            TISSUE
        };
        mix(inside, outside, tissue)
    }

    /// Gas, or fluid below the level of the pool at arc length `s`.
    fn content(&self, p: DVec3, s: f64) -> f64 {
        match self.pools.iter().find(|pool| (pool.from..=pool.to).contains(&s)) {
            Some(pool) => mix(GAS, FLUID, normal_cdf((p.y - pool.level) / self.sigma)),
            None => GAS,
        }
    }
}

/// Whether no two loops of the axis come nearer than their walls and 4 mm of tissue, and no bend is so tight that the
/// wall would fold over itself.
fn has_room(axis: &Centerline) -> bool {
    axis_clearance(axis) >= 4.0
        && (0..axis.knots().len()).all(|i| {
            let s = i as f64 * axis.knot_step();
            axis.curvature(s) * axis.profile(s).radius.0 < 0.72
        })
}

/// The least tissue between the walls of two loops, mm.
fn axis_clearance(axis: &Centerline) -> f64 {
    let knots = axis.knots();
    let radius: Vec<f64> =
        (0..knots.len()).map(|i| 1.08 * axis.profile(i as f64 * axis.knot_step()).radius.0).collect();
    let mut least = f64::INFINITY;
    for i in 0..knots.len() {
        for j in i + 1..knots.len() {
            // A half circle of the tightest bend is no other loop.
            let along = (j - i) as f64 * axis.knot_step();
            if along > 3.2 * (radius[i] + radius[j]) * 0.5 + 20.0 {
                least = least.min((knots[i] - knots[j]).length() - radius[i] - radius[j]);
            }
        }
    }
    least
}
