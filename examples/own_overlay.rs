//! Adds an overlay to the window of colvis: the path flown, shown and hidden with the key O.
//!
//! `cargo run --release --example own_overlay`

use colvis::app::{Canvas, FlightApp, Overlay};

const FLOWN: Overlay = Overlay {
    name: "flown",
    summary: "the way flown",
    key: Some('o'),
    shown: true,
    draw: draw_way_flown,
    ..Overlay::PLAIN
};

/// Draws the part of the camera's trail that is in view, and the distance flown as text.
fn draw_way_flown(flight: &FlightApp, canvas: &mut Canvas) {
    let green = [120, 220, 140];
    let places = flight.survey().trail().map_or(&[][..], |t| t.views()).iter().map(|v| canvas.find(v.0));
    let places: Vec<_> = places.collect();
    for two in places.windows(2) {
        if let (Some(from), Some(to)) = (two[0], two[1]) {
            canvas.line(from, to, green);
        }
    }
    let [width, height] = canvas.size();
    canvas.text([width / 2.0, height * 0.75], format!("{:.0} mm flown", flight.flight().length_mm), green);
}

fn main() -> std::process::ExitCode {
    colvis::cli::Program::default().overlay(FLOWN).run()
}

#[test]
fn it_draws() -> colvis::error::Result<()> {
    use colvis::app::{FlightRequest, Scan, Scene};
    let mut flight =
        Scan::phantom(1)?.flight(Scene { picture: true, ..Scene::default() }, &FlightRequest::default())?;
    flight.fly(2.0)?;
    flight.fly(0.1)?;
    let mut canvas = Canvas::new(flight.view().expect("the scene has a picture"));
    draw_way_flown(&flight, &mut canvas);
    assert!(!canvas.into_marks().is_empty());
    Ok(())
}
