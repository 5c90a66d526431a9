//! The gradient cache (the paper's cache at frame level): the regressions at a cell's eight corners, kept as long as there is room.
//!
//! A voxel covers hundreds of pixels of a colon's wall, and the next frame shows nearly the same cells. Where a voxel
//! covers few pixels, [`fit`](super::fit) works without the cache.
//!
//! [`gradient_store`](crate::render::gradient_store) keeps quantised gradients of single voxels, shared by all threads, for rays
//! traced one by one. Sixteen rays are shaded cell by cell, in full precision, and each thread has its own cache.

use glam::{Mat3, Vec3, Vec4, Vec4Swizzles};

use crate::render::regression::{Block, Regression, block};
use crate::volume::Volume;

/// Number of cells kept, a power of two. Four times as many are no faster.
const SIZE: usize = 1 << 13;

/// World gradient (HU/mm) in a cell, as the coefficients of a trilinear polynomial of the position within it: k₀ + k₁u
/// + k₂v + k₃w + k₄uv + k₅uw + k₆vw + k₇uvw for each component.
pub(crate) type Corners = [[f32; 8]; 3];

/// A direct-mapped cache. Earlier lookups affect only the time a lookup takes, never its result.
pub(crate) struct Cells {
    keys: Vec<i32>,
    corners: Vec<Corners>,
    /// Red, green and blue that a custom shader has given to the rays of the current packet.
    pub colours: Colours,
}

/// Red, green and blue of sixteen rays.
pub(crate) type Colours = [[f32; 16]; 3];

impl Default for Cells {
    fn default() -> Self {
        Self { keys: vec![-1; SIZE], corners: vec![[[0.0; 8]; 3]; SIZE], colours: [[0.0; 16]; 3] }
    }
}

impl Cells {
    /// Returns the gradient in the cell `key`, whose position (counted from cell −1) is `cell`.
    #[inline(always)]
    pub(crate) fn get(&mut self, source: &Source, key: i32, cell: [i32; 3]) -> &Corners {
        // Neighbours along each axis map to different slots.
        let at = (cell[0] & 31 | (cell[1] & 15) << 5 | (cell[2] & 15) << 9) as usize % SIZE;
        if self.keys[at] != key {
            self.keys[at] = key;
            source.corners(cell, &mut self.corners[at]);
        }
        &self.corners[at]
    }

    /// Returns the memory taken, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.keys.len() * size_of::<i32>() + self.corners.len() * size_of::<Corners>()
    }
}

/// The source of gradients: a volume and its regression.
pub(crate) struct Source<'a> {
    volume: &'a Volume,
    regression: Regression,
    to_world: Mat3,
}

impl<'a> Source<'a> {
    /// Uses the regressions of `volume`, turned into world gradients by `to_world`.
    pub(crate) fn new(volume: &'a Volume, regression: Regression, to_world: Mat3) -> Self {
        Self { volume, regression, to_world }
    }

    /// The regression.
    #[inline(always)]
    pub(crate) fn regression(&self) -> &Regression {
        &self.regression
    }

    /// Returns the rows of the matrix that turns changes along the index axes into a world gradient.
    #[inline(always)]
    pub(crate) fn to_world(&self) -> [Vec3; 3] {
        [0, 1, 2].map(|n| self.to_world.row(n))
    }

    /// Computes a cell's entry. Out of line, because it is rare and needs other registers than the rays.
    #[inline(never)]
    fn corners(&self, cell: [i32; 3], out: &mut Corners) {
        let [a, b, c] = at_corners(&self.regression, &block(self.volume, cell.map(|c| c - 2)));
        for (row, out) in self.to_world().iter().zip(out) {
            let [near, far] = [0, 1].map(|z: usize| a[z] * row.x + b[z] * row.y + c[z] * row.z);
            let [a, b, c, d] = near.to_array();
            let [e, f, g, h] = far.to_array();
            *out = [a, b - a, c - a, e - a, d - c - b + a, f - e - b + a, g - e - c + a, h - g - f + e - d + c + b - a];
        }
    }
}

/// Returns the regression's A, B and C at the eight inner voxels of a block.
///
/// For z = 0 and 1 the voxels are (0, 0), (1, 0), (0, 1), (1, 1) of (x, y). The sums are those of [`Regression::fit`],
/// without its interpolation.
fn at_corners(r: &Regression, block: &Block) -> [[Vec4; 2]; 3] {
    let middle = |p: Vec4, q: Vec4| Vec4::new(p.y, p.z, q.y, q.z);
    let low = |p: Vec4, q: Vec4| Vec4::new(p.x, p.y, q.x, q.y);
    let high = |p: Vec4, q: Vec4| Vec4::from((p.zw(), q.zw()));
    // For each slice: what A and B take from the slice itself and from its neighbours, and what C takes from the neighbours.
    let slice = |[r0, r1, r2, r3]: [Vec4; 4]| {
        let (sum, difference) = ((r0 + r2, r1 + r3), (r2 - r0, r3 - r1));
        // Even and odd parts along x: of the rows themselves, and of the sums and the differences of their neighbours.
        let (cc, (lo, hi)) = (middle(r1, r2), (low(r1, r2), high(r1, r2)));
        let (ec, oc) = (hi + lo, hi - lo);
        let (ce, (lo, hi)) = (middle(sum.0, sum.1), (low(sum.0, sum.1), high(sum.0, sum.1)));
        let (ee, oe) = (hi + lo, hi - lo);
        let co = middle(difference.0, difference.1);
        let eo = low(difference.0, difference.1) + high(difference.0, difference.1);
        let [a, b, c] = [r.a, r.b, r.c];
        [
            oc * a[0][0] + oe * a[0][1],
            oc * a[1][0] + oe * a[1][1],
            co * b[0][0] + eo * b[1][0],
            co * b[0][1] + eo * b[1][1],
            cc * c[0][0] + ce * c[0][1] + ec * c[1][0] + ee * c[1][1],
        ]
    };
    let [p, q, r, s] = [slice(block[0]), slice(block[1]), slice(block[2]), slice(block[3])];
    [[q[0] + p[1] + r[1], r[0] + q[1] + s[1]], [q[2] + p[3] + r[3], r[2] + q[3] + s[3]], [r[4] - p[4], s[4] - q[4]]]
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::math::hash;
    use crate::render::regression::Weighting;
    use crate::volume::Grid;

    #[test]
    fn corners_are_the_regressions_of_the_voxels() {
        let spacing = DVec3::new(0.7, 0.9, 1.3);
        let grid = Grid::new([6, 5, 7], spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..grid.len() as u64).map(|n| (2000.0 * hash::uniform(7, n)) as i16 - 1000).collect();
        let volume = Volume::new(grid, data);
        let regression = Regression::new(spacing, Weighting::InverseSquare);
        let source = Source::new(&volume, regression, Mat3::IDENTITY);
        let mut cells = Cells::default();
        for z in 0..=7 {
            for y in 0..=5 {
                for x in 0..=6 {
                    let cell = [x, y, z];
                    let k = *cells.get(&source, x + 100 * (y + 100 * z), cell);
                    let voxels = block(&volume, cell.map(|c| c - 2));
                    for n in 0..8u8 {
                        let t = Vec3::new(f32::from(n & 1), f32::from(n >> 1 & 1), f32::from(n >> 2));
                        let expected = regression.fit(&voxels, t).gradient;
                        let [u, v, w] = t.to_array();
                        let got = Vec3::from_array(k.map(|k| {
                            k[0] + k[1] * u
                                + k[2] * v
                                + k[3] * w
                                + k[4] * u * v
                                + k[5] * u * w
                                + k[6] * v * w
                                + k[7] * u * v * w
                        }));
                        assert!((got - expected).length() < 1e-2, "{cell:?} {n}: {got} {expected}");
                    }
                }
            }
        }
    }
}
