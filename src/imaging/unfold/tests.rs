use std::f64::consts::PI;
use std::sync::Mutex;

use glam::{DMat3, DVec3};

use super::*;
use crate::fields::centerline::Centerline;
use crate::fields::lumen::Interior;
use crate::volume::Grid;

/// Distance of the bend's middle from its centre, mm.
const BEND_MM: f64 = 30.0;
/// Radius of the tube, mm.
const TUBE_MM: f64 = 9.0;

fn mask(dims: [usize; 3], is_inside: impl Fn(DVec3) -> bool) -> Volume {
    let grid = Grid::new(dims, DVec3::splat(0.8), DVec3::new(5.0, -3.0, 7.0), DMat3::IDENTITY).unwrap();
    let at =
        |n: usize| DVec3::from_array([n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|c| c as f64));
    let data = (0..grid.len()).map(|n| i16::from(is_inside(grid.world(at(n))))).collect();
    Volume::new(grid, data)
}

fn line(points: Vec<DVec3>, radius: f64) -> Centerline {
    let length_mm = points.windows(2).map(|w| w[0].distance(w[1])).sum();
    Centerline { radius_mm: vec![radius; points.len()], points, length_mm, guessed: Vec::new() }
}

/// Half a torus about (50, 10, 20), in the plane z = 20.
fn bend(angle: f64) -> DVec3 {
    DVec3::new(50.0 + BEND_MM * angle.cos(), 10.0 + BEND_MM * angle.sin(), 20.0)
}

fn in_bend(p: DVec3) -> bool {
    let out = (p - DVec3::new(50.0, 10.0, 20.0)).truncate();
    (out.length() - BEND_MM).hypot(p.z - 20.0) < TUBE_MM && out.y > 0.0
}

/// A ball on the wall, on the outer side in the middle of the bend.
fn polyp() -> DVec3 {
    DVec3::new(50.0, 10.0 + BEND_MM + TUBE_MM, 20.0)
}

fn bent() -> (Volume, Centerline) {
    let volume = mask([120, 70, 36], |p| in_bend(p) && p.distance(polyp()) > 3.0);
    let points = (0..=94).map(|n| bend(PI * f64::from(n) / 94.0)).skip(8).take(79).collect();
    (volume, line(points, TUBE_MM))
}

fn unfolded(volume: &Volume, line: &Centerline, sheet: &Sheet) -> Result<Unfolding> {
    let progress = Progress::new();
    let chart = Chart::of_interior(&Interior::of_mask(volume)?, line, &progress)?;
    Unfolding::new(chart, volume, 0.5, sheet, &progress)
}

#[test]
fn a_bend_is_shown_once_and_found_again() {
    let (volume, line) = bent();
    let map = unfolded(&volume, &line, &Sheet::default()).unwrap();
    let measures = Measures::of(&map);
    assert!(measures.shown > 0.98 && measures.absent < 0.01, "{measures:?}");
    assert!(measures.round_trip_mm[2] < 0.5, "{measures:?}");
    // The polyp is in one place.
    let near: Vec<(usize, usize)> = (0..map.rows())
        .flat_map(|row| (0..map.columns()).map(move |column| (row, column)))
        .filter(|&(row, column)| map.point(row, column).is_some_and(|p| p.distance(polyp()) < 3.3))
        .collect();
    let rows = near.iter().map(|n| n.0);
    let (first, last) = (rows.clone().min().unwrap(), rows.max().unwrap());
    assert!(near.len() > 50 && last - first < 30, "{} pixels in rows {first} to {last}", near.len());
    // Every row, also at the tips, has wall all round; the rows of a bend do not cross.
    for row in 1..map.rows() - 1 {
        let shown = (0..map.columns()).filter(|&c| map.point(row, c).is_some()).count();
        assert!(shown * 20 > map.columns() * 19, "row {row}: {shown}");
    }
    let angle = |row: usize, column: usize| {
        let out = map.point(row, column).unwrap() - DVec3::new(50.0, 10.0, 20.0);
        out.y.atan2(out.x)
    };
    for column in (0..map.columns()).step_by(20) {
        let rows: Vec<f64> =
            (0..map.rows()).filter(|r| (5.0..70.0).contains(&map.mm(*r))).map(|r| angle(r, column)).collect();
        assert!(rows.windows(2).all(|w| w[1] > w[0] - 0.02), "column {column}");
    }
    for nowhere in [DVec3::NAN, DVec3::splat(1e9), DVec3::new(50.0, 10.0, 20.0)] {
        assert_eq!(map.place(nowhere), None);
    }
}

/// Seen from inside with the rectum above, right is right: across, then down the map is out of the lumen.
#[test]
fn the_wall_is_seen_from_inside_and_not_mirrored() {
    let (volume, line) = bent();
    let map = unfolded(&volume, &line, &Sheet { columns: Some(128), ..Sheet::default() }).unwrap();
    let (mut out, mut all) = (0, 0);
    for row in (60..map.rows() - 60).step_by(7) {
        let middle = map.chart().middle(map.mm(row)).unwrap();
        for column in 0..map.columns() {
            let (Some(at), Some(right), Some(down)) =
                (map.point(row, column), map.point(row, (column + 1) % 128), map.point(row + 1, column))
            else {
                continue;
            };
            all += 1;
            out += usize::from((right - at).cross(down - at).dot(at - middle.frame.at) > 0.0);
            assert!((down - at).dot(middle.frame.tangent) > -0.3, "down is towards the cecum");
        }
        // The middle column is towards the front where the line begins, and the frame does not turn about a plane line.
        let front = map.point(row, 64).unwrap() - middle.frame.at;
        assert!(front.normalize().dot(middle.frame.normal) > 0.95, "row {row}");
    }
    assert!(out * 100 > all * 98, "{out} of {all}");
}

#[test]
fn two_pieces_leave_empty_rows_between_them() {
    let volume = mask([110, 30, 30], |p| {
        let around = (p.y - 9.0).hypot(p.z - 19.0) < 6.0;
        around && ((10.0..40.0).contains(&p.x) || (60.0..88.0).contains(&p.x))
    });
    let mut line = line((0..=70).map(|n| DVec3::new(14.0 + f64::from(n), 9.0, 19.0)).collect(), 6.0);
    line.guessed = vec![[25.0, 47.0]];
    let map = unfolded(&volume, &line, &Sheet::default()).unwrap();
    let gaps = map.chart().gaps();
    assert_eq!(gaps.len(), 1);
    assert!((10.0..24.0).contains(&(gaps[0][1] - gaps[0][0])), "{gaps:?}");
    let is_empty = |mm: f64| {
        let row = map.row(mm).round() as usize;
        (0..map.columns()).all(|c| map.point(row, c).is_none())
    };
    assert!(is_empty(36.0) && !is_empty(15.0) && !is_empty(60.0));
    let drawn = picture(&map, -650.0);
    assert_eq!(drawn.len(), map.rows() * map.columns());
    let measures = Measures::of(&map);
    // The four ends are flat, and a sixth of the wall.
    assert!(measures.shown > 0.93, "{measures:?}");
}

/// A ring has no ends, noise has no line, and a part of a line may miss the lumen. None of it panics.
#[test]
fn rings_noise_and_lines_outside_end_in_a_map_or_in_an_error() {
    let ring = mask([120, 120, 36], |p| {
        let out = (p - DVec3::new(50.0, 40.0, 20.0)).truncate();
        (out.length() - BEND_MM).hypot(p.z - 20.0) < TUBE_MM
    });
    let around = |n: i32| {
        let angle = 0.06 * f64::from(n);
        DVec3::new(50.0 + BEND_MM * angle.cos(), 40.0 + BEND_MM * angle.sin(), 20.0)
    };
    let map = unfolded(&ring, &line((0..60).map(around).collect(), TUBE_MM), &Sheet::default()).unwrap();
    assert!(map.points().iter().any(|p| p[0].is_finite()));
    let noise =
        mask([24, 24, 24], |p| crate::math::hash::uniform(1, (p.x * 971.0 + p.y * 31.0 + p.z * 7919.0) as u64) < 0.4);
    let through = line((0..12).map(|n| DVec3::splat(f64::from(n)) + DVec3::new(6.0, -2.0, 8.0)).collect(), 1.0);
    if let Ok(map) = unfolded(&noise, &through, &Sheet::default()) {
        Measures::of(&map);
        picture(&map, -650.0);
    }
    // The lumen reaches the faces of the scan.
    let whole = mask([20, 20, 60], |_| true);
    let straight = line((0..40).map(|n| DVec3::new(13.0, 5.0, 8.0 + f64::from(n))).collect(), 7.0);
    let map = unfolded(&whole, &straight, &Sheet::default()).unwrap();
    assert!(Measures::of(&map).absent < 0.05, "{:?}", Measures::of(&map));
    let outside = line(vec![DVec3::splat(1e4), DVec3::splat(1.1e4)], 1.0);
    for lost in [outside, line(Vec::new(), 1.0), line(vec![DVec3::splat(12.0)], 1.0)] {
        assert_eq!(unfolded(&whole, &lost, &Sheet::default()).unwrap_err().kind as u8, 4);
    }
    for (from, to) in [(30.0, 10.0), (1e9, 1e12), (f64::NAN, 5.0)] {
        let sheet = Sheet { from_mm: Some(from), to_mm: Some(to), ..Sheet::default() };
        assert!(unfolded(&whole, &straight, &sheet).is_err());
    }
}

#[test]
fn any_number_of_threads_makes_the_same_map() {
    let (volume, line) = bent();
    let sheet = Sheet { columns: Some(64), step_mm: 1.0, ..Sheet::default() };
    let draw = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let map = unfolded(&volume, &line, &sheet).unwrap();
            let bits: Vec<[u32; 3]> = map.points().iter().map(|p| p.map(f32::to_bits)).collect();
            (bits, picture(&map, -650.0))
        })
    };
    assert!(draw(1) == draw(4));
}

/// For any number of threads, bands make the map that is drawn at once; where the reader looks they come first, also once that changes.
#[test]
fn bands_make_the_whole_map_and_come_nearest_first() {
    let (volume, line) = bent();
    let progress = Progress::new();
    let chart = Arc::new(Chart::of_interior(&Interior::of_mask(&volume).unwrap(), &line, &progress).unwrap());
    let drawn = |step_mm: f64| {
        let sheet = Sheet { columns: None, step_mm, ..Sheet::default() };
        Unfolding::new(Arc::clone(&chart), &volume, 0.5, &sheet, &progress).unwrap()
    };
    let (whole, coarse) = (drawn(0.2), drawn(0.8));
    let sheet = Sheet { step_mm: 0.2, ..Sheet::default() };
    let drawing = Drawing::new(Arc::clone(&chart), &volume, 0.5, &sheet).unwrap();
    assert!(drawing.count() > 12 && whole.rows() % drawing.rows(0).len() != 0, "{}", drawing.count());
    let bits = |map: &Unfolding| {
        let points: Vec<[u32; 3]> = map.points().iter().map(|p| p.map(f32::to_bits)).collect();
        let normals: Vec<[u32; 3]> = map.normals.iter().map(|n| n.to_array().map(f32::to_bits)).collect();
        let behind: Vec<(u32, [u32; 3])> =
            map.behind().iter().map(|b| (b.pixel, b.point.to_array().map(f32::to_bits))).collect();
        (points, normals, behind)
    };
    // Before any band is drawn, each pixel shows about what it will show.
    let preview = drawing.preview(&coarse);
    let far = (0..whole.points.len())
        .filter_map(|n| {
            let (row, column) = (n / whole.columns(), n % whole.columns());
            Some(preview.point(row, column)?.distance(whole.point(row, column)?))
        })
        .collect::<Vec<_>>();
    let near = far.iter().filter(|mm| **mm < 1.5).count();
    assert!(near * 100 > far.len() * 97 && far.len() * 100 > whole.points.len() * 95, "{near} of {}", far.len());
    for threads in [1, 4] {
        let rgb = drawing.enlarged(&coarse, &picture(&coarse, -650.0));
        let made = Mutex::new((drawing.preview(&coarse), rgb, Vec::new()));
        // The reader looks at the middle, then at the end.
        let looked_at = |done: usize| if done < 4 { 45.0 } else { 80.0 };
        let from_mm = || looked_at(made.lock().unwrap().2.len());
        let put = |band: Band| {
            let mut made = made.lock().unwrap();
            let (map, rgb, order) = &mut *made;
            rgb[band.rows.start * map.columns()..band.rows.end * map.columns()]
                .copy_from_slice(&drawing.picture(&band));
            map.put(&band);
            order.push(band.rows);
            Ok(())
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| drawing.outwards(from_mm, &progress, put)).unwrap();
        let (map, rgb, order) = made.into_inner().unwrap();
        assert!(bits(&map) == bits(&whole), "{threads} threads");
        assert!(rgb == picture(&whole, 0.5), "{threads} threads");
        assert_eq!(order.len(), drawing.count());
        // Of several threads, each may have begun another band before.
        if threads == 1 {
            let away = |rows: &std::ops::Range<usize>, mm: f64| {
                let row = whole.row(mm);
                (rows.start as f64 - row).max(row - (rows.end - 1) as f64).max(0.0)
            };
            for (n, rows) in order.iter().enumerate() {
                let mm = looked_at(n);
                let nearer = order[n..].iter().filter(|later| away(later, mm) < away(rows, mm)).count();
                assert_eq!(nearer, 0, "{n}: {order:?}");
            }
        }
    }
}

/// A deep sac beside a tube: the function hardly changes in it, so that its wall belongs to little of the line. It gets rows of its own,
/// and no two rows are farther apart than asked.
#[test]
fn rows_are_closer_where_a_deep_sac_opens() {
    let volume = mask([150, 100, 36], |p| {
        let in_tube = (10.0..110.0).contains(&p.x) && (p.y - 12.0).hypot(p.z - 20.0) < 8.0;
        let in_sac = (12.0..44.0).contains(&p.y) && (p.x - 60.0).hypot(p.z - 20.0) < 9.0;
        in_tube || in_sac
    });
    let line = line((0..=100).map(|n| DVec3::new(10.0 + f64::from(n), 12.0, 20.0)).collect(), 8.0);
    let map = unfolded(&volume, &line, &Sheet::default()).unwrap();
    let apart: Vec<f64> = (1..map.rows()).map(|r| map.mm(r) - map.mm(r - 1)).collect();
    let (least, most) = apart.iter().fold((f64::MAX, 0.0f64), |(l, m), a| (l.min(*a), m.max(*a)));
    assert!(most < STEP_MM + 1e-6 && least < 0.25 * STEP_MM, "{least} to {most} mm apart");
    for row in [0, 7, map.rows() - 1] {
        assert!((map.row(map.mm(row)) - row as f64).abs() < 1e-6);
    }
    // With rows evenly spaced 6.7 % of the wall were absent.
    let measures = Measures::of(&map);
    assert!(measures.absent < 0.02, "{measures:?}");
}
