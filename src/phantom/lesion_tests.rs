use std::f64::consts::PI;

use super::ground::{APART_MM, Ground};
use super::solid::{Ellipsoid, Rod};
use super::*;
use crate::checks::cases;
use crate::lesions::Lesion;

fn with_lesions(size: Size, seed: u64, pools: bool) -> Phantom {
    let settings = PhantomSettings { size, seed, pools, lesions: true, noise: false, ..PhantomSettings::default() };
    Phantom::new(&settings)
}

#[test]
#[ignore = "slow: shares among the lesions of ten phantoms"]
fn shapes_sites_and_sizes_have_their_shares() {
    let (mut shapes, mut sites, mut sizes, mut all) = ([0; 3], [0; 3], [0; 3], 0);
    for seed in 1..=10 {
        let start = std::time::Instant::now();
        let polyps =
            Phantom::new(&PhantomSettings { seed, polyps: false, lesions: true, ..PhantomSettings::default() })
                .polyps();
        println!("seed {seed}: {} lesions, {:?}", polyps.len(), start.elapsed());
        for p in &polyps {
            shapes[p.shape as usize] += 1;
            sites[p.site as usize] += 1;
            sizes[if p.diameter_mm < 6.0 { 0 } else { 1 + usize::from(p.diameter_mm >= 10.0) }] += 1;
            let least = [3.0, 5.0, 6.0][p.shape as usize];
            assert!((least..=20.0).contains(&p.diameter_mm), "{p:?}");
        }
        assert!((14..=22).contains(&polyps.len()), "{}", polyps.len());
        all += polyps.len();
    }
    println!("{shapes:?} {sites:?} {sizes:?} of {all}");
    for (counts, shares) in [(shapes, [0.45, 0.3, 0.25]), (sites, [0.4, 0.3, 0.3]), (sizes, [0.3, 0.4, 0.3])] {
        for (n, share) in counts.into_iter().zip(shares) {
            assert!((f64::from(n) / all as f64 - share).abs() < 0.08, "{n} of {all} is not {share}");
        }
    }
}

#[test]
fn lesions_are_apart_and_leave_a_way() {
    for seed in 1..=cases(4, 1) {
        let phantom = with_lesions(Size::Small, seed, true);
        let lesions = &phantom.shape.lesions;
        println!("{seed}: {} lesions", lesions.len());
        assert!(lesions.len() >= 7, "{}", lesions.len());
        for (i, a) in lesions.iter().enumerate() {
            for b in &lesions[i + 1..] {
                let (p, q) = (&a.what.head, &b.what.head);
                let gap = p.points(200).map(|at| -q.surface(at).d).fold(f64::INFINITY, f64::min);
                assert!(gap >= APART_MM, "{gap}");
            }
        }
        let axis = phantom.axis();
        for s in 0..axis.length() as usize {
            let frame = axis.frame(s as f64);
            for k in 0..8 {
                let p = frame.at + frame.direction(f64::from(k) * PI / 4.0) * 4.0;
                assert!(phantom.wall(p) < 0.0, "{seed}, {s}: {}", phantom.wall(p));
            }
        }
    }
}

#[test]
fn the_surface_is_as_far_from_the_centre_as_the_diameter_says() {
    for seed in 1..=cases(3, 1) {
        let phantom = with_lesions(Size::Standard, seed, false);
        for lesion in &phantom.shape.lesions {
            let Lesion { shape, head, .. } = lesion.what;
            let up = head.axes.z_axis;
            if shape == PolypShape::Flat {
                assert!((1.3..2.9).contains(&head.radii.z));
                let mut bare = phantom.shape.clone();
                bare.lesions.clear();
                let (with, bare) = (Ground::new(&phantom.shape), Ground::new(&bare));
                let at = |i: i32| head.centre + up * (0.01 * f64::from(i));
                let top = (0..500).map(at).find(|p| with.surface(*p, lesion.s).unwrap().d < 0.0).unwrap();
                let high = -bare.surface(top, lesion.s).unwrap().d;
                // A fold's own distance is less exact in its fillet.
                let off = if lesion.what.site == PolypSite::Wall { 0.1 } else { 0.3 };
                assert!((high - head.radii.z).abs() < off, "{high}: {lesion:?}");
                continue;
            }
            let base = Ground::new(&phantom.shape);
            for along in [up, (up + head.axes.x_axis).normalize(), (up - head.axes.y_axis).normalize()] {
                let own = 1.0 / ((head.axes.transpose() * along) / head.radii).length();
                let mut t = 0.0;
                while base.surface(head.centre + along * t, lesion.s).unwrap().d > 0.0 && t < 15.0 {
                    t += 0.01;
                }
                assert!((t - own).abs() < 0.1, "{t}, not {own}: {lesion:?}");
            }
        }
    }
}

#[test]
#[ignore = "slow: a standard phantom with every lesion measured"]
fn truth_has_heights_and_volumes() {
    let phantom = with_lesions(Size::Standard, 1, true);
    let start = std::time::Instant::now();
    let polyps = phantom.measured_polyps();
    println!("{:?}", start.elapsed());
    for p in &polyps {
        let (h, v) = (p.height_mm.unwrap(), p.volume_mm3.unwrap());
        println!(
            "{:?} {:?} {:.1} mm, {h:.1} mm high, {v:.0} mm³, {} at {}",
            p.shape, p.site, p.diameter_mm, p.submerged, p.position
        );
        assert!(h < p.diameter_mm + 9.0 && h > 1.0 && h < 30.0 && v > 3.0 && v < 6000.0);
        if p.shape == PolypShape::Flat {
            assert!(h < 3.0);
        }
    }
    let under = polyps.iter().filter(|p| p.submerged && p.shape != PolypShape::Flat).count();
    assert!(under >= 3, "{under}");
}

/// A colon so large that its wall is flat about a place: the place, its normal into the lumen, and the arc length.
fn flat_wall() -> (Shape, DVec3, DVec3, f64) {
    let axis = Centerline::new(12.0, |_| 240.0, 0.0, 1);
    let end = axis.length();
    let rows = [0, 1, 2].map(|_| vec![0.0, end]);
    let (folds, polyps, bridges, lesions) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let shape = Shape {
        axis,
        taenia: 0.0,
        twist: None,
        rows,
        folds,
        polyps,
        bridges,
        lesions,
        decoys: Vec::new(),
        collapsed: Vec::new(),
        touching: Vec::new(),
    };
    let (at, up, s) = {
        let spot = Ground::new(&shape).spot(0.4 * end, PI / 3.0).unwrap();
        (spot.at, spot.up, spot.s)
    };
    (shape, at, up, s)
}

fn axes(up: DVec3) -> DMat3 {
    let (x, y) = up.any_orthonormal_pair();
    DMat3::from_cols(x, y, up)
}

#[test]
fn a_balls_volume_is_that_of_a_segment() {
    let (bare, root, up, s) = flat_wall();
    for (radius, lift) in [(4.0, 0.35), (5.0, 0.2)] {
        let head = Ellipsoid::ball(root + up * (lift * radius), radius);
        let stem = Some(Rod { from: head.centre, to: root - up, radius: 0.7 * radius });
        let (shape, site) = (PolypShape::Sessile, PolypSite::Wall);
        let mut grown = bare.clone();
        grown.lesions.push(Attached { s, what: Lesion { shape, site, head, stem, root } });
        let volume = growth::volume_mm3(&Ground::new(&grown), &Ground::new(&bare), s, head.centre, radius + 1.0);
        let h = (1.0 + lift) * radius;
        let segment = PI * h * h * (3.0 * radius - h) / 3.0;
        assert!((volume / segment - 1.0).abs() < 0.03, "{volume} mm³, not {segment}");
    }
}

#[test]
fn the_distance_to_a_lesion_is_one() {
    let (mut wall, root, up, s) = flat_wall();
    let tilted = (up + 0.6 * up.any_orthonormal_vector()).normalize();
    let stalk = Rod { from: root - tilted * 2.0, to: root + tilted * 10.0, radius: 1.5 };
    let stalked = Lesion {
        shape: PolypShape::Stalked,
        site: PolypSite::Wall,
        head: Ellipsoid { centre: stalk.to, axes: axes(tilted), radii: DVec3::new(4.0, 3.7, 3.8) },
        stem: Some(stalk),
        root,
    };
    let head = Ellipsoid { centre: root, axes: axes(up), radii: DVec3::new(6.0, 5.0, 2.0) };
    let flat = Lesion { shape: PolypShape::Flat, site: PolypSite::Wall, head, stem: None, root };
    for lesion in [stalked, flat] {
        wall.lesions = vec![Attached { s, what: lesion }];
        let ground = Ground::new(&wall);
        let d = |p: DVec3| ground.surface(p, s).unwrap().d;
        let (mut lengths, h) = (Vec::new(), 1e-4);
        for n in 0..20_000u64 {
            let u = |k| 2.0 * hash::uniform(17, 4 * n + k) - 1.0;
            let p = root + up * 7.0 + DVec3::new(u(0), u(1), u(2)) * 13.0;
            // Beside the lesion there is only wall; far inside it there is a middle, where a distance has a crease.
            if d(p).abs() > 1.5 || (p - root).dot(up) < 0.2 {
                continue;
            }
            let by = |a: DVec3| (d(p + a * h) - d(p - a * h)) / (2.0 * h);
            lengths.push(DVec3::new(by(DVec3::X), by(DVec3::Y), by(DVec3::Z)).length());
        }
        lengths.sort_by(f64::total_cmp);
        let off = lengths.iter().filter(|l| (**l - 1.0).abs() > 0.1).count();
        println!("{:?}: {off} of {} off, {:?} to {:?}", lesion.shape, lengths.len(), lengths.first(), lengths.last());
        assert!(lengths.len() > 300 && off * 20 < lengths.len(), "{off} of {}", lengths.len());
    }
}

#[test]
fn a_polyp_needs_no_more_than_its_place_and_size() {
    let polyp: TruePolyp = serde_json::from_str(r#"{"position": [1.0, 2.0, 3.0], "diameter_mm": 7.0}"#).unwrap();
    assert_eq!(polyp, TruePolyp { position: DVec3::new(1.0, 2.0, 3.0), diameter_mm: 7.0, ..TruePolyp::default() });
    let stalked = TruePolyp { shape: PolypShape::Stalked, site: PolypSite::Between, submerged: true, ..polyp };
    let json = serde_json::to_value(stalked).unwrap();
    assert_eq!(
        (&json["shape"], &json["site"], &json["submerged"]),
        (&"stalked".into(), &"between".into(), &true.into())
    );
    assert!(json.get("height_mm").is_none());
    assert_eq!(serde_json::from_value::<TruePolyp>(json).unwrap(), stalked);
}

#[test]
#[ignore = "slow: two phantoms with every lesion and decoy"]
fn every_lesion_and_decoy_is_in_the_voxels() {
    let settings = PhantomSettings { size: Size::Small, lesions: true, noise: false, ..PhantomSettings::default() };
    let with = Phantom::new(&PhantomSettings { decoys: true, ..settings });
    let bare = Phantom::new(&PhantomSettings { lesions: false, ..settings });
    let grid = with.grid();
    let (a, b) = (with.voxelise(&grid, &Progress::new()).unwrap(), bare.voxelise(&grid, &Progress::new()).unwrap());
    let [nx, ny, nz] = grid.dims();
    let changed = |at: DVec3, reach: f64| {
        let cells = (0..nx * ny * nz).filter(|&n| (a.data()[n] - b.data()[n]).abs() > 200);
        cells
            .filter(|n| {
                let p = grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64));
                p.distance(at) < reach
            })
            .count()
    };
    for p in with.polyps().iter().filter(|p| !bare.polyps().contains(p)) {
        assert!(changed(p.position, 0.5 * p.diameter_mm + 1.0) >= 8, "{p:?}");
    }
    for d in with.decoys() {
        assert!(changed(d.position, 0.5 * d.diameter_mm + 1.0) >= 20, "{d:?}");
    }
}
