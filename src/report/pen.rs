//! The pen that plots are drawn with, as SVG.

use plotters::coord::Shift;
use plotters::prelude::*;
pub(super) use plotters::style::RGBColor;
use plotters::style::text_anchor::Pos;
pub(super) use plotters::style::text_anchor::{HPos, VPos};

use crate::error::{Error, Result};

/// Colours that people with any colour vision can distinguish (Okabe and Ito 2008).
pub(super) const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(120, 94, 60),
    RGBColor(0, 0, 0),
];
/// The colour of an axis' numbers, and of its lines.
pub(super) const GREY: RGBColor = RGBColor(90, 90, 90);
pub(super) const GRID: RGBColor = RGBColor(228, 228, 228);
/// The colour of titles.
pub(super) const INK: RGBColor = BLACK;

/// A place in a picture, pixels to the right and downwards.
pub(super) type Place = (i32, i32);
/// The result of drawing: plotters' error, as text.
pub(super) type Drawn = std::result::Result<(), String>;

/// Returns the colour of the series `n`.
pub(super) fn colour(n: usize) -> RGBColor {
    COLOURS[n % COLOURS.len()]
}

/// A pen on a white picture.
pub(super) struct Pen<'a>(DrawingArea<SVGBackend<'a>, Shift>);

/// Returns what `with` draws on `width` × `height` pixels as an SVG element. Fails with status 1 if it cannot be drawn.
pub(super) fn svg(width: i32, height: i32, with: impl FnOnce(&Pen<'_>) -> Drawn) -> Result<String> {
    let mut svg = String::new();
    let pen = Pen(SVGBackend::with_string(&mut svg, (width as u32, height as u32)).into_drawing_area());
    let drawn = words(pen.0.fill(&WHITE)).and_then(|()| with(&pen)).and_then(|()| words(pen.0.present()));
    drop(pen);
    drawn.map_err(|e| Error::fault("plot", e, "report it"))?;
    Ok(svg)
}

fn words<E: std::error::Error + Send + Sync>(drawn: std::result::Result<(), DrawingAreaErrorKind<E>>) -> Drawn {
    drawn.map_err(|e| format!("{e:?}"))
}

impl Pen<'_> {
    /// Writes `s` in letters of `px` pixels, aligned to a place by `h` and `v`.
    pub(super) fn text(&self, s: &str, at: Place, px: i32, colour: RGBColor, (h, v): (HPos, VPos)) -> Drawn {
        let style = ("sans-serif", px).into_font().color(&colour).pos(Pos::new(h, v));
        words(self.0.draw(&Text::new(s.to_owned(), at, style)))
    }

    /// Writes a title upwards, to the right of a place, centred on it.
    pub(super) fn upwards(&self, s: &str, at: Place, px: i32) -> Drawn {
        let style = ("sans-serif", px).into_font().transform(FontTransform::Rotate270).color(&INK);
        words(self.0.draw(&Text::new(s.to_owned(), at, style.pos(Pos::new(HPos::Center, VPos::Top)))))
    }

    /// Draws a line through places, `width` pixels wide.
    pub(super) fn line(&self, through: impl Into<Vec<Place>>, colour: RGBColor, width: u32) -> Drawn {
        words(self.0.draw(&PathElement::new(through.into(), colour.stroke_width(width))))
    }

    /// Draws a dot of a radius, pixels.
    pub(super) fn dot(&self, at: Place, radius: i32, colour: RGBColor) -> Drawn {
        words(self.0.draw(&Circle::new(at, radius, colour.filled())))
    }

    /// Draws the frame of a plotting area.
    pub(super) fn frame(&self, corners: [Place; 2]) -> Drawn {
        words(self.0.draw(&Rectangle::new(corners, GREY.stroke_width(1))))
    }
}
