//! PNG files: encodes pictures, and decodes slices and drawings.
//!
//! All kinds of PNG are decoded: palettes, grey and colour, 1 to 16 bits a sample, with and without opacity, interlaced.

use std::fmt;
use std::io::{self, BufRead, Seek, Write};

use ::png::{BitDepth, Encoder, EncodingError, Filter, Limits, Reader, Transformations};
pub use ::png::{ColorType, Compression, DecodingError};

/// Memory that a decoder may allocate beside its result, bytes.
const MOST_MEMORY: usize = 512 << 20;

/// Encodes samples of 8 bits, row by row from the top. `size` is the width and the height, pixels.
///
/// # Errors
/// Fails if writing fails, if the picture has no pixels, or if the samples are not as many as its size needs.
pub fn encode(
    to: &mut dyn Write,
    samples: &[u8],
    [width, height]: [usize; 2],
    color: ColorType,
    compression: Compression,
) -> io::Result<()> {
    let failed = |e| match e {
        EncodingError::IoError(e) => e,
        e => io::Error::other(e),
    };
    let mut encoder = Encoder::new(to, width as u32, height as u32);
    encoder.set_color(color);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(compression);
    // The compression chooses a filter, too.
    encoder.set_filter(Filter::Adaptive);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(samples).map_err(failed)?;
    writer.finish().map_err(failed)
}

/// Encodes samples of 16 bits, row by row from the top. `size` is the width and the height, pixels.
///
/// # Errors
/// As [`encode`].
pub fn encode16(to: &mut dyn Write, samples: &[u16], [width, height]: [usize; 2], color: ColorType) -> io::Result<()> {
    let failed = |e| match e {
        EncodingError::IoError(e) => e,
        e => io::Error::other(e),
    };
    let mut encoder = Encoder::new(to, width as u32, height as u32);
    encoder.set_color(color);
    encoder.set_depth(BitDepth::Sixteen);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Adaptive);
    let bytes: Vec<u8> = samples.iter().flat_map(|s| s.to_be_bytes()).collect();
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&bytes).map_err(failed)?;
    writer.finish().map_err(failed)
}

/// The reason why a PNG cannot be decoded.
#[derive(Debug)]
pub enum Fault {
    /// It cannot be read, or is damaged.
    Decoding(DecodingError),
    /// A side is longer than allowed.
    Size,
}

impl From<DecodingError> for Fault {
    fn from(e: DecodingError) -> Self {
        Self::Decoding(e)
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Decoding(e @ DecodingError::Format(_)) => write!(f, "Format error decoding Png: {e}"),
            Self::Decoding(DecodingError::LimitsExceeded) => f.write_str("Memory limit exceeded"),
            Self::Decoding(e) => e.fmt(f),
            Self::Size => f.write_str("Image size exceeds limit"),
        }
    }
}

impl std::error::Error for Fault {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Decoding(e @ DecodingError::Format(_)) => Some(e),
            _ => None,
        }
    }
}

/// A PNG of which everything before its pixels is read.
pub struct Decoder<R: BufRead + Seek>(Reader<R>);

impl<R: BufRead + Seek> Decoder<R> {
    /// Reads up to the pixels. No side may be longer than `longest` pixels.
    ///
    /// # Errors
    /// Fails if the bytes cannot be read, are damaged, or declare a longer side.
    pub fn new(from: R, longest: u32) -> Result<Self, Fault> {
        let mut decoder = ::png::Decoder::new_with_limits(from, Limits { bytes: MOST_MEMORY });
        let header = decoder.read_header_info()?;
        if header.width.max(header.height) > longest {
            return Err(Fault::Size);
        }
        // Palettes become colours, fewer than eight bits become eight, and a transparent colour becomes an opacity.
        decoder.set_transformations(Transformations::EXPAND);
        Ok(Self(decoder.read_info()?))
    }

    /// Returns the width and the height, pixels.
    pub fn size(&self) -> (u32, u32) {
        self.0.info().size()
    }

    /// Returns true if decoded samples have 16 bits.
    pub fn is_deep(&self) -> bool {
        self.0.output_color_type().1 == BitDepth::Sixteen
    }

    /// Returns the size of the decoded samples, bytes.
    pub fn bytes(&self) -> u64 {
        self.0.output_buffer_size().map_or(u64::MAX, |n| n as u64)
    }

    /// Decodes the pixels.
    ///
    /// # Errors
    /// Fails if the bytes cannot be read or are damaged.
    pub fn read(mut self) -> Result<Samples, Fault> {
        let mut bytes = vec![0; self.0.output_buffer_size().ok_or(DecodingError::LimitsExceeded)?];
        self.0.next_frame(&mut bytes)?;
        Ok(Samples { channels: self.0.output_color_type().0.samples(), deep: self.is_deep(), bytes })
    }
}

/// Decoded pixels, row by row from the top: grey, grey and opacity, red, green and blue, or these and opacity.
pub struct Samples {
    channels: usize,
    /// True for 16 bits, the more significant byte first; false for 8.
    deep: bool,
    bytes: Vec<u8>,
}

/// Weights of red, green and blue in the luminance: the Y row of the matrix from sRGB's primaries (ITU-R BT.709) and white (D65) to
/// CIE XYZ. Rounded to four digits they are those of BT.709.
const LUMINANCE: [f32; 3] = [0.212_647_84, 0.715_179_2, 0.072_173_04];

impl Samples {
    fn sample(&self, n: usize) -> u16 {
        if self.deep { u16::from_be_bytes([self.bytes[2 * n], self.bytes[2 * n + 1]]) } else { self.bytes[n].into() }
    }

    fn pixels(&self) -> std::ops::Range<usize> {
        0..self.bytes.len() / (self.channels * if self.deep { 2 } else { 1 })
    }

    /// Returns the grey value of each pixel, 0 to 65535: eight bits are spread over that range. Colours become their luminance, of as
    /// many bits as they have. Opacity is left out.
    pub fn grey(&self) -> impl Iterator<Item = u16> {
        let (full, spread) = if self.deep { (65535.0, 1) } else { (255.0, 257) };
        let part = 1.0 / full;
        let luminance = move |rgb: [u16; 3]| {
            let y = rgb.iter().zip(LUMINANCE).fold(0.0, |y, (v, weight)| y + f32::from(*v) * part * weight);
            (y * full).round().min(full) as u16
        };
        self.pixels().map(move |p| {
            let first = p * self.channels;
            let colour = self.channels > 2;
            spread * if colour { luminance([0, 1, 2].map(|c| self.sample(first + c))) } else { self.sample(first) }
        })
    }

    /// Returns red, green, blue and opacity of each pixel, rounded to 8 bits.
    pub fn rgba(&self) -> impl Iterator<Item = [u8; 4]> {
        let byte = |n| if self.deep { (u32::from(self.sample(n)) + 128) / 257 } else { self.sample(n).into() } as u8;
        self.pixels().map(move |p| {
            let at = |c| byte(p * self.channels + c);
            match self.channels {
                1 => [at(0), at(0), at(0), 255],
                2 => [at(0), at(0), at(0), at(1)],
                3 => [at(0), at(1), at(2), 255],
                _ => [at(0), at(1), at(2), at(3)],
            }
        })
    }
}

#[cfg(test)]
#[path = "png_tests.rs"]
mod tests;
