//! What a window draws over the picture of a flight.

use std::time::Instant;

use glam::DVec3;

use super::{FlightApp, overlays};
use crate::error::{Error, Result};
use crate::panics;
use crate::render::{Options, View};
use crate::schedule::book_time;

/// Something that a window draws over its picture, on a key.
///
/// Recorded and rendered images carry no overlay. `examples/own_overlay.rs` is a whole one.
#[derive(Clone, Copy)]
pub struct Overlay {
    /// Its name.
    pub name: &'static str,
    /// What it shows, in a few words, for the help.
    pub summary: &'static str,
    /// The key that shows and hides it.
    pub key: Option<char>,
    /// Whether it is shown from the beginning.
    pub shown: bool,
    /// Draws it for the flight as it is, by its settings ([`Canvas::options`]). Called for each picture while it is shown, so it
    /// should be quick.
    pub draw: fn(&FlightApp, &mut Canvas),
    /// Its settings: the table `[overlay.NAME]` of a scene file.
    pub options: Options,
    /// Checks its settings, an error (wrong usage) if they make no sense: [`Options::none`] for an overlay without any.
    pub check: fn(Options) -> Result<()>,
}

impl Overlay {
    /// An overlay that draws nothing, hidden, without a key and without settings: what others begin with.
    pub const PLAIN: Self = Self {
        name: "",
        summary: "",
        key: None,
        shown: false,
        draw: |_, _| {},
        options: Options::NONE,
        check: Options::none,
    };
}

impl std::fmt::Debug for Overlay {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Overlay").field("name", &self.name).field("key", &self.key).finish_non_exhaustive()
    }
}

/// Red, green, blue.
pub type Colour = [u8; 3];

/// A place in the picture, pixels from its top left corner.
pub type Place2 = [f32; 2];

/// Where a text stands beside its place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Align {
    /// The place is the middle of its left edge.
    Left,
    /// The place is its centre.
    #[default]
    Centre,
    /// The place is the middle of its right edge.
    Right,
}

/// Something drawn. Places and radii are in pixels; widths of lines and sizes of text in points, that is in pixels of a
/// screen of the usual density.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A straight line.
    Line {
        /// From here.
        from: Place2,
        /// To here.
        to: Place2,
        /// Colour.
        colour: Colour,
        /// Points.
        width: f32,
    },
    /// A circle's outline, a point and a half wide.
    Circle {
        /// Its centre.
        centre: Place2,
        /// Its radius, pixels.
        radius: f32,
        /// Colour.
        colour: Colour,
    },
    /// A filled circle.
    Disc {
        /// Its centre.
        centre: Place2,
        /// Its radius, pixels.
        radius: f32,
        /// Colour.
        colour: Colour,
    },
    /// A filled rectangle.
    Panel {
        /// Its top left corner.
        low: Place2,
        /// Its bottom right corner.
        high: Place2,
        /// Colour.
        colour: Colour,
        /// How much of the picture it covers, 0 to 1.
        opacity: f32,
    },
    /// A line of text.
    Text {
        /// Its place.
        at: Place2,
        /// The text.
        text: String,
        /// Colour.
        colour: Colour,
        /// How it stands beside its place.
        align: Align,
        /// Height of the font, points.
        size: f32,
    },
}

/// What overlays draw on: a list of marks in the picture's own pixels, and the camera's view to find them.
///
/// ```
/// use colvis::app::Canvas;
/// use colvis::render::View;
/// use glam::DVec3;
///
/// let mut canvas = Canvas::new(View::new(DVec3::ZERO, DVec3::Y, DVec3::Z, 90.0, 200, 100)?);
/// let target = DVec3::new(0.0, 30.0, 0.0); // world, mm
/// if let Some(at) = canvas.find(target) {
///     canvas.circle(at, 6.0, [255, 214, 102]);
///     canvas.text([at[0], at[1] + 14.0], "polyp?", [255, 214, 102]);
/// }
/// assert_eq!(canvas.into_marks().len(), 2);
/// # Ok::<(), colvis::error::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Canvas {
    view: View,
    scale: f32,
    /// Points.
    foot: f32,
    marks: Vec<Mark>,
    /// Settings of the overlay that draws.
    options: Options,
    /// How many rows of what overlays share are taken.
    taken: Vec<(&'static str, usize)>,
}

/// Width of a line where none is given, points.
const LINE: f32 = 1.5;
/// Height of a text's font where none is given, points.
const TEXT: f32 = 14.0;

impl Canvas {
    /// Nothing drawn yet over the picture of `view`, on a screen of the usual density.
    pub fn new(view: View) -> Self {
        Self::at_scale(view, 1.0)
    }

    /// Nothing drawn yet over the picture of `view`, on a screen of `scale` pixels a point.
    pub fn at_scale(view: View, scale: f32) -> Self {
        Self { view, scale, foot: 0.0, marks: Vec::new(), options: Options::NONE, taken: Vec::new() }
    }

    /// The same where text covers so many points of the picture's lower edge.
    #[must_use]
    pub fn with_foot(self, points: f32) -> Self {
        Self { foot: points, ..self }
    }

    /// Lets an overlay draw. What it had drawn before it panicked is taken back.
    ///
    /// # Errors
    /// Status 1 when it panics.
    pub fn draw(&mut self, overlay: &Overlay, flight: &FlightApp) -> Result<()> {
        self.options = overlay.options;
        let (before, begun) = (self.marks.len(), Instant::now());
        let drawn = panics::catch(|| (overlay.draw)(flight, self));
        if overlays::BUILT_IN.iter().all(|o| o.name != overlay.name) {
            book_time(format!("overlay {}", overlay.name), begun.elapsed().as_secs_f64() * 1e3);
        }
        drawn.map_err(|why| {
            self.marks.truncate(before);
            Error::fault(format!("overlay {}", overlay.name), format!("panicked: {why}"), "fix it, or hide it")
        })
    }

    /// The settings of the overlay that draws.
    pub fn options(&self) -> Options {
        self.options
    }

    /// Width and height, pixels.
    pub fn size(&self) -> Place2 {
        [self.view.width() as f32, self.view.height() as f32]
    }

    /// Pixels a point: what is to look alike on every screen is so many times its size.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// How much of the picture's lower edge is covered by text, pixels: a window has its figures there, a recording nothing. What
    /// stands at the lower edge, such as a legend, belongs above it.
    pub fn foot(&self) -> f32 {
        self.foot * self.scale
    }

    /// The view that is drawn over.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Where a point (world, mm) is in the picture; none where the camera does not see it. What hides it is not asked.
    pub fn find(&self, point: DVec3) -> Option<Place2> {
        self.view.project(point).map(|[x, y]| [x as f32, y as f32])
    }

    /// Takes so many rows of something that several overlays share, by its name; how many were taken before.
    pub fn take(&mut self, what: &'static str, rows: usize) -> usize {
        match self.taken.iter_mut().find(|t| t.0 == what) {
            Some((_, taken)) => std::mem::replace(taken, *taken + rows),
            None => {
                self.taken.push((what, rows));
                0
            }
        }
    }

    /// Draws a line.
    pub fn line(&mut self, from: Place2, to: Place2, colour: Colour) {
        self.stroke(from, to, LINE, colour);
    }

    /// Draws a line of a width in points.
    pub fn stroke(&mut self, from: Place2, to: Place2, width: f32, colour: Colour) {
        self.marks.push(Mark::Line { from, to, colour, width });
    }

    /// Draws a circle.
    pub fn circle(&mut self, centre: Place2, radius: f32, colour: Colour) {
        self.marks.push(Mark::Circle { centre, radius, colour });
    }

    /// Draws a filled circle.
    pub fn disc(&mut self, centre: Place2, radius: f32, colour: Colour) {
        self.marks.push(Mark::Disc { centre, radius, colour });
    }

    /// Draws a filled rectangle that covers a share (0 to 1) of what is below.
    pub fn panel(&mut self, low: Place2, high: Place2, colour: Colour, opacity: f32) {
        self.marks.push(Mark::Panel { low, high, colour, opacity });
    }

    /// Writes a line of text, centred at a place.
    pub fn text(&mut self, at: Place2, text: impl Into<String>, colour: Colour) {
        self.label(at, Align::Centre, TEXT, text, colour);
    }

    /// Writes a line of text of a size in points beside a place.
    pub fn label(&mut self, at: Place2, align: Align, size: f32, text: impl Into<String>, colour: Colour) {
        self.marks.push(Mark::Text { at, text: text.into(), colour, align, size });
    }

    /// What was drawn.
    pub fn into_marks(self) -> Vec<Mark> {
        self.marks
    }
}
