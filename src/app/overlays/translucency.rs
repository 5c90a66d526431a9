//! What lies behind the wall, as its colour: tag, fat, soft tissue or gas; with a legend. In the whole picture, or in a lens.

use super::{GREY, WHITE, legend_row, legend_text, ring};
use crate::components::output::Picture;
use crate::components::translucent::Translucent;
use crate::error::Result;
use crate::overlay::Canvas;
use crate::render::Options;
use crate::render::translucency::{TissueRange, TranslucencySettings};
use crate::render::wall_paint::PaintedArea;
use crate::{FlightApp, Overlay};

/// The overlay.
pub const OVERLAY: Overlay = Overlay {
    name: "translucency",
    summary: "translucency: what lies behind the wall",
    key: Some('5'),
    ways: &["in the whole picture", "in a lens at the pointer"],
    switch: Some(switch),
    check: |options| TranslucencySettings::read(options).map(drop),
    draw,
    ..Overlay::PLAIN
};

/// The way that shows a lens.
const LENS: usize = 1;

fn switch(flight: &mut FlightApp, options: Options, way: Option<usize>) -> Result<()> {
    let Some(way) = way else { return flight.show_translucency(None) };
    if flight.camera::<Translucent>().is_none() {
        flight.show_translucency(Some(TranslucencySettings::read(options)?))?;
    }
    let area = if way == LENS { lens(flight, None) } else { PaintedArea::Whole };
    flight.look_through(area);
    Ok(())
}

/// Moves the lens to a pixel of the picture, if there is one.
pub fn move_lens(flight: &mut FlightApp, to: [f64; 2]) {
    if flight.camera::<Translucent>().is_some_and(|t| t.area != PaintedArea::Whole) {
        let area = lens(flight, Some(to));
        flight.look_through(area);
    }
}

/// Returns the lens at a pixel of the picture, or in its middle.
fn lens(flight: &FlightApp, at: Option<[f64; 2]>) -> PaintedArea {
    let share = flight.camera::<Translucent>().map_or(0.0, |t| t.translucency.settings().lens);
    let size = flight.camera::<Picture>().map(|p| p.frame.size()).unwrap_or_default();
    let centre = at.unwrap_or([0.5 * size.width as f64, 0.5 * size.height as f64]).map(|c| c as f32);
    PaintedArea::Lens { centre, radius: (share * size.shorter() as f64) as f32 }
}

fn draw(flight: &FlightApp, canvas: &mut Canvas) {
    let Some(shown) = flight.camera::<Translucent>() else { return };
    if let PaintedArea::Lens { centre, radius } = shown.area {
        ring(canvas, centre, radius, WHITE);
    }
    let settings = shown.translucency.settings();
    // The legend grows upwards.
    for range in &settings.ranges {
        let Some(row) = legend_row(canvas) else { return };
        let pt = canvas.scale();
        let side = 5.0 * pt;
        canvas.panel([row[0], row[1] - side], [row[0] + 2.0 * side, row[1] + side], range.colour, 1.0);
        legend_text(canvas, row, 18.0, range.name.clone(), WHITE);
        legend_text(canvas, row, 118.0, values(range, &settings.ranges), GREY);
    }
    if let Some(row) = legend_row(canvas) {
        legend_text(canvas, row, 0.0, format!("behind the wall, 0 to {} mm", settings.depth_mm), WHITE);
    }
}

/// Returns a range in words. The first has no lower end and the last no upper one.
fn values(range: &TissueRange, all: &[TissueRange]) -> String {
    let is = |other: Option<&TissueRange>| other.is_some_and(|o| std::ptr::eq(o, range));
    let [low, high] = range.hu.map(|hu| format!("{hu}").replace('-', "−"));
    match (is(all.first()), is(all.last())) {
        (true, false) => format!("up to {high} HU"),
        (false, true) => format!("from {low} HU"),
        _ => format!("{low} to {high} HU"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;
    use crate::overlay::Mark;
    use crate::overlays::tests::{drawn, flight_in_a_room, texts};

    fn flight() -> FlightApp {
        let mut flight = flight_in_a_room(Scene { picture: true, ..Scene::guided_by("tentacles") });
        flight.camera_mut::<Picture>().unwrap().frame.resize(320, 240);
        flight.frame().unwrap();
        flight
    }

    fn picture(flight: &mut FlightApp) -> Vec<[u8; 3]> {
        flight.mark_picture();
        flight.frame().unwrap();
        flight.camera::<Picture>().unwrap().frame.pixels().to_vec()
    }

    #[test]
    fn it_colours_the_picture_while_it_is_shown_and_a_lens_a_part_of_it() {
        let mut flight = flight();
        let plain = picture(&mut flight);
        OVERLAY.switch(&mut flight, Some(0)).unwrap();
        let whole = picture(&mut flight);
        let red = |p: &[u8; 3]| p[0] > 0;
        let changed = whole.iter().zip(&plain).filter(|(a, b)| a != b).count();
        assert!(changed > plain.iter().filter(|p| red(p)).count() * 9 / 10, "{changed}");
        OVERLAY.switch(&mut flight, Some(LENS)).unwrap();
        let lens = picture(&mut flight);
        let changed: Vec<usize> = (0..plain.len()).filter(|&n| lens[n] != plain[n]).collect();
        assert!(!changed.is_empty() && changed.iter().all(|&n| lens[n] == whole[n]));
        let near = |n: usize, x: f32, y: f32| ((n % 320) as f32 - x).hypot((n / 320) as f32 - y) < 49.0;
        assert!(changed.iter().all(|&n| near(n, 160.0, 120.0)), "in the middle");
        move_lens(&mut flight, [10.0, 20.0]);
        let lens = picture(&mut flight);
        assert!((0..plain.len()).all(|n| lens[n] == plain[n] || near(n, 10.0, 20.0)));
        OVERLAY.switch(&mut flight, None).unwrap();
        assert_eq!(picture(&mut flight), plain);
        move_lens(&mut flight, [10.0, 20.0]);
        assert!(flight.camera::<Translucent>().is_none());
    }

    #[test]
    fn the_legend_names_each_range() {
        let mut flight = flight();
        assert!(drawn(&OVERLAY, &flight, [800, 600], 1.0).is_empty(), "nothing before it is shown");
        OVERLAY.switch(&mut flight, Some(0)).unwrap();
        let marks = drawn(&OVERLAY, &flight, [800, 600], 1.0);
        let expected =
            ["gas", "up to −350 HU", "fat", "−140 to −40 HU", "soft tissue", "−5 to 110 HU", "tag", "from 160 HU"];
        let title = ["behind the wall, 0 to 5 mm"];
        assert_eq!(texts(&marks), [&expected[..], &title[..]].concat());
        OVERLAY.switch(&mut flight, Some(LENS)).unwrap();
        let lens = drawn(&OVERLAY, &flight, [800, 600], 1.0);
        assert!(lens.iter().any(|m| matches!(m, Mark::Circle { radius, .. } if *radius == 48.0)), "{lens:?}");
    }

    #[test]
    fn its_table_is_in_the_scene_file() {
        let scene = |text: &str| Scene::parse(text, &crate::Catalog::default());
        let head = "plugins = [\"tentacles\"]\n[overlay.translucency]\n";
        let good = scene(&format!("{head}depth_mm = 3.5")).unwrap();
        let options = good.options.overlay(OVERLAY).options;
        assert_eq!(TranslucencySettings::read(options).unwrap().depth_mm, 3.5);
        let e = scene(&format!("{head}depth_mm = -1")).unwrap_err().to_string();
        assert!(e.contains("depth_mm") && e.contains("line 3") && e.contains("is -1"), "{e}");
    }
}
