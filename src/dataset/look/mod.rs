//! The picture of a frame as an endoscope makes it: lamps beside the lens, the mucosa's colour, gloss, exposure, noise.

mod albedo;
mod lanes;
mod light;
mod noise;
mod sensor;
mod shadow;
#[cfg(test)]
mod tests;
mod vessels;

use rayon::prelude::*;

pub use albedo::{BASE, Mucosa};
pub use sensor::Sensor;

use super::truth::Crossing;
use crate::math::hash;
use crate::render::View;
use crate::space::PreparedVolume;
use albedo::Albedo;
use lanes::LANES;
use light::{Lamps, Sent};
use sensor::Reader;

/// Pixels that a thread draws at a time.
const PART: usize = 1 << 12;

/// What a picture is made with.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Look {
    /// Places of the lamps beside the lens: to the right and up, mm. At most 8.
    pub lights_mm: Vec<[f64; 2]>,
    /// How a lamp weakens to the side: the cosine of the angle from the camera's axis to this power.
    pub cone: u32,
    /// True if the wall casts shadows.
    pub shadows: bool,
    /// How much the mucosa's colour varies.
    pub mucosa: Mucosa,
    /// Share of the light that the wet surface mirrors where it comes straight; 0 for none.
    pub gloss: f64,
    /// How smooth that surface is between its bumps: Blinn's power.
    pub polish: u32,
    /// The sensor.
    pub sensor: Sensor,
    /// True to keep linear light, gloss and the wall's colour.
    pub linear: bool,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            lights_mm: Self::lights(2),
            cone: 1,
            shadows: false,
            mucosa: Mucosa::Mild,
            gloss: 0.03,
            polish: 256,
            sensor: Sensor::default(),
            linear: false,
        }
    }
}

impl Look {
    /// Returns the usual places of lamps: one above the lens, or one at each side, 3 mm away.
    pub fn lights(count: usize) -> Vec<[f64; 2]> {
        if count == 1 { vec![[0.0, 3.0]] } else { vec![[-3.0, 0.0], [3.0, 0.0]] }
    }
}

/// A picture as a screen shows it, and in linear light.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// 8 bits, after exposure, noise and gamma.
    pub shown: Vec<[u8; 3]>,
    /// What linear light is multiplied with before noise and gamma.
    pub exposure: f32,
    /// Linear red, green and blue before exposure and noise, 1/mm²: what the wall sends to the lens for lamps that together light a wall
    /// of albedo 1 in front of them with 1/r². Empty unless it is kept.
    pub linear: Vec<[f32; 3]>,
    /// What of it is gloss, the same for all colours. Empty unless it is kept.
    pub gloss: Vec<f32>,
    /// The wall's colour: the share of light that it scatters. 0 where there is no wall. Empty unless it is kept.
    pub albedo: Vec<[f32; 3]>,
}

/// Draws pictures with a look: its tables.
#[derive(Debug)]
pub struct Painter {
    look: Look,
    albedo: Albedo,
    reader: Reader,
    seed: u64,
}

impl Painter {
    /// Creates it. The seed chooses the mucosa's colour and the noise.
    pub fn new(look: &Look, seed: u64) -> Self {
        let (albedo, reader) = (Albedo::new(look.mucosa, seed), Reader::new(&look.sensor));
        Self { look: look.clone(), albedo, reader, seed }
    }

    /// Draws the picture of a view whose pixels cross the wall of a scan at `crossings`, row by row. The frame's number chooses the noise.
    /// The result is the same for every number of threads.
    pub fn draw(&self, volume: &PreparedVolume, view: &View, crossings: &[Option<Crossing>], frame: u64) -> Picture {
        let lamps = Lamps::new(&self.look, &self.albedo, volume, view);
        let dark = if self.look.shadows { shadow::dark(&self.look, volume, view, crossings) } else { Vec::new() };
        // The pixels of each sixteen, of the part at `from`.
        let sent = |from: usize, part: &[Option<Crossing>], take: &mut dyn FnMut(usize, Sent)| {
            for (n, found) in part.chunks(LANES).enumerate() {
                let dark = dark.get(from + n * LANES..).unwrap_or_default();
                let sent = lamps.sent(found, dark);
                (0..found.len()).for_each(|k| take(n * LANES + k, sent[k]));
            }
        };
        let (mut picture, count) = (Picture::default(), crossings.len());
        picture.linear = vec![[0.0; 3]; count];
        let parts = picture.linear.par_chunks_mut(PART).zip(crossings.par_chunks(PART));
        if self.look.linear {
            picture.gloss = vec![0.0; count];
            picture.albedo = vec![[0.0; 3]; count];
            let more = picture.gloss.par_chunks_mut(PART).zip(picture.albedo.par_chunks_mut(PART));
            parts.zip(more).enumerate().for_each(|(n, ((linear, found), (gloss, albedo)))| {
                sent(n * PART, found, &mut |k, sent: Sent| {
                    (linear[k], gloss[k], albedo[k]) = (sent.linear.to_array(), sent.gloss, sent.albedo.to_array());
                });
            });
        } else {
            parts.enumerate().for_each(|(n, (linear, found))| {
                sent(n * PART, found, &mut |k, sent: Sent| linear[k] = sent.linear.to_array());
            });
        }
        picture.exposure = self.reader.exposure(&picture.linear);
        picture.shown = self.reader.read(&picture.linear, picture.exposure, hash::bits(self.seed, frame));
        if !self.look.linear {
            picture.linear = Vec::new();
        }
        picture
    }
}
