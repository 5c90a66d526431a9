//! Tables of numbers, in CSV and HTML format.

use std::fmt::Write;

/// A cell.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Cell {
    /// Text.
    Text(String),
    /// A number, with the number of decimals for display.
    Number(f64, usize),
    /// Not measured.
    None,
}

impl From<&str> for Cell {
    fn from(s: &str) -> Self {
        Self::Text(s.to_owned())
    }
}

impl From<String> for Cell {
    fn from(s: String) -> Self {
        Self::Text(s)
    }
}

impl From<&String> for Cell {
    fn from(s: &String) -> Self {
        Self::Text(s.clone())
    }
}

impl From<bool> for Cell {
    fn from(yes: bool) -> Self {
        if yes { "yes" } else { "no" }.into()
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Self {
        Self::Number(count as f64, 0)
    }
}

/// A number and its decimals for display.
impl From<(f64, usize)> for Cell {
    fn from((v, digits): (f64, usize)) -> Self {
        Self::Number(v, digits)
    }
}

impl From<(Option<f64>, usize)> for Cell {
    fn from((v, digits): (Option<f64>, usize)) -> Self {
        v.map(|v| (v, digits)).into()
    }
}

impl<C: Into<Cell>> From<Option<C>> for Cell {
    fn from(c: Option<C>) -> Self {
        c.map_or(Self::None, Into::into)
    }
}

/// Returns a number with its decimals; not measured if it is NaN.
pub(crate) fn known(v: f64, digits: usize) -> Cell {
    (Some(v).filter(|v| !v.is_nan()), digits).into()
}

/// Returns a number with its decimals; not measured if it is NaN or infinite.
pub(crate) fn finite(v: f64, digits: usize) -> Cell {
    (Some(v).filter(|v| v.is_finite()), digits).into()
}

/// The cells of a row, each from a text, a count, a bool, or a number with its decimals.
macro_rules! row {
    ($($cell:expr),+ $(,)?) => { vec![$($crate::report::table::Cell::from($cell)),+] };
}

/// A table with each column beside its cell: `table!(for ROW in ROWS; let NAME = VALUE; "column / mm" => CELL, …)`.
macro_rules! table {
    (for $row:pat in $rows:expr; $(let $name:pat = $value:expr;)* $($column:literal => $cell:expr),+ $(,)?) => {{
        let mut t = $crate::report::table::Table::new(&[$($column),+]);
        for $row in $rows {
            $(let $name = $value;)*
            t.row($crate::report::table::row![$($cell),+]);
        }
        t
    }};
}
pub(crate) use {row, table};

/// A table. Units are part of the column names.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Creates a table without rows.
    pub(crate) fn new(columns: &[&str]) -> Self {
        Self { columns: columns.iter().map(|&c| c.to_owned()).collect(), rows: Vec::new() }
    }

    /// Adds a row with a cell for each column.
    pub(crate) fn row(&mut self, cells: Vec<Cell>) {
        debug_assert_eq!(cells.len(), self.columns.len());
        self.rows.push(cells);
    }

    /// True if it has no rows.
    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Returns the table as comma-separated values (RFC 4180) with full precision. `inf` is infinite, an empty field was not
    /// measured.
    pub(crate) fn csv(&self) -> String {
        let quote = |s: &str| {
            if s.contains([',', '"', '\n', '\r']) { format!("\"{}\"", s.replace('"', "\"\"")) } else { s.to_owned() }
        };
        let mut out = self.columns.iter().map(|c| quote(c)).collect::<Vec<_>>().join(",") + "\n";
        for row in &self.rows {
            let cells: Vec<String> = row
                .iter()
                .map(|c| match c {
                    Cell::Text(t) => quote(t),
                    Cell::Number(v, _) => format!("{v}"),
                    Cell::None => String::new(),
                })
                .collect();
            out.push_str(&cells.join(","));
            out.push('\n');
        }
        out
    }

    /// Returns the table as HTML.
    pub(crate) fn html(&self) -> String {
        let mut out = String::from("<table><tr>");
        for c in &self.columns {
            let _ = write!(out, "<th>{}</th>", escape(c));
        }
        out.push_str("</tr>\n");
        for row in &self.rows {
            out.push_str("<tr>");
            for cell in row {
                let _ = match cell {
                    Cell::Text(t) => write!(out, "<td>{}</td>", escape(t)),
                    Cell::Number(v, _) if v.is_infinite() => write!(out, "<td class=n>∞</td>"),
                    Cell::Number(v, digits) => write!(out, "<td class=n>{v:.digits$}</td>"),
                    Cell::None => write!(out, "<td class=n>–</td>"),
                };
            }
            out.push_str("</tr>\n");
        }
        out + "</table>\n"
    }
}

/// Escapes text for HTML.
pub(crate) fn escape(s: &str) -> String {
    s.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_keeps_numbers_and_quotes_words() {
        let mut t = Table::new(&["a, b", "n"]);
        t.row(vec!["say \"x\"".into(), Cell::Number(0.1234567, 2)]);
        t.row(vec!["<i>".into(), Cell::Number(f64::INFINITY, 2)]);
        t.row(vec!["none".into(), Cell::None]);
        assert_eq!(t.csv(), "\"a, b\",n\n\"say \"\"x\"\"\",0.1234567\n<i>,inf\nnone,\n");
        assert!(t.html().contains("&lt;i&gt;") && t.html().contains("0.12") && t.html().contains('∞'));
    }
}
