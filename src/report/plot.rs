//! Work-precision plots: both axes are logarithmic, the Pareto front is marked, and every point has a name.

use super::pen::{self, Drawn, GREY, GRID, HPos, INK, Pen, Place, RGBColor, VPos, colour};
use super::table::{Table, row};
use crate::error::Result;

/// Size of a plot, pixels.
const SIZE: (i32, i32) = (1000, 620);
/// Pixels around the plotting area: left, right, top, bottom.
const MARGIN: [i32; 4] = [84, 22, 78, 62];
/// The colour of the Pareto front.
const FRONT: RGBColor = RGBColor(216, 216, 216);

/// A measured point.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Point {
    /// Horizontal coordinate, above 0.
    pub x: f64,
    /// Vertical coordinate, above 0.
    pub y: f64,
    /// Its name in the plot and the CSV.
    pub name: String,
}

/// Points of one colour.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Its name in the legend and the CSV.
    pub name: String,
    /// Its points, in the order of a line through them.
    pub points: Vec<Point>,
    /// True if a line is drawn through them.
    pub line: bool,
}

impl Point {
    /// Creates a point without a name.
    pub(crate) fn at(x: f64, y: f64) -> Self {
        Self { x, y, name: String::new() }
    }
}

impl Series {
    /// Creates points with a line through them.
    pub(crate) fn line(name: impl Into<String>, points: impl IntoIterator<Item = Point>) -> Self {
        Self { name: name.into(), points: points.into_iter().collect(), line: true }
    }

    /// Groups points by the name of their series, in the order of the names' first points. The bool is true if a line is drawn.
    pub(crate) fn grouped(points: impl IntoIterator<Item = (String, bool, Point)>) -> Vec<Self> {
        let mut all: Vec<Self> = Vec::new();
        for (name, line, point) in points {
            match all.iter_mut().find(|s| s.name == name) {
                Some(s) => s.points.push(point),
                None => all.push(Self { name, points: vec![point], line }),
            }
        }
        all
    }
}

/// A plot of y over x. Smaller values are better in both.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plot {
    /// Title above the plot.
    pub title: String,
    /// Label of x, with its unit.
    pub x: String,
    /// Label of y, with its unit.
    pub y: String,
    /// True if the Pareto front is marked.
    pub front: bool,
    /// The plotted series. Points that a logarithmic scale cannot show are omitted in the picture, but not in the CSV file.
    pub series: Vec<Series>,
}

impl Plot {
    /// Creates a plot without a front.
    pub(crate) fn new(
        title: impl Into<String>,
        x: impl Into<String>,
        y: impl Into<String>,
        series: Vec<Series>,
    ) -> Self {
        Self { title: title.into(), x: x.into(), y: y.into(), front: false, series }
    }

    /// Returns the points as a table: series, name, x, y, and whether the point is on the Pareto front.
    pub(crate) fn table(&self) -> Table {
        let mut t = Table::new(&["series", "name", &self.x, &self.y, "on_front"]);
        let front = self.front();
        for s in &self.series {
            for p in &s.points {
                t.row(row![&s.name, &p.name, (p.x, 4), (p.y, 4), front.contains(&(p.x, p.y))]);
            }
        }
        t
    }

    fn shown(&self) -> impl Iterator<Item = (usize, &Point)> {
        let can = |v: f64| v.is_finite() && v > 0.0;
        let each = self.series.iter().enumerate().flat_map(|(n, s)| s.points.iter().map(move |p| (n, p)));
        each.filter(move |(_, p)| can(p.x) && can(p.y))
    }

    /// Returns the Pareto front (points that none surpasses in both), from left to right.
    fn front(&self) -> Vec<(f64, f64)> {
        let mut all: Vec<(f64, f64)> = self.shown().map(|(_, p)| (p.x, p.y)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut least = f64::INFINITY;
        all.retain(|&(_, y)| {
            let better = y < least;
            least = least.min(y);
            better
        });
        all
    }

    /// Returns the plot as an SVG element. Fails with status 1 if it cannot be drawn.
    pub(crate) fn svg(&self) -> Result<String> {
        pen::svg(SIZE.0, SIZE.1, |pen| self.draw(pen))
    }

    fn draw(&self, pen: &Pen<'_>) -> Drawn {
        let (left, right) = (MARGIN[0], SIZE.0 - MARGIN[1]);
        let (top, bottom) = (MARGIN[2], SIZE.1 - MARGIN[3]);
        pen.text(&self.title, (left, 6), 20, INK, (HPos::Left, VPos::Top))?;
        let x = Axis::over(self.shown().map(|(_, p)| p.x), [left, right]);
        let y = Axis::over(self.shown().map(|(_, p)| p.y), [bottom, top]);
        for (v, labelled) in x.ticks() {
            let at = x.at(v);
            pen.line([(at, top), (at, bottom)], GRID, 1)?;
            if labelled {
                pen.text(&number(v), (at, bottom + 8), 15, GREY, (HPos::Center, VPos::Top))?;
            }
        }
        for (v, labelled) in y.ticks() {
            let at = y.at(v);
            pen.line([(left, at), (right, at)], GRID, 1)?;
            if labelled {
                pen.text(&number(v), (left - 8, at), 15, GREY, (HPos::Right, VPos::Center))?;
            }
        }
        pen.frame([(left, top), (right, bottom)])?;
        pen.text(&self.x, ((left + right) / 2, SIZE.1 - 12), 17, INK, (HPos::Center, VPos::Bottom))?;
        pen.upwards(&self.y, (10, (top + bottom) / 2), 17)?;
        self.legend(pen)?;
        let place = |p: &Point| (x.at(p.x), y.at(p.y));
        let front = if self.front { self.front() } else { Vec::new() };
        pen.line(front.iter().map(|&(a, b)| (x.at(a), y.at(b))).collect::<Vec<_>>(), FRONT, 7)?;
        for (n, s) in self.series.iter().enumerate().filter(|(_, s)| s.line) {
            let points = self.shown().filter(|(k, _)| *k == n).map(|(_, p)| place(p));
            pen.line(points.collect::<Vec<_>>(), colour(n), 2)?;
            debug_assert!(!s.name.is_empty());
        }
        let mut taken: Vec<[i32; 4]> = self.shown().map(|(_, p)| around(place(p), 7)).collect();
        for (n, p) in self.shown() {
            pen.dot(place(p), 5, colour(n))?;
            let at = free_place(&p.name, place(p), [left, top, right, bottom], &mut taken);
            if (at.0 - place(p).0).abs() > 60 + 4 * p.name.chars().count() as i32 || (at.1 - place(p).1).abs() > 24 {
                pen.line([place(p), at], RGBColor(170, 170, 170), 1)?;
            }
            pen.text(&p.name, at, LABEL, colour(n), (HPos::Center, VPos::Center))?;
        }
        Ok(())
    }

    /// Draws the legend's entries in rows above the plot, with that of the front last.
    fn legend(&self, pen: &Pen<'_>) -> Drawn {
        let mut at = (MARGIN[0] + 6, 40);
        let named = self.series.iter().enumerate().map(|(n, s)| (s.name.as_str(), colour(n)));
        let front = self.front.then_some(("no other point is better in both", FRONT));
        for (name, colour) in named.chain(front) {
            if at.0 + width(name, 14) > SIZE.0 {
                at = (MARGIN[0] + 6, at.1 + 20);
            }
            pen.dot(at, 5, colour)?;
            pen.text(name, (at.0 + 10, at.1), 15, INK, (HPos::Left, VPos::Center))?;
            at.0 += 32 + width(name, 14);
        }
        Ok(())
    }
}

/// Font size of the points' names, pixels.
const LABEL: i32 = 14;

/// Returns the approximate width of a text, pixels. The fonts depend on the reader's system, so this is an upper estimate.
fn width(s: &str, px: i32) -> i32 {
    s.chars().count() as i32 * px * 50 / 100
}

fn around((x, y): Place, by: i32) -> [i32; 4] {
    [x - by, y - by, x + by, y + by]
}

/// Finds and reserves a position for a point's name, nearby, where it covers nothing. Falls back to the nearest position.
fn free_place(name: &str, (x, y): Place, within: [i32; 4], taken: &mut Vec<[i32; 4]>) -> Place {
    let (w, h) = (width(name, LABEL) / 2, LABEL / 2 + 1);
    let beside = w + 10;
    let candidates = (0..30).flat_map(|ring| {
        let up = 12 + 13 * ring;
        let mut places = vec![(0, -up), (0, up), (w, -up), (-w, -up), (w, up), (-w, up)];
        if ring == 0 {
            places.splice(0..0, [(beside, 0), (-beside, 0)]);
        } else {
            places.extend([(beside, -13 * ring), (beside, 13 * ring), (-beside, -13 * ring), (-beside, 13 * ring)]);
        }
        places.into_iter().map(move |(dx, dy)| (x + dx, y + dy))
    });
    let room = |&(cx, cy): &Place| {
        let b = [cx - w, cy - h, cx + w, cy + h];
        let inside = b[0] >= within[0] + 2 && b[1] >= within[1] + 2 && b[2] <= within[2] - 2 && b[3] <= within[3] - 2;
        inside && !taken.iter().any(|t| b[0] < t[2] && t[0] < b[2] && b[1] < t[3] && t[1] < b[3])
    };
    let at = candidates.into_iter().find(room).unwrap_or((x + beside, y));
    taken.push([at.0 - w, at.1 - h, at.0 + w, at.1 + h]);
    at
}

/// A logarithmic axis.
struct Axis {
    low: f64,
    high: f64,
    pixels: [i32; 2],
}

impl Axis {
    /// Creates an axis that covers all `values` (above 0); one decade if there are none.
    fn over(values: impl Iterator<Item = f64>, pixels: [i32; 2]) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return Self { low: 1.0, high: 10.0, pixels };
        }
        let room = (high / low).powf(0.08).max(1.25);
        Self { low: low / room, high: high * room, pixels }
    }

    fn at(&self, v: f64) -> i32 {
        let t = (v / self.low).ln() / (self.high / self.low).ln();
        self.pixels[0] + (t * f64::from(self.pixels[1] - self.pixels[0])).round() as i32
    }

    /// Returns the positions of lines, and whether they have labels: 1, 2 and 5 of each decade, with all labels if there are few
    /// lines, and with labels only at decades if there are many.
    fn ticks(&self) -> Vec<(f64, bool)> {
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let wide = last - first > 5;
        let every = ((last - first) / 10).max(1);
        let all = (first..=last).flat_map(|d| (1..10).map(move |m| (d, m)));
        let inside =
            all.map(|(d, m)| (d, m, f64::from(m) * 10f64.powi(d))).filter(|t| t.2 >= self.low && t.2 <= self.high);
        let inside: Vec<(i32, i32, f64)> = inside.filter(|t| !wide || (t.1 == 1 && t.0 % every == 0)).collect();
        let few = inside.iter().filter(|t| [1, 2, 5].contains(&t.1)).count() < 3;
        inside.into_iter().map(|(_, m, v)| (v, few || [1, 2, 5].contains(&m))).collect()
    }
}

/// Formats a tick's number for people.
fn number(v: f64) -> String {
    if !(1e-3..1e6).contains(&v) {
        return format!("{v:.0e}");
    }
    let digits = (-v.log10().floor()).max(0.0) as usize;
    format!("{v:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: &[(f64, f64)]) -> Plot {
        let points = points.iter().enumerate().map(|(n, &(x, y))| Point { x, y, name: format!("p{n}") }).collect();
        let series = vec![Series { name: "one".to_owned(), points, line: true }];
        Plot { title: "a <plot>".to_owned(), x: "time / ms".to_owned(), y: "error".to_owned(), front: true, series }
    }

    #[test]
    fn the_front_is_what_none_betters() {
        let p = plot(&[(1.0, 5.0), (2.0, 2.0), (3.0, 3.0), (4.0, 1.0), (0.5, 9.0), (4.0, 7.0)]);
        assert_eq!(p.front(), vec![(0.5, 9.0), (1.0, 5.0), (2.0, 2.0), (4.0, 1.0)]);
        assert_eq!(p.table().csv().matches(",yes").count(), 4);
    }

    #[test]
    fn a_plot_is_svg_with_its_words_and_without_what_no_logarithm_takes() {
        let svg = plot(&[(1.0, 5.0), (2.0, 0.0), (f64::INFINITY, 3.0), (20.0, 1.0)]).svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for word in ["a &lt;plot&gt;", "time / ms", "p0", "p3", "one"] {
            assert!(svg.contains(word), "{word}");
        }
        assert!(!svg.contains("p1") && !svg.contains("p2") && !svg.contains("NaN"));
        assert!(plot(&[]).svg().is_ok() && plot(&[(3.0, 3.0)]).svg().is_ok());
    }

    #[test]
    fn names_do_not_cover_each_other() {
        let mut taken = vec![around((100, 100), 7), around((104, 103), 7)];
        for _ in 0..12 {
            let before = taken.clone();
            free_place("a name", (100, 100), [0, 0, 1000, 600], &mut taken);
            let b = taken[taken.len() - 1];
            assert!(!before.iter().any(|t| b[0] < t[2] && t[0] < b[2] && b[1] < t[3] && t[1] < b[3]));
        }
    }

    #[test]
    fn ticks_lie_on_the_axis() {
        for values in [vec![3.0, 4.0], vec![1e-3, 1e5], vec![0.02], vec![]] {
            let axis = Axis::over(values.into_iter(), [0, 900]);
            let ticks = axis.ticks();
            assert!(ticks.iter().any(|t| t.1) && ticks.len() < 80);
            assert!(ticks.iter().all(|t| (0..=900).contains(&axis.at(t.0))));
        }
        assert_eq!([number(0.02), number(5.0), number(200.0), number(1e-7)], ["0.02", "5", "200", "1e-7"]);
    }
}
