//! The report: one page that needs nothing else, no script either, and prints.

use std::fmt::Write as _;

use base64::prelude::{BASE64_STANDARD, Engine as _};

use super::Case;
use super::map::{self, Map};
use super::second::{Second, There};
use super::segments::COLOURS;
use crate::app::findings::{Finding, FindingPicture, Quality, SegmentFacts, Tissue};
use crate::cli::candidates::escape;
use crate::error::{Error, Result};
use crate::polyps::answers::Answer;
use crate::render::Frame;

const STYLE: &str = include_str!("page.css");
/// What is said of every report.
const CAUTION: &str =
    "Research software. Not for diagnosis. The category is a draft that follows from what was entered.";

/// What is said of a scan whose findings are none, and were perhaps not looked for.
pub(super) const UNREAD: &str =
    "No reading is noted: the findings tell neither what was seen nor for how long it was looked at.";

/// Returns the page.
pub(super) fn html(case: &Case) -> Result<String> {
    let mut out = String::new();
    let _ = write!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>CT colonography</title><style>{STYLE}</style></head><body>\n\
         <h1>CT colonography</h1>\n<p class=\"soft\">{} Scan {}.</p>\n<p class=\"caution\">{CAUTION}</p>\n",
        escape(&whose(case).unwrap_or_else(|| "Without name or number of the patient.".to_owned())),
        escape(&short(&case.findings.scan))
    );
    category(case, &mut out);
    let list = &case.findings.findings;
    let _ = writeln!(out, "<h2>Findings in the colon</h2>");
    if list.is_empty() {
        let _ = writeln!(out, "<p>None was entered.</p>");
    } else {
        table_of_findings(list, case.second.as_ref(), &mut out);
    }
    if let Some(map) = &case.map {
        colon(case, map, &mut out)?;
    }
    for (n, (finding, pictures)) in list.iter().zip(&case.pictures).enumerate() {
        let there = case.second.as_ref().map(|s| s.findings.get(n).and_then(Option::as_ref));
        card(finding, pictures, there, &mut out)?;
    }
    outside(case, &mut out);
    let both = case.second.is_some();
    quality("Quality by segment", &case.quality, both, &mut out);
    if let Some(second) = &case.second {
        quality("Quality by segment, second position", &second.quality, both, &mut out);
    }
    answers(case, &mut out);
    let _ = write!(
        out,
        "<footer>colvis {}. Places are world mm, LPS (x to the left, y to posterior, z to superior). Diameters are the largest ones without \
         a stalk. {CAUTION}</footer>\n</body></html>\n",
        env!("CARGO_PKG_VERSION")
    );
    Ok(out)
}

/// Returns patient and study in words; `None` if they are not known or must not be written.
#[cfg(feature = "dicom")]
fn whose(case: &Case) -> Option<String> {
    use crate::dicom::{day, person};
    use crate::volume::io::identity as tags;
    let study = Some(&case.study).filter(|study| !study.is_anonymous())?;
    let of = |tag| study.text(tag).filter(|text| !text.is_empty());
    let parts = [
        of(tags::PATIENT_NAME).map(person),
        of(tags::PATIENT_ID).map(|id| format!("number {id}")),
        of(tags::BIRTH_DATE).map(|date| format!("born {}", day(date))),
        of(tags::SEX).map(str::to_owned),
        of(tags::STUDY_DATE).map(|date| format!("study of {}", day(date))),
        of(tags::STUDY_DESCRIPTION).map(str::to_owned),
        of(tags::ACCESSION).map(|number| format!("accession {number}")),
    ];
    let words = parts.into_iter().flatten().collect::<Vec<_>>().join("; ");
    (!words.is_empty()).then(|| format!("{words}."))
}

/// Without DICOM, no input tells.
#[cfg(not(feature = "dicom"))]
fn whose(_: &Case) -> Option<String> {
    None
}

fn category(case: &Case, out: &mut String) {
    let (scheme, findings, draft) = (&case.scheme, &case.findings, case.draft());
    let _ = write!(
        out,
        "<div class=\"category\"><p><strong>{}</strong> <span class=\"soft\">draft, {}</span></p><p>Because: {}.</p>",
        escape(&draft.category),
        escape(&scheme.title),
        escape(&draft.because)
    );
    if !draft.advice.is_empty() {
        let _ = write!(out, "<p>{}</p>", escape(&draft.advice));
    }
    if !draft.unmeasured.is_empty() {
        let _ = write!(
            out,
            "<p class=\"bad\">Not counted, because without a diameter: {}.</p>",
            escape(&draft.unmeasured.join(", "))
        );
    }
    if !findings.tells_a_reading() {
        let _ = write!(out, "<p class=\"bad\">{UNREAD}</p>");
    }
    match scheme.outside(&findings.outside) {
        Some(c) => _ = write!(out, "<p><strong>{}</strong> {}, as entered.</p>", escape(&c.name), escape(&c.says)),
        None => _ = write!(out, "<p class=\"soft\">No category outside the colon was entered.</p>"),
    }
    let _ = writeln!(out, "<p class=\"soft\">{}</p></div>", escape(&scheme.source));
}

fn table_of_findings(list: &[Finding], second: Option<&Second>, out: &mut String) {
    let there = if second.is_some() { "<th>second position</th>" } else { "" };
    let _ = writeln!(
        out,
        "<table><tr><th>No.</th><th>Segment</th><th class=\"n\">from the rectum</th><th class=\"n\">diameter</th><th class=\"n\">height</th>\
         <th>form</th><th>tissue</th><th class=\"n\">confidence</th>{there}</tr>"
    );
    for (n, f) in list.iter().enumerate() {
        let there = second.map_or_else(String::new, |s| {
            let told = s.findings.get(n).and_then(Option::as_ref).map_or_else(|| "–".to_owned(), There::text);
            format!("<td>{}</td>", escape(&told))
        });
        let mm = |x: Option<f64>, digits: usize| x.map_or_else(|| "–".to_owned(), |x| format!("{x:.digits$} mm"));
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td>{there}</tr>",
            escape(&f.id),
            escape(f.segment.as_deref().unwrap_or("–")),
            mm(f.along_mm.map(|mm| (mm / 10.0).round() * 10.0), 0),
            mm(f.diameter_mm, 1),
            mm(f.height_mm, 1),
            f.morphology.map_or("–", |m| m.name()),
            tissue(f.tissue),
            f.confidence.map_or_else(|| "–".to_owned(), |c| format!("{c:.2}"))
        );
    }
    let _ = writeln!(out, "</table>");
}

fn tissue(tissue: Option<Tissue>) -> &'static str {
    match tissue {
        Some(Tissue::Soft) => "soft tissue",
        Some(Tissue::Fat) => "fat",
        None => "–",
    }
}

/// Writes the colon from outside.
fn colon(case: &Case, map: &Map, out: &mut String) -> Result<()> {
    let [width, height] = map::SIZE;
    let png = png(&map.rgb, width, height)?;
    let _ = write!(
        out,
        "<figure class=\"map\"><svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"the colon from the front\">\
         <image width=\"{width}\" height=\"{height}\" href=\"data:image/png;base64,{png}\"/>"
    );
    for (text, [x, y]) in [("R", [12.0, 0.5 * height as f64]), ("L", [width as f64 - 12.0, 0.5 * height as f64])] {
        label(text, [x, y], "#777", 18, out);
    }
    for (n, (id, at)) in map.findings.iter().enumerate() {
        let beside = map::beside(*at, n);
        let _ = write!(
            out,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"7\" fill=\"none\" stroke=\"#000\" stroke-width=\"4\"/>\
             <circle cx=\"{0:.1}\" cy=\"{1:.1}\" r=\"7\" fill=\"none\" stroke=\"#fff\" stroke-width=\"2\"/>",
            at[0], at[1]
        );
        label(id, beside, "#000", 18, out);
    }
    let _ = write!(out, "</svg><figcaption>The colon from the front, the patient's right on the left. ");
    for (n, part) in case.along.parts().iter().enumerate() {
        let [r, g, b] = COLOURS[n % COLOURS.len()];
        let seen = case.findings.quality.iter().find(|q| q.segment == part.name).and_then(|q| q.coverage);
        let seen = seen.map_or_else(String::new, |share| format!(" ({:.0} % seen)", 100.0 * share));
        let _ = write!(
            out,
            "<span class=\"name\"><span class=\"swatch\" style=\"background:rgb({r},{g},{b})\"></span>{}{seen}</span> ",
            escape(part.name)
        );
    }
    let _ = writeln!(out, "</figcaption></figure>");
    Ok(())
}

/// Writes a finding with its pictures. `there` is what it is in the second position: `None` without one, and within it `None` if that is not
/// known.
fn card(finding: &Finding, pictures: &[FindingPicture], there: Option<Option<&There>>, out: &mut String) -> Result<()> {
    let p = finding.place;
    let _ = write!(
        out,
        "<div class=\"finding\"><h3>Finding {}{}</h3><p>{}</p>",
        escape(&finding.id),
        finding.segment.as_ref().map_or_else(String::new, |s| format!(", {}", escape(s))),
        escape(&facts(finding))
    );
    if !finding.note.is_empty() {
        let _ = write!(out, "<p>{}</p>", escape(&finding.note).replace('\n', "<br>"));
    }
    let _ = writeln!(out, "<p class=\"soft\">At {:.1}, {:.1}, {:.1} mm.</p>", p.x, p.y, p.z);
    figures(finding, pictures, out)?;
    match there {
        Some(Some(there)) => {
            let p = there.finding.place;
            let told = escape(&there.text());
            let _ = writeln!(out, "<p>Second position: {told}. At {:.1}, {:.1}, {:.1} mm there.</p>", p.x, p.y, p.z);
            figures(&there.finding, &there.pictures, out)?;
        }
        Some(None) => _ = writeln!(out, "<p class=\"soft\">Its place in the second position is not known.</p>"),
        None => {}
    }
    let _ = writeln!(out, "</div>");
    Ok(())
}

/// Writes the pictures of a finding.
fn figures(finding: &Finding, pictures: &[FindingPicture], out: &mut String) -> Result<()> {
    let _ = write!(out, "<div class=\"pictures\">");
    for picture in pictures {
        let png = png(&picture.rgb, picture.side, picture.side)?;
        let (name, is_scanned) = match picture.name.strip_suffix("-scanned") {
            Some(name) => (name, true),
            None => (picture.name, false),
        };
        let caption = match name {
            "view" => "From the lumen",
            "axial" => "Axial",
            _ => "Along its longest diameter",
        };
        let caption = if is_scanned { format!("{caption}, as scanned, with the tag") } else { caption.to_owned() };
        let side = picture.side as f64;
        let _ = write!(
            out,
            "<figure><svg viewBox=\"0 0 {0} {0}\" role=\"img\" aria-label=\"{caption}, finding {1}\">\
             <image width=\"{0}\" height=\"{0}\" href=\"data:image/png;base64,{png}\"/>",
            picture.side,
            escape(&finding.id)
        );
        // The ends alone: a line would hide what it measures.
        for [x, y] in picture.ends.into_iter().flatten() {
            let _ = write!(
                out,
                "<path d=\"M{:.1} {:.1}h10m-5 -5v10\" stroke=\"#000\" stroke-width=\"3.5\"/><path d=\"M{0:.1} {1:.1}h10m-5 -5v10\" stroke=\"#ff78c8\" stroke-width=\"1.6\"/>",
                x - 5.0,
                y
            );
        }
        if let Some(edges) = &picture.edges {
            let at = [[12.0, 0.5 * side], [side - 12.0, 0.5 * side], [0.5 * side, 16.0], [0.5 * side, side - 8.0]];
            for (text, at) in edges.iter().zip(at) {
                label(text, at, "#ffe14a", 15, out);
            }
        }
        let _ = write!(out, "</svg><figcaption>{caption}</figcaption></figure>");
    }
    let _ = writeln!(out, "</div>");
    Ok(())
}

/// Returns what is known of a finding, in words.
fn facts(f: &Finding) -> String {
    let parts = [
        f.diameter_mm.map(|mm| format!("{mm:.1} mm")),
        f.height_mm.map(|mm| format!("{mm:.1} mm high")),
        f.volume_mm3.map(|mm3| format!("{mm3:.0} mm³")),
        f.morphology.map(|m| m.name().to_owned()),
        f.tissue.map(|t| tissue(Some(t)).to_owned()),
        f.along_mm.map(|mm| format!("{:.0} mm from the rectum", (mm / 10.0).round() * 10.0)),
        f.confidence.map(|c| format!("confidence {c:.2}")),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

fn outside(case: &Case, out: &mut String) {
    let _ = writeln!(out, "<h2>Findings outside the colon</h2>");
    if case.findings.outside.is_empty() {
        let _ = writeln!(out, "<p>None was entered.</p>");
        return;
    }
    let _ = writeln!(out, "<table><tr><th>Category</th><th>What it is</th><th class=\"n\">at, mm</th></tr>");
    for o in &case.findings.outside {
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{:.0}, {:.0}, {:.0}</td></tr>",
            escape(if o.category.is_empty() { "–" } else { &o.category }),
            escape(&o.text),
            o.place.x,
            o.place.y,
            o.place.z
        );
    }
    let _ = writeln!(out, "</table>");
}

fn quality(title: &str, list: &[(Quality, SegmentFacts)], both: bool, out: &mut String) {
    let _ = writeln!(out, "<h2>{title}</h2>");
    if list.is_empty() {
        let _ = writeln!(out, "<p>The segments are not known, because no line leads from the rectum to the cecum.</p>");
        return;
    }
    let _ = writeln!(
        out,
        "<table><tr><th>Segment</th><th class=\"n\">length, mm</th><th class=\"n\">distended</th><th class=\"n\">least caliber, mm</th>\
         <th class=\"n\">wall under tag</th><th class=\"n\">residue, ml</th><th class=\"n\">wall seen</th><th class=\"n\">time</th><th></th></tr>"
    );
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    for (q, facts) in list {
        let seconds = q.seconds.round() as u64;
        let time = if seconds == 0 { "–".to_owned() } else { format!("{}:{:02}", seconds / 60, seconds % 60) };
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td class=\"n\">{:.0}</td><td class=\"n\">{}</td><td class=\"n\">{:.0}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{time}</td><td class=\"bad\">{}</td></tr>",
            escape(&q.segment),
            q.length_mm,
            percent(q.distended),
            q.least_caliber_mm,
            percent(q.fluid),
            facts.residue_ml.map_or_else(|| "–".to_owned(), |ml| format!("{ml:.1}")),
            q.coverage.map_or_else(|| "–".to_owned(), percent),
            if q.adequate { "" } else { "inadequate" }
        );
    }
    let one = if both {
        "For the category, a segment is adequate if it is in either position."
    } else {
        "In one position; the other one may show what this one does not."
    };
    let _ = writeln!(
        out,
        "</table><p class=\"soft\">Distended: share of the length with a caliber of 10 mm or more. A least caliber of 0: collapsed. {one}</p>"
    );
    for (_, facts) in list.iter().filter(|(q, _)| !q.adequate) {
        let _ = writeln!(out, "<p class=\"bad\">{}.</p>", escape(&facts.why));
    }
}

fn answers(case: &Case, out: &mut String) {
    let list = &case.findings.answers;
    if list.is_empty() {
        return;
    }
    let _ = writeln!(out, "<h2>Candidates of the assistant that were answered</h2>");
    let _ = writeln!(out, "<table><tr><th>Rank</th><th>Answer</th><th>Note</th><th class=\"n\">at, mm</th></tr>");
    for a in list {
        let answer = match a.answer {
            Some(Answer::Yes) => "a polyp",
            Some(Answer::No) => "not a polyp",
            Some(Answer::Unsure) => "unsure",
            None => "–",
        };
        let p = a.position;
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{answer}</td><td>{}</td><td class=\"n\">{:.0}, {:.0}, {:.0}</td></tr>",
            a.rank,
            escape(&a.note),
            p.x,
            p.y,
            p.z
        );
    }
    let _ = writeln!(out, "</table><p class=\"soft\">Answers do not count for the category: only findings do.</p>");
}

/// Writes text with a dark rim, in the middle of a place.
fn label(text: &str, [x, y]: [f64; 2], colour: &str, size: u32, out: &mut String) {
    let rim = if colour == "#000" { "#fff" } else { "#000" };
    let _ = write!(
        out,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" text-anchor=\"middle\" dominant-baseline=\"middle\" fill=\"{colour}\" \
         stroke=\"{rim}\" stroke-width=\"3\" paint-order=\"stroke\">{}</text>",
        escape(text)
    );
}

/// Encodes pixels as a PNG in Base64.
fn png(rgb: &[[u8; 3]], width: usize, height: usize) -> Result<String> {
    let mut frame = Frame::new(width, height);
    frame.buffers().0.copy_from_slice(rgb);
    let mut bytes = Vec::new();
    frame.encode_png(&mut bytes).map_err(|e| Error::fault("report.html", e.to_string(), "report it").caused_by(e))?;
    Ok(BASE64_STANDARD.encode(bytes))
}

/// Returns the first digits of a scan's hash.
fn short(scan: &str) -> String {
    scan.rsplit(':').next().unwrap_or_default().chars().take(12).collect()
}
