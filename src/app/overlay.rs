//! Overlays: drawings that a window adds to the picture of a flight.

use glam::DVec3;

use crate::FlightApp;
use crate::error::Result;
use crate::render::{Options, View};

/// Shows an overlay with its settings in one of its ways, counted from 0, or hides it with `None`.
pub type SwitchOverlay = fn(&mut FlightApp, Options, Option<usize>) -> Result<()>;

/// A drawing that a window adds on top of its picture, toggled by a key.
///
/// A recording contains the overlays that `fly --overlay` names, in a build with the feature `window`. Screenshots and rendered
/// images contain none. `examples/own_overlay.rs` is a complete example.
#[derive(Clone, Copy)]
pub struct Overlay {
    /// Its name.
    pub name: &'static str,
    /// Short description of what it shows, for the help.
    pub summary: &'static str,
    /// The key that shows and hides it.
    pub key: Option<char>,
    /// True if it is shown initially.
    pub shown: bool,
    /// Draws it for the current state of the flight, with its settings ([`Canvas::options`]). It is called for each picture while
    /// the overlay is shown, so it should be fast.
    pub draw: fn(&FlightApp, &mut Canvas),
    /// The ways in which it is shown: its key goes from one to the next, and then hides it. Empty if there is one way.
    pub ways: &'static [&'static str],
    /// Called when it is shown, in one of its ways, with its settings, and with `None` when it is hidden. For an overlay that changes the
    /// pixels of the picture and not only draws marks.
    pub switch: Option<SwitchOverlay>,
    /// Its settings: the table `[overlay.NAME]` of a scene file.
    pub options: Options,
    /// Checks its settings and returns an error (invalid usage) if they are invalid. Use [`Options::none`] for an overlay without
    /// settings.
    pub check: fn(Options) -> Result<()>,
}

impl Overlay {
    /// An overlay that draws nothing, hidden, without a key and without settings. Use it as the base of others.
    pub const PLAIN: Self = Self {
        name: "",
        summary: "",
        key: None,
        shown: false,
        draw: |_, _| {},
        ways: &[],
        switch: None,
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

/// A position in the picture, in pixels from its top left corner.
pub type Place2 = [f32; 2];

/// Alignment of a text relative to its position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Align {
    /// The position is the middle of its left edge.
    Left,
    /// The position is its centre.
    #[default]
    Centre,
    /// The position is the middle of its right edge.
    Right,
}

/// A drawing primitive. Positions and radii are in pixels. Widths of lines and sizes of text are in points, which equal pixels on
/// a screen of the usual density.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Mark {
    /// A straight line.
    Line {
        /// Start.
        from: Place2,
        /// End.
        to: Place2,
        /// Colour.
        colour: Colour,
        /// Width, points.
        width: f32,
    },
    /// A circle's outline, 1.5 points wide.
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
        /// Its position.
        at: Place2,
        /// The text.
        text: String,
        /// Colour.
        colour: Colour,
        /// Alignment relative to its position.
        align: Align,
        /// Height of the font, points.
        size: f32,
    },
}

/// The drawing surface of overlays: a list of marks in the picture's pixels, and the camera's view to project points to them.
///
/// ```
/// # use colvis_app as colvis;
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
    /// Height covered by text at the picture's lower edge, points.
    foot: f32,
    pub(super) marks: Vec<Mark>,
    /// Settings of the active overlay.
    pub(super) options: Options,
    /// Number of rows taken of each thing that overlays share.
    taken: Vec<(&'static str, usize)>,
}

/// Default width of a line, points.
const LINE: f32 = 1.5;
/// Default height of a text's font, points.
const TEXT: f32 = 14.0;

impl Canvas {
    /// Creates an empty canvas over the picture of `view`, on a screen of the usual density.
    pub fn new(view: View) -> Self {
        Self::at_scale(view, 1.0)
    }

    /// Creates an empty canvas over the picture of `view`, on a screen of `scale` pixels per point.
    pub fn at_scale(view: View, scale: f32) -> Self {
        Self { view, scale, foot: 0.0, marks: Vec::new(), options: Options::NONE, taken: Vec::new() }
    }

    /// Sets the height at the picture's lower edge that is covered by text, points.
    #[must_use]
    pub fn with_foot(self, points: f32) -> Self {
        Self { foot: points, ..self }
    }

    /// Returns the settings of the active overlay.
    pub fn options(&self) -> Options {
        self.options
    }

    /// Returns width and height, pixels.
    pub fn size(&self) -> Place2 {
        [self.view.width() as f32, self.view.height() as f32]
    }

    /// Returns the pixels per point. Multiply lengths in points by it for the same size on every screen.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// Returns the height at the picture's lower edge that is covered by text, pixels: the figures in a window, nothing in a
    /// recording. Draw things at the lower edge, such as a legend, above it.
    pub fn foot(&self) -> f32 {
        self.foot * self.scale
    }

    /// Returns the view under the canvas.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Projects a point (world, mm) into the picture. `None` if it is outside the camera's view. Occlusion is not checked.
    pub fn find(&self, point: DVec3) -> Option<Place2> {
        self.view.project(point).map(|[x, y]| [x as f32, y as f32])
    }

    /// Reserves `rows` rows of `what`, a thing that several overlays share. Returns the number of rows reserved before.
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

    /// Draws a line with a width in points.
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

    /// Draws a filled rectangle. `opacity` is the share (0 to 1) that it covers of the picture below.
    pub fn panel(&mut self, low: Place2, high: Place2, colour: Colour, opacity: f32) {
        self.marks.push(Mark::Panel { low, high, colour, opacity });
    }

    /// Draws a line of text, centred at a position.
    pub fn text(&mut self, at: Place2, text: impl Into<String>, colour: Colour) {
        self.label(at, Align::Centre, TEXT, text, colour);
    }

    /// Draws a line of text beside a position, with its font size in points.
    pub fn label(&mut self, at: Place2, align: Align, size: f32, text: impl Into<String>, colour: Colour) {
        self.marks.push(Mark::Text { at, text: text.into(), colour, align, size });
    }

    /// Returns the marks drawn.
    pub fn into_marks(self) -> Vec<Mark> {
        self.marks
    }
}
