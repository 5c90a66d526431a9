//! The homogeneous-region flag (the paper's section 2.2): one bit a voxel, and a coarse level of bricks to leap by.
//!
//! A voxel's flag is set when its 3×3×3 neighbourhood, with air outside the volume, lies wholly in one class: *empty*
//! (≤ the wall's `lo`) or *opaque* (≥ its `hi`); the voxel's own value tells which. It costs 1/16 of the 16-bit volume.
//!
//! Rays see the volume grown by one voxel of air, since a trilinear cell at the border still mixes voxels with air. So
//! bricks hold 8×8×8 *cells*, the first of them being cell −1 of each axis. A brick is empty when every voxel that a
//! cell of it touches is flagged empty: then all voxels within two of any point in it are empty, which is enough for
//! trilinear values and for regressions over 3×3×3 neighbourhoods alike.

use rayon::prelude::*;

use crate::volume::{AIR_HU, Volume};

use super::space::Wall;

/// Cells along a brick's edge, as a power of two.
pub const BRICK_SHIFT: u32 = 3;
/// Slices that one task flags; it reads one more on either side.
const SLAB: usize = 16;

/// Homogeneous-region flags of a volume, and its empty bricks.
#[derive(Clone, Debug)]
pub struct Flags {
    dims: [usize; 3],
    /// 64-bit words in a row of flags.
    words: usize,
    bits: Vec<u64>,
    bricks: [usize; 3],
    empty: Vec<bool>,
    /// Greatest voxel value that is empty.
    lo: i16,
}

/// The values that are empty (`≤ lo`) and opaque (`≥ hi`), as whole HU.
#[derive(Clone, Copy)]
struct Classes {
    lo: i16,
    hi: i16,
}

impl Flags {
    /// Flags of `volume` for the classes of `wall`, in parallel.
    pub fn new(volume: &Volume, wall: Wall) -> Self {
        // `Wall` keeps its bounds within ±32767, so both roundings fit.
        let classes = Classes { lo: wall.lo().floor() as i16, hi: wall.hi().ceil() as i16 };
        let dims = volume.grid().dims();
        let words = dims[0].div_ceil(64);
        let plane = words * dims[1];
        let mut bits = vec![0u64; plane * dims[2]];
        bits.par_chunks_mut(plane * SLAB).enumerate().for_each(|(n, slab)| {
            flag_slab(volume, classes, n * SLAB, words, slab);
        });
        let bricks = dims.map(|n| (n + 1).div_ceil(1 << BRICK_SHIFT));
        let mut flags = Self { dims, words, bits, bricks, empty: Vec::new(), lo: classes.lo };
        let mut empty = vec![false; bricks.iter().product()];
        empty.par_chunks_mut(bricks[0] * bricks[1]).enumerate().for_each(|(bz, layer)| {
            for (n, e) in layer.iter_mut().enumerate() {
                *e = flags.brick_is_empty(volume, [n % bricks[0], n / bricks[0], bz]);
            }
        });
        flags.empty = empty;
        flags
    }

    /// Whether the neighbourhood of voxel (`i`, `j`, `k`) lies wholly in one class.
    #[inline]
    pub fn homogeneous(&self, i: usize, j: usize, k: usize) -> bool {
        self.bits[(k * self.dims[1] + j) * self.words + i / 64] >> (i % 64) & 1 != 0
    }

    /// Greatest voxel value that is empty, HU.
    #[inline]
    pub fn empty_up_to(&self) -> i16 {
        self.lo
    }

    /// Whether nothing is to be seen in brick (`i`, `j`, `k`); brick `b` of an axis holds cells `8b − 1` to `8b + 6`.
    #[inline]
    pub fn empty_brick(&self, i: usize, j: usize, k: usize) -> bool {
        self.empty[i + self.bricks[0] * (j + self.bricks[1] * k)]
    }

    /// Memory of all flags.
    pub fn bytes(&self) -> usize {
        size_of_val(self.bits.as_slice()) + size_of_val(self.empty.as_slice())
    }

    fn brick_is_empty(&self, volume: &Volume, brick: [usize; 3]) -> bool {
        let range = |axis: usize| {
            let first = brick[axis] << BRICK_SHIFT;
            first.saturating_sub(1)..(first + (1 << BRICK_SHIFT)).min(self.dims[axis])
        };
        let (x, y, z) = (range(0), range(1), range(2));
        for k in z.clone() {
            for j in y.clone() {
                if !x.clone().all(|i| self.homogeneous(i, j, k)) {
                    return false;
                }
            }
        }
        // Flagged neighbours share voxels, so the whole brick is of one class, and one voxel tells which.
        volume.data()[volume.grid().index(x.start, y.start, z.start)] <= self.lo
    }
}

/// The masks of one slice, one for each class, after the and over each voxel's 3×3 neighbours in the slice.
struct Slice {
    empty: Vec<u64>,
    opaque: Vec<u64>,
}

/// Flags the slices from `first` on that `out` has room for.
fn flag_slab(volume: &Volume, classes: Classes, first: usize, words: usize, out: &mut [u64]) {
    let [_, ny, nz] = volume.grid().dims();
    let plane = words * ny;
    let mut ring = [(); 3].map(|()| Slice { empty: vec![0; plane], opaque: vec![0; plane] });
    let mut rows = [vec![0u64; plane], vec![0u64; plane]];
    let mut load = |z: usize, slice: &mut Slice| {
        // `z` counts from one below the first slice, so that the air below is 0.
        if (1..=nz).contains(&z) {
            slice_masks(volume, classes, z - 1, words, &mut rows, slice);
        } else {
            slice.empty.fill(if AIR_HU <= classes.lo { u64::MAX } else { 0 });
            slice.opaque.fill(if AIR_HU >= classes.hi { u64::MAX } else { 0 });
        }
    };
    load(first, &mut ring[0]);
    load(first + 1, &mut ring[1]);
    for (n, out) in out.chunks_mut(plane).enumerate() {
        load(first + n + 2, &mut ring[(n + 2) % 3]);
        let [a, b, c] = &ring;
        for (w, out) in out.iter_mut().enumerate() {
            *out = (a.empty[w] & b.empty[w] & c.empty[w]) | (a.opaque[w] & b.opaque[w] & c.opaque[w]);
        }
    }
}

/// Class masks of slice `k`, and-ed over x and then over y.
fn slice_masks(volume: &Volume, c: Classes, k: usize, words: usize, rows: &mut [Vec<u64>; 2], out: &mut Slice) {
    let [nx, ny, _] = volume.grid().dims();
    let data = &volume.data()[nx * ny * k..nx * ny * (k + 1)];
    let [empty, opaque] = rows;
    let air = [AIR_HU <= c.lo, AIR_HU >= c.hi];
    let per_row = data.chunks_exact(nx).zip(empty.chunks_exact_mut(words)).zip(opaque.chunks_exact_mut(words));
    for ((row, empty), opaque) in per_row {
        for ((values, e), o) in row.chunks(64).zip(empty.iter_mut()).zip(opaque.iter_mut()) {
            *e = mask(values, |v| v <= c.lo);
            *o = mask(values, |v| v >= c.hi);
        }
        and_along_row(empty, nx, air[0]);
        and_along_row(opaque, nx, air[1]);
    }
    for (rows, out, air) in [(&*empty, &mut out.empty, air[0]), (&*opaque, &mut out.opaque, air[1])] {
        let outside = if air { u64::MAX } else { 0 };
        for j in 0..ny {
            for w in 0..words {
                let below = if j > 0 { rows[(j - 1) * words + w] } else { outside };
                let above = if j + 1 < ny { rows[(j + 1) * words + w] } else { outside };
                out[j * words + w] = below & rows[j * words + w] & above;
            }
        }
    }
}

/// A bit for each of up to 64 values.
#[inline(always)]
fn mask(values: &[i16], test: impl Fn(i16) -> bool) -> u64 {
    let mut word = 0;
    let (eights, rest) = values.as_chunks::<8>();
    for (n, eight) in eights.iter().enumerate() {
        // Eight bytes of 0 or 1; the product gathers their lowest bits in its top byte.
        let bytes = u64::from_le_bytes(eight.map(|v| u8::from(test(v))));
        word |= (bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * n);
    }
    for (n, &v) in rest.iter().enumerate() {
        word |= u64::from(test(v)) << (8 * eights.len() + n);
    }
    word
}

/// Each bit becomes the and of itself and its two neighbours in a row of `n` bits; `outside` is the class of air.
fn and_along_row(row: &mut [u64], n: usize, outside: bool) {
    let last = row.len() - 1;
    let tail = (n - 1) % 64 + 1;
    if outside && tail < 64 {
        row[last] |= u64::MAX << tail;
    }
    let mut left = u64::from(outside);
    for w in 0..=last {
        let here = row[w];
        let right = if w < last { row[w + 1] & 1 } else { u64::from(outside) };
        row[w] = here & (here << 1 | left) & (here >> 1 | right << 63);
        left = here >> 63;
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::math::hash;
    use crate::volume::Grid;

    fn volume(dims: [usize; 3], f: impl Fn(usize) -> i16) -> Volume {
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..grid.len()).map(f).collect();
        Volume::new(grid, data)
    }

    fn naive(v: &Volume, wall: Wall, i: usize, j: usize, k: usize) -> bool {
        let mut around = Vec::new();
        for z in -1..=1 {
            for y in -1..=1 {
                for x in -1..=1 {
                    around.push(f32::from(v.get(i as i64 + x, j as i64 + y, k as i64 + z)));
                }
            }
        }
        around.iter().all(|&h| h <= wall.lo()) || around.iter().all(|&h| h >= wall.hi())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn flags_are_what_they_say(
            nx in 1usize..140, ny in 1usize..14, nz in 1usize..40, seed: u64, share in 0.0..0.03f64,
            wall in prop_oneof![Just((-800.0, -500.0)), Just((-2000.0, -1100.0)), Just((-1100.0, -500.0))],
        ) {
            let wall = Wall::new(wall.0, wall.1).unwrap();
            let inside = if hash::uniform(seed, u64::MAX) < 0.5 { -1000 } else { 40 };
            let v = volume([nx, ny, nz], |n| {
                if hash::uniform(seed, n as u64) < share { -650 } else { inside }
            });
            let flags = Flags::new(&v, wall);
            for k in 0..nz { for j in 0..ny { for i in 0..nx {
                prop_assert_eq!(flags.homogeneous(i, j, k), naive(&v, wall, i, j, k), "{} {} {}", i, j, k);
            }}}
            for b in 0..flags.empty.len() {
                let [bx, by, _] = flags.bricks;
                let b = [b % bx, b / bx % by, b / bx / by];
                if flags.empty_brick(b[0], b[1], b[2]) {
                    for k in -2..=8 { for j in -2..=8 { for i in -2..=8 {
                        let at = |a: usize, o: i64| (8 * b[a]) as i64 + o;
                        prop_assert!(f32::from(v.get(at(0, i), at(1, j), at(2, k))) <= wall.lo());
                    }}}
                }
            }
        }
    }

    #[test]
    fn memory_is_an_eighth_of_the_volume_at_most() {
        for nx in [64, 65, 100, 128, 512] {
            let v = volume([nx, 64, 64], |_| -1000);
            let flags = Flags::new(&v, Wall::default());
            assert!(flags.bytes() * 8 <= v.bytes(), "{nx}");
            assert!(flags.empty.iter().all(|&e| e));
        }
    }
}
