//! Adds a renderer to colvis: it shows the distance to the wall as a grey value.
//!
//! `cargo run --release --example own_renderer -- fly --preset distance` (also `render`, `explain`, scene files)

use colvis::render::choices;
use colvis::render::{Frame, MemoryPart, PreparedVolume, Preset, Renderer, View, Work, first_crossing};
use rayon::prelude::*;

const DISTANCE: Preset = Preset {
    name: "distance",
    summary: "the wall's distance as a grey value",
    memory: "nothing",
    takes: choices::none,
    make: |volume, _, _| Box::new(Distance(volume.clone())),
    ..Preset::BASE
};

/// Distances from here on are black, mm.
const FAR_MM: f64 = 100.0;

struct Distance(PreparedVolume);

impl Renderer for Distance {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        frame.resize(view.width(), view.height());
        let (pixels, depth) = frame.buffers();
        let nearness = |n: usize| {
            let ray = view.ray(n % view.width(), n / view.width())?;
            first_crossing(&self.0, ray.origin, ray.direction, FAR_MM)
        };
        let found: Vec<Option<f64>> = (0..pixels.len()).into_par_iter().map(nearness).collect();
        for (pixel, mm) in pixels.iter_mut().zip(&found) {
            *pixel = [mm.map_or(0, |mm| (255.0 * (1.0 - mm / FAR_MM)) as u8); 3];
        }
        if let Some(depth) = depth {
            depth.iter_mut().zip(&found).for_each(|(d, mm)| *d = mm.map_or(f32::INFINITY, |mm| mm as f32));
        }
        Work { rays: found.len() as u64, ..Work::default() }
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        Vec::new()
    }
}

fn main() -> std::process::ExitCode {
    colvis::cli::Program::default().preset(DISTANCE).run()
}

#[test]
fn a_flight_is_seen_by_it() -> colvis::error::Result<()> {
    use colvis::app::{FlightRequest, ImageSettings, Scan, Scene};
    let image = ImageSettings { preset: DISTANCE, ..ImageSettings::default() };
    let flight = Scan::phantom(1)?.flight(Scene { image, ..Scene::default() }, &FlightRequest::default())?;
    let picture = flight.look(64, 48)?;
    assert!(picture.pixels().iter().all(|[r, g, b]| r == g && g == b) && picture.pixels().iter().any(|p| p[0] > 100));
    Ok(())
}
