//! Dot plots of shares: a line for each thing measured, a dot for each share, and reference values across all lines.

use super::pen::{self, Drawn, GREY, GRID, HPos, INK, Pen, RGBColor, VPos, colour};
use super::table::{Cell, Table};
use crate::error::Result;

/// Width of a plot and height of a line, pixels.
const WIDTH: i32 = 1000;
const LINE: i32 = 30;
/// Difference in height between the dots of two series, pixels.
const STAGGER: i32 = 4;
/// Pixels around the plotting area: left, right, top, bottom.
const MARGIN: [i32; 4] = [330, 24, 104, 58];
/// Distance of the axis' ticks.
const TICK: f64 = 0.1;

/// A dot plot of shares, 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Dots {
    /// Title above the plot.
    pub title: String,
    /// The name of the shares' axis.
    pub x: String,
    /// The name of each colour.
    pub series: Vec<&'static str>,
    /// The lines from top to bottom, each with a share for each series where there is one.
    pub lines: Vec<(String, Vec<Option<f64>>)>,
    /// Values to compare with, and their names.
    pub references: Vec<(f64, &'static str)>,
}

impl Dots {
    /// Returns the shares as a table: a row for each line, a column for each series.
    pub(crate) fn table(&self) -> Table {
        let mut t = Table::new(&[&["name"], &self.series[..]].concat());
        for (name, shares) in &self.lines {
            let cells = shares.iter().map(|&s| (s, 3).into());
            t.row(std::iter::once(Cell::from(name)).chain(cells).collect());
        }
        t
    }

    /// Returns the plot as an SVG element. Fails with status 1 if it cannot be drawn.
    pub(crate) fn svg(&self) -> Result<String> {
        let height = MARGIN[2] + MARGIN[3] + LINE * self.lines.len() as i32;
        pen::svg(WIDTH, height, |pen| self.draw(pen, height))
    }

    fn draw(&self, pen: &Pen<'_>, height: i32) -> Drawn {
        let (left, right, top, bottom) = (MARGIN[0], WIDTH - MARGIN[1], MARGIN[2], height - MARGIN[3]);
        let shares = self.lines.iter().flat_map(|l| l.1.iter().flatten());
        let least = shares.copied().filter(|s| s.is_finite()).fold(1.0 - TICK, f64::min);
        let low = ((least / TICK).floor() * TICK).clamp(0.0, 1.0 - TICK);
        let across = |s: f64| left + ((s - low) / (1.0 - low) * f64::from(right - left)).round() as i32;
        pen.text(&self.title, (12, 6), 20, INK, (HPos::Left, VPos::Top))?;
        let mut legend = 18;
        for (n, name) in self.series.iter().enumerate() {
            pen.dot((legend, 48), 5, colour(n))?;
            pen.text(name, (legend + 10, 48), 15, INK, (HPos::Left, VPos::Center))?;
            legend += 34 + 7 * name.chars().count() as i32;
        }
        for n in (low / TICK).round() as i32..=(1.0 / TICK).round() as i32 {
            let at = across(f64::from(n) * TICK);
            pen.line([(at, top), (at, bottom)], GRID, 1)?;
            pen.text(&format!("{} %", n * 10), (at, bottom + 8), 15, GREY, (HPos::Center, VPos::Top))?;
        }
        for (share, name) in self.references.iter().filter(|r| r.0 >= low) {
            let at = across(*share);
            pen.line([(at, top - 6), (at, bottom)], RGBColor(150, 150, 150), 2)?;
            // Names of values that are close together alternate between two rows.
            let row = self.references.iter().position(|r| r.1 == *name).unwrap_or(0) as i32 % 2;
            pen.text(name, (at, top - 10 - 15 * row), 13, GREY, (HPos::Center, VPos::Bottom))?;
        }
        for (n, (name, shares)) in self.lines.iter().enumerate() {
            let y = top + LINE * n as i32 + LINE / 2;
            pen.line([(left, y), (right, y)], RGBColor(238, 238, 238), 1)?;
            pen.text(name, (left - 12, y), 15, INK, (HPos::Right, VPos::Center))?;
            for (k, share) in shares.iter().enumerate() {
                if let Some(s) = share.filter(|s| s.is_finite()) {
                    // Each series has its own height within the line, so that equal shares do not hide each other.
                    let beside = STAGGER * (2 * k as i32 + 1 - self.series.len() as i32) / 2;
                    pen.dot((across(s), y + beside), 4, colour(k))?;
                }
            }
        }
        pen.frame([(left, top), (right, bottom)])?;
        pen.text(&self.x, ((left + right) / 2, height - 10), 17, INK, (HPos::Center, VPos::Bottom))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dots_are_drawn_where_there_is_a_share() {
        let dots = Dots {
            title: "a <plot>".to_owned(),
            x: "share".to_owned(),
            series: vec!["one", "two"],
            lines: vec![("a".to_owned(), vec![Some(0.35), None]), ("b".to_owned(), vec![Some(1.0), Some(f64::NAN)])],
            references: vec![(0.77, "study"), (0.1, "below the axis")],
        };
        let svg = dots.svg().unwrap();
        assert!(
            svg.starts_with("<svg") && svg.contains("a &lt;plot&gt;") && svg.contains("30 %") && !svg.contains("NaN")
        );
        assert_eq!(svg.matches("<circle").count(), 2 + 2, "the legend, and two shares");
        assert!(svg.contains("study") && !svg.contains("below the axis") && !svg.contains("20 %"));
        assert_eq!(dots.table().csv(), "name,one,two\na,0.35,\nb,1,NaN\n");
        assert!(Dots { lines: Vec::new(), ..dots }.svg().is_ok());
    }
}
