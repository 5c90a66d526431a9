//! The ray caster for flights: sixteen rays at once, leaping in bundles, shaded cell by cell.

mod beam;
mod blur;
mod cells;
pub(super) mod directions;
mod fit;
mod forms;
pub(super) mod lanes;
mod layer;
mod occupancy;
mod packet;
mod paint;
pub(super) mod picture;
mod predict;
mod rays;
mod refine;
mod sampling;
mod subdivided;
mod wide;

use std::sync::{Arc, Mutex, PoisonError};

use fearless_simd::Level;

use super::caster::fill_depth;
use super::direct::Direct;
use super::distances::Distances;
use super::memory::MemoryPart;
use super::renderer::Renderer;
use super::shaders::Shader;
use super::{Frame, PreparedVolume, Settings, View, Work};
use cells::Cells;
use occupancy::Occupancy;
use rays::Rays;
pub(crate) use sampling::BLOCK;
use sampling::ImageSamples;

/// Returns the name of the SIMD level that ray packets use on this machine.
#[doc(hidden)]
pub fn simd_level() -> &'static str {
    name(Level::new())
}

/// Returns the SIMD levels of this machine that ray packets are compiled for, best first, with their names.
pub fn levels() -> Vec<(&'static str, Level)> {
    let best = Level::new();
    let mut all = vec![(name(best), best)];
    #[cfg(target_arch = "x86_64")]
    let lesser = best.as_avx2().map(Level::Avx2).into_iter().chain([Level::baseline()]);
    #[cfg(not(target_arch = "x86_64"))]
    let lesser = [Level::baseline()];
    for level in lesser {
        if all.iter().all(|l| l.0 != name(level)) {
            all.push((name(level), level));
        }
    }
    all
}

fn name(level: Level) -> &'static str {
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512(_) => "avx512",
        #[cfg(target_arch = "x86_64")]
        Level::Avx2(_) => "avx2",
        #[cfg(target_arch = "x86_64")]
        _ => "sse2",
        #[cfg(target_arch = "aarch64")]
        _ => "neon",
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        _ => "scalar",
    }
}

/// Which pixels get their own ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Pixels {
    /// Only those that the rays around them do not determine.
    #[default]
    Needed,
    /// All.
    All,
}

/// Renders one volume with ray packets.
pub struct PacketRenderer {
    volume: PreparedVolume,
    settings: Settings,
    pixels: Pixels,
    occupancy: Arc<Occupancy>,
    /// How smooth the scan is: [`blur::waves`].
    waves: f32,
    /// A cache for each thread. Its entries depend on the volume alone.
    cells: Arc<[Mutex<Cells>]>,
    /// Of the widest blocks to the picture's.
    samples: Vec<ImageSamples>,
    /// The size of the picture that they belong to, pixels, and a distance of 1 in it, mm; `None` if the last one was made otherwise.
    sampled: Option<([usize; 2], f32)>,
    level: Level,
    /// The shader that takes the headlight's place.
    shader: Option<Arc<dyn Shader>>,
    direct: Direct,
}

impl PacketRenderer {
    /// Prepares `volume` in one parallel pass over its voxels.
    pub fn new(volume: &PreparedVolume, settings: Settings, pixels: Pixels) -> Self {
        Self::with_level(volume, settings, pixels, Level::new())
    }

    /// Like [`PacketRenderer::new`], on a given SIMD level.
    pub fn with_level(volume: &PreparedVolume, settings: Settings, pixels: Pixels, level: Level) -> Self {
        let occupancy = Arc::new(Occupancy::new(volume.voxels(), volume.transfer()));
        let cells = (0..rayon::current_num_threads()).map(|_| Mutex::default()).collect();
        Self {
            volume: volume.clone(),
            settings,
            pixels,
            occupancy,
            waves: blur::waves(volume.voxels(), volume.transfer()),
            cells,
            samples: Default::default(),
            sampled: None,
            level,
            shader: settings.shader.own(),
            direct: Direct::new(volume, settings),
        }
    }

    /// Creates another renderer of the same volume that shares the prepared data.
    pub fn beside(&self, settings: Settings) -> Self {
        Self {
            volume: self.volume.clone(),
            settings,
            pixels: self.pixels,
            occupancy: Arc::clone(&self.occupancy),
            waves: self.waves,
            cells: Arc::clone(&self.cells),
            samples: Default::default(),
            sampled: None,
            level: self.level,
            shader: self.shader.clone(),
            direct: Direct::new(&self.volume, settings),
        }
    }

    /// Like [`Renderer::refining`], for a renderer that has no prepared data to share.
    pub fn refining_alone(volume: &PreparedVolume, settings: Settings) -> Self {
        Self::new(volume, like_rays(settings), Pixels::Needed)
    }
}

/// Returns the settings with which packets sample like rays traced one by one do with `settings`.
///
/// Packets take half as many samples, since values in between are taken as linear.
fn like_rays(settings: Settings) -> Settings {
    Settings { step_power: settings.step_power + 1, ..settings }
}

impl Renderer for PacketRenderer {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        self.sampled = None;
        let Some(rays) =
            Rays::new(&self.volume, &self.occupancy, self.waves, view, &self.settings, self.shader.as_deref())
        else {
            return self.direct.render(view, frame);
        };
        frame.resize(view.width(), view.height());
        fill_depth(&self.volume, view, frame);
        let pixels = frame.buffers().0;
        match self.pixels {
            Pixels::Needed => {
                if picture::is_sampled(&rays) {
                    self.sampled = Some(([view.width(), view.height()], rays.step_mm / rays.step_in_waves()));
                }
                picture::needed(&mut self.samples, &rays, view, pixels, &self.cells, self.level)
            }
            Pixels::All => picture::pixels_of(&rays, view, pixels, &self.cells, self.level),
        }
    }

    fn distances(&self) -> Option<Distances<'_>> {
        let (size, unit_mm) = self.sampled?;
        Some(self.samples.last()?.distances(size, unit_mm))
    }

    fn refining(&self, settings: Settings) -> Option<Box<dyn Renderer>> {
        Some(Box::new(self.beside(like_rays(settings))))
    }

    /// Renders the `wanted` squares with a ray for every pixel.
    fn render_squares(&mut self, view: &View, frame: &mut Frame, wanted: &[bool]) -> Work {
        let Some(rays) =
            Rays::new(&self.volume, &self.occupancy, self.waves, view, &self.settings, self.shader.as_deref())
        else {
            return self.direct.render(view, frame);
        };
        frame.resize(view.width(), view.height());
        picture::squares_of(&rays, view, frame.buffers().0, &self.cells, self.level, wanted)
    }

    /// Returns the bytes that are not shared with renderers made by [`beside`](PacketRenderer::beside).
    fn own_bytes(&self) -> usize {
        self.samples.iter().map(ImageSamples::bytes).sum()
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        let cells = self.cells.iter().map(|c| c.lock().unwrap_or_else(PoisonError::into_inner).bytes());
        vec![
            (MemoryPart::Flags, self.volume.bytes()),
            (MemoryPart::Occupancy, self.occupancy.bytes()),
            (MemoryPart::GradientCache, cells.sum()),
            (MemoryPart::SampledRays, self.samples.iter().map(ImageSamples::bytes).sum()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::phantom::PhantomSettings as Colon;
    use crate::render::Quality;
    use crate::render::renderer::SQUARE;
    use crate::shared::shared;
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};

    /// Asserts that pictures are the same to the bit with and without the knowledge of empty cells. Returns the number
    /// of samples with and without it.
    fn compare(volume: &PreparedVolume, views: &[View], power: i32, pixels: Pixels) -> [u64; 2] {
        let settings = Settings { step_power: power, ..Settings::new(Quality::High) };
        let mut fast = PacketRenderer::new(volume, settings, pixels);
        let mut slow = fast.beside(settings);
        let everything = TransferFunction::new(-3000.0, 0.0).unwrap();
        slow.occupancy = Arc::new(Occupancy::new(volume.voxels(), everything));
        let mut samples = [0; 2];
        for (n, view) in views.iter().enumerate() {
            let (mut a, mut b) = (Frame::default(), Frame::default());
            let (quick, all) = (fast.render(view, &mut a), slow.render(view, &mut b));
            assert!(a == b, "step 2^{power}, view {n}");
            assert_eq!(quick.rays, all.rays);
            samples = [samples[0] + quick.samples, samples[1] + all.samples];
        }
        samples
    }

    /// Steps of two voxels, and specks that are finer.
    #[test]
    fn what_is_left_out_of_a_smooth_scan_changes_nothing() {
        let grid = Grid::new([64; 3], DVec3::splat(0.4), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let value = |n: usize| {
            let [x, y, z] = [n % 64, n / 64 % 64, n / 4096].map(|c| c as f64);
            let wall = ((DVec3::new(x, y, z) - 31.0).length() - 20.0) / 8.0;
            if n.is_multiple_of(7919) { -300 } else { (-650.0 + 1000.0 * wall).clamp(-1000.0, 0.0) as i16 }
        };
        let volume = Volume::new(grid.clone(), (0..grid.len()).map(value).collect());
        let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
        assert_eq!(PacketRenderer::new(&volume, Settings::default(), Pixels::Needed).waves, blur::LONGEST);
        let views = [DVec3::X, DVec3::new(0.3, -0.8, 0.1), DVec3::new(-1.0, 1.0, 1.0)].map(|direction| {
            View::new(grid.world(DVec3::new(30.3, 32.1, 29.7)), direction, DVec3::Z, 100.0, 90, 80).unwrap()
        });
        for power in [-4, -1, 0, 2] {
            let [taken, all] = compare(&volume, &views, power, Pixels::Needed);
            assert!(taken < all, "{taken} {all}");
        }
        let pictures = levels().into_iter().map(|(_, level)| {
            let (mut fast, mut frame) =
                (PacketRenderer::with_level(&volume, Settings::default(), Pixels::Needed, level), Frame::default());
            fast.render(&views[1], &mut frame);
            frame
        });
        let pictures: Vec<_> = pictures.collect();
        assert!(pictures.windows(2).all(|two| two[0] == two[1]), "SIMD levels differ");
    }

    /// Squares of pixels match a picture with a ray for every pixel, at its borders, too.
    #[test]
    fn squares_are_those_of_the_whole_picture() {
        let (phantom, volume) = shared(&Colon::embedded(1));
        let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
        let lumen = phantom.axis().frame(phantom.axis().length() * 0.4);
        let settings = Settings { step_power: -2, ..Settings::new(Quality::High) };
        for (_, level) in levels() {
            let mut fast = PacketRenderer::with_level(&volume, settings, Pixels::All, level);
            for [width, height] in [[1, 1], [3, 2], [70, 33], [33, 70]] {
                let view = View::new(lumen.at, lumen.tangent, lumen.normal, 90.0, width, height).unwrap();
                let (mut whole, mut part) = (Frame::default(), Frame::default());
                fast.render(&view, &mut whole);
                let across = width.div_ceil(SQUARE);
                let mut wanted: Vec<_> = (0..across * height.div_ceil(SQUARE)).map(|n| n * n % 7 < 3).collect();
                let is_wanted = |w: &[bool], n: usize| w[n / width / SQUARE * across + n % width / SQUARE];
                let work = fast.render_squares(&view, &mut part, &wanted);
                assert_eq!(work.rays, 4 * wanted.iter().filter(|w| **w).count() as u64);
                for (n, (a, b)) in whole.pixels().iter().zip(part.pixels()).enumerate() {
                    assert!(!is_wanted(&wanted, n) || a == b, "{width}x{height}: pixel {n}");
                }
                wanted.fill(false);
                assert_eq!(fast.render_squares(&view, &mut part, &wanted), Work::default());
            }
        }
    }

    #[test]
    fn what_is_left_out_of_a_colon_changes_nothing() {
        let (phantom, volume) = shared(&Colon::embedded(1));
        let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
        let axis = phantom.axis();
        let views = [0, 1, 2, 3].map(|n| {
            let lumen = axis.frame(axis.length() * (n as f64 + 0.5) / 4.0);
            // The last one looks from outside.
            let away = [0.0, 0.0, 0.0, 300.0][n];
            let angle = [60.0, 90.0, 150.0, 40.0][n];
            View::new(lumen.at - lumen.tangent * away, lumen.tangent, lumen.normal, angle, 100, 90).unwrap()
        });
        for power in [-6, -3, 0, 1, 3, 6] {
            let [taken, all] = compare(&volume, &views, power, Pixels::Needed);
            assert!(taken < all, "{taken} {all}");
        }
    }

    /// A thin-walled box, so wide that leaps are long, on axes that are not at right angles and with slices that are far apart.
    #[test]
    fn what_is_left_out_of_a_sheared_grid_changes_nothing() {
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.7, 0.7, 0.1), DVec3::new(0.2, -0.3, 0.9));
        for spacing in [DVec3::ONE, DVec3::new(0.3, 0.3, 3.0)] {
            let grid = Grid::new([120, 110, 100], spacing, DVec3::splat(-9.0), shear).unwrap();
            let box_of = |n: usize| {
                let [x, y, z] = [n % 120, n / 120 % 110, n / 120 / 110];
                matches!(x, 10 | 11 | 105 | 106) || matches!(y, 12 | 13 | 101 | 102) || matches!(z, 7 | 8 | 93 | 94)
            };
            let data = (0..grid.len()).map(|n| if box_of(n) { 100 } else { -1000 }).collect();
            let centre = grid.world(DVec3::new(60.0, 55.0, 50.0));
            let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
            // The directions along which a step moves farthest along an axis.
            let [x, y, z] = [shear.y_axis, shear.z_axis, shear.x_axis];
            let views = [x.cross(y), y.cross(z), z.cross(x), y.cross(x)]
                .map(|forward| View::new(centre, forward, DVec3::new(0.1, 0.2, 1.0), 100.0, 160, 160).unwrap());
            for pixels in [Pixels::Needed, Pixels::All] {
                let [taken, all] = compare(&volume, &views, 0, pixels);
                assert!(taken * 2 < all, "{taken} {all}");
            }
        }
    }

    /// If air itself is above the ramp's foot, the surroundings of a volume with lower values are visible.
    #[test]
    fn air_around_the_volume_is_seen_where_it_is_no_air_to_the_wall() {
        for ny in 18..22 {
            let grid = Grid::new([20, ny, 22], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let centre = grid.world(DVec3::new(10.0, 9.0, 11.0));
            let data = vec![-2000; grid.len()];
            let volume = PreparedVolume::new(
                Arc::new(Volume::new(grid, data)),
                TransferFunction::new(-1100.0, -1000.0).unwrap(),
            );
            let views = [DVec3::Y, DVec3::NEG_Y, DVec3::X]
                .map(|forward| View::new(centre, forward, DVec3::Z, 60.0, 40, 40).unwrap());
            for power in [0, 1, 2] {
                compare(&volume, &views, power, Pixels::All);
            }
        }
    }

    /// A renderer that refines takes half as many samples along its rays as one that takes steps of the given length.
    #[test]
    fn refining_takes_half_as_many_samples() {
        let grid = Grid::new([48; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        // A round room whose wall becomes opaque over seven voxels.
        let value = |n: usize| {
            let [x, y, z] = [n % 48, n / 48 % 48, n / 2304].map(|c| c as f64);
            (40.0 * ((DVec3::new(x, y, z) - 23.5).length() - 10.0) - 800.0).clamp(-1000.0, 0.0) as i16
        };
        let data = (0..grid.len()).map(value).collect();
        let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
        let view = View::new(DVec3::splat(23.5), DVec3::X, DVec3::Z, 90.0, 24, 24).unwrap();
        let settings = Settings::new(Quality::Reference);
        let mut all = PacketRenderer::new(&volume, settings, Pixels::All);
        let mut fewer = all.refining(settings).unwrap();
        let [all, fewer] = [all.render(&view, &mut Frame::default()), fewer.render(&view, &mut Frame::default())];
        assert_eq!(all.rays, fewer.rays);
        let share = fewer.samples as f64 / all.samples as f64;
        assert!((0.4..0.8).contains(&share), "{} samples instead of {}", fewer.samples, all.samples);
    }
}
