//! The gradient regression at sixteen places at once.
//!
//! Where voxels are fine, each ray of a bundle meets the wall in a different cell, and the next picture's rays meet it in others. A
//! cell's eight regressions, computed to be cached ([`cells`](super::cells)), would serve a single ray. Here the regression is
//! computed at the rays' exact positions, like [`Regression::fit`] does for one position, with a lane for each ray.

use fearless_simd::{Simd, f32x16, prelude::*};

use super::lanes::Blocks;
use crate::render::regression::{Regression, parts};

/// Returns the gradients along the index axes (HU/mm) at the positions `t` in the blocks' inner cells.
#[inline(always)]
pub(crate) fn gradients<S: Simd>(
    simd: S,
    regression: &Regression,
    blocks: &Blocks<S>,
    t: [f32x16<S>; 3],
) -> [f32x16<S>; 3] {
    let Regression { a, b, c: of_c, .. } = regression;
    let zero = f32x16::splat(simd, 0.0);
    let [tx, ty, tz] = t;
    let sx = f32x16::splat(simd, 1.0) - tx;
    // For each voxel along x: its column's parts along z, for each y.
    let mut along_z = [[[zero; 3]; 4]; 4];
    for y in 0..4 {
        let mut rows = [[zero; 4]; 4];
        for (z, row) in rows.iter_mut().enumerate() {
            *row = blocks.row(simd, [y, z]);
        }
        let [p, q, r, s] = rows;
        for (x, columns) in along_z.iter_mut().enumerate() {
            columns[y] = parts([p[x], q[x], r[x], s[x]], tz);
        }
    }
    let mut g = [zero; 3];
    for (x, z) in along_z.into_iter().enumerate() {
        // Named by the part along z, then along y. Not with closures: they do not inherit the level's instructions.
        let [cc, ce, co] = parts([z[0][0], z[1][0], z[2][0], z[3][0]], ty);
        let [ec, ee, eo] = parts([z[0][1], z[1][1], z[2][1], z[3][1]], ty);
        let [oc, oe, _] = parts([z[0][2], z[1][2], z[2][2], z[3][2]], ty);
        // This voxel's coefficients in c, e and o along x.
        let (c, e, o) = match x {
            0 => (zero, sx, zero - sx),
            1 => (sx, tx, zero - tx),
            2 => (tx, sx, sx),
            _ => (zero, tx, tx),
        };
        g[0] += o * (cc * a[0][0] + ce * a[0][1] + ec * a[1][0] + ee * a[1][1]);
        g[1] += c * (co * b[0][0] + eo * b[0][1]) + e * (co * b[1][0] + eo * b[1][1]);
        g[2] += c * (oc * of_c[0][0] + oe * of_c[0][1]) + e * (oc * of_c[1][0] + oe * of_c[1][1]);
    }
    g
}

#[cfg(test)]
mod tests {
    use fearless_simd::{i32x16, mask32x16};
    use glam::{DMat3, DVec3, Vec3};

    use super::*;
    use crate::math::hash;
    use crate::render::packets::lanes::Voxels;
    use crate::render::packets::levels;
    use crate::render::regression::{Weighting, block};
    use crate::volume::{Grid, Volume};

    /// Sixteen random cells and positions, with seeds from `n` on.
    fn lanes(dims: [usize; 3], n: u64) -> [([i32; 3], Vec3); 16] {
        std::array::from_fn(|lane| {
            let random = |a: u64| hash::uniform(n + lane as u64, a);
            // Cell 2 is the first whose block is within the volume, n − 2 the last.
            let cell = [0, 1, 2].map(|a| 2 + (random(a as u64) * (dims[a] - 3) as f64) as i32);
            (cell, Vec3::from_array([3, 4, 5].map(|a| random(a) as f32)))
        })
    }

    fn at<S: Simd>(simd: S, lanes: &[([i32; 3], Vec3); 16]) -> ([i32x16<S>; 3], [f32x16<S>; 3]) {
        let cell = |a: usize| i32x16::load_array_ref(simd, &lanes.map(|l| l.0[a]));
        let place = |a: usize| f32x16::load_array_ref(simd, &lanes.map(|l| l.1[a]));
        ([cell(0), cell(1), cell(2)], [place(0), place(1), place(2)])
    }

    fn all<S: Simd>(simd: S) -> mask32x16<S> {
        f32x16::splat(simd, 0.0).simd_lt(1.0)
    }

    #[test]
    fn they_are_the_regressions_of_each_place_on_every_level() {
        let spacing = DVec3::new(0.7, 0.9, 1.3);
        for dims in [[4, 4, 4], [9, 5, 7], [20, 30, 4]] {
            let grid = Grid::new(dims, spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let data = (0..grid.len() as u64).map(|n| (65535.0 * hash::uniform(7, n) - 32768.0) as i16).collect();
            let volume = Volume::new(grid, data);
            let voxels = Voxels::new(&volume).unwrap();
            let regression = Regression::new(spacing, Weighting::InverseSquare);
            for n in 0..20 {
                let lanes = lanes(dims, 100 * n);
                let found: Vec<[[f32; 16]; 3]> = levels()
                    .into_iter()
                    .map(|(_, level)| {
                        fearless_simd::dispatch!(level, simd => {
                            let (cell, place) = at(simd, &lanes);
                            let blocks = voxels.blocks(simd, cell, all(simd)).unwrap();
                            gradients(simd, &regression, &blocks, place).map(|g| g.to_array())
                        })
                    })
                    .collect();
                assert!(found.iter().all(|f| f == &found[0]), "levels differ");
                for (lane, (cell, t)) in lanes.into_iter().enumerate() {
                    let exact = regression.fit(&block(&volume, cell.map(|c| c - 2)), t).gradient;
                    let got = Vec3::from_array(found[0].map(|g| g[lane]));
                    assert!((got - exact).length() < 0.1, "{cell:?} {t}: {got} {exact}");
                }
            }
        }
    }

    #[test]
    fn a_block_that_leaves_the_volume_is_none() {
        let dims = [6, 5, 4];
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let volume = Volume::new(grid, vec![0; 120]);
        let voxels = Voxels::new(&volume).unwrap();
        for (a, last) in [(0, 4), (1, 3), (2, 2)] {
            for (c, within) in
                [(-5, false), (0, false), (1, false), (2, true), (last, true), (last + 1, false), (99, false)]
            {
                let mut lanes = [([2, 2, 2], Vec3::ZERO); 16];
                lanes[7].0[a] = c;
                fearless_simd::dispatch!(levels()[0].1, simd => {
                    let (cell, place) = at(simd, &lanes);
                    assert_eq!(voxels.blocks(simd, cell, all(simd)).is_some(), within, "axis {a}, cell {c}");
                    // A lane that is not wanted does no harm.
                    let others = !cell[a].simd_eq(c) | cell[a].simd_eq(2);
                    let blocks = voxels.blocks(simd, cell, others).unwrap();
                    let r = Regression::new(DVec3::ONE, Weighting::InverseSquare);
                    let g = gradients(simd, &r, &blocks, place);
                    assert!(g.iter().all(|g| g.to_array() == [0.0; 16]));
                });
            }
        }
        let thin = Volume::new(Grid::new([3, 9, 9], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap(), vec![0; 243]);
        fearless_simd::dispatch!(levels()[0].1, simd => {
            let (cell, _) = at(simd, &[([2, 2, 2], Vec3::ZERO); 16]);
            assert!(Voxels::new(&thin).unwrap().blocks(simd, cell, all(simd)).is_none());
        });
    }
}
