//! The picture of a flight through a drawing: potential, trajectory, tentacles, mines and camera.

use glam::DVec3;

use super::drawing::MM_PER_PIXEL;
use super::flight::{Flight, State};
use super::potential::Potential;
use crate::render::{Frame, ImageSize};

/// The parts of a flight to draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct Show {
    /// Tentacles at the camera's position.
    pub tentacles: bool,
    /// Mines and their reach.
    pub mines: bool,
    /// The potential, as shading and contour lines.
    pub potential: bool,
    /// The trajectory.
    pub trajectory: bool,
}

impl Default for Show {
    fn default() -> Self {
        Self { tentacles: true, mines: true, potential: true, trajectory: true }
    }
}

type Colour = [u8; 3];

const WALL: Colour = [38, 34, 40];
const LUMEN: Colour = [232, 236, 240];
const STEEP: Colour = [96, 120, 178];
const LINE: Colour = [150, 168, 206];
const WAY: Colour = [232, 120, 16];
const TENTACLE: Colour = [40, 150, 90];
const MINE: Colour = [200, 30, 40];
const START: Colour = [220, 40, 40];
const GOAL: Colour = [20, 160, 40];
const CAMERA: Colour = [20, 20, 24];
const CALLED: Colour = [190, 20, 190];

/// Potential of the first contour line, mm²/s². Each further line is at four times the previous value.
const FIRST_LINE: f32 = 15.0;
/// Number of shading levels.
const LEVELS: f32 = 6.0;

/// Draws flights through one drawing.
#[doc(hidden)]
pub struct Painter {
    potential: Potential,
    /// The contour level of each pixel.
    levels: Vec<i8>,
}

impl Painter {
    /// Creates a painter for a flight's drawing.
    #[doc(hidden)]
    pub fn new(flight: &Flight) -> Self {
        let potential = Potential::new(flight.walls(), flight.settings());
        Self { potential, levels: Vec::new() }
    }

    /// Returns the whole number of picture pixels per drawing pixel that best fits `size`, at least 1.
    #[doc(hidden)]
    pub fn scale_for(flight: &Flight, size: ImageSize) -> usize {
        let drawing = flight.walls().drawing();
        (size.width / drawing.width()).min(size.height / drawing.height()).max(1)
    }

    /// Draws the current state of a flight, with `scale` picture pixels per pixel of the drawing.
    #[doc(hidden)]
    pub fn paint(&mut self, flight: &Flight, show: Show, scale: usize, frame: &mut Frame) {
        let drawing = flight.walls().drawing();
        let (w, h) = (drawing.width(), drawing.height());
        frame.resize(w * scale, h * scale);
        self.ground(flight, show, scale, frame);
        let mut pen = Pen { frame, per_mm: scale as f64 / MM_PER_PIXEL };
        let thin = 0.5 / pen.per_mm;
        let mines = flight.settings().mines.filter(|_| show.mines);
        if let Some(s) = mines {
            for m in flight.mines().iter() {
                pen.circle(m, s.reach_mm, MINE, 0.12);
            }
        }
        if show.trajectory {
            // One point per picture pixel is enough.
            let mut last = flight.plan().start;
            for &p in flight.places() {
                if p.distance(last) >= 2.0 * thin {
                    pen.line(last, p, 0.55, WAY, 1.0);
                    last = p;
                }
            }
        }
        let at = flight.position();
        if show.tentacles {
            let (directions, lengths) = flight.tentacles();
            for (&d, &l) in directions.iter().zip(lengths) {
                pen.line(at, at + d * l, thin, TENTACLE, 0.55);
            }
        }
        pen.disc(flight.plan().start, 1.6, START);
        pen.circle(flight.plan().goal, flight.plan().within_mm, GOAL, 1.0);
        pen.disc(flight.plan().goal, 1.0, GOAL);
        if mines.is_some() {
            for m in flight.mines().iter() {
                pen.disc(m, 0.9, MINE);
            }
        }
        let radius = flight.settings().body.radius_mm.max(2.0 * thin);
        pen.disc(at, radius, CAMERA);
        pen.line(at, at + flight.heading() * (radius + 4.0), 0.4, CAMERA, 1.0);
        if let (State::Operator, Some(call)) = (flight.state(), flight.call()) {
            for d in [DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, -1.0, 0.0)] {
                pen.line(call.place - d * 4.0, call.place + d * 4.0, 0.8, CALLED, 1.0);
            }
        }
    }

    /// Draws wall, lumen and potential.
    fn ground(&mut self, flight: &Flight, show: Show, scale: usize, frame: &mut Frame) {
        let drawing = flight.walls().drawing();
        let w = drawing.width();
        let mines = flight.settings().mines.as_ref().filter(|_| show.mines).map(|m| (flight.mines(), m));
        let values = self.potential.with_mines(mines);
        self.levels.clear();
        self.levels.extend(values.iter().map(|&v| level(v)));
        let levels = &self.levels;
        let (pixels, _) = frame.buffers();
        for (n, &lumen) in drawing.lumen().iter().enumerate() {
            let (i, j) = (n % w, n / w);
            let colour = match (lumen, show.potential) {
                (false, _) => WALL,
                (true, false) => LUMEN,
                (true, true) => {
                    let higher = |m: usize| levels.get(m).is_some_and(|&l| l < levels[n]);
                    if (i + 1 < w && higher(n + 1))
                        || higher(n + w)
                        || (i > 0 && higher(n - 1))
                        || (j > 0 && higher(n - w))
                    {
                        LINE
                    } else {
                        mix(LUMEN, STEEP, f64::from(f32::from(levels[n]).min(LEVELS) / LEVELS))
                    }
                }
            };
            for y in j * scale..(j + 1) * scale {
                let row = y * w * scale + i * scale;
                pixels[row..row + scale].fill(colour);
            }
        }
    }
}

/// Returns the number of contour lines below a potential.
fn level(v: f32) -> i8 {
    if v < FIRST_LINE { 0 } else { (1.0 + (v / FIRST_LINE).log2() / 2.0).min(100.0) as i8 }
}

fn mix(a: Colour, b: Colour, share: f64) -> Colour {
    std::array::from_fn(|c| (f64::from(a[c]) + (f64::from(b[c]) - f64::from(a[c])) * share).round() as u8)
}

/// Draws in millimetres.
struct Pen<'a> {
    frame: &'a mut Frame,
    per_mm: f64,
}

impl Pen<'_> {
    /// Blends `colour` into the pixels of the box between two corners (picture pixels), each with the weight that `share`
    /// returns, 0 to 1.
    fn cover(&mut self, low: DVec3, high: DVec3, colour: Colour, share: impl Fn(DVec3) -> f64) {
        let (w, h) = (self.frame.width(), self.frame.height());
        let from = |x: f64| x.floor().max(0.0) as usize;
        let to = |x: f64, n: usize| (x.ceil().max(0.0) as usize + 1).min(n);
        let (pixels, _) = self.frame.buffers();
        for y in from(low.y)..to(high.y, h) {
            for x in from(low.x)..to(high.x, w) {
                let part = share(DVec3::new(x as f64 + 0.5, y as f64 + 0.5, 0.0)).clamp(0.0, 1.0);
                if part > 0.0 {
                    pixels[x + w * y] = mix(pixels[x + w * y], colour, part);
                }
            }
        }
    }

    fn disc(&mut self, at: DVec3, radius_mm: f64, colour: Colour) {
        let (c, r) = (at * self.per_mm, radius_mm * self.per_mm);
        let reach = DVec3::new(r + 1.0, r + 1.0, 0.0);
        self.cover(c - reach, c + reach, colour, |p| r + 0.5 - p.distance(c));
    }

    fn circle(&mut self, at: DVec3, radius_mm: f64, colour: Colour, share: f64) {
        let (c, r) = (at * self.per_mm, radius_mm * self.per_mm);
        let reach = DVec3::new(r + 2.0, r + 2.0, 0.0);
        self.cover(c - reach, c + reach, colour, |p| share * (1.2 - (p.distance(c) - r).abs()).min(1.0));
    }

    /// Draws a line of half-width `half_mm`.
    fn line(&mut self, from: DVec3, to: DVec3, half_mm: f64, colour: Colour, share: f64) {
        let (a, b, r) = (from * self.per_mm, to * self.per_mm, half_mm * self.per_mm);
        let along = b - a;
        let length2 = along.length_squared();
        let reach = DVec3::new(r + 1.0, r + 1.0, 0.0);
        // The bounding box of a long slanted line is large, so the line is drawn in pieces.
        let pieces = (along.length() / 24.0).ceil().max(1.0);
        let near = |p: DVec3| {
            let t = if length2 > 0.0 { ((p - a).dot(along) / length2).clamp(0.0, 1.0) } else { 0.0 };
            (p - a - along * t).length()
        };
        for n in 0..pieces as usize {
            // Each pixel belongs to the piece that contains its foot point, so none is covered twice.
            let (s, e) = (n as f64 / pieces, (n as f64 + 1.0) / pieces);
            let (p, q) = (a + along * s, a + along * e);
            let last = n + 1 == pieces as usize;
            self.cover(p.min(q) - reach, p.max(q) + reach, colour, |x| {
                let t = if length2 > 0.0 { (x - a).dot(along) / length2 } else { 0.0 };
                let mine = (n == 0 || t >= s) && (last || t < e);
                if mine { share * (r + 0.5 - near(x)).min(1.0) } else { 0.0 }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PlaneSettings;
    use crate::drawing::Drawing;
    use crate::shipped::named;

    const BARE: Show = Show { tentacles: false, mines: false, potential: false, trajectory: false };
    const RED: Colour = [255, 0, 0];

    /// A drawing of `w` × `h` pixels with a start and a goal, mm.
    fn drawn(w: usize, h: usize, inside: impl Fn(usize, usize) -> bool, start: DVec3, goal: DVec3) -> Drawing {
        let lumen = (0..w * h).map(|n| inside(n % w, n / w)).collect();
        let mut drawing = Drawing::new("d", ImageSize::new(w, h), lumen).unwrap();
        (drawing.start, drawing.goal) = (Some(start), Some(goal));
        drawing
    }

    /// Draws on a black picture of 70 × 30 pixels, two a millimetre.
    fn on_black(draw: impl Fn(&mut Pen<'_>)) -> Frame {
        let mut frame = Frame::new(70, 30);
        draw(&mut Pen { frame: &mut frame, per_mm: 2.0 });
        frame
    }

    fn red(frame: &Frame, x: usize, y: usize) -> u8 {
        frame.pixels()[x + frame.width() * y][0]
    }

    #[test]
    fn contour_lines_lie_at_fourfold_potentials() {
        let levels = [0.0, 14.9, 15.0, 59.0, 60.0, 239.0, 240.0, f32::INFINITY].map(level);
        assert_eq!(levels, [0, 0, 1, 1, 2, 2, 3, 100]);
    }

    #[test]
    fn a_disc_is_where_it_is_put_and_as_large() {
        let frame = on_black(|pen| pen.disc(DVec3::new(10.0, 5.0, 0.0), 2.0, RED));
        // The centre is (20, 10) and the radius 4 pixels. The rim is blended over one pixel.
        for y in 0..30 {
            for x in 0..70 {
                let d = (x as f64 + 0.5 - 20.0).hypot(y as f64 + 0.5 - 10.0);
                assert_eq!(red(&frame, x, y), (255.0 * (4.5 - d).clamp(0.0, 1.0)).round() as u8, "{x}, {y}");
            }
        }
    }

    #[test]
    fn a_circle_is_round_on_every_side() {
        let frame = on_black(|pen| pen.circle(DVec3::new(10.0, 6.0, 0.0), 3.0, RED, 0.8));
        // The centre is (20, 12) and the radius 6 pixels. The line fades out 1.2 pixels to either side.
        for y in 0..30 {
            for x in 0..70 {
                let off = ((x as f64 + 0.5 - 20.0).hypot(y as f64 + 0.5 - 12.0) - 6.0).abs();
                let share = 0.8 * (1.2 - off).clamp(0.0, 1.0);
                assert_eq!(red(&frame, x, y), (255.0 * share).round() as u8, "{x}, {y}");
            }
        }
    }

    #[test]
    fn a_line_reaches_from_end_to_end_and_covers_no_pixel_twice() {
        // From pixel (4, 10) to (56, 10), drawn in three pieces, half a pixel to either side, with round ends.
        let (a, b) = (DVec3::new(2.0, 5.0, 0.0), DVec3::new(28.0, 5.0, 0.0));
        let frame = on_black(|pen| pen.line(a, b, 0.25, RED, 0.5));
        for y in 0..30 {
            for x in 0..70 {
                let px = x as f64 + 0.5;
                let d = (px - px.clamp(4.0, 56.0)).hypot(y as f64 + 0.5 - 10.0);
                assert_eq!(red(&frame, x, y), (255.0 * 0.5 * (1.0 - d).max(0.0)).round() as u8, "{x}, {y}");
            }
        }
        assert_eq!([20, 21, 22, 38, 39].map(|x| red(&frame, x, 9)), [64; 5], "a quarter, at the joints too");
        assert_eq!([3, 56].map(|x| red(&frame, x, 10)), [37; 2], "both ends are round");
    }

    #[test]
    fn every_pixel_of_the_drawing_becomes_a_square() {
        let inside = |i, j| (4..76).contains(&i) && (4..20).contains(&j);
        let (start, goal) = (DVec3::new(6.0, 6.0, 0.0), DVec3::new(34.0, 6.0, 0.0));
        let flight = Flight::new(drawn(80, 24, inside, start, goal), PlaneSettings::default()).unwrap();
        let mut frame = Frame::default();
        Painter::new(&flight).paint(&flight, BARE, 3, &mut frame);
        assert_eq!((frame.width(), frame.height()), (240, 72));
        for (n, &pixel) in frame.pixels().iter().enumerate() {
            let (i, j) = (n % 240 / 3, n / 240 / 3);
            // Start, camera and goal lie at both ends of the lumen.
            if !inside(i, j) {
                assert_eq!(pixel, WALL, "{i}, {j}");
            } else if (32..56).contains(&i) {
                assert_eq!(pixel, LUMEN, "{i}, {j}");
            }
        }
    }

    #[test]
    fn contour_lines_do_not_go_on_at_the_other_border() {
        // One mine near the right border and walls that do not repel: three lines around the mine.
        let (start, goal) = (DVec3::new(74.0, 8.0, 0.0), DVec3::new(74.0, 36.0, 0.0));
        let mut settings = PlaneSettings::default();
        settings.tentacles.wall_push = 0.0;
        let mut flight = Flight::new(drawn(160, 80, |i, j| i + j > 0, start, goal), settings).unwrap();
        for _ in 0..2000 {
            if flight.mines().is_empty() {
                flight.step();
            }
        }
        assert_eq!(flight.mines().iter().collect::<Vec<_>>(), [start]);
        let mut frame = Frame::default();
        let show = Show { mines: true, potential: true, ..BARE };
        Painter::new(&flight).paint(&flight, show, 1, &mut frame);
        let lines = (0..80).filter(|j| frame.pixels()[159 + 160 * j] == LINE).count();
        assert!((1..=4).contains(&lines), "{lines} pixels of the right border are on a line");
    }

    #[test]
    fn a_cross_marks_the_place_where_the_operator_is_called() {
        let mut flight = Flight::new(named("neck").unwrap().unwrap(), PlaneSettings::default()).unwrap();
        while flight.state() == State::Flying {
            flight.step();
        }
        let place = flight.call().unwrap().place;
        let mut frame = Frame::default();
        Painter::new(&flight).paint(&flight, BARE, 1, &mut frame);
        for d in [[0.0, 0.0], [3.0, 3.0], [3.0, -3.0], [-3.0, 3.0], [-3.0, -3.0]] {
            let (x, y) = (((place.x + d[0]) / MM_PER_PIXEL) as usize, ((place.y + d[1]) / MM_PER_PIXEL) as usize);
            assert_eq!(frame.pixels()[x + frame.width() * y], CALLED, "{d:?} mm from the middle");
        }
    }
}
