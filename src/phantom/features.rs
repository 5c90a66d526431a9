//! Placement of folds, polyps and bridges: drawn from the seed, within the space that a flight leaves.

use std::f64::consts::TAU;

use glam::DVec3;

use super::PhantomSettings;
use super::centerline::Centerline;
use super::pools::Pool;
use super::profile::SHIFT;
use super::shape::{Attached, Bridge, Fold, Polyp, Shape};
use super::stream::stream;

/// Minimum distance of folds and polyps from the axis, mm. A fillet between two of them may reduce it by 0.9 mm.
pub(crate) const CHANNEL_MM: f64 = 6.0;

/// Builds the wall around `axis` with the features that the settings enable.
pub(crate) fn shape(axis: Centerline, settings: &PhantomSettings) -> Shape {
    let seed = settings.seed;
    let taenia = stream(seed, 0).within(0.0, TAU);
    let rows = [0, 1, 2].map(|row| constrictions(&axis, seed, row));
    let (folds, polyps, bridges, lesions) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (decoys, collapsed, touching) = (Vec::new(), Vec::new(), Vec::new());
    let twist = None;
    let mut shape = Shape { axis, taenia, twist, rows, folds, polyps, bridges, lesions, decoys, collapsed, touching };
    if settings.folds {
        shape.folds = place_folds(&shape, seed);
    }
    if settings.polyps {
        shape.polyps = place_polyps(&shape, seed);
    }
    if settings.bridges {
        shape.bridges = place_bridges(&shape, seed);
    }
    shape
}

/// Returns the arc lengths of a row's constrictions, from 0 to the axis' length: 20 to 30 mm apart in a wide colon and
/// staggered against the other rows.
fn constrictions(axis: &Centerline, seed: u64, row: usize) -> Vec<f64> {
    let mut draw = stream(seed, 1 + row as u64);
    let end = axis.length();
    let gap = |s: f64, x: f64| x * axis.fold_spacing(s) * (axis.profile(s).radius.0 / 16.5).clamp(0.72, 1.0);
    let mut all = vec![0.0];
    let mut s = 15.0 + gap(0.0, 25.0) / 3.0 * row as f64 + draw.within(0.0, 4.0);
    while s < end - 18.0 {
        all.push(s);
        s += gap(s, draw.within(20.0, 30.0));
    }
    all.push(end);
    all
}

/// Returns the angle midway between a row's taeniae.
fn middle(shape: &Shape, row: usize) -> f64 {
    shape.taenia + TAU / 3.0 * (row as f64 + 0.5)
}

fn place_folds(shape: &Shape, seed: u64) -> Vec<Fold> {
    let mut folds = Vec::new();
    for (row, constrictions) in shape.rows.iter().enumerate() {
        let mut draw = stream(seed, 8 + row as u64);
        for &s in &constrictions[1..constrictions.len() - 1] {
            let radius = shape.axis.profile(s).radius.0;
            let phi = middle(shape, row) + draw.within(-0.12, 0.12);
            let half_width = draw.within(60f64, 75.0).to_radians();
            let deep = (radius * draw.within(0.36, 0.52)).clamp(6.0, 11.0).min(radius - CHANNEL_MM);
            let thickness = draw.within(2.6, 3.2);
            let lean = 0.15 * radius;
            let (slant, bow) = (draw.within(-lean, lean), draw.within(-lean, lean));
            folds.push(Fold { s, phi, half_width, depth: deep, thickness, radius, slant, bow, sheet: false });
        }
    }
    folds.sort_by(|a, b| a.s.total_cmp(&b.s));
    folds
}

/// Returns a polyp on the plain wall at arc length `s` (mm) and angle `phi`. Its centre is 0.35 radii inside the lumen.
pub(crate) fn sessile(shape: &Shape, s: f64, phi: f64, diameter_mm: f64) -> Attached<Polyp> {
    let frame = shape.axis.frame(s);
    let rho = shape.radius(s, phi) - 0.175 * diameter_mm;
    Attached { s, what: Polyp { position: frame.at + frame.direction(phi) * rho, diameter_mm } }
}

fn place_polyps(shape: &Shape, seed: u64) -> Vec<Attached<Polyp>> {
    let mut draw = stream(seed, 16);
    let end = shape.axis.length();
    let count = if end > 1000.0 { 9 } else { 6 };
    (0..count)
        .map(|i| {
            let last = f64::from(count - 1);
            let share = f64::from(i) / last;
            // Diameters from 4 to 12 mm, in mixed order along the colon.
            let wanted = 4.0 + 8.0 * f64::from((i * 4) % count) / last;
            let mut best = (f64::INFINITY, sessile(shape, 0.5 * end, 0.0, 4.0));
            for _ in 0..40 {
                let s = 40.0 + (end - 80.0) * share + draw.within(-25.0, 25.0);
                let phi = middle(shape, draw.within(0.0, 3.0) as usize) + draw.within(-0.6, 0.6);
                let radius = shape.radius(s, phi);
                let diameter = wanted.min((radius - CHANNEL_MM) / 0.675);
                // Space to nearby folds, in the polyp's radii: it should be visible, not buried.
                let room = shape
                    .folds
                    .iter()
                    .filter(|f| f.height(phi) > 0.0)
                    .map(|f| (f.s - s).abs() - 0.5 * diameter)
                    .fold(f64::INFINITY, f64::min);
                let fault = (2.0 - room).max(0.0) + 3.0 * (wanted - diameter);
                if fault < best.0 {
                    best = (fault, sessile(shape, s, phi, diameter));
                }
            }
            best.1
        })
        .collect()
}

/// Sharp thickness of the folds placed under fluid, mm.
const SHEET_MM: f64 = 2.0;

/// Adds what is hard to see under fluid to each pool: a thin fold, and a polyp of 6 to 10 mm, both where the fluid is deep.
pub(crate) fn submerge(shape: &mut Shape, pools: &[Pool], down: DVec3, sigma: f64, seed: u64) {
    let mut draw = stream(seed, 48);
    for pool in pools {
        let middle = 0.5 * (pool.from + pool.to);
        let deep = |s: f64| shape.axis.frame(s).at.dot(down) + shape.axis.profile(s).radius.0 - pool.level;
        let candidates = (-10..=10).map(|i| middle + 0.04 * f64::from(i) * (pool.to - pool.from));
        let deepest = candidates.max_by(|&a, &b| deep(a).total_cmp(&deep(b))).unwrap_or(middle);
        let (s, radius) = (deepest, shape.axis.profile(deepest).radius.0);
        let phi = shape.axis.frame(s).angle(down) + draw.within(-0.2, 0.2);
        let depth = (0.8 * deep(s)).clamp(3.0, 8.0).min(radius - CHANNEL_MM);
        // From edge to edge of the tissue it is thinner than between the wall's iso-values.
        let thickness = SHEET_MM - 2.0 * SHIFT * sigma;
        let half_width = draw.within(35f64, 45.0).to_radians();
        shape.folds.push(Fold { s, phi, half_width, depth, thickness, radius, slant: 0.0, bow: 0.0, sheet: true });
        let s = s + if s > middle { -12.0 } else { 12.0 };
        let diameter = draw.within(6.0, 10.0).min((shape.radius(s, phi) - CHANNEL_MM) / 0.675);
        let polyp = sessile(shape, s, shape.axis.frame(s).angle(down), diameter);
        if deep(s) > diameter {
            shape.polyps.push(polyp);
        }
    }
    shape.folds.sort_by(|a, b| a.s.total_cmp(&b.s));
}

fn place_bridges(shape: &Shape, seed: u64) -> Vec<Attached<Bridge>> {
    let mut draw = stream(seed, 24);
    let end = shape.axis.length();
    let count = 5;
    (0..count)
        .map(|i| {
            // Of several candidates take the one farthest from the folds, so that the strand is free-standing.
            let middle = end * (f64::from(i) + 0.5) / f64::from(count);
            let free = |s: f64| shape.folds.iter().map(|f| (f.s - s).abs()).fold(f64::INFINITY, f64::min);
            let s = (0..12).map(|_| middle + draw.within(-20.0, 20.0)).max_by(|a, b| free(*a).total_cmp(&free(*b)));
            let s = s.unwrap_or(middle);
            let phi = draw.within(0.0, TAU);
            // The chord passes the axis at half the radius or more, so it never blocks the path.
            let across = draw.within(75f64, 110.0).to_radians();
            let place = |s: f64, phi: f64| {
                let frame = shape.axis.frame(s);
                frame.at + frame.direction(phi) * (shape.radius(s, phi) + 1.5)
            };
            let slant = draw.within(-2.0, 2.0);
            let what = Bridge {
                from: place(s - slant, phi),
                to: place(s + slant, phi + across),
                diameter_mm: draw.within(1.0, 2.0),
            };
            Attached { s, what }
        })
        .collect()
}
