//! Files of a folder that are skipped: counted by kind, with the name of the first, so that no slice is lost silently.

use std::path::{Path, PathBuf};

use super::recognise::{HEAD, is_bare_dicom, is_dicom, is_png};
use super::source;

/// Why a file is skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    /// It has no bytes.
    Empty,
    /// Its name or its first bytes are those of a slice, but it is not one.
    Damaged,
    /// It is DICOM, packed by gzip.
    Gzip,
    /// It is a packed archive.
    Archive,
    /// It cannot be read.
    Unreadable,
    /// A folder that cannot be read.
    UnreadableFolder,
    /// A folder below the deepest that is looked into.
    DeepFolder,
    /// A link to a folder, or one that leads nowhere.
    Link,
    /// A slice in a subfolder, where slices of a folder are read from the folder itself.
    Below,
    /// It is of no known kind.
    Unknown,
}

impl Kind {
    /// Returns the words for `n` files of the kind.
    fn words(self, n: usize) -> &'static str {
        let one = n == 1;
        match self {
            Self::Empty if one => "file is empty and was skipped",
            Self::Empty => "files are empty and were skipped",
            Self::Damaged if one => "file is named like a slice but is not a slice and was skipped",
            Self::Damaged => "files are named like slices but are not slices and were skipped",
            Self::Gzip if one => "slice is compressed with gzip and was skipped (unpack it)",
            Self::Gzip => "slices are compressed with gzip and were skipped (unpack them)",
            Self::Archive if one => "archive was not opened",
            Self::Archive => "archives were not opened",
            Self::Unreadable if one => "file cannot be read and was skipped",
            Self::Unreadable => "files cannot be read and were skipped",
            Self::UnreadableFolder if one => "folder cannot be read and was skipped",
            Self::UnreadableFolder => "folders cannot be read and were skipped",
            Self::DeepFolder if one => "folder is nested too deeply and was skipped",
            Self::DeepFolder => "folders are nested too deeply and were skipped",
            Self::Link if one => "link was not followed",
            Self::Link => "links were not followed",
            Self::Below if one => "PNG file in a subfolder was skipped",
            Self::Below => "PNG files in subfolders were skipped",
            Self::Unknown if one => "file of another kind was skipped",
            Self::Unknown => "files of another kind were skipped",
        }
    }
}

/// The files of a folder that are skipped, in the order in which they were found.
#[derive(Clone, Debug, Default)]
pub(crate) struct Passed(pub Vec<(Kind, PathBuf)>);

impl Passed {
    pub(crate) fn add(&mut self, kind: Kind, path: &Path) {
        self.0.push((kind, path.to_owned()));
    }

    /// Returns one note for each kind, with the first file by its name in `folder`.
    pub(crate) fn notes(&self, folder: &Path) -> Vec<String> {
        let mut kinds: Vec<Kind> = self.0.iter().map(|p| p.0).collect();
        kinds.sort_unstable();
        kinds.dedup();
        let note = |kind: &Kind| {
            let mut own = self.0.iter().filter(|p| p.0 == *kind).map(|p| &p.1).peekable();
            let first = name_in(folder, own.peek()?);
            let n = own.count();
            Some(format!("{n} {}{}{first}", kind.words(n), if n == 1 { ": " } else { ", the first: " }))
        };
        kinds.iter().filter_map(note).collect()
    }
}

/// Returns the name of a file in a folder, fit for one line.
pub(crate) fn name_in(folder: &Path, path: &Path) -> String {
    let name = path.strip_prefix(folder).unwrap_or(path).to_string_lossy().into_owned();
    name.chars().filter(|c| !c.is_control()).take(120).collect()
}

/// Endings of files that accompany scans and hold no slices.
const COMPANIONS: [&str; 54] = [
    "txt", "md", "rtf", "log", "json", "xml", "csv", "tsv", "yaml", "yml", "toml", "ini", "inf", "cfg", "conf", "htm",
    "html", "css", "js", "pdf", "doc", "docx", "xls", "xlsx", "exe", "dll", "bat", "sh", "com", "msi", "app", "jar",
    "lnk", "url", "ico", "icns", "jpg", "jpeg", "png", "gif", "bmp", "svg", "webp", "avi", "mp4", "mov", "db", "md5",
    "sha256", "sql", "nii", "nrrd", "stl", "py",
];
/// Names of such files without an ending.
const COMPANION_NAMES: [&str; 6] = ["dicomdir", "readme", "license", "licence", "version", "changelog"];
/// Endings of slices.
const SLICES: [&str; 5] = ["dcm", "dicom", "ima", "dc3", "img"];

fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// True if a file accompanies scans, by its name.
fn is_companion(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let plain = name.split([';', '.']).next().unwrap_or_default();
    name.starts_with('.')
        || name.ends_with(".nii.gz")
        || COMPANIONS.contains(&&*ending(path))
        || COMPANION_NAMES.contains(&plain)
}

/// Returns a name with a sign for each of its numbers.
pub(crate) fn pattern(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut out = String::new();
    for c in name.chars() {
        match (c.is_ascii_digit(), out.ends_with('#')) {
            (true, true) => {}
            (true, false) => out.push('#'),
            _ => out.extend(c.to_lowercase()),
        }
    }
    out
}

/// Returns why a file that is not a slice is skipped, by its first bytes and its name; `None` if it plainly accompanies the scan.
/// `like_slice` is true if its name is like those of the slices.
pub(crate) fn kind(path: &Path, head: &[u8], like_slice: bool) -> Option<Kind> {
    // What macOS keeps beside a file that it copies (AppleDouble).
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if name.starts_with("._") || head.starts_with(&[0x00, 0x05, 0x16, 0x07]) {
        return None;
    }
    if head.is_empty() {
        // Markers such as `.nomedia`, and logs that stayed empty.
        return (!is_companion(path) || like_slice).then_some(Kind::Empty);
    }
    if head.starts_with(&[0x1F, 0x8B]) {
        let inside = source::head(path, HEAD).is_ok_and(|h| is_dicom(&h) || is_bare_dicom(&h));
        return Some(if inside { Kind::Gzip } else { Kind::Archive }).filter(|_| inside || !is_companion(path));
    }
    if [&b"PK\x03\x04"[..], b"7z\xBC\xAF\x27\x1C", b"BZh", b"\xFD7zXZ\0", b"Rar!\x1A\x07", b"\x28\xB5\x2F\xFD"]
        .iter()
        .any(|magic| head.starts_with(magic))
        && !is_companion(path)
    {
        return Some(Kind::Archive);
    }
    // A preamble is zeros as a rule.
    let preamble = head.len() <= 132 && head.iter().all(|b| *b == 0);
    if like_slice || SLICES.contains(&&*ending(path)) || preamble && !is_companion(path) {
        return Some(Kind::Damaged);
    }
    if is_companion(path) || is_png(head) {
        return None;
    }
    Some(Kind::Unknown)
}
