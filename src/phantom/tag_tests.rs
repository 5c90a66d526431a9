use super::*;
use crate::profile::GAS;
use crate::progress::Progress;
use crate::{Phantom, PhantomSettings, Scanner, Size};

const TAGGED: PhantomSettings = PhantomSettings {
    size: Size::Small,
    folds: true,
    polyps: true,
    fluid: false,
    pools: true,
    films: true,
    stool: true,
    inhomogeneous: false,
    pseudo: false,
    position: Position::Supine,
    bridges: false,
    lesions: false,
    decoys: false,
    ileum: false,
    stomach: false,
    lungs: false,
    collapsed: false,
    pelvis: false,
    touching: false,
    touching_mm: None,
    noise: false,
    seed: 1,
};

fn phantom(settings: PhantomSettings) -> Phantom {
    Phantom::new(&settings)
}

fn tag(phantom: &Phantom) -> &Tag {
    phantom.tag.as_ref().unwrap()
}

/// Nodes and weights of the trapezoid rule for the mean over a standard normal variable; exact far beyond what is asked.
fn normal_nodes() -> Vec<(f64, f64)> {
    let nodes = (-16..=16).map(|n| f64::from(n) / 4.0);
    nodes.map(|x| (x, 0.25 * (-0.5 * x * x).exp() / TAU.sqrt())).collect()
}

/// Where a level meets the wall, the value is that of the sharp materials blurred in three dimensions.
#[test]
fn the_rim_of_a_level_is_what_a_scanner_makes_of_it() {
    let p = phantom(PhantomSettings { films: false, stool: false, folds: false, polyps: false, ..TAGGED });
    let (pool, hu) = tag(&p).pools[0];
    let (sigma, runs) = (p.sigma, [p.all_knots()]);
    let sharp = |at: DVec3| {
        let (d, s) = p.distances_among(at, &runs);
        let fluid = (pool.from..=pool.to).contains(&s) && at.y > pool.level;
        if d.wall + SHIFT * sigma > 0.0 {
            TISSUE
        } else if fluid {
            hu
        } else {
            GAS
        }
    };
    let nodes = normal_nodes();
    let (mut count, mut worst, mut total) = (0, 0.0f64, 0.0);
    for i in 0..400u64 {
        let s = mix(pool.from, pool.to, 0.3 + 0.4 * hash::uniform(7, i));
        let frame = p.axis().frame(s);
        let phi = TAU * hash::uniform(8, i);
        let at = frame.at + frame.direction(phi) * p.shape.radius(s, phi);
        let u = |k| 0.8 * (hash::uniform(9, 3 * i + k) - 0.5);
        let at = at + DVec3::new(u(0), u(1), u(2));
        if (at.y - pool.level).abs() > 0.8 || p.wall(at).abs() > 0.8 {
            continue;
        }
        let mut sum = 0.0;
        for (x, wx) in &nodes {
            for (y, wy) in &nodes {
                for (z, wz) in &nodes {
                    sum += wx * wy * wz * sharp(at + DVec3::new(*x, *y, *z) * sigma);
                }
            }
        }
        let got = p.value(at);
        worst = worst.max((got - sum).abs());
        total += (got - sum).abs();
        count += 1;
    }
    let mean = total / f64::from(count);
    println!("{count} places at the rim: {mean:.1} HU off in the mean, at most {worst:.1}, of {}", hu - GAS);
    // The wall is curved, and its distance is correct to first order.
    assert!(count >= 8 && mean < 20.0 && worst < 60.0, "{count} places, {mean} HU, {worst} HU");
}

/// A sheet of tissue in fluid: the minimum is F + (T − F)·erf(d / 2√2σ) in its middle.
#[test]
fn a_thin_fold_under_fluid_is_as_faint_as_a_scanner_makes_it() {
    let erf = |x: f64| 2.0 * normal_cdf(x * 2f64.sqrt()) - 1.0;
    for blur in [0.4, 0.5, 0.7] {
        let settings = PhantomSettings { films: false, stool: false, folds: false, polyps: false, ..TAGGED };
        let p = Phantom::scanned(&settings, Scanner { blur_mm: Some(blur), tag_hu: Some(600.0), ..Scanner::default() });
        let want = 600.0 + (TISSUE - 600.0) * erf(2.0 / (2.0 * 2f64.sqrt() * blur));
        assert!(!p.shape.folds.is_empty());
        let mut found = 0;
        for fold in p.shape.folds.iter().filter(|f| f.sheet) {
            let frame = p.axis().frame(fold.s);
            // Half way up, where neither the root nor the edge is near.
            let rho = p.shape.radius(fold.s, fold.phi) - 0.5 * fold.depth;
            let least =
                (-30..=30).map(|i| frame.at + frame.tangent * (0.1 * f64::from(i)) + frame.direction(fold.phi) * rho);
            let value = least.map(|at| p.value(at)).fold(f64::INFINITY, f64::min);
            if fold.depth > 4.5 {
                found += 1;
                assert!((value - want).abs() < 25.0, "blur {blur}: {value}, not {want}");
            }
        }
        assert!(found > 0);
    }
}

#[test]
#[ignore = "slow: two phantoms with tag"]
fn the_twin_is_the_same_colon_without_tag() {
    let p = phantom(TAGGED);
    let twin = p.twin();
    let (mut with, without) = (p.truth(), twin.truth());
    assert!(with.polyps.iter().any(|p| p.submerged) && without.polyps.iter().all(|p| !p.submerged));
    with.polyps.iter_mut().for_each(|p| p.submerged = false);
    assert_eq!(with, without);
    assert!(with.polyps.len() > 6, "some of them under fluid");
    let grid = p.grid();
    let (a, b) = (p.voxelise(&grid, &Progress::new()).unwrap(), twin.voxelise(&grid, &Progress::new()).unwrap());
    let changed = a.data().iter().zip(b.data()).filter(|(a, b)| a != b).count();
    let share = changed as f64 / a.data().len() as f64;
    assert!((0.002..0.05).contains(&share), "{share}");
    // Tag only makes brighter.
    assert!(a.data().iter().zip(b.data()).all(|(a, b)| a >= b));
    assert!(b.data().iter().all(|&v| v < 440), "no tag is left, only bone");
}

#[test]
fn each_part_is_there_only_if_asked_for() {
    let none = PhantomSettings { pools: false, films: false, stool: false, ..TAGGED };
    assert!(phantom(none).tag.is_none());
    for (settings, parts) in [
        (PhantomSettings { pools: true, ..none }, [true, false, false]),
        (PhantomSettings { films: true, ..none }, [false, true, false]),
        (PhantomSettings { stool: true, ..none }, [false, false, true]),
        (PhantomSettings { films: true, fluid: true, ..none }, [true, true, false]),
    ] {
        let p = phantom(settings);
        let tag = tag(&p);
        assert_eq!([!tag.pools.is_empty(), !tag.films.is_empty(), !tag.stool.is_empty()], parts);
    }
}

/// Fluid lies on the side that is down, below its level.
#[test]
fn levels_are_normal_to_gravity_in_each_position() {
    for position in [Position::Supine, Position::Prone, Position::Left, Position::Right] {
        let p = phantom(PhantomSettings { position, films: false, stool: false, ..TAGGED });
        let pools = &tag(&p).pools;
        assert!(pools.len() > 1, "{position:?}");
        let mut deep = 0;
        for (pool, hu) in pools {
            for i in 0..50 {
                let s = mix(pool.from, pool.to, f64::from(i) / 49.0);
                let frame = p.axis().frame(s);
                let down = frame.direction(frame.angle(position.down()));
                for away in [-0.6, -0.3, 0.0, 0.3, 0.6] {
                    let at = frame.at + down * (away * p.shape.radius(s, frame.angle(position.down())));
                    let below = at.dot(position.down()) - pool.level;
                    if p.wall(at) > -3.0 || below.abs() < 3.0 {
                        continue;
                    }
                    deep += usize::from(below > 0.0);
                    let want = if below > 0.0 { *hu } else { GAS };
                    assert!((p.value(at) - want).abs() < 1.0, "{position:?}: {} at {below} mm", p.value(at));
                }
            }
        }
        assert!(deep > 20, "{position:?}: {deep}");
    }
}

/// A film is tag between tissue and gas, as thick as it says.
#[test]
fn films_lie_on_the_wall() {
    let p = phantom(PhantomSettings { pools: false, stool: false, folds: false, polyps: false, ..TAGGED });
    let mut seen = 0;
    for &Film { s, centre, thickness_mm: thickness, .. } in &tag(&p).films {
        let frame = p.axis().frame(s);
        let inwards = (frame.at - centre).normalize_or_zero();
        // The integral of the share of tag across the film is its thickness.
        let mut sum = 0.0;
        for i in -200..=400 {
            let at = centre + inwards * (0.02 * f64::from(i));
            let (d, s) = p.distances_among(at, &[p.all_knots()]);
            let content = tag(&p).seen(at, s, &d, p.sigma).tag;
            sum += 0.02 * content * (1.0 - super::super::profile::tissue_share(d.wall, p.sigma));
        }
        // Its neighbours may overlap, and the wall slopes.
        if (sum / thickness - 1.0).abs() < 0.1 {
            seen += 1;
        }
    }
    assert!(seen * 10 >= tag(&p).films.len() * 6, "{seen} of {}", tag(&p).films.len());
}

#[test]
fn stool_clings_and_holds_bubbles() {
    let p = phantom(PhantomSettings { pools: false, films: false, ..TAGGED });
    for lump in &tag(&p).stool {
        let value = |at: DVec3| p.value(at);
        assert!(p.wall(lump.centre) > -6.0, "at the wall: {}", p.wall(lump.centre));
        let most = lump.balls.iter().map(|b| value(b.0)).fold(f64::NEG_INFINITY, f64::max);
        assert!(most > 200.0, "{most}");
        let least = lump.bubbles.iter().map(|b| value(b.0)).fold(f64::INFINITY, f64::min);
        assert!(least < 0.0, "{least}");
    }
}

#[test]
fn inhomogeneous_tag_varies_within_its_range() {
    let p = phantom(PhantomSettings { inhomogeneous: true, ..TAGGED });
    let values: Vec<f64> = tag(&p).pools.iter().map(|p| p.1).collect();
    assert!(values.iter().any(|v| (v - values[0]).abs() > 50.0), "{values:?}");
    let volume = p.voxelise(&p.grid(), &Progress::new()).unwrap();
    let most = volume.data().iter().max().unwrap();
    assert!((600..=1200).contains(most), "{most}");
}

/// Tissue in and beside tag gains up to 139 HU, and dry tissue nothing.
#[test]
fn pseudo_enhancement_is_beside_tag_only() {
    let plain = phantom(PhantomSettings { films: false, stool: false, ..TAGGED });
    let pseudo = phantom(PhantomSettings { films: false, stool: false, pseudo: true, ..TAGGED });
    let (mut gains, mut dry) = (Vec::new(), 0);
    for (pool, _) in &tag(&plain).pools {
        for i in 0..200u64 {
            let s = mix(pool.from, pool.to, hash::uniform(3, i));
            let (frame, phi) = (plain.axis().frame(s), TAU * hash::uniform(4, i));
            let at = frame.at + frame.direction(phi) * (plain.shape.radius(s, phi) + 1.5);
            let gain = pseudo.value(at) - plain.value(at);
            let below = at.y - pool.level;
            assert!((-1e-9..STRENGTH * (FLUID - TISSUE) + 5.0).contains(&gain), "{gain}");
            if below > 6.0 {
                gains.push(gain);
            } else if below < -14.0 {
                dry += 1;
                assert!(gain < 1.0, "{gain} HU {below} mm above the level");
            }
        }
    }
    let mean = gains.iter().sum::<f64>() / gains.len() as f64;
    assert!(gains.len() > 20 && dry > 20 && (8.0..40.0).contains(&mean), "{mean} of {}, {dry}", gains.len());
}

/// What is beside a place follows from what was put there.
#[test]
fn the_wall_knows_what_is_beside_it() {
    let p = phantom(TAGGED);
    let at_wall = |s: f64, phi: f64| {
        let frame = p.axis().frame(s);
        let mut at = frame.at + frame.direction(phi) * p.shape.radius(s, phi);
        for _ in 0..4 {
            let (d, _) = p.distances_among(at, &[p.all_knots()]);
            at -= d.normal * d.wall;
        }
        at
    };
    let mut seen = std::collections::BTreeMap::new();
    for n in 0..3000u64 {
        let at = at_wall(p.axis().length() * hash::uniform(1, n), TAU * hash::uniform(2, n));
        let Some(wall) = p.wall_at(at).filter(|w| w.mm.abs() < 0.01) else { continue };
        *seen.entry(wall.beside).or_insert(0) += 1;
        let (d, s) = p.distances_among(at, &[p.all_knots()]);
        let content = tag(&p)
            .seen(at - d.normal * 1.5, s, &p.distances_among(at - d.normal * 1.5, &[p.all_knots()]).0, p.sigma)
            .tag;
        match wall.beside {
            Beside::Gas => {
                assert!(content < 0.01, "{content}");
                // Nor is there any tag around it.
                for side in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z] {
                    let near = at - d.normal * 1.5 + side * 2.0;
                    assert!(p.wall(near) > -1.0 || p.value(near) < -800.0, "{}", p.value(near));
                }
            }
            Beside::Fluid => assert!(content > 0.3 || p.wall(at - d.normal * 1.5) > -1.0, "{content}"),
            _ => {}
        }
    }
    for (beside, least) in [
        (Beside::Gas, 800),
        (Beside::Near, 100),
        (Beside::Rim, 30),
        (Beside::Fluid, 100),
        (Beside::Film, 30),
        (Beside::Stool, 3),
    ] {
        assert!(seen.get(&beside).is_some_and(|&n| n >= least), "{beside:?}: {seen:?}");
    }
    for lump in &tag(&p).stool {
        let frame = p.axis().frame(lump.s);
        let at = at_wall(lump.s, frame.angle(lump.centre - frame.at));
        assert_eq!(p.wall_at(at).unwrap().beside, Beside::Stool, "behind the middle of a lump");
    }
    assert!(p.wall_at(DVec3::splat(1e4)).is_none());
}

/// Films and lumps are spread from end to end.
#[test]
fn tag_is_spread_over_the_colon() {
    let p = phantom(TAGGED);
    let end = p.axis().length();
    let places =
        |s: Vec<f64>| (s.iter().copied().fold(f64::INFINITY, f64::min), s.iter().copied().fold(0.0, f64::max), s.len());
    let films = places(tag(&p).films.iter().map(|f| f.s).collect());
    let stool = places(tag(&p).stool.iter().map(|l| l.s).collect());
    assert!(films.0 < 0.12 * end && films.1 > 0.88 * end && films.2 >= 12, "{films:?}");
    assert!(stool.0 < 0.25 * end && stool.1 > 0.75 * end && stool.1 < end && stool.2 >= 5, "{stool:?}");
}

/// It is looked for at 21 places of the middle four fifths of a pool.
#[test]
fn a_thin_fold_stands_where_its_pool_is_deepest() {
    for seed in [1, 2] {
        let p = phantom(PhantomSettings { films: false, stool: false, seed, ..TAGGED });
        for (pool, _) in &tag(&p).pools {
            let deep = |s: f64| p.axis().frame(s).at.y + p.axis().profile(s).radius.0 - pool.level;
            let own = p.shape.folds.iter().filter(|f| f.sheet && (pool.from..=pool.to).contains(&f.s));
            let places: Vec<f64> = own.map(|f| f.s).collect();
            let [fold] = places[..] else { panic!("{places:?} in {pool:?}") };
            for i in 0..=20 {
                let s = mix(pool.from, pool.to, 0.1 + 0.04 * f64::from(i));
                assert!(deep(fold) >= deep(s) - 1e-9, "seed {seed}: {} mm at {fold}, {} at {s}", deep(fold), deep(s));
            }
        }
    }
}

/// A film of 10 mm is too thin to count near its edge. Tag is near up to 5 mm beyond the edge.
#[test]
fn the_wall_around_a_film_is_near_tag() {
    let film = Film { s: 100.0, centre: DVec3::ZERO, radius_mm: 10.0, thickness_mm: 1.0, hu: FLUID };
    let films = vec![film];
    let tag = Tag { down: DVec3::Y, pools: Vec::new(), films, stool: Vec::new(), inhomogeneous: None, pseudo: false };
    let d = Distances { wall: 0.0, plain: 0.0, normal: DVec3::Y, thickness: f64::INFINITY };
    for (mm, beside) in [
        (0.0, Beside::Film),
        (5.0, Beside::Film),
        (9.5, Beside::Near),
        (12.0, Beside::Near),
        (14.9, Beside::Near),
        (15.1, Beside::Gas),
    ] {
        assert_eq!(tag.beside(DVec3::X * mm, 100.0, &d), beside, "{mm} mm from the middle");
    }
}

#[test]
fn a_lump_grows_towards_its_balls_and_away_from_its_bubbles() {
    let (balls, bubbles) = (vec![(DVec3::ZERO, 5.0)], vec![(2.0 * DVec3::X, 1.0)]);
    let lump = Stool { s: 0.0, centre: DVec3::ZERO, reach_mm: 5.0, balls, bubbles, hu: FLUID };
    for (at, inside, grows) in [
        (4.0 * DVec3::Y, 1.0, DVec3::NEG_Y),
        (7.0 * DVec3::Z, -2.0, DVec3::NEG_Z),
        // Between the bubble's surface and that of the ball, nearer to the bubble's.
        (3.4 * DVec3::X, 0.4, DVec3::X),
    ] {
        let body = lump.body(at);
        assert!((body.inside - inside).abs() < 1e-9, "{at}: {} mm", body.inside);
        assert!((body.grows - grows).length() < 1e-9, "{at}: {}", body.grows);
    }
}

#[test]
fn patches_vary_by_a_fifth_about_one() {
    let at = |n: u64| 400.0 * DVec3::new(hash::uniform(1, n), hash::uniform(2, n), hash::uniform(3, n));
    let factors: Vec<f64> = (0..2000).map(|n| patchy(7, at(n))).collect();
    let (least, most) = factors.iter().fold((f64::INFINITY, 0.0f64), |(l, m), f| (l.min(*f), m.max(*f)));
    let mean = factors.iter().sum::<f64>() / factors.len() as f64;
    assert!((mean - 1.0).abs() < 0.02, "{mean}");
    assert!((0.8..0.9).contains(&least) && (1.1..1.2).contains(&most), "{least} to {most}");
}
