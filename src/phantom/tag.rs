//! Tagged residue: pools with level surfaces, films on the wall, and stool that clings to it and holds bubbles.
//!
//! Three materials meet here: tissue, gas and tag. A scanner with a Gaussian point spread of σ sees at each position the
//! share that each of them has within its spread. With `u` the distance into the tissue and `v` the distance into the tag, both
//! over σ, and ρ the cosine between the directions in which they grow, the tissue's share is Φ(u) and the tag's is Φ₂(−u, v; −ρ):
//! exact for plane boundaries at any angle.

use std::f64::consts::TAU;

use glam::DVec3;

use super::Position;
use super::decoys::{DecoyKind, TrueDecoy};
use super::pools::Pool;
use super::profile::{FLUID, SHIFT, TISSUE, mix, normal_cdf, normal_cdf_2, smooth_max, smooth_min, smooth_step};
use super::shape::{DEEP, Distances, Shape};
use super::solid::{centre_of, extent};
use super::stream::stream;
use crate::math::hash;

/// Range of the HU of inhomogeneous tag.
const TAG_HU: [f64; 2] = [200.0, 1200.0];
/// Standard deviation of the spread of pseudo-enhancement, mm, and its strength: the share of the tag's excess over tissue that
/// tissue surrounded by tag gains.
const SPREAD_MM: f64 = 5.0;
const STRENGTH: f64 = 0.12;
/// Fillet between the balls of a lump of stool and around its bubbles, mm.
const FILLET_MM: f64 = 1.0;
/// Beyond this many σ from its boundary, a material has no share.
const FAR: f64 = 6.0;

/// A film of tag on the wall: thickest at a point and thinner around it.
#[derive(Clone, Copy, Debug)]
struct Film {
    s: f64,
    centre: DVec3,
    radius_mm: f64,
    thickness_mm: f64,
    hu: f64,
}

/// A lump of stool: balls of tag with bubbles of gas.
#[derive(Clone, Debug)]
struct Stool {
    s: f64,
    centre: DVec3,
    /// Nothing of the lump is farther from its centre, mm.
    reach_mm: f64,
    balls: Vec<(DVec3, f64)>,
    bubbles: Vec<(DVec3, f64)>,
    hu: f64,
}

/// The tagged residue of a colon.
#[derive(Clone, Debug)]
pub(crate) struct Tag {
    /// Direction of gravity, world.
    down: DVec3,
    pools: Vec<(Pool, f64)>,
    films: Vec<Film>,
    stool: Vec<Stool>,
    /// Pools are layered, and all tag is patchy, by this seed.
    inhomogeneous: Option<u64>,
    pseudo: bool,
}

/// What a scanner sees of the tag at one position.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Seen {
    /// Share of the tag in the lumen's content, 0 to 1, and its HU.
    pub tag: f64,
    pub hu: f64,
    /// What the tag adds to tissue there, HU.
    pub pseudo_hu: f64,
}

/// What is beside a place on the wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Beside {
    /// Gas, and no tag within 5 mm.
    Gas,
    /// Gas, with tag within 5 mm.
    Near,
    /// A level of fluid, within 2 mm along the wall.
    Rim,
    /// Fluid.
    Fluid,
    /// A film of tag.
    Film,
    /// Stool.
    Stool,
}

/// Maximum distance along the wall at which a level is beside a place, mm.
const RIM_MM: f64 = 2.0;
/// Maximum distance at which tag is near a place, mm.
const NEAR_MM: f64 = 5.0;
/// Minimum thickness of a film that counts, mm.
const FILM_MM: f64 = 0.15;

/// One body of tag: how far inside its boundary a position is (mm), in which direction that grows, and its HU.
struct Body {
    inside: f64,
    grows: DVec3,
    hu: f64,
    /// What of the pseudo-enhancement of a large body it causes.
    bulk: f64,
}

/// Which kinds of tag there are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kinds {
    pub films: bool,
    pub stool: bool,
    pub inhomogeneous: bool,
    pub pseudo: bool,
}

impl Tag {
    /// Distributes tag in a colon with these pools.
    pub(crate) fn new(shape: &Shape, pools: &[Pool], kinds: Kinds, position: Position, seed: u64) -> Self {
        let mut draw = stream(seed, 40);
        let mut hu = || if kinds.inhomogeneous { draw.within(TAG_HU[0], TAG_HU[1]) } else { FLUID };
        let pools = pools.iter().map(|p| (*p, hu())).collect();
        let films = if kinds.films { place_films(shape, seed, &mut hu) } else { Vec::new() };
        let stool = if kinds.stool { place_stool(shape, position.down(), seed, &mut hu) } else { Vec::new() };
        let inhomogeneous = kinds.inhomogeneous.then(|| hash::bits(seed, 0x7A6));
        Self { down: position.down(), pools, films, stool, inhomogeneous, pseudo: kinds.pseudo }
    }

    /// Returns the pools.
    pub(crate) fn pools(&self) -> Vec<Pool> {
        self.pools.iter().map(|(pool, _)| *pool).collect()
    }

    /// Returns the lumps of stool.
    pub(crate) fn lumps(&self) -> impl Iterator<Item = TrueDecoy> + '_ {
        self.stool.iter().map(|lump| TrueDecoy {
            kind: DecoyKind::TaggedStool,
            position: centre_of(&lump.balls),
            diameter_mm: extent(&lump.balls),
        })
    }

    /// Removes the lumps of stool and the films within 15 mm of these stretches of arc length.
    pub(crate) fn keep_off(&mut self, stretches: &[[f64; 2]]) {
        let free = |s: f64| stretches.iter().all(|[from, to]| !(from - 15.0..=to + 15.0).contains(&s));
        self.stool.retain(|lump| free(lump.s));
        self.films.retain(|film| free(film.s));
    }

    /// Removes the lumps of stool within `mm` of these balls: centres (world mm) and radii (mm).
    pub(crate) fn keep_from(&mut self, balls: &[(DVec3, f64)], mm: f64) {
        let free = |lump: &Stool| balls.iter().all(|(c, r)| c.distance(lump.centre) > lump.reach_mm + r + mm);
        self.stool.retain(free);
    }

    /// Gives all tag the same HU.
    pub(crate) fn set_hu(&mut self, hu: f64) {
        self.pools.iter_mut().for_each(|p| p.1 = hu);
        self.films.iter_mut().for_each(|f| f.hu = hu);
        self.stool.iter_mut().for_each(|s| s.hu = hu);
    }

    /// Returns what a scanner with a blur of `sigma` mm sees at `p` (world), with arc length `s` and distances `d`.
    pub(crate) fn seen(&self, p: DVec3, s: f64, d: &Distances, sigma: f64) -> Seen {
        let mut seen = Seen::default();
        let u = d.wall / sigma + SHIFT;
        let lumen = normal_cdf(-u);
        // What no body of tag covers, and the HU of what they cover, as a weighted sum.
        let (mut free, mut sum, mut weight) = (1.0, 0.0, 0.0);
        let mut add = |body: &Body| {
            let hu = self.inhomogeneous.map_or(body.hu, |seed| (body.hu * patchy(seed, p)).clamp(TAG_HU[0], TAG_HU[1]));
            if lumen > 0.0 && body.inside > -FAR * sigma {
                let v = body.inside / sigma;
                let share =
                    if u < -FAR { normal_cdf(v) } else { normal_cdf_2(-u, v, -d.normal.dot(body.grows)) / lumen };
                let share = share.clamp(0.0, 1.0);
                free *= 1.0 - share;
                (sum, weight) = (sum + share * hu, weight + share);
            }
            if self.pseudo && d.wall > -1.0 {
                // The tag is where both are positive: within its boundary and within the lumen.
                let near = body.inside.min(-d.wall) / SPREAD_MM;
                let fades = 1.0 - smooth_step(4.0, DEEP, d.plain);
                let gain = STRENGTH * body.bulk * (hu - TISSUE) * normal_cdf(near) * fades;
                seen.pseudo_hu = gain.max(seen.pseudo_hu);
            }
        };
        if let Some((pool, hu)) = self.pools.iter().find(|(pool, _)| (pool.from..=pool.to).contains(&s)) {
            let inside = p.dot(self.down) - pool.level;
            // Heavier tag settles.
            let settled =
                if self.inhomogeneous.is_some() { mix(0.75, 1.5, smooth_step(2.0, 14.0, inside)) } else { 1.0 };
            add(&Body { inside, grows: self.down, hu: hu * settled, bulk: 1.0 });
        }
        for film in self.films.iter().filter(|f| (f.s - s).abs() < 3.0 * f.radius_mm) {
            let off = p.distance_squared(film.centre) / (film.radius_mm * film.radius_mm);
            if off < 1.0 {
                let thickness = film.thickness_mm * (1.0 - off) * (1.0 - off);
                let inside = (u * sigma) + thickness;
                add(&Body { inside, grows: d.normal, hu: film.hu, bulk: 0.15 });
            }
        }
        for lump in self.stool.iter().filter(|l| (l.s - s).abs() < 3.0 * l.reach_mm) {
            if p.distance(lump.centre) < lump.reach_mm + FAR * sigma + if self.pseudo { 8.0 } else { 0.0 } {
                add(&lump.body(p));
            }
        }
        seen.tag = 1.0 - free;
        seen.hu = if weight > 0.0 { sum / weight } else { FLUID };
        seen
    }

    /// Returns what is beside a place on the wall (world), with arc length `s` and distances `d`.
    pub(crate) fn beside(&self, p: DVec3, s: f64, d: &Distances) -> Beside {
        let mut nearest = f64::INFINITY;
        for lump in self.stool.iter().filter(|l| (l.s - s).abs() < 3.0 * l.reach_mm + NEAR_MM) {
            let away = -lump.body(p).inside;
            if away < 1.0 {
                return Beside::Stool;
            }
            nearest = nearest.min(away);
        }
        if let Some((pool, _)) = self.pools.iter().find(|(pool, _)| (pool.from..=pool.to).contains(&s)) {
            let below = p.dot(self.down) - pool.level;
            // Along the wall a level is farther away than below the place.
            let steep = (1.0 - d.normal.dot(self.down).powi(2)).max(0.0).sqrt().max(0.1);
            if below.abs() / steep <= RIM_MM {
                return Beside::Rim;
            }
            if below > 0.0 {
                return Beside::Fluid;
            }
            nearest = nearest.min(-below);
        }
        for film in self.films.iter().filter(|f| (f.s - s).abs() < 3.0 * f.radius_mm + NEAR_MM) {
            let off = p.distance(film.centre) / film.radius_mm;
            if off < 1.0 && film.thickness_mm * (1.0 - off * off).powi(2) > FILM_MM {
                return Beside::Film;
            }
            nearest = nearest.min((off - 1.0) * film.radius_mm);
        }
        if nearest <= NEAR_MM { Beside::Near } else { Beside::Gas }
    }
}

impl Stool {
    fn body(&self, p: DVec3) -> Body {
        let (mut inside, mut grows) = (-100.0, DVec3::X);
        for &(centre, radius) in &self.balls {
            let away = p - centre;
            let own = radius - away.length();
            if own > inside {
                grows = -away.normalize_or_zero();
            }
            inside = smooth_max(inside, own, FILLET_MM);
        }
        for &(centre, radius) in &self.bubbles {
            let away = p - centre;
            let own = away.length() - radius;
            if own < inside {
                grows = away.normalize_or_zero();
            }
            inside = smooth_min(inside, own, FILLET_MM);
        }
        Body { inside, grows, hu: self.hu, bulk: 0.5 }
    }
}

/// Returns a factor around 1 that varies over a few millimetres.
fn patchy(seed: u64, p: DVec3) -> f64 {
    0.8 + 0.4 * super::texture::lattice(seed, p / 4.0)
}

fn place_films(shape: &Shape, seed: u64, hu: &mut impl FnMut() -> f64) -> Vec<Film> {
    let mut draw = stream(seed, 41);
    let end = shape.axis.length();
    let count = (end / 45.0) as usize;
    (0..count)
        .map(|i| {
            let s = 15.0 + (end - 30.0) * (i as f64 + draw.within(0.2, 0.8)) / count as f64;
            let phi = draw.within(0.0, TAU);
            let frame = shape.axis.frame(s);
            let centre = frame.at + frame.direction(phi) * shape.radius(s, phi);
            Film { s, centre, radius_mm: draw.within(8.0, 16.0), thickness_mm: draw.within(0.5, 2.2), hu: hu() }
        })
        .collect()
}

fn place_stool(shape: &Shape, down: DVec3, seed: u64, hu: &mut impl FnMut() -> f64) -> Vec<Stool> {
    let mut draw = stream(seed, 42);
    let end = shape.axis.length();
    let count = (end / 110.0) as usize;
    (0..count)
        .map(|i| {
            let s = 25.0 + (end - 50.0) * (i as f64 + draw.within(0.2, 0.8)) / count as f64;
            let frame = shape.axis.frame(s);
            // It clings anywhere, more often where it falls to.
            let phi = frame.angle(down) + draw.within(-1.0, 1.0) * draw.within(0.3, 3.0);
            let wall = frame.at + frame.direction(phi) * shape.radius(s, phi);
            let size = draw.within(2.5, 5.5).min(0.35 * shape.radius(s, phi));
            let inwards = -frame.direction(phi);
            let centre = wall + inwards * (0.6 * size);
            let around = frame.tangent.cross(inwards);
            let mut at = |spread: f64, lift: f64| {
                let (along, across) = (draw.within(-spread, spread), draw.within(-spread, spread));
                centre + (frame.tangent * along + around * across + inwards * draw.within(-0.2, lift)) * size
            };
            let balls: Vec<_> = [1.0, 0.8, 0.7].map(|r| (at(0.7, 0.3), r * size)).to_vec();
            let bubbles: Vec<_> = [0.34, 0.26, 0.2].map(|r| (at(0.5, 0.6), (r * size).max(0.7))).to_vec();
            Stool { s, centre, reach_mm: 2.6 * size, balls, bubbles, hu: hu() }
        })
        .collect()
}

#[cfg(test)]
#[path = "tag_tests.rs"]
mod tests;
