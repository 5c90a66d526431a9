//! Flies through a drawing without a window and writes a picture of the whole flight, or a film.

use std::path::Path;

use super::record::{Recorder, write_png};
use crate::error::{Error, Result};
use crate::plane::flight::HZ;
use crate::plane::picture::{Painter, Show};
use crate::plane::{Flight, State};
use crate::progress::Progress;
use crate::render::{Frame, ImageSize};

/// Approximate size of the picture, pixels.
const SIZE: ImageSize = ImageSize::new(800, 800);
/// Steps per picture of a film. Together with the pictures per second this plays 2.5 times as fast as the flight.
const STEPS: usize = 24;
const FPS: f64 = 12.5;
/// Number of pixels beyond which a film has half as many pictures.
const MANY_PIXELS: usize = 1 << 20;

/// Kind of output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Film {
    /// The last moment, with the whole path.
    Picture,
    /// The whole flight.
    Film,
}

impl Film {
    /// Selects the kind of output by the extension of `out`.
    ///
    /// # Errors
    /// Returns status 2 for an extension other than `.png` and `.gif`.
    #[doc(hidden)]
    pub fn check(out: &Path) -> Result<Self> {
        match out.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
            Some("png") => Ok(Self::Picture),
            Some("gif") => Ok(Self::Film),
            _ => {
                let what = format!("--out {}", out.display());
                Err(Error::usage(what, "does not end in .png or .gif", "give a .png or a .gif"))
            }
        }
    }
}

/// Flies until the flight is over and writes it to `out`. The result of the flight is in `flight`.
///
/// # Errors
/// Returns status 2 for an unknown extension, 4 if interrupted, 5 if the output cannot be written.
#[doc(hidden)]
pub fn fly(flight: &mut Flight, out: &Path, progress: &Progress) -> Result<()> {
    let film = Film::check(out)?;
    let mut painter = Painter::new(flight);
    let scale = Painter::scale_for(flight, SIZE);
    let mut frame = Frame::default();
    let drawing = flight.walls().drawing();
    let size = ImageSize::new(drawing.width() * scale, drawing.height() * scale);
    let mut recorder = match film {
        Film::Picture => None,
        Film::Film => Some(Recorder::create(&out.to_string_lossy(), size, FPS)?),
    };
    // A film of a large drawing has fewer pictures.
    let every = STEPS * size.pixels().div_ceil(MANY_PIXELS);
    let mut steps = 0;
    while flight.state() == State::Flying {
        if let Some(r) = recorder.as_mut().filter(|_| steps % every == 0) {
            painter.paint(flight, Show::default(), scale, &mut frame);
            r.add(&frame)?;
        }
        flight.step();
        steps += 1;
        if steps % HZ as usize == 0 {
            progress.check()?;
        }
    }
    painter.paint(flight, Show::default(), scale, &mut frame);
    match recorder {
        None => write_png(out, &frame),
        Some(mut r) => {
            // Hold the last picture for a while.
            for _ in 0..FPS as usize {
                r.add(&frame)?;
            }
            r.finish()
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use image::AnimationDecoder;
    use image::codecs::gif::GifDecoder;

    use super::*;
    use crate::plane::{Drawing, PlaneSettings};

    /// A flight of a quarter of a second through a corridor of 248 × 18 mm.
    fn flight() -> Flight {
        let lumen = (0..500 * 40).map(|n| (2..498).contains(&(n % 500)) && (2..38).contains(&(n / 500))).collect();
        let mut drawing = Drawing::new("corridor", ImageSize::new(500, 40), lumen).unwrap();
        (drawing.start, drawing.goal) = (Some(DVec3::new(20.0, 10.0, 0.0)), Some(DVec3::new(230.0, 10.0, 0.0)));
        Flight::new(drawing, PlaneSettings { seconds: 0.25, ..PlaneSettings::default() }).unwrap()
    }

    #[test]
    fn a_film_shows_the_flight_and_holds_its_end_and_a_picture_is_the_end() {
        let dir = tempfile::tempdir().unwrap();
        let [film, picture] = ["a.gif", "a.png"].map(|n| dir.path().join(n));
        let mut flown = flight();
        fly(&mut flown, &film, &Progress::new()).unwrap();
        assert_eq!((flown.state(), flown.places().len()), (State::Ended, 31), "0.25 s are 30 steps");
        let file = std::io::BufReader::new(std::fs::File::open(&film).unwrap());
        let frames = GifDecoder::new(file).unwrap().into_frames().collect_frames().unwrap();
        // Steps 0 and 24, then the end for a second.
        assert_eq!(frames.len(), 2 + 12);
        assert!(frames[0].buffer() != frames[1].buffer() && frames[1].buffer() != frames[2].buffer());
        assert!(frames[2].buffer() == frames[13].buffer());
        fly(&mut flight(), &picture, &Progress::new()).unwrap();
        assert_eq!(image::image_dimensions(&picture).unwrap(), (500, 40));
    }
}
