use std::sync::Arc;

use glam::{DMat3, DVec3};
use proptest::prelude::*;

use super::chessboard::{FAR, Outside, chessboard};
use super::*;
use crate::math::hash;
use crate::render::begin::FromScratch;
use crate::render::caster::ImageRequest;
use crate::render::classify::{ByDensity, ByValue};
use crate::render::sampler::Trilinear;
use crate::render::skip::Everything;
use crate::render::{Frame, Settings, View};
use crate::space::TransferFunction;
use crate::volume::{Grid, Volume};

fn specks(dims: [usize; 3], spacing: DVec3, wall: TransferFunction, seed: u64, share: f64) -> PreparedVolume {
    let grid = Grid::new(dims, spacing, DVec3::new(-3.0, 5.0, 7.0), DMat3::from_rotation_x(0.4)).unwrap();
    let value = |n: u64| match hash::uniform(seed, n) < share {
        true => -1000 + (1000.0 * hash::uniform(!seed, n)) as i16,
        false => -1000,
    };
    let data = (0..grid.len() as u64).map(value).collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), wall)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn chessboard_distances_are_exact(
        dims in prop::array::uniform3(1usize..12), seed: u64, share in 0.0..0.1f64, edge: bool,
    ) {
        let count: usize = dims.iter().product();
        let marked = |n: usize| hash::uniform(seed, n as u64) < share;
        let mut cells: Vec<u8> = (0..count).map(|n| if marked(n) { 0 } else { FAR }).collect();
        let outside = if edge { Outside::Marked } else { Outside::Unmarked };
        chessboard(&mut cells, dims, outside);
        let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
        for (n, &cell) in cells.iter().enumerate() {
            let p = at(n);
            let to_marked = (0..count).filter(|&m| marked(m)).map(|m| {
                let o = at(m);
                (0..3).map(|a| p[a].abs_diff(o[a])).max().unwrap()
            });
            let outside = (0..3).map(|a| (p[a] + 1).min(dims[a] - p[a])).min().filter(|_| edge);
            let want = to_marked.chain(outside).min().map_or(FAR, |d| d.min(255) as u8);
            prop_assert_eq!(cell, want, "{:?}", p);
        }
    }

    #[test]
    fn leaping_by_distance_changes_no_bit(
        dims in prop::array::uniform3(1usize..50), seed: u64, share in prop_oneof![Just(0.0), 0.0..0.002f64, 0.0..0.1f64],
        spacing in prop_oneof![Just(DVec3::new(0.7, 0.6, 1.1)), Just(DVec3::new(0.3, 0.3, 10.0))],
        from in prop::array::uniform3(-0.3..1.3f64), to in prop::array::uniform3(0.0..1.0f64), fov in 20.0..150.0f64,
        wall in prop_oneof![Just((-800.0, -500.0)), Just((-1100.0, -500.0)), Just((-999.5, 40.0))],
    ) {
        let s = specks(dims, spacing, TransferFunction::new(wall.0, wall.1).unwrap(), seed, share);
        let grid = s.voxels().grid();
        let at = |q: [f64; 3]| grid.world(DVec3::from_array(std::array::from_fn(|a| q[a] * dims[a] as f64)));
        let view = View::new(at(from), at(to) - at(from), DVec3::Z, fov, 24, 16).unwrap();
        let settings = Settings::default();
        let (bricks, voxels) = (BrickWalls::new(&s), VoxelWalls::new(&s));
        let (request, high) = (ImageRequest { volume: &s, view: &view, settings: &settings }, Trilinear::new(&s));
        let mut kept = vec![(); 24 * 16];
        let mut frames = vec![Frame::new(24, 16); 7];
        let [a, b, c, d, e, f, g] = &mut frames[..] else { unreachable!() };
        request.image(&high, &Everything, &ByValue, &FromScratch, &mut kept, a);
        request.image(&high, &BrickLeap::<true>::new(&s, &bricks), &ByValue, &FromScratch, &mut kept, b);
        request.image(&high, &BrickLeap::<false>::new(&s, &bricks), &ByValue, &FromScratch, &mut kept, c);
        request.image(&high, &VoxelLeap::<1>::new(&voxels), &ByValue, &FromScratch, &mut kept, d);
        request.image(&high, &Everything, &ByDensity, &FromScratch, &mut kept, e);
        request.image(&high, &BrickLeap::<false>::new(&s, &bricks), &ByDensity, &FromScratch, &mut kept, f);
        request.image(&high, &VoxelLeap::<2>::new(&voxels), &ByDensity, &FromScratch, &mut kept, g);
        prop_assert!(a == b && a == c && a == d);
        prop_assert!(e == f && e == g);
    }

    #[test]
    fn clearances_are_true(
        dims in prop::array::uniform3(1usize..40), seed: u64, share in prop_oneof![Just(0.0), 0.0..0.002f64],
        wall in prop_oneof![Just((-800.0, -500.0)), Just((-1100.0, -500.0))],
    ) {
        let s = specks(dims, DVec3::ONE, TransferFunction::new(wall.0, wall.1).unwrap(), seed, share);
        let (bricks, voxels) = (BrickWalls::new(&s), VoxelWalls::new(&s));
        let both = Surroundings { volume: &s, bricks: &bricks };
        for n in 0..60 {
            let q = Vec3::from_array(std::array::from_fn(|a| (dims[a] + 1) as f32 * hash::uniform(seed, 3 * n + a as u64) as f32));
            for free in [both.around(q), voxels.around(q)] {
                let free = free.min(24.0);
                let range = |a: usize| (q[a] - free).ceil() as i64..=(q[a] + free).floor() as i64;
                for k in range(2) { for j in range(1) { for i in range(0) {
                    let near = (Vec3::new(i as f32, j as f32, k as f32) - q).abs().max_element() < free - 1e-4;
                    prop_assert!(!near || s.voxels().get(i - 1, j - 1, k - 1) <= s.flags().empty_up_to());
                }}}
            }
        }
    }
}

#[test]
fn memory_is_as_told() {
    let s = specks([64, 48, 40], DVec3::ONE, TransferFunction::default(), 1, 0.0);
    assert_eq!(VoxelWalls::new(&s).bytes() * 2, s.voxels().bytes());
    assert_eq!(BrickWalls::new(&s).bytes(), 9 * 7 * 6);
}
