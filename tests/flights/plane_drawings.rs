//! Draws the ten lumens of `assets/plane`: strokes of lumen and of wall, always the same.

use colvis::plane::drawing::MM_PER_PIXEL;
use image::{Rgb, RgbImage};

/// A drawing in progress. Positions and lengths are in mm.
pub(crate) struct Canvas {
    image: RgbImage,
}

const LUMEN: Rgb<u8> = Rgb([255, 255, 255]);
const WALL: Rgb<u8> = Rgb([0, 0, 0]);

impl Canvas {
    fn new(width_mm: f64, height_mm: f64) -> Self {
        let pixels = |mm: f64| (mm / MM_PER_PIXEL) as u32;
        Self { image: RgbImage::from_pixel(pixels(width_mm), pixels(height_mm), WALL) }
    }

    /// Paints everything within `half` of the line through `points`.
    fn stroke(mut self, points: &[(f64, f64)], half: f64, colour: Rgb<u8>) -> Self {
        for (x, y, pixel) in self.image.enumerate_pixels_mut() {
            let p = ((f64::from(x) + 0.5) * MM_PER_PIXEL, (f64::from(y) + 0.5) * MM_PER_PIXEL);
            if points.windows(2).any(|w| distance(p, w[0], w[1]) <= half) {
                *pixel = colour;
            }
        }
        self
    }

    fn lumen(self, points: &[(f64, f64)], half: f64) -> Self {
        self.stroke(points, half, LUMEN)
    }

    fn wall(self, points: &[(f64, f64)], half: f64) -> Self {
        self.stroke(points, half, WALL)
    }

    /// Marks start (red) and goal (green), two by two pixels each.
    fn between(mut self, start: (f64, f64), goal: (f64, f64)) -> RgbImage {
        for (at, colour) in [(start, Rgb([255, 0, 0])), (goal, Rgb([0, 255, 0]))] {
            for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let pixel = |mm: f64, n: u32| (mm / MM_PER_PIXEL) as u32 + n - 1;
                self.image.put_pixel(pixel(at.0, i), pixel(at.1, j), colour);
            }
        }
        self.image
    }
}

fn distance(p: (f64, f64), a: (f64, f64), b: (f64, f64)) -> f64 {
    let (d, q) = ((b.0 - a.0, b.1 - a.1), (p.0 - a.0, p.1 - a.1));
    let l2 = d.0 * d.0 + d.1 * d.1;
    let t = if l2 > 0.0 { ((q.0 * d.0 + q.1 * d.1) / l2).clamp(0.0, 1.0) } else { 0.0 };
    (q.0 - t * d.0).hypot(q.1 - t * d.1)
}

fn arc(centre: (f64, f64), radius: impl Fn(f64) -> f64, from: f64, to: f64) -> Vec<(f64, f64)> {
    let n = 160;
    (0..=n)
        .map(|i| {
            let t = from + (to - from) * f64::from(i) / f64::from(n);
            let r = radius((t - from) / (to - from));
            (centre.0 + r * t.to_radians().cos(), centre.1 + r * t.to_radians().sin())
        })
        .collect()
}

/// Draws the lumen with that name.
pub(crate) fn draw(name: &str) -> RgbImage {
    match name {
        "straight" => {
            Canvas::new(180.0, 60.0).lumen(&[(16.0, 30.0), (164.0, 30.0)], 10.0).between((18.0, 30.0), (160.0, 30.0))
        }
        // A colon in the plane: hairpins, with folds that extend from both sides in turn.
        "bends" => {
            let way = [
                (20.0, 100.0),
                (20.0, 40.0),
                (32.0, 24.0),
                (46.0, 40.0),
                (48.0, 84.0),
                (62.0, 102.0),
                (80.0, 88.0),
                (84.0, 40.0),
                (98.0, 22.0),
                (114.0, 34.0),
                (122.0, 62.0),
                (140.0, 66.0),
                (152.0, 46.0),
                (160.0, 24.0),
            ];
            let mut canvas = Canvas::new(180.0, 120.0).lumen(&way, 9.5);
            for (a, b) in [((9.0, 62.0), (15.0, 62.0)), ((58.0, 66.0), (52.0, 66.0)), ((92.0, 60.0), (86.0, 61.0))] {
                canvas = canvas.wall(&[a, b], 1.2);
            }
            canvas.between((20.0, 98.0), (159.0, 27.0))
        }
        // The blind branch goes straight on. The path to the goal leaves it sideways and backwards.
        "fork" => Canvas::new(180.0, 120.0)
            .lumen(&[(16.0, 30.0), (164.0, 30.0)], 9.0)
            .lumen(&[(92.0, 30.0), (60.0, 92.0), (160.0, 100.0)], 9.0)
            .between((18.0, 30.0), (158.0, 100.0)),
        // A wide cave that faces the camera. The exit is a gap in its rear, beside the entrance.
        "pocket" => Canvas::new(180.0, 120.0)
            .lumen(&[(16.0, 40.0), (90.0, 40.0)], 9.0)
            .lumen(&[(112.0, 40.0), (120.0, 40.0)], 30.0)
            .lumen(&[(92.0, 58.0), (76.0, 86.0), (90.0, 104.0), (160.0, 100.0)], 7.0)
            .between((18.0, 40.0), (156.0, 100.0)),
        // A ring: the path to the goal is narrower than the camera.
        "ring" => Canvas::new(150.0, 120.0)
            .lumen(&arc((62.0, 60.0), |_| 40.0, 0.0, 360.0), 9.0)
            .lumen(&[(100.0, 60.0), (122.0, 60.0)], 1.0)
            .lumen(&[(124.0, 60.0), (134.0, 60.0)], 8.0)
            .between((62.0, 20.0), (132.0, 60.0)),
        // Two loops of the colon that touch: their walls are open to each other for a stretch.
        "touching" => Canvas::new(180.0, 120.0)
            .lumen(&[(16.0, 38.0), (60.0, 36.0), (90.0, 50.0), (120.0, 36.0), (164.0, 38.0)], 9.0)
            .lumen(&[(16.0, 92.0), (60.0, 84.0), (90.0, 67.0), (120.0, 84.0), (164.0, 92.0)], 9.0)
            .between((18.0, 38.0), (160.0, 38.0)),
        // A strand in the middle of the view: the forces balance in front of it.
        "bridge" => Canvas::new(180.0, 60.0)
            .lumen(&[(18.0, 30.0), (162.0, 30.0)], 12.0)
            .wall(&[(90.0, 24.0), (90.0, 36.0)], 1.0)
            .between((20.0, 30.0), (158.0, 30.0)),
        // A polyp on a broad base that leaves a quarter of the lumen.
        "polyp" => Canvas::new(180.0, 60.0)
            .lumen(&[(16.0, 30.0), (164.0, 30.0)], 11.0)
            .wall(&[(92.0, 38.0), (92.0, 37.0)], 13.0)
            .between((18.0, 30.0), (160.0, 30.0)),
        "neck" => Canvas::new(180.0, 60.0)
            .lumen(&[(16.0, 30.0), (76.0, 30.0)], 10.0)
            .lumen(&[(106.0, 30.0), (164.0, 30.0)], 10.0)
            .lumen(&[(80.0, 30.0), (100.0, 30.0)], 1.1)
            .between((18.0, 30.0), (160.0, 30.0)),
        "spiral" => Canvas::new(150.0, 150.0)
            .lumen(&arc((75.0, 75.0), |t| 62.0 - 56.0 * t, 180.0, 1040.0), 7.0)
            .between((13.5, 75.0), (79.0, 71.0)),
        _ => panic!("there is no drawing {name:?}"),
    }
}
