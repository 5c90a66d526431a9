//! Files that are read or written with the one that is named: data files beside headers, and the slices of a folder.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::folder::{self, Folder};
use super::write;
use crate::progress::Progress;

/// Maximum size of a header, bytes.
const LONGEST_HEADER: u64 = 1 << 16;

/// The data file that is written beside `path`, if its ending is that of a header alone (`.mhd`, `.nhdr`).
pub fn written_with(path: &Path) -> Option<PathBuf> {
    write::data_file(path)
}

/// The data file that is read with `path`, a header or the first file of a pair. `None` if there is none.
pub fn read_with(path: &Path) -> Option<PathBuf> {
    // The data is beside the header itself, wherever a link to it is.
    let path = &path.canonicalize().ok()?;
    let ending = path.extension()?.to_str()?.to_ascii_lowercase();
    let (mark, names) = match ending.as_str() {
        "mhd" | "mha" => ('=', &["elementdatafile"][..]),
        "nhdr" | "nrrd" => (':', &["data file", "datafile"][..]),
        "hdr" => return ["img", "img.gz"].map(|e| path.with_extension(e)).into_iter().find(|p| p.is_file()),
        _ => return None,
    };
    let mut head = Vec::new();
    std::fs::File::open(path).ok()?.take(LONGEST_HEADER).read_to_end(&mut head).ok()?;
    let text = String::from_utf8_lossy(&head);
    let named = text.lines().find_map(|line| {
        let (key, value) = line.split_once(mark)?;
        names.contains(&key.trim().to_ascii_lowercase().as_str()).then(|| value.trim().to_owned())
    });
    named.filter(|name| !name.eq_ignore_ascii_case("local")).map(|name| path.with_file_name(name))
}

/// True if `file` is one of the slices of a folder.
pub fn is_slice_of(folder: &Path, file: &Path) -> bool {
    match folder::open(folder, &Progress::new()) {
        Ok((Folder::Dicom(files) | Folder::Png(files), _)) => files.iter().any(|f| f == file),
        Err(_) => false,
    }
}
