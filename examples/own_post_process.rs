//! Adds a post-process to colvis: images in the colours of mucosa, darker towards the edges.
//!
//! `cargo run --release --example own_post_process` (also `-- fly --headless --record film.gif`)

use colvis::bevy_ecs::prelude::*;
use colvis::components::output::Picture;
use colvis::error::Result;
use colvis::schedule::{App, FlightSystems};
use rayon::prelude::*;

/// Colours of the darkest, middle and brightest pixels.
const TISSUE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [190.0, 88.0, 70.0], [255.0, 232.0, 214.0]];

fn tissue_colours(app: &mut App) -> Result<()> {
    app.add_systems(FlightSystems::PostProcess, (colour, darken_edges));
    Ok(())
}

/// Maps each pixel's brightness to a colour. Views that were not traced in this frame are coloured already.
fn colour(mut views: Query<&mut Picture>) {
    let colours: Vec<[u8; 3]> = (0..=255u8)
        .map(|light| {
            let (at, dark) = (f32::from(light) / 127.5, usize::from(light >= 128));
            let share = at - dark as f32;
            [0, 1, 2].map(|c| (TISSUE[dark][c] * (1.0 - share) + TISSUE[dark + 1][c] * share).round() as u8)
        })
        .collect();
    for mut view in views.iter_mut().filter(|v| v.traced) {
        view.frame.buffers().0.par_iter_mut().for_each(|p| *p = colours[usize::from(p[0])]);
    }
}

/// Darkens pixels by up to a third, with the square of their distance from the centre.
fn darken_edges(mut views: Query<&mut Picture>) {
    for mut view in views.iter_mut().filter(|v| v.traced) {
        let (width, height) = (view.frame.width() as f32, view.frame.height() as f32);
        let rows = view.frame.buffers().0.par_chunks_mut(width as usize).enumerate();
        rows.for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let (x, y) = (x as f32 / width - 0.5, y as f32 / height - 0.5);
                *pixel = pixel.map(|c| (f32::from(c) * (1.0 - (x * x + y * y) * 2.0 / 3.0)) as u8);
            }
        });
    }
}

fn main() -> std::process::ExitCode {
    colvis::cli::Program::default().plugin(tissue_colours).run()
}

#[test]
fn mucosa_is_red() -> Result<()> {
    use colvis::app::{FlightRequest, Scan, Scene};
    let scene = Scene { picture: true, ..Scene::default() };
    let mut flight = Scan::phantom(1)?.flight(scene.plug(tissue_colours)?, &FlightRequest::default())?;
    flight.frame()?;
    let red = flight.camera::<Picture>().unwrap().frame.pixels().iter().filter(|p| p[0] > p[1] && p[1] > p[2]).count();
    Ok(assert!(red > 1024 * 1024 / 2))
}
