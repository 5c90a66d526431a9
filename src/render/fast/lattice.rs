//! Pixels between rays. A voxel of the wall covers hundreds of pixels of a frame, so that most rays tell nothing new.
//!
//! Rays are cast through the corners and the centres of blocks of 4×4 pixels. Where the centre is what the corners make
//! one expect, and nothing else speaks against it, the block's pixels are interpolated; everywhere else each pixel gets
//! its own ray. What must hold ([`Block::is_smooth`]):
//!
//! - all five rays end in the wall after a single passage, or all five meet nothing;
//! - its rays (corners and centre) are no farther apart than two voxels where it lies, which is how long the finest waves
//!   are that the scan can hold: it has little to show between them;
//! - inverse depth, which is linear over a plane, and brightness are those of the corners' mean at the centre, and the
//!   corners are not twisted.
//!
//! Between the corners values are bilinear, with a tent over the centre for what it differs by: blocks meet without a
//! seam.

use super::packet::Light;

/// Side of a block, pixels.
pub const BLOCK: usize = 4;
/// By how much the centre may differ from the corners' mean: brightness, 0 to 1.
const BRIGHTNESS: f32 = 0.016;
/// The most that brightness may change over a block.
const CONTRAST: f32 = 0.5;
/// By how much the centre's depth may differ, voxels (the smallest spacing).
const DEPTH: f32 = 0.15;
/// The most that depth may change over a block, voxels.
const SLOPE: f32 = 3.0;
/// The largest side of a block, voxels: 2√2, at which the rays of corners and centres are 2 voxels apart.
const SIDE: f32 = 2.83;
/// A ray has ended in the wall when no more than this comes from beyond.
const OPAQUE: f32 = 0.02;

/// What came of one ray.
#[derive(Clone, Copy, Debug, Default)]
pub struct Point {
    /// As [`Light::bright`].
    pub bright: f32,
    /// As [`Light::tone`].
    pub tone: f32,
    /// 1 / depth, 1 / voxels of the smallest spacing; 0 where nothing was met.
    pub near: f32,
    /// Whether the ray ended in the wall after a single passage, or met nothing.
    pub plain: bool,
}

impl Point {
    /// Lane `n` of a packet whose steps are `step` voxels of the smallest spacing long.
    pub fn new(light: &Light, n: usize, step: f32) -> Self {
        let weight = 1.0 - light.through[n];
        let nothing = weight <= 0.0;
        let ended = light.through[n] <= OPAQUE && light.mixed >> n & 1 == 0 && light.depth[n] > 0.0;
        Self {
            bright: light.bright[n],
            tone: light.tone[n],
            near: if nothing { 0.0 } else { weight / (light.depth[n] * step).max(1e-6) },
            plain: nothing || ended,
        }
    }
}

/// The rays of a block: the corners (left to right, then top to bottom) and the centre.
pub struct Block {
    /// Corners.
    pub corners: [Point; 4],
    /// Centre.
    pub centre: Point,
}

impl Block {
    /// Whether the pixels between may be interpolated. `side` is the side of the block at distance 1.
    pub fn is_smooth(&self, side: f32) -> bool {
        let [a, b, c, d] = self.corners;
        let e = self.centre;
        if !(a.plain && b.plain && c.plain && d.plain && e.plain) {
            return false;
        }
        let nearest = a.near.min(b.near).min(c.near).min(d.near).min(e.near);
        let farthest = a.near.max(b.near).max(c.near).max(d.near).max(e.near);
        if farthest == 0.0 {
            return true;
        }
        // With n = 1/depth, a small change of n by δ is one of depth by δ/n².
        let scale = 1.0 / (e.near * e.near);
        let bend = (e.near - 0.25 * (a.near + b.near + c.near + d.near)).abs() * scale;
        let twist = (a.near + d.near - b.near - c.near).abs() * scale;
        let pale = (e.bright - 0.25 * (a.bright + b.bright + c.bright + d.bright)).abs();
        let turn = (a.bright + d.bright - b.bright - c.bright).abs();
        let low = a.bright.min(b.bright).min(c.bright).min(d.bright);
        let high = a.bright.max(b.bright).max(c.bright).max(d.bright);
        nearest > 0.0
            && side <= SIDE * e.near
            && (farthest - nearest) * scale <= SLOPE
            && bend <= DEPTH
            && twist <= 4.0 * DEPTH
            && pale <= BRIGHTNESS
            && turn <= 4.0 * BRIGHTNESS
            && high - low <= CONTRAST
    }
}

/// Weights of a block's rays (corners, then centre) in each of its pixels, row by row: bilinear between the corners, and
/// a tent over the centre for what it differs by from their mean.
pub static WEIGHTS: [[f32; BLOCK * BLOCK]; 5] = weights();

const fn weights() -> [[f32; BLOCK * BLOCK]; 5] {
    let mut all = [[0.0; BLOCK * BLOCK]; 5];
    let mut n = 0;
    while n < BLOCK * BLOCK {
        let (u, v) = ((n % BLOCK) as f32 / BLOCK as f32, (n / BLOCK) as f32 / BLOCK as f32);
        let (du, dv) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let tent = (1.0 - if du < 0.0 { -du } else { du }) * (1.0 - if dv < 0.0 { -dv } else { dv });
        all[0][n] = (1.0 - u) * (1.0 - v) - 0.25 * tent;
        all[1][n] = u * (1.0 - v) - 0.25 * tent;
        all[2][n] = (1.0 - u) * v - 0.25 * tent;
        all[3][n] = u * v - 0.25 * tent;
        all[4][n] = tent;
        n += 1;
    }
    all
}
