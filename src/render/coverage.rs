//! How much of the wall a flight has seen.
//!
//! A place at the wall counts as seen when, from some view of the flight, it is no further away than [`REACH_MM`], lies
//! within a square image, and no wall is between: the ray to it crosses none, or only within a voxel of it, as it does
//! where it grazes the wall that the place belongs to. So the share does not depend on how densely an image is sampled.

use glam::DVec3;
use rayon::prelude::*;

use super::camera::{Camera, Perspective};
use super::{PreparedVolume, first_crossing};
use crate::dynamics::Attitude;
use crate::fields::lumen::WallPlace;

/// What is further away is not counted as seen, mm.
pub const REACH_MM: f64 = 100.0;

/// The share of a wall's area that was seen, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Coverage {
    /// By the views as they were.
    pub one_way: f64,
    /// By these and by those from the same places in the opposite direction, as if the way had been flown back too.
    pub both_ways: f64,
}

/// Which way a view looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Facing {
    /// As it was flown.
    Ahead,
    /// From the same place in the opposite direction.
    Back,
}

/// The share of `wall` that is seen from `views` (world mm, and where they look) by a perspective camera with a square image
/// of `fov_degrees` (from 1 to 179; what is no angle sees nothing).
pub fn coverage(
    volume: &PreparedVolume,
    wall: &[WallPlace],
    views: &[(DVec3, Attitude)],
    fov_degrees: f64,
) -> Coverage {
    Perspective::new(fov_degrees.clamp(1.0, 179.0))
        .map_or_else(|_| Coverage::default(), |camera| coverage_by(volume, wall, views, &camera))
}

/// The share of `wall` that is seen from `views` (world mm, and where they look) in the square image of `camera`, whose rays
/// all begin at its place.
pub fn coverage_by(
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
                    // Turned round, what is on the right is on the left.
                    let ways =
                        [(Facing::Ahead, DVec3::new(right, up, ahead)), (Facing::Back, DVec3::new(-right, up, -ahead))];
                    let seen = ways.map(|(direction, place)| within(place).then_some((to.length(), direction, *at)));
                    seen.into_iter().flatten()
                })
                .collect();
            // The nearest first: it is the most likely to see it. A stable sort, so ties stay in the flight's order.
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

/// Whether no wall lies between a camera and a place at the wall.
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
    use crate::render::TransferFunction;
    use crate::volume::{Grid, Volume};

    /// A tube of radius 10 mm along z, from 0 to 100 mm, closed at both ends; at z = 50 a pocket of radius 4 mm leads 30 mm
    /// deep along x.
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

    /// Areas of the pocket's side that can be looked into from the tube's axis with an image of 90°, forwards and either
    /// way. The flattest view of a place 10 + d from the axis is from as far before it, and passes the mouth at z − d.
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
        // Up along x, so that the image's edge is across the pocket.
        let view = |z: f64| (DVec3::new(0.0, 0.0, z), Attitude::new(DVec3::Z, DVec3::X));
        let views: Vec<_> = (0..=80).map(|n| view(10.0 + f64::from(n))).collect();
        let c = coverage(&volume, &wall, &views, 90.0);
        // Faces of voxels have 4/π times the area of a round wall, and that of a flat one.
        let round = 4.0 / PI;
        let (side, cap, hole) = (round * 2.0 * PI * 10.0 * 100.0, PI * 100.0, round * PI * 16.0);
        let pocket = round * 2.0 * PI * 4.0 * 30.0 + PI * 16.0;
        let all = side + 2.0 * cap - hole + pocket;
        // Forwards from z = 10 the side is seen from 10 + 10 max(|cos|, |sin|) mm on; its mean is 10 · 4 √½ · 2/π.
        let unseen = round * 2.0 * PI * 10.0 * (10.0 + 10.0 * 2.0 * 2f64.sqrt() / PI) + cap;
        let [one, both] = pocket_seen().map(|a| a * round);
        let truth = [(all - unseen - pocket + one) / all, (all - pocket + both) / all];
        println!("coverage {c:?}, truth {truth:?}");
        assert!((c.one_way - truth[0]).abs() < 0.015 && (c.both_ways - truth[1]).abs() < 0.015, "{c:?} {truth:?}");
        assert!(c.both_ways < 0.97, "the pocket's depth is never seen");
        // Turned round, the other end is seen instead: the same both ways.
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
