use std::f64::consts::PI;

use super::*;
use crate::touching::Touching;

fn make(size: Size, seed: u64) -> Phantom {
    Phantom::new(&PhantomSettings { size, seed, touching: true, noise: false, ..PhantomSettings::default() })
}

fn septum(phantom: &Phantom) -> TrueSeptum {
    let truth: Vec<_> = phantom.shape.touching.iter().map(Touching::truth).collect();
    assert_eq!(truth.len(), 1, "seed {}", phantom.settings.seed);
    truth[0]
}

/// Returns the thickness of tissue along the unit vector `along` through `at`, as the walls see it, and its middle, mm from `at`.
fn through(phantom: &Phantom, at: DVec3, along: DVec3) -> Option<(f64, f64)> {
    let wall = |t: f64| phantom.wall(at + along * t);
    let edge = |sign: f64| {
        let t = (0..60).map(|k| sign * 0.1 * f64::from(k)).find(|&t| wall(t) < 0.0)?;
        let (mut lo, mut hi) = (t - sign * 0.1, t);
        for _ in 0..50 {
            let mid = 0.5 * (lo + hi);
            if wall(mid) < 0.0 { hi = mid } else { lo = mid }
        }
        Some(lo)
    };
    let (a, b) = (edge(-1.0)?, edge(1.0)?);
    Some((b - a, 0.5 * (a + b)))
}

#[test]
fn limbs_touch_for_every_seed_and_the_septum_is_the_truths() {
    let mut level = 0;
    for size in [Size::Small, Size::Standard] {
        for seed in 1..=20 {
            let phantom = make(size, seed);
            let TrueSeptum { position, normal, thickness_mm, along_mm } = septum(&phantom);
            assert!((touching_placing::SEPTUM_MM[0]..=touching_placing::SEPTUM_MM[1]).contains(&thickness_mm));
            assert!((normal.length() - 1.0).abs() < 1e-9 && along_mm[1] - along_mm[0] >= 100.0);
            level += usize::from(normal.z.abs() > 0.85);
            // Between the walls' own values the tissue is thicker than between its edges.
            let apart = thickness_mm - 2.0 * profile::SHIFT * phantom.sigma;
            let side = normal.any_orthonormal_vector();
            for k in 0..9 {
                let turn =
                    side * (f64::from(k) * PI / 4.0).cos() + normal.cross(side) * (f64::from(k) * PI / 4.0).sin();
                let off = if k == 8 { DVec3::ZERO } else { turn * 4.5 };
                let (thick, middle) = through(&phantom, position + off, normal).expect("gas on both sides");
                assert!((thick - apart).abs() < 0.02 && middle.abs() < 0.02, "{size:?} {seed}, {k}: {thick}, {middle}");
            }
            // Gas, tissue, gas; and the two sides are the two limbs.
            for (sign, s) in [(-1.0, along_mm[0]), (1.0, along_mm[1])] {
                let p = position + normal * (sign * (0.5 * apart + 2.0));
                assert!(phantom.value(p) < -990.0, "{size:?} {seed}: {}", phantom.value(p));
                let foot = phantom.distances_among(p, &[phantom.all_knots()]).1;
                assert!((foot - s).abs() < 8.0, "{foot} for {s}");
                let on = position + normal * (sign * 0.5 * apart);
                assert!((phantom.wall(on)).abs() < 1e-6);
            }
            // Each side's blur reaches the other one.
            let share = 2.0 * normal_cdf(0.5 * thickness_mm / phantom.sigma) - 1.0;
            assert!((phantom.value(position) - mix(GAS, TISSUE, share)).abs() < 1.0, "{size:?} {seed}");
        }
    }
    // Common, but not the only orientation.
    assert!((20..=34).contains(&level), "{level} of 40 septa are level");
}

#[test]
fn a_colon_that_touches_has_the_other_guarantees() {
    for size in [Size::Small, Size::Standard] {
        for seed in 1..=10 {
            let phantom = make(size, seed);
            let (axis, grid) = (&phantom.shape.axis, phantom.grid());
            let [nx, ny, nz] = grid.dims();
            let far = grid.world(DVec3::new(nx as f64 - 1.0, ny as f64 - 1.0, nz as f64 - 1.0));
            let mut s = 0.0;
            while s <= axis.length() {
                let frame = axis.frame(s);
                for k in 0..12 {
                    let p = frame.at + frame.direction(f64::from(k) * PI / 6.0) * 5.1;
                    assert!(phantom.wall(p) < 0.0, "{size:?} {seed}: {s} mm, {k}: {}", phantom.wall(p));
                }
                let room =
                    (frame.at - grid.origin()).min(far - frame.at).min_element() - phantom.shape.largest_radius(s);
                assert!(room >= 12.0, "{size:?} {seed}: {room} mm at {s}");
                assert!(phantom.body.value(frame.at) > -300.0, "{size:?} {seed}: {s} mm is outside the body");
                s += 2.3;
            }
            let septum = septum(&phantom);
            let step = DVec3::new(1.0, -2.0, 1.5) * 1e-5;
            for n in 0..20_000u64 {
                let u = |k| hash::uniform(13, 4 * n + k) - 0.5;
                let p = septum.position + DVec3::new(u(0), u(1), u(2)) * 60.0;
                let (a, b) = (phantom.wall(p), phantom.wall(p + step));
                assert!(a.abs() > 2.0 || (a - b).abs() < 3.0 * step.length(), "{size:?} {seed} {p}: {a}, {b}");
            }
        }
    }
}

#[test]
fn the_thickness_can_be_set_and_the_axis_stays() {
    let settings = PhantomSettings { size: Size::Small, touching: true, noise: false, ..PhantomSettings::default() };
    let with = |mm| Phantom::new(&PhantomSettings { touching_mm: Some(mm), ..settings });
    let first = with(0.4);
    for mm in [0.4, 0.9, 1.5] {
        let phantom = with(mm);
        assert_eq!(septum(&phantom).thickness_mm, mm);
        assert_eq!(phantom.axis().knots(), first.axis().knots());
        let s = septum(&phantom);
        // Without blur the tissue's share, summed along the normal, is the thickness.
        let share = |t: f64| (phantom.value(s.position + s.normal * t) - GAS) / (TISSUE - GAS);
        let sum = (-500..500).map(|k| share(0.008 * f64::from(k))).sum::<f64>() * 0.008;
        assert!((sum - mm).abs() < 0.02, "{sum} for {mm}");
    }
    for (set, used) in [(0.0, 0.2), (9.0, 3.0)] {
        assert_eq!(septum(&with(set)).thickness_mm, used);
    }
    assert!((0.4..=1.5).contains(&septum(&with(f64::NAN)).thickness_mm));
}

#[test]
fn a_septum_between_gas_and_fluid_has_no_jump() {
    for position in [Position::Supine, Position::Prone, Position::Left, Position::Right] {
        for (fluid, pools) in [(true, false), (false, true)] {
            let settings = PhantomSettings {
                size: Size::Small,
                touching: true,
                noise: false,
                fluid,
                pools,
                position,
                ..PhantomSettings::default()
            };
            let phantom = Phantom::new(&settings);
            let s = septum(&phantom);
            for n in 0..400u64 {
                let u = |k| hash::uniform(17, 4 * n + k) - 0.5;
                let p = s.position + DVec3::new(u(0), u(1), u(2)) * 12.0;
                let on = p - s.normal * (p - s.position).dot(s.normal);
                let jump = phantom.value(on + s.normal * 1e-6) - phantom.value(on - s.normal * 1e-6);
                assert!(jump.abs() < 0.05, "{position:?} {on}: {jump}");
            }
        }
    }
}

#[test]
fn labels_and_truth_know_the_septum() {
    let phantom = make(Size::Small, 3);
    let s = septum(&phantom);
    assert_eq!(phantom.content_at(s.position), Content::Tissue);
    for sign in [-1.0, 1.0] {
        assert_eq!(phantom.content_at(s.position + s.normal * (3.0 * sign)), Content::Colon);
    }
    let truth = phantom.truth();
    assert_eq!(truth.touching, [s]);
    let json = serde_json::to_value(&truth).unwrap();
    let first = &json["touching"][0];
    assert!(first["position"][2].is_f64() && first["normal"][0].is_f64() && first["thickness_mm"].is_f64());
    assert!(first["along_mm"][1].is_f64() && json["wall_hu"] == -650);
    let plain = Phantom::new(&PhantomSettings { touching: false, ..*phantom.settings() }).truth();
    assert!(plain.touching.is_empty() && serde_json::to_value(&plain).unwrap().get("touching").is_none());
    // The volume is that of the voxels around the septum, too.
    assert!((0.8..1.25).contains(&(truth.lumen_ml / plain.lumen_ml)));
}

#[test]
#[ignore = "slow: twenty phantoms with everything"]
fn everything_goes_together() {
    for size in [Size::Small, Size::Standard] {
        for seed in 1..=10 {
            let mut settings = PhantomSettings::with_all_gas(size, seed, Position::Prone);
            (settings.touching, settings.lesions, settings.decoys, settings.films, settings.stool) =
                (true, true, true, true, true);
            settings.noise = false;
            let phantom = Phantom::new(&settings);
            let s = septum(&phantom);
            assert!(through(&phantom, s.position, s.normal).is_some(), "{size:?} {seed}");
            // The last stretch of the ileum meets the colon at the valve.
            let (axis, spot) = (phantom.axis(), phantom.valve.map(|valve| valve.spot.at));
            let scale = if size == Size::Small { 0.58 } else { 1.0 };
            let colon: Vec<_> = (axis.knots().iter().enumerate())
                .map(|(i, c)| (*c, axis.profile(i as f64 * axis.knot_step()).radius.0))
                .filter(|(c, r)| spot.is_none_or(|spot| c.distance(spot) - r > 24.0 * scale))
                .collect();
            for tube in &phantom.guts.tubes {
                let room = tube.clearance(&colon);
                assert!(room > 2.0, "{size:?} {seed}: {:?}: {room:.1} mm", tube.kind);
            }
        }
    }
}

/// Without the part, a phantom is what it was before there was one.
#[test]
fn other_phantoms_have_not_changed_by_a_byte() {
    let all = PhantomSettings {
        bridges: true,
        lesions: true,
        decoys: true,
        films: true,
        stool: true,
        inhomogeneous: true,
        pseudo: true,
        ..PhantomSettings::with_all_gas(Size::Small, 4, Position::Left)
    };
    let plain = PhantomSettings::default();
    let fluid = PhantomSettings { size: Size::Small, fluid: true, seed: 2, ..plain };
    let digests = [plain, fluid, all].map(|settings| {
        let grid = Grid::new([61, 53, 67], DVec3::new(4.3, 3.9, 3.7), DVec3::splat(-120.0), DMat3::IDENTITY).unwrap();
        let volume = Phantom::new(&settings).voxelise(&grid, &Progress::new()).unwrap();
        volume.data().iter().fold(0, |sum, &hu| hash::bits(sum, u64::from(hu.cast_unsigned())))
    });
    assert_eq!(digests, [1_051_105_172_809_742_954, 15_443_141_261_954_302_221, 14_656_757_084_404_516_677]);
}
