//! Where a finding is on the wall.

use glam::DVec3;

use crate::math::sphere::directions;
use crate::space::{PreparedVolume, first_crossing};
use crate::volume::Volume;
use crate::volume::cell::Cell;

/// A place farther than this from the wall is in mid-air or in tissue, mm.
const SNAP_MM: f64 = 10.0;
/// Directions in which the wall is sought.
const DIRECTIONS: usize = 400;
/// Step through tissue, mm.
const STEP_MM: f64 = 0.25;
/// The normal is that of the gas within this distance of a place, mm.
const NORMAL_MM: [f64; 2] = [1.5, 3.0];

/// Returns the place of the wall nearest to a place (world, mm) in gas or in tissue, and the direction into the gas there, of unit length;
/// `None` if there is no wall within 10 mm.
pub fn wall_near(volume: &PreparedVolume, at: DVec3) -> Option<(DVec3, DVec3)> {
    let iso = volume.transfer().iso();
    let is_gas = |p: DVec3| value(volume.voxels(), p).is_some_and(|hu| hu <= iso);
    value(volume.voxels(), at)?;
    let nearest = |way: &dyn Fn(DVec3) -> Option<f64>| {
        let found = directions(DIRECTIONS).filter_map(|d| Some((way(d)?, d)));
        found.reduce(|a, b| if b.0 < a.0 { b } else { a })
    };
    let (mm, direction) = match is_gas(at) {
        true => nearest(&|d| first_crossing(volume, at, d, SNAP_MM)),
        false => nearest(&|d| {
            let steps = (1..).map(|n| f64::from(n) * STEP_MM).take_while(|mm| *mm <= SNAP_MM);
            // The last place in tissue, so that it counts as on the wall.
            steps
                .take_while(|mm| value(volume.voxels(), at + d * *mm).is_some())
                .find(|mm| is_gas(at + d * *mm))
                .map(|mm| mm - STEP_MM)
        }),
    }?;
    let place = at + direction * mm;
    Some((place, normal_at(volume, place).unwrap_or(if is_gas(at) { -direction } else { direction })))
}

/// Returns the direction towards the gas around a place (world, mm), of unit length; `None` if there is none, or gas on all sides.
pub fn normal_at(volume: &PreparedVolume, place: DVec3) -> Option<DVec3> {
    let iso = volume.transfer().iso();
    let is_gas = |p: DVec3| value(volume.voxels(), p).is_some_and(|hu| hu <= iso);
    let ways = || NORMAL_MM.into_iter().flat_map(|mm| directions(DIRECTIONS).map(move |d| (d, mm)));
    let sum: DVec3 = ways().filter(|(d, mm)| is_gas(place + *d * *mm)).map(|w| w.0).sum();
    (sum.length() > 0.05 * ways().count() as f64).then(|| sum.normalize())
}

/// Returns the value at a place (world, mm), HU, trilinear; `None` outside the scan.
fn value(volume: &Volume, at: DVec3) -> Option<f64> {
    let grid = volume.grid();
    if !at.is_finite() || !grid.contains(at) {
        return None;
    }
    // A voxel reaches half its size beyond its centre; outside of the scan is no gas.
    let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
    let voxel = grid.voxel(at).clamp(DVec3::ZERO, last);
    let base = voxel.floor();
    Some(Cell::load(volume, base.to_array().map(|x| x as i64)).at(voxel - base))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use crate::space::TransferFunction;
    use crate::volume::Grid;

    /// A ball of gas of radius 20 mm around 30, 30, 30.
    fn ball() -> PreparedVolume {
        let grid = Grid::new([60; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let hu = |n: usize| {
            let p = DVec3::new((n % 60) as f64, (n / 60 % 60) as f64, (n / 3600) as f64);
            let inside = 20.0 - p.distance(DVec3::splat(30.0));
            (-480.0 - 520.0 * inside.clamp(-1.0, 1.0)) as i16
        };
        PreparedVolume::new(
            Arc::new(Volume::new(grid.clone(), (0..grid.len()).map(hu).collect())),
            TransferFunction::default(),
        )
    }

    #[test]
    fn the_nearest_wall_is_found_from_gas_and_from_tissue() {
        let (volume, middle) = (ball(), DVec3::splat(30.0));
        for direction in [DVec3::X, DVec3::NEG_Z, DVec3::new(1.0, -2.0, 2.0) / 3.0] {
            for mm in [12.0, 18.0, 19.9, 20.5, 24.0] {
                let (place, normal) = wall_near(&volume, middle + direction * mm).unwrap();
                assert!((place.distance(middle) - 20.0).abs() < 0.6, "{direction} {mm}: {}", place.distance(middle));
                assert!(place.distance(middle + direction * 20.0) < 2.0, "{direction} {mm}: {place}");
                assert!(normal.dot(-direction) > 0.97, "{direction} {mm}: {normal}");
            }
        }
        for nowhere in [middle, DVec3::splat(2.0), DVec3::splat(-50.0), DVec3::splat(f64::NAN)] {
            assert_eq!(wall_near(&volume, nowhere), None, "{nowhere}");
        }
    }
}
