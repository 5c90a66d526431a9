//! The anatomy of a colon in the patient's second position: all that is on its wall goes with it.
//!
//! Constrictions and folds follow the arc length and the angle. Polyps and strands keep their distance from the plain wall. Lesions,
//! decoys and the ileocecal valve are rigid: each goes with the surface that it grows on, as the surface shifts, turns and leans.

use glam::{DMat3, DQuat, DVec3};

use super::centerline::Centerline;
use super::coordinates::{Motion, Place};
use super::decoy_placing;
use super::decoys::{Body, Decoy, TrueDecoy};
use super::features::CHANNEL_MM;
use super::ground::{Ground, Spot};
use super::lesions::Lesion;
use super::shape::{Attached, Bridge, Fold, Polyp, Shape};
use super::solid::{Ellipsoid, Plate, Rod};
use super::spline::Spline;
use super::valve::Valve;

/// Range of the factor by which a fold's deviation from the plane across the axis is stretched.
const LEAN: [f64; 2] = [0.6, 1.4];
/// Largest change of the angle between what is rigid and the colon's frame, degrees.
const LEANS_DEG: f64 = 20.0;
/// Least height of a fold where the lumen is narrower, mm.
const LOWEST_MM: f64 = 2.0;

/// Returns the colon `first` around its axis in the second position, with nothing collapsed, and the valve.
pub(crate) fn shape(
    first: &Shape,
    axis: Centerline,
    motion: &Motion,
    valve: Option<&Valve>,
    seed: u64,
) -> (Shape, Option<Valve>) {
    // What lesions and decoys grow on.
    let bare = Shape { lesions: Vec::new(), decoys: Vec::new(), collapsed: Vec::new(), ..first.clone() };
    let rows = first.rows.clone().map(|row| row.iter().map(|s| motion.along.at(*s)).collect());
    let (step, turn) = (axis.knot_step(), &motion.turn);
    let twist = |i: usize| {
        let s = i as f64 * step;
        DVec3::X * (turn.jet(s).at.x + first.twist(motion.along.back(s)).0)
    };
    let twists: Vec<DVec3> = (0..axis.knots().len()).map(twist).collect();
    let (from, to) = (turn.jet(0.0).d1, turn.jet(axis.length()).d1);
    let twist = Some(Spline::new(step, twists, from * DVec3::X, to * DVec3::X));
    let (folds, polyps, bridges) = (Vec::new(), Vec::new(), Vec::new());
    let mut own = Shape { axis, twist, rows, folds, polyps, bridges, ..bare.clone() };
    own.folds = first.folds.iter().map(|fold| moved_fold(fold, first, &own, motion)).collect();
    own.folds.sort_by(|a, b| a.s.total_cmp(&b.s));
    let mover = Mover { first: Ground::new(&bare), second: Ground::new(&own), motion };
    let polyps = first.polyps.iter().map(|a| mover.attached(a, |p, s| mover.ball(p, s))).collect();
    let bridges = first.bridges.iter().map(|a| mover.attached(a, |b, s| mover.strand(b, s))).collect();
    own = Shape { polyps, bridges, ..own };
    let mover = Mover { first: Ground::new(&bare), second: Ground::new(&own), motion };
    let lesions = first.lesions.iter().map(|a| mover.attached(a, |l, s| mover.lesion(l, s))).collect();
    let decoys = first.decoys.iter().map(|d| mover.decoy(d, seed)).collect();
    let valve = valve.map(|v| mover.valve(v));
    (Shape { lesions, decoys, ..own }, valve)
}

/// Returns a fold of `first` in the second position.
fn moved_fold(fold: &Fold, first: &Shape, second: &Shape, motion: &Motion) -> Fold {
    let s = motion.along.at(fold.s);
    let radius = fold.radius * second.axis.profile(s).radius.0 / first.axis.profile(fold.s).radius.0;
    let depth = fold.depth.min((radius - CHANNEL_MM).max(LOWEST_MM));
    // Two folds that cross still do.
    let lean = motion.along.slope(fold.s).clamp(LEAN[0], LEAN[1]);
    let phi = fold.phi + motion.turn.jet(s).at.x;
    Fold { s, phi, radius, depth, slant: fold.slant * lean, bow: fold.bow * lean, ..*fold }
}

/// A motion that keeps the shape of things: a rotation about a point, and a shift.
struct Rigid {
    rotation: DMat3,
    from: DVec3,
    to: DVec3,
}

impl Rigid {
    fn at(&self, p: DVec3) -> DVec3 {
        self.to + self.rotation * (p - self.from)
    }

    fn ellipsoid(&self, e: Ellipsoid) -> Ellipsoid {
        Ellipsoid { centre: self.at(e.centre), axes: self.rotation * e.axes, ..e }
    }

    fn rod(&self, rod: Rod) -> Rod {
        Rod { from: self.at(rod.from), to: self.at(rod.to), ..rod }
    }

    fn plate(&self, plate: Plate) -> Plate {
        Plate { foot: self.at(plate.foot), axes: self.rotation * plate.axes, ..plate }
    }
}

/// Moves things from the first to the second position.
struct Mover<'a> {
    first: Ground<'a>,
    second: Ground<'a>,
    motion: &'a Motion,
}

impl Mover<'_> {
    fn attached<T>(&self, a: &Attached<T>, moved: impl Fn(&T, f64) -> T) -> Attached<T> {
        Attached { s: self.motion.along.at(a.s), what: moved(&a.what, a.s) }
    }

    /// Returns the place of a position (world, mm) in the loop around arc length `s`, before and after.
    fn places(&self, p: DVec3, s: f64) -> Option<[Place; 2]> {
        let (first, second) = (self.first.shape, self.second.shape);
        let place = Place::at_foot(&first.axis, &self.first.foot(p, s)?);
        Some([place, self.motion.forth(place, |s, phi| first.radius(s, phi), |s, phi| second.radius(s, phi))])
    }

    /// Returns where a position in the loop around arc length `s` is, world mm.
    fn position(&self, p: DVec3, s: f64) -> DVec3 {
        self.places(p, s).map_or(p, |[_, place]| place.position(&self.second.shape.axis))
    }

    fn ball(&self, polyp: &Polyp, s: f64) -> Polyp {
        Polyp { position: self.position(polyp.position, s), ..*polyp }
    }

    fn strand(&self, strand: &Bridge, s: f64) -> Bridge {
        Bridge { from: self.position(strand.from, s), to: self.position(strand.to, s), ..*strand }
    }

    /// Returns the motion of what grows on the surface at the point nearest to `p` (world, mm), in the loop around arc length `s`.
    fn rigid(&self, p: DVec3, s: f64) -> Rigid {
        self.try_rigid(p, s).unwrap_or_else(|| Rigid { rotation: DMat3::IDENTITY, from: p, to: self.position(p, s) })
    }

    fn try_rigid(&self, p: DVec3, s: f64) -> Option<Rigid> {
        let (from, own) = on_surface(&self.first, p, s)?;
        let [before, after] = self.places(from, s)?;
        let (to, other) = on_surface(&self.second, after.position(&self.second.shape.axis), after.s)?;
        let axes = |axis: &Centerline, place: Place| {
            let frame = axis.frame(place.s);
            let out = frame.direction(place.phi);
            DMat3::from_cols(out, frame.tangent.cross(out), frame.tangent)
        };
        let turn = axes(&self.second.shape.axis, after) * axes(&self.first.shape.axis, before).transpose();
        let (leans, most) = DQuat::from_rotation_arc((turn * own).normalize(), other.normalize()).to_axis_angle();
        let lean = DMat3::from_axis_angle(leans, most.min(LEANS_DEG.to_radians()));
        Some(Rigid { rotation: lean * turn, from, to })
    }

    fn lesion(&self, lesion: &Lesion, s: f64) -> Lesion {
        let rigid = self.rigid(lesion.root, s);
        let stem = lesion.stem.map(|stem| rigid.rod(stem));
        Lesion { head: rigid.ellipsoid(lesion.head), stem, root: rigid.at(lesion.root), ..*lesion }
    }

    /// Returns a decoy. A tube is not anatomy: it is put in again.
    fn decoy(&self, decoy: &Decoy, seed: u64) -> Decoy {
        let truth = decoy.truth;
        let s = self.motion.along.at(decoy.s);
        let moved = |rigid: &Rigid, body: Body| {
            let truth = TrueDecoy { position: rigid.at(truth.position), ..truth };
            Decoy { truth, s, span_mm: decoy.span_mm, body }
        };
        match &decoy.body {
            Body::Folds => {
                let truth = TrueDecoy { position: self.position(truth.position, decoy.s), ..truth };
                Decoy { truth, s, span_mm: decoy.span_mm, body: Body::Folds }
            }
            Body::Bulge(bulge) => {
                let rigid = self.rigid(bulge.centre, decoy.s);
                moved(&rigid, Body::Bulge(rigid.ellipsoid(*bulge)))
            }
            Body::Valve(lips) => {
                let rigid = self.rigid(0.5 * (lips[0].foot + lips[1].foot), decoy.s);
                moved(&rigid, Body::Valve(lips.map(|lip| rigid.plate(lip))))
            }
            Body::Lips(lips) => {
                let rigid = self.rigid(lips.foot, decoy.s);
                moved(&rigid, Body::Lips(rigid.plate(*lips)))
            }
            Body::Tube(_) => decoy_placing::tube_decoy(self.second.shape, seed),
            Body::Stool(lump) => {
                let rigid = self.rigid(truth.position, decoy.s);
                let mut lump = lump.clone();
                lump.balls.iter_mut().chain(&mut lump.bubbles).for_each(|ball| ball.0 = rigid.at(ball.0));
                moved(&rigid, Body::Stool(lump))
            }
        }
    }

    fn valve(&self, valve: &Valve) -> Valve {
        let spot = valve.spot;
        let rigid = self.rigid(spot.at, spot.s);
        let moved = Spot { at: rigid.at(spot.at), up: rigid.rotation * spot.up, s: self.motion.along.at(spot.s) };
        let slit = valve.slit.map(|slit| rigid.plate(slit));
        Valve { spot: moved, lips: rigid.plate(valve.lips), slit, ..*valve }
    }
}

/// Returns the point of the surface nearest to `p` (world, mm), to first order, in the loop around arc length `s`, and the normal there.
fn on_surface(ground: &Ground<'_>, p: DVec3, s: f64) -> Option<(DVec3, DVec3)> {
    let mut at = p;
    for _ in 0..12 {
        let surface = ground.surface(at, s)?;
        if surface.d.abs() < 1e-4 {
            return Some((at, surface.normal));
        }
        // In a fold's middle the distance is cut short.
        at -= surface.normal * (0.9 * surface.d);
    }
    ground.surface(at, s).map(|surface| (at, surface.normal))
}
