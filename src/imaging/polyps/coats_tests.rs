use glam::DMat3;

use super::*;
use crate::checks::cases;
use crate::fields::{cleanse, lumen};
use crate::math::hash;
use crate::phantom::{Beside, PhantomSettings, Size};
use crate::polyps::tests::wall_at;
use crate::shared::shared;
use crate::volume::Grid;

const SIGMA: f64 = 0.7;

/// A room of gas, 40 × 40 × 30 mm, whose floor at z = 0 wears a coat as thick as `coat` says of x and y, mm, under noise, HU.
fn room(spacing: DVec3, noise: f64, coat: impl Fn(f64, f64) -> f64) -> Volume {
    let size = DVec3::new(52.0, 52.0, 46.0);
    let dims = (size / spacing).ceil().to_array().map(|n| n as usize);
    let grid = Grid::new(dims, spacing, DVec3::new(-26.0, -26.0, -8.0), DMat3::IDENTITY).unwrap();
    let hu = |n: usize| {
        let p = grid
            .world(DVec3::from_array([n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])].map(|c| c as f64)));
        let walls = (p.x.abs() - 20.0).max(p.y.abs() - 20.0).max(p.z - 30.0);
        let tissue = normal::cdf(walls.max(-p.z) / SIGMA);
        let tag = normal::cdf((coat(p.x, p.y) - p.z) / SIGMA).max(tissue) - tissue;
        let tag = if walls < -3.0 { tag } else { 0.0 };
        (-1000.0 + 1040.0 * tissue + 1500.0 * tag + noise * hash::normal(5, n as u64)).round() as i16
    };
    let data = (0..grid.len()).map(hu).collect();
    Volume::new(grid, data)
}

fn disc(radius: f64, mm: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, y| if x.hypot(y) < radius { mm } else { 0.0 }
}

/// The spots of a room with that coat on its floor, whose tag is known to have 500 HU.
fn spots(spacing: DVec3, noise: f64, coat: impl Fn(f64, f64) -> f64) -> (Wall, Coats) {
    let bare = room(spacing, noise, |_, _| 0.0);
    let (_, wall) = wall_at(&bare, DVec3::new(0.0, 0.0, 15.0));
    let pool = CleansedPool { ml: 1.0, tag_hu: 500.0, level: [DVec3::Z * 1e3, DVec3::Z] };
    let cleansed = Cleansed { pools: vec![pool], blur_mm: SIGMA, ..Cleansed::default() };
    let coats = Coats::find(&wall, &room(spacing, noise, coat), Some(&cleansed), &Progress::new()).unwrap();
    (wall, coats)
}

#[test]
fn a_coat_is_found_with_its_area_and_thickness() {
    for (spacing, noise) in [(DVec3::splat(0.7), 0.0), (DVec3::new(0.7, 0.7, 1.0), 25.0)].into_iter().take(cases(2, 1))
    {
        for mm in [1.1, 1.5, 2.0, 2.5] {
            let (wall, coats) = spots(spacing, noise, disc(6.0, mm));
            let [spot] = coats.spots[..] else { panic!("{mm} mm: {:?}", coats.spots) };
            assert!(spot.place.distance(DVec3::ZERO) < 2.0 && spot.normal.z > 0.9, "{mm} mm: {spot:?}");
            let area = std::f64::consts::PI * 36.0;
            assert!((0.7 * area..1.25 * area).contains(&spot.area_mm2), "{mm} mm: {spot:?}");
            assert!((spot.thickness_mm - mm).abs() < 0.35, "{mm} mm: {spot:?}");
            let here = coats.at(&wall, DVec3::ZERO, 4.0);
            assert!(here.share > 0.95 && (here.thickness_mm - mm).abs() < 0.35, "{mm} mm: {here:?}");
            assert_eq!(coats.at(&wall, DVec3::new(13.0, 0.0, 0.0), 4.0), Coated::default());
            assert_eq!(coats.at(&wall, DVec3::splat(500.0), 4.0), Coated::default());
            // Each of several by itself, in one go.
            let places = [DVec3::ZERO, DVec3::new(13.0, 0.0, 0.0), DVec3::splat(1e300), DVec3::new(0.5, 0.0, 0.2)];
            let several: Vec<Candidate> = places.map(|p| Candidate::new(p, 1.0)).into();
            let each = several.iter().map(|c| coats.at(&wall, c.position, 4.0)).collect::<Vec<_>>();
            assert_eq!(coats.of_each(&wall, &several), each);
            assert_eq!(each[0], here);
        }
    }
}

#[test]
fn bare_walls_thick_tag_and_specks_have_no_coat() {
    let spacing = DVec3::splat(0.7);
    for (what, noise, radius, mm) in [
        ("bare", 30.0, 6.0, 0.0),
        ("thick", 0.0, 8.0, 6.0),
        ("a speck", 0.0, 0.9, 1.5),
        ("a film that nobody sees", 0.0, 6.0, 0.2),
    ] {
        let (_, coats) = spots(spacing, noise, disc(radius, mm));
        assert!(coats.spots.is_empty(), "{what}: {:?}", coats.spots);
    }
    // The rim of a heap that thins out is a part of it.
    let (_, coats) = spots(spacing, 0.0, |x, y| (7.0 - 1.5 * x.hypot(y)).max(0.0));
    assert!(coats.spots.is_empty(), "{:?}", coats.spots);
}

#[test]
fn a_pool_is_no_coat_however_shallow() {
    let spacing = DVec3::splat(0.7);
    let shallow = room(spacing, 0.0, |_, _| 1.5);
    let (_, wall) = wall_at(&room(spacing, 0.0, |_, _| 0.0), DVec3::new(0.0, 0.0, 15.0));
    let find = |level: f64| {
        let pool = CleansedPool { ml: 1.0, tag_hu: 500.0, level: [DVec3::Z * level, DVec3::Z] };
        let cleansed = Cleansed { pools: vec![pool], ..Cleansed::default() };
        Coats::find(&wall, &shallow, Some(&cleansed), &Progress::new()).unwrap().spots.len()
    };
    assert_eq!([find(1.5), find(20.0)], [0, 1]);
}

/// On phantoms, films are found and pools, their rims, stool and dry wall are not.
#[test]
fn films_of_a_phantom_are_coats_and_its_pools_are_not() {
    let progress = Progress::new();
    let settings = PhantomSettings {
        size: Size::Small,
        pools: true,
        films: true,
        stool: true,
        seed: 3,
        ..PhantomSettings::default()
    };
    let (phantom, scanned) = shared(&settings);
    let before = lumen::find(&scanned, &progress).unwrap();
    let cleansed = cleanse::cleanse(&scanned, &before, &progress).unwrap();
    let clean = cleansed.changes.applied(&scanned);
    let after = lumen::find(&clean, &progress).unwrap();
    let wall = Wall::new(&clean, &after, -650.0, &progress).unwrap();
    let coats = Coats::find(&wall, &scanned, Some(&cleansed), &progress).unwrap();
    let mut areas = [[0.0; 2]; 6];
    for v in 0..wall.len() as u32 {
        let Some(place) = phantom.wall_at(wall.world(v)) else { continue };
        let kind = match place.beside {
            Beside::Gas => 0,
            Beside::Near => 1,
            Beside::Rim => 2,
            Beside::Fluid => 3,
            Beside::Film => 4,
            Beside::Stool => 5,
        };
        areas[kind][0] += f64::from(wall.area(v));
        areas[kind][1] += if coats.thickness(v) > 0.0 { f64::from(wall.area(v)) } else { 0.0 };
    }
    println!("of gas, near, rim, fluid, film, stool: {areas:.0?}; {} spots", coats.spots.len());
    let share = |kind: usize| areas[kind][1] / areas[kind][0].max(1.0);
    assert!(share(0) < 0.002 && share(3) < 0.02, "{areas:?}");
    assert!(share(4) > 0.08, "{areas:?}");
    let all: f64 = areas.iter().map(|a| a[1]).sum();
    assert!(areas[4][1] > 0.9 * all, "most of it are films: {areas:?}");
}
