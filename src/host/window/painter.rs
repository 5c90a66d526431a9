//! Puts a window's picture together: the image below, text and shapes over it at the window's own resolution.
//!
//! To lay text out and paint it takes several times as long as everything else that shows a picture, so a thread of its own
//! does it: while the figures of a flight change, the picture goes on below the last ones until the new ones are there.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use egui::{Context, LayerId, Pos2, RawInput, Rect, Vec2, ViewportId};
use egui_software_backend::{BufferMutRef, ColorFieldOrder, EguiSoftwareRender};

use super::layer::{Bgra, Layer, compose};
use super::overlay::{self, Content};
use crate::app::overlay::Mark;
use crate::error::{Error, Result};
use crate::render::Frame;

/// What an overlay is laid out for.
#[derive(Clone, Debug, PartialEq)]
struct LayoutRequest {
    content: Content,
    /// Pixels.
    size: (usize, usize),
    /// Pixels a point.
    scale: f32,
}

impl LayoutRequest {
    /// Whether an overlay laid out for `self` may be shown while this is laid out.
    fn may_wait(&self, shown: &Self) -> bool {
        let flies = |o: &Self| matches!(o.content, Content::Flight(_));
        self.size == shown.size && self.scale == shown.scale && flies(self) && flies(shown)
    }
}

/// Puts pictures together.
pub struct Painter {
    requests: Sender<LayoutRequest>,
    done: Receiver<(LayoutRequest, Layer)>,
    /// What is being laid out.
    under_way: Option<LayoutRequest>,
    overlay: Layer,
    /// What the overlay shows.
    shown: Option<LayoutRequest>,
}

impl Painter {
    /// Nothing is laid out yet.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn new() -> Result<Self> {
        let (requests, todo) = channel::<LayoutRequest>();
        let (finished, done) = channel();
        let work = move || {
            let mut artist = Artist::new();
            for request in todo {
                let layer = artist.lay_out(&request);
                if finished.send((request, layer)).is_err() {
                    break;
                }
            }
        };
        let spawned = thread::Builder::new().name("overlay".to_owned()).spawn(work);
        spawned.map_err(|e| Error::fault("window", e.to_string(), "use --headless"))?;
        Ok(Self { requests, done, under_way: None, overlay: Layer::default(), shown: None })
    }

    /// Fills `surface`, `width` × `height` pixels of `0x00RRGGBB`, with the `image` (black where there is none of that
    /// size) and `content` over it at `scale` pixels a point. Nothing is done for a surface of another size.
    ///
    /// Returns whether it is `content` that lies over it, and not what was there before: then it is to be painted again.
    pub fn paint(
        &mut self,
        size: (usize, usize),
        scale: f32,
        image: Option<&Frame>,
        content: &Content,
        surface: &mut [u32],
    ) -> bool {
        if surface.is_empty() || surface.len() != size.0 * size.1 {
            return true;
        }
        let wanted = LayoutRequest { content: content.clone(), size, scale };
        self.take(false);
        if !self.shown.as_ref().is_some_and(|s| wanted.may_wait(s)) {
            while self.shown.as_ref() != Some(&wanted) && self.request(&wanted) && self.take(true) {}
        }
        compose(image, &self.overlay, surface, size.0);
        // Only now, so that both do not want the same cores at once.
        let settled = self.shown.as_ref() == Some(&wanted);
        if !settled {
            self.request(&wanted);
        }
        settled
    }

    /// Has it laid out, once what is at work is done. Whether there is anything at work.
    fn request(&mut self, wanted: &LayoutRequest) -> bool {
        if self.under_way.is_none() && self.requests.send(wanted.clone()).is_ok() {
            self.under_way = Some(wanted.clone());
        }
        self.under_way.is_some()
    }

    /// Takes what was laid out, if it is done; waits for it if it is to. Whether there was something to take.
    fn take(&mut self, wait: bool) -> bool {
        if self.under_way.is_none() {
            return false;
        }
        let done = if wait { self.done.recv().ok() } else { self.done.try_recv().ok() };
        let Some((request, layer)) = done else { return false };
        self.overlay = layer;
        self.shown = Some(request);
        self.under_way = None;
        true
    }
}

/// Paints marks of overlays into pictures, one after the other, on the caller's thread.
pub struct Marker(Artist);

impl Default for Marker {
    fn default() -> Self {
        Self(Artist::new())
    }
}

impl Marker {
    /// Paints `marks` over a picture.
    pub fn paint(&mut self, marks: Vec<Mark>, picture: &mut Frame) {
        let size = (picture.width(), picture.height());
        if size.0 == 0 || size.1 == 0 || marks.is_empty() {
            return;
        }
        let layer = self.0.lay_out(&LayoutRequest { content: Content::Marks(marks), size, scale: 1.0 });
        layer.cover_frame(picture);
    }
}

/// Lays overlays out.
struct Artist {
    egui: Context,
    raster: EguiSoftwareRender,
    canvas: Vec<Bgra>,
}

impl Artist {
    fn new() -> Self {
        let raster = EguiSoftwareRender::new(ColorFieldOrder::Bgra);
        Self { egui: Context::default(), raster, canvas: Vec::new() }
    }

    fn lay_out(&mut self, request: &LayoutRequest) -> Layer {
        let (width, height) = request.size;
        let (scale, area) = area(request.size, request.scale);
        let mut input = RawInput { screen_rect: Some(area), ..RawInput::default() };
        input.viewports.entry(ViewportId::ROOT).or_default().native_pixels_per_point = Some(scale);
        let output = self.egui.run_ui(input, |ui| {
            overlay::draw(&ui.ctx().layer_painter(LayerId::background()), area, &request.content);
        });
        let shapes = self.egui.tessellate(output.shapes, output.pixels_per_point);
        self.raster.render_to_canvas(width, height, &shapes, &output.textures_delta, output.pixels_per_point);
        self.canvas.clear();
        self.canvas.resize(width * height, [0; 4]);
        self.raster.blit_canvas_to_buffer(&mut BufferMutRef::new(&mut self.canvas, width, height));
        Layer::of(&self.canvas, width)
    }
}

/// Pixels a point of the overlay, and its area in points, in a window of so many pixels at `scale` pixels a point.
fn area((width, height): (usize, usize), scale: f32) -> (f32, Rect) {
    let scale = scale * shrink(width as f32 / scale, height as f32 / scale);
    (scale, Rect::from_min_size(Pos2::ZERO, Vec2::new(width as f32, height as f32) / scale))
}

/// Pixels a point of the overlay in a window of so many pixels, of which the system counts `scale` as a point.
pub fn pixels_a_point(window: (usize, usize), scale: f32) -> f32 {
    area(window, scale).0
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

    fn readings(figure: &str) -> overlay::Readings {
        overlay::Readings {
            state: "flying".to_owned(),
            mood: overlay::Mood::Well,
            more: Vec::new(),
            figures: vec![figure.to_owned()],
            directions: crate::host::window::directions::Directions::default(),
            per_mille: 0,
            marks: Vec::new(),
            place: String::new(),
            message: None,
            help: Vec::new(),
            marks_drawn: Vec::new(),
        }
    }

    fn failed(text: &str) -> Content {
        Content::Failed { text: text.to_owned() }
    }

    #[test]
    fn text_is_painted_at_every_scale_and_changes_with_its_content() {
        let mut p = Painter::new().unwrap();
        for (size, scale) in [((640, 480), 1.0), ((1280, 960), 2.0), ((333, 217), 1.25)] {
            let first = painted(&mut p, size, scale, &failed("scan.nii: wrong magic"));
            assert!(first.iter().filter(|&&c| c > 0x0060_6060).count() > 200, "{size:?}: no text");
            assert_ne!(painted(&mut p, size, scale, &failed("no such file")), first, "{size:?}: another text");
            let again = painted(&mut p, size, scale, &failed("scan.nii: wrong magic"));
            assert!(again == first, "{size:?}: the same again");
        }
    }

    #[test]
    fn figures_may_come_later_than_the_picture_but_do_come() {
        let mut p = Painter::new().unwrap();
        let flight = |figure: &str| Content::Flight(Box::new(readings(figure)));
        let size = (320, 240);
        let mut out = vec![7; size.0 * size.1];
        assert!(p.paint(size, 1.0, None, &flight("1"), &mut out), "there is nothing to show in its place");
        let first = out.clone();
        let mut late = 0;
        while !p.paint(size, 1.0, None, &flight("88888"), &mut out) {
            assert!(out == first, "the last figures, whole");
            late += 1;
            assert!(late < 100_000);
            thread::yield_now();
        }
        assert!(out != first);
        assert!(painted(&mut p, size, 1.0, &flight("88888")) == out, "and they stay");
        // Another kind of content never waits.
        assert!(p.paint(size, 1.0, None, &failed("no"), &mut out));
    }

    #[test]
    fn a_window_without_pixels_is_no_fault() {
        let mut p = Painter::new().unwrap();
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
        let (mut p, frame) = (Painter::new().unwrap(), Frame::new(1024, 1024));
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
