//! The user interface over and beside the flight's picture, laid out by egui on the event loop's thread.
//!
//! A layout is computed only if something that it shows may have changed, and is rasterised only if it differs. The interface
//! does not depend on a window: the caller passes egui's events, and tests create them.

use crate::panics;
use crate::render::ImageSize;
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::epaint::{ClippedShape, Primitive, TessellationOptions, Tessellator};
use egui::{ClippedPrimitive, Context, PlatformOutput, Pos2, RawInput, Rect, TexturesDelta, Ui, Vec2, ViewportId};

/// Size of a window in pixels, with the system's scale factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WindowSize {
    /// Width and height.
    pub pixels: ImageSize,
    /// Pixels per point.
    pub scale: f32,
}

impl WindowSize {
    /// Returns the zoom of the interface. It is reduced in a small window to leave some of it free.
    fn zoom(self) -> f32 {
        let [width, height] = [self.pixels.width, self.pixels.height].map(|p| p as f32 / self.scale);
        (width / 420.0).min(height / 300.0).clamp(0.7, 1.0)
    }

    /// Returns the pixels per point of the interface.
    pub(crate) fn pixels_a_point(self) -> f32 {
        self.scale * self.zoom()
    }

    /// Returns the window's area in points of the interface.
    pub(crate) fn area(self) -> Rect {
        let ImageSize { width, height } = self.pixels;
        Rect::from_min_size(Pos2::ZERO, Vec2::new(width as f32, height as f32) / self.pixels_a_point())
    }

    /// Converts a rectangle of the interface to pixels: left, top, width, height.
    pub(crate) fn in_pixels(self, at: Rect) -> [usize; 4] {
        let edge = |x: f32, most: usize| ((x * self.pixels_a_point()).round().max(0.0) as usize).min(most);
        let ImageSize { width, height } = self.pixels;
        let [left, right] = [at.min.x, at.max.x].map(|x| edge(x, width));
        let [top, bottom] = [at.min.y, at.max.y].map(|y| edge(y, height));
        [left, top, right.saturating_sub(left), bottom.saturating_sub(top)]
    }
}

/// A layout, ready to be rasterised.
#[derive(Clone)]
pub(crate) struct Layout {
    /// Changes with each layout that looks different.
    pub serial: u64,
    /// The size of its window.
    pub size: WindowSize,
    /// What is drawn, in points.
    shapes: Vec<ClippedShape>,
    /// Changes of the textures since the previous layout.
    pub textures: TexturesDelta,
    /// Positions of the pictures below it. Between two layouts with the same positions, the older one may be shown a little
    /// longer.
    pub pictures: Vec<Rect>,
    tessellation: TessellationOptions,
    font_texture: [usize; 2],
}

impl Layout {
    /// True if this layout may be shown instead of `newer` until that one is ready.
    pub(crate) fn may_stand_in_for(&self, newer: &Self) -> bool {
        self.size == newer.size && !self.pictures.is_empty() && self.pictures == newer.pictures
    }

    /// Returns its triangles.
    pub(crate) fn tessellate(&self) -> Vec<ClippedPrimitive> {
        // egui's own function would prevent the event loop from laying out the next one meanwhile.
        let scale = self.size.pixels_a_point();
        let mut all = Tessellator::new(scale, self.tessellation, self.font_texture, Vec::new())
            .tessellate_shapes(self.shapes.clone());
        all.retain(|p| matches!(&p.primitive, Primitive::Mesh(m) if !m.is_empty()));
        all
    }
}

/// Computes layouts.
pub(crate) struct Interface {
    egui: Context,
    layout: Option<Arc<Layout>>,
    /// When it needs another layout, for example for a tooltip.
    next: Option<Instant>,
}

impl Default for Interface {
    fn default() -> Self {
        Self::new()
    }
}

impl Interface {
    /// Creates an interface without a layout.
    pub(crate) fn new() -> Self {
        Self { egui: Self::context(), layout: None, next: None }
    }

    /// Begins anew after a panic, which may have damaged egui's state: its fonts, its memory of widgets.
    pub(crate) fn renew(&mut self) {
        (self.egui, self.next) = (Self::context(), None);
    }

    fn context() -> Context {
        let egui = Context::default();
        egui.set_theme(egui::Theme::Dark);
        let mut fonts = egui::FontDefinitions::default();
        egui_phosphor::add_to_fonts(&mut fonts, egui_phosphor::Variant::Regular);
        egui.set_fonts(fonts);
        egui.options_mut(|o| {
            // egui's zoom keys change the view angle here.
            o.zoom_with_keyboard = false;
            // One pass only, so that no action is requested twice.
            o.max_passes = std::num::NonZeroUsize::MIN;
        });
        egui.all_styles_mut(|style| {
            // A picture rasterised on the CPU does not fade.
            style.animation_time = 0.0;
            // Dividers are grabbed exactly; the area beside them belongs to the panels.
            style.interaction.resize_grab_radius_side = 2.0;
            // As legible as text over the pictures.
            style.visuals.override_text_color = Some(super::style::INK);
        });
        egui
    }

    /// Returns egui's state.
    pub(crate) fn egui(&self) -> &Context {
        &self.egui
    }

    /// Returns the last layout.
    pub(crate) fn layout(&self) -> Option<&Arc<Layout>> {
        self.layout.as_ref()
    }

    /// Returns when to lay out again even without events.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.next
    }

    /// Lays out the content drawn by `draw` in a window of `size` after `input`. `draw` returns the positions of the pictures
    /// below it.
    ///
    /// A window without pixels has no layout.
    ///
    /// # Errors
    /// Returns the reason if it panics. The former layout stays, and the next one begins anew.
    pub(crate) fn lay_out(
        &mut self,
        input: RawInput,
        size: WindowSize,
        now: Instant,
        draw: impl FnMut(&mut Ui) -> Vec<Rect>,
    ) -> Result<PlatformOutput, String> {
        if size.pixels.pixels() == 0 {
            return Ok(PlatformOutput::default());
        }
        panics::catch(|| self.lay_out_now(input, size, now, draw)).inspect_err(|_| self.renew())
    }

    fn lay_out_now(
        &mut self,
        mut input: RawInput,
        size: WindowSize,
        now: Instant,
        mut draw: impl FnMut(&mut Ui) -> Vec<Rect>,
    ) -> PlatformOutput {
        let mut textures = TexturesDelta::default();
        if self.egui.zoom_factor() != size.zoom() {
            // egui takes a new factor over from the previous pass, which must have had this window's size.
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
