//! The overlays of this crate: what the camera feels and what acts on it, drawn over the picture (paper, figures 4 and 5).
//!
//! Each is one file, with its entry in [`BUILT_IN`]. All of them are hidden at first, and nothing is computed for one that is
//! hidden. What a picture cannot show, since it begins at the eye or lies behind the camera, is drawn in two small views of
//! the surroundings ([`surroundings`]), which they share.
//!
//! Colours are near those of Okabe and Ito (*Color Universal Design*, 2008), which the colour-blind tell apart, and none is near
//! the wall's own pink; nothing is told by colour alone.

pub mod forces;
pub mod mines;
pub mod surroundings;
pub mod tentacles;

use crate::app::Overlay;
use crate::app::overlay::{Align, Canvas, Colour, Place2};

/// Every overlay of this crate.
pub const BUILT_IN: [Overlay; 3] = [tentacles::OVERLAY, mines::OVERLAY, forces::OVERLAY];

/// Around what is drawn over the picture, so that it stands out on every ground.
const EDGE: Colour = [0, 0, 0];
const WHITE: Colour = [240, 240, 240];
const GREY: Colour = [170, 176, 184];
const ORANGE: Colour = [230, 159, 0];
const SKY: Colour = [86, 180, 233];
const GREEN: Colour = [0, 190, 140];
const YELLOW: Colour = [240, 228, 66];
const VERMILION: Colour = [240, 110, 30];
const VIOLET: Colour = [186, 150, 255];

/// From the picture's edge, points.
const MARGIN: f32 = 10.0;
/// Height of the legend's text and of its rows, points.
const SMALL: f32 = 12.0;
const ROW: f32 = 17.0;

/// A disc that stands out on every ground.
fn dot(canvas: &mut Canvas, at: Place2, radius: f32, colour: Colour) {
    canvas.disc(at, radius + canvas.scale(), EDGE);
    canvas.disc(at, radius, colour);
}

/// A ring that stands out on every ground.
fn ring(canvas: &mut Canvas, at: Place2, radius: f32, colour: Colour) {
    for beside in [-1.0, 1.0] {
        canvas.circle(at, radius + beside * canvas.scale(), EDGE);
    }
    canvas.circle(at, radius, colour);
}

/// An arrow that stands out on every ground; a point where it has no length.
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

/// The lower edge of what is free for legends and views, pixels.
fn bottom(canvas: &Canvas) -> f32 {
    canvas.size()[1] - canvas.foot().max(MARGIN * canvas.scale())
}

/// The next row of the legend, which grows upwards from the picture's lower left corner: the left end of its middle line, on
/// a backing. None where the picture has no room for it.
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

/// Writes into a row of the legend, so many points from its left end.
fn legend_text(canvas: &mut Canvas, row: Place2, right: f32, text: impl Into<String>, colour: Colour) {
    let at = [row[0] + right * canvas.scale(), row[1]];
    canvas.label(at, Align::Left, SMALL, text, colour);
}
