//! Built-in overlays: the camera's tentacles, and the mines and forces that act on it, drawn over the picture (paper, figures 4
//! and 5).
//!
//! Each is one file, with its entry in [`BUILT_IN`]. All are hidden at first, and nothing is computed for a hidden one. What a
//! picture cannot show, because it begins at the eye or is behind the camera, is drawn in two small views of the surroundings
//! ([`surroundings`]), which the overlays share.
//!
//! The colours are close to those of Okabe and Ito (*Color Universal Design*, 2008), which colour-blind people can distinguish.
//! None is close to the pink of the wall, and no information is conveyed by colour alone.

pub mod forces;
pub mod mines;
pub mod surroundings;
pub mod tentacles;

use crate::app::Overlay;
use crate::app::overlay::{Align, Canvas, Colour, Place2};

/// All overlays of this crate.
pub const BUILT_IN: [Overlay; 3] = [tentacles::OVERLAY, mines::OVERLAY, forces::OVERLAY];

/// Outline of the marks, so that they stand out on every background.
const EDGE: Colour = [0, 0, 0];
const WHITE: Colour = [240, 240, 240];
const GREY: Colour = [170, 176, 184];
const ORANGE: Colour = [230, 159, 0];
const SKY: Colour = [86, 180, 233];
const GREEN: Colour = [0, 190, 140];
const YELLOW: Colour = [240, 228, 66];
const VERMILION: Colour = [240, 110, 30];
const VIOLET: Colour = [186, 150, 255];

/// Distance from the picture's edge, points.
const MARGIN: f32 = 10.0;
/// Height of the legend's text and of its rows, points.
const SMALL: f32 = 12.0;
const ROW: f32 = 17.0;

/// Draws a disc that stands out on every background.
fn dot(canvas: &mut Canvas, at: Place2, radius: f32, colour: Colour) {
    canvas.disc(at, radius + canvas.scale(), EDGE);
    canvas.disc(at, radius, colour);
}

/// Draws a ring that stands out on every background.
fn ring(canvas: &mut Canvas, at: Place2, radius: f32, colour: Colour) {
    for beside in [-1.0, 1.0] {
        canvas.circle(at, radius + beside * canvas.scale(), EDGE);
    }
    canvas.circle(at, radius, colour);
}

/// Draws an arrow that stands out on every background; a point if its length is zero.
fn arrow(canvas: &mut Canvas, from: Place2, to: Place2, colour: Colour) {
    let pt = canvas.scale();
    let [x, y] = [to[0] - from[0], to[1] - from[1]];
    let length = x.hypot(y);
    if length < 2.0 * pt {
        dot(canvas, to, 2.0 * pt, colour);
        return;
    }
    let [x, y] = [x / length, y / length];
    let head = (0.4 * length).min(8.0 * pt);
    let side = |s: f32| [to[0] - head * (x - s * 0.5 * y), to[1] - head * (y + s * 0.5 * x)];
    for (width, colour) in [(4.0, EDGE), (2.2, colour)] {
        canvas.stroke(from, to, width, colour);
        canvas.stroke(side(1.0), to, width, colour);
        canvas.stroke(side(-1.0), to, width, colour);
    }
}

/// Returns the lower edge of the area that is free for legends and views, pixels.
fn bottom(canvas: &Canvas) -> f32 {
    canvas.size()[1] - canvas.foot().max(MARGIN * canvas.scale())
}

/// Adds a row to the legend, which grows upwards from the picture's lower left corner, and draws its background. Returns the left
/// end of the row's middle line; `None` if the picture has no room for it.
fn legend_row(canvas: &mut Canvas) -> Option<Place2> {
    let pt = canvas.scale();
    let [width, height] = canvas.size();
    let (row, bottom) = (canvas.take("legend", 1) as f32, bottom(canvas));
    let wide = (0.5 * width - 48.0 * pt).min(310.0 * pt);
    // Whole pixels, so that rows meet without a seam.
    let [low, high] = [row + 1.0, row].map(|n| (bottom - ROW * n * pt).round());
    if wide < 120.0 * pt || low < 0.5 * height {
        return None;
    }
    let left = (MARGIN * pt).round();
    canvas.panel([left, low], [(left + wide).round(), high], EDGE, 0.82);
    Some([left + 8.0 * pt, 0.5 * (low + high)])
}

/// Writes into a row of the legend, `right` points from its left end.
fn legend_text(canvas: &mut Canvas, row: Place2, right: f32, text: impl Into<String>, colour: Colour) {
    let at = [row[0] + right * canvas.scale(), row[1]];
    canvas.label(at, Align::Left, SMALL, text, colour);
}
