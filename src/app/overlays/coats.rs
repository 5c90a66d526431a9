//! Coated spots: tag on the wall thinner than 3 mm, painted in the picture. Most flat polyps wear such a coat.

use super::{GREY, WHITE, legend_row, legend_text};
use crate::coats::COAT;
use crate::overlay::Canvas;
use crate::{FlightApp, Overlay};

/// The overlay.
pub const OVERLAY: Overlay = Overlay {
    name: "coats",
    summary: "coats: thin tag on the wall",
    switch: Some(|flight, _, way| flight.show_coats(way.is_some())),
    draw,
    ..Overlay::PLAIN
};

fn draw(flight: &FlightApp, canvas: &mut Canvas) {
    let Some(row) = legend_row(canvas) else { return };
    let side = 5.0 * canvas.scale();
    canvas.panel([row[0], row[1] - side], [row[0] + 2.0 * side, row[1] + side], COAT, 1.0);
    let (text, colour) = match flight.coats().map(|c| &c.spots[..]) {
        None => ("looking for coats".to_owned(), GREY),
        Some([]) => ("no coats".to_owned(), GREY),
        Some(spots) => {
            let all: f64 = spots.iter().map(|s| s.area_mm2).sum();
            let mm = spots.iter().map(|s| s.area_mm2 * s.thickness_mm).sum::<f64>() / all;
            (format!("{} coats, {mm:.1} mm of tag on the mean", spots.len()), WHITE)
        }
    };
    legend_text(canvas, row, 18.0, text, colour);
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::Scene;
    use crate::components::coats::CoatPaint;
    use crate::components::output::Picture;
    use crate::overlays::tests::{drawn, flight_in_a_room, texts};
    use crate::polyps::{CoatedPlaces, CoatedSpot};

    #[test]
    fn what_is_known_is_painted_while_it_is_shown() {
        let mut flight = flight_in_a_room(Scene { picture: true, ..Scene::guided_by("tentacles") });
        flight.camera_mut::<Picture>().unwrap().frame.resize(120, 90);
        let picture = |flight: &mut FlightApp| {
            flight.mark_picture();
            flight.frame().unwrap();
            flight.camera::<Picture>().unwrap().frame.pixels().to_vec()
        };
        let plain = picture(&mut flight);
        let legend = |flight: &FlightApp| texts(&drawn(&OVERLAY, flight, [800, 600], 1.0)).concat();
        OVERLAY.switch(&mut flight, Some(0)).unwrap();
        assert!(picture(&mut flight) == plain && flight.camera::<CoatPaint>().is_none());
        assert_eq!(legend(&flight), "looking for coats");
        // The wall ahead is at 80 mm.
        let place = DVec3::new(10.0, 80.0, 10.0);
        let spot = CoatedSpot { place, normal: DVec3::NEG_Y, area_mm2: 30.0, thickness_mm: 1.5 };
        let spread = |n: usize| {
            place + DVec3::new((n % 9) as f64 - 4.0, ((n / 81) as f64 - 4.0) * 0.25, (n / 9 % 9) as f64 - 4.0)
        };
        let places = (0..729).map(spread).collect();
        flight.keep_coats(Arc::new(CoatedPlaces { spots: vec![spot], places }));
        OVERLAY.switch(&mut flight, Some(0)).unwrap();
        let painted = picture(&mut flight);
        let changed = painted.iter().zip(&plain).filter(|(a, b)| a != b).count();
        assert!(changed > 50 && changed < plain.len() / 2, "{changed}");
        assert_eq!(legend(&flight), "1 coats, 1.5 mm of tag on the mean");
        OVERLAY.switch(&mut flight, None).unwrap();
        assert!(picture(&mut flight) == plain);
    }
}
