//! Several flights through one scan: none changes the scan for the next.

use std::sync::Arc;

use colvis::app::{FlightApp, FlightRequest, OpenOptions, Scan, Scene};
use colvis::components::output::LogLine;
use colvis::volume::{Grid, Volume};
use glam::{DMat3, DVec3};

use crate::support::embedded::embedded;
use crate::support::flights::fly;

/// Returns the HU of two long chambers of gas over one pool of tagged fluid.
fn basin(p: DVec3) -> i16 {
    let inside = p.x.abs() < 14.0 && p.z.abs() < 300.0 && p.y.abs() < 16.0;
    match p {
        _ if !inside || p.z.abs() <= 6.0 && p.y <= 8.0 => 40,
        _ if p.y < 2.0 => -1000,
        // The blurred fluid level.
        _ if p.y < 3.0 => -150,
        _ => 600,
    }
}

fn parted() -> Scan {
    let dims @ [nx, ny, _] = [31, 61, 311];
    let (spacing, origin) = (DVec3::new(2.0, 1.0, 2.0), DVec3::new(-30.0, -30.0, -310.0));
    let grid = Grid::new(dims, spacing, origin, DMat3::IDENTITY).unwrap();
    let at = |n: usize| grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64));
    let data = (0..grid.len()).map(|n| basin(at(n))).collect();
    Scan::of(Volume::new(grid, data), &OpenOptions::default()).unwrap()
}

fn begun(scan: &mut Scan, guide: &'static str) -> FlightApp {
    let scene = Scene { log: true, ..Scene::guided_by(guide) };
    scan.flight(scene, &FlightRequest::default()).unwrap()
}

fn flown(scan: &mut Scan, guide: &'static str) -> Vec<LogLine> {
    fly(&mut begun(scan, guide), 3.0)
}

/// `path` treats tagged fluid as gas, `tentacles` does not.
#[test]
#[ignore = "slow: six flights through two chambers"]
fn a_guide_that_drains_fluid_leaves_the_scan_as_it_was() {
    let guides = ["path", "tentacles"];
    let fresh = guides.map(|guide| flown(&mut parted(), guide));
    assert_ne!(fresh[0][0].clearance_mm, fresh[1][0].clearance_mm, "the pool makes no difference here");
    for order in [[0, 1], [1, 0]] {
        let mut scan = parted();
        let voxels = scan.volume().voxels().data().to_vec();
        let lumen = scan.lumen().unwrap();
        for n in order {
            assert!(flown(&mut scan, guides[n]) == fresh[n], "{} in the order {order:?}", guides[n]);
            let notes = scan.take_notes().join("\n");
            assert_eq!(notes.contains("flies through tagged fluid"), n == 0, "{notes}");
        }
        assert!(scan.volume().voxels().data() == voxels && Arc::ptr_eq(&scan.lumen().unwrap(), &lumen));
    }
}

#[test]
fn voxels_are_shared_and_cleansed_once() {
    let mut scan = parted();
    let own = scan.volume().shared_voxels();
    let plain = begun(&mut scan, "tentacles");
    assert!(Arc::ptr_eq(&plain.setup().volume.shared_voxels(), &own));
    let [first, second] = ["path", "potential"].map(|guide| begun(&mut scan, guide).setup().volume.shared_voxels());
    assert!(Arc::ptr_eq(&first, &second) && !Arc::ptr_eq(&first, &own));
    let times = |part: &str| scan.timings().parts().iter().filter(|p| p.0 == part).count();
    assert_eq!((times("lumen_s"), times("cleanse_s"), times("cleansed_lumen_s")), (1, 1, 1));
    // Without tag there is nothing to take out.
    let mut dry = Scan::prepared(embedded(), Arc::default());
    let own = dry.volume().shared_voxels();
    assert!(Arc::ptr_eq(&begun(&mut dry, "path").setup().volume.shared_voxels(), &own));
}
