//! The same patient in the other position: a deformed twin of a phantom, and the map of points between the two.

use glam::DVec3;

use super::body::Body;
use super::coordinates::{Motion, Place};
use super::gut::Guts;
use super::pools::{self, FLUID_SHARE};
use super::second_axis::{Bent, bends};
use super::shape::{DEEP, Shape};
use super::truth::{TruePoints, TrueSecond, Truth};
use super::valve::Valve;
use super::{Phantom, PhantomSettings, collapse_placing, gut_placing, moved, residue};
use crate::error::{Error, Result};
use crate::math::hash;

/// Distance between pairs of arc lengths and between rings of points in the truth, mm of the first position, and points in a ring.
const PAIRS_MM: f64 = 5.0;
const RINGS_MM: f64 = 10.0;
const AROUND: u32 = 12;
/// A lumen with less than this share of its radius counts as collapsed for the truth's points.
const OPEN: f64 = 0.4;
/// Tissue between small bowel or the stomach and the colon, mm; if they have less beside one axis, another one is tried.
const BESIDE_GUT_MM: f64 = 3.4;
/// Least distance between lumps of stool and lesions or decoys, mm.
const APART_MM: f64 = 4.0;

/// A phantom in two positions.
///
/// The second is the first turned over: each segment longer or shorter, the axis bent anew, the wall turned about it and wider or
/// narrower, another stretch collapsed, other fluid, stool and noise. Folds, polyps, decoys and the ileocecal valve are the same.
#[derive(Clone, Debug)]
pub struct Second {
    first: Phantom,
    second: Phantom,
    motion: Motion,
}

impl Phantom {
    /// Returns the same patient in the other position: prone for supine, right for left, and the reverse.
    ///
    /// # Errors
    /// Returns status 2 if two limbs of the colon touch: they would not in the other position.
    pub fn second(&self) -> Result<Second> {
        if self.settings.touching {
            let why = "a colon with limbs that touch has no second position";
            return Err(Error::usage("--second", why, "leave touching out of --with"));
        }
        let (position, seed) = (self.settings.position.opposite(), self.settings.seed);
        let settings = PhantomSettings { position, ..self.settings };
        let (scale, down) = (settings.size.scale(), position.down());
        let body = Body::new(scale, self.sigma, hash::bits(seed, 0xB0D7)).with(&settings);
        let grid = self.grid();
        let [nx, ny, nz] = grid.dims();
        let far = grid.world(DVec3::new(nx as f64 - 1.0, ny as f64 - 1.0, nz as f64 - 1.0));
        let depth = |p: DVec3| (p - grid.origin()).min(far - p).min_element().min(body.skin_depth(p));
        let mut best: Option<(f64, Anatomy)> = None;
        for Bent { axis, motion } in bends(&self.shape.axis, scale, down, seed, depth) {
            let (shape, valve) = moved::shape(&self.shape, axis, &motion, self.valve.as_ref(), seed);
            let guts = gut_placing::place(&shape, scale, valve.as_ref(), &settings);
            let room = gut_placing::room(&guts, &shape, scale, valve.as_ref());
            if best.as_ref().is_none_or(|(most, _)| room > *most) {
                best = Some((room, Anatomy { shape, valve, guts, motion }));
            }
            if room >= BESIDE_GUT_MM {
                break;
            }
        }
        let Some((_, Anatomy { mut shape, valve, guts, motion })) = best else {
            unreachable!("the unmoved axis is among those bent")
        };
        let closed = self.shape.collapsed.iter().map(|c| [c.from - c.taper, c.to + c.taper]);
        let closed: Vec<_> = closed.map(|stretch| stretch.map(|s| motion.along.at(s))).collect();
        collapse_placing::close_another(&mut shape, &closed, seed);
        // What is in the lumen is another draw.
        let contents = hash::bits(seed, 0x5EC0);
        let mut pools = if settings.fluid { pools::pools(&shape, down, || FLUID_SHARE) } else { Vec::new() };
        let mut tag = None;
        if settings.pools || settings.films || settings.stool {
            if settings.pools {
                pools = residue::deep_pools(&shape, down, contents);
            }
            let mut own = residue::tag(&shape, &pools, &settings, self.scanner.tag_hu, contents);
            own.keep_from(&grown(&shape), APART_MM);
            (tag, pools) = (Some(own), Vec::new());
        }
        let (reach, noise_seed) = (shape.reach(), hash::bits(contents, 0x4015E));
        let second = Self { settings, shape, body, pools, guts, valve, tag, reach, noise_seed, ..self.clone() };
        Ok(Second { first: self.clone(), second, motion })
    }

    /// Returns the place of a position (world, mm) in the loop that it is deepest in; `None` if it is more than 6 mm outside of the
    /// plain wall.
    fn place(&self, p: DVec3) -> Option<Place> {
        let mut best: Option<(f64, Place)> = None;
        self.shape.axis.feet(p, self.all_knots(), &self.reach, |foot| {
            let place = Place::at_foot(&self.shape.axis, &foot);
            let d = place.rho - self.shape.radius(place.s, place.phi);
            if d < DEEP && best.is_none_or(|(least, _)| d < least) {
                best = Some((d, place));
            }
        });
        best.map(|(_, place)| place)
    }
}

/// What of a body is in another place in its second position.
struct Anatomy {
    shape: Shape,
    valve: Option<Valve>,
    guts: Guts,
    motion: Motion,
}

/// Returns the balls that lesions and decoys of the wall lie in: centres (world mm) and radii (mm).
fn grown(shape: &Shape) -> Vec<(DVec3, f64)> {
    let lesions = shape.lesions.iter().flat_map(|a| a.what.balls());
    let decoys = shape.decoys.iter().map(|d| (d.truth.position, 0.5 * d.truth.diameter_mm));
    lesions.chain(decoys).collect()
}

impl Second {
    /// Returns the phantom in the first position.
    pub fn first(&self) -> &Phantom {
        &self.first
    }

    /// Returns the phantom in the second position.
    pub fn phantom(&self) -> &Phantom {
        &self.second
    }

    /// Returns where a point of the first position (world, mm LPS) is in the second. It keeps its distance from the plain wall if it
    /// is near it. `None` if it is more than 6 mm outside of the plain wall.
    pub fn to_second(&self, p: DVec3) -> Option<DVec3> {
        Some(self.forth(self.first.place(p)?).position(&self.second.shape.axis))
    }

    /// Returns where a point of the second position (world, mm LPS) is in the first; see [`Second::to_second`].
    pub fn to_first(&self, p: DVec3) -> Option<DVec3> {
        let place = self.second.place(p)?;
        let (first, second) = (&self.first.shape, &self.second.shape);
        let place = self.motion.back(place, |s, phi| first.caliber(s, phi), |s, phi| second.caliber(s, phi));
        Some(place.position(&first.axis))
    }

    /// Returns the arc length in the second position that belongs to `s` in the first, mm from the rectal end.
    pub fn along(&self, s: f64) -> f64 {
        self.motion.along.at(s)
    }

    /// Returns the arc length in the first position that belongs to `s` in the second, mm from the rectal end.
    pub fn along_first(&self, s: f64) -> f64 {
        self.motion.along.back(s)
    }

    /// Returns the ground truth of the first position, with that of the second in it.
    pub fn truth(&self) -> Truth {
        let end = self.first.shape.axis.length();
        let count = (end / PAIRS_MM).floor() as usize;
        let along: Vec<f64> = (0..=count).map(|i| i as f64 * PAIRS_MM).chain([end]).collect();
        let along_mm: Vec<_> = along.into_iter().map(|s| [s, self.along(s)]).collect();
        let turn_degrees = along_mm.iter().map(|[_, s]| self.motion.turn.jet(*s).at.y.to_degrees()).collect();
        let second = TrueSecond { truth: self.second.truth(), along_mm, turn_degrees, points: self.points() };
        Truth { second: Some(Box::new(second)), ..self.first.truth() }
    }

    fn forth(&self, place: Place) -> Place {
        let (first, second) = (&self.first.shape, &self.second.shape);
        self.motion.forth(place, |s, phi| first.caliber(s, phi), |s, phi| second.caliber(s, phi))
    }

    pub(crate) fn points(&self) -> TruePoints {
        let (first, second) = (&self.first.shape, &self.second.shape);
        let mut points = TruePoints { first: Vec::new(), second: Vec::new() };
        let is_open = |shape: &Shape, place: &Place| place.rho > OPEN * shape.radius(place.s, place.phi);
        for ring in 0..=(first.axis.length() / RINGS_MM) as usize {
            for k in 0..AROUND {
                let (s, phi) = (ring as f64 * RINGS_MM, f64::from(k) * std::f64::consts::TAU / f64::from(AROUND));
                let place = Place { s, phi, lean: 0.0, rho: first.caliber(s, phi) };
                let there = self.forth(place);
                if is_open(first, &place) && is_open(second, &there) {
                    points.first.push(place.position(&first.axis));
                    points.second.push(there.position(&second.axis));
                }
            }
        }
        points
    }
}
