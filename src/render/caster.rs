//! The ray caster of the paper's section 2.2: radiance L and opacity A along each ray, front to back,
//!
//! L ← L + (1 − A)·C and (1 − A) ← (1 − A)(1 − a), C the colour weighted by its opacity a,
//!
//! until 1 − A drops below the camera's sensitivity. The background is black, so the pixel is L.

use glam::Vec3;
use rayon::prelude::*;

use super::camera::View;
use super::frame::{Frame, Work};
use super::march::{Ray, Step};
use super::quality::{Classification, Quality, Settings};
use super::ray::first_crossing;
use super::sampler::{Nearest, Sampler, Trilinear};
use super::shade::{Headlight, Shader};
use super::skip::{Everything, Leap, Skipper};
use super::space::Space;
use super::transfer::Ramp;

/// Rows of a task and of a tile.
const TILE_ROWS: usize = 16;
/// Columns of a tile: neighbouring rays visit the same voxels while they are in the cache.
const TILE_COLUMNS: usize = 32;

/// Renders `view` of `space` into `frame` (made to fit if it does not), on all of rayon's threads. The same bytes for
/// every number of threads.
pub fn render(space: &Space, view: &View, settings: &Settings, frame: &mut Frame) -> Work {
    let (high, low) = (Trilinear::new(space), Nearest::new(space));
    let (voxels, bricks) = (Leap::<true>::new(space), Leap::<false>::new(space));
    match (settings.quality, settings.classification) {
        (Quality::High, Classification::Value) => image(space, view, settings, (&high, &voxels, ByValue), frame),
        (Quality::High, Classification::Filtered) => image(space, view, settings, (&high, &bricks, ByDensity), frame),
        (Quality::Low, Classification::Value) => image(space, view, settings, (&low, &voxels, ByValue), frame),
        (Quality::Low, Classification::Filtered) => image(space, view, settings, (&low, &bricks, ByDensity), frame),
        (Quality::Reference, Classification::Value) => {
            image(space, view, settings, (&high, &Everything, ByValue), frame)
        }
        (Quality::Reference, Classification::Filtered) => {
            image(space, view, settings, (&high, &Everything, ByDensity), frame)
        }
    }
}

/// What opacity is looked up by, with the gradient where it comes for nothing.
trait Classifier: Sync {
    fn look<S: Sampler>(&self, sampler: &S, q: Vec3) -> (f32, Option<Vec3>);
}

/// [`Classification::Value`].
struct ByValue;

impl Classifier for ByValue {
    #[inline(always)]
    fn look<S: Sampler>(&self, sampler: &S, q: Vec3) -> (f32, Option<Vec3>) {
        (sampler.value(q), None)
    }
}

/// [`Classification::Filtered`].
struct ByDensity;

impl Classifier for ByDensity {
    #[inline(always)]
    fn look<S: Sampler>(&self, sampler: &S, q: Vec3) -> (f32, Option<Vec3>) {
        let fit = sampler.fit(q);
        (fit.density, Some(fit.gradient))
    }
}

/// The parts of a ray caster put together.
struct Caster<'a, S, K, C> {
    space: &'a Space,
    view: &'a View,
    sampler: &'a S,
    skipper: &'a K,
    classifier: C,
    shader: Headlight,
    ramp: Ramp,
    step: Step,
    sensitivity: f32,
    samples_per_pixel: u32,
}

/// Casts a whole picture with the given sampler, skipper and classifier.
fn image<S: Sampler, K: Skipper, C: Classifier>(
    space: &Space,
    view: &View,
    settings: &Settings,
    (sampler, skipper, classifier): (&S, &K, C),
    frame: &mut Frame,
) -> Work {
    let step = Step::new(space, settings.step_power);
    let caster = Caster {
        space,
        view,
        sampler,
        skipper,
        classifier,
        shader: Headlight::new(space),
        ramp: Ramp::new(space.wall(), step.power),
        step,
        sensitivity: settings.sensitivity,
        samples_per_pixel: settings.samples_per_pixel.max(1),
    };
    frame.resize(view.width(), view.height());
    let (pixels, depth) = frame.buffers();
    let band = TILE_ROWS * view.width();
    if let Some(depth) = depth {
        depth.par_chunks_mut(band).enumerate().for_each(|(n, band)| {
            tiles(view.width(), n, band, |x, y, out| {
                let hit = first_crossing(space, view.position(), view.ray(x, y), f64::INFINITY);
                *out = hit.map_or(f32::INFINITY, |t| t as f32);
            });
        });
    }
    let bands = pixels.par_chunks_mut(band).enumerate().map(|(n, band)| {
        let mut work = Work::default();
        tiles(view.width(), n, band, |x, y, out| *out = caster.pixel(x, y, &mut work));
        work
    });
    bands.reduce(Work::default, |a, b| a + b)
}

/// Calls `each` for the pixels of the `n`-th band of rows, tile by tile.
fn tiles<T>(width: usize, n: usize, band: &mut [T], mut each: impl FnMut(usize, usize, &mut T)) {
    for left in (0..width).step_by(TILE_COLUMNS) {
        let right = (left + TILE_COLUMNS).min(width);
        for (row, pixels) in band.chunks_exact_mut(width).enumerate() {
            for (x, out) in (left..right).zip(&mut pixels[left..right]) {
                each(x, n * TILE_ROWS + row, out);
            }
        }
    }
}

/// Where ray `n` of `count` passes through a pixel, each coordinate 0 to 1: the centre for one ray, else the points of
/// a lattice along the golden ratio, which are evenly spread for every count.
fn within_pixel(n: u32, count: u32) -> (f64, f64) {
    if count == 1 {
        return (0.5, 0.5);
    }
    let n = f64::from(n) + 0.5;
    (n / f64::from(count), (n * 0.618_033_988_749_894_9).fract())
}

impl<S: Sampler, K: Skipper, C: Classifier> Caster<'_, S, K, C> {
    fn pixel(&self, x: usize, y: usize, work: &mut Work) -> [u8; 3] {
        let mut light = Vec3::ZERO;
        for n in 0..self.samples_per_pixel {
            let (u, v) = within_pixel(n, self.samples_per_pixel);
            let direction = self.view.ray_at(x as f64 + u, y as f64 + v);
            work.rays += 1;
            if let Some(ray) = Ray::new(self.space, self.view.position(), direction, self.step) {
                light += self.cast(&ray, &mut work.samples);
            }
        }
        (light / self.samples_per_pixel as f32).to_array().map(|c| (c * 255.0 + 0.5) as u8)
    }

    /// The radiance that comes along a ray.
    #[inline(always)]
    fn cast(&self, ray: &Ray, samples: &mut u64) -> Vec3 {
        let (mut light, mut through) = (Vec3::ZERO, 1.0f32);
        let mut walk = self.skipper.start(ray);
        let mut n = 0;
        loop {
            n = self.skipper.next(&mut walk, ray, n);
            if n >= ray.count {
                break;
            }
            *samples += 1;
            let q = ray.at(n);
            let (hu, gradient) = self.classifier.look(self.sampler, q);
            let a = self.ramp.opacity(hu);
            if a > 0.0 {
                let gradient = gradient.unwrap_or_else(|| self.gradient(q));
                light += self.shader.colour(hu, gradient, ray.direction) * (through * a);
                through *= 1.0 - a;
                if through < self.sensitivity {
                    break;
                }
            }
            n += 1;
        }
        light
    }

    /// The gradient at a place that is not empty: none in a homogeneous region.
    #[inline(always)]
    fn gradient(&self, q: Vec3) -> Vec3 {
        if self.space.homogeneous_near(q) { Vec3::ZERO } else { self.sampler.fit(q).gradient }
    }
}

#[cfg(test)]
#[path = "caster_tests.rs"]
mod tests;
