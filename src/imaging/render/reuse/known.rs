//! Proves which parts of a picture are empty, and derives from it where the rays of the next one are empty.
//!
//! Each pixel of the old picture is the square pyramid of all rays through it, and stores a distance up to which that
//! whole pyramid is empty ([`super::prove`]). Together the pyramids fill the old picture's view without gaps. A point
//! of a new ray is therefore known to be empty if it is within the old picture, in front of it, and nearer to the old
//! camera than the distance stored for the old pixel there.
//!
//! A bound is computed for all rays of a block of new pixels at once. From some distance z on, and without end, the
//! rays sweep a region whose projection is within the bounding box of eight points: the projections of its four corners
//! at z, and of its four directions. The block is empty up to the least distance of the old pixels in this box, less
//! the camera's motion. With z moved to that distance, the box shrinks and gives a better bound.

use glam::DVec3;
use rayon::prelude::*;

use crate::render::View;

/// Edge of the blocks of pixels whose least distances are stored besides the pixels', and of the blocks bounded first.
const COARSE: usize = 16;
/// Edge of the blocks of pixels that are bounded together in the end.
pub(crate) const BLOCK: usize = 4;
/// How far beyond its edges a pixel is proven to be empty, pixels: far more than the rounding of f64.
pub(crate) const BEYOND: f64 = 1e-3;
/// Boxes of more coarse blocks than this are not searched.
const MOST: usize = 400;

/// A pixel's record of how far its pyramid is empty, mm.
pub trait Empty {
    /// Returns the distance, mm; 0 if unknown.
    fn empty_mm(&self) -> f32;
}

impl Empty for f32 {
    fn empty_mm(&self) -> f32 {
        *self
    }
}

/// An old picture.
pub struct Known<K> {
    /// The view in which it was rendered.
    pub view: View,
    /// The record of each pixel.
    pub pixels: Vec<K>,
    /// The least distance of each coarse block, mm.
    coarse: Vec<f32>,
}

impl<K: Empty + Sync> Known<K> {
    /// Creates the record of a picture from its `pixels`.
    pub fn new(view: View, pixels: Vec<K>, mut coarse: Vec<f32>) -> Self {
        let (width, blocks) = (view.width(), view.width().div_ceil(COARSE));
        coarse.clear();
        coarse.resize(blocks * view.height().div_ceil(COARSE), f32::INFINITY);
        coarse.par_chunks_mut(blocks).zip(pixels.par_chunks(COARSE * width)).for_each(|(coarse, rows)| {
            for row in rows.chunks_exact(width) {
                for (least, pixels) in coarse.iter_mut().zip(row.chunks(COARSE)) {
                    *least = pixels.iter().fold(*least, |l, p| l.min(p.empty_mm()));
                }
            }
        });
        Self { view, pixels, coarse }
    }

    /// Returns the memory taken, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.pixels.as_slice()) + size_of_val(self.coarse.as_slice())
    }

    /// Returns its memory for reuse.
    pub fn into_parts(self) -> (Vec<K>, Vec<f32>) {
        (self.pixels, self.coarse)
    }

    /// Returns the least distance over the pixels from column `x[0]` to `x[1]` and row `y[0]` to `y[1]`, mm; 0 if that
    /// would take too long to find.
    fn least(&self, x: [usize; 2], y: [usize; 2]) -> f64 {
        let width = self.view.width();
        let scan = |row: &[f32]| row.iter().fold(f32::INFINITY, |l, v| l.min(*v));
        let least = if (x[1] - x[0] + 1) * (y[1] - y[0] + 1) <= 2 * COARSE * BLOCK {
            let row = |j: usize| self.pixels[j * width + x[0]..=j * width + x[1]].iter();
            (y[0]..=y[1]).flat_map(row).fold(f32::INFINITY, |l, p| l.min(p.empty_mm()))
        } else {
            let blocks = width.div_ceil(COARSE);
            let [x, y] = [x, y].map(|c| c.map(|c| c / COARSE));
            if (x[1] - x[0] + 1) * (y[1] - y[0] + 1) > MOST {
                return 0.0;
            }
            (y[0]..=y[1])
                .map(|j| scan(&self.coarse[j * blocks + x[0]..=j * blocks + x[1]]))
                .fold(f32::INFINITY, f32::min)
        };
        f64::from(least)
    }
}

/// The motion and rotation of a perspective camera since the old picture.
pub struct Reprojection {
    old: Image,
    new: Image,
    /// The new camera's position in the old one's axes: forward, right, up; mm.
    pub moved: DVec3,
    /// The new camera's axes in the old one's.
    axes: [DVec3; 3],
}

/// The image of a perspective camera.
struct Image {
    size: [usize; 2],
    /// Side of a pixel at distance 1.
    pixel: f64,
    centre: [f64; 2],
}

impl Image {
    /// Returns the image of `view`; `None` unless its camera is perspective.
    fn new(view: &View) -> Option<Self> {
        Some(Self { size: [view.width(), view.height()], pixel: view.pixel()?, centre: view.centre() })
    }
}

impl Reprojection {
    /// Computes the motion from the `old` picture to the `new` one; `None` unless both have a perspective camera.
    pub fn new(old: &View, new: &View) -> Option<Self> {
        let turn = |v: DVec3| DVec3::new(v.dot(old.forward()), v.dot(old.right()), v.dot(old.up()));
        let moved = turn(new.position() - old.position());
        let axes = [new.forward(), new.right(), new.up()].map(turn);
        Some(Self { old: Image::new(old)?, new: Image::new(new)?, moved, axes })
    }

    /// Returns the direction through the point (`x`, `y`) of the new image in the old camera's axes.
    ///
    /// Its length is the distance at which it meets the plane at distance 1 from the new camera.
    #[inline]
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        let Image { pixel, centre, .. } = self.new;
        let (a, b) = ((x - centre[0]) * pixel, (centre[1] - y) * pixel);
        self.axes[0] + self.axes[1] * a + self.axes[2] * b
    }

    /// Returns where a position (in the old camera's axes) appears in the old image, pixels. The result is not finite
    /// or far outside the image if it does not appear.
    #[inline]
    pub fn project(&self, p: DVec3) -> [f64; 2] {
        let Image { pixel, centre, .. } = self.old;
        let scale = 1.0 / (p.x * pixel);
        [centre[0] + p.y * scale, centre[1] - p.z * scale]
    }

    /// Returns the block's box in the old image (pixels, `[first, last]` in x and y) from `from` mm on.
    fn shadow(&self, corners: &[DVec3; 4], from: f64) -> Option<[[usize; 2]; 2]> {
        // Rays of the block are at least this far in front of the camera's plane when they are `from` mm away.
        let longest = corners.iter().fold(0.0f64, |l, c| l.max(c.length_squared())).sqrt();
        let still = self.moved == DVec3::ZERO;
        let depth = if still { 1.0 } else { from / longest };
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &c in corners {
            for p in [c, self.moved + c * depth] {
                // Also rejects points so near the camera's plane that rounding decides.
                if p.x.is_nan() || p.x <= 1e-9 * p.abs().max_element() {
                    return None;
                }
                let at = self.project(p);
                for a in 0..2 {
                    low[a] = low[a].min(at[a]);
                    high[a] = high[a].max(at[a]);
                }
            }
        }
        let sides = self.old.size.map(|n| n as f64);
        // Old pixels are proven to be empty slightly beyond their edges, so that a block that coincides with old pixels
        // needs no others.
        let inside = |a: usize| low[a] >= -BEYOND && high[a] <= sides[a] + BEYOND;
        (inside(0) && inside(1)).then(|| {
            std::array::from_fn(|a| {
                let first = (low[a] + BEYOND).max(0.0) as usize;
                [first, ((high[a] - BEYOND).ceil().max(1.0) as usize - 1).max(first)]
            })
        })
    }
}

/// How far blocks of a new picture are known to be empty from an old one.
pub(crate) struct Bounds {
    blocks: usize,
    mm: Vec<f32>,
}

impl Bounds {
    /// Computes bounds for the rays of `motion`'s new picture, whose first `free` mm (in all directions) are known to be empty.
    ///
    /// Coarse blocks selected by `skip` keep the bound `free`.
    pub(crate) fn new<K: Empty + Sync>(
        known: &Known<K>,
        motion: &Reprojection,
        free: f64,
        skip: impl Fn(usize) -> bool + Sync,
        mut mm: Vec<f32>,
    ) -> Self {
        const SPLIT: usize = COARSE / BLOCK;
        let [width, height] = motion.new.size;
        let blocks = width.div_ceil(BLOCK);
        mm.clear();
        mm.resize(blocks * height.div_ceil(BLOCK), free as f32);
        let coarse = width.div_ceil(COARSE);
        mm.par_chunks_mut(blocks * SPLIT).enumerate().for_each(|(j, rows)| {
            for i in (0..coarse).filter(|i| !skip(j * coarse + i)) {
                let corner = |n: usize, side: usize| [n * side, (n + 1) * side];
                let (x, y) = (corner(i, COARSE), corner(j, COARSE));
                let all = bound(known, motion, x.map(|x| x.min(width)), y.map(|y| y.min(height)), free, 4);
                for (v, row) in rows.chunks_exact_mut(blocks).enumerate() {
                    for (u, out) in row.iter_mut().enumerate().skip(i * SPLIT).take(SPLIT) {
                        let (x, y) = (corner(u, BLOCK), corner(j * SPLIT + v, BLOCK));
                        let one = bound(known, motion, x.map(|x| x.min(width)), y.map(|y| y.min(height)), all, 2);
                        // Rounded down; infinite bounds stay infinite.
                        *out = (one * (1.0 - 1e-6)) as f32;
                    }
                }
            }
        });
        Self { blocks, mm }
    }

    /// Returns the bound of pixel (`x`, `y`), mm.
    #[inline(always)]
    pub(crate) fn at(&self, x: usize, y: usize) -> f32 {
        self.mm[x / BLOCK + self.blocks * (y / BLOCK)]
    }

    /// Returns its memory for reuse.
    pub(crate) fn into_mm(self) -> Vec<f32> {
        self.mm
    }
}

/// Returns how far the block of new pixels between the given edges is empty, mm. It must be empty up to `free` mm.
fn bound<K: Empty + Sync>(
    known: &Known<K>,
    motion: &Reprojection,
    x: [usize; 2],
    y: [usize; 2],
    mut free: f64,
    turns: usize,
) -> f64 {
    let [x, y] = [x, y].map(|c| c.map(|c| c as f64));
    let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| motion.direction(x[i], y[j]));
    let middle = motion.direction(0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])).normalize();
    let off = corners.iter().fold(0.0f64, |m, c| m.max((c.normalize() - middle).length()));
    let far = motion.moved.length();
    // The greatest part of the motion in the direction of any ray of the block.
    let along = motion.moved.dot(middle) + far * off;
    for _ in 0..turns {
        let Some([i, j]) = motion.shadow(&corners, free) else { break };
        let least = known.least(i, j);
        // A point t mm along a ray d is |moved + t·d| from the old camera; this is where that equals `least`.
        let room = least * least - far * far + along * along;
        let reached = if least > far { room.max(0.0).sqrt() - along } else { 0.0 };
        if reached <= free {
            break;
        }
        let gain = reached - free;
        free = reached;
        if gain < 0.02 * free {
            break;
        }
    }
    free
}
