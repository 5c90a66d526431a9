//! Complete flights by tentacles and mines, against the phantom's truth and on a real scan.

use std::sync::Arc;

use colvis::app::Scene;
use colvis::app::plan::{self, FlightRequest, Place};
use colvis::components::flight::State;
use colvis::dynamics::mines::MineSettings;
use colvis::dynamics::tentacles::TentacleSettings;
use colvis::fields::{Distance, Through, WallDistance, lumen};
use colvis::phantom::{PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::{Frame, Preset, Quality, Reuse, Settings, View, renderer};
use colvis::space::{PreparedVolume, TransferFunction, value};
use colvis::volume::{Grid, Volume};
use glam::{DMat3, DVec3};

use crate::support::flights::{flight, fly, judge, scan};
use crate::support::logs::read_log;
use crate::support::phantom::phantom;
use crate::support::run::run;
use crate::support::scans::data;

fn logged() -> Scene {
    Scene { log: true, ..Scene::default() }
}

/// Flies from rectum to cecum, passing at least 99 % of the centerline, with a mean distance from it of at most
/// `offset` times the radius.
fn end_to_end(settings: &PhantomSettings, offset: f64) {
    let (volume, truth) = phantom(settings);
    let mut flight = flight(volume, logged(), &FlightRequest::default());
    let log = fly(&mut flight, 120.0);
    let f = flight.flight();
    assert_eq!(f.state, State::Arrived, "{}", f.reason);
    let course = judge(&log, &truth);
    println!("{settings:?}: {course:?}, {:.0} of {:.0} mm", f.length_mm, truth.length_mm);
    assert!(course.passed >= 0.99 && course.offset <= offset, "{course:?}");
    assert!(course.clearance_mm >= 1.5, "{course:?}");
    let start = DVec3::from_array(log[0].position);
    let [rectum, cecum] = [0, truth.centerline.len() - 1].map(|i| truth.centerline[i]);
    assert!(start.distance(rectum) < start.distance(cecum), "it starts at the rectum");
    // Every logged position is inside the lumen.
    for line in &log {
        assert!(value(&flight.setup().volume, DVec3::from_array(line.position)) < -650.0, "{line:?}");
    }
}

#[test]
fn small_phantom() {
    end_to_end(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() }, 0.23);
}

#[test]
#[ignore = "slow: five standard phantoms from end to end"]
fn standard_phantoms_1_to_5() {
    for seed in 1..=5 {
        end_to_end(&PhantomSettings { seed, ..PhantomSettings::default() }, 0.13);
    }
}

#[test]
#[ignore = "slow: a phantom with fluid and bridges from end to end"]
fn with_fluid_and_bridges() {
    end_to_end(
        &PhantomSettings { size: Size::Small, fluid: true, bridges: true, seed: 2, ..PhantomSettings::default() },
        0.3,
    );
}

#[test]
#[ignore = "slow: ten flights of up to 200 s"]
fn the_wrong_way_first_then_turned_round() {
    let settings = PhantomSettings { size: Size::Small, ..PhantomSettings::default() };
    let (volume, truth) = phantom(&settings);
    let mut scan = scan(volume);
    // From many places along the path to both ends: at some point the longest free direction is the wrong one.
    let mut turned = 0;
    for part in 1..6 {
        let from = truth.centerline[truth.centerline.len() * part / 6];
        for to in [Place::Rectum, Place::Cecum] {
            let request = FlightRequest { from: Some(Place::World(from)), to: Some(to), reverse: false };
            let mut flight = scan.flight(logged(), &request).unwrap();
            fly(&mut flight, 200.0);
            let f = flight.flight();
            assert_eq!(f.state, State::Arrived, "from {from} to {to:?}: {}", f.reason);
            turned += f.turns;
        }
    }
    assert!(turned > 2, "some flights must have turned round");
}

#[test]
#[ignore = "slow: a flight through half a phantom"]
fn a_goal_is_reached_within_three_millimetres() {
    let (volume, truth) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let to = truth.centerline[truth.centerline.len() / 2];
    let mut flight =
        flight(volume, logged(), &FlightRequest { to: Some(Place::World(to)), ..FlightRequest::default() });
    let log = fly(&mut flight, 120.0);
    assert_eq!(flight.flight().state, State::Arrived);
    assert!(DVec3::from_array(log[log.len() - 1].position).distance(to) <= 3.0);
}

#[test]
#[ignore = "slow: flights with four numbers of tentacles"]
fn few_tentacles_are_as_safe_as_many() {
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let mut scan = scan(volume);
    for count in [3, 8, 64, 300] {
        let mut scene = logged();
        scene.guides.edit::<TentacleSettings>(|t| t.count = count);
        let mut flight = scan.flight(scene, &FlightRequest::default()).unwrap();
        let log = fly(&mut flight, 60.0);
        let least = log.iter().map(|l| l.clearance_mm).fold(f64::INFINITY, f64::min);
        assert!(least >= 1.5, "{count} tentacles: {least}");
        let f = flight.flight();
        if count >= 8 {
            assert_eq!(f.state, State::Arrived, "{count} tentacles: {}", f.reason);
        } else {
            // The paper's smallest number need not find the path, but the flight must end and give a reason.
            assert!(f.state == State::Arrived || !f.reason.is_empty(), "{f:?}");
        }
    }
}

#[test]
#[ignore = "slow: flights with three numbers of mines"]
fn no_mines_and_ten_thousand_are_as_safe_as_twelve() {
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let mut scan = scan(volume);
    for (kept, spacing_mm, seconds) in [(0, 8.0, 60.0), (1, 8.0, 60.0), (10_000, 0.1, 12.0)] {
        let mut scene = logged();
        scene.mines = Some(MineSettings { kept, spacing_mm, ..MineSettings::default() });
        let mut flight = scan.flight(scene, &FlightRequest::default()).unwrap();
        let log = fly(&mut flight, seconds);
        let least = log.iter().map(|l| l.clearance_mm).fold(f64::INFINITY, f64::min);
        assert!(least >= 1.5, "{kept} mines: {least}");
        let f = flight.flight();
        let whole = log.iter().all(|l| l.position.iter().chain(&l.velocity).all(|x| x.is_finite()));
        assert!(whole && (f.state != State::Operator || !f.reason.is_empty()), "{f:?}");
        assert!(f.length_mm > 160.0 || f.state == State::Operator, "{kept} mines: it hangs after {} mm", f.length_mm);
    }
}

/// A lumen one voxel wide, and starts in its wall, at distance 0 from it and outside: all are refused with the reason.
#[test]
fn where_the_camera_does_not_fit_no_flight_begins() {
    let grid = Grid::new([40, 40, 40], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let data = (0..grid.len()).map(|n| if n % 40 == 20 && n / 40 % 40 == 20 { -1000 } else { 40 }).collect();
    let progress = Progress::new();
    let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
    let lumen = lumen::find(volume.voxels(), &progress).unwrap();
    for at in [
        DVec3::splat(20.0),
        DVec3::new(20.34, 20.0, 20.0),
        DVec3::new(22.0, 20.0, 20.0),
        DVec3::new(-50.0, 20.0, 20.0),
        DVec3::NAN,
    ] {
        let request = FlightRequest { from: Some(Place::World(at)), ..FlightRequest::default() };
        let e = plan::plan(&volume, &lumen, &request, 1.5, &progress).unwrap_err();
        assert_eq!(e.kind as i32, 4, "{at}: {e}");
    }
}

#[test]
fn real_scan_end_to_end() {
    let Some(scan) = data("ctc_prone.nii.gz") else { return };
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("f.jsonl");
    let stats = dir.path().join("s.json");
    let scan = scan.to_str().unwrap();
    let out = run(&["fly", scan, "--headless", "--log", log.to_str().unwrap(), "--stats", stats.to_str().unwrap()], 0);
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(said.contains("2 more: "), "the segments not flown are named: {said}");
    let lines = read_log(&log);
    let last = &lines[lines.len() - 1];
    assert_eq!(last.state, State::Arrived);
    assert!(lines.iter().all(|l| l.clearance_mm >= 1.5));
    let ends = [DVec3::new(131.0, -64.0, -126.0), DVec3::new(-90.0, -103.0, -258.0)];
    for (line, end, off) in [(&lines[0], ends[0], 8.0), (last, ends[1], 30.0)] {
        assert!(DVec3::from_array(line.position).distance(end) < off, "{line:?} near {end}");
    }
    let stats: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&stats).unwrap()).unwrap();
    assert_eq!(stats["state"], "arrived");
    assert_eq!(stats["unflown"].as_array().unwrap().len(), 2);
    assert!(stats["prepare"]["load_s"].as_f64().unwrap() > 0.0 && stats["peak_rss_bytes"].as_u64().unwrap() > 0);
}

#[test]
fn no_colon_to_fly() {
    let Some(scan) = data("abdomen_unprepared.nii.gz") else { return };
    let out = run(&["fly", scan.to_str().unwrap(), "--headless"], 4);
    assert!(String::from_utf8_lossy(&out.stderr).contains("no colon found to fly through"));
    let dir = tempfile::tempdir().unwrap();
    let mask = dir.path().join("m.nii.gz");
    run(&["segment", scan.to_str().unwrap(), "--out", mask.to_str().unwrap()], 0);
    assert!(mask.exists(), "segment still writes what there is");
}

/// A scan of more than 2³¹ voxels, in whose last part the colon is: it is flown and seen as without the rest.
#[test]
#[ignore = "slow: five gigabytes"]
fn more_voxels_than_31_bits_can_count() {
    let (small, truth) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let grid = small.grid().clone();
    let side = 1300;
    let first = grid.dims().map(|n| side - n);
    let origin = grid.world(-DVec3::from_array(first.map(|n| n as f64)));
    let whole = Grid::new([side; 3], grid.spacing(), origin, grid.direction()).unwrap();
    assert!(whole.len() > 1 << 31);
    // Air around the patient, as in the phantom's own corner.
    let mut data = vec![small.data()[0]; whole.len()];
    let [nx, ny, nz] = grid.dims();
    for (j, k) in (0..nz).flat_map(|k| (0..ny).map(move |j| (j, k))) {
        let to = whole.index(first[0], first[1] + j, first[2] + k);
        data[to..to + nx].copy_from_slice(&small.data()[grid.index(0, j, k)..][..nx]);
    }
    let view = |volume: &PreparedVolume| {
        let [at, on] = [0.3, 0.31].map(|share| truth.centerline[(share * truth.centerline.len() as f64) as usize]);
        let view = View::new(at, on - at, DVec3::new(0.3, 0.2, 1.0), 90.0, 96, 96).unwrap();
        let mut frame = Frame::new(96, 96);
        renderer(volume, Settings::new(Quality::High), Preset::default(), Reuse::Never).render(&view, &mut frame);
        frame.pixels().to_vec()
    };
    let flown = |volume: Volume| {
        let mut scan = scan(volume);
        let picture = view(&scan.volume().clone());
        let lumen = scan.lumen().unwrap();
        let walls = WallDistance::of_lumen(scan.volume().voxels(), &lumen, Through::Gas, &Progress::new()).unwrap();
        let far = walls.sample(truth.centerline[truth.centerline.len() / 2]).unwrap().mm;
        let log = fly(&mut scan.flight(logged(), &FlightRequest::default()).unwrap(), 5.0);
        (picture, lumen.gas_ml(), far, DVec3::from_array(log[log.len() - 1].position))
    };
    let huge = flown(Volume::new(whole, data));
    let small = flown(small);
    assert!((huge.1 - small.1).abs() < 1e-6 * small.1 && (huge.2 - small.2).abs() < 1e-6, "{huge:?}");
    assert!(huge.3.distance(small.3) < 0.1, "{} {}", huge.3, small.3);
    let off = huge.0.as_flattened().iter().zip(small.0.as_flattened()).map(|(a, b)| f64::from(a.abs_diff(*b)));
    let mean = off.sum::<f64>() / small.0.as_flattened().len() as f64;
    assert!(mean < 2.0, "{mean} grey levels");
}
