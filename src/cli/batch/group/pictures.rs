//! The pictures of the cases, in the report's own folder, so that it can be moved.

use std::fs;
use std::io;
use std::path::Path;

use super::rows::Row;
use crate::error::Result;
use crate::output;
use crate::progress::Progress;

/// Folder of the pictures.
const FOLDER: &str = "pictures";
/// Number of pictures in a folder: file systems and programs are slow with more.
const TOGETHER: usize = 1000;

/// Returns the name of the picture of a row. Numbers, because an id may be longer than a file's name, and need quotes in an address.
pub(super) fn name(row: usize) -> String {
    format!("{FOLDER}/{}/{row:06}.png", row / TOGETHER)
}

/// Links or copies all pictures; a row whose picture is gone has none from here on. Removes those of an earlier report. Fails with status
/// 4 if interrupted, 5 if one cannot be written.
pub(super) fn write(report: &Path, rows: &mut [Row], progress: &Progress) -> Result<()> {
    for (n, row) in rows.iter_mut().enumerate() {
        progress.check()?;
        let to = report.join(name(n));
        if n % TOGETHER == 0 {
            output::make_folder(to.parent().unwrap_or(report))?;
        }
        // A copy must not be written into the file of a case that an earlier report links to.
        remove(&to)?;
        let Some(from) = row.picture.take() else { continue };
        if fs::symlink_metadata(&from).is_ok_and(|meta| meta.is_file()) {
            // Not every file system has links.
            fs::hard_link(&from, &to)
                .or_else(|_| fs::copy(&from, &to).map(drop))
                .map_err(|e| output::cannot(&to, e))?;
            row.picture = Some(from);
        }
    }
    let last = rows.len().div_ceil(TOGETHER) * TOGETHER;
    (rows.len()..last).try_for_each(|n| remove(&report.join(name(n))))?;
    for folder in (last / TOGETHER..).map(|n| report.join(FOLDER).join(n.to_string())).take_while(|f| f.is_dir()) {
        fs::remove_dir_all(&folder).map_err(|e| output::cannot(&folder, e))?;
    }
    Ok(())
}

/// Removes a file that may be there. Fails with status 5.
pub(super) fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(output::cannot(path, e)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::batch::group::rows::State;

    #[test]
    fn pictures_are_those_of_this_report_and_the_cases_keep_theirs() {
        let dir = tempfile::tempdir().unwrap();
        let report = dir.path().join("report");
        let of = |text: &str| {
            let path = dir.path().join(format!("{text}.png"));
            fs::write(&path, text).unwrap();
            let mut row = Row::unknown(text, State::Done, "", "");
            row.picture = Some(path);
            row
        };
        let mut rows = vec![of("a"), of("b"), of("c")];
        write(&report, &mut rows, &Progress::new()).unwrap();
        assert_eq!(fs::read(report.join("pictures/0/000001.png")).unwrap(), b"b");
        let mut fewer = vec![of("c"), of("gone")];
        fs::remove_file(dir.path().join("gone.png")).unwrap();
        write(&report, &mut fewer, &Progress::new()).unwrap();
        assert!(fewer[0].picture.is_some() && fewer[1].picture.is_none());
        let names: Vec<_> = fs::read_dir(report.join("pictures/0")).unwrap().flatten().map(|e| e.file_name()).collect();
        assert_eq!(names, ["000000.png"]);
        for text in ["a", "b", "c"] {
            assert_eq!(fs::read_to_string(dir.path().join(format!("{text}.png"))).unwrap(), text);
        }
    }
}
