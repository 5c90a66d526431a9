//! Colours over the bodies of gas in a slice.

use std::sync::Arc;

use rayon::prelude::*;

use super::Slice;
use crate::fields::lumen::KindMap;
use crate::render::Frame;

/// Rows of the image per task.
const ROWS: usize = 16;

/// Colours of the bodies of gas in a scan.
#[derive(Clone, Debug)]
pub struct Tint {
    /// The bodies.
    pub map: Arc<KindMap>,
    /// Red, green, blue and opacity of each body; an opacity of 0 leaves it as it is.
    pub colours: Vec<[u8; 4]>,
}

impl Tint {
    /// Lays the colours over the image of a slice. A pixel has the colour of the voxel that is nearest to its centre.
    pub fn paint(&self, slice: &Slice, frame: &mut Frame) {
        let width = frame.width();
        if width == 0 {
            return;
        }
        let step = slice.frame.right() * slice.mm_per_pixel;
        frame.buffers().0.par_chunks_mut(width * ROWS).enumerate().for_each(|(task, rows)| {
            for (n, row) in rows.chunks_exact_mut(width).enumerate() {
                let start = slice.world([0.5, (task * ROWS + n) as f64 + 0.5]);
                self.map.along(start, step, width, |part, body| {
                    if let Some(colour) = self.colours.get(body).filter(|c| c[3] > 0) {
                        row[part].iter_mut().for_each(|pixel| *pixel = over(*pixel, *colour));
                    }
                });
            }
        });
    }
}

/// Blends a colour over a pixel.
fn over(pixel: [u8; 3], [r, g, b, opacity]: [u8; 4]) -> [u8; 3] {
    let (part, opacity) = ([r, g, b], u32::from(opacity));
    std::array::from_fn(|c| ((u32::from(pixel[c]) * (255 - opacity) + u32::from(part[c]) * opacity + 127) / 255) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_covers_as_much_as_it_is_opaque() {
        assert_eq!(over([10, 200, 30], [255, 0, 99, 0]), [10, 200, 30]);
        assert_eq!(over([10, 200, 30], [255, 0, 99, 255]), [255, 0, 99]);
        assert_eq!(over([0, 100, 200], [200, 100, 0, 128]), [100, 100, 100]);
    }
}
