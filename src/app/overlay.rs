//! What a window draws over the picture of a flight.

use glam::DVec3;

use super::FlightApp;
use crate::render::View;

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
    /// Draws it for the flight as it is. Called for each picture while it is shown, so it should be quick.
    pub draw: fn(&FlightApp, &mut Canvas),
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

/// Something drawn.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A straight line, a pixel and a half wide at the usual scale.
    Line {
        /// From here.
        from: Place2,
        /// To here.
        to: Place2,
        /// Colour.
        colour: Colour,
    },
    /// A circle's outline.
    Circle {
        /// Its centre.
        centre: Place2,
        /// Its radius, pixels.
        radius: f32,
        /// Colour.
        colour: Colour,
    },
    /// A line of text, centred at a place.
    Text {
        /// The text's centre.
        at: Place2,
        /// The text.
        text: String,
        /// Colour.
        colour: Colour,
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
    marks: Vec<Mark>,
}

impl Canvas {
    /// Nothing drawn yet over the picture of `view`.
    pub fn new(view: View) -> Self {
        Self { view, marks: Vec::new() }
    }

    /// Width and height, pixels.
    pub fn size(&self) -> Place2 {
        [self.view.width() as f32, self.view.height() as f32]
    }

    /// Where a point (world, mm) is in the picture; none where the camera does not see it. What hides it is not asked.
    pub fn find(&self, point: DVec3) -> Option<Place2> {
        self.view.project(point).map(|[x, y]| [x as f32, y as f32])
    }

    /// Draws a line.
    pub fn line(&mut self, from: Place2, to: Place2, colour: Colour) {
        self.marks.push(Mark::Line { from, to, colour });
    }

    /// Draws a circle.
    pub fn circle(&mut self, centre: Place2, radius: f32, colour: Colour) {
        self.marks.push(Mark::Circle { centre, radius, colour });
    }

    /// Writes a line of text.
    pub fn text(&mut self, at: Place2, text: impl Into<String>, colour: Colour) {
        self.marks.push(Mark::Text { at, text: text.into(), colour });
    }

    /// What was drawn.
    pub fn into_marks(self) -> Vec<Mark> {
        self.marks
    }
}
