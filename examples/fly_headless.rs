//! Opens a scan, flies it headless, and prints where the flight ended.
//!
//! `cargo run --release --example fly_headless -- scan.nii.gz`. Without a scan it flies the embedded phantom.

use colvis::app::{FlightRequest, Scan, Scene};
use colvis::components::flight::State;
use colvis::error::Result;

fn main() -> Result<()> {
    // Cargo's test runner also calls this, with its own options.
    let scan = std::env::args().nth(1).filter(|a| !a.starts_with('-'));
    let mut scan = match scan {
        Some(path) => Scan::open(path)?,
        None => Scan::phantom(1)?,
    };
    let scene = Scene { log: true, ..Scene::guided_by("tentacles") };
    let mut flight = scan.flight(scene, &FlightRequest::default())?;
    let state = flight.fly(5.0)?;
    let (pose, flown) = (flight.pose(), flight.flight());
    println!(
        "{state:?} at {:.1} mm after {:.0} mm in {:.1} s",
        pose.position,
        flown.length_mm,
        flight.clock().seconds()
    );
    let least = flight.take_log().iter().map(|l| l.clearance_mm).fold(f64::INFINITY, f64::min);
    println!("never nearer to the wall than {least:.1} mm");
    assert!(state != State::Operator && least > 1.0);
    let picture = flight.look(320, 240)?;
    println!("sees {} pixels of wall", picture.pixels().iter().filter(|p| p[0] > 0).count());
    Ok(())
}

#[test]
fn it_flies() {
    main().unwrap();
}
