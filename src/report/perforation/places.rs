//! Test volumes for perforation: small, with walls of every kind.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};
use crate::phantom::{Phantom, PhantomSettings, Size};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// A volume with a name.
pub(crate) struct Place {
    /// Name in the report.
    pub name: String,
    /// The volume.
    pub volume: Arc<Volume>,
}

/// Values of gas and tissue in the synthetic volumes, HU.
const GAS: i16 = -1000;
const TISSUE: i16 = 40;

/// Creates all places: parts of phantoms of several seeds and spacings, tubes, the narrowest lumen, lumens that touch, noise.
pub(crate) fn all(seed: u64, progress: &Progress) -> Result<Vec<Place>> {
    let mut places = Vec::new();
    let spacings = [DVec3::splat(0.9), DVec3::new(0.7, 0.7, 1.0), DVec3::new(0.3, 0.3, 10.0)];
    for (n, spacing) in spacings.into_iter().cycle().take(6).enumerate() {
        let settings = PhantomSettings {
            size: Size::Small,
            seed: seed.wrapping_add(n as u64),
            fluid: n % 2 == 0,
            bridges: true,
            ..PhantomSettings::default()
        };
        let phantom = Phantom::new(&settings);
        let truth = phantom.truth();
        let middle = truth.centerline[truth.centerline.len() * (n + 1) / 7];
        let turned = if n < 3 { DMat3::IDENTITY } else { DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-0.2) };
        let grid = cube(50.0, spacing, middle, turned)?;
        let name = format!("phantom {}, {}×{}×{} mm", settings.seed, spacing.x, spacing.y, spacing.z);
        places.push(Place { name, volume: Arc::new(phantom.voxelise(&grid, progress)?) });
        progress.check()?;
    }
    let tube = |p: DVec3, radius: f64| (p - DVec3::new(6.0 * (p.z / 8.0).sin(), 0.0, p.z)).length() < radius;
    let mut add = |name: &str, size: f64, spacing: DVec3, gas: &dyn Fn(DVec3) -> bool| -> Result<()> {
        let grid = cube(size, spacing, DVec3::ZERO, DMat3::IDENTITY)?;
        let data = voxels(&grid).map(|p| if gas(p) { GAS } else { TISSUE }).collect();
        places.push(Place { name: name.to_owned(), volume: Arc::new(Volume::new(grid, data)) });
        Ok(())
    };
    add("tube of 8 mm", 40.0, DVec3::ONE, &|p| tube(p, 8.0))?;
    add("tube of 9 mm, 0.3×0.3×10 mm", 40.0, DVec3::new(0.3, 0.3, 10.0), &|p| tube(p, 9.0))?;
    add("tube as wide as the camera", 30.0, DVec3::splat(0.8), &|p| tube(p, 2.2))?;
    add("lumen one voxel wide", 16.0, DVec3::ONE, &|p| p.x.abs() < 0.5 && p.y.abs() < 0.5)?;
    add("lumen one voxel wide, 4 mm voxels", 40.0, DVec3::splat(4.0), &|p| p.x.abs() < 2.0 && p.y.abs() < 2.0)?;
    // The wall between them is one voxel thick, and absent where they touch.
    let two = |gap: f64| move |p: DVec3| (p.x.abs() - 4.0 - gap + (p.z / 9.0).cos() * 0.5).hypot(p.y) < 4.0;
    add("two lumens that touch", 30.0, DVec3::splat(0.7), &two(0.3))?;
    add("two lumens, a voxel between", 30.0, DVec3::splat(0.5), &|p| {
        p.x.abs() > 0.26 && (p.x.abs() - 5.0).hypot(p.y) < 5.0
    })?;
    let grid = cube(20.0, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY)?;
    let noise = |n: u64| (crate::math::hash::normal(seed, n) * 300.0 - 900.0) as i16;
    let data = (0..grid.len() as u64).map(noise).collect();
    places.push(Place { name: "noise".to_owned(), volume: Arc::new(Volume::new(grid, data)) });
    Ok(places)
}

/// Creates a grid over a cube of `size` mm.
fn cube(size: f64, spacing: DVec3, middle: DVec3, direction: DMat3) -> Result<Grid> {
    let dims = spacing.to_array().map(|s| (size / s).ceil() as usize | 1);
    let half = DVec3::from_array(dims.map(|n| (n - 1) as f64 / 2.0)) * spacing;
    let grid = Grid::new(dims, spacing, middle - direction * half, direction);
    grid.map_err(|e| Error::fault("grid", e.why, "report it"))
}

/// Returns the world positions of a grid's voxels, in order.
fn voxels(grid: &Grid) -> impl Iterator<Item = DVec3> + '_ {
    let [nx, ny, _] = grid.dims();
    (0..grid.len()).map(move |n| grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64)))
}
