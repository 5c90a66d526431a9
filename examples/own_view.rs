//! Adds a rear view to colvis, shown as a picture-in-picture inset.
//!
//! `cargo run --release --example own_view` (also `-- fly --headless --record film.gif`)

use colvis::bevy_ecs::{self, prelude::*};
use colvis::components::output::{Follows, Picture};
use colvis::error::Result;
use colvis::render::Frame;
use colvis::schedule::{App, FlightSystems, Main};

/// Marks the rear view's entity.
#[derive(Component)]
struct Rear;

/// Pixels between the inset and the image's edges.
const MARGIN: usize = 12;

fn rear_view(app: &mut App) -> Result<()> {
    app.world.spawn((Rear, Picture::new(256, 192), Follows::rear()));
    app.add_systems(FlightSystems::Aim, fit_inset);
    app.add_systems(FlightSystems::PostProcess, draw_inset);
    Ok(())
}

/// Keeps the rear view a quarter as wide as the main image.
fn fit_inset(mut rear: Single<&mut Picture, With<Rear>>, main: Single<&Picture, (With<Main>, Without<Rear>)>) {
    let width = (main.into_inner().frame.width() / 4).max(1);
    rear.frame.resize(width, (width * 3 / 4).max(1));
}

/// Draws the rear view into the lower right corner, with a grey border.
fn draw_inset(rear: Single<&Picture, With<Rear>>, mut main: Single<&mut Picture, (With<Main>, Without<Rear>)>) {
    let rear = rear.into_inner();
    if main.traced {
        let (width, height) = (rear.frame.width() + 2, rear.frame.height() + 2);
        let column = main.frame.width().saturating_sub(width + MARGIN);
        let row = main.frame.height().saturating_sub(height + 5 * MARGIN);
        let mut border = Frame::new(width, height);
        border.buffers().0.fill([170; 3]);
        main.frame.draw(&border, column, row);
        main.frame.draw(&rear.frame, column + 1, row + 1);
    }
}

fn main() -> std::process::ExitCode {
    colvis::cli::Program::default().plugin(rear_view).run()
}

#[test]
fn the_corner_shows_what_lies_behind() -> Result<()> {
    use colvis::app::{FlightRequest, Scan, Scene};
    let scene = Scene { picture: true, ..Scene::default() };
    let mut flight = Scan::phantom(1)?.flight(scene.plug(rear_view)?, &FlightRequest::default())?;
    flight.frame()?;
    let (rear, picture) = (flight.other_views()[0].0, flight.camera::<Picture>().unwrap());
    let corner = &picture.frame.pixels()[(1024 - 60 - 100) * 1024 + 1024 - 12 - 100];
    assert_eq!(*corner, rear.frame.pixels()[(192 - 99) * 256 + 256 - 99]);
    Ok(assert!(rear.view.as_ref().unwrap().forward().dot(flight.pose().attitude.forward) < -0.999))
}
