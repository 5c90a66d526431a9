//! Report pages: one self-contained HTML page, and a CSV file for each plot and table beside it.

use base64::prelude::{BASE64_STANDARD, Engine as _};
use std::path::{Path, PathBuf};

use super::dots::Dots;
use super::plot::Plot;
use super::table::{Table, escape};
use crate::error::Result;
use crate::output;

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:1080px;margin:2em auto;padding:0 1em;color:#222}\
table{border-collapse:collapse;margin:1em 0;font-size:13px}th,td{padding:3px 9px;border-bottom:1px solid #ddd;\
text-align:left;vertical-align:top}th{background:#f4f4f4}td.n{text-align:right;font-variant-numeric:tabular-nums}\
svg,img{max-width:100%;height:auto}figure{margin:1em 0}figcaption{font-size:13px;color:#555}\
p.finding{background:#f2f7f2;border-left:4px solid #4a4;padding:.6em 1em}";

/// A page under construction.
pub(crate) struct Page {
    folder: PathBuf,
    title: String,
    body: String,
}

impl Page {
    /// Creates a page `report.html` in `folder`, and the folder. Fails with status 5 if the folder cannot be created.
    pub(crate) fn new(folder: &Path, title: &str) -> Result<Self> {
        output::make_folder(folder)?;
        Ok(Self { folder: folder.to_owned(), title: title.to_owned(), body: String::new() })
    }

    /// Starts a section.
    pub(crate) fn section(&mut self, title: &str) {
        self.body.push_str(&format!("<h2>{}</h2>\n", escape(title)));
    }

    /// Adds a paragraph of plain text.
    pub(crate) fn text(&mut self, text: &str) {
        self.body.push_str(&format!("<p>{}</p>\n", escape(text)));
    }

    /// Adds a finding.
    pub(crate) fn finding(&mut self, text: &str) {
        self.body.push_str(&format!("<p class=finding>{}</p>\n", escape(text)));
    }

    /// Adds findings.
    pub(crate) fn findings(&mut self, all: &[String]) {
        all.iter().for_each(|f| self.finding(f));
    }

    /// Adds a table, and writes `name.csv` beside the page. Fails with status 5 if the CSV file cannot be written.
    pub(crate) fn table(&mut self, name: &str, table: &Table) -> Result<()> {
        self.body.push_str(&table.html());
        self.csv(name, table)
    }

    /// Adds a plot with a caption, and writes its numbers to `name.csv`. Fails with status 5 if the CSV file cannot be written,
    /// status 1 if the plot cannot be drawn.
    pub(crate) fn plot(&mut self, name: &str, plot: &Plot, caption: &str) -> Result<()> {
        self.figure(name, &plot.svg()?, caption, &plot.table())
    }

    /// Adds a dot plot with a caption, and writes its numbers to `name.csv`. Fails with status 5 if the CSV file cannot be written,
    /// status 1 if the plot cannot be drawn.
    pub(crate) fn dots(&mut self, name: &str, dots: &Dots, caption: &str) -> Result<()> {
        self.figure(name, &dots.svg()?, caption, &dots.table())
    }

    fn figure(&mut self, name: &str, svg: &str, caption: &str, numbers: &Table) -> Result<()> {
        let figure = format!("<figure>\n{svg}\n<figcaption>{}</figcaption></figure>\n", escape(caption));
        self.body.push_str(&figure);
        self.csv(name, numbers)
    }

    /// Writes only `name.csv`. Fails with status 5 if it cannot be written.
    pub(crate) fn csv(&self, name: &str, table: &Table) -> Result<()> {
        let path = self.folder.join(format!("{name}.csv"));
        output::write_whole(&path, |w| w.write_all(table.csv().as_bytes()))
    }

    /// Embeds a PNG below a caption that opens it.
    pub(crate) fn picture(&mut self, png: &[u8], caption: &str) {
        let caption = escape(caption);
        self.body.push_str(&format!(
            "<details><summary>{caption}</summary><img alt=\"{caption}\" src=\"data:image/png;base64,{}\"></details>\n",
            BASE64_STANDARD.encode(png)
        ));
    }

    /// Writes the page. Fails with status 5 if it cannot be written.
    pub(crate) fn finish(self) -> Result<()> {
        output::write_whole(&self.folder.join("report.html"), |w| {
            let title = escape(&self.title);
            write!(
                w,
                "<!DOCTYPE html>\n<html lang=en><meta charset=utf-8><title>{title}</title><style>{STYLE}</style>\n\
                 <h1>{title}</h1>\n{}</html>\n",
                self.body
            )
        })
    }
}
