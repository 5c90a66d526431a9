use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::{Mesh, Rasteriser};
use crate::math::hash;
use crate::render::{Frame, Renderer, Settings, View, psnr, render};
use crate::space::{PreparedVolume, TransferFunction};
use crate::volume::{Grid, Volume};

/// A tube of gas along z with a bulge, in tissue with an edge three voxels wide.
fn tube(n: usize) -> PreparedVolume {
    let grid = Grid::new([n; 3], DVec3::splat(0.8), DVec3::new(100.0, -50.0, 20.0), DMat3::IDENTITY).unwrap();
    let c = 0.5 * (n as f64 - 1.0);
    let data = (0..grid.len())
        .map(|i| {
            let d = DVec3::new((i % n) as f64 - c, (i / n % n) as f64 - c, (i / n / n) as f64 - c);
            let r = d.truncate().length() - 9.0 - 2.0 * (0.4 * d.z).sin();
            (-650.0 + 200.0 * r).clamp(-1000.0, 60.0) as i16
        })
        .collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

fn view(volume: &PreparedVolume, voxel: DVec3, forward: DVec3, fov: f64, size: [usize; 2]) -> View {
    View::new(volume.voxels().grid().world(voxel), forward, DVec3::Y, fov, size[0], size[1]).unwrap()
}

#[test]
fn the_picture_is_near_that_of_the_rays() {
    let volume = tube(48);
    let mut raster = Rasteriser::new(&volume).unwrap();
    for (voxel, forward) in [
        (DVec3::splat(23.5), DVec3::Z),
        (DVec3::new(23.0, 28.0, 10.0), DVec3::new(0.2, -0.1, 1.0)),
        (DVec3::new(20.0, 24.0, 40.0), DVec3::new(1.0, 0.3, -0.2)),
    ] {
        let v = view(&volume, voxel, forward, 90.0, [150, 130]);
        let (mut rays, mut mesh) = (Frame::with_depth(1, 1), Frame::with_depth(1, 1));
        render(&volume, &v, &Settings::default(), &mut rays);
        let work = raster.render(&v, &mut mesh);
        assert_eq!(work.rays, 150 * 130);
        let db = psnr(&rays, &mesh);
        // Rays see the ramp's soft edge at silhouettes, where a mesh is hard. Nothing else differs much.
        assert!(db > 24.0, "{db} dB");
        let pairs = rays.pixels().as_flattened().iter().zip(mesh.pixels().as_flattened());
        let mut apart: Vec<u8> = pairs.map(|(a, b)| a.abs_diff(*b)).collect();
        apart.sort_unstable();
        assert!(apart[apart.len() / 2] <= 3, "{} levels in the median", apart[apart.len() / 2]);
        let (a, b) = (rays.depth().unwrap(), mesh.depth().unwrap());
        let off = a.iter().zip(b).filter(|(a, b)| (**a - **b).abs() > 0.2).count();
        assert!(off * 100 < a.len(), "{off} of {} depths are off by more than a quarter voxel", a.len());
        let holes = a.iter().zip(b).filter(|(a, b)| a.is_finite() && b.is_infinite()).count();
        assert_eq!(holes, 0, "a closed mesh has no hole");
    }
}

#[test]
fn no_hole_from_anywhere_in_the_gas() {
    // The border closes it, so every ray ends.
    let grid = Grid::new([12; 3], DVec3::new(0.5, 0.7, 1.5), DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let border = |i: usize| [i % 12, i / 12 % 12, i / 144].iter().any(|c| !(2..=9).contains(c));
    let data = (0..grid.len())
        .map(|i| {
            if border(i) || hash::uniform(5, i as u64) < 0.12 {
                40
            } else {
                -1000 + (hash::bits(6, i as u64) % 300) as i16
            }
        })
        .collect();
    let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
    let mut raster = Rasteriser::new(&volume).unwrap();
    let mut frame = Frame::with_depth(1, 1);
    for n in 0..60 {
        let u = |k| hash::uniform(n, k);
        let voxel = DVec3::new(3.0 + 5.0 * u(0), 3.0 + 5.0 * u(1), 3.0 + 5.0 * u(2));
        let forward = DVec3::new(u(3) - 0.5, u(4) - 0.5, u(5) - 0.5);
        let v = view(&volume, voxel, forward, [1.0, 60.0, 90.0, 150.0, 170.0][n as usize % 5], [70, 45]);
        raster.render(&v, &mut frame);
        // A mesh cannot be drawn nearer than the near plane. The trilinear wall and its triangles differ within a cell.
        let holes = frame.depth().unwrap().iter().filter(|d| d.is_infinite()).count();
        assert_eq!(holes, 0, "pose {n}");
    }
}

#[test]
fn in_the_tissue_and_outside() {
    let volume = tube(32);
    let mut raster = Rasteriser::new(&volume).unwrap();
    let mut frame = Frame::with_depth(1, 1);
    raster.render(&view(&volume, DVec3::new(2.0, 3.0, 15.0), DVec3::X, 90.0, [20, 20]), &mut frame);
    assert!(frame.depth().unwrap().iter().all(|&d| d == 0.0));
    raster.render(&view(&volume, DVec3::new(-60.0, 15.5, 15.5), DVec3::X, 60.0, [64, 64]), &mut frame);
    let seen = frame.depth().unwrap().iter().filter(|d| d.is_finite()).count();
    assert!(seen > 500 && seen < 4000, "{seen} pixels see the block of tissue");
    raster.render(&view(&volume, DVec3::new(-60.0, 15.5, 15.5), DVec3::NEG_X, 60.0, [64, 64]), &mut frame);
    assert!(frame.depth().unwrap().iter().all(|d| d.is_infinite()) && frame.pixels().iter().all(|p| *p == [0; 3]));
}

#[test]
fn empty_volumes_and_odd_sizes() {
    let grid = Grid::new([2; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let empty = PreparedVolume::new(Arc::new(Volume::new(grid, vec![-1000; 8])), TransferFunction::default());
    let mut raster = Rasteriser::new(&empty).unwrap();
    let mut frame = Frame::new(1, 1);
    for size in [[1, 1], [33, 1], [1, 65], [31, 32]] {
        let work = raster.render(&view(&empty, DVec3::splat(0.5), DVec3::Z, 90.0, size), &mut frame);
        assert_eq!(work.rays, (size[0] * size[1]) as u64);
        assert!(frame.pixels().iter().all(|p| *p == [0; 3]));
    }
}

#[test]
fn any_number_of_threads_draws_the_same() {
    let volume = tube(40);
    let mesh = Arc::new(Mesh::new(&volume).unwrap());
    let v = view(&volume, DVec3::splat(19.5), DVec3::new(0.3, 0.2, 1.0), 100.0, [200, 90]);
    let draw = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut frame = Frame::with_depth(1, 1);
        let work = pool.install(|| Rasteriser::of(&volume, Arc::clone(&mesh)).render(&v, &mut frame));
        (frame, work)
    };
    assert_eq!(draw(1), draw(2));
    assert_eq!(draw(1), draw(5));
}
