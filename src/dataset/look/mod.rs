//! The picture of a frame as an endoscope makes it: lights beside the lens, the mucosa's colour, gloss, exposure, noise.

mod sensor;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

pub use sensor::Sensor;

use super::truth::Crossing;
use crate::render::View;

/// What a picture is made with.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Look {
    /// Places of the lights beside the lens: to the right and up, mm.
    pub lights_mm: Vec<[f64; 2]>,
    /// How a light weakens to the side: the cosine of the angle from its axis to this power.
    pub cone: f64,
    /// The mucosa's colour, linear red, green and blue, 0 to 1.
    pub mucosa: [f32; 3],
    /// Share of gloss.
    pub gloss: f32,
    /// The sensor.
    pub sensor: Sensor,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            lights_mm: vec![[-2.0, 0.0], [2.0, 0.0]],
            cone: 1.0,
            mucosa: [0.60, 0.26, 0.18],
            gloss: 0.06,
            sensor: Sensor::default(),
        }
    }
}

/// A picture in linear light and as a screen shows it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Linear red, green and blue before exposure and noise: radiance of the wall for lights of strength 1 mm².
    pub linear: Vec<[f32; 3]>,
    /// 8 bits, after exposure, noise and gamma.
    pub shown: Vec<[u8; 3]>,
    /// What linear light is multiplied with before gamma.
    pub exposure: f32,
}

impl Look {
    /// Makes the picture of a view whose pixels cross the wall at `crossings`. `seed` and the frame's number choose the noise.
    pub fn draw(&self, view: &View, crossings: &[Option<Crossing>], seed: u64, frame: u64) -> Picture {
        let strength = 1.0 / self.lights_mm.len().max(1) as f64;
        let lights: Vec<DVec3> =
            self.lights_mm.iter().map(|[x, y]| view.position() + view.right() * *x + view.up() * *y).collect();
        let eye = view.position();
        let lit = |c: &Crossing| {
            let back = (eye - c.place).normalize_or_zero();
            let mut colour = Vec3::ZERO;
            for light in &lights {
                let to = *light - c.place;
                let square = to.length_squared().max(1e-6);
                let to = to / square.sqrt();
                let cosine = to.dot(c.smooth).max(0.0);
                let aside = (-to).dot(view.forward()).max(0.0).powf(self.cone);
                let fall = (strength * aside / square) as f32;
                let half = (to + back).normalize_or_zero();
                let gloss = if cosine > 0.0 { self.gloss * half.dot(c.smooth).max(0.0).powi(60) as f32 } else { 0.0 };
                colour += (Vec3::from_array(self.mucosa) * cosine as f32 + Vec3::splat(gloss)) * fall;
            }
            colour.to_array()
        };
        let linear: Vec<[f32; 3]> = crossings.par_iter().map(|c| c.as_ref().map_or([0.0; 3], lit)).collect();
        let exposure = self.sensor.exposure(&linear);
        let shown = self.sensor.read(&linear, exposure, seed, frame);
        Picture { linear, shown, exposure }
    }
}
