//! Puts a window's picture together: the image below, text and shapes over it at the window's own resolution.

use egui::{Context, LayerId, Pos2, RawInput, Rect, Vec2, ViewportId};
use egui_software_backend::{BufferMutRef, ColorFieldOrder, EguiSoftwareRender};

use super::overlay::{self, Content};
use super::upscale::{Bgrx, upscale};
use crate::render::Frame;

/// A window's picture, in memory.
pub struct Painter {
    egui: Context,
    raster: EguiSoftwareRender,
    canvas: Vec<Bgrx>,
    size: (usize, usize),
    /// What the overlay shows, at which scale: it is laid out anew only when that changes.
    shown: Option<(Content, f32)>,
}

impl Painter {
    /// An empty picture.
    pub fn new() -> Self {
        Self {
            egui: Context::default(),
            raster: EguiSoftwareRender::new(ColorFieldOrder::Bgra),
            canvas: Vec::new(),
            size: (0, 0),
            shown: None,
        }
    }

    /// Paints `content` at `scale` pixels a point over the `image` (black where there is none) stretched over `width` ×
    /// `height` pixels. Nothing is done for a window without pixels.
    pub fn paint(&mut self, (width, height): (usize, usize), scale: f32, image: Option<&Frame>, content: &Content) {
        if width == 0 || height == 0 {
            return;
        }
        if self.size != (width, height) {
            self.size = (width, height);
            self.canvas.clear();
            self.canvas.resize(width * height, [0; 4]);
            self.shown = None;
        }
        match image {
            Some(frame) => upscale(frame, &mut self.canvas, width),
            None => self.canvas.fill([0; 4]),
        }
        if self.shown.as_ref().is_none_or(|(c, s)| c != content || *s != scale) {
            self.lay_out(scale, content);
            self.shown = Some((content.clone(), scale));
        }
        self.raster.blit_canvas_to_buffer(&mut BufferMutRef::new(&mut self.canvas, width, height));
    }

    fn lay_out(&mut self, scale: f32, content: &Content) {
        let (width, height) = self.size;
        let scale = scale * shrink(width as f32 / scale, height as f32 / scale);
        let area = Rect::from_min_size(Pos2::ZERO, Vec2::new(width as f32, height as f32) / scale);
        let mut input = RawInput { screen_rect: Some(area), ..RawInput::default() };
        input.viewports.entry(ViewportId::ROOT).or_default().native_pixels_per_point = Some(scale);
        let output = self.egui.run_ui(input, |ui| {
            overlay::draw(&ui.ctx().layer_painter(LayerId::background()), area, content);
        });
        let shapes = self.egui.tessellate(output.shapes, output.pixels_per_point);
        self.raster.render_to_canvas(width, height, &shapes, &output.textures_delta, output.pixels_per_point);
    }

    /// Copies the picture to a surface of the same size, pixels as `0x00RRGGBB`; one of another size stays as it is.
    pub fn copy_to(&self, surface: &mut [u32]) {
        if surface.len() == self.canvas.len() {
            for (out, &[b, g, r, _]) in surface.iter_mut().zip(&self.canvas) {
                *out = u32::from_le_bytes([b, g, r, 0]);
            }
        }
    }
}

/// How much smaller than usual text is in a window of so many points, for it to leave some of the image free.
fn shrink(width: f32, height: f32) -> f32 {
    (width / 420.0).min(height / 300.0).clamp(0.7, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(p: &Painter) -> Vec<u32> {
        let mut out = vec![7; p.canvas.len()];
        p.copy_to(&mut out);
        out
    }

    fn failed(text: &str) -> Content {
        Content::Failed { text: text.to_owned() }
    }

    #[test]
    fn text_is_painted_at_every_scale_and_changes_with_its_content() {
        let mut p = Painter::new();
        for (size, scale) in [((640, 480), 1.0), ((1280, 960), 2.0), ((333, 217), 1.25)] {
            p.paint(size, scale, None, &failed("scan.nii: wrong magic"));
            let first = pixels(&p);
            assert!(first.iter().filter(|&&c| c > 0x0060_6060).count() > 200, "{size:?}: no text");
            p.paint(size, scale, None, &failed("no such file"));
            assert_ne!(pixels(&p), first, "{size:?}: another text");
            p.paint(size, scale, None, &failed("scan.nii: wrong magic"));
            assert_eq!(pixels(&p), first, "{size:?}: the same again");
        }
    }

    #[test]
    fn a_window_without_pixels_is_no_fault() {
        let mut p = Painter::new();
        p.paint((0, 480), 1.0, None, &failed("x"));
        p.paint((1, 1), 1.0, None, &failed("x"));
        p.paint((3, 2), 3.0, None, &failed("x"));
        let mut other = vec![7; 5];
        p.copy_to(&mut other);
        assert_eq!(other, [7; 5], "a surface of another size is left alone");
    }

    /// What a picture of 1024² costs besides the ray caster; run it by name to see.
    #[test]
    fn presenting_is_cheap_beside_rendering() {
        let (mut p, frame) = (Painter::new(), Frame::new(512, 512, false));
        let mut surface = vec![0; 1 << 20];
        let mut best = f64::INFINITY;
        for _ in 0..20 {
            let begun = std::time::Instant::now();
            p.paint((1024, 1024), 1.0, Some(&frame), &failed("x"));
            p.copy_to(&mut surface);
            best = best.min(begun.elapsed().as_secs_f64() * 1e3);
        }
        println!("presenting 512² on 1024²: {best:.2} ms");
        assert!(best < 100.0, "{best} ms");
    }
}
