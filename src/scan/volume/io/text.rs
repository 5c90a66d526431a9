//! Helpers for the text headers of MetaImage and NRRD.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::error::{Error, Result};

/// Maximum length of a text header, bytes. Some writers store whole protocols in it.
pub(crate) const MAX_HEADER: u64 = 1 << 20;

/// Parses exactly `N` numbers (or other values) separated by white space.
pub(crate) fn exactly<T: FromStr + Copy, const N: usize>(value: &str) -> Option<[T; N]> {
    some(value)?.try_into().ok()
}

/// Parses all numbers of a line.
pub(crate) fn some<T: FromStr>(value: &str) -> Option<Vec<T>> {
    value.split_whitespace().map(|t| t.parse().ok()).collect()
}

/// Returns the error for an invalid header field.
pub(crate) fn bad(path: &Path, key: &str, value: &str, wanted: &str) -> Error {
    // A damaged header can contain kilobytes in one line.
    let value: String = value.chars().take(60).collect();
    Error::file(path, format!("{key} is {value:?}, not {wanted}"), "correct the header")
}

/// Returns the data file that a header names. It must be in or below the header's folder. Fails with status 3 if the file is
/// missing or elsewhere, by an absolute path, by `..` or behind a link.
pub(crate) fn data_file(header: &Path, name: &str) -> Result<PathBuf> {
    let outside = || {
        Error::file(
            header,
            format!("its data file {name:?} lies outside the header's folder"),
            "move the data beside the header and name it there",
        )
    };
    let missing =
        || Error::file(header, format!("its data file {name:?} does not exist"), "put the data beside the header");
    if name.is_empty() {
        return Err(Error::file(header, "names no data file", "name the data file in the header"));
    }
    let real = header.canonicalize().map_err(|e| super::source::unreadable(header, e))?;
    let folder = real.parent().ok_or_else(outside)?;
    let named = Path::new(name);
    let leaves = named.is_absolute() || named.components().any(|c| c == std::path::Component::ParentDir);
    match folder.join(named).canonicalize() {
        Ok(data) if data.starts_with(folder) && data != folder => Ok(data),
        Ok(_) => Err(outside()),
        // Do not reveal whether something exists elsewhere.
        Err(_) if leaves => Err(outside()),
        Err(_) => Err(missing()),
    }
}

/// Returns the number of voxels for `dims`. Fails with status 3 if a dimension is zero or the product cannot be addressed.
pub(crate) fn voxel_count(path: &Path, dims: [usize; 3]) -> Result<usize> {
    if dims.contains(&0) {
        return Err(Error::file(path, format!("has no voxels (dims {dims:?})"), "correct the header"));
    }
    dims.iter()
        .try_fold(1usize, |n, &d| n.checked_mul(d))
        .filter(|&n| n <= isize::MAX as usize / 8)
        .ok_or_else(|| Error::file(path, format!("dims {dims:?} overflow"), "correct the header"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_names_data_in_its_own_folder_only() {
        let outer = tempfile::tempdir().unwrap();
        let path = |name: &str| outer.path().join(name);
        std::fs::create_dir_all(path("scan/deep")).unwrap();
        for name in ["scan/a.mhd", "scan/a.raw", "scan/deep/b.raw", "other.raw"] {
            std::fs::write(path(name), b"x").unwrap();
        }
        let find = |name: &str| data_file(&path("scan/a.mhd"), name);
        assert_eq!(find("a.raw").unwrap(), path("scan/a.raw").canonicalize().unwrap());
        assert_eq!(find("deep/b.raw").unwrap(), path("scan/deep/b.raw").canonicalize().unwrap());
        let refused = |name: &str, why: &str| {
            let e = find(name).unwrap_err();
            assert!(e.to_string().contains(why), "{name}: {e}");
        };
        let absolute = path("other.raw").canonicalize().unwrap();
        for name in ["../other.raw", "deep/../../other.raw", "../missing.raw", absolute.to_str().unwrap(), "."] {
            refused(name, "outside");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(path("other.raw"), path("scan/link.raw")).unwrap();
            refused("link.raw", "outside");
        }
        refused("b.raw", "does not exist");
        refused("", "names no data file");
    }
}
