//! What the gas of whole phantoms is taken for, the rules one by one, and the parts of a body.

use std::sync::Arc;

use glam::DVec3;

use super::rules::{RULES, for_colon, weigh};
use super::{Chain, Features, GasKind, judge};
use crate::checks::cases;
use crate::fields::lumen::{self, Lumen};
use crate::phantom::{Phantom, PhantomSettings, Position, Size};
use crate::progress::Progress;
use crate::shared::shared;
use crate::volume::{PatientPosition, Volume};

/// A phantom with every kind of gas.
fn phantom(seed: u64, position: Position) -> (Arc<Phantom>, Volume) {
    shared(&PhantomSettings::with_all_gas(Size::Small, seed, position))
}

#[test]
fn what_is_called_colon_is_the_colon() {
    const SMALL_BOWEL: u8 = 2;
    // An open valve on the back, and a closed one with a descending colon full of fluid on the left side.
    let phantoms = [(1, Position::Supine, PatientPosition::Supine), (2, Position::Left, PatientPosition::Left)];
    for (seed, position, expected) in phantoms.into_iter().take(cases(2, 1)) {
        let ((phantom, volume), progress) = (phantom(seed, position), Progress::default());
        let lumen = lumen::find(&volume, &progress).unwrap();
        let (mask, labels) = (lumen.mask(), phantom.labels(volume.grid(), &progress).unwrap());
        let count = |which: &dyn Fn(u8, u8) -> bool| mask.iter().zip(&labels).filter(|v| which(*v.0, *v.1)).count();
        let both = count(&|m, l| m != 0 && l == 1);
        let dice = 2.0 * both as f64 / (count(&|m, _| m != 0) + count(&|_, l| l == 1)) as f64;
        assert!(dice >= 0.97, "seed {seed}: {dice}");
        let ileum = count(&|m, l| m != 0 && l == SMALL_BOWEL) as f64 * volume.grid().voxel_ml();
        assert!(ileum < 1.0, "seed {seed}: {ileum} ml of ileum");
        assert!(lumen.ordered && lumen.segments.len() > 1, "seed {seed}");
        assert_eq!(lumen.lying.map(|l| l.position), Some(expected), "seed {seed}");
        let places = places(&phantom, &lumen);
        assert!(places.is_sorted(), "seed {seed}: {places:?}");
    }
}

/// The ends of the segments in their order, as numbers of points of the true centerline.
fn places(phantom: &Phantom, lumen: &Lumen) -> Vec<usize> {
    let truth = phantom.truth();
    let along = |p: DVec3| {
        let far = |q: &DVec3| q.distance(p);
        let nearest = (0..truth.centerline.len())
            .min_by(|&a, &b| far(&truth.centerline[a]).total_cmp(&far(&truth.centerline[b])));
        nearest.unwrap()
    };
    lumen.segments.iter().flat_map(|s| s.ends).map(along).collect()
}

#[test]
fn limbs_full_of_fluid_do_not_hide_the_order() {
    // A limb of fluid with only bubbles of gas between two collapsed stretches, and two bodies of gas that touch only where they were
    // grown to the wall: as one, they would end where one of them does, and the line would miss the other.
    for seed in [101, 107] {
        let settings = PhantomSettings {
            polyps: false,
            lungs: false,
            pelvis: false,
            ..PhantomSettings::with_all_gas(Size::Small, seed, Position::Supine)
        };
        let (phantom, volume) = shared(&settings);
        let lumen = lumen::find(&volume, &Progress::new()).unwrap();
        let places = places(&phantom, &lumen);
        assert!(lumen.ordered && places.is_sorted(), "seed {seed}: {places:?}");
        let whole = phantom.truth().centerline.len();
        assert!(places.windows(2).all(|w| w[1] - w[0] < whole / 3), "seed {seed}: {places:?} of {whole}");
    }
}

/// A body about which nothing tells anything.
fn plain() -> Features {
    Features {
        ml: 40.0,
        length_mm: 50.0,
        caliber_mm: 25.0,
        widest_mm: 25.0,
        back: 0.5,
        height: 0.45,
        ..Features::default()
    }
}

#[test]
fn each_rule_holds_for_a_body_made_for_it_and_not_for_a_plain_one() {
    let spare = |f: &Features| (*f, Chain::Spare);
    let alone = |f: Features| (f, Chain::Unknown);
    let p = plain();
    let made: [(Features, Chain); 18] = [
        (p, Chain::Link),
        alone(Features { height: 0.2, aside: 0.1, back: 0.6, ..p }),
        alone(Features { aside: -0.5, caliber_mm: 30.0, ..p }),
        alone(Features { share: 1.0, ml: 200.0, ..p }),
        alone(Features { caliber_mm: 40.0, ..p }),
        alone(Features { length_mm: 500.0, ..p }),
        alone(Features { aside: 0.6, along_mm: 90.0, ..p }),
        alone(Features { across: 0.6, ..p }),
        alone(Features { joined: true, ..p }),
        spare(&p),
        spare(&Features { length_mm: 70.0, ..p }),
        alone(Features { caliber_mm: 18.0, length_mm: 70.0, ..p }),
        alone(Features { length_mm: 70.0, ..p }),
        alone(Features { length_mm: 70.0, height: 0.3, ..p }),
        alone(Features { caliber_mm: 50.0, length_mm: 100.0, height: 0.7, ..p }),
        alone(Features { below_lungs_mm: Some(30.0), ..p }),
        alone(Features { caliber_mm: 20.0, along_mm: 90.0, lung_beside: 0.3, below_lungs_mm: Some(-60.0), ..p }),
        alone(Features {
            ml: 500.0,
            caliber_mm: 60.0,
            widest_mm: 12.0,
            lung_beside: 0.3,
            below_lungs_mm: Some(-60.0),
            ..p
        }),
    ];
    assert_eq!(weigh(&p, Chain::Unknown, None), [0.0; 7], "nothing holds for a plain body");
    // The last rule holds with the one before it.
    for (n, r) in RULES.iter().enumerate() {
        let (f, chain) = &made[n.min(made.len() - 1)];
        assert!((r.holds)(f, *chain), "rule {n}: {}", r.why);
        assert!(!r.why.is_empty() && r.weight != 0.0);
    }
    assert_eq!(RULES.len(), made.len() + 1);
}

#[test]
fn the_air_of_a_blanket_over_the_chest_is_not_lung() {
    let lung = Features {
        ml: 3000.0,
        caliber_mm: 90.0,
        widest_mm: 20.0,
        lung_beside: 0.4,
        below_lungs_mm: Some(-80.0),
        ..plain()
    };
    let kind = |f: Features| judge(&f, Chain::Unknown, None).kind;
    assert_eq!(kind(Features { across: 0.8, ..lung }), GasKind::Lung);
    assert_eq!(kind(Features { across: 1.1, ..lung }), GasKind::Outside, "around the body");
    assert_eq!(kind(Features { back: -0.1, ..lung }), GasKind::Outside, "on the belly");
    assert_eq!(kind(Features { aside: -1.2, ..lung }), GasKind::Outside, "beside it");
}

#[test]
fn a_body_is_unknown_where_nothing_leads_and_stays_in_the_colon_unless_it_is_spare() {
    let p = plain();
    let judged = judge(&p, Chain::Unknown, None);
    assert_eq!((judged.kind, judged.is_lumen), (GasKind::Unknown, true));
    let judged = judge(&p, Chain::Spare, None);
    assert_eq!((judged.kind, judged.is_lumen), (GasKind::Unknown, false));
    let judged = judge(&p, Chain::Link, None);
    assert_eq!((judged.kind, judged.is_lumen), (GasKind::Colon, true));
    // The chain alone decides that.
    assert_eq!(judge(&p, Chain::Link, Some(0)).kind, GasKind::Unknown);
    // What speaks against a body lowers its worth.
    let narrow = Features { caliber_mm: 18.0, length_mm: 200.0, ..p };
    assert!(for_colon(&narrow) < for_colon(&p) && for_colon(&p) < for_colon(&Features { caliber_mm: 40.0, ..p }));
}

#[test]
fn features_that_are_no_numbers_judge_a_body_without_panic() {
    let f = Features { ml: f64::NAN, length_mm: f64::INFINITY, caliber_mm: f64::NAN, aside: f64::NAN, ..plain() };
    for chain in [Chain::Unknown, Chain::Link, Chain::Spare] {
        let judged = judge(&f, chain, None);
        assert!(GasKind::ALL.contains(&judged.kind) && !judged.why.is_empty());
    }
}

/// Returns the slices of a volume from `from` to `to` of its height.
fn slab(volume: &Volume, [from, to]: [f64; 2]) -> Volume {
    let [nx, ny, nz] = volume.grid().dims();
    let (first, last) = ((from * nz as f64) as usize, (to * nz as f64) as usize);
    let grid = volume.grid().part([0, 0, first], [nx, ny, last - first]);
    Volume::new(grid, volume.data()[nx * ny * first..nx * ny * last].to_vec())
}

#[test]
fn scans_of_other_regions_are_not_flown() {
    const COLON: u8 = 1;
    for seed in 1..=cases(5, 1) {
        let ((phantom, whole), progress) = (phantom(seed, Position::Supine), Progress::default());
        let labels = phantom.labels(whole.grid(), &progress).unwrap();
        let unprepared = whole.data().iter().zip(&labels).map(|(&hu, &l)| if l == COLON { 40 } else { hu }).collect();
        let unprepared = Volume::new(whole.grid().clone(), unprepared);
        let regions = [
            ("the chest", slab(&whole, [0.9, 1.0])),
            ("an abdomen without gas in the colon", slab(&unprepared, [0.0, 1.0])),
            ("its upper part", slab(&unprepared, [0.6, 1.0])),
            ("a pelvis without gas", slab(&unprepared, [0.0, 0.2])),
        ];
        // What the gas must have been taken for.
        let kinds: [&[&str]; 4] = [&["lung"], &["lung", "stomach", "small bowel"], &["lung", "stomach"], &[]];
        for ((name, volume), kinds) in regions.into_iter().zip(kinds) {
            let lumen = lumen::find(&volume, &progress).unwrap();
            let found = lumen.found().unwrap_or_default();
            assert!(kinds.iter().all(|k| found.contains(k)), "{name}, seed {seed}: {found}");
            assert!(!lumen.ordered && !lumen.is_flyable(), "{name}, seed {seed}");
        }
    }
}
