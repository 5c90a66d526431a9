//! The distance to a target in known lumens.

use super::*;

fn walls(dims: [usize; 3], spacing: DVec3, is_in: impl Fn(DVec3) -> bool) -> Arc<WallDistance> {
    Arc::new(WallDistance::drawn(dims, spacing, is_in))
}

/// A tube of radius 5 mm, bent to three quarters of a circle of radius 15 mm: its ends are close to each other.
fn bend(p: DVec3) -> bool {
    let q = p - DVec3::new(24.0, 24.0, 8.0);
    let ring = (q.x.hypot(q.y) - 15.0).hypot(q.z);
    ring < 5.0 && !(q.x > 0.0 && q.y > -1.0 && q.y < 3.0)
}

fn to(walls: &Arc<WallDistance>, target: DVec3) -> TargetDistance {
    TargetDistance::to(walls, target, None, &[], &Progress::new()).unwrap()
}

#[test]
fn follows_the_lumen_and_has_no_minimum_but_the_target() {
    for spacing in [DVec3::ONE, DVec3::new(0.6, 0.8, 1.5)] {
        let dims = [48.0, 48.0, 17.0];
        let w = walls([0, 1, 2].map(|a| (dims[a] / spacing[a]).ceil() as usize), spacing, bend);
        let target = DVec3::new(39.0, 28.0, 8.0);
        let d = to(&w, target);
        let mut lower = 0;
        w.set().for_each(|n, [i, j, k]| {
            let v = [i as i64, j as i64, k as i64];
            if w.value(n) < 0.0 {
                assert_eq!(d.at(v), None);
                return;
            }
            let here = d.at(v).expect("all of the bend is one piece");
            let neighbours = (0..6).map(|s| {
                let mut u = v;
                u[s / 2] += if s % 2 == 0 { 1 } else { -1 };
                d.at(u)
            });
            if !neighbours.flatten().any(|o| o < here) {
                lower += 1;
                assert_eq!(v, w.voxel(target), "a local minimum");
            }
            assert!(f64::from(here) >= w.world(v).distance(target) - 1e-4);
        });
        assert_eq!(lower, 1);
        // The taut path around the ring's inner side (10 mm) is 64.5 mm long. First-order fast marching around a
        // stepped wall gives a longer one, never a shorter one.
        let far = d.sample(DVec3::new(39.0, 22.0, 8.0)).unwrap().mm;
        assert!((64.0..77.0).contains(&far), "{far}");
    }
}

#[test]
fn the_gradient_leads_to_the_target() {
    let w = walls([48, 48, 17], DVec3::ONE, bend);
    let target = DVec3::new(39.0, 28.0, 8.0);
    let d = to(&w, target);
    for start in [DVec3::new(39.0, 22.0, 8.0), DVec3::new(9.0, 24.0, 10.0), DVec3::new(24.0, 5.0, 7.0)] {
        let mut at = start;
        let mut last = f64::INFINITY;
        for _ in 0..2000 {
            let s = d.sample(at).expect("the way stays in the lumen");
            assert!(s.mm < last + 1e-3, "at {at}: {} after {last}", s.mm);
            assert!(s.hessian.to_cols_array().iter().all(|h| h.is_finite()));
            last = s.mm;
            if at.distance(target) < 2.0 {
                break;
            }
            assert!((0.5..1.5).contains(&s.gradient.length()), "{at}: {}", s.gradient.length());
            at -= s.gradient.normalize() * 0.1;
        }
        assert!(at.distance(target) < 2.0, "from {start} to {at}");
    }
}

/// Two channels that touch along an edge, and one voxel of wall: neither leaks, in voxels or between them.
#[test]
fn no_way_through_a_touching_wall() {
    let w = walls([40, 9, 5], DVec3::ONE, |p| {
        (1.0..=7.0).contains(&p.y) && p.y != 4.0 && (1.0..=38.0).contains(&p.x)
            || (p.y == 4.0 && p.x >= 37.0 && p.x < 39.0)
    });
    let d = to(&w, DVec3::new(2.0, 2.0, 2.0));
    let (near, far) = (d.sample(DVec3::new(2.0, 3.2, 2.0)).unwrap(), d.sample(DVec3::new(2.0, 5.0, 2.0)).unwrap());
    assert!(near.mm < 2.0 && far.mm > 70.0, "{} {}", near.mm, far.mm);
    let corner = walls([20, 20, 3], DVec3::ONE, |p| (p.x < 10.0) == (p.y < 10.0));
    let d = to(&corner, DVec3::new(5.0, 5.0, 1.0));
    assert_eq!(d.at([15, 15, 1]), None);
}

#[test]
fn a_gap_is_bridged_only_as_a_guess() {
    let w = walls([60, 11, 11], DVec3::ONE, |p| (p.y - 5.0).hypot(p.z - 5.0) < 4.0 && !(25.0..33.0).contains(&p.x));
    let target = DVec3::new(3.0, 5.0, 5.0);
    assert_eq!(to(&w, target).at([50, 5, 5]), None);
    let gap = [DVec3::new(34.0, 5.0, 5.0), DVec3::new(23.0, 5.0, 5.0)];
    let d = TargetDistance::to(&w, target, None, &[gap], &Progress::new()).unwrap();
    assert!((f64::from(d.at([50, 5, 5]).unwrap()) - 47.0).abs() < 1.0);
    assert_eq!(d.guessed(), &[[gap[1], gap[0]]]);
    assert!(TargetDistance::to(&w, DVec3::new(29.0, 50.0, 5.0), None, &[], &Progress::new()).is_err());
    assert!(TargetDistance::to(&w, DVec3::NAN, None, &[], &Progress::new()).is_err());
}

/// Two rooms with a slit between them, and optionally a wide detour.
fn rooms(wide: bool) -> impl Fn(DVec3) -> bool {
    move |p| {
        let room = (p.x - 20.0).abs() < 18.0 && (p.y - 10.0).abs() < 8.0 && (p.z - 8.0).abs() < 7.0;
        let wall = (p.x - 20.0).abs() < 2.5;
        let slit = (p.y - 10.0).abs() < 1.2;
        let round = wide && p.y > 15.0 && p.y < 40.0 && (p.x - 20.0).abs() < 18.0 && (p.z - 8.0).abs() < 7.0;
        room && (!wall || slit) || round && (p.y > 24.0 || (p.x - 20.0).abs() > 6.0)
    }
}

#[test]
fn leads_where_the_body_fits() {
    let (from, target) = (DVec3::new(8.0, 10.0, 8.0), DVec3::new(32.0, 10.0, 8.0));
    let way = |wide: bool, clearance_mm: f64| {
        let w = walls([41, 44, 17], DVec3::ONE, rooms(wide));
        let d =
            TargetDistance::to(&w, target, Some(BodyClearance { from, clearance_mm }), &[], &Progress::new()).unwrap();
        let (mut at, mut least) = (from, f64::INFINITY);
        for _ in 0..2000 {
            let Some(s) = d.sample(at) else { break };
            least = least.min(f64::from(w.at(w.voxel(at)).unwrap()));
            at -= s.gradient.normalize_or_zero() * 0.1;
            if at.distance(target) < 2.0 {
                break;
            }
        }
        (d, at.distance(target) < 2.0, least)
    };
    let (d, there, least) = way(true, 2.5);
    assert!(there && d.clearance_mm() == 2.5 && least > 1.7, "{there} {least}");
    // From the slit the field leads back to the nearer room.
    for x in [17.0, 18.0, 19.0] {
        let g = d.sample(DVec3::new(x, 10.0, 8.0)).unwrap().gradient;
        assert!(g.x > 0.3, "at {x}: {g}");
    }
    let (d, there, least) = way(true, 0.0);
    assert!(there && d.sample(from).unwrap().mm < 30.0 && least < 1.7, "{least}");
    let (d, there, _) = way(false, 2.5);
    assert!(there && d.clearance_mm() < 1.3, "through the slit, as there is no other way");
}

/// Where nothing leads to the body's start, no clearance is kept, and only the target's own piece has a distance.
#[test]
fn a_start_out_of_reach_leaves_the_distance_of_the_targets_piece() {
    let w = walls([60, 11, 11], DVec3::ONE, |p| (p.y - 5.0).hypot(p.z - 5.0) < 4.0 && !(25.0..33.0).contains(&p.x));
    let (target, from) = (DVec3::new(3.0, 5.0, 5.0), DVec3::new(50.0, 5.0, 5.0));
    for clearance_mm in [0.0, 2.0] {
        let body = Some(BodyClearance { from, clearance_mm });
        let d = TargetDistance::to(&w, target, body, &[], &Progress::new()).unwrap();
        assert_eq!(d.clearance_mm(), 0.0);
        assert!((f64::from(d.at([20, 5, 5]).unwrap()) - 17.0).abs() < 1.0);
        assert_eq!(d.at([50, 5, 5]), None);
    }
}

/// Where the front does not arrive, a voxel has the distance of the nearest one that it reached, plus half as much
/// again as the path from there. Of two that are equally near, the one farther along the axis counts.
#[test]
fn what_is_not_reached_continues_the_distance_of_the_nearest_reached_voxel() {
    // A channel too narrow for the body, open around two positions 18 mm apart.
    let w = WallDistance::drawn([30, 3, 3], DVec3::ONE, |p| p.y == 1.0 && p.z == 1.0);
    let open = [DVec3::new(3.0, 1.0, 1.0), DVec3::new(21.0, 1.0, 1.0)];
    let mut march = March::new(&w, 2.0, &open);
    march.ball([3, 1, 1], open[0]);
    march.run(&Progress::new()).unwrap();
    assert_eq!(march.bridge(&[open], &Progress::new()).unwrap(), [open]);
    march.extend(&Progress::new()).unwrap();
    for x in 0..30i64 {
        let n = w.set().number([x, 1, 1]).unwrap();
        let x = x as f64;
        let expected = match x {
            ..=8.0 => (x - 3.0).abs(),
            ..=11.0 => 5.0 + 1.5 * (x - 8.0),
            // Voxel 12 is four voxels from both voxel 8 and voxel 16.
            ..16.0 => 23.0 + 1.5 * (16.0 - x),
            ..=26.0 => 18.0 + (x - 21.0).abs(),
            _ => 23.0 + 1.5 * (x - 26.0),
        };
        assert!((f64::from(march.values[n]) - expected).abs() < 1e-4, "{x}: {}, not {expected}", march.values[n]);
    }
}

/// Every voxel of the lumen counts once, however many there are.
#[test]
fn the_progress_ends_at_the_number_of_voxels() {
    let w = walls([42; 3], DVec3::ONE, |_| true);
    let progress = Progress::new();
    TargetDistance::to(&w, DVec3::ONE, None, &[], &progress).unwrap();
    let (_, done, all) = progress.snapshot();
    assert_eq!((done, all), (42 * 42 * 42, 42 * 42 * 42));
}
