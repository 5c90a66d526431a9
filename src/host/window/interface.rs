//! The interface: what lies over and beside the flight's picture, laid out by egui on the event loop's thread.
//!
//! A layout is made only when something that it shows may have changed, and is rasterised only if it has. It does not
//! depend on a window: the caller passes egui's events, and tests make them up.

use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::epaint::{ClippedShape, Primitive, TessellationOptions, Tessellator};
use egui::{ClippedPrimitive, Context, PlatformOutput, Pos2, RawInput, Rect, TexturesDelta, Ui, Vec2, ViewportId};

/// Pixels of a window, and how many of them the system counts as a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowSize {
    /// Width and height.
    pub pixels: (usize, usize),
    /// Pixels a point.
    pub scale: f32,
}

impl WindowSize {
    /// How much smaller than usual the interface is, for it to leave some of a small window free.
    fn zoom(self) -> f32 {
        let [width, height] = [self.pixels.0, self.pixels.1].map(|p| p as f32 / self.scale);
        (width / 420.0).min(height / 300.0).clamp(0.7, 1.0)
    }

    /// Pixels that the interface counts as a point.
    pub fn pixels_a_point(self) -> f32 {
        self.scale * self.zoom()
    }

    /// The window in the interface's points.
    pub fn area(self) -> Rect {
        let (width, height) = self.pixels;
        Rect::from_min_size(Pos2::ZERO, Vec2::new(width as f32, height as f32) / self.pixels_a_point())
    }

    /// A rectangle of the interface in pixels: left, top, width, height.
    pub fn in_pixels(self, at: Rect) -> [usize; 4] {
        let edge = |x: f32, most: usize| ((x * self.pixels_a_point()).round().max(0.0) as usize).min(most);
        let (width, height) = self.pixels;
        let [left, right] = [at.min.x, at.max.x].map(|x| edge(x, width));
        let [top, bottom] = [at.min.y, at.max.y].map(|y| edge(y, height));
        [left, top, right.saturating_sub(left), bottom.saturating_sub(top)]
    }
}

/// A layout, ready to be rasterised.
#[derive(Clone)]
pub struct Layout {
    /// Another number for each layout that looks different.
    pub serial: u64,
    /// The window that it is for.
    pub size: WindowSize,
    /// What is drawn, in points.
    shapes: Vec<ClippedShape>,
    /// What has changed of the textures since the layout before.
    pub textures: TexturesDelta,
    /// Where pictures lie below it. Between two layouts with the same ones, the older one may be shown a little longer.
    pub pictures: Vec<Rect>,
    tessellation: TessellationOptions,
    font_texture: [usize; 2],
}

impl Layout {
    /// Whether this layout may be shown in the place of `newer` until that one is ready.
    pub fn may_stand_in_for(&self, newer: &Self) -> bool {
        self.size == newer.size && !self.pictures.is_empty() && self.pictures == newer.pictures
    }

    /// Its triangles.
    pub fn tessellate(&self) -> Vec<ClippedPrimitive> {
        // Not egui's own function: it would keep the event loop from laying out the next one meanwhile.
        let scale = self.size.pixels_a_point();
        let mut all = Tessellator::new(scale, self.tessellation, self.font_texture, Vec::new())
            .tessellate_shapes(self.shapes.clone());
        all.retain(|p| matches!(&p.primitive, Primitive::Mesh(m) if !m.is_empty()));
        all
    }
}

/// Lays out.
pub struct Interface {
    egui: Context,
    layout: Option<Arc<Layout>>,
    /// When it wants to be laid out again: for a tooltip, say.
    next: Option<Instant>,
}

impl Default for Interface {
    fn default() -> Self {
        Self::new()
    }
}

impl Interface {
    /// Nothing is laid out yet.
    pub fn new() -> Self {
        let egui = Context::default();
        egui.set_theme(egui::Theme::Dark);
        egui.options_mut(|o| {
            // Its keys for that are the view angle's here.
            o.zoom_with_keyboard = false;
            // Nothing is asked of an action twice.
            o.max_passes = std::num::NonZeroUsize::MIN;
        });
        egui.all_styles_mut(|style| {
            // A picture that is rasterised on a processor does not fade.
            style.animation_time = 0.0;
            // A divider is grabbed where it lies, and what lies beside it is the panels'.
            style.interaction.resize_grab_radius_side = 2.0;
            // As legible as what lies over the pictures.
            style.visuals.override_text_color = Some(super::overlay::INK);
        });
        Self { egui, layout: None, next: None }
    }

    /// egui's state.
    pub fn egui(&self) -> &Context {
        &self.egui
    }

    /// The last layout.
    pub fn layout(&self) -> Option<&Arc<Layout>> {
        self.layout.as_ref()
    }

    /// When it is to be laid out again although nothing has happened.
    pub fn next(&self) -> Option<Instant> {
        self.next
    }

    /// Lays out what `draw` shows in a window of `size` after `input`. `draw` returns where pictures lie below it.
    ///
    /// A window without pixels has no layout.
    pub fn lay_out(
        &mut self,
        mut input: RawInput,
        size: WindowSize,
        now: Instant,
        mut draw: impl FnMut(&mut Ui) -> Vec<Rect>,
    ) -> PlatformOutput {
        if size.pixels.0 == 0 || size.pixels.1 == 0 {
            return PlatformOutput::default();
        }
        let mut textures = TexturesDelta::default();
        if self.egui.zoom_factor() != size.zoom() {
            // egui takes a new factor over from the pass before; that one is to have had this window's size.
            self.egui.set_zoom_factor(size.zoom());
            let mut empty = RawInput { screen_rect: Some(size.area()), ..RawInput::default() };
            empty.viewports.entry(ViewportId::ROOT).or_default().native_pixels_per_point = Some(size.scale);
            textures = self.egui.run_ui(empty, |_| {}).textures_delta;
        }
        input.screen_rect = Some(size.area());
        input.viewports.entry(ViewportId::ROOT).or_default().native_pixels_per_point = Some(size.scale);
        let mut pictures = Vec::new();
        let output = self.egui.run_ui(input, |ui| pictures = draw(ui));
        textures.append(output.textures_delta);
        let wait = output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |v| v.repaint_delay);
        self.next = now.checked_add(wait).filter(|_| wait < Duration::from_secs(3600));
        let same = self.layout.as_ref().is_some_and(|last| {
            last.size == size && last.pictures == pictures && textures.is_empty() && last.shapes == output.shapes
        });
        if !same {
            #[expect(clippy::redundant_closure_for_method_calls, reason = "the method alone is of one lifetime")]
            let font_texture = self.egui.fonts(|f| f.font_image_size());
            self.layout = Some(Arc::new(Layout {
                serial: self.layout.as_ref().map_or(1, |l| l.serial + 1),
                size,
                shapes: output.shapes,
                textures,
                pictures,
                tessellation: self.egui.tessellation_options(|o| *o),
                font_texture,
            }));
        }
        output.platform_output
    }
}
