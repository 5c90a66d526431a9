use std::sync::OnceLock;

use glam::DMat3;

use super::*;
use crate::phantom::{Phantom, PhantomSettings, Scanner, Size};
use crate::volume::Grid;

fn scanned(blur_mm: f64, slice_mm: Option<f64>) -> Volume {
    let settings =
        PhantomSettings { size: Size::Small, folds: true, polyps: false, noise: true, ..PhantomSettings::default() };
    let scanner = Scanner { noise_hu: 20.0, blur_mm: Some(blur_mm), slice_mm, ..Scanner::default() };
    Phantom::scanned(&settings, scanner).scan(&Progress::new()).unwrap()
}

/// A phantom, and itself with lesions.
fn grafted() -> &'static (Volume, Grafted) {
    static GRAFTED: OnceLock<(Volume, Grafted)> = OnceLock::new();
    GRAFTED.get_or_init(|| {
        let volume = scanned(0.58, None);
        let made = graft(volume.clone(), 3, 10, &Progress::new()).unwrap();
        (volume, made)
    })
}

#[test]
fn the_blur_of_a_scan_is_measured_at_its_walls() {
    // Thick slices are a box, of variance h²/12, on top of the blur.
    for (blur_mm, slice_mm) in [(0.45, None), (0.58, None), (0.9, None), (0.58, Some(2.0))] {
        let volume = scanned(blur_mm, slice_mm);
        let lumen = lumen::find(&volume, &Progress::new()).unwrap();
        let wall = Wall::new(&volume, &lumen, HALF_HU, &Progress::new()).unwrap();
        let spread = Spread::of(&volume, &wall).unwrap();
        let z = slice_mm.map_or(blur_mm, |h| (blur_mm * blur_mm + h * h / 12.0).sqrt());
        println!("{blur_mm} {slice_mm:?}: {spread:?}");
        assert!((spread.sigma_mm[0] - blur_mm).abs() < 0.06, "{blur_mm} {slice_mm:?}: {spread:?}");
        assert!((spread.sigma_mm[1] - z).abs() < 0.12, "{blur_mm} {slice_mm:?}: {spread:?}");
        // The phantom's wall is hardly thicker than the blur.
        assert!(spread.sharpness == 0.0 && (-10.0..50.0).contains(&spread.tissue_hu), "{spread:?}");
    }
}

#[test]
fn noise_that_is_added_is_correlated_as_that_of_the_scan() {
    // White noise, averaged over neighbours along x and y: correlations of ½, ¼, 0 and so on.
    let grid = Grid::new([66, 66, 40], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let dims = grid.dims();
    let white = |i: usize, j: usize, k: usize| math_normal((i + 70 * (j + 70 * k)) as u64);
    let hu = |n: usize| {
        let (i, j, k) = (n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1]));
        let sum = white(i, j, k) + white(i + 1, j, k) + white(i, j + 1, k) + white(i + 1, j + 1, k);
        (40.0 + 15.0 * 0.5 * sum).round() as i16
    };
    let volume = Volume::new(grid.clone(), (0..grid.len()).map(hu).collect());
    let noise = Noise::of(&volume);
    assert!((noise.level().tissue_hu - 15.0).abs() < 1.0, "{:?}", noise.level());
    let correlation = |d: [i64; 3]| {
        let (mut sum, mut square) = (0.0, 0.0);
        for n in 0..6000i64 {
            let at = [5 * (n % 20), 7 * (n / 20 % 20), 5 * (n / 400)];
            let [a, b] = [at, std::array::from_fn(|x| at[x] + d[x])].map(|v| noise.at(7, v));
            sum += a * b;
            square += a * a;
        }
        (sum / square, square / 6000.0)
    };
    for (d, expected) in
        [([0, 0, 0], 1.0), ([1, 0, 0], 0.5), ([0, 1, 0], 0.5), ([1, 1, 0], 0.25), ([0, 0, 1], 0.0), ([3, 0, 0], 0.0)]
    {
        let (found, variance) = correlation(d);
        assert!((found - expected).abs() < 0.07, "{d:?}: {found}");
        assert!((variance - 1.0).abs() < 0.1, "{variance}");
    }
}

fn math_normal(counter: u64) -> f64 {
    crate::math::hash::normal(11, counter)
}

#[test]
fn only_the_voxels_of_lesions_change_and_all_of_theirs() {
    let (before, made) = grafted();
    let grid = before.grid();
    let [nx, ny, _] = grid.dims();
    assert!(made.truth.polyps.len() >= 8, "{} lesions", made.truth.polyps.len());
    let mut added = vec![0.0; made.truth.polyps.len()];
    for (n, (a, b)) in before.data().iter().zip(made.volume.data()).enumerate() {
        let place = grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / (nx * ny)) as f64));
        let gap = |p: &TruePolyp| p.position.distance(place) - 0.5 * p.diameter_mm;
        let nearest = made.truth.polyps.iter().enumerate().min_by(|a, b| gap(a.1).total_cmp(&gap(b.1))).unwrap();
        if a != b {
            // A stalk, and the blur.
            assert!(gap(nearest.1) < 14.0, "{place} changed, {} mm from a lesion", gap(nearest.1));
        }
        added[nearest.0] += f64::from(b - a) * 1000.0 * grid.voxel_ml() / 1020.0;
    }
    // The blur keeps the sum: what is added is the lesion's volume of tissue instead of gas, but for the wall's edge beneath.
    let all: f64 = made.truth.polyps.iter().filter_map(|p| p.volume_mm3).sum();
    let share = added.iter().sum::<f64>() / all;
    assert!((share - 1.0).abs() < 0.06, "{share}");
    for (polyp, added) in made.truth.polyps.iter().zip(added) {
        let volume = polyp.volume_mm3.unwrap();
        assert!((added / volume - 1.0).abs() < 0.2, "{added} of {volume}: {polyp:?}");
        let h = polyp.height_mm.unwrap();
        assert!(h > 1.2 && h < 30.0 && polyp.diameter_mm > 2.0, "{polyp:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_scan_on_any_number_of_threads() {
    let (before, made) = grafted();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = pool.install(|| graft(before.clone(), 3, 10, &Progress::new())).unwrap();
    assert!(made.volume.data() == again.volume.data());
    assert_eq!(serde_json::to_string(&made.truth).unwrap(), serde_json::to_string(&again.truth).unwrap());
    let other = graft(before.clone(), 4, 2, &Progress::new()).unwrap();
    assert!(made.volume.data() != other.volume.data());
}

/// The surface of the scan with a lesion is where the lesion was drawn: its tissue ends half-way.
#[test]
fn a_lesion_ends_half_way_where_its_truth_says() {
    let (before, made) = grafted();
    let grid = before.grid();
    let [at, was] = [&made.volume, before].map(|v| move |p: DVec3| trilinear(v, grid.voxel(p)));
    for polyp in made.truth.polyps.iter().filter(|p| p.shape == PolypShape::Stalked && p.diameter_mm > 5.0) {
        let steps = || (0..200).map(|n| 0.1 * f64::from(n));
        let to_wall = |d: &DVec3| steps().find(|mm| was(polyp.position + d * *mm) > HALF_HU).unwrap_or(f64::INFINITY);
        let all: Vec<DVec3> = crate::math::sphere::directions(600).collect();
        let down = *all.iter().min_by(|a, b| to_wall(a).total_cmp(&to_wall(b))).unwrap();
        // Across the stalk, where there is gas on both sides: the longest is the diameter, to the blur's σ²/R.
        let mut longest = 0f64;
        for &d in all.iter().filter(|d| d.dot(down).abs() < 0.3) {
            let end = |d: DVec3| steps().find(|mm| at(polyp.position + d * *mm) < HALF_HU);
            if let (Some(a), Some(b)) = (end(d), end(-d)) {
                longest = longest.max(a + b);
            }
        }
        assert!((longest - polyp.diameter_mm).abs() < 0.8, "{longest}: {polyp:?}");
    }
}

#[test]
fn a_slice_of_few_values_gets_no_others() {
    let grid = Grid::new([4, 2, 2], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let mut volume = Volume::new(grid, vec![-1000, -1000, -980, 0, 20, 40, 40, 60, 1, 2, 3, 4, 5, 6, 7, 8]);
    apply(&mut volume, [([0, 0, 0], 1031.0), ([1, 0, 0], 1e9), ([2, 0, 0], -1e9), ([0, 0, 1], 2.4)].into_iter());
    assert_eq!(volume.data(), [40, 60, -1000, 0, 20, 40, 40, 60, 3, 2, 3, 4, 5, 6, 7, 8]);
}

#[test]
fn wishes_have_their_shares_of_any_number() {
    for count in [1, 2, 20, 200] {
        let all = wishes(5, count);
        assert_eq!(all.len(), count);
        assert!(all.iter().all(|w| w.diameter_mm >= 3.5 && w.diameter_mm <= 20.0), "{all:?}");
    }
    let all = wishes(5, 200);
    let share = |is: &dyn Fn(&Wish) -> bool| all.iter().filter(|w| is(w)).count();
    assert_eq!(share(&|w| w.shape == PolypShape::Flat), 60);
    assert_eq!(share(&|w| w.site == PolypSite::Fold), 60);
    assert!((20..60).contains(&share(&|w| w.under)) && (20..80).contains(&share(&|w| w.coated)));
}

#[test]
fn a_scan_without_a_colon_is_refused() {
    let grid = Grid::new([40; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    for hu in [-1000, 40] {
        let volume = Volume::new(grid.clone(), vec![hu; grid.len()]);
        let refused = graft(volume, 1, 5, &Progress::new()).unwrap_err();
        assert_eq!(refused.kind, crate::error::Kind::Incomplete, "{refused}");
    }
}

/// What a patch of wall looks like: how wide its edge is, mm; HU and their deviation at two depths; how rough they are; the gas before it.
const LOOKS: usize = 7;
type Look = [f64; LOOKS];

/// Returns the mean look of some vertices of a wall.
fn look(volume: &Volume, wall: &Wall, vertices: &[u32]) -> Look {
    let at = |v: u32, mm: f64| trilinear(volume, volume.grid().voxel(wall.world(v) - wall.normal(v).as_dvec3() * mm));
    let depth = |v: u32, level: f64| {
        let steps = (0..60).map(|n| -3.0 + 0.1 * f64::from(n));
        steps.zip(1..).find(|(mm, _)| at(v, *mm) > level).map_or(3.0, |s| s.0)
    };
    let mean = |of: &dyn Fn(u32) -> f64| vertices.iter().map(|&v| of(v)).sum::<f64>() / vertices.len() as f64;
    let moment = |mm: f64| {
        let m = mean(&|v| at(v, mm));
        [m, mean(&|v| (at(v, mm) - m).powi(2)).sqrt()]
    };
    let ([shallow, one], [deep, other]) = (moment(1.5), moment(2.5));
    let rough = mean(&|v| (at(v, 1.5) - 0.5 * (at(v, 1.0) + at(v, 2.0))).abs());
    [mean(&|v| depth(v, -270.0) - depth(v, -720.0)), shallow, one, deep, other, rough, mean(&|v| at(v, -2.0))]
}

/// Returns the area under the curve of a logistic classifier of looks, each judged by what the other pairs taught.
fn told_apart(pairs: &[[Look; 2]]) -> f64 {
    let all = || pairs.iter().flatten();
    let count = 2.0 * pairs.len() as f64;
    let mean: Look = std::array::from_fn(|f| all().map(|l| l[f]).sum::<f64>() / count);
    let sd: Look =
        std::array::from_fn(|f| (all().map(|l| (l[f] - mean[f]).powi(2)).sum::<f64>() / count).sqrt().max(1e-9));
    let row = |l: &Look| -> Look { std::array::from_fn(|f| (l[f] - mean[f]) / sd[f]) };
    let mut scores = Vec::new();
    for (n, pair) in pairs.iter().enumerate() {
        let (mut w, mut bias) = ([0.0; LOOKS], 0.0);
        for _ in 0..300 {
            let (mut step, mut up) = ([0.0; LOOKS], 0.0);
            for (_, other) in pairs.iter().enumerate().filter(|o| o.0 != n) {
                for (look, truth) in other.iter().zip([1.0, 0.0]) {
                    let x = row(look);
                    let z = bias + x.iter().zip(w).map(|(x, w)| x * w).sum::<f64>();
                    let off = truth - 1.0 / (1.0 + (-z).exp());
                    up += off;
                    step.iter_mut().zip(x).for_each(|(s, x)| *s += off * x);
                }
            }
            bias += up / count;
            w.iter_mut().zip(step).for_each(|(w, s)| *w += s / count - 0.01 * *w);
        }
        let judge = |l: &Look| row(l).iter().zip(w).map(|(x, w)| x * w).sum::<f64>();
        scores.push([judge(&pair[0]), judge(&pair[1])]);
    }
    let wins = scores.iter().flat_map(|a| scores.iter().map(move |b| if a[0] > b[1] { 1.0 } else { 0.0 }));
    wins.sum::<f64>() / (pairs.len() * pairs.len()) as f64
}

/// Puts sixty lesions into a scan. Returns the looks of their rims, of the same places without lesions, and of the lesions' surfaces, each
/// with that of the wall around.
fn rims_and_surfaces(before: &Volume, seed: u64) -> [Vec<[Look; 2]>; 3] {
    let progress = Progress::new();
    let made = graft(before.clone(), seed, 60, &progress).unwrap();
    assert!(made.truth.polyps.len() >= 55, "{}", made.truth.polyps.len());
    let lumen = lumen::find(&made.volume, &progress).unwrap();
    let wall = Wall::new(&made.volume, &lumen, HALF_HU, &progress).unwrap();
    let grid = before.grid();
    let change = |p: DVec3| trilinear(&made.volume, grid.voxel(p)) - trilinear(before, grid.voxel(p));
    let (mut rims, mut untouched, mut surfaces) = (Vec::new(), Vec::new(), Vec::new());
    for polyp in made.truth.polyps.iter().filter(|p| !p.submerged && !p.coated) {
        let near: Vec<u32> = (0..wall.len() as u32)
            .filter(|&v| wall.world(v).distance(polyp.position) < 0.5 * polyp.diameter_mm + 14.0)
            .collect();
        let gap = |v: u32| wall.world(v).distance(polyp.position) - 0.5 * polyp.diameter_mm;
        let moved = |v: u32| trilinear(before, grid.voxel(wall.world(v))) < HALF_HU - 250.0;
        let is_touched = |v: u32| (0..7).any(|n| change(wall.world(v) + 1.2 * axis(n)).abs() > 5.0);
        // The same wall in both: flat, without tag, with gas before it and tissue behind.
        let hu = |v: u32, mm: f64| trilinear(&made.volume, grid.voxel(wall.world(v) - wall.normal(v).as_dvec3() * mm));
        let flat = |v: u32| {
            let is_tissue = [1.2, 2.0, 2.8, 3.6].iter().all(|mm| (-350.0..200.0).contains(&hu(v, *mm)));
            is_tissue && hu(v, -2.0) < -800.0 && wall.curvatures(v).iter().all(|k| k.abs() < 0.15)
        };
        let of = |is: &dyn Fn(u32) -> bool| -> Vec<u32> { near.iter().copied().filter(|&v| is(v)).collect() };
        let rim = of(&|v| is_touched(v) && change(wall.world(v)).abs() < 60.0 && flat(v));
        let around = of(&|v| !is_touched(v) && (2.0..8.0).contains(&gap(v)) && flat(v));
        let surface = of(&|v| moved(v) && hu(v, -2.0) < -800.0);
        if rim.len() < 20 || around.len() < 50 || surface.len() < 20 {
            continue;
        }
        let there = look(&made.volume, &wall, &around);
        rims.push([look(&made.volume, &wall, &rim), there]);
        untouched.push([look(before, &wall, &rim), there]);
        surfaces.push([look(&made.volume, &wall, &surface), there]);
    }
    [rims, untouched, surfaces]
}

#[test]
#[ignore = "slow: puts lesions into a CT, twice"]
fn the_rim_of_a_lesion_looks_like_the_wall_around_it() {
    let Some(path) = crate::scans::data("ctc_prone.nii.gz") else { return };
    let options = crate::volume::io::LoadOptions::default();
    let before = crate::volume::io::load(&path, &options, &Progress::new()).unwrap().volume;
    let [mut rims, mut untouched, mut surfaces] = rims_and_surfaces(&before, 1);
    for (all, more) in [&mut rims, &mut untouched, &mut surfaces].into_iter().zip(rims_and_surfaces(&before, 2)) {
        all.extend(more);
    }
    for (name, pairs) in [("rim", &rims), ("the same places without lesions", &untouched), ("surface", &surfaces)] {
        println!("{name}: {} pairs, AUC {:.2}", pairs.len(), told_apart(pairs));
        for side in 0..2 {
            let mean: Look =
                std::array::from_fn(|f| pairs.iter().map(|p| p[side][f]).sum::<f64>() / pairs.len() as f64);
            println!("  {}", mean.map(|m| format!("{m:8.2}")).join(" "));
        }
    }
    assert!(rims.len() >= 50, "{}", rims.len());
    // Where lesions find room, the wall differs from that around by itself.
    let [with, without] = [told_apart(&rims), told_apart(&untouched)];
    assert!(with <= without + 0.02, "{with}, without lesions {without}");
}

fn axis(n: usize) -> DVec3 {
    let mut unit = [0.0; 3];
    if n > 0 {
        unit[(n - 1) / 2] = if n.is_multiple_of(2) { 1.0 } else { -1.0 };
    }
    DVec3::from_array(unit)
}
