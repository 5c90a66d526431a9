//! Skipping of samples that need not be evaluated.

use glam::{Vec3, Vec3A};

use super::march::Ray;
use super::sampler::nearest;
use crate::space::PreparedVolume;
use crate::space::flags::{BRICK_SHIFT, Flags};

/// Leaps over samples whose opacity is 0.
///
/// An implementation may only leave out such samples, so all of them produce the same picture bit for bit.
pub trait Skipper: Sync {
    /// The state of a ray's walk.
    type Walk;

    /// Starts a ray at sample `n`, which must be one of its samples.
    fn start(&self, ray: &Ray, n: u32) -> Self::Walk;

    /// Returns the first sample from `n` on that may be visible, or the ray's count or more if there is none.
    fn next(&self, walk: &mut Self::Walk, ray: &Ray, n: u32) -> u32;
}

/// Skips nothing: brute force.
pub struct Everything;

impl Skipper for Everything {
    type Walk = ();

    fn start(&self, _: &Ray, _: u32) {}

    #[inline(always)]
    fn next(&self, (): &mut (), _: &Ray, n: u32) -> u32 {
        n
    }
}

/// Leaps over empty bricks, and with `VOXELS` also over single voxels that are flagged as homogeneous and empty.
///
/// A voxel's flag only covers 3×3×3 voxels, which is too few where a sample depends on the regressions of all eight
/// voxels around it.
pub struct Leap<'a, const VOXELS: bool> {
    volume: &'a PreparedVolume,
    flags: &'a Flags,
}

/// A ray walking from brick to brick (Amanatides and Woo 1987), without branches: it is bound by latency, not throughput.
pub struct Bricks {
    /// The planes ahead, grown voxel coordinates.
    planes: Vec3A,
    /// Offset from one plane to the next.
    step: Vec3A,
    /// The numbers of samples after which the planes ahead are met.
    meets: Vec3A,
    inverse: Vec3A,
    offset: Vec3A,
    /// The index of the brick in the list of bricks.
    brick: isize,
    /// The change of that index for each set of axes along which the walk advances (bit 0: x, …).
    strides: [isize; 8],
    /// Samples from here on are in later bricks.
    exit: u32,
}

impl Bricks {
    /// Returns a lower bound for the number of samples before the next plane, allowing for f32 errors.
    #[inline(always)]
    fn fewest_before(ahead: f32) -> u32 {
        ((ahead - Self::slack(ahead)) as u32).saturating_add(1)
    }

    /// Returns an upper bound for the number of samples before the next plane, allowing for f32 errors.
    #[inline(always)]
    fn most_before(ahead: f32) -> u32 {
        ((ahead + Self::slack(ahead)) as u32).saturating_add(1)
    }

    /// Returns an upper bound for the f32 error, samples.
    #[inline(always)]
    fn slack(ahead: f32) -> f32 {
        0.01 + ahead * 1e-6
    }

    /// Advances by one brick and returns the number of samples at which that happens.
    #[inline(always)]
    fn advance(&mut self) -> f32 {
        let t = self.meets.min_element();
        let now = self.meets.cmple(Vec3A::splat(t));
        self.planes += Vec3A::select(now, self.step, Vec3A::ZERO);
        self.meets = self.planes * self.inverse + self.offset;
        self.brick += self.strides[now.bitmask() as usize & 7];
        t
    }
}

impl<'a, const VOXELS: bool> Leap<'a, VOXELS> {
    /// Leaps by the flags of `volume`.
    pub fn new(volume: &'a PreparedVolume) -> Self {
        Self { volume, flags: volume.flags() }
    }
}

/// Returns true if the nearest voxel to `q` and its 26 neighbours are empty.
#[inline(always)]
pub(super) fn is_empty_voxel(volume: &PreparedVolume, q: Vec3) -> bool {
    let voxels = volume.voxels();
    let dims = voxels.grid().dims();
    let [i, j, k] = nearest(q).map(|c| c.wrapping_sub(1) as usize);
    i < dims[0]
        && j < dims[1]
        && k < dims[2]
        && voxels.data()[voxels.grid().index(i, j, k)] <= volume.flags().empty_up_to()
        && volume.flags().homogeneous(voxels, i, j, k)
}

impl<const VOXELS: bool> Skipper for Leap<'_, VOXELS> {
    type Walk = Bricks;

    #[inline(always)]
    fn start(&self, ray: &Ray, n: u32) -> Bricks {
        const EDGE: f32 = (1 << BRICK_SHIFT) as f32;
        let bricks = self.flags.bricks().map(|n| n as i32);
        let from = (ray.at(n) / EDGE).to_array().map(|c| c as i32);
        let b: [i32; 3] = std::array::from_fn(|a| from[a].clamp(0, bricks[a] - 1));
        let forward = ray.inverse.cmpge(Vec3::ZERO);
        let b_f = Vec3::new(b[0] as f32, b[1] as f32, b[2] as f32);
        let planes = Vec3A::from((b_f + Vec3::select(forward, Vec3::ONE, Vec3::ZERO)) * EDGE);
        let (inverse, offset) = (Vec3A::from(ray.inverse), Vec3A::from(ray.offset));
        let index =
            |v: [i32; 3]| v[0] as isize + bricks[0] as isize * (v[1] as isize + bricks[1] as isize * v[2] as isize);
        let sign: [i32; 3] = std::array::from_fn(|a| if forward.test(a) { 1 } else { -1 });
        let mut walk = Bricks {
            planes,
            step: Vec3A::from(Vec3::select(forward, Vec3::splat(EDGE), Vec3::splat(-EDGE))),
            meets: planes * inverse + offset,
            inverse,
            offset,
            brick: index(b),
            strides: std::array::from_fn(|set| {
                index(std::array::from_fn(|a| if set >> a & 1 == 1 { sign[a] } else { 0 }))
            }),
            exit: 0,
        };
        if !self.flags.empty_brick(walk.brick) {
            walk.exit = Bricks::most_before(walk.meets.min_element());
        }
        walk
    }

    #[inline(always)]
    fn next(&self, walk: &mut Bricks, ray: &Ray, mut n: u32) -> u32 {
        let count = ray.count as f32;
        loop {
            let end = walk.exit.min(ray.count);
            while n < end {
                if !VOXELS || !is_empty_voxel(self.volume, ray.at(n)) {
                    return n;
                }
                // The whole neighbourhood is empty, out to one voxel from its centre, and the sample is within half a
                // voxel of it. So are all samples that are less than another half voxel away.
                n += ray.near;
            }
            // Advance to the next brick in which something may be visible.
            let entry = loop {
                let t = walk.advance();
                if t >= count {
                    return ray.count;
                }
                if !self.flags.empty_brick(walk.brick) {
                    break t;
                }
            };
            n = n.max(Bricks::fewest_before(entry));
            walk.exit = Bricks::most_before(walk.meets.min_element());
        }
    }
}
