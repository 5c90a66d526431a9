//! The page: what stands out first, all cases last. It needs nothing but the pictures beside it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use super::super::steps::Step;
use super::chart::{self, Mark};
use super::distributions::{Distribution, OUTLIER, Outlier, quantile};
use super::measures::{MEASURES, short, with_unit};
use super::pictures;
use super::reconciliation::{Reconciliation, Source};
use super::rows::{Row, State};
use crate::cli::candidates::escape;
use crate::error::Result;
use crate::output;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
/// Cases on a page: a browser opens so many in a second.
pub(super) const TOGETHER: usize = 1000;
/// Outliers, kinds of failures, and ids of a list that the page shows. The table has all.
const MOST_OUTLIERS: usize = 48;
const MOST_FAILURES: usize = 100;
const MOST_IDS: usize = 40;
/// Measures on the card of a case.
const ON_CARD: [&str; 6] = ["length_mm", "lumen_ml", "caliber_mm", "distended", "coverage", "candidates"];

/// Everything that the pages tell.
pub(super) struct Group<'a> {
    /// By their ids.
    pub(super) rows: &'a [Row],
    pub(super) told: &'a Reconciliation,
    pub(super) distributions: &'a [Distribution],
    /// The farthest first.
    pub(super) outliers: &'a [Outlier],
}

/// Returns the name of a page, counted from 0.
pub(super) fn name(page: usize) -> String {
    if page == 0 { "index.html".to_owned() } else { format!("cases-{}.html", page + 1) }
}

impl Group<'_> {
    /// Writes all pages, the first one last. Fails with status 5.
    pub(super) fn write(&self, report: &Path) -> Result<()> {
        let reasons: BTreeMap<usize, &Outlier> = self.outliers.iter().map(|o| (o.row, o)).collect();
        for page in (0..self.pages()).rev() {
            let mut body = if page == 0 { self.summary() } else { self.later_head(page) };
            self.cases(page, &reasons, &mut body);
            let title = self.title();
            let about = match page {
                0 => title.clone(),
                n => format!("{title}, page {}", n + 1),
            };
            output::write_whole(&report.join(name(page)), |w| {
                write!(
                    w,
                    "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
                     <meta name=\"viewport\" content=\"width=device-width\">\n<title>{about}</title>\n\
                     <style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{body}<footer>colvis {}. All numbers are in \
                     <a href=\"cases.csv\">cases.csv</a>.</footer>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n",
                    env!("CARGO_PKG_VERSION")
                )
            })?;
        }
        Ok(())
    }

    fn pages(&self) -> usize {
        self.rows.len().div_ceil(TOGETHER).max(1)
    }

    fn title(&self) -> String {
        format!("Batch of {}", cases(self.rows.len()))
    }

    /// Everything above the cases on the first page.
    fn summary(&self) -> String {
        let mut out = String::new();
        self.tiles(&mut out);
        out.push_str("<p class=\"soft\">Research software, not for diagnosis.</p>\n");
        self.versions(&mut out);
        out.push_str(
            "<nav><a href=\"#list\">List and folders</a> <a href=\"#distributions\">Distributions</a> <a href=\"#outliers\">Outliers</a> \
             <a href=\"#failures\">Failures</a> <a href=\"#cost\">Time and memory</a> <a href=\"#cases\">Cases</a></nav>\n",
        );
        self.reconciliation(&mut out);
        self.distributions(&mut out);
        self.outliers(&mut out);
        self.failures(&mut out);
        self.cost(&mut out);
        out
    }

    fn later_head(&self, page: usize) -> String {
        format!("<p><a href=\"{}\">Summary</a>, page {} of {}</p>\n", name(0), page + 1, self.pages())
    }

    fn tiles(&self, out: &mut String) {
        let tile = |number: usize, text: &str, class: &str| {
            let class = if number == 0 { "" } else { class };
            format!("<li class=\"{class}\"><b>{number}</b>{}</li>", escape(text))
        };
        let of = |state: State| self.rows.iter().filter(|r| r.state == state).count();
        let mut tiles = vec![tile(of(State::Done), "done", "good")];
        let mut classes: BTreeMap<&str, usize> = BTreeMap::new();
        for row in self.rows.iter().filter(|r| r.state == State::Failed) {
            *classes.entry(row.failures.first().map_or("no class", |f| f.class.as_str())).or_default() += 1;
        }
        let classes: Vec<String> = classes.iter().map(|(class, n)| format!("{n} {class}")).collect();
        let text = if classes.is_empty() { "failed".to_owned() } else { format!("failed: {}", classes.join(", ")) };
        tiles.push(tile(of(State::Failed), &text, "bad"));
        for state in [State::Unreadable, State::Missing] {
            tiles.extend(Some(of(state)).filter(|n| *n > 0).map(|n| tile(n, state.name(), "bad")));
        }
        let told = self.told;
        let twice = told.twice.iter().map(Vec::len).sum::<usize>();
        for (number, text) in [
            (told.extra.len(), "not in the list"),
            (twice, "with a scan that others have, too"),
            (self.outliers.len(), "outliers"),
        ] {
            tiles.extend(Some(number).filter(|n| *n > 0).map(|n| tile(n, text, "far")));
        }
        let _ = writeln!(out, "<ul class=\"tiles\">{}</ul>", tiles.concat());
    }

    fn versions(&self, out: &mut String) {
        let mut versions: BTreeMap<&str, usize> = BTreeMap::new();
        for row in self.rows.iter().filter(|r| !r.version.is_empty()) {
            *versions.entry(&row.version).or_default() += 1;
        }
        let list: Vec<String> = versions.iter().map(|(v, n)| format!("{} ({})", escape(v), cases(*n))).collect();
        let _ = match versions.len() {
            0 => Ok(()),
            1 => writeln!(out, "<p class=\"soft\">Made by colvis {}.</p>", list[0]),
            n => writeln!(
                out,
                "<p class=\"caution\">The cases were made by {n} versions of colvis: {}. Numbers of different versions may differ for the \
                 same scan: run the batch again with one.</p>",
                list.join(", ")
            ),
        };
    }

    fn reconciliation(&self, out: &mut String) {
        let told = self.told;
        let _ = writeln!(out, "<h2 id=\"list\">List and folders</h2>");
        let source = match told.source {
            Source::Manifest => format!("The manifest has {}.", cases(told.listed)),
            Source::List => format!("The list that the batch left beside the cases has {}.", cases(told.listed)),
            Source::None => "There is no list of the cases: nothing tells which are missing. Give the manifest.".to_owned(),
            Source::Unreadable => {
                "The list that the batch left beside the cases cannot be read: nothing tells which are missing. Give the manifest."
                    .to_owned()
            }
        };
        let folders = self.rows.iter().filter(|r| r.state != State::Missing).count();
        let _ = writeln!(out, "<p>{source} There are folders of {}.</p>", cases(folders));
        let mut rows = String::new();
        let mut row = |what: &str, number: usize, list: String| {
            if number > 0 {
                let _ = writeln!(
                    rows,
                    "<tr><td>{what}</td><td class=\"n\">{number}</td><td class=\"line\">{list}</td></tr>"
                );
            }
        };
        let link = |id: &String| self.link(id);
        row("In the list, but no case", told.missing.len(), some(&told.missing, link));
        row("A case, but not in the list", told.extra.len(), some(&told.extra, link));
        // An id may have a comma.
        let twice = |ids: &Vec<String>| format!("<p>{}</p>", joined(ids, " = ", link));
        row("The same scan in several cases", told.twice.len(), joined(&told.twice, "", twice));
        let unreadable: Vec<String> =
            self.rows.iter().filter(|r| r.state == State::Unreadable).map(|r| r.id.clone()).collect();
        row("A record that cannot be read", unreadable.len(), some(&unreadable, link));
        let renamed = |(id, other): &(String, String)| format!("{} (of {})", self.link(id), escape(other));
        row("A folder with the record of another case", told.renamed.len(), some(&told.renamed, renamed));
        let interrupted = some(&told.interrupted, |id| escape(id));
        row("Being made, or left by an interrupted run", told.interrupted.len(), interrupted);
        row("A folder without a record", told.without_record.len(), some(&told.without_record, |id| escape(id)));
        let _ = match (rows.is_empty(), told.source) {
            (false, _) => writeln!(out, "<div class=\"scroll\"><table>\n{rows}</table></div>"),
            (true, Source::Manifest | Source::List) => {
                writeln!(
                    out,
                    "<p class=\"good\">Every case of the list has its folder, and no scan is there twice.</p>"
                )
            }
            (true, _) => writeln!(out, "<p>No scan is there twice.</p>"),
        };
    }

    fn distributions(&self, out: &mut String) {
        let _ = writeln!(out, "<h2 id=\"distributions\">Distributions</h2>");
        if self.distributions.is_empty() {
            let _ = writeln!(out, "<p>No case has a number.</p>");
            return;
        }
        let _ = writeln!(
            out,
            "<p class=\"soft\">The line is the median; the band reaches from the 5 % to the 95 % quantile; dots are outliers. Arrows count \
             cases beyond the drawing.</p><div class=\"charts\">"
        );
        for (n, distribution) in self.distributions.iter().enumerate() {
            let far = self.outliers.iter().filter_map(|o| {
                let value = o.reasons.iter().find(|r| r.distribution == n)?.value;
                Some(Mark { value, id: &self.rows[o.row].id, address: address(o.row) })
            });
            out.push_str(&chart::figure(distribution, far));
        }
        out.push_str("</div>\n");
    }

    fn outliers(&self, out: &mut String) {
        let _ = writeln!(out, "<h2 id=\"outliers\">Outliers</h2>");
        if self.outliers.is_empty() {
            let _ = writeln!(out, "<p>No case lies far outside the others. With fewer than 8 cases, none can.</p>");
            return;
        }
        let more = match self.outliers.len().saturating_sub(MOST_OUTLIERS) {
            0 => String::new(),
            n => format!(" {n} more are in the table, column <i>outlier</i>."),
        };
        let _ = writeln!(
            out,
            "<p class=\"soft\">The farthest first: a number is more than {OUTLIER} robust standard deviations (σ, by the median \
             absolute deviation) from the median. An outlier need not be wrong: look at it.{more}</p><ul class=\"cases\">"
        );
        for outlier in self.outliers.iter().take(MOST_OUTLIERS) {
            let row = &self.rows[outlier.row];
            let _ = write!(
                out,
                "<li class=\"case {}\">{}<h3>{}</h3>{}</li>",
                row.state.name(),
                picture(outlier.row, row),
                self.link(&row.id),
                self.reasons(outlier, true)
            );
        }
        out.push_str("</ul>\n");
    }

    /// Why a case is an outlier.
    fn reasons(&self, outlier: &Outlier, is_whole: bool) -> String {
        let reason = |r: &super::distributions::Reason| {
            let distribution = &self.distributions[r.distribution];
            let measure = distribution.measure();
            let value = with_unit(r.value, measure.unit);
            let sign = if r.score < 0.0 { '−' } else { '+' };
            let far = if r.score.abs() > 99.0 { ">99".to_owned() } else { format!("{:.1}", r.score.abs()) };
            let median = if is_whole { format!(" (median {})", short(distribution.median)) } else { String::new() };
            format!(
                "<p class=\"far\">{}: {}{median}, {sign}{}\u{a0}σ</p>",
                escape(measure.title),
                escape(&value),
                escape(&far)
            )
        };
        outlier.reasons.iter().map(reason).collect()
    }

    fn failures(&self, out: &mut String) {
        let _ = writeln!(out, "<h2 id=\"failures\">Failures</h2>");
        let mut kinds: BTreeMap<(&str, &str, &str), Vec<&String>> = BTreeMap::new();
        let mut classes: BTreeMap<&str, usize> = BTreeMap::new();
        for row in self.rows.iter().filter(|r| r.state != State::Missing) {
            for failure in &row.failures {
                *classes.entry(&failure.class).or_default() += 1;
                kinds.entry((&failure.class, &failure.step, &failure.line)).or_default().push(&row.id);
            }
        }
        if kinds.is_empty() {
            let _ = writeln!(out, "<p class=\"good\">No case failed.</p>");
            return;
        }
        let mut kinds: Vec<_> = kinds.into_iter().collect();
        // The most frequent class first, and in it the most frequent line.
        kinds.sort_by_key(|((class, ..), ids)| {
            (std::cmp::Reverse(classes[class]), *class, std::cmp::Reverse(ids.len()))
        });
        let _ = writeln!(
            out,
            "<div class=\"scroll\"><table>\n<tr><th>Class</th><th>Step</th><th>Error</th><th class=\"n\">Cases</th><th></th></tr>"
        );
        for ((class, step, line), ids) in kinds.iter().take(MOST_FAILURES) {
            let _ = writeln!(
                out,
                "<tr><td>{}</td><td>{}</td><td class=\"line\">{}</td><td class=\"n\">{}</td><td class=\"line\">{}</td></tr>",
                escape(class),
                escape(step),
                escape(line),
                ids.len(),
                some(ids, |id| self.link(id))
            );
        }
        out.push_str("</table></div>\n");
        if kinds.len() > MOST_FAILURES {
            let _ = writeln!(out, "<p>{} more lines are in the table.</p>", kinds.len() - MOST_FAILURES);
        }
    }

    fn cost(&self, out: &mut String) {
        let _ = writeln!(out, "<h2 id=\"cost\">Time and memory</h2>");
        let mut rows = String::new();
        for (n, step) in Step::ALL.iter().enumerate() {
            let costs = || self.rows.iter().filter_map(|r| r.costs[n]);
            let mut seconds: Vec<f64> = costs().filter_map(|c| c.seconds).filter(|s| s.is_finite()).collect();
            seconds.sort_unstable_by(f64::total_cmp);
            let peak = costs().filter_map(|c| c.peak_bytes).reduce(f64::max);
            let at = |share: f64| quantile(&seconds, share).map_or_else(|| "–".to_owned(), short);
            if costs().count() > 0 {
                let _ = writeln!(
                    rows,
                    "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
                     <td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
                    step.name(),
                    costs().count(),
                    at(0.5),
                    at(0.95),
                    at(1.0),
                    short(seconds.iter().sum::<f64>() / 3600.0),
                    peak.map_or_else(|| "–".to_owned(), |bytes| short((bytes / 1_048_576.0).round()))
                );
            }
        }
        let _ = match rows.is_empty() {
            true => writeln!(out, "<p>Nothing was made.</p>"),
            false => writeln!(
                out,
                "<div class=\"scroll\"><table>\n<tr><th>Step</th><th class=\"n\">Cases</th><th class=\"n\">Median, s</th>\
                 <th class=\"n\">95 %, s</th><th class=\"n\">Longest, s</th><th class=\"n\">All, h</th><th class=\"n\">Most memory, MiB</th></tr>\n\
                 {rows}</table></div>"
            ),
        };
    }

    /// The cases of a page.
    fn cases(&self, page: usize, reasons: &BTreeMap<usize, &Outlier>, out: &mut String) {
        let first = page * TOGETHER;
        let shown = &self.rows[first.min(self.rows.len())..(first + TOGETHER).min(self.rows.len())];
        let _ = writeln!(out, "<h2 id=\"cases\">Cases</h2>");
        self.contents(page, out);
        let states: String = State::ALL.iter().map(|s| format!("<option>{}</option>", s.name())).collect();
        let here = if self.pages() > 1 { " on this page" } else { "" };
        let _ = writeln!(
            out,
            "<div class=\"tools\" hidden><label>Find{here} <input id=\"text\" type=\"search\" size=\"24\"></label>\
             <label>State <select id=\"state\"><option value=\"\">all</option>{states}</select></label>\
             <span id=\"count\" role=\"status\"></span></div>\n<ul class=\"cases all\">"
        );
        for (n, row) in (first..).zip(shown) {
            let _ = write!(
                out,
                "<li class=\"case {0}\" id=\"c{n}\">{1}<h3>{2}</h3>",
                row.state.name(),
                picture(n, row),
                escape(&row.id)
            );
            if let Some(failure) = row.failures.first() {
                let class = if failure.class == row.state.name() {
                    String::new()
                } else {
                    format!("{}, {}: ", escape(&failure.class), escape(&failure.step))
                };
                let _ = write!(out, "<p class=\"bad why\">{}: {class}{}</p>", row.state.name(), escape(&failure.line));
            }
            let facts = ON_CARD.iter().filter_map(|name| {
                let n = MEASURES.iter().position(|m| m.name == *name)?;
                let (measure, value) = (&MEASURES[n], row.values[n]?);
                let text = escape(&with_unit(value * measure.scale, measure.unit));
                Some(match *name {
                    "caliber_mm" => format!("{text} wide"),
                    "distended" => format!("{text} distended"),
                    "coverage" => format!("{text} seen"),
                    "candidates" if value == 1.0 => "1 candidate".to_owned(),
                    "candidates" => format!("{text} candidates"),
                    _ => text,
                })
            });
            let facts: Vec<String> = facts.collect();
            if !facts.is_empty() {
                let _ = write!(out, "<p>{}</p>", facts.join(" · "));
            }
            if let Some(outlier) = reasons.get(&n) {
                out.push_str(&self.reasons(outlier, false));
            }
            out.push_str("</li>\n");
        }
        out.push_str("</ul>\n");
        self.contents(page, out);
    }

    /// The pages with the ids that each begins with.
    fn contents(&self, page: usize, out: &mut String) {
        if self.pages() < 2 {
            return;
        }
        let link = |n: usize| {
            let first = escape(&self.rows[n * TOGETHER].id);
            if n == page {
                format!("<b>{}: {first} …</b>", n + 1)
            } else {
                format!("<a href=\"{}#cases\">{}: {first} …</a>", name(n), n + 1)
            }
        };
        let links: Vec<String> = (0..self.pages()).map(link).collect();
        let _ = writeln!(out, "<div class=\"pages\">{}</div>", links.join(" "));
    }

    /// A link to a case, from the first page.
    fn link(&self, id: &str) -> String {
        let Ok(n) = self.rows.binary_search_by(|r| r.id.as_str().cmp(id)) else { return escape(id) };
        format!("<a href=\"{}\">{}</a>", address(n), escape(id))
    }
}

/// The address of a case, from the first page.
fn address(row: usize) -> String {
    let page = row / TOGETHER;
    let file = if page == 0 { String::new() } else { name(page) };
    format!("{file}#c{row}")
}

/// The picture of a row, or where it would be.
fn picture(n: usize, row: &Row) -> String {
    match &row.picture {
        Some(_) => format!(
            "<img src=\"{}\" width=\"200\" height=\"200\" loading=\"lazy\" decoding=\"async\" alt=\"The colon of {} from the front\">",
            pictures::name(n),
            escape(&row.id)
        ),
        None => "<div class=\"none\">no picture</div>".to_owned(),
    }
}

/// A number of cases in words.
fn cases(n: usize) -> String {
    if n == 1 { "1 case".to_owned() } else { format!("{n} cases") }
}

/// The first entries of a list, and how many there are beside.
fn some<T>(list: &[T], text: impl Fn(&T) -> String) -> String {
    joined(list, ", ", text)
}

/// As [`some`], with something else between them.
fn joined<T>(list: &[T], between: &str, text: impl Fn(&T) -> String) -> String {
    let shown: Vec<String> = list.iter().take(MOST_IDS).map(text).collect();
    match list.len().saturating_sub(MOST_IDS) {
        0 => shown.join(between),
        n => format!("{} and {n} more", shown.join(between)),
    }
}

#[cfg(test)]
#[path = "page_tests.rs"]
mod tests;
