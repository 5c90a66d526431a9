//! The table: a row a case, for spreadsheets and for programs.

use std::collections::BTreeSet;
use std::path::Path;

use super::super::steps::Step;
use super::distributions::{Distribution, Outlier};
use super::measures::MEASURES;
use super::pictures;
use super::rows::Row;
use crate::error::Result;
use crate::output;

/// Writes the table. A cell of what a case does not have is empty. Fails with status 5.
pub(super) fn write(
    path: &Path,
    rows: &[Row],
    listed: Option<&BTreeSet<String>>,
    distributions: &[Distribution],
    outliers: &[Outlier],
) -> Result<()> {
    let mut far: Vec<Option<&Outlier>> = vec![None; rows.len()];
    for outlier in outliers {
        far[outlier.row] = Some(outlier);
    }
    output::write_whole(path, |w| {
        let mut table = csv::Writer::from_writer(w);
        table.write_record(columns())?;
        for (n, (row, far)) in rows.iter().zip(far).enumerate() {
            table.write_record(cells(n, row, listed, distributions, far))?;
        }
        table.flush()
    })
}

/// The names of the columns.
fn columns() -> Vec<String> {
    let first =
        ["id", "state", "class", "step", "error", "also_failed", "listed", "version", "scan", "voxels", "scan_bytes"];
    let costs = Step::ALL.iter().flat_map(|s| ["seconds", "peak_bytes"].map(|what| format!("{}_{what}", s.name())));
    let last = ["outlier", "outlier_score", "picture"];
    let own = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
    let measures = MEASURES.iter().map(|m| m.name.to_owned());
    own(&first).into_iter().chain(measures).chain(costs).chain(own(&last)).collect()
}

fn cells(
    n: usize,
    row: &Row,
    listed: Option<&BTreeSet<String>>,
    distributions: &[Distribution],
    far: Option<&Outlier>,
) -> Vec<String> {
    let first = row.failures.first();
    let text = |get: fn(&super::rows::Failure) -> &String| first.map_or_else(String::new, |f| plain(get(f)));
    let also: Vec<&str> = row.failures.iter().skip(1).map(|f| f.step.as_str()).collect();
    let listed = listed.map_or("", |l| if l.contains(&row.id) { "yes" } else { "no" });
    let whole = |x: Option<u64>| x.map_or_else(String::new, |x| x.to_string());
    let number = |x: Option<f64>| x.map_or_else(String::new, |x| x.to_string());
    let mut all = vec![
        plain(&row.id),
        row.state.name().to_owned(),
        text(|f| &f.class),
        text(|f| &f.step),
        text(|f| &f.line),
        plain(&also.join(" ")),
        listed.to_owned(),
        plain(&row.version),
        plain(&row.content),
        whole(row.voxels),
        whole(row.bytes),
    ];
    all.extend(row.values.map(number));
    all.extend(row.costs.iter().flat_map(|c| [c.and_then(|c| c.seconds), c.and_then(|c| c.peak_bytes)]).map(number));
    let reasons = far.map_or(&[][..], |far| &far.reasons);
    let names: Vec<&str> = reasons.iter().map(|r| distributions[r.distribution].measure().name).collect();
    all.push(names.join(" "));
    all.push(number(reasons.first().map(|r| (10.0 * r.score).round() / 10.0)));
    all.push(if row.picture.is_some() { pictures::name(n) } else { String::new() });
    all
}

/// Returns text for a cell. A spreadsheet takes what begins with certain characters for a formula and runs it.
fn plain(text: &str) -> String {
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let is_formula = text.trim_start().starts_with(['=', '+', '-', '@', '＝', '＋', '－', '＠']);
    if is_formula { format!("'{text}") } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::batch::group::rows::{Failure, State};

    #[test]
    fn no_cell_is_a_formula_and_every_row_has_all_columns() {
        for (text, cell) in [
            ("=1+1", "'=1+1"),
            ("+a", "'+a"),
            ("-a", "'-a"),
            ("@a", "'@a"),
            (" =a", "' =a"),
            ("\t=a", "' =a"),
            ("a\n=b", "a =b"),
            ("a=b", "a=b"),
            ("", ""),
        ] {
            assert_eq!(plain(text), cell);
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cases.csv");
        let mut row = Row::unknown("=cmd, \"x\"", State::Failed, "input", "-1 of\nmany");
        row.failures.push(Failure { class: String::new(), step: "fly".to_owned(), line: String::new() });
        row.values[0] = Some(-12.5);
        let listed = BTreeSet::from(["other".to_owned()]);
        let rows = [row, Row::unknown("other", State::Missing, "missing", "no")];
        write(&path, &rows, Some(&listed), &[], &[]).unwrap();
        let mut table = csv::Reader::from_path(&path).unwrap();
        let columns = table.headers().unwrap().clone();
        let read: Vec<_> = table.records().map(|r| r.unwrap()).collect();
        let cell = |row: usize, name: &str| &read[row][columns.iter().position(|c| c == name).unwrap()];
        assert_eq!([cell(0, "id"), cell(0, "error"), cell(0, "also_failed")], ["'=cmd, \"x\"", "'-1 of many", "fly"]);
        assert_eq!(
            [cell(0, "length_mm"), cell(0, "lumen_ml"), cell(0, "listed")],
            ["-12.5", "", "no"],
            "a number is one"
        );
        assert_eq!([cell(1, "state"), cell(1, "listed"), cell(1, "fly_seconds")], ["missing", "yes", ""]);
        let unique: BTreeSet<&str> = columns.iter().collect();
        assert_eq!(unique.len(), columns.len());
    }
}
