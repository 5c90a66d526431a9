//! Pictures of a tube whose light is known.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::*;
use crate::dataset::truth::{Kind, Subject, Truth};
use crate::progress::Progress;
use crate::space::TransferFunction;
use crate::volume::{Grid, Volume};

/// A tube along z of radius 15 mm, with a bend of its wall so that no two places are alike.
fn tube() -> PreparedVolume {
    let grid = Grid::new([48, 48, 80], DVec3::ONE, DVec3::new(-24.0, -24.0, 0.0), DMat3::IDENTITY).unwrap();
    let mut data = Vec::new();
    for k in 0..80 {
        for j in 0..48 {
            for i in 0..48 {
                let p = grid.world(DVec3::new(f64::from(i), f64::from(j), f64::from(k)));
                let wall = 15.0 + 2.0 * (0.2 * p.z).sin();
                data.push(((p.truncate().length() - wall) * 400.0 - 650.0).clamp(-1000.0, 40.0) as i16);
            }
        }
    }
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

fn view(position: DVec3, forward: DVec3) -> View {
    View::new(position, forward, DVec3::Y, 100.0, 96, 80).unwrap()
}

fn crossed(volume: &PreparedVolume, view: &View) -> Truth {
    let rays = crate::render::leap::Crossings::new(volume, &Progress::new()).unwrap();
    let subject =
        Subject { volume, rays: &rays, view, tissue: None, neighbours: [None, None], rings: None, labels: None };
    let mut truth = Truth::default();
    truth.measure(subject, &[Kind::Shading], &Progress::new()).unwrap();
    truth
}

fn quiet() -> Sensor {
    Sensor { shot: 0.0, read: 0.0, ..Sensor::default() }
}

#[test]
fn a_picture_without_noise_gives_linear_light_back() {
    let (volume, look) = (tube(), Look { sensor: quiet(), linear: true, ..Look::default() });
    let view = view(DVec3::new(1.0, -2.0, 20.0), DVec3::new(0.3, 0.1, 1.0));
    let picture = Painter::new(&look, 4).draw(&volume, &view, &crossed(&volume, &view).crossings, 0);
    let mut checked = 0;
    for (linear, shown) in picture.linear.iter().zip(&picture.shown) {
        for c in (0..3).filter(|c| shown[*c] < 255) {
            let light = |number: f64| (number.max(0.0) / 255.0).powf(2.2) / f64::from(picture.exposure);
            let (number, value) = (f64::from(shown[c]), f64::from(linear[c]));
            assert!((light(number - 0.501)..=light(number + 0.501)).contains(&value), "{value} {number}");
            checked += 1;
        }
    }
    assert!(checked > 10_000, "{checked}");
}

#[test]
fn linear_light_gives_the_light_of_a_lamp_at_the_lens_back() {
    let volume = tube();
    let look = Look { lights_mm: vec![[0.0, 0.0]], cone: 0, sensor: quiet(), linear: true, ..Look::default() };
    let view = view(DVec3::new(1.0, -2.0, 20.0), DVec3::new(0.3, 0.1, 1.0));
    let truth = crossed(&volume, &view);
    for mucosa in [Mucosa::Off, Mucosa::Mild, Mucosa::Strong] {
        let picture = Painter::new(&Look { mucosa, ..look.clone() }, 4).draw(&volume, &view, &truth.crossings, 0);
        for n in 0..picture.linear.len() {
            for c in 0..3 {
                let light = (picture.linear[n][c] - picture.gloss[n]) / picture.albedo[n][c].max(1e-9);
                let told = truth.shading[n];
                assert!((light - told).abs() <= 1e-2 * told + 1e-9, "{mucosa:?} {n}: {light} {told}");
            }
        }
    }
}

#[test]
fn light_of_two_lamps_is_what_the_readme_says() {
    let volume = tube();
    let look = Look { sensor: quiet(), linear: true, ..Look::default() };
    let view = view(DVec3::new(1.0, -2.0, 20.0), DVec3::new(0.3, 0.1, 1.0));
    let truth = crossed(&volume, &view);
    let picture = Painter::new(&look, 4).draw(&volume, &view, &truth.crossings, 0);
    for (n, crossing) in truth.crossings.iter().enumerate() {
        let Some(c) = crossing else { continue };
        let of_lamp = |x: f64| {
            let way = view.position() + view.right() * x - c.place;
            let to = way.normalize();
            0.5 * to.dot(c.smooth.as_dvec3()).max(0.0) * (-to).dot(view.forward()).max(0.0) / way.length_squared()
        };
        let told = of_lamp(-3.0) + of_lamp(3.0);
        let found = f64::from((picture.linear[n][0] - picture.gloss[n]) / picture.albedo[n][0]);
        assert!((found - told).abs() <= 1e-3 * told + 1e-9, "{n}: {found} {told}");
    }
}

#[test]
fn pictures_are_the_same_on_any_number_of_threads() {
    let (volume, look) = (tube(), Look { shadows: true, linear: true, ..Look::default() });
    let view = view(DVec3::new(1.0, -2.0, 20.0), DVec3::new(0.3, 0.1, 1.0));
    let truth = crossed(&volume, &view);
    let drawn = |threads: usize, frame: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Painter::new(&look, 4).draw(&volume, &view, &truth.crossings, frame))
    };
    let one = drawn(1, 3);
    assert!(one == drawn(3, 3));
    let other = drawn(1, 4);
    assert!(one.linear == other.linear && one.shown != other.shown, "the frame chooses the noise");
    assert!(Painter::new(&look, 5).draw(&volume, &view, &truth.crossings, 3).albedo != one.albedo);
}

#[test]
fn colour_is_fixed_to_the_wall() {
    let volume = tube();
    let painter = Painter::new(&Look { mucosa: Mucosa::Strong, linear: true, ..Look::default() }, 4);
    let from = view(DVec3::new(1.0, -2.0, 20.0), DVec3::new(0.3, 0.1, 1.0));
    let truth = crossed(&volume, &from);
    let seen = painter.draw(&volume, &from, &truth.crossings, 0);
    let mut checked = 0;
    for n in (0..truth.crossings.len()).step_by(37) {
        let Some(c) = truth.crossings[n] else { continue };
        // A view whose middle pixel looks at the point.
        let eye = DVec3::new(-2.0, 3.0, 26.0);
        let other = View::new(eye, c.place - eye, DVec3::Y, 60.0, 1, 1).unwrap();
        let met = crossed(&volume, &other).crossings[0];
        let Some(met) = met.filter(|m| m.place.distance(c.place) < 1e-6) else { continue };
        let again = painter.draw(&volume, &other, &[Some(met)], 9);
        for k in 0..3 {
            assert!((again.albedo[0][k] - seen.albedo[n][k]).abs() < 2e-3, "{n}");
        }
        checked += 1;
    }
    assert!(checked > 50, "{checked}");
}

#[test]
fn the_wall_hides_a_lamp_that_is_in_it() {
    let volume = tube();
    let look = Look { lights_mm: vec![[0.0, 0.0], [60.0, 0.0]], shadows: true, linear: true, ..Look::default() };
    let view = view(DVec3::new(0.0, 0.0, 20.0), DVec3::Z);
    let truth = crossed(&volume, &view);
    let drawn = |look: &Look| Painter::new(look, 4).draw(&volume, &view, &truth.crossings, 0).linear;
    let (shadowed, free) = (drawn(&look), drawn(&Look { shadows: false, ..look.clone() }));
    assert!(shadowed.iter().zip(&free).all(|(s, f)| s[0] <= f[0]));
    // A lamp at the lens hides nothing that the lens sees.
    let at_lens = |shadows: bool| drawn(&Look { lights_mm: vec![[0.0, 0.0]], shadows, ..look.clone() });
    assert!(at_lens(true) == at_lens(false));
}

#[test]
fn no_number_is_none() {
    let volume = tube();
    let at = DVec3::new(0.0, 0.0, 20.0);
    let view = View::new(at, DVec3::Z, DVec3::Y, 90.0, 4, 4).unwrap();
    let crossing = |place: DVec3, smooth: DVec3| {
        Some(Crossing { mm: 0.0, place, tissue: place.as_vec3(), smooth: smooth.as_vec3() })
    };
    let found = [
        crossing(at, DVec3::NEG_Z),
        crossing(at + DVec3::X * 3.0, DVec3::NEG_Z),
        crossing(at + DVec3::Z * 1e-12, DVec3::NEG_Z),
        crossing(DVec3::splat(1e9), DVec3::X),
        crossing(DVec3::splat(-1e9), DVec3::ZERO),
        None,
    ];
    for lights_mm in [vec![], vec![[0.0, 0.0]], vec![[3.0, 0.0], [-3.0, 0.0]], vec![[1e9, 1e-9]]] {
        for (cone, polish, exposure) in [(0, 0, None), (1, 256, Some(1e9)), (64, 4096, Some(1e-6))] {
            let sensor = Sensor { exposure, ..Sensor::default() };
            let lights_mm = lights_mm.clone();
            let look = Look { lights_mm, cone, polish, sensor, linear: true, shadows: true, ..Look::default() };
            let picture = Painter::new(&look, 1).draw(&volume, &view, &found, 0);
            let numbers =
                picture.linear.as_flattened().iter().chain(&picture.gloss).chain(picture.albedo.as_flattened());
            let mut numbers = numbers.copied();
            assert!(numbers.all(|x| x.is_finite() && x >= 0.0) && picture.exposure.is_finite());
        }
    }
}

/// Returns the time that threads of this process ran, ms, where Linux tells it: others may use the processors, too.
fn processor_ms() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let ran = tasks.filter_map(|t| std::fs::read_to_string(t.path().join("schedstat")).ok());
    ran.filter_map(|text| text.split(' ').next()?.parse::<f64>().ok()).sum::<f64>() * 1e-6
}

/// `cargo test --release -p colvis-dataset --lib -- --ignored --nocapture time`
#[test]
#[ignore = "slow: times the drawing of 512² pixels"]
fn time_of_a_picture() {
    let volume = tube();
    let view = View::new(DVec3::new(1.0, -2.0, 20.0), DVec3::Z, DVec3::Y, 110.0, 512, 512).unwrap();
    let truth = crossed(&volume, &view);
    for (name, look) in [
        ("usual", Look::default()),
        ("off", Look { mucosa: Mucosa::Off, ..Look::default() }),
        ("linear", Look { linear: true, ..Look::default() }),
        ("shadows", Look { shadows: true, ..Look::default() }),
    ] {
        let painter = Painter::new(&look, 1);
        let least = (0..40).map(|n| {
            let begun = std::time::Instant::now();
            std::hint::black_box(painter.draw(&volume, &view, &truth.crossings, n));
            begun.elapsed()
        });
        let (before, least) = (processor_ms(), least.min().unwrap_or_default());
        let each = (processor_ms() - before) / 40.0;
        println!("{name}: {:.2} ms at least, {each:.2} ms of processors each", 1e3 * least.as_secs_f64());
    }
}
