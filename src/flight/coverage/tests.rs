//! Coverage of shapes whose shadows are known in closed form.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};

use super::missed::{self, LEAST_MM2, Missed};
use super::{Coverage, CoveragePaint, LiveCoverage, LookFrom, Sight, Wall, paint_slice};
use crate::components::still::{StillView, StillViews};
use crate::dynamics::Attitude;
use crate::fields::{AlongColon, ClearanceFinder, lumen};
use crate::progress::Progress;
use crate::render::camera::Perspective;
use crate::render::slice::{Slice, SlicePlane};
use crate::render::{Frame, View};
use crate::space::{PreparedVolume, TransferFunction, first_crossing};
use crate::volume::{Grid, Volume};

/// A volume whose wall at −650 HU is where a signed distance (mm, negative in the gas) is 0, on a grid of `h` mm.
fn volume([low, high]: [DVec3; 2], h: f64, distance: impl Fn(DVec3) -> f64) -> PreparedVolume {
    let dims = ((high - low) / h).ceil().as_u64vec3().to_array().map(|n| n as usize);
    let grid = Grid::new(dims, DVec3::splat(h), low, DMat3::IDENTITY).unwrap();
    let hu = |n: usize| {
        let v = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
        let d = distance(grid.world(DVec3::from_array(v.map(|x| x as f64))));
        (-650.0 + (d / h * 350.0).clamp(-350.0, 690.0)).round() as i16
    };
    let data = (0..grid.len()).map(hu).collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

fn wall(volume: &PreparedVolume, at: DVec3) -> Wall {
    let gas = lumen::gas_at(volume.voxels(), at, &Progress::new()).unwrap().unwrap();
    Wall::of(volume.voxels(), &gas, &[0], volume.transfer().iso(), &Progress::new()).unwrap()
}

/// Views along z, from `from` to `to`, `step` mm apart.
fn along_z([from, to]: [f64; 2], step: f64) -> Vec<(DVec3, Attitude)> {
    let count = ((to - from) / step).round() as usize;
    (0..=count).map(|n| (DVec3::Z * (from + step * n as f64), Attitude::new(DVec3::Z, DVec3::X))).collect()
}

fn seen(wall: &Wall, volume: &PreparedVolume, views: &[(DVec3, Attitude)], count: bool) -> (Vec<Sight>, Coverage) {
    let sights = wall.seen(volume, views, &Perspective::new(90.0).unwrap(), count, &Progress::new()).unwrap();
    let coverage = wall.coverage(&sights);
    (sights, coverage)
}

/// Radius of the tube and of the holes in its rings, the rings' thickness, and where each begins, mm.
const R: f64 = 10.0;
const HOLE: f64 = 7.0;
const THICK: f64 = 2.0;
const RINGS: [f64; 3] = [30.0, 52.0, 74.0];
const LENGTH: f64 = 96.0;

/// A tube from z = 0 to its length with three rings, each with a round hole.
fn ringed(p: DVec3) -> f64 {
    let r = p.truncate().length();
    let tube = (r - R).max(-p.z).max(p.z - LENGTH);
    RINGS.iter().fold(tube, |d, &z| {
        let ring = (HOLE - r).max(z - p.z).max(p.z - z - THICK);
        d.max(-ring)
    })
}

#[test]
fn patches_and_blocks_are_those_of_their_triangles_on_any_number_of_threads() {
    let volume = volume([DVec3::new(-12.0, -12.0, -2.0), DVec3::new(12.0, 12.0, LENGTH + 2.0)], 0.3, ringed);
    let wall = wall(&volume, DVec3::Z * 10.0);
    assert!(wall.len() > 2 << 16, "{} triangles are measured in one go", wall.len());
    let mut before = None;
    for block in 0..wall.block_count() {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for patch in wall.patches_of(block) {
            let these = wall.triangles_of(patch);
            let own = wall.middle(patch).patch();
            assert!(before < Some(own) && these.contains(&(wall.patches[patch].middle as usize)));
            for face in these.map(|n| wall.face(n)) {
                assert_eq!(face.patch(), own);
                (low, high) = (low.min(face.centroid), high.max(face.centroid));
            }
            before = Some(own);
        }
        assert_eq!((wall.blocks[block].low, wall.blocks[block].high), (low, high));
    }
    let all: f64 = (0..wall.patch_count()).flat_map(|p| wall.triangles_of(p)).map(|n| wall.mm2_at(n)).sum();
    assert_eq!(all, wall.mm2());
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = alone.install(|| self::wall(&volume, DVec3::Z * 10.0));
    assert_eq!((&again.places, &again.triangles), (&wall.places, &wall.triangles));
    assert_eq!(format!("{:?}", again.patches), format!("{:?}", wall.patches));
}

#[test]
fn a_part_measures_its_triangles_as_the_whole_and_all_of_it_is_no_copy() {
    let volume = volume([DVec3::splat(-12.0), DVec3::splat(12.0)], 0.8, |p| p.length() - 9.0);
    let wall = wall(&volume, DVec3::ZERO);
    let (all, numbers) = wall.part(|_| true);
    assert!(Arc::ptr_eq(&all.triangles, &wall.triangles) && Arc::ptr_eq(&all.places, &wall.places));
    assert!(numbers.len() == wall.len() && Arc::ptr_eq(&all.patches, &wall.patches));
    let (part, numbers) = wall.part(|n| n % 3 == 1);
    assert!(numbers.iter().all(|n| n % 3 == 1) && part.len() == numbers.len());
    for (n, &whole) in numbers.iter().enumerate() {
        assert_eq!(part.face(n), wall.face(whole as usize));
    }
    assert!(part.bytes() < wall.bytes() && wall.part(|_| false).0.is_empty());
}

/// Flying along the axis with a square picture of 90°, a place of the tube is seen from no nearer than `R m` before it, with `m` =
/// max(|cos|, |sin|) of its angle about the axis. Behind a ring of height `h` a strip `h m` wide is therefore never seen (with similar
/// triangles), and the ring's rear faces away. The mean of `m` is 2√2/π.
#[test]
fn a_ringed_tube_has_the_shadow_of_its_rings() {
    let volume = volume([DVec3::new(-12.0, -12.0, -2.0), DVec3::new(12.0, 12.0, LENGTH + 2.0)], 0.25, ringed);
    let wall = wall(&volume, DVec3::Z * 10.0);
    let (h, m, begin) = (R - HOLE, 2.0 * 2f64.sqrt() / PI, 8.0);
    let rings = RINGS.len() as f64;
    let (annulus, bore) = (PI * (R * R - HOLE * HOLE), 2.0 * PI * HOLE * THICK);
    let side = 2.0 * PI * R * (LENGTH - rings * THICK);
    let all = side + 2.0 * PI * R * R + rings * (2.0 * annulus + bore);
    assert!((wall.mm2() / all - 1.0).abs() < 0.01, "{} mm², not {all}", wall.mm2());
    let start = 2.0 * PI * R * (begin + R * m) + PI * R * R;
    let shadows = rings * (2.0 * PI * R * h * m + annulus);
    let truth = 1.0 - (start + shadows) / all;
    // Back from the same places, the strips before the rings, the first stretch and the first end are seen, too. The last stretch
    // is seen on the way there.
    let (_, coverage) = seen(&wall, &volume, &along_z([begin, LENGTH - 4.0], 0.25), false);
    println!("{coverage:?}, truth {truth}");
    assert!((coverage.one_way - truth).abs() < 0.01, "{} of the area, not {truth}", coverage.one_way);
    assert!(coverage.both_ways > 0.985, "{}", coverage.both_ways);
}

#[test]
fn counting_and_looking_for_one_agree_and_threads_change_nothing() {
    let volume = volume([DVec3::new(-12.0, -12.0, -2.0), DVec3::new(12.0, 12.0, LENGTH + 2.0)], 0.8, ringed);
    let wall = wall(&volume, DVec3::Z * 10.0);
    let views = along_z([8.0, 90.0], 2.0);
    let (first, one) = seen(&wall, &volume, &views, false);
    let (all, counted) = seen(&wall, &volume, &views, true);
    let lost = [counted.one_way - one.one_way, counted.both_ways - one.both_ways];
    assert!(lost.iter().all(|l| (0.0..2.5e-3).contains(l)), "{lost:?} of the area");
    assert!(first.iter().zip(&all).all(|(a, b)| a.ahead <= b.ahead.min(1) && a.either <= b.either));
    assert!(all.iter().any(|s| s.ahead > 20));
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(alone.install(|| seen(&wall, &volume, &views, true)).0, all);
    // Each alone, by the definition.
    let by_hand = |n: usize| {
        let sees = |(at, a): &&(DVec3, Attitude)| {
            let to = wall.centroid(n) - *at;
            let place = [a.right(), a.up, a.forward].map(|axis| to.dot(axis));
            let inside = place[2] > 0.0 && place[0].abs() <= place[2] && place[1].abs() <= place[2];
            let facing = -to.dot(wall.normal(n)) > 85f64.to_radians().cos() * to.length();
            let free = first_crossing(&volume, *at, to, to.length() - 0.4).is_none();
            to.length() <= 100.0 && inside && facing && free
        };
        views.iter().filter(sees).count()
    };
    let differ = (0..wall.len()).step_by(7).filter(|&n| by_hand(n) != usize::from(all[n].ahead)).count();
    assert!(differ <= 2, "{differ} triangles on the edge of a picture or of what faces the camera");
}

#[test]
fn what_takes_seconds_can_be_interrupted() {
    let volume = volume([DVec3::splat(-12.0), DVec3::splat(12.0)], 0.8, |p| p.length() - 9.0);
    let (views, camera) = (along_z([-4.0, 4.0], 2.0), Perspective::new(90.0).unwrap());
    let gas = Arc::new(lumen::gas_at(volume.voxels(), DVec3::ZERO, &Progress::new()).unwrap().unwrap());
    let mut live = LiveCoverage::of(&volume, &gas, &Progress::new()).unwrap();
    let wall = live.wall().clone();
    let interrupted = Progress::new();
    interrupted.cancel();
    let still: StillViews =
        views.iter().map(|&(position, attitude)| StillView { position, attitude, fov_degrees: 90.0 }).collect();
    let numbers: Vec<u32> = (0..wall.len() as u32).collect();
    let look_from = Some(LookFrom { position: DVec3::ZERO, forward: DVec3::Z, up: DVec3::X });
    let (position, normal, triangles) = (wall.centroid(0), wall.normal(0), vec![0]);
    let patches = [Missed { area_mm2: 1.0, position, normal, along: None, look_from, triangles }];
    let statuses = [
        wall.seen(&volume, &views, &camera, false, &interrupted).err(),
        missed::missed(&wall, |_| false, 1.0, |_| None, &volume, 1.5, &interrupted).err(),
        missed::look_at(&wall, &[DVec3::ZERO], &volume, 1.5, &interrupted).err(),
        missed::to_visit(&patches, &wall, &numbers, &volume, &camera, &interrupted).err(),
        live.catch_up(&volume, &views, 0.0, &interrupted).err(),
        live.see(&volume, &views, &still, 0.0, &interrupted).err(),
        LiveCoverage::of(&volume, &gas, &interrupted).err(),
    ];
    assert!(statuses.iter().all(|e| e.as_ref().is_some_and(|e| e.kind as u8 == 4)), "{statuses:?}");
    // It can go on from there.
    live.see(&volume, &views, &still, 0.0, &Progress::new()).unwrap();
    let mut other = LiveCoverage::of(&volume, &gas, &Progress::new()).unwrap();
    other.see(&volume, &views, &still, 0.0, &Progress::new()).unwrap();
    assert_eq!((live.share(), live.looked()), (other.share(), views.len()));
}

#[test]
fn nothing_seen_and_nothing_to_see() {
    let volume = volume([DVec3::splat(-12.0), DVec3::splat(12.0)], 0.8, |p| p.length() - 9.0);
    let wall = wall(&volume, DVec3::ZERO);
    let nowhere =
        [(DVec3::NAN, Attitude::new(DVec3::Z, DVec3::X)), (DVec3::splat(1e300), Attitude::new(DVec3::Z, DVec3::X))];
    for views in [&[][..], &nowhere] {
        let (sights, coverage) = seen(&wall, &volume, views, true);
        assert_eq!((coverage, sights.len()), (Coverage::default(), wall.len()));
    }
    let (sights, coverage) = seen(&Wall::default(), &volume, &nowhere, false);
    assert!(sights.is_empty() && coverage == Coverage::default());
    // A ball from its middle: a sixth of it, the square picture's solid angle.
    let (_, coverage) = seen(&wall, &volume, &along_z([0.0, 0.0], 1.0), false);
    assert!(
        (coverage.one_way - 1.0 / 6.0).abs() < 0.01 && (coverage.both_ways - 1.0 / 3.0).abs() < 0.01,
        "{coverage:?}"
    );
}

fn along_z_axis(p: DVec3) -> Option<AlongColon> {
    Some(AlongColon { segment: 0, mm: p.z, part: Some("sigmoid"), is_guessed: false })
}

/// A tube along z with a pocket of radius 6 mm that extends 30 mm along x from its axis.
#[test]
fn a_pocket_that_was_missed_is_told_with_a_place_to_look_from() {
    let shape = |p: DVec3| {
        let tube = (p.truncate().length() - R).max(-p.z).max(p.z - 100.0);
        let pocket = ((p.z - 50.0).hypot(p.y) - 6.0).max(-p.x).max(p.x - 40.0);
        tube.min(pocket)
    };
    let volume = volume([DVec3::new(-12.0, -12.0, -2.0), DVec3::new(42.0, 12.0, 102.0)], 0.6, shape);
    let wall = wall(&volume, DVec3::Z * 10.0);
    let views = along_z([2.0, 97.0], 1.0);
    let (sights, coverage) = seen(&wall, &volume, &views, false);
    let walls = ClearanceFinder::new(volume.shared_voxels(), volume.transfer().iso() as f32, 3.0);
    let missed =
        missed::missed(&wall, |n| sights[n].ahead > 0, LEAST_MM2, along_z_axis, &volume, 1.5, &Progress::new())
            .unwrap();
    let place = |p: DVec3| p.x > R;
    let pocket = missed.iter().find(|m| place(m.position)).expect("the pocket's rear is not seen");
    assert!(missed.is_sorted_by(|a, b| a.area_mm2 >= b.area_mm2) && missed.iter().all(|m| m.area_mm2 >= LEAST_MM2));
    assert!(pocket.along.is_some_and(|a| (a.mm - 50.0).abs() < 8.0), "{:?}", pocket.along);
    let sum: f64 = pocket.triangles.iter().map(|&n| wall.mm2_at(n as usize)).sum();
    assert!((sum - pocket.area_mm2).abs() < 1e-6 && pocket.normal.is_normalized());
    assert!(pocket.triangles.iter().all(|&n| sights[n as usize].ahead == 0));
    // From there, most of it is seen.
    let from = pocket.look_from.unwrap();
    assert!(
        walls.at(from.position).mm >= 2.0 && from.forward.is_normalized() && from.up.dot(from.forward).abs() < 1e-9
    );
    // A patch that is seen from there too needs no look of its own, and one that cannot be looked at has none.
    let camera = Perspective::new(90.0).unwrap();
    let (unseen, numbers) = wall.part(|n| sights[n].ahead == 0);
    let view = (from.position, Attitude::new(from.forward, from.up));
    let shown = unseen.seen(&volume, &[view], &camera, false, &Progress::new()).unwrap();
    let triangles: Vec<u32> = pocket
        .triangles
        .iter()
        .copied()
        .filter(|t| numbers.binary_search(t).is_ok_and(|n| shown[n].ahead > 0))
        .collect();
    let area_mm2 = triangles.iter().map(|&n| wall.mm2_at(n as usize)).sum();
    let beside = Missed { area_mm2, triangles, ..pocket.clone() };
    let narrow = Missed { look_from: None, ..pocket.clone() };
    let visited =
        |patches: &[Missed]| missed::to_visit(patches, &unseen, &numbers, &volume, &camera, &Progress::new()).unwrap();
    assert_eq!(visited(&[narrow, pocket.clone(), beside.clone()]), [1]);
    assert_eq!(visited(&[beside]), [0]);
    // A place on the pocket's wall is looked at, too, and one that is nowhere is not.
    let looks =
        missed::look_at(&wall, &[pocket.position, DVec3::splat(500.0), DVec3::NAN], &volume, 1.5, &Progress::new())
            .unwrap();
    let look = looks[0].unwrap();
    let to = pocket.position - look.position;
    assert!(to.normalize().dot(look.forward) > 0.999 && walls.at(look.position).mm >= 2.0);
    assert!(first_crossing(&volume, look.position, to, to.length() - 0.6).is_none(), "nothing is between");
    assert_eq!(looks[1..], [None; 2]);
    let mut more = views;
    more.push((from.position, Attitude::new(from.forward, from.up)));
    let (again, after) = seen(&wall, &volume, &more, false);
    let left: f64 =
        pocket.triangles.iter().filter(|&&n| again[n as usize].ahead == 0).map(|&n| wall.mm2_at(n as usize)).sum();
    assert!(left < 0.6 * pocket.area_mm2 && after.one_way > coverage.one_way, "{left} of {} mm² left", pocket.area_mm2);
    // Everything seen: nothing is missed; nothing seen: all of the wall is one patch.
    assert!(missed::missed(&wall, |_| true, 0.0, |_| None, &volume, 1.5, &Progress::new()).unwrap().is_empty());
    let all = missed::missed(&wall, |_| false, LEAST_MM2, |_| None, &volume, 1.5, &Progress::new()).unwrap();
    assert!(all.len() == 1 && (all[0].area_mm2 / wall.mm2() - 1.0).abs() < 1e-6 && all[0].along.is_none());
}

#[test]
fn what_was_passed_and_missed_is_painted_and_what_was_seen_is_not() {
    let volume = volume([DVec3::new(-12.0, -12.0, -2.0), DVec3::new(12.0, 12.0, LENGTH + 2.0)], 0.5, ringed);
    let gas = Arc::new(lumen::gas_at(volume.voxels(), DVec3::Z * 10.0, &Progress::new()).unwrap().unwrap());
    let mut live = LiveCoverage::of(&volume, &gas, &Progress::new()).unwrap();
    let mut paint = CoveragePaint::new(&live);
    assert!(paint.is_of(&live));
    // Looking back at the rear of the second ring, which ends at z = 54 mm.
    let view = View::new(DVec3::Z * 70.0, DVec3::NEG_Z, DVec3::X, 90.0, 96, 96).unwrap();
    let mut painted = |live: &LiveCoverage, seconds: f64| {
        let mut frame = Frame::new(96, 96);
        frame.buffers().0.fill([200; 3]);
        paint.paint(live, &volume, &view, seconds, &mut frame);
        frame
    };
    let pixel = |frame: &Frame, at: DVec3| {
        let [x, y] = view.project(at).unwrap();
        frame.pixels()[y as usize * 96 + x as usize]
    };
    let (rear, side) = (DVec3::new(8.5, 0.0, 54.0), DVec3::new(R, 0.0, 60.0));
    assert!(painted(&live, 0.0).pixels().iter().all(|p| *p == [200; 3]), "nothing is missed before the flight");
    live.catch_up(&volume, &along_z([8.0, 90.0], 2.0), 10.0, &Progress::new()).unwrap();
    let missed = painted(&live, 10.0);
    assert_ne!(pixel(&missed, rear), [200; 3], "the rear of the ring was not seen");
    assert_eq!(pixel(&missed, side), [200; 3], "the side was");
    let slice = Slice {
        centre: DVec3::Z * 48.0,
        frame: SlicePlane::Coronal.frame().unwrap(),
        mm_per_pixel: 0.5,
        size: [64, 240],
    };
    let lines = |live: &LiveCoverage| {
        let mut frame = Frame::new(64, 240);
        paint_slice(live, &slice, &mut frame);
        frame
    };
    let at = |frame: &Frame, place: DVec3| {
        let [x, y] = slice.pixel(place).0;
        frame.pixels()[y.round() as usize * 64 + x.round() as usize] != [0; 3]
    };
    assert!(at(&lines(&live), rear) && !at(&lines(&live), side));
    // The wall still ahead is not missed, until the flight is over.
    let last = |live: &LiveCoverage| {
        let missed = live.missed();
        (0..missed.len()).filter(|&n| missed[n]).map(|n| live.wall().centroid(n).z).fold(0.0, f64::max)
    };
    assert!((54.0..74.0).contains(&last(&live)), "{}", last(&live));
    live.set_over(true);
    assert!(last(&live) > 76.0, "{}", last(&live));
    live.set_over(false);
    // Seen after all, it fades.
    let back: Vec<_> =
        (0..10).map(|n| (DVec3::Z * (76.0 - f64::from(n)), Attitude::new(DVec3::NEG_Z, DVec3::X))).collect();
    let mut views = along_z([8.0, 90.0], 2.0);
    views.extend(back);
    live.catch_up(&volume, &views, 20.0, &Progress::new()).unwrap();
    let mut shade = |seconds: f64| pixel(&painted(&live, seconds), rear)[1];
    assert!(shade(20.0) < shade(21.5) && shade(21.5) < 200 && shade(24.0) == 200, "{}", shade(20.0));
    assert!(!at(&lines(&live), rear));
    // Pictures and slices without pixels, and places that are none.
    paint.paint(&live, &volume, &view, f64::NAN, &mut Frame::default());
    paint_slice(&live, &Slice { size: [0; 2], ..slice }, &mut Frame::default());
    let lost = Slice { centre: DVec3::NAN, ..slice };
    paint_slice(&live, &lost, &mut Frame::new(8, 8));
}
