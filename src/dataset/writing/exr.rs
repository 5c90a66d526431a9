//! OpenEXR files of one part: rows of 32-bit floats that are not compressed (Kainz et al., Technical Introduction to OpenEXR, 2013, and
//! OpenEXR File Layout). A library that also compresses would be the largest dependency of this crate.

use std::io::{Result, Write};

/// Magic number and version 2.
const HEAD: [u8; 8] = [0x76, 0x2F, 0x31, 0x01, 2, 0, 0, 0];

/// A channel: its name, its values one after another, how many a pixel has, and which of them is meant.
pub(super) type Channel<'a> = (&'a str, &'a [f32], usize, usize);

/// Writes channels, which are in the order of their names' bytes, row by row from the top. `size` is the width and the height, pixels.
pub(super) fn encode(
    to: &mut dyn Write,
    channels: &[Channel<'_>],
    [width, height]: [usize; 2],
    comment: &str,
) -> Result<()> {
    let mut head = HEAD.to_vec();
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        for text in [name, kind] {
            head.extend(text.as_bytes());
            head.push(0);
        }
        head.extend((value.len() as u32).to_le_bytes());
        head.extend(value);
    };
    let mut list = Vec::new();
    for (name, ..) in channels {
        list.extend(name.as_bytes());
        list.push(0);
        // Floats, not linear to the eye, at each pixel.
        for word in [2_u32, 0, 1, 1] {
            list.extend(word.to_le_bytes());
        }
    }
    list.push(0);
    let window: Vec<u8> =
        [0, 0, width as i32 - 1, height as i32 - 1].iter().flat_map(|x: &i32| x.to_le_bytes()).collect();
    let one = 1_f32.to_le_bytes();
    attribute("channels", "chlist", &list);
    attribute("comments", "string", comment.as_bytes());
    attribute("compression", "compression", &[0]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &one);
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &one);
    head.push(0);
    to.write_all(&head)?;
    let row = 4 * width * channels.len();
    let first = head.len() + 8 * height;
    for y in 0..height {
        to.write_all(&((first + y * (8 + row)) as u64).to_le_bytes())?;
    }
    let mut bytes = Vec::with_capacity(8 + row);
    for y in 0..height {
        bytes.clear();
        bytes.extend((y as u32).to_le_bytes());
        bytes.extend((row as u32).to_le_bytes());
        for (_, values, each, which) in channels {
            let row = values[y * width * each..].iter().skip(*which).step_by(*each).take(width);
            bytes.extend(row.flat_map(|v| v.to_le_bytes()));
        }
        to.write_all(&bytes)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_lead_to_the_rows_and_the_rows_hold_the_channels() {
        let colour: Vec<f32> = (0..18).map(|n| n as f32).collect();
        let more = [0.5; 6];
        let mut file = Vec::new();
        encode(&mut file, &[("B", &colour, 3, 2), ("R", &colour, 3, 0), ("more", &more, 1, 0)], [3, 2], "x").unwrap();
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
        let row = 4 * 3 * 3;
        let table = file.len() - 2 * (8 + row) - 2 * 8;
        for y in 0..2 {
            let at = word(table + 8 * y) as usize;
            assert_eq!((word(at) as usize, word(at + 4) as usize), (y, row));
            let value = |n: usize| f32::from_bits(word(at + 8 + 4 * n));
            let first = 9.0 * y as f32;
            assert_eq!([value(0), value(2), value(3), value(8)], [first + 2.0, first + 8.0, first, 0.5]);
        }
    }
}
