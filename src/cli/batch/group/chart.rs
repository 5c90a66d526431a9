//! Histograms as SVG.

use std::fmt::Write as _;

use super::distributions::{Distribution, Histogram, nice};
use super::measures::{short, with_unit};
use crate::cli::candidates::escape;

/// Width and height of the bars' field, and the room for the axis below it, pixels.
const SIZE: [f64; 2] = [300.0, 96.0];
const AXIS: f64 = 20.0;
/// Room at both sides, pixels: for the counts of values beyond, and half a label.
const SIDE: f64 = 30.0;
/// Number of marks of an axis.
const MARKS: f64 = 5.0;

/// An outlier in a distribution.
pub(super) struct Mark<'a> {
    pub(super) value: f64,
    pub(super) id: &'a str,
    /// The address of its case.
    pub(super) address: String,
}

/// Returns a distribution as a figure, with the outliers marked.
pub(super) fn figure<'a>(distribution: &Distribution, far: impl Iterator<Item = Mark<'a>>) -> String {
    let measure = distribution.measure();
    let histogram = distribution.histogram();
    let Histogram { from, width, counts, is_whole, beyond } = &histogram;
    let to = from + width * counts.len() as f64;
    let x = |value: f64| SIDE + (SIZE[0] - 2.0 * SIDE) * ((value - from) / (to - from)).clamp(0.0, 1.0);
    let most = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    if distribution.least() == distribution.most() {
        let all = if distribution.count() == 1 { "The one case has" } else { "All cases have" };
        let value = with_unit(distribution.median, measure.unit);
        return frame(distribution, &format!("<p>{all} {}.</p>", escape(&value)), "");
    }
    let (bottom, step) = (SIZE[1], (SIZE[0] - 2.0 * SIDE) / counts.len() as f64);
    let mut svg = String::new();
    let [low, median, high] = [distribution.low, distribution.median, distribution.high].map(x);
    let _ = write!(
        svg,
        "<rect class=\"band\" x=\"{low:.1}\" y=\"8\" width=\"{:.1}\" height=\"{:.0}\"/>",
        (high - low).max(1.0),
        bottom - 8.0
    );
    for (n, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        // A single case must be seen beside thousands.
        let tall = ((bottom - 14.0) * *count as f64 / most).max(1.5);
        let begin = from + width * n as f64;
        let range = match *is_whole && *width == 1.0 {
            true => with_unit(begin + 0.5, measure.unit),
            false => format!("{} to {}", short(begin), with_unit(begin + width, measure.unit)),
        };
        let _ = write!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{tall:.1}\"><title>{}: {count}</title></rect>",
            SIDE + step * n as f64 + 0.5,
            bottom - tall,
            (step - 1.0).max(0.5),
            escape(&range)
        );
    }
    let _ = write!(svg, "<path class=\"median\" d=\"M{median:.1} 6V{bottom:.0}\"/>");
    let _ = write!(svg, "<path class=\"axis\" d=\"M{SIDE:.0} {bottom:.0}H{:.0}\"/>", SIZE[0] - SIDE);
    let gap = nice((to - from) / MARKS).max(if *is_whole { 1.0 } else { 0.0 });
    let mut before = String::new();
    for n in (from / gap).ceil() as i64..=(to / gap + 1e-9).floor() as i64 {
        let (at, label) = (gap * n as f64, short(gap * n as f64));
        // Marks nearer to each other than the label has digits would have the same one.
        if label != before {
            let _ = write!(svg, "<text x=\"{:.1}\" y=\"{:.0}\">{label}</text>", x(at), bottom + AXIS - 5.0);
        }
        before = label;
    }
    for mark in far.filter(|m| (*from..=to).contains(&m.value)) {
        let told = escape(&format!("{}: {}", mark.id, with_unit(mark.value, measure.unit)));
        let _ = write!(
            svg,
            "<a href=\"{}\"><circle cx=\"{:.1}\" cy=\"{bottom:.1}\" r=\"3\"><title>{told}</title></circle></a>",
            mark.address,
            x(mark.value)
        );
    }
    for (count, at, arrow) in [(beyond[0], 2.0, "← "), (beyond[1], SIZE[0] - 2.0, "→ ")] {
        if count > 0 {
            let side = if at < SIDE { "start" } else { "end" };
            let _ = write!(
                svg,
                "<text class=\"beyond\" x=\"{at}\" y=\"{:.0}\" text-anchor=\"{side}\">{arrow}{count}</text>",
                bottom - 4.0
            );
        }
    }
    let count = distribution.count();
    let cases = if count == 1 { "1 case".to_owned() } else { format!("{count} cases") };
    let told = format!(
        "median {}, 5 % {}, 95 % {}, from {} to {}, {cases}",
        with_unit(distribution.median, measure.unit),
        short(distribution.low),
        short(distribution.high),
        short(distribution.least()),
        short(distribution.most()),
    );
    let title = escape(measure.title);
    let svg = format!(
        "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{title}: {told}\">{svg}</svg>",
        SIZE[0],
        SIZE[1] + AXIS
    );
    frame(distribution, &svg, &format!("<figcaption>{told}</figcaption>"))
}

/// A figure with its title.
fn frame(distribution: &Distribution, picture: &str, caption: &str) -> String {
    let measure = distribution.measure();
    let unit = if measure.unit.is_empty() { String::new() } else { format!(" <small>{}</small>", measure.unit) };
    format!("<figure class=\"chart\"><h3>{}{unit}</h3>{picture}{caption}</figure>\n", escape(measure.title))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::batch::group::measures::MEASURES;
    use crate::cli::batch::group::rows::{Row, State};

    /// Every number of a drawing is finite, whatever the values.
    #[test]
    fn a_figure_is_drawn_of_one_case_of_ties_and_of_extremes() {
        let number = MEASURES.iter().position(|m| m.name == "coverage").unwrap();
        let figure_of = |values: &[f64]| {
            let row = |x: &f64| {
                let mut row = Row::unknown("a", State::Done, "", "");
                row.values[number] = Some(*x);
                row
            };
            let rows: Vec<Row> = values.iter().map(row).collect();
            let mark = |x: &f64| Mark { value: *x, id: "<a>", address: "#c0".to_owned() };
            figure(&Distribution::of(number, &rows).unwrap(), values.iter().map(mark))
        };
        for values in [&[0.5, 0.51][..], &[0.0, 1e-30], &[-1e200, 0.5, 0.6, 1e200], &[1e-9, 2e-9]] {
            let html = figure_of(values);
            assert!(
                html.contains("<svg") && !html.contains("<a>") && !html.contains("NaN") && !html.contains("inf"),
                "{html}"
            );
            assert!(html.matches("<text").count() < 20, "{html}");
        }
        assert!(figure_of(&[0.5, 0.5, 0.6]).contains("median 50\u{a0}%, 5 % 50, 95 % 59, from 50 to 60, 3 cases<"));
        assert!(figure_of(&[0.5]).contains("<p>The one case has 50\u{a0}%.</p></figure>"));
        assert!(figure_of(&[0.0; 3]).contains("<p>All cases have 0\u{a0}%.</p></figure>"));
    }
}
