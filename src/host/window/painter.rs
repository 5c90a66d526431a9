//! Puts a window's picture together: the image below, text and shapes over it at the window's own resolution.

use egui::{Context, LayerId, Pos2, RawInput, Rect, Vec2, ViewportId};
use egui_software_backend::{BufferMutRef, ColorFieldOrder, EguiSoftwareRender};

use super::layer::{Bgra, Layer, compose};
use super::overlay::{self, Content};
use crate::render::Frame;

/// Puts pictures together.
pub struct Painter {
    egui: Context,
    raster: EguiSoftwareRender,
    canvas: Vec<Bgra>,
    overlay: Layer,
    /// What the overlay shows, in which size and at which scale: it is laid out anew only when that changes.
    shown: Option<(Content, (usize, usize), f32)>,
}

impl Painter {
    /// Nothing is laid out yet.
    pub fn new() -> Self {
        Self {
            egui: Context::default(),
            raster: EguiSoftwareRender::new(ColorFieldOrder::Bgra),
            canvas: Vec::new(),
            overlay: Layer::default(),
            shown: None,
        }
    }

    /// Fills `surface`, `width` × `height` pixels of `0x00RRGGBB`, with the `image` (black where there is none of that
    /// size) and `content` over it at `scale` pixels a point. Nothing is done for a surface of another size.
    pub fn paint(
        &mut self,
        (width, height): (usize, usize),
        scale: f32,
        image: Option<&Frame>,
        content: &Content,
        surface: &mut [u32],
    ) {
        if surface.is_empty() || surface.len() != width * height {
            return;
        }
        let shown = self.shown.as_ref();
        if shown.is_none_or(|(c, size, s)| c != content || *size != (width, height) || *s != scale) {
            self.lay_out((width, height), scale, content);
            self.shown = Some((content.clone(), (width, height), scale));
        }
        compose(image, &self.overlay, surface, width);
    }

    fn lay_out(&mut self, (width, height): (usize, usize), scale: f32, content: &Content) {
        let (scale, area) = area((width, height), scale);
        let mut input = RawInput { screen_rect: Some(area), ..RawInput::default() };
        input.viewports.entry(ViewportId::ROOT).or_default().native_pixels_per_point = Some(scale);
        let output = self.egui.run_ui(input, |ui| {
            overlay::draw(&ui.ctx().layer_painter(LayerId::background()), area, content);
        });
        let shapes = self.egui.tessellate(output.shapes, output.pixels_per_point);
        self.raster.render_to_canvas(width, height, &shapes, &output.textures_delta, output.pixels_per_point);
        self.canvas.clear();
        self.canvas.resize(width * height, [0; 4]);
        self.raster.blit_canvas_to_buffer(&mut BufferMutRef::new(&mut self.canvas, width, height));
        self.overlay = Layer::of(&self.canvas, width);
    }
}

/// Pixels a point of the overlay, and its area in points, in a window of so many pixels at `scale` pixels a point.
fn area((width, height): (usize, usize), scale: f32) -> (f32, Rect) {
    let scale = scale * shrink(width as f32 / scale, height as f32 / scale);
    (scale, Rect::from_min_size(Pos2::ZERO, Vec2::new(width as f32, height as f32) / scale))
}

/// The share of the way that a pixel of a window stands for, if it is on the bar.
pub fn on_bar(window: (usize, usize), scale: f32, pixel: (f64, f64)) -> Option<f64> {
    let (scale, area) = area(window, scale);
    overlay::on_bar(area, Pos2::new(pixel.0 as f32, pixel.1 as f32) / scale)
}

/// How much smaller than usual text is in a window of so many points, for it to leave some of the image free.
fn shrink(width: f32, height: f32) -> f32 {
    (width / 420.0).min(height / 300.0).clamp(0.7, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn painted(p: &mut Painter, size: (usize, usize), scale: f32, content: &Content) -> Vec<u32> {
        let mut out = vec![7; size.0 * size.1];
        p.paint(size, scale, None, content, &mut out);
        out
    }

    fn failed(text: &str) -> Content {
        Content::Failed { text: text.to_owned() }
    }

    #[test]
    fn text_is_painted_at_every_scale_and_changes_with_its_content() {
        let mut p = Painter::new();
        for (size, scale) in [((640, 480), 1.0), ((1280, 960), 2.0), ((333, 217), 1.25)] {
            let first = painted(&mut p, size, scale, &failed("scan.nii: wrong magic"));
            assert!(first.iter().filter(|&&c| c > 0x0060_6060).count() > 200, "{size:?}: no text");
            assert_ne!(painted(&mut p, size, scale, &failed("no such file")), first, "{size:?}: another text");
            let again = painted(&mut p, size, scale, &failed("scan.nii: wrong magic"));
            assert!(again == first, "{size:?}: the same again");
        }
    }

    #[test]
    fn a_window_without_pixels_is_no_fault() {
        let mut p = Painter::new();
        for (size, scale) in [((0, 480), 1.0), ((1, 1), 1.0), ((3, 2), 3.0)] {
            painted(&mut p, size, scale, &failed("x"));
        }
        let mut other = vec![7; 5];
        p.paint((3, 2), 1.0, None, &failed("x"), &mut other);
        assert_eq!(other, [7; 5], "a surface of another size is left alone");
    }

    #[test]
    fn the_bar_is_where_it_is_painted() {
        for (size, scale) in [((640, 480), 1.0), ((1280, 960), 2.0), ((360, 240), 1.25)] {
            let (w, h) = (size.0 as f64, size.1 as f64);
            let bottom = h - 10.0 * f64::from(area(size, scale).0);
            assert_eq!(on_bar(size, scale, (w / 2.0, bottom)).map(|s| (s * 100.0).round()), Some(50.0));
            assert_eq!(on_bar(size, scale, (w / 2.0, h / 2.0)), None);
            assert_eq!(on_bar(size, scale, (f64::NAN, bottom)), None);
        }
    }

    /// What a picture of 1024² costs besides the ray caster, with the same overlay and with another each time; run it by
    /// name to see.
    #[test]
    fn presenting_is_cheap_beside_rendering() {
        let (mut p, frame) = (Painter::new(), Frame::new(1024, 1024, false));
        let mut surface = vec![0; 1 << 20];
        let mut best = [f64::INFINITY; 2];
        for n in 0..60 {
            let kind = usize::from(n % 3 == 0);
            let content = failed(&format!("picture {}", n / 3));
            let begun = std::time::Instant::now();
            p.paint((1024, 1024), 1.0, Some(&frame), &content, &mut surface);
            best[kind] = best[kind].min(begun.elapsed().as_secs_f64() * 1e3);
        }
        println!("painting 1024²: {:.2} ms, with a new overlay {:.2} ms", best[0], best[1]);
        assert!(best[0] < 30.0 && best[1] < 100.0, "{best:?} ms");
    }
}
