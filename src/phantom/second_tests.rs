use std::f64::consts::TAU;

use super::*;
use crate::checks::cases;
use crate::features::CHANNEL_MM;

/// Settings with all anatomy and residue that a second position has.
fn all(size: Size, seed: u64) -> PhantomSettings {
    PhantomSettings {
        size,
        seed,
        pools: true,
        films: true,
        stool: true,
        bridges: true,
        lesions: true,
        decoys: true,
        ileum: true,
        collapsed: seed.is_multiple_of(2),
        ..PhantomSettings::default()
    }
}

/// Returns second positions of both sizes, one a size in a quick run.
fn seconds(make: impl Fn(Size, u64) -> PhantomSettings) -> impl Iterator<Item = (String, Second)> {
    let all = (1..=cases(12, 1)).flat_map(|seed| [Size::Small, Size::Standard].map(|size| (size, seed)));
    all.map(move |(size, seed)| (format!("{size:?} {seed}"), Phantom::new(&make(size, seed)).second().unwrap()))
}

fn plain(size: Size, seed: u64) -> PhantomSettings {
    PhantomSettings { size, seed, ..PhantomSettings::default() }
}

#[test]
fn a_second_position_is_another_scan_of_a_like_colon() {
    for (name, second) in seconds(plain) {
        let (a, b) = (second.first(), second.phantom());
        assert_eq!(b.settings().position, Position::Prone);
        assert!(has_room(b.axis()), "{name}");
        let longer = b.axis().length() / a.axis().length();
        let off = |i: usize| {
            let s = a.axis().stations()[i];
            a.axis().at(s).distance(b.axis().at(second.along(s)))
        };
        let moved = (0..29).map(off).fold(0.0, f64::max);
        let wider = b.lumen_ml() / a.lumen_ml();
        println!("{name}: {longer:.3} as long, {wider:.3} of the volume, moved by up to {moved:.1} mm");
        assert!((0.9..1.1).contains(&longer) && (0.68..1.32).contains(&wider) && moved > 3.0, "{name}");
        let [[from, to]] = b.collapsed()[..] else { panic!("{name}: one stretch") };
        assert!((25.0..=50.0).contains(&(to - from)) && from > 100.0, "{name}: {from} to {to}");
        assert!(b.wall(b.axis().at(0.5 * (from + to))) > 1.0, "{name}");
    }
}

#[test]
fn points_near_the_wall_map_both_ways() {
    for (name, second) in seconds(all) {
        let (a, b) = (second.first(), second.phantom());
        let mut worst = 0.0f64;
        for n in 0..4000u64 {
            let u = |k| hash::uniform(17, 4 * n + k);
            let s = a.axis().length() * u(0);
            let phi = TAU * u(1);
            let radius = a.shape.caliber(s, phi);
            let frame = a.axis().frame(s);
            let p = frame.at + frame.direction(phi) * (radius + 4.5 * u(2) - 3.0).max(0.1);
            let there = second.to_second(p).unwrap();
            if let Some(back) = second.to_first(there) {
                worst = worst.max(back.distance(p));
            } else {
                panic!("{name}: {p} is lost");
            }
            let q = second.to_second(frame.at).unwrap();
            assert!(q.distance(b.axis().at(second.along(s))) < 1e-6, "{name}: the axis maps to the axis");
        }
        println!("{name}: {worst:.2e} mm");
        assert!(worst < 0.05, "{name}: {worst}");
    }
}

#[test]
fn walls_map_to_walls() {
    for (name, second) in seconds(plain) {
        let (a, b) = (second.first(), second.phantom());
        let points = second.points();
        assert!(points.first.len() == points.second.len() && points.first.len() > 500, "{name}");
        let mut free = 0;
        for (p, q) in points.first.iter().zip(&points.second) {
            // Where the lumen is closed, and beside it, the plain wall's distance includes the tissue of the closed walls.
            let tapers = b.shape.collapsed.iter().any(|c| c.concerns(b.nearest(*q).unwrap().s));
            let off = if tapers { 0.0 } else { b.plain_wall(*q) };
            assert!(a.plain_wall(*p).abs() < 0.05 && off.abs() < 0.05, "{name}: {p} to {q}, {off}");
            let mapped = second.to_second(*p).unwrap();
            assert!(mapped.distance(*q) < 1e-6, "{name}: {p} to {q}, not {mapped}");
            // Away from folds in one position, the wall itself is there in the other, too.
            if a.wall(*p).abs() < 1e-3 && b.wall(*q).abs() < 0.05 {
                free += 1;
            }
        }
        assert!(3 * free > points.first.len(), "{name}: {free} of {}", points.first.len());
    }
}

#[test]
#[ignore = "slow: the heights of all polyps in two positions"]
fn polyps_stay_on_the_wall_and_keep_their_size() {
    let (mut all, mut alike) = (0, 0);
    for (name, second) in seconds(self::all) {
        let (a, b) = (second.first().measured_polyps(), second.phantom().measured_polyps());
        assert!(a.len() == b.len() && !a.is_empty(), "{name}");
        let closed = &second.phantom().shape.collapsed;
        let s_of = |polyp: &TruePolyp| second.first().nearest(polyp.position).unwrap().s;
        for (a, b) in a.iter().zip(&b) {
            assert_eq!((a.diameter_mm, a.shape, a.site), (b.diameter_mm, b.shape, b.site), "{name}");
            let s = second.phantom().nearest(b.position).unwrap().s;
            let in_closed = closed.iter().any(|c| c.concerns(s));
            let off = second.to_second(a.position).unwrap().distance(b.position);
            let heights = [a.height_mm.unwrap(), b.height_mm.unwrap()];
            if in_closed {
                continue;
            }
            assert!(second.phantom().wall(b.position) > 0.3, "{name}: {b:?} is tissue");
            let change = (heights[0] - heights[1]).abs();
            println!("{name}: {:?} {:?} {:.1} mm, off {off:.2}, higher by {change:.2}", a.shape, a.site, a.diameter_mm);
            // A stalked one's height is that above a wall which is bent otherwise.
            if a.shape != PolypShape::Stalked {
                // It is rigid, and what it grows on is stretched: the folds beside it are nearer or farther, and it is less or more high above
                // what lies between them.
                let stretch = (second.along(s_of(a) + 1.0) - second.along(s_of(a) - 1.0)) / 2.0 - 1.0;
                assert!(
                    off < 1.0 + stretch.abs() * a.diameter_mm && change < 1.2 + stretch.abs() * heights[0],
                    "{name}: off {off}, {heights:?} {a:?}"
                );
                (all, alike) = (all + 1, alike + usize::from(change < 0.3));
            }
        }
    }
    assert!(10 * alike > 9 * all, "{alike} of {all} are as high as before within 0.3 mm");
}

#[test]
fn a_flight_has_room_in_the_second_position() {
    for (name, second) in seconds(plain) {
        let b = second.phantom();
        let closed = &b.shape.collapsed;
        let mut s = 0.0;
        while s <= b.axis().length() {
            let frame = b.axis().frame(s);
            let is_open = closed.iter().all(|c| !c.concerns(s));
            for k in 0..12 {
                let p = frame.at + frame.direction(f64::from(k) * TAU / 12.0) * (CHANNEL_MM - 2.2);
                assert!(!is_open || b.wall(p) < 0.0, "{name}: {s} mm, {k}: {}", b.wall(p));
            }
            s += 2.3;
        }
    }
}

#[test]
fn a_colon_with_limbs_that_touch_has_no_second_position() {
    let settings = PhantomSettings { touching: true, ..plain(Size::Small, 1) };
    let error = Phantom::new(&settings).second().unwrap_err();
    assert_eq!((error.kind, &*error.what), (error::Kind::Usage, "--second"));
}

#[test]
#[ignore = "slow: small bowel, stomach and lesions of colons in two positions"]
fn small_bowel_and_stomach_have_room_beside_the_second_colon() {
    for size in [Size::Small, Size::Standard] {
        for seed in 1..=cases(20, 3) {
            let gas = PhantomSettings::with_all_gas(size, seed, Position::Left);
            let second = Phantom::new(&PhantomSettings { lesions: true, decoys: true, ..gas }).second().unwrap();
            let b = second.phantom();
            let (own, valve) = (b.valve.unwrap(), b.valve().unwrap());
            let room = gut_placing::room(&b.guts, &b.shape, size.scale(), Some(&own));
            println!("{size:?} {seed}: {room:.1} mm");
            assert!(room > 3.0, "{size:?} {seed}: {room} mm");
            assert_eq!(b.settings().position, Position::Right);
            assert_eq!((valve.open, second.first().valve().unwrap().open), (seed % 2 == 1, seed % 2 == 1));
            let mouth = b.content_at(valve.position + valve.direction * 2.0);
            assert_eq!(mouth == Content::SmallBowel, valve.open, "{size:?} {seed}: {mouth:?}");
        }
    }
}
