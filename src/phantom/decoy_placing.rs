//! Placement of decoys: drawn from the seed, away from polyps.

use glam::{DMat3, DVec3};

use super::decoys::{Body, Decoy, DecoyKind, Lump, TrueDecoy, Tube};
use super::features::CHANNEL_MM;
use super::ground::{Ground, Taken};
use super::shape::{Fold, Shape};
use super::solid::{Ellipsoid, Plate, centre_of, extent};
use super::stream::stream;
use super::valve::{Valve, valve_spot};
use crate::math::hash;
use crate::math::hash::Stream;

/// Length of the tube that is within the rectum's end wall, mm.
const IN_WALL_MM: f64 = 5.5;
/// Thickness of the balloon's skin, mm. A thinner one would have holes between voxels of 1 mm.
const SKIN_MM: f64 = 1.5;
/// Number of places tried for a decoy.
const TRIES: usize = 300;

/// Returns the balls in which the valve and the tube lie, so that a lesion is in the same place with decoys and without.
pub(crate) fn reserved(shape: &Shape, seed: u64) -> Vec<(DVec3, f64)> {
    let mut balls = valve_spot(&Ground::new(shape)).map(|spot| (spot.at, 12.0)).into_iter().collect::<Vec<_>>();
    let tube = tube(shape, seed);
    balls.extend((0..=6).map(|i| (tube.from.lerp(tube.to, f64::from(i) / 6.0), 3.0)));
    balls.push((tube.balloon.0, tube.balloon.1));
    balls
}

/// Adds decoys to `shape`, away from what is `taken`, and adds their places to it.
pub(crate) fn place(shape: &mut Shape, down: DVec3, taken: &mut Taken, seed: u64) {
    let adult = shape.axis.length() > 1000.0;
    // Folds first: the other decoys grow on what they leave.
    let mut folds = Vec::new();
    let mut decoys = Vec::new();
    let mut draw = stream(seed, 81);
    for _ in 0..if adult { 2 } else { 1 } {
        if let Some((decoy, i, pair)) = (0..TRIES).find_map(|_| junction(shape, &mut draw, taken, &decoys)) {
            shape.folds[i] = pair[0].clone();
            folds.push(pair[1].clone());
            decoys.push(decoy);
        }
    }
    for _ in 0..if adult { 2 } else { 1 } {
        if let Some((decoy, fold)) = (0..TRIES).find_map(|_| stub(shape, &mut draw, taken)) {
            folds.push(fold);
            decoys.push(decoy);
        }
    }
    shape.folds.extend(folds);
    shape.folds.sort_by(|a, b| a.s.total_cmp(&b.s));
    // The valve that small bowel opens through.
    let own = shape.decoys.first().cloned();
    let ground = Ground::new(shape);
    decoys.extend((0..TRIES).find_map(|_| bulge(&ground, &mut draw, taken)));
    decoys.extend(own.or_else(|| valve(&ground)));
    decoys.push(tube_decoy(shape, seed));
    for i in 0..if adult { 4 } else { 2 } {
        decoys.extend((0..TRIES).find_map(|_| stool(&ground, down, &mut draw, taken, hash::bits(seed, 0x5700 + i))));
    }
    decoys.sort_by(|a, b| a.s.total_cmp(&b.s));
    shape.decoys = decoys;
}

fn at(kind: DecoyKind, position: DVec3, diameter_mm: f64) -> TrueDecoy {
    TrueDecoy { kind, position, diameter_mm }
}

/// Returns the balls along a fold's edge.
fn along_edge(shape: &Shape, fold: &Fold) -> Vec<(DVec3, f64)> {
    let ball = |i: i32| {
        let phi = fold.phi + f64::from(i) / 4.0 * fold.half_width;
        let frame = shape.axis.frame(fold.line(phi).clamp(0.0, shape.axis.length()));
        (frame.at + frame.direction(phi) * (fold.radius - 0.5 * fold.height(phi)), 0.5 * fold.thickness)
    };
    (-4..=4).map(ball).collect()
}

/// Lets a fold and another one cross at opposite slants.
fn junction(
    shape: &Shape,
    draw: &mut Stream,
    taken: &mut Taken,
    others: &[Decoy],
) -> Option<(Decoy, usize, [Fold; 2])> {
    let count = shape.folds.len();
    if count == 0 {
        return None;
    }
    let i = (draw.within(0.0, count as f64) as usize).min(count - 1);
    let old = shape.folds[i].clone();
    let end = shape.axis.length();
    if old.sheet || !(60.0..end - 90.0).contains(&old.s) || old.depth < 5.0 {
        return None;
    }
    let lean = draw.within(0.3, 0.42) * old.radius;
    let side = if draw.within(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
    // They cross in the middle, or the second one ends at the first.
    let meets = draw.within(0.0, 1.0) < 0.5;
    let half_width = draw.within(38f64, 48.0).to_radians();
    let phi = if meets { old.phi + 0.75 * half_width } else { old.phi };
    let first = Fold { slant: side * lean, bow: 0.0, ..old };
    let mut second = Fold { half_width, phi, slant: -side * lean, depth: 0.9 * old.depth, ..first };
    let crossing = if meets { old.phi + 0.15 * half_width } else { old.phi };
    second.s += first.line(crossing) - second.line(crossing);
    let (a, b) = (along_edge(shape, &first), along_edge(shape, &second));
    let frame = shape.axis.frame(first.line(crossing));
    let middle = frame.at + frame.direction(crossing) * (old.radius - 0.6 * old.depth);
    let apart = others.iter().all(|d| d.truth.position.distance(middle) > 60.0);
    if !apart || !taken.has_room_for(&a) || !taken.has_room_for(&b) {
        return None;
    }
    taken.take([(middle, 7.0)]);
    taken.take(b);
    let truth = at(DecoyKind::FoldJunction, middle, 14.0);
    Some((Decoy { truth, s: old.s, span_mm: 0.0, body: Body::Folds }, i, [first, second]))
}

/// Returns a short and stubby fold.
fn stub(shape: &Shape, draw: &mut Stream, taken: &mut Taken) -> Option<(Decoy, Fold)> {
    let s = draw.within(60.0, shape.axis.length() - 90.0);
    let phi = draw.within(0.0, std::f64::consts::TAU);
    let spot = Ground::new(shape).spot(s, phi)?;
    let radius = shape.axis.frame(s).at.distance(spot.at);
    let (length, depth) = (draw.within(8.0, 16.0), draw.within(4.0, 7.0).min(radius - CHANNEL_MM));
    let (thickness, slant) = (draw.within(3.0, 4.0), draw.within(-0.1, 0.1) * radius);
    let ball = (spot.at + spot.up * (0.5 * depth), 0.5 * length);
    let free = Ground::new(shape).foot(spot.at, s).is_some_and(|f| shape.to_folds(&f) < -5.0);
    if !free || depth < 4.0 || !taken.has_room_for(&[ball]) {
        return None;
    }
    taken.take([ball]);
    let half_width = 0.5 * length / radius;
    let fold = Fold { s, phi, half_width, depth, thickness, radius, slant, bow: 0.0, sheet: false };
    let truth = at(DecoyKind::FoldTip, ball.0, length);
    Some((Decoy { truth, s, span_mm: 0.0, body: Body::Folds }, fold))
}

/// Returns a bulge along a fold's edge, on one side.
fn bulge(ground: &Ground<'_>, draw: &mut Stream, taken: &mut Taken) -> Option<Decoy> {
    let folds = &ground.shape.folds;
    let count = folds.len();
    if count == 0 {
        return None;
    }
    let fold = &folds[(draw.within(0.0, count as f64) as usize).min(count - 1)];
    let phi = fold.phi + draw.within(-0.4, 0.4) * fold.half_width;
    if fold.sheet || fold.depth < 5.0 || fold.half_width < 0.8 {
        return None;
    }
    let spot = ground.spot(fold.line(phi), phi)?;
    let frame = ground.shape.axis.frame(spot.s);
    let side = if draw.within(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
    let along = (fold_place(ground.shape, fold, phi + 0.05) - fold_place(ground.shape, fold, phi - 0.05)).normalize();
    let up = (spot.up - along * spot.up.dot(along)).normalize();
    let across = along.cross(up);
    let across = across * across.dot(frame.tangent).signum() * side;
    let length = draw.within(9.0, 14.0);
    let width = length / draw.within(2.7, 3.3);
    let radii = DVec3::new(0.5 * length, 0.5 * width, 0.5 * width);
    let centre = spot.at - up * (0.35 * width + 1.0) + across * (0.5 * fold.thickness - 0.1 * width);
    let ball = (centre, 0.5 * length);
    if !taken.has_room_for(&[ball]) {
        return None;
    }
    taken.take([ball]);
    let axes = DMat3::from_cols(along, across, along.cross(across));
    let body = Body::Bulge(Ellipsoid { centre, axes, radii });
    Some(Decoy { truth: at(DecoyKind::FoldTip, centre, length), s: spot.s, span_mm: 30.0, body })
}

/// Returns the place of a fold's edge at angle `phi`, world mm.
fn fold_place(shape: &Shape, fold: &Fold, phi: f64) -> DVec3 {
    let frame = shape.axis.frame(fold.line(phi).clamp(0.0, shape.axis.length()));
    frame.at + frame.direction(phi) * (fold.radius - fold.height(phi))
}

fn valve(ground: &Ground<'_>) -> Option<Decoy> {
    let spot = valve_spot(ground)?;
    let frame = ground.shape.axis.frame(spot.s);
    let share = if ground.shape.axis.length() > 1000.0 { 1.0 } else { 0.85 };
    let size = DVec3::new(21.0, 7.0, 6.0) * share;
    let across = (frame.tangent - spot.up * frame.tangent.dot(spot.up)).normalize();
    let axes = DMat3::from_cols(across.cross(spot.up), across, spot.up);
    let lip = |side: f64| Plate { foot: spot.at + across * (side * (0.5 * size.y + 1.0)), axes, size };
    let truth = at(DecoyKind::Valve, spot.at + spot.up * (0.5 * size.z), size.x);
    Some(Decoy { truth, s: spot.s, span_mm: 35.0, body: Body::Valve([lip(-1.0), lip(1.0)]) })
}

/// Adds the lips that small bowel opens through, and removes the polyps and folds that would be in their way.
pub(crate) fn open(shape: &mut Shape, valve: &Valve) {
    let Valve { spot, lips, height, .. } = *valve;
    shape.polyps.retain(|p| p.what.position.distance(spot.at) > 0.5 * (p.what.diameter_mm + lips.size.x) + 4.0);
    let truth = at(DecoyKind::Valve, spot.at + spot.up * (0.5 * height), lips.size.x);
    shape.decoys.push(Decoy { truth, s: spot.s, span_mm: 35.0, body: Body::Lips(lips) });
}

/// Returns the rectal tube as a decoy.
pub(crate) fn tube_decoy(shape: &Shape, seed: u64) -> Decoy {
    let tube = tube(shape, seed);
    let entry = tube.from + (tube.to - tube.from).normalize() * IN_WALL_MM;
    let truth = at(DecoyKind::Tube, 0.5 * (entry + tube.to), entry.distance(tube.to));
    Decoy { truth, s: 0.0, span_mm: 70.0, body: Body::Tube(tube) }
}

/// Returns the tube: through the rectum's end wall, near its posterior wall.
fn tube(shape: &Shape, seed: u64) -> Tube {
    let mut draw = stream(seed, 82);
    let axis = &shape.axis;
    let small = axis.length() < 1000.0;
    let frame = axis.frame(0.0);
    let posterior = frame.direction(frame.angle(DVec3::Y));
    let radius = axis.profile(0.0).radius.0;
    let scale: f64 = if small { 0.6 } else { 1.0 };
    let outer = 0.5 * draw.within(8.0, 9.0) * scale.max(0.75);
    let wall = draw.within(1.5, 2.0);
    let length = draw.within(35.0, 55.0) * scale;
    // The wall that the tube enters through, and where its tip is.
    let entry = frame.at + (posterior * 0.25 - frame.tangent * 0.968) * radius;
    let tip = |s: f64| {
        let f = axis.frame(s);
        f.at + f.direction(f.angle(DVec3::Y)) * (axis.profile(s).radius.0 - outer - 2.5)
    };
    let s = (1..60).map(f64::from).find(|s| tip(*s).distance(entry) >= length).unwrap_or(40.0);
    let to = tip(s);
    let along = (to - entry).normalize();
    let balloon_radius = 0.5 * draw.within(22.0, 28.0) * scale;
    // It touches the wall, and leaves a passage in front.
    let room = |centre: DVec3| {
        let places = (0..40).map(f64::from);
        places.map(|s| axis.profile(s).radius.0 - centre.distance(axis.frame(s).at)).fold(f64::NEG_INFINITY, f64::max)
    };
    let along_tube = (0..40).map(|i| entry + along * (balloon_radius * (0.85 + 0.02 * f64::from(i))));
    let best = along_tube.clone().max_by(|a, b| room(*a).total_cmp(&room(*b)));
    let first = along_tube.clone().find(|c| room(*c) >= balloon_radius - 0.6);
    let centre = first.or(best).unwrap_or(entry);
    Tube {
        from: entry - along * IN_WALL_MM,
        to,
        radius: outer - 0.5 * wall,
        wall,
        balloon: (centre, balloon_radius, SKIN_MM),
    }
}

/// Returns a lump of stool on the wall.
fn stool(ground: &Ground<'_>, down: DVec3, draw: &mut Stream, taken: &mut Taken, seed: u64) -> Option<Decoy> {
    let axis = &ground.shape.axis;
    let s = draw.within(70.0, axis.length() - 50.0);
    let phi = axis.frame(s).angle(down) + draw.within(-1.0, 1.0) * draw.within(0.3, 3.0);
    let spot = ground.spot(s, phi)?;
    let diameter = draw.within(5.0, 12.0).min(0.7 * (axis.frame(s).at.distance(spot.at) - CHANNEL_MM));
    let (x, y) = spot.up.any_orthonormal_pair();
    let mut somewhere = |spread: f64, lift: f64| {
        x * draw.within(-spread, spread) + y * draw.within(-spread, spread) + spot.up * draw.within(0.0, lift)
    };
    // About a unit ball, then scaled to its size.
    let balls = [1.0, 0.8, 0.7].map(|r| (somewhere(0.6, 0.3), r));
    let inner = [0.45, 0.4, 0.35, 0.3].map(|r| (somewhere(0.4, 0.5), r));
    let largest = extent(&balls);
    let scale = diameter / largest;
    let middle = spot.at + spot.up * (0.45 * scale);
    let placed = |(c, r): (DVec3, f64)| (middle + c * scale, r * scale);
    let balls: Vec<_> = balls.map(placed).to_vec();
    let count = (diameter / 3.5) as usize;
    let bubbles: Vec<_> =
        inner.map(placed).into_iter().take(count.max(1)).map(|(c, r)| (c, (0.7 * r).clamp(0.6, 1.6))).collect();
    let ball = (centre_of(&balls), 0.5 * diameter);
    if diameter < 5.0 || !taken.has_room_for(&[ball]) {
        return None;
    }
    taken.take([ball]);
    let lump = Lump { balls, bubbles, hu: draw.within(0.0, 60.0), seed };
    let truth = at(DecoyKind::Stool, ball.0, diameter);
    Some(Decoy { truth, s: spot.s, span_mm: 30.0, body: Body::Stool(lump) })
}
