//! Bad and extreme scans: cleansing ends, gives numbers, says why tag was left, and keeps what is far from any tag.

use glam::{DMat3, DVec3};

use super::*;
use crate::checks::cases;
use crate::fields::lumen;
use crate::math::{hash, normal};
use crate::volume::Grid;

/// Standard deviation of the blur of all edges, mm.
const SIGMA: f64 = 0.6;
/// HU of the materials.
const AIR: f64 = -1000.0;
const FLESH: f64 = 40.0;
const TAG: f64 = 450.0;
/// Voxels around a colon that is 28 mm wide and 88 mm long, and with room beside it or below.
const DIMS: [usize; 3] = [64, 64, 120];
const WIDE: [usize; 3] = [80, 64, 120];
const DEEP: [usize; 3] = [64, 80, 120];
const SPACING: DVec3 = DVec3::splat(0.8);
/// Nothing darker is tag, HU.
const BRIGHT: i16 = 180;

type Way = fn(&Volume, &Lumen, &Progress) -> Result<Cleansed>;
const WAYS: [(&str, Way); 2] = [("cleanse", cleanse), ("to_fly", to_fly)];

/// What can be asked of new values.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Scan {
    /// Edges are blurred and noise is small: no value is darker than gas, and none rises.
    Sound,
    /// Single voxels may be anything: a wall that is averaged over its neighbours may rise to tissue.
    Noisy,
    /// The values are no scan, or not that of the lumen: only numbers are asked for.
    Senseless,
}

/// Returns the place of a voxel, world mm.
fn place(grid: &Grid, n: usize) -> DVec3 {
    let [nx, ny, _] = grid.dims();
    grid.world(DVec3::from_array([n % nx, n / nx % ny, n / nx / ny].map(|c| c as f64)))
}

/// Makes a scan around the world's origin with the values of each place, and noise.
fn scan(dims: [usize; 3], spacing: DVec3, noise: f64, hu: impl Fn(DVec3) -> f64) -> Volume {
    let last = DVec3::from_array(dims.map(|d| d as f64 - 1.0));
    let grid = Grid::new(dims, spacing, -0.5 * last * spacing, DMat3::IDENTITY).expect("a grid of some voxels");
    let value = |n: usize| (hu(place(&grid, n)) + noise * hash::normal(11, n as u64)).round() as i16;
    Volume::new(grid.clone(), (0..grid.len()).map(value).collect())
}

/// Returns the distance from a capsule along z, mm; negative within.
fn capsule(p: DVec3, radius: f64, half: f64) -> f64 {
    p.distance(DVec3::new(0.0, 0.0, p.z.clamp(-half, half))) - radius
}

/// Returns the blurred value at a distance from the edge of a body.
fn mix(around: f64, within: f64, distance: f64) -> f64 {
    around + (within - around) * normal::cdf(-distance / SIGMA)
}

/// A colon along z with gas above a level and tag below it.
fn colon(p: DVec3, around: f64, tag: f64, level: f64) -> f64 {
    mix(around, mix(AIR, tag, level - p.y), capsule(p, 14.0, 30.0))
}

/// A colon with tag in tissue.
fn tagged(noise: f64) -> Volume {
    scan(DIMS, SPACING, noise, |p| colon(p, FLESH, TAG, 2.0))
}

/// Any values at all.
fn random(seed: u64) -> Volume {
    let grid = tagged(0.0).grid().clone();
    Volume::new(grid.clone(), (0..grid.len()).map(|n| hash::bits(seed, n as u64) as i16).collect())
}

/// Finds the lumen of a scan and cleanses it both ways.
fn found(scan: &Volume, kind: Scan) -> (Lumen, [Cleansed; 2]) {
    let lumen = lumen::find(scan, &Progress::new()).unwrap_or_else(|e| panic!("no lumen could be sought: {e}"));
    let both = cleansed(scan, &lumen, kind);
    (lumen, both)
}

/// Cleanses a lumen both ways, and checks what always holds.
fn cleansed(scan: &Volume, lumen: &Lumen, kind: Scan) -> [Cleansed; 2] {
    WAYS.map(|(name, way)| {
        let run = || way(scan, lumen, &Progress::new()).unwrap_or_else(|e| panic!("{name} failed: {e}"));
        let (made, again) = (run(), run());
        assert!(made.changes == again.changes, "{name} changes other voxels the second time");
        assert!(made.pools == again.pools && made.left == again.left, "{name} tells other things the second time");
        numbers_are_sound(name, &made);
        values_are_sound(name, scan, &made, kind);
        made
    })
}

fn numbers_are_sound(name: &str, made: &Cleansed) {
    for pool in &made.pools {
        assert!(pool.ml.is_finite() && pool.ml > 0.0 && pool.tag_hu.is_finite(), "{name}: {pool:?}");
        let [at, up] = pool.level;
        assert!(at.is_finite() && (up.length() - 1.0).abs() < 1e-9, "{name}: a level is a plane: {pool:?}");
    }
    for (what, number) in [("films", made.residue_ml), ("tag", made.replaced_ml), ("blur", made.blur_mm)] {
        assert!(number.is_finite() && number >= 0.0, "{name}: {number} of {what}");
    }
    for left in &made.left {
        assert!(left.ml.is_finite() && left.ml > 0.0, "{name}: nothing is left, but told: {left:?}");
        assert!(!left.why.is_empty(), "{name}: {} ml are left without a reason", left.ml);
    }
}

/// Checks each new value against the old one and the tag near it.
fn values_are_sound(name: &str, scan: &Volume, made: &Cleansed, kind: Scan) {
    let now = made.changes.applied(scan);
    let around = places_around(scan.grid());
    let [nx, ny, _] = scan.grid().dims();
    for n in (0..now.data().len()).filter(|&n| now.data()[n] != scan.data()[n]) {
        let [was, is] = [scan, &now].map(|v| i32::from(v.data()[n]));
        let at = place(scan.grid(), n);
        let [least, most] = match kind {
            Scan::Sound => [-1100, was + 250],
            Scan::Noisy => [was.min(-1000) - 250, was.max(40) + 250],
            Scan::Senseless => continue,
        };
        assert!(is >= least, "{name}: {was} HU at {at} became {is}, darker than gas");
        assert!(is <= most, "{name}: {was} HU at {at} became {is}, brighter than it may");
        let v = [n % nx, n / nx % ny, n / nx / ny].map(|c| c as i64);
        let is_tag = |d: &[i64; 3]| scan.get(v[0] + d[0], v[1] + d[1], v[2] + d[2]) > BRIGHT;
        assert!(around.iter().any(is_tag), "{name}: {was} HU at {at} became {is}, and no tag is near");
    }
}

/// Returns the steps to all voxels within 5 mm, the nearest first, and as much farther as voxels are longer than 1 mm.
fn places_around(grid: &Grid) -> Vec<[i64; 3]> {
    let spacing = grid.spacing();
    let most = 5.0 + (spacing.max_element() - 1.0).max(0.0);
    let [x, y, z] = (most / spacing).to_array().map(|r| r as i64).map(|r| -r..=r);
    let all = z.flat_map(|k| y.clone().map(move |j| (j, k))).flat_map(|(j, k)| x.clone().map(move |i| [i, j, k]));
    let mm = |at: &[i64; 3]| (DVec3::from_array(at.map(|c| c as f64)) * spacing).length();
    let mut near: Vec<_> = all.filter(|at| mm(at) <= most).collect();
    near.sort_by(|a, b| mm(a).total_cmp(&mm(b)));
    near
}

/// Returns how many values differ where `is_in` says so.
fn changed(scan: &Volume, made: &Cleansed, is_in: impl Fn(DVec3) -> bool) -> usize {
    let now = made.changes.applied(scan);
    let differs = |n: &usize| now.data()[*n] != scan.data()[*n] && is_in(place(scan.grid(), *n));
    (0..now.data().len()).filter(differs).count()
}

/// Checks that nothing was found and nothing is told.
fn all_idle(both: &[Cleansed], what: &str) {
    for made in both {
        let is_idle = made.changes.is_empty() && made.pools.is_empty() && made.left.is_empty();
        assert!(is_idle && made.replaced_ml == 0.0, "{what}: {made}; left {:?}", made.left);
    }
}

#[test]
fn a_scan_without_tag_stays_as_it_is() {
    for noise in [0.0, 22.0] {
        let (lumen, both) = found(&scan(DIMS, SPACING, noise, |p| colon(p, FLESH, AIR, 0.0)), Scan::Sound);
        assert_eq!(lumen.segments.len(), 1, "the colon is found");
        all_idle(&both, "without tag");
    }
}

/// No wall is in view, and no side is down.
#[test]
fn a_body_that_is_as_bright_as_tag_is_left_with_a_reason() {
    let bright = scan(DIMS, SPACING, 0.0, |p| colon(p, 600.0, AIR, 0.0));
    let (lumen, [whole, flown]) = found(&bright, Scan::Sound);
    assert_eq!(lumen.segments.len(), 1, "the colon is found");
    assert!(whole.changes.is_empty() && flown.changes.is_empty(), "the body is not taken for tag");
    assert!(!whole.left.is_empty(), "what is left is told");
}

/// The colon leaves the scan at both ends and on one side: with its fluid only, and with its gas, which is outside air then.
#[test]
fn tag_is_taken_up_to_the_rim_of_the_scan() {
    let cut = |level: f64| {
        let at = |p: DVec3| p - DVec3::new(12.7, 0.0, 0.0);
        scan(DIMS, SPACING, 0.0, |p| mix(FLESH, mix(AIR, TAG, level - p.y), capsule(at(p), 14.0, 1e3)))
    };
    let (lumen, both) = found(&cut(-8.0), Scan::Sound);
    assert_eq!(lumen.segments.len(), 1, "the colon is found");
    assert!(both.iter().all(|made| made.pools.len() == 1), "fluid at the rim has one level: {}", both[0]);
    let (lumen, both) = found(&cut(0.0), Scan::Sound);
    assert!(lumen.segments.is_empty(), "gas that leaves on a side is outside");
    all_idle(&both, "no lumen at the rim");
}

/// A ball of metal in the fluid, and one beside it, with streaks in the slices around it, within the scanner's range.
#[test]
fn metal_and_its_streaks_are_lived_with() {
    for [x, y] in [[7.0, 7.0], [16.0, 10.0]] {
        let streaked = scan(DIMS, SPACING, 10.0, |p| {
            let from = p - DVec3::new(x, y, 0.0);
            let fading = (-from.truncate().length() / 20.0 - (from.z / 6.0).powi(2)).exp();
            let streak = 1000.0 * (10.0 * from.y.atan2(from.x)).cos() * fading;
            mix(colon(p, FLESH, TAG, 2.0) + streak, 3071.0, from.length() - 4.0).clamp(-1024.0, 3071.0)
        });
        let (lumen, _) = found(&streaked, Scan::Noisy);
        assert!(lumen.gas_ml() > 5.0, "the colon is found beside metal at {x}, {y} mm");
    }
}

/// A tube full of fluid beside the colon, alone and with a passage below the level.
#[test]
fn a_tube_full_to_the_top_has_no_level_of_its_own() {
    for is_joined in [false, true] {
        let full = |p: DVec3| capsule(p - DVec3::new(18.0, 0.0, 0.0), 8.0, 30.0);
        let passage = |p: DVec3| p.distance(DVec3::new(p.x.clamp(-12.0, 18.0), 6.0, 0.0)) - 4.0;
        let tubes = scan(WIDE, SPACING, 0.0, |p| {
            let wet = if is_joined { full(p).min(passage(p)) } else { full(p) };
            colon(p + DVec3::new(12.0, 0.0, 0.0), mix(FLESH, TAG, wet), TAG, 2.0)
        });
        for made in found(&tubes, Scan::Sound).1 {
            assert_eq!(made.pools.len(), 1, "one level: {made}");
            assert!(is_joined || changed(&tubes, &made, |p| full(p) < 0.0) == 0, "the full tube stays");
        }
    }
}

/// Scanners and files of 11 bits end at 1023 HU, and others cut off noise below air.
#[test]
fn values_that_are_clipped_are_cleansed() {
    for (low, high) in [(i16::MIN, 1023), (-1000, 1023), (-1000, 3071)] {
        let raw = scan(DIMS, SPACING, 20.0, |p| colon(p, FLESH, 1500.0, 2.0));
        let clipped = raw.data().iter().map(|hu| (*hu).clamp(low, high)).collect();
        for made in found(&Volume::new(raw.grid().clone(), clipped), Scan::Sound).1 {
            assert_eq!(made.pools.len(), 1, "{low} to {high} HU: {made}");
            let (hu, most) = (made.pools[0].tag_hu, f64::from(high).min(1500.0));
            assert!((hu - most).abs() < 0.05 * most, "tag of {most} HU is told to be of {hu}");
        }
    }
}

/// Contrast agent in small bowel, with 2.5 mm of tissue between it and the colon's fluid or gas.
#[test]
fn small_bowel_beside_the_wall_stays_bright() {
    for level in [-3.0, 5.0] {
        let bowel = |p: DVec3| capsule(p - DVec3::new(12.5, 0.0, 0.0), 10.0, 30.0);
        let colon = |p: DVec3| colon(p + DVec3::new(14.0, 0.0, 0.0), mix(FLESH, 400.0, bowel(p)), TAG, level);
        let beside = scan(WIDE, SPACING, 0.0, colon);
        for made in found(&beside, Scan::Sound).1 {
            assert_eq!(made.pools.len(), 1, "the colon's pool is taken: {made}");
            // Its edge is blurred into the wall, which is the colon's.
            assert_eq!(changed(&beside, &made, |p| bowel(p) < -0.5), 0, "voxels of the bowel, level at {level} mm");
        }
    }
}

#[test]
fn a_bladder_below_the_wall_stays_bright() {
    let bladder = |p: DVec3| p.distance(DVec3::new(0.0, 26.0, 0.0)) - 25.0;
    let colon = |p: DVec3| colon(p + DVec3::new(0.0, 16.0, 0.0), mix(FLESH, 300.0, bladder(p)), TAG, 2.0);
    let above = scan(DEEP, SPACING, 0.0, colon);
    for made in found(&above, Scan::Sound).1 {
        assert_eq!(made.pools.len(), 1, "the colon's pool is taken: {made}");
        assert_eq!(changed(&above, &made, |p| bladder(p) < -0.5), 0, "voxels of the bladder");
    }
}

#[test]
fn voxels_of_any_edges_are_cleansed() {
    for (dims, spacing) in [([104, 104, 20], DVec3::new(0.5, 0.5, 5.0)), ([24, 24, 44], DVec3::splat(2.5))] {
        let coarse = scan(dims, spacing, 0.0, |p| colon(p, FLESH, TAG, 2.0));
        let (lumen, both) = found(&coarse, Scan::Sound);
        assert_eq!(lumen.segments.len(), 1, "the colon is found in voxels of {spacing} mm");
        assert!(both.iter().all(|made| made.replaced_ml > 1.0), "in voxels of {spacing} mm {}", both[0]);
    }
}

/// Noise of a third of the contrast of the wall to gas, which hides the level and all else.
#[test]
fn extreme_noise_is_lived_with() {
    found(&tagged(300.0), Scan::Noisy);
}

#[test]
fn volumes_of_one_value_and_of_any_values_give_numbers() {
    let sound = tagged(0.0);
    // That of another scan, which has gas and a level where these have none.
    let other = found(&sound, Scan::Sound).0;
    let all = [i16::MIN, -1024, -1000, -650, 40, 181, 600, 3071, i16::MAX];
    for hu in all.into_iter().step_by(cases(1, 4)) {
        let constant = Volume::new(sound.grid().clone(), vec![hu; sound.data().len()]);
        let (lumen, both) = found(&constant, Scan::Sound);
        assert!(lumen.segments.is_empty(), "there is no colon in {hu} HU");
        all_idle(&both, "one value throughout");
        cleansed(&constant, &other, Scan::Senseless);
    }
    for seed in 0..2 {
        found(&random(seed), Scan::Senseless);
        cleansed(&random(seed), &other, Scan::Senseless);
    }
}

#[test]
fn a_lumen_of_nothing_leaves_every_scan_as_it_is() {
    for scan in [tagged(0.0), random(3)] {
        all_idle(&cleansed(&scan, &Lumen::none(scan.grid()), Scan::Sound), "no lumen");
    }
}

#[test]
fn an_interrupted_job_ends_with_status_4() {
    let scan = tagged(0.0);
    let lumen = found(&scan, Scan::Sound).0;
    assert!(lumen.fluid_ml() > 1.0, "there is something to do");
    let progress = Progress::new();
    progress.cancel();
    for (name, way) in WAYS {
        let status = way(&scan, &lumen, &progress).err().map(|e| e.kind as i32);
        assert_eq!(status, Some(4), "{name}");
    }
}
