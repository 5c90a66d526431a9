//! Coverage: how much of the wall a flight has seen.
//!
//! A wall point counts as seen if, from some view of the flight, it is no further away than [`REACH_MM`], is inside a
//! square image, and no wall is in between: the ray to it crosses none, or crosses one only within a voxel of it, as
//! happens where it grazes the wall that the point belongs to. The share therefore does not depend on how densely an
//! image is sampled.

use glam::DVec3;
use rayon::prelude::*;

use super::camera::{Camera, Perspective};
use crate::dynamics::Attitude;
use crate::fields::lumen::WallPlace;
use crate::space::{PreparedVolume, first_crossing};

/// The largest distance at which a wall point counts as seen, mm.
pub(crate) const REACH_MM: f64 = 100.0;

/// The share of a wall's area that was seen, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Coverage {
    /// Seen in the direction of flight.
    pub one_way: f64,
    /// Seen from the same positions in either direction, as if the path had been flown back too.
    pub both_ways: f64,
}

/// The direction of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Facing {
    /// The direction of flight.
    Ahead,
    /// The opposite direction, from the same position.
    Back,
}

/// Returns the share of `wall` that is seen from `views` by a perspective camera.
///
/// Each view is a world position (mm) and an attitude. The image is square, and its `fov_degrees` is clamped to 1 to
/// 179; an angle that is not a number sees nothing.
pub fn coverage(
    volume: &PreparedVolume,
    wall: &[WallPlace],
    views: &[(DVec3, Attitude)],
    fov_degrees: f64,
) -> Coverage {
    Perspective::new(fov_degrees.clamp(1.0, 179.0))
        .map_or_else(|_| Coverage::default(), |camera| coverage_by(volume, wall, views, &camera))
}

/// Returns the share of `wall` that is seen from `views` in the square image of `camera`.
///
/// Each view is a world position (mm) and an attitude. All rays of the camera must start at its position.
pub(crate) fn coverage_by(
    volume: &PreparedVolume,
    wall: &[WallPlace],
    views: &[(DVec3, Attitude)],
    camera: &dyn Camera,
) -> Coverage {
    let within = |place: DVec3| camera.project(place).is_some_and(|at| at.abs().max_element() <= 1.0);
    let seen: Vec<[bool; 2]> = wall
        .par_iter()
        .with_min_len(256)
        .map(|p| {
            let mut near: Vec<(f64, Facing, DVec3)> = views
                .iter()
                .map(|(at, a)| (at, a, p.at - *at))
                .filter(|(.., to)| to.length() <= REACH_MM)
                .flat_map(|(at, a, to)| {
                    let [right, up, ahead] = [a.right(), a.up, a.forward].map(|axis| to.dot(axis));
                    // Looking back, right becomes left.
                    let ways =
                        [(Facing::Ahead, DVec3::new(right, up, ahead)), (Facing::Back, DVec3::new(-right, up, -ahead))];
                    let seen = ways.map(|(direction, place)| within(place).then_some((to.length(), direction, *at)));
                    seen.into_iter().flatten()
                })
                .collect();
            // Try the nearest view first: it is the most likely to see the point. The sort is stable, so ties keep the
            // flight's order.
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            let by = |direction: Facing| near.iter().any(|v| v.1 == direction && is_seen(volume, v.2, p.at));
            let ahead = by(Facing::Ahead);
            [ahead, ahead || by(Facing::Back)]
        })
        .collect();
    let total: f64 = wall.iter().map(|p| p.mm2).sum();
    let share = |n: usize| {
        let area: f64 = wall.iter().zip(&seen).filter(|(_, s)| s[n]).map(|(p, _)| p.mm2).sum();
        if total > 0.0 { area / total } else { 0.0 }
    };
    Coverage { one_way: share(0), both_ways: share(1) }
}

/// Returns true if no wall is between a camera at `from` and a wall point `to`.
fn is_seen(volume: &PreparedVolume, from: DVec3, to: DVec3) -> bool {
    let d = from.distance(to);
    let Some(direction) = (to - from).try_normalize() else { return true };
    let grazing = volume.voxels().grid().spacing().max_element();
    first_crossing(volume, from, direction, d).is_none_or(|t| t >= d - grazing)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};

    /// A tube of radius 10 mm along z, from 0 to 100 mm, closed at both ends. At z = 50 a pocket of radius 4 mm extends
    /// 30 mm along x.
    fn inside(p: DVec3) -> bool {
        let tube = p.truncate().length() <= 10.0 && (0.0..=100.0).contains(&p.z);
        let pocket = (p.z - 50.0).hypot(p.y) <= 4.0 && (0.0..=40.0).contains(&p.x);
        tube || pocket
    }

    fn scene() -> (PreparedVolume, Vec<WallPlace>) {
        let (dims, h) = ([140, 60, 260], 0.4);
        let origin = DVec3::new(-12.0, -12.0, -2.0);
        let grid = Grid::new(dims, DVec3::splat(h), origin, DMat3::IDENTITY).unwrap();
        let at = |n: usize| {
            let v = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
            grid.world(DVec3::from_array(v.map(|x| x as f64)))
        };
        let gas: Vec<bool> = (0..grid.len()).map(|n| inside(at(n))).collect();
        let steps = [1, dims[0], dims[0] * dims[1]];
        let wall = (0..grid.len()).filter(|&n| gas[n]).filter_map(|n| {
            let open = steps.iter().flat_map(|s| [n - s, n + s]).filter(|&m| !gas[m]).count();
            (open > 0).then(|| WallPlace { at: at(n), mm2: open as f64 * h * h })
        });
        let wall = wall.collect();
        let data = gas.iter().map(|&g| if g { -1000 } else { 40 }).collect();
        (PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default()), wall)
    }

    /// Areas of the pocket's side that are visible from the tube's axis in a 90° image, looking forwards and in either
    /// direction. A point 10 + d from the axis is seen at the flattest angle from the same distance before it, through
    /// the mouth at z − d.
    fn pocket_seen() -> [f64; 2] {
        let (na, nd) = (720, 600);
        let mut areas = [0.0; 2];
        for a in 0..na {
            let angle = std::f64::consts::TAU * (f64::from(a) + 0.5) / f64::from(na);
            let (z, y) = (4.0 * angle.cos(), 4.0 * angle.sin());
            for n in 0..nd {
                let d = 30.0 * (f64::from(n) + 0.5) / f64::from(nd);
                let mouth = (16.0 - (y * 10.0 / (10.0 + d)).powi(2)).sqrt();
                let (ahead, back) = (z - d >= -mouth, -z - d >= -mouth);
                let piece = 4.0 * std::f64::consts::TAU / f64::from(na) * 30.0 / f64::from(nd);
                areas[0] += if ahead { piece } else { 0.0 };
                areas[1] += if ahead || back { piece } else { 0.0 };
            }
        }
        areas
    }

    #[test]
    fn a_tube_with_a_pocket() {
        use std::f64::consts::PI;
        let (volume, wall) = scene();
        // Up is along x, so the image's edge runs across the pocket.
        let view = |z: f64| (DVec3::new(0.0, 0.0, z), Attitude::new(DVec3::Z, DVec3::X));
        let views: Vec<_> = (0..=80).map(|n| view(10.0 + f64::from(n))).collect();
        let c = coverage(&volume, &wall, &views, 90.0);
        // Voxel faces have 4/π times the area of a round wall, and exactly the area of a flat one.
        let round = 4.0 / PI;
        let (side, cap, hole) = (round * 2.0 * PI * 10.0 * 100.0, PI * 100.0, round * PI * 16.0);
        let pocket = round * 2.0 * PI * 4.0 * 30.0 + PI * 16.0;
        let all = side + 2.0 * cap - hole + pocket;
        // Looking forwards from z = 10, the side is seen from 10 + 10 max(|cos|, |sin|) mm on; its mean is 10 · 4 √½ ·
        // 2/π.
        let unseen = round * 2.0 * PI * 10.0 * (10.0 + 10.0 * 2.0 * 2f64.sqrt() / PI) + cap;
        let [one, both] = pocket_seen().map(|a| a * round);
        let truth = [(all - unseen - pocket + one) / all, (all - pocket + both) / all];
        println!("coverage {c:?}, truth {truth:?}");
        assert!((c.one_way - truth[0]).abs() < 0.015 && (c.both_ways - truth[1]).abs() < 0.015, "{c:?} {truth:?}");
        assert!(c.both_ways < 0.97, "the pocket's depth is never seen");
        // Facing the other end instead gives the same result for both directions.
        let back: Vec<_> = views.iter().map(|v| (v.0, Attitude::new(-v.1.forward, v.1.up))).collect();
        let b = coverage(&volume, &wall, &back, 90.0);
        assert!((b.both_ways - c.both_ways).abs() < 1e-12 && (b.one_way - c.one_way).abs() < 0.02);
    }

    #[test]
    fn nothing_seen_and_nothing_to_see() {
        let (volume, wall) = scene();
        assert_eq!(coverage(&volume, &wall, &[], 90.0), Coverage::default());
        assert_eq!(coverage(&volume, &[], &[(DVec3::Z, Attitude::new(DVec3::Z, DVec3::X))], 90.0), Coverage::default());
        let lost =
            [(DVec3::NAN, Attitude::new(DVec3::Z, DVec3::X)), (DVec3::splat(1e9), Attitude::new(DVec3::Z, DVec3::X))];
        assert_eq!(coverage(&volume, &wall, &lost, f64::NAN), Coverage::default());
    }
}
