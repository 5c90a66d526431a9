//! The page of the gallery: one HTML file beside the pictures that needs nothing else.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::json;

use crate::app::look::{SLICE, SLICE_MM};
use crate::app::study::CandidateEntry;
use crate::error::Result;
use crate::math::hash;
use crate::output;
use crate::polyps::{EVIDENCE, FEATURES, Lesion, score, terms};
use crate::render::slice::Slice;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
/// Side of the view, pixels.
pub(super) const VIEW: usize = 320;
/// Length of the scale bars, mm.
const BAR_MM: f64 = 10.0;
/// Length of the marks, and their distance from what they point at and from the border, pixels.
const MARK: [f64; 3] = [12.0, 6.0, 20.0];

/// A picture on a card.
pub(super) struct Picture {
    /// Its file, in the page's folder.
    pub(super) file: String,
    title: &'static str,
    side: usize,
    /// Pixels for each mm at the candidate.
    scale: f64,
    /// Radius of the candidate, mm, where it is marked.
    radius_mm: Option<f64>,
    /// The sides of the patient at its left, right, top and bottom edges.
    edges: Option<[String; 4]>,
}

impl Picture {
    /// A view from the lumen.
    pub(super) fn view(file: String, scale: f64) -> Self {
        Self { file, title: "view", side: VIEW, scale, radius_mm: None, edges: None }
    }

    /// A slice with the candidate in its middle.
    pub(super) fn slice(file: String, title: &'static str, slice: &Slice, radius_mm: f64) -> Self {
        let scale = SLICE as f64 / SLICE_MM;
        Self { file, title, side: SLICE, scale, radius_mm: Some(radius_mm), edges: Some(slice.frame.edges()) }
    }

    /// Returns the figure. The marks are drawn over the pixels, which stay as they are.
    fn html(&self, rank: usize, is_measured: bool) -> String {
        let caption = match (self.title, is_measured) {
            ("view", _) => "From the lumen",
            ("axial", _) => "Axial",
            ("across", true) => "Across its longest diameter",
            ("along", true) => "Along its longest diameter",
            ("across", false) => "Across the wall",
            _ => "Across the wall, turned by 90°",
        };
        let side = self.side as f64;
        let mut marks = String::new();
        if let Some(mm) = self.radius_mm {
            let [length, gap, border] = MARK;
            let near = (mm * self.scale + gap).min(0.5 * side - border - length);
            let far = near + length;
            for turn in [0, 90, 180, 270] {
                let middle = 0.5 * side;
                let _ = write!(
                    marks,
                    "<line transform=\"rotate({turn} {middle} {middle})\" x1=\"{:.1}\" x2=\"{:.1}\" y1=\"{middle}\" y2=\"{middle}\"/>",
                    middle + near,
                    middle + far
                );
            }
        }
        let (left, low) = (12.0, side - 10.0);
        let bar = BAR_MM * self.scale;
        let _ = write!(
            marks,
            "<path class=\"bar\" d=\"M{left} {:.1}v4h{bar:.1}v-4\"/><text x=\"{:.1}\" y=\"{:.1}\">10 mm</text>",
            low - 4.0,
            left + 0.5 * bar,
            low - 8.0
        );
        if let Some(edges) = &self.edges {
            let at = [(9.0, 0.5 * side), (side - 9.0, 0.5 * side), (0.5 * side, 13.0), (0.5 * side, side - 5.0)];
            for (text, (x, y)) in edges.iter().zip(at) {
                let _ = write!(marks, "<text class=\"edge\" x=\"{x:.0}\" y=\"{y:.0}\">{}</text>", escape(text));
            }
        }
        format!(
            "<figure><div class=\"picture\"><img src=\"{0}\" width=\"{1}\" height=\"{1}\" alt=\"{2}, candidate {rank}\">\
             <svg viewBox=\"0 0 {1} {1}\" width=\"{1}\" height=\"{1}\" aria-hidden=\"true\">{marks}</svg></div>\
             <figcaption>{2}</figcaption></figure>\n",
            escape(&self.file),
            self.side,
            escape(caption)
        )
    }
}

/// A candidate with its pictures.
pub(super) struct Card<'a> {
    pub(super) entry: &'a CandidateEntry,
    pub(super) lesion: Option<&'a Lesion>,
    pub(super) pictures: Vec<Picture>,
}

impl Card<'_> {
    fn html(&self, is_ordered: bool) -> String {
        let CandidateEntry { rank, score: own, position, .. } = self.entry;
        let mut facts = vec![format!("score {own:.3}")];
        let measures = [
            ("diameter", self.entry.diameter_mm, "mm"),
            ("height", self.entry.height_mm, "mm"),
            ("volume", self.entry.volume_mm3, "mm³"),
        ];
        facts.extend(measures.into_iter().filter_map(|(name, v, unit)| v.map(|v| format!("{name} {v:.1} {unit}"))));
        facts.extend(
            self.entry
                .coated
                .zip(self.entry.coat_mm)
                .map(|(share, mm)| format!("coated: {:.0} %, {mm:.1} mm of tag", 100.0 * share)),
        );
        facts.extend(self.entry.along_mm.zip(self.entry.segment).map(|(mm, segment)| {
            let from = if is_ordered { "from the rectum" } else { "from its end nearer to the rectum" };
            let part = self.entry.part.map_or_else(String::new, |p| format!("{p}, "));
            format!("{part}segment {segment}, {mm:.0} mm {from}")
        }));
        let facts: Vec<String> = facts.iter().map(|f| format!("<li>{}</li>", escape(f))).collect();
        let pictures: String = self.pictures.iter().map(|p| p.html(*rank, self.lesion.is_some())).collect();
        let answers: String = [("yes", "Yes"), ("no", "No"), ("unsure", "Unsure")]
            .iter()
            .map(|(value, text)| {
                format!("<button type=\"button\" data-answer=\"{value}\" aria-pressed=\"false\">{text}</button>")
            })
            .collect();
        format!(
            "<article class=\"card\" id=\"c{rank}\" data-rank=\"{rank}\" tabindex=\"-1\" aria-label=\"Candidate {rank}\">\n\
             <header><h2>{rank}</h2><ul>{}</ul><span class=\"said\"></span></header>\n\
             <div class=\"pictures\">\n{pictures}</div>\n{}\
             <div class=\"answers\">{answers}<label>Note <textarea rows=\"1\" maxlength=\"2000\"></textarea></label></div>\n\
             <details><summary>Position and features</summary><table>\
             <tr><th>position, mm LPS</th><td>{:.1}, {:.1}, {:.1}</td></tr>{}</table></details>\n</article>\n",
            facts.concat(),
            self.terms(),
            position.x,
            position.y,
            position.z,
            self.features()
        )
    }

    /// Returns bars for the terms of the score, if the score is made of them.
    fn terms(&self) -> String {
        let Some(lesion) = self.lesion.filter(|l| score(l).to_bits() == self.entry.score.to_bits()) else {
            return String::new();
        };
        let most = terms(lesion).fold(1e-9f64, |m, t| m.max(t.1.abs()));
        let mut rows = String::new();
        for (term, value) in terms(lesion) {
            let (side, width) = (if value < 0.0 { "against" } else { "for" }, 50.0 * value.abs() / most);
            let _ = writeln!(
                rows,
                "<tr title=\"{1}\"><th>{0}</th><td class=\"track\"><span class=\"{side}\" style=\"width:{width:.1}%\"></span></td>\
                 <td class=\"n\">{value:+.2}</td><td>{1}</td></tr>",
                escape(term.name),
                escape(term.summary)
            );
        }
        format!("<table class=\"terms\"><caption>Terms of the score</caption>\n{rows}</table>\n")
    }

    fn features(&self) -> String {
        let Some(lesion) = self.lesion else { return String::new() };
        let row = |(name, value): (&str, &f64)| format!("<tr><th>{}</th><td>{value:.4}</td></tr>", escape(name));
        FEATURES.into_iter().zip(&lesion.features).map(row).collect()
    }
}

/// The page.
pub(super) struct Page<'a> {
    /// Name of the scan's file or folder.
    pub(super) scan: &'a str,
    /// True if places are measured from the rectum; else each segment is measured from its own end.
    pub(super) is_ordered: bool,
    /// The whole list.
    pub(super) all: &'a [CandidateEntry],
    /// Those with pictures.
    pub(super) cards: &'a [Card<'a>],
}

impl Page<'_> {
    /// Writes the page. Fails with status 5 if it cannot be written.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let (all, shown) = (self.all.len(), self.cards.len());
        let count = match all - shown {
            0 => format!("{all} candidates, best first."),
            _ => format!("The list has {all} candidates; this page shows the best {shown}."),
        };
        let mut cards: String = self.cards.iter().map(|c| c.html(self.is_ordered)).collect();
        if cards.is_empty() {
            cards.push_str("<p>The detector found nothing that looks like a polyp.</p>\n");
        }
        let listed: Vec<_> =
            self.cards.iter().map(|c| json!({"rank": c.entry.rank, "position": c.entry.position})).collect();
        let list = json!({"scan": self.scan, "fingerprint": self.fingerprint(), "candidates": listed});
        // No text may end the script.
        let list = list.to_string().replace('<', "\\u003c");
        let scan = escape(self.scan);
        output::write_whole(path, |w| {
            write!(
                w,
                "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
                 <meta name=\"viewport\" content=\"width=device-width\">\n<title>Candidates in {scan}</title>\n\
                 <style>\n{STYLE}</style>\n</head>\n<body>\n<h1>Candidates in {scan}</h1>\n\
                 <p class=\"caution\">A second reader's aid, {EVIDENCE}: it is not a diagnosis.</p>\n<p>{count}</p>\n{TOOLS}<main>\n{cards}</main>\n\
                 <script type=\"application/json\" id=\"list\">{list}</script>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n"
            )
        })
    }

    /// Returns a text that differs between lists: the key of the answers that a browser keeps.
    fn fingerprint(&self) -> String {
        let mut sum = hash::bits(0, self.all.len() as u64);
        let mut add = |bits: u64| sum = hash::bits(sum, bits);
        self.scan.bytes().for_each(|b| add(u64::from(b)));
        for entry in self.all {
            entry.position.to_array().map(f64::to_bits).into_iter().for_each(&mut add);
            add(entry.score.to_bits());
        }
        format!("{sum:016x}")
    }
}

/// The bar on top.
const TOOLS: &str = "<div class=\"tools\">\n\
<span id=\"counts\" role=\"status\"></span>\n\
<label>Show <select id=\"filter\"><option value=\"all\">all</option><option value=\"open\">open</option>\
<option value=\"yes\">yes</option><option value=\"no\">no</option><option value=\"unsure\">unsure</option></select></label>\n\
<button type=\"button\" id=\"save\">Save answers</button>\n\
<label>Load answers <input type=\"file\" id=\"load\" accept=\".json,application/json\"></label>\n\
<details><summary>Keys</summary><p><kbd>j</kbd> <kbd>↓</kbd> next, <kbd>k</kbd> <kbd>↑</kbd> previous, <kbd>y</kbd> yes, \
<kbd>n</kbd> no, <kbd>u</kbd> unsure, <kbd>z</kbd> <kbd>Backspace</kbd> undo, <kbd>e</kbd> note (<kbd>Esc</kbd> leaves it), \
<kbd>f</kbd> filter, <kbd>s</kbd> save</p></details>\n\
<span id=\"message\" role=\"alert\"></span>\n</div>\n";

/// Escapes text for HTML, in attributes too.
pub(in crate::cli) fn escape(s: &str) -> String {
    let mut out = String::with_capacity(s.len());
    for c in s.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_scans_are_text() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("index.html");
        let scan = "</script><b onclick=\"x()\" title='y'>&.nii";
        Page { scan, is_ordered: true, all: &[], cards: &[] }.write(&path).unwrap();
        let html = std::fs::read_to_string(&path).unwrap();
        assert_eq!(html.matches("</script>").count(), 2, "only the page's own scripts end");
        assert!(!html.contains("<b ") && html.contains("&lt;b onclick=&quot;x()&quot; title=&#39;y&#39;&gt;&amp;.nii"));
        let list = html.split("id=\"list\">").nth(1).and_then(|t| t.split("</script>").next()).unwrap();
        let list: serde_json::Value = serde_json::from_str(list).unwrap();
        assert_eq!(list["scan"], scan);
    }

    #[test]
    fn a_page_tells_how_much_of_the_list_it_shows() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("index.html");
        let entry = |rank| CandidateEntry {
            rank,
            score: 0.5,
            position: glam::DVec3::splat(rank as f64),
            diameter_mm: None,
            height_mm: None,
            volume_mm3: None,
            along_mm: Some(12.0),
            segment: Some(1),
            part: Some("sigmoid"),
            coated: Some(0.8),
            coat_mm: Some(1.5),
            features: std::collections::BTreeMap::new(),
        };
        let all = [1, 2, 3].map(entry);
        let page = |count: usize, is_ordered| {
            let card = |entry| Card { entry, lesion: None, pictures: vec![Picture::view(format!("{count}.png"), 5.0)] };
            let cards: Vec<Card<'_>> = all.iter().take(count).map(card).collect();
            Page { scan: "s.nii", is_ordered, all: &all, cards: &cards }.write(&path).unwrap();
            std::fs::read_to_string(&path).unwrap()
        };
        let html = page(2, true);
        assert!(html.contains("The list has 3 candidates; this page shows the best 2."));
        assert!(
            html.contains("sigmoid, segment 1, 12 mm from the rectum<") && html.matches("src=\"2.png\"").count() == 2
        );
        assert!(page(3, false).contains("<p>3 candidates, best first.</p>"));
        assert!(!page(3, false).contains("from the rectum"));
        assert!(page(0, true).contains("The detector found nothing"));
    }
}
