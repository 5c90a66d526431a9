//! Bodies of known shape on a wall of known shape.

use glam::{DMat3, DVec3};

use super::base::Scratch;
use super::sweep::Scanner;
use super::*;
use crate::fields::lumen;
use crate::math::{hash, normal};
use crate::volume::Grid;

/// A scan of a body: `d` is the distance into the tissue, mm; the blur is 0.6 mm, and −650 HU lies at d = 0.
fn scan(size: DVec3, spacing: DVec3, noise_hu: f64, d: impl Fn(DVec3) -> f64) -> Volume {
    let dims = (size / spacing).ceil().to_array().map(|n| n as usize);
    let grid = Grid::new(dims, spacing, -0.5 * size, DMat3::IDENTITY).unwrap();
    let hu = |n: usize| {
        let [i, j, k] = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])].map(|x| x as f64);
        let share = normal::cdf(d(grid.world(DVec3::new(i, j, k))) / 0.6 - 0.4219);
        (-1000.0 + 1040.0 * share + noise_hu * hash::normal(7, n as u64)).round() as i16
    };
    let data = (0..grid.len()).map(hu).collect();
    Volume::new(grid, data)
}

/// The diameter of the tissue of a body in [`scan`], whose edge is half-way, of a diameter at −650 HU.
fn tissue(surface_mm: f64) -> f64 {
    surface_mm - 2.0 * 0.4219 * 0.6
}

/// The wall of the gas at a place.
pub(super) fn wall_at(volume: &Volume, gas: DVec3) -> (Lumen, Wall) {
    let progress = Progress::new();
    let lumen = lumen::gas_at(volume, gas, &progress).unwrap().expect("gas");
    let wall = Wall::new(volume, &lumen, -650.0, &progress).unwrap();
    (lumen, wall)
}

/// A closed room of 40 × 40 × 30 mm with a floor at z = 0 and what stands on it.
fn room(body: impl Fn(DVec3) -> f64) -> impl Fn(DVec3) -> f64 {
    move |p| {
        let wall = (p.x.abs() - 20.0).max(p.y.abs() - 20.0).max(-p.z).max(p.z - 30.0);
        wall.max(body(p))
    }
}

const ROOM: DVec3 = DVec3::new(48.0, 48.0, 70.0);

fn ball(at: DVec3, radius: f64) -> impl Fn(DVec3) -> f64 {
    move |p| radius - p.distance(at)
}

#[test]
fn a_ball_has_the_curvature_of_its_radius_and_finer_voxels_measure_it_better() {
    for radius in [3.0, 6.0, 10.0] {
        let mut errors = Vec::new();
        for h in [1.0, 0.5] {
            // A ball of tissue that floats in gas; islands stay where they touch nothing, so a thin rod holds it.
            let at = DVec3::new(0.0, 0.0, 15.0);
            let rod = |p: DVec3| 1.5 - p.truncate().length().max(p.z - 15.0);
            let volume = scan(ROOM, DVec3::splat(h), 0.0, room(move |p| ball(at, radius)(p).max(rod(p))));
            let (_, wall) = wall_at(&volume, DVec3::new(15.0, 15.0, 15.0));
            let upper = |v: &u32| wall.world(*v).z > at.z && wall.world(*v).distance(at) < radius + 1.0;
            let on: Vec<u32> = (0..wall.len() as u32).filter(upper).collect();
            let area: f64 = on.iter().map(|&v| f64::from(wall.area(v))).sum();
            let error = |v: u32| {
                let [a, b] = wall.curvatures(v).map(f64::from);
                f64::from(wall.area(v)) * (0.5 * (a + b) * radius - 1.0).powi(2)
            };
            errors.push((on.iter().map(|&v| error(v)).sum::<f64>() / area).sqrt());
            let index = on.iter().map(|&v| f64::from(wall.area(v) * wall.shape_index(v))).sum::<f64>() / area;
            assert!(index > 0.9, "a cap: {index}");
        }
        assert!(errors[0] < 0.12 && errors[1] < 0.05, "radius {radius}: {errors:?}");
        assert!(errors[1] < 0.6 * errors[0], "radius {radius}: {errors:?}");
    }
}

#[test]
fn a_ridge_is_curved_one_way_and_a_pit_the_other_way() {
    let ridge = |p: DVec3| 4.0 - p.y.hypot(p.z);
    let volume = scan(ROOM, DVec3::splat(0.8), 0.0, room(ridge));
    let (_, wall) = wall_at(&volume, DVec3::new(0.0, 10.0, 15.0));
    let crest = wall.nearest(DVec3::new(1.0, 0.0, 4.0), 1.0).unwrap();
    let [k1, k2] = wall.curvatures(crest);
    assert!((k1 - 0.25).abs() < 0.02 && k2.abs() < 0.01, "{k1}, {k2}");
    assert!((wall.shape_index(crest) - 0.75).abs() < 0.03 && (wall.curvedness(crest) - 0.177).abs() < 0.02);
    assert!(wall.normal(crest).z > 0.99, "into the lumen");
    // A corner of the room is a pit.
    let corner = wall.nearest(DVec3::new(20.0, 20.0, 30.0), 2.0).unwrap();
    assert!(wall.shape_index(corner) < 0.15, "{}", wall.shape_index(corner));
    let ceiling = wall.nearest(DVec3::new(0.0, 0.0, 30.0), 1.0).unwrap();
    assert!(wall.curvedness(ceiling) < 0.01);
    assert_eq!(wall.nearest(DVec3::new(0.0, 0.0, 15.0), 3.0), None);
}

/// The cap nearest to a place, measured.
fn measured(volume: &Volume, wall: &Wall, at: DVec3) -> Lesion {
    let all = caps(wall, 0.02, 3.0);
    let away = |c: &Cap| wall.world(c.peak).distance(at);
    let cap = all.iter().min_by(|a, b| away(a).total_cmp(&away(b))).expect("a cap");
    Lesion::of(wall, cap, volume, &mut Scratch::new(wall)).expect("a lesion")
}

#[test]
fn a_ball_on_a_floor_has_its_diameter_height_and_volume() {
    for (diameter, lift, noise) in [(6.0, 1.0, 0.0), (6.0, 1.0, 22.0), (10.0, 1.5, 22.0), (16.0, 3.0, 22.0)] {
        let radius = 0.5 * diameter;
        let at = DVec3::new(0.4, -0.3, lift);
        let volume = scan(ROOM, DVec3::new(0.7, 0.7, 1.0), noise, room(ball(at, radius)));
        let (_, wall) = wall_at(&volume, DVec3::new(15.0, 15.0, 15.0));
        let found = measured(&volume, &wall, at + DVec3::Z * radius);
        let (height, cap) = (radius + lift, radius - lift);
        let spherical = std::f64::consts::PI * (4.0 * radius.powi(3) - cap * cap * (3.0 * radius - cap)) / 3.0;
        let told = format!("{diameter} mm, {noise} HU: {found:?}");
        assert!((found.diameter_mm - tissue(diameter)).abs() < 0.45, "{told}");
        assert!((found.height_mm - height).abs() < 0.4, "{height}: {told}");
        assert!((found.volume_mm3 / spherical - 1.0).abs() < 0.15, "{spherical}: {told}");
        assert!(found.axis.z > 0.98 && (found.ends[0].distance(found.ends[1]) - found.diameter_mm).abs() < 1e-9);
        assert!((found.feature("hu_mean") - 40.0).abs() < 45.0, "{told}");
        assert!(found.feature("no such").is_nan());
    }
}

#[test]
fn a_head_on_a_stalk_is_measured_without_it() {
    let head = DVec3::new(0.0, 0.0, 10.0);
    let stalk = |p: DVec3| 1.5 - p.truncate().length().max(p.z - 10.0);
    let volume = scan(ROOM, DVec3::new(0.7, 0.7, 1.0), 22.0, room(move |p| ball(head, 4.0)(p).max(stalk(p))));
    let (_, wall) = wall_at(&volume, DVec3::new(15.0, 15.0, 15.0));
    let found = measured(&volume, &wall, head + DVec3::Z * 4.0);
    assert!((found.diameter_mm - tissue(8.0)).abs() < 0.4, "{found:?}");
    assert!((found.height_mm - 14.0).abs() < 0.6 && found.feature("stalk_mm") > 2.0, "{found:?}");
}

#[test]
fn detectors_find_balls_and_no_ridge_and_the_order_is_theirs() {
    let balls = [(DVec3::new(-10.0, -8.0, 1.5), 4.0), (DVec3::new(9.0, 10.0, 1.0), 3.0)];
    let body = move |p: DVec3| {
        let ridge = 3.0 - p.y.hypot(p.z);
        balls.iter().fold(ridge, |d, &(at, r)| d.max(ball(at, r)(p)))
    };
    let volume = scan(ROOM, DVec3::new(0.7, 0.7, 1.0), 22.0, room(body));
    let (lumen, wall) = wall_at(&volume, DVec3::new(15.0, 0.0, 15.0));
    let colon = Colon { volume: &volume, lumen: &lumen, wall: &wall };
    for detector in &detectors::BUILT_IN {
        let found = find(detector, &colon, &Progress::new()).unwrap();
        assert!(found.windows(2).all(|w| w[0].score >= w[1].score), "{}", detector.name);
        for (at, radius) in balls {
            let rank = found.iter().position(|c| c.position.distance(at) < radius + 2.0);
            assert!(rank.is_some_and(|r| r < 2), "{}: {rank:?} of {}", detector.name, found.len());
        }
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(one.install(|| find(detector, &colon, &Progress::new()).unwrap()), found, "{}", detector.name);
    }
}

/// A plaque that follows a concave wall is nowhere curved like a cap. At the usual scale its rim is a chain of small bumps.
#[test]
fn a_plaque_on_a_concave_wall_is_one_lesion() {
    let (bowel, radius, high) = (20.0, 8.0, 2.3);
    let tube = move |p: DVec3| {
        let r = p.truncate().length();
        let off = DVec3::new(bowel * p.y.atan2(p.x), 0.0, p.z).length() / radius;
        (r - bowel + high * (1.0 - off.powi(4)).max(0.0)).max(p.z.abs() - 26.0)
    };
    let size = DVec3::new(52.0, 52.0, 64.0);
    let volume = scan(size, DVec3::new(0.7, 0.7, 1.0), 22.0, tube);
    let (lumen, wall) = wall_at(&volume, DVec3::ZERO);
    let colon = Colon { volume: &volume, lumen: &lumen, wall: &wall };
    let found = find(&detectors::BUILT_IN[0], &colon, &Progress::new()).unwrap();
    let first = &found[0];
    let lesion = first.lesion.as_ref().unwrap();
    let at = DVec3::new(bowel, 0.0, 0.0);
    assert!(first.score > 0.5 && first.position.distance(at) < 6.0, "{:?}", first);
    assert!(found.iter().skip(1).all(|c| c.score < first.score.min(0.5)), "{:?}", found.get(1));
    assert!((lesion.diameter_mm - 2.0 * radius).abs() < 3.0 && (lesion.height_mm - high).abs() < 0.8, "{lesion:?}");
    assert!(lesion.feature("broad") > 0.5 && lesion.axis.dot(DVec3::NEG_X) > 0.95, "{lesion:?}");
    // At the usual scale alone there are only parts of its rim.
    let parts = caps(&wall, 0.02, 3.0);
    assert!(parts.iter().all(|c| c.area < 60.0), "{:?}", parts.iter().map(|c| c.area).collect::<Vec<_>>());
}

#[test]
fn bumps_lower_than_the_noise_are_no_candidates() {
    let bumps = [(-9.0, 0.35), (0.0, 1.6), (9.0, 0.35)];
    let body = move |p: DVec3| {
        bumps
            .iter()
            .map(|(x, high)| high * (-((p.x - x).powi(2) + p.y * p.y) / 8.0).exp() - p.z)
            .fold(f64::MIN, f64::max)
    };
    let volume = scan(ROOM, DVec3::new(0.7, 0.7, 1.0), 22.0, room(body));
    let (lumen, wall) = wall_at(&volume, DVec3::new(0.0, 0.0, 15.0));
    let colon = Colon { volume: &volume, lumen: &lumen, wall: &wall };
    let found = find(&detectors::BUILT_IN[0], &colon, &Progress::new()).unwrap();
    let near = |x: f64| found.iter().any(|c| c.position.distance(DVec3::new(x, 0.0, 0.5)) < 4.0);
    let heights: Vec<f64> = found.iter().filter_map(|c| Some(c.lesion.as_ref()?.height_mm)).collect();
    assert!(near(0.0) && !near(-9.0) && !near(9.0), "{heights:?}");
}

#[test]
fn what_a_detector_returns_is_put_in_order_and_one_is_left_for_each_place() {
    fn odd(_: &Colon<'_>, _: &Progress) -> Result<Vec<Candidate>> {
        let at = |x: f64, score| Candidate::new(DVec3::new(x, 0.0, 0.0), score);
        Ok(vec![at(-18.0, 1.0), at(-15.0, 2.0), at(0.0, f64::NAN), at(12.0, 1.0), at(5.0, 1.0)])
    }
    fn broken(_: &Colon<'_>, _: &Progress) -> Result<Vec<Candidate>> {
        panic!("a bug")
    }
    let volume = scan(ROOM, DVec3::ONE, 0.0, room(|_| f64::NEG_INFINITY));
    let (lumen, wall) = wall_at(&volume, DVec3::new(0.0, 0.0, 15.0));
    let colon = Colon { volume: &volume, lumen: &lumen, wall: &wall };
    let detector = |find| Detector { name: "own", summary: "", find };
    let found = find(&detector(odd), &colon, &Progress::new()).unwrap();
    let places: Vec<(f64, f64)> = found.iter().map(|c| (c.position.x, c.score)).collect();
    assert_eq!(places, [(-15.0, 2.0), (5.0, 1.0), (12.0, 1.0)]);
    let e = find(&detector(broken), &colon, &Progress::new()).unwrap_err().to_string();
    assert!(e.contains("detector own") && e.contains("a bug"), "{e}");
    let (lumen, wall) = (Lumen::none(volume.grid()), Wall::default());
    let colon = Colon { volume: &volume, lumen: &lumen, wall: &wall };
    for detector in &detectors::BUILT_IN {
        assert_eq!(find(detector, &colon, &Progress::new()).unwrap(), [], "no wall, no candidate: {}", detector.name);
    }
}

/// A candidate at `$x`, 0, `$z` beside one on the wall.
macro_rules! at {
    ($x:expr, $z:expr) => {
        |_: &Colon<'_>, _: &Progress| {
            Ok(vec![Candidate::new(DVec3::ZERO, 1.0), Candidate::new(DVec3::new($x, 0.0, $z), 0.5)])
        }
    };
}

#[test]
fn places_that_are_not_on_the_wall_are_a_fault_of_the_detector() {
    let volume = scan(ROOM.with_z(100.0), DVec3::ONE, 0.0, room(|_| f64::NEG_INFINITY));
    let (lumen, wall) = wall_at(&volume, DVec3::new(0.0, 0.0, 15.0));
    let colon = Colon { volume: &volume, lumen: &lumen, wall: &wall };
    type Find = fn(&Colon<'_>, &Progress) -> Result<Vec<Candidate>>;
    let found = |find: Find| super::find(&Detector { name: "own", summary: "", find }, &colon, &Progress::new());
    // The centre of a large polyp is no fault.
    for on_the_wall in [at!(15.0, 0.0), at!(15.0, 8.0) as Find, at!(15.0, -6.0)] {
        assert_eq!(found(on_the_wall).unwrap().len(), 2);
    }
    for (off_the_wall, why) in [
        (at!(1e6, 0.0) as Find, "outside the scan: 1.0e6,0.0,0.0 mm"),
        (at!(0.0, 1e300), "outside the scan: 0.0,0.0,1.0e300 mm"),
        (at!(0.0, -70.0), "outside the scan: 0.0,0.0,-70.0 mm"),
        (at!(f64::NAN, 0.0), "not finite"),
        (at!(0.0, f64::INFINITY), "not finite"),
        (at!(0.0, -40.0), "far from the wall: 0.0,0.0,-40.0 mm"),
    ] {
        let e = found(off_the_wall).unwrap_err();
        assert!(e.kind as u8 == 1 && e.what == "detector own" && e.why.ends_with(why), "{e}");
    }
}

#[test]
fn an_ellipsoid_is_found_from_a_part_of_it_and_nothing_from_nothing() {
    use super::fit::Ellipsoid;
    let half = DVec3::new(3.0, 4.0, 5.0);
    let turn = DMat3::from_rotation_y(0.4);
    let cap = |n: u64| {
        let u = |k| hash::uniform(3, 4 * n + k);
        let (z, phi) = (u(0), std::f64::consts::TAU * u(1));
        let r = (1.0f64 - z * z).sqrt();
        (turn * (half * DVec3::new(r * phi.cos(), r * phi.sin(), z)) + DVec3::new(7.0, 8.0, 9.0), 0.3)
    };
    let points: Vec<(DVec3, f64)> = (0..600).map(cap).collect();
    let fit = Ellipsoid::fit(&points, 1.0).unwrap();
    assert!(fit.rms < 0.02 && fit.centre.distance(DVec3::new(7.0, 8.0, 9.0)) < 0.3, "{fit:?}");
    let along = |d: DVec3| 2.0 / (fit.s * d).length();
    for n in 0..3 {
        let d = turn.col(n);
        assert!((along(d) - 2.0 * half[n]).abs() < 0.3, "{n}: {}", along(d));
    }
    assert!(fit.distance(fit.centre + turn.x_axis * 4.0) > 0.7 && fit.distance(fit.centre) < 0.0);
    let flat: Vec<(DVec3, f64)> = points.iter().map(|p| (DVec3::new(p.0.x, p.0.y, 1.0), 1.0)).collect();
    for none in [&points[..3], &flat, &[], &vec![(DVec3::NAN, 1.0); 9], &vec![(DVec3::ONE, 1.0); 9]] {
        assert_eq!(Ellipsoid::fit(none, 1.0), None);
    }
}

#[test]
fn twenty_clicks_around_a_polyp_measure_the_same_lesion() {
    let (at, radius) = (DVec3::new(1.4, -2.3, 1.5), 4.0);
    let body = move |p: DVec3| {
        // A fold beside it.
        let fold = 1.5 - (p.x - 9.0).hypot((p.z - 5.0).max(0.0));
        ball(at, radius)(p).max(fold)
    };
    let volume = scan(ROOM, DVec3::new(0.7, 0.7, 1.0), 22.0, room(body));
    let (_, wall) = wall_at(&volume, DVec3::new(-15.0, 15.0, 15.0));
    let clicks = (0..20u64).map(|n| {
        let u = |k| hash::uniform(11, 4 * n + k);
        let (z, phi) = (0.2 + 0.8 * u(0), std::f64::consts::TAU * u(1));
        let r = (1.0f64 - z * z).sqrt();
        at + radius * DVec3::new(r * phi.cos(), r * phi.sin(), z) + DVec3::splat(u(2) - 0.5)
    });
    let found: Vec<Measurement> = clicks.map(|c| measure(&wall, &volume, c, |_| false).unwrap()).collect();
    for m in &found {
        assert!((m.lesion.diameter_mm - tissue(8.0)).abs() < 0.5 && m.form == Form::Sessile, "{m:?}");
        assert!((m.lesion.diameter_mm - found[0].lesion.diameter_mm).abs() < 0.3, "{m:?}");
        assert!(m.confidence > 0.7 && m.why.is_empty(), "{m:?}");
    }
    // Also from its foot, and on the fold with a reason.
    let foot = measure(&wall, &volume, DVec3::new(1.4, 2.8, 0.0), |_| true).unwrap();
    assert!((foot.lesion.diameter_mm - tissue(8.0)).abs() < 0.5 && foot.confidence < found[0].confidence, "{foot:?}");
    if let Ok(fold) = measure(&wall, &volume, DVec3::new(9.0, 12.0, 6.5), |_| false) {
        assert!(fold.confidence < 0.5 && fold.why.iter().any(|w| w.contains("fold") || w.contains("flat")), "{fold:?}");
    }
    for (place, why) in [
        (DVec3::new(-10.0, 0.0, 15.0), "no wall"),
        (DVec3::new(900.0, 0.0, 15.0), "no wall"),
        (DVec3::new(-15.0, -15.0, 30.0), "does not bulge"),
    ] {
        let e = measure(&wall, &volume, place, |_| false).map(|m| m.lesion.height_mm);
        match e {
            Err(e) => assert!(e.kind as i32 == 4 && e.to_string().contains(why), "{e}"),
            Ok(height) => assert!(why == "does not bulge" && height < 0.2, "{height} at {place}"),
        }
    }
    assert!(measure(&Wall::default(), &volume, at, |_| false).is_err());
}

#[test]
fn the_flow_sinks_what_bulges_and_leaves_ridges() {
    let balls = [(DVec3::new(-10.0, -8.0, 0.0), 4.0), (DVec3::new(9.0, 9.0, 1.0), 3.0)];
    let body = move |p: DVec3| {
        let ridge = 3.0 - p.y.hypot(p.z);
        balls.iter().fold(ridge, |d, &(at, r)| d.max(ball(at, r)(p)))
    };
    let mut errors = Vec::new();
    for h in [1.0, 0.5] {
        let volume = scan(ROOM, DVec3::splat(h), if h < 1.0 { 0.0 } else { 22.0 }, room(body));
        let (_, wall) = wall_at(&volume, DVec3::new(15.0, 0.0, 15.0));
        let sunk = flow::protrusions(&wall, &Progress::new()).unwrap();
        assert!(sunk.iter().all(|mm| mm.is_finite() && *mm >= 0.0));
        let at = |place: DVec3| f64::from(sunk[wall.nearest(place, 2.0).unwrap() as usize]);
        for (place, radius) in balls {
            let top = place + DVec3::Z * radius;
            let height = radius + place.z;
            // It hangs on the rim where k2 vanishes.
            assert!((0.5 * height..height + 0.3).contains(&at(top)), "{h}: {} of {height}", at(top));
            errors.push(height - at(top));
        }
        assert!(at(DVec3::new(12.0, 0.0, 3.0)) < 0.15, "{h}: the ridge stays: {}", at(DVec3::new(12.0, 0.0, 3.0)));
        assert!(at(DVec3::new(15.0, -15.0, 0.0)) < 0.1, "{h}: the floor stays");
    }
    assert!(flow::protrusions(&Wall::default(), &Progress::new()).unwrap().is_empty());
}

/// Balls of exact diameter, sampled finely and blurred as a scanner does, which moves every level of a curved edge.
#[test]
fn diameters_are_those_of_the_tissue_whatever_the_blur() {
    let mut all = Vec::new();
    for (n, sigma_mm) in [0.5, 0.7, 1.0, 1.2].into_iter().enumerate() {
        for (k, diameter) in [[6.0, 14.0], [8.0, 11.0]][n % 2].into_iter().enumerate() {
            let radius = 0.5 * diameter;
            let at = DVec3::new(0.3 * n as f64 - 0.4, 0.2 - 0.17 * k as f64, [0.35, 0.6][k % 2] * radius);
            let inside = room(ball(at, radius));
            let spacing = DVec3::new(0.7, 0.7, 1.0);
            let scanner = Scanner {
                spacing,
                fine: [2; 3],
                sigma_mm: DVec3::splat(sigma_mm),
                is_thick: false,
                noise_hu: 15.0,
                seed: 5,
            };
            let volume = scanner.scan(DVec3::new(-22.0, -22.0, -3.0), DVec3::new(44.0, 44.0, 34.0), inside);
            let (_, wall) = wall_at(&volume, DVec3::new(15.0, 15.0, 15.0));
            let found = measure(&wall, &volume, at + DVec3::Z * radius, |_| false).unwrap().lesion;
            let surface = found.feature("diameter_mm");
            println!(
                "{sigma_mm} {diameter}: {:+.2}, its surface {:+.2}",
                found.diameter_mm - diameter,
                surface - diameter
            );
            all.push([found.diameter_mm - diameter, surface - diameter]);
        }
    }
    let mean = |of: usize| all.iter().map(|e| e[of]).sum::<f64>() / all.len() as f64;
    let deviation = (all.iter().map(|e| (e[0] - mean(0)).powi(2)).sum::<f64>() / (all.len() - 1) as f64).sqrt();
    println!("bias {:.2} mm, SD {deviation:.2} mm; of the surface {:.2} mm", mean(0), mean(1));
    assert!(mean(0).abs() <= 0.3 && deviation <= 0.5 && mean(1) > 0.4);
}
