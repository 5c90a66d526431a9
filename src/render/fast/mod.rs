//! The ray caster for flights: sixteen rays at once, leaping in bundles, shaded cell by cell.

mod beam;
mod cells;
mod fit;
mod halved;
mod lanes;
mod lattice;
mod occupancy;
mod packet;
mod paint;
mod passage;
mod picture;
mod refine;

use std::sync::{Arc, Mutex, PoisonError};

use fearless_simd::Level;

use super::caster::depths;
use super::{Direct, Frame, Renderer, Settings, Space, View, Work};
use cells::Cells;
pub use lattice::BLOCK;
use lattice::Lattice;
use occupancy::Occupancy;
use packet::Rays;

/// The name of the SIMD level that packets of rays use on this machine.
pub fn simd_level() -> &'static str {
    name(Level::new())
}

/// The SIMD levels of this machine that packets of rays are compiled for, the best first, with their names.
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

/// Which pixels get a ray of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Pixels {
    /// Those that the rays around do not tell of.
    #[default]
    Needed,
    /// All.
    All,
}

/// Renders one space by packets of rays.
pub struct Fast {
    space: Space,
    settings: Settings,
    pixels: Pixels,
    occupancy: Arc<Occupancy>,
    /// A cache for each thread; what is in it depends on the space alone.
    cells: Arc<[Mutex<Cells>]>,
    lattice: Lattice,
    level: Level,
    direct: Direct,
}

impl Fast {
    /// Prepares `space`: one parallel pass over its voxels.
    pub fn new(space: &Space, settings: Settings, pixels: Pixels) -> Self {
        Self::with_level(space, settings, pixels, Level::new())
    }

    /// As [`Fast::new`], on a given SIMD level.
    pub fn with_level(space: &Space, settings: Settings, pixels: Pixels, level: Level) -> Self {
        let occupancy = Arc::new(Occupancy::new(space.volume(), space.wall()));
        let cells = (0..rayon::current_num_threads()).map(|_| Mutex::default()).collect();
        let direct = Direct::new(space, settings);
        Self { space: space.clone(), settings, pixels, occupancy, cells, lattice: Lattice::default(), level, direct }
    }

    /// Another renderer of the same space, which shares what was prepared.
    pub fn beside(&self, settings: Settings) -> Self {
        Self {
            space: self.space.clone(),
            settings,
            pixels: self.pixels,
            occupancy: Arc::clone(&self.occupancy),
            cells: Arc::clone(&self.cells),
            lattice: Lattice::default(),
            level: self.level,
            direct: Direct::new(&self.space, settings),
        }
    }

    /// Memory taken by what is not shared with those [beside](Fast::beside), bytes.
    pub fn own_bytes(&self) -> usize {
        self.lattice.bytes()
    }

    /// As [`Renderer::render`], with a ray for every pixel of the blocks of [`BLOCK`] × [`BLOCK`] pixels that are `wanted`,
    /// row by row of blocks; what `frame` holds elsewhere is not told.
    pub fn render_blocks(&mut self, view: &View, frame: &mut Frame, wanted: &[bool]) -> Work {
        let Some(rays) = Rays::new(&self.space, &self.occupancy, view, &self.settings) else {
            return self.direct.render(view, frame);
        };
        frame.resize(view.width(), view.height());
        picture::pixels_of(&rays, view, frame.buffers().0, &self.cells, self.level, Some(wanted))
    }
}

impl Renderer for Fast {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        let Some(rays) = Rays::new(&self.space, &self.occupancy, view, &self.settings) else {
            return self.direct.render(view, frame);
        };
        frame.resize(view.width(), view.height());
        let (pixels, depth) = frame.buffers();
        if let Some(depth) = depth {
            depths(&self.space, view, depth);
        }
        match self.pixels {
            Pixels::Needed => picture::needed(&mut self.lattice, &rays, view, pixels, &self.cells, self.level),
            Pixels::All => picture::pixels_of(&rays, view, pixels, &self.cells, self.level, None),
        }
    }

    fn parts(&self) -> Vec<(&'static str, usize)> {
        let cells = self.cells.iter().map(|c| c.lock().unwrap_or_else(PoisonError::into_inner).bytes());
        vec![
            ("homogeneous-region flags", self.space.bytes()),
            ("cells that may be seen, and distances of bricks", self.occupancy.bytes()),
            ("gradient cache", cells.sum()),
            ("rays of the lattice", self.lattice.bytes()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::{Phantom, Settings as Colon, Size};
    use crate::progress::Progress;
    use crate::render::{Quality, Wall};

    /// With and without the knowledge of empty cells, pictures are the same to the bit, with steps from an eighth of a voxel to eight.
    #[test]
    fn what_is_left_out_changes_nothing() {
        let space = Space::new(Arc::new(Phantom::embedded(&Progress::default()).unwrap()), Wall::default());
        let phantom = Phantom::new(&Colon { size: Size::Small, ..Colon::default() });
        let axis = &phantom.shape().axis;
        let everything = Arc::new(Occupancy::new(space.volume(), Wall::new(-3000.0, 0.0).unwrap()));
        for power in [-3, 0, 1, 3] {
            let settings = Settings { step_power: power, ..Settings::new(Quality::High) };
            let mut fast = Fast::new(&space, settings, Pixels::Needed);
            let mut slow = fast.beside(settings);
            slow.occupancy = Arc::clone(&everything);
            for n in 0..4 {
                let lumen = axis.frame(axis.length() * (n as f64 + 0.5) / 4.0);
                // The last one from outside.
                let away = [0.0, 0.0, 0.0, 300.0][n];
                let angle = [60.0, 90.0, 150.0, 40.0][n];
                let view =
                    View::new(lumen.at - lumen.tangent * away, lumen.tangent, lumen.normal, angle, 100, 90).unwrap();
                let (mut a, mut b) = (Frame::default(), Frame::default());
                let (quick, all) = (fast.render(&view, &mut a), slow.render(&view, &mut b));
                assert!(a == b, "step 2^{power}, view {n}");
                assert!(quick.samples < all.samples && quick.rays == all.rays, "{} {}", quick.samples, all.samples);
            }
        }
    }
}
