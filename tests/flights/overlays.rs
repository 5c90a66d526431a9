//! The overlays of a flight: tentacles, mines and forces are drawn with their true values.

use colvis::app::overlay::{Canvas, Mark, Place2};
use colvis::app::overlays::forces::{Force, forces};
use colvis::app::{FlightApp, FlightRequest, Overlay, Scene};
use colvis::components::camera::Velocity;
use colvis::components::guide::{MineField, Tentacles};
use colvis::components::input::HandCommand;
use colvis::phantom::{PhantomSettings, Size};
use colvis::render::first_crossing;
use colvis::volume::Volume;
use glam::DVec3;

use crate::support::flights::{flight, fly};
use crate::support::phantom::phantom;

fn small() -> Volume {
    phantom(&PhantomSettings { size: Size::Small, seed: 1, ..PhantomSettings::default() }).0
}

fn flown(guide: &'static str, seconds: f64) -> FlightApp {
    let scene = Scene { picture: true, operator: true, log: true, ..Scene::guided_by(guide) };
    let mut f = flight(small(), scene, &FlightRequest::default());
    fly(&mut f, seconds);
    f
}

fn built_in(name: &str) -> Overlay {
    *colvis::app::overlays::BUILT_IN.iter().find(|o| o.name == name).unwrap()
}

/// Returns the marks of an overlay at a scale. The picture is 1024 pixels wide and high.
fn drawn(f: &FlightApp, name: &str, scale: f32) -> Vec<Mark> {
    let mut canvas = Canvas::at_scale(f.view().unwrap(), scale);
    (built_in(name).draw)(f, &mut canvas);
    canvas.into_marks()
}

fn is_at(place: &Place2, at: DVec3, f: &FlightApp) -> bool {
    let found = f.view().unwrap().project(at);
    found.is_some_and(|[x, y]| (f64::from(place[0]) - x).hypot(f64::from(place[1]) - y) < 0.01)
}

fn texts(marks: &[Mark]) -> String {
    let text = |m: &Mark| if let Mark::Text { text, .. } = m { Some(text.clone()) } else { None };
    marks.iter().filter_map(text).collect::<Vec<_>>().join("\n")
}

#[test]
fn those_of_the_engine_are_hidden_at_first_and_leave_all_keys_to_readers_and_plug_ins() {
    let hidden = colvis::app::overlays::BUILT_IN.iter().filter(|o| !o.shown);
    let keys: Vec<(&str, Option<char>)> = hidden.map(|o| (o.name, o.key)).collect();
    for name in ["tentacles", "mines", "forces"] {
        assert!(keys.contains(&(name, None)), "{keys:?}");
    }
}

#[test]
fn each_tentacle_in_the_picture_is_a_disc_where_it_touches_the_wall() {
    let f = flown("tentacles", 3.0);
    let marks = drawn(&f, "tentacles", 1.0);
    let t = f.camera::<Tentacles>().unwrap();
    let at = f.pose().position;
    let mut seen = 0;
    for (&way, &length) in t.directions.iter().zip(&t.lengths) {
        let tip = at + way * length;
        let [x, y] = f.view().unwrap().project(tip).unwrap_or([-1.0; 2]);
        if length >= t.settings.reach_mm || !(0.0..1024.0).contains(&x) || !(0.0..1024.0).contains(&y) {
            continue;
        }
        seen += 1;
        let radius = |m: &Mark| match m {
            Mark::Disc { centre, radius, .. } if is_at(centre, tip, &f) => Some(*radius),
            _ => None,
        };
        assert!(marks.iter().any(|m| radius(m).is_some()), "no disc for the tentacle of {length} mm at {x},{y}");
    }
    assert!(seen > 10, "{seen}");
    assert!(texts(&marks).contains("128 tentacles"));
    // For a guide without tentacles the overlay only draws that message.
    let text = texts(&drawn(&flown("path", 0.5), "tentacles", 1.0));
    assert!(text.contains("path has no tentacles"), "{text}");
}

#[test]
fn mines_are_filled_in_sight_and_hollow_behind_a_wall() {
    let mut f = flown("tentacles", 6.0);
    let mines: Vec<DVec3> = f.camera::<MineField>().unwrap().mines.iter().collect();
    assert!(mines.len() >= 10, "{}", mines.len());
    // Look back. The operator's look takes one step, and takes nothing from the mines.
    f.act(HandCommand::Look([180.0, 0.0])).unwrap();
    f.step().unwrap();
    let mines: Vec<DVec3> = f.camera::<MineField>().unwrap().mines.iter().collect();
    let marks = drawn(&f, "mines", 1.0);
    let at = f.pose().position;
    let (mut filled, mut hollow) = (0, 0);
    for mine in mines {
        if f.view().unwrap().project(mine).is_none() {
            continue;
        }
        let discs = marks.iter().filter(|m| matches!(m, Mark::Disc { centre, .. } if is_at(centre, mine, &f))).count();
        let rings =
            marks.iter().filter(|m| matches!(m, Mark::Circle { centre, .. } if is_at(centre, mine, &f))).count();
        let distance = at.distance(mine);
        let hidden = first_crossing(&f.setup().volume, at, (mine - at) / distance, distance).is_some();
        assert_eq!((discs > 0, rings > 0), (!hidden, hidden), "{distance} mm away");
        filled += usize::from(!hidden);
        hollow += usize::from(hidden);
    }
    assert!(filled > 1 && hollow > 1, "{filled} filled, {hollow} hollow");
}

/// The sum of the drawn forces matches the body's motion: the change of its velocity over a step.
#[test]
#[ignore = "slow: flights by every guide"]
fn the_forces_drawn_are_those_that_move_the_body() {
    for guide in ["tentacles", "potential", "path", "manual"] {
        let mut f = flown(guide, 2.0);
        let (mut compared, mut mean, mut pushed) = (0, 0.0, 0.0f64);
        for step in 0..240 {
            if step == 60 {
                f.act(HandCommand::Push([0.4, 0.2, 0.6])).unwrap();
            }
            if step == 150 {
                f.act(HandCommand::Push([0.0; 3])).unwrap();
            }
            let before = f.camera::<Velocity>().unwrap().0;
            f.step().unwrap();
            // The forces of the last step, at the place that it led to, with its new velocity. The drag is that of the
            // mean of both ends.
            let all = forces(&f);
            let after = f.camera::<Velocity>().unwrap().0;
            let sum = all.last().unwrap();
            assert_eq!(sum.name, "sum");
            let told: DVec3 = all[..all.len() - 1].iter().map(|f| f.acceleration).sum();
            assert!(told.distance(sum.acceleration) < 1e-9);
            let drag = f.setup().scene.body.drag_per_s;
            let expected = sum.acceleration + (after - before) * (0.5 * drag);
            let change = (after - before) * 120.0;
            // Within a step a potential changes with the place, and a touched wall stops motion into it.
            if f.camera::<colvis::components::camera::Contact>().unwrap().clearance_mm > 2.5 {
                compared += 1;
                let off = expected.distance(change) / (change.length().max(expected.length()) + 20.0);
                assert!(off < 0.5, "{guide}, step {step}: {change} but {expected}");
                mean += off;
            }
            let by_name = |name: &str| all.iter().find(|f: &&Force| f.name == name).unwrap().acceleration.length();
            pushed = pushed.max(by_name("operator's push"));
        }
        mean /= f64::from(compared);
        println!("{guide}: {mean:.4} off in the mean of {compared} steps");
        assert!(mean < 0.05, "{guide}: {mean}");
        assert!(compared > 100 && pushed > 100.0, "{guide}: {compared} steps, {pushed} mm/s²");
        let text = texts(&drawn(&f, "forces", 1.0));
        assert!(text.contains("wall's push") && text.contains("mm/s²") && text.contains("from above"), "{text}");
    }
}

/// The views of the surroundings are drawn once, however many overlays request them. Every row of the legend also
/// appears on a screen of twice the density.
#[test]
fn the_views_of_the_surroundings_and_the_legend_are_shared() {
    let f = flown("tentacles", 3.0);
    for scale in [1.0, 2.0] {
        let mut canvas = Canvas::at_scale(f.view().unwrap(), scale);
        for overlay in colvis::app::overlays::BUILT_IN {
            (overlay.draw)(&f, &mut canvas);
        }
        let marks = canvas.into_marks();
        let text = texts(&marks);
        assert_eq!((text.matches("from above").count(), text.matches("20 mm").count()), (1, 2), "{text}");
        let panels = marks.iter().filter(|m| matches!(m, Mark::Panel { .. })).count();
        assert_eq!(panels, 14, "two views, eleven rows of the legend, and the colour of coats");
    }
}

/// They extend down to the picture's margin, or to the text that covers its lower edge.
#[test]
fn legend_and_views_stand_above_the_foot() {
    let f = flown("tentacles", 1.0);
    for (foot, scale, free) in [(0.0, 1.0, 1014.0), (100.0, 1.0, 924.0), (60.0, 2.0, 904.0)] {
        let mut canvas = Canvas::at_scale(f.view().unwrap(), scale).with_foot(foot);
        assert_eq!(canvas.foot(), foot * scale);
        for overlay in colvis::app::overlays::BUILT_IN {
            (overlay.draw)(&f, &mut canvas);
        }
        let lowest = |m: &Mark| if let Mark::Panel { high, .. } = m { high[1] } else { 0.0 };
        assert_eq!(canvas.into_marks().iter().map(lowest).fold(0.0, f32::max), free);
    }
}

/// A recording contains the overlays that are requested, and no others.
#[test]
#[cfg(feature = "window")]
#[ignore = "slow: three recordings by the program"]
fn a_recording_carries_the_overlays_that_are_named() {
    use crate::support::run::run;
    let dir = tempfile::tempdir().unwrap();
    let recorded = |name: &str, overlays: &[&str]| {
        let folder = dir.path().join(name);
        let record = format!("{}/", folder.display());
        let args = ["fly", "--headless", "--seconds", "2", "--fps", "1", "--size", "400x300", "--record", &record];
        run(&[&args, overlays].concat(), 0);
        image::open(folder.join("0002.png")).unwrap().to_rgb8()
    };
    let plain = recorded("plain", &[]);
    let drawn = recorded("drawn", &["--overlay", "tentacles,forces"]);
    let again = recorded("again", &["--overlay", "tentacles,forces"]);
    let differ = plain.pixels().zip(drawn.pixels()).filter(|(a, b)| a != b).count();
    assert!(differ > 500 && differ < 400 * 300 / 2, "{differ} pixels");
    assert!(drawn == again, "the same bytes");
    let out = run(&["fly", "--headless", "--overlay", "halo"], 2);
    let err = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(err.contains("there is no \"halo\"") && err.contains("tentacles, mines, forces"), "{err}");
}
