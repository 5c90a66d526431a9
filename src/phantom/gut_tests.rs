//! What lies beside the colon: room, volumes, the valve, collapsed stretches, names and labels.

use super::*;
use crate::checks::cases;
use crate::profile::WALL_HU;

fn all(size: Size, seed: u64) -> Phantom {
    let rest = PhantomSettings { polyps: false, noise: false, ..PhantomSettings::default() };
    let with = PhantomSettings { ileum: true, stomach: true, lungs: true, collapsed: true, pelvis: true, ..rest };
    Phantom::new(&PhantomSettings { size, seed, ..with })
}

/// Returns the colon's knots with radii, without those near the valve.
fn colon(phantom: &Phantom, but: f64) -> Vec<(DVec3, f64)> {
    let axis = phantom.axis();
    let valve = phantom.valve().unwrap().position;
    let ball = |i: usize| (axis.knots()[i], phantom.shape.largest_radius(i as f64 * axis.knot_step()));
    (0..axis.knots().len()).map(ball).filter(|(c, r)| c.distance(valve) - r > but).collect()
}

#[test]
fn gut_is_apart_and_has_its_volume_for_every_seed() {
    let mut faults = Vec::new();
    for &size in cases(&[Size::Small, Size::Standard][..], &[Size::Small]) {
        let scale = if size == Size::Small { 0.58 } else { 1.0 };
        for seed in 1..=cases(20, 1) {
            let phantom = all(size, seed);
            let tubes = &phantom.guts.tubes;
            let colon = colon(&phantom, 24.0 * scale);
            let lungs = |t: &gut::Gut| {
                t.balls().iter().map(|(c, r)| -phantom.body.lung_depth(*c) - r).fold(f64::INFINITY, f64::min)
            };
            let mut note = format!("{size:?} {seed}: {:.0} mm;", tubes[0].axis.length());
            for (i, tube) in tubes.iter().enumerate() {
                let to_colon = tube.clearance(&colon);
                let others: Vec<_> = tubes.iter().skip(i + 1).flat_map(|t| t.balls()).collect();
                let to_others = tube.clearance(&others);
                let own = tube.own_clearance();
                note += &format!(" {:?} {to_colon:.1} {to_others:.1} {own:.1} {:.1}", tube.kind, lungs(tube));
                if to_colon < if i == 0 { 4.0 } else { 3.5 } || to_others < 3.5 || own < 4.0 || lungs(tube) < 3.0 {
                    faults.push(format!("{size:?} {seed} {i}: {to_colon} {to_others} {own} {}", lungs(tube)));
                }
            }
            if tubes[0].axis.length() < 400.0 * scale {
                faults.push(format!("{size:?} {seed}: {} mm long", tubes[0].axis.length()));
            }
            if seed <= 10 {
                let sum = |kind| {
                    let bodies = phantom.bodies();
                    bodies.iter().filter(|b| b.kind == kind).map(|b| b.ml).collect::<Vec<_>>()
                };
                let (bowel, stomach, lungs) = (sum(BodyKind::SmallBowel), sum(BodyKind::Stomach), sum(BodyKind::Lung));
                note += &format!(
                    "; bowel {bowel:.0?} stomach {stomach:.0?} lungs {lungs:.0?} colon {:.0?}",
                    sum(BodyKind::Colon)
                );
                let cube = scale.powi(3);
                let fits = (100.0 * cube..500.0 * cube).contains(&bowel.iter().sum())
                    && stomach.len() == 1
                    // A small colon leaves it less room.
                    && (if size == Size::Small { 4.0..70.0 } else { 100.0..350.0 }).contains(&stomach[0])
                    && lungs.len() == 2
                    && lungs.iter().all(|ml| *ml > 150.0 * cube);
                if !fits {
                    faults.push(format!("{size:?} {seed}: volumes"));
                }
                for b in phantom.bodies() {
                    if phantom.value(b.position) > WALL_HU || b.position.min(b.bounds_mm[0]) != b.bounds_mm[0] {
                        faults.push(format!("{size:?} {seed}: {b:?}: {}", phantom.value(b.position)));
                    }
                }
            }
            println!("{note}");
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Labels the voxels of gas in colon and small bowel by connected components (6 neighbours), and returns the component of each.
fn components(phantom: &Phantom) -> (Vec<u8>, Vec<u32>, Volume) {
    let grid = phantom.grid();
    let volume = phantom.voxelise(&grid, &Progress::new()).unwrap();
    let labels = phantom.labels(&grid, &Progress::new()).unwrap();
    let [nx, ny, _] = grid.dims();
    let gas = |n: usize| volume.data()[n] < -650 && (1..=2).contains(&labels[n]);
    let mut of = vec![0u32; labels.len()];
    let mut next = 0;
    for start in 0..labels.len() {
        if of[start] != 0 || !gas(start) {
            continue;
        }
        next += 1;
        let mut open = vec![start];
        of[start] = next;
        while let Some(n) = open.pop() {
            for step in [1, nx, nx * ny] {
                for m in [n.wrapping_sub(step), n + step] {
                    if m < of.len() && of[m] == 0 && gas(m) {
                        of[m] = next;
                        open.push(m);
                    }
                }
            }
        }
    }
    (labels, of, volume)
}

#[test]
fn the_valve_joins_gas_if_it_is_open_and_labels_agree_with_the_scan() {
    for seed in 1..=cases(4, 1) {
        let phantom = all(Size::Small, seed);
        let (labels, of, volume) = components(&phantom);
        let grid = phantom.grid();
        let at = |p: DVec3| {
            let v = ((p - grid.origin()) / grid.spacing()).round();
            of[grid.index(v.x as usize, v.y as usize, v.z as usize)]
        };
        let bodies = phantom.bodies();
        let cecum = bodies.iter().rfind(|b| b.kind == BodyKind::Colon).map(|b| at(b.position)).unwrap();
        assert!(cecum != 0);
        let ileum: Vec<u32> =
            bodies.iter().filter(|b| b.kind == BodyKind::SmallBowel).map(|b| at(b.position)).collect();
        assert!(ileum.iter().all(|c| *c != 0), "{seed}: {ileum:?}");
        let valve = phantom.valve().unwrap();
        assert_eq!(valve.open, seed % 2 == 1);
        assert_eq!(ileum.contains(&cecum), valve.open, "{seed}: {cecum}, {ileum:?}");
        // Each segment of the colon is its own component.
        let mut segments: Vec<u32> =
            bodies.iter().filter(|b| b.kind == BodyKind::Colon).map(|b| at(b.position)).collect();
        let count = segments.len();
        segments.sort_unstable();
        segments.dedup();
        assert_eq!((segments.len(), count), (phantom.collapsed().len() + 1, phantom.collapsed().len() + 1), "{seed}");
        // Within gas, away from every boundary, the scan is dark; beside it, it is not.
        let [nx, ny, _] = grid.dims();
        let mut odd = [0usize; 6];
        for (n, label) in labels.iter().enumerate() {
            let around = [1, nx, nx * ny].into_iter().flat_map(|s| [n.wrapping_sub(s), n + s]);
            let inner = around.clone().all(|m| labels.get(m) == Some(label));
            // At the back a spinous process is beneath the skin.
            let back = (n / nx) % ny > ny / 2;
            let dark = matches!(label, 1 | 2) || *label == 5 && !back;
            if inner && dark && volume.data()[n] > -650 {
                odd[usize::from(*label)] += 1;
            }
            if inner && *label == 0 && volume.data()[n] < -900 {
                odd[0] += 1;
            }
        }
        assert_eq!(odd, [0; 6], "{seed}");
    }
}

#[test]
fn a_collapsed_stretch_is_tissue() {
    for size in [Size::Small, Size::Standard] {
        for seed in 1..=20 {
            let phantom = all(size, seed);
            let collapsed = phantom.collapsed();
            assert!((2..=3).contains(&collapsed.len()));
            for [from, to] in collapsed {
                assert!((12.0..=45.0).contains(&(to - from)), "{size:?} {seed}: {from} to {to}");
                for i in 0..=10 {
                    let s = from + 3.5 + (to - from - 7.0) * f64::from(i) / 10.0;
                    let hu = phantom.value(phantom.axis().frame(s).at);
                    assert!((20.0..50.0).contains(&hu), "{size:?} {seed} at {s} of {from} to {to}: {hu}");
                }
            }
        }
    }
}

#[test]
fn names_cover_the_line() {
    let truth = all(Size::Small, 2).truth();
    assert_eq!(truth.names.len(), 8);
    assert!(truth.names[0].from_mm == 0.0 && truth.names[7].to_mm == truth.length_mm);
    assert!(truth.names.windows(2).all(|w| w[0].to_mm == w[1].from_mm && w[0].from_mm < w[0].to_mm));
    let json = serde_json::to_value(&truth).unwrap();
    assert_eq!((&json["position"], &json["names"][3]["name"]), (&"supine".into(), &"splenic flexure".into()));
    assert_eq!(serde_json::from_value::<Truth>(json).unwrap(), truth);
}
