//! A screenshot of all views: the flight's picture and the slices with what is drawn over them, and a strip that labels them. Menus,
//! lists and what lies under the pointer are left out.

use std::time::Instant;

use egui::{Align2, LayerId, RawInput, Rect, Ui, pos2};

use super::contract::{Beside, Context};
use super::interface::{Interface, WindowSize};
use super::layer::Layer;
use super::overlay::HudState;
use super::painter::Artist;
use super::panels::{flat, flight, slices};
use super::style::{self, DISCLAIMER, INK, SOFT, TEXT, angle};
use crate::components::output::Picture;
use crate::components::slices::Orientation;
use crate::render::{Frame, ImageSize};

/// Height of the strip, and its margin, points.
const STRIP: f32 = 46.0;
const MARGIN: f32 = 8.0;

/// All views of a window, without the flight's picture as long as that is not complete.
#[derive(Clone)]
pub(crate) struct Photograph {
    /// The slices where they are in the window; the rest is black.
    canvas: Frame,
    /// What is drawn over the views.
    over: Layer,
    /// The labels, as wide as the window.
    strip: Frame,
    /// Where the flight's picture is in the window, pixels: left, top, width, height.
    flight_at: Option<[usize; 4]>,
    /// The part of the window that has views.
    part: [usize; 4],
}

impl std::fmt::Debug for Photograph {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Photograph").field("part", &self.part).finish_non_exhaustive()
    }
}

/// The views of a window, by their rectangles in it, points.
#[derive(Clone, Debug, Default)]
pub(crate) struct Views {
    /// The flight's picture, if it is shown.
    pub flight: Option<Rect>,
    /// The slices.
    pub slices: Vec<(Orientation, Rect)>,
    /// Other pictures.
    pub beside: Vec<(Beside, Rect)>,
}

impl Photograph {
    /// Takes what a window of `size` shows beside and over the flight's picture; `None` if it shows no view.
    pub(crate) fn take(context: &Context<'_>, size: WindowSize, views: &Views) -> Option<Self> {
        let flight_at = views.flight.map(|at| size.in_pixels(at)).filter(|at| at[2] * at[3] > 0);
        let slices_at: Vec<_> = views.slices.iter().map(|(o, at)| (*o, size.in_pixels(*at))).collect();
        let beside_at: Vec<_> = views.beside.iter().map(|(b, at)| (*b, size.in_pixels(*at))).collect();
        let beside = slices_at.iter().map(|s| &s.1).chain(beside_at.iter().map(|b| &b.1));
        let all = flight_at.iter().chain(beside).filter(|at| at[2] * at[3] > 0);
        let part = all.copied().reduce(around)?;
        let mut canvas = Frame::new(size.pixels.width, size.pixels.height);
        for (orientation, at) in &slices_at {
            if let Some(view) = context.slice(*orientation) {
                put(&mut canvas, [at[0], at[1]], &view.frame);
            }
        }
        let other = context.of_other();
        for (which, at) in &beside_at {
            let picture = match which {
                Beside::Other => other.as_ref().and_then(|o| Some(&o.flight.camera::<Picture>()?.frame)),
                Beside::OtherSlice(o) => other.as_ref().and_then(|other| Some(&other.slice(*o)?.frame)),
                Beside::Flat => Some(context.view.flat().frame()),
            };
            if let Some(picture) = picture {
                put(&mut canvas, [at[0], at[1]], picture);
            }
        }
        // Messages tell what has just been done, and keys what can be.
        let hud = HudState { message: None, keys: String::new(), ..context.hud.clone() };
        let over = painted(size, |ui| {
            for (orientation, at) in &views.slices {
                slices::draw_alone(context, ui, *orientation, *at);
            }
            if let Some(at) = views.flight {
                flight::draw_alone(context, ui, at, &hud);
            }
            for (which, at) in &views.beside {
                match (which, &other) {
                    (Beside::Other, Some(other)) => flight::draw_alone(other, ui, *at, other.hud),
                    (Beside::OtherSlice(o), Some(other)) => slices::draw_alone(other, ui, *o, *at),
                    (Beside::Flat, _) => flat::draw_alone(context, ui, *at),
                    (Beside::Other | Beside::OtherSlice(_), None) => {}
                }
            }
        })?;
        let labels = labels(context, views);
        let mut strip = Frame::new(size.pixels.width, (STRIP * size.pixels_a_point()).ceil() as usize);
        painted(size, |ui| write(ui, &labels, part[2] as f32 / size.pixels_a_point()))?.cover_frame(&mut strip);
        Some(Self { canvas, over, strip, flight_at, part })
    }

    /// Returns the size of the flight's picture; `None` if it is not shown.
    pub(crate) fn flight(&self) -> Option<ImageSize> {
        self.flight_at.map(|[.., width, height]| ImageSize::new(width, height))
    }

    /// Returns the image, with the flight's picture in its place.
    pub(crate) fn with(mut self, picture: Option<&Frame>) -> Frame {
        if let (Some(at), Some(picture)) = (self.flight_at, picture) {
            put(&mut self.canvas, [at[0], at[1]], picture);
        }
        self.over.cover_frame(&mut self.canvas);
        let [left, top, width, height] = self.part;
        let mut image = Frame::new(width, height + self.strip.height());
        let rows = |frame: &Frame, from: usize, count: usize, left: usize| -> Vec<[u8; 3]> {
            let row = |y: usize| frame.pixels()[y * frame.width() + left..][..width].to_vec();
            (from..from + count).flat_map(row).collect()
        };
        let pixels = [rows(&self.canvas, top, height, left), rows(&self.strip, 0, self.strip.height(), 0)].concat();
        image.buffers().0.copy_from_slice(&pixels);
        image
    }
}

/// Returns the rectangle around two.
fn around(a: [usize; 4], b: [usize; 4]) -> [usize; 4] {
    let [left, top] = [0, 1].map(|n| a[n].min(b[n]));
    let [right, bottom] = [0, 1].map(|n| (a[n] + a[n + 2]).max(b[n] + b[n + 2]));
    [left, top, right - left, bottom - top]
}

/// Copies a picture to its place. What does not fit is cut off.
fn put(canvas: &mut Frame, [left, top]: [usize; 2], picture: &Frame) {
    let (width, height) = (canvas.width(), canvas.height());
    let columns = picture.width().min(width.saturating_sub(left));
    if columns == 0 {
        return;
    }
    let rows = picture.pixels().chunks_exact(picture.width()).take(height.saturating_sub(top));
    for (y, row) in rows.enumerate() {
        canvas.buffers().0[(top + y) * width + left..][..columns].copy_from_slice(&row[..columns]);
    }
}

/// Paints an interface without pointer and keys, as large as a window of `size`; `None` if it panics or has no pixels.
fn painted(size: WindowSize, mut draw: impl FnMut(&mut Ui)) -> Option<Layer> {
    let mut interface = Interface::new();
    let laid_out = interface.lay_out(RawInput::default(), size, Instant::now(), |ui| {
        draw(ui);
        Vec::new()
    });
    laid_out.ok()?;
    let layout = interface.layout()?;
    Some(Artist::new().paint(layout, &layout.textures))
}

/// Returns the two lines of the strip: what is shown, and how.
fn labels(context: &Context<'_>, views: &Views) -> [String; 2] {
    let setup = context.flight.setup();
    let position = setup.lumen.lying.map(|l| l.position.name().to_owned());
    let place = Some(context.hud.place.clone()).filter(|p| !p.is_empty() && context.view.unflown().is_none());
    // The name of a file may be that of a patient, and a picture leaves the program.
    let series = context.series().map(|n| format!("series {n}"));
    let what = [series, position, place];
    let mut how = Vec::new();
    if let Some(picture) = context.flight.camera::<Picture>().filter(|_| views.flight.is_some()) {
        let ahead = &context.hud.directions.ahead;
        how.push(format!("view {}, ahead {ahead}", angle(picture.fov_degrees)));
    }
    for (orientation, _) in &views.slices {
        if let Some(slice) = context.slice(*orientation).and_then(|v| v.shown()) {
            how.push(format!("{} {:.2} mm per pixel", orientation.name(), slice.mm_per_pixel));
        }
    }
    [what.into_iter().flatten().collect::<Vec<_>>().join("   "), how.join("   ")]
}

/// Writes the labels at the top of the window, `width` points wide.
fn write(ui: &Ui, [what, how]: &[String; 2], width: f32) {
    let p = ui.ctx().layer_painter(LayerId::background());
    let row = |y: f32, words: &str, colour| {
        let at = Rect::from_min_max(pos2(MARGIN, y), pos2(width - MARGIN, STRIP));
        style::text(&p.with_clip_rect(at), at.min, Align2::LEFT_TOP, words, TEXT, colour)
    };
    row(4.0, what, INK);
    let used = row(24.0, how, SOFT);
    let free = width - 2.0 * MARGIN - used.width();
    let size = p.layout_no_wrap(DISCLAIMER.to_owned(), egui::FontId::proportional(TEXT), SOFT).size();
    if free > size.x + MARGIN {
        style::text(&p, pos2(width - MARGIN, 24.0), Align2::RIGHT_TOP, DISCLAIMER, TEXT, SOFT);
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use egui::vec2;
    use glam::DVec3;

    use super::*;
    use crate::host::settings::KeySettings;
    use crate::host::window::action::Actions;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::tests::{controller, perform};
    use crate::host::window::intent::SliceInput;

    #[test]
    fn views_are_where_the_window_has_them_with_what_is_drawn_over_them_and_a_strip() {
        let (mut c, now) = (controller("manual"), Instant::now());
        let size = WindowSize { pixels: ImageSize::new(900, 600), scale: 1.0 };
        // Menus above, and a panel on the right.
        let flight = Rect::from_min_size(pos2(0.0, 60.0), vec2(400.0, 540.0));
        let axial = Rect::from_min_size(pos2(404.0, 60.0), vec2(300.0, 540.0));
        let slices = [(Orientation::Axial, [300, 540])];
        let due = c.prepare(ImageSize::new(400, 540), &slices, now).unwrap();
        c.show(due).unwrap();
        let actions = Actions::new(&c.flight().setup().scene.guides, &[], &[], &KeySettings::new()).unwrap();
        let taken = |c: &mut crate::host::window::controller::FlightController, views: &Views| {
            let hud = c.hud(now);
            let context = Context::new(c, &actions, &[], &hud).of_scan(Some(Path::new("a/case.nii")), Some(2));
            (Photograph::take(&context, size, views), labels(&context, views))
        };
        let both = Views { flight: Some(flight), slices: vec![(Orientation::Axial, axial)], beside: Vec::new() };
        let (photo, [what, how]) = taken(&mut c, &both);
        assert!(what.starts_with("series 2") && !what.contains("case") && how.starts_with("view 90°"), "{what} {how}");
        assert!(how.contains("axial 0.1") && how.contains("mm per pixel"), "{how}");
        let photo = photo.unwrap();
        assert_eq!(photo.flight(), Some(ImageSize::new(400, 540)));
        let mut red = Frame::new(400, 540);
        red.buffers().0.fill([200, 0, 0]);
        let image = photo.with(Some(&red));
        assert_eq!((image.width(), image.height()), (704, 540 + 46));
        let at = |image: &Frame, x: usize, y: usize| image.pixels()[y * image.width() + x];
        assert_eq!((at(&image, 200, 200), at(&image, 401, 200)), ([200, 0, 0], [0; 3]));
        let slice = &c.slices().view(c.flight(), Orientation::Axial).unwrap().frame;
        assert_eq!(at(&image, 404 + 40, 200), at(slice, 40, 200));
        let is_text = |p: &[u8; 3]| p.iter().all(|c| *c > 150);
        assert!(image.pixels()[540 * 704..].iter().filter(|p| is_text(p)).count() > 100, "labels");
        // A distance is drawn over the slice; without the flight, the slice is alone.
        let alone = Views { flight: None, ..both };
        let before = taken(&mut c, &alone).0.unwrap().with(None);
        assert_eq!(before.width(), 300);
        perform(&mut c, "measure", now);
        let here = c.flight().pose().position;
        for place in [here, here + DVec3::X * 5.0] {
            c.slice(SliceInput::Click(place), now);
        }
        assert_ne!(taken(&mut c, &alone).0.unwrap().with(None), before);
        assert!(taken(&mut c, &Views::default()).0.is_none());
    }

    #[test]
    fn what_does_not_fit_is_cut_off() {
        let mut canvas = Frame::new(5, 4);
        let mut white = Frame::new(3, 3);
        white.buffers().0.fill([255; 3]);
        for at in [[3, 2], [5, 0], [0, 4], [9, 9]] {
            put(&mut canvas, at, &white);
        }
        assert_eq!(canvas.pixels().iter().filter(|p| p[0] == 255).count(), 4);
        assert_eq!(around([4, 4, 2, 2], [0, 5, 1, 9]), [0, 4, 6, 10]);
    }
}
