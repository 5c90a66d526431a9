//! Light from the lamps to the wall and back.

use fearless_simd::Level;
use glam::{DVec3, Vec3};

use super::albedo::{Albedo, Residue};
use super::lanes::{LANES, Lanes};
use super::{Look, Mucosa};
use crate::dataset::truth::Crossing;
use crate::render::View;
use crate::space::PreparedVolume;

/// Least distance between a lamp and the wall, mm.
const NEAREST_MM: f32 = 0.05;

/// The most lamps.
const LAMPS: usize = 8;

/// What a pixel sends to the lens.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sent {
    /// Linear red, green and blue.
    pub linear: Vec3,
    /// What of it is gloss: white.
    pub gloss: f32,
    /// The wall's own colour.
    pub albedo: Vec3,
}

/// The lamps of a frame. Places are relative to the lens, in the world's directions, mm: single precision suffices there.
pub(super) struct Lamps<'a> {
    eye: DVec3,
    forward: Vec3,
    lamps: Vec<Vec3>,
    strength: f32,
    look: &'a Look,
    albedo: &'a Albedo,
    residue: Residue<'a>,
    /// What the power of the gloss is multiplied with.
    polish: f32,
    level: Level,
}

impl<'a> Lamps<'a> {
    pub(super) fn new(look: &'a Look, albedo: &'a Albedo, volume: &'a PreparedVolume, view: &View) -> Self {
        let place = |[x, y]: &[f64; 2]| (view.right() * *x + view.up() * *y).as_vec3();
        Self {
            eye: view.position(),
            forward: view.forward().as_vec3(),
            lamps: look.lights_mm.iter().take(LAMPS).map(place).collect(),
            strength: 1.0 / look.lights_mm.len().clamp(1, LAMPS) as f32,
            look,
            albedo,
            residue: Residue::new(volume),
            polish: look.gloss as f32 * (look.polish as f32 + 8.0) / 8.0,
            level: Level::new(),
        }
    }

    /// Returns what is sent from at most [`LANES`] points of the wall. Bit n of `dark` tells that lamp n is hidden there; it may be empty.
    ///
    /// The wall scatters evenly (Lambert), and its wet surface mirrors by Blinn and Phong with the factor that keeps energy (Akenine-Möller
    /// et al., Real-Time Rendering, 3rd ed., 2008, section 7.6), times the wall's π.
    pub(super) fn sent(&self, found: &[Option<Crossing>], dark: &[u8]) -> [Sent; LANES] {
        fearless_simd::dispatch!(self.level, _simd => self.sent_at_once(found, dark))
    }

    #[inline(always)]
    fn sent_at_once(&self, found: &[Option<Crossing>], dark: &[u8]) -> [Sent; LANES] {
        let (mut place, mut normal) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for (k, c) in found.iter().enumerate().take(LANES) {
            let Some(c) = c else { continue };
            let (p, n) = ((c.place - self.eye).as_vec3(), c.smooth);
            for axis in 0..3 {
                (place[axis][k], normal[axis][k]) = (p[axis], n[axis]);
            }
        }
        let mut back = [[0.0; LANES]; 3];
        for k in 0..LANES {
            let [x, y, z] = [place[0][k], place[1][k], place[2][k]];
            let short = -1.0 / (x * x + y * y + z * z).sqrt().max(NEAREST_MM);
            (back[0][k], back[1][k], back[2][k]) = (x * short, y * short, z * short);
        }
        let (mut diffuse, mut gloss) = ([0.0; LANES], [0.0; LANES]);
        // The light that falls from each lamp where there may be gloss; 0 elsewhere.
        let (mut shining, mut is_hot) = ([[0.0; LANES]; LAMPS], [false; LANES]);
        for ((bit, lamp), shining) in self.lamps.iter().enumerate().zip(&mut shining) {
            let (mut falling, hot) = self.falling(*lamp, [&place, &normal, &back]);
            for (falling, dark) in falling.iter_mut().zip(dark) {
                *falling *= f32::from(u8::from(dark >> bit & 1 == 0));
            }
            for k in 0..LANES {
                diffuse[k] += falling[k];
                shining[k] = if hot[k] > 0.0 { falling[k] } else { 0.0 };
                is_hot[k] |= shining[k] > 0.0;
            }
        }
        for k in (0..LANES).filter(|k| is_hot[*k] && self.polish > 0.0) {
            let at = |all: &[Lanes; 3]| Vec3::new(all[0][k], all[1][k], all[2][k]);
            let (place, back) = (at(&place), at(&back));
            let bumpy = (at(&normal) + self.albedo.bumps(self.eye.as_vec3() + place)).normalize_or_zero();
            for (lamp, shining) in self.lamps.iter().zip(&shining).filter(|(_, shining)| shining[k] > 0.0) {
                let half = ((*lamp - place).normalize_or_zero() + back).normalize_or_zero();
                gloss[k] += shining[k] * self.polish * power(half.dot(bumpy).max(0.0), self.look.polish);
            }
        }
        let mut tissue = [[0.0; LANES]; 3];
        let mut world = [[0.0; LANES]; 3];
        let mut is_found = [false; LANES];
        for (k, c) in found.iter().enumerate().take(LANES) {
            let Some(c) = c else { continue };
            is_found[k] = true;
            let at = c.place.as_vec3();
            for axis in 0..3 {
                (tissue[axis][k], world[axis][k]) = (c.tissue[axis], at[axis]);
            }
        }
        let mut albedo = self.albedo.sixteen(&tissue, &normal);
        if self.look.mucosa != Mucosa::Off {
            self.residue.over(&mut albedo, &world, &normal);
        }
        let mut out = [Sent::default(); LANES];
        for k in 0..LANES {
            let own = Vec3::new(albedo[0][k], albedo[1][k], albedo[2][k]);
            if is_found[k] {
                out[k] = Sent { linear: own * diffuse[k] + gloss[k], gloss: gloss[k], albedo: own };
            }
        }
        out
    }

    /// Returns the light that falls from a lamp on each point, and a number above 0 where there may be gloss. Without branches, so that
    /// several points are computed with each instruction.
    #[inline(always)]
    fn falling(&self, lamp: Vec3, [place, normal, back]: [&[Lanes; 3]; 3]) -> (Lanes, Lanes) {
        let (mut falling, mut aside, mut hot) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for k in 0..LANES {
            let (x, y, z) = (lamp.x - place[0][k], lamp.y - place[1][k], lamp.z - place[2][k]);
            let square = (x * x + y * y + z * z).max(NEAREST_MM * NEAREST_MM);
            let short = 1.0 / square.sqrt();
            let (x, y, z) = (x * short, y * short, z * short);
            let cosine = x * normal[0][k] + y * normal[1][k] + z * normal[2][k];
            aside[k] = (-(x * self.forward.x + y * self.forward.y + z * self.forward.z)).max(0.0);
            falling[k] = self.strength * cosine.max(0.0) * short * short;
            let (x, y, z) = (x + back[0][k], y + back[1][k], z + back[2][k]);
            let across = (x * normal[0][k] + y * normal[1][k] + z * normal[2][k]).max(0.0);
            // The bumps turn no normal so far that there is gloss elsewhere.
            hot[k] = across * across - 0.81 * (x * x + y * y + z * z);
        }
        let mut n = self.look.cone;
        while n > 0 {
            for k in 0..LANES {
                falling[k] *= if n & 1 == 0 { 1.0 } else { aside[k] };
                aside[k] *= aside[k];
            }
            n >>= 1;
        }
        (falling, hot)
    }
}

/// Returns `x` to a whole power, by squaring.
#[inline]
fn power(x: f32, mut n: u32) -> f32 {
    let (mut square, mut out) = (x, 1.0);
    while n > 0 {
        if n & 1 != 0 {
            out *= square;
        }
        square *= square;
        n >>= 1;
    }
    out
}
