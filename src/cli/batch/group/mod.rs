//! `colvis batch --group`: one table and one page of all cases of a folder.
//!
//! Only the records of the cases are read, one at a time, and their pictures are linked: ten thousand cases take seconds. Nothing in them
//! identifies a patient, so nothing here does.

mod chart;
mod distributions;
mod measures;
mod page;
mod pictures;
mod reconciliation;
mod rows;
mod table;

use std::path::{Path, PathBuf};

use super::{list, manifest, record};
use crate::cli::messages::print;
use crate::error::{Error, Result};
use crate::output;
use crate::progress::Progress;
use page::Group;
use reconciliation::Source;
use rows::State;

/// Name of the table.
const TABLE: &str = "cases.csv";

/// Makes the report of all cases in a folder. Fails with status 2 if `out` lies in the folder of a case, 3 if there is no case or if the
/// manifest is wrong, 4 if interrupted, 5 if the report cannot be written.
pub(super) fn run(cases: &Path, manifest: Option<&Path>, out: &Path, progress: &Progress) -> Result<()> {
    let no = |why: String| Error::file(cases, why, "give the --out of an earlier colvis batch");
    let dir = std::fs::canonicalize(cases).map_err(|e| no(format!("cannot be read ({})", output::plain(&e))))?;
    check_apart(&dir, out)?;
    let (source, listed) = match manifest {
        Some(path) => (Source::Manifest, Some(manifest::read(path)?.into_iter().map(|c| c.id).collect())),
        None => match dir.join(list::FILE) {
            path if !path.exists() => (Source::None, None),
            path => list::read(&path).map_or((Source::Unreadable, None), |ids| (Source::List, Some(ids))),
        },
    };
    let report = std::fs::canonicalize(out).unwrap_or_default();
    let found = rows::read(cases, &report, progress)?;
    if found.rows.is_empty() {
        return Err(no("holds no case".to_owned()));
    }
    let (mut rows, told) = reconciliation::reconcile(found, source, listed.as_ref());
    let distributions = distributions::all(&rows);
    let outliers = distributions::outliers(&distributions, &rows);
    output::make_folder(out)?;
    // An older page must not show the new pictures. The first page is the last to come back.
    for page in 0.. {
        let path = out.join(page::name(page));
        if page > 0 && !path.exists() {
            break;
        }
        pictures::remove(&path)?;
    }
    pictures::write(out, &mut rows, progress)?;
    table::write(&out.join(TABLE), &rows, listed.as_ref(), &distributions, &outliers)?;
    Group { rows: &rows, told: &told, distributions: &distributions, outliers: &outliers }.write(out)?;
    let counts: Vec<String> = State::ALL
        .iter()
        .map(|state| (rows.iter().filter(|r| r.state == *state).count(), state))
        .filter(|(n, state)| *n > 0 || matches!(state, State::Done | State::Failed))
        .map(|(n, state)| format!("{n} {}", state.name()))
        .collect();
    print(|w| {
        let (extra, twice) = (told.extra.len(), told.twice.len());
        let pairs = if twice == 1 { "scan is" } else { "scans are" };
        writeln!(w, "{} cases: {}; {extra} not in the list, {twice} {pairs} there twice", rows.len(), counts.join(", "))
    })
}

/// Refuses a report in the folder of a case, which a later run would replace. `dir` is the canonical folder of cases. Fails with status 2.
fn check_apart(dir: &Path, out: &Path) -> Result<()> {
    let absolute = std::path::absolute(out).unwrap_or_else(|_| out.to_owned());
    let there = absolute.ancestors().find_map(|p| std::fs::canonicalize(p).ok()).unwrap_or_default();
    let Ok(inside) = there.strip_prefix(dir) else { return Ok(()) };
    let Some(first) = inside.components().next() else { return Ok(()) };
    let name = first.as_os_str().to_string_lossy();
    let is_work = name.starts_with(record::WORK) || name.starts_with(record::OLD);
    if is_work || dir.join(PathBuf::from(first.as_os_str())).join(record::FILE).exists() {
        let why = format!("lies in the folder of the case {name}, which a later run replaces");
        return Err(Error::usage(out.display().to_string(), why, "give another --out"));
    }
    Ok(())
}
