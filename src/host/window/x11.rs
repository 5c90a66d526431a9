//! Pixels that are sent to an X server over a connection of their own: frames of any size, in the format of any visual with red,
//! green and blue.
//!
//! softbuffer shares memory with the server, which is faster, but needs a visual of 24 bits. Without shared memory (over `ssh -X`,
//! in containers) it cannot send frames that are longer than the server's longest request.

use rayon::prelude::*;
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::platform::scancode::PhysicalKeyExtScancode;
use winit::raw_window_handle::{HasWindowHandle, RawWindowHandle};
use winit::window::Window;
use x11rb::connection::{Connection, RequestConnection};
use x11rb::errors::ConnectError;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    ConnectionExt, CreateGCAux, Format, ImageFormat, ImageOrder, Setup, VisualClass, Visualtype,
};
use x11rb::rust_connection::RustConnection;

use xkeysym::Keysym;

use super::stroke::Printing;
use crate::render::ImageSize;

/// Bytes of a request besides its pixels, rounded up.
const HEAD: usize = 64;
/// Most bytes of a strip. The server handles the input of other programs between two.
const MOST_BYTES: usize = 1 << 20;

/// The pixels of a window of an X server.
pub(crate) struct XPixels {
    connection: RustConnection,
    window: u32,
    gc: u32,
    depth: u8,
    format: PixelFormat,
    /// Most bytes of a strip.
    most: usize,
    pixels: Vec<u32>,
    bytes: Vec<u8>,
}

/// Returns what the keys of the server's keyboard print, without and with Shift; `None` if a window is not one of an X server, or if
/// that does not answer.
pub(crate) fn printed(window: &Window) -> Option<Vec<(KeyCode, Printing)>> {
    id_of(window)?;
    let (connection, _) = RustConnection::connect(None).ok()?;
    let first = connection.setup().min_keycode;
    let count = connection.setup().max_keycode.checked_sub(first)?.checked_add(1)?;
    let mapping = connection.get_keyboard_mapping(first, count).ok()?.reply().ok()?;
    let keys = mapping.keysyms.chunks_exact(usize::from(mapping.keysyms_per_keycode).max(1));
    let of = |(n, symbols): (usize, &[u32])| {
        // Evdev's numbers are lower by 8 than those of X.
        let code = PhysicalKey::from_scancode((usize::from(first) + n).checked_sub(8)?.try_into().ok()?);
        let PhysicalKey::Code(code) = code else { return None };
        let character = |level: usize| Keysym::new(*symbols.get(level)?).key_char();
        Some((code, [character(0), character(1)]))
    };
    Some(keys.enumerate().filter_map(of).collect())
}

/// Returns the number of a window of an X server; `None` for others.
fn id_of(window: &Window) -> Option<u32> {
    match window.window_handle().ok()?.as_raw() {
        RawWindowHandle::Xlib(handle) => u32::try_from(handle.window).ok(),
        RawWindowHandle::Xcb(handle) => Some(handle.window.get()),
        _ => None,
    }
}

impl XPixels {
    /// Connects to the display of a window; `None` if that is not one of an X server.
    ///
    /// # Errors
    /// Returns the reason if the server cannot be reached, or if the window has no red, green and blue.
    pub(crate) fn open(window: &Window) -> Option<Result<Self, String>> {
        Some(Self::connect(id_of(window)?).map_err(|e| e.to_string()))
    }

    fn connect(window: u32) -> Result<Self, Box<dyn std::error::Error>> {
        let (connection, _) = RustConnection::connect(None)?;
        let attributes = connection.get_window_attributes(window)?;
        let geometry = connection.get_geometry(window)?;
        let (visual, depth) = (attributes.reply()?.visual, geometry.reply()?.depth);
        let format = PixelFormat::of(connection.setup(), visual, depth)
            .ok_or_else(|| format!("the display has {depth} bits a pixel, but no red, green and blue"))?;
        let gc = connection.generate_id()?;
        connection.create_gc(gc, window, &CreateGCAux::new().graphics_exposures(0))?.check()?;
        let most = connection.maximum_request_bytes().saturating_sub(HEAD).min(MOST_BYTES);
        let (pixels, bytes) = (Vec::new(), Vec::new());
        Ok(Self { connection, window, gc, depth, format, most, pixels, bytes })
    }

    /// Shows the `size` pixels of `0x00RRGGBB` that `paint` fills. Returns its result.
    ///
    /// # Errors
    /// Returns the reason if the server did not take it, or reports that it did not show an earlier one.
    pub(crate) fn show<T>(
        &mut self,
        window: &Window,
        size: ImageSize,
        paint: &mut impl FnMut(&mut [u32]) -> T,
    ) -> Result<T, String> {
        self.pixels.resize(size.pixels(), 0);
        let painted = paint(&mut self.pixels);
        window.pre_present_notify();
        self.send(size).map_err(|e| e.to_string())?;
        Ok(painted)
    }

    fn send(&mut self, size: ImageSize) -> Result<(), Box<dyn std::error::Error>> {
        let width = u16::try_from(size.width)?;
        let rows = (self.most / self.format.row_bytes(size.width).max(1)).max(1);
        for (n, strip) in self.pixels.chunks(rows * size.width.max(1)).enumerate() {
            let (top, height) = (i16::try_from(n * rows)?, u16::try_from(strip.len() / size.width)?);
            let bytes = if self.format.is_usual() {
                bytemuck::cast_slice(strip)
            } else {
                self.format.convert(strip, size.width, &mut self.bytes);
                &self.bytes
            };
            let (to, gc) = (self.window, self.gc);
            let image = ImageFormat::Z_PIXMAP;
            // Not waited for: a server that another program has grabbed answers late, and some versions then only to a new request.
            drop(self.connection.put_image(image, to, gc, width, height, 0, top, 0, self.depth, bytes)?);
        }
        self.connection.flush()?;
        // Errors come as events. Other events, which every program gets, would pile up.
        let mut error = None;
        while let Some(event) = self.connection.poll_for_event()? {
            if let Event::Error(e) = event {
                error = Some(format!("the server reports {:?}", e.error_kind));
            }
        }
        error.map_or(Ok(()), |e| Err(e.into()))
    }
}

/// True if no X server listens at the display of this session any more.
pub(crate) fn is_display_lost() -> bool {
    use std::io::ErrorKind::{ConnectionRefused, NotFound};
    matches!(RustConnection::connect(None), Err(ConnectError::IoError(e)) if [ConnectionRefused, NotFound].contains(&e.kind()))
}

/// How a server stores the pixels of a visual.
#[derive(Clone, Debug, PartialEq, Eq)]
struct PixelFormat {
    /// The pixel of each of the 256 values of red, green and blue.
    tables: [Vec<u32>; 3],
    /// Bytes of a pixel.
    bytes: usize,
    /// Each row starts at a multiple of this, bytes.
    pad: usize,
    is_big_endian: bool,
}

impl PixelFormat {
    /// Returns the format of a visual of `depth` bits; `None` if it has no red, green and blue.
    fn of(setup: &Setup, visual: u32, depth: u8) -> Option<Self> {
        let visuals = setup.roots.iter().flat_map(|s| &s.allowed_depths).flat_map(|d| &d.visuals);
        let visual = visuals.into_iter().find(|v| v.visual_id == visual)?;
        let stored = setup.pixmap_formats.iter().find(|f| f.depth == depth)?;
        Self::new(visual, stored, setup.image_byte_order == ImageOrder::MSB_FIRST)
    }

    fn new(visual: &Visualtype, stored: &Format, is_big_endian: bool) -> Option<Self> {
        let is_rgb = [VisualClass::TRUE_COLOR, VisualClass::DIRECT_COLOR].contains(&visual.class);
        let (bits, pad) = (usize::from(stored.bits_per_pixel), usize::from(stored.scanline_pad));
        let masks = [visual.red_mask, visual.green_mask, visual.blue_mask];
        if !is_rgb || ![16, 24, 32].contains(&bits) || pad % 8 != 0 || pad == 0 || masks.contains(&0) {
            return None;
        }
        let table = |mask: u32| {
            let (shift, most) = (mask.trailing_zeros(), u64::from(mask >> mask.trailing_zeros()));
            // To the nearest of the values from 0 to the highest.
            (0..256u64).map(|v| (((v * most + 127) / 255) as u32) << shift).collect()
        };
        Some(Self { tables: masks.map(table), bytes: bits / 8, pad: pad / 8, is_big_endian })
    }

    /// True for words of `0x00RRGGBB` as in this program's memory.
    fn is_usual(&self) -> bool {
        let same = |n: usize, shift: u32| self.tables[n][255] == 255 << shift;
        let is_own_order = self.is_big_endian == cfg!(target_endian = "big");
        is_own_order && self.bytes == 4 && self.pad <= 4 && same(0, 16) && same(1, 8) && same(2, 0)
    }

    /// Returns the bytes of a row of `width` pixels.
    fn row_bytes(&self, width: usize) -> usize {
        (width * self.bytes).next_multiple_of(self.pad)
    }

    /// Converts rows of `width` pixels of `0x00RRGGBB`.
    fn convert(&self, pixels: &[u32], width: usize, out: &mut Vec<u8>) {
        let (width, row_bytes) = (width.max(1), self.row_bytes(width.max(1)));
        out.resize(pixels.len() / width * row_bytes, 0);
        let [red, green, blue] = &self.tables;
        out.par_chunks_exact_mut(row_bytes).zip(pixels.par_chunks_exact(width)).for_each(|(out, row)| {
            for (out, pixel) in out.chunks_exact_mut(self.bytes).zip(row) {
                let [_, r, g, b] = pixel.to_be_bytes().map(usize::from);
                let pixel = red[r] | green[g] | blue[b];
                if self.is_big_endian {
                    out.copy_from_slice(&pixel.to_be_bytes()[4 - self.bytes..]);
                } else {
                    out.copy_from_slice(&pixel.to_le_bytes()[..self.bytes]);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(masks: [u32; 3], depth: u8, bits_per_pixel: u8, is_big_endian: bool) -> PixelFormat {
        let [red_mask, green_mask, blue_mask] = masks;
        let class = VisualClass::TRUE_COLOR;
        let visual = Visualtype { class, red_mask, green_mask, blue_mask, ..Visualtype::default() };
        PixelFormat::new(&visual, &Format { depth, bits_per_pixel, scanline_pad: 32 }, is_big_endian).unwrap()
    }

    fn bytes(format: &PixelFormat, pixels: &[u32]) -> Vec<u8> {
        let mut out = Vec::new();
        format.convert(pixels, pixels.len(), &mut out);
        out
    }

    #[test]
    fn colours_are_those_of_the_visual() {
        let pixels = [0x00ff_0000, 0x0000_ff00, 0x0000_00ff];
        let usual = [0x00ff_0000, 0x0000_ff00, 0x0000_00ff];
        let words = |all: &[u32]| all.iter().flat_map(|p| p.to_le_bytes()).collect::<Vec<_>>();
        let of_usual = format(usual, 24, 32, false);
        assert!(of_usual.is_usual() && bytes(&of_usual, &pixels) == words(&pixels));
        let ten = format([0x3ff0_0000, 0x000f_fc00, 0x0000_03ff], 30, 32, false);
        assert!(!ten.is_usual());
        assert_eq!(bytes(&ten, &pixels), words(&[0x3ff0_0000, 0x000f_fc00, 0x0000_03ff]));
        assert_eq!(bytes(&ten, &[0x0080_8080]), words(&[514 << 20 | 514 << 10 | 514]));
        // Two bytes a pixel, and rows of four.
        let halves = format([0xf800, 0x07e0, 0x001f], 16, 16, false);
        assert_eq!(bytes(&halves, &pixels), [0x00, 0xf8, 0xe0, 0x07, 0x1f, 0x00, 0, 0]);
        let swapped = format([0x0000_00ff, 0x0000_ff00, 0x00ff_0000], 24, 24, true);
        assert_eq!(bytes(&swapped, &[0x0001_0203]), [3, 2, 1, 0]);
    }

    #[test]
    fn every_value_keeps_its_order_and_the_ends_are_black_and_white() {
        for masks in [[0xf800, 0x07e0, 0x001f], [0x3ff0_0000, 0x000f_fc00, 0x0000_03ff], [0x7c00, 0x03e0, 0x001f]] {
            let format = format(masks, 24, 32, false);
            for (table, mask) in format.tables.iter().zip(masks) {
                assert!(table[0] == 0 && table[255] == mask && table.is_sorted(), "{mask:x}");
            }
        }
    }

    #[test]
    fn palettes_are_refused() {
        let stored = Format { depth: 8, bits_per_pixel: 8, scanline_pad: 32 };
        let visual = Visualtype { class: VisualClass::PSEUDO_COLOR, ..Visualtype::default() };
        assert_eq!(PixelFormat::new(&visual, &stored, false), None);
    }
}
