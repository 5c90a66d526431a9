//! The colon's wall around its lumen, as voxels, and its thickness.
//!
//! A ray leads from the nearest point of the lumen's surface through each voxel and on outwards. The wall is soft
//! tissue. It ends where the values along the ray fall below the edge of fat (fat, or gas beyond), or rise to tagged
//! fluid or bone. A wall so thin that its blurred values never reach soft tissue ends at their maximum. If soft tissue
//! continues too far to be the wall alone (an adjacent organ), the thickness cannot be measured and is taken as
//! `DEFAULT_MM`. Tissue between two pieces of lumen is the wall of both: half of it counts as the thickness of each.

use glam::DVec3;
use rayon::prelude::*;

use super::distance::WallDistance;
use super::lumen::Lumen;
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;
use crate::volume::cell::Cell;

/// Thickness where it cannot be measured, mm.
pub(crate) const DEFAULT_MM: f64 = 3.0;
/// Soft tissue farther than this from the lumen is not the wall alone, mm.
const REACH_MM: f64 = 6.0;
/// Soft tissue is brighter than this, HU: half-way from fat to muscle …
const SOFT_HU: f64 = -30.0;
/// … and darker than this: bone and tagged fluid are above.
const BRIGHT_HU: f64 = 180.0;
/// Maximum width of the blurred edge between lumen and wall, mm.
const EDGE_MM: f64 = 2.5;
/// The maximum of a thin wall is passed when the values have fallen by this much, HU: more than noise.
const FALL_HU: f64 = 60.0;

/// The colon's wall.
#[derive(Clone, Debug)]
#[doc(hidden)]
pub struct Wall {
    /// Voxels of the wall, as linear indices (x fastest), ascending.
    pub voxels: Vec<usize>,
    /// Volume, ml.
    pub ml: f64,
    /// Thickness at the innermost voxels where it can be measured; `None` if it cannot be measured anywhere.
    pub thickness: Option<Thickness>,
    /// Fraction of the innermost voxels where the thickness can be measured.
    pub reported: f64,
}

/// Thickness of the wall.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[doc(hidden)]
pub struct Thickness {
    /// Mean, mm.
    pub mean_mm: f64,
    /// Median, mm.
    pub median_mm: f64,
}

/// The end of a ray's path through soft tissue.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ending {
    /// Distance from the lumen, mm.
    at_mm: f64,
    /// Thickness of the wall, mm.
    thick_mm: f64,
}

/// Finds the wall around gas and tagged fluid of a lumen found in `volume`. Voxels of the lumen do not belong to the
/// wall; every other voxel that shares a face with one does.
///
/// # Errors
/// Returns status 4 when interrupted, status 3 if there are more voxels than can be numbered.
#[doc(hidden)]
pub fn around(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Wall> {
    progress.stage("finding the wall", 0);
    let walls = WallDistance::around_lumen(volume, lumen, REACH_MM, progress)?;
    let [nx, ny, nz] = volume.grid().dims();
    let slices: Vec<(Vec<usize>, Vec<Option<f64>>)> = (0..nz)
        .into_par_iter()
        .map(|k| {
            progress.check()?;
            let (mut voxels, mut inner) = (Vec::new(), Vec::new());
            for j in 0..ny {
                let mut n = walls.set().row_start(j, k);
                super::voxels::each_run(walls.set().row(j, k), |run| {
                    for i in run {
                        let far = -f64::from(walls.value(n));
                        n += 1;
                        if far <= 0.0 || far > REACH_MM {
                            continue;
                        }
                        let voxel = [i as i64, j as i64, k as i64];
                        let ending = ending(volume, &walls, voxel, far);
                        let touches = touches(&walls, voxel);
                        if touches {
                            inner.push(ending.map(|e| e.thick_mm));
                        }
                        if touches || far <= ending.map_or(DEFAULT_MM, |e| e.at_mm) {
                            voxels.push(i + nx * (j + ny * k));
                        }
                    }
                });
            }
            Ok((voxels, inner))
        })
        .collect::<Result<_>>()?;
    let (voxels, inner): (Vec<Vec<usize>>, Vec<Vec<Option<f64>>>) = slices.into_iter().unzip();
    let (voxels, inner) = (voxels.concat(), inner.concat());
    let mut reported: Vec<f64> = inner.iter().flatten().copied().collect();
    reported.sort_unstable_by(f64::total_cmp);
    let thickness = (!reported.is_empty()).then(|| Thickness {
        mean_mm: reported.iter().sum::<f64>() / reported.len() as f64,
        median_mm: reported[reported.len() / 2],
    });
    Ok(Wall {
        ml: voxels.len() as f64 * volume.grid().voxel_ml(),
        voxels,
        thickness,
        reported: reported.len() as f64 / inner.len().max(1) as f64,
    })
}

/// True if a voxel shares a face with the lumen.
fn touches(walls: &WallDistance, voxel: [i64; 3]) -> bool {
    (0..6).any(|s| {
        let mut beside = voxel;
        beside[s / 2] += if s % 2 == 0 { 1 } else { -1 };
        walls.is_inside(beside)
    })
}

/// Returns where soft tissue ends from the lumen through a voxel that is `far` mm from it; `None` if that cannot be measured.
fn ending(volume: &Volume, walls: &WallDistance, voxel: [i64; 3], far: f64) -> Option<Ending> {
    let place = walls.world(voxel);
    let inwards = inwards(walls, voxel)?;
    let begin = place + far * inwards;
    let grid = volume.grid();
    let (from, along) = (grid.voxel(begin), grid.to_voxel().transform_vector3(-inwards));
    let hu = |mm: f64| {
        let p = from + mm * along;
        let base = p.floor();
        Cell::load(volume, base.to_array().map(|x| x as i64)).at(p - base)
    };
    let (at_mm, _) = through_tissue(hu, 0.5 * grid.min_spacing())?;
    let lumen_beyond = |mm: f64| walls.is_inside(walls.voxel(begin - (at_mm + mm) * inwards));
    let shared = [0.5, 1.0, 1.75, 2.5].into_iter().any(lumen_beyond);
    Some(Ending { at_mm, thick_mm: if shared { 0.5 * at_mm } else { at_mm } })
}

/// Returns the unit direction (world) from a voxel to the nearest lumen: along the gradient of the distance, by central
/// differences.
fn inwards(walls: &WallDistance, voxel: [i64; 3]) -> Option<DVec3> {
    let mut slope = [0.0; 3];
    for (a, s) in slope.iter_mut().enumerate() {
        let beside = |step: i64| {
            let mut v = voxel;
            v[a] += step;
            walls.at(v).map(f64::from)
        };
        *s = match (beside(-1), beside(1)) {
            (Some(low), Some(high)) => 0.5 * (high - low),
            // At the border of the scan.
            (None, Some(high)) => high - f64::from(walls.at(voxel)?),
            (Some(low), None) => f64::from(walls.at(voxel)?) - low,
            (None, None) => 0.0,
        };
    }
    (walls.grid().to_voxel().matrix3.transpose() * DVec3::from_array(slope)).try_normalize()
}

/// The change in value at which soft tissue ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// The values fall.
    Fall,
    /// The values rise.
    Rise,
}

/// Returns the distance (mm) at which soft tissue ends along a ray from the lumen, and how. `hu` gives the value at a
/// distance (mm).
fn through_tissue(hu: impl Fn(f64) -> f64, step_mm: f64) -> Option<(f64, End)> {
    let count = (REACH_MM / step_mm).ceil() as usize + 1;
    let (mut in_tissue, mut top) = (false, (f64::NEG_INFINITY, 0usize));
    // Three consecutive values average out noise; before the first one is the lumen.
    let mut last = [-step_mm, 0.0, step_mm].map(&hu);
    let mut before = last.iter().sum::<f64>() / 3.0;
    for n in 0..count {
        let mm = n as f64 * step_mm;
        if n > 0 {
            last = [last[1], last[2], hu(mm + step_mm)];
        }
        let now = last.iter().sum::<f64>() / 3.0;
        let crossing = |level: f64| mm - step_mm * ((now - level) / (now - before)).clamp(0.0, 1.0);
        if in_tissue {
            if now < SOFT_HU {
                return Some((crossing(SOFT_HU), End::Fall));
            }
            if now > BRIGHT_HU {
                return Some((crossing(BRIGHT_HU), End::Rise));
            }
        } else if (SOFT_HU..=BRIGHT_HU).contains(&now) {
            in_tissue = true;
        } else {
            if now < SOFT_HU && now > top.0 {
                top = (now, n);
            }
            if now < top.0 - FALL_HU && n > top.1 {
                return Some((top.1 as f64 * step_mm, End::Fall));
            }
            if mm > EDGE_MM {
                return None;
            }
        }
        before = now;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::uniform;

    /// Returns values that change from one layer to the next within half a millimetre around each boundary.
    fn layers(first: f64, rest: &[(f64, f64)]) -> impl Fn(f64) -> f64 {
        move |mm| {
            let mut value = first;
            for &(at, next) in rest {
                value += (next - value) * ((mm - at) / 1.0 + 0.5).clamp(0.0, 1.0);
            }
            value
        }
    }

    fn end(first: f64, rest: &[(f64, f64)]) -> Option<(f64, End)> {
        let hu = layers(first, rest);
        through_tissue(|mm| hu(mm) + 20.0 * (uniform(3, (mm * 1e3) as i64 as u64) - 0.5), 0.35)
    }

    #[test]
    fn soft_tissue_ends_where_fat_gas_bone_or_fluid_begins() {
        for (what, rest, want, how) in [
            ("fat", &[(0.2, 45.0), (3.0, -100.0)][..], 3.0, End::Fall),
            ("gas of a neighbour", &[(0.2, 45.0), (2.2, -1000.0)], 1.8, End::Fall),
            ("bone", &[(0.2, 45.0), (2.5, 400.0)], 2.5, End::Rise),
        ] {
            let (mm, end) = end(-1000.0, rest).unwrap();
            assert!((mm - want).abs() < 0.4 && end == how, "{what}: {mm} {end:?}");
        }
        let (mm, end_) = end(500.0, &[(0.0, 45.0), (3.5, -100.0)]).unwrap();
        assert!((mm - 3.5).abs() < 0.4 && end_ == End::Fall, "from fluid: {mm}");
    }

    #[test]
    fn a_wall_thinner_than_the_blur_is_told_and_an_organ_is_not() {
        let thin = |mm: f64| -1000.0 + 700.0 * (-(mm - 0.7f64).powi(2) / 0.3).exp();
        let (mm, end_) = through_tissue(thin, 0.35).unwrap();
        assert!((0.3..1.1).contains(&mm) && end_ == End::Fall, "{mm}");
        assert_eq!(end(-1000.0, &[(0.2, 50.0)]), None, "liver");
        assert_eq!(end(-1000.0, &[(4.0, 50.0)]), None, "an edge that is none");
    }

    /// Around a box, the lumen is straight across the nearest face, whatever the voxels' shape.
    #[test]
    fn the_lumen_is_inwards_of_its_wall() {
        for spacing in [DVec3::ONE, DVec3::new(0.6, 0.9, 1.4)] {
            let middle = spacing * 10.0;
            let walls = WallDistance::drawn([21; 3], spacing, |p| ((p - middle) / spacing).abs().max_element() < 4.5);
            for a in 0..3 {
                for side in [-1i64, 1] {
                    let mut voxel = [10i64; 3];
                    voxel[a] += 5 * side;
                    let expected = DVec3::AXES[a] * -(side as f64);
                    let found = inwards(&walls, voxel).unwrap();
                    assert!(found.distance(expected) < 1e-3, "{spacing}, {voxel:?}: {found}");
                }
            }
        }
    }

    /// A wall may be 6 mm thick, and not thicker.
    #[test]
    fn tissue_is_measured_up_to_the_walls_greatest_thickness() {
        let measured = |mm: f64| through_tissue(layers(-1000.0, &[(0.0, 45.0), (mm, -100.0)]), 0.35);
        let (mm, how) = measured(5.8).unwrap();
        assert!((mm - 5.8).abs() < 0.4 && how == End::Fall, "{mm}");
        assert_eq!(measured(7.5), None);
    }

    /// Three voxels of tissue between two lumens are the wall of both. Before gas that is no lumen they are one wall.
    #[test]
    fn tissue_between_two_lumens_counts_by_half_for_each() {
        let is_gas = |p: DVec3| p.x < 9.5 || p.x > 12.5;
        let ending_of = |walls: &WallDistance| {
            let grid = walls.grid();
            let hu = |n: usize| if is_gas(DVec3::X * (n % 24) as f64) { -1000 } else { 45 };
            let volume = Volume::new(grid.clone(), (0..grid.len()).map(hu).collect());
            ending(&volume, walls, [10, 4, 4], 0.5).unwrap()
        };
        let one = ending_of(&WallDistance::drawn([24, 9, 9], DVec3::ONE, |p| p.x < 9.5));
        let two = ending_of(&WallDistance::drawn([24, 9, 9], DVec3::ONE, is_gas));
        assert!((one.at_mm - 3.0).abs() < 1.0 && one.thick_mm == one.at_mm, "{one:?}");
        assert!(two.at_mm == one.at_mm && two.thick_mm == 0.5 * one.thick_mm, "{two:?}");
    }
}
