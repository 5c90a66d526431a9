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
        if self.polish > 0.0 && is_hot.contains(&true) {
            self.shine([&place, &back, &normal], (&shining, &is_hot), &mut gloss);
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

    /// Adds the gloss of points on which lamps fall, where there may be some.
    #[inline(always)]
    fn shine(
        &self,
        [place, back, normal]: [&[Lanes; 3]; 3],
        (shining, is_hot): (&[Lanes; LAMPS], &[bool; LANES]),
        gloss: &mut Lanes,
    ) {
        let mut bumpy = *normal;
        for k in (0..LANES).filter(|k| is_hot[*k]) {
            let at = Vec3::new(place[0][k], place[1][k], place[2][k]);
            let bumps = self.albedo.bumps(self.eye.as_vec3() + at);
            (bumpy[0][k], bumpy[1][k], bumpy[2][k]) =
                (bumpy[0][k] + bumps.x, bumpy[1][k] + bumps.y, bumpy[2][k] + bumps.z);
        }
        for (lamp, shining) in self.lamps.iter().zip(shining) {
            let mut shine = [0.0; LANES];
            for k in 0..LANES {
                let (x, y, z) = (lamp.x - place[0][k], lamp.y - place[1][k], lamp.z - place[2][k]);
                let short = 1.0 / (x * x + y * y + z * z).max(f32::MIN_POSITIVE).sqrt();
                let (x, y, z) = (x * short + back[0][k], y * short + back[1][k], z * short + back[2][k]);
                let [p, q, r] = [bumpy[0][k], bumpy[1][k], bumpy[2][k]];
                let lengths = (x * x + y * y + z * z) * (p * p + q * q + r * r);
                shine[k] = ((x * p + y * q + z * r) / lengths.max(f32::MIN_POSITIVE).sqrt()).clamp(0.0, 1.0);
            }
            power(&mut shine, self.look.polish);
            for k in 0..LANES {
                gloss[k] += shining[k] * self.polish * shine[k];
            }
        }
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
        power(&mut aside, self.look.cone);
        for k in 0..LANES {
            falling[k] *= aside[k];
        }
        (falling, hot)
    }
}

/// Raises numbers to a whole power, by squaring.
#[inline(always)]
fn power(all: &mut Lanes, mut n: u32) {
    let mut square = *all;
    *all = [1.0; LANES];
    while n > 0 {
        for k in 0..LANES {
            all[k] *= if n & 1 == 0 { 1.0 } else { square[k] };
            square[k] *= square[k];
        }
        n >>= 1;
    }
}
