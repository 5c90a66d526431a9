//! Rendered pictures and counts of the work they took.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use rayon::prelude::*;

use crate::error;
use crate::output::{self, png};

/// Number of pixels that a thread copies at a time.
const PART: usize = 1 << 16;

/// The size of an image, pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImageSize {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
}

impl ImageSize {
    /// Creates a size.
    pub const fn new(width: usize, height: usize) -> Self {
        Self { width, height }
    }

    /// Returns the number of pixels.
    pub const fn pixels(self) -> usize {
        self.width * self.height
    }

    /// Returns the shorter side.
    pub fn shorter(self) -> usize {
        self.width.min(self.height)
    }
}

impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// Reads `WxH`.
impl FromStr for ImageSize {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let (w, h) = s.split_once(['x', 'X']).ok_or("is not WxH")?;
        let side = |t: &str| t.trim().parse().ok().filter(|n| (1..=16384).contains(n));
        let sides = side(w).zip(side(h)).map(|(width, height)| Self { width, height });
        sides.ok_or_else(|| "a side must be a whole number from 1 to 16384 pixels".to_owned())
    }
}

/// A rendered picture, row 0 on top. Reuse it: rendering into a frame of the right size does not allocate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
    depth: Option<Vec<f32>>,
}

impl Frame {
    /// Creates a black picture of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![[0; 3]; width * height], depth: None }
    }

    /// Creates a black picture of `width` × `height` pixels with a depth for each pixel, initially infinite.
    pub fn with_depth(width: usize, height: usize) -> Self {
        Self { depth: Some(vec![f32::INFINITY; width * height]), ..Self::new(width, height) }
    }

    /// Returns the number of pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the size.
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }

    /// Returns red, green and blue of each pixel, row by row.
    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// Returns the distance from the camera to the wall for each pixel, row by row, mm. It is infinite where there is
    /// no wall. `None` if the frame was created without depth.
    pub fn depth(&self) -> Option<&[f32]> {
        self.depth.as_deref()
    }

    /// Resizes the frame to `width` × `height`, reusing its memory if that is large enough.
    pub fn resize(&mut self, width: usize, height: usize) {
        if (self.width, self.height) != (width, height) {
            (self.width, self.height) = (width, height);
            self.pixels.resize(width * height, [0; 3]);
            if let Some(depth) = &mut self.depth {
                depth.resize(width * height, f32::INFINITY);
            }
        }
    }

    /// Copies the pixels of another picture, taking its size. The depth of this frame is left alone.
    pub fn show(&mut self, other: &Self) {
        self.resize(other.width, other.height);
        let parts = self.pixels.par_chunks_mut(PART).zip(other.pixels.par_chunks(PART));
        parts.for_each(|(to, from)| to.copy_from_slice(from));
    }

    /// Draws another picture into this one with its top left pixel at `column`, `row`. Pixels beyond the edges are cut off.
    pub fn draw(&mut self, other: &Self, column: usize, row: usize) {
        let across = other.width.min(self.width.saturating_sub(column));
        if across == 0 {
            return;
        }
        let rows = self.pixels.chunks_exact_mut(self.width).skip(row);
        for (to, from) in rows.zip(other.pixels.chunks_exact(other.width)) {
            to[column..column + across].copy_from_slice(&from[..across]);
        }
    }

    /// Writes the pixels as an 8-bit RGB PNG file, completely or not at all.
    ///
    /// Depth does not fit into it: write [`Frame::depth`] with [`write_npy`](crate::output::write_npy).
    ///
    /// ```
    /// # use colvis_imaging as colvis;
    /// use colvis::output::write_npy;
    /// use colvis::render::Frame;
    ///
    /// # let folder = std::env::temp_dir().join(format!("colvis-frame-{}", std::process::id()));
    /// # colvis::output::make_folder(&folder)?;
    /// let mut frame = Frame::with_depth(4, 3);
    /// frame.buffers().0.fill([200, 90, 80]);
    /// frame.write_png(folder.join("picture.png"))?;
    /// if let Some(depth) = frame.depth() {
    ///     write_npy(&folder.join("depth.npy"), depth, &[frame.height(), frame.width()])?; // mm, row 0 on top
    /// }
    /// # let _ = std::fs::remove_dir_all(folder);
    /// # Ok::<(), colvis::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written, or if it has no pixels.
    pub fn write_png(&self, path: impl AsRef<Path>) -> error::Result<()> {
        output::write_whole(path.as_ref(), |w| self.encode_png(w))
    }

    /// Writes the pixels as PNG.
    #[doc(hidden)]
    pub fn encode_png(&self, to: &mut dyn std::io::Write) -> std::io::Result<()> {
        let size = [self.width, self.height];
        png::encode(to, self.pixels.as_flattened(), size, png::ColorType::Rgb, png::Compression::Fast)
    }

    /// Returns the pixels and, if present, the depth for writing.
    pub fn buffers(&mut self) -> (&mut [[u8; 3]], Option<&mut [f32]>) {
        (&mut self.pixels, self.depth.as_deref_mut())
    }
}

/// The work that a picture took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Rays cast for the image, not counting those for depth.
    pub rays: u64,
    /// Samples evaluated along them.
    pub samples: u64,
    /// Rays that an earlier picture shortened or made unnecessary.
    pub reused: u64,
    /// Rays that the paper's own rule would have started too late, based on an earlier picture, and that were corrected.
    pub misled: u64,
}

impl std::ops::Add for Work {
    type Output = Self;

    fn add(self, o: Self) -> Self {
        Self {
            rays: self.rays + o.rays,
            samples: self.samples + o.samples,
            reused: self.reused + o.reused,
            misled: self.misled + o.misled,
        }
    }
}

/// Returns the peak signal-to-noise ratio of two pictures of the same size in dB, over all colours. It is infinite if
/// they are equal.
pub fn psnr(a: &Frame, b: &Frame) -> f64 {
    let square = |(a, b): (&u8, &u8)| u64::from(a.abs_diff(*b)).pow(2);
    let sum: u64 = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened()).map(square).sum();
    let mean = sum as f64 / a.pixels.as_flattened().len() as f64;
    10.0 * (255.0 * 255.0 / mean).log10()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;

    #[test]
    fn a_picture_is_written_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        let mut frame = Frame::with_depth(3, 2);
        frame.buffers().0.copy_from_slice(&[[1, 2, 3], [4, 5, 6], [7, 8, 9], [250, 0, 9], [0, 0, 0], [255; 3]]);
        frame.write_png(&path).unwrap();
        let read = image::open(&path).unwrap().into_rgb8();
        assert_eq!((read.dimensions(), read.as_raw().as_slice()), ((3, 2), frame.pixels().as_flattened()));
        let before = std::fs::read(&path).unwrap();
        let error = Frame::default().write_png(&path).unwrap_err();
        assert_eq!(error.kind, Kind::Output, "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), before, "a picture without pixels leaves the old file alone");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
        assert_eq!(frame.write_png(folder.path().join("none/picture.png")).unwrap_err().kind, Kind::Output);
    }

    #[test]
    fn a_picture_is_drawn_into_another_as_far_as_it_fits() {
        let mut small = Frame::new(2, 3);
        small.buffers().0.copy_from_slice(&[[1; 3], [2; 3], [3; 3], [4; 3], [5; 3], [6; 3]]);
        let drawn = |column, row| {
            let mut large = Frame::new(4, 4);
            large.draw(&small, column, row);
            large.pixels().iter().map(|p| p[0]).collect::<Vec<_>>()
        };
        assert_eq!(drawn(1, 0), [0, 1, 2, 0, 0, 3, 4, 0, 0, 5, 6, 0, 0, 0, 0, 0]);
        assert_eq!(drawn(3, 2), [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 3]);
        assert_eq!(drawn(4, 0), [0; 16]);
        assert_eq!(drawn(0, 9), [0; 16]);
        Frame::default().draw(&small, 0, 0);
        Frame::new(4, 4).draw(&Frame::default(), 0, 0);
    }
}
