//! Renders a list of poses of a scan, with depth: the library calls behind `colvis render --poses`.
//!
//! `cargo run --release --example render_poses -- scan.nii.gz poses.json`. Without arguments it renders some poses of a flight
//! through the embedded phantom.

use colvis::app::{FlightRequest, Scan, Scene};
use colvis::error::{Error, Result};
use colvis::glam::DVec3;
use colvis::render::{Frame, Preset, Reuse, Settings, View, renderer};
use colvis::serde_json;

/// Position (mm), forward and up, in world coordinates.
type Pose = [DVec3; 3];

fn poses(path: &str) -> Result<Vec<Pose>> {
    let bad = |why: String| Error::file(std::path::Path::new(path), why, "give {\"poses\": [{\"position\": …}]}");
    let text = std::fs::read_to_string(path).map_err(|e| bad(e.to_string()))?;
    let file: serde_json::Value = serde_json::from_str(&text).map_err(|e| bad(e.to_string()))?;
    let vector = |v: &serde_json::Value| serde_json::from_value(v.clone()).map_err(|e| bad(e.to_string()));
    let list = file["poses"].as_array().map_or(&[][..], Vec::as_slice);
    list.iter().map(|p| Ok([vector(&p["position"])?, vector(&p["forward"])?, vector(&p["up"])?])).collect()
}

/// Poses along a flight, one every second.
fn flown(scan: &mut Scan) -> Result<Vec<Pose>> {
    let mut flight = scan.flight(Scene::default(), &FlightRequest::default())?;
    let next = |_| {
        flight.fly(1.0)?;
        let pose = flight.pose();
        Ok([pose.position, pose.attitude.forward, pose.attitude.up])
    };
    (0..4).map(next).collect()
}

fn main() -> Result<()> {
    // Cargo's test runner also calls this, with its own options.
    let args: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let (scan, poses) = match &args[..] {
        [scan, list, ..] => (Scan::open(scan)?, poses(list)?),
        _ => {
            let mut scan = Scan::phantom(1)?;
            let poses = flown(&mut scan)?;
            (scan, poses)
        }
    };
    let mut renderer = renderer(scan.volume(), Settings::default(), Preset::default(), Reuse::Allowed);
    let mut frame = Frame::with_depth(256, 256);
    for [position, forward, up] in poses {
        let work = renderer.render(&View::new(position, forward, up, 90.0, 256, 256)?, &mut frame);
        let nearest = frame.depth().unwrap_or_default().iter().copied().fold(f32::INFINITY, f32::min);
        println!("{position:.1}: wall from {nearest:.1} mm on, {} rays", work.rays);
    }
    Ok(())
}

#[test]
fn it_renders() {
    main().unwrap();
}
