//! Composes a window's picture: the image below, text and shapes over it at the window's resolution.
//!
//! Laying out and painting text takes several times as long as all other work of showing a picture, so a separate thread does it.
//! While the figures of a flight change, pictures are shown below the last figures until the new ones are ready.

use std::mem;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use egui::epaint::{ClippedPrimitive, Mesh, Primitive, Vertex};
use egui::{LayerId, Pos2, RawInput, Rect, TexturesDelta, Vec2};
use egui_software_backend::{BufferMutRef, ColorFieldOrder, EguiSoftwareRender};

use super::interface::{Interface, Layout, WindowSize};
use super::layer::{Bgra, Layer, Placed, compose};
use super::overlay;
use crate::app::overlay::Mark;
use crate::error::{Error, Result};
use crate::render::{Frame, ImageSize};
use crate::schedule::report_fault;

/// A layout to be rasterised, with the changes of the textures since the previous one.
struct Request {
    layout: Arc<Layout>,
    textures: TexturesDelta,
    /// A layer that is no longer shown, to be filled again.
    spare: Layer,
}

/// Composes pictures.
pub(crate) struct Painter {
    requests: Sender<Request>,
    done: Receiver<(Arc<Layout>, Layer)>,
    /// The layout that should be shown.
    wanted: Option<Arc<Layout>>,
    /// Texture changes of layouts that were not sent, in order. Later layouts need them even if one is skipped.
    textures: TexturesDelta,
    /// The layout that is being rasterised.
    under_way: Option<Arc<Layout>>,
    layer: Layer,
    /// The layer before it.
    spare: Layer,
    /// The layout in `layer`.
    shown: Option<Arc<Layout>>,
}

fn is(layout: Option<&Arc<Layout>>, wanted: &Layout) -> bool {
    layout.is_some_and(|l| l.serial == wanted.serial)
}

impl Painter {
    /// Creates a painter without a layout.
    ///
    /// # Errors
    /// Returns an error if the system cannot start a thread.
    pub(crate) fn new() -> Result<Self> {
        let (requests, todo) = channel::<Request>();
        let (finished, done) = channel();
        let work = move || {
            let mut artist = Artist::new();
            for Request { layout, textures, spare: mut layer } in todo {
                artist.paint_into(&mut layer, &layout, &textures);
                if finished.send((layout, layer)).is_err() {
                    break;
                }
            }
        };
        let spawned = thread::Builder::new().name("overlay".to_owned()).spawn(work);
        spawned.map_err(|e| Error::fault("window", e.to_string(), "use --headless"))?;
        let (textures, [layer, spare]) = (TexturesDelta::default(), Default::default());
        Ok(Self { requests, done, wanted: None, textures, under_way: None, layer, spare, shown: None })
    }

    /// Sets the layout over the next picture. Pass every layout, in order, even if it is never painted.
    pub(crate) fn prepare(&mut self, layout: &Arc<Layout>) {
        if !is(self.wanted.as_ref(), layout) {
            self.textures.append(layout.textures.clone());
            self.wanted = Some(Arc::clone(layout));
        }
    }

    /// Fills `surface`, `size` pixels of `0x00RRGGBB`, with the `pictures`, black around them, and the layout over them. Does
    /// nothing for a surface of another size.
    ///
    /// Returns true if the last prepared layout is over the pictures. If false, it is an earlier one, and the picture must be
    /// painted again.
    pub(crate) fn paint(&mut self, size: ImageSize, pictures: &[Placed<'_>], surface: &mut [u32]) -> bool {
        if surface.is_empty() || surface.len() != size.pixels() {
            return true;
        }
        let Some(wanted) = self.wanted.clone() else {
            compose(pictures, &Layer::default(), surface, size.width);
            return true;
        };
        if wanted.size.pixels != size {
            // The window has a different size by now, and gets a layout for it with the next picture.
            compose(pictures, &Layer::default(), surface, size.width);
            return false;
        }
        self.take(false);
        if !self.shown.as_ref().is_some_and(|s| s.may_stand_in_for(&wanted)) {
            while !is(self.shown.as_ref(), &wanted) && self.request(&wanted) && self.take(true) {}
        }
        compose(pictures, &self.layer, surface, size.width);
        // Only now, so that both do not compete for the same cores.
        let settled = is(self.shown.as_ref(), &wanted);
        if !settled {
            self.request(&wanted);
        }
        settled
    }

    /// Requests rasterisation, unless one is in progress. Returns true if one is in progress afterwards.
    fn request(&mut self, wanted: &Arc<Layout>) -> bool {
        if self.under_way.is_none() {
            let (textures, spare) = (mem::take(&mut self.textures), mem::take(&mut self.spare));
            let request = Request { layout: Arc::clone(wanted), textures, spare };
            if self.requests.send(request).is_ok() {
                self.under_way = Some(Arc::clone(wanted));
            }
        }
        self.under_way.is_some()
    }

    /// Takes the rasterised layer if it is complete, or waits for it if `wait` is set. Returns true if one was taken.
    fn take(&mut self, wait: bool) -> bool {
        if self.under_way.is_none() {
            return false;
        }
        let done = if wait { self.done.recv().ok() } else { self.done.try_recv().ok() };
        let Some((layout, layer)) = done else { return false };
        self.spare = mem::replace(&mut self.layer, layer);
        self.shown = Some(layout);
        self.under_way = None;
        true
    }
}

/// Paints marks of overlays into pictures, one after another, on the caller's thread.
pub(crate) struct Marker {
    interface: Interface,
    artist: Artist,
}

impl Default for Marker {
    fn default() -> Self {
        Self { interface: Interface::new(), artist: Artist::new() }
    }
}

impl Marker {
    /// Paints `marks` over a picture.
    pub(crate) fn paint(&mut self, marks: &[Mark], picture: &mut Frame) {
        let pixels = picture.size();
        if marks.is_empty() {
            return;
        }
        let now = std::time::Instant::now();
        let drawn = self.interface.lay_out(RawInput::default(), WindowSize { pixels, scale: 1.0 }, now, |ui| {
            let area = ui.ctx().content_rect();
            overlay::marks(&ui.ctx().layer_painter(LayerId::background()), area, marks);
            Vec::new()
        });
        if let Err(why) = drawn {
            report_fault("an overlay's marks", why);
            return;
        }
        if let Some(layout) = self.interface.layout() {
            self.artist.paint(layout, &layout.textures).cover_frame(picture);
        }
    }
}

/// Rasterises layouts.
///
/// Shapes are drawn right into the canvas. The backend can also keep a picture of each shape and draw only those that changed, which takes
/// three times as long here (8.3 ms instead of 2.9 for 1600×1000) and 12 MiB: the figures of a flight change all the time.
pub(crate) struct Artist {
    raster: EguiSoftwareRender,
    canvas: Vec<Bgra>,
}

/// A shape of more pixels along a side is drawn less precisely, and one of twice as many not at all: it is cut first.
const LARGEST: f32 = 4096.0;
/// How far beyond what is seen of it a shape is cut, points.
const BEYOND: f32 = 4.0;

impl Artist {
    /// Creates an artist that has painted nothing yet.
    pub(crate) fn new() -> Self {
        Self { raster: EguiSoftwareRender::new(ColorFieldOrder::Bgra).with_caching(false), canvas: Vec::new() }
    }

    /// Rasterises a layout, with the changes of the textures since the previous one.
    pub(crate) fn paint(&mut self, layout: &Layout, textures: &TexturesDelta) -> Layer {
        let mut layer = Layer::default();
        self.paint_into(&mut layer, layout, textures);
        layer
    }

    /// Like [`Artist::paint`], into a layer that need not be empty.
    fn paint_into(&mut self, layer: &mut Layer, layout: &Layout, textures: &TexturesDelta) {
        let ImageSize { width, height } = layout.size.pixels;
        let (mut shapes, scale) = (layout.tessellate(), layout.size.pixels_a_point());
        let window = Rect::from_min_size(Pos2::ZERO, Vec2::new(width as f32, height as f32) / scale);
        for ClippedPrimitive { clip_rect, primitive } in &mut shapes {
            if let Primitive::Mesh(mesh) = primitive
                && is_large(mesh, LARGEST / scale)
            {
                *mesh = cut(mesh, clip_rect.intersect(window).expand(BEYOND));
            }
        }
        self.canvas.clear();
        self.canvas.resize(width * height, [0; 4]);
        self.raster.render(&mut BufferMutRef::new(&mut self.canvas, width, height), &shapes, textures, scale);
        layer.fill(&self.canvas, width);
    }
}

/// True if a side of the box around a mesh is longer than `most`, points, or a vertex is nowhere.
fn is_large(mesh: &Mesh, most: f32) -> bool {
    let (mut low, mut high) = (Pos2::new(f32::MAX, f32::MAX), Pos2::new(f32::MIN, f32::MIN));
    let mut is_finite = true;
    for vertex in &mesh.vertices {
        (low, high) = (low.min(vertex.pos), high.max(vertex.pos));
        is_finite &= vertex.pos.is_finite();
    }
    !is_finite || (high - low).max_elem() > most
}

/// Returns the part of a mesh inside a rectangle: each triangle cut at one side after the other (Sutherland and Hodgman 1974).
fn cut(mesh: &Mesh, to: Rect) -> Mesh {
    let mut out = Mesh { texture_id: mesh.texture_id, ..Mesh::default() };
    let inside: [fn(Pos2, Rect) -> f32; 4] =
        [|p, r| p.x - r.left(), |p, r| r.right() - p.x, |p, r| p.y - r.top(), |p, r| r.bottom() - p.y];
    for triangle in mesh.indices.as_chunks::<3>().0 {
        let corners = triangle.map(|n| mesh.vertices[n as usize]);
        if !corners.iter().all(|c| c.pos.is_finite()) {
            continue;
        }
        let mut part = Vec::from(corners);
        for side in inside {
            let corners = mem::take(&mut part);
            for (n, &here) in corners.iter().enumerate() {
                let next = corners[(n + 1) % corners.len()];
                let [a, b] = [here, next].map(|v| side(v.pos, to));
                if a >= 0.0 {
                    part.push(here);
                }
                if (a >= 0.0) != (b >= 0.0) {
                    part.push(between(here, next, a / (a - b)));
                }
            }
        }
        let first = out.vertices.len() as u32;
        for n in 2..part.len() as u32 {
            out.indices.extend([first, first + n - 1, first + n]);
        }
        out.vertices.extend(part);
    }
    out
}

/// Returns the vertex at a share of the way between two.
fn between(a: Vertex, b: Vertex, share: f32) -> Vertex {
    Vertex { pos: a.pos.lerp(b.pos, share), uv: a.uv.lerp(b.uv, share), color: a.color.lerp_to_gamma(b.color, share) }
}

/// Returns the pixels per point of the interface in a window of `pixels` with the system's scale factor `scale`.
pub(crate) fn pixels_a_point(pixels: ImageSize, scale: f32) -> f32 {
    WindowSize { pixels, scale }.pixels_a_point()
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    /// A painter with an interface.
    struct Both {
        interface: Interface,
        painter: Painter,
    }

    impl Both {
        fn new() -> Self {
            Self { interface: Interface::new(), painter: Painter::new().unwrap() }
        }

        /// Lays out `text`, with or without a picture below.
        fn lay_out(&mut self, pixels: ImageSize, scale: f32, text: &str, picture: bool) {
            let size = WindowSize { pixels, scale };
            let laid_out = self.interface.lay_out(RawInput::default(), size, Instant::now(), |ui| {
                let area = ui.ctx().content_rect();
                overlay::loading(&ui.ctx().layer_painter(LayerId::background()), area, text, None, "Esc");
                picture.then_some(area).into_iter().collect()
            });
            laid_out.unwrap();
            if let Some(layout) = self.interface.layout() {
                self.painter.prepare(layout);
            }
        }

        fn painted(&mut self, pixels: ImageSize, scale: f32, text: &str) -> Vec<u32> {
            self.lay_out(pixels, scale, text, false);
            let mut out = vec![7; pixels.pixels()];
            assert!(self.painter.paint(pixels, &[], &mut out));
            out
        }
    }

    #[test]
    fn text_is_painted_at_every_scale_and_changes_with_its_content() {
        let mut p = Both::new();
        for (size, scale) in
            [(ImageSize::new(640, 480), 1.0), (ImageSize::new(1280, 960), 2.0), (ImageSize::new(333, 217), 1.25)]
        {
            let first = p.painted(size, scale, "scan.nii: wrong magic");
            assert!(first.iter().filter(|&&c| c > 0x0060_6060).count() > 200, "{size}: no text");
            assert_ne!(p.painted(size, scale, "no such file"), first, "{size}: another text");
            assert!(p.painted(size, scale, "scan.nii: wrong magic") == first, "{size}: the same again");
        }
    }

    #[test]
    fn text_in_a_small_window_is_as_large_at_first_as_later() {
        let mut p = Both::new();
        let small = ImageSize::new(200, 150);
        let first = p.painted(small, 1.0, "a");
        assert!(p.painted(small, 1.0, "b") != first && p.painted(small, 1.0, "a") == first);
    }

    #[test]
    fn figures_may_come_later_than_the_picture_but_do_come() {
        let mut p = Both::new();
        let (size, mut out) = (ImageSize::new(320, 240), vec![7; 320 * 240]);
        p.lay_out(size, 1.0, "1", true);
        assert!(p.painter.paint(size, &[], &mut out), "there is nothing to show in its place");
        let first = out.clone();
        // New letters, and layouts that are skipped while another is rasterised.
        for text in ["2", "345", "6789 and more", "88888 XYZ"] {
            p.lay_out(size, 1.0, text, true);
            p.painter.paint(size, &[], &mut out);
        }
        let mut late = 0;
        while !p.painter.paint(size, &[], &mut out) {
            late += 1;
            assert!(late < 100_000);
            thread::yield_now();
        }
        assert!(out != first);
        assert!(
            out == Both::new().painted(size, 1.0, "88888 XYZ"),
            "whole, as of a painter that has painted nothing else"
        );
        // One without a picture never waits.
        assert!(p.painted(size, 1.0, "no") != out);
    }

    #[test]
    fn characters_of_layouts_that_are_never_painted_are_painted_later() {
        let mut p = Both::new();
        let size = ImageSize::new(320, 240);
        for text in ["scan 1", "345 KLM", "xyz"] {
            p.lay_out(size, 1.0, text, false);
        }
        for text in ["scan 345", "KLM xyz"] {
            assert!(p.painted(size, 1.0, text) == Both::new().painted(size, 1.0, text), "{text}");
        }
    }

    #[test]
    fn a_window_without_pixels_is_no_fault() {
        let mut p = Both::new();
        for (size, scale) in [(ImageSize::new(0, 480), 1.0), (ImageSize::new(1, 1), 1.0), (ImageSize::new(3, 2), 3.0)] {
            p.painted(size, scale, "x");
        }
        let mut other = vec![7; 5];
        p.painter.paint(ImageSize::new(3, 2), &[], &mut other);
        assert_eq!(other, [7; 5], "a surface of another size is left alone");
    }

    /// A curve may go far beyond the window, and is shown like the part of it that is inside.
    #[test]
    fn long_shapes_are_painted_as_far_as_they_are_seen() {
        let mut p = Both::new();
        let pixels = ImageSize::new(320, 240);
        let mut line = |reach: f32| {
            let size = WindowSize { pixels, scale: 1.0 };
            let laid_out = p.interface.lay_out(RawInput::default(), size, Instant::now(), |ui| {
                let painter = ui.ctx().layer_painter(LayerId::background());
                let stroke = egui::Stroke::new(4.0, egui::Color32::WHITE);
                let (area, y) = (ui.ctx().content_rect(), ui.ctx().content_rect().center().y);
                painter.line_segment([Pos2::new(-reach, y), Pos2::new(area.right() + reach, y)], stroke);
                Vec::new()
            });
            laid_out.unwrap();
            p.painter.prepare(p.interface.layout().unwrap());
            let mut out = vec![7; pixels.pixels()];
            assert!(p.painter.paint(pixels, &[], &mut out));
            out
        };
        let inside = line(10.0);
        assert_eq!(inside[120 * 320..][..320], [0x00ff_ffff; 320]);
        for reach in [3000.0, 20_000.0, 10.0] {
            assert!(line(reach) == inside, "{reach}");
        }
    }

    #[test]
    fn a_mesh_is_cut_where_a_rectangle_ends() {
        let vertex = |x: f32, y: f32| {
            let (pos, uv) = (Pos2::new(x, y), Pos2::new(0.001 * x, 0.002 * y));
            Vertex { pos, uv, color: egui::Color32::from_gray((0.1 * x.clamp(0.0, 2000.0)) as u8) }
        };
        let vertices = vec![vertex(0.0, 0.0), vertex(2000.0, 0.0), vertex(2000.0, 2000.0), vertex(f32::NAN, 0.0)];
        let mesh = Mesh { vertices, indices: vec![0, 1, 2, 0, 1, 3], ..Mesh::default() };
        let area = |mesh: &Mesh| -> f32 {
            let corner = |n: u32| mesh.vertices[n as usize].pos;
            let triangles = mesh.indices.as_chunks::<3>().0.iter();
            triangles.map(|t| t.map(corner)).map(|[a, b, c]| 0.5 * (b - a).rot90().dot(c - a).abs()).sum()
        };
        let to = Rect::from_min_max(Pos2::new(100.0, -50.0), Pos2::new(300.0, 200.0));
        let part = cut(&mesh, to);
        // Below the diagonal: all of 100 by 100, and a half of 100 by 100; then 100 by 200.
        assert!((area(&part) - (100.0 * 100.0 + 0.5 * 100.0 * 100.0 + 100.0 * 200.0)).abs() < 1.0, "{}", area(&part));
        for v in &part.vertices {
            assert!(to.expand(0.01).contains(v.pos), "{:?}", v.pos);
            assert!((v.uv.x - 0.001 * v.pos.x).abs() < 1e-4 && (v.uv.y - 0.002 * v.pos.y).abs() < 1e-4);
            assert!((f32::from(v.color.r()) - 0.1 * v.pos.x).abs() < 1.6, "{:?}", v);
        }
        assert!(cut(&mesh, Rect::from_min_max(Pos2::new(-9.0, 300.0), Pos2::new(90.0, 900.0))).indices.is_empty());
    }

    /// Cost of a picture of 1024² besides the ray caster, with the same overlay and with a different one each time. Run it by
    /// name to see the figures.
    #[test]
    fn presenting_is_cheap_beside_rendering() {
        let (mut p, frame) = (Both::new(), Frame::new(1024, 1024));
        let mut surface = vec![0; 1 << 20];
        let mut best = [f64::INFINITY; 3];
        for n in 0..60 {
            let kind = usize::from(n % 3 == 0);
            let begun = Instant::now();
            p.lay_out(ImageSize::new(1024, 1024), 1.0, &format!("picture {}", n / 3), false);
            let laid_out = begun.elapsed().as_secs_f64() * 1e3;
            p.painter.paint(ImageSize::new(1024, 1024), &[Placed { at: (0, 0), frame: &frame }], &mut surface);
            best[kind] = best[kind].min(begun.elapsed().as_secs_f64() * 1e3);
            best[2] = best[2].min(laid_out);
        }
        println!(
            "painting 1024²: {:.2} ms, with a new overlay {:.2} ms; the layout alone {:.2} ms",
            best[0], best[1], best[2]
        );
        assert!(best[0] < 30.0 && best[1] < 100.0, "{best:?} ms");
    }
}
