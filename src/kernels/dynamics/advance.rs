//! The step that cannot perforate: conservative advancement of a sphere through exact clearances.
//!
//! The distance to the wall is 1-Lipschitz: within a displacement of `c − r` from a point of clearance `c`, every point keeps a
//! clearance of at least `r`. The body moves by at most that distance, queries the clearance again, and repeats (conservative
//! advancement, Mirtich 1996; the same idea as sphere tracing, Hart 1996). The guarantee depends only on [`Clearances::clearance`]
//! never exceeding the true distance. It does not depend on the number of tentacles, the size of the force or the size of the step.
//!
//! **Why a sphere when the camera is a cylinder.** The sphere of [`Body::radius_mm`](super::Body::radius_mm) encloses the
//! cylinder in every orientation, so turning in place cannot bring any part of it into the wall. The guarantee then
//! depends on position alone and takes one clearance per move. A cylinder would need its least clearance over all
//! attitudes of the step. The price is room: the camera stays farther from the wall than its cylinder requires, by at
//! most the gap between the two surfaces, [`Body::gap_mm`](super::Body::gap_mm). That is 0.44 mm for the default body of
//! 1.5 mm, less than the side of a voxel. The camera may therefore be refused a passage narrower than 3 mm, and it never
//! enters one that is too narrow.

use glam::DVec3;

use crate::fields::clearance::TOLERANCE_MM;
use crate::fields::{Clearance, Clearances};

/// Maximum clearance queries per step; any displacement left after them is dropped.
const MAX_MOVES: usize = 16;
/// Within this distance of contact, mm, the motion into the wall is removed and the rest slides along it.
const SKIN_MM: f64 = 0.05;
/// Longest single move along the wall, mm.
const CREEP_MM: f64 = 0.1;
/// Longest single move off the wall where none along it is found, mm.
const OFF_MM: f64 = 0.02;

/// The outcome of a move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advance {
    /// Position of the body after the move, world mm.
    pub position: DVec3,
    /// Unit vector into the wall that stopped the body, if one did.
    pub blocked: Option<DVec3>,
    /// Clearance before the move, mm.
    pub clearance_mm: f64,
    /// True if the body is in the wall or too close to it and did not move, because no move raised the clearance.
    pub stuck: bool,
    /// True if the body is wedged: it touches walls on several sides, and did not move because it can slide along none of them.
    pub wedged: bool,
}

/// Moves a sphere of `radius` mm from `position` by `displacement` (world, mm) as far as the wall allows.
///
/// The body keeps the finder's tolerance beyond its radius, so reported clearances never fall below the radius. If it starts in the
/// wall or too close to it, only motion that raises the clearance is allowed. A displacement that is not finite does not move it.
pub fn advance(walls: &impl Clearances, position: DVec3, displacement: DVec3, radius: f64) -> Advance {
    sweep(walls, position, displacement, radius, &mut |_, _| {})
}

/// Does the same as [`advance()`] and calls `piece` with the start and end of each straight piece of the path.
pub(crate) fn sweep(
    walls: &impl Clearances,
    position: DVec3,
    displacement: DVec3,
    radius: f64,
    piece: &mut dyn FnMut(DVec3, DVec3),
) -> Advance {
    let mut rest = if displacement.is_finite() { displacement } else { DVec3::ZERO };
    let mut at = position;
    let (mut blocked, mut wedged) = (None, false);
    let first = walls.clearance(at);
    let mut clearance = first;
    for _ in 0..MAX_MOVES {
        let length = rest.length();
        if length < 1e-9 {
            break;
        }
        let free = clearance.mm - radius - TOLERANCE_MM;
        if length <= free {
            piece(at, at + rest);
            at += rest;
            break;
        }
        if free >= SKIN_MM {
            let step = rest * (free / length);
            piece(at, at + step);
            at += step;
            rest -= step;
            clearance = walls.clearance(at);
            continue;
        }
        let into = rest.dot(clearance.toward).max(0.0);
        if into > 0.0 {
            blocked = Some(clearance.toward);
        }
        let along = rest - clearance.toward * into;
        let next = creep(walls, at, clearance, along, radius)
            .or_else(|| if into > 0.0 { None } else { retreat(walls, at, clearance, along, radius) });
        let Some((next, there)) = next else {
            wedged = at == position;
            break;
        };
        piece(at, next);
        rest = along * (1.0 - next.distance(at) / along.length()).max(0.0);
        (at, clearance) = (next, there);
    }
    let stuck = first.mm < radius && at == position;
    Advance { position: at, blocked, clearance_mm: first.mm, stuck, wedged }
}

/// Makes a short move along the wall that the body touches, leaning away from it as far as needed.
///
/// Candidates are tried rather than bounded: with clearance `c₀` at the start and `c₁` at the end, a move of length `l`
/// keeps at least `(c₀ + c₁ − l)/2`. If the body starts in the wall or too close to it, any candidate is accepted that
/// raises the clearance and does not lead the centre into the wall. That last condition is tested exactly: a clearance of
/// 0 may belong to a point in gas beside a wall that is thinner than the move.
fn creep(walls: &impl Clearances, at: DVec3, here: Clearance, along: DVec3, radius: f64) -> Option<(DVec3, Clearance)> {
    let direction = along.try_normalize()?;
    let length = along.length().min(CREEP_MM);
    [0.0, 0.1, 0.5, 2.0].into_iter().find_map(|lean| {
        let next = at + (direction - here.toward * lean).normalize() * length;
        let there = walls.clearance(next);
        let keeps = there.mm >= radius && here.mm + there.mm - length >= 2.0 * radius;
        let raises = here.mm < radius && there.mm > here.mm && !walls.enters(at, next);
        (keeps || raises).then_some((next, there))
    })
}

/// Makes a shorter move off the wall that the body touches, where no move along it was found.
///
/// A body that has crept until its clearance is its radius could never leave: between the ends of a move of length `l`, the bound of
/// [`creep`] is `l/2` less than the clearance at the ends, and in a narrow place the clearance grows by less than `l`. The clearances of
/// both ends are kept, and the move is so short that in between at most [`OFF_MM`]`/2` is missing, less than the finder's tolerance.
fn retreat(walls: &impl Clearances, at: DVec3, here: Clearance, off: DVec3, radius: f64) -> Option<(DVec3, Clearance)> {
    let direction = off.try_normalize()?;
    let length = off.length().min(OFF_MM);
    [0.0, 0.1, 0.5, 2.0].into_iter().find_map(|lean| {
        let next = at + (direction - here.toward * lean).normalize() * length;
        let there = walls.clearance(next);
        (there.mm >= radius && !walls.enters(at, next)).then_some((next, there))
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use crate::checks::cases;
    use crate::fields::ClearanceFinder;
    use crate::math::hash;
    use crate::volume::{Grid, Volume};

    /// A bent tube of the given radius (mm) in tissue, with coarse voxels.
    fn tube(radius: f64, spacing: DVec3) -> Arc<Volume> {
        let dims = [0, 1, 2].map(|a| (40.0 / spacing[a]).ceil() as usize);
        let grid = Grid::new(dims, spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..grid.len())
            .map(|n| {
                let p = grid.world(DVec3::new(
                    (n % dims[0]) as f64,
                    (n / dims[0] % dims[1]) as f64,
                    (n / dims[0] / dims[1]) as f64,
                ));
                let axis = DVec3::new(20.0 + 6.0 * (p.z / 8.0).sin(), 20.0, p.z);
                if (p - axis).length() < radius { -1000 } else { 40 }
            })
            .collect();
        Arc::new(Volume::new(grid, data))
    }

    #[test]
    fn random_forces_never_perforate() {
        for (spacing, r) in [(DVec3::ONE, 8.0), (DVec3::new(0.3, 0.3, 10.0), 9.0), (DVec3::new(0.7, 0.7, 1.0), 3.5)] {
            let walls = ClearanceFinder::new(tube(r, spacing), -650.0, 12.0);
            let start = DVec3::new(20.0, 20.0, 0.0) + DVec3::new(6.0 * (20f64 / 8.0).sin(), 0.0, 20.0);
            let radius = 1.5;
            assert!(walls.at(start).mm > radius);
            let mut at = start;
            for n in 0..cases(4000u64, 500) {
                let u = |k| hash::uniform(3, 8 * n + k) * 2.0 - 1.0;
                let size = 10f64.powf(u(3) * 5.0);
                let from = at;
                let a = advance(&walls, at, DVec3::new(u(0), u(1), u(2)) * size, radius);
                at = a.position;
                // Check along the straight line between the ends only if the move was not bent by sliding.
                let parts = if a.blocked.is_none() { 8 } else { 1 };
                for p in 0..parts {
                    let c = walls.at(at.lerp(from, f64::from(p) / 8.0)).mm;
                    assert!(c >= radius - 1e-9, "step {n}: {c}");
                }
            }
        }
    }

    #[test]
    fn slides_along_the_wall() {
        let walls = ClearanceFinder::new(tube(8.0, DVec3::ONE), -650.0, 12.0);
        let mut at = DVec3::new(20.0, 20.0, 20.0) + DVec3::X * 6.0 * (20f64 / 8.0).sin();
        let z = at.z;
        for _ in 0..200 {
            let a = advance(&walls, at, DVec3::new(0.0, 1.0, 0.2), 1.5);
            at = a.position;
        }
        assert!(at.z > z + 5.0, "a push into the wall at a slant still gets on: {at}");
    }

    #[test]
    fn from_within_the_wall_only_outwards() {
        let walls = ClearanceFinder::new(tube(8.0, DVec3::ONE), -650.0, 12.0);
        let axis = DVec3::new(20.0 + 6.0 * (20f64 / 8.0).sin(), 20.0, 20.0);
        let near = axis + DVec3::Y * 6.9;
        let before = walls.at(near).mm;
        assert!(before < 1.5);
        let pushed = advance(&walls, near, DVec3::Y * 0.3, 1.5).position;
        assert!(walls.at(pushed).mm >= before && pushed.y <= near.y + 0.1, "not further into the wall: {pushed}");
        let out = advance(&walls, near, DVec3::NEG_Y * 0.3, 1.5).position;
        assert!(walls.at(out).mm > before);
        let inside = axis + DVec3::Y * 15.0;
        assert!(advance(&walls, inside, DVec3::splat(1e9), 1.5).position.is_finite());
        assert_eq!(advance(&walls, axis, DVec3::NAN, 1.5).position, axis);
    }

    /// A wedge between two planes that meet in the line x = 0 at 20° to the x axis; gas is at x < 0.
    struct Wedge;

    impl Clearances for Wedge {
        fn clearance(&self, at: DVec3) -> Clearance {
            let (sin, cos) = 20f64.to_radians().sin_cos();
            let toward = DVec3::new(sin, if at.y < 0.0 { -cos } else { cos }, 0.0);
            Clearance { mm: (-at.dot(toward)).max(0.0), toward }
        }
    }

    /// Off the wedge the clearance grows by a third of the move.
    #[test]
    fn a_body_that_touches_two_walls_is_wedged_and_gets_off_them() {
        let touching = DVec3::new(-1.5 / 20f64.to_radians().sin(), 0.0, 0.0);
        assert!((Wedge.clearance(touching).mm - 1.5).abs() < 1e-12);
        let touching = touching - DVec3::X * 1e-9;
        let pushed = advance(&Wedge, touching, DVec3::X * 0.3, 1.5);
        assert!(pushed.wedged && !pushed.stuck && pushed.position == touching && pushed.blocked.is_some());
        let aside = advance(&Wedge, touching, DVec3::Z * 0.05, 1.5);
        assert!(!aside.wedged && aside.position.z > 0.04, "along both walls it slides");
        let mut at = touching;
        for _ in 0..100 {
            let off = advance(&Wedge, at, DVec3::X * -4e-3, 1.5);
            assert!(!off.wedged && off.clearance_mm >= 1.5);
            at = off.position;
        }
        assert!((at.x - touching.x + 0.4).abs() < 1e-6, "{at}");
    }

    /// Pushed on for ten seconds, it does not gather a momentum that no motion shows, and a pull backwards acts at once.
    #[test]
    fn a_wedged_body_is_at_rest() {
        use crate::dynamics::rigid::orientation;
        use crate::dynamics::{Attitude, Body, RigidBodyState, STEP_S, Turning, step};

        let body = Body::default();
        let position = DVec3::X * (-body.radius_mm / 20f64.to_radians().sin() - 1e-9);
        let orientation = orientation(Attitude::new(DVec3::X, DVec3::Z));
        let mut at = RigidBodyState { position, momentum: DVec3::ZERO, orientation, angular: DVec3::ZERO };
        let mut pushed = |acceleration: DVec3, steps: u32| {
            for _ in 0..steps {
                let push = acceleration * body.mass_g;
                let turning = Turning::by_hand(DVec3::ZERO, 15.0);
                at = step(body.integrator.stepper(), &body, &at, &push, &turning, &Wedge, STEP_S).motion;
            }
            at
        };
        let held = pushed(DVec3::new(200.0, 10.0, 0.0), 1200);
        assert!(held.momentum == DVec3::ZERO && held.position.distance(position) < 0.1, "{held:?}");
        let off = pushed(DVec3::X * -60.0, 120);
        assert!(off.position.x < position.x - 3.0, "{off:?}");
    }

    /// A plane wall: the clearance is known.
    struct Plane;

    impl Clearances for Plane {
        fn clearance(&self, at: DVec3) -> Clearance {
            Clearance { mm: (10.0 - at.x).max(0.0), toward: DVec3::X }
        }

        fn enters(&self, _: DVec3, to: DVec3) -> bool {
            to.x >= 10.0
        }
    }

    /// Along a plane wall the body slides as far as it was to go along it, and is blocked only by motion into it.
    #[test]
    fn a_body_slides_along_a_plane_by_the_rest_of_its_way() {
        let touching = DVec3::new(10.0 - 1.5 - TOLERANCE_MM, 0.0, 0.0);
        let a = advance(&Plane, touching, DVec3::new(0.3, 0.4, 0.0), 1.5);
        assert!((a.position.y - 0.4).abs() < 1e-3 && (a.position.x - touching.x).abs() < 0.05, "{}", a.position);
        assert_eq!(a.blocked, Some(DVec3::X));
        let along = advance(&Plane, touching, DVec3::new(0.0, 0.4, 0.0), 1.5);
        assert!((along.position.y - 0.4).abs() < 1e-3, "{}", along.position);
        assert_eq!(along.blocked, None, "what goes along the wall is not blocked by it");
        let away = advance(&Plane, touching, DVec3::new(-3.0, 0.0, 0.0), 1.5);
        assert!((away.position.x - touching.x + 3.0).abs() < 0.1 && away.blocked.is_none(), "{}", away.position);
    }

    /// Two walls without thickness, across x and across y, with gas on all sides.
    struct Sheets;

    impl Clearances for Sheets {
        fn clearance(&self, at: DVec3) -> Clearance {
            let [x, y] = [10.0 - at.x, 10.0 - at.y];
            let (off, axis) = if x.abs() < y.abs() { (x, DVec3::X) } else { (y, DVec3::Y) };
            Clearance { mm: off.abs(), toward: axis * off.signum() }
        }

        fn enters(&self, from: DVec3, to: DVec3) -> bool {
            (from.x < 10.0) != (to.x < 10.0) || (from.y < 10.0) != (to.y < 10.0)
        }
    }

    /// Beyond the sheet across x there is more room. A body too close to both does not creep there.
    #[test]
    fn a_body_does_not_creep_through_a_wall_thinner_than_its_move() {
        let start = DVec3::new(9.95, 9.96, 0.0);
        for push in [DVec3::new(0.2, 0.0, 0.0), DVec3::new(3.0, 0.1, 0.0), DVec3::new(0.2, 0.2, 0.1)] {
            let mut at = start;
            for _ in 0..20 {
                at = advance(&Sheets, at, push, 1.5).position;
                assert!(at.x < 10.0 && at.y < 10.0, "pushed by {push}: {at}");
            }
        }
        let away = advance(&Sheets, start, DVec3::new(-0.3, -0.3, 0.0), 1.5);
        assert!(away.position.x < 9.9 && away.position.y < 9.9, "{}", away.position);
    }
}
