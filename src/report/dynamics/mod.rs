//! `report dynamics`: compares integrators of the rigid body (error against time, stability, conservation), and measures the cost
//! of the clamp to free space, the number of tentacles and mines required, and the gaze. Each study has its own file.

mod clamp;
mod conserved;
mod contenders;
mod looking;
mod mines;
mod precision;
mod reference;
mod repulsion;
mod smooth;
mod stability;
mod tentacles;
mod tube;

use std::path::Path;

use crate::error::Result;
use crate::progress::Progress;
use crate::space::PreparedVolume;

use super::Effort;
use super::page::Page;

// For `report::internals`.
pub use precision::{CASES, Case, SECONDS, errors, forces, start, turning};
pub use reference::{ACCURACY, solve};

/// The subject of the studies.
struct Subject {
    /// How much to measure.
    effort: Effort,
    /// A scan to fly, with its title.
    scan: Option<(String, PreparedVolume)>,
}

/// A study. It measures, writes its part of the page, and returns its findings, one sentence each.
type Study = fn(&Subject, &mut Page, &Progress) -> Result<Vec<String>>;

/// The studies in their order on the page. To add one, add a line here.
const STUDIES: [(&str, Study); 9] = [
    ("error against time", precision::study),
    ("stability", stability::study),
    ("conservation", conserved::study),
    ("steady flight", smooth::study),
    ("cost of the clamp", clamp::study),
    ("tentacles", tentacles::study),
    ("mines", mines::study),
    ("repulsion alone", repulsion::study),
    ("gaze", looking::study),
];

/// Runs all studies, with flights through a scan (and its title) if there is one, and writes the report into `folder`. Returns
/// the findings, one sentence each.
///
/// # Errors
/// Returns status 4 if interrupted or if a scan contains no colon, 5 if a file cannot be written.
pub fn report(
    effort: Effort,
    scan: Option<(String, PreparedVolume)>,
    folder: &Path,
    progress: &Progress,
) -> Result<Vec<String>> {
    let subject = Subject { effort, scan };
    let mut page = Page::new(folder, "colvis: integrators of the rigid body, error against time")?;
    page.text(
        "The camera is a cylinder of 1 g in a sphere of 1.5 mm, with a drag of 6/s. It flies a bent tube whose distances \
         to the wall and to the target, with their gradients and Hessians, are known exactly, under the paper's potential V = C_t D_t + C_s (p/D_s − 1)², and turns its view along the path ahead. Translation and rotation are solved by \
         the same method. Times are for one thread, the minimum of several rounds, because a busy machine only adds time.",
    );
    let mut findings = Vec::new();
    progress.stage("measuring integrators", STUDIES.len() as u64);
    for (title, study) in STUDIES {
        page.section(title);
        let found = study(&subject, &mut page, progress)?;
        page.findings(&found);
        findings.extend(found);
        progress.advance(1)?;
    }
    page.finish()?;
    Ok(findings)
}
