//! Folders of slices: DICOM or PNG, recognised by content.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::passed::{self, Passed};
use super::recognise::{HEAD, is_bare_dicom, is_dicom, is_png};
use super::{png, source};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Maximum depth of nested folders.
const DEEPEST: usize = 8;
/// Maximum number of files; more than any scan has.
const MOST_FILES: usize = 200_000;

/// The slices of a folder, in natural order of names.
pub(crate) enum Folder {
    /// DICOM files, including those in subfolders.
    Dicom(Vec<PathBuf>),
    /// PNG slices directly in the folder.
    Png(Vec<PathBuf>),
}

/// Opens a folder and recognises its contents. Also returns notes on what is skipped. Fails with status 3 if the folder is
/// empty, unreadable or contains neither kind, or if a file among PNG slices is not a PNG.
pub(crate) fn open(path: &Path, progress: &Progress) -> Result<(Folder, Vec<String>)> {
    progress.stage("reading the folder", 0);
    let (mut files, mut passed) = (Vec::new(), Passed::default());
    collect(path, DEEPEST, &mut files, &mut passed, progress)?;
    let (mut dicom, mut png, mut rest) = (Vec::new(), Vec::new(), Vec::new());
    for file in &files {
        progress.advance(1)?;
        let mut head = Vec::new();
        let read = source::open(file)
            .and_then(|(f, _)| f.take(HEAD).read_to_end(&mut head).map_err(|e| source::unreadable(file, e)));
        if let Err(e) = read {
            rest.push((file, Err(e)));
        } else if is_dicom(&head) || is_bare_dicom(&head) {
            dicom.push(file.clone());
        } else if is_png(&head) && file.parent() == Some(path) {
            png.push(file.clone());
        } else {
            rest.push((file, Ok(head)));
        }
    }
    if dicom.is_empty() && !png.is_empty() {
        let notes = png::check_folder(path, &png, rest, passed)?;
        return Ok((Folder::Png(png), notes));
    }
    if dicom.is_empty() && rest.len() == files.len() {
        // A folder of which nothing can be read says why.
        if let Some((_, Err(e))) = rest.iter().find(|(_, head)| head.is_err()) {
            return Err(e.clone());
        }
    }
    if !dicom.is_empty() {
        let patterns: BTreeSet<String> = dicom.iter().map(|f| passed::pattern(f)).collect();
        for (file, head) in rest {
            let kind = match head {
                Err(_) => Some(passed::Kind::Unreadable),
                Ok(head) => passed::kind(file, &head, patterns.contains(&passed::pattern(file))),
            };
            if let Some(kind) = kind {
                passed.add(kind, file);
            }
        }
        return Ok((Folder::Dicom(dicom), passed.notes(path)));
    }
    let scan = files.iter().find(|f| {
        let name = f.to_string_lossy().to_ascii_lowercase();
        [".nii", ".nii.gz", ".mha", ".mhd", ".nrrd", ".nhdr"].iter().any(|e| name.ends_with(e))
    });
    Err(match (scan, files.len()) {
        (Some(file), _) => {
            Error::file(path, "is a folder without slices (DICOM or PNG)", format!("name the file: {}", file.display()))
        }
        (None, 0) => Error::file(path, "is an empty folder", "give a folder of DICOM or PNG slices"),
        (None, n) => {
            Error::file(path, format!("is a folder of {n} files, none of them DICOM or PNG"), super::SUPPORTED)
        }
    })
}

fn collect(
    path: &Path,
    depth: usize,
    files: &mut Vec<PathBuf>,
    passed: &mut Passed,
    progress: &Progress,
) -> Result<()> {
    progress.check()?;
    let fail = |e: std::io::Error| source::unreadable(path, e);
    let entries = std::fs::read_dir(path).and_then(Iterator::collect::<std::io::Result<Vec<_>>>);
    let mut entries = match entries {
        // Of the folder that was asked for, this is an error.
        Err(e) if depth == DEEPEST => return Err(fail(e)),
        Err(_) => {
            passed.add(passed::Kind::UnreadableFolder, path);
            return Ok(());
        }
        Ok(entries) => entries,
    };
    entries.sort_by(|a, b| {
        natural(&a.file_name().to_string_lossy(), &b.file_name().to_string_lossy())
            .then_with(|| a.file_name().cmp(&b.file_name()))
    });
    for entry in entries {
        let path = entry.path();
        // Do not follow links to folders: they may form a cycle.
        let Ok(kind) = entry.file_type() else {
            passed.add(passed::Kind::Unreadable, &path);
            continue;
        };
        if kind.is_dir() {
            if depth > 0 {
                collect(&path, depth - 1, files, passed, progress)?;
            } else {
                passed.add(passed::Kind::DeepFolder, &path);
            }
        } else if kind.is_file() || (kind.is_symlink() && path.is_file()) {
            if files.len() >= MOST_FILES {
                let why = format!("is file {MOST_FILES} of the folder");
                return Err(Error::file(&path, why, "give the folder of one scan"));
            }
            files.push(path);
        } else if kind.is_symlink() {
            passed.add(passed::Kind::Link, &path);
        }
    }
    Ok(())
}

/// Compares names by the value of the numbers in them: `s2` comes before `s10`.
fn natural(a: &str, b: &str) -> std::cmp::Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let (Some(x), Some(y)) = (a.chars().next(), b.chars().next()) else { return a.len().cmp(&b.len()) };
        if x.is_ascii_digit() && y.is_ascii_digit() {
            let split = |s: &str| s.find(|c: char| !c.is_ascii_digit()).unwrap_or(s.len());
            let ((m, rest_a), (n, rest_b)) = (a.split_at(split(a)), b.split_at(split(b)));
            let (m, n) = (m.trim_start_matches('0'), n.trim_start_matches('0'));
            let order = m.len().cmp(&n.len()).then_with(|| m.cmp(n));
            if order.is_ne() {
                return order;
            }
            (a, b) = (rest_a, rest_b);
        } else {
            if x != y {
                return x.cmp(&y);
            }
            (a, b) = (&a[x.len_utf8()..], &b[y.len_utf8()..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_count_by_value() {
        let mut names = ["s10.png", "s2.png", "s010a.png", "a.png", "s1.png", "s99999999999999999999999.png"];
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(names, ["a.png", "s1.png", "s2.png", "s10.png", "s010a.png", "s99999999999999999999999.png"]);
    }

    #[test]
    fn a_preview_among_dicom_slices_is_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let png = b"\x89PNG\r\n\x1a\n";
        let pictures = ["p2.png", "p10.png"].map(|name| write(name, png));
        write("notes.txt", b"of the scan");
        let open = || open(folder.path(), &Progress::new()).unwrap().0;
        assert!(matches!(open(), Folder::Png(files) if files == pictures));
        let mut slice = vec![0; 128];
        slice.extend(b"DICM");
        let slice = write("slice", &slice);
        assert!(matches!(open(), Folder::Dicom(files) if files == [slice]));
    }
}
