use super::decoys::Body;
use super::solid::Ellipsoid;
use super::*;

fn with_decoys(size: Size, seed: u64) -> Phantom {
    let settings =
        PhantomSettings { size, seed, decoys: true, lesions: true, stool: true, noise: false, ..Default::default() };
    Phantom::new(&settings)
}

#[test]
#[ignore = "slow: five standard phantoms with every decoy"]
fn every_kind_appears_as_often_as_it_shall() {
    use DecoyKind::{FoldJunction, FoldTip, Stool, TaggedStool, Tube, Valve};
    for seed in 1..=5 {
        let phantom = with_decoys(Size::Standard, seed);
        let decoys = phantom.truth().decoys;
        let count = |kind| decoys.iter().filter(|d| d.kind == kind).count();
        for (kind, range) in [(FoldTip, 2..=3), (FoldJunction, 1..=2), (Valve, 1..=1), (Tube, 1..=1), (Stool, 3..=4)] {
            assert!(range.contains(&count(kind)), "{seed}: {} {kind:?}", count(kind));
        }
        assert!(count(TaggedStool) > 5);
        assert!(phantom.twin().decoys().iter().all(|d| d.kind != TaggedStool));
        for (i, a) in decoys.iter().enumerate().filter(|(_, d)| d.kind != TaggedStool) {
            for b in &decoys[i + 1..] {
                assert!(a.position.distance(b.position) > 15.0, "{a:?} {b:?}");
            }
        }
    }
}

#[test]
#[ignore = "slow: three phantoms with every lesion and decoy"]
fn materials_have_their_hu() {
    for (size, seed) in [(Size::Standard, 1), (Size::Standard, 2), (Size::Small, 1)] {
        let phantom = with_decoys(size, seed);
        for decoy in &phantom.shape.decoys {
            match &decoy.body {
                Body::Folds => assert!(phantom.value(decoy.truth.position) > -300.0, "{decoy:?}"),
                Body::Lips(lips) => assert!((phantom.value(lips.foot) - TISSUE).abs() < 20.0, "{decoy:?}"),
                Body::Bulge(b) => assert!((phantom.value(b.centre) - TISSUE).abs() < 20.0, "{decoy:?}"),
                Body::Valve(lips) => {
                    for lip in lips {
                        let core = phantom.value(lip.foot + lip.axes.z_axis * (0.5 * lip.size.z - 0.5));
                        assert!((core + 70.0).abs() < 10.0, "{core}");
                    }
                    let slit = phantom.value(decoy.truth.position + lips[0].axes.z_axis * 1.5);
                    assert!(slit < -500.0, "{slit}");
                }
                Body::Tube(tube) => {
                    let along = (tube.to - tube.from).normalize();
                    let side = along.any_orthonormal_vector();
                    let near_tip = tube.to - along * 6.0;
                    assert!(phantom.value(near_tip) < -950.0, "the bore is open: {}", phantom.value(near_tip));
                    let wall = phantom.value(near_tip + side * tube.radius);
                    // A scanner sees less of it, as it is thin.
                    assert!((0.0..260.0).contains(&wall), "{wall}");
                    assert_eq!(decoy.material(near_tip + side * tube.radius, TISSUE), 250.0);
                    let (centre, radius, skin) = tube.balloon;
                    let skins = Ellipsoid::ball(centre, radius - 0.5 * skin);
                    let is_skin = |p: &DVec3| (-400.0..300.0).contains(&phantom.value(*p));
                    // The tube passes through it, and the wall may be next to it.
                    let seen = skins.points(100).filter(is_skin).count();
                    assert!(seen > 85, "{seen}");
                    let within = Ellipsoid::ball(centre, radius - skin - 2.0);
                    let gas = within.points(100).filter(|p| phantom.value(*p) < -900.0).count();
                    // In a small colon the tube takes much of it.
                    assert!(gas > 40, "{gas}");
                }
                Body::Stool(lump) => {
                    let values: Vec<f64> = Ellipsoid::ball(decoy.truth.position, 0.35 * decoy.truth.diameter_mm)
                        .points(200)
                        .filter(|p| lump.balls.iter().any(|(c, r)| c.distance(*p) < r - 1.2))
                        .filter(|p| lump.bubbles.iter().all(|(c, r)| c.distance(*p) > r + 1.5))
                        .map(|p| phantom.value(p))
                        .collect();
                    assert!(values.iter().all(|hu| (hu - lump.hu).abs() < 75.0), "{values:?}");
                    let (c, r) = lump.bubbles[0];
                    assert!(phantom.value(c) < if r > 1.2 { -800.0 } else { -350.0 }, "{}", phantom.value(c));
                }
            }
        }
    }
}
