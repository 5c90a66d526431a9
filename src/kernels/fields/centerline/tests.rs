use proptest::prelude::*;

use super::polyline::{is_free, resampled, tightened};
use super::*;
use crate::math::hash::uniform;

const METHODS: [CenterlineMethod; 4] =
    [CenterlineMethod::PenalisedPath, CenterlineMethod::PeelOnion, CenterlineMethod::Roadmap, CenterlineMethod::Cells];

/// Checks the invariants of every line without a guess.
fn holds_together(walls: &WallDistance, line: &Centerline) {
    assert_eq!(line.points.len(), line.radius_mm.len());
    assert!(line.points.windows(2).all(|w| is_free(walls, w[0], w[1])), "a line leaves the lumen");
    assert!(line.points.iter().all(|&p| walls.is_inside(walls.voxel(p))));
    let length: f64 = line.points.windows(2).map(|w| w[0].distance(w[1])).sum();
    assert!((length - line.length_mm).abs() < 1e-9 * (1.0 + length));
    assert!(line.radius_mm.iter().all(|r| r.is_finite() && *r >= 0.0) && line.guessed.is_empty());
}

fn off(p: DVec3, line: &[DVec3]) -> f64 {
    let part = |w: &[DVec3]| {
        let way = w[1] - w[0];
        p.distance(w[0] + way * ((p - w[0]).dot(way) / way.length_squared()).clamp(0.0, 1.0))
    };
    line.windows(2).map(part).fold(f64::INFINITY, f64::min)
}

/// Every method finds the axis of a straight tube, from the centre of one end's ball to the other's.
#[test]
fn a_tube_has_its_axis() {
    let (a, b) = (DVec3::new(12.0, 13.0, 12.0), DVec3::new(60.0, 33.0, 40.0));
    for spacing in [DVec3::ONE, DVec3::new(0.7, 0.9, 1.4)] {
        let dims = [74.0, 48.0, 54.0];
        let walls =
            WallDistance::drawn([0, 1, 2].map(|n| (dims[n] / spacing[n]) as usize), spacing, |p| off(p, &[a, b]) < 9.0);
        let ends = far_ends(&walls, &Progress::new()).unwrap();
        for (method, most) in METHODS.into_iter().zip([0.6, 1.2, 2.5, 4.0]) {
            let line = by(method, &walls, End::Tip(ends[0]), End::Tip(ends[1]), &[], &Progress::new()).unwrap();
            holds_together(&walls, &line);
            let errors: Vec<f64> = line.points.iter().map(|&p| off(p, &[a, b])).collect();
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            assert!(mean < most, "{method:?}, {spacing}: {mean} mm");
            assert!(line.points[0].distance(a) < 3.5 && line.points.last().unwrap().distance(b) < 3.5, "{method:?}");
        }
    }
}

/// Two limbs of a hairpin share a wall of one voxel, or touch along an edge or at a corner: the line goes around.
#[test]
fn touching_loops_are_not_cut() {
    let hairpin = |p: DVec3, wall: &dyn Fn(DVec3) -> bool| {
        let limbs = p.x >= 1.0 && p.x <= 60.0 && (p.z - 6.0).abs() <= 4.0 && p.y >= 1.0 && p.y <= 17.0;
        limbs && (!wall(p) || p.x > 53.0)
    };
    let one_voxel = |p: DVec3| p.y == 9.0;
    // A staircase between the limbs whose steps touch only in edges.
    let edges = |p: DVec3| p.y == 9.0 + (p.x + p.z) % 2.0;
    for (name, walls) in [
        ("one voxel", WallDistance::drawn([62, 19, 13], DVec3::ONE, |p| hairpin(p, &one_voxel))),
        ("edges", WallDistance::drawn([62, 19, 13], DVec3::ONE, |p| hairpin(p, &edges))),
        (
            "flat",
            WallDistance::drawn([62, 19, 13], DVec3::new(1.0, 1.0, 4.0), |p| {
                hairpin(DVec3::new(p.x, p.y, p.z / 4.0), &one_voxel)
            }),
        ),
    ] {
        let (from, to) = (
            DVec3::new(4.0, 5.0, 6.0 * walls.grid().spacing().z),
            DVec3::new(4.0, 14.0, 6.0 * walls.grid().spacing().z),
        );
        for method in METHODS {
            let line = by(method, &walls, End::At(from), End::At(to), &[], &Progress::new()).unwrap();
            holds_together(&walls, &line);
            assert!(line.length_mm > 95.0, "{name}, {method:?}: {} mm is a shortcut", line.length_mm);
        }
    }
}

#[test]
fn extremes() {
    let p = Progress::new();
    // One voxel wide, with corners, in thick slices.
    let spacing = DVec3::new(0.3, 0.3, 10.0);
    let narrow = WallDistance::drawn([40, 40, 6], spacing, |w| {
        let u = (w / spacing).round();
        let in_slice = u.z == 2.0 && (u.y == 3.0 || u.x == 38.0);
        in_slice || (u.x == 38.0 && u.y == 39.0)
    });
    let ends = far_ends(&narrow, &p).unwrap();
    for method in METHODS {
        let line = by(method, &narrow, End::Tip(ends[0]), End::Tip(ends[1]), &[], &p).unwrap();
        holds_together(&narrow, &line);
        assert!(line.points.len() > 2, "{method:?}");
    }
    // A closed ring.
    let ring = WallDistance::drawn([50, 50, 13], DVec3::ONE, |w| {
        let q = w - DVec3::new(24.5, 24.5, 6.0);
        (q.x.hypot(q.y) - 17.0).hypot(q.z) < 5.0
    });
    let ends = far_ends(&ring, &p).unwrap();
    for method in METHODS {
        let line = by(method, &ring, End::Tip(ends[0]), End::Tip(ends[1]), &[], &p).unwrap();
        holds_together(&ring, &line);
        assert!((30.0..75.0).contains(&line.length_mm), "{method:?}: half of the ring, {} mm", line.length_mm);
    }
    // One voxel, and two identical points.
    let one = WallDistance::drawn([5, 5, 5], DVec3::ONE, |w| w == DVec3::splat(2.0));
    for method in METHODS {
        let line = by(method, &one, End::Tip(DVec3::splat(2.0)), End::Tip(DVec3::splat(2.0)), &[], &p).unwrap();
        assert_eq!(line.points, [DVec3::splat(2.0)]);
    }
    let none = WallDistance::drawn([5, 5, 5], DVec3::ONE, |_| false);
    assert!(far_ends(&none, &p).is_err());
    for at in [DVec3::NAN, DVec3::splat(1e300), DVec3::splat(2.0)] {
        assert!(between(&none, End::At(at), End::At(at), &[], &p).is_err());
    }
    let cancelled = Progress::new();
    cancelled.cancel();
    assert!(between(&ring, End::Tip(ends[0]), End::Tip(ends[1]), &[], &cancelled).is_err());
}

/// A tube in three pieces is bridged in order, in both directions, only when guesses are given, and marked.
#[test]
fn collapsed_stretches_are_marked_guesses() {
    let walls = WallDistance::drawn([120, 15, 15], DVec3::ONE, |p| {
        (p.y - 7.0).hypot(p.z - 7.0) < 5.0 && !(40.0..46.0).contains(&p.x) && !(70.0..79.0).contains(&p.x)
    });
    let at = |x: f64| DVec3::new(x, 7.0, 7.0);
    let p = Progress::new();
    let straight = |a: f64, b: f64| vec![at(a), at(b)];
    let guesses = [straight(37.0, 48.0), straight(67.0, 81.0)];
    assert!(between(&walls, End::At(at(5.0)), End::At(at(110.0)), &[], &p).is_err());
    assert!(between(&walls, End::At(at(5.0)), End::At(at(110.0)), &guesses[1..], &p).is_err());
    for (from, to) in [(5.0, 110.0), (110.0, 5.0)] {
        let line = between(&walls, End::At(at(from)), End::At(at(to)), &guesses, &p).unwrap();
        assert_eq!(line.guessed.len(), 2);
        assert!((line.length_mm - 105.0).abs() < 2.0, "{}", line.length_mm);
        let mut widths = line.guessed.iter().map(|g| g[1] - g[0]).collect::<Vec<_>>();
        widths.sort_by(f64::total_cmp);
        assert!((widths[0] - 11.0).abs() < 1e-9 && (widths[1] - 14.0).abs() < 1e-9, "{widths:?}");
        assert_eq!(line.points.len(), line.radius_mm.len());
        assert!(line.radius_mm.iter().filter(|r| **r == 0.0).count() >= 20);
    }
    // A guess within one piece bridges nothing. Fluid that joins two gas segments leaves such guesses.
    let [first, second] = guesses.clone();
    let more = [straight(10.0, 20.0), first, straight(52.0, 60.0), second, straight(90.0, 100.0)];
    for (from, to) in [(5.0, 110.0), (110.0, 5.0)] {
        let [line, with_more] =
            [&guesses[..], &more].map(|g| between(&walls, End::At(at(from)), End::At(at(to)), g, &p).unwrap());
        assert_eq!(line, with_more);
    }
    // A guess that is bent is followed, in both directions.
    let bent = [vec![at(37.0), at(42.0) + DVec3::Y * 9.0, at(48.0)], straight(67.0, 81.0)];
    for (from, to) in [(5.0, 110.0), (110.0, 5.0)] {
        let line = between(&walls, End::At(at(from)), End::At(at(to)), &bent, &p).unwrap();
        let guessed: f64 = line.guessed.iter().map(|g| g[1] - g[0]).sum();
        assert!((guessed - (14.0 + 106f64.sqrt() + 117f64.sqrt())).abs() < 1e-9, "{guessed}");
        assert!(line.points.iter().any(|p| p.distance(at(42.0) + DVec3::Y * 9.0) < 1e-9));
        assert!(line.points.windows(2).all(|w| w[0].distance(w[1]) < 1.2) && line.points.len() == line.radius_mm.len());
    }
    // From one piece to the one before or after it.
    for (from, to) in [(60.0, 5.0), (5.0, 60.0), (110.0, 60.0), (60.0, 110.0)] {
        let line = between(&walls, End::At(at(from)), End::At(at(to)), &guesses, &p).unwrap();
        assert_eq!(line.guessed.len(), 1, "{from} to {to}");
    }
    // Within one piece nothing is guessed.
    let line = between(&walls, End::At(at(50.0)), End::At(at(60.0)), &guesses, &p).unwrap();
    assert!(line.guessed.is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// In random caves, every method finds a line that is inside everywhere, if and only if a flood fill from one end
    /// reaches the other.
    #[test]
    fn lines_stay_inside_caves(seed: u64, share in 0.45f64..0.9, sx in 0.3f64..2.0, sz in 0.3f64..4.0) {
        let dims = [17usize, 15, 13];
        let walls = WallDistance::drawn(dims, DVec3::new(sx, 0.8, sz), |p| {
            let u = (p / DVec3::new(sx, 0.8, sz)).round();
            uniform(seed, (u.x + 17.0 * (u.y + 15.0 * u.z)) as u64) < share
        });
        let inside: Vec<[i64; 3]> = {
            let mut out = Vec::new();
            walls.set().for_each(|n, v| if walls.value(n) >= 0.0 { out.push(v.map(|x| x as i64)) });
            out
        };
        let (a, b) = (inside[0], inside[inside.len() - 1]);
        let mut reached = vec![a];
        let mut n = 0;
        while n < reached.len() {
            for s in 0..6 {
                let mut v = reached[n];
                v[s / 2] += if s.is_multiple_of(2) { 1 } else { -1 };
                if walls.is_inside(v) && !reached.contains(&v) {
                    reached.push(v);
                }
            }
            n += 1;
        }
        for method in METHODS {
            let line = by(method, &walls, End::At(walls.world(a)), End::At(walls.world(b)), &[], &Progress::new());
            prop_assert_eq!(line.is_ok(), reached.contains(&b), "{:?}", method);
            if let Ok(line) = line {
                holds_together(&walls, &line);
                prop_assert!(line.points[0].distance(walls.world(a)) < 1e-9);
                prop_assert!(line.points[line.points.len() - 1].distance(walls.world(b)) < 1e-9);
            }
        }
    }
}

/// Random walks through a cave's voxels stay free when resampled and tightened.
#[test]
fn resampling_and_tightening_keep_a_line_free() {
    let walls = WallDistance::drawn([20, 20, 20], DVec3::new(0.5, 0.7, 1.1), |p| {
        (p.x * 1.7).sin() + (p.y * 1.3).cos() + (p.z).sin() < 0.6
    });
    for walk in 0..20u64 {
        let mut at = [(walk % 20) as i64, 10, 10];
        while !walls.is_inside(at) {
            at[1] = (at[1] + 1) % 20;
        }
        let mut line = vec![walls.world(at)];
        for n in 0..200 {
            let s = (6.0 * uniform(walk, n)) as usize;
            let mut v = at;
            v[s / 2] += if s.is_multiple_of(2) { 1 } else { -1 };
            if walls.is_inside(v) {
                at = v;
                line.push(walls.world(at));
            }
        }
        for step in [0.2, 1.0, 3.0] {
            let mut r = resampled(&walls, &line, step);
            assert!(r.first() == line.first() && r.last() == line.last());
            tightened(&walls, &mut r, 5, 0.4);
            assert!(r.windows(2).all(|w| is_free(&walls, w[0], w[1])), "walk {walk}, step {step}");
        }
    }
}

/// On a straight line, points of the resampled one are `step` apart; the last part may be shorter.
#[test]
fn a_resampled_line_has_even_steps() {
    let walls = WallDistance::drawn([60, 9, 9], DVec3::ONE, |p| p.y > 0.5 && p.y < 7.5 && p.z > 0.5 && p.z < 7.5);
    for spaced in [0.25, 0.7, 1.9] {
        let line: Vec<DVec3> =
            (0..=(40.0 / spaced) as usize).map(|n| DVec3::new(5.0 + spaced * n as f64, 4.0, 4.0)).collect();
        let step = 3.0;
        let out = resampled(&walls, &line, step);
        let lengths: Vec<f64> = out.windows(2).map(|w| w[0].distance(w[1])).collect();
        let (last, others) = lengths.split_last().unwrap();
        assert!(others.iter().all(|l| (l - step).abs() < 1e-6) && *last <= step + 1e-6, "{spaced}: {lengths:?}");
    }
}

/// Tightening straightens a line, and leans it towards the middle of the lumen and nowhere else.
#[test]
fn a_tightened_line_moves_to_the_middle() {
    let walls = WallDistance::drawn([60, 21, 21], DVec3::ONE, |p| (p.y - 10.0).hypot(p.z - 10.0) < 7.0);
    let off = |p: &DVec3| (p.y - 10.0).hypot(p.z - 10.0);
    let line: Vec<DVec3> = (5..55).map(|x| DVec3::new(f64::from(x), 10.0, 10.0)).collect();
    let mut stays = line.clone();
    tightened(&walls, &mut stays, 20, 0.5);
    assert!(stays.iter().all(|p| off(p) < 0.2), "on the axis it stays there");
    // The ends are off the axis, and stay.
    let mut moves: Vec<DVec3> = line.iter().map(|p| *p + DVec3::new(0.0, 3.0, 0.0)).collect();
    let ends = [moves[0], moves[49]];
    tightened(&walls, &mut moves, 60, 0.5);
    assert_eq!([moves[0], moves[49]], ends);
    assert!(off(&moves[25]) < 1.0, "{}", moves[25]);
    let mut straight = line;
    straight[20] += DVec3::Z * 3.0;
    tightened(&walls, &mut straight, 40, 0.0);
    assert!(off(&straight[20]) < 0.8 && off(&straight[20]) > 0.0);
}

/// Cells hold 64 voxels, in the shape that is nearest to a cube, and equal pieces are told apart by their order.
#[test]
fn cells_are_nearly_cubes_and_the_first_of_equal_pieces_is_the_largest() {
    use super::cells::Cells;
    let walls =
        WallDistance::drawn([40, 8, 8], DVec3::ONE, |p| (2.0..10.0).contains(&p.x) || (22.0..30.0).contains(&p.x));
    let cells = Cells::of(&walls, 0.0, &Progress::new()).unwrap();
    let piece = cells.largest_piece();
    assert!(piece.contains(&cells.node_at([4, 4, 4]).unwrap()) && !piece.contains(&cells.node_at([25, 4, 4]).unwrap()));
}

#[test]
fn a_method_is_named_as_scene_files_write_it() {
    for method in CenterlineMethod::ALL {
        assert_eq!(serde_json::to_value(method).unwrap(), method.name());
    }
}

/// An end beside the lumen is moved to the nearest voxel of it; one in the lumen stays.
#[test]
fn a_line_begins_in_the_lumen_although_its_end_was_given_beside_it() {
    let walls = WallDistance::drawn([40, 13, 13], DVec3::ONE, |p| {
        (p.y - 6.0).hypot(p.z - 6.0) < 4.5 && p.x > 1.5 && p.x < 37.5
    });
    let (beside, within) = (DVec3::new(8.0, 11.8, 6.0), DVec3::new(30.2, 6.1, 5.9));
    for method in METHODS {
        for swapped in [false, true] {
            let (from, to) = if swapped { (within, beside) } else { (beside, within) };
            let line = by(method, &walls, End::At(from), End::At(to), &[], &Progress::new()).unwrap();
            holds_together(&walls, &line);
            let mut ends = [line.points[0], line.points[line.points.len() - 1]];
            if swapped {
                ends.reverse();
            }
            assert!(ends[0].distance(DVec3::new(8.0, 10.0, 6.0)) < 1e-9, "{method:?}: {}", ends[0]);
            assert!(ends[1].distance(within) < 1e-9, "{method:?}: {}", ends[1]);
        }
    }
}

#[test]
fn narrow_stretches_are_listed_by_their_narrowest_place() {
    let line = Centerline {
        points: (0..10).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)).collect(),
        radius_mm: vec![5.0, 1.2, 0.8, 1.0, 4.0, 0.0, 0.0, 3.0, 3.0, 1.4],
        length_mm: 9.0,
        guessed: vec![[4.5, 6.5]],
    };
    let at = |narrow: &Narrow| (narrow.along_mm, narrow.radius_mm);
    assert_eq!(line.narrows(1.5).iter().map(at).collect::<Vec<_>>(), [(2.0, 0.8), (9.0, 1.4)]);
    assert!(line.narrows(0.5).is_empty() && Centerline::default().narrows(1.5).is_empty());
}
