//! Bends a colon's axis until two limbs touch, and clears the contact.

use glam::DVec3;

use super::centerline::{Centerline, control_points};
use super::room::has_room_but;
use super::shape::{Shape, largest};
use super::stream::stream;
use super::touching::{Limb, Touching};
use super::{PhantomSettings, bowel};
use crate::math::hash;

/// Range of the septum's thickness, mm.
pub(crate) const SEPTUM_MM: [f64; 2] = [0.4, 1.5];
/// Range that [`PhantomSettings::touching_mm`] is clamped to, mm.
const SET_MM: [f64; 2] = [0.2, 3.0];
/// Thickness for which the axes are bent, mm. All thicknesses have the same axis.
const BENT_FOR_MM: f64 = 1.0;
/// Distance from a limb's axis to the septum, and radius of the patch, in radii of the limb.
const TO_SEPTUM: f64 = 0.8;
const PATCH: f64 = 0.72;
/// Distance of the ball from the limb's axis, in radii of the limb.
const TO_BALL: f64 = 0.35;
/// Least distance along the axis between limbs that touch, mm.
const FAR_MM: f64 = 100.0;
/// Beyond a limb's range, its lumen is at least this far from the septum, mm.
const CLEAR_MM: f64 = 4.0;
/// Control points of the sigmoid and the transverse colon (number, position in an adult's mm LPS).
const SIGMOID: [(usize, [f64; 3]); 5] = [
    (5, [-48.0, -12.0, -54.0]),
    (6, [-42.0, -54.0, -52.0]),
    (7, [2.0, -74.0, -34.0]),
    (8, [48.0, -60.0, -58.0]),
    (9, [82.0, -14.0, -104.0]),
];
const TRANSVERSE: [(usize, [f64; 3]); 3] =
    [(18, [54.0, -66.0, 30.0]), (19, [4.0, -80.0, -2.0]), (20, [-48.0, -72.0, 18.0])];
/// Control points that are moved until the limbs touch, and by which share.
const MOVED: [[(usize, f64); 5]; 2] =
    [[(7, 1.0), (6, 0.8), (8, 0.8), (5, 0.2), (9, 0.2)], [(19, 1.0), (18, 0.8), (20, 0.8), (17, 0.0), (21, 0.2)]];
/// Control points whose radius is smaller than usual, and by which factor.
const NARROWER: [(usize, f64); 3] = [(18, 0.88), (19, 0.82), (20, 0.88)];
/// Control points between which the limbs touch.
const BETWEEN: [[usize; 2]; 2] = [[5, 9], [17, 21]];
/// Number of colons tried for a seed.
const TRIES: u64 = 48;

/// Returns the axis of a colon whose sigmoid and transverse colon touch, and the septum between them.
pub(crate) fn axis(
    scale: f64,
    radius: impl Fn(f64) -> f64 + Copy,
    settings: &PhantomSettings,
) -> Option<(Centerline, Touching)> {
    (0..TRIES).find_map(|n| attempt(scale, radius, settings, n))
}

fn attempt(
    scale: f64,
    radius: impl Fn(f64) -> f64,
    settings: &PhantomSettings,
    n: u64,
) -> Option<(Centerline, Touching)> {
    // The variation goes down to none, and so does the tilt.
    let left = 1.0 - n as f64 / (TRIES - 1) as f64;
    let mut draw = stream(hash::bits(settings.seed, 0x70C + n), 120);
    let (mut places, mut profile) = control_points(scale, radius, 4.0 * left, hash::bits(settings.seed, 0xA715 + n));
    for (i, factor) in NARROWER {
        profile[i].x *= factor;
    }
    let tilted = stream(settings.seed, 121).within(0.0, 1.0);
    // For three seeds of five the septum is nearly level. For the others it leans to one side, or one limb lies before the other one.
    let (slope, forwards) = match tilted {
        t if t < 0.6 => (draw.within(-0.15, 0.15), draw.within(-4.0, 4.0)),
        t if t < 0.8 => (draw.within(0.6, 1.0) * if t < 0.7 { -1.0 } else { 1.0 }, draw.within(-4.0, 4.0)),
        _ => (draw.within(-0.15, 0.15), draw.within(26.0, 44.0)),
    };
    let moved = (SIGMOID.iter().map(|limb| (limb, -0.7))).chain(TRANSVERSE.iter().map(|limb| (limb, 0.3)));
    for (&(i, at), share) in moved {
        let off = DVec3::new(0.0, -forwards * share, slope * at[0] - 0.45 * forwards.max(0.0) * (share + 0.7)) * left;
        let fixed = i == 5 || i == 9;
        let at = DVec3::from_array(at) + if fixed { DVec3::ZERO } else { off };
        places[i] += at * scale - centred(i, scale);
    }
    // Move both limbs along the line between them until they are as far apart as they should be.
    for _ in 0..40 {
        let axis = Centerline::through(&places, &profile);
        let (s, between) = nearest(&axis);
        let wanted = s.iter().map(|&s| TO_SEPTUM * axis.profile(s).radius.0).sum::<f64>() + BENT_FOR_MM;
        let gap = between.length() - wanted;
        if gap.abs() < 0.02 {
            let stretches = BETWEEN.map(|limb| limb.map(|i| axis.stations()[i]));
            if settings.ileum && !bowel::leaves_room(&axis, stretches, scale) {
                return None;
            }
            return septum(&axis, s, settings, gap).map(|touching| (axis, touching));
        }
        let step = between.normalize() * (0.6 * gap);
        for (limb, sign) in MOVED.iter().zip([1.0, -1.0]) {
            for &(i, share) in limb {
                places[i] += step * (sign * share);
            }
        }
    }
    None
}

/// Returns a control point without variation, world mm.
fn centred(i: usize, scale: f64) -> DVec3 {
    control_points(scale, |r| r, 0.0, 0).0[i]
}

/// Returns the arc lengths where the two limbs are nearest to each other, mm, and the vector from the first to the second.
fn nearest(axis: &Centerline) -> ([f64; 2], DVec3) {
    let stations = axis.stations();
    let mut range = BETWEEN.map(|[from, to]| [stations[from], stations[to]]);
    let mut best = ([0.0; 2], DVec3::INFINITY);
    for step in [4.0, 0.5, 0.05] {
        let places = range.map(|[from, to]| {
            let count = ((to - from) / step).ceil() as usize;
            (0..=count)
                .map(|i| from + (to - from) * i as f64 / count as f64)
                .map(|s| (s, axis.at(s)))
                .collect::<Vec<_>>()
        });
        best.1 = DVec3::INFINITY;
        for (s, a) in &places[0] {
            for (t, b) in &places[1] {
                if (*b - *a).length_squared() < best.1.length_squared() {
                    best = ([*s, *t], *b - *a);
                }
            }
        }
        range = [0, 1].map(|i| [(best.0[i] - 1.5 * step).max(range[i][0]), (best.0[i] + 1.5 * step).min(range[i][1])]);
    }
    best
}

/// Returns the septum between the limbs at arc lengths `s`, or `None` if they, or other loops, lack the room. The limbs are `gap` mm
/// farther apart than they should be.
fn septum(axis: &Centerline, s: [f64; 2], settings: &PhantomSettings, gap: f64) -> Option<Touching> {
    let places = s.map(|s| axis.at(s));
    let normal = (places[1] - places[0]).normalize();
    let radii = s.map(|s| axis.profile(s).radius.0);
    let middle = places[0] + normal * (TO_SEPTUM * radii[0] + 0.5 * (BENT_FOR_MM + gap));
    let limb = |i: usize| {
        let side = [-1.0, 1.0][i];
        let away = |s: f64| (axis.at(s) - middle).dot(normal) * side - largest(axis, s);
        let end = |step: f64| {
            (1..400)
                .map(|k| s[i] + step * f64::from(k))
                .find(|&s| away(s) > CLEAR_MM || !(0.0..=axis.length()).contains(&s))
        };
        let (from, to) = (end(-0.5)?, end(0.5)?);
        let is_beside = (0..=100).all(|k| {
            let s = from + (to - from) * f64::from(k) / 100.0;
            // The axis itself stays far from the septum.
            (axis.at(s) - middle).dot(normal) * side > 0.7 * axis.profile(s).radius.0
        });
        let lift = TO_SEPTUM - TO_BALL;
        let ball = (places[i] - normal * (side * TO_BALL * radii[i]), radii[i] * lift.hypot(PATCH));
        (is_beside && from > 0.0 && to < axis.length()).then_some(Limb {
            s: s[i],
            from,
            to,
            ball,
            patch: PATCH * radii[i],
        })
    };
    let limbs = [limb(0)?, limb(1)?];
    let set = settings.touching_mm.filter(|mm| mm.is_finite()).map(|mm| mm.clamp(SET_MM[0], SET_MM[1]));
    let drawn = stream(settings.seed, 122).within(SEPTUM_MM[0], SEPTUM_MM[1]);
    let touching = Touching { middle, normal, thickness_mm: set.unwrap_or(drawn), apart: 0.0, limbs };
    let far = limbs[1].from - limbs[0].to >= FAR_MM;
    (far && has_room_but(axis, [[limbs[0].from, limbs[0].to], [limbs[1].from, limbs[1].to]])).then_some(touching)
}

/// Removes the folds, polyps and strands at the contacts of a colon.
pub(crate) fn clear(shape: &mut Shape) {
    for touching in shape.touching.clone() {
        let (middle, patch) = touching.ball();
        let off = |at: DVec3, radius: f64| at.distance(middle) - radius > patch + 2.0;
        let axis = &shape.axis;
        let is_free = |s: f64, phi: f64, rho: f64| {
            let frame = axis.frame(s.clamp(0.0, axis.length()));
            touching.limb(s).is_none() || off(frame.at + frame.direction(phi) * rho, 0.0)
        };
        // A fold is taken away if its edge or the middle of its height is at the contact.
        shape.folds.retain(|fold| {
            (-10..=10).all(|k| {
                let phi = fold.phi + fold.half_width * f64::from(k) / 10.0;
                let height = fold.height(phi);
                height < 1.0 || [0.0, 0.5, 1.0].iter().all(|t| is_free(fold.line(phi), phi, fold.radius - t * height))
            })
        });
        let clear = |s: f64, at: DVec3, radius: f64| match touching.limb(s) {
            // A polyp does not reach the septum at all.
            Some(i) => off(at, radius) && touching.beyond(i, at) + radius < 0.0,
            None => true,
        };
        shape.polyps.retain(|a| clear(a.s, a.what.position, 0.5 * a.what.diameter_mm));
        shape.bridges.retain(|a| clear(a.s, a.what.from, 1.0) && clear(a.s, a.what.to, 1.0));
    }
}
