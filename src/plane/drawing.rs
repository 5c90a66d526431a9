//! A drawn lumen: a PNG whose bright pixels are lumen.

use std::io::Cursor;
use std::path::Path;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::output::png::{Decoder, Fault, Samples};
use crate::render::ImageSize;

/// Scale of a drawing: length of a pixel's side, mm.
pub const MM_PER_PIXEL: f64 = 0.5;
/// Maximum side length of a drawing, pixels: two metres.
pub const MOST_PIXELS: u32 = 4096;
/// Minimum brightness of a lumen pixel (0 to 255), unless it is transparent.
const BRIGHT: u32 = 128;
/// A start is red and a goal green: minimum of the marking channel, and maximum of the two others.
const COLOUR: (u8, u8) = (160, 96);

/// The lumen pixels of a drawing, and where the flight starts and ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    width: usize,
    height: usize,
    lumen: Vec<bool>,
    /// Centroid of the red pixels, mm.
    pub start: Option<DVec3>,
    /// Centroid of the green pixels, mm.
    pub goal: Option<DVec3>,
}

impl Drawing {
    /// Creates a drawing of `width` × `height` pixels, row by row, without start and goal. Messages call it `what`.
    ///
    /// # Errors
    /// Returns status 3 if the drawing is too small or too large, has the wrong number of pixels, or has no lumen or no wall.
    pub fn new(what: &str, ImageSize { width, height }: ImageSize, lumen: Vec<bool>) -> Result<Self> {
        let refuse = |why: String, hint: &str| Err(Error::input(what, why, hint));
        if width < 3 || height < 3 {
            return refuse(format!("is {width}x{height} pixels, too small for a lumen"), "draw at least 3x3 pixels");
        }
        if width.max(height) > MOST_PIXELS as usize {
            return refuse(
                format!("is {width}x{height} pixels, more than {MOST_PIXELS} a side"),
                "draw it smaller: a pixel is half a millimetre",
            );
        }
        if lumen.len() != width * height {
            return refuse(format!("has {} pixels instead of {}", lumen.len(), width * height), "give every pixel");
        }
        if !lumen.contains(&true) {
            return refuse("has no lumen: every pixel is dark or transparent".to_owned(), "draw the lumen bright");
        }
        if !lumen.contains(&false) {
            return refuse("has no wall: every pixel is bright".to_owned(), "draw the wall dark");
        }
        Ok(Self { width, height, lumen, start: None, goal: None })
    }

    /// Reads a PNG file.
    ///
    /// # Errors
    /// Returns status 3 if the file cannot be read, is not a PNG, or is not a drawing of a lumen.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| {
            let why = format!("cannot be read ({})", crate::output::plain(&e));
            Error::file(path, why, format!("give a PNG, or one of {}", super::files::names())).caused_by(e)
        })?;
        Self::decode(&path.display().to_string(), &bytes)
    }

    /// Decodes a PNG that messages call `what`.
    ///
    /// # Errors
    /// Returns status 3 as [`Drawing::read`] does.
    pub fn decode(what: &str, bytes: &[u8]) -> Result<Self> {
        let broken = |e: Fault| Error::input(what, format!("is not a readable PNG ({e})"), "give a PNG").caused_by(e);
        // The size is in the header: an image that is too large is refused before any of it is unpacked.
        let decoder = Decoder::new(Cursor::new(bytes), u32::MAX).map_err(broken)?;
        let (width, height) = decoder.size();
        let size = ImageSize::new(width as usize, height as usize);
        if width > MOST_PIXELS || height > MOST_PIXELS || width < 3 || height < 3 {
            return Self::new(what, size, Vec::new());
        }
        Self::from_samples(what, size, &decoder.read().map_err(broken)?)
    }

    fn from_samples(what: &str, size: ImageSize, samples: &Samples) -> Result<Self> {
        let (mut red, mut green) = (Mark::default(), Mark::default());
        let lumen = samples
            .rgba()
            .enumerate()
            .map(|(n, [r, g, b, a])| {
                if a < 128 {
                    return false;
                }
                let (full, rest) = COLOUR;
                let at = pixel_centre(n % size.width, n / size.width);
                if r >= full && g <= rest && b <= rest {
                    red.add(at);
                    true
                } else if g >= full && r <= rest && b <= rest {
                    green.add(at);
                    true
                } else {
                    // Rec. 601 weights, as image editors convert colours to grey.
                    299 * u32::from(r) + 587 * u32::from(g) + 114 * u32::from(b) >= 1000 * BRIGHT
                }
            })
            .collect();
        let drawing = Self::new(what, size, lumen)?;
        Ok(Self { start: red.middle(), goal: green.middle(), ..drawing })
    }

    /// Returns the number of pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns true if a pixel is lumen. Everything outside the drawing is wall.
    pub fn is_lumen(&self, i: i64, j: i64) -> bool {
        (0..self.width as i64).contains(&i)
            && (0..self.height as i64).contains(&j)
            && self.lumen[i as usize + self.width * j as usize]
    }

    /// Returns all pixels, row by row; true for lumen.
    pub fn lumen(&self) -> &[bool] {
        &self.lumen
    }
}

/// Returns the centre of a pixel, mm.
pub fn pixel_centre(i: usize, j: usize) -> DVec3 {
    DVec3::new(i as f64 + 0.5, j as f64 + 0.5, 0.0) * MM_PER_PIXEL
}

/// Accumulates the centroid of marked pixels.
#[derive(Default)]
struct Mark {
    sum: DVec3,
    count: f64,
}

impl Mark {
    fn add(&mut self, at: DVec3) {
        self.sum += at;
        self.count += 1.0;
    }

    fn middle(&self) -> Option<DVec3> {
        (self.count > 0.0).then(|| self.sum / self.count)
    }
}

#[cfg(test)]
mod tests {
    use image::{ImageBuffer, ImageFormat, Rgba, RgbaImage};

    use super::*;

    fn png(image: &RgbaImage) -> Vec<u8> {
        let mut out = Cursor::new(Vec::new());
        image.write_to(&mut out, ImageFormat::Png).unwrap();
        out.into_inner()
    }

    #[test]
    fn bright_is_lumen_and_colours_mark() {
        let image = ImageBuffer::from_fn(4, 3, |i, j| match (i, j) {
            (1, 1) => Rgba([255, 0, 0, 255]),
            (2, 1) => Rgba([0, 255, 0, 255]),
            (3, 1) => Rgba([255, 255, 255, 0]),
            (0, 1) => Rgba([200, 200, 200, 255]),
            _ => Rgba([20, 20, 20, 255]),
        });
        let d = Drawing::decode("d", &png(&image)).unwrap();
        assert_eq!((d.width(), d.height()), (4, 3));
        assert_eq!(d.start, Some(DVec3::new(0.75, 0.75, 0.0)));
        assert_eq!(d.goal, Some(DVec3::new(1.25, 0.75, 0.0)));
        let row: Vec<bool> = (-1..5).map(|i| d.is_lumen(i, 1)).collect();
        assert_eq!(row, [false, true, true, true, false, false], "transparent and beyond the border is wall");
        assert!(!d.is_lumen(1, 0) && !d.is_lumen(1, -1) && !d.is_lumen(1, 3));
    }

    #[test]
    fn what_is_no_drawing_is_refused_with_its_reason() {
        let grey = |w, h, g: u8| png(&ImageBuffer::from_pixel(w, h, Rgba([g, g, g, 255])));
        for (bytes, why) in [
            (grey(1, 1, 255), "too small"),
            (grey(9, 9, 0), "no lumen"),
            (grey(9, 9, 255), "no wall"),
            (grey(4097, 3, 255), "more than 4096"),
            (b"GIF89a".to_vec(), "not a readable PNG"),
            (Vec::new(), "not a readable PNG"),
            (grey(9, 9, 0)[..40].to_vec(), "not a readable PNG"),
        ] {
            let e = Drawing::decode("d.png", &bytes).unwrap_err();
            assert!(e.to_string().contains(why) && e.kind as i32 == 3, "{e}");
        }
    }

    #[test]
    fn colours_count_by_their_brightness() {
        // 299 · 255 + 587 · 150 = 164 295 for the orange; 587 · 150 + 114 · 255 = 117 120 for the blue; 128 000 is bright.
        let (orange, blue) = (Rgba([255, 150, 0, 255]), Rgba([0, 150, 255, 255]));
        let image = ImageBuffer::from_fn(4, 3, |i, _| if i < 2 { orange } else { blue });
        let d = Drawing::decode("d", &png(&image)).unwrap();
        assert_eq!(d.lumen()[..4], [true, true, false, false]);
        assert!(d.start.is_none() && d.goal.is_none());
    }

    #[test]
    fn a_drawing_may_be_4096_pixels_long() {
        for (w, h) in [(MOST_PIXELS, 3), (3, MOST_PIXELS)] {
            let image =
                ImageBuffer::from_fn(w, h, |i, j| Rgba(if i == 1 && j == 1 { [255; 4] } else { [0, 0, 0, 255] }));
            let d = Drawing::decode("d", &png(&image)).unwrap();
            assert_eq!((d.width(), d.height(), d.is_lumen(1, 1)), (w as usize, h as usize, true));
        }
    }
}
