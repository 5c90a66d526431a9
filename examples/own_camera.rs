//! Adds a camera model to colvis: an orthographic camera, whose rays are parallel.
//!
//! `cargo run --release --example own_camera -- fly --camera orthographic --fov 60` (also `render`). `--fov` is the length
//! in mm that the image's shorter side shows.

use std::sync::Arc;

use colvis::error::Error;
use colvis::glam::{DVec2, DVec3};
use colvis::render::camera::{Camera, CameraModel, CameraRay, Origins};

const MODEL: CameraModel = CameraModel {
    name: "orthographic",
    summary: "parallel rays; --fov is the height that the image shows, mm",
    make: |mm, _, _| match mm {
        mm if mm.is_finite() && mm > 0.0 => Ok(Arc::new(Orthographic { half_mm: 0.5 * mm })),
        _ => Err(Error::usage("height", format!("{mm} mm is not above 0"), "give millimetres")),
    },
    ..CameraModel::BASE
};

/// The image's shorter side shows twice `half_mm`.
#[derive(Debug, PartialEq)]
struct Orthographic {
    half_mm: f64,
}

impl Camera for Orthographic {
    fn ray(&self, at: DVec2) -> Option<CameraRay> {
        Some(CameraRay { origin: (at * self.half_mm).extend(0.0), direction: DVec3::Z })
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        (place.z >= 0.0).then(|| place.truncate() / self.half_mm)
    }

    fn origins(&self) -> Origins {
        Origins::Many
    }
}

fn main() -> std::process::ExitCode {
    colvis::cli::Program::default().camera(MODEL).run()
}

#[test]
fn a_flight_is_seen_through_it() -> colvis::error::Result<()> {
    use colvis::app::{FlightRequest, ImageSettings, Scan, Scene};
    let image = ImageSettings { camera: MODEL, fov_degrees: 12.0, ..ImageSettings::default() };
    let flight = Scan::phantom(1)?.flight(Scene { image, ..Scene::default() }, &FlightRequest::default())?;
    assert!(flight.look(64, 48)?.pixels().iter().any(|p| p[0] > 60));
    Ok(())
}
